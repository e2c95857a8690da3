"""Large scenes: sparse matrices are those that the elements give one by one."""

import numpy as np
import pytest
from chains import hanging_chain, spring_chain
from random_mechanisms import random_mechanism

import mbstab
from mbstab.analysis.algebra.sparse import in_sparse
from mbstab.errors import MbstabError, NumericalError


def _dense(x):
    return x.toarray() if hasattr(x, "toarray") else x


def _both(text):
    system = mbstab.loads(text).system()
    rng = np.random.default_rng(3)
    q, u, a = (rng.uniform(-0.5, 0.5, system.n_q) for _ in range(3))
    nu = rng.normal(size=system.n_c)
    for name, arguments in (
        ("dynamics", (q, u)), ("linearize", (q, u, a, nu)), ("linearize_rows", (q, u, a)), ("terms", (q, u, a, nu)),
    ):  # fmt: skip
        for one, other in zip(
            *(_listed(getattr(s, name)(*arguments)) for s in (system, in_sparse(system))), strict=True
        ):
            assert not hasattr(one, "toarray")
            assert one.ndim == 1 or hasattr(other, "toarray")
            yield one, _dense(other)


def _listed(found):
    found = found if isinstance(found, (dict, tuple)) else vars(found)
    return list(found.values() if isinstance(found, dict) else found)


@pytest.mark.parametrize("seed", range(24))
def test_sparse_assembly_of_random_mechanisms(seed):
    try:
        pairs = list(_both(random_mechanism(seed)))
    except MbstabError:
        pytest.skip("no mechanism")
    for one, other in pairs:
        np.testing.assert_allclose(other, one, rtol=1e-13, atol=1e-13 * np.max(np.abs(one), initial=0.0))


@pytest.mark.parametrize("chain", [hanging_chain, spring_chain])
def test_elements_of_one_kernel_are_evaluated_together(chain):
    for one, other in _both(chain(np.random.default_rng(1), 12, damping=0.3)):
        np.testing.assert_allclose(other, one, rtol=1e-14, atol=1e-14 * np.max(np.abs(one), initial=0.0))


def test_what_has_no_value_is_named_as_without_sparse_matrices():
    bodies = "".join(f"  p{i}: {{type: planar, mass: 1, inertia: 1}}\n" for i in range(8))
    springs = "".join(
        f"  s{i}: {{type: spring, between: [p{i}, p{i + 1}], stiffness: 1, length: 1}}\n" for i in range(7)
    )
    places = "".join(f"    p{i}: {{x: {i}, y: 0, theta: 0}}\n" for i in range(8))
    text = f"mbstab: 1\ngravity: 0\nbodies:\n{bodies}forces:\n{springs}reference:\n  coordinates:\n{places}"
    system = mbstab.loads(text).system()
    zero = np.zeros(system.n_q)
    told = []
    for s in (system, in_sparse(system)):
        with pytest.raises(NumericalError, match="s0 has no finite equations") as caught:
            s.dynamics(zero, zero)
        told.append(str(caught.value))
    assert told[0] == told[1]
