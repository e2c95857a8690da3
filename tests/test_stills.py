"""Pictures of mode shapes."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image
from test_cli import run

import mbstab
from mbstab.analysis.simulate.mode_shape import swing
from mbstab.report.animation.stills import mode_stills
from mbstab.report.pictures.curves import INK


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
    result = run("eig", "cart_pendulum.yaml", "--plot", "modes", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "a-modes.svg").stat().st_size > 5000


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_command_draws_them(suffix, tmp_path):
    result = run("eig", "whipple_bicycle.yaml", "--plot", "modes", "--pictures", str(tmp_path / f"a.{suffix}"))
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
    result = run("eig", *arguments, "--plot", "modes", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_moving_picture_for_a_slide_has_its_shape(tmp_path):
    goal = tmp_path / "a.gif"
    command = ("simulate", "pendulum.yaml", "--mode-shape", "1", "--fps", "5", "--animate", str(goal))
    assert run(*command, "--size", "slide").exit_code == 0
    with Image.open(goal) as picture:
        assert picture.size == (720, pytest.approx(720 * 143 / 254, abs=1.0))


def test_panels_are_as_high_as_what_they_show(tmp_path):
    """Five modes of an arm, three in a row: panels are not as high as those of two in a row would be."""
    assert run("eig", "robot_arm.yaml", "--plot", "modes", "--pictures", str(tmp_path / "a.png")).exit_code == 0
    with Image.open(tmp_path / "a-modes.png") as picture:
        pixels = np.array(picture.convert("L"))
    frames = np.flatnonzero(np.mean((pixels > 195) & (pixels < 215), axis=1) > 0.4)  # edges of the panels of a row
    (top, *_), (*_, low) = np.split(frames, np.flatnonzero(np.diff(frames) > 5) + 1)[:2]
    dark = np.flatnonzero(np.any(pixels[top + 10 : low - 10] < 100, axis=1))
    assert np.ptp(dark) > 0.7 * (low - top)
