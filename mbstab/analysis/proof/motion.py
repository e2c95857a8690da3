"""A motion in balls: its state, and the same scene in double precision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mbstab.analysis.algebra import ball_matrices
from mbstab.analysis.algebra.balls import Matrix
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.steady import Generator
from mbstab.compiler.system import System
from mbstab.model.balls import Ball

BallGenerator = Any
"""`mbstab.analysis.reference.steady.Generator` whose arrays hold balls."""


def generator_in_balls(
    system: System,
    axis: Any,
    point: Any,
    rate: Ball,
    velocity: Any,
    spins: Any,
) -> BallGenerator:
    """Return the generator of a steady motion in balls."""
    vectors = (np.array([*x], dtype=object) for x in (axis, point, velocity, spins))
    axis, point, velocity, spins = vectors
    return Generator(system, axis, point, rate, velocity, spins)


class State(NamedTuple):
    """The reference motion in balls."""

    q: Matrix
    u: Matrix
    a: Matrix
    nu: Matrix
    slope: Matrix
    second: Matrix
    field: BallGenerator


class Rough(NamedTuple):
    """The same scene in double precision."""

    system: System
    motion: Motion
    linear: Linearization


def steady_state(field: BallGenerator, q: Matrix, nu: Sequence[Ball] | Matrix = ()) -> State:
    """Return the motion that follows a field, given its multipliers."""
    u, (slope, second) = ball_matrices.matrix(field.field(q)), map(ball_matrices.matrix, field.frame(q))
    return State(q, u, ball_matrices.times(slope, u), np.array(nu, dtype=object), slope, second, field)
