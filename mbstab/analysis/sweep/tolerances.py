"""What is told apart in a sweep, and how many points are looked at."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of sweeps."""

    __slots__ = ()

    # Equations and spectra of many points together
    newton_steps_polishing: Final = 20
    """Newton steps from a predicted equilibrium …"""
    newton_step_polished: Final = 1e-7
    """… and the size of the last one: what it leaves is its square."""
    normal_equations_ridge: Final = 1e-14
    """Normal equations are regularized by this part of their trace."""
    roundings_of_matrix: Final = 4.0
    """Matrices are known to so many roundings of their norms."""
    direction_closure: Final = 1e-10
    """S leads directions of symmetries out of their span by less than this part of its norm."""
    block_entries: Final = 600_000
    """Entries of a matrix over all points evaluated together: enough to hide Python, few enough for the caches."""
    points_with_terms: Final = 17
    """At so many points of a block the terms of which matrices are sums are formed."""
    points_guarded: Final = 9
    """At so many points of a sweep, spread over it, the motion is checked to stand still in its frame."""
    neutral_elsewhere: Final = 1e-6
    """Eigenvalues below this part of the largest are left out where those of other points are neutral."""
    points_of_lonely_pattern: Final = 8
    """A pattern that fits no more points than this is a lonely one …"""
    lonely_patterns: Final = 4
    """… and after so many of them in a row the other points are answered one by one."""
    points_asked_for_zeros: Final = 100
    """Points at which many digits are asked whether eigenvalues are zero; where there are more, none is."""
    undecided_in_a_row: Final = 2
    """Points of a kind are left undecided when the code of `mbstab eig` decides none of so many in a row."""

    # Sides of the imaginary axis
    bounds_from_axis: Final = 10.0
    """An eigenvalue is placed if it is so many times its bound away from the axis."""
    bounds_apart: Final = 16.0
    """First-order bounds hold if eigenvalues are apart by so many times the largest of them, and their number."""
    parallel_vectors: Final = 1e12
    """Vectors with an inverse of a larger norm say nothing."""
    slow_eigenvalue: Final = 1e-7
    """Eigenvalues below this part of the largest have lost digits in A and come from its inverse."""
    unexplained_zero: Final = 1e-5
    """Zeros that nothing explains are below this part of the norm of the matrix."""

    # Eigenvalues that are followed from point to point
    tracking_step: Final = 0.35
    """Between neighbouring points an eigenvalue moves by less than this part of its distance to the others."""
    twin_distance: Final = 1e-9
    """Eigenvalues closer than this part of the largest are equal, if they are so at both ends of an interval."""
    intervals_together: Final = 20_000
    """Intervals that are compared together."""
    crossing_interval: Final = 1e-12
    """Eigenvalues that are not told apart in an interval of this relative width cross or collide in it."""
    meeting_interval: Final = 1e-6
    """Where eigenvalues meet is known if the interval is narrower than this part of the parameter."""
    meeting_rounding: Final = 1e-7
    """So near to a meeting, relative to the parameter, rounding may show a pair on the wrong side."""
    direction_difference: Final = 1e-6
    """Where eigenvalues meet, their directions are taken over this part of the parameter's value."""
    branch_split: Final = 8
    """Parts into which an interval is divided in which eigenvalues cannot be followed."""
    branch_parts_crowded: Final = 150
    """An interval with more parts in which eigenvalues cannot be followed is not divided further: they are rounding."""
    branch_points: Final = 100_000
    """So many points in between are looked at at most …"""
    branch_eigenvalues: Final = 4_000_000
    """… and so many eigenvalues of them are kept."""
    branch_looks: Final = 5_000
    """Points in between are looked at so many times at most …"""
    branch_looks_of_judgement: Final = 8
    """… where to judge one as `mbstab eig` does counts as so many."""

    # Critical values
    collision_side: Final = 1e-3
    """So far from a collision, relative to the parameter, the modes that meet are told apart."""
    test_function_zero: Final = 1e-6
    """A test function is zero where it is this small beside its values at the ends of the interval."""
    spectrum_ratio: Final = 100.0
    """Spectra are compared by products of eigenvalues if their sizes are within this factor …"""
    interval_width: Final = 0.1
    """… or the parameter changes by less than this part of it."""
    change_beside: Final = 0.1
    """The number of unstable eigenvalues is compared at this part of the way to both ends of the interval."""
    jump_parts: Final = 32
    """Parts into which an interval is divided in which a test function jumps …"""
    jump_depth: Final = 6
    """… and how often."""
    points_beside: Final = 2
    """So many points on either side are looked at with an interval in which stability may change."""
    points_fewest: Final = 24
    """Sweeps with fewer points are looked at between them as well."""
    interval_ratio: Final = 100.0
    """Ends of an interval whose ratio is larger are divided evenly by ratio."""
    beyond_range: Final = 1e-4
    """So far beyond a range, relative to the parameter, is seen what happens at its end …"""
    at_end_of_range: Final = 1e-9
    """… and so near it happens there."""
    potential_misfit: Final = 1e-8
    """Forces have a potential if K is symmetric and R antisymmetric to this."""
    edge_halvings: Final = 40
    """Halvings of an edge: to 1e-12 of it."""

    # Blocks
    block_points: Final = 25_000
    """Points of a block at most …"""
    block_points_least: Final = 1_000
    """… and at least: fewer would take little longer than what a block costs by itself."""
    block_time: Final = 5.0
    """Estimated time of a block between these limits (s)."""
    point_time: Final = 0.35e-6
    """Time of a point for each square of the number of coordinates (s); measured for 15 to 240 of them."""
    blocks_ahead: Final = 2
    """Blocks that each worker has: one that it computes, and one to go on with."""
    block_retries: Final = 3
    """A block whose worker died is computed again so many times."""


TOLERANCES = Tolerances()
