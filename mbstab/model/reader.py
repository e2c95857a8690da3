"""A model file to a `Model`: the sections in the order in which they need each other, all problems at once."""

from __future__ import annotations

import copyreg
import os
from collections.abc import Callable
from collections.abc import Mapping as MappingType
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbstab.errors import ModelFileError, UsageError
from mbstab.model.expansion import expanded
from mbstab.model.fields.base import Reading
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.garbage import uncollected
from mbstab.model.keys import SECTIONS, VERSION
from mbstab.model.names import Names
from mbstab.model.nodes import NodeReader
from mbstab.model.parameters import bound
from mbstab.model.quantities import QuantityReader
from mbstab.model.schema import Model
from mbstab.model.sections.definitions import DefinitionReader
from mbstab.model.sections.entries import EntryReader, home
from mbstab.model.sections.outputs import read_outputs
from mbstab.model.sections.parameters import ParameterReader
from mbstab.model.sections.tables import TableReader
from mbstab.model.yamlfile import Document, Mapping, Opened, Scalar, not_told, parse_yaml, read_text, yaml_text


def read_model(path: Path, opened: Opened = not_told) -> Model:
    """Read a model file; `opened` is called with the path of each file before it is read.

    Raises
    ------
    ModelFileError
        With all problems of the file.
    UsageError
        If the file cannot be read.
    """
    opened(path)
    text = read_text(path)
    try:
        return read_model_text(text, str(path), opened=opened)
    except ModelFileError:
        with suppress(OSError):  # what it names belongs to it, even if it is not understood
            for other in path.parent.iterdir() if opened is not not_told else ():
                if os.fsencode(other.name) in text:
                    opened(other)
        raise


def read_model_text(
    text: str | bytes,
    name: str = "<text>",
    beside: MappingType[str, str] | None = None,
    opened: Opened = not_told,
) -> Model:
    """Read a model from text.

    Parameters
    ----------
    text : str or bytes
    name : str
        What messages call it.
    beside : mapping, optional
        Texts of other files that it names.
    opened : callable
        Is called with the path of each file before it is read.
    """
    with uncollected():
        document, root = parse_yaml(text, name)
        document.beside.update(beside or {})
        document.opened = opened
        if not root.entries.keys() & SECTIONS.keys():
            hint = "a model starts with the line mbstab: 1; mbstab new writes one to begin with"
            document.fail(root.location, "", "this is no model: none of its keys is a section of one", hint)
        if isinstance(counts := root.entries.get("counts"), Mapping):
            document.counts = counts.entries
        model = _read(document, expanded(document, root))
    document.raise_problems()
    return model


def expanded_text(model: Model) -> str:
    """Return the file of a model with its repetitions and parts written out, as YAML."""
    document, root = parse_yaml("\n".join(model.document.lines), model.document.name)
    document.beside.update(model.document.beside)
    return yaml_text(expanded(document, root))


def with_counts(model: Model, settings: MappingType[str, object]) -> tuple[Model, dict[str, object]]:
    """Return a model with the counts among some settings, read again, and the settings that are left.

    Raises
    ------
    ModelFileError
        If the file does not fit these counts.
    UsageError
        If a count is no whole number.
    """
    counts = model.document.counts
    chosen = {name: _whole(name, x) for name, x in settings.items() if name in counts and name not in model.parameters}
    if not chosen:
        return model, dict(settings)
    lines = list(model.document.lines)
    # From the last to the first, so that places stay.
    for name in sorted(chosen, key=lambda x: (counts[x].location.line, counts[x].location.column), reverse=True):
        node = counts[name]
        assert isinstance(node, Scalar)
        row, begin = node.location.line - 1, node.location.column - 1
        at = lines[row].index(node.text, begin)  # behind a quotation mark
        lines[row] = lines[row][:at] + str(chosen[name]) + lines[row][at + len(node.text) :]
    told = model.document.opened
    found = read_model_text("\n".join(lines), model.document.name, model.document.beside, told)
    given = {name: x.given for name, x in model.parameters.items() if x.given is not None and name in found.parameters}
    changed = {name: replace(found.parameters[name], given=x) for name, x in given.items()}
    left = {name: x for name, x in settings.items() if name not in chosen}
    return replace(found, parameters={**found.parameters, **changed}), left


def _read_again(
    text: str, name: str, beside: dict[str, str], settings: dict[str, object], inputs: list[str], outputs: list[str]
) -> Model:
    model = bound(read_model_text(text, name, beside), settings)
    return replace(
        model,
        inputs={x: model.inputs[x] for x in inputs if x in model.inputs},
        outputs={x: model.outputs[x] for x in outputs if x in model.outputs},
    )


def _as_text(model: Model) -> tuple[Callable[..., Model], tuple[object, ...]]:
    """Return what a model is made of again, in another process too: its files, what it is asked at, and its ports."""
    document = model.document
    text, ports = "\n".join(document.lines), (list(model.inputs), list(model.outputs))
    return _read_again, (text, document.name, document.beside, model.settings, *ports)


copyreg.pickle(Model, _as_text)


def _whole(name: str, value: object) -> int:
    """Return a count that is given as a number or a text."""
    text = str(value).strip()
    if not text.isdecimal():
        raise UsageError(
            f"{name} is a count of the file: expected a whole number, not {text!r}\nhint: such as {name}=10"
        )
    return int(text)


def _read(document: Document, root: Mapping) -> Model:
    """Read every section; after a problem, reading goes on with something harmless."""
    nodes = NodeReader(document)
    quantities = QuantityReader(Names(nodes))
    top = root.entries
    nodes.known_keys(root, "", [name for name, x in SECTIONS.items() if not x.expanded], home)
    _check_version(nodes, root)
    quantities.names.tables = TableReader(nodes).read(top.get("tables"))
    ParameterReader(quantities).read(top.get("parameters"))
    definitions = DefinitionReader(quantities)
    definitions.find(top.get("definitions"))
    entry_reader = EntryReader(quantities)
    found = entry_reader.find_bodies(root)
    entry_reader.read_ground(top.get("ground"))
    bodies = entry_reader.read_bodies(found)
    entry_reader.find_states(top)
    entries = entry_reader.read(top, definitions)
    inputs = entries.pop("inputs")
    reading = Reading(quantities, root, "")

    def value(name: str, absent: str = "") -> Any:
        section = SECTIONS[name]
        return kind_of(section).read(reading, section, top.get(name, Scalar(absent, root.location)), name)

    return Model(
        document=document,
        dimension=quantities.names.dimension,
        order=tuple(
            dict.fromkeys([*(key for key in top if key in entries), *(["states"] if entries["states"] else [])])
        ),
        title=value("title"),
        source=value("source"),
        parameters=quantities.names.parameters,
        gravity=value("gravity", "0"),
        ground=quantities.names.geometry[None][0],
        bodies=bodies,
        entries=entries,
        inputs=inputs,
        outputs=read_outputs(quantities, top.get("outputs"), entries),
        **{name: value(name) for name in ("reference", "initial", "sweep", "modes", "expect")},
        measures=quantities.names.measures,
        definitions=quantities.names.definitions,
        tables=quantities.names.tables,
        state_units=quantities.names.state_units,
    )


def _check_version(nodes: NodeReader, root: Mapping) -> None:
    node = root.entries.get("mbstab")
    if node is None:
        nodes.complain(root, "", "the key 'mbstab' is missing", "write mbstab: 1 in the first line")
    elif not isinstance(node, Scalar) or node.text != VERSION:
        nodes.complain(node, "mbstab", f"this program reads version {VERSION} of the file format")
