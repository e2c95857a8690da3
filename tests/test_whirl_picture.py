"""Campbell diagrams of rotors: senses of whirl, and crossings with their values."""

import re
from dataclasses import replace

import numpy as np
from matplotlib.text import Text
from test_plots import made

from mbstab.analysis.sweep.sweep import OrderCrossing
from mbstab.report.picture_sizes import sized
from mbstab.report.pictures.campbell import campbell


def texts(figure):
    return [text.get_text() for text in figure.findobj(Text)]


def test_a_branch_without_frequency_is_no_branch_without_whirl():
    x = np.linspace(0.0, 10.0, 41)
    branches = np.column_stack([3j - 0.1 + 0.0 * x, -3j - 0.1 + 0.0 * x, -1.0 - x])
    swept = replace(made(x, branches), orders=(1.0,), whirls=("forward", "forward", ""))
    assert "no whirl" not in texts(campbell(swept, "omega (rad/s)", ""))


def test_crossings_without_a_value_are_counted():
    x = np.linspace(0.0, 10.0, 41)
    frequencies = np.linspace(1.0, 4.0, 8)
    branches = np.column_stack([sign * 1j * w - 0.1 + 0.0 * x for w in frequencies for sign in (1, -1)])
    orders = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
    crossings = tuple(OrderCrossing(k, w / k, w, 2 * n, "", "", ()) for k in orders for n, w in enumerate(frequencies))
    swept = replace(made(x, branches), orders=orders, crossings=crossings)
    counts = {}
    for size in ("page", "column"):
        with sized(size):
            figure = campbell(swept, "omega (rad/s)", "")
        shown = texts(figure)
        (left_out,) = (int(text.split()[0]) for text in shown if text.endswith("crossings without their value"))
        placed = [part for text in figure.axes[0].texts for part in text.get_text().split(", ")]
        values = [text for text in placed if re.fullmatch(r"[0-9.]+", text)]
        assert len(values) + left_out == len({(round(c.value, 3), c.frequency) for c in crossings})
        assert {f"{w:.4g}" for w in frequencies} <= set(values)  # of the order 1, though the last in the list
        assert any(text.startswith("branch") for text in placed)
        counts[size] = len(values)
    assert counts["column"] < 0.5 * counts["page"]
    few = replace(swept, orders=orders[:2], crossings=crossings[:2])
    assert not any("without" in text for text in texts(campbell(few, "omega (rad/s)", "")))
