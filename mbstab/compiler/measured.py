"""The measures in the expressions of a scene: in terms of its coordinates, and their values at a state."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from mbstab.mechanics.catalogue import GROUND
from mbstab.mechanics.frames import Frame
from mbstab.mechanics.measures import MEASURES, Measure, parts
from mbstab.model.arithmetic import FLOAT, Arithmetic, array_arithmetic
from mbstab.model.jets import Jet, jet_arithmetic
from mbstab.model.scene import MeasureNumbers, Scene
from mbstab.model.turned import counted_on
from mbstab.records import dataclass


@dataclass(frozen=True)
class Measured:
    """A measure that occurs, such as ``angle(pivot)``.

    Attributes
    ----------
    name : str
    dimension : int
    bodies : tuple of tuple of str
        Names of the coordinates of each of its bodies; empty for the ground.
    count : int
        Number of its own numbers, which follow the base rotations of its bodies.
    """

    name: str
    dimension: int
    bodies: tuple[tuple[str, ...], ...]
    count: int

    @property
    def kind(self) -> Measure:
        """What it measures."""
        return MEASURES[parts(self.name)[0]]

    @property
    def bases(self) -> list[int]:
        """Sizes of the base rotations of its bodies."""
        return [9 if self.dimension == 3 and len(body) == 6 else 0 for body in self.bodies]

    @property
    def size(self) -> int:
        """Number of all numbers that belong to it."""
        return sum(self.bases) + self.count

    def of(self, frame: Callable[[Sequence[str], list[Any]], Frame], numbers: Iterator[Any]) -> Any:
        """Return the measure, or the speed that it is.

        Parameters
        ----------
        frame : callable
            Returns the frame of a body from the names of its coordinates and its base rotation.
        numbers : iterator
            The next ones are those of this measure.
        """
        frames = [
            frame(body, [next(numbers) for _ in range(size)])
            for body, size in zip(self.bodies, self.bases, strict=True)
        ]
        assert self.kind.formula is not None
        found = self.kind.formula(frames, [next(numbers) for _ in range(self.count)])
        return frames[0].f.sqrt(2 * found) if self.kind.root else found


def measured(scene: Scene, used: Container[str]) -> dict[Measured, tuple[Any, ...]]:
    """Return the measures of a scene among some names, each with the numbers that belong to it."""
    found = {}
    for name, measure in scene.measures.items():
        if name not in used:
            continue
        one, numbers = occurring(scene, name, measure)
        found[one] = numbers
    return found


def all_coordinates(coordinates: Iterable[str], measures: Iterable[Measured]) -> tuple[str, ...]:
    """Return coordinates and then those that are in measures only."""
    return tuple(dict.fromkeys((*coordinates, *(name for x in measures for body in x.bodies for name in body))))


def occurring(scene: Scene, name: str, measure: MeasureNumbers) -> tuple[Measured, tuple[Any, ...]]:
    """Return a measure of a scene with the numbers that belong to it."""
    bodies = [None if body == GROUND else scene.bodies[body] for body in measure.bodies]
    names = tuple(tuple(f"{x.name}.{c}" for c in x.coordinates) if x else () for x in bodies)
    one = Measured(name, scene.dimension, names, len(measure.numbers))
    bases = [body.base if body and size else () for body, size in zip(bodies, one.bases, strict=True)]
    return one, (*chain.from_iterable(bases), *measure.numbers)


def frames(f: Arithmetic, scene: Scene, moving: Mapping[str, Jet]) -> Callable[[Sequence[str], list[Any]], Frame]:
    """Return what gives the frames of bodies for `Measured.of`.

    Parameters
    ----------
    f : Arithmetic
    scene : Scene
    moving : mapping
        Coordinates by name, with their rates and accelerations in this arithmetic.
    """
    jets = jet_arithmetic(f)

    def frame(body: Sequence[str], base: list[Any]) -> Frame:
        q = [moving[name] for name in body]
        return Frame(jets, scene.dimension, q, base, [Jet(x.rate, x.second) for x in q])

    return frame


def recounted(scene: Scene, names: list[str], q: Any, reach: float) -> dict[str, MeasureNumbers]:
    """Return angles in space that are further than `reach` (rad) from where they count, counted from where they are.

    Parameters
    ----------
    names : list of str
        Coordinates in the order of q.
    q : ndarray, shape (n_q,)
    """
    found = {}
    frame = frames(FLOAT, scene, {name: Jet(x) for name, x in zip(names, q.tolist(), strict=True)})
    for name, x in scene.measures.items():
        if x.kind != "angle" or not len(x.numbers):
            continue
        one, numbers = occurring(scene, name, x)
        angle, near = Jet.of(one.of(frame, iter(numbers))).value, x.numbers[-1]
        if abs(angle - near) > reach:
            k, before = round(angle / math.pi), round(near / math.pi)
            found[name] = replace(x, numbers=counted_on(x.numbers, k, FLOAT, before))
    return found


def values(scene: Scene, names: list[str], q: Any, u: Any) -> dict[str, Any]:
    """Return the values of all measures of a scene, and those of their rates under ``rate(…)``.

    Parameters
    ----------
    names : list of str
        Coordinates in the order of q.
    q, u : ndarray, shape (…, n_q)
    """
    moving = {name: Jet(q[..., i], u[..., i]) for i, name in enumerate(names)}
    frame, found = frames(array_arithmetic(), scene, moving), {}
    for one, numbers in measured(scene, scene.measures).items():
        jet = Jet.of(one.of(frame, iter(numbers)))
        if one.kind.speed:
            found[f"rate({one.name})"] = jet.value
        else:
            found[one.name], found[f"rate({one.name})"] = jet.value, jet.rate
    return found
