"""Sweeps whose points have zeros that only a family of motions explains: they are not judged one by one."""

from dataclasses import replace

import numpy as np
import pytest

import mbstab
from mbstab.analysis.sweep import batched_spectra
from mbstab.analysis.sweep.batched_verdict import NOT_COUNTED, WORD, _zeros
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import UNDECIDED

# Drives by velocities leave the places of three bodies along the track open: no symmetry shifts only one of them.
BOGIE = """
mbstab: 1
parameters:
  v: {value: 100, unit: km/h}
  m: {value: 1200, unit: kg}
  J: {value: 700, unit: kg*m^2}
  mf: {value: 2500, unit: kg}
  Jf: {value: 2600, unit: kg*m^2}
  a: {value: 1.25, unit: m}
  kx: {value: 6, unit: MN*m/rad}
  ky: {value: 5, unit: MN/m}
  r0: {value: 0.46, unit: m}
  lam: {value: 0.1, unit: rad}
  b: {value: 0.75, unit: m}
  f11: {value: 8, unit: MN}
  f22: {value: 7.5, unit: MN}
bodies:
  frame: {type: planar, mass: mf, inertia: Jf, points: {f: [a, 0], r: [-a, 0]}}
  ws1: {type: planar, mass: m, inertia: J}
  ws2: {type: planar, mass: m, inertia: J}
forces:
  cr1: {type: creep, at: ws1, half_gauge: b, conicity: lam, radius: r0, f11: f11, f22: f22}
  cr2: {type: creep, at: ws2, half_gauge: b, conicity: lam, radius: r0, f11: f11, f22: f22}
  s1: {type: bushing, between: [ws1, frame.f], stiffness: [0, ky], torsional_stiffness: kx}
  s2: {type: bushing, between: [ws2, frame.r], stiffness: [0, ky], torsional_stiffness: kx}
  sec: {type: bushing, between: [frame, ground], stiffness: [0, 3e5], damping: [0, 3e4], torsional_stiffness: 1e5}
drives:
  d0: {type: point, at: frame, direction: x, velocity: v}
  d1: {type: point, at: ws1, direction: x, velocity: v}
  d2: {type: point, at: ws2, direction: x, velocity: v}
reference:
  coordinates: {frame: {x: 0, y: 0, theta: 0}, ws1: {x: a, y: 0, theta: 0}, ws2: {x: -a, y: 0, theta: 0}}
"""


@pytest.fixture
def judged_alone(monkeypatch):
    """The points that are judged as `eig` does."""
    found, exact = [], batched_spectra._Work._exact

    def counted(self, i, grounds=None):
        found.append(i)
        return exact(self, i, grounds)

    monkeypatch.setattr(batched_spectra._Work, "_exact", counted)
    return found


def test_a_family_is_followed_at_some_points_and_answers_for_the_others(judged_alone):
    model = mbstab.loads(BOGIE)
    speeds = np.linspace(20.0, 50.0, 200)  # m/s
    swept = model.sweep("v", speeds)
    assert len(judged_alone) <= TOLERANCES.points_guarded + 2
    assert set(swept.verdicts) == {"asymptotically stable up to symmetry"}
    for k in (0, 57, 199):
        answer = model.eig(v=3.6 * float(speeds[k]))
        assert answer.verdict == swept.verdicts[k]
        expected = answer.values()
        expected = expected[np.abs(expected) > 1e-3]
        distance = np.abs(expected[:, None] - swept.branches[k][None, :])
        assert np.all(distance.min(axis=1) <= 1e-6 * np.abs(expected))


def test_zeros_count_only_where_a_gap_tells_them_from_the_others():
    stacked = np.array([np.diag([3.0, 1.0, x]) for x in (0.0, 1e-12, 1e-9, 1e-6)])
    assert _zeros(stacked).tolist() == [1, 1, NOT_COUNTED, 0]


def test_where_one_point_has_another_answer_each_is_judged(judged_alone, monkeypatch):
    plain, asked = batched_spectra._Work._judged, []

    def other(self, i, grounds=None):
        asked.append(i)
        verdict = plain(self, i, grounds)
        return replace(verdict, family=("another",)) if len(asked) == TOLERANCES.points_guarded else verdict

    monkeypatch.setattr(batched_spectra._Work, "_judged", other)
    work = batched_spectra.Evaluator(mbstab.loads(BOGIE).model)
    found = work.spectra({"v": np.linspace(20.0, 40.0, 14)})
    assert set(judged_alone) == set(range(14))
    assert not np.any(found.words == WORD[UNDECIDED])
