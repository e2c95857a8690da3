"""Branches that touch, are equal at an end of the range, or pass multiple zeros: rounding shows no meetings."""

import numpy as np
import pytest

import mbstab

TEXT = """mbstab: 1
parameters: {p: 0}
bodies: {a: {type: planar_point, mass: 1}}
forces: {s: {type: expression, on: {a.x: -a.x, a.y: -(1 + GAP)*a.y}}}
reference: {coordinates: {a: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(
    ("gap", "meeting", "within"),
    [
        ("p**2", None, 0.0),
        ("p**3", None, 0.0),
        ("p**4", None, 0.0),
        ("(p - 1)**2", None, 0.0),
        ("(p - 0.5)**2", 0.5, 1e-12),
        ("(p - 0.503)**2", 0.503, 1e-6),
        ("(p - 0.503)**3", 0.503, 1e-4),
        ("1e-4*(p - 0.503)", 0.503, 1e-8),
        ("p - 0.503", 0.503, 1e-11),
        ("0.5*sin(9*pi*p)", (1 / 9, 2 / 9, 1 / 3, 4 / 9, 5 / 9, 2 / 3, 7 / 9, 8 / 9), 1e-11),
    ],
)
def test_branches_that_touch_meet_once(gap, meeting, within):
    found = mbstab.loads(TEXT.replace("GAP", gap)).sweep("p", np.linspace(0.0, 1.0, 21))
    expected = np.repeat([] if meeting is None else np.atleast_1d(meeting), 2)  # above and below the real axis
    assert found.warnings == ()
    assert {kind for _, kind in found.meetings} <= {"cross"}
    assert len(found.meetings) == len(expected)
    assert np.max(np.abs(np.sort([value for value, _ in found.meetings]) - expected), initial=0.0) <= within


def test_two_shafts_that_are_equal_at_first_do_not_meet():
    found = mbstab.load("drive_shafts.yaml").sweep("beta", np.linspace(0.0, 1.2, 61))
    assert (found.warnings, found.meetings) == ((), ())


def test_a_pair_is_followed_through_zeros_that_nothing_explains():
    found = mbstab.load("rolling_disk.yaml").sweep("omega", np.linspace(0.0, 10.0, 401))
    assert (found.warnings, found.meetings) == ((), ())
    first, last = found.branches[[0, -1]]
    growing, falling = int(np.argmax(first.real)), int(np.argmin(first.real))
    assert last[growing].imag > 5.0
    assert last[falling].imag < -5.0
    (critical,) = found.critical
    assert critical.branches == (growing,)
    assert critical.value == pytest.approx(3.316764376003506, rel=1e-11)
