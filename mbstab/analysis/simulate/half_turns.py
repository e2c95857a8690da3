"""Springs in space that a motion takes beyond half a turn.

In space angles of joints are known within half a turn only. A joint spring takes the angle within half a turn of its
rest, elastic gears, belts and racks their sum within half a turn of where it has no force
(`mbstab.mechanics.gears`). Beyond, the effort jumps to that of the turn before, which no spring does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from mbstab.analysis.reference.efforts import moving_joints
from mbstab.compiler.system import Array
from mbstab.mechanics.gears import is_elastic, stretched
from mbstab.model.scene import ItemValues, Scene


def beyond_half_turn(scene: Scene, times: Array, motions: Array) -> tuple[str, ...]:
    """Return warnings about springs that turn beyond half a turn.

    Parameters
    ----------
    times : ndarray, shape (n_t,)
        Of the output (s).
    motions : ndarray, shape (n_t, n_m)
        Motions of joints over all turns, as `moving_joints` lists them (m, rad).
    """
    if scene.dimension == 2 or not len(times):
        return ()
    numbers = {(item.name, motion): i for i, (motion, item) in enumerate(moving_joints(scene))}
    found = []
    for item, terms, rest, reach in _springs(scene):
        total = np.sum([factor * motions[:, numbers[name, motion]] for name, motion, factor in terms], axis=0) - rest
        first = math.remainder(float(total[0]), 2.0 * math.pi)
        beyond = np.flatnonzero(np.abs(total - total[0] + first) > math.pi)
        if len(beyond):
            found.append(
                f"{item.entry.called} turned beyond {reach} before t = {times[beyond[0]]:.6g} s: in space angles are "
                "known within half a turn, and its effort jumped there, which that of a spring does not; the motion "
                "after that is not that of the system"
            )
    return tuple(found)


def _springs(scene: Scene) -> Iterator[tuple[ItemValues, list[tuple[str, str, float]], float, str]]:
    """Yield springs on angles: joints, motions and factors of what they act on, its rest, and how far it counts."""
    for item in scene.items:
        if is_elastic(item):
            terms, rest = stretched(item)
            reach = math.pi / abs(float(terms[0][2])) if item.kind.name != "rack" else math.pi
            told = f"{reach:.6g} rad of the {'pinion' if item.kind.name == 'rack' else 'first wheel'} from its rest"
            yield (
                item,
                [(joint.entry.name, motion, float(factor)) for joint, motion, factor in terms],
                float(rest),
                told,
            )
        elif item.kind.effort is not None:
            effort = item.kind.effort(item)
            if effort.motion == "angle" and float(effort.stiffness):
                joint: Any = effort.of
                yield item, [(joint.entry.name, "angle", 1.0)], float(effort.rest), "half a turn from its rest"
