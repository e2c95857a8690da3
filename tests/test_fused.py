"""Fused functions give what the system gives, on every model and at every state, and contain nothing of a file."""

import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import mbstab
from mbstab.analysis.accelerations import Accelerations
from mbstab.compiler import fused
from mbstab.compiler.fused import Fused
from mbstab.compiler.system import Dynamics
from mbstab.compiler.trace import Trace, Traced
from mbstab.errors import ConstraintError, MassError, NumericalError, UsageError
from mbstab.model.arithmetic import FUNCTIONS
from mbstab.model.expressions import ExpressionError
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}
STATES = 5
ROUNDING = 2e-13

DRIVEN = """
mbstab: 1
title: Everything that depends on time, and every function
parameters:
  a: {value: 2, unit: "1", description: a number}
bodies:
  b: {type: planar, mass: 1, inertia: 2, points: {P: [0.3, 0.1]}}
  c: {type: planar, mass: 3, inertia: 1}
forces:
  f:
    type: expression
    on:
      b.x: abs(b.y)*smooth_start(t) + sinh(b.theta)**2.5*tanh(a) + asin(b.theta/9)*acos(c.theta/9) + log(b.theta)
      b.theta: rate(b.x)*abs(rate(b.y))**3*exp(a) + t**2*cosh(b.theta) + atan2(c.y, b.x)*atan(t)*tan(c.theta)
  g: {type: force, at: b.P, vector: [smooth_start(t)*abs(sin(3*t + 1)), (t + 2)**1.5 - (t + 1)**t]}
  h: {type: torque, body: c, value: "sinh(t)*tanh(t) + atan2(t, 2)*log(t + 1) - exp(-t)*asin(t/9)"}
constraints:
  D: {nonholonomic: rate(c.x)*sin(c.theta + t) - rate(c.y)*cos(c.theta + t)**2}
drives:
  turn: {type: coordinate, coordinate: b.theta, position: sqrt((t - 1)**4) + cosh(t)/(1 + t**2)}
  go: {type: point, at: b.P, direction: [1, 2], velocity: acos(t/9)*atan(t) + tan(t/9)}
reference: {time: 0.4, coordinates: {b: {x: 1, y: 1, theta: 1}, c: {x: 1, y: 2, theta: 1}}}
"""


def states(system, seed=1):
    """Yield random states: time, q, u, a, nu."""
    rng = np.random.default_rng(seed)
    for _ in range(STATES):
        q, u, a = rng.uniform(0.2, 1.2, (3, system.n_q))
        yield rng.uniform(0.1, 0.9), q, u, a, rng.uniform(0.2, 1.2, system.n_c)


def same(found, expected):
    for x, y in zip(found, expected, strict=True):
        assert x.shape == y.shape
        assert x.dtype == float
        assert np.max(np.abs(x - y), initial=0.0) <= ROUNDING * np.max(np.abs(y), initial=0.0)


def parts(state):
    return [getattr(state, field.name) for field in fields(Dynamics)]


def compare(system, quick):
    # The fused functions must not be silent about a failure and ask the system.
    slow, quick.system = system, None
    quick.system = type("Clock", (), {"scene": slow.scene})
    for t, q, u, a, nu in states(slow):
        state = slow.dynamics(q, u, t)
        same(parts(quick.dynamics(q, u, t)), parts(state))
        same(quick.equations(q, u, t), (state.M, state.F0, state.J, state.B))
        same(quick.residuals(q, u, t), (state.E, state.V, state.J))
        same(quick.linearize(q, u, a, nu, t), slow.linearize(q, u, a, nu, t))
        same(quick.linearize_rows(q, u, a, t), slow.linearize_rows(q, u, a, t))
    same(parts(quick.dynamics(q.tolist(), u.tolist())), parts(slow.dynamics(q, u)))
    quick.system = slow


@pytest.fixture
def driven():
    return mbstab.loads(DRIVEN).system()


# --- the same numbers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MODELS)
def test_every_model_gives_what_its_system_gives(name):
    system = mbstab.load(MODELS[name]).system()
    compare(system, system.fused())


def test_laws_of_time_expressions_and_nonholonomic_rows_give_what_the_system_gives(driven):
    assert driven.n_n == 2
    compare(driven, driven.fused())


def test_parameters_are_those_of_the_scene():
    model = mbstab.load("top.yaml")
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    slow = model.system(omega=3.0)
    same(parts(slow.fused().dynamics(q, u, 2.0)), parts(slow.dynamics(q, u, 2.0)))
    assert model.system(omega=4.0).fused().residuals(q, u, 2.0)[0][3] == 0.3 - 8.0


def test_results_are_new_arrays_that_may_be_changed(driven):
    quick = driven.fused()
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    first = quick.equations(q, u)[0]
    first[:] = 7.0
    assert np.all(quick.equations(q, u)[0] != 7.0)


def test_where_only_the_system_has_a_value_it_is_taken(driven):
    # sqrt((t - 1)**4) stands still at t = 1, where the formula for its rate divides by zero.
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    assert parts(driven.fused().dynamics(q, u, 1.0))[0] is not None
    same(parts(driven.fused().dynamics(q, u, 1.0)), parts(driven.dynamics(q, u, 1.0)))


def test_what_does_not_exist_is_refused_as_by_the_system(driven):
    quick, u = driven.fused(), np.zeros(6)
    with pytest.raises(NumericalError, match=r"forces\.f has no finite equations here"):
        quick.dynamics(np.full(6, -0.3), u)
    with pytest.raises(NumericalError, match="overflow"):
        quick.equations(np.full(6, 0.3), np.full(6, 1e200))
    with pytest.raises(ExpressionError, match="math domain error"):
        quick.residuals(np.full(6, 0.3), u, 10.0)


def test_scenes_of_a_sweep_are_refused():
    from mbstab.compiler.system import System
    from mbstab.model.values import evaluate

    scene = evaluate(mbstab.load("top.yaml").model, {"omega": np.linspace(1.0, 2.0, 3)})
    with pytest.raises(ValueError, match="floats"):
        System(scene).fused()


# --- the text -------------------------------------------------------------------------------------------------------


def sources(quick):
    names = ("_dynamics", "_equations", "_residuals", "_linearize", "_linearize_rows")
    return [getattr(quick, name).source for name in names]


def test_the_text_holds_numbers_and_our_own_names_only(driven):
    own = re.compile(r"def|evaluate|return|pack|[quaw]\d*|nu\d*|t|_|e")
    functions = {*FUNCTIONS, "sign", "abs_slope", "power"}
    for source in sources(driven.fused()):
        words = set(re.findall(r"[A-Za-z_]\w*", source))
        assert all(own.fullmatch(word) for word in words - functions)
        assert re.sub(r"[\w.+\-*/=(),:\s]", "", source) == ""


def test_the_text_does_not_depend_on_the_hash_seed():
    code = "import mbstab; print(mbstab.load('rolling_disk.yaml').system().fused()._linearize.source)"
    texts = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(mbstab.__file__).parents[1])},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
    assert "def evaluate" in texts.pop()


def test_a_pendulum_takes_one_sine_and_one_cosine():
    source = mbstab.load("pendulum.yaml").system().fused()._equations.source
    assert source.count("sin(") == source.count("cos(") == 1
    assert "q0" not in source  # neither the matrices nor the rest of the equations depend on the place
    assert source.count("\n") < 25


def test_a_text_for_arrays_serves_other_parameters():
    trace = Trace()
    x = trace.input("q0")
    texts = [trace.array_text({"q": [x]}, [x * c + 5.0]) for c in (2.5, 3.5)]
    assert texts[0][0] == texts[1][0]
    assert [constants for _, constants in texts] == [[2.5, 5.0], [3.5, 5.0]]


def test_nothing_is_generated_before_it_is_asked_for():
    code = (
        "import sys, mbstab; s = mbstab.load('top.yaml').system(); print('mbstab.compiler.fused' in sys.modules);"
        "print([k for k in vars(s.fused()) if k.startswith('_') and not k.startswith(('_trace', '_inputs', '_mach'))])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n")[:2] == ["False", "[]"]


# --- traced numbers -------------------------------------------------------------------------------------------------


def test_what_is_known_is_computed_at_once():
    trace = Trace()
    x, y, f = trace.input("q0"), trace.input("q1"), trace.arithmetic()
    assert 0.0 * x == x - x == 0.0 / x == 0.0
    assert (x * y) / (y * x) == 1.0
    assert f.sin(x) * f.sin(x) + f.cos(x) * f.cos(x) == 1.0
    assert 0.25 * f.sin(x) ** 2 + 0.25 * f.cos(x) ** 2 == 0.25
    assert f.power(2.0, 0.5) == 2.0**0.5
    with pytest.raises(ZeroDivisionError):
        x / 0.0


def test_what_is_the_same_is_computed_once():
    trace = Trace()
    x, y, f = trace.input("q0"), trace.input("q1"), trace.arithmetic()

    def step(z):
        assert isinstance(z, Traced)
        return z.step, z.negative

    assert step(x * y + x) == step(x * (y + 1.0))
    assert step(y - x) == step(-(x - y))
    assert step(f.sin(-x)) == step(-f.sin(x))
    assert step(f.cos(y - x)) == step(f.cos(x - y))
    assert step(f.abs(-x)) == step(f.abs(x))
    assert step(f.sqrt(x)) != step(f.exp(x))


def test_the_text_keeps_order_and_signs():
    trace = Trace()
    x, y = trace.input("q0"), trace.input("q1")
    outputs = [-(x - y) / (x + y), x - (y + 2.0), x * (y * 3.0), -x - y, (x / y) / (y / x) - 1.0, 2.0, -(x * x)]
    names = {"pack": lambda *values: values}
    exec(trace.text({"q": [x, y]}, outputs), names)
    a, b = 0.7, 1.9
    expected = (-(a - b) / (a + b), a - (b + 2.0), a * (b * 3.0), -a - b, (a / b) / (b / a) - 1.0, 2.0, -(a * a))
    assert names["evaluate"]([a, b]) == pytest.approx(expected, rel=1e-15)


# --- accelerations --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MODELS)
def test_accelerations_are_those_of_the_reference(name):
    model = mbstab.load(MODELS[name])
    motion, system = model.motion(), model.system()
    forces = np.max(np.abs(motion.dynamics.F0)) + 1e-300
    # What forces would do to single coordinates, if nothing balanced them.
    masses = np.diag(motion.dynamics.M)
    pulled = np.max(np.abs(motion.dynamics.F0[masses > 0.0]) / masses[masses > 0.0], initial=0.0)
    size = max(1.0, float(np.max(np.abs(motion.a))), float(pulled))
    everything, least = Accelerations(system, motion.redundant), Accelerations(system)
    for accelerations in (everything, least):
        a, nu = accelerations(motion.q, motion.u, motion.time)
        assert np.max(np.abs(a - motion.a)) < 1e-11 * size
        assert np.max(np.abs(motion.dynamics.J.T @ (nu - motion.nu)), initial=0.0) < 1e-11 * forces
    assert len(everything.rows) == system.n_c - len(motion.redundant)


@pytest.mark.parametrize("name", sorted(set(MODELS) - {"bricard"}))  # its redundant row is none off the constraints
def test_accelerations_satisfy_the_equations_anywhere(name):
    system = mbstab.load(MODELS[name]).system()
    accelerations = Accelerations(system)
    for t, q, u, _, _ in states(system):
        a, nu = accelerations(q, u, t)
        state = system.dynamics(q, u, t)
        size = np.linalg.norm(state.F0) + np.linalg.norm(state.J.T) * np.linalg.norm(nu)
        assert np.linalg.norm(state.M @ a + state.J.T @ nu + state.F0) < 1e-11 * size
        assert np.linalg.norm(state.J @ a + state.B) <= 1e-11 * (
            np.linalg.norm(state.B) + np.linalg.norm(state.J) * np.linalg.norm(a)
        )


def test_a_motion_without_mass_has_no_accelerations():
    system = mbstab.loads("""
mbstab: 1
title: A body without inertia
bodies: {b: {type: planar, mass: 1, inertia: 0}}
reference: {coordinates: {b: {x: 0, y: 0, theta: 0}}}
""").system()
    with pytest.raises(MassError, match="carries no mass"):
        Accelerations(system)(np.zeros(3), np.zeros(3))


def test_constraints_that_contradict_each_other_have_no_accelerations():
    system = mbstab.loads("""
mbstab: 1
title: A coordinate driven twice
bodies: {b: {type: planar, mass: 1, inertia: 1}}
drives:
  one: {type: coordinate, coordinate: b.x, position: t**2}
  two: {type: coordinate, coordinate: b.x, position: 2*t**2}
reference: {coordinates: {b: {x: 0, y: 0, theta: 0}}}
""").system()
    with pytest.raises(ConstraintError, match="contradict"):
        Accelerations(system)(np.zeros(3), np.zeros(3))


# --- machine code ---------------------------------------------------------------------------------------------------


@pytest.fixture
def cache(tmp_path, monkeypatch):
    pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fused._machine_code.cache_clear()
    yield tmp_path / "mbstab"
    fused._machine_code.cache_clear()


def test_machine_code_needs_numba(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(UsageError, match=r"mbstab\[fast\]"):
        mbstab.load("kapitza.yaml").system().fused(machine_code=True).equations(np.ones(3), np.ones(3))


@pytest.mark.parametrize("name", ["pendulum", "top", "rolling_disk", "trailer"])
def test_machine_code_gives_what_the_system_gives(name, cache):
    system = mbstab.load(MODELS[name]).system()
    compare(system, system.fused(machine_code=True))


def test_machine_code_of_laws_and_expressions_gives_what_the_system_gives(driven, cache):
    quick = driven.fused(machine_code=True)
    compare(driven, quick)
    with pytest.raises(NumericalError, match=r"forces\.f has no finite equations here"):
        quick.dynamics(np.full(6, -0.3), np.zeros(6))
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    same(parts(quick.dynamics(q, u, 1.0)), parts(driven.dynamics(q, u, 1.0)))


def test_machine_code_is_kept_for_other_parameters(cache):
    model = mbstab.load("top.yaml")
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    for omega in (3.0, 4.0):
        system = model.system(omega=omega)
        same(parts(Fused(system, machine_code=True).dynamics(q, u, 0.2)), parts(system.dynamics(q, u, 0.2)))
    assert len(list(cache.glob("*.py"))) == 1
    assert len(list(cache.glob("__pycache__/*.nbc"))) == 1
    before = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")}
    fused._machine_code.cache_clear()  # as another process would
    compare(system, system.fused(machine_code=True))
    assert {path: path.stat().st_mtime_ns for path in before} == before
