"""Tolerances of the discs that contain eigenvalues for zero, equal and known, and limits of their work."""

from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the discs that contain eigenvalues."""

    __slots__ = ()

    # Errors of the matrices
    inverse_refined: Final = 1e-12
    """The pseudo-inverse of rows on speeds is refined where a product with it misses the identity by more than this."""
    magnified_rounding: Final = 1e3
    """Stiff rows on speeds magnify the rounding along neutral directions where it is so many times as large."""
    slowest_rate_of_errors: Final = 1e-10
    """Rates below this fraction of the typical one cannot be told from zero."""

    # Bounds of eigenvalues
    schur_from_symmetries: Final = 30
    """Number of symmetries from which on one Schur form is cheaper than least squares for each eigenvalue."""
    eigenvalue_of_neutral: Final = 1e-4
    """Eigenvalues farther from those of T than this fraction of S on T are not among them."""
    slow_eigenvalue: Final = 1e-8
    """Eigenvalues smaller than this fraction of the largest have lost half of their digits in the matrix."""
    joining_rounds: Final = 40
    """Rounds of joining eigenvalues that cannot be told apart."""
    other_method_distance: Final = 10.0
    """A value of another method is wrong if it is this many times farther from an eigenvalue than its vector allows."""
    cluster_singular_value: Final = 1e-11
    """Vectors of a cluster span its subspace if the smallest singular value of their unit vectors is larger."""
    roundings_of_block: Final = 4.0
    """The entries of a block are known to so many roundings, and so is its resolvent."""
    cluster_circle_points: Final = 48
    """Number of points of a circle on which a block is shown to have no eigenvalue …"""
    cluster_circle_product: Final = 0.8
    """… because a spectral radius that must be less than 1 is less than this."""
    vector_improvements: Final = 4
    """Rounds of improving vectors."""
    coupling_in_bound: Final = 0.1
    """Coupling to others may add this fraction to the bound of an eigenvalue before vectors are improved."""
    turn_product: Final = 0.1
    """Two vectors are not decoupled by a correction if the product of both angles is larger."""
    relative_bound_refined: Final = 100.0 * EPS
    """Eigenvalues with larger relative error bounds are refined, each by itself."""
    bound_beyond_data: Final = 10.0
    """A cluster is refined if the bound from data errors alone is this many times smaller …"""
    relative_bound_refined_at_zeros: Final = 1e-12
    """… and beside structural zeros also if the relative error bound is larger than this."""
    coupling_of_pair: Final = 0.3
    """Two eigenvalues are judged together if their coupling exceeds this fraction of their distance."""
    parallel_vectors: Final = 1e-6
    """Vectors of equal eigenvalues are independent if the smallest singular value of their unit vectors is larger."""
    defective_distance: Final = 1e-3
    """Eigenvalues of a cluster with parallel vectors differ by less than this, relatively."""
    radii_of_eigenvector: Final = 2.0
    """A vector of a cluster is an eigenvector if it is one for an eigenvalue at this many radii from the centre."""
    radius_powers: Final = 20
    """Powers of a matrix that bound its spectral radius, before its eigenvalues are computed."""

    # Spectra of large scenes
    sparse_disc_distance: Final = 0.1
    """Discs and corrections are smaller than this fraction of the distance to the nearest eigenvalue, or both are
    joined."""
    momentum_misfit: Final = 1e-9
    """Tolerance within which T and L are positions and their momenta."""
    equal_eigenvalues: Final = 1e-7
    """Eigenvalues that differ by less than this, relatively, are judged together."""
    second_order_in_bound: Final = 1.0
    """Vectors are improved where the second order is more than this many times the first."""
    sparse_joining_rounds: Final = 12
    """Rounds of joining eigenvalues that cannot be told apart."""
    eigenvectors_at_once: Final = 64
    """Eigenvectors that are processed at once."""


TOLERANCES = Tolerances()
