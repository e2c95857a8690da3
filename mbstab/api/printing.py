"""Answers as the text that the commands print."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

from mbstab.model.schema import Model
from mbstab.records import Answer

T = TypeVar("T")


def printed(answer: T, model: Model) -> T:
    """Return an answer about a model, or several, which then print as that of the command does."""
    for one in answer if isinstance(answer, list) else [answer]:
        if isinstance(one, Answer):
            one.__dict__.setdefault("_text", partial(text_of, model))
    return answer


_WITH_TITLE = {
    "EigenResult": "eigenvalues.eigen_text",
    "PreciseResult": "eigenvalues.precise_text",
    "Certificate": "certificate.certificate_text",
    "CheckReport": "model_check.check_text",
    "Comparison": "comparison.compare_text",
    "Energies": "energies.energies_text",
    "Integrations": "integrations.integrations_text",
    "Response": "responses.response_text",
    "Simulation": "simulation.simulation_text",
}
"""Functions of `mbstab.report` that take an answer and a title, by the type of the answer."""


def text_of(model: Model, answer: Any) -> str:
    """Return the text of an answer about a model."""
    kind = type(answer).__name__
    if kind in _WITH_TITLE:
        module, _, name = _WITH_TITLE[kind].partition(".")
        text = getattr(import_module(f"mbstab.report.{module}"), name)(answer, model.title)
    else:
        text = _OTHERS[kind](model, answer)
    return str(text).rstrip("\n")


def _labels(model: Model, *names: str) -> list[tuple[str, float]]:
    """Return unit and factor of parameters."""
    return [(model.parameters[name].unit, model.parameters[name].factor) for name in names]


def _sweep(model: Model, answer: Any) -> str:
    from mbstab.report.sweeps import sweep_text

    return sweep_text(answer, *_labels(model, answer.parameter)[0], model.title)


def _chart(model: Model, answer: Any) -> str:
    from mbstab.report.sweeps import chart_text

    return chart_text(answer, _labels(model, *answer.parameters), model.title)


def _unbalance(model: Model, answer: Any) -> str:
    from mbstab.report.responses import unbalance_text

    unit, factor = _labels(model, answer.parameter)[0]
    return unbalance_text(answer, model.title, unit or "rad/s", factor)


def _equilibrium(model: Model, answer: Any) -> str:
    from mbstab.report.equilibria import equilibrium_text

    return equilibrium_text([answer], model)


def _verification(model: Model, answer: Any) -> str:
    from mbstab.report.eigenvalues import eigen_text
    from mbstab.report.verification import verification_text

    return f"{eigen_text(answer.result, model.title)}\n{verification_text(answer)}"


def _sensitivities(model: Model, answer: Any) -> str:
    from mbstab.report.eigenvalues import eigen_text
    from mbstab.report.sensitivity import sensitivity_text

    return f"{eigen_text(answer.result, model.title)}\n{sensitivity_text(answer, model)}"


def _linearization(model: Model, answer: Any) -> str:
    from mbstab.report.linearization import linearize_text

    return linearize_text(answer, None, "equations", model.title)


def _state_space(model: Model, answer: Any) -> str:
    from mbstab.report.linearization import linearize_text

    return linearize_text(answer.linear, answer, "state-space", model.title)


def _design(model: Model, answer: Any) -> str:
    from mbstab.analysis.design.design import settings
    from mbstab.model.arithmetic import FLOAT
    from mbstab.model.parameters import evaluate_parameters
    from mbstab.report.designs import design_text

    values = evaluate_parameters(model, {}, FLOAT)
    given = settings(model, {name: values[name] for name in model.settings} | answer.values)
    return design_text(answer, model, given, [])


_OTHERS: dict[str, Callable[[Model, Any], str]] = {
    "Sweep": _sweep,
    "Chart": _chart,
    "UnbalanceResponse": _unbalance,
    "Equilibrium": _equilibrium,
    "Verification": _verification,
    "Sensitivities": _sensitivities,
    "Linearization": _linearization,
    "ControlModel": _state_space,
    "Design": _design,
}
