"""Tolerances of responses from inputs to outputs for zero, equal and known, and limits of their work."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of responses from inputs to outputs."""

    __slots__ = ()

    # Inputs and outputs
    steady_signal: Final = 1e-9
    """Columns of inputs and rows of outputs that change by no more than this fraction are constant."""
    pivot: Final = 0.1
    """The rates of the chosen coordinates are states unless their smallest pivot is less than this fraction."""
    circles_of_poles: Final = (1.0, 1e-3, 1e-6, 1e-9)
    """Poles are looked for on circles of these radii, relative to the widest."""
    points_on_circle: Final = 16
    """A circle about poles has at least this many points, besides two for each pole inside, …"""
    most_points_on_circle: Final = 100
    """… and at most so many: enough for poles outside to leave nothing but rounding."""
    residue_kept: Final = 30.0
    """A singular value of the moments of a pole is different from 0 if it is this many times its error …"""
    residue_dropped: Final = 1.0
    """… and zero if it is no more than this many times."""
    steps_beside_pole: Final = 10
    """How often the distance from an eigenvalue at which the response is known is enlarged."""
    zero_at_zero: Final = 1e-100
    """Zeros below this fraction of the largest eigenvalue are 0, up to this."""
    conjugate: Final = 1e-3
    """Two zeros are a pair if their imaginary parts differ by less than this fraction, and real parts by no more."""
    rounds_of_zeros: Final = 60
    """Maximum number of rounds of Aberth's iteration."""
    places_of_nothing: Final = (0.37j, 1.3 + 0.7j, 23.0j)
    """Where a response is asked for being exactly zero, relative to the largest eigenvalue."""
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
    crossing_misfit: Final = 1e-9
    """At a phase crossing the imaginary part is smaller than this fraction of the response, besides errors."""
    undamped: Final = 1e-3
    """A zero known to this fraction of its size, whose real part may be zero, is taken to be on the imaginary axis."""
    margin_known: Final = 1e-3
    """Margins whose error is larger than this, relatively or in rad, are not told."""
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
