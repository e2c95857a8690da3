"""A few eigenvalues of large scenes, and the number of unstable ones counted without them."""

import json
import random

import linear_oracle
import mpmath
import numpy as np
import pytest
from chains import four_bar_loops, hanging_chain, spring_chain
from random_mechanisms import random_mechanism
from sampling import sample
from scipy import sparse

import mbstab
from mbstab.analysis.algebra.inertia import ConstrainedForms
from mbstab.analysis.algebra.sparse_rank import sparse_rank
from mbstab.analysis.verdict.rule import STRENGTH
from mbstab.cli import main
from mbstab.errors import MbstabError, UsageError

GRAVITY = 9.81


def plumb_line(masses, gravity=-GRAVITY):
    """Return the text of equal point masses on a line, 1 m from each other, that hang from the ground or stand."""
    names = range(1, masses + 1)
    bodies = "".join(f"  b{i}: {{type: planar_point, mass: 1}}\n" for i in names)
    ends = [f"[b{i}, {f'b{i - 1}' if i > 1 else 'ground'}]" for i in names]
    joints = "".join(
        f"  j{i}: {{type: distance, between: {end}, length: 1}}\n" for i, end in zip(names, ends, strict=True)
    )
    places = "".join(f"    b{i}: {{x: 0, y: {-i}}}\n" for i in names)
    start = f"mbstab: 1\ngravity: [0, {gravity}]\n"
    return f"{start}bodies:\n{bodies}joints:\n{joints}reference:\n  coordinates:\n{places}"


def laguerre(masses, near):
    """Return the exact frequency near one: ω²/g is a zero of the Laguerre polynomial (D. Bernoulli 1733)."""
    with mpmath.workdps(40):
        g = mpmath.mpf("9.81")
        return mpmath.sqrt(g * mpmath.findroot(lambda x: mpmath.laguerre(masses, 0, x), mpmath.mpf(near) ** 2 / g))


def outcome(text, count):
    """Return all eigenvalues with bounds and a few of them; skip what cannot be answered."""
    try:
        model = mbstab.loads(text)
        full = model.eig()
        return full, model.modes(min(count, full.counts.found))
    except MbstabError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("masses", [3, 200])
def test_slow_modes_of_a_plumb_line_are_those_of_laguerre(masses):
    result = mbstab.loads(plumb_line(masses)).modes(3)
    found = [e for e in result.eigenvalues if e.value.imag > 0.0]
    assert len(found) == 3
    for e in found:
        error = abs(float(e.value.imag - laguerre(masses, e.value.imag)))
        assert error <= min(e.error_bound, 1e-14 * abs(e.value))
        assert e.kind == "center"
        assert e.value.real == 0.0
    assert result.counts.unstable_proven == 0
    assert result.verdict == "stable"


@pytest.mark.parametrize("masses", [3, 200])
def test_all_modes_of_a_plumb_line_upside_down_grow(masses):
    result = mbstab.loads(plumb_line(masses, GRAVITY)).modes(2)
    assert result.counts.unstable_proven == masses
    assert result.verdict == "unstable"
    assert [e.kind for e in result.eigenvalues] == ["saddle"] * 2 or all(
        e.value.imag == 0.0 for e in result.eigenvalues
    )


def test_instability_is_counted_where_nothing_found_grows():
    """Pendulums that hang, and a stiff one that stands: nothing near zero says so."""
    text = plumb_line(30).replace(
        "joints:\n",
        "  up: {type: planar_point, mass: 1}\njoints:\n  rod: {type: distance, between: [up, ground], length: 1e-4}\n",
    )
    result = mbstab.loads(text + "    up: {x: 0, y: 1e-4}\n").modes(2)
    assert all(e.kind == "center" for e in result.eigenvalues)
    assert result.counts.unstable_proven == 1
    assert (result.verdict, result.counts.found) == ("unstable", 4)
    assert "1 eigenvalue lies right" in result.reasons[0]


# The vectors of 81 are those of a search that does not converge well beside zeros with a chain.
@pytest.mark.parametrize("seed", [52, 81, *sample([x for x in range(96) if x not in (52, 81)], 22)])
def test_modes_of_random_mechanisms(seed):
    full, few = outcome(random_mechanism(seed), 3)
    values = np.array([e.value for e in full.eigenvalues])
    known = np.array([0.0 if e.kind == "neutral" else e.error_bound for e in full.eigenvalues])
    judged = [e for e in few.eigenvalues if e.kind != "neutral"]
    for e in judged:
        assert np.min(np.abs(values - e.value) - known) <= e.error_bound
    radius = max((e.error_bound for e in judged), default=0.0)
    # What cannot be told from zero has no order: it may be a pair on either axis.
    every = sorted(abs(v) for v, r in zip(values, known, strict=True) if v.imag >= 0.0 and abs(v) > max(r, radius))
    unclear = max([radius, *(r for v, r in zip(values, known, strict=True) if abs(v) <= max(r, radius))])
    upper = [e for e in judged if e.value.imag >= 0.0]
    found = sorted(abs(e.value) for e in upper if abs(e.value) > unclear)
    if not any("were found" in text for text in few.warnings):
        assert len(upper) == min(3, len(every) + len(upper) - len(found))
        for one, other in zip(found, every, strict=False):
            assert abs(one - other) <= 1e-6 * other + 2.0 * radius
    if few.counts.unstable_proven is not None:
        right = sum(bool(v.real > r) for v, r in zip(values, known, strict=True))
        undecided = sum(e.kind == "undecided" for e in full.eigenvalues)
        assert right <= few.counts.unstable_proven <= right + undecided
    assert few.verdict in STRENGTH[full.verdict] or full.verdict == "undecided"


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", sample(range(12), 4))
def test_counts_of_linear_systems(seed):
    """Damped, gyroscopic and circulatory forces, indefinite, critical and defective ones."""
    rng, counted = random.Random(seed), 0
    for _ in range(12):
        K, D = linear_oracle.random_system(rng, rng.choice((1, 2, 3, 4)))
        n, truth = len(K), linear_oracle.truth(K, D)
        result = mbstab.loads(linear_oracle.text(K, D)).modes(1)
        assert result.verdict in truth.allowed
        if result.counts.unstable_proven is not None:
            A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.array(K, float), -np.array(D, float)]])
            values = np.linalg.eigvals(A)
            counted += 1
            # A defective zero is scattered by a root of the rounding.
            assert result.counts.unstable_proven == np.sum(values.real > 1e-3)
    assert counted > 4


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "text",
    [
        hanging_chain(np.random.default_rng(1), 40, damping=0.1, stiffness=1.0),
        spring_chain(np.random.default_rng(2), 12, damping=0.2),
    ],
    ids=["damped", "spatial"],
)
def test_nearest_and_rightmost(text):
    full, slow = outcome(text, 4)
    values = np.array([e.value for e in full.eigenvalues if e.value.imag >= 0.0])
    size = max(abs(values))
    for few, wanted in (
        (slow, sorted(values, key=abs)),
        (mbstab.loads(text).modes(4, near=-0.3j), sorted(values, key=lambda s: abs(s - 0.3j))),
        (mbstab.loads(text).modes(4, near=-3 + 2j), sorted(values, key=lambda s: abs(s + 3 - 2j))),
        (mbstab.loads(text).modes(4, rightmost=True), sorted(values, key=lambda s: -s.real)),
    ):
        found = [e for e in few.eigenvalues if e.value.imag >= 0.0]
        assert len(found) == 4
        for s in wanted[:3] if few.verdict == "asymptotically stable" else []:
            assert min(abs(e.value - s) for e in found) <= 1e-12 * size
        for e in found:
            assert np.min(np.abs(values - e.value)) <= e.error_bound
    assert slow.counts.unstable_proven == 0
    assert slow.verdict == full.verdict


@pytest.mark.parametrize("angle", ["-pi/2", "pi/2"])
def test_loops(angle):
    full, few = outcome(four_bar_loops(20, angle), 1)
    for e in few.eigenvalues:
        assert min(abs(e.value - x.value) for x in full.eigenvalues) <= e.error_bound
    assert few.counts.unstable_proven == (angle == "pi/2")
    assert few.verdict == full.verdict


def test_redundant_rows_are_left_out_and_named():
    text = plumb_line(120).replace("joints:\n", "joints:\n  again: {type: distance, between: [b60, b59], length: 1}\n")
    result = mbstab.loads(text).modes(2)
    assert (result.counts.n_holonomic, result.counts.rank_holonomic, result.counts.expected) == (121, 120, 240)
    assert any("redundant constraint" in w and "j60" in w and "again" in w for w in result.warnings)
    plain = mbstab.loads(plumb_line(120)).modes(2)
    assert np.allclose(result.values(), plain.values(), rtol=1e-13)


def test_neutral_shifts_are_counted_apart():
    """A chain of masses and springs that nothing holds: two zeros, and none of them is looked for."""
    bodies = "".join(f"  b{i}: {{type: planar_point, mass: 1}}\n" for i in range(40))
    rails = "".join(f"  r{i}: {{type: point_on_line, between: [ground, b{i}], axis: x}}\n" for i in range(40))
    springs = "".join(
        f"  s{i}: {{type: spring, between: [b{i}, b{i + 1}], stiffness: 3, length: 1}}\n" for i in range(39)
    )
    places = "".join(f"    b{i}: {{x: {i}, y: 0}}\n" for i in range(40))
    text = f"mbstab: 1\nbodies:\n{bodies}joints:\n{rails}forces:\n{springs}reference:\n  coordinates:\n{places}"
    result = mbstab.loads(text).modes(2)
    exact = [2.0 * np.sqrt(3.0) * np.sin(k * np.pi / 80) for k in (1, 2)]
    assert np.allclose(sorted(e.value.imag for e in result.eigenvalues if e.value.imag > 0), exact, rtol=1e-13)
    assert (result.counts.neutral, result.counts.unstable_proven) == (2, 0)
    assert result.verdict == "undecided"


def test_without_a_count_the_answer_is_a_part():
    """Undamped gyroscopic forces on two unstable directions: neither their number nor stability is known."""
    K, D = [[-1, 0], [0, -1]], [[0, 3], [-3, 0]]
    result = mbstab.loads(linear_oracle.text(K, D)).modes(1)
    assert result.counts.unstable_proven is None
    assert result.verdict == "undecided"
    assert "2 of 4 eigenvalues were looked for" in result.reasons[0]
    assert "not counted" in result.reasons[0]


def test_negative_squares_of_random_forms():
    rng, told = np.random.default_rng(4), 0
    for _ in range(40):
        n = int(rng.integers(3, 30))
        c = int(rng.integers(0, n))
        J = np.where(rng.random((c, n)) < 0.3, rng.normal(size=(c, n)), 0.0)
        J = J[np.linalg.norm(J, axis=1) > 0.0]
        J = J / np.linalg.norm(J, axis=1, keepdims=True)
        J = J[sparse_rank(sparse.csr_array(J)).kept]
        assert np.linalg.matrix_rank(J) == len(J)
        K = np.where(rng.random((n, n)) < 0.2, rng.normal(size=(n, n)), 0.0)
        K = K + K.T
        N = np.linalg.svd(J)[2][len(J) :].T if len(J) else np.eye(n)
        values = np.linalg.eigvalsh(N.T @ K @ N)
        found = ConstrainedForms(sparse.csr_array(J)).negatives(
            sparse.csr_array(K), sparse.csr_array(1e-14 * np.abs(K))
        )
        told += found is not None
        assert found in (None, int(np.sum(values < 0.0)))
        assert found is not None or min(abs(values), default=0.0) < 1e-10
    assert told > 15


def test_a_form_that_rounding_may_change_has_no_count():
    forms = ConstrainedForms(sparse.csr_array(np.array([[1.0, 0.0, 0.0]])))
    K = sparse.csr_array(np.diag([1.0, 1.0, 1e-13]))
    everywhere = sparse.csr_array(np.ones((3, 3)))
    assert forms.negatives(K, 1e-18 * everywhere) == 0
    assert forms.negatives(K, 1e-12 * everywhere) is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--modes", "0"], "--modes 0"),
        (["--modes", "-3"], "hint: give a whole number"),
        (["--modes", "3"], "3 modes are asked for, there are 2 finite eigenvalues\nhint: give a number up to 2"),
        (["--modes", "1", "--near", "fast"], "--near fast: that is not a number"),
        (["--modes", "1", "--near", "inf"], "that is not a number"),
        (["--modes", "1", "--near", "1", "--rightmost"], "leave out one of them"),
        (["--near", "1"], "hint: give --modes K"),
        (["--rightmost"], "hint: give --modes K"),
        (["--modes", "1", "--method", "index3"], "--modes goes with none"),
        (["--modes", "1", "--certify"], "--modes goes with none"),
        (["--modes", "1", "--precision", "30"], "--modes goes with none"),
        (["--modes", "1", "--frozen"], "--modes goes with none"),
        (["--modes", "1", "--verify"], "--modes goes with none"),
    ],
)
def test_options_that_make_no_sense(arguments, message, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["eig", "pendulum.yaml", *arguments])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("near", ["0.1", "20i", "-1+5i", "-2 + 3j"])
def test_json_says_what_was_counted(near, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["eig", "pendulum.yaml", "--modes", "1", "--near", near, "--format", "json"])
    assert not stop.value.code
    data = json.loads(capsys.readouterr().out)
    assert data["counts"]["unstable_proven"] == 0
    assert "inertia of the stiffness" in data["counts"]["counted"]
    assert data["verdict"] == "stable"
    assert [e["kind"] for e in data["eigenvalues"]] == ["center"] * 2


def test_arguments_of_the_library():
    model = mbstab.load("pendulum.yaml")
    for arguments in (
        {"count": 0},
        {"count": 1.5},
        {"count": 1, "near": "x"},
        {"count": 1, "near": 1j, "rightmost": True},
    ):
        with pytest.raises(UsageError):
            model.modes(**arguments)
    with pytest.raises(UsageError, match="multipliers"):
        mbstab.load("kapitza.yaml").modes(1)


@pytest.mark.parametrize(
    "model", ["top.yaml", "rolling_disk.yaml", "whipple_bicycle.yaml", "four_bar.yaml", "governor.yaml"]
)
def test_examples_in_motion_and_loops(model):
    mechanism = mbstab.load(model)
    full, few = mechanism.eig(), mechanism.modes(2)
    values = np.array([e.value for e in full.eigenvalues])
    for e in few.eigenvalues:
        if e.kind != "neutral":
            assert np.min(np.abs(values - e.value)) <= e.error_bound * (1.0 + 1e-9) + 1e-12
    assert few.verdict in STRENGTH[full.verdict]


@pytest.mark.parametrize("growth", ["1e-10", "1e-12", "1e-40"])
def test_weak_growth_beside_a_strong_damper_is_not_counted_as_damping(growth):
    result = mbstab.loads(f"""
mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{a.x: -a.x-1e6*rate(a.x), a.y: -a.y+{growth}*rate(a.y)}}}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}
""").modes(2)
    assert result.counts.unstable_proven != 0
    assert result.verdict in ("unstable", "undecided")


def equal_oscillators(copies, odd):
    """Return the text of equal damped points in a plane with another one among them: ẍ = −k x − d ẋ ∓ c y."""
    blocks = [(4.0, 0.5, 0.0)] * copies
    blocks[copies // 2] = odd
    bodies = "".join(f"  p{i}: {{type: planar_point, mass: 1}}\n" for i in range(copies))
    forces = "".join(
        f"  f{i}: {{type: expression, on: {{p{i}.x: '{-k!r}*p{i}.x + {-d!r}*rate(p{i}.x) + {-c!r}*p{i}.y', "
        f"p{i}.y: '{-k!r}*p{i}.y + {-d!r}*rate(p{i}.y) + {c!r}*p{i}.x'}}}}\n"
        for i, (k, d, c) in enumerate(blocks)
    )
    places = "".join(f"    p{i}: {{x: 0, y: 0}}\n" for i in range(copies))
    return f"mbstab: 1\nbodies:\n{bodies}forces:\n{forces}reference:\n  coordinates:\n{places}"


@pytest.mark.parametrize("copies", sample([7, 16, 20, 48], 3))
@pytest.mark.parametrize(
    ("odd", "unstable"),
    [
        ((9.0, -0.1, 0.0), 4),
        ((4.0, 0.5, 0.1), 0),
        ((9.0, 1e-3, 2.9997e-3), 0),
        ((9.0, 1e-3, 3.0003e-3), 2),
        ((-1.0, 0.3, 0.0), 2),
    ],
)
def test_many_equal_eigenvalues_are_counted_right(copies, odd, unstable):
    result = mbstab.loads(equal_oscillators(copies, odd)).modes(2)
    assert result.counts.unstable_proven == unstable
    assert (result.verdict == "unstable") == (unstable > 0)


@pytest.mark.few(1)
@pytest.mark.parametrize(("damping", "unstable"), [(0.1, 0), (1.5, 2)])
def test_a_long_chain_with_a_circulatory_force_is_counted_right(damping, unstable):
    n, k = 120, 60
    K = 3.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 2.0
    R = 0.4 * np.eye(n)
    K[k, k + 1] += 0.05
    K[k + 1, k] -= 0.05
    R[k, k] -= damping
    values = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K, -R]]))
    assert np.sum(values.real > 0.0) == unstable
    names = [f"p{i}.x" for i in range(n)]
    forces = "".join(
        f"  f{i}: {{type: expression, on: {{{x}: '"
        + " ".join(f"{-K[i, j]:+}*{y}" for j, y in enumerate(names) if K[i, j])
        + f" {-R[i, i]:+}*rate({x})'}}}}\n"
        for i, x in enumerate(names)
    )
    bodies = "".join(f"  p{i}: {{type: planar_point, mass: 1}}\n" for i in range(n))
    rails = "".join(f"  r{i}: {{type: point_on_line, between: [ground, p{i}], axis: x}}\n" for i in range(n))
    places = "".join(f"    p{i}: {{x: 0, y: 0}}\n" for i in range(n))
    text = f"mbstab: 1\nbodies:\n{bodies}joints:\n{rails}forces:\n{forces}reference:\n  coordinates:\n{places}"
    assert mbstab.loads(text).modes(2).counts.unstable_proven == unstable


TURNING = """mbstab: 1
parameters: {{w: 1.512}}
bodies:
  hub: {{type: planar, mass: 2, inertia: 0.7, points: {{B: [0.7, 0.3]}}}}
  arm: {{type: planar, mass: 1.5, inertia: 1.1, points: {{F: [-0.6, 0]}}}}
joints:
  axle: {{type: revolute, between: [hub, ground]}}
  hinge: {{type: revolute, between: [arm.F, hub.B]}}
forces:
  hinge: {{type: joint_spring, joint: hinge, stiffness: 27, damping: {damping}, rest: 0.31}}
  motor: {{type: expression, on: {{hub.theta: '1.5*(w - rate(hub.theta))'}}}}
reference:
  {{find: steady, coordinates: {{hub: {{theta: 0.3}}}}, rates: {{hub: {{theta: w}}}}, steady: {{axis: z, rate: w}}}}
"""


@pytest.mark.parametrize("damping", [0, 0.4, 40])
@pytest.mark.parametrize("rightmost", [False, True])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_zero_of_a_steady_turn_is_one_value_and_hides_no_others(count, rightmost, damping):
    model = mbstab.loads(TURNING.format(damping=damping))
    every = [e.value for e in model.eig().eigenvalues]
    upper = sorted((s for s in every if s.imag >= 0), key=lambda s: -s.real if rightmost else abs(s))
    found = model.modes(count, rightmost=rightmost)
    values = [e.value for e in found.eigenvalues if e.value.imag >= 0]
    assert np.allclose(values, sorted(upper[:count], key=lambda s: -s.real), rtol=0, atol=1e-10)
    assert found.counts.found == len(found.eigenvalues) <= found.counts.expected
    assert not any("lost" in warning for warning in found.warnings)


@pytest.mark.parametrize(
    "law",
    [
        "b.x: '-b.x - 2*rate(b.x)', b.y: '-3*b.y - rate(b.y)'",
        "b.x: '-b.x - 2*rate(b.x) + b.y', b.y: '-b.y - 2*rate(b.y)'",
        "b.x: '-b.x - 2*rate(b.x) + 3*b.y', b.y: '-b.y - 2*rate(b.y)'",
    ],
)
@pytest.mark.parametrize("near", [0.0, -0.9, -1 + 0.01j, 2j])
def test_the_nearest_eigenvalue_is_not_left_out_because_it_is_defective(law, near):
    place = "reference: {coordinates: {b: {x: 0, y: 0}}}"
    body = "bodies: {b: {type: planar_point, mass: 1}}"
    result = mbstab.loads(f"mbstab: 1\n{body}\nforces: {{law: {{type: expression, on: {{{law}}}}}}}\n{place}\n").modes(
        2, near=near
    )
    lost = any("lost" in warning for warning in result.warnings)
    assert lost or min(abs(e.value + 1) for e in result.eigenvalues) < 1e-2
    for e in result.eigenvalues:
        assert min(abs(e.value - s) for s in (-1, -0.5 + 0.5j * 11**0.5, -0.5 - 0.5j * 11**0.5)) <= e.error_bound


def scattered_chain(rng):
    """Return the text of a chain along x with numbers of all sizes, and the determinant of its equations."""
    count = int(rng.integers(3, 5))
    m, k, c = ([float(f"{10.0**x:.3g}") for x in rng.uniform(*ends, count)] for ends in ((-16, 28), (-10, 7), (-7, 14)))
    c = [x if rng.random() < 0.6 else 0.0 for x in c]
    bodies = {f"b{i}": {"type": "planar_point", "mass": x} for i, x in enumerate(m)}
    loads = {f"b{i}.x": "0" for i in range(count)}
    for i in range(count):
        back, rate = (f"b{i - 1}.x", f"rate(b{i - 1}.x)") if i else ("0", "0")
        force = f"({k[i]!r}*(b{i}.x - {back}) + {c[i]!r}*(rate(b{i}.x) - {rate}))"
        loads[f"b{i}.x"] += f" - {force}"
        if i:
            loads[f"b{i - 1}.x"] += f" + {force}"
    data = {
        "mbstab": 1,
        "bodies": bodies,
        "constraints": {f"h{i}": {"holonomic": f"b{i}.y"} for i in range(count)},
        "forces": {"f": {"type": "expression", "on": loads}},
    }

    def determinant(s):
        links = [mpmath.mpf(repr(a)) + mpmath.mpf(repr(b)) * s for a, b in zip(k, c, strict=True)] + [mpmath.mpf(0)]
        before, now = mpmath.mpf(0), mpmath.mpf(1)
        for i, mass in enumerate(m):
            whole = links[i] + links[i + 1] + mpmath.mpf(repr(mass)) * s**2
            before, now = now, whole * now - links[i] ** 2 * before
        return now

    return json.dumps(data), determinant


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", sample(range(36), 4))
def test_bounds_hold_beside_eigenvalues_that_are_lost(seed):
    rng = np.random.default_rng(seed)
    text, determinant = scattered_chain(rng)
    model = mbstab.loads(text)
    shifts = [1j * 10.0 ** rng.uniform(-10, 20), 10.0 ** rng.uniform(-12, 10), 1e4j]
    for asked in ({}, *({"near": shift} for shift in shifts), {"rightmost": True}):
        for e in model.modes(2, **asked).eigenvalues:
            if not e.error_bound < 0.1 * abs(e.value):
                continue
            with mpmath.workdps(400):
                s = mpmath.mpc(e.value)
                true = mpmath.findroot(determinant, (s, s * (1 + mpmath.mpf(10) ** -20)), verify=False, maxsteps=60)
                assert abs(true - s) <= e.error_bound, (asked, e)


# --- damped chains, against a formulation in angles of their own ------------------------------------------------------


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
@pytest.mark.few(2)
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


@pytest.mark.few(1)
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
