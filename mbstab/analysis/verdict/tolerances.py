"""Tolerances of the facts behind a verdict for zero, equal and known, and limits of their work."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of the facts behind a verdict."""

    __slots__ = ()

    # Neutral directions
    independent_direction: Final = 1e-8
    """Directions are independent above this singular value, if the next one follows after a rank gap."""
    direction_closure: Final = 1e-7
    """A direction that S maps out of T by more than this, relative to its norm, is an error of the program."""
    roundings_of_directions: Final = 64.0
    """A direction that S maps out of T by more roundings of the product than this is corrected."""
    unknowns_of_correction: Final = 900
    """Directions are corrected where no more unknowns than this are solved for."""
    rest_manifold_rank: Final = 1e-9
    """Rest positions form a manifold if the smallest relative singular value of the forces on them is larger."""
    norm_by_powers_from: Final = 400
    """Norms of matrices from this size on …"""
    norm_powers: Final = 20
    """… are estimated by this many steps of the power method."""
    turning_frequency: Final = 1e-3
    """Relative agreement of the frequencies of neutral directions with those of the motion."""
    neutral_rate: Final = 1e-9
    """Rates of change along neutral directions are zero below this fraction of the norm of S, or where rounding hides
    them: below a fraction of the fastest of them (direction_closure)."""
    equal_turns: Final = 1e-4
    """Neutral directions turn at the same rate if it agrees to this fraction of the largest."""
    chain_length: Final = 4
    """Maximum length of Jordan chains of neutral directions that turn."""
    slowest_typical_rate: Final = 1e-6
    """Smallest typical rate, as a fraction of that of the single forces."""
    number_lost: Final = 1e-150
    """Squares of smaller numbers underflow."""
    rank_states: Final = 3
    """Number of states near the reference at which the rank is computed …"""
    rank_state_distances: Final = (0.5, 0.1, 0.02, 0.002, 0.0002)
    """… and their distances from it, in sizes of the scene; a smaller one where rows bend strongly."""
    rank_state_misfit: Final = 1.0
    """How far redundant rows may be off where it is looked for, in sizes of the scene."""
    row_singular_value: Final = 1e-7
    """Rows are independent there above this singular value, as unit vectors."""
    mirrored_reference: Final = 1e-9
    """The mirror image of the reference is the reference itself to this, relative to the characteristic sizes."""
    mirror_difference: Final = 1e-5
    """Step of finite differences of the map of the speeds, relative to the characteristic sizes."""
    mirrored_singular_value: Final = 1e-9
    """Singular values of A on Q are zero below this fraction of its norm; the next one follows after a rank gap."""

    # Families of motions
    family_reach: Final = 0.1
    """Distance of a member of a family that is looked for: in sizes of the scene and rad, and relative to its rate."""
    family_parts: Final = (1.0, 1e-1, 1e-2, 1e-4)
    """Fractions of this distance: from the first at which one is found on, there is one at each."""
    fixed_states: Final = 6
    """States that symmetries of a reference leave alone, at which the work of forces is compared."""
    family_singular_value: Final = 1e-10
    """Singular values of A modulo symmetries are zero below this fraction of its norm; the next follows after a rank
    gap."""
    newton_steps_family: Final = 150
    """Steps of Newton's method for a member of a family, with the slopes at the reference …"""
    bits_of_member: Final = 240
    """… to so many bits, relative to the slopes."""
    bits_that_stay: Final = 16
    """What Newton's steps leave the same to so many bits is a force, not rounding."""
    family_slope: Final = 1e-18
    """Slopes that are smaller than this part of the largest are what differences leave of higher powers."""
    bits_of_difference: Final = 100
    """These slopes are differences over this negative power of two, in units of the scene."""
    force_vanishes: Final = 1e-9
    """A force along a direction is zero below this fraction of the force of each element along it …"""
    force_rounding: Final = 1e-14
    """… or below this fraction of the sum of all of them, as rounding."""
    acceleration_difference: Final = 1e-6
    """Step of finite differences of accelerations, relative to the characteristic sizes."""
    further_states: Final = 8
    """A function is constant if it is so at twice as many states as it has coefficients, and this many more."""
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
    simple_zero: Final = 1e-6
    """The zero is the only one in the positions if the next singular value is larger, relative to the largest."""

    # Second variation of the energy
    roundings_of_variation: Final = 30.0
    """The second variation is known to this many roundings of its terms."""
    force_across_rows: Final = 1e-9
    """Forces across rows on speeds vanish to this, relative to all forces."""
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

    # Periodic motions
    multiplier_circle_points: Final = 64
    """Number of points of a circle on which there are no eigenvalues …"""
    multiplier_circle_errors: Final = 2.0
    """… and margin between them, in errors."""
    multiplier_circle_parts: Final = (0.5, 0.2, 0.05, 0.01)
    """Radii of circles around a group that are tried, as fractions of the distance to the next one."""


TOLERANCES = Tolerances()
