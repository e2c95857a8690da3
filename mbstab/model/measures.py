"""What can be measured of a motion, as the expressions of outputs name it."""

from __future__ import annotations

import re

from mbstab.model.expressions import DERIVED
from mbstab.model.schema import unit_of
from mbstab.records import dataclass

MEASURES = {
    "angle": "angle of a joint: angle(joint)",
    "displacement": "travel along a joint: displacement(joint)",
    "place": "component of the place of a point: place(body.point.x) or place(body.x)",
    "force": "component of what a joint, contact, drive or mount transmits to its first body: force(joint.x)",
    "torque": "component of the torque that it transmits: torque(joint.z)",
    "effort": "force or torque of a spring, damper, actuator, controller, motor or drive: effort(name)",
}
"""Words of outputs; coordinates stand by themselves, rate(...) and acceleration(...) go with those and with motions."""

TRANSMITTED = ("force", "torque", "effort")
_TEXT = re.compile(r"(?:(rate|acceleration)\()?(?:(" + "|".join(MEASURES) + r")\()?([\w.]+)\)*")


@dataclass(frozen=True)
class Measure:
    """One thing that is measured.

    Attributes
    ----------
    order : int
        0, 1 or 2: itself, its rate or its acceleration.
    kind : str
        A key of `MEASURES`, or ``coordinate``.
    owner : str
        The coordinate, the joint, the body or the entry.
    point : str
        Of the body, empty for its reference point.
    component : str
        ``x``, ``y`` or ``z``, empty where there is one only.
    """

    order: int
    kind: str
    owner: str
    point: str = ""
    component: str = ""

    @staticmethod
    def of(text: str) -> Measure:
        """Return what a name in an output stands for, such as ``rate(angle(pivot))``."""
        match = _TEXT.fullmatch(text)
        assert match is not None
        order = 0 if match[1] is None else 1 + DERIVED.index(match[1])
        if match[2] is None:
            return Measure(order, "coordinate", match[3])
        if match[2] == "place" or match[2] in ("force", "torque"):
            owner, *middle, component = match[3].split(".") if "." in match[3] else (match[3], "")
            return Measure(order, match[2], owner, ".".join(middle), component)
        return Measure(order, match[2], match[3])

    @property
    def unit(self) -> str:
        """Its SI unit; empty for efforts, which are forces or torques."""
        base = {"angle": "rad", "displacement": "m", "place": "m", "force": "N", "torque": "N*m", "effort": ""}
        unit = unit_of(self.owner) if self.kind == "coordinate" else base[self.kind]
        return unit + ("", "/s", "/s^2")[self.order]
