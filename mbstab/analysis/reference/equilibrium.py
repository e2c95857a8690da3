"""Equilibria and steady motions: Newton's method on the constrained equations with exact derivatives.

The equations are those of `mbstab.analysis.reference.equations`. Steps have minimum norm, so
coordinates that nothing depends on do not change; they are bounded and damped as in the
Levenberg-Marquardt method. Where that stalls, the motion is damped until it comes to rest
(pseudo-transient continuation; Kelley and Keyes 1998, SIAM J. Numer. Anal. 35), a valley with
stiff walls is followed along its floor, or the motion is spun up from rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra.arrays import Flags, least_squares
from mbstab.analysis.algebra.failures import FAILURES
from mbstab.analysis.algebra.subspaces import fewest
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.coefficients import matrices_in
from mbstab.analysis.reference.efforts import Acted, Placement, efforts
from mbstab.analysis.reference.equations import Balance, State
from mbstab.analysis.reference.failure import STRATEGIES, Failure, excess, undetermined
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.reference.guard import coefficients, require_steady
from mbstab.analysis.reference.imbalance import carrying, force_rounding, state_rounding
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.reference.newton import Search, Stalled, newton_step
from mbstab.analysis.reference.outputs import Outputs
from mbstab.analysis.reference.reactions import Reaction, components, reactions
from mbstab.analysis.reference.rotation import orientation
from mbstab.analysis.reference.sharpening import exactly_rounded
from mbstab.analysis.reference.steady import Family, Generator, declared_family, detected
from mbstab.analysis.reference.symmetries import symmetries
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import EquilibriumError, MbstabError, ModelFileError, NumericalError, UsageError
from mbstab.model.schema import is_angle
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class Equilibrium(Answer):
    """An equilibrium or a steady motion.

    Attributes
    ----------
    motion : Motion
    steady : Generator
        Generator of the motion; its text is ``rest`` at rest.
    reactions : list of Reaction
        What each joint, contact and drive transmits.
    efforts : list of Acted
        Of all that acts along one motion.
    outputs : dict of float
        The outputs of the file by name; nan where one has no value.
    residual : float
        Largest remaining imbalance, relative to the forces that balance.
    unbalanced : tuple of float
        Largest unbalanced force (N) and torque (N·m).
    iterations : int
    strategy : str
        ``Newton``, ``relaxation``, ``valley`` or ``spin-up``: what led to the solution.
    symmetries : tuple of str
        Shifts that lead from this solution to others like it.
    open : tuple of str
        Other directions in which the solution is not isolated to first order, in words; empty: it is isolated.
    timed : bool
        Whether given functions of time act, so that it is an equilibrium at this time only.
    """

    motion: Motion
    steady: Generator
    reactions: list[Reaction]
    efforts: list[Acted]
    outputs: dict[str, float]
    residual: float
    unbalanced: tuple[float, float]
    iterations: int
    strategy: str
    symmetries: tuple[str, ...]
    open: tuple[str, ...]
    timed: bool

    @property
    def isolated(self) -> bool:
        """Whether no other solution is near, apart from symmetries."""
        return not self.open


# --- from a scene to its equilibria ---------------------------------------------------------------------------------


def found_motion(system: System, massless: bool = False) -> Motion:
    """Return the equilibrium or steady motion that the reference of a file leads to, given coordinates held.

    Raises
    ------
    ModelFileError
        If the constraints cannot be satisfied.
    EquilibriumError
        If none is found; the message says where the search stalled, and what to try.
    """
    problem = Problem(system, massless)
    motion, search, at, _ = problem.solved(problem.start)
    if not search.balance.equations(at, TOLERANCES.isolated_singular_value).loose.size:
        return motion
    found = _open_directions(search, at, symmetries(system, motion))
    what = "equilibrium" if motion.at_rest else "steady motion"
    said = [f"the {what} is not isolated to first order: {text}" for text in found]
    off = np.zeros(system.n_q)
    if not motion.sharpened:
        for vector in found.values():
            off[search.balance.open] += _spread(search, at, vector) * np.abs(vector)
    return replace(motion, spread=off * search.sizes, warnings=(*motion.warnings, *said))


def find_equilibria(
    system: System, starts: int, seed: int = 1, track: Callable[[list[int]], Iterator[int]] = iter
) -> list[Equilibrium]:
    """Return the distinct equilibria or steady motions that several starts lead to, the file's own first.

    Given coordinates are held if the file says ``find``; otherwise they are a start like the
    guessed ones.

    Parameters
    ----------
    starts : int
        Number of starts: the reference of the file, and random ones around it.
    seed : int
        Seed of the random numbers; the same seed gives the same starts.
    track : callable
        Takes the list of starts and returns them one by one, for a progress bar.

    Raises
    ------
    ModelFileError
        If the constraints cannot be satisfied.
    EquilibriumError
        If no start leads to one.
    """
    problem = Problem(system, massless=True)
    rng = np.random.default_rng(seed)
    distinct: list[Equilibrium] = []
    failure: MbstabError | None = None
    for number in track(list(range(starts))):
        try:
            found = problem.described(*problem.solved(problem.start if number == 0 else problem.elsewhere(rng)))
        except MbstabError as error:
            failure = failure or error
            continue
        if not any(problem.same(found, other) for other in distinct):
            distinct.append(found)
    if not distinct:
        assert failure is not None
        raise problem.explained(failure)
    return distinct


class Problem:
    """What is asked for, and the checks that a solution must pass."""

    def __init__(self, system: System, massless: bool = False) -> None:
        self.system, self.scene, self.massless = system, system.scene, massless
        if self.scene.period is not None:
            name = self.scene.model.name
            raise UsageError(f"{name} describes a periodic motion: there is no equilibrium to look for")
        self.finder = Finder(system)
        self.held: Flags = ~self.finder.start()[1] & (self.scene.model.reference.find is not None)
        self.family, self.known = declared_family(system)
        if self.scene.steady is None and self.scene.model.reference.find is None and any(self.scene.rates.values()):
            self.family, self.known = self._moving()

    @cached_property
    def start(self) -> Array:
        """The state of the file, assembled."""
        q = self.finder.start()[0]
        return self.finder.assemble(q, ~self.held) if self.system.n_h and not self.held.all() else q

    def explained(self, failure: MbstabError) -> MbstabError:
        """Return why nothing was found; where equations have no value on the way, what to do if the reference moves."""
        moves = self.scene.model.reference.find is None and any(self.scene.rates.values())
        if not moves or not isinstance(failure, NumericalError):
            return failure
        said = str(failure).partition("\nhint:")[0]
        return EquilibriumError(
            f"{said}\nhint: the reference of this file moves, and no find: says what is looked for; find: steady looks "
            "for a motion, with steady: {direction: x, speed: …} or {axis: z, rate: …}; mbstab eig takes the reference "
            "as it is"
        )

    def _moving(self) -> tuple[Family, dict[int, float]]:
        """Return the generator that the rates of a file without ``find`` or ``steady`` describe, all rates given.

        Rates that it leaves out follow from the constraints; where these leave a choice, they are zero.
        """
        try:
            u = self.finder.rates(self.start)[0]
            u[self.system.states[0]] = 0.0  # those of a steady motion are constant
        except MbstabError:
            u = np.array([self.scene.rates.get(name, 0.0) for name in self.system.names], dtype=float)
        generator = detected(self.system, self.start, u, self.finder.sizes)[-1]
        columns = tuple(int(i) for i in np.flatnonzero(generator.spins))
        axis = generator.axis if generator.turns else None
        directions = generator.velocity[None, :] if np.any(generator.velocity) else np.zeros((0, 3))
        family = Family(self.system, axis, generator.point, directions, columns)
        rates = [*([generator.rate] if generator.turns else []), *([1.0] * len(directions))]
        return family, dict(enumerate([*rates, *generator.spins[list(columns)]]))

    def solved(self, start: Array, c: Array | None = None) -> tuple[Motion, Search, State, str]:
        """Return the solution from a start, checked, and how it was found.

        With rates `c` as well, the start is a prediction: given coordinates are put in, and only
        Newton's method is tried.

        Raises
        ------
        ModelFileError
            If the constraints cannot be satisfied.
        EquilibriumError
            If there is none.
        """
        if c is not None:
            start = np.where(self.held, self.finder.start()[0], start)
            if self.family.columns and len(c) < self.family.size:
                return self._without_spins()._solved(start, c, STRATEGIES[:1])
        elif self.family.columns and self.scene.steady is not None:
            # A motion without spins first: with spins there may be more solutions, some valid for an instant only.
            try:
                return self._without_spins()._solved(start, None, STRATEGIES[:1])
            except MbstabError as error:
                declared = error
            try:
                return self._solved(start, c, STRATEGIES)
            except EquilibriumError:
                if any(self.system.names[i] in self.scene.rates for i in self.family.columns):
                    raise  # the file declares spins
                raise declared from None
        return self._solved(start, c, STRATEGIES if c is None else STRATEGIES[:1])

    def _without_spins(self) -> Problem:
        plain = copy(self)
        plain.family = replace(self.family, columns=())
        return plain

    def _solved(self, start: Array, c: Array | None, allowed: tuple[str, ...]) -> tuple[Motion, Search, State, str]:
        """Return the solution that some strategies lead to."""
        balance = Balance(self.system, self.finder.sizes, self.family, self.known, self.held)
        search = Search(balance, self.finder, start)
        c = self.rates(start) if c is None else c
        try:
            with np.errstate(all="ignore"):
                at, strategy = search.solve(start, c, allowed)
        except Stalled as stalled:
            raise Failure(self, search).error(stalled.state) from None
        at, sharpened = _tidied(search, at), None
        if search.magnified > TOLERANCES.sharpened_from:
            sharpened = exactly_rounded(balance, at)
            at = at if sharpened is None else search.state(*sharpened)
        finder = Finder(self.system, self.massless)
        finder.solved = [name for name, held in zip(self.system.names, self.held, strict=True) if not held]
        over = excess(search, at)
        if np.any(over > 1.0):
            at = search.softened(at)
            over = excess(search, at)
        small = np.all(np.abs(at.residual) <= TOLERANCES.residual) and np.all(over <= 1.0)
        if not (small and self._closed(at)) or undetermined(search, at)[1]:
            raise Failure(self, search).error(at)
        self._require_rates(search, at)
        try:
            motion = finder.motion(at.q, at.u, steady=at.steady, declared=self.scene.steady is not None)
            unsure = [_unsure(search, at)] if search.magnified > TOLERANCES.sharpened_from and not sharpened else []
            motion = replace(motion, sharpened=sharpened is not None, warnings=(*motion.warnings, *unsure))
        except ModelFileError as error:
            raise Failure(self, search).error(at, error) from None
        if not at.steady.turns and np.any(at.u):
            motion = replace(motion, generators=tuple(detected(self.system, at.q, at.u, self.finder.sizes)))
        return motion, search, at, strategy

    def described(self, motion: Motion, search: Search, at: State, strategy: str) -> Equilibrium:
        """Return the equilibrium of a solution, with reactions and symmetries."""
        coefficients(self.system, motion)  # names what breaks a declared symmetry
        if not motion.at_rest and not motion.declared:
            self._require_steady(motion, at)
        known = symmetries(self.system, motion)
        force = at.residual[: self.system.n_q] * search.balance.energy / self.finder.sizes
        unbalanced = [
            float(np.max(np.abs(force[kind]), initial=0.0)) for kind in (self.finder.is_length, ~self.finder.is_length)
        ]
        loads, acting = _loads(self.system, motion)
        return Equilibrium(
            motion, at.steady, loads, acting, outputs_along(self.system, motion), float(np.max(np.abs(at.residual))),
            (unbalanced[0], unbalanced[1]), search.iterations, strategy, tuple(s.name for s in known),
            tuple(_open_directions(search, at, known)),
            not np.any(at.u) and self.scene.timed,
        )  # fmt: skip

    def _require_steady(self, motion: Motion, at: State) -> None:
        """Refuse rates of a file that no steady motion has; forces may balance at an instant.

        Raises
        ------
        ModelFileError
            With what does not stay as it is.
        """
        try:
            require_steady(self.system, motion, at.steady)
        except MbstabError as error:
            model = self.scene.model
            place = next(x.location for x in model.reference.rates.values())
            message = f"these rates are those of no steady motion: {str(error).splitlines()[0]}"
            hint = "leave them out to look for an equilibrium, which is at rest, or correct them"
            raise ModelFileError([model.document.problem(place, "reference.rates", message, hint)]) from None

    def _closed(self, at: State) -> bool:
        """Return whether a state satisfies all rows, including redundant ones."""
        dynamics = self.system.dynamics(at.q, at.u)
        allowed = TOLERANCES.residual * np.abs(dynamics.J) @ self.finder.sizes + 1e-300
        fastest = float(np.max(np.abs(at.u / self.finder.sizes), initial=0.0))
        n_h = self.system.n_h
        good = np.all(np.abs(dynamics.E[:n_h]) <= allowed[:n_h])
        place, time = (at.q, at.u), self.scene.time
        rounding = state_rounding(self.system, *place, time)
        rounding += TOLERANCES.coordinate_rounding * carrying(self.system, place, time, self.finder.sizes)
        return bool(good and np.all(np.abs(dynamics.V) <= allowed * max(fastest, 1e-300) + rounding))

    def _require_rates(self, search: Search, at: State) -> None:
        """Refuse a steady motion some of whose rates are undetermined.

        Raises
        ------
        ModelFileError
            If there are any; the message names them.
        """
        balance = search.balance
        if not balance.free:
            return
        null = balance.equations(at, TOLERANCES.isolated_singular_value).loose
        known = np.linalg.svd(balance.family.basis(at.q)[:, balance.free] / search.sizes[:, None])
        same = known[2][int(np.sum(known[1] > 1e-9 * max(float(known[1][0]), 1e-300))) :].T
        n = len(balance.open)
        # Combinations of rates that move nothing are no freedom of the motion.
        rates = null[n:] - same @ (same.T @ null[n:])
        still = np.linalg.norm(null[:n], axis=0) < 1e-6
        names = [balance.family.names()[k] for k in balance.free]
        if np.any(np.abs(rates[:, still]) > 1e-6):
            loose = ", ".join(names[i] for i in fewest(rates[:, still], names))
            message = f"nothing determines {loose} of the steady motion"
            hint = f"give {loose} under reference; 0 for what does not turn"
            place = self.scene.model.reference.location
            raise ModelFileError([self.scene.model.document.problem(place, "reference", message, hint)])

    def rates(self, q: Array) -> Array:
        """Return starting values of the rates: given ones, and for the others those that fit the constraints best."""
        c = np.array([self.known.get(k, 0.0) for k in range(self.family.size)])
        free = [k for k in range(self.family.size) if k not in self.known]
        if free:
            basis = self.family.basis(q)
            given = [i for i, name in enumerate(self.system.names) if name in self.scene.rates]
            given += [i for i, name in enumerate(self.system.names) if name in self.scene.guess_rates]
            told = {**self.scene.guess_rates, **self.scene.rates}
            rates = np.array([told[self.system.names[i]] for i in given], dtype=float)
            state = self.system.bodily.dynamics(q, basis @ c)
            left = np.vstack([state.J @ basis[:, free], basis[np.ix_(given, free)]])
            c[free] = least_squares(left, -np.concatenate([state.V, (basis @ c)[given] - rates]), rcond=1e-9)
            turns = self.family.axis is not None and 0 in free
            if turns and not np.any(c):
                # At rate zero the derivative vanishes: the forces grow with the square of the rate.
                gravity = float(np.linalg.norm([float(x) for x in self.scene.gravity]))
                lengths = self.finder.sizes[self.finder.is_length]
                c[0] = math.sqrt((gravity or 1.0) / (float(np.max(lengths, initial=0.0)) or 1.0))
            c[free] *= self.boost
        return c

    boost = 1.0
    """Factor on starting values of unknown rates, for random starts."""

    def elsewhere(self, rng: np.random.Generator) -> Array:
        """Return a random start that satisfies the constraints as well as possible."""
        self.boost = float(np.exp(rng.uniform(-3.0, 1.5)))
        far = np.where([is_angle(name) for name in self.system.names], math.pi, 2.0 * self.finder.sizes)
        change = rng.uniform(-1.0, 1.0, len(self.start)) * far
        q = self.start + np.where(self.held, 0.0, change)
        if self.system.n_h and not self.held.all():
            try:
                q = self.finder.assemble(q, ~self.held)
            except FAILURES:
                return self.start
        return q

    def alike(self, one: Array, other: Array) -> bool:
        """Whether two positions are the same, apart from whole turns."""
        difference = _pose(self.system, one) - _pose(self.system, other)
        return bool(np.max(np.abs(difference)) < 1e-6 * max(1e-300, float(np.min(self.finder.sizes))))

    def same(self, one: Equilibrium, other: Equilibrium) -> bool:
        """Whether two solutions are the same, apart from whole turns and symmetries."""
        if self.alike(one.motion.q, other.motion.q):
            return True
        if not one.symmetries or one.symmetries != other.symmetries:
            return False
        # What a symmetry does not change: the loads and the spectrum of the stiffness.
        x, y = (_signature(self.system, found) for found in (one, other))
        size = max(float(np.max(np.abs(z), initial=1e-300)) for z in (x, y))
        return len(x) == len(y) and bool(np.max(np.abs(x - y), initial=0.0) < 1e-6 * size)


def _loads(system: System, motion: Motion) -> tuple[list[Reaction], list[Acted]]:
    """Return what is transmitted at a motion, and what acts along one motion of bodies."""
    placement = Placement(Attitudes.of(system), system, motion.q, motion.u)
    transmitted = reactions(system, motion.q, motion.u, motion.dynamics.J, motion.nu)
    return transmitted, efforts(placement, motion.nu, motion.time)


def outputs_along(system: System, motion: Motion) -> dict[str, float]:
    """Return the outputs of the file at a motion by name, nan where one has no value."""
    outputs, state, (loads, acting) = Outputs(system), (motion.q, motion.u, motion.a), _loads(system, motion)
    values = outputs.values(outputs.measured(system, *state), *state, components(loads), acting)
    return {
        name: x if math.isfinite(x) else math.nan for (name, _), x in zip(outputs.names, values.tolist(), strict=True)
    }


def _tidied(search: Search, at: State) -> State:
    """Return a solution with near-zero numbers set to zero, where the residuals stay small."""
    q, c = at.q.copy(), at.c.copy()
    q[np.abs(q / search.sizes) < 1e-15] = 0.0
    c = _fewest_spins(search.balance, q, c)
    c[np.abs(c) < 1e-13 * search.balance.speed] = 0.0
    try:
        cleaned = search.state(q, c)
    except (MbstabError, ArithmeticError, ValueError):
        return at
    return cleaned if cleaned.size <= max(2.0 * at.size, 1e-14) else at


def _fewest_spins(balance: Balance, q: Array, c: Array) -> Array:
    """Return rates of the same motion in which spins that the turn produces are part of the turn."""
    free, columns = balance.free, len(balance.family.columns)
    if not free or not columns:
        return c
    _, s, right = np.linalg.svd(balance.family.basis(q)[:, free] / balance.sizes[:, None])
    null = right[int(np.sum(s > 1e-9 * max(float(s[0]), 1e-300))) :].T
    spins = [n for n, k in enumerate(free) if k >= balance.family.size - columns]
    if null.shape[1] and spins:
        moved = c.copy()
        moved[free] -= null @ least_squares(null[spins], c[free][spins], rcond=1e-9)
        return moved
    return c


def _unsure(search: Search, at: State) -> str:
    """Return how well a solution is known that more digits do not sharpen, in words."""
    moves = np.abs(search.balance.equations(at).inverse[: search.balance.moving])
    off = float(np.max(moves @ np.maximum(np.abs(at.residual), EPS), initial=0.0))
    return (
        f"the {'steady motion' if np.any(at.u) else 'equilibrium'} that was found is known to {off:.0e} of the size of "
        f"the scene or worse: beside a singular or critical position rounding is magnified {search.magnified:.0e} times"
    )


def _open_directions(search: Search, at: State, known: list[Symmetry]) -> dict[str, Array]:
    """Return directions in which a solution is not isolated to first order, and which no symmetry explains."""
    balance = search.balance
    if not balance.moving:
        return {}
    null = balance.equations(at, TOLERANCES.isolated_singular_value).loose[: len(balance.open)]
    if known:
        shifts = (
            np.array([s.direction for s in known])[:, search.balance.open].T / search.sizes[search.balance.open, None]
        )
        basis, _ = np.linalg.qr(shifts)
        null = null - basis @ (basis.T @ null)
    left, s, _ = np.linalg.svd(null, full_matrices=False)
    names = [search.system.names[i] for i in search.balance.open]
    found = {}
    for vector in left.T[: int(np.sum(s > 1e-6))]:
        strong = np.argsort(-np.abs(vector))
        parts = [names[i] for i in strong if abs(vector[i]) > 0.3 * np.max(np.abs(vector))]
        kind = "a continuum" if _continues(search, at, vector) else "a critical position"
        found[f"{kind} along {', '.join(parts[:4])}"] = vector
    return found


def _spread(search: Search, at: State, vector: Array) -> float:
    """Return how far along a direction, relative to the scene, residuals are no more than rounding and that of `at`.

    At an m-fold solution they grow like the m-th power of the distance, so that this is an m-th root of the rounding.
    Along a continuum they stay: all is a solution, and none is off.
    """
    system, balance = search.system, search.balance
    equations = balance.equations(at, TOLERANCES.isolated_singular_value)
    ahead = np.concatenate([vector, np.zeros(balance.moving - len(vector))])
    rounding = force_rounding(system, (at.q, at.u, at.a, at.nu)) * search.sizes / balance.energy
    allowed = np.abs(equations.unmoved.T) @ (2.0 * rounding + np.abs(at.residual[: system.n_q]))

    def held(step: Array) -> bool:
        trial = search.tried(at, step)
        trial = trial and search.tried(trial, equations.step(trial.residual))
        return trial is not None and bool(np.all(np.abs(equations.unmoved.T @ trial.residual[: system.n_q]) <= allowed))

    reached = 0.0
    for distance in np.geomspace(*TOLERANCES.spread_searched):
        if held(distance * ahead) or held(-distance * ahead):
            reached = float(distance)
    return reached if reached < TOLERANCES.spread_searched[1] else 0.0


def _continues(search: Search, at: State, vector: Array) -> bool:
    """Return whether there are solutions at some distance along a direction."""
    distance = 0.02 / float(np.max(np.abs(vector)))
    step = np.concatenate([distance * vector, np.zeros(len(search.balance.free))])
    trial = search.tried(at, step)
    for _ in range(20):
        if trial is None:
            return False
        if trial.size < 1e-10:
            moved = (trial.q - at.q)[search.balance.open] / search.sizes[search.balance.open]
            return bool(abs(moved @ vector) > 0.5 * distance)
        G, moving = search.balance.jacobian(trial), search.balance.moving
        G = np.vstack([G, np.concatenate([vector, np.zeros(G.shape[1] - len(vector))])])
        trial = search.tried(trial, newton_step(G, np.append(trial.residual, 0.0), moving, 0.0))
    return False


def _pose(system: System, q: Array) -> Array:
    """Return positions and orientations, which do not depend on the choice of angles."""
    d = system.scene.dimension
    parts: list[Array] = []
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        angles = q[part.start + d : part.stop]
        parts.append(q[part.start : part.start + d])
        if body.orientation:
            turned = orientation(body, angles) if d == 3 else np.array([np.cos(angles[0]), np.sin(angles[0])])
            parts.append(turned.ravel())
    return np.concatenate(parts)


def _signature(system: System, found: Equilibrium) -> Array:
    """Return numbers that symmetries do not change: sizes of reactions, and eigenvalues of the reduced stiffness."""
    motion = found.motion
    found_in = matrices_in(system, motion, found.steady)
    spaces, scale = motion.spaces, motion.spaces.scale
    full = found_in.K * scale * scale[:, None]
    mass = spaces.N.T @ (found_in.M * scale * scale[:, None]) @ spaces.N
    values = np.linalg.eigvals(np.linalg.pinv(mass) @ spaces.N.T @ full @ spaces.N)
    loads = [float(np.linalg.norm(r.force)) for r in found.reactions]
    return np.concatenate([np.sort(values.real), np.sort(np.abs(values.imag)), loads])
