"""Frames as files: GIF by itself, MP4 by ffmpeg."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import struct
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from PIL import GifImagePlugin, Image, ImageChops

from mbstab.errors import OutputError, UsageError
from mbstab.report.animation.stage import Stage
from mbstab.report.files import whole_file
from mbstab.report.pictures.curves import INK

FORMATS = (".gif", ".mp4")
"""Formats of `write`, by suffix."""

FASTEST_GIF = 50.0
"""Maximum number of frames per second of a GIF: viewers slow down faster ones."""

SLOWEST = 0.01
"""Minimum number of frames per second: a GIF cannot show one frame for longer than 10 min."""


def check(path: Path, fps: float) -> None:
    """Refuse a file that cannot be written, before anything is computed.

    Raises
    ------
    UsageError
        If the suffix is not in `FORMATS`, frames are too slow, or too fast for a GIF, or ffmpeg is missing for an MP4.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: animations end with {' or '.join(FORMATS)}")
    if fps < SLOWEST:
        raise UsageError(f"{path}: an animation has at least {SLOWEST:g} frames per second, not {fps:g}")
    if path.suffix.lower() == ".gif" and fps > FASTEST_GIF:
        raise UsageError(f"{path}: a GIF has at most {FASTEST_GIF:g} frames per second, not {fps:g}")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(f"{path}: MP4 files need the program ffmpeg, which is not found\nhint: name a .gif file")


def write(stage: Stage, path: str | os.PathLike[str], progress: Callable[[float], object] = lambda done: None) -> None:
    """Write all frames; the file is written completely or not at all.

    Parameters
    ----------
    path : path
        The suffix selects the format: ``.gif``, which repeats, or ``.mp4``, by ffmpeg.
    progress : callable
        Called with the fraction of the frames that is written, from 0 to 1.

    Raises
    ------
    UsageError
        As in `check`.
    OutputError
        If ffmpeg fails.
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    check(path, stage.view.frames.fps)
    count = len(stage.view.frames.captions)

    def images() -> Iterator[Image.Image]:
        for number, image in enumerate(stage.images(), 1):
            yield image
            progress(number / count)

    with whole_file(path) as stream:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(stream, images(), stage.view.frames.fps)


def _palette() -> Image.Image:
    """Return greys, and the inks on their way to white and to black."""
    colours = [(round(255 * k / 31),) * 3 for k in range(32)]  # as fine as Pillow distinguishes
    for ink in INK[1:]:
        rgb = np.array([int(ink[i : i + 2], 16) for i in (1, 3, 5)])
        colours += [tuple(np.round(rgb + (255 - rgb) * k / 23).astype(int).tolist()) for k in range(23)]
        colours += [tuple(np.round(rgb * k / 12).astype(int).tolist()) for k in range(12)]
    image = Image.new("P", (1, 1))
    image.putpalette([x for colour in colours for x in colour])
    return image


def _write_gif(stream: BinaryIO, images: Iterator[Image.Image], fps: float) -> None:
    """Write frames one after the other, only their changes; delays in 1/100 s sum to the right duration."""
    palette = _palette()
    before: Image.Image | None = None
    pending: tuple[Image.Image, tuple[int, int]] | None = None
    due = shown = 0

    def put(ticks: int) -> None:
        assert pending is not None
        for data in GifImagePlugin.getdata(pending[0], pending[1], duration=10 * ticks):
            stream.write(data)

    for number, image in enumerate(images, 1):
        indexed = image.quantize(palette=palette, dither=Image.Dither.NONE)
        if before is None:
            table = bytes(palette.getpalette() or [])[:768].ljust(768, b"\0")
            stream.write(b"GIF89a" + struct.pack("<HHBBB", *indexed.size, 0xF7, 0, 0) + table)
            stream.write(b"!\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")
            box: tuple[int, int, int, int] | None = (0, 0, *indexed.size)
        else:
            box = ImageChops.difference(indexed.convert("L"), before.convert("L")).getbbox() or (0, 0, 1, 1)
        if pending is not None:
            put(due - shown)
            shown = due
        assert box is not None
        pending, before, due = (indexed.crop(box), box[:2]), indexed, round(100.0 * number / fps)
    if pending is not None:
        put(due - shown)
    stream.write(b";")


def _write_mp4(stream: BinaryIO, images: Iterator[Image.Image], fps: float) -> None:
    """Pass frames to ffmpeg, which writes to the path of the stream."""
    first = next(images)
    source = [
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{first.width}x{first.height}",
        "-r",
        f"{fps:.12g}",
        "-i",
        "-",
    ]
    command = ["ffmpeg", "-y", "-loglevel", "error", *source, "-an", "-pix_fmt", "yuv420p", "-f", "mp4", stream.name]
    # In its own session it does not receive the Ctrl-C of the terminal; it is ended here instead.
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for image in itertools.chain([first], images):
                process.stdin.write(image.tobytes())
        except BrokenPipeError:
            pass  # ffmpeg prints the reason
        except BaseException:
            process.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        said = process.stderr.read()
    if process.returncode:
        raise OutputError(_failed(said))


def _failed(said: bytes) -> str:
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return f"ffmpeg could not write the animation{': ' + lines[-1] if lines else ''}"
