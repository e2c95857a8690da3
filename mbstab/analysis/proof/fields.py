"""Groups that act on the coordinates, for numbers that carry derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.proof.enclosures import Reference
from mbstab.analysis.proof.motion import BallGenerator, generator_in_balls
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.reference.fields import Basis, Field, columns_of
from mbstab.analysis.reference.steady import Generator
from mbstab.compiler.system import Array
from mbstab.mechanics.catalogue import GROUND
from mbstab.model import balls
from mbstab.model.balls import Ball, ball
from mbstab.model.jets import Jet, jet_arithmetic

Map = Callable[[Sequence[Jet]], list[Jet]]
"""A field, for jets of balls."""


def along_direction(Y: Map, q: Sequence[Ball], v: Sequence[Ball]) -> list[Jet]:
    """Return a field at q with its first two derivatives in a direction."""
    return [Jet.of(x) for x in Y([Jet(x, y, ball(0)) for x, y in zip(q, v, strict=True)])]


def combined(group: Field, reference: Reference) -> Map:
    """Return a combination of rigid motions of bodies and shifts of states."""
    f, system = jet_arithmetic(balls.ball_arithmetic()), reference.system

    def sine(x: Any) -> tuple[Jet, Jet]:
        return f.sin(x), f.cos(x)

    exact = [c if isinstance(c, int) else ball(c) for c in group.exact]

    def field(q: Sequence[Jet]) -> list[Jet]:
        found = [Jet.of(ball(0))] * len(q)
        for b in Basis(system).blocks:
            if any(exact[k] != 0 for k in b.fields):
                columns = columns_of(b.kind, tuple(map(ball, b.base)), q[b.part], sine)
                for (i, k), x in columns.items():
                    if exact[b.start + k] != 0:
                        found[b.part.start + i] = found[b.part.start + i] + Jet.of(ball(exact[b.start + k])) * x
        return found

    return field


def ground_turn(generator: Generator, reference: Reference) -> BallGenerator:
    """Return a rotation of the ground at 1 rad/s, about an axis and a point of the file if it names them."""
    system, zero = reference.system, [ball(0)] * 3
    axis = next((x for x in _axes(reference) if _same(x, generator.axis)), None)
    axis = axis or [short(x) for x in generator.axis.tolist()]
    point = next((x for x in _points(reference, axis) if _same(x, generator.point)), None)
    point = point or [short(x) for x in generator.point.tolist()]
    return generator_in_balls(system, axis, point, ball(1), zero, [ball(0)] * system.n_q)


def _axes(reference: Reference) -> Iterable[list[Ball]]:
    """Yield axes that the file names."""
    yield from ([ball(int(i == k)) for i in range(3)] for k in range(3))
    scene = reference.system.scene
    gravity = [*ball_matrices.vector(scene.gravity), ball(0)][:3]
    if any(not x.is_zero() for x in gravity):
        size = balls.ball_arithmetic().sqrt(sum((x * x for x in gravity), ball(0)))
        yield [-x / size for x in gravity]
    yield reference.state.field.axis
    for item in scene.items:
        if item.entry.section == "joints" and item.given("axis") and item.given("between"):
            sides = zip(item.markers("between"), item.triads("axis", "zero"), strict=True)
            yield from (
                [*ball_matrices.vector(triad.v1), ball(0)][:3] for marker, triad in sides if marker.body == GROUND
            )


def _points(reference: Reference, axis: list[Ball]) -> Iterable[list[Ball]]:
    """Yield points that the file names, moved along an axis to the plane through the origin perpendicular to it."""
    found = [[ball(0)] * 3, reference.state.field.point]
    for item in reference.system.scene.items:
        if item.given("between"):
            markers = (x for x in item.markers("between") if x.body == GROUND)
            found += [[*ball_matrices.vector(x.point), ball(0)][:3] for x in markers]
    for point in found:
        along = sum((x * y for x, y in zip(axis, point, strict=True)), ball(0))
        yield [x - along * y for x, y in zip(point, axis, strict=True)]


def short(x: float) -> Ball:
    """Return the short fraction nearest to a float, or the float itself."""
    fraction = Fraction(x).limit_denominator(TOLERANCES.fraction_denominator)
    return ball(fraction if abs(float(fraction) - x) <= TOLERANCES.fraction_misfit * abs(x) else Fraction(x))


def _same(x: Sequence[Ball], y: Array) -> bool:
    return all(abs(float(a) - b) <= TOLERANCES.equal_points for a, b in zip(x, y.tolist(), strict=True))
