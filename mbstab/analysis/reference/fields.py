"""Vector fields among which symmetries are looked for: rigid motions of each body in both frames, and shifts of states.

Of each body there are translations and rotations of the ground and of the body itself, and rotations of the body in
place; of each state its shift. A field of the class is a combination X_c = Σ c_k X_k with constant coefficients: a
wheel that turns about its axle, everything about the vertical, a gear train. Their derivatives are those of formulas in
numbers that carry derivatives, whatever the numbers are: floats, arrays over the points of a sweep, or balls.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra.arrays import Flags
from mbstab.analysis.algebra.ball_arrays import in_ball, many_bits
from mbstab.analysis.algebra.sparse import nothing
from mbstab.analysis.reference.steady import Generator
from mbstab.compiler.system import Array, System
from mbstab.model.jets import Jet
from mbstab.records import dataclass

SIZES = {"spatial": 15, "planar": 6, "spatial point": 6, "planar point": 3, "scalar": 1}
"""Numbers of fields of a body with and without orientation, and of a state.

In space: translations and rotations of the ground about its axes, rotations in place about these axes, rotations and
translations of the body about and along its own axes; in the plane two translations, a rotation about the origin, one
in place, and two translations of the body; of points those of the ground.
"""

ROTATIONS = {"spatial": 3, "spatial point": 3, "planar": 2, "planar point": 2}
"""The first rotation of the ground among the fields of a body; translations come before."""

SPINS = {"spatial": 9, "planar": 3}
"""The first rotation about a body-fixed axis."""

DRIFTS = {"spatial": 12, "planar": 4}
"""The first translation along a body-fixed axis."""


class Block(NamedTuple):
    """The fields of a body or of a state: its coordinates, the number of its first field, its kind and its base."""

    part: slice
    start: int
    kind: str
    base: Sequence[Any]
    body: int | None

    @property
    def fields(self) -> range:
        """Numbers of its fields."""
        return range(self.start, self.start + SIZES[self.kind])

    @property
    def ground(self) -> int:
        """How many of the fields of a body, its first ones, move it with the ground."""
        return 6 if self.kind.startswith("spatial") else 3


class Basis:
    """The fields of a scene, numbered body by body, then the states."""

    def __init__(self, system: System) -> None:
        self.system, self.blocks = system, list[Block]()
        self._place: Array | None = None
        self._values = dict[int, Values]()
        spatial, start = system.scene.dimension == 3, 0
        for number, (body, part) in enumerate(zip(system.scene.bodies, system.body_slices, strict=True)):
            kind = ("spatial" if spatial else "planar") + ("" if body.orientation else " point")
            base = tuple(body.base) if kind == "spatial" else ()
            self.blocks.append(Block(part, start, kind, base, number))
            start += SIZES[kind]
        for i in range(sum(part.stop - part.start for part in system.body_slices), system.n_q):
            self.blocks.append(Block(slice(i, i + 1), start, "scalar", (), None))
            start += 1
        self.size = start

    def values(self, k: int, q: Array) -> Values:
        """Return the fields of a block at coordinates of the scene, where speeds are zero; the last are kept."""
        if self._place is not q:
            self._place, self._values = q, {}
        if k not in self._values:
            own = q[..., self.blocks[k].part]
            self._values[k] = field_values(self.blocks[k], own, 0.0 * own, 0.0 * own)
        return self._values[k]

    @cached_property
    def of_coordinate(self) -> list[int]:
        """The number of the block of each coordinate."""
        return [k for k, b in enumerate(self.blocks) for _ in range(b.part.start, b.part.stop)]

    @cached_property
    def of_field(self) -> Array:
        """The number of the block of each field, shape (size,)."""
        return np.repeat(np.arange(len(self.blocks)), [SIZES[b.kind] for b in self.blocks])

    @cached_property
    def still(self) -> Flags:
        """Whether each field is a constant shift: translations of the ground, last angles, states; shape (size,)."""
        found = np.zeros(self.size, dtype=bool)
        for b in self.blocks:
            found[b.start : b.start + ROTATIONS.get(b.kind, 1)] = True
            if b.kind in SPINS:
                found[b.start + (11 if b.kind == "spatial" else 3)] = True
        return found

    @cached_property
    def lengths(self) -> Flags:
        """Which fields are translations, shape (size,)."""
        found = np.zeros(self.size, dtype=bool)
        for b in self.blocks:
            found[b.start : b.start + ROTATIONS.get(b.kind, 0)] = True
            if b.kind in DRIFTS:
                found[b.start + DRIFTS[b.kind] : b.start + SIZES[b.kind]] = True
        return found


def columns_of(
    kind: str, base: Sequence[Any], q: Sequence[Any], sine: Callable[[Any], tuple[Any, Any]] | None = None
) -> dict[tuple[int, int], Any]:
    """Return the entries of the fields of a body that are not zero, by coordinate and number, at jets of coordinates.

    With `sine`, that gives sine and cosine of an angle.
    """
    if kind == "scalar":
        return {(0, 0): 1}
    if kind.startswith("planar"):
        x, y = q[:2]
        found = {(0, 0): 1, (1, 1): 1, (0, 2): -y, (1, 2): x}
        if kind == "planar":
            s, c = (sine or _sine)(q[2])
            found |= {(2, 2): 1, (2, 3): 1, (0, 4): c, (1, 4): s, (0, 5): -s, (1, 5): c}
        return found
    found = {(k, k): 1 for k in range(3)}
    for j in range(3):
        found[(j + 1) % 3, 3 + j], found[(j + 2) % 3, 3 + j] = -q[(j + 2) % 3], q[(j + 1) % 3]
    if kind == "spatial":
        found |= _turning(base, q[3:], sine or _sine)
    return found


def _turning(
    base: Sequence[Any], angles: Sequence[Any], sine: Callable[[Any], tuple[Any, Any]]
) -> dict[tuple[int, int], Any]:
    """Return the entries of the rotations of a body in space, and of its own translations."""
    (s1, c1), (s2, c2), (s3, c3) = map(sine, angles)
    secant = 1 / c2
    tangent = s2 * secant
    found: dict[tuple[int, int], Any] = {}
    for j in range(3):
        w1, w2, w3 = base[3 * j : 3 * j + 3]
        across = _sum((w3, c1), (-w2, s1))
        rates = -(tangent * across) + w1, _sum((w2, c1), (w3, s1)), across * secant
        for i, x in enumerate(rates):
            found[3 + i, 3 + j] = found[3 + i, 6 + j] = x
    own = (c3 * secant, s3, -(c3 * tangent)), (-(s3 * secant), c3, s3 * tangent), (0, 0, 1)
    found |= {(3 + i, 9 + k): x for k, column in enumerate(own) for i, x in enumerate(column)}
    rows = (
        (c2 * c3, -(c2 * s3), s2),
        (c1 * s3 + s1 * s2 * c3, c1 * c3 - s1 * s2 * s3, -(s1 * c2)),
        (s1 * s3 - c1 * s2 * c3, s1 * c3 + c1 * s2 * s3, c1 * c2),
    )
    return found | {
        (i, 12 + k): _sum(*zip(base[3 * i : 3 * i + 3], (row[k] for row in rows), strict=True))
        for i in range(3)
        for k in range(3)
    }


def _sum(*terms: tuple[Any, Any]) -> Any:
    """Return a sum of products; factors of a base are mostly zero."""
    return sum((x if c == 1 else c * x for c, x in terms if not _zero(c)), Jet(0))


def _zero(c: Any) -> bool:
    return not isinstance(c, np.ndarray) and bool(c == 0)


def _sine(x: Any) -> tuple[Jet, Jet]:
    """Return sine and cosine of a jet of numbers or arrays that have them."""
    x = Jet.of(x)
    s, c = (
        getattr(x.value, name)() if hasattr(x.value, name) else getattr(np, name)(x.value) for name in ("sin", "cos")
    )
    bent = x.rate * x.rate
    return Jet(s, c * x.rate, c * x.second - s * bent), Jet(c, -(s * x.rate), -(s * x.second) - c * bent)


class Values(NamedTuple):
    """Fields of a block at states: X, DX u, DX a + D²X[u, u], each (…, m, n), and DX, shape (…, m, m, n)."""

    X: Array
    rate: Array
    growth: Array
    slope: Array


def field_values(b: Block, q: Array, u: Array | None = None, a: Array | None = None) -> Values:
    """Return the fields of a block with their derivatives at coordinates, speeds and accelerations, shape (…, m).

    Without speeds only X has a meaning.
    """
    m, n, lead = q.shape[-1], SIZES[b.kind], q.shape[:-1]
    if u is None or a is None:
        X = np.zeros((*lead, m, n), dtype=q.dtype)
        for (i, k), x in columns_of(b.kind, b.base, [Jet(q[..., i]) for i in range(m)]).items():
            X[..., i, k] = Jet.of(x).value
        return Values(X, X, X, X)
    # The motion itself comes first, then unit directions.
    rates = np.zeros((m + 1, *lead, m), dtype=q.dtype)
    bent = np.zeros((m + 1, *lead, m), dtype=q.dtype)
    rates[0], bent[0] = u, a
    for j in range(m):
        rates[j + 1, ..., j] = rates[j + 1, ..., j] + 1
    found = np.zeros((3, m + 1, *lead, m, n), dtype=q.dtype)
    jets = [Jet(q[None, ..., i], rates[..., i], bent[..., i]) for i in range(m)]
    for (i, k), x in columns_of(b.kind, b.base, jets).items():
        x = Jet.of(x)
        found[0, ..., i, k], found[1, ..., i, k], found[2, ..., i, k] = x.value, x.rate, x.second
    return Values(found[0, 0], found[1, 0], found[2, 0], np.moveaxis(found[1, 1:], 0, -2))


@dataclass(frozen=True, eq=False)
class Field:
    """A field X_c of the class.

    Attributes
    ----------
    basis : Basis
    c : ndarray, shape (basis.size,)
        Its coefficients.
    exact : sequence of numbers
        The same as fractions or balls.
    """

    basis: Basis
    c: Array
    exact: Sequence[Any]

    @cached_property
    def shift(self) -> Array | None:
        """The same change of the coordinates everywhere, shape (n_q,); None if it is none."""
        if np.any(self.c[~self.basis.still]):
            return None
        found = np.zeros(self.basis.system.n_q)
        for b in self.basis.blocks:
            count = ROTATIONS.get(b.kind, 1)
            found[b.part.start : b.part.start + count] = self.c[b.start : b.start + count]
            if b.kind in SPINS:
                found[b.part.stop - 1] = self.c[b.start + (11 if b.kind == "spatial" else 3)]
        return found

    @cached_property
    def generator(self) -> Generator | None:
        """The same field as a motion of everything with the ground, and shifts of single coordinates; or None."""
        system = self.basis.system
        d, common, spins = system.scene.dimension, np.zeros(6), np.zeros(system.n_q)
        for number, b in enumerate(self.basis.blocks):
            own = self.c[b.start : b.start + SIZES[b.kind]].copy()
            if b.body is None:
                spins[b.part] = own
                continue
            first, last = ROTATIONS[b.kind], b.ground
            turn = own[first:last]
            motion = np.concatenate([own[:first], np.zeros(3 - d), np.zeros(3 - len(turn)), turn])
            if b.kind in SPINS:
                k = 11 if d == 3 else 3
                spins[b.part.stop - 1], own[k] = own[k], 0.0
            if np.any(own[last:]) or (number and np.any(motion[3:] != common[3:])):
                return None
            common = motion if not number else common
            spins[b.part.start : b.part.start + d] = (motion - common)[:d]
        rate = float(np.linalg.norm(common[3:]))
        if not rate:
            return Generator(system, np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.0, common[:3], spins)
        axis = common[3:] / rate
        along = axis * (axis @ common[:3])
        return Generator(system, axis, np.cross(axis, common[:3] - along) / rate, rate, along, spins)

    @cached_property
    def moved(self) -> tuple[int, ...]:
        """Numbers of the blocks on which it is not zero."""
        return tuple(sorted(set(self.basis.of_field[np.flatnonzero(self.c)].tolist())))

    def field(self, q: Array) -> Array:
        """Return X(q), shape (…, n_q)."""
        found = np.zeros(q.shape, dtype=q.dtype)
        for k in self.moved:
            b = self.basis.blocks[k]
            found[..., b.part] = self.basis.values(k, q).X @ self.c[b.fields]
        return found

    def slope(self, q: Array) -> Any:
        """Return DX(q), shape (…, n_q, n_q)."""
        if not np.any(self.c[~self.basis.still]):
            return nothing(q.shape[-1]) if q.ndim == 1 else np.zeros((*q.shape, q.shape[-1]))
        found = np.zeros((*q.shape, q.shape[-1]), dtype=q.dtype)
        for k in self.moved:
            b = self.basis.blocks[k]
            found[..., b.part, b.part] = self.basis.values(k, q).slope @ self.c[b.fields]
        return found

    def __add__(self, other: Field) -> Field:
        exact = [_exactly(operator.add, *x) for x in zip(self.exact, other.exact, strict=True)]
        return Field(self.basis, self.c + other.c, exact)

    def times(self, factor: Any) -> Field:
        """Return a multiple of it."""
        return Field(self.basis, self.c * float(factor), [x and _exactly(operator.mul, x, factor) for x in self.exact])


def _exactly(function: Callable[[Any, Any], Any], x: Any, y: Any) -> Any:
    """Return a sum or a product of exact coefficients, in balls if one of them is: fractions and balls do not mix."""
    if not (hasattr(x, "rad") or hasattr(y, "rad")):
        return function(x, y)
    with many_bits():
        return function(in_ball(x), in_ball(y))


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A one-parameter group that carries motions into motions.

    Attributes
    ----------
    name : str
        Such as ``wheel.psi``, ``translation along x``, ``rotation about z``.
    direction, rate : ndarray, shape (n_q,)
        Its changes of the coordinates and of the speeds of the reference, Y and DY u.
    of : Field
    parts : tuple of (float, Symmetry)
        The symmetries of which it is a combination; empty: it is one of its own.
    """

    name: str
    direction: Array
    rate: Array
    of: Field
    parts: tuple[tuple[float, Symmetry], ...] = ()
