"""Zeros of transfer functions, and eigenvalues that an input does not reach or an output does not see.

Everything here rests on values of G(s) from the unreduced equations, with their error bounds
(`mbstab.analysis.response.frequency`), and on the eigenvalues p with theirs.

* The order of the principal part of G at a group of eigenvalues is the rank of the Hankel matrix of its moments on a
  circle about them; what is missing to their number is hidden (Kailath, Linear Systems, 1980, section 6.2).
* Far out G falls like s^-r; G has r zeros less than it has poles.
* N(s) = G(s) Π (s − p) has no poles. Re(s N'/N), averaged over a circle about 0, is the number of zeros inside. With
  the starts that this gives, Aberth's iteration finds all zeros together (Bini, Numer. Algorithms 13, 1996, 179-200).
* With approximate zeros z_k, m of them, and N = c s^m + …, the discs about z_k with the radii
  m |N(z_k)/c| / Π |z_k − z_j| contain all zeros, and discs that meet as many as there are (Smith, J. ACM 17, 1970,
  661-674).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.bounds.tolerances import TOLERANCES as BOUNDS
from mbstab.analysis.response.exact_zeros import Powers, mirrored, order_at_zero
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.analysis.response.transfer import Channel
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.verdict.wording import show
from mbstab.compiler.system import Array
from mbstab.records import dataclass

Values = Callable[[complex], tuple[complex, float, complex]]
"""Returns G(s), its error bound and G'(s)."""


@dataclass(frozen=True)
class Zeros:
    """The zeros of a transfer function.

    Attributes
    ----------
    values : ndarray of complex (1/s)
        Sorted by their real parts.
    errors : ndarray
        Radii of discs about them that contain as many zeros; those of clusters overlap.
    poles : ndarray of complex (1/s)
        Eigenvalues that the input reaches and the output sees.
    pole_errors : ndarray
        Their error bounds; of a group of which others are hidden, what it is wide.
    undamped : ndarray of bool
        Which of them are known to lie on the imaginary axis.
    hidden : tuple of complex (1/s)
        Eigenvalues that the input does not reach or the output does not see; of a group those with the largest real
        parts.
    hidden_errors : ndarray
        Their error bounds, as `pole_errors`.
    vanishes : bool
        Whether the transfer function is exactly zero: nothing leads from the input to the output.
    doubt : str
        Why the number of zeros is not decided; empty if it is.
    on_axis : ndarray of bool
        Which zeros are known to lie on the imaginary axis.
    """

    values: Complex
    errors: Array
    poles: Complex
    pole_errors: Array
    undamped: Any
    hidden: tuple[complex, ...]
    hidden_errors: Array
    vanishes: bool
    doubt: str = ""
    on_axis: Any = ()

    @classmethod
    def vanishing(cls, poles: Complex, bounds: Array) -> Zeros:
        """Return the answer where nothing leads from the input to the output."""
        nothing = np.zeros(0, dtype=complex), np.zeros(0)
        return cls(*nothing, *nothing, np.zeros(0, dtype=bool), tuple(poles.tolist()), bounds, True)

    @classmethod
    def unknown(cls, doubt: str) -> Zeros:
        """Return the answer where none is found."""
        nothing = np.zeros(0, dtype=complex), np.zeros(0)
        return cls(*nothing, *nothing, np.zeros(0, dtype=bool), (), np.zeros(0), False, doubt)

    @property
    def hidden_growing(self) -> tuple[complex, ...]:
        """Hidden eigenvalues right of the imaginary axis."""
        return tuple(s for s, e in zip(self.hidden, self.hidden_errors, strict=True) if s.real > e)

    def removable_growing(self, every: Complex) -> tuple[Complex, Complex]:
        """Return hidden eigenvalues right of the axis that lie apart from those that are seen, and all others.

        Parameters
        ----------
        every : ndarray of complex (1/s)
            All eigenvalues.
        """
        apart = [
            s
            for s, e in zip(self.hidden, self.hidden_errors, strict=True)
            if s.real > e and np.all(np.abs(self.poles - s) > self.pole_errors + e)
        ]
        return np.array(apart, dtype=complex), every[~np.isin(every, apart)]

    @property
    def hidden_decaying(self) -> bool:
        """Whether all hidden eigenvalues lie left of the imaginary axis."""
        return all(s.real < -e for s, e in zip(self.hidden, self.hidden_errors, strict=True))

    @property
    def growing(self) -> bool:
        """Whether a zero lies right of the imaginary axis."""
        return bool(np.any(self.values.real > self.errors))

    @property
    def minimum_phase(self) -> bool | None:
        """Whether all zeros lie left of the imaginary axis; None: that is not decided."""
        if self.doubt:
            return None
        if self.growing or np.any(self.on_axis):
            return False
        return True if np.all(self.values.real < -self.errors) and not self.vanishes else None


class _Doubt(Exception):
    """Why something is not decided."""


@dataclass(frozen=True)
class Group:
    """Eigenvalues that are judged together: their centre, the radius of a circle about them, values, error bounds."""

    centre: complex
    radius: float
    values: tuple[complex, ...]
    errors: tuple[float, ...]


def groups_of(poles: Complex, bounds: Array) -> list[Group]:
    """Return eigenvalues in groups that are far from each other, compared with their sizes and errors."""
    members = [[k] for k in range(len(poles))]
    while True:
        centres = [complex(np.mean(poles[g])) for g in members]
        joined = None
        found = []
        for g, centre in zip(members, centres, strict=True):
            spread = float(np.max(np.abs(poles[g] - centre) + bounds[g]))
            others = [k for k in range(len(poles)) if k not in g]
            gaps = np.abs(poles[others] - centre) - bounds[others]
            gap = float(np.min(gaps, initial=np.inf))
            radius = gap / 8.0 if others else max(4.0 * spread, 0.1 * abs(centre), 1e-3)
            if others and not 4.0 * spread < radius:
                joined = g, others[int(np.argmin(gaps))]
                break
            found.append(Group(centre, radius, tuple(poles[g].tolist()), tuple(bounds[g].tolist())))
        if joined is None:
            return found
        first, k = joined
        other = next(g for g in members if k in g)
        members = [g for g in members if g is not first and g is not other] + [sorted(first + other)]


def order(group: Group, values: Values, beyond: Array) -> int:
    """Return the order of the principal part of G at a group of poles.

    A trace that is lost on a wide circle may be seen on one close to the poles.

    Parameters
    ----------
    beyond : ndarray
        Distances of the other eigenvalues from the centre.
    """
    q, kept, best = len(group.values), 0, (np.inf, 0)
    if not q:
        return 0
    spread = max(abs(s - group.centre) + e for s, e in zip(group.values, group.errors, strict=True))
    for radius in group.radius * np.array(TOLERANCES.circles_of_poles):
        if radius != group.radius and not 4.0 * spread < radius:
            break
        singular, noise = _moments(group, values, float(radius), beyond)
        if singular is None:
            continue
        kept = max(kept, int(np.sum(singular > TOLERANCES.residue_kept * noise)))
        best = min(best, (noise * radius, int(np.sum(singular > TOLERANCES.residue_dropped * noise))))
        if kept == q:
            return q
    if not best[0] < np.inf:
        raise _Doubt(f"the response beside the eigenvalue {show(group.centre)} is not known")
    if best[1] > kept:
        raise _Doubt(f"whether the eigenvalue {show(group.centre)} is reached and seen")
    return kept


def _moments(group: Group, values: Values, radius: float, beyond: Array) -> tuple[Any, float]:
    """Return the singular values of the moments on a circle, or None if G is not known there, and their error."""
    q = len(group.values)
    count, outside = _points_on(radius / beyond)
    count += 2 * q
    turns = np.exp(2j * np.pi * (np.arange(count) + 0.5) / count)
    found = [values(group.centre + radius * u) for u in turns]
    G, errors = np.array([x[0] for x in found]), np.array([x[1] for x in found])
    if not (np.isfinite(G).all() and np.isfinite(errors).all()):
        return None, np.inf
    moments = np.array([np.mean(turns ** (k + 1) * G) for k in range(2 * q - 1)])
    hankel = np.array([[moments[i + k] for k in range(q)] for i in range(q)])
    noise = q * (float(np.mean(errors)) + float(np.max(np.abs(G))) * outside)
    return np.linalg.svd(hankel, compute_uv=False), noise


def _points_on(ratios: Array) -> tuple[int, float]:
    """Return on how many points of a circle the mean forgets poles outside, and what is left of them.

    Of a product of 1/(1 − r_j u) these are the coefficients of powers of u: several poles at one place, or many, leave
    more than a single one.
    """
    powers = np.array([1.0])
    sums = np.array([np.sum(ratios**n) for n in range(1, TOLERANCES.most_points_on_circle)])
    while len(powers) <= TOLERANCES.points_on_circle or (powers[-1] > EPS and len(powers) <= len(sums)):
        # Newton's identities for complete homogeneous sums.
        powers = np.append(powers, np.dot(sums[: len(powers)], powers[::-1]) / len(powers))
    return len(powers) - 1, float(powers[-1])


def excess(values: Values, size: float) -> tuple[int, complex]:
    """Return r with G ~ s^-r far outside of all poles and zeros, and where that is."""
    last, there = None, 0j
    for exponent in range(2, 15, 2):
        near, far = (values(1j * size * 10.0**x) for x in (exponent, exponent + 1))
        known = all(np.isfinite(x[0]) and x[1] < 1e-3 * abs(x[0]) for x in (near, far))
        if not known:
            break
        slope = float(np.log10(abs(near[0]) / abs(far[0])))
        last = round(slope) if abs(slope - round(slope)) < 1e-3 else None
        there = 1j * size * 10.0**exponent
    if last is None:
        raise _Doubt("how the response falls at high frequencies")
    return last, there


class TransferZeros:
    """The zeros of the transfer functions of a model.

    Parameters
    ----------
    exact : FrequencyResponse

    Attributes
    ----------
    poles : ndarray of complex (1/s)
        The eigenvalues of the model.
    bounds : ndarray (1/s)
        Their error bounds; infinite: not known.
    """

    def __init__(self, exact: FrequencyResponse) -> None:
        self.exact = exact
        found = eigenvalues(exact.model.linear).eigenvalues
        values = np.array([e.value for e in found], dtype=complex)
        self.axis = np.array([e.value for e in found if e.exact or e.kind == "center"], dtype=complex)
        zero = np.array([e.exact for e in found], dtype=bool) & (
            np.abs(values) <= BOUNDS.slow_eigenvalue * np.max(np.abs(values), initial=0.0)
        )
        self.poles = np.where(zero, 0.0, values)
        self.bounds = np.array([0.0 if e.exact else e.error_bound for e in found])
        self._known: dict[complex, tuple[Complex, Array, Complex]] = {}

    def of(self, channel: Channel, shift: float = 0.0) -> Zeros:
        """Return the zeros of G(s) + shift, from one input to one output."""
        if channel.vanishes and not shift:
            return Zeros.vanishing(self.poles, self.bounds)
        if len(self.poles) > TOLERANCES.zero_states:
            return Zeros.unknown(f"zeros are not computed for {len(self.poles)} states")
        if not np.isfinite(self.bounds).all():
            return Zeros.unknown("not all eigenvalues are known")
        at = self.exact.number(channel)

        def values(s: complex) -> tuple[complex, float, complex]:
            if s not in self._known:
                with np.errstate(all="ignore"):
                    self._known[s] = self.exact.at(s)
            G, error, slope = (x[at] for x in self._known[s])
            return complex(G) + shift, float(error) + EPS * abs(shift), complex(slope)

        size = float(np.max(np.abs(self.poles), initial=0.0)) or 1.0
        if not shift and all(values(s * size)[:2] == (0.0, 0.0) for s in TOLERANCES.places_of_nothing):
            # Zero without an error: a gain of 0 leads from the input to the output.
            return Zeros.vanishing(self.poles, self.bounds)
        found = find(values, self.poles, self.bounds, self.axis)
        return found if found.doubt else _settled(found, self.exact.powers(at, shift), self.poles, self.bounds)

    def growth(self, zeros: Zeros) -> str:
        """Return a sentence if the output of a channel grows without bound, or may do so; empty: it does not."""
        if reason := growing(zeros.poles, zeros.pole_errors):
            return f"the output grows without bound: {reason}"
        if zeros.doubt and (reason := growing(self.poles, self.bounds)):
            return (
                f"whether the output grows without bound is not decided: {reason}, and if it is not reached or not "
                "seen, what grows here are rounding errors"
            )
        return ""


def find(values: Values, poles: Complex, bounds: Array, axis: Complex) -> Zeros:
    """Return the zeros of a transfer function.

    Parameters
    ----------
    values : callable
        G(s), its error bound and G'(s).
    poles, bounds : ndarray
        All eigenvalues, each as often as it is one, and their error bounds.
    axis : ndarray of complex
        Those that are known to lie on the imaginary axis.
    """
    try:
        (seen, known), (others, errors_of_others) = _seen(values, groups_of(poles, bounds))
        size = float(np.max(np.abs(poles), initial=0.0)) or 1.0
        fall, far = excess(values, size)
        if len(seen) < fall:
            raise _Doubt("there are fewer poles than the response needs")
        with np.errstate(all="ignore"):
            found = _roots(values, seen, len(seen) - fall, size)
            found = _paired(_beside(values, seen, known, found))
            found, errors = _joined(found, _radii(values, seen, found, far))
        if not np.isfinite(errors).all():
            raise _Doubt(
                "an eigenvalue has hardly any trace in the response, and zeros beside it cannot be told from it"
            )
    except _Doubt as reason:
        return Zeros.unknown(str(reason))
    rank = np.lexsort((found.imag, found.real))
    undamped = np.isin(seen, [*axis, 0.0])
    return Zeros(found[rank], errors[rank], seen, known, undamped, tuple(others.tolist()), errors_of_others, False)


def _settled(zeros: Zeros, powers: Powers, poles: Complex, bounds: Array) -> Zeros:
    """Return zeros, those that are known to lie on the imaginary axis put there.; `poles` are all eigenvalues."""
    values, errors = zeros.values.copy(), zeros.errors.copy()
    on_axis = np.zeros(len(values), dtype=bool)
    beside = np.flatnonzero(np.abs(values) <= errors)
    if len(beside):
        seen = int(np.sum((zeros.poles == 0.0) & (zeros.pole_errors == 0.0)))
        at_zero = beside[: max(0, order_at_zero(powers) - int(np.sum(np.abs(poles) <= bounds)) + seen)]
        values[at_zero], errors[at_zero], on_axis[at_zero] = 0.0, 0.0, True
    if mirrored(powers):
        apart = np.abs(zeros.values[:, None] - zeros.values) > zeros.errors[:, None] + zeros.errors
        alone = np.sum(~apart, axis=1) == 1
        own = alone & (np.abs(values.real) <= errors) & ~on_axis
        values.real[own], on_axis[own] = 0.0, True
    rank = np.lexsort((values.imag, values.real))
    return replace(zeros, values=values[rank], errors=errors[rank], on_axis=on_axis[rank])


def _seen(values: Values, groups: Sequence[Group]) -> list[tuple[Complex, Array]]:
    """Return the poles of G with their errors, and the other eigenvalues with theirs."""
    found: list[tuple[list[complex], list[float]]] = [([], []), ([], [])]
    every = np.array([s for group in groups for s in group.values], dtype=complex)
    errors_of_every = np.array([error for group in groups for error in group.errors])
    owner = np.repeat(np.arange(len(groups)), [len(group.values) for group in groups])
    for n, group in enumerate(groups):
        if group.centre.imag < 0.0 and group.radius < -group.centre.imag:
            continue
        others = owner != n
        count = order(group, values, np.abs(every[others] - group.centre) - errors_of_every[others])
        own = sorted(group.values, key=lambda s: (s.real, s.imag))
        parts = own[:count], own[count:]
        wide = max((abs(s - x) for s in own for x in own), default=0.0) if 0 < count < len(own) else 0.0
        pairs = 2 if group.centre.imag > group.radius else 1
        for (targets, errors), part in zip(found, parts, strict=True):
            targets += part
            if pairs == 2:
                targets += [s.conjugate() for s in part]
            errors += [wide + max(group.errors)] * (pairs * len(part))
    return [(np.array(targets, dtype=complex), np.array(errors)) for targets, errors in found]


def _ratio(values: Values, poles: Complex, z: complex) -> tuple[complex, float, complex]:
    """Return G, its error bound, and G N'/N = G' + G Σ 1/(z − p)."""
    G, error, slope = values(z)
    return G, error, slope + G * complex(np.sum(1.0 / (z - poles)))


def _roots(values: Values, poles: Complex, m: int, size: float) -> Complex:
    """Return m approximate zeros of N, by Aberth's iteration."""
    z = _starts(values, poles, m, size)
    step = np.full(m, np.inf)
    for _ in range(TOLERANCES.rounds_of_zeros):
        for k in range(m):
            if step[k] <= EPS * abs(z[k]) or abs(z[k]) < TOLERANCES.zero_at_zero * size:
                step[k] = 0.0
                continue
            G, error, slope = _ratio(values, poles, complex(z[k]))
            if not np.isfinite(G) or abs(G) <= 0.1 * error or slope == 0.0:
                step[k] = 0.0
                continue
            newton = slope / G
            others = np.delete(z, k)
            apart = z[k] - others
            apart[apart == 0.0] = 1e-300
            change = 1.0 / (newton - np.sum(1.0 / apart))
            if not np.isfinite(change):
                continue  # the others hold it where it is, until they move
            z[k] -= change
            step[k] = abs(change)
        if np.all(step <= EPS * np.abs(z)):
            break
    return z


def _beside(values: Values, poles: Complex, bounds: Array, z: Complex) -> Complex:
    """Return approximate zeros, those on which G is not known moved beside their eigenvalues until it is."""
    z = z.copy()
    for k, s in enumerate(z.tolist()):
        if np.isfinite(values(s)[1]) or not len(poles):
            continue
        step = 4.0 * max(float(bounds[np.argmin(np.abs(poles - s))]), EPS * abs(s))
        for power in range(TOLERANCES.steps_beside_pole):
            if np.isfinite(values(s + step * 8.0**power)[1]):
                z[k] = s + step * 8.0**power
                break
    return z


def _paired(z: Complex) -> Complex:
    """Return approximate zeros of which those that are next to conjugate are so."""
    z = z.copy()
    for k in np.flatnonzero(z.imag > 0.0):
        away = np.where(z.imag < 0.0, np.abs(z - z[k].conjugate()), np.inf)
        other = int(np.argmin(away))
        if away[other] < TOLERANCES.conjugate * z[k].imag:
            mean = 0.5 * (z[k] + z[other].conjugate())
            z[k], z[other] = mean, mean.conjugate()
    return z


def _radii(values: Values, poles: Complex, z: Complex, far: complex) -> Array:
    """Return the radii of Smith's discs."""

    def log_size(s: complex, points: Complex) -> float:
        return float(np.sum(np.log(np.abs(s - points))))

    leading = np.log(abs(values(far)[0])) + log_size(far, poles) - log_size(far, z)
    radii = np.empty(len(z))
    for k, s in enumerate(z.tolist()):
        G, error, _ = values(s)
        others = log_size(s, poles) - log_size(s, np.delete(z, k)) - leading
        radii[k] = 1.01 * len(z) * (abs(G) + error) * np.exp(others) + 2.0 * EPS * abs(s)
    return radii


def _joined(z: Complex, errors: Array) -> tuple[Complex, Array]:
    """Return zeros with discs that contain as many zeros as meet in them; real ones are made so."""
    radii = errors.copy()
    for _ in range(len(z)):
        meet = np.abs(z[:, None] - z) <= radii[:, None] + radii
        wide = np.max(np.where(meet, np.abs(z[:, None] - z) + errors, 0.0), axis=1, initial=0.0)
        if np.all(wide <= radii):
            break
        radii = np.maximum(radii, wide)
    real = np.abs(z.imag) <= radii
    return np.where(real, z.real, z), radii


def _starts(values: Values, poles: Complex, m: int, size: float) -> Complex:
    """Return starting values: for each ring about 0 as many as zeros lie in it."""
    if not m:
        return np.zeros(0, dtype=complex)
    turns = np.exp(2j * np.pi * (np.arange(5) + 0.3) / 5)
    exponents = np.arange(-16.0, 15.0)
    inside, known = 0, []
    for x in exponents:
        radius, part = size * 10.0**x, []
        for u in turns:
            G, error, slope = _ratio(values, poles, radius * u)
            turning = (radius * u * slope / G).real if error < 0.3 * abs(G) else np.nan
            if np.isfinite(turning):
                part.append(turning)
        count = int(np.clip(round(float(np.mean(part))), inside, m)) if len(part) >= 3 else inside
        known += [radius * 10.0**-0.5] * (count - inside)
        inside = count
    known += [size * 10.0**15] * (m - inside)
    return np.array([r * np.exp(1j * (0.4 + 2.39996 * k)) for k, r in enumerate(known)])


def growing(poles: Complex, errors: Array) -> str:
    """Return in words that one of some eigenvalues grows; empty if none is known to."""
    values = poles[poles.real > errors]
    return f"the eigenvalue {show(values[np.argmax(values.real)])} is unstable" if len(values) else ""
