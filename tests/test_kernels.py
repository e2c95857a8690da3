"""Every kernel at a random state off symmetry and in motion: derivatives, definitions, arithmetics.

Derivatives are compared with differences in 50 digits; definitions with kinematics
written here, from rotation matrices and displaced states only.
"""

import importlib
import inspect
import itertools
import random

import mpmath
import numpy as np
import pytest
from element_tables import HOLONOMIC, NONHOLONOMIC, POWER, STEP, Body, turn, unit

from mbstab.compiler.derive import parameter_sizes
from mbstab.compiler.user import user_kernel
from mbstab.mechanics.catalogue import COORDINATES
from mbstab.mechanics.elements import ELEMENTS
from mbstab.model.arithmetic import FLOAT, array_arithmetic, mpmath_arithmetic
from mbstab.model.expressions import parse
from mbstab.model.functions import FUNCTIONS

DIGITS = 50
MATRICES = {"M", "J", "K", "R", "D", "V_q", "A_q", "A_u"}
OF_ROWS = {"E", "V", "B", "J", "D", "V_q", "A_q", "A_u"}


def named(*roles):
    return sorted(name for name, element in ELEMENTS.items() if element.role in roles)


def frame_of(name):
    return name.removesuffix(f"_{ELEMENTS[name].name}")


@pytest.fixture(autouse=True)
def _precision():
    with mpmath.workdps(DIGITS):
        yield


# --- cases ----------------------------------------------------------------------------------------------------------


class Case:
    """A kernel with random inputs.

    Parameters
    ----------
    name : str
    units : tuple of str
        Parameters that are unit vectors.
    """

    def __init__(self, name, units=()):
        self.name, self.element, self.frame = name, ELEMENTS[name], frame_of(name)
        self.kernel = importlib.import_module(f"mbstab.compiler.kernels.{name}")
        rng = random.Random(name)
        self.size = len(COORDINATES[self.frame])

        def numbers(count):
            return np.array([mpmath.mpf(rng.uniform(0.2, 1.2)) for _ in range(count)], dtype=object)

        self.own = self.size * self.element.slots
        n = self.n = self.own + self.element.states
        self.rows = 1 + max((i for (i,) in self.kernel.DYNAMICS.get("E", ())), default=-1)
        angles = numbers(3 * self.element.slots).reshape(-1, 3)
        self.bases = [turn(0, x) @ turn(1, y) @ turn(2, z) for x, y, z in angles]
        self.p = {key: numbers(count) for key, count in parameter_sizes(self.element, self.frame)}
        for key in units:
            self.p[key] = unit(self.p[key])
        self.inputs = {"q": numbers(n), "u": numbers(n), "s": numbers(3 * self.element.signals)}
        self.last = {"inertia": {"a": numbers(n)}, "force": {}}.get(self.element.role, {"nu": numbers(self.rows)})
        self.a = numbers(n)

    @property
    def flat(self):
        bases = [x for base in self.bases for x in base.ravel()] if self.frame == "spatial" else []
        return np.array([*bases, *(x for value in self.p.values() for x in value)], dtype=object)

    @property
    def s(self):
        """The given functions of time, without their derivatives."""
        return self.inputs["s"][: self.element.signals]

    def parted(self, x):
        """Return the part of each body, then each state by itself."""
        return [*x[: self.own].reshape(-1, self.size), *x[self.own :]]

    def bodies(self):
        parts, count = self.parted(self.inputs["q"]), self.element.slots
        return [*(Body(self.frame, q, base) for q, base in zip(parts[:count], self.bases, strict=True)), *parts[count:]]

    def virtual(self):
        """Yield each coordinate's unit velocity, body by body."""
        for j in range(self.n):
            yield self.parted(np.array([mpmath.mpf(int(i == j)) for i in range(self.n)]))

    def speeds(self):
        return self.parted(self.inputs["u"])

    def arguments(self, function, inputs):
        last = {"dynamics": [], "linearize": list(self.last.values()), "linearize_rows": [self.a]}[function]
        return [inputs["q"], inputs["u"], self.flat, inputs["s"], *last]

    def shape(self, key):
        rows = self.rows if key in OF_ROWS else self.n
        return (rows, self.n) if key in MATRICES else (rows,)

    def dense(self, function, values):
        values = iter(values)
        out = {}
        for key, entries in getattr(self.kernel, function.upper()).items():
            out[key] = np.full(self.shape(key), 0, dtype=object)
            for index in entries:
                out[key][index] = next(values)
        assert next(values, None) is None
        return out

    def run(self, function, **changed):
        inputs = self.inputs | changed
        f = mpmath_arithmetic()
        return self.dense(function, getattr(self.kernel, function)(f, *self.arguments(function, inputs)))

    def slope(self, output, group):
        """Return ∂output/∂group by differences; `output` takes what `run` returns."""
        columns = []
        for j in range(len(self.inputs[group])):
            ends = []
            for sign in (1, -1):
                moved = self.inputs[group].copy()
                moved[j] += sign * STEP
                ends.append(output(self.run("dynamics", **{group: moved})))
            columns.append((ends[0] - ends[1]) / (2 * STEP))
        return np.array(columns).T

    def rate(self, key):
        """Return the time derivative of an output on the path with constant u."""
        q, u = self.inputs["q"], self.inputs["u"]
        s, s_t, s_tt = self.inputs["s"].reshape(3, -1)
        ends = []
        for h in (STEP, -STEP):
            later = np.concatenate([s + h * s_t + h**2 / 2 * s_tt, s_t + h * s_tt, s_tt])
            ends.append(self.run("dynamics", q=q + h * u, s=later)[key])
        return (ends[0] - ends[1]) / (2 * STEP)


def assert_close(found, expected, tolerance=1e-20):
    found, expected = np.array(found, dtype=object), np.array(expected, dtype=object)
    assert found.shape == expected.shape
    largest = max((abs(x) for x in expected.flat), default=0)
    error = max((abs(x - y) for x, y in zip(found.flat, expected.flat, strict=True)), default=0)
    assert error <= tolerance * largest or error == 0, f"{mpmath.nstr(error, 3)} of {mpmath.nstr(largest, 3)}"


# --- derivatives ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", named("holonomic"))
def test_a_holonomic_velocity_residual_is_the_time_derivative_of_the_row(name):
    case = Case(name)
    assert_close(case.run("dynamics")["V"], case.rate("E"))


@pytest.mark.parametrize("name", named("nonholonomic"))
def test_a_nonholonomic_velocity_residual_is_the_row_itself(name):
    out = Case(name).run("dynamics")
    assert_close(out["V"], out["E"], 0)


@pytest.mark.parametrize("name", named("holonomic", "nonholonomic"))
def test_the_jacobian_is_the_derivative_of_the_velocity_residual_by_the_speeds(name):
    case = Case(name)
    J = case.run("dynamics")["J"]
    assert np.any(J != 0)
    assert_close(J, case.slope(lambda out: out["V"], "u"))


@pytest.mark.parametrize("name", named("holonomic"))
def test_the_jacobian_of_a_holonomic_row_is_its_derivative_by_the_coordinates(name):
    case = Case(name)
    assert_close(case.run("dynamics")["J"], case.slope(lambda out: out["E"], "q"))


@pytest.mark.parametrize("name", named("holonomic", "nonholonomic"))
def test_the_bias_is_the_time_derivative_of_the_velocity_residual_without_acceleration(name):
    case = Case(name)
    assert_close(case.run("dynamics")["B"], case.rate("V"))


@pytest.mark.parametrize("name", named("holonomic", "nonholonomic"))
def test_K_and_R_of_a_constraint_are_the_derivatives_of_its_force(name):
    case = Case(name)
    out = case.run("linearize")

    def push(dynamics):
        return dynamics["J"].T @ case.last["nu"]

    assert_close(out["K"], case.slope(push, "q"))
    R = out.get("R", np.full((case.n, case.n), mpmath.mpf(0)))
    assert_close(R, case.slope(push, "u"))


@pytest.mark.parametrize("name", named("nonholonomic"))
def test_D_is_the_derivative_of_a_nonholonomic_row_by_the_coordinates(name):
    case = Case(name)
    assert_close(case.run("linearize")["D"], case.slope(lambda out: out["E"], "q"))


def assert_rows_linearized(case):
    """Compare the derivatives of V, and of A = J a + B at fixed a, with differences."""
    rows = case.run("linearize_rows")

    def accelerations(out):
        return out["J"] @ case.a + out["B"]

    assert_close(rows["V_q"], case.slope(lambda out: out["V"], "q"))
    assert_close(rows["A_q"], case.slope(accelerations, "q"))
    assert_close(rows["A_u"], case.slope(accelerations, "u"))


@pytest.mark.parametrize("name", named("holonomic", "nonholonomic"))
def test_rows_are_differentiated_at_velocity_and_acceleration_level(name):
    assert_rows_linearized(Case(name))


@pytest.mark.parametrize("name", named("holonomic"))
def test_V_q_of_a_holonomic_row_is_the_time_derivative_of_its_jacobian(name):
    case = Case(name)
    assert_close(case.run("linearize_rows")["V_q"], case.rate("J"))


@pytest.mark.parametrize("name", named("inertia", "force"))
def test_only_rows_are_linearized_as_rows(name):
    assert not hasattr(Case(name).kernel, "linearize_rows")


@pytest.mark.parametrize("name", named("force"))
def test_K_and_R_of_a_force_are_its_derivatives(name):
    case = Case(name)
    out = case.run("linearize")
    assert np.any(case.run("dynamics")["F"] != 0)
    assert_close(out["K"], case.slope(lambda out: out["F"], "q"))
    assert_close(out["R"], case.slope(lambda out: out["F"], "u"))


@pytest.mark.parametrize("name", named("inertia"))
def test_K_and_R_of_a_body_are_the_derivatives_of_its_equations_at_fixed_accelerations(name):
    case = Case(name)
    out = case.run("linearize")
    assert_close(out["K"], case.slope(lambda out: out["M"] @ case.last["a"] + out["F"], "q"))
    assert_close(out["R"], case.slope(lambda out: out["F"], "u"))


@pytest.mark.parametrize("name", named("inertia"))
def test_a_mass_matrix_is_symmetric_to_the_last_digit(name):
    M = Case(name).run("dynamics")["M"]
    assert np.any(M != 0)
    assert np.all(M == M.T)


# --- definitions: bodies --------------------------------------------------------------------------------------------


def cloud(case):
    """Return masses and places of a rigid cloud, and give the case its mass properties."""
    rng = random.Random(17)
    size, count = case.bodies()[0].size, 1 if case.element.name == "point" else 7
    masses = np.array([mpmath.mpf(rng.uniform(0.2, 1.2)) for _ in range(count)])
    places = np.array([[mpmath.mpf(rng.uniform(-1, 1)) for _ in range(size)] for _ in range(count)])
    center = masses @ places / sum(masses)
    if case.element.name != "body_offset":
        places, center = places - center, 0 * center
    x, y, z = (*(places - center).T, 0 * masses)[:3]
    tensor = [masses @ v for v in (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)]
    values = {"mass": [sum(masses)], "center": center, "inertia": tensor[2:3] if size == 2 else tensor}
    case.p |= {key: np.array(value) for key, value in values.items() if key in case.p}
    return masses, places


@pytest.mark.parametrize("name", named("inertia"))
def test_a_body_has_the_kinetic_energy_of_a_rigid_cloud_of_points(name):
    case = Case(name)
    masses, places = cloud(case)
    (body,), (u,) = case.bodies(), case.speeds()
    energy = sum(m * sum(body.velocity(r, u) ** 2) / 2 for m, r in zip(masses, places, strict=True))
    assert_close(u @ case.run("dynamics")["M"] @ u / 2, energy)


@pytest.mark.parametrize("name", named("inertia"))
def test_a_body_obeys_newton_as_a_rigid_cloud_of_points_does(name):
    case = Case(name)
    masses, places = cloud(case)
    (body,), (u,) = case.bodies(), case.speeds()
    expected = []
    for (w,) in case.virtual():
        missing = [m * (body.acceleration(r, u) - case.p["gravity"]) for m, r in zip(masses, places, strict=True)]
        expected.append(sum(force @ body.velocity(r, w) for force, r in zip(missing, places, strict=True)))
    assert_close(case.run("dynamics")["F"], expected)


# --- definitions: constraints ---------------------------------------------------------------------------------------


def gap(bodies, p):
    return bodies[0].place(p["first"]) - bodies[1].place(p["second"])


def travel(bodies, p):
    return (bodies[1].matrix() @ p["second_v1"]) @ gap(bodies, p)


def crank(bodies, p):
    """Return length and angle of the first body's zero direction, seen in two directions of the second."""
    zero = bodies[0].matrix() @ p["first_v2"]
    c, s = (zero @ (bodies[1].matrix() @ p[key]) for key in ("second_v2", "second_v3"))
    return mpmath.hypot(c, s), mpmath.atan2(s, c)


def angle(bodies, p):
    return bodies[0].q[2] - bodies[1].q[2] if bodies[0].size == 2 else crank(bodies, p)[1]


def screw(bodies, p, s):
    length, angle = crank(bodies, p)
    (lead,) = p["lead"]
    return [lead / (2 * mpmath.pi) * length * mpmath.sin(angle - 2 * mpmath.pi * travel(bodies, p) / lead)]


def triads(bodies, p):
    """Return the triads of both bodies, first made orthonormal (v2 along its part across v1), as columns."""
    found = []
    for body, side in zip(bodies, ("first", "second"), strict=True):
        v1, v2 = (p[f"{side}_v{i}"] for i in (1, 2))
        v1 = unit(v1)
        v2 = unit(v2 - (v2 @ v1) * v1)
        p |= {f"{side}_v{i}": v for i, v in enumerate((v1, v2, np.cross(v1, v2)), 1)}
        found.append(body.matrix() @ np.array([v1, v2, np.cross(v1, v2)]).T)
    return found


def sum_of(motions):
    """Return the factors times the motions of joints, each between two bodies, less the phase."""

    def total(bodies, p):
        found = -p["phase"][0]
        for k, motion in enumerate(motions):
            own = {key.rpartition("_")[0]: value for key, value in p.items() if key[-1] == str(k)}
            found += p["factors"][k] * motion(bodies[2 * k : 2 * k + 2], own)
        return found

    return total


def train(motions):
    """Return the row of a drive train: in space less the whole turns."""

    def row(bodies, p, s=()):
        total = sum_of(motions)(bodies, p)
        if bodies[0].size == 3:
            total -= 2 * mpmath.pi * mpmath.nint(total / (2 * mpmath.pi))
        return [total / p["scale"][0]]

    return row


def equal_turns(bodies, p, s):
    # If they turn equally, the shortest turn that brings the first shaft onto the second takes v2 to w2.
    A, B = triads(bodies, p)
    v1, w1 = A[:, 0], B[:, 0]
    axis = unit(np.cross(v1, w1))
    bend = mpmath.atan2(axis @ np.cross(v1, w1), v1 @ w1)
    across = np.cross(axis, A[:, 1])
    bent = axis * (axis @ A[:, 1]) * (1 - mpmath.cos(bend)) + mpmath.cos(bend) * A[:, 1] + mpmath.sin(bend) * across
    twist = mpmath.atan2(w1 @ np.cross(bent, B[:, 1]), bent @ B[:, 1])
    return [2 * mpmath.tan(twist / 2)]


def distance(bodies, p, s):
    (length,) = p["length"]
    return [(sum(gap(bodies, p) ** 2) - length**2) / (2 * length)]


def angle_position(bodies, p, s):
    if bodies[0].size == 2:
        return [bodies[0].q[2] - bodies[1].q[2] - s[0]]
    length, angle = crank(bodies, p)
    return [length * mpmath.sin(angle - s[0])]


def lowest(body, p):
    """Return the lowest point of a wheel, as the lowest of a circle of points around the axle, less the tube."""
    axle, normal = body.matrix() @ p["axle"], p["normal"]
    e = unit(np.cross(axle, [1, 0, 0]))
    f = np.cross(axle, e)
    height = mpmath.hypot(normal @ e, normal @ f)
    down = -(normal @ e * e + normal @ f * f) / height
    return body.place(p["center"]) + p["radius"][0] * down - p["tube"][0] * normal


def wheel_height(bodies, p, s):
    return [p["normal"] @ lowest(bodies[0], p) - p["level"][0]]


def support(body, p):
    """Return the lowest point of an ellipsoid in the body frame: where a sphere touches that space has stretched."""
    stretch = np.diag(p["semi_axes"])
    return p["center"] - stretch @ unit(stretch @ body.matrix().T @ p["normal"])


def displaced(bodies, u, sign):
    frame = {2: "planar", 3: "spatial"}[bodies[0].size]
    return [Body(frame, body.q + sign * STEP * v, body.base) for body, v in zip(bodies, u, strict=True)]


def rate_of(function, bodies, u):
    return (function(displaced(bodies, u, 1)) - function(displaced(bodies, u, -1))) / (2 * STEP)


GEAR, RACK = (angle, angle), (travel, angle)

HOLONOMIC = {
    "coincident": lambda b, p, s: gap(b, p),
    "in_plane": lambda b, p, s: [(b[0].matrix() @ p["normal"]) @ gap(b, p)],
    "perpendicular": lambda b, p, s: [(b[0].matrix() @ p["first"]) @ (b[1].matrix() @ p["second"])],
    "aligned": lambda b, p, s: [b[0].q[2] - b[1].q[2] + p["angle"][0]],
    "distance": distance,
    "screw": screw,
    "equal_turns": equal_turns,
    "gear": train(GEAR),
    "rack": train(RACK),
    "differential": train((angle, angle, angle)),
    "roller_distance": lambda b, p, s: [mpmath.sqrt(sum(gap(b, p) ** 2)) - sum(p["radii"])],
    "disk_height": lambda b, p, s: [p["normal"] @ b[0].place(p["center"]) - p["level"][0]],
    "wheel_height": wheel_height,
    "ellipsoid_height": lambda b, p, s: [p["normal"] @ b[0].place(support(b[0], p)) - p["level"][0]],
    "angle_position": angle_position,
    "displacement_position": lambda b, p, s: [travel(b, p) - s[0]],
    "point_position": lambda b, p, s: [p["direction"] @ b[0].place(p["point"]) - s[0]],
}


def disk_slip(bodies, p, s, u):
    contact = p["center"] - p["radius"][0] * (bodies[0].matrix().T @ p["normal"])
    along = np.array([p["normal"][1], -p["normal"][0]])
    return [along @ (bodies[0].velocity(contact, u[0]) - carried(p, s, None))]


def roller_slip(bodies, p, s, u):
    away = unit(gap(bodies, p))
    own = [
        p["first"] - p["radii"][0] * bodies[0].matrix().T @ away,
        p["second"] + p["radii"][1] * bodies[1].matrix().T @ away,
    ]
    first, second = (body.velocity(point, v) for body, point, v in zip(bodies, own, u, strict=True))
    return [np.array([-away[1], away[0]]) @ (first - second)]


def carried(p, s, place):
    """Return the velocity of a plane that moves along itself, at a place; of one at rest 0."""
    turn = s[3] * np.cross(p["normal"], place - p["origin"]) if len(s) == 4 else 0
    return s[: len(p["normal"])] + turn if len(s) else 0


def wheel_slip(across):
    def row(bodies, p, s, u):
        (body,) = bodies
        contact = body.matrix().T @ (lowest(body, p) - body.q[:3])
        direction = unit(np.cross(body.matrix() @ p["axle"], p["normal"]))
        direction = np.cross(p["normal"], direction) if across else direction
        return [direction @ (body.velocity(contact, u[0]) - carried(p, s, lowest(body, p)))]

    return row


def ellipsoid_slip(bodies, p, s, u):
    (body,), point = bodies, support(bodies[0], p)
    return [p["along"] @ (body.velocity(point, u[0]) - carried(p, s, body.place(point)))]


def knife_edge(bodies, p, s, u):
    (body,) = bodies
    across = body.matrix() @ p["across"] if body.size == 2 else np.cross(p["normal"], body.matrix() @ p["along"])
    return [across @ body.velocity(p["point"], u[0])]


def angle_velocity(bodies, p, s, u):
    axis = bodies[1].matrix() @ p["second_v1"] if bodies[0].size == 3 else np.array([1])
    return [axis @ (bodies[0].spin(u[0]) - bodies[1].spin(u[1])) - s[0]]


def rolling(body, p, u):
    """Return speeds of a wheel along and across its plane, its turn rate about the normal, and its lean."""
    if body.size == 2:
        heading, velocity = body.matrix() @ p["along"], body.velocity(p["point"], u)
        return heading @ velocity, np.array([-heading[1], heading[0]]) @ velocity, u[2], 0
    axle, n = body.matrix() @ p["axle"], p["normal"]
    heading = unit(np.cross(axle, n))
    contact = body.velocity(body.matrix().T @ (lowest(body, p) - body.q[:3]), u)
    lean = mpmath.pi / 2 - mpmath.acos(axle @ n)
    return heading @ body.velocity(p["center"], u), np.cross(n, heading) @ contact, n @ body.spin(u), lean


def slip_angle(body, p, u):
    along, across, _, _ = rolling(body, p, u)
    return mpmath.atan(across / abs(along))


def slip_of_lean(body, p, u):
    return p["camber"][0] * rolling(body, p, u)[3] / p["cornering"][0] if body.size == 3 else 0


def tyre_relaxation(bodies, p, s, u):
    along, across, _, _ = rolling(bodies[0], p, u[0])
    lag = p["relaxation"][0] / mpmath.hypot(along, across)
    return [u[1] - (slip_angle(bodies[0], p, u[0]) + slip_of_lean(bodies[0], p, u[0]) - bodies[1]) / lag]


NONHOLONOMIC = {
    "tyre_relaxation": tyre_relaxation,
    "disk_slip": disk_slip,
    "roller_slip": roller_slip,
    "wheel_slip_along": wheel_slip(across=False),
    "wheel_slip_across": wheel_slip(across=True),
    "ellipsoid_slip": ellipsoid_slip,
    "knife_edge": knife_edge,
    "angle_velocity": angle_velocity,
    "displacement_velocity": lambda b, p, s, u: [rate_of(lambda at: travel(at, p), b, u) - s[0]],
    "point_velocity": lambda b, p, s, u: [p["direction"] @ b[0].velocity(p["point"], u[0]) - s[0]],
}

NONHOLONOMIC |= {
    f"carried_{name}": row for name, row in NONHOLONOMIC.items() if name.endswith(("slip", "along", "across"))
}

UNIT_VECTORS = ("normal", "axle")


def of_bodies(*roles):
    return [name for name in named(*roles) if frame_of(name) != "coordinate"]


def with_units(name):
    return Case(name, [key for key in UNIT_VECTORS if key in dict(ELEMENTS[name].parameters)])


@pytest.mark.table
@pytest.mark.parametrize("name", of_bodies("holonomic"))
def test_a_holonomic_row_is_what_the_kinematics_say(name):
    case = with_units(name)
    expected = HOLONOMIC[case.element.name](case.bodies(), case.p, case.s)
    assert_close(case.run("dynamics")["E"], expected)


@pytest.mark.table
@pytest.mark.parametrize("name", of_bodies("nonholonomic"))
def test_a_nonholonomic_row_is_what_the_kinematics_say(name):
    case = with_units(name)
    expected = NONHOLONOMIC[case.element.name](case.bodies(), case.p, case.s, case.speeds())
    assert_close(case.run("dynamics")["E"], expected)


@pytest.mark.parametrize(("name", "group"), [("position", "q"), ("velocity", "u")])
def test_a_driven_coordinate_follows_its_law(name, group):
    case = Case(f"coordinate_coordinate_{name}")
    assert_close(case.run("dynamics")["E"], case.inputs[group] - case.s, 0)


# --- definitions: forces --------------------------------------------------------------------------------------------


@pytest.mark.table
def length(bodies, p):
    return mpmath.sqrt(sum(gap(bodies, p) ** 2))


def spring(extension):
    """Return the power of a spring and damper in a virtual motion w."""

    def power(bodies, p, s, u, w):
        speed, virtual = (rate_of(lambda at: extension(at, p), bodies, v) for v in (u, w))
        (stiffness,), (rest,), (damping,) = p["stiffness"], p["rest"], p["damping"]
        return -(stiffness * (extension(bodies, p) - rest) + damping * speed) * virtual

    return power


def elastic_train(motions):
    def power(bodies, p, s, u, w):
        speed, virtual = (rate_of(lambda at: sum_of(motions)(at, p), bodies, v) / p["scale"][0] for v in (u, w))
        return -(p["stiffness"][0] * train(motions)(bodies, p)[0] + p["damping"][0] * speed) * virtual

    return power


def effort(motion):
    return lambda b, p, s, u, w: s[0] * rate_of(lambda at: motion(at, p), b, w)


def ideal_spring(b, p, s, u, w):
    ends = gap(b, p)
    return -p["stiffness"][0] * sum(x * rate_of(lambda at, i=i: gap(at, p)[i], b, w) for i, x in enumerate(ends))


def bearing(b, p, s, u, w):
    """Return the power in a virtual motion, with the gap in the axes of the second body."""

    def local(bodies):
        return bodies[1].matrix().T @ gap(bodies, p)

    (stiffness,), (damping,) = p["stiffness"], p["damping"]
    speed, virtual = ([rate_of(lambda at, i=i: local(at)[i], b, v) for i in range(len(local(b)))] for v in (u, w))
    return -sum((stiffness * x + damping * v) * d for x, v, d in zip(local(b), speed, virtual, strict=True))


def mount(displacements):
    """Return the power of springs, dampers and preloads along displacements whose speeds are given besides."""

    def power(bodies, p, s, u, w):
        moved, rates, virtual, speeds = displacements(bodies, p, u, w)
        forces = zip(p["stiffness"], p["preload"], moved, virtual, strict=True)
        stored = sum((f - k * x) * d for k, f, x, d in forces)
        return stored - sum(c * v * d for c, v, d in zip(p["damping"], rates, speeds, strict=True))

    return power


def mount_axes(p, owner):
    return np.array([p[f"{owner}_v{i}"] for i in (1, 2, 3)])


def mounted(bodies, p, u, w):
    axes = np.eye(2, dtype=int) if bodies[0].size == 2 else mount_axes(p, "second")

    def local(at):
        return axes @ (at[1].matrix().T @ gap(at, p))

    rates, virtual = ([rate_of(lambda at, i=i: local(at)[i], bodies, v) for i in range(len(axes))] for v in (u, w))
    return local(bodies), rates, virtual, virtual


def coupled_mount(b, p, s, u, w):
    """Return the power of a force with matrices of stiffness and damping across an axis."""
    across = np.array([p["second_v2"], p["second_v3"]]) if b[0].size == 3 else np.eye(2, dtype=int)

    def local(at):
        return across @ (at[1].matrix().T @ gap(at, p))

    K, C = p["stiffness"].reshape(2, 2), p["damping"].reshape(2, 2)
    rates, virtual = (np.array([rate_of(lambda at, i=i: local(at)[i], b, v) for i in range(2)]) for v in (u, w))
    return -(K @ local(b) + C @ rates) @ virtual


def turned(bodies, p, u, w):
    spins, virtual = (bodies[0].spin(v[0]) - bodies[1].spin(v[1]) for v in (u, w))
    if bodies[0].size == 2:
        return [bodies[0].q[2] - bodies[1].q[2]], spins, virtual, virtual
    axes = mount_axes(p, "second") @ bodies[1].matrix().T

    def turns(at):
        R = mount_axes(p, "second") @ at[1].matrix().T @ at[0].matrix() @ mount_axes(p, "first").T
        return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / mpmath.sqrt(1 + np.trace(R))

    growing = [rate_of(lambda at, i=i: turns(at)[i], bodies, w) for i in range(3)]
    return turns(bodies), axes @ spins, growing, axes @ virtual


def tyre(b, p, s, u, w):
    """Return the power of a side force at the contact and its moment, which falls with the cosine of the slip angle."""
    slip = b[1] - slip_of_lean(b[0], p, u[0]) if len(b) > 1 else slip_angle(b[0], p, u[0])
    force = -magic_formula(slip, p["cornering"][0], p) if "peak" in p else -p["cornering"][0] * slip
    along, across, _, lean = rolling(b[0], p, u[0])
    arm = p["trail"][0] * mpmath.cos(mpmath.atan2(across, along))
    _, side, turn, _ = rolling(b[0], p, w[0])
    thrust = -p["camber"][0] * lean if b[0].size == 3 else 0
    return (force + thrust) * side - arm * force * turn


def aligning_moment(b, p, s, u, w):
    """Return the power of a moment about the normal that turns a wheel to where it goes, ahead or astern."""
    slip = b[1] - slip_of_lean(b[0], p, u[0]) if len(b) > 1 else slip_angle(b[0], p, u[0])
    slope, sense = p["aligning"][0], mpmath.sign(rolling(b[0], p, u[0])[0])
    return sense * (magic_formula(slip, slope, p) if "peak" in p else slope * slip) * rolling(b[0], p, w[0])[2]


def camber_moment(b, p, s, u, w):
    """Return the power of a moment that turns a wheel to the side to which it leans."""
    along, _, _, lean = rolling(b[0], p, u[0])
    return -mpmath.sign(along) * p["moment"][0] * lean * rolling(b[0], p, w[0])[2]


def magic_formula(slip, slope, p):
    """Return F = D sin(C atan(B φ)) with φ = (1 − E) α + (E/B) atan(B α), and B C D the slope where nothing slips."""
    D, C, E = (p[key][0] for key in ("peak", "shape_factor", "curvature_factor"))
    B = slope / C / D
    return D * mpmath.sin(C * mpmath.atan(B * ((1 - E) * slip + E / B * mpmath.atan(B * slip))))


def creep(b, p, s, u, w):
    """Return the power of creep and of the load, with the wheelset's coordinates along and across the rails.

    In space the lateral motion is that of the point of the wheelset a radius below its middle.
    """
    rails = p["rails"]
    f11, f22, f23, f33, half, conicity, radius, load = (
        p[x][0] for x in ("f11", "f22", "f23", "f33", "half_gauge", "conicity", "radius", "load")
    )
    up = p.get("normal", [0, 0, 1])
    left = np.array([-rails[1], rails[0]]) if b[0].size == 2 else np.cross(up, rails)
    contact = p["point"] - (b[0].matrix().T @ (radius * up) if b[0].size == 3 else 0 * p["point"])
    velocity, virtual = (left @ b[0].velocity(contact, x[0]) for x in (u, w))
    rate, turn = (b[0].spin(x[0]) @ up[-len(b[0].spin(x[0])) :] for x in (u, w))
    ahead = rails @ b[0].velocity(p["point"], u[0])
    speed = mpmath.hypot(ahead, velocity)
    off, yaw = left @ (b[0].place(p["point"]) - p["origin"]), left @ (b[0].matrix() @ p["along"])
    power = -load * conicity * (off / half * virtual - half * yaw * turn)
    for side in (1, -1):
        x = -side * (half * rate + conicity * off * ahead / radius) / speed
        y, spin = (velocity - yaw * ahead) / speed, rate / speed
        f23 = p["f23"][0] * ahead / speed
        power += -f11 * x * (-side * half * turn) - (f22 * y + f23 * spin) * virtual + (f23 * y - f33 * spin) * turn
    return power


POWER = {
    "creep": creep,
    "camber_moment": camber_moment,
    "tyre": tyre,
    "relaxed_tyre": tyre,
    "aligning_moment": aligning_moment,
    "relaxed_aligning_moment": aligning_moment,
    "magic_aligning_moment": aligning_moment,
    "relaxed_magic_aligning_moment": aligning_moment,
    "magic_tyre": tyre,
    "relaxed_magic_tyre": tyre,
    "mount_force": mount(mounted),
    "mount_torque": mount(turned),
    "spring": spring(length),
    "bearing": bearing,
    "coupled_mount": coupled_mount,
    "ideal_spring": ideal_spring,
    "angle_spring": spring(angle),
    "gear_spring": elastic_train(GEAR),
    "rack_spring": elastic_train(RACK),
    "displacement_spring": spring(travel),
    "angle_effort": effort(angle),
    "displacement_effort": effort(travel),
    "ground_force": lambda b, p, s, u, w: s @ b[0].velocity(p["point"], w[0]),
    "body_force": lambda b, p, s, u, w: (b[0].matrix() @ s) @ b[0].velocity(p["point"], w[0]),
    "ground_torque": lambda b, p, s, u, w: s @ b[0].spin(w[0]),
    "body_torque": lambda b, p, s, u, w: (b[0].matrix() @ s) @ b[0].spin(w[0]),
}


@pytest.mark.parametrize("name", named("force"))
def test_a_force_has_the_power_that_force_times_velocity_gives_in_every_virtual_motion(name):
    case = with_units(name)
    power = POWER[case.element.name]
    expected = [-power(case.bodies(), case.p, case.s, case.speeds(), w) for w in case.virtual()]
    assert_close(case.run("dynamics")["F"], expected)


def test_forces_that_come_from_a_potential_and_a_dissipation_function_say_so():
    springs = {"spring", "ideal_spring", "angle_spring", "displacement_spring"}
    stored = springs | {"gear_spring", "rack_spring", "bearing", "mount_force", "mount_torque"}
    for name in ELEMENTS:
        case = Case(name)
        assert hasattr(case.kernel, "DAMPING") == (case.element.name in stored)
        assert hasattr(case.kernel, "potential") == (case.element.name in stored or case.element.role == "inertia")


@pytest.mark.parametrize("name", named("inertia", "force"))
def test_a_potential_has_the_force_at_rest_for_its_gradient(name):
    case = Case(name)
    if not hasattr(case.kernel, "potential"):
        return
    case.inputs["u"] = 0 * case.inputs["u"]
    q, f = case.inputs["q"], mpmath_arithmetic()

    def energy(step):
        (value,) = case.kernel.potential(f, q + step, case.flat)
        return value

    slopes = [(energy(STEP * one) - energy(-STEP * one)) / (2 * STEP) for one in np.eye(case.n, dtype=int)]
    assert_close(case.run("dynamics")["F"], slopes)


@pytest.mark.parametrize("name", named("force"))
def test_a_force_without_its_coefficients_of_damping_is_that_at_rest(name):
    case = Case(name)
    places = getattr(case.kernel, "DAMPING", ())
    if not places:
        return
    f, p = mpmath_arithmetic(), case.flat
    moving = case.kernel.dynamics(f, case.inputs["q"], case.inputs["u"], p, [])
    at_rest = case.kernel.dynamics(f, case.inputs["q"], 0 * case.inputs["u"], p, [])
    assert max(abs(x - y) for x, y in zip(moving, at_rest, strict=True)) > mpmath.mpf("1e-3")
    p[list(places)] = mpmath.mpf(0)
    undamped = case.kernel.dynamics(f, case.inputs["q"], case.inputs["u"], p, [])
    assert_close(np.array(undamped), np.array(at_rest))


# --- arithmetics ----------------------------------------------------------------------------------------------------


FUNCTIONS_OF_KERNELS = [(name, function) for name in sorted(ELEMENTS) for function in ("dynamics", "linearize")]
FUNCTIONS_OF_KERNELS += [(name, "linearize_rows") for name in named("holonomic", "nonholonomic")]


def assert_same(case, function, found, expected):
    found, expected = case.dense(function, found), case.dense(function, expected)
    for key, matrix in expected.items():
        largest = max((abs(x) for x in matrix.ravel()), default=0)
        assert all(abs(x - y) <= 1e-13 * largest for x, y in zip(found[key].ravel(), matrix.ravel(), strict=True)), key


@pytest.mark.parametrize(("name", "function"), FUNCTIONS_OF_KERNELS)
def test_floats_agree_with_50_digits(name, function):
    case = Case(name)
    floats = [[float(x) for x in group] for group in case.arguments(function, case.inputs)]
    exact = [[mpmath.mpf(x) for x in group] for group in floats]
    run = getattr(case.kernel, function)
    assert_same(case, function, run(FLOAT, *floats), run(mpmath_arithmetic(), *exact))


@pytest.mark.parametrize(("name", "function"), FUNCTIONS_OF_KERNELS)
def test_arrays_give_what_their_elements_give_one_by_one(name, function):
    case = Case(name)
    rng = np.random.default_rng(5)
    groups = [[float(x) * rng.uniform(0.9, 1.1, 5) for x in group] for group in case.arguments(function, case.inputs)]
    run = getattr(case.kernel, function)
    together = [np.broadcast_to(x, 5) for x in run(array_arithmetic(), *groups)]
    for i in range(5):
        single = run(FLOAT, *[[float(x[i]) for x in group] for group in groups])
        assert_same(case, function, [x[i] for x in together], single)


# --- kernels of expressions -----------------------------------------------------------------------------------------

ARGUMENTS = {"acos": "b.x*b.y/4", "asin": "b.x*b.y/4", "atan2": "b.x - L*t, b.y + t", "smooth_start": "b.x*b.y/4 + t/8"}
SOME = ("b.x*b.y + t**2", "b.x - b.y*t", "L*b.y + t", "L/4")
TEXTS = {
    name: f"L*{name}({ARGUMENTS.get(name, ', '.join(SOME[: FUNCTIONS[name].arguments]))}) + b.x" for name in FUNCTIONS
} | {
    "power of a coordinate": "b.x**1.5*L + (b.x*b.y)**-3 + b.y**12",
    "power with exponent": "b.x**(L*b.y + t)",
    "constants": "pi*b.x + 30*deg*b.y**2 + 0.123456789*b.x*b.y*t - 1/3",
}


class UserCase(Case):
    """A kernel of expressions in b.x, b.y, L and t."""

    def __init__(self, role, texts, rows=(), sign=1):
        rng = random.Random(3)
        self.kernel = user_kernel(role, tuple(map(parse, texts)), rows, ("b.x", "b.y"), ("L",))
        self.n, self.rows = 2, len(texts) if role != "force" else 0
        self.element = ELEMENTS["coordinate_coordinate_position"]  # for its one given function of time
        q, u, s, self._p, nu = (
            np.array([mpmath.mpf(rng.uniform(0.4, 0.9)) for _ in range(count)], dtype=object)
            for count in (2, 2, 3, 1, self.rows)
        )
        self.inputs = {"q": sign * q, "u": u, "s": s}
        self.last = {} if role == "force" else {"nu": nu}
        self.a = np.array([mpmath.mpf(rng.uniform(0.4, 0.9)) for _ in range(2)], dtype=object)

    @property
    def flat(self):
        return self._p


@pytest.mark.parametrize("role", ["holonomic", "nonholonomic"])
@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_a_constraint_written_as_an_expression_has_its_value_and_derivatives(role, text):
    text = text if role == "holonomic" else f"({text})*rate(b.y) - rate(b.x)"
    case = UserCase(role, [text])
    q, u = case.inputs["q"], case.inputs["u"]
    names = {"b.x": q[0], "b.y": q[1], "L": case.flat[0], "t": case.s[0]}
    value = parse(text).evaluate(names, mpmath_arithmetic(), {"b.x": u[0], "b.y": u[1]})
    out, linear = case.run("dynamics"), case.run("linearize")
    assert_close(out["E"], [value])
    assert_close(out["B"], case.rate("V"))
    assert_close(out["J"], case.slope(lambda out: out["V"], "u"))
    assert_close(linear["K"], case.slope(lambda out: out["J"].T @ case.last["nu"], "q"))
    assert_rows_linearized(case)
    if role == "holonomic":
        assert_close(out["V"], case.rate("E"))
    else:
        assert_close(linear["D"], case.slope(lambda out: out["E"], "q"))


def test_a_force_written_as_expressions_acts_on_the_coordinates_it_names():
    case = UserCase("force", ["-L*b.x*rate(b.y)**2", "sin(b.x + t)"], ("b.x", "b.y"))
    q, u = case.inputs["q"], case.inputs["u"]
    assert_close(case.run("dynamics")["F"], [case.flat[0] * q[0] * u[1] ** 2, -mpmath.sin(q[0] + case.s[0])])
    assert_close(case.run("linearize")["K"], case.slope(lambda out: out["F"], "q"))
    assert_close(case.run("linearize")["R"], case.slope(lambda out: out["F"], "u"))


@pytest.mark.parametrize("text", ["abs(b.x) - b.x + b.y", "sqrt(b.x**2) - b.x + b.y", "abs(b.x*b.y) - b.x*b.y + b.y"])
def test_what_holds_for_positive_numbers_only_is_not_taken_for_an_identity(text):
    case = UserCase("holonomic", [text], sign=-1)
    x, y = case.inputs["q"]
    expected = {"a": abs(x) - x + y, "s": abs(x) - x + y}[text[0]] if "*b.y" not in text else y
    assert_close(case.run("dynamics")["E"], [expected])
    assert_close(case.run("dynamics")["J"], case.slope(lambda out: out["E"], "q"))


def test_a_smooth_start_can_be_written_in_a_constraint_and_starts_at_time_zero():
    kernel = user_kernel("holonomic", (parse("b.x - smooth_start(t)"),), (), ("b.x",), ())
    E, V, J, _ = kernel.dynamics(FLOAT, [0.0], [0.0], [], [0.0, 1.0, 0.0])
    assert (E, V, J) == (0.0, 0.0, 1)


# --- special states: upright, at rest, axes along coordinates, where common factors vanish ----------------------------
# A kernel that divides by something its definition does not divide by is right at random
# states and wrong at the states people ask about.


# Lengths that a definition divides by, and vectors that may not vanish.
POSITIVE = {
    "length",
    "lead",
    "radius",
    "mass",
    "stiffness",
    "damping",
    "tube",
    "rest",
    "cornering",
    "aligning",
    "peak",
    "shape_factor",
    "relaxation",
    "half_gauge",
    "scale",
}
SEMI_AXES = (2, 3, 1)  # and the ball inside it has the shortest


def states(name):
    """Yield inputs made of 0, 1 and right angles, such that the definition itself has a value."""
    element = ELEMENTS[name]
    frame = name.removesuffix(f"_{element.name}")
    # Wheels must not stand: slip has no value at rest.
    moving = "xyz" * (not {"cornering", "aligning", "conicity"}.isdisjoint(dict(element.parameters)))
    ones = [mpmath.mpf(1)] * element.states
    rng = random.Random(name)
    half_turn = mpmath.pi / 2
    # Each further pair of bodies may have an angle without a value.
    for trial in range(12 * max(1, element.slots - 1)):
        q, u, a = [], [], []
        for slot, coordinate in itertools.product(range(element.slots), COORDINATES[frame]):
            # Distinct places: a spring of zero length has no direction.
            turns = coordinate in ("phi", "psi") or (coordinate == "theta" and frame == "planar")
            angle = rng.choice([0, 0, half_turn, -half_turn]) if turns else 0
            q.append(mpmath.mpf(slot * 2 + 1) if coordinate == "x" else mpmath.mpf(angle))
            u.append(mpmath.mpf(rng.choice([1] if coordinate in moving else [0, 0, 1])))
            a.append(mpmath.mpf(rng.choice([0, 0, 1])))
        q, u, a = q + ones, u + ones, a + ones
        p = []
        if frame == "spatial":
            p = [mpmath.mpf(i == j) for _ in range(element.slots) for i in range(3) for j in range(3)]
        for number, (parameter, count) in enumerate(parameter_sizes(element, frame)):
            if parameter == "ball":
                p.append(mpmath.mpf(min(SEMI_AXES)))
            elif count == 1:
                p.append(mpmath.mpf(1 if parameter in POSITIVE else rng.choice([0, 1])))
            elif parameter in ("first", "second", "center", "point"):
                p += [mpmath.mpf(0)] * count
            elif parameter == "semi_axes":
                p += [mpmath.mpf(x) for x in SEMI_AXES]
            elif parameter == "inertia":
                p += [mpmath.mpf(x) for x in ([1, 1, 2, 0, 0, 0] if trial % 2 else [1, 2, 2, 0, 0, 0])]
            else:
                axis = {"axle": 1, "normal": 2 if frame == "spatial" else 1}.get(parameter, (number + trial) % count)
                p += [mpmath.mpf(i == axis) for i in range(count)]
        s = [mpmath.mpf(rng.choice([0, 1])) for _ in range(3 * element.signals)]
        yield q, u, a, p, s


@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_a_kernel_has_the_same_value_at_a_special_state_as_next_to_it(name):
    element = ELEMENTS[name]
    kernel = importlib.import_module(f"mbstab.compiler.kernels.{name}")
    tried = 0
    with mpmath.workdps(60):
        f = mpmath_arithmetic()
        for q, u, a, p, s in states(name):
            rows = {"planar": 2, "spatial": 3}[name.split("_")[0]] if element.name == "coincident" else 1
            last = {"inertia": [a], "force": []}.get(element.role, [[mpmath.mpf(1)] * rows])
            # Next to the state, in a direction in which nothing vanishes.
            step = mpmath.mpf(10) ** -25
            near = [[x + step * (i + 1) / 7 for i, x in enumerate(group)] for group in (q, u, p, s)]
            calls = (("dynamics", []), ("linearize", last))
            away = [[2 * x - y for x, y in zip(*pair, strict=True)] for pair in zip((q, u, p, s), near, strict=True)]
            try:
                beside = [getattr(kernel, function)(f, *near, *extra) for function, extra in calls]
                others = [getattr(kernel, function)(f, *away, *extra) for function, extra in calls]
            except ValueError:  # a root of what is not positive next to here
                continue
            jumps = "signum" in inspect.getsource(kernel)
            if jumps and any(x != pytest.approx(y, abs=1e-12) for x, y in zip(others, beside, strict=True)):
                continue
            if any(abs(x) > 1e12 for values in beside for x in values):  # the definition itself has no value here
                continue
            if any(abs(abs(x) - mpmath.pi) < 1e-12 for x in beside[0]):  # half a turn off, where an angle jumps
                continue
            for (function, extra), expected in zip(calls, beside, strict=True):
                floats = [[float(x) for x in group] for group in (q, u, p, s)]
                exact = getattr(kernel, function)(FLOAT, *floats, *[[float(x) for x in group] for group in extra])
                assert [float(x) for x in expected] == pytest.approx(list(exact), rel=1e-12, abs=1e-12)
                tried += 1
    assert tried >= 6
