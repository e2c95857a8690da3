"""Tyres: side force and aligning moment of a wheel that rolls with a slip angle.

The slip angle α is that of the speed of the contact against the plane of the wheel, tan α = v_y/|v_x| with v_x of the
centre and v_y of the contact, positive to the left of the heading; the lean γ is positive to the right. Of the slip
comes the side force F = −C α, with a peak D that of the Magic Formula, −D sin(S atan(x − E (x − atan x))) with
x = C α/(S D), the shape factor S and the curvature factor E: it has the same slope C where nothing slips (Bakker,
Nyborg, Pacejka, SAE 870421, 1987). The lean adds a camber thrust −C_γ γ at the contact.
F acts a pneumatic trail t behind the contact: its moment there is −t cos α F. An aligning moment of its own may be
added, K α at small slip and with a peak likewise by the Magic Formula; it turns the wheel to where it goes, until at
large slip it may change its sign (shape factors above 2). The lean may have a moment of its own, −K_γ γ, which turns
the wheel to the side to which it leans. Where the wheel moves astern of its heading, v_x < 0, the trail lies on the
other side, and both moments have the other sign. With a relaxation length σ side force and camber thrust follow over
the distance travelled: the slip z = α + γ C_γ/C is a first-order state, z' = |v|/σ (α + γ C_γ/C − z), and z − γ C_γ/C
stands for α above (Pacejka, Tire and Vehicle Dynamics, 2012, chapters 1, 4 and 7). Coefficients may be expressions of
the load, and this one of the motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Item, Kind, Load, Look, OwnState
from mbstab.mechanics.contacts import wheel_at_contact
from mbstab.mechanics.frames import Column
from mbstab.mechanics.vectors import turned
from mbstab.records import dataclass

# --- elements -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Rolling:
    """How a wheel moves over the ground: speeds along and across, turn rate about the normal, lean; and functions."""

    along: Any
    across: Any
    turn: Any
    lean: Any
    f: Any

    @property
    def speed(self) -> Any:
        return self.f.sqrt(self.along**2 + self.across**2)

    @property
    def sense(self) -> Any:
        """1 of a wheel that moves ahead, -1 of one that moves astern, no value of one that moves sideways."""
        return 1 / self.f.signum(self.along)


def _rolling(frame: Any, p: Any) -> _Rolling:
    if frame.dimension == 2:
        heading, velocity = frame.direction(p.along), frame.velocity(p.point)
        left = Column(turned(heading))
        return _Rolling(heading.dot(velocity), left.dot(velocity), frame.u[2], 0, frame.f)
    arm, heading, left = wheel_at_contact(frame, p)
    centre, turn = frame.velocity(p.center), frame.angular_velocity()
    axle = frame.direction(p.axle)
    level = axle.cross(p.normal)
    lean = frame.f.atan2(p.normal.dot(axle), frame.f.sqrt(level.dot(level)))
    return _Rolling(heading.dot(centre), left.dot(centre + turn.cross(arm)), p.normal.dot(turn), lean, frame.f)


def _slip(at: _Rolling, p: Any, states: Any) -> Any:
    """Return the slip angle, or what follows it over a relaxation length."""
    if not states:
        return at.f.atan2(at.across, at.f.abs(at.along))
    return states[0].q[0] - _of_lean(at, p)


def _of_lean(at: _Rolling, p: Any) -> Any:
    """Return the slip angle at which the side force is the camber thrust."""
    return p.camber[0] / p.cornering[0] * at.lean if at.lean != 0 else 0


def _side_force(at: _Rolling, p: Any, slip: Any) -> Any:
    """Return the side force at a slip: linear, or by the Magic Formula where there is a peak."""
    if not hasattr(p, "peak"):
        return -p.cornering[0] * slip
    return -_magic(at, p.cornering[0], p, slip)


def _magic(at: _Rolling, slope: Any, p: Any, slip: Any) -> Any:
    """Return the Magic Formula with a slope at zero slip."""
    x = slope / (p.shape_factor[0] * p.peak[0]) * slip
    return p.peak[0] * at.f.sin(p.shape_factor[0] * at.f.atan(x - p.curvature_factor[0] * (x - at.f.atan(x))))


def _acting(at: _Rolling, p: Any, slip: Any) -> Load:
    force = _side_force(at, p, slip)
    moment = -p.trail[0] * at.along / at.speed * force
    thrust = -p.camber[0] * at.lean if at.lean != 0 else 0
    return Load(power=(((force + thrust, moment), (at.across, at.turn)),))


def _tyre(frames: Any, p: Any, s: Any) -> Load:
    wheel, *states = frames
    at = _rolling(wheel, p)
    return _acting(at, p, _slip(at, p, states))


def _aligning(frames: Any, p: Any, s: Any) -> Load:
    wheel, *states = frames
    at = _rolling(wheel, p)
    slip = _slip(at, p, states)
    moment = _magic(at, p.aligning[0], p, slip) if hasattr(p, "peak") else p.aligning[0] * slip
    return Load(power=(((at.sense * moment,), (at.turn,)),))


def _camber_moment(frames: Any, p: Any, s: Any) -> Load:
    at = _rolling(frames[0], p)
    return Load(power=(((-at.sense * p.moment[0] * at.lean,), (at.turn,)),))


def _tyre_relaxation(frames: Any, p: Any, s: Any) -> Any:
    wheel, state = frames
    at = _rolling(wheel, p)
    return [state.u[0] - at.speed / p.relaxation[0] * (_slip(at, p, ()) + _of_lean(at, p) - state.q[0])]


_PLACES: dict[str, tuple[tuple[str, int], ...]] = {
    "planar": (("point", 2), ("along", 2)),
    "spatial": (("center", 3), ("axle", 3), ("radius", 1), ("tube", 1), ("normal", 3)),
}
_CAMBER: dict[str, tuple[tuple[str, int], ...]] = {"planar": (), "spatial": (("camber", 1),)}
_CAMBER_SLIP: dict[str, tuple[tuple[str, int], ...]] = {"planar": (), "spatial": (("cornering", 1), ("camber", 1))}
_FORCE = (("cornering", 1), ("trail", 1))
_MAGIC = tuple((name, 1) for name in ("peak", "shape_factor", "curvature_factor"))
_AT_REST = (
    "the slip of a tyre has no value where its wheel does not move over the ground, at rest or turning on the spot: "
    "give speeds under reference: rates: (or reference: steady: {direction: x, speed: …}, where a motion is looked "
    "for, or a turn about an axis beside the wheel), or hold a wheel that stands by a contact instead; an aligning "
    "or camber moment has none where its wheel moves straight sideways; with a relaxation length the cornering "
    "stiffness must not be 0; a peak that changes with the motion must stay positive"
)

ELEMENTS = tuple(
    element
    for frame, place in _PLACES.items()
    for element in (
        *(
            element
            for magic, law in (("", _FORCE), ("magic_", (*_FORCE, *_MAGIC)))
            for element in (
                Element(f"{magic}tyre", "force", (frame,), 1, (*place, *law, *_CAMBER[frame]), _tyre, hint=_AT_REST),
                Element(
                    f"relaxed_{magic}tyre",
                    "force",
                    (frame,),
                    1,
                    (*place, *law, *_CAMBER[frame]),
                    _tyre,
                    states=1,
                    hint=_AT_REST,
                ),
            )
        ),
        *(
            element
            for magic, law in (("", ()), ("magic_", _MAGIC))
            for element in (
                Element(
                    f"{magic}aligning_moment",
                    "force",
                    (frame,),
                    1,
                    (*place, ("aligning", 1), *law),
                    _aligning,
                    hint=_AT_REST,
                ),
                Element(
                    f"relaxed_{magic}aligning_moment",
                    "force",
                    (frame,),
                    1,
                    (*place, ("aligning", 1), *law, *_CAMBER_SLIP[frame]),
                    _aligning,
                    states=1,
                    hint=_AT_REST,
                ),
            )
        ),
        Element(
            "tyre_relaxation",
            "nonholonomic",
            (frame,),
            1,
            (*place, ("relaxation", 1), ("cornering", 1), *_CAMBER[frame]),
            _tyre_relaxation,
            states=1,
            units=("rad/s",),
            hint=_AT_REST,
        ),
        *(
            Element("camber_moment", "force", (frame,), 1, (*place, ("moment", 1)), _camber_moment, hint=_AT_REST)
            for _ in _CAMBER[frame]
        ),
    )
)

# --- kinds ----------------------------------------------------------------------------------------------------------


def _place(item: Item) -> tuple[int, tuple[Any, ...]]:
    """Return the body of the wheel, and the numbers that say where it is."""
    if item.dimension == 2:
        point = item.marker("at")
        return point.body, (*point.point, *item.direction("along"))
    contact = item.contact("contact")
    center = contact.marker("center")
    sizes = (contact.number("radius"), contact.number("tube"))
    return center.body, (*center.point, *contact.direction("axle"), *sizes, *contact.direction("normal"))


def _camber(item: Item) -> tuple[Any, ...]:
    return (item.number("camber_stiffness"),) if item.dimension == 3 else ()


def _tyre_elements(item: Item) -> Iterable[ElementUse]:
    body, place = _place(item)
    force = [item.number("cornering_stiffness"), item.number("trail")]
    name = "tyre"
    if item.given("peak"):
        name = "magic_tyre"
        force += [item.number(key) for key, _ in _MAGIC]
    if item.given("relaxation_length"):
        yield ElementUse(f"relaxed_{name}", (body, item.state), (*place, *force, *_camber(item)))
    else:
        yield ElementUse(name, (body,), (*place, *force, *_camber(item)))
    if item.given("aligning_stiffness"):
        yield _aligning_use(item, body, place)
    if item.given("camber_moment"):
        yield ElementUse("camber_moment", (body,), (*place, item.number("camber_moment")))


def _aligning_use(item: Item, body: int, place: tuple[Any, ...]) -> ElementUse:
    name, numbers = "aligning_moment", [item.number("aligning_stiffness")]
    if item.given("aligning_peak"):
        name = f"magic_{name}"
        numbers += [item.number(f"aligning_{key}") for key, _ in _MAGIC]
    if not item.given("relaxation_length"):
        return ElementUse(name, (body,), (*place, *numbers))
    slip = (item.number("cornering_stiffness"), *_camber(item)) if item.dimension == 3 else ()
    return ElementUse(f"relaxed_{name}", (body, item.state), (*place, *numbers, *slip))


def _relaxation(item: Item) -> Iterable[ElementUse]:
    body, place = _place(item)
    numbers = (*place, item.number("relaxation_length"), item.number("cornering_stiffness"), *_camber(item))
    yield ElementUse("tyre_relaxation", (body, item.state), numbers, labels=("relaxation",))


def _look(item: Item) -> tuple[Look, ...]:
    return (Look("blade", (item.marker("at"),), item.direction("along")),)


_WHERE = {
    2: (
        Field("at", "marker", "where the wheel stands, seen from above: body or body.point", required=True),
        Field("along", "direction", "heading of the wheel in the frame of its body", default="x"),
    ),
    3: (
        Field(
            "contact",
            "slipping wheel",
            "name of a contact of type wheel that may slip across its track, motion: sideways or frictionless",
            required=True,
        ),
    ),
}
_STIFFNESS = (
    Field(
        "cornering_stiffness",
        "moving number",
        "side force over slip angle at small slip; may change with the motion, as the load does",
        "N/rad",
        required=True,
        sign="nonnegative",
        instead="a positive stiffness gives a side force against the slip; data whose slip or force has the other sign "
        "have it negative",
    ),
    Field(
        "camber_stiffness",
        "number",
        "camber thrust over lean, towards the side to which the wheel leans; the trail does not count for it",
        "N/rad",
        default="0",
        dimensions=(3,),
    ),
    Field(
        "camber_moment",
        "number",
        "moment over lean, which turns the wheel to the side to which it leans",
        "N*m/rad",
        dimensions=(3,),
    ),
    Field(
        "peak",
        "moving number",
        "largest side force, D of the Magic Formula, which may change with the motion; without it the side force is "
        "linear",
        "N",
        sign="positive",
        needs=("shape_factor",),
    ),
    Field(
        "shape_factor",
        "number",
        "C of the Magic Formula, for side forces about 1.3",
        sign="positive",
        most=2.0,
        needs=("peak",),
    ),
    Field(
        "curvature_factor",
        "moving number",
        "E of the Magic Formula, which may change with the motion",
        default="0",
        most=1.0,
        needs=("peak",),
    ),
    Field(
        "aligning_stiffness",
        "moving number",
        "aligning moment over slip angle at small slip, in addition to that of the trail; may change with the motion",
        "N*m/rad",
        sign="nonnegative",
        instead="a positive stiffness turns the wheel to where it goes; data whose slip or moment has the other sign "
        "needs it reversed",
    ),
    Field(
        "aligning_peak",
        "moving number",
        "largest aligning moment, D of the Magic Formula, which may change with the motion; without it the moment is "
        "linear",
        "N*m",
        sign="positive",
        needs=("aligning_stiffness", "aligning_shape_factor"),
    ),
    Field(
        "aligning_shape_factor",
        "number",
        "C of the Magic Formula, for aligning moments about 2.4",
        sign="positive",
        most=4.0,
        needs=("aligning_peak",),
    ),
    Field(
        "aligning_curvature_factor",
        "moving number",
        "E of the Magic Formula, which may change with the motion",
        default="0",
        most=1.0,
        needs=("aligning_peak",),
    ),
    Field("trail", "number", "pneumatic trail: distance of the side force behind the contact", "m", default="0"),
    Field(
        "relaxation_length",
        "number",
        "distance over which the side force follows the slip, which is then a state named NAME_slip (rad)",
        "m",
        sign="positive",
    ),
)

KINDS: tuple[Kind, ...] = tuple(
    Kind(
        "tyre",
        "side force and aligning moment of a rolling wheel, " + ("seen from above", "with a contact")[dimension - 2],
        (dimension,),
        (*where, *(field for field in _STIFFNESS if dimension in field.dimensions)),
        _tyre_elements,
        transmits=True,
        look=_look if dimension == 2 else None,
        state=OwnState(
            "relaxation_length", "slip", "slip angle that the side force of a tyre follows", "rad", _relaxation
        ),
    )
    for dimension, where in _WHERE.items()
)
