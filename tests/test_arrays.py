"""Least squares of what has no value are an error, without a word of the libraries below."""

from pathlib import Path

import numpy as np
import pytest

import mbstab
from mbstab.analysis.algebra.arrays import least_squares


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_not_finite_is_an_error_that_prints_nothing(wrong, capfd):
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        least_squares(np.array([[1.0, wrong], [0.0, 1.0]]), np.ones(2))
    assert tuple(capfd.readouterr()) == ("", "")


def test_the_shortest_of_all_solutions():
    A = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 1e-14]])
    assert least_squares(A, np.array([2.0, 2.0, 0.0]), rcond=1e-10) == pytest.approx([1.0, 1.0])


def test_least_squares_have_one_place():
    files = Path(mbstab.__file__).parent.rglob("*.py")
    assert [x.name for x in files if "lstsq" in x.read_text(encoding="utf-8")] == ["arrays.py"]
