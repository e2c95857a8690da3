"""Discs hold as many eigenvalues as they say: single ones, clusters, defective ones, slow ones beside fast ones."""

import itertools
import math

import numpy as np
import pytest
from discs import compared, exact, placed, without
from mpmath import mp
from random_mechanisms import KINDS, random_mechanism
from sampling import sample

import mbstab
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.analysis.bounds import grouping
from mbstab.analysis.bounds.backward_errors import BackwardErrors
from mbstab.analysis.bounds.location import enclosures, enclosures_of
from mbstab.analysis.linear import roundings
from mbstab.analysis.linear.methods import METHODS, solver
from mbstab.analysis.reference.coefficients import Matrices
from mbstab.analysis.verdict.facts import Grounds
from mbstab.errors import MbstabError

EPS = float(np.finfo(float).eps)

SEEDS = [(seed, True) for seed in (*range(0, 480, 13), 887)] + [
    (seed, False) for seed in (4, 12, 23, 52, 204, 501, 536, 1541)
]
"""Mechanisms of every kind, and some that were wrong once, judged with all their zeros."""


def law(*accelerations):
    """Return the text of points on a line with x_i'' as expressions of x0, x1, … and v0, v1, …"""
    n = len(accelerations)
    texts = list(accelerations)
    for i in range(n):
        texts = [x.replace(f"x{i}", f"b{i}.x").replace(f"v{i}", f"rate(b{i}.x)") for x in texts]
    bodies = "".join(f"  b{i}: {{type: planar_point, mass: 1}}\n" for i in range(n))
    rows = "".join(f"  line_{i}: {{holonomic: b{i}.y}}\n" for i in range(n))
    on = ", ".join(f"b{i}.x: {x}" for i, x in enumerate(texts))
    places = ", ".join(f"b{i}: {{x: 0, y: 0}}" for i in range(n))
    return (
        f"mbstab: 1\nbodies:\n{bodies}constraints:\n{rows}forces:\n  law: {{type: expression, on: {{{on}}}}}\n"
        f"reference: {{coordinates: {{{places}}}}}\n"
    )


def bare(text):
    """Return linearization, state space, rate, S and no structure."""
    grounds = Grounds(mbstab.loads(text).linearize())
    nothing = np.zeros((len(grounds.S), 0))
    return grounds.linear, grounds.space, grounds.gamma, grounds.S, nothing, nothing.T


def discs(*accelerations):
    return enclosures(*bare(law(*accelerations))).discs


def holding(found, s):
    (disc,) = [d for d in found if abs(d.centre - s) <= d.radius]
    return disc


# --- random mechanisms ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "structure"), sample(SEEDS, 5))
def test_discs_of_random_mechanisms_hold_their_eigenvalues(seed, structure):
    try:
        mechanism = mbstab.loads(random_mechanism(seed))
        found, neutral = placed(mechanism, structure)
        true = exact(mechanism)
    except MbstabError:
        pytest.skip("no mechanism")
    rows = compared(found, without(true, neutral))
    assert max((ratio for ratio, _, _ in rows), default=0.0) <= 1.0
    assert all(math.isfinite(radius) for _, radius, _ in rows)


@pytest.mark.long
def test_random_mechanisms_are_of_all_kinds_and_nearly_all_are_mechanisms():
    refused = 0
    for seed in range(4 * len(KINDS)):
        try:
            mbstab.loads(random_mechanism(seed)).linearize()
        except MbstabError:
            refused += 1
    assert refused <= 0.15 * 4 * len(KINDS)


# --- clusters -------------------------------------------------------------------------------------------------------


def test_a_double_root_is_a_disc_of_two():
    (disc,) = discs("2*v0 - x0")
    assert len(disc.members) == 2
    assert disc.centre.imag == 0.0
    assert abs(disc.centre - 1.0) <= disc.radius < 1e-6


@pytest.mark.parametrize("coupling", ["0", "1e-9*x1"])
def test_equal_eigenvalues_with_vectors_of_their_own_are_known_to_rounding(coupling):
    found = discs(f"-x0 + {coupling}", "-x1")
    assert sorted(len(d.members) for d in found) == [2, 2]
    assert max(d.radius for d in found) < 1e-12


def test_equal_eigenvalues_in_a_chain_spread_by_the_root_of_a_rounding():
    found = discs("-x0 + 7*x1 + 0.1*v1", "-x1 + 0*x0")
    assert sorted(len(d.members) for d in found) == [2, 2]
    assert all(abs(d.centre - (1j if d.centre.imag > 0 else -1j)) <= d.radius < 1e-6 for d in found)


def test_zeros_in_chains_are_one_disc_beside_fast_and_slow_ones():
    found = discs("0*x0", "-1e16*x1", "x0", "-9*x3")
    assert len(holding(found, 0.0).members) == 4
    assert holding(found, 0.0).radius < 1e-2
    assert holding(found, 3j).radius < 1e-13
    assert holding(found, 1e8j).radius < 1e-6


def test_slow_eigenvalues_keep_their_digits_beside_fast_ones():
    found = discs("-1e16*x0", "1e-4*x1", "-9*x2 - 1e-3*v2")
    for s in (1e-2, -1e-2, 1e8j):
        assert holding(found, s).radius < 1e-14 * abs(s)
    assert all(len(d.members) == 1 for d in found)


def test_discs_are_mirror_images_of_each_other():
    for seed in (0, 3, 7, 40):
        found, _ = placed(mbstab.loads(random_mechanism(seed)))
        known = {(d.centre, d.radius, len(d.members)) for d in found.discs}
        assert known == {(c.conjugate(), r, n) for c, r, n in known}


def chained(rng, sizes):
    """Return an integer matrix P J P⁻¹ with Jordan blocks of these sizes, and its eigenvalues."""
    n = sum(sizes)
    J, values, at = np.zeros((n, n), dtype=int), [], 0
    for size in sizes:
        value = int(rng.choice([-9, -4, -2, -1, 1, 3, 5]))
        block = slice(at, at + size)
        J[block, block] = value * np.eye(size, dtype=int) + np.eye(size, k=1, dtype=int)
        values += [value] * size
        at += size
    P = inverse = np.eye(n, dtype=int)
    for _ in range(n):
        i, j = rng.choice(n, 2, replace=False)
        add = np.eye(n, dtype=int)
        add[i, j] = int(rng.choice([-1, 1]))
        P, inverse = P @ add, (2 * np.eye(n, dtype=int) - add) @ inverse
    return P @ J @ inverse, values


@pytest.mark.parametrize("sizes", [(2,), (3,), (4,), (2, 1), (2, 2), (3, 1), (1, 1, 1), (2, 1, 1)])
@pytest.mark.parametrize("seed", range(4))
def test_discs_of_defective_matrices_hold_as_many_as_they_say(sizes, seed):
    A, values = chained(np.random.default_rng([seed, *sizes]), sizes)
    texts = [" + ".join(f"({a})*x{j}" for j, a in enumerate(row)) for row in A.tolist()]
    true = [sign * np.sqrt(complex(s)) for s in values for sign in (1, -1)]
    found = discs(*texts)
    assert sum(len(d.members) for d in found) == len(true)
    for disc in found:
        assert sum(abs(s - disc.centre) <= disc.radius for s in true) == len(disc.members)
        assert disc.radius < 0.05 * abs(disc.centre)
    for one, two in itertools.combinations(found, 2):
        assert abs(one.centre - two.centre) > one.radius + two.radius


# --- other methods --------------------------------------------------------------------------------------------------


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("seed", "method"), sample(itertools.product([0, 9, 11, 35], [name for name in METHODS if solver(name)]), 5)
)
def test_bounds_of_other_methods_hold(method, seed):
    mechanism = mbstab.loads(random_mechanism(seed))
    grounds = Grounds(mechanism.linearize())
    T, L = grounds.separated.T, grounds.separated.L
    problem = grounds.linear, grounds.space, grounds.gamma, grounds.S, T, L
    default = enclosures(*problem)
    zeros = np.zeros(T.shape[1] + len(L), dtype=complex)
    try:
        found = solver(method)(grounds.linear, grounds.gamma, np.concatenate([default.values, zeros]))
    except MbstabError:
        pytest.skip("not for this mechanism")
    judged = enclosures_of(*problem, found.values, found.vectors)
    true = exact(mechanism)
    assert len(judged.values) == len(found.values)
    for i, s in enumerate(found.values):
        if i not in judged.neutral and np.isfinite(judged.bounds[i]):
            assert min(float(mp.fabs(mp.mpc(complex(s)) - x)) for x in true) <= judged.bounds[i]


def test_what_no_eigenvalue_belongs_to_has_no_bound():
    problem = bare(law("-x0", "-4*x1"))
    vectors = np.zeros((4, 6), dtype=complex)
    vectors[0, :2] = vectors[2, 2:4] = vectors[0, 4:] = 1.0
    values = np.array([1j, -1j, 2j, np.nan, 7.0, np.inf])
    judged = enclosures_of(*problem, values, vectors)
    assert np.all(judged.bounds[:3] < 1e-14)
    assert np.all(~np.isfinite(judged.bounds[[3, 5]]))
    assert not judged.bounds[4] < 1.0
    assert sorted(i for d in judged.discs for i in d.members) == list(range(6))


def test_what_is_not_known_has_discs_without_end():
    linear, space, gamma, S, T, L = bare(law("-x0", "-4*x1"))
    for wrong in (1e300, np.inf, np.nan):
        broken = S.copy()
        broken[0, 0] = wrong
        for disc in enclosures(linear, space, gamma, broken, T, L).discs:
            inside = sum(abs(s - disc.centre) <= disc.radius for s in (1j, -1j, 2j, -2j))
            assert not np.isfinite(disc.radius) or inside == len(disc.members)


# --- numbers with errors --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_numbers_know_how_much_they_are_wrong(seed):
    rng = np.random.default_rng(seed)
    f = rounded_arithmetic()
    texts = [*(f"{x:.3f}" for x in rng.uniform(0.2, 1.5, 4)), "7", "10", "0.5", "1"]
    numbers = [f.number(x) for x in texts]
    with mp.workdps(50):
        true = [mp.mpf(x) for x in texts]
        for _ in range(40):
            i, j = rng.integers(len(numbers), size=2)
            kind = rng.integers(9)
            a, b, x, y = numbers[i], numbers[j], true[i], true[j]
            if kind in (7, 8) and not abs(float(b)) > 1e-3:
                continue
            one, two = {
                0: lambda a=a, b=b, x=x, y=y: (a + b, x + y),
                1: lambda a=a, b=b, x=x, y=y: (a - b, x - y),
                2: lambda a=a, b=b, x=x, y=y: (a * b, x * y),
                3: lambda a=a, x=x: (f.sin(a), mp.sin(x)),
                4: lambda a=a, x=x: (f.cos(a), mp.cos(x)),
                5: lambda a=a, x=x: (f.sqrt(f.abs(a) + 1.0), mp.sqrt(abs(x) + 1)),
                6: lambda a=a, b=b, x=x, y=y: (f.atan2(a, f.abs(b) + 0.5), mp.atan2(x, abs(y) + mp.mpf("0.5"))),
                7: lambda a=a, b=b, x=x, y=y: (a / b, x / y),
                8: lambda b=b, y=y: (f.power(f.abs(b), 1.5), mp.power(abs(y), mp.mpf("1.5"))),
            }[int(kind)]()
            numbers.append(one)
            true.append(two)
        for one, two in zip(numbers, true, strict=True):
            v, e = (one.v, one.e) if isinstance(one, Rounded) else (one, 0.0)
            assert abs(mp.mpf(v) - two) <= e


@pytest.mark.parametrize("forces", [
    ("3.44*b.x", "-3.41*b.x", "-2.58*rate(b.x)"),
    ("(k - 3.41)*b.x - c*rate(b.x)",),
    ("43/12.5*b.x - 2.58*rate(b.x)", "-3.41*b.x"),
    ("0.86*b.y*b.x", "-3.41*b.x", "-2.58*rate(b.x)"),
])  # fmt: skip
def test_numbers_that_cancel_count_with_their_rounding_wherever_they_are_written(forces):
    """The coefficient is 0.03, the difference of decimals that are no floats: 200 times their rounding."""
    lines = "\n".join(f"  f{i}: {{type: expression, on: {{b.x: {force}}}}}" for i, force in enumerate(forces))
    text = f"""
mbstab: 1
parameters: {{k: 3.44, c: 2.58}}
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: b.y - 4}}}}
forces:
{lines}
reference: {{coordinates: {{b: {{x: 0, y: 4}}}}}}
"""
    with mp.workdps(30):
        k, c = mp.mpf("0.03"), mp.mpf("2.58")
        true = [(sign * mp.sqrt(c * c + 4 * k) - c) / 2 for sign in (1, -1)]
        for found in mbstab.loads(text).eig().eigenvalues:
            off = min(abs(found.value.real - s) for s in true)
            assert off <= found.error_bound < 1e-14


def test_entries_that_cancel_inside_of_an_element_are_known_to_be_uncertain():
    # The spring is 1e-9 m longer than at rest; its force is a difference of equal numbers.
    text = (
        "mbstab: 1\nbodies: {b: {type: planar_point, mass: 1}}\n"
        "forces: {s: {type: spring, between: [b, ground], stiffness: 1e6, length: 0.1}}\n"
        "reference: {find: equilibrium, coordinates: {b: {y: 0}}, guess: {b: {x: 0.1}}}\n"
    )
    linear = mbstab.loads(text).linearize()
    error = roundings.roundings(linear).errors.K
    assert error[1, 1] > 0.1 * EPS * 1e6  # the entry itself is rounding
    assert abs(linear.K[1, 1]) <= error[1, 1]
    assert error[0, 0] < 1e-8


def test_roundings_are_worked_out_once(monkeypatch):
    calls, found = [], roundings._Roundings.found
    monkeypatch.setattr(roundings._Roundings, "found", lambda self: calls.append(self) or found(self))
    mbstab.load("von_mises_truss.yaml").eig()  # bounds and the second variation of the energy need them
    assert len(calls) == 1


@pytest.mark.parametrize("exponent", [20, 50, 100, 200])
def test_values_lie_in_their_discs_where_conjugates_change_places(exponent):
    mechanism = mbstab.loads(
        "mbstab: 1\nparameters: {J: 1}\ngravity: [0, -9.81]\nbodies:\n"
        "  cart: {type: planar, mass: 2, inertia: 1}\n"
        "  bob: {type: planar, mass: 0.5, inertia: J, points: {P: [0, 0.3]}}\n"
        "joints:\n  rail: {type: prismatic, between: [cart, ground], axis: x}\n"
        "  pin: {type: revolute, between: [bob.P, cart]}\n"
        "forces:\n  spring: {type: joint_spring, joint: rail, stiffness: 50, damping: 0.4}\n"
        "  hinge: {type: joint_spring, joint: pin, damping: 0.02}\n"
        "reference: {coordinates: {cart: {x: 0}, bob: {theta: 0}}}\n"
    )
    result = mechanism.eig(J=10.0**-exponent)
    assert result.verdict == "asymptotically stable"
    for e in result.eigenvalues:
        assert e.error_bound < 1e-12
        (twin,) = (x for x in result.eigenvalues if x.value == e.value.conjugate())
        assert (twin.kind, twin.error_bound) == (e.kind, pytest.approx(e.error_bound, rel=0.5))


@pytest.mark.parametrize("powers", [0, 20])
def test_spectral_radii_are_compared_as_their_eigenvalues_say(monkeypatch, powers):
    monkeypatch.setattr("mbstab.analysis.bounds.tolerances.Tolerances.radius_powers", powers)
    rng, agreed = np.random.default_rng(4), []
    for k in range(300):
        matrices = rng.uniform(size=(3, 4, 4)) * (rng.uniform(size=(3, 4, 4)) < (0.3, 0.5, 1.0)[k % 3])
        radius = float(np.max(np.abs(np.linalg.eigvals(matrices))))
        for part in (0.5, 0.999, 1.001, 2.0) if radius > 1e-3 else ():
            with np.errstate(all="ignore"):
                agreed.append(grouping.below(matrices, part * radius) == (part > 1.0))
    assert len(agreed) > 800
    assert all(agreed)


def test_errors_of_rows_count_with_the_weights_of_the_rows(monkeypatch):
    """A row C x = 0 acts on an eigenvalue s with Σ λ_k sᵏ: at the worst change the bound is reached, never beaten."""
    calls = []
    data = BackwardErrors.data

    def kept(judge, *arguments):
        calls.append((judge, arguments))
        return data(judge, *arguments)

    monkeypatch.setattr(BackwardErrors, "data", kept)
    mbstab.loads("""
mbstab: 1
gravity: [0, -9.81]
bodies: {p: {type: planar, mass: 1, inertia: 0.1, points: {top: [0, 1]}}}
joints: {j: {type: revolute, between: [p.top, ground]}}
forces: {d: {type: joint_spring, joint: j, stiffness: 0, damping: 12}}
reference: {coordinates: {p: {x: 0, y: -1, theta: 0}}}
""").eig()
    monkeypatch.undo()
    judge, (x, w, V, Y, C, blocks) = calls[0]
    assert np.all(np.isreal(x.pos))
    for row in range(judge.n_h):
        errors = Matrices(*(np.zeros_like(part) for part in judge.m))
        errors.J[row] = 1.0  # far above all rounding
        monkeypatch.setitem(vars(judge), "errors", errors)
        bound = judge.data(x, w, V, Y, C, blocks)
        for i in range(len(C)):
            change = Matrices(*(part.copy() for part in errors))
            change.J[row] = np.sign(x.pos[:, i].real)
            weight = sum(part[i, row] * C[i, i] ** k for k, part in enumerate(w.lam))
            exact = abs(weight * (change.J[row] @ x.pos[:, i]))
            # The multipliers act through the same row.
            through = float(np.abs(w.y[i]) @ np.abs(errors.J.T) @ np.abs(x.nu[:, i]))
            assert bound[i, i] == pytest.approx(exact + through, rel=1e-6)
