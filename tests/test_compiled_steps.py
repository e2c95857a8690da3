"""Compiled steps: every operation, the linear equations, and motions that are those of the steps taken one by one."""

import importlib
import math
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from chains import straight_chain
from sampling import sample

import mbstab
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.simulate.start import start_of
from mbstab.analysis.simulate.steppers import compiled
from mbstab.analysis.simulate.steppers.compiled import Marching
from mbstab.analysis.simulate.steppers.interface import Options
from mbstab.analysis.simulate.steppers.layout import Elimination
from mbstab.analysis.simulate.steppers.table import METHODS
from mbstab.compiler.machine import tables
from mbstab.compiler.trace import OPERATIONS, Trace
from mbstab.errors import SimulationError, UsageError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.functions import TABLE
from mbstab.model.library import installed_models

numba = pytest.importorskip("numba")
explicit, interpreter, linear, native = (
    importlib.import_module(f"mbstab.compiler.machine.{name}")
    for name in ("explicit", "interpreter", "linear", "native")
)
MODELS = {path.stem: path for path in installed_models()}


@native.called
def interpret(m, start, stop):
    return interpreter.interpret(m, start, stop)


@native.called
def slope(m, t, y, dy):
    return linear.slope(m, t, y, dy)


@native.called
def power(m, y):
    return linear.power(m, y)


@native.called
def factor_and_solve(m):
    linear.factor(m)
    native.floats(m, tables.B)[:] = 1.0
    return linear.solve(m)


def compiled_steps(name, perturb=None, **parameters):
    start = start_of(mbstab.load(name).system(**parameters), perturb, None, False)
    equations, attitudes = Constrained(start.system, start.motion), Attitudes.of(start.system)
    method = METHODS["projection"]["DOP853"]
    return Marching(equations, attitudes, Energy.of(start.system), method), equations, start


# --- operations -----------------------------------------------------------------------------------------------------

VALUES = [-2.5, -1.0, -0.3, 0.0, 0.4, 1.0, 3.0]
SYMBOLS = {"+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y, "/": lambda x, y: x / y}


def of_floats(operation, x, y):
    """Return what Python makes of an operation, None where it refuses."""
    try:
        if operation in SYMBOLS:
            value = SYMBOLS[operation](x, y)
        elif operation == "negative":
            value = -x
        else:
            function = getattr(FLOAT, operation)
            value = function(x, y) if operation == "power" or TABLE[operation].arguments == 2 else function(x)
    except (ArithmeticError, ValueError):
        return None
    return value if math.isfinite(value) else None


@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_operation_is_that_of_floats(operation):
    some, one_body = 0, compiled_steps("pendulum")[0].machine
    for x in [*VALUES, 800.0]:
        for y in VALUES:
            arrays = {k: np.zeros(0) for k in range(tables.FLOATS)}
            arrays |= {tables.RUN_OPERATION: [OPERATIONS.index(operation)], tables.RUN_START: [0, 1]}
            arrays |= {tables.FIRST: [0], tables.SECOND: [1], tables.W: [x, y, math.nan]}
            numbers = {name: getattr(one_body, name) for name in one_body._fields[2:]} | {"base": 2}
            one = tables.machine(arrays, **numbers)
            expected = of_floats(operation, x, y)
            assert interpret(one, 0, 1) == (expected is not None), (x, y)
            if expected is not None:
                assert tables.table(one, tables.W)[2] == pytest.approx(expected, rel=4e-16, abs=0.0), (x, y)
                some += 1
    assert some > 20


def test_machine_code_that_is_kept_belongs_to_these_operations_and_modules(tmp_path, monkeypatch):
    # Numba keeps it by the name and the file of a function, and does not see what has changed elsewhere.
    folder = Path(native.__file__).parent
    copied = [Path(shutil.copy(path, tmp_path)) for path in folder.glob("*.py")]
    assert native.version(tmp_path) == native.version(folder) == native.VERSION
    copied[0].write_text("x = 1", encoding="utf-8")
    assert native.version(tmp_path) != native.VERSION
    monkeypatch.setitem(native.TEXTS, "abs", "x")
    assert native.version(folder) != native.VERSION
    assert explicit.march.py_func.__qualname__ == f"march_{native.VERSION}"


def test_a_program_is_that_of_the_text():
    trace = Trace()
    x, y, unused = (trace.input(name) for name in "xyz")
    f = trace.arithmetic()
    groups = [[f.exp(-x) * y, 3.0], [-(x / y), f.atan2(-y, x), f.exp(-x) * y + 2.0, 0.0, x]]
    code = trace.code([x, y, unused], groups)
    assert code.ends[0] < code.ends[1] == len(code.runs)
    values = {0: 0.7, 1: 1.9, 2: math.nan}
    registers = [*values.values(), *code.constants]
    start = 0
    for operation, end in code.runs:
        for one, other in code.operands[start:end]:
            registers.append(of_floats(OPERATIONS[operation], registers[one], registers[other]))
        start = end
    found = [-registers[i] if negative else registers[i] for i, negative in code.results]
    a, b = 0.7, 1.9
    part = math.exp(-a) * b
    assert found == pytest.approx([part, 3.0, -a / b, math.atan2(-b, a), part + 2.0, 0.0, a], rel=1e-15)


# --- linear equations -----------------------------------------------------------------------------------------------


def test_the_order_of_elimination_puts_rows_after_their_coordinates_and_knows_every_place():
    rng = np.random.default_rng(3)
    for _ in range(20):
        n, rows = 12, 7
        A = np.zeros((n + rows, n + rows), dtype=bool)
        A[:n, :n] = rng.random((n, n)) < 0.1
        A[n:, :n] = rng.random((rows, n)) < 0.25
        A |= A.T | np.eye(n + rows, dtype=bool)
        A[n:, n:] = False
        neighbours = [set(np.flatnonzero(row).tolist()) - {i} for i, row in enumerate(A)]
        elimination = Elimination.of(neighbours, n)
        place = np.array(elimination.place)
        assert sorted(place) == list(range(n + rows))
        for row in range(n, n + rows):
            assert all(place[j] < place[row] for j in neighbours[row])
        values = np.where(A, rng.uniform(0.5, 1.5, A.shape), 0.0)
        values = values + values.T + 40.0 * np.diag([*np.ones(n), *-np.ones(rows)])
        values[n:, n:] -= np.diag(np.full(rows, 40.0))  # dominant: no pivoting is needed
        permuted = np.empty_like(values)
        permuted[np.ix_(place, place)] = values
        factor = _ldl(permuted)
        for k, column in enumerate(elimination.columns):
            assert set(np.flatnonzero(np.abs(factor[k + 1 :, k]) > 1e-14) + k + 1) <= set(column)


def _ldl(A):
    L, A = np.eye(len(A)), A.copy()
    for k in range(len(A)):
        L[k + 1 :, k] = A[k + 1 :, k] / A[k, k]
        A[k + 1 :, k + 1 :] -= np.outer(L[k + 1 :, k], A[k, k + 1 :])
    return L


@pytest.mark.few(3)
@pytest.mark.parametrize("name", sample(sorted(MODELS, key=lambda name: name == "andrews_squeezer"), 2))
def test_accelerations_and_power_are_those_of_the_system_at_any_state(name):
    steps, equations, start = compiled_steps(MODELS[name])
    m, system, n = steps.machine, start.system, equations.n
    steps.start(system, 0.0, start.motion.q, start.motion.u, np.array([1.0]), 1.0, _options(), 0.0, 1e-3)
    rng = np.random.default_rng(5)
    energy = Energy.of(system)
    parts = {path: part for path, part in system.parts() if path in {*energy.working, *energy.damped}}
    for _ in range(4):
        t = start.motion.time + rng.uniform(0.0, 0.5)
        q = start.motion.q + 0.2 * rng.uniform(-1.0, 1.0, n) * equations.sizes
        u = start.motion.u + rng.uniform(-1.0, 1.0, n) * equations.sizes
        dy = np.empty(2 * n)
        assert slope(m, t, np.concatenate([q, u]), dy)
        state = system.dynamics(q, u, t)
        kept = equations.kept
        A = np.block([[state.M, state.J[kept].T], [state.J[kept], np.zeros((len(kept), len(kept)))]])
        scale = np.concatenate([equations.scale, equations.row_scale[kept]])
        A = A * scale * scale[:, None]
        expected = np.linalg.solve(A, -np.concatenate([state.F0, state.B[kept]]) * scale) * scale
        limit = 1e-13 * np.linalg.cond(A) * np.max(np.abs(expected / scale)) * scale[:n]
        assert np.all(np.abs(dy[n:] - expected[:n]) <= limit)
        assert dy[:n].tolist() == u.tolist()
        nu = np.zeros(system.n_c)
        nu[kept] = expected[n:]
        terms = sum(energy.powers(parts, q, u, t).values()) - (float(nu @ (state.J @ u)) if energy.driven else 0.0)
        assert power(m, np.concatenate([q, u])) == pytest.approx(
            terms, rel=1e-9, abs=1e-10 * float(np.abs(nu) @ np.abs(state.J) @ np.abs(u) + 1.0)
        )


def _options():
    return Options(METHODS["projection"]["DOP853"], 1e-8, None, 1e-3, 1.0)


def test_inertias_of_zero_do_no_harm_and_a_singular_matrix_is_seen():
    text = """
mbstab: 1
title: A rod without inertia on a cart
bodies:
  cart: {type: planar, mass: 1, inertia: 1}
  link: {type: planar, mass: 1, inertia: 0, points: {A: [0, 0], B: [0, -1]}}
  bob: {type: planar, mass: 2, inertia: 0.1}
gravity: [0, -9.81]
joints:
  one: {type: revolute, between: [cart, link.A]}
  two: {type: revolute, between: [link.B, bob]}
constraints:
  rail: {holonomic: cart.y}
  level: {holonomic: cart.theta}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, link: {x: 0, y: 0, theta: 0}, bob: {x: 0, y: -1, theta: 0}}
"""
    model = mbstab.loads(text)
    options = {"perturb": {"link.theta": 0.5}, "tol": 1e-9, "points": 11}
    one, other = (model.simulate(0.5, compiled=x, **options) for x in (False, True))
    assert np.max(np.abs(one.q - other.q)) < 1e-7
    m = compiled_steps("pendulum")[0].machine
    tables.table(m, tables.W)[:] = 0.0  # a matrix of zeros
    assert not factor_and_solve(m)


# --- motions --------------------------------------------------------------------------------------------------------

MOTIONS = {
    "pendulum": ({"rod.theta": 1.0}, {}),
    "top": ({"top.theta": 0.3}, {}),
    "rolling_disk": ({"disk.phi": 0.02, "rate(disk.theta)": 0.1}, {}),
    "governor": ({"right_crank.psi": 0.2}, {}),
    "free_rigid_body": ({"mode:1": 0.2}, {}),  # its angles are replaced on the way
    "whipple_bicycle": ({"mode:1": 0.1}, {"v": 5.0}),
    "chaplygin_sleigh": ({"mode:1": 0.1}, {}),
    "bricard": ({}, {}),  # with a row that others imply
    "kapitza": ({"rod.theta": 0.1}, {}),
    "trailer": ({"mode:1": 0.05}, {}),
    "zener": ({"mode:1": 0.1}, {}),  # with a first-order state
    "car_relaxation": ({"mode:1": 0.05}, {}),
    "dc_motor_arm": ({"mode:1": 0.05}, {}),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("name", MOTIONS)
def test_compiled_steps_are_the_same_steps(name):
    perturb, parameters = MOTIONS[name]
    model = mbstab.load(MODELS[name])
    one, other = (
        model.simulate(2.0, perturb=perturb, tol=1e-9, once=True, points=21, compiled=x, **parameters)
        for x in (False, True)
    )
    assert abs(one.steps - other.steps) <= 1 + 0.02 * one.steps
    assert one.charts == other.charts
    size = np.max(np.abs(one.q - one.q[0])) + 1e-3
    assert np.max(np.abs(one.q - other.q)) < 2e-7 * size
    assert np.max(np.abs(one.u - other.u)) < 2e-6 * (np.max(np.abs(one.u)) + 1e-3)
    assert np.max(np.abs(one.work - other.work)) < 1e-6 * one.energy_scale
    assert other.max_constraint_residual < 1e-12
    assert other.energy_drift < 3.0 * one.energy_drift + 1e-7


IMPLICIT = [name for name, solvers in METHODS.items() if any(x.compiled == name for x in solvers.values())]


@pytest.mark.long
@pytest.mark.parametrize("method", IMPLICIT)
@pytest.mark.parametrize("name", sample(MOTIONS, 6))
@pytest.mark.parametrize("accuracy", [{"tol": 1e-5, "once": True}, {"step": 0.01}], ids=["tolerance", "step"])
def test_compiled_implicit_steps_are_those_of_the_interpreted_method(method, name, accuracy):
    perturb, parameters = MOTIONS[name]
    model = mbstab.load(MODELS[name])
    if name == "kapitza" and "step" in accuracy:
        accuracy = {"step": 0.001}  # its support moves up and down within 0.06 s
    one, other = (
        model.simulate(1.0, perturb=perturb, method=method, points=21, compiled=x, **accuracy, **parameters)
        for x in (False, True)
    )
    assert abs(one.steps - other.steps) <= 1 + 0.02 * one.steps
    assert one.charts == other.charts
    # With fixed steps both solve the same equations; else each step has errors of its own.
    off = accuracy.get("tol", 1e-8)
    size = np.max(np.abs(one.q - one.q[0])) + 1e-3
    assert np.max(np.abs(one.q - other.q)) < off * size
    assert np.max(np.abs(one.u - other.u)) < 10.0 * off * (np.max(np.abs(one.u)) + 1e-3)
    # Work is summed differently along the same steps: it is as near to the truth.
    work = model.simulate(1.0, perturb=perturb, tol=1e-10, points=21, once=True, **parameters).work
    errors = [np.max(np.abs(x.work - work)) for x in (one, other)]
    assert errors[1] < 1.5 * errors[0] + off * one.energy_scale
    assert other.max_constraint_residual < 1e-12
    assert other.energy_drift < 1.5 * one.energy_drift + off


@pytest.mark.long
def test_compiled_steps_of_radau_are_long_where_a_motion_is_stiff():
    # A bead on a parabola, held to cos(t) by a stiff spring, without friction: it starts where the spring balances.
    model = mbstab.loads("""
mbstab: 1
title: A bead on a stiff spring
bodies: {p: {type: point, mass: 1}}
constraints: {a: {holonomic: p.y - 0.1*p.x**2}, b: {holonomic: p.z}}
forces: {f: {type: expression, on: {p.x: "-1e9*(p.x - cos(t)) - 1e5*rate(p.x)"}}}
initial: {coordinates: {p: {x: 1, y: 0.1, z: 0}}}
reference: {coordinates: {p: {x: 0, y: 0, z: 0}}}
""")
    options = {"method": "radau", "tol": 1e-6, "points": 16, "once": True}
    one, other = (model.simulate(1.5, compiled=x, **options) for x in (False, True))
    assert np.max(np.abs(one.q - other.q)) < 1e-6
    assert np.max(np.abs(other.q[:, 0] - np.cos(other.times - 1e-4))) < 1e-6
    assert other.steps <= one.steps + 2 < 300  # an explicit method takes more than 10 000


@pytest.mark.long
@pytest.mark.parametrize("method", IMPLICIT)
def test_the_work_of_a_drive_is_that_of_compiled_implicit_steps(method):
    model = mbstab.loads("""
mbstab: 1
title: A driven body with a damper
gravity: [0, -9.81]
bodies: {a: {type: planar, mass: 1, inertia: 0.1, points: {O: [-0.3, 0]}}}
joints: {h: {type: revolute, between: [a.O, ground]}}
drives: {m: {type: joint, joint: h, velocity: 1 + sin(t)}}
reference: {coordinates: {a: {x: 0.3, y: 0, theta: 0}}, rates: {a: {theta: 1}}}
""")
    sim = model.simulate(3.0, method=method, tol=1e-5, points=31, compiled=True)
    angle = sim.times + 1.0 - np.cos(sim.times)
    rate = 1.0 + np.sin(sim.times)
    inertia = 0.1 + 0.3**2
    exact = 0.5 * inertia * (rate**2 - 1.0) + 9.81 * 0.3 * np.sin(angle)
    assert np.max(np.abs(sim.q[:, 2] - angle)) < 3e-5
    assert np.max(np.abs(sim.work - exact)) < 1e-3


@pytest.mark.parametrize(("solver", "step"), [("DOP853", 0.1), ("RK45", 0.05)])
def test_compiled_steps_of_fixed_size_have_the_error_of_the_method(solver, step):
    model = mbstab.load("pendulum.yaml")
    options = {"perturb": {"rod.theta": 1.0}, "once": True, "points": 2}
    exact = model.simulate(2.0, tol=1e-13, **options).q[-1]
    one, other = (model.simulate(2.0, solver=solver, step=step, compiled=x, **options).q[-1] for x in (False, True))
    error = float(np.max(np.abs(one - exact)))
    assert error > 1e-9
    assert np.max(np.abs(other - one)) < 1e-4 * error


def test_a_body_that_tumbles_needs_one_program_only(monkeypatch):
    made = []
    of = compiled.machine_of
    monkeypatch.setattr(compiled, "machine_of", lambda *arguments: made.append(1) or of(*arguments))
    model = mbstab.loads("""
mbstab: 1
title: A free body
bodies: {body: {type: spatial, mass: 1, inertia: [1, 2, 3]}}
reference: {coordinates: {body: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}, rates: {body: {phi: 1.5, psi: 0.9}}}
""")
    one, other = (model.simulate(30.0, tol=1e-9, compiled=x, points=101) for x in (False, True))
    assert one.charts == other.charts >= 2
    assert made == [1]
    assert np.max(np.abs(one.rotations - other.rotations)) < 1e-7
    assert np.max(np.abs(one.q - other.q)) < 1e-6
    assert other.energy_drift < 1e-8


TOLERANCES = {"projection": (1e-4, 1e-7, 1e-10), "alpha": (1e-3, 1e-5), "radau": (1e-4, 1e-7, 1e-10)}


@pytest.mark.few(1)
@pytest.mark.parametrize("method", METHODS)
def test_the_tolerance_holds_for_compiled_steps(method):
    model = mbstab.load("pendulum.yaml")
    exact = model.simulate(10.0, perturb={"rod.theta": 2.0}, tol=1e-12, points=11)
    for tol in TOLERANCES[method]:
        sim = model.simulate(10.0, perturb={"rod.theta": 2.0}, tol=tol, points=11, compiled=True, method=method)
        assert np.max(np.abs(sim.rotations - exact.rotations)) < 3.0 * tol
        assert sim.error_estimate <= tol


@pytest.mark.few(1)
@pytest.mark.parametrize("method", METHODS)
def test_a_singular_configuration_is_found_between_compiled_steps(method):
    options = {"method": method, "once": method != "projection", "tol": 1e-8 if method == "projection" else 1e-5}
    model = mbstab.load("n_four_bar.yaml")
    told = []
    for steps in (False, True):
        with pytest.raises(SimulationError, match="singular configuration") as caught:
            model.simulate(3.0, perturb={"rate(crank_1.theta)": 9.0}, compiled=steps, **options)
        told.append(float(re.search(r"at t = (\S+) s", str(caught.value))[1]))
        assert told[-1] - 0.03 < caught.value.partial.times[-1] < told[-1]
    assert told[0] == pytest.approx(told[1], abs=10.0 * options["tol"])


LAWS = {
    "torque": "forces: {m: {type: torque, body: a, vector: [0, 0, sin(t)]}}",
    "start": "forces: {m: {type: torque, body: a, vector: [0, 0, smooth_start(t/0.7)]}}",
    "joint": "drives: {m: {type: joint, joint: h, position: 0.3*sin(2*t)}}",
    "rate": "drives: {m: {type: joint, joint: h, velocity: exp(-t) + t**2}}",
}


@pytest.mark.parametrize("law", LAWS)
def test_laws_of_time_move_bodies_in_space(law):
    model = mbstab.loads(f"""
mbstab: 1
title: A body on a hinge
gravity: [0, -9.81, 0]
bodies: {{a: {{type: spatial, mass: 1, inertia: [0.1, 0.2, 0.3], center_of_mass: [0.2, 0, 0]}}}}
joints: {{h: {{type: revolute, between: [a, ground], axis: z}}}}
{LAWS[law]}
reference: {{rates: {{a: {{psi: {"0" if "forces" in LAWS[law] else "0.6" if law == "joint" else "1"}}}}}}}
""")
    one, other = (model.simulate(2.0, tol=1e-9, points=21, compiled=x) for x in (False, True))
    assert np.max(np.abs(one.q)) > 0.1
    assert np.max(np.abs(one.q - other.q)) < 1e-8
    assert np.max(np.abs(one.work - other.work)) < 1e-7
    assert other.energy_drift < 1e-7


@pytest.mark.few(1)
@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_loses_its_value_ends_the_motion_with_the_same_words(method):
    text = """
mbstab: 1
title: A mass that is pulled out of the domain of its force
bodies: {b: {type: point, mass: 1}}
forces: {f: {type: expression, on: {b.x: 1 + sqrt(1 - b.x)}}}
reference: {coordinates: {b: {x: 0, y: 0, z: 0}}, rates: {b: {x: 0, y: 0, z: 0}}}
"""
    told, texts = [], []
    for steps in (False, True):
        with pytest.raises(SimulationError) as caught:
            mbstab.loads(text).simulate(5.0, compiled=steps, method=method, tol=1e-5, once=True)
        told.append(caught.value.partial.times[-1])
        first, _, rest = str(caught.value).partition("\n")
        texts.append((re.sub(r"[0-9.]+(e-\d+)?", "", first), rest))
    assert told[0] == told[1] > 0.5
    assert "the step size has collapsed" in texts[0][0]
    assert texts[0] == texts[1]


def test_progress_is_told_and_a_stop_keeps_what_was_found():
    seen = []

    def progress(done):
        seen.append(done)
        if done > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(SimulationError, match="stopped") as caught:
        mbstab.load("pendulum.yaml").simulate(
            3000.0, perturb={"rod.theta": 1.0}, once=True, compiled=True, progress=progress
        )
    assert len(seen) > 2
    assert 0.25 < caught.value.partial.times[-1] / 3000.0 < 0.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solver": "Radau"}, "no compiled steps for projection Radau"),
        ({"solver": "BDF"}, "projection RK45, alpha, radau"),
    ],
)
def test_other_methods_have_no_compiled_steps(options, message):
    with pytest.raises(UsageError, match=message):
        mbstab.load("pendulum.yaml").simulate(1.0, compiled=True, **options)


def test_compiled_steps_need_numba(monkeypatch):
    monkeypatch.setitem(sys.modules, "mbstab.compiler.machine.native", None)
    with pytest.raises(UsageError, match=r"mbstab\[fast\]"):
        mbstab.load("pendulum.yaml").simulate(1.0, compiled=True)


def test_parts_of_machine_code_stand_in_what_calls_them_and_nowhere_else():
    part = native._translated(lambda x: math.sqrt(x) + 1.0, no_cpython_wrapper=True)
    whole = native._translated(lambda x: 2.0 * part(x))
    assert whole(9.0) == 8.0
    (inner,), (outer,) = (list(f.overloads.values()) for f in (part, whole))
    # Another piece may have a part of the same name: it must not be found by it.
    names = {f.name: f.linkage.name for f in outer.library.get_defined_functions()}
    assert "linkonce_odr" not in names.values()
    assert names.get(inner.fndesc.llvm_func_name, "internal") == "internal"
    assert outer.library.get_pointer_to_function(outer.fndesc.llvm_func_name)
    assert not inner.library.get_pointer_to_function(inner.fndesc.llvm_func_name)


def test_compiling_is_told_step_by_step_and_that_of_others_is_not(monkeypatch):
    first, second = numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)
    monkeypatch.setattr(native, "MADE", {first.py_func, second.py_func})
    told = []
    with native.telling(told.append):
        numba.njit(lambda x: x + 3)(1)  # none of ours
        assert told == []
        first(1)
        first(2)
        second(1)
    second(1.0)
    assert told == [0.0, 0.5, 1.0]


def test_runs_that_show_other_motions_are_no_estimate():
    # This double pendulum is chaotic: runs with larger tolerances differ from each other by as much as it moves.
    chain, start = mbstab.loads(straight_chain(2)), {"rod_0.theta": 1.3}
    exact = chain.simulate(40.0, perturb=start, tol=1e-12, once=True, points=51, compiled=True)
    sim = chain.simulate(40.0, perturb=start, tol=1e-3, points=51, compiled=True)
    assert sim.warnings == ()
    error = np.max(np.abs(sim.positions - exact.positions)) / np.max(exact.sizes)
    assert max(error, np.max(np.abs(sim.rotations - exact.rotations))) <= 1e-3
