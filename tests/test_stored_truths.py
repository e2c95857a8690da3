"""Stored truths are what comes out when they are computed again, and shipped models still give what is stored."""

import json

import gallery
import pytest
import truth
from mpmath import mp
from sampling import sample

import mbstab
from mbstab.model.library import installed_models

QUESTIONS = sorted(truth.stored())


@pytest.mark.parametrize("number", sample(range(len(QUESTIONS)), 100))
def test_a_truth_that_is_computed_again_is_the_one_that_is_stored(number):
    answer, again = truth.stored()[QUESTIONS[number]], truth.computed(json.loads(QUESTIONS[number]))
    assert again["neutral"] == answer["neutral"]
    with mp.workdps(truth.WORKING_DIGITS):
        left, values = ([truth.number(parts) for parts in x["eigenvalues"]] for x in (answer, again))
        assert len(left) == len(values)
        for value in values:
            nearest = min(left, key=lambda other, value=value: abs(other - value))
            assert abs(nearest - value) <= mp.mpf(10) ** -truth.DIGITS * abs(value)
            left.remove(nearest)


def test_what_is_not_stored_is_not_answered():
    with pytest.raises(AssertionError, match="no truth is stored"):
        truth.exact_eigenvalues(mbstab.load("pendulum.yaml").model, L="0.123456")


# --- shipped models ---------------------------------------------------------------------------------------------------


MODELS = {path.name: path for path in installed_models()}


def test_every_model_is_stored():
    assert list(gallery.stored()) == list(MODELS)


@pytest.mark.table
@pytest.mark.parametrize("name", MODELS)
def test_a_model_prints_what_is_stored(name):
    found, expected = gallery.printed(MODELS[name]), gallery.stored()[name]
    assert {key: found[key] for key in gallery.WORDS} == {key: expected[key] for key in gallery.WORDS}
    assert gallery.farthest(found["eigenvalues"], expected["eigenvalues"]) <= gallery.ROUNDING


def test_a_difference_is_seen():
    one = [["center", 0.0, 2.0], ["center", 0.0, -2.0], ["neutral", 0.0, 0.0]]
    assert gallery.farthest(one, one[::-1]) == 0.0
    assert gallery.farthest([["center", 1e-11, 2.0], *one[1:]], one) > gallery.ROUNDING
    assert gallery.farthest([["neutral", 0.0, 2.0], *one[1:]], one) == float("inf")
    assert gallery.farthest(one[:2], one) == float("inf")
