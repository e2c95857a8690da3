"""The page of a model: its file, pictures, eigenvalues beside the expected ones, critical values, all by commands."""

from __future__ import annotations

import contextlib
import html
import io
import shlex
import shutil
from pathlib import Path
from urllib.parse import quote

import click

from mbstab.api import Mechanism, load
from mbstab.cli.terminal import without_colours
from mbstab.errors import MbstabError
from mbstab.records import dataclass


@dataclass(frozen=True)
class ModelPage:
    """A model with what its page shows.

    Attributes
    ----------
    path : Path
    title, verdict : str
    body : str
        HTML.
    pictures : tuple of str
        Names of files beside the page.
    """

    path: Path
    title: str
    verdict: str
    body: str
    pictures: tuple[str, ...]


def model_page(path: Path, folder: Path, group: click.Group) -> ModelPage:
    """Return the page of a model, and put its file and its pictures into the folder."""
    mechanism = load(path)
    model = mechanism.model
    shutil.copyfile(path, folder / path.name)
    name, stem, text = shlex.quote(_typed(path)), shlex.quote(path.stem), path.read_text(encoding="utf-8")
    parts = [f"<h1>{html.escape(model.title)}</h1>\n<p>{html.escape(model.source)}</p>"]
    line = f"mbstab simulate {name} --mode-shape 1 --fps 8 --size column --animate {stem}.gif"
    pictures = _drawn(group, line, path, folder, f"{path.stem}.gif")
    parts += pictures.shown
    parts.append(f"<h2>Eigenvalues</h2>\n{_session(group, f'mbstab eig {name}', path)}")
    parts += _compared(mechanism)
    maps: tuple[str, ...] = ()
    for parameter in list(model.sweep)[:1]:  # others are swept in the same way
        parts.append("<h2>Critical values</h2>")
        for kind in ("map", "path") if model.reference.find is not None else ("map",):
            line = f"mbstab sweep {name} --param {parameter} --plot {kind} --pictures {stem}.png"
            drawn = _drawn(group, line, path, folder, f"{path.stem}-{kind}.png")
            maps += drawn.files
            parts += drawn.shown
    link = f'<a href="{quote(path.name)}" download>{html.escape(path.name)}</a>'
    parts.append(f"<h2>The file</h2>\n<p>{link}</p>\n<pre class='file'>{html.escape(text)}</pre>")
    return ModelPage(path, model.title, mechanism.eig().verdict, "\n".join(parts), pictures.files + maps)


@dataclass(frozen=True)
class _Drawn:
    """Pictures of a command that exist, and the HTML that shows them with the command."""

    files: tuple[str, ...]
    shown: tuple[str, ...]


def _drawn(group: click.Group, line: str, path: Path, folder: Path, file: str) -> _Drawn:
    """Run a command that draws; what cannot be drawn (modes of periodic motions) is left out, with the reason."""
    try:
        printed = _printed(group, line, path, folder)
    except MbstabError as error:
        # A sweep draws the points that it has, and fails because of the others.
        printed = str(error)
        if not (folder / file).is_file():
            return _Drawn((), (f"<p><code>{html.escape(line)}</code>: {html.escape(printed)}</p>",))
    shown = f'<p><img src="{quote(file)}" alt="{html.escape(line)}"></p>'
    return _Drawn((file,), (_shown(line, printed), shown))


def _session(group: click.Group, line: str, path: Path) -> str:
    return _shown(line, _printed(group, line, path))


def _shown(line: str, printed: str) -> str:
    return f'<pre><span class="typed">$ {html.escape(line)}\n</span>{html.escape(printed)}</pre>'


def _typed(path: Path) -> str:
    """Return the name of a model as it is typed in its folder."""
    return f"./{path.name}" if path.name.startswith("-") else path.name


def _printed(group: click.Group, line: str, path: Path, folder: Path | None = None) -> str:
    """Return what a command prints; it reads the model at its path and writes its pictures to the folder."""
    _, name, *words = shlex.split(line)
    command = group.get_command(click.get_current_context(), name)
    assert command is not None
    whole = f"./{path}" if str(path).startswith("-") else str(path)  # no option
    given = [whole if word == _typed(path) else word for word in words]
    if folder is not None:
        drawn = {f"{path.stem}{suffix}" for suffix in (".gif", ".png")}
        given = [str(folder / word) if word in drawn else word for word in given]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()), without_colours():
        command.main(given, prog_name=f"mbstab {name}", standalone_mode=False)
    return out.getvalue()


def _compared(mechanism: Mechanism) -> list[str]:
    """Return a table of the eigenvalues that the file expects beside those that are found, those with Im >= 0."""
    from mbstab.analysis.compare.expectations import expected_eigenvalues

    rows = []
    for entry in mechanism.model.expect:
        if entry.eigenvalues is None:
            continue
        given = {name: x.text for name, x in entry.at.items()}
        there = mechanism.at(**given)
        found = [e.value for e in there.eig(frozen=entry.frozen).eigenvalues if not e.exact]
        where = ", ".join(f"{name} = {text}" for name, text in given.items()) + (" frozen" if entry.frozen else "")
        ends = (where, entry.source)  # of the first row only
        for expected in expected_eigenvalues(there.model, entry):
            nearest = min(found, key=lambda s: abs(s - expected))
            found.remove(nearest)
            if expected.imag >= 0.0:
                error = abs(nearest - expected) / abs(expected) if expected else None
                told = "zero" if error is None else f"{error:.0e}" if error else "0"
                rows.append([ends[0], _number(expected), _number(nearest), told, ends[1]])
                ends = ("", "")
    if not rows:
        return []
    heads = ("at", "expected (1/s)", "found (1/s)", "relative difference", "source")
    cells = "".join(
        f'<tr><td class="number">{html.escape(row[0])}</td><td class="number">{row[1]}</td>'
        f'<td class="number">{row[2]}</td><td>{row[3]}</td><td class="source">{html.escape(row[4])}</td></tr>\n'
        for row in rows
    )
    head = "".join(f"<th>{head}</th>" for head in heads)
    return [f"<h2>Beside the expected values</h2>\n<table>\n<thead><tr>{head}</tr></thead>\n{cells}</table>"]


def _number(s: complex) -> str:
    return f"{s.real:.10g}" + (f" ± {s.imag:.10g}i" if s.imag else "")
