"""Controllers and motors: against formulas in matrices, published digits, and the same written as states."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.cli.main import main
from mbstab.errors import ModelFileError
from mbstab.model.units import per_second
from mbstab.report.simulation import simulation_rows


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


CART = """\
mbstab: 1
parameters: {T: 0.05}
gravity: [0, -9.81]
bodies:
  cart: {type: planar_point, mass: 0.5}
  rod: {type: planar, mass: 0.2, inertia: 0.006}
joints: {pivot: {type: revolute, between: [cart, {body: rod, point: [0, -0.3]}]}}
constraints: {rail: {holonomic: cart.y}}
forces:
  control: {type: pid, coordinate: cart.x, of: rod.theta, P: 40, I: 20, D: 8, lag: T}
  friction: {type: expression, on: {cart.x: -0.1*rate(cart.x)}}
reference: {coordinates: {cart: {x: 0, y: 0}, rod: {x: 0, y: 0.3, theta: 0}}}
"""


@pytest.mark.parametrize(
    ("T", "expected"),
    [
        (0.02, pairs(-0.683869916855054, -3.999842985286747, -22.74905263983819 + 32.59914507909302j)),
        (0.05, pairs(-0.68058468468294108, -4.074047905647982, -7.713592795743629 + 23.75021277225299j)),
        (0.1, pairs(-0.6752765168220667, -4.189941870254077, -2.658299897371019 + 17.27653212646016j)),
    ],
)
def test_a_cart_and_pendulum_with_a_lagging_controller(T, expected):
    found = mbstab.loads(CART).eig(T=T)
    assert close(found.values(), expected, 1e-12)
    assert (found.counts.expected, found.counts.neutral) == (6, 2)
    assert found.verdict == "asymptotically stable up to symmetry"


def test_the_cart_is_swept_and_asked_by_every_method():
    mechanism = mbstab.loads(CART)
    (critical,) = mechanism.sweep("T", np.linspace(0.02, 0.4, 13)).critical
    assert critical.value == pytest.approx(0.20478619158233459, rel=1e-12)
    assert critical.frequency == pytest.approx(12.013237476893, rel=1e-11)
    expected = mechanism.eig().values()
    for method in ("index3", "paper"):
        assert close(mechanism.eig(method).values(), expected, 1e-9)
    assert mechanism.system().names[-2:] == ["control_integral", "control_effort"]


DISK = """\
mbstab: 1
parameters: {parameters}
bodies: {{b: {{type: planar, mass: 1, inertia: J}}}}
joints: {{axle: {{type: revolute, between: [b, ground]}}}}
forces:
  {forces}
  rub: {{type: expression, on: {{angle(axle): {rub}}}}}
{rest}
"""


def disk(forces, rub="-d*rate(angle(axle))", rest="", **parameters):
    """Return a disk on an axle."""
    return mbstab.loads(
        DISK.format(parameters=json.dumps({"J": 0.7, "d": 0.1, **parameters}), forces=forces, rub=rub, rest=rest)
    )


MOTOR = "drive: {type: motor, joint: axle, resistance: R, inductance: L, constant: K}"
FIRST = {"J": 0.01, "d": 0.1, "K": 0.01, "R": 1, "L": 0.5}


def test_a_motor_and_its_stiff_twin():
    expected = [-2.00250078173866305, -9.99749921826133695]
    motor = disk(MOTOR, **FIRST)
    assert close(motor.eig().values(), expected, 1e-13)
    assert motor.eig().counts.neutral == 1
    assert close([complex(x) for x in motor.eig_precise(20).values()], expected, 1e-15)
    stiff = disk(MOTOR, J=3.2284e-6, d=3.5077e-6, K=0.0274, R=4, L=2.75e-6)
    expected = [-59.2260384878323432, -1454487.3150204099]
    assert close(stiff.eig().values(), expected, 1e-11)


def test_a_motor_with_an_arm_and_one_with_a_gear():
    arm = disk(MOTOR, rub="-d*rate(angle(axle)) - 0.3*sin(angle(axle))", **FIRST)
    expected = pairs(-1.99715040970956369, -5.00142479514521816 + 2.24244394823927014j)
    assert close(arm.eig().values(), expected, 1e-13)
    geared = disk(MOTOR.replace("constant: K", "constant: K/3, ratio: 3"), **FIRST)
    assert close(geared.eig().values(), disk(MOTOR, **FIRST).eig().values(), 1e-14)
    assert arm.certify().verdict == "asymptotically stable"


def test_a_motor_turns_as_its_matrix_says():
    motor = disk(
        MOTOR.replace("joint:", "voltage: 2, joint:"),
        rest="reference: {find: steady, steady: {axis: z}, guess: {drive_current: 1}}",
        **FIRST,
    )
    speed = 0.01 * 2.0 / (0.1 * 1.0 + 0.01**2)
    motion, found = motor.motion(), motor.eig().values()
    assert motion.u[2] == pytest.approx(speed, rel=1e-12)
    assert motion.q[3] == pytest.approx(0.1 * speed / 0.01, rel=1e-12)
    assert close(found[np.abs(found) > 1e-9], [-2.00250078173866305, -9.99749921826133695], 1e-12)


def closed_loop(A, B, C, D, J=0.7, d=0.1):
    """Return the eigenvalues of J θ'' + d θ' = u, u = C x + D y, x' = A x + B y with y = -θ."""
    n = len(A)
    S = np.zeros((n + 2, n + 2))
    S[0, 1] = 1.0
    S[1, 0], S[1, 1], S[1, 2:] = -D / J, -d / J, np.asarray(C) / J
    S[2:, 0], S[2:, 2:] = -np.asarray(B), A
    return np.linalg.eigvals(S)


def test_a_state_space_controller():
    A, B, C, D = [[-1.0, 2.0], [-3.0, -4.0]], [1.0, 0.5], [2.0, -1.0], 3.0
    text = f"u: {{type: state_space, joint: axle, signal: -angle(axle), A: {A}, B: {B}, C: {C}, D: {D}}}"
    assert close(disk(text).eig().values(), closed_loop(A, B, C, D), 1e-12)


@pytest.mark.parametrize(
    ("above", "below"),
    [
        ([3.0, 2.0, 5.0], [2.0, 3.0, 4.0]),
        ([5.0], [2.0, 3.0, 4.0, 1.5]),
        ([2.0, 5.0], [1.0, 3.0]),
        ([5.0], [2.0]),
    ],
)
def test_a_transfer_function(above, below):
    text = (
        f"u: {{type: transfer_function, joint: axle, signal: -angle(axle), numerator: {above}, denominator: {below}}}"
    )
    # (J s² + d s) below(s) + above(s) = 0.
    expected = np.roots(np.polyadd(np.polymul([0.7, 0.1, 0.0], below), above))
    found = disk(text)
    assert close(found.eig().values(), expected, 1e-11)
    assert found.eig().counts.expected == len(below) + 1


def test_state_feedback_with_and_without_a_lag():
    text = "u: {type: state_feedback, joint: axle, gains: {angle(axle): 4, rate(angle(axle)): k}}"
    assert close(disk(text, k=2).eig().values(), np.roots([0.7, 2.1, 4.0]), 1e-13)
    lagging = disk(text.replace("gains", "lag: 0.2, gains"), k=2)
    expected = np.roots(np.polyadd(np.polymul([0.7, 0.1, 0.0], [0.2, 1.0]), [2.0, 4.0]))
    assert close(lagging.eig().values(), expected, 1e-12)


def test_a_filtered_derivative_and_a_target():
    text = "u: {type: pid, joint: axle, of: angle(axle), target: 0.3, P: 4, I: 3, D: 2, filter: 0.05}"
    rest = "reference: {find: equilibrium, guess: {b: {theta: 0.1}}}"
    mechanism = disk(text, rest=rest)
    motion = mechanism.motion()
    assert motion.q[2] == pytest.approx(0.3, abs=1e-12)
    # (J s² + d s) s (T s + 1) + (P s + I)(T s + 1) + D s² = 0.
    loop = np.polymul(np.polymul([0.7, 0.1, 0.0], [1.0, 0.0]), [0.05, 1.0])
    expected = np.roots(np.polyadd(loop, np.polyadd(np.polymul([4.0, 3.0], [0.05, 1.0]), [2.0, 0.0, 0.0])))
    assert close(mechanism.eig().values(), expected, 1e-11)
    assert mechanism.certify().verdict == "asymptotically stable"
    assert disk(text.replace("I: 3", "I: 300"), rest=rest).certify().verdict == "unstable"
    at_rest = "reference: {coordinates: {b: {theta: 0.3}, u_filtered: 0.3}}"
    assert disk(text, rest=at_rest).certify().verdict == "asymptotically stable"


def test_a_controlled_motion_follows_the_exact_one():
    text = "u: {type: pid, joint: axle, of: angle(axle), P: 4, D: 2, filter: 0.05}"
    run = disk(text).simulate(to=0.5, points=3, perturb={"b.theta": 0.1})
    A = np.array([[0.0, 1.0, 0.0], [-(4.0 + 40.0) / 0.7, -0.1 / 0.7, 40.0 / 0.7], [20.0, 0.0, -20.0]])
    for t, q, u in zip(run.times, run.q, run.u, strict=True):
        expected = expm(A * t) @ [0.1, 0.0, 0.0]
        assert [q[2], u[2], q[3]] == pytest.approx(expected.tolist(), abs=1e-6)


def test_sensitivity_and_response_know_controllers():
    text = DISK.format(
        parameters="{J: 0.7, d: 0.1, P: 4}",
        forces="u: {type: pid, joint: axle, of: angle(axle), P: P, D: 2, lag: 0.1}",
        rub="-d*rate(angle(axle))",
        rest="inputs: {push: {type: joint, joint: axle}}\noutputs: {turn: angle(axle)}",
    )
    result = CliRunner().invoke(main, ["eig", "-", "--sensitivity", "--format", "json"], input=text)
    for row in json.loads(result.output)["sensitivity"]["eigenvalues"]:
        s = complex(row["real"], row["imag"])
        # (J s² + d s)(T s + 1) + P + D s = 0.
        slope = np.polyval(np.polyder(np.polyadd(np.polymul([0.7, 0.1, 0.0], [0.1, 1.0]), [2.0, 4.0])), s)
        found = row["derivatives"]["P"]
        assert complex(found["real"], found["imag"]) == pytest.approx(-1.0 / slope, rel=1e-10)
    result = CliRunner().invoke(main, ["response", "-", "--format", "json"], input=text)
    assert result.exit_code == 0, result.output


def bad(forces, rest=""):
    """Return the message of a model that is refused."""
    with pytest.raises(ModelFileError) as caught:
        disk(forces, rest=rest, R=1, L=1, K=1).system()
    return str(caught.value)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("type: pid, joint: axle, of: angle(axle)", "give at least one of 'P', 'I' and 'D'"),
        ("type: pid, joint: axle, of: angle(axle), P: 1, filter: 1", "there is no derivative to be filtered"),
        ("type: pid, joint: axle, of: angle(axle), D: 1, filter: 0", "filter must be positive, got 0 s"),
        ("type: pid, of: angle(axle), P: 1", "give one of 'joint' and 'coordinate', none given"),
        ("type: pid, joint: axle, coordinate: b.x, of: b.x, P: 1", "give one of 'joint' and 'coordinate', both given"),
        ("type: pid, joint: axel, of: angle(axle), P: 1", "there is no joint 'axel'"),
        ("type: pid, joint: axle, P: 1", "the key 'of' is missing"),
        ("type: pid, joint: axle, of: angel(axle), P: 1", "unknown function 'angel'"),
        ("type: pid, joint: axle, of: angle(axle) + 1, D: 1", "D needs its rate"),
        ("type: motor, joint: axle, resistance: R, constant: K", "the key 'inductance' is missing"),
        ("type: motor, joint: axle, resistance: R, constant: K, inductance: 0", "inductance must be positive, got 0 H"),
        ("type: state_feedback, joint: axle, gains: {}", "there are no gains"),
        ("type: state_feedback, joint: axle, gains: [1]", "expected gains by expression"),
        (
            "type: transfer_function, joint: axle, signal: b.x, numerator: [1, 2, 3], denominator: [1, 2]",
            "the degree 2",
        ),
        ("type: transfer_function, joint: axle, signal: b.x, numerator: [1], denominator: [0, 2]", "must not be zero"),
        (
            "type: transfer_function, joint: axle, signal: b.x, numerator: 1, denominator: [1]",
            "expected a list of numbers",
        ),
        ("type: state_space, joint: axle, signal: b.x, A: [[1, 2]], B: [1], C: [1]", "A must be square"),
        ("type: state_space, joint: axle, signal: b.x, A: [[1]], B: [1, 2], C: [1]", "B must have as many numbers"),
        ("type: state_space, joint: axle, signal: b.x, A: [[1]], B: [1], C: []", "expected a list of numbers"),
        ("type: state_space, joint: axle, signal: b.x, A: 3, B: [1], C: [1]", "expected rows of numbers"),
    ],
)
def test_a_controller_that_does_not_fit_is_refused_where_it_stands(entry, message):
    said = bad(f"u: {{{entry}}}")
    assert message in said
    assert re.search("<text>:6:[0-9]+: forces.u", said)


def test_names_of_states_are_not_taken_twice():
    said = bad("u: {type: pid, joint: axle, of: angle(axle), I: 1}", "states: {u_integral: {rate: 1}}")
    assert "its state would be called 'u_integral', and that name is taken" in said


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ("a: {rate: rate(c) - a}, c: {rate: rate(a)}", "an algebraic loop: rates depend on each other in a circle"),
        ("a: {rate: rate(a)}", "the rate of 'a' depends on itself"),
    ],
)
def test_an_algebraic_loop_is_told(states, message):
    said = bad("u: {type: pid, joint: axle, of: angle(axle), P: 1}", f"states: {{{states}}}")
    assert message in said
    assert "<text>:8:" in said


@pytest.mark.parametrize("below", [[1, 30], [1, 60], [1, 1000], [1, 1e-3], [1e-3, 2]])
def test_an_equilibrium_with_a_controller_is_isolated_whatever_its_time_constants(below):
    # At rest the force is -x times the last coefficients' quotient, which is no 0.
    text = f"""mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}}}
constraints: {{line: {{holonomic: a.y}}}}
forces: {{c: {{type: transfer_function, coordinate: a.x, signal: -a.x, numerator: [2, 1], denominator: {below}}}}}
reference: {{coordinates: {{a: {{x: 0}}}}}}
"""
    (found,) = mbstab.loads(text).equilibria()
    assert not found.open


@pytest.mark.parametrize("lag", ["", ", lag: 0.05"])
def test_the_effort_of_a_controller_is_an_output(lag):
    text = f"""mbstab: 1
bodies: {{a: {{type: planar, mass: 2, inertia: 3}}}}
joints: {{axle: {{type: revolute, between: [a, ground]}}}}
forces: {{c: {{type: pid, joint: axle, of: angle(axle), P: 40, I: 30, D: 9{lag}}}}}
inputs: {{push: {{type: torque, body: a}}}}
outputs:
  effort: effort(c)
  same: {"c_effort" if lag else "-40*a.theta + 30*c_integral - 9*rate(a.theta)"}
reference: {{}}
"""
    C = mbstab.loads(text).state_space().C
    assert np.any(C[0])
    np.testing.assert_allclose(C[0], C[1], rtol=1e-14)


FAULTS = {
    "joint: pin": "joint: pine",
    "of: angle(pin)": "of: angel(pin)",
    "P: k": "Kp: k",
    "type: pid": "type: PID",
    "lag: 0.1": "lag: -0.1*",
    "filter: 0.01, D: 2": "filter: 0.01",
}


@pytest.mark.parametrize(("old", "new"), FAULTS.items())
def test_a_mistake_in_a_controller_is_told_once_whatever_names_it(old, new):
    text = """\
mbstab: 1
parameters: {k: {value: 5}}
bodies: {a: {type: planar, mass: 1, inertia: 1}}
joints: {pin: {type: revolute, between: [a, ground]}}
forces:
  pid1: {type: pid, joint: pin, of: angle(pin), P: k, filter: 0.01, D: 2, lag: 0.1}
  pid2: {type: pid, joint: pin, of: angle(pin), P: k}
outputs: {u: effort(pid1), v: 2*pid1_effort, w: effort(pid2), x: pid1_filtered + effort(pid1)}
"""
    mbstab.loads(text)
    assert old in text
    with pytest.raises(mbstab.ModelFileError) as caught:
        mbstab.loads(text.replace(old, new, 1))
    assert [problem.path.split(".")[:2] for problem in caught.value.problems] == [["forces", "pid1"]]
    if new in ("Kp: k", "type: PID"):
        assert caught.value.problems[0].hint == f"did you mean {'P' if new == 'Kp: k' else 'pid'!r}?"


UNITS_OF_PARTS = """mbstab: 1
parameters:
  T: {value: 0.1, unit: s}
  K: {value: 2, unit: N*m/rad}
  Ki: {value: 2, unit: N*m/(rad*s)}
  Kd: {value: 2, unit: N*m*s/rad}
  w: {value: 3, unit: 1/s}
  m: {value: 3, unit: kg}
  k: {value: 3, unit: N*m/A}
  kt: {value: 3, unit: N/A}
  R: {value: 3, unit: ohm}
  L: {value: 3, unit: H}
  V: {value: 3, unit: V/rad}
  d: {value: 0.2, unit: rad}
  ky: {value: 3, unit: N/m}
  e: {value: 3, unit: 1/m}
bodies: {b: {type: planar, mass: 1, inertia: 1}, c: {type: planar, mass: 1, inertia: 1}}
joints: {axle: {type: revolute, between: [b, ground]}, slide: {type: prismatic, between: [c, ground], axis: x}}
forces: {FORCES}
reference: {coordinates: {b: {theta: 0}, c: {x: 0}}}
"""
TRANSFER = "u: {type: transfer_function, joint: axle, signal: -angle(axle), %s}"
SPACE = "u: {type: state_space, joint: axle, signal: angle(axle), %s}"
LAGGED = "a: {type: pid, joint: axle, of: angle(axle), P: K, lag: T}, "
MOTORED = "u: {type: motor, joint: axle, resistance: R, inductance: L, %s}"
SLIDING = "u: {type: motor, joint: slide, resistance: R, inductance: L, %s}"


@pytest.mark.parametrize(
    ("forces", "units"),
    [
        (TRANSFER % "numerator: [K], denominator: [T, 1]", {"u_1": "rad*s"}),
        (TRANSFER % "numerator: [Kd, K, Ki], denominator: [T, 1, 0]", {"u_1": "rad*s^2", "u_2": "rad*s"}),
        (TRANSFER % "numerator: [K*T, K], denominator: [T**2, 0.7*T, 1], lag: T", {"u_2": "rad*s", "u_effort": "N*m"}),
        (TRANSFER % "numerator: [4, 3], denominator: [0.1, 1]", {"u_1": "rad*s"}),
        (TRANSFER % "numerator: [K*w], denominator: [1, w]", {"u_1": "rad*s"}),
        (
            "u: {type: pid, joint: axle, of: angle(axle), target: d, P: K, I: Ki, D: Kd, filter: T, lag: T}",
            {"u_integral": "rad*s", "u_filtered": "rad", "u_effort": "N*m"},
        ),
        (
            "u: {type: pid, coordinate: c.x, of: rate(c.x), I: 3, D: 1, filter: 1, lag: 1}",
            {"u_integral": "m", "u_filtered": "m/s", "u_effort": "N"},
        ),
        (SPACE % "A: [[-w, 1], [0, -w]], B: [1, w], C: [K, K], D: K", {"u_2": "rad"}),
        (SPACE % "A: [[-w, 1], [0, -w]], B: [1, 2], C: [Ki, 3]", {"u_1": "rad*s"}),
        (SPACE % "A: [[-1]], B: [1], C: [1]", {}),
        (LAGGED + "u: {type: pid, joint: axle, of: a_effort, I: 2}", {"a_effort": "N*m", "u_integral": "N*m*s"}),
        (LAGGED + "u: {type: state_feedback, joint: axle, gains: {a_effort: 2}}", {}),
        (MOTORED % "constant: k, voltage: -V*angle(axle)", {"u_current": "A"}),
        (MOTORED % "constant: k, voltage: -3*angle(axle), ratio: 10", {"u_current": "A"}),
        (SLIDING % "constant: k, ratio: e", {"u_current": "A"}),
        (SLIDING % "constant: kt", {"u_current": "A"}),
    ],
)
def test_states_of_controllers_have_the_units_that_signals_gains_and_time_give(forces, units):
    model = mbstab.loads(UNITS_OF_PARTS.replace("FORCES", forces)).model
    assert units.items() <= model.state_units.items()
    for state in units:
        assert model.unit_of(state, 1) == per_second(units[state])


@pytest.mark.parametrize(
    ("forces", "place", "message", "hint"),
    [
        (TRANSFER % "numerator: [ky], denominator: [T, 1]", "numerator[0]", "expected N*m/rad", "it multiplies -angle"),
        (TRANSFER % "numerator: [K], denominator: [T, m]", "denominator[1]", "expected a plain number", "power of s"),
        (TRANSFER % "numerator: [K, K], denominator: [T, 1]", "numerator[0]", "expected N*m*s", "it multiplies"),
        (SPACE % "A: [[-T]], B: [1], C: [K]", "A[0][0]", "expected 1/s", "u_1 in the rate of u_1"),
        (SPACE % "A: [[-w]], B: [w], C: [ky]", "C[0]", "expected N*m/rad", "u_1"),
        (SPACE % "A: [[-w, 1], [0, m]], B: [w, w], C: [K, K]", "A[1][1]", "expected 1/s", "u_2 in the rate of u_2"),
        (SPACE % "A: [[-w, e], [0, -w]], B: [w, w], C: [K, K]", "A[0][1]", "expected 1/s", "u_2 in the rate of u_1"),
        (SPACE % "A: [[-1]], B: [1], C: [1], D: ky", "D", "expected N*m/rad", "it multiplies angle(axle)"),
        (LAGGED + "u: {type: state_feedback, joint: axle, gains: {a_effort: K}}", "gains.a_effort", "plain number", ""),
        (LAGGED + MOTORED % "constant: k, voltage: a_effort", "voltage", "has the unit N*m, expected V", ""),
        (MOTORED % "constant: kt", "constant", "has the unit N/A, expected N*m/A", "u_current"),
        (MOTORED % "constant: m, ratio: 3", "constant", "has the unit kg, expected N*m/A", "3 is a plain number"),
        (SLIDING % "constant: k, ratio: 50", "constant", "expected N/A", "50 is a plain number; if it stands for 1/m"),
        (
            "u: {type: expression, on: {b.theta: -0.13*ky*c.x}}",
            "on.b.theta",
            "has the unit N, expected N*m",
            "0.13 is a plain number; if it stands for m, make it a parameter",
        ),
        ("u: {type: actuator, joint: axle, effort: -ky*angle(axle)}", "effort", "expected N*m", ""),
        ("u: {type: pid, joint: axle, of: angle(axle), P: K, target: ky}", "target", "expected rad", "compared with"),
    ],
)
def test_a_coefficient_in_a_wrong_unit_is_told_at_its_key(forces, place, message, hint):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(UNITS_OF_PARTS.replace("FORCES", forces))
    (problem,) = caught.value.problems
    assert problem.path == f"forces.u.{place}"
    assert message in problem.message
    assert hint in problem.hint


def test_plots_and_tables_tell_the_units_of_states():
    forces = "u: {type: pid, joint: axle, of: angle(axle), P: K, I: Ki, lag: T}"
    model = mbstab.loads(UNITS_OF_PARTS.replace("FORCES", forces))
    heads = simulation_rows(model.simulate(to=0.1, points=2), model.model)[0]
    for head in ("u_integral (rad*s)", "rate(u_integral) (rad)", "acceleration(u_effort) (N*m/s^2)"):
        assert head in heads
    with pytest.raises(ModelFileError, match="'ky' has the unit N/m, expected N\\*m"):
        mbstab.loads(UNITS_OF_PARTS.replace("FORCES", forces).replace("c: {x: 0}", "c: {x: 0}, u_effort: ky"))
    state = [x for x in model.eig().units if x not in ("m", "rad")]
    assert state == ["rad*s", "N*m"]


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("lag", "leave it out: without it, the effort acts at once"),
        ("filter", "leave it out: without it, the rate itself acts"),
    ],
)
def test_times_of_zero_are_left_out(key, hint):
    with pytest.raises(ModelFileError, match=f"{key} must be positive, got 0 s") as caught:
        mbstab.loads(CART.replace("lag: T", f"{key}: 0")).eig()
    assert hint in str(caught.value)


INTEGRAL = """
mbstab: 1
parameters: {I: 2, load: 0.3}
bodies: {p: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: p.y}}
forces:
  spring: {type: expression, on: {p.x: -p.x + load}}
  a: {type: pid, of: p.x, target: 0.1, coordinate: p.x, P: 3, D: 1, I: I}
reference: {find: equilibrium}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("first", [0.0, -1.0])
def test_a_sweep_names_the_integral_that_has_no_value_at_a_gain_of_zero(first):
    result = mbstab.loads(INTEGRAL.replace("I: 2", f"I: {first}")).sweep("I", np.linspace(first, 3.0, 13))
    assert [(c.kind, c.value) for c in result.critical] == [("loss of equilibrium", pytest.approx(0.0, abs=1e-9))]
    i = int(np.argmin(np.abs(result.values)))
    assert result.problems[i] == "no solution at I = 0 on this path: a_integral grows beyond all bounds there"
    if not first:
        assert "a_integral acts on nothing here, and its rate does not come to zero" in result.moved


def test_positions_that_grow_are_named_too():
    # x = load/(k - 1): two points do, the third does not.
    text = """
mbstab: 1
parameters: {k: 3}
bodies: {p: {type: planar_point, mass: 1}, r: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: r.y}}
forces:
  f: {type: expression, on: {p.x: (1 - k)*p.x - rate(p.x) + 1, p.y: (1 - k)*p.y - rate(p.y) - 2}}
  g: {type: expression, on: {r.x: 1 - r.x - rate(r.x)}}
reference: {find: equilibrium}
"""
    result = mbstab.loads(text).sweep("k", np.linspace(3.0, 0.0, 9))
    said = set(result.problems.values())
    assert "no solution beyond k = 1 on this path: p.x and p.y grow beyond all bounds there" in said


@pytest.mark.parametrize(
    ("target", "verdict"),
    [
        ("0.1 + 0.2 - 0.3", "asymptotically stable"),
        ("sum", "asymptotically stable"),
        ("sin(pi)", "asymptotically stable"),
        ("(0.1 + 0.2 - 0.3)**2", "asymptotically stable"),
        ("1e-17", "undecided"),
        ("2e-30", "undecided"),
        ("0.1 + 0.2 - 0.3 + 1e-15", "undecided"),
    ],
)
def test_an_error_that_is_rounding_is_told_from_one_that_is_small(target, verdict):
    """The integral of a controller rests where its error is the rounding of an expression."""
    text = f"u: {{type: pid, joint: axle, of: angle(axle), target: {target}, P: 4, I: 0.1}}"
    rest = "reference: {coordinates: {b: {x: 0, y: 0, theta: 0}}}"
    assert disk(text, rest=rest, sum="0.1 + 0.2 - 0.3").eig().verdict == verdict


ARM = """\
mbstab: 1
parameters: {k: 50, d: 2, q0: {value: 180, unit: deg}}
bodies: {arm: {type: spatial, mass: 1, inertia: [0.1, 0.1, 0.1]}}
joints: {j: {type: revolute, between: [arm, ground], axis: z}}
forces:
  fb: {type: state_feedback, joint: j, gains: {angle(j) - q0: k, rate(angle(j)): d}}
reference: {coordinates: {arm: {phi: 0, theta: 0, psi: q0}}}
"""
PID = "fb: {type: pid, joint: j, of: angle(j), target: q0, P: k, D: d}"
EXPRESSION = "fb: {type: expression, on: {angle(j): k*(q0 - angle(j)) - d*rate(arm.psi)}}"


@pytest.mark.parametrize("law", ["", PID, EXPRESSION])
@pytest.mark.parametrize("turned", [180, -180, 200, 720])
def test_angles_in_space_count_from_the_turn_of_the_target(law, turned):
    """s² J + s d + k = 0, whatever the angle; within half a turn, 200 degrees would be 360 degrees from the target."""
    text = ARM.replace("value: 180", f"value: {turned}")
    text = text if not law else re.sub("fb: .*", law, text)
    found = mbstab.loads(text).eig()
    assert found.verdict == "asymptotically stable"
    assert close([e.value for e in found.eigenvalues], pairs(-10 + 20j), 1e-12)


def test_a_sweep_of_the_target_over_two_turns():
    found = mbstab.loads(ARM).sweep("q0", np.linspace(-6.0, 6.0, 25))
    assert not found.critical
    assert np.max(np.abs(found.branches.real + 10.0)) <= 1e-9


def test_angles_in_space_go_on_over_turns_in_a_simulation():
    """The arm swings by 1.4 turns to both sides of its target: φ = q0 + (w/ω) sin ωt with ω² = k/J."""
    found = mbstab.loads(ARM).at(d=0.0, q0=200.0).simulate(0.3, perturb={"rate(arm.psi)": 200.0}, points=31, tol=1e-6)
    omega = np.sqrt(500.0)
    exact = np.radians(200.0) + 200.0 / omega * np.sin(omega * found.times)
    assert np.max(np.abs(found.q[:, found.names.index("arm.psi")] - exact)) <= 1e-5
    assert not found.warnings


def test_an_integral_that_only_rounding_moves_is_at_rest():
    # The coordinates that the rail leaves are solved for: their product in the travel is some 1e-65 m.
    model = mbstab.loads("""\
mbstab: 1
gravity: [0, -9.81]
bodies:
  cart: {type: planar, mass: 3, inertia: 1}
  a: {type: planar, mass: 0.5, shape: {type: rod, length: 0.6}, points: {top: [0, 0.3], end: [0, -0.3]}}
  b: {type: planar, mass: 0.3, shape: {type: rod, length: 0.4}, points: {top: [0, 0.2]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: x}
  j1: {type: revolute, between: [cart, a.top]}
  j2: {type: revolute, between: [a.end, b.top]}
forces:
  m: {type: pid, joint: rail, of: displacement(rail), P: 200, I: 30, D: 80}
reference: {coordinates: {cart: {x: 0}, a: {theta: 0}, b: {theta: 0}}}
""")
    assert not np.any(model.motion().u)
    assert model.eig().verdict == "asymptotically stable"
