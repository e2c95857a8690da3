"""A state of the reference motion: assembled from the file, checked, with accelerations and multipliers.

Missing coordinates are solved from C(q, t) = 0 and missing rates from the velocity rows;
given ones are checked. Then

    M a + Jᵀ ν = −F0,   J a = −B

gives the accelerations and the multipliers. Which motion the file asks for is decided in
`mbstab.analysis.reference.requested`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from mbstab.analysis.algebra.arrays import others
from mbstab.analysis.algebra.augmented import Augmented, mobility, sparse_mobility
from mbstab.analysis.algebra.rank import Rank, rank_of
from mbstab.analysis.algebra.sparse import dense, identity, largest, scaled, sizes_times
from mbstab.analysis.algebra.stacks import times, transposed
from mbstab.analysis.algebra.subspaces import Redundancy, Subspaces, fewest, redundancies, subspaces
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.reference.assembly import assembled, not_satisfied, unclosed
from mbstab.analysis.reference.imbalance import (
    balanced_at,
    carrying,
    require_compatible,
    rounding_of_accelerations,
    state_rounding,
)
from mbstab.analysis.reference.read_speeds import misread
from mbstab.analysis.reference.refusals import (
    inertias_too_far_apart,
    redundant_rows,
    require_constant_rank,
    turns_and_degrees,
    vanishing_rows,
)
from mbstab.analysis.reference.speeds import on_rows
from mbstab.analysis.reference.state_units import balanced_states, characteristic_sizes
from mbstab.analysis.reference.steady import Family, Generator, not_round, off_axis
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.errors import ConstraintError, MassError, ModelFileError, Problem, amount
from mbstab.model.doubts import doubts
from mbstab.model.schema import is_length, is_state
from mbstab.model.units import per_second
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclass(frozen=True)
class Motion:
    """The reference motion at an instant; over the points of a sweep arrays have a first axis for these.

    Attributes
    ----------
    q, u, a : ndarray, shape (n_q,)
        Coordinates (m, rad), speeds, accelerations.
    nu : ndarray, shape (n_c,)
        Multipliers [λ; μ]; of minimum norm where constraints are redundant.
    time : float (s)
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate: the size of the scene (m), or 1 rad.
    dynamics : Dynamics
        Matrices at this state.
    spaces : Subspaces
    augmented : Augmented
        Of the matrices in scaled coordinates and rows.
    redundant : list of Redundancy
    solved : tuple of str
        Coordinates and rates that the file leaves to the program.
    warnings : tuple of str
    generators : tuple of Generator
        Symmetries that the motion may follow, the simplest first.
    declared : bool
        Whether the file says that the motion is steady.
    massless : ndarray, shape (n_q, k), or None
        Orthonormal motions in scaled coordinates that the constraints allow and that carry no mass; None: there are
        none. Their accelerations are not known: zero.
    sharpened : bool
        Whether coordinates and rates that were solved for are right to their rounding.
    spread : ndarray, shape (n_q,), or None
        How far coordinates that were solved for may be from a multiple solution (m, rad); None: the solution is simple.
    """

    q: Array
    u: Array
    a: Array
    nu: Array
    time: float
    sizes: Array
    dynamics: Dynamics
    spaces: Subspaces
    augmented: Augmented
    redundant: list[Redundancy]
    solved: tuple[str, ...]
    warnings: tuple[str, ...]
    generators: tuple[Generator, ...] = ()
    declared: bool = False
    massless: Array | None = None
    sharpened: bool = False
    spread: Array | None = None

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves at this instant."""
        return not np.any(self.u)

    def scaled(self, spaces: Subspaces) -> Motion:
        """Return the same motion with coordinates and rows in other scales; all that is allowed carries mass."""
        scale, row_scale, allowed = spaces.scale, spaces.row_scale, spaces.allowed
        M, J = scaled(self.dynamics.M, scale, scale), scaled(self.dynamics.J, scale, row_scale)
        augmented = Augmented(M, J, spaces.inverse(J), mobility(allowed.T @ M @ allowed, allowed, None))
        return replace(self, spaces=spaces, augmented=augmented)

    def balancing(self, force: Any) -> Any:
        """Return the minimum-norm multipliers, shape (…, n_c), that balance forces best, shape (…, n_q)."""
        return -times(transposed(self.augmented.inverse), force * self.spaces.scale) * self.spaces.row_scale

    def balancing_sizes(self, forces: Array) -> Array:
        """Return bounds of the multipliers that balance forces which are known by their sizes."""
        return sizes_times(transposed(self.augmented.inverse), forces * self.spaces.scale) * self.spaces.row_scale


def motion_at(system: System, q: Array, u: Array, time: float, massless: bool = False) -> Motion:
    """Return accelerations and multipliers of a state that satisfies the constraints."""
    return Finder(system, massless).motion(q, u, time)


class Finder:
    """Assembles states of a scene from its file, and reports what does not fit.

    Attributes
    ----------
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    solved, warnings : list of str
    massless : bool
        Whether motions without mass are allowed; refused otherwise.
    """

    def __init__(self, system: System, massless: bool = False) -> None:
        self.system, self.massless = system, massless
        self.scene = system.scene
        self.document = system.scene.model.document
        self.is_length: npt.NDArray[np.bool_] = np.array([is_length(name) for name in system.names])
        self.sizes: Array = system.remember("sizes", None, lambda: characteristic_sizes(system, self.start()[0]))
        self.solved: list[str] = []
        self.warnings: list[str] = [
            f"the Euler angles that are given for {name!r} are singular: phi, theta and psi count from the orientation "
            "that they give, as if it were written as axes: [phi, theta, psi]"
            for name in self.scene.turned
        ]
        self.warnings += [item.text for item in self.scene.model.left_out]

    def _fail(self, problems: list[Problem]) -> None:
        if problems:
            raise ModelFileError(problems)

    # --- position ---------------------------------------------------------------------------------------------------

    def start(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return given and guessed coordinates, and which of them are not given, shape (n_q,)."""
        system, scene = self.system, self.scene
        q = np.array([scene.coordinates.get(n, scene.guess.get(n, 0.0)) for n in system.names], dtype=float)
        return q, np.array([n not in scene.coordinates for n in system.names])

    def coordinates(self) -> Array:
        """Return coordinates that satisfy the constraints, the given ones unchanged.

        Raises
        ------
        ModelFileError
            If they do not satisfy the constraints, or are at a singular orientation.
        """
        system = self.system
        q, missing = self.start()
        self.check_chart(q, missing)
        if missing.any() and system.n_h:
            q = self.assemble(q, missing)
            self.check_chart(q, np.zeros(len(q), dtype=bool))
        self.solved += [n for n, lacks in zip(system.names, missing, strict=True) if lacks]
        self._fail(unclosed(system, self.sizes, q, missing))
        return q

    def _held_controls(self, spaces: Subspaces) -> list[str]:
        """Return warnings about controllers and motors that act on a coordinate which no allowed motion changes."""
        if self.system.sparse:
            return []
        held = np.linalg.norm(spaces.N, axis=1) <= TOLERANCES.coordinate_held
        names = {name for name, still in zip(self.system.names, held, strict=True) if still}
        return [
            f"{item.entry.path} acts on {name}, which the constraints hold: its effort only changes reactions"
            for item in self.scene.items
            if item.kind.part is not None
            for name in item.entry.equations
            if name in names
        ]

    def check_chart(self, q: Array, skip: npt.NDArray[np.bool_]) -> None:
        """Refuse Euler angles near their singularity, cos θ = 0, and warn before digits are lost."""
        problems = []
        for body, part in zip(self.scene.bodies, self.system.body_slices, strict=True):
            if len(body.coordinates) != 6 or skip[part.start + 4]:
                continue
            distance = abs(math.cos(q[part.start + 4]))
            hint = (
                "give the body another base rotation with axes: [phi, theta, psi], so that theta stays away from ±pi/2"
            )
            if distance < TOLERANCES.euler_cosine_refused:
                message = f"the Euler angles of {body.name!r} are singular here: |cos theta| = {amount(distance)}"
                problems.append(self.document.problem(body.location, f"bodies.{body.name}", message, hint))
            elif distance < TOLERANCES.euler_cosine_warned:
                self.warnings.append(
                    f"the Euler angles of body {body.name!r} are close to singular: "
                    f"|cos theta| = {amount(distance)}; {hint}"
                )
        self._fail(problems)

    def assemble(self, q: Array, missing: npt.NDArray[np.bool_]) -> Array:
        """Solve C = 0 for the missing coordinates: damped Gauss-Newton steps of minimum norm."""
        return assembled(self.system, self.sizes, q, missing)

    # --- velocity ---------------------------------------------------------------------------------------------------

    def rates(self, q: Array) -> tuple[Array, Dynamics]:
        """Return rates that satisfy the constraints, the given ones unchanged, and the matrices there.

        Raises
        ------
        ModelFileError
            If they do not satisfy the constraints, or leave a choice that changes the motion.
        """
        system, scene = self.system, self.scene
        u = np.array([scene.rates.get(n, 0.0) for n in system.names], dtype=float)
        missing = np.array([n not in scene.rates for n in system.names])
        states, sizes = system.states[0], self.sizes
        columns = others(len(u), np.concatenate([np.flatnonzero(~missing), states]))
        basis = np.diag(sizes)[:, columns]
        x, slope = on_rows(system.bodily, q, u, basis, sizes, (columns[:0], u[:0]), scene.time)
        u = u + basis @ x
        if np.any(missing[states]):
            u = system.with_state_rates(q, u, scene.time)
        state = system.dynamics(q, u, scene.time)
        # Rounding errors of the solution are set to zero.
        fastest = float(np.max(np.abs(u / sizes), initial=0.0))
        noise = missing & (np.abs(u / sizes) < 1e-14 * fastest)
        noise[states] |= missing[states] & (np.abs(u[states]) <= self._rounding(q, u)[system.states[1]])
        if np.any(u[noise]):
            u[noise] = 0.0
            state = system.dynamics(q, u, scene.time)
        self._check_rates(q, u, state)
        if np.any(u):
            self._check_determined(slope, columns, u / sizes)
        self.solved += [f"rate of {system.names[i]}" for i in np.flatnonzero(missing) if u[i]]
        return u, state

    def _rounding(self, q: Array, u: Array) -> Array:
        """Return what rounding makes of the rates of states; of coordinates that are solved for, that of the scene."""
        system, time = self.system, self.scene.time
        found, rows = state_rounding(system, q, u, time), system.states[1]
        solved = np.isin(system.names, self.solved)
        if len(rows) and np.any(solved):
            V_q = dense(system.linearize_rows(q, u, 0.0 * u, time)[0])[rows]
            found[rows] += TOLERANCES.coordinate_rounding * (np.abs(V_q) @ (self.sizes * solved))
        return found

    def _check_rates(self, q: Array, u: Array, state: Dynamics, steady: Generator | None = None) -> None:
        """Refuse rates that do not satisfy the constraints; `steady` is the motion that they follow from."""
        system = self.system
        fastest = float(np.max(np.abs(u / self.sizes), initial=0.0))
        allowed = TOLERANCES.residual * abs(state.J) @ (self.sizes * fastest) + self._rounding(q, u)
        bad = [i for i in range(system.n_c) if not abs(state.V[i]) <= allowed[i] + 1e-300]
        if bad:
            allowed = allowed + TOLERANCES.coordinate_rounding * carrying(system, (q, u), self.scene.time, self.sizes)
            bad = [i for i in bad if not abs(state.V[i]) <= allowed[i]]
        hint = "correct the rates, or leave out those that the constraints determine"
        hints = [hint if steady is None else off_axis(system, i, steady) or hint for i in bad]
        self._fail(
            [
                not_satisfied(system, i, state.V[i], hint, per="/s" if i < system.n_h else "")
                for i, hint in zip(bad, hints, strict=True)
            ]
        )

    def _check_determined(self, J: Array, columns: npt.NDArray[np.intp], speeds: Array) -> None:
        """Refuse rates that were left out although the constraints leave a choice that changes the motion."""
        lengths = np.linalg.norm(J, axis=1)
        null = rank_of(J[lengths > 0.0] / lengths[lengths > 0.0, None]).null
        free = np.linalg.norm(null, axis=1) > TOLERANCES.residual
        moving = np.abs(speeds[columns]) > TOLERANCES.residual * np.max(np.abs(speeds), initial=0.0)
        if np.any(free & moving):
            names = [self.system.names[i] for i in columns]
            few = fewest(null, [name.partition(".")[0] for name in names])
            listed = ", ".join(names[i] for i in few)
            message = f"the constraints do not determine all rates: {listed} {'is' if len(few) == 1 else 'are'} missing"
            hint = f"give {listed} under reference.rates, 0 for what does not move; the others follow"
            self._fail([self._at_reference(message, hint)])

    def _at_reference(self, message: str, hint: str) -> Problem:
        return self.document.problem(self.scene.model.reference.location, "reference", message, hint)

    def steady_rates(self, q: Array, family: Family, known: dict[int, float]) -> tuple[Generator, Dynamics]:
        """Return the generator of a family whose speeds satisfy the constraints and given rates, and the matrices.

        Parameters
        ----------
        q : ndarray, shape (n_q,)
        family : Family
        known : dict
            Coefficients that are given, by number.

        Raises
        ------
        ModelFileError
            If there is none, or if a coefficient is undetermined.
        """
        system, scene = self.system, self.scene
        given = np.array([i for i, name in enumerate(system.names) if name in scene.rates], dtype=np.intp)
        rates = np.array([scene.rates[system.names[i]] for i in given], dtype=float)
        c = np.array([known.get(k, 0.0) for k in range(family.size)])
        basis, free = family.basis(q), others(family.size, list(known))
        x, slope = on_rows(system, q, basis @ c, basis[:, free], self.sizes, (given, rates), scene.time)
        c[free] += x
        if slope.shape[1]:
            rank = rank_of(slope / np.max(np.abs(slope), initial=1e-300))
            names = [family.names()[k] for k in free]
            if few := fewest(rank.null, names):
                listed = ", ".join(names[i] for i in few)
                message = f"the constraints do not determine {listed} of the steady motion"
                self._fail([self._at_reference(message, f"give {listed} under reference; 0 for what does not turn")])
        c[np.abs(c) < 1e-13 * np.max(np.abs(c), initial=0.0)] = 0.0
        generator = family.generator(c)
        u = generator.field(q)
        fastest = float(np.max(np.abs(u / self.sizes), initial=0.0))
        problems = []
        for i, rate in zip(given, rates, strict=True):
            if abs(u[i] - rate) > TOLERANCES.residual * self.sizes[i] * max(fastest, abs(rate) / self.sizes[i]):
                unit = per_second(self.system.units[i])
                message = f"the rate of {system.names[i]} is given as {rate:.6g} {unit}, "
                message += f"the steady motion ({generator}) has {u[i]:.6g} {unit}"
                hint = not_round(system, i) or "leave it out, or correct reference.steady"
                problems.append(self._at_reference(message, hint))
        self._fail(problems)
        state = system.dynamics(q, u, scene.time)
        self._check_rates(q, u, state, generator)
        return generator, state

    # --- accelerations and multipliers ------------------------------------------------------------------------------

    def motion(
        self,
        q: Array,
        u: Array,
        time: float | None = None,
        steady: Generator | None = None,
        declared: bool = False,
        state: Dynamics | None = None,
    ) -> Motion:
        """Return the motion through a state that satisfies the constraints.

        With `steady`, its accelerations must be those of that steady motion (or zero at rest);
        `declared` tells whether the file asks for it. `state` holds the matrices there, if they are known.

        Raises
        ------
        ModelFileError
            If a steady motion or a state at rest does not persist.
        """
        system = self.system
        time = self.scene.time if time is None else time
        state = system.dynamics(q, u, time) if state is None else state
        if system.n_h:
            self._fail(vanishing_rows(system, (q, u, time), state.J, self.sizes))
        spaces, sizes = subspaces(state.M, state.J, system.n_h, system.rows, self.sizes), self.sizes
        if (units := balanced_states(system, spaces, state, (q, u, time), sizes)) is not None:
            spaces, sizes = subspaces(state.M, state.J, system.n_h, system.rows, *units), units[0]
        redundant = redundancies(state.J, spaces, system.n_h, system.rows)
        scale, row_scale = spaces.scale, spaces.row_scale
        J, M = scaled(state.J, scale, row_scale), scaled(state.M, scale, scale)
        inverse = spaces.inverse(J)
        moved, massless = self._mobility(state.M, M, spaces)
        augmented = Augmented(M, J, inverse, moved)
        force, bias = -(state.F0 * scale), state.B * row_scale
        require_compatible(system, (q, u, time), self.sizes, spaces, J, inverse, bias)
        a, nu = augmented.refined(force, bias, TOLERANCES.balance_refinements)
        self.warnings += [*self._held_controls(spaces), *self._measured(q, u, spaces)]
        if redundant:
            C = spaces.C
            require_constant_rank(
                system, (q, u, time), C.left_null,
                (lambda x: C.null @ (C.null.T @ x)) if isinstance(C, Rank) else C.rows.allowed,
                (scale, row_scale), partial(self._refuse_inertias_too_far_apart, state.M),
            )  # fmt: skip
            self.warnings += redundant_rows(redundant, max(spaces.C.largest_dropped, spaces.W.largest_dropped))
        motion = Motion(
            q, u, a * scale, nu * row_scale, time, sizes, state, spaces, augmented, redundant, tuple(self.solved),
            (*self.warnings, *misread(system, q, u), *self._resting(q, declared, steady), *doubts(system.scene.model)),
            massless=massless,
        )  # fmt: skip
        if massless is not None:
            self._check_balanced(motion)
        if steady is not None:
            expected = steady.acceleration(q)
            self._check_steady(motion, expected, steady)
            # The accelerations are known exactly; only the reactions are asked for.
            nu = augmented.multipliers(force - M @ (expected / scale), TOLERANCES.balance_refinements)
            motion = replace(motion, a=expected, nu=nu * row_scale, generators=(steady,), declared=declared)
        return motion

    def _measured(self, q: Array, u: Array, spaces: Subspaces) -> list[str]:
        """Return warnings about impossible moments that are taken as measured."""
        if not any(entry.values.get("measured") for entry in self.scene.model.bodies.values()):
            return []
        from mbstab.analysis.reference.measured_moments import measured_moments

        return measured_moments(self.system, q, u, spaces.scale[:, None] * spaces.N)

    def _resting(self, q: Array, declared: bool, steady: Generator | None) -> list[str]:
        """Return a warning with its place if a steady motion that the file declares is a rest."""
        if not declared or steady is None or not steady.turns_in_place(q):
            return []
        names, solved = self.system.names, [n for n, name in enumerate(self.system.names) if name in self.solved]
        places = [f"{names[n]} = {q[n] + 0.0:.6g} {self.system.units[n]}" for n in solved if self.is_length[n]]
        where = f" ({', '.join(places[:3])}{', …' if len(places) > 3 else ''})" if places else ""
        other = "another guess, or mbstab equilibrium --starts, may find one that moves"
        hint = other if self.scene.model.reference.find else "a place off the axis moves"
        return [
            f"the steady motion ({steady}) does not move anything here{where}: it is judged as a rest\nhint: {hint}"
        ]

    def _mobility(self, mass: Any, M: Any, spaces: Subspaces) -> tuple[Any, Array | None]:
        """Return what gives the allowed accelerations from forces, in scaled coordinates, and motions without mass."""
        C = spaces.C
        if not isinstance(C, Rank) and not len(spaces.W.left_null):
            least = TOLERANCES.massless * largest(M)
            rounding = TOLERANCES.rest_rounding * float(abs(M).sum())
            # Most mass matrices are positive by themselves, whatever the rows allow.
            dominant = bool(np.all(2.0 * M.diagonal() - np.asarray(abs(M).sum(axis=1)).ravel() > least + rounding))
            if dominant or C.forms.negatives(M - least * identity(M.shape[0]), TOLERANCES.rest_rounding * abs(M)) == 0:
                return sparse_mobility(M, C.J[C.kept]), None
        allowed = spaces.allowed
        M_z = allowed.T @ M @ allowed
        massless = self._without_mass(mass, M_z, allowed)
        return mobility(M_z, allowed, massless), massless

    def _without_mass(self, M: Any, M_z: Array, allowed: Array) -> Array | None:
        """Return the motions that the constraints allow and that carry no mass; refuse them if they are not allowed."""
        if not M_z.size:
            return None
        values = np.linalg.eigvalsh(M_z)
        # Where nothing that is allowed carries mass, M_z holds squares of rounding.
        least = max(TOLERANCES.massless * values[-1], TOLERANCES.rounding_of_mass)
        if values[0] > least:
            return None
        self._refuse_inertias_too_far_apart(M)
        values, vectors = np.linalg.eigh(M_z)
        heavy = values > least
        if self.massless and np.all(values[heavy] > ALGEBRA.rank_gap * least):
            found: Array = allowed @ vectors[:, ~heavy]
            for involved in map(self._involved, found.T):
                if all(map(is_state, involved)):
                    raise ConstraintError(
                        f"the rates of the states depend on each other too much: {', '.join(involved)} cannot be told "
                        "from the others in double precision\nhint: give the states units in which the coefficients of "
                        "rate(…) are near 1, or write what the rates stand for in their place"
                    )
            return found
        involved = self._involved(allowed @ vectors[:, 0])
        body = next(iter(dict.fromkeys(n.partition(".")[0] for n in involved if not is_state(n))), "")
        location = next((b.location for b in self.scene.bodies if b.name == body), self.scene.bodies[0].location)
        message = f"the motion of {', '.join(involved)} carries no mass, and joints and drives do not determine it"
        hint = "give the body an inertia in this direction, add a joint or a drive, or make it a point"
        if not self.massless:
            hint = (
                "springs and dampers determine such a motion only about a rest or a steady motion, in scenes that "
                f"dense matrices can hold; otherwise {hint}"
            )
        raise MassError(str(self.document.problem(location, f"bodies.{body}", message, hint)))

    def _involved(self, direction: Array) -> list[str]:
        """Return the names of the coordinates that change most along a direction."""
        size = np.abs(direction)
        return [self.system.names[i] for i in np.argsort(-size) if size[i] > 0.3 * size.max()][:4]

    def _check_balanced(self, motion: Motion) -> None:
        """Refuse forces along motions without mass, which nothing could balance."""
        assert motion.massless is not None
        scale, state = motion.spaces.scale, motion.dynamics
        force = (state.F0 + state.M @ motion.a + state.J.T @ motion.nu) * scale
        left = motion.massless @ (motion.massless.T @ force)
        if not balanced(self.system, motion, left):
            worst = int(np.argmax(np.abs(left)))
            self.refuse_unbalanced(worst, math.inf, float(-left[worst] / scale[worst]))

    def _check_steady(self, motion: Motion, expected: Array, steady: Generator) -> None:
        """Refuse a steady motion, or a state at rest, that does not persist."""
        spaces, scale, excess = motion.spaces, motion.spaces.scale, motion.a - expected
        if balanced(self.system, motion, (motion.dynamics.M @ excess) * scale):
            return
        force = motion.dynamics.F0 + motion.dynamics.M @ expected
        left = self._unheld(spaces, force * scale)
        at = motion.q, motion.u, motion.time
        off = np.abs(motion.dynamics.J @ expected + motion.dynamics.B)
        if np.all(off <= rounding_of_accelerations(self.system, at, self.sizes, np.abs(expected))) and balanced(
            self.system, motion, left
        ):
            return  # the rows alone accelerate it, by rounding
        most = np.abs(excess / scale)
        if np.any(bodily := most * ~np.isin(np.arange(len(most)), self.system.states[0])):
            most = bodily  # states follow what accelerates
        worst = int(np.argmax(most))
        name = self.system.names[worst]
        if np.linalg.norm(spaces.projected(np.eye(1, len(scale), worst)[0])) >= TOLERANCES.coordinate_rounding:
            load = -left[worst] / scale[worst]
            self.refuse_unbalanced(worst, float(excess[worst]), float(load), "" if motion.at_rest else str(steady))
        what = "is at rest at this time only" if motion.at_rest else "is steady at this time only"
        unit = per_second(self.system.units[worst], 2)
        message = f"the reference {what}: a drive accelerates {name} with {excess[worst]:.6g} {unit}"
        self._fail([self._at_reference(message, "choose a time at which the drive is steady")])

    def _unheld(self, spaces: Subspaces, forces: Array) -> Array:
        """Return the part of scaled forces that no row carries; first-order states, which follow, carry none."""
        states = self.system.states[0]
        if not len(states):
            return spaces.projected(forces)
        bodily = spaces.allowed.copy()
        bodily[states] = 0.0
        directions, s, _ = np.linalg.svd(bodily, full_matrices=False)
        directions = directions[:, s > ALGEBRA.singular_value_zero * np.max(s, initial=0.0)]
        result: Array = directions @ (directions.T @ forces)
        return result

    def refuse_unbalanced(self, worst: int, acceleration: float, load: float, steady: str = "") -> NoReturn:
        """Refuse a reference in which forces do not balance.

        Parameters
        ----------
        worst : int
            The coordinate that accelerates most.
        acceleration, load : float
            Its acceleration, and the unbalanced force or torque along it (SI).
        steady : str
            The steady motion that is expected, in words; empty: rest.
        """
        unit, push = per_second(self.system.units[worst], 2), "N" if self.is_length[worst] else "N*m"
        where = f"no steady motion ({steady})" if steady else "at rest but not in equilibrium"
        name, moves = self.system.names[worst], f"would accelerate with {acceleration:.6g} {unit}"
        if math.isinf(acceleration):
            moves = "carries no mass and would not stay"
        message = f"the reference is {where}: {name} {moves} (unbalanced {load:.6g} {push})"
        find = "steady" if steady else "equilibrium"
        hint = (
            "give coordinates at which the forces balance, or the rates of the motion you mean; "
            f"mbstab equilibrium or reference: {{find: {find}}} solves for coordinates under guess"
        )
        raise ModelFileError([self._at_reference(message, hint + turns_and_degrees(self.scene))])

    def _refuse_inertias_too_far_apart(self, M: Any) -> None:
        """Explain a failed rank decision by inertias whose ratio leaves no digits for it."""
        text = inertias_too_far_apart(self.system, M, self.sizes)
        if text:
            raise MassError(f"{self.scene.model.reference.location}: {text}")


def balanced(system: System, motion: Motion, left: Array) -> bool:
    """Return whether scaled forces that should vanish do so; see `balanced_at`."""
    at = motion.q, motion.u, motion.a, motion.nu
    return bool(balanced_at(system, at, left, motion.dynamics.F0, motion.sizes, motion.spaces.scale, motion.time))
