"""The rightmost eigenvalues, and others, of damped chains, against a formulation in angles of their own."""

import json
import random

import numpy as np
import pytest
from sampling import sample

import mbstab


def chain(seed, links):
    """Return the text of a row of links with damped joints and a load that follows the last, and its M, C and K."""
    rng = random.Random(seed)
    length, decades = rng.choice((1 / links, 0.1)), rng.choice((0, 1, 2))
    m = [float(f"{10 ** rng.uniform(-decades, decades):.3g}") for _ in range(links)]
    k = [float(f"{10 ** rng.uniform(1, 2):.3g}") for _ in range(links)]
    c0, drag = rng.choice((1e-3, 1e-2, 1.0, 10.0)), rng.choice((0.0, 0.1, 1.0))
    c = [float(f"{c0 * x:.3g}") for x in k]
    load = float(f"{rng.choice((0.0, 5.0, 30.0)) / (links * length) * rng.uniform(1, 10):.3g}")
    # Heights of centres and differences of angles from the angles of the links.
    heights = length * (np.tri(links, k=-1) + 0.5 * np.eye(links))
    step = np.eye(links) - np.eye(links, k=-1)
    M = heights.T @ np.diag(m) @ heights + np.diag(m) * length**2 / 12.0
    C = step.T @ np.diag(c) @ step + drag * heights.T @ heights
    K = step.T @ np.diag(k) @ step - load * length * np.eye(links)
    K[:, -1] += load * length
    forces = {}
    for i in range(links):
        forces[f"s{i}"] = {"type": "joint_spring", "joint": f"j{i}", "stiffness": k[i], "damping": c[i]}
        if drag:
            law = {f"b{i}.{x}": f"-{drag}*rate(b{i}.{x})" for x in "xy"}
            forces[f"e{i}"] = {"type": "expression", "on": law}
    if load:
        last = f"b{links - 1}"
        forces["load"] = {"type": "force", "at": f"{last}.b", "vector": [-load, 0], "frame": "body"}
    ends = {"a": [-length / 2, 0], "b": [length / 2, 0]}
    bodies = {
        f"b{i}": {"type": "planar", "mass": m[i], "inertia": f"{m[i]}*{length!r}**2/12", "points": ends}
        for i in range(links)
    }
    joints = {
        f"j{i}": {"type": "revolute", "between": [f"b{i}.a", f"b{i - 1}.b" if i else "ground"]} for i in range(links)
    }
    places = {f"b{i}": {"x": f"({i}+1/2)*{length!r}", "y": 0, "theta": 0} for i in range(links)}
    scene = {"mbstab": 1, "bodies": bodies, "joints": joints, "forces": forces, "reference": {"coordinates": places}}
    return json.dumps(scene), M, C, K


def eigenvalues(M, C, K):
    """Return the roots of det(s²M + sC + K), those with small real parts refined."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.array([_refined(s, M, C, K) for s in np.linalg.eigvals(A)])


def _refined(s, M, C, K):
    """Return the root near s, by inverse iteration with both vectors."""
    # Beside the value, which may be an exact one.
    s = s * (1.0 + 1e-9)
    Q = s * s * M + s * C + K
    x = y = np.ones(len(M), dtype=complex)
    with np.errstate(all="ignore"):
        for _ in range(3):
            x, y = np.linalg.solve(Q, x), np.linalg.solve(Q.T, y)
            x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
        step = (y @ Q @ x) / (y @ (2.0 * s * M + C) @ x)
    return s - step if abs(step) < 1e-3 * abs(s) else s


def upper(result):
    return [e for e in result.eigenvalues if e.value.imag >= 0.0]


# Far up the axis all eigenvalues of 6 and 9 are at about the same distance: iterations do not converge there.
@pytest.mark.parametrize("seed", [6, 9, *sample([x for x in range(60) if x not in (6, 9)], 4)])
@pytest.mark.parametrize("links", [30, 70])
def test_rightmost_eigenvalues_of_damped_chains(seed, links):
    text, *matrices = chain(seed, links)
    true = eigenvalues(*matrices)
    size, growing = np.max(np.abs(true)), int(np.sum(true.real > 0.0))
    result = mbstab.loads(text).modes(3, rightmost=True)
    assert result.counts.unstable_proven in (None, growing)
    assert (result.verdict == "unstable") == (growing > 0) or result.verdict == "undecided"
    first = sorted(true[true.imag >= 0.0], key=lambda s: -s.real)[:3]
    found = sorted((e.value for e in upper(result)), key=lambda s: -s.real)
    assert len(found) == 3
    for one, other in zip(found, first, strict=True):
        # Real parts may be equal.
        assert abs(one.real - other.real) <= 1e-6 * abs(other) + 1e-12 * size
    for e in upper(result):
        assert np.min(np.abs(true - e.value)) <= e.error_bound + 1e-6 * abs(e.value) + 1e-12 * size


@pytest.mark.parametrize("seed", sample(range(100), 4))
@pytest.mark.parametrize("links", [20, 60])
def test_all_and_a_few_eigenvalues_agree(seed, links):
    text, *_ = chain(seed, links)
    model = mbstab.loads(text)
    full = model.eig()
    growing = sum(e.value.real > e.error_bound for e in full.eigenvalues)
    for few in (model.modes(3), model.modes(3, rightmost=True), model.modes(2, near=1j)):
        assert few.counts.unstable_proven in (None, growing)
        assert "undecided" in (few.verdict, full.verdict) or (few.verdict == "unstable") == (full.verdict == "unstable")
        for e in few.eigenvalues:
            assert min(abs(e.value - x.value) - x.error_bound for x in full.eigenvalues) <= e.error_bound
