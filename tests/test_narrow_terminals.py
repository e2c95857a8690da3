"""Tables and texts on terminals with fewer than 80 columns."""

import os
import subprocess
import sys
from contextvars import copy_context

import pytest

import mbstab
from mbstab.report import set_width
from mbstab.report.eigenvalues import eigen_text
from mbstab.report.tables import eigenvalue


def narrowed(columns, text):
    """Return a text as it is written for a terminal of that width."""

    def written():
        set_width(columns)
        return text()

    return copy_context().run(written)


@pytest.mark.parametrize("columns", [60, 50])
@pytest.mark.parametrize("name", ["bogie.yaml", "whipple_bicycle.yaml", "gear_train.yaml"])
def test_tables_fit_a_narrow_terminal_and_keep_their_numbers(name, columns):
    mechanism = mbstab.load(name)
    result = mechanism.eig()
    whole, narrow = (narrowed(n, lambda: eigen_text(result, "")) for n in (200, columns))
    assert max(map(len, whole.splitlines())) <= 80
    assert max(map(len, narrow.splitlines())) <= columns
    for e in (e for e in result.eigenvalues if e.value.imag >= 0.0 and not e.exact):
        assert eigenvalue(e.value if abs(e.value.real) > e.error_bound else 1j * e.value.imag) in narrow


def test_a_terminal_tells_its_width_and_a_file_does_not(tmp_path):
    """The command asks the terminal; what goes to a file is as wide as ever."""
    ours, theirs = os.openpty()
    environment = {**os.environ, "COLUMNS": "60"}
    command = [sys.executable, "-m", "mbstab", "eig", "bogie.yaml"]
    for more, wide in (([], 60), (["--output", str(tmp_path / "a.txt")], 80)):
        process = subprocess.run([*command, *more], stdout=theirs, stderr=subprocess.DEVNULL, env=environment)
        assert process.returncode == 0
        text = (tmp_path / "a.txt").read_text(encoding="utf-8") if more else os.read(ours, 65536).decode()
        assert 0.9 * wide < max(map(len, text.splitlines())) <= wide
    os.close(ours)
    os.close(theirs)
