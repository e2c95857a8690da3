"""Tells whether a motion of a constrained mechanical system is stable, and how far each number can be trusted.

``mbstab.load("top.yaml").eig(omega=5.6)`` does what ``mbstab eig top.yaml --set omega=5.6`` does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbstab.api import Mechanism, load, loads
    from mbstab.errors import (
        ConstraintError,
        ExpectationError,
        MassError,
        MbstabError,
        ModelFileError,
        NumericalError,
        SimulationError,
        UsageError,
    )

_HOME = {
    "mbstab.api": ("Mechanism", "load", "loads"),
    "mbstab.errors": (
        "ConstraintError",
        "ExpectationError",
        "MassError",
        "MbstabError",
        "ModelFileError",
        "NumericalError",
        "SimulationError",
        "UsageError",
    ),
}

__all__ = [
    "ConstraintError",
    "ExpectationError",
    "MassError",
    "MbstabError",
    "Mechanism",
    "ModelFileError",
    "NumericalError",
    "SimulationError",
    "UsageError",
    "load",
    "loads",
]


def __getattr__(name: str) -> Any:
    # Imported on first use: `mbstab --help` needs none of it.
    import importlib

    if name == "__version__":
        from importlib.metadata import version

        return version("mbstab")
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(module), name)
    raise AttributeError(f"module 'mbstab' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
