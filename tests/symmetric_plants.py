"""Random plants with equal eigenvalues: the same equations along x and y, as of round rotors and quadrotors."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


class Plant:
    """Points in a plane, ẍ = −K x − C ẋ, where K and C are linear in the parameters p and r between 0 and 1.

    All but the last point have the same equations along x and y; some plants turn them into each other, as rotors do.
    The last one is an oscillator of its own along each axis: its eigenvalues cross the others.
    """

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m = int(rng.integers(1, 3))
        self.varied = ("p",) if seed % 2 else ("p", "r")
        self.goal = "damping" if seed % 5 == 4 else "decay"
        turning = 0.3 * (seed % 3 == 0)
        self.K, self.C = np.zeros((3, 2 * m + 2, 2 * m + 2)), np.zeros((3, 2 * m + 2, 2 * m + 2))
        for k in range(3):
            for matrix, size in ((self.K, (4.0, 3.0, 3.0)[k]), (self.C, (1.0, 1.5, 1.5)[k])):
                root = rng.normal(size=(m, m))
                same = size * (root @ root.T / m + 0.2 * np.eye(m)) * (1.0 if k == 0 else rng.choice([1.0, -0.4]))
                matrix[k, : 2 * m, : 2 * m] = np.kron(same, np.eye(2)) + turning * rng.normal() * np.kron(
                    np.eye(m), TURN
                )
                own = size * rng.uniform(0.1, 1.0, 2) * (1.0 if k == 0 else rng.choice([1.0, -0.5], 2))
                matrix[k, 2 * m :, 2 * m :] = np.diag(own)

    @property
    def text(self) -> str:
        """The model file."""
        bodies = [f"b{i}" for i in range(self.K.shape[1] // 2)]
        names = [f"{body}.{axis}" for body in bodies for axis in "xy"]
        on = {name: " ".join(self._terms(i, names)) for i, name in enumerate(names)}
        return "\n".join(
            [
                "mbstab: 1",
                "parameters: {p: 0.5, r: 0.5}",
                "bodies:",
                *(f"  {body}: {{type: planar_point, mass: 1}}" for body in bodies),
                "forces:\n  f:\n    type: expression\n    on:",
                *(f"      {name}: 0 {force}" for name, force in on.items()),
                f"reference: {{coordinates: {{{', '.join(f'{body}: {{x: 0, y: 0}}' for body in bodies)}}}}}",
            ]
        )

    def _terms(self, i: int, names: list[str]) -> Iterator[str]:
        for matrix, written in ((self.K, "{}"), (self.C, "rate({})")):
            for j, name in enumerate(names):
                a, b, c = matrix[:, i, j].tolist()
                if a or b or c:
                    yield f"- ({a!r} + ({b!r})*p + ({c!r})*r)*{written.format(name)}"

    def value(self, p: float, r: float = 0.5) -> float:
        """Return the smallest decay rate or damping ratio."""
        K, C = (x[0] + p * x[1] + r * x[2] for x in (self.K, self.C))
        n = len(K)
        s = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]]))
        return float(np.min(-s.real if self.goal == "decay" else -s.real / np.abs(s)))

    def best_of_grid(self) -> float:
        """Return the best value on a grid of 200 points."""
        if len(self.varied) == 1:
            return max(self.value(p) for p in np.linspace(0.0, 1.0, 200).tolist())
        rows, columns = np.linspace(0.0, 1.0, 20).tolist(), np.linspace(0.0, 1.0, 10).tolist()
        return max(self.value(p, r) for p in rows for r in columns)

    def designed(self, load: Any) -> tuple[float, str]:
        """Return the value at what `design` finds, and why it ended."""
        found = load(self.text).design({name: (0.0, 1.0) for name in self.varied}, self.goal)
        assert abs(found.best - self.value(**found.values)) <= 1e-6
        return found.best, found.ended
