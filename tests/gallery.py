"""What ``mbstab eig --format json`` prints for the shipped models, stored in ``truths/gallery.json``.

A change of a printed number, kind, count or verdict is seen there, and is an entry of the changelog. ``python
tests/truths/make_gallery.py`` stores what is printed now.
"""

import json
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.report.eigenvalue_data import eigen_data
from mbstab.report.export import to_json

STORE = Path(__file__).parent / "truths" / "gallery.json"
ROUNDING = 1e-12
"""By how much eigenvalues may differ, relative to the largest of the model."""

WORDS = ("verdict", "modulo", "in_place", "evidence", "frame", "period", "counts")
"""What is printed besides eigenvalues and must be the same."""


def printed(path):
    """Return eigenvalues (kind, real and imaginary part in 1/s) and verdict of a model as printed."""
    mechanism = mbstab.load(path)
    data = json.loads(to_json(eigen_data(mechanism.eig(), mechanism.model)))
    values = [[e["kind"], e["real"], e["imag"]] for e in data["eigenvalues"]]
    return {"eigenvalues": values, **{key: data[key] for key in WORDS}}


def stored():
    """Return what is stored, by the names of the models."""
    return json.loads(STORE.read_text(encoding="utf-8"))


def farthest(found, expected):
    """Return how far eigenvalues are from those of the same kind, relative to the largest; inf: kinds differ."""
    if sorted(kind for kind, *_ in found) != sorted(kind for kind, *_ in expected):
        return np.inf
    one, other = (np.array([complex(*parts) for _, *parts in values]) for values in (found, expected))
    unlike = np.array([[a != b for b, *_ in expected] for a, *_ in found])
    largest = np.max(np.abs(other), initial=0.0)
    distances = np.abs(one[:, None] - other[None, :]) / (largest or 1.0)
    return float(np.max(distances[linear_sum_assignment(np.where(unlike, 1e9, distances))], initial=0.0))
