"""``mbstab simulate --animate``: its options, and writing the file."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mbstab.cli.common import progress_bar
from mbstab.cli.output import asked_size, files, note, save
from mbstab.errors import UsageError
from mbstab.records import dataclass
from mbstab.report.picture_sizes import sized

if TYPE_CHECKING:
    from mbstab.analysis.simulate.result import Simulation
    from mbstab.api import Mechanism
    from mbstab.compiler.system import System
    from mbstab.report.animation.frames import Frames

F = TypeVar("F", bound=Callable[..., Any])

POINTS = 501
"""Output times of a simulation, if not given and enough for an animation."""

SMALL = 6.0
"""From this ratio of the widths of picture and mechanism on, --follow is recommended."""

SUNK = 0.01
"""Depth below the ground, as a fraction of the width of the mechanism, from which on it is told."""

_OPTIONS = (
    click.option(
        "--animate",
        "path",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="FILE",
        help="Write a moving picture, .gif or .mp4 (with ffmpeg), in real time.",
    ),
    click.option("--fps", type=float, help="Frames per second; 25 if not given."),
    click.option("--speed", type=float, help="Seconds of the motion in a second, such as 0.1 for slow motion."),
    click.option(
        "--view", metavar="ELEVATION,AZIMUTH", help="Where one looks from in space (deg); 20,-60 if not given."
    ),
    click.option("--trace", "traces", metavar="POINT", multiple=True, help="Draw the path of body or body.point."),
    click.option("--follow", metavar="POINT", help="Keep a body or body.point in place while the ground moves along."),
    click.option(
        "--mode-shape",
        "mode",
        type=click.IntRange(1),
        metavar="K",
        help="Animate mode K of mbstab eig instead of a simulation: exaggerated, in 2 s to and fro about the "
        "reference, without growth or decay.",
    ),
)


def animation_options(command: F) -> F:
    """Add the options of animations to a command, which takes them as keywords to `Animation.of`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@dataclass(frozen=True)
class Animation:
    """The requested animation.

    Attributes
    ----------
    path : Path
    fps, speed : float
        Frames per second, and seconds of motion per second.
    view : (float, float) or None
        Elevation and azimuth (deg).
    traces : tuple of str
    follow : str
    mode : int or None
        Number of the mode that swings; None: the simulation.
    """

    path: Path
    fps: float
    speed: float
    view: tuple[float, float] | None
    traces: tuple[str, ...]
    follow: str
    mode: int | None

    @classmethod
    def of(
        cls,
        path: Path | None,
        fps: float | None,
        speed: float | None,
        view: str | None,
        traces: tuple[str, ...],
        follow: str | None,
        mode: int | None,
    ) -> Animation | None:
        """Read the options; None if there is nothing to animate.

        Raises
        ------
        UsageError
            If they exclude each other, a number is out of range, or the file cannot be written.
        """
        if path is None:
            given = {"fps": fps, "speed": speed, "view": view, "trace": traces, "follow": follow, "mode-shape": mode}
            for name, value in given.items():
                if value not in (None, ()):
                    raise UsageError(f"--{name} goes with --animate")
            return None
        for name, number in (("fps", fps), ("speed", speed)):
            if number is not None and not (math.isfinite(number) and number > 0.0):
                raise UsageError(f"--{name} must be a positive number, not {number:g}")
        from mbstab.report.animation import movie_files
        from mbstab.report.animation.frames import FPS

        files().claim(path, "--animate")
        fps = FPS if fps is None else fps
        try:
            movie_files.check(path, fps)
        except UsageError as error:
            raise UsageError(f"--animate {error}") from None
        return cls(path, fps, 1.0 if speed is None else speed, _angles(view), traces, follow or "", mode)

    def check(self, system: System) -> None:
        """Refuse unknown points, and a view of a planar scene, before anything is computed."""
        from mbstab.report.animation.sketch import Sketch

        sketch = Sketch.of(system)
        for name in self.traces:
            sketch.marker(name, "--trace")
        if self.follow:
            sketch.marker(self.follow, "--follow")
        if self.view is not None and sketch.dimension == 2:
            raise UsageError("--view is for scenes in space, this one is planar")

    def points(self, system: System, start: float | None, to: float | None) -> int:
        """Return the number of output times that a simulation needs, so that each frame has one.

        Raises
        ------
        UsageError
            If there are too many frames, or only one.
        """
        from mbstab.analysis.simulate.tolerances import TOLERANCES as SIMULATE
        from mbstab.report.animation.frames import frame_count

        scene = system.scene
        first = start if start is not None else float(scene.time if scene.initial.time is None else scene.initial.time)
        duration = SIMULATE.default_duration if to is None else to - first
        if not (math.isfinite(duration) and duration > 0.0):
            return POINTS  # the simulation reports the mistake
        intervals = frame_count(duration, self.fps, self.speed) - 1
        if not intervals:
            raise UsageError(
                f"--animate would show one frame only: {duration:g} s at --speed {self.speed:g} take "
                f"{duration / self.speed:.3g} s, and a frame 1/{self.fps:g} s\nhint: a smaller --speed or a later --to"
            )
        return intervals * math.ceil((POINTS - 1) / intervals) + 1

    def write_motion(self, system: System, sim: Simulation, title: str) -> None:
        """Animate a simulation."""
        from mbstab.report.animation.frames import motion_frames

        self._write(system, motion_frames(sim, self.fps, self.speed), title)

    def write_mode(self, mechanism: Mechanism) -> None:
        """Animate a mode."""
        from mbstab.report.animation.frames import SWING, frame_count, swing_frames

        assert self.mode is not None
        points = max(2, frame_count(SWING, self.fps, 1.0) - 1)
        frames = swing_frames(mechanism.swing(self.mode, points), self.mode, self.fps)
        self._write(mechanism.system(), frames, mechanism.model.title)

    def _write(self, system: System, frames: Frames, title: str) -> None:
        from mbstab.report.animation.movie_files import write
        from mbstab.report.animation.sketch import Sketch
        from mbstab.report.animation.stage import Stage

        with sized(asked_size()):
            stage = Stage(Sketch.of(system), frames, title, self.view, self.traces, self.follow)
        if not self.follow and stage.view.spread > SMALL:
            body = stage.view.sketch.bodies[0]
            note(f"hint: --follow {body} keeps the mechanism in view, which is small in the picture")
        body, depth = stage.view.sunk()
        if depth > SUNK * stage.view.width:
            note(f"{body} is drawn as much as {depth:.3g} m below the ground: nothing in the model keeps it above")
        with sized(asked_size()), progress_bar("animating") as progress:
            save(self.path, lambda path: write(stage, path, progress), "--animate")


def _angles(view: str | None) -> tuple[float, float] | None:
    if view is None:
        return None
    try:
        elevation, azimuth = (float(x) for x in view.split(","))
    except ValueError:
        raise UsageError(f"--view {view}: write ELEVATION,AZIMUTH in degrees, such as 20,-60") from None
    if not (-90.0 <= elevation <= 90.0 and math.isfinite(azimuth)):
        raise UsageError(f"--view {view}: the elevation lies between -90 and 90 degrees")
    return elevation, azimuth
