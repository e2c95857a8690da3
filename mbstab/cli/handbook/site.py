"""The manual as a web site: a gallery, a page for each model and each topic; no network, no script."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

import click

from mbstab.cli.handbook.model_pages import ModelPage, model_page
from mbstab.cli.handbook.pages import INDEX, TOPICS, indexed, page, titles
from mbstab.errors import OutputError, UsageError

MARK = "/* the manual of mbstab */"
"""Begins the style sheet, which is written first; a folder with it may be written again."""

STYLE = """\
body { font: 17px/1.5 system-ui, sans-serif; max-width: 52em; margin: 0 auto; padding: 0 1em 3em; color: #111; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2em; }
a { color: #0b4f9c; } nav { margin: 1em 0; border-bottom: 1px solid #bbb; padding-bottom: .6em; }
nav a { display: inline-block; margin-right: .9em; padding: .2em 0; }
code, pre { font-family: ui-monospace, Menlo, Consolas, monospace; font-size: .87em; overflow-wrap: break-word; }
pre { background: #f4f4f4; padding: .7em; overflow-x: auto; line-height: 1.3; overflow-wrap: normal; }
pre code { font-size: 1em; } .typed { white-space: pre-wrap; } .option { white-space: nowrap; }
table { display: block; overflow-x: auto; border-collapse: collapse; }
th, td { border-bottom: 1px solid #ccc; padding: .25em .8em .25em 0; text-align: left; vertical-align: top; }
td.number { font-family: ui-monospace, Menlo, Consolas, monospace; white-space: nowrap; } td.source { min-width: 12em; }
img { max-width: 100%; height: auto; }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(18em, 100%), 1fr)); gap: 1em; }
.gallery a { display: block; border: 1px solid #ccc; padding: .5em; text-decoration: none; }
.gallery img { display: block; margin: 0 auto .4em; max-height: 16em; }
@media print { nav { display: none; } body { max-width: none; font-size: 10pt; } pre { white-space: pre-wrap; }
  h1, h2 { break-after: avoid; } pre, tr, img, .gallery a { break-inside: avoid; } pre.file { break-inside: auto; }
  img { max-height: 14cm; } table { display: table; } }
"""


def write_site(folder: Path, group: click.Group, models: Sequence[Path], progress: Callable[[float], object]) -> None:
    """Write the site to a folder, which is made unless it is there.

    Parameters
    ----------
    folder : Path
    group : click.Group
        The commands of the program.
    models : sequence of Path
        Model files that get a page.
    progress : callable
        Is called with the part of the work that is done, from 0 to 1.

    Raises
    ------
    UsageError
        If markdown-it-py is missing, or the folder contains anything but such a site.
    OutputError
        If a file cannot be written.
    """
    if find_spec("markdown_it") is None:
        raise UsageError("--html needs the package markdown-it-py\nhint: pip install 'mbstab[manual]'")
    _require_free(folder)
    pages: dict[str, Path] = {}
    for path in models:
        if (other := pages.setdefault(path.stem, path)) != path:
            raise UsageError(f"{other} and {path} would have the same page\nhint: rename one of them")
    made = []
    try:
        (folder / "models").mkdir(parents=True, exist_ok=True)
        _put(folder / "style.css", f"{MARK}\n{STYLE}")
        for number, path in enumerate(models, 1):
            model = model_page(path, folder / "models", group)
            _put(folder / "models" / f"{path.stem}.html", _whole(model.title, model.body, "../"))
            made.append(model)
            progress(number / len(models))
        names = {model.path.name for model in made}
        for topic, title in titles().items():
            _put(
                folder / f"{topic}.html",
                _whole(title, _unbroken(_linked(_with_places(_markdown(indexed(page(topic, group)))), names))),
            )
        _put(folder / "index.html", _whole("mbstab: the manual", _gallery(made)))
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: cannot be written: {error.strerror}") from None


def _require_free(folder: Path) -> None:
    style = folder / "style.css"
    ours = style.is_file() and style.read_text(encoding="utf-8", errors="replace").startswith(MARK)
    if folder.exists() and not ours and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder} contains other files\nhint: name a folder that is empty or not there yet")


def _put(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _markdown(text: str) -> str:
    from markdown_it import MarkdownIt

    return str(MarkdownIt("commonmark", {"html": False}).enable("table").render(text))


def _with_places(body: str) -> str:
    """Return a page whose headings are places that can be linked, as its index does."""
    heads: dict[str, str] = {}

    def place(found: re.Match[str]) -> str:
        name = re.sub(r"[^a-z0-9]+", "-", re.sub(r"<[^>]*>|&\w+;", "", found[1]).lower()).strip("-")
        heads[name] = found[1]
        return f'<h2 id="{name}">{found[1]}</h2>'

    body = re.sub(r"<h2>(.*?)</h2>", place, body)
    links = " · ".join(f'<a href="#{name}">{head}</a>' for name, head in heads.items())
    return re.sub(rf"<p>{INDEX}.*?</p>", lambda _: f"<p>{INDEX} {links}</p>", body, flags=re.S)


def _linked(body: str, models: set[str]) -> str:
    """Return a page whose mentions of topics and of example models are links."""

    def topic(found: re.Match[str]) -> str:
        return f'<a href="{found[1]}.html">{found[0]}</a>' if found[1] in TOPICS else found[0]

    def model(found: re.Match[str]) -> str:
        name = f"{found[1]}.yaml"
        return f'<a href="models/{found[1]}.html">{found[0]}</a>' if name in models else found[0]

    body = re.sub(r"<code>mbstab manual ([a-z-]+)</code>", topic, body)
    return re.sub(r"<code>(\w+)\.yaml</code>", model, body)


def _unbroken(body: str) -> str:
    """Return a page in whose text and code options such as --output are not broken at their hyphens."""
    pieces = re.split(r"(<pre>.*?</pre>|<[^>]*>)", body, flags=re.S)
    option = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
    return "".join(
        piece if piece.startswith("<") else option.sub(r'<span class="option">\g<0></span>', piece) for piece in pieces
    )


def _gallery(made: Sequence[ModelPage]) -> str:
    cards = "".join(
        f'<a href="models/{quote(model.path.stem)}.html">{_thumbnail(model)}{html.escape(model.title)}<br>'
        f"<small>{html.escape(model.verdict)}</small></a>\n"
        for model in made
    )
    topics = "".join(f'<li><a href="{topic}.html">{html.escape(title)}</a></li>\n' for topic, title in titles().items())
    return (
        "<h1>mbstab</h1>\n<p>Whether a motion of a constrained mechanical system is stable, how that is known, and how "
        f'far each number can be trusted.</p>\n<div class="gallery">\n{cards}</div>\n'
        f"<h2>Pages</h2>\n<ul>\n{topics}</ul>"
    )


def _thumbnail(model: ModelPage) -> str:
    if not model.pictures:
        return ""
    return f'<img src="models/{quote(model.pictures[0])}" loading="lazy" alt="{html.escape(model.title)}">'


def _whole(title: str, body: str, up: str = "") -> str:
    links = "".join(f'<a href="{up}{topic}.html">{topic}</a>\n' for topic in TOPICS)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{html.escape(title)}</title>\n<link rel="icon" href="data:,">\n'
        f'<link rel="stylesheet" href="{up}style.css">\n</head>\n<body>\n'
        f'<nav><a href="{up}index.html">gallery</a>\n{links}</nav>\n{body}\n</body>\n</html>\n'
    )
