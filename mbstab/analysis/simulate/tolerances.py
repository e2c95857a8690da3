"""Tolerances of simulations for rest, singular and converged, and limits of their duration."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of simulations."""

    __slots__ = ()

    # Constraints on the way
    projection_steps: Final = 12
    """Newton steps of a projection; near the constraints two are enough."""
    projection_residual: Final = 2e-14
    """A projection is finished when the residuals, relative to the sizes in the scene, are below this …"""
    projection_residual_failed: Final = 1e-12
    """… and has failed if they stay above this."""
    blocked: Final = 1e-7
    """A coordinate that moves less than this under a force, relative to one that is free of constraints, is blocked."""
    carried_most: Final = 100.0
    """Rows are told to be singular in coordinates scaled by their own masses, up to so many times what they carry."""
    pivot_of_rows: Final = 1e-10
    """All rows are combined where a pivot of the independent ones falls below this fraction of the largest."""
    multiplier_singular_value: Final = 1e-10
    """Multipliers of row combinations whose singular value is below this fraction of the largest are set to zero."""
    resting_speed_of_forces: Final = 1e-3
    """Speeds below this fraction of those that the forces at the start can cause count as rest."""
    kink_offset: Final = 1e-6
    """Fraction of the fastest speed, or of those that count as rest, by which speeds are moved off a kink."""

    # Singular configurations; the least singular value of the constraints counts relative to that at the start
    passage_tried_from: Final = 0.5
    """Passages are tried once the smallest singular value has fallen to this."""
    singular_failure: Final = 0.3
    """A step that fails where the smallest singular value is below this fails for that reason."""
    singular_nearby: Final = 0.1
    """A singular configuration is near where the smallest singular value is below this."""
    speed_stopped: Final = 1e-9
    """Constraints stop a motion that goes on with less than this part of its speed."""
    speed_growth_near_singular: Final = 2.0
    """Near it the tolerance of speeds is relative to the present ones, updated when they grow by this factor."""
    speed_growth_at_limit: Final = 100.0
    """If speeds have grown by more at a singular configuration, it is a limit of the mechanism, not a branch; if by
    more than this over the smallest singular value, the motion runs away for another reason."""
    passage_halvings: Final = 12
    """Number of halvings of the distance to a singular configuration until its passage is accurate enough."""
    passage_error_fixed_steps: Final = 1e-10
    """Error of a passage where steps are fixed."""
    passage_iterations: Final = 60
    """Maximum number of iterations for the polynomial of a passage."""
    passage_correction_rounding: Final = 1e-13
    """Corrections below this, in sizes of the scene, are rounding."""
    passage_correction_stalled: Final = 1e-10
    """Corrections that stop shrinking below this are rounding."""
    passage_tail: Final = 0.1
    """Limit of the last coefficients of the polynomial, and of rounding, as a fraction of the tolerance per step."""
    passage_correction_placed: Final = 1e-6
    """With corrections below this, in sizes of the scene, the singular configuration is located."""
    passage_centerings: Final = 4
    """Number of intervals that are tried …"""
    passage_off_center: Final = 0.02
    """… until the singular configuration is within this fraction of the half-length from their middle."""
    passage_times_ahead: Final = 8
    """Number of times at which a state ahead is examined."""
    passage_node_singular_value: Final = 1e-4
    """Lower limit of the smallest singular value at a node."""

    # Start and disturbance
    value_increment: Final = 0.2
    """Given values are approached in steps of this fraction of their sizes, and the others follow."""
    change_told: Final = 1e-9
    """A change by less than this, relative to the size, is not mentioned."""
    change_far: Final = 0.5
    """A value that is moved by more than this fraction of its size was not near a state on the constraints."""
    symmetric_start_offset: Final = 0.1
    """Fraction of their sizes by which coordinates are perturbed where a symmetric start fails."""
    independent_motion_sine: Final = 0.05
    """Sine of the angle to the span of the others above which a motion is independent of them."""
    equally_bound: Final = 0.9
    """Motions that the constraints restrict equally to within this fraction count as equal."""
    newton_steps_to_values: Final = 30
    """Newton steps towards given values."""
    value_reached: Final = 1e-9
    """A coordinate farther from its value than this, relative to its size, has not reached it."""
    component_without_mass: Final = 1e-9
    """Components of motions without mass below this, of unit vectors, are rounding."""
    angle_that_follows: Final = 1e-3
    """Angles follow from lengths only where these weigh less than this in the rows."""
    balance_left: Final = 1e-6
    """Forces along directions without mass may be out of balance by this fraction of their sizes."""
    swing_amplitude: Final = 0.25
    """Amplitude of the coordinate that moves most, in sizes of the scene or rad."""

    # Accuracy of the result
    error_factor: Final = 3.0
    """The error of a result is below this factor times the tolerance, unless a warning says otherwise."""
    time_resolution: Final = 1e-3
    """Required accuracy of the time, as a fraction of the natural time of a scene."""
    runs_most: Final = 6
    """Maximum number of runs with different tolerances …"""
    runs_least: Final = 3
    """… and the minimum."""
    resting_speed: Final = 1e-4
    """Speeds below this fraction of the natural rate count as rest."""
    step_tolerance_least: Final = 1e-13
    """Tolerance per step below which rounding dominates."""
    first_tolerance: Final = 100.0
    """Tolerance per step of the first run, over that of the result, …"""
    first_tolerance_most: Final = 1e-4
    """… but at most this, or that of the result if it is larger."""
    step_tolerance_reduction: Final = 0.1
    """Ratio of the tolerances per step of the first and the second run."""
    step_tolerance_ratio: Final = 0.5
    """Largest ratio of tolerances whose runs give an estimate of the error."""
    estimate_improvement: Final = 0.7
    """A run whose estimate is above this fraction of the previous one has not improved the result."""
    order_counted_on: Final = 0.75
    """Fraction of `Method.power` that is assumed: errors of single runs may shrink less than in theory …"""
    clear_reduction: Final = 0.01
    """… down to this part of a tolerance per step; the whole power is assumed from there on."""
    difference_of_motions: Final = 0.5
    """From this difference on, in sizes of the scene or rad, two runs show different motions."""
    repeated_run_aim: Final = 0.5
    """A repeated run aims at this fraction of the tolerance …"""
    confirming_reduction: Final = 0.3
    """… and has at most this fraction of the tolerance per step of the one before."""
    looks_at_given_functions: Final = 8
    """Cells in the longest step, and minimum of samples in each, at which given functions of time are examined …"""
    looks_in_all: Final = 2**16
    """… and number of samples in a simulation, if that is more."""
    clear_pulse: Final = 0.05
    """Fraction of a function's range, or of a number of cells, above which a deviation counts."""
    longest_step_parts: Final = (100.0, 1000.0)
    """With functions of time or of the motion that may rest, a step is at most that of the output, between these
    fractions of the duration."""
    roundings_of_power: Final = 8.0
    """Powers are known to this many roundings of the terms of which they are sums."""
    roundings_of_time: Final = 8.0
    """Accuracy of speeds is limited to their change in this many roundings of the time."""
    fixed_step_shortened: Final = 0.999
    """A fixed step that is rejected and shortened to less than this fraction has failed."""

    # Steps
    step_tolerance_relative: Final = 3e-14
    """Relative tolerance of explicit integrators: only rounding, as the tolerance is in sizes of the scene."""
    compiled_steps: Final = 250
    """Number of compiled steps after which they return to the caller."""
    looked_steps: Final = 5
    """Where compiled steps stop, this many are taken singly; twice as many if compiled ones get no further
    …"""
    looked_steps_most: Final = 320
    """… up to this many."""
    newton_steps_implicit: Final = (10, 40)
    """Maximum number of Newton iterations, with steps that can be shortened and with fixed ones."""
    newton_correction: Final = 0.01
    """Newton's method has converged when a correction is this fraction of the tolerance per step …"""
    newton_correction_rounding: Final = 1e-14
    """… or is rounding, in sizes of the scene."""
    newton_correction_stalled: Final = 1e-10
    """A correction below this that stops shrinking is rounding, too."""
    step_collapsed: Final = 1e-14
    """A step below this fraction of the duration, or of the time itself, has collapsed."""
    fixed_steps: Final = 1e9
    """Maximum number of steps of fixed size."""

    # Stiffness
    stability_boundary_part: Final = 0.2
    """Steps are suspected if their mean reaches this fraction of the stability limit."""
    longest_step_part: Final = 0.7
    """Steps are limited by the longest one allowed if their mean reaches this fraction of it."""
    implicit_probes: Final = 15
    """Steps of the implicit method that are tried."""
    implicit_step_factor: Final = 10.0
    """As its steps cost more, they count as much longer only from this factor on."""
    stiffness_first_test: Final = 500
    """Number of steps after which the first test is made; the next after twice as many …"""
    stiffness_next_test: Final = 8000
    """… and finally after every multiple of this."""
    stiffness_window: Final = 100
    """Number of steps before a test over which their mean is taken."""
    steps_of_slow_pace: Final = 4000
    """Number of steps after which a constantly slow pace is taken as that of the rest …"""
    steps_left_explicit: Final = 1e7
    """… and refused if the rest would take more steps than this where other methods do better …"""
    steps_left: Final = 1e9
    """… and more than this where no method may."""

    # Work
    default_duration: Final = 10.0
    """Duration of a simulation whose end is not given (s)."""
    memory_of_state: Final = 40
    """Overhead of a stored state, in numbers of the same memory."""
    states_together: Final = 500
    """Maximum number of states that are processed together …"""
    matrix_numbers_together: Final = 4_000_000
    """… and of numbers in their constraint matrices."""
    numbers_of_output: Final = 2_000_000
    """Work is summed at the end of a run, or as soon as so many numbers at nodes of the quadrature wait for it."""
    states_singly: Final = 8
    """Fewer states are looked at one by one."""
    progress_shown: Final = 0.002
    """The progress function is called each time this fraction of the work is done."""
    time_told: Final = 60.0
    """The duration of a simulation is reported if it is longer than this (s)."""
    time_to_judge: Final = 5.0
    """Time after which the duration is first estimated (s); then after twice as long, and so on."""
    time_of_run_to_judge: Final = 1.0
    """A run gives an estimate for later runs from this time on (s)."""
    time_growth_told: Final = 2.0
    """The duration is reported again if it exceeds the last report by this factor."""


TOLERANCES = Tolerances()
