"""Pictures: labels with units, critical values, gaps, files, and curves that stay small."""

import math
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text
from test_cli import run

import mbstab
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.ranges import Range
from mbstab.analysis.sweep.sweep import OrderCrossing, Sweep, sweep
from mbstab.analysis.verdict.rule import STABLE, UNSTABLE, WORDS
from mbstab.errors import UsageError
from mbstab.model.units import is_angular_velocity
from mbstab.report.picture_sizes import sized
from mbstab.report.pictures.campbell import WHIRL_INK, campbell
from mbstab.report.pictures.curves import INK, THICK, THIN
from mbstab.report.pictures.drawing import save
from mbstab.report.pictures.pencil import pencil_pattern
from mbstab.report.pictures.responses import response_picture
from mbstab.report.pictures.root_locus import root_locus
from mbstab.report.pictures.scales import Axis, number_text, upward_range
from mbstab.report.pictures.spectrum import FAINT
from mbstab.report.pictures.stability_chart import REGIONS, chart
from mbstab.report.pictures.stability_map import stability_map
from mbstab.report.pictures.sweep_curves import SweepCurves
from mbstab.report.responses import decibels

PICTURES = {"map": stability_map, "locus": root_locus, "campbell": campbell}


def made(x, branches, critical=(), meetings=()):
    branches = np.asarray(branches, dtype=complex)
    unstable = np.where(np.isnan(branches).any(axis=1), -1, np.sum(branches.real > 0.0, axis=1))
    return Sweep("p", np.asarray(x, dtype=float), branches, unstable, 0, tuple(critical), tuple(meetings), {})


def oscillator(points=101, gap=()):
    """One pair (p − 1) ± (2 + p)i: flutter at p = 1."""
    x = np.linspace(0.0, 2.0, points)
    branch = (x - 1.0) + (2.0 + x) * 1j
    branches = np.column_stack([branch, branch.conj()])
    branches[list(gap)] = np.nan
    return made(x, branches, [Critical(1.0, "flutter", (0,), 3.0, (0, 2))])


def texts(figure):
    found = [text.get_text() for text in figure.texts]
    for axes in figure.axes:
        found += [axes.get_xlabel(), axes.get_ylabel(), *(text.get_text() for text in axes.texts)]
    return found + [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def curves(axes):
    """The lines of branches: those with more than two points that are not of the grid of equal damping."""
    lines = [line for line in axes.get_lines() if line.get_zorder() != FAINT["zorder"]]
    return [line for line in lines if len(line.get_xdata()) > 2 and line.get_linestyle() != "None"]


def verticals(axes):
    return [line.get_xdata()[0] for line in axes.get_lines() if list(line.get_ydata()) == [0, 1]]


@pytest.fixture(scope="module")
def top():
    return sweep(mbstab.load("top.yaml").model, "omega", np.linspace(0.0, 10.0, 101), detail=True)


# --- what is written on a picture -----------------------------------------------------------------------------------


def test_labels_have_units(top):
    expected = {
        "map": ["omega (rad/s)", "real part (1/s)", "imaginary part (rad/s)"],
        "locus": ["real part (1/s)", "imaginary part (rad/s)", "omega = 0 rad/s", "omega = 10 rad/s"],
        "campbell": ["omega (rad/s)", "frequency (Hz)"],
    }
    for kind, draw in PICTURES.items():
        found = texts(draw(top, "omega (rad/s)", "Top"))
        assert "Top" in found
        assert [text for text in expected[kind] if text not in found] == []


def test_critical_values_are_drawn_and_labelled(top):
    figure = stability_map(top, "omega (rad/s)", "Top")
    assert "5.56773 collision" in texts(figure)
    for axes in figure.axes:
        np.testing.assert_allclose([x for x in verticals(axes) if x], [5.567728441653741], rtol=1e-12)
    locus = root_locus(top, "omega (rad/s)", "Top")
    assert "omega = 5.56773 rad/s" in texts(locus)
    diamonds = [line for line in locus.axes[0].get_lines() if line.get_marker() == "D"]
    np.testing.assert_allclose(sorted(diamonds[0].get_ydata()), [-3.523878760540, 3.523878760540], rtol=1e-9)


def test_values_are_in_the_declared_unit():
    x = np.linspace(0.0, 2.0, 51)
    result = oscillator(51)
    turned = made(x * math.pi / 30.0, result.branches, [Critical(math.pi / 30.0, "flutter", (0,), 3.0, (0, 2))])
    figure = stability_map(turned, "n (rpm)", "Rotor")
    assert figure.axes[0].get_xlim() == pytest.approx((0.0, 2.0))
    assert "1 flutter" in texts(figure)
    assert "n (rpm)" in texts(figure)


def test_dollar_signs_in_titles_are_no_formulas(tmp_path):
    figure = stability_map(oscillator(), "p", "Costs $5, not $_")
    save(figure, tmp_path / "a.png")
    assert "Costs $5, not $_" in texts(figure)


@pytest.mark.long
def test_many_critical_values_do_not_cover_each_other():
    x = np.linspace(0.0, 1.0, 2001)
    branches = np.column_stack([np.sin(300.0 * x) + 5j, np.sin(300.0 * x) - 5j])
    changes = [Critical(k * math.pi / 300.0, "flutter", (0,), 5.0, (2, 0)[:: (-1) ** k]) for k in range(1, 95)]
    figure = stability_map(made(x, branches, changes), "p (m)", "Many")
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in figure.axes[0].texts]
    assert len(boxes) > 10
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert any("without label" in text for text in texts(figure))


# --- branches -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", PICTURES)
def test_a_missing_row_breaks_the_lines(kind):
    figure = PICTURES[kind](oscillator(gap=[20, 21]), "p (m/s)", "Gap")
    for axes in figure.axes:
        for line in curves(axes):
            x, y = (np.asarray(values, dtype=float) for values in line.get_data())
            finite = np.isfinite(x) & np.isfinite(y)
            step = np.hypot(np.diff(x), np.diff(y))[finite[1:] & finite[:-1]]
            assert step.max(initial=0.0) < 0.05
    if kind != "locus":
        assert "no answer" in texts(figure)


def test_a_point_between_gaps_is_seen():
    figure = stability_map(oscillator(gap=[10, 11, 13, 14]), "p", "Point")
    dots = [line for line in figure.axes[0].get_lines() if line.get_marker() == "."]
    assert [list(line.get_xdata()) for line in dots] == [[pytest.approx(0.24)]] * 2


def test_line_styles_tell_real_from_imaginary_and_stable_from_unstable():
    figure = stability_map(oscillator(), "p", "Grey")
    upper, lower = ({(line.get_linestyle(), line.get_linewidth()) for line in curves(axes)} for axes in figure.axes)
    assert upper == {("-", THIN), ("-", THICK)}
    assert lower == {("--", THIN), ("--", THICK)}
    grey = [np.array([int(ink[k : k + 2], 16) for k in (1, 3, 5)]) @ [0.299, 0.587, 0.114] / 255 for ink in INK]
    assert np.diff(grey).min() > 0.15
    assert np.diff([float(shade) for shade in REGIONS]).max() < -0.15


def test_thick_parts_end_at_the_critical_value():
    # Few points: the value lies far from both neighbours.
    figure = stability_map(oscillator(8), "p", "Coarse")
    for axes in figure.axes:
        thick = [line for line in curves(axes) if line.get_linewidth() == THICK]
        assert thick
        for line in thick:
            x, y = (np.asarray(values, dtype=float) for values in line.get_data())
            assert np.min(x[np.isfinite(y)]) == 1.0


def test_unstable_ranges_end_at_critical_values(top):
    figure = stability_map(top, "omega (rad/s)", "Top")
    assert [(a, b, state) for a, b, state in SweepCurves(top, Axis("omega")).ranges()] == [
        (0.0, pytest.approx(5.567728441653741, rel=1e-12), 1)
    ]
    assert "unstable range" in texts(figure)


def test_colliding_branches_meet_where_they_collide(top):
    picture = SweepCurves(top, Axis("omega"))
    row = int(np.argmin(np.abs(picture.x - 5.567728441653741)))
    found = sorted(zip(picture.imag[row], picture.real[row], strict=True))
    np.testing.assert_allclose(found, [(s * 3.52387876, 0.0) for s in (-1, -1, 1, 1)], atol=1e-3)


def test_collisions_at_the_same_value_are_all_drawn_as_square_roots():
    """λ² ∓ cλ + 1 = 0, once with negative and once with positive damping: both pairs collide at c = 2."""
    model = mbstab.loads(
        """
        mbstab: 1
        parameters: {c: 1}
        bodies: {p: {type: planar_point, mass: 1}, q: {type: planar_point, mass: 1}}
        constraints: {one: {holonomic: p.y}, other: {holonomic: q.y}}
        forces:
          f: {type: expression, on: {p.x: -p.x + c*rate(p.x), q.x: -q.x - c*rate(q.x)}}
        reference: {coordinates: {p: {x: 0}, q: {x: 0}}}
        """
    )
    result = model.sweep("c", np.linspace(1.55, 2.45, 10), meetings=True, detail=True)
    assert [(round(at, 9), how) for at, how in result.meetings] == [(2.0, "collide")] * 2
    drawn = SweepCurves(result, Axis("c"))
    root = np.sqrt(drawn.x**2 - 4.0 + 0j)
    exact = np.stack([sign * (drawn.x + other * root) / 2.0 for sign in (1, -1) for other in (1, -1)], axis=1)
    found = drawn.real + 1j * drawn.imag
    assert np.max(np.min(np.abs(found[:, :, None] - exact[:, None, :]), axis=2)) < 0.02
    assert "branches meet at c: 2 (2 pairs collide)" in str(result)


def test_descending_sweeps_start_where_they_were_asked_to():
    result = oscillator()
    down = made(result.values[::-1], result.branches[::-1], result.critical)
    legend = [text for text in texts(root_locus(down, "p (m)", "Down")) if text.startswith("p = ")]
    assert legend[-2:] == ["p = 2 m", "p = 0 m"]
    assert stability_map(down, "p (m)", "Down").axes[0].get_xlim() == (0.0, 2.0)


DEGENERATE = {
    "none": made([0.0, 1.0, 2.0], np.zeros((3, 0))),
    "nan": made([0.0, 1.0, 2.0], np.full((3, 2), np.nan)),
    "one point": made([3.0], [[1.0 + 2j, 1.0 - 2j]]),
    "zero": made([0.0, 1.0], np.zeros((2, 2))),
}


@pytest.mark.parametrize(
    ("kind", "name"), [(k, n) for k in PICTURES for n in DEGENERATE if (k, n) != ("campbell", "zero")]
)
def test_degenerate_sweeps_are_drawn(kind, name, tmp_path):
    save(PICTURES[kind](DEGENERATE[name], "omega (rad/s)", ""), tmp_path / "a.png")


def test_a_campbell_diagram_without_frequencies_is_refused():
    x = np.linspace(-1.0, 2.0, 5)
    message = "no eigenvalue oscillates between p = −1 m and 2\nhint: --plot map shows the real parts"
    with pytest.raises(UsageError, match=message):
        campbell(made(x, np.column_stack([x, -x])), "p (m)", "")


def test_rounding_is_not_blown_up():
    x = np.linspace(0.0, 1.0, 51)
    noise = 1e-16 * np.sin(1e3 * x)
    result = made(x, np.column_stack([noise + 3j, noise - 3j]))
    low, high = root_locus(result, "p", "Centre").axes[0].get_xlim()
    assert low < -0.1
    assert high > 0.1


@pytest.mark.parametrize("unit", [1.0, 1j])
def test_a_panel_of_zeros_is_left_out_with_a_word(unit):
    x = np.linspace(1.0, 2.0, 51)
    values = unit * np.column_stack([x, -x])
    figure = stability_map(made(x, values), "p", "Zeros")
    shown, empty = ("real", "imaginary") if unit == 1.0 else ("imaginary", "real")
    assert [axes.get_ylabel().split()[0] for axes in figure.axes] == [shown]
    assert f"all {empty} parts are 0" in texts(figure)


def test_curves_are_smooth_between_few_points():
    x = np.linspace(0.5, 3.0, 11)
    branch = 1.0 / x + 1j * np.sqrt(x)
    picture = SweepCurves(made(x, np.column_stack([branch, branch.conj()])), Axis("p"))
    assert len(picture.x) > 50
    np.testing.assert_allclose(picture.real[:, 0], 1.0 / picture.x, atol=0.04)
    np.testing.assert_allclose(picture.imag[:, 0], np.sqrt(picture.x), atol=1e-12)
    assert np.all(np.diff(picture.real[:, 0]) < 0.0)
    np.testing.assert_array_equal(picture.imag[:, 0], -picture.imag[:, 1])


def test_what_is_zero_stays_zero_beside_a_bend():
    x = np.linspace(-1.0, 1.0, 11)
    frequency = np.sqrt(np.maximum(x - 0.1, 0.0))
    picture = SweepCurves(made(x, np.column_stack([frequency * 1j, -frequency * 1j])), Axis("p"))
    assert np.all(picture.imag[picture.x <= 0.0] == 0.0)
    assert np.all(picture.imag[:, 0] >= 0.0)


@pytest.mark.parametrize("points", [20, 21])
def test_a_pitchfork_is_a_square_root_on_and_between_points(points):
    x = np.linspace(-1.0, 1.0, points)
    root = np.sqrt(x.astype(complex))
    swept = made(x, np.column_stack([root, -root]), [Critical(0.0, "divergence", (0,), 0.0, (0, 1))])
    picture = SweepCurves(swept, Axis("p"))
    near = np.abs(picture.x) < 0.1
    assert near.sum() > 10
    np.testing.assert_allclose(picture.real[near, 0], np.sqrt(np.maximum(picture.x[near], 0.0)), atol=0.02)
    assert picture.growing[picture.x >= 0.0, 0].all()


def test_four_eigenvalues_that_meet_at_zero_stay_on_the_axes():
    # Which continues which is open: the sweep may follow those that stay zero instead.
    x = np.linspace(-1.0, 1.1, 15)
    before, after = np.sqrt(np.maximum(-x, 0.0)), 1j * np.sqrt(np.maximum(x, 0.0))
    swept = made(x, np.column_stack([before, after, -after, -before]), [Critical(0.0, "divergence", (0,), 0.0, (1, 0))])
    picture = SweepCurves(swept, Axis("p"))
    assert np.max(np.abs(picture.real * picture.imag)) == 0.0
    np.testing.assert_allclose(picture.real[:, 0], np.sqrt(np.maximum(-picture.x, 0.0)), atol=0.05)
    np.testing.assert_allclose(picture.imag[:, 1], np.sqrt(np.maximum(picture.x, 0.0)), atol=0.05)


@pytest.mark.parametrize("values", [np.linspace(-2.0, 2.0, 5), np.linspace(2.0, -2.0, 5), np.linspace(-2.0, 2.0, 4)])
def test_an_unstable_range_ends_at_a_critical_value_on_a_point_or_between(values):
    model = mbstab.loads(
        """
        mbstab: 1
        parameters: {k: 1}
        bodies: {p: {type: planar_point, mass: 1}}
        constraints: {line: {holonomic: p.y}}
        forces: {f: {type: expression, on: {p.x: -k*p.x - rate(p.x)}}}
        reference: {coordinates: {p: {x: 0}}}
        """
    )
    found = list(SweepCurves(model.sweep("k", values), Axis("k")).ranges())
    assert found == [(-2.0, pytest.approx(0.0, abs=1e-12), 1)]


def test_points_without_an_answer_leave_open_what_lies_around_them():
    known = [(0.0, 0.18, STABLE), (0.24, 1.0, STABLE), (1.0, 1.8, UNSTABLE)]
    ranges = tuple(Range(low, high, WORDS.index(word), (2 * (word == UNSTABLE),)) for low, high, word in known)
    swept = replace(oscillator(gap=[10, 11, *range(95, 101)]), ranges=ranges)
    found = list(SweepCurves(swept, Axis("p")).ranges())
    assert found == [pytest.approx(piece) for piece in ((0.18, 0.24, -1), (1.0, 1.8, 1), (1.88, 2.0, -1))]


@pytest.mark.parametrize("power", [2.0, 4.0])
def test_a_path_that_ends_at_a_fold_is_drawn_to_it(power):
    x = np.linspace(-1.0, 1.0, 21)
    value = np.where(x < 0.97, np.abs(0.97 - x) ** (1.0 / power), np.nan)
    swept = made(x, np.column_stack([-value, value]), [Critical(0.97, "fold", (), 0.0, (0, 0))])
    picture = SweepCurves(swept, Axis("p"))
    ends = picture.x[np.isfinite(picture.real[:, 0])]
    assert ends.max() == pytest.approx(0.97)
    last = picture.x > 0.8
    expected = np.maximum(0.97 - picture.x[last], 0.0) ** (1.0 / power)
    shown = np.isfinite(picture.real[last, 0])
    np.testing.assert_allclose(picture.real[last, 1][shown], expected[shown], atol=0.1)


def test_axes_say_quantity_name_and_unit_as_it_is_printed():
    axis = Axis("k", "N*m/rad", 1.0, "stiffness; of both")
    figure = stability_map(oscillator(), axis, "Label")
    assert figure.axes[1].get_xlabel() == "stiffness k (N·m/rad)"
    assert Axis("k", "N/m^2", 1.0, "x" * 60).text == "k (N/m²)"
    assert (Axis("n", "rad/rad").text, Axis("n", "rad/rad").at("3")) == ("n", "n = 3")
    assert Axis("n", "rad").text == "n (rad)"
    assert number_text(7.29129e7, 1e8, 6) == "7.29129·10⁷"
    assert number_text(-1e-9, 1e-8, 6) == "\N{MINUS SIGN}1·10⁻⁹"


def test_strongly_damped_branches_do_not_squeeze_the_others():
    x = np.linspace(0.0, 2.0, 51)
    branches = np.column_stack([x - 1.0 + 2j, x - 1.0 - 2j, -1e4 - x])
    figure = stability_map(made(x, branches), "p", "Stiff")
    axes = figure.axes[0]
    assert axes.get_yscale() == "asinh"
    assert "logarithmic beyond" in axes.get_ylabel()
    heights = axes.transAxes.inverted().transform(axes.transData.transform([(0.0, -1.0), (0.0, 1.0)]))[:, 1]
    assert heights[1] - heights[0] > 0.2


@pytest.mark.parametrize("kind", PICTURES)
def test_long_sweeps_have_few_vertices_and_keep_their_extrema(kind):
    n = 100_000
    x = np.linspace(0.0, 2.0, n)
    real, imag = 0.1 * np.sin(40.0 * x) - 1.0, 3.0 + np.cos(30.0 * x)
    real[n // 3] = -5.0  # one point of many in a column
    branches = np.column_stack([real + 1j * imag, real - 1j * imag])
    branches[n // 2] = np.nan
    axes = PICTURES[kind](made(x, branches), "p (m)", "Long").axes[0]
    lines = curves(axes)
    assert lines
    assert max(len(line.get_xdata()) for line in lines) < 10_000
    for line in lines:
        data = np.asarray(line.get_data(), dtype=float)
        assert np.isnan(data).any()
        if kind != "campbell":
            assert np.nanmin(data[1 if kind == "map" else 0]) == -5.0


# --- Campbell diagrams ----------------------------------------------------------------------------------------------


def test_crossings_with_excitation_lines_are_marked():
    # Frequency 3 rad/s at all speeds: crossed at 3/n.
    omega = np.linspace(0.5, 5.0, 46)
    branches = np.column_stack([-0.1 + 3j + 0.0 * omega, -0.1 - 3j + 0.0 * omega])
    crossings = tuple(OrderCrossing(k, 3.0 / k, 3.0, 0, "", "") for k in (2.0, 1.0))
    swept = replace(made(omega, branches), orders=(1.0, 2.0), crossings=crossings)
    figure = campbell(swept, "omega (rad/s)", "Rotor")
    rings = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    np.testing.assert_allclose(sorted(line.get_xdata()[0] for line in rings), [1.5, 3.0])
    np.testing.assert_allclose([line.get_ydata()[0] for line in rings], 3.0 / (2.0 * math.pi))
    assert {"1.5", "3", "1×", "2×"} <= set(texts(figure))


def test_a_high_frequency_does_not_compress_the_low_ones():
    x = np.linspace(0.0, 100.0, 41)
    columns = [f + 0.01 * x for f in (3.0, 6.0, 500.0)]
    branches = np.column_stack([sign * 1j * w - 0.1 for w in columns for sign in (1, -1)])
    axes = campbell(made(x, branches), "omega (rad/s)", "Stiff").axes[0]
    assert "logarithmic beyond" in axes.get_ylabel()
    height = axes.transAxes.inverted().transform(axes.transData.transform([(0.0, 3.0 / 6.28), (0.0, 6.0 / 6.28)]))[:, 1]
    assert height[0] > 0.2
    assert height[1] - height[0] > 0.05


def test_a_chain_of_branches_that_meet_has_a_colour_for_each_pair_and_numbers():
    """Branches 2 and 3 are conjugate at two points, 1 and 2, and 3 and 4, at ten: without numbers all were black."""
    x = np.arange(15.0)
    real = np.full((15, 4), -1.0) * [1.0, 2.0, 3.0, 4.0] * (1.0 + 0j)
    real[:2, 1:3] = np.array([-2.5 + 0.2j, -2.5 - 0.2j])
    real[5:] = np.array([-1.5 + 3j, -1.5 - 3j, -3.5 + 1j, -3.5 - 1j])
    ink = SweepCurves(made(x, real), Axis("p")).ink
    assert ink[0] == ink[1] != ink[2] == ink[3]
    figure = stability_map(made(x, real), "p", "")
    assert [sorted(text.get_text() for text in axes.texts)[:1] for axes in figure.axes] == [["1"], ["1"]]


def test_branches_have_their_names_or_numbers_in_their_colours():
    x = np.linspace(0.0, 2.0, 41)
    branches = np.column_stack([sign * 1j * (k + x) - 0.1 for k in (3.0, 9.0, 9.0) for sign in (1, -1)])
    for names, expected in (
        ((), ["branch 1", "branch 3, 5"]),
        (("weave", "", "wobble", "", "pitch", ""), ["weave", "wobble, pitch"]),
    ):
        swept = replace(made(x, branches), names=names)
        axes = campbell(swept, "p", "").axes[0]
        shown = {text.get_text(): text for text in axes.texts}
        assert list(shown) == expected
        assert [shown[text].get_color() for text in expected] == SweepCurves(swept, Axis("p")).ink[::2][:2]
        for text, middle in zip(expected, (4.0, 10.0), strict=True):
            assert abs(shown[text].xy[1] * 2.0 * math.pi - middle) <= 1.0


def test_campbell_diagrams_name_every_sense_of_whirl_and_coincident_crossings_once():
    x = np.linspace(0.0, 10.0, 41)
    branches = np.column_stack([sign * 1j * k + 0.0 * x - 0.1 for k in (3.0, 5.0, 5.0, 7.0) for sign in (1, -1)])
    senses = ("forward", "mixed", "mixed", "backward")
    crossings = tuple(
        OrderCrossing(1.0, k, k, 2 * n, "", whirl, ())
        for n, (k, whirl) in enumerate(zip((3.0, 5.0, 5.0, 7.0), senses, strict=True))
    )
    # The last branch changes its sense at 4.
    ranges = [((0.0, 10.0, s),) for s in senses[:3]] + [((0.0, 4.0, "forward"), (4.0, 10.0, "backward"))]
    swept = replace(
        made(x, branches), orders=(1.0,), crossings=crossings, senses=tuple(s for s in ranges for _ in range(2))
    )
    assert swept.whirls[-1] == "changing"
    figure = campbell(swept, "omega (rad/s)", "")
    shown = texts(figure)
    assert {"forward whirl", "backward whirl", "mixed whirl", "crossing, mixed whirl"} <= set(shown)
    assert "no whirl" not in shown
    highest = [
        (line.get_color(), np.asarray(line.get_xdata(), dtype=float)[np.isfinite(line.get_ydata())])
        for line in figure.axes[0].get_lines()
        if len(line.get_xdata()) > 1 and np.nanmax(np.abs(np.asarray(line.get_ydata()) - 3.5 / np.pi)) < 1e-9
    ]
    assert [(ink, at[0], at[-1]) for ink, at in highest] == [
        (WHIRL_INK["forward"], 0.0, 4.0),
        (WHIRL_INK["backward"], pytest.approx(4.0, abs=0.26), 10.0),
    ]
    assert "frequency of a branch" not in shown
    assert [text for text in shown if text in ("3", "5", "7")] == ["3", "5", "7"]
    colours = {line.get_marker(): line.get_color() for line in figure.axes[0].get_lines() if len(line.get_xdata()) == 1}
    assert colours == {"^": WHIRL_INK["forward"], "D": WHIRL_INK["mixed"], "v": WHIRL_INK["backward"]}


def test_legends_lie_inside_the_picture_and_below_the_panels():
    x = np.linspace(0.0, 2.0, 41)
    branches = np.column_stack([(x - 1.0) + 1j * (k + x) for k in range(2, 10)])
    names = tuple(f"a mode with a long name {k}" for k in range(8))
    change = Critical(1.0, "flutter", (0,), 3.0, (0, 16))
    for draw in PICTURES.values():
        figure = draw(replace(made(x, branches, [change]), names=names), "speed (m/s)", "Long")
        figure.draw_without_rendering()
        box, sheet = figure.legends[0].get_window_extent(), figure.bbox
        assert sheet.x0 <= box.x0 < box.x1 <= sheet.x1
        assert sheet.y0 <= box.y0
        assert all(box.y1 <= axes.xaxis.label.get_window_extent().y0 for axes in figure.axes if axes.get_xlabel())


def test_orders_need_an_angular_velocity():
    units = {"rpm": True, "deg/s": True, "rad/min": True, "m/s": False, "Hz": False, "rad": False, "": False}
    assert {unit: is_angular_velocity(unit) for unit in units} == units


def test_the_legend_names_only_what_is_drawn():
    # Divergence below p = 1, oscillation above: no frequency is unstable.
    root = np.sqrt(1.0 - np.linspace(0.0, 2.0, 50) + 0j)
    result = made(
        np.linspace(0.0, 2.0, 50), np.column_stack([root, -root]), [Critical(1.0, "divergence", (0,), 0.0, (1, 0))]
    )
    assert "unstable eigenvalue" in texts(stability_map(result, "p", ""))
    assert "unstable eigenvalue" not in texts(campbell(result, "p", ""))
    still = made(result.values, np.column_stack([0j + result.values - 3.0, 1.0 + 0j * result.values]))
    assert "unstable eigenvalue" not in texts(campbell(replace(result, beyond=(still,)), "p", ""))


# --- charts ---------------------------------------------------------------------------------------------------------


def stable(unstable):
    return np.full(unstable.shape, "stable")


def test_charts_show_regions_gaps_and_boundaries(tmp_path):
    x, y = np.linspace(0.0, 10.0, 21), np.linspace(0.0, 1e-3, 11)
    unstable = np.add.outer(np.arange(11) // 4, np.arange(21) // 7)
    unstable[8:, :4] = -1
    complex_ones = np.minimum(np.maximum(unstable, 0), 2)
    boundary = np.array([[0.0, 0.0], [5.0, 5e-4], [np.nan, np.nan], [6.0, 6e-4], [10.0, 1e-3]])
    figure = chart(x, y, unstable, complex_ones, stable(unstable), [boundary], ("v (m/s)", "h (mm)"), "Chart")
    axes = figure.axes[0]
    found = texts(figure)
    expected = ["v (m/s)", "h (mm)", "stable", "1 unstable: flutter", "4 or more unstable: divergence and flutter"]
    assert [text for text in [*expected, "no answer", "stability boundary"] if text not in found] == []
    assert axes.get_ylim() == pytest.approx((0.0, 1.0))
    assert [c.get_hatch() for c in axes.collections if c.get_hatch()] == ["////"]
    assert np.isnan(curves(axes)[0].get_ydata()).any()
    shades = [c.get_facecolor()[0, 0] for c in axes.collections if not c.get_hatch()]
    np.testing.assert_allclose(shades, [float(shade) for shade in REGIONS])
    save(figure, tmp_path / "chart.pdf")


def test_the_kind_of_loss_is_written_where_it_has_room():
    x = np.linspace(0.0, 1.0, 21)
    unstable = np.where(x < 0.45, 2, np.where(x < 0.55, 1, 0)) * np.ones((21, 1), dtype=int)
    said = np.where(x[:, None] < 0.5, "marginally stable", stable(unstable))
    figure = chart(x, x, unstable, np.where(unstable == 2, 2, 0), said, [], ("a", "b"), "")
    written = {text.get_text(): text.get_position() for text in figure.axes[0].texts}
    assert set(written) == {"flutter", "stable", "marginally stable"}  # divergence: only in the legend
    assert "marginally stable, stable" in texts(figure)
    assert written["marginally stable"][1] < 0.5 < written["stable"][1]
    assert "1 unstable: divergence" in texts(figure)
    assert written["flutter"][0] < 0.4
    assert written["stable"][0] > 0.6


@pytest.mark.parametrize(("columns", "hidden"), [(1, True), (4, False)])
def test_the_key_says_what_is_too_narrow_to_be_seen(columns, hidden):
    x = np.linspace(0.0, 1.0, 161)
    unstable = np.zeros((161, 161), dtype=int)
    unstable[:, 100 : 100 + columns] = 1
    found = texts(chart(x, x, unstable, 0 * unstable, stable(unstable), [], ("a", "b"), ""))
    assert ("1 unstable: divergence (hidden by a line)" in found) == hidden
    assert "stable" in found


# --- files ----------------------------------------------------------------------------------------------------------


MAGIC = {"png": b"\x89PNG\r\n", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", MAGIC)
def test_files_are_whole_deterministic_and_alone(kind, tmp_path, top):
    path = tmp_path / f"picture.{kind}"
    contents = []
    for _ in range(2):
        save(stability_map(top, "omega (rad/s)", "Top"), path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert contents[0].startswith(MAGIC[kind])
    assert b"Date" not in contents[0]
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if kind == "pdf":
        assert b"/FontFile2" in contents[0]
    if kind == "svg":
        assert b"<text" not in contents[0]


def test_another_suffix_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ValueError, match=r"\.png, \.svg, \.pdf"):
        save(stability_map(oscillator(), "p", ""), tmp_path / "picture.bmp")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")
    figure = stability_map(oscillator(), "p", "")

    def fail(stream, **settings):
        stream.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        save(figure, path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["picture.png"]


def test_titles_in_other_scripts_do_not_warn(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save(stability_map(oscillator(), "p", "陀螺"), tmp_path / "a.png")


def test_settings_of_the_user_are_left_alone():
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 23.0}):
        stability_map(oscillator(), "p", "")
        assert mpl.rcParams["font.size"] == 23.0


def test_a_curve_that_hardly_changes_does_not_lie_on_the_frame():
    low, high = upward_range(np.linspace(2.0, 2.001, 11), 2.001)
    assert low == 0.0
    assert high > 2.1


@pytest.mark.parametrize(
    ("name", "parameter", "text"),
    [("rotating_pendulum", "Omega", "frequency in the turning frame (Hz)"), ("rigid_rotor", "Omega", "frequency (Hz)")],
)
def test_the_campbell_diagram_says_in_which_frame_frequencies_are(name, parameter, text):
    found = mbstab.load(f"{name}.yaml").sweep(parameter, np.linspace(6.0, 20.0, 9), detail=True)
    assert campbell(found, parameter, "").axes[0].get_ylabel() == text


# --- Campbell diagrams of rotors: senses of whirl, and crossings with their values ------------------------------------


def all_texts(figure):
    return [text.get_text() for text in figure.findobj(Text)]


def test_a_branch_without_frequency_is_no_branch_without_whirl():
    x = np.linspace(0.0, 10.0, 41)
    branches = np.column_stack([3j - 0.1 + 0.0 * x, -3j - 0.1 + 0.0 * x, -1.0 - x])
    senses = tuple(((0.0, 10.0, word),) for word in ("forward", "forward", ""))
    swept = replace(made(x, branches), orders=(1.0,), senses=senses)
    assert "no whirl" not in all_texts(campbell(swept, "omega (rad/s)", ""))


@pytest.mark.long
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
        shown = all_texts(figure)
        (left_out,) = (int(text.split()[0]) for text in shown if text.endswith("crossings without their value"))
        placed = [part for text in figure.axes[0].texts for part in text.get_text().split(", ")]
        values = [text for text in placed if re.fullmatch(r"[0-9.]+", text)]
        assert len(values) + left_out == len({(round(c.value, 3), c.frequency) for c in crossings})
        assert {f"{w:.4g}" for w in frequencies} <= set(values)  # of the order 1, though the last in the list
        assert any(text.startswith("branch") for text in placed)
        counts[size] = len(values)
    assert counts["column"] < 0.5 * counts["page"]
    few = replace(swept, orders=orders[:2], crossings=crossings[:2])
    assert not any("without" in text for text in all_texts(campbell(few, "omega (rad/s)", "")))


# --- margins in Bode diagrams -----------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["dc_motor_arm", "levitation", "whipple_bicycle", "wheeled_inverted_pendulum"])
def test_bode_diagrams_show_the_margins_that_are_printed(name):
    """Each as a step from the response itself, at its frequency, to 0 dB or to an odd multiple of 180 degrees."""
    result = mbstab.load(f"{name}.yaml").response()
    figure = response_picture(result, "")
    count = 0
    for axes, of_gain in zip(figure.axes, (True, False), strict=True):
        steps = [line for line in axes.get_lines() if line.get_marker() == "o"]
        inside = [
            (k, x)
            for k, own in enumerate(result.margins)
            for x in (own.gain if of_gain else own.phase)
            if result.x[0] <= x.frequency <= result.x[-1]
        ]
        assert len(steps) == len(inside)
        texts = " ".join(text.get_text() for text in axes.texts)
        for step, (k, margin) in zip(steps, inside, strict=True):
            (omega, _), (start, end) = step.get_data()
            value = result.exact.over(np.array([omega]))[0][result.exact.number(result.channels[k])][0]
            assert omega == margin.frequency
            assert start == pytest.approx(decibels(value) if of_gain else start, abs=1e-6)
            assert end % 360.0 == pytest.approx(0.0 if of_gain else 180.0)
            if not of_gain:
                assert (start - np.degrees(np.angle(value)) + 90.0) % 360.0 == pytest.approx(90.0, abs=1e-6)
            size = decibels(margin.factor) if of_gain else margin.phase
            assert f"{size:.3g}".replace("-", "\N{MINUS SIGN}") in texts
            assert axes.get_ylim()[0] <= min(start, end) <= max(start, end) <= axes.get_ylim()[1]
            count += 1
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("gain and phase margins" in legend) == (count > 0)
    assert count >= 1


# --- the descriptor pencil --------------------------------------------------------------------------------------------


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
    result = run("linearize", "pendulum.yaml", "--plot", "pencil", "--pictures", str(tmp_path / "a.pdf"))
    assert result.exit_code == 0
    assert (tmp_path / "a-pencil.pdf").stat().st_size > 3000


@pytest.mark.parametrize("arguments", [("--plot", "pencil"), ("--plot", "pencil", "--pictures", "a.png")])
def test_symbols_are_not_drawn(arguments):
    result = run("linearize", "pendulum.yaml", "--symbolic", *arguments)
    assert result.exit_code == 2
    assert "--plot draws numbers" in result.stderr
