"""Pictures of eigenvalues in the complex plane, of multipliers, and root loci."""

import math
import re
from itertools import combinations

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.text import Text
from test_pictures import curves, made, texts
from test_sweep import lagging

import mbstab
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.cli import main
from mbstab.report.pictures.drawing import house_style, titled_figure
from mbstab.report.pictures.point_labels import PointLabels
from mbstab.report.pictures.root_locus import root_locus
from mbstab.report.pictures.scales import Axis, is_geometric
from mbstab.report.pictures.spectrum import spectrum
from mbstab.report.pictures.stability_map import stability_map


def drawn(figure):
    """Return the markers of a picture by what they say, and its texts."""
    (axes,) = figure.axes
    points = {line.get_marker(): line.get_xydata() for line in axes.get_lines() if line.get_linestyle() == "None"}
    texts = [text.get_text() for text in (*axes.texts, *figure.legends[0].get_texts())]
    return axes, points, texts


def test_eigenvalues_are_where_they_are_with_their_names():
    result = mbstab.load("whipple_bicycle.yaml").eig(v=3)
    _, points, texts = drawn(spectrum(result, "bicycle"))
    growing = [(1.7067560567397352, 2.3158244738432436), (1.7067560567397352, -2.3158244738432436)]
    assert np.allclose(points["s"], growing)
    assert np.allclose(sorted(points["o"][:, 0]), [-10.3510146724592282, -2.6336613725366530])
    assert {"weave", "capsize", "castering", "neutral, 6×", "0.7"} <= set(texts)


def test_lines_of_equal_damping_have_their_ratio():
    result = mbstab.load("ziegler_column.yaml").eig()
    axes, _, _ = drawn(spectrum(result, ""))
    ratios = set()
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xydata(), dtype=float).T
        if len(x) == 601:  # a ray, not an arc
            ratios.add(round(-x[-1] / np.hypot(x[-1], y[-1]), 12))
    assert ratios == {0.05, 0.1, 0.2, 0.4, 0.7}


@pytest.mark.parametrize("name", ["dc_motor_arm", "car_trailer", "motorcycle", "flyball_governor", "wheelset_creep"])
def test_damping_ratios_are_written_beside_eigenvalues(name):
    figure = spectrum(mbstab.load(f"{name}.yaml").eig(), "")
    figure.draw_without_rendering()
    axes, points, _ = drawn(figure)
    places = axes.transData.transform(np.concatenate(list(points.values())))
    written = [text for text in axes.texts if text.get_text().startswith("0.")]
    assert len(written) > 1
    for text in written:
        box = text.get_window_extent().expanded(1.0, 1.0).padded(3.0)
        assert not any(box.contains(x, y) for x, y in places), text.get_text()


@pytest.mark.parametrize("far", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("angle", range(0, 360, 30))
def test_a_label_stands_beside_its_own_marker(far, angle):
    """Of two markers near each other, the one that is named is nearer to the name, or a line leads there."""
    with house_style():
        figure, (axes,) = titled_figure("", heights=(5.0,))
        axes.set_xlim(-5.0, 5.0)
        axes.set_ylim(-5.0, 5.0)
        other = far * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        axes.plot([0.0, other[0]], [0.0, other[1]], "o", zorder=5)
        labels = PointLabels(axes)
        labels.add(0.0, 0.0, "sway")
        labels.draw()
        figure.draw_without_rendering()
    (text,) = axes.texts
    if text.arrow_patch is None:
        box = Text.get_window_extent(text)
        own, wrong = (
            np.hypot(*np.maximum(0.0, np.maximum(box.min - place, place - box.max)))
            for place in axes.transData.transform([(0.0, 0.0), other])
        )
        assert own < wrong


def pointers(axes):
    """The lines from labels to their points: from the middle of the text."""
    found = []
    for text in axes.texts:
        if text.arrow_patch is not None:
            box = Text.get_window_extent(text)
            found.append((0.5 * (box.min + box.max), axes.transData.transform(text.xy)))
    return found


def crosses(one, other):
    """Whether two lines cross, apart from common ends."""
    (a, b), (c, d) = one, other

    def side(p, q, r):
        return np.sign(np.linalg.det(np.array([q - p, r - p])))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("wide", [0.05, 0.15, 0.4])
def test_labels_do_not_overlap_and_their_pointers_do_not_cross(seed, wide):
    """What has no room is in the legend; markers that cover each other share a label."""
    places = 0.45 + wide * np.random.default_rng(seed).random((9, 2))
    with house_style():
        figure, (axes,) = titled_figure("", heights=(5.0,))
        axes.set_xlim(0.0, 1.0)
        axes.set_ylim(0.0, 1.0)
        labels = PointLabels(axes)
        for n, (x, y) in enumerate(places.tolist()):
            axes.plot(x, y, "o", zorder=5)
            labels.add(x, y, f"value {n}")
        left_out = labels.left_out()
        labels.draw()
        figure.draw_without_rendering()
    written = " ".join([text.get_text() for text in axes.texts] + [label.text for label in left_out])
    assert sorted(re.findall(r"\d", written)) == [str(n) for n in range(9)]
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert not any(crosses(a, b) for a, b in combinations(pointers(axes), 2))


def test_markers_that_cover_each_other_share_a_label():
    with house_style():
        _, (axes,) = titled_figure("", heights=(5.0,))
        axes.set_xlim(0.0, 1.0)
        axes.set_ylim(0.0, 1.0)
        labels = PointLabels(axes)
        for x, text in ((0.5, "u = 5.9 m/s"), (0.505, "u = 10.7 m/s"), (0.9, "u = 55 m/s")):
            labels.add(x, 0.5, text)
        labels.draw()
    assert [text.get_text() for text in axes.texts] == ["u = 5.9, 10.7 m/s", "u = 55 m/s"]


def test_numbers_of_crowded_branches_stand_beside_their_curves():
    """Where there is room along a curve, no pointer is needed."""
    x = np.linspace(0.0, 1.0, 51)
    heights = (-3000.0, -5000.0, -7500.0, -14000.0)
    branches = np.column_stack([-50.0 + 40.0 * x + 3j, -50.0 + 40.0 * x - 3j, *(h - 20.0 * x for h in heights)])
    unstable = np.zeros(len(x), dtype=int)
    axes = stability_map(Sweep("q", x, branches, unstable, 0, (), (), {}), "q", "").axes[0]
    numbers = {text.get_text(): text for text in axes.texts}
    assert set(numbers) == {"1, 2", "3", "4", "5", "6"}
    axes.figure.draw_without_rendering()
    for text, curve in zip("3456", heights, strict=True):
        assert numbers[text].arrow_patch is None
        box = Text.get_window_extent(numbers[text])
        levels = {h: axes.transData.transform([(0.5, h - 10.0)])[0, 1] for h in heights}
        assert min(heights, key=lambda h: max(box.y0 - levels[h], levels[h] - box.y1)) == curve


def test_fast_eigenvalues_do_not_hide_slow_ones():
    axes, _, _ = drawn(spectrum(mbstab.load("flyball_governor.yaml").eig(), ""))
    assert axes.get_xscale() == "asinh"
    assert "logarithmic beyond" in axes.get_xlabel()


STIFF = """\
mbstab: 1
bodies:
  a: {type: planar_point, mass: 1}
  b: {type: planar_point, mass: 1}
  c: {type: planar_point, mass: 1}
constraints:
  rail_a: {holonomic: a.y}
  rail_b: {holonomic: b.y}
  rail_c: {holonomic: c.y}
forces:
  springs:
    type: expression
    on: {a.x: -a.x - 0.4*rate(a.x), b.x: -9*b.x - 0.2*rate(b.x), c.x: -1e8*c.x - 20*rate(c.x)}
reference:
  coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}, c: {x: 0, y: 0}}
"""


def test_one_fast_pair_does_not_hide_slow_ones():
    axes, points, _ = drawn(spectrum(mbstab.loads(STIFF).eig(), ""))
    upper = points["o"][points["o"][:, 1] > 0.0]
    places = axes.transAxes.inverted().transform(axes.transData.transform(upper))
    assert len(places) == 3
    for part in (0, 1):
        assert np.min(np.diff(np.sort(places[:, part]))) > 0.03


def test_scales_are_linear_where_nothing_is_hidden():
    for name in ("car.yaml", "zener.yaml"):
        axes, _, _ = drawn(spectrum(mbstab.load(name).eig(), ""))
        assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")


def test_discs_are_drawn_where_they_can_be_seen():
    result = mbstab.load("top.yaml").eig(omega="5.5677284")
    axes, _, _ = drawn(spectrum(result, ""))
    radii = sorted(patch.get_radius() for patch in axes.patches if hasattr(patch, "get_radius"))
    assert radii == sorted(e.error_bound for e in result.eigenvalues if np.isfinite(e.error_bound))


def test_multipliers_are_drawn_with_the_unit_circle():
    axes, points, texts = drawn(spectrum(mbstab.load("kapitza.yaml").eig(), ""))
    assert np.allclose(np.hypot(*points["D"].T), 1.0)
    assert axes.get_aspect() == 1.0
    assert "on the circle" in texts


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        main(["eig", *arguments])
    return stop.value.code


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_command_draws(suffix, tmp_path, capsys):
    goal = tmp_path / f"p.{suffix}"
    assert not run("pendulum.yaml", "--plot", "spectrum", "--pictures", str(goal))
    assert (tmp_path / f"p-spectrum.{suffix}").stat().st_size > 1000
    assert "Verdict: stable" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pendulum.yaml", "--pictures", "x.png"], "--pictures goes with --plot"),
        (["pendulum.yaml", "top.yaml", "--plot", "spectrum"], "--plot goes with a single file"),
        (["pendulum.yaml", "--plot", "spectrum", "--certify"], "--plot goes with a single file"),
        (["pendulum.yaml", "--plot", "spectrum", "--pictures", "x.gif"], "no picture ends with .gif"),
        (["pendulum.yaml", "--plot", "locus"], "spectrum"),
    ],
)
def test_mistakes_are_told(arguments, message, capsys):
    assert run(*arguments) == 2
    assert message in capsys.readouterr().err


# --- root loci and stability maps of coarse sweeps: curves on the true ones -------------------------------------------


INERTIAS = (0.02, 0.3)


@pytest.fixture(scope="module")
def discs():
    return mbstab.loads(lagging(INERTIAS))


def points_of_branches(figure):
    """The points of all branches, as complex numbers."""
    lines = [np.asarray(line.get_xydata()) @ [1.0, 1j] for line in curves(figure.axes[0])]
    return [z[~np.isnan(z)] for z in lines]


def off(z, J, last):
    """The distance from the eigenvalues of a disc at that P of the range for which z is nearest to one."""
    law = [0.005 * J, J, 10.0, 0.0]
    law[-1] = min(max(-np.polyval(law, z).real, 10.0), last)
    return np.min(np.abs(np.roots(law) - z))


@pytest.mark.few(1)
@pytest.mark.parametrize("points", [3, 5, 21])
@pytest.mark.parametrize("last", [2500.0, 20000.0])
def test_every_point_of_a_locus_is_on_the_true_one(discs, points, last):
    """T J s³ + J s² + D s + P = 0 has a real P in the range at each point that is drawn."""
    figure = root_locus(discs.sweep("P", np.linspace(10.0, last, points), detail=True), "P", "")
    z = np.concatenate(points_of_branches(figure))
    size = np.max(np.abs(z))
    distance = [min(off(s, J, last) for J in INERTIAS) for s in z[:: 1 + len(z) // 400]]
    assert np.max(distance) < 0.01 * size
    low, high = figure.axes[0].get_ylim()
    for J in INERTIAS:
        frequency = math.sqrt(10.0 / (0.005 * J))
        assert low < -frequency < frequency < high
        assert np.min(np.abs(z - 1j * frequency)) < 0.01 * size


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "parameter", "ends"), [("whipple_bicycle", "v", (0.1, 10)), ("top", "omega", (0, 10))]
)
@pytest.mark.parametrize("points", [4, 12, 31])
def test_loci_are_mirrored_at_the_real_axis(name, parameter, ends, points):
    figure = root_locus(
        mbstab.load(f"{name}.yaml").sweep(parameter, np.linspace(*ends, points), detail=True), parameter, ""
    )
    lines = [(line.get_color(), line.get_linewidth(), line.get_xydata()) for line in curves(figure.axes[0])]
    mirrored = sorted((c, w, np.nan_to_num(xy * [1, -1]).tolist()) for c, w, xy in lines)
    own = sorted((c, w, np.nan_to_num(xy * [1, 1]).tolist()) for c, w, xy in lines)
    heights = [np.nanmax(np.abs(xy[:, 1])) for *_, xy in lines]
    assert max(heights) > 0.0
    assert [x for x in own if np.any(np.array(x[2])[:, 1])] == [x for x in mirrored if np.any(np.array(x[2])[:, 1])]


@pytest.mark.few(1)
@pytest.mark.parametrize("points", [3, 8])
def test_coarse_maps_show_what_fine_ones_show(discs, points):
    coarse, fine = (
        stability_map(discs.sweep("P", np.linspace(10.0, 20000.0, n), detail=True), "P", "").axes[0]
        for n in (points, 1001)
    )
    assert coarse.get_ylim() == pytest.approx(fine.get_ylim(), rel=0.02)


def test_a_search_that_ended_early_is_marked(discs, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.branch_looks", 1)
    result = discs.sweep("P", np.linspace(10.0, 20000.0, 12), detail=True, meetings=True)
    assert any("ended after" in text for text in result.warnings)
    for draw in (root_locus, stability_map):
        assert any("branches uncertain" in text for text in texts(draw(result, "P", "")))


def test_equal_ratios_are_told_from_equal_steps():
    assert is_geometric(np.geomspace(0.05, 15.0, 31))
    assert is_geometric(np.geomspace(15.0, 0.05, 31))
    for x in (
        np.linspace(1.0, 2.0, 9),
        np.geomspace(1.0, 9.0, 2),
        np.array([1.0, 2.0, 5.0]),
        np.linspace(-1.0, 1.0, 4),
    ):
        assert not is_geometric(x)


@pytest.mark.few(1)
@pytest.mark.parametrize("spaced", [True, False])
def test_maps_have_the_axis_of_their_values(discs, spaced):
    x = (np.geomspace if spaced else np.linspace)(10.0, 20000.0, 12)
    axis = Axis("P", "N*m/rad", logarithmic=is_geometric(x))
    figure = stability_map(discs.sweep("P", x, detail=True), axis, "")
    assert {axes.get_xscale() for axes in figure.axes} == {"log" if spaced else "linear"}
    (label,) = (text for text in figure.axes[0].texts if text.get_text().startswith("2000 flutter"))
    line = figure.axes[0].transData.transform((2000.0, 0.0))[0]
    at = figure.axes[0].transAxes.transform((label.get_position()[0], 0.0))[0]
    assert at == pytest.approx(line, abs=0.1 * figure.bbox.width)


def test_log_draws_logarithmic_axes(discs, tmp_path, monkeypatch):
    kept = []
    monkeypatch.setattr("mbstab.cli.commands.sweep.save_picture", lambda draw, path: kept.append(draw()))
    path = tmp_path / "discs.yaml"
    path.write_text(lagging(INERTIAS), encoding="utf-8")
    given = ["sweep", str(path), "--param", "P", "--from", "10", "--to", "20000", "--points", "9", "--log"]
    assert CliRunner().invoke(main, [*given, "-o", str(tmp_path / "a.csv")]).exit_code == 0
    assert kept[0].axes[0].get_xscale() == "log"
    both = ["--param", "D", "--from", "1", "--to", "50", "--points", "5"]
    assert CliRunner().invoke(main, [*given, *both, "-o", str(tmp_path / "b.csv")]).exit_code == 0
    assert {kept[-1].axes[0].get_xscale(), kept[-1].axes[0].get_yscale()} == {"log"}


def test_pairs_that_touch_on_the_real_axis_have_a_number_each(recwarn):
    # Four real eigenvalues, close together, leave the axis as two pairs whose real parts never turn back.
    x = np.linspace(0.0, 1.0, 8001)
    columns = [
        np.where(x < 0.3, -8.0 + x, -8.0 + x + sign * far * 1j * np.maximum(x - 0.3, 0.0))
        for far in (9.0, 6.0)
        for sign in (1.0, -1.0)
    ]
    swept = made(x, np.column_stack(columns))
    axes = root_locus(swept, "p", "").axes[0]
    assert [text.get_text() for text in axes.texts if text.get_text().isdigit()] == ["1", "3"]
    assert not recwarn.list
