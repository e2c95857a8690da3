"""The manual as a web site: no broken link, nothing from a network, a page for every model."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from browser import WIDTHS, program, seen
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.cli.handbook.pages import TOPICS
from mbstab.model.library import installed_models

pytest.importorskip("markdown_it")


class Page(HTMLParser):
    """Links, sources and the balance of tags of a page."""

    VOID = ("meta", "link", "img", "br", "hr")

    def __init__(self, path):
        super().__init__()
        self.targets, self.open = [], []
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag, attrs):
        self.targets += [value for name, value in attrs if name in ("href", "src")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def built(folder, *names):
    return CliRunner().invoke(main, ["manual", "--html", str(folder), *names])


def check(folder, names):
    """Check every page: links lead to files of the site, and every page and model is there."""
    pages = {path.relative_to(folder).as_posix(): Page(path) for path in folder.rglob("*.html")}
    assert pages.keys() == {
        "index.html", *(f"{topic}.html" for topic in TOPICS), *(f"models/{name}.html" for name in names),
    }  # fmt: skip
    linked = set()
    for name, page in pages.items():
        assert page.open == []
        assert '<meta name="viewport" content="width=device-width' in page.text
        assert "<script" not in page.text
        for target in page.targets:
            if target != "data:,":  # no icon is asked for
                file, _, part = target.partition("#")
                place = ((folder / name).parent / file).resolve() if file else (folder / name).resolve()
                assert place.is_file(), f"{name} links to {target}"
                assert not part or f' id="{part}">' in pages[place.relative_to(folder.resolve()).as_posix()].text
                linked |= {place} if file else set()
    # What is there can be reached.
    assert {path.resolve() for path in folder.rglob("*.*")} == linked
    return pages


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site") / "manual"
    answer = built(folder, "top", "kapitza")
    assert answer.exit_code == 0, answer.output
    assert answer.stderr.endswith(f"wrote {folder / 'index.html'}\n")
    return folder


def test_no_link_is_broken_and_nothing_comes_from_a_network(site):
    pages = check(site, ["top", "kapitza"])
    assert all("//" not in target for page in pages.values() for target in page.targets)
    assert "@media print" in (site / "style.css").read_text(encoding="utf-8")


def test_the_page_of_a_model_has_what_was_computed_beside_what_is_published(site):
    text = (site / "models" / "top.html").read_text(encoding="utf-8")
    assert '<span class="typed">$ mbstab eig top.yaml\n</span>' in text
    assert "$ mbstab sweep top.yaml --param omega " in text
    assert "Verdict: marginally stable" in text
    assert (
        text.count('<td class="source">closed form; Table 6 prints 2.4512 and 2.5316</td>') == 1
    )  # of two eigenvalues
    assert "5.567728" in text  # the critical spin, from the sweep
    rows = re.findall(
        r'<tr><td class="number">([^<]*)</td><td class="number">([^<]*)</td><td class="number">([^<]*)</td>', text
    )
    assert ("omega = 4", "2.451222599 ± 2.53164557i", "2.451222599 ± 2.53164557i") in rows
    assert len(rows) == sum(len(e.eigenvalues or ()) for e in mbstab.load("top.yaml").model.expect)
    assert (site / "models" / "top.yaml").read_bytes() == next(
        path for path in installed_models() if path.stem == "top"
    ).read_bytes()
    assert {"models/top.gif", "models/top-map.png"} <= {f"models/{x.name}" for x in (site / "models").iterdir()}


def test_what_cannot_be_drawn_is_left_out_with_the_reason(site):
    text = (site / "models" / "kapitza.html").read_text(encoding="utf-8")
    assert "modes of periodic motions have no shape that swings" in text
    assert not (site / "models" / "kapitza.gif").exists()


def test_topics_and_models_are_linked_where_they_are_mentioned(site):
    assert '<a href="verdicts.html"><code>mbstab manual verdicts</code></a>' in (site / "tutorial.html").read_text(
        encoding="utf-8"
    )
    assert '<a href="models/top.html"><code>top.yaml</code></a>' in (site / "examples.html").read_text(encoding="utf-8")


def test_options_are_not_broken_at_their_hyphens(site):
    for name in ("commands", "verdicts", "how-to"):
        text = re.sub(r"<pre>.*?</pre>", "", (site / f"{name}.html").read_text(encoding="utf-8"), flags=re.S)
        whole = re.findall(r'<span class="option">(--[a-z-]+)</span>', text)
        assert len(whole) == len(re.findall(r"(?<![\w-])--[a-z]", text)) > 4
    assert ".option { white-space: nowrap; }" in (site / "style.css").read_text(encoding="utf-8")


def test_a_long_page_begins_with_links_to_its_headings(site):
    text = (site / "keys.html").read_text(encoding="utf-8")
    index = re.findall(r"<p>On this page:.*?</p>", text, flags=re.S)
    assert len(index) == 1
    assert '<a href="#bodies"><code>bodies</code></a> · <a href="#joints">' in index[0]
    assert text.index('<h2 id="bodies"><code>bodies</code></h2>') > text.index(index[0])
    assert "On this page" not in (site / "limits.html").read_text(encoding="utf-8")


def test_a_folder_with_other_files_is_refused_and_a_site_is_written_again(tmp_path):
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    answer = built(tmp_path, "pendulum")
    assert answer.exit_code == 2
    assert "contains other files\nhint: name a folder" in answer.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    assert built(tmp_path / "site", "pendulum").exit_code == 0
    for name in ("limits", "index"):  # as after an interrupt
        (tmp_path / "site" / f"{name}.html").unlink()
    assert built(tmp_path / "site", "pendulum").exit_code == 0
    check(tmp_path / "site", ["pendulum"])


def test_an_own_model_with_any_name_has_a_page(tmp_path):
    own = tmp_path / "k 1.yaml"
    text = (
        "mbstab: 1\ntitle: a <b> & c\nparameters: {k: 9}\nbodies: {k: {type: planar_point, mass: 1}}\n"
        "forces: {k: {type: expression, on: {k.x: -k*k.x, k.y: -k*k.y}}}\nreference: {coordinates: {k: {x: 0, y: 0}}}\n"
        "sweep: {k: {from: 1, to: 2, points: 3}}\n"
    )
    own.write_text(text, encoding="utf-8")
    answer = built(tmp_path / "site", str(own))
    assert answer.exit_code == 0, answer.output
    page = Page(tmp_path / "site" / "models" / "k 1.html")
    assert "a &lt;b&gt; &amp; c" in page.text
    assert {"k%201.yaml", "k%201.gif", "k%201-map.png"} <= set(page.targets)
    assert (tmp_path / "site" / "models" / "k 1-map.png").is_file()


def test_wrong_requests_are_refused(tmp_path, monkeypatch):
    assert "did you mean 'pendulum'?" in built(tmp_path / "site", "pendulm").stderr
    both = CliRunner().invoke(main, ["manual", "--html", str(tmp_path / "site"), "--search", "top"])
    assert (both.exit_code, "exclude each other" in both.stderr) == (2, True)
    from mbstab.cli.handbook import site

    monkeypatch.setattr(site, "find_spec", lambda name: None)
    assert "hint: pip install 'mbstab[manual]'" in built(tmp_path / "site", "top").stderr
    assert not (tmp_path / "site").exists()


@pytest.mark.skipif(program() is None, reason="there is no Chromium")
def test_no_page_scrolls_sideways_misses_a_picture_or_complains_in_a_browser(site, tmp_path):
    shown, console = seen(site, tmp_path)
    assert {(Path(page).name, width) for page, width, *_ in shown} == {
        (path.name, width) for path in site.rglob("*.html") for width in WIDTHS
    }
    assert [page for page in shown if page[2] > 0 or page[3]] == []
    assert console == []


@pytest.mark.skipif(program() is None, reason="there is no Chromium")
def test_what_is_wrong_in_a_browser_is_seen(tmp_path):
    page = "<pre style='width: 2000px'>x</pre><img src='none.png'><script>console.error('no')</script>"
    (tmp_path / "page.html").write_text(f"<!DOCTYPE html>{page}", encoding="utf-8")
    shown, console = seen(tmp_path, tmp_path)
    assert all(too_wide > 500 and missing for _, _, too_wide, missing in shown)
    assert console


@pytest.mark.long
def test_every_example_has_a_page(tmp_path):
    answer = built(tmp_path / "site")
    assert answer.exit_code == 0, answer.output
    check(tmp_path / "site", [path.stem for path in installed_models()])
    if program() is not None:
        shown, console = seen(tmp_path / "site", tmp_path)
        assert ([page for page in shown if page[2] > 0 or page[3]], console) == ([], [])
