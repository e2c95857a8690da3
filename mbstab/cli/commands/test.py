"""``mbstab test``: whether the expectations of model files hold."""

from __future__ import annotations

import click

from mbstab.cli.common import failure_of, load_model, model_argument
from mbstab.cli.output import Output, output_options, quiet, say_error
from mbstab.errors import ExpectationError, MbstabError, SeveralErrors, UsageError, counted


@click.command()
@model_argument("names", "[FILES]...", nargs=-1)
@output_options("table", "json", "junit")
def test(names: tuple[str, ...], output: Output) -> None:
    """Check what model files expect to be true of them.

    That is what their expect: blocks say; without FILES those of all example models. With --quiet the table lists
    failures only. Exit code 1 if a model cannot be answered, 2 if a file is wrong, 3 if an expectation does not hold.
    """
    from mbstab.model.library import installed_models
    from mbstab.report import export, outcomes

    models: list[outcomes.Tested] = []
    errors: list[MbstabError] = []
    for name in names or tuple(str(path) for path in installed_models()):
        try:
            found = load_model(name).test()
            if not found:
                raise UsageError(f"{name} has no expect: block\nhint: mbstab schema expect shows its keys")
            models.append(outcomes.Tested(name, found))
        except Exception as error:
            failure = failure_of(name, error)
            say_error(failure)
            models.append(outcomes.Tested(name, [], str(failure)))
            errors.append(failure)
    output.write(
        {
            "table": lambda: outcomes.tested_text(models, quiet()),
            "json": lambda: export.to_json(outcomes.tested_data(models)),
            "junit": lambda: outcomes.tested_junit(models),
        }
    )
    if errors:
        raise SystemExit(SeveralErrors(errors).exit_code)
    if failed := sum(x.failed for x in models):
        raise ExpectationError(f"{counted(failed, 'expectation')} failed")
