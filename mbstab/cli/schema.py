"""``mbstab schema``: what a model file may contain."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import output_option, write
from mbstab.errors import UsageError, suggestion


@click.command()
@click.argument("section", required=False)
@output_option
def schema(section: str | None, output: Path | None) -> None:
    """Print the JSON Schema with which editors complete and check model files.

    With SECTION (bodies, joints, contacts, drives, forces) print its types and their keys as text; with a type as well,
    such as joints.revolute, only that one. Sections without types (parameters, ground, constraints, reference,
    reference.steady, initial, sweep, expect, expect.critical) print their keys.

    Example: mbstab schema -o mbstab.schema.json
    """
    if section is None:
        from mbstab.model.schema import json_schema
        from mbstab.report.export import to_json

        write(to_json(json_schema()), output)
        return
    from mbstab.mechanics.elements import KINDS
    from mbstab.model.schema import SECTION_FIELDS
    from mbstab.report.kinds import keys_text, kinds_text

    if section in SECTION_FIELDS:
        write(keys_text(SECTION_FIELDS[section]), output)
        return
    name, _, kind = section.partition(".")
    if name not in KINDS:
        known = [*KINDS, *SECTION_FIELDS]
        hint = suggestion(section, known) or "one of " + ", ".join(known)
        raise UsageError(f"there is no section {section!r}\nhint: {hint}")
    kinds = {id(k): k for (k_name, _), k in KINDS[name].items() if kind in ("", k_name)}
    if not kinds:
        known = sorted({k_name for k_name, _ in KINDS[name]})
        raise UsageError(f"there is no type {kind!r} in {name}\nhint: {suggestion(kind, known) or ', '.join(known)}")
    write(kinds_text(list(kinds.values())), output)
