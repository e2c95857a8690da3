"""Equilibria and steady motions over a parameter: followed along their path, through folds.

A path is a curve in the space of coordinates, rates and the parameter. From one solution the
next one is predicted along the tangent and corrected by Newton's method perpendicular to it
(pseudo-arclength continuation; Keller 1977), so the path may pass folds. Between two folds
the parameter is monotonic: such a part is a `Path`, and the others to which it
leads are those `beyond` it, with the paths that cross the first one. Where another path
crosses, the equations, bordered by the tangent, are singular, and eigenvalues change their sign.
Where some do without a crossing in between, the step has led to another path, and is repeated
with half its length.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise, takewhile

import numpy as np

from mbstab.analysis.reference.curve_equations import CurveEquations, Solved
from mbstab.analysis.reference.curve_points import Point, Run, joined, pole_ahead, rounded, without_value
from mbstab.analysis.reference.paths import Path, PathEnd
from mbstab.analysis.reference.smooth import SmoothSolutions
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, NumericalError, in_one_line
from mbstab.model.arithmetic import FLOAT
from mbstab.model.parameters import evaluate_parameters
from mbstab.model.schema import Model
from mbstab.model.values import evaluate


def follow(
    model: Model,
    parameter: str,
    low: float,
    high: float,
    first_at: float | None = None,
    near: tuple[Array, Array] | None = None,
    further: bool = True,
    wanted: float = math.inf,
) -> Path:
    """Return the solutions over a range of a parameter, followed from one value in both directions.

    The first solution is sought at `first_at`, or else at the value of the range that is nearest to the file's own one;
    where there is none, at the ends or in the middle. It is the one `near` given coordinates and rates, or else the
    one that the file's own guess leads to. Paths behind folds are followed only if `further` is set. `wanted` is the
    number of values at which solutions are asked for.

    Raises
    ------
    MbstabError
        If there is no solution to start from.
    """
    starts = beginnings(model, parameter, low, high)
    if first_at is not None:
        starts = list(dict.fromkeys([first_at, *([] if near else starts)]))
    failure: MbstabError | None = None
    for start in starts:
        try:
            curve = _Curve(model, parameter, (low, high), start, near)
            break
        except MbstabError as error:
            failure = failure or error
    else:
        assert failure is not None
        raise failure
    moved = "" if failure is None else in_one_line(failure)
    if smooth := curve.smooth(start, wanted):
        return replace(smooth, moved=moved)
    curve = curve.regular(start)
    up, down = (curve.traced(sign, further) for sign in (1.0, -1.0))
    main = joined(down[0], up[0])
    beyond = [curve.path(run, run.ends[0][0]) for run in (*up[1:], *down[1:])]
    known = len(curve.folds), len(curve.crossed)
    for at in (*curve.branchings, *curve.crossed):
        # A path that has been followed from one crossing may lead to another one.
        if not curve.has_reached(at, *known):
            beyond += curve.switched(at)
    return replace(curve.path(main, start), moved=moved, beyond=tuple(beyond))


def beginnings(model: Model, parameter: str, low: float, high: float) -> list[float]:
    """Return where in a range solutions are sought: first as near as possible to the file's own value."""
    own = float(evaluate_parameters(model, {}, FLOAT)[parameter])
    others = sorted((low, high, 0.5 * (low + high)), key=lambda value: abs(value - own))
    return list(dict.fromkeys([min(max(own, low), high), *others]))


def follow_row(
    model: Model,
    parameter: str,
    ends: tuple[float, float],
    start: float,
    near: tuple[Array, Array],
    beside: Sequence[Point] = (),
) -> tuple[Path, list[Point]]:
    """Return the solutions over a range of a parameter up to their folds, and where steps led if they are not smooth.

    `beside` are such points of a row beside, ascending, which may lead along this one.

    Raises
    ------
    MbstabError
        If there is no solution near the one to start from.
    """
    curve = _Curve(model, parameter, ends, start, near)
    if not beside and (smooth := curve.smooth(start, math.inf)):
        return smooth, []
    curve = curve.regular(start)
    up, down = (curve.traced(sign, False, _onwards(beside, sign, start))[0] for sign in (1.0, -1.0))
    return curve.path(joined(down, up), start), [*_reversed(down.lead), *up.lead[1:]]


def _reversed(points: Sequence[Point]) -> list[Point]:
    """Return points of a path as one meets them on the way back."""
    return [replace(point, tangent=-point.tangent) for point in reversed(points)]


def _onwards(points: Sequence[Point], sign: float, start: float) -> Sequence[Point]:
    """Return those of ascending points that lie upwards or downwards of a start, and the last one before it."""
    along = points if sign > 0.0 else _reversed(points)
    before = sum(1 for _ in takewhile(lambda point: sign * (start - point.p) >= 0.0, along))
    return along[max(before - 1, 0) :]


class _Curve(CurveEquations):
    """The curve of solutions through one of them."""

    def smooth(self, start: float, wanted: float) -> Path | None:
        """Return the path over the whole range if it is smooth, for so many values on it."""
        if self.low == self.high:
            return None
        ranges, at = {self.parameter: (self.low, self.high)}, {self.parameter: start}
        surface = SmoothSolutions(self.model, self.balance, ranges, at, self.first.q, self.first.c).surface(wanted)
        if surface is None:
            return None
        values = np.array([self.low, self.high])
        q, c = surface.predicted({self.parameter: values})
        return Path(self.model.parameters[self.parameter], values, q, c, (), (), start, surface=surface)

    def regular(self, start: float) -> _Curve:
        """Return the curve, from a solution beside the first one if the equations are singular there."""
        for step in (TOLERANCES.path_first_step * self.width, -TOLERANCES.path_first_step * self.width):
            if self.low <= start + step <= self.high:
                with contextlib.suppress(MbstabError):
                    near, ends = (self.first.q, self.first.c), (self.low, self.high)
                    beside = _Curve(self.model, self.parameter, ends, start + step, near)
                    beside.usual /= TOLERANCES.path_first_step  # it grows with the distance from there
                    return beside if beside.rank > self.rank else self
        return self

    def path(self, run: Run, start: float) -> Path:
        """Return a run as a path."""
        values, index = np.unique([point.p for point in run.points], return_index=True)
        q, c = (np.array([getattr(run.points[i], name) for i in index]) for name in ("q", "c"))
        crossings = tuple(sorted(run.crossings))
        growing = {end: self._largest(q[np.argmin(np.abs(values - end))]) for end, x in run.ends if x is PathEnd.AWAY}
        return Path(
            self.model.parameters[self.parameter], values, q, c, tuple(run.ends), crossings, start,
            growing=growing, refused=run.refused,
        )  # fmt: skip

    def _largest(self, q: Array) -> tuple[str, ...]:
        """Return the coordinates that are largest, relative to their sizes."""
        size = np.abs(q) / self.balance.sizes
        return tuple(self.problem.system.names[i] for i in np.flatnonzero(size > TOLERANCES.pole_share * np.max(size)))

    # --- along the path ---------------------------------------------------------------------------------------------

    def traced(self, sign: float, further: bool = True, beside: Sequence[Point] = ()) -> list[Run]:
        """Return the path from the first solution on, divided at its folds, or only up to the first fold.

        The parameter increases at first where `sign` is positive. `beside` are points of a path that is near.
        """
        at = replace(self.first, tangent=self.first.tangent * (sign if self.first.rise >= 0.0 else -sign))
        runs = [Run([at])]
        length = self._led(runs[0], beside) if len(beside) > 1 else TOLERANCES.path_first_step
        while True:
            fold = self._run(runs[-1], length)
            length = TOLERANCES.path_first_step
            runs[-1].lead = [*runs[-1].points, *([] if fold is None else [fold])]
            if self._closes(runs):
                return runs[:-1]
            if fold is None:
                return runs
            if len(runs) > TOLERANCES.folds_of_path:
                runs[-1].ends.append((fold.p, PathEnd.AGAIN))
                return runs
            branches = self._branches(fold)
            runs[-1].ends.append((fold.p, PathEnd.BRANCHES if branches else PathEnd.TURNS))
            self._close_in(runs, fold, further)
            # On a closed curve this part has been followed from the other side.
            if not further or any(self._same(fold, other) for other in self.folds):
                return runs[:-1]
            self.folds.append(fold)
            if branches:
                self.branchings.append(replace(fold, right=runs[-2].lead[-2].right))

    def _branches(self, fold: Point) -> bool:
        """Return whether another path branches off at a fold."""
        return fold.least < TOLERANCES.branching_singular_value * self.usual

    @property
    def spent(self) -> bool:
        """Return whether the allowed work is used up."""
        return self.work[0] <= 0

    def _led(self, run: Run, beside: Sequence[Point]) -> float:
        """Add the points near those of another path, as far as steps from one to the next fit; return the next step.

        There are twice as many as on the other path; steps leave some out where they can.
        """
        starts, ahead, hold = [], [], []
        for one, other in pairwise(beside):
            gap = self._open(self._between(one, other))
            length = float(np.linalg.norm(gap))
            starts += [one, one]
            ahead += [0.0 * gap, 0.5 * gap + 0.125 * length * (one.tangent - other.tangent)]
            hold += [one.tangent, gap / max(length, 1e-300)]
        at = run.points[0]
        every = self._all_corrected(starts[1:], ahead[1:], hold[1:])
        found = [x for x in every if x is not None and (x[2] - at.p) * at.rise > 0.0]
        k: int | None = 0
        while k is not None:
            # Longer steps come first: points would become more and more from row to row.
            steps = range(min(k + TOLERANCES.points_left_out, len(found) - 1), k - 1, -1)
            k = next((step + 1 for step in steps if self._joined(run, found[step])), None)
        rest = self._open(self._between(run.points[-1], beside[-1]))
        return max(float(np.linalg.norm(rest)) * TOLERANCES.step_beyond_lead, TOLERANCES.path_least_step)

    def _joined(self, run: Run, solved: Solved) -> bool:
        """Add a solution to a run if a step leads to it."""
        at, (q, c, p, G) = run.points[-1], solved
        point = self._point(q, c, p, G, at.tangent, at)
        gap = self._open(self._between(at, point))
        ahead = float(gap @ at.tangent)
        if (
            ahead <= 0.0
            or np.max(np.abs(gap - ahead * at.tangent)) > TOLERANCES.path_prediction_error
            or point.tangent @ at.tangent <= TOLERANCES.path_turn_cosine
            or point.rise * at.rise <= 0.0
            or not self.low < p < self.high
            or not self._leads(run, at, point)
        ):
            return False
        run.points.append(point)
        return True

    def _run(self, run: Run, length: float = TOLERANCES.path_first_step) -> Point | None:
        """Add points until the parameter turns back or leaves the range; return the fold if it turns."""
        jumped = False
        while True:
            at = run.points[-1]
            end = self.high if at.rise > 0.0 else self.low
            if at.p == end:
                return None
            if len(run.points) >= TOLERANCES.points_between_folds or self.spent:
                run.ends.append((at.p, PathEnd.LONG))
                return None
            step = length * at.tangent
            hold, room = at.tangent, (end - at.p) / self.width
            if abs(step[-1]) >= abs(room):
                step = at.tangent * (room / at.rise)
                hold = np.eye(len(step))[-1]
            if found := self._fitting(at, step, hold):
                point, error = found
                if point.rise * at.rise <= 0.0:
                    if abs(at.rise) <= TOLERANCES.path_turning_slope:
                        run.ends.append((at.p, PathEnd.HIDDEN))
                        return None
                    fold = self._fold(at, float(np.linalg.norm(step)))
                    if fold is not None:
                        if self._branches(fold) or self._leads(run, at, fold):
                            return fold
                        jumped = True
                elif self.low <= point.p <= self.high:
                    point = point if hold is at.tangent else replace(point, p=end)
                    if self._leads(run, at, point):
                        run.points.append(point)
                        jumped, pole = False, self._pole(run.points, end)
                        if pole is not None:
                            run.ends.append((pole, PathEnd.AWAY))
                            return None
                        length *= 1.6 if error < 0.3 * TOLERANCES.path_prediction_error else 1.0
                        continue
                    jumped = True
            length = 0.5 * min(length, float(np.linalg.norm(step)))
            if length < TOLERANCES.path_least_step:
                beyond = self._stuck(run, end, jumped)
                if beyond is None:
                    return None
                run.points.append(beyond)
                length, jumped = TOLERANCES.path_first_step, False

    def _fitting(self, at: Point, step: Array, hold: Array) -> tuple[Point, float] | None:
        """Return the solution near a step and the error of its prediction, if both fit the path so far."""
        found = self._corrected(at, step, hold)
        if (
            found is None
            or found[1] > TOLERANCES.path_prediction_error
            or found[0].tangent @ at.tangent <= TOLERANCES.path_turn_cosine
        ):
            return None
        return found

    def _stuck(self, run: Run, end: float, jumped: bool) -> Point | None:
        """Return the next point where no step leads on, or None and note why the path ends."""
        at = run.points[-1]
        if abs(end - at.p) < TOLERANCES.kink_step * self.width:
            # Another path crosses at the end of the range: the crossing is judged elsewhere.
            return replace(at, p=end)
        beyond = None if jumped else self._beyond_a_kink(at, end)
        if beyond is not None:
            return beyond
        if refused := "" if self.spent or jumped else self._refused(at):
            factor = self.model.parameters[self.parameter].factor
            place = rounded(at.p, TOLERANCES.path_least_step * self.width, factor)
            run.refused[place] = refused
            run.ends.append((place, PathEnd.EQUATIONS))
        else:
            run.ends.append((at.p, PathEnd.LONG if self.spent else PathEnd.UNSURE if jumped else PathEnd.NONE))
        return None

    def _refused(self, at: Point) -> str:
        """Return why the equations have no value beyond a solution, straight ahead; nothing if they have one."""

        def residual(step: float) -> Array:
            q, c, p = self._stepped(at.q, at.c, at.p, step * at.tangent)
            balance = self.balance.over(System(evaluate(self.model, {self.parameter: p})))
            return balance.state(balance.completed(q), c).residual

        return without_value(residual, TOLERANCES.beyond_the_end)

    def _pole(self, points: list[Point], end: float) -> float | None:
        """Return the value before an end of the range at which positions become infinite, as far as it is known."""
        last = points[-TOLERANCES.pole_points :]
        sizes = [float(np.max(np.abs(x.q / self.balance.sizes), initial=0.0)) for x in last]
        found = pole_ahead(sizes, np.array([x.p for x in last]), end, self.width)
        return None if found is None else rounded(*found, self.model.parameters[self.parameter].factor)

    def _beyond_a_kink(self, at: Point, end: float) -> Point | None:
        """Return the solution a little beyond a kink, where a path continues in another direction."""
        step = (
            TOLERANCES.kink_step
            if abs(end - at.p) > TOLERANCES.kink_step * self.width
            else abs(end - at.p) / self.width
        )
        axis = np.eye(len(at.tangent))[-1]
        found = self._corrected(at, np.copysign(step, at.rise) * axis, axis)
        if found is None or found[1] > 100.0 * TOLERANCES.kink_step or found[0].rise == 0.0:
            return None
        turned = np.copysign(1.0, at.rise * found[0].rise)
        return replace(found[0], tangent=turned * found[0].tangent)

    def _leads(self, run: Run, before: Point, after: Point) -> bool:
        """Return whether the path leads from one point to another: nothing changes sign, or another path crosses."""
        return not before.turns_to(after) or self._cross(run, before, after)

    def _cross(self, run: Run, before: Point, after: Point) -> bool:
        """Note where another path crosses between two points, and add points that close in on it.

        Return False if a sign changes without a crossing: the points lie on different paths.
        """
        low, high = before, after
        gap = float(np.linalg.norm(self._open(self._between(before, after))))
        clear = 10.0 * TOLERANCES.crossing_distance * min(self.usual, max(before.least, after.least) / max(gap, 1e-300))
        for _ in range(TOLERANCES.points_between_folds):
            if self.spent:
                return False
            length = float(np.linalg.norm(self._open(self._between(low, high))))
            part = low.least / max(low.least + high.least, 1e-300)
            if length < TOLERANCES.crossing_distance:
                break
            found = self._inside(low, high, min(max(part, 0.1), 0.9)) or self._inside(low, high, 0.5)
            if found is None:
                return False
            turns = low.turns_to(found), found.turns_to(high)
            if not any(turns):
                return True  # a long step, but along the path
            # Where constraints lose rank, the equations have a pole: their sizes tell the distances from it.
            reach = length / (found.size / low.size + found.size / high.size)
            if reach < TOLERANCES.pole_distance and found.size > TOLERANCES.growth_at_pole * max(
                before.size, after.size
            ):
                return self._past_pole(run, before, found, after)
            if all(turns) and found.least > clear:
                if not self._cross(run, low, found):
                    return False
                run.points.append(found)
                return self._cross(run, found, high)
            low, high = (low, found) if turns[0] else (found, high)
        # Where the equations are nearly dependent all along the path, the sign is only rounding.
        if low.least > clear:
            return True
        q, c = (x + part * (y - x) for x, y in ((low.q, high.q), (low.c, high.c)))
        at = replace(low, q=q, c=c, p=low.p + part * (high.p - low.p), tangent=0.5 * (low.tangent + high.tangent))
        if min(at.p - self.low, self.high - at.p) <= TOLERANCES.crossing_distance**2 * self.width:
            return True  # whether it lies within the range is rounding
        if any(abs(at.p - known) <= TOLERANCES.crossing_distance * self.width for known in run.crossings):
            return True  # a point of the path lies on it: both steps beside it cross
        run.crossings.append(at.p)
        self.crossed.append(at)
        for pair in ((before, at), (at, after)):
            halves: list[Point] = []
            for _ in range(TOLERANCES.fold_halvings):
                half = self._inside(*pair, 0.5)
                if half is None:
                    break
                halves.append(half)
                pair = (half, at) if pair[1] is at else (at, half)
            run.points += halves if pair[1] is at else halves[::-1]
        return True

    def _past_pole(self, run: Run, before: Point, pole: Point, after: Point) -> bool:
        """Add points that close in on a pole of the equations; return whether the path leads there and on behind it."""
        gap = self._open(self._between(before, after))
        length = float(np.linalg.norm(gap))
        place = float(self._open(self._between(before, pole)) @ gap) / length**2
        halvings = 0.5 ** np.arange(1, 2 - math.floor(math.log2(TOLERANCES.pole_distance)))
        sides = [
            [
                self._inside(before, after, place + x * part)
                for part in halvings
                if abs(x) * part * length > TOLERANCES.pole_distance
            ]
            for x in (-place, 1.0 - place)
        ]
        near, far = ([point for point in side if point is not None] for side in sides)
        for first, points in ((before, near), (None, far[::-1])):
            for point in points:
                if first is not None and not self._leads(run, first, point):
                    return False
                run.points.append(point)
                first = point
        return self._leads(run, far[0], after) if far else True

    def _inside(self, one: Point, other: Point, part: float) -> Point | None:
        """Return a solution between two, predicted by a cubic through both; its tangent must fit their path."""
        gap = self._open(self._between(one, other))
        length = float(np.linalg.norm(gap))
        if length == 0.0:
            return None
        ahead = part * part * (3.0 - 2.0 * part) * gap
        ahead += length * part * (1.0 - part) * ((1.0 - part) * one.tangent - part * other.tangent)
        found = self._corrected(one, ahead, gap / length)
        if found is None or found[0].tangent @ gap < TOLERANCES.path_turn_cosine * length:
            return None
        return found[0]

    def switched(self, at: Point) -> list[Path]:
        """Return the parts of the other path through a place where one branches off or crosses.

        The right null space of the point is that of a point beside it.
        """
        if self.spent:
            return []
        _, G = self._equations(at.q, at.c, at.p)
        null = np.linalg.svd(self._along_rows(G))[2][self.rank - 1 :].T
        aside = np.linalg.svd(null - at.right @ (at.right.T @ null))[0][:, 0]
        aside -= at.tangent * (at.tangent @ aside)
        aside /= np.linalg.norm(aside)
        halves, further = list[Run](), list[Run]()
        known = len(self.folds), len(self.crossed)
        for sign in (1.0, -1.0):
            start = replace(at, tangent=sign * aside)
            found = self._corrected(start, TOLERANCES.branch_step * start.tangent, aside)
            if found is None or not self.low <= found[0].p <= self.high:
                continue
            other = copy(self)
            other.first, other.branchings = found[0], []
            run, *behind = other.traced(1.0 if other.first.rise >= 0.0 else -1.0)
            halves.append(replace(run, points=[start, *run.points]))
            further += behind
            if self.has_reached(at, *known):
                break  # a closed curve
        sides = [half.points[1].p - at.p for half in halves]
        if len(halves) == 2 and sides[0] * sides[1] < 0.0:  # one path that crosses
            halves = [joined(halves[sides[0] > 0.0], halves[sides[0] < 0.0])]
            halves[0].crossings.append(at.p)
        else:
            halves = [replace(half, ends=[(at.p, PathEnd.BRANCHES), *half.ends]) for half in halves]
        return [*(self.path(half, at.p) for half in halves), *(self.path(run, run.ends[0][0]) for run in further)]

    def has_reached(self, at: Point, folds: int, crossed: int) -> bool:
        """Return whether paths turn or cross at a place, besides those at so many folds and crossings found first."""
        found = (*self.folds[folds:], *self.crossed[crossed:])
        return any(np.max(np.abs(self._between(at, x))) < TOLERANCES.crossing_distance for x in found)

    def _fold(self, at: Point, length: float) -> Point | None:
        """Return the fold that is less than a length ahead."""
        from scipy.optimize import brentq

        found: dict[float, Point] = {0.0: at}

        def rise(distance: float) -> float:
            if distance not in found:
                before, after = (
                    max(d for d in found if d < distance),
                    min((d for d in found if d > distance), default=0.0),
                )
                if after:
                    point = self._inside(found[before], found[after], (distance - before) / (after - before))
                else:
                    point = (self._corrected(at, distance * at.tangent, at.tangent) or (None,))[0]
                if point is None:
                    return float("nan")
                found[distance] = point
            rise = found[distance].rise
            return rise if abs(rise) > TOLERANCES.path_turning_slope else 0.0

        try:
            return found[brentq(rise, 0.0, length, xtol=np.finfo(float).tiny, disp=False)]
        except (NumericalError, ValueError):  # no value in between
            return None

    def _close_in(self, runs: list[Run], fold: Point, further: bool) -> None:
        """Add points next to a fold on both of its sides, or only before it, and begin the run beyond it."""
        before = runs[-1]
        at = before.points[-1]
        distance = float(np.linalg.norm(self._between(fold, at)))
        sides: list[list[Point]] = [[], []]
        for near, side in zip(sides, (-1.0, 1.0) if further else (-1.0,), strict=False):
            count = TOLERANCES.fold_halvings
            ahead = [side * distance * 0.5**k * fold.tangent for k in range(1, count + 1)]
            found = self._all_corrected([fold] * count, ahead, [fold.tangent] * count)
            near += [self._point(*x, fold.tangent, fold) for x in found if x is not None]
        if not self._branches(fold):
            # A point whose sign differs lies beyond a crossing, or on another path.
            sides[1] = list(takewhile(lambda x: x.sign == fold.sign, sides[1][::-1]))[::-1]
        rising = at.rise > 0.0
        before.points += [x for x in sides[0] if (x.rise > 0.0) == rising]
        before.points.append(fold)
        runs.append(Run([fold, *(x for x in sides[1][::-1] if (x.rise > 0.0) != rising)], [before.ends[-1]]))

    def _same(self, one: Point, other: Point) -> bool:
        return abs(one.p - other.p) < TOLERANCES.equal_solutions * self.width and self.problem.alike(one.q, other.q)

    def _closes(self, runs: list[Run]) -> bool:
        """Return whether the last of several runs passes the first solution, so that the curve is closed."""
        if len(runs) < 2 or (runs[-1].points[-1].rise > 0.0) != (runs[0].points[0].rise > 0.0):
            return False
        points = runs[-1].points
        for one, other in pairwise(points):
            weight = (self.first.p - one.p) / (other.p - one.p) if other.p != one.p else 0.0
            if 0.0 <= weight <= 1.0:
                ahead = weight * self._open(self._between(one, other))
                found = self._corrected(one, ahead, np.eye(len(ahead))[-1])
                return found is not None and self._same(found[0], self.first)
        return False
