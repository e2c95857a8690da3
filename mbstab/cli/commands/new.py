"""``mbstab new``: a commented file with which an own model begins."""

from __future__ import annotations

import re
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from mbstab.cli.output import quiet_option, save, show, write_bytes
from mbstab.errors import UsageError, suggestion
from mbstab.model.library import SUFFIX, starts_folder


def _kinds() -> list[str]:
    return sorted(path.stem for path in starts_folder().glob(f"*{SUFFIX}"))


def _offered(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(kind) for kind in _kinds() if kind.startswith(incomplete)]


@click.command()
@click.argument("kind", required=False, shell_complete=_offered)
@click.argument("file", required=False, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The same as FILE.")
@quiet_option
def new(kind: str | None, file: Path | None, output: Path | None) -> None:
    """Write a commented model file to start from.

    Without KIND, list the kinds. The file runs at once. FILE is KIND.yaml here unless given; an existing file is not
    overwritten.

    Example: mbstab new planar linkage.yaml
    """
    if kind is None and output is not None:
        raise UsageError(f"--output {output} needs a KIND of model\nhint: one of {', '.join(_kinds())}")
    if kind is None:
        show("".join(f"{name:12}{_title(name)}\n" for name in _kinds()))
        return
    if kind not in _kinds():
        hint = suggestion(kind, _kinds()) or f"one of {', '.join(_kinds())}"
        raise UsageError(f"there is no kind {kind!r} of model\nhint: {hint}")
    if file is not None and output is not None:
        raise UsageError(f"FILE is {file}, and --output {output} too\nhint: name one of them")
    name, file = kind + SUFFIX, file or output
    goal = Path(name) if file is None else file / name if file.is_dir() else file
    if goal.exists():
        raise UsageError(f"{goal} exists already\nhint: name another FILE")
    text = (starts_folder() / name).read_text(encoding="utf-8")
    text = re.sub(rf"(?<!\w){re.escape(name)}", lambda _: goal.name, text)
    save(goal, lambda path: write_bytes(path, text.encode("utf-8")), "FILE")


def _title(kind: str) -> str:
    """Return what the comment that heads a file names first."""
    lines = (starts_folder() / (kind + SUFFIX)).read_text(encoding="utf-8").splitlines()[1:]
    comment = " ".join(line.removeprefix("# ") for line in lines if line.startswith("#"))
    return re.split("[:,.] ", comment)[0]
