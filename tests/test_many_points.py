"""Sweeps and charts of equilibria that are found all at once: against single answers and closed forms."""

import numpy as np
import pytest
from sampling import sample
from scipy.optimize import root
from test_sweep import CUBIC, optimal

import mbstab
from mbstab.analysis.reference import many_points
from mbstab.analysis.reference.continuation import follow
from mbstab.analysis.reference.equations import Balance
from mbstab.analysis.reference.paths import Sheet, Surface
from mbstab.analysis.reference.sheets import follow_all
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.blocks import home_of, patterns_at
from mbstab.analysis.verdict.rule import WORDS
from mbstab.model.parameters import settings_in_si

SWEEPS = [
    ("rotating_pendulum", {"Omega": (5.0, 20.0)}),
    ("bead_on_hoop", {"Omega": (1.0, 4.0), "R": (0.3, 0.6)}),
    ("andrews_squeezer", {"m3": (0.02, 0.03)}),
    ("von_mises_truss", {"k": (60.0, 200.0), "h": (0.4, 0.6)}),
    ("governor", {"omega": (1.0, 40.0)}),
    ("bead_on_hoop", {"Omega": (1.0, 8.0)}),
    ("rotating_pendulum", {"Omega": (6.0, 12.0), "l": (0.45, 0.7)}),
    ("bricard", {"m": (0.5, 2.0)}),
    ("governor_paper", {"sigma": (2.0, 20.0)}),
    ("governor", {"omega": (1.0, 40.0), "m_c": (2.0, 4.0)}),
    ("flyball_governor", {"omega": (4.0, 8.0)}),
]
"""Models whose reference is found, with parameters and their ranges."""


def grid(ranges, points):
    """Return the points of a sweep, or of a chart row by row."""
    axes = np.meshgrid(*(np.linspace(*ends, points) for ends in ranges.values()))
    return {name: x.ravel() for name, x in zip(ranges, axes, strict=True)}


def solutions(model, ranges):
    """Return the equilibria over one parameter or two."""
    if len(ranges) == 1:
        ((name, ends),) = ranges.items()
        return follow(model, name, *ends)
    return follow_all(model, tuple(ranges), *(np.linspace(*ends, 24) for ends in ranges.values()))


@pytest.mark.parametrize(("name", "ranges"), sample(SWEEPS, 6))
def test_points_at_random_are_answered_as_eig_answers_them(name, ranges):
    mechanism = mbstab.load(f"{name}.yaml")
    values = grid(ranges, 24 if len(ranges) > 1 else 60)
    found = Evaluator(mechanism.model, solutions(mechanism.model, ranges)).spectra(values)
    assert found.problems == {}
    for i in np.random.default_rng(len(name)).choice(len(found.values), 4, replace=False).tolist():
        single = mechanism.eig(**settings_in_si({key: float(x[i]) for key, x in values.items()}))
        exact = single.values()
        assert optimal(found.values[i], exact) <= 1e-13 * np.max(np.abs(exact))
        assert WORDS[found.words[i]] == single.judged.word


def test_a_steady_motion_over_two_parameters_is_the_closed_form_everywhere():
    # The bob turns with z = −g/Ω².
    axes = np.linspace(6.0, 12.0, 5), np.linspace(0.45, 0.7, 5)
    model = mbstab.load("rotating_pendulum.yaml").model
    surface = follow_all(model, ("Omega", "l"), *axes)
    assert isinstance(surface, Surface)
    values = {
        "Omega": np.random.default_rng(1).uniform(6.0, 12.0, 50),
        "l": np.random.default_rng(2).uniform(0.45, 0.7, 50),
    }
    q, _ = surface.predicted(values)
    z = mbstab.load("rotating_pendulum.yaml").system().names.index("bob.z")
    assert np.max(np.abs(q[:, z] + 9.81 / values["Omega"] ** 2)) < 1e-10
    assert surface.covers({"Omega": np.array([6.0, 5.9]), "l": np.array([0.7, 0.5])}).tolist() == [True, False]
    assert "Omega is beyond the range" in surface.missing({"Omega": np.array([5.9]), "l": np.array([0.5])}, 0)


def test_a_polynomial_says_what_the_path_that_is_followed_says(monkeypatch):
    model, x = mbstab.load("rotating_pendulum.yaml").model, np.linspace(7.0, 12.0, 31)
    smooth = follow(model, "Omega", 7.0, 12.0)
    monkeypatch.setattr("mbstab.analysis.reference.tolerances.Tolerances.smooth_points_most", 0)
    followed = follow(model, "Omega", 7.0, 12.0)
    assert smooth.surface is not None
    assert followed.surface is None
    assert (followed.ends, followed.crossings) == (smooth.ends, smooth.crossings) == ((), ())
    assert np.max(np.abs(smooth.predicted({"Omega": followed.values})[0] - followed.q)) < 1e-9
    one, other = (Evaluator(model, path).spectra({"Omega": x}) for path in (smooth, followed))
    assert np.array_equal(one.words, other.words)
    for left, right in zip(one.values, other.values, strict=True):
        assert optimal(left, right) < 1e-13 * np.max(np.abs(left))


@pytest.mark.parametrize(
    ("name", "parameter", "ends", "kind"),
    [
        ("bead_on_hoop", "Omega", (0.0, 8.0), "crossing"),
        ("von_mises_truss", "P", (-10.0, 10.0), "fold"),
    ],
)
def test_where_others_branch_off_or_it_turns_back_a_path_is_followed(name, parameter, ends, kind):
    path = follow(mbstab.load(f"{name}.yaml").model, parameter, *ends)
    assert path.surface is None
    if kind == "crossing":
        assert path.crossings == pytest.approx([np.sqrt(9.81 / 0.5)])
    else:
        assert path.ends


def test_a_crossing_between_the_points_is_seen_by_the_determinant():
    # On the path x = 0 of μ x − x³ all but the determinant is smooth.
    model = mbstab.loads(CUBIC.replace("LOAD", "mu*p.x - p.x**3").replace("{mu: 0, x0: 1}", "{mu: 0, x0: 0}")).model
    path = follow(model, "mu", -2.0, 2.1)
    assert path.surface is None
    assert path.crossings == pytest.approx([0.0], abs=1e-12)
    assert follow(model, "mu", -2.0, -0.1).surface is not None


def test_a_chart_in_which_some_rows_fold_is_followed_row_by_row():
    model = mbstab.load("von_mises_truss.yaml").model
    sheet = follow_all(model, ("P", "h"), np.linspace(0.0, 6.0, 5), np.linspace(0.2, 0.6, 3))
    assert isinstance(sheet, Sheet)
    assert [len(paths) for paths in sheet.paths] == [1] * 3


def test_neighbours_share_derivatives_also_where_rows_of_a_chart_begin(monkeypatch):
    ranges = {"Omega": (6.0, 12.0), "l": (0.45, 0.7)}
    model, values = mbstab.load("rotating_pendulum.yaml").model, grid(ranges, 24)
    evaluator = Evaluator(
        model, solutions(model, ranges), patterns_at(model, solutions(model, ranges), home_of(values))
    )
    expected = evaluator.near(values, 2).values
    monkeypatch.setattr(many_points, "newton", None)  # no point needs its own
    assert np.array_equal(evaluator.near(values, 2).values, expected)


def test_steps_of_a_march_become_longer_where_solutions_are_near_their_extrapolation(monkeypatch):
    derivatives, own = [], Balance.jacobian
    monkeypatch.setattr(Balance, "jacobian", lambda balance, at: derivatives.append(at) or own(balance, at))
    assert follow(mbstab.load("governor.yaml").model, "omega", 1.0, 40.0).surface is not None
    assert sum(at.q.ndim == 2 for at in derivatives) <= 26


def test_few_points_start_from_polynomials_that_are_just_good_enough_to_be_known_as_smooth():
    mechanism, ends = mbstab.load("governor.yaml"), (1.0, 40.0)
    few, many = (follow(mechanism.model, "omega", *ends, wanted=points).surface for points in (3, 1000))
    assert 2 * (len(few.coefficients) - 1) == len(many.coefficients) - 1
    x = np.linspace(*ends, 3)
    found = Evaluator(mechanism.model, few).spectra({"omega": x})
    for own, value in zip(found.values, x.tolist(), strict=True):
        exact = mechanism.eig(omega=value).values()
        assert optimal(own, exact) <= 1e-13 * np.max(np.abs(exact))


CAR = """
mbstab: 1
parameters: {delta: 0.05, u: 12, m: 1400, I: 2200, a: 1.2, b: 1.4, Cf: 6e4, Cr: 8e4}
bodies: {car: {type: planar, mass: m, inertia: I, points: {front: [a, 0], rear: [-b, 0]}}}
constraints: {cruise: {nonholonomic: vx(car) - u}}
forces:
  front: {type: tyre, at: car.front, along: [cos(delta), sin(delta)], cornering_stiffness: Cf}
  rear: {type: tyre, at: car.rear, cornering_stiffness: Cr}
reference:
  find: steady
  steady: {axis: z}
  coordinates: {car: {theta: 0}}
  guess: {car: {x: 0, y: -(a + b)/delta}}
"""


def turn(delta, u, m=1400.0, a=1.2, b=1.4, front=6e4, rear=8e4):
    """Return the speed across and the yaw rate of a car in a steady turn, from its equations."""

    def equations(x):
        v, r = x
        slip = np.arctan2(v + a * r, u) - delta, np.arctan2(v - b * r, u)
        forces = -front * slip[0] * np.cos(delta), -rear * slip[1]
        return sum(forces) / (m * u) - r, (a * forces[0] - b * forces[1]) / (m * u)

    return root(equations, [0.0, u * delta / (a + b)], tol=1e-13).x


def test_the_places_of_wide_turns_may_change_by_more_than_the_car_is_long():
    model = mbstab.loads(CAR).model
    path = follow(model, "delta", 0.005, 0.1)
    assert path.surface is not None
    deltas = np.array([0.005, 0.0123, 0.05, 0.0877])
    q, c = path.predicted({"delta": deltas})
    for delta, place, rate in zip(deltas.tolist(), q, c[:, 0], strict=True):
        v, r = turn(delta, 12.0)
        assert np.allclose([*place[:2], rate], [v / r, -12.0 / r, r], rtol=1e-9)
    axes = np.linspace(0.02, 0.1, 4), np.linspace(5.0, 15.0, 4)
    assert isinstance(follow_all(model, ("delta", "u"), *axes), Surface)


def test_from_a_start_that_is_far_points_take_their_own_derivatives():
    model = mbstab.load("rotating_pendulum.yaml").model
    path, values = follow(model, "Omega", 7.0, 12.0), {"Omega": np.linspace(7.0, 12.0, 100)}
    expected = Evaluator(model, path).spectra(values)
    # The first coefficients only: the prediction is wrong by centimetres.
    rough = Surface(path.surface.ranges, path.surface.coefficients[:4], path.surface.n_q)
    found = Evaluator(model, rough).spectra(values)
    assert np.array_equal(found.words, expected.words)
    assert max(optimal(a, b) for a, b in zip(found.values, expected.values, strict=True)) < 1e-12


def test_the_pattern_of_a_sweep_in_blocks_is_worked_out_once(monkeypatch):
    asked = []
    original = Evaluator.patterns_at
    monkeypatch.setattr(Evaluator, "patterns_at", lambda self, at: asked.append(at) or original(self, at))
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points", 40)
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.block_points_least", 40)
    x = np.linspace(5.5, 19.5, 200)
    result = mbstab.load("rotating_pendulum.yaml").sweep("Omega", x)
    assert asked == [{"Omega": x[int(0.37 * 200)]}]
    assert result.problems == {}


DISKS = """mbstab: 1
gravity: [0, 0]
parameters: {{h: 1}}
bodies:
  a: {{type: planar, mass: 1, inertia: {J[0]!r}}}
  b: {{type: planar, mass: 1, inertia: {J[1]!r}}}
joints: {{first: {{type: revolute, between: [a, ground]}}, second: {{type: revolute, between: [b, ground]}}}}
forces:
  shaft:
    type: expression
    on: {{a.theta: "{k!r}*(b.theta - a.theta)", b.theta: "{k!r}*(a.theta - b.theta)"}}
  u: {{type: pid, joint: first, of: angle(first), target: {t[0]!r}, P: {P[0]!r}*h, {I[0]} D: {D[0]!r}*h, filter: {F!r}, lag: {T!r}}}
  v: {{type: pid, joint: second, of: angle(second), target: {t[1]!r}, P: {P[1]!r}*h, {I[1]} D: {D[1]!r}*h, filter: {F!r}, lag: {T!r}}}
reference: {{find: equilibrium}}
"""  # noqa: E501


def controlled_disks(seed):
    """Return two disks on a shaft, each with a controller, and a function that returns their matrix at a gain h."""
    rng = np.random.default_rng(seed)
    J, P, D = rng.uniform(0.2, 2.0, 2), rng.uniform(500.0, 3000.0, 2), rng.uniform(20.0, 120.0, 2)
    k, F, T = rng.uniform(100.0, 2000.0), rng.uniform(1e-3, 5e-3), rng.uniform(1e-3, 5e-3)
    gains = rng.uniform(300.0, 6000.0, 2) * (seed % 3 > 0)
    targets = rng.uniform(-2.0, 2.0, 2) * ([0, 1] if seed % 2 else [1, 1])
    integral = [f"I: {float(x)!r}*h," if x else "" for x in gains]
    numbers = {key: [float(x) for x in value] for key, value in {"J": J, "P": P, "D": D, "t": targets}.items()}
    text = DISKS.format(k=float(k), F=float(F), T=float(T), I=integral, **numbers)

    def matrix(h):
        # Of each disk: angle, speed, filtered angle, torque, integral of the angle.
        A = np.zeros((10, 10))
        for i, at in enumerate((0, 5)):
            other = 5 - at
            A[at, at + 1] = A[at + 4, at] = 1.0
            A[at + 1, [at, other, at + 3]] = [-k / J[i], k / J[i], 1.0 / J[i]]
            A[at + 2, [at, at + 2]] = [1.0 / F, -1.0 / F]
            A[at + 3, [at, at + 2]] = h * np.array([-P[i] - D[i] / F, D[i] / F]) / T
            A[at + 3, [at + 3, at + 4]] = [-1.0 / T, -h * gains[i] / T]
        kept = [n for n in range(10) if n not in (4, 9) or np.any(gains)]
        return A[np.ix_(kept, kept)]

    return mbstab.loads(text).model, matrix


@pytest.mark.parametrize("seed", sample(range(12), 5))
def test_rounding_of_states_that_come_to_rest_makes_no_point_a_case_of_its_own(seed):
    # Fast filters and lags make of the last bit of an angle a rate that is far from zero.
    model, matrix = controlled_disks(seed)
    path, h = follow(model, "h", 0.3, 3.0), np.linspace(0.3, 3.0, 40)
    evaluator = Evaluator(model, path, patterns_at(model, path, home_of({"h": h})))
    found = evaluator.near({"h": h}, len(matrix(1.0)), exact=True)
    assert evaluator.alone == 0
    for i in range(0, len(h), 7):
        A = matrix(float(h[i]))
        exact = np.linalg.eigvals(A)
        assert optimal(found.values[i], exact) <= 1e-10 * np.max(np.abs(exact))
        assert (WORDS[found.words[i]] == "asymptotically stable") == (np.max(exact.real) < 0.0)


@pytest.mark.parametrize("seed", sample(range(12), 5))
def test_branches_that_move_together_are_followed_without_a_search(seed):
    # Two damped masses on slow springs: the slow eigenvalues, about −k/d, are nearly equal and never meet.
    rng = np.random.default_rng(seed)
    d, near = rng.uniform(5.0, 20.0), 1.0 + rng.uniform(5e-4, 5e-3)
    # The heavier mass with the weaker damper: both make it the faster of the two.
    masses, dampings = -np.sort(-rng.uniform(0.01, 0.03, 2)), (float(d), float(d * near))
    forces = [f'{x}.x: "-k*{x}.x - {c!r}*rate({x}.x)"' for x, c in zip("ab", dampings, strict=True)]
    bodies = [f"{x}: {{type: planar_point, mass: {float(m)!r}}}" for x, m in zip("ab", masses, strict=True)]
    text = (
        f"mbstab: 1\nparameters: {{k: 10}}\nbodies: {{{', '.join(bodies)}}}\n"
        "constraints: {first: {holonomic: a.y}, second: {holonomic: b.y}}\n"
        f"forces: {{f: {{type: expression, on: {{{', '.join(forces)}}}}}}}\n"
    )
    k = np.linspace(10.0, 60.0, 5)
    found = mbstab.loads(text).sweep("k", k)
    assert found.warnings == ()
    assert found.meetings == ()
    slow = np.array([[max(np.roots([m, c, x]).real) for m, c in zip(masses, dampings, strict=True)] for x in k])
    columns = np.argsort(-found.branches[0].real)[:2]
    order = np.argsort(-slow[0])
    assert np.max(np.abs(found.branches[:, columns] - slow[:, order])) <= 1e-11 * np.max(np.abs(found.branches))


def test_the_warning_of_a_search_that_ends_says_whether_stability_may_change_there(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.sweep.tolerances.Tolerances.branch_parts_crowded", 0)
    text = (
        "mbstab: 1\nparameters: {k: 10}\nbodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}\n"
        "constraints: {first: {holonomic: a.y}, second: {holonomic: b.y}}\nforces:\n  f:\n    type: expression\n"
        '    on: {a.x: "-a.x - DRAG*rate(a.x)", b.x: "-(k/10)*b.x - DRAG*rate(b.x)"}\n'
    )
    k = np.linspace(9.5, 10.6, 2)
    far, near = (mbstab.loads(text.replace("DRAG", drag)).sweep("k", k).warnings for drag in ("1.0", "1e-9"))
    assert "no change of stability (they are far from the imaginary axis)" in " ".join(far)
    assert "critical values may be missing" in " ".join(near)
