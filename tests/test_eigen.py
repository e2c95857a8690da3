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
from mbstab.analysis.eigen import deflate_neutral, matched
from mbstab.analysis.methods import METHODS
from mbstab.errors import UsageError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
# Of a periodic motion there are multipliers, not eigenvalues of constant coefficients; tests/test_floquet.py has those.
PERIODIC = {"kapitza"}
CONSTANT = sorted(set(MODELS) - PERIODIC)


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


def double_pendulum(**p):
    return [s for root in (-1.0, 1.0) for s in pair(-(2.0 + root * math.sqrt(2.0)) * p["g"] / p["l"])]


def four_bar(**p):
    # Two rods turn about their ends, the coupler moves with the pins: (2/3 + 1) m l² θ'' = −(1/2 + 1/2 + 1) m g l θ.
    return pair(-2.0 * p["g"] / ((2.0 / 3.0 + 1.0) * p["l"]))


def slider_crank(r, m_c, m_r, k, c):
    # The rod turns with −r/l of the crank about a wrist pin that stands still: its l drops out.
    J = (m_c + m_r) * r**2 / 3.0
    root = cmath.sqrt(c**2 - 4.0 * J * k)
    return [(-c + root) / (2.0 * J), (-c - root) / (2.0 * J)]


def sleigh(**p):
    return [-p["m"] * p["a"] * p["v"] / (p["I"] + p["m"] * p["a"] ** 2)]


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
    "body-middle": (
        "free_rigid_body",
        {"I1": 1.0, "I2": 2.0, "I3": 3.0, "Omega": 2.0},
        free_rigid_body,
        12,
        8,
        "unstable",
    ),
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

# Turning scenes whose frame carries neutral pairs around, and others that the examples have at rest.
UNIFORM_DISC = """\
mbstab: 1
gravity: [0, 0, -1]
parameters: {lean: 0.3, yaw: 0.7}
bodies:
  disc: {type: spatial, mass: 1, inertia: [1/4, 1/4, 1/2]}
contacts:
  rolling: {type: wheel, center: disc, axle: z, radius: 1}
reference:
  find: steady
  steady: {axis: z, rate: yaw}
  coordinates: {disc: {x: 0, phi: pi/2 + lean, theta: 0, psi: 0}}
  guess: {disc: {y: 2, z: cos(lean)}}
"""
SPINNING_STONE = (
    MODELS["rattleback"]
    .read_text(encoding="utf-8")
    .replace("omega: {value: 0,", "omega: {value: 5,")
    .replace(
        "  rates:\n    stone: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: omega}", "  steady: {axis: z, rate: omega}"
    )
)
# Two masses on a spring, which go round each other and may drift through the plane together.
DRIFTING_PAIR = """\
mbstab: 1
parameters: {Omega: 3, l: 0.8, k: 40, m: 1, n: 2.5, mu: m*n/(m + n)}
bodies:
  one: {type: planar_point, mass: m}
  two: {type: planar_point, mass: n}
forces:
  spring: {type: spring, between: [one, two], stiffness: k, length: l - mu*l*Omega**2/k}
reference:
  steady: {axis: z, rate: Omega, point: [0.4, -1]}
  coordinates: {one: {x: 0.4 - l*n/(m + n), y: -1}, two: {x: 0.4 + l*m/(m + n), y: -1}}
"""
TURNING = {"disc-on-a-circle": UNIFORM_DISC, "spinning-stone": SPINNING_STONE, "drifting-pair": DRIFTING_PAIR}
TEXTS = {**GENERATED, **TURNING}
EXACT = [*CONSTANT, *TEXTS]


@functools.cache
def mechanism(name):
    return shipped(name) if name in MODELS else mbstab.loads(TEXTS[name], name)


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


@pytest.mark.parametrize("method", list(METHODS)[1:])
@pytest.mark.parametrize("name", GENERATED)
def test_the_undeflated_methods_lie_within_their_own_error_bounds(name, method):
    errors, bounds, _ = errors_and_bounds(answer(name, method), truth(name)[0])
    np.testing.assert_array_less(errors, bounds)


# Small inertias beside stiff springs, dampers of 4e4 N s/m: some infinite eigenvalues come out finite, which is said.
INVENTED = {("andrews_squeezer", "index3"), ("flyball_governor", "index3"), ("flyball_governor", "paper")}


@pytest.mark.parametrize("method", ["index3", "paper"])
@pytest.mark.parametrize("name", [*CONSTANT, *TURNING])
def test_the_methods_agree_on_the_examples_within_their_error_bounds(name, method):
    if method == "index3" and mechanism(name).motion().redundant:
        pytest.skip("its pencil is singular: see the test of redundant rows")
    if (name, method) in INVENTED:
        assert answer(name, method).verdict == "undecided"
        assert answer(name, method).counts.found > answer(name, method).counts.expected
        return
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
    with pytest.raises(UsageError, match=r"unknown method 'qr'\nhint: one of nullspace, index3, paper, augmented, "):
        shipped("pendulum").eig("qr")


# --- the verdict ----------------------------------------------------------------------------------------------------

CRITICAL_TOP = "2*sqrt((I_x + m*H**2)*m*g*H)/I_z"
CRITICAL_DISK = "sqrt(m*g*R*I_t/(I_a*(I_a + m*R**2)))"
CRITICAL_TORUS = "rho*sqrt(m*g*R*I_t/(I_a*(I_a + m*rho**2)))"

# An inverted pendulum held up by a torsional spring of the stiffness m g l: Euler's load on a strut with one hinge.
STRUT = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {m: 2, l: 0.5, k: m*9.81*l}
bodies:
  strut: {type: planar, mass: m, inertia: 0.1, points: {O: [0, -l]}}
joints:
  hinge: {type: revolute, between: [strut.O, ground]}
forces:
  spring: {type: joint_spring, joint: hinge, stiffness: k}
reference:
  coordinates: {strut: {x: 0, y: l, theta: 0}}
"""

# A point mass on a rod in a vertical plane that turns at Ω about the vertical, leaning out at cos θ = g/(l Ω²).
DRIVEN_PLANE = """\
mbstab: 1
gravity: [0, 0, -9.81]
parameters: {l: 0.5, Omega: 8, lean: acos(9.81/(l*Omega**2)), k: 0, place: 2}
bodies:
  bob: {type: point, mass: 1}
joints:
  rod: {type: distance, between: [bob, ground], length: l}
forces:
  spring: {type: spring, between: [bob, {body: ground, point: [place, 0, 0]}], stiffness: k, length: 0.1}
constraints:
  plane: {holonomic: "bob.y*cos(Omega*t) - bob.x*sin(Omega*t)"}
reference:
  coordinates: {bob: {x: l*sin(lean), y: 0, z: -l*cos(lean)}}
  rates: {bob: {x: 0, y: Omega*l*sin(lean), z: 0}}
"""
DECLARED_PLANE = re.sub(r"  rates: .*", "  steady: {axis: z, rate: Omega}", DRIVEN_PLANE)
# The same with angles that stand still: φ turns about the vertical, θ leans out, ψ is held.
DRIVEN_PLANE_AT_REST = """\
mbstab: 1
gravity: [9.81, 0, 0]
parameters: {l: 0.5, Omega: 8, lean: acos(9.81/(l*Omega**2))}
bodies:
  bob: {type: spatial, mass: 1, inertia: [0, 0, 0], center_of_mass: [l, 0, 0]}
joints:
  pivot: {type: spherical, between: [bob, ground]}
drives:
  plane: {type: coordinate, coordinate: bob.phi, position: Omega*t}
  twist: {type: coordinate, coordinate: bob.psi, position: "0"}
reference:
  coordinates: {bob: {x: 0, y: 0, z: 0, phi: 0, theta: lean, psi: 0}}
  rates: {bob: {x: 0, y: 0, z: 0, phi: Omega, theta: 0, psi: 0}}
"""

PENDULUM = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {turn: 0, lift: 0}
bodies:
  rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [-1, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
forces:
  lift: {type: force, at: rod, vector: [0, lift*sin(7*t)]}
reference:
  coordinates: {rod: {x: 0, y: -1, theta: -pi/2}}
  rates: {rod: {theta: turn}}
"""

# A mass on a spring that a given force pushes: it does not stay at rest, but its equations are linear.
PUSHED_MASS = """\
mbstab: 1
bodies:
  mass: {type: planar_point, mass: 2}
forces:
  push: {type: force, at: mass, vector: [0, sin(7*t)]}
  spring: {type: expression, on: {mass.x: -3*mass.x, mass.y: -8*mass.y}}
reference:
  coordinates: {mass: {x: 0, y: 0}}
"""


def test_a_double_pair_on_the_imaginary_axis_is_undecided():
    result = shipped("top").eig(omega=CRITICAL_TOP)
    assert result.verdict == "undecided"
    assert "too close to another one to be placed on it" in result.reasons[0]
    exact = math.sqrt(0.01 * 9.81 * 0.04 / (3e-4 + 0.01 * 0.04**2))
    np.testing.assert_allclose(np.abs(result.values()), exact, rtol=1e-7, atol=0.0)


@pytest.mark.parametrize(
    ("name", "parameters"), [("rolling_disk", {"omega": CRITICAL_DISK}), ("rolling_torus", {"v": CRITICAL_TORUS})]
)
def test_two_zero_eigenvalues_too_many_at_the_critical_speed_are_undecided(name, parameters):
    usual, critical = shipped(name).eig().counts.neutral, shipped(name).eig(**parameters)
    assert critical.verdict == "undecided"
    assert critical.counts.neutral == usual + 2
    assert "form a chain of length 5, longer than symmetries explain: a critical state" in critical.reasons[0]


@pytest.mark.parametrize("factor", [1.0 - 1e-9, 1.0 + 1e-9])
@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("top", "omega", CRITICAL_TOP),
        ("rolling_disk", "omega", CRITICAL_DISK),
        ("rolling_torus", "v", CRITICAL_TORUS),
    ],
)
def test_the_verdict_is_right_a_billionth_beside_the_critical_value(name, parameter, value, factor):
    expected = "unstable" if factor < 1.0 else "marginally stable"
    assert shipped(name).eig(**{parameter: f"{factor!r}*({value})"}).verdict == expected


def test_the_buckling_load_is_undecided_because_no_symmetry_explains_its_zeros():
    result = mbstab.loads(STRUT).eig()
    assert result.verdict == "undecided"
    assert result.counts.neutral == 2
    assert result.chains == (1, 1)
    assert "2 eigenvalues are zero, but 0 symmetries explain 0 at most: a critical state" in result.reasons[0]


@pytest.mark.parametrize(("k", "verdict"), [(9.82, "marginally stable"), (9.8, "unstable")])
def test_the_strut_stands_above_the_critical_stiffness_and_falls_below_it(k, verdict):
    result = mbstab.loads(STRUT).eig(k=k)
    assert result.verdict == verdict
    assert_matched(result.values(), pair(-(k - 2 * 9.81 * 0.5) / (0.1 + 2 * 0.5**2)), rtol=1e-12)


def test_a_reference_that_turns_has_the_eigenvalues_of_the_frame_that_turns_with_it():
    result = mbstab.loads(DECLARED_PLANE).eig()
    assert result.verdict == "marginally stable"
    assert result.frame == "rotation about z at 8 rad/s"
    assert_matched(result.values(), [7.61480424896136j, -7.61480424896136j], rtol=1e-13)


def test_it_is_undecided_as_frozen_in_time():
    result = mbstab.loads(DECLARED_PLANE).eig(frozen=True)
    assert result.verdict == "undecided"
    assert result.reasons[0].startswith("frozen-time (asked for): not a stability verdict; the coefficients")
    # The eigenvalues at one instant are indeed not those of the motion.
    assert_matched(result.values(), [8j, -8j], rtol=1e-13)


def test_a_spring_to_the_ground_off_the_axis_makes_the_motion_unsteady_and_undecided():
    result = mbstab.loads(DRIVEN_PLANE).eig(k=3)
    assert result.verdict == "undecided"
    assert re.match(r"frozen-time: not a stability verdict; .* change by \d+\.\d% along the motion", result.reasons[0])
    assert result.frame == ""


# Gallery models whose motion turns in fixed coordinates; the others stand still in theirs.
IN_TURNING_FRAMES = {
    "governor": {"omega": 10},
    "governor_paper": {"omega": 30},
    "rotating_pendulum": {},
    "bead_on_hoop": {"Omega": 6, "theta": 1},
    "rattleback": {"omega": 5},
}


@pytest.mark.parametrize("name", IN_TURNING_FRAMES)
def test_what_turns_in_fixed_coordinates_is_undecided_if_frozen_and_says_by_how_much(name):
    parameters = IN_TURNING_FRAMES[name]
    result = shipped(name).eig(frozen=True, **parameters)
    assert result.frozen
    assert result.verdict == "undecided"
    assert result.frame == ""
    change = re.match(r"frozen-time \(asked for\): .* change by ([\d.]+)% along the motion$", result.reasons[0])
    assert float(change[1]) > 1.0
    steady = shipped(name).eig(**parameters)
    assert not steady.frozen
    assert steady.frame.startswith("rotation about z at ")
    assert matched(result.values(), steady.values()).max() > 1e-3 * np.abs(steady.values()).max()


@pytest.mark.parametrize("name", CONSTANT)
def test_no_example_is_frozen_in_time(name):
    assert not answer(name).frozen
    variation = mechanism(name).linearize().variation
    # Forces of springs of 8e5 N/m round where the steady motion is turned on.
    assert variation == 0.0 or (name == "flyball_governor" and variation < 1e-15)
    if name not in {*IN_TURNING_FRAMES, "flyball_governor"} or mechanism(name).motion().at_rest:
        # In its own coordinates it stands still: frozen and steady are the same.
        frozen = mechanism(name).eig(frozen=True)
        assert not frozen.frozen
        assert frozen.verdict == answer(name).verdict


def test_the_same_motion_in_angles_that_stand_still_has_the_true_eigenvalues():
    result = mbstab.loads(DRIVEN_PLANE_AT_REST).eig()
    assert result.verdict == "marginally stable"
    assert_matched(result.values(), [7.61480424896136j, -7.61480424896136j], rtol=1e-13)


@pytest.mark.parametrize("turn", [2.0, -1e-5])
def test_a_swinging_pendulum_is_undecided_as_frozen_in_time(turn):
    result = mbstab.loads(PENDULUM).eig(turn=turn)
    assert result.verdict == "undecided"
    assert result.reasons[0].startswith("frozen-time: ")


def test_a_pendulum_at_rest_whose_weight_changes_with_time_is_undecided_as_frozen_in_time():
    result = mbstab.loads(PENDULUM).eig(lift=5)
    assert result.verdict == "undecided"
    assert result.reasons[0].startswith("frozen-time: ")
    assert mbstab.loads(PENDULUM).eig().verdict == "marginally stable"


def test_a_given_force_on_linear_equations_leaves_their_coefficients_constant():
    result = mbstab.loads(PUSHED_MASS).eig()
    assert result.verdict == "marginally stable"
    assert_matched(result.values(), [2j, -2j, math.sqrt(1.5) * 1j, -math.sqrt(1.5) * 1j], rtol=1e-13)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("top", {"omega": 1e-3}),
        ("top", {"omega": 1e5}),
        ("rolling_disk", {"omega": 0.1}),
        ("rolling_disk", {"omega": 1e4}),
        ("rolling_torus", {"v": 1e-3}),
        ("rolling_torus", {"v": 1e3}),
        ("chaplygin_sleigh", {"v": 1e-6}),
        ("chaplygin_sleigh", {"v": -1e6}),
        ("free_rigid_body", {"Omega": 1e-3}),
        ("free_rigid_body", {"Omega": 1e6}),
        ("trailer", {"v": 1e-3}),
        ("trailer", {"v": -1e4}),
    ],
)
def test_a_steady_motion_is_not_frozen_in_time(name, parameters):
    assert shipped(name).linearize(**parameters).variation == 0.0


# --- steady turns and neutral pairs ---------------------------------------------------------------------------------


def disc_balance(lean, yaw, spin):
    """What vanishes on a circle (SymPy's test of linearize): q1 the yaw, q2 the lean, q3 the turn about the axle.

    There the axle points to where ours comes from, so q3' = −spin.
    """
    return 4 / 5 * math.sin(lean) + math.sin(2 * lean) * yaw**2 / 2 - 6 / 5 * math.cos(lean) * yaw * spin


TRIMS = {
    # Found besides the spin: the place, the place and the yaw at a given rate of psi, or the lean.
    "place": UNIFORM_DISC,
    "yaw": UNIFORM_DISC.replace("axis: z, rate: yaw}", "axis: z}\n  rates: {disc: {psi: yaw}}"),
    "lean": UNIFORM_DISC.replace("{x: 0, phi: pi/2 + lean,", "{x: 0, y: 2,").replace(
        "{y: 2, z: cos(lean)}", "{phi: pi/2 + lean, z: cos(lean)}"
    ),
}


@pytest.mark.parametrize("found", TRIMS)
@pytest.mark.parametrize(("lean", "yaw"), [(0.3, 0.7), (-0.2, 1.3), (0.5, -0.9), (1.2, 2.0)])
def test_a_disc_rolls_on_a_circle_with_the_lean_that_balances_it(found, lean, yaw):
    if found != "place":
        lean, yaw = abs(lean), abs(yaw)
    motion = mbstab.loads(TRIMS[found]).motion(lean=lean, yaw=yaw)
    (generator,) = motion.generators
    lean = motion.q[3] - math.pi / 2
    assert generator.spins[5] != 0.0
    assert abs(disc_balance(lean, generator.rate, generator.spins[5])) < 1e-12
    # It rolls: the axle at its centre and the contact go round the same axis.
    assert motion.q[2] == pytest.approx(math.cos(lean), abs=1e-12)
    contact = motion.q[1] + math.sin(lean)
    assert generator.rate * contact == pytest.approx(generator.spins[5], abs=1e-12)


def test_shifts_of_a_disc_on_a_circle_are_a_neutral_pair_at_the_rate_of_the_frame():
    result = answer("disc-on-a-circle")
    pairs = [e.value for e in result.eigenvalues if e.kind == "neutral" and e.value]
    assert pairs == [0.7j, -0.7j]
    assert result.shifts == (0.7,)
    assert result.counts.neutral == 6


def test_the_drift_of_a_pair_that_turns_is_a_double_neutral_pair():
    result = answer("drifting-pair")
    assert result.shifts == (3.0, 3.0)
    assert result.counts.neutral == 6
    assert result.chains == (1, 1)
    # The distance moves in the effective potential of the turn.
    assert_matched(result.values(), pair(-(3.0 * 3.0**2 + 40.0 / (2.5 / 3.5))), rtol=1e-12)
    assert result.verdict == "marginally stable"


def test_a_free_body_has_a_third_pair_at_the_rate_of_its_frame_and_keeps_the_digits_of_the_others():
    text = """\
mbstab: 1
bodies:
  body: {type: spatial, mass: 2, inertia: [1, 2, 2.7]}
reference:
  steady: {axis: z, rate: 3, point: [0.4, -1, 0]}
  coordinates: {body: {x: 0.4, y: -1, z: 0, phi: 0, theta: 0, psi: 0.3}}
"""
    result = mbstab.loads(text).eig()
    # Shift and drift across the axis, and a tilt of the axis itself: not to be told apart by the frequency alone.
    possible = np.array([0, 3j, -3j, *pair(3.0**2 * (2.7 - 1.0) * (2.0 - 2.7) / (1.0 * 2.0))])
    assert len(result.eigenvalues) == 12
    for e in result.eigenvalues:
        assert np.min(np.abs(possible - e.value)) < 1e-12
    assert result.verdict == "marginally stable"


STONE = [
    complex(real, sign * imag)
    for real, imag in ((0.2025212833, 34.1436916659), (-2.1206923979, 109.3923228379))
    for sign in (1, -1)
]


@pytest.mark.parametrize("omega", [5, -5])
def test_a_rattleback_that_spins_one_way_is_the_negative_of_the_other(omega):
    result = shipped("rattleback").eig(omega=omega)
    expected = np.array(STONE) * (1 if omega > 0 else -1)
    assert_matched(result.values(), expected, rtol=1e-11)
    assert result.shifts == (5.0,)
    assert [e.value for e in result.eigenvalues if e.kind == "neutral"] == [0j, 0j, 5j, -5j]
    assert result.verdict == "unstable"
    other = shipped("rattleback").eig(omega=-omega)
    assert_matched(other.values(), -result.values(), rtol=1e-10)


@pytest.mark.parametrize("method", list(METHODS)[1:])
@pytest.mark.parametrize("name", TURNING)
def test_other_methods_find_the_same_neutral_eigenvalues(name, method):
    result = answer(name, method)
    assert result.counts.neutral == answer(name).counts.neutral
    assert sum(e.kind == "neutral" for e in result.eigenvalues) == result.counts.neutral


def test_the_regular_pencil_of_redundant_rows_is_singular_and_says_so():
    result = answer("bricard", "index3")
    assert result.verdict == "undecided"
    assert "2 finite eigenvalues exist, the method returned 0; use --method nullspace" in result.reasons
    assert result.counts.undefined > 0


# --- extremes -------------------------------------------------------------------------------------------------------


def growing_masses(reverse, number):
    masses = [10.0**i for i in range(10)]
    return hanging_chain(np.random.default_rng([10, number]), 10, masses=masses[::-1] if reverse else masses)


EXTREMES = {
    # Text, relative error of all eigenvalues.
    **{f"masses-growing-downwards-{n}": (growing_masses(False, n), 1e-13) for n in range(3)},
    **{f"masses-growing-upwards-{n}": (growing_masses(True, n), 1e-13) for n in range(3)},
    "lengths-1e-6": (hanging_chain(np.random.default_rng(1), 4, size=1e-6), 1e-13),
    "lengths-1e6": (hanging_chain(np.random.default_rng(2), 4, size=1e6), 1e-13),
    "lengths-1e-6-damped": (
        hanging_chain(np.random.default_rng(3), 4, size=1e-6, stiffness=1e-11, damping=1e-13),
        1e-12,
    ),
    "stiffness-1e12": (hanging_chain(np.random.default_rng(4), 4, stiffness=1e12), 1e-13),
    "stiffness-1e12-one-soft-joint": (
        re.sub(
            r"(spring_2: .*stiffness: )\S+,",
            r"\g<1>1.5,",
            hanging_chain(np.random.default_rng(5), 3, stiffness=1e12),
        ),
        1e-4,  # the soft spring and a stiff one stand in one sum, which knows the soft one to 1e12 roundings
    ),
    "inertia-1e12": (
        re.sub(
            r"(link_2: {type: planar, mass: \S+ inertia: )\S+,",
            r"\g<1>1e12,",
            hanging_chain(np.random.default_rng(6), 3),
        ),
        1e-13,  # the squares of the frequencies lie twelve orders apart
    ),
    "inertia-1e-12": (
        re.sub(
            r"(link_2: {type: planar, mass: \S+ inertia: )\S+,",
            r"\g<1>1e-12,",
            hanging_chain(np.random.default_rng(7), 3),
        ),
        1e-13,
    ),
}


@pytest.mark.parametrize("case", EXTREMES)
def test_extreme_numbers_keep_accuracy_and_bounds(case):
    text, accuracy = EXTREMES[case]
    model = mbstab.loads(text, case)
    exact, zeros = exact_eigenvalues(model.model)
    result = model.eig()
    errors, bounds, sizes = errors_and_bounds(result, exact)
    np.testing.assert_array_less(errors, bounds)
    np.testing.assert_array_less(errors / sizes, accuracy)
    assert (result.counts.neutral, zeros) == (0, 0)
    assert result.verdict == ("asymptotically stable" if "-damped" in case else "marginally stable")


# --- the staircase of zero eigenvalues ------------------------------------------------------------------------------

# Jordan blocks at zero: their sizes, and how many eigenvalues each step of the staircase must find.
JORDAN = {
    "one": ([1], (1,)),
    "1-1": ([1, 1], (2,)),
    "2": ([2], (1, 1)),
    "2-2-1": ([2, 2, 1], (3, 2)),
    "3-2-1": ([3, 2, 1], (3, 2, 1)),
    "4-4": ([4, 4], (2, 2, 2, 2)),
    "5": ([5], (1, 1, 1, 1, 1)),
}
OTHERS = np.array([-1.0, 0.7, -0.3])
SLOW = {"1e-3": 1e-3, "1e-6": 1e-6}


def staircase(rng, sizes, others):
    """Return a matrix with these Jordan blocks at zero and these other eigenvalues, turned by an orthogonal matrix.

    The chains at zero are coupled to the other directions so that the condition numbers of these stay near 1: turning
    rounds the matrix, and no algorithm knows its eigenvalues better than condition number times rounding.
    """
    n, k = sum(sizes) + len(others), sum(sizes)
    J = np.zeros((n, n))
    J[:k, k:] = rng.uniform(-1.0, 1.0, (k, n - k)) * np.abs(others) ** max(sizes)
    J[range(k, n), range(k, n)] = others
    start = 0
    for size in sizes:
        J[range(start, start + size - 1), range(start + 1, start + size)] = 1.0
        start += size
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return Q @ J @ Q.T


@pytest.mark.parametrize("blocks", JORDAN)
@pytest.mark.parametrize("number", range(5))
def test_the_staircase_finds_the_jordan_blocks_at_zero(blocks, number):
    sizes, steps = JORDAN[blocks]
    S = staircase(np.random.default_rng([number, len(sizes)]), sizes, OTHERS)
    deflated = deflate_neutral(S)
    assert deflated.steps == steps
    assert deflated.undecided == ""
    k = sum(steps)
    np.testing.assert_allclose(deflated.Q @ deflated.Q.T, np.eye(len(S)), rtol=0.0, atol=1e-14)
    whole = np.block([[deflated.neutral, deflated.coupling], [np.zeros((len(S) - k, k)), deflated.S]])
    np.testing.assert_allclose(deflated.Q @ whole @ deflated.Q.T, S, rtol=0.0, atol=1e-13)
    assert np.abs(np.linalg.matrix_power(deflated.neutral, len(steps))).max() == 0.0
    assert_matched(np.linalg.eigvals(deflated.S), OTHERS, rtol=1e-12)


@pytest.mark.parametrize("blocks", [name for name, (sizes, _) in JORDAN.items() if max(sizes) <= 3])
@pytest.mark.parametrize("slow", SLOW)
def test_slow_eigenvalues_beside_zeros_keep_the_digits_that_the_matrix_has(blocks, slow):
    sizes, steps = JORDAN[blocks]
    s = SLOW[slow]
    S = staircase(np.random.default_rng(8), sizes, np.array([-1.0, s, -s / 3.0]))
    deflated = deflate_neutral(S)
    assert deflated.steps == steps
    assert deflated.undecided == ""
    found = np.linalg.eigvals(deflated.S)
    # A few 1e-16 of the norm, 1, is the rounding of the matrix itself.
    assert_matched(found, [-1.0, s, -s / 3.0], rtol=1e-14 / s)


@pytest.mark.parametrize("small", [3e-14, 3e-13])
def test_small_singular_values_without_a_gap_are_undecided(small):
    S = staircase(np.random.default_rng(9), [1], np.array([-1.0, 2e-15, small]))
    deflated = deflate_neutral(S)
    assert deflated.steps == (2,)
    assert re.fullmatch(
        r"2 eigenvalues are close to zero without a gap \(singular values \S+ and \S+ 1/s\): "
        "neutral or merely slow cannot be told in double precision",
        deflated.undecided,
    )


def soft_springs(slow, fast=-1.0):
    """Return two masses on springs, one so soft that it can still be told from none, the other from neither."""
    springs = f"{{m.x: {fast}*m.x, m.y: -4e-15*m.y, n.x: {slow}*n.x, n.y: -n.y}}"
    return (
        "mbstab: 1\nbodies: {m: {type: planar_point, mass: 1}, n: {type: planar_point, mass: 1}}\n"
        f"forces: {{springs: {{type: expression, on: {springs}}}}}\n"
        "reference: {coordinates: {m: {x: 0, y: 0}, n: {x: 0, y: 0}}}\n"
    )


@pytest.mark.parametrize(("slow", "verdict"), [(-4e-13, "undecided"), (4e-13, "unstable")])
def test_what_is_slow_by_itself_is_told_from_zero_where_the_matrix_has_no_gap(slow, verdict):
    result = mbstab.loads(soft_springs(slow)).eig()
    assert result.verdict == verdict
    values = np.array([e.value for e in result.eigenvalues])
    expected = [sign * cmath.sqrt(k) for k in (-4e-15, slow, -1.0, -1.0) for sign in (1.0, -1.0)]
    errors, bounds = matched(values, expected), np.array([e.error_bound for e in result.eigenvalues])
    assert np.all(errors <= np.max(bounds))


def test_what_grows_fast_is_unstable_even_where_zeros_have_no_gap():
    assert mbstab.loads(soft_springs(4e-13, fast=1.0)).eig().verdict == "unstable"


def test_a_matrix_of_zeros_is_all_neutral():
    assert deflate_neutral(np.zeros((4, 4))).steps == (4,)
    assert deflate_neutral(np.zeros((0, 0))).steps == ()


def test_pairing_does_not_depend_on_the_order():
    expected = np.array([1e-16 + 2j, -1e-16 - 2j, 3.0, -1e-17 + 2.5j])
    np.testing.assert_array_equal(matched(expected[[3, 1, 0, 2]], expected), np.zeros(4))
