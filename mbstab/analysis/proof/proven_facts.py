"""The facts about a motion in balls, for the rule of `mbstab.analysis.verdict.rule`.

Neutral directions, conserved functions and the work of the elements are those that double precision
has found, if `mbstab.analysis.proof.identities` verifies them. If it does not, a strict case
leaves them out, so that the zeros that they explain remain unexplained; another case takes them for
granted and says so: "provided that rotation about z is a symmetry".

The second variation of the energy is that of `mbstab.analysis.verdict.minimum`, H = żᵀM ż + zᵀK z, apart from
symmetries and at the given momenta; it is positive definite if all pivots of its elimination are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from mbstab.analysis.algebra import ball_matrices, ball_polynomials
from mbstab.analysis.algebra.balls import Matrix, NotProvable
from mbstab.analysis.algebra.matching import together
from mbstab.analysis.proof.characteristic import (
    Enclosure,
    Factor,
    Proof,
    Quotient,
    Spectrum,
    carried_enclosures,
    enclosed,
    null_combinations,
    touch,
    zero_enclosure,
)
from mbstab.analysis.proof.fields import ground_turn, short
from mbstab.analysis.proof.identities import Finding, tiny
from mbstab.analysis.proof.motion import BallGenerator
from mbstab.analysis.reference.fields import Symmetry
from mbstab.analysis.verdict.minimum import frame_rates
from mbstab.analysis.verdict.rule import (
    STABLE,
    STABLE_UP_TO,
    UNDECIDED,
    Disc,
    Extremum,
    Facts,
    Minimum,
    Side,
    Verdict,
    judge,
    weakest,
)
from mbstab.analysis.verdict.spectrum import Evidence, Neutral
from mbstab.analysis.verdict.wording import phrases
from mbstab.model import balls
from mbstab.model.balls import Ball, ball, zero_inside

SIDES: dict[str, Side] = {"left": "left", "right": "right", "imaginary": "axis", "open": "open"}

CHECKED = "(checked in double precision)"

DOUBLE = "more than one eigenvalue may be there"


class Case:
    """What is proven about a motion, or follows from findings in double precision.

    Parameters
    ----------
    proof : Proof
    strict : bool
        Whether to leave out what is not verified in balls.

    Attributes
    ----------
    conditions : list of str
        What was taken for granted.
    left_out : bool
        Whether something was left out because it is not verified.
    """

    def __init__(self, proof: Proof, strict: bool) -> None:
        self.proof, self.strict = proof, strict
        self.identities, self.grounds = proof.identities, proof.identities.grounds
        self.conditions: list[str] = []
        self.left_out = False
        self._evidence: list[Evidence] = ["structural"]

    @cached_property
    def generic(self) -> Case:
        """The same case at a value inside the interval of a parameter."""
        point = self.identities.reference
        assert isinstance(point, Proof)
        return self if point is self.proof else Case(point, self.strict)

    def _accepts(self, finding: Finding, text: str) -> bool:
        """Whether something counts as a fact; without a proof it becomes a condition."""
        if finding == "refuted" or (finding == "open" and self.strict):
            self.left_out |= finding == "open"
            return False
        if finding == "open":
            condition = f"{text} {CHECKED}"
            if condition not in self.conditions:
                self.conditions.append(condition)
        self._evidence.append("numerical" if finding == "open" else finding)
        return True

    # --- neutral directions -------------------------------------------------------------------------------------------

    @cached_property
    def symmetries(self) -> list[Symmetry]:
        """Symmetries that count."""
        return [
            x for x in self.grounds.invariance.symmetries
            if self._accepts(self.identities.symmetry(x), f"{x.name} is a symmetry")
        ]  # fmt: skip

    @cached_property
    def _directions(self) -> list[tuple[str, bool, Matrix]]:
        """Neutral directions: name, whether it is a symmetry, and the direction in the coordinates of S."""
        found = [
            (x.name, True, self.proof.column(*self.identities.disturbance(x, self.proof))) for x in self.symmetries
        ]
        for item in self.grounds.invariance.boosts:
            if item in self.symmetries:
                direction = ball_matrices.matrix([short(x) for x in item.direction.tolist()])
                still = ball_matrices.zeros(len(direction))
                name = f"speed along {item.name.removeprefix('translation along ')}"
                found.append((name, False, self.proof.column(still, direction)))
        if self.grounds.plain.choice.moving:
            for item in self.symmetries:
                name = f"speed of {item.name}"
                if name in self.grounds.plain.neutral.family and self._accepts(
                    self.identities.at_any_speed(item), f"motions at any {name} exist"
                ):  # fmt: skip
                    direction, _ = self.identities.disturbance(item, self.proof)
                    found.append((name, False, self.proof.column(0 * direction, direction)))
        return found + [("position at rest", False, x) for x in self._rests()]

    def _rests(self) -> list[Matrix]:
        """Return the directions of neighbouring rests; see `mbstab.analysis.verdict.neutral.Structure`."""
        r = self.proof.reduced
        m, k = len(r.free), len(r.moving)
        light = self.grounds.linear.massless
        if light is not None and len(light.first_order):  # neighbours at rest must satisfy their balance as well
            return []
        if k >= m or self._moves or not self._accepts(self.identities.rows_at_rest(), "rest satisfies all constraints"):
            return []
        try:
            pivots, T = ball_matrices.eliminate(r.S[m:, :m], k, m)
        except NotProvable:
            return []
        _, N = ball_matrices.null_space(pivots, T, m)
        return list(np.vstack([N, ball_matrices.zeros(k, N.shape[1])]).T)

    @property
    def _moves(self) -> bool:
        return bool(np.any(self.grounds.motion.u))

    @cached_property
    def _divided(self) -> tuple[Quotient, list[tuple[str, bool, Matrix]]]:
        """S modulo the neutral directions, which span an invariant subspace, and these directions."""
        S, chosen = self.proof.reduced.S, self._directions
        while True:
            quotient, kept = Quotient(S), []
            for item in chosen:
                if quotient.divide(item[2]):
                    kept.append(item)
            images = [quotient.seen(ball_matrices.times(S, x)) for _, _, x in kept]
            stay = [x for x, v in zip(kept, images, strict=True) if all(zero_inside(y) for y in v.values())]
            if len(stay) == len(kept):
                return quotient, kept
            chosen = stay

    @cached_property
    def _functions(self) -> tuple[Matrix, list[str]]:
        """Differentials of conserved functions that are constant along the neutral directions, and their names."""
        candidates = [(f"speed of {x.name}", self._momentum(x)) for x in self.momenta if self._commutes(x)]
        if self._moves and self._accepts(self.identities.conserved(False), "the energy is conserved"):
            candidates.append(("speed", self.proof.differential(self.proof.state.u, self.proof.state.a)))
        if any(not self.grounds.invariance.conserves(x.of) for x in self.grounds.invariance.boosts):
            return self._stacked([]), []
        test, rows = Quotient(0 * self.proof.reduced.S), list[tuple[str, Matrix]]()
        for name, row in candidates:
            if test.restrict(row):
                rows.append((name, row))
        differentials = self._stacked([row for _, row in rows])
        combinations = self._vanishing(differentials, self._stacked([x for _, _, x in self._divided[1]]))
        names = [next(rows[k][0] for k in reversed(range(len(rows))) if not c[k].is_zero()) for c in combinations]
        return ball_matrices.times(combinations, differentials), names

    def _stacked(self, vectors: Sequence[Matrix]) -> Matrix:
        """Return vectors in the coordinates of S as rows."""
        return np.array(vectors, dtype=object).reshape(len(vectors), len(self.proof.reduced.S))

    def _vanishing(self, rows: Matrix, columns: Matrix, turned: bool = False) -> Matrix:
        """Return combinations of rows that vanish along columns; `turned`: of columns on which the rows vanish."""
        sizes = [np.array(list(map(_size, part)), dtype=object) for part in (rows, columns)]
        scaled, along = (part / size[:, None] for part, size in zip((rows, columns), sizes, strict=True))
        products = ball_matrices.times(scaled, along.T)
        found, slack = null_combinations(products if turned else products.T)
        if not self.proof.wide and slack > float(balls.small(0.5)):
            raise NotProvable("which conserved functions change along symmetries is not known")
        return np.asarray(found / sizes[turned])

    @cached_property
    def momenta(self) -> list[Symmetry]:
        """Symmetries, and combinations of them, with a conserved momentum."""
        known = {id(x) for x in self.symmetries}
        return [
            x for x in self.grounds.invariance.momenta if {id(part) for _, part in x.parts or ((1.0, x),)} <= known
        ]  # fmt: skip

    def _momentum(self, item: Symmetry) -> Matrix:
        return self.proof.differential(*self.identities.disturbance(item, self.proof))

    def _commutes(self, item: Symmetry) -> bool:
        """Return whether a symmetry is constant in the co-moving frame."""
        direction, rate = self.identities.disturbance(item, self.proof)
        return all(map(zero_inside, rate - ball_matrices.times(self.proof.state.slope, direction)))

    @cached_property
    def left(self) -> tuple[Spectrum, Neutral]:
        """The eigenvalues left to judge, and the neutral ones."""
        quotient, directions = self._divided
        rows, names = self._functions
        kept = [name for name, row in zip(names, rows, strict=True) if quotient.restrict(row)]
        r = self.proof.reduced
        known = self.grounds.plain.neutral
        symmetries = tuple(x for x, symmetry, _ in directions if symmetry)
        family = [x for x, symmetry, _ in directions if not symmetry]
        count = len(r.S) - len(quotient.alive)
        if self.generic is not self and self.generic.left[1].count != count:
            raise NotProvable("neutral directions are not independent at all values")
        neutral = Neutral(
            symmetries,
            tuple(dict.fromkeys([*family, *kept])),
            count,
            None,
            weakest(*self._evidence),
            tumbling=known.tumbling,
        )
        if count == known.count and symmetries == known.symmetries:
            neutral = replace(known, evidence=neutral.evidence)
        spectrum = quotient.spectrum([self.proof.name_of(i) for i in range(len(r.S))], self._mirrored)
        return spectrum, neutral

    @cached_property
    def _mirrored(self) -> str:
        """What makes the spectrum symmetric about the imaginary axis, in words; empty: nothing."""
        conserved, text = "the energy is conserved", "the equations are the same backwards in time"
        if not self.proof.r_n and self._accepts(self.identities.conserved(True), conserved):
            return conserved
        return text if not self._moves and self._accepts(self.identities.reversible(), text) else ""

    # --- eigenvalues --------------------------------------------------------------------------------------------------

    @cached_property
    def enclosures(self) -> list[Enclosure]:
        """All eigenvalues."""
        spectrum, neutral = self.left
        found: list[Enclosure] = []
        for k, factor in enumerate(spectrum.factors):
            others = [x for i, x in enumerate(spectrum.factors) if i != k and x.even and not spectrum.apart(x, factor)]
            theirs = [e for other in others for e in enclosed(other) if e.kind == "imaginary"]
            for e in enclosed(factor):
                if e.kind == "imaginary" and any(touch(e, other) for other in theirs):
                    e = replace(e, kind="open", why=DOUBLE)
                found.append(e)
        found += [zero_enclosure("open", 1, name) for name in spectrum.zeros]
        carried = self._carried
        if neutral.count > 2 * len(carried):
            found.append(zero_enclosure("zero", neutral.count - 2 * len(carried), phrases(neutral.names)))
        why = "the motion carries neutral directions around"
        for rate in carried:
            found += carried_enclosures(rate, why)
        return found

    @cached_property
    def _carried(self) -> list[Ball]:
        """ω of the eigenvalues ±iω of neutral directions that rotate with the motion."""
        S, T = self.proof.reduced.S, self._stacked([x for _, _, x in self._divided[1]])
        if not len(T) or not self._moves:
            return []
        quotient = Quotient(0 * S)
        for x in T:
            quotient.divide(x)
        places = [i for i in range(len(S)) if i not in quotient.alive]
        step = ball_matrices.solve(T.T[places], ball_matrices.times(S, T.T)[places])
        values = np.linalg.eigvals(step.astype(float))
        turning = values[values.imag > 1e-4 * float(np.max(np.abs(values), initial=0.0))].imag
        if not len(turning):
            return []
        if np.ptp(turning) > 1e-6 * turning[0]:
            raise NotProvable("neutral directions go round at different rates")
        trace = sum(np.diagonal(ball_matrices.times(step, step)))
        rate = balls.ball_arithmetic().sqrt(-trace / (2 * len(turning)))
        return [rate] * len(turning)

    def discs(self) -> list[Disc]:
        """Return the eigenvalues left to judge as discs; over an interval only their sides are computed."""
        if self.proof.wide:
            return self._sides()
        return [
            Disc(complex(float(e.real.mid()), float(e.imag.mid())), e.radius, e.count, SIDES[e.kind], e.why)
            for e in self.enclosures
            if e.kind in SIDES
        ]

    def _sides(self) -> list[Disc]:
        """Return discs that tell on which side of the axis the eigenvalues are, but not where."""
        spectrum, _ = self.left
        found = [Disc(0j, 0.0, 1, "open", name) for name in spectrum.zeros]
        even = [factor for factor in spectrum.factors if factor.even]
        acting = [[not spectrum.apart(one, other) for other in even] for one in even]
        for members in together(acting):
            group = [even[k] for k in members]
            whole = ball_polynomials.product(*(factor.p for factor in group))
            count = 2 * (len(whole) - 1)
            inside = ball_polynomials.all_negative_and_simple(whole)
            if inside:
                found.append(Disc(1j, 0.0, count, "axis", group[0].why))
            elif inside is not None:
                # A root σ that is neither real negative nor zero: one of ±√σ is right of the axis.
                found += [Disc(1 + 0j, 0.0, 1, "right"), Disc(0j, math.inf, count - 1, "open")]
            else:
                found += [disc for factor in group for disc in _rough(factor, len(group) == 1)]
        for factor in spectrum.factors:
            if not factor.even:
                count = len(factor.p) - 1
                right = ball_polynomials.right_roots(factor.p)
                if right is None:
                    found += _rough(factor, False)
                else:
                    found += [Disc(1 + 0j, 0.0, right, "right")] if right else []
                    found += [Disc(-1 + 0j, 0.0, count - right, "left")] if count > right else []
        return found

    # --- energy -------------------------------------------------------------------------------------------------------

    def minimum(self) -> Minimum | None:
        """Return what the energy says, or None if it says nothing."""
        grounds = self.grounds
        finding = self.identities.decreases(self.proof.system, bool(self._following))
        if finding == "refuted" or not grounds.second_variation.applies or not self._unforced():
            return None
        turning = grounds.linear.generator is not None and grounds.linear.generator.turns
        name = "the energy in the frame of the motion" if turning or self._moves else "the energy"
        name += grounds.second_variation.beside
        sign = self._sign()
        text = "the energy is conserved" if sign < 0 else "the energy never increases"
        if sign and self._accepts(self.identities.conserved(True) if sign < 0 else finding, text):
            nothing = not grounds.invariance.symmetries if self._moves else not self.left[1].count
            kind: Extremum = "maximum" if sign < 0 else "minimum"
            return Minimum(name, True, nothing, kind, weakest(*self._evidence, "enclosed"))
        if self._moves and not sign and self._with_a_multiple():
            return Minimum(name, True, False, "with a multiple", weakest(*self._evidence, "enclosed"))
        return None

    def _sign(self) -> int:
        """Return 1 if the second variation is proven to be positive definite, −1 if negative, else 0."""
        W = self._disturbances()
        h = ball_matrices.times(W.T, self._second_variation(), W)
        return next((s for s in (1, -1) if ball_matrices.positive(s * h)), 0)

    def _with_a_multiple(self) -> bool:
        """Return whether the second variation is definite in another frame in which the reference is at rest too."""
        if not self.grounds.structure.work.conserved or self.proof.r_n:
            return False
        rates = frame_rates(self.grounds.separated.A).tolist()
        for item, step in self._idle():
            if not self.grounds.invariance.conserves(item.of):
                continue
            if self.identities.conserved(True) not in ("structural", "enclosed"):
                continue
            if any(Case(self.proof.seen_from(step, short(x)), True)._sign() > 0 for x in rates):
                return True
        return False

    def _idle(self) -> Iterator[tuple[Symmetry, BallGenerator]]:
        """Yield rotations of the ground that do not move the reference, with the spins that compensate them."""
        still, own = np.zeros(self.proof.system.n_q), self.proof.state.field
        spins = [x for x in self.momenta if x.of.shift is not None and np.sum(x.of.shift != 0.0) == 1]
        for name, group in self.grounds.invariance.fields:
            generator = group.generator
            if generator is None or not generator.turns or name == "the motion itself":
                continue
            item = Symmetry(name, still, still, group)
            Y = self.identities.disturbance(item, self.proof)[0]
            free = {int(np.flatnonzero(x.direction)[0]) for x in spins}
            if all(i in free or y.is_zero() for i, y in enumerate(Y)) and any(not y.is_zero() for y in Y):
                turn = ground_turn(group, self.proof)
                pairs = zip([*own.axis, *own.point], [*turn.axis, *turn.point], strict=True)
                if not own.rate.is_zero() and any(not (x - y).is_zero() for x, y in pairs):
                    continue
                yield item, replace(turn, spins=-Y)

    def _second_variation(self) -> Matrix:
        """Return H in the coordinates of S."""
        r = self.proof.reduced
        m, rates = len(r.free), np.hstack([r.P, r.Z])
        H: Matrix = ball_matrices.times(rates.T, r.M_N, rates)
        H[:m, :m] = H[:m, :m] + (r.K_N + r.K_N.T) / 2
        return H

    @cached_property
    def _following(self) -> list[Matrix]:
        """Disturbances of states that only follow the others, if proven to decay but for symmetries, as columns."""
        states, r = self.proof.system.following, self.proof.reduced
        if not states or self._moves or self.grounds.linear.massless is not None:
            return []
        places = [r.free.index(i) for i in states]
        left = Quotient(r.S[np.ix_(places, places)])
        for _, symmetry, x in self._divided[1]:
            if symmetry and all(x[i].is_zero() for i in range(len(x)) if i not in places):
                left.divide(np.array([x[i] for i in places], dtype=object))
        if (
            ball_polynomials.right_roots(ball_polynomials.characteristic(left.kept[np.ix_(left.alive, left.alive)]))
            != 0
        ):
            return []
        return list(ball_matrices.matrix(np.eye(len(r.S), dtype=int)[places].tolist()))

    def _disturbances(self) -> Matrix:
        """Return disturbances at the given momenta, modulo symmetries, as columns."""
        r = self.proof.reduced
        n, m = len(r.S), len(r.free)
        if self._moves:
            columns = [x for _, symmetry, x in self._directions if symmetry]
            rows = [self._momentum(x) for x in self.momenta]
        else:
            still = ball_matrices.zeros(n - m)
            columns = [np.concatenate([x[:m], still]) for _, symmetry, x in self._divided[1] if symmetry]
            columns += self._following
            rows = []
        kernel, _ = null_combinations(self._stacked(rows))  # at least as large as the true one
        combinations = self._vanishing(self._stacked(rows), self._stacked(columns), True)
        free = [next(j for j in range(n) if c[j] == 1 and _alone(kernel, j)) for c in kernel]
        quotient = Quotient(ball_matrices.zeros(len(kernel), len(kernel)))
        for vector in ball_matrices.times(combinations, self._stacked(columns)):
            quotient.divide(vector[free])
        return kernel[quotient.alive].T

    def _unforced(self) -> bool:
        """Return whether the reactions of rows on speeds vanish along all that holonomic rows allow."""
        for case in (self, self.generic):
            proof = case.proof
            D, nu = proof.dynamic_rows(), proof.state.nu[proof.r_h :]
            for total in ball_matrices.times(nu, D, proof.reduced.N):
                exact = proof.wide or tiny(total, sum((abs(x) for x in proof.state.nu), ball(0)))
                if not zero_inside(total) or not exact:
                    return False
        return True

    # --- the verdict --------------------------------------------------------------------------------------------------

    def facts(self) -> Facts:
        """Return the facts."""
        size, grounds = len(self.proof.reduced.S), self.proof.grounds
        return Facts(
            expected=size,
            found=size,
            discs=tuple(self.discs()),
            neutral=self.left[1],
            kink=grounds.kink(1),
            rough=grounds.rough,
            resisted=grounds.resisted,
            minimum=self.minimum,
            warnings=() if grounds.linear.massless is None else grounds.linear.massless.warnings,
            frequencies=self.grounds.second_variation.warnings,
        )

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict; where a fact is only taken for granted, `conditions` states it."""
        return judge(self.facts())

    @property
    def coarse(self) -> bool:
        """Whether the verdict is stable but the eigenvalues are not located: a stronger verdict may hold."""
        return self.verdict.word in (STABLE, STABLE_UP_TO) and any(d.side == "open" for d in self.discs())


def best(proof: Proof) -> Case:
    """Return the case with the strongest verdict: proven if there is one, else under conditions."""
    proof.settle(not proof.pending or proof.identities.steady() in ("structural", "enclosed"))
    case = Case(proof, True)
    if case.verdict.word == UNDECIDED and case.left_out:
        other = Case(proof, False)
        if other.verdict.word != UNDECIDED:
            return other
    return case


def _size(x: Matrix) -> Ball:
    """Return the size of a vector."""
    size = float(np.max(np.abs(x.astype(float)), initial=0.0))
    return ball(2.0 ** round(np.log2(size))) if size else ball(1)


def _alone(kernel: Matrix, j: int) -> bool:
    """Whether only one row has an entry in a column."""
    return sum(not c[j].is_zero() for c in kernel) == 1


def _rough(factor: Factor, isolated: bool) -> list[Disc]:
    """Return the roots of a factor with wide coefficients as discs; those on the axis may meet other factors' roots."""
    return [
        Disc(
            complex(float(e.real.mid()), float(e.imag.mid())), e.radius, e.count,
            "open" if e.kind == "imaginary" and not isolated else SIDES[e.kind], e.why,
        )
        for e in enclosed(factor)
    ]  # fmt: skip
