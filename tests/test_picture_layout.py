"""Axes and sizes of pictures: logarithmic ones, labels, and nothing that is cut off or too small to read."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text
from PIL import Image

import mbstab
from mbstab.analysis.simulate.mode_shape import Swing
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.sweep import OrderCrossing, Sweep
from mbstab.cli import main
from mbstab.report.animation.stills import mode_stills
from mbstab.report.picture_sizes import SIZES, scaled, size, sized
from mbstab.report.pictures.bifurcation import bifurcation
from mbstab.report.pictures.campbell import campbell
from mbstab.report.pictures.curves import branch_ink
from mbstab.report.pictures.drawing import title_lines
from mbstab.report.pictures.over_parameter import panels_over_parameter
from mbstab.report.pictures.pencil import pencil_pattern
from mbstab.report.pictures.point_labels import drawn_points
from mbstab.report.pictures.root_locus import root_locus
from mbstab.report.pictures.scales import Axis
from mbstab.report.pictures.sensitivity_bars import sensitivity_bars
from mbstab.report.pictures.spectrum import spectrum
from mbstab.report.pictures.stability_chart import chart
from mbstab.report.pictures.stability_map import stability_map
from mbstab.report.pictures.sweep_curves import SweepCurves


def swept(x, pairs, critical=()):
    """Return a sweep with pairs of eigenvalues given by their upper ones, shape (points, pairs)."""
    upper = np.column_stack(pairs)
    branches = np.stack([upper, upper.conj()], axis=2).reshape(len(x), -1)
    unstable = np.sum(branches.real > 0.0, axis=1)
    found = tuple(Critical(value, kind, (0,), 1.0, (0, 2)) for value, kind in critical)
    return Sweep("k", np.asarray(x), branches, unstable, 0, found, (), {})


def shown(axes):
    """Return the numbers along the horizontal axis of a panel: place, text and box of those in its range."""
    axes.figure.draw_without_rendering()
    low, high = axes.get_xlim()
    ticks = [*axes.xaxis.get_major_ticks(), *axes.xaxis.get_minor_ticks()]
    within = [t for t in ticks if low * (1 - 1e-9) <= t.get_loc() <= high * (1 + 1e-9) and t.label1.get_text()]
    return sorted((t.get_loc(), t.label1.get_text(), t.label1.get_window_extent()) for t in within)


RANGES = [(0.05, 1.0), (2.0, 3.0), (1e5, 6e5), (0.4, 200.0), (1e-4, 1e4), (0.9, 95.0), (0.12, 0.19)]


@pytest.mark.parametrize("of", SIZES)
@pytest.mark.parametrize("ends", RANGES)
def test_numbers_of_logarithmic_axes_do_not_touch_and_are_true(ends, of):
    x = np.geomspace(*ends, 21)
    with sized(of):
        figure = stability_map(swept(x, [-1.0 + 1j * x]), Axis("k", "N/m", logarithmic=True), "t")
    numbers = shown(figure.axes[-1])
    assert len(numbers) >= 2
    for (*_, one), (*_, other) in pairwise(numbers):
        assert one.x1 + 2.0 < other.x0
    for place, text, _ in numbers:
        plain = text.replace("$", "").replace("{", "").replace("}", "").replace("−", "-")
        factor, _, power = plain.partition("10^")
        value = float(plain) if not power else float(factor.rstrip("·") or 1.0) * 10.0 ** int(power)
        assert value == pytest.approx(place, rel=1e-9)


def test_campbell_diagrams_and_bifurcation_diagrams_are_logarithmic_where_the_sweep_is():
    x = np.geomspace(1.0, 1e3, 31)
    result = swept(x, [-1.0 + 1j * np.sqrt(x)])
    for draw in (campbell, bifurcation):
        for logarithmic, scale in ((True, "log"), (False, "linear")):
            figure = draw(result, Axis("k", "N/m", logarithmic=logarithmic), "t")
            assert {axes.get_xscale() for axes in figure.axes} == {scale}


def test_a_long_logarithmic_sweep_keeps_its_small_values():
    x = np.geomspace(1e-3, 1e3, 20001)
    figure = stability_map(swept(x, [-2.0 + np.sin(20.0 * np.log10(x)) + 3j]), Axis("k", logarithmic=True), "t")
    line = max(figure.axes[0].get_lines(), key=lambda one: len(one.get_xdata()))
    along = np.asarray(line.get_xdata(), dtype=float)
    assert np.max(np.diff(np.log10(along[np.isfinite(along)]))) < 0.02


def test_a_short_stretch_of_large_real_parts_does_not_squeeze_the_others():
    """Of one that is -12 at a place and -1 elsewhere, beside -400/k, there is more than a corner."""
    k = np.linspace(1.0, 60.0, 60)
    pairs = [-1.0 - 11.0 * np.exp(-(((k - 15.0) / 4.0) ** 2)) + 1j, -400.0 / k + 3j]
    axes = stability_map(swept(k, pairs), Axis("k"), "t").axes[0]
    heights = axes.transAxes.inverted().transform(axes.transData.transform([(1.0, -6.0), (1.0, 0.0)]))[:, 1]
    assert heights[1] - heights[0] > 0.1


@pytest.mark.parametrize("real", [-3.0, 3.0])
def test_the_line_of_zero_is_in_every_map(real):
    x = np.linspace(1.0, 2.0, 21)
    low, high = stability_map(swept(x, [real + 0.1 * x + 1j]), "k", "t").axes[0].get_ylim()
    assert low < 0.0 < high


CLUSTERS = [
    [(1.0, "flutter"), (1.7, "divergence"), (8.0, "flutter")],
    [(5.0, "flutter"), (5.3, "divergence"), (5.6, "flutter"), (5.9, "fold")],
    [(9.0, "divergence"), (9.5, "flutter"), (9.9, "divergence")],
    [(float(k), "flutter") for k in range(1, 10)],
]


@pytest.mark.parametrize("of", SIZES)
@pytest.mark.parametrize("critical", CLUSTERS)
def test_pointers_to_critical_values_cross_no_label(critical, of):
    x = np.linspace(0.95, 10.0, 41)
    with sized(of):
        curves = SweepCurves(swept(x, [0.1 * (x - 5.0) + 1j], critical), Axis("k"))
        figure, (panel,), lost = panels_over_parameter(curves, "t", ("y",))
    figure.draw_without_rendering()
    labels = [(text, super(type(text), text).get_window_extent()) for text in panel.texts]
    assert lost == 0
    assert len(labels) == len(critical)
    for k, (text, own) in enumerate(labels):
        assert all(not own.overlaps(other) for _, other in labels[k + 1 :])
        if text.arrow_patch is None:
            continue
        pointer = text.arrow_patch.get_window_extent()
        assert pointer.width < 3.0  # upright
        crossed = [other for one, other in labels if one is not text and other.overlaps(pointer)]
        assert not crossed, (text.get_text(), critical)


def test_eigenvalues_beside_bars_have_the_minus_sign_of_axes():
    figure = sensitivity_bars(mbstab.load("car.yaml").sensitivities(), "t")
    axes = figure.axes[0]
    assert axes.get_title("left") == "−4.75755 ± 3.29645i 1/s"
    figure.draw_without_rendering()
    assert axes._left_title.get_window_extent().y0 >= axes.get_window_extent().y1  # no line strikes it


def test_lines_of_a_title_are_about_equally_long():
    title = "Bent drive shafts, one with a constant-velocity joint and one with Hooke's joint"
    lines = title_lines(title)
    assert " ".join(lines) == title
    assert len(lines) == 2
    assert min(map(len, lines)) > 0.6 * max(map(len, lines))
    assert title_lines("Short") == ["Short"]
    assert title_lines("") == []


def test_the_legend_tells_colours_from_styles_of_lines():
    figure = stability_map(mbstab.load("car_trailer.yaml").sweep("u", np.linspace(10.0, 45.0, 8), detail=True), "u", "")
    legend = figure.legends[0]
    entries = dict(zip([x.get_text() for x in legend.get_texts()], legend.legend_handles, strict=True))
    assert [entries[name].get_linestyle() for name in ("real part", "snaking")] == ["-", "None"]
    assert entries["snaking"].get_marker() == "o"


def test_many_branches_have_unlike_colours():
    """Colours of any two differ visibly, and are darker than the shade of unstable ranges."""
    inks = np.array([to_rgb(branch_ink(k)) for k in range(24)])
    apart = np.linalg.norm(inks[:, None] - inks, axis=2) + 9.0 * np.eye(len(inks))
    assert apart.min() > 0.07
    assert np.max(inks.mean(axis=1)) < 0.88


def test_no_frequency_of_a_campbell_diagram_is_negative():
    """Also where its axis is logarithmic: frequencies of 1.5 and 48 Hz."""
    text = """mbstab: 1
parameters: {n: {value: 10, unit: rad/s}}
bodies: {a: {type: planar, mass: 5, inertia: 0.2}, b: {type: planar, mass: 0.05, inertia: 0.2}}
forces:
  s: {type: bearing, between: [a, ground], stiffness: 450, damping: 1}
  t: {type: bearing, between: [b, ground], stiffness: 4500, damping: 0.1}
reference:
  coordinates: {a: {x: 0, y: 0, theta: 0}, b: {x: 0, y: 0, theta: 0}}
  rates: {a: {x: 0, y: 0, theta: n}, b: {x: 0, y: 0, theta: n}}
"""
    (axes,) = campbell(mbstab.loads(text).sweep("n", np.linspace(1.0, 500.0, 9), detail=True), Axis("n"), "").axes
    assert axes.get_yscale() == "asinh"
    assert axes.get_ylim()[0] == 0.0


# --- every command that draws knows the sizes -------------------------------------------------------------------------


WIDTHS = {"column": 85.0, "page": 170.0, "slide": 254.0}
"""Millimetres."""

COMMANDS = {
    "spectrum": "eig pendulum.yaml --plot spectrum",
    "pencil": "linearize pendulum.yaml --plot pencil",
    "chart": "sweep rolling_disk.yaml --param omega --param R --from 1,0.2 --to 8,0.5 --points 3,3",
    "energy": "simulate pendulum.yaml --to 0.1 --plot energy",
    "nyquist": "response dc_motor_arm.yaml --points 20 --plot nyquist",
}
"""Each with the name of its picture."""


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        main([*arguments])
    return stop.value.code


@pytest.mark.few(3)
@pytest.mark.parametrize(("name", "of"), [(n, s) for k, n in enumerate(COMMANDS) for s in [(*WIDTHS,)[k % 3]]])
def test_commands_draw_in_the_size_asked_for(name, of, tmp_path):
    assert not run(*COMMANDS[name].split(), "--pictures", str(tmp_path / "p.png"), "--size", of)
    with Image.open(tmp_path / f"p-{name}.png") as picture:
        assert picture.info["dpi"] == pytest.approx((SIZES[of].dpi,) * 2, abs=0.5)
        wide, high = (25.4 * n / SIZES[of].dpi for n in picture.size)
    assert wide == pytest.approx(WIDTHS[of], abs=0.2)
    assert of != "slide" or high == pytest.approx(143.0, abs=0.2)


def test_the_comparison_has_sizes_too(tmp_path):
    drawn = ("--plot", "error", "--pictures", str(tmp_path / "p.pdf"), "--size", "column")
    assert not run("compare", "pendulum.yaml", "--digits", "20", *drawn)
    box = (tmp_path / "p-error.pdf").read_bytes().partition(b"/MediaBox [")[2].partition(b"]")[0].split()
    assert float(box[2]) == pytest.approx(85.0 / 25.4 * 72.0, abs=0.1)


@pytest.mark.parametrize(
    "command", ["eig pendulum.yaml", "compare pendulum.yaml", "linearize pendulum.yaml --symbolic"]
)
def test_a_size_without_a_picture_is_refused(command, capsys):
    assert run(*command.split(), "--size", "slide") == 2
    assert "--size is that of pictures, and none is drawn" in capsys.readouterr().err


def test_the_size_ends_with_its_block():
    with sized("slide"):
        assert (size(), scaled(9.0)) == (SIZES["slide"], 12.0)
    assert (size(), scaled(9.0)) == (SIZES["page"], 9.0)


def sweep_with_names():
    """Return a sweep with names, critical values, orders, and one fast branch."""
    x = np.linspace(0.0, 50.0, 41)
    pairs = [(0.02 * x - 0.5) + 1j * (k + 0.1 * x) for k in (3.0, 9.0)] + [-90.0 + 400j + x]
    branches = np.column_stack([part for z in pairs for part in (z, z.conj())])
    changes = [Critical(25.0, "flutter", (0,), 5.5, (0, 4)), Critical(27.0, "divergence", (2,), 0.0, (4, 5))]
    unstable = np.sum(branches.real > 0.0, axis=1)
    crossings = (OrderCrossing(1.0, 3.3, 3.3, 0, "", ""), OrderCrossing(2.0, 4.7, 9.5, 2, "", "forward"))
    result = Sweep("omega", x, branches, unstable, 0, tuple(changes), (), {})
    return replace(result, names=("weave",) * 2 + ("wobble",) * 4, orders=(1.0, 2.0), crossings=crossings)


TITLE = "A system whose title is so long that it needs more than a single line in a column"


@pytest.fixture(scope="module")
def drawings():
    bicycle = mbstab.load("whipple_bicycle.yaml")
    result, linear, slopes = bicycle.eig(), bicycle.linearize(), mbstab.load("car.yaml").sensitivities()
    upper = [e for e in result.eigenvalues if e.vector is not None and e.value.imag >= 0.0]
    shaped = dict(enumerate(upper[:3], 1))
    swings: list[Swing] = [bicycle.swing(number, 4) for number in shaped]
    x = np.linspace(0.0, 10.0, 5)
    counts = np.add.outer(x, x).astype(int) // 4
    return {
        "map": lambda: stability_map(sweep_with_names(), "omega (rad/s)", TITLE),
        "locus": lambda: root_locus(sweep_with_names(), "omega (rad/s)", TITLE),
        "campbell": lambda: campbell(sweep_with_names(), "omega (rad/s)", TITLE),
        "spectrum": lambda: spectrum(result, TITLE),
        "chart": lambda: chart(x, x, counts, counts // 2, np.full((5, 5), "stable"), [], ("v (m/s)", "w"), TITLE),
        "pencil": lambda: pencil_pattern(linear, TITLE),
        "sensitivity": lambda: sensitivity_bars(slopes, TITLE),
        "modes": lambda: mode_stills(bicycle.system(), shaped, swings, TITLE),
    }


@pytest.mark.parametrize("of", WIDTHS)
@pytest.mark.parametrize("name", ["map", "locus", "campbell", "spectrum", "chart"])
def test_texts_hide_neither_each_other_nor_curves(name, of, drawings):
    with sized(of):
        figure = drawings[name]()
    figure.draw_without_rendering()
    for axes in figure.axes:
        scale = 72.0 / figure.dpi
        texts = [text for text in axes.texts if text.get_text()]
        boxes = [Text.get_window_extent(text) for text in texts]
        assert [t.get_text() for t, a in zip(texts, boxes, strict=True) if sum(a.overlaps(b) for b in boxes) > 1] == []
        frame = axes.get_window_extent()
        points = drawn_points(axes) / scale
        for text, box in zip(texts, boxes, strict=True):
            assert box.x1 < frame.x0 or box.y0 > frame.y1 or (box.x0 > frame.x0 and box.x1 < frame.x1), text.get_text()
            covered = (points > (box.x0, box.y0 + 1.0)) & (points < (box.x1, box.y1 - 1.0))
            assert name == "chart" or not covered.all(axis=1).any(), text.get_text()


@pytest.mark.long
@pytest.mark.parametrize("of", WIDTHS)
def test_texts_are_inside_the_picture_and_legible(of, drawings):
    for name, draw in drawings.items():
        with sized(of):
            figure = draw()
        figure.draw_without_rendering()
        sheet = figure.bbox
        assert (sheet.width, of != "slide" or sheet.height) == pytest.approx(
            (figure.dpi * WIDTHS[of] / 25.4, of != "slide" or figure.dpi * 143.0 / 25.4)
        )
        for text in figure.findobj(Text):
            assert text.get_fontsize() >= 6.0 or not text.get_text().strip(), (name, text.get_text())
        labels = [part for axes in figure.axes for part in (axes.xaxis.label, axes.yaxis.label, axes.title)]
        for box in (axes.yaxis.get_tightbbox() for axes in figure.axes):
            assert box is None or box.x0 >= sheet.x0, name
        assert figure.texts[0].get_text().replace("\n", " ") == TITLE
        entries = [entry for legend in figure.legends for entry in legend.get_texts()]
        for text in (*labels, *entries, *figure.texts):
            box = text.get_window_extent()
            if text.get_text():
                assert sheet.x0 - 1.0 <= box.x0 < box.x1 <= sheet.x1 + 1.0, (name, text.get_text())
                assert sheet.y0 - 1.0 <= box.y0 < box.y1 <= sheet.y1 + 1.0, (name, text.get_text())


@pytest.mark.long
@pytest.mark.parametrize("of", WIDTHS)
def test_pictures_with_many_panels_fit_a_page(of):
    model = mbstab.load("motorcycle.yaml")
    upper = [e for e in model.eig().eigenvalues if not e.exact and e.value.imag >= 0.0]
    for count in (2, len(upper), 3 * len(upper)):
        modes = {n: upper[n % len(upper)] for n in range(count)}
        swings = [model.swing(1 + n % len(upper), 4) for n in modes]
        with sized(of):
            figure = mode_stills(model.system(), modes, swings, TITLE)
        assert len(figure.axes) == count
        assert figure.get_figheight() < 240.0 / 25.4  # the text of a page
    with sized(of):
        figure = sensitivity_bars(model.sensitivities(), TITLE)
    assert len(figure.axes) == (2 if of == "slide" else 5)
    assert figure.get_figheight() < 240.0 / 25.4
