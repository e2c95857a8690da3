"""Stability by energy: a function that never increases, and its second variation at the reference.

In the co-moving frame, with disturbances z, the second variation of E − p_X is
H = żᵀM ż + zᵀK z (M and K of `mbstab.analysis.linear.linearize`). Where it is definite the motion is
stable, up to the symmetries, at the given momenta (Lagrange and Dirichlet at rest; Routh 1877;
Simo, Lewis, Marsden 1991; Patrick 1992; Ortega and Ratiu 1999 for all nearby momenta); eigenvalues
on the imaginary axis cannot decide this. Where a rotation does not move the reference (a top that
stands upright turns about the vertical and about its own axis alike), a multiple of its momentum may
be added: the co-moving frame is not unique.

Stability that needs such a multiple, or a maximum, is gyroscopic: damping destroys it (Thomson and
Tait 1879; Chetaev 1961; Zajac 1964). Modes with energy of opposite sign may destroy it in resonance
(Cherry 1925; Markeev 1978).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import least_squares
from mbstab.analysis.algebra.rank import Rank
from mbstab.analysis.algebra.sparse import dense, scaled
from mbstab.analysis.algebra.stacks import beside, complement, frobenius, transposed, unit
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.reference.coefficients import Matrices, matrices_in
from mbstab.analysis.reference.steady import Generator
from mbstab.analysis.verdict.directions import Deflated, Ranks, at_given_momenta, not_driven
from mbstab.analysis.verdict.growth import all_linear
from mbstab.analysis.verdict.neutral import Separated, Structure
from mbstab.analysis.verdict.rule import Minimum
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.wording import phrases
from mbstab.compiler.system import Array
from mbstab.model.schema import is_angle

if TYPE_CHECKING:
    import numpy.typing as npt

RATIOS = ((1, 1), (1, 2), (1, 3))
"""Ratios of frequencies at which modes of opposite energy may excite each other."""


def frame_rates(S: Array) -> Array:
    """Return one rate (rad/s) for each range of rates in which the energy of all frames is definite or of none.

    In a frame that turns at the rate Ω about an axis which the motion does not notice, frequencies ω of the motion are
    ω ± Ω, and the form that is left, linear in Ω, changes its inertia only where one of them is zero. Where it is
    definite at all, it is so between two neighbouring frequencies (pairs of forms: Stewart and Sun 1990, section VI.1).

    Parameters
    ----------
    S : ndarray, shape (..., n, n)
        The matrix of the disturbances (1/s).

    Returns
    -------
    ndarray, shape (..., n + 1)
    """
    ends = np.sort(np.linalg.eigvals(S).imag, axis=-1)
    inside = 0.5 * (ends[..., 1:] + ends[..., :-1])
    result: Array = np.concatenate([2.0 * ends[..., :1], inside, 2.0 * ends[..., -1:]], axis=-1)
    return result


class SecondVariation:
    """The second variation of the energy in the co-moving frame.

    Parameters
    ----------
    structure : Structure
    separated : Separated
    """

    def __init__(self, structure: Structure, separated: Separated) -> None:
        self.structure, self.separated = structure, separated
        self.linear = structure.linear
        self.moving = bool(np.any(self.linear.motion.u))
        self._ranks = Ranks()

    # --- the form -----------------------------------------------------------------------------------------------------

    @cached_property
    def H(self) -> Array:
        """The second variation, shape (n, n)."""
        return self.structure.at.second_variation()

    @cached_property
    def known_to(self) -> Array:
        """Bound of the error of each entry of H, shape (n, n): of its evaluation, and of the numbers of the file."""
        linear, known = self.linear, roundings(self.linear)
        basis = linear.spaces.scale[:, None] * linear.spaces.N
        N, n, rates = np.abs(basis), basis.shape[1], np.abs(self.structure.at.rates)
        errors = Matrices(*(dense(np.nan_to_num(x, nan=np.inf)) for x in known.errors))
        evaluated = TOLERANCES.roundings_of_variation * EPS
        mass, stiffness = (
            N.T @ (evaluated * dense(terms) + error) @ N + _both(self._beside(dense(form), errors.J, basis))
            for form, terms, error in (
                (linear.M, linear.terms.M, errors.M),
                (linear.K, linear.terms.K, errors.K),
            )
        )
        result = rates.T @ mass @ rates + _both(self._carried(errors, basis))
        result[:n, :n] += 0.5 * (stiffness + stiffness.T)
        for changes in known.displaced:
            result[:n, :n] += np.abs(basis.T @ changes.K @ basis)
        bound: Array = np.nan_to_num(result, nan=np.inf)
        return bound

    def _beside(self, form: Array, error: Array, basis: Array) -> Array:
        """Return what a form takes from motions across the rows, shape (n_ξ, n_ξ).

        Rows that are known to δJ allow motions that differ by J⁺ δJ N, to first order.
        """
        spaces, n_h = self.linear.spaces, self.linear.n_h
        reactions = spaces.C.pseudo_inverse.T @ (spaces.scale[:, None] * (form.T @ basis))
        across: Array = np.abs(reactions).T @ (spaces.row_scale[:n_h, None] * (error[:n_h] @ np.abs(basis)))
        return across

    def _carried(self, errors: Matrices, basis: Array) -> Array:
        """Return what the kinetic energy takes from speeds across the rows on speeds, shape (n, n)."""
        spaces, n_h, N, rates = self.linear.spaces, self.linear.n_h, np.abs(basis), self.structure.at.rates
        rows = errors.J[n_h:] @ N @ np.abs(rates)
        rows[:, : N.shape[1]] += errors.D_q @ N
        weights = spaces.W.pseudo_inverse.T @ (basis.T @ dense(self.linear.M) @ basis @ rates)
        across: Array = np.abs(weights).T @ (spaces.row_scale[n_h:, None] * rows)
        return across

    @cached_property
    def applies(self) -> bool:
        """Whether the function never increases, and its first variation vanishes."""
        structure, motion, linear = self.structure, self.linear.motion, self.linear
        if not (structure.work.decreases or (self.following.size and structure.work.decreases_beside_states)):
            return False
        if not self._splits():
            return False
        # Rows on speeds must not need reactions along the motions that they forbid.
        spaces = linear.spaces
        across = spaces.N.T @ (spaces.scale * (linear.J[linear.n_h :].T @ linear.nu[linear.n_h :]))
        load = motion.dynamics.F0 + motion.dynamics.M @ motion.a
        forces = float(np.max(np.abs(load * spaces.scale), initial=0.0))
        return bool(np.max(np.abs(across), initial=0.0) <= TOLERANCES.force_across_rows * forces)

    @cached_property
    def following(self) -> Array:
        """Disturbances of states that only follow the others, and decay but for symmetries; there may be none.

        Where the others stay near the reference, so do these, up to symmetries (Vidyasagar 1980): the energy need not
        contain them.
        """
        linear, spaces, n = self.linear, self.linear.spaces, len(self.separated.S)
        states = linear.system.following
        nothing = np.zeros((n, 0))
        if not states or self.moving or linear.massless is not None or linear.system.sparse:
            return nothing
        columns, S = self.structure.at.followers(states), self.separated.S
        inverse = np.linalg.pinv(columns)
        evaluated = TOLERANCES.roundings_of_variation * EPS
        known = evaluated * np.abs(inverse) @ np.abs(S) @ np.abs(columns)
        scale = spaces.scale[states]
        rows = evaluated * linear.entries.D_q + np.nan_to_num(roundings(linear).errors.D_q, nan=np.inf)
        error = float(np.linalg.norm(known, 2)) + float(np.max(rows[:, states] * scale)) / float(np.min(scale))
        left = complement(self._explained)
        return columns if decays(left.T @ inverse @ S @ columns @ left, error) else nothing

    @cached_property
    def linear_equations(self) -> bool:
        """Whether the equations of a scene with symmetries are linear: no motion drives others along these."""
        return bool(self.separated.neutral.symmetries) and all_linear(self.structure)

    @cached_property
    def constant(self) -> list[int]:
        """Which of the states that only follow are constant, and neutral directions, where the equations are linear.

        Others of a family may be driven: z' = w, w' = x of x' = 0 goes on like t².
        """
        linear, T = self.linear, self.separated.T
        rows = dict(zip(*(x.tolist() for x in linear.system.states), strict=True))
        own = [rows[i] for i in linear.system.following]
        columns = unit(self.structure.at.followers(linear.system.following))
        apart = np.linalg.norm(columns - T @ (T.T @ columns), axis=0)
        found = [
            k
            for k, row in enumerate(own)
            if not np.any(linear.D_q[row - linear.n_h])
            and np.count_nonzero(linear.J[row]) == 1
            and apart[k] <= TOLERANCES.direction_closure
        ]
        return found if found and self.linear_equations else []

    @cached_property
    def _explained(self) -> Array:
        """Symmetries and constants among the disturbances of states that only follow, as orthonormal parts of these."""
        at, symmetries = self.structure.at, self.structure.invariance.symmetries
        followers = at.followers(self.linear.system.following)
        return not_driven(followers, unit(at.of_symmetries(symmetries)), self.constant, self._ranks)

    @property
    def beside(self) -> str:
        """Which states the energy need not contain, in words; empty: none."""
        if not self.following.size:
            return ""
        names = [f"state {self.linear.names[i]}" for i in self.linear.system.following]
        return f" of what {phrases(names)} only follow{'s' if len(names) == 1 else ''}"

    def _splits(self) -> bool:
        """Whether translations that rotate with the frame decouple, because a common speed changes nothing."""
        generator, invariance = self.linear.generator, self.structure.invariance
        if generator is None or not generator.turns:
            return True
        boosts = [item.name for item in invariance.boosts]
        return all(
            item.name in boosts or np.linalg.norm(generator.frame(self.linear.motion.q)[0] @ item.direction) < 1e-9
            for item in invariance.symmetries
            if item.of.shift is not None and np.any(item.of.shift[~self._angles()])
        )

    @property
    def ranks(self) -> Mapping[str, int]:
        """Decisions about the basis, as of `mbstab.analysis.verdict.directions.Ranks`."""
        return self._ranks.known if self.basis.size else {}

    @cached_property
    def basis(self) -> Array:
        """Disturbances at the given momenta, modulo symmetries, as orthonormal columns."""
        at, invariance, ranks = self.structure.at, self.structure.invariance, self._ranks
        columns = at.of_symmetries(invariance.symmetries)
        if self.moving:
            return at_given_momenta(columns, at.of_momenta(invariance.momenta), ranks)
        # Neighbouring rests without a symmetry are kept: along them the energy has no minimum.
        return at_given_momenta(beside(at.still(columns), self.following), columns.T[:0], ranks)

    def definite(self) -> int:
        """Return 1 if H is positive definite, −1 if negative definite, beyond rounding; 0 if neither, or on nothing."""
        if self.linear.system.sparse:
            return self._definite_in_large()
        return sign_of(self.on(self.basis)) if self.basis.size else 0

    def on(self, W: Array) -> Array:
        """Return the numbers of positive, negative and doubtful directions of the form on the span of columns."""
        return restricted(self.H, self.known_to, W)

    def _definite_in_large(self) -> int:
        """Return 1 if the stiffness is positive on all motions that are allowed, apart from symmetries; 0 if unknown.

        So it is at rest and without rows on speeds; that these motions carry mass is known.
        """
        from scipy.sparse import csr_array, vstack

        from mbstab.analysis.algebra.inertia import ConstrainedForms

        linear, spaces = self.linear, self.linear.spaces
        assert not isinstance(spaces.C, Rank)
        known, symmetries = roundings(linear), self.structure.invariance.symmetries
        of_K, of_J = known.errors.K + TOLERANCES.roundings_of_variation * EPS * abs(linear.K), known.errors.J
        for change in known.displaced:
            of_K, of_J = of_K + abs(change.K), of_J + abs(change.J)
        J, kept = spaces.C.J, spaces.C.kept
        rows, of_rows = (x[kept] for x in (J, scaled(of_J, spaces.scale, spaces.row_scale) + 2.0 * EPS * abs(J)))
        if symmetries:
            basis = np.linalg.qr(np.array([x.direction / spaces.scale for x in symmetries]).T)[0]
            further = csr_array(np.where(np.abs(basis) > EPS, basis, 0.0).T)
            rows, of_rows = (vstack(x, format="csr") for x in ((rows, further), (of_rows, 4.0 * EPS * abs(further))))
        K, error = (scaled(x, spaces.scale, spaces.scale) for x in (linear.K, of_K))
        forms = ConstrainedForms(rows, of_rows)
        return int(forms.negatives(0.5 * (K + K.T), error) == 0)

    # --- what it says -------------------------------------------------------------------------------------------------

    def minimum(self) -> Minimum | None:
        """Return the result of the energy criterion, or None if it decides nothing."""
        if not self.applies:
            return None
        turning = self.linear.generator is not None and self.linear.generator.turns
        name = "the energy in the frame of the motion" if turning or self.moving else "the energy"
        name += self.beside
        sign = self.definite()
        if sign < 0 and not self.structure.work.conserved:
            sign = 0
        if sign:
            whole = not self.moving and not self.separated.neutral.count
            whole = whole or (self.moving and not self.structure.invariance.symmetries)
            return Minimum(name, True, whole, "maximum" if sign < 0 else "minimum", linear=self.linear_equations)
        if self.structure.work.conserved and self._with_a_multiple():
            return Minimum(name, True, False, "with a multiple")
        return None

    def _with_a_multiple(self) -> bool:
        """Return whether H is definite in another frame in which the reference is at rest too."""
        steps = self.idle_turns() if self.moving else []
        if not steps:
            return False
        rates = frame_rates(self.separated.A).tolist()
        return any(self._definite_in(step, rate) for step in steps for rate in rates)

    def _angles(self) -> npt.NDArray[np.bool_]:
        return np.array([is_angle(name) for name in self.linear.names])

    def idle_turns(self) -> list[Generator]:
        """Return rotations about the axis of the frame that do not move the reference, with spins that undo them."""
        invariance, motion, own = self.structure.invariance, self.linear.motion, self.linear.generator
        spins = [field.shift for _, field in invariance.fields if field.shift is not None]
        found = []
        for _, field in invariance.fields:
            generator = field.generator
            if generator is None or not generator.turns or not spins:
                continue
            Y, columns = field.field(motion.q), np.array(spins).T
            c = least_squares(columns, Y, rcond=1e-12)
            undone = columns @ c
            if np.max(np.abs(Y - undone) / motion.sizes) < 1e-9 and np.any(undone) and invariance.conserves(field):
                found.append(replace(generator, spins=generator.spins - undone))
        return [
            x
            for x in found
            if own is None
            or not own.turns
            or max(np.linalg.norm(own.axis - x.axis), np.linalg.norm(own.point - x.point)) <= 1e-9
        ]

    def _definite_in(self, step: Generator, rate: float) -> bool:
        """Return whether H is positive definite in a frame that turns faster about an axis."""
        own, faster = self.linear.generator, replace(step, rate=rate, spins=step.spins * rate)
        if own is not None:
            faster = replace(faster, rate=own.rate + rate, velocity=own.velocity, spins=own.spins + faster.spins)
        other = self._seen_from(faster)
        return sign_of(other.on(other.basis)) > 0

    def _seen_from(self, generator: Generator) -> SecondVariation:
        """Return the second variation in another frame."""
        structure, linear, space = self.structure, self.linear, self.structure.space
        matrices = matrices_in(linear.system, linear.motion, generator)
        other: Linearization = replace(
            linear, M=matrices.M, R=matrices.R, K=matrices.K, D_q=matrices.D_q, generator=generator
        )
        at = Deflated.of(other, space, float(structure.at.gamma))
        return SecondVariation(Structure(other, space, at, structure.invariance), self.separated)

    # --- warnings -----------------------------------------------------------------------------------------------------

    def warnings(self) -> tuple[str, ...]:
        """Return what may destroy stability that rests on gyroscopic terms or on reversibility."""
        if not self.structure.work.conserved:
            return self._resonances(signed=False)
        W = self.basis
        if self.linear.D_q.shape[0] or not W.shape[1]:
            return ()
        negative = negative_directions(W.T @ self.H @ W, np.abs(W).T @ self.known_to @ np.abs(W))
        found: tuple[str, ...] = ()
        if negative:
            found = (
                "stable by gyroscopic effect only: any damping inside the system that reaches all its motions makes it "
                f"unstable ({negative} direction{'s' if negative > 1 else ''} of negative energy)",
            )
        return found + self._resonances(signed=True)

    def _resonances(self, signed: bool) -> tuple[str, ...]:
        """Return pairs of modes that may excite each other: frequencies in a low ratio, energies of opposite sign.

        Without a conserved energy (`signed` false) the ratio alone is told.
        """
        found = self.separated
        values, vectors = np.linalg.eig(found.A)
        largest = float(np.max(np.abs(values), initial=0.0))
        modes = []
        for s, w in zip(values, (found.B @ vectors).T, strict=True):
            if s.imag > 1e-9 * largest and abs(s.real) < 1e-9 * largest:
                modes.append((float(s.imag), float(np.sign((w.conj() @ self.H @ w).real)) if signed else 0.0))
        texts = []
        for i, (one, sign) in enumerate(modes):
            for other, second in modes[i + 1 :]:
                slow, fast = sorted((one, other))
                for p, q in RATIOS:
                    off = abs(fast * p - slow * q)
                    if (sign * second < 0.0 or not signed) and off <= TOLERANCES.resonance_misfit * fast:
                        why = " and belong to modes with energies of opposite sign" if signed else ""
                        texts.append(
                            f"the frequencies {slow:.6g} and {fast:.6g} 1/s are as {p} to {q}{why}: resonance may "
                            "destroy stability"
                        )
        return tuple(texts)


def decays(A: Array, error: float) -> bool:
    """Return whether all matrices within an error of A, in the spectral norm, have their eigenvalues left of the axis.

    P with Aᵀ P + P A = −1 is positive definite then, and remains a function of Lyapunov while 2 |P| error < 1.
    """
    from scipy.linalg import solve_continuous_lyapunov

    if not len(A):
        return True
    if not np.max(np.linalg.eigvals(A).real) < -error:
        return False
    P = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
    left = A.T @ P + P @ A
    rounding = 2.0 * float(np.linalg.norm(P, 2)) * error
    return bool(
        np.all(np.isfinite(P))
        and np.linalg.eigvalsh(0.5 * (P + P.T))[0] > 0.0
        and np.linalg.eigvalsh(0.5 * (left + left.T))[-1] + rounding < 0.0
    )


def _both(change: Array) -> Array:
    """Return the sum of a change of one factor of a form and of that of the other."""
    return change + change.T


def inertia(H: Array, known: Array) -> Array:
    """Return numbers of positive, negative and doubtful directions of symmetric matrices, shape (…, 3).

    Parameters
    ----------
    H : ndarray, shape (…, m, m)
    known : ndarray, shape (…, m, m)
        Bound of the error of each entry; inf where there is none.
    """
    m = H.shape[-1]
    if not m:
        return np.zeros((*H.shape[:-2], 3), dtype=int)
    # Scaled by the diagonal, so that large stiffness does not hide soft directions (Demmel and Veselić 1992). Entries
    # that may be zero are left small, so that they hide nothing either.
    own, open_ = (np.diagonal(x, axis1=-2, axis2=-1) for x in (np.abs(H), known))
    diagonal = np.where(own > 10.0 * open_, own, np.max(np.maximum(own, open_), axis=-1, keepdims=True))
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
    both = scale[..., :, None] * scale[..., None, :]
    values = np.linalg.eigvalsh(0.5 * (H + transposed(H)) * both)
    with np.errstate(invalid="ignore"):
        error = known * both
    # No eigenvalue moves by more than the norm of the error: neither than its size, nor than its largest sum of a row.
    least = np.minimum(frobenius(error), np.max(np.sum(error, axis=-1), axis=-1)) + m * EPS * np.max(
        np.abs(values), axis=-1
    )
    positive, negative = (np.sum(x > least[..., None], axis=-1) for x in (values, -values))
    return np.stack([positive, negative, m - positive - negative], axis=-1)


def restricted(H: Array, known: Array, W: Array) -> Array:
    """Return the inertia of forms, given with the bounds of their errors, on the spans of columns."""
    with np.errstate(invalid="ignore"):
        return inertia(transposed(W) @ H @ W, transposed(np.abs(W)) @ known @ np.abs(W))


def sign_of(counts: Array) -> int:
    """Return 1 or −1 for a form that is positive or negative definite by its inertia, 0 for others."""
    positive, negative, doubtful = counts.tolist()
    if doubtful or (positive and negative):
        return 0
    return -1 if negative else 1


def negative_directions(h: Array, known_to: Array) -> int:
    """Return the dimension of a space on which a matrix is negative definite whatever its rounding errors are."""
    diagonal = np.abs(np.diag(h))
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(h * scale * scale[:, None])
    vectors = scale[:, None] * vectors
    error = np.sum(np.abs(vectors) * (known_to @ np.abs(vectors)), axis=0)
    sure = vectors[:, values < -error]
    known = bool(sure.size) and sign_of(restricted(h, known_to, sure)) < 0
    return sure.shape[1] if known else 0
