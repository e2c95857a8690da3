"""Root loci and stability maps of coarse sweeps: curves on the true ones, symmetric, with logarithmic axes."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from test_plots import curves, made, texts
from test_sweep import lagging

import mbstab
from mbstab.cli import main
from mbstab.report.pictures.root_locus import root_locus
from mbstab.report.pictures.scales import Axis, is_geometric
from mbstab.report.pictures.stability_map import stability_map

INERTIAS = (0.02, 0.3)


@pytest.fixture(scope="module")
def discs():
    return mbstab.loads(lagging(INERTIAS))


def drawn(figure):
    """The points of all branches, as complex numbers."""
    lines = [np.asarray(line.get_xydata()) @ [1.0, 1j] for line in curves(figure.axes[0])]
    return [z[~np.isnan(z)] for z in lines]


def off(z, J, last):
    """The distance from the eigenvalues of a disc at that P of the range for which z is nearest to one."""
    law = [0.005 * J, J, 10.0, 0.0]
    law[-1] = min(max(-np.polyval(law, z).real, 10.0), last)
    return np.min(np.abs(np.roots(law) - z))


@pytest.mark.parametrize("points", [3, 5, 21])
@pytest.mark.parametrize("last", [2500.0, 20000.0])
def test_every_point_of_a_locus_is_on_the_true_one(discs, points, last):
    """T J s³ + J s² + D s + P = 0 has a real P in the range at each point that is drawn."""
    figure = root_locus(discs.sweep("P", np.linspace(10.0, last, points)), "P", "")
    z = np.concatenate(drawn(figure))
    size = np.max(np.abs(z))
    distance = [min(off(s, J, last) for J in INERTIAS) for s in z[:: 1 + len(z) // 400]]
    assert np.max(distance) < 0.01 * size
    low, high = figure.axes[0].get_ylim()
    for J in INERTIAS:
        frequency = math.sqrt(10.0 / (0.005 * J))
        assert low < -frequency < frequency < high
        assert np.min(np.abs(z - 1j * frequency)) < 0.01 * size


@pytest.mark.parametrize(
    ("name", "parameter", "ends"), [("whipple_bicycle", "v", (0.1, 10)), ("top", "omega", (0, 10))]
)
@pytest.mark.parametrize("points", [4, 12, 31])
def test_loci_are_mirrored_at_the_real_axis(name, parameter, ends, points):
    figure = root_locus(mbstab.load(f"{name}.yaml").sweep(parameter, np.linspace(*ends, points)), parameter, "")
    lines = [(line.get_color(), line.get_linewidth(), line.get_xydata()) for line in curves(figure.axes[0])]
    mirrored = sorted((c, w, np.nan_to_num(xy * [1, -1]).tolist()) for c, w, xy in lines)
    own = sorted((c, w, np.nan_to_num(xy * [1, 1]).tolist()) for c, w, xy in lines)
    heights = [np.nanmax(np.abs(xy[:, 1])) for *_, xy in lines]
    assert max(heights) > 0.0
    assert [x for x in own if np.any(np.array(x[2])[:, 1])] == [x for x in mirrored if np.any(np.array(x[2])[:, 1])]


@pytest.mark.parametrize("points", [3, 8])
def test_coarse_maps_show_what_fine_ones_show(discs, points):
    coarse, fine = (
        stability_map(discs.sweep("P", np.linspace(10.0, 20000.0, n)), "P", "").axes[0] for n in (points, 1001)
    )
    assert coarse.get_ylim() == pytest.approx(fine.get_ylim(), rel=0.02)


def test_a_search_that_ended_early_is_marked(discs, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.branch_looks", 4)
    result = discs.sweep("P", np.linspace(10.0, 20000.0, 12))
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


@pytest.mark.parametrize("spaced", [True, False])
def test_maps_have_the_axis_of_their_values(discs, spaced):
    x = (np.geomspace if spaced else np.linspace)(10.0, 20000.0, 12)
    axis = Axis("P", "N*m/rad", logarithmic=is_geometric(x))
    figure = stability_map(discs.sweep("P", x), axis, "")
    assert {axes.get_xscale() for axes in figure.axes} == {"log" if spaced else "linear"}
    (label,) = (text for text in figure.axes[0].texts if text.get_text().startswith("2000 flutter"))
    line = figure.axes[0].transData.transform((2000.0, 0.0))[0]
    at = figure.axes[0].transAxes.transform((label.get_position()[0], 0.0))[0]
    assert at == pytest.approx(line, abs=0.1 * figure.bbox.width)


def test_log_draws_logarithmic_axes(discs, tmp_path, monkeypatch):
    kept = []
    monkeypatch.setattr("mbstab.cli.commands.sweep.save_picture", lambda draw, path: kept.append(draw()))
    path = tmp_path / "discs.yaml"
    path.write_text(lagging(INERTIAS))
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
