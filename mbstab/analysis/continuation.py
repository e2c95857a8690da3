"""Equilibria and steady motions over a parameter: followed along their path, through folds.

A path is a curve in the space of coordinates, rates and the parameter. From one solution the
next one is predicted along the tangent and corrected by Newton's method perpendicular to it
(pseudo-arclength continuation; Keller 1977), so the parameter may turn back. Between two turns
the parameter grows or falls all the time: such a part is a `Path`, and the others to which it
leads are those `beyond` it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mbstab.analysis.equilibrium import Problem
from mbstab.analysis.motion import TOLERANCE
from mbstab.analysis.numerics import root
from mbstab.analysis.subspaces import rank_of
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, NumericalError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.schema import Model
from mbstab.model.values import evaluate, evaluate_parameters

FIRST = 1.0 / 16.0
"""First step, as a part of the range, of the size of the scene, or as an angle (rad)."""

LEAST = 1e-12
"""A solution is lost if no step of this length leads further."""

TRUSTED = 0.05
"""A prediction may be wrong by this part of the size of the scene, or by this angle (rad)."""

STRAIGHT = 0.95
"""Cosine of the angle by which the tangent may turn in a step."""

CORRECTIONS, CORRECTED = 10, 1e-8
"""Newton steps from a prediction, and the size of the last one: what it leaves is its square."""

DIFFERENCE = 1e-6
"""Derivatives by the parameter are taken over this part of the range."""

DEPENDENT = 1e-9
"""Directions of the path, of symmetries: so little changes the equations along them, relative to the largest change."""

BRANCHING = 1e-5
"""Where the path turns back another one leaves if the equations are dependent to this."""

HALVINGS = 20
"""Points of a path close in on a fold by a factor of 2 each: there coordinates vary like a root of the parameter."""

SAME = 1e-9
"""Solutions are the same if their parameters differ by less than this part of the range, and their positions do not."""

FOLDS, POINTS = 10, 5000
"""A path is followed through so many folds, and so many points between two of them."""

ENDS, TURNS, BRANCHES = "it ends there", "it turns back", "it turns back where others branch off"

Flags = npt.NDArray[np.bool_]

AGAIN = f"it turns back after {FOLDS} folds and is not followed further"

FAILURES = (MbstabError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Path:
    """Solutions over a parameter, one for each value.

    Attributes
    ----------
    values : ndarray, shape (k,)
        Of the parameter (SI), ascending.
    q : ndarray, shape (k, n_q)
    c : ndarray, shape (k, size of the family)
        Rates of the steady motion.
    ends : tuple of (float, str)
        Values at which it ends within the range, and why.
    low, high : float
        The range that was asked for.
    start : float
        The value from which it was followed: where the first solution was found, or a fold.
    beyond : tuple of Path
        Those to which it leads through folds: first from its upper end, then from its lower end.
    """

    values: Array
    q: Array
    c: Array
    ends: tuple[tuple[float, str], ...]
    low: float
    high: float
    start: float
    beyond: tuple[Path, ...] = ()

    def covers(self, values: Array) -> Flags:
        """Return which values lie on the path, shape (points,)."""
        lower, upper = float(self.values[0]), float(self.values[-1])
        ended = [value for value, _ in self.ends]
        inside: Flags = (values > lower if lower in ended else values >= lower) & (
            values < upper if upper in ended else values <= upper
        )
        return inside

    def missing(self, value: float) -> str:
        """Say why there is no solution at a value."""
        end, reason = min(self.ends, key=lambda item: abs(item[0] - value))
        return f"no solution beyond {end:.12g} on this path: {reason}"

    def predicted(self, values: Array) -> tuple[Array, Array]:
        """Return starting values at parameter values, shapes (points, n_q) and (points, size)."""
        q, c = (
            np.stack([np.interp(values, self.values, column) for column in x.T], axis=1)
            if x.shape[1]
            else np.zeros((len(values), 0))
            for x in (self.q, self.c)
        )
        return q, c

    def nearest(self, value: float) -> tuple[Array, Array]:
        """Return starting values at one parameter value."""
        q, c = self.predicted(np.array([value]))
        return q[0], c[0]


def follow(
    model: Model, parameter: str, settings: Mapping[str, float], low: float, high: float, first_at: float | None = None
) -> Path:
    """Return the solutions over a range of a parameter, followed from one value both ways.

    From `first_at`, or else the lowest value; where there is none, from the other end, the file's
    own value, or the middle.

    Raises
    ------
    MbstabError
        If there is no solution to start from.
    """
    nominal = float(evaluate_parameters(model, dict(settings), FLOAT)[parameter])
    starts = [low if first_at is None else first_at, low, high]
    starts += [nominal] if low <= nominal <= high else []
    starts.append(0.5 * (low + high))
    failure: MbstabError | None = None
    for start in starts:
        try:
            curve = _Curve(model, parameter, settings, low, high, start)
            break
        except MbstabError as error:
            failure = failure or error
    else:
        assert failure is not None
        raise failure
    up, down = (curve.traced(sign) for sign in (1.0, -1.0))
    main = _Run([*down[0].points[:0:-1], *up[0].points], [*down[0].ends, *up[0].ends])
    beyond = tuple(curve.path(run, run.ends[0][0]) for run in (*up[1:], *down[1:]))
    return replace(curve.path(main, start), beyond=beyond)


@dataclass(frozen=True)
class _Point:
    """A solution: coordinates, rates, the parameter, and the tangent of the path (scaled, of length 1)."""

    q: Array
    c: Array
    p: float
    tangent: Array

    @property
    def rise(self) -> float:
        """How the parameter changes along the path."""
        return float(self.tangent[-1])


@dataclass
class _Run:
    """Points of a path between two turns, and where and why it ends within the range."""

    points: list[_Point]
    ends: list[tuple[float, str]] = field(default_factory=list)


class _Curve:
    """The curve of solutions through one of them.

    Unknown are [q; c; p] without what is given, scaled by the size of the scene, its speed and
    the range.
    """

    def __init__(
        self, model: Model, parameter: str, settings: Mapping[str, float], low: float, high: float, start: float
    ) -> None:
        self.model, self.parameter, self.settings = model, parameter, settings
        self.low, self.high, self.width = low, high, (high - low) or 1.0
        self.problem = Problem(System(evaluate(model, {**settings, parameter: start})))
        _, search, at, _ = self.problem.solved(self.problem.start)
        self.balance = search.balance
        _, A = self._equations(at.q, at.c, start)
        # Least change with the parameter: symmetries have no part in it.
        by_p = np.append(np.linalg.lstsq(A[:, :-1], -A[:, -1], rcond=DEPENDENT)[0], 1.0)
        self.first = _Point(at.q, at.c, start, self._tangent(A, by_p))
        self.folds: list[_Point] = []

    def path(self, run: _Run, start: float) -> Path:
        """Return a run as a path."""
        values, index = np.unique([point.p for point in run.points], return_index=True)
        q, c = (np.array([getattr(run.points[i], name) for i in index]) for name in ("q", "c"))
        return Path(values, q, c, tuple(run.ends), self.low, self.high, start)

    # --- equations --------------------------------------------------------------------------------------------------

    def _equations(self, q: Array, c: Array, p: float) -> tuple[Array, Array]:
        """Return the residuals that multipliers cannot balance, and their derivative by the scaled unknowns."""
        step = DIFFERENCE * self.width
        around = np.array([p, min(p + step, self.high), max(p - step, self.low)])
        system = System(evaluate(self.model, {**self.settings, self.parameter: around}))
        balance = self.balance.over(system)
        at = balance.state(balance.completed(np.tile(q, (3, 1))), np.tile(c, (3, 1)))
        if not np.all(np.isfinite(at.residual)):
            raise NumericalError("the equations are not finite")
        G, moving = balance.jacobian(at)[0], balance.moving
        by_p = (at.residual[1] - at.residual[2]) * self.width / (around[1] - around[2])
        A = np.column_stack([G[:, :moving], by_p])
        forces = G[:, moving:]
        if not forces.size:
            return at.residual[0], A
        left = rank_of(forces.T / max(float(np.max(np.abs(forces))), 1e-300)).null.T
        return left @ at.residual[0], left @ A

    def _stepped(self, q: Array, c: Array, p: float, step: Array) -> tuple[Array, Array, float]:
        q, c = self.balance.shifted(q, c, step[:-1])
        return q, c, p + float(step[-1]) * self.width

    def _tangent(self, A: Array, along: Array) -> Array:
        """Return the direction in which the equations stay satisfied, nearest to a given one, of length 1."""
        _, s, right = np.linalg.svd(A)
        rank = int(np.sum(s > DEPENDENT * max(float(s[0]), 1e-300))) if len(s) else 0
        null = right[rank:].T
        tangent: Array = null @ (null.T @ along)
        return tangent / float(np.linalg.norm(tangent))

    def _corrected(self, start: _Point, ahead: Array, hold: Array) -> tuple[_Point, float] | None:
        """Return the solution near a step, perpendicular to `hold`, and how far the step missed it."""
        q, c, p = self._stepped(start.q, start.c, start.p, ahead)
        missed = np.zeros(len(ahead))
        try:
            with np.errstate(all="ignore"):
                for _ in range(CORRECTIONS):
                    residual, A = self._equations(q, c, p)
                    step = np.linalg.lstsq(np.vstack([A, hold]), -np.append(residual, 0.0), rcond=1e-11)[0]
                    q, c, p = self._stepped(q, c, p, step)
                    missed += step
                    if not np.max(np.abs(missed)) < 1.0:
                        return None
                    if np.max(np.abs(step)) < CORRECTED:
                        residual, A = self._equations(q, c, p)
                        if np.max(np.abs(residual)) > TOLERANCE:
                            return None
                        return _Point(q, c, p, self._tangent(A, start.tangent)), float(np.max(np.abs(missed)))
        except FAILURES:
            pass
        return None

    # --- along the path ---------------------------------------------------------------------------------------------

    def traced(self, sign: float) -> list[_Run]:
        """Return the path from the first solution on, cut where it turns; the parameter first grows or falls."""
        at = replace(self.first, tangent=self.first.tangent * (sign if self.first.rise >= 0.0 else -sign))
        runs = [_Run([at])]
        while True:
            fold = self._run(runs[-1])
            if self._closes(runs):
                return runs[:-1]
            if fold is None:
                return runs
            if len(runs) > FOLDS:
                runs[-1].ends.append((fold.p, AGAIN))
                return runs
            runs[-1].ends.append((fold.p, BRANCHES if self._branches(fold) else TURNS))
            if any(self._same(fold, other) for other in self.folds):
                return runs  # a closed curve: it has been followed from the other side
            self.folds.append(fold)
            self._close_in(runs, fold)

    def _run(self, run: _Run) -> _Point | None:
        """Add points until the parameter turns back or leaves the range; return the fold if it turns."""
        length = FIRST
        while len(run.points) < POINTS:
            at = run.points[-1]
            end = self.high if at.rise > 0.0 else self.low
            if at.p == end:
                return None
            step = length * at.tangent
            hold, room = at.tangent, (end - at.p) / self.width
            if abs(step[-1]) >= abs(room):
                step = at.tangent * (room / at.rise)
                hold = np.eye(len(step))[-1]
            found = self._corrected(at, step, hold)
            if found is not None and found[1] <= TRUSTED and found[0].tangent @ at.tangent > STRAIGHT:
                point, error = found
                if point.rise * at.rise <= 0.0:
                    fold = self._fold(at, float(np.linalg.norm(step)))
                    if fold is not None:
                        return fold
                elif self.low <= point.p <= self.high:
                    if hold is not at.tangent:
                        point = replace(point, p=end)
                    run.points.append(point)
                    if error < 0.3 * TRUSTED:
                        length *= 1.6
                    continue
            length = 0.5 * min(length, float(np.linalg.norm(step)))
            if length < LEAST:
                break
        run.ends.append((run.points[-1].p, ENDS))
        return None

    def _fold(self, at: _Point, length: float) -> _Point | None:
        """Return the point less than a length ahead at which the parameter turns back."""
        found: dict[float, _Point] = {0.0: at}

        def rise(distance: float) -> float:
            if distance not in found:
                corrected = self._corrected(at, distance * at.tangent, at.tangent)
                if corrected is None:
                    return float("nan")
                found[distance] = corrected[0]
            return found[distance].rise

        try:
            return found[root(rise, 0.0, length)]
        except NumericalError:
            return None

    def _close_in(self, runs: list[_Run], fold: _Point) -> None:
        """Add points next to a fold on both of its sides, and begin the run beyond it."""
        before = runs[-1]
        at = before.points[-1]
        distance = float(np.linalg.norm(self._between(fold, at)))
        sides = []
        for side in (-1.0, 1.0):
            near = [
                self._corrected(fold, side * distance * 0.5**k * fold.tangent, fold.tangent)
                for k in range(1, HALVINGS + 1)
            ]
            sides.append([found[0] for found in near if found is not None])
        rising = at.rise > 0.0
        before.points += [x for x in sides[0] if (x.rise > 0.0) == rising]
        before.points.append(fold)
        runs.append(_Run([fold, *(x for x in sides[1][::-1] if (x.rise > 0.0) != rising)], [before.ends[-1]]))

    def _between(self, one: _Point, other: _Point) -> Array:
        """Return the scaled difference of two solutions."""
        q = (other.q - one.q) / self.balance.sizes
        return np.concatenate([q, (other.c - one.c) / self.balance.speed, [(other.p - one.p) / self.width]])

    def _same(self, one: _Point, other: _Point) -> bool:
        return abs(one.p - other.p) < SAME * self.width and self.problem.alike(one.q, other.q)

    def _branches(self, fold: _Point) -> bool:
        """Whether another path leaves where this one turns back."""
        _, A = self._equations(fold.q, fold.c, fold.p)
        _, A_first = self._equations(self.first.q, self.first.c, self.first.p)
        s, s_first = (np.linalg.svd(x, compute_uv=False) for x in (A, A_first))
        rank = int(np.sum(s_first > DEPENDENT * max(float(s_first[0]), 1e-300)))
        return rank > 0 and bool(s[rank - 1] < BRANCHING * s[0])

    def _closes(self, runs: list[_Run]) -> bool:
        """Whether the last of several runs passes the first solution: the curve is closed."""
        if len(runs) < 2 or (runs[-1].points[-1].rise > 0.0) != (runs[0].points[0].rise > 0.0):
            return False
        points = runs[-1].points
        for one, other in pairwise(points):
            weight = (self.first.p - one.p) / (other.p - one.p) if other.p != one.p else 0.0
            if 0.0 <= weight <= 1.0:
                ahead = weight * np.delete(self._between(one, other), self._held)
                found = self._corrected(one, ahead, np.eye(len(ahead))[-1])
                return found is not None and self._same(found[0], self.first)
        return False

    @property
    def _held(self) -> npt.NDArray[np.intp]:
        """Numbers, within all scaled coordinates and rates, of those that are given."""
        n = len(self.balance.sizes)
        given = np.ones(n + self.balance.family.size, dtype=bool)
        given[self.balance.open] = False
        given[[n + k for k in self.balance.free]] = False
        return np.flatnonzero(given)
