"""First-order states in constraints: the bodies they move, and what such motions are measured by."""

import math
import re

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.errors import ModelFileError

DRIVEN = """
mbstab: 1
title: A mass on a spring whose other end follows a lag, which feels the mass by next to nothing
parameters: {{K: {gain}}}
bodies: {{end: {{type: planar_point, mass: {light}}}, b: {{type: planar_point, mass: 2}}}}
constraints: {{e: {{holonomic: end.y}}, y: {{holonomic: b.y}}, follow: {{holonomic: end.x - {unit}*s}}}}
forces: {{spring: {{type: expression, on: {{b.x: -8*(b.x - end.x) - 0.4*rate(b.x), end.x: -8*(end.x - b.x)}}}}}}
states: {{s: {{rate: (K*b.x - s)/0.1}}}}
reference: {{coordinates: {{end: {{x: 0, y: 0}}, b: {{x: 0, y: 0}}, s: 0}}}}
"""


@pytest.mark.parametrize("light", [0, 1e-3])
@pytest.mark.parametrize("unit", [1, 1e-6, 1e6])
@pytest.mark.parametrize("gain", [0, 1e-18, 1e-15, 1e-12, 1e-6, -1e-3, 0.1])
def test_modes_of_a_state_that_drives_a_body_through_a_constraint(gain, unit, light):
    """Units of states are balanced by what they move, too: without feedback nothing else bounds them."""
    model = mbstab.loads(DRIVEN.format(gain=gain / unit, unit=unit, light=light))
    result = model.eig()
    found = [e.value for e in result.eigenvalues]
    true = np.roots([0.2, 2.04, 1.2, 8 - 8 * gain])
    distances = np.abs(np.subtract.outer(found, true)).min(axis=1)
    assert np.all(distances < 1e-13 * np.abs(found))
    # In balanced units the largest part of a mode is 1/√gain of the smallest.
    close_to = 1e-12 + (1e-14 / math.sqrt(abs(gain)) if gain else 0.0)
    for e in result.eigenvalues:
        motion = dict(zip(result.coordinates, e.vector, strict=True))
        if abs(e.value) > 5:  # the mode of the lag
            assert abs(motion["b.x"] / motion["end.x"] * (2 * e.value**2 + 0.4 * e.value + 8) / 8 - 1) < close_to
            assert abs(motion["s"] * unit / motion["end.x"] - 1) < 1e-12
        else:
            driven = gain / (0.1 * e.value + 1)
            assert abs(motion["end.x"] / motion["b.x"] - driven) < close_to * abs(driven) + (0 if gain else 1e-13)


@pytest.mark.parametrize(
    ("states", "row", "seen"),
    [
        ("s: {rate: (0.1*rate(b.x) - s)/0.1}", "holonomic: end.x - s", "rate(b.x)"),
        ("s: {rate: (v - s)/0.1}, v: {rate: 3*rate(b.x) - v}", "holonomic: end.x - s - v", "rate(b.x)"),
        ("s: {rate: 2*rate(v) - s}, v: {rate: 3*rate(b.x) - v}", "nonholonomic: rate(end.x) - rate(s)", "rate(v)"),
        ("s: {rate: (0.1*vx(b) - s)/0.1}", "holonomic: end.x - s", "vx(b)"),
    ],
)
def test_states_that_follow_speeds_cannot_hold_bodies(states, row, seen):
    """The row of the rate would pass the reaction on to what it follows: a lever, where a signal is meant."""
    text = DRIVEN.format(gain=0, light=1, unit=1).replace("holonomic: end.x - 1*s", row)
    text = text.replace("s: {rate: (K*b.x - s)/0.1}", states)
    with pytest.raises(
        ModelFileError, match=rf"contains {re.escape(seen)}: the reaction would act on what has this speed, too"
    ):
        mbstab.loads(text)


def test_a_state_may_hold_a_body_by_way_of_one_that_follows_a_speed():
    """A lag w of the speed, and s that follows w: 2 λ² + 0.4 λ + 8 = 8 · 0.3 λ/((0.1 λ + 1) (0.2 λ + 1))."""
    text = DRIVEN.format(gain=0, light=1, unit=1)
    text = text.replace("s: {rate: (K*b.x - s)/0.1}", "s: {rate: (w - s)/0.1}, w: {rate: (0.3*rate(b.x) - w)/0.2}")
    true = np.roots(np.polysub(np.polymul([2, 0.4, 8], np.polymul([0.1, 1], [0.2, 1])), [2.4, 0]))
    found = np.array(mbstab.loads(text).eig().values())
    assert len(found) == 4
    distances = np.abs(np.subtract.outer(found, true))[linear_sum_assignment(np.abs(np.subtract.outer(found, true)))]
    assert np.all(distances < 1e-13 * np.abs(true).min())
