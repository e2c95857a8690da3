"""Ten seconds of three examples in machine code written by hand, beside compiled steps of mbstab.

The limit is DOP853 in a loop that Numba compiles, with equations written by hand in as few coordinates as there are
degrees of freedom: no constraints, no projections, no dense output, no check of the rank. Its errors, and those of
mbstab, are differences of places (in the size of the scene) and of entries of rotation matrices at the end from a run
with a tolerance of 1e-12 per step. Each program runs with tolerances that shrink until the error is below 1e-6; the
median CPU time of nine runs counts, mbstab from the loaded model on, its equations known. Columns: CPU time (ms) of the
limit, of mbstab (one run), and with the global error controlled (``tol=1e-6``, several runs); their ratios to the
limit; the error of the last over the tolerance.

A second table has the implicit methods, alpha to an error of 1e-4: the CPU time of one compiled run, its ratio to the
limit with that error, its steps, microseconds for each, and how much faster that is than step by step in Python.
"""

import math
import statistics
import sys
import time
from functools import partial
from pathlib import Path

import numba
import numpy as np
import scipy.integrate

import mbstab

sys.path.insert(0, str(Path(__file__).parents[1]))
from chains import straight_chain

GOAL, END, REPEATS = 1e-6, 10.0, 9
IMPLICIT = {"alpha": 1e-4, "radau": 1e-6}
"""Errors that implicit methods reach."""

TOLERANCES = [10.0 ** -(0.5 * k) for k in range(8, 25)]
METHOD = scipy.integrate.DOP853
A, B, C, E3, E5 = (np.ascontiguousarray(getattr(METHOD, name)) for name in ("A", "B", "C", "E3", "E5"))


@numba.njit
def pendulum(t, y, p, dy):
    """A rod of length 2 L, with its angle from the vertical."""
    dy[0], dy[1] = y[1], -0.75 * p[0] / p[1] * math.sin(y[0])


@numba.njit
def top(t, y, p, dy):
    """A top with A = R_x(a) R_y(b) R_z(ω t), whose last angle is driven."""
    weight, across, axial, spin = p
    a, b, da, db = y
    s, c = math.sin(b), math.cos(b)
    # T = (I (ȧ² cos² b + ḃ²) + I_z (ω + ȧ sin b)²)/2 and V = m g H cos a cos b
    mass = across * c * c + axial * s * s
    dy[0], dy[1] = da, db
    turning = 2.0 * (axial - across) * s * c * da * db + axial * spin * c * db
    dy[2] = (weight * math.sin(a) * c - turning) / mass
    dy[3] = ((axial - across) * s * c * da * da + axial * spin * c * da + weight * math.cos(a) * s) / across


@numba.njit
def chain(t, y, p, dy):
    """Rods of 1 m and 1 kg with their angles from the vertical: M by Cholesky's method."""
    n = len(y) // 2
    M, b, s, c = np.empty((n, n)), np.zeros(n), np.sin(y[:n]), np.cos(y[:n])
    for i in range(n):
        b[i] -= p[0] * (n - i - 0.5) * s[i]
        for j in range(i):
            coupling = n - i - 0.5
            M[i, j] = coupling * (c[i] * c[j] + s[i] * s[j])
            turning = coupling * (s[i] * c[j] - c[i] * s[j])
            b[i] -= turning * y[n + j] ** 2
            b[j] += turning * y[n + i] ** 2
        M[i, i] = n - i - 2.0 / 3.0
    for k in range(n):
        for i in range(k, n):
            for j in range(k):
                M[i, k] -= M[i, j] * M[k, j]
            M[i, k] = math.sqrt(M[k, k]) if i == k else M[i, k] / M[k, k]
        for j in range(k):
            b[k] -= M[k, j] * b[j]
        b[k] /= M[k, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= M[j, k] * b[j]
        b[k] /= M[k, k]
    for i in range(n):
        dy[i], dy[n + i] = y[n + i], b[i]


def integrator(slope):
    """Return DOP853 for these equations: y at the end, with a tolerance of places and of speeds."""

    @numba.njit
    def run(y, p, end, tolerance, A, B, C, E3, E5):
        n, t, h = len(y), 0.0, 1e-3
        k, z = np.zeros((13, n)), np.empty(n)
        slope(t, y, p, k[0])
        while t < end:
            h = min(h, end - t)
            for i in range(1, 13):
                for c in range(n):
                    total = 0.0
                    for j in range(i):
                        total += (B[j] if i == 12 else A[i, j]) * k[j, c]
                    z[c] = y[c] + h * total
                slope(t + (h if i == 12 else C[i] * h), z, p, k[i])
            five, three = 0.0, 0.0
            for c in range(n):
                first, second = 0.0, 0.0
                for i in range(13):
                    first += E5[i] * k[i, c]
                    second += E3[i] * k[i, c]
                five += (first / tolerance) ** 2
                three += (second / tolerance) ** 2
            error = h * five / math.sqrt((five + 0.01 * three) * n) if five > 0.0 else 0.0
            if error < 1.0:
                t += h
                y, z = z, y
                k[0] = k[12]
            h *= min(10.0, max(0.2, 0.9 * error**-0.125)) if error > 0.0 else 10.0
        return y

    return lambda y, tolerance, p: run(y.copy(), p, END, tolerance, A, B, C, E3, E5)


def planar(angles, middle):
    """Return places of the centres and directions of rods that hang on each other."""
    along = np.stack([np.sin(angles), -np.cos(angles)], axis=1)
    return np.cumsum(2.0 * middle * along, axis=0) - middle * along, along


def upright(y, p, height):
    """Return place and axis of the top."""
    a, b = y[:2]
    axis = np.array([[math.sin(b), -math.sin(a) * math.cos(b), math.cos(a) * math.cos(b)]])
    return height * axis, axis


def examples():
    """Yield name, model, disturbance, equations, y at the start, parameters, and what is compared at the end."""
    model = mbstab.load("pendulum.yaml")
    p, angle = model.parameters(), math.pi / 4
    yield (
        "pendulum",
        model,
        {"rod.theta": angle},
        pendulum,
        [angle, 0.0],
        [9.81, p["L"]],
        lambda y: planar(y[:1], p["L"]),
        0,
    )
    model = mbstab.load("top.yaml")
    w = model.parameters()
    across = w["I_x"] + w["m"] * w["H"] ** 2
    yield (
        "top",
        model,
        {"top.theta": 0.3},
        top,
        [0.0, 0.3, 0.0, 0.0],
        [w["m"] * w["g"] * w["H"], across, w["I_z"], w["omega"]],
        lambda y: upright(y, w, w["H"]),
        2,
    )
    model, count = mbstab.loads(straight_chain(20)), 20
    sim = model.simulate(END, perturb={"rod_0.theta": 0.3}, tol=1e-3, once=True, points=2)
    angles = [math.atan2(turn[0, 0], -turn[1, 0]) for turn in sim.rotations[0]]
    yield (
        "chain of 20",
        model,
        {"rod_0.theta": 0.3},
        chain,
        [*angles, *[0.0] * count],
        [9.81],
        lambda y: planar(y[:count], 0.5),
        0,
    )


def timed(function):
    """Return the median of CPU times (s)."""
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        function()
        times.append(time.process_time() - began)
    return statistics.median(times)


def first(run, off, goal=GOAL):
    """Return the largest tolerance with which a run ends with an error below the goal."""
    return next(tol for tol in TOLERANCES if off(run(tol)) <= goal)


class Example:
    """An example, its exact end, and how far other ends are from it."""

    def __init__(self, model, perturb, step, y, ends, column):
        self.model, self.perturb, self.column = model, perturb, column
        self.by_hand = lambda tol: ends(step(y, tol))
        self.exact = self.by_hand(1e-12)
        self.size = float(np.max(np.abs(self.exact[0])))

    def off(self, end):
        """Return the error of an end."""
        places, axes = (np.max(np.abs(x - y)) for x, y in zip(end, self.exact, strict=True))
        return max(places / self.size, axes)

    def simulated(self, tol, once=True, method="projection", compiled=True, end=END):
        """Return a simulation."""
        options = {"tol": tol, "once": once, "points": 2, "method": method, "compiled": compiled}
        return self.model.simulate(end, perturb=self.perturb, **options)

    def end(self, *arguments):
        """Return what is compared at the end of a simulation."""
        sim = self.simulated(*arguments)
        places = sim.positions[-1]
        return places, sim.rotations[-1][:, : places.shape[1], self.column]

    def limit(self, goal):
        """Return the CPU time of the limit with an error below a goal (s)."""
        return timed(partial(self.by_hand, first(self.by_hand, self.off, goal)))

    def row(self):
        """Return CPU times (s), and the error over the tolerance where the global one is controlled."""
        single = first(self.end, self.off)
        times = [timed(partial(self.simulated, single)), timed(partial(self.simulated, GOAL, False))]
        return [self.limit(GOAL), *times], self.off(self.end(GOAL, False)) / GOAL

    def implicit_row(self, method, goal):
        """Return the CPU time of a compiled run (s), its ratio to the limit, its steps, and the ratio per step."""
        tol = first(lambda tol: self.end(tol, True, method), self.off, goal)
        seconds, steps = timed(partial(self.simulated, tol, True, method)), self.simulated(tol, True, method).steps
        began = time.process_time()
        interpreted = self.simulated(tol, True, method, False, END / 20.0)
        each = (time.process_time() - began) / interpreted.steps
        return seconds, seconds / self.limit(goal), steps, each * steps / seconds


def main():
    heads = ("", "limit", "one run", "controlled", "ratio", "ratio", "error/tol")
    print("".join(f"{head:>12}" for head in heads))
    found = []
    for name, model, perturb, slope, start, values, ends, column in examples():
        run, p = integrator(slope), np.array(values)
        found.append((name, Example(model, perturb, partial(run, p=p), np.array(start), ends, column)))
        times, error = found[-1][1].row()
        text = "".join(f"{1e3 * x:12.3f}" for x in times) + "".join(f"{x / times[0]:12.1f}" for x in times[1:])
        print(f"{name:>12}{text}{error:12.1e}", flush=True)
    print("".join(f"{head:>12}" for head in ("", "method", "one run", "ratio", "steps", "us/step", "to Python")))
    for name, example in found:
        for method, goal in IMPLICIT.items():
            seconds, ratio, steps, faster = example.implicit_row(method, goal)
            text = f"{1e3 * seconds:12.3f}{ratio:12.1f}{steps:12}{1e6 * seconds / steps:12.1f}{faster:12.1f}"
            print(f"{name:>12}{method:>12}{text}", flush=True)


if __name__ == "__main__":
    main()
