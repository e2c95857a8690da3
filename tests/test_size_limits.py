"""Scenes that are too large are refused before matrices are made; what can be asked of large ones is quick."""

import time

import numpy as np
import pytest
from chains import free_bodies, straight_chain
from click.testing import CliRunner

import mbstab
from mbstab.analysis.algebra.budget import Cost
from mbstab.analysis.algebra.failures import guarded
from mbstab.cli import main
from mbstab.errors import NumericalError, UsageError

QUESTIONS = {
    "check": lambda model: model.check(),
    "eig": lambda model: model.eig(),
    "eig_precise": lambda model: model.eig_precise(),
    "certify": lambda model: model.certify(),
    "verify": lambda model: model.verify(),
    "linearize": lambda model: model.linearize(),
    "state_space": lambda model: model.state_space(),
    "motion": lambda model: model.motion(),
    "equilibria": lambda model: model.equilibria(),
    "simulate": lambda model: model.simulate(1.0),
    "swing": lambda model: model.swing(),
    "compare": lambda model: model.compare(),
    "compare_integrators": lambda model: model.compare_integrators(),
    "sweep": lambda model: model.sweep("m", np.array([1.0, 2.0])),
    "chart": lambda model: model.chart({"m": np.array([1.0, 2.0]), "k": np.array([1.0, 2.0])}),
}


@pytest.fixture(scope="module")
def crowd():
    return mbstab.loads(free_bodies(1000))


@pytest.mark.parametrize("question", QUESTIONS.values(), ids=QUESTIONS)
def test_a_thousand_free_bodies_are_refused_at_once_with_the_estimate(crowd, question):
    started = time.process_time()
    with pytest.raises(UsageError, match=r"3000 coordinates: that takes about .* GB of memory .*\n.*--force") as info:
        question(crowd)
    assert time.process_time() - started < 5.0
    assert "\nhint: " in str(info.value)


@pytest.mark.parametrize(("question", "links", "said"), [("eig_precise", 60, "2 min"), ("certify", 125, "79 s")])
def test_many_digits_and_proofs_that_take_minutes_are_refused(question, links, said):
    chain = mbstab.loads(straight_chain(links))
    assert chain.eig().verdict == "stable"
    with pytest.raises(UsageError, match=rf"{3 * links} coordinates: .* {said} of work"):
        QUESTIONS[question](chain)


def test_force_goes_on(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.algebra.tolerances.Tolerances.estimated_time", 0.0)
    with pytest.raises(UsageError, match="--force"):
        mbstab.loads(free_bodies(2)).eig()
    assert mbstab.loads(free_bodies(2), force=True).eig().counts.neutral == 12


@pytest.mark.parametrize("command", ["check", "eig", "linearize", "equilibrium", "simulate", "sweep", "compare"])
def test_every_command_has_the_option(command, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mbstab.analysis.algebra.tolerances.Tolerances.estimated_memory", 0.0)
    more = {"sweep": ["--param", "m", "--from", "1", "--to", "2", "--points", "3", "--plot", "none"]}.get(command, [])
    more += ["--to", "0.1"] if command == "simulate" else []
    refused = CliRunner().invoke(main, [command, "pendulum.yaml", *more])
    assert refused.exit_code == 2
    assert "--force" in refused.output
    assert CliRunner().invoke(main, [command, "pendulum.yaml", "--force", *more]).exit_code == 0


def test_lack_of_memory_is_said():
    @guarded
    def enormous():
        return np.zeros((10**9, 10**9))

    with pytest.raises(NumericalError, match=r"not enough memory \(Unable to allocate"):
        enormous()


def test_estimates_are_told_in_units_that_suit_them():
    assert str(Cost(1, 3e9, 700.0)) == "about 3.0 GB of memory and 12 min of work"
