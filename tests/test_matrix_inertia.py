"""Negative squares of constrained forms are counted where numbers differ by decades, and only where they are known."""

import json

import numpy as np
import pytest
from sampling import sample
from scipy import sparse

import mbstab
from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.sparse_rank import sparse_rank


def _random_form(rng):
    """Return sparse rows and a form, dense, and its number of negative squares on their null space."""
    n = int(rng.integers(3, 25))
    J = np.where(rng.random((int(rng.integers(0, n)), n)) < 0.3, rng.normal(size=(1, n)), 0.0)
    J = J[np.linalg.norm(J, axis=1) > 0.0]
    J = J / np.linalg.norm(J, axis=1, keepdims=True)
    J = J[sparse_rank(sparse.csr_array(J)).kept]
    K = np.where(rng.random((n, n)) < 0.2, rng.normal(size=(n, n)), 0.0) + np.diag(rng.normal(size=n))
    K = K + K.T
    N = np.linalg.svd(J)[2][len(J) :].T if len(J) else np.eye(n)
    values = np.linalg.eigvalsh(N.T @ K @ N)
    return J, K, int(np.sum(values < 0.0)), float(min(abs(values), default=0.0))


@pytest.mark.parametrize("seed", range(3))
def test_a_count_does_not_depend_on_units(seed):
    rng, told = np.random.default_rng(seed), 0
    for _ in range(25):
        J, K, negative, least = _random_form(rng)
        units, of_rows = 10.0 ** rng.uniform(-5, 5, len(K)), 10.0 ** rng.uniform(-3, 3, len(J))
        other, rows = K * units * units[:, None], J * units * of_rows[:, None]
        found = ConstrainedForms(sparse.csr_array(rows)).negatives(
            sparse.csr_array(other), sparse.csr_array(1e-15 * np.abs(other))
        )
        told += found is not None
        assert found in (None, negative)
        assert found is not None or least < 1e-6
    assert told > 15


def test_errors_that_change_the_count_leave_it_open():
    """Of forms within entrywise errors of one with a count all have that number of negative squares."""
    rng, told = np.random.default_rng(8), 0
    for _ in range(60):
        J, K, _, _ = _random_form(rng)
        size = 10.0 ** rng.uniform(-6, 0)
        errors = [size * np.abs(x) * rng.random(x.shape) for x in (K, J)]
        errors[0] = 0.5 * (errors[0] + errors[0].T)
        found = ConstrainedForms(*(sparse.csr_array(x) for x in (J, errors[1]))).negatives(
            *(sparse.csr_array(x) for x in (K, errors[0]))
        )
        if found is None:
            continue
        told += 1
        for _ in range(20):
            signs = np.triu(rng.choice((-1.0, 1.0), size=K.shape))
            nearby = K + errors[0] * (signs + np.triu(signs, 1).T)
            rows = J + errors[1] * rng.choice((-1.0, 1.0), size=J.shape)
            N = np.linalg.svd(rows)[2][len(rows) :].T if len(rows) else np.eye(len(K))
            assert np.sum(np.linalg.eigvalsh(N.T @ nearby @ N) < 0.0) == found
    assert told > 15


def _cantilever(rng, links, pressed):
    """Return the text of a row of links with springs between them, pressed along their line, and its stiffness."""
    m, k = (np.round(10.0 ** rng.uniform(*ends, links), 4) for ends in ((-2, 2), (1, 1.2)))
    step = np.eye(links) - np.eye(links, k=-1)
    K, load = step.T @ np.diag(k) @ step, 0.0
    if pressed:
        loads = np.linalg.eigvalsh(K)
        # Between two buckling loads.
        load = float(f"{0.5 * (loads[2] + loads[3]) / 0.1:.6g}")
        K = K - 0.1 * load * np.eye(links)
    names = [f"b{i}" for i in range(links)]
    bodies = {
        x: {"type": "planar", "mass": m[i], "inertia": f"{m[i]}*0.1**2/12", "points": {"a": [-0.05, 0], "b": [0.05, 0]}}
        for i, x in enumerate(names)
    }
    joints = {
        f"j{i}": {"type": "revolute", "between": [f"b{i}.a", f"b{i - 1}.b" if i else "ground"]} for i in range(links)
    }
    forces = {f"s{i}": {"type": "joint_spring", "joint": f"j{i}", "stiffness": k[i]} for i in range(links)}
    if pressed:
        forces["load"] = {"type": "force", "at": f"b{links - 1}.b", "vector": [-load, 0]}
    places = {x: {"x": f"({i}+1/2)*0.1", "y": 0, "theta": 0} for i, x in enumerate(names)}
    scene = {"mbstab": 1, "bodies": bodies, "joints": joints, "forces": forces, "reference": {"coordinates": places}}
    return json.dumps(scene), K


@pytest.mark.few(2)
@pytest.mark.parametrize("links", [40, 150])
@pytest.mark.parametrize("seed", sample(range(12), 3))
@pytest.mark.parametrize("pressed", [False, True])
def test_masses_over_decades_do_not_hide_the_stiffness(links, seed, pressed):
    text, K = _cantilever(np.random.default_rng(seed), links, pressed)
    values = np.linalg.eigvalsh(K)
    assert min(abs(values)) > 1e-6 * max(abs(values))
    model = mbstab.loads(text)
    full, few = model.eig(), model.modes(2)
    assert few.counts.unstable_proven == np.sum(values < 0.0)
    assert full.verdict == few.verdict == ("unstable" if pressed else "stable")
