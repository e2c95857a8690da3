"""First-order states: filters, lags, integrals and currents, against closed forms and other formulations."""

import json
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from mpmath import mp
from sampling import sample
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.verdict.facts import Grounds
from mbstab.cli import main
from mbstab.compiler.system import System
from mbstab.errors import EquilibriumError, MbstabError, ModelFileError
from mbstab.model.library import installed_models
from mbstab.model.units import parse_unit
from mbstab.model.values import evaluate
from mbstab.model.words import ASYMPTOTIC_UP_TO, STABLE_UP_TO, UNDECIDED, UNSTABLE

LINE = """\
mbstab: 1
parameters: {{{parameters}}}
bodies:
  b: {{type: planar_point, mass: m}}
constraints:
  line: {{holonomic: b.y}}
states:
  {states}
forces:
  all: {{type: expression, on: {{b.x: {force}}}}}
{rest}
"""


def on_a_line(parameters, states, force, rest=""):
    """Return a mass on a line with states."""
    return mbstab.loads(LINE.format(parameters=parameters, states=states, force=force, rest=rest))


def turning(parameters, states, torque, rest=""):
    """Return a disk on a fixed axle with states."""
    return mbstab.loads(
        f"mbstab: 1\nparameters: {{{parameters}}}\nbodies: {{b: {{type: planar, mass: 1, inertia: J}}}}\n"
        f"joints: {{axle: {{type: revolute, between: [b, ground]}}}}\nstates:\n  {states}\n"
        f"forces: {{all: {{type: expression, on: {{b.theta: {torque}}}}}}}\n{rest}"
    )


def close(found, expected, part):
    """Whether two sets of eigenvalues are equal, each relative to its own size."""
    found, expected = np.asarray(found, dtype=complex), np.asarray(expected, dtype=complex)
    assert len(found) == len(expected)
    cost = np.abs(found[:, None] - expected)
    rows, columns = linear_sum_assignment(cost)
    return bool(np.all(cost[rows, columns] <= part * np.abs(expected[columns])))


def pairs(*values):
    """Return numbers with the conjugates of those that are complex."""
    return [x for s in values for x in ((s, np.conj(s)) if isinstance(s, complex) else (s,))]


ZENER = "F: {rate: km*rate(b.x) - km/c*F}", "-k*b.x - F"
LAGGED = """\
mbstab: 1
parameters: {T: 0.05}
gravity: [0, -9.81]
bodies:
  cart: {type: planar_point, mass: 0.5}
  rod: {type: planar, mass: 0.2, inertia: 0.006}
joints: {pivot: {type: revolute, between: [cart, {body: rod, point: [0, -0.3]}]}}
constraints: {rail: {holonomic: cart.y}}
states:
  F: {rate: (-40*rod.theta + 20*sum - 8*rate(rod.theta) - F)/T}
  sum: {rate: -rod.theta}
forces: {motor: {type: expression, on: {cart.x: F - 0.1*rate(cart.x)}}}
reference: {coordinates: {cart: {x: 0, y: 0}, rod: {x: 0, y: 0.3, theta: 0}}}
"""


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((1, 100, 400, 10), pairs(-6.52189615220069 + 10.28852254136692j, -26.95620769559862)),
        ((2, 50, 200, 30), pairs(-1.41773500115668, -2.624465832754993 + 10.52000879048247j)),
    ],
)
def test_a_zener_element_adds_one_eigenvalue(values, expected):
    """m x'' + k x + F = 0, F' = k_m x' - (k_m/c) F."""
    mechanism = on_a_line("m: {}, k: {}, km: {}, c: {}".format(*values), *ZENER)
    found = mechanism.eig()
    assert found.counts.expected == 3
    assert found.verdict == "asymptotically stable"
    assert close(found.values(), expected, 1e-14)
    assert all(abs(e.value - min(expected, key=lambda x: abs(x - e.value))) <= e.error_bound for e in found.eigenvalues)


@pytest.mark.parametrize(
    ("T", "expected"),
    [
        (0.02, pairs(-0.683869916855054, -3.999842985286747, -22.74905263983819 + 32.59914507909302j)),
        (0.05, pairs(-0.68058468468294108, -4.074047905647982, -7.713592795743629 + 23.75021277225299j)),
        (0.1, pairs(-0.6752765168220667, -4.189941870254077, -2.658299897371019 + 17.27653212646016j)),
    ],
)
def test_a_cart_and_pendulum_with_control_and_a_lag_of_the_actuator(T, expected):
    """T F' = 40 θ + 20 ∫θ + 8 θ' − F; place and speed of the cart are neutral."""
    found = mbstab.loads(LAGGED).eig(T=T)
    assert close(found.values(), expected, 1e-12)
    assert (found.counts.expected, found.counts.neutral) == (6, 2)
    assert found.verdict == "asymptotically stable up to symmetry"


def test_the_critical_lag_is_found():
    swept = mbstab.loads(LAGGED).sweep("T", np.linspace(0.02, 0.4, 13))
    (critical,) = swept.critical
    assert critical.value == pytest.approx(0.20478619158233459, rel=1e-12)
    assert critical.frequency == pytest.approx(12.013237476893, rel=1e-11)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((0.01, 0.1, 0.01, 1, 0.5), [-2.00250078173866305, -9.99749921826133695]),
        ((3.2284e-6, 3.5077e-6, 0.0274, 4, 2.75e-6), [-59.2260384878323432, -1454487.3150204099]),
    ],
)
def test_a_motor_with_its_current(values, expected):
    """J ω' + b ω = K i, L i' + R i = V − K ω; the angle is neutral."""
    motor = turning("J: {}, d: {}, K: {}, R: {}, L: {}".format(*values), *MOTOR)
    found = motor.eig()
    assert close(found.values(), expected, 1e-11)
    assert all(np.min(np.abs(np.array(expected) - e.value)) <= e.error_bound for e in found.eigenvalues[:2])
    assert found.counts.neutral == 1
    precise = motor.eig_precise(20)
    assert close([complex(x) for x in precise.values()], expected, 1e-15)


MOTOR = "i: {rate: (-K*rate(b.theta) - R*i)/L}", "K*i - d*rate(b.theta)"


def test_a_motor_with_a_pendulum():
    motor = turning(
        "J: 0.01, d: 0.1, K: 0.01, R: 1, L: 0.5",
        MOTOR[0],
        "K*i - d*rate(b.theta) - 0.3*sin(b.theta)",
    )
    expected = pairs(-1.99715040970956369, -5.00142479514521816 + 2.24244394823927014j)
    assert close(motor.eig().values(), expected, 1e-13)
    # Half a turn away it falls over.
    assert motor.eig().verdict == "asymptotically stable"
    up = turning("J: 0.01, d: 0.1, K: 0.01, R: 1, L: 0.5", MOTOR[0], "K*i - d*rate(b.theta) + 0.3*sin(b.theta)")
    assert up.eig().verdict == "unstable"


def test_shimmy_with_relaxation_of_the_tyre():
    """I ψ'' + d ψ' + (e + t) C α' = 0, (σ/V) dα'/dt + α' = ψ + e ψ'/V: Hurwitz gives both critical speeds."""
    wheel = turning(
        "J: 0.25, d: 1.5, e: 0.08, trail: 0.02, C: 15000, sigma: 0.25, V: 10",
        "slip: {rate: (b.theta + e*rate(b.theta)/V - slip)*V/sigma}",
        "-d*rate(b.theta) - (e + trail)*C*slip",
    )
    expected = pairs(10.55332535975057 + 58.86445414291477j, -67.10665071950114)
    assert close(wheel.eig().values(), expected, 1e-13)
    expected = pairs(1.875780182693704 + 76.50940571085784j, -409.7515603653874)
    assert close(wheel.eig(V=100).values(), expected, 1e-13)
    swept = wheel.sweep("V", np.geomspace(0.3, 300.0, 21))
    assert [c.value for c in swept.critical] == pytest.approx([0.71520186173908039567, 167.7847981382609196], rel=1e-11)


def test_every_way_of_asking_gives_the_same():
    mechanism = mbstab.loads(LAGGED)
    expected = mechanism.eig().values()
    for method in ("index3", "paper"):
        assert close(mechanism.eig(method).values(), expected, 1e-9)
    swept = mechanism.sweep("T", np.array([0.04, 0.05, 0.06])).branches[1]
    assert close(swept[np.abs(swept) > 1e-6], expected, 1e-11)


def test_eigenvalues_with_states_are_proven():
    proven = on_a_line("m: 1, k: 100, km: 400, c: 10", *ZENER).certify()
    assert proven.verdict == "asymptotically stable"
    proven = on_a_line("m: 1, k: 100, km: 400, c: -10", *ZENER).certify()
    assert proven.verdict == "unstable"


def test_the_nonlinear_motion_confirms_the_eigenvalues():
    checked = on_a_line("m: 1, k: 100, km: 400, c: 10", *ZENER).verify()
    assert checked.verdict == "confirmed"


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "settings", [{}, {"method": "radau", "once": True}, {"method": "alpha", "tol": 1e-4}, {"compiled": True}]
)
def test_a_simulation_follows_the_exact_solution(settings):
    if settings.get("compiled"):
        pytest.importorskip("numba")
    mechanism = on_a_line("m: 1, k: 100, km: 400, c: 10", *ZENER)
    run = mechanism.simulate(to=0.3, points=4, perturb={"b.x": 0.1}, **settings)
    A = np.array([[0.0, 1.0, 0.0], [-100.0, 0.0, -1.0], [0.0, 400.0, -40.0]])
    for t, q, u in zip(run.times, run.q, run.u, strict=True):
        x, v, F = expm(A * t) @ [0.1, 0.0, 0.0]
        assert [q[0], u[0], q[2]] == pytest.approx([x, v, F], abs=20 * settings.get("tol", 1e-8))


def test_a_state_is_solved_for_with_an_equilibrium():
    """The force of an integral controller comes to rest where the error is zero: it carries the load."""
    text = "x: {rate: 3*(0.2 - b.x)}"
    rest = "reference: {find: equilibrium, guess: {b: {x: 0.1}}}"
    mechanism = on_a_line("m: 1", text, "x - 7 - 5*b.x - 2*rate(b.x)", rest)
    (found,) = mechanism.equilibria()
    assert found.motion.q == pytest.approx([0.2, 0.0, 8.0], abs=1e-12)
    expected = np.roots([1.0, 2.0, 5.0, 3.0])
    assert close(mechanism.eig().values(), expected, 1e-13)
    assert close([complex(x) for x in mechanism.eig_precise(25).values()], expected, 1e-14)


def test_a_state_in_a_turning_frame():
    """r'' - r θ'^2 = -k z, (r^2 θ')' = 0, T z' = r - z, for a circle with the rate ω."""
    k, T, r = 4.0, 0.3, 1.5
    mechanism = mbstab.loads(
        f"mbstab: 1\nparameters: {{k: {k}, T: {T}, r: {r}}}\nbodies: {{b: {{type: planar_point, mass: 1}}}}\n"
        "states: {z: {rate: (sqrt(b.x**2 + b.y**2) - z)/T}}\n"
        "forces: {pull: {type: expression, on: {b.x: -k*z*b.x/sqrt(b.x**2 + b.y**2), "
        "b.y: -k*z*b.y/sqrt(b.x**2 + b.y**2)}}}\n"
        "reference: {steady: {axis: z, rate: sqrt(k)}, coordinates: {b: {x: r, y: 0}, z: r}}"
    )
    # With h = r^2 θ' held: ρ'' + 3 ω^2 ρ = -k ζ, T ζ' = ρ - ζ.
    expected = np.linalg.eigvals([[0.0, 1.0, 0.0], [-3.0 * k, 0.0, -k], [1.0 / T, 0.0, -1.0 / T]])
    found = mechanism.eig()
    assert found.counts.expected == 5
    assert close(found.values()[np.abs(found.values()) > 1e-6], expected, 1e-12)
    assert found.verdict == "unstable"


def test_multipliers_of_a_periodic_motion_with_a_state():
    """x'' + (1 + 0.4 cos 2t) x + z = 0, z' = x' - 0.5 z: the multipliers of a fundamental matrix."""
    mechanism = on_a_line(
        "m: 1",
        "z: {rate: rate(b.x) - 0.5*z}",
        "-(1 + 0.4*cos(2*t))*b.x - z",
        "reference: {period: pi, coordinates: {b: {x: 0, y: 0}}}",
    )

    def slope(t, y):
        x, v, z = y.reshape(3, 3)
        return np.concatenate([v, -(1.0 + 0.4 * np.cos(2.0 * t)) * x - z, v - 0.5 * z])

    end = solve_ivp(slope, (0.0, np.pi), np.eye(3).ravel(), method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    expected = np.linalg.eigvals(end.reshape(3, 3))
    found = mechanism.eig()
    assert close([e.multiplier for e in found.eigenvalues], expected, 1e-8)


def test_states_stand_last_and_are_given_under_their_names():
    mechanism = on_a_line("m: 1", "F: {rate: 3 - F}", "F - 3 - b.x", "reference: {coordinates: {b: {x: 0}, F: 3}}")
    motion = mechanism.motion()
    assert motion.q.tolist() == [0.0, 0.0, 3.0]
    assert motion.at_rest
    data = json.loads(CliRunner().invoke(main, ["eig", "-", "--format", "json"], input=str(SCENE)).output)
    assert [x["name"] for x in data["coordinates"]] == ["b.x", "b.y", "F"]
    assert data["coordinates"][2]["unit"] == "1"


SCENE = LINE.format(parameters="m: 1", states="F: {rate: -F}", force="F - b.x", rest="")


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ("m: {rate: 1}", "the name 'm' is taken"),
        ("t: {rate: 1}", "the name 't' is taken"),
        ("sin: {rate: 1}", "the name 'sin' is taken"),
        ("b: {rate: 1}", "the name 'b' is taken"),
        ("F: {}", "the key 'rate' is missing"),
        ("F: {rate: 1, type: state}", "unknown key 'type'"),
        ("F: 3", "expected {rate: expression}"),
        ("F: {rate: 2*rate(F) + 1}", "the rate of 'F' depends on itself"),
        ("F: {rate: G}", "unknown parameter 'G'"),
        ("F: {rate: -F}\n  G: {rate: rate(H)}", "unknown coordinate 'H'"),
    ],
)
def test_bad_states_are_refused_where_they_stand(states, message):
    with pytest.raises(ModelFileError) as caught:
        on_a_line("m: 1", states, "-b.x")
    assert message in str(caught.value)
    assert re.search("<text>:[789]:[0-9]+: states", str(caught.value))


def test_states_cannot_stand_where_only_the_time_may():
    text = SCENE + "drives: {d: {type: coordinate, coordinate: b.x, position: F}}"
    with pytest.raises(ModelFileError, match="states such as 'F' cannot be used here"):
        mbstab.loads(text)


LINK = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {T: 0.05, P: 50, D: 10}
bodies: {rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [-0.5, 0]}}}
joints: {pin: {type: revolute, between: [rod.O, ground]}}
states: {M: {rate: (-P*angle(pin) - D*rate(angle(pin)) - M)/T}}
forces: {motor: {type: expression, on: {angle(pin): M}}}
"""


@pytest.mark.parametrize("perturbed", [False, True])
def test_states_follow_the_bodies_where_a_simulation_starts(perturbed):
    """A changed angle leaves the rod at rest: the rate of the state follows, it does not push the rod."""
    text = LINK + "reference: {coordinates: {rod: {theta: 0}, M: 4.905}}\n"
    if not perturbed:
        text += "initial: {coordinates: {rod: {theta: 0.1}}}\n"
    run = mbstab.loads(text).simulate(to=0.1, points=3, perturb={"rod.theta": 0.1} if perturbed else None)
    assert run.u[0][2] == pytest.approx(0.0, abs=1e-12)

    def slope(t, y):
        theta, w, M = y
        return [w, (M - 9.81 * 0.5 * np.cos(theta)) / (0.1 + 0.25), (-50.0 * theta - 10.0 * w - M) / 0.05]

    exact = solve_ivp(slope, (0.0, 0.1), [0.1, 0.0, 4.905], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert [run.q[-1][2], run.u[-1][2], run.q[-1][3]] == pytest.approx(exact.tolist(), abs=1e-6)


def test_an_equilibrium_with_a_fast_state_is_found():
    found = mbstab.loads(LINK + "reference: {find: equilibrium, guess: {rod: {x: 0.5, theta: 0}}}\n").eig()
    motion = mbstab.loads(LINK + "reference: {find: equilibrium, guess: {rod: {x: 0.5, theta: 0}}}\n").motion()
    theta, M = motion.q[2], motion.q[3]
    assert pytest.approx(-50.0 * theta, rel=1e-12) == M
    assert pytest.approx(9.81 * 0.5 * np.cos(theta), rel=1e-12) == M
    stiffness = -9.81 * 0.5 * np.sin(theta)
    expected = np.roots(np.polyadd(np.polymul([0.35, 0.0, stiffness], [0.05, 1.0]), [10.0, 50.0]))
    assert close(found.values(), expected, 1e-12)


def test_rates_that_are_left_out_are_those_of_bodies_at_rest():
    """Off balance the state moves, and the rod does not for now."""
    motion = mbstab.loads(LINK + "reference: {coordinates: {rod: {theta: 0.1}, M: 4.905}}\n").motion()
    assert motion.u.tolist() == pytest.approx([0.0, 0.0, 0.0, (-5.0 - 4.905) / 0.05])


def test_states_are_plotted_by_their_names(tmp_path):
    file = tmp_path / "link.yaml"
    file.write_text(LINK + "reference: {coordinates: {rod: {theta: 0}, M: 4.905}}\n", encoding="utf-8")
    arguments = ["simulate", str(file), "--to", "0.1", "--plot", "M", "--pictures", str(tmp_path / "x")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert list(tmp_path.glob("x*.png"))


def test_growth_along_a_symmetry_is_not_denied_where_it_is_of_second_order():
    """z1' = z2^2 with z2 constant: z1 leaves, although no eigenvalue says so."""
    found = on_a_line("m: 1", "z1: {rate: z2**2}\n  z2: {rate: 0}", "-b.x - rate(b.x)").eig()
    assert found.verdict == "asymptotically stable up to symmetry"
    assert found.in_place is None
    assert "may drift at most like t" in found.judged.reasons[0]


def test_badly_conditioned_rates_of_states_stay_within_the_bounds():
    """The rows of the rates have the condition number 1e6; the expected values have 50 digits."""
    mechanism = on_a_line(
        "m: 1",
        "z0: {rate: b.x + 2e6*rate(b.x) + 5*z1 + 2e7*z2}\n"
        "  z1: {rate: 0.02*b.x + 1e-8*z0 - 300*z1 - 0.5*rate(z0)}\n"
        "  z2: {rate: -1e-6*b.x + 0.002*rate(b.x) + 5e3*z0 + 1e8*z1 + rate(z0)}",
        "-0.01*b.x + 1e9*z0 - 0.003*z2 + rate(z2)",
    )
    expected = pairs(
        42954930.38716767972, -20954566.21256233559, -746.4193950132463431, 39.8733948345565978 + 240.7216186960688838j
    )
    for e in mechanism.eig().eigenvalues:
        assert min(abs(e.value - s) for s in expected) <= e.error_bound


RANDOM = range(250)


def chained_states(rng):
    """Return a point on a line with one to four states whose rates depend on each other's, and its eigenvalues.

    Coefficients have one digit and sizes from 1e-8 to 1e8, so that the rows of the rates are badly conditioned.
    The eigenvalues are those of E ẋ = A x, x = (position, speed, states), in 60 digits.
    """
    count = int(rng.integers(1, 5))
    size = 2 + count
    exponent = int(rng.choice([2, 5, 8]))

    def coefficient():
        if rng.random() < 0.35:
            return "0"
        return f"{rng.choice([-1, 1]) * rng.integers(1, 10)}e{rng.integers(-exponent, exponent + 1)}"

    with mp.workdps(60):
        E, A = mp.eye(size), mp.zeros(size)
        A[0, 1] = 1
        texts = []
        for row in (*range(2, size), 1):
            own = [coefficient() for _ in range(size)]
            # Rates of states that stand before it, so that the rows can be solved.
            rates = {j: coefficient() for j in range(2, size if row == 1 else row)}
            for j, x in enumerate(own):
                A[row, j] = mp.mpf(x)
            for j, x in rates.items():
                E[row, j] = -mp.mpf(x)
            names = ["b.x", "rate(b.x)", *(f"z{k}" for k in range(count))]
            terms = [f"{x}*{name}" for x, name in zip(own, names, strict=True)]
            texts.append(" + ".join(terms + [f"{x}*rate(z{j - 2})" for j, x in rates.items()]))
        eigenvalues = mp.eig(E**-1 * A, left=False, right=False)
        # Roundings of 60 digits stand for zeros.
        rounding = mp.mpf(10) ** -50 * max(abs(x) for x in eigenvalues)
    states = "\n  ".join(f"z{k}: {{rate: '{text}'}}" for k, text in enumerate(texts[:-1]))
    return on_a_line("m: 1", states, texts[-1]), [complex(x) if abs(x) > rounding else 0j for x in eigenvalues]


@pytest.mark.parametrize("seed", sample(RANDOM, 25))
def test_bounds_hold_for_states_whose_rates_depend_on_each_other(seed):
    mechanism, expected = chained_states(np.random.default_rng(seed))
    try:
        found = mechanism.eig()
    except MbstabError:
        pytest.skip("beyond double precision")
    assert len(found.eigenvalues) == len(expected)
    values, true = np.array([e.value for e in found.eigenvalues]), np.array(expected)
    size = np.abs(values)[:, None] + np.abs(true) + 1e-300
    for i, k in zip(*linear_sum_assignment(np.abs(values[:, None] - true) / size), strict=True):
        bound = found.eigenvalues[i].error_bound
        if bound is not None and np.isfinite(bound):
            assert abs(values[i] - true[k]) <= 3.0 * bound + 2e-16 * abs(true[k])


def test_a_joint_shift_with_a_small_part_is_exact():
    """With s = rate of the state, s = 4e5 x − 5e8 ẋ + 0.8 z and ẍ = −2e-6 s: λ² − 1000.8 λ + 0.8 = 0, and a zero."""
    mechanism = on_a_line("m: 1", "z0: {rate: 4e5*b.x - 5e8*rate(b.x) + 0.8*z0}", "-2e-6*rate(z0)")
    large, small, zero = sorted(mechanism.eig().eigenvalues, key=lambda e: -abs(e.value))
    assert zero.kind == "neutral"
    # 50 digits.
    assert abs(large.value - 1000.7992006388499417977) <= large.error_bound
    assert abs(small.value - 0.00079936115005820206) <= small.error_bound


COIL = """\
mbstab: 1
parameters:
  R: {{value: 1, unit: ohm}}
  L: {{value: 0.5, unit: H}}
  U: {{value: 2, unit: V}}
  K: {{value: 0.01, unit: N*m/A}}
  m: {{value: 1, unit: kg}}
bodies: {{b: {{type: planar, mass: m, inertia: 0.01}}}}
joints: {{axle: {{type: revolute, between: [b, ground]}}}}
states: {{i: {{{state}}}}}
forces: {{all: {{type: expression, on: {{angle(axle): {torque}}}}}}}
reference: {{coordinates: {{b: {{x: 0, y: 0}}, i: {given}}}}}
"""


def test_states_have_units():
    text = COIL.format(state="rate: (U - R*i)/L, unit: A", torque="K*(i - U/R)", given="U/R")
    assert close(mbstab.loads(text).eig().values(), [-2.0], 1e-14)


@pytest.mark.parametrize(
    ("state", "torque", "given", "message"),
    [
        ("rate: (U - R*i), unit: A", "K*i", "2", "'U - R*i' has the unit V, expected A/s"),
        ("rate: (U - i)/L, unit: A", "K*i", "2", "V and A cannot be added or compared"),
        ("rate: (U - R*i)/L, unit: A", "K*i + m", "2", "N*m and kg cannot be added or compared"),
        ("rate: (U - R*i)/L, unit: A", "K*i", "U", "'U' has the unit V, expected A"),
        ("rate: (U - R*i)/L, unit: mA", "K*i", "2", "a state cannot have the unit mA"),
        ("rate: (U - R*i)/L, unit: Amp", "K*i", "2", "unknown unit 'Amp'"),
    ],
)
def test_units_of_states_are_checked(state, torque, given, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(COIL.format(state=state, torque=torque, given=given))
    assert message.replace("(", "").replace(")", "") in str(caught.value).replace("(", "").replace(")", "")


def test_an_actuator_may_push_with_a_state():
    """The same as an expression along the motion of the joint, and lags and drives by a constraint."""
    pushed = LINK.replace("{type: expression, on: {angle(pin): M}}", "{type: actuator, joint: pin, effort: 2*M - M}")
    reference = "reference: {find: equilibrium, guess: {rod: {x: 0.5, theta: 0}}}\n"
    found = mbstab.loads(pushed + reference).eig().values()
    assert close(found, mbstab.loads(LINK + reference).eig().values(), 1e-13)
    with pytest.raises(ModelFileError, match="unknown parameter 'N'"):
        mbstab.loads(pushed.replace("2*M - M", "2*M - N") + reference)


def test_a_motion_that_follows_a_state():
    """θ = z with z' = -3 z: the only eigenvalue; the torque is a reaction."""
    text = turning("J: 0.3", "z: {rate: -3*z}", "-rate(b.theta)", "constraints: {d: {holonomic: angle(axle) - z}}")
    assert close(text.eig().values(), [-3.0], 1e-14)


LAGGING = """
mbstab: 1
parameters: {T: 0.02}
gravity: [0, -9.81]
bodies:
  pole: {type: planar, mass: 0.4, shape: {type: rod, length: 1.2}, points: {O: [-0.6, 0]}}
joints: {pin: {type: revolute, between: [pole.O, ground]}}
forces:
  ctl: {type: state_feedback, joint: pin, gains: {"angle(pin) - pi/2": 30, rate(angle(pin)): 5}, lag: T}
reference: {coordinates: {pole: {theta: pi/2}}}
"""


def test_the_energy_of_a_simulation_is_compared_with_that_of_bodies_however_fast_states_are():
    found = mbstab.loads(LAGGING).simulate(0.3, T=1e-4, perturb={"pole.theta": 0.1}, method="radau", tol=1e-3)
    exchanged = max(np.max(found.kinetic), np.ptp(found.potential), np.max(np.abs(found.work)))
    assert exchanged <= found.energy_scale <= 1.1 * exchanged


@pytest.mark.long
def test_a_run_that_ends_at_its_start_is_not_said_to_rest():
    answer = CliRunner().invoke(
        main, ["simulate", "-", "--perturb", "pole.theta=0.1", "--to", "1", "--set", "T=1e-12"], input=LAGGING
    )
    assert answer.exit_code == 1
    assert "ended early" in answer.stdout
    assert "nothing moves" not in answer.stdout


def test_rates_of_states_are_told_per_second_of_their_unit():
    text = LAGGING.replace("theta: pi/2}}", "theta: 1.57}}")
    reasons = " ".join(mbstab.loads(text).eig().reasons)
    assert "find: equilibrium" in reasons
    assert "ctl_effort" not in reasons or "rad/s" not in reasons.split("ctl_effort")[1][:40]


SCALES = ("car_relaxation", "cart_pendulum", "dc_motor_arm", "robot_arm", "shimmy_relaxation", "zener")


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("name", SCALES)
def test_units_of_mass_length_time_and_current_change_no_answer(name, number):
    """A state is a force of 1e-12 N, a current of 1e6 A or an integral over years: only ratios decide."""
    model, rng = (
        mbstab.load(next(x for x in installed_models() if x.stem == name)),
        np.random.default_rng([number, SCALES.index(name)]),
    )
    units = 10.0 ** rng.integers(-6, 7, 4)
    scene, scaled = model.system().scene.parameters, {}
    for key, parameter in model.model.parameters.items():
        factor, dimension = parse_unit(parameter.unit) if parameter.unit else (1.0, (0, 0, 0, 0))
        scaled[key] = (
            float(scene[key]) / factor * math.prod(float(x) ** float(e) for x, e in zip(units, dimension, strict=True))
        )
    before, after = model.eig(), model.eig(**scaled)
    assert (after.verdict, after.counts) == (before.verdict, before.counts)
    values, others = (np.array([e.value for e in x.eigenvalues if e.kind != "neutral"]) for x in (before, after))
    assert np.all(matched(units[2] * others, values) <= 1e-11 * np.max(np.abs(values)))


@pytest.mark.parametrize("gain", ["1e-8", "1", "1e8"])
@pytest.mark.parametrize("mass", ["1e-9", "1", "1e9"])
def test_integrals_of_any_size_are_found(gain, mass):
    """The mass rests at 0.1 m, where the integral has taken over the load of 1 N per kg: up to 1e8 m s."""
    found = on_a_line(
        f"m: {mass}, i: {gain}",
        "z: {rate: b.x - 0.1}",
        "m*(1 - 9*b.x - 2*rate(b.x) - i*z)",
        "reference: {find: equilibrium, guess: {b: {x: 0}}}",
    ).eig()
    with mp.workdps(30):
        roots = mp.polyroots([1, 2, 9, mp.mpf(gain)], maxsteps=200, extraprec=200)
    expected = np.array([complex(x) for x in roots])
    distance = matched(np.array([e.value for e in found.eigenvalues]), expected)
    assert np.all(distance <= 1e-13 * np.max(np.abs(expected)))


@pytest.mark.parametrize(
    ("k", "verdict"),
    [
        ("-1e-10", "unstable"),
        ("-1e-14", "unstable"),
        ("1e-10", "asymptotically stable"),
        ("0", "asymptotically stable up to symmetry"),
    ],
)
@pytest.mark.parametrize("where", ["rate", "rate(b.x)"])
def test_a_weak_part_of_a_strong_rate_is_no_symmetry(k, verdict, where):
    """s²(s + 20) + 1000 s + k = 0 with k on the place, the speed beside 1000 or both at rest."""
    weak = f"{k}*b.x" if where == "rate" else f"{k}*rate(b.x)"
    found = on_a_line(
        "m: 1", f"z: {{rate: -20*z - 1000*{'rate(b.x)' if where == 'rate' else 'b.x'} - {weak}}}", "z"
    ).eig()
    with mp.workdps(40):
        last = [1000, mp.mpf(k)] if where == "rate" else [mp.mpf(k), 1000]
        roots = [complex(x) for x in mp.polyroots([1, 20, *last], maxsteps=200, extraprec=300)]
    for e in found.eigenvalues:
        if e.kind != "neutral":
            assert min(abs(e.value - x) for x in roots) <= 1.1 * e.error_bound + 1e-15 * abs(e.value)
    if where == "rate":
        assert found.verdict == verdict


# --- states that only watch a scene keep its verdict, its family of motions and its drift -----------------------------


SHAFTS = """
mbstab: 1
title: Two free shafts with a coupling
parameters: {{J: 1.5, k: 7, e: 0.2}}
bodies:
  rotor: {{type: planar, mass: 1, inertia: J}}
  arm: {{type: planar, mass: 1, inertia: 0.4}}
joints:
  a1: {{type: revolute, between: [rotor, ground]}}
  a2: {{type: revolute, between: [arm, ground]}}
states: {{{states}}}
forces:
  flex: {{type: expression, on: {{angle(a1): -{force}{drag}, angle(a2): {force}}}}}
reference:
  coordinates: {{rotor: {{theta: 0}}, arm: {{theta: 0}}}}
"""
DAMPED = "k*(angle(a1) - angle(a2)) + e*(rate(angle(a1)) - rate(angle(a2)))"
UNDAMPED = "k*(angle(a1) - angle(a2))"
LAG = "u: {rate: (-5*angle(a1) - u)/0.1}"
RATES = "u: {rate: (-5*angle(a1) - 3*rate(angle(a1)) - u)/0.1}"
CASCADE = "u: {rate: (-5*angle(a1) - 3*rate(angle(a2)) - u)/0.1}, w: {rate: 3*u - w + angle(a2)}"
PAIR = "u: {rate: 4*w - u}, w: {rate: angle(a2) - u - w}"
CUBIC = "u: {rate: -(u - angle(a1)) - (u - angle(a1))**3}"
GROWING = "u: {rate: angle(a1) + 2*u}"
SINE = "u: {rate: sin(angle(a1)) - u}"


def shafts(states, force=DAMPED, drag=""):
    return mbstab.loads(SHAFTS.format(states=states, force=f"({force})", drag=drag))


@pytest.mark.few(3)
@pytest.mark.parametrize("states", ["", LAG, RATES, CASCADE, PAIR, CUBIC])
@pytest.mark.parametrize(("force", "word"), [(DAMPED, ASYMPTOTIC_UP_TO), (UNDAMPED, STABLE_UP_TO)])
def test_the_drift_of_a_free_shaft_is_told_whatever_watches_it(states, force, word):
    mechanism = shafts(states, force)
    found = mechanism.eig()
    assert found.verdict == word
    assert found.counts.neutral == 2
    assert "only this offset drifts like t" in found.reasons[0]
    swept = mechanism.sweep("J", [1.0, 1.5, 2.0])
    assert swept.verdicts == [word] * 3
    assert swept.neutral == 2


@pytest.mark.parametrize("states", [RATES, CASCADE])
def test_a_shaft_with_a_drag_has_no_speed_of_its_own(states):
    found = shafts(states, drag=" - e*rate(angle(a1))").eig()
    assert (found.verdict, found.counts.neutral) == (ASYMPTOTIC_UP_TO, 1)
    assert "growing" not in found.reasons[0]


@pytest.mark.parametrize(
    ("states", "drag", "word", "neutral"),
    [
        (GROWING, "", UNSTABLE, 2),
        (RATES, " - e*rate(angle(a1))**3", STABLE_UP_TO, 1),  # every speed decays, though not exponentially
        (SINE, "", UNDECIDED, 1),  # turned by half a turn, the state falls where it rose
    ],
)
def test_what_does_not_go_on_as_before_is_no_family(states, drag, word, neutral):
    found = shafts(states, drag=drag).eig()
    assert (found.verdict, found.counts.neutral) == (word, neutral)


@pytest.mark.parametrize("states", [LAG, RATES])
def test_a_single_free_shaft_turns_at_any_speed(states):
    alone = mbstab.loads(
        "mbstab: 1\nbodies: {rotor: {type: planar, mass: 1, inertia: 1.5}}\n"
        f"joints: {{a1: {{type: revolute, between: [rotor, ground]}}}}\nstates: {{{states}}}\n"
        "reference: {coordinates: {rotor: {theta: 0}}}\n"
    )
    found = alone.eig()
    assert (found.verdict, found.counts.neutral) == (ASYMPTOTIC_UP_TO, 2)
    assert [e.value for e in found.eigenvalues if e.value] == [pytest.approx(-10.0, rel=1e-12)]
    assert "only this offset drifts like t" in found.reasons[0]


ARM = """
mbstab: 1
title: Two links in the plane, the elbow held by a spring, the shoulder free
parameters: {{loop: {loop}}}
bodies:
  upper: {{type: planar, mass: 8, shape: {{type: rod, length: 0.4}}, points: {{a: [-0.2, 0], b: [0.2, 0]}}}}
  lower: {{type: planar, mass: 5, shape: {{type: rod, length: 0.3}}, points: {{a: [-0.15, 0]}}}}
joints:
  shoulder: {{type: revolute, between: [upper.a, ground]}}
  elbow: {{type: revolute, between: [lower.a, upper.b]}}
states:
  u: {{rate: (-15*angle(shoulder) - 10*rate(angle(shoulder)) - u)/0.005}}
forces:
  act: {{type: expression, on: {{angle(shoulder): loop*u}}}}
  hold: {{type: joint_spring, joint: elbow, stiffness: 400, damping: 20, rest: 1}}
reference:
  coordinates: {{upper: {{theta: 0}}, lower: {{theta: 1}}}}
"""


def test_an_open_loop_on_a_free_shoulder_leaves_its_turn_and_its_momentum():
    """Turned with the links, the state has another value; a factor zero takes it out of the force."""
    found = mbstab.loads(ARM.format(loop=0)).eig()
    assert (found.verdict, found.counts.neutral) == (ASYMPTOTIC_UP_TO, 2)
    assert set(found.modulo.names) == {"rotation in the plane", "speed of rotation in the plane"}
    assert "only this offset drifts like t" in found.reasons[0]
    assert any(e.value == pytest.approx(-200.0, rel=1e-12) for e in found.eigenvalues)
    closed = mbstab.loads(ARM.format(loop=1)).eig()
    assert closed.counts.neutral == 0


@pytest.mark.parametrize(("states", "expected"), [(RATES, [-10.0]), (CASCADE, [-10.0, -1.0])])
def test_disturbances_of_states_alone_stay_such(states, expected):
    """S F = F A with the eigenvalues of the states alone, although their rates contain those of bodies."""
    system = System(evaluate(shafts(states).model))
    grounds = Grounds(linearize(system, reference_motion(system)))
    F, S = grounds.at.followers(grounds.system.following), grounds.S
    A = np.linalg.lstsq(F, S @ F, rcond=None)[0]
    assert np.max(np.abs(S @ F - F @ A)) < 1e-12 * np.max(np.abs(S))
    assert np.sort(np.linalg.eigvals(A)) == pytest.approx(expected, rel=1e-12)


# --- states in constraints: the bodies they move, and what such motions are measured by -------------------------------


DRIVEN = """
mbstab: 1
title: A mass on a spring whose other end follows a lag, which feels the mass by next to nothing
parameters: {{K: {gain}}}
bodies: {{end: {{type: planar_point, mass: {light}}}, b: {{type: planar_point, mass: 2}}}}
constraints: {{e: {{holonomic: end.y}}, y: {{holonomic: b.y}}, follow: {{holonomic: end.x - {unit}*s}}}}
forces: {{spring: {{type: expression, on: {{b.x: -8*(b.x - end.x) - 0.4*rate(b.x), end.x: -8*(end.x - b.x)}}}}}}
states: {{s: {{rate: (K*b.x - s)/0.1}}}}
reference: {{coordinates: {{end: {{x: 0, y: 0}}, b: {{x: 0, y: 0}}, s: 0}}}}
"""


@pytest.mark.parametrize("light", [0, 1e-3])
@pytest.mark.parametrize("unit", [1, 1e-6, 1e6])
@pytest.mark.parametrize("gain", [0, 1e-18, 1e-15, 1e-12, 1e-6, -1e-3, 0.1])
def test_modes_of_a_state_that_drives_a_body_through_a_constraint(gain, unit, light):
    """Units of states are balanced by what they move, too: without feedback nothing else bounds them."""
    model = mbstab.loads(DRIVEN.format(gain=gain / unit, unit=unit, light=light))
    result = model.eig()
    found = [e.value for e in result.eigenvalues]
    true = np.roots([0.2, 2.04, 1.2, 8 - 8 * gain])
    distances = np.abs(np.subtract.outer(found, true)).min(axis=1)
    assert np.all(distances < 1e-13 * np.abs(found))
    # In balanced units the largest part of a mode is 1/√gain of the smallest.
    close_to = 1e-12 + (1e-14 / math.sqrt(abs(gain)) if gain else 0.0)
    for e in result.eigenvalues:
        motion = dict(zip(result.coordinates, e.vector, strict=True))
        if abs(e.value) > 5:  # the mode of the lag
            assert abs(motion["b.x"] / motion["end.x"] * (2 * e.value**2 + 0.4 * e.value + 8) / 8 - 1) < close_to
            assert abs(motion["s"] * unit / motion["end.x"] - 1) < 1e-12
        else:
            driven = gain / (0.1 * e.value + 1)
            assert abs(motion["end.x"] / motion["b.x"] - driven) < close_to * abs(driven) + (0 if gain else 1e-13)


@pytest.mark.parametrize(
    ("states", "row", "seen"),
    [
        ("s: {rate: (0.1*rate(b.x) - s)/0.1}", "holonomic: end.x - s", "rate(b.x)"),
        ("s: {rate: (v - s)/0.1}, v: {rate: 3*rate(b.x) - v}", "holonomic: end.x - s - v", "rate(b.x)"),
        ("s: {rate: 2*rate(v) - s}, v: {rate: 3*rate(b.x) - v}", "nonholonomic: rate(end.x) - rate(s)", "rate(v)"),
        ("s: {rate: (0.1*vx(b) - s)/0.1}", "holonomic: end.x - s", "vx(b)"),
    ],
)
def test_states_that_follow_speeds_cannot_hold_bodies(states, row, seen):
    """The row of the rate would pass the reaction on to what it follows: a lever, where a signal is meant."""
    text = DRIVEN.format(gain=0, light=1, unit=1).replace("holonomic: end.x - 1*s", row)
    text = text.replace("s: {rate: (K*b.x - s)/0.1}", states)
    with pytest.raises(
        ModelFileError, match=rf"contains {re.escape(seen)}: the reaction would act on what has this speed, too"
    ):
        mbstab.loads(text)


def test_a_state_may_hold_a_body_by_way_of_one_that_follows_a_speed():
    """A lag w of the speed, and s that follows w: 2 λ² + 0.4 λ + 8 = 8 · 0.3 λ/((0.1 λ + 1) (0.2 λ + 1))."""
    text = DRIVEN.format(gain=0, light=1, unit=1)
    text = text.replace("s: {rate: (K*b.x - s)/0.1}", "s: {rate: (w - s)/0.1}, w: {rate: (0.3*rate(b.x) - w)/0.2}")
    true = np.roots(np.polysub(np.polymul([2, 0.4, 8], np.polymul([0.1, 1], [0.2, 1])), [2.4, 0]))
    found = np.array(mbstab.loads(text).eig().values())
    assert len(found) == 4
    distances = np.abs(np.subtract.outer(found, true))[linear_sum_assignment(np.abs(np.subtract.outer(found, true)))]
    assert np.all(distances < 1e-13 * np.abs(true).min())


# --- the search for an equilibrium does not depend on how fast states follow, or in which unit ------------------------


HELD_ARM = """\
mbstab: 1
parameters: {T: 0.005, P: 300, I: 400, D: 20, Tf: 0.002}
gravity: [0, -9.81]
bodies: {arm: {type: planar, mass: 4, inertia: 0.1, points: {a: [-0.3, 0]}}}
joints: {axle: {type: revolute, between: [arm.a, ground]}}
forces:
  c: {type: pid, joint: axle, of: angle(axle), target: 0.5, P: P, D: D, filter: Tf, lag: TGIVEN}
reference: {find: equilibrium, guess: {arm: {theta: 0.4}}}
"""
INTEGRATING = mbstab.loads(HELD_ARM.replace("GIVEN", ", I: I"))
SAGGING = mbstab.loads(HELD_ARM.replace("GIVEN", ""))


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, 10.0**power) for name, powers in {
        "T": (-12, -9, -6, 0, 6), "Tf": (-9, -6, 3), "P": (-3, 5, 7, 9, 12), "I": (-9, -3, 6, 9), "D": (-6, 5, 8)
    }.items() for power in powers],
)  # fmt: skip
def test_an_integrating_controller_holds_its_target_whatever_its_time_constants_and_gains(name, value):
    motion = INTEGRATING.at(**{name: value}).motion()
    at = dict(zip(INTEGRATING.system().names, motion.q, strict=True))
    torque = 4 * 9.81 * 0.3 * math.cos(0.5)
    assert at["arm.theta"] == pytest.approx(0.5, rel=1e-12)
    assert at["c_effort"] == pytest.approx(torque, rel=1e-12)
    assert at["c_filtered"] == pytest.approx(0.5, rel=1e-12)
    # The differentiator makes a torque of the last digit of the angle, which the integral takes.
    gains = {"D": 20, "Tf": 0.002, name: value}
    last = np.spacing(0.5) * gains["D"] / gains["Tf"]
    assert at["c_integral"] * (value if name == "I" else 400) == pytest.approx(torque, rel=1e-9, abs=last)


def test_the_loop_of_an_arm_that_carries_weight_is_cut_as_the_manual_says():
    parameters = "hold: 4*9.81*0.3*cos(0.5), loop: 0, T"
    cut = "  cut: {type: expression, on: {angle(axle): -(1 - loop)*(c_effort - hold)}}\nreference"
    inputs = "inputs: {u: {type: joint, joint: axle}}\noutputs: {y: -c_effort}\nreference"
    text = HELD_ARM.replace("GIVEN", ", I: I").replace("{T", f"{{{parameters}", 1).replace("reference", cut, 1)
    model = mbstab.loads(text.replace("reference", inputs, 1))
    # Where the loop gain is -1, an eigenvalue of the closed loop is: 1 + L(s) = 0.
    opened = FrequencyResponse(model.state_space())
    for value in model.at(loop=1).eig().values():
        assert opened.value(complex(value))[0, 0] == pytest.approx(-1.0, rel=1e-6)


@pytest.mark.parametrize("P", [20.0, 1e3, 1e7, 1e12])
@pytest.mark.parametrize("T", [1e-9, 1e-3, 1e3])
def test_an_arm_sags_by_what_its_stiffness_allows(P, T):
    motion = SAGGING.at(P=P, T=T).motion()
    at = dict(zip(SAGGING.system().names, motion.q, strict=True))
    torque = 4 * 9.81 * 0.3 * math.cos(at["arm.theta"])
    assert at["c_effort"] == pytest.approx(torque, rel=1e-9)
    assert P * (0.5 - at["arm.theta"]) == pytest.approx(torque, rel=1e-9, abs=4e-16 * P)


def test_an_integral_with_a_gain_of_zero_is_named():
    with pytest.raises(EquilibriumError, match="the state c_integral acts on nothing") as caught:
        INTEGRATING.at(I=0).motion()
    assert "leave the gain out" in str(caught.value)
    # Without gravity the error is zero at rest, and so is the rate of the integral.
    assert mbstab.loads(HELD_ARM.replace("GIVEN", ", I: 0").replace("-9.81", "0")).motion().at_rest


def test_forces_out_of_balance_are_told_of_the_body_and_not_of_a_state_that_follows_it():
    text = (
        "mbstab: 1\nbodies: {cart: {type: planar_point, mass: 2}}\nconstraints: {rail: {holonomic: cart.y}}\n"
        "states: {u: {rate: (-40*rate(cart.x) - u)/0.001}}\nforces: {f: {type: expression, on: {cart.x: 5 + u}}}\n"
        "reference: {coordinates: {cart: {x: 0}}}\n"
    )
    with pytest.raises(ModelFileError, match=r"cart\.x would accelerate with 2\.5 m/s\^2 \(unbalanced 5 N\)"):
        mbstab.loads(text).eig()


# --- scenes that are states alone, or in which states stand beside a motion that does not decay -----------------------

HELD = "mbstab: 1\nparameters: {{p: 0}}\nbodies: {{b: {{type: planar, mass: 1, inertia: 1}}}}\n"
HELD += "joints: {{hold: {{type: fixed, between: [b, ground]}}}}\nstates: {{{states}}}\n"


@pytest.mark.parametrize("seed", range(6))
def test_a_centre_manifold_of_states_decides(seed):
    """On y = d z^2 + … the motion is z' = (c d + e) z^3, to the lowest power; where that vanishes, z is at rest."""
    rng = np.random.default_rng(seed)
    c, d = (int(x) for x in rng.choice([-3, -2, -1, 1, 2, 3], 2))
    for cubic, verdict in ((1, UNSTABLE), (-1, "asymptotically stable"), (0, ASYMPTOTIC_UP_TO)):
        states = f"z: {{rate: {c}*z*y + ({cubic - c * d})*z**3}}, y: {{rate: -y + ({d})*z**2}}"
        assert mbstab.loads(HELD.format(states=states)).eig().verdict == verdict, (c, d, cubic)


@pytest.mark.parametrize("seed", range(3))
def test_sweeps_of_what_a_filter_follows_say_what_eig_says(seed):
    """The energy bounds the mass, and the states only follow it where they decay by themselves."""
    k, T, g = np.random.default_rng(seed).uniform(0.2, 4.0, 3).round(3)
    states = f"F: {{rate: (b.x - F)/T}}\n  G: {{rate: {g}*F - p*G}}"
    mechanism = on_a_line(f"m: 1, k: {k}, T: {T}, p: 1", states, "-k*b.x")
    for name, values in (("k", [0.5, 1.0, 2.0]), ("T", [0.1, 0.5, 3.0]), ("p", [-1.0, 0.5, 1.0])):
        words = [mechanism.eig(**{name: value}).verdict for value in values]
        assert words == [UNSTABLE if name == "p" else "stable", "stable", "stable"]
        assert mechanism.sweep(name, values).verdicts == words
    assert np.all(mechanism.chart({"k": [0.5, 1.0, 2.0], "T": [0.1, 1.0, 2.0]}).unstable == 0)


def test_where_states_alone_lose_their_stability_is_found():
    pair = "x: {rate: (1e-6 - p**2)*x + 2*y}, y: {rate: -2*x + (1e-6 - p**2)*y}"
    found = mbstab.loads(HELD.format(states=pair)).sweep("p", np.linspace(-1.0, 1.0, 20))
    assert [x.value for x in found.critical] == pytest.approx([-1e-3, 1e-3], rel=1e-9)
