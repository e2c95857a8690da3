"""The one rule from facts to a verdict: what is not known is never taken for harmless, and facts only strengthen."""

import math
import random
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sampling import sample

import mbstab
from mbstab.analysis.verdict.rule import (
    ASYMPTOTIC,
    ASYMPTOTIC_UP_TO,
    MARGINAL,
    STABLE,
    STABLE_UP_TO,
    STRENGTH,
    UNDECIDED,
    UNSTABLE,
    WORDS,
    Critical,
    Disc,
    Facts,
    Minimum,
    judge,
    place,
    side,
)
from mbstab.analysis.verdict.spectrum import Chains, Neutral
from mbstab.analysis.verdict.wording import unplaced
from mbstab.errors import amount, percent

HELD = "the energy is conserved"
SHIFT = Neutral(("translation along x",), ("speed along x",), 2, Chains((2,)))


def disc(real, imag=0.0, radius=1e-12, count=1, where=None):
    return Disc(complex(real, imag), radius, count, where or side(real, radius), HELD if where == "axis" else "")


def facts(*discs, neutral=None, **more):
    neutral = neutral or Neutral()
    n = sum(d.count for d in discs) + neutral.count
    return Facts(more.pop("expected", n), more.pop("found", n), discs, neutral, **more)


def test_each_rule_has_its_word():
    left, right, pair = disc(-1), disc(1), [disc(0, s, where="axis") for s in (2, -2)]
    minimum = Minimum("the energy", True, True)
    assert judge(facts(left, right)).word == UNSTABLE
    assert judge(facts(left)).word == ASYMPTOTIC
    assert judge(facts(left, neutral=SHIFT)).word == ASYMPTOTIC_UP_TO
    assert judge(facts(neutral=SHIFT)).word == STABLE_UP_TO
    assert judge(facts(*pair)).word == MARGINAL
    assert judge(facts(*pair, minimum=lambda: minimum)).word == STABLE
    assert judge(facts(*pair, neutral=SHIFT, minimum=lambda: replace(minimum, in_place=False))).word == STABLE_UP_TO
    assert judge(facts(*pair, neutral=SHIFT, reversible=lambda: "it is its own mirror image")).word == STABLE_UP_TO
    assert judge(facts(left, disc(0))).word == UNDECIDED
    assert judge(facts(left, disc(0), critical=lambda count, others: Critical(UNSTABLE, "as y²"))).word == UNSTABLE


@pytest.mark.parametrize("radius", [math.inf, math.nan, 1.0])
def test_an_eigenvalue_that_is_not_placed_forbids_every_claim_but_growth(radius):
    open_ = disc(-0.5, radius=radius, where="open")
    assert side(-0.5, radius) == side(0.5, radius) == "open"
    assert judge(facts(disc(-1), open_)).word == UNDECIDED
    assert judge(facts(disc(1), open_)).word == UNSTABLE


@pytest.mark.parametrize(
    "doubt", [{"time": "t"}, {"kink": "|x|"}, {"doubts": ("rank",)}, {"found": 4}, {"expected": 4}, {"rough": "x|x|"}]
)
def test_a_doubt_forbids_claims(doubt):
    assert judge(facts(disc(-1), neutral=SHIFT, **doubt)).word == UNDECIDED


def test_a_doubt_about_time_forbids_growth_as_well_and_one_about_a_count_does_not():
    assert judge(facts(disc(1), time="the equations depend on time")).word == UNDECIDED
    assert judge(facts(disc(1), expected=4)).word == UNSTABLE


def test_nothing_left_to_move_is_no_stability():
    assert judge(facts()).word == UNDECIDED


def test_a_cluster_is_judged_as_a_whole():
    assert judge(facts(disc(1, radius=1e-7, count=2))).word == UNSTABLE
    assert judge(facts(disc(-1, radius=1e-7, count=2))).word == ASYMPTOTIC
    assert judge(facts(disc(0, radius=1e-7, count=2))).word == UNDECIDED


def test_the_axis_needs_a_structure_and_isolation():
    pair = [1j, -1j]
    assert {d.side for d in place(pair, [1e-9] * 2, [1, 1], "")} == {"open"}
    assert {d.side for d in place(pair, [1e-9] * 2, [1, 1], HELD)} == {"axis"}
    # Two within their bounds of each other's mirror image may be a pair off the axis.
    near = [complex(1e-10, 1), complex(-1e-10, 1 + 1e-10)]
    assert {d.side for d in place(near, [1e-9] * 2, [1, 1], HELD)} == {"open"}
    assert {d.side for d in place([1j], [1e-9], [2], HELD)} == {"open"}
    assert {d.side for d in place([0j], [1e-9], [1], HELD)} == {"open"}


words = st.sampled_from(["left", "right", "axis", "open"])


@st.composite
def some_facts(draw):
    discs = []
    for where in draw(st.lists(words, max_size=4)):
        real = {"left": -1.0, "right": 1.0}.get(where, 0.0)
        imag = draw(st.sampled_from([0.0, 2.0])) if where != "axis" else 2.0
        discs.append(disc(real, imag, 1e-9, draw(st.sampled_from([1, 2])), where))
    neutral = draw(st.sampled_from([Neutral(), SHIFT]))
    return facts(*discs, neutral=neutral)


@settings(deadline=None)
@given(some_facts(), st.integers(0, 3), st.booleans())
@pytest.mark.long
def test_less_known_about_an_eigenvalue_never_makes_a_verdict_stronger_or_another(known, number, definite):
    minimum = Minimum("the energy", definite, False)
    known = replace(known, minimum=lambda: minimum)
    before = judge(known).word
    assume(known.discs)
    k = number % len(known.discs)
    opened = tuple(replace(d, side="open") if i == k else d for i, d in enumerate(known.discs))
    after = judge(replace(known, discs=opened)).word
    # A minimum of the energy decides whatever eigenvalues say, unless one is shown to grow.
    if not definite:
        assert after in STRENGTH[before]


@settings(deadline=None)
@given(some_facts())
def test_every_verdict_says_why(known):
    found = judge(known)
    assert found.word in WORDS
    assert found.reasons
    assert all(text and text[-1] not in "., " for text in found.reasons)
    if found.word in (ASYMPTOTIC_UP_TO, STABLE_UP_TO):
        assert found.modulo.symmetries == known.neutral.symmetries


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("centre", [0j, 10j, -1e-9 + 10j])
@pytest.mark.parametrize("radius", [0.0, 1e-8, math.inf])
def test_why_a_verdict_is_open_is_said_without_numbers_that_are_none(count, centre, radius):
    text = unplaced(Disc(centre, radius, count, "open"))
    for nonsense in ("0.0e", "inf", "nan", "within its error bound 0 "):
        assert nonsense not in text
    assert (f"{count} eigenvalues" in text) == (count > 1 and radius < math.inf)
    assert "lie, which" not in text


@pytest.mark.parametrize("x", [0.0, 1e-300, 1.0, math.inf, math.nan])
def test_sizes_in_sentences(x):
    assert "inf" not in amount(x) or "finite" in amount(x)
    assert "0.0e" not in amount(x)
    assert amount(1.24e-5) == "1.2e-05"
    assert (percent(0.0), percent(1.23e-9), percent(0.25)) == ("0.0%", "1.2e-07%", "25.0%")


UPRIGHT = """
mbstab: 1
parameters: {k: 9.81, tilt: 0}
gravity: [0, -9.81]
bodies:
  bob: {type: planar_point, mass: 2}
  rod: {type: planar, mass: 0, inertia: 0, points: {top: [0, 0.5]}}
joints:
  pin: {type: revolute, between: [rod, ground]}
  tip: {type: revolute, between: [bob, rod.top]}
forces:
  spring: {type: joint_spring, joint: pin, stiffness: k}
reference:
  find: equilibrium
  PLACE: {rod: {theta: 0}}
"""


@pytest.mark.parametrize("place", ["guess", "coordinates"])
def test_a_critical_position_that_is_solved_for_is_decided_as_one_that_is_given(place):
    """Torque mgL sin θ − kθ with k = mgL: θ = 0 is a triple solution, and the energy k θ²/2 + mgL cos θ grows as θ⁴."""
    model = mbstab.loads(UPRIGHT.replace("PLACE", place))
    assert model.eig().verdict == "stable"
    assert model.eig_precise(20).verdict == "stable"
    assert model.eig(k=9.8).verdict == "unstable"


@pytest.mark.few(1)
@pytest.mark.parametrize(("damping", "kinds"), [(0, ["critical"] * 2), (1, ["stable node", "critical"])])
def test_zeros_that_nonlinear_terms_judge_are_critical_and_not_neutral(damping, kinds):
    text = UPRIGHT.replace("PLACE", "coordinates").replace("stiffness: k", f"stiffness: k, damping: {damping}")
    result = mbstab.loads(text).eig()
    assert [e.kind for e in result.eigenvalues] == kinds
    assert (result.counts.neutral, result.counts.critical) == (0, kinds.count("critical"))
    assert result.modulo.names == ()
    why = " ".join(result.reasons)
    assert ("damping takes energy" in why) == bool(damping) == (result.verdict == "asymptotically stable")
    precise = mbstab.loads(text).eig_precise(20)
    assert sorted(e.kind for e in precise.eigenvalues) == sorted(kinds)


TOP = """
mbstab: 1
parameters: {A: 1, C: 1, l: 1, omega: 1}
gravity: [0, 0, -9.81]
bodies: {top: {type: spatial, mass: 1, inertia: [A, A, C], points: {tip: [0, 0, -l]}}}
joints: {tip: {type: spherical, between: [top.tip, ground]}}
reference: {coordinates: {top: {z: l}}, rates: {top: {psi: omega}}}
"""


def random_tops(count):
    """Return tops that stand upright, a little or far above their critical speed, and this speed."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        A, length = 10.0 ** rng.uniform(-3.0, 3.0), 10.0 ** rng.uniform(-2.0, 1.0)
        C = rng.uniform(0.05, 1.95) * A
        critical = 2.0 * np.sqrt(9.81 * length * (A + length**2)) / C
        yield {"A": A, "C": C, "l": length, "omega": critical * (1.0 + 10.0 ** rng.uniform(-3.0, 2.0))}, critical


def test_every_top_that_sleeps_is_stable_by_its_energy():
    """Above the critical speed some multiple of the momentum makes the energy definite (Lagrange's top)."""
    model = mbstab.loads(TOP)
    for values, critical in random_tops(6):
        found = model.eig(**values)
        assert found.verdict == "stable up to symmetry", values
        assert "with a multiple of the angular momentum has a strict minimum" in found.reasons[0]
        assert model.eig(**values | {"omega": 0.99 * critical}).verdict == "unstable"
    scene = {name: values[name] for name in ("A", "C", "l")}
    speeds = critical * np.array([0.5, 0.999, 1.001, 1.5, 10.0, 300.0])
    assert model.sweep("omega", speeds, **scene).verdicts == ["unstable"] * 2 + ["stable up to symmetry"] * 4


# --- a zero eigenvalue is judged by the lowest power of the force, however small its coefficient ----------------------


POWERS = (2, 3, 4, 5, 7)

ONE = """
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
constraints: {{rail: {{holonomic: p.y}}}}
forces: {{f: {{type: expression, on: {{p.x: {force}}}}}}}
reference: {{coordinates: {{p: {{x: 0}}}}}}
"""

LEVER = """
mbstab: 1
bodies: {{a: {{type: planar, mass: 1, inertia: 1/12, points: {{end: [1/2, 0], start: [-1/2, 0]}}}}}}
joints: {{pin: {{type: revolute, between: [a.start, ground]}}}}
forces: {{f: {{type: expression, on: {{a.theta: {force}}}}}}}
reference: {{coordinates: {{a: {{theta: 0}}}}}}
"""


def polynomial(seed):
    """Return a force on x at random, its lowest power and the sign of the potential there, and whether it is damped."""
    rng = random.Random(seed)
    terms = {k: rng.choice((-1, 1)) * 10.0 ** rng.randint(-140, 12) for k in rng.sample(POWERS, rng.randint(1, 3))}
    return terms, rng.random() < 0.5


@pytest.mark.parametrize(("text", "seed"), sample([(x, seed) for x in (ONE, LEVER) for seed in range(60)], 16))
def test_the_lowest_power_decides_however_weak_it_is(text, seed):
    terms, damped = polynomial(seed)
    x = "p.x" if text is ONE else "a.theta"
    force = " + ".join(f"{c!r}*{x}**{k}" for k, c in terms.items()) + (f" - rate({x})" if damped else "")
    lowest = min(terms)
    minimum = lowest % 2 == 1 and terms[lowest] < 0.0
    truth = (ASYMPTOTIC if damped else STABLE) if minimum else UNSTABLE
    result = mbstab.loads(text.format(force=force)).eig()
    assert result.verdict == truth, (force, result.reasons)


@pytest.mark.few(2)
@pytest.mark.parametrize(("weak", "truth"), [("1e-17", UNSTABLE), ("-1e-17", UNSTABLE), ("0", STABLE)])
def test_a_weak_slope_of_a_spring_beside_a_wall_is_seen_by_every_command(weak, truth):
    scene = mbstab.loads("parameters: {w: " + weak + "}" + ONE.format(force="-w*p.x**2 - p.x**3"))
    assert scene.eig().verdict == truth
    assert scene.eig_precise(50).verdict == truth
    assert scene.sweep("w", [float(weak), 1.0]).verdicts[0] == truth


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("weak", "truth"),
    [
        ("", ASYMPTOTIC_UP_TO),
        (" - 1e-20*p.x**7", ASYMPTOTIC),
        (" + 1e-20*p.x**5", UNSTABLE),
        (" + 1e-20*p.x**2", UNSTABLE),
    ],
)
def test_a_valley_of_rest_positions_is_none_if_a_weak_force_acts_along_it(weak, truth):
    laws = f"{{p.x: 2*p.x*(p.y - p.x**2) - rate(p.x){weak}, p.y: -(p.y - p.x**2) - rate(p.y)}}"
    text = (
        f"mbstab: 1\nbodies: {{p: {{type: planar_point, mass: 1}}}}\nforces: {{f: {{type: expression, on: {laws}}}}}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}"
    )
    assert mbstab.loads(text).eig().verdict == truth


@pytest.mark.parametrize(
    ("weak", "truth"),
    [
        ("", ASYMPTOTIC_UP_TO),
        (" - 1e-20*p.y**3", ASYMPTOTIC),
        (" + 1e-20*p.y**3", UNSTABLE),
        (" + 1e-20*p.y", UNSTABLE),
        (" - 1e-20*p.y", ASYMPTOTIC),
    ],
)
def test_a_ring_is_none_if_a_weak_force_breaks_its_symmetry(weak, truth):
    push = "-(p.x**2 + p.y**2 - 1)"
    laws = f"{{p.x: {push}*p.x - rate(p.x), p.y: {push}*p.y - rate(p.y){weak}}}"
    text = (
        f"mbstab: 1\nbodies: {{p: {{type: planar_point, mass: 1}}}}\nforces: {{f: {{type: expression, on: {laws}}}}}\n"
        "reference: {coordinates: {p: {x: 1, y: 0}}}"
    )
    assert mbstab.loads(text).eig().verdict == truth


def test_turns_of_written_forces_are_seen_with_parameters_of_many_digits():
    """The products C·a in the torque of a tyre are rounded differently in a force and in its derivatives."""
    text = """
mbstab: 1
parameters: {C: 0.7, a: 1.3, b: 1.1, v: 20}
bodies: {car: {type: planar, mass: 1.5, inertia: 2.5, points: {front: [a, 0], rear: [-b, 0]}}}
constraints: {cruise: {nonholonomic: vx(car) - v}}
forces:
  tyres:
    type: expression
    on: {vy(car.front): -C*atan(vy(car.front)/v), vy(car.rear): -C*atan(vy(car.rear)/v)}
reference: {coordinates: {car: {x: 0, y: 0, theta: 0}}, rates: {car: {x: v, y: 0, theta: 0}}}
"""
    result = mbstab.loads(text).eig()
    assert result.neutral_directions == ("car.x", "car.y", "rotation in the plane")


# --- zeros that form a chain: motions that leave like a power of t where the equations are linear ---------------------


POINT = """
mbstab: 1
parameters: {e: 0}
bodies: {p: {type: planar_point, mass: 1}}
forces: {all: {type: expression, on: {p.x: "ALONG", p.y: "ACROSS"}}}
STATES
reference: {coordinates: {p: {x: 0, y: 0}}}
"""


def point(along, across, rates=()):
    states = ", ".join(f"{name}: {{rate: {rate}}}" for name, rate in rates)
    text = POINT.replace("ALONG", along).replace("ACROSS", across)
    return mbstab.loads(text.replace("STATES", f"states: {{{states}}}" if rates else ""))


LEAVING = [
    ("rate(p.y)", "0", []),  # the speed along x grows like t
    ("p.y", "0", []),
    ("0", "-p.y", [("z", "p.x")]),  # an integrator that is cut off: x is no symmetry, and grows like t
    ("0", "-p.y", [("z", "p.x"), ("w", "z")]),
    ("0", "-p.y - rate(p.y)", [("z", "-3*p.x + p.y - z"), ("w", "z")]),
    ("0*z - rate(p.x)", "0", [("z", "p.y")]),
    ("1e-9*rate(p.y)", "0", []),
]
STAYING = [
    ("0", "0", []),  # only what symmetries name grows
    ("rate(p.y)", "-rate(p.x)", []),  # circles
    ("0", "-p.y", [("z", "rate(p.x)")]),
    ("0", "-p.y", [("z", "p.x - z")]),  # all moves on together
]
NOT_LINEAR = [
    ("rate(p.y)", "-1e-30*rate(p.y)**3", []),
    ("-1e-30*p.x**3", "-p.y", [("z", "p.x")]),
    ("0", "-p.y", [("z", "p.x + 1e-30*p.x**2")]),
    ("p.y", "-1e-12*p.y*abs(p.y)", []),
    ("-p.x**3", "0", []),  # two zeros in a chain, and it stays
]


@pytest.mark.few(1)
@pytest.mark.parametrize(("along", "across", "rates"), sample(LEAVING, 2))
def test_a_chain_of_zeros_leaves_where_the_equations_are_linear(along, across, rates):
    model = point(along, across, rates)
    found = model.eig()
    assert found.verdict == "unstable"
    assert "grow like t" in found.reasons[0]
    assert model.eig_precise(30).verdict == "unstable"
    assert model.sweep("e", [0.0, 0.1]).verdicts == ["unstable", "unstable"]
    assert model.certify().verdict in ("unstable", "not provable")


@pytest.mark.parametrize(("along", "across", "rates"), STAYING)
def test_a_chain_that_ends_in_a_symmetry_is_drift(along, across, rates):
    assert "stable up to symmetry" in point(along, across, rates).eig().verdict


@pytest.mark.parametrize(("along", "across", "rates"), NOT_LINEAR)
def test_a_chain_proves_nothing_where_the_equations_are_not_linear(along, across, rates):
    assert point(along, across, rates).eig().verdict != "unstable"


def test_a_zero_that_is_only_nearly_one_is_not_counted():
    model = point("rate(p.y)", "-1e-60*rate(p.y)")
    assert model.eig().verdict == "undecided"
    assert model.eig_precise(80).verdict == "asymptotically stable up to symmetry"


AXIS = """
mbstab: 1
parameters: {P: 0, I: 0, D: 0}
bodies: {table: {type: planar_point, mass: 2}}
constraints: {rail: {holonomic: table.y}}
forces: {pid: {type: pid, coordinate: table.x, of: table.x, P: P, I: I, D: D}}
reference: {coordinates: {table: {x: 0}}}
"""


def test_a_controller_without_gains_on_a_free_axis():
    axis = mbstab.loads(AXIS)
    assert axis.eig().verdict == "unstable"  # x grows like t, and its integral like t**2
    assert axis.eig(I=3).verdict == "unstable"
    assert axis.eig(P=3, D=1).verdict == "asymptotically stable up to symmetry"
    assert axis.eig(P=3, I=1, D=2).verdict == "asymptotically stable"
    assert axis.sweep("D", np.linspace(0.0, 1.0, 3)).verdicts == [
        "unstable", "asymptotically stable up to symmetry", "asymptotically stable up to symmetry",
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_springs_with_unlike_sides(seed):
    """x'' = −x' − a x^p + b |x|^p, p = 3: restoring on both sides if and only if a > |b|."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.2, 3.0), rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 3.0)
    spring = mbstab.loads(
        "mbstab: 1\nbodies: {a: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: a.y}}\n"
        f'forces: {{f: {{type: expression, on: {{a.x: "-rate(a.x) - {a}*a.x**3 + {b}*abs(a.x)**3"}}}}}}\n'
        "reference: {coordinates: {a: {x: 0, y: 0}}}\n"
    )
    assert spring.eig().verdict == (ASYMPTOTIC if a > abs(b) else UNSTABLE)


def test_zeros_that_a_disc_holds_are_critical_as_many_as_a_count_proves():
    """Beside a chain of zeros there are ± 1.0000000005i and ± 1.0000005i in the same disc."""
    answer = mbstab.loads("""
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}, c: {type: planar_point, mass: 1}}
constraints: {k: {holonomic: c.y}}
forces: {f: {type: expression, on: {
  a.x: "-0.00261*rate(c.x)",
  a.y: "-1.000000001*a.y - 2e-9*b.y + 4.3e-7*rate(b.x) - 1e-5*rate(b.y) + 5.9e-5*rate(c.x)",
  b.x: "-0.156*a.x - 1.4235e-8*b.y + 431517000*c.x",
  b.y: "-45124224.3137*rate(c.x)",
  c.x: "-1.000001*c.x"}}}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}, c: {x: 0, y: 0}}}
""").eig()
    assert answer.verdict == UNSTABLE
    assert answer.counts.neutral + answer.counts.critical == 6


CENTRE = {
    "states": """
bodies: {{p: {{type: planar_point, mass: 2}}}}
forces: {{f: {{type: expression, on: {{p.x: -rate(p.x) - p.x, p.y: -rate(p.y) - p.y}}}}}}
states:
  s: {{rate: "{a}*s*w + {b}*s**3 + {d}*s**5"}}
  w: {{rate: "-{k}*w + {c}*s**2"}}
""",
    "damped": """
bodies: {{p: {{type: planar_point, mass: 2}}}}
forces:
  f: {{type: expression, on: {{p.x: "-rate(p.x) + {a}*p.x*p.y + {b}*p.x**3 + {d}*p.x**5",
    p.y: "-rate(p.y) - {k}*p.y + {c}*p.x**2"}}}}
""",
    "row": """
bodies: {{p: {{type: planar_point, mass: 2}}}}
constraints: {{r: {{nonholonomic: "rate(p.x) - {a}*p.x*p.y - {b}*p.x**3 - {d}*p.x**5"}}}}
forces: {{f: {{type: expression, on: {{p.y: "-rate(p.y) - {k}*p.y + {c}*p.x**2"}}}}}}
""",
}
"""x' = a x y + b x³ + d x⁵ with y = c x²/k + … on the centre manifold (Carr 1981): x' = (a c/k + b) x³ + d x⁵ + …"""


@pytest.mark.parametrize("form", CENTRE)
@pytest.mark.parametrize("seed", sample(range(30), 4))
def test_the_drift_on_the_centre_manifold_decides(form, seed):
    rng = random.Random(seed)
    k, a, c = (rng.choice((1, 2, 4)) * rng.choice((1, sign)) for sign in (1, -1, -1))
    d = rng.choice((-3, 2))
    cube = rng.choice((-1, 0, 1))
    b = cube * rng.choice((1, 1e-12)) - a * c / k
    text = f"mbstab: 1\n{CENTRE[form].format(a=f'({a})', b=f'({b!r})', c=f'({c})', d=f'({d})', k=k)}"
    result = mbstab.loads(text).eig()
    # What is left of b + a c/k in the decimals of the file decides before the fifth power.
    left = Fraction(repr(b)) + Fraction(a * c, k)
    assert result.verdict == (UNSTABLE if (left or d) > 0 else ASYMPTOTIC), result.reasons


@pytest.mark.parametrize(
    "law",
    [
        'constraints: {r: {nonholonomic: "rate(p.y) - p.y**2*exp(-1e4*p.y**2)"}}',
        'states: {s: {rate: "s**3*exp(-1e4*s**2)"}}\nconstraints: {r: {holonomic: p.y}}',
    ],
)
def test_a_drift_that_is_flat_but_near_the_reference_is_seen(law):
    text = (
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\n"
        "forces: {f: {type: expression, on: {p.x: -p.x - rate(p.x)}}}\n"
        f"reference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}\n{law}"
    )
    assert mbstab.loads(text).eig().verdict == UNSTABLE
