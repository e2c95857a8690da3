"""The picture of the descriptor pencil."""

import numpy as np
import pytest
from test_cli import run

import mbstab
from mbstab.report.pictures.pencil import pencil_pattern


def test_every_entry_is_marked_and_blocks_are_named():
    linear = mbstab.load("four_bar.yaml").linearize()
    figure = pencil_pattern(linear, "Linkage")
    for axes, matrix, name in zip(figure.axes, linear.pencil(), "AE", strict=True):
        marks = next(line for line in axes.get_lines() if line.get_marker() == "s")
        drawn = np.zeros_like(matrix, dtype=bool)
        drawn[(marks.get_ydata() - 0.5).astype(int), (marks.get_xdata() - 0.5).astype(int)] = True
        np.testing.assert_array_equal(drawn, matrix != 0.0)
        assert axes.get_title() == f"{name}: 26 × 26, {np.count_nonzero(matrix)} not zero"
        assert [text.get_text() for text in axes.texts] == ["Δq", "Δν", "Δu"]
    rows = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert rows == [
        "rates  left", "right", "coupler", "motion  left", "right", "coupler", "constraints  A", "B", "C", "D",
    ]  # fmt: skip


def test_the_command_draws_it(tmp_path):
    result = run("linearize", "pendulum.yaml", "--plot", "--pictures", str(tmp_path / "a.pdf"))
    assert result.exit_code == 0
    assert (tmp_path / "a-pencil.pdf").stat().st_size > 3000


@pytest.mark.parametrize("arguments", [("--plot",), ("--pictures", "a.png")])
def test_symbols_are_not_drawn(arguments):
    result = run("linearize", "pendulum.yaml", "--symbolic", *arguments)
    assert result.exit_code == 2
    assert "--plot draws numbers" in result.stderr
