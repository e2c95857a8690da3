"""Units of parameters, and a check that expressions fit the unit of the place they stand in.

A dimension holds the exponents of kilogram, metre, second and ampere; radians and plain
numbers have none. Quantities without a declared unit always fit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from functools import lru_cache, partial, reduce
from operator import add, mul, sub
from typing import Any, NamedTuple

from mbstab.errors import suggestion
from mbstab.model.arithmetic import CONSTANTS, Arithmetic
from mbstab.model.expressions import Binary, Call, Expression, ExpressionError, Name, Negative, Node, Number, Rate
from mbstab.model.functions import CALLED

Dimension = tuple[Fraction, Fraction, Fraction, Fraction]


def _dimension(kilogram: int, metre: int, second: int, ampere: int = 0) -> Dimension:
    return Fraction(kilogram), Fraction(metre), Fraction(second), Fraction(ampere)


NONE = _dimension(0, 0, 0)

_BASE = ("kg", "m", "s", "A")

UNITS: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, NONE),
    "rad": (1.0, NONE),
    "deg": (CONSTANTS["deg"], NONE),
    "mrad": (1e-3, NONE),
    "kg": (1.0, _dimension(1, 0, 0)),
    "g": (1e-3, _dimension(1, 0, 0)),
    "t": (1e3, _dimension(1, 0, 0)),
    "m": (1.0, _dimension(0, 1, 0)),
    "um": (1e-6, _dimension(0, 1, 0)),
    "mm": (1e-3, _dimension(0, 1, 0)),
    "cm": (1e-2, _dimension(0, 1, 0)),
    "km": (1e3, _dimension(0, 1, 0)),
    "mph": (0.44704, _dimension(0, 1, -1)),
    "s": (1.0, _dimension(0, 0, 1)),
    "ms": (1e-3, _dimension(0, 0, 1)),
    "min": (60.0, _dimension(0, 0, 1)),
    "h": (3600.0, _dimension(0, 0, 1)),
    "Hz": (1.0, _dimension(0, 0, -1)),
    "rpm": (CONSTANTS["pi"] / 30.0, _dimension(0, 0, -1)),
    "N": (1.0, _dimension(1, 1, -2)),
    "kN": (1e3, _dimension(1, 1, -2)),
    "MN": (1e6, _dimension(1, 1, -2)),
    "J": (1.0, _dimension(1, 2, -2)),
    "W": (1.0, _dimension(1, 2, -3)),
    "kW": (1e3, _dimension(1, 2, -3)),
    "Pa": (1.0, _dimension(1, -1, -2)),
    "kPa": (1e3, _dimension(1, -1, -2)),
    "MPa": (1e6, _dimension(1, -1, -2)),
    "GPa": (1e9, _dimension(1, -1, -2)),
    "A": (1.0, _dimension(0, 0, 0, 1)),
    "mA": (1e-3, _dimension(0, 0, 0, 1)),
    "C": (1.0, _dimension(0, 0, 1, 1)),
    "V": (1.0, _dimension(1, 2, -3, -1)),
    "ohm": (1.0, _dimension(1, 2, -3, -2)),
    "H": (1.0, _dimension(1, 2, -2, -2)),
    "mH": (1e-3, _dimension(1, 2, -2, -2)),
    "F": (1.0, _dimension(-1, -2, 4, 2)),
}
"""Factor to SI and dimension of every unit a file may name."""

_MEANT = {"ton": "t", "tons": "t", "tonne": "t", "tonnes": "t", "second": "s", "seconds": "s", "minutes": "min"}
_MEANT |= {"meter": "m", "meters": "m", "metre": "m", "metres": "m", "gram": "g", "grams": "g", "newton": "N"}
_MEANT |= {"Nm": "N*m", "Nms": "N*m*s", "Ns": "N*s", "sec": "s", "degree": "deg", "degrees": "deg", "mps": "m/s"}
_MEANT |= {"kph": "km/h", "kmh": "km/h", "kmph": "km/h", "hour": "h", "hours": "h", "hr": "h", "rps": "Hz"}
_MEANT |= {"radian": "rad", "radians": "rad", "dimensionless": "1", "none": "1", "kgm": "kg*m", "newtons": "N"}
"""Words that are not units, and what those who write them mean."""
_OTHER = {"rev": "turns are counted in rpm, or in Hz", "U": "turns are counted in rpm, or in Hz"}
_OTHER |= {"in": "an inch is 25.4 mm", "inch": "an inch is 25.4 mm", "ft": "a foot is 0.3048 m"}
_OTHER |= {"lb": "a pound is 0.45359237 kg", "lbs": "a pound is 0.45359237 kg", "lbf": "a pound-force is 4.4482216 N"}
_OTHER |= {"kgf": "a kilogram-force is 9.80665 N", "bar": "a bar is 100 kPa", "l": "a litre is 0.001 m^3"}
"""Units that a file may not name, and in which others they are written."""
_SIGNS = {"°": "degrees are written deg", "²": "powers are written ^2", "³": "powers are written ^3"}
_SIGNS |= {"·": "products are written *", "×": "products are written *", "µ": "micrometres are written um"}
_SIGNS |= {
    "μ": "micrometres are written um",
    "Ω": "it is written ohm",
    "%": "write the value as a fraction, 0.05 for 5 %",
}
_SIGNS |= {"-": "a plain number has the unit 1, and products are written *"}
"""What stands for characters that units do not have."""

_POWER = r"\s*(?:(?:\^|\*\*)\s*(?P<power>-?[0-9]{1,2}))?\s*"
_FACTOR = re.compile(r"\s*(?P<name>[A-Za-z]+|1)" + _POWER)
_OPEN = re.compile(r"\s*\(")
_CLOSE = re.compile(r"\)" + _POWER)
_MOST = 99

_TURNS = re.compile(r"\s*(rad|deg)\s*/\s*(s|ms|min|h)\s*|rpm")


def is_angular_velocity(unit: str) -> bool:
    """Whether a unit is that of an angular velocity, such as rad/s, deg/s or rpm."""
    return _TURNS.fullmatch(unit) is not None


@lru_cache(maxsize=256)
def parse_unit(text: str) -> tuple[float, Dimension]:
    """Return the factor to SI and the dimension of a unit such as ``kg*m^2`` or ``N/(rad*s)``.

    Raises
    ------
    ExpressionError
        If the text is not a product of known units.
    """
    factor, dimension = 1.0, NONE
    for name, power, at in factors(text):
        if name not in UNITS:
            # Kg is kg, not g; mN is not MN.
            alike = [unit for unit in UNITS if unit.lower() == name.lower() and unit[0] != "M"]
            hint = suggestion(alike[0], alike) if alike else f"write {_MEANT[name]}" if name in _MEANT else ""
            hint = hint or _OTHER.get(name, "known units: " + ", ".join(UNITS))
            raise ExpressionError(f"unknown unit {name!r}", at, hint)
        try:
            factor *= UNITS[name][0] ** power
        except OverflowError:
            factor = 0.0
        if not 1e-300 < factor < 1e300:
            raise ExpressionError(f"{text!r} is out of the range of numbers", at)
        dimension = times(dimension, UNITS[name][1], power)
    return factor, dimension


def factors(text: str) -> Iterator[tuple[str, int, int]]:
    """Return the name, the power and the position of each factor of a unit, brackets multiplied out."""
    found: list[tuple[str, int, int]] = []
    opened: list[tuple[int, int, int]] = []  # of each open bracket: the first factor in it, its sign, its position
    at, sign = 0, 1

    def power(match: re.Match[str]) -> int:
        return sign * int(match.group("power") or 1)

    while True:
        while (bracket := _OPEN.match(text, at)) is not None:
            opened.append((len(found), sign, bracket.end() - 1))
            at, sign = bracket.end(), 1
        match = _FACTOR.match(text, at)
        if match is None:
            raise _no_unit(text, at)
        found.append((match.group("name"), power(match), match.start("name")))
        at = match.end()
        while opened and (match := _CLOSE.match(text, at)) is not None:
            first, sign, _ = opened.pop()
            found[first:] = [(name, before * power(match), place) for name, before, place in found[first:]]
            if any(abs(total) > _MOST for _, total, _ in found[first:]):
                raise ExpressionError(f"{text!r} has a power beyond {_MOST}", at)
            at = match.end()
        if at == len(text) and not opened:
            return iter(found)
        if at == len(text):
            raise ExpressionError(f"'(' is not closed in the unit {text!r}", opened[-1][2])
        if text[at] not in "*/":
            raise _no_unit(text, at)
        sign = -1 if text[at] == "/" else 1
        at += 1


def _no_unit(text: str, at: int) -> ExpressionError:
    known = _SIGNS.get(text[at], "") if at < len(text) else ""
    hint = known or "write products of units, such as kg*m^2 or N/(rad*s)"
    return ExpressionError(f"{text!r} is not a unit", at, hint)


_WORDS = re.compile(r"[A-Za-z]+")
_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_UNIT_AT = re.compile(r"(?:°|[A-Za-z]+)(?:\^-?[0-9])?(?:\s*[*/]\s*(?:°|[A-Za-z]+)(?:\^-?[0-9])?)*")


def meant(text: str) -> str:
    """Return a unit as it is written here, km/h for ``kmh``; an empty string if a text is none."""
    found = _WORDS.sub(lambda word: _MEANT.get(word.group(), word.group()), text.replace("°", "deg"))
    try:
        parse_unit(found)
    except ExpressionError:
        return ""
    return found


def _unit_at(text: str, at: int) -> tuple[str, str]:
    """Return the unit that stands at a place of a text, as it is written there and as it is written here."""
    found = _UNIT_AT.match(text, at)
    written = found.group() if found is not None else ""
    while written and not meant(written):
        written = written[: max(written.rfind("*"), written.rfind("/"), 0)].rstrip()
    return written, meant(written) if written else ""


def behind_number(text: str) -> ExpressionError | None:
    """Return what is wrong with an expression that has a unit behind a number, as in ``2 kg``; None if it has none."""
    for found in _NUMBER.finditer(text):
        at = found.end() + len(text[found.end() :]) - len(text[found.end() :].lstrip())
        written, unit = _unit_at(text, at)
        if written:
            break
    else:
        return None
    number = found.group()
    if unit == "deg":
        hint = f"write {number}*deg"
    elif parse_unit(unit)[0] == 1.0:
        hint = f"write {number}"
    else:
        hint = f"declare a parameter and write its name: parameters: {{NAME: {{value: {number}, unit: {unit}}}}}"
    shown = repr(text[found.start() : at] + written)
    return ExpressionError(f"{shown}: numbers in expressions are in SI units, without a unit", at, hint)


def as_name(text: str, at: int = 0) -> str:
    """Return what to do about a unit at a place of an expression, as a hint; empty if there is none.

    A single letter is more likely the name of a parameter that is missing.
    """
    written, unit = _unit_at(text, at)
    if len(written) < 2 or "*" in written[:2] or "/" in written[:2]:
        return ""
    return (
        f"{written} is a unit: numbers in expressions are in SI units, other units stand with a parameter, "
        f"such as {{value: 5, unit: {unit}}}"
    )


def exact_factor(text: str, arithmetic: Arithmetic) -> Any:
    """Return the factor to SI of a unit of `parse_unit`, or of none, in a number system: a millimetre is 1/1000.

    The float in `UNITS` is only the nearest double; its shortest decimals are the exact factor.
    """
    above, below = arithmetic.number("1"), arithmetic.number("1")
    for name, power, _ in factors(text) if text else ():
        if name == "deg":
            factor = arithmetic.constants["deg"]
        elif name == "rpm":
            factor = arithmetic.constants["pi"] / 30
        else:
            factor = arithmetic.number(repr(UNITS[name][0]))
        for _ in range(abs(power)):
            if power > 0:
                above = above * factor
            else:
                below = below * factor
    return above / below


_SI = {
    "deg": "rad", "mrad": "rad", "g": "kg", "t": "kg", "um": "m", "mm": "m", "cm": "m", "km": "m", "ms": "s",
    "min": "s", "h": "s", "kN": "N", "MN": "N", "kW": "W", "kPa": "Pa", "MPa": "Pa", "GPa": "Pa", "mA": "A", "mH": "H",
    "rpm": "rad/s", "mph": "m/s",
}  # fmt: skip
"""Units with a factor, and what they become without it."""


def si_unit(text: str) -> str:
    """Return the unit in which a quantity is computed whose unit in the file is this one: rad/s for deg/s or rpm."""
    return product([(text, 1)]) if text else ""


def product(given: Iterable[tuple[str, int]]) -> str:
    """Return the unit of a product of powers, in SI: rad*s for rad/s and s^2, N*m/(rad*s) for N*m/rad and 1/s."""
    powers: dict[str, int] = {}
    for unit, power in given:
        for name, own, _ in factors(unit):
            for part, inner, _ in factors(_SI.get(name, name)):
                powers[part] = powers.get(part, 0) + inner * own * power
    over = [_power(name, Fraction(n)) for name, n in powers.items() if n > 0 and name != "1"]
    under = [_power(name, Fraction(-n)) for name, n in powers.items() if n < 0 and name != "1"]
    below = f"({'*'.join(under)})" if len(under) > 1 else "".join(under)
    return ("*".join(over) or "1") + (f"/{below}" if below else "")


@lru_cache(maxsize=256)
def per_second(unit: str, order: int = 1) -> str:
    """Return the unit of a time derivative."""
    return product([(unit, 1), ("s", -order)])


def times(a: Dimension, b: Dimension, power: Fraction | int = 1) -> Dimension:
    """Return the dimension of a·b^power."""
    first, second, third, fourth = (x + y * power for x, y in zip(a, b, strict=True))
    return first, second, third, fourth


_SPOKEN = ("N", "N/m", "N*m", "N*s/m", "N*m*s", "N*m/s", "N/m^2", "V", "ohm")
"""How dimensions of forces, of torques, of what they are multiplied by, and of circuits are written."""


def show(dimension: Dimension) -> str:
    """Return a dimension in SI units, such as ``N/m`` or ``kg*m^2``."""
    for unit in _SPOKEN:
        if parse_unit(unit)[1] == dimension:
            return unit
    over = [_power(n, e) for n, e in zip(_BASE, dimension, strict=True) if e > 0]
    under = [_power(n, -e) for n, e in zip(_BASE, dimension, strict=True) if e < 0]
    return "/".join(["*".join(over) or "1", *under])


def _power(name: str, exponent: Fraction) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


LITERAL = "literal"
UNKNOWN = "unknown"


class Moving(NamedTuple):
    """The dimension of coordinates, measures, their rates and states: a number beside one may be a coefficient."""

    dimension: Dimension


Known = Dimension | Moving | str


def moving(unit: str) -> Moving:
    """Return what is known of something that moves, in a unit."""
    return Moving(parse_unit(unit)[1])


def dimension_of(expression: Expression, names: Mapping[str, Known]) -> Known:
    """Return the dimension of an expression.

    Parameters
    ----------
    expression : Expression
    names : mapping
        Dimension of the names; a missing one is unknown.

    Returns
    -------
    dimension : Dimension or str
        ``LITERAL`` if only literals occur (they fit any unit), ``UNKNOWN`` if a name
        without a unit decides.

    Raises
    ------
    ExpressionError
        If quantities of different dimension are added, or a function gets one.
    """
    return _infer(expression.root, names)


def _infer(node: Node, names: Mapping[str, Known]) -> Known:
    match node:
        case Number():
            return LITERAL
        case Name():
            return LITERAL if node.name in CONSTANTS else names.get(node.name, UNKNOWN)
        case Rate():
            found = names.get(node.name, UNKNOWN)
            if isinstance(found, str):
                return UNKNOWN
            rate = times(_plain(found), UNITS["s"][1], -1)
            return Moving(rate) if isinstance(found, Moving) else rate
        case Negative():
            return _infer(node.operand, names)
        case Call():
            return _infer_call(node, names)
        case Binary():
            left, right = _infer(node.left, names), _infer(node.right, names)
            if node.operator in "+-":
                return _same(left, right, node.position)
            if node.operator == "**":
                return _raise(left, right, node)
            if left == UNKNOWN or right == UNKNOWN:
                return UNKNOWN
            if isinstance(left, Moving) or isinstance(right, Moving):
                return _of_moving(left, right, 1 if node.operator == "*" else -1)
            if {left, right} <= {LITERAL, NONE} and LITERAL in (left, right):
                return LITERAL  # 10*ratio may be a length: a bare number stands for any unit
            return times(_plain(left), _plain(right), 1 if node.operator == "*" else -1)


def unlike_terms(expression: Expression, names: Mapping[str, Known]) -> tuple[int, Dimension, Dimension] | None:
    """Return the position of a sum whose terms hardly fit, and their dimensions; None if there is none.

    A length and an angle that move, or their rates; or one term that moves and one whose units are declared. With a
    factor, if only a bare number, either may be meant in the unit of the other.
    """
    for node in expression.walk():
        if isinstance(node, Binary) and node.operator in "+-":
            pair = _infer(node.left, names), _infer(node.right, names)
            one, other = map(_plain, pair)
            if any(isinstance(x, str) for x in pair) or one == other:
                continue
            ratio = times(one, other, -1)
            both = all(isinstance(x, Moving) for x in pair)
            if not both or UNITS["m"][1] in (ratio, times(NONE, ratio, -1)):
                return node.position, one, other
    return None


def bare_factor(node: Node, power: int = 1) -> tuple[str, int] | None:
    """Return a number that multiplies (1) or divides (-1) an expression and may be meant with a unit; None if none."""
    match node:
        case Number():
            return (node.text, power) if Fraction(node.text) not in (0, 1, 2, Fraction(1, 2)) else None
        case Negative():
            return bare_factor(node.operand, power)
        case Binary(operator="*" | "/"):
            right = -power if node.operator == "/" else power
            return bare_factor(node.left, power) or bare_factor(node.right, right)
        case _:
            return None


def _plain(known: Known) -> Dimension:
    return NONE if isinstance(known, str) else known.dimension if isinstance(known, Moving) else known


def _of_moving(left: Known, right: Known, power: int) -> Known:
    """Return what is known of a product with something that moves: all, if the other one has a declared unit."""
    if LITERAL in (left, right):
        return UNKNOWN
    found = times(_plain(left), _plain(right), power)
    return Moving(found) if isinstance(left, Moving) and isinstance(right, Moving) else found


def _same(left: Known, right: Known, position: int) -> Known:
    if left in (LITERAL, UNKNOWN):
        return right if left == LITERAL else UNKNOWN
    if right in (LITERAL, UNKNOWN):
        return left if right == LITERAL else UNKNOWN
    if isinstance(left, Moving) or isinstance(right, Moving):
        return Moving(_plain(left)) if _plain(left) == _plain(right) else UNKNOWN
    if left != right:
        raise ExpressionError(f"{_name(left)} and {_name(right)} cannot be added or compared", position)
    return left


def _raise(base: Known, exponent: Known, node: Binary) -> Known:
    if isinstance(exponent, Moving):
        return UNKNOWN
    if exponent not in (LITERAL, UNKNOWN, NONE):
        raise ExpressionError(f"an exponent is a plain number, this one has the unit {_name(exponent)}", node.position)
    if isinstance(base, str) or base == NONE:
        return base
    value = _fraction(node.right)
    if value is None:
        return UNKNOWN
    found = times(NONE, _plain(base), value)
    return Moving(found) if isinstance(base, Moving) else found


_EXACT: dict[str, Callable[[Fraction, Fraction], Fraction]] = {"+": add, "-": sub, "*": mul}


def _fraction(node: Node) -> Fraction | None:
    """Return the value of an exponent that is made of numbers, such as -(1/2); None of others."""
    match node:
        case Number():
            return Fraction(node.text)
        case Negative():
            value = _fraction(node.operand)
            return None if value is None else -value
        case Binary(operator="+" | "-" | "*" | "/"):
            left, right = _fraction(node.left), _fraction(node.right)
            if left is None or right is None or (node.operator == "/" and not right):
                return None
            return left / right if node.operator == "/" else _EXACT[node.operator](left, right)
        case _:
            return None


def _infer_call(node: Call, names: Mapping[str, Known]) -> Known:
    arguments = [_infer(argument, names) for argument in node.arguments]
    rule = CALLED[node.function].unit
    if rule == "free":
        return UNKNOWN
    if rule == "root":
        if isinstance(arguments[0], str):
            return arguments[0]
        found = times(NONE, _plain(arguments[0]), Fraction(1, 2))
        return Moving(found) if isinstance(arguments[0], Moving) else found
    if rule != "plain":
        common = reduce(partial(_same, position=node.position), arguments)
        return common if rule == "same" else LITERAL
    if isinstance(arguments[0], Moving):
        return LITERAL
    if arguments[0] not in (LITERAL, UNKNOWN, NONE):
        raise ExpressionError(
            f"{node.function}() takes a plain number or an angle, its argument has the unit {_name(arguments[0])}",
            node.position,
        )
    return LITERAL  # cos(a) alone may be meant as a length, like the number it is


def _name(dimension: Known) -> str:
    return dimension if isinstance(dimension, str) else show(_plain(dimension))
