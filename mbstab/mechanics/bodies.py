"""Bodies: their kinetic energy and weight, and the mass properties of simple shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Form, Item, Kind, Number, Vector
from mbstab.mechanics.frames import Column
from mbstab.mechanics.vectors import plain_zero
from mbstab.records import dataclass

# --- elements -------------------------------------------------------------------------------------------------------


def _lagrangian(frame: Any, mass: Any, inertia: Any, center: Any, gravity: Any) -> Any:
    # About the reference point; its velocity in ground axes, ω in those of the body: each occurs where it is short.
    velocity = frame.velocity(None)
    momentum = mass * velocity / 2
    if center is not None:
        momentum += mass * (frame.velocity(center) - velocity)
        inertia = _moved(inertia, mass, center)
    kinetic = momentum.dot(velocity)
    if inertia is not None:
        spin = frame.local_angular_velocity()
        kinetic += Column(row.dot(spin) for row in inertia).dot(spin) / 2
    return kinetic + mass * gravity.dot(frame.position(center))


def _moved(inertia: Any, mass: Any, center: Any) -> Any:
    """Return the inertia about the reference point, J + m (c² − c cᵀ) (Steiner); in the plane c has no part along z."""
    square, along = center.dot(center), center if len(inertia) == 3 else (0,)
    return [
        Column(x + mass * ((square if i == j else 0) - along[i] * along[j]) for j, x in enumerate(row))
        for i, row in enumerate(inertia)
    ]


def _tensor(entries: Any) -> Any:
    if len(entries) == 1:
        return (Column(entries),)
    xx, yy, zz, xy, xz, yz = entries
    return Column((xx, xy, xz)), Column((xy, yy, yz)), Column((xz, yz, zz))


def _body(frames: Any, p: Any, s: Any) -> Any:
    return _lagrangian(frames[0], p.mass[0], _tensor(p.inertia), None, p.gravity)


def _body_offset(frames: Any, p: Any, s: Any) -> Any:
    return _lagrangian(frames[0], p.mass[0], _tensor(p.inertia), p.center, p.gravity)


def _point(frames: Any, p: Any, s: Any) -> Any:
    return _lagrangian(frames[0], p.mass[0], None, None, p.gravity)


TENSOR_SIZE = -1
"""In `Element.parameters`: one number in the plane, six in space (xx, yy, zz, xy, xz, yz)."""

ELEMENTS = (
    Element(
        "body", "inertia", ("planar", "spatial"), 1, (("mass", 1), ("inertia", TENSOR_SIZE), ("gravity", 0)), _body
    ),
    Element(
        "body_offset",
        "inertia",
        ("planar", "spatial"),
        1,
        (("mass", 1), ("inertia", TENSOR_SIZE), ("center", 0), ("gravity", 0)),
        _body_offset,
    ),
    Element("point", "inertia", ("planar", "spatial"), 1, (("mass", 1), ("gravity", 0)), _point),
)


def inertia_element(
    body: int, orientation: bool, mass: Number, inertia: Vector, center: Vector, gravity: Vector
) -> ElementUse:
    """Return the element of a body, the simplest that its numbers allow."""
    if not orientation:
        return ElementUse("point", (body,), (mass, *gravity))
    if all(plain_zero(c) for c in center):
        return ElementUse("body", (body,), (mass, *inertia, *gravity))
    return ElementUse("body_offset", (body,), (mass, *inertia, *center, *gravity))


# --- shapes ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ShapeKind:
    """A homogeneous shape: its lengths and its principal moments for mass 1.

    Attributes
    ----------
    fields : tuple of Field
        Its lengths; ``along`` is added to shapes that have an axis.
    axis : int or None
        Number of the axis of symmetry when ``along`` is not given.
    moments : callable
        Lengths to (axial, transverse) for shapes with an axis, to (xx, yy, zz) without.
    form : callable
        Lengths to the form in which it is drawn.
    """

    name: str
    doc: str
    fields: tuple[Field, ...]
    axis: int | None
    moments: Callable[..., Vector]
    form: Callable[..., Form]


def _length(name: str, doc: str, required: bool = True, default: str | None = None) -> Field:
    sign: Any = "positive" if required else "nonnegative"
    return Field(name, "number", doc, "m", required=required, default=default, sign=sign)


SHAPES: dict[str, ShapeKind] = {
    shape.name: shape
    for shape in (
        ShapeKind(
            "rod",
            "thin rod",
            (_length("length", "length"),),
            0,
            lambda length: (0.0 * length, length * length / 12.0),
            lambda length: Form("rod", (length,)),
        ),
        ShapeKind(
            "cylinder",
            "solid circular cylinder",
            (_length("radius", "radius"), _length("length", "length")),
            2,
            lambda radius, length: (radius * radius / 2.0, (3.0 * radius * radius + length * length) / 12.0),
            lambda radius, length: Form("cylinder", (radius, length)),
        ),
        ShapeKind(
            "cone",
            "solid circular cone with its tip along its axis; its centre is a quarter of its length above its base",
            (_length("radius", "radius of the base"), _length("length", "length")),
            2,
            lambda radius, length: (
                3.0 * radius * radius / 10.0,
                3.0 * (4.0 * radius * radius + length * length) / 80.0,
            ),
            lambda radius, length: Form("cone", (radius, length)),
        ),
        ShapeKind(
            "disk",
            "solid disk",
            (_length("radius", "radius"), _length("thickness", "thickness", False, "0")),
            2,
            lambda radius, thickness: (radius * radius / 2.0, (3.0 * radius * radius + thickness * thickness) / 12.0),
            lambda radius, thickness: Form("cylinder", (radius, thickness)),
        ),
        ShapeKind(
            "hoop",
            "thin ring",
            (_length("radius", "radius"),),
            2,
            lambda radius: (radius * radius, radius * radius / 2.0),
            lambda radius: Form("hoop", (radius,)),
        ),
        ShapeKind(
            "box",
            "solid box with edges along the body axes",
            (_length("x", "edge along x"), _length("y", "edge along y"), _length("z", "edge along z", False, "0")),
            None,
            lambda x, y, z: ((y * y + z * z) / 12.0, (x * x + z * z) / 12.0, (x * x + y * y) / 12.0),
            lambda x, y, z: Form("box", (x, y, z)),
        ),
        ShapeKind(
            "sphere",
            "solid sphere",
            (_length("radius", "radius"),),
            None,
            lambda radius: (2.0 * radius * radius / 5.0,) * 3,  # 0.4 is not a double
            lambda radius: Form("ellipsoid", (radius,) * 3),
        ),
    )
}


def shape_moments(kind: ShapeKind, lengths: Vector, mass: Number, axis: int | None) -> Vector:
    """Return (Ixx, Iyy, Izz) of a shape about its centre, in kg·m²."""
    moments = kind.moments(*lengths)
    if kind.axis is not None:
        axial, transverse = moments
        along = kind.axis if axis is None else axis
        moments = tuple(axial if i == along else transverse for i in range(3))
    return tuple(mass * moment for moment in moments)


def combine(parts: Iterable[tuple[Number, Vector, Vector]], dimension: int) -> tuple[Number, Vector, Vector]:
    """Return mass, centre and inertia about the centre of a body made of parts.

    Parameters
    ----------
    parts : iterable of (mass, place, moments)
        ``moments`` are Ixx, Iyy, Izz about the part's own centre, in body axes.

    Returns
    -------
    mass : number (kg)
    center : tuple (m)
    inertia : tuple (kg·m²)
        One number in the plane; xx, yy, zz, xy, xz, yz in space (tensor entries).
    """
    parts = [(mass, (*place, 0.0)[:3] if dimension == 2 else place, moments) for mass, place, moments in parts]
    total = sum(mass for mass, _, _ in parts)
    center = tuple(sum(mass * place[i] for mass, place, _ in parts) / total for i in range(3))
    tensor: list[Number] = [0.0] * 6
    for mass, place, moments in parts:
        x, y, z = (place[i] - center[i] for i in range(3))
        steiner = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
        for k in range(6):
            tensor[k] = tensor[k] + mass * steiner[k] + (moments[k] if k < 3 else 0.0)
    if dimension == 2:
        return total, center[:2], (tensor[2],)
    return total, center, tuple(tensor)


# --- kinds ----------------------------------------------------------------------------------------------------------

_MASS = Field("mass", "number", "mass; 0 where joints and forces determine the motion", "kg", sign="nonnegative")
_GEOMETRY = (
    Field("points", "points", "named points in the body frame, used as body.point", "m"),
    Field("directions", "named directions", "named directions in the body frame, used as axes of joints"),
)
_DISTRIBUTION = (
    _MASS,
    Field("inertia", "tensor", "inertia about the centre of mass, in body axes", "kg*m^2"),
    Field("shape", "shape", "a homogeneous shape instead of an inertia"),
    Field("parts", "parts", "several shapes with their own masses and places, instead of mass and inertia"),
    Field("drawing", "drawing", "shapes that pictures show instead of these, without mass"),
    Field("center_of_mass", "vector", "centre of mass in the body frame", "m"),
)


def _no_elements(item: Item) -> Iterable[ElementUse]:
    return ()


KINDS: tuple[Kind, ...] = (
    Kind("planar", "rigid body in the plane: x, y, theta", (2,), (*_DISTRIBUTION, *_GEOMETRY), _no_elements),
    Kind(
        "spatial",
        "rigid body in space: x, y, z and Euler X-Y-Z angles phi, theta, psi; psi is the spin about its z",
        (3,),
        (
            *_DISTRIBUTION,
            Field(
                "measured",
                "flag",
                "whether an inertia that no body can have, one moment larger than the sum of the other two, is "
                "taken as it is, with a warning",
                default="false",
                needs=("inertia",),
            ),
            *_GEOMETRY,
            Field("axes", "angles", "Euler X-Y-Z angles of a constant rotation before phi, theta, psi", "rad"),
        ),
        _no_elements,
    ),
    Kind("planar_point", "point mass in the plane: x, y", (2,), (_MASS,), _no_elements),
    Kind("point", "point mass in space: x, y, z", (3,), (_MASS,), _no_elements),
)

BODY_COORDINATES: dict[str, tuple[str, ...]] = {
    "planar": ("x", "y", "theta"),
    "spatial": ("x", "y", "z", "phi", "theta", "psi"),
    "planar_point": ("x", "y"),
    "point": ("x", "y", "z"),
}
"""The coordinates that a body of each type has."""
