"""What is distinguished in a sweep, and how many points are computed."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of sweeps."""

    __slots__ = ()

    # Equations and spectra of many points together
    roundings_of_matrix: Final = 4.0
    """Matrices are known to this many roundings of their norms."""
    direction_closure: Final = 1e-10
    """S maps directions of symmetries out of their span by less than this fraction of its norm."""
    block_entries: Final = 600_000
    """Entries of a matrix over all points evaluated together: enough to amortize Python, few enough for the caches."""
    points_with_terms: Final = 17
    """Number of points of a block at which the terms of the matrices are formed …"""
    points_tried_for_errors: Final = 17
    """… and at which it is tried to propagate the rounding of the file, from both ends on, until one has any."""
    points_with_errors: Final = 6
    """Number of points at which that is done, at most: these two, and others …"""
    errors_alike: Final = 100.0
    """… between two points at which it differs by more than this factor."""
    unknown_error: Final = 1e100
    """Stands for the error of an entry without a bound: no side and no sign is known beside it."""
    points_guarded: Final = 9
    """Number of points, spread over a sweep, at which the motion is checked to be steady in its frame."""
    logarithms: Final = (-700.0, 700.0)
    """Test functions whose logarithms are beyond these are as small or as large as numbers can be."""
    neutral_elsewhere: Final = 1e-6
    """Eigenvalues below this fraction of the largest are left out where those of other points are neutral."""
    place_of_home: Final = 0.37
    """The pattern of the point at this fraction of a sweep is tried first at all of them."""
    points_of_lonely_pattern: Final = 8
    """A pattern that fits no more points than this counts as isolated …"""
    lonely_patterns: Final = 4
    """… and after this many of them in a row the other points are computed one by one."""
    points_asked_for_zeros: Final = 100
    """Maximum number of points at which eigenvalues are tested for zero with many digits; with more, none is."""
    intervals_asked: Final = 100
    """Maximum number of intervals between points that are looked into where their ends do not tell their verdict, …"""
    parts_asked: Final = (0.1, 0.5, 0.9)
    """… at these parts of them."""
    undecided_in_a_row: Final = 2
    """Points of a kind are left undecided after the code of `mbstab eig` fails to decide this many in a row."""

    # Sides of the imaginary axis
    bounds_from_axis: Final = 10.0
    """An eigenvalue has a side if its distance from the axis is this many times its bound."""
    part_of_margin: Final = 0.8
    """Errors of the data are proven bounds: they are compared with this part of that distance."""
    parallel_vectors: Final = 1e12
    """Vectors whose inverse has a larger norm are useless."""
    slow_eigenvalue: Final = 1e-7
    """Eigenvalues below this fraction of the largest have lost digits in A and come from its inverse."""
    inverse_departure: Final = 1e4
    """An inverse whose norm is larger, relative to its eigenvalues, tells no more of the slow ones than A."""
    unexplained_zero: Final = 1e-5
    """Unexplained zeros are below this fraction of the norm of the matrix."""

    # Eigenvalues that are followed from point to point
    tracking_step: Final = 0.35
    """Between neighbouring points an eigenvalue moves by less than this fraction of its distance to the others."""
    pass_near: Final = 0.5
    """Eigenvalues may meet if they come nearer to each other on straight lines than this fraction of their approach."""
    uncoupled: Final = 1e-12
    """Entries of a matrix below this fraction of its eigenvalues are rounding."""
    other_vectors: Final = 0.5
    """Eigenvectors are those of another point if less than this part of each lies along others."""
    points_with_vectors: Final = 32
    """Points whose eigenvectors are computed together."""
    twin_distance: Final = 1e-9
    """Eigenvalues closer than this fraction of the largest are equal, if they are so at both ends of an interval."""
    twin_rounding: Final = 1e-13
    """Eigenvalues closer than this fraction of the largest are equal up to rounding."""
    intervals_together: Final = 20_000
    """Intervals that are compared together."""
    crossing_interval: Final = 1e-12
    """Eigenvalues that are not separated in an interval of this relative width cross or collide in it."""
    meeting_interval: Final = 1e-6
    """A meeting of eigenvalues is located if the interval is narrower than this fraction of the parameter."""
    meeting_part: Final = 0.02
    """Where two eigenvalues seem to meet, points are computed at this fraction of the interval on both sides."""
    meeting_rounding: Final = 1e-7
    """Nearer to a meeting than this, relative to the parameter, rounding may show a pair on the wrong side."""
    pole_reach: Final = 128.0
    """Where eigenvalues become infinite is told by points up to so many times the interval in which none is known …"""
    pole_points: Final = 4
    """… on either side of it, so many on each side, each half as far away …"""
    pole_distances: Final = 8
    """… of so many at which the eigenvalues are looked at."""
    direction_difference: Final = 1e-6
    """Where eigenvalues meet, their directions are taken over this fraction of the parameter's value."""
    branch_split: Final = 8
    """Parts into which an interval is divided in which eigenvalues cannot be followed."""
    branch_parts_crowded: Final = 150
    """An interval with more parts in which eigenvalues cannot be followed is not divided further: they are rounding."""
    branch_points: Final = 100_000
    """Maximum number of intermediate points …"""
    branch_points_each: Final = 2
    """… far from the axis for each point of the sweep …"""
    branch_eigenvalues_least: Final = 2_000
    """… or with so many eigenvalues, if these are more …"""
    branch_locating: Final = 8
    """… or this many times as many where meetings are asked for …"""
    branch_eigenvalues: Final = 4_000_000
    """… and of their eigenvalues that are kept."""
    branch_looks: Final = 5_000
    """Maximum work at intermediate points, in evaluations …"""
    branch_looks_of_judgement: Final = 8
    """… of which judging one as `mbstab eig` does counts as this many …"""
    branch_looks_alone: Final = 50
    """… and one that is computed by itself because no pattern fits it as this many."""

    # Critical values
    search_beside: Final = 3
    """Number of points on each side of a guess at which the eigenvalues are computed with it."""
    collision_side: Final = 1e-3
    """Distance from a collision, relative to the parameter, at which the modes that meet are distinguished."""
    test_function_zero: Final = 1e-6
    """A test function is zero where it is below this, relative to the mean of those at the ends of the interval."""
    spectrum_ratio: Final = 100.0
    """Spectra are compared by products of eigenvalues if their sizes are within this factor …"""
    interval_width: Final = 0.1
    """… or the parameter changes by less than this, relatively."""
    change_beside: Final = 0.1
    """The number of unstable eigenvalues is compared at this fraction of the way to both ends of the interval."""
    jump_parts: Final = 32
    """Parts into which an interval is divided in which a test function jumps …"""
    jump_depth: Final = 6
    """… and how often."""
    points_beside: Final = 2
    """Number of points on either side that are examined with an interval in which stability may change."""
    turning_points: Final = 9
    """Where a real part approaches the axis and turns back, so many points are looked at from end to end …"""
    turning_rounds: Final = 6
    """… in so many rounds, each between the two points beside the nearest one."""
    points_fewest: Final = 24
    """Sweeps with fewer points get intermediate points everywhere."""
    interval_ratio: Final = 100.0
    """Intervals whose ends have a larger ratio are divided geometrically."""
    beyond_range: Final = 1e-4
    """Distance beyond a range, relative to the parameter, at which the change at its end is tested …"""
    at_end_of_range: Final = 1e-9
    """… and distance within which it counts as being there."""
    potential_misfit: Final = 1e-8
    """Forces have a potential if K is symmetric and R skew-symmetric to this."""
    edge_halvings: Final = 40
    """Bisections of an edge: to 1e-12 of it …"""
    halvings_together: Final = (4, 2, 1)
    """… of which so many are done at once, most first, …"""
    edge_points: Final = 640
    """… as long as these take no more points."""

    # Points between those of a sweep, for pictures
    detail_enough: Final = 2_000
    """Sweeps of more points need none between them."""
    detail_coarse: Final = 300
    """Sweeps of fewer points get more where the curves bend …"""
    detail_points: Final = 300
    """… at most so many …"""
    detail_eigenvalues: Final = 6_000
    """… with so many eigenvalues …"""
    detail_first: Final = 16
    """… and none after the first few if no pattern fits these."""
    detail_bend: Final = 0.003
    """A point is far from the chord of its neighbours if it is this part of the extent of its branch away."""
    detail_smallest: Final = 1e-3
    """The extent of a branch counts as no less than this part of the largest eigenvalue."""
    detail_meeting: Final = 1e-3
    """Eigenvalues that come near to each other are told apart in intervals down to this part of the parameter."""
    detail_narrow: Final = 1e-5
    """Intervals below this part of the range are not divided."""
    detail_apart: Final = 1e-7
    """Points nearer to each other than this part of the range are one."""
    detail_jump: Final = 0.02
    """A branch that moves by more than this part of its extent, where what continues it is open, is interrupted."""

    # Boundaries of charts
    same_place: Final = 1e-9
    """Points of boundaries nearer than this, relative to the ranges, are one …"""
    boundary_turn: Final = 0.95
    """A chart gets more lines where a boundary turns by more than the angle with this cosine …"""
    boundary_parts: Final = 4
    """… so many for each of the old intervals …"""
    boundary_cells: Final = 400
    """… that are longer than this part of the range."""

    # Derivatives of critical values
    slope_reach: Final = 1e-2
    """Steps to both sides, relative to the critical value …"""
    slope_trials: Final = 4
    """… and how often they become four times shorter …"""
    slope_fine: Final = 1e-7
    """… unless the errors are below this, relative to the largest derivative."""
    slope_settled: Final = 1e-4
    """With larger errors there is no derivative."""
    slope_square: Final = 1e-4
    """At the critical value the square of what is zero there is below this fraction of those beside it."""

    # Blocks
    block_points: Final = 25_000
    """Maximum number of points of a block …"""
    block_points_least: Final = 1_000
    """… and the minimum: with fewer, the fixed cost of a block would dominate."""
    block_time: Final = 5.0
    """Estimated time of a block between these limits (s)."""
    point_time: Final = 0.35e-6
    """Time of a point for each square of the number of coordinates (s); measured for 15 to 240 of them."""
    blocks_ahead: Final = 2
    """Blocks that each worker has: one that it computes, and one to go on with."""
    block_retries: Final = 3
    """Number of times that a block whose worker died is computed again."""

    # Orders
    crossing: Final = 1e-10
    """A frequency that differs from its order by more than this fraction at the crossing jumps there."""

    points_of_approach: Final = 8
    """Where a frequency comes near to an order, intervals are divided by so many points …"""
    rounds_of_approach: Final = 4
    """… and so many times."""
    rounds_of_crossing: Final = 2
    """Where a frequency is seen to cross an order, so many of these rounds separate its branch from others."""
    reach_of_dip: Final = 4.0
    """A frequency may reach an order between points if its distance is at most this many times its change there."""

    # Unbalance
    degrees_over_spin: Final = (1, 2, 4, 8)
    """Equations are interpolated over the spin by polynomials of these degrees, …"""
    converges: Final = 0.1
    """… as long as each misses the equations at further spins by no more than this part of the one before, …"""
    interpolated: Final = 1e-11
    """… until they agree to this, relative to the largest entry of balanced matrices, …"""
    narrowest_piece: Final = 1e-5
    """… or on pieces of this part of the range, where they bend."""
    rounding_of_interpolation: Final = 1e-14
    """Terms of polynomials that are no larger than this are rounding."""
    shift_of_poles: Final = 0.13 + 0.71j
    """Poles are found about this point, where a piece goes from -1 to 1; it is as far from both of its ends, nearly."""
    far_pole: Final = 0.05
    """Poles further away than the inverse of this are not looked at."""
    pole_near_axis: Final = 1e-5
    """Poles that are nearer to each other and to the axis than this part of a piece are found again together, …"""
    refinements_of_pole: Final = 3
    """… so many times, from the vectors that belong to them."""
    circle_of_pole: Final = 0.1
    """An output has a pole if its values on a circle of this part of the distance to others, or of the spin, …"""
    points_about_pole: Final = 16
    """… at so many points …"""
    principal_part: Final = 1e-8
    """… have a principal part that is larger than this part of them."""
    peak_places: Final = 17
    """Largest amplitudes are looked for at so many speeds between those asked for, …"""
    on_axis: Final = 1e-9
    """A point is on the spin axis if it is nearer than this fraction of the size of the scene."""
    peak_speed: Final = 1e-7
    """… and their speeds are found to this fraction, …"""
    peak_steps: Final = 30
    """… in at most so many steps."""
    share_of_peak: Final = 0.01
    """Peaks of an unbalance response are told if they are at least this part of the largest."""

    points_of_whirl: Final = 11
    """Points at which the sense of whirl of the branches is looked at …"""
    halvings_of_whirl: Final = 6
    """… and how often the distance of two that differ is halved to locate the change."""

    # Names
    points_followed: Final = 33
    """Points at which eigenvalues are looked at between where a mode is named and where it is asked for …"""
    points_between_names: Final = 5_000
    """… and maximum number of points in between."""
    lines_kept: Final = 50
    """So many ways along a parameter are kept for further questions about the same model."""


TOLERANCES = Tolerances()
