"""The command ``mbstab``."""

from __future__ import annotations

import atexit
import contextlib
import errno
import gc
import io
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import click

from mbstab.cli import commands
from mbstab.cli.common import one_thread_by_default
from mbstab.cli.mistakes import Choice, call_error
from mbstab.cli.output import say, say_error, show, stdout_failure
from mbstab.cli.terminal import COLOURS, WHEN, When
from mbstab.errors import MbstabError, OutputError, UsageError, suggestion
from mbstab.report import set_width

STREAM = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Errors of writing to a stream."""


COMMANDS = tuple(sorted(path.stem for path in Path(commands.__file__).parent.glob("[!_]*.py")))
"""Each is the function of the name of its module in `mbstab.cli.commands`, imported at first use."""


GROUPS = {
    "Ask": ("eig", "equilibrium", "energy", "simulate", "response", "linearize"),
    "Explore": ("sweep", "design"),
    "Check": ("check", "test", "compare"),
    "Files": ("new", "models", "schema", "manual"),
}
"""The commands as ``--help`` lists them."""

SUMMARY = 60
"""Characters of the first sentence about a command at most."""

OTHERWISE = {
    "campbell": "mbstab sweep FILE --param SPIN --plot campbell draws a Campbell diagram",
    "chart": "mbstab sweep FILE with two --param draws a stability chart",
    "locus": "mbstab sweep FILE --param NAME --plot locus draws a root locus",
    "bode": "mbstab response FILE --plot bode draws it",
    "nyquist": "mbstab response FILE --plot nyquist draws it",
    "margins": "mbstab response FILE prints them",
    "step": "mbstab response FILE --step T",
    "unbalance": "mbstab response FILE --unbalance POINT --speed PARAMETER",
    "verify": "mbstab eig FILE --verify",
    "certify": "mbstab eig FILE --certify",
    "sensitivity": "mbstab eig FILE --sensitivity",
    "animate": "mbstab simulate FILE --animate FILE.gif",
}
"""What asks for an answer that others name as a command."""


class _Group(click.Group):
    """Turns the errors of the library into messages with their exit codes; other errors stay visible."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the summaries of the commands, in groups."""
        wide = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            commands = [(name, self.get_command(ctx, name)) for name in names]
            rows = [(f"{name:{wide}}", command.get_short_help_str(SUMMARY)) for name, command in commands if command]
            with formatter.section(title):
                formatter.write_dl(rows)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"mbstab.cli.commands.{cmd_name}"), cmd_name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the requested command; an unknown one raises an error with a hint."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            hint = OTHERWISE.get(args[0], "") or suggestion(args[0], COMMANDS) if args else ""
            raise click.UsageError(error.message + (f"\nhint: {hint}" if hint else ""), ctx) from None

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the options of all commands; --color may also stand behind the command."""
        end = args.index("--") if "--" in args else len(args)
        places: list[int] = []
        for k, word in enumerate(args[:end]):
            if word.startswith("--color="):
                places.append(k)
            elif word == "--color" and args[k + 1 : k + 2] and args[k + 1] in COLOURS:
                places += [k, k + 1]
        moved = [args[k] for k in places]
        rest = [word for k, word in enumerate(args) if k not in places]
        return super().parse_args(ctx, moved + rest)

    def make_context(self, *arguments: Any, **options: Any) -> click.Context:
        """Return the context of a call; the answer to ``--help`` is written on the way."""
        with _into_pipe():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: click.Context) -> Any:
        with _into_pipe():
            try:
                return super().invoke(ctx)
            except MbstabError as error:
                say_error(error)
                ctx.exit(error.exit_code)

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run the command and end the process with its exit code."""
        options["standalone_mode"] = False
        WHEN.set("auto")
        with _stoppable() as received, _rarely_collected():
            code = _exit_code(lambda: super(_Group, self).main(*arguments, **options))
        sys.exit(STOPPED + received[0] if code and received else code)


STOPPED = 128
"""Exit code of a command that a signal has stopped, less the number of the signal, as shells have it."""


UNREAD = STOPPED + 13
"""Exit code of a command whose reader, such as ``head``, has closed the pipe (SIGPIPE): what it did not write tells
nothing."""


@contextlib.contextmanager
def _into_pipe() -> Iterator[None]:
    """End quietly if the reader has closed the pipe."""
    try:
        yield
    except BrokenPipeError:
        raise click.exceptions.Exit(UNREAD) from None


def _exit_code(run: Callable[[], Any]) -> int:
    """Return the exit code of a call, also of one whose reader has closed a pipe."""
    try:
        return _answered(run)
    except BrokenPipeError:
        return UNREAD


def _answered(run: Callable[[], Any]) -> int:
    """Return the exit code of a call; errors of the command line or the machine go to stderr."""
    # What is closed is opened to nothing, so that no file gets its number: answers cannot be written, messages vanish.
    if sys.stdin is None:
        os.open(os.devnull, os.O_RDONLY)
    if sys.stdout is None:
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_RDONLY), "w", encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without these characters still gets the answer
            stream.reconfigure(errors="backslashreplace")
    if isinstance(sys.stdout, io.TextIOWrapper) and isinstance(raw := sys.stdout.buffer, io.RawIOBase):
        # Without a buffer (PYTHONUNBUFFERED) a stream silently loses what a full disk does not take.
        whole = io.BufferedWriter(raw)
        sys.stdout = io.TextIOWrapper(whole, sys.stdout.encoding, sys.stdout.errors, line_buffering=True)
    try:
        try:
            code = run()
            sys.stdout.flush()
            return code or 0
        except OSError as error:  # from --help, and from the rest of the buffer
            if error.filename is not None or error.errno not in STREAM:
                raise
            raise stdout_failure(error) from None
    except click.ClickException as error:
        say_error(UsageError(call_error(error)))
        return error.exit_code
    except click.Abort:
        say("stopped")
    except OutputError as error:
        say_error(error)
    except MemoryError as error:
        text = f"there is not enough memory{f': {error}' if str(error) else ''}"
        say_error(OutputError(f"{text}\nhint: a smaller model, or fewer points"))
    return 1


YOUNG = 100_000
"""Objects after which cycles are looked for: most objects that a short command makes are its code."""


@contextlib.contextmanager
def _rarely_collected() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(YOUNG, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a command: Ctrl-C, a request to terminate, a terminal that is closed."""


@contextlib.contextmanager
def _stoppable() -> Iterator[list[int]]:
    """Let the signals that end a command stop it in order: no half file and no process is left.

    Yields the list that the numbers of their signals are appended to. A signal that is ignored stays so.
    """
    received: list[int] = []

    def stop(number: int, frame: Any) -> None:
        received.append(number)
        raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()  # elsewhere signals cannot be handled
    ending = [signal.Signals[name] for name in ENDING if name in signal.Signals.__members__]
    before = {number: signal.getsignal(number) for number in ending if main}
    handled = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    try:
        for number in handled:
            signal.signal(number, stop)
        yield received
    finally:
        for number in handled:
            signal.signal(number, before[number])


def _version(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from importlib.metadata import version

        show(f"mbstab {version('mbstab')}\n")
        ctx.exit()


def _colour(ctx: click.Context, _: click.Parameter, value: When | None) -> None:
    if value is not None:
        WHEN.set(value)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--color",
    type=Choice(COLOURS),
    expose_value=False,
    is_eager=True,
    callback=_colour,
    help="Whether answers and messages have colours; auto, if not given: on a terminal, or as NO_COLOR and FORCE_COLOR "
    "say. May stand behind the command, too.",
)
@click.option("--version", is_flag=True, expose_value=False, is_eager=True, callback=_version, help="Show the version.")
def main() -> None:
    """Tell whether a motion of a constrained mechanical system is stable.

    FILE is a model file (YAML), or - for stdin; a name that is not a file is looked up among the example models.
    Answers go to the terminal or to --output, whose suffix says the format; messages go to stderr. Exit codes:
    0 answered, 1 the computation failed, 2 the file or the command line is wrong, 3 an expectation did not hold or
    --verify contradicts, 130 stopped by Ctrl-C, 143 by a request to terminate (SIGTERM), 129 by the end of the terminal
    (SIGHUP), 141 the reader of the answer, such as head, has closed the pipe.
    """
    one_thread_by_default()
    if sys.stdout.isatty():
        set_width(shutil.get_terminal_size().columns)


ROOM = 2**16
"""Words that the first function of a command asks for in CPython's stack of frames, so that all others fit behind it.

The stack consists of pieces of 16 KiB, or larger where a frame needs it, each taken from the system and given back with
its first frame: calls across the end of a piece, such as imports within imports, do so thousands of times.
"""


def _command() -> None:
    main(prog_name="mbstab")


def program() -> None:
    """Run the command as a process of its own, which ends without taking itself apart object by object.

    That would take as long as many a model, and so would a last look for cycles. What is registered for the end is run
    before; where other threads run, or the process is traced or profiled, it ends as others do.
    """
    gc.set_threshold(YOUNG, *gc.get_threshold()[1:])
    command = FunctionType(_command.__code__.replace(co_stacksize=ROOM), globals())
    try:
        command()
    except SystemExit as stop:
        if threading.active_count() > 1 or sys.gettrace() is not None or sys.getprofile() is not None:
            raise
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(stop.code if isinstance(stop.code, int) else 0)
