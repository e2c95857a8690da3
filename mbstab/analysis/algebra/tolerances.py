"""Tolerances of the algebra for zero, equal and converged, and limits of its work.

Every wing of the analysis has such a module, which holds all its tolerances. The class is a plain one with read-only
attributes: a dataclass of so many fields costs milliseconds at every start.
"""

import sys
from typing import Final

EPS = sys.float_info.epsilon
"""Distance of 1 from the next larger number in double precision."""


class Tolerances:
    """Tolerances, thresholds and limits of the algebra."""

    __slots__ = ()

    # Ranks in double precision
    singular_value_zero: Final = 1e-11
    """Singular values of rows of unit length that are below this count as zero."""
    singular_value_kept: Final = 1e-8
    """A rank is trusted if the other singular values are above this, as no mechanism is built more exactly …"""
    rank_gap: Final = 1e3
    """… and if the two on both sides of the decision differ by at least this factor."""
    light_mass: Final = 1e-12
    """Where rows nearly depend on each other because they move coordinates of less than this part of the largest
    inertia, those are scaled as with this part of it."""
    light_beside_carried: Final = 10.0
    """A coordinate is scaled by the inertia that it carries where its own scale would be so many times as large."""

    # Eigenpairs that are refined by Newton's method in double precision
    roundings_of_entry: Final = 4.0
    """An entry of a matrix is known to this many roundings of its largest term."""
    newton_steps_eigenpair: Final = 6
    """Maximum number of Newton steps on an eigenpair; most need two."""
    balancing_rounds: Final = 4
    """Rounds of equilibration of a linear system."""
    sparse_from_size: Final = 200
    """Matrices with at least this number of rows are stored as sparse ones."""

    # Sparse factors
    columns_at_once: Final = 128
    """Columns that are processed at once."""
    sparse_derivatives_from: Final = 600
    """From this number of coordinates on, derivatives of maps are sparse."""
    row_shift: Final = 1e-8
    """Shift δ for rows of unit length: inverse iteration separates singular values that are larger."""
    row_weight_dependent: Final = 1e-7
    """A row takes part in a vanishing combination if its weight is larger; the rank decision has shown that one
    exists."""
    entry_rounding: Final = 4.0 * EPS
    """Accuracy of the entries of rows."""
    weights_of_rows: Final = (0.7, 1.3, 0.3)
    """Weights with which squares of rows are added to forms that are factored, in turn."""
    inertia_error: Final = 0.1
    """Backward errors of factors and errors of entries may be this fraction of the smallest singular value."""
    moving_part: Final = 1e-3
    """A coordinate determines a motion that is left if it takes part in it by more than this, of the largest part."""
    dense_null_space: Final = 1500
    """Up to this number of coordinates a dense null space is used where sparse factors fail."""
    inertia_iterations: Final = 6
    """Steps of inverse iteration for the smallest singular value …"""
    inertia_vectors: Final = 4
    """… and its vectors."""
    dense_operator: Final = 160
    """Operators up to this size are formed as dense matrices: all eigenvalues then take no longer than a few."""
    dense_spectrum: Final = 1000
    """… up to this size where iterations do not converge, or where all eigenvalues are looked through."""
    subspaces: Final = (1, 4, 10)
    """Subspaces of iterations are enlarged by these factors, in turn …"""
    restarts: Final = 60
    """… if so many restarts do not suffice."""
    finite_operator_value: Final = 1e-9
    """Values μ of a dense operator below this fraction of the largest belong to infinite eigenvalues."""
    vector_corrections: Final = 1
    """Steps of iterative refinement for vectors."""

    # Ranks of sparse rows
    rank_iterations: Final = 5
    """Number of inverse iterations."""
    singular_values_at_once: Final = 8
    """Number of singular values that are computed first; it is doubled as long as all of them vanish."""
    direction_unseen: Final = 1e-8
    """Directions whose image under a matrix is smaller than this are in its null space."""

    # Numbers with many digits
    pivot_digits_lost: Final = 0.7
    """A pivot counts as zero if it has lost this fraction of the digits …"""
    pivot_gap: Final = 0.1
    """… and the decision is trusted if the next pivot is larger by this further fraction of them."""
    polished_digits: Final = 0.8
    """A refined number is accepted if its corrections stop shrinking after this fraction of the digits."""
    slope_steps: Final = 8
    """Most steps of Newton's method for derivatives by parameters; each has the accuracy of the Jacobian."""
    aligned_rounding: Final = 8.0 * EPS
    """Entries of orthonormal bases below this are rounding errors of zero."""
    slope_rounding: Final = 1e-9
    """Derivatives of the reference are accepted if their corrections stop shrinking below this fraction of them."""

    # Identities
    bits_of_identities: Final = 320
    """Bits of balls in which identities are tested at random states."""
    bits_of_combinations: Final = 40
    """Bits to which combinations of fields must be known: data that are rounded decimals have 50."""
    bits_of_zero: Final = 100
    """Bits to which a motion is known whose equations are proven."""

    sines_kept: Final = 500
    """Sines and cosines of so many angles are kept."""

    # Balls
    sparse_pivot: Final = 0.1
    """A pivot may be smaller than the largest by this factor if it causes less fill-in."""
    determinant_summed_size: Final = 6
    """Up to this number of rows, determinants are sums of products: of wide balls these are narrower than pivots."""

    # Work
    estimated_memory: Final = 1e9
    """A task with a larger estimated memory is refused (bytes), unless it is forced."""
    estimated_time: Final = 10.0
    """A task with a longer estimated time is refused (s), unless it is forced …"""
    estimated_time_of_spectrum: Final = 60.0
    """… and so is a spectrum with a longer estimated time than this (s)."""

    search_spread: Final = 8.0
    """Each point beside a guess of a root is so many times as far from it as the one before."""
    search_useful: Final = 8.0
    """A guess was of use if the interval has become so many times narrower."""


TOLERANCES = Tolerances()
