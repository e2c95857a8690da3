"""Groups that act on the coordinates, in balls."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Matrix
from mbstab.analysis.proof.enclosures import Reference
from mbstab.analysis.proof.motion import BallGenerator, generator_in_balls
from mbstab.analysis.proof.tolerances import TOLERANCES
from mbstab.analysis.reference.fields import ROTATIONS, Basis, Field, columns_of
from mbstab.model.balls import Ball, ball, ball_arithmetic
from mbstab.model.jets import Jet, jet_arithmetic


def moved(group: Field, reference: Reference, q: Matrix, u: Matrix) -> tuple[Matrix, Matrix]:
    """Return X(q) and DX(q) u of a combination X of rigid motions of bodies and shifts of states."""
    f, X, rate = jet_arithmetic(ball_arithmetic()), ball_matrices.zeros(len(q)), ball_matrices.zeros(len(q))
    for b in Basis(reference.system).blocks:
        c = [ball(group.exact[k]) for k in b.fields]
        if all(x.is_zero() for x in c):
            continue
        jets = [Jet(x, y, ball(0)) for x, y in zip(q[b.part], u[b.part], strict=True)]
        entries = columns_of(b.kind, tuple(map(ball, b.base)), jets, lambda x: (f.sin(x), f.cos(x)))
        for (i, k), x in entries.items():
            if not c[k].is_zero():
                place, x = b.part.start + i, Jet.of(x)
                X[place], rate[place] = X[place] + c[k] * ball(x.value), rate[place] + c[k] * ball(x.rate)
    return X, rate


def ground_turn(group: Field, reference: Reference) -> BallGenerator:
    """Return the rotation at 1 rad/s of a group that moves all with the ground but for shifts of coordinates."""
    system, b = reference.system, group.basis.blocks[0]
    c, first, zero = ball_matrices.matrix([group.exact[k] for k in b.fields]), ROTATIONS[b.kind], ball_matrices.zeros(3)
    velocity, turn = zero.copy(), zero.copy()
    velocity[:first], turn[3 - (b.ground - first) :] = c[:first], c[first : b.ground]
    size = ball_arithmetic().sqrt(ball_matrices.times(turn, turn))
    axis = turn / size
    point = np.cross(axis, velocity) / size
    return generator_in_balls(system, axis, point, ball(1), zero, ball_matrices.zeros(system.n_q))


def short(x: float) -> Ball:
    """Return the short fraction nearest to a float, or the float itself."""
    fraction = Fraction(x).limit_denominator(TOLERANCES.fraction_denominator)
    return ball(fraction if abs(float(fraction) - x) <= TOLERANCES.fraction_misfit * abs(x) else Fraction(x))
