"""Eigenvalues, their error bounds and the verdict: against closed forms, other methods and 50 digits."""

import cmath
import functools
import math
import re

import numpy as np
import pytest
from chains import hanging_chain, spring_chain
from truth import distance, exact_eigenvalues

import mbstab
from mbstab.analysis.eigen import METHODS, deflate_neutral, matched
from mbstab.errors import UsageError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}


def shipped(name):
    return mbstab.load(MODELS[name])


def assert_matched(found, expected, rtol):
    """Compare sets of eigenvalues by optimal pairing; sorting pairs them wrongly when real parts differ by rounding."""
    assert len(found) == len(expected)
    np.testing.assert_array_less(matched(found, expected) / np.abs(expected), rtol)


# --- closed forms ---------------------------------------------------------------------------------------------------


def pair(square):
    """Return ±√(s²)."""
    root = cmath.sqrt(square)
    return [root, -root]


def pendulum(L, g):
    return pair(-3.0 * g / (4.0 * L))


def wheeled_inverted_pendulum(m_d, R_d, I_d, m_p, L_p, I_p, g):
    # Massless-wheel-like elimination of the rolling coordinate: (I + m L² − (m L)²/(m_d + m_p + I_d/R²)) θ'' = m g L θ.
    effective = I_p + m_p * L_p**2 - (m_p * L_p) ** 2 / (m_d + m_p + I_d / R_d**2)
    return pair(m_p * g * L_p / effective)


def top(H, m, I_x, I_z, g, omega):
    # A s² − i C ω s − m g H = 0 for the complex tilt, and its conjugate.
    A = I_x + m * H**2
    spin = 1j * I_z * omega
    nutation = (spin + math.copysign(1.0, omega) * cmath.sqrt(4.0 * A * m * g * H + spin**2)) / (2.0 * A)
    # The product of the roots: their difference would lose the digits of a slow precession.
    precession = -m * g * H / (A * nutation)
    return [nutation, precession, nutation.conjugate(), precession.conjugate()]


def rolling_disk(R, m, I_t, I_a, g, omega):
    return pair((m * g * R * I_t - I_a * (I_a + m * R**2) * omega**2) / (I_t * (I_t + m * R**2)))


def rolling_torus(m, R, r, I_t, I_a, g, v):
    rho = R + r
    return pair((m * g * R * I_t - I_a * (I_a + m * rho**2) * (v / rho) ** 2) / (I_t * (I_t + m * rho**2)))


def double_pendulum(l, g):
    return [*pair(-(2.0 - math.sqrt(2.0)) * g / l), *pair(-(2.0 + math.sqrt(2.0)) * g / l)]


def four_bar(l, g):
    # Two rods turn about their ends, the coupler moves with the pins: (2/3 + 1) m l² θ'' = −(1/2 + 1/2 + 1) m g l θ.
    return pair(-2.0 * g / ((2.0 / 3.0 + 1.0) * l))


def slider_crank(r, m_c, m_r, k, c):
    # The rod turns with −r/l of the crank about a wrist pin that stands still: its l drops out.
    J = (m_c + m_r) * r**2 / 3.0
    root = cmath.sqrt(c**2 - 4.0 * J * k)
    return [(-c + root) / (2.0 * J), (-c - root) / (2.0 * J)]


def sleigh(m, a, I, v):
    return [-m * a * v / (I + m * a**2)]


def trailer(L, v):
    return [-v / L]


def free_rigid_body(I1, I2, I3, Omega):
    return [*pair(Omega**2 * (I2 - I1) * (I3 - I2) / (I1 * I3)), 1j * Omega, -1j * Omega]


DISK = {"R": 0.3, "m": 2.0, "I_t": 2.0 * (3 * 0.3**2 + 0.05**2) / 12, "I_a": 2.0 * 0.3**2 / 2, "g": 9.81}
TOP = {"H": 0.04, "m": 0.01, "I_x": 3e-4, "I_z": 4e-4, "g": 9.81}
TORUS = {"m": 5.0, "R": 0.25, "r": 0.05, "I_t": 0.164, "I_a": 0.322, "g": 9.81}
WHEELED = {"m_d": 1.0, "R_d": 0.2, "I_d": 0.02, "m_p": 2.0, "L_p": 0.5, "I_p": 0.0417, "g": 9.81}
CRANK = {"r": 0.1, "m_c": 0.5, "m_r": 0.8, "k": 3.0}

# Model, its parameters, closed form, number of finite eigenvalues, how many of them are zero, verdict.
CLOSED_FORMS = {
    "pendulum": ("pendulum", {"L": 0.2, "g": 9.81}, pendulum, 2, 0, "marginally stable"),
    "pendulum-long": ("pendulum", {"L": 17.3, "g": 1.62}, pendulum, 2, 0, "marginally stable"),
    "wheeled": ("wheeled_inverted_pendulum", WHEELED, wheeled_inverted_pendulum, 5, 3, "unstable"),
    "wheeled-heavy": (
        "wheeled_inverted_pendulum",
        {**WHEELED, "m_d": 40.0, "R_d": 0.7, "L_p": 0.05},
        wheeled_inverted_pendulum,
        5,
        3,
        "unstable",
    ),
    "top-4": ("top", {**TOP, "omega": 4.0}, top, 4, 0, "unstable"),
    "top-5.6": ("top", {**TOP, "omega": 5.6}, top, 4, 0, "marginally stable"),
    "top-10": ("top", {**TOP, "omega": 10.0}, top, 4, 0, "marginally stable"),
    "top-backward": ("top", {**TOP, "omega": -300.0}, top, 4, 0, "marginally stable"),
    "disk-1": ("rolling_disk", {**DISK, "omega": 1.0}, rolling_disk, 6, 4, "unstable"),
    "disk-3.33": ("rolling_disk", {**DISK, "omega": 3.33}, rolling_disk, 6, 4, "marginally stable"),
    "disk-3.4": ("rolling_disk", {**DISK, "omega": 3.4}, rolling_disk, 6, 4, "marginally stable"),
    "disk-5": ("rolling_disk", {**DISK, "omega": 5.0}, rolling_disk, 6, 4, "marginally stable"),
    "disk-moon": ("rolling_disk", {**DISK, "g": 1.62, "omega": 40.0}, rolling_disk, 6, 4, "marginally stable"),
    "torus-0.5": ("rolling_torus", {**TORUS, "v": 0.5}, rolling_torus, 8, 6, "unstable"),
    "torus-1.5": ("rolling_torus", {**TORUS, "v": 1.5}, rolling_torus, 8, 6, "marginally stable"),
    "torus-thick": ("rolling_torus", {**TORUS, "r": 0.2, "v": 7.0}, rolling_torus, 8, 6, "marginally stable"),
    "double": ("double_pendulum", {"l": 1.0, "g": 9.81}, double_pendulum, 4, 0, "marginally stable"),
    "double-short": ("double_pendulum", {"l": 0.013, "g": 9.81}, double_pendulum, 4, 0, "marginally stable"),
    "four-bar": ("four_bar", {"l": 1.0, "g": 9.81}, four_bar, 2, 0, "marginally stable"),
    "four-bar-long": ("four_bar", {"l": 37.0, "g": 9.81}, four_bar, 2, 0, "marginally stable"),
    "crank": ("slider_crank", {**CRANK, "c": 0.02}, slider_crank, 2, 0, "asymptotically stable"),
    "crank-overdamped": ("slider_crank", {**CRANK, "c": 0.5}, slider_crank, 2, 0, "asymptotically stable"),
    "crank-undamped": ("slider_crank", {**CRANK, "c": 0.0}, slider_crank, 2, 0, "marginally stable"),
    "sleigh": ("chaplygin_sleigh", {"m": 2.0, "a": 0.25, "I": 0.3, "v": 1.0}, sleigh, 5, 4, "marginally stable"),
    "sleigh-backward": ("chaplygin_sleigh", {"m": 2.0, "a": 0.25, "I": 0.3, "v": -31.0}, sleigh, 5, 4, "unstable"),
    "trailer": ("trailer", {"L": 4.0, "v": 10.0}, trailer, 1, 0, "asymptotically stable"),
    "trailer-backing": ("trailer", {"L": 0.3, "v": -2.0}, trailer, 1, 0, "unstable"),
    "body-middle": ("free_rigid_body", {"I1": 1.0, "I2": 2.0, "I3": 3.0, "Omega": 2.0}, free_rigid_body, 12, 8, "unstable"),
    "body-least": (
        "free_rigid_body",
        {"I1": 2.0, "I2": 1.0, "I3": 2.5, "Omega": 30.0},
        free_rigid_body,
        12,
        8,
        "marginally stable",
    ),
}


@pytest.mark.parametrize("case", CLOSED_FORMS)
def test_eigenvalues_are_those_of_the_closed_form(case):
    name, parameters, closed_form, n_f, neutral, verdict = CLOSED_FORMS[case]
    result = shipped(name).eig(**parameters)
    assert_matched(result.values(), closed_form(**parameters), rtol=1e-13)
    assert (result.counts.expected, result.counts.found, result.counts.neutral) == (n_f, n_f, neutral)
    assert result.verdict == verdict


# --- generated mechanisms -------------------------------------------------------------------------------------------


def chain(kind, links, number, **options):
    generate = hanging_chain if kind == "hanging" else spring_chain
    return generate(np.random.default_rng([links, number]), links, **options)


def floating(text):
    """Cut a chain off the ground: six zero eigenvalues (four in a plane) beside the others."""
    text = re.sub(r"  (pin|angle|displacement|spring)_1:.*\n", "", text)
    text = re.sub(r"(joints|forces):\n(?=[a-z])", "", text)
    return text.replace("gravity: [0, -9.81]", "gravity: 0")


GENERATED = {
    **{f"hanging-{n}": chain("hanging", n, 0) for n in (1, 2, 3, 5, 8, 12, 20)},
    **{f"hanging-damped-{n}": chain("hanging", n, 1, damping=1.0, stiffness=5.0) for n in (1, 2, 3, 5, 8, 12)},
    **{f"spatial-{n}": chain("spatial", n, 2) for n in (1, 2, 3, 5, 8)},
    **{f"spatial-damped-{n}": chain("spatial", n, 3, damping=0.5) for n in (1, 2, 3, 5)},
    **{f"floating-planar-{n}": floating(chain("hanging", n, 4, stiffness=20.0)) for n in (2, 5)},
    **{f"floating-planar-damped-{n}": floating(chain("hanging", n, 5, stiffness=20.0, damping=1.0)) for n in (2, 5)},
    **{f"floating-spatial-{n}": floating(chain("spatial", n, 6)) for n in (2, 4)},
    **{f"floating-spatial-damped-{n}": floating(chain("spatial", n, 7, damping=0.5)) for n in (2, 4)},
}
EXACT = {**{name: None for name in MODELS}, **GENERATED}


@functools.cache
def mechanism(name):
    return shipped(name) if name in MODELS else mbstab.loads(GENERATED[name], name)


@functools.cache
def answer(name, method="nullspace"):
    return mechanism(name).eig(method)


@functools.cache
def truth(name):
    return exact_eigenvalues(mechanism(name).model)


def errors_and_bounds(result, exact):
    judged = [e for e in result.eigenvalues if e.kind != "neutral"]
    assert len(judged) == len(exact)
    errors, exact = distance([e.value for e in judged], exact)
    return errors, np.array([e.error_bound for e in judged]), np.abs(exact)


@pytest.mark.parametrize("name", EXACT)
def test_eigenvalues_lie_within_their_error_bounds_of_the_truth(name):
    exact, zeros = truth(name)
    errors, bounds, _ = errors_and_bounds(answer(name), exact)
    np.testing.assert_array_less(errors, bounds)
    assert answer(name).counts.neutral == zeros
    assert answer(name).counts.found == answer(name).counts.expected == len(exact) + zeros


@pytest.mark.parametrize("name", EXACT)
def test_error_bounds_are_no_larger_than_they_must_be(name):
    errors, bounds, sizes = errors_and_bounds(answer(name), truth(name)[0])
    possible = np.maximum(errors, np.finfo(float).eps * sizes)
    assert np.median(bounds / possible) < 1e3
    assert np.max(bounds / sizes) < 1e-9


@pytest.mark.parametrize("method", ["index3", "paper"])
@pytest.mark.parametrize("name", GENERATED)
def test_the_undeflated_methods_lie_within_their_own_error_bounds(name, method):
    errors, bounds, _ = errors_and_bounds(answer(name, method), truth(name)[0])
    np.testing.assert_array_less(errors, bounds)


@pytest.mark.parametrize("method", ["index3", "paper"])
@pytest.mark.parametrize("name", MODELS)
def test_the_methods_agree_on_the_examples_within_their_error_bounds(name, method):
    default, other = ([e for e in answer(name, m).eigenvalues if e.kind != "neutral"] for m in ("nullspace", method))
    assert len(default) == len(other)
    found, expected = (np.array([e.value for e in group]) for group in (default, other))
    bounds = [e.error_bound for e in default], [e.error_bound for e in other]
    np.testing.assert_array_less(matched(found, expected), max(bounds[0]) + max(bounds[1]))


@pytest.mark.parametrize("name", [n for n in GENERATED if "-damped" in n and "floating" not in n])
def test_a_chain_whose_joints_are_all_damped_is_asymptotically_stable(name):
    assert answer(name).verdict == "asymptotically stable"


@pytest.mark.parametrize("name", [n for n in GENERATED if "damped" not in n or "floating" in n])
def test_a_chain_without_dampers_or_without_ground_is_marginally_stable(name):
    assert answer(name).verdict == "marginally stable"


@pytest.mark.parametrize("name", EXACT)
def test_the_shares_of_the_bodies_in_the_kinetic_energy_sum_to_one(name):
    moving = [e for e in answer(name).eigenvalues if e.participation]
    assert moving
    for e in moving:
        assert sum(e.participation.values()) == pytest.approx(1.0, rel=1e-9)


def test_an_unknown_method_is_named():
    with pytest.raises(UsageError, match=r"unknown method 'qr'\nhint: one of nullspace, index3, paper"):
        shipped("pendulum").eig("qr")
    assert METHODS == ("nullspace", "index3", "paper")
