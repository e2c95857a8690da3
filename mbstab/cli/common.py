"""What the commands share: options, finding the model, writing the answer."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mbstab.errors import UsageError

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


def parse_settings(settings: tuple[str, ...]) -> dict[str, str]:
    """Return ``--set`` options as a dictionary.

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
            raise UsageError(f"--set {setting}: write NAME=VALUE")
        if name in found:
            raise UsageError(f"--set {name} is given twice")
        found[name] = value.strip()
    return found


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


def warn(warnings: tuple[str, ...] | list[str]) -> None:
    """Write warnings to stderr."""
    for text in warnings:
        note(f"warning: {text}")


def write(data: str | bytes, output: Path | None) -> None:
    """Write an answer to stdout or to a file, which appears whole or not at all.

    Raises
    ------
    UsageError
        If the file cannot be written, or the answer is binary and has no file.
    """
    if output is None:
        if isinstance(data, bytes):
            raise UsageError("this format is binary: name a file with --output")
        click.echo(data, nl=False)
        return
    text = data.encode("utf-8") if isinstance(data, str) else data
    try:
        handle, temporary = tempfile.mkstemp(dir=output.parent, prefix=f".{output.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(text)
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(temporary, 0o666 & ~mask)
            os.replace(temporary, output)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise UsageError(f"{output}: cannot be written: {error.strerror}") from None
    note(f"wrote {output}")


def one_thread_by_default() -> None:
    """Keep the linear algebra library to one thread unless the user chose otherwise.

    Matrices of one mechanism are small: starting threads costs more than they save.
    """
    if "numpy" not in sys.modules:
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(name, "1")
