"""What counts as zero, as equal and as known in the linearized equations, and how much work it may take."""

import math
from typing import Final

from mbstab.analysis.algebra.tolerances import EPS


class Tolerances:
    """Tolerances, thresholds and limits of the linearization and its eigenvalues."""

    __slots__ = ()

    # Errors of the matrices
    roundings_of_sum: Final = 2.0
    """A sum of products is computed to so many roundings of its terms, and to one more for four times as many terms."""
    loose_direction: Final = 1e-13
    """What is solved for moves along one direction where it may be wrong by more than this …"""
    loose_directions: Final = 8
    """… and so many of these directions are kept apart."""
    row_rounding: Final = 1e-9
    """Rows and columns smaller than this part of the others are rounding."""
    angle_difference: Final = 1e-6
    """Step of differences of the frame by angles."""
    slowest_rate_of_errors: Final = 1e-10
    """Rates are not told from zero below this part of the typical one."""

    # Bounds of eigenvalues
    schur_from_symmetries: Final = 30
    """Symmetries from which on one Schur form is cheaper than least squares for each eigenvalue."""
    eigenvalue_of_neutral: Final = 1e-4
    """Eigenvalues farther from those of T than this part of what S does there are none of them."""
    slow_eigenvalue: Final = 1e-8
    """Eigenvalues smaller than this part of the largest have lost half of their digits in the matrix."""
    joining_rounds: Final = 40
    """Rounds of joining eigenvalues that cannot be told apart."""
    other_method_distance: Final = 10.0
    """A value of another method that lies so many times farther from an eigenvalue than its vector says is none."""
    cluster_singular_value: Final = 1e-11
    """Vectors of a cluster span its subspace if the least singular value of them, as unit vectors, is larger."""
    cluster_circle_points: Final = 48
    """Points of a circle on which a block is shown to have no eigenvalue …"""
    cluster_circle_product: Final = 0.8
    """… because a spectral radius that must be less than 1 is less than this."""
    vector_improvements: Final = 4
    """Rounds in which vectors are made better."""
    coupling_in_bound: Final = 0.1
    """What couples an eigenvalue to others may add this part to its bound before vectors are made better."""
    turn_product: Final = 0.1
    """Two vectors are not turned towards each other if the product of both angles is larger."""
    relative_bound_refined: Final = 100.0 * EPS
    """Eigenvalues with larger relative error bounds are refined, each by itself."""
    bound_beyond_data: Final = 10.0
    """A cluster is refined if the errors of the data alone leave so many times less open …"""
    relative_bound_refined_at_zeros: Final = 1e-12
    """… and beside zeros of the structure also if the relative error bound is larger than this."""
    relative_bound_warned: Final = 1e-10
    """Eigenvalues with larger relative error bounds are warned about."""
    coupling_of_pair: Final = 0.3
    """Two eigenvalues are judged together if what couples them is more than this part of their distance."""
    parallel_vectors: Final = 1e-6
    """Vectors of equal eigenvalues are independent if the least singular value of them, as unit vectors, is larger."""
    defective_distance: Final = 1e-3
    """Eigenvalues of a cluster with parallel vectors differ by less than this part of them."""
    radius_powers: Final = 20
    """Powers of a matrix by which its spectral radius is compared with a limit, before its eigenvalues are found."""

    # Other methods
    inverse_steps: Final = 3
    """Steps of inverse iteration; the best vector is taken, as later ones may be worse (Peters and Wilkinson 1979)."""
    qz_attempts: Final = 6
    """QZ is tried so many times."""
    finite_eigenvalue: Final = 1e5
    """Eigenvalues larger than this times the typical rate of the system count as infinite."""
    zero_pair: Final = 1e-13
    """A pair α/β with both parts below this times the size of the matrices is 0/0."""

    # Spectra of large scenes
    sparse_disc_distance: Final = 0.1
    """Discs and corrections are smaller than this part of the distance to the nearest eigenvalue, or both are
    joined."""
    momentum_misfit: Final = 1e-9
    """T and L are positions and their momenta to this."""
    equal_eigenvalues: Final = 1e-7
    """Eigenvalues that differ by less than this part of them are judged together."""
    second_order_in_bound: Final = 1.0
    """Vectors are made better where the second order adds more than so many times the first."""
    sparse_joining_rounds: Final = 12
    """Rounds of joining eigenvalues that cannot be told apart."""
    eigenvectors_at_once: Final = 64
    """Eigenvectors that are worked on at once."""
    symmetric_part: Final = 1e-13
    """Symmetric to this, relative to the largest entry: vectors from the symmetric part are as good."""

    # A few eigenvalues of large scenes
    equal_vectors_cosine: Final = 1.0 - 1e-6
    """Vectors with a larger cosine are the same."""
    drawn_rounding_factor: Final = 3.0
    """Drawn roundings count so many times."""
    correction_of_eigenvalue: Final = 1e-2
    """What is corrected by more, relatively, is no eigenvalue …"""
    correction_beyond_rounding: Final = 1e2
    """… if it is also more than so many times what rounding explains."""
    values_together: Final = 1e-7
    """Values closer than this, relatively, are treated together."""
    vector_shift: Final = 1e-8
    """Vectors come from factors so far beside an eigenvalue, relatively …"""
    left_vector_steps: Final = 3
    """… left ones with so many steps of inverse iteration."""
    real_value: Final = 1e-9
    """Values are real if their imaginary part is less than this part of them."""
    search_start_nearest: Final = 1e-7
    """A search that starts nearer to an eigenvalue than this part of the distance of the farthest value it finds …"""
    search_start_aside: Final = 1e-3
    """… starts farther aside by this part …"""
    search_starts: Final = 4
    """… at most so often."""
    second_search_start: Final = 0.03
    """Another search starts beside the first by this part of its radius."""
    eigenvalues_more: Final = 6
    """So many more eigenvalues are looked for than are asked for: the outermost may hide others."""
    axis_shifts: Final = 40
    """So many shifts along the imaginary axis are tried for the rightmost eigenvalues."""
    axis_disc_overlap: Final = 0.8
    """Discs about these shifts overlap: the next centre lies this part of the last radius farther."""
    square_rate_zero: Final = (1e-14, 1e-12, 1e-10, 1e-8)
    """Squares of rates that are taken for zero, in those of single forces; the smallest that the factors can tell."""
    winding_disc_radius: Final = 0.8
    """Radius of a disc, as part of the distance to the nearest eigenvalue."""
    winding_arnoldi_steps: Final = 14
    """Steps in which this distance is estimated."""
    winding_phase: Final = math.pi / 3.0
    """A change of phase agrees with slopes to this."""
    winding_slope_step: Final = 1e-4
    """Slopes come from points so many radii apart."""
    winding_factorizations: Final = 3000
    """So many factorizations are made at most …"""
    winding_rows: Final = 3e6
    """… and so many rows factored altogether."""
    winding_nearest_axis: Final = 1e-12
    """An eigenvalue so near to the axis, relative to the fastest, may lie on it."""
    winding_rounding_steps: Final = 5
    """Steps of the iteration for how much rounding of the entries changes solutions …"""
    winding_rounding_effect: Final = 0.02
    """… and how much it may."""
    winding_start: Final = 3.0
    """From so many spectral radii on nothing but the tail of the phase is left."""
    winding_number_misfit: Final = 0.05
    """The number comes out whole to this."""

    # Many digits
    digits_least: Final = 16
    """Digits that can be asked for are not fewer than these …"""
    digits_most: Final = 1000
    """… and not more than these."""
    digits_beyond: Final = 15
    """Digits beyond those asked for, and as many more in the second computation."""
    digits_of_bound: Final = 2
    """An error bound is this many digits below the last one that is printed."""
    precision_rounds: Final = 6
    """Computations with more digits before giving up."""
    separate_bounds: Final = 100
    """Eigenvalues this many error bounds apart are different."""
    sharpened_slope: Final = 1e-11
    """Digits are gained along directions in which the equations have a larger relative slope than this."""
    sharpened_coordinate: Final = 1e-6
    """Coordinates that move by less than this in all directions in which they are not sharpened are determined."""

    # Neutral directions
    independent_direction: Final = 1e-8
    """Directions are independent above this singular value, if the next one follows after a rank gap."""
    direction_closure: Final = 1e-7
    """A direction that S leads out of T by more than this, relative to its norm, is a fault of the program."""
    rest_manifold_rank: Final = 1e-9
    """Rest positions form a manifold if the least relative singular value of the forces on them is larger."""
    norm_by_powers_from: Final = 400
    """Norms of matrices of this size …"""
    norm_powers: Final = 20
    """… are found by so many steps of the power method."""
    turning_frequency: Final = 1e-3
    """Frequencies of neutral directions are those of the motion to this."""
    chain_length: Final = 4
    """Jordan chains of neutral directions are no longer than this."""
    slowest_typical_rate: Final = 1e-6
    """A typical rate is not less than this part of that of the single forces."""
    number_lost: Final = 1e-150
    """Squares of smaller numbers are not told from zero."""
    rank_states: Final = 3
    """So many states next to the reference are asked for their rank …"""
    rank_state_distance: Final = 0.02
    """… so far from it in sizes of the scene."""
    repeated_row_misfit: Final = 1e-9
    """Rows that repeat others agree with them there to this, relative to the sizes in the scene …"""
    row_singular_value: Final = 1e-7
    """… and rows are independent there above this singular value, as unit vectors."""
    mirrored_reference: Final = 1e-9
    """The mirror image of the reference is the reference itself to this, relative to a large change."""
    mirror_difference: Final = 1e-5
    """Part of a large change over which the map of the speeds is differentiated."""
    mirrored_singular_value: Final = 1e-9
    """Singular values of A on Q are zero below this part of its norm; the next one follows after a rank gap."""

    # Families of motions
    family_reach: Final = 0.1
    """How far families are followed: in sizes of the scene and rad, and of their rates."""
    family_parts: Final = (1.0, 1e-2, 1e-4, 1e-6)
    """Parts of this way at which they are looked for as well."""
    family_singular_value: Final = 1e-10
    """Singular values of A apart from symmetries are zero below this part of its norm; the next follows after a rank
    gap."""
    newton_steps_family: Final = 12
    """Steps of Gauss and Newton for each motion of a family."""
    force_vanishes: Final = 1e-9
    """A force along a direction is zero if it is this part of what each element does along it …"""
    force_rounding: Final = 1e-14
    """… or of all that they do, as rounding."""
    acceleration_difference: Final = 1e-6
    """Part of a large change over which accelerations are differentiated."""
    family_states: Final = 30
    """Systems with more states are not followed."""

    # Critical zeros
    critical_reach: Final = 0.2
    """How far the critical direction is followed, in sizes of the scene or rad."""
    critical_halvings: Final = 24
    """So many times the distance is halved …"""
    critical_distances: Final = 10
    """… and where the motion cannot be followed so far, so many of the distances will do."""
    newton_steps_critical: Final = 12
    """Newton steps at each distance."""
    critical_balance: Final = 1e-13
    """Forces along each coordinate balance to this, relative to those that act along it."""
    critical_force: Final = 30.0
    """Forces along the critical direction count if they are so many times what counts as zero."""
    power_misfit: Final = 0.12
    """How far an observed power may be from a whole number."""
    simple_zero: Final = 1e-6
    """The zero is the only one in the positions if the next singular value is larger, relative to the largest."""

    # Second variation of the energy
    roundings_of_variation: Final = 30.0
    """The second variation is known to this many roundings of the terms it is a sum of."""
    variation_powers: Final = 8
    """Steps of the power method that bound what is known of a large matrix."""
    force_across_rows: Final = 1e-9
    """Forces across rows on speeds vanish to this, relative to all forces."""
    momentum_multiples: Final = 33
    """Multiples of a momentum that are tried, before the best of them is made better."""
    resonance_misfit: Final = 1e-3
    """Frequencies of modes of opposite energy are in a ratio of small numbers to this."""

    # Exact functions
    product_terms: Final = 100
    """Products with more terms are not multiplied out."""
    power_bits: Final = 4000
    """Powers with longer numerators stay powers."""
    constant_rounding: Final = 1e-12
    """Values of constants are known to this, relative to the sum of the sizes of their terms."""
    kink_distance: Final = 1e-9
    """The state is at a kink if a change of this size, relative to the sizes in the scene, leads there."""
    common_period: Final = 10**6
    """A common period of more periods of the fastest part is of no use: none is said to exist."""
    period_multiple: Final = 1e-12
    """A stated period is a multiple of the true one if the ratio is whole to this, relatively."""
    printed_operations: Final = 100_000
    """Of all entries together, unless it is forced: more fill pages that nobody reads, and take minutes to print."""
    simplified_weight: Final = 5000
    """What all entries that are simplified may weigh together; the others are printed as they come."""

    # Periodic motions
    monodromy_tolerances: Final = (1e-12, 1e-13)
    """Local errors of two integrations, relative and to a large change: the second counts, the first judges it."""
    monodromy_steps: Final = (1.0 / 24.0, 1.0 / 32.0)
    """Their longest steps in periods, as given functions may rest and then start; their ratio is that of order 8."""
    periodicity: Final = 1e-7
    """Speeds and coefficients that agree to this after a period, relative to their largest values, are the same."""
    monodromy_rounding: Final = 10.0 * EPS
    """Of the monodromy matrix, relative to its norm."""
    constraints_singular: Final = 1e-5
    """Mechanisms are singular where the least singular value of the constraints falls to this part of the first."""
    monodromy_growth: Final = 1e6
    """Where disturbances grow more, their rounding hides the smallest of them and that of the motion is not small."""
    motion_in_period: Final = 1e-4
    """What moves less than this times its size in a period is compared as if it moved so much."""
    monodromy_evaluations: Final = 200_000
    """Of one integration: some minutes for a scene of a few bodies."""
    mismatch_factor: Final = 10.0
    """A motion that misses itself by some part has multipliers that are off by no more than so many times that part."""
    periods_later: Final = (1, 2, 5, 13, 100)
    """Numbers of periods after which a motion that has moved on is looked at."""
    rest_in_period: Final = 1e-9
    """What moves by no more than this part of its size in a period is at rest, but for rounding."""
    multiplier_turned: Final = 1e-4
    """Multipliers of symmetries that differ from 1 by more are those of a turn."""
    multiplier_circle_points: Final = 64
    """Points of a circle on which there are no eigenvalues …"""
    multiplier_circle_errors: Final = 2.0
    """… with so many errors left between them."""
    multiplier_circle_parts: Final = (0.5, 0.2, 0.05, 0.01)
    """Circles around a group are tried at these parts of the distance to the next one."""


TOLERANCES = Tolerances()
