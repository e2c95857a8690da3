"""Sweeps of oscillators whose stiffness and damping are functions of the parameter: what happens between two points."""

import numpy as np
import pytest
from sampling import sample

import mbstab


def oscillators(laws):
    """Return a point on a rail for each stiffness and damping, of mass 1."""
    forces = (f'b{i}.x: "-({k})*b{i}.x - ({c})*rate(b{i}.x)"' for i, (k, c) in enumerate(laws))
    names = [f"b{i}" for i in range(len(laws))]
    return mbstab.loads(f"""
mbstab: 1
parameters: {{p: 0}}
bodies: {{{", ".join(f"{x}: {{type: planar_point, mass: 1}}" for x in names)}}}
constraints: {{{", ".join(f"{x}: {{holonomic: {x}.y}}" for x in names)}}}
forces: {{all: {{type: expression, on: {{{", ".join(forces)}}}}}}}
reference: {{coordinates: {{{", ".join(f"{x}: {{x: 0}}" for x in names)}}}}}
""")


# Stiffness, damping and how many of their eigenvalues are unstable.
BESIDE = [
    ("1", "1", 0), ("0.0001*(1 + p)", "1", 0), ("1e-5*(2 - p)", "1", 0), ("-0.1*(1 + p)", "1", 1), ("1", "-0.001", 2),
]  # fmt: skip


@pytest.mark.parametrize("kind", ["divergence", "flutter"])
@pytest.mark.parametrize("beside", BESIDE)
def test_a_window_between_two_points_is_found_beside_other_eigenvalues(kind, beside):
    """The real part that comes over the axis and returns need not be the largest one."""
    *law, others = beside
    grid, rng = np.linspace(0.0, 1.0, 31), np.random.default_rng(7)
    step, more = grid[1], 1 if kind == "divergence" else 2
    middle = 0.5 * (grid[13] + grid[14])
    windows = [(middle - 0.1 * step, middle + 0.1 * step)]  # as far from one point as from the other
    for k in rng.integers(1, 29, 1).tolist():
        a = grid[k] + step * rng.uniform(0.1, 0.5)
        windows.append((a, a + step * rng.uniform(0.06, 0.4)))
    for a, b in np.array(windows).tolist():
        square = f"(p - {a!r})*(p - {b!r})"
        own = (square, "1") if kind == "divergence" else ("4", square)
        found = oscillators([own, law]).sweep("p", grid)
        assert set(found.unstable) == {others}
        np.testing.assert_allclose([c.value for c in found.critical], [a, b], rtol=1e-9)
        assert [c.kind for c in found.critical] == 2 * [kind]
        assert [c.unstable for c in found.critical] == [(others, others + more), (others + more, others)]


@pytest.mark.parametrize("place", sample([0.161327041997346, 0.45, 0.7123], 2))
@pytest.mark.parametrize("beside", [("1", "1"), ("4e-5", "0.5"), ("4e-6*(1 + p)", "0.5"), ("1e-3*p**2", "0.5")])
def test_a_change_through_infinity_is_told_beside_slow_eigenvalues(place, beside):
    """Next to such a place slow eigenvalues are undecided, but the points of the sweep tell that stability changes."""
    found = oscillators([(f"1000*(p - 0.9)/(p - {place})", "1"), beside]).sweep("p", np.linspace(0.0, 1.0, 31))
    infinite, zero = found.critical
    assert (infinite.kind, infinite.unstable) == ("unresolved", (0, 1))
    assert (zero.kind, zero.unstable) == ("divergence", (1, 0))
    np.testing.assert_allclose([infinite.value, zero.value], [place, 0.9], rtol=1e-9)


@pytest.mark.parametrize("seed", sample(range(40), 10))
def test_a_window_that_begins_or_ends_on_a_point_of_the_sweep_is_found(seed):
    """An eigenvalue exactly on the axis at a point is beyond it on one side of the point."""
    rng = np.random.default_rng(seed)
    grid = np.linspace(0.0, 1.0, int(rng.integers(12, 60)))
    k, step = int(rng.integers(2, len(grid) - 3)), float(grid[1])
    point, part = float(grid[k]), step * rng.uniform(0.02, 0.9)
    windows = [(point, point + part), (point - part, point), (point, float(grid[k + 1])), (point, point + part + step)]
    for a, b in windows:
        sign = "-" if rng.uniform() < 0.3 else ""
        square = f"{sign}(p - {a!r})*(p - {b!r})"
        more, own = ((1, (square, "1")), (2, ("4", square)))[int(rng.integers(2))]
        found = oscillators([own, ("1", "1")][: int(rng.integers(1, 3))]).sweep("p", grid)
        np.testing.assert_allclose([c.value for c in found.critical], [a, b], rtol=0.0, atol=1e-9)
        inside, outside = (0, more) if sign else (more, 0)
        assert [c.unstable for c in found.critical] == [(outside, inside), (inside, outside)]
        assert {c.kind for c in found.critical} == {"divergence" if more == 1 else "flutter"}


@pytest.mark.parametrize("seed", sample(range(40), 10))
def test_eigenvalues_that_pass_in_opposite_directions_at_nearly_one_value_are_both_told(seed):
    """What a passing eigenvalue adds or takes must fit the direction in which it passes."""
    rng = np.random.default_rng(seed)
    first = float(rng.uniform(0.2, 0.8))
    places = [first, first + float(10.0 ** rng.uniform(-7.0, -3.0) * rng.choice([-1, 1]))]
    laws, truth = [], []
    for sign, place in zip(rng.permutation([1, -1]).tolist(), places, strict=True):
        law = f"{'' if sign < 0 else '-'}(p - {place!r})"
        real = bool(rng.integers(2))
        laws.append((law, str(float(rng.uniform(1.0, 2.0)))) if real else (str(float(rng.uniform(3.0, 5.0))), law))
        truth.append((place, "divergence" if real else "flutter", sign * (1 if real else 2)))
    found = oscillators(laws).sweep("p", np.linspace(0.0, 1.0, 26)).critical
    told = [(c.kind, c.unstable[1] - c.unstable[0]) for c in found]
    assert told == [x[1:] for x in sorted(truth)]
    np.testing.assert_allclose([c.value for c in found], sorted(places), rtol=1e-9)
