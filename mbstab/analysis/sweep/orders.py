"""Crossings of frequencies with orders of a speed: where an excitation k times in each turn meets a mode.

The parameter is an angular velocity Ω. Where Im λ - kΩ changes its sign (`mbstab.analysis.sweep.approaches`), the
eigenvalue is followed and the zero located.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
        whirls=search.whirls(found),
    )  # fmt: skip


class _Search:
    """Eigenvalues between the points of a sweep."""

    def __init__(self, model: Model, result: Sweep) -> None:
        self.result, self.notes = result, list[str]()
        ends = sorted((float(result.values[0]), float(result.values[-1])))
        path = None
        if model.reference.find is not None:
            path = follow_path(model, result.parameter, ends[0], ends[1], float(result.values[0]))
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

    def whirls(self, crossings: Sequence[OrderCrossing]) -> tuple[str, ...]:
        """Return the sense in which bodies whirl on each branch, as some points and the crossings tell it.

        It is ``changing`` on branches that have both, ``mixed`` where all motions are nearly plane, and empty where no
        body whirls.
        """
        branches = self.result.branches
        senses: list[set[str]] = [set() for _ in branches.T]
        answered = np.flatnonzero(np.isfinite(branches).all(axis=1))
        for i in answered[np.unique(np.linspace(0, len(answered) - 1, TOLERANCES.points_of_whirl).astype(int))]:
            try:
                values, shapes, linear = self.evaluator.modes({self.result.parameter: float(self.result.values[i])})
            except MbstabError:
                continue
            whirl = Whirl(linear.system, linear.motion, linear.generator)
            told: dict[int, str] = {}
            for sense, s in zip(senses, branches[i], strict=True):
                # The two of a pair are one motion.
                k = int(np.argmin(np.abs(values - complex(s.real, abs(s.imag)))))
                if s.imag and k not in told:
                    told[k] = whirl.of(complex(values[k]), shapes[:, k])
                sense |= {told[k]} if s.imag else set()
        for c in crossings:
            i = int(np.argmin(np.abs(self.result.values - c.value)))
            for s in (branches[i, c.branch], np.conj(branches[i, c.branch])):
                senses[int(np.argmin(np.abs(branches[i] - s)))].add(c.whirl)
        sure = [sense & {"forward", "backward"} or sense - {""} for sense in senses]
        return tuple("changing" if len(sense) > 1 else "".join(sense) for sense in sure)


def _between(passed: Approach, x: float) -> complex:
    """Return the eigenvalue of a branch between the ends of an interval, on a straight line."""
    (a, b), (first, last) = passed.x.tolist(), passed.values.tolist()
    return complex(first + (x - a) / (b - a) * (last - first))


def _nearest(values: Complex, place: complex) -> complex:
    return complex(values[np.argmin(np.abs(values - place))])
