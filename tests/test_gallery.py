"""The shipped models print the numbers, kinds, counts and verdicts that are stored."""

import gallery
import pytest

from mbstab.model.library import installed_models

MODELS = {path.name: path for path in installed_models()}


def test_every_model_is_stored():
    assert list(gallery.stored()) == list(MODELS)


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
