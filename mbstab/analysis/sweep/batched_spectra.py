"""Eigenvalues and verdicts at all points of a sweep at once.

One point is computed in full (`mbstab.analysis.verdict.facts`): its ranks, its symmetries and the frame of its motion
are the pattern. Every other point must have the same pattern, which is checked with the same thresholds; points that do
not are computed with a pattern of their own, finally one by one. Points that the bounds for many points do not decide
are judged by the code of `mbstab eig`.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.linear.linearize import Linearization, linearize, state_space
from mbstab.analysis.reference.equations import Balance
from mbstab.analysis.reference.equilibrium import Problem, found_motion
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.paths import Path, Sheet, Surface
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.steady import Family, spinning_columns
from mbstab.analysis.spectrum.exactly import Exactly
from mbstab.analysis.sweep.batched_equations import Equations, Pattern
from mbstab.analysis.sweep.batched_structure import Known, coefficients
from mbstab.analysis.sweep.batched_verdict import NOT_COUNTED, Judged, judged
from mbstab.analysis.sweep.data_errors import EntryErrors, Samples, data_errors, entry_errors
from mbstab.analysis.sweep.open_points import Kind, Part, kinds_of_open_points, nearly_meeting, settle, spread
from mbstab.analysis.sweep.shapes import Shapes, shapes_of
from mbstab.analysis.sweep.spectra import NO_EIGENVALUE, WORD, Spectra, usual
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.rule import NAMES, OPEN, UNDECIDED, Sides, Verdict, judge, place
from mbstab.analysis.verdict.tolerances import TOLERANCES as VERDICT
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, UsageError
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.scene import Scene
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

FROZEN = "frozen-time: the coefficients change along the motion"
T = TypeVar("T")
RAISED: Any = {"over": "raise", "divide": "raise", "invalid": "raise", "under": "ignore"}


class Evaluator:
    """Computes spectra of a model at values of some of its parameters.

    Parameters
    ----------
    model : Model
    path : Path, Sheet or Surface, optional
        Equilibria over the parameters that vary, if a file asks to find them; without it each point is solved alone.
    patterns : sequence of Pattern, optional
        Those that are tried first.
    """

    def __init__(
        self, model: Model, path: Path | Sheet | Surface | None = None, patterns: Sequence[Pattern] = ()
    ) -> None:
        self.model, self.path = model, path
        self.patterns = list(patterns)
        self.tried: list[Pattern] = []  # those of them that have fitted few points
        self.errors: Samples | None = None
        self.terms: Samples | None = None
        self.solutions: dict[tuple[float, ...], tuple[Array, Array] | None] = {}
        """Coordinates and rates of points that are solved by themselves, by the values of the parameters."""
        self.alone = 0
        """How many points of the last call of `near` no pattern fits, so that each was computed by itself."""

    def spectra(
        self,
        values: Mapping[str, Array],
        progress: Callable[[float], object] = lambda done: None,
        share: float = 1.0,
    ) -> Spectra:
        """Return the eigenvalues and verdicts at many points.

        Parameters
        ----------
        values : mapping
            Parameter values in SI, arrays of shape (points,).
        progress : callable, optional
            Called with the fraction of the work that is done, from 0 to 1.
        share : float
            The fraction of all points of the sweep that these are.
        """
        work = _Work(self, values, progress)
        work.run()
        work.guard(math.ceil(share * TOLERANCES.points_guarded))
        work.decide()
        return work.gathered()

    def near(self, values: Mapping[str, Array], count: int, exact: bool = False) -> Spectra:
        """Return `count` eigenvalues at points between others; nan where there are none.

        Parameters
        ----------
        exact : bool
            Whether points that the bounds for many points do not decide are judged one by one.
        """
        work = _Work(self, values, lambda done: None)
        work.sampled = False
        work.run()
        self.alone = sum(part.alone for part in work.found)
        if exact:
            work.decide()
        return work.gathered(count)

    def shapes(self, values: Mapping[str, Array], count: int) -> dict[int, Shapes]:
        """Return `count` eigenvalues and their vectors by the numbers of those points that patterns fit; no verdict."""
        return self._fitted(values, count, lambda points, separation: shapes_of(points, separation).each())

    def eigenvalues(self, values: Mapping[str, Array], count: int) -> Complex:
        """Return `count` eigenvalues at points between others, without verdicts; nan where there are none."""
        known = self._fitted(values, count, lambda points, separation: np.linalg.eigvals(separation.A))
        result = np.full((len(next(iter(values.values()))), count), NO_EIGENVALUE)
        for i, found in known.items():
            result[i] = found
        if len(left := np.setdiff1d(np.arange(len(result)), list(known))):
            result[left] = self.near({name: x[left] for name, x in values.items()}, count).values
        return result

    def _fitted(self, values: Mapping[str, Array], count: int, of: Callable[..., Iterable[T]]) -> dict[int, T]:
        """Return what is told of separated equations by the numbers of those points that patterns fit."""
        work, found = _Work(self, values, lambda done: None), dict[int, T]()
        work.sampled, pending = False, np.arange(work.points)
        pending = pending if self.path is None else pending[self.path.covers(values)]
        for pattern in self.patterns:
            for start in range(0, len(pending), TOLERANCES.points_with_vectors):
                found |= work.separated(pattern, pending[start : start + TOLERANCES.points_with_vectors], count, of)
            pending = pending[~np.isin(pending, list(found))]
        return found

    def at_zeros(self, values: Mapping[str, Array], spectra: Complex, sides: Sides) -> npt.NDArray[np.int8]:
        """Return the verdicts of undecided points, as numbers, where exact zero eigenvalues may decide.

        Whether they are zero to many digits is tested at each point by itself, from the smallest ones on as long as it
        holds; this takes long, so where there are many points they are left undecided.

        Parameters
        ----------
        values : mapping
            Parameter values in SI, arrays of shape (points,).
        spectra : ndarray of complex, shape (points, r)
        sides : ndarray of int8, shape (points, r)
        """
        result = np.full(len(spectra), WORD[UNDECIDED], dtype=np.int8)
        if len(spectra) > TOLERANCES.points_asked_for_zeros:
            return result
        work, failed = _Work(self, values, lambda done: None), 0
        for i in np.argsort(np.max(np.abs(spectra), axis=1, initial=0.0, where=sides == OPEN), kind="stable").tolist():
            result[i] = work.at_zero(i)
            failed = failed + 1 if result[i] == WORD[UNDECIDED] else 0
            if failed == TOLERANCES.undecided_in_a_row:
                break
        return result

    def modes(self, values: Mapping[str, float]) -> tuple[Complex, Complex, Linearization]:
        """Return eigenvalues of one point, their shapes Δq as columns, and the linearized equations."""
        linear = _Work(self, {name: np.array([x]) for name, x in values.items()}, lambda done: None)._linear(0)
        space = state_space(linear)
        found, vectors = np.linalg.eig(space.A)
        return found.astype(complex), space.to_coordinates @ vectors, linear

    def missing(self, values: Mapping[str, Array], index: Index) -> dict[int, str]:
        """Say why there is no solution at some of many points: the scene itself may not exist there."""
        result: dict[int, str] = {}
        for i in index.tolist():
            assert self.path is not None
            try:
                evaluate(self.model, {name: float(x[i]) for name, x in values.items()})
                result[i] = self.path.missing(values, i)
            except MbstabError as error:
                result[i] = str(error)
        return result

    def patterns_at(self, values: Mapping[str, float]) -> tuple[Pattern, ...]:
        """Return the pattern of a point; none if it has a problem."""
        at = {name: np.array([x]) for name, x in values.items()}
        if self.path is not None and not self.path.covers(at).all():
            return ()
        found = _Work(self, at, lambda done: None).pattern(0, judged=False)
        return () if found is None else (found,)

    def keep(self, pattern: Pattern, fitted: int) -> None:
        """Keep a pattern for further points; of those that have fitted few so far, only the latest ones."""
        self.patterns.append(pattern)
        self.tried += [pattern] * (fitted <= TOLERANCES.points_of_lonely_pattern)
        if len(self.tried) > TOLERANCES.lonely_patterns:
            first = self.tried.pop(0)
            self.patterns = [x for x in self.patterns if x is not first]


class _Work:
    """The points of one call."""

    def __init__(self, evaluator: Evaluator, values: Mapping[str, Array], progress: Callable[[float], object]) -> None:
        self.evaluator, self.values, self.progress = evaluator, values, progress
        self.points = len(next(iter(values.values())))
        self.sampled = True
        self.path = evaluator.path
        self.problems: dict[int, str] = {}
        self.found: list[Part] = []
        self.linearized: dict[int, Linearization] = {}
        self.numbers: list[tuple[Index, list[Any]]] = []

    def scene(self, index: Index | int) -> Scene:
        """Return the scene at some points, or at one."""
        chosen = {
            name: float(x[index]) if isinstance(index, int) else np.asarray(x[index]) for name, x in self.values.items()
        }
        return evaluate(self.evaluator.model, chosen)

    def run(self) -> None:
        """Compute all points."""
        pending = np.arange(self.points)
        if self.path is not None:
            covered = self.path.covers(self.values)
            self.problems |= self.evaluator.missing(self.values, pending[~covered])
            pending = pending[covered]
        self.numbers = self._numbers(pending)
        for pattern in list(self.evaluator.patterns):
            pending = pending[~self._fitting(pattern, pending)]
        lonely, number = 0, 0
        while len(pending):
            # In varying order: special values are often in the middle or at an end.
            i = int(pending[int(len(pending) * ((0.37 + 0.618 * number) % 1.0))])
            number += 1
            own = self.pattern(i)
            pending = pending[pending != i]
            if own is not None and lonely < TOLERANCES.lonely_patterns:
                done = self._fitting(own, pending)
                pending = pending[~done]
                lonely = 0 if np.sum(done) > TOLERANCES.points_of_lonely_pattern else lonely + 1
                self.evaluator.keep(own, int(np.sum(done)))

    def _fitting(self, pattern: Pattern, pending: Index) -> Flags:
        """Compute points with a pattern; return which of them fit it."""
        alike = np.zeros(self.points, dtype=bool)
        for index, numbers in self.numbers:
            alike[index] = pattern.known.same_signs(numbers)
        done = alike[pending]
        alike_ones = pending[done]
        errors = self._errors(pattern, alike_ones) if len(alike_ones) else None
        terms = None if errors is None else self._terms(pattern, alike_ones)
        if errors is None or terms is None:
            return np.zeros(len(pending), dtype=bool)
        block, fits = max(64, TOLERANCES.block_entries // pattern.linear.M.size), []
        for start in range(0, len(alike_ones), block):
            part = slice(start, start + block)
            fits.append(self._block(pattern, alike_ones[part], (errors.at(part), terms.at(part))))
            self.progress(1.0 - (len(pending) - start) / self.points)
        done[done] = np.concatenate(fits)
        return done

    def _numbers(self, index: Index) -> list[tuple[Index, list[Any]]]:
        """Return numbers and coefficients of points, in groups; those that are out of range are in none."""
        with contextlib.suppress(MbstabError):
            return [(index, coefficients(System(self.scene(index))))] if len(index) else []
        half = len(index) // 2
        return [*self._numbers(index[:half]), *self._numbers(index[half:])] if half else []

    # --- what is checked at some points, or decided one by one ------------------------------------------------------

    def guard(self, number: int) -> None:
        """Refuse points whose motion is not steady in the frame of their pattern, as tested at so many of them.

        Where a sample has less structure than its pattern, the points of the pattern are computed
        one by one.
        """
        good = np.sort(np.concatenate([part.index for part in self.found])) if self.found else np.arange(0)
        sample = good[np.unique(np.linspace(0, len(good) - 1, number).round().astype(int))] if len(good) else good
        ends = self._ends()
        compared = {i: self._grounds_beside(known, i) for known in ends for i in ends[known]}
        doubts = {int(i): self._doubt(int(i)) for i in sample if int(i) not in compared}
        if any(doubts.values()) or None in compared.values():
            doubts |= {int(i): self._doubt(int(i)) for i in good if int(i) not in doubts and int(i) not in compared}
            for i, doubt in doubts.items():
                if doubt:
                    self.problems.setdefault(i, doubt)
        for known, members in ends.items():
            self._compare(known, {i: grounds for i in members if (grounds := compared[i]) is not None})

    def _grounds_beside(self, known: Known, i: int) -> Grounds | None:
        """Return the facts about a point, which may be the one of a pattern itself."""
        there = known.grounds.system.scene.parameters
        return known.grounds if all(there[name] == x[i] for name, x in self.values.items()) else self._grounds(i)

    def _ends(self) -> dict[Known, list[int]]:
        """Return the first and last point of each pattern."""
        ends: dict[Known, list[int]] = {}
        for part in self.found:
            if len(part.index) and not part.alone:
                ends.setdefault(part.known, []).extend((int(part.index[0]), int(part.index[-1])))
        return {known: sorted({min(index), max(index)}) for known, index in ends.items()}

    def _compare(self, known: Known, ends: Mapping[int, Grounds]) -> None:
        """Compute points of a pattern one by one where points at its ends have another structure."""
        for i, grounds in ends.items():
            other = Known(grounds)
            if known.names == other.names:
                continue
            if known.holds_for(other):
                self._exact(i, grounds)
                continue
            evaluator = self.evaluator
            evaluator.patterns = [x for x in evaluator.patterns if x.known is not known]
            for j in np.concatenate([x.index for x in self.found if x.known is known and not x.alone]).tolist():
                self._exact(int(j))
            return

    def _doubt(self, i: int) -> str:
        """Return why the motion at a point is not steady, or does not exist."""
        try:
            linear = self._linear(i)
            if not linear.constant:
                return FROZEN
            return Grounds(linear).kink(1)
        except MbstabError as error:
            return str(error)

    def decide(self) -> None:
        """Judge points with open eigenvalues one by one, kind by kind, as long as this decides some of them."""
        kinds = kinds_of_open_points(self.found)
        # Where equilibria nearly meet, they are known to the root of the rounding, which only the full answer includes.
        if self.path is not None:
            for i in nearly_meeting(self.found):
                self._exact(i)
        for kind, members in kinds.items():
            failed = 0
            for i in self._unexplained(kind, members):
                failed = 0 if self._more(i, kind) else failed + 1
                if failed == TOLERANCES.undecided_in_a_row:
                    break

    def _unexplained(self, kind: Kind, members: list[int]) -> list[int]:
        """Return the points of a kind that are left after a family of motions has explained the zeros of the others.

        It is followed at some of them, spread over the kind; between these it is the same one, as far as checked.
        """
        alike = kind.with_zeros(self.found, members)
        some = spread(alike, TOLERANCES.points_guarded)
        if len(some) == len(alike):
            return members
        found: Verdict | None = None
        for n, i in enumerate(some):
            verdict = self._judged(i)
            if verdict is None or verdict.zeros != "neutral" or (found is not None and verdict.modulo != found.modulo):
                return [j for j in members if j not in some[: n + 1]]
            found = verdict
        if found is not None:
            settle(self.found, alike, WORD[found.word])
        return [j for j in members if j not in alike]

    def _more(self, i: int, kind: Kind) -> bool:
        """Judge a point as `mbstab eig` does; return whether this decides more than a verdict with open eigenvalues."""
        verdict = self._judged(i)
        if verdict is None:
            return False
        left, word = int(np.sum(self.found[-1].found.sides == OPEN)), WORD[verdict.word]
        return word != WORD[UNDECIDED] and (word != kind.word or left < kind.open)

    def _judged(self, i: int, grounds: Grounds | None = None) -> Verdict | None:
        """Judge a point as `_exact`; return None also where a computation fails."""
        try:
            return self._exact(i, grounds)
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
            return None

    def gathered(self, count: int | None = None) -> Spectra:
        """Return the spectra; the number of neutral eigenvalues is `count`, or the smallest of all points."""
        n_f, neutral = self._sizes(count)
        mirrored, sizes = np.zeros(self.points, dtype=bool), np.zeros(self.points)
        words = np.full(self.points, WORD[UNDECIDED], dtype=np.int8)
        width = 2 * len(self.evaluator.model.coordinates()) * (self.path is not None)
        values, motion = np.full((self.points, n_f - neutral), NO_EIGENVALUE), np.full((self.points, width), np.nan)
        sides = np.full(values.shape, OPEN, dtype=np.int8)
        for part in self.found:
            index, own = part.index, part.found.fitted(n_f, neutral)
            values[index], sides[index], words[index] = own.values, own.sides, own.words
            mirrored[index], sizes[index], motion[index] = own.mirrored, own.sizes, own.motion[:, :width]
            self.problems |= {int(index[i]): text for i, text in own.problems.items()}
        lost = list(self.problems)
        values[lost], sides[lost], words[lost], motion[lost] = NO_EIGENVALUE, OPEN, WORD[UNDECIDED], np.nan
        return Spectra(values, sides, words, mirrored, self.problems, neutral, sizes, motion)

    def _sizes(self, count: int | None) -> tuple[int, int]:
        """Return the number of eigenvalues at most points, and the number of neutral ones."""
        n_f, neutral = usual(part.found for part in self.found)
        if count is not None:
            return max(n_f, count), max(n_f - count, 0)
        # At single points symmetries may be missing: eigenvalues that are zero elsewhere are small there.
        for part in self.found:
            further = neutral - part.known.neutral.count
            if part.total == n_f and further > 0:
                size = np.sort(np.abs(part.found.values), axis=1)
                if np.any(size[:, further - 1] > TOLERANCES.neutral_elsewhere * size[:, -1]):
                    neutral = part.known.neutral.count
        return n_f, neutral

    # --- one point --------------------------------------------------------------------------------------------------

    def _linear(self, i: int) -> Linearization:
        """Return the linearized equations of a point."""
        if i in self.linearized:
            return self.linearized[i]
        system = System(self.scene(i))
        if system.scene.period is not None:
            raise UsageError("periodic motions are not swept: their multipliers take an integration each")
        return linearize(system, self.motion(system, i)[0])

    def _grounds(self, i: int) -> Grounds | None:
        """Return the facts about a point, or None, and record why there are none."""
        try:
            with np.errstate(**RAISED):
                grounds = Grounds(self._linear(i))
                if not grounds.linear.constant:
                    self.problems[i] = FROZEN
                    return None
                doubt = grounds.time or grounds.kink(1)
                if doubt:
                    self.problems[i] = doubt
                    return None
                return grounds
        except UsageError:
            raise
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError) as error:
            self.problems[i] = str(error)
            return None

    def at_zero(self, i: int) -> int:
        """Judge a point whose open eigenvalues may be zero to many digits; return the number of the verdict."""
        grounds = self._grounds(i)
        if grounds is None:
            return WORD[UNDECIDED]
        system, q = grounds.system, grounds.motion.q

        def model() -> Model | None:
            # Many digits are computed for the equilibrium that the file's own guess leads to.
            if self.path is not None and not Problem(system).alike(found_motion(system).q, q):
                return None
            at = {name: float(x[i]) for name, x in self.values.items()}
            return bound(self.evaluator.model, settings_in_si(at))

        grounds.digits = Exactly(model)
        verdict = self._judged(i, grounds)
        return WORD[UNDECIDED if verdict is None else verdict.word]

    def _exact(self, i: int, grounds: Grounds | None = None) -> Verdict | None:
        """Judge a point as `mbstab eig` does; return the verdict, or None if there is none."""
        grounds = grounds or self._grounds(i)
        if grounds is None:
            return None
        separated = grounds.separated
        with np.errstate(all="ignore"):
            placed = grounds.enclosures()
        discs = place(
            [d.centre for d in placed.discs], [d.radius for d in placed.discs],
            [len(d.members) for d in placed.discs], grounds.mirrored,
        )  # fmt: skip
        facts = grounds.facts(discs, len(placed.values) + separated.neutral.count)
        verdict = judge(replace(facts, zeros=lambda: -1))  # what is said of the linear equations is not kept
        sides = np.full((1, len(placed.values)), OPEN, dtype=np.int8)
        numbers = {name: number for number, name in NAMES.items()}
        for disc, own in zip(discs, placed.discs, strict=True):
            sides[0, list(own.members)] = numbers[disc.side]
        sizes, motion = np.array([np.linalg.norm(grounds.S)]), np.hstack([grounds.motion.q, grounds.motion.u])
        words = np.array([WORD[verdict.word]], dtype=np.int8)
        mirrored, neutral = np.array([bool(grounds.mirrored)]), separated.neutral.count
        found = Judged(
            placed.values[None], sides, words, mirrored, {}, neutral, sizes, motion[None], np.array([NOT_COUNTED])
        )
        # Earlier results for the point are discarded.
        for n, part in enumerate(self.found):
            if len(part.index) and i in part.index:
                keep = part.index != i
                self.found[n] = Part(part.index[keep], part.found.at(keep), part.known, part.alone)
        self.found.append(Part(np.array([i]), found, Known(grounds), alone=True))
        return verdict

    def pattern(self, i: int, judged: bool = True) -> Pattern | None:
        """Compute a point in full, and judge it if asked to; return its pattern, or None if it has a problem."""
        grounds = self._grounds(i)
        if grounds is None:
            return None
        if judged:
            try:
                self._exact(i, grounds)
            except (MbstabError, ArithmeticError, np.linalg.LinAlgError) as error:
                self.problems[i] = str(error)
                return None
        known = self.found[-1].known if judged else Known(grounds)
        linear, family = grounds.linear, None
        if grounds.idle_frame and (not grounds.structure.work.conserved or len(linear.D_q)):
            return None  # damping takes energy from motions in one frame, not in the other
        if grounds.lost:
            return None
        if linear.generator is not None and linear.generator.turns:
            directions = np.eye(3)[: linear.system.scene.dimension]
            family = Family(
                linear.system, linear.generator.axis, np.zeros(3), directions, spinning_columns(linear.system)
            )
        balance = None if self.path is None else self.motion(linear.system, i)[1]
        return Pattern(linear, known, family, balance)

    def motion(self, system: System, i: int) -> tuple[Motion, Balance | None]:
        """Return the motion at a point, and its equations if it was solved for."""
        if self.path is None:
            return reference_motion(system, massless=True), None
        q, c = self.path.predicted({name: x[i : i + 1] for name, x in self.values.items()})

        def solved() -> tuple[Motion, Balance]:
            motion, search, at, _ = Problem(system, massless=True).solved(q[0], c[0])
            self.evaluator.solutions[self._place(i)] = at.q, at.c
            return motion, search.balance

        return system.remember("followed motion", (q.tobytes(), c.tobytes()), solved)

    # --- many points ------------------------------------------------------------------------------------------------

    def _block(self, pattern: Pattern, index: Index, known: tuple[Samples, Samples]) -> Flags:
        """Compute points of a pattern together; return which of them fit it."""
        with np.errstate(all="ignore"):
            try:
                good, points = self._equations(pattern, index, self.scene(index)).linearized(*known)
                separation = pattern.known.separated(points)
                for x in self.values.values():
                    good = good & ((x[index] == 0.0) | (np.abs(x[index]) >= VERDICT.number_lost))
                good = good & separation.good & pattern.known.keeps_energy(points)
                found = judged(pattern.known, points, separation)
            except (MbstabError, ArithmeticError, np.linalg.LinAlgError):
                return np.zeros(len(index), dtype=bool)
        if np.any(good):
            self.found.append(Part(index[good], found.at(good), pattern.known))
        return good

    def separated(self, pattern: Pattern, index: Index, count: int, of: Callable[..., Iterable[T]]) -> dict[int, T]:
        """Return what is told of the equations of points with `count` eigenvalues, by their numbers, if they fit."""
        with np.errstate(all="ignore"), contextlib.suppress(MbstabError, ArithmeticError, np.linalg.LinAlgError):
            errors, terms = (f(pattern, index) if len(index) else None for f in (self._errors, self._terms))
            if errors is not None and terms is not None:
                equations = self._equations(pattern, index, self.scene(index))
                good, points = equations.linearized(*(x.at(slice(len(index))) for x in (errors, terms)))
                separation = pattern.known.separated(points)
                if separation.A.shape[-1] == count:
                    told = zip(index.tolist(), (good & separation.good).tolist(), of(points, separation), strict=True)
                    return {i: x for i, fits, x in told if fits}
        return {}

    def _equations(self, pattern: Pattern, index: Index, scene: Scene) -> Equations:
        """Return the equations of some points of a pattern."""
        return Equations(
            pattern,
            System(scene),
            len(index),
            self._start(index),
            lambda x: System(self.scene(index[x])),
            lambda k: self._solution(int(index[k])),
        )

    def _solution(self, i: int) -> tuple[Array, Array] | None:
        """Return the coordinates and rates of a point that is solved by itself; None if it has none."""
        known, place = self.evaluator.solutions, self._place(i)
        if place not in known:
            known[place] = None
            with contextlib.suppress(MbstabError, ArithmeticError, np.linalg.LinAlgError):
                self.motion(System(self.scene(i)), i)
        return known[place]

    def _place(self, i: int) -> tuple[float, ...]:
        """Return the values of the parameters at a point."""
        return tuple(float(x[i]) for x in self.values.values())

    def _start(self, index: Index) -> tuple[Array, Array] | None:
        return None if self.path is None else self.path.predicted({k: x[index] for k, x in self.values.items()})

    def _terms(self, pattern: Pattern, index: Index) -> Samples | None:
        """Return how much cancels in the equations, from some of the points; None if unknown."""
        earlier, points = self.evaluator.terms, len(index)
        if earlier is not None and (not self.sampled or points < TOLERANCES.points_of_lonely_pattern):
            return earlier
        some = np.unique(np.linspace(0, points - 1, TOLERANCES.points_with_terms).round().astype(int))
        with np.errstate(all="ignore"), contextlib.suppress(MbstabError, ArithmeticError, np.linalg.LinAlgError):
            parts = self._equations(pattern, index[some], self.scene(index[some])).terms()
            found = Samples.of(some, parts, points)
            self.evaluator.terms = found.largest(earlier)
            return found
        return earlier

    def _errors(self, pattern: Pattern, index: Index) -> Samples | None:
        """Return how much the rounding of the file changes the equations, from some of the points; None if unknown."""
        evaluator, points = self.evaluator, len(index)
        earlier = evaluator.errors
        if earlier is not None and (not self.sampled or points < TOLERANCES.points_of_lonely_pattern):
            return earlier
        found = data_errors(lambda i: self._errors_at(pattern, int(index[i])), points)
        if found is not None:
            evaluator.errors = found.largest(earlier)
        return found or earlier

    def _errors_at(self, pattern: Pattern, i: int) -> EntryErrors | None:
        """Return how much the rounding of the file changes the equations of a point; None where it has none."""
        place, known = self._place(i), pattern.errors
        if place not in known:
            known[place] = None
            with contextlib.suppress(MbstabError, ArithmeticError, np.linalg.LinAlgError), np.errstate(**RAISED):
                self.linearized[i] = self._linear(i)
                known[place] = entry_errors(self.linearized[i])
        return known[place]
