"""Ellipsoids, disks, balls and wheels on planes, on moving surfaces and on each other, against closed forms."""

import cmath
import math

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.reference.reactions import reactions
from mbstab.analysis.verdict.neutral import Separated, chains_of
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.cli import main
from mbstab.errors import ModelFileError
from mbstab.model.library import models_folder

MASS, G = 1.7, 9.81
INERTIA = (0.031, 0.042, 0.057)
MOTIONS = ["rolling", "frictionless"]


def body(section, reference, mass=MASS, inertia=INERTIA, extra=""):
    """Return a scene of one body b."""
    return mbstab.loads(
        f"mbstab: 1\ngravity: [0, 0, {-G}]\n"
        f"bodies: {{b: {{type: spatial, mass: {mass}, inertia: {list(inertia)}{extra}}}}}\n"
        f"{section}\nreference: {reference}\n"
    )


def contact(semi_axes, motion="rolling", center="b", more=""):
    sizes = ", ".join(f"{name}: {size}" for name, size in zip("abc", semi_axes, strict=True))
    return f"contacts: {{c: {{type: ellipsoid, center: {center}, {sizes}, motion: {motion}{more}}}}}"


def at_rest(z):
    return f"{{coordinates: {{b: {{x: 0, y: 0, z: {z}, phi: 0, theta: 0, psi: 0}}}}}}"


def pairs(*squares):
    return [sign * cmath.sqrt(square) for square in squares for sign in (1, -1)]


def assert_eigenvalues(result, expected, neutral, rtol=1e-13):
    # Zeros that no symmetry explains, such as those of rolling in place, are among the values.
    limit = 1e-5 * max(np.abs(result.values()), default=0.0)
    found = [s for s in result.values() if abs(s) > limit]
    assert (len(found), result.counts.found - len(found)) == (len(expected), neutral)
    np.testing.assert_array_less(matched(found, expected) / np.abs(expected), rtol)


# --- at rest --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("depth", [0.1, 0.02, -0.04])
def test_an_eccentric_ball_rocks_as_a_pendulum(motion, depth):
    # Centre of mass below the centre by the depth; it turns about the contact, or without friction about itself.
    R = 0.25
    scene = body(contact([R] * 3, motion, "b.C"), at_rest(R - depth), extra=f", points: {{C: [0, 0, {depth}]}}")
    arm = R - depth if motion == "rolling" else 0.0
    squares = [-MASS * G * depth / (inertia + MASS * arm**2) for inertia in INERTIA[:2]]
    result = scene.eig()
    assert_eigenvalues(result, pairs(*squares), 4 if motion == "rolling" else 6)
    assert result.verdict == ("stable up to symmetry" if depth > 0 else "unstable")


UPRIGHT = {0: "[0, -pi/2, 0]", 1: "[pi/2, 0, 0]", 2: "[0, 0, 0]"}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("up", UPRIGHT)
@pytest.mark.parametrize("semi_axes", [(0.3, 0.2, 0.1), (0.11, 0.29, 0.17), (0.2, 0.2, 0.5)])
def test_an_ellipsoid_rocks_about_each_of_its_horizontal_axes(semi_axes, up, motion):
    scene = body(contact(semi_axes, motion), at_rest(semi_axes[up]), extra=f", axes: {UPRIGHT[up]}")
    squares = []
    for about in {0, 1, 2} - {up}:
        (along,) = {0, 1, 2} - {up, about}
        stiffness = MASS * G * (semi_axes[along] ** 2 - semi_axes[up] ** 2) / semi_axes[up]
        resting = MASS * semi_axes[up] ** 2 if motion == "rolling" else 0.0
        squares.append(-stiffness / (INERTIA[about] + resting))
    # Round about its axis it also rolls in place: no restoring force, two more neutral eigenvalues.
    squares = [square for square in squares if square]
    neutral = (8 if motion == "rolling" else 10) - 2 * len(squares)
    assert_eigenvalues(scene.eig(), pairs(*squares), neutral)


@pytest.mark.parametrize("method", ["index3", "paper"])
def test_other_methods_agree_about_the_rattleback(method):
    scene = mbstab.load("rattleback.yaml")
    found, expected = scene.eig(method=method).values(), scene.eig().values()
    assert np.max(matched(found[np.abs(found) > 1], expected) / np.abs(expected)) < 1e-9


# --- rolling straight ahead -----------------------------------------------------------------------------------------


def rolling_along(section, R, speed, transverse, axial):
    state = f"{{x: 0, y: 0, z: {R}, phi: pi/2, theta: 0, psi: 0}}"
    rates = f"{{x: {speed}, y: 0, z: 0, phi: 0, theta: 0, psi: {-speed / R}}}"
    reference = f"{{coordinates: {{b: {state}}}, rates: {{b: {rates}}}}}"
    return body(section, reference, inertia=(transverse, transverse, axial)).eig()


@pytest.mark.parametrize("speed", [0.4, 3.0])
@pytest.mark.parametrize("width", [0.03, 0.15, 0.25, 0.4])
def test_a_spheroid_rolls_on_its_equator_as_a_tread_of_its_curvature(width, speed):
    # The closed form of the rolling torus, with the radius of curvature of the meridian as the radius of the tube.
    R, I_t, I_a = 0.25, 0.037, 0.052
    tube = width**2 / R
    turn = (I_a + MASS * R**2) * I_a * (speed / R) ** 2 / I_t
    square = (MASS * G * (R - tube) - turn) / (I_t + MASS * R**2)
    result = rolling_along(contact((R, R, width)), R, speed, I_t, I_a)
    assert_eigenvalues(result, pairs(square), 6)
    assert result.verdict == ("unstable" if square > 0 else "stable up to symmetry")
    if tube < R:
        wheel = f"contacts: {{c: {{type: wheel, center: b, axle: z, radius: {R - tube}, tube: {tube}}}}}"
        assert_eigenvalues(result, rolling_along(wheel, R, speed, I_t, I_a).values(), 6)


def test_a_homogeneous_ball_rolls_on_with_neutral_eigenvalues_only():
    result = rolling_along(contact([0.2] * 3), 0.2, 0.0, 0.03, 0.03)
    assert_eigenvalues(result, [], 8)


# --- spinning about the vertical ------------------------------------------------------------------------------------

SPINNING = {
    1: (0.042341989 + 33.841541593j, -0.4259762119 + 107.295936564j),
    5: (0.2025212833 + 34.1436916659j, -2.1206923979 + 109.3923228379j),
    10: (0.3567677253 + 35.0947483870j, -4.1931099545 + 115.689907218j),
    20: (0.4839795701 + 38.8521295499j, -8.1566640285 + 137.9709231802j),
}
"""Rattleback of Kane and Levinson (1982): eigenvalues by spin (rad/s), from equations in the axes of the body."""


@pytest.mark.parametrize("spin", SPINNING)
@pytest.mark.parametrize("sense", [1, -1])
def test_a_spinning_rattleback_has_one_growing_mode_in_each_sense(spin, sense):
    # Eigenvalues in axes that turn along, Δq = P(t) z and Δu = P(t) (ż + ω S z): P turns x, y and the tilt.
    omega = sense * spin
    state = "x: 0, y: 0, z: 0.01, phi: 0, theta: 0, psi: 0"
    rates = f"x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: {omega}"
    scene = body(
        contact((0.2, 0.03, 0.02), center="b.C"),
        f"{{coordinates: {{b: {{{state}}}}}, rates: {{b: {{{rates}}}}}}}",
        mass=1,
        inertia=([2e-4, -2e-5, 0], [-2e-5, 1.6e-3, 0], [0, 0, 1.7e-3]),
        extra=", points: {C: [0, 0, 0.01]}",
    )
    system, motion = scene.system(), scene.motion()
    K, R, D_q = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    M, J = motion.dynamics.M, motion.dynamics.J
    S = np.zeros((6, 6))
    S[0, 1] = S[3, 4] = -omega
    S[1, 0] = S[4, 3] = omega
    A, E = np.zeros((15, 15)), np.zeros((15, 15))
    E[:6, :6], E[6:12, 6:12] = np.eye(6), M
    A[:6, :6], A[:6, 6:12] = -S, np.eye(6)
    A[6:12, :6], A[6:12, 6:12], A[6:12, 12:] = -K, -R - M @ S, -J.T
    A[12, :6], A[13:, :6], A[13:, 6:12] = J[0], D_q, J[1:]
    inverse = np.linalg.eigvals(np.linalg.solve(A - 50 * E, E))
    values = 50 + 1 / inverse[np.abs(inverse) > 1e-3]
    found = values[values.imag > 25]  # the neutral directions x and y turn with the axes: ± i ω
    expected = np.array(SPINNING[spin]) * sense
    expected = np.where(expected.imag > 0, expected, expected.conj())
    assert len(found) == 2
    np.testing.assert_array_less(matched(found, expected) / np.abs(expected), 1e-10)


# --- geometry -------------------------------------------------------------------------------------------------------


def turn(axis, angle):
    i, j = (axis + 1) % 3, (axis + 2) % 3
    A = np.eye(3)
    A[i, i] = A[j, j] = math.cos(angle)
    A[i, j], A[j, i] = -math.sin(angle), math.sin(angle)
    return A


def place(q, point):
    return q[:3] + turn(0, q[3]) @ turn(1, q[4]) @ turn(2, q[5]) @ point


def test_a_tumbling_ellipsoid_touches_the_plane_in_one_point_that_stands_still():
    semi_axes, center = np.array([0.3, 0.2, 0.1]), np.array([0.02, -0.03, 0.05])
    normal, origin = np.array([1.0, -2.0, 2.0]) / 3, np.array([0.3, 0.1, -0.2])
    scene = body(
        contact(semi_axes, center="b.C", more=f", normal: {normal.tolist()}, origin: {origin.tolist()}"),
        "{coordinates: {b: {x: 0.1, y: 0.2, phi: 0.4, theta: -0.7, psi: 1.1}}, guess: {b: {z: 0.2}}, "
        "rates: {b: {phi: 1.3, theta: 0.8, psi: -2.1}}}",
        extra=f", points: {{C: {center.tolist()}}}",
    )
    motion = scene.motion()
    q, u = motion.q, motion.u
    # The lowest point by search, without the formula that is tested.
    rng = np.random.default_rng(4)
    best, spread = np.array([0.0, 0.0, -1.0]), 2.0

    def height(direction):
        return normal @ (place(q, center + semi_axes * direction) - origin)

    for _ in range(60):
        tries = best + spread * rng.normal(size=(60, 3))
        tries /= np.linalg.norm(tries, axis=1)[:, None]
        heights = [height(direction) for direction in tries]
        if min(heights) < height(best):
            best = tries[np.argmin(heights)]
        else:
            spread *= 0.6
    assert height(best) == pytest.approx(0.0, abs=1e-12)
    touching, step = center + semi_axes * best, 1e-6
    velocity = (place(q + step * u, touching) - place(q - step * u, touching)) / (2 * step)
    assert np.linalg.norm(u[:3]) > 0.1
    np.testing.assert_allclose(velocity, 0.0, atol=1e-5)


# --- points in a plane ----------------------------------------------------------------------------------------------


def test_a_body_hangs_from_a_ceiling_without_friction():
    L = 0.3
    joint = "joints: {j: {type: point_on_plane, between: [ground, b.P], axis: z}}"
    scene = body(joint, at_rest(-L), extra=f", points: {{P: [0, 0, {L}]}}")
    assert_eigenvalues(scene.eig(), pairs(*(-MASS * G * L / inertia for inertia in INERTIA[:2])), 6)


@pytest.mark.parametrize("ends", ["ground, b", "b, ground"])
def test_the_plane_is_fixed_in_the_first_body(ends):
    joint = f"joints: {{j: {{type: point_on_plane, between: [{ends}], axis: [0, 3, 4]}}}}"
    tilt = 0.3 if ends == "b, ground" else 0.0
    normal = turn(0, tilt) @ [0, 0.6, 0.8]
    system = body(joint, at_rest(0)).system()
    J = system.dynamics([0, 0, 0, 0.3, 0, 0], np.zeros(6)).J
    np.testing.assert_allclose(np.abs(J), [[0, *np.abs(normal[1:]), 0, 0, 0]], atol=1e-15)


def test_the_centre_of_a_ball_without_friction_stays_in_a_plane():
    R, point = 0.25, ", points: {C: [0, 0.03, 0.1]}"
    reference = (
        "{coordinates: {b: {x: 0, y: 0, phi: 0.5, theta: 0.2, psi: 0.9}}, guess: {b: {z: 0}}, "
        "rates: {b: {phi: 1, theta: 2, psi: 3}}}"
    )
    joint = f"joints: {{j: {{type: point_on_plane, between: [{{body: ground, point: [0, 0, {R}]}}, b.C], axis: -z}}}}"
    ball, bead = (body(section, reference, extra=point) for section in (contact([R] * 3, "frictionless", "b.C"), joint))
    for one, other in zip(
        (ball.motion().q, ball.motion().a, ball.motion().nu, ball.linearize().K, ball.motion().dynamics.J),
        (bead.motion().q, bead.motion().a, bead.motion().nu, bead.linearize().K, bead.motion().dynamics.J),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


# --- the types ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("contacts.ellipsoid", ["center", "a", "b", "c", "normal", "origin", "motion"]),
        ("joints.point_on_plane", ["between", "axis"]),
    ],
)
def test_the_schema_lists_the_keys(name, keys):
    result = CliRunner().invoke(main, ["schema", name])
    assert result.exit_code == 0
    listed = [line.strip().partition(":")[0] for line in result.stdout.splitlines()[1:] if line[:3].strip()]
    assert [key for key in listed if key in keys] == keys


@pytest.mark.parametrize("size", ["0", "-0.1"])
def test_a_semi_axis_must_be_positive(size):
    with pytest.raises(mbstab.ModelFileError, match="b must be positive"):
        body(contact((0.1, size, 0.1)), at_rest(0.1)).eig()


def test_the_rows_are_named():
    rows = body(contact((0.3, 0.2, 0.1)), at_rest(0.1)).system().rows
    assert [(row.label, row.unit) for row in rows] == [("height", "m"), ("slip v2", "m/s"), ("slip v3", "m/s")]


# --- surfaces that move: turntables and treadmills, and the fixed ground ----------------------------------------------
# A ball of inertia k m R^2 about its centre on a plane that turns at the rate Omega about the vertical obeys
# x'' = -kappa Omega y', y'' = kappa Omega x' with kappa = k/(1 + k), 2/7 for a solid one (Earnshaw 1844; Weltner 1979):
# its centre moves on a circle at kappa Omega. On a treadmill all is as on the ground, seen from the belt (Galileo).


TABLE = """\
mbstab: 1
parameters: {{m: 2, R: 0.1, k: {k}, Omega: 3.5, x0: 0.3, v: 0.2}}
gravity: [0, 0, -9.81]
bodies: {{ball: {{type: spatial, mass: m, inertia: [k*m*R**2, k*m*R**2, k*m*R**2]}}}}
contacts: {{table: {{type: ellipsoid, center: ball, a: R, b: R, c: R, surface_rate: Omega}}}}
reference:
  coordinates: {{ball: {{x: {x}, y: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{ball: {{x: {w}, y: {v}, phi: {phi}, theta: {w}/R, psi: 0}}}}
"""


def ball(k="0.4", x="0", v="0", w="0"):
    """Return a ball at (x, 0) with the speeds w and v along x and y; there the table moves at Omega x along y."""
    return mbstab.loads(TABLE.format(k=k, x=x, v=v, w=w, phi=f"(Omega*{x} - {v})/R"))


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0], ids=["solid", "hollow"])
def test_the_linearized_ball_on_a_turntable_circles_at_its_share_of_the_rate(k):
    found = ball(k=repr(k)).eig()
    values = found.values()
    assert sorted(values.imag)[-1] == pytest.approx(k / (1.0 + k) * 3.5, rel=1e-12)
    assert sorted(abs(values))[:-2] == pytest.approx([0.0] * (len(values) - 2), abs=1e-5)


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0], ids=["solid", "hollow"])
def test_a_ball_on_a_turntable_moves_on_a_circle(k):
    rate = k / (1.0 + k) * 3.5
    run = ball(repr(k), "x0", "v").simulate(to=2.0 * math.pi / rate, points=9)
    angle, radius = rate * run.times, 0.2 / rate
    exact = np.column_stack([0.3 - radius + radius * np.cos(angle), radius * np.sin(angle)])
    np.testing.assert_allclose(run.q[:, :2], exact, atol=1e-9)
    assert np.ptp(run.kinetic) > 0.5 * np.max(run.kinetic)
    assert not run.conservative
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)


def test_the_power_of_a_turntable_is_that_of_the_friction_on_its_surface():
    """The friction on the ball is m kappa Omega w along y, where the table moves at Omega x0."""
    found = ball(x="x0", w="v").energies()
    (share,) = (x for x in found.shares if "table" in x.owner)
    assert share.power == pytest.approx(2.0 * (2.0 / 7.0) * 3.5 * 0.2 * 3.5 * 0.3, rel=1e-12)
    assert found.total.power == share.power


BICYCLE = (models_folder() / "whipple_bicycle.yaml").read_text(encoding="utf-8")


def treadmill(text):
    """Return the bicycle with its frame at rest, on a belt that runs to the rear."""
    for contact in ("rear_wheel, axle: z, radius: r_R", "front_wheel, axle: z, radius: r_F"):
        text = text.replace(contact, f"{contact}, surface_velocity: [-v, 0, 0]")
    return text.replace("{x: v, y: 0", "{x: 0, y: 0")


@pytest.mark.long
@pytest.mark.parametrize("v", [1.0, 5.0])
def test_a_bicycle_on_a_treadmill_has_the_eigenvalues_of_one_on_the_road(v):
    road, belt = (mbstab.loads(x).eig(v=v) for x in (BICYCLE, treadmill(BICYCLE)))
    assert belt.verdict == road.verdict
    far, near = (x.values()[np.abs(x.values()) > 1e-3] for x in (road, belt))
    np.testing.assert_allclose(np.sort_complex(near), np.sort_complex(far), rtol=1e-9)
    assert len(near) == 4


def test_a_disturbed_bicycle_on_a_treadmill_moves_as_on_the_road():
    runs = [
        mbstab.loads(x).simulate(to=0.5, points=3, perturb={"rate(rear_body.phi)": 0.1})
        for x in (BICYCLE, treadmill(BICYCLE))
    ]
    road, belt = runs
    k = road.names.index("rear_body.x")
    np.testing.assert_allclose(belt.q[:, k] + 5.0 * belt.times, road.q[:, k], atol=1e-8)
    k = road.names.index("rear_body.phi")
    np.testing.assert_allclose(belt.q[:, k], road.q[:, k], atol=1e-8)
    assert belt.energy_drift < 1e-8 * np.max(road.kinetic)


DISK = """\
mbstab: 1
parameters: {{m: 2, R: 0.1, V: 0.7, A: 0.3}}
gravity: [0, -9.81]
bodies: {{disk: {{type: planar, mass: m, inertia: m*R**2/2}}}}
contacts: {{belt: {{type: disk, center: disk, radius: R, surface_velocity: {velocity}}}}}
reference:
  coordinates: {{disk: {{x: 0, theta: 0}}}}
  rates: {{disk: {{x: 0}}}}
"""


def test_a_disk_on_a_belt_that_speeds_up_has_a_third_of_its_acceleration():
    run = mbstab.loads(DISK.format(velocity="[V + A*t, 0]")).simulate(to=2.0, points=3)
    np.testing.assert_allclose(run.u[:, 0], 0.1 * run.times, atol=1e-10)
    np.testing.assert_allclose(run.u[:, 2], (0.7 + 0.2 * run.times) / 0.1, rtol=1e-10)
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)


@pytest.mark.parametrize(
    ("kind", "contact"),
    [
        ("wheel", "axle: [0.1, 1, 0.3], radius: 0.3, tube: 0.05"),
        ("ellipsoid", "a: 0.3, b: 0.2, c: 0.25"),
    ],
)
def test_slip_counts_against_the_surface_at_the_contact(kind, contact):
    """On a plane at rest two states differ in slip by the velocity of the surface of a moving plane."""
    text = """\
mbstab: 1
bodies: {{b: {{type: spatial, mass: 1, inertia: [1, 1, 1], points: {{C: [0.1, 0.2, 0.3]}}}}}}
contacts: {{on: {{type: {kind}, center: b.C, {contact}, origin: [0.4, -0.2, 0.1]{more}}}}}
reference: {{guess: {{b: {{z: 1}}}}}}
"""
    moving = ", surface_velocity: [0.3, -0.4 + t, 0], surface_rate: 2 - 3*t"
    rest, carried = (mbstab.loads(text.format(kind=kind, contact=contact, more=more)).system() for more in ("", moving))
    q, u, t = np.array([0.3, 0.1, 0.8, 0.2, -0.3, 0.4]), np.array([0.5, 0.2, 0.1, 0.3, -0.7, 0.6]), 0.3
    at, there = rest.dynamics(q, u, t), carried.dynamics(q, u, t)
    np.testing.assert_array_equal(at.J, there.J)
    slips = [i for i, row in enumerate(rest.rows) if "slip" in str(row)]
    # A pure translation of the body with the velocity of the surface at the contact has no slip.
    V, rate, origin = np.array([0.3, -0.1, 0.0]), 1.1, np.array([0.4, -0.2, 0.1])
    h = 1e-6
    contact_point = touching(rest, q)
    surface = V + rate * np.cross([0.0, 0.0, 1.0], contact_point - origin)
    found = rest.dynamics(q, u - np.concatenate([surface, np.zeros(3)]), t)
    np.testing.assert_allclose(there.V[slips], found.V[slips], atol=1e-12)
    assert np.max(np.abs(there.V[slips] - at.V[slips])) > 0.1
    # The acceleration residual is the rate of the slip, the given functions included.
    a = np.linspace(-1.0, 1.0, 6)
    ahead, behind = (carried.dynamics(q + s * u + 0.5 * s * s * a, u + s * a, t + s).V for s in (h, -h))
    np.testing.assert_allclose((there.J @ a + there.B)[slips], (ahead - behind)[slips] / (2.0 * h), atol=1e-7)


def touching(system, q):
    """Return the contact point: where turns about axes through it, parallel to the plane, leave the slip as it is."""
    J = system.dynamics(q, np.zeros(6), 0.0).J
    slips = [i for i, row in enumerate(system.rows) if "slip" in str(row)]
    moved = J[slips][:, :2]
    # The slip of a turn about the vertical is that of its speed at the contact: z x (contact - place of the body).
    turn = vertical(q)
    speed = np.linalg.solve(moved, J[slips][:, 3:] @ turn)
    return q[:3] + np.array([speed[1], -speed[0], 0.0])


def vertical(q):
    """Return the rates of the Cardan angles of a turn about the vertical at unit rate."""
    phi, theta = q[3:5]
    c, s = np.cos, np.sin
    X = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    Y = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    axes = np.column_stack([[1, 0, 0], X @ [0, 1, 0], X @ Y @ [0, 0, 1]])
    return np.linalg.solve(axes, [0.0, 0.0, 1.0])


def test_a_surface_that_is_written_as_zero_is_one_at_rest():
    text = (models_folder() / "rolling_torus.yaml").read_text(encoding="utf-8")
    plain = mbstab.loads(text)
    written = mbstab.loads(text.replace("type: wheel,", "type: wheel, surface_velocity: [0, 0, 0], surface_rate: 0,"))
    assert written.eig().values().tolist() == plain.eig().values().tolist()
    assert written.model.document.lines != plain.model.document.lines
    assert plain.simulate(to=0.01, points=2).conservative
    assert written.simulate(to=0.01, points=2).conservative


def test_a_turning_surface_does_not_exist_in_the_plane():
    with pytest.raises(ModelFileError, match="unknown key 'surface_rate'"):
        mbstab.loads(DISK.format(velocity="0, surface_rate: 1"))


def test_a_tyre_on_a_moving_plane_is_refused():
    text = """\
mbstab: 1
bodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 1]}}
contacts: {on: {type: wheel, center: b, axle: y, radius: 1, motion: sideways, surface_rate: 1}}
forces: {tyre: {type: tyre, contact: on, cornering_stiffness: 5}}
reference: {guess: {b: {z: 1}}}
"""
    with pytest.raises(ModelFileError, match=r":4:.*moving plane \(surface_rate\), and slip counts against a plane at"):
        mbstab.loads(text)


# --- verdicts -------------------------------------------------------------------------------------------------------

TURNTABLE = mbstab.load(models_folder() / "turntable.yaml")


@pytest.mark.parametrize("k", [1e-2, 1e-4, 1e-6])
def test_a_ball_of_little_inertia_is_known_within_its_bounds(k):
    """The ball's spin about the vertical carries nothing, its rolling the mass; the motion turns one into the other."""
    (pair,) = (x for x in TURNTABLE.eig(k=k).eigenvalues if x.value.imag > 0.0 and x.kind != "neutral")
    assert abs(pair.value - 1j * k / (1.0 + k) * 3.5) <= pair.error_bound < 1e-12


@pytest.mark.parametrize(
    "values",
    [{"m": 1e-6}, {"R": 1e-5}, {"R": 1e4}, {"Omega": 1e-5}, {"Omega": 1e5}, {"k": 1e-6}, {"x0": 1e6}, {"x0": 1e-6}],
    ids=lambda values: " ".join(f"{name}={value}" for name, value in values.items()),
)
@pytest.mark.parametrize("middle", [False, True])
def test_a_ball_on_a_turntable_is_stable_up_to_symmetry(values, middle):
    values |= {"x0": 0.0} if middle else {}
    found = TURNTABLE.eig(**values)
    assert found.verdict == "stable up to symmetry"
    k, rate = values.get("k", 0.4), values.get("Omega", 3.5)
    (pair,) = (x for x in found.eigenvalues if x.value.imag > 0.0 and x.kind != "neutral")
    assert abs(pair.value - 1j * k / (1.0 + k) * rate) <= pair.error_bound + 4e-16 * rate


@pytest.mark.parametrize("x0", [1e-7, 1e-6, 1e-5, 1e-3])
def test_symmetries_that_nearly_agree_lose_no_digits(x0):
    """Near the middle a turn of the table is nearly one of the ball: their difference has few digits."""
    for found in (TURNTABLE.eig(x0=x0), TURNTABLE.eig(x0=x0, method="index3")):
        (pair,) = (x for x in found.eigenvalues if x.value.imag > 0.0 and x.kind != "neutral")
        assert abs(pair.value - 1j) <= pair.error_bound < 1e-12


def test_a_spinning_ball_in_the_middle_is_judged():
    text = TABLE.replace("psi: 0}}}}\n", "psi: 4}}}}\n").format(k=0.4, x=0, w=0, v=0, phi=0)
    assert "psi: 4" in text.splitlines()[-1]
    assert mbstab.loads(text).eig().verdict == "stable up to symmetry"


@pytest.mark.parametrize("push", ["1e-13*ball.x", "-1e-13*ball.x", "1e-9*ball.x**2"])
def test_a_weak_force_beside_a_turntable_is_not_overlooked(push):
    text = TABLE.format(k=0.4, x=0, w=0, v=0, phi=0) + f"forces: {{push: {{type: expression, on: {{ball.x: {push}}}}}}}"
    assert mbstab.loads(text).eig().verdict in ("undecided", "marginally stable")


def test_a_ball_in_a_bowl_and_two_balls_on_a_spring_are_stable_up_to_their_own_turns():
    """In a bowl a ball swings at sqrt(g/((1 + k)(B - R))), two balls on a spring at sqrt(2 c/((1 + k) m))."""
    bowl = """\
mbstab: 1
parameters: {m: 2, R: 0.1, k: 0.4, B: 1.1}
gravity: [0, 0, -9.81]
bodies: {ball: {type: spatial, mass: m, inertia: [k*m*R**2, k*m*R**2, k*m*R**2]}}
joints: {bowl: {type: distance, between: [{body: ground, point: [0, 0, B]}, ball], length: B-R}}
definitions:
  ox: "rate(ball.phi) + rate(ball.psi)*sin(ball.theta)"
  oy: "rate(ball.theta)*cos(ball.phi) - rate(ball.psi)*sin(ball.phi)*cos(ball.theta)"
  oz: "rate(ball.theta)*sin(ball.phi) + rate(ball.psi)*cos(ball.phi)*cos(ball.theta)"
constraints:
  along: {nonholonomic: "rate(ball.x) + R*(oy*(ball.z - B) - oz*ball.y)/(B - R)"}
  across: {nonholonomic: "rate(ball.y) + R*(oz*ball.x - ox*(ball.z - B))/(B - R)"}
reference: {coordinates: {ball: {x: 0, y: 0, z: R, phi: 0, theta: 0, psi: 0}}}
"""
    body = "{type: spatial, mass: 2, inertia: [0.008, 0.008, 0.008]}"
    two = f"""\
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {{a: {body}, b: {body}}}
contacts:
  first: {{type: ellipsoid, center: a, a: 0.1, b: 0.1, c: 0.1}}
  second: {{type: ellipsoid, center: b, a: 0.1, b: 0.1, c: 0.1}}
forces: {{spring: {{type: spring, between: [a, b], stiffness: 100, length: 1}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}, b: {{x: 1, y: 0}}}}}}
"""
    for text, square in ((bowl, 9.81 / 1.4), (two, 200.0 / 2.8)):
        found = mbstab.loads(text).eig()
        assert found.verdict == "stable up to symmetry"
        assert max(found.values().imag) == pytest.approx(math.sqrt(square), rel=1e-12)


@pytest.mark.parametrize("x0", [3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9])
def test_a_ball_that_hardly_turns_is_left_behind_like_t(x0):
    """Another angular velocity turns a ball ever further, whatever its own rate Omega x0/R is: like t, not like t^2."""
    assert TURNTABLE.eig(x0=x0).reasons[0].endswith("only this offset drifts like t, while everything else stays small")


@pytest.mark.parametrize("rate", [1.0, 1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize(("turned", "power"), [(True, 0), (False, 1)])
def test_the_growth_of_neutral_directions_does_not_depend_on_how_slowly_they_turn(rate, turned, power):
    """A constant speed drives x, y or the angle z of a frame that turns: x and y stay bounded, z grows like t."""
    S = np.zeros((4, 4))
    S[0, 1], S[1, 0] = -rate, rate
    S[:3, 3] = [1.0, 0.5, 0.0 if turned else 1.0]
    basis = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    mixed = basis @ S @ basis.T
    found = Separated(mixed, np.eye(4), np.zeros((0, 4)), np.zeros((4, 0)), Neutral())
    assert chains_of(found).drift == power
    two = np.kron(np.eye(2), S)
    two[3, 4:7] = [0.0, 0.0, rate]  # the angle of the second drives the speed of the first
    found = Separated(two, np.eye(8), np.zeros((0, 8)), np.zeros((8, 0)), Neutral())
    assert chains_of(found).drift == (1 if turned else 3)


def test_slow_turns_of_a_ball_on_a_turntable_move_no_eigenvalue_of_the_fast_one():
    """Directions that are nearly dependent span a space that S leaves: ±i keep their bounds."""
    places = [3.0000000000000004e-05, 2.1402966057353745e-05, *10.0 ** np.random.default_rng(1).uniform(-9, 1, 40)]
    for x0 in places:
        found = TURNTABLE.eig(x0=float(x0))
        (fast,) = (e for e in found.eigenvalues if abs(e.value - 1j) < 1e-3)
        assert abs(fast.value - 1j) <= fast.error_bound
        assert str(found.verdict) == "stable up to symmetry", x0


# --- disks that roll on each other in the plane -----------------------------------------------------------------------


RING = """\
mbstab: 1
parameters: {{m: 2, r: 0.1, R: 0.5, k: 0.5, Omega: 3, y: {y}}}
gravity: [0, -9.81]
bodies:
  disk: {{type: planar, mass: m, inertia: k*m*r**2}}
{roller}
contacts: {{pair: {{type: rollers, between: [disk, {on}], radii: [r, R], internal: {internal}{more}}}}}
reference:
  coordinates: {{disk: {{x: 0, y: y, theta: 0}}}}
"""


@pytest.mark.parametrize(
    ("internal", "more", "squared"),
    [
        # (1 + k) (R -+ r) phi'' = -+ g phi, without friction k = 0.
        ("true", "", -9.81 / (1.5 * 0.4)),
        ("false", "", 9.81 / (1.5 * 0.6)),
        ("true", ", motion: frictionless", -9.81 / 0.4),
    ],
)
def test_a_disk_inside_a_ring_and_on_top_of_a_cylinder(internal, more, squared):
    y = "r - R" if internal == "true" else "r + R"
    found = mbstab.loads(RING.format(y=y, roller="", on="ground", internal=internal, more=more)).eig()
    values = [x for x in found.values() if abs(x) > 1e-6]
    np.testing.assert_allclose(np.square(values), [squared, squared], rtol=1e-12)


RIG = """\
mbstab: 1
parameters: {m: 2, r: 0.3, R: 0.1, a: 0.2, k: 0.5, Omega: 3, A: 0.7}
gravity: [0, -9.81]
bodies:
  wheel: {type: planar, mass: m, inertia: k*m*r**2}
  left: {type: planar, mass: 1, inertia: 0.01}
  right: {type: planar, mass: 1, inertia: 0.01}
joints:
  one: {type: revolute, between: [left, {body: ground, point: [-a, 0]}]}
  two: {type: revolute, between: [right, {body: ground, point: [a, 0]}]}
contacts:
  first: {type: rollers, between: [wheel, left], radii: [r, R]}
  second: {type: rollers, between: [wheel, right], radii: [r, R]}
drives: {turning: {type: joint, joint: one, motion: angle, velocity: Omega + A*t}}
reference:
  coordinates: {left: {x: -a, y: 0, theta: 0}, right: {x: a, y: 0, theta: 0}, wheel: {x: 0, theta: 0}}
  guess: {wheel: {y: r}}
"""


def test_a_wheel_on_two_rollers_of_a_rig_turns_against_the_driven_one_and_takes_its_work():
    run = mbstab.loads(RIG).simulate(to=1.0, points=3)
    names = list(run.names)
    turn, place, other = (names.index(x) for x in ("wheel.theta", "wheel.y", "right.theta"))
    driven = 3.0 + 0.7 * run.times
    np.testing.assert_allclose(run.u[:, turn], -driven * 0.1 / 0.3, rtol=1e-10)
    np.testing.assert_allclose(run.u[:, other], driven, rtol=1e-10)
    np.testing.assert_allclose(run.q[:, place], math.sqrt(0.4**2 - 0.2**2), rtol=1e-12)
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)
    assert np.ptp(run.kinetic) > 0.1 * np.max(run.kinetic)


def test_reactions_of_a_resting_wheel_on_two_rollers_carry_its_weight():
    mechanism = mbstab.loads(RIG.replace("Omega + A*t", "0"))
    at = mechanism.motion()
    carried = [x.force for x in reactions(mechanism.system(), at.q, at.u, at.dynamics.J, at.nu) if x.body == "wheel"]
    # Each roller pushes half of the weight along the line of centres, which stands at asin(a/(r + R)) = 30 deg.
    half, across = 9.81, 9.81 * math.tan(math.pi / 6)
    np.testing.assert_allclose(carried, [[across, half], [-across, half]], rtol=1e-12)
