"""Kernels at special states: upright, at rest, axes along coordinates, where common factors vanish.

A kernel that divides by something its definition does not divide by is right at random
states and wrong at the states people ask about.
"""

import importlib
import inspect
import itertools
import random

import mpmath
import pytest

from mbstab.compiler.derive import parameter_sizes
from mbstab.mechanics.catalogue import COORDINATES
from mbstab.mechanics.elements import ELEMENTS
from mbstab.model.arithmetic import FLOAT, mpmath_arithmetic

# Lengths that a definition divides by, and vectors that may not vanish.
POSITIVE = {
    "length",
    "lead",
    "radius",
    "mass",
    "stiffness",
    "damping",
    "tube",
    "rest",
    "cornering",
    "aligning",
    "peak",
    "shape_factor",
    "relaxation",
    "half_gauge",
    "scale",
}
SEMI_AXES = (2, 3, 1)  # and the ball inside it has the shortest


def states(name):
    """Yield inputs made of 0, 1 and right angles, such that the definition itself has a value."""
    element = ELEMENTS[name]
    frame = name.removesuffix(f"_{element.name}")
    # Wheels must not stand: slip has no value at rest.
    moving = "xyz" * (not {"cornering", "aligning", "conicity"}.isdisjoint(dict(element.parameters)))
    ones = [mpmath.mpf(1)] * element.states
    rng = random.Random(name)
    half_turn = mpmath.pi / 2
    # Each further pair of bodies may have an angle without a value.
    for trial in range(12 * max(1, element.slots - 1)):
        q, u, a = [], [], []
        for slot, coordinate in itertools.product(range(element.slots), COORDINATES[frame]):
            # Distinct places: a spring of zero length has no direction.
            turns = coordinate in ("phi", "psi") or (coordinate == "theta" and frame == "planar")
            angle = rng.choice([0, 0, half_turn, -half_turn]) if turns else 0
            q.append(mpmath.mpf(slot * 2 + 1) if coordinate == "x" else mpmath.mpf(angle))
            u.append(mpmath.mpf(rng.choice([1] if coordinate in moving else [0, 0, 1])))
            a.append(mpmath.mpf(rng.choice([0, 0, 1])))
        q, u, a = q + ones, u + ones, a + ones
        p = []
        if frame == "spatial":
            p = [mpmath.mpf(i == j) for _ in range(element.slots) for i in range(3) for j in range(3)]
        for number, (parameter, count) in enumerate(parameter_sizes(element, frame)):
            if parameter == "ball":
                p.append(mpmath.mpf(min(SEMI_AXES)))
            elif count == 1:
                p.append(mpmath.mpf(1 if parameter in POSITIVE else rng.choice([0, 1])))
            elif parameter in ("first", "second", "center", "point"):
                p += [mpmath.mpf(0)] * count
            elif parameter == "semi_axes":
                p += [mpmath.mpf(x) for x in SEMI_AXES]
            elif parameter == "inertia":
                p += [mpmath.mpf(x) for x in ([1, 1, 2, 0, 0, 0] if trial % 2 else [1, 2, 2, 0, 0, 0])]
            else:
                axis = {"axle": 1, "normal": 2 if frame == "spatial" else 1}.get(parameter, (number + trial) % count)
                p += [mpmath.mpf(i == axis) for i in range(count)]
        s = [mpmath.mpf(rng.choice([0, 1])) for _ in range(3 * element.signals)]
        yield q, u, a, p, s


@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_a_kernel_has_the_same_value_at_a_special_state_as_next_to_it(name):
    element = ELEMENTS[name]
    kernel = importlib.import_module(f"mbstab.compiler.kernels.{name}")
    tried = 0
    with mpmath.workdps(60):
        f = mpmath_arithmetic()
        for q, u, a, p, s in states(name):
            rows = {"planar": 2, "spatial": 3}[name.split("_")[0]] if element.name == "coincident" else 1
            last = {"inertia": [a], "force": []}.get(element.role, [[mpmath.mpf(1)] * rows])
            # Next to the state, in a direction in which nothing vanishes.
            step = mpmath.mpf(10) ** -25
            near = [[x + step * (i + 1) / 7 for i, x in enumerate(group)] for group in (q, u, p, s)]
            calls = (("dynamics", []), ("linearize", last))
            away = [[2 * x - y for x, y in zip(*pair, strict=True)] for pair in zip((q, u, p, s), near, strict=True)]
            try:
                beside = [getattr(kernel, function)(f, *near, *extra) for function, extra in calls]
                others = [getattr(kernel, function)(f, *away, *extra) for function, extra in calls]
            except ValueError:  # a root of what is not positive next to here
                continue
            jumps = "signum" in inspect.getsource(kernel)
            if jumps and any(x != pytest.approx(y, abs=1e-12) for x, y in zip(others, beside, strict=True)):
                continue
            if any(abs(x) > 1e12 for values in beside for x in values):  # the definition itself has no value here
                continue
            if any(abs(abs(x) - mpmath.pi) < 1e-12 for x in beside[0]):  # half a turn off, where an angle jumps
                continue
            for (function, extra), expected in zip(calls, beside, strict=True):
                floats = [[float(x) for x in group] for group in (q, u, p, s)]
                exact = getattr(kernel, function)(FLOAT, *floats, *[[float(x) for x in group] for group in extra])
                assert [float(x) for x in expected] == pytest.approx(list(exact), rel=1e-12, abs=1e-12)
                tried += 1
    assert tried >= 6
