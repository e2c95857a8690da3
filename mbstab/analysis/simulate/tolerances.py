"""What simulations count as rest, as singular and as converged, and how long they may take."""

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
    pivot_of_rows: Final = 1e-10
    """All rows are combined where a pivot of those that are not redundant falls below this part of the largest."""
    multiplier_singular_value: Final = 1e-10
    """Multipliers of combinations of rows whose singular value is below this part of the largest are set to zero."""
    resting_speed_of_forces: Final = 1e-3
    """Speeds below this part of what the forces at the start can cause are as good as rest."""
    kink_offset: Final = 1e-6
    """Part of the fastest speed, or of those as good as rest, by which speeds are moved off a kink."""

    # Singular configurations; the least singular value of the constraints counts relative to that at the start
    passage_tried_from: Final = 0.5
    """Passages are tried from where the least singular value has fallen to this."""
    singular_failure: Final = 0.3
    """A step that fails where the least singular value is below this fails for that reason."""
    singular_nearby: Final = 0.1
    """A singular configuration is near where the least singular value is below this."""
    speed_growth_near_singular: Final = 2.0
    """Near it speeds are known to the tolerance times the present ones, taken anew when they grow by this factor."""
    speed_growth_at_limit: Final = 100.0
    """Speeds that have grown by more when a singular configuration is reached tell of a limit, not of a branch."""
    passage_halvings: Final = 12
    """How often the way to a singular configuration is halved until its passage is accurate enough."""
    passage_error_fixed_steps: Final = 1e-10
    """Error of a passage where steps are fixed."""
    passage_iterations: Final = 60
    """Iterations for the polynomial of a passage at most."""
    passage_correction_rounding: Final = 1e-13
    """Corrections below this, in sizes of the scene, are rounding."""
    passage_correction_stalled: Final = 1e-10
    """Corrections that do not become smaller are rounding below this at most."""
    passage_tail: Final = 0.1
    """The last coefficients of the polynomial, and rounding, may be worth this part of the tolerance of a step."""
    passage_correction_placed: Final = 1e-6
    """Corrections below this, in sizes of the scene, tell where the singular configuration is."""
    passage_centerings: Final = 4
    """Intervals that are tried …"""
    passage_off_center: Final = 0.02
    """… until their middle is off the singular configuration by less than this part of the half."""
    passage_times_ahead: Final = 8
    """Times at which a state ahead is looked at."""
    passage_node_singular_value: Final = 1e-4
    """The least singular value at a node is this at least."""

    # Start and disturbance
    value_increment: Final = 0.2
    """Given values are gone to in steps of this part of their sizes, the others follow."""
    change_told: Final = 1e-9
    """What is moved by less, relative to its size, is not mentioned."""
    change_far: Final = 0.5
    """A value that is moved by more than this part of its size was not near a state that satisfies the constraints."""
    symmetric_start_offset: Final = 0.1
    """Part of their sizes by which coordinates are moved aside, where a symmetric start leads nowhere."""
    independent_motion_sine: Final = 0.05
    """Sine of the angle to what others determine, above which a motion is independent of them."""
    equally_bound: Final = 0.9
    """What is bound by no more than this part less counts as bound alike."""
    newton_steps_to_values: Final = 30
    """Newton steps to given values."""
    value_reached: Final = 1e-9
    """What is farther from its value, relative to its size, has not reached it."""
    swing_amplitude: Final = 0.25
    """How far the coordinate that moves most swings, in sizes of the scene or rad."""

    # Accuracy of the result
    error_factor: Final = 3.0
    """The error of a result is below this factor times the tolerance, unless a warning says otherwise."""
    time_resolution: Final = 1e-3
    """Part of the natural time of a scene within which the time has to be known."""
    runs_most: Final = 5
    """Runs with different tolerances at most …"""
    runs_least: Final = 3
    """… and at least."""
    resting_speed: Final = 1e-4
    """Speeds below this part of the natural rate are as good as none."""
    step_tolerance_least: Final = 1e-13
    """Tolerance of a step below which rounding decides."""
    step_tolerance_reduction: Final = 0.1
    """Of the tolerance of a step from the first run to the second."""
    step_tolerance_ratio: Final = 0.5
    """Largest ratio of tolerances whose runs tell anything about the error."""
    estimate_improvement: Final = 0.7
    """A run whose estimate is above this part of the one before has not improved the result."""
    order_counted_on: Final = 0.75
    """Part of `Method.power` that is counted on: errors of single runs may shrink less than theory says."""
    repeated_run_aim: Final = 0.3
    """A repeated run aims at this part of the tolerance."""
    looks_at_given_functions: Final = 8
    """In so many parts of the longest step …"""
    looks_in_all: Final = 2**16
    """… and in at most so many of a simulation given functions of time are looked at."""
    clear_pulse: Final = 0.05
    """Of a function's range, or of a number of parts: more counts."""
    longest_step_parts: Final = (100.0, 1000.0)
    """With functions of time that may rest a step is at most that of the output, between these parts of the
    duration."""
    roundings_of_time: Final = 8.0
    """Speeds cannot be known better than what they change by in this many roundings of the time."""
    fixed_step_shortened: Final = 0.999
    """A fixed step that is taken back and shortened to less than this part has failed."""

    # Steps
    step_tolerance_relative: Final = 3e-14
    """Relative part of the tolerance of explicit integrators: rounding. The tolerance counts in sizes of the scene."""
    compiled_steps: Final = 250
    """Compiled steps after which the caller hears of them."""
    looked_steps: Final = 5
    """Where compiled steps leave something to others, so many are taken singly; twice as many if they get no further
    …"""
    looked_steps_most: Final = 320
    """… until so many."""
    newton_steps_implicit: Final = (10, 40)
    """Iterations of Newton's method at most, with steps that can be shortened and with fixed ones."""
    newton_correction: Final = 0.01
    """Newton's method is finished when a correction is this part of the tolerance of a step …"""
    newton_correction_rounding: Final = 1e-14
    """… or is rounding, in sizes of the scene."""
    newton_correction_stalled: Final = 1e-10
    """A correction below this that does not become smaller is rounding, too."""
    step_collapsed: Final = 1e-14
    """A step below this part of the motion, or of the time itself, has collapsed."""
    fixed_steps: Final = 1e9
    """Steps of fixed size at most."""

    # Stiffness
    stability_boundary_part: Final = 0.2
    """Steps whose mean comes to this part of the boundary of stability are suspected."""
    longest_step_part: Final = 0.7
    """Steps whose mean comes to this part of the longest one allowed are limited by that."""
    implicit_probes: Final = 15
    """Steps of the implicit method that are tried."""
    implicit_step_factor: Final = 10.0
    """Its steps cost more: they count as much longer from this factor on."""
    stiffness_first_test: Final = 500
    """Steps after which the test is made first; then after twice as many …"""
    stiffness_next_test: Final = 8000
    """… and at last every so many."""
    stiffness_window: Final = 100
    """Steps before a test over which their mean is taken."""
    steps_of_slow_pace: Final = 4000
    """Steps after which a pace that is slow all the time is taken for that of the rest …"""
    steps_left_explicit: Final = 1e7
    """… and refused if the rest would take more steps than this where other methods do better …"""
    steps_left: Final = 1e9
    """… and more than this where none may."""

    # Work
    default_duration: Final = 10.0
    """Duration of a simulation whose end is not given (s)."""
    memory_of_state: Final = 40
    """Numbers that would take as much memory as what surrounds a state that is kept."""
    states_together: Final = 500
    """States that are looked at together …"""
    matrix_numbers_together: Final = 4_000_000
    """… and numbers in their constraint matrices, at most."""
    progress_shown: Final = 0.002
    """The progress function is called when this part of the work is done."""
    time_told: Final = 60.0
    """A simulation that takes longer in all is told of (s)."""
    time_to_judge: Final = 5.0
    """From this time on there is enough to judge by; then after twice as long, and so on (s)."""
    time_of_run_to_judge: Final = 1.0
    """A run tells about those to come from this time on (s)."""
    time_growth_told: Final = 2.0
    """It is told again where the time grows by this factor over what was said."""


TOLERANCES = Tolerances()
