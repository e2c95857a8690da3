"""Random systems whose frequencies would cross over a parameter, were they not coupled, and which mode is which.

Each has a few masses on springs, some coupled very weakly, some damped. The truth follows left and right eigenvectors
with steps so small that each keeps pointing its own way.
"""

import numpy as np

import mbstab

STEP = 0.05
"""In a step of the truth vectors turn by at most this angle (rad), and eigenvalues approach by this part at most."""

OVERLAP = 0.99
"""Eigenvectors of two neighbouring values overlap by more than this."""


class Case:
    """Masses on springs with stiffness a + b p, weakly coupled."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        n = self.n = int(rng.integers(2, 5))
        self.points = int(rng.integers(5, 40))
        # Uncoupled squares of frequencies are straight lines that cross in the middle part of 0 … 1.
        ends = rng.permutation(np.linspace(1.0, 4.0, n) * rng.uniform(0.97, 1.03, n))
        self.a = np.sort(rng.uniform(1.0, 4.0, n))
        self.b = ends - self.a
        self.coupling = np.zeros((n, n))
        for i in range(n):
            for j in range(i):
                self.coupling[i, j] = self.coupling[j, i] = 10.0 ** rng.uniform(-6.0, -1.0) * rng.choice([-1, 1])
        damped = rng.uniform() < 0.5
        self.damping = rng.uniform(0.0, 0.2, n) * 10.0 ** rng.uniform(-4.0, 0.0) if damped else np.zeros(n)

    def matrix(self, p):
        """Return the matrix of the first-order equations."""
        K = np.diag(self.a + self.b * p) + self.coupling
        n = self.n
        return np.block([[np.zeros((n, n)), np.eye(n)], [-K, -np.diag(self.damping)]])

    def text(self, names):
        """Return the model with names for the modes at p = 0."""
        n = self.n
        numbers = {"p": 0.0}
        numbers |= {
            f"{x}{i}": float(v[i]) for x, v in (("a", self.a), ("b", self.b), ("d", self.damping)) for i in range(n)
        }
        numbers |= {f"c{i}{j}": float(self.coupling[i, j]) for i in range(n) for j in range(i)}
        bodies = ", ".join(f"m{i}: {{type: planar_point, mass: 1}}" for i in range(n))
        rows = ", ".join(f"r{i}: {{holonomic: m{i}.y}}" for i in range(n))
        forces = []
        for i in range(n):
            terms = [f"-(a{i} + b{i}*p)*m{i}.x - d{i}*rate(m{i}.x)"]
            terms += [f" - c{max(i, j)}{min(i, j)}*m{j}.x" for j in range(n) if j != i]
            forces.append(f"m{i}.x: {''.join(terms)}")
        modes = "".join(f"  {name}: {{near: {value.real!r}{value.imag:+.17g}i}}\n" for name, value in names.items())
        given = ", ".join(f"{name}: {value!r}" for name, value in numbers.items())
        return (
            f"mbstab: 1\nparameters: {{{given}}}\nbodies: {{{bodies}}}\nconstraints: {{{rows}}}\n"
            f"forces: {{all: {{type: expression, on: {{{', '.join(forces)}}}}}}}\nmodes:\n{modes}"
        )


def upper(case, p):
    """Return the upper eigenvalues with right and left eigenvectors, biorthonormal."""
    values, right = np.linalg.eig(case.matrix(p))
    left = np.linalg.inv(right)
    kept = np.flatnonzero(values.imag > 0.0)
    return values[kept], right[:, kept], left[kept]


def turns(values, right, left, slope):
    """Return the rate at which vectors turn into each other and eigenvalues approach, relative to their distances."""
    change = left @ slope @ right
    moved = np.abs(np.diag(change)[:, None] - np.diag(change)[None, :])
    gaps = np.abs(values[:, None] - values[None, :]) + np.diag(np.full(len(values), np.inf))
    return float(np.max(np.maximum(np.abs(change), moved) / gaps))


def truth(case):
    """Return the eigenvalues at p = 0 and those at p = 1 in their order, by their vectors."""
    p, slope = 0.0, case.matrix(1.0) - case.matrix(0.0)
    values, right, left = upper(case, p)
    first = values
    while p < 1.0:
        step = min(STEP / max(turns(values, right, left, slope), STEP), 1.0 - p)
        new_values, new_right, new_left = upper(case, p + step)
        # How much of an old mode is in each new one, and back: independent of the size of the vectors.
        overlap = np.abs((new_left @ right) * (left @ new_right).T)
        order = np.argmax(overlap, axis=0)
        assert np.min(overlap[order, np.arange(len(order))]) > OVERLAP
        assert len(set(order.tolist())) == len(order)
        p += step
        values, right, left = new_values[order], new_right[:, order], new_left[order]
    return first, values


def swaps(seed):
    """Return how many names a sweep carries to another eigenvalue than the truth, and how many there are."""
    case = Case(seed)
    first, last = truth(case)
    names = {f"n{k}": complex(value) for k, value in enumerate(first)}
    result = mbstab.loads(case.text(names)).sweep("p", np.linspace(0.0, 1.0, case.points))
    wrong = 0
    for k, value in enumerate(last):
        own = [result.branches[-1, b] for b, name in enumerate(result.names) if name == f"n{k}"]
        near = min((abs(x - value) for x in own), default=np.inf)
        other = min((abs(x - y) for x in own for y in last if y != value and x.imag > 0.0), default=np.inf)
        wrong += not near < other
    return wrong, len(last)
