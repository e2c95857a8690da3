"""The sections ``reference`` and ``initial``: the motion that is asked about, and where a simulation starts."""

from __future__ import annotations

from mbstab.model.names import Names
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import (
    FINDS,
    INITIAL_FIELDS,
    REFERENCE_FIELDS,
    STEADY_FIELDS,
    Components,
    Initial,
    Quantity,
    Reference,
    Steady,
    body_coordinates,
    constant,
    unit_of,
)
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode


def read_state(quantities: QuantityReader, node: YamlNode | None, path: str, per: str = "") -> dict[str, Quantity]:
    """Return values of coordinates by name such as ``rod.theta``; `per` is "/s" for rates."""
    nodes, names = quantities.nodes, quantities.names
    mapping = nodes.optional(node, path)
    state = {}
    for key, item in mapping.pairs() if mapping else ():
        body, here = key.text, f"{path}.{key.text}"
        if body in names.coordinates:  # a first-order state
            unit = names.state_units.get(body, "")
            state[body] = quantities.expression(item, here, unit + per if unit else "")
            continue
        inner = nodes.mapping(item, here)
        if not names.has_body(key, path, body):
            continue
        known = body_coordinates(names.bodies[body])
        if inner is not None:
            nodes.known_keys(inner, here, known)
        for coordinate, value in inner.entries.items() if inner else ():
            if coordinate in known:
                name = f"{body}.{coordinate}"
                state[name] = quantities.expression(value, f"{here}.{coordinate}", unit_of(name) + per)
    return state


class ReferenceReader:
    """Reads the reference motion and the start of a simulation."""

    def __init__(self, quantities: QuantityReader) -> None:
        self.quantities = quantities
        self.nodes = quantities.nodes
        self.names: Names = quantities.names

    def reference(self, root: Mapping) -> Reference:
        """Return the reference motion."""
        mapping = self._section(root, "reference", REFERENCE_FIELDS)
        entries = mapping.entries if mapping else {}
        time = self._optional(entries, "time", "reference", "s")
        guess, guess_rates = self._guess(entries.get("guess"))
        return Reference(
            root.keys["reference"].location if mapping else root.location,
            time if time is not None else constant("0", root.location, "reference.time"),
            read_state(self.quantities, entries.get("coordinates"), "reference.coordinates"),
            read_state(self.quantities, entries.get("rates"), "reference.rates", "/s"),
            read_state(self.quantities, guess, "reference.guess"),
            *self._search(entries),
            self._optional(entries, "period", "reference", "s"),
            self._guessed_rates(entries, guess_rates),
            self._optional(entries, "closure_tolerance", "reference", "m"),
        )

    def _guess(self, node: YamlNode | None) -> tuple[YamlNode | None, YamlNode | None]:
        """Return starting values of coordinates, and those of rates; a body may be called rates, too."""
        if not isinstance(node, Mapping) or "rates" not in node.entries or "rates" in self.names.bodies:
            return node, None
        rest = {key: item for key, item in node.entries.items() if key != "rates"}
        return Mapping(rest, {key: node.keys[key] for key in rest}, node.location), node.entries["rates"]

    def _guessed_rates(self, entries: dict[str, YamlNode], node: YamlNode | None) -> dict[str, Quantity]:
        """Return starting values of the rates of a steady motion; only one that is looked for has such."""
        path = "reference.guess.rates"
        find = entries.get("find")
        if node is not None and not (isinstance(find, Scalar) and find.text == "steady"):
            hint = "write find: steady, or what is known of the motion under reference.rates"
            self.nodes.complain(node, path, "rates are guessed only of a steady motion that is looked for", hint)
            return {}
        return read_state(self.quantities, node, path, "/s")

    def initial(self, root: Mapping) -> Initial:
        """Return where a simulation starts."""
        mapping = self._section(root, "initial", INITIAL_FIELDS)
        entries = mapping.entries if mapping else {}
        return Initial(
            root.keys["initial"].location if mapping else root.location,
            self._optional(entries, "time", "initial", "s"),
            read_state(self.quantities, entries.get("coordinates"), "initial.coordinates"),
            read_state(self.quantities, entries.get("rates"), "initial.rates", "/s"),
        )

    def _section(self, root: Mapping, name: str, known: dict[str, str]) -> Mapping | None:
        mapping = self.nodes.optional(root.entries.get(name), name)
        if mapping is not None:
            self.nodes.known_keys(mapping, name, known)
        return mapping

    def _optional(self, entries: dict[str, YamlNode], key: str, path: str, unit: str) -> Quantity | None:
        return self.quantities.expression(entries[key], f"{path}.{key}", unit) if key in entries else None

    def _search(self, entries: dict[str, YamlNode]) -> tuple[str | None, Steady | None]:
        """Read what kind of motion is looked for, and along which symmetry."""
        complain = self.nodes.complain
        find = self.nodes.choice(entries["find"], "reference.find", FINDS) if "find" in entries else None
        steady = self._steady(entries["steady"]) if "steady" in entries else None
        if find == "steady" and "steady" not in entries:
            hint = "add steady: {axis: z, rate: …} or steady: {direction: x, speed: …}"
            complain(entries["find"], "reference.find", "a steady motion needs its symmetry", hint)
        if find == "equilibrium" and "steady" in entries:
            message = "an equilibrium is at rest, but reference.steady asks for a motion"
            complain(entries["find"], "reference.find", message, "write find: steady")
        if find == "equilibrium" and "rates" in entries:
            message = "an equilibrium is at rest: rates have no effect"
            complain(
                entries["rates"],
                "reference.rates",
                message,
                "leave them out, or write find: steady; for a rotor with steady: {axis: z, rate: 0}",
            )
        if "period" in entries and ("find" in entries or "steady" in entries):
            message = "the period belongs to a motion that is neither at rest nor steady"
            complain(entries["period"], "reference.period", message, "leave out find and steady, or the period")
        return find, steady

    def _steady(self, node: YamlNode) -> Steady | None:
        path = "reference.steady"
        mapping = self.nodes.mapping(node, path, "{axis: z, rate: …} or {direction: x, speed: …}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, STEADY_FIELDS)
        entries = mapping.entries
        self._check_steady_keys(mapping, path)
        point = self.quantities.vector(entries["point"], f"{path}.point", "m") if "point" in entries else None
        direction = None
        if "direction" in entries:
            direction = self.quantities.direction(entries["direction"], f"{path}.direction", None)
        return Steady(
            mapping.location,
            self._axis(entries["axis"], f"{path}.axis") if "axis" in entries else None,
            self._optional(entries, "rate", path, "rad/s"),
            point,
            direction,
            self._optional(entries, "speed", path, "m/s"),
        )

    def _check_steady_keys(self, mapping: Mapping, path: str) -> None:
        """Refuse keys that mean nothing without another."""
        entries = mapping.entries
        lonely = [
            (key, needed)
            for key, needed in (("rate", "axis"), ("point", "axis"), ("speed", "direction"))
            if key in entries and needed not in entries
        ]
        for key, needed in lonely:
            if needed == "axis":
                example = "z" if self.names.dimension == 2 else "z, or -z or a vector such as [0, 0.6, 0.8]"
                hint = f"add axis: {example}; a turn has an axis, in the plane always z"
            else:
                hint = "add direction: x, or -x or a vector; a translation has a direction"
            self.nodes.complain(entries[key], f"{path}.{key}", f"{key} needs {needed}", hint)
        if not lonely and "axis" not in entries and "direction" not in entries:
            self.nodes.complain(mapping, path, "give an axis of the turn, a direction of the translation, or both")

    def _axis(self, node: YamlNode, path: str) -> Components | None:
        """Return the axis of a turn, with three components also in the plane."""
        if self.names.dimension == 3:
            return self.quantities.direction(node, path, None)
        if self.nodes.choice(node, path, ("z",)) is None:
            return None
        return Components(tuple(constant(x, node.location, path) for x in "001"), node.location, path)
