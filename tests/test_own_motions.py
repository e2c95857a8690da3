"""Simulations against equations of motion that are written here, from other coordinates, and integrated by SciPy."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from mechanisms import FREE_DISK
from PIL import Image
from sampling import sample
from scipy.integrate import solve_ivp

import mbstab
from mbstab.cli import main
from mbstab.report.animation.frames import motion_frames
from mbstab.report.animation.sketch import Sketch
from mbstab.report.animation.stage import Stage

RADIUS, MASS, GRAVITY = 0.3, 2.0, 9.81

DISK = (
    FREE_DISK
    + """\
initial:
  coordinates: {disk: {x: 0.1, y: -0.2, phi: pi/2 - LEAN, theta: 0.3, psi: 0.7}}
  rates: {disk: {phi: 0.4, theta: 0.9, psi: SPIN}}
"""
)

CRANE = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {L: {value: 0.4, unit: m}}
bodies:
  cart: {type: planar, mass: 3, inertia: 0.1}
  rod: {type: planar, mass: 2, shape: {type: rod, length: 2*L}, points: {O: [-L, 0]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: x}
  pivot: {type: revolute, between: [rod.O, cart]}
drives: {motor: {type: coordinate, coordinate: cart.x, position: LAW}}
reference:
  time: START
  coordinates: {rod: {theta: -pi/2}, cart: {y: 0, theta: 0}}
  guess: {rod: {y: -L}}
initial:
  coordinates: {rod: {theta: -pi/2 + 0.5}}
  rates: {rod: {theta: -1}}
"""


def frame(axis):
    """Return the axes along the contact line and up the disk for its axle, and how far the axle is from upright."""
    tilt = math.acos(axis[2])
    up = (np.array([0.0, 0.0, 1.0]) - math.cos(tilt) * axis) / math.sin(tilt)
    return np.cross(up, axis), up, tilt


def rolling(t, y):
    """Return the rates of a thin disk that rolls, its spin in the axes of `frame` (Routh, Advanced Part, art. 244).

    Of Newton's law the reaction is R = m(a + g z); Euler's equations have its moment about the centre, −r e2 × R, and
    a follows from v = r(−w3 e1 + w1 e3).
    """
    tilt, heading, _, _, w1, w2, w3 = y
    A, C = 0.25 * MASS * (RADIUS**2 + 0.05**2 / 3.0), 0.5 * MASS * RADIUS**2
    rim, turn = MASS * RADIUS**2, w2 / math.tan(tilt)
    e1 = np.array([math.cos(heading), math.sin(heading)])
    e3 = math.sin(tilt) * np.array([math.sin(heading), -math.cos(heading)])
    return [
        w1,
        w2 / math.sin(tilt),
        *(RADIUS * (w1 * e3 - w3 * e1)),
        (A * turn * w2 - (C + rim) * w2 * w3 - MASS * GRAVITY * RADIUS * math.cos(tilt)) / (A + rim),
        (C * w1 * w3 - A * turn * w1) / A,
        rim * w1 * w2 / (C + rim),
    ]


@pytest.mark.parametrize(
    ("lean", "spin", "end"),
    # A disk that runs fast and sways, and one that runs slowly and leans far over.
    [(0.3, 8.0, 3.0), (0.7, 3.0, 0.8)],
)
@pytest.mark.parametrize("options", sample([{}, {"method": "radau", "tol": 1e-6}], 2), ids=["projection", "radau"])
def test_a_disk_off_symmetry_rolls_as_its_own_equations_say(lean, spin, end, options):
    text = DISK.replace("LEAN", str(lean)).replace("SPIN", str(spin))
    sim = mbstab.loads(text).simulate(end, points=61, **{"tol": 1e-8, **options})
    assert sim.warnings == ()
    axle, spins = sim.rotations[:, 0, :, 2], sim.spins[:, 0]
    e1, e2, tilt = frame(axle[0])
    start = [tilt, math.atan2(e1[1], e1[0]), *sim.positions[0, 0, :2], *(np.array([e1, e2, axle[0]]) @ spins[0])]
    assert abs(math.cos(tilt)) > 0.2
    exact = solve_ivp(rolling, (0.0, end), start, "DOP853", sim.times, rtol=1e-12, atol=1e-13)
    assert exact.success
    allowed = 3.0 * options.get("tol", 1e-8)
    tilt, heading, x, y, *w = exact.y
    place = np.stack([x, y, RADIUS * np.sin(tilt)], axis=1)
    np.testing.assert_allclose(sim.positions[:, 0], place, rtol=0.0, atol=allowed * RADIUS)
    along = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(tilt)], axis=1)
    axis = np.stack([np.sin(tilt) * np.sin(heading), -np.sin(tilt) * np.cos(heading), np.cos(tilt)], axis=1)
    np.testing.assert_allclose(axle, axis, rtol=0.0, atol=allowed)
    spun = w[0][:, None] * along + w[1][:, None] * np.cross(axis, along) + w[2][:, None] * axis
    np.testing.assert_allclose(spins, spun, rtol=0.0, atol=allowed * np.max(np.abs(spun)))
    # It does something worth comparing.
    assert np.ptp(tilt) > 0.2
    assert np.ptp(heading) > 0.5


@pytest.mark.parametrize(
    ("law", "start", "acceleration"),
    [
        ("0.2*sin(7*t) - 0.1*t", 0.3, lambda t: -0.2 * 49.0 * np.sin(7.0 * t)),
        ("0.5*t**3 - 0.3*t**2", 0.0, lambda t: 3.0 * t - 0.6),
        # A smooth start within the time: 3 s² − 2 s³ has the second derivative 6 − 12 s.
        (
            "0.3*smooth_start((t - 0.5)/0.8)",
            0.0,
            lambda t: np.where((t > 0.5) & (t < 1.3), 0.3 * (6.0 - 12.0 * (t - 0.5) / 0.8) / 0.64, 0.0),
        ),
    ],
    ids=["wave", "cubic", "smooth start"],
)
def test_what_a_drive_moves_by_a_law_of_time_follows_its_own_equation(law, start, acceleration):
    text = CRANE.replace("LAW", law).replace("START", str(start))
    mechanism = mbstab.loads(text)
    end = start + 2.0
    sim = mechanism.simulate(end, points=81, tol=1e-8)
    assert sim.warnings == ()
    L, m = 0.4, 2.0

    def swinging(t, y):
        # About the pivot, in which the acceleration of the cart acts as a field: I θ'' = −m L (g sin θ + a cos θ).
        return [y[1], -m * L * (GRAVITY * math.sin(y[0]) + acceleration(t) * math.cos(y[0])) / (m * (2.0 * L) ** 2 / 3)]

    # Steps end where the law has a kink in its acceleration.
    exact, y = [], [0.5, -1.0]
    for low, high in ((start, start + 0.5), (start + 0.5, start + 1.3), (start + 1.3, end)):
        inside = sim.times[(sim.times >= low) & (sim.times < high if high < end else sim.times <= end + 1e-9)]
        sides = low + 1e-12, high - 1e-12
        part = solve_ivp(
            lambda t, y, sides=sides: swinging(min(max(t, sides[0]), sides[1]), y),
            (low, high), y, "DOP853", [*inside, high] if inside[-1] < high else inside, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        exact.append(part.y[:, : len(inside)])
        y = part.y[:, -1]
    angle, rate = np.concatenate(exact, axis=1)
    number = {name: i for i, name in enumerate(sim.names)}
    np.testing.assert_allclose(sim.q[:, number["rod.theta"]] + 0.5 * math.pi, angle, rtol=0.0, atol=3e-8)
    np.testing.assert_allclose(sim.u[:, number["rod.theta"]], rate, rtol=0.0, atol=3e-8 * np.max(np.abs(rate)))
    # The motor accelerates the cart and the middle of the rod; times at a kink belong to either side.
    a = acceleration(sim.times)
    growth = np.array([swinging(t, y)[1] for t, y in zip(sim.times, np.stack([angle, rate], axis=1), strict=True)])
    force = 3.0 * a + m * (a + L * (growth * np.cos(angle) - rate**2 * np.sin(angle)))
    column = sim.load_names.index(("drive 'motor'", "cart", "force x"))
    smooth = ~np.isclose(sim.times, 0.5) & ~np.isclose(sim.times, 1.3) if "smooth" in law else np.full(81, True)
    np.testing.assert_allclose(sim.loads[smooth, column], force[smooth], rtol=0.0, atol=1e-6 * np.max(np.abs(force)))
    assert sim.energy_drift < 1e-7


# --- what is followed in a picture ----------------------------------------------------------------------------------


def test_in_a_film_the_followed_body_stays_in_its_place(tmp_path):
    spread = {}
    for name, options in (("still", ()), ("followed", ("--follow", "disk"))):
        path = tmp_path / f"{name}.gif"
        arguments = ("simulate", "rolling_disk.yaml", "--to", "1", "--tol", "1e-4", "--once", "--animate", str(path))
        result = CliRunner().invoke(main, [*arguments, "--fps", "10", "--view", "0,-90", *options])
        assert result.exit_code == 0
        middles = []
        with Image.open(path) as film:
            for k in range(film.n_frames):
                film.seek(k)
                grey = np.asarray(film.convert("L"), dtype=int)[60:-60, 40:-40]
                # The fill of the disk is the only grey that covers a whole area.
                columns = np.flatnonzero(np.count_nonzero(np.abs(grey - 237) < 6, axis=0) > 15)
                middles.append(0.5 * (columns[0] + columns[-1]))
        spread[name] = np.ptp(middles)
    assert len(middles) == 11
    assert spread["followed"] <= 1.5
    assert spread["still"] > 100.0


def test_the_ground_moves_back_by_as_much_as_the_followed_body_goes():
    model = mbstab.load("rolling_disk.yaml")
    sim = model.simulate(1.0, points=51, perturb={"disk.phi": 0.2}, tol=1e-5)
    stage = Stage(Sketch.of(model.system()), motion_frames(sim, 25.0), follow="disk", view=(90.0, -90.0))
    np.testing.assert_allclose(np.abs(stage.view.across[:2]), [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    offsets = {}
    for k in (0, 7, 25):
        stage.show(k)
        lines = np.array(stage.ground.get_segments())
        for i in (0, 1):
            across = lines[np.ptp(lines[:, :, i], axis=1) < 1e-9][:, 0, i]
            moved = sim.positions[2 * k, 0, i] - sim.positions[0, 0, i]
            # The lines of a grid that is fixed to the ground are at whole multiples of its step.
            rest = (across + moved * stage.view.across[i, i]) / np.diff(np.sort(across))[0]
            offset = offsets.setdefault(i, rest[0])
            np.testing.assert_allclose(rest - offset, np.round(rest - offset), atol=1e-6)
    assert np.ptp(sim.positions[:, 0, :2], axis=0).max() > 1.0
