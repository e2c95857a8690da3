"""How far proofs divide intervals, and how long they run."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of proofs."""

    __slots__ = ()

    # Intervals of a parameter
    part_width: Final = 2.0**-24
    """A part of an interval that is narrower than this fraction of the whole is given up …"""
    interval_parts: Final = 500
    """… and so is the rest of an interval after this many parts …"""
    interval_time: Final = 60.0
    """… or this many seconds."""
    hopeless_width: Final = 2.0**-5
    """A part narrower than this is not divided if nothing is proven at its ends and its middle."""
    unplaced_width: Final = 2.0**-8
    """A stable part whose eigenvalues are not located is divided down to this fraction of the whole."""

    # Critical values
    critical_brackets: Final = (1e-9, 1e-6)
    """A critical value is looked for so near to that of a sweep, relative to it and to the range: the nearer first."""
    critical_digits_beyond: Final = 30
    """Digits of the computation beyond those of the enclosure."""

    # Single values
    fast_convergence: Final = 2.0**-20
    """An approximate inverse that shortens the steps to a zero by less than this is computed again."""
    digit_factors: Final = (1, 2, 4)
    """Where a verdict is open, it is tried again with these multiples of the digits."""
    trial_speeds: Final = (0.7, -1.3, 2.1)
    """Speeds along a symmetry, in units of its own, at which a scene is tried."""
    fraction_denominator: Final = 10**6
    """A float stands for a nearby fraction with a denominator no larger than this …"""
    fraction_misfit: Final = 1e-15
    """… if both differ by no more than this, relative to its size."""

    """Points in double precision and in balls that are closer than this (m) are the same."""


TOLERANCES = Tolerances()
