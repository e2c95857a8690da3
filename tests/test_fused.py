"""Fused functions give what the system gives, on every model and at every state, and contain nothing of a file."""

import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import mbstab
from mbstab.compiler.fused import Fused
from mbstab.compiler.system import Dynamics
from mbstab.compiler.trace import Trace, Traced
from mbstab.errors import NumericalError
from mbstab.model.expressions import ExpressionError
from mbstab.model.functions import NATIVE
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
        same(parts(quick.dynamics(q, u, t)), parts(slow.dynamics(q, u, t)))
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
    compare(system, Fused(system))


def test_laws_of_time_expressions_and_nonholonomic_rows_give_what_the_system_gives(driven):
    assert driven.n_n == 2
    compare(driven, Fused(driven))


def test_parameters_are_those_of_the_scene():
    model = mbstab.load("top.yaml")
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    slow = model.system(omega=3.0)
    same(parts(Fused(slow).dynamics(q, u, 2.0)), parts(slow.dynamics(q, u, 2.0)))
    assert Fused(model.system(omega=4.0)).dynamics(q, u, 2.0).E[3] == 0.3 - 8.0


def test_results_are_new_arrays_that_may_be_changed(driven):
    quick = Fused(driven)
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    first = quick.dynamics(q, u).M
    first[:] = 7.0
    assert np.all(quick.dynamics(q, u).M != 7.0)


def test_where_only_the_system_has_a_value_it_is_taken(driven):
    # sqrt((t - 1)**4) stands still at t = 1, where the formula for its rate divides by zero.
    q, u = np.full(6, 0.3), np.full(6, 0.4)
    assert parts(Fused(driven).dynamics(q, u, 1.0))[0] is not None
    same(parts(Fused(driven).dynamics(q, u, 1.0)), parts(driven.dynamics(q, u, 1.0)))


def test_what_does_not_exist_is_refused_as_by_the_system(driven):
    quick, u = Fused(driven), np.zeros(6)
    with pytest.raises(NumericalError, match=r"forces\.f has no finite equations here"):
        quick.dynamics(np.full(6, -0.3), u)
    with pytest.raises(NumericalError, match="not finite"):
        quick.dynamics(np.full(6, 0.3), np.full(6, 1e200))
    with pytest.raises(ExpressionError, match="a function has no real value there"):
        quick.dynamics(np.full(6, 0.3), u, 10.0)


def test_scenes_of_a_sweep_are_refused():
    from mbstab.compiler.system import System
    from mbstab.model.values import evaluate

    scene = evaluate(mbstab.load("top.yaml").model, {"omega": np.linspace(1.0, 2.0, 3)})
    with pytest.raises(ValueError, match="floats"):
        Fused(System(scene))


# --- the text -------------------------------------------------------------------------------------------------------


def sources(quick):
    names = ("_dynamics", "_linearize", "_linearize_rows")
    return [getattr(quick, name).source for name in names]


def test_the_text_holds_numbers_and_our_own_names_only(driven):
    own = re.compile(r"def|evaluate|return|pack|[quaw]\d*|nu\d*|t|_|e")
    functions = {*NATIVE, "power"}
    for source in sources(Fused(driven)):
        words = set(re.findall(r"[A-Za-z_]\w*", source))
        assert all(own.fullmatch(word) for word in words - functions)
        assert re.sub(r"[\w.+\-*/=(),:\s]", "", source) == ""


def test_the_text_does_not_depend_on_the_hash_seed():
    code = (
        "import mbstab; from mbstab.compiler.fused import Fused; "
        "print(Fused(mbstab.load('rolling_disk.yaml').system())._linearize.source)"
    )
    texts = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(mbstab.__file__).parents[1])},
            capture_output=True,
            encoding="utf-8",
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
    assert "def evaluate" in texts.pop()


def test_a_pendulum_takes_one_sine_and_one_cosine():
    source = Fused(mbstab.load("pendulum.yaml").system()).augmented([0, 1]).source
    assert source.count("sin(") == source.count("cos(") == 1
    assert "q0" not in source  # neither the matrices nor the rest of the equations depend on the place
    assert source.count("\n") < 25


def test_nothing_is_generated_before_it_is_asked_for():
    code = (
        "import sys, mbstab; s = mbstab.load('top.yaml').system(); print('mbstab.compiler.fused' in sys.modules);"
        "from mbstab.compiler.fused import Fused;"
        "print([k for k in vars(Fused(s)) if k.startswith('_') and not k.startswith(('_trace', '_inputs', '_bases'))])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
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
