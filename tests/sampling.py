"""Which cases of a test run always: a few that differ; the others carry the mark ``long``."""

import pytest

FEW = 3
"""The number of cases of a test in the default lane."""


def sample(cases, every):
    """Return the cases for `pytest.mark.parametrize`: one of `every` so many, beginning with the first, runs always."""
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=() if i % every == 0 else pytest.mark.long)
        for i, case in enumerate(cases)
    ]


def differing(calls, most):
    """Return at most so many of the cases of a test, in their order.

    The first, then always one with as many values of parameters that are in none of those before as possible, and
    among these one that is far from them in the list: lists are written so that neighbours are alike.
    """
    if len(calls) <= most:
        return list(calls)
    chosen, seen = [0], set(calls[0].indices.items())
    while len(chosen) < most:
        best = max(
            (k for k in range(len(calls)) if k not in chosen),
            key=lambda k: (len(calls[k].indices.items() - seen), min(abs(k - i) for i in chosen)),
        )
        chosen.append(best)
        seen |= calls[best].indices.items()
    return [calls[k] for k in sorted(chosen)]
