"""The sections ``sweep``, ``modes`` and ``expect``: ranges of parameters, names of modes, what the answers must be."""

from __future__ import annotations

import cmath
import math
import re
from dataclasses import replace
from typing import Any, ClassVar

from mbstab.errors import suggestion
from mbstab.mechanics.catalogue import Field
from mbstab.model.fields.base import BY_NAME, NUMBER, FieldKind, NamesIn, Reading
from mbstab.model.fields.mappings import ListField, MappingField, MappingsField
from mbstab.model.schema import CriticalValue, Expectation, ExpectedEigenvalue, ModeName, SweepRange
from mbstab.model.yamlfile import Mapping, Scalar, YamlNode

JOINT_MOTION = re.compile(r"(\w+)\((\w+)\)")


class SweepRangesField(MappingsField):
    """Default ranges, by parameter."""

    name = "sweep ranges"

    def check_name(self, reading: Reading, key: Scalar, path: str) -> None:
        """Refuse what is no parameter."""
        reading.names.check_parameter(key, path)

    def build(self, reading: Reading) -> SweepRange | None:
        """Return a range."""
        start, stop, points = reading.values.values()
        return None if start is None or stop is None else SweepRange(start, stop, points)


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


class ComplexField(FieldKind):
    """A complex number."""

    name = "complex"
    form = NUMBER
    names: ClassVar[NamesIn] = "none"
    example = "-0.3+4.4i"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> complex | None:
        """Return the number."""
        word = reading.nodes.word(node, path, f"a number such as {self.example}")
        value = None if word is None else complex_number(word)
        if word is not None and value is None:
            reading.nodes.complain(node, path, f"{word!r} is not a number", f"such as {self.example}")
        return value


class AmplitudesField(ComplexField):
    """Complex amplitudes of coordinates and of motions of joints."""

    name = "amplitudes"
    names = "only keys"
    form = BY_NAME
    absent: ClassVar[Any] = {}
    example = "0.5 or 0.5 ∠ -30"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Any:
        """Return them by name."""
        mapping = reading.nodes.mapping(node, path, "motions with amplitudes")
        shape: dict[str, complex] = {}
        for key, item in mapping.pairs() if mapping is not None else ():
            value = super().read(reading, field, item, f"{path}.{key.text}")
            if self._is_motion(reading, key, path) and value is not None:
                shape[key.text] = value
        if mapping is not None and len(shape) == len(mapping.entries) and not any(shape.values()):
            reading.nodes.complain(node, path, "nothing moves in this shape", "give at least one motion an amplitude")
        return shape

    @staticmethod
    def _is_motion(reading: Reading, key: Scalar, path: str) -> bool:
        """Whether a name is that of a coordinate, or of the motion of a joint; refuse it if not."""
        match = JOINT_MOTION.fullmatch(key.text)
        if match is None:
            return reading.names.coordinate(key, path) is not None
        kind = reading.names.joint(key, path, match[2])
        if kind is None or match[1] in kind.motions:
            return kind is not None
        motions = [f"{motion}({match[2]})" for motion in kind.motions]
        hint = suggestion(key.text, motions) or ", ".join(motions) or "it has no motion with a name"
        reading.nodes.complain(key, path, f"the joint {match[2]!r} has no motion {match[1]!r}", hint)
        return False


class ModesField(MappingsField):
    """Names of modes."""

    name = "modes"
    expected = "{near: eigenvalue} or {shape: motions}"

    def check_name(self, reading: Reading, key: Scalar, path: str) -> None:
        """Refuse what is no name."""
        reading.nodes.check_name(key, path, "mode")

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Any:
        """Return the names in the order of the file."""
        found: dict[str, ModeName] = super().read(reading, field, node, path)
        keys = node.keys if isinstance(node, Mapping) else {}
        return tuple(replace(mode, location=keys[name].location) for name, mode in found.items())

    def build(self, reading: Reading) -> ModeName | None:
        """Return one name, where its key stands."""
        entries, path = reading.node.entries, reading.path
        if ("near" in entries) == ("shape" in entries):
            hint = "near: -0.3+4.4i, the eigenvalue; or shape: {body.phi: 1}, what moves"
            reading.nodes.complain(reading.node, path, "give either near or shape", hint)
            return None
        return ModeName(path.partition(".")[2], reading.node.location, **reading.values)


class EigenvaluesField(ListField):
    """Expected eigenvalues."""

    name = "eigenvalues"

    def build(self, reading: Reading) -> ExpectedEigenvalue:
        """Return one of them."""
        return ExpectedEigenvalue(**reading.values)


class CriticalField(MappingField):
    """A critical value of a parameter."""

    name = "critical"
    expected = "keys with values"

    def build(self, reading: Reading) -> CriticalValue | None:
        """Return the value."""
        complete = all(value is not None for value in reading.values.values())
        return CriticalValue(**reading.values, location=reading.node.location) if complete else None


class ExpectationsField(ListField):
    """What answers must be."""

    name = "expectations"
    expected = "keys with values"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[Any, ...]:
        """Return the expectations; there may be none, as all are commented out."""
        return () if isinstance(node, Scalar) and node.empty else super().read(reading, field, node, path)

    def build(self, reading: Reading) -> Expectation:
        """Return one of them; refuse one that expects nothing."""
        node, path = reading.node, reading.path
        if not node.entries.keys() - {"at", "tolerance", "frozen", "source"} and not reading.nodes.faulty(path):
            reading.nodes.complain(node, path, "nothing is expected here", "mbstab schema expect shows the keys")
        return Expectation(node.location, **reading.values)
