"""Tolerances of the reference motion, of the search for it and its continuation, and of symmetries."""

from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the reference."""

    __slots__ = ()

    # What a reference motion satisfies
    residual: Final = 1e-9
    """A reference satisfies its constraints if the residuals are below this, relative to the sizes in the scene."""
    unbalance: Final = 1e-8
    """At rest, unbalanced forces may have this size relative to the forces that balance."""
    vanishing_derivative: Final = 1e-7
    """A constraint has no derivative where it is smaller than this beside, and vanishes within this part of the scene.
    """
    coordinate_rounding: Final = 100.0 * EPS
    """Accuracy of coordinates, relative to the sizes in the scene."""
    contradiction: Final = 1e-7
    """Accelerations satisfy redundant rows that agree to this, relative to the largest of what they must balance."""
    curvature_of_dependent_rows: Final = 1e-7
    """Dependent rows stay dependent nearby if their curvatures cancel to this."""
    balance_refinements: Final = 3
    """Refinement steps of accelerations and multipliers: after the first, small ones are wrong beside large ones."""
    newton_steps_onto_constraints: Final = 60
    """Newton steps for coordinates and speeds that the file leaves out."""
    assembly_gain: Final = 1e-3
    """Coordinates are given up where a step would reduce the residuals of linear rows by less than this part."""
    assembly_shift: Final = 1e-7
    """Shift δ for steps in large scenes: directions whose singular values are smaller hardly change."""
    contradictions_sought: Final = 6
    """Of more entries that are not satisfied, those that contradict each other are not sought."""
    assembly_rounding: Final = 1e-13
    """A step below this, relative to the sizes in the scene, is rounding: half of it is no better."""
    euler_cosine_refused: Final = 1e-6
    """Euler angles are refused as singular where |cos θ| is below this …"""
    euler_cosine_warned: Final = 0.02
    """… and warned about below this."""
    euler_cosine_chart_left: Final = 0.4
    """The chart is changed where |cos θ| is below this."""
    turned_from_count: Final = 2.0
    """Angles of joints in space count from another half turn where they are further from it than this (rad)."""
    counts_kept: Final = 16
    """Equations of so many half turns are kept."""
    euler_cosine_pinned: Final = 1e-3
    """A body that keeps its chart is refused where |cos θ| is below this."""
    turning_axes: Final = 1e-9
    """A body turns about axes that are independent to this part; its moments are possible if they miss it by less."""
    row_in_loop: Final = 1e-7
    """Rows with larger weights in the one that repeats them are those of its loop."""
    row_repeated: Final = 1e-3
    """Rows repeat others to first order if less than this fraction of them is independent …"""
    closure: Final = 1e-9
    """… and are left out if they contradict them by less than this, relative to the size of the loop …"""
    closure_rounding: Final = 1e-13
    """… but by more than this, which is rounding."""
    row_independent_part: Final = 1e-7
    """A row is redundant if less than this fraction of it is independent of the others."""

    # Scenes at rest with sparse matrices
    multiplier_corrections: Final = 2
    """Steps of iterative refinement of the multipliers."""
    massless: Final = 1e-13
    """Motions with less mass than this, in scaled coordinates, carry none."""
    rounding_of_mass: Final = 1e-28
    """Motions with no more mass than this, in scaled coordinates, carry none, whatever the others carry."""
    drawn_roundings: Final = 4
    """Number of random draws of the signs of rounding errors …"""
    drawn_rounding_size: Final = 2.0**-22
    """… and their relative size where their effect is estimated."""
    rest_rounding: Final = 8.0 * EPS
    """Rounding of forces and coordinates, relative to the sizes of their terms."""
    curvature_rounding: Final = 1e-12
    """Curvatures smaller than this fraction of those of all rows are rounding."""
    curvature_probes: Final = 3
    """Number of motions along which the curvatures of dependent rows are checked."""

    # Whether coefficients are constant along the motion
    variation_along_motion: Final = 1e-8
    """Coefficients that change less than this along the motion, relative to their size, count as constant."""
    variation_told: Final = 1e-3
    """A change below this is printed together with the threshold."""
    guard_turn: Final = 0.3
    """Coefficients are compared after a turn by this angle (rad) and a travel by this fraction of the scene's size."""
    generator_misfit: Final = 1e-9
    """Speeds follow a generator if they differ from it by less than this, relative to the largest."""

    # Newton's method for equilibria and steady motions
    newton_reach: Final = 0.5
    """No step is longer than this fraction of the size of the scene, or this angle (rad) …"""
    newton_trusted_nonlinearity: Final = 0.4
    """… unless the change so far agreed with the derivatives, to this fraction of it …"""
    newton_reach_growth: Final = 10.0
    """… and then at most this many times the last one."""
    newton_residual_polished: Final = 1e-9
    """Residuals below this, relative to what balances, are polished by undamped steps until they stop falling."""
    newton_step_settled: Final = 0.01
    """At balance, the next step is no longer than this fraction of the size of the scene, or this angle (rad)."""
    rounding_varies: Final = 100.0
    """Residuals that are rounding are no larger than so many times those of a state beside."""
    newton_left_out: Final = 1e-11
    """Steps leave out directions along which the equations change by less than this, relative to the largest change."""
    newton_steps_to_halve: Final = 12
    """Newton's method continues while it halves the residuals within this many steps."""
    slowest_settling: Final = 0.9
    """Towards a multiple solution steps become shorter by this factor or less, and residuals fall: up to tenfold."""
    valley_gap: Final = 1e3
    """Forces along the walls of a valley change at least so many times as much as those along its floor."""
    valley_descent: Final = 1e-3
    """A step along the floor takes away this part of the residual, if it is not shortened."""
    valley_shortest: Final = 1e-6
    """Steps along the floor are not shortened below this part."""
    steps_to_floor: Final = 4
    """Steps back to the floor after each step along it."""
    move_scaling_forces: Final = 1e-5
    """Where no force acts, the scale is that of the forces after a move by this fraction of the size of the scene."""
    relaxed_residual: Final = 1e-3
    """A relaxed motion is handed to Newton's method at residuals below this; if that fails, at a tenth of them."""
    relaxation_steps: Final = 200
    """Maximum number of steps of a heavily damped motion towards rest."""
    spin_up_steps: Final = 40
    """Maximum number of steps in which given rates are raised from rest."""
    search_ran_off: Final = 10.0
    """A search has diverged if it ends more than this many sizes of the scene, or rad, from its start."""
    other_position: Final = 0.1
    """So many sizes of the scene from where a search ended it is seen whether a force changes with the position."""
    speed_of_curves: Final = 1e-3
    """Curves are read at another speed than that of the body if the two differ by more than this part."""
    gap_of_constraints: Final = 1e-6
    """Constraints with residuals above this fraction of the size of the scene are not satisfied."""
    sharpened_coordinate: Final = 1e-6
    """Coordinates that move by less than this in all directions that gain no digits are determined."""
    sharpened_from: Final = 1e6
    """Solutions are found with more digits where rounding is magnified by more than this, in scaled coordinates …"""
    sharpened_digits: Final = 34
    """… and with so many."""
    sharpened_residual: Final = 1e-27
    """What is left of residuals then, relative to the forces that balance."""
    spread_searched: Final = (1e-9, 0.1, 17)
    """From where to where, relative to the size of the scene, and at how many places, multiple solutions may spread."""
    isolated_singular_value: Final = 1e-7
    """A solution is not isolated if a singular value of the equations is below this, relative to the largest."""

    # Paths of solutions that are followed over a parameter
    path_first_step: Final = 1.0 / 16.0
    """First step, as a fraction of the range or of the size of the scene, or as an angle (rad)."""
    path_least_step: Final = 1e-12
    """A solution is lost if no step of this length leads further."""
    path_prediction_error: Final = 0.02
    """Allowed error of a prediction, as a fraction of the size of the scene or as an angle (rad)."""
    path_turn_cosine: Final = 0.985
    """Cosine of the angle by which the tangent may turn in a step."""
    path_newton_steps: Final = 25
    """Newton steps from a prediction …"""
    path_last_newton_step: Final = 1e-8
    """… and the size of the last one: what it leaves is its square."""
    path_residual_rounding: Final = 1e-14
    """Residuals below this are rounding …"""
    path_step_rounding: Final = 1e-4
    """… where the step is below this."""
    parameter_difference: Final = 1e-6
    """Step of the derivatives by the parameter, as a fraction of the range."""
    path_singular_value: Final = 1e-9
    """Along the path and along symmetries the equations change by less than this, relative to the largest change."""
    branching_singular_value: Final = 1e-5
    """At a fold another path branches off if the equations are dependent to this."""
    path_turning_slope: Final = 1e-9
    """A fold is where the parameter changes by less than this along the path: its error there is the square."""
    points_left_out: Final = 3
    """So many points near those of the row beside are left out if a step fits without them."""
    step_beyond_lead: Final = 1.5
    """A row is followed beyond the points of the one beside it by so many times the last step there, at first."""
    entries_at_curve_points: Final = 3_000_000
    """Points of a curve are computed at once as long as their matrices have no more entries than this."""
    fold_halvings: Final = 20
    """Points added at a fold, each at half the distance: coordinates vary as a square root of the parameter there."""
    folds_of_path: Final = 10
    """Maximum number of folds through which a path is followed …"""
    points_between_folds: Final = 5000
    """… and of points between two of them."""
    path_evaluated_numbers: Final = 100_000
    """Maximum number of coordinates and rows that are evaluated for a curve, over all evaluations …"""
    path_evaluations: Final = 2_500
    """… but at least this many evaluations of the equations are allowed."""
    pole_size: Final = 1e4
    """Where positions exceed this many times the size of the scene …"""
    pole_points: Final = 5
    """… this number of points tells whether a pole is ahead …"""
    pole_error: Final = 1e-6
    """… and where, to within this fraction of the range …"""
    pole_resolution: Final = 1e-13
    """… which is never smaller than this."""
    pole_share: Final = 0.1
    """Coordinates become infinite there if they are at least this fraction of the largest, relative to their sizes."""
    pole_names: Final = 2
    """So many of them are named."""
    beyond_the_end: Final = (1e-9, 1e-6)
    """The equations end with a path if they have no value at these lengths ahead."""
    kink_step: Final = 1e-6
    """A path is continued this fraction of the range beyond a kink, if the solution moves by little more."""
    crossing_distance: Final = 1e-6
    """The place of a crossing is known to the square of this."""
    growth_at_pole: Final = 3.0
    """Between solutions the equations have a pole where their derivative is so many times as large …"""
    pole_distance: Final = 1e-4
    """… and as large as at this distance from it, up to which points are computed."""
    branch_step: Final = 1e-3
    """Distance from a branch point at which another path is started."""
    equal_solutions: Final = 1e-9
    """Solutions are the same if their positions are, and their parameters to this fraction of the range."""
    turn_neighbourhood: Final = 1e-7
    """Distance from a fold at which the path is used, as a fraction of its range."""
    columns_across: Final = (0.5, 0.25, 0.75)
    """Of neighbouring columns those at these parts of their number are tried on the way to a row beside."""
    parameter_halvings: Final = 40
    """Bisections of a path in the search for a value of the parameter."""

    # Solutions at many points of a sweep together
    steps_at_many_points: Final = 20
    """Steps from a predicted solution …"""
    newton_step_at_many_points: Final = 1e-7
    """… and the size of the last one: what it leaves is its square."""
    reach_at_many_points: Final = 0.2
    """No step is longer than this part of the size of the scene, or this angle (rad)."""
    points_of_a_derivative: Final = 16
    """One of so many points lends its derivative to those near it …"""
    chord_contraction: Final = 0.25
    """… if each step is at most this part of the one before, …"""
    chord_step_settled: Final = 5e-14
    """… until steps are no larger than this: rounding."""
    newton_step_on_the_way: Final = 0.01
    """The last step where solutions are the start of others."""
    smooth_points_first: Final = (9, 5)
    """Chebyshev points between which solutions are polynomials, along one parameter or each of two, at first …"""
    smooth_points_most: Final = 1200
    """… and in all at most, at twice to eight times as many each time …"""
    smooth_decay: Final = 0.25
    """… while the last coefficients fall below this part of what they were …"""
    smooth_remainder_enough: Final = 1e-13
    """… and are larger than this, in sizes of the scene; …"""
    smooth_remainder: Final = 1e-9
    """… in the end they must be smaller than this."""
    smooth_steps_behind: Final = 3
    """Each solution is extrapolated by a polynomial through so many of the last ones, …"""
    smooth_least_step: Final = 0.01
    """… and where that does not lead to it, by way of others no closer than this part of the range."""
    smooth_determinant_points: Final = 200
    """At so many points of a range the sign of the determinant is looked at."""

    # Symmetries: whether elements are carried into themselves
    roundings_of_comparison: Final = 8.0
    """Numbers computed in a comparison may be wrong by this many roundings of their terms."""
    row_residual: Final = 1e-12
    """Constraint rows hold to this at the states that are compared, relative to the sizes in the scene."""
    field_felt: Final = 1e-9
    """A field that moves the reference by less, relative to the sizes in the scene, does not move it."""
    repeated_row_misfit: Final = 30.0
    """Redundant rows agree elsewhere to this many times their disagreement in direction at the reference."""
    resting_speed: Final = 1e-6
    """Speeds below this, relative to those of the scene, count as rest where rows on speeds are tested."""
    state_spreads: Final = (0.5, 0.15, 0.04, 0.01)
    """Spread of the states, in sizes of the scene and rad; a smaller one where equations have no value."""
    near_rows: Final = 0.04
    """Spread of states near the reference that satisfy the constraints, relative to that of the others."""
    state_surroundings: Final = 1e-3
    """Spread of the states near the reference, relative to that of the others."""
    newton_steps_onto_rows: Final = 25
    """Newton steps onto the constraints for a state that is compared …"""
    settled_onto_rows: Final = 1e-9
    """… until one is smaller than this, relative to the sizes in the scene: what is left is of the order of its square.
    """
    parameter_offset: Final = 1e-6
    """Relative perturbation of the parameters of expressions in the search for structure."""
    state_coupling: Final = 1e-9
    """Couplings of first-order states below this, relative to the terms of which they are sums, are rounding."""
    balancing_steps: Final = 30
    """Rounds in which the units of first-order states are balanced."""
    state_bits: Final = 24
    """Bits of the numbers in the states at which elements are compared."""

    # Symmetries: which are tried, and which are independent
    work_of_combination: Final = 1e-7
    """Combinations of symmetries along which the work is below this are tested more closely."""
    independent_fields: Final = 1e-8
    """Fields are independent if the smallest singular value of their unit vectors is larger than this."""
    coordinate_held: Final = 1e-9
    """A coordinate is held by the constraints if its part in all allowed motions, of unit length, is below this."""
    trial_speeds: Final = (0.3, -1.0, 3.0, 1e-3, -1e-6, 1e-9, -1e-12)
    """Speeds along symmetries, in rates of the scene, at which a scene at rest is tested."""
    proposed_change: Final = 1e-8
    """A field is proposed if an element changes by less along it, relative to the terms of the change …"""
    row_without_terms: Final = 1e-13
    """Rows of changes with smaller terms than this, relative to those of others, restrict no proposal …"""
    states_beyond: Final = 3
    """… at so many random states, and as many more as it takes to see all fields."""
    exact_spreads: Final = (0.6, 1e-3, 1e-6, 1e-10)
    """Spreads of states at which identities are tested, by `state_spreads`; but the first of what the file writes only:
    a function may be flat to all digits but near the reference."""
    bits_of_scene: Final = 1280
    """Bits with which the entries of a file are evaluated: cos(1e300) needs a thousand of its argument."""
    inertia_of_states: Final = 1e-20
    """Motions of inertias below this part of the largest do not set the rate of random states."""
    searched_together: Final = 60
    """Elements of scenes with no more coordinates than this are tested at states of the whole scene."""
    half_of_digits: Final = 1e-45
    """A step of Newton's method with many digits that is smaller than this, relatively, is the last: it leaves its
    square."""
    row_dependence: Final = 1e-9
    """Rows of unit length are dependent on others beside which less is left of them."""
    steps_of_refinement: Final = 9
    """Steps of Newton's method, each of which adds some 12 digits to coefficients of fields that are no fractions."""
    steps_of_decimals: Final = 60
    """Steps of that for decimals; each adds about as many digits as the file has."""
    roundings_within_digits: Final = 16.0
    """What elements change by the rounding of decimals, in relative errors of these."""
    roundings_felt: Final = 16.0
    """Decimals matter to fields if what they change is more than that by so many roundings."""
    decimals_alike: Final = 1e-14
    """Combinations of decimals that fields feel by less, relative to others, are left as they are."""
    decimals_moved: Final = 80
    """Symmetries of other decimals are looked for in files with no more rounded ones than these."""
    digits_of_moved: Final = 50
    """Digits of such decimals …"""
    bits_of_moved: Final = 190
    """… when the changes of elements along fields are so small, relative to their terms."""
    bits_of_step: Final = 60
    """Decimals are moved by this negative power of two for derivatives by them, in units of their last digits."""
    digits_of_midpoints: Final = 2.0**-16
    """Midpoints of wide balls are right to this part of their radii: Arb computes with 30 bits more than are known."""
    rounding_on_rows: Final = 2.0**-280
    """Distance of states, relative to their size, from those that satisfy rows with many digits, and of coefficients
    of fields from those that leave elements unchanged; much more than the square of the last step."""
    bits_of_motion: Final = 36
    """Bits to which the rates of a steady motion are known."""
    simple_field: Final = (1e-7, 1e-10)
    """Distances of a field with entries 0 and 1 from the space that doubles propose; the second if one hides others."""
    bits_of_coefficients: Final = 120
    """Coefficients of fields are equal, or zero, to so many bits."""
    rounds_of_identities: Final = 12
    """Rounds of fresh states after which the fields that pass are given up …"""
    fields_at_once: Final = 900
    """Scenes with more fields are sparse."""
    coefficient_zero: Final = 1e-10
    """Relative rounding of the coefficients that doubles propose."""
    shift_denominator: Final = 1000
    """Largest denominator of fractions that are recognized in the ratios of the entries of a shift."""


TOLERANCES = Tolerances()
