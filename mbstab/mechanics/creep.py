"""Wheelsets on straight rails: linear creep of conical wheels, and gravitational stiffness.

The rails lie along a direction of the ground, the contacts at ±e beside the middle, in space r_0 below the axle, where
the forces act. With the displacement y across the track, the yaw ψ from it, the speed v along the rails and
V = √(v² + y'²), the creepages of a wheel on the side ± are ξ_x = ∓(e ψ' + λ v y/r_0)/V, ξ_y = (y' − v sin ψ)/V and
ξ_s = ψ'/V, and the rails act with F_x = −f_11 ξ_x, F_y = −f_22 ξ_y − f ξ_s and M = f ξ_y − f_33 ξ_s, where f = f_23 v/V
(Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, 1990): a wheelset that runs backwards is, seen from
behind, one that runs ahead. The axle turns at v/r_0. Under the load W the cone lifts one side and lowers the other:
W λ/e draws the wheelset back to the middle, and its yaw turns it away with W e λ (Wickens, Fundamentals of Rail
Vehicle Dynamics, 2003). In space a joint, such as planar, carries the wheelset over the track.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Element, ElementUse, Field, Item, Kind, Load, Look
from mbstab.mechanics.frames import Column
from mbstab.mechanics.vectors import turned

# --- elements -------------------------------------------------------------------------------------------------------


def _creep(frames: Any, p: Any, s: Any) -> Load:
    (frame,) = frames
    axle, velocity = frame.direction(p.along), frame.velocity(p.point)
    if frame.dimension == 2:
        left = Column(turned(p.rails))
        across, turn = left.dot(velocity), frame.u[2]
    else:
        left, spins = p.normal.cross(p.rails), frame.angular_velocity()
        across, turn = left.dot(velocity - p.radius[0] * spins.cross(p.normal)), p.normal.dot(spins)
    ahead = p.rails.dot(velocity)
    speed = frame.f.sqrt(ahead**2 + across**2)
    yaw, off = left.dot(axle), left.dot(frame.position(p.point) - p.origin)
    half, rise = p.half_gauge[0], p.conicity[0] / p.radius[0]
    slip = (across - ahead * yaw) / speed
    spin = turn / speed
    push = -2 * p.f11[0] * half * (half * turn + rise * off * ahead) / speed
    weight = p.load[0] * p.conicity[0]
    coupling = p.f23[0] * ahead / speed
    side = -2 * p.f22[0] * slip - 2 * coupling * spin - weight / half * off
    moment = push + 2 * coupling * slip - 2 * p.f33[0] * spin + weight * half * yaw
    return Load(power=(((side, moment), (across, turn)),))


_PLACE = tuple((name, 0) for name in ("point", "along", "rails", "origin"))
_NORMAL: dict[str, tuple[tuple[str, int], ...]] = {"planar": (), "spatial": (("normal", 3),)}
_SIZES = ("half_gauge", "conicity", "radius", "f11", "f22", "f23", "f33", "load")

ELEMENTS = tuple(
    Element(
        "creep",
        "force",
        (frame,),
        1,
        (*_PLACE, *normal, *((name, 1) for name in _SIZES)),
        _creep,
        hint="creep has no value where a wheelset does not move along the rails: give the body a speed along them "
        "under reference: rates:",
    )
    for frame, normal in _NORMAL.items()
)

# --- kinds ----------------------------------------------------------------------------------------------------------


def _wheelset(item: Item) -> Iterable[ElementUse]:
    middle = item.marker("at")
    place = (*middle.point, *item.direction("along"), *item.direction("rails"), *item.vector("origin"))
    normal = item.direction("normal") if item.dimension == 3 else ()
    yield ElementUse("creep", (middle.body,), (*place, *normal, *(item.number(name) for name in _SIZES)))


def _look(item: Item) -> tuple[Look, ...]:
    return (Look("blade", (item.marker("at"),), item.direction("along")),)


_FIELDS = (
    Field("at", "marker", "middle of the axle: body or body.point", required=True),
    Field("along", "direction", "rolling direction in the frame of the body", default="x"),
    Field("rails", "level direction", "direction of the rails", default="x"),
    Field("normal", "ground direction", "normal of the track, upwards", default="z", dimensions=(3,)),
    Field("origin", "vector", "a point in the middle of the track", "m", default="0"),
    Field("half_gauge", "number", "half distance of the contacts", "m", required=True, sign="positive"),
    Field("conicity", "number", "slope of the treads", "rad", required=True),
    Field("radius", "number", "rolling radius in the middle", "m", required=True, sign="positive"),
    Field("f11", "number", "creep along the rail, of one wheel", "N", required=True, sign="nonnegative"),
    Field("f22", "number", "creep across it, of one wheel", "N", required=True, sign="nonnegative"),
    Field("f23", "number", "coupling of lateral creep and spin", "N*m", default="0"),
    Field("f33", "number", "spin creep", "N*m^2", default="0", sign="nonnegative"),
    Field("load", "number", "load of the axle, for gravitational stiffness", "N", default="0"),
)

KINDS: tuple[Kind, ...] = tuple(
    Kind(
        "creep",
        f"wheelset with conical wheels on straight rails{where}: Kalker's linear creep on both wheels, and "
        "gravitational stiffness",
        (dimension,),
        tuple(field for field in _FIELDS if dimension in field.dimensions),
        _wheelset,
        transmits=True,
        look=_look,
    )
    for dimension, where in ((2, ", seen from above"), (3, ", carried by a joint"))
)
