"""Tolerances of eigenvalues, modes and their derivatives for zero, equal and known, and limits of their work."""

import math
from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of eigenvalues, modes and their derivatives."""

    __slots__ = ()

    # Errors of the matrices
    roundings_of_vectors: Final = 4.0
    """Eigenvectors are exact for a matrix that differs by this many roundings of its norm."""

    # Bounds of eigenvalues
    relative_bound_warned: Final = 1e-10
    """Eigenvalues with larger relative error bounds are warned about."""

    # Spectra of large scenes
    vague_looked_at_again: Final = 30
    """Up to so many eigenvalues that cannot be told from others or from the axis are looked at with dense matrices."""

    # A few eigenvalues of large scenes
    equal_vectors_cosine: Final = 1.0 - 1e-6
    """Vectors with a larger cosine are the same."""
    drawn_rounding_factor: Final = 3.0
    """Factor on the effect of randomly drawn roundings."""
    correction_of_eigenvalue: Final = 1e-2
    """A value that is corrected by more than this, relatively, is not an eigenvalue …"""
    correction_beyond_rounding: Final = 1e2
    """… if the correction is also more than this many times the effect of rounding."""
    correction_again: Final = 1e-9
    """Relative correction above which vectors are computed again at the corrected value."""
    steps_of_correction: Final = 8
    """Steps to the root of a quadratic: each gains the digits of the correction above."""
    values_together: Final = 1e-7
    """Values closer than this, relatively, are treated together."""
    vector_steps: Final = 3
    """… left ones with this many steps of inverse iteration."""
    vector_error: Final = 0.1
    """Bounds of second order hold for vectors that are wrong by at most this part."""
    real_value: Final = 1e-9
    """Values are real if their imaginary part is smaller than this, relatively."""
    search_start_nearest: Final = 1e-7
    """A search whose shift is nearer to an eigenvalue than this fraction of the distance of its farthest value …"""
    search_start_aside: Final = 1e-3
    """… is repeated with its shift moved by this fraction of that distance …"""
    search_starts: Final = 4
    """… at most this many times."""
    second_search_start: Final = 0.03
    """Distance of the shift of a second search from that of the first, as a fraction of its radius."""
    eigenvalues_more: Final = 6
    """Number of eigenvalues computed beyond the requested ones: the outermost may hide others."""
    axis_shifts: Final = 40
    """Maximum number of shifts along the imaginary axis in the search for the rightmost eigenvalues."""
    axis_disc_overlap: Final = 0.8
    """Discs about these shifts overlap: the next centre is farther by this fraction of the last radius."""
    square_rate_zero: Final = (1e-14, 1e-12, 1e-10, 1e-8)
    """Squares of rates that count as zero, relative to those of single forces; the smallest that factors resolve."""
    beyond_all: Final = 1.5
    """All eigenvalues together are computed from a real shift of so many times the largest."""
    scale_step: Final = 1e-2
    """… and again from shifts that are smaller by this factor each, down to eigenvalues that are known."""
    winding_disc_radius: Final = 0.8
    """Radius of a disc, as a fraction of the distance to the nearest eigenvalue."""
    winding_arnoldi_steps: Final = 14
    """Arnoldi steps for the estimate of this distance."""
    winding_phase: Final = math.pi / 3.0
    """Maximum error of the change of phase that the slopes give (rad)."""
    winding_slope_step: Final = 1e-2
    """Distance of the points for slopes, in radii divided by the number of eigenvalues."""
    winding_factorizations: Final = 3000
    """Maximum number of factorizations …"""
    winding_rows: Final = 3e6
    """… and of rows that are factored in total."""
    winding_nearest_axis: Final = 1e-12
    """An eigenvalue nearer to the axis than this, relative to the fastest, may lie on it."""
    winding_rounding_steps: Final = 5
    """Iterations for the change of solutions by rounding of the entries …"""
    winding_rounding_effect: Final = 0.02
    """… and its limit."""
    winding_start: Final = 3.0
    """Beyond this many spectral radii only the tail of the phase is left."""
    winding_number_misfit: Final = 0.05
    """The number must be an integer to within this."""

    # Many digits
    digits_least: Final = 16
    """Smallest number of digits that can be requested …"""
    digits_most: Final = 1000
    """… and the largest."""
    digits_beyond: Final = 15
    """Digits beyond the requested ones, and the same number again in the second computation."""
    digits_of_holding: Final = 470
    """Digits with which the force that holds a motion beside its reference is computed …"""
    distance_digits: Final = 40
    """… at 10 to the minus this power of the sizes of the scene, …"""
    distances: Final = tuple(range(1, 12))
    """… times these: as many as there are powers up to the tenth, and one more, into which those beyond fall."""
    float_range: Final = 300
    """Of numbers of different size in one vector those smaller by 10 to this power are lost as floats."""
    digits_of_bound: Final = 2
    """An error bound is this many digits below the last printed one."""
    precision_rounds: Final = 6
    """Maximum number of computations with more digits."""
    separate_bounds: Final = 100
    """Eigenvalues this many error bounds apart are different."""
    sharpened_slope: Final = 1e-11
    """Digits are gained along directions in which the relative slope of the equations exceeds this."""

    # Neutral directions
    slope_of_residual: Final = 1e-7
    """A reference follows a parameter if this fraction of the slopes of the terms is left in sums that vanish."""
    neutral_apart: Final = 1e-9
    """An eigenvalue has no derivative if a neutral one is nearer than this fraction of it."""

    # Periodic motions
    monodromy_tolerances: Final = (1e-12, 1e-13)
    """Local errors of two integrations, relative to values and sizes: the second is the result, the first a check."""
    monodromy_steps: Final = (1.0 / 24.0, 1.0 / 32.0)
    """Their longest steps in periods, as given functions may rest and then start; their ratio is that of order 8."""
    time_samples: Final = 2**16
    """Instants of a period at which functions of time are sampled: what is shorter than their distance is not seen."""
    change_in_time: Final = 1e-12
    """A function is constant if its variation is below this fraction of its size."""
    change_in_step: Final = 1.5
    """A step passes over this many times its part of the period of the variation of a function, at most …"""
    feature_of_step: Final = 0.25
    """… where that makes it shorter than this fraction of the longest one."""
    periodicity: Final = 1e-7
    """Speeds and coefficients are the same after a period if they agree to this, relative to their largest values."""
    monodromy_rounding: Final = 10.0 * EPS
    """Rounding error of the monodromy matrix, relative to its norm."""
    instants_rounded: Final = 13
    """Number of instants of a period at which the rounding of the numbers of the file is propagated."""
    constraints_singular: Final = 1e-5
    """A mechanism is singular where the smallest singular value of the rows falls to this fraction of the first."""
    monodromy_growth: Final = 1e6
    """Limit of the growth of disturbances: beyond it, rounding hides the smallest and affects the motion."""
    motion_in_period: Final = 1e-4
    """A coordinate that moves less than this times its size in a period is compared as if it moved that much."""
    monodromy_evaluations: Final = 200_000
    """Maximum number of evaluations of one integration: some minutes for a scene of a few bodies."""
    mismatch_factor: Final = 10.0
    """The error of multipliers is at most this many times the relative mismatch of the motion after a period."""
    periods_to_whole_turns: Final = 12
    """A motion whose angles have made no whole turns after a period may repeat after so many of them."""
    periods_later: Final = (1, 2, 5, 13, 100)
    """Numbers of periods after which a motion that advances is checked."""
    rest_in_period: Final = 1e-9
    """A coordinate that moves by no more than this fraction of its size in a period is at rest, except for rounding."""
    multiplier_turned: Final = 1e-4
    """Multipliers of symmetries that differ from 1 by more than this belong to a rotation."""

    # Modes in words
    told_coordinates: Final = 300
    """Modes of scenes with more coordinates are not told in words: choosing these takes as long as the modes."""
    told_joint_independent: Final = 0.1
    """Part of the motion of a joint that the motions chosen before do not determine, from which on it is chosen."""
    told_independent: Final = 1e-6
    """The same for coordinates."""
    told_held: Final = 1e-9
    """A motion is held if all that the constraints allow moves it by at most this, relative to its own size."""
    told_part: Final = 0.05
    """Motions smaller than this fraction of the largest are not told …"""
    told_motions: Final = 4
    """… and at most this many."""
    states_apart: Final = 15
    """States that move by less than ten to the minus this, relative to the largest, are not told from rounding."""
    amplitudes_corrected: Final = 1e4
    """Amplitudes of such states are corrected where the equations are satisfied to so many times their errors …"""
    amplitude_change: Final = 1e-6
    """… and no amplitude changes by more than this, relatively."""
    mode_near: Final = 0.5
    """An eigenvalue farther from the given one than this fraction of it is not the named mode."""
    mode_difference: Final = 0.5
    """A mode that differs from the named one by more than this, of 1 at most, is not the one."""
    mode_ambiguous: Final = 0.05
    """A name is ambiguous if another mode differs by at most so much more."""
    mode_massless: Final = 1e-12
    """Motions without mass count with this fraction of the mean mass."""
    mode_held: Final = 1e-6
    """A shape is allowed if its amplitudes are reached to this, relative to the largest."""
    balance_defect: Final = 1e-14
    """Modes whose energy balance closes less well are improved …"""
    balance_improvements: Final = 3
    """… by at most this many Newton steps."""
    rotor_still: Final = 1e-9
    """An axis or a centre stands still if its rate is at most this fraction of the spin."""
    rotor_moves: Final = 1e-2
    """A spinning body that moves less than this fraction of the largest motion does not whirl."""
    whirl_round: Final = 0.02
    """A straight line has no sense: difference of the squares of both circles, relative to their sum, weighed by
    energies."""


TOLERANCES = Tolerances()
