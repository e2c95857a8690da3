"""Common parts of the commands: options, finding the model, progress."""

from __future__ import annotations

import contextlib
import functools
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from mbstab.cli import completion
from mbstab.cli.mistakes import Choice
from mbstab.cli.output import (
    PICTURES,
    check_pictures,
    check_size,
    files,
    note,
    pictures_option,
    quiet,
    remembered,
    remembered_flag,
    with_file,
)
from mbstab.cli.terminal import draws
from mbstab.errors import MbstabError, UnforeseenError, UsageError

if TYPE_CHECKING:
    from mbstab.api import Mechanism

F = TypeVar("F", bound=Callable[..., Any])


def model_argument(name: str, metavar: str | None = None, **options: Any) -> Callable[[F], F]:
    """Return the argument that names a model file or an example."""
    return click.argument(name, metavar=metavar, shell_complete=completion.model_files, **options)


file_argument = model_argument("file", "FILE")
files_argument = model_argument("names", "FILES...", nargs=-1, required=True)

set_option = click.option(
    "--set",
    "settings",
    metavar="NAME=VALUE",
    multiple=True,
    shell_complete=completion.settings,
    help="Override a parameter; VALUE is a number in the parameter's unit or an expression. May be repeated.",
)

_FORCE = "mbstab.force"

force_option = remembered_flag(
    _FORCE, "--force", help="Go on with scenes so large that in floats they take more than 1 GB of memory or 10 s."
)
"""Handled by `load_model`."""


def model_command(function: Callable[..., Any]) -> click.Command:
    """Make a command of a function that asks about one model: FILE, --set and --force come first."""
    return click.command()(file_argument(set_option(force_option(function))))


def load_model(file: str, settings: tuple[str, ...] = ()) -> Mechanism:
    """Load a model file, an installed example (named on stderr), or the model on standard input.

    Its parameters have the values of ``--set``.
    """
    return _loaded(file).at(**parse_settings(settings))


def _loaded(file: str) -> Mechanism:
    from mbstab.api import Mechanism
    from mbstab.model.library import STDIN, find_model
    from mbstab.model.reader import read_model, read_model_text
    from mbstab.model.yamlfile import read_limited

    opened = files().opened
    if file == "-":
        if sys.stdin is None:
            raise UsageError("stdin cannot be read: it is closed\nhint: give the name of a file")
        opened(Path("/dev/stdin"))  # may be a file
        model = read_model_text(read_limited(sys.stdin.buffer, STDIN), STDIN, opened=opened)
    else:
        found = find_model(file)
        if found.installed:
            note(with_file("using the example model", found.path))
        model = read_model(found.path, opened)
    files().keep_apart()
    return Mechanism(model, remembered(_FORCE))


def failure_of(name: str, error: Exception) -> MbstabError:
    """Return why one of several files has no answer, so that the others get theirs.

    Raises
    ------
    OSError, MemoryError
        If the others would fail alike.
    """
    if isinstance(error, (OSError, MemoryError)):
        raise error
    return error if isinstance(error, MbstabError) else UnforeseenError(name, error)


def parse_settings(
    settings: tuple[str, ...], option: str = "--set", what: str = "VALUE", example: str = "0.5"
) -> dict[str, str]:
    """Return options such as ``--set`` as a dictionary; `what` messages call the values, and an `example` of one.

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
            raise UsageError(f"{option} {setting}: write NAME={what}, such as {option} {name or 'NAME'}={example}")
        if name in found:
            raise UsageError(f"{option} {name} is given twice")
        found[name] = value.strip()
    return found


def parse_ranges(texts: tuple[str, ...], option: str) -> dict[str, str | None]:
    """Return options such as ``--param d=0.1..10`` or ``--param d`` as names with ranges, None where there is none.

    Raises
    ------
    UsageError
        If a value is no range, or a name is given twice.
    """
    found: dict[str, str | None] = {}
    for text in texts:
        name, equals, span = (part.strip() for part in text.partition("="))
        if equals and not (re.fullmatch(r".*[^.\s].*\.\..*[^.\s].*", span) or span.endswith("%")):
            one = f"; one value: mbstab eig --set {text}" if span and ".." not in span else ""
            raise UsageError(f"{option} {text}: {span or 'nothing'!r} is no range\nhint: {name}=FIRST..LAST{one}")
        if name in found:
            raise UsageError(f"{option} {name} is given twice")
        found[name] = span or None
    return found


def refuse_given(names: tuple[str, ...], where: str) -> None:
    """Refuse options that would be ignored.

    Parameters
    ----------
    names : tuple of str
        Parameters of the command that has been called.
    where : str
        Why they have no effect, such as ``with --step``.

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


def tracked(items: list[Any], label: str) -> Iterator[Any]:
    """Yield the items, with a progress bar on stderr when it is a terminal."""
    with progress_bar(label, len(items)) as show:
        for number, item in enumerate(items, 1):
            yield item
            show(number / len(items))


@contextlib.contextmanager
def progress_bar(label: str, count: int = 0) -> Iterator[Callable[[float], None]]:
    """Yield a function of the fraction done, from 0 to 1, which draws a bar on stderr if it is a terminal.

    Beside it stands how many of `count` parts are done, or the percentage, and the time left: ``37/401, 12 s left``.
    """
    if quiet() or not draws(sys.stderr):
        yield lambda done: None
        return
    bar: Any = None

    def state(_: object) -> str:
        done = bar.pos / bar.length
        part = f"{round(done * count)}/{count}" if count else f"{done:.0%}"
        return f"{part}, {duration(bar.eta)} left" if bar.eta_known and not bar.finished else part

    def show_part(done: float) -> None:
        nonlocal bar
        if bar is None:  # not before the first call
            bar = click.progressbar(
                length=PARTS, label=label, show_percent=False, show_eta=False, item_show_func=state, file=sys.stderr
            )
            bar.__enter__()
        bar.update(max(0, round(PARTS * done) - bar.pos))

    try:
        yield show_part
    finally:
        if bar is not None:
            bar.__exit__(None, None, None)


PARTS = 10_000
"""Steps of a progress bar."""


def duration(seconds: float) -> str:
    """Return a time in seconds, or in minutes or hours where it is long."""
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.{seconds < 10.0 * size:d}f} {unit}"
    return f"{seconds:.0f} s"


def one_thread_by_default() -> None:
    """Restrict the linear algebra library to one thread unless the user chose otherwise.

    Matrices of one mechanism are small: threads cost more time than they save.
    """
    if "numpy" not in sys.modules:
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(name, "1")


def listed(one: Any = click.STRING) -> Callable[[click.Context, click.Parameter, tuple[str, ...]], tuple[Any, ...]]:
    """Return a parser for the values of an option that may be repeated, or given as a list with commas, or both."""

    def callback(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> tuple[Any, ...]:
        # Commas within parentheses belong to an expression.
        parts = [part.strip() for text in given for part in re.split(r",(?![^(]*\))", text)]
        return tuple(one.convert(part, option, context) for part in parts)

    return callback


def plot_option(*names: str, meaning: str) -> Callable[[F], F]:
    """Add --plot, --pictures and --size to a command, which takes the first two as ``pictures`` and ``place``.

    The names are those of the pictures, `meaning` says in a help text what they show. With ``none`` among them the
    command draws also where nothing is asked for.
    """
    always = "none" in names

    def read(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> tuple[Any, ...]:
        for text in given:
            if Path(text).suffix in PICTURES:
                hint = f"hint: --plot {names[0]} --pictures {text}"
                raise click.BadParameter(f"{text!r} is no picture but where one goes\n{hint}", context, option)
        return listed(Choice(names))(context, option, given)

    def decorated(command: F) -> F:
        @functools.wraps(command)
        def run(*arguments: Any, pictures: tuple[str, ...], place: Path | None, **options: Any) -> Any:
            check_pictures(place)
            if not always:
                check_size(bool(pictures))
                if place is not None and not pictures:
                    raise UsageError("--pictures goes with --plot")
            elif "none" in pictures and (len(pictures) > 1 or place is not None):
                raise UsageError("--plot none goes with no other picture")
            return command(*arguments, pictures=pictures, place=place, **options)

        option = click.option(
            "--plot",
            "pictures",
            callback=read,
            metavar=f"[{'|'.join(names)}]",
            multiple=True,
            help=f"Pictures to draw, separated by commas or repeated; --pictures says where to. {meaning}.",
        )
        return option(pictures_option(run))  # type: ignore[return-value]

    return decorated
