"""Sizes of pictures: every command that draws knows them, and nothing is cut off or too small to read."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image

import mbstab
from mbstab.analysis.simulate.mode_shape import Swing
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.sweep import OrderCrossing, Sweep
from mbstab.cli import main
from mbstab.report.animation.stills import mode_stills
from mbstab.report.picture_sizes import SIZES, scaled, size, sized
from mbstab.report.pictures.campbell import campbell
from mbstab.report.pictures.pencil import pencil_pattern
from mbstab.report.pictures.point_labels import drawn_points
from mbstab.report.pictures.root_locus import root_locus
from mbstab.report.pictures.sensitivity_bars import sensitivity_bars
from mbstab.report.pictures.spectrum import spectrum
from mbstab.report.pictures.stability_chart import chart
from mbstab.report.pictures.stability_map import stability_map

WIDTHS = {"column": 85.0, "page": 170.0, "slide": 254.0}
"""Millimetres."""

COMMANDS = {
    "spectrum": "eig pendulum.yaml --plot spectrum",
    "pencil": "linearize pendulum.yaml --plot",
    "chart": "sweep rolling_disk.yaml --param omega --param R --from 1,0.2 --to 8,0.5 --points 3,3",
    "energy": "simulate pendulum.yaml --to 0.1 --plot energy",
    "nyquist": "response dc_motor_arm.yaml --points 20 --plot nyquist",
}
"""Each with the name of its picture."""


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        main([*arguments])
    return stop.value.code


@pytest.mark.parametrize(("name", "of"), [(n, s) for k, n in enumerate(COMMANDS) for s in [(*WIDTHS,)[k % 3]]])
def test_commands_draw_in_the_size_asked_for(name, of, tmp_path):
    assert not run(*COMMANDS[name].split(), "--pictures", str(tmp_path / "p.png"), "--size", of)
    with Image.open(tmp_path / f"p-{name}.png") as picture:
        assert picture.info["dpi"] == pytest.approx((SIZES[of].dpi,) * 2, abs=0.5)
        wide, high = (25.4 * n / SIZES[of].dpi for n in picture.size)
    assert wide == pytest.approx(WIDTHS[of], abs=0.2)
    assert of != "slide" or high == pytest.approx(143.0, abs=0.2)


def test_the_comparison_has_sizes_too(tmp_path):
    goal = tmp_path / "p.pdf"
    assert not run("compare", "pendulum.yaml", "--digits", "20", "--plot", str(goal), "--size", "column")
    box = goal.read_bytes().partition(b"/MediaBox [")[2].partition(b"]")[0].split()
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


def swept():
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
        "map": lambda: stability_map(swept(), "omega (rad/s)", TITLE),
        "locus": lambda: root_locus(swept(), "omega (rad/s)", TITLE),
        "campbell": lambda: campbell(swept(), "omega (rad/s)", TITLE),
        "spectrum": lambda: spectrum(result, TITLE),
        "chart": lambda: chart(x, x, counts, counts // 2, [], ("v (m/s)", "w"), TITLE),
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
