"""``mbstab test``: do the expectations of model files hold."""

from __future__ import annotations

import click

from mbstab.cli.common import load_model, note, show
from mbstab.errors import ExpectationError, MbstabError, UsageError, counted


@click.command()
@click.argument("files", metavar="FILES...", nargs=-1)
@click.option("--quiet", "-q", is_flag=True, help="Print failures only.")
def test(files: tuple[str, ...], quiet: bool) -> None:
    """Check the expect: blocks of model files; without FILES those of all example models.

    Exit code 1 if a model cannot be answered, 2 if a file is wrong, 3 if an expectation does not hold.
    """
    from mbstab.model.library import installed_models

    names = files or tuple(str(path) for path in installed_models())
    passed = failed = 0
    worst: MbstabError | None = None
    for name in names:
        try:
            outcomes = load_model(name).test()
        except MbstabError as error:
            note(str(error))
            show(f"FAIL {name}", "\n")
            worst, failed = error, failed + 1
            continue
        if not outcomes:
            raise UsageError(f"{name} has no expect: block")
        for outcome in outcomes:
            passed, failed = passed + outcome.passed, failed + (not outcome.passed)
            if not outcome.passed or not quiet:
                mark = "ok  " if outcome.passed else "FAIL"
                show(f"{mark} {outcome.location}: {outcome.what}: {outcome.detail}", "\n")
    show(f"{passed} passed, {failed} failed", "\n")
    if worst is not None:
        raise SystemExit(worst.exit_code)
    if failed:
        raise ExpectationError(f"{counted(failed, 'expectation')} failed")
