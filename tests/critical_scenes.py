"""Scenes with a zero eigenvalue that pieces, flat places or extreme ratios decide, with their truth.

Each generator returns a text and the verdicts that are true of it, beside `undecided`; all numbers are fractions, and
the truth follows from exact series.
"""

import random
from fractions import Fraction
from itertools import pairwise

from mbstab.analysis.verdict.rule import (
    ASYMPTOTIC,
    ASYMPTOTIC_UP_TO,
    MARGINAL,
    STABLE,
    STABLE_UP_TO,
    UNSTABLE,
)

Truth = frozenset[str]
Series = dict[int, Fraction]
"""Coefficients by powers of the distance to one side."""


def decimal(x: Fraction) -> str:
    return f"({x.numerator}/{x.denominator})" if x.denominator > 1 else f"({x.numerator})"


def number(r: random.Random, spread: int = 3) -> Fraction:
    return Fraction(r.randint(1, 40), r.choice([1, 4, 5, 8])) * Fraction(10) ** r.randint(-spread, spread)


def times(a: Series, b: Series, most: int = 9) -> Series:
    found: Series = {}
    for i, x in a.items():
        for j, y in b.items():
            if i + j <= most:
                found[i + j] = found.get(i + j, Fraction(0)) + x * y
    return found


def plus(a: Series, b: Series) -> Series:
    return {k: a.get(k, Fraction(0)) + b.get(k, Fraction(0)) for k in a.keys() | b.keys()}


def lowest(a: Series) -> int:
    """Return the sign with which a series begins, 0 if it vanishes."""
    k = min((k for k, x in a.items() if x), default=0)
    return 0 if not k else 1 if a[k] > 0 else -1


def judged(outward: list[Series], damped: bool) -> Truth:
    """Return the truth about a point that a force drives outward, as series on each side."""
    signs = [lowest(x) for x in outward]
    if max(signs) > 0:
        return frozenset({UNSTABLE})
    if max(signs) < 0:
        return frozenset({ASYMPTOTIC if damped else STABLE})
    return frozenset({ASYMPTOTIC_UP_TO, STABLE_UP_TO, STABLE} if damped else {STABLE_UP_TO})


def springs(seed: int) -> tuple[str, Truth]:
    """Return a point on a rail with a force that is C² and has pieces that meet at the reference.

    It may pull another coordinate y along, which pulls back: y = e/k s^2 in balance.
    """
    r = random.Random(seed)
    damped, x = r.random() < 0.6, "p.x"
    sides: list[Series] = [{}, {}]  # the force along x, by powers of |x|, ahead and behind
    terms = []

    def term(text: str, c: Fraction, k: int, ahead: int, behind: int) -> None:
        terms.append(f"{decimal(c)}*{text}")
        for side, sign in zip(sides, (ahead, behind), strict=True):
            side[k] = side.get(k, Fraction(0)) + c * sign

    for _ in range(r.randint(1, 3)):
        k, c = r.choice([3, 3, 4, 5, 6, 7]), number(r) * r.choice([-1, 1])
        own = (-1) ** k
        match r.randrange(4):
            case 0:
                term(f"{x}**{k}", c, k, 1, own)
            case 1:
                term(f"abs({x})**{k}", c, k, 1, 1)
            case 2:
                term(f"{x}*abs({x})**{k - 1}", c, k, 1, -1)
            case 3:
                # One side alone.
                term(f"{x}**{k}", c / 2, k, 1, own)
                term(f"abs({x})**{k}" if own == -1 else f"{x}*abs({x})**{k - 1}", c / 2, k, 1, 1 if own == -1 else -1)
    pulled = r.random() < 0.5
    e, stiffness = number(r, 1) * r.choice([-1, 1]), number(r, 1)
    loads = {"p.x": " + ".join(terms)}
    if pulled:
        loads["p.x"] += f" + {decimal(2 * e)}*{x}*p.y"
        loads["p.y"] = f"-{decimal(stiffness)}*p.y + {decimal(e)}*{x}**2"
        if r.random() < 0.4:
            # What the other coordinate gives back is just balanced at the third power.
            c = -2 * e * e / stiffness
            loads["p.x"] += f" + {decimal(c)}*{x}**3"
            sides = [plus(side, {3: sign * c}) for side, sign in zip(sides, (1, -1), strict=True)]
        sides = [plus(side, {3: sign * 2 * e * e / stiffness}) for side, sign in zip(sides, (1, -1), strict=True)]
    else:
        loads["p.y"] = f"-{decimal(stiffness)}*p.y"
    if damped:
        loads = {name: f"{load} - {decimal(number(r, 1))}*rate({name})" for name, load in loads.items()}
    text = f"""
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{{", ".join(f'{name}: "{load}"' for name, load in loads.items())}}}}}}}
reference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}
"""
    outward = [sides[0], {k: -c for k, c in sides[1].items()}]
    return text, judged(outward, damped)


def flats(seed: int) -> tuple[str, Truth]:
    """Return a point or a state at a place x₀ where a hump, a dip or a rate is flat far away, and begins with s^p."""
    r = random.Random(seed)
    p, place, width = r.choice([2, 3, 4, 5, 6]), Fraction(r.randint(-20, 20), 4), Fraction(10) ** r.randint(-2, 0)
    one_sided, c, sign = p > 2 and r.random() < 0.4, number(r, 2), r.choice([-1, 1])
    kind = r.choice(["row", "force", "state", "speed"])
    at = {"row": "a.x", "force": "a.x", "state": "s", "speed": "a.y"}[kind]
    s = f"({at} - {decimal(place)})"
    size = f"abs{s}**{p}" if one_sided else f"{s}**{p}"
    flat = f"{decimal(sign * c)}*{size}*exp(-({s}/{decimal(width)})**{r.choice([2, 4])})"
    # The function, ahead and behind, begins with these signs.
    begins = [sign, sign if one_sided else sign * (-1) ** p]
    coordinates, more = {"x": decimal(place) if at == "a.x" else "0", "y": decimal(place) if at == "a.y" else "0"}, ""
    match kind:
        case "row":
            gravity, body = "gravity: [0, -9.81]\n", f"constraints: {{c: {{holonomic: a.y - {flat}}}}}\n"
            forces = 'forces: {f: {type: expression, on: {a.x: "-rate(a.x)"}}}\n'
            # Down a hump, up from a dip: outward where the height falls.
            outward = [-x for x in begins]
        case "force":
            gravity, body = "", ""
            forces = (
                f'forces: {{f: {{type: expression, on: {{a.x: "{flat} - rate(a.x)", a.y: "-a.y - rate(a.y)"}}}}}}\n'
            )
            outward = [begins[0], -begins[1]]
        case "speed":
            gravity, body = "", f'constraints: {{c: {{nonholonomic: "rate(a.y) - {flat}"}}}}\n'
            forces = 'forces: {f: {type: expression, on: {a.x: "-a.x - rate(a.x)"}}}\n'
            outward = [begins[0], -begins[1]]
        case _:
            gravity, body = "", f'states: {{s: {{rate: "{flat}"}}}}\n'
            forces = 'forces: {f: {type: expression, on: {a.x: "-a.x - rate(a.x)", a.y: "-a.y - rate(a.y)"}}}\n'
            more, outward = f", s: {decimal(place)}", [begins[0], -begins[1]]
    given = ", ".join(f"{key}: {value}" for key, value in coordinates.items())
    text = f"""
mbstab: 1
{gravity}bodies: {{a: {{type: planar_point, mass: 1}}}}
{body}{forces}reference: {{coordinates: {{a: {{{given}}}{more}}}}}
"""
    return text, judged([{1: Fraction(x)} for x in outward], True)


def shifts(seed: int) -> tuple[str, Truth]:
    """Return points on springs x_i − r_i x_{i+1} with ratios from 1e-10 to 1e10, and perhaps a weak spring besides."""
    r = random.Random(seed)
    n, damped = r.randint(2, 3), r.random() < 0.7
    names = [f"{'abc'[i]}.x" for i in range(n)]
    loads = {name: [] for name in names}
    for first, second in pairwise(names):
        ratio = r.choice([-1, 1]) * Fraction(r.randint(1, 40), r.choice([1, 4, 3])) * Fraction(10) ** r.randint(-10, 10)
        k = number(r, 1)
        gap = f"({first} - {decimal(ratio)}*{second})"
        loads[first].append(f"-{decimal(k)}*{gap}")
        loads[second].append(f"{decimal(k * ratio)}*{gap}")
    weak = r.choice([0, -1, 1]) * Fraction(10) ** -r.randint(3, 25)
    if weak:
        loads[r.choice(names)].append(f"{decimal(weak)}*{{0}}")
    if damped:
        for name in names:
            loads[name].append(f"-{decimal(number(r, 1))}*rate({name})")
    on = ", ".join(f'{name}: "{" + ".join(parts).format(name)}"' for name, parts in loads.items())
    bodies = ", ".join(f"{name[0]}: {{type: planar_point, mass: {decimal(number(r, 1))}}}" for name in names)
    rails = ", ".join(f"r{name[0]}: {{holonomic: {name[0]}.y}}" for name in names)
    places = ", ".join(f"{name[0]}: {{x: 0, y: 0}}" for name in names)
    text = f"""
mbstab: 1
bodies: {{{bodies}}}
constraints: {{{rails}}}
forces: {{f: {{type: expression, on: {{{on}}}}}}}
reference: {{coordinates: {{{places}}}}}
"""
    if weak:
        return text, frozenset({UNSTABLE} if weak > 0 else {ASYMPTOTIC} if damped else {STABLE, MARGINAL})
    return text, frozenset({ASYMPTOTIC_UP_TO} if damped else {STABLE_UP_TO, MARGINAL})
