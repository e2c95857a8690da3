"""Tolerances of the linearized equations for zero, equal and known, and limits of their work."""

import math
from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the linearization and its eigenvalues."""

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
    roundings_of_vectors: Final = 4.0
    """Eigenvectors are exact for a matrix that differs by this many roundings of its norm."""
    inverse_refined: Final = 1e-12
    """The pseudo-inverse of rows on speeds is refined where a product with it misses the identity by more than this."""
    magnified_rounding: Final = 1e3
    """Stiff rows on speeds magnify the rounding along neutral directions where it is so many times as large."""
    loose_direction: Final = 1e-13
    """Unknowns whose error may exceed this are changed jointly along one direction …"""
    loose_directions: Final = 8
    """… of which this many are kept separately."""
    row_rounding: Final = 1e-9
    """Rows and columns smaller than this fraction of the others are rounding."""
    angle_difference: Final = 1e-6
    """Step of finite differences of the frame by angles (rad)."""
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
    relative_bound_warned: Final = 1e-10
    """Eigenvalues with larger relative error bounds are warned about."""
    coupling_of_pair: Final = 0.3
    """Two eigenvalues are judged together if their coupling exceeds this fraction of their distance."""
    parallel_vectors: Final = 1e-6
    """Vectors of equal eigenvalues are independent if the smallest singular value of their unit vectors is larger."""
    defective_distance: Final = 1e-3
    """Eigenvalues of a cluster with parallel vectors differ by less than this, relatively."""
    radius_powers: Final = 20
    """Powers of a matrix that bound its spectral radius, before its eigenvalues are computed."""

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
    vague_looked_at_again: Final = 30
    """Up to so many eigenvalues that cannot be told from others or from the axis are looked at with dense matrices."""
    eigenvectors_at_once: Final = 64
    """Eigenvectors that are processed at once."""
    symmetric_part: Final = 1e-13
    """Asymmetry, relative to the largest entry, below which vectors of the symmetric part are used."""

    # A few eigenvalues of large scenes
    equal_vectors_cosine: Final = 1.0 - 1e-6
    """Vectors with a larger cosine are the same."""
    drawn_rounding_factor: Final = 3.0
    """Factor on the effect of randomly drawn roundings."""
    correction_of_eigenvalue: Final = 1e-2
    """A value that is corrected by more than this, relatively, is not an eigenvalue …"""
    correction_beyond_rounding: Final = 1e2
    """… if the correction is also more than this many times the effect of rounding."""
    values_together: Final = 1e-7
    """Values closer than this, relatively, are treated together."""
    vector_shift: Final = 1e-8
    """Vectors come from factors at this relative distance from an eigenvalue …"""
    left_vector_steps: Final = 3
    """… left ones with this many steps of inverse iteration."""
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
    digits_of_bound: Final = 2
    """An error bound is this many digits below the last printed one."""
    precision_rounds: Final = 6
    """Maximum number of computations with more digits."""
    separate_bounds: Final = 100
    """Eigenvalues this many error bounds apart are different."""
    sharpened_slope: Final = 1e-11
    """Digits are gained along directions in which the relative slope of the equations exceeds this."""
    sharpened_coordinate: Final = 1e-6
    """Coordinates that move by less than this in all directions that gain no digits are determined."""

    # Neutral directions
    independent_direction: Final = 1e-8
    """Directions are independent above this singular value, if the next one follows after a rank gap."""
    direction_closure: Final = 1e-7
    """A direction that S maps out of T by more than this, relative to its norm, is an error of the program."""
    rest_manifold_rank: Final = 1e-9
    """Rest positions form a manifold if the smallest relative singular value of the forces on them is larger."""
    norm_by_powers_from: Final = 400
    """Norms of matrices from this size on …"""
    norm_powers: Final = 20
    """… are estimated by this many steps of the power method."""
    slope_of_residual: Final = 1e-7
    """A reference follows a parameter if this fraction of the slopes of the terms is left in sums that vanish."""
    neutral_apart: Final = 1e-9
    """An eigenvalue has no derivative if a neutral one is nearer than this fraction of it."""
    turning_frequency: Final = 1e-3
    """Relative agreement of the frequencies of neutral directions with those of the motion."""
    chain_length: Final = 4
    """Maximum length of Jordan chains of neutral directions."""
    slowest_typical_rate: Final = 1e-6
    """Smallest typical rate, as a fraction of that of the single forces."""
    number_lost: Final = 1e-150
    """Squares of smaller numbers underflow."""
    rank_states: Final = 3
    """Number of states near the reference at which the rank is computed …"""
    rank_state_distance: Final = 0.02
    """… and their distance from it, in sizes of the scene."""
    repeated_row_misfit: Final = 1e-9
    """Redundant rows agree there to this, relative to the sizes in the scene …"""
    row_singular_value: Final = 1e-7
    """… and rows are independent there above this singular value, as unit vectors."""
    mirrored_reference: Final = 1e-9
    """The mirror image of the reference is the reference itself to this, relative to the characteristic sizes."""
    mirror_difference: Final = 1e-5
    """Step of finite differences of the map of the speeds, relative to the characteristic sizes."""
    mirrored_singular_value: Final = 1e-9
    """Singular values of A on Q are zero below this fraction of its norm; the next one follows after a rank gap."""

    # Families of motions
    family_reach: Final = 0.1
    """Distance to which families are followed: in sizes of the scene and rad, and relative to their rates."""
    family_parts: Final = (1.0, 1e-2, 1e-4, 1e-6)
    """Fractions of this distance at which they are searched as well."""
    family_singular_value: Final = 1e-10
    """Singular values of A modulo symmetries are zero below this fraction of its norm; the next follows after a rank
    gap."""
    newton_steps_family: Final = 12
    """Gauss-Newton steps for each motion of a family."""
    force_vanishes: Final = 1e-9
    """A force along a direction is zero below this fraction of the force of each element along it …"""
    force_rounding: Final = 1e-14
    """… or below this fraction of the sum of all of them, as rounding."""
    acceleration_difference: Final = 1e-6
    """Step of finite differences of accelerations, relative to the characteristic sizes."""
    family_states: Final = 30
    """Families of systems with more states are not followed."""

    # Critical zeros
    critical_reach: Final = 0.2
    """Distance to which the critical direction is followed, in sizes of the scene or rad."""
    critical_halvings: Final = 24
    """Number of halvings of the distance …"""
    critical_distances: Final = 10
    """… and number of distances that suffice where the motion cannot be followed so far."""
    newton_steps_critical: Final = 12
    """Newton steps at each distance."""
    critical_balance: Final = 1e-13
    """Forces along each coordinate balance to this, relative to the forces that act along it."""
    critical_force: Final = 30.0
    """Forces along the critical direction count if they exceed the zero tolerance by this factor."""
    power_misfit: Final = 0.12
    """Largest distance of an observed power from an integer."""
    simple_zero: Final = 1e-6
    """The zero is the only one in the positions if the next singular value is larger, relative to the largest."""

    # Second variation of the energy
    roundings_of_variation: Final = 30.0
    """The second variation is known to this many roundings of its terms."""
    force_across_rows: Final = 1e-9
    """Forces across rows on speeds vanish to this, relative to all forces."""
    momentum_multiples: Final = 33
    """Multiples of a momentum that are tried, before the best of them is refined."""
    resonance_misfit: Final = 1e-3
    """Frequencies of modes with opposite energy are in a ratio of small integers to within this."""

    # Exact functions
    product_terms: Final = 100
    """Products with more terms are not expanded."""
    power_bits: Final = 4000
    """Powers with longer numerators (bits) are not expanded."""
    constant_rounding: Final = 1e-12
    """Accuracy of the values of constants, relative to the sum of the sizes of their terms."""
    kink_distance: Final = 1e-9
    """The state is at a kink if a change of this size, relative to the sizes in the scene, leads there."""
    common_period: Final = 10**6
    """A common period longer than this many periods of the fastest part is useless: it counts as none."""
    period_multiple: Final = 1e-12
    """A stated period is a multiple of the true one if the ratio is an integer to this, relatively."""
    printed_operations: Final = 100_000
    """Maximum number of operations in all entries, unless it is forced: more fill pages and take minutes to print."""
    simplified_weight: Final = 5000
    """Maximum total weight of the entries that are simplified; the others are printed without."""

    # Periodic motions
    monodromy_tolerances: Final = (1e-12, 1e-13)
    """Local errors of two integrations, relative to values and sizes: the second is the result, the first a check."""
    monodromy_steps: Final = (1.0 / 24.0, 1.0 / 32.0)
    """Their longest steps in periods, as given functions may rest and then start; their ratio is that of order 8."""
    periodicity: Final = 1e-7
    """Speeds and coefficients are the same after a period if they agree to this, relative to their largest values."""
    monodromy_rounding: Final = 10.0 * EPS
    """Rounding error of the monodromy matrix, relative to its norm."""
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
    periods_later: Final = (1, 2, 5, 13, 100)
    """Numbers of periods after which a motion that advances is checked."""
    rest_in_period: Final = 1e-9
    """A coordinate that moves by no more than this fraction of its size in a period is at rest, except for rounding."""
    multiplier_turned: Final = 1e-4
    """Multipliers of symmetries that differ from 1 by more than this belong to a rotation."""
    multiplier_circle_points: Final = 64
    """Number of points of a circle on which there are no eigenvalues …"""
    multiplier_circle_errors: Final = 2.0
    """… and margin between them, in errors."""
    multiplier_circle_parts: Final = (0.5, 0.2, 0.05, 0.01)
    """Radii of circles around a group that are tried, as fractions of the distance to the next one."""

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
    """A straight line has no sense: difference of the squares of both circles, relative to their sum."""
    # Inputs and outputs
    steady_signal: Final = 1e-9
    """Columns of inputs and rows of outputs that change by no more than this fraction are constant."""
    pivot: Final = 0.1
    """The rates of the chosen coordinates are states unless their smallest pivot is less than this fraction."""
    residue_kept: Final = 30.0
    """A singular value of the moments of a pole is different from 0 if it is this many times its error …"""
    residue_dropped: Final = 1.0
    """… and zero if it is no more than this many times."""
    zero_at_zero: Final = 1e-100
    """Zeros below this fraction of the largest eigenvalue are 0, up to this."""
    rounds_of_zeros: Final = 60
    """Maximum number of rounds of Aberth's iteration."""
    zero_states: Final = 80
    """Zeros of channels with more states are not computed: that would take minutes."""
    sparse_response: Final = 100
    """s E − A of this size or larger is factorized as a sparse matrix."""
    singular_response: Final = 4.0
    """s E − A is singular if its reciprocal condition is at most this many roundings."""
    refinements_of_response: Final = 4
    """Maximum number of residuals that are looked at …"""
    residual_of_response: Final = 100.0
    """… until they are no larger than this many roundings of their terms, …"""
    residual_largest: Final = 1e-8
    """… and the largest of them, relative to its terms, with which a value is known at all."""
    scalings_of_response: Final = 4
    """Rounds in which rows and columns of s E − A are scaled before it is factorized."""
    calibration: Final = 1e-3
    """A response is known where its relative error is at most this."""
    factored_off: Final = 1e-6
    """The product of its zeros and eigenvalues differs from a response by at most this, besides their errors."""
    end_of_response: Final = 1e-4
    """Crossings are looked for from this fraction of the smallest zero or eigenvalue to as far beyond the largest …"""
    halvings: Final = 80
    """… with at most this many halvings of intervals, …"""
    narrowest: Final = 1e-14
    """… until they are as narrow as this, relative to the frequency, …"""
    most_intervals: Final = 20_000
    """… and at most this many together."""
    beside_crossing: Final = (1e-13, 1e-11, 1e-9, 1e-7)
    """Where a crossing lies at the end of an interval, signs are compared this far beside it, relatively."""
    crossing_apart: Final = 1e-9
    """Crossings closer than this, relative to the frequency, are one."""
    undamped: Final = 1e-3
    """An eigenvalue known to this fraction of its size, whose real part may be zero, has no damping."""
    newton_steps_crossing: Final = 30
    """Maximum number of Newton steps to the frequency of the largest gain."""
    gain_found: Final = 1e-12
    """The logarithm of the largest gain is looked for to this."""
    level_step: Final = 1e-9
    """The largest gain is said to be known to this, relatively, unless its error is larger."""
    errors_of_real: Final = 3.0
    """A response is real if its imaginary part is at most this many times its error at all samples."""
    independent_states: Final = 1e-8
    """The smallest singular value of the unit rows of states must be larger."""


TOLERANCES = Tolerances()
