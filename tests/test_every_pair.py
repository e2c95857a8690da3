"""Models with their parameters, drawn by a seed: sweeps that end in an answer or a message, and agree with `eig`."""

import random

import pytest
from every_pair import contradiction, everything, of_parameter
from sampling import sample

SEED, PAIRS = 3, 12


def drawn():
    """Return some models with one of their parameters each, and those whose inertia a steady motion knows."""
    pairs = [(path, name) for path, names in everything().items() for name in names]
    steady = [(path, name) for path, name in pairs if (path.stem, name) in (("bead_on_hoop", "R"), ("governor", "m_c"))]
    return [*steady, *random.Random(SEED).sample(pairs, PAIRS)]


@pytest.mark.parametrize(("path", "name"), sample(drawn(), 8), ids=lambda x: getattr(x, "stem", x))
def test_a_parameter_of_a_model(path, name):
    answers = list(of_parameter(path, name))
    assert [answer.fault for answer in answers if answer.traceback or answer.code not in (0, 1, 2, 3)] == []
    assert contradiction(answers[:2], answers[2]) == ""
