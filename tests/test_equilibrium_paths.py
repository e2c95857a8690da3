"""Equilibria and steady motions over parameters, in sweeps and charts: against single answers and closed forms."""

import csv
import io
import json
import math
from itertools import product

import numpy as np
import pytest
from sampling import sample
from scipy.optimize import root
from test_cli import run
from test_sweep import CUBIC, optimal

import mbstab
from mbstab.analysis.reference import continuation, many_points
from mbstab.analysis.reference.continuation import follow
from mbstab.analysis.reference.equations import Balance
from mbstab.analysis.reference.paths import Path, PathEnd, Sheet, Surface
from mbstab.analysis.reference.sheets import follow_all
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import home_of, patterns_at
from mbstab.analysis.sweep.chart import _ends
from mbstab.analysis.verdict.rule import WORDS
from mbstab.errors import UsageError
from mbstab.model.parameters import settings_in_si
from mbstab.report.export import to_csv, to_json
from mbstab.report.pictures.bifurcation import _pieces, bifurcation, shown_names
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.scales import Axis
from mbstab.report.pictures.sweep_curves import SweepCurves
from mbstab.report.sweep_data import sweep_data, sweep_rows

SWEEPS = [
    ("rotating_pendulum", {"Omega": (5.0, 20.0)}),
    ("bead_on_hoop", {"Omega": (1.0, 4.0), "R": (0.3, 0.6)}),
    ("andrews_squeezer", {"m3": (0.02, 0.03)}),
    ("von_mises_truss", {"k": (60.0, 200.0), "h": (0.4, 0.6)}),
    ("governor", {"omega": (1.0, 40.0)}),
    ("bead_on_hoop", {"Omega": (1.0, 8.0)}),
    ("rotating_pendulum", {"Omega": (6.0, 12.0), "l": (0.45, 0.7)}),
    ("bricard", {"m": (0.5, 2.0)}),
    ("governor_paper", {"sigma": (2.0, 20.0)}),
    ("governor", {"omega": (1.0, 40.0), "m_c": (2.0, 4.0)}),
    ("flyball_governor", {"omega": (4.0, 8.0)}),
]
"""Models whose reference is found, with parameters and their ranges."""


def grid(ranges, points):
    """Return the points of a sweep, or of a chart row by row."""
    axes = np.meshgrid(*(np.linspace(*ends, points) for ends in ranges.values()))
    return {name: x.ravel() for name, x in zip(ranges, axes, strict=True)}


def solutions(model, ranges):
    """Return the equilibria over one parameter or two."""
    if len(ranges) == 1:
        ((name, ends),) = ranges.items()
        return follow(model, name, *ends)
    return follow_all(model, tuple(ranges), *(np.linspace(*ends, 24) for ends in ranges.values()))


@pytest.mark.parametrize(("name", "ranges"), sample(SWEEPS, 6))
def test_points_at_random_are_answered_as_eig_answers_them(name, ranges):
    mechanism = mbstab.load(f"{name}.yaml")
    values = grid(ranges, 24 if len(ranges) > 1 else 60)
    found = Evaluator(mechanism.model, solutions(mechanism.model, ranges)).spectra(values)
    assert found.problems == {}
    for i in np.random.default_rng(len(name)).choice(len(found.values), 4, replace=False).tolist():
        single = mechanism.eig(**settings_in_si({key: float(x[i]) for key, x in values.items()}))
        exact = single.values()
        assert optimal(found.values[i], exact) <= 1e-13 * np.max(np.abs(exact))
        assert WORDS[found.words[i]] == single.judged.word


def test_a_steady_motion_over_two_parameters_is_the_closed_form_everywhere():
    # The bob turns with z = −g/Ω².
    axes = np.linspace(6.0, 12.0, 5), np.linspace(0.45, 0.7, 5)
    model = mbstab.load("rotating_pendulum.yaml").model
    surface = follow_all(model, ("Omega", "l"), *axes)
    assert isinstance(surface, Surface)
    values = {
        "Omega": np.random.default_rng(1).uniform(6.0, 12.0, 50),
        "l": np.random.default_rng(2).uniform(0.45, 0.7, 50),
    }
    q, _ = surface.predicted(values)
    z = mbstab.load("rotating_pendulum.yaml").system().names.index("bob.z")
    assert np.max(np.abs(q[:, z] + 9.81 / values["Omega"] ** 2)) < 1e-10
    assert surface.covers({"Omega": np.array([6.0, 5.9]), "l": np.array([0.7, 0.5])}).tolist() == [True, False]
    assert "Omega is beyond the range" in surface.missing({"Omega": np.array([5.9]), "l": np.array([0.5])}, 0)


def test_a_polynomial_says_what_the_path_that_is_followed_says(monkeypatch):
    model, x = mbstab.load("rotating_pendulum.yaml").model, np.linspace(7.0, 12.0, 31)
    smooth = follow(model, "Omega", 7.0, 12.0)
    monkeypatch.setattr("mbstab.analysis.reference.tolerances.Tolerances.smooth_points_most", 0)
    followed = follow(model, "Omega", 7.0, 12.0)
    assert smooth.surface is not None
    assert followed.surface is None
    assert (followed.ends, followed.crossings) == (smooth.ends, smooth.crossings) == ((), ())
    assert np.max(np.abs(smooth.predicted({"Omega": followed.values})[0] - followed.q)) < 1e-9
    one, other = (Evaluator(model, path).spectra({"Omega": x}) for path in (smooth, followed))
    assert np.array_equal(one.words, other.words)
    for left, right in zip(one.values, other.values, strict=True):
        assert optimal(left, right) < 1e-13 * np.max(np.abs(left))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "parameter", "ends", "kind"),
    [
        ("bead_on_hoop", "Omega", (0.0, 8.0), "crossing"),
        ("von_mises_truss", "P", (-10.0, 10.0), "fold"),
    ],
)
def test_where_others_branch_off_or_it_turns_back_a_path_is_followed(name, parameter, ends, kind):
    path = follow(mbstab.load(f"{name}.yaml").model, parameter, *ends)
    assert path.surface is None
    if kind == "crossing":
        assert path.crossings == pytest.approx([np.sqrt(9.81 / 0.5)])
    else:
        assert path.ends


def test_a_crossing_between_the_points_is_seen_by_the_determinant():
    # On the path x = 0 of μ x − x³ all but the determinant is smooth.
    model = mbstab.loads(CUBIC.replace("LOAD", "mu*p.x - p.x**3").replace("{mu: 0, x0: 1}", "{mu: 0, x0: 0}")).model
    path = follow(model, "mu", -2.0, 2.1)
    assert path.surface is None
    assert path.crossings == pytest.approx([0.0], abs=1e-12)
    assert follow(model, "mu", -2.0, -0.1).surface is not None


def test_a_chart_in_which_some_rows_fold_is_followed_row_by_row():
    model = mbstab.load("von_mises_truss.yaml").model
    sheet = follow_all(model, ("P", "h"), np.linspace(0.0, 6.0, 5), np.linspace(0.2, 0.6, 3))
    assert isinstance(sheet, Sheet)
    assert [len(paths) for paths in sheet.paths] == [1] * 3


def test_neighbours_share_derivatives_also_where_rows_of_a_chart_begin(monkeypatch):
    ranges = {"Omega": (6.0, 12.0), "l": (0.45, 0.7)}
    model, values = mbstab.load("rotating_pendulum.yaml").model, grid(ranges, 24)
    evaluator = Evaluator(
        model, solutions(model, ranges), patterns_at(model, solutions(model, ranges), home_of(values))
    )
    expected = evaluator.near(values, 2).values
    monkeypatch.setattr(many_points, "newton", None)  # no point needs its own
    assert np.array_equal(evaluator.near(values, 2).values, expected)


def test_steps_of_a_march_become_longer_where_solutions_are_near_their_extrapolation(monkeypatch):
    derivatives, own = [], Balance.jacobian
    monkeypatch.setattr(Balance, "jacobian", lambda balance, at: derivatives.append(at) or own(balance, at))
    assert follow(mbstab.load("governor.yaml").model, "omega", 1.0, 40.0).surface is not None
    assert sum(at.q.ndim == 2 for at in derivatives) <= 26


def test_few_points_start_from_polynomials_that_are_just_good_enough_to_be_known_as_smooth():
    mechanism, ends = mbstab.load("governor.yaml"), (1.0, 40.0)
    few, many = (follow(mechanism.model, "omega", *ends, wanted=points).surface for points in (3, 1000))
    assert 2 * (len(few.coefficients) - 1) == len(many.coefficients) - 1
    x = np.linspace(*ends, 3)
    found = Evaluator(mechanism.model, few).spectra({"omega": x})
    for own, value in zip(found.values, x.tolist(), strict=True):
        exact = mechanism.eig(omega=value).values()
        assert optimal(own, exact) <= 1e-13 * np.max(np.abs(exact))


CAR = """
mbstab: 1
parameters: {delta: 0.05, u: 12, m: 1400, I: 2200, a: 1.2, b: 1.4, Cf: 6e4, Cr: 8e4}
bodies: {car: {type: planar, mass: m, inertia: I, points: {front: [a, 0], rear: [-b, 0]}}}
constraints: {cruise: {nonholonomic: vx(car) - u}}
forces:
  front: {type: tyre, at: car.front, along: [cos(delta), sin(delta)], cornering_stiffness: Cf}
  rear: {type: tyre, at: car.rear, cornering_stiffness: Cr}
reference:
  find: steady
  steady: {axis: z}
  coordinates: {car: {theta: 0}}
  guess: {car: {x: 0, y: -(a + b)/delta}}
"""


def turn(delta, u, m=1400.0, a=1.2, b=1.4, front=6e4, rear=8e4):
    """Return the speed across and the yaw rate of a car in a steady turn, from its equations."""

    def equations(x):
        v, r = x
        slip = np.arctan2(v + a * r, u) - delta, np.arctan2(v - b * r, u)
        forces = -front * slip[0] * np.cos(delta), -rear * slip[1]
        return sum(forces) / (m * u) - r, (a * forces[0] - b * forces[1]) / (m * u)

    return root(equations, [0.0, u * delta / (a + b)], tol=1e-13).x


def test_the_places_of_wide_turns_may_change_by_more_than_the_car_is_long():
    model = mbstab.loads(CAR).model
    path = follow(model, "delta", 0.005, 0.1)
    assert path.surface is not None
    deltas = np.array([0.005, 0.0123, 0.05, 0.0877])
    q, c = path.predicted({"delta": deltas})
    for delta, place, rate in zip(deltas.tolist(), q, c[:, 0], strict=True):
        v, r = turn(delta, 12.0)
        assert np.allclose([*place[:2], rate], [v / r, -12.0 / r, r], rtol=1e-9)
    axes = np.linspace(0.02, 0.1, 4), np.linspace(5.0, 15.0, 4)
    assert isinstance(follow_all(model, ("delta", "u"), *axes), Surface)


def test_from_a_start_that_is_far_points_take_their_own_derivatives():
    model = mbstab.load("rotating_pendulum.yaml").model
    path, values = follow(model, "Omega", 7.0, 12.0), {"Omega": np.linspace(7.0, 12.0, 100)}
    expected = Evaluator(model, path).spectra(values)
    # The first coefficients only: the prediction is wrong by centimetres.
    rough = Surface(path.surface.ranges, path.surface.coefficients[:4], path.surface.n_q)
    found = Evaluator(model, rough).spectra(values)
    assert np.array_equal(found.words, expected.words)
    assert max(optimal(a, b) for a, b in zip(found.values, expected.values, strict=True)) < 1e-12


def test_the_pattern_of_a_sweep_in_blocks_is_worked_out_once(monkeypatch):
    asked = []
    original = Evaluator.patterns_at
    monkeypatch.setattr(Evaluator, "patterns_at", lambda self, at: asked.append(at) or original(self, at))
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 40)
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points_least", 40)
    x = np.linspace(5.5, 19.5, 200)
    result = mbstab.load("rotating_pendulum.yaml").sweep("Omega", x)
    assert asked == [{"Omega": x[int(0.37 * 200)]}]
    assert result.problems == {}


DISKS = """mbstab: 1
gravity: [0, 0]
parameters: {{h: 1}}
bodies:
  a: {{type: planar, mass: 1, inertia: {J[0]!r}}}
  b: {{type: planar, mass: 1, inertia: {J[1]!r}}}
joints: {{first: {{type: revolute, between: [a, ground]}}, second: {{type: revolute, between: [b, ground]}}}}
forces:
  shaft:
    type: expression
    on: {{a.theta: "{k!r}*(b.theta - a.theta)", b.theta: "{k!r}*(a.theta - b.theta)"}}
  u: {{type: pid, joint: first, of: angle(first), target: {t[0]!r}, P: {P[0]!r}*h, {I[0]} D: {D[0]!r}*h, filter: {F!r}, lag: {T!r}}}
  v: {{type: pid, joint: second, of: angle(second), target: {t[1]!r}, P: {P[1]!r}*h, {I[1]} D: {D[1]!r}*h, filter: {F!r}, lag: {T!r}}}
reference: {{find: equilibrium}}
"""  # noqa: E501


def controlled_disks(seed):
    """Return two disks on a shaft, each with a controller, and a function that returns their matrix at a gain h."""
    rng = np.random.default_rng(seed)
    J, P, D = rng.uniform(0.2, 2.0, 2), rng.uniform(500.0, 3000.0, 2), rng.uniform(20.0, 120.0, 2)
    k, F, T = rng.uniform(100.0, 2000.0), rng.uniform(1e-3, 5e-3), rng.uniform(1e-3, 5e-3)
    gains = rng.uniform(300.0, 6000.0, 2) * (seed % 3 > 0)
    targets = rng.uniform(-2.0, 2.0, 2) * ([0, 1] if seed % 2 else [1, 1])
    integral = [f"I: {float(x)!r}*h," if x else "" for x in gains]
    numbers = {key: [float(x) for x in value] for key, value in {"J": J, "P": P, "D": D, "t": targets}.items()}
    text = DISKS.format(k=float(k), F=float(F), T=float(T), I=integral, **numbers)

    def matrix(h):
        # Of each disk: angle, speed, filtered angle, torque, integral of the angle.
        A = np.zeros((10, 10))
        for i, at in enumerate((0, 5)):
            other = 5 - at
            A[at, at + 1] = A[at + 4, at] = 1.0
            A[at + 1, [at, other, at + 3]] = [-k / J[i], k / J[i], 1.0 / J[i]]
            A[at + 2, [at, at + 2]] = [1.0 / F, -1.0 / F]
            A[at + 3, [at, at + 2]] = h * np.array([-P[i] - D[i] / F, D[i] / F]) / T
            A[at + 3, [at + 3, at + 4]] = [-1.0 / T, -h * gains[i] / T]
        kept = [n for n in range(10) if n not in (4, 9) or np.any(gains)]
        return A[np.ix_(kept, kept)]

    return mbstab.loads(text).model, matrix


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", sample(range(12), 5))
def test_rounding_of_states_that_come_to_rest_makes_no_point_a_case_of_its_own(seed):
    # Fast filters and lags make of the last bit of an angle a rate that is far from zero.
    model, matrix = controlled_disks(seed)
    path, h = follow(model, "h", 0.3, 3.0), np.linspace(0.3, 3.0, 40)
    evaluator = Evaluator(model, path, patterns_at(model, path, home_of({"h": h})))
    found = evaluator.near({"h": h}, len(matrix(1.0)), exact=True)
    assert evaluator.alone == 0
    for i in range(0, len(h), 7):
        A = matrix(float(h[i]))
        exact = np.linalg.eigvals(A)
        assert optimal(found.values[i], exact) <= 1e-10 * np.max(np.abs(exact))
        assert (WORDS[found.words[i]] == "asymptotically stable") == (np.max(exact.real) < 0.0)


@pytest.mark.parametrize("seed", sample(range(12), 5))
def test_branches_that_move_together_are_followed_without_a_search(seed):
    # Two damped masses on slow springs: the slow eigenvalues, about −k/d, are nearly equal and never meet.
    rng = np.random.default_rng(seed)
    d, near = rng.uniform(5.0, 20.0), 1.0 + rng.uniform(5e-4, 5e-3)
    # The heavier mass with the weaker damper: both make it the faster of the two.
    masses, dampings = -np.sort(-rng.uniform(0.01, 0.03, 2)), (float(d), float(d * near))
    forces = [f'{x}.x: "-k*{x}.x - {c!r}*rate({x}.x)"' for x, c in zip("ab", dampings, strict=True)]
    bodies = [f"{x}: {{type: planar_point, mass: {float(m)!r}}}" for x, m in zip("ab", masses, strict=True)]
    text = (
        f"mbstab: 1\nparameters: {{k: 10}}\nbodies: {{{', '.join(bodies)}}}\n"
        "constraints: {first: {holonomic: a.y}, second: {holonomic: b.y}}\n"
        f"forces: {{f: {{type: expression, on: {{{', '.join(forces)}}}}}}}\n"
    )
    k = np.linspace(10.0, 60.0, 5)
    found = mbstab.loads(text).sweep("k", k)
    assert found.warnings == ()
    assert found.meetings == ()
    slow = np.array([[max(np.roots([m, c, x]).real) for m, c in zip(masses, dampings, strict=True)] for x in k])
    columns = np.argsort(-found.branches[0].real)[:2]
    order = np.argsort(-slow[0])
    assert np.max(np.abs(found.branches[:, columns] - slow[:, order])) <= 1e-11 * np.max(np.abs(found.branches))


def test_the_warning_of_a_search_that_ends_says_whether_stability_may_change_there(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.branch_parts_crowded", 0)
    text = (
        "mbstab: 1\nparameters: {k: 10}\nbodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}\n"
        "constraints: {first: {holonomic: a.y}, second: {holonomic: b.y}}\nforces:\n  f:\n    type: expression\n"
        '    on: {a.x: "-a.x - DRAG*rate(a.x)", b.x: "-(k/10)*b.x - DRAG*rate(b.x)"}\n'
    )
    k = np.linspace(9.5, 10.6, 2)
    far, near = (
        mbstab.loads(text.replace("DRAG", drag)).sweep("k", k, meetings=True).warnings for drag in ("1.0", "1e-9")
    )
    assert "no change of stability (they are far from the imaginary axis)" in " ".join(far)
    assert "critical values may be missing" in " ".join(near)


# --- equilibria that exist in a part of the plane of a chart only -----------------------------------------------------


# x² = ROOM where that is positive; at x > 0 the stiffness is 2 x, and the damping changes its sign in the chart.
TEXT = """\
mbstab: 1
parameters: {a: 0, b: 0, start: 1}
tables: {load: {x: [0, 1, 2, 3], y: [1, 1.5, 1.2, 1.1]}}
bodies: {p: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: p.y}}
forces: {f: {type: expression, on: {p.x: 'ROOM - p.x**2 - (0.3 + a/2 - b/3)*rate(p.x)'}}}
reference:
  find: equilibrium
  coordinates: {p: {y: 0}}
  guess: {p: {x: start}}
"""
REGIONS = {
    "disk": ("1 - a**2 - b**2", (-0.61, 1.1), (-1.13, 1.17)),
    "half plane": ("a - b", (0.0, 1.0), (-0.53, 1.1)),
    "ring": ("4*(a**2 + b**2 - 0.25)*(1 - a**2 - b**2)", (-0.93, 1.1), (-1.13, 1.17)),
    "two bumps": ("1 - (b - cos(3*a))**2", (-1.9, 1.1), (-0.7, 2.5)),
    "slit": ("(a**2 - b)*(1.5 - b)", (-1.0, 1.03), (-0.7, 1.1)),
}


def solution(room, a, b):
    """Return the place of the equilibrium, nan where there is none."""
    left = eval(room, {"a": a, "b": b, "cos": np.cos})
    return np.sqrt(np.where(left > 0.0, left, np.nan))


LONGER = [pytest.param(name, 13, marks=pytest.mark.long) for name in ("two bumps", "ring")]


@pytest.mark.long
@pytest.mark.parametrize(("name", "points"), [("disk", 7), *LONGER])
def test_rows_to_which_the_first_column_does_not_lead_are_reached_from_those_beside(name, points):
    room, *ends = REGIONS[name]
    a, b = (np.linspace(*part, points) for part in ends)
    mechanism = mbstab.loads(TEXT.replace("ROOM", room))
    chart = mechanism.chart({"a": a, "b": b})
    A, B = np.meshgrid(a, b)
    exists = ~np.isnan(solution(room, A, B))
    assert not exists[:, 0].all()  # the first column leaves the region
    assert np.array_equal(chart.unstable, np.where(exists, np.where(0.3 + A / 2 - B / 3 > 0.0, 0, 2), -1))
    assert set(chart.problems) == set(np.flatnonzero(~exists))
    # Every row ends on the edge of the region, and what else is drawn is where the damping changes its sign.
    drawn = np.concatenate(chart.boundaries)
    on_edge = np.abs(eval(room, {"a": drawn[:, 0], "b": drawn[:, 1], "cos": np.cos})) < 1e-9
    # Those whose solutions lie between the points of the grid may be found, too.
    between = ~np.isnan(solution(room, np.linspace(a[0], a[-1], 10001)[None, :], b[:, None])).all(axis=1)
    assert set(b[np.any(exists, axis=1)]) <= set(drawn[on_edge, 1]) <= set(b[between])
    assert np.all(np.abs(0.3 + drawn[~on_edge, 0] / 2 - drawn[~on_edge, 1] / 3) < 1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", REGIONS)
def test_points_of_rows_are_judged_as_eig_judges_them_from_the_same_solution(name):
    room, *ends = REGIONS[name]
    a, b = (np.linspace(*part, 15) for part in ends)
    mechanism = mbstab.loads(TEXT.replace("ROOM", room))
    chart, sheet = mechanism.chart({"a": a, "b": b}), follow_all(mechanism.model, ("a", "b"), a, b)
    A, B = (x.ravel() for x in np.meshgrid(a, b))
    on = np.flatnonzero(sheet.covers({"a": A, "b": B}))
    assert np.array_equal(on, np.flatnonzero(~np.isnan(solution(room, A, B))))
    for i in np.random.default_rng(1).choice(on, 12, replace=False).tolist():
        q, _ = sheet.predicted({"a": A[i : i + 1], "b": B[i : i + 1]})
        found = mechanism.at(a=A[i], b=B[i], start=q[0, 0])
        assert found.motion().q[0] == pytest.approx(solution(room, A[i], B[i]), rel=1e-9)
        assert np.array(chart.verdicts).flat[i] == found.eig().verdict


FOUR_BAR = """\
mbstab: 1
parameters: {k: 8, rest: pi/3}
gravity: [0, -9.81]
ground: {points: {A: [0, 0], D: [0.3, 0]}}
bodies:
  crank: {type: planar, mass: 0.5, shape: {type: rod, length: 0.1}, points: {s: [-0.05, 0], e: [0.05, 0]}}
  coupler: {type: planar, mass: 1.5, shape: {type: rod, length: 0.26}, points: {s: [-0.13, 0], e: [0.13, 0]}}
  rocker: {type: planar, mass: 1, shape: {type: rod, length: 0.18}, points: {s: [-0.09, 0], e: [0.09, 0]}}
joints:
  A: {type: revolute, between: [crank.s, ground.A]}
  B: {type: revolute, between: [coupler.s, crank.e]}
  C: {type: revolute, between: [coupler.e, rocker.e]}
  D: {type: revolute, between: [rocker.s, ground.D]}
forces: {coil: {type: joint_spring, joint: A, stiffness: k, rest: rest, damping: 0.05}}
reference:
  find: equilibrium
  guess:
    crank: {theta: rest, x: 0.025, y: 0.043}
    coupler: {theta: 20*deg, x: 0.17, y: 0.13}
    rocker: {theta: 100*deg, x: 0.3, y: 0.09}
"""


@pytest.mark.parametrize("ends", [(0.1, 10.0), (3.0, 20.0), (8.0, 1.0)])
def test_paths_lead_through_the_solution_of_eig_whatever_the_direction(ends):
    """At k = 0.1 the guess leads to an unstable branch that ends at 1.136, and the file is at k = 8."""
    mechanism, values = mbstab.loads(FOUR_BAR), np.linspace(*ends, 8)
    here, back = (mechanism.sweep("k", x) for x in (values, values[::-1]))
    assert here.start == back.start == 8.0
    assert set(here.unstable) == {0}
    assert (here.critical, here.beyond, here.moved) == ((), (), "")
    np.testing.assert_array_equal(here.branches, back.branches[::-1])
    near = mechanism.sweep("k", np.array([7.5, 8.0, 8.5])).branches[1]
    assert optimal(near, np.array([x.value for x in mechanism.eig().eigenvalues])) < 1e-9


def test_a_path_starts_at_the_end_that_is_nearest_to_the_value_of_the_file():
    mechanism = mbstab.loads(FOUR_BAR)
    for ends, start in (((0.1, 2.0), 2.0), ((20.0, 9.0), 9.0)):
        result = mechanism.sweep("k", np.linspace(*ends, 5))
        assert result.start == start
        assert set(result.unstable) == {0}
    chart = mechanism.chart({"k": np.linspace(10.0, 0.1, 6), "rest": np.linspace(1.0, 1.3, 4)})
    assert chart.start == (8.0, pytest.approx(np.pi / 3))
    assert np.all(chart.unstable == 0)
    same = mechanism.chart({"k": chart.x, "rest": chart.y})
    assert np.array_equal(chart.words, same.words)


@pytest.mark.parametrize("q", [0.0, -1.0, 1.0])
def test_a_start_at_a_branch_point_is_none_of_its_own(q):
    """Where the file's own value is that of the pitchfork, the equations are singular at its solution."""
    result = rail(3, 0.0, q).sweep("q", np.linspace(-1.0, 1.0, 8))
    (critical,) = result.critical
    assert (critical.kind, critical.unstable, critical.branching) == ("divergence", (0, 1), True)
    assert abs(critical.value) < 1e-12
    assert len(result.beyond) == 2


@pytest.mark.long
def test_a_table_that_the_first_column_leaves_does_not_end_the_rows():
    a, b = np.linspace(0.0, 1.5, 8), np.linspace(-0.53, 1.1, 8)
    chart = mbstab.loads(TEXT.replace("ROOM - p.x**2", "2*spline(a - b, load) - p.x")).chart({"a": a, "b": b})
    A, B = np.meshgrid(a, b)
    assert np.array_equal(chart.unstable, np.where(A > B, np.where(0.3 + A / 2 - B / 3 > 0.0, 0, 2), -1))
    (curve,) = chart.boundaries
    np.testing.assert_allclose(curve[:, 0], curve[:, 1], atol=1e-9)
    assert all("is outside the table 'load'" in text for text in chart.problems.values())


@pytest.mark.long
def test_a_row_is_not_continued_on_another_sheet():
    """Beside a cusp: rows with two folds end at the first one, though their neighbour leads around to the others."""
    text = TEXT.replace("ROOM - p.x**2", "a + b*p.x - p.x**3")
    text = text.replace("a: 0, b: 0, start: 1", "a: -2, b: -0.7, start: -1")
    a, b = np.linspace(-2.0, 2.0, 9), np.linspace(-0.7, 1.4, 5)
    chart = mbstab.loads(text).chart({"a": a, "b": b})
    fold = 2.0 * (np.maximum(b, 0.0) / 3.0) ** 1.5
    exists = (a < fold[:, None]) | (b[:, None] < 0.0)
    assert np.array_equal(chart.unstable >= 0, exists)


def test_rows_that_end_follow_those_beside_them(monkeypatch):
    """The first row is followed step by step; the others go through the points near its own, in steps that fit."""
    room, (low, high), _ = REGIONS["disk"]
    a, b = np.linspace(low, high, 9), np.linspace(-0.5, 0.6, 9)
    steps = []
    fitting = continuation._Curve._fitting
    monkeypatch.setattr(continuation._Curve, "_fitting", lambda self, *step: steps.append(1) or fitting(self, *step))
    sheet = follow_all(mbstab.loads(TEXT.replace("ROOM", room)).model, ("a", "b"), a, b)
    ends = np.array([path.values[-1] for (path,) in sheet.paths])
    np.testing.assert_allclose(ends, np.sqrt(1.0 - b**2), rtol=1e-13)
    assert len(steps) < 12 * len(b)
    for value, (path,) in zip(b, sheet.paths, strict=True):
        np.testing.assert_allclose(path.q[:, 0] ** 2, 1.0 - path.values**2 - value**2, atol=1e-14)


def test_curves_of_ends_go_around_a_hole():
    """Four rows across a ring: where one path becomes two, the outer curves go on and the inner one begins."""
    parameter = mbstab.loads(TEXT.replace("ROOM", "1")).model.parameters["a"]

    def path(low, high):
        values, none = np.array([low, high]), np.zeros((2, 0))
        return Path(parameter, values, none, none, ((low, PathEnd.TURNS), (high, PathEnd.TURNS)), (), low)

    ends = [[(-0.7, 0.75)], [(-0.8, -0.2), (0.25, 0.85)], [(-0.9, -0.3), (0.35, 0.95)], [(-0.6, 0.65)]]
    rows = tuple(tuple(path(*part) for part in row) for row in ends)
    curves = _ends(Sheet(parameter, np.arange(4.0), rows, rows[0][0], (0.0, 0.0)))
    expected = [(-0.7, -0.8, -0.9, -0.6), (0.25, 0.35), (0.75, 0.85, 0.95, 0.65), (-0.2, -0.3)]
    assert sorted(tuple(curve[:, 0].tolist()) for curve in curves) == sorted(expected)


# --- paths past imperfect pitchforks and transcritical bifurcations ---------------------------------------------------


RAIL = """\
mbstab: 1
parameters: {q: 0}
bodies:
  p: {type: planar_point, mass: 1}
constraints:
  rail: {holonomic: p.y}
forces:
  f: {type: expression, on: {p.x: LOAD - rate(p.x)}}
reference: {find: equilibrium, guess: {p: {x: 0, y: 0}}}
"""

ROD = """\
mbstab: 1
parameters: {m: 1, k: 4}
gravity: [0, -10]
bodies: {rod: {type: planar, mass: m, inertia: 0.1, points: {O: [0, -1]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {hinge: {type: joint_spring, joint: pivot, stiffness: k, damping: 1, rest: 5.0e-4}}
reference: {find: equilibrium, guess: {rod: {x: 0, y: 1, theta: 0}}}
"""

FUNCTIONS = ["table", "spline", "linear"]
SIZES = [1e-2, 2e-3, 1e-3, 1e-4, 1e-6, 1e-8]
BOTH = [1.0, -1.0]


def rail(power, e, q=0.0):
    return mbstab.loads(RAIL.replace("LOAD", f"q*p.x - p.x**{power} + ({e!r})").replace("{q: 0}", f"{{q: {q!r}}}"))


def equilibrium(power, e, up, q):
    """Return the root of q x - x**power + e on the path that begins at q = -1 (up) or 1; None beyond its fold."""
    if power == 2:
        square = q * q + 4.0 * e
        if square < 0.0 or (e < 0.0 and q * up > 0.0):
            return None
        far = 0.5 * (q - up * math.sqrt(square))
        return 0.5 * (q + up * math.sqrt(square)) if q * up > 0.0 else -e / far
    roots = np.roots([-1.0, 0.0, q, e])
    real = np.sort(roots.real[np.abs(roots.imag) < 1e-13 * np.max(np.abs(roots))])
    if up > 0.0:
        return float(real[-1] if e > 0.0 else real[0])
    return float(real[1]) if q > 3.0 * (0.5 * abs(e)) ** (2.0 / 3.0) else None


@pytest.mark.few(3)
@pytest.mark.parametrize(("size", "power", "up", "sign"), sample(product(SIZES, [2, 3], BOTH, BOTH), 7))
def test_an_imperfect_bifurcation_is_followed_on_one_branch(size, power, up, sign):
    e = sign * size
    path = continuation.follow(rail(power, e).model, "q", -1.0, 1.0, first_at=-up)
    assert path.crossings == ()
    folds = path.ends
    for q, x in zip(path.values.tolist(), path.q[:, 0].tolist(), strict=True):
        # At the fold itself the roots are equal.
        exact = None if any(q == fold for fold, _ in folds) else equilibrium(power, e, up, q)
        if exact is not None:
            assert abs(x - exact) < 1e-7
        else:
            assert any(abs(q - fold) < 1e-9 for fold, _ in folds)
    if power == 3 and up < 0.0:
        assert [fold for fold, _ in folds] == pytest.approx([3.0 * (0.5 * size) ** (2.0 / 3.0)], rel=1e-6)
    elif power == 2 and e < 0.0:
        assert [fold for fold, _ in folds] == pytest.approx([-2.0 * up * math.sqrt(size)], rel=1e-6)
    else:
        assert (path.values[0], path.values[-1], folds) == (-1.0, 1.0, ())


TWO_RAILS = """\
mbstab: 1
parameters: {q: 0}
bodies:
  p: {type: planar_point, mass: 1}
  r: {type: planar_point, mass: 1}
constraints:
  one: {holonomic: p.y}
  other: {holonomic: r.y}
forces:
  f:
    type: expression
    on: {p.x: q*p.x - p.x**3 + ONE - rate(p.x), r.x: (q - LATER)*r.x - r.x**3 + (OTHER) - rate(r.x)}
reference: {find: equilibrium, guess: {p: {x: 0, y: 0}, r: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(("later", "part"), sample([(0.0, 1.0), (0.0, -1.0), (1e-2, 0.5)], 3))
def test_two_eigenvalues_that_change_sign_together_are_no_way_to_another_path(part, later):
    size, other = 1e-3, part * 1e-3
    text = TWO_RAILS.replace("ONE", repr(size)).replace("OTHER", repr(other)).replace("LATER", repr(later))
    values = np.linspace(-1.0, 1.0, 15)
    swept = mbstab.loads(text).sweep("q", values)
    assert set(swept.unstable) == {0}
    # At the end both rest where their loads push them: q x - x^3 + e = 0, x of the sign of e.
    expected = []
    for e, q in ((size, 1.0), (other, 1.0 - later)):
        roots = np.roots([1.0, 0.0, -q, -e])
        x = max(roots[np.abs(roots.imag) < 1e-9].real, key=lambda root: root * np.sign(e))
        expected += list(np.roots([1.0, 1.0, 3.0 * x * x - q]))
    found = np.sort_complex(np.round(swept.branches[-1], 9))
    np.testing.assert_allclose(found, np.sort_complex(np.round(expected, 9)), atol=2e-9)


IMPERFECT = [(3, 1e-3, 1.0), (3, 1e-8, 1.0), (3, 1e-4, -1.0), (2, 1e-3, 1.0), (2, -1e-4, 1.0)]


@pytest.mark.few(1)
@pytest.mark.parametrize(("imperfect", "points"), sample(product(IMPERFECT, [15, 41, 401]), 4))
def test_a_sweep_past_an_imperfect_bifurcation_answers_for_one_branch(imperfect, points):
    power, e, up = imperfect
    result = rail(power, e, -up).sweep("q", np.linspace(-up, up, points))
    for q, count, values in zip(result.values, result.unstable, result.branches, strict=True):
        x = None if abs(q + 0.02) < 1e-12 and e < 0.0 else equilibrium(power, e, up, float(q))  # -0.02: the fold
        assert count == (-1 if x is None else int(up < 0.0))
        if x is not None:
            assert abs(np.prod(values) + q - power * x ** (power - 1)) < 1e-9
    folds = [3.0 * (0.5 * e) ** (2.0 / 3.0)] if power == 3 and up < 0.0 else [-0.02] if e < 0.0 else []
    assert [c.kind for c in result.critical] == ["fold"] * len(folds)
    assert [c.value for c in result.critical] == pytest.approx(folds, rel=1e-9)


def test_a_rod_on_a_spring_that_is_not_quite_upright_stays_stable():
    result = mbstab.loads(ROD.replace("m: 1", "m: 0.1")).sweep("m", np.linspace(0.1, 0.8, 15))
    assert result.critical == ()
    assert result.problems == {}
    assert set(result.unstable) == {0}
    # k (theta - rest) = m g sin(theta)
    for m, values in zip(result.values, result.branches, strict=True):
        low, high = 1e-4, math.pi
        for _ in range(60):
            theta = 0.5 * (low + high)
            low, high = (theta, high) if 4.0 * (theta - 5e-4) < 10.0 * m * math.sin(theta) else (low, theta)
        stiffness = (4.0 - 10.0 * m * math.cos(theta)) / (m + 0.1)
        assert np.prod(values).real == pytest.approx(stiffness, rel=1e-7)


def test_the_path_ends_where_branches_cannot_be_told_apart(monkeypatch):
    monkeypatch.setattr(continuation._Curve, "_cross", lambda self, run, *ends: False)
    result = rail(3, 0.0, -1.0).sweep("q", np.linspace(-1.0, 1.0, 14))
    assert set(result.unstable[:7]) == {0}
    assert set(result.unstable[7:]) == {-1}
    assert all(PathEnd.UNSURE in message for message in result.problems.values())
    assert [c.kind for c in result.critical] == ["unresolved"]


def test_a_path_ends_where_the_equations_do():
    """Beyond p = 1/3 the load has no value."""
    text = """
mbstab: 1
parameters: {p: 0}
bodies: {a: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: a.y}}
forces: {load: {type: expression, on: {a.x: -a.x - 0.1*rate(a.x) + (1/3 - p)**1.5}}}
reference: {find: equilibrium, guess: {a: {x: 0}}}
"""
    for values in (np.linspace(0.0, 1.0, 11), np.linspace(0.3, 1.0, 4)):
        (end,) = mbstab.loads(text).sweep("p", values).critical
        assert end.kind == "end of the equations"
        assert end.value == round(1 / 3, 11)


LAW = """\
mbstab: 1
parameters: {F: {value: 0, unit: N}}
tables: {law: {x: [-0.2, 0, 0.1, 0.2], y: [-8, 0, 4, 9]}}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: b.y}}
forces: {s: {type: expression, on: {b.x: "F - FUNCTION(b.x, law) - rate(b.x)"}}}
reference: {find: equilibrium, guess: {b: {x: 0.01}}}
"""

SLIDER = """\
mbstab: 1
parameters: {F: {value: 0, unit: N}}
bodies: {b: {type: planar, mass: 1, inertia: 1}}
constraints: {heading: {holonomic: b.theta}, cruise: {nonholonomic: rate(b.x) - 7}}
forces:
  s: {type: expression, on: {b.y: F - 5*b.y - rate(b.y)}}
  wheel: {type: tyre, at: b, along: [cos(0.1), sin(0.1)], cornering_stiffness: (3 - 2*b.y)**1.5}
reference: {find: steady, steady: {direction: x, speed: 7}, guess: {b: {y: 0}}}
"""


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("text", "last", "end", "why"),
    [
        # The table ends at x = 0.2 with 9 N and at x = -0.2 with -8 N.
        *(
            (LAW.replace("FUNCTION", name), 12.0, 9.0, "forces.s has no finite equations here (0.200000")
            for name in FUNCTIONS
        ),
        (LAW.replace("FUNCTION", "table"), -11.0, -8.0, "is outside the table 'law', which goes from -0.2 to 0.2)"),
        # Without stiffness the wheel carries nothing at y = 1.5, and the spring 7.5 N.
        (SLIDER, 10.0, 7.5, "forces.wheel has no finite equations here (a function has no real value there)"),
    ],
)
def test_the_end_of_the_equations_is_no_loss_of_equilibrium(text, last, end, why):
    result = mbstab.loads(text).sweep("F", np.linspace(0.1 * last, last, 9))
    assert [(c.kind, c.value, c.branches) for c in result.critical] == [("end of the equations", end, ())]
    assert [i in result.problems for i in range(9)] == [abs(x) > abs(end) for x in result.values]
    assert all(x.startswith(f"the equations end at F = {end:g} N on this path: ") for x in result.problems.values())
    assert all(why in x for x in result.problems.values())
    assert "end of the equations" in str(result)
    assert "the equations end at F" in str(result)


def test_an_equilibrium_that_is_lost_where_the_equations_go_on():
    """The force of the spring falls from 3 N on."""
    law = LAW.replace("FUNCTION(b.x, law)", "(3 - 40*abs(b.x - 0.075))")
    (end,) = mbstab.loads(law).sweep("F", np.linspace(0.0, 8.0, 10)).critical
    assert end.kind == "loss of equilibrium"
    assert end.value == pytest.approx(3.0, abs=1e-9)


# --- the references themselves, as data and as a picture of stable and unstable parts ---------------------------------


TRUSS, PENDULUM, CAR_TURN = (
    mbstab.load(f"{name}.yaml") for name in ("von_mises_truss", "rotating_pendulum", "car_turn")
)


def load_on(y):
    """Return the load of the truss at a height of its apex, in closed form."""
    k, a, h = (TRUSS.parameters()[name] for name in ("k", "a", "h"))
    return 2.0 * k * y * (np.hypot(a, h) / np.hypot(a, y) - 1.0)


@pytest.fixture(scope="module")
def truss():
    return TRUSS.sweep("P", np.linspace(-10.0, 10.0, 41))


def test_coordinates_of_all_paths_are_the_closed_form(truss):
    assert len(truss.beyond) == 2
    for path in (truss, *truss.beyond):
        known = np.isfinite(path.reference["apex.y"])
        assert known.sum() >= 15
        np.testing.assert_allclose(load_on(path.reference["apex.y"][known]), path.values[known], rtol=0, atol=1e-12)
        assert np.array_equal(~known, np.isnan(path.branches).any(axis=1))


def test_descending_sweeps_have_coordinates_in_their_order():
    values = np.linspace(20.0, 5.0, 31)
    found = PENDULUM.sweep("Omega", values)
    np.testing.assert_allclose(found.reference["bob.z"], -PENDULUM.parameters()["g"] / values**2, rtol=1e-12)
    np.testing.assert_allclose(found.reference["rate(fork.psi)"], values, rtol=1e-14)


def test_given_references_have_none():
    assert mbstab.load("top.yaml").sweep("omega", np.linspace(1.0, 10.0, 5)).reference == {}


def test_csv_and_json_have_the_coordinates(truss):
    rows = list(csv.DictReader(io.StringIO(to_csv(*sweep_rows(truss, TRUSS.model)))))
    column = [float(row["apex.y (m)"] or "nan") for row in rows]
    whole = np.concatenate([path.reference["apex.y"] for path in (truss, *truss.beyond)])
    assert np.array_equal(column, whole, equal_nan=True)
    data = json.loads(to_json(sweep_data(truss, TRUSS.model)))
    assert data["beyond"][1]["reference"]["apex.y"] == truss.beyond[1].reference["apex.y"].tolist()


def test_curves_go_round_folds_and_tell_stable_from_unstable(truss):
    curves = SweepCurves(truss, Axis("P", "N"))
    pieces = _pieces(truss, curves, 1.0, ["apex.y"])
    a, h = (TRUSS.parameters()[name] for name in ("a", "h"))
    turn = np.sqrt(np.cbrt(np.hypot(a, h) * a**2) ** 2 - a**2)
    for piece in pieces:
        y = piece.columns["apex.y"]
        np.testing.assert_allclose(load_on(y), piece.x, rtol=0, atol=0.02)
        assert piece.state == (1 if abs(y[len(y) // 2]) < turn else 0)
    heights = np.concatenate([piece.columns["apex.y"] for piece in pieces])
    assert np.max(np.diff(np.sort(heights))) < 0.02
    figure = bifurcation(truss, Axis("P", "N"), "truss")
    assert figure.axes[0].get_ylabel() == "apex.y (m)"


def test_a_reference_that_does_not_depend_on_the_parameter_has_no_empty_picture():
    swept = TRUSS.sweep("m", np.linspace(1.0, 2.0, 5))
    with pytest.raises(UsageError, match="no coordinate of the reference depends on m"):
        bifurcation(swept, Axis("m", "kg"), "")
    (axes,) = bifurcation(swept, Axis("m", "kg"), "", ["apex.y"]).axes
    assert len(axes.get_lines()) == 1


def test_the_pitchfork_of_a_bead_on_a_hoop_is_drawn():
    """It leaves the bottom where Omega² = g/R, with z = −g/Omega²; the hoop's own rate is the parameter."""
    swept = mbstab.load("bead_on_hoop.yaml").sweep("Omega", np.linspace(4.0, 5.0, 5))
    assert "rate(hoop.psi)" in swept.reference
    assert len(swept.beyond) == 2
    for path in swept.beyond:
        np.testing.assert_allclose(path.reference["bead.z"], -9.81 / path.values**2, rtol=1e-9)
        assert set(path.unstable.tolist()) == {0}
    names, left = shown_names(swept, ())
    assert {"bead.x", "bead.z"} < set(names)
    assert "rate(hoop.psi)" not in names
    assert left == 0
    (axes,) = bifurcation(swept, Axis("Omega", "rad/s"), "", ["bead.x"]).axes
    ends = {(round(x, 3), round(y, 3)) for line in axes.get_lines() for x, y in line.get_xydata()}
    aside = round(math.sqrt(0.25 - (9.81 / 25.0) ** 2), 3)
    assert {(5.0, aside), (5.0, -aside), (round(math.sqrt(9.81 / 0.5), 3), 0.0)} <= ends


def test_what_the_parameter_changes_is_drawn_and_the_rest_counted():
    found = CAR_TURN.sweep("steer", np.linspace(0.01, 0.05, 9))
    assert shown_names(found, ())[0] == ["car.y", "car.x", "rate(car.y)", "rate(car.theta)"]
    assert shown_names(found, ["rate(car.theta)"]) == (["rate(car.theta)"], 0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["top.yaml", "--param", "omega", "--plot", "path"], "draws a reference that is found"),
        (["von_mises_truss.yaml", "--param", "P", "--coordinate", "apex.y"], "goes with --plot path"),
        (["von_mises_truss.yaml", "--param", "P", "--plot", "path", "--coordinate", "apex.z"], "did you mean 'apex.y'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(words, said):
    answer = run("sweep", *words)
    assert answer.exit_code == 2
    assert said in " ".join(answer.output.split())


@pytest.mark.long
def test_the_legend_tells_names_from_lines(truss):
    """Names belong to colours, where there is more than one curve in a panel, and lines to stability."""
    legend = bifurcation(truss, Axis("P"), "").legends[0]
    assert [x.get_text() for x in legend.get_texts()] == [
        "stable",
        "unstable",
        "critical value",
        "where it is critical",
    ]
    stable, unstable = legend.get_lines()[:2]
    assert [stable.get_color(), unstable.get_color(), stable.get_linestyle()] == [INK[0], INK[0], "-"]
    car = bifurcation(CAR_TURN.sweep("steer", np.linspace(0.03, 0.07, 9), detail=True), Axis("steer"), "")
    names = [x.get_text() for x in car.legends[0].get_texts()]
    assert names[:2] == ["car.y", "car.x"]
    assert not [name for name in names if name.startswith("rate(")]  # each alone in its panel
    assert "no answer" in names


@pytest.mark.long
def test_what_has_no_answer_begins_where_the_path_ends():
    """The steady turn ends in a fold, 0.0584430954089223 rad, between two points of the sweep."""
    found = list(SweepCurves(CAR_TURN.sweep("steer", np.linspace(0.03, 0.07, 9), detail=True), Axis("steer")).ranges())
    assert found == [(pytest.approx(0.0584430954089223, rel=1e-8), 0.07, -1)]
    down = list(SweepCurves(CAR_TURN.sweep("steer", np.linspace(0.07, 0.03, 9), detail=True), Axis("steer")).ranges())
    assert down == found


# --- outputs along paths ----------------------------------------------------------------------------------------------


TURNING = """
mbstab: 1
parameters: {Omega: {value: 10, unit: rad/s}, l: 0.5}
gravity: [0, 0, -9.81]
bodies: {ball: {type: point, mass: 2}}
joints: {rod: {type: distance, between: [ball, ground], length: l}}
outputs: {depth: -ball.z, pull: force(rod.x), height: l + ball.z, gone: log(-1 - ball.x**2)}
reference:
  find: steady
  steady: {axis: z, rate: Omega}
  coordinates: {ball: {y: 0}}
  guess: {ball: {x: 0.45, z: -0.2}}
"""


def test_outputs_of_the_file_follow_the_path(tmp_path):
    model = tmp_path / "turning.yaml"
    model.write_text(TURNING)
    Omega = np.linspace(6.0, 12.0, 5)
    result = mbstab.load(model).sweep("Omega", Omega)
    np.testing.assert_allclose(result.outputs["depth"], 9.81 / Omega**2, rtol=1e-9)
    (one,) = mbstab.load(model).equilibria(Omega=Omega[1])
    assert result.outputs["pull"][1] == pytest.approx(one.outputs["pull"], rel=1e-9)
    assert np.all(np.isnan(result.outputs["gone"]))
    options = [str(model), "--param", "Omega", "--from", "6", "--to", "12", "--points", "5"]
    data = json.loads(run("sweep", *options, "--plot", "none", "--format", "json").stdout)
    assert data["outputs"]["depth"] == result.outputs["depth"].tolist()
    assert data["outputs"]["gone"] == [None] * 5
    rows = list(csv.DictReader(io.StringIO(run("sweep", *options, "--plot", "none", "--format", "csv").stdout)))
    assert [float(row["depth (m)"]) for row in rows] == data["outputs"]["depth"]
    assert {row["gone"] for row in rows} == {""}
    assert "depth" in shown_names(result, ())[0] + shown_names(result, ["depth"])[0]
    picture = tmp_path / "path.png"
    drawn = run("sweep", *options, "--plot", "path", "--coordinate", "depth,pull", "--pictures", str(picture))
    assert drawn.exit_code == 0
    assert "wrote" in drawn.stderr
    wrong = run("sweep", *options, "--plot", "path", "--coordinate", "dept")
    assert "depth" in wrong.stderr


# --- beside singular configurations -----------------------------------------------------------------------------------


FIVE_BAR = """
mbstab: 1
parameters: {d: 0.2, a: 0.25, b: 0.35, ma: 0.6, mb: 0.4, mt: 0.5, kp: 60, kd: 3, q1: 130*deg, q2: 50*deg}
gravity: [0, -9.81]
ground: {points: {L: [-d/2, 0], R: [d/2, 0]}}
bodies:
  c1: {type: planar, mass: ma, shape: {type: rod, length: a}, points: {o: [-a/2, 0], e: [a/2, 0]}}
  c2: {type: planar, mass: ma, shape: {type: rod, length: a}, points: {o: [-a/2, 0], e: [a/2, 0]}}
  r1: {type: planar, mass: mb, shape: {type: rod, length: b}, points: {o: [-b/2, 0], e: [b/2, 0]}}
  r2: {type: planar, mass: mb, shape: {type: rod, length: b}, points: {o: [-b/2, 0], e: [b/2, 0]}}
  tip: {type: planar_point, mass: mt}
joints:
  m1: {type: revolute, between: [c1.o, ground.L]}
  m2: {type: revolute, between: [c2.o, ground.R]}
  e1: {type: revolute, between: [r1.o, c1.e]}
  e2: {type: revolute, between: [r2.o, c2.e]}
  t: {type: revolute, between: [r1.e, r2.e]}
  g: {type: revolute, between: [tip, r1.e]}
forces:
  pd1: {type: joint_spring, joint: m1, stiffness: kp, damping: kd, rest: q1}
  pd2: {type: joint_spring, joint: m2, stiffness: kp, damping: kd, rest: q2}
  fr: {type: joint_spring, joint: t, damping: 0.02}
reference:
  find: equilibrium
  guess: {c1: {theta: q1}, c2: {theta: q2}, r1: {theta: 60*deg}, r2: {theta: 120*deg}, tip: {y: 0.45}}
"""
D, A, B, M_A, M_B, M_T, REST, G = 0.2, 0.25, 0.35, 0.6, 0.4, 0.5, math.radians(130.0), 9.81
RATIO = A + math.sqrt(A * B)
STRETCHED = G * (M_A * A + M_B * (A + RATIO) + M_T * RATIO) / (2.0 * (math.pi - REST))
"""The stiffness at which all links lie on a line: the balance of moments at the cranks, by virtual work."""


def stiffness_that_holds(turned):
    """Return the stiffness at which the cranks of the five-bar stand so far beyond the line, and the tip's height.

    The mechanism is symmetric, so that one angle is left: kp (q - q1) balances the weights. The height of the
    connecting rods is a root, whose sign changes with the angle.
    """
    q = math.pi + turned
    # b² - (d/2 - a cos q)² by sin²(turned/2), without cancellation.
    x = 2.0 * A * math.sin(0.5 * turned) ** 2
    root_ = math.copysign(math.sqrt(x * (2.0 * B - x)), turned)
    slope = -(B - x) * A * math.sin(q) / root_
    rise = A * math.cos(q) - slope
    weight = M_A * A * math.cos(q) + M_B * (A * math.cos(q) + rise) + M_T * rise
    return -G * weight / (2.0 * (q - REST)), A * math.sin(q) - root_


LINES = [((5.0, 4.0), 12), ((3.9, 4.6), 8), ((60.0, 2.0), 51), ((2.0, 60.0), 401), ((60.0, 2.0), 401)]


@pytest.mark.parametrize(("ends", "points"), [LINES[0], *(pytest.param(*x, marks=pytest.mark.long) for x in LINES[1:])])
def test_an_eigenvalue_is_infinite_where_all_links_lie_on_a_line(ends, points):
    result = mbstab.loads(FIVE_BAR).sweep("kp", np.linspace(*ends, points))
    *_, infinite = result.critical
    assert (infinite.kind, infinite.unstable) == ("infinity", (1, 0))
    assert infinite.value == pytest.approx(STRETCHED, rel=1e-10)
    assert [c.unstable for c in result.critical] == [(0, 1), (1, 0)][-len(result.critical) :]


@pytest.mark.parametrize("beyond", [4e-5, 1e-6, -1e-5])
def test_a_position_beside_the_line_is_known_or_warned_of_or_refused(beyond):
    """All commands say the same about it."""
    mechanism, kp = mbstab.loads(FIVE_BAR), STRETCHED + beyond
    try:
        (found,) = mechanism.equilibria(kp=kp)
    except mbstab.MbstabError:
        with pytest.raises(mbstab.MbstabError):
            mechanism.eig(kp=kp)
        return
    unsure = [x for x in found.motion.warnings if x.startswith("the equilibrium that was found is known to ")]
    assert [x for x in mechanism.eig(kp=kp).warnings if "was found" in x] == unsure
    if not unsure:
        turned = found.motion.q[mechanism.model.coordinates().index("c1.theta")] - math.pi
        near, far = (stiffness_that_holds(x * turned)[0] - kp for x in (0.9, 1.1))
        assert near * far < 0.0


@pytest.mark.long
def test_equilibria_beside_a_singular_configuration_are_found_to_rounding():
    """Multipliers grow without bound there, and with them what rounding does to the balance."""
    turned = np.concatenate([sign * np.geomspace(1e-3, 0.03, 8) for sign in (1.0, -1.0)])
    held = sorted(stiffness_that_holds(x) for x in turned.tolist())
    result = mbstab.loads(FIVE_BAR).sweep("kp", np.array([kp for kp, _ in held]))
    heights = np.array([y for _, y in held])
    np.testing.assert_allclose(result.reference["tip.y"], heights, atol=1e-10)
    assert np.all(result.unstable == np.where(heights < 0.0, 1, 0))


@pytest.mark.parametrize("turned", [0.002, 0.0005, -0.001, -0.005, -2e-5])
def test_newton_finds_an_equilibrium_beside_a_singular_configuration_from_afar(turned):
    """On the way multipliers grow, and with them residuals, although each step leads nearer to the solution."""
    kp, height = stiffness_that_holds(turned)
    mechanism = mbstab.loads(FIVE_BAR)
    (found,) = mechanism.equilibria(kp=kp)
    assert found.motion.q[mechanism.model.coordinates().index("tip.y")] == pytest.approx(height, abs=1e-9)
    assert mechanism.eig(kp=kp).verdict == ("asymptotically stable" if height > 0.0 else "unstable")


def test_paths_branch_off_from_one_on_which_no_force_acts():
    """Of V = (1 - p) x²/2 + x⁴/4; slopes of forces were compared with forces of a move by 1e-5, and none was seen."""
    scene = (
        "mbstab: 1\nparameters: {p: 0}\nbodies: {b: {type: planar_point, mass: 1}}\n"
        "constraints: {c: {holonomic: b.y}}\n"
        "forces: {f: {type: potential, energy: (1 - p)*b.x**2/2 + b.x**4/4}}\n"
        "reference: {find: equilibrium, guess: {b: {x: 0}}}\n"
    )
    result = mbstab.loads(scene).sweep("p", np.linspace(0.5, 1.55, 8))
    (critical,) = result.critical
    assert (critical.branching, critical.value) == (True, pytest.approx(1.0))
    assert len(result.beyond) == 2
    for path in result.beyond:
        np.testing.assert_allclose(path.reference["b.x"] ** 2, path.values - 1.0, atol=1e-12)
