"""Systems whose stability is known by proof, with what each command may say about them.

`SYSTEMS` holds small mechanisms as texts of model files. Most are simple to the eye and each is a trap for some rule
of thumb: zeros that a shift seems to explain, pairs that seem to lie on the axis, coefficients that seem constant.
`why` tells the proof or the trap in a line. In laws of force of a point ``p`` the letters x, y, u, v stand for its
coordinates and their rates.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import mechanisms

from mbstab.analysis.verdict.rule import (
    ASYMPTOTIC,
    ASYMPTOTIC_UP_TO,
    MARGINAL,
    STABLE,
    STABLE_UP_TO,
    STRENGTH,
    UNDECIDED,
    UNSTABLE,
)

MODELS = Path(__file__).parent.parent / "models"

EVERY = ("eig", "index3", "precise", "certify", "sweep")
PERIODIC = ("eig",)  # the other commands refuse periodic motions


@dataclass(frozen=True)
class Zoo:
    """A system with known truth.

    Attributes
    ----------
    name, number : str, int
        Both unique to a system or a group of its cases.
    text : str
        The model file.
    truth : str or None
        The strongest true verdict; None: not known.
    best : str
        The strongest verdict that a sound tool is known to reach.
    least : str
        What `eig` must say at least; `best` unless that asks for more than linear analysis with structure gives.
    why : str
    also : frozenset of str
        Verdicts that are true besides those that `truth` implies.
    never : frozenset of str
        Verdicts that must not be given although `truth` implies them.
    digits : str
        What many digits and balls must say where that is more than `least`; empty: nothing more.
    in_place : bool or None
        Whether motions nearby stay near the reference itself; None: not tested.
    apart : str
        Regular expression that no symmetry and no family in `modulo` may match; empty: none.
    warns : str
        Regular expression that a warning of `eig` must match; empty: none.
    swept : (str, tuple of float)
        Parameter of a sweep, with the value of the text in the middle.
    commands : tuple of str
    """

    name: str
    number: int
    text: str
    truth: str | None
    best: str
    least: str
    why: str
    also: frozenset[str] = frozenset()
    never: frozenset[str] = frozenset()
    digits: str = ""
    in_place: bool | None = None
    apart: str = ""
    warns: str = ""
    swept: tuple[str, tuple[float, ...]] = ("dummy", (0.5, 1.0, 2.0))
    commands: tuple[str, ...] = EVERY

    @property
    def allowed(self) -> frozenset[str]:
        """Return the verdicts that are true."""
        implied = STRENGTH[self.truth] if self.truth else frozenset()
        place = frozenset({STABLE}) if self.in_place else frozenset()
        return (implied | place | self.also | {UNDECIDED}) - self.never

    @property
    def require_best(self) -> bool:
        """Return whether `eig` must reach `best`."""
        return self.least == self.best


SYSTEMS: list[Zoo] = []


def known(number, name, text, truth, best, why, **more):
    """Add a system; without ``least`` the best must be reached."""
    for key in ("also", "never"):
        more[key] = frozenset(more.get(key, ()))
    SYSTEMS.append(Zoo(name, number, text, truth, best, more.pop("least", best), why, **more))


def scene(text, parameters=""):
    """Return a model text with a parameter on which nothing depends."""
    lines = "".join(f"  {line}\n" for line in ["dummy: 1", *parameters.splitlines()])
    return f"mbstab: 1\nparameters:\n{lines}{text.lstrip()}"


def law(text):
    """Return a law of force of the point p, written with x, y, u, v."""
    for letter, name in zip("xyuv", ("p.x", "p.y", "rate(p.x)", "rate(p.y)"), strict=True):
        text = re.sub(rf"(?<![\w.]){letter}\b", name, text)
    return text


def point(x, y=None, at=(0, 0), rates=None, parameters="", reference="", more=""):
    """Return the text of a point of mass 1 in the plane under forces; without ``y`` it moves along x only."""
    laws = f"p.x: {law(x)!r}" + (f", p.y: {law(y)!r}" if y is not None else "")
    rail = "" if y is not None else "joints: {rail: {type: point_on_line, between: [ground, p], axis: x}}\n"
    speeds = f"  rates: {{p: {{x: {rates[0]}, y: {rates[1]}}}}}\n" if rates else ""
    return scene(
        f"bodies: {{p: {{type: planar_point, mass: 1}}}}\n{rail}"
        f"forces: {{push: {{type: expression, on: {{{laws}}}}}}}\n{more}"
        f"reference:\n  coordinates: {{p: {{x: {at[0]}, y: {at[1]}}}}}\n{speeds}{reference}",
        parameters,
    )


def shipped(name, replace=(), **values):
    """Return the text of an example with other values of parameters, without its expectations."""
    text = (MODELS / f"{name}.yaml").read_text(encoding="utf-8").split("\nexpect:")[0].split("\nsweep:")[0] + "\n"
    for parameter, value in values.items():
        text, count = re.subn(rf"(?m)^(  {parameter}: {{value: )[^,]*,", rf"\g<1>{value},", text)
        assert count == 1, (name, parameter)
    for old, new in replace:
        assert old in text, (name, old)
        text = text.replace(old, new)
    return text.replace("\nparameters:\n", "\nparameters:\n  dummy: 1\n", 1)


# --- pendulums ------------------------------------------------------------------------------------------------------

PENDULUM = """
gravity: [0, -9.81]
bodies: {rod: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, -side/2]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {hinge: {type: joint_spring, joint: pivot, stiffness: k, damping: c}}
reference: {coordinates: {rod: {x: 0, y: side/2, theta: 0}}}
"""


def pendulum(side=-1, k="0", c="0", more=""):
    return scene(PENDULUM.replace("forces: {", f"forces: {{{more}"), f"side: {side}\nk: {k}\nc: {c}")


def balanced(force):
    """Return the text of a rod pinned at its middle."""
    return scene(
        """
bodies: {rod: {type: planar, mass: 1, inertia: 1/12}}
joints: {pivot: {type: revolute, between: [rod, ground]}}
forces: {FORCE}
reference: {coordinates: {rod: {x: 0, y: 0, theta: 0}}}
""".replace("FORCE", force)
    )


known(1, "pendulum", pendulum(), STABLE, STABLE, "Lagrange and Dirichlet")
known(1, "pendulum, example", shipped("pendulum"), STABLE, STABLE, "Lagrange and Dirichlet")
known(2, "pendulum, damped", pendulum(c="0.1"), ASYMPTOTIC, ASYMPTOTIC, "both eigenvalues decay")
known(
    2,
    "pendulum, hardly damped",
    pendulum(c="1e-18"),
    ASYMPTOTIC,
    STABLE,
    "the energy decides where the real part is below rounding",
    digits=ASYMPTOTIC,
)
known(3, "pendulum upright", pendulum(side=1), UNSTABLE, UNSTABLE, "saddle")
known(
    35,
    "upright on a critical torsion spring",
    pendulum(side=1, k="9.81/2"),
    STABLE,
    UNDECIDED,
    "k = m g L: the energy grows with the fourth power of the angle; at linear order it drifts",
    never=[MARGINAL],
)
known(
    101,
    "pendulum with cubic damping",
    pendulum(more="brake: {type: expression, on: {rod.theta: -rate(rod.theta)**3}}, "),
    ASYMPTOTIC,
    UNDECIDED,
    "dissipation that the linearized equations do not know",
)
known(
    102,
    "pendulum with a follower force without load",
    scene(
        """
gravity: [0, -9.81]
bodies: {rod: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, 1/2], tip: [0, -1/2]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {follower: {type: force, at: rod.tip, vector: [P, P], frame: body}}
reference: {coordinates: {rod: {x: 0, y: -1/2, theta: 0}}}
""",
        "P: 0",
    ),
    STABLE,
    STABLE,
    "a force that is zero breaks nothing",
    least=MARGINAL,
)
known(103, "double pendulum", shipped("double_pendulum"), STABLE, STABLE, "Lagrange and Dirichlet")
DOUBLE = """
gravity: [0, -9.81]
bodies:
  lower: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, -1/2], E: [0, 1/2]}}
  upper: {type: planar, mass: 1, inertia: 1/12, points: {E: [0, -1/2]}}
joints:
  base: {type: revolute, between: [lower.O, ground]}
  elbow: {type: revolute, between: [upper.E, lower.E]}
reference: {coordinates: {lower: {x: 0, y: 1/2, theta: 0}, upper: {x: 0, y: 3/2, theta: 0}}}
"""
known(104, "double pendulum upright", scene(DOUBLE), UNSTABLE, UNSTABLE, "two growing eigenvalues")
known(
    105,
    "two equal pendulums on a spring",
    scene("""
gravity: [0, -9.81]
bodies:
  a: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, 1/2], P: [0, 0]}}
  b: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, 1/2], P: [0, 0]}}
joints:
  left: {type: revolute, between: [a.O, ground]}
  right: {type: revolute, between: [b.O, {body: ground, point: [1, 0]}]}
forces: {spring: {type: spring, between: [a.P, b.P], stiffness: 1e-6, length: 1}}
reference: {coordinates: {a: {x: 0, y: -1/2, theta: 0}, b: {x: 1, y: -1/2, theta: 0}}}
"""),
    STABLE,
    STABLE,
    "two pairs a ten-millionth apart; the energy is definite",
)
known(106, "four-bar linkage", shipped("four_bar"), STABLE, STABLE, "one freedom, the energy has a minimum")
SPHERICAL = """
gravity: [0, 0, -9.81]
bodies: {bob: {type: point, mass: 1}}
joints: {string: {type: distance, between: [bob, ground], length: 1}}
"""
known(
    107,
    "spherical pendulum hanging",
    scene(SPHERICAL + "reference: {coordinates: {bob: {x: 0, y: 0, z: -1}}}\n"),
    STABLE,
    STABLE,
    "two equal pairs; the turn about the vertical moves nothing here",
)
known(
    108,
    "conical pendulum",
    scene(
        SPHERICAL
        + """\
reference:
  steady: {axis: z, rate: Omega}
  coordinates: {bob: {x: 0.6, y: 0, z: -0.8}}
  rates: {bob: {x: 0, y: 0.6*Omega, z: 0}}
""",
        "Omega: sqrt(9.81/0.8)",
    ),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "the energy has a minimum at the given angular momentum",
)
known(
    109,
    "pendulum in a turned plane",
    shipped("rotating_pendulum"),
    STABLE,
    STABLE,
    "prescribed angle: the energy in the turning frame has a minimum",
)

# --- a point in the plane under forces ------------------------------------------------------------------------------

known(
    4,
    "cubic push beside a shift",
    point("-u", "-v + y**3"),
    UNSTABLE,
    UNDECIDED,
    "y is a shift at linear order only",
    never=[MARGINAL],
    apart=r"\by\b",
)
known(
    5,
    "cubic spring beside a shift",
    point("-u", "-v - y**3"),
    ASYMPTOTIC_UP_TO,
    UNDECIDED,
    "the linear part of the system above",
    in_place=True,
    apart=r"\by\b",
)
known(
    6, "two shifts, damped", point("-u", "-v"), ASYMPTOTIC_UP_TO, ASYMPTOTIC_UP_TO, "both hold exactly", in_place=True
)
known(7, "cubic spring", point("-x**3"), STABLE, UNDECIDED, "drifts at linear order", never=[MARGINAL])
known(7, "cubic push", point("x**3"), UNSTABLE, UNDECIDED, "drifts at linear order")
known(7, "quadratic push, damped", point("-u + x**2"), UNSTABLE, UNDECIDED, "x = a > 0 escapes")
known(
    7,
    "quadratic push, damped, beside a shift",
    point("-u", "-v + y**2"),
    UNSTABLE,
    UNDECIDED,
    "y = a > 0 escapes",
    apart=r"\by\b",
)
known(
    8,
    "a speed that drives another",
    point("v", "0"),
    UNSTABLE,
    UNDECIDED,
    "four zeros and two shifts, but the rate of x grows with t",
)
known(9, "circles", point("v", "-u"), STABLE, STABLE, "circles of any size and place", least=MARGINAL)
known(
    10,
    "ball on a turntable, reduced",
    point("-2*W*v/7", "2*W*u/7", parameters="W: 3"),
    STABLE,
    STABLE,
    "circles of any size and place",
    least=MARGINAL,
)
known(
    11,
    "quadratic drive, undamped",
    point("y**2", "-y"),
    UNSTABLE,
    MARGINAL,
    "y = a cos t drives x by a²/2 for ever, although shift and speed of x explain both zeros",
    also=[MARGINAL],
    least=UNDECIDED,
)
known(
    12,
    "quadratic drive, damped",
    point("y**2", "-y - v"),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "the drive dies out; a speed remains",
    least=UNDECIDED,
)
known(
    13,
    "trough in a ring",
    point("-(x**2 + y**2 - 1)*x - u", "-(x**2 + y**2 - 1)*y - v", at=(1, 0)),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "the equilibria are one turned",
    in_place=True,
)
known(
    14,
    "tiny cubic push beside huge damping",
    point("-1e6*u", "-1e6*v + 1e-9*y**3"),
    UNSTABLE,
    UNDECIDED,
    "the push must be seen relative to its own size",
    never=[MARGINAL],
    apart=r"\by\b",
)
known(15, "double pair with one vector", point("-x + y", "-y"), UNSTABLE, UNDECIDED, "grows with t")
known(
    16,
    "equal pairs of a spring",
    scene("""
bodies: {p: {type: planar_point, mass: 1}}
forces: {spring: {type: spring, between: [p, ground], stiffness: 1}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""),
    STABLE,
    STABLE,
    "the energy is definite",
)
known(16, "equal pairs of forces", point("-x", "-y"), STABLE, STABLE, "the energy is definite")
known(
    18,
    "spring pendulum, two to one",
    scene("""
gravity: [0, -1]
bodies: {p: {type: planar_point, mass: 1}}
forces: {spring: {type: spring, between: [p, ground], stiffness: 4, length: 3/4}}
reference: {coordinates: {p: {x: 0, y: -1}}}
"""),
    STABLE,
    STABLE,
    "resonance is harmless where the energy is definite",
)
known(
    19,
    "held on a hill by gyroscopic forces",
    point("3*v + x", "-3*u + 1.1*y"),
    STABLE,
    MARGINAL,
    "linear: s⁴ + 6.9 s² + 1.1; the energy is indefinite",
    warns="damping",
)
known(
    20,
    "held on a hill, slightly damped",
    point("3*v + x - c*u", "-3*u + 1.1*y - c*v", parameters="c: 1e-6"),
    UNSTABLE,
    UNSTABLE,
    "Kelvin, Tait, Chetaev: any damping destroys it, here with 1.8e-7 1/s",
    swept=("c", (1e-7, 1e-6, 1e-5)),
)
known(
    21,
    "pairs that meet on a hill",
    point("2*v + x", "-2*u + y"),
    UNSTABLE,
    UNDECIDED,
    "double pair ±i with opposite energies, growth with t",
)
known(
    22,
    "Cherry's oscillators",
    point("-x - 2*x*y", "-4*y + x**2"),
    UNSTABLE,
    MARGINAL,
    "indefinite energy with frequencies one to two: explodes after 4/a, however small a",
    also=[MARGINAL],
    warns="1:2|1 : 2|resonance",
)
known(23, "Lyapunov's pair, pushed", point("-x + x**2*u"), UNSTABLE, UNDECIDED, "nothing holds it", also=[MARGINAL])
known(23, "Lyapunov's pair, braked", point("-x - x**2*u"), ASYMPTOTIC, UNDECIDED, "nothing holds the pair")

ROTOR = {
    "x": "-x - c_e*u - c_i*(u + Omega*y)",
    "y": "-y - c_e*v - c_i*(v - Omega*x)",
}


def rotor(Omega, damping="0.1"):
    return point(**ROTOR, parameters=f"Omega: {Omega}\nc_e: {damping}\nc_i: {damping}")


LIMIT = "turning damping destabilizes above sqrt(k) (1 + c_e/c_i) = 2"
known(27, "rotor with damped shaft, slow", rotor(1.5), ASYMPTOTIC, ASYMPTOTIC, LIMIT, swept=("Omega", (1.0, 1.5, 1.9)))
known(27, "rotor with damped shaft, fast", rotor(2.5), UNSTABLE, UNSTABLE, LIMIT, swept=("Omega", (1.5, 2.5, 3.0)))
known(27, "rotor, undamped", rotor(2.5, "0"), STABLE, STABLE, "no damping, no push: springs only")
known(110, "rotor just below its limit", rotor("2 - 1e-6"), ASYMPTOTIC, ASYMPTOTIC, LIMIT)
known(110, "rotor just above its limit", rotor("2 + 1e-6"), UNSTABLE, UNSTABLE, LIMIT)
known(
    111,
    "Foucault's pendulum",
    point("2*W*v - 4*x", "-2*W*u - 4*y", parameters="W: 0.1"),
    STABLE,
    STABLE,
    "gyroscopic forces do no work, the energy is definite",
    least=MARGINAL,
)
known(
    49,
    "satellite, Lagrange's region",
    point("(1 - k_1)*v - 4*k_1*x", "-(1 - k_3)*u - k_3*y", parameters="k_1: 0.5\nk_3: 0.3"),
    STABLE,
    STABLE,
    "linear, two pairs; the energy (weighted) is definite",
    least=MARGINAL,
)
known(
    49,
    "satellite, second region",
    point("(1 - k_1)*v - 4*k_1*x", "-(1 - k_3)*u - k_3*y", parameters="k_1: -0.05\nk_3: -0.9"),
    STABLE,
    MARGINAL,
    "linear, two pairs of opposite energies",
)
known(
    49,
    "satellite, unstable",
    point("(1 - k_1)*v - 4*k_1*x", "-(1 - k_3)*u - k_3*y", parameters="k_1: -0.9\nk_3: -0.2"),
    UNSTABLE,
    UNSTABLE,
    "the pairs have met and left the axis",
)
SATELLITE = """
bodies: {roll: {type: planar_point, mass: 1/(1 - k_1)}, yaw: {type: planar_point, mass: 1/(1 - k_3)}}
joints:
  one: {type: point_on_line, between: [ground, roll], axis: x}
  two: {type: point_on_line, between: [{body: ground, point: [0, 1]}, yaw], axis: x}
forces:
  turning: {type: expression, on: {roll.x: rate(yaw.x), yaw.x: -rate(roll.x)}}
  gravity: {type: expression, on: {roll.x: -4*k_1/(1 - k_1)*roll.x, yaw.x: -k_3/(1 - k_3)*yaw.x}}
reference: {coordinates: {roll: {x: 0, y: 0}, yaw: {x: 0, y: 1}}}
"""
known(
    49,
    "satellite with its masses, Lagrange's region",
    scene(SATELLITE, "k_1: 0.5\nk_3: 0.3"),
    STABLE,
    STABLE,
    "the energy is definite, gyroscopic forces do no work",
    least=MARGINAL,
)
known(
    49,
    "satellite with its masses, second region",
    scene(SATELLITE, "k_1: -0.05\nk_3: -0.9"),
    STABLE,
    MARGINAL,
    "linear, two pairs of opposite energies",
    warns="damping",
)
known(
    57,
    "slow growth beside a stiff spring",
    point("-K*x", "1e-4*y", parameters="K: 1e10"),
    UNSTABLE,
    UNSTABLE,
    "growth of 0.01 1/s, far below a ten-billionth of the largest square",
    least=UNDECIDED,
    swept=("K", (1e9, 1e10, 1e11)),
)
known(
    58,
    "falling at terminal speed",
    point("3 - u", rates=(3, 0)),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "a steady translation",
    in_place=True,
)
known(
    112,
    "cubic damping",
    point("-u**3"),
    STABLE_UP_TO,
    UNDECIDED,
    "the rate dies out like 1/sqrt(t), the way grows like sqrt(t)",
    also=[ASYMPTOTIC_UP_TO],
)
known(
    113, "cubic push by the rate", point("u**3"), UNSTABLE, UNDECIDED, "any rate grows without bound", never=[MARGINAL]
)
known(
    114,
    "slow growth hidden by a coupling",
    point("-S*x - D*y", "-D*x - S*y", parameters="S: (1e12 - 1e-9)/2\nD: (1e12 + 1e-9)/2"),
    UNSTABLE,
    UNDECIDED,
    "stiffness 1e12 along one diagonal, -1e-9 along the other, of which floats keep nothing",
    digits=UNSTABLE,
)
known(
    115,
    "negative damping below rounding",
    point("-x + 1e-17*u"),
    UNSTABLE,
    UNDECIDED,
    "a pair near the axis is not on it",
    digits=UNSTABLE,
)
known(116, "circulatory forces", point("-x - 0.1*y", "-y + 0.1*x"), UNSTABLE, UNSTABLE, "s² = -1 ± 0.1i")
known(
    117,
    "Hénon and Heiles",
    point("-x - 2*x*y", "-y - x**2 + y**2"),
    STABLE,
    STABLE,
    "one to one, but the energy is definite",
)
known(118, "quartic minimum", point("-x**3", "-y**3"), STABLE, UNDECIDED, "drifts at linear order", never=[MARGINAL])
known(119, "quartic minimum, damped", point("-x**3 - u"), ASYMPTOTIC, UNDECIDED, "the centre manifold: x' = -x³")
known(
    120,
    "one-sided push",
    point("-u + smooth_start(x)"),
    UNSTABLE,
    UNDECIDED,
    "zero slope at the kink, but x > 0 is pushed on",
    never=[MARGINAL],
)
known(121, "kink in a spring", point("-u - abs(x)"), UNSTABLE, UNDECIDED, "x < 0 is pushed on, x > 0 pulled back")
known(122, "kinked spring", point("-u - x*abs(x)"), ASYMPTOTIC, UNDECIDED, "the slope at 0 is 0 from both sides")
known(
    123,
    "constant force, nothing resists",
    point("3"),
    STABLE_UP_TO,
    UNDECIDED,
    "accelerates for ever; all motions are shifts of each other in place and speed",
    also=[ASYMPTOTIC_UP_TO],
)
KEPLER = {
    "at": (1, 0),
    "rates": (0, 1),
    "reference": "  steady: {axis: z, rate: 1}\n",
}
known(
    124,
    "Kepler's circle",
    point("-x/(x**2 + y**2)**(3/2)", "-y/(x**2 + y**2)**(3/2)", **KEPLER),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "the energy has a minimum at the given angular momentum",
    least=UNDECIDED,
)
known(
    124,
    "circle under the fourth power",
    point("-x/(x**2 + y**2)**(5/2)", "-y/(x**2 + y**2)**(5/2)", **KEPLER),
    UNSTABLE,
    UNSTABLE,
    "the effective potential has a maximum",
)

VALLEY = {"x": "2*x*(y - x**2) - 2*u", "y": "-(y - x**2) - v"}
known(
    142,
    "bent valley, damped",
    point(**VALLEY),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "at rest everywhere on y = x², which no symmetry tells",
    least=UNDECIDED,
    in_place=True,
)
known(
    142,
    "bent valley that falls, damped",
    point(VALLEY["x"] + " + 0.4*x**3", VALLEY["y"]),
    UNSTABLE,
    UNDECIDED,
    "the same linear part: V = (y - x²)²/2 - x⁴/10",
)

known(
    144,
    "push flatter than floats know",
    point("-u + x*exp(-1/(x**2 + 1e-3))"),
    UNSTABLE,
    UNDECIDED,
    "the slope at 0 is exp(-1000), which is no float but more than 0",
)
known(
    145,
    "push that begins far away",
    point("-u + smooth_start((x - 5)/10)"),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "shifts hold where x < 5",
    least=UNDECIDED,
    in_place=True,
)
known(
    146,
    "trough in a ring with a tiny push along it",
    point("-(x**2 + y**2 - 1)*x - u", "-(x**2 + y**2 - 1)*y - v + 1e-9*y**3", at=(1, 0)),
    UNSTABLE,
    UNDECIDED,
    "turned ones are no equilibria; the angle grows by 1e-9 of its cube",
)
known(
    147,
    "tiny circulatory forces",
    point("-x - 1e-12*y", "-y + 1e-12*x"),
    UNSTABLE,
    UNSTABLE,
    "growth of 5e-13 1/s beside equal springs",
    least=UNDECIDED,
    digits=UNSTABLE,
)
known(
    147,
    "circulatory forces below rounding",
    point("-x - 1e-18*y", "-y + 1e-18*x"),
    UNSTABLE,
    UNDECIDED,
    "growth of 5e-19 1/s",
    digits=UNSTABLE,
)
known(
    148,
    "damping that is zero in decimals only",
    point("-x - (0.1 + 0.2 - 0.3)*u"),
    STABLE,
    STABLE,
    "floats make it 5.6e-17",
    least=UNDECIDED,
)
known(
    148,
    "negative damping that is zero in decimals only",
    point("-x + (0.1 + 0.2 - 0.3)*u"),
    STABLE,
    UNDECIDED,
    "floats make it 5.6e-17",
)
known(
    149,
    "rate that the square of another coordinate drives",
    point("-u + v", "-v + x**2"),
    UNSTABLE,
    UNDECIDED,
    "y' = x², x' = y' on the centre manifold: x > 0 escapes; y is a shift, x is none",
    apart=r"\bx\b",
)
ELLIPSE = """
bodies: {p: {type: planar_point, mass: 1}}
constraints: {wire: {holonomic: p.x**2/4 + p.y**2 - 1}}
FORCES
reference: {coordinates: {p: {x: 0, y: 1}}}
"""
known(
    150,
    "bead on an elliptic wire",
    scene(ELLIPSE.replace("FORCES\n", "")),
    STABLE_UP_TO,
    UNDECIDED,
    "at rest everywhere, which no symmetry tells; it drifts along",
)
known(
    150,
    "bead on an elliptic wire, damped",
    scene(ELLIPSE.replace("FORCES", "forces: {drag: {type: expression, on: {p.x: -rate(p.x), p.y: -rate(p.y)}}}")),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "stops at rest nearby",
    least=UNDECIDED,
    in_place=True,
)
known(
    150,
    "bead on top of an elliptic wire",
    scene(ELLIPSE.replace("FORCES", "gravity: [0, -1e-9]")),
    UNSTABLE,
    UNSTABLE,
    "growth of 1.6e-5 1/s",
)
known(
    150,
    "bead on a round wire",
    scene("""
bodies: {p: {type: planar_point, mass: 1}}
joints: {wire: {type: distance, between: [p, ground], length: 1}}
reference: {coordinates: {p: {x: 0, y: 1}}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "nothing but turns",
)

# --- several points on springs --------------------------------------------------------------------------------------

CARTS = """
bodies: {{a: {{type: planar_point, mass: 1}}, b: {{type: planar_point, mass: 1}}, c: {{type: planar_point, mass: 1}}}}
joints:
  rail_a: {{type: point_on_line, between: [ground, a], axis: x}}
  rail_b: {{type: point_on_line, between: [ground, b], axis: x}}
  rail_c: {{type: point_on_line, between: [ground, c], axis: x}}
forces:
  ab: {{type: spring, between: [a, b], stiffness: 1, length: 1, damping: {d}}}
  bc: {{type: spring, between: [b, c], stiffness: 1, length: 1, damping: {d}}}
{more}
reference: {{coordinates: {{a: {{x: 1, y: 0}}, b: {{x: 2, y: 0}}, c: {{x: 3, y: 0}}}}}}
"""
HELD = "  wall: {type: spring, between: [a, ground], stiffness: 1, length: 1, damping: WALL}"
known(
    17,
    "two carts, damper between",
    scene("""
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
joints:
  rail_a: {type: point_on_line, between: [ground, a], axis: x}
  rail_b: {type: point_on_line, between: [ground, b], axis: x}
forces:
  left: {type: spring, between: [a, ground], stiffness: 1, length: 1}
  right: {type: spring, between: [b, {body: ground, point: [3, 0]}], stiffness: 1, length: 1}
  damper: {type: spring, between: [a, b], damping: 1}
reference: {coordinates: {a: {x: 1, y: 0}, b: {x: 2, y: 0}}}
"""),
    STABLE,
    STABLE,
    "the mode in which both go together is not damped",
)
known(
    125,
    "free chain of carts",
    scene(CARTS.format(d=0, more="")),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy at the given momentum",
)
known(
    125,
    "free chain of carts, damped",
    scene(CARTS.format(d=0.3, more="")),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "place and speed of the whole remain",
    in_place=False,
)
known(
    126, "chain of carts on a wall", scene(CARTS.format(d=0, more=HELD.replace("WALL", "0"))), STABLE, STABLE, "minimum"
)
known(
    126,
    "chain of carts on a damped wall",
    scene(CARTS.format(d=0, more=HELD.replace("WALL", "0.2"))),
    ASYMPTOTIC,
    ASYMPTOTIC,
    "one damper reaches all",
)
known(
    30,
    "free point",
    scene("bodies: {p: {type: planar_point, mass: 1}}\nreference: {coordinates: {p: {x: 0, y: 0}}}\n"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "nothing but shifts and speeds",
)
PAIR = """
bodies: {{a: {{type: planar_point, mass: 1}}, b: {{type: planar_point, mass: 1}}}}
forces: {{spring: {{type: spring, between: [a, b], stiffness: 2, length: {length}, damping: {damping}}}}}
reference:
  coordinates: {{a: {{x: -1, y: 0}}, b: {{x: 1, y: 0}}}}
{rates}
"""
known(
    30,
    "two free points on a spring",
    scene(PAIR.format(length=2, damping=0, rates="")),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy at given momenta",
)
known(
    30,
    "two free points on a damped spring",
    scene(PAIR.format(length=2, damping=0.5, rates="")),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "a rigid motion remains",
    in_place=False,
)
TURNING = "  rates: {a: {x: 0, y: -1}, b: {x: 0, y: 1}}\n  steady: {axis: z, rate: 1}"
known(
    31,
    "two points turning about each other",
    scene(PAIR.format(length="3/2", damping=0.5, rates=TURNING)),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "ten neutral eigenvalues, four of them ±i",
    in_place=False,
)
known(
    31,
    "two points turning about each other, undamped",
    scene(PAIR.format(length="3/2", damping=0, rates=TURNING)),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy at given momenta",
)
STRING = """
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces:
  left: {{type: spring, between: [p, {{body: ground, point: [-1, 0]}}], stiffness: 1, length: {length}, damping: {c}}}
  right: {{type: spring, between: [p, {{body: ground, point: [1, 0]}}], stiffness: 1, length: {length}, damping: {c}}}
reference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}
"""
known(
    127,
    "between two relaxed springs",
    scene(STRING.format(length=1, c=0)),
    STABLE,
    UNDECIDED,
    "across, the energy grows with the fourth power; at linear order it drifts",
    never=[MARGINAL],
)
known(127, "between two pressed springs", scene(STRING.format(length=1.01, c=1)), UNSTABLE, UNSTABLE, "buckles")
known(127, "between two stretched springs", scene(STRING.format(length=0.99, c=0)), STABLE, STABLE, "minimum")
TRUSS = """
bodies: {{apex: {{type: planar_point, mass: 1}}}}
forces:
  left: {{type: spring, between: [apex, {{body: ground, point: [-4, 0]}}], stiffness: 1, length: 125/16, damping: {c}}}
  right: {{type: spring, between: [apex, {{body: ground, point: [4, 0]}}], stiffness: 1, length: 125/16, damping: {c}}}
  load: {{type: force, at: apex, vector: [0, -27/8]}}
reference: {{coordinates: {{apex: {{x: 0, y: 3}}}}}}
"""
known(
    36,
    "truss at its fold",
    scene(TRUSS.format(c=0)),
    UNSTABLE,
    UNDECIDED,
    "the third derivative of the energy is not zero",
    never=[MARGINAL],
)
known(
    36,
    "truss at its fold, damped",
    scene(TRUSS.format(c=1)),
    UNSTABLE,
    UNDECIDED,
    "one zero, y' = c y² on its manifold",
)

# --- bodies ---------------------------------------------------------------------------------------------------------

CART = """
gravity: [0, -9.81]
bodies:
  cart: {type: planar, mass: 1, inertia: 1}
  rod: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, -side/2]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: x}
  pivot: {type: revolute, between: [rod.O, cart]}
forces: {brake: {type: joint_spring, joint: rail, damping: c}}
reference: {coordinates: {cart: {x: 0, y: 0, theta: 0}, rod: {x: 0, y: side/2, theta: 0}}}
"""
known(
    28,
    "pendulum on a free cart",
    scene(CART, "side: -1\nc: 0"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy at the given momentum",
)
known(
    28,
    "pendulum on a damped cart",
    scene(CART, "side: -1\nc: 0.5"),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "the place remains",
    in_place=True,
    swept=("c", (0.2, 0.5, 1.0)),
)
known(29, "pendulum upright on a cart", scene(CART, "side: 1\nc: 0"), UNSTABLE, UNSTABLE, "saddle beside zeros")
known(
    29,
    "wheeled inverted pendulum",
    shipped("wheeled_inverted_pendulum"),
    UNSTABLE,
    UNSTABLE,
    "saddle beside zeros",
)
known(
    128,
    "chain hanging from a sliding pivot",
    scene("""
gravity: [0, -9.81]
bodies:
  slider: {type: planar, mass: 1, inertia: 1}
  one: {type: planar, mass: 1, inertia: 1/12, points: {A: [0, 1/2], B: [0, -1/2]}}
  two: {type: planar, mass: 1, inertia: 1/12, points: {A: [0, 1/2], B: [0, -1/2]}}
joints:
  rail: {type: prismatic, between: [ground, slider], axis: x}
  first: {type: revolute, between: [one.A, slider]}
  second: {type: revolute, between: [two.A, one.B]}
reference:
  coordinates: {slider: {x: 0, y: 0, theta: 0}, one: {x: 0, y: -1/2, theta: 0}, two: {x: 0, y: -3/2, theta: 0}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy at the given momentum",
)
known(
    32,
    "rod pinned at its middle",
    scene("""
gravity: [0, -9.81]
bodies: {rod: {type: planar, mass: 1, inertia: 1}}
joints: {pivot: {type: revolute, between: [rod, ground]}}
reference: {coordinates: {rod: {x: 0, y: 0, theta: 0.3}}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "nothing is left to judge: the angle drifts",
)
known(
    33,
    "Roberval balance, tilted",
    scene(
        """
gravity: [0, -9.81]
bodies:
  upper: {type: planar, mass: 1, inertia: 1/3, points: {L: [-1, 0], R: [1, 0]}}
  lower: {type: planar, mass: 1, inertia: 1/3, points: {L: [-1, 0], R: [1, 0]}}
  left: {type: planar, mass: 2, inertia: 1, points: {A: [0, 1], B: [0, -1]}}
  right: {type: planar, mass: 2, inertia: 1, points: {A: [0, 1], B: [0, -1]}}
joints:
  top: {type: revolute, between: [upper, {body: ground, point: [0, 1]}]}
  bottom: {type: revolute, between: [lower, {body: ground, point: [0, -1]}]}
  upper_left: {type: revolute, between: [upper.L, left.A]}
  upper_right: {type: revolute, between: [upper.R, right.A]}
  lower_left: {type: revolute, between: [lower.L, left.B]}
  lower_right: {type: revolute, between: [lower.R, right.B]}
reference:
  coordinates:
    upper: {x: 0, y: 1, theta: a}
    lower: {x: 0, y: -1, theta: a}
    left: {x: -cos(a), y: -sin(a), theta: 0}
    right: {x: cos(a), y: sin(a), theta: 0}
""",
        "a: 0.3",
    ),
    STABLE_UP_TO,
    UNDECIDED,
    "at rest at any angle, which no symmetry tells; it drifts along",
)
known(
    129,
    "free body in the plane",
    scene("""
bodies: {body: {type: planar, mass: 1, inertia: 1}}
reference: {coordinates: {body: {x: 0, y: 0, theta: 0}}, rates: {body: {x: 0, y: 0, theta: 2}}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "nothing but shifts, turns and speeds",
)
known(
    130,
    "body on a frictionless table",
    scene("""
gravity: [0, 0, -9.81]
bodies: {body: {type: spatial, mass: 1, inertia: [1, 2, 2]}}
joints: {table: {type: planar, between: [ground, body], axis: z}}
reference: {coordinates: {body: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "nothing but shifts, turns and speeds",
)
known(
    131,
    "disk on a line",
    scene("""
gravity: [0, -9.81]
bodies: {disk: {type: planar, mass: 1, inertia: 1/8}}
contacts: {ground: {type: disk, center: disk, radius: 1/2}}
reference:
  coordinates: {disk: {x: 0, y: 1/2, theta: 0}}
  rates: {disk: {x: 3, y: 0, theta: -6}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "another place, another speed",
)
for moments, truth, best, warns, name in (
    ((1.5, 3, 2), STABLE_UP_TO, STABLE_UP_TO, "", "greatest"),
    ((1.5, 1, 2), STABLE_UP_TO, STABLE_UP_TO, "damping", "least"),
    ((1, 2, 3), UNSTABLE, UNSTABLE, "", "middle"),
):
    text = shipped("free_rigid_body", I1=moments[0], I2=moments[1], I3=moments[2])
    known(37, f"free body about its {name} axis", text, truth, best, "Euler", warns=warns)
known(
    38,
    "free sphere turning",
    shipped("free_rigid_body", I1=2, I2=2, I3=2),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "every turn of the body is a symmetry",
)
known(
    132,
    "free round body about a transverse axis",
    shipped("free_rigid_body", I1=2, I2=2, I3=1),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "the slow turn about its own axis is a symmetry",
    least=UNDECIDED,
)
known(
    133,
    "satellite with a rotor",
    scene("""
bodies:
  hull: {type: spatial, mass: 1, inertia: [2, 3, 4]}
  wheel: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.2]}
joints: {bearing: {type: revolute, between: [hull, wheel], axis: z}}
reference:
  coordinates: {hull: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, wheel: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates: {hull: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, wheel: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 50}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "the energy of the hull is least at rest, the momentum of the wheel is conserved",
    least=UNDECIDED,
)
TOP = """
gravity: [0, 0, -9]
bodies: {top: {type: spatial, mass: 1, inertia: [3, 3, 4], points: {O: [0, 0, -1]}}}
joints: {tip: {type: spherical, between: [top.O, ground]}}
reference:
  coordinates: {top: {x: 0, y: 0, z: 1, phi: 0, theta: 0, psi: 0}}
  rates: {top: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: omega}}
"""
known(
    39,
    "sleeping top, fast",
    scene(TOP, "omega: 4"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "Chetaev; critical spin 2 sqrt((3 + 1)·9)/4 = 3",
    warns="damping",
)
known(39, "sleeping top, slow", scene(TOP, "omega: 2"), UNSTABLE, UNSTABLE, "critical spin 3")
known(
    40,
    "sleeping top at its critical spin",
    scene(TOP, "omega: 3"),
    STABLE_UP_TO,
    UNDECIDED,
    "the effective potential grows with the fourth power; linear motions grow with t",
    never=[MARGINAL],
)
known(
    41,
    "top with a driven Cardan angle",
    shipped("top"),
    None,
    MARGINAL,
    "the drive breaks the turn about the vertical: no second integral",
    also=[MARGINAL],
    warns="damping",
)
known(41, "slow top with a driven Cardan angle", shipped("top", omega=4), UNSTABLE, UNSTABLE, "linear")
DISK = mechanisms.FREE_DISK.replace("mbstab: 1\n", "")


def free_disk(omega):
    return scene(DISK.replace("x: -1.5", "x: -0.3*omega").replace("psi: 5}", "psi: omega}"), f"omega: {omega}")


known(
    42,
    "rolling disk, fast",
    free_disk(5),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "reversible with one pair; critical spin 3.3168",
    least=MARGINAL,
)
known(42, "rolling disk, slow", free_disk(1), UNSTABLE, UNSTABLE, "critical spin 3.3168")
known(
    43,
    "disk with a driven Cardan angle",
    shipped("rolling_disk"),
    None,
    UNDECIDED,
    "steady circles do not exist",
    also=[MARGINAL],
)
known(43, "slow disk with a driven Cardan angle", shipped("rolling_disk", omega=1), UNSTABLE, UNSTABLE, "linear")
known(
    44,
    "sleigh forwards",
    shipped("chaplygin_sleigh"),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "place, heading and speed remain",
    in_place=False,
)
known(44, "sleigh backwards", shipped("chaplygin_sleigh", v=-1), UNSTABLE, UNSTABLE, "turns round")
known(
    134,
    "sleigh at rest",
    shipped("chaplygin_sleigh", v=0),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "the energy bounds the speeds, which are all that is left apart from place and heading",
    least=UNDECIDED,
    swept=("v", (-0.5, 0.0, 0.5)),
)
BLADE = """
GRAVITY
bodies: {skate: {type: planar, mass: 1, inertia: 1}}
contacts: {blade: {type: knife_edge, at: skate, along: x}}
reference: {coordinates: {skate: {x: 0, y: 0, theta: 0}}, rates: {skate: {x: v, y: 0, theta: 0}}}
"""
known(
    45,
    "skate at rest across a slope",
    scene(BLADE.replace("GRAVITY", "gravity: [0, -1]"), "v: 0"),
    UNSTABLE,
    UNDECIDED,
    "turning slowly it reaches 2 g/omega however small omega is",
    never=[MARGINAL],
)
known(
    135,
    "skate at rest on the level",
    scene(BLADE.replace("GRAVITY\n", ""), "v: 0"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "speed and turn rate stay what they are",
    least=UNDECIDED,
)
known(
    135,
    "skate sliding on the level",
    scene(BLADE.replace("GRAVITY\n", ""), "v: 2"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "speed and turn rate stay what they are",
    least=UNDECIDED,
)
known(136, "trailer", shipped("trailer"), ASYMPTOTIC, ASYMPTOTIC, "s = -v/L", swept=("v", (5.0, 10.0, 15.0)))
known(136, "trailer backwards", shipped("trailer", v=-10), UNSTABLE, UNSTABLE, "s = -v/L")
known(136, "trailer parked", shipped("trailer", v=0), STABLE, UNDECIDED, "hitch and axle held: any angle, for ever")
for speed, truth, best, place in (
    (4, UNSTABLE, UNSTABLE, None),
    (5, ASYMPTOTIC_UP_TO, ASYMPTOTIC_UP_TO, False),
    (7, UNSTABLE, UNSTABLE, None),
):
    text = shipped("whipple_bicycle", v=speed)
    swept = ("v", (speed - 0.1, float(speed), speed + 0.1))
    known(46, f"bicycle at {speed} m/s", text, truth, best, "benchmark", in_place=place, swept=swept)
known(47, "rattleback at rest", shipped("rattleback"), STABLE_UP_TO, STABLE_UP_TO, "the energy is definite")
known(47, "rattleback spinning", shipped("rattleback", omega=5), UNSTABLE, UNSTABLE, "one of the rockings grows")
known(47, "rattleback spinning backwards", shipped("rattleback", omega=-5), UNSTABLE, UNSTABLE, "the other one grows")
known(
    48,
    "Watt governor, driven",
    shipped("governor"),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "the heading remains",
    in_place=True,
)
DRIVE = "drives:\n  spin: {type: coordinate, coordinate: shaft.psi, velocity: omega}\n\n"
known(
    48,
    "Watt governor, free",
    shipped("governor", replace=[(DRIVE, "")]),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "heading and momentum remain",
    in_place=False,
)
known(
    34,
    "bead at the pitchfork of its hoop",
    shipped("bead_on_hoop", g=8, Omega=4),
    STABLE_UP_TO,
    UNDECIDED,
    "the effective potential grows with the fourth power; at linear order it drifts",
    also=[STABLE],
    never=[MARGINAL],
)
known(34, "bead at rest in its hoop", shipped("bead_on_hoop"), STABLE_UP_TO, STABLE_UP_TO, "minimum", also=[STABLE])
known(
    34,
    "raised bead in its hoop",
    shipped("bead_on_hoop", Omega=6, theta=1),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum",
    also=[STABLE],
)
known(34, "bead below in a fast hoop", shipped("bead_on_hoop", Omega=6), UNSTABLE, UNSTABLE, "maximum")
known(
    24,
    "Ziegler's column, undamped",
    shipped("ziegler_column", P=1, b_1=0, b_2=0),
    None,
    MARGINAL,
    "reversible without an energy: nonlinear stability is open",
    also=[MARGINAL],
    swept=("P", (0.5, 1.0, 1.5)),
)
known(
    25,
    "Ziegler's column, slightly damped",
    shipped("ziegler_column", P=1.2, b_1="1e-9", b_2="2e-9"),
    UNSTABLE,
    UNSTABLE,
    "damping destabilizes above 1.1126: growth of 2.2e-11 1/s",
)
known(
    26,
    "Ziegler's column, hardly damped",
    shipped("ziegler_column", P=1.2, b_1="1e-17", b_2="2e-17"),
    UNSTABLE,
    UNDECIDED,
    "the same below rounding",
    digits=UNSTABLE,
)
known(137, "wheelset, slow", shipped("wheelset"), ASYMPTOTIC, ASYMPTOTIC, "below the critical speed")
known(137, "wheelset, fast", shipped("wheelset", V=100), UNSTABLE, UNSTABLE, "hunting")
known(
    138,
    "wheelset without slip",
    shipped("wheelset_no_slip"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "its paths are closed about the track: ln cos(theta) - gamma y²/(2 r h) and the energy are conserved",
    least=UNDECIDED,
)
known(139, "shimmy, stable", shipped("shimmy"), ASYMPTOTIC, ASYMPTOTIC, "a b > r²", swept=("a", (0.4, 0.5, 0.6)))
known(139, "shimmy, unstable", shipped("shimmy", a=0.2), UNSTABLE, UNSTABLE, "a b < r²")
known(
    10,
    "ball on a turntable",
    scene(
        """
gravity: [0, 0, -9.81]
bodies: {ball: {type: spatial, mass: 1, inertia: [2/5, 2/5, 2/5]}}
joints: {table: {type: point_on_plane, between: [{body: ground, point: [0, 0, 1]}, ball], axis: z}}
constraints:
  along:
    nonholonomic: >-
      rate(ball.x) - rate(ball.theta)*cos(ball.phi) + rate(ball.psi)*sin(ball.phi)*cos(ball.theta) + W*ball.y
  across: {nonholonomic: "rate(ball.y) + rate(ball.phi) + rate(ball.psi)*sin(ball.theta) - W*ball.x"}
reference: {coordinates: {ball: {x: 0, y: 0, z: 1, phi: 0, theta: 0, psi: 0}}}
""",
        "W: 3",
    ),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "circles of any size and place, about which the ball turns",
    also=[STABLE],
)

known(
    151,
    "rod on a spring below rounding",
    balanced("hinge: {type: joint_spring, joint: pivot, stiffness: 1e-30}"),
    STABLE,
    STABLE,
    "a minimum, however flat",
    least=UNDECIDED,
    digits=STABLE,
)
known(
    151,
    "rod on a push below rounding",
    balanced("push: {type: expression, on: {rod.theta: 1e-30*rod.theta}}"),
    UNSTABLE,
    UNSTABLE,
    "growth of 3.5e-15 1/s",
    least=UNDECIDED,
    digits=UNSTABLE,
)
for speed, name in ((0, "at rest"), (2, "rolling")):
    text = scene(f"""
gravity: [0, 0, -9.81]
bodies: {{ball: {{type: spatial, mass: 1, inertia: [2/5, 2/5, 2/5]}}}}
contacts: {{plane: {{type: ellipsoid, center: ball, a: 1, b: 1, c: 1}}}}
reference:
  coordinates: {{ball: {{x: 0, y: 0, z: 1, phi: 0, theta: 0, psi: 0}}}}
  rates: {{ball: {{x: 0, y: {-speed}, z: 0, phi: {speed}, theta: 0, psi: 0}}}}
""")
    known(152, f"ball {name}", text, STABLE_UP_TO, STABLE_UP_TO, "every motion rolls straight on", least=UNDECIDED)
known(
    153,
    "two things that do not touch",
    scene("""
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, 1/2]}}
  wheel: {type: planar, mass: 1, inertia: 1}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
  axle: {type: revolute, between: [wheel, {body: ground, point: [2, 0]}]}
forces: {hinge: {type: joint_spring, joint: pivot, damping: 0.1}}
reference: {coordinates: {rod: {x: 0, y: -1/2, theta: 0}, wheel: {x: 2, y: 0, theta: 0}}}
"""),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "a damped pendulum and a free wheel",
    in_place=False,
)
known(
    154,
    "top hanging without spin",
    scene(TOP.replace("[0, 0, -1]", "[0, 0, 1]").replace("z: 1,", "z: -1,"), "omega: 0"),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "minimum of the energy; its own turn drifts",
)
known(
    155,
    "pendulum on a cart that is driven evenly",
    scene("""
gravity: [0, -9.81]
bodies:
  cart: {type: planar, mass: 1, inertia: 1}
  rod: {type: planar, mass: 1, inertia: 1/12, points: {O: [0, 1/2]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: x}
  pivot: {type: revolute, between: [rod.O, cart]}
drives: {motor: {type: joint, joint: rail, position: -3*t}}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, rod: {x: 0, y: -1/2, theta: 0}}
  rates: {cart: {x: 3, y: 0, theta: 0}, rod: {x: 3, y: 0, theta: 0}}
"""),
    STABLE,
    STABLE,
    "the same as at rest",
)
TRACK = """
bodies: {cart: {type: planar_point, mass: 1}, p: {type: planar_point, mass: 1}}
joints:
  rail: {type: point_on_line, between: [ground, cart], axis: x}
  guide: {type: point_on_line, between: [ground, p], axis: y}
drives: {motor: {type: point, at: cart, direction: x, position: 2*t}}
forces: {spring: {type: expression, on: {p.y: -(1 + sin(cart.x)/2)*p.y}}}
reference:
  coordinates: {cart: {x: 0, y: 0}, p: {x: 0, y: 0}}
  rates: {cart: {x: 2, y: 0}, p: {x: 0, y: 0}}
"""
known(
    156,
    "spring that a driven cart changes",
    scene(TRACK),
    UNSTABLE,
    UNDECIDED,
    "no law contains t, but the spring pulsates with twice its own frequency",
)
known(
    156,
    "spring that a driven cart changes, with its period",
    scene(TRACK + "  period: pi\n"),
    UNSTABLE,
    UNSTABLE,
    "parametric resonance",
    least=UNDECIDED,
    commands=PERIODIC,
)
SHAFT = """
bodies:
  rotor: {type: planar, mass: 1, inertia: 1, points: {X: [1, 0], Y: [0, 1]}}
  bob: {type: planar_point, mass: 1}
joints: {bearing: {type: revolute, between: [rotor, ground]}}
drives: {motor: {type: coordinate, coordinate: rotor.theta, position: Omega*t}}
forces:
  shaft: {type: spring, between: [bob, ground], stiffness: 1}
  inner_x: {type: spring, between: [bob, rotor.X], damping: 0.1}
  inner_y: {type: spring, between: [bob, rotor.Y], damping: 0.1}
  outer_x: {type: spring, between: [bob, {body: ground, point: [1, 0]}], damping: 0.1}
  outer_y: {type: spring, between: [bob, {body: ground, point: [0, 1]}], damping: 0.1}
reference:
  coordinates: {rotor: {x: 0, y: 0, theta: 0}, bob: {x: 0, y: 0}}
  rates: {rotor: {x: 0, y: 0, theta: Omega}, bob: {x: 0, y: 0}}
"""
for Omega, truth in ((1.5, ASYMPTOTIC), (2.5, UNSTABLE)):
    name, parameters = f"bob with dampers on a rotor, {Omega} rad/s", f"Omega: {Omega}"
    known(157, name, scene(SHAFT, parameters), truth, truth, LIMIT, least=UNDECIDED)
    text = scene(SHAFT + "  period: 2*pi/Omega\n", parameters)
    known(157, f"{name}, with its period", text, truth, truth, LIMIT, least=UNDECIDED, commands=PERIODIC)

# --- time -----------------------------------------------------------------------------------------------------------


def periodic(law, period, **more):
    return point(law, reference=f"  period: {period}\n", **more)


known(
    50, "Kapitza's pendulum, fast", shipped("kapitza"), STABLE, MARGINAL, "Bardin and Markeev 1995", commands=PERIODIC
)
known(50, "Kapitza's pendulum, slow", shipped("kapitza", nu=60), UNSTABLE, UNSTABLE, "falls", commands=PERIODIC)
BRAKE = [("reference:\n", "forces: {brake: {type: expression, on: {rod.theta: -0.01*rate(rod.theta)}}}\nreference:\n")]
known(
    50,
    "Kapitza's pendulum, damped",
    shipped("kapitza", replace=BRAKE),
    ASYMPTOTIC,
    ASYMPTOTIC,
    "both multipliers lie inside",
    commands=PERIODIC,
)
MATHIEU = "-(d + 0.1*cos(t))*x"


def mathieu(d, period="2*pi"):
    return periodic(MATHIEU, period, parameters=f"d: {d}")


known(51, "Mathieu, stable", mathieu("0.5"), STABLE, MARGINAL, "linear with |trace| < 2", commands=PERIODIC)
known(51, "Mathieu, unstable", mathieu("0.25"), UNSTABLE, UNSTABLE, "in the first tongue", commands=PERIODIC)
known(
    51,
    "Mathieu at the edge of a tongue",
    mathieu("0.298718514801153889"),
    UNSTABLE,
    UNDECIDED,
    "a_1(0.2)/4 = 0.29871851480115388923 is above it: just inside; a double multiplier -1",
    commands=PERIODIC,
)
known(
    52,
    "Mathieu at the first edge",
    mathieu("-0.00497832408960938"),
    UNSTABLE,
    UNDECIDED,
    "a_0(0.2)/4 = -0.00497832408960937959 is above it: just outside; a double multiplier 1, no shift in time",
    commands=PERIODIC,
)
known(
    140,
    "Mathieu with twice its period",
    mathieu("0.5", "4*pi"),
    STABLE,
    MARGINAL,
    "a multiple of the period is a period",
    least=UNDECIDED,
    commands=PERIODIC,
)
known(
    140,
    "Mathieu, damped, with a wrong period",
    periodic("-(0.25 + 0.1*cos(t))*x - 0.001*u", "3*pi"),
    UNSTABLE,
    UNDECIDED,
    "in the first tongue; the law does not have this period",
    commands=PERIODIC,
)
SHAKEN = "-(1 + sin(2*pi*t/3)/2)*x"
known(
    53,
    "shaken spring, no period stated",
    point(SHAKEN),
    UNSTABLE,
    UNDECIDED,
    "looked at every 1.5 s or 3 s it is constant; it grows by 1.405 in a period",
)
known(53, "shaken spring", periodic(SHAKEN, 3), UNSTABLE, UNSTABLE, "grows by 1.405 in a period", commands=PERIODIC)
known(
    53,
    "shaken spring, half of its period stated",
    periodic(SHAKEN, "3/2"),
    UNSTABLE,
    UNDECIDED,
    "the coefficient is 1 at both ends",
    commands=PERIODIC,
)
known(
    54,
    "spring that turns into a push at 50 s",
    point("tanh(t - 50)*x - 0.1*u"),
    UNSTABLE,
    UNDECIDED,
    "near t = 0 constant to 1e-43",
)
LATER = "-(1 - 2*smooth_start((t - 5)/10))*x - 0.1*u"
known(55, "push that begins at 5 s", point(LATER), UNSTABLE, UNDECIDED, "before 5 s all samples agree")
known(
    55,
    "push that begins to be constant",
    point(LATER, reference="  time: 15\n"),
    UNSTABLE,
    UNSTABLE,
    "constant from 15 s on",
    least=UNDECIDED,
)
known(158, "time that cancels", point("-x + 0*t"), STABLE, STABLE, "no law depends on time", least=UNDECIDED)
known(
    158,
    "time that cancels by an identity",
    point("-(sin(t)**2 + cos(t)**2)*x"),
    STABLE,
    UNDECIDED,
    "no law depends on time",
)
known(55, "push that has begun", point(LATER, reference="  time: 20\n"), UNSTABLE, UNSTABLE, "constant after 15 s")
known(
    141,
    "push in the direction of growth that ends at 100 s",
    point("-x - 0.1*u + 2*(1 - smooth_start((t - 90)/10))*x"),
    ASYMPTOTIC,
    UNDECIDED,
    "grows for 100 s, then decays for ever",
)
known(
    141,
    "push that has ended",
    point("-x - 0.1*u + 2*(1 - smooth_start((t - 90)/10))*x", reference="  time: 100\n"),
    ASYMPTOTIC,
    ASYMPTOTIC,
    "constant after 100 s",
)
known(
    143,
    "damped spring with a stated period",
    periodic("-x - 0.1*u", "3.7"),
    ASYMPTOTIC,
    ASYMPTOTIC,
    "constant coefficients have every period",
    commands=PERIODIC,
)
known(
    143,
    "spring with its own period stated",
    periodic("-x", "2*pi"),
    STABLE,
    STABLE,
    "two multipliers 1 with two vectors, which no shift in time explains",
    least=UNDECIDED,
    commands=PERIODIC,
)
known(
    56,
    "van der Pol's cycle",
    periodic("(1 - x**2)*u - x", "6.663286859323130189699682", at=("2.00861986087484313650964", 0)),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "one multiplier 1 is the shift in time",
    never=[ASYMPTOTIC],
    commands=PERIODIC,
)
known(
    56,
    "round cycle",
    periodic("-x - (x**2 + u**2 - 1)*u", "2*pi", at=(1, 0)),
    ASYMPTOTIC_UP_TO,
    ASYMPTOTIC_UP_TO,
    "x = cos t; one multiplier 1 is the shift in time",
    commands=PERIODIC,
)
known(
    56,
    "pendulum swinging by 1 rad",
    scene("""
gravity: [0, -9.81]
bodies: {rod: {type: planar, mass: 1, inertia: 0.04/3, points: {O: [0, 0.2]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
reference:
  period: 1.104645906961319393276709581583
  coordinates: {rod: {x: 0.2*sin(1), y: -0.2*cos(1), theta: 1}}
  rates: {rod: {theta: 0}}
"""),
    STABLE_UP_TO,
    STABLE_UP_TO,
    "a double multiplier 1: the shift in time, and the energy",
    commands=PERIODIC,
)


# --- found by trying to prove the rule wrong ------------------------------------------------------------------------

UP = "gravity: [0, -9.81]\n"
known(
    59,
    "valley of rests that no symmetry makes, with a rolling row",
    scene("""
bodies: {p: {type: point, mass: 1}}
constraints: {row: {nonholonomic: rate(p.z) - p.y*rate(p.x)}}
forces: {push: {type: expression, on: {p.x: -p.x*(1-p.z), p.y: -p.y*(1-p.z), p.z: (p.x**2+p.y**2)/2}}}
reference: {coordinates: {p: {x: 0, y: 0, z: 0}}}
"""),
    UNSTABLE,
    UNDECIDED,
    "circles of radius e in x and y drive z by e²/2 on average, to where x and y are pushed away",
    also=[MARGINAL],
)
known(
    59,
    "blade with springs that pull and push",
    scene("""
bodies: {b: {type: planar, mass: 1, inertia: 1}}
contacts: {blade: {type: knife_edge, at: b, along: [1, 0]}}
forces: {push: {type: expression, on: {b.x: -b.x, b.y: b.y, b.theta: -b.theta}}}
reference: {coordinates: {b: {x: 0, y: 0, theta: 0}}}
"""),
    UNSTABLE,
    UNDECIDED,
    "x and the angle are in resonance: y'' = (A²/4) y on average",
    also=[MARGINAL],
)
known(
    60,
    "valley that opens",
    point("-x*y**2", "-x**2*y", at=(1, 0)),
    UNSTABLE,
    UNDECIDED,
    "V = x²y²/2: swinging across drives the point along the valley, to x = 0, where nothing holds y",
    also=[MARGINAL],
)
known(
    61,
    "critical damping of what a speed is carried by",
    point("y*u", "-v - y**3"),
    UNSTABLE,
    UNDECIDED,
    "y decays like t^(-1/2), so the speed along x grows like exp(sqrt(2t))",
)
known(
    61,
    "speed that a row beside it lets grow",
    point("y*u", "0*y", more="constraints: {a: {nonholonomic: rate(p.y)}}\n"),
    UNSTABLE,
    UNDECIDED,
    "y = c stays, and x'' = c x'",
)
BOW = "constraints: {{a: {{holonomic: p.y + 1e-10*p.x**{0}}}}}\n" + UP
for drag, number in (("-u", 2), ("-u", 4)):
    known(
        62,
        f"top of a hill that is flat to 1e-10, of order {number}",
        point(drag, "0*y", more=BOW.format(number)),
        UNSTABLE,
        UNSTABLE,
        "the rails differ by 1e-10 m only, and gravity tells",
        least=UNSTABLE if number == 2 else UNDECIDED,
    )
known(
    62,
    "door whose axis leans by 1e-10",
    scene("""
gravity: [0, 0, -9.81]
bodies: {door: {type: spatial, mass: 1, inertia: [1, 1, 1], points: {H: [-1, 0, 0]}}}
joints: {hinge: {type: revolute, between: [door.H, ground], axis: [-1e-10, 0, 1]}}
forces: {d: {type: joint_spring, joint: hinge, damping: 1}}
reference: {coordinates: {door: {x: 1, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}
"""),
    UNSTABLE,
    UNSTABLE,
    "the door stands where its centre of mass is highest",
)
known(
    63,
    "row that drives by 1e-10",
    point("y**2/2", "-y*(1 - x)", more="constraints: {a: {nonholonomic: rate(p.x) - 1e-10*p.y**2}}\n"),
    UNSTABLE,
    UNDECIDED,
    "x' = 1e-10 y² takes x past 1",
    also=[MARGINAL],
)
for name, rows in (
    ("rows that touch", "{a: {holonomic: p.y}, b: {holonomic: p.y - p.x**4}}"),
    ("rows that touch, of order 6", "{a: {holonomic: p.y}, b: {holonomic: p.y - p.x**6}}"),
    ("rows that touch, of order 7 and weakly", "{a: {holonomic: p.y}, b: {holonomic: p.y - 0.01*p.x**7}}"),
    ("rows that touch, of order 16", "{a: {holonomic: p.y}, b: {holonomic: p.y - p.x**16}}"),
    ("rows on speeds that touch", "{a: {nonholonomic: rate(p.y)}, b: {nonholonomic: rate(p.y) - p.x**2*rate(p.x)}}"),
):
    known(64, name, point("x", "0*y", more=f"constraints: {rows}\n"), STABLE, UNDECIDED, "nothing can move")
known(
    64,
    "row that vanishes at the reference only",
    point("x", "y", more="constraints: {a: {nonholonomic: p.x*rate(p.x) + p.y*rate(p.y)}}\n"),
    STABLE,
    UNDECIDED,
    "the distance from the origin stays what it is",
)
known(
    65,
    "zero but for 1e-60",
    point("-u + 1e-60*x - x**3"),
    UNSTABLE,
    UNSTABLE,
    "50 digits do not tell 1e-60 from zero",
    least=UNDECIDED,
)
known(
    66,
    "trough in a ring with a push of 1e-13 along it",
    point("-(x**2 + y**2 - 1)*x - u", "-(x**2 + y**2 - 1)*y - v + 1e-13*y**3", at=(1, 0)),
    UNSTABLE,
    UNDECIDED,
    "the angle creeps away like its cube",
)
for name, push in (
    ("push in a narrow range under a load", "1e3*y**3*exp(-(y/1e-3)**2)"),
    ("weak push under a load", "1e-8*tanh((y/1e-4)**3)"),
):
    known(
        67,
        name,
        point("-u", f"9.81 - v + {push}", more=UP),
        UNSTABLE,
        UNSTABLE,
        "y' = c y³ near 0",
        least=UNDECIDED,
    )
known(
    67,
    "speed that no sample of order one sees change",
    point("1e3*u**3*exp(-(u/1e-5)**2)"),
    UNSTABLE,
    UNDECIDED,
    "no speed is steady",
)
known(
    68,
    "stiffness that is singular to 2e-12",
    point("-x + 0.73245191834*y - u", "x - 0.732451918338*y - v"),
    UNSTABLE,
    UNSTABLE,
    "det K = -2e-12",
)
known(
    68,
    "stiffness that is singular to 1e-6 beside a strong force",
    scene("""
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
constraints: {c: {holonomic: b.y}}
forces:
  f:
    type: expression
    on:
      a.x: -a.x + 0.73245191834*a.y - rate(a.x) + 1000000*(b.x + rate(b.x))
      a.y: a.x - 0.732451*a.y - rate(a.y) + 1000000*(b.x + rate(b.x))
      b.x: -b.x - rate(b.x)
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
"""),
    UNSTABLE,
    UNSTABLE,
    "det K = -9e-7: the strong force hides no weak one",
)
known(
    69,
    "weak growth beside a strong damper in one force",
    point("-1e6*u", "-y + 1e-12*v"),
    UNSTABLE,
    UNSTABLE,
    "y'' = 1e-12 y' - y",
)
known(
    69,
    "growth below the rounding of a strong damper in the same force",
    point("-1e6*u", "-y + 1e-40*v"),
    UNSTABLE,
    UNDECIDED,
    "y'' = 1e-40 y' - y",
)
known(
    69,
    "weak growth in a gyroscopic force",
    point("-x + 2*v", "-y - 2*u + 1e-12*v"),
    UNSTABLE,
    UNSTABLE,
    "trace 1e-12",
)
known(
    70,
    "slow growth of second order in a coupling",
    point("-u + 1e-22*y", "-y - v + 1e-22*x"),
    UNSTABLE,
    UNSTABLE,
    "the least eigenvalue is 1e-44",
)

# --- states that only follow ----------------------------------------------------------------------------------------

FOLLOWING = "beside what stays near, what follows it and decays by itself stays near as well"
for name, x, states in (
    ("a filter", "-x", "{z: {rate: p.x - z}}"),
    ("a filter of a rate and a square", "-x - x**3", "{z: {rate: rate(p.x) + p.x**2 - z}}"),
    ("a chain of filters", "-x", "{z: {rate: p.x - z}, w: {rate: z - 2*w + rate(z)}}"),
    ("a slow filter", "-x", "{z: {rate: p.x - 1e-9*z}}"),
):
    known(71, f"spring with {name}", point(x, more=f"states: {states}\n"), STABLE, STABLE, FOLLOWING, in_place=True)
known(
    71,
    "pendulum with a filter of its angle",
    pendulum().replace("gravity:", "states: {z: {rate: (angle(pivot) - z)/0.1}}\ngravity:", 1),
    STABLE,
    STABLE,
    FOLLOWING,
)
known(
    72,
    "spring with a filter that grows",
    point("-x", more="states: {z: {rate: p.x + 1e-9*z}}\n"),
    UNSTABLE,
    UNSTABLE,
    "1e-9 1/s",
)
known(
    72,
    "spring in resonance with what follows",
    point("-x", more="states: {z: {rate: w + p.x}, w: {rate: -z}}\n"),
    UNSTABLE,
    UNDECIDED,
    "a double pair ±i with one vector",
)
known(
    72,
    "spring whose square is integrated, and softens it",
    point("-x*(1 - 1e-10*z)".replace("z", "s"), more="states: {s: {rate: p.x**2}}\n"),
    UNSTABLE,
    UNDECIDED,
    "the state grows until the spring pushes",
)
known(
    72,
    "hardly pushed spring with a filter",
    point("-x + 1e-17*u", more="states: {z: {rate: p.x - z}}\n"),
    UNSTABLE,
    UNDECIDED,
    "the energy increases",
    digits=UNSTABLE,
)
known(
    72,
    "spring that a filter feeds, hardly",
    point("-x - 1e-18*s", more="states: {s: {rate: p.x - s}}\n"),
    UNSTABLE,
    UNDECIDED,
    "the lag drives it: real part 2.5e-19 1/s",
    digits=UNSTABLE,
)
