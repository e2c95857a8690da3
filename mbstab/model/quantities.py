"""Expressions of a model file: numbers, vectors and directions, with their names and units checked."""

from __future__ import annotations

import re
from collections.abc import Iterable

from mbstab.errors import suggestion
from mbstab.mechanics.measures import MEASURES, is_measure, is_speed, parts
from mbstab.model import units
from mbstab.model.arithmetic import CONSTANTS
from mbstab.model.expressions import Expression, ExpressionError, Node, filled_in
from mbstab.model.functions import CALLED
from mbstab.model.names import Names
from mbstab.model.nodes import decimal_commas, single
from mbstab.model.schema import (
    Components,
    Quantity,
    constant,
    is_state,
    owner_of_point,
    parse_finite,
    unit_of,
)
from mbstab.model.turns import counted_by, require_angle
from mbstab.model.yamlfile import Scalar, Sequence, YamlNode

AXES = {"x": 0, "y": 1, "z": 2}

_DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")


class QuantityReader:
    """Reads single expressions and lists of them."""

    def __init__(self, names: Names) -> None:
        self.names = names
        self.nodes = names.nodes
        self._literals: dict[tuple[str, str], Node] = {}

    # --- one expression ---------------------------------------------------------------------------------------------

    def quantity(
        self,
        node: YamlNode,
        path: str,
        unit: str = "",
        time: bool = False,
        state: bool = False,
        shared: bool = True,
        made: bool = False,
    ) -> Quantity | None:
        """Return an expression, None if there is a problem.

        Parameters
        ----------
        unit : str
            What it must be in, "1" for a plain number; "" stands for anything.
        time : bool
            Whether it may contain the time t.
        state : bool
            Whether it may contain coordinates and rates.
        shared : bool
            Whether it may contain definitions; those of parameters may not.
        made : bool
            Whether the program wrote it from keys whose units are checked.
        """
        if not isinstance(node, Scalar) or node.empty:
            self.nodes.complain(node, path, "expected a number or an expression" + _in_brackets(unit), single(node))
            return None
        known = self._literals.get((node.text, unit))
        if known is not None:
            return Quantity(node.text, known, node.location, path)
        try:
            if not node.quoted and _DATE.fullmatch(node.text):
                raise ExpressionError(f"{node.text} looks like a date", 0, "a difference has blanks: 2020 - 1 - 1")
            expression = parse_finite(node.text, self.names.parameters)
            expression = filled_in(expression, self.names.definitions if shared else {}, self.names.tables)
            self._check_names(expression, time, state)
            self._check_widths(expression)
            if not made:
                self.check_unit(expression, unit)
                self.doubt_sums(expression, node, path)
        except ExpressionError as error:
            self.complain(node, path, error)
            return None
        if expression.literal:
            self._literals[node.text, unit] = expression.root
        return Quantity(expression.text, expression.root, node.location, path)

    def expression(
        self, node: YamlNode, path: str, unit: str = "", time: bool = False, state: bool = False, made: bool = False
    ) -> Quantity:
        """Return an expression as `quantity` does, but 1 if there is a problem."""
        return self.quantity(node, path, unit, time, state, made=made) or constant("1", node.location, path)

    def complain(self, node: Scalar, path: str, error: ExpressionError) -> None:
        """Record what is wrong with an expression, at the character where it is."""
        self.nodes.complain(self.nodes.document.locate(node, error.position), path, error.message, error.hint)

    def _check_names(self, expression: Expression, time: bool, state: bool) -> None:
        parameters = self.names.parameters
        for name, at in sorted(expression.names().items(), key=lambda item: item[1]):
            if name in parameters or (name == "t" and time):
                continue
            if name in self.names.definitions:
                raise ExpressionError(f"definitions such as {name!r} cannot be used here", at, "write out what it is")
            if name == "t":
                raise ExpressionError("the time t cannot be used here", at)
            if is_measure(name) or "." in name or name in self.names.coordinates:
                self._check_coordinate(name, at, state)
                continue
            raise ExpressionError(f"unknown parameter {name!r}", at, self._meant(name, time, expression.text[at:]))
        for name, at in expression.rates().items():
            if not state:
                what = f"speeds such as {name!r}" if is_speed(name) else "rate(...)"
                raise ExpressionError(f"{what} cannot be used here", at, self._moving_elsewhere(name))
            self._check_coordinate(name, at, state)

    def _meant(self, name: str, time: bool, text: str) -> str:
        """Return what an unknown name may stand for, as a hint; `text` begins with it."""
        document = self.nodes.document
        if name in document.counts or name in document.indices:
            return f"counts and indices are written in angle brackets: <{name}>"
        known = [*self.names.parameters, *self.names.definitions, *CONSTANTS, *(("t",) if time else ())]
        known += [x for x in self.names.coordinates if is_state(x)]
        return (
            self._measured(name)
            or (f"{name} is a function: {name}(…)" if name in CALLED or name in MEASURES else "")
            or units.as_name(text)
            or suggestion(name, known)
            or f"declare it: parameters: {{{name}: {{value: …, unit: …}}}}"
        )

    def _measured(self, name: str) -> str:
        """Return what expressions take of a joint or a body, as a hint."""
        if name in self.names.joints:
            motions = self.names.joints[name].motions
            return f"{name!r} is a joint: " + " or ".join(f"{x}({name})" for x in motions) if motions else ""
        own = [x for x in self.names.coordinates if x.startswith(f"{name}.")]
        if not own and (some := next((x for x in self.names.coordinates if x.endswith(f".{name}")), "")):
            return f"coordinates are written with their body, such as {some}"
        return f"{name!r} is a body: it has the coordinates {', '.join(own)}" if own else ""

    def _check_widths(self, expression: Expression) -> None:
        """Refuse a width of smoothing that is not a constant."""
        for function, width in expression.widths:
            inside = Expression("", width)
            if inside.rates() or not set(inside.names()) <= set(self.names.parameters):
                hint = "make it of numbers and parameters"
                raise ExpressionError(f"the width of {function}() must be constant", width.position, hint)

    def _moving_elsewhere(self, name: str) -> str:
        """Return where expressions may contain what moves, as a hint; `name` is that of a coordinate or measure."""
        mistaken = ""
        if is_measure(name) and "joints" in self.names.written:  # all that it may name has been found
            try:
                self.names.places.measure(*parts(name))
            except ExpressionError as error:
                mistaken = "; ".join(x for x in (error.message, error.hint) if x) + "; "
                name = f"{parts(name)[0]}(…)"
        own = is_state(name) and not is_measure(name)
        along = f"angle(joint): …}} or {{vz(body.point): {name}" if own else f"{name}: …"
        return (
            f"{mistaken}a force written type: expression, on: {{{along}}} takes them; what moves with them is a "
            "constraint, {holonomic: angle(joint) - …}"
        )

    def _check_coordinate(self, name: str, at: int, allowed: bool) -> None:
        if not allowed:
            what = "measures" if is_measure(name) else "states" if is_state(name) else "coordinates"
            raise ExpressionError(f"{what} such as {name!r} cannot be used here", at, self._moving_elsewhere(name))
        if is_measure(name):
            self.measure(name, at)
            return
        coordinates = self.names.coordinates
        if name not in coordinates and not self.names.unread(name):
            raise ExpressionError(f"unknown coordinate {name!r}", at, self.names.places.meant(name, coordinates))

    def measure(self, name: str, at: int = 0) -> None:
        """Note what a measure names.

        Raises
        ------
        ExpressionError
            If there is no such joint, point or body.
        """
        names = self.names
        if name not in names.measures:
            names.measures[name] = names.places.measure(*parts(name), at)

    def check_unit(self, expression: Expression, unit: str) -> None:
        """Refuse an expression that is known to have another unit.

        Raises
        ------
        ExpressionError
        """
        moving = {name: x for name in {*expression.names(), *expression.rates()} if (x := self.unit_of(name))}
        counted = {name: counted_by(x) for name, x in moving.items()}
        require_angle(expression, {**self.names.counted, **counted}, unit)
        found = self.dimension_of(expression)
        # What only moves, as in -rate(a.x), may have the coefficient 1 in any unit.
        if not unit or isinstance(found, (str, units.Moving)):
            return
        expected = units.parse_unit(unit)[1]
        if found != expected:
            raise ExpressionError(self.misfit(expression, found, unit), 0, hint_of_factor(expression, found, expected))

    def misfit(self, expression: Expression, found: units.Dimension, expected: str) -> str:
        """Return that an expression has another unit than expected."""
        alone = self.names.parameters.get(expression.text.strip())
        shown = alone.unit if alone is not None and alone.unit else units.show(found)
        wanted = "a plain number" if expected == "1" else expected
        return f"{expression.text!r} has the unit {shown}, expected {wanted}"

    def dimension_of(self, expression: Expression) -> units.Known:
        """Return what is known of the dimension of an expression of the motion.

        Raises
        ------
        ExpressionError
            If quantities of different dimensions are added, or a function gets one.
        """
        return units.dimension_of(expression, {**self._moving_in(expression), **self.names.units})

    def _moving_in(self, expression: Expression) -> dict[str, units.Known]:
        """Return what is known of the dimensions of coordinates, measures and states."""
        names = {*expression.names(), *expression.rates()}
        # A speed such as vx(point) counts as the rate of itself.
        return {name: units.moving(x.removesuffix("/s")) for name in names if (x := self.unit_of(name))}

    def doubt_sums(self, expression: Expression, node: Scalar, path: str) -> None:
        """Note a warning about terms of unlike units, such as a length to which an angle is added without a factor."""
        moving = self._moving_in(expression)
        found = units.unlike_terms(expression, {**moving, **self.names.units}) if moving else None
        if found is not None:
            document = self.nodes.document
            place = document.locate(node, found[0])
            if any(told.startswith(f"{place}: ") for told in document.doubts):
                return  # in another repetition of the same text
            one, other = (units.show(x) if x != units.NONE else "rad or 1" for x in found[1:])
            document.doubts.append(
                f"{place}: {path}: the terms of a sum have the units {one} and {other}\n"
                "hint: write the factor between them: the radius that makes a length of an angle, as in r*body.theta, "
                "or the number that is meant, such as 1*body.theta"
            )

    def unit_of(self, name: str) -> str:
        """Return the unit of a coordinate, a state or a measure; of others an empty text."""
        if is_measure(name):
            measure = MEASURES.get(parts(name)[0])
            return measure.unit if measure is not None and measure.formula is not None else ""
        if "." in name and name in self.names.coordinates:
            return unit_of(name)
        return self.names.state_units.get(name, "")

    # --- vectors ----------------------------------------------------------------------------------------------------

    def components(
        self, items: Iterable[YamlNode], node: YamlNode, path: str, unit: str = "", time: bool = False
    ) -> Components:
        """Return the expressions of a list; `node` is the whole."""
        values = (self.expression(item, f"{path}[{i}]", unit, time) for i, item in enumerate(items))
        return Components(tuple(values), node.location, path)

    def vector(self, node: YamlNode, path: str, unit: str = "", time: bool = False) -> Components:
        """Return a vector: a list, the name of an axis such as -z, or 0."""
        if isinstance(node, Scalar):
            named = self.axis(node, path)
            if named is not None:
                return named
            if node.text.strip() == "0":
                return self.zero(node, path)
        dimension = self.names.dimension
        if not isinstance(node, Sequence):
            hint = "for example [1, 2]" if dimension == 2 else "for example [1, 2, 3]"
            self.nodes.complain(node, path, f"expected a list of {dimension} numbers{_in_brackets(unit)}", hint)
            return self.zero(node, path)
        if len(node.items) != dimension:
            message = f"expected {dimension} numbers{_in_brackets(unit)}, got {len(node.items)}"
            scene = "planar: its vectors have x and y" if dimension == 2 else "spatial: its vectors have x, y and z"
            hint = f"the scene is {scene}" if len(node.items) == 5 - dimension else ""
            hint = decimal_commas(node, dimension) or hint
            self.nodes.complain(node, path, message, hint)
            return self.zero(node, path)
        return self.components(node.items, node, path, unit, time)

    def zero(self, node: YamlNode, path: str) -> Components:
        """Return the zero vector."""
        zero = constant("0", node.location, path)
        return Components((zero,) * self.names.dimension, node.location, path)

    def axis(self, node: Scalar, path: str) -> Components | None:
        """Return the unit vector that a word such as -z stands for, None if it is none."""
        text = node.text
        sign, letter = ("-1", text[1:]) if text.startswith("-") else ("1", text)
        if letter not in list(AXES)[: self.names.dimension]:
            return None
        numbers = (sign if i == AXES[letter] else "0" for i in range(self.names.dimension))
        return Components(tuple(constant(x, node.location, path) for x in numbers), node.location, path)

    def direction(self, node: YamlNode, path: str, body: str | None) -> Components | None:
        """Return a direction in the frame of a body (None: the ground): an axis, a named direction or a list."""
        if not isinstance(node, Scalar) or node.text.strip() == "0":
            return self.vector(node, path)
        named = self.axis(node, path)
        if named is not None:
            return named
        word = self.nodes.word(node, path, "a direction such as x or -y, or a list of numbers")
        directions = self.names.geometry[body][1]
        if word is not None and word not in directions:
            known = [*list(AXES)[: self.names.dimension], *directions]
            hint = suggestion(word, known) or "known directions: " + ", ".join(known)
            self.nodes.complain(node, path, f"{owner_of_point(body)} has no direction {word!r}", hint)
        return directions.get(word) if word is not None else None

    def named_vectors(self, node: YamlNode | None, path: str, what: str, unit: str = "") -> dict[str, Components]:
        """Return vectors by name, of a body or of the ground; `what` is what messages call one of them."""
        mapping = self.nodes.optional(node, path)
        found = {}
        for key, item in mapping.pairs() if mapping else ():
            here = f"{path}.{key.text}"
            self.nodes.check_name(key, here, what, reserved=AXES)
            found[key.text] = self.vector(item, here, unit)
        return found


def _in_brackets(unit: str) -> str:
    return f" ({unit})" if unit not in ("", "1") else ""


def hint_of_factor(expression: Expression, found: units.Dimension, expected: units.Dimension) -> str:
    """Return what to do about a unit that does not fit; a number beside it may have the unit that lacks."""
    factor = units.bare_factor(expression.root)
    if factor is None:
        return "check the units declared under parameters"
    number, power = factor
    lacking = units.show(units.times(expected, found, -1) if power > 0 else units.times(found, expected, -1))
    return f"beside a declared unit, {number} is a plain number; if it stands for {lacking}, make it a parameter"
