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
    "-c*v1**3", "-c*v1*abs(v1)", "-c*abs(v1)**1.5*v1", "-c*v1**3*abs(v1) + 5*v1**5", "-c*v1**3 - d*v1",
    "-c*v1**3*(1 - x1)", "-c*(2 + sin(x1))*v1*abs(v1)", "-c*x1**2*v1", "-c*v1**3*exp(x1 + v1)", "-c*v1**3/(1 + v2**2)",
    "-c*tanh(v1)**3", "-c*(c - 0.2)*v1**3", "-c*v1*abs(v1) + 3*v2**2*v1**3*abs(v1)", "-c*v1**3*cos(v1)",
    "-c*(v1 - x1*v1)**3", "-c*v1**2*tanh(2*v1)", "-c*v1**3*sqrt(1 + v2**2) + d*v1**3",
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


@pytest.mark.parametrize(("linear", "kinds"), [("", {"center"}), (" - 1e-18*v1", {"undecided"})])
def test_a_cubic_damper_alone_leaves_the_eigenvalues_on_the_axis(linear, kinds):
    result = rails({1: "-c*v1**3" + linear}, (1,)).eig()
    assert result.verdict == "stable"
    assert {e.kind for e in result.eigenvalues} == kinds


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


POINTWISE = [
    ({1: "-c*hypot(v1, v2)*v1", 2: "-c*hypot(v1, v2)*v2"}, True),
    ({1: "-c*sqrt(v1**2 + v2**2)*v1", 2: "-c*sqrt(v1**2 + v2**2)*v2"}, True),
    ({1: "-c*hypot(v1, 2*v2)**3*v1", 2: "-d*hypot(v2, v1)*v2"}, True),
    ({1: "-c*hypot(v1, v2)*v2", 2: "c*hypot(v1, v2)*v1"}, True),  # does no work
    ({1: "c*hypot(v1, v2)*v1", 2: "-c*hypot(v1, v2)*v2"}, False),
    ({1: "-c*hypot(v1, v2)*v2", 2: "-c*hypot(v1, v2)*v1"}, False),
]  # fmt: skip


@pytest.mark.table
@pytest.mark.parametrize(("forces", "takes"), POINTWISE)
def test_drag_along_a_velocity_in_the_plane(forces, takes):
    assert rails(forces).eig().verdict == ("stable" if takes else "undecided")


PENDULUM = """
mbstab: 1
parameters: {c: 0.3, v: 0, low: -0.2, turned: 0}
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 1, inertia: 0.02, points: {O: [low, 0], tip: [0.2, 0]}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces:
  drag: {type: expression, on: FORCES}
reference: {coordinates: {rod: {x: 0, y: low, theta: 3*pi/2}}, rates: {rod: {theta: v}}}
"""
TIP = [
    "{angle(pivot): '-c*rate(angle(pivot))*abs(rate(angle(pivot)))'}",
    "{rod.theta: -c*rate(rod.theta)**3}",
    "{x(rod.tip): '-c*hypot(rate(x(rod.tip)), rate(y(rod.tip)))*rate(x(rod.tip))',"
    " y(rod.tip): '-c*hypot(rate(x(rod.tip)), rate(y(rod.tip)))*rate(y(rod.tip))'}",
    "{vx(rod.tip): -c*vx(rod.tip)**3, vy(rod.tip): '-c*vy(rod.tip)*abs(vy(rod.tip))'}",
]


@pytest.mark.few(1)
@pytest.mark.parametrize("forces", TIP)
def test_all_commands_agree_on_a_pendulum_with_drag(forces):
    pendulum = mbstab.loads(PENDULUM.replace("FORCES", forces))
    for c, word in ((0.3, "stable"), (-0.1, "undecided")):
        assert pendulum.eig(c=c).verdict == word
        assert pendulum.eig_precise(20, c=c).verdict == word
        assert pendulum.modes(1, c=c).verdict == word
        proven = pendulum.certify(c=c).verdict
        assert proven == word or (word == "undecided" and proven in ("not provable", "marginally stable"))
    assert pendulum.sweep("c", [-0.2, -0.1, 0.0, 0.1, 0.3, 2.0]).verdicts == 2 * ["undecided"] + 4 * ["stable"]
    chart = pendulum.chart({"c": np.linspace(-0.2, 0.3, 4), "low": np.linspace(-0.3, -0.2, 3)})
    assert np.array_equal(chart.verdicts, [2 * ["undecided"] + 2 * ["stable"]] * 3)


@pytest.mark.parametrize("force", ["-c*v1**3", "-c*v1*(d - 0.1)*abs(v1)", "-c*v1**3 + d*v1**5"])
def test_a_proof_over_an_interval_holds_for_all_of_it(force):
    point = rails({1: force})
    assert point.certify(c="[0.1, 0.3]").verdict == "stable"
    assert point.certify(c="[-0.1, 0.3]").verdict in ("marginally stable", "not provable")


LIFTED = """
mbstab: 1
parameters: {f: 0.5}
bodies: {p: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: p.y}}
forces:
  spring: {type: expression, on: {p.x: f - p.x}}
  drag: {type: expression, on: {p.x: -(1 - p.x)*rate(p.x)**3}}
reference: {find: equilibrium}
"""


def test_drag_that_depends_on_a_place_is_judged_where_the_reference_is():
    point = mbstab.loads(LIFTED)
    assert [point.eig(f=f).verdict for f in (0.5, 1.5)] == ["stable", "undecided"]
    assert point.sweep("f", [0.1, 0.5, 0.9, 1.1, 1.5]).verdicts == 3 * ["stable"] + 2 * ["undecided"]
    assert point.certify(f=0.5).verdict == "stable"
    assert point.certify(f="[0.5, 1.5]").verdict != "stable"


def test_upright_the_drag_does_not_save_a_pendulum():
    text = PENDULUM.replace("FORCES", TIP[1]).replace("y: low, theta: 3*pi/2", "y: -low, theta: pi/2")
    assert mbstab.loads(text).eig().verdict == "unstable"


PASSING = """
mbstab: 1
parameters: {c: 0.7}
bodies: {p: {type: planar_point, mass: 1}}
forces: {all: {type: expression, on: {p.x: "ALONG", p.y: "-2*p.y - c*rate(p.y)**3"}}}
STATES
reference: {coordinates: {p: {x: 0, y: 0}}, rates: {p: {x: SPEED}}}
"""


def passing(along, speed=0, states=""):
    return mbstab.loads(PASSING.replace("ALONG", along).replace("SPEED", str(speed)).replace("STATES", states)).eig()


def test_a_force_that_resists_at_rest_is_no_drag_about_a_motion():
    assert passing("-c*rate(p.x)**3").verdict == "stable up to symmetry"
    assert "at most like t" in passing("-c*rate(p.x)**3").reasons[0]
    # One speed feeds what is slower and stops what is faster.
    assert passing("-c*(rate(p.x) - 1)**3", 1).verdict == "undecided"
    assert passing("c*(rate(p.x) - 1)**3", 1).verdict == "undecided"
    assert passing("c*rate(p.x)*rate(p.y)**2", 1).verdict != "stable up to symmetry"


@pytest.mark.parametrize(("rate", "word"), [("p.x - z", "undecided"), ("-z", "undecided")])
def test_drag_beside_a_force_of_a_state_decides_nothing(rate, word):
    found = passing("-p.x - c*rate(p.x)**3 - 1e-9*z**3", 0, f"states: {{z: {{rate: {rate}}}}}")
    assert found.verdict == word


COLUMN = """
mbstab: 1
parameters: {P: 1.8, c: 0.1}
bodies:
  r1: {type: planar, mass: 2, inertia: 1e-12, points: {O: [-1, 0]}}
  r2: {type: planar, mass: 1, inertia: 1e-12, points: {O: [-1, 0], E: [0, 0]}}
joints: {a: {type: revolute, between: [r1.O, ground]}, b: {type: revolute, between: [r2.O, r1]}}
forces:
  one: {type: joint_spring, joint: a, stiffness: 1}
  two: {type: joint_spring, joint: b, stiffness: 1}
  load: {type: expression, on: {FORCES}}
reference: {coordinates: {r1: {x: 1, y: 0, theta: 0}, r2: {x: 2, y: 0, theta: 0}}}
"""


@pytest.mark.few(2)
@pytest.mark.parametrize("law", ["-c*{}**3", "-c*{}*abs({})"])
@pytest.mark.parametrize("joint", "ab")
def test_a_load_that_follows_the_body_has_no_potential_beside_drag(joint, law):
    """Ziegler's column. Damping of the joint b makes it unstable: so does drag there, however small the motion."""
    drag = f"angle({joint}): '{law.replace('{}', f'rate(angle({joint}))')}'"
    for load in ("vx(r2.E): -P", "vx(r2.E): -P/2, vx(r1): -P/2"):
        column = mbstab.loads(COLUMN.replace("FORCES", f"{load}, {drag}"))
        assert column.eig(P=1.3).verdict == column.eig_precise(20, P=1.3).verdict == "undecided"
        assert column.sweep("P", [0.5, 1.0, 1.5]).verdicts == 3 * ["undecided"]
        assert column.certify().verdict != "stable"
    assert mbstab.loads(COLUMN.replace("FORCES", f"x(r2.E): -P/8, {drag}")).eig().verdict == "stable"


# --- random laws against their power itself -------------------------------------------------------------------------

FACTORS = [
    "v{i}", "v{i}", "v{i}**2", "v{i}**3", "v{j}", "v{j}**2", "abs(v{i})", "tanh(2*v{i})", "x{i}", "x{j}**2",
    "(1 - x{i})", "(0.4 + x{j})", "exp(v{j})", "cos(v{i})", "cos(x{j} + 2)", "(v{i} - v{j})", "(v{i} - 2*v{j})**2",
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


@pytest.mark.few(1)
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
