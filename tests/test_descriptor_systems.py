"""Linear systems with states, rows of constraints and motions without mass: numbers, bounds, verdicts against truth."""

import random
from contextlib import suppress

import numpy as np
import pytest
from descriptor_oracle import AS, U, finite_part, random_descriptor, truth
from sampling import sample
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.errors import ConstraintError, MassError, ModelFileError, NumericalError
from mbstab.model.words import ASYMPTOTIC_UP_TO, UNDECIDED

REFUSED = (ConstraintError, MassError, ModelFileError)
"""What may be said of rows that vanish or motions that nothing determines."""


def drawn(seed, count, massless=0.2):
    """Yield random systems that have an answer, with it and the truth."""
    rng = random.Random(seed)
    for _ in range(count):
        system = random_descriptor(rng, massless)
        A = finite_part(*system.pencil())
        try:
            mechanism = mbstab.loads(system.text())
            answer = mechanism.eig()
        except REFUSED:
            continue
        if A is not None:
            yield system.text(), mechanism, answer, truth(A)


@pytest.mark.parametrize(
    ("seed", "massless", "count"), sample([(seed, part, 40) for seed in range(12) for part in (0.2, 0.7)], 5)
)
def test_numbers_bounds_and_verdicts_are_true(seed, massless, count):
    answered = decided = 0
    for text, _, answer, known in drawn(seed, count, massless):
        assert answer.verdict in known.allowed, text
        assert not (answer.in_place and answer.verdict == ASYMPTOTIC_UP_TO and not known.in_place), text
        expected = np.array(known.eigenvalues)
        assert answer.counts.expected == len(expected), text
        assert answer.counts.neutral <= known.zeros, text
        values = np.array([e.value for e in answer.eigenvalues])
        bounds = np.array([1e-9 if e.kind == "neutral" else e.error_bound for e in answer.eigenvalues])
        bounds += 1e-15 * np.abs(values) + 1e-300
        distance = np.abs(values[:, None] - expected) / bounds[:, None] if len(values) else np.zeros((0, 0))
        rows, columns = linear_sum_assignment(np.log(distance + 1e-300))
        assert np.all(distance[rows, columns] <= 1.0), text
        # What grows or decays decides for itself; rates below are few.
        if known.eigenvalues and (known.word == AS or any(s.real > 1e-6 for s in known.eigenvalues)):
            answered += 1
            decided += answer.verdict in (AS, U)
    assert answered == decided > 5


@pytest.mark.parametrize(("seed", "count"), sample([(seed, 6) for seed in range(20, 40)], 10))
def test_no_command_says_what_is_not_so(seed, count):
    for text, mechanism, _, known in drawn(seed, count):
        proven = None
        with suppress(NumericalError):  # directions without mass that are known in double precision only
            assert mechanism.eig_precise(30).verdict in known.allowed, text
        assert not known.eigenvalues or mechanism.modes(1).verdict in known.allowed, text
        try:
            proven = mechanism.certify().verdict
        except REFUSED:
            continue
        assert (UNDECIDED if proven == "not provable" else proven) in known.allowed, text


CARRIED = """
mbstab: 1
bodies: {{p: {{type: planar_point, mass: {mass}}}, q: {{type: planar_point, mass: 0}}}}
states: {{z: {{rate: {rate}}}}}
forces: {{law: {{type: expression, on: {{{laws}}}}}}}
{rows}
"""


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        # Balances along q: q.x = 0 and q.y = -p.x/2; rows: p.x' = p.y' = z; so z' = -p.x - 3 z/2.
        (
            {
                "mass": 2,
                "rate": "-p.x - rate(q.x) + rate(q.y) - z",
                "laws": "p.x: -4*p.x + p.y - 2*q.y, p.y: p.x - 2*p.y - z, q.x: -q.x, q.y: -2*p.x - 4*q.y",
                "rows": "constraints: {a: {nonholonomic: rate(p.y) - rate(p.x)}, b: {nonholonomic: rate(p.x) - z}}",
            },
            [0.0, -0.75 + 0.6614378277661477j, -0.75 - 0.6614378277661477j],
        ),
        # Roots of s^5 + 3 s^4/4 + 9 s^3 + 21 s^2/2 + 143 s/8 + 153/4.
        (
            {
                "mass": 1,
                "rate": "-p.x + p.y - rate(p.y) - rate(q.x) - z",
                "laws": "p.x: -2*p.x - 2*p.y + 3*q.x - 3*q.y, p.y: 2*p.x - 2*p.y - 3*q.x + q.y - z, "
                "q.x: p.x + 5*p.y - 3*q.x + z, q.y: 3*p.x - p.y + 2*q.x - 2*q.y",
                "rows": "",
            },
            np.roots([1.0, 3 / 4, 9.0, 21 / 2, 143 / 8, 153 / 4]),
        ),
    ],
)
def test_a_state_that_goes_along_with_what_has_no_mass(parts, expected):
    """Directions without mass are computed there, also where nothing that may move has mass: rounding is no part."""
    found = mbstab.loads(CARRIED.format(**parts)).eig()
    assert sorted((e.value for e in found.eigenvalues), key=_order) == pytest.approx(
        sorted(expected, key=_order), abs=1e-12
    )
    assert all(e.error_bound < 1e-11 for e in found.eigenvalues)


def _order(s):
    return round(s.real, 6), s.imag
