"""The command ``mbstab``."""

from __future__ import annotations

from typing import Any

import click

from mbstab.cli import check, compare, eig, equilibrium, linearize, models, schema, simulate, sweep, test
from mbstab.cli.common import note, one_thread_by_default
from mbstab.errors import MbstabError


class _Group(click.Group):
    """Turns the errors of the library into messages with their exit codes; other errors stay visible."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MbstabError as error:
            note(str(error))
            ctx.exit(error.exit_code)
        except BrokenPipeError:  # the reader of a pipe has seen enough
            ctx.exit(0)


def _version(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from importlib.metadata import version

        click.echo(f"mbstab {version('mbstab')}")
        ctx.exit()


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, expose_value=False, is_eager=True, callback=_version, help="Show the version.")
def main() -> None:
    """Tell whether a motion of a constrained mechanical system is stable.

    FILE is a model file (YAML); a name that is no file is looked up among the example models.
    Answers go to the terminal or to --output, messages to stderr. Exit codes: 0 answered,
    1 the computation failed, 2 the file or the command line is wrong, 3 an expectation did not hold
    or --verify contradicts.
    """
    one_thread_by_default()


for _command in (
    check.check,
    compare.compare,
    eig.eig,
    equilibrium.equilibrium,
    linearize.linearize,
    models.models,
    schema.schema,
    simulate.simulate,
    sweep.sweep,
    test.test,
):
    main.add_command(_command)
