"""Angles of joints in space over all turns: from which half turn on an angle in an expression counts.

The directions of two bodies give an angle within half a turn. It is continued over all turns as kπ + atan2(…), where
the directions of the second body are turned by k half turns, so that k is any whole number within half a turn of the
angle itself. At the reference k is that of the value x in ``angle(joint) - x``, as a controller compares it with its
target: the difference is within half a turn there, as that of a `joint_spring` from its rest. Without such a
difference, it is that of the angle within half a turn. A simulation counts on from there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.mechanics.catalogue import Number, Vector
from mbstab.mechanics.measures import MEASURES
from mbstab.model.arithmetic import FLOAT
from mbstab.model.dependencies import expressions_in
from mbstab.model.expressions import Binary, Expression, ExpressionError, Name, Node
from mbstab.model.numbers import nominal

if TYPE_CHECKING:
    from mbstab.model.scene import ItemValues


def counted_on(numbers: Vector, k: Any, f: Any, before: Any = 0) -> Vector:
    """Return the numbers of an angle in space that counts from `k` half turns, and counted from `before` of them.

    Parameters
    ----------
    numbers : tuple of number
        Directions of both bodies (`mbstab.mechanics.joints.motion_parameters`).
    f : arithmetic
    """
    sign = 1 - 2 * ((k - before) % 2)
    return (*numbers[:3], *(sign * x for x in numbers[3:9]), k * f.constants["pi"])


def at_reference(joint: ItemValues, numbers: Vector) -> Vector:
    """Return the numbers of the angle of a joint, counted from the half turn that is next to it at the reference."""
    f, formula = joint.functions, MEASURES["angle"].formula
    assert formula is not None
    within = (*numbers, f.number("0"))
    if f.name == "symbol":
        return within
    poses = [joint.at_reference(marker.body) for marker in joint.markers("between")]
    angle = _plain(formula(poses, within))
    value = next(_compared(joint), None)
    if value is not None:
        angle = angle + 2.0 * math.pi * _rounded((_plain(value) - angle) / (2.0 * math.pi))
    k = _rounded(angle / math.pi)
    return within if isinstance(k, int) and not k else counted_on(numbers, k, f)


def _plain(x: Number) -> Any:
    """Return a number as a float, or an array of them over the points of a sweep."""
    return x if hasattr(x, "shape") else nominal(x)


def _rounded(x: Any) -> Any:
    """Return the next whole number, or an array of them."""
    return np.round(x) if hasattr(x, "shape") else round(x)


def _compared(joint: ItemValues) -> Iterator[Number]:
    """Yield the values x in ``angle(joint) - x`` or ``x - angle(joint)`` in what acts on the motion."""
    evaluator, name = joint.evaluator, f"angle({joint.name})"
    model = evaluator.model
    known = {**evaluator.parameters, "t": evaluator.number(model.reference.time)}
    for section in ("drives", "forces", "constraints", "states"):
        for expression in expressions_in([entry.values for entry in model.entries.get(section, {}).values()]):
            for node in expression.walk() if name in expression.names() else ():
                value = _beside(node, name)
                if value is None or value.used[1] or not set(value.used[0]) <= set(known):
                    continue
                try:
                    yield Expression("", value).evaluate(known, evaluator.f)
                except ExpressionError:
                    continue


def _beside(node: Node, name: str) -> Node | None:
    """Return what a name is compared with in a difference."""
    if not isinstance(node, Binary) or node.operator != "-":
        return None
    sides = (node.left, node.right)
    for one, other in (sides, sides[::-1]):
        if isinstance(one, Name) and one.name == name:
            return other
    return None


def counts_turns(name: str, expressions: Sequence[Expression]) -> bool:
    """Whether an expression changes with a full turn of an angle; that of its sine does not."""
    for expression in expressions:
        if name not in expression.names():
            continue
        names = {x: 0.3 + 0.1 * math.sqrt(i) for i, x in enumerate((*expression.names(), *expression.rates()))}
        rates = {x: names[x] for x in expression.rates()}
        try:
            one, other = (
                expression.evaluate({**names, name: names[name] + turn}, FLOAT, rates) for turn in (0.0, 2.0 * math.pi)
            )
        except ExpressionError:
            return True
        if not math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12):
            return True
    return False
