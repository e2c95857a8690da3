"""Stored truths are what comes out when they are computed again."""

import json

import pytest
import truth
from mpmath import mp
from sampling import sample

import mbstab

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
