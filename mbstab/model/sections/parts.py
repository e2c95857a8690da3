"""Entries with states of their own: what they stand for, from the texts of their keys."""

from __future__ import annotations

from collections.abc import Mapping as MappingType
from collections.abc import Sequence as SequenceType
from typing import Any, NamedTuple

from mbstab.mechanics.catalogue import EFFORT, Kind, Part, Product
from mbstab.model import units
from mbstab.model.expressions import Binary, ExpressionError, Name, Negative, Node, Rate, filled_in, parse
from mbstab.model.fields.base import Reading
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.measures import effort_unit
from mbstab.model.quantities import QuantityReader, hint_of_factor
from mbstab.model.yamlfile import Mapping, Scalar


def _along(node: Mapping, motions: tuple[str, ...]) -> str:
    given = {key: item.text for key, item in node.entries.items() if isinstance(item, Scalar)}
    if "coordinate" in given:
        return given["coordinate"]
    return f"{given.get('motion', (*motions, '')[0])}({given.get('joint', '')})"


def part_of(kind: Kind, name: str, node: Mapping, motions: tuple[str, ...] = ()) -> Part:
    """Return what an entry stands for.

    Parameters
    ----------
    motions : tuple of str
        Motions of the joint that it names.

    Raises
    ------
    PartError, KeyError, FormError
        If its keys do not fit each other, are missing or of another form.
    """
    assert kind.part is not None
    written = ((field, node.entries.get(field.name)) for field in kind.fields if not field.made)
    given = {field.name: kind_of(field).texts(item) for field, item in written if item is not None}
    return kind.part(_along(node, motions), name, given)


class Size(NamedTuple):
    """The unit of something: what is known of its dimension, and its text, if it has one of its own."""

    dimension: units.Dimension
    moves: bool = False
    text: str = ""

    @property
    def known(self) -> units.Known:
        """Return what is known of the dimension."""
        return units.Moving(self.dimension) if self.moves else self.dimension

    @property
    def shown(self) -> str:
        """Return the unit as text."""
        return self.text or units.show(self.dimension)


ONE = Size(units.NONE, text="1")


class _PartUnits:
    """The units of what stands in the products of one part.

    Parameters
    ----------
    along : str
        The coordinate or measure along which its effort acts.
    """

    def __init__(self, quantities: QuantityReader, part: Part, along: str) -> None:
        self.quantities, self.part = quantities, part
        effort = effort_unit(quantities.unit_of(along))
        fixed = {EFFORT: effort, **part.units}
        self.found: dict[str, Size | None] = {
            name: Size(units.parse_unit(unit)[1], text=unit) if unit else None for name, unit in fixed.items()
        }
        self._solve()

    def size_of(self, text: str) -> Size | None:
        """Return the unit of an effort, a state or an expression; None if it is not known."""
        if text not in self.found:
            self.found[text] = self._of_expression(text)
        return self.found[text]

    def _of_expression(self, text: str) -> Size | None:
        names = self.quantities.names
        try:
            expression = filled_in(parse(text), names.definitions, names.tables)
            known = self.quantities.dimension_of(expression)
        except ExpressionError:
            return None  # told where it is read
        if isinstance(known, str):
            return None
        unit = self._own_text(expression.root)
        return Size(known.dimension, True, unit) if isinstance(known, units.Moving) else Size(known, False, unit)

    def _own_text(self, node: Node) -> str:
        """Return the unit of an expression as it is declared; empty for products and functions."""
        match node:
            case Name():
                given = self.quantities.names.parameters.get(node.name)
                return units.si_unit(given.unit) if given is not None else self.quantities.unit_of(node.name)
            case Rate():
                unit = self.quantities.unit_of(node.name)
                # A speed such as vx(point) counts as the rate of itself.
                return unit if unit.endswith("/s") or not unit else units.per_second(unit)
            case Negative():
                return self._own_text(node.operand)
            case Binary(operator="+" | "-"):
                return self._own_text(node.left) or self._own_text(node.right)
            case _:
                return ""

    def _solve(self) -> None:
        """Find what is decided by the products: of each that has one unknown, this one."""
        known = ((x, self.size_of(x.coefficient) if x.coefficient else ONE) for x in self.part.products)
        products = [(x, coefficient) for x, coefficient in known if coefficient is not None]
        solved = True
        while solved:
            solved = False
            for product, coefficient in products:
                missing = [x for x in (product.gives, *product.factors) if self.size_of(x) is None]
                if len(missing) != 1:
                    continue
                (name,), solved = missing, True
                factors = [coefficient, *(size for x in product.factors if (size := self.size_of(x)) is not None)]
                if (whole := self.size_of(product.gives)) is None:
                    self.found[name] = _multiplied([(x, 1) for x in factors], product.seconds)
                else:
                    self.found[name] = _multiplied([(whole, 1), *((x, -1) for x in factors)], -product.seconds)

    def states(self) -> dict[str, Size]:
        """Return the units of the states that are known."""
        return {name: size for name in self.part.states if (size := self.size_of(name)) is not None}


def _multiplied(factors: SequenceType[tuple[Size, int]], seconds: int) -> Size:
    """Return the unit of a product of powers, times a power of seconds; a coefficient with a unit fixes it."""
    dimension, texts = units.NONE, [x.text for x, _ in factors]
    for size, power in factors:
        dimension = units.times(dimension, size.dimension, power)
    dimension = units.times(dimension, units.UNITS["s"][1], seconds)
    moves = all(x.moves or x.text == "1" for x, _ in factors)
    pairs = [(x.text, power) for x, power in factors]
    return Size(dimension, moves, units.product([*pairs, ("s", seconds)]) if all(texts) else "")


def note_units(quantities: QuantityReader, parts: MappingType[str, tuple[Part, str]]) -> None:
    """Note the units of all states of parts that what is declared decides; one may take in states of another.

    Parameters
    ----------
    parts : mapping
        By name, each with the coordinate or measure along which its effort acts.
    """
    names, left, noted = quantities.names, dict(parts), True
    while noted:
        noted = False
        for name, (part, along) in list(left.items()):
            sizes = _PartUnits(quantities, part, along).states()
            for state, size in sizes.items():
                noted |= state not in names.units
                names.units[state], names.state_units[state] = size.known, size.shown
            if len(sizes) == len(part.states):
                del left[name]


def _check_products(reading: Reading, part: Part, along: str) -> None:
    """Refuse coefficients that do not fit what they multiply, as far as units are declared."""
    sizes = _PartUnits(reading.quantities, part, along)
    for product in part.products:
        value: Any = reading.values.get(product.key)
        whole, gives = sizes.size_of(product.coefficient) if product.key else None, sizes.size_of(product.gives)
        factors = [x for x in map(sizes.size_of, product.factors) if x is not None]
        if whole is None or whole.moves or gives is None or len(factors) < len(product.factors):
            continue
        for i in product.index:
            value = value[i]
        found = sizes.size_of(value.text)
        expected = _multiplied([(gives, 1), *((x, -1) for x in factors)], -product.seconds)
        if found is None or whole.dimension == expected.dimension:
            continue
        beside = parse(product.coefficient)
        hint = (
            _place_of(product)
            if units.bare_factor(beside.root) is None
            else hint_of_factor(beside, whole.dimension, expected.dimension)
        )
        if whole.dimension != found.dimension:  # what multiplies it in the entry has a unit, too
            expected = _multiplied([(expected._replace(text=""), 1), (found, 1), (whole, -1)], 0)
        message = reading.quantities.misfit(value, found.dimension, expected.shown)
        reading.nodes.complain(value.location, value.path, message, hint)


def _place_of(product: Product) -> str:
    """Return what a coefficient multiplies, or is compared with, as a hint."""
    if product.factors:
        where = f" in the rate of {product.gives}" if product.seconds == 1 and product.gives != EFFORT else ""
        return f"it multiplies {' and '.join(product.factors)}{where}"
    if product.key == "target":
        return f"it is compared with {product.gives}"
    return f"with its power of s, it is one of {product.gives}"


def motion_of(node: Mapping, joints: MappingType[str, Kind]) -> str:
    """Return the coordinate or the measure along which an entry acts."""
    joint = node.entries.get("joint")
    kind = joints.get(joint.text) if isinstance(joint, Scalar) else None
    return _along(node, kind.motions if kind is not None else ())


def write_effort(reading: Reading, kind: Kind, name: str, node: Mapping) -> Part | None:
    """Give an entry its effort along the motion it acts on; return what it stands for, None after a problem."""
    asked = {field.name for field in kind.fields if field.required}
    if not asked <= set(reading.values) or len({"joint", "coordinate"} & set(reading.values)) != 1:
        return None
    motions = reading.joint.motions if reading.joint is not None else ()
    along, part = _along(node, motions), part_of(kind, name, node, motions)
    at = node.location
    loads = Mapping({along: Scalar(part.effort, at)}, {along: Scalar(along, at)}, at)
    told = len(reading.nodes.document.problems)
    _check_products(reading, part, along)
    if len(reading.nodes.document.problems) > told:
        return None
    field = kind.field("on")
    reading.read(kind_of(field), field, loads)
    return part
