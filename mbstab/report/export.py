"""Results as data: JSON, CSV, NumPy and MATLAB files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO, StringIO
from typing import Any

from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import evaluate_parameters
from mbstab.model.schema import Model


def to_json(data: Any) -> str:
    """Return one JSON object; numbers with all digits, null for numbers that are not finite."""
    import json

    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(x: Any) -> Any:
    if isinstance(x, dict):
        return {str(key): _plain(value) for key, value in x.items()}
    if isinstance(x, (list, tuple)):
        return [_plain(value) for value in x]
    if hasattr(x, "tolist"):
        return _plain(x.tolist())
    if isinstance(x, complex):
        return {"real": _plain(x.real), "imag": _plain(x.imag)}
    if isinstance(x, float) and not math.isfinite(x):
        return None
    return x


def polar(vector: Any) -> dict[str, Any]:
    """Return magnitude and phase (rad) of complex numbers."""
    import numpy as np

    return {"magnitude": np.abs(vector), "phase": np.angle(vector)}


Rows = tuple[list[str], list[list[Any]]]
"""Heads and lines of a CSV file."""


def attributes(x: Any, names: str) -> dict[str, Any]:
    """Return attributes of an object by their names, which blanks separate."""
    return {name: getattr(x, name) for name in names.split()}


def unit_factors(model: Model, *names: str) -> list[tuple[str, float]]:
    """Return the unit of each parameter, and the factor to SI."""
    return [(model.parameters[name].unit, model.parameters[name].factor) for name in names]


def to_csv(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return comma-separated values with a head line; numbers with all digits."""
    import csv

    out = StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow(["" if isinstance(x, float) and math.isnan(x) else x for x in row])
    return out.getvalue()


def in_unit(values: Any, factor: float) -> Any:
    """Return SI values in a unit: to 15 digits where these differ by rounding only, so that 500 rpm stays 500."""
    import numpy as np

    exact = np.asarray(values, dtype=float) / factor
    if factor == 1.0:
        return exact
    short = np.array([float(f"{x:.15g}") for x in exact.ravel()]).reshape(exact.shape)
    return np.where(np.abs(short * factor - values) <= 2.0 * np.spacing(np.abs(values)), short, exact)


def parameters_data(model: Model) -> dict[str, Any]:
    """Return parameters as part of a JSON object: ``value`` in its ``unit``, and ``si`` for each."""
    return {
        name: {"value": float(in_unit(x, factor)), "unit": unit, "si": x}
        for name, x in evaluate_parameters(model, {}, FLOAT).items()
        for unit, factor in unit_factors(model, name)
    }


def npz_bytes(arrays: dict[str, Any]) -> bytes:
    """Return a NumPy archive."""
    import numpy as np

    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def mat_bytes(arrays: dict[str, Any]) -> bytes:
    """Return a MATLAB file (version 5); texts become cell arrays."""
    import numpy as np
    from scipy.io import savemat

    out = BytesIO()
    savemat(out, {key: x.astype(object) if x.dtype.kind == "U" else np.asarray(x) for key, x in arrays.items()})
    return out.getvalue()
