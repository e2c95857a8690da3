"""The answer of a rotor to what turns with it, as a function of its spin Ω, also a complex one.

What turns with the rotor acts as exp(iΩt). With s = iΩ in s E y = A y + B w, z = C y + D w, whose matrices depend on
the spin as well,

    z(Ω) = D + C P⁻¹ B,   P(Ω) = iΩ E − A.

The bordered matrix [P B; C D] is evaluated at a few spins and interpolated between Chebyshev points, on pieces of the
range that are halved until it agrees at further spins (Trefethen, Approximation Theory and Approximation Practice,
SIAM 2013): all spins, however many, cost one solution each. The poles of z, the critical speeds, are eigenvalues of the
matrix polynomial P(Ω), which are all found at once, however near to each other and to the axis they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebpts2, chebvander

from mbstab.analysis.algebra.arrays import Complex, Flags
from mbstab.analysis.algebra.refinement import equilibration
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError
from mbstab.records import dataclass


@dataclass(frozen=True)
class Bordered:
    """[P B; C D] at a spin, and what is known of it.

    Attributes
    ----------
    matrix : ndarray of complex, shape (n + outputs, n + 1)
    responds : ndarray of bool, shape (outputs,)
        Where it is False, the output is 0 by the entries that are exactly zero.
    errors : callable
        Returns error bounds of the entries of P, shape (n, n).
    """

    matrix: Complex
    responds: Flags
    errors: Callable[[], Array]


@dataclass(frozen=True)
class Pole:
    """Where outputs have no bound: a critical speed without damping, or several that are not told apart.

    Attributes
    ----------
    speed, error : float (rad/s)
    reached : ndarray of bool, shape (outputs,)
        Whether outputs grow beyond all bounds there. Others do not answer to the motion without damping.
    around, values : ndarray of complex, shape (points,) and (outputs, points)
        Spins on a circle about it, and z there.
    """

    speed: float
    error: float
    reached: Flags
    around: Complex
    values: Complex

    def means(self, speeds: Array) -> Complex:
        """Return outputs that are not reached, by Cauchy's integral, at spins next to it, shape (outputs, spins)."""
        weights = (self.around - self.speed)[:, None] / (self.around[:, None] - speeds)
        return np.asarray(self.values @ weights / len(self.around))


@dataclass(frozen=True)
class _Piece:
    """A part of the range, with the coefficients of Chebyshev polynomials, shape (degree + 1, rows, columns)."""

    start: float
    stop: float
    coefficients: Complex
    off: float

    @property
    def half(self) -> float:
        return 0.5 * (self.stop - self.start) or 1.0

    def inner(self, speeds: Complex | Array) -> Complex:
        """Return spins as numbers between -1 and 1."""
        return np.asarray((speeds - 0.5 * (self.start + self.stop)) / self.half, dtype=complex)

    def outer(self, t: Complex | Array) -> Complex:
        return np.asarray(0.5 * (self.start + self.stop) + self.half * t)

    def at(self, t: Complex | Array, order: int = 0) -> Complex:
        """Return the interpolated matrices, shape (points, rows, columns), or a derivative by t."""
        own = chebder(self.coefficients, order) if order else self.coefficients
        return np.tensordot(chebvander(t, len(own) - 1), own, 1)


class Synchronous:
    """The outputs of a rotor over its spin.

    Parameters
    ----------
    equations : callable
        Returns `Bordered` at a spin (rad/s).
    breaks : ndarray, shape (k,)
        First and last spin, in ascending order, and those between at which pieces begin in any case.

    Raises
    ------
    NumericalError
        If the equations have another size at some spins.
    """

    def __init__(self, equations: Callable[[float], Bordered], breaks: Array) -> None:
        known = dict[float, Bordered]()

        def sample(speed: float) -> Complex:
            if speed not in known:
                known[speed] = equations(speed)
                first = next(iter(known))
                if known[speed].matrix.shape != known[first].matrix.shape:
                    raise NumericalError(
                        f"the equations at {speed:.6g} rad/s have another size than those at {first:.6g} rad/s\n"
                        "hint: ask for both sides of the change by themselves"
                    )
            return known[speed].matrix

        first, last = float(breaks[0]), float(breaks[-1])
        middle = 0.5 * (first + last)
        sizes = np.max([np.abs(sample(x)) for x in (first, middle, last)], axis=0)
        self.left, self.right = equilibration(sizes, *(np.ones(k) for k in sizes.shape))
        self.n = sizes.shape[1] - 1

        def balanced(speed: float) -> Complex:
            return np.asarray(sample(speed) * self.left[:, None] * self.right)

        self.pieces = [x for a, b in pairwise(breaks.tolist()) for x in _pieces(balanced, a, b, last - first)]
        self.pieces = self.pieces or [_Piece(first, last, balanced(first)[None], 0.0)]
        self.responds: Flags = np.any([x.responds for x in known.values()], axis=0)
        self.errors = known[middle].errors() * self.left[: self.n, None] * self.right[: self.n]

    def values(self, speeds: Complex | Array) -> Complex:
        """Return z at spins (rad/s), shape (outputs, points); infinite where P is exactly singular."""
        found = np.zeros((len(self.responds), len(speeds)), dtype=complex)
        within = np.clip(np.searchsorted([x.start for x in self.pieces[1:]], np.real(speeds), "right"), 0, None)
        block = max(1, TOLERANCES.block_entries // self.left.size**2)
        for k, piece in enumerate(self.pieces):
            own = np.flatnonzero(within == k)
            for part in (own[i : i + block] for i in range(0, len(own), block)):
                found[:, part] = self._solved(piece.at(piece.inner(speeds[part])))
        return np.where(self.responds[:, None], found, 0.0)

    def _solved(self, bordered: Complex) -> Complex:
        P, b = bordered[:, : self.n, : self.n], bordered[:, : self.n, self.n :]
        try:
            y = np.linalg.solve(P, b)
        except np.linalg.LinAlgError:
            if len(P) == 1:
                return np.full((len(self.responds), 1), complex(np.inf))
            return np.hstack([self._solved(x[None]) for x in bordered])
        z = bordered[:, self.n :, self.n] + (bordered[:, self.n :, : self.n] @ y)[..., 0]
        return np.asarray((z / (self.left[self.n :] * self.right[self.n])).T)

    # --- critical speeds ----------------------------------------------------------------------------------------------

    def resonances(self) -> tuple[list[Pole], Complex]:
        """Return critical speeds without damping, ascending, and all other poles whose real part is in the range."""
        sharp, damped, everything = list[tuple[float, float]](), list[Complex](), list[Complex]()
        for piece in self.pieces:
            t = self._eigenvalues(piece)
            everything.append(piece.outer(t))
            t = t[(np.abs(t.real) <= 1.0 + TOLERANCES.peak_speed) & (np.abs(t.imag) <= 1.0)]
            near = np.abs(t.imag) <= TOLERANCES.pole_near_axis
            damped.append(piece.outer(t[~near]))
            for group in _groups(t[near], TOLERANCES.pole_near_axis):
                places, errors = self._refined(piece, group)
                axis = np.abs(places.imag) <= errors
                sharp += zip(
                    piece.outer(places.real[axis]).real.tolist(), (piece.half * errors[axis]).tolist(), strict=True
                )
                damped.append(piece.outer(places[~axis]))
        whole, single = np.concatenate([*everything, []]), list[tuple[float, float]]()
        for speed, error in sorted(sharp):
            if single and speed - single[-1][0] <= max(error + single[-1][1], TOLERANCES.peak_speed * speed):
                single[-1] = 0.5 * (speed + single[-1][0]), max(error, single[-1][1], speed - single[-1][0])
            else:
                single.append((speed, error))
        poles = [self._pole(x, error, whole) for x, error in single]
        return poles, np.concatenate([*damped, []])

    def _eigenvalues(self, piece: _Piece) -> Complex:
        """Return where P is singular near a piece, as inner numbers: eigenvalues of a companion matrix about a shift.

        Infinite eigenvalues, which the constraints make, are zeros there.
        """
        n, degree = self.n, len(piece.coefficients) - 1
        if not degree or not n:
            return np.zeros(0, dtype=complex)
        shift = np.array([TOLERANCES.shift_of_poles])
        terms = [piece.at(shift, k)[0, :n, :n] / math.factorial(k) for k in range(degree + 1)]
        companion = np.eye(n * degree, k=-n, dtype=complex)
        companion[:n] = -np.linalg.solve(terms[0], np.hstack(terms[1:]))
        inverse = np.linalg.eigvals(companion)
        inverse = inverse[np.abs(inverse) > TOLERANCES.far_pole]
        return np.asarray(shift[0] + 1.0 / inverse)

    def _refined(self, piece: _Piece, t: Complex) -> tuple[Complex, Array]:
        """Return eigenvalues that are close to each other again, with bounds of their errors, as inner numbers."""
        n, error = self.n, np.full(len(t), np.inf)
        for _ in range(TOLERANCES.refinements_of_pole):
            centre = np.array([np.mean(t)])
            P, slope = (piece.at(centre, order)[0, :n, :n] for order in (0, 1))
            left, _, right = np.linalg.svd(P)
            U, V = left[:, n - len(t) :].conj().T, right[n - len(t) :].conj().T
            try:
                inverse = np.linalg.inv(U @ slope @ V)
            except np.linalg.LinAlgError:
                return t, error
            t = centre - np.linalg.eigvals(inverse @ (U @ P @ V))
        off = self.errors + piece.off * np.max(np.abs(P))
        error[:] = np.max(np.sum(np.abs(inverse) @ (np.abs(U) @ off @ np.abs(V)), axis=1))
        return t, error

    def _pole(self, speed: float, error: float, poles: Complex) -> Pole:
        """Return a critical speed with the outputs that have a pole there, by their principal parts on a circle."""
        apart = np.abs(poles - speed)
        apart = apart[apart > max(2.0 * error, TOLERANCES.peak_speed * speed)]
        halves = [piece.half for piece in self.pieces if piece.start <= speed <= piece.stop]
        radius = TOLERANCES.circle_of_pole * min(float(np.min(apart, initial=np.inf)), speed, *halves)
        count = TOLERANCES.points_about_pole
        around = speed + radius * np.exp(2j * np.pi * np.arange(count) / count)
        values = self.values(around)
        # The power -k of the distance is the harmonic -k on the circle, and count - k; halfway both kinds mix.
        principal = np.max(np.abs(np.fft.fft(values, axis=1)[:, -(count // 4) :]), axis=1) / count
        reached: Flags = principal > TOLERANCES.principal_part * np.max(np.abs(values), axis=1)
        return Pole(speed, error, reached, around, values)


def _pieces(sample: Callable[[float], Complex], start: float, stop: float, whole: float) -> Iterator[_Piece]:
    """Yield pieces of a range, of a `whole` one, on which polynomials agree with a function at further points."""
    piece, before = None, np.inf
    for degree in TOLERANCES.degrees_over_spin:
        t = chebpts2(degree + 1)
        values = np.array([sample(x) for x in _places(start, stop, t)])
        inverse = np.linalg.inv(chebvander(t, degree))
        piece = _Piece(start, stop, np.tensordot(inverse, values, 1), 0.0)
        further = chebpts2(2 * degree + 1)[1::2]  # the others are those above
        exact = np.array([sample(x) for x in _places(start, stop, further)])
        off = float(np.max(np.abs(piece.at(further) - exact)))
        least = max(TOLERANCES.rounding_of_interpolation * float(np.max(np.abs(values))), off)
        if off <= TOLERANCES.interpolated * float(np.max(np.abs(values))):
            last = np.flatnonzero(np.max(np.abs(piece.coefficients), axis=(1, 2)) > least)[-1]
            yield _Piece(start, stop, piece.coefficients[: last + 1], off)
            return
        if off > TOLERANCES.converges * before:
            break
        before = off
    middle = 0.5 * (start + stop)
    if stop - start <= TOLERANCES.narrowest_piece * whole:
        assert piece is not None
        yield piece
        return
    yield from _pieces(sample, start, middle, whole)
    yield from _pieces(sample, middle, stop, whole)


def _places(start: float, stop: float, t: Array) -> list[float]:
    inside = 0.5 * (start + stop) + 0.5 * (stop - start) * t
    return [float(x) for x in np.where(t == -1.0, start, np.where(t == 1.0, stop, inside))]


def _groups(t: Complex, reach: float) -> Iterator[Complex]:
    """Yield numbers in groups whose members are at most so far apart along the real axis."""
    order = np.argsort(t.real)
    yield from np.split(t[order], 1 + np.flatnonzero(np.diff(t.real[order]) > reach)) if len(t) else ()
