"""Motions without mass under loads written as numbers: nets in the plane, off symmetry, with preloaded springs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigvals

import mbstab


def net(rng):
    """Return a net of points as a file, a third of them without mass, and M, C and K derived by hand.

    The loads are those that keep the preloaded springs in balance at the reference.
    """
    n, places = 3, np.array([[0.0, 0.25], [1.5, -0.5], [3.0, 0.75], [-1.0, 2.0], [1.5, -3.0], [4.5, 1.0]])
    masses = rng.permutation([0.0, 1.0, 2.0])
    C, K, loads, lines = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((n, 2)), []
    for number, (i, j) in enumerate([(0, 1), (1, 2), (0, 2), (0, 3), (1, 4), (2, 5), (0, 4), (2, 4)]):
        gap = places[j] - places[i]
        length, (k, c) = float(np.hypot(*gap)), rng.choice([[2.0, 0.0], [3.0, 0.5], [1.0, 2.0]])
        free = length * rng.uniform(0.7, 1.1)
        along = np.outer(gap, gap) / length**2
        stiff = k * along + k * (1 - free / length) * (np.eye(2) - along)
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            if max(a, b) < n:
                K[2 * a : 2 * a + 2, 2 * b : 2 * b + 2] += sign * stiff
                C[2 * a : 2 * a + 2, 2 * b : 2 * b + 2] += sign * c * along
        for a, sign in ((i, -1), (j, 1)):
            if a < n:
                loads[a] += sign * k * (1 - free / length) * gap
        ends = ", ".join(f"p{a}" if a < n else f"ground.a{a}" for a in (i, j))
        values = f"stiffness: {k}, damping: {c}, length: {free!r}"
        lines.append(f"  s{number}: {{type: spring, between: [{ends}], {values}}}")
    bodies = [f"  p{a}: {{type: planar_point, mass: {masses[a]}}}" for a in range(n)]
    lines += [f"  f{a}: {{type: force, at: p{a}, vector: {loads[a].tolist()}}}" for a in range(n)]
    points = ", ".join(f"a{a}: {places[a].tolist()}" for a in range(n, 6))
    where = [f"    p{a}: {{x: {places[a, 0]}, y: {places[a, 1]}}}" for a in range(n)]
    rest = [f"ground: {{points: {{{points}}}}}", "forces:", *lines, "reference:", "  coordinates:", *where]
    return "\n".join(["mbstab: 1", "bodies:", *bodies, *rest]) + "\n", np.diag(np.repeat(masses, 2)), C, K


@pytest.mark.parametrize("seed", range(6))
def test_loads_on_nets_with_massless_points_are_no_functions_of_time(seed):
    text, M, C, K = net(np.random.default_rng(seed))
    zero, one = np.zeros((6, 6)), np.eye(6)
    expected = eigvals(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]))
    expected = expected[np.isfinite(expected) & (np.abs(expected) < 1e6)]
    found = mbstab.loads(text).eig()
    values = np.array([e.value for e in found.eigenvalues])
    assert found.counts.expected == len(values) == len(expected)
    assert np.max(np.min(np.abs(values[:, None] - expected), axis=1)) <= 1e-9 * np.max(np.abs(values))
    stable = np.max(expected.real) < 0
    assert found.verdict == ("asymptotically stable" if stable else "unstable")


def test_eigenvalues_that_pass_through_infinity_are_no_divergence():
    """A node without mass on a damper that changes its sign: (s² + 3)(c s + 2) = 4, whose product is 2/c."""
    scene = mbstab.loads("""
mbstab: 1
parameters: {c: 1}
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 0}}
constraints: {r: {holonomic: a.y}, s: {holonomic: b.y}}
forces:
  f: {type: expression, on: {a.x: -a.x - 2*(a.x - b.x), b.x: 2*(a.x - b.x) - c*rate(b.x)}}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
""")
    found = scene.sweep("c", np.linspace(-1.0, 1.1, 4))
    assert [x.kind for x in found.critical] == ["unresolved"]
    assert abs(found.critical[0].value) < 1e-9
    assert found.critical[0].unstable == (3, 0)
