"""Every answer as text and as data: the functions that write it, by its type and by format.

Each takes the answer and its model. What all answers have in common is added here: the title above a text, the keys
``model`` and ``title`` of a JSON object.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from mbstab.model.schema import Model
from mbstab.report.export import mat_bytes, npz_bytes, to_csv, to_json
from mbstab.report.styles import joined, styled

WRITERS: dict[str, dict[str, str]] = {
    "CheckReport": {"table": "model_check.check_text", "json": "model_check.check_data"},
    "Energies": {"table": "energies.energies_text", "json": "energies.energies_data"},
    "Equilibrium": {
        "table": "equilibria.equilibrium_text", "json": "equilibria.equilibrium_data",
        "csv": "equilibria.equilibrium_rows",
    },
    "EigenResult": {
        "table": "eigenvalues.eigen_text", "json": "eigenvalue_data.eigen_data", "csv": "eigenvalue_data.eigen_rows",
    },
    "PreciseResult": {
        "table": "eigenvalues.precise_text", "json": "eigenvalue_data.precise_data",
        "csv": "eigenvalue_data.precise_rows",
    },
    "Certificate": {"table": "certificate.certificate_text", "json": "certificate.certificate_data"},
    "Verification": {"table": "verification.verification_text", "json": "verification.verification_data"},
    "Sensitivities": {
        "table": "sensitivity.sensitivity_text", "json": "sensitivity.sensitivity_data",
        "csv": "sensitivity.sensitivity_rows",
    },
    "Linearization": {"table": "linearization.linearize_text"},
    "ControlModel": {
        "table": "linearization.linearize_text", "json": "linear_data.linearize_data",
        "csv": "linear_data.linearize_rows", "npz": "linear_data.linearize_arrays",
        "mat": "linear_data.linearize_arrays", "latex": "linear_data.linearize_latex",
    },
    "SymbolicBlocks": {"table": "symbolic.symbolic_text", "latex": "symbolic.symbolic_latex"},
    "Sweep": {
        "table": "sweeps.sweep_text", "json": "sweep_data.sweep_data", "csv": "sweep_data.sweep_rows",
        "npz": "sweep_data.sweep_arrays",
    },
    "Chart": {
        "table": "sweeps.chart_text", "json": "sweep_data.chart_data", "csv": "sweep_data.chart_rows",
        "npz": "sweep_data.chart_arrays",
    },
    "Simulation": {
        "table": "simulation.simulation_text", "json": "simulation.simulation_data",
        "csv": "simulation.simulation_rows", "npz": "simulation.simulation_arrays",
    },
    "Response": {
        "table": "responses.response_text", "json": "responses.response_data", "csv": "responses.response_rows",
    },
    "UnbalanceResponse": {
        "table": "responses.unbalance_text", "json": "responses.unbalance_data", "csv": "responses.unbalance_rows",
    },
    "Comparison": {
        "table": "comparison.compare_text", "json": "comparison.compare_data", "csv": "comparison.compare_rows",
    },
    "Integrations": {
        "table": "integrations.integrations_text", "json": "integrations.integrations_data",
        "csv": "integrations.integrations_rows",
    },
    "Design": {"table": "designs.design_text", "json": "designs.design_data", "yaml": "designs.design_file"},
}  # fmt: skip
"""Functions of this package; those for csv return heads and lines, those for npz and mat arrays by name."""

_FILES: dict[str, Callable[[Any], str | bytes]] = {
    "json": to_json,
    "csv": lambda rows: to_csv(*rows),
    "npz": npz_bytes,
    "mat": mat_bytes,
}


def content(answer: Any, model: Model, form: str, options: Mapping[str, Any] | None = None) -> Any:
    """Return an answer, or a list of answers, in a format: text, a JSON object, or heads and lines."""
    one = answer[0] if isinstance(answer, list) else answer
    module, _, name = WRITERS[type(one).__name__][form].partition(".")
    found = getattr(import_module(f"mbstab.report.{module}"), name)(answer, model, **(options or {}))
    if form == "table" and model.title:
        return joined([styled(model.title, "title"), "", found])
    return {"model": model.name, "title": model.title, **found} if form == "json" else found


def bind_writers(answer: Any, model: Model, **options: Mapping[str, Any]) -> dict[str, Callable[[], str | bytes]]:
    """Return functions that write an answer, by format; `options` go to the writers of a format."""

    def write(form: str) -> str | bytes:
        found = content(answer, model, form, options.get(form))
        return _FILES[form](found) if form in _FILES else found

    one = answer[0] if isinstance(answer, list) else answer
    return {form: lambda form=form: write(form) for form in WRITERS[type(one).__name__]}  # type: ignore[misc]
