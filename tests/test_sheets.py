"""Charts of equilibria that exist in a part of the plane only: against closed forms, and `eig` point by point."""

import numpy as np
import pytest

import mbstab
from mbstab.analysis.reference import continuation
from mbstab.analysis.reference.paths import Path, PathEnd, Sheet
from mbstab.analysis.reference.sheets import follow_all
from mbstab.analysis.sweep.chart import _ends

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
    assert set(b[np.any(exists, axis=1)]) == set(drawn[on_edge, 1])
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


def test_a_table_that_the_first_column_leaves_does_not_end_the_rows():
    a, b = np.linspace(0.0, 1.5, 8), np.linspace(-0.53, 1.1, 8)
    chart = mbstab.loads(TEXT.replace("ROOM - p.x**2", "2*spline(a - b, load) - p.x")).chart({"a": a, "b": b})
    A, B = np.meshgrid(a, b)
    assert np.array_equal(chart.unstable, np.where(A > B, np.where(0.3 + A / 2 - B / 3 > 0.0, 0, 2), -1))
    (curve,) = chart.boundaries
    np.testing.assert_allclose(curve[:, 0], curve[:, 1], atol=1e-9)
    assert all("is outside the table 'load'" in text for text in chart.problems.values())


def test_a_row_is_not_continued_on_another_sheet():
    """Beside a cusp: rows with two folds end at the first one, though their neighbour leads around to the others."""
    text = TEXT.replace("ROOM - p.x**2", "a + b*p.x - p.x**3").replace("start: 1", "start: -1")
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
