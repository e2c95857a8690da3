"""How far proofs divide intervals, and how long they go on."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of proofs."""

    __slots__ = ()

    # Intervals of a parameter
    part_width: Final = 2.0**-24
    """A part of an interval that is narrower than this part of the whole is given up …"""
    interval_parts: Final = 500
    """… and so is the rest of an interval after so many parts …"""
    interval_time: Final = 60.0
    """… or so many seconds."""
    hopeless_width: Final = 2.0**-5
    """A part narrower than this is not divided if nothing is proven at its ends and its middle either."""
    unplaced_width: Final = 2.0**-8
    """Down to this part of the whole a part is divided where its eigenvalues are not placed, although it is stable."""

    # Single values
    digit_factors: Final = (1, 2, 4)
    """Where a verdict is open, it is tried again with so many times the digits."""
    close_states: Final = 2.0**-10
    """How far from the reference the close states are at which elements are compared, relative to the others."""
    momentum_multiples: Final = 65
    """Multiples of a momentum that are tried."""
    fraction_denominator: Final = 10**6
    """A float that is next to a fraction with no larger denominator stands for it …"""
    fraction_misfit: Final = 1e-15
    """… if it differs by no more than this, relative to its size."""
    equal_points: Final = 1e-9
    """Points in double precision and in balls that are closer than this (m) are the same."""


TOLERANCES = Tolerances()
