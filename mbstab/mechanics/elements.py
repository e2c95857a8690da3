"""All elements, and all kinds of entries, in one place; each module is imported when something of it is asked for."""

from __future__ import annotations

from types import ModuleType

from mbstab.mechanics.catalogue import FRAMES, Element, Kind
from mbstab.mechanics.gathered import Gathered

_MODULES = "bodies joints contacts drives forces bearings tyres creep gears measures"
_FRAMES: Gathered[str, list[str]] = Gathered(__package__, _MODULES, lambda module: _frames(module.ELEMENTS))
"""The frames of each element, by its name without them; one module has all of them."""


def _frames(elements: tuple[Element, ...]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for element in elements:
        found.setdefault(element.name, []).extend(element.frames)
    return found


def _by_kernel(module: ModuleType) -> dict[str, Element]:
    return {f"{frame}_{element.name}": element for element in module.ELEMENTS for frame in element.frames}


ELEMENTS: Gathered[str, Element] = Gathered(__package__, _MODULES, _by_kernel)
"""Every built-in element under the name of its kernel, such as ``planar_coincident``."""


def kernel_name(element: str, dimension: int) -> str:
    """Return the key of an element in scenes of a dimension, by its name without the frame."""
    frames = _FRAMES[element]
    return f"{'coordinate' if 'coordinate' in frames else FRAMES[dimension]}_{element}"


def list_kinds(module: ModuleType) -> dict[tuple[str, int], Kind]:
    """Return the types that a module defines, under (name, dimension of the scene)."""
    kinds: tuple[Kind, ...] = module.KINDS
    return {(kind.name, dimension): kind for kind in kinds for dimension in kind.dimensions}


KINDS: dict[str, Gathered[tuple[str, int], Kind]] = {
    "bodies": Gathered(__package__, "bodies", list_kinds),
    "joints": Gathered(__package__, "joints gears", list_kinds),
    "contacts": Gathered(__package__, "contacts", list_kinds),
    "drives": Gathered(__package__, "drives", list_kinds),
    "forces": Gathered(__package__, "forces bearings tyres creep controllers", list_kinds),
    "inputs": Gathered(__package__, "inputs", list_kinds),
}
"""Types by section of a model file, under (name, dimension of the scene)."""
