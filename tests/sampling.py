"""Parameters of tests that are thorough: a sample runs always, the others carry the mark ``long``."""

import pytest


def sample(cases, every):
    """Return the cases for `pytest.mark.parametrize`: one of `every` so many, beginning with the first, runs always."""
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=() if i % every == 0 else pytest.mark.long)
        for i, case in enumerate(cases)
    ]
