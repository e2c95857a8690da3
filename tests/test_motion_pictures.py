"""Pictures and animations of motions and mode shapes show what was computed; frames, shapes, files, errors."""

import math
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from children import child, command_line, ended, until
from click.testing import CliRunner
from matplotlib.colors import to_hex
from matplotlib.path import Path
from matplotlib.text import Text
from PIL import Image
from sampling import sample
from scipy.spatial import ConvexHull
from test_cli import run as run_command

import mbstab
from mbstab.analysis.simulate.mode_shape import swing
from mbstab.cli import main
from mbstab.errors import OutputError, UsageError
from mbstab.mechanics import contacts, joints
from mbstab.mechanics.bodies import SHAPES
from mbstab.mechanics.catalogue import Form
from mbstab.model.library import installed_models
from mbstab.report.animation import movie_files, outlines
from mbstab.report.animation.frames import FINE, Frames, motion_frames, swing_frames
from mbstab.report.animation.sketch import Sketch
from mbstab.report.animation.solids import Solid, hidden
from mbstab.report.animation.stage import TOUCHING, Stage
from mbstab.report.animation.stills import mode_stills
from mbstab.report.animation.view import View
from mbstab.report.picture_sizes import sized
from mbstab.report.pictures import motion_plots
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.drawing import save

PENDULUM = mbstab.load("pendulum.yaml")
DISK = mbstab.load("rolling_disk.yaml")

SHAPED = """\
mbstab: 1
title: All shapes
gravity: [0, 0, -9.81]
bodies:
  rod: {type: spatial, mass: 1, shape: {type: rod, length: 2, along: y}}
  can: {type: spatial, mass: 1, shape: {type: cylinder, radius: 0.5, length: 3, along: x}}
  plate: {type: spatial, mass: 1, shape: {type: disk, radius: 0.7}}
  ring: {type: spatial, mass: 1, shape: {type: hoop, radius: 0.4, along: y}}
  box: {type: spatial, mass: 1, shape: {type: box, x: 1, y: 2, z: 3}}
  ball: {type: spatial, mass: 1, shape: {type: sphere, radius: 0.6}, center_of_mass: [0, 0, 1]}
  pair:
    type: spatial
    parts:
      - {type: sphere, radius: 0.1, mass: 1, at: [1, 0, 0]}
      - {type: sphere, radius: 0.1, mass: 1, at: [-1, 0, 0]}
  grain: {type: point, mass: 1}
reference:
  coordinates:
    rod: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: pi/2}
"""


def text_of(name):
    return next(path for path in installed_models() if path.stem == name).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def pendulum():
    return PENDULUM.simulate(1.0, points=101, perturb={"rod.theta": 1.0}, tol=1e-6)


@pytest.fixture(scope="module")
def disk():
    return DISK.simulate(1.0, points=51, perturb={"disk.phi": 0.2}, tol=1e-5)


def drawn(text, sim, mechanism=PENDULUM):
    return motion_plots.draw(motion_plots.read_picture(mechanism.model, text), sim, mechanism.model.title)


def curves(axes):
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 2]


def legend(figure):
    return [text.get_text() for one in figure.legends for text in one.get_texts()]


def run(*arguments):
    return CliRunner().invoke(main, ["simulate", *map(str, arguments)])


# --- curves ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "label", "values"),
    [
        ("rod.theta", "rod.theta (rad)", lambda sim: sim.q[:, 2]),
        ("rod.x", "rod.x (m)", lambda sim: sim.q[:, 0]),
        ("rate(rod.theta)", "rate(rod.theta) (rad/s)", lambda sim: sim.u[:, 2]),
        ("rate( rod.x )", "rate(rod.x) (m/s)", lambda sim: sim.u[:, 0]),
        ("acceleration(rod.theta)", "acceleration(rod.theta) (rad/s²)", lambda sim: sim.a[:, 2]),
        ("force(pivot.y)", "force(pivot.y) (N)", lambda sim: sim.loads[:, 1]),
        ("kinetic", "kinetic energy (J)", lambda sim: sim.kinetic),
        ("total", "kinetic + potential", None),
    ],
)
def test_a_curve_is_the_data_with_its_unit(pendulum, text, label, values):
    figure = drawn(text, pendulum)
    (axes,) = figure.axes
    (line,) = curves(axes)
    assert axes.get_ylabel().startswith(label)
    assert axes.get_xlabel() == "time (s)"
    assert legend(figure) == []
    assert line.get_xdata().tolist() == pendulum.times.tolist()
    if values is not None:
        assert line.get_ydata().tolist() == values(pendulum).tolist()


def test_quantities_of_a_unit_share_a_panel_others_are_stacked(pendulum):
    figure = drawn("rod.theta, rod.x, rod.y, force(pivot)", pendulum)
    assert [axes.get_ylabel() for axes in figure.axes] == ["rod.theta (rad)", "length (m)", "force (N)"]
    assert [len(curves(axes)) for axes in figure.axes] == [1, 2, 2]
    assert legend(figure) == ["rod.x", "rod.y", "force(pivot.x)", "force(pivot.y)"]
    styles = {(line.get_color(), str(line.get_linestyle())) for axes in figure.axes[1:] for line in curves(axes)}
    assert len(styles) == 4


def test_the_energies_add_up_and_work_is_shown_where_it_is_done(pendulum):
    upper, lower = drawn("energy", pendulum).axes
    kinetic, potential, total = (np.asarray(line.get_ydata()) for line in curves(upper))
    np.testing.assert_allclose(kinetic + potential, total)
    np.testing.assert_array_equal(kinetic, pendulum.kinetic)
    # The sum is told from what it coincides with: below the others, and broad.
    lines = curves(upper)
    assert lines[2].get_zorder() < min(line.get_zorder() for line in lines[:2])
    assert lines[2].get_linewidth() >= 3.0 * max(line.get_linewidth() for line in lines[:2])
    assert potential.min() == 0.0
    assert lower.get_ylabel().startswith("energy drift (10⁻")
    assert lower.get_ylabel().endswith(" J)")
    model = mbstab.load("ziegler_column.yaml")
    sim = model.simulate(0.1, points=5, tol=1e-4)
    assert "work of other forces" in legend(drawn("energy", sim, model))


def test_energies_are_drawn_at_the_scale_at_which_they_change():
    model = mbstab.load("trailer.yaml")
    sim = model.simulate(1.0, points=21, perturb={"trailer.theta": 0.1}, tol=1e-6)
    least = sim.kinetic.min()
    assert np.ptp(sim.kinetic) < 0.01 * least
    figure = drawn("energy", sim, model)
    kinetic, potential, total, work = (np.asarray(line.get_ydata()) for line in curves(figure.axes[0]))
    assert f"kinetic energy less {least:.6g} J" in legend(figure)
    np.testing.assert_allclose(kinetic, sim.kinetic - least)
    np.testing.assert_allclose(total, kinetic + potential)
    np.testing.assert_array_equal(work, sim.work)
    # What changes by rounding only keeps its size.
    still = mbstab.load("free_rigid_body.yaml").simulate(0.1, points=3, tol=1e-6)
    assert "kinetic energy" in legend(drawn("energy", still, mbstab.load("free_rigid_body.yaml")))


def test_residuals_are_logarithmic_with_gaps_where_they_are_zero(pendulum):
    (axes,) = drawn("residuals", pendulum).axes
    assert axes.get_yscale() == "log"
    assert np.any(pendulum.residuals == 0.0)
    for line, column in zip(curves(axes), pendulum.residuals.T, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), np.where(column > 0.0, np.maximum(column, 1e-17), np.nan))
        assert line.get_marker() == "."  # of a value between two gaps there is no line


def test_residuals_are_seen_whatever_their_size(pendulum):
    for size in (1e-30, 3e-17, 1e-3):
        sim = replace(pendulum, residuals=np.full_like(pendulum.residuals, size))
        (axes,) = drawn("residuals", sim).axes
        low, high = axes.get_ylim()
        assert low < max(size, 1e-17) < high
        ticks = [tick for tick in axes.get_yticks() if low <= tick <= high]
        assert len(ticks) > 1
        assert all(np.all(line.get_ydata() == max(size, 1e-17)) for line in curves(axes))


def test_the_axis_of_energies_does_not_magnify_rounding(pendulum):
    noise = 1e-33 * np.arange(len(pendulum.times))
    sim = replace(pendulum, kinetic=noise, potential=noise - 2.5, work=0.0 * noise)
    upper, _ = drawn("energy", sim).axes
    assert upper.get_ylim()[1] - upper.get_ylim()[0] > 0.1
    assert upper.get_ylabel() == "energy (J)"


def test_energies_that_are_rounding_are_a_line_of_zero(pendulum):
    noise = 1e-117 * np.sin(np.arange(len(pendulum.times)))
    rest = replace(pendulum, kinetic=np.abs(noise), potential=noise, work=0.0 * noise, peak=1e-12)
    for axes in drawn("energy", rest).axes:
        assert axes.get_ylim() == (-1.0, 1.0)
        assert all(not np.any(line.get_ydata()) for line in curves(axes))
        assert [text.get_text() for text in axes.texts] == ["zero but for rounding"]
    # A drift of some units in the last place.
    steps = 2e-15 * (np.arange(len(pendulum.times)) % 5)
    flying = replace(pendulum, kinetic=7.0 + steps, potential=0.0 * steps, work=0.0 * steps)
    upper, lower = drawn("energy", flying).axes
    assert upper.get_ylim()[1] > 7.0
    assert not np.any(curves(lower)[0].get_ydata())
    drifting = replace(flying, kinetic=7.0 + 1e3 * steps)
    assert np.ptp(curves(drawn("energy", drifting).axes[1])[0].get_ydata()) == pytest.approx(8e-12, rel=1e-2)


def test_kinetic_energy_that_changes_by_errors_only_is_not_magnified(pendulum):
    error = 1e-6 * np.sin(np.arange(len(pendulum.times)))
    sim = replace(pendulum, kinetic=16.0 + error, potential=error, work=0.0 * error)
    figure = drawn("energy", sim)
    assert "kinetic energy" in legend(figure)
    assert figure.axes[0].get_ylim()[1] > 16.0
    swinging = replace(sim, potential=-error)  # their sum is constant
    assert "kinetic energy less 16 J" in legend(drawn("energy", swinging))


def test_residuals_that_are_all_zero_have_no_entry_in_the_legend(pendulum):
    still = replace(pendulum, residuals=pendulum.residuals * [0.0, 1.0])
    assert legend(drawn("residuals", still)) == ["velocities"]


def test_a_phase_plane_has_rates_over_coordinates_and_marked_ends(pendulum):
    figure = drawn("phase:rod.theta", pendulum)
    (axes,) = figure.axes
    (line,) = curves(axes)
    assert line.get_xdata().tolist() == pendulum.q[:, 2].tolist()
    assert line.get_ydata().tolist() == pendulum.u[:, 2].tolist()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("rod.theta (rad)", "rate(rod.theta) (rad/s)")
    assert legend(figure) == ["start, t = 0 s", "end, t = 1 s"]


def test_small_motions_are_drawn_from_what_they_share_in_powers_of_ten():
    sim = PENDULUM.simulate(1.0, points=21, perturb={"rod.theta": 1e-6}, tol=1e-6)
    (axes,) = drawn("rod.theta", sim).axes
    assert axes.get_ylabel() == "rod.theta (10⁻⁶ rad), less 4.712389"
    np.testing.assert_array_equal(curves(axes)[0].get_ydata(), sim.q[:, 2] - 4.712389)
    assert axes.yaxis.get_major_formatter()(-5e-7, 0) == "−0.5"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rod.tetha", "did you mean 'rod.theta'?"),
        ("rate(rod.tetha)", "did you mean 'rod.theta'?"),
        ("phase:rod.tetha", "did you mean 'rod.theta'?"),
        ("phase:rod", "coordinates: rod.x, rod.y, rod.theta"),
        ("phase:rod.x,rod.theta", "quantities in m and rad cannot"),
        ("enrgy", "did you mean 'energy'?"),
        ("speed(rod.x)", "there is no function 'speed'"),
        ("force(pivt)", "did you mean 'pivot'?"),
        ("force(pivot.z)", "components x, y"),
        (" , ", "names nothing"),
        (",".join(f"{f}(rod.{x})" for f in ("rate", "acceleration") for x in ("x", "y", "theta")) + ",rod.x,rod.y,"
         "rod.theta,kinetic,potential,total,work", "13 curves"),
    ],
)  # fmt: skip
def test_unknown_names_are_refused_before_anything_is_computed(text, message):
    result = run("pendulum.yaml", "--to", "1e9", "--plot", text)
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_reaction_that_is_not_transmitted_is_said(disk):
    with pytest.raises(UsageError, match=r"contact 'rolling' transmits no torque x"):
        drawn("torque(rolling.x)", disk, DISK)


def test_pictures_lie_where_those_of_sweeps_do(tmp_path):
    common = ("pendulum.yaml", "--to", "0.2", "--points", "5", "--tol", "1e-4")
    table = tmp_path / "a.csv"
    result = run(*common, "-o", table, "--plot", "rod.theta,rate(rod.theta)", "--plot", "energy")
    assert result.exit_code == 0
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv", "a-rod.theta-rate-rod.theta.png", "a-energy.png"}
    twice = ("--plot", "energy", "--plot", "energy", "--plot", "energy,", "--pictures", tmp_path / "c.pdf")
    assert run(*common, *twice).exit_code == 0
    assert {p.name for p in tmp_path.glob("c*")} == {"c-energy.pdf", "c-energy-2.pdf"}
    result = run(*common, "--plot", "phase:rod.theta", "--pictures", tmp_path / "b.svg")
    assert result.exit_code == 0
    assert (tmp_path / "b-phase-rod.theta.svg").read_bytes().startswith(b"<?xml")
    result = run(*common, "--plot", "energy", "--pictures", tmp_path / "b.jpg")
    assert result.exit_code == 2
    assert "no picture ends with .jpg" in result.stderr


def test_pictures_show_the_part_of_a_motion_that_ends_early(tmp_path):
    early = ("four_bar.yaml", "--to", "2", "--perturb", "rate(left.theta)=9", "--tol", "1e-4")
    result = run(*early, "--plot", "left.theta", "--pictures", tmp_path / "a", "--animate", tmp_path / "a.gif")
    assert result.exit_code == 1
    assert {p.name for p in tmp_path.iterdir()} == {"a-left.theta.png", "a.gif"}
    assert 3 <= len(durations(tmp_path / "a.gif")) <= 6


@pytest.mark.parametrize("text", ["energy", "residuals", "rod.theta,rod.x,force(pivot)", "phase:rod.theta"])
def test_nothing_is_cut_off_or_covered(pendulum, text):
    figure = drawn(text, pendulum)
    figure.draw_without_rendering()
    whole = figure.bbox
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert whole.x0 <= box.x0
        assert box.x1 <= whole.x1
    boxes = [axes.get_tightbbox() for axes in figure.axes] + [one.get_window_extent() for one in figure.legends]
    for i, one in enumerate(boxes):
        assert all(min(one.y1, other.y1) - max(one.y0, other.y0) < 3.0 for other in boxes[:i])


# --- shapes ---------------------------------------------------------------------------------------------------------


def test_every_shape_contact_and_joint_can_be_drawn():
    for shape in SHAPES.values():
        assert outlines.outline_of(shape.form(*(0.5 for _ in shape.fields))).strokes
    assert all(kind.look for kind in contacts.KINDS)
    # Bodies that are fixed to each other look like one.
    assert {kind.name for kind in joints.KINDS if kind.look is None} == {"fixed"}


def test_shapes_have_the_sizes_and_axes_of_the_file():
    system = mbstab.loads(SHAPED).system()
    drawing = Sketch.of(system)
    extent = {}
    for piece in drawing.pieces:
        points = np.concatenate([*piece.outline.strokes, piece.outline.skin])
        low, high = extent.get(drawing.bodies[piece.body], (np.inf, -np.inf))
        extent[drawing.bodies[piece.body]] = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    expected = {
        "rod": ([0, -1, 0], [0, 1, 0]),
        "can": ([-1.5, -0.5, -0.5], [1.5, 0.5, 0.5]),
        "plate": ([-0.7, -0.7, 0], [0.7, 0.7, 0]),
        "ring": ([-0.4, 0, -0.4], [0.4, 0, 0.4]),
        "box": ([-0.5, -1, -1.5], [0.5, 1, 1.5]),
        "ball": ([-0.6, -0.6, 0.4], [0.6, 0.6, 1.6]),
        "pair": ([-1.1, -0.1, -0.1], [1.1, 0.1, 0.1]),
    }
    assert extent.keys() == expected.keys()
    for name, bounds in expected.items():
        np.testing.assert_allclose(extent[name], bounds, atol=2e-3, err_msg=name)
    assert drawing.masses == [7]


@pytest.mark.parametrize("along", ["x", "y", "z"])
@pytest.mark.parametrize("shape", ["cylinder, radius: 0.5, length: 3", "disk, radius: 0.7", "hoop, radius: 0.4"])
def test_round_bodies_show_that_they_turn_from_every_side(shape, along):
    """Something seen moves when a body turns about its axis, and does not lie along an axis of the body."""
    text = (
        f"mbstab: 1\nbodies:\n  a: {{type: spatial, mass: 1, shape: {{type: {shape}, along: {along}}}}}\n"
        "reference:\n  coordinates: {a: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}\n"
    )
    (piece,) = Sketch.of(mbstab.loads(text).system()).pieces
    axis = "xyz".index(along)
    c, s = np.cos(0.3), np.sin(0.3)
    turned = np.roll(np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]), axis, axis=(0, 1))
    for towards in np.vstack([np.eye(3), -np.eye(3)]):
        ends = [
            {tuple(np.round((x - (x @ towards)[:, None] * towards)[[0, -1]].ravel(), 6) + 0.0) for x in seen}
            for seen in (
                [x for x in piece.outline.placed(frame, np.zeros(3)).seen(towards) if len(x) == 2]
                for frame in (np.eye(3), turned)
            )
        ]
        thin = not shape.startswith("cylinder") and not towards[axis]
        assert thin or ends[0] != ends[1]
        assert thin or all(ends)


def test_drawn_shapes_are_where_positions_and_rotations_say(disk):
    frames = motion_frames(disk, fps=50.0)
    stage = Stage(Sketch.of(DISK.system()), frames)
    for k in (0, 20, 50):
        circle, radius = stage.view.outline(0, k).strokes
        center, A = disk.positions[k, 0], disk.rotations[k, 0]
        np.testing.assert_allclose(circle[:-1].mean(axis=0), center, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(circle - center, axis=1), 0.3, rtol=1e-9)
        np.testing.assert_allclose((circle - center) @ A[:, 2], 0.0, atol=1e-9)
        assert circle[:, 2].min() == pytest.approx(0.0, abs=2e-3)
        np.testing.assert_allclose(radius[0], center, atol=1e-9)
    # As pixels: the middle of the filled outline is the place of the disk, seen from where one looks.
    stage.show(20)
    hull = stage.bodies.get_paths()[0].vertices[:-1]
    middle = 0.5 * (hull.max(axis=0) + hull.min(axis=0))
    np.testing.assert_allclose(middle, stage.view.across[:2] @ disk.positions[20, 0], atol=2e-3)


HIDING = """\
mbstab: 1
bodies:
  ball: {type: spatial, mass: 1, shape: {type: sphere, radius: 0.5}}
  beam: {type: spatial, mass: 1, shape: {type: box, x: 6, y: 0.1, z: 0.1}}
  fly: {type: point, mass: 1}
joints: {eye: {type: spherical, between: [ball, {body: ground, point: [0, 2, 0]}]}}
"""


def placed(angle, fly):
    """Return a ball, seen along y, a beam whose middle is at x = 1.5 and turned about z, and the places of a fly."""
    n = len(fly)
    positions, rotations = np.zeros((n, 3, 3)), np.tile(np.eye(3), (n, 3, 1, 1))
    positions[:, 1] = [1.5, -0.5, 0.0]
    positions[:, 2] = fly
    rotations[:, 1] = [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    trail = np.repeat(positions, FINE, axis=0), np.repeat(rotations, FINE, axis=0)
    return Stage(
        Sketch.of(mbstab.loads(HIDING).system()), Frames(25.0, [""] * n, positions, rotations, trail),
        view=(0.0, -90.0), traces=["fly"],
    )  # fmt: skip


@pytest.mark.parametrize(
    # Where it passes the ball the beam is behind or before it; its middle is always nearer than the ball.
    ("angle", "last"),
    [(-0.7, "ball"), (0.0, "beam")],
)
def test_what_is_nearer_covers_what_is_behind_it(angle, last):
    stage = placed(angle, np.zeros((1, 3)))
    np.testing.assert_allclose(stage.view.across[2], [0.0, -1.0, 0.0], atol=1e-12)
    stage.show(0)
    radii = [np.ptp(path.vertices[:, 1]) for path in stage.bodies.get_paths()]
    assert radii == pytest.approx([0.1, 1.0] if last == "ball" else [1.0, 0.1], abs=0.01)
    # Of the straight edges of the beam none shows where the ball covers it.
    inside = [x for x in stage.edges.get_segments() if np.allclose(abs(x[:, 1]), 0.05) and np.any(abs(x[:, 0]) < 0.4)]
    assert bool(inside) is (last == "beam")


def test_paths_and_joints_behind_a_body_are_hidden_by_it():
    x = np.linspace(-1.0, 1.0, 21)
    for y, seen in ((1.0, False), (-1.0, True)):
        stage = placed(0.0, np.stack([x, np.full(21, y), np.full(21, 0.2)], axis=1))
        stage.show(20)
        across, up = stage.paths[0].get_data()
        assert np.all(np.isnan(across) == np.isnan(up))
        assert np.any(np.abs(across) < 0.4) == seen
        assert (np.nanmin(across), np.nanmax(across)) == pytest.approx((-1.0, 1.0))
        eye = next(k for k, (line, _) in enumerate(stage.marked) if line.get_marker() == "o")
        assert len(stage.behind[eye].get_xdata()) == 1
    planar = Stage(Sketch.of(PENDULUM.system()), swing_frames(PENDULUM.swing(1, points=4), 1), traces=["rod"])
    assert planar.paths[0].get_zorder() < planar.bodies.get_zorder()


def test_a_thin_plate_hides_what_is_behind_it():
    plate = "bodies:\n  ball: {type: spatial, mass: 1, shape: {type: disk, radius: 0.5, along: y}}\n"
    model = mbstab.loads(
        HIDING.replace("bodies:\n  ball: {type: spatial, mass: 1, shape: {type: sphere, radius: 0.5}}\n", plate)
    )
    towards = np.array([0.0, -1.0, 0.0])
    solid = Solid.of(Sketch.of(model.system()).pieces[0].outline.skin)
    x = np.linspace(-0.9, 0.9, 7)
    for y, behind in ((0.5, True), (0.0, False), (-0.5, False)):
        stage = placed(0.0, np.zeros((1, 3)))
        np.testing.assert_allclose(stage.view.across[2], towards, atol=1e-12)
        points = np.stack([x, np.full(7, y), np.zeros(7)], axis=1)
        covered = hidden(points, [solid], towards, TOUCHING * stage.view.width)
        assert covered.tolist() == [behind and abs(p) < 0.5 for p in x]


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_solids_of_any_size_and_flat_ones_are_where_their_corners_are(size):
    cube = size * np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    solid = Solid.of(cube)
    assert len(solid.faces) == 6
    first, last = solid.through(size * np.array([[0.5, 0.2, -3.0], [1.5, 0.0, -3.0]]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose([first[0], last[0]], [2.0 * size, 4.0 * size])
    assert last[1] < first[1]
    plate = Solid.of(cube[np.abs(cube[:, 0] - size) < 0.1 * size])
    first, last = plate.through(np.zeros((1, 3)), np.array([1.0, 0.0, 0.0]))
    assert 0.5 * (first + last) == pytest.approx(size)
    assert 0.0 < last - first < 1e-3 * size


def test_a_drawing_is_shown_instead_of_the_shape_and_changes_nothing():
    top = mbstab.load("top.yaml")
    text = text_of("top")
    bare = mbstab.loads(
        "".join(line for line in text.splitlines(True) if "drawing" not in line and "cylinder" not in line)
    )
    assert [e.value for e in top.eig().eigenvalues] == [e.value for e in bare.eig().eigenvalues]
    assert top.system().scene.lengths == bare.system().scene.lengths
    cone, stem = (piece.outline for piece in Sketch.of(top.system()).pieces)
    # The tip is at the fixed point, 0.04 m below the centre of mass, the base a third of that above it.
    assert cone.skin[:, 2].min() == pytest.approx(-0.04)
    assert cone.skin[:, 2].max() == pytest.approx(0.04 / 3.0) == pytest.approx(stem.skin[:, 2].min())
    assert len(Sketch.of(bare.system()).pieces) == 2  # a line to the fixed point, and the axes


def test_a_knife_edge_is_drawn_over_its_body():
    pieces = Sketch.of(mbstab.load("chaplygin_sleigh.yaml").system()).pieces
    assert [len(piece.outline.skin) > 0 for piece in pieces] == [True, False]


@pytest.mark.parametrize("name", ["motorcycle", "whipple_bicycle", "rattleback", "wheeled_inverted_pendulum"])
def test_wheels_stay_on_the_ground_in_every_mode(name):
    mechanism = mbstab.load(name + ".yaml")
    sketch = Sketch.of(mechanism.system())
    assert sketch.planes
    for number in range(1, 3):
        view = View(sketch, swing_frames(mechanism.swing(number, 8), number))
        assert view.sunk()[1] < 0.002 * view.width


def test_what_passes_through_the_ground_is_told(tmp_path):
    text = text_of("wheeled_inverted_pendulum")
    (tmp_path / "low.yaml").write_text(text.replace("R_d: {value: 0.2", "R_d: {value: 0.1"), encoding="utf-8")
    command = ["simulate", str(tmp_path / "low.yaml"), "--to", "1.5", "--perturb", "pendulum.theta=0.3", "--animate"]
    answer = CliRunner().invoke(main, [*command, str(tmp_path / "low.gif"), "--fps", "5"])
    assert answer.exit_code == 0, answer.output
    assert "pendulum is drawn as much as" in answer.stderr
    assert "below the ground: nothing in the model keeps it above" in answer.stderr


@pytest.mark.parametrize(("turn", "rims"), [(0.0, 2), (1.5, 1)])
def test_a_ring_is_seen_with_its_hole_unless_from_the_side(turn, rims):
    torus = outlines.outline_of(Form("torus", (0.3, 0.1)))
    across = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(turn), math.sin(turn)], [0.0, -math.sin(turn), math.cos(turn)]])
    found = torus.rims(across)
    assert len(found) == rims
    assert np.abs(found[0][:, 0]).max() == pytest.approx(0.4, rel=1e-3)
    assert np.abs(found[0][:, 1]).max() == pytest.approx(0.3 * math.cos(turn) + 0.1, rel=1e-3)
    if rims == 2:
        np.testing.assert_allclose(np.linalg.norm(found[1], axis=1), 0.2, rtol=1e-3)


def test_a_torus_shows_its_near_side_only():
    torus = outlines.outline_of(Form("torus", (0.3, 0.1)))
    for towards in np.eye(3):
        seen = np.concatenate(torus.seen(towards))
        place = seen - 0.3 * seen * [1, 1, 0] / np.hypot(seen[:, 0], seen[:, 1])[:, None]
        np.testing.assert_allclose(np.linalg.norm(place, axis=1), 0.1, rtol=1e-9)
        assert np.all(place @ towards > -0.06)
        assert len(torus.seen(towards)) < 0.7 * len(torus.strokes)


def test_a_spring_in_space_winds_about_its_axis():
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    across = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    points = outlines.windings(ends, 0.1, across, 3)
    radius = np.hypot(points[:, 0], points[:, 1])
    assert radius.max() == pytest.approx(0.1)
    turned = np.unwrap(np.arctan2(points[radius > 0.01, 1], points[radius > 0.01, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2.0 * math.pi * outlines.WINDINGS, rel=0.1)
    assert points[[0, -1]].tolist() == ends.tolist()


def test_a_planar_scene_is_seen_along_z_with_pins_and_paths(pendulum):
    stage = Stage(Sketch.of(PENDULUM.system()), motion_frames(pendulum), traces=["rod", "rod.O"])
    stage.show(10)
    k = 40  # 25 frames and 100 times in a second
    (verts,) = (path.vertices for path in stage.bodies.get_paths())
    np.testing.assert_allclose(verts, [[0.0, 0.0], pendulum.positions[k, 0]], atol=1e-9)
    np.testing.assert_allclose(np.array(stage.paths[0].get_data()).T[-1], pendulum.positions[k, 0], atol=1e-9)
    path = np.array(stage.paths[1].get_data())
    assert path.shape == (2, 10 * FINE + 1)
    np.testing.assert_allclose(path[:, ::FINE], 0.0, atol=1e-9)
    np.testing.assert_allclose(path, 0.0, atol=1e-4)
    assert stage.caption.get_text() == "t = 0.40 s"
    assert stage.axes.get_xlabel() == "x (m)"
    scale = [stage.axes.transData.transform(p) for p in ((0, 0), (0.1, 0), (0, 0.1))]
    assert scale[1][0] - scale[0][0] == pytest.approx(scale[2][1] - scale[0][1], rel=1e-6)


def test_limits_hold_the_whole_motion(disk):
    stage = Stage(Sketch.of(DISK.system()), motion_frames(disk))
    for k in range(len(stage.view.frames.captions)):
        seen = stage.view.outline(0, k).strokes[0] @ stage.view.across[:2].T
        assert np.all(seen > stage.view.low)
        assert np.all(seen < stage.view.high)


@pytest.mark.parametrize("name", ["drive_shafts", "bricard", "top", "rigid_rotor"])
def test_no_body_meets_the_scale_bar_or_the_ground_axes(name):
    model = mbstab.load(f"{name}.yaml")
    stage = Stage(Sketch.of(model.system()), swing_frames(model.swing(1, 8), 1, 8.0))
    stage.figure.draw_without_rendering()
    (bar,) = stage.axes.lines[:1]
    marks = [bar.get_window_extent(), *(Text.get_window_extent(x) for x in stage.axes.texts if x.get_text())]
    for k in range(len(stage.view.frames.captions)):
        for number in range(len(stage.view.sketch.pieces)):
            outline = stage.view.outline(number, k)
            points = np.concatenate([*outline.strokes, outline.skin]) @ stage.view.across[:2].T
            shown = Path(stage.axes.transData.transform(points)[ConvexHull(points).vertices])
            assert not any(shown.intersects_bbox(mark) for mark in marks)


def test_what_is_followed_stays_in_place_and_the_ground_moves(disk):
    stage = Stage(Sketch.of(DISK.system()), motion_frames(disk), follow="disk")
    stage.show(0)
    at, ground = stage.view.outline(0, 0).strokes[1][0], stage.ground.get_segments()
    stage.show(25)
    np.testing.assert_allclose(stage.view.outline(0, 25).strokes[1][0][:2], at[:2], atol=1e-12)
    assert not np.allclose(ground[0], stage.ground.get_segments()[0])


def test_turns_between_times_of_output_are_even():
    sim = DISK.simulate(1.0, points=3, tol=1e-5)  # 2.5 rad from one to the next
    frames = motion_frames(sim, fps=20.0)
    exact = DISK.simulate(1.0, points=21, tol=1e-5)
    np.testing.assert_allclose(frames.rotations, exact.rotations, atol=1e-4)
    np.testing.assert_allclose(frames.positions, exact.positions, atol=1e-4)


# --- modes ----------------------------------------------------------------------------------------------------------


def test_a_mode_swings_about_the_reference_on_the_constraints():
    model = mbstab.load("double_pendulum.yaml")
    found = model.swing(2, points=20)
    middle = 0.5 * (found.positions[0] + found.positions[10])
    np.testing.assert_allclose(middle[:, 0], 0.0, atol=1e-9)
    rods = np.linalg.norm(np.diff(found.positions, axis=1)[:, 0], axis=1), np.linalg.norm(found.positions[:, 0], axis=1)
    np.testing.assert_allclose(rods, 1.0, rtol=1e-9)
    # The masses of the fast mode move against each other in the ratio of its shape, 1 to −√2 in angles.
    upper, lower = found.positions[0]
    assert lower[0] - upper[0] == pytest.approx(-math.sqrt(2.0) * upper[0], rel=0.05)
    assert swing_frames(found, 2).captions[0] == f"mode 2: 0 ± {abs(found.value.imag):.4g}i 1/s, exaggerated"


def test_a_real_mode_starts_at_the_reference():
    system = mbstab.load("wheeled_inverted_pendulum.yaml").system()
    found = swing(system, 1, 4)
    assert found.value.real > 0.0
    np.testing.assert_allclose(found.q[0], found.q[2], atol=1e-9)
    assert np.max(np.abs(found.q[1] - found.q[0])) > 0.1
    assert "growth and decay not shown" in swing_frames(found, 1).captions[0]


def test_modes_of_periodic_motions_do_not_swing():
    with pytest.raises(UsageError, match="periodic"):
        mbstab.load("kapitza.yaml").swing(1)


# --- files ----------------------------------------------------------------------------------------------------------


def durations(path):
    found = []
    with Image.open(path) as image:
        for k in range(image.n_frames):
            image.seek(k)
            found.append(image.info["duration"])
        assert image.info["loop"] == 0
    return found


@pytest.mark.parametrize("size", ["column", "page"])
def test_captions_and_titles_cover_nothing_and_are_inside(size):
    mechanism = mbstab.load("cart_pendulum.yaml")
    with sized(size):
        stage = Stage(Sketch.of(mechanism.system()), swing_frames(mechanism.swing(1, 4), 1), mechanism.model.title)
        list(stage.images())
    (title,) = [text.get_window_extent() for text in stage.figure.texts]
    caption, frame, sheet = stage.caption.get_window_extent(), stage.axes.get_window_extent(), stage.figure.bbox
    assert frame.y1 <= caption.y0 < caption.y1 <= title.y0 < title.y1 <= sheet.y1
    for box in (caption, title):
        assert sheet.x0 <= box.x0 < box.x1 <= sheet.x1


@pytest.mark.parametrize(
    ("options", "frames", "seconds"),
    [((), 26, 1.04), (("--fps", "30"), 31, 31 / 30), (("--speed", "0.5", "--fps", "10"), 21, 2.1)],
)
def test_a_gif_takes_as_long_as_the_motion(tmp_path, options, frames, seconds):
    path = tmp_path / "a.gif"
    result = run("pendulum.yaml", "--to", "1", "--perturb", "rod.theta=1", "--tol", "1e-4", "--animate", path, *options)
    assert result.exit_code == 0
    assert f"wrote {path}" in result.stderr
    found = durations(path)
    assert len(found) == frames
    assert sum(found) == pytest.approx(1000 * seconds, abs=5.1)
    assert max(found) - min(found) <= 10


def test_a_frame_of_a_file_is_the_frame_that_was_drawn(tmp_path, pendulum):
    stage = Stage(Sketch.of(PENDULUM.system()), motion_frames(pendulum), "Title", traces=["rod"])
    movie_files.write(stage, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as stored:
        for k, image in enumerate(stage.images()):
            if k in (0, 7, 25):
                stored.seek(k)
                difference = np.abs(np.asarray(stored.convert("RGB"), dtype=int) - np.asarray(image, dtype=int))
                assert difference.max() <= 40
                assert difference.mean() < 0.5
        assert np.asarray(stored.convert("RGB"))[0, 0].tolist() == [255, 255, 255]


def test_a_mode_is_one_period_of_two_seconds(tmp_path):
    path = tmp_path / "m.gif"
    result = run("four_bar.yaml", "--mode-shape", "1", "--animate", path, "--fps", "10")
    assert result.exit_code == 0
    assert durations(path) == [100] * 20


def fake_ffmpeg(folder, code):
    program = folder / "ffmpeg"
    program.write_text(f"#!{sys.executable}\nimport sys\n{code}\n", encoding="utf-8")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def test_mp4_files_get_all_frames_from_ffmpeg(tmp_path, monkeypatch, pendulum):
    size, count = "sys.argv[sys.argv.index('-s') + 1]", "str(len(sys.stdin.buffer.read()))"
    code = f"open(sys.argv[-1], 'w').write({size} + ' ' + {count})"
    monkeypatch.setenv("PATH", fake_ffmpeg(tmp_path, code))
    stage = Stage(Sketch.of(PENDULUM.system()), motion_frames(pendulum))
    movie_files.write(stage, tmp_path / "a.mp4")
    size, count = (tmp_path / "a.mp4").read_text(encoding="utf-8").split()
    width, height = map(int, size.split("x"))
    assert int(count) == 26 * width * height * 3
    assert width % 2 == height % 2 == 0
    fake_ffmpeg(tmp_path, "sys.exit('Unknown encoder')")
    with pytest.raises(OutputError, match="ffmpeg could not write the animation: Unknown encoder"):
        movie_files.write(stage, tmp_path / "b.mp4")
    assert {p.name for p in tmp_path.iterdir()} == {"a.mp4", "ffmpeg"}


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg")
@pytest.mark.parametrize(("options", "rate"), [((), 25.0), (("--fps", "29.97", "--speed", "0.5"), 29.97)], ids=str)
def test_a_film_has_all_frames_their_size_and_the_duration_of_the_motion(tmp_path, options, rate):
    path = tmp_path / "a.mp4"
    result = run("pendulum.yaml", "--to", "1", "--perturb", "rod.theta=1", "--tol", "1e-4", "--animate", path, *options)
    assert result.exit_code == 0
    speed = 0.5 if options else 1.0
    sim = PENDULUM.simulate(1.0, points=1001, perturb={"rod.theta": 1.0}, tol=1e-6)
    stage = Stage(Sketch.of(PENDULUM.system()), motion_frames(sim, rate, speed), PENDULUM.model.title)
    drawn = [np.asarray(image, dtype=int) for image in stage.images()]
    assert len(drawn) == math.floor(rate / speed) + 1
    said = subprocess.run(["ffmpeg", "-hide_banner", "-i", path], capture_output=True, encoding="utf-8").stderr
    height, width, _ = drawn[0].shape
    assert re.search(rf"Video: h264.* yuv420p.* {width}x{height},.* {rate:g} fps", said)
    hours, minutes, seconds = map(float, re.search(r"Duration: (\d+):(\d+):([\d.]+)", said).groups())
    assert (hours, minutes, seconds) == (0.0, 0.0, pytest.approx(len(drawn) / rate, abs=0.011))
    command = ["ffmpeg", "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    stored = np.frombuffer(subprocess.run(command, capture_output=True).stdout, dtype=np.uint8)
    for image, frame in zip(drawn, stored.reshape(-1, height, width, 3), strict=True):
        assert np.abs(frame - image).mean() < 2.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--animate", "a.mp4"), "ffmpeg, which is not found"),
        (("--animate", "a.avi"), "animations end with .gif or .mp4"),
        (("--animate", "nowhere/a.gif"), "there is no directory nowhere"),
        (("--animate", "a.gif", "--fps", "60"), "at most 50 frames per second"),
        (("--animate", "a.gif", "--fps", "1e-300"), "at least 0.01 frames per second, not 1e-300"),
        (("--animate", "a.gif", "--mode-shape", "1", "--fps", "1e-3"), "at least 0.01 frames per second, not 0.001"),
        (("--animate", "a.gif", "--speed", "1e300"), "would show one frame only"),
        (("--animate", "a.gif", "--speed", "1e-300"), "e+302 frames, more than 20000"),
        (("--animate", "a.gif", "--to", "1e300"), "2.5e+301 frames, more than 20000"),
        (("--animate", "a.gif", "--fps", "0"), "--fps must be a positive number"),
        (("--animate", "a.gif", "--view", "20,30"), "this one is planar"),
        (("--animate", "a.gif", "--view", "20"), "write ELEVATION,AZIMUTH"),
        (("--animate", "a.gif", "--trace", "rod.o"), "did you mean 'rod.O'?"),
        (("--animate", "a.gif", "--follow", "rood"), "did you mean 'rod'?"),
        (("--animate", "a.gif", "--to", "1e6"), "or make it faster with --speed"),
        (("--animate", "a.gif", "--mode-shape", "2"), "there is 1 to choose from"),
        *(
            (("--animate", "a.gif", "--mode-shape", "1", *extra), f"{extra[0]} has no effect with --mode-shape")
            for extra in (
                ("--to", "3"), ("--from", "1"), ("--method", "alpha"), ("--solver", "BDF"), ("--tol", "1e-8"),
                ("--step", "1e-3"), ("--once",), ("--compiled",), ("--points", "7"), ("--perturb", "rod.theta=1"),
                ("--strict",),
                ("--plot", "energy"), ("--pictures", "b"), ("--format", "json"), ("--output", "a.csv"),
                ("--speed", "2"),
            )
        ),
        (("--pictures", "b"), "--pictures has no effect without --plot"),
        (("--step", "0.1", "--tol", "1e-8", "--method", "alpha"), "--tol has no effect with --step"),
        (("--step", "0.1", "--once", "--tol", "1e-8"), "--tol, --once have no effect with --step"),
        (("--mode-shape", "1"), "--mode-shape goes with --animate"),
        (("--trace", "rod"), "--trace goes with --animate"),
    ],
    ids=str,
)  # fmt: skip
def test_wrong_requests_are_refused_before_anything_is_computed(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    result = run("pendulum.yaml", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert list(tmp_path.iterdir()) == []


STALLING = """\
import contextlib, sys, time
from mbstab.cli import main, output
whole_file = output.whole_file

@contextlib.contextmanager
def stalling(path):
    with whole_file(path) as stream:
        stream.write(b"half")
        stream.flush()
        time.sleep(60)
        yield stream

output.whole_file = stalling
"""
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@pytest.mark.parametrize("number", sample([signal.SIGINT, signal.SIGTERM], 2), ids=str)
def test_ctrl_c_while_animating_leaves_no_half_file(tmp_path, number):
    path = tmp_path / "a.gif"
    arguments = ("--perturb", "rod.theta=1", "--to", "60", "--tol", "1e-3", "--once", "--animate", path, "--fps", "50")
    with child(command_line("simulate", "pendulum.yaml", *arguments), **QUIET) as process:
        until(lambda: any(p.stat().st_size > 20_000 for p in tmp_path.iterdir()), process)
        assert [p.name.startswith(".a.gif.") for p in tmp_path.iterdir()] == [True]
        process.send_signal(number)
        process.wait(timeout=30)
    assert process.returncode == 128 + number
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=str)
def test_ctrl_c_while_data_are_written_leaves_no_half_file(tmp_path, number):
    path = tmp_path / "a.csv"
    # The disk stops after the first bytes.
    code = STALLING + "main(sys.argv[1:])"
    command = [sys.executable, "-c", code, "simulate", "pendulum.yaml", "--to", "0.1", "--points", "3", "-o", str(path)]
    with child(command, **QUIET) as process:
        until(lambda: any(p.stat().st_size for p in tmp_path.iterdir()), process)
        process.send_signal(number)
        process.wait(timeout=30)
    assert process.returncode == 128 + number
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", sample([signal.SIGINT, signal.SIGTERM], 2), ids=str)
def test_ffmpeg_ends_with_the_animation(tmp_path, number):
    # It says its number and swallows frames for ever.
    folder = tmp_path / "bin"
    folder.mkdir()
    code = "import os\nopen(sys.argv[-1], 'w').write(str(os.getpid()))\nwhile sys.stdin.buffer.read(9999): pass"
    environment = {**os.environ, "PATH": fake_ffmpeg(folder, code)}
    out = tmp_path / "out"
    out.mkdir()
    arguments = ("--perturb", "rod.theta=1", "--to", "60", "--tol", "1e-3", "--once", "--animate", out / "a.mp4")
    with child(command_line("simulate", "pendulum.yaml", *arguments), env=environment, **QUIET) as process:
        until(lambda: any(p.stat().st_size for p in out.iterdir()), process)
        (half,) = out.iterdir()
        writer = int(half.read_text(encoding="utf-8"))
        process.send_signal(number)
        process.wait(timeout=30)
    assert process.returncode == 128 + number
    assert list(out.iterdir()) == []
    assert ended(writer)


def test_the_users_matplotlibrc_changes_nothing(pendulum, tmp_path):
    before = drawn("energy", pendulum)
    save(before, tmp_path / "a.png")
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 30}):
        save(drawn("energy", pendulum), tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


# --- pictures of mode shapes ------------------------------------------------------------------------------------------


def dots(axes, ink):
    """Return where the point masses of one drawing are, shape (n, 2)."""
    found = [
        x for x in axes.get_lines() if x.get_marker() == "o" and x.get_markersize() > 5 and to_hex(x.get_color()) == ink
    ]
    return np.column_stack(found[-1].get_data())


def test_the_modes_of_a_double_pendulum():
    """Of two equal masses: the upper one moves (√2 - 1) as far in the first mode, and (√2 + 1) in the second."""
    model = mbstab.load("double_pendulum.yaml")
    modes = dict(enumerate((e for e in model.eig().eigenvalues if e.value.imag > 0.0), 1))
    figure = mode_stills(
        model.system(), modes, [swing(model.system(), n, 4, amplitude=1e-3) for n in (1, 2)], "Pendulum"
    )
    for axes, ratio in zip(figure.axes, (2**0.5 - 1, -(2**0.5) - 1), strict=True):
        rest, black, red = (dots(axes, to_hex(ink)) for ink in ("0.78", INK[0], INK[1]))
        np.testing.assert_allclose(rest[:, 0], 0.0, atol=1e-12)
        moved = black[:, 0]
        assert moved[0] / moved[1] == pytest.approx(ratio, rel=1e-5)
        np.testing.assert_allclose(red[:, 0], -moved, rtol=1e-9)
        # Rods keep their lengths.
        np.testing.assert_allclose(np.linalg.norm(black[0] - black[1]), np.linalg.norm(rest[0] - rest[1]), rtol=1e-9)
    assert "2.3972" in figure.axes[0].get_title()


@pytest.mark.parametrize("name", ["cart_pendulum", "car_relaxation", "zener", "whipple_bicycle"])
def test_bodies_move_by_the_same_in_every_mode(name):
    """States of the first order beside them, such as the force of an actuator, do not count."""
    mechanism = mbstab.load(f"{name}.yaml")
    system, bodies = mechanism.system(), slice(0, mechanism.system().body_slices[-1].stop)
    sizes = mechanism.motion().sizes[bodies]
    for number in range(1, 1 + sum(e.kind != "neutral" and e.value.imag >= 0.0 for e in mechanism.eig().eigenvalues)):
        shown = swing(system, number, 4, amplitude=1e-3)
        first, second = shown.q[[0, 2] if shown.value.imag else [1, 3], bodies]
        assert np.max(np.abs(first - second) / sizes) == pytest.approx(2e-3, rel=1e-2), number


def test_neutral_modes_have_no_panel(tmp_path):
    """They have a shape, but no number under which a mode is swung."""
    result = run_command("eig", "cart_pendulum.yaml", "--plot", "modes", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "a-modes.svg").stat().st_size > 5000


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_command_draws_them(suffix, tmp_path):
    result = run_command("eig", "whipple_bicycle.yaml", "--plot", "modes", "--pictures", str(tmp_path / f"a.{suffix}"))
    assert result.exit_code == 0
    assert (tmp_path / f"a-modes.{suffix}").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("pendulum.yaml", "--modes", "1"), "--plot modes draws the first modes of all"),
        (("kapitza.yaml",), "no mode has a shape"),
        (("free_rigid_body.yaml", "--precision", "20"), "neither with --precision"),
    ],
)
def test_what_has_no_picture_is_refused(arguments, message, tmp_path):
    result = run_command("eig", *arguments, "--plot", "modes", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_moving_picture_for_a_slide_has_its_shape(tmp_path):
    goal = tmp_path / "a.gif"
    command = ("simulate", "pendulum.yaml", "--mode-shape", "1", "--fps", "5", "--animate", str(goal))
    assert run_command(*command, "--size", "slide").exit_code == 0
    with Image.open(goal) as picture:
        assert picture.size == (720, pytest.approx(720 * 143 / 254, abs=1.0))


def test_panels_are_as_high_as_what_they_show(tmp_path):
    """Five modes of an arm, three in a row: panels are not as high as those of two in a row would be."""
    assert run_command("eig", "robot_arm.yaml", "--plot", "modes", "--pictures", str(tmp_path / "a.png")).exit_code == 0
    with Image.open(tmp_path / "a-modes.png") as picture:
        pixels = np.array(picture.convert("L"))
    frames = np.flatnonzero(np.mean((pixels > 195) & (pixels < 215), axis=1) > 0.4)  # edges of the panels of a row
    (top, *_), (*_, low) = np.split(frames, np.flatnonzero(np.diff(frames) > 5) + 1)[:2]
    dark = np.flatnonzero(np.any(pixels[top + 10 : low - 10] < 100, axis=1))
    assert np.ptp(dark) > 0.7 * (low - top)
