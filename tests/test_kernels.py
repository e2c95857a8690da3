"""Every kernel at a random state off symmetry and in motion: derivatives, definitions, arithmetics.

Derivatives are compared with differences in 50 digits; definitions with kinematics
written here, from rotation matrices and displaced states only.
"""

import inspect
import itertools
import random

import mpmath
import numpy as np
import pytest
from element_tables import HOLONOMIC, NONHOLONOMIC, POWER, STEP, Body, turn, unit
from mpmath_numbers import mpmath_arithmetic

import mbstab
from mbstab.compiler.derive import parameter_sizes
from mbstab.compiler.kernels import load
from mbstab.compiler.user import user_kernel
from mbstab.mechanics.catalogue import COORDINATES
from mbstab.mechanics.elements import ELEMENTS
from mbstab.model.arithmetic import FLOAT, array_arithmetic
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
        self.kernel = load(name)
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


@pytest.mark.parametrize("name", [x for x in named("nonholonomic") if "_measure_" not in x])
def test_D_is_the_derivative_of_a_nonholonomic_row_by_the_coordinates(name):
    """Measures are no rows: they have no D, and `linearize_rows` has their derivatives."""
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
            elif count == 10:  # of an angle: the direction it counts from, those it counts in, half turns
                p += [mpmath.mpf(i == (axis + trial) % 3) for axis in (0, 0, 1) for i in range(3)] + [mpmath.mpf(0)]
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
    kernel = load(name)
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
            jumps = any(name in inspect.getsource(kernel) for name in ("signum", "atan2"))
            if jumps and any(x != pytest.approx(y, abs=1e-12) for x, y in zip(others, beside, strict=True)):
                continue
            if any(abs(x) > 1e12 for values in beside for x in values):  # the definition itself has no value here
                continue
            if any(abs(abs(x) - mpmath.pi) < 1e-12 for x in beside[0]):  # half a turn off, where an angle jumps
                continue
            for (function, extra), expected in zip(calls, beside, strict=True):
                floats = [[float(x) for x in group] for group in (q, u, p, s)]
                try:
                    exact = getattr(kernel, function)(FLOAT, *floats, *[[float(x) for x in group] for group in extra])
                except ZeroDivisionError:
                    assert jumps  # the sense of a wheel that does not roll, the angle of a direction that is none
                    continue
                assert [float(x) for x in expected] == pytest.approx(list(exact), rel=1e-12, abs=1e-12)
                tried += 1
    assert tried >= 6


def test_the_mass_matrix_of_a_body_beside_its_centre_of_mass_is_exactly_diagonal_in_its_place():
    body = "{type: spatial, mass: 3, inertia: [1, 2, 2.5], center_of_mass: [0.1, 0.2, 0.3], axes: [0.3, 0.7, 1.1]}"
    system = mbstab.loads(f"mbstab: 1\ngravity: [0, 0, 0]\nbodies: {{a: {body}}}\n").system()
    M = system.dynamics(np.full(6, 0.3), np.zeros(6), 0.0).M
    assert np.array_equal(M[:3, :3], 3.0 * np.eye(3))


@pytest.mark.parametrize("distance", [0.0, 0.25])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_forces_along_a_distance_have_their_slopes_where_it_is_zero(power, distance):
    text = f"""\
mbstab: 1
gravity: [0, 0]
bodies: {{a: {{type: planar_point, mass: 2}}}}
forces: {{law: {{type: expression, on: {{"distance(a, ground)": "-6*distance(a, ground)**{power}"}}}}}}
"""
    system = mbstab.loads(text).system()
    K, *_ = system.linearize(np.array([distance, 0.0]), np.zeros(2), np.zeros(2), np.zeros(0), 0.0)
    slope = 6.0 * distance ** (power - 1)
    assert pytest.approx(np.diag([power * slope, slope]), abs=1e-14) == K
