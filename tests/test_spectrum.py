"""Functions of spectra on constructed ones, pairing against SciPy's, zeros of hard functions against Brent's method."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, linear_sum_assignment

from mbstab.analysis.numerics import assigned, root
from mbstab.analysis.spectrum import STRIDE, discriminant, follow, product, signs, squares, symmetric, unstable_counts
from mbstab.errors import NumericalError


def spectrum(*values):
    return np.array(values, dtype=complex)


def quadruple(s):
    return [s, s.conjugate(), -s, -s.conjugate()]


# --- symmetry -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("seed", range(5))
def test_symmetric_spectra_are_recognized_in_any_order_and_size(size, seed):
    rng = np.random.default_rng(seed)
    values = [*quadruple(complex(*rng.normal(size=2))), 1j, -1j, 0.3, -0.3]
    x = size * rng.permutation(np.array(values))
    assert symmetric(x)
    assert not symmetric(x + 1e-6 * size)
    assert not symmetric(x[:-1])
    assert symmetric(np.stack([x, x + 1e-6 * size, x])).tolist() == [True, False, True]


def test_power_sums_beyond_the_first_are_looked_at():
    # The sum vanishes, that of the cubes does not.
    assert not symmetric(spectrum(2.0, -1.0, -1.0, 0.0))
    assert not symmetric(spectrum(1.0, 5.0, -2.0, -4.0))
    assert not symmetric(spectrum(0.1 + 1j, 0.1 - 1j, -0.1 + 2j, -0.1 - 2j))


def test_an_empty_spectrum():
    assert unstable_counts(np.zeros((3, 0), dtype=complex)).tolist() == [0, 0, 0]


# --- counts ---------------------------------------------------------------------------------------------------------


def test_unstable_eigenvalues_are_counted():
    cases = [
        (spectrum(-1.0, -2.0, 1e-3, -3.0), 1),
        (spectrum(0.1 + 1j, 0.1 - 1j, -0.1 + 2j, -0.1 - 2j), 2),
        (spectrum(*quadruple(0.1 + 1j)), 2),
        (spectrum(1j, -1j, 2j, -2j), 0),
        (spectrum(1.0, -1.0, 2j, -2j), 1),
        (spectrum(1.0, -1.0, 2.0, -2.0), 2),
        (spectrum(-1.0, -2.0, 1e-13, -3.0), 0),
        (spectrum(0.0, -1.0), 0),
    ]
    for values, count in cases:
        for size in (1e-9, 1.0, 1e9):
            assert unstable_counts(size * values[None])[0] == count


def test_no_eigenvalues_no_count():
    values = np.stack([spectrum(1.0, -1.0), spectrum(math.nan, 1.0), spectrum(math.nan, math.nan)])
    assert unstable_counts(values).tolist() == [1, -1, -1]


def test_rounding_at_a_collision_on_the_axis_is_no_instability():
    # Two pairs that have just met: real parts are roots of rounding errors.
    near = spectrum(*quadruple(1e-8 + 1j))
    assert unstable_counts(near[None]).tolist() == [2]
    nearer = spectrum(*quadruple(3e-12 + 1j))
    assert unstable_counts(nearer[None]).tolist() == [0]


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_rounding_of_the_matrix_is_no_instability_however_small_its_eigenvalues(size):
    # A rolling torus at its critical speed: λ² = 0 but for the rounding of a matrix of norm 14.
    known = size * np.array([13.56, 9e-14])
    for s in (1e-15 + 9.5e-8j, -1e-15 + 9.5e-8j, 9.5e-8 + 0j):
        values = size * np.array([s, s.conjugate() if s.imag else -s])
        assert symmetric(values, known)
        assert unstable_counts(values, known) == 0
        assert signs(values[None] * 1e-8, known[None]).tolist() == [[0.0, 0.0]]
    assert unstable_counts(size * spectrum(1e-5, -1e-5), known) == 1
    assert unstable_counts(size * spectrum(1e-12 + 1e-5j, 1e-12 - 1e-5j), known) == 2
    assert not symmetric(size * spectrum(1e-12 + 1e-5j, 1e-12 - 1e-5j), known)


def test_small_eigenvalues_of_a_known_matrix_are_symmetric_only_if_every_sum_is():
    values = 1e-3 * spectrum(0.1 + 1j, 0.1 - 1j, -0.1 + 2j, -0.1 - 2j)
    assert not symmetric(values, np.array([1.0, 1e-14]))
    assert symmetric(1e-3 * spectrum(*quadruple(0.1 + 1j)), np.array([1.0, 1e-14]))


@pytest.mark.parametrize("points", range(1, 40))
def test_missing_rows_do_not_trap_where_invalid_operations_are_errors(points):
    values = np.full((points, 4), math.nan + 0j)
    with np.errstate(all="raise", under="ignore"):
        assert unstable_counts(values).tolist() == [-1] * points


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
        for size in (1.0, 3.0):
            assert math.isclose(discriminant(values, size), (b * b - 4 * c) / size**4, rel_tol=1e-12, abs_tol=1e-13)


def test_the_discriminant_changes_its_sign_where_two_pairs_meet():
    before = spectrum(1j, -1j, 1.01j, -1.01j, 3j, -3j)
    after = spectrum(*quadruple(0.01 + 1.005j), 3j, -3j)
    assert discriminant(before, 3.0) > 0.0 > discriminant(after, 3.0)


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
    assert follow(before, before + (STRIDE - 0.01) * np.array([1.0, -0.0]))[1][0] == False  # noqa: E712 (gap shrinks)
    assert follow(before, before + 0.2 * np.array([1.0, 0.0]))[1][0]
    assert follow(before, before + STRIDE - 0.01)[1][0]
    assert not follow(before, before + STRIDE + 0.01)[1][0]


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


@pytest.mark.parametrize("number", range(len(FUNCTIONS)))
def test_zeros_of_hard_functions(number):
    f, a, b = FUNCTIONS[number]
    calls = []

    def counted(x):
        calls.append(x)
        return f(x)

    expected = brentq(f, a, b, xtol=1e-300, rtol=4 * np.finfo(float).eps, maxiter=5000)
    for low, high in ((a, b), (b, a)):
        calls.clear()
        found = root(counted, low, high)
        assert abs(found - expected) <= 8 * np.finfo(float).eps * abs(expected)
        assert all(min(a, b) <= x <= max(a, b) for x in calls)
        assert len(calls) <= 130


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_function_without_a_value(value):
    with pytest.raises(NumericalError, match="no value"):
        root(lambda x: value if 0.2 < x < 0.8 else x - 0.5, 0.0, 1.0)


def test_a_zero_at_an_end():
    assert root(lambda x: x - 1.0, 1.0, 2.0) == 1.0
    assert root(lambda x: x - 2.0, 1.0, 2.0) == 2.0


def test_a_zero_at_the_first_end_of_a_falling_function():
    assert root(lambda x: 1.0 - x, 1.0, 2.0) == 1.0


def test_a_zero_at_zero():
    assert abs(root(lambda x: x, -1.0, 3.0)) < 1e-50
    assert abs(root(lambda x: x**3, -1.0, 2.0)) < 1e-50
