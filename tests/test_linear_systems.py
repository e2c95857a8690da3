"""Verdicts on random linear systems with small integers are true; the truth is exact and tested itself.

`benchmarks/linear_systems.py` asks for many more of them and tells what is left open without need.
"""

import random

import numpy as np
import pytest
from linear_oracle import AS, AS_UP_TO, OPEN, S_UP_TO, M, S, U, random_system, text, truth
from sampling import sample

import mbstab
from mbstab.analysis.verdict.rule import WORDS
from mbstab.errors import MbstabError

NONE = [[0, 0], [0, 0]]
UNIT = [[1, 0], [0, 1]]
TURN = [[0, 1], [-1, 0]]


# --- the truth itself -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("K", "D", "word", "true"),
    [
        ([[1]], [[0]], S, {S, S_UP_TO, M}),
        ([[1]], [[1]], AS, {AS, AS_UP_TO, S, S_UP_TO, M}),
        ([[1]], [[-2]], U, {U}),
        ([[-1]], [[1]], U, {U}),
        ([[0]], [[1]], AS_UP_TO, {AS_UP_TO, S, S_UP_TO, M}),
        ([[0]], [[0]], S_UP_TO, {AS_UP_TO, S_UP_TO, M}),
        ([[0]], [[-1]], U, {U}),
        (UNIT, NONE, S, {S, S_UP_TO, M}),
        ([[1, -1], [0, 1]], NONE, OPEN, {U}),  # x″ = −x + y, y″ = −y
        (NONE, [[0, -1], [0, 0]], U, {U}),  # x″ = y′, y″ = 0
        (NONE, TURN, S_UP_TO, {S, S_UP_TO, M}),  # circles
        ([[-1, 0], [0, -1]], [[0, -2], [2, 0]], OPEN, {U}),  # pairs that meet on a hill
        ([[-1, 0], [0, -1]], [[0, -3], [3, 0]], M, {S, S_UP_TO, M}),  # held on a hill
        ([[-1, 0], [0, -1]], [[1, -3], [3, 1]], U, {U}),
        ([[2, -1], [-1, 2]], [[1, -1], [-1, 1]], S, {S, S_UP_TO, M}),  # two carts, damper between
        ([[1, -1], [-1, 1]], [[1, -1], [-1, 1]], AS_UP_TO, {AS_UP_TO, S_UP_TO, M}),  # free carts, damper between
        ([[1, -1], [-1, 1]], NONE, S_UP_TO, {S_UP_TO, M}),
        ([[1, 1], [-1, 1]], NONE, U, {U}),  # circulatory
        ([[1, 2], [0, 3]], NONE, M, {S, S_UP_TO, M}),
    ],
)
def test_small_systems_are_known_by_hand(K, D, word, true):
    found = truth(K, D)
    assert found.expected == word
    assert found.allowed == true | {OPEN}


@pytest.mark.parametrize("systems", sample([400, 2000], 2))
def test_exact_truth_agrees_with_eigenvalues_where_those_are_clear(systems):
    rng, clear = random.Random(5), 0
    for _ in range(systems):
        n = rng.randint(1, 4)
        K, D = random_system(rng, n)
        found = truth(K, D)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.array(K), -np.array(D)]])
        values = np.linalg.eigvals(A)
        # A cluster of eight is spread by the eighth root of rounding.
        if np.min(np.abs(values.real)) > 0.05:
            clear += 1
            assert found.expected == (AS if np.max(values.real) < 0.0 else U)
        if np.max(values.real) > 0.05:
            assert found.expected == U
    assert clear > 0.15 * systems


# --- the verdicts ---------------------------------------------------------------------------------------------------


def drawn(seed, count):
    rng = random.Random(seed)
    for _ in range(count):
        yield random_system(rng, rng.randint(1, 4))


def checked(known, word, place, names, system):
    assert word in WORDS
    assert word in known.allowed, (word, known, system)
    if word == AS_UP_TO:
        assert place in (None, known.in_place), (word, known, system)
    if not known.neutral:
        assert not names, (names, known, system)


@pytest.mark.parametrize("systems", sample([150, 300], 2))
def test_no_verdict_on_a_linear_system_is_wrong(systems):
    words = []
    for system in drawn(1, systems):
        known = truth(*system)
        result = mbstab.loads(text(*system)).eig()
        names = result.modulo.symmetries + result.modulo.family
        checked(known, result.verdict, result.in_place, names, system)
        words.append((known.expected, result.verdict))
    for word in (AS, U, S):
        cases = [verdict for expected, verdict in words if expected == word]
        assert cases.count(word) >= 0.9 * len(cases) > 10


@pytest.mark.parametrize(
    ("K", "D"),
    [
        # Shifts and speeds along them that no single coordinate shows.
        ([[0, 0], [1, 2]], [[0, 0], [1, 2]]),
        (
            [[1, 0, 0, -1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0]],
            [[1, 0, 0, -1], [0, 1, 0, 1], [0, 0, 1, 1], [0] * 4],
        ),
        # Conserved functions that are no momenta of symmetries.
        ([[1, 0], [0, 0]], [[1, -1], [2, 0]]),
        ([[1, 1, 1], [0, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 0], [0, 0, 1]]),
        ([[0, 3, 0], [3, 4, 0], [0, 0, 0]], [[0, -3, 1], [3, 0, -2], [-1, 2, 0]]),
        # Some speeds stay, others that conserve the same function grow.
        (NONE, [[1, 1], [-1, -1]]),
    ],
)
def test_what_takes_combinations_to_see_is_seen(K, D):
    known, result = truth(K, D), mbstab.loads(text(K, D)).eig()
    assert result.verdict == known.expected
    checked(known, result.verdict, result.in_place, result.modulo.symmetries + result.modulo.family, (K, D))


@pytest.mark.parametrize("systems", sample([12, 40], 2))
@pytest.mark.parametrize("command", ["precise", "certify", "index3", "sweep"])
def test_no_command_is_wrong_about_a_linear_system(command, systems):
    answered = 0
    for system in drawn(2, systems):
        known, model = truth(*system), mbstab.loads(text(*system, parameter=True))
        try:
            word = ask(model, command)
        except MbstabError:
            continue
        answered += 1
        checked(known, OPEN if word == "not provable" else word, None, (), system)
    assert answered >= 0.75 * systems


def ask(model, command):
    if command == "sweep":
        return model.sweep("c", np.array([0.9, 1.0, 1.1])).verdicts[1]
    if command == "index3":
        return model.eig(method="index3").verdict
    return (model.eig_precise(40) if command == "precise" else model.certify(40)).verdict
