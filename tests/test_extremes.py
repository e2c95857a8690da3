"""Numbers at the extremes: how many digits are kept, whether the bounds say so, and what is refused instead."""

import functools
import re

import mpmath
import numpy as np
import pytest
from chains import hanging_chain, spring_chain
from mpmath import mp
from truth import ZERO, distance, exact_eigenvalues

import mbstab
from mbstab.errors import MbstabError
from mbstab.model.library import installed_models

MODELS = {path.stem: path.read_text(encoding="utf-8") for path in installed_models()}
EPS = float(np.finfo(float).eps)


# --- closed forms in 50 digits --------------------------------------------------------------------------------------


def pair(square):
    root = mp.sqrt(mp.mpc(square))
    return [root, -root]


def top(omega):
    H, m, I_x, I_z, g = map(mp.mpf, ("0.04", "0.01", "3e-4", "4e-4", "9.81"))
    A, spin = I_x + m * H**2, 1j * I_z * mp.mpf(omega)
    root = mp.sqrt(4 * A * m * g * H + spin**2)
    values = [(spin + root) / (2 * A), (spin - root) / (2 * A)]
    return [*values, *(mp.conj(s) for s in values)]


def disk(omega):
    R, W, m, g = map(mp.mpf, ("0.3", "0.05", "2", "9.81"))
    I_t, I_a = m * (3 * R**2 + W**2) / 12, m * R**2 / 2
    return pair((m * g * R * I_t - I_a * (I_a + m * R**2) * mp.mpf(omega) ** 2) / (I_t * (I_t + m * R**2)))


def pendulum(L):
    return pair(-3 * mp.mpf("9.81") / (4 * mp.mpf(L)))


def ziegler(P):
    p = mp.mpf(P)
    root = mp.sqrt(mp.mpc((7 - 2 * p) ** 2 - 8))
    return [s for sign in (1, -1) for s in pair((2 * p - 7 + sign * root) / 4)]


def critical(closed_form):
    with mp.workdps(60):
        if closed_form is top:
            H, m, I_x, I_z, g = map(mp.mpf, ("0.04", "0.01", "3e-4", "4e-4", "9.81"))
            return 2 * mp.sqrt((I_x + m * H**2) * m * g * H) / I_z
        if closed_form is disk:
            R, W, m, g = map(mp.mpf, ("0.3", "0.05", "2", "9.81"))
            I_t, I_a = m * (3 * R**2 + W**2) / 12, m * R**2 / 2
            return mp.sqrt(m * g * R * I_t / (I_a * (I_a + m * R**2)))
        return mp.mpf(7) / 2 - mp.sqrt(2)


def rounded(number):
    """Return the text of a double, which both arithmetics read as the same number."""
    return repr(float(number))


# --- texts ----------------------------------------------------------------------------------------------------------


def plumb_line(links, length="1", mass="1"):
    """Return the text of a chain of rods without mass with a point mass at the end of each."""
    link = f"{{type: planar, mass: {mass}, inertia: 0, points: {{A: [0, {length}]}}}}"
    bodies = [f"  b{i}: {link}" for i in range(links)]
    joints = [f"  j{i}: {{type: revolute, between: [b{i}.A, {f'b{i - 1}' if i else 'ground'}]}}" for i in range(links)]
    places = [f"    b{i}: {{x: 0, y: -{i + 1}*{length}, theta: 0}}" for i in range(links)]
    return "\n".join(
        ["mbstab: 1", "gravity: [0, -9.81]", "bodies:", *bodies, "joints:", *joints]
        + ["reference:", "  coordinates:", *places, ""]
    )


@functools.cache
def laguerre_roots(n):
    """Return the zeros of the Laguerre polynomial: squared frequencies of a plumb line in units of g/l."""
    start = np.linalg.eigvalsh(np.diag(2.0 * np.arange(n) + 1.0) + np.diag(np.arange(1.0, n), 1) + np.diag(np.arange(1.0, n), -1))
    roots = []
    for x in start:
        x = mp.mpf(float(x))
        for _ in range(8):
            before, now = mp.mpf(1), 1 - x
            for k in range(1, n):
                before, now = now, ((2 * k + 1 - x) * now - k * before) / (k + 1)
            step = now * x / (n * (now - before)) if n > 1 else -(1 - x)
            x -= step
            if abs(step) < mp.mpf(10) ** -45 * abs(x):
                break
        roots.append(x)
    return roots


def plumb_line_eigenvalues(links, length="1"):
    return [s for x in laguerre_roots(links) for s in pair(-x * mp.mpf("9.81") / mp.mpf(length))]


TILTED = """\
mbstab: 1
parameters: {d: 0.1, tilt: pi/2 - d}
gravity: [0, 0, -9.81]
bodies:
  b: {type: spatial, mass: 2, inertia: [0.3, 0.4, 0.5], center_of_mass: [0.7*sin(tilt), 0, -0.7*cos(tilt)]}
joints:
  pivot: {type: spherical, between: [b, ground]}
reference:
  coordinates: {b: {x: 0, y: 0, z: 0, phi: 0, theta: tilt, psi: 0}}
"""


def tilted(d):
    """The tensor is that of the body's frame, so it turns with theta: 3x3 quadratic problem about the pivot."""
    with mp.workdps(60):
        t = mp.pi / 2 - mp.mpf(d)
        c, s = mp.cos(t), mp.sin(t)
        A = mp.matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        inertia = A * mp.diag([mp.mpf("0.3"), mp.mpf("0.4"), mp.mpf("0.5")]) * A.T
        m, l, g = mp.mpf(2), mp.mpf("0.7"), mp.mpf("9.81")
        for k in (0, 1):
            inertia[k, k] += m * l * l
        # About the vertical nothing resists: eliminated.
        x, y, z = inertia[0, 0] - inertia[0, 2] ** 2 / inertia[2, 2], inertia[1, 1], inertia[2, 2]
        assert inertia[1, 2] == 0 and z > 0
        return [*pair(-m * g * l / x), *pair(-m * g * l / y)]


LINKAGE = """\
mbstab: 1
parameters: {a: 0.1}
gravity: [9.81*cos(a), 9.81*sin(a)]
ground: {points: {B: [1, 0]}}
bodies:
  left: {type: planar, mass: 1, shape: {type: rod, length: 1}, points: {A: [-0.5, 0], C: [0.5, 0]}}
  right: {type: planar, mass: 1, shape: {type: rod, length: 1}, points: {B: [-0.5, 0], D: [0.5, 0]}}
  coupler: {type: planar, mass: 1, shape: {type: rod, length: 1}, points: {C: [-0.5, 0], D: [0.5, 0]}}
joints:
  A: {type: revolute, between: [left.A, ground]}
  B: {type: revolute, between: [right.B, ground.B]}
  C: {type: revolute, between: [coupler.C, left.C]}
  D: {type: revolute, between: [coupler.D, right.D]}
reference:
  coordinates:
    left: {x: cos(a)/2, y: sin(a)/2, theta: a}
    right: {x: 1 + cos(a)/2, y: sin(a)/2, theta: a}
    coupler: {x: 1/2 + cos(a), y: sin(a), theta: 0}
"""

# A door on two hinges, the second one turned by a small angle and moved by as much.
DOOR = """\
mbstab: 1
parameters: {e: 0}
gravity: [0, -9.81, 0]
bodies:
  door: {type: spatial, mass: 3, inertia: [0.2, 0.3, 0.4], center_of_mass: [0, -0.5, 0], points: {H: [0, 0, 1]}}
joints:
  one: {type: revolute, between: [door, ground], axis: z}
  two: {type: revolute, between: [door.H, {body: ground, point: [0, 0, 1]}], axis: [[sin(e), 0, cos(e)], [sin(e), 0, cos(e)]]}
reference:
  coordinates: {door: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
"""

# Two pins of one link, a small distance apart.
PINS = """\
mbstab: 1
parameters: {e: 0}
gravity: [0, -9.81]
bodies:
  link: {type: planar, mass: 3, inertia: 0.2, center_of_mass: [0, -0.5], points: {P: [e, 0]}}
joints:
  one: {type: revolute, between: [link, ground]}
  two: {type: revolute, between: [link.P, {body: ground, point: [e, 0]}]}
reference:
  coordinates: {link: {x: 0, y: 0, theta: 0}}
"""


def without_turning_inertia(text, numbers):
    for i in numbers:
        text = re.sub(rf"(link_{i}: {{type: planar, mass: \S+ inertia: )\S+,", r"\g<1>0,", text)
    return text


def chain(number, links, **options):
    return hanging_chain(np.random.default_rng(number), links, **options)


def with_inertia(text, link, value):
    return re.sub(rf"(link_{link}: {{type: planar, mass: \S+ inertia: )\S+,", rf"\g<1>{value},", text)


def with_stiffness(text, joint, value):
    return re.sub(rf"(spring_{joint}: .*stiffness: )\S+,", rf"\g<1>{value},", text)


def growing(number, reverse=False):
    masses = [10.0**i for i in range(10)]
    return chain([10, number], 10, masses=masses[::-1] if reverse else masses)


# --- cases: text, parameters, closed form or None -------------------------------------------------------------------

CASES = {
    "masses 1 : 1e12, heavy below": (chain(11, 2, masses=[1.0, 1e12]), {}, None),
    "masses 1e12 : 1, light below": (chain(12, 2, masses=[1e12, 1.0]), {}, None),
    "masses 1 : 1e12 : 1": (chain(13, 3, masses=[1.0, 1e12, 1.0]), {}, None),
    "masses 1e-12 : 1": (chain(14, 3, masses=[1.0, 1e-12, 1.0]), {}, None),
    "inertia 1e12": (with_inertia(chain(6, 3), 2, "1e12"), {}, None),
    "inertia 1e-12": (with_inertia(chain(7, 3), 2, "1e-12"), {}, None),
    **{f"pendulum, L = {x} m": (MODELS["pendulum"], {"L": x}, lambda x=x: pendulum(x)) for x in ("1e-9", "1e-3", "1e3", "1e9")},
    "chain of 4, links of 1e-9 m": (chain(1, 4, size=1e-9), {}, None),
    "chain of 4, links of 1e9 m": (chain(2, 4, size=1e9), {}, None),
    **{f"top, spin {x} rad/s": (MODELS["top"], {"omega": x}, lambda x=x: top(x)) for x in ("0", "1e-6", "1", "100", "1e4", "1e6")},
    **{
        f"rolling disk, spin {x} rad/s": (MODELS["rolling_disk"], {"omega": x}, lambda x=x: disk(x))
        for x in ("0", "1e-6", "1", "100", "1e4", "1e6")
    },
    "joints of 1e15 N m": (chain(4, 4, stiffness=1e15), {}, None),
    "joints of 1e-15 N m": (chain(4, 4, stiffness=1e-15), {}, None),
    "one soft joint among 1e12": (with_stiffness(chain(5, 3, stiffness=1e12), 2, "1.5"), {}, None),
    "one soft joint among 1e15": (with_stiffness(chain(5, 3, stiffness=1e15), 2, "1.5"), {}, None),
    "spatial chain of 3": (spring_chain(np.random.default_rng(15), 3), {}, None),
    **{f"10 links, masses growing downwards ({i})": (growing(i), {}, None) for i in range(3)},
    "10 links, masses growing upwards": (growing(0, True), {}, None),
    **{
        f"plumb line of {n}": (plumb_line(n), {}, lambda n=n: plumb_line_eigenvalues(n)) for n in (1, 10, 50)
    },
    **{
        f"{name}, {x:g} beside critical": (
            MODELS[model],
            {**more, parameter: rounded(critical(form) * (1 + mp.mpf(x)))},
            lambda form=form, x=x: form(rounded(critical(form) * (1 + mp.mpf(x)))),
        )
        for name, model, parameter, form, more in (
            ("top", "top", "omega", top, {}),
            ("rolling disk", "rolling_disk", "omega", disk, {}),
            ("Ziegler", "ziegler_column", "P", ziegler, {"b_1": "0", "b_2": "0"}),
        )
        for x in (1e-3, -1e-6, 1e-9, -1e-12, 1e-14, 1e-15)
    },
    **{f"bicycle, {x:g} beside flutter": (MODELS["whipple_bicycle"], {"v": rounded(4.292382536341 * (1 + x))}, None) for x in (1e-3, 1e-8)},
    **{f"theta {x} off pi/2": (TILTED, {"d": x}, lambda x=x: tilted(x)) for x in ("1e-1", "1e-2", "1e-3", "1e-4", "1e-5", "1e-6", "1e-7", "1e-9")},
    **{
        f"four-bar {x} off its change point": (LINKAGE, {"a": x}, lambda: pair(-6 * mp.mpf("9.81") / 5))
        for x in ("1e-1", "1e-3", "1e-5", "1e-7", "1e-8", "1e-9")
    },
    "n_four_bar": (MODELS["n_four_bar"], {}, lambda: pair(-7 * mp.mpf("9.81") / 6)),
    "bricard": (MODELS["bricard"], {}, None),
    "door on two hinges": (DOOR, {"e": "0"}, lambda: pair(-3 * mp.mpf("9.81") * 0.5 / (mp.mpf("0.4") + mp.mpf("0.75")))),
    **{f"door, second hinge off by {x}": (DOOR, {"e": x}, lambda: []) for x in ("1e-3", "1e-6", "1e-9", "1e-11", "1e-12", "1e-14")},
    **{f"pins {x} m apart": (PINS, {"e": x}, lambda: []) for x in ("1e-3", "1e-6", "1e-9", "1e-11", "1e-12", "1e-14")},
    "zero inertia in one link": (without_turning_inertia(chain(16, 4), [2]), {}, None),
    "zero inertia in all links": (without_turning_inertia(chain(17, 4), [1, 2, 3, 4]), {}, None),
    "damping 1e-15": (chain(18, 3, stiffness=5.0, damping=1e-15), {}, None),
    "damping 1e15": (chain(18, 3, stiffness=5.0, damping=1e15), {}, None),
    "damping 1e6": (chain(18, 3, stiffness=5.0, damping=1e6), {}, None),
}


@functools.cache
def truth(case):
    text, parameters, closed_form = CASES[case]
    with mp.workdps(60):
        if closed_form is not None:
            return closed_form()
        return exact_eigenvalues(mbstab.loads(text).model, 1e-35 if "damping" in case else ZERO, **parameters)[0]


@functools.cache
def answer(case, method="nullspace"):
    """Return the result, or what is refused."""
    text, parameters, _ = CASES[case]
    try:
        return mbstab.loads(text).eig(method, **{k: float(x) for k, x in parameters.items()})
    except MbstabError as error:
        return error
