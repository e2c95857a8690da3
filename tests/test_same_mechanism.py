"""One mechanism, written in several ways, has one verdict.

The law of a joint stands in five forms; scenes are shifted, turned by quarter turns and in ratios 3:4:5, which decimals
hold exactly.
"""

import random
from fractions import Fraction

import pytest

import mbstab

# --- one law of a joint ---------------------------------------------------------------------------------------------

ANGLE, TRAVEL = "angle(j)", "displacement(j)"


def forms(measure: str, k: str, c: str) -> dict[str, str]:
    """Return the law −k x − c ẋ of a joint, written in five ways; x is 0 at the reference."""
    law = f"-{k}*{measure} - {c}*rate({measure})"
    return {
        "joint_spring": f"{{type: joint_spring, joint: j, stiffness: {k}, damping: {c}}}",
        "expression": f"{{type: expression, on: {{{measure}: {law}}}}}",
        "actuator": f"{{type: actuator, joint: j, effort: {law}}}",
        "pid": f"{{type: pid, joint: j, of: {measure}, P: {k}, D: {c}}}",
        "state_feedback": f"{{type: state_feedback, joint: j, gains: {{{measure}: {k}, rate({measure}): {c}}}}}",
    }


def jointed(seed: int) -> tuple[str, dict[str, str]]:
    """Return two bodies with a joint between them, the first free, sliding, hinged or fixed, and its laws."""
    r = random.Random(seed)
    planar, slides = seed % 2 == 0, seed % 4 >= 2
    first = ["free", "rail", "hinge", "post"][seed // 4 % 4]
    k, c = r.choice(["1", "2.5", "40"]), r.choice(["0.1", "0", "3"])
    masses = [r.choice([1, 2, 0.5]) for _ in range(2)]
    axis = r.choice(["x", "y", "z"])
    along = f", axis: {'x' if planar else axis}" if slides else ("" if planar else f", axis: {axis}")
    ends = "between: [b, a]" if r.random() < 0.5 or slides else "between: [b.q, a.p]"
    if planar:
        moments, angles = [str(r.choice([0.2, 1, 1.5])) for _ in range(2)], "x: 0, y: 0, theta: 0"
    else:
        moments = [str(r.choice([[1, 1, 1], [1, 1, 2], [1, 1.5, 1.2]])) for _ in range(2)]
        angles = "x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0"
    place = "-0.5, 0" if planar else "-0.5, 0, 0"
    second = angles if "b.q" not in ends else angles.replace("x: 0", "x: 1", 1)
    kind = "planar" if planar else "spatial"
    ground = {
        "free": "",
        "rail": "  rail: {type: prismatic, between: [a, ground], axis: x}\n",
        "hinge": "  rail: {type: revolute, between: [a, ground]%s}\n" % ("" if planar else ", axis: z"),
        "post": "  rail: {type: fixed, between: [a, ground]}\n",
    }[first]
    text = f"""
mbstab: 1
bodies:
  a: {{type: {kind}, mass: {masses[0]}, inertia: {moments[0]}, points: {{p: [{place.replace("-", "")}]}}}}
  b: {{type: {kind}, mass: {masses[1]}, inertia: {moments[1]}, points: {{q: [{place}]}}}}
joints:
{ground}  j: {{type: {"prismatic" if slides else "revolute"}, {ends}{along}}}
reference: {{coordinates: {{a: {{{angles}}}, b: {{{second}}}}}}}
"""
    return text, forms(TRAVEL if slides else ANGLE, k, c)


def told(text: str) -> tuple[str, int, tuple[int, ...]]:
    """Return the verdict, the number of neutral eigenvalues, and how many lie right, left and on the axis."""
    found = mbstab.loads(text).eig()
    return found.verdict, found.counts.neutral, (found.spectrum.right, found.spectrum.left, found.spectrum.open)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(40))
def test_a_law_has_one_verdict_in_all_forms(seed):
    text, laws = jointed(seed)
    found = {name: told(f"{text}forces: {{s: {law}}}\n") for name, law in laws.items()}
    assert len(set(found.values())) == 1, found


# --- turned and shifted exactly -------------------------------------------------------------------------------------

HALF_TURN, QUARTER = ((-1, 0), (0, -1)), ((0, -1), (1, 0))
RATIOS = ((Fraction(3, 5), Fraction(-4, 5)), (Fraction(4, 5), Fraction(3, 5)))
TURNS = [((1, 0), (0, 1)), QUARTER, HALF_TURN, RATIOS]


def decimal(x: Fraction) -> str:
    """Return a decimal that is exactly a fraction."""
    whole = x * 10**12
    assert whole.denominator == 1
    sign, digits = "-" if whole < 0 else "", f"{abs(int(whole)):013d}"
    return f"{sign}{digits[:-12]}.{digits[-12:]}".rstrip("0").rstrip(".") or "0"


def points(seed: int, turn, shift) -> str:
    """Return points between springs that are relaxed at the reference, turned about the third axis and shifted."""
    r = random.Random(seed)
    spatial, n = seed % 2 == 1, r.choice([2, 3])
    part = [Fraction(r.randint(-20, 20), 10) for _ in range(3 * n)]
    at = [part[3 * i : 3 * i + (3 if spatial else 2)] for i in range(n)]
    names = "xyz"[: len(at[0])]

    def moved(p, shifts=True):
        x, y = (row[0] * p[0] + row[1] * p[1] for row in turn)
        return [v + (shift if shifts else 0) for v in (x, y)] + list(p[2:])

    lines, places = ["mbstab: 1", "bodies:"], []
    lines += [
        f"  p{i}: {{type: {'point' if spatial else 'planar_point'}, mass: {r.choice([1, 2, 3])}}}" for i in range(n)
    ]
    lines.append("forces:")
    law = r.choice(["spring", "expression", "ground"])
    for i in range(n - 1):
        c = r.choice(["0", "0.5"])
        squares = (f"({decimal(u - v)})**2" for u, v in zip(moved(at[i]), moved(at[i + 1]), strict=True))
        length = f"sqrt({' + '.join(squares)})"
        ends = f"p{i}, p{i + 1}"
        if law == "expression":
            d = f"distance({ends})"
            lines.append(f'  s{i}: {{type: expression, on: {{"{d}": "-3*({d} - {length}) - {c}*rate({d})"}}}}')
        else:
            lines.append(f"  s{i}: {{type: spring, between: [{ends}], stiffness: 3, length: {length}, damping: {c}}}")
    if law == "ground":
        place = ", ".join(decimal(v) for v in moved(at[0]))
        lines.append(f"  g: {{type: bearing, between: [p0, {{body: ground, point: [{place}]}}], stiffness: 2}}")
    for i in range(n):
        places.append(
            f"p{i}: {{" + ", ".join(f"{k}: {decimal(v)}" for k, v in zip(names, moved(at[i]), strict=True)) + "}"
        )
    lines.append("reference: {coordinates: {" + ", ".join(places) + "}}")
    return "\n".join(lines)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(40))
def test_a_scene_that_is_turned_and_shifted_exactly_keeps_its_verdict(seed):
    found = [told(points(seed, turn, shift)) for turn in TURNS for shift in (Fraction(0), Fraction(7, 4))]
    assert len(set(found)) == 1, found
