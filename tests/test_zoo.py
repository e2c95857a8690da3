"""Nothing false is said about systems whose stability is known, by no command, and no two commands contradict."""

import functools
import re
from dataclasses import dataclass

import numpy as np
import pytest
from sampling import sample
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.verdict.rule import (
    ASYMPTOTIC,
    ASYMPTOTIC_UP_TO,
    MARGINAL,
    STABLE,
    STABLE_UP_TO,
    STRENGTH,
    UNDECIDED,
    UNSTABLE,
    WORDS,
)
from mbstab.errors import MbstabError

NAMES = {system.name: system for system in SYSTEMS}
DIGITS = 40
STAYING = frozenset({ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO})


@dataclass(frozen=True)
class Answer:
    """What a command says about a system: a verdict, and what comes with it where the command tells."""

    word: str
    modulo: tuple[frozenset[str], frozenset[str]] | None = None
    in_place: bool | None = None
    warnings: tuple[str, ...] = ()
    refusal: str = ""
    note: str = ""


# --- the interface to the commands, all of it -----------------------------------------------------------------------


def eig(model, system):
    return told(model.eig())


def index3(model, system):
    return told(model.eig(method="index3"))


def precise(model, system):
    return told(model.eig_precise(DIGITS))


def certify(model, system):
    result = model.certify(DIGITS)
    word = UNDECIDED if result.verdict == "not provable" else result.verdict
    return told(result, word)


def sweep(model, system):
    parameter, values = system.swept
    result = model.sweep(parameter, np.array(values))
    return Answer(result.verdicts[len(values) // 2])


def verify(model, system):
    found = model.verify()
    answer = told(found.result)
    return Answer(answer.word, answer.modulo, note=found.verdict)


def told(result, word=None):
    modulo = getattr(result, "modulo", None)
    return Answer(
        word or result.verdict,
        modulo and (frozenset(modulo.symmetries), frozenset(modulo.family)),
        getattr(result, "in_place", None),
        tuple(getattr(result, "warnings", ())),
    )


COMMANDS = {f.__name__: f for f in (eig, index3, precise, certify, sweep, verify)}


@functools.cache
def asked(name, command):
    """Return the answer of a command; a refusal claims nothing."""
    system = NAMES[name]
    try:
        return COMMANDS[command](mbstab.loads(system.text, f"{name}.yaml"), system)
    except MbstabError as error:
        return Answer(UNDECIDED, refusal=str(error))


# --- claims ---------------------------------------------------------------------------------------------------------


def test_every_system_has_its_own_name():
    assert len(NAMES) == len(SYSTEMS)
    assert all(system.best in system.allowed | {UNDECIDED} for system in SYSTEMS)
    assert all(system.least in STRENGTH[system.best] for system in SYSTEMS)


def claim(name, command):
    """Return what a command says, which must not be false."""
    system, answer = NAMES[name], asked(name, command)
    assert answer.word in WORDS
    assert answer.word in system.allowed, f"{command}: {answer.word}, but {system.truth}: {system.why}"
    if system.apart and answer.modulo:
        assert not [text for part in answer.modulo for text in part if re.search(system.apart, text)]
    return answer


@pytest.mark.table
@pytest.mark.parametrize("name", NAMES)
def test_eig_says_nothing_that_is_not_so(name):
    claim(name, "eig")


# Together, so that no worker asks again what another one knows.
@pytest.mark.parametrize("name", sample(NAMES, 12))
def test_no_command_says_what_is_not_so_and_no_two_contradict_each_other(name):
    system = NAMES[name]
    answers = {command: claim(name, command) for command in system.commands}
    pairs = [(a, b) for a in answers for b in answers if a < b and contradict(system, answers[a], answers[b])]
    assert not pairs, {command: (answer.word, answer.modulo) for command, answer in answers.items()}


def contradict(system, first, second):
    """Whether two answers cannot both be true; what nonlinear terms make unstable may be marginally stable as well."""
    words = {first.word, second.word}
    if UNSTABLE in words and (words & STAYING or (MARGINAL in words and MARGINAL not in system.also)):
        return True
    return first.word == second.word and None not in (first.modulo, second.modulo) and first.modulo != second.modulo


@pytest.mark.table
@pytest.mark.parametrize("name", NAMES)
def test_what_can_be_known_is_said(name):
    system, answer = NAMES[name], asked(name, "eig")
    assert system.least in STRENGTH[answer.word], f"{answer.word}, not {system.least}: {answer.refusal or system.why}"


@pytest.mark.parametrize("name", [s.name for s in SYSTEMS if s.digits])
@pytest.mark.parametrize("command", ["precise", "certify"])
def test_many_digits_tell_what_floats_cannot(name, command):
    assert NAMES[name].digits in STRENGTH[asked(name, command).word]


@pytest.mark.parametrize("name", [s.name for s in SYSTEMS if s.in_place is not None])
def test_whether_neighbours_stay_near_the_reference_itself_is_told(name):
    system, answer = NAMES[name], asked(name, "eig")
    told_anyway = system.best != ASYMPTOTIC_UP_TO and answer.in_place is None
    if answer.word == ASYMPTOTIC_UP_TO and not told_anyway:
        assert answer.in_place == system.in_place


@pytest.mark.parametrize("name", [s.name for s in SYSTEMS if s.warns])
def test_stability_that_damping_or_resonance_destroys_is_warned_of(name):
    system, answer = NAMES[name], asked(name, "eig")
    assert any(re.search(system.warns, text) for text in answer.warnings), answer.warnings


# --- simulation and comparison --------------------------------------------------------------------------------------


# What linear analysis cannot tell, and some others; it takes longer than all other commands together.
SIMULATED = [s.name for s in SYSTEMS if s.best == UNDECIDED or (s.truth == UNSTABLE and s.best != UNSTABLE)]
SIMULATED += [s.name for s in SYSTEMS[::16] if s.name not in SIMULATED]


@pytest.mark.parametrize("name", sample(SIMULATED, 3))
def test_simulation_confirms_nothing_false_and_contradicts_nothing_true(name):
    system, answer = NAMES[name], asked(name, "verify")
    assert answer.note != ("contradicted" if answer.word in system.allowed else "confirmed")


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    sample(["sleeping top, fast", "sleigh forwards", "chain of carts on a wall", "held on a hill, slightly damped"], 2),
)
def test_methods_that_are_compared_contradict_neither_the_truth_nor_each_other(name):
    found = mbstab.loads(NAMES[name].text).compare()
    answers = [Answer(found.truth.verdict), *(Answer(outcome.verdict) for outcome in found.outcomes if outcome.verdict)]
    assert all(answer.word in NAMES[name].allowed for answer in answers)
    assert not any(contradict(NAMES[name], a, b) for a in answers for b in answers)
