"""Crossings of frequencies with orders of a speed: where an excitation k times in each turn meets a mode.

The parameter is an angular velocity Ω. Where Im λ - kΩ changes its sign (`mbstab.analysis.sweep.approaches`), the
eigenvalue is followed and the zero located.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.roots import Search
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.continuation import follow as follow_path
from mbstab.analysis.spectrum.eigenvalues import told_mode
from mbstab.analysis.spectrum.named_motions import Whirl
from mbstab.analysis.sweep.approaches import Approach, approaches
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import home_of, patterns_at
from mbstab.analysis.sweep.sweep import OrderCrossing, Sweep
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, UsageError
from mbstab.model.schema import Model
from mbstab.model.units import is_angular_velocity

TURNING = "the frequencies are those seen from a turning frame ({}), and so are their orders"


def with_orders(model: Model, result: Sweep, orders: Sequence[float]) -> Sweep:
    """Return a sweep over an angular velocity with the crossings of its branches and some orders of it.

    Raises
    ------
    UsageError
        If the parameter is no angular velocity, or an order is not a positive number.
    """
    if not orders:
        return result
    unit = model.parameters[result.parameter].unit
    if not is_angular_velocity(unit):
        what = f"has the unit {unit}" if unit not in ("", "1") else "has no unit"
        raise UsageError(
            f"orders are multiples of an angular velocity, and {result.parameter} {what}\n"
            "hint: sweep a parameter in rad/s, deg/s or rpm"
        )
    if wrong := [k for k in orders if not 0.0 < k < np.inf]:
        raise UsageError(f"order {wrong[0]:g}: orders are positive numbers, such as 1, 2 or 0.5")
    search = _Search(model, result)
    found, notes, factor = [], list[str](), model.parameters[result.parameter].factor
    for order in dict.fromkeys(float(k) for k in orders):
        told = list[OrderCrossing]()
        passed = sorted(search.passed(order), key=lambda a: not a.told)
        for approach, value in zip(passed, search.values(order, passed), strict=True):
            try:
                crossing = search.crossing(order, approach, value)
            except MbstabError as error:
                place = f"between {approach.x[0] / factor:.6g} and {approach.x[1] / factor:.6g}"
                first = str(error).splitlines()[0]
                notes.append(
                    f"a crossing of branch {approach.branch + 1} with order {order:g} {place} is not located: {first}"
                )
                continue
            # Between points a branch may be taken for another one.
            same = TOLERANCES.crossing * abs(crossing.value)
            if approach.told:
                told.append(crossing)
            elif any(abs(crossing.value - c.value) <= same for c in told):
                continue
            found.append(crossing)
    found.sort(key=lambda c: (c.value, c.order, c.frequency))
    notes += search.notes
    return replace(
        result, orders=tuple(orders), crossings=tuple(found), warnings=(*result.warnings, *dict.fromkeys(notes)),
        senses=search.senses(found),
    )  # fmt: skip


class _Search:
    """Eigenvalues between the points of a sweep."""

    def __init__(self, model: Model, result: Sweep) -> None:
        self.result, self.notes = result, list[str]()
        self._looked: dict[float, tuple[Complex, list[str]]] = {}
        ends = sorted((float(result.values[0]), float(result.values[-1])))
        path = None
        if model.reference.find is not None:
            path = follow_path(model, result.parameter, ends[0], ends[1])
        home = home_of({result.parameter: np.sort(result.values)})
        self.evaluator = Evaluator(model, path, patterns_at(model, path, home))

    def passed(self, order: float) -> list[Approach]:
        """Return where branches cross a line."""
        rank, parameter = np.argsort(self.result.values), self.result.parameter
        x, branches = self.result.values[rank], self.result.branches[rank]
        line = order * np.abs(x)[:, None]
        on_line = np.all(np.abs(branches.imag - line) <= TOLERANCES.crossing * line, axis=0)
        for j in np.flatnonzero(on_line).tolist():
            self.notes.append(
                f"the frequency of branch {j + 1} is {order:g} times {parameter} at all points: it lies on the line of "
                "this order, and crosses it nowhere"
            )
        found = approaches(self.evaluator, parameter, x, branches, order)
        return [a for a in found if a.crosses and not on_line[a.branch]]

    def values(self, order: float, passed: Sequence[Approach]) -> list[float]:
        """Return where branches cross a line in intervals, all looked for together; nan where one has no eigenvalue."""
        # Eigenvalues are rounded by so much: the crossing is not known better.
        rounding = EPS * float(np.nanmax(np.abs(self.result.branches), initial=0.0)) / order
        searches = [
            Search(a.x, a.values.imag - order * np.abs(a.x), 0, 1, max(rounding, EPS * float(np.max(np.abs(a.x)))))
            for a in passed
        ]
        parameter, count = self.result.parameter, self.result.branches.shape[1]
        while open_ := [(a, search) for a, search in zip(passed, searches, strict=True) if not search.done]:
            places = [search.points(1) for _, search in open_]
            spectra = iter(self.evaluator.eigenvalues({parameter: np.concatenate(places)}, count))
            for (a, search), x in zip(open_, places, strict=True):
                near = np.array([_nearest(next(spectra), _between(a, float(at))) for at in x])
                search.learn(x, near.imag - order * np.abs(x))
        return [np.nan if search.failed else search.best for search in searches]

    def crossing(self, order: float, passed: Approach, value: float) -> OrderCrossing:
        """Return the crossing of a branch at a value in an interval.

        Raises
        ------
        MbstabError
            If there are no eigenvalues, or the branch jumps there.
        """
        if np.isnan(value):
            raise UsageError("there are no eigenvalues in between")
        values, shapes, linear = self.evaluator.modes({self.result.parameter: value})
        k = int(np.argmin(np.abs(values - _between(passed, value))))
        s = complex(values[k])
        if not abs(s.imag - order * abs(value)) <= TOLERANCES.crossing * abs(s):
            raise UsageError("its frequency jumps there")
        if linear.generator is not None and linear.generator.turns:
            self.notes.append(TURNING.format(linear.generator))
        name = self.result.names[passed.branch] if self.result.names else ""
        shape, motions = told_mode(linear, s, shapes[:, k])
        whirl = Whirl(linear.system, linear.motion, linear.generator).of(s, shape)
        return OrderCrossing(order, value, s.imag, passed.branch, name, whirl, motions)

    def senses(self, crossings: Sequence[OrderCrossing]) -> tuple[tuple[tuple[float, float, str], ...], ...]:
        """Return the sense in which bodies whirl on each branch, from where to where.

        Some points and the crossings tell it; where two that follow each other differ, the change is located between
        them.
        """
        x, branches = self._curves
        answered = np.flatnonzero(np.isfinite(branches).all(axis=1))
        known = x[answered]
        wanted = np.linspace(known[0], known[-1], TOLERANCES.points_of_whirl) if len(known) else known
        told: list[list[tuple[float, str]]] = [[] for _ in branches.T]
        for i in np.unique(np.searchsorted(known, wanted)).tolist():
            at = float(known[i])
            for own, word in zip(told, self._whirls(at, branches[answered[i]]), strict=True):
                own += [(at, word)] if word is not None else []
        for c in crossings:
            i = int(np.argmin(np.abs(x - c.value)))
            for s in (branches[i, c.branch], np.conj(branches[i, c.branch])):
                told[int(np.argmin(np.abs(branches[i] - s)))].append((c.value, c.whirl))
        ends = (float(x[0]), float(x[-1])) if len(x) else (0.0, 0.0)
        return tuple(self._ranges(j, sorted(own), ends) for j, own in enumerate(told))

    @cached_property
    def _curves(self) -> tuple[Array, Complex]:
        """The parameter, ascending, and the branches, with the points between those that are asked for."""
        fine, rank = self.result.detail, np.argsort(self.result.values)
        return (self.result.values[rank], self.result.branches[rank]) if fine is None else (fine.values, fine.branches)

    def _ranges(
        self, branch: int, told: list[tuple[float, str]], ends: tuple[float, float]
    ) -> tuple[tuple[float, float, str], ...]:
        """Return the ranges of one sense of a branch from the senses at some values."""
        found, begin = [], ends[0]
        for (low, word), (high, other) in pairwise(told):
            while word != other:
                change, low, new = self._change(branch, (low, high), (word, other))
                found.append((begin, change, word))
                begin, word = change, new
        return (*found, (begin, ends[1], told[-1][1] if told else ""))

    def _change(self, branch: int, ends: tuple[float, float], words: tuple[str, str]) -> tuple[float, float, str]:
        """Return where a branch first has another sense of whirl than at the lower of two values, and what it has then.

        Returns
        -------
        change, beyond : float
            Near the end of the first sense, and where another one was seen.
        sense : str
        """
        (low, high), (word, other), (x, branches) = ends, words, self._curves
        values = branches[:, branch]
        for _ in range(TOLERANCES.halvings_of_whirl):
            middle = 0.5 * (low + high)
            here = np.array([np.interp(middle, x, values.real) + 1j * np.interp(middle, x, values.imag)])
            (found,) = self._whirls(middle, here)
            if found == word:
                low = middle
            else:
                high, other = middle, found or other
        return 0.5 * (low + high), high, other

    def _whirls(self, value: float, branches: Complex) -> list[str | None]:
        """Return the sense of whirl of branches at a value of the parameter; None where nothing oscillates."""
        if value not in self._looked:
            try:
                values, shapes, linear = self.evaluator.modes({self.result.parameter: value})
                whirl = Whirl(linear.system, linear.motion, linear.generator)
                words = [whirl.of(complex(s), shapes[:, k]) if s.imag > 0.0 else "" for k, s in enumerate(values)]
                self._looked[value] = values, words
            except MbstabError:
                self._looked[value] = np.zeros(0, dtype=complex), []
        values, words = self._looked[value]
        if not len(values):
            return [None] * len(branches)
        # The two of a pair are one motion.
        near = [int(np.argmin(np.abs(values - complex(s.real, abs(s.imag))))) for s in branches]
        return [words[k] if s.imag else None for k, s in zip(near, branches, strict=True)]


def _between(passed: Approach, x: float) -> complex:
    """Return the eigenvalue of a branch between the ends of an interval, on a straight line."""
    (a, b), (first, last) = passed.x.tolist(), passed.values.tolist()
    return complex(first + (x - a) / (b - a) * (last - first))


def _nearest(values: Complex, place: complex) -> complex:
    return complex(values[np.argmin(np.abs(values - place))])
