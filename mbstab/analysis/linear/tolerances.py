"""Tolerances of the linearized equations for zero, equal and known, and limits of their work."""

from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the linearized equations."""

    __slots__ = ()

    # Errors of the matrices
    balance_zero: Final = 1e-12
    """Along a direction without mass, damping or stiffness below this, relative to its terms, is zero."""
    pushing_part: Final = 1e-6
    """Stiffness along a direction without mass that is complex by more than this part of it lets it run away."""
    direction_rounding: Final = 100.0 * EPS
    """Accuracy of computed directions without mass, relative to their length."""
    roundings_of_sum: Final = 2.0
    """A sum of products has this many roundings of its terms as error, and one more for four times as many terms."""
    loose_direction: Final = 1e-13
    """Unknowns whose error may exceed this are changed jointly along one direction …"""
    loose_directions: Final = 8
    """… of which this many are kept separately."""
    row_rounding: Final = 1e-9
    """Entries of rows smaller than this fraction of their terms are rounding."""
    angle_difference: Final = 1e-6
    """Step of finite differences of the frame by angles (rad)."""

    # Other methods
    inverse_steps: Final = 3
    """Steps of inverse iteration; the best vector is taken, as later ones may be worse (Peters and Wilkinson 1979)."""
    qz_attempts: Final = 6
    """Number of attempts with QZ."""
    finite_eigenvalue: Final = 1e5
    """Eigenvalues larger than this times the typical rate of the system count as infinite."""
    zero_pair: Final = 1e-13
    """A pair α/β with both parts below this times the size of the matrices is 0/0."""

    # Spectra of large scenes
    symmetric_part: Final = 1e-13
    """Asymmetry, relative to the largest entry, below which vectors of the symmetric part are used."""

    # A few eigenvalues of large scenes
    vector_shift: Final = 1e-8
    """Vectors come from factors at this relative distance from an eigenvalue …"""

    # Exact functions
    printed_operations: Final = 100_000
    """Maximum number of operations in all entries, unless it is forced: more fill pages and take minutes to print."""
    simplified_weight: Final = 5000
    """Maximum total weight of the entries that are simplified; the others are printed without."""

    better_scale: Final = 2.0
    """Coordinates have the scale of their own inertia if rates in that of carried ones are so many times as large."""


TOLERANCES = Tolerances()
