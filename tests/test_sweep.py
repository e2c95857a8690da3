"""Sweeps: critical values against closed forms, branches against `eig`, points without an answer."""

import csv
import io
import json
import math
import re
import subprocess
import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from closed_forms import critical_disk, critical_top, critical_ziegler
from documents import documents
from paths import avoided, bicycle_paths, chain_path, swaps
from sampling import sample
from scipy.optimize import linear_sum_assignment
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.reference import continuation
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.sweep import batched_spectra, sweep
from mbstab.analysis.sweep.branches import Branches
from mbstab.analysis.sweep.tolerances import TOLERANCES as SWEEP
from mbstab.analysis.verdict.rule import STRENGTH
from mbstab.cli import main
from mbstab.errors import UsageError
from mbstab.model.ranges import sweep_values

SQRT2 = math.sqrt(2.0)


def wheelset_speed():
    m, i, f, h, gamma, r, k_y, k_psi = 1022.0, 678.0, 1e7, 0.7465, 0.1, 0.4566, 1e5, 1e6
    w = (k_psi + k_y * h**2) / (m * h**2 + i)
    square = m * i * w**2 - (m * k_psi + i * k_y) * w + k_y * k_psi + 4 * f**2 * h * gamma / r
    return 2 * f * h * math.sqrt(w / square), math.sqrt(w)


def damped_ziegler(b_1, b_2):
    b = b_1 / b_2
    return (4 * b**2 + 33 * b + 4) / (2 * (b**2 + 7 * b + 6)) + b_1 * b_2 / 2


TOP, DISK, FLUTTER = (float(f()) for f in (critical_top, critical_disk, critical_ziegler))
WHEELSET, HUNTING = wheelset_speed()
HOOP = math.sqrt(9.81 / 0.5)
WEAVE, CAPSIZE = 4.29238253634110395869, 6.02426201538835888987

# model, parameter, range, settings, and of each critical value: value, kind, frequency, unstable below and above.
# Verdicts between critical values are in WORDS_OF.
CASES = {
    "top": ("top.yaml", "omega", (0, 10), {}, [(TOP, "collision", 2e-4 * TOP / 3.16e-4, (2, 0))]),
    "disk": ("rolling_disk.yaml", "omega", (0, 10), {}, [(DISK, "divergence", 0.0, (1, 0))]),
    "torus": ("rolling_torus.yaml", "v", (0, 3), {}, [(0.853686309623846, "divergence", 0.0, (1, 0))]),
    "bicycle": (
        "whipple_bicycle.yaml", "v", (0, 10), {},
        [(WEAVE, "flutter", 3.4350338486614363, (2, 0)), (CAPSIZE, "divergence", 0.0, (0, 1))],
    ),
    "ziegler": (
        "ziegler_column.yaml", "P", (0, 6), {"b_1": 0, "b_2": 0}, [(FLUTTER, "collision", 2**-0.25, (0, 2))]
    ),
    "ziegler 0.1 0.2": (
        "ziegler_column.yaml", "P", (0, 6), {}, [(damped_ziegler(0.1, 0.2), "flutter", 0.480384461415260764, (0, 2))]
    ),
    "ziegler 1 1": (
        "ziegler_column.yaml", "P", (0, 6), {"b_1": 1, "b_2": 1},
        [(damped_ziegler(1, 1), "flutter", math.sqrt(2 / 7), (0, 2))],
    ),
    "ziegler 0.2 0.05": (
        "ziegler_column.yaml", "P", (0, 6), {"b_1": 0.2, "b_2": 0.05},
        [(damped_ziegler(0.2, 0.05), "flutter", math.sqrt(1 / 2), (0, 2))],
    ),
    "bead": ("bead_on_hoop.yaml", "Omega", (0, 8), {}, [(HOOP, "divergence", 0.0, (0, 1))]),
    "wheelset": ("wheelset.yaml", "V", (10, 100), {}, [(WHEELSET, "flutter", HUNTING, (0, 2))]),
    "shimmy": (
        "shimmy.yaml", "a", (0.1, 0.9), {},
        [(0.3, "flutter", 1.0, (2, 0)), (0.7, "flutter", math.sqrt(3 / 7), (0, 2))],
    ),
}  # fmt: skip


U, AS, M, OPEN = "unstable", "asymptotically stable", "marginally stable", "undecided"
WORDS_OF = {
    "top": (U, M),
    "disk": (U, OPEN),  # the driven Cardan angle leaves two zeros without explanation
    "torus": (U, "stable up to symmetry"),
    "bicycle": (U, "asymptotically stable up to symmetry", U),
    "ziegler": (M, U),
    "ziegler 0.1 0.2": (AS, U),
    "ziegler 1 1": (AS, U),
    "ziegler 0.2 0.05": (AS, U),
    "bead": ("stable up to symmetry", U),
    "wheelset": (AS, U),
    "shimmy": (U, AS, U),
}


def check(found, expected):
    assert [(c.kind, c.unstable) for c in found] == [(kind, unstable) for _, kind, _, unstable in expected]
    for c, (value, _, frequency, _) in zip(found, expected, strict=True):
        assert abs(c.value - value) <= 1e-11 * value
        # Where a derivative is steep the frequency takes over the error of the value.
        assert abs(c.frequency - frequency) <= 1e-9 * max(frequency, 1.0)


def optimal(one, other):
    """Return the largest distance between two spectra, paired so that the sum is least."""
    cost = np.abs(np.asarray(one)[:, None] - np.asarray(other)[None, :])
    rows, columns = linear_sum_assignment(cost)
    return np.max(cost[rows, columns], initial=0.0)


# --- critical values ------------------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize(("case", "points"), sample(product(CASES, [11, 23]), 3))
def test_critical_values_on_any_grid(case, points):
    name, parameter, ends, settings, expected = CASES[case]
    result = mbstab.load(name).sweep(parameter, np.linspace(*ends, points), **settings)
    check(result.critical, expected)
    assert [c.verdicts for c in result.critical] == list(pairwise(WORDS_OF[case]))
    # Every point is answered in the words of the range it lies in; the unloaded column has an energy.
    at = np.searchsorted([value for value, *_ in expected], result.values)
    words = [WORDS_OF[case][k] for k in at]
    words[0] = "stable" if case == "ziegler" else words[0]
    assert result.verdicts == words


@pytest.mark.few(1)
@pytest.mark.parametrize("case", sample(CASES, 3))
def test_a_descending_range_gives_the_same_from_the_other_end(case):
    name, parameter, ends, settings, expected = CASES[case]
    model, x = mbstab.load(name), np.linspace(*ends, 37)
    up, down = (model.sweep(parameter, values, **settings) for values in (x, x[::-1].copy()))
    check(down.critical, expected)
    assert np.array_equal(down.values, x[::-1])
    assert np.array_equal(down.branches, up.branches[::-1])
    assert np.array_equal(down.unstable, up.unstable[::-1])


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("case", "number"), sample([(case, i) for case in CASES for i in range(len(CASES[case][-1]))], 2)
)
def test_a_critical_value_on_a_point_of_the_grid(case, number):
    name, parameter, ends, settings, expected = CASES[case]
    value = expected[number][0]
    grid = np.unique(np.append(np.linspace(*ends, 18), value))
    result = mbstab.load(name).sweep(parameter, grid, **settings)
    check(result.critical, expected)
    # The point itself is undecided, or rounding has put it on one side; ranges beside it are what they are.
    k = int(np.flatnonzero(grid == value)[0])
    assert result.verdicts[k] in {OPEN, *WORDS_OF[case][number : number + 2]}
    assert result.verdicts[k - 1 : k + 2 : 2] == list(WORDS_OF[case][number : number + 2])


def ranges_that_end_at_a_critical_value():
    for case, (_, _, ends, _, expected) in CASES.items():
        for value, *_ in expected:
            yield case, (ends[0], value)
            yield case, (value, ends[1])


@pytest.mark.few(3)
@pytest.mark.parametrize(("case", "ends"), sample(ranges_that_end_at_a_critical_value(), 5))
def test_a_critical_value_at_an_end_is_exact_or_not_there(case, ends):
    name, parameter, _, settings, expected = CASES[case]
    found = mbstab.load(name).sweep(parameter, np.linspace(*ends, 41), **settings).critical
    there = [(value, kind) for value, kind, *_ in expected if ends[0] <= value <= ends[1]]
    inside = [(value, kind) for value, kind in there if ends[0] < value < ends[1]]
    for c in found:
        assert [kind for value, kind in there if abs(c.value - value) <= 1e-11 * value] == [c.kind]
    for value, kind in inside:
        assert [c.kind for c in found if abs(c.value - value) <= 1e-11 * value] == [kind]


def test_a_value_at_which_two_things_happen_and_others_at_its_sides():
    sweep_of = mbstab.load("ziegler_column.yaml").sweep
    result = sweep_of("P", np.linspace(0.0, 6.0, 301), meetings=True, b_1=0, b_2=0)
    assert {kind for _, kind in result.meetings} == {"collide"}
    for value in (3.5 - SQRT2, 3.5 + SQRT2):
        assert min(abs(at - value) for at, _ in result.meetings) < 1e-10
    assert [set(result.unstable[(result.values > a) & (result.values < b)]) for a, b in
            ((0, 3.5 - SQRT2), (3.5 - SQRT2, 3.5 + SQRT2), (3.5 + SQRT2, 6))] == [{0}, {2}, {2}]  # fmt: skip


def test_a_logarithmic_grid():
    values = sweep_values(mbstab.load("whipple_bicycle.yaml").model, "v", "1", "20", 30, logarithmic=True)
    assert np.allclose(values[1:] / values[:-1], values[1] / values[0], rtol=1e-14)
    check(mbstab.load("whipple_bicycle.yaml").sweep("v", values).critical, CASES["bicycle"][-1])


def test_a_region_between_two_points_is_found():
    # Stable only between 0.3 and 0.7: no point of the grid lies there.
    check(mbstab.load("shimmy.yaml").sweep("a", np.array([0.1, 0.2, 0.8, 0.9])).critical, CASES["shimmy"][-1])


def test_the_branches_of_a_collision_are_named():
    result = mbstab.load("ziegler_column.yaml").sweep("P", np.linspace(0.0, 3.0, 31), b_1=0, b_2=0)
    assert len(result.critical[0].branches) == 2


@pytest.mark.parametrize("points", [11, 401])
def test_both_branches_of_a_collision_are_named(points):
    assert len(mbstab.load("top.yaml").sweep("omega", np.linspace(0.0, 10.0, points)).critical[0].branches) == 2


# --- branches are the eigenvalues -----------------------------------------------------------------------------------


GALLERY = [(f"{name}.yaml", parameter) for name, data in documents().items() for parameter in data.get("sweep", ())]


@pytest.mark.few(1)
@pytest.mark.parametrize(("name", "parameter"), sample([*GALLERY[1:], GALLERY[0]], 6))
def test_branches_are_what_eig_says_at_the_same_point(name, parameter):
    mechanism = mbstab.load(name)
    model = mechanism.model
    default = sweep_values(model, parameter)
    rng = np.random.default_rng(len(name))
    x = np.sort(rng.uniform(default.min(), default.max(), 24))
    result = mechanism.sweep(parameter, x, si=True)
    answered = [i for i in range(len(x)) if i not in result.problems]
    assert len(answered) >= 8
    for i in rng.choice(answered, 3, replace=False):
        eig = mechanism.eig(**{parameter: x[i] / model.parameters[parameter].factor})
        values = np.array([e.value for e in eig.eigenvalues if e.kind != "neutral"])
        # What is zero all along, but only by a family of motions that was followed, is a branch of a sweep.
        more = eig.counts.neutral - result.neutral
        zero = np.flatnonzero(result.branches[i] == 0.0)[:more]
        assert len(zero) == more
        others = np.delete(result.branches[i], zero)
        assert len(values) == len(others)
        assert optimal(values, others) <= 1e-9 * np.max(np.abs(values), initial=1e-300)
        assert result.verdicts[i] in STRENGTH[eig.verdict]
        unstable = sum(
            e.kind in ("unstable node", "unstable focus", "saddle") and e.value.real > 0 for e in eig.eigenvalues
        )
        assert result.unstable[i] == (-1 if result.verdicts[i] == OPEN else unstable)
    for i in list(result.problems)[:1]:
        assert np.all(np.isnan(result.branches[i]))
        assert result.unstable[i] == -1


def rows_that_differ(mechanism, parameter, low, high, **settings):
    """Return how many common points of a coarse and a fine sweep have columns in another order."""
    x = np.linspace(low, high, 4001)
    coarse = mechanism.sweep(parameter, x[::10], **settings).branches
    fine = mechanism.sweep(parameter, x, **settings).branches[::10]
    assert coarse.shape == fine.shape
    return swaps(coarse, fine)


@pytest.mark.parametrize(
    ("parameter", "low", "high"),
    sample(
        [("v", 0, 10), ("w", 0.8, 1.3), ("c", -0.2, 0.3), ("tilt", 0.05, 0.7), ("x_B", 0.1, 0.6), ("z_B", 0.5, 1.2)],
        every=6,
    ),
)
def test_branches_of_the_bicycle_are_the_same_on_a_finer_grid(parameter, low, high):
    speed = float(np.random.default_rng(len(parameter) + int(10 * high)).uniform(0.5, 9.0))
    settings = {} if parameter == "v" else {"v": speed}
    assert rows_that_differ(mbstab.load("whipple_bicycle.yaml"), parameter, low, high, **settings) == 0


# To shift paths of bicycles until eigenvalues only just avoid each other takes longer than all else.
@pytest.mark.long
@pytest.mark.parametrize(("part", "bicycles"), sample([(1, 0), *((part, 10) for part in range(6))], 7))
def test_no_branches_are_swapped_on_random_paths_through_avoided_crossings(part, bicycles):
    rng = np.random.default_rng(part)
    s = np.linspace(0.0, 1.0, 1001)
    passed = 0
    found = bicycle_paths(rng, bicycles) if bicycles else []
    for text in [*found, *(chain_path(rng) for _ in range(3))]:
        fine, coarse = (mbstab.loads(text).sweep("s", x).branches for x in (s, s[::100]))
        passed += bool(avoided(fine))
        assert swaps(coarse, fine[::100]) == 0
    assert passed >= 2


@pytest.mark.long
@pytest.mark.parametrize("seed", sample(range(12), 12))
def test_frequencies_of_undamped_chains_keep_their_order(seed):
    text = chain_path(np.random.default_rng(seed), damping=0.0)
    result = mbstab.loads(text).sweep("s", np.linspace(0.0, 1.0, 11), meetings=True)
    frequencies = np.abs(result.branches.imag)
    assert result.meetings == ()
    assert np.all(np.diff(frequencies[:, np.argsort(frequencies[0])], axis=1) >= -1e-9 * np.max(frequencies))


# --- meetings -------------------------------------------------------------------------------------------------------


OSCILLATORS = """\
mbstab: 1
parameters: {k: 1, e: 0, m: 1, d: 0}
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
      a.x: -k*a.x - e*(a.x - b.x) - d*rate(a.x)
      b.x: -b.x - e*(b.x - a.x)
reference:
  coordinates:
    a: {x: 0, y: 0}
    b: {x: 0, y: 0}
"""


def ends_of(result):
    """Return |Im| of every branch at both ends, sorted."""
    return np.array(sorted(map(tuple, np.abs(result.branches.imag[[0, -1]]).T)))


@pytest.mark.parametrize(("e", "points"), sample(product([1e-1, 1e-3, 1e-5, 1e-7], [5, 22, 401]), 4))
def test_frequencies_that_avoid_each_other_do_not_cross(e, points):
    x = np.linspace(0.5, 2.0, points)
    result = mbstab.loads(OSCILLATORS).sweep("k", x, meetings=True, e=e)
    assert result.meetings == ()
    assert result.critical == ()
    half = (x + 1) / 2 + e
    root = np.sqrt(((x - 1) / 2) ** 2 + e**2)
    lower, upper = np.sqrt(half - root), np.sqrt(half + root)
    found = np.abs(result.branches.imag)
    order = np.argsort(found[0])
    assert np.allclose(found[:, order], np.column_stack([lower, lower, upper, upper]), rtol=1e-12)


@pytest.mark.parametrize("seed", sample(range(4), 4))
def test_frequencies_of_uncoupled_oscillators_cross(seed):
    rng = np.random.default_rng(seed)
    bad, kinds = 0, []
    for _ in range(4):
        low, high = float(rng.uniform(0.3, 0.9)), float(rng.uniform(1.1, 2.5))
        result = mbstab.loads(OSCILLATORS).sweep("k", np.linspace(low, high, int(rng.integers(5, 60))), meetings=True)
        expected = [[math.sqrt(low), math.sqrt(high)]] * 2 + [[1.0, 1.0]] * 2
        bad += not np.allclose(ends_of(result), expected, rtol=1e-9)
        kinds += [(kind, abs(at - 1.0) < 1e-9) for at, kind in result.meetings]
    assert bad == 0
    assert kinds == [("cross", True)] * 8  # above and below the real axis


def test_every_row_of_oscillators_that_cross_is_right_as_a_set():
    x = np.linspace(0.5, 2.0, 37)
    result = mbstab.loads(OSCILLATORS).sweep("k", x)
    for k, row in zip(x, result.branches, strict=True):
        assert optimal(row, [1j, -1j, 1j * math.sqrt(k), -1j * math.sqrt(k)]) < 1e-14


def test_a_collision_at_a_point_of_the_grid_is_one_collision():
    result = mbstab.load("top.yaml").sweep("omega", np.linspace(0.0, 2 * TOP, 101), meetings=True)
    assert result.meetings == ((result.meetings[0][0], "collide"),) * 2  # above and below the real axis


ROLLING_BALL = """
mbstab: 1
parameters: {h: 0.01, R: 0.05, n: 10}
gravity: [0, 0, -9.81]
bodies:
  ball: {type: spatial, mass: 0.5, inertia: [5e-4, 5e-4, 6e-4], points: {O: [0, 0, -h]}}
contacts:
  roll: {type: ellipsoid, center: ball.O, a: R, b: R, c: R}
reference:
  coordinates: {ball: {x: 0, y: 0, z: R+h, phi: 0, theta: 0, psi: 0}}
  rates: {ball: {psi: n}}
"""


def test_collisions_have_krein_signatures_in_hamiltonian_systems_only():
    top = mbstab.load("top.yaml").sweep("omega", np.linspace(0.0, 10.0, 41))
    assert [(c.kind, sorted(c.signatures)) for c in top.critical] == [("collision", [-1, 1])]
    # A body that rolls is not Hamiltonian: energies of its modes have equal signs, and they leave the axis.
    ball = mbstab.loads(ROLLING_BALL).sweep("n", np.linspace(5.0, 15.0, 21))
    assert [(c.kind, c.signatures) for c in ball.critical] == [("collision", None)]


def test_springs_that_become_repulsive():
    for points in (30, 31):
        critical = mbstab.loads(OSCILLATORS).sweep("k", np.linspace(-1.0, 2.0, points)).critical
        assert [(c.kind, c.unstable) for c in critical] == [("divergence", (1, 0))]
        assert abs(critical[0].value) < 1e-13


def test_two_pairs_pass_the_axis_at_the_same_value():
    critical = mbstab.loads(OSCILLATORS).sweep("d", np.linspace(-1.0, 1.0, 30), e=0.3).critical
    assert [c.kind for c in critical] == ["flutter", "flutter"]
    assert all(abs(c.value) < 1e-14 and c.unstable == (4, 0) for c in critical)
    frequencies = np.sort([c.frequency for c in critical])
    assert np.allclose(frequencies, np.sqrt([1.0, 1.6]), rtol=1e-9)


# --- points without an answer ---------------------------------------------------------------------------------------


TRUSS = "von_mises_truss.yaml"


def snap(a=1.0, h=0.5, k=100.0):
    """Return the load at which the toggle snaps: P(y) = 2 k y (L_0/L − 1) is greatest where L³ = L_0 a²."""
    rest = math.hypot(a, h)
    length = (rest * a**2) ** (1 / 3)
    return 2 * k * math.sqrt(length**2 - a**2) * (rest / length - 1)


def squares_of_truss(load, start, a=1.0, h=0.5, k=100.0):
    """Return s² of the truss, up and down and sideways, where Newton's method finds its apex."""
    rest, y = math.hypot(a, h), start
    for _ in range(60):
        length = math.hypot(a, y)
        slope = 2 * k * (1 - rest * a**2 / length**3)
        y -= (2 * k * y * (1 - rest / length) + load) / slope
    return np.array([-slope, -2 * k * (1 - rest * y**2 / math.hypot(a, y) ** 3)], dtype=complex)


@pytest.mark.few(1)
@pytest.mark.parametrize(("points", "sign"), sample(product([12, 101], [1.0, -1.0]), 3))
def test_a_truss_is_followed_through_both_of_its_folds(points, sign):
    # Without a load it stands; under one it falls back past the flat position, and hangs.
    values = sign * np.linspace(-10.0, 10.0, points)
    result = mbstab.load(TRUSS).sweep("P", values)
    assert [c.kind for path in (result, *result.beyond) for c in path.critical] == ["fold", "fold"]
    for path, at in zip((result, *result.beyond), (snap(), -snap(), None), strict=True):
        assert [abs(c.value - at) <= 1e-13 * snap() for c in path.critical] == ([True] if at is not None else [])
    assert [path.start for path in (result, *result.beyond)] == pytest.approx([0.0, snap(), -snap()])
    stands, falls, hangs = (result, *result.beyond)
    assert np.array_equal(falls.values, values[np.abs(values) < snap()])
    assert np.array_equal(hangs.values, values[values > -snap()])
    lost = values > snap()
    assert set(stands.problems) == set(np.flatnonzero(lost))
    assert all(f"no solution beyond P = {snap():.6g}"[:-2] in text for text in stands.problems.values())
    assert not falls.problems
    assert not hangs.problems
    for path, start, unstable in ((stands, 0.7, 0), (falls, 0.0, 1), (hangs, -0.7, 0)):
        known = path.unstable >= 0
        assert set(path.unstable[known]) == {unstable}
        for load, row in zip(path.values[known], path.branches[known], strict=True):
            exact = np.sqrt(squares_of_truss(load, start))
            # Next to a fold a root of a small difference.
            assert optimal(row, [*exact, *-exact]) < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("points", [12, 101])
def test_the_count_before_a_fold_is_that_of_the_side_that_has_one(points):
    (critical,) = mbstab.load(TRUSS).sweep("P", np.linspace(0.0, 10.0, points)).critical
    assert critical.unstable == (0, -1)
    (critical,) = mbstab.load(TRUSS).sweep("P", np.linspace(10.0, -10.0, points), y=-0.5).critical  # it hangs
    assert critical.unstable == (-1, 0)


TURNED = """\
mbstab: 1
parameters: {T: 0, m: 1, L: 0.5, k: 0}
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: m, inertia: 0.1, points: {O: [0, L]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
forces:
  drive: {type: torque, body: rod, value: T}
  wound: {type: expression, on: {rod.theta: -k*rod.theta}}
reference:
  find: equilibrium
  guess: {rod: {theta: 0}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("first", sample([1.0, 6.0, -6.0], 2))
def test_a_path_that_closes_after_a_whole_turn_is_followed_once(first):
    # T = m g L sin(theta): stable below the pivot, unstable above it, and then the same again.
    values = np.sign(first) * np.linspace(-6.0, 6.0, 25) if abs(first) > 2 else np.linspace(1.0, 6.0, 11)
    result = mbstab.loads(TURNED).sweep("T", values)
    hanging, standing = (result, *result.beyond)
    top = 9.81 * 0.5
    folds = [c.value for path in (hanging, standing) for c in path.critical]
    assert set(np.round(folds, 10)) == ({top, -top} if abs(first) > 2 else {top})
    assert set(hanging.unstable[hanging.unstable >= 0]) == {0}
    assert set(standing.unstable) == {1}
    for path, sign in ((hanging, -1.0), (standing, 1.0)):
        known = path.unstable >= 0
        square = sign * np.sqrt(top**2 - path.values[known] ** 2) / (0.1 + 0.25)
        assert np.allclose(path.branches[known] ** 2, square[:, None], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("allowed", sample([3, REFERENCE.folds_of_path], 2))
def test_a_path_through_more_folds_than_are_followed_says_so(allowed, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.reference.tolerances.Tolerances.folds_of_path", allowed)
    # A spiral spring lets the rod wind up turn by turn: T = m g L sin(theta) + k theta.
    result = mbstab.loads(TURNED).sweep("T", np.linspace(-6.0, 6.0, 13), k=1e-3)
    assert len(result.beyond) == 2 * allowed  # to both sides
    assert [c.kind for c in result.beyond[-1].critical] == ["unresolved"]


CUBIC = """\
mbstab: 1
parameters: {mu: 0, x0: 1}
bodies:
  p: {type: planar_point, mass: 1}
constraints:
  rail: {holonomic: p.y}
forces:
  f: {type: expression, on: {p.x: LOAD - 0.2*rate(p.x)}}
reference:
  find: equilibrium
  coordinates: {p: {y: 0}}
  guess: {p: {x: x0}}
"""


def cubic(load, mu=0):
    return mbstab.loads(CUBIC.replace("LOAD", load).replace("{mu: 0", f"{{mu: {mu}"))


@pytest.mark.long
@pytest.mark.parametrize(("start", "stop", "points"), sample([(1.7, -2.1, 20), (2, -2, 41), (2, -2, 101)], 3))
def test_the_other_path_through_a_pitchfork_is_followed(start, stop, points):
    result = cubic("mu*p.x - p.x**3", start).sweep("mu", np.linspace(start, stop, points))
    assert [c.kind for c in result.critical] == ["branch point"]
    assert abs(result.critical[0].value) < 1e-10
    mirror, straight = result.beyond
    assert set(mirror.unstable) <= {0}
    assert mirror.critical == ()  # the solution is followed as near to its turn as it is asked for
    assert np.array_equal(straight.values, result.values)
    assert [(c.kind, c.unstable) for c in straight.critical] == [("divergence", (0, 1))]
    assert result.unanswered == []


@pytest.mark.few(1)
@pytest.mark.parametrize(("x0", "points"), sample([(2.0, 5), (2.0, 23), (-2.0, 22), (-2.0, 101)], 2))
def test_an_exchange_of_stability_along_a_path_is_found(x0, points):
    # x = 0 and x**2 - 0.3*x - mu = 0 cross at mu = 0; the second folds at mu = -0.0225.
    result = cubic("mu*p.x + 0.3*p.x**2 - p.x**3", 2).sweep("mu", np.linspace(2.0, -2.0, points), x0=x0)
    paths = (result, *result.beyond)
    found = [(c.kind, c.branching) for path in paths for c in path.critical]
    assert sorted(found) == [("divergence", True), ("divergence", True), ("fold", False)]
    for path in paths:
        trivial = not np.nanmax(np.abs(path.reference["p.x"])) > 1e-12
        for c in path.critical:
            assert abs(c.value - (-0.0225 if c.kind == "fold" else 0.0)) < 1e-12
            passing = (0, 1) if trivial else (1, 0)
            assert c.unstable == (passing if c.kind == "divergence" else (-1, int(path.start == 2.0 and x0 < 0.0)))


def test_a_path_between_two_branch_points_is_followed_once():
    """From x = 0, x² = 1 − mu² branches off at mu = −1 and leads back to it at mu = 1."""
    result = cubic("p.x*(p.x**2 + mu**2 - 1)").sweep("mu", np.linspace(-2.0, 2.0, 9), x0=0.0)
    assert [c.value for c in result.critical] == pytest.approx([-1.0, 1.0])
    assert [c.branching for c in result.critical] == [True, True]
    assert len(result.beyond) == 2
    for path in result.beyond:
        assert {c.kind for c in path.critical} <= {"branch point"}
        np.testing.assert_allclose(path.reference["p.x"] ** 2, 1.0 - path.values**2, atol=1e-9)
        assert set(path.unstable.tolist()) == {1}
    assert result.beyond[0].reference["p.x"][1] == -result.beyond[1].reference["p.x"][1]


@pytest.mark.long
def test_a_fold_and_a_crossing_close_to_each_other():
    result = cubic("mu*p.x + 0.3*p.x**2 - p.x**3", 0.06).sweep("mu", np.linspace(0.06, -0.05, 12), x0=-0.2)
    assert [(c.kind, c.unstable) for c in result.critical] == [("fold", (-1, 1)), ("divergence", (1, 0))]
    assert [abs(c.value - at) < 1e-12 for c, at in zip(result.critical, (-0.0225, 0.0), strict=True)] == [True] * 2


def test_no_crossing_is_looked_for_where_nothing_crosses(monkeypatch):
    looked = []
    monkeypatch.setattr(continuation._Curve, "_cross", lambda self, run, *ends: looked.append(ends))
    result = mbstab.load("flyball_governor.yaml").sweep("L", [0.9, 1.0])
    assert result.problems == {}
    assert looked == []


@pytest.mark.long
def test_a_path_goes_on_beyond_a_kink():
    result = cubic("abs(mu) - p.x").sweep("mu", np.linspace(-2.0, 2.0, 41), x0=0)
    assert result.critical == ()
    assert result.problems == {}


def test_a_model_that_is_not_valid_beyond_a_value_loses_no_equilibrium_there():
    text = CUBIC.replace("LOAD", "mu*p.x - p.x**3").replace("mass: 1", "mass: 1 - mu")
    result = mbstab.loads(text).sweep("mu", np.linspace(0.5, 1.5, 11))
    assert result.critical == ()
    assert result.problems.pop(5) == "1 finite eigenvalue exists here, elsewhere 2"  # without mass, by its damping
    assert all("mass must not be negative" in message for message in result.problems.values())
    assert [int(n) for n in result.unstable] == [0] * 5 + [-1] * 6


@pytest.mark.long
def test_a_mode_is_not_mistaken_for_another_one_on_a_coarse_grid():
    text = OSCILLATORS.replace("- d*rate(a.x)", "+ sin(50*d)*rate(a.x)").replace(
        "b.x: -b.x", "b.x: -b.x - 0.2*rate(b.x)"
    )
    critical = mbstab.loads(text).sweep("d", np.linspace(-2.0, 2.0, 9)).critical
    assert critical
    for c in critical:
        assert abs(c.value * 50 / math.pi - round(c.value * 50 / math.pi)) < 1e-9


def test_a_fold_on_a_point_of_the_grid_counts_for_neither_side():
    # mu = x**2, and a second mass that loses its stiffness at mu = 0.0025.
    text = CUBIC.replace("LOAD", "mu - p.x**2").replace("rail:", "side: {holonomic: s.y}\n  rail:")
    text = text.replace("bodies:\n", "bodies:\n  s: {type: planar_point, mass: 1}\n")
    text = text.replace("on: {p.x", "on: {s.x: -s.x*(p.x**2 - 0.0025) - 0.2*rate(s.x), p.x")
    text = text.replace("{p: {y: 0}}", "{p: {y: 0}, s: {x: 0, y: 0}}")
    result = mbstab.loads(text).sweep("mu", np.linspace(2.0, -2.0, 41))
    (second,) = result.beyond
    assert [(c.kind, c.unstable) for c in result.critical] == [("fold", (-1, 1)), ("divergence", (1, 0))]
    assert [(c.kind, c.unstable) for c in second.critical] == [("divergence", (2, 1))]
    for path in (result, second):
        assert abs(path.critical[-1].value - 0.0025) < 1e-13
    assert 0.0 not in second.values


@pytest.mark.parametrize("largest", sample([1e8, 1e6, 1e9, 1e12], 3))
def test_a_range_of_many_magnitudes(largest):
    found = mbstab.load("top.yaml").sweep("omega", np.linspace(0.0, largest, 5)).critical
    assert [(c.kind, c.unstable) for c in found] == [("collision", (2, 0))]
    assert abs(found[0].value - TOP) < 1e-11 * TOP


def test_a_window_between_points_may_be_missed_and_the_text_says_on_how_many_they_rest():
    """Damping 1 − 2 exp(−((k − 0.53)/0.003)²) is negative within 0.0025 of 0.53: the grid decides what is seen."""
    damping = "(1 - 2*exp(-((k - 0.53)/0.003)**2))"
    model = mbstab.loads(
        "mbstab: 1\nparameters: {k: 0}\nbodies: {p: {type: planar_point, mass: 1}}\n"
        f"forces: {{f: {{type: expression, on: {{p.x: -p.x - {damping}*rate(p.x), p.y: -p.y - rate(p.y)}}}}}}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    )
    seen, missed = (str(model.sweep("k", np.linspace(a, 1.0, 11))) for a in (0.06, 0.0))
    assert "0.527502 to 0.532498: unstable (2)" in seen
    assert "  0 to 1: asymptotically stable\n(as 11 points show: what is narrower than their distance" in missed
    alone = str(model.sweep("k", np.array([0.53])))
    assert "at 0.53: unstable (2)" in alone
    assert "show" not in alone


def test_points_without_an_answer_are_not_called_stable():
    result = run("pendulum.yaml", "--param", "m", "--from", -1, "--to", 1, "--points", 5, "--plot", "none")
    assert "0.5 to 1: stable" in result.stdout
    assert "-1 to" not in result.stdout.replace("from -1 to", "")
    result = run("pendulum.yaml", "--param", "m", "--from", -3, "--to", -1, "--points", 4, "--plot", "none")
    assert "stable" not in result.stdout
    assert result.exit_code == 1


@pytest.mark.long
def test_a_path_that_turns_back_at_a_pitchfork_names_it():
    text = (Path(__file__).parents[1] / "models" / "bead_on_hoop.yaml").read_text(encoding="utf-8")
    text = text.replace("theta: {value: 0,", "theta: {value: 1,").replace("Omega: {value: 4,", "Omega: {value: 8,")
    result = mbstab.loads(text).sweep("Omega", np.linspace(8.0, 0.0, 33))
    (critical,) = result.critical
    assert critical.kind == "branch point"
    assert abs(critical.value - HOOP) < 1e-11 * HOOP
    # Beyond it the bead is on the other side of the hoop.
    other, bottom = result.beyond
    assert np.allclose(other.branches, result.branches[: len(other.values)], rtol=1e-9)
    # The bottom, which loses stability there, is answered on its own path.
    assert np.array_equal(bottom.values, result.values)
    assert [(c.kind, c.unstable, c.branching) for c in bottom.critical] == [("divergence", (0, 1), True)]
    assert abs(bottom.critical[0].value - HOOP) < 1e-11 * HOOP
    assert result.unanswered == []


ALL_PATHS = (TRUSS, "--param", "P", "--points", 21)


@pytest.mark.long
def test_all_paths_are_in_json():
    data = json.loads(run(*ALL_PATHS, "--format", "json").stdout)
    assert [len(path["values"]) for path in (data, *data["beyond"])] == [21, 9, 15]
    assert [path["start"] for path in (data, *data["beyond"])] == pytest.approx([0.0, snap(), -snap()])


@pytest.mark.long
def test_all_paths_are_in_every_output(tmp_path):
    arguments = ALL_PATHS
    rows = list(csv.reader(io.StringIO(run(*arguments, "--format", "csv").stdout)))
    assert [row[-2] for row in rows] == ["path", *["1"] * 21, *["2"] * 9, *["3"] * 15]
    printed = run(*arguments, "--plot", "none", "--output", tmp_path / "P.npz")
    with np.load(tmp_path / "P.npz") as arrays:
        assert [int(n) for n in arrays["path"]] == [int(row[-2]) for row in rows[1:]]
        assert np.allclose(arrays["values"], [float(row[0]) for row in rows[1:]])
        assert arrays["branches"].shape == (45, 4)
        assert arrays["critical_kind"].tolist() == ["fold", "fold"]
    text = printed.stdout
    assert printed.exit_code == 0  # values without an equilibrium on the first path have one on the third
    assert "6 points without an answer:\n  at 6 values from 5 to 10: no solution beyond P = 4.29143257312 N on" in text
    assert "path 2, beyond the turn at P = 4.29143, 9 points" in text
    assert "path 3, beyond the turn at P = -4.29143, 15 points" in text
    assert "-4.29143 to 4.29143: unstable (1)" in text


def test_points_with_a_negative_mass_have_no_answer_and_the_others_have():
    x = np.linspace(-1.0, 2.0, 31)
    result = mbstab.loads(OSCILLATORS).sweep("m", x, k=3)
    bad = x <= 0.0
    assert set(result.problems) == set(np.flatnonzero(bad))
    assert result.problems.pop(10) == "2 finite eigenvalues exist here, elsewhere 4"  # the spring alone holds it
    assert all("mass must not be negative" in text for text in result.problems.values())
    assert np.array_equal(result.unstable, np.where(bad, -1, 0))
    for m, row in zip(x[~bad], result.branches[~bad], strict=True):
        assert optimal(row, [1j, -1j, 1j * math.sqrt(3 / m), -1j * math.sqrt(3 / m)]) < 1e-12


@pytest.mark.parametrize("points", [2, 5, 31])
def test_no_point_has_an_answer(points):
    result = mbstab.loads(OSCILLATORS).sweep("m", np.linspace(-2.0, -1.0, points), k=3)
    assert len(result.problems) == points
    assert result.critical == ()


# --- what cannot be asked -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"parameter": "omga"}, "did you mean 'omega'"),
        ({"start": 1, "stop": 1}, "empty"),
        ({"start": 0, "logarithmic": True}, "--log needs positive ends"),
        ({"start": -1, "stop": 1, "logarithmic": True}, "--log needs positive ends"),
        ({"values": "1,3,2"}, "ascending or descending"),
        ({"values": "1,1"}, "ascending or descending"),
        ({"values": "5"}, "at least two"),
        ({"values": "1,x"}, "unknown parameter 'x'"),
        ({"values": "1,2", "start": 1}, "leave out"),
        ({"parameter": "H"}, "no sweep: block for H"),
    ],
)
def test_a_range_that_cannot_be(arguments, message):
    model = mbstab.load("top.yaml").model
    with pytest.raises(UsageError, match=message):
        sweep_values(model, **{"parameter": "omega", **arguments})


def test_values_are_taken_in_the_unit_of_the_parameter():
    model = mbstab.loads(OSCILLATORS.replace("k: 1,", "k: {value: 1, unit: N/mm},")).model
    assert np.array_equal(sweep_values(model, "k", values="1,2"), [1000.0, 2000.0])
    assert np.array_equal(sweep_values(model, "k", 3, 1, 3), [3000.0, 2000.0, 1000.0])


def test_a_reversed_range_descends_and_one_that_turns_back_is_refused():
    assert np.array_equal(sweep_values(mbstab.load("top.yaml").model, "omega", 4, 1, 4), [4, 3, 2, 1])
    for values in ([0.0, 2.0, 1.0], [0.0, 0.0, 1.0]):
        with pytest.raises(UsageError, match="ascend or descend"):
            mbstab.load("top.yaml").sweep("omega", np.array(values))


def test_a_parameter_that_is_swept_and_set():
    with pytest.raises(UsageError, match="swept and set"):
        mbstab.load("top.yaml").sweep("omega", np.array([0.0, 1.0]), omega=1)


# --- command line ---------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["sweep", *map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("--param", "omga"), "did you mean 'omega'"),
        (("--param", "omega", "--log"), "--log needs positive ends"),
        (("--param", "omega", "--resume"), "--output"),
        (("--param", "omega", "--format", "npz"), "is binary: name a file with --output"),
        (("--param", "omega", "--param", "omega"), "given twice"),
        (("--param", "omega", "--set", "omega=3"), "swept and set"),
        (("--param", "omega,l", "--from", "1,2"), "hint: --param omega --param l"),
        (("--param", "omega", "--from", "1", "--from", "2"), "is given 2 times for 1 parameter: once for each"),
    ],
)
def test_the_command_line_is_wrong(arguments, hint):
    result = run("top.yaml", *arguments, "--plot", "none")
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stdout == ""


def test_json_has_the_keys_scripts_rely_on():
    result = run("whipple_bicycle.yaml", "--param", "v", "--points", 23, "--format", "json")
    data = json.loads(result.stdout)
    assert result.exit_code == 0
    assert data["parameter"] == "v"
    assert data["unit"] == "m/s"
    assert data["neutral"] == 6
    assert data["values"] == np.linspace(0, 10, 23).tolist()
    assert [len(branch[part]) for branch in data["branches"] for part in ("real", "imag")] == [23] * 8
    assert [(c["kind"], c["unstable_below"], c["unstable_above"]) for c in data["critical"]] == [
        ("flutter", 2, 0),
        ("divergence", 0, 1),
    ]
    for c, value in zip(data["critical"], (WEAVE, CAPSIZE), strict=True):
        assert abs(c["value"] - value) < 1e-11 * value
        assert c["branch"]
        assert all(b in range(1, 5) for b in c["branch"])
    assert data["problems"] == []


def test_a_parameter_with_a_unit_is_written_in_it(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(OSCILLATORS.replace("k: 1,", "k: {value: 1, unit: N/mm},"), encoding="utf-8")
    data = json.loads(run(path, "--param", "k", "--from", -1, "--to", 2, "--points", 30, "--format", "json").stdout)
    assert data["values"] == pytest.approx(np.linspace(-1, 2, 30).tolist())
    assert data["unit"] == "N/mm"
    assert abs(data["critical"][0]["value"]) < 1e-13


def test_csv_has_a_line_for_each_value_and_npz_the_arrays(tmp_path):
    result = run("top.yaml", "--param", "omega", "--points", 7, "--format", "csv")
    rows = list(csv.reader(io.StringIO(result.stdout)))
    assert rows[0][:5] == ["omega (rad/s)", "unstable", "verdict", "real 1 (1/s)", "imag 1 (1/s)"]
    assert rows[0][-1] == "status"
    assert len(rows) == 8
    assert {len(row) for row in rows} == {3 + 8 + 2}
    place = tmp_path / "top.npz"
    run("top.yaml", "--param", "omega", "--points", 7, "--plot", "none", "--output", place)
    with np.load(place) as data:
        keys = {"parameter", "values", "branches", "unstable", "verdicts", "path", "critical", "critical_kind", "names"}
        keys |= {"reference", "reference_names", "outputs", "output_names"}
        assert set(data) == keys
        assert data["verdicts"].tolist() == [line[2] for line in rows[1:]]
        assert data["parameter"] == "omega"
        assert data["critical_kind"].tolist() == ["collision"]
        assert data["branches"].shape == (7, 4)
        for row, line in zip(data["branches"], rows[1:], strict=True):
            assert [float(x) for x in line[3:-2]] == [part for s in row for part in (s.real, s.imag)]
        assert data["unstable"].tolist() == [int(line[1]) for line in rows[1:]]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["top.npz"]


@pytest.mark.parametrize("points", sample([7, 31], 2))
def test_missing_points_give_exit_code_1_and_the_others(tmp_path, points):
    path = tmp_path / "model.yaml"
    path.write_text(OSCILLATORS, encoding="utf-8")
    arguments = (path, "--param", "m", "--from", -1, "--to", 2, "--points", points)
    for format_ in ("json", "csv", "table"):
        result = run(*arguments, "--format", format_, "--plot", "none")
        assert result.exit_code == 1
        assert f"of {points} points have no answer" in result.stderr
        assert result.stdout
    data = json.loads(run(*arguments, "--format", "json").stdout)
    bad = np.linspace(-1, 2, points) <= 0.0
    assert [p["point"] for p in data["problems"]] == np.flatnonzero(bad).tolist()
    assert [n is None for n in data["unstable"]] == bad.tolist()
    assert all([x is None for x in branch["real"]] == bad.tolist() for branch in data["branches"])
    rows = list(csv.reader(io.StringIO(run(*arguments, "--format", "csv").stdout)))[1:]
    assert [row[-1] != "ok" for row in rows] == bad.tolist()
    assert [row[1] == "" and set(row[3:-2:2]) == {""} for row in rows] == bad.tolist()


@pytest.mark.parametrize("format_", ["csv", "json"])
def test_missing_eigenvalues_have_no_imaginary_part(tmp_path, format_):
    path = tmp_path / "model.yaml"
    path.write_text(OSCILLATORS, encoding="utf-8")
    result = run(path, "--param", "m", "--from", -1, "--to", 2, "--points", 7, "--format", format_)
    if format_ == "csv":
        row = list(csv.reader(io.StringIO(result.stdout)))[1]
        assert set(row[3:-2]) == {""}
    else:
        assert all(branch["imag"][0] is None for branch in json.loads(result.stdout)["branches"])


def test_a_periodic_motion_is_not_swept():
    with pytest.raises(UsageError, match="periodic"):
        sweep.sweep(mbstab.load("kapitza.yaml").model, "nu", np.linspace(90.0, 100.0, 5))


def test_a_path_between_two_points_of_the_grid_is_listed_with_its_fold():
    # mu + x - x**3: the middle path lies within ±0.3849.
    result = cubic("mu + p.x - p.x**3").sweep("mu", np.array([-2.0, 2.0]), x0=-1.5)
    assert [[c.kind for c in path.critical] for path in (result, *result.beyond)] == [["fold"], ["fold"], []]
    assert [len(path.values) for path in (result, *result.beyond)] == [2, 0, 1]
    assert abs(result.critical[0].value - 2.0 / (3.0 * math.sqrt(3.0))) < 1e-13


HIDDEN = """
mbstab: 1
parameters: {k: 1e15, weak: -1}
bodies:
  a: {type: planar_point, mass: 1}
  b: {type: planar_point, mass: 1}
constraints:
  rail_a: {holonomic: a.y}
  rail_b: {holonomic: b.y}
forces:
  weak: {type: expression, on: {a.x: -weak*(a.x - 1)}}
  stiff: {type: spring, between: [a, b], stiffness: k, length: 1, damping: 0}
reference:
  coordinates:
    a: {x: 1, y: 0}
    b: {x: 2, y: 0}
"""


def test_zeros_that_nothing_explains_are_undecided():
    # Beside 1e15 N/m rounding hides a spring of -1 N/m; without it the zeros are those of a shift.
    hidden = mbstab.loads(HIDDEN).sweep("k", np.linspace(0.9e15, 1e15, 5))
    assert hidden.verdicts == [OPEN] * 5
    assert set(hidden.unstable) == {-1}
    seen = mbstab.loads(HIDDEN).sweep("k", np.linspace(0.9e3, 1e3, 5))
    assert seen.verdicts == [U] * 5
    assert set(seen.unstable) == {1}
    free = mbstab.loads(HIDDEN).sweep("k", np.linspace(0.9e15, 1e15, 5), weak=0)
    assert free.verdicts == ["stable up to symmetry"] * 5
    assert set(free.unstable) == {0}
    assert free.neutral == 2


# --- slow beside fast -----------------------------------------------------------------------------------------------


PLANE = """
mbstab: 1
parameters: {e: 1e-6, K: 1, c: 0}
bodies:
  p: {type: planar_point, mass: 1}
forces:
  push:
    type: expression
    on:
      p.x: PUSH
      p.y: -K*p.y - c*rate(p.y)
reference:
  coordinates: {p: {x: 0, y: 0}}
"""


@pytest.mark.parametrize("points", sample([7, 41], 2))
@pytest.mark.parametrize(
    ("push", "settings", "rate"),
    [
        ("e*p.x", {}, 1e-3),  # a stiffness alone: counted by its sign
        ("e*p.x - 1e-3*rate(p.x)", {"c": 1}, 6.1803398874989e-4),  # damped: nothing mirrors the spectrum
        ("e*p.x + 0*rate(p.x)", {"c": 1e-9}, 1e-3),
    ],
)
def test_a_slow_growth_beside_a_stiff_spring_is_seen(push, settings, rate, points):
    result = mbstab.loads(PLANE.replace("PUSH", push)).sweep("K", np.geomspace(1.0, 1e10, points), **settings)
    assert result.verdicts == [U] * points
    assert result.critical == ()
    assert set(result.unstable) == {1}
    assert np.allclose(np.max(result.branches.real, axis=1), rate, rtol=1e-9)


def test_a_slow_decay_beside_a_stiff_spring_is_seen():
    text = PLANE.replace("PUSH", "-1e-6*p.x - 1e-4*rate(p.x)")
    result = mbstab.loads(text).sweep("K", np.geomspace(1.0, 1e12, 25), c=1e-3)
    assert set(result.verdicts) == {AS}
    assert result.critical == ()


def test_where_a_slow_growth_ends_is_found_beside_a_stiff_spring():
    text = PLANE.replace("PUSH", "-(K - 3)*1e-9*p.x").replace("-K*p.y", "-1e10*p.y")
    (critical,) = mbstab.loads(text).sweep("K", np.linspace(1.0, 6.0, 12)).critical
    assert (critical.kind, critical.unstable) == ("divergence", (1, 0))
    # Points that are judged one by one have coarser bounds of rounding for the energy than all together.
    assert critical.verdicts in ((U, "stable"), (U, "marginally stable"))
    assert abs(critical.value - 3.0) < 1e-11


def test_damping_that_is_rounding_is_not_read_off():
    # x'' = -x + 1e-18 x': unstable, but no float knows.
    text = PLANE.replace("PUSH", "-p.x + 1e-18*rate(p.x)")
    result = mbstab.loads(text).sweep("K", np.linspace(2.0, 3.0, 9))
    assert set(result.verdicts) == {OPEN}
    assert set(result.unstable) == {-1}
    assert result.critical == ()


# --- kinds of verdicts ----------------------------------------------------------------------------------------------


def test_words_change_with_the_evidence_and_are_no_critical_values(tmp_path):
    # The energy in the turning frame has no minimum any more from omega = 1 on, and gyroscopic terms hold the mass.
    text = """
mbstab: 1
parameters: {w: 0.5}
bodies:
  p: {type: planar_point, mass: 1}
forces:
  all:
    type: expression
    on:
      p.x: (w**2 - 1)*p.x + 2*w*rate(p.y)
      p.y: (w**2 - 1)*p.y - 2*w*rate(p.x)
reference:
  coordinates: {p: {x: 0, y: 0}}
"""
    result = mbstab.loads(text).sweep("w", np.linspace(0.5, 1.6, 12))
    assert result.critical == ()
    # At 1 the mass goes round in circles of any size and place.
    assert result.verdicts == ["stable"] * 5 + ["stable up to symmetry"] + [M] * 6
    assert set(result.unstable) == {0}
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    printed = run(path, "--param", "w", "--from", 0.5, "--to", 1.6, "--points", 12, "--plot", "none").stdout
    assert "  0.5 to 1: stable\n  at 1: stable up to symmetry\n  1 to 1.6: marginally stable\n" in printed
    assert "does not change" not in printed


@pytest.mark.long
def test_a_symmetry_at_single_values_does_not_make_others_symmetric():
    # At s = 0 the scene is blind to a shift; the cubic push elsewhere is seen by no linear equation.
    text = PLANE.replace("PUSH", "K*p.x**3 - rate(p.x)").replace("-K*p.y", "-p.y")
    result = mbstab.loads(text).sweep("K", np.linspace(-1.0, 1.0, 21), c=1)
    # x'' = K x³ − x': whether it returns is up to the cubic term.
    assert result.verdicts == [AS] * 10 + ["asymptotically stable up to symmetry"] + [U] * 10


def test_laws_that_contain_the_time_are_no_verdict():
    text = PLANE.replace("PUSH", "-p.x - 0.1*rate(p.x) + p.x*tanh(t - 50)")
    result = mbstab.loads(text).sweep("K", np.linspace(1.0, 2.0, 5), c=1)
    assert result.verdicts == [OPEN] * 5
    assert all("tanh" in reason or "time" in reason for reason in result.problems.values())


def test_a_kink_is_no_verdict():
    text = PLANE.replace("PUSH", "-p.x*abs(p.x) - abs(p.x) - rate(p.x)")
    result = mbstab.loads(text).sweep("K", np.linspace(1.0, 2.0, 5), c=1)
    assert result.verdicts == [OPEN] * 5


@pytest.mark.parametrize("points", [3, 33])
def test_a_top_with_free_spin_is_stable_by_a_multiple_of_its_momentum(points):
    text = (Path(__file__).parents[1] / "models" / "top.yaml").read_text(encoding="utf-8")
    a, b = text.index("drives:"), text.index("reference:")
    result = mbstab.loads(text[:a] + text[b : text.index("expect:")]).sweep("omega", np.linspace(5.8, 12.0, points))
    assert set(result.verdicts) == {"stable up to symmetry"}


# --- where refinement ends ------------------------------------------------------------------------------------------


def test_refinement_ends_within_its_budget_and_says_so(monkeypatch):
    budget = "mbstab.analysis.sweep.tolerances.Tolerances.branch_points"
    monkeypatch.setattr(budget, 10)
    text = OSCILLATORS.replace("- d*rate(a.x)", "+ sin(50*d)*rate(a.x)")
    result = mbstab.loads(text).sweep("d", np.linspace(-2.0, 2.0, 9), meetings=True, e=0.3)
    (warning,) = result.warnings
    assert "refinement" in warning
    monkeypatch.setattr(budget, 100)
    assert mbstab.loads(OSCILLATORS).sweep("k", np.linspace(0.5, 2.0, 9), e=0.1).warnings == ()


def test_a_range_of_twenty_magnitudes_ends(monkeypatch):
    looked = []
    near = batched_spectra.Evaluator.near

    def counted(self, values, *arguments):
        looked.append(len(next(iter(values.values()))))
        return near(self, values, *arguments)

    monkeypatch.setattr(batched_spectra.Evaluator, "near", counted)
    result = mbstab.load("wheelset_no_slip.yaml").sweep("gamma", np.linspace(1e20, 100.0, 9))
    assert sum(looked) < 1.2 * SWEEP.branch_points
    assert set(result.verdicts) == {"stable up to symmetry"}
    assert result.critical == ()


# --- next to the axis -----------------------------------------------------------------------------------------------


def oscillators(first, second):
    """Return the text of two points on lines."""
    return (
        "mbstab: 1\nparameters: {p: 0}\n"
        "bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}\n"
        "constraints: {c: {holonomic: a.y}, d: {holonomic: b.y}}\n"
        f"forces: {{f: {{type: expression, on: {{a.x: {first!r}, b.x: {second!r}}}}}}}\n"
        "reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}\n"
    )


@pytest.mark.parametrize(
    ("damping", "growing", "spaced"), sample(product(["1e-3", "1e-4", "1e-6", "1e-8"], [0, 1], ["even", "log"]), 5)
)
def test_a_pair_that_meets_beside_the_axis_is_a_divergence(damping, growing, spaced):
    other = "1000*b.x - 0.1*rate(b.x)" if growing else "-3*b.x - 0.2*rate(b.x)"
    values = np.linspace(0.0, 3.0, 31) if spaced == "even" else np.geomspace(1e-3, 1e5, 21)
    # One real eigenvalue passes zero at 1.037, where stiffness vanishes, whatever the damping.
    text = oscillators(f"-(1.037 - p)*a.x - {damping}*rate(a.x)", other)
    (critical,) = mbstab.loads(text).sweep("p", values).critical
    assert (critical.kind, critical.unstable) == ("divergence", (growing, growing + 1))
    assert critical.value == pytest.approx(1.037, rel=1e-9)


def test_a_start_where_two_equilibria_meet_is_unstable():
    # V' = (1 + x)(2x² − p): at p = 2 two of them meet at x = −1, where the force 4 (1 + x)² drives the motion away.
    text = """
mbstab: 1
parameters: {p: 2}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {c: {holonomic: b.y}}
forces: {f: {type: expression, on: {b.x: -(1 + b.x)*(2*b.x**2 - p) - 0.5*rate(b.x)}}}
reference: {find: equilibrium, coordinates: {b: {y: 0}}, guess: {b: {x: 0.1}}}
"""
    result = mbstab.loads(text).sweep("p", np.linspace(2.0, -2.0, 9))
    at = int(np.argmax(result.values))
    assert result.verdicts[at] == "unstable"


@pytest.mark.long
def test_what_is_singular_to_twelve_digits_is_no_symmetry_of_a_sweep():
    text = oscillators("-a.x + 0.73245191834*b.x - rate(a.x)", "a.x - (0.732451918338 - p)*b.x - rate(b.x)")
    model, values = mbstab.loads(text), np.linspace(-1e-11, 1e-11, 21)
    result = model.sweep("p", values)
    for p, verdict in zip(values.tolist(), result.verdicts, strict=True):
        # det K = (0.732451918338 − p) − 0.73245191834, and at its zero the shift is a symmetry to rounding.
        if abs(p + 2e-12) < 1e-18:
            continue
        assert verdict in ("undecided", "unstable" if p > -2e-12 else "asymptotically stable")
    assert result.verdicts[0] == "asymptotically stable"
    assert result.verdicts[-1] == "unstable"


@pytest.mark.parametrize("values", sample([[-60.0, 60.0], [-40.0, 40.0], [-90.0, -15.0, 60.0]], 3))
def test_what_happens_in_the_middle_of_a_coarse_sweep_is_seen(values):
    # A rotor with damping inside (1) and outside (2), k = 100: stable for |W| < 10 (1 + 2/1).
    text = """
mbstab: 1
parameters: {W: 5}
bodies: {disk: {type: planar_point, mass: 1}}
forces:
  f:
    type: expression
    on:
      disk.x: -100*disk.x - 3*rate(disk.x) - W*disk.y
      disk.y: -100*disk.y - 3*rate(disk.y) + W*disk.x
reference: {coordinates: {disk: {x: 0, y: 0}}}
"""
    result = mbstab.loads(text).sweep("W", np.array(values))
    assert [c.unstable for c in result.critical] == [(2, 0), (0, 2)]
    assert [c.value for c in result.critical] == pytest.approx([-30.0, 30.0], rel=1e-9)


# --- ends of the range, poles, limits -------------------------------------------------------------------------------


@pytest.mark.parametrize(("first", "last", "ends"), [(0.1, 0.3, [0.3]), (0.7, 0.3, [0.3, 0.7]), (0.2, 0.7, [0.3, 0.7])])
def test_a_critical_value_on_an_end_of_the_range_is_one(first, last, ends):
    result = mbstab.load("shimmy.yaml").sweep("a", np.linspace(first, last, 6))
    assert [c.kind for c in result.critical] == ["flutter"] * len(ends)
    assert [c.value for c in result.critical] == pytest.approx(ends, abs=1e-13)
    assert all(sorted(c.unstable) == [0, 2] for c in result.critical)
    text = run("shimmy.yaml", "--param", "a", "--from", first, "--to", last, "--points", 6, "--plot", "none").stdout
    assert re.findall("at (.*): undecided", text) == [f"{x:g}" for x in (ends if first < last else ends[::-1])]
    assert "unstable (2)" in text or min(first, last) >= 0.3


def test_no_end_of_the_range_is_critical_where_nothing_changes_there():
    result = mbstab.load("shimmy.yaml").sweep("a", np.linspace(0.3001, 0.6999, 6))
    assert result.critical == ()


@pytest.mark.long
@pytest.mark.parametrize("first", sample([-0.4, 0.0], 2))
def test_a_zero_that_nonlinear_terms_decide_is_decided_as_by_eig(first):
    # The pin above the wheel: any angle of the trailer goes on, and carries it across like t.
    shimmy, at = mbstab.load("shimmy.yaml"), ("shimmy.yaml", "--param", "l", "--from", first, "--to", 0.4)
    result = shimmy.sweep("l", np.linspace(first, 0.4, 5))
    here = result.verdicts[result.values.tolist().index(0.0)]
    assert here == shimmy.eig(l=0).verdict == "asymptotically stable up to symmetry"
    assert [(c.kind, c.unstable) for c in result.critical] == [("divergence", (1, 2))]
    assert abs(result.critical[0].value) < 1e-15
    assert f"at 0: {here}\n" in run(*at, "--points", 5, "--plot", "none").stdout


@pytest.mark.long
def test_zeros_along_a_whole_sweep_are_decided_at_every_point():
    # s'' = −2 s' − K s³
    text = PLANE.replace("PUSH", "-K*p.x**3 - 2*rate(p.x)").replace("-K*p.y", "-p.y")
    result = mbstab.loads(text).sweep("K", np.linspace(-1.0, 1.0, 12), c=1)
    assert result.verdicts == [U] * 6 + [AS] * 6
    # No eigenvalue passes the axis: the change is bisected.
    (change,) = result.critical
    assert (change.kind, change.unstable) == ("unresolved", (0, 0))
    assert abs(change.value) < 1e-7


def test_zeros_at_too_many_points_are_left_open_at_all_of_them(monkeypatch):
    text = PLANE.replace("PUSH", "-K*p.x**3 - 2*rate(p.x)").replace("-K*p.y", "-p.y")
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.points_asked_for_zeros", 11)
    assert set(mbstab.loads(text).sweep("K", np.linspace(-1.0, 1.0, 12), c=1).verdicts) == {OPEN}


ARM = """
mbstab: 1
parameters: {k: 100, L: 1, Omega: 5}
bodies:
  arm: {type: spatial, mass: 1, inertia: [1, 1, 1]}
  bead: {type: point, mass: 1}
joints:
  bearing: {type: revolute, between: [arm, ground], axis: z}
  plane: {type: point_on_plane, between: [arm, bead], axis: y}
  level: {type: point_on_plane, between: [arm, bead], axis: z}
forces: {spring: {type: spring, between: [bead, arm], stiffness: k, length: L}}
drives: {spin: {type: joint, joint: bearing, position: Omega*t}}
reference:
  find: steady
  steady: {axis: z, rate: Omega}
  coordinates:
    arm: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}
    bead: {y: 0, z: 0}
  guess: {bead: {x: L}}
"""


@pytest.mark.long
@pytest.mark.parametrize(("parameter", "first", "last", "pole"), sample([("Omega", 5, 15, 10), ("k", 100, 10, 25)], 2))
def test_at_a_pole_of_the_equilibrium_nothing_else_is_said(parameter, first, last, pole):
    # x = k·L/(k − Ω²)
    result = mbstab.loads(ARM).sweep(parameter, np.linspace(first, last, 14))
    assert [(c.kind, c.branching) for c in result.critical] == [("loss of equilibrium", False)]
    assert result.critical[0].value == pytest.approx(pole, abs=1e-8)
    assert result.beyond == ()
    assert all((x > pole) == (last > pole) for x in result.values[list(result.problems)])
    assert all("bead.x grows beyond all bounds" in text for text in result.problems.values())
    answered = [i for i in range(14) if i not in result.problems]
    assert all((x < pole) == (last > pole) for x in result.values[answered])


def test_a_pole_beyond_the_range_is_no_loss_of_equilibrium():
    # x = 1/k, infinite at zero, which is no value of the sweep
    text = (
        "mbstab: 1\nparameters: {k: 1}\nbodies:\n  a: {type: planar_point, mass: 1}\n"
        "constraints:\n  rail: {holonomic: a.y}\nforces:\n  spring: {type: expression, on: {a.x: 1 - k*a.x}}\n"
        "reference:\n  find: equilibrium\n  guess: {a: {x: 1, y: 0}}\n"
    )
    result = mbstab.loads(text).sweep("k", np.geomspace(1.0, 1e-5, 15))
    assert result.critical == ()
    assert not any("no solution beyond" in text for text in result.problems.values())


def test_every_value_without_an_answer_is_listed_with_others_of_its_cause():
    result = run("free_rigid_body.yaml", "--param", "I2", "--from", 1.2, "--to", 2.8, "--points", 9, "--plot", "none")
    text = " ".join(result.stdout.split())
    assert "4 points without an answer: at 4 values from 1.2 to 1.8:" in text
    assert text.count("impossible inertia") == 1


def test_a_search_that_is_too_long_ends_and_says_where(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.branch_looks", 1)
    result = mbstab.load("whipple_bicycle.yaml").sweep("v", np.linspace(0.0, 10.0, 11), meetings=True)
    assert len(result.values) == 11
    assert "the refinement between points ended" in result.warnings[0]
    assert "between v = " in result.warnings[0]


def test_a_path_that_is_too_long_ends_without_a_verdict_on_its_end(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.reference.smooth.SmoothSolutions.surface", lambda *given: None)  # step by step
    monkeypatch.setattr("mbstab.analysis.reference.tolerances.Tolerances.path_evaluated_numbers", 12)
    monkeypatch.setattr("mbstab.analysis.reference.tolerances.Tolerances.path_evaluations", 12)
    result = mbstab.load("rotating_pendulum.yaml").sweep("Omega", np.linspace(5.0, 20.0, 9))
    assert [c.kind for c in result.critical] == ["unresolved"]
    assert any("not followed further" in text for text in result.problems.values())


@pytest.mark.long
def test_options_are_lists_or_repeated(tmp_path):
    ends = ("--from", "0,0.1", "--to", "8,0.6", "--points", "5,4")
    again = ("--from", "0", "--from", "0.1", "--to", "8", "--to", "0.6", "--points", 5, "--points", 4)
    names = ("rolling_disk.yaml", "--param", "omega", "--param", "R", "--plot", "none", "--format", "csv")
    assert run(*names, *ends).stdout == run(*names, *again).stdout != ""
    run("top.yaml", "--param", "omega", "--points", 5, "--plot", "map,locus", "--output", tmp_path / "t.csv")
    assert sorted(x.name for x in tmp_path.iterdir()) == ["t-locus.png", "t-map.png", "t.csv"]
    assert run("top.yaml", "--param", "omega", "--plot", "map,none").exit_code == 2
    assert run("top.yaml", "--param", "omega", "--points", "5,x").exit_code == 2
    single = ("top.yaml", "--param", "omega", "--from", "atan2(1, 2)", "--to", 5, "--points", 3, "--format", "csv")
    assert run(*single).stdout.splitlines()[1].startswith("0.46")


PUSHED = """
mbstab: 1
parameters: {e: {value: 0.1}, D: {value: 0}}
bodies: {p: {type: planar_point, mass: 1}}
forces:
  push: {type: expression, on: {p.x: -p.x - D*rate(p.x) + c*p.y, p.y: -p.y - c*p.x + r*rate(p.y)}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""
CIRCULATORY = PUSHED.replace("c*", "e*").replace("r*", "0*")
EXCITED = PUSHED.replace("c*", "0*").replace("r*", "e*")


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("text", "damping", "values"),
    sample(
        [
            (text, damping, values)
            for text, damping in [(CIRCULATORY, 0.0), (EXCITED, 0.0), (EXCITED, 1e4)]
            for values in [(0.0, 1.0), (1.0, 0.0), (0.0, 1e-3), (0.0, 0.5, 1.0)]
        ],
        every=3,
    ),
)
def test_what_holds_at_a_special_value_is_not_carried_to_others(text, damping, values):
    result = mbstab.loads(text).sweep("e", list(values), D=damping)
    for value, word, count in zip(values, result.verdicts, result.unstable, strict=True):
        assert (word, count) == ("unstable", 2) if value else word != "unstable"
    assert all(abs(c.value) < 1e-11 for c in result.critical)


def test_parts_are_gone_when_the_file_is_written_but_the_terminal_fails(tmp_path):
    command = [sys.executable, "-m", "mbstab", "sweep", "top.yaml", "--param", "omega", "--points", "3"]
    command += ["--plot", "none", "-o", str(tmp_path / "t.csv")]
    with open("/dev/full", "w") as full:
        assert subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True).returncode == 1
    assert [x.name for x in tmp_path.iterdir()] == ["t.csv"]


def test_branches_that_pass_the_axis_together_are_one_event():
    text = PLANE.replace("PUSH", "-rate(p.x) - e*p.x").replace("-K*p.y - c*rate(p.y)", "-2*rate(p.y) - e*p.y")
    result = mbstab.loads(text).sweep("e", np.linspace(-1.0, 1.0, 41))
    (critical,) = result.critical
    assert (critical.value, critical.kind, critical.unstable) == (0.0, "divergence", (2, 0))
    assert len(critical.branches) == 2


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "parameter", "ends", "kind", "unstable", "value"),
    [
        ("whipple_bicycle.yaml", "v", (3.9, 4.9), "flutter", (2, 0), 4.29238253634111),
        ("whipple_bicycle.yaml", "v", (5.5, 6.5), "divergence", (0, 1), 6.02426201538837),
        ("top.yaml", "omega", (5.2, 6.1), "collision", (2, 0), None),
    ],
)
def test_a_change_of_stability_is_told_whatever_the_search_for_branches_has_spent(
    monkeypatch, name, parameter, ends, kind, unstable, value
):
    model, grid = mbstab.load(name), np.linspace(*ends, 4)
    (sure,) = model.sweep(parameter, grid).critical
    monkeypatch.setattr(Branches, "budget", 0)
    (found,) = model.sweep(parameter, grid).critical
    assert (found.kind, found.unstable, found.verdicts) == (kind, unstable, sure.verdicts)
    assert found.value == pytest.approx(value or sure.value, rel=1e-12)
    assert found.frequency == pytest.approx(sure.frequency, rel=1e-9, abs=1e-12)


def test_a_critical_value_on_a_point_is_found_once():
    """An integral that takes no part at zero gain: the zero there is explained, on both sides it has a side."""
    text = (
        "mbstab: 1\nparameters: {k: 1}\nbodies: {p: {type: planar_point, mass: 1}}\n"
        "constraints: {rail: {holonomic: p.y}}\nstates: {z: {rate: p.x}}\n"
        "forces: {spring: {type: expression, on: {p.x: -p.x - rate(p.x) - k*z}}}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    )
    for points in (41, 40):
        (found,) = mbstab.loads(text).sweep("k", np.linspace(-0.5, 0.5, points)).critical
        assert (found.kind, found.unstable) == ("divergence", (1, 0))
        assert abs(found.value) < 1e-12


@pytest.mark.few(2)
@pytest.mark.parametrize("other", ["-a.y**3 - rate(a.y)", "-9*a.y - rate(a.y)**3", "-rate(a.y)**3"])
@pytest.mark.parametrize("points", [2, 5, 40])
def test_an_eigenvalue_that_passes_zero_beside_an_open_one_is_found(other, points):
    """Unstable on both sides: two eigenvalues grow always, one more for negative p; another one is on the axis."""
    text = (
        "mbstab: 1\nparameters: {p: 1}\n"
        "bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}\n"
        "constraints: {rail: {holonomic: b.y}}\nforces:\n"
        f"  f: {{type: expression, on: {{a.x: -a.x + 0.1*rate(a.x), a.y: {other}, b.x: -p*b.x - rate(b.x)}}}}\n"
        "reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}\n"
    )
    (found,) = mbstab.loads(text).sweep("p", np.linspace(-1.0, 1.0, points)).critical
    assert (found.kind, found.unstable) == ("divergence", (3, 2))
    assert abs(found.value) < 1e-12


BALANCE = next(x.text for x in SYSTEMS if x.name == "Roberval balance, tilted")


@pytest.mark.long
@pytest.mark.parametrize("points", [2, 3, 5])
@pytest.mark.parametrize("parameter", ["dummy", "a"])
def test_a_stiffness_that_is_the_sum_of_large_terms_is_zero_to_their_rounding(parameter, points):
    """Reactions of 10 N m cancel in it, at any angle: what is left is no stiffness."""
    found = mbstab.loads(BALANCE).sweep(parameter, np.linspace(0.1, 0.6, points))
    assert set(found.verdicts) <= {"stable up to symmetry", "undecided"}
    assert not found.critical


@pytest.mark.parametrize("k", [1e-17, 1e-3, -1e-17, -1e-3])
def test_what_is_left_of_large_terms_is_judged_as_alone(k):
    text = BALANCE.replace(
        "\nreference:",
        f"""
forces:
  law: {{type: expression, on: {{upper.theta: '-({k})*(upper.theta - a)'}}}}
reference:""",
    )
    model = mbstab.loads(text)
    found = model.sweep("dummy", np.linspace(0.1, 0.6, 5))
    alone = model.eig().verdict
    allowed = {"stable" if k > 0 else "unstable", "undecided"}
    assert alone in allowed
    assert set(found.verdicts) <= allowed
    assert abs(k) < 1e-9 or set(found.verdicts) == {alone} != {"undecided"}


# --- several pairs that cross at one value --------------------------------------------------------------------------


def lagging(inertias):
    """Discs, each held by a PD controller with lag: T J s³ + J s² + D s + P has ω² = D/(T J) at P = D/T."""
    lines = ["mbstab: 1", "parameters: {P: {value: 1000, unit: N*m/rad}, D: 10, T: 0.005}", "bodies:"]
    lines += [f"  b{n}: {{type: planar, mass: 1, inertia: {J}}}" for n, J in enumerate(inertias)]
    lines += ["joints:", *(f"  j{n}: {{type: revolute, between: [b{n}, ground]}}" for n in range(len(inertias)))]
    lines += ["forces:"]
    lines += [f"  c{n}: {{type: pid, joint: j{n}, of: angle(j{n}), P: P, D: D, lag: T}}" for n in range(len(inertias))]
    return "\n".join([*lines, "reference: {coordinates: {b0: {theta: 0}}}", ""])


@pytest.mark.parametrize("inertias", [(0.03,), (0.03, 0.05), (0.02, 0.05, 0.3)])
@pytest.mark.parametrize(
    "values", [(1900, 2000, 2100), np.linspace(10, 5000, 30), (1900, 1934, 2101), (1999.9, 2000.1)]
)
def test_every_pair_that_crosses_at_a_value_is_named(tmp_path, inertias, values):
    path = tmp_path / "discs.yaml"
    path.write_text(lagging(inertias))
    found = mbstab.load(path).sweep("P", np.asarray(values, dtype=float)).critical
    roots = [np.roots([0.005 * J, J, 10.0, 2000.0]) for J in inertias]
    expected = sorted(float(z.imag.max()) for z in roots)
    np.testing.assert_allclose([c.value for c in found], 2000.0, rtol=1e-9)
    np.testing.assert_allclose(sorted(c.frequency for c in found), expected, rtol=1e-9)
    assert {(c.kind, c.unstable) for c in found} == {("flutter", (0, 2 * len(inertias)))}


def test_the_table_has_the_order_that_was_asked_for():
    """From high to low speeds: what happens on the way down, and the verdicts in between."""
    model = mbstab.load("whipple_bicycle.yaml")
    rising, falling = (str(model.sweep("v", np.linspace(*ends, 15))) for ends in ((1, 8), (8, 1)))
    found = re.findall(r"([\d.]+)  (divergence|flutter) .*?(\d → \d)", falling)
    assert [row[1:] for row in found] == [("divergence", "1 → 0"), ("flutter", "0 → 2")]
    assert [float(row[0]) for row in found] == pytest.approx([CAPSIZE, WEAVE], rel=1e-12)
    ranges = re.findall(r"^  ([\d.]+) to ([\d.]+): (.*)$", rising, flags=re.M)
    assert re.findall(r"^  ([\d.]+) to ([\d.]+): (.*)$", falling, flags=re.M) == [(b, a, c) for a, b, c in ranges[::-1]]
    assert len(ranges) == 3
