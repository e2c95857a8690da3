"""Motions as frames: positions of all bodies at evenly spaced times, or over one period of a mode."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbstab.analysis.simulate.mode_shape import Swing
from mbstab.analysis.simulate.result import Simulation
from mbstab.analysis.verdict.wording import show
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.records import dataclass
from mbstab.report.pictures.scales import typeset, with_minus_sign

FPS = 25.0
"""Frames per second, if not given."""

FINE = 5
"""Points on the path of a traced point for each frame."""

MOST_FRAMES = 20_000
"""Largest number of frames; more are taken as a mistake."""

SWING = 2.0
"""Duration of one period of a mode in an animation, for any period (s)."""


@dataclass(frozen=True)
class Frames:
    """Positions of the bodies in each frame.

    Attributes
    ----------
    fps : float
        Frames per second.
    captions : list of str
        Text in the corner of each frame.
    positions, rotations : ndarray, shape (n, n_b, 3) and (n, n_b, 3, 3)
        Reference points (m), and from body axes to ground axes.
    trail : (ndarray, ndarray)
        The same with `FINE` instants for a frame, for the paths of points; the first is that of the first frame.
    """

    fps: float
    captions: list[str]
    positions: Array
    rotations: Array
    trail: tuple[Array, Array]


def frame_count(duration: float, fps: float, speed: float) -> int:
    """Return the number of frames of a motion (s).

    Raises
    ------
    UsageError
        If there are too many.
    """
    frames = duration / speed * fps + 1e-9
    if not frames < MOST_FRAMES:
        raise UsageError(
            f"an animation of {duration:g} s has {frames:.6g} frames, more than {MOST_FRAMES}\n"
            "hint: shorten it with --to, or make it faster with --speed 10"
        )
    return math.floor(frames) + 1


def motion_frames(sim: Simulation, fps: float = FPS, speed: float = 1.0) -> Frames:
    """Return a simulation at evenly spaced times; between output times it is interpolated.

    Parameters
    ----------
    fps : float
        Frames per second.
    speed : float
        Seconds of motion per second of the animation.
    """
    first, last = float(sim.times[0]), float(sim.times[-1])
    count = frame_count(last - first, fps, speed)
    fine = np.minimum(first + np.arange(FINE * (count - 1) + 1) * (speed / fps / FINE), last)
    times, trail = fine[::FINE], _interpolated(sim, fine)
    digits = max(0, math.ceil(-math.log10(speed / fps) - 1e-9))
    captions = [with_minus_sign(f"t = {t:.{digits}f} s") for t in times]
    if speed != 1.0:
        how = f"{speed:g}× as fast" if speed > 1.0 else f"{1.0 / speed:g}× slower"
        captions = [f"{text}, {how}" for text in captions]
    for (name, unit), y in zip(sim.output_names, sim.outputs.T, strict=True):
        values = np.interp(times, sim.times, y)
        digits = max(0, 3 - math.ceil(math.log10(float(np.max(np.abs(y))) or 1.0))) if np.isfinite(y).all() else 3
        captions = [
            f"{text}, {name} = {with_minus_sign(f'{x:.{digits}f}')} {typeset(unit)}".rstrip()
            for text, x in zip(captions, values.tolist(), strict=True)
        ]
    return Frames(fps, captions, trail[0][::FINE], trail[1][::FINE], trail)


def _interpolated(sim: Simulation, times: Array) -> tuple[Array, Array]:
    """Return positions by cubic interpolation, orientations by uniform rotation."""
    from scipy.interpolate import CubicHermiteSpline

    place, turn = _padded(sim.positions, sim.rotations)
    if len(sim.times) == 1:
        return np.repeat(place, len(times), axis=0), np.repeat(turn, len(times), axis=0)
    k = np.clip(np.searchsorted(sim.times, times, side="right") - 1, 0, len(sim.times) - 2)
    part = (times - sim.times[k]) / (sim.times[k + 1] - sim.times[k])
    v = np.zeros_like(place)
    v[..., : sim.velocities.shape[-1]] = sim.velocities
    relative = np.swapaxes(turn[k], -1, -2) @ turn[k + 1]
    return CubicHermiteSpline(sim.times, place, v)(times), turn[k] @ _part_of_turn(relative, part[:, None])


def _part_of_turn(rotation: Array, part: Array) -> Array:
    """Return rotations, shape (…, 3, 3), by a fraction of their angles, shape (…)."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    sine = np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0))
    cross = skew / np.where(sine > 1e-12, sine, 1.0)[..., None, None]
    a = (part * angle)[..., None, None]
    result: Array = np.eye(3) + np.sin(a) * cross + (1.0 - np.cos(a)) * cross @ cross
    return result


def _padded(positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Return positions and orientations with three components."""
    d = positions.shape[-1]
    place = np.zeros((*positions.shape[:-1], 3))
    turn = np.broadcast_to(np.eye(3), (*rotations.shape[:-2], 3, 3)).copy()
    place[..., :d], turn[..., :d, :d] = positions, rotations
    return place, turn


def still_frames(swings: Sequence[Swing]) -> Frames:
    """Return the reference, and of each mode both extremes, from its positions at four instants of a period."""
    positions, rotations = [swings[0].rest[0]], [swings[0].rest[1]]
    for swing in swings:
        # A mode without frequency starts at the reference.
        for k in (0, 2) if swing.value.imag else (1, 3):
            positions.append(swing.positions[k])
            rotations.append(swing.rotations[k])
    place, turn = _padded(np.array(positions), np.array(rotations))
    return Frames(FPS, [""] * len(place), place, turn, (place, turn))


def swing_frames(swing: Swing, number: int, fps: float = FPS) -> Frames:
    """Return one period of a mode, which continues smoothly when repeated."""
    value = swing.value
    text = with_minus_sign(f"mode {number}: {show(value, 4)} 1/s")
    said = "growth and decay not shown" if value.real else "exaggerated"
    place, turn = _padded(swing.positions, swing.rotations)
    trail = np.repeat(place, FINE, axis=0), np.repeat(turn, FINE, axis=0)
    return Frames(fps, [f"{text}, {said}"] * len(swing.q), place, turn, trail)
