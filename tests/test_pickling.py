"""Mechanisms, answers and errors go to other processes and come back the same."""

import pickle
from multiprocessing import get_context

import numpy as np
import pytest

import mbstab
from mbstab import errors
from mbstab.errors import (
    Location,
    MbstabError,
    ModelFileError,
    Problem,
    SeveralErrors,
    SimulationError,
    UnforeseenError,
)
from mbstab.model.library import starts_folder
from mbstab.report.answers import WRITERS

PENDULUM = mbstab.load("pendulum.yaml")
LAGGED = """\
mbstab: 1
title: A mass with a motor
parameters: {k: {value: 9, unit: N/m}, T: {value: 5, unit: ms}}
bodies: {p: {type: planar, mass: 1, inertia: 1}}
forces: {f: {type: expression, on: {p.x: -k*p.x - u}}}
states: {u: {rate: (2*rate(p.x) - u)/T}}
inputs: {push: {type: force, at: p, direction: [1, 0]}, turn: {type: torque, body: p}}
outputs: {x: p.x, v: rate(p.x)}
"""
ROTOR = starts_folder() / "rotor.yaml"
ANSWERS = {
    "EigenResult": lambda m: m.eig(energies=True),
    "PreciseResult": lambda m: m.eig_precise(20),
    "Certificate": lambda m: m.certify(L="[0.19, 0.21]"),
    "CheckReport": lambda m: m.check(),
    "Comparison": lambda m: m.compare(20),
    "Energies": lambda m: m.energies(),
    "Integrations": lambda m: m.compare_integrators(0.02),
    "Response": lambda m: mbstab.loads(LAGGED).response("push", "x", points=3),
    "Simulation": lambda m: m.simulate(0.01, points=3, perturb={"rod.theta": 0.1}),
    "Sweep": lambda m: m.sweep("L", [0.1, 0.2, 0.3], certify=True, sensitivity=True),
    "Chart": lambda m: m.chart({"L": [0.1, 0.2, 0.3], "g": [9.0, 9.5, 10.0]}),
    "UnbalanceResponse": lambda m: mbstab.load(ROTOR).unbalance("disk", "omega", [200, 300], "x"),
    "Equilibrium": lambda m: m.equilibria()[0],
    "Verification": lambda m: m.verify(),
    "Sensitivities": lambda m: m.sensitivities(),
    "Linearization": lambda m: m.linearize(),
    "ControlModel": lambda m: mbstab.loads(LAGGED).at(k=8).state_space(),
    "SymbolicBlocks": lambda m: m.symbolic(),
    "Design": lambda m: m.design({"L": "5%"}, "decay"),
}


def again(x):
    return pickle.loads(pickle.dumps(x))


@pytest.mark.parametrize("name", WRITERS)
def test_an_answer_prints_the_same_text(name):
    answer = ANSWERS[name](PENDULUM.at(m=1.1))
    assert type(answer).__name__ == name
    copy = again(answer)
    assert str(copy) == str(answer)
    assert not str(copy).startswith(name)
    assert str(again(copy)) == str(answer)


def test_a_mechanism_keeps_what_it_is_asked_at():
    model = PENDULUM.at(g="9.81 + 1")
    copy = again(model)
    assert repr(copy) == repr(model)
    assert copy.eig().values().tolist() == model.eig().values().tolist()
    M, other = (
        x.dynamics(np.array([0.1, 0.2, 0.3]), np.ones(3), 0.0).M for x in (model.system(), again(model.system()))
    )
    assert np.array_equal(M, other)


def every(kind):
    return [kind, *(x for sub in kind.__subclasses__() for x in every(sub))]


MADE = {
    ModelFileError: lambda: ModelFileError([Problem(Location("a.yaml", 1, 2), "b", "wrong", "right", "text")]),
    SimulationError: lambda: SimulationError("ended", PENDULUM.simulate(0.01, points=2)),
    UnforeseenError: lambda: UnforeseenError("a.yaml", ValueError("odd")),
    SeveralErrors: lambda: SeveralErrors([MADE[ModelFileError](), errors.NumericalError("no")]),
}


@pytest.mark.parametrize("kind", every(MbstabError), ids=lambda kind: kind.__name__)
def test_an_error_says_the_same_and_keeps_its_attributes(kind):
    error = MADE.get(kind, lambda: kind("something"))()
    copy = again(error)
    assert (type(copy), str(copy), copy.exit_code) == (kind, str(error), error.exit_code)
    assert repr(vars(copy)) == repr(vars(error))


def verdict(length):
    return PENDULUM.at(L=length).eig().verdict


def test_a_pool_gets_answers_and_errors():
    with get_context("fork").Pool(1) as pool:
        assert pool.map(verdict, [0.2]) == ["stable"]
        with pytest.raises(MbstabError, match="L"):
            pool.map_async(verdict, [0.2, 0]).get(timeout=60)
