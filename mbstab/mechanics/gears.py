"""Drive trains: gears, belts, racks and differentials between joints that stand elsewhere in the file.

Each is one holonomic row (f₁x₁ + f₂x₂ + … − phase)/scale over angles and travels x of joints, or, with a stiffness or a
damping, a spring and a damper on this sum. In the plane angles count turns. In space they are known by cosine and sine
only, within half a turn; there the sum is taken within half a turn, too, and the factors of angles are whole numbers:
no turn of any angle then shows. Whole numbers without a common divisor admit the same motions as the sum itself.

Angles and travels count against the body that all joints of the train share, the carrier of its wheels, so planetary
trains need nothing of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

from mbstab.mechanics.catalogue import (
    GROUND,
    Element,
    ElementUse,
    Field,
    Form,
    Item,
    Kind,
    Load,
    Look,
    Marker,
    Number,
    Vector,
)
from mbstab.mechanics.drives import TRAVEL, TURN
from mbstab.mechanics.forces import ANY_SIGN
from mbstab.mechanics.frames import Frame, cross, dot
from mbstab.mechanics.joints import joint_angle_functions, joint_displacement, motion_parameters
from mbstab.mechanics.measures import MEASURES
from mbstab.mechanics.vectors import norm, representative, turned

# --- elements -------------------------------------------------------------------------------------------------------

_HINT = (
    "the zero direction of one of its joints stands along the axis there, and the angle has no value; give the angles "
    "of the bodies under reference.guess, or turn a body by axes:, so that the axes meet"
)
_OF_MOTION = {("angle", "planar"): (), ("angle", "spatial"): TURN}
ANGLES = ("angle", "angle")
TRAVEL_AND_ANGLE = ("displacement", "angle")
SIDES = ("angle", "angle", "angle")


def _motion(motion: str, first: Any, second: Any, p: Any) -> Any:
    if motion == "displacement":
        return joint_displacement(first, second, p)
    if first.dimension == 2:
        return first.q[2] - second.q[2]
    cosine, sine = joint_angle_functions(first, second, p)
    return first.f.atan2(sine, cosine)


def _sum(motions: tuple[str, ...], frames: Any, p: Any) -> Any:
    """Return f₁x₁ + f₂x₂ + … − phase."""
    total = -p.phase[0]
    for k, motion in enumerate(motions):
        own = SimpleNamespace(
            **{name.rpartition("_")[0]: value for name, value in vars(p).items() if name[-1] == str(k)}
        )
        total += p.factors[k] * _motion(motion, frames[2 * k], frames[2 * k + 1], own)
    return total


def _value(frames: Any, p: Any, total: Any) -> Any:
    """Return the value of the row."""
    if frames[0].dimension == 3:
        f = frames[0].f
        total = f.atan2(f.sin(total), f.cos(total))
    return total / p.scale[0]


def _train(motions: tuple[str, ...]) -> Callable[..., Any]:
    return lambda frames, p, s: [_value(frames, p, _sum(motions, frames, p))]


def _elastic(motions: tuple[str, ...]) -> Callable[..., Any]:
    def define(frames: Any, p: Any, s: Any) -> Load:
        total = _sum(motions, frames, p)
        speed = frames[0].rate(total) / p.scale[0]
        return Load(p.stiffness[0] * _value(frames, p, total) ** 2 / 2, p.damping[0] * speed**2 / 2)

    return define


def _elements(name: str, motions: tuple[str, ...], unit: str, elastic: bool = True) -> Iterable[Element]:
    for frame in ("planar", "spatial"):
        of_motions = [TRAVEL if x == "displacement" else _OF_MOTION[x, frame] for x in motions]
        own = tuple((f"{key}_{k}", size) for k, keys in enumerate(of_motions) for key, size in keys)
        numbers = (("factors", len(motions)), ("phase", 1), ("scale", 1))
        slots = 2 * len(motions)
        yield Element(name, "holonomic", (frame,), slots, (*own, *numbers), _train(motions), units=(unit,), hint=_HINT)
        if elastic:
            parameters = (*own, *numbers, ("stiffness", 1), ("damping", 1))
            yield Element(f"{name}_spring", "force", (frame,), slots, parameters, _elastic(motions), hint=_HINT)


ELEMENTS = (
    *_elements("gear", ANGLES, "rad"),
    *_elements("rack", TRAVEL_AND_ANGLE, "m"),
    *_elements("differential", SIDES, "rad", elastic=False),
)

# --- kinds ----------------------------------------------------------------------------------------------------------

SMALL = 100_000
"""Largest number of turns after which two wheels with a given ratio must stand as before, in space.

The row tells positions apart that differ by less than a turn over this number; steps of a simulation stay far below.
"""


def whole_turns(ratio: Number) -> Number | None:
    """Return how often the first wheel turns until both stand as before; None: a ratio is no fraction of small numbers.

    Parameters
    ----------
    ratio : number
        Turns of the first wheel in one of the second, not zero. A symbol stands for a whole number.
    """
    if hasattr(ratio, "free_symbols"):
        return 1
    if getattr(ratio, "shape", ()):
        import numpy as np

        found = [whole_turns(x) for x in ratio.flat]
        return None if None in found else np.reshape(np.array(found, dtype=float), ratio.shape)
    size = representative(ratio)
    if size < 0:
        return whole_turns(-ratio)
    if size == 0:
        return None
    fraction = Fraction(max(size, 1 / size)).limit_denominator(SMALL)
    if size < 1:
        fraction = 1 / fraction
    error, allowed = ratio * fraction.denominator - fraction.numerator, 4e-16 * fraction.numerator
    return fraction.denominator if bool(error <= allowed) and bool(-error <= allowed) else None


def nearest_whole(number: Number) -> Number:
    """Return the whole number that is nearest to a number, or to each of an array."""
    if getattr(number, "shape", ()):
        import numpy as np

        return np.round(number).astype(int)
    return round(representative(number))


def _common_divisor(a: Number, b: Number) -> Number:
    if hasattr(a, "free_symbols") or hasattr(b, "free_symbols"):
        return 1
    a, b = nearest_whole(a), nearest_whole(b)
    if getattr(a, "shape", ()) or getattr(b, "shape", ()):
        import numpy as np

        return np.gcd(a, b)
    return math.gcd(a, b)


def _ratio(item: Item) -> tuple[Number, Number]:
    """Return factors of the two angles, whose quotient is the ratio; in space whole numbers."""
    if item.given("teeth"):
        a, b = item.value("teeth")
        divisor = _common_divisor(a, b) if item.dimension == 3 else 1
        return a / divisor, b / divisor
    if item.given("radii"):
        a, b = item.value("radii")
        ratio = b / a
    else:
        ratio = item.number("ratio")
    turns = whole_turns(ratio) if item.dimension == 3 else 1
    assert turns is not None
    return turns, ratio * turns


def _senses(joints: Iterable[Item]) -> list[int]:
    """Return for each joint 1, or -1 where its first body is the carrier: the one body that all joints share."""
    pairs = [tuple(marker.body for marker in joint.markers("between")) for joint in joints]
    shared = set.intersection(*map(set, pairs))
    return [-1 if shared == {first} else 1 for first, _ in pairs]


def _placed(item: Item, motions: tuple[str, ...], factors: Vector) -> tuple[tuple[int, ...], Vector, Number]:
    """Return the bodies of the joints, the parameters of their motions, and the sum of the motions at the reference.

    In space angles then count from the reference, where the sum is zero.
    """
    slots: list[int] = []
    parameters: list[Number] = []
    phase: Number = 0.0
    for joint, motion, factor in zip(item.value("joints"), motions, factors, strict=True):
        bodies = [marker.body for marker in joint.markers("between")]
        poses = [item.at_reference(body) for body in bodies]
        numbers = motion_parameters(joint, motion)
        if motion == "angle" and item.dimension == 3 and not item.given("offset"):
            numbers = _from_here(poses, numbers)
        else:
            phase = phase + factor * _measured(motion, poses, numbers)
        slots += bodies
        parameters += numbers
    return tuple(slots), tuple(parameters), phase


def _measured(motion: str, poses: list[Frame], numbers: Vector) -> Any:
    """Return a motion, an angle in space within half a turn."""
    formula = MEASURES[motion].formula
    assert formula is not None
    return formula(poses, (*numbers, 0.0) if motion == "angle" else numbers)


def _from_here(poses: list[Frame], numbers: Vector) -> Vector:
    """Return the parameters of an angle that counts from where the bodies stand."""
    own, v2, v3 = numbers[:3], numbers[3:6], numbers[6:]
    first, second = poses
    zero = first.direction(own)
    cosine, sine = (dot(zero, second.direction(v)) for v in (v2, v3))
    ahead = tuple(cosine * x + sine * y for x, y in zip(v2, v3, strict=True))
    across = tuple(cosine * y - sine * x for x, y in zip(v2, v3, strict=True))
    return (*own, *ahead, *across)


def _use(item: Item, name: str, motions: tuple[str, ...], factors: Vector, scale: Number, own: Number) -> ElementUse:
    """Return the element of a train, whose sum is divided by `scale` in a row, and by `own` where it is elastic."""
    joints = item.value("joints")
    signed = tuple(x * sense for x, sense in zip(factors, _senses(joints), strict=True))
    slots, parameters, phase = _placed(item, motions, signed)
    if item.given("offset"):
        phase = scale * item.number("offset")
    if not any(map(item.given, ("stiffness", "damping"))):
        return ElementUse(name, slots, (*parameters, *signed, phase, scale), labels=("ratio",))
    spans = 2 if item.kind.name == "belt" else 1
    elastic = (spans * item.number(x) if item.given(x) else 0.0 for x in ("stiffness", "damping"))
    return ElementUse(f"{name}_spring", slots, (*parameters, *signed, phase, own, *elastic))


def _gear(item: Item) -> Iterable[ElementUse]:
    motions, factors, scale = _terms(item)
    radius = item.value("radii")[0] if item.given("radii") else 1.0
    yield _use(item, "gear", motions, factors, scale, scale / radius)


def _rack(item: Item) -> Iterable[ElementUse]:
    motions, factors, scale = _terms(item)
    yield _use(item, "rack", motions, factors, scale, scale)


def _terms(item: Item) -> tuple[tuple[str, ...], Vector, Number]:
    """Return the motions in the sum of a gear, a belt or a rack, their factors, and that of the offset."""
    if item.kind.name == "rack":
        scale = 1 / item.number("radius")
        return TRAVEL_AND_ANGLE, (scale, -1.0), scale
    one, other = _ratio(item)
    same = item.value("internal") if item.kind.name == "gear" else not item.value("crossed")
    return ANGLES, (one, -other if same else other), one


def is_elastic(item: Item) -> bool:
    """Whether an entry is a gear, a belt or a rack with a stiffness."""
    return item.kind.name in ("gear", "belt", "rack") and item.given("stiffness")


def stretched(item: Item) -> tuple[list[tuple[Any, str, Number]], Number]:
    """Return the sum over which an elastic train pulls: joints, motions and factors, and the value without force."""
    motions, factors, scale = _terms(item)
    joints = item.value("joints")
    terms = [
        (joint, motion, factor * sense)
        for joint, motion, factor, sense in zip(joints, motions, factors, _senses(joints), strict=True)
    ]
    if item.given("offset"):
        return terms, scale * item.number("offset")
    rest: Number = 0.0
    for joint, motion, factor in terms:
        poses = [item.at_reference(marker.body) for marker in joint.markers("between")]
        rest = rest + factor * _measured(motion, poses, motion_parameters(joint, motion))
    return terms, rest


def _differential(item: Item) -> Iterable[ElementUse]:
    one, other = _ratio(item) if item.given("teeth") else (1, 1)
    yield _use(item, "differential", SIDES, (one + other, -one, -other), one + other, 1.0)


def _circles(item: Item, radii: Vector) -> tuple[Look, ...]:
    """Return the pitch circles of the wheels about the last joints of a train."""
    joints = item.value("joints")
    found = []
    for joint, sense, radius in zip(reversed(joints), reversed(_senses(joints)), reversed(radii), strict=False):
        side = 0 if sense > 0 else 1
        wheel, axis = joint.markers("between")[side], ()
        if item.dimension == 3:
            axis = joint.triads("axis", "zero")[side].v1
        if wheel.body != GROUND:
            found.append(Look("body", (wheel,), axis, Form("cylinder", (abs(radius), 0.0))))
    return tuple(found)


def _wheels(item: Item) -> tuple[Look, ...]:
    return _circles(item, item.value("radii") if item.given("radii") else _touching(item))


def _belt_look(item: Item) -> tuple[Look, ...]:
    """Return the pitch circles, and the spans of the belt between them."""
    circles, sides = _wheels(item), list(_carriers(item))
    one, other = (joint.markers("between")[side] for joint, side in sides)
    if not item.given("radii") or one.body != other.body:
        return circles
    gap, sqrt = tuple(y - x for x, y in zip(one.point, other.point, strict=True)), item.functions.sqrt
    axis: Vector = ()
    if item.dimension == 3:
        axis = sides[0][0].triads("axis", "zero")[sides[0][1]].v1
        gap = tuple(x - dot(axis, gap) * y for x, y in zip(gap, axis, strict=True))
    apart, (own, far) = norm(gap, sqrt), item.value("radii")
    far = -far if item.value("crossed") else far
    if not apart > abs(own - far):
        return circles
    along = tuple(x / apart for x in gap)
    across, lean = cross(axis, along) if axis else turned(along), (own - far) / apart
    spans = []
    for side in (1, -1):  # a tangent of both circles has the same normal at both
        normal = [lean * x + side * sqrt(1 - lean * lean) * y for x, y in zip(along, across, strict=True)]
        ends = (
            Marker(marker.body, tuple(x + radius * y for x, y in zip(marker.point, normal, strict=True)))
            for marker, radius in ((one, own), (other, far))
        )
        spans.append(Look("line", tuple(ends)))
    return (*circles, *spans)


def _sides_look(item: Item) -> tuple[Look, ...]:
    """Return lines from the case to both sides."""
    case, *sides = (joint.markers("between")[1 - side] for joint, side in _carriers(item))
    return tuple(Look("line", (case, side)) for side in sides if GROUND not in (case.body, side.body))


def _carriers(item: Item) -> Iterable[tuple[Item, int]]:
    """Yield each joint of a train, and which of its two sides is on the carrier."""
    joints = item.value("joints")
    return ((joint, 1 if sense > 0 else 0) for joint, sense in zip(joints, _senses(joints), strict=True))


def _touching(item: Item) -> Vector:
    """Return radii with which two wheels on a carrier touch each other, or none."""
    one, other = (joint.markers("between")[side] for joint, side in _carriers(item))
    if one.body != other.body or item.kind.name == "belt":
        return ()
    apart = norm(tuple(x - y for x, y in zip(one.point, other.point, strict=True)), item.functions.sqrt)
    turns, times = _ratio(item)
    inside = item.value("internal")
    if representative(times) < 0:
        inside, times = not inside, -times
    across = abs(times - turns) if inside else turns + times
    return (apart * turns / across, apart * times / across) if apart and across else ()


def _fields(motions: tuple[str, ...], which: str, *own: Field, unit: str, rest: str) -> tuple[Field, ...]:
    doc = f"{which}; angles and travels count against the body that they share"
    joints = Field("joints", "joints", doc, required=True, motions=motions)
    stays = (
        f"value of {rest}, which stays, in space up to whole turns of each angle; that of the reference, if not given"
    )
    offset = Field("offset", "number", stays, unit)
    return (joints, *own, offset)


def _elastic_fields(of: str, needs: tuple[str, ...] = ()) -> tuple[Field, ...]:
    return (
        Field("stiffness", "number", f"stiffness {of}; the ratio then holds without load only", "N/m",
              sign="nonnegative", needs=needs, instead=ANY_SIGN),
        Field("damping", "number", f"viscous damping {of}", "N*s/m", sign="nonnegative", needs=needs,
              instead=ANY_SIGN),
    )  # fmt: skip


_RADII = Field("radii", "radii", "radii of the pitch circles of both wheels", "m", sign="positive")
_TEETH = Field("teeth", "teeth", "numbers of teeth of both wheels")
_RATIO = Field(
    "ratio", "ratio", "turns of the first wheel in one of the second; negative: in the other sense", sign="nonzero"
)
_WHEELS = (_TEETH, _RADII, _RATIO)
_ONE = (("teeth", "radii", "ratio"),)

KINDS: tuple[Kind, ...] = (
    Kind(
        "gear",
        "two wheels in mesh: they turn in opposite senses, with internal: true in the same; with a stiffness or "
        "damping the teeth are elastic",
        (2, 3),
        _fields(
            ANGLES,
            "the joints about which the two wheels turn",
            *_WHEELS,
            Field("internal", "flag", "whether one of them is a ring gear with internal teeth", default="false"),
            *_elastic_fields("of the mesh, along the pitch circles", ("radii",)),
            unit="rad",
            rest="angle 1 + ratio*angle 2 (-, if internal)",
        ),
        _gear,
        one_of=_ONE,
        transmits=True,
        look=_wheels,
    ),
    Kind(
        "belt",
        "belt or chain around two wheels: they turn in the same sense, with crossed: true in opposite ones; with "
        "a stiffness or damping it is elastic",
        (2, 3),
        _fields(
            ANGLES,
            "the joints about which the two wheels turn",
            *_WHEELS,
            Field("crossed", "flag", "whether the belt is crossed between the wheels", default="false"),
            *_elastic_fields("of each of the two spans", ("radii",)),
            unit="rad",
            rest="angle 1 - ratio*angle 2 (+, if crossed)",
        ),
        _gear,
        one_of=_ONE,
        transmits=True,
        look=_belt_look,
    ),
    Kind(
        "rack",
        "rack and pinion: travel = radius*angle; with a stiffness or damping the teeth are elastic",
        (2, 3),
        _fields(
            TRAVEL_AND_ANGLE,
            "the joint along which the rack slides, and that about which the pinion turns",
            Field("radius", "number", "of the pitch circle, negative if the rack lies on the other side", "m",
                  required=True, sign="nonzero"),
            *_elastic_fields("of the mesh, along the rack"),
            unit="m",
            rest="travel - radius*angle",
        ),
        _rack,
        transmits=True,
        look=lambda item: _circles(item, (item.number("radius"),)),
    ),
    Kind(
        "differential",
        "the case turns by the mean of both sides, which get equal torques; with teeth: a planetary set, "
        "(n1 + n2)*carrier = n1*sun + n2*ring",
        (2, 3),
        _fields(
            SIDES,
            "the joints of the case and of the two sides, or of carrier, sun and ring",
            replace(_TEETH, doc="numbers of teeth of both sides, if they differ"),
            unit="rad",
            rest="angle of the case - mean of the sides",
        ),
        _differential,
        transmits=True,
        look=_sides_look,
    ),
)  # fmt: skip
