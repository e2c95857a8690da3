"""Arguments of questions asked in Python, checked."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mbstab.errors import UsageError, nearest

if TYPE_CHECKING:
    import numpy.typing as npt
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")
Progress = Callable[[float], object]


def untold(done: float) -> None:
    """Tell nobody how much is done."""


def whole(name: str, value: object, least: int = 0) -> int:
    """Return an argument that is a whole number."""
    if not isinstance(value, numbers.Integral) or isinstance(value, bool) or value < least:
        raise UsageError(f"{name}={value!r}: give a whole number, {least} or more")
    return int(value)


def several(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return names; a text is one."""
    return (names,) if isinstance(names, str) else tuple(names)


def series(name: object, values: object) -> npt.NDArray[np.float64]:
    """Return the values of a swept parameter as an array, shape (points,)."""
    if not isinstance(name, str):
        raise UsageError(f"{name!r} is not a parameter\nhint: give its name as a text")
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(())
    if found.ndim != 1 or not np.all(np.isfinite(found)):
        raise UsageError(f"{name}: a sweep takes a list of finite numbers\nhint: such as numpy.linspace(1, 2, 11)")
    return found


def parted(kind: type[S], keywords: Mapping[str, Any], known: Collection[str]) -> tuple[S, dict[str, Any]]:
    """Return settings of a kind, and the parameters among keywords, some of which are known.

    Raises
    ------
    UsageError
        If a keyword is nearer to a setting than to a parameter, but none; if settings are wrong.
    """
    names = [x.name for x in fields(kind)]
    parameters = {name: x for name, x in keywords.items() if name not in names}
    for name in parameters.keys() - known:
        if (near := nearest(name, [*known, *names])) in names:
            raise UsageError(f"there is no setting or parameter {name!r}\nhint: did you mean {near!r}?")
    return kind(**{name: x for name, x in keywords.items() if name in names}), parameters
