"""What the commands share: options, finding the model, writing the answer."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from mbstab.errors import OutputError, UsageError
from mbstab.report.files import whole_file

if TYPE_CHECKING:
    from mbstab.api import Mechanism

F = TypeVar("F", bound=Callable[..., Any])

file_argument = click.argument("file", metavar="FILE")

set_option = click.option(
    "--set",
    "settings",
    metavar="NAME=VALUE",
    multiple=True,
    help="Override a parameter; VALUE is a number in the parameter's unit or an expression. May be repeated.",
)

output_option = click.option(
    "--output",
    "-o",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write to this file instead of the terminal.",
)

SUFFIXES = (".png", ".svg", ".pdf")
"""Of pictures; the first is the default."""

pictures_option = click.option(
    "--pictures",
    "place",
    type=click.Path(path_type=Path),
    help="How the names of the pictures begin, with the suffix .png, .svg or .pdf; else beside the model or --output.",
)


def format_option(*formats: str) -> Callable[[F], F]:
    """Return the option that chooses among output formats; the first is the default."""
    return click.option(
        "--format", "format_", type=click.Choice(formats), default=formats[0], show_default=True, help="Output format."
    )


def load_model(file: str) -> Mechanism:
    """Load a model file or an installed example; stderr says which example."""
    from mbstab.api import Mechanism
    from mbstab.model.library import find_model
    from mbstab.model.reader import read_model

    found = find_model(file)
    if found.installed:
        note(f"using the example model {found.path}")
    return Mechanism(read_model(found.path))


def parse_settings(settings: tuple[str, ...], option: str = "--set") -> dict[str, str]:
    """Return options such as ``--set`` as a dictionary.

    Raises
    ------
    UsageError
        If one has no ``=`` or a name is set twice.
    """
    found: dict[str, str] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        name = name.strip()
        if not equals or not name or not value.strip():
            raise UsageError(f"{option} {setting}: write NAME=VALUE")
        if name in found:
            raise UsageError(f"{option} {name} is given twice")
        found[name] = value.strip()
    return found


def refuse_given(names: tuple[str, ...], where: str) -> None:
    """Refuse options that would be passed over.

    Parameters
    ----------
    names : tuple of str
        Parameters of the command that has been called.
    where : str
        What makes them pointless, such as ``with --step``.

    Raises
    ------
    UsageError
        If one of them is on the command line.
    """
    context = click.get_current_context()
    given = [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]
    if given:
        listed = ", ".join(given)
        raise UsageError(
            f"{listed} {'has' if len(given) == 1 else 'have'} no effect {where}\n"
            f"hint: leave {'it' if len(given) == 1 else 'them'} out"
        )


def note(text: str) -> None:
    """Write a line to stderr."""
    click.echo(text, err=True)


def tracked(items: list[Any], label: str) -> Iterator[Any]:
    """Yield the items, with a progress bar on stderr when it is a terminal."""
    if not sys.stderr.isatty():
        yield from items
        return
    with click.progressbar(items, label=label, file=sys.stderr) as bar:
        yield from bar


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float], None]]:
    """Give a function of the part that is done, from 0 to 1, which draws a bar on stderr when it is a terminal."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    bar: Any = None

    def show_part(done: float) -> None:
        nonlocal bar
        if bar is None:  # not before there is something to wait for
            bar = click.progressbar(length=1000, label=label, file=sys.stderr).__enter__()
        bar.update(max(0, round(1000 * done) - bar.pos))

    try:
        yield show_part
    finally:
        if bar is not None:
            bar.__exit__(None, None, None)


def warn(warnings: tuple[str, ...] | list[str]) -> None:
    """Write warnings to stderr."""
    for text in warnings:
        note(f"warning: {text}")


def write(data: str | bytes, output: Path | None, model: str = "") -> None:
    """Write an answer to stdout or to a file, which appears whole or not at all.

    Parameters
    ----------
    data : str or bytes
    output : Path or None
        None: stdout.
    model : str
        Name of the model file, which is never overwritten.

    Raises
    ------
    UsageError
        If the answer is binary and has no file, or would overwrite the model.
    OutputError
        If it cannot be written.
    """
    if output is None:
        if isinstance(data, bytes):
            raise UsageError("this format is binary: name a file with --output")
        show(data)
        return
    content = data.encode("utf-8") if isinstance(data, str) else data
    try:
        if model and output.exists() and os.path.exists(model) and os.path.samefile(output, model):
            raise UsageError(f"--output {output} would overwrite the model file")
        if output.exists() and not output.is_file():  # a device or a pipe is written to, not replaced
            output.write_bytes(content)
        else:
            with whole_file(output) as stream:
                stream.write(content)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        raise UsageError(f"{output}: cannot be written: {error.strerror}") from None
    except OSError as error:
        kept = _rescued(content, output)
        where = f"; what was to be written is in {kept}" if kept else ""
        raise OutputError(f"{output}: cannot be written: {error.strerror}{where}") from None
    note(f"wrote {output}")


def _rescued(content: bytes, output: Path) -> str:
    """Return a temporary file that takes what has no space elsewhere, or nothing if there is none for it either."""
    import tempfile

    try:
        handle, name = tempfile.mkstemp(prefix=f"{output.stem}-", suffix=output.suffix)
    except OSError:
        return ""
    try:
        with open(handle, "wb") as stream:
            stream.write(content)
    except OSError:
        os.unlink(name)
        return ""
    return name


def check_output(output: Path | None) -> None:
    """Refuse a file in a directory that does not exist before anything is computed.

    Raises
    ------
    UsageError
        If there is no such directory, or the file is one.
    """
    if output is None:
        return
    if not output.parent.is_dir():
        raise UsageError(f"{output}: cannot be written: there is no directory {output.parent}")
    if output.is_dir():
        raise UsageError(f"{output}: cannot be written: it is a directory")


def check_pictures(place: Path | None) -> None:
    """Refuse a wrong suffix in --pictures before anything is computed.

    Raises
    ------
    UsageError
        If pictures cannot end like that.
    """
    if place is not None and place.suffix and place.suffix not in SUFFIXES:
        raise UsageError(f"--pictures {place}: pictures are {', '.join(SUFFIXES)}")


def picture_stem(place: Path | None, output: Path | None, model: Path, name: str = "") -> tuple[Path, str]:
    """Return how the names of the pictures begin, and their suffix.

    Parameters
    ----------
    place, output : Path or None
        What --pictures and --output say.
    model : Path
        The model file, beside which they are drawn otherwise; those of installed models in the working directory.
    name : str
        Follows the name of the model there.
    """
    from mbstab.model.library import installed_models

    if place is not None:
        suffix = place.suffix if place.suffix in SUFFIXES else SUFFIXES[0]
        return (place.with_suffix("") if place.suffix in SUFFIXES else place), suffix
    if output is not None:
        return output.with_suffix(""), SUFFIXES[0]
    name = f"{model.stem}-{name}" if name else model.stem
    return (Path(name) if model in installed_models() else model.with_name(name)), SUFFIXES[0]


def save_picture(figure: Any, path: Path) -> None:
    """Draw a picture to a file.

    Raises
    ------
    UsageError, OutputError
        If it cannot be written.
    """
    from mbstab.report import plots

    try:
        plots.save(figure, path)
    except (FileNotFoundError, NotADirectoryError, PermissionError) as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    note(f"wrote {path}")


def show(text: str, end: str = "") -> None:
    """Write text to stdout.

    Raises
    ------
    OutputError
        If stdout is closed or full.
    """
    if sys.stdout is None:
        raise OutputError("the answer cannot be written: stdout is closed")
    try:
        click.echo(text + end, nl=False)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        # What is left in the buffer cannot be written either; do not try again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise OutputError(f"the answer cannot be written to stdout: {error.strerror}") from None


def one_thread_by_default() -> None:
    """Keep the linear algebra library to one thread unless the user chose otherwise.

    Matrices of one mechanism are small: starting threads costs more than they save.
    """
    if "numpy" not in sys.modules:
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(name, "1")
