"""Stability charts: regions and boundaries against closed forms, points without an answer, the command line."""

import csv
import io
import json
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from closed_forms import critical_disk
from sampling import sample

import mbstab
from mbstab.cli import main
from mbstab.errors import UsageError
from mbstab.model.library import installed_models
from mbstab.report.pictures.regions import regions

# a.x and b.x are uncoupled oscillators with stiffness k and c; the first has the mass m and the damping d.
OSCILLATORS = """\
mbstab: 1
parameters: {k: 1, c: 2, m: 1, d: 0}
bodies:
  a: {type: planar_point, mass: m}
  b: {type: planar_point, mass: 1}
constraints:
  rail_a: {holonomic: a.y}
  rail_b: {holonomic: b.y}
forces:
  springs:
    type: expression
    on:
      a.x: -k*a.x - d*rate(a.x)
      b.x: -c*b.x - d*rate(b.x)
reference:
  coordinates:
    a: {x: 0, y: 0}
    b: {x: 0, y: 0}
"""


@np.vectorize
def critical_spin(R, g=9.81):
    """Return the spin from which a disk rolls stably."""
    return float(critical_disk(R=R, g=g))


@pytest.fixture(scope="module")
def disk():
    grid = {"omega": np.linspace(0.0, 8.0, 31), "R": np.linspace(0.1, 0.6, 13)}
    return mbstab.load("rolling_disk.yaml").chart(grid)


def test_regions_of_the_disk(disk):
    assert disk.parameters == ("omega", "R")
    assert disk.problems == {}
    assert disk.unstable.shape == (13, 31)
    slow = disk.x[None, :] < critical_spin(disk.y)[:, None]
    # Faster ones do not fall, but driving the last Cardan angle breaks the turn about the vertical: two open zeros.
    assert np.array_equal(disk.unstable, np.where(slow, 1, -1))
    assert np.array_equal(disk.verdicts, np.where(slow, "unstable", "undecided"))


def test_the_boundary_of_the_disk_is_one_curve_with_all_its_points(disk):
    (curve,) = disk.boundaries
    assert np.max(np.abs(curve[:, 0] / critical_spin(curve[:, 1]) - 1.0)) < 1e-9
    changes = np.sum(disk.unstable[:, 1:] != disk.unstable[:, :-1])
    changes += np.sum(disk.unstable[1:] != disk.unstable[:-1])
    assert len(curve) == len(np.unique(curve, axis=0)) == changes
    # Neighbours on the curve lie in one cell: the curve goes one way, from edge to edge.
    cell = np.array([disk.x[1] - disk.x[0], disk.y[1] - disk.y[0]])
    assert np.all(np.abs(np.diff(curve, axis=0)) <= cell * (1 + 1e-12))
    assert np.all(np.diff(curve[:, 0] * np.sign(curve[-1, 0] - curve[0, 0])) > 0.0)
    assert {curve[0, 1], curve[-1, 1]} == {disk.y[0], disk.y[-1]}


def test_exchanging_the_parameters_transposes_the_chart(disk):
    other = mbstab.load("rolling_disk.yaml").chart({"R": disk.y, "omega": disk.x})
    assert np.array_equal(other.unstable, disk.unstable.T)
    one, two = (np.unique(np.round(curve, 9), axis=0) for curve in (disk.boundaries[0], other.boundaries[0][:, ::-1]))
    assert np.allclose(one, two, atol=2e-9)


def test_other_settings_move_the_boundary(disk):
    grid = {"omega": disk.x, "R": disk.y}
    result = mbstab.load("rolling_disk.yaml").chart(grid, g=1.62)
    for curve in result.boundaries:
        assert np.max(np.abs(curve[:, 0] / critical_spin(curve[:, 1], g=1.62) - 1.0)) < 1e-9


def test_the_weave_speed_of_the_bicycle_is_on_its_boundary():
    grid = {"v": np.linspace(3.0, 7.0, 9), "w": np.array([1.0, 1.02, 1.04])}
    result = mbstab.load("whipple_bicycle.yaml").chart(grid)
    assert set(result.unstable.ravel()) == {0, 1, 2}
    points = np.concatenate(result.boundaries)
    found = np.sort(points[points[:, 1] == 1.02][:, 0])
    assert np.allclose(found, [4.29238253634110395869, 6.02426201538835888987], rtol=1e-10)


@pytest.mark.long
def test_three_regions_meet():
    # One unstable eigenvalue for each stiffness below zero; the corner lies inside a cell, three regions in it.
    x, y = np.linspace(-1.0, 1.4, 9), np.linspace(-0.7, 1.0, 8)
    result = mbstab.loads(OSCILLATORS).chart({"k": x, "c": y})
    assert np.array_equal(result.unstable, (x[None, :] < 0).astype(int) + (y[:, None] < 0))
    points = np.unique(np.round(np.concatenate(result.boundaries), 12), axis=0)
    assert np.all(np.min(np.abs(points), axis=1) < 1e-9)
    # Every line of the grid is crossed.
    for axis, values in enumerate((x, y)):
        assert set(np.round(values, 12)) <= set(points[np.abs(points[:, 1 - axis]) < 1e-9, axis])
    # The corner itself.
    result = mbstab.loads(OSCILLATORS).chart({"k": x, "d": y})
    expected = np.where(y[:, None] < 0, np.where(x[None, :] < 0, 3, 4), np.where(x[None, :] < 0, 1, 0))
    assert np.array_equal(result.unstable, expected)
    assert np.all(np.min(np.abs(np.concatenate(result.boundaries)), axis=1) < 1e-9)


def test_boundaries_through_points_of_the_grid_are_lines():
    """A stiffness is zero at points of the grid, where an eigenvalue is undecided."""
    text = OSCILLATORS.replace("a.x: -k*a.x", "a.x: -(k - c)*a.x")
    values = np.linspace(0.2, 1.0, 9)
    result = mbstab.loads(text).chart({"k": values, "c": values})
    points = np.concatenate(result.boundaries)
    assert np.max(np.abs(points[:, 0] - points[:, 1])) < 1e-9
    along = np.sort(points[:, 0])
    assert along[0] < 0.31
    assert along[-1] > 0.89
    assert np.max(np.diff(along)) < 0.11
    assert len(result.detail.x) == 9  # what runs through points of the grid needs no finer one


@pytest.mark.long
def test_curves_reach_the_point_where_they_meet():
    # Weave, capsize and both: three regions in one cell.
    x, y = np.array([4.0, 5.0, 6.0, 7.0]), np.array([1.1, 1.15, 1.2])
    result = mbstab.load("whipple_bicycle.yaml").chart({"v": x, "w": y})
    assert {0, 1, 2, 3} == set(result.unstable.ravel())
    # Nothing but the edges of the grid ends a curve, or another curve.
    points = [tuple(point) for curve in result.boundaries for point in curve]
    for end in (tuple(curve[k]) for curve in result.boundaries for k in (0, -1)):
        assert end[0] in (x[0], x[-1]) or end[1] in (y[0], y[-1]) or points.count(end) > 1


@pytest.mark.long
def test_a_bend_within_a_cell_is_drawn():
    """Ziegler's column: with little damping of the upper hinge the critical force rises from 2 to 2.086 and falls."""
    y = np.linspace(0.0, 0.2, 9)
    result = mbstab.load("ziegler_column.yaml").chart({"P": np.linspace(1.05, 3.0, 9), "b_2": y})
    assert result.unstable.shape == (9, 9)
    (curve,) = result.boundaries
    force, damping = curve[curve[:, 1] > 0.0].T
    beta = 0.1 / damping
    critical = (4 * beta**2 + 33 * beta + 4) / (2 * (beta**2 + 7 * beta + 6)) + 0.05 * damping
    assert np.max(np.abs(force - critical)) < 1e-9
    assert 2.085 < np.max(force) < 2.0864
    assert result.detail.unstable.shape == (len(result.detail.y), len(result.detail.x))
    assert set(y) < set(result.detail.y)


@pytest.mark.long
def test_a_region_between_the_lines_of_the_grid_is_found():
    """Two boundaries through 0, which differ by less than a cell: between them one eigenvalue grows."""
    text = OSCILLATORS.replace("-c*b.x - d*rate(b.x)", "-(k + c)*b.x").replace(
        "-k*a.x - d*rate(a.x)", "-(k + 0.85*c)*a.x"
    )
    x = np.linspace(-1.0, 1.1, 11)
    result = mbstab.loads(text).chart({"k": x, "c": x + 0.013})
    fine = result.detail
    K, C = np.meshgrid(fine.x, fine.y)
    assert np.array_equal(fine.unstable, (K + C < 0).astype(int) + (K + 0.85 * C < 0))
    points = np.concatenate(result.boundaries)
    apart = np.array([np.abs(points[:, 0] + slope * points[:, 1]) for slope in (1.0, 0.85)])
    assert np.max(np.min(apart, axis=0)) < 1e-9
    for own, other in (apart, apart[::-1]):
        assert np.sum((own < 1e-9) & (other > 0.1)) > 3


def test_divergence_is_told_from_flutter():
    x, y = np.linspace(-1.0, 1.4, 9), np.linspace(-0.7, 1.0, 8)
    result = mbstab.loads(OSCILLATORS).chart({"k": x, "d": y})
    # λ² + dλ + k: one real eigenvalue grows below k = 0, a pair where d < 0, as that of the other oscillator does.
    assert np.array_equal(result.oscillating, np.where(y[:, None] < 0, np.where(x < 0, 2, 4), 0))


@pytest.mark.long
def test_three_regions_that_meet_in_one_cell():
    # Below zero stiffness 1, above and damped 0, above and undamped by rotation 2 or more: k(c) cut by a line.
    text = OSCILLATORS.replace("-c*b.x - d*rate(b.x)", "-(k + c)*b.x").replace("-k*a.x - d*rate(a.x)", "-(k - c)*a.x")
    x, y = np.linspace(-1.03, 1.0, 10), np.linspace(-0.97, 1.05, 11)
    result = mbstab.loads(text).chart({"k": x, "c": y})
    X, Y = np.meshgrid(x, y)
    assert np.array_equal(result.unstable, (X + Y < 0).astype(int) + (X - Y < 0))
    points = np.concatenate(result.boundaries)
    assert np.max(np.minimum(np.abs(points[:, 0] - points[:, 1]), np.abs(points.sum(axis=1)))) < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("points", sample([10, 24], 2))
def test_a_closed_boundary_closes(points):
    text = OSCILLATORS.replace("-k*a.x - d*rate(a.x)", "-(k**2 + c**2 - 1)*a.x").replace("-c*b.x", "-b.x")
    x = np.linspace(-2.1, 2.0, points)
    result = mbstab.loads(text).chart({"k": x, "c": x + 0.07})
    (curve,) = result.boundaries
    assert np.array_equal(curve[0], curve[-1])
    assert np.max(np.abs(np.hypot(*curve.T) - 1.0)) < 1e-9
    turned = np.diff(np.unwrap(np.arctan2(curve[:, 1], curve[:, 0])))
    assert abs(abs(turned.sum()) - 2 * math.pi) < 1e-12
    assert np.all(turned > 0) or np.all(turned < 0)


def test_a_chart_without_a_boundary():
    result = mbstab.loads(OSCILLATORS).chart({"k": np.array([1.0, 2.0]), "c": np.array([1.0, 2.0])})
    assert result.boundaries == []
    assert np.array_equal(result.unstable, np.zeros((2, 2)))


def test_points_without_an_answer_are_no_region():
    x, y = np.linspace(-1.0, 1.4, 9), np.linspace(-1.0, 1.1, 7)
    result = mbstab.loads(OSCILLATORS).chart({"k": x, "m": y})
    lost = np.broadcast_to(y[:, None] <= 0, (7, 9))
    assert np.array_equal(result.unstable, np.where(lost, -1, (x[None, :] < 0).astype(int)))
    assert set(result.problems) == set(np.flatnonzero(lost))
    assert all("mass must not be negative" in text for text in result.problems.values())
    (curve,) = result.boundaries
    assert np.max(np.abs(curve[:, 0])) < 1e-9
    assert np.array_equal(np.sort(curve[:, 1]), y[y > 0])


@pytest.mark.parametrize(
    ("grid", "settings"),
    [
        ({"k": [1.0, 2.0]}, {}),
        ({"k": [1.0, 2.0], "c": [1.0, 2.0], "m": [1.0, 2.0]}, {}),
        ({"k": [1.0, 2.0], "c": [1.0, 3.0, 2.0]}, {}),
        ({"k": [1.0, 2.0], "c": [1.0, 1.0]}, {}),
        ({"k": [1.0, 2.0], "c": [1.0, 2.0]}, {"c": 3}),
    ],
)
def test_charts_that_cannot_be(grid, settings):
    with pytest.raises(UsageError):
        mbstab.loads(OSCILLATORS).chart({name: np.array(x) for name, x in grid.items()}, **settings)


# --- command line ---------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["sweep", *map(str, arguments)])


DISK = ("rolling_disk.yaml", "--param", "omega", "--param", "R")
RANGES = ("--from", 0, "--to", 8, "--from", 0.1, "--to", 0.6, "--points", 11, "--points", 5)


def test_json_of_a_chart():
    result = run(*DISK, *RANGES, "--format", "json")
    data = json.loads(result.stdout)
    assert result.exit_code == 0
    keys = {"model", "title", "parameters", "units", "values", "unstable", "verdicts", "boundaries", "problems"}
    keys |= {"divisions", "warnings", "start"}
    assert set(data) == keys
    assert data["parameters"] == ["omega", "R"]
    assert data["units"] == ["rad/s", "m"]
    assert [len(x) for x in data["values"]] == [11, 5]
    omega, R = map(np.array, data["values"])
    slow = omega[None, :] < critical_spin(R)[:, None]
    assert [[n == 1 for n in row] for row in data["unstable"]] == slow.tolist()
    assert [[n is None for n in row] for row in data["unstable"]] == (~slow).tolist()
    assert np.array_equal(data["verdicts"], np.where(slow, "unstable", "undecided"))
    for curve in data["boundaries"]:
        for omega_c, R_c in curve:
            assert abs(omega_c / critical_spin(R_c) - 1.0) < 1e-9
    assert data["problems"] == []


def test_csv_and_npz_of_a_chart(tmp_path):
    rows = list(csv.reader(io.StringIO(run(*DISK, *RANGES, "--format", "csv").stdout)))
    assert rows[0] == ["omega (rad/s)", "R (m)", "unstable", "verdict"]
    assert len(rows) == 1 + 55
    for omega, R, n, verdict in rows[1:]:
        slow = float(omega) < critical_spin(float(R))
        assert (n, verdict) == (("1", "unstable") if slow else ("", "undecided"))
    place = tmp_path / "disk.npz"
    assert run(*DISK, *RANGES, "--plot", "none", "--output", place).exit_code == 0
    with np.load(place) as data:
        assert data["parameters"].tolist() == ["omega", "R"]
        assert data["unstable"].ravel().tolist() == [int(row[2] or -1) for row in rows[1:]]
        assert data["verdicts"].ravel().tolist() == [row[3] for row in rows[1:]]
        points = data["boundaries"][~np.isnan(data["boundaries"][:, 0])]
        assert np.max(np.abs(points[:, 0] / critical_spin(points[:, 1]) - 1.0)) < 1e-9
    assert [path.name for path in tmp_path.iterdir()] == ["disk.npz"]


def test_missing_points_of_a_chart_give_exit_code_1(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(OSCILLATORS, encoding="utf-8")
    ranges = ("--from", -1, "--to", 1.4, "--from", -1, "--to", 1.1, "--points", 9, "--points", 7)
    result = run(path, "--param", "k", "--param", "m", *ranges, "--format", "json")
    assert result.exit_code == 1
    assert "of 63 points have no answer" in result.stderr
    data = json.loads(result.stdout)
    assert [row[0] is None for row in data["unstable"]] == (np.linspace(-1, 1.1, 7) <= 0).tolist()
    assert len(data["problems"]) == sum(n is None for row in data["unstable"] for n in row)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--param", "W"), "a chart two different ones"),
        (("--from", 1), "--from is given once for 2 parameters: once for each"),
        (("--values", "1,2"), "one parameter"),
    ],
)
def test_a_command_line_that_is_wrong(arguments, message):
    result = run(*DISK, *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.long
def test_a_chart_follows_equilibria_and_draws_where_they_end():
    from test_sweep import snap

    x, y = np.linspace(0.0, 6.0, 25), np.linspace(0.2, 0.6, 9)
    result = mbstab.load("von_mises_truss.yaml").chart({"P": x, "h": y})
    for row, h in zip(result.unstable, y, strict=True):
        assert np.array_equal(row, np.where(x < snap(h=h), 0, -1))
    assert all("no solution beyond P" in text for text in result.problems.values())
    (curve,) = [points for points in result.boundaries if len(points) > 1]
    for load, h in curve:
        assert abs(load - snap(h=h)) < 1e-10


@pytest.mark.long
def test_a_chart_of_equilibria_draws_nothing_between_paths_that_differ():
    from test_sweep import CUBIC

    # Only the row without imperfection loses stability: its neighbours are other paths.
    text = CUBIC.replace("LOAD", "mu*p.x - p.x**3 + e").replace("{mu: 0, x0: 1}", "{mu: 0, x0: 0, e: 0}")
    mechanism = mbstab.loads(text)
    result = mechanism.chart({"mu": np.linspace(-2.0, 2.0, 20), "e": np.linspace(-0.1, 0.1, 5)})
    assert [sorted(set(row.tolist())) for row in result.unstable] == [[0], [0], [0, 1], [0], [0]]
    assert all(np.allclose(points, 0.0, atol=1e-9) for points in result.boundaries)
    (text,) = result.warnings
    assert text.startswith("no boundary is drawn between 20 pairs of neighbouring points")
    assert "no path of equilibria joins them" in text


SAGGING = """\
mbstab: 1
parameters: {k: 50, c: 5, q: 20, T: 0.05, a: 0.5}
gravity: [0, -9.81]
bodies: {b: {type: planar_point, mass: 1}}
states: {f: {rate: (K - f)/T}}
forces:
  act: {type: expression, on: {b.x: f - c*rate(b.x) + q*b.y, b.y: -1.1*k*b.y*(1 + a*b.y**2) - c*rate(b.y) - q*b.x}}
reference: {find: equilibrium}
""".replace("K -", "-k*b.x*(1 + a*b.x**2) -")
"""A mass that sags on springs, one of which lags, under a follower force."""
SPANS = {"k": (10.0, 200.0), "c": (0.3, 8.0), "q": (1.0, 100.0), "T": (0.001, 0.3), "a": (0.0, 3.0)}


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", range(40))
def test_boundaries_of_found_equilibria_have_what_sweeps_find_along_rows_and_columns(seed):
    rng = np.random.default_rng(seed)
    names = rng.choice(list(SPANS), 2, replace=False).tolist()
    others = {n: round(float(rng.uniform(*SPANS[n])), 4) for n in SPANS if n not in names}
    mechanism = mbstab.loads(SAGGING).at(**others)
    chart = mechanism.chart({n: np.linspace(*SPANS[n], int(rng.integers(6, 10))) for n in names})
    vertices = np.concatenate([np.zeros((0, 2)), *chart.boundaries])
    axes, counts = (chart.x, chart.y), chart.unstable
    edges = []
    for axis, (one, other) in enumerate([(counts[:, :-1], counts[:, 1:]), (counts[:-1], counts[1:])]):
        changed = np.argwhere((one != other) & (one >= 0) & (other >= 0))
        edges += [(axis, *map(int, e)) for e in changed]
    found = {}
    for axis, i, j in edges:
        fixed, low = (chart.y[i], chart.x[j]) if axis == 0 else (chart.x[j], chart.y[i])
        high = axes[axis][(j if axis == 0 else i) + 1]
        on = vertices[vertices[:, 1 - axis] == fixed, axis]
        found[axis, i, j] = on[(on >= low) & (on <= high)], fixed, low, high
    untold = [edge for edge, (on, *_) in found.items() if not len(on)]
    assert len(untold) == 0 or "no boundary is drawn" in "".join(chart.warnings)
    for edge in rng.permutation([e for e in edges if e not in untold])[:4].tolist():
        on, fixed, low, high = found[tuple(edge)]
        swept = mechanism.at(**{names[1 - edge[0]]: fixed}).sweep(names[edge[0]], np.linspace(low, high, 4))
        values = [c.value for c in swept.critical if min(c.unstable) >= 0]
        assert any(abs(x - value) < 1e-6 * (high - low) for x in on for value in values)


def test_descending_ranges_are_answered_like_ascending_ones():
    mechanism = mbstab.loads(SAGGING)
    q, c = np.linspace(1.0, 100.0, 5), np.linspace(0.3, 8.0, 4)
    up, down = mechanism.chart({"q": q, "c": c}), mechanism.chart({"q": q[::-1], "c": c[::-1]})
    assert np.array_equal(up.x, down.x)
    assert np.array_equal(up.words, down.words)
    assert all(np.array_equal(one, other) for one, other in zip(up.boundaries, down.boundaries, strict=True))


@pytest.mark.long
def test_a_parameter_of_the_guess_alone_changes_nothing_and_that_is_said():
    truss = mbstab.load("von_mises_truss.yaml")
    grid = {"y": np.linspace(0.025, 2.5, 5), "h": np.linspace(0.5, 2.5, 4)}
    result = truss.chart(grid)
    assert result.start == (0.5, 0.5)
    (text,) = result.warnings
    assert text.startswith("only the guess of the reference uses y: the equilibrium found at y = 0.5 m")
    assert truss.sweep("y", grid["y"]).warnings == (text,)
    assert not truss.chart({"P": np.linspace(0.0, 1.0, 3), "h": grid["h"]}).warnings
    arguments = ["--param", "y", "--param", "h", "--from", "0.025,0.5", "--to", "2.5,2.5", "--points", "5,4"]
    shown = CliRunner().invoke(main, ["sweep", "von_mises_truss.yaml", *arguments, "--plot", "none"])
    assert "equilibria followed from y = 0.5, h = 0.5" in shown.stdout
    assert f"warning: {text}" in shown.stderr
    assert mbstab.load("bead_on_hoop.yaml").sweep("Omega", np.linspace(1.0, 5.0, 3)).warnings == ()


def test_a_parameter_that_nothing_uses_is_told():
    free = mbstab.loads("""
mbstab: 1
parameters: {m: 2, c: {value: 1, unit: N/m}, d: 3, e: 2*d, f: 1, g: f}
bodies: {p: {type: planar_point, mass: m}}
forces: {s: {type: expression, on: {p.x: -c*p.x, p.y: -g*p.y}}}
""")
    said = "neither the equations of motion nor the reference use {}: it changes no eigenvalue"
    assert free.sweep("e", np.linspace(1.0, 2.0, 3)).warnings == (said.format("e"),)
    assert free.chart({"d": np.linspace(1.0, 2.0, 3), "m": np.linspace(1.0, 2.0, 3)}).warnings == (said.format("d"),)
    assert free.sweep("f", np.linspace(1.0, 2.0, 3)).warnings == ()


def damped(**settings):
    """Return Ziegler's column with the same damping in both hinges."""
    text = next(path for path in installed_models() if path.name == "ziegler_column.yaml").read_text(encoding="utf-8")
    text = text.partition("\nsweep:")[0].replace("b_1: {value: 0.1,", "b_1: {value: b_2,").partition("\nexpect:")[0]
    return mbstab.loads(text).at(**settings)


def test_damping_that_begins_at_zero_makes_a_jump_which_a_chart_tells():
    chart = damped().chart({"P": np.linspace(0.0, 4.0, 17), "b_2": np.linspace(0.0, 0.5, 9)})
    words = " ".join(str(chart).split())
    low, high = map(float, re.search(r"along b_2 = 0 from about P = (\S+) to (\S+):", words).groups())
    # Without damping the collision at 7/2 - sqrt(2), with the least damping the limit 41/28 of the closed form.
    assert high == pytest.approx(3.5 - math.sqrt(2.0), abs=0.01)
    assert low == pytest.approx(41.0 / 28.0, abs=0.04)


def test_damping_that_begins_at_zero_makes_a_jump_which_a_sweep_tells():
    found = damped(P=1.8).sweep("b_2", np.linspace(0.0, 0.5, 11))
    (jump,) = found.critical
    assert (jump.value, jump.kind, jump.unstable) == (0.0, "flutter", (0, 2))
    assert jump.frequency == pytest.approx(math.sqrt((3.4 - math.sqrt(3.4**2 - 8.0)) / 4.0), rel=1e-12)
    assert damped(P=1.4).sweep("b_2", np.linspace(0.0, 0.5, 11)).critical == ()


UPRIGHT = """\
mbstab: 1
parameters: {m: 1, k: 2}
gravity: [0, -8]
bodies:
  rod: {type: planar, mass: m, inertia: 1, points: {O: [-0.25, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
forces:
  spring: {type: joint_spring, joint: pivot, stiffness: k, rest: pi/2}
reference:
  coordinates: {rod: {theta: pi/2}}
  guess: {rod: {y: 0.25}}
"""


@pytest.mark.long
def test_points_on_a_boundary_are_judged_as_eig_judges_them():
    mechanism = mbstab.loads(UPRIGHT)
    m, k = np.linspace(0.5, 1.5, 3), np.linspace(1.0, 3.0, 3)
    chart = mechanism.chart({"m": m, "k": k})
    for i, stiffness in enumerate(k.tolist()):
        for j, mass in enumerate(m.tolist()):
            found = mechanism.eig(m=mass, k=stiffness)
            assert chart.verdicts[i][j] == found.verdict != "undecided"
            assert chart.unstable[i, j] == sum(e.value.real > 0.1 for e in found.eigenvalues)


def test_a_line_divides_flutter_from_divergence():
    """Without damping Ziegler's column flutters from P l/k = 7/2 - sqrt(2) on, and diverges from 7/2 + sqrt(2) on."""
    chart = mbstab.load("ziegler_column.yaml").chart(
        {"P": np.linspace(3.03, 6.03, 7), "k": np.linspace(0.8, 1.2, 5)}, b_1=0, b_2=0
    )
    (line,) = chart.divisions
    np.testing.assert_allclose(line[:, 0], (3.5 + math.sqrt(2.0)) * line[:, 1], rtol=1e-6)
    assert np.ptp(line[:, 1]) == pytest.approx(0.4)


@pytest.mark.long
@pytest.mark.parametrize(
    ("force", "ends", "told"),
    [
        # Unstable where q > p² + 0.3: a region that reaches the end of the range and no further.
        ("-4*b.x - (p**2 + 0.3 - q)*rate(b.x)", (0.0, 0.7), False),
        # Unstable everywhere but at the end, where the damping vanishes.
        ("-4*b.x - (q - 0.7)*rate(b.x)", (0.0, 0.7), True),
    ],
)
def test_a_region_that_ends_with_the_range_is_no_jump(force, ends, told):
    text = (
        "mbstab: 1\nparameters: {p: 0.2, q: 0.1}\nbodies: {b: {type: planar_point, mass: 1}}\n"
        f"constraints: {{rail: {{holonomic: b.y}}}}\nforces: {{s: {{type: expression, on: {{b.x: '{force}'}}}}}}\n"
        "reference: {coordinates: {b: {x: 0, y: 0}}}\n"
    )
    for names in (("p", "q"), ("q", "p")):
        values = {"p": np.linspace(-1.0, 1.0, 7), "q": np.linspace(*ends, 5)}
        found = mbstab.loads(text).chart({name: values[name] for name in names})
        said = " ".join(str(found).split())
        assert ("jump: a boundary runs along q = 0.7 from about p = -1 to 1" in said) == told
        assert ("jump" in said) == told


# --- regions between the points of the grid: their sizes against those that boundaries enclose ------------------------


def area(polygon):
    x, y = np.array(polygon).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def circle_on(x, y):
    """Return the points in which the unit circle crosses the lines of a grid, around it."""
    found = [(s * math.sqrt(1.0 - v * v), v) for v in y if abs(v) < 1.0 for s in (1, -1)]
    found += [(v, s * math.sqrt(1.0 - v * v)) for v in x if abs(v) < 1.0 for s in (1, -1)]
    return np.array(sorted(found, key=lambda point: math.atan2(point[1], point[0])))


@pytest.mark.parametrize("down", [False, True])
def test_regions_end_at_their_boundary(down):
    x, y = np.linspace(-1.53, 1.6, 14), np.linspace(-1.41, 1.5, 11)
    x = x[::-1] if down else x
    inside = (np.hypot(*np.meshgrid(x, y)) < 1.0).astype(int)
    found = regions(x, y, inside, [circle_on(x, y)])
    sizes = {label: sum(abs(area(polygon)) for polygon in polygons) for label, polygons in found.items()}
    assert sum(sizes.values()) == pytest.approx(abs(np.ptp(x) * np.ptp(y)), rel=1e-12)
    # Chords of the circle, of which a cell of the grid cuts off at most 3 % here; half cells are 10 % away.
    assert 0.97 * math.pi < sizes[1] < math.pi


@pytest.mark.parametrize("slope", [0.3, 2.7, -3.1])
@pytest.mark.parametrize("transposed", [False, True])
def test_regions_end_at_a_boundary_that_is_known_in_each_row_only(slope, transposed):
    """Such as that of folds: its line crosses several columns from one row to the next."""
    x, y = np.linspace(0.0, 10.0, 21), np.linspace(0.0, 3.0, 4)
    line = 5.0 - slope * (y - 1.5) + 0.013
    beyond = np.where(x < line[:, None], 0, -1)
    curve = np.column_stack([line, y])
    found = regions(y, x, beyond.T, [curve[:, ::-1]]) if transposed else regions(x, y, beyond, [curve])
    sizes = {label: sum(abs(area(polygon)) for polygon in polygons) for label, polygons in found.items()}
    assert sizes == {0: pytest.approx(3.0 * 5.013, rel=1e-12), -1: pytest.approx(3.0 * 4.987, rel=1e-12)}


def test_cells_with_three_and_four_regions_are_filled_once():
    for labels in ([[0, 1], [2, 2]], [[0, 1], [1, 0]], [[0, 1], [2, 0]], [[0, 1], [3, 2]], [[0, 1], [1, 2]]):
        found = regions(np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.array(labels), [])
        assert set(found) == set(np.ravel(labels))
        assert all(area(polygon) > 0.0 for polygons in found.values() for polygon in polygons)
        assert sum(area(polygon) for polygons in found.values() for polygon in polygons) == pytest.approx(2.0)
