"""What counts as a reference motion, how it is looked for and followed, and what counts as a symmetry."""

from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the reference."""

    __slots__ = ()

    # What a reference motion satisfies
    residual: Final = 1e-9
    """A reference satisfies its constraints if the residuals are below this, relative to the sizes in the scene."""
    unbalance: Final = 1e-8
    """At rest, the unbalanced forces may be this large relative to the forces that balance."""
    coordinate_rounding: Final = 100.0 * EPS
    """Coordinates are known to this, relative to the sizes in the scene."""
    curvature_of_dependent_rows: Final = 1e-7
    """Rows that depend on each other do so nearby if their curvatures cancel to this."""
    curvatures_together_from: Final = 400
    """From so many rows on their curvatures are not looked at one by one."""
    balance_refinements: Final = 3
    """Steps in which accelerations and multipliers are found; the first leaves small ones wrong beside large ones."""
    newton_steps_onto_constraints: Final = 60
    """Newton steps for coordinates and speeds that the file leaves out."""
    euler_cosine_refused: Final = 1e-6
    """Euler angles are refused as singular where |cos θ| is below this …"""
    euler_cosine_warned: Final = 0.02
    """… and warned about below this."""
    euler_cosine_chart_left: Final = 0.4
    """Another chart is taken where |cos θ| is below this."""
    euler_cosine_pinned: Final = 1e-3
    """A body that keeps its chart is refused where |cos θ| is below this."""
    row_independent_part: Final = 1e-7
    """A row repeats others if less than this part of it is independent of them."""

    # Scenes at rest with sparse matrices
    multiplier_corrections: Final = 2
    """Steps in which the multipliers are corrected."""
    massless: Final = 1e-13
    """Motions with less mass than this, in scaled coordinates, carry none."""
    drawn_roundings: Final = 4
    """So often signs of roundings are drawn …"""
    drawn_rounding_size: Final = 2.0**-22
    """… and so large they are, relatively, where their effects are looked at."""
    rest_rounding: Final = 8.0 * EPS
    """Forces and coordinates are rounded by this, relative to the sizes of their terms."""
    curvature_rounding: Final = 1e-12
    """What is smaller than this part of the curvatures of all rows is rounding."""
    curvature_probes: Final = 3
    """Motions along which dependent rows must not curve."""

    # Whether coefficients are constant along the motion
    variation_along_motion: Final = 1e-8
    """Coefficients that change less than this along the motion, relative to their size, count as constant."""
    variation_told: Final = 1e-3
    """A change below this is told with the least one that counts."""
    guard_turn: Final = 0.3
    """The coefficients are compared after a turn by this angle (rad) and a travel by this part of the scene's size."""
    generator_misfit: Final = 1e-9
    """Speeds follow a generator if they differ from it by less than this, relative to the largest."""

    # Newton's method for equilibria and steady motions
    newton_reach: Final = 0.5
    """No step is longer than this part of the size of the scene, or this angle (rad) …"""
    newton_trusted_nonlinearity: Final = 0.4
    """… but longer where those before came out as the derivatives say, but for this part of the change …"""
    newton_reach_growth: Final = 10.0
    """… and at most so many times longer than the last one."""
    newton_residual_polished: Final = 1e-9
    """Residuals below this, relative to what balances, are polished by undamped steps until they stop falling."""
    newton_step_settled: Final = 0.01
    """Where forces balance, the next step is no longer than this part of the size of the scene, or this angle (rad)."""
    newton_steps_to_halve: Final = 12
    """Newton's method goes on while it halves the residuals in so many steps."""
    move_scaling_forces: Final = 1e-5
    """Where no force acts, those are the scale that a move by this part of the size of the scene brings about."""
    relaxed_residual: Final = 1e-3
    """A relaxed motion is handed to Newton's method at residuals below this; if that fails, at a tenth of them."""
    relaxation_steps: Final = 200
    """Steps of a heavily damped motion towards rest at most."""
    spin_up_steps: Final = 40
    """Steps in which given rates are raised from rest at most."""
    search_ran_off: Final = 10.0
    """A search that ends more than so many sizes of the scene, or rad, from where it started ran off."""
    gap_of_constraints: Final = 1e-6
    """Constraints are not satisfied above this part of the size of the scene."""
    isolated_singular_value: Final = 1e-7
    """A solution is not isolated if a singular value of the equations is this small beside the largest."""

    # Paths of solutions that are followed over a parameter
    path_first_step: Final = 1.0 / 16.0
    """First step, as a part of the range, of the size of the scene, or as an angle (rad)."""
    path_least_step: Final = 1e-12
    """A solution is lost if no step of this length leads further."""
    path_prediction_error: Final = 0.02
    """A prediction may be wrong by this part of the size of the scene, or by this angle (rad)."""
    path_turn_cosine: Final = 0.985
    """Cosine of the angle by which the tangent may turn in a step."""
    path_newton_steps: Final = 25
    """Newton steps from a prediction …"""
    path_last_newton_step: Final = 1e-8
    """… and the size of the last one: what it leaves is its square."""
    path_residual_rounding: Final = 1e-14
    """Residuals that are rounding …"""
    path_step_rounding: Final = 1e-4
    """… and steps after which that counts."""
    parameter_difference: Final = 1e-6
    """Derivatives by the parameter are taken over this part of the range."""
    path_singular_value: Final = 1e-9
    """Along the path and along symmetries the equations change by less than this, relative to the largest change."""
    branching_singular_value: Final = 1e-5
    """Where the path turns back another one leaves if the equations are dependent to this."""
    path_turning_slope: Final = 1e-9
    """The parameter turns back where it changes by less than this along the path: there it is known to the square."""
    fold_halvings: Final = 20
    """Points that close in on a fold by a factor of 2 each: coordinates vary like a root of the parameter there."""
    folds_of_path: Final = 10
    """A path is followed through so many folds …"""
    points_between_folds: Final = 5000
    """… and so many points between two of them."""
    path_evaluated_numbers: Final = 100_000
    """So many coordinates and rows of the equations of a curve are evaluated at most …"""
    path_evaluations: Final = 2_500
    """… but all of them so many times anyway."""
    pole_size: Final = 1e4
    """Where positions are this many times the size of the scene …"""
    pole_points: Final = 5
    """… so many points tell whether a pole is ahead …"""
    pole_error: Final = 1e-6
    """… and where, which must be known to this part of the range …"""
    pole_resolution: Final = 1e-13
    """… and is to no smaller one."""
    kink_step: Final = 1e-6
    """A path with a kink is taken up again this part of the range beyond it, if the solution moves by little more."""
    crossing_distance: Final = 1e-6
    """Where another path crosses is known to the square of this."""
    branch_step: Final = 1e-3
    """So far from a branch point another path is taken up."""
    equal_solutions: Final = 1e-9
    """Solutions are the same if their positions are, and their parameters but for this part of the range."""
    turn_neighbourhood: Final = 1e-7
    """Next to a turn, as a part of the path."""
    parameter_halvings: Final = 40
    """Halvings of a part of the path in which a value of the parameter is looked for."""

    # Symmetries: whether elements are carried into themselves
    force_change: Final = 1e-11
    """An element is carried into itself if each of its forces changes by no more than this part of its size …"""
    force_change_rounding: Final = 1e-14
    """… or than this part of all that the element does: what turned axes mix is rounded so."""
    roundings_of_comparison: Final = 8.0
    """Numbers that are computed in a comparison may be off by so many roundings of their terms."""
    comparison_digits: Final = 40
    """Expressions are compared with so many digits …"""
    comparison_exact: Final = 1e-32
    """… and are equal to this."""
    row_residual: Final = 1e-12
    """Constraint rows hold to this at the states that are compared, relative to the sizes in the scene."""
    repeated_row_misfit: Final = 30.0
    """Rows that repeat others agree elsewhere to so many times what their directions agree to at the reference."""
    resting_speed: Final = 1e-6
    """Slower speeds, relative to those of the scene, count as rest where rows on speeds are asked."""
    state_spreads: Final = (0.5, 0.15, 0.04, 0.01)
    """How far states are spread, in sizes of the scene and rad; less where equations have no value."""
    state_surroundings: Final = 1e-3
    """Surroundings of the reference, relative to the spread of the other states."""
    newton_steps_onto_rows: Final = 25
    """Newton steps onto the constraints for a state that is compared."""
    parameter_offset: Final = 1e-6
    """So far off are the parameters of expressions with which structure is looked for."""
    state_bits: Final = 24
    """Bits of the states at which elements are compared."""
    trial_move: Final = 0.7
    """Turns (rad), and shifts in sizes of the scene, by which elements are tried."""

    # Symmetries: which are tried, and which are independent
    work_of_combination: Final = 1e-7
    """Work along combinations of symmetries that is smaller than this is looked at more closely."""
    row_change_first_order: Final = 1e-6
    """What changes constraint rows by more than this to first order, relative to their terms, is not tried."""
    independent_fields: Final = 1e-8
    """Fields are independent if the smallest of their singular values, of unit vectors, is larger than this."""
    trial_parts: Final = (1.0, 2.0**-20, 2.0**-40)
    """Parts of a move that are tried: functions may be flat but for a narrow range."""
    trial_speeds: Final = (0.3, -1.0, 3.0, 1e-3, -1e-6, 1e-9, -1e-12)
    """Speeds along symmetries, in rates of the scene, at which what rests is tried."""
    trial_centres: Final = 8
    """So many points fixed in the ground are tried as centres of turns."""
    shift_denominator: Final = 1000
    """Ratios of the entries of a shift are fractions if their denominators are no larger."""


TOLERANCES = Tolerances()
