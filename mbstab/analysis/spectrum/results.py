"""The parts of an answer about eigenvalues."""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.spectrum.named_motions import Told
from mbstab.analysis.verdict.rule import Judged, Verdict
from mbstab.model.schema import is_state
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.mode_energy import EnergyBalance


@dataclass(frozen=True)
class Eigenvalue:
    """One finite eigenvalue.

    Attributes
    ----------
    value : complex (1/s)
    kind : str
        ``stable node``, ``unstable node``, ``saddle``, ``stable focus``, ``unstable focus``,
        ``center``, ``neutral`` (explained by a symmetry or a family), ``critical`` (zero, judged by nonlinear terms),
        or ``undecided``.
    error_bound : float (1/s)
        Radius of the disc that contains it; nan for neutral eigenvalues, which are exact by structure.
    condition, backward_error : float
        Relative condition number κ and backward error η.
    participation : dict
        Share of each body in the kinetic energy of the mode; sums to 1, or is 0 where no mass moves. Empty without a
        `vector`.
    multiplier : complex or None
        For a periodic motion: the factor of a disturbance in a period; `value` is then
        the Floquet exponent.
    vector : ndarray of complex, shape (n_q,), or None
        Mode shape (m, rad), in the order of `EigenResult.coordinates`; the coordinate that moves most,
        lengths relative to the size of the scene, is 1. None for neutral eigenvalues and multipliers, and where an
        eigenvalue is not told from others that have fewer shapes than they are, as of a defective one. In a mode of
        first-order states alone (`EigenResult.moves_bodies`) bodies have exact zeros.
    motions : tuple of (str, complex)
        The mode in few words: independent motions of joints, such as ``angle(pivot)``, and coordinates that are not
        small, with amplitudes relative to the size of the scene or 1 rad; the first is the largest, and 1.
    whirl : str
        ``forward``, ``backward`` or ``mixed``: sense in which bodies that spin whirl; empty if none does.
    name : str
        The name that the file gives the mode under ``modes``; empty if none.
    energy : EnergyBalance or None
        Energies and powers, entry by entry, if they are asked for, the eigenvalue is known not to be zero, and a body
        moves.
    together : int
        Number of eigenvalues in its disc: these are not told apart.
    """

    value: complex
    kind: str
    error_bound: float
    condition: float
    backward_error: float
    participation: dict[str, float] = field(default_factory=dict)
    multiplier: complex | None = None
    vector: Complex | None = field(default=None, compare=False, repr=False)
    motions: Told = field(default=(), compare=False, repr=False)
    whirl: str = field(default="", compare=False)
    name: str = field(default="", compare=False)
    energy: EnergyBalance | None = field(default=None, compare=False, repr=False)
    together: int = field(default=1, compare=False)

    @property
    def exact(self) -> bool:
        """Whether it is known exactly, so that it has no digits of its own: neutral, or a critical zero."""
        return self.kind in ("neutral", "critical")

    @property
    def significant(self) -> complex:
        """The value (1/s); of a center and of what is undecided or neutral without the parts that may be zero."""
        real, imag = self.value.real, self.value.imag
        if self.kind == "center":
            return complex(0.0, imag)
        if self.kind == "critical":
            return 0j
        if self.kind not in ("undecided", "neutral") or not math.isfinite(self.error_bound):
            return self.value
        return complex(*(x if abs(x) > self.error_bound else 0.0 for x in (real, imag)))

    @property
    def frequency(self) -> float:
        """Frequency of oscillation |Im s|/2π (Hz)."""
        return abs(self.value.imag) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """−Re s/|s|, nan for a neutral or critical eigenvalue."""
        return -self.value.real / abs(self.value) if not self.exact and self.value else math.nan

    @property
    def time_to_double(self) -> float:
        """Time in which a disturbance doubles (s); negative: time in which it halves; inf if it does neither."""
        if self.exact or self.kind == "center" or self.value.real == 0.0:
            return math.inf
        return math.log(2.0) / self.value.real


@dataclass(frozen=True)
class Counts:
    """Sizes of the problem.

    Attributes
    ----------
    n_q, n_holonomic, n_nonholonomic : int
        Coordinates and constraint rows.
    rank_holonomic, rank_nonholonomic : int
        rank C_q and rank D_u N.
    expected, found : int
        Finite eigenvalues: 2(n_q − rank C_q) − rank(D_u N), less those that directions without mass take away, and
        the number that the method returned.
    neutral : int
        Number of neutral eigenvalues.
    infinite, undefined : int
        Infinite eigenvalues and 0/0 pairs that the method also returned.
    extra : int
        Eigenvalues of constraint drift that the method also returned: two for each independent
        holonomic row, one for each nonholonomic one.
    extra_error : float (1/s)
        Largest distance of one of these from its exact value: 0, or ±iω where a
        constraint rotates with the frame.
    unstable_proven : int or None
        Number of eigenvalues right of the imaginary axis, counted without computing them; only where
        a few are computed. None: not counted.
    counted : str
        How they are counted, or why not; empty: not requested.
    critical : int
        Number of critical zeros.
    massless : tuple of str
        Directions without mass: algebraic ones, which take two from `expected`, and those of first order, which take
        one.
    states : int
        How many of the coordinates are first-order states, each with a nonholonomic row for its rate.
    """

    n_q: int
    n_holonomic: int
    n_nonholonomic: int
    rank_holonomic: int
    rank_nonholonomic: int
    expected: int
    found: int
    neutral: int
    infinite: int
    undefined: int
    extra: int = 0
    extra_error: float = 0.0
    unstable_proven: int | None = None
    counted: str = ""
    massless: tuple[str, ...] = ()
    critical: int = 0
    states: int = 0

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent speeds."""
        return self.n_q - self.rank_holonomic - self.rank_nonholonomic


@dataclass(frozen=True)
class EigenResult(Judged):
    """Eigenvalues, the verdict and its grounds.

    Attributes
    ----------
    eigenvalues : list of Eigenvalue
        Sorted by decreasing real part, neutral ones last.
    judged : Verdict
        The verdict, with what it rests on.
    counts : Counts
    method : str
    warnings : tuple of str
        Warnings about the model and the numbers, including those of the verdict.
    frame : str
        The frame in which the equations are constant, in words; empty: the coordinates of the file.
    shifts : tuple of float
        ω of neutral pairs ±iω: shifts that rotate with the frame.
    period : float or None
        Period of a motion that is judged by its Floquet multipliers (s).
    frozen : bool
        Whether these are frozen-time eigenvalues, which say nothing about stability.
    coordinates, units : tuple of str
        Names and units of the entries of the vectors.
    neutral_directions : tuple of str
        What the neutral eigenvalues belong to, in words, whatever the verdict.
    """

    eigenvalues: list[Eigenvalue]
    judged: Verdict
    counts: Counts
    method: str
    warnings: tuple[str, ...]
    frame: str = ""
    frozen: bool = False
    shifts: tuple[float, ...] = ()
    period: float | None = None
    coordinates: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    neutral_directions: tuple[str, ...] = ()

    def values(self) -> Complex:
        """Return the eigenvalues that are neither neutral nor critical, shape (n,)."""
        return np.array([e.value for e in self.eigenvalues if not e.exact], dtype=complex)

    def moves_bodies(self, e: Eigenvalue) -> bool:
        """Return whether a mode with a shape moves bodies; else it is one of first-order states alone."""
        bodies = [not is_state(name) for name in self.coordinates]
        return e.vector is not None and bool(np.any(e.vector[bodies]))
