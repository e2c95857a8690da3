"""The ``expect:`` block of a model file: required answers, and whether they hold."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.failures import guarded
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.spectrum.eigenvalues import answer
from mbstab.analysis.spectrum.exactly import Exactly
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.compiler.system import System
from mbstab.errors import Location, MbstabError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.expressions import ExpressionError
from mbstab.model.parameters import bound, evaluate_parameters, settings_in_si
from mbstab.model.schema import Expectation, Model, after_number
from mbstab.model.values import evaluate
from mbstab.records import dataclass


@dataclass(frozen=True)
class Outcome:
    """Whether one expectation holds.

    Attributes
    ----------
    what : str
        What was expected, in words.
    passed : bool
    detail : str
        What was found.
    """

    location: Location
    what: str
    passed: bool
    detail: str


def check_expectations(model: Model) -> list[Outcome]:
    """Return the outcome of every expectation of a model."""
    return [outcome for expectation in model.expect for outcome in check_expectation(model, expectation)]


def check_expectation(model: Model, expectation: Expectation) -> list[Outcome]:
    """Return the outcomes of one entry of ``expect:``; an answer that fails is an outcome too."""
    at = ", ".join(f"{name}={x.text}" for name, x in expectation.at.items())
    where = f" at {at}" if at else ""
    try:
        model = bound(model, {name: x.text for name, x in expectation.at.items()})
        outcomes = []
        if expectation.eigenvalues is not None or expectation.neutral is not None or expectation.verdict:
            outcomes += _eigen_outcomes(model, expectation, where)
        if expectation.coordinates or expectation.redundant is not None:
            outcomes += _motion_outcomes(model, expectation, where)
        if expectation.critical is not None:
            outcomes.append(_critical_outcome(model, expectation, where))
        return outcomes
    except (MbstabError, ExpressionError) as error:
        return [Outcome(expectation.location, f"an answer{where}", False, str(error))]


@guarded
def _answer(model: Model, frozen: bool = False) -> EigenResult:
    return answer(System(evaluate(model)), frozen=frozen, digits=Exactly(lambda: model))


@guarded
def _motion(model: Model) -> tuple[Motion, list[str]]:
    system = System(evaluate(model))
    return reference_motion(system, massless=True), system.names


def _motion_outcomes(model: Model, expectation: Expectation, where: str) -> list[Outcome]:
    motion, names = _motion(model)
    outcomes = []
    parameters = evaluate_parameters(model, {}, FLOAT)
    for name, quantity in expectation.coordinates.items():
        value, found = quantity.evaluate(parameters, FLOAT), float(motion.q[names.index(name)])
        what = f"{name} = {value:.12g} to {expectation.tolerance:g}{where}"
        passed = abs(found - value) <= expectation.tolerance * max(1.0, abs(value))
        outcomes.append(Outcome(expectation.location, what, passed, f"found {found:.15g}"))
    if expectation.redundant is not None:
        found_rows = len(motion.redundant)
        what = f"{expectation.redundant} redundant rows{where}"
        outcomes.append(Outcome(expectation.location, what, found_rows == expectation.redundant, f"found {found_rows}"))
    return outcomes


def _eigen_outcomes(model: Model, expectation: Expectation, where: str) -> list[Outcome]:
    result = _answer(model, expectation.frozen)
    outcomes = []
    if expectation.eigenvalues is not None:
        outcomes.append(_compare(result, expected_eigenvalues(model, expectation), expectation, where))
    if expectation.neutral is not None:
        found = result.counts.neutral
        what = f"{expectation.neutral} neutral eigenvalues{where}"
        outcomes.append(Outcome(expectation.location, what, found == expectation.neutral, f"found {found}"))
    if expectation.verdict:
        detail = f"found {result.verdict}" + (f": {result.reasons[0]}" if result.reasons else "")
        passed = result.verdict == expectation.verdict
        outcomes.append(Outcome(expectation.location, f"{expectation.verdict}{where}", passed, detail))
    return outcomes


def expected_eigenvalues(model: Model, expectation: Expectation) -> list[complex]:
    """Return the eigenvalues that an entry demands, conjugates included (1/s).

    Parameters
    ----------
    model : Model
        With the parameter values of the entry.
    expectation : Expectation
    """
    parameters = evaluate_parameters(model, {}, FLOAT)
    expected: list[complex] = []
    for item in expectation.eigenvalues or ():
        value = complex(item.real.evaluate(parameters, FLOAT), item.imag.evaluate(parameters, FLOAT))
        expected += [value, value.conjugate()] if value.imag else [value]
    return expected


def _compare(result: EigenResult, expected: list[complex], expectation: Expectation, where: str) -> Outcome:
    judged = sorted((e for e in result.eigenvalues if not e.exact), key=lambda e: abs(e.value))
    what = f"{len(expected)} eigenvalues to {expectation.tolerance:g}{where}"
    if len(judged) != len(expected):
        listed = ", ".join(f"{s:.6g}" for s in result.values())
        return Outcome(expectation.location, what, False, f"found {len(judged)} that are not neutral: {listed}")
    others = [s for s in expected if s]
    # Zeros have no relative difference: their error bounds must contain zero.
    for e in judged[: len(expected) - len(others)]:
        if not abs(e.value) <= e.error_bound:
            return Outcome(expectation.location, what, False, f"{e.value:.6g} is not zero within {e.error_bound:.1e}")
    if not others:
        return Outcome(expectation.location, what, True, "zeros, as expected" if expected else "none, as expected")
    found = [e.value for e in judged[len(expected) - len(others) :]]
    difference = matched(found, others) / np.abs(others)
    worst = int(np.argmax(difference))
    detail = f"largest relative difference {difference[worst]:.1e}, at {others[worst]:.15g}"
    return Outcome(expectation.location, what, bool(difference[worst] <= expectation.tolerance), detail)


def _critical_outcome(model: Model, expectation: Expectation, where: str) -> Outcome:
    critical = expectation.critical
    assert critical is not None
    parameter = model.parameters[critical.parameter]
    given = critical.value.evaluate(evaluate_parameters(model, {}, FLOAT), FLOAT)
    value = given * parameter.factor
    step = critical.tolerance * abs(value)
    sides = [settings_in_si({critical.parameter: value + side * step}) for side in (-1, 1)]
    found = [_answer(bound(model, at)).verdict for at in sides]
    what = (
        f"{critical.parameter} critical at {given:.12g}{after_number(parameter.unit)} to {critical.tolerance:g}{where}"
    )
    passed = found == [critical.below, critical.above]
    return Outcome(critical.location, what, passed, f"{found[0]} below, {found[1]} above")
