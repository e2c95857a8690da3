"""The section ``modes``: names of modes."""

from __future__ import annotations

import cmath
import math
import re

from mbstab.errors import suggestion
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import MODE_FIELDS, ModeName
from mbstab.model.sections.expectations import ExpectationReader
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode

JOINT_MOTION = re.compile(r"(\w+)\((\w+)\)")


def complex_number(text: str) -> complex | None:
    """Return a number such as ``-0.3+4.4i`` or ``0.5 ∠ -30`` (degrees), None if it is no finite one."""
    size, angle, degrees = text.replace(" ", "").replace("\N{MINUS SIGN}", "-").partition("∠")
    try:
        if angle:
            value = cmath.rect(float(size), math.radians(float(degrees.removesuffix("°"))))
        else:
            value = complex(size.replace("i", "j") if "n" not in size else "nan")
    except (ValueError, OverflowError):
        return None
    return value if cmath.isfinite(value) else None


class ModeReader:
    """Reads names of modes."""

    def __init__(self, quantities: QuantityReader, expectations: ExpectationReader) -> None:
        self.nodes, self.names, self.expectations = quantities.nodes, quantities.names, expectations

    def read(self, node: YamlNode | None) -> tuple[ModeName, ...]:
        """Return the names in the order of the file."""
        mapping = self.nodes.optional(node, "modes")
        found = [self._mode(key, item) for key, item in mapping.pairs()] if mapping else []
        return tuple(mode for mode in found if mode is not None)

    def _mode(self, key: Scalar, node: YamlNode) -> ModeName | None:
        path = f"modes.{key.text}"
        self.nodes.check_name(key, path, "mode")
        mapping = self.nodes.mapping(node, path, "{near: eigenvalue} or {shape: motions}")
        if mapping is None:
            return None
        self.nodes.known_keys(mapping, path, MODE_FIELDS)
        entries = mapping.entries
        if ("near" in entries) == ("shape" in entries):
            hint = "near: -0.3+4.4i, the eigenvalue; or shape: {body.phi: 1}, what moves"
            self.nodes.complain(mapping, path, "give either near or shape", hint)
            return None
        near = self._number(entries["near"], f"{path}.near", "-0.3+4.4i") if "near" in entries else None
        shape = self._shape(entries["shape"], f"{path}.shape") if "shape" in entries else {}
        return ModeName(
            key.text, key.location, self.expectations.parameter_values(entries.get("at"), f"{path}.at"), near, shape
        )

    def _number(self, node: YamlNode, path: str, example: str) -> complex | None:
        word = self.nodes.word(node, path, f"a number such as {example}")
        value = None if word is None else complex_number(word)
        if word is not None and value is None:
            self.nodes.complain(node, path, f"{word!r} is not a number", f"such as {example}")
        return value

    def _shape(self, node: YamlNode, path: str) -> dict[str, complex]:
        mapping: Mapping | None = self.nodes.mapping(node, path, "motions with amplitudes")
        shape: dict[str, complex] = {}
        for key, item in mapping.pairs() if mapping is not None else ():
            value = self._number(item, f"{path}.{key.text}", "0.5 or 0.5 ∠ -30")
            if self._is_motion(key, path) and value is not None:
                shape[key.text] = value
        if mapping is not None and len(shape) == len(mapping.entries) and not any(shape.values()):
            self.nodes.complain(node, path, "nothing moves in this shape", "give at least one motion an amplitude")
        return shape

    def _is_motion(self, key: Scalar, path: str) -> bool:
        """Whether a name is that of a coordinate, or of the motion of a joint; refuse it if not."""
        match = JOINT_MOTION.fullmatch(key.text)
        if match is None:
            return self.names.coordinate(key, path) is not None
        kind = self.names.joint(key, path, match[2])
        if kind is None or match[1] in kind.motions:
            return kind is not None
        motions = [f"{motion}({match[2]})" for motion in kind.motions]
        hint = suggestion(key.text, motions) or ", ".join(motions) or "it has no motion with a name"
        self.nodes.complain(key, path, f"the joint {match[2]!r} has no motion {match[1]!r}", hint)
        return False
