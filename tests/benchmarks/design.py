"""The range of stable speeds of the bicycle, widened by changes below 5 % of five parameters.

The design is compared with a grid of three values of each parameter and with random points, and its range with that of
a sweep.
"""

import time

import numpy as np

import mbstab
from mbstab.analysis.design.goals import Cube, Range
from mbstab.analysis.design.plant import Plant

NAMES, PART, RANDOM, TOGETHER = ("w", "c", "tilt", "x_H", "z_H"), "5%", 300, 20


def main():
    bicycle = mbstab.load("whipple_bicycle.yaml")
    bicycle.design({"w": PART}, "range:v", steps=1)
    start = time.process_time()
    found = bicycle.design(dict.fromkeys(NAMES, PART), "range:v")
    took = time.process_time() - start
    print(f"design: {found.first:.6f} to {found.best:.9f} m/s in {found.steps} steps, {took:.1f} s CPU; {found.ended}")
    print(f"  {found.values}, at ends: {found.bounds}")

    values = {name: f"1*({value!r})" for name, value in found.values.items()}
    critical = [c.value for c in bicycle.sweep("v", np.linspace(4.0, 7.0, 61), **values).critical]
    print(f"sweep: stable from {critical[0]:.9f} to {critical[1]:.9f} m/s")
    print(f"  off by {max(abs(a - b) for a, b in zip(critical, found.interval, strict=True)):.1e} m/s")

    cube = Cube(found.task.vary)
    plant = Plant(bicycle.model, found.before | {"v": 5.0})
    goal = Range(plant, cube, "v", found.task.window)
    grid = np.stack([x.ravel() for x in np.meshgrid(*[[0.0, 0.5, 1.0]] * len(NAMES), indexing="ij")], axis=1)
    points = np.vstack([grid, np.random.default_rng(0).uniform(size=(RANDOM, len(NAMES)))])
    start = time.process_time()
    widths = np.concatenate([goal.values(points[k : k + TOGETHER]) for k in range(0, len(points), TOGETHER)])
    took = time.process_time() - start
    best = int(np.argmax(widths))
    print(f"grid of {len(grid)} points and {RANDOM} random ones, {took:.0f} s CPU: at most {widths[best]:.9f} m/s")
    print(f"  at {cube.at(points[best])}")
    if widths[best] > found.best * (1 + 1e-9):
        raise SystemExit("the grid has a better point")


if __name__ == "__main__":
    main()
