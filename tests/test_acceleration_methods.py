"""The five standard techniques: accelerations and derivatives in 40 digits, eigenvalues in 50, what they refuse."""

import functools
from itertools import product

import numpy as np
import pytest
from elimination import solve, zeros
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic
from sampling import sample
from truth import distance, exact_eigenvalues

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.linear import acceleration_methods
from mbstab.analysis.linear.methods import DEFAULT, METHODS, solver
from mbstab.compiler.system import System
from mbstab.errors import NumericalError, UsageError
from mbstab.model.library import installed_models
from mbstab.model.values import evaluate

MODELS = {path.stem: path for path in installed_models()}
TECHNIQUES = ["augmented", "embedding", "amalgamated", "projection", "udwadia-kalaba"]
DIGITS = 40
STEP = "1e-12"
"""Central differences: off by STEP², and by 1e-40/STEP."""


@functools.cache
def shipped(name):
    return mbstab.load(MODELS[name])


# --- the printed equations, in many digits --------------------------------------------------------------------------


def embedded(J, Q_d, independent):
    n, c = J.shape[1], len(J)
    B = zeros(n - c, n)
    B[np.arange(n - c), independent] = mp.one
    J_c, ones = np.vstack([J, B]), zeros(n, n - c)
    ones[c:] = np.eye(n - c, dtype=int) + mp.zero
    return solve(J_c, ones), solve(J_c, np.concatenate([-Q_d, zeros(n - c)]))


def eq_38(M, Q_b, J, Q_d, _):
    c = len(J)
    matrix = np.block([[M, J.T], [J, zeros(c, c)]])
    return solve(matrix, np.concatenate([Q_b, Q_d]))[: len(M)]


def eq_159(M, Q_b, J, Q_d, independent):
    J_bar, w_bar = embedded(J, Q_d, independent)
    if not len(independent):
        return -w_bar
    return J_bar @ solve(J_bar.T @ M @ J_bar, J_bar.T @ (Q_b + M @ w_bar)) - w_bar


def eq_165(M, Q_b, J, Q_d, independent):
    J_bar, w_bar = embedded(J, Q_d, independent)
    n, i = J_bar.shape
    unit = np.eye(n, dtype=int) + mp.zero
    matrix = np.block(
        [[M, unit, zeros(n, i)], [unit, zeros(n, n), -J_bar], [zeros(i, n), -J_bar.T, zeros(i, i)]],
    )
    return solve(matrix, np.concatenate([Q_b, -w_bar, zeros(i)]))[:n]


def eq_170(M, Q_b, J, Q_d, independent):
    J_bar, _ = embedded(J, Q_d, independent)
    return solve(np.vstack([J_bar.T @ M, J]), np.concatenate([J_bar.T @ Q_b, Q_d]))


def eq_172(M, Q_b, J, Q_d, _, printed=False):
    M_star = M + J.T @ J
    free = solve(M_star, Q_b + J.T @ Q_d)
    inner = J @ M_star @ J.T if printed else J @ solve(M_star, J.T)
    return free + solve(M_star, J.T @ solve(inner, Q_d - J @ free))


EQUATIONS = dict(zip(TECHNIQUES, (eq_38, eq_159, eq_165, eq_170, eq_172), strict=True))


@functools.cache
def states(name, **parameters):
    """Return system, basis and states: the reference, one of other speeds, and one off the constraints."""
    linear = shipped(name).linearize(**parameters)
    motion, basis = linear.motion, acceleration_methods.basis_of(linear)
    rng = np.random.default_rng(3)
    free = basis.scale[:, None] * (motion.spaces.N @ motion.spaces.Z)
    size = max(1.0, float(np.max(np.abs(motion.u / motion.sizes))))
    other = motion.u + free @ rng.uniform(-1.0, 1.0, free.shape[1]) * size / np.max(np.abs(free), initial=1.0)
    q = motion.q + 0.1 * motion.sizes * rng.uniform(-1.0, 1.0, len(motion.q))
    u = motion.u + 0.3 * size * motion.sizes * rng.uniform(-1.0, 1.0, len(motion.q))
    found = {"reference": (motion.q, motion.u), "consistent": (motion.q, other), "inconsistent": (q, u)}
    return linear, basis, found


def in_many_digits(name, technique, q, u, basis, time, **equation):
    """Return a(q, u, t) by the printed equations of a technique; for M + JᵀJ in the scales of the program."""
    system = System(evaluate(shipped(name).model, {}, mpmath_arithmetic()))
    state = system.dynamics(q, u, mp.mpf(time))
    scale, rows = basis.scale + mp.zero, basis.row_scale + mp.zero
    M, J = (state.M + mp.zero) * scale * scale[:, None], (state.J + mp.zero) * scale * rows[:, None]
    Q_b, Q_d = -(state.F0 + mp.zero) * scale, -(state.B + mp.zero) * rows
    return scale * EQUATIONS[technique](M, Q_b, J, Q_d, basis.independent, **equation)


PLACES = ["reference", "consistent", "inconsistent"]
SMALL = ["pendulum", "wheeled_inverted_pendulum", "top", "rolling_disk", "rotating_pendulum", "trailer", "four_bar"]


LARGER = ["double_pendulum", "shimmy", "wheelset_no_slip", "chaplygin_sleigh"]


# The steps 7 and 11 have no common factor with the numbers of techniques, models and places: each is met.
@pytest.mark.parametrize(
    ("technique", "name", "place"), sample(list(product(TECHNIQUES, [*SMALL, *LARGER], PLACES)), 7)
)
def test_accelerations_are_those_of_all_other_formulations(name, technique, place):
    linear, basis, found = states(name)
    q, u = found[place]
    a = solver(technique).accelerations(basis, q, u, linear.motion.time)
    with mp.workdps(DIGITS):
        exact = in_many_digits(name, "augmented", q + mp.zero, u + mp.zero, basis, linear.motion.time)
        own = in_many_digits(name, technique, q + mp.zero, u + mp.zero, basis, linear.motion.time)
        assert max(abs(x) for x in (own - exact) / basis.scale) < 1e-30 * (1 + max(abs(x) for x in exact / basis.scale))
    exact = exact.astype(float)
    size = np.max(np.abs(exact / basis.scale)) + np.max(np.abs(linear.motion.dynamics.F0 * basis.scale))
    assert np.max(np.abs(a - exact) / basis.scale) <= 1e-12 * size


@pytest.mark.parametrize(("technique", "name", "place"), sample(list(product(TECHNIQUES, SMALL, PLACES)), 11))
def test_slopes_are_the_difference_quotients_of_the_printed_equations(name, technique, place):
    linear, basis, found = states(name)
    q, u = found[place]
    A_q, A_u = solver(technique).slopes(basis, q, u, linear.motion.time)
    n = len(q)
    with mp.workdps(DIGITS):
        h, state = mp.mpf(STEP), np.concatenate([q, u]) + mp.zero
        exact = np.zeros((n, 2 * n))
        for j in range(2 * n):
            step = zeros(2 * n)
            step[j] = h
            after, before = (
                in_many_digits(name, technique, x[:n], x[n:], basis, linear.motion.time)
                for x in (state + step, state - step)
            )
            exact[:, j] = ((after - before) / (2 * h)).astype(float)
    for slope, expected in zip((A_q, A_u), np.hsplit(exact, 2), strict=True):
        scaled, expected = (x * basis.scale / basis.scale[:, None] for x in (slope, expected))
        np.testing.assert_allclose(scaled, expected, rtol=1e-11, atol=1e-12 * np.max(np.abs(exact)))


def test_the_pseudo_inverse_as_eq_172_prints_it_satisfies_no_constraint():
    linear, basis, found = states("four_bar")
    q, u = (x + mp.zero for x in found["consistent"])
    with mp.workdps(DIGITS):
        right, printed = (
            in_many_digits("four_bar", "udwadia-kalaba", q, u, basis, 0, printed=x).astype(float) for x in (False, True)
        )
    state = linear.system.dynamics(*found["consistent"])
    assert np.max(np.abs(state.J @ right + state.B)) < 1e-12
    assert np.max(np.abs(state.J @ printed + state.B)) > 0.1
    a = solver("udwadia-kalaba").accelerations(basis, *found["consistent"], 0.0)
    assert np.max(np.abs(a - right)) < 1e-12
    assert np.max(np.abs(a - printed)) > 0.1


# --- eigenvalues ----------------------------------------------------------------------------------------------------

# Model, parameters, and the relative error that the worst technique is allowed; measured ones are ten times smaller.
CASES = {
    "pendulum": ({}, 1e-14),
    "wheeled_inverted_pendulum": ({}, 2e-14),
    "top-4": ({"omega": "4"}, 2e-14),
    "top-10": ({"omega": "10"}, 2e-14),
    "rolling_disk-1": ({"omega": "1"}, 1e-14),
    "rolling_disk-5": ({"omega": "5"}, 1e-14),
    "governor-0": ({"omega": "0"}, 1e-13),
    "governor-10": ({"omega": "10"}, 4e-13),
    "governor-20": ({"omega": "20"}, 4e-13),
    "governor-30": ({"omega": "30"}, 4e-13),
    "governor_paper-20": ({"omega": "20"}, 2e-13),
    "rotating_pendulum": ({}, 5e-13),
    "bead_on_hoop": ({"Omega": "6", "theta": "1"}, 1e-14),
    "whipple_bicycle": ({"v": "5"}, 2e-9),
    "trailer": ({}, 1e-14),
    "four_bar": ({}, 1e-14),
    "double_pendulum": ({}, 1e-14),
    "shimmy": ({}, 1e-14),
    "rattleback": ({}, 1e-14),
    "free_rigid_body": ({}, 2e-14),
}


@functools.cache
def truth(case):
    return exact_eigenvalues(shipped(case.partition("-")[0]).model, **CASES[case][0])


@pytest.mark.parametrize(("technique", "case"), sample(product(TECHNIQUES, CASES), 7))
def test_eigenvalues_agree_with_50_digits_and_lie_within_their_bounds(case, technique):
    parameters, tolerance = CASES[case]
    result = shipped(case.partition("-")[0]).eig(technique, **parameters)
    exact, zeros_of_truth = truth(case)
    # Tilts of an axis are neutral and the pair ±iω in truth; zeros that no symmetry explains are no neutral ones.
    others = [s for s in exact if all(abs(abs(s.imag) - rate) > 1e-9 * rate for rate in result.shifts)]
    judged = sorted((e for e in result.eigenvalues if e.kind != "neutral"), key=lambda e: -abs(e.value))
    judged, unexplained = judged[: len(others)], judged[len(others) :]
    assert len(judged) == len(others)
    assert all(abs(e.value) <= e.error_bound for e in unexplained)
    assert result.counts.neutral + len(unexplained) == zeros_of_truth + len(exact) - len(others)
    exact = others
    errors, exact = distance([e.value for e in judged], exact)
    np.testing.assert_array_less(errors, [e.error_bound for e in judged])
    np.testing.assert_array_less(errors / np.abs(exact), tolerance)
    assert max(e.error_bound / abs(e.value) for e in judged) < 1e-6


@pytest.mark.parametrize(("technique", "case"), sample(product(TECHNIQUES, CASES), 7))
def test_extra_eigenvalues_are_counted_and_lie_where_constraint_drift_has_them(case, technique):
    result = shipped(case.partition("-")[0]).eig(technique, **CASES[case][0])
    counts = result.counts
    assert counts.extra == 2 * counts.rank_holonomic + counts.rank_nonholonomic == 2 * counts.n_q - counts.expected
    assert counts.found == counts.expected
    assert counts.infinite == counts.undefined == 0
    # Roots of rounding: Jordan blocks of size 2, of 4 where neutral ones join them.
    assert counts.extra_error < 1e-3


def test_what_a_turning_frame_carries_around_drifts_round_in_it():
    linear = shipped("governor").linearize(omega=10)
    drift = acceleration_methods.drift(linear)
    assert len(drift) == 2 * 36 - 3
    around = np.abs(np.abs(drift) - 10.0) < 1e-9
    assert 0 < np.sum(around) < len(drift)
    np.testing.assert_allclose(drift[~around], 0.0, atol=1e-9)
    np.testing.assert_allclose(drift[around].real, 0.0, atol=1e-9)
    for technique in TECHNIQUES:
        found = np.linalg.eigvals(solver(technique).state_matrix(linear))
        assert np.sum(np.abs(np.abs(found.imag) - 10.0) < 1e-3) == np.sum(around)


def test_the_extra_eigenvalues_of_a_double_pendulum_are_roots_of_rounding():
    # Two rows on four coordinates: Jordan blocks of size 2 at zero, so that the rank of A is 8 − 2, of A² 8 − 4.
    linear = shipped("double_pendulum").linearize()
    for technique in TECHNIQUES:
        A = solver(technique).state_matrix(linear)
        assert np.linalg.matrix_rank(A, tol=1e-10) == 6
        assert np.linalg.matrix_rank(A @ A, tol=1e-10) == np.linalg.matrix_rank(A @ A @ A, tol=1e-10) == 4


# --- dependent rows, no mass, frozen time ---------------------------------------------------------------------------


@pytest.mark.parametrize("technique", TECHNIQUES[:-1])
def test_dependent_rows_are_refused_with_the_joints(technique):
    with pytest.raises(NumericalError, match=r"30 rows have rank 29: joint 'hinge_5' .* repeats what joint 'hinge_0'"):
        shipped("bricard").eig(technique)


def test_the_pseudo_inverse_takes_dependent_rows():
    found, expected = shipped("bricard").eig("udwadia-kalaba"), shipped("bricard").eig()
    np.testing.assert_array_less(matched(found.values(), expected.values()), 1e-7)
    assert found.counts.extra == 2 * 29
    assert found.verdict == expected.verdict


# A link whose mass is in its middle: its angle carries none.
MASSLESS = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {l: 0.7, m: 1.5, n: 0.4}
bodies:
  link: {type: planar, mass: n, inertia: 0, points: {top: [-l/2, 0], end: [l/2, 0]}}
  bob: {type: planar_point, mass: m}
joints:
  pivot: {type: revolute, between: [link.top, ground]}
  pin: {type: spherical, between: [link.end, bob]}
reference:
  coordinates: {link: {theta: -pi/2}}
  guess: {link: {y: -l/2}, bob: {y: -l}}
"""


@pytest.mark.parametrize("technique", TECHNIQUES)
def test_coordinates_without_mass_are_none_of_their_concern(technique):
    scene = mbstab.loads(MASSLESS)
    assert np.linalg.matrix_rank(scene.linearize().M) == 4
    result = scene.eig(technique)
    root = np.sqrt(9.81 * (1.5 + 0.4 / 2) / (0.7 * (1.5 + 0.4 / 4)))
    np.testing.assert_allclose(matched(result.values(), [1j * root, -1j * root]), 0.0, atol=1e-13)


@pytest.mark.parametrize("technique", TECHNIQUES)
def test_frozen_time_is_refused_where_coefficients_change(technique):
    with pytest.raises(UsageError, match=f"--method {technique} needs constant coefficients"):
        shipped("governor").eig(technique, frozen=True)
    assert shipped("pendulum").eig(technique, frozen=True).verdict == "undecided"


# --- the table of methods -------------------------------------------------------------------------------------------


def test_every_method_has_its_function():
    assert DEFAULT == "nullspace"
    assert set(TECHNIQUES) < set(METHODS)
    assert [name for name in METHODS if solver(name) is None] == [DEFAULT]
    assert all(solver(name).name == name and solver(name).__doc__ for name in TECHNIQUES)
