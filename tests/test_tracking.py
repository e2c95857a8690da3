"""Functions of spectra on constructed ones, pairing against SciPy's, zeros of hard functions against Brent's method."""

import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import brentq, linear_sum_assignment

import mbstab
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.roots import Search
from mbstab.analysis.sweep.batched_verdict import eigenvalues, placed
from mbstab.analysis.sweep.spectra import WORD, pinned, settled, signs, unplaced, unstable_counts
from mbstab.analysis.sweep.tolerances import TOLERANCES as SWEEP
from mbstab.analysis.sweep.tracking import (
    continuous,
    discriminant,
    doubtful,
    follow,
    product,
    squares,
    symmetric_product,
)
from mbstab.analysis.verdict.minimum import inertia
from mbstab.analysis.verdict.rule import AXIS, LEFT, MARGINAL, OPEN, RIGHT, STABLE, UNDECIDED, UNSTABLE


def spectrum(*values):
    return np.array(values, dtype=complex)


def quadruple(s):
    return [s, s.conjugate(), -s, -s.conjugate()]


# --- sides of the axis ----------------------------------------------------------------------------------------------


def matrix(values, turn=0.0, seed=0):
    """Return a real matrix with given eigenvalues, in a basis that is orthonormal but for a part."""
    blocks = []
    for s in values:
        if np.imag(s) > 0.0:
            blocks.append(np.array([[np.real(s), np.imag(s)], [-np.imag(s), np.real(s)]]))
        elif np.imag(s) == 0.0:
            blocks.append(np.array([[np.real(s)]]))
    A = block_diag(*blocks)
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=A.shape))[0] + turn * rng.normal(size=A.shape)
    return Q @ A @ np.linalg.inv(Q)


def sides_of(values, error=1e-14, mirrored=False, **changes):
    """Return the sides in the order of decreasing real part."""
    A = matrix(values, **changes)[None]
    found, sides = placed(A, np.array([error * np.linalg.norm(A)]), mirrored)
    return sides[0, np.argsort(-found[0].real, kind="stable")].tolist()


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_eigenvalues_are_placed_in_any_unit(size, turn):
    cases = [
        ([-1.0, -2.0, 1e-3, -3.0], [RIGHT, LEFT, LEFT, LEFT]),
        ([0.1 + 1j, 0.1 - 1j, -0.1 + 2j, -0.1 - 2j], [RIGHT, RIGHT, LEFT, LEFT]),
        ([5.0], [RIGHT]),
        ([-1e-9 + 1j, -1e-9 - 1j], [LEFT, LEFT]),
    ]
    for values, expected in cases:
        assert sides_of(size * spectrum(*values), turn=turn) == expected


def test_what_is_within_its_bound_is_not_placed():
    for values in ([1e-15, -1.0, -2.0], [1e-15 + 1j, 1e-15 - 1j, -3.0], [0.0, -1.0]):
        found = sides_of(spectrum(*values))
        assert OPEN in found
        assert RIGHT not in found
    assert sides_of(spectrum(1e-12, -1.0, -2.0), error=1e-16)[0] == RIGHT


def test_a_slow_eigenvalue_beside_a_fast_one_is_not_compared_with_it():
    # 1e-3 beside 1e9: 1e-12 of the largest.
    assert sides_of(spectrum(1e-3, -1.0, -1e9), error=1e-17)[0] != LEFT
    values, sides = placed(np.diag([1e-3, -1.0, -1e9])[None], np.array([1e-8]), False)
    assert dict(zip(values[0].tolist(), sides[0].tolist(), strict=True)) == {1e-3: RIGHT, -1.0: LEFT, -1e9: LEFT}


def test_only_structure_and_isolation_hold_a_pair_on_the_axis():
    axis = [1j, -1j, 2j, -2j]
    assert set(sides_of(spectrum(*axis))) == {OPEN}
    assert set(sides_of(spectrum(*axis), mirrored=True)) == {AXIS}
    # Two pairs that cannot be told apart may leave it.
    near = spectrum(1j, -1j, 1j * (1 + 1e-14), -1j * (1 + 1e-14))
    assert set(sides_of(near, mirrored=True)) == {OPEN}
    assert set(sides_of(spectrum(1e-16, -1e-16), error=1.0, mirrored=True)) == {OPEN}
    # Far from it nothing has to be held.
    quadruple = spectrum(0.1 + 1j, 0.1 - 1j, -0.1 + 1j, -0.1 - 1j)
    assert sides_of(quadruple, mirrored=True) == [RIGHT, RIGHT, LEFT, LEFT]


def test_a_double_eigenvalue_with_two_vectors_is_placed_by_them_and_a_defective_one_is_left_open():
    assert sides_of(spectrum(-1.0, -1.0, 2.0, 2.0), turn=0.2) == [RIGHT, RIGHT, LEFT, LEFT]
    A = np.array([[[-1.0, 1.0], [0.0, -1.0]]])
    assert set(placed(A, np.array([1e-16]), False)[1][0].tolist()) == {OPEN}


def test_bounds_hold_against_random_disturbances():
    rng = np.random.default_rng(7)
    for seed in range(60):
        values = rng.normal(size=3) * 10.0 ** rng.integers(-6, 1, 3)
        A = matrix(spectrum(*values), turn=0.5, seed=seed)[None]
        E = rng.normal(size=A.shape)
        E *= 1e-9 * np.linalg.norm(A) / np.linalg.norm(E)
        error = np.array([np.linalg.norm(E)])
        there = np.sort(np.linalg.eigvals(A + E)[0].real)
        _, sides = placed(A, error, False)
        assert np.sum(sides == RIGHT) <= np.sum(there > 0.0)
        assert np.sum(sides == LEFT) <= np.sum(there < 0.0)


def test_slow_eigenvalues_beside_fast_ones_have_their_digits():
    for slow in (1e-3, 1e-1):
        A = np.array([[0.0, 1e8, 0.0], [-1e8, 0.0, 1e8], [0.0, slow / 1e8, slow]])[None]
        exact = slow * (1.0 + 0.0)
        found = eigenvalues(A)[0]
        assert abs(found[np.argmin(np.abs(found))].real - exact) < 1e-6 * slow + 1e-12


@pytest.mark.parametrize("grade", [1.0, 1e5, 1e12])
def test_the_inertia_of_stiffness_is_counted_however_graded_it_is(grade):
    rng = np.random.default_rng(3)
    scale = np.array([1.0, grade, 1.0, grade**0.5])
    for signs_ in ([1, 1, 1, 1], [1, -1, 1, -1], [-1, 1, 1, 1]):
        L = np.tril(0.3 * rng.normal(size=(4, 4)), -1) + np.eye(4)
        H = L @ np.diag(signs_) @ L.T * scale * scale[:, None]
        known = 1e-15 * np.abs(H)
        positive, negative, doubtful = inertia(H[None], known[None])[0]
        assert (positive, negative, doubtful) == (signs_.count(1), signs_.count(-1), 0)
    zero = np.diag([1.0, grade, 0.0])[None]
    assert inertia(zero, 1e-15 * np.abs(zero) + 1e-16)[0].tolist() == [2, 0, 1]
    assert inertia(np.zeros((2, 0, 0)), np.zeros((2, 0, 0))).tolist() == [[0, 0, 0]] * 2


def test_unstable_eigenvalues_are_counted_where_the_verdict_is_not_open():
    sides = np.array([[RIGHT, LEFT], [RIGHT, OPEN], [LEFT, OPEN], [AXIS, AXIS], [OPEN, OPEN]], dtype=np.int8)
    words = np.array([WORD[x] for x in (UNSTABLE, UNSTABLE, UNDECIDED, MARGINAL, STABLE)], dtype=np.int8)
    assert unstable_counts(sides, words).tolist() == [1, 1, -1, 0, 0]
    assert settled(sides, words, 0).tolist() == [1, -1, -1, 0, 0]
    assert settled(sides, words, 1).tolist() == [1, 1, 0, 0, 0]
    assert unplaced(sides[1:3], words[1:3], {}) == 1
    assert unplaced(sides, words, {}) == 0
    assert signs(sides).tolist() == [[1, -1], [1, 0], [-1, 0], [0, 0], [0, 0]]


SINGULAR = """
mbstab: 1
parameters: {s: 0.7}
bodies: {p: {type: planar_point, mass: 1}}
forces:
  f:
    type: expression
    on:
      p.x: -p.x - s*p.y - rate(p.x) - 2*rate(p.y)
      p.y: -s*p.x - s**2*p.y - 2*rate(p.x) - s**2*rate(p.y)
reference: {coordinates: {p: {x: 0, y: 0}}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize(("low", "high"), [(-2, 2), (-2, 0), (-2, -1), (-1.9, 1), (0, 2), (0.5, 2.5)])
@pytest.mark.parametrize("points", [5, 9, 17])
def test_a_zero_at_all_points_hides_no_change_beside_it(low, high, points):
    """The stiffness is singular for all s; at s = 0 the damping is as well, which is no rule for the others."""
    truth = {-1.764878249016: (0, 2), 0.0: (2, 1), 2.0: (1, 0)}
    found = {c.value: c.unstable for c in mbstab.loads(SINGULAR).sweep("s", np.linspace(low, high, points)).critical}
    expected = {s: unstable for s, unstable in truth.items() if low + 1e-6 < s < high - 1e-6}
    inner = {s: unstable for s, unstable in found.items() if low + 1e-6 < s < high - 1e-6}
    assert list(inner) == pytest.approx(list(expected), abs=1e-9)
    assert list(inner.values()) == list(expected.values())


def test_a_change_of_the_verdict_between_points_is_never_without_a_value(monkeypatch):
    for module in ("branches", "critical_values"):
        monkeypatch.setattr(f"mbstab.analysis.sweep.{module}.settled", lambda sides, *_: np.full(len(sides), -1))
    (found,) = mbstab.loads(SINGULAR).sweep("s", np.linspace(-2.0, -1.0, 5)).critical
    assert (found.kind, found.unstable) == ("flutter", (0, 2))
    assert abs(found.value + 1.764878249016) < 1e-6


def test_zeros_that_nothing_explains_are_shown_as_such():
    values = np.array([spectrum(1e-7, -1e-7, 1j, -1j), spectrum(1e-3, -1e-3, 1j, -1j)])
    sides = np.array([[OPEN, OPEN, AXIS, AXIS]] * 2, dtype=np.int8)
    shown = pinned(values, sides, np.ones(2), 2)
    assert shown[0].tolist() == [0, 0, 1j, -1j]
    assert np.array_equal(shown[1], values[1])
    assert np.array_equal(pinned(values, sides, np.ones(2), 0), values)


# --- functions that vanish ------------------------------------------------------------------------------------------


def test_the_product_changes_its_sign_where_a_real_eigenvalue_passes_zero():
    def at(x):
        return product(spectrum(x, -2.0, -0.5 + 3j, -0.5 - 3j), 4.0)

    assert at(0.0) == 0.0
    assert at(1e-9) * at(-1e-9) < 0.0
    assert math.isclose(at(0.1), 0.1 * -2.0 * 9.25 / 4.0**4, rel_tol=1e-14)
    # In a symmetric spectrum λ² passes: ± i√x becomes ± √x.
    on, off = product(spectrum(0.1j, -0.1j, 2j, -2j), 1.0), product(spectrum(0.1, -0.1, 2j, -2j), 1.0)
    assert math.isclose(on, 0.04)
    assert math.isclose(off, -0.04)


def test_zeros_that_rounding_shows_do_not_change_the_product_of_the_others():
    for noise in (0.0, 1e-8, 1e-8j):
        for x in (1e-4, -1e-4):
            pair = np.sqrt(complex(x))
            values = spectrum(noise, -noise, pair, -pair, 2j, -2j)
            assert math.isclose(product(values, 1.0, 2), -4.0 * x, rel_tol=1e-6)
    assert product(spectrum(0.0, -2.0, 3.0), 1.0, 1) == -6.0


def test_squares_are_each_there_once():
    rng = np.random.default_rng(3)
    mu = np.array([-4.0, -1.0 + 0.5j, -1.0 - 0.5j, 2.0, -1e-3])
    values = np.concatenate([np.sqrt(mu), -np.sqrt(mu)])
    found = squares(rng.permutation(values) * (1 + 1e-15))
    assert len(found) == 5
    assert all(np.min(np.abs(found - m)) < 1e-14 for m in mu)


@pytest.mark.parametrize("seed", range(5))
def test_the_discriminant_is_that_of_the_polynomial_in_the_square(seed):
    rng = np.random.default_rng(seed)
    for b, c in (rng.normal(size=2), (2.0, 0.5), (2.0, 3.0), (-2.0, 0.5)):
        mu = np.roots([1.0, b, c]).astype(complex)
        values = rng.permutation(np.concatenate([np.sqrt(mu), -np.sqrt(mu)]))
        # Of 1 and 4, the whole numbers squared, it is 1.
        size = 0.6 * np.sum(np.abs(mu))
        assert math.isclose(discriminant(values) * size**2, b * b - 4 * c, rel_tol=1e-12, abs_tol=1e-13)


def test_the_discriminant_changes_its_sign_where_two_pairs_meet():
    before = spectrum(1j, -1j, 1.01j, -1.01j, 3j, -3j)
    after = spectrum(*quadruple(0.01 + 1.005j), 3j, -3j)
    assert discriminant(before) > 0.0 > discriminant(after)


@pytest.mark.parametrize("power", [1, 2, 4])
def test_the_discriminant_of_many_pairs_keeps_its_sign(power):
    """As of a string, a beam or stiffer: the product of all differences leaves the range of numbers."""
    rest = 1j * np.arange(3.0, 60.0) ** power
    rest = np.concatenate([rest, -rest])
    for distance in (1e-2, 1e-4):
        assert discriminant(np.concatenate([rest, spectrum(1j, -1j, 1j + 1j * distance, -1j - 1j * distance)])) > 0.0
        assert discriminant(np.concatenate([rest, spectrum(*quadruple(distance + 1j))])) < 0.0


def test_a_zero_that_is_its_own_mirror_image_is_left_out_of_the_functions_of_symmetric_spectra():
    before, after = [1j, -1j, 1.01j, -1.01j, 3j, -3j], [*quadruple(0.01 + 1.005j), 3j, -3j]
    for zero in (0.0, 1e-17, -1e-17):
        for pairs in (before, after):
            found = discriminant(spectrum(zero, *pairs)), discriminant(spectrum(zero, 0.0, *pairs), 1)
            assert np.allclose(found, discriminant(spectrum(*pairs)), rtol=1e-12)
    for zeros, count in ((spectrum(1e-17), 0), (spectrum(1e-17), 1), (spectrum(1e-17, -1e-18, 0.0), 2)):
        stable = symmetric_product(np.concatenate([zeros, spectrum(0.1j, -0.1j, 2j, -2j)]), 1.0, count)
        unstable = symmetric_product(np.concatenate([zeros, spectrum(0.1, -0.1, 2j, -2j)]), 1.0, count)
        assert stable > 0.0 > unstable


# --- following ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("r", range(2, 12))
def test_small_motions_are_followed_whatever_the_order(r):
    rng = np.random.default_rng(r)
    before = rng.normal(size=(50, r)) + 1j * rng.normal(size=(50, r))
    gap = np.abs(before[:, :, None] - before[:, None, :]) + 100 * np.eye(r)
    moved = 0.2 * gap.min(axis=(1, 2))[:, None] * np.exp(2j * math.pi * rng.uniform(size=(50, r)))
    orders = np.array([rng.permutation(r) for _ in range(50)])
    after = np.take_along_axis(before + moved, orders, axis=1)
    link, clear = follow(before, after)
    assert clear.all()
    assert np.array_equal(np.take_along_axis(orders, link, axis=1), np.broadcast_to(np.arange(r), (50, r)))


def test_motions_that_are_too_large_are_doubtful():
    before = spectrum(0.0, 1.0)[None]
    assert follow(before, before + (SWEEP.tracking_step - 0.01) * np.array([1.0, -0.0]))[1][0] == False  # noqa: E712 (gap shrinks)
    assert follow(before, before + 0.2 * np.array([1.0, 0.0]))[1][0]
    assert follow(before, before + SWEEP.tracking_step - 0.01)[1][0]
    assert not follow(before, before + SWEEP.tracking_step + 0.01)[1][0]


def test_both_becoming_one_is_doubtful():
    assert not follow(spectrum(0.0, 1.0)[None], spectrum(0.5, 5.0)[None])[1][0]


def test_multiple_eigenvalues_are_given_one_successor_each():
    values = spectrum(1j, 1j, -1j, -1j, 2.0)[None]
    link, clear = follow(values, values[:, ::-1] * 1.001)
    assert clear[0]
    assert sorted(link[0]) == [0, 1, 2, 3, 4]
    assert np.allclose(values[:, ::-1][0, link[0]], values[0])


def test_spectra_that_are_missing_do_not_disturb_the_others():
    there, missing = spectrum(1.0, 2.0, 5.0), np.full(3, math.nan + 0j)
    before, after = np.stack([there, missing, there, missing]), np.stack([there[::-1], there, missing, missing])
    with np.errstate(all="raise", under="ignore"):
        link, clear = follow(before, after)
    assert clear[0]
    assert link[0].tolist() == [2, 1, 0]
    assert all(sorted(row) == [0, 1, 2] for row in link)


@pytest.mark.parametrize("m", [2, 3, 40, 101])
def test_columns_that_are_followed_are_continuous(m):
    rng = np.random.default_rng(m)
    smooth = np.array([1.0, 3.0, 6.0, 10.0]) + 0.01 * np.arange(m)[:, None]
    orders = np.array([rng.permutation(4) for _ in range(m)])
    values = np.take_along_axis(smooth, orders, axis=1).astype(complex)
    found = np.take_along_axis(values, continuous(*follow(values[:-1], values[1:])), axis=1)
    assert np.all(np.abs(np.diff(found, axis=0)) < 0.011)


@pytest.mark.parametrize("short", [1.0, 0.01])
def test_eigenvalues_that_pass_each_other_in_the_middle_of_an_interval_are_doubtful(short):
    """Also between short intervals, in which they move little."""
    x = np.cumsum([0.0, 1.0, short, 1.0, short, 1.0])
    x -= 0.5 * (x[2] + x[3])
    values = np.stack([x, -x], axis=1) * 1j
    links, clear = follow(values[:-1], values[1:])
    assert clear.tolist() == [short == 1.0, short < 1.0, True, short < 1.0, short == 1.0]
    assert links[2].tolist() == [1, 0]
    assert doubtful(clear, x)[2]
    assert doubtful(np.array([True, True, False, True, True]), np.arange(6.0)).tolist() == [False] * 5
    assert doubtful(np.array([True, False, True, True, False]), np.arange(6.0)).tolist() == [True] + [False] * 4
    assert doubtful(np.array([True]), np.arange(2.0)).tolist() == [True]


@pytest.mark.parametrize("r", [0, 1])
def test_one_eigenvalue_or_none_needs_no_following(r):
    link, clear = follow(np.ones((4, r), dtype=complex), np.ones((4, r), dtype=complex))
    assert link.shape == (4, r)
    assert not link.any()
    assert clear.all()


# --- pairing --------------------------------------------------------------------------------------------------------


def best(cost):
    rows, columns = linear_sum_assignment(cost)
    return cost[rows, columns].sum()


@pytest.mark.parametrize("seed", range(20))
def test_pairs_are_as_cheap_as_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    for n in range(0, 13):
        for cost in (
            rng.uniform(size=(n, n)),
            rng.normal(size=(n, n)) * 10.0 ** rng.integers(-8, 9, (n, n)),
            rng.integers(0, 3, (n, n)).astype(float),
            np.ones((n, n)),
            -rng.integers(0, 2, (n, n)).astype(float),
        ):
            columns = assigned(cost)
            assert sorted(columns) == list(range(n))
            total = cost[np.arange(n), columns].sum()
            assert abs(total - best(cost)) <= 1e-14 * max(np.abs(cost).sum(), 1e-300)


def test_a_permutation_is_found_back():
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 20, 60):
        order = rng.permutation(n)
        cost = rng.uniform(1.0, 2.0, (n, n))
        cost[np.arange(n), order] = 0.5
        assert np.array_equal(assigned(cost), order)


# --- zeros ----------------------------------------------------------------------------------------------------------


FUNCTIONS = [
    (lambda x: (x - 1.0) ** 5, 0.0, 3.0),
    (lambda x: (x - 1.0) ** 9, 0.0, 3.3),
    (lambda x: math.copysign(abs(x - 0.3) ** 0.1, x - 0.3), -1.0, 3.0),
    (lambda x: math.copysign(math.sqrt(abs(x - 2.0)), x - 2.0), 0.0, 9.0),
    (lambda x: math.atan(1e8 * (x - 0.3)), -1.0, 1.0),
    (lambda x: math.exp(50.0 * (x - 0.7)) - 1.0, -5.0, 5.0),
    (lambda x: math.tanh(1e3 * (x - 1e-9)), -1.0, 1.0),
    (lambda x: 1.0 if x > math.pi else -1.0, 0.0, 10.0),
    (lambda x: x - 1e300, -1e301, 1e301),
    (lambda x: x - 1e-200, -1.0, 1.0),
    (lambda x: math.cos(x) - x, 0.0, 1.0),
    (lambda x: x**3 - 2.0 * x - 5.0, 2.0, 3.0),
    (lambda x: 1.0 / (x - 0.5) if x != 0.5 else 1e300, 0.0, 1.3),
    (lambda x: -(x**20) + 1.0, 0.0, 5.0),
]


@pytest.mark.parametrize("beside", [1, 3])
@pytest.mark.parametrize("number", range(len(FUNCTIONS)))
def test_zeros_of_hard_functions_at_many_points(number, beside):
    f, a, b = FUNCTIONS[number]
    expected = brentq(f, a, b, xtol=1e-300, rtol=4 * np.finfo(float).eps, maxiter=5000)
    x = np.linspace(a, b, 7)
    y = np.array([f(z) for z in x])
    left = int(np.flatnonzero(np.sign(y) != np.sign(y[0]))[0]) - 1
    for search in (Search(x[[0, -1]], y[[0, -1]], 0, 1), Search(x, y, left, left + 1)):
        rounds = 0
        while not search.done:
            points = search.points(beside)
            assert 0 < len(points) <= 2 * beside + 2
            assert np.all((a < points) & (points < b))
            search.learn(points, np.array([f(z) for z in points]))
            rounds += 1
        assert abs(search.best - expected) <= 8 * np.finfo(float).eps * abs(expected)
        assert abs(f(search.best)) <= search.residual
        assert rounds <= 55  # bisections of an interval to the last digits


def test_searches_end_where_a_function_has_no_value_and_find_a_zero_at_zero():
    search = Search(np.array([-1.0, 3.0]), np.array([-1.0, 3.0]), 0, 1)
    points = search.points(3)
    search.learn(points, points)
    assert search.done
    assert search.best == 0.0
    search = Search(np.array([1.0, 3.0]), np.array([-1.0, 3.0]), 0, 1)
    search.learn(search.points(1), np.full(3, math.nan))
    assert search.done
    assert search.failed
