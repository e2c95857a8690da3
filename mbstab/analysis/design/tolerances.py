"""What is distinguished in a design, and how much is computed."""

from typing import Final


class Tolerances:
    """Tolerances and limits of designs."""

    __slots__ = ()

    # The search
    reaches: Final = 4
    """Trust regions that are tried together, from the largest on …"""
    reach_ratio: Final = 5.0
    """… each smaller than the one before by this factor …"""
    reach_least: Final = 1e-8
    """… until none of this size, relative to the ranges, is better."""
    cost_of_slack: Final = 10.0
    """Price of leaving the side of a meeting on which real parts are smooth, relative to the goal."""
    gain: Final = 1e-9
    """A step must gain this fraction of the value of the goal …"""
    rounding: Final = 1e-12
    """… and this fraction of the largest eigenvalue, of 1, or of the window."""
    gain_enough: Final = 1e-7
    """The search ends after steps that gain less than this fraction …"""
    small_gains: Final = 2
    """… so many of them in a row."""
    alike: Final = 1e-13
    """Points whose values differ by less than this fraction are equally good."""
    cuts: Final = 4
    """Former steps whose inequalities are tried again."""
    equal: Final = 1e-10
    """Eigenvalues whose distance is below this fraction of the largest are equal: they move with their mean."""
    cutting_planes: Final = 6
    """Points at which the matrix that moves to first order is bounded again, where eigenvalues may cross."""
    scattered: Final = 256
    """Points over all ranges that are tried where no model leads on …"""
    scattered_in_boxes: Final = 64
    """… where each of them takes a box or a range …"""
    scattered_near: Final = 8
    """… and in each smaller region."""
    rounds_of_root: Final = 60
    """Steps to the root by which such points are spread."""
    near_partner: Final = 0.5
    """Eigenvalues nearer to each other than this fraction of their size may meet."""
    meets: Final = 1e-2
    """They nearly meet within this fraction."""
    on_a_line: Final = 1e-12
    """Two of them are both real, or a pair, if the imaginary part of their sum is below this fraction."""
    at_bound: Final = 1e-6
    """A parameter is at the end of its range within this fraction of it."""
    active: Final = 1e-3
    """An eigenvalue limits the goal if its margin is the smallest within this fraction, or within this fraction of its
    size if it meets another one."""

    # Boxes and ranges
    grid: Final = (41, 11, 7)
    """Points along each side of a box with so many sides …"""
    grid_of_many: Final = 4
    """… and with more of them."""
    grid_checked: Final = (401, 41, 13)
    """Points along each side of the grid on which the result is checked …"""
    checked_rounds: Final = 12
    """… and how often it is made finer."""
    finer: Final = (9, 5, 3)
    """Points along each side of a finer grid about the worst one …"""
    finer_rounds: Final = 2
    """… and how often it is made finer."""
    places: Final = 5
    """Places of a box at which derivatives are taken."""
    range_points: Final = 61
    """Points at which a range is looked for …"""
    range_points_checked: Final = 401
    """… and at which the best one is checked."""
    window_inside: Final = 1e-7
    """The first and the last of them are inside of the window by this fraction."""
    range_rounds: Final = 14
    """Steps at most with which all ends of ranges are located …"""
    range_known: Final = 1e-12
    """… to this fraction."""
    inside: Final = 2e-4
    """Derivatives at the end of a range are taken inside of it by this fraction of the window."""
    peak: Final = 0.25
    """A peak inside of a range counts if the margin there is below this fraction of the largest."""


TOLERANCES = Tolerances()
