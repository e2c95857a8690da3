"""Frequencies count turns, angular velocities radians: Hz and 1/min where an angle is meant lack a factor 2*pi.

Both are 1/s as dimensions (`mbstab.model.units`), so what an expression counts is followed beside its dimension.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mbstab.model.expressions import Binary, Call, Expression, ExpressionError, Name, Negative, Node, Number, Rate
from mbstab.model.functions import CALLED
from mbstab.model.units import factors


class Counted(NamedTuple):
    """What a quantity counts: powers of radians and of turns, and the first name that counts turns."""

    radians: float = 0
    turns: float = 0
    name: str = ""
    position: int = 0

    @property
    def lacks(self) -> bool:
        """Whether turns stand where only an angle can be meant."""
        return self.turns != 0 and self.radians == 0


NOTHING = Counted()

_RADIANS = ("rad", "mrad", "deg", "rpm")
_PLAIN_TIMES = ("min", "h")
_DECIMALS_OF_PI = ("3.14", "6.28")


def counted_by(unit: str) -> Counted:
    """Return what a declared unit counts: Hz, 1/min and 1/h turns; rad, deg and rpm radians; 1/s neither."""
    found = list(factors(unit)) if unit else []
    radians = sum(power for name, power, _ in found if name in _RADIANS)
    turns = sum(power for name, power, _ in found if name == "Hz")
    plain = [(name, power) for name, power, _ in found if name != "1"]
    if len(plain) == 1 and plain[0][0] in _PLAIN_TIMES and plain[0][1] == -1:
        turns = 1
    return Counted(radians, turns)


def one_counts_turns(unit: str, other: str) -> bool:
    """Whether of two units one counts turns and the other measures an angle."""
    found = {(x.turns != 0, x.radians != 0) for x in map(counted_by, (unit, other))}
    return found == {(True, False), (False, True)}


def require_angle(expression: Expression, names: Mapping[str, Counted], expected: str) -> None:
    """Refuse turns where the unit `expected` is an angle or an angular velocity, and in sines and the like.

    Raises
    ------
    ExpressionError
        With the factor that is missing.
    """
    found = count(expression, names)
    if found.lacks and counted_by(expected).radians:
        raise _missing(found, f"an angle in {expected} is expected")


def count(expression: Expression, names: Mapping[str, Counted]) -> Counted:
    """Return what an expression counts.

    Raises
    ------
    ExpressionError
        If a sine, a cosine or a tangent gets turns.
    """
    return _count(expression.root, names)


def _missing(found: Counted, why: str) -> ExpressionError:
    message = f"{found.name} counts turns (Hz or 1/min), but {why}"
    return ExpressionError(message, found.position, f"write 2*pi*{found.name}, or declare it in rpm or rad/s")


def _count(node: Node, names: Mapping[str, Counted]) -> Counted:
    match node:
        case Number() if node.text.startswith(_DECIMALS_OF_PI):
            return Counted(radians=1)
        case Name(name="pi" | "deg"):
            return Counted(radians=1)
        case Name():
            known = names.get(node.name, NOTHING)
            return Counted(known.radians, known.turns, node.name, node.position) if known.turns else known
        case Rate():
            return names.get(node.name, NOTHING)
        case Negative():
            return _count(node.operand, names)
        case Call():
            arguments = [_count(argument, names) for argument in node.arguments]
            if node.function in ("sin", "cos", "tan") and arguments[0].lacks:
                raise _missing(arguments[0], f"{node.function}() takes an angle in rad")
            return _returned(node, arguments)
        case Binary():
            return _combined(node, _count(node.left, names), _count(node.right, names))
        case _:
            return NOTHING


def _returned(node: Call, arguments: list[Counted]) -> Counted:
    """Return what the value of a function counts."""
    if node.function in ("asin", "acos", "atan", "atan2"):
        return Counted(radians=1)
    match CALLED[node.function].unit:
        case "same":
            return next((x for x in arguments if x.lacks), arguments[0])
        case "root":
            return _power(arguments[0], 0.5)
        case _:
            return NOTHING


def _power(base: Counted, power: float) -> Counted:
    return base._replace(radians=power * base.radians, turns=power * base.turns)


def _combined(node: Binary, left: Counted, right: Counted) -> Counted:
    if node.operator in "+-":
        for one, other in ((left, right), (right, left)):
            if one.lacks and other.radians == 1 and not other.turns:
                raise _missing(one, "it is added to an angle or to a turn rate")
        return left if left.lacks or not right.lacks else right
    if node.operator == "**":
        sign, power = (-1, node.right.operand) if isinstance(node.right, Negative) else (1, node.right)
        return _power(left, sign * float(power.text)) if isinstance(power, Number) else NOTHING
    sign = -1 if node.operator == "/" else 1
    named = left if left.turns else right
    return named._replace(radians=left.radians + sign * right.radians, turns=left.turns + sign * right.turns)
