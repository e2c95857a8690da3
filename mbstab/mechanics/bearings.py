"""Bearings of rotors: eight coefficients across the axis."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Item, Kind, Load, Look
from mbstab.mechanics.forces import ANY_SIGN, gap_and_speed
from mbstab.mechanics.frames import Column
from mbstab.mechanics.vectors import plain_zero

# --- elements -------------------------------------------------------------------------------------------------------


def _coupled_mount(frames: Any, p: Any, s: Any) -> Load:
    second = frames[1]
    axes = [second.direction(v) for v in (p.second_v2, p.second_v3)] if second.dimension == 3 else second.axes
    gap, speed = gap_and_speed(frames, p)
    x, v = (Column(axis.dot(vector) for axis in axes) for vector in (gap, speed))
    K, C = ((Column(rows[:2]), Column(rows[2:])) for rows in (p.stiffness, p.damping))
    return Load(power=((Column(-k.dot(x) - c.dot(v) for k, c in zip(K, C, strict=True)), v),))


_ENDPOINTS = (("first", 0), ("second", 0))
_MATRICES = (("stiffness", 4), ("damping", 4))

ELEMENTS = (
    Element("coupled_mount", "force", ("planar",), 2, (*_ENDPOINTS, *_MATRICES), _coupled_mount),
    Element(
        "coupled_mount",
        "force",
        ("spatial",),
        2,
        (*_ENDPOINTS, ("second_v2", 3), ("second_v3", 3), *_MATRICES),
        _coupled_mount,
    ),
)

# --- kinds ----------------------------------------------------------------------------------------------------------

_STIFFNESS = ("kxx", "kxy", "kyx", "kyy")
_DAMPING = ("cxx", "cxy", "cyx", "cyy")


def _rotor_bearing(item: Item) -> Iterable[ElementUse]:
    first, second = item.markers("between")
    curves = item.value("curves") if item.given("curves") else {}
    K, C = ([curves[x] if x in curves else item.number(x) for x in names] for names in (_STIFFNESS, _DAMPING))
    slots, ends = (first.body, second.body), (*first.point, *second.point)
    spatial = item.dimension == 3
    axes = item.triads("axis", "zero")[1] if spatial else None
    if all(plain_zero(x) for x in (*K[1:3], *C[1:3])):
        # Springs and dampers along two axes, which have a potential and a dissipation function.
        own = (*axes.v1, *axes.v2, *axes.v3) if axes else ()
        along = (0.0,) * (1 if spatial else 0)
        numbers = (*along, K[0], K[3], *along, C[0], C[3], *along, 0.0, 0.0)
        yield ElementUse("mount_force", slots, (*ends, *own, *numbers))
    else:
        across = (*axes.v2, *axes.v3) if axes else ()
        yield ElementUse("coupled_mount", slots, (*ends, *across, *K, *C))


def _look(item: Item) -> tuple[Look, ...]:
    return (Look("spring", item.markers("between")),)


_BODIES = "in the frame of each body: x, -y, a named direction or a vector; a list of two if they differ"
_FIELDS = (
    Field("between", "markers", "a point of the shaft and one of the housing or the ground", required=True),
    Field("axis", "directions", f"axis of the bearing, {_BODIES}", default="z", dimensions=(3,)),
    Field(
        "zero",
        "zero directions",
        f"direction x across the axis, {_BODIES}; y is the axis times x",
        default="x",
        dimensions=(3,),
    ),
    Field(
        "curves",
        "speed curves",
        "coefficients that change with the speed, from a file",
        columns=(*_STIFFNESS, *_DAMPING),
    ),
    *(Field(x, "number", f"stiffness, {x} of the matrix", "N/m", default="0") for x in _STIFFNESS),
    *(
        Field(
            x,
            "number",
            f"damping, {x} of the matrix",
            "N*s/m",
            default="0",
            sign="nonnegative" if x in ("cxx", "cyy") else "any",
            instead=f"stiffness, cxy and cyx may be negative; {ANY_SIGN}",
        )
        for x in _DAMPING
    ),
)

KINDS: tuple[Kind, ...] = tuple(
    Kind(
        "rotor_bearing",
        "bearing or seal of a rotor with eight coefficients: the force on the shaft is -[kxx, kxy; kyx, kyy]*(x, y) "
        "- [cxx, cxy; cyx, cyy]*(rates of x and y), with its displacement (x, y) across the axis in the axes of the "
        "second body",
        (dimension,),
        tuple(field for field in _FIELDS if dimension in field.dimensions),
        _rotor_bearing,
        some_of=("curves", *_STIFFNESS, *_DAMPING),
        transmits=True,
        look=_look,
    )
    for dimension in (2, 3)
)
