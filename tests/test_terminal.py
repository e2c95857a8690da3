"""What a terminal shows beside the text: colours, by the meaning of each part, and as wide as it is."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from contextlib import chdir
from contextvars import copy_context
from pathlib import Path
from threading import Thread
from unittest import mock
from urllib.parse import unquote, urlsplit

import pytest
from click.testing import CliRunner

from mbstab.cli import main
from mbstab.cli.common import duration, progress_bar
from mbstab.cli.main import COMMANDS, GROUPS, SUMMARY
from mbstab.cli.terminal import LOOKS, is_coloured, painted
from mbstab.model.words import WORDS
from mbstab.report import set_width
from mbstab.report.messages import message_text
from mbstab.report.styles import Text, document, joined, styled
from mbstab.report.tables import table
from mbstab.report.verdicts import SYMBOLS, verdict_badge

ESCAPE = re.compile(r"\x1b\[[\d;]*m")
COLOUR_SETTINGS = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "TERM")


def plain(text):
    return ESCAPE.sub("", text)


def environment(**settings):
    return {k: v for k, v in os.environ.items() if k not in COLOUR_SETTINGS} | {"TERM": "xterm-256color"} | settings


class Screen:
    """A terminal, and what is written to it."""

    def __init__(self, columns):
        self.own, self.other = pty.openpty()
        fcntl.ioctl(self.other, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.parts = []
        self.reader = Thread(target=self._read)
        self.reader.start()

    def _read(self):
        while True:
            try:
                part = os.read(self.own, 65536)
            except OSError:  # nobody has it open any more
                return
            if not part:
                return
            self.parts.append(part)

    def text(self):
        os.close(self.other)
        self.reader.join()
        os.close(self.own)
        return b"".join(self.parts).decode().replace("\r\n", "\n")


def on_terminal(*arguments, columns=80, cwd=".", **settings):
    """Return the exit code of a command, and what it writes to a terminal: as stdout, and as stderr."""

    def run():
        with (
            open(out.other, "w", encoding="utf-8", closefd=False) as stdout,
            open(err.other, "w", encoding="utf-8", closefd=False) as stderr,
            mock.patch.multiple(sys, stdout=stdout, __stdout__=stdout, stderr=stderr),
            mock.patch.dict(os.environ, environment(**settings), clear=True),
            chdir(cwd),
            pytest.raises(SystemExit) as stop,
        ):
            main([str(x) for x in arguments], prog_name="mbstab")
        return stop.value.code

    out, err = Screen(columns), Screen(columns)
    return copy_context().run(run), out.text(), err.text()


def piped(*arguments, **settings):
    """Return what a command writes to a pipe."""
    alone = dict.fromkeys(COLOUR_SETTINGS) | settings
    return CliRunner().invoke(main, [str(x) for x in arguments], env=alone).stdout


UP_TO = "● Verdict: asymptotically stable up to symmetry"


def look(style, text):
    return painted(styled(text, style))


# --- what is coloured -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "style", "badge", "rows"),
    [
        (("eig", "pendulum.yaml"), "stable", "✔ Verdict: stable", {}),
        (("eig", "chaplygin_sleigh.yaml", "--set", "v=2"), "marginal", UP_TO, {"neutral": "faint"}),
        (("eig", "trailer.yaml", "--set", "v=-1"), "unstable", "✘ Verdict: unstable", {"unstable": "grows"}),
        (("eig", "governor_paper.yaml", "--frozen"), "undecided", "? Verdict: undecided", {}),
    ],
)
def test_a_terminal_shows_the_verdict_first_as_a_badge_and_the_text_of_a_pipe(arguments, style, badge, rows):
    code, shown, _ = on_terminal(*arguments)
    assert code == 0
    assert look(style, badge) in shown.splitlines()[:3]
    timed = re.compile(r" in \d+\.\d s;")
    assert timed.sub("", plain(shown)) == timed.sub("", piped(*arguments))
    for kind, row in rows.items():
        lines = [line for line in shown.splitlines() if re.search(rf" {kind}\b[ \w]*(, \d×)?(\x1b\[0m)?$", line)]
        assert lines
        assert all(line == look(row, plain(line)) for line in lines)


def test_a_process_shows_on_a_terminal_what_it_does_in_tests():
    screen = Screen(80)
    command = [sys.executable, "-m", "mbstab", "eig", "pendulum.yaml", "-q"]
    subprocess.run(command, stdin=subprocess.DEVNULL, stdout=screen.other, env=environment(), check=True)
    assert screen.text() == on_terminal("eig", "pendulum.yaml")[1]


@pytest.mark.parametrize("word", WORDS)
def test_every_verdict_has_a_symbol_and_a_colour_of_its_rank(word):
    expected = {"stable": "✔", "asymptotically stable": "✔", "unstable": "✘", "undecided": "?"}.get(word, "●")
    badge = verdict_badge(word)
    assert badge == f"{expected} Verdict: {word}"
    ((first, stop, style),) = badge.spans
    assert (first, stop, SYMBOLS[style]) == (0, len(badge), expected)


def test_the_ranges_of_a_sweep_have_the_colours_of_their_verdicts():
    sweep = ("sweep", "top.yaml", "--param", "omega", "--from", "0", "--to", "12", "--points", "13", "--plot", "none")
    _, shown, _ = on_terminal(*sweep)
    (line,) = (line for line in shown.splitlines() if "unstable (" in line)
    assert line == f"{plain(line).partition(': ')[0]}: {look('bad', plain(line).partition(': ')[2])}"
    assert plain(shown) == piped(*sweep)


ARM = "mbstab: 1\nbodies:\n  arm:\n    type: planar\n    masss: 1.5\n    mass: 1\n    inertia: 1\n"


def test_an_error_a_hint_and_a_caret_have_colours(tmp_path):
    code, shown, told = on_terminal("eig", "pendulum.yaml", "--set", "LL=1", cwd=tmp_path)
    assert (code, shown) == (2, "")
    assert look("error", "error:") + " " in told
    assert look("hint", "hint:") + " " in told
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    _, _, told = on_terminal("check", "arm.yaml", cwd=tmp_path)
    place, source, caret, *_ = told.splitlines()
    assert place == look("place", "arm.yaml:5:5:") + " bodies.arm: unknown key 'masss'"
    assert source == " 5 |     masss: 1.5"
    assert caret == "   | " + look("error", "    ^")
    same = CliRunner().invoke(main, ["check", str(tmp_path / "arm.yaml")]).stderr
    assert plain(told) == same.replace(f"{tmp_path}/", "")


def test_a_warning_has_a_colour():
    assert painted(message_text("warning", "rank 2\nhint: x")) == (
        f"{look('warning', 'warning:')} rank 2\n{look('hint', 'hint:')} x"
    )


@pytest.mark.parametrize("name", ["a b.csv", "ü%.csv"])
def test_a_written_file_is_a_link(name, tmp_path):
    _, _, told = on_terminal("eig", "pendulum.yaml", "-o", name, cwd=tmp_path)
    (line,) = (line for line in told.splitlines() if "wrote" in line)
    target, shown = re.fullmatch(r"wrote \x1b]8;[^;]*;([^\x1b]*)\x1b\\(.*)\x1b]8;;\x1b\\", line).groups()
    assert plain(shown) == name
    assert Path(unquote(urlsplit(target).path)) == tmp_path / name
    plainly = CliRunner().invoke(main, ["eig", "pendulum.yaml", "-o", str(tmp_path / name)]).stderr
    assert f"wrote {tmp_path / name}\n" in plainly


# --- progress -------------------------------------------------------------------------------------------------------


def test_progress_tells_the_count_and_the_time_left(monkeypatch):
    screen, now = Screen(80), [100.0]
    monkeypatch.setattr("click._termui_impl.time.time", lambda: now[0])
    monkeypatch.setenv("TERM", "xterm")
    with open(screen.other, "w", encoding="utf-8", closefd=False) as stderr, mock.patch.object(sys, "stderr", stderr):
        with progress_bar("sweeping", 401) as show:
            show(0.0)
            now[0] += 2.0
            show(37 / 401)
        with progress_bar("simulating") as show:
            show(0.25)
    assert re.search(r"sweeping  \[###-+\]  37/401, 20 s left", text := screen.text())
    assert re.search(r"simulating  \[#{9}-+\]  25%\x1b", text)


def test_a_sweep_counts_its_points():
    sweep = (
        "sweep",
        "pendulum.yaml",
        "--param",
        "L",
        "--from",
        "0.1",
        "--to",
        "0.3",
        "--points",
        "41",
        "--plot",
        "none",
    )
    assert "41/41" in on_terminal(*sweep)[2]
    assert "41/41" not in on_terminal(*sweep, TERM="dumb")[2]
    assert "41/41" not in on_terminal(*sweep, "--quiet")[2]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (89.0, "89 s"), (90.0, "1.5 min"), (1200.0, "20 min"), (9000.0, "2.5 h")]
)
def test_times_are_short(seconds, text):
    assert duration(seconds) == text


# --- whether --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        ((), {"NO_COLOR": "1"}),
        ((), {"TERM": "dumb"}),
        ((), {"NO_COLOR": "1", "FORCE_COLOR": "1"}),
        (("--color", "never"), {"FORCE_COLOR": "1"}),
    ],
)
def test_a_terminal_without_colours_gets_the_text_of_a_pipe(arguments, settings):
    assert on_terminal(*arguments, "eig", "pendulum.yaml", **settings)[1] == piped("eig", "pendulum.yaml")


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        (("--color", "always", "eig", "top.yaml"), {"NO_COLOR": "1"}),
        (("eig", "top.yaml", "--color", "always"), {}),
        (("eig", "--color=always", "top.yaml"), {}),
        (("eig", "top.yaml"), {"FORCE_COLOR": "1"}),
    ],
)
def test_colours_can_be_had_in_a_pipe(arguments, settings):
    text = piped("eig", "top.yaml")
    assert "\x1b" not in text
    shown = piped(*arguments, **settings)
    assert look("marginal", "● Verdict: marginally stable") in shown
    assert plain(shown) == text


class Stream:
    def __init__(self, terminal):
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.mark.parametrize(
    ("terminal", "settings", "expected"),
    [
        (True, {"TERM": "xterm"}, True),
        (False, {"TERM": "xterm"}, False),
        (True, {"TERM": "dumb"}, False),
        (True, {"TERM": "xterm", "NO_COLOR": ""}, True),
        (True, {"TERM": "xterm", "NO_COLOR": "0"}, False),
        (False, {"FORCE_COLOR": "1", "TERM": "dumb"}, True),
        (False, {"FORCE_COLOR": "0"}, False),
        (False, {"FORCE_COLOR": ""}, False),
    ],
)
def test_what_decides_on_colours(terminal, settings, expected):
    assert is_coloured(Stream(terminal), settings) is expected


def test_a_file_has_no_colours(tmp_path):
    piped("eig", "top.yaml", "-o", tmp_path / "a.txt", "--color", "always")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == piped("eig", "top.yaml")


@pytest.mark.parametrize("arguments", [("eig", "pendulum.yaml", "--color", "red"), ("--color", "alway", "models")])
def test_another_word_for_color_is_refused(arguments):
    found = CliRunner().invoke(main, arguments)
    assert found.exit_code == 2
    assert found.stderr.startswith("error: ")


# --- how wide -------------------------------------------------------------------------------------------------------

NUMBER = re.compile(r"(?<![\w.])[-−]?\d[\w.+-]*")


def answered_at(columns, *arguments):
    """Return an answer as for a terminal of that many columns."""
    context = copy_context()
    context.run(set_width, columns)
    return context.run(CliRunner().invoke, main, arguments).stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("eig", "whipple_bicycle.yaml", "--shapes"),
        ("eig", "kapitza.yaml"),
        ("linearize", "whipple_bicycle.yaml", "--form", "state-space"),
        ("equilibrium", "governor.yaml"),
        ("check", "whipple_bicycle.yaml"),
    ],
)
def test_tables_keep_every_digit_and_fit(arguments):
    narrow, wide = (re.sub(r", \d+ more$", "", answered_at(n, *arguments), flags=re.M) for n in (80, 120))
    assert max(map(len, narrow.splitlines())) <= 80
    assert max(map(len, wide.splitlines())) <= 120
    assert set(NUMBER.findall(narrow)) <= set(NUMBER.findall(wide))


def test_columns_that_do_not_fit_in_80_stand_side_by_side_in_120():
    command = ("linearize", "whipple_bicycle.yaml", "--form", "state-space")
    narrow, wide = (answered_at(columns, *command) for columns in (80, 120))
    assert len(wide.splitlines()) < len(narrow.splitlines())
    assert max(map(len, wide.splitlines())) > 80
    _, shown, _ = on_terminal(*command, columns=120)
    assert plain(shown) == wide


# --- text with styles -----------------------------------------------------------------------------------------------


def test_styles_stay_where_texts_are_joined():
    text = document(["a", joined([styled("bc", "good"), "d"], "-"), styled("", "bad"), styled("e", None)])
    assert text == "a\nbc-d\n\ne\n"
    assert [(text[first:stop], style) for first, stop, style in text.spans] == [("bc", "good")]
    assert painted(text) == f"a\n{look('good', 'bc')}-d\n\ne\n"


def test_what_cannot_be_seen_is_escaped_beside_colours():
    assert painted(joined([styled("a\x1b[31m", "good"), "\x07"], "")) == look("good", "a\\u001b[31m") + "\\u0007"


def test_a_table_styles_whole_rows_of_several_lines():
    text = table(["a", "b"], [["1", "x"], ["2\n3", "y"]], styles=[None, "grows"])
    assert isinstance(text, Text)
    assert [text[first:stop] for first, stop, style in text.spans if style == "grows"] == ["2  y", "3"]


@pytest.mark.parametrize("style", LOOKS)
def test_every_look_has_only_colours_that_a_terminal_sets_for_its_background(style):
    codes = re.search(r"\x1b\[([\d;]+)m", look(style, "x"))[1].split(";")
    assert not {"38", "48"} & {*codes}


# --- calls ----------------------------------------------------------------------------------------------------------


def test_commands_are_listed_in_groups_each_with_a_whole_sentence():
    assert sorted(name for names in GROUPS.values() for name in names) == list(COMMANDS)
    shown = CliRunner().invoke(main, ["--help"]).stdout
    assert [line[:-1] for line in shown.splitlines() if line[:-1] in GROUPS] == list(GROUPS)
    for name in COMMANDS:
        (summary,) = re.findall(rf"^  {name} +(.*)$", shown, flags=re.M)
        assert len(summary) <= SUMMARY
        assert "..." not in summary
        assert summary == re.split(r"\.\s", f"{main.get_command(None, name).help} ")[0] + "." * summary.endswith(".")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("eig pendulum.yaml --require stabel", "--require: 'stabel' is none of asymptotic, stable, marginal, linear\n"
         "hint: did you mean 'stable'?"),
        ("eig pendulum.yaml --plot spectrun", "--plot: 'spectrun' is none of spectrum, modes, sensitivity\n"
         "hint: did you mean 'spectrum'?"),
        ("eig pendulum.yaml --requir stable", "mbstab eig has no option --requir\nhint: did you mean --require?"),
        ("eig pendulum.yaml --json", "mbstab eig has no option --json\nhint: --format json"),
        ("eig pendulum.yaml --color red", "mbstab eig has no option --color\nhint: --color auto, always or never"),
        ("egi pendulum.yaml", "no such command 'egi'\nhint: did you mean 'eig'?"),
        ("sweep pendulum.yaml", "--param is missing\nhint: mbstab sweep --help shows arguments and options"),
        ("eig", "FILES... is missing\nhint: mbstab eig --help shows arguments and options"),
        ("check a.yaml b.yaml", "got unexpected extra argument (b.yaml)\n"
         "hint: mbstab check --help shows arguments and options"),
        ("sweep pendulum.yaml --param L --jobs 0", "--jobs: 0 is not in the range 1<=x<=1024\n"
         "hint: mbstab sweep --help shows arguments and options"),
        ("sweep pendulum.yaml --param L --points x", "--points: 'x' is not a valid integer range\n"
         "hint: mbstab sweep --help shows arguments and options"),
        ("models lst", "no such command 'lst'\nhint: mbstab models --help shows arguments and options"),
        ("compare pendulum.yaml --plot a.svg", "--plot: 'a.svg' is no picture but where one goes\n"
         "hint: --plot error --pictures a.svg"),
        ("linearize pendulum.yaml --pictures a.svg", "--pictures goes with --plot"),
    ],
)  # fmt: skip
def test_mistakes_in_a_call_are_told_as_all_others(arguments, told):
    found = CliRunner().invoke(main, arguments.split(), prog_name="mbstab")
    assert found.exit_code == 2
    assert found.stdout == ""
    assert found.stderr.rstrip("\n").partition("\n")[::2] == f"error: {told}".partition("\n")[::2]


@pytest.mark.parametrize(
    ("span", "apart"),
    [
        ("L=0.1..0.3", ("L", "--from", "0.1", "--to", "0.3")),
        ("L = 0.3 .. 0.1", ("L", "--from", "0.3", "--to", "0.1")),
        ("L=50%", ("L", "--from", "0.2-0.1", "--to", "0.2+0.1")),
        ("L=0.1..2*0.15", ("L", "--from", "0.1", "--to", "0.3")),
    ],
)
def test_a_range_stands_behind_its_name_or_apart(span, apart):
    rest = ("--points", "3", "--plot", "none", "--format", "csv")
    told = CliRunner().invoke(main, ["sweep", "pendulum.yaml", "--param", span, *rest])
    assert told.exit_code == 0, told.stderr
    assert told.stdout == CliRunner().invoke(main, ["sweep", "pendulum.yaml", "--param", *apart, *rest]).stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("L=1..2", "--from", "1"), "L=1..2 gives both ends\nhint: leave out --from and --to"),
        (("L=1..1",), "the range of L is empty"),
        (("L=1..2", "--values", "1,2"), "--values gives the whole range"),
        (("L=1..2..3",), "L=1..2..3: a range is written FIRST..LAST"),
    ],
)
def test_a_range_that_is_none_is_refused(arguments, told):
    found = CliRunner().invoke(main, ["sweep", "pendulum.yaml", "--plot", "none", "--param", *arguments])
    assert found.exit_code == 2
    assert told in found.stderr


def test_a_chart_takes_two_ranges():
    rest = ("--points", "3,3", "--plot", "none", "--format", "csv")
    one = CliRunner().invoke(main, ["sweep", "pendulum.yaml", "--param", "L=1..2", "--param", "m=1..3", *rest])
    other = ("--param", "L", "--param", "m", "--from", "1,1", "--to", "2,3")
    assert one.exit_code == 0, one.stderr
    assert one.stdout == CliRunner().invoke(main, ["sweep", "pendulum.yaml", *other, *rest]).stdout
