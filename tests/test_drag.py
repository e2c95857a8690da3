"""Forces of resistance that are not linear: the energy decides where they take some from every motion, nowhere else."""

import math
import re

import numpy as np
import pytest
from sampling import sample

import mbstab
from mbstab.errors import MbstabError

RAILS = """
mbstab: 1
parameters: {c: 0.7, d: 0.2}
bodies: {BODIES}
constraints: {ROWS}
forces:
  spring: {type: expression, on: {SPRINGS}}
  drag: {type: expression, on: {DRAG}}
reference: {coordinates: {AT}}
"""


def rails(drag, stiff=(1, 2)):
    """Return points on parallel rails, coordinates x1, x2, … and speeds v1, v2, …, held by springs."""
    n = len(stiff)
    names = [f"p{i + 1}" for i in range(n)]

    def written(text):
        return re.sub(r"\bv(\d)\b", r"rate(p\1.x)", re.sub(r"\bx(\d)\b", r"p\1.x", text))

    parts = {
        "BODIES": ", ".join(f"{x}: {{type: planar_point, mass: 1}}" for x in names),
        "ROWS": ", ".join(f"{x}: {{holonomic: {x}.y}}" for x in names),
        "SPRINGS": ", ".join(f"{x}.x: -{k}*{x}.x" for k, x in zip(stiff, names, strict=True)),
        "DRAG": ", ".join(f'p{i}.x: "{written(force)}"' for i, force in drag.items()),
        "AT": ", ".join(f"{x}: {{x: 0}}" for x in names),
    }
    text = RAILS
    for key, value in parts.items():
        text = text.replace(f"{{{key}}}", f"{{{value}}}")
    return mbstab.loads(text)


TAKES = [
    "-c*v1**3", "-c*v1*abs(v1)", "-c*abs(v1)**1.5*v1", "-c*v1**3*abs(v1) + 5*v1**5", "-c*v1**3 - d*v1", "-c*tanh(v1)**3",
    "-c*v1**3*(1 - x1)", "-c*(2 + sin(x1))*v1*abs(v1)", "-c*x1**2*v1", "-c*v1**3*exp(x1 + v1)", "-c*v1**3/(1 + v2**2)",
    "-c*(c - 0.2)*v1**3", "-c*v1*abs(v1) + 3*v2**2*v1**3*abs(v1)", "-c*v1**3*cos(v1)",
    "-c*(v1 - x1*v1)**3", "-c*v1**2*tanh(2*v1)",
]  # fmt: skip

FEEDS = [
    "c*v1**3", "c*v1*abs(v1)", "-c*v1**3*abs(v1) + 5*v1**3", "-c*v1**2", "c*x1**2*v1", "-c*(d - 0.7)*v1**3",
    "-c*v1**3*(x1 - 0.1)", "-c*v1**3*cos(x1 + pi)", "-c*tanh(v1)**2*v1 + c*v1**3*1.01", "-v1*tanh(v1)**2 + v1**3",
    "-c*v1**3 + 4*v2**3", "-c*v2**3", "-c*(v1 + 0.1*v2)**3", "-c*tanh(x1 + v1)**3", "-x1*v1**2", "-c*v1**2*v2",
    "-v1**3 + v1**2*v2",
]  # fmt: skip


@pytest.mark.parametrize("force", TAKES)
def test_a_force_that_takes_energy_near_rest_leaves_the_minimum_of_the_energy_to_decide(force):
    found = rails({1: force}).eig()
    assert found.verdict == "stable", found.reasons
    assert "minimum" in found.reasons[0]


@pytest.mark.parametrize("force", FEEDS)
def test_a_force_that_feeds_some_motion_is_not_taken_for_drag(force):
    assert rails({1: force}).eig().verdict in ("undecided", "marginally stable")


BETWEEN = [
    ({1: "-c*(v1 - v2)**3", 2: "c*(v1 - v2)**3"}, True),
    ({1: "-c*(v1 - v2)**3", 2: "-c*(v2 - v1)**3"}, True),
    ({1: "-c*(v1 - v2)*abs(v1 - v2)", 2: "c*(v1 - v2)*abs(v1 - v2)"}, True),
    ({1: "-c*tanh(3*(v1 - v2))**3", 2: "c*tanh(3*(v1 - v2))**3"}, True),
    ({1: "-c*(v1 - v2) - v1**3", 2: "c*(v1 - v2)"}, True),
    ({1: "-c*(v1 - v2)**3", 2: "c*(v1 - v2)**3*1.001"}, False),
    ({1: "-c*(v1 - v2)**3", 2: "-c*(v1 - v2)**3"}, False),
    # Along v1 = v2 nothing is taken that could outweigh what is fed there.
    ({1: "-c*(v1 - v2) + v1**3", 2: "c*(v1 - v2)"}, False),
    ({1: "-abs(v1 - v2)*(v1 - v2) + 1e-3*v1**3", 2: "abs(v1 - v2)*(v1 - v2)"}, False),
]  # fmt: skip


@pytest.mark.parametrize(("forces", "takes"), BETWEEN)
def test_drag_between_two_bodies_leaves_their_common_motion(forces, takes):
    assert rails(forces, (1, 1)).eig().verdict == ("stable" if takes else "undecided")


# --- random laws against their power itself -------------------------------------------------------------------------

FACTORS = [
    "v{i}", "v{i}", "v{i}**2", "v{i}**3", "v{j}", "v{j}**2", "abs(v{i})", "tanh(2*v{i})", "x{i}", "x{j}**2", "(1 - x{i})",
    "(0.4 + x{j})", "exp(v{j})", "cos(v{i})", "cos(x{j} + 2)", "(v{i} - v{j})", "(v{i} - 2*v{j})**2",
]  # fmt: skip
BETWEEN_TWO = ["({})**3", "({})**5", "({})*abs({})", "tanh({})**3", "({})**2*abs({})", "({})**3*(x1 - 0.3)"]
COEFFICIENTS = ["-c", "-d", "-3", "d", "0.01", "5", "-(c - 0.7)", "(d - c)", "-d/c"]


def random_law(rng):
    """Return forces along two rails."""
    forces = {1: [], 2: []}
    for _ in range(rng.integers(1, 4)):
        i = int(rng.integers(1, 3))
        if rng.random() < 0.3:
            law = str(rng.choice(BETWEEN_TWO)).replace("{}", str(rng.choice(["v1 - v2", "v2 - v1", "2*v1 + v2"])))
            k = str(rng.choice(COEFFICIENTS))
            forces[1].append(f"({k})*{law}")
            forces[2].append(f"{rng.choice([-1, -1, 1, 2])}*({k})*{law}")
            continue
        size = int(rng.integers(1, 4))
        factors = [str(rng.choice(FACTORS)).format(i=i, j=3 - i) for _ in range(size)]
        forces[i].append("*".join([str(rng.choice(COEFFICIENTS)), f"v{i}", *factors]))
    return {i: terms for i, terms in forces.items() if terms}


def feeds(forces, size):
    """Whether the forces give energy to some motion within a distance from rest: their power is computed."""
    names = {"c": 0.7, "d": 0.2, "pi": math.pi}
    functions = {f: getattr(np, f) for f in ("abs", "tanh", "exp", "cos", "sin")}
    rng = np.random.default_rng(5)
    directions = np.concatenate([
        rng.normal(size=(4000, 4)),
        [[a, b, v, w] for a in (-1, 0, 1) for b in (-1, 0, 1) for v in (-2, -1, 0, 1, 2) for w in (-2, -1, 0, 1, 2)],
        # Speeds of very different sizes, and positions that are slower or faster still.
        rng.normal(size=(4000, 4)) * size ** rng.uniform(0.0, 2.0, (4000, 4)),
    ])  # fmt: skip
    x1, x2, v1, v2 = size * directions.T / np.maximum(1.0, np.linalg.norm(directions, axis=1))
    state = {"x1": x1, "x2": x2, "v1": v1, "v2": v2}
    total, sizes = 0.0, 1e-300
    for i, terms in forces.items():
        for term in terms:
            power = eval(term, functions | names | state) * state[f"v{i}"]
            total, sizes = total + power, sizes + np.abs(power)
    return bool(np.any(total > 1e-12 * sizes))


def laws(number):
    rng = np.random.default_rng(11)
    return [random_law(rng) for _ in range(number)]


@pytest.mark.parametrize("part", sample(range(10), 5))
def test_no_random_law_that_feeds_a_motion_is_called_stable(part):
    stable = 0
    for forces in laws(400)[part::10]:
        try:
            found = rails({i: " + ".join(terms) for i, terms in forces.items()}, (1, 1)).eig()
        except MbstabError:  # has no derivative at rest
            continue
        if found.verdict == "stable":
            stable += 1
            assert not feeds(forces, 1e-3), forces
        elif found.verdict == "undecided" and not any("(" in x for terms in forces.values() for x in terms):
            assert feeds(forces, 1e-3), forces
    assert stable >= 2
