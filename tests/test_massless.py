"""Bodies without mass or inertia: motions that joints, springs and dampers determine all the same."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp
from sampling import sample
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals, expm
from scipy.optimize import brentq, fsolve, linear_sum_assignment

import mbstab
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.verdict.rule import RIGHT
from mbstab.errors import MassError, MbstabError, NumericalError


def close(found, expected, part):
    """Whether two sets of eigenvalues are equal, each relative to its own size."""
    found, expected = np.asarray(found, dtype=complex), np.asarray(expected, dtype=complex)
    assert len(found) == len(expected)
    rows, columns = linear_sum_assignment(np.abs(found[:, None] - expected))
    return bool(np.all(np.abs(found[rows] - expected[columns]) <= part * np.abs(expected[columns])))


# --- massless links and frames: joints determine their motion ---------------------------------------------------------

RODS = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {m: 1, M: 2}
bodies:
  one: {type: planar, mass: 0, inertia: 0}
  a: {type: planar_point, mass: m}
  two: {type: planar, mass: 0, inertia: 0}
  b: {type: planar_point, mass: M}
joints:
  O: {type: revolute, between: [{body: one, point: [0, 1]}, ground]}
  A: {type: revolute, between: [one, a]}
  B: {type: revolute, between: [{body: two, point: [0, 1]}, a]}
  C: {type: revolute, between: [two, b]}
reference:
  coordinates: {one: {theta: 0}, two: {theta: 0}}
  guess: {a: {y: -1}, one: {y: -1}, b: {y: -2}, two: {y: -2}}
"""


def double_pendulum(m, M):
    """Return the frequencies of two point masses on massless rods of 1 m, one below the other."""
    mass, stiffness = np.array([[m + M, M], [M, M]]), 9.81 * np.diag([m + M, M])
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)


def test_a_double_pendulum_of_point_masses_on_massless_rods():
    rods = mbstab.loads(RODS)
    expected = np.concatenate([1j * s * double_pendulum(1.0, 2.0) for s in (1.0, -1.0)])
    found = rods.eig()
    assert found.verdict == "stable"
    assert found.counts.expected == 4
    assert close(found.values(), expected, 1e-14)
    for method in ("index3", "augmented", "udwadia-kalaba"):
        assert close(rods.eig(method).values(), expected, 1e-11)
    precise = rods.eig_precise(25)
    assert close([complex(x) for x in precise.values()], expected, 1e-15)
    assert close(rods.modes(2).values(), expected, 1e-12)
    swept = rods.sweep("m", np.array([0.5, 1.0]))
    assert close(swept.branches[1], expected, 1e-12)


def test_the_motion_of_massless_rods_is_simulated():
    """Both rods together at 0.1 rad: the energy is kept, and so are the lengths."""
    run = mbstab.loads(RODS).simulate(to=1.0, points=5, perturb={"one.theta": 0.1}, tol=1e-6)
    a, b = run.q[:, 3:5], run.q[:, 8:10]
    assert np.linalg.norm(a, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.norm(b - a, axis=1) == pytest.approx(1.0, abs=1e-12)
    energy = 0.5 * (run.u[:, 3:5] ** 2).sum(1) + (run.u[:, 8:10] ** 2).sum(1) + 9.81 * (a[:, 1] + 2.0 * b[:, 1])
    assert np.ptp(energy) < 1e-5
    assert np.ptp(a[:, 0]) > 0.05


def test_massless_rods_are_proven():
    assert mbstab.loads(RODS).certify().verdict == "stable"


HOOKE = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  bob: {type: spatial, mass: 3, inertia: [0.2, 0.3, 0.1], center_of_mass: [0.05, 0, -1]}
YOKE
reference: {find: equilibrium}
"""
HINGES = """\
  yoke: {type: spatial, mass: 0, inertia: [0, 0, 0]}
joints:
  first: {type: revolute, between: [yoke, ground], axis: [1, 0, 0]}
  second: {type: revolute, between: [bob, yoke], axis: [0, 1, 0]}"""
CROSS = "joints: {hooke: {type: universal, between: [bob, ground], axis: [[0, 1, 0], [1, 0, 0]]}}"


def test_a_massless_yoke_between_two_hinges_is_a_universal_joint():
    yoke, hooke = (mbstab.loads(HOOKE.replace("YOKE", x)).eig() for x in (HINGES, CROSS))
    assert yoke.counts.expected == hooke.counts.expected == 4
    assert close(yoke.values(), hooke.values(), 1e-13)
    assert yoke.verdict == hooke.verdict == "stable"


def test_what_nothing_determines_is_refused_where_it_stands():
    text = RODS.replace("  C: {type: revolute, between: [two, b]}\n", "").replace("mass: M", "mass: M + 0")
    with pytest.raises(MassError, match=r"<text>:7:8: bodies\.two: the motion of (two\.x, )?two\.theta.* no mass"):
        mbstab.loads(text.replace("  b: {type: planar_point, mass: M + 0}\n", "").replace(", b: {y: -2}", "")).eig()


@pytest.mark.parametrize("seed", range(8))
def test_a_massless_link_that_hangs_loose_is_refused_whatever_hangs_beside_it(seed):
    """What its joint carries is rounding of the forces beside it, and no stiffness."""
    rng = np.random.default_rng(seed)
    m, h, x, y = (float(f"{value:.3g}") for value in rng.uniform(0.1, 9.0, 4))
    text = f"""
mbstab: 1
gravity: [{-x if seed % 2 else 0}, -9.81]
bodies:
  rod: {{type: planar, mass: {m}, inertia: {h}, points: {{pin: [0, {h}], hook: [{x}, {-y}]}}}}
  link: {{type: planar, mass: 0, inertia: 0, points: {{end: [{y}, {x}]}}}}
joints:
  pin: {{type: revolute, between: [rod.pin, ground]}}
  hook: {{type: revolute, between: [link.end, rod.hook]}}
reference: {{find: equilibrium, guess: {{rod: {{y: {-h}}}, link: {{x: {x - y}, y: {-h - y - x}}}}}}}
"""
    with pytest.raises(MbstabError, match=r"link\."):
        mbstab.loads(text).eig()


# --- springs and dampers in series ------------------------------------------------------------------------------------


def line(masses, elements, rest="", parameters=""):
    """Return masses on a line with springs and dampers (i, j, k, c); j = −1 is the ground."""
    n = len(masses)
    bodies = "".join(f"  n{i}: {{type: planar_point, mass: {m}}}\n" for i, m in enumerate(masses))
    rails = "".join(f"  r{i}: {{holonomic: n{i}.y}}\n" for i in range(n))
    forces = ""
    for e, (i, j, k, c) in enumerate(elements):
        stretch = f"n{i}.x" if j < 0 else f"(n{i}.x - n{j}.x)"
        rate = f"rate(n{i}.x)" if j < 0 else f"(rate(n{i}.x) - rate(n{j}.x))"
        pull = f"({k})*{stretch} + ({c})*{rate}"
        other = "" if j < 0 else f", n{j}.x: {pull}"
        forces += f"  f{e}: {{type: expression, on: {{n{i}.x: -({pull}){other}}}}}\n"
    head = f"mbstab: 1\nparameters: {{{parameters}}}\n" if parameters else "mbstab: 1\n"
    return mbstab.loads(f"{head}bodies:\n{bodies}constraints:\n{rails}forces:\n{forces}{rest}")


def exact(masses, elements, followers=()):
    """Return the finite eigenvalues of s²M + sC + K with 60 digits: roots of the determinant, interpolated.

    Followers (i, j, k) push node i by k times the place of node j.
    """
    n, count = len(masses), 2 * len(masses) + 1
    with mp.workdps(60):
        M, C, K = mp.diag([mp.mpf(repr(m)) for m in masses]), mp.zeros(n), mp.zeros(n)
        for i, j, *numbers in elements:
            for A, x in zip((K, C), (mp.mpf(repr(x)) for x in numbers), strict=True):
                A[i, i] += x
                if j >= 0:
                    A[j, j] += x
                    A[i, j] -= x
                    A[j, i] -= x
        for i, j, number in followers:
            K[i, j] -= mp.mpf(repr(number))
        points = [mp.expjpi(mp.mpf(2) * k / count) for k in range(count)]
        values = [mp.det(M * s * s + C * s + K) for s in points]
        whole = [sum(v * s**-k for s, v in zip(points, values, strict=True)).real / count for k in range(count)]
        size = max(abs(x) for x in whole)
        whole = [x if abs(x) > size * mp.mpf(10) ** -50 else mp.mpf(0) for x in whole]
        while whole[-1] == 0:
            whole.pop()
        zeros = next(k for k, x in enumerate(whole) if x)
        roots = mp.polyroots(whole[zeros:][::-1], maxsteps=300, extraprec=200)
        return [complex(x) for x in roots] + [0j] * zeros


def some_chain(rng, decades):
    """Return masses, more than half of them zero, and springs, dampers or both between neighbours and across."""

    def number(low, high):
        return float(f"{rng.uniform(low, high) * 10.0 ** rng.uniform(-decades, decades):.3g}")

    n = int(rng.integers(2, 5))
    masses = [0.0 if rng.uniform() < 0.55 else number(0.2, 3.0) for _ in range(n)]
    pairs = [(i, i - 1) for i in range(n)] + [tuple(rng.integers(-1, n, 2).tolist()) for _ in range(rng.integers(0, 3))]
    elements = []
    for i, j in pairs:
        springy, damped = [(True, False), (False, True), (True, True)][rng.integers(0, 3)]
        if i >= 0 and i != j:
            elements.append((i, j, number(1.0, 50.0) if springy else 0.0, number(0.1, 5.0) if damped else 0.0))
    return masses if any(masses) else [1.0, *masses[1:]], elements


@pytest.mark.parametrize(("seed", "decades"), sample([(seed, decades) for seed in range(13) for decades in (0, 3)], 5))
def test_random_chains_have_the_eigenvalues_of_their_pencil(seed, decades):
    """Four chains each: numbers of eigenvalues, values within their bounds, and the verdict."""
    rng = np.random.default_rng(100 * decades + seed)
    for _ in range(4):
        masses, elements = some_chain(rng, decades)
        expected = np.array(exact(masses, elements))
        found = line(masses, elements).eig()
        values = np.array([e.value for e in found.eigenvalues])
        assert found.counts.expected == len(values) == len(expected), (masses, elements)
        size = float(np.max(np.abs(expected), initial=0.0))
        bounds = np.array([1e-12 * size if e.kind == "neutral" else e.error_bound for e in found.eigenvalues])
        distance = np.abs(values[:, None] - expected)
        rows, columns = linear_sum_assignment(np.log(distance + 1e-300))
        assert np.all(distance[rows, columns] <= bounds[rows]), (masses, elements)
        assert found.verdict not in ("unstable", "undecided"), (masses, elements)


@pytest.mark.parametrize(("seed", "decades"), sample([(seed, decades) for seed in range(24) for decades in (0, 3)], 6))
def test_random_chains_are_proven_as_their_pencil_says(seed, decades):
    """Chains, half of them with a force that follows another node: numbers of eigenvalues, enclosures, the verdict."""
    rng = np.random.default_rng(1000 * decades + seed)
    masses, elements = some_chain(rng, decades)
    followers = []
    if seed % 2:
        i, j = rng.permutation(len(masses))[:2].tolist()
        followers = [(i, j, float(f"{rng.uniform(1.0, 80.0):.3g}"))]
    rest = "".join(f"  follower: {{type: expression, on: {{n{i}.x: ({k})*n{j}.x}}}}\n" for i, j, k in followers)
    expected = np.array(exact(masses, elements, followers))
    found = line(masses, elements, rest).certify()
    if not found.eigenvalues:
        assert found.verdict == "not provable"
        assert "moves along with others" in found.reasons[0]
        return
    assert sum(e.count for e in found.eigenvalues) == len(expected), (masses, elements, followers)
    for e in found.eigenvalues:
        near = [s for s in expected if e.contains(s, 1e-12 * abs(s) + 1e-290)]
        assert e.kind in ("zero", "open") or len(near) >= e.count, (masses, elements, followers)
    growing = bool(np.any(expected.real > 0.0))
    decided = "stable" in found.verdict and found.verdict != "not provable"
    assert not decided or ("unstable" in found.verdict) == growing, (masses, elements, followers)
    assert decided or followers, (masses, elements)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((1, 100, 400, 10), [-6.52189615220069 + 10.28852254136692j, -26.95620769559862]),
        ((2, 50, 200, 30), [-1.41773500115668, -2.624465832754993 + 10.52000879048247j]),
    ],
)
def test_a_spring_and_a_damper_in_series_are_of_first_order(values, expected):
    """The Zener element: m x'' + k x + F = 0, F' = k_m x' − (k_m/c) F, with a massless node between k_m and c."""
    m, k, km, c = values
    zener = line([m, 0], [(0, -1, k, 0), (0, 1, km, 0), (1, -1, 0, c)])
    expected = [x for s in expected for x in ((s, np.conj(s)) if isinstance(s, complex) else (s,))]
    found = zener.eig()
    assert close(found.values(), expected, 1e-14)
    assert found.verdict == "asymptotically stable"
    assert found.counts.massless == ("n1: balance along n1.x, of first order",)
    assert close(zener.eig("index3").values(), expected, 1e-11)
    assert close([complex(x) for x in zener.eig_precise(30).values()], expected, 1e-14)


def test_a_maxwell_element_alone_lets_its_mass_go():
    """m s² + (k c s)/(k + c s) = 0: s = 0, the shift of everything, and s² + (k/c) s + k/m = 0."""
    found = line([2.0, 0.0], [(0, 1, 8.0, 0.0), (1, -1, 0.0, 0.5)]).eig()
    assert close([e.value for e in found.eigenvalues if e.kind != "neutral"], np.roots([1.0, 16.0, 4.0]), 1e-14)
    assert (found.counts.expected, found.counts.neutral) == (3, 1)
    assert found.verdict == "asymptotically stable up to symmetry"


@pytest.mark.parametrize("ratio", [1.0, 1e-8, 1e8])
def test_springs_in_series_are_one_spring(ratio):
    k = 10.0
    springs = line([1.0, 0.0], [(0, 1, k, 0.0), (1, -1, k * ratio, 0.0)])
    found, w = springs.eig(), np.sqrt(k * ratio / (1.0 + ratio))
    # The sum of a stiff and a soft spring keeps half of the digits of the soft one.
    assert close(found.values(), [1j * w, -1j * w], 1e-14 if ratio >= 1.0 else 1e-8)
    assert all(abs(abs(e.value) - w) <= e.error_bound for e in found.eigenvalues)
    assert close([complex(x) for x in springs.eig_precise(20).values()], [1j * w, -1j * w], 1e-15)
    assert found.verdict == "stable"
    assert found.counts.massless == ("n1: balance along n1.x, algebraic",)


def test_derivatives_by_what_is_zero_without_mass_are_not_given():
    """The mass of the node, and a damper that would be its only one, add eigenvalues; the spring does not."""
    scene = line([1.0, "mu"], [(0, 1, "k", "c"), (1, -1, 20.0, 0.0)], parameters="mu: 0, k: 10, c: 0")
    found = scene.sensitivities()
    assert set(found.missing) == {"mu", "c"}
    (item,) = found.derivatives
    k, w = 10.0, np.sqrt(10.0 * 20.0 / 30.0)
    assert item.slopes[1] == pytest.approx(1j * (20.0 / (k + 20.0)) ** 2 / (2.0 * w), rel=1e-12)


def test_derivatives_of_a_maxwell_element_with_masses_in_numbers():
    """(s² + k + k_1) (k_1 + c s) = k_1², differentiated by hand."""
    springs = [(0, -1, "k", 0.0), (0, 1, "k_1", 0.0), (1, -1, 0.0, "c")]
    found = line([1.0, 0.0], springs, parameters="k: 10, k_1: 5, c: 2").sensitivities()
    assert not found.missing
    assert len(found.derivatives) == 2
    k, k_1, c = 10.0, 5.0, 2.0
    for item in found.derivatives:
        s = found.result.eigenvalues[item.number].value
        slope = 2.0 * s * (k_1 + c * s) + (s * s + k + k_1) * c
        by = np.array([k_1 + c * s, k_1 + c * s + s * s + k + k_1 - 2.0 * k_1, (s * s + k + k_1) * s])
        assert item.slopes == pytest.approx(-by / slope, rel=1e-13)


LEVER = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {at: AT}
bodies:
  lever: {type: planar, mass: 0, inertia: 0, points: {pin: [at, 0], end: [2 + at, 0], mid: [1 + at, 0]}}
  b: {type: planar_point, mass: 2}
joints: {pin: {type: revolute, between: [lever.pin, ground]}}
constraints: {rail: {holonomic: b.x - 2}}
forces:
  hanger: {type: spring, between: [b, lever.end], stiffness: 100, length: 0.5}
  stay: {type: spring, between: [lever.mid, {body: ground, point: [1, -3]}], stiffness: 300, length: 3, damping: D}
reference: {find: equilibrium, coordinates: {b: {x: 2}}, guess: {b: {y: -0.6}, lever: {theta: 0}}}
"""


@pytest.mark.parametrize(
    ("damping", "expected"),
    [
        ("0", [4.64505663185974978j]),
        ("20", [-34.2285757519512435, -0.40738213865366767 + 4.68232752999893182j]),
    ],
)
def test_a_massless_lever_under_load(damping, expected):
    """One algebraic direction without the damper, one of first order with it.

    Where the body counts from another point than the pin, reactions of the pin turn the direction.
    """
    expected = [x for s in expected for x in ((s, np.conj(s)) if isinstance(s, complex) else (s,))]
    lever, other = (mbstab.loads(LEVER.replace("AT", at).replace("D}", damping + "}")) for at in ("0", "0.7"))
    for scene in (lever, other):
        found = scene.eig()
        assert close(found.values(), expected, 1e-13)
        assert found.verdict == ("stable" if damping == "0" else "asymptotically stable")
        assert scene.check().n_f == found.counts.expected == len(expected)
    for scene in (lever, other):
        assert close([complex(x) for x in scene.eig_precise(20).values()], expected, 1e-14)

    # The point from which the body counts turns the direction without mass, and moves no eigenvalue.
    moved = other.sensitivities()
    assert not moved.missing
    assert all(abs(x.slopes[0]) <= 1e-9 * abs(moved.eigenvalue(x).value) for x in moved.derivatives)


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("masses", "elements", "rest", "message"),
    [
        ([1, 0], [(0, -1, 1, 0)], "", r"<text>:4:7: bodies\.n1: .* n1\.x carries no mass, and no force depends on it"),
        (
            [1, 0],
            [(0, 1, 1, 0), (1, -1, -1, 0)],
            "",
            r"bodies\.n1: the motion of n1\.x carries no mass, and its own stiffness vanishes",
        ),
        (
            [1, 0],
            [(0, 1, 1, 0), (1, -1, 1, 0)],
            "  push: {type: expression, on: {n1.x: -rate(n0.x)}}\n",
            "a force on it depends on speeds of other bodies, and nothing damps its own motion",
        ),
        (
            [1, 0],
            [(0, 1, 1, 0), (1, -1, 1, 0)],
            "  push: {type: expression, on: {n1.x: 1}}\n",
            r"n1\.x carries no mass and would not stay \(unbalanced 1 N\)",
        ),
        (
            [1, 0],
            [(0, 1, 1, 0), (1, -1, 1, 0)],
            "  push: {type: expression, on: {n0.x: sin(t)}}\n",
            "under functions of time its motion is not determined yet",
        ),
        (
            [1, 0, 0],
            [(0, 1, 1, 0), (1, 2, 0, 1), (2, -1, 0, 1e-9)],
            "",
            r"the damping of motions without mass cannot be decided \(n[12]\.x, n[12]\.x\)",
        ),
    ],
)
def test_what_forces_do_not_determine_is_refused_with_its_place(masses, elements, rest, message):
    with pytest.raises(MbstabError, match=message):
        line(masses, elements, rest).eig()


@pytest.mark.parametrize(
    "ask",
    [
        lambda x: x.eig("embedding"),
    ],
)
def test_what_is_not_possible_yet_says_so(ask):
    scene = line([1, 0], [(0, 1, 1, 0), (1, -1, 0, 1)])
    with pytest.raises(MbstabError, match=r"carries no mass|without (it|mass)"):
        ask(scene)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, pytest.param(4, marks=pytest.mark.long)])
def test_sweeps_and_eig_of_chains_with_massless_nodes_agree(seed):
    """Springs and dampers in series, some of them driving: values, verdicts and refusals at points of a sweep."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    masses = [1.0, *(float(rng.choice([0.0, 0.0, 1.0, 2.5])) for _ in range(n - 1))]
    pairs = [(i, j) for i in range(n) for j in (*range(i + 1, n), -1) if rng.random() < 0.7]
    elements = []
    for i, j in pairs:
        k, c = rng.choice([0.0, 1.0, 1.0]) * rng.uniform(0.5, 50.0), rng.choice([0.0, 0.0, 1.0]) * rng.uniform(0.1, 5.0)
        elements.append((i, j, f"{k}*{rng.choice(['1', 'p'])}", f"{c}*{rng.choice(['1', 'p', '(p - 1.57)'])}"))
    chain, values = line(masses, elements, parameters="p: 1"), np.linspace(0.5, 2.5, 17)
    found = chain.sweep("p", values)
    for i in range(0, 17, 4):
        try:
            alone = chain.at(p=values[i]).eig()
        except MbstabError:
            assert i in found.problems
            continue
        assert i not in found.problems
        assert found.verdicts[i] == alone.verdict
        own = sorted(alone.values(), key=abs, reverse=True)[: found.branches.shape[1]]
        assert close(found.branches[i], own, 1e-9)


COLUMN = """
mbstab: 1
parameters: {P: 10, EI: 1, a: 0.5, c: 0, l: a/2, r: (1 - a)/2}
bodies:
  a1: {type: planar, mass: 0, inertia: 0, points: {O: [-l/2, 0], E: [l/2, 0]}}
  a2: {type: planar, mass: 0, inertia: 0, points: {O: [-l/2, 0], E: [l/2, 0]}}
  b1: {type: planar, mass: 0, inertia: 0, points: {O: [-r/2, 0], E: [r/2, 0]}}
  b2: {type: planar, mass: 0, inertia: 0, points: {O: [-r/2, 0], E: [r/2, 0]}}
  m1: {type: planar_point, mass: 1}
  m2: {type: planar_point, mass: 1}
joints:
  j1: {type: revolute, between: [a1.O, ground]}
  j2: {type: revolute, between: [a2.O, a1.E]}
  i1: {type: revolute, between: [b1.O, a2.E]}
  i2: {type: revolute, between: [b2.O, b1.E]}
  h1: {type: spherical, between: [a2.E, m1]}
  h2: {type: spherical, between: [b2.E, m2]}
forces:
  k1: {type: joint_spring, joint: j1, stiffness: 2*EI/l}
  k2: {type: joint_spring, joint: j2, stiffness: EI/l, damping: c}
  k3: {type: joint_spring, joint: i1, stiffness: 2*EI/(l + r)}
  k4: {type: joint_spring, joint: i2, stiffness: EI/r}
  load: {type: force, at: b2.E, vector: [-P, 0], frame: body}
reference:
  coordinates:
    {a1: {x: l/2, y: 0, theta: 0}, a2: {x: 3*l/2, y: 0, theta: 0}, b1: {x: a + r/2, y: 0, theta: 0},
    b2: {x: a + 3*r/2, y: 0, theta: 0}, m1: {x: a, y: 0}, m2: {x: 1, y: 0}}
"""
"""A column of four links without mass under a load that follows its end: the motions without mass bend it."""


@pytest.mark.parametrize("c", [0.0, 0.05])
def test_motions_without_mass_oblique_to_the_coordinates_are_swept_together(c):
    column, values = mbstab.loads(COLUMN).at(c=c), np.linspace(1.0, 20.0, 25)
    evaluator = Evaluator(column.model)
    evaluator.patterns += evaluator.patterns_at({"P": 8.0})
    found = evaluator.near({"P": values}, 4 + (c > 0.0))
    assert evaluator.alone == 0
    for i in (0, 9, 17, 24):
        alone = column.eig(P=values[i])
        assert np.any(found.sides[i] == RIGHT) == (alone.verdict == "unstable")
        assert close(found.values[i], alone.values(), 1e-10)


@pytest.mark.long
def test_a_column_without_mass_is_designed():
    """No damping: what is stable is so marginally, up to a load at which two pairs meet."""
    column = mbstab.loads(COLUMN)
    found = column.design({"a": (0.2, 0.9)}, "range:P=1..30")
    ends = {
        a: column.sweep("P", np.linspace(1.0, 30.0, 60), a=a).critical[0].value
        for a in (0.5, *np.linspace(0.2, 0.9, 29))
    }
    assert found.interval_before == pytest.approx((1.0, ends[0.5]), rel=1e-5)
    assert found.interval[1] > 0.999 * max(ends.values())


def test_some_of_all_eigenvalues_are_those_nearest_or_rightmost():
    """m = 1, k = 100, a spring of 400 N/m and a damper of 10 N s/m in series: one pair and one node."""
    zener = line([1.0, 0.0], [(0, -1, 100.0, 0.0), (0, 1, 400.0, 0.0), (1, -1, 0.0, 10.0)])
    first, fast = zener.modes(1), zener.modes(1, near=-30.0)
    assert [round(x.real, 9) for x in first.values()] == [-6.521896152] * 2
    assert fast.values() == pytest.approx([-26.95620769559862], rel=1e-12)
    assert zener.modes(1, rightmost=True).values() == pytest.approx(first.values())
    assert first.counts.unstable_proven == 0
    assert first.verdict == fast.verdict == "asymptotically stable"
    with pytest.raises(MbstabError, match="there are 3 finite eigenvalues"):
        zener.modes(4)


PORTS = """\
inputs: {push: {type: force, at: n0, direction: x}, pull: {type: force, at: n1, direction: x}}
outputs: {place: n0.x, node: n1.x, speed: rate(n1.x), both: acceleration(n1.x) + n0.x}
"""


@pytest.mark.parametrize(
    "elements",
    [
        [(0, -1, 100.0, 0.0), (0, 1, 400.0, 0.0), (1, -1, 0.0, 10.0)],
        [(0, -1, 100.0, 0.0), (0, 1, 400.0, 0.0), (1, -1, 60.0, 0.0)],
        [(0, 1, 4.0, 0.3), (1, 2, 9.0, 0.0), (2, -1, 2.0, 0.5)],
        [(0, 1, 4.0, 0.0), (1, 2, 9.0, 0.0), (2, -1, 2.0, 0.5), (0, -1, 1.0, 0.0)],
    ],
)
def test_inputs_act_on_motions_without_mass_as_the_dynamic_stiffness_says(elements):
    """A force on a massless node moves it at once: A, B, C, D and the descriptor form against (s²M + sC + K)⁻¹."""
    n = 1 + max(i for e in elements for i in e[:2])
    model = line([1.0] + [0.0] * (n - 1), elements, PORTS).state_space()
    M, C, K = np.diag([1.0] + [0.0] * (n - 1)), np.zeros((n, n)), np.zeros((n, n))
    for i, j, k, c in elements:
        d = np.eye(n)[i] - (np.eye(n)[j] if j >= 0 else 0.0)
        K, C = K + k * np.outer(d, d), C + c * np.outer(d, d)
    for s in (0.3j, 4.0j, 2.0 + 50.0j):
        X = np.linalg.inv(s * s * M + s * C + K)[:, :2]
        expected = np.array([X[0], X[1], s * X[1], s * s * X[1] + X[0]])
        d = model.descriptor
        states, all_ = (
            np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B),
            np.linalg.solve(s * d.E - d.A, d.B),
        )
        found, by_w = model.C @ states + model.D, d.D * np.array([s**order for _, order in model.orders])
        for i in range(2):
            own = [k for k, (j, _) in enumerate(model.orders) if j == i]
            powers = np.array([s ** model.orders[k][1] for k in own])
            assert found[:, own] @ powers == pytest.approx(expected[:, i], rel=1e-11)
            assert d.C @ all_[:, i] + by_w[:, own].sum(axis=1) == pytest.approx(expected[:, i], rel=1e-11)


def test_the_critical_damping_of_a_maxwell_element_is_found():
    """A mass that −c drives, beside k and d in series: s (d s² + (k − c d) s + k (d − c)) = 0 changes at d = c."""
    chain = line([1.0, 0.0], [(0, 1, 4.0, 0.0), (1, -1, 0.0, "d"), (0, -1, 0.0, -0.5)], parameters="d: 1")
    found = chain.sweep("d", np.linspace(0.3, 0.9, 13))
    assert [x.value for x in found.critical] == pytest.approx([0.5], abs=1e-12)


def test_a_maxwell_element_at_its_critical_damping_slides_at_any_speed():
    """At d = c the dampers cancel: m u − c (x − y) is constant, two zeros; the third root is c/m − k/d = −7.5."""
    found = line([1.0, 0.0], [(0, 1, 4.0, 0.0), (1, -1, 0.0, "d"), (0, -1, 0.0, -0.5)], parameters="d: 0.5").eig()
    assert (found.verdict, found.counts.neutral) == ("asymptotically stable up to symmetry", 2)
    assert [e.value for e in found.eigenvalues if e.kind != "neutral"] == pytest.approx([-7.5], rel=1e-12)


def test_a_stiff_spring_without_mass_leaves_the_bounds_of_the_others():
    """A spring of 34240 N/m beside one of 1 mN/m; a determinant with 120 digits gave the expected values."""
    elements = [(1, 0, "0.4824", "0.01587"), (2, 1, "0", "16.67"), (3, 2, "34240", "0"), (0, 1, "0.0003154", "0")]
    lines = ["mbstab: 1", "bodies:"]
    lines += [f"  n{i}: {{type: planar_point, mass: {494.2 if i == 1 else 0}}}" for i in range(4)]
    lines += ["constraints:", *(f"  r{i}: {{holonomic: n{i}.y}}" for i in range(4)), "forces:"]
    lines.append("  damper: {type: expression, on: {n0.x: -208.9*rate(n0.x)}}")
    for number, (i, j, k, c) in enumerate(elements):
        pull = f"{k}*(n{i}.x - n{j}.x) + {c}*(rate(n{i}.x) - rate(n{j}.x))"
        lines.append(f"  f{number}: {{type: expression, on: {{n{i}.x: -({pull}), n{j}.x: {pull}}}}}")
    found = [e for e in mbstab.loads("\n".join(lines)).eig().eigenvalues if e.kind != "neutral"]
    assert len(found) == 2
    for e in found:
        expected = complex(-0.0011713416082434485, np.copysign(0.031230033474460912, e.value.imag))
        assert abs(e.value - expected) <= e.error_bound < 1e-15


# --- moving references ------------------------------------------------------------------------------------------------

ROTOR = """\
mbstab: 1
parameters: {Omega: {value: 30, unit: rad/s}}
bodies: {rotor: {type: planar, mass: 2, inertia: 0.1}, node: {type: planar_point, mass: 0}}
forces:
  shaft_x: {type: expression, on: {rotor.x: -800*(rotor.x - node.x), node.x: 800*(rotor.x - node.x)}}
  shaft_y: {type: expression, on: {rotor.y: -800*(rotor.y - node.y), node.y: 800*(rotor.y - node.y)}}
  bearing: {type: expression, on: {node.x: -500*node.x - 20*rate(node.x), node.y: -500*node.y - 20*rate(node.y)}}
  inner_x: {type: expression, on: {rotor.x: -3*(rate(rotor.x) + rate(rotor.theta)*rotor.y)}}
  inner_y: {type: expression, on: {rotor.y: -3*(rate(rotor.y) - rate(rotor.theta)*rotor.x)}}
reference:
  coordinates: {rotor: {x: 0, y: 0, theta: 0}, node: {x: 0, y: 0}}
  rates: {rotor: {x: 0, y: 0, theta: Omega}, node: {x: 0, y: 0}}
"""


def whirl(spin):
    """Return the eigenvalues of z = x + iy and its conjugate; the node is eliminated by hand."""
    p = np.polymul([2.0, 3.0, 800.0 - 3.0j * spin], [20.0, 1300.0]).astype(complex)
    p[-1] -= 800.0**2
    roots = np.roots(p)
    return np.concatenate([roots, roots.conj()])


@pytest.mark.parametrize("spin", [0.0, 5.0, 30.0, 60.0])
def test_a_rotor_spins_on_massless_bearings(spin):
    found = mbstab.loads(ROTOR).eig(Omega=spin)
    own = [e for e in found.eigenvalues if e.kind != "neutral"]
    assert close([e.value for e in own], whirl(spin), 1e-12)
    assert max(e.error_bound for e in own) < 1e-11
    assert ("unstable" in found.verdict) == bool(np.any(whirl(spin).real > 0.0))
    assert found.counts.neutral == 2


def test_the_onset_of_whirl_on_massless_bearings_is_found():
    found = mbstab.loads(ROTOR).sweep("Omega", np.linspace(10.0, 60.0, 11))
    (critical,) = found.critical
    assert critical.value == pytest.approx(brentq(lambda x: np.max(whirl(x).real), 30.0, 60.0, xtol=1e-12), rel=1e-9)


TURNING = """\
mbstab: 1
parameters: {{Omega: {{value: {spin}, unit: rad/s}}}}
bodies:
  disc: {{type: planar, mass: 1, inertia: 1}}
  b: {{type: planar_point, mass: {m}}}
  w: {{type: planar_point, mass: 0}}
constraints: {{px: {{holonomic: disc.x}}, py: {{holonomic: disc.y}}}}
forces:
  spring_x: {{type: expression, on: {{b.x: -{k}*(b.x - w.x), w.x: {k}*(b.x - w.x)}}}}
  spring_y: {{type: expression, on: {{b.y: -{k}*(b.y - w.y), w.y: {k}*(b.y - w.y)}}}}
  anchor: {{type: expression, on: {{w.x: -{h}*(w.x - cos(disc.theta)), w.y: -{h}*(w.y - sin(disc.theta))}}}}
  damper_x: {{type: expression, on: {{w.x: -{c}*(rate(w.x) + rate(disc.theta)*w.y)}}}}
  damper_y: {{type: expression, on: {{w.y: -{c}*(rate(w.y) - rate(disc.theta)*w.x)}}}}
reference:
  find: steady
  steady: {{axis: z, rate: Omega}}
  coordinates: {{disc: {{theta: 0}}}}
  guess: {{b: {{x: {x}, y: 0}}, w: {{x: {y}, y: 0}}}}
"""


@pytest.mark.parametrize("seed", range(8))
def test_a_massless_node_off_the_axis_turns_with_a_steady_motion(seed):
    """A mass, a node without mass and an anchor on a disk, in whose frame ζ = x + iy obeys linear equations."""
    rng = np.random.default_rng(seed)
    spin, m, k, h, c = (float(f"{x:.4g}") for x in rng.uniform([0.5, 0.5, 30, 30, 1], [4, 3, 90, 90, 20]))
    c *= seed % 2
    x, y = np.linalg.solve([[k - m * spin**2, -k], [-k, k + h]], [0.0, h])
    found = mbstab.loads(TURNING.format(spin=spin, m=m, k=k, h=h, c=c, x=1.01 * x, y=0.99 * y)).eig()
    p = np.polymul([m, 2j * m * spin, k - m * spin**2], [c, k + h] if c else [k + h]).astype(complex)
    p[-1] -= k * k
    roots = np.roots(p)
    size = np.max(np.abs(roots))
    values = [e.value for e in found.eigenvalues if abs(e.value) > 1e-9 * size]
    assert close(values, [*roots, *roots.conj()], 1e-10)
    assert found.counts.expected == len(values) + 2


@pytest.mark.parametrize("seed", sample(range(40), 4))
def test_what_any_mass_would_let_run_away_is_told(seed):
    """Chains with springs and dampers that may push; with masses of 1e-14 kg some eigenvalues are beyond 1e4 1/s."""
    rng = np.random.default_rng(7000 + seed)
    masses, elements = some_chain(rng, 0)
    elements = [(i, j, *(x * (-1 if rng.uniform() < 0.3 else 1) for x in numbers)) for i, j, *numbers in elements]
    try:
        found = line(masses, elements).eig()
    except MassError:
        return
    told = any("run away" in x for x in found.warnings)
    fast = max(s.real for s in exact([m or 1e-14 for m in masses], elements))
    assert told == (fast > 1e4), (masses, elements)


# --- loads written as numbers: nets in the plane, off symmetry, with preloaded springs --------------------------------


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
    assert [x.kind for x in found.critical] == ["infinity"]
    assert abs(found.critical[0].value) < 1e-9
    assert found.critical[0].unstable == (3, 0)


# --- nonlinear motions ------------------------------------------------------------------------------------------------


METHODS = {"projection": 1e-8, "radau": 1e-6, "alpha": 1e-4}
"""Tolerances for methods; alpha is of order 2."""

ZENER = [1.0, 0.0], [(0, -1, 100, 0), (0, 1, 400, 0), (1, -1, 0, 10)]


def zener(times, x, force):
    """Return place and force in the damper of m ẍ + k x + F = 0, Ḟ = k_m ẋ − (k_m/c) F, from rest, to 30 digits."""
    with mp.workdps(30):
        A = mp.matrix([[0, 1, 0], [-100, 0, -1], [0, 400, -40]])
        found = [mp.expm(A * mp.mpf(float(t))) * mp.matrix([x, 0, force]) for t in times]
        return np.array([[float(y[0]), float(y[2])] for y in found]).T


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"solver": "RK45"},
        {"solver": "Radau"},
        {"solver": "BDF"},
        {"method": "radau"},
        {"method": "alpha", "tol": 1e-4},
    ],
)
def test_a_spring_and_a_damper_in_series(settings):
    tol = settings.get("tol", 1e-7)
    run = line(*ZENER).simulate(to=1.0, points=6, perturb={"n0.x": 0.1}, **({"tol": tol} | settings))
    i, j = (run.names.index(x) for x in ("n0.x", "n1.x"))
    assert run.q[0, [i, j]] == pytest.approx([0.1, 0.0], abs=1e-15)  # the damper holds its end at first
    place, force = zener(run.times, 0.1, 40.0)
    assert run.q[:, i] == pytest.approx(place, abs=tol)
    assert 400.0 * (run.q[:, i] - run.q[:, j]) == pytest.approx(force, abs=400.0 * tol)
    assert 10.0 * run.u[:, j] == pytest.approx(force, abs=1000.0 * tol)


def test_the_end_of_a_damper_starts_where_it_is_put():
    run = line(*ZENER).simulate(to=0.5, points=3, perturb={"n1.x": 0.05}, tol=1e-7)
    place, _ = zener(run.times, 0.0, -20.0)
    assert run.q[:, run.names.index("n0.x")] == pytest.approx(place, abs=1e-7)


def test_the_damper_takes_the_energy():
    text = """\
mbstab: 1
bodies: {m: {type: planar_point, mass: 1}, n: {type: planar_point, mass: 0}}
constraints: {r: {holonomic: m.y}, s: {holonomic: n.y}}
forces:
  base: {type: expression, on: {m.x: -100*m.x}}
  spring: {type: expression, on: {m.x: 400*(n.x - m.x), n.x: 400*(m.x - n.x)}}
  damper: {type: expression, on: {n.x: -10*rate(n.x)}}
"""
    run = mbstab.loads(text).simulate(to=1.0, points=6, perturb={"m.x": 0.1}, tol=1e-8)
    m, n = (run.q[:, run.names.index(x)] for x in ("m.x", "n.x"))
    # Springs that are written as expressions have no potential: all is work.
    stored = 50.0 * m**2 + 200.0 * (m - n) ** 2
    assert run.kinetic == pytest.approx(run.work, abs=1e-7)
    assert np.all(np.diff(run.kinetic + stored) < 0.0)


def test_springs_in_series_on_both_sides_of_a_damper():
    """As one spring of 100·300/400 = 75 N/m in series with the damper: balances of sums of coordinates."""
    system = line([1.0, 0.0, 0.0], [(0, 1, 100, 0), (1, 2, 0, 10), (2, -1, 300, 0)])
    run = system.simulate(to=1.0, points=5, perturb={"n0.x": 0.1}, tol=1e-7)
    force = 100.0 * float(run.q[0, run.names.index("n0.x")] - run.q[0, run.names.index("n1.x")])
    with mp.workdps(30):
        A = mp.matrix([[0, 1, 0], [0, 0, -1], [0, 75, -7.5]])
        expected = [(mp.expm(A * mp.mpf(float(t))) * mp.matrix([0.1, 0, force]))[0] for t in run.times]
    assert run.q[:, run.names.index("n0.x")] == pytest.approx([float(x) for x in expected], abs=1e-7)


PENDULUM = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  bob: {type: planar_point, mass: 2}
  node: {type: planar_point, mass: 0}
forces:
  top: {type: spring, between: [node, ground], stiffness: 300, length: 0.5}
  low: {type: spring, between: [bob, node], stiffness: 200, length: 0.5}
reference: {find: equilibrium, guess: {bob: {y: -1.2}, node: {y: -0.6}}}
"""
SWUNG = {
    1.0: [-0.262942603387734120220019134752, -1.12283519061611939422093750892],
    2.0: [0.218561936024567667192047921778, -1.08583294437432616925347351061],
}
"""x and y of the bob on one spring of 120 N/m and 1 m from (0.3, −1 − 2·9.81/120), by Taylor series of 34 digits."""


def test_a_pendulum_on_two_springs_in_series():
    run = mbstab.loads(PENDULUM).simulate(to=2.0, points=3, perturb={"bob.x": 0.3}, tol=1e-8)
    bob, node = (run.q[:, run.names.index(f"{name}.x") :][:, :2] for name in ("bob", "node"))
    for t, place in SWUNG.items():
        assert bob[run.times == t][0] == pytest.approx(place, abs=1e-7)
    # The node stays on the line, where both springs pull equally.
    upper, lower = np.linalg.norm(node, axis=1), np.linalg.norm(bob - node, axis=1)
    assert upper + lower == pytest.approx(np.linalg.norm(bob, axis=1), abs=1e-12)
    assert 300.0 * (upper - 0.5) == pytest.approx(200.0 * (lower - 0.5), abs=1e-9)


def test_a_damper_that_begins_to_act_is_refused():
    system = mbstab.loads("""\
mbstab: 1
bodies: {m: {type: planar_point, mass: 1}, n: {type: planar_point, mass: 0}}
constraints: {r: {holonomic: m.y}, s: {holonomic: n.y}}
forces:
  one: {type: expression, on: {m.x: 100*(n.x - m.x), n.x: 100*(m.x - n.x) - 300*n.x - 500*m.x**2*rate(n.x)}}
""")
    assert system.eig().counts.massless
    with pytest.raises(
        NumericalError, match=r"forces along n\.x, which carries no mass, are out of balance at t = 0\."
    ):
        system.simulate(to=1.0, perturb={"m.x": 0.1})


@pytest.mark.few(1)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", ["0", "20"])
def test_a_lever_moves_alike_whatever_point_describes_it(damping, method):
    """About its hinge a lever is an angle alone; elsewhere constraints tie three coordinates without mass."""
    runs = []
    for at in ("0", "-3"):
        lever = mbstab.loads(LEVER.replace("AT", at).replace("D}", f"{damping}}}"))
        run = lever.simulate(to=0.5, points=5, perturb={"b.y": 0.3}, tol=METHODS[method], method=method)
        runs.append(run.q[:, [run.names.index("b.y"), run.names.index("lever.theta")]])
    assert np.max(np.abs(runs[1] - runs[0])) < 100.0 * METHODS[method]


@pytest.mark.long
def test_a_lever_in_space_moves_like_one_in_the_plane():
    run = mbstab.loads(LEVER.replace("AT", "0.5").replace("D}", "20}")).simulate(1.0, points=3, perturb={"b.y": 0.3})
    there = mbstab.loads(SPATIAL_LEVER).simulate(1.0, points=3, perturb={"b.z": 0.3})
    assert there.q[:, there.names.index("b.z")] == pytest.approx(run.q[:, run.names.index("b.y")], abs=1e-6)


SPATIAL_LEVER = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies:
  lever: {type: spatial, mass: 0, inertia: [0, 0, 0],
    points: {pin: [0.5, 0, 0.2], end: [2.5, 0, 0.2], mid: [1.5, 0, 0.2]}}
  b: {type: point, mass: 2}
joints: {pin: {type: revolute, between: [lever.pin, ground], axis: y}}
constraints: {rail: {holonomic: b.x - 2}, side: {holonomic: b.y}}
forces:
  hanger: {type: spring, between: [b, lever.end], stiffness: 100, length: 0.5}
  stay: {type: spring, between: [lever.mid, {body: ground, point: [1, 0, -3]}], stiffness: 300, length: 3, damping: 20}
reference: {find: equilibrium, coordinates: {b: {x: 2, y: 0}}, guess: {b: {z: -0.6}, lever: {x: -0.5, z: -0.2}}}
"""


SLIDER = """\
mbstab: 1
parameters: {K: 40, C: 3, k: 10}
bodies:
  m: {type: planar_point, mass: 1}
  node: {type: planar, mass: 0, inertia: 0, points: {p: [0.3, -0.1]}}
joints: {rail: {type: prismatic, between: [node.p, {body: ground, point: [0.3, -0.1]}], axis: [0.6, 0.8]}}
constraints: {line: {holonomic: 4*m.x - 3*m.y}}
forces:
  spring: {type: expression, on: {m.x: K*(node.x - m.x), m.y: K*(node.y - m.y), node.x: K*(m.x - node.x),
    node.y: K*(m.y - node.y)}}
  damper: {type: joint_spring, joint: rail, damping: C}
  own: {type: expression, on: {m.x: -k*m.x, m.y: -k*m.y}}
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_slider_without_mass_between_a_spring_and_a_damper(method):
    """Along the rail: m ẍ = −K (x − n) − k x, C ṅ = K (x − n)."""
    run = mbstab.loads(SLIDER).simulate(1.0, points=5, perturb={"m.x": 0.3}, tol=METHODS[method], method=method)
    A = np.array([[0.0, 1.0, 0.0], [-50.0, 0.0, 40.0], [40.0 / 3.0, 0.0, -40.0 / 3.0]])
    expected = [(expm(A * t) @ [0.3, 0.0, 0.0])[0] for t in run.times]
    assert run.q[:, run.names.index("m.x")] == pytest.approx(expected, abs=30.0 * METHODS[method])


LEVERS = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  one: {type: planar, mass: 0, inertia: 0, points: {a: [-0.5, 0], b: [0.5, 0]}}
  two: {type: planar, mass: 0, inertia: 0, points: {a: [-0.5, 0], b: [0.5, 0]}}
  bob: {type: planar_point, mass: 1}
joints:
  top: {type: revolute, between: [one.a, ground]}
  mid: {type: revolute, between: [two.a, one.b]}
forces:
  first: {type: joint_spring, joint: top, stiffness: 40}
  second: {type: joint_spring, joint: mid, stiffness: 60, damping: C}
  spring: {type: spring, between: [bob, two.b], stiffness: 400, length: 0.3}
reference:
  find: equilibrium
  guess: {bob: {x: 2, y: -0.5}, one: {x: 0.5, y: 0, theta: 0}, two: {x: 1.5, y: 0, theta: 0}}
"""


def levers(damping, held=None):
    """Return the rates of the bob and of the second angle, by finding the angles that balance at every instant.

    The first angle may be held.
    """

    def forces(bob, angles):
        one, two = angles
        end = np.array([np.cos(one) + np.cos(two), np.sin(one) + np.sin(two)])
        apart = bob - end
        length = np.linalg.norm(apart)
        pull = 400.0 * (length - 0.3) * apart / length
        own = 60.0 * (two - one)
        moments = [-np.sin(x) * pull[0] + np.cos(x) * pull[1] for x in angles]
        return pull, moments[0] - 40.0 * one + own, moments[1] - own

    def rates(t, y):
        bob, speed, apart = y[:2], y[2:4], y[4]
        if held is not None:
            two = fsolve(lambda x: forces(bob, (held, x[0]))[2], [-0.5], xtol=1e-11)[0]
            angles, drift = (held, two), 0.0
        elif damping:  # the second angle relative to the first is a state
            one = fsolve(lambda x: sum(forces(bob, (x[0], x[0] + apart))[1:]), [-0.4], xtol=1e-11)[0]
            angles = one, one + apart
            drift = forces(bob, angles)[2] / damping
        else:
            angles = fsolve(lambda x: forces(bob, x)[1:], [-0.4, -0.5], xtol=1e-11)
            drift = 0.0
        return [*speed, *(-forces(bob, angles)[0] + [0.0, -9.81]), drift]

    return rates


@pytest.mark.few(1)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_two_levers_without_mass_balance_at_every_instant(damping, method):
    run = mbstab.loads(LEVERS.replace("C}", f"{damping}}}")).simulate(
        0.5, points=6, perturb={"bob.x": -0.1, "bob.y": 0.2}, tol=METHODS[method], method=method
    )
    place = [run.names.index(x) for x in ("bob.x", "bob.y", "one.theta", "two.theta")]
    start = run.q[0, place]
    found = solve_ivp(
        levers(damping),
        (0.0, 0.5),
        [*start[:2], 0.0, 0.0, start[3] - start[2]],
        "DOP853",
        run.times,
        rtol=1e-10,
        atol=1e-12,
    )
    assert run.q[:, place[:2]] == pytest.approx(found.y[:2].T, abs=100.0 * METHODS[method])
    assert np.abs(run.u[0, place[:2]]) == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_drive_holds_one_of_two_levers(compiled):
    text = LEVERS.replace("C}", "0}").replace("  first: {type: joint_spring, joint: top, stiffness: 40}\n", "")
    held = mbstab.loads(text.replace("forces:", "drives: {d: {type: joint, joint: top, position: -0.4}}\nforces:", 1))
    run = held.simulate(0.5, points=3, perturb={"bob.y": 0.1}, compiled=compiled, tol=1e-8)
    assert run.q[:, run.names.index("one.theta")] == pytest.approx(-0.4, abs=1e-12)
    place = [run.names.index(x) for x in ("bob.x", "bob.y")]
    start = [*run.q[0, place], 0.0, 0.0, 0.0]
    found = solve_ivp(levers(0.0, -0.4), (0.0, 0.5), start, "DOP853", run.times, rtol=1e-10, atol=1e-12)
    assert run.q[:, place] == pytest.approx(found.y[:2].T, abs=1e-6)


@pytest.mark.parametrize("lift", ["0", "0.2"])
def test_a_lever_in_space_has_the_frequency_of_one_in_the_plane(lift):
    """Rounding along angles that the hinge holds must not scale them."""
    found = mbstab.loads(SPATIAL_LEVER.replace("damping: 20", "damping: 0").replace("0.2]", f"{lift}]")).eig()
    assert np.sort(found.values().imag) == pytest.approx([-4.64505663185974978, 4.64505663185974978], rel=1e-12)
    assert np.max(np.abs(found.values().real)) < 1e-12


WHIRLED = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 0}, m: {type: planar_point, mass: 1}}
joints: {rod: {type: distance, between: [p, ground], length: 1}}
forces:
  a: {type: spring, between: [p, m], stiffness: 50, length: 0}
  b: {type: spring, between: [m, ground], stiffness: 50, length: 3}
reference: {coordinates: {p: {x: 1, y: 0}, m: {x: 2, y: 0}}}
"""


def test_a_point_on_a_rod_follows_all_around():
    """The rod points at the mass, at every angle: as a spring of length 1 at the pivot, of the same stiffness.

    At the reference the rod does not see y of the point: what a row contains counts, not its slopes there.
    """
    alone = WHIRLED.replace("p: {type: planar_point, mass: 0}, ", "").replace("p: {x: 1, y: 0}, ", "")
    alone = alone.replace("joints: {rod: {type: distance, between: [p, ground], length: 1}}\n", "")
    alone = alone.replace("between: [p, m], stiffness: 50, length: 0", "between: [ground, m], stiffness: 50, length: 1")
    settings = {"to": 4.0, "points": 9, "perturb": {"rate(m.y)": 4.0}, "tol": 1e-8}
    run, other = (mbstab.loads(text).simulate(**settings) for text in (WHIRLED, alone))
    place = run.q[:, [run.names.index(name) for name in ("m.x", "m.y")]]
    assert place == pytest.approx(other.q, abs=1e-6)
    assert np.unwrap(np.arctan2(*place.T[::-1]))[-1] > 2.0 * np.pi
    point = run.q[:, [run.names.index(name) for name in ("p.x", "p.y")]]
    assert np.linalg.norm(place, axis=1)[:, None] * point == pytest.approx(place, abs=1e-9)


def test_a_lever_about_its_reference_point_swings():
    """Small vibrations have the frequency that eig gives; the spring of the stay is part of the balance."""
    lever = mbstab.loads(LEVER.replace("AT", "0").replace("D}", "0}"))
    omega = max(lever.eig().values().imag)
    run = lever.simulate(to=float(2.0 * np.pi / omega), points=3, perturb={"b.y": 1e-4}, tol=1e-8)
    y = run.q[:, run.names.index("b.y")]
    assert y[0] - y[1] == pytest.approx(2e-4, abs=1e-7)
    assert y[2] == pytest.approx(y[0], abs=1e-7)


@pytest.mark.parametrize("system", [lambda: line(*ZENER), lambda: mbstab.loads(PENDULUM)], ids=["zener", "pendulum"])
def test_motions_verify_eigenvalues(system):
    found = system().verify()
    assert found.verdict == "confirmed"
    assert all(mode.error < 1e-3 for mode in found.modes)


def test_a_motion_starts_in_a_mode():
    run = line(*ZENER).simulate(to=0.2, points=3, perturb={"mode:2": 0.01}, tol=1e-8)
    i, j = (run.names.index(x) for x in ("n0.x", "n1.x"))
    values = line(*ZENER).eig().values()
    real = values[np.argmin(np.abs(values.imag))].real
    assert np.max(np.abs(run.q[0, [i, j]])) == pytest.approx(0.01, rel=1e-9)
    assert run.u[0, i] == pytest.approx(real * run.q[0, i], rel=1e-9)
    assert run.q[:, i] == pytest.approx(run.q[0, i] * np.exp(real * run.times), abs=1e-8)


HINGED = """
mbstab: 1
bodies:
  load: {type: planar, mass: 2, inertia: 1}
  lever: {type: planar, mass: 0, inertia: 0, points: {A: [X, 1], B: [0, 0.4]}}
joints:
  rail: {type: prismatic, between: [load, {body: ground, point: [0, 1]}], axis: x}
  hinge: {type: revolute, between: [lever, ground]}
forces:
  link: {type: spring, between: [lever.A, load], stiffness: 300, length: 1 - X}
  mount: {type: bearing, between: [lever.B, {body: ground, point: [0, 0.4]}], stiffness: 20, damping: C}
reference: {coordinates: {load: {x: 1, y: 1, theta: 0}, lever: {x: 0, y: 0, theta: 0}}}
"""


@pytest.mark.parametrize("x", ["0", "0.2"])
@pytest.mark.parametrize(("c", "verdict"), [(5, "asymptotically stable"), (0, "stable")])
def test_a_lever_without_mass_on_a_hinge_is_proven(x, c, verdict):
    """2 s^2 (300 + z) + 300 z = 0 with z = 0.4^2 (20 + c s), wherever the link is fixed along its line."""
    certificate = mbstab.loads(HINGED.replace("X", x).replace("C}", f"{c}}}")).certify()
    assert (certificate.status, certificate.verdict) == ("proven", verdict)
    h = 0.4**2
    expected = np.roots([2 * h * c, 2 * (300 + 20 * h), 300 * h * c, 300 * 20 * h][0 if c else 1 :])
    assert sum(e.count for e in certificate.eigenvalues) == len(expected)
    for s in expected:
        assert any(e.contains(s, 1e-11 * abs(s)) for e in certificate.eigenvalues), s
