"""``mbstab eig``: eigenvalues and verdict."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbstab.analysis.linear.methods import DEFAULT, METHODS
from mbstab.cli.common import (
    failure_of,
    files_argument,
    force_option,
    load_model,
    plot_option,
    progress_bar,
    set_option,
)
from mbstab.cli.mistakes import Choice
from mbstab.cli.output import (
    Answer,
    Output,
    note,
    output_options,
    picture_paths,
    picture_stem,
    save_picture,
    warn,
)
from mbstab.errors import ExpectationError, MbstabError, NumericalError, SeveralErrors, UsageError, visible
from mbstab.model.words import REQUIRED
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.results import EigenResult
    from mbstab.api import Mechanism
    from mbstab.model.schema import Model

CERTIFIED_DIGITS = 50
PICTURES = ("spectrum", "modes", "sensitivity")
MOST_SHAPES = 8
"""Modes that are drawn; an animation shows any other."""


@click.command()
@files_argument
@set_option
@force_option
@click.option(
    "--method",
    type=Choice(tuple(METHODS)),
    default=DEFAULT,
    show_default=True,
    help="; ".join(f"{name}: {method.description}" for name, method in METHODS.items()) + ".",
)
@click.option(
    "--frozen",
    is_flag=True,
    help="Take the equations as they are at the reference time; for comparison, no stability verdict.",
)
@click.option(
    "--precision",
    type=int,
    metavar="DIGITS",
    help="Number of correct digits, 16 to 1000; parameters count with all decimals. With --certify: of the balls.",
)
@click.option(
    "--certify",
    is_flag=True,
    help="Enclose all eigenvalues with proven radii; a parameter may be an interval, such as omega=[5.6,10].",
)
@click.option(
    "--modes",
    "count",
    type=int,
    metavar="K",
    help="Compute K eigenvalues only, a conjugate pair as one, also of thousands of bodies: the slowest, or as --near "
    "or --rightmost says. The number right of the imaginary axis is counted as well.",
)
@click.option("--near", metavar="S", help="With --modes: those nearest to S in rad/s, such as 0.1, 20i or -1+5i.")
@click.option("--rightmost", is_flag=True, help="With --modes: those with the largest real parts.")
@click.option(
    "--verify",
    is_flag=True,
    help="Excite each mode of the nonlinear motion a little; compare growth rate and frequency with the eigenvalue. "
    "Exit with 3 if it contradicts.",
)
@click.option(
    "--shapes",
    is_flag=True,
    help="Print each mode coordinate by coordinate, with magnitude and phase, and its energies and powers, entry by "
    "entry; JSON holds the energies, too.",
)
@click.option(
    "--sensitivity",
    is_flag=True,
    help="Print the derivative of each eigenvalue by each parameter, the motion of the reference included, and the "
    "change per percent, what moves it most first; CSV holds these alone.",
)
@plot_option(
    *PICTURES,
    meaning="spectrum: the eigenvalues in the complex plane, with bounds, names, and lines of equal damping and "
    "frequency; modes: the shapes of the first ones; sensitivity, with --sensitivity: its bars",
)
@click.option(
    "--require",
    type=Choice(tuple(REQUIRED)),
    help="Exit with 3 unless at least this stable, if only up to symmetry: position, heading, speed. "
    "marginal: at least no disturbance grows in the linearized equations; linear: none grows exponentially there.",
)
@output_options("table", "json", "csv")
def eig(
    names: tuple[str, ...],
    settings: tuple[str, ...],
    method: str,
    frozen: bool,
    precision: int | None,
    certify: bool,
    count: int | None,
    near: str | None,
    rightmost: bool,
    verify: bool,
    shapes: bool,
    sensitivity: bool,
    pictures: tuple[str, ...],
    place: Path | None,
    require: str | None,
    output: Output,
) -> None:
    """Compute eigenvalues with error bounds, and a verdict.

    Several FILES are answered one after the other; the exit code is that of the worst.

    Example: mbstab eig pendulum.yaml --set L=0.5
    """
    _refuse(method, frozen, precision, certify, count, verify, output.format)
    shift = _read_shift(count, near, rightmost)
    if len(set(names)) < len(names):
        raise UsageError("a file is named twice")
    many_digits = precision is not None or certify
    _refuse_more(shapes, sensitivity, many_digits or verify, count is not None or method != DEFAULT, output.format)
    _refuse_pictures(pictures, many_digits, len(names) > 1, sensitivity, count is not None)
    paths: dict[str, Path] = {}

    def reply(mechanism: Mechanism) -> _Reply:
        if certify:
            return _answer_certified(mechanism, precision or CERTIFIED_DIGITS)
        if precision is not None:
            return _answer_precise(mechanism, frozen, precision)
        if count is not None:
            return _answer_modes(mechanism, mechanism.modes(count, shift, rightmost, shapes), shapes)
        if sensitivity:
            return _answer_sensitivities(mechanism, frozen)
        return _answer_verified(mechanism, frozen) if verify else _answer_plain(mechanism, method, frozen, shapes)

    replies: list[_Reply] = []
    failures: list[MbstabError] = []
    for name in names:
        try:
            mechanism = load_model(name, settings)
            paths = picture_paths(*picture_stem(place, output.path, Path(mechanism.model.name)), pictures)
            replies.append(reply(mechanism))
            failures += _failure(replies[-1], require, name if len(names) > 1 else "")
        except Exception as error:
            if len(names) == 1:
                raise
            failures.append(failure_of(name, error))
    if replies:
        _write(replies, len(names) > 1, output, paths)
    if failures:
        raise failures[0] if len(failures) == 1 else SeveralErrors(failures)


def _write(replies: list[_Reply], several: bool, output: Output, paths: Mapping[str, Path]) -> None:
    """Write the answers, and the pictures of a single one."""
    if several:
        output.write(_join(replies))
    else:
        output.answer(replies[0].answer, replies[0].model, False, **replies[0].options)
    for picture, path in paths.items():
        save_picture(replies[0].pictures[picture], path)


def _refuse(
    method: str, frozen: bool, precision: int | None, certify: bool, count: int | None, verify: bool, form: str
) -> None:
    """Refuse options that contradict each other."""
    if (precision is not None or certify) and method != DEFAULT:
        message = f"--precision and --certify compute by deflation, not with --method {method}"
        raise UsageError(f"{message}\nhint: leave out one of them")
    if verify and (precision is not None or certify or method != DEFAULT or form == "csv"):
        raise UsageError("--verify goes with none of --precision, --certify, --method and the format csv")
    if certify and (frozen or form == "csv"):
        raise UsageError("--certify goes with neither --frozen nor the format csv")
    if count is not None and (method != DEFAULT or certify or precision is not None or frozen or verify):
        message = "--modes goes with none of --method, --certify, --precision, --frozen and --verify"
        raise UsageError(f"{message}\nhint: leave out --modes for all eigenvalues")


def _refuse_more(shapes: bool, sensitivity: bool, other: bool, partial: bool, form: str) -> None:
    """Refuse details of the modes where the answer is another one, or one by another method."""
    if shapes and (other or form == "csv"):
        raise UsageError("--shapes goes with none of --precision, --certify, --verify and the format csv")
    if sensitivity and (other or partial or shapes):
        raise UsageError(
            "--sensitivity goes with none of --precision, --certify, --verify, --shapes, --modes, --method"
        )


def _refuse_pictures(
    pictures: tuple[str, ...], many_digits: bool, several: bool, sensitivity: bool, partial: bool
) -> None:
    """Refuse pictures of what cannot be drawn."""
    if "sensitivity" in pictures and not sensitivity:
        raise UsageError("--plot sensitivity draws what --sensitivity computes\nhint: give both")
    if "modes" in pictures and partial:
        raise UsageError(
            "--plot modes draws the first modes of all, --modes computes a part of them\nhint: leave out one of them"
        )
    if pictures and (many_digits or several):
        raise UsageError("--plot goes with a single file, and neither with --precision nor with --certify")


@dataclass(frozen=True)
class _Reply:
    """The answer about one model.

    Attributes
    ----------
    model : Model
    answer : object
    result : EigenResult, PreciseResult or Certificate
        What has the verdict.
    reasons : sequence of str
    options : mapping
        Options of its writers, by format.
    failure : MbstabError or None
        Error with which the command fails although there is an answer.
    pictures : mapping
        Functions that draw, by name.
    """

    model: Model
    answer: Any
    result: Any
    reasons: Sequence[str]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    failure: MbstabError | None = None
    pictures: Mapping[str, Callable[[], Any]] = field(default_factory=dict)

    @property
    def linear(self) -> bool:
        """Whether the linear statement says that no eigenvalue lies right of the imaginary axis, or may do so."""
        return self.result.spectrum is not None and self.result.spectrum.linear


def _join(replies: list[_Reply]) -> Answer:
    """Return the answers for several models by format; each names its model."""
    from mbstab.report.answers import content
    from mbstab.report.export import to_csv, to_json
    from mbstab.report.styles import joined

    def contents(form: str) -> list[Any]:
        return [content(x.answer, x.model, form, x.options.get(form)) for x in replies]

    def table() -> str:
        names = (visible(x.model.name, lines=False) for x in replies)
        titled = (f"{name}: " if x.model.title else f"{name}\n\n" for name, x in zip(names, replies, strict=True))
        return joined(joined(x, "") for x in zip(titled, contents("table"), strict=True))

    def csv() -> str:
        found = [(x.model.name, *rows) for x, rows in zip(replies, contents("csv"), strict=True)]
        heads = list(dict.fromkeys(head for _, own, _ in found for head in own))
        lines = [
            [name, *(dict(zip(own, row, strict=True)).get(head, "") for head in heads)]
            for name, own, rows in found
            for row in rows
        ]
        return to_csv(["model", *heads], lines)

    return {"table": table, "json": lambda: to_json(contents("json")), "csv": csv}


def _failure(reply: _Reply, require: str | None, name: str) -> list[MbstabError]:
    """Return the errors with which the command fails: no answer, or a weaker verdict than required."""
    about = f"{name}: " if name else ""
    if reply.failure is not None:
        return [type(reply.failure)(about + str(reply.failure))]
    linear = require == "linear" and reply.linear
    if require and not linear and reply.result.verdict not in REQUIRED[require]:
        reasons = "; ".join(reply.reasons)
        return [ExpectationError(f"{about}required: {require}, found: {reply.result.verdict}: {reasons}")]
    return []


def _answer_plain(mechanism: Mechanism, method: str, frozen: bool, shapes: bool) -> _Reply:
    """Answer in double precision."""
    with progress_bar("following the period") as progress:
        result = mechanism.eig(method, frozen, progress, shapes)
    return _answer_modes(mechanism, result, shapes)


def _answer_modes(mechanism: Mechanism, result: EigenResult, shapes: bool) -> _Reply:
    """Return an answer with or without the shapes of modes."""
    return _add_pictures(_reply(mechanism, result, result, table={"shapes": shapes}), mechanism, result)


def _add_pictures(reply: _Reply, mechanism: Mechanism, result: EigenResult) -> _Reply:
    """Return an answer with the pictures that can be drawn of it."""

    def spectrum() -> Any:
        from mbstab.report.pictures.spectrum import spectrum

        return spectrum(result, mechanism.model.title)

    def modes() -> Any:
        from mbstab.report.animation.stills import mode_stills

        listed = [e for e in result.eigenvalues if not e.exact and e.value.imag >= 0.0]
        shaped = {k: e for k, e in enumerate(listed, 1) if e.vector is not None}
        moving = {k: e for k, e in shaped.items() if result.moves_bodies(e)}
        if still := [str(k) for k in shaped if k not in moving]:
            one, many = f"mode {still[0]} is", f"modes {', '.join(still)} are"
            note(f"{many if len(still) > 1 else one} not drawn: states move, and no body")
        drawn = dict([*moving.items()][:MOST_SHAPES])
        swings = [mechanism.swing(number, 4) for number in drawn]
        return mode_stills(mechanism.system(), drawn, swings, mechanism.model.title)

    return replace(reply, pictures={"spectrum": spectrum, "modes": modes})


def _read_shift(count: int | None, near: str | None, rightmost: bool) -> complex:
    """Return the number near which a few eigenvalues are computed, 0 if none is given; refuse invalid options."""
    if count is None and (near is not None or rightmost):
        raise UsageError(f"{'--near' if near is not None else '--rightmost'} says which of a few\nhint: give --modes K")
    if near is not None and rightmost:
        raise UsageError("--near and --rightmost exclude each other\nhint: leave out one of them")
    if count is not None and count < 1:
        raise UsageError(f"--modes {count}: that is none\nhint: give a whole number from 1 on")
    try:
        shift = complex((near or "0").replace(" ", "").replace("i", "j"))
    except ValueError:
        shift = complex("nan")
    if not cmath.isfinite(shift):
        raise UsageError(f"--near {near}: that is not a number\nhint: in rad/s, such as 0.1, 20i or -1+5i")
    return shift


def _answer_precise(mechanism: Mechanism, frozen: bool, digits: int) -> _Reply:
    """Answer with many digits."""
    with progress_bar("more digits") as progress:
        result = mechanism.eig_precise(digits, frozen, progress)
    return _reply(mechanism, result, result)


def _reply(mechanism: Mechanism, answer: Any, result: Any, **options: Mapping[str, Any]) -> _Reply:
    """Write warnings, and return an answer with how it is written."""
    warn(result.warnings)
    return _Reply(mechanism.model, answer, result, result.reasons, options)


def _answer_verified(mechanism: Mechanism, frozen: bool) -> _Reply:
    """Answer with the eigenvalues, and what the nonlinear motion says about them."""
    with progress_bar("exciting modes") as progress:
        found = mechanism.verify(frozen, progress)
    reply = _add_pictures(_reply(mechanism, found, found.result), mechanism, found.result)
    if found.verdict != "contradicted":
        return reply
    return replace(reply, failure=ExpectationError(f"the nonlinear motion contradicts the eigenvalues: {found.reason}"))


def _answer_sensitivities(mechanism: Mechanism, frozen: bool) -> _Reply:
    """Answer with the eigenvalues and their derivatives by the parameters."""
    found = mechanism.sensitivities(frozen)

    def bars() -> Any:
        from mbstab.report.pictures.sensitivity_bars import sensitivity_bars

        return sensitivity_bars(found, mechanism.model.title)

    reply = _add_pictures(_reply(mechanism, found, found.result), mechanism, found.result)
    return replace(reply, pictures={**reply.pictures, "sensitivity": bars})


def _answer_certified(mechanism: Mechanism, digits: int) -> _Reply:
    """Answer with enclosures and the verdict, proven or under conditions; without one the command fails."""
    with progress_bar("dividing the interval") as progress:
        result = mechanism.certify(digits, progress)
    failure = None if result.decided else NumericalError("no verdict is proven; the answer says why")
    return _Reply(mechanism.model, result, result, [result.statement], failure=failure)
