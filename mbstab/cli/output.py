"""Where answers go: one layer for all commands.

It selects the format by the suffix, keeps the files that a call reads and writes apart, writes each
file completely or not at all, and prints no invisible characters on the terminal.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mbstab.cli.mistakes import Choice
from mbstab.cli.terminal import shown
from mbstab.errors import MbstabError, OutputError, UsageError, suggestion, visible
from mbstab.records import dataclass
from mbstab.report import WIDTH, set_width
from mbstab.report.files import whole_file
from mbstab.report.picture_sizes import SIZES, sized
from mbstab.report.styles import Text, joined, styled

if TYPE_CHECKING:
    from mbstab.model.schema import Model

F = TypeVar("F", bound=Callable[..., Any])

Answer = Mapping[str, Callable[[], "str | bytes"]]
"""Functions that write an answer, by format."""

SUFFIXES = {
    "table": ".txt", "json": ".json", "csv": ".csv", "npz": ".npz", "mat": ".mat", "latex": ".tex", "junit": ".xml",
    "yaml": ".yaml",
}  # fmt: skip
"""The suffix of each format."""

BINARY = ("npz", "mat")

PICTURES = (".png", ".svg", ".pdf")
"""Suffixes of pictures; the first is the default."""


# --- the terminal ---------------------------------------------------------------------------------------------------

QUIET = "mbstab.quiet"
"""Key in the context: whether only the answer, warnings and errors are written."""


def remembered_flag(key: str, *names: str, help: str) -> Callable[[F], F]:
    """Return an option that the context stores under a key and that the command does not receive."""

    def remember(context: click.Context, _: click.Parameter, value: bool) -> None:
        context.meta[key] = value

    return click.option(*names, is_flag=True, expose_value=False, callback=remember, help=help)


def remembered(key: str) -> bool:
    """Whether such an option is given."""
    context = click.get_current_context(silent=True)
    return bool(context is not None and context.meta.get(key))


quiet_option = remembered_flag(
    QUIET, "--quiet", "-q", help="Write only the answer, warnings and errors: no notes, no progress."
)


def quiet() -> bool:
    """Whether --quiet is given."""
    return remembered(QUIET)


def say(text: str) -> None:
    """Write a line to stderr; an answer does not depend on whether that can be written."""
    with contextlib.suppress(OSError):
        click.echo(shown(text, sys.stderr), err=True, color=True)


def say_error(error: MbstabError) -> None:
    """Write an error to stderr."""
    from mbstab.report.messages import error_text

    say(error_text(error))


def note(text: str) -> None:
    """Write a line to stderr, unless --quiet is given."""
    if not quiet():
        say(text)


def with_file(what: str, path: Path) -> Text:
    """Return a line about a file; where there are colours the file is a link."""
    return joined([what, styled(visible(str(path), lines=False), "file")], " ")


def warn(warnings: tuple[str, ...] | list[str]) -> None:
    """Write warnings to stderr."""
    from mbstab.report.messages import message_text

    for text in warnings:
        say(message_text("warning", text))


def show(text: str) -> None:
    """Write text to stdout.

    Raises
    ------
    OutputError
        If stdout is closed or full.
    """
    try:
        click.echo(shown(text, sys.stdout), nl=False, color=True)
        sys.stdout.flush()
    except OSError as error:
        raise stdout_failure(error) from None


def stdout_failure(error: OSError) -> Exception:
    """Return a failure to write to stdout as an error that a user can act on; a closed pipe is returned unchanged."""
    # The rest of the buffer cannot be written either; do not try again at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return error
    reason = "it is closed" if error.errno == errno.EBADF else error.strerror
    return OutputError(f"the answer cannot be written to stdout: {reason}")


# --- files ----------------------------------------------------------------------------------------------------------


@dataclass
class Files:
    """The files of one call: those that are read, and those that are written, with their options."""

    read: list[Path] = field(default_factory=list)
    written: dict[Path, str] = field(default_factory=dict)

    def opened(self, path: Path) -> None:
        """Register a file when it is read; it must not be written as well, also where it holds no model."""
        self.read.append(path)

    def keep_apart(self) -> None:
        """Refuse to write a file that has been read.

        Raises
        ------
        UsageError
            If one is.
        """
        for goal, option in self.written.items():
            for known in self.read:
                if _is_same(goal, known):
                    raise UsageError(f"{option} would overwrite {known}, which is read\nhint: name another file")

    def claim(self, path: Path, option: str) -> None:
        """Register a file that is to be written.

        Raises
        ------
        UsageError
            If it has no directory, is one, a file of the same call or one that is write-protected, or its name contains
            invisible characters or is none to the system.
        """
        if visible(str(path), lines=False) != str(path):
            raise UsageError(f"{option} {str(path)!r}: the name contains characters that cannot be seen")
        try:
            if not path.parent.is_dir():
                raise UsageError(f"{path}: cannot be written: there is no directory {path.parent}")
            if path.is_dir():
                raise UsageError(f"{path}: cannot be written: it is a directory")
            with contextlib.suppress(FileNotFoundError):
                path.stat()
            goal = path.resolve()
            if goal.is_file() and not (goal.stat().st_mode & 0o222 and os.access(goal, os.W_OK)):
                raise UsageError(f"{path}: cannot be written: it is write-protected")
        except (OSError, RuntimeError) as error:  # the latter from a circle of links
            raise UsageError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}") from None
        if goal.is_file() or not goal.exists():  # devices take any number of answers
            other = self.written.get(goal, option)
            if other != option:
                raise UsageError(f"{path}: {other} and {option} name the same file")
        self.written[goal] = option
        self.keep_apart()


def _is_same(goal: Path, known: Path) -> bool:
    """Whether two names are those of one file, which is no device."""
    return goal.is_file() and known.exists() and goal.samefile(known)


def files() -> Files:
    """Return the files of the call that is being answered."""
    context = click.get_current_context(silent=True)
    found: Files = context.meta.setdefault("mbstab.files", Files()) if context is not None else Files()
    return found


def save(path: Path, write: Callable[[Path], object], option: str, content: bytes | None = None) -> None:
    """Write a file by a function that writes it completely or not at all, and print a note.

    Parameters
    ----------
    path : Path
    write : callable
        Writes the file, or raises `OSError`.
    option : str
        The option that requests it.
    content : bytes, optional
        The content, kept in a temporary file if there is no space for it at the path.

    Raises
    ------
    UsageError, OutputError
        If it cannot be written.
    """
    files().claim(path, option)
    try:
        write(path)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
    except OSError as error:
        kept = _rescued(content, path) if content is not None else ""
        where = f"; the content is kept in {kept}" if kept else ""
        raise OutputError(f"{path}: cannot be written: {error.strerror}{where}") from None
    note(with_file("wrote", path))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file completely or not at all; a device or a pipe is written to, not replaced."""
    if path.exists() and not path.is_file():
        path.write_bytes(content)
        return
    with whole_file(path) as stream:
        stream.write(content)


def _rescued(content: bytes, output: Path) -> str:
    """Return a temporary file with content that has no space elsewhere, or nothing if that fails, too."""
    import tempfile

    try:
        handle, name = tempfile.mkstemp(prefix=f"{output.stem[:50]}-", suffix=output.suffix)
    except OSError:
        return ""
    try:
        with open(handle, "wb") as stream:
            stream.write(content)
    except OSError:
        os.unlink(name)
        return ""
    return name


# --- answers --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Output:
    """Where an answer goes, and how it is written.

    Attributes
    ----------
    path : Path or None
        None: stdout.
    format : str
        A key of `SUFFIXES`.
    """

    path: Path | None = None
    format: str = "table"

    @classmethod
    def of(cls, path: Path | None, format_: str | None, formats: tuple[str, ...], unnamed: str = "") -> Output:
        """Read the options; the suffix selects the format unless it is given, and `unnamed` is a hint if none does.

        Raises
        ------
        UsageError
            If the suffix belongs to no format, a binary format has no file, or the file cannot be written.
        """
        path = None if path == Path("-") else path
        if path is not None:
            files().claim(path, "--output")
        format_ = _format_of(path, formats, unnamed) if format_ is None else format_
        suffix = "" if path is None else path.suffix.lower()
        told = {SUFFIXES[x] for x in SUFFIXES if x in formats or x != "yaml"}  # others may give YAML to a model file
        if suffix in told and suffix != SUFFIXES[format_]:
            raise UsageError(f"--output {path} and --format {format_} contradict each other\nhint: leave out --format")
        if path is None and format_ in BINARY:
            raise UsageError(f"--format {format_} is binary: name a file with --output")
        return cls(path, format_)

    def answer(self, answer: Any, model: Model, summary: bool = False, **options: Mapping[str, Any]) -> None:
        """Write an answer about a model; `options` are those of its writers, by format."""
        from mbstab.report.answers import bind_writers

        self.write(bind_writers(answer, model, **options), summary)

    def write(self, answer: Answer, summary: bool = False) -> None:
        """Write an answer to stdout or to the file, which is written completely or not at all.

        Parameters
        ----------
        answer : mapping
        summary : bool
            Whether the table is also shown if the data go to a file.
        """
        data = answer[self.format]()
        if self.path is None:
            assert isinstance(data, str)
            show(data)
            return
        content = data.encode("utf-8") if isinstance(data, str) else data
        try:
            save(self.path, lambda path: write_bytes(path, content), "--output", content)
        finally:
            if summary and self.format != "table":
                show(str(answer["table"]()))


def _format_of(path: Path | None, formats: tuple[str, ...], unnamed: str) -> str:
    if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
        return formats[0]
    known = {SUFFIXES[name]: name for name in formats}
    suffix = path.suffix.lower()
    if suffix in known:
        return known[suffix]
    what = f"the suffix {suffix} says no format of this command" if suffix else "no suffix says the format"
    hint = f"{', '.join(known)}, or --format"
    if suffix in PICTURES:
        hint += "; pictures are asked for by --plot"
    elif unnamed and not suffix:
        hint += f"; {unnamed}"
    raise UsageError(f"--output {path}: {what}\nhint: {hint}")


def output_options(*formats: str, unnamed: str = "") -> Callable[[F], F]:
    """Add --format, --output and --quiet to a command, which takes an `Output` as the keyword ``output``.

    `unnamed` is a further hint if --output has no suffix.
    """

    def decorated(command: F) -> F:
        @quiet_option
        @click.option(
            "--output",
            "-o",
            type=click.Path(path_type=Path),
            help="Write to this file instead of the terminal; its suffix says the format: "
            + ", ".join(SUFFIXES[name] for name in formats)
            + ".",
        )
        @click.option(
            "--format",
            "format_",
            type=Choice(formats),
            help=f"If not given, the suffix of --output decides, else {formats[0]}.",
        )
        @functools.wraps(command)
        def run(*arguments: Any, format_: str | None, output: Path | None, **options: Any) -> Any:
            if output is not None:  # a file is as wide as ever, whatever the terminal
                set_width(WIDTH)
            return command(*arguments, output=Output.of(output, format_, formats, unnamed), **options)

        return run  # type: ignore[return-value]

    return decorated


# --- pictures -------------------------------------------------------------------------------------------------------

SIZE = "mbstab.size"
"""Key in the context: the size of pictures, or none."""


def _remember_size(context: click.Context, _: click.Parameter, value: str | None) -> None:
    context.meta[SIZE] = value


size_option = click.option(
    "--size",
    type=Choice(tuple(SIZES)),
    expose_value=False,
    callback=_remember_size,
    help="Size of the pictures: a column (85 mm wide) or the width (170 mm) of a page, a slide (254 mm x 143 mm); "
    "page if not given. Moving pictures have 720 pixels across, with text and shape as in that size.",
)


def pictures_option(command: F) -> F:
    """Add --pictures and --size to a command, which takes the first one as the keyword ``place``."""
    place = click.option(
        "--pictures",
        "place",
        type=click.Path(path_type=Path),
        help="How the names of the pictures begin, with the suffix .png, .svg or .pdf; else beside the model or "
        "--output.",
    )
    return place(size_option(command))


def check_size(drawn: bool) -> None:
    """Refuse --size if nothing is drawn.

    Raises
    ------
    UsageError
        If it is given.
    """
    if not drawn and _size() is not None:
        raise UsageError("--size is that of pictures, and none is drawn\nhint: --plot draws them")


def _size() -> str | None:
    context = click.get_current_context(silent=True)
    return context.meta.get(SIZE) if context is not None else None


def asked_size() -> str:
    """Return the size of pictures that is asked for."""
    return _size() or "page"


PICTURE = "a picture"


def check_pictures(place: Path | None) -> None:
    """Refuse a wrong suffix in --pictures before anything is computed.

    Raises
    ------
    UsageError
        If pictures cannot have that suffix.
    """
    if place is not None and place.suffix and place.suffix not in PICTURES:
        hint = suggestion(place.suffix, PICTURES) or ", ".join(PICTURES)
        raise UsageError(f"--pictures {place}: no picture ends with {place.suffix}\nhint: {hint}")


def picture_stem(place: Path | None, output: Path | None, model: Path, name: str = "") -> tuple[Path, str]:
    """Return the beginning of the names of the pictures, and their suffix.

    Parameters
    ----------
    place, output : Path or None
        Values of --pictures and --output.
    model : Path
        The model file, beside which they are drawn otherwise; those of installed models and of stdin in the working
        directory.
    name : str
        Appended to the name of the model there.
    """
    from mbstab.model.library import STDIN, installed_models

    if place is not None:
        suffix = place.suffix if place.suffix in PICTURES else PICTURES[0]
        return (place.with_suffix("") if place.suffix in PICTURES else place), suffix
    if output is not None:
        return output.with_suffix(""), PICTURES[0]
    stem = "stdin" if str(model) == STDIN else model.stem
    name = f"{stem}-{name}" if name else stem
    own = str(model) != STDIN and model not in installed_models()
    return (model.with_name(name) if own else Path(name)), PICTURES[0]


def picture_paths(stem: Path, suffix: str, names: Iterable[str], animated: bool = False) -> dict[str, Path]:
    """Return the paths of pictures by name; those that cannot be written are refused before anything is computed."""
    paths = {name: stem.with_name(f"{stem.name}-{name}{suffix}") for name in names}
    check_size(bool(paths) or animated)
    for path in paths.values():
        files().claim(path, PICTURE)
    return paths


def save_picture(draw: Callable[[], Any], path: Path, option: str = PICTURE) -> None:
    """Draw a picture in the size that is asked for, and write it to a file.

    Raises
    ------
    UsageError, OutputError
        If it cannot be drawn or written.
    """
    from mbstab.report.pictures.drawing import save as save_figure

    with sized(asked_size()):
        figure = draw()
        save(path, lambda goal: save_figure(figure, goal), option)
