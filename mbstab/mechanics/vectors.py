"""Small vectors as tuples, of numbers of any kind (floats, arrays over a sweep, symbols)."""

from __future__ import annotations

from collections.abc import Callable

from mbstab.mechanics.catalogue import Number, Triad, Vector
from mbstab.mechanics.frames import cross, dot


def norm(a: Vector, sqrt: Callable[[Number], Number]) -> Number:
    """Return |a|."""
    return sqrt(dot(a, a))


def unit(a: Vector, sqrt: Callable[[Number], Number]) -> Vector:
    """Return a/|a|."""
    # Dividing by the largest component first would guard against overflow; lengths of
    # directions written in a file do not need it.
    length = norm(a, sqrt)
    return tuple(x / length for x in a)


def turned(a: Vector) -> Vector:
    """Return a planar vector turned by a right angle, counter-clockwise."""
    return -a[1], a[0]


def triad(axis: Vector, zero: Vector | None, sqrt: Callable[[Number], Number]) -> Triad:
    """Return the right-handed triad on an axis.

    Parameters
    ----------
    axis : tuple
        Direction of v1, any length; two components in a planar scene.
    zero : tuple or None
        Direction from which an angle about the axis counts; v2 is its part across the
        axis. Without it v2 is the body axis that follows the largest component of
        `axis` in the cycle x, y, z.
    """
    v1 = unit(axis, sqrt)
    if len(v1) == 2:
        return Triad(v1, turned(v1), ())
    if zero is None:
        sizes = [abs(representative(x)) for x in v1]
        follower = (sizes.index(max(sizes)) + 1) % 3
        zero = tuple(1.0 if i == follower else 0.0 for i in range(3))
    along = dot(zero, v1)
    v2 = unit(tuple(z - along * v for z, v in zip(zero, v1, strict=True)), sqrt)
    return Triad(v1, v2, cross(v1, v2))


def plain_zero(x: Number) -> bool:
    """Whether a number is always zero: neither a symbol nor an array over a sweep."""
    return not (hasattr(x, "shape") or hasattr(x, "free_symbols")) and bool(x == 0)


def representative(x: Number) -> float:
    """Return one representative of a number: the first point of a sweep, the value of a constant."""
    if hasattr(x, "flat"):
        return float(x.flat[0])
    try:
        return float(x)
    except TypeError:  # a symbol: the choice of v2 is a convention, any will do
        return 0.5
