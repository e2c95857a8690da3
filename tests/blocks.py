"""Blocks of README and manual: found, and run as a reader would."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]\d+)?(?![\w.])")
EXIT = re.compile(r"\s+# exit (\d)$")


def blocks(text):
    """Return the fenced blocks of a Markdown page, as pairs of their kind and their text."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, flags=re.M | re.S)


def sessions(block):
    """Return the commands of a console block, each with what it prints; nothing where that is not shown."""
    parts = re.split(r"^\$ ", block, flags=re.M)
    assert parts[0] == "", "a console block begins with a command"
    return [part.partition("\n")[::2] for part in parts[1:]]


def run(line, expected=""):
    """Run ``mbstab …``; what it prints is what is shown, numbers but for round-off, and its exit code what is said.

    Of a mistake (exit code 2) the message is shown.
    """
    code = EXIT.search(line)
    words = shlex.split(EXIT.sub("", line))
    assert words[0] == "mbstab"
    result = CliRunner().invoke(main, words[1:])
    assert result.exit_code == (int(code[1]) if code else 0), f"{line}\n{result.output}"
    if expected.strip():
        printed = (result.stderr if result.exit_code == 2 else result.stdout).rstrip("\n") + "\n"
        expected = expected.rstrip("\n") + "\n"
        assert NUMBER.sub("#", printed) == NUMBER.sub("#", expected)
        for found, shown in zip(NUMBER.findall(printed), NUMBER.findall(expected), strict=True):
            # Error bounds and residuals are round-off: their size is the machine's.
            assert float(found) == pytest.approx(float(shown), rel=1e-8, abs=1e-10)
    return result


def read(block, folder):
    """Read a model and analyse it; it is written to the folder under the name in its first line, if it has one."""
    name = re.match(r"# (\w+\.yaml)\n", block)
    if not name:
        return mbstab.loads(block).eig()
    path = Path(folder) / name[1]
    path.write_text(block, encoding="utf-8")
    # A part is read with the file that includes it.
    return None if re.search(r"^needs:", block, re.MULTILINE) else mbstab.load(path).eig()
