"""Large scenes: sparse matrices, and answers from them, are those of small ones."""

import json

import numpy as np
import pytest
import yaml
from chains import four_bar_loops, hanging_chain, spring_chain, straight_chain, string_of_points
from random_mechanisms import random_mechanism

import mbstab
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.rank import rank_of
from mbstab.analysis.algebra.rounded import Rounded, rounded_arithmetic
from mbstab.analysis.algebra.rounded_arrays import RoundedArray, RoundedNumbers
from mbstab.analysis.algebra.sparse import in_sparse
from mbstab.analysis.algebra.sparse_rank import last_rows, sparse_null_space, sparse_rank
from mbstab.analysis.bounds.sparse_bounds import _Discs, _general
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.linear.sparse_pencil import SparsePencil
from mbstab.analysis.reference.requested import fits_sparse, reference_motion
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import System
from mbstab.errors import ConstraintError, MbstabError, NumericalError
from mbstab.model.values import evaluate


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


@pytest.mark.parametrize("seed", range(12))
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


# --- ranks ----------------------------------------------------------------------------------------------------------


def _rows(rng, independent, dependent, columns):
    """Return sparse rows of unit length, of which the last repeat the others."""
    from scipy.sparse import csr_array, random_array, vstack

    first = random_array((independent, columns), density=0.2, rng=rng) + csr_array(np.eye(independent, columns))
    mixed = random_array((dependent, independent), density=0.3, rng=rng) + csr_array(np.eye(dependent, independent))
    J = vstack([first, mixed @ first], format="csr")
    lengths = np.sqrt((J * J).sum(axis=1))
    return csr_array(J.multiply(1.0 / lengths[:, None]))


@pytest.mark.parametrize("dependent", [0, 1, 12])
def test_rank_null_space_and_inverse_are_those_of_a_singular_value_decomposition(dependent):
    J = _rows(np.random.default_rng(dependent), 30, dependent, 50)
    found, known = sparse_rank(J), rank_of(J.toarray())
    assert found.rank == known.rank == 30
    assert found.smallest_kept == pytest.approx(known.smallest_kept, rel=1e-3)
    assert found.largest_dropped < 1e-14
    np.testing.assert_allclose(found.null @ found.null.T, known.null @ known.null.T, atol=1e-12)
    np.testing.assert_allclose(found.left_null @ found.left_null.T, known.left_null @ known.left_null.T, atol=1e-11)
    np.testing.assert_allclose(found.pseudo_inverse @ np.eye(len(known.left_null)), known.pseudo_inverse, atol=1e-11)
    np.testing.assert_allclose(found.pseudo_inverse.T @ np.eye(50), known.pseudo_inverse.T, atol=1e-11)
    assert [i for i, _ in last_rows(found.left_null)] == list(range(30, 30 + dependent))


@pytest.mark.parametrize("size", [1e-3, 1e-5, 1e-7, 1e-9, 1e-10])
def test_small_singular_values_are_found(size):
    from scipy.sparse import csr_array

    J = _rows(np.random.default_rng(3), 30, 1, 50).toarray()
    J[-1] += size * np.random.default_rng(4).standard_normal(50)
    found, known = sparse_rank(csr_array(J)), rank_of(J)
    assert found.rank == known.rank == 31
    assert found.smallest_kept == pytest.approx(known.smallest_kept, rel=1e-3)


def test_null_space_of_columns():
    J = _rows(np.random.default_rng(8), 20, 0, 30).toarray()
    J[:, [3, 7]] = 0.0
    from scipy.sparse import csr_array

    null = sparse_null_space(csr_array(J), 30)
    np.testing.assert_allclose(null @ null.T, rank_of(J).null @ rank_of(J).null.T, atol=1e-10)
    assert sparse_null_space(csr_array(J), 5) is None


# --- rounding -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["governor", "whipple_bicycle", "cart_pendulum", "gear_train", "robot_arm"])
def test_elements_with_other_numbers_are_those_of_a_new_scene(name):
    model = mbstab.load(f"{name}.yaml").model
    scene = evaluate(model, arithmetic=rounded_arithmetic(), checked=True)
    found, new = System(evaluate(model)).renumbered(scene), System(evaluate(model, arithmetic=rounded_arithmetic()))
    for one, other in zip(found._elements, new._elements, strict=True):
        assert one.kernel is other.kernel
        assert (one.columns, one.rows, one.path) == (other.columns, other.rows, other.path)
        assert list(map(repr, one.parameters)) == list(map(repr, other.parameters))


def test_left_vectors_of_symmetric_equations_are_conjugates():
    """The same spectrum, to the bounds, as if nothing were known of the symmetry."""
    system = in_sparse(mbstab.loads(straight_chain(60, damping=0.05)).system())
    linear = linearize(system, reference_motion(system))
    pencil, other = SparsePencil(linear), SparsePencil(linear)
    grounds = Grounds(linear)
    problem = grounds.space, grounds.gamma, grounds.S, grounds.separated.T, grounds.separated.L
    other.symmetric = False
    with np.errstate(all="ignore"):
        one, two = (_Discs(p, *_general(*problem, p.symmetric)).placed() for p in (pencil, other))
    assert pencil.symmetric
    order = assigned(np.abs(one.values[:, None] - two.values))
    assert np.all(np.abs(one.values - two.values[order]) <= one.bounds + two.bounds[order])
    assert np.all(one.bounds <= 1.01 * two.bounds[order])


def test_arrays_of_rounded_numbers_are_rounded_numbers():
    rng = np.random.default_rng(2)
    pairs = [
        [Rounded(v, e) for v, e in zip(rng.uniform(0.5, 2.0, 6), 1e-13 * rng.random(6), strict=True)] for _ in "ab"
    ]
    one, other = (RoundedArray.of(x) for x in pairs)
    f, g = rounded_arithmetic(), RoundedNumbers().arithmetic([])
    cases = (
        (lambda h, x, y: x * y - 0.3 * x + 1.0), (lambda h, x, y: 1.5 - x / (y + 2.0)), (lambda h, x, y: -2.0 / x),
        (lambda h, x, y: h.sin(x) * h.atan2(x, y)), (lambda h, x, y: h.sqrt(abs(x - 3.0)) + y**2),
    )  # fmt: skip
    for case in cases:
        found = case(g, one, other)
        for v, e, x, y in zip(found.v, found.e, *pairs, strict=True):
            known = case(f, x, y)
            assert v == pytest.approx(known.v, rel=1e-15)  # sines of arrays and of numbers
            assert e == pytest.approx(known.e, rel=1e-12)


# --- answers --------------------------------------------------------------------------------------------------------


def _of_sparse(text):
    system = mbstab.loads(text).system()
    sparse = in_sparse(system)
    return eigenvalues(linearize(sparse, reference_motion(sparse)))


def _agree(one, other, vague=False):
    """Whether the discs of two answers meet one by one, and their verdicts agree."""
    values, bounds = (
        [np.array([f(e) for e in x.eigenvalues]) for x in (one, other)]
        for f in (lambda e: e.value, lambda e: 0.0 if e.kind == "neutral" else e.error_bound)
    )
    pairs = assigned(np.abs(values[0][:, None] - values[1]))
    assert np.all(np.abs(values[0] - values[1][pairs]) <= bounds[0] + bounds[1][pairs])
    assert vague or (one.verdict == other.verdict and one.judged.modulo == other.judged.modulo)
    with np.errstate(invalid="ignore"):  # of two that are infinite
        return bounds[1][pairs] / np.where(bounds[0] > 0.0, bounds[0], np.inf)


# These rest, with rows on positions only.
@pytest.mark.parametrize("seed", [5, 6, 7, 16, 17, 18, 19, 23, 29, 30, 31, 41, 42, 43, 53, 54, 55, 65])
def test_random_mechanisms_have_the_same_answer(seed, monkeypatch):
    monkeypatch.setattr("mbstab.analysis.algebra.tolerances.Tolerances.sparse_from_size", 1)
    text = random_mechanism(seed)
    assert fits_sparse(mbstab.loads(text).system())
    sparse = _of_sparse(text)
    monkeypatch.undo()
    known = mbstab.loads(text).eig()
    # What the discs leave open is answered as for small scenes.
    vague = sparse.verdict == "undecided"
    ratio = _agree(known, sparse, vague)
    assert vague or np.all(ratio < 3.0)


@pytest.mark.parametrize(
    "text",
    [straight_chain(6, "universal"), straight_chain(6, "spherical"), straight_chain(12, damping=0.1),
     four_bar_loops(8, "-pi/2"), spring_chain(np.random.default_rng(2), 5, damping=0.3),
     hanging_chain(np.random.default_rng(2), 9, masses=[10.0**k for k in range(9)])],
    ids=["universal", "spherical", "damped", "loops", "springs", "masses"],
)  # fmt: skip
def test_chains_have_the_same_answer(text):
    assert np.all(_agree(mbstab.loads(text).eig(), _of_sparse(text)) < 5.0)


def test_redundant_rows_are_named_alike():
    text = four_bar_loops(4, "-pi/2").replace('"pivot_4"', '"pivot_4b"')
    text = text.replace('"left_1"', '"again": {"type": "revolute", "between": ["crank_4.A", "ground.P"]},\n  "left_1"')
    text = text.replace('"joints"', '"ground": {"points": {"P": [4, 0]}},\n "joints"')
    known, sparse = mbstab.loads(text).eig(), _of_sparse(text)
    assert known.warnings == sparse.warnings
    assert any("redundant" in x for x in sparse.warnings)
    _agree(known, sparse)


def test_a_singular_configuration_is_refused_alike():
    text = four_bar_loops(3, 0)
    told = []
    for answer in (lambda: mbstab.loads(text).eig(), lambda: _of_sparse(text)):
        with pytest.raises(ConstraintError, match="singular configuration") as caught:
            answer()
        told.append(str(caught.value).splitlines()[-1])
    assert told[0] == told[1]


def test_frequencies_of_a_long_string_are_exact():
    count = 90
    # In long chains only: the matrices are sparse from 200 coordinates and rows on.
    result = mbstab.loads(string_of_points(count)).eig()
    assert result.verdict == "stable"
    zeros = np.polynomial.laguerre.laggauss(count)[0]
    found = np.sort([e.value.imag for e in result.eigenvalues if e.value.imag > 0.0])
    np.testing.assert_allclose(found, np.sqrt(9.81 * zeros), rtol=1e-13)
    bounds = np.array([e.error_bound / abs(e.value) for e in result.eigenvalues])
    assert np.all(bounds < 1e-11)


def test_coordinates_that_the_file_leaves_out():
    text = straight_chain(7).replace('"x": 0,', "")
    assert np.all(_agree(mbstab.loads(text).eig(), _of_sparse(text)) < 3.0)


@pytest.mark.parametrize("links", [50, 90])
def test_places_that_the_joints_determine(links):
    """The angles of a chain are given, and all places follow from joint to joint."""
    data = yaml.safe_load(hanging_chain(np.random.default_rng(links), links, stiffness=1.0, damping=0.1))
    given = mbstab.loads(json.dumps(data)).linearize()
    for place in data["reference"]["coordinates"].values():
        del place["x"], place["y"]
    found = mbstab.loads(json.dumps(data)).linearize()
    assert found.motion.q == pytest.approx(given.motion.q, abs=1e-11)


@pytest.mark.long
def test_modes_of_a_chain_whose_places_are_left_out():
    """Dense matrices of so many coordinates would be refused."""
    data = json.loads(string_of_points(800))
    given = mbstab.loads(json.dumps(data)).modes(4)
    for place in data["reference"]["coordinates"].values():
        del place["x"]
    found = mbstab.loads(json.dumps(data)).modes(4)
    assert [e.value for e in found.eigenvalues] == pytest.approx([e.value for e in given.eigenvalues], rel=1e-13)
    assert (found.verdict, found.counts.unstable_proven) == ("stable", 0)


def test_errors_of_sparse_matrices_cover_those_of_their_entries():
    system = mbstab.loads(hanging_chain(np.random.default_rng(4), 10, damping=0.2, stiffness=1.0)).system()
    sparse = in_sparse(system)
    one, other = (roundings(linearize(s, reference_motion(s))).errors for s in (system, sparse))
    for x, y in zip(one, other, strict=True):
        assert np.all(y.toarray() >= 0.5 * x)
        assert np.all(y.toarray() <= 3.0 * x + 1e-15 * np.max(x, initial=0.0))


# --- zeros that no structure explains -------------------------------------------------------------------------------


def _row_on_relaxed_springs(bodies, damping=0.0):
    """Return the text of planar bodies in a row, neighbours joined by springs that hold them along the row only."""
    names = range(bodies)
    model = {
        "mbstab": 1,
        "gravity": 0,
        "bodies": {f"p{i}": {"type": "planar", "mass": 1, "inertia": 0.1} for i in names},
        "forces": {
            f"s{i}": {"type": "spring", "between": [f"p{i}", f"p{i + 1}"], "stiffness": 1, "length": 1}
            | ({"damping": damping} if damping else {})
            for i in names[:-1]
        },
        "reference": {"coordinates": {f"p{i}": {"x": i, "y": 0, "theta": 0} for i in names}},
    }
    return json.dumps(model)


def test_many_zeros_that_nothing_explains_are_one_disc(monkeypatch):
    """Across the row nothing holds the bodies to first order: of n pairs of zeros two belong to symmetries."""
    bodies = 80
    dense = []
    monkeypatch.setattr(
        "mbstab.analysis.spectrum.eigenvalues.reference_motion", lambda s: dense.append(s.sparse) or reference_motion(s)
    )
    result = mbstab.loads(_row_on_relaxed_springs(bodies)).eig()
    assert dense == [True]  # dense matrices take minutes for so many zeros, and say no more
    assert result.verdict == "undecided"
    assert len(result.eigenvalues) == 6 * bodies
    near = [e for e in result.eigenvalues if e.kind == "undecided"]
    assert len(near) == 2 * (bodies - 2)
    assert all(abs(e.value) + e.error_bound < 1e-5 for e in near)
    found = np.sort([e.value.imag for e in result.eigenvalues if e.value.imag > 1e-3])
    known = 2.0 * np.sin(np.pi * np.arange(1, bodies) / (2 * bodies))
    np.testing.assert_allclose(found, known, rtol=1e-14)
    bound = max(e.error_bound / abs(e.value) for e in result.eigenvalues if abs(e.value) > 1e-3)
    assert bound < 2e-11


def test_few_zeros_that_nothing_explains_are_those_of_small_scenes():
    text = _row_on_relaxed_springs(6)
    known, sparse = mbstab.loads(text).eig(), _of_sparse(text)
    _agree(known, sparse)
    assert sparse.verdict == "undecided"
    assert max(e.error_bound for e in sparse.eigenvalues if e.kind == "undecided") < 1e-5


def on_a_slide(text):
    """Return the text of a planar chain whose upper end slides along x."""
    model = yaml.safe_load(text)
    del model["joints"]["pin_0"]
    model["constraints"] = {"slide": {"holonomic": "rod_0.y - 0.5*sin(rod_0.theta)"}}
    return yaml.safe_dump(model, sort_keys=False)


CHAINS = {
    "pinned": (lambda: straight_chain(45), []),
    "damped": (lambda: straight_chain(45, damping=0.01), []),
    "sliding": (lambda: on_a_slide(straight_chain(45)), ["translation along x"]),
    "spherical": (lambda: straight_chain(30, "spherical"), [f"rod_{i}.psi" for i in range(30)]),
}


@pytest.mark.parametrize(("written", "names"), CHAINS.values(), ids=CHAINS)
def test_symmetries_of_chains_are_found_element_by_element(written, names):
    system = in_sparse(mbstab.loads(written()).system())
    motion = reference_motion(system)
    assert [item.name for item in Invariance(system, motion).symmetries] == names


@pytest.mark.parametrize("written", [CHAINS["pinned"][0], CHAINS["sliding"][0]], ids=["pinned", "sliding"])
def test_rows_of_coordinates_alone_do_no_work(written, monkeypatch):
    system = in_sparse(mbstab.loads(written()).system())
    motion = reference_motion(system)

    def work():
        found = Work(Invariance(system, motion), motion.generators[0])
        return found.rows_at_rest, found.conserved, found.reversible

    assert work() == (True, True, True)
    monkeypatch.setattr(Invariance, "rows_of_places", False)
    assert work() == (True, True, True)
