"""Critical values: what happens between two points and at special ones, and derivatives by parameters."""

import csv
import json
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from click.testing import CliRunner
from sampling import sample

import mbstab
from mbstab import load, loads
from mbstab.analysis.sweep import batched_spectra
from mbstab.analysis.sweep.batched_verdict import NOT_COUNTED, _zeros
from mbstab.analysis.sweep.spectra import WORD
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import STRENGTH, UNDECIDED, WORDS
from mbstab.cli import main


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


@pytest.mark.few(1)
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


@pytest.mark.few(1)
@pytest.mark.parametrize("place", sample([0.161327041997346, 0.45, 0.7123], 2))
@pytest.mark.parametrize("beside", [("1", "1"), ("4e-5", "0.5"), ("4e-6*(1 + p)", "0.5"), ("1e-3*p**2", "0.5")])
def test_a_change_through_infinity_is_told_beside_slow_eigenvalues(place, beside):
    """Next to such a place slow eigenvalues are undecided, but the points of the sweep tell that stability changes."""
    found = oscillators([(f"1000*(p - 0.9)/(p - {place})", "1"), beside]).sweep("p", np.linspace(0.0, 1.0, 31))
    infinite, zero = found.critical
    assert (infinite.kind, infinite.unstable) == ("infinity", (0, 1))
    assert (zero.kind, zero.unstable) == ("divergence", (1, 0))
    assert zero.value == pytest.approx(0.9, rel=1e-9)
    assert abs(infinite.value - place) <= min(max(infinite.error, 1e-15), 1e-9)
    assert infinite.error < 1e-7


@pytest.mark.few(1)
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


@pytest.mark.few(1)
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


# --- branches that touch, are equal at an end of the range, or pass multiple zeros ------------------------------------


TEXT = """mbstab: 1
parameters: {p: 0}
bodies: {a: {type: planar_point, mass: 1}}
forces: {s: {type: expression, on: {a.x: -a.x, a.y: -(1 + GAP)*a.y}}}
reference: {coordinates: {a: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(
    ("gap", "meeting", "within"),
    [
        ("p**2", None, 0.0),
        ("p**3", None, 0.0),
        ("p**4", None, 0.0),
        ("(p - 1)**2", None, 0.0),
        ("(p - 0.5)**2", 0.5, 1e-12),
        ("(p - 0.503)**2", 0.503, 1e-6),
        ("(p - 0.503)**3", 0.503, 1e-4),
        ("1e-4*(p - 0.503)", 0.503, 1e-8),
        ("p - 0.503", 0.503, 1e-11),
        ("0.5*sin(9*pi*p)", (1 / 9, 2 / 9, 1 / 3, 4 / 9, 5 / 9, 2 / 3, 7 / 9, 8 / 9), 1e-11),
    ],
)
def test_branches_that_touch_meet_once(gap, meeting, within):
    found = mbstab.loads(TEXT.replace("GAP", gap)).sweep("p", np.linspace(0.0, 1.0, 21), meetings=True)
    expected = np.repeat([] if meeting is None else np.atleast_1d(meeting), 2)  # above and below the real axis
    assert found.warnings == ()
    assert {kind for _, kind in found.meetings} <= {"cross"}
    assert len(found.meetings) == len(expected)
    assert np.max(np.abs(np.sort([value for value, _ in found.meetings]) - expected), initial=0.0) <= within


def test_two_shafts_that_are_equal_at_first_do_not_meet():
    found = mbstab.load("drive_shafts.yaml").sweep("beta", np.linspace(0.0, 1.2, 61), meetings=True)
    assert (found.warnings, found.meetings) == ((), ())


def test_a_pair_is_followed_through_zeros_that_nothing_explains():
    found = mbstab.load("rolling_disk.yaml").sweep("omega", np.linspace(0.0, 10.0, 401), meetings=True)
    assert (found.warnings, found.meetings) == ((), ())
    first, last = found.branches[[0, -1]]
    growing, falling = int(np.argmax(first.real)), int(np.argmin(first.real))
    assert last[growing].imag > 5.0
    assert last[falling].imag < -5.0
    (critical,) = found.critical
    assert critical.branches == (growing,)
    assert critical.value == pytest.approx(3.316764376003506, rel=1e-11)


# --- structure that holds at special values of a parameter is not carried to others -----------------------------------


NAME = {number: word for word, number in WORD.items()}
WINDOW = "smooth_start((q-1.3)/0.1)*smooth_start((1.7-q)/0.1)"
RAIL = "point_on_line, between: [ground, p], axis: x"


def rail(force, k, more=""):
    """Return the text of a point on a rail; x, u: place and speed, k: a coefficient that depends on q and b."""
    force = force.replace("x", "p.x").replace("u", "rate(p.x)")
    return (
        f"mbstab: 1\nparameters: {{q: 1, b: 0, k: {k}}}\nbodies:\n  p: {{type: planar_point, mass: 1}}\n"
        f"joints:\n  r: {{type: {RAIL}}}\nforces:\n  f: {{type: expression, on: {{p.x: '{force}'}}}}\n"
        "reference:\n  coordinates: {p: {x: 0, y: 0}}\n"
    )


FORCES = ["-u + k*x**3", "-u - k*x**3", "-x + k*u**3", "-x - k*u**3", "-x + k*u*x**2", "-x - u + k*x**2", "-u + k*x*u"]


COEFFICIENTS = [WINDOW, f"-{WINDOW}", "abs(q-1)+q-1", "(q-1)**2"]


@pytest.mark.few(1)
@pytest.mark.parametrize(("k", "force"), sample(product(COEFFICIENTS, FORCES), 18))
def test_a_term_that_is_zero_elsewhere_counts(k, force):
    model = mbstab.loads(rail(force, k))
    values = np.linspace(0.0, 2.0, 21)
    swept = model.sweep("q", values)
    for q, word in zip(values, swept.words, strict=True):
        single = model.eig(q=float(q)).verdict
        assert NAME[word] in STRENGTH[single], (q, NAME[word], single)
    assert {NAME[word] for word in swept.words} <= set(WORDS)


def test_growth_between_damped_ranges_is_found():
    swept = mbstab.loads(rail("-u + k*x**3", WINDOW)).sweep("q", np.linspace(0.0, 2.0, 41))
    inside = (swept.values > 1.31) & (swept.values < 1.69)
    assert {NAME[word] for word in swept.words[inside]} == {"unstable"}
    assert "unstable" not in {NAME[word] for word in swept.words[~inside]}


@pytest.mark.long
@pytest.mark.parametrize("order", [("q", "b"), ("b", "q")])
def test_a_triangle_of_a_chart_is_not_taken_for_the_rest(order):
    model = mbstab.loads(rail("-u + k*x**3", "abs(b-q)+b-q"))
    values = np.linspace(0.0, 1.0, 6)
    found = model.chart(dict.fromkeys(order, values))
    assert found.parameters == order
    for row, second in zip(found.verdicts, values, strict=True):
        for word, first in zip(row, values, strict=True):
            at = dict(zip(order, (first, second), strict=True))
            assert (word in ("unstable", "undecided")) == (at["b"] > at["q"]), (at, word)


def test_pairs_that_leave_the_axis_at_one_value_only():
    """A rattleback without spin: one rocking mode grows with spin in one sense, the other one in the other sense."""
    found = mbstab.load("rattleback.yaml").sweep("omega", np.linspace(-2.0, 2.0, 5)).critical
    assert [(c.value, c.kind, c.unstable) for c in found] == [(0.0, "flutter", (2, 0)), (0.0, "flutter", (0, 2))]
    assert [c.frequency for c in found] == pytest.approx([107.207658319253605, 33.8289912761731306], rel=1e-9)


# --- zeros that only a family of motions explains are not judged one by one -------------------------------------------


# Drives by velocities leave the places of three bodies along the track open: no symmetry shifts only one of them.
BOGIE = """
mbstab: 1
parameters:
  v: {value: 100, unit: km/h}
  m: {value: 1200, unit: kg}
  J: {value: 700, unit: kg*m^2}
  mf: {value: 2500, unit: kg}
  Jf: {value: 2600, unit: kg*m^2}
  a: {value: 1.25, unit: m}
  kx: {value: 6, unit: MN*m/rad}
  ky: {value: 5, unit: MN/m}
  r0: {value: 0.46, unit: m}
  lam: {value: 0.1, unit: rad}
  b: {value: 0.75, unit: m}
  f11: {value: 8, unit: MN}
  f22: {value: 7.5, unit: MN}
bodies:
  frame: {type: planar, mass: mf, inertia: Jf, points: {f: [a, 0], r: [-a, 0]}}
  ws1: {type: planar, mass: m, inertia: J}
  ws2: {type: planar, mass: m, inertia: J}
forces:
  cr1: {type: creep, at: ws1, half_gauge: b, conicity: lam, radius: r0, f11: f11, f22: f22}
  cr2: {type: creep, at: ws2, half_gauge: b, conicity: lam, radius: r0, f11: f11, f22: f22}
  s1: {type: bushing, between: [ws1, frame.f], stiffness: [0, ky], torsional_stiffness: kx}
  s2: {type: bushing, between: [ws2, frame.r], stiffness: [0, ky], torsional_stiffness: kx}
  sec: {type: bushing, between: [frame, ground], stiffness: [0, 3e5], damping: [0, 3e4], torsional_stiffness: 1e5}
drives:
  d0: {type: point, at: frame, direction: x, velocity: v}
  d1: {type: point, at: ws1, direction: x, velocity: v}
  d2: {type: point, at: ws2, direction: x, velocity: v}
reference:
  coordinates: {frame: {x: 0, y: 0, theta: 0}, ws1: {x: a, y: 0, theta: 0}, ws2: {x: -a, y: 0, theta: 0}}
"""


@pytest.fixture
def judged_alone(monkeypatch):
    """The points that are judged as `eig` does."""
    found, exact = [], batched_spectra._Work._exact

    def counted(self, i, grounds=None):
        found.append(i)
        return exact(self, i, grounds)

    monkeypatch.setattr(batched_spectra._Work, "_exact", counted)
    return found


@pytest.mark.long
def test_a_family_is_followed_at_some_points_and_answers_for_the_others(judged_alone):
    model = mbstab.loads(BOGIE)
    speeds = np.linspace(20.0, 50.0, 200)  # m/s
    swept = model.sweep("v", speeds, si=True)
    assert len(judged_alone) <= TOLERANCES.points_guarded + 2
    assert set(swept.verdicts) == {"asymptotically stable up to symmetry"}
    for k in (0, 57, 199):
        answer = model.eig(v=3.6 * float(speeds[k]))
        assert answer.verdict == swept.verdicts[k]
        expected = answer.values()
        expected = expected[np.abs(expected) > 1e-3]
        distance = np.abs(expected[:, None] - swept.branches[k][None, :])
        assert np.all(distance.min(axis=1) <= 1e-6 * np.abs(expected))


def test_zeros_count_only_where_a_gap_tells_them_from_the_others():
    stacked = np.array([np.diag([3.0, 1.0, x]) for x in (0.0, 1e-12, 1e-9, 1e-6)])
    assert _zeros(stacked).tolist() == [1, 1, NOT_COUNTED, 0]


@pytest.mark.long
def test_where_one_point_has_another_answer_each_is_judged(judged_alone, monkeypatch):
    plain, asked = batched_spectra._Work._judged, []

    def other(self, i, grounds=None):
        asked.append(i)
        verdict = plain(self, i, grounds)
        return replace(verdict, family=("another",)) if len(asked) == TOLERANCES.points_guarded else verdict

    monkeypatch.setattr(batched_spectra._Work, "_judged", other)
    work = batched_spectra.Evaluator(mbstab.loads(BOGIE).model)
    found = work.spectra({"v": np.linspace(20.0, 40.0, 14)})
    assert set(judged_alone) == set(range(14))
    assert not np.any(found.words == WORD[UNDECIDED])


# --- derivatives of critical values by parameters, against closed forms and values computed again ---------------------


def swept(mechanism, parameter, first, last, points=9):
    return mechanism.sweep(parameter, np.linspace(first, last, points), sensitivity=True).critical


def assert_slopes(c, expected, tolerance):
    """Compare derivatives and their error estimates."""
    found = dict(zip(c.slopes.names, zip(c.slopes.slopes, c.slopes.errors, strict=True), strict=True))
    for name, exact in expected.items():
        slope, error = found[name]
        assert abs(slope - exact) <= tolerance * abs(exact)
        assert abs(slope - exact) <= 10.0 * error + 1e-14 * abs(exact)  # the estimate is no fiction
        assert error <= 1e-5 * abs(exact)  # nor is it useless


def test_flutter_of_a_column():
    (c,) = swept(load("ziegler_column.yaml"), "P", 0.5, 2.0)
    b_1, b_2 = 0.1, 0.2
    # Where k, l and m are 1: P = (k/l) (4 b**2 + 33 b + 4)/(2 (b**2 + 7 b + 6)) + b_1 b_2/(2 m l**3) with b = b_1/b_2.
    b = b_1 / b_2
    over, under = 4 * b**2 + 33 * b + 4, 2 * (b**2 + 7 * b + 6)
    moved = ((8 * b + 33) * under - over * (4 * b + 14)) / under**2
    expected = {
        "k": over / under,
        "l": -over / under - 3 * b_1 * b_2 / 2,
        "m": -b_1 * b_2 / 2,
        "b_1": moved / b_2 + b_2 / 2,
        "b_2": -moved * b / b_2 + b_1 / 2,
    }
    assert_slopes(c, expected, 1e-10)


def test_shimmy_at_both_ends_of_its_range():
    low, high = swept(load("shimmy.yaml"), "a", 0.1, 0.9)
    root = math.sqrt(1.0 - 4.0 * 0.21)  # a = (l ± sqrt(l**2 - 4 I/m))/2
    for c, sign in ((low, -1.0), (high, 1.0)):
        expected = {"l": 0.5 * (1.0 + sign / root), "I": -sign / root, "m": sign * 0.21 / root}
        assert_slopes(c, expected, 1e-10)
        k, u = (c.slopes.names.index(name) for name in ("k", "u"))
        assert abs(c.slopes.slopes[k]) <= 10.0 * c.slopes.errors[k] < 1e-10  # it is critical at any speed
        assert abs(c.slopes.slopes[u]) <= 10.0 * c.slopes.errors[u] < 1e-10


def test_the_collision_of_a_sleeping_top():
    (c,) = swept(load("top.yaml"), "omega", 4.0, 8.0)
    assert c.kind == "collision"
    about = 3e-4 + 0.01 * 0.04**2  # omega = 2 sqrt((I_x + m H**2) m g H)/I_z
    omega = 2.0 * math.sqrt(about * 0.01 * 9.81 * 0.04) / 4e-4
    expected = {
        "I_z": -omega / 4e-4,
        "I_x": omega / (2 * about),
        "g": omega / (2 * 9.81),
        "m": omega * (0.04**2 / (2 * about) + 1 / (2 * 0.01)),
        "H": omega * (0.01 * 0.04 / about + 1 / (2 * 0.04)),
    }
    assert_slopes(c, expected, 1e-9)


STANDING = """
mbstab: 1
parameters: {m: 2.0, l: 0.5, g: 9.81, k: 12.0, c: 0.3, m_c: 4.0}
gravity: [0, -g]
bodies:
  cart: {type: planar, mass: m_c, inertia: 1}
  rod: {type: planar, mass: m, inertia: 0.01, points: {O: [0, -l]}}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: [1, 0]}
  hinge: {type: revolute, between: [rod.O, cart]}
forces:
  spring: {type: expression, on: {rod.theta: -k*rod.theta - c*rate(rod.theta)}}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, rod: {x: 0, y: l, theta: 0}}
"""


@pytest.mark.parametrize("damping", sample([0.3, 0.0], 2))
def test_a_zero_eigenvalue_beside_neutral_ones(damping):
    """An upright rod on a free cart: k = m g l, where one eigenvalue passes zero, or a pair turns real."""
    (c,) = swept(loads(STANDING).at(c=damping), "k", 5.0, 15.0)
    assert c.kind == "divergence"
    assert c.value == pytest.approx(9.81, rel=1e-9)
    assert_slopes(c, {"m": 9.81 * 0.5, "g": 1.0, "l": 2.0 * 9.81}, 1e-8)
    for name in ("m_c", "c"):
        k = c.slopes.names.index(name)
        assert abs(c.slopes.slopes[k]) <= 10.0 * c.slopes.errors[k] < 1e-5


@pytest.mark.long
def test_weave_and_capsize_of_the_bicycle():
    """Lengths of all kinds scale: v is as sqrt(g L); and g against critical speeds computed again."""
    bicycle = load("whipple_bicycle.yaml")
    weave, capsize = swept(bicycle, "v", 4.0, 6.5)
    assert (weave.kind, capsize.kind) == ("flutter", "divergence")
    assert_slopes(weave, {"g": weave.value / (2 * 9.81)}, 1e-11)
    # Interpolated between neighbouring values: to 1e-7 of the largest derivative, as it is asked for.
    assert_slopes(capsize, {"g": capsize.value / (2 * 9.81)}, 1e-7)


@pytest.mark.long
def test_the_bicycle_against_critical_speeds_computed_again():
    bicycle = load("whipple_bicycle.yaml")
    weave, capsize = swept(bicycle, "v", 4.0, 6.5)
    for name in ("c", "z_B"):
        at, h = bicycle.parameters()[name], 1e-2
        near = [
            [x.value for x in bicycle.sweep("v", np.linspace(4.0, 6.5, 9), **{name: at * (1 + n * h)}).critical]
            for n in (-3, -2, -1, 1, 2, 3)
        ]
        exact = np.array([-1, 9, -45, 45, -9, 1]) @ np.array(near) / (60 * h * at)
        for c, difference, tolerance in ((weave, exact[0], 1e-8), (capsize, exact[1], 1e-6)):
            assert c.slopes.slopes[c.slopes.names.index(name)] == pytest.approx(difference, rel=tolerance)


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "parameter", "ends", "reason"),
    sample(
        [
            ("bead_on_hoop.yaml", "Omega", (1.0, 8.0), "other equilibria branch off"),
            ("von_mises_truss.yaml", "P", (-10.0, 10.0), "the path of equilibria turns back"),
        ],
        2,
    ),
)
def test_where_there_is_no_derivative_the_reason_is_said(model, parameter, ends, reason):
    (c,) = swept(load(model), parameter, *ends)
    assert reason in c.slopes.missing
    assert not c.slopes.names


def test_two_that_pass_together_are_not_differentiated():
    text = """
mbstab: 1
parameters: {k: 1.0}
bodies:
  a: {type: planar, mass: 1, inertia: 1}
forces:
  spring: {type: expression, on: {a.x: -k*a.x - rate(a.x), a.y: -k*a.y - rate(a.y), a.theta: -a.theta}}
"""
    (c,) = swept(loads(text), "k", -1.0, 1.5)
    assert "together" in c.slopes.missing


def test_the_command_prints_what_moves_a_critical_value_most_first():
    arguments = ["sweep", "top.yaml", "--param", "omega", "--from", "4", "--to", "8", "--points", "11", "--sensitivity"]
    run = CliRunner().invoke(main, [*arguments, "--plot", "none"], catch_exceptions=False)
    assert run.exit_code == 0, run.output
    lines = run.stdout.rstrip().splitlines()
    assert "omega = 5.567728442 rad/s, collision" in lines
    assert [line.split()[0] for line in lines[-5:]] == ["I_z", "H", "m", "g", "I_x"]
    run = CliRunner().invoke(main, [*arguments, "--format", "csv"], catch_exceptions=False)
    rows = {row["parameter"]: row for row in csv.DictReader(run.stdout.splitlines())}
    assert float(rows["g"]["derivative"]) == pytest.approx(5.567728441644 / (2 * 9.81), rel=1e-9)
    run = CliRunner().invoke(main, [*arguments, "--format", "json"], catch_exceptions=False)
    (item,) = json.loads(run.stdout)["sensitivity"]
    assert item["derivatives"]["g"]["percent"] == pytest.approx(0.01 * 5.567728441644 / 2, rel=1e-9)
    assert next(iter(item["derivatives"])) == "I_z"


def test_derivatives_are_in_the_declared_units_of_both_parameters():
    text = STANDING.replace("l: 0.5,", "l: {value: 500, unit: mm},").replace("k: 12.0", "k: {value: 12, unit: N*m}")
    arguments = ["sweep", "-", "--param", "k", "--from", "5", "--to", "15", "--points", "9", "--sensitivity"]
    run = CliRunner().invoke(main, [*arguments, "--format", "json"], input=text, catch_exceptions=False)
    (item,) = json.loads(run.stdout)["sensitivity"]
    assert item["derivatives"]["l"]["derivative"] == pytest.approx(2.0 * 9.81e-3, rel=1e-8)


def test_options_that_contradict_are_refused():
    run = CliRunner().invoke(main, ["sweep", "top.yaml", "--param", "omega", "--param", "H", "--sensitivity"])
    assert run.exit_code == 2
    assert "--sensitivity goes with one parameter" in run.output


TWO_RAILS = """\
mbstab: 1
parameters: {p: 0}
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
constraints: {ay: {holonomic: a.y}, by: {holonomic: b.y}}
forces:
  f: {type: expression, on: {a.x: -(4+p)*a.x-(0.2-0.1*p)*rate(a.x), b.x: -(8-p)*b.x-(0.1*p-0.05)*rate(b.x)}}
"""


@pytest.mark.parametrize("find", ["", "reference: {find: equilibrium}\n"])
@pytest.mark.parametrize(("low", "high", "points"), [(0.0, 3.7, 2), (-3.5, 7.5, 9), (0.4, 2.1, 2), (0.0, 3.0, 4)])
def test_pairs_that_exchange_stability_between_two_points_are_found(low, high, points, find):
    # One pair becomes stable at 1/2, the other one unstable at 2: as many are unstable before as after.
    result = mbstab.loads(TWO_RAILS + find).sweep("p", np.linspace(low, high, points))
    assert [c.value for c in result.critical] == pytest.approx([0.5, 2.0], rel=1e-10)
    assert [c.unstable for c in result.critical] == [(2, 0), (0, 2)]
    # That of b, the faster one, passes first; also where branches at the next point lie nearer to that of a.
    assert [abs(result.branches[0, c.branches[0]]) for c in result.critical] == pytest.approx(
        [math.sqrt(8.0 - low), math.sqrt(4.0 + low)]
    )


# --- ranges: points at which the spectrum is special speak for themselves only ---------------------------------------

RESISTED = """
mbstab: 1
parameters: {{p: 0.3}}
bodies: {{b: {{type: planar_point, mass: 1}}}}
constraints: {{r: {{holonomic: b.y}}}}
forces: {{f: {{type: expression, on: {{b.x: "-rate(b.x) - ({force})"}}}}}}
reference: {{find: equilibrium, guess: {{b: {{x: {guess}}}}}}}
"""


def said(result):
    """Return the ranges of a sweep and of the paths that it leads to: ends rounded, verdict, unstable eigenvalues."""
    return [
        [(round(x.low, 6) + 0.0, round(x.high, 6) + 0.0, WORDS[x.word], x.counts) for x in path.ranges]
        for path in (result, *result.beyond)
    ]


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize(
    ("force", "guess", "ends", "ranges"),
    [
        ("b.x**2 - p", 1, (0, 1, 11), {(0.0, 1.0, "asymptotically stable", (0,)), (0.0, 0.0, "unstable", (0,))}),
        ("b.x**2 - p**2*(1 - p)", -1, (-1, 1, 21), {(0.0, 1.0, "asymptotically stable", (0,)),
         (0.0, 1.0, "unstable", (1,)), (-1.0, 0.0, "unstable", (1,)), (-1.0, 0.0, "asymptotically stable", (0,)),
         (0.0, 0.0, "unstable", (0,)), (1.0, 1.0, "unstable", (0,))}),
        ("(b.x - p)*(b.x**2 - p)", 1, (-1, 0.5, 16), {(-1.0, 0.0, "asymptotically stable", (0,)),
         (0.0, 0.0, "asymptotically stable", (0,)), (0.0, 0.5, "unstable", (1,)),
         (0.0, 0.5, "asymptotically stable", (0,))}),
    ],
)  # fmt: skip
def test_a_fold_or_crossing_on_a_point_says_nothing_of_the_interval_beside_it(force, guess, ends, ranges, down):
    grid = np.linspace(*ends)
    result = loads(RESISTED.format(force=force, guess=guess)).sweep("p", grid[::-1] if down else grid)
    assert {x for path in said(result) for x in path} == ranges
    assert "unresolved" not in [c.kind for path in (result, *result.beyond) for c in path.critical]


def test_a_point_with_more_symmetry_than_the_others_says_nothing_of_the_interval_beside_it():
    """Gyroscopic terms hold the mass from p = √6 − 2 on; at p = 0.5 its stiffness vanishes, beyond it is positive."""
    text = """
mbstab: 1
parameters: {p: 0.3}
bodies: {b: {type: planar_point, mass: 1}}
forces:
  f: {type: expression, on: {b.x: "p*rate(b.y) - b.x*(p - 0.5)", b.y: "-p*rate(b.x) - b.y*(p - 0.5)"}}
reference: {coordinates: {b: {x: 0, y: 0}}}
"""
    (found,) = said(loads(text).sweep("p", np.linspace(-1.0, 1.0, 21)))
    place = round(math.sqrt(6.0) - 2.0, 6)
    assert found == [
        (-1.0, place, "unstable", (2,)), (place, 0.5, "marginally stable", (0,)),
        (0.5, 0.5, "stable up to symmetry", (0,)), (0.5, 1.0, "stable", (0,)),
    ]  # fmt: skip


@pytest.mark.parametrize("damping", ["0", "0.3"])
@pytest.mark.parametrize("stiffness", ["p", "p**3"])
@pytest.mark.parametrize(("low", "high", "points"), [(-1.0, 1.0, 21), (1.0, -1.0, 21), (-1.0, 1.0, 20), (0.7, -1.3, 9)])
def test_two_equal_motions_diverge_together(low, high, points, stiffness, damping):
    found = oscillators(2 * [(stiffness, damping)]).sweep("p", np.linspace(low, high, points)).critical
    assert [(c.kind, c.unstable) for c in found] == [("divergence", (2, 0))]
    assert abs(found[0].value) < 1e-4


def passing(kind, g, sign, power):
    """Return laws of which as many eigenvalues as are told pass the imaginary axis at p = g, and their number."""
    d = f"({sign}*(p - {g!r})**{power})"
    return {
        "divergence": ([(d, "0.7")], 1),
        "divergence without damping": ([(d, "0")], 1),
        "divergence of two": ([(d, "0.7"), (d, "0.7")], 2),
        "divergence of two without damping": ([(d, "0"), (d, "0")], 2),
        "flutter": ([("4", d)], 2),
        "flutter beside a free oscillation": ([("4", d), ("4", "0")], 2),
    }[kind]


KINDS = ("divergence", "divergence without damping", "divergence of two", "divergence of two without damping",
         "flutter", "flutter beside a free oscillation")  # fmt: skip


@pytest.mark.few(4)
@pytest.mark.parametrize(("seed", "kind"), [(seed, kind) for seed in range(8) for kind in KINDS])
def test_a_critical_value_is_the_same_whether_or_not_it_is_a_point_and_upwards_and_downwards(seed, kind):
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    g, sign, power = round(float(rng.uniform(-1.0, 1.0)), 3), int(rng.choice([-1, 1])), int(rng.choice([1, 1, 3]))
    laws, passed = passing(kind, g, sign, power)
    more = [] if "without" in kind else [("2.5", "0.3")] * int(rng.integers(2))
    model = oscillators([*laws, *more])
    counts = (passed, 0) if sign > 0 else (0, passed)
    step = float(rng.uniform(0.03, 0.2))
    on = g + step * np.arange(-int(rng.integers(3, 9)), int(rng.integers(4, 9)))
    on[np.abs(on - g) < 1e-9] = g
    off = np.linspace(on[0], on[-1], int(rng.integers(5, 40)))
    for grid in (on, on[::-1], off, off[::-1]):
        found = model.sweep("p", grid)
        (critical,) = found.critical
        assert (critical.kind, critical.unstable) == (kind.split()[0], counts)
        assert abs(critical.value - g) <= critical.error + 1e-12
        assert critical.error <= (1e-12 if power == 1 else 1e-4)
        wide = [x for x in found.ranges if x.high > x.low]
        # A point that is the value but for rounding stands for it.
        assert np.ravel([(x.low, x.high) for x in wide]) == pytest.approx(
            [min(grid), critical.value, critical.value, max(grid)], abs=1e-15
        )
        for part in wide:
            inner = part.low + rng.uniform(0.2, 0.8) * (part.high - part.low)
            assert model.eig(p=float(inner)).judged.word == WORDS[part.word]


@pytest.mark.parametrize("points", [(0.1, 0.0, 14), (0.0, 0.1, 11), (1.0, -1.1, 21), (-1.0, 1.0, 21)])
def test_one_through_zero_and_one_through_infinity_are_one_change(points):
    low, high, number = points
    found = oscillators([("1", "1/(p - 0.013)"), ("1", "1")]).sweep("p", np.linspace(low, high, number))
    (critical,) = found.critical
    assert critical.unstable == (2, 0)
    assert critical.value == pytest.approx(0.013, rel=1e-12)
    assert len(found.ranges) == 2


@pytest.mark.parametrize("points", [(-1.0, 1.0, 21), (-1.0, 1.0, 20), (-1.0, 0.5, 16), (1.0, -1.0, 21)])
def test_a_pair_that_passes_another_one_on_the_axis_does_so_where_it_does(points):
    """Both of z'' + p z' + (1 - ip) z = 0 are i at p = 0; one stays there, the other one is i - p."""
    text = """
mbstab: 1
parameters: {p: 0.3}
bodies: {b: {type: planar_point, mass: 1}}
forces:
  f: {type: expression, on: {b.x: "-b.x + p*b.y - p*rate(b.x)", b.y: "-b.y - p*b.x - p*rate(b.y)"}}
reference: {coordinates: {b: {x: 0, y: 0}}}
"""
    low, high, number = points
    found = loads(text).sweep("p", np.linspace(low, high, number))
    (critical,) = found.critical
    assert (critical.kind, critical.unstable) == ("flutter", (2, 0))
    assert abs(critical.value) <= 1e-12
    assert [WORDS[x.word] for x in found.ranges if x.high > x.low] == ["unstable", UNDECIDED]
