"""Bodies with given Euler angles at their singularity: the same orientation, counted from another base rotation.

The angles of a spatial body, A = B Ax(φ) Ay(θ) Az(ψ), lose a direction where cos θ = 0. Nothing in
the equations of motion depends on the base rotation B: with B′ = A and angles of zero the body
stands where it was, as if the file said so with ``axes:``. The last angle counts about the same
axis of the body as before. Angles that an expression, a drive or an initial value names keep their meaning:
such a body is left as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.mechanics.catalogue import Number, Vector
from mbstab.model.fields.catalogue import given_fields

if TYPE_CHECKING:
    from mbstab.model.scene import BodyValues, Scene
    from mbstab.model.schema import Entry

SINGULAR = 1e-4
"""Below this |cos θ|, these angles lose digits."""

ANGLES = ("phi", "theta", "psi")


def named_by(entries: Iterable[Entry]) -> dict[str, str]:
    """Return the coordinates that entries name, and what names them, such as ``drive 'spin'``."""
    found: dict[str, str] = {}
    for entry in entries:
        for _, kind, value in given_fields(entry):
            found.update((name, entry.called) for name in kind.coordinates(value) if name not in found)
    return found


def regular(scene: Scene) -> Scene:
    """Return a scene in which no body has singular given angles, as far as that is possible."""
    if scene.dimension == 2 or scene.arithmetic.name == "symbol":
        return scene
    named = named_by(item.entry for item in scene.items)
    bodies, coordinates, rates, turned = list(scene.bodies), dict(scene.coordinates), dict(scene.rates), []
    for i, body in enumerate(scene.bodies):
        names = [f"{body.name}.{angle}" for angle in ANGLES]
        fixed = any(name in named or name in scene.initial.coordinates or name in scene.initial.rates for name in names)
        if fixed or not all(name in coordinates for name in names) or not _singular(coordinates[names[1]]):
            continue
        given = [name in rates for name in names]
        if any(given) and not all(given):
            continue  # a rate that is solved for would change its meaning
        angles = tuple(coordinates[name] for name in names)
        if all(given):
            speeds = _turning(angles, tuple(rates[name] for name in names), scene.arithmetic)
            rates.update(zip(names, speeds, strict=True))
        bodies[i] = _based(body, angles, scene.arithmetic)
        coordinates.update(dict.fromkeys(names, 0.0 * angles[0]))
        turned.append(body.name)
    if not turned:
        return scene
    return replace(scene, bodies=tuple(bodies), coordinates=coordinates, rates=rates, turned=tuple(turned))


def _singular(theta: Number) -> bool:
    values = np.atleast_1d(np.asarray(theta))
    return bool(np.all(np.abs(np.cos([float(x) for x in values])) < SINGULAR))


def _based(body: BodyValues, angles: Vector, f: Any) -> BodyValues:
    """Return a body whose angles count from the orientation that the given ones describe."""
    return replace(body, base=_product(body.base, euler_matrix(angles, f)))


def _product(one: Vector, other: Vector) -> Vector:
    return tuple(sum(one[3 * i + k] * other[3 * k + j] for k in range(3)) for i in range(3) for j in range(3))


def _turning(angles: Vector, rates: Vector, f: Any) -> Vector:
    """Return the angular velocity in body axes for Euler rates; at angles of zero it equals the Euler rates."""
    (c1, s1), (c2, s2) = ((f.cos(x), f.sin(x)) for x in angles[:2])
    columns: tuple[Mapping[int, Any], ...] = ({0: 1.0}, {1: c1, 2: s1}, {0: s2, 1: -s1 * c2, 2: c1 * c2})
    spin = [sum(column.get(i, 0.0) * rate for column, rate in zip(columns, rates, strict=True)) for i in range(3)]
    A = euler_matrix(angles, f)
    return tuple(sum(A[3 * i + j] * spin[i] for i in range(3)) for j in range(3))


def euler_matrix(angles: Vector, f: Any) -> Vector:
    """Return Ax(φ) Ay(θ) Az(ψ), row by row; Eqs. (120)-(122) of Pappalardo, Lettieri, Guida (2020)."""
    (c1, s1), (c2, s2), (c3, s3) = ((f.cos(x), f.sin(x)) for x in angles)
    return (
        c2 * c3, -c2 * s3, s2,
        c1 * s3 + s1 * s2 * c3, c1 * c3 - s1 * s2 * s3, -s1 * c2,
        s1 * s3 - c1 * s2 * c3, s1 * c3 + c1 * s2 * s3, c1 * c2,
    )  # fmt: skip
