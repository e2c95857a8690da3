"""What the algebra takes for zero, for equal, for converged, and how much work it does.

Every wing of the analysis has such a module, and its numbers nowhere else. The class is a plain one with read-only
attributes: a dataclass of as many fields takes milliseconds at every start.
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
    """A rank is trusted if the other singular values are above this, as nothing is built more exactly …"""
    rank_gap: Final = 1e3
    """… and if the two next to the decision differ by this factor at least."""

    # Eigenpairs that are refined by Newton's method in double precision
    roundings_of_entry: Final = 4.0
    """An entry of a matrix is known to so many roundings of the largest term beside it."""
    newton_steps_eigenpair: Final = 6
    """Newton steps on an eigenpair at most; most need two."""
    balancing_rounds: Final = 4
    """Rounds in which rows and columns of a linear system are scaled to equal size."""
    sparse_from_size: Final = 200
    """Matrices with so many rows or more are stored as sparse ones."""

    # Sparse factors
    columns_at_once: Final = 128
    """Columns that are worked on at once."""
    sparse_derivatives_from: Final = 600
    """From so many coordinates on derivatives of bases are sparse."""
    row_shift: Final = 1e-8
    """Shift δ for rows of unit length: inverse iteration tells larger singular values from each other."""
    row_weight_dependent: Final = 1e-7
    """A row takes part in a combination that vanishes if its weight is larger; the rank decision said that one
    exists."""
    entry_rounding: Final = 4.0 * EPS
    """Entries of rows are known to this."""
    inertia_error: Final = 0.1
    """What factors miss, and what entries are not known to, may be this part of the smallest singular value."""
    dense_null_space: Final = 1500
    """Up to so many coordinates a dense null space serves where the sparse factors do not."""
    inertia_iterations: Final = 6
    """Steps of inverse iteration for the smallest singular value …"""
    inertia_vectors: Final = 4
    """… and its vectors."""
    dense_operator: Final = 160
    """Operators of this size are made a dense matrix: all of their eigenvalues are as fast as a few."""
    finite_operator_value: Final = 1e-9
    """What is smaller than this part of the largest μ of a dense operator belongs to infinite eigenvalues."""
    vector_corrections: Final = 1
    """Steps of iterative refinement for vectors."""

    # Ranks of sparse rows
    rank_iterations: Final = 5
    """Rounds of inverse iteration."""
    singular_values_at_once: Final = 8
    """So many singular values are looked for at once, and twice as many as long as all of them vanish."""
    direction_unseen: Final = 1e-8
    """Directions that matrices send to less than this are sent to zero."""

    # Numbers with many digits
    pivot_digits_lost: Final = 0.7
    """A pivot counts as zero if it has lost this part of the digits …"""
    pivot_gap: Final = 0.1
    """… and the decision is trusted if the next one is larger by a further part of them, this one."""
    polished_digits: Final = 0.8
    """A polished number is accepted where steps stop shrinking after this part of the digits."""
    cluster_widths: Final = (1e-7, 1e-4, 1e-2)
    """Eigenvalues closer than this part of the norm are computed together; tried in turn."""

    # Balls
    ball_digits_beyond: Final = 15
    """Digits carried besides those that are asked for."""
    ball_width_interval: Final = 1e-12
    """Balls that are wider than this, relative to their middle, are intervals, not numbers with a rounding error."""
    sparse_pivot: Final = 0.1
    """A pivot may be smaller than the largest by this factor if it fills in less."""
    determinant_summed_size: Final = 6
    """Up to so many rows determinants are sums of products: of wide balls these are narrower than elimination."""

    # Work
    estimated_memory: Final = 1e9
    """What is estimated to take more memory is refused (bytes), unless it is forced."""
    estimated_time: Final = 10.0
    """What is estimated to take longer is refused (s), unless it is forced …"""
    estimated_time_of_spectrum: Final = 60.0
    """… and so is a spectrum that is estimated to take longer than this (s)."""


TOLERANCES = Tolerances()
