"""All elements, and all kinds of entries, in one place."""

from __future__ import annotations

from mbstab.mechanics import (
    bearings,
    bodies,
    contacts,
    controllers,
    creep,
    drives,
    forces,
    gears,
    inputs,
    joints,
    tyres,
)
from mbstab.mechanics.catalogue import Element, Kind

ELEMENTS: dict[str, Element] = {
    f"{frame}_{element.name}": element
    for module in (bodies, joints, contacts, drives, forces, bearings, tyres, creep, gears)
    for element in module.ELEMENTS
    for frame in element.frames
}
"""Every built-in element under the name of its kernel, such as ``planar_coincident``."""


def kernel_name(element: str, dimension: int) -> str:
    """Return the key of an element in scenes of a dimension, by its name without the frame."""
    frames = ("coordinate", "planar" if dimension == 2 else "spatial")
    return next(name for frame in frames if (name := f"{frame}_{element}") in ELEMENTS)


def _by_dimension(kinds: dict[str, Kind]) -> dict[tuple[str, int], Kind]:
    return {(kind.name, dimension): kind for kind in kinds.values() for dimension in kind.dimensions}


KINDS: dict[str, dict[tuple[str, int], Kind]] = {
    "bodies": _by_dimension(bodies.KINDS),
    "joints": joints.KINDS | gears.KINDS,
    "contacts": contacts.KINDS,
    "drives": _by_dimension(drives.KINDS),
    "forces": forces.KINDS | bearings.KINDS | tyres.KINDS | creep.KINDS | controllers.KINDS,
    "inputs": inputs.KINDS,
}
"""Types by section of a model file, under (name, dimension of the scene)."""
