"""Elements at many points of a sweep: those of one kernel are evaluated together, as arrays.

With few points a sweep spends its time on starting operations of NumPy, not on numbers; elements of
one kernel share them. With many points they stay apart: what does not vary is faster as a plain float.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from mbstab.compiler.placed import Placed
from mbstab.compiler.scatter import arithmetic_of

MANY = 500
"""Above this number of points, elements are faster one by one."""

Arguments = list[Sequence[Any]]
"""What a function of a kernel takes: coordinates, speeds, parameters, signals and more."""


def results_at_points(
    function: str, elements: Sequence[Placed], arguments: list[Arguments], points: int
) -> list[Sequence[Any]]:
    """Return the results of each element: floats where they are the same at all points, else arrays (points,).

    Raises
    ------
    ArithmeticError, ValueError
        If the equations of an element have no value at a point.
    """
    found: list[Sequence[Any]] = [()] * len(elements)
    for numbers in _groups(elements, arguments) if points <= MANY else ([i] for i in range(len(elements))):
        run, own = getattr(elements[numbers[0]].kernel, function), [arguments[i] for i in numbers]
        for number, results in zip(numbers, _together(run, own) if len(own) > 1 else [_alone(run, *own)], strict=True):
            found[number] = results
    return found


def _groups(elements: Sequence[Placed], arguments: list[Arguments]) -> Iterator[list[int]]:
    """Yield the numbers of elements of one kernel; those are alone that do not vary or take functions of time."""
    groups: dict[Any, list[int]] = {}
    for number, (element, own) in enumerate(zip(elements, arguments, strict=True)):
        varies = [isinstance(x, np.ndarray) for some in own for x in some]
        alone = element.laws or True not in varies
        groups.setdefault(number if alone else id(element.kernel), []).append(number)
    return iter(groups.values())


def _alone(run: Callable[..., Any], arguments: Arguments) -> Any:
    return run(arithmetic_of(arguments), *arguments)


def _together(run: Callable[..., Any], several: list[Arguments]) -> Iterator[tuple[Any, ...]]:
    """Return the results of elements of one kernel, element by element."""
    arguments: Arguments = [
        [_stacked(values) for values in zip(*some, strict=True)] for some in zip(*several, strict=True)
    ]
    return zip(*(_apart(x, len(several)) for x in _alone(run, arguments)), strict=True)


def _stacked(values: tuple[Any, ...]) -> Any:
    """Return the same argument of several elements, shape (elements, points or 1), or a float that they share."""
    arrays = [x for x in values if isinstance(x, np.ndarray)]
    if len(arrays) == len(values):
        return np.array(values)
    if not arrays:
        return values[0] if values.count(values[0]) == len(values) else np.array(values)[:, None]
    result = np.empty((len(values), len(arrays[0])))
    for row, value in zip(result, values, strict=True):
        row[:] = value
    return result


def _apart(x: Any, count: int) -> Sequence[Any]:
    """Return a result of several elements for each of them."""
    if not isinstance(x, np.ndarray):
        return (x,) * count
    return x[:, 0].tolist() if x.shape[1] == 1 else list(x)
