"""Sweeps of a parameter: eigenvalue branches, verdicts, and the values at which stability changes.

Every point is judged by the rule of `mbstab.analysis.verdict.rule`, as `mbstab eig` does
(`mbstab.analysis.sweep.batched_spectra`); a point that cannot be decided counts as neither stable nor unstable.
Branches are followed by continuity: between neighbouring points no eigenvalue may move by
more than a fraction of its distance to the others; intervals in which one does are divided until
that holds, or until two eigenvalues cross or collide, within a budget of points. Stability changes
are located by functions that are smooth there: the product of the eigenvalues where one passes
zero, the real part of a simple pair where it passes the axis, and, where the spectrum is symmetric
about the imaginary axis, the discriminant of λ², which passes zero where two pairs collide (real parts
grow from there as a square root; Seyranian and Mailybaev 2003, chapter 4). A value counts only
if the verdicts on both sides of it confirm the change.
"""

from __future__ import annotations

import contextlib
from dataclasses import field, replace
from itertools import islice

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex, Flags, Index
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.reference.continuation import follow as follow_path
from mbstab.analysis.reference.equilibrium import outputs_along
from mbstab.analysis.reference.guesses import idle
from mbstab.analysis.reference.measured_moments import measured_moments
from mbstab.analysis.reference.motion import motion_at
from mbstab.analysis.reference.paths import Path as Solutions
from mbstab.analysis.reference.read_speeds import misread
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import Block, Progress, home_of, merged, patterns_at, tasks, undecided
from mbstab.analysis.sweep.critical import Critical
from mbstab.analysis.sweep.critical_values import CriticalValues
from mbstab.analysis.sweep.detail import Detail, detailed
from mbstab.analysis.sweep.jobs import run, stored
from mbstab.analysis.sweep.ranges import Range, Ranges
from mbstab.analysis.sweep.settings import HERE, SweepSettings
from mbstab.analysis.sweep.spectra import unstable_counts
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import AXIS, LEFT, OPEN, RIGHT, WORDS
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError
from mbstab.model.doubts import doubts
from mbstab.model.measures import unit_of_output
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class OrderCrossing:
    """Where the frequency of a branch is a multiple of the parameter, an angular velocity.

    Attributes
    ----------
    order : float
        The multiple.
    value : float
        Of the parameter (SI).
    frequency : float (rad/s)
    branch : int
    name : str
        Of the branch, empty if it has none.
    whirl : str
        ``forward``, ``backward`` or ``mixed``; empty if no body that spins whirls.
    motions : tuple of (str, complex)
        The mode in words, as `mbstab.analysis.spectrum.results.Eigenvalue` has it.
    """

    order: float
    value: float
    frequency: float
    branch: int
    name: str
    whirl: str
    motions: tuple[tuple[str, complex], ...] = ()


PLACES = ("right", "left", "axis", "open")
"""Right and left of the imaginary axis, held on it by a structure, and where the side is not known."""


@dataclass(frozen=True)
class Sweep(Answer):
    """Eigenvalue branches over a parameter.

    Attributes
    ----------
    parameter : str
    values : ndarray, shape (points,)
        Values of the parameter (SI), ascending or descending as requested.
    branches : ndarray of complex, shape (points, r)
        Eigenvalues that are not neutral (1/s), one column for each branch; nan where there are none.
    unstable : ndarray of int, shape (points,)
        Number of unstable eigenvalues; −1 where the verdict is open, or there is no answer.
    neutral : int
        Additional number of neutral eigenvalues.
    critical : tuple of Critical
        In the order of the parameter.
    meetings : tuple of (float, str)
        If they are asked for, values at which two branches ``cross`` or ``collide``; once for each pair that does.
    problems : dict
        By the number of a point, why it has no eigenvalues.
    start : float or None
        The value from which equilibria were followed, if a file asks to find them.
    moved : str
        Why they were not followed from the file's own value, or the one of the range that is nearest to it.
    beyond : tuple of Sweep
        Sweeps along the paths to which the equilibria lead through folds and branch points: each from one of these to
        the next or to an end of the range, at those values that lie in between.
    words : ndarray of int8, shape (points,)
        Numbers of the verdicts among `mbstab.analysis.verdict.rule.WORDS`; `verdicts` has them in words.
    warnings : tuple of str
        Where the search for critical values ended early.
    names : tuple of str
        Names of the branches, from the modes that the file names; without them none.
    orders : tuple of float
        Multiples of the parameter whose crossings with the frequencies are asked for …
    crossings : tuple of OrderCrossing
        … and found, in the order of the parameter.
    senses : tuple of tuple of (float, float, str)
        With orders: for each branch from where to where, ascending, spinning bodies whirl in which sense: ``forward``,
        ``backward`` or ``mixed``, empty if none whirls.
    reference : dict of ndarray, shape (points,)
        If the file asks to find the reference: its coordinates by name (m, rad), and as ``rate(…)`` those rates that
        are not zero everywhere; nan where there is no answer.
    outputs : dict of ndarray, shape (points,)
        If the file asks to find the reference: the outputs of the file there, nan where one has no value.
    units : dict
        Units of the columns of `reference` and `outputs`.
    turning : bool
        Whether the eigenvalues are those of disturbances in a frame that turns with the motion.
    detail : Detail or None
        The branches with the points between those of the sweep, for a picture; None if these are dense, or it was not
        asked for.
    located : ndarray of int, shape (points, 4)
        Numbers of eigenvalues that are not neutral by their place, in the order of `PLACES`.
    ranges : tuple of Range
        The verdicts between critical values and at special points, ascending.
    """

    parameter: str
    values: Array
    branches: Complex
    unstable: npt.NDArray[np.intp]
    neutral: int
    critical: tuple[Critical, ...]
    meetings: tuple[tuple[float, str], ...]
    problems: dict[int, str]
    start: float | None = None
    moved: str = ""
    beyond: tuple[Sweep, ...] = ()
    words: npt.NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    warnings: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    orders: tuple[float, ...] = ()
    crossings: tuple[OrderCrossing, ...] = ()
    senses: tuple[tuple[tuple[float, float, str], ...], ...] = ()
    reference: dict[str, Array] = field(default_factory=dict)
    outputs: dict[str, Array] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    turning: bool = False
    detail: Detail | None = None
    located: Index = field(default_factory=lambda: np.zeros((0, len(PLACES)), dtype=int))
    ranges: tuple[Range, ...] = ()

    @property
    def whirls(self) -> tuple[str, ...]:
        """With orders: the sense of whirl of each branch, ``changing`` if it is forward and backward; see `senses`."""
        words = [{word for *_, word in parts} for parts in self.senses]
        sure = [found & {"forward", "backward"} or found - {""} for found in words]
        return tuple("changing" if len(found) > 1 else "".join(found) for found in sure)

    @property
    def spectra(self) -> list[dict[str, int] | None]:
        """Numbers of eigenvalues at each value by their place, `PLACES`; None where there is no answer."""
        lost = self._lost()
        return [
            None if lost[i] else dict(zip(PLACES, counts, strict=True))
            for i, counts in enumerate(self.located.tolist())
        ]

    @property
    def found(self) -> dict[str, Array]:
        """The columns of `reference` and `outputs`."""
        return self.reference | self.outputs

    @property
    def verdicts(self) -> list[str]:
        """The verdict at each value, one of `mbstab.analysis.verdict.rule.WORDS`."""
        return [WORDS[word] for word in self.words]

    @property
    def unanswered(self) -> list[int]:
        """Numbers of the points that have no eigenvalues on any path."""
        answered = {float(x) for path in self.beyond for x in path.values[~path._lost()]}
        return [int(i) for i in np.flatnonzero(self._lost()) if float(self.values[i]) not in answered]

    def _lost(self) -> Flags:
        """Return which values have no answer on this path."""
        lost: Flags = np.any(np.isnan(self.branches), axis=1)
        lost[list(self.problems)] = True
        return lost


def sweep(
    model: Model,
    parameter: str,
    values: Array,
    progress: Progress = lambda done: None,
    settings: SweepSettings = HERE,
    meetings: bool = False,
    detail: bool = False,
) -> Sweep:
    """Return the eigenvalue branches of a model over a parameter, and where stability changes.

    Parameters
    ----------
    model : Model
    parameter : str
    values : ndarray, shape (points,)
        Values of the parameter (SI), ascending or descending.
    progress : callable, optional
        Called with the fraction of the work that is done, from 0 to 1.
    settings : SweepSettings, optional
    meetings : bool, optional
        Whether it is located where branches meet …
    detail : bool, optional
        … and points between those of the sweep are computed, for pictures.

    Raises
    ------
    UsageError
        If the parameter is also set, or its values are not in order.
    MbstabError
        If the file asks to find equilibria and none is found to start from.
    """
    if parameter in model.settings:
        raise UsageError(f"{parameter} is swept and set at the same time")
    steps = np.diff(values)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise UsageError(f"the values of {parameter} must ascend or descend")
    order = slice(None, None, -1) if len(values) > 1 and values[0] > values[-1] else slice(None)
    x = values[order]
    paths: list[Solutions | None] = [None]
    if model.reference.find is not None:
        main = follow_path(model, parameter, float(x[0]), float(x[-1]), wanted=len(x))
        paths = [main, *main.beyond]
    grids = [x, *(x[path.covers({parameter: x})] for path in paths[1:] if path is not None)]
    # What happens between the last point and a fold shows at a point near the fold.
    closer = [x if path is None else np.union1d(x, path.next_to_ends()) for x, path in zip(grids, paths, strict=True)]
    groups = [tasks(model, {parameter: x}, path) for x, path in zip(closer, paths, strict=True)]
    all_tasks = [task for group in groups for task in group]
    with stored(all_tasks, settings) as store:
        blocks = iter(run(all_tasks, store, settings, progress))
        found = [
            _at(
                np.flatnonzero(np.isin(more, x))[order],
                _answer(model, parameter, more, path, merged(list(islice(blocks, len(group)))), (meetings, detail)),
            )
            for x, more, path, group in zip(grids, closer, paths, groups, strict=True)
        ]
    return replace(found[0], beyond=tuple(found[1:]))


def _answer(
    model: Model, parameter: str, x: Array, path: Solutions | None, raw: Block, asked: tuple[bool, bool]
) -> Sweep:
    """Return the branches and critical values along one path of solutions; with meetings and detail if asked for."""
    evaluator = Evaluator(model, path, patterns_at(model, path, home_of({parameter: x})))
    # Names and curves belong to branches.
    fine = TOLERANCES.meeting_interval if asked[0] or model.modes else TOLERANCES.detail_meeting if asked[1] else np.inf
    tracker = CriticalValues(evaluator, parameter, x, raw, locates=fine)
    branches = tracker.branches()
    critical = tracker.critical(branches)
    # Zeros that nonlinear terms decide do not tell where stability changes.
    words, open_ = raw.words.copy(), undecided(raw)
    if len(open_):
        words[open_] = evaluator.at_zeros({parameter: x[open_]}, raw.values[open_], raw.sides[open_])
    if path is not None:
        others = [value for value in tracker.crossings if not tracker.known(value, critical)]
        critical = [replace(c, branching=any(tracker.known(x, [c]) for x in tracker.crossings)) for c in critical]
        critical += [tracker.branch_point(value, branches) for value in others]
        # The fold from which a further path starts is reported with the path that leads to it.
        critical += [tracker.ended(value, reason) for value, reason in path.ends if value != path.start]
    ranges = Ranges(tracker, words)
    critical += ranges.untold(critical, branches)
    critical.sort(key=lambda c: c.value)
    warnings = (*tracker.warnings, *idle(model, [parameter], None if path is None else {parameter: path.start}))
    # What is said of the speeds and the moments of one point holds for the others.
    points = [pattern.linear for pattern in evaluator.patterns[:1]]
    for system, motion in ((linear.system, linear.motion) for linear in points):
        allowed = motion.spaces.scale[:, None] * motion.spaces.N
        warnings += (*misread(system, motion.q, motion.u), *measured_moments(system, motion.q, motion.u, allowed))
    warnings += tuple(doubts(model))
    reference, outputs = _named(model, raw.motion), _outputs(model, parameter, x, raw.motion)
    units = {name: model.unit_of_solved(name) for name in reference}
    units |= {name: unit_of_output(model, model.outputs[name]) for name in outputs}
    return Sweep(
        parameter, x, branches, unstable_counts(raw.sides, words), raw.neutral, tuple(critical),
        tuple(sorted(tracker.meetings)) if asked[0] else (), raw.problems, None if path is None else path.start,
        "" if path is None else path.moved, (), words,
        warnings, reference=reference, outputs=outputs, units=units,
        turning=_turns(evaluator), detail=detailed(tracker, branches) if asked[1] else None,
        located=np.stack([np.sum(raw.sides == side, axis=1) for side in (RIGHT, LEFT, AXIS, OPEN)], axis=1),
        ranges=ranges.told(critical),
    )  # fmt: skip


def _turns(evaluator: Evaluator) -> bool:
    """Return whether the motions turn and the equations are written in frames that turn with them."""
    frames = (pattern.linear.generator for pattern in evaluator.patterns[:1])
    return any(frame is not None and bool(frame.turns) for frame in frames)


def _named(model: Model, motion: Array) -> dict[str, Array]:
    """Return coordinates and rates of solved references by name, rates if they are not zero everywhere."""
    if not motion.shape[1]:
        return {}
    names = model.coordinates()
    q, u = motion[:, : len(names)].T, motion[:, len(names) :].T
    moving = {f"rate({name})": x for name, x in zip(names, u, strict=True) if np.any(np.nan_to_num(x))}
    return dict(zip(names, q, strict=True)) | moving


def _outputs(model: Model, parameter: str, x: Array, motion: Array) -> dict[str, Array]:
    """Return the outputs of the file at solved references, by name."""
    if not motion.shape[1] or not model.outputs:
        return {}
    found = np.full((len(x), len(model.outputs)), np.nan)
    for i in np.flatnonzero(~np.any(np.isnan(motion), axis=1)).tolist():
        with contextlib.suppress(*FAILURES):
            system = System(evaluate(model, {parameter: float(x[i])}))
            q, u = np.split(motion[i], 2)
            found[i] = list(outputs_along(system, motion_at(system, q, u, system.scene.time, massless=True)).values())
    return dict(zip(model.outputs, found.T, strict=True))


def _at(index: Index, result: Sweep) -> Sweep:
    """Return a sweep at some of its points, in this order."""
    return replace(
        result, values=result.values[index], branches=result.branches[index], unstable=result.unstable[index],
        words=result.words[index], located=result.located[index],
        problems={n: result.problems[i] for n, i in enumerate(index.tolist()) if i in result.problems},
        reference={name: x[index] for name, x in result.reference.items()},
        outputs={name: x[index] for name, x in result.outputs.items()},
    )  # fmt: skip
