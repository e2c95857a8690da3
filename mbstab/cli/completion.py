"""Shell completion: model files, parameters, quantities to plot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbstab.errors import MbstabError

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from mbstab.model.schema import Model


def _item(value: str, **options: Any) -> CompletionItem:
    from click.shell_completion import CompletionItem  # where something is completed only

    return CompletionItem(value, **options)


def model_files(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the example models, model files and folders that begin with the given text."""
    from mbstab.model.library import SUFFIX, installed_models

    names = [path.name for path in installed_models() if path.name.startswith(incomplete)]
    folder, _, begin = incomplete.rpartition("/")
    try:
        here = sorted(Path(f"{folder}/" if folder or incomplete.startswith("/") else ".").iterdir())
    except OSError:
        here = []
    beside = [
        (f"{folder}/" if "/" in incomplete else "") + path.name + ("/" if path.is_dir() else "")
        for path in here
        if path.name.startswith(begin) and (path.suffix == SUFFIX or path.is_dir()) and path.name[0] not in ".\n"
    ]
    # The shell itself completes files only if nothing else is offered.
    found = [_item(name) for name in dict.fromkeys([*names, *beside])]
    return found or [_item(incomplete, type="file")]


def _model(context: click.Context) -> Model | None:
    """Return the model that the command line names so far, or None."""
    from mbstab.model.library import find_model
    from mbstab.model.reader import read_model

    # An incomplete command line leaves arguments unread.
    given = [context.params.get("file"), *(context.params.get("names") or ()), *context.args]
    names = [name for name in given if name]
    try:
        return read_model(find_model(names[0]).path) if names else None
    except MbstabError:
        return None


def settings(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return parameters as ``NAME=``."""
    model = _model(context)
    names = [] if model is None else model.parameters
    return [_item(f"{name}=", nospace=True) for name in names if name.startswith(incomplete)]


def parameters(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return parameters with their descriptions."""
    model = _model(context)
    found = {} if model is None else model.parameters
    return [_item(name, help=x.description) for name, x in found.items() if name.startswith(incomplete)]


def quantities(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the quantities that a simulation can plot."""
    from mbstab.analysis.reference.efforts import motion_name
    from mbstab.report.pictures.motion_plots import GROUPS, WORDS

    model = _model(context)
    names = [] if model is None else model.coordinates()
    known = [*names, *(f"rate({name})" for name in names), *WORDS, *GROUPS, *(f"phase:{name}" for name in names)]
    if model is not None:
        joints, forces = model.entries.get("joints", {}), model.entries.get("forces", {})
        acting = (*forces.items(), *model.entries.get("drives", {}).items())
        motions = [motion_name(motion, name) for name, joint in joints.items() for motion in joint.kind.motions]
        known += [*model.outputs, *motions, *(f"rate({name})" for name in motions)]
        known += [f"{what}({name})" for name in joints for what in ("force", "torque")]
        known += [f"effort({name})" for name, entry in acting if entry.has_effort]
    return [_item(word) for word in known if word.startswith(incomplete)]
