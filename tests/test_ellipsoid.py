"""Ellipsoids on a plane and points held in a plane: against closed forms, other contacts and the geometry itself."""

import cmath
import math

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.cli import main

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
