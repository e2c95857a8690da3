"""``mbstab schema``: what a model file may contain."""

from __future__ import annotations

import click

from mbstab.cli.output import Output, output_options
from mbstab.errors import UsageError, nearest, suggestion


@click.command()
@click.argument("section", required=False)
@output_options("json", "table")
def schema(section: str | None, output: Output) -> None:
    """Print what model files may contain, or their JSON Schema.

    With the schema editors complete and check model files. With SECTION (bodies, joints, contacts, drives, forces)
    print its types and their keys as text; with a type, such as revolute or joints.revolute, only that one. Sections
    without types, such as reference, and keys with keys of their own, such as reference.steady and shape, print these,
    and functions what expressions may call.

    Example: mbstab schema -o mbstab.schema.json
    """
    if section is None:
        from mbstab.model.json_schema import json_schema
        from mbstab.report.export import to_json

        output.write(dict.fromkeys(("json", "table"), lambda: to_json(json_schema())))
        return
    text = section_text(section)
    output.write(dict.fromkeys(("json", "table"), lambda: text))


def section_text(section: str) -> str:
    """Return the types of a section, or the keys of one without types, as text.

    Raises
    ------
    UsageError
        If there is no such section or type.
    """
    from mbstab.mechanics.elements import KINDS
    from mbstab.mechanics.measures import MEASURES
    from mbstab.model.functions import CALLED
    from mbstab.model.keys import EXPLAINED, SECTIONS
    from mbstab.report.kinds import keys_text, kinds_text, shapes_text

    if section == "shape":
        return shapes_text()
    if section == "functions":
        return "".join(f"{name}({', '.join(x.names)}): {x.doc}\n" for name, x in CALLED.items())
    measures = "".join(f"{name}({', '.join(x.arguments)}): {x.doc} ({x.unit})\n" for name, x in MEASURES.items())
    if section == "measures":
        return measures
    if section in EXPLAINED:
        return keys_text(EXPLAINED[section])
    if section in SECTIONS and section not in KINDS:
        return keys_text([SECTIONS[section]]) + (measures if section == "outputs" else "")
    name, _, kind = section.partition(".")
    homes = [x for x in KINDS if any(section == k_name for k_name, _ in KINDS[x])]
    if homes and f"{section}s" not in KINDS:  # joint, a type of drives, rather means joints
        return "\n".join(section_text(f"{home}.{section}") for home in homes)
    if name not in KINDS:
        known = list(dict.fromkeys([*KINDS, *SECTIONS, "shape", "functions", "measures", *EXPLAINED]))
        ends = {x.rpartition(".")[2]: x for x in known}
        near = nearest(section, [*known, *ends])
        hint = f"did you mean {ends.get(near, near)!r}?" if near else "one of " + ", ".join(known)
        raise UsageError(f"there is no section {section!r}\nhint: {hint}")
    kinds = {id(k): k for (k_name, _), k in KINDS[name].items() if kind in ("", k_name)}
    if not kinds:
        known = sorted({k_name for k_name, _ in KINDS[name]})
        raise UsageError(f"there is no type {kind!r} in {name}\nhint: {suggestion(kind, known) or ', '.join(known)}")
    return kinds_text(list(kinds.values()))
