"""What simulations of one mechanism share, what they must not share, and states that are recorded together."""

import copy
import itertools
import math

import numpy as np
import pytest
import scipy.integrate
from chains import straight_chain

import mbstab
from mbstab.analysis.simulate import start
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.estimate import estimated, reduction, shrunk
from mbstab.analysis.simulate.steppers import layout
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.machine.tables import RUN_START
from mbstab.compiler.trace import OPERATIONS, Trace

SWING = {"rod.theta": math.pi / 4}


def counted(monkeypatch, module, name):
    """Return a list that grows with each call of a function."""
    calls, function = [], getattr(module, name)
    monkeypatch.setattr(module, name, lambda *arguments: calls.append(1) or function(*arguments))
    return calls


def test_a_mechanism_that_is_simulated_again_is_not_worked_out_again(monkeypatch):
    model = mbstab.load("pendulum.yaml")
    references, starts = counted(monkeypatch, start, "_reference"), counted(monkeypatch, start, "_start_of")
    one, other = (model.simulate(0.2, perturb=SWING, points=3, tol=tol) for tol in (1e-4, 1e-6))
    assert (len(references), len(starts)) == (1, 1)
    assert np.array_equal(one.q[0], other.q[0])
    turned = model.simulate(0.2, perturb={"rod.theta": 0.1}, points=3)
    assert (len(references), len(starts)) == (1, 2)
    assert turned.q[0, 2] - 1.5 * math.pi == pytest.approx(0.1, abs=1e-14)
    longer = model.simulate(0.2, perturb=SWING, points=3, L=0.4)
    assert (len(references), len(starts)) == (2, 3)
    assert longer.q[0, 0] == pytest.approx(2.0 * one.q[0, 0], rel=1e-12)


@pytest.mark.long
def test_the_equations_for_machine_code_are_written_once(monkeypatch):
    pytest.importorskip("numba")
    model, written = mbstab.load("pendulum.yaml"), counted(monkeypatch, layout, "layout_of")
    first, _, again = (
        model.simulate(0.2, perturb={"rod.theta": angle}, points=3, compiled=True) for angle in (0.3, 1.0, 0.3)
    )
    assert len(written) == 1
    assert np.array_equal(first.q, again.q)  # nothing of the motion between them is left
    model.simulate(0.2, points=3, compiled=True, L=0.4)
    assert len(written) == 2


def test_what_is_shared_is_not_changed_from_outside():
    model = mbstab.load("pendulum.yaml")
    one = model.simulate(0.1, perturb=SWING, points=3)
    before = one.q.copy()
    for x in (one.q, one.u, one.a, one.nu, one.sizes, one.positions):
        x[...] = math.nan
    assert np.array_equal(model.simulate(0.1, perturb=SWING, points=3).q, before)


def test_numbers_that_are_equal_but_written_otherwise_are_others():
    model = mbstab.load("pendulum.yaml")
    assert model.system(L=0.2) is model.system(L=0.2)
    assert model.system(L=1) is not model.system(L=1.0)
    with pytest.raises(mbstab.errors.UsageError, match="one number"):
        model.system(L=True)
    assert model.system(L="0.2") is not model.system(L="200 mm")
    assert copy.deepcopy(model).system(L=0.2) is not model.system(L=0.2)
    with pytest.raises(mbstab.errors.UsageError, match="one number"):
        _ = [model.simulate(0.1, perturb={"rod.theta": x}, points=2, once=True) for x in (1, True)]


def test_parts_of_a_system_know_nothing_of_the_whole():
    system = mbstab.load("double_pendulum.yaml").system()
    assert system.remember("what", 1, lambda: "whole") == "whole"
    assert system.remember("what", 1, lambda: "again") == "whole"
    for _, part in system.parts():
        assert part.remember("what", 1, lambda: "part") == "part"
    assert system.in_arithmetic(system.scene).remember("what", 1, lambda: "other") == "other"
    assert system.remember("what", 2, lambda: "again") == "again"


@pytest.mark.parametrize("name", ["pendulum", "top", "kapitza", "governor", "rolling_disk", "slider_crank"])
def test_states_looked_at_together_are_those_looked_at_one_by_one(name, monkeypatch):
    model, found = mbstab.load(f"{name}.yaml"), []
    evaluate = Constrained.evaluate

    def looked(self, t, q, u):
        found.extend([q] if q.ndim > 1 else [])
        return evaluate(self, t, q, u)

    def failing(self, t, q, u):
        if q.ndim > 1:
            raise np.linalg.LinAlgError
        return evaluate(self, t, q, u)

    monkeypatch.setattr(Constrained, "evaluate", looked)
    one = model.simulate(0.05, once=True, tol=1e-4, points=12)
    assert found
    monkeypatch.setattr(Constrained, "evaluate", failing)
    other = model.simulate(0.05, once=True, tol=1e-4, points=12)
    for key in ("q", "u", "a", "nu", "loads", "efforts", "kinetic", "work"):
        a, b = getattr(one, key), getattr(other, key)
        assert np.max(np.abs(a - b), initial=0.0) <= 1e-10 * np.max(np.abs(b), initial=0.0), key
    assert np.max(np.abs(one.residuals - other.residuals)) <= 1e-15


DISTURBED = {
    "pendulum": (mbstab.load("pendulum.yaml"), SWING),
    "top": (mbstab.load("top.yaml"), {"top.theta": 0.3}),
    "chain of 20": (mbstab.loads(straight_chain(20)), {"rod_0.theta": 0.3}),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("tol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", DISTURBED)
def test_the_error_is_neither_above_the_tolerance_nor_far_below(name, tol):
    pytest.importorskip("numba")
    model, perturb = DISTURBED[name]
    exact, sim = (
        model.simulate(10.0, perturb=perturb, tol=x, points=41, compiled=True, once=x < tol) for x in (1e-13, tol)
    )
    size = np.max(sim.sizes)
    error = max(
        np.max(np.abs(sim.rotations - exact.rotations)),
        np.max(np.abs(sim.positions - exact.positions)) / size,
        np.max(np.abs(sim.spins - exact.spins))
        / max(np.max(np.abs(exact.spins)), np.max(np.abs(exact.velocities)) / size),
    )
    assert 1e-2 <= error / tol <= 1.0
    assert sim.error_estimate <= tol
    assert error <= TOLERANCES.error_factor * sim.error_estimate


@pytest.mark.parametrize("power", [1.0, 2.0 / 3.0, 1.25])
def test_errors_are_estimated_from_the_power_that_runs_show(power):
    def found(tolerances, errors):
        last, exact = tolerances[-1], errors[-1]
        return estimated(
            [(last / tol, error - exact) for tol, error in zip(tolerances, errors[:-1], strict=False)], power
        )

    tolerances = [1e-4, 1e-8, 1e-9]
    errors = [tol**power for tol in tolerances]
    estimate, likely = found(tolerances, errors)
    assert estimate == likely
    assert 1.0 < estimate / errors[-1] < 5.0
    # Errors that shrink with half the power: the motion amplifies them until they are as large as it.
    errors = [tol ** (0.5 * power) for tol in tolerances]
    estimate, likely = found(tolerances, errors)
    assert likely < 0.7 * errors[-1]
    assert 0.7 * errors[-1] < estimate < 2.0 * errors[-1]
    # Two runs may agree by chance, and a run far away says little: the difference itself is an upper limit.
    for tolerances, errors in (([1e-4, 1e-5], [1e-4, 1e-5]), ([1e-4, 1e-5, 1e-9], [1e-4, 1e-5, 1e-9])):
        estimate, likely = found(tolerances, errors)
        assert likely < 0.7 * (errors[-2] - errors[-1])
        assert errors[-2] - errors[-1] < estimate


@pytest.mark.parametrize("power", [1.0, 2.0 / 3.0, 1.25])
@pytest.mark.parametrize("part", [0.3, 0.03, 1e-3, 1e-6])
def test_a_tolerance_is_reduced_so_that_the_wanted_part_of_the_error_is_left(power, part):
    ratio = reduction(part, power)
    assert shrunk(ratio, power) == pytest.approx(part, rel=1e-12)
    assert ratio**power <= part


def test_operations_stand_in_long_runs_each_after_those_it_uses():
    trace = Trace()
    x = [trace.input(f"x{i}") for i in range(20)]
    f = trace.arithmetic()
    results = [f.sin(a) * f.cos(b) + a * b - f.exp(a) for a, b in itertools.pairwise(x)]
    code = trace.code(x, [results, [a / b for a, b in itertools.pairwise(results)]])
    ends = [end for _, end in code.runs]
    assert len(code.runs) <= 8
    assert ends[-1] == len(code.operands) > 120
    assert ends == sorted(ends)
    assert [OPERATIONS[k] for k, _ in code.runs[code.ends[0] :]] == ["/"]
    first = code.inputs + len(code.constants)
    assert all(max(pair) < first + i for i, pair in enumerate(code.operands))


def test_a_chain_is_a_few_runs_of_operations():
    begin = start.start_of(mbstab.loads(straight_chain(20)).system())
    equations = Constrained(begin.system, begin.motion)
    from mbstab.analysis.reference.attitude import Attitudes
    from mbstab.analysis.simulate.energy import Energy

    machine = layout.machine_of(equations, [], Attitudes.of(begin.system), Energy.of(begin.system))
    starts = machine.integers[machine.integers[RUN_START] : machine.integers[RUN_START + 1]]
    assert len(starts) < 16
    assert starts[-1] > 400


def test_states_that_no_body_feels_are_as_exact_as_is_asked_for():
    """The Lorenz equations beside an oscillator, against SciPy's DOP853; errors grow by 1e6 in 15 s."""
    model = mbstab.loads(
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\nconstraints: {r: {holonomic: p.y}}\n"
        "forces: {f: {type: expression, on: {p.x: -p.x}}}\n"
        "states:\n  A: {rate: 10*(B - A)}\n  B: {rate: A*(28 - C) - B}\n  C: {rate: A*B - 8/3*C}\n"
        "reference: {coordinates: {p: {x: 0}, A: 0, B: 0, C: 0}}\n"
        "initial: {coordinates: {p: {x: 0.1}, A: 1, B: 1, C: 1}}\n"
    )
    found = model.simulate(15.0, points=16, tol=1e-6)
    exact = scipy.integrate.solve_ivp(
        lambda t, y: [10.0 * (y[1] - y[0]), y[0] * (28.0 - y[2]) - y[1], y[0] * y[1] - 8.0 / 3.0 * y[2]],
        (0.0, 15.0), [1.0, 1.0, 1.0], method="DOP853", rtol=1e-13, atol=1e-13, t_eval=found.times,
    ).y.T  # fmt: skip
    off = found.q[:, [found.names.index(x) for x in "ABC"]] - exact
    worst = np.max(np.abs(off) / np.max(np.abs(exact), axis=0))
    assert worst < 1e-6
    assert 1e-12 < found.error_estimate < 1e-6
