"""Whether the coefficients of the linearized equations are constant along the motion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.reference.coefficients import Matrices, deflated, matrices_in
from mbstab.analysis.reference.motion import Finder, Motion, balanced
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import ConstraintError, MbstabError, ModelFileError, percent
from mbstab.model.schema import is_length


def coefficients(system: System, motion: Motion, frozen: bool = False) -> tuple[float, Generator | None, Matrices]:
    """Return the coefficients about a motion in its co-moving frame, and how much they vary there.

    Parameters
    ----------
    frozen : bool
        Take them in the coordinates of the file, as they are at the reference time.

    Returns
    -------
    variation : float
        Relative change along the motion.
    generator : Generator or None
        The symmetry that defines the frame; None: the coordinates of the file.
    matrices : Matrices

    Raises
    ------
    ModelFileError
        If the file declares a steady motion whose symmetry the scene does not have; names what breaks it.
    """
    if frozen or not motion.generators:
        candidates: tuple[Generator | None, ...] = (None,)
    else:
        # Coefficients may be constant along motions that are not steady; those that the forces keep come first.
        kept_first = sorted(motion.generators, key=lambda x: not _is_kept(system, motion, x))
        candidates = tuple(kept_first)
    best: tuple[float, Generator | None, Matrices] | None = None
    invariance = Invariance(system, motion)
    for generator in candidates:
        matrices = matrices_in(system, motion, generator)
        variation, obstacle = _variation(system, motion, matrices, generator)
        if variation > TOLERANCES.variation_along_motion and obstacle is None and generator is not None:
            # Small coefficients are differences of large ones: what a symmetry of the scene keeps, rounding changes.
            kept = not invariance.broken(generator) if system.scene.timed else invariance.steady(generator)
            variation *= not kept
        if best is None or variation < best[0]:
            best = variation, generator, matrices
        if variation <= TOLERANCES.variation_along_motion:
            break
    assert best is not None
    variation, generator, matrices = best
    if variation > TOLERANCES.variation_along_motion:
        if motion.declared and not frozen:
            raise _asymmetric(system, motion, variation, obstacle)
        # Nothing makes the coefficients constant: the plain equations are shown.
        matrices = matrices_in(system, motion, None)
        variation, generator = _variation(system, motion, matrices, None)[0], None
    return variation, generator, matrices


def require_steady(system: System, motion: Motion, generator: Generator) -> None:
    """Refuse a motion whose forces balance at the reference only, not as it goes on.

    Raises
    ------
    MbstabError
        If constraints or forces do not keep it.
    """
    for _ in _followed(system, motion, matrices_in(system, motion, generator), generator):
        pass


def _is_kept(system: System, motion: Motion, generator: Generator) -> bool:
    """Whether the accelerations at the reference are those of a steady motion."""
    return balanced(system, motion, _unkept(motion, generator.acceleration(motion.q)))


def _unkept(motion: Motion, steady: Array) -> Array:
    """Return the scaled forces that other accelerations than those of a motion would need."""
    result: Array = (motion.dynamics.M @ (motion.a - steady)) * motion.spaces.scale
    return result


def _variation(
    system: System, motion: Motion, matrices: Matrices, generator: Generator | None
) -> tuple[float, MbstabError | None]:
    """Return the largest relative change of the coefficients a little later on the motion, and why it is infinite."""
    worst = 0.0
    try:
        if generator is not None and (generator.turns or motion.declared):
            later = _followed(system, motion, matrices, generator)
        else:
            later = ((x, matrices_in(system, x, None)) for x in _continuing(system, motion, matrices))
        for state, then in later:
            worst = max(worst, _change(system, motion, matrices, then, state.time - motion.time))
    except MbstabError as error:
        return np.inf, error
    return worst, None


def _followed(
    system: System, motion: Motion, matrices: Matrices, generator: Generator
) -> Iterator[tuple[Motion, Matrices]]:
    """Yield the steady motion at later times, and the coefficients there, transformed to the initial directions."""
    rate = abs(generator.rate)
    speed = float(np.linalg.norm(generator.velocity)) / float(
        np.max(motion.sizes[_lengths(system)], initial=0.0) or 1.0
    )
    spin = float(np.max(np.abs(generator.spins), initial=0.0))
    fastest = max(rate, speed, spin)
    times = [
        part * TOLERANCES.guard_turn / x
        for x in (rate, speed, spin)
        if x > TOLERANCES.coordinate_rounding * fastest
        for part in (1.0, 3.0)
    ]
    times += _law_times(system, motion, matrices)
    for time in times:
        q, T = generator.flow(motion.q, time)
        u = generator.field(q)
        state = system.dynamics(q, u, motion.time + time)
        if left := _left_rows(system, motion, state, u):
            raise ConstraintError(f"the steady motion leaves {', '.join(left)}")
        later = _motion_at(motion, system, q, u, time, state)
        excess = _unkept(later, generator.acceleration(q))
        if not balanced(system, later, excess):
            worst = system.names[int(np.argmax(np.abs(excess)))]
            raise ConstraintError(f"the forces do not keep {worst} on the steady motion")
        later = replace(later, a=generator.acceleration(q))
        M, R, K, J, D_q = matrices_in(system, later, generator)
        yield later, Matrices(T.T @ M @ T, T.T @ R @ T, T.T @ K @ T, J @ T, D_q @ T)


def _motion_at(
    motion: Motion, system: System, q: Array, u: Array, time: float, state: Dynamics | None = None
) -> Motion:
    """Return a state of a motion some time later, without mass where that has none."""
    return Finder(system, motion.massless is not None).motion(q, u, motion.time + time, state=state)


def _left_rows(system: System, motion: Motion, state: Dynamics, u: Array) -> list[str]:
    """Return the owners of constraint rows that a state does not satisfy, given the matrices there."""
    allowed = TOLERANCES.residual * np.abs(state.J) @ motion.sizes
    fastest = float(np.max(np.abs(u / motion.sizes)))
    bad = [i for i in range(system.n_h) if abs(state.E[i]) > allowed[i]]
    bad += [i for i in range(system.n_c) if abs(state.V[i]) > allowed[i] * fastest]
    return list(dict.fromkeys(system.rows[i].owner for i in bad))


def _lengths(system: System) -> Any:
    return np.array([is_length(name) for name in system.names])


def _continuing(system: System, motion: Motion, matrices: Matrices) -> Iterator[Motion]:
    yield from _moved(system, motion)
    yield from _continued(system, motion, matrices)


def _moved(system: System, motion: Motion) -> Iterator[Motion]:
    """Yield the motion some way along its speeds: after a noticeable rotation, and after a noticeable shift."""
    u, a = motion.u, motion.a
    if balanced(system, motion, _unkept(motion, 0.0 * a)):
        a = 0.0 * a  # steady: rounding must not add up
    lengths = _lengths(system)
    for kind in (~lengths, lengths):
        rate = float(np.max(np.abs(u / motion.sizes)[kind], initial=0.0))
        if rate > 0.0:
            time = TOLERANCES.guard_turn / rate
            yield _motion_at(motion, system, motion.q + time * u + 0.5 * time * time * a, u + time * a, time)


def _law_times(system: System, motion: Motion, matrices: Matrices) -> list[float]:
    """Return times at which given functions of time may have changed."""
    if not system.scene.timed:
        return []
    scale = motion.spaces.scale
    R, K = (float(np.max(np.abs(x * scale * scale[:, None]), initial=0.0)) for x in (matrices.R, matrices.K))
    # Given functions can be fast or slow; the time scale of the scene itself decides what matters.
    step = 3.0 / (max(R, math.sqrt(K)) or 1.0)
    return [0.5 * step, step]


def _continued(system: System, motion: Motion, matrices: Matrices) -> Iterator[Motion]:
    """Yield the motion a step of the midpoint rule later, as given functions of time drive it."""
    last = motion
    for time in _law_times(system, motion, matrices):
        last = _motion_at(motion, system, motion.q + time * last.u, motion.u + time * last.a, time)
        yield last


def _asymmetric(system: System, motion: Motion, variation: float, obstacle: MbstabError | None) -> ModelFileError:
    """Return the error about a declared steady motion whose scene does not have the symmetry."""
    generator, scene = motion.generators[0], system.scene
    names = Invariance(system, motion).broken(generator)
    least = (
        f", where {percent(TOLERANCES.variation_along_motion)} is allowed"
        if variation < TOLERANCES.variation_told
        else ""
    )
    change = (
        f"change by {percent(variation)} along it{least}"
        if obstacle is None
        else f"cannot be followed along it, as {str(obstacle).splitlines()[0]}"
    )
    broken = f"; the symmetry is broken by {', '.join(names)}" if names else ""
    message = (
        f"the scene does not have the symmetry of the declared steady motion ({generator}): "
        f"its equations {change}{broken}"
    )
    hint = "correct reference.steady, or give the period of the motion, or ask for frozen-time numbers with --frozen"
    reference = scene.model.reference
    held = [name for name, u in zip(system.names, generator.spins, strict=True) if u and name in scene.coordinates]
    if reference.find is not None and held:
        hint = f"put {' and '.join(held[:6])} under reference.guess: given coordinates hold against forces; or {hint}"
    place = reference.location if reference.steady is None else reference.steady.location
    return ModelFileError([scene.model.document.problem(place, "reference.steady", message, hint)])


def _change(system: System, motion: Motion, now: Matrices, then: Matrices, time: float) -> float:
    """Return the largest relative change of the deflated system, apart from rounding."""
    spaces, scale = motion.spaces, motion.spaces.scale
    J = then.J * scale * spaces.row_scale[:, None]
    C, D = J[: system.n_h], J[system.n_h :]
    # The same motions must be allowed.
    turned = float(max(np.max(np.abs(x), initial=0.0) for x in (C @ spaces.N, D @ spaces.N @ spaces.Z)))
    if turned > TOLERANCES.coordinate_rounding:
        return turned
    n = spaces.N.shape[1]
    if motion.massless is not None:  # forces along these motions are compared as if they had the mass of the others
        light = motion.massless / scale[:, None]
        now, then = (x._replace(M=x.M + light @ light.T) for x in (now, then))
    A, B = (deflated(spaces, matrices)[0] for matrices in (now, then))
    # Terms that rounding is relative to, besides the entries: inertia over the time, the forces that balance, and what
    # rows on speeds make of inertia and damping, (M P + R) P and M P, which may cancel.
    forces = float(np.max(np.abs(motion.dynamics.F0 * scale)) / np.min(motion.sizes / scale))
    led, damped = (float(np.max(np.abs(A[block]), initial=0.0)) for block in (np.s_[:n, :n], np.s_[n:, n:]))
    worst = 0.0
    for block, natural in (
        (np.s_[:n, :n], 1.0 / time),
        (np.s_[n:, :n], 1.0 / time**2 + forces + led * (led + damped)),
        (np.s_[n:, n:], 1.0 / time + led),
    ):
        difference = float(np.max(np.abs(B[block] - A[block]), initial=0.0))
        if difference > TOLERANCES.coordinate_rounding * natural:
            worst = max(worst, difference / float(np.max(np.maximum(np.abs(A[block]), np.abs(B[block])))))
    return worst
