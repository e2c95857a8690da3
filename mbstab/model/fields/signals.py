"""Fields that hold expressions of the motion: constraints, rates of states, signals, gains; and lists of numbers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from mbstab.mechanics.catalogue import Field, Moved, Number
from mbstab.mechanics.measures import is_measure, is_speed
from mbstab.model.expressions import Binary, Rate, moves
from mbstab.model.fields.base import BY_NAME, NUMBER, NUMBERS, TEXT, FieldKind, FormError, Owner, Reading, text_of
from mbstab.model.nodes import COMMA
from mbstab.model.schema import Quantity, is_state
from mbstab.model.units import per_second
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode


class SignalField(FieldKind):
    """An expression of coordinates, rates, states and time."""

    name = "signal"
    form = NUMBER
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression."""
        return reading.quantities.quantity(node, path, field.unit, time=True, state=True)

    def check(self, owner: Owner, field: Field, numbers: Quantity, time: Number) -> None:
        """Require positive widths of smoothing."""
        owner.evaluator.check_widths(numbers)

    def coordinates(self, value: Quantity) -> Iterable[str]:
        """Return the names in the expression, and those of its rates."""
        return {*value.names(), *value.rates()}


def _check_moves(reading: Reading, node: YamlNode, expression: Quantity | None, hint: str = "") -> None:
    """Refuse a signal to which a controller reacts and in which nothing moves."""
    if expression is None or expression.rates():
        return
    if not any(name == "t" or moves(name, reading.names.coordinates) for name in expression.names()):
        message = f"nothing in {expression.text!r} moves"
        hint = f"write a coordinate or a measure, such as body.x or angle(joint){hint}"
        reading.nodes.complain(node, expression.path, message, hint)


class MovingSignalField(SignalField):
    """An expression to whose motion a controller reacts."""

    name = "moving signal"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression."""
        expression = super().read(reading, field, node, path)
        _check_moves(reading, node, expression, "; what it should be stands under target")
        return expression


class ConstraintField(SignalField):
    """An expression of coordinates, rates and time that must be zero."""

    form = TEXT

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression."""
        expression = reading.quantities.quantity(node, path, time=True, state=True)
        if expression is not None:
            self.check_contents(reading, node, expression)
        return expression

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Check that the expression depends on what it must depend on."""
        raise NotImplementedError


class HolonomicField(ConstraintField):
    """A constraint on coordinates."""

    name = "holonomic"

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Refuse rates, and an expression without coordinates."""
        if expression.rates():
            message = "a holonomic constraint contains no rates"
            reading.nodes.complain(node, expression.path, message, "make it nonholonomic")
        elif not any(moves(name, reading.names.coordinates) for name in expression.names()):
            reading.nodes.complain(node, expression.path, "the constraint contains no coordinate")


class NonholonomicField(ConstraintField):
    """A constraint on rates."""

    name = "nonholonomic"

    def check_contents(self, reading: Reading, node: YamlNode, expression: Quantity) -> None:
        """Refuse an expression without rates."""
        if not expression.rates():
            reading.nodes.complain(node, expression.path, "the constraint contains no rate of a coordinate")


class EnergyField(SignalField):
    """A potential energy: an expression of coordinates and places, smooth and the same at all times."""

    name = "energy"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression."""
        expression = super().read(reading, field, node, path)
        if expression is None:
            return None
        names, coordinates = expression.names(), reading.names.coordinates
        moving = [name for name in names if moves(name, coordinates)]
        if "t" in names:
            problem = "depends on the time, and its force would feed in energy", "write the force: type: expression"
        elif state := next((x for x in (*moving, *expression.rates()) if is_state(x) and not is_measure(x)), None):
            problem = f"contains the state {state}, on which it would act", "write the force: type: expression"
        elif other := self.unsuited(expression, moving):
            problem = other
        elif expression.pieced(coordinates):
            hint = "write the force itself: type: expression"
            problem = "has pieces, and its force may jump where they meet", hint
        else:
            return expression
        reading.nodes.complain(node, path, f"{self.doc} {problem[0]}", problem[1])
        return None

    doc = "a potential energy"

    def unsuited(self, expression: Quantity, moving: list[str]) -> tuple[str, str] | None:
        """Return what is wrong with the names in it, and a hint."""
        speed = next((x for x in (*expression.rates(), *filter(is_speed, moving))), None)
        if speed is not None:
            return f"depends on a speed ({speed})", "forces of speeds: type: dissipation, or type: expression"
        return None if moving else ("contains no coordinate", "for example k*(a.x - b.x)**2/2")


class DissipationField(EnergyField):
    """A dissipation function: an expression of rates, coordinates and places, smooth and the same at all times."""

    name = "dissipation"
    doc = "a dissipation function"

    def unsuited(self, expression: Quantity, moving: list[str]) -> tuple[str, str] | None:
        """Return what is wrong with the names in it, and a hint."""
        if expression.rates() or any(map(is_speed, moving)):
            return None
        return "contains no rate", "for example c*(rate(a.x) - rate(b.x))**2/2"


class RateField(SignalField):
    """The rate of a first-order state: an expression of coordinates, rates, states and time."""

    name = "rate"
    made: ClassVar[bool] = False

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return the expression that must be zero: rate(state) minus the given one."""
        state = reading.path.partition(".")[2]
        unit = reading.names.state_units.get(state)
        given = reading.quantities.quantity(node, path, per_second(unit) if unit else "", True, True, made=self.made)
        if given is None:
            return None
        if state in given.rates():
            message = f"the rate of {state!r} depends on itself"
            reading.nodes.complain(node, path, message, "solve the equation for the rate")
            return None
        root = Binary("-", Rate(state, 0), given.root, 0)
        return Quantity(given.text, root, given.location, path)


class MadeRateField(RateField):
    """The rate of a state of a controller or a motor, as the program wrote it."""

    name = "made rate"
    made = True


class MovingNumberField(SignalField):
    """A number that may change with the motion."""

    name = "moving number"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Quantity | None:
        """Return its expression."""
        return reading.quantities.quantity(node, path, field.unit, time=True, state=True)

    def numbers(self, owner: Owner, field: Field, value: Quantity) -> Number | Moved:
        """Return the number, or how it changes."""
        if value.rates() or not set(value.names()) <= set(owner.evaluator.parameters):
            return Moved(value, field.sign == "positive")
        return owner.evaluator.number(value, field)

    def check(self, owner: Owner, field: Field, numbers: Number | Moved, time: Number) -> None:
        """Require positive widths of smoothing."""
        if isinstance(numbers, Moved):
            owner.evaluator.check_widths(numbers.expression)


def _items(node: YamlNode) -> list[YamlNode]:
    """Return the items of a list.

    Raises
    ------
    FormError
    """
    if not isinstance(node, Sequence):
        raise FormError
    return node.items


def _flat(node: Sequence) -> list[str] | None:
    """Return the numbers of a matrix of one row or one column; None for anything else."""
    rows = [x.items for x in node.items if isinstance(x, Sequence)]
    if len(rows) < len(node.items) or not (len(rows) == 1 or all(len(row) == 1 for row in rows)):
        return None
    numbers = [x for row in rows for x in row]
    return [x.text for x in numbers if isinstance(x, Scalar)] if numbers else None


class NumbersField(FieldKind):
    """A list of numbers, at least one."""

    name = "numbers"
    form = NUMBERS

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[Quantity, ...] | None:
        """Return their expressions."""
        if not isinstance(node, Sequence) or not node.items:
            reading.nodes.complain(node, path, "expected a list of numbers", "for example [1, 0.5]")
            return None
        if (flat := _flat(node)) is not None:
            reading.nodes.complain(node, path, "expected a list of numbers, got a matrix", f"write [{', '.join(flat)}]")
            return None
        return reading.quantities.components(node.items, node, path).values

    def texts(self, node: YamlNode) -> list[str]:
        """Return their texts."""
        return [text_of(x) for x in _items(node)]

    def numbers(self, owner: Owner, field: Field, value: tuple[Quantity, ...]) -> tuple[Number, ...]:
        """Return the numbers."""
        return tuple(owner.evaluator.number(x) for x in value)

    def check(self, owner: Owner, field: Field, numbers: tuple[Number, ...], time: Number) -> None:
        """Refuse a leading coefficient of a denominator that is zero."""
        first = owner.entry.values[field.name][0]
        if field.name == "denominator" and not owner.evaluator.symbolic:
            owner.evaluator.number(first, Field("its first coefficient", "number", "", sign="nonzero"))


class MatrixField(FieldKind):
    """Rows of numbers."""

    name = "matrix"
    form: ClassVar[dict[str, Any]] = {"type": "array", "items": NUMBERS}

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> list[tuple[Quantity, ...]] | None:
        """Return their expressions row by row."""
        if not isinstance(node, Sequence) or not node.items or not all(isinstance(x, Sequence) for x in node.items):
            reading.nodes.complain(node, path, "expected rows of numbers", "for example [[0, 1], [-2, -3]]")
            return None
        rows = (x for x in node.items if isinstance(x, Sequence))
        return [reading.quantities.components(x.items, x, f"{path}[{i}]").values for i, x in enumerate(rows)]

    def texts(self, node: YamlNode) -> list[list[str]]:
        """Return their texts row by row."""
        return [[text_of(x) for x in _items(row)] for row in _items(node)]

    def numbers(self, owner: Owner, field: Field, value: list[tuple[Quantity, ...]]) -> tuple[Number, ...]:
        """Return the numbers, row by row."""
        return tuple(owner.evaluator.number(x) for row in value for x in row)


class GainsField(FieldKind):
    """Numbers by expression of the motion."""

    name = "gains"
    form = BY_NAME
    names = "keys"
    moving = True

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> list[Quantity] | None:
        """Return the expressions, those of the motion first."""
        hint = "for example {angle(knee): 40, rate(angle(knee)): 3}"
        mapping = reading.nodes.mapping(node, path, "gains by expression", hint)
        if mapping is None:
            return None
        if not mapping.entries:
            reading.nodes.complain(node, path, "there are no gains", hint)
        if cut := [key for key, x in mapping.pairs() if isinstance(x, Scalar) and x.empty]:
            reading.nodes.complain(cut[0], f"{path}.{cut[0].text}", "there is no gain", COMMA)
            return None
        signals = [self._signal(reading, key, path) for key in mapping.keys.values()]
        gains = [reading.quantities.quantity(x, f"{path}.{key.text}") for key, x in mapping.pairs()]
        return [x for x in (*signals, *gains) if x is not None]

    def texts(self, node: YamlNode) -> dict[str, str]:
        """Return the gains by expression."""
        if not isinstance(node, Mapping):
            raise FormError
        return {key: text_of(x) for key, x in node.entries.items()}

    @staticmethod
    def _signal(reading: Reading, key: Scalar, path: str) -> Quantity | None:
        signal = reading.quantities.quantity(key, f"{path}.{key.text}", time=True, state=True)
        _check_moves(reading, key, signal)
        return signal

    def check(self, owner: Owner, field: Field, numbers: list[Quantity], time: Number) -> None:
        """Require positive widths of smoothing."""
        for expression in numbers:
            owner.evaluator.check_widths(expression)

    def coordinates(self, value: list[Quantity]) -> Iterable[str]:
        """Return the names in the expressions, and those of their rates."""
        return {name for x in value for name in (*x.names(), *x.rates())}
