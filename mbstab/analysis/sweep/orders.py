"""Crossings of frequencies with orders of a speed: where an excitation k times in each turn meets a mode.

The parameter is an angular velocity Ω. Where Im λ - kΩ changes its sign (`mbstab.analysis.sweep.approaches`), the
eigenvalue is followed and the zero located.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.roots import root
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.reference.continuation import follow as follow_path
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.spectrum.named_motions import Whirl
from mbstab.analysis.spectrum.results import Eigenvalue
from mbstab.analysis.sweep.approaches import Approach, approaches
from mbstab.analysis.sweep.batched_spectra import Evaluator
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
        for passed in sorted(search.passed(order), key=lambda a: not a.told):
            try:
                crossing = search.crossing(order, passed)
            except MbstabError as error:
                place = f"between {passed.x[0] / factor:.6g} and {passed.x[1] / factor:.6g}"
                first = str(error).splitlines()[0]
                notes.append(
                    f"a crossing of branch {passed.branch + 1} with order {order:g} {place} is not located: {first}"
                )
                continue
            # Between points a branch may be taken for another one.
            same = TOLERANCES.crossing * abs(crossing.value)
            if passed.told:
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
        self.evaluator = Evaluator(model, path)

    def passed(self, order: float) -> list[Approach]:
        """Return where branches cross a line."""
        rank, parameter = np.argsort(self.result.values), self.result.parameter
        x, branches = self.result.values[rank], self.result.branches[rank]
        return [a for a in approaches(self.evaluator, parameter, x, branches, order) if a.crosses]

    def crossing(self, order: float, passed: Approach) -> OrderCrossing:
        """Return the crossing of a branch in an interval.

        Raises
        ------
        MbstabError
            If there are no eigenvalues in between, or the branch jumps there.
        """
        (a, b), ends, branch = passed.x.tolist(), passed.values, passed.branch

        def near(x: float) -> tuple[complex, Linearization]:
            values, _, linear = self.evaluator.modes({self.result.parameter: x})
            return _nearest(values, complex(ends[0] + (x - a) / (b - a) * (ends[1] - ends[0]))), linear

        value = root(lambda x: near(x)[0].imag - order * abs(x), a, b)
        s, linear = near(value)
        if not abs(s.imag - order * abs(value)) <= TOLERANCES.crossing * abs(s):
            raise UsageError("its frequency jumps there")
        if linear.generator is not None and linear.generator.turns:
            self.notes.append(TURNING.format(linear.generator))
        mode = self._mode(linear, s)
        name = self.result.names[branch] if self.result.names else ""
        return OrderCrossing(order, value, s.imag, branch, name, mode.whirl, mode.motions)

    def whirls(self, crossings: Sequence[OrderCrossing]) -> tuple[str, ...]:
        """Return the sense in which bodies whirl on each branch, as some points and the crossings tell it.

        It is ``changing`` on branches where they differ, and empty where no body whirls.
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
            for sense, s in zip(senses, branches[i], strict=True):
                # The two of a pair are one motion.
                k = int(np.argmin(np.abs(values - complex(s.real, abs(s.imag)))))
                if s.imag:
                    sense.add(whirl.of(complex(values[k]), shapes[:, k]))
        for c in crossings:
            i = int(np.argmin(np.abs(self.result.values - c.value)))
            for s in (branches[i, c.branch], np.conj(branches[i, c.branch])):
                senses[int(np.argmin(np.abs(branches[i] - s)))].add(c.whirl)
        return tuple("changing" if len(found := sense - {""}) > 1 else "".join(found) for sense in senses)

    @staticmethod
    def _mode(linear: Linearization, s: complex) -> Eigenvalue:
        return min(eigenvalues(linear).eigenvalues, key=lambda e: abs(e.value - s))


def _nearest(values: Complex, place: complex) -> complex:
    return complex(values[np.argmin(np.abs(values - place))])
