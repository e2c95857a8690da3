"""``mbstab design``: values of parameters that are best for a goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from mbstab.cli import completion
from mbstab.cli.common import file_argument, force_option, load_model, parse_settings, progress_bar, set_option
from mbstab.cli.output import Output, note, output_options, warn
from mbstab.errors import ExpectationError, NumericalError

if TYPE_CHECKING:
    from mbstab.analysis.design.design import Design
    from mbstab.analysis.proof.certify import Certificate
    from mbstab.api import Mechanism

CERTIFIED_DIGITS = 50
INSIDE = 1e-3
"""A proof about a range leaves out this fraction of it at both ends, where an eigenvalue is zero."""


@click.command()
@file_argument
@click.option(
    "--vary",
    "vary",
    metavar="NAME=RANGE",
    multiple=True,
    required=True,
    shell_complete=completion.settings,
    help="A parameter that may change: NAME=FIRST..LAST, or NAME=5% about its present value. May be repeated.",
)
@click.option(
    "--goal",
    metavar="[decay|damping|range:NAME]",
    required=True,
    help="decay: the slowest disturbance decays as fast as possible; damping: the smallest damping ratio is as large "
    "as possible, where that of a real eigenvalue is 1 or -1; range:NAME: this parameter has the widest stable range "
    "within that of its sweep: block, or within range:NAME=FIRST..LAST.",
)
@click.option(
    "--over",
    metavar="NAME=RANGE",
    multiple=True,
    shell_complete=completion.settings,
    help="With decay and damping: what counts is the worst for all values of this parameter. May be repeated.",
)
@click.option(
    "--at-least",
    "least",
    type=float,
    metavar="VALUE",
    help="Stop when the goal has this value (1/s, a ratio, or a width in SI); exit with 3 if it is not reached.",
)
@click.option("--steps", type=click.IntRange(1, 100_000), default=40, show_default=True, help="Steps at most.")
@click.option(
    "--certify",
    is_flag=True,
    help="Prove the verdict about the result: over the range of the goal but for its ends, or of a single --over; "
    "otherwise, or if that is not proven, for the worst values.",
)
@set_option
@force_option
@output_options("table", "json", "yaml")
def design(
    file: str,
    vary: tuple[str, ...],
    goal: str,
    over: tuple[str, ...],
    least: float | None,
    steps: int,
    certify: bool,
    settings: tuple[str, ...],
    output: Output,
) -> None:
    """Find values of parameters that meet a goal best.

    The search follows exact derivatives from the values of the file to a local optimum: the best that was found, not
    the best that exists. Ctrl-C ends it with the best so far. As yaml it writes the model file with the new values.

    Example, which widens the range of stable speeds of a bicycle: mbstab design whipple_bicycle.yaml --goal range:v
    --vary w=5% --vary c=5% --vary tilt=5% --vary x_H=5% --vary z_H=5%
    """
    mechanism = load_model(file, settings)
    ranges, box = (
        parse_settings(given, option, "RANGE", "0.9..1.1") for given, option in ((vary, "--vary"), (over, "--over"))
    )
    with progress_bar("designing", steps) as progress:
        found = mechanism.design(ranges, goal, progress, over=box, least=least, steps=steps)
    from mbstab.analysis.design.search import STOPPED

    model = mechanism.model
    warn(found.result.warnings)
    proofs = _proofs(mechanism, found) if certify and found.ended != STOPPED else []
    with_proofs = {"proofs": proofs}
    output.answer(found, model, True, table=with_proofs, json=with_proofs)
    if output.format == "yaml" and model.expect:
        note("its expect: entries are still those of the old values")
    if found.ended == STOPPED:
        raise NumericalError("interrupted; the answer is the best that was found until then")
    if proofs and not any(proof.decided for proof in proofs):
        raise NumericalError("no verdict is proven; the answer says why")
    if least is not None and not found.reached:
        raise ExpectationError(f"at least {least:g} was asked for, {found.best:.6g} is the best that was found")


def _proofs(mechanism: Mechanism, found: Design) -> list[Certificate]:
    """Return what is proven about a design: over a range; if nothing is, at the worst values."""
    from mbstab.analysis.design.design import settings

    model, task = mechanism.model, found.task
    intervals = {task.parameter: found.interval} if found.interval is not None else dict(task.over)
    places = [settings(model, found.worst)]
    if len(intervals) == 1:
        ((name, ends),) = intervals.items()
        inside = INSIDE * (ends[1] - ends[0]) if task.parameter else 0.0
        low, high = (settings(model, {name: x})[name] for x in (ends[0] + inside, ends[1] - inside))
        places.insert(0, {name: f"[{low}, {high}]"})
    proofs: list[Certificate] = []
    for place in places:
        if not any(proof.decided for proof in proofs):
            with progress_bar("proving") as progress:
                proofs.append(mechanism.certify(CERTIFIED_DIGITS, progress, **settings(model, found.values), **place))
    return proofs
