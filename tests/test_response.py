"""Frequency responses, zeros and step responses against closed forms."""

import csv
import io
import json

import numpy as np
import pytest
from mpmath import mp
from test_cli import run
from test_control import MASSES, WHIPPLE, cart

import mbstab
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.response import answer
from mbstab.analysis.response.transfer import channels
from mbstab.analysis.response.zeros import TransferZeros
from mbstab.errors import NumericalError, UsageError
from mbstab.report.pictures.responses import nyquist, response_picture
from mbstab.report.responses import _degrees, angles, decibels, phase, response_data, response_text


def channel(model, source, goal):
    return channels(model, (source,), (goal,))[0]


def zeros_of(model, source, goal):
    return TransferZeros(FrequencyResponse(model)).of(channel(model, source, goal))


@pytest.mark.few(1)
@pytest.mark.parametrize("states", [WHIPPLE, []])
def test_the_bicycle_at_5_m_per_s(states):
    model = mbstab.load("whipple_bicycle.yaml").state_space(states, v=5)
    roll, steer = channel(model, "steer_torque", "roll"), channel(model, "steer_torque", "steer")
    exact = FrequencyResponse(model)
    known = {
        0.1: (-0.9868355698423036 + 0.311818946057855j, -0.4139805160943399 + 0.1349011784455204j),
        1.0: (-0.08684857153592184 + 0.3377703770044555j, -0.02600477922341272 + 0.1589365093804886j),
        100.0: (1.258669834379354e-5 - 7.089108793684031e-6j, -0.0004240188630987565 - 6.783239645706545e-5j),
    }
    for omega, (first, second) in known.items():
        for of, value in ((roll, first), (steer, second)):
            assert abs(exact.of(of)(np.array([omega]))[0][0] - value) < 1e-10 * abs(value)
    for source, goal, zeros in (
        ("steer_torque", "roll", [-59.25992316246231, -13.7464996092469]),
        ("steer_torque", "steer", [-3.13466385808362, 3.13466385808362]),
        ("roll_torque", "roll", [-16.09472211912259, -12.19888055817634]),
        ("roll_torque", "steer", [-2.523609225797761, 4.356737470927877]),
    ):
        found = zeros_of(model, source, goal)
        np.testing.assert_allclose(found.values, zeros, rtol=1e-12)
        assert np.all(np.abs(found.values - zeros) <= found.errors + 1e-14 * np.abs(zeros))
        assert np.all(found.errors < 1e-8)
        assert found.minimum_phase is (goal == "roll")
        assert found.hidden == (0.0,) * 6


def test_zeros_of_two_masses_beside_the_force_and_behind_the_spring():
    model = mbstab.loads(MASSES).state_space()
    near, far = zeros_of(model, "push", "near"), zeros_of(model, "push", "far")
    np.testing.assert_allclose(near.values, [-0.125 - 7.06996287118963589j, -0.125 + 7.06996287118963589j], rtol=1e-12)
    np.testing.assert_allclose(far.values, [-200.0], rtol=1e-10)
    assert near.minimum_phase
    assert far.minimum_phase


@pytest.mark.parametrize("damping", [0.0, 0.5])
@pytest.mark.parametrize(
    ("output", "at_zero"),
    [("one.x", 0), ("rate(one.x)", 1), ("acceleration(one.x)", 2), ("w", 1), ("rate(w)", 2)],
)
def test_a_zero_on_the_imaginary_axis_is_known_to_lie_there(output, at_zero, damping):
    """A constant force leaves what a spring holds no rate; without damping the mass behind absorbs at √50 rad/s."""
    text = MASSES.replace("0.5", str(damping)).replace("near: one.x", f"near: '{output}'")
    text = text.replace("forces:", "forces:\n  held: {type: joint_spring, joint: first, stiffness: 3}")
    if "w" in output:
        text += "states: {w: {rate: rate(one.x) - w}}\n"
    found = zeros_of(mbstab.loads(text).state_space(), "push", "near")
    known = np.array([*np.roots([2.0, damping, 100.0]), *[0] * at_zero])
    by_side = [x[np.argsort(x.imag)] for x in (found.values, known)]
    np.testing.assert_allclose(*by_side, rtol=1e-12, atol=1e-14)
    assert np.sum(found.values == 0.0) == np.sum(found.errors == 0.0) == at_zero
    # The state w reacts to a rate: the mirror image of its equation is another one.
    absorbed = 2 * (damping == 0.0 and "w" not in output)
    assert np.sum(found.on_axis) == at_zero + absorbed
    assert np.all(found.values[found.on_axis].real == 0.0)
    unknown = damping == 0.0 and output == "w"
    assert found.minimum_phase is (not found.on_axis.any() and not unknown)


def test_zeros_that_cancel_eigenvalues_are_hidden():
    """Of a cart with a pendulum above it: the angle does not see where the cart is, nor how fast it moves."""
    found = zeros_of(cart(outputs=["bob.theta"]).state_space(), "push", "z0")
    assert len(found.values) == 0
    assert len(found.hidden) == 2
    zeros = zeros_of(cart(outputs=["cart.x"]).state_space(), "push", "z0")
    np.testing.assert_allclose(zeros.values, [-(19.62**0.5), 19.62**0.5], rtol=1e-12)
    assert zeros.minimum_phase is False
    vanishing = zeros_of(cart(outputs=["cart.y"]).state_space(), "push", "z0")
    assert vanishing.vanishes
    assert vanishing.minimum_phase is None


DRIVEN = "drives:\n  motor: {type: joint, joint: rail, position: 0}"


def test_the_function_of_a_drive_has_its_zeros_too():
    """The tilt follows the acceleration of the cart: two zeros at 0; and its effort has four."""
    model = cart("{type: drive, drive: motor}", ["bob.theta", "effort(motor)", "place(cart.x)"], DRIVEN).state_space()
    tilt = channel(model, "push", "z0")
    zeros = zeros_of(model, "push", "z0")
    np.testing.assert_array_equal(zeros.values, [0, 0])
    assert zeros.minimum_phase is False
    effort = channel(model, "push", "z1")
    zeros = zeros_of(model, "push", "z1")
    assert len(zeros.values) == 4
    np.testing.assert_allclose(np.abs(zeros.values.real).max(), (9.81 * 1.1 / 0.5) ** 0.5, rtol=1e-6)
    times = np.linspace(0, 1, 11)
    np.testing.assert_allclose(channel(model, "push", "z2").step(times), 1.0, rtol=1e-14)
    # A unit step of the cart leaves the bob where it is.
    np.testing.assert_allclose(tilt.step(times), 2.0 * np.cosh(19.62**0.5 * times), rtol=1e-11)
    with pytest.raises(UsageError, match="has impulses after a step of push"):
        effort.step(times)


def test_steps_and_impulses():
    model = cart(outputs=["bob.theta"]).state_space()
    times, rate = np.linspace(0, 0.5, 6), 4.64564312017184549
    found = answer(model, duration=0.5, points=6)
    np.testing.assert_allclose(found.values[0], 2.0 * (np.cosh(rate * times) - 1) / rate**2, rtol=1e-11, atol=1e-15)
    found = answer(model, duration=0.5, points=6, impulse=True)
    np.testing.assert_allclose(found.values[0], 2.0 * np.sinh(rate * times) / rate, rtol=1e-11, atol=1e-15)


def test_the_command_writes_the_same_numbers_in_each_format(tmp_path):
    arguments = (
        "response",
        "whipple_bicycle.yaml",
        "--input",
        "steer_torque",
        "--from",
        "0.1",
        "--to",
        "10",
        "--points",
        "3",
    )
    data = json.loads(run(*arguments, "--format", "json").stdout)
    rows = list(csv.reader(io.StringIO(run(*arguments, "--format", "csv").stdout)))
    np.testing.assert_allclose(data["frequency"], [0.1, 1, 10], rtol=1e-14)
    first = data["channels"][0]
    assert (first["input"], first["output"], first["unit"]) == ("steer_torque", "roll", "rad/(N*m)")
    heads = [f"roll/steer_torque {part} (rad/(N*m))" for part in ("real", "imag", "error")]
    assert rows[0][:4] == ["frequency (rad/s)", *heads]
    assert [float(row[1]) for row in rows[1:]] == first["real"]
    text = run(*arguments).stdout
    assert "-13.7464996" in text
    assert "0.298201" in text  # dB
    assert "162.465" in text
    assert "not minimum phase" in text
    for extra, own in (("--step", "rad/(N*m)"), ("--impulse", "rad/(N*m*s)")):
        over_time = run(*arguments[:4], extra, "1", "--points", "3", "--format", "csv").stdout
        assert over_time.splitlines()[0].split(",")[:2] == ["time (s)", f"roll/steer_torque ({own})"]
    picture = tmp_path / "a.svg"
    for extra, name in (((), "bode"), (("--step", "2"), "step"), (("--impulse", "2"), "impulse")):
        result = run(
            "response", "whipple_bicycle.yaml", "--points", "20", *extra, "--plot", name, "--pictures", str(picture)
        )
        assert result.exit_code == 0
        assert (tmp_path / f"a-{name}.svg").stat().st_size > 1000


UNDAMPED = """\
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}}
constraints: {l: {holonomic: a.y}}
forces: {f: {type: expression, on: {a.x: %s}}}
inputs: {push: {type: force, at: a, direction: [1, 0]}}
outputs: {pos: a.x}
"""


def test_a_step_that_overflows_is_refused_with_the_time():
    for duration in (1000.0, 1e300):
        with pytest.raises(NumericalError, match="pos after a change of push: numbers above 1e308 between"):
            answer(mbstab.loads(UNDAMPED % "5*rate(a.x)").state_space(), duration=duration)


def test_on_a_pole_there_is_no_phase():
    found = answer(mbstab.loads(UNDAMPED % "-4*a.x").state_space(), ends=(1.0, 4.0), points=3)
    assert np.isinf(found.values[0][1])
    data = response_data(found, None)["channels"][0]
    assert np.isnan(data["imag"][1])
    np.testing.assert_array_equal(np.isnan(phase(found.values[0])), [False, True, False])


LEAK = """\
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}}
constraints: {l: {holonomic: a.y}}
states: {z: {rate: -0.3*a.x - 0.7*z}}
forces: {f: {type: expression, on: {a.x: -23*rate(a.x) - 4*a.x}}}
inputs: {push: {type: force, at: a, direction: [1, 0]}}
outputs: {leak: -0.7*z - 0.3*a.x}
"""


def test_a_zero_at_zero_is_on_no_side_of_the_axis():
    """The output is the rate of a state: the transfer function has the factor s."""
    zeros = zeros_of(mbstab.loads(LEAK).state_space(), "push", "leak")
    assert len(zeros.values) == 1
    assert abs(zeros.values[0]) <= zeros.errors[0] < 1e-9
    assert zeros.minimum_phase is None


LOOSE = """\
mbstab: 1
parameters: {w: 0, e: 1e-7}
bodies: {a: {type: planar_point, mass: 1.88}, b: {type: planar_point, mass: 1}}
constraints: {la: {holonomic: a.y}, lb: {holonomic: b.y}}
states: {z: {rate: -0.716*a.x - 17.3*rate(a.x) - 25.4*w}}
forces:
  a: {type: expression, on: {a.x: -10000*a.x - 23*rate(a.x)}}
  b: {type: expression, on: {b.x: -1000000*b.x - rate(b.x) + e*a.x}}
inputs: {push: {type: force, at: a, direction: [1, 0]}, par: {type: parameter, parameter: w}}
outputs: {near: a.x, far: b.x}
"""


def test_only_what_nothing_leads_to_is_said_not_to_respond():
    """The parameter drives only the state, which acts on nothing; the weak spring acts, and the other way does not."""
    found = answer(mbstab.loads(LOOSE).state_space(), ends=(0.1, 10.0), points=3)
    assert [x.vanishes for x in found.zeros] == [False, False, True, True]
    for values in found.values[2:]:
        np.testing.assert_array_equal(values, 0.0)
    weak = found.zeros[1]
    assert (weak.doubt, len(weak.values), weak.hidden) == ("", 0, (0.0,))
    peak = 1j * found.largest[1].frequency
    gain = 1e-7 / abs((1.88 * peak**2 + 23 * peak + 1e4) * (peak**2 + peak + 1e6))
    assert found.largest[1].value == pytest.approx(gain, rel=1e-12)
    assert 72.0 < peak.imag < 73.0
    # The sum of 1 and of this response has traces of its eigenvalues close to them only.
    assert found.margins[1].closed is True
    assert "does not respond" in response_text(found, None)
    cut = answer(mbstab.loads(LOOSE).state_space(e=0), goals=("far",), points=2)
    assert all(x.vanishes for x in cut.zeros)


CHAIN = """\
mbstab: 1
bodies:
  b0: {type: planar_point, mass: 17.5}
  b1: {type: planar_point, mass: 170}
  b2: {type: planar_point, mass: 11.8}
constraints: {l0: {holonomic: b0.y}, l1: {holonomic: b1.y}, l2: {holonomic: b2.y}}
states:
  z0: {rate: 1.1*b1.x + 0.252*b2.x - 4.15*rate(b0.x) + 0.287*rate(b1.x)}
  z1: {rate: -0.000502*b0.x + 0.000457*b2.x - 0.654*rate(b2.x) + 645*z0 - 24.6*z1}
forces:
  all:
    type: expression
    on:
      b0.x: 13.1*b0.x - 0.0365*b2.x + 0.265*rate(b0.x) + 0.107*rate(b1.x) - 5.65*z0
      b1.x: 28.9*b0.x + 0.126*b1.x - 1.86*b2.x - 1.03*rate(b0.x) - 0.00272*rate(b1.x) - 24.7*rate(b2.x) + 0.000946*z1
      b2.x: -23.5*b2.x + 0.00437*rate(b0.x) + 0.095*rate(b1.x) - 0.123*rate(b2.x) + 26.3*z0
inputs: {push: {type: force, at: b0, direction: [1, 0]}}
outputs: {o: b2.x}
"""


def test_errors_of_zeros_include_those_of_derivatives_of_the_output():
    """Three masses, the output three integrators behind the input; the expected zeros have 80 digits."""
    zeros = zeros_of(mbstab.loads(CHAIN).state_space(), "push", "o")
    for expected in (-24.59999947, 24976.10452):
        k = int(np.argmin(np.abs(zeros.values - expected)))
        assert abs(zeros.values[k] - expected) <= zeros.errors[k] + 5e-10 * abs(expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("whipple_bicycle.yaml", "--input", "steer"), "there is no input 'steer'"),
        (("whipple_bicycle.yaml", "--measured", "rol"), "did you mean 'roll'"),
        (("whipple_bicycle.yaml", "--from", "2", "--to", "2"), "two different positive numbers"),
        (("whipple_bicycle.yaml", "--step", "1", "--impulse", "1"), "exclude each other"),
        (("whipple_bicycle.yaml", "--step", "-1"), "give a positive time"),
        (("whipple_bicycle.yaml", "--step", "1", "--from", "1"), "are frequencies"),
        (("pendulum.yaml",), "the model declares no inputs"),
    ],
)
def test_wrong_questions_are_refused(arguments, message):
    result = run("response", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


# --- values from the unreduced equations ----------------------------------------------------------------------------


NOTHING_AT_REST = """\
mbstab: 1
parameters: {k: {value: 2, unit: kN/m}, w: {value: 0, unit: mm}}
bodies: {a: {type: planar_point, mass: 1}}
constraints: {line: {holonomic: a.y}}
forces: {spring: {type: expression, on: {a.x: -k*(a.x - w) - 3*rate(a.x)}}}
inputs: {foot: {type: parameter, parameter: w}, push: {type: force, at: a, direction: [1, 0]}}
outputs: {x: a.x, acc: acceleration(a.x)}
reference: {coordinates: {a: {x: 0, y: 0}}}
"""


TWO_MASSES = """\
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
constraints: {la: {holonomic: a.y}, lb: {holonomic: b.y}}
forces: {own: {type: expression, on: {a.x: -a.x - (a.x - b.x), b.x: -(b.x - a.x) - 0.1*rate(b.x)}}}
inputs: {u: {type: force, at: a, direction: [1, 0]}}
outputs: {x: a.x}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
"""


def test_values_over_many_decades_are_as_accurate_as_they_say():
    """k/(s² + 3 s + k) and s²/(s² + 3 s + k), at frequencies at which a reduced matrix loses the small ones."""
    model = mbstab.loads(NOTHING_AT_REST).state_space()
    exact = FrequencyResponse(model)
    omega = np.geomspace(1e-9, 1e9, 37)
    values, errors = exact.over(omega)
    with mp.workdps(40):
        for k, x in enumerate(omega):
            s = mp.mpc(0, x)
            below = s**2 + 3 * s + 2000
            true = (2000 / below, 1 / below, 2000 * s**2 / below, s**2 / below)
            for value, error, expected in zip(values[:, :, k].ravel(), errors[:, :, k].ravel(), true, strict=True):
                assert abs(mp.mpc(complex(value)) - expected) <= error
                assert error <= 1e-11 * abs(expected)


def test_an_input_that_is_a_parameter_has_the_unit_of_its_numbers():
    model = mbstab.loads(NOTHING_AT_REST).state_space()
    assert model.input_units == ("m", "N")


def test_the_first_frequency_is_not_a_rounding_error():
    """A cart that moves freely has the eigenvalue 0, which has no frequency; its gain does not say so either."""
    text = NOTHING_AT_REST.replace("-k*(a.x - w) - 3*rate(a.x)", "-3*rate(a.x)").replace(
        "foot: {type: parameter, parameter: w}, ", ""
    )
    found = answer(mbstab.loads(text).state_space(), goals=("x",))
    assert found.x[0] == pytest.approx(0.3)
    assert np.all(found.errors[0] <= 1e-13 * np.abs(found.values[0]))
    assert "the eigenvalue 0 has no damping" in found.largest[0].reason


def test_a_pair_of_zeros_is_printed_once():
    result = answer(mbstab.loads(TWO_MASSES).state_space(), points=2)
    (line,) = [x for x in response_text(result, None).splitlines() if x.startswith("zeros")]
    assert len(result.zeros[0].values) == 2
    assert line.count("±") == 2  # of the pair, and of its error


def test_an_input_that_is_a_parameter_does_not_move_what_counts_from_the_reference():
    # The offset of the gear is that of the guess; the target stands there too. By hand: 16/(5 s^2 + 4 s + 16).
    geared = """mbstab: 1
parameters: {q: {value: 0.3, unit: rad}}
bodies: {motor: {type: planar, mass: 1, inertia: 1}, load: {type: planar, mass: 1, inertia: 1}}
joints:
  a: {type: revolute, between: [motor, ground]}
  b: {type: revolute, between: [load, ground]}
  g: {type: gear, joints: [a, b], ratio: 2}
forces: {c: {type: state_feedback, joint: a, gains: {angle(b) - q: -8, rate(angle(b)): -2}}}
inputs: {set: {type: parameter, parameter: q}}
outputs: {load: load.theta}
"""
    for reference in ("{find: equilibrium, guess: {load: {theta: q}}}", "{coordinates: {load: {theta: q}}}"):
        model = mbstab.loads(f"{geared}reference: {reference}\n").state_space()
        gain, _, _ = FrequencyResponse(model).at(2j)
        assert gain.item() == pytest.approx(16 / (-20 + 8j + 16), rel=1e-12)


def test_resonances_are_drawn_between_printed_frequencies():
    """Without damping they leave the panel, and phases jump there."""
    result = answer(mbstab.load("gear_train.yaml").state_space(), points=30)
    upper, lower = response_picture(result, "").axes
    poles = sorted(p.imag for p in result.poles if p.imag > 1.0)
    for x, gain in (np.array(line.get_data()) for line in upper.get_lines() if len(line.get_xdata()) > 2):
        for pole in poles:
            near = np.abs(x / pole - 1.0) < 1e-3
            assert np.max(gain[near]) > upper.get_ylim()[1] or np.isnan(gain[near]).any()
    x, angle = np.array(lower.get_lines()[0].get_data())
    rising = np.flatnonzero(np.abs(np.diff(angle)) > 1.0)
    assert all(np.min(np.abs(x[k] / np.array(poles) - 1.0)) < 1e-3 for k in rising)
    printed = decibels(np.concatenate(result.values))
    assert upper.get_ylim()[0] < np.min(printed) < upper.get_ylim()[0] + 30.0


@pytest.mark.few(3)
@pytest.mark.parametrize("upper", [0.02, 0.5, 2.0, 4.0, 30.0])
@pytest.mark.parametrize("name", ["whipple_bicycle.yaml", "cart_pendulum.yaml"])
def test_phases_have_a_handful_of_marks_at_common_angles(name, upper):
    """Whether phases fill some degrees or several turns."""
    result = answer(mbstab.load(name).state_space(), ends=(0.01, upper), points=20)
    lower = response_picture(result, "").axes[1]
    low, high = lower.get_ylim()
    marks = np.array([x for x in lower.get_yticks() if low <= x <= high])
    assert 3 <= len(marks) <= 9
    assert high - low < 3.5 or set(np.diff(marks)) <= {1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0}


def test_constant_phases_have_marks_as_others_have():
    result = answer(mbstab.load("wheeled_inverted_pendulum.yaml").state_space(), ends=(2.0, 10.0), points=20)
    lower = response_picture(result, "").axes[1]
    low, high = lower.get_ylim()
    assert (low, high) == pytest.approx((-90.0, 90.0))
    assert set(np.diff([x for x in lower.get_yticks() if low <= x <= high])) == {30.0}


def test_outputs_over_time_share_a_panel_if_they_share_a_unit():
    car = response_picture(answer(mbstab.load("car.yaml").state_space(), points=20, duration=1.0), "")
    names = [f"yaw_rate after a unit step (rad/s/{unit})" for unit in ("rad", "N")]
    assert [axes.get_ylabel() for axes in car.axes] == names
    bicycle = response_picture(
        answer(mbstab.load("whipple_bicycle.yaml").state_space(), points=20, duration=1.0, impulse=True), ""
    )
    assert [axes.get_ylabel() for axes in bicycle.axes] == ["after a unit impulse (rad/(N·m·s))"]


def test_what_grows_is_drawn_until_it_has_grown_a_thousand_times():
    """Nothing of the first second would be seen of x'' = 16 x after 5 s: e^20."""
    text = (
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}\n"
        "forces: {spring: {type: expression, on: {p.x: k*p.x}}}\nparameters: {k: 16}\n"
        "inputs: {push: {type: force, at: p, direction: x}}\noutputs: {x: p.x}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    )
    model = mbstab.loads(text)
    for k, last, said in ((16, np.log(1e3) / 4.0, "grow without bound, and are drawn up to 1.73 s"), (-16, 5.0, "")):
        (axes,) = response_picture(answer(model.state_space(k=k), points=20, duration=5.0), "").axes
        assert axes.get_xlim() == pytest.approx((0.0, last))
        assert axes.get_lines()[0].get_xdata()[-1] == pytest.approx(last)
        assert (said or "time (s)") in axes.get_xlabel().replace("\n", " ")
        assert bool(said) == ("grow" in axes.get_xlabel())


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("differential.yaml", "at 0, 148.7 rad/s"),
        ("rack_and_pinion.yaml", "at 6.751 rad/s"),
        ("zener.yaml", ""),
        ("car.yaml", ""),
        ("car_trailer.yaml", ""),  # neutral motions that neither input nor output knows
    ],
)
def test_nyquist_diagrams_tell_where_they_close_at_infinity(name, text):
    figure = nyquist(answer(mbstab.load(name).state_space(), points=40), "")
    said = [x.get_text() for x in figure.legends[0].get_texts() if "infinity" in x.get_text()]
    assert len(said) == bool(text)
    assert all(text in x for x in said)


def test_fast_oscillations_over_time_are_drawn_as_they_are():
    """Between 20 printed values an oscillator turns 16 times: y = 1 - cos(100 t)."""
    text = (
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}\n"
        "forces: {spring: {type: expression, on: {p.x: -1e4*p.x}}}\n"
        "inputs: {push: {type: force, at: p, direction: x}}\noutputs: {x: 1e4*p.x}\n"
        "reference: {coordinates: {p: {x: 0, y: 0}}}\n"
    )
    result = answer(mbstab.loads(text).state_space(), points=20, duration=1.0)
    x, y = np.array(response_picture(result, "").axes[0].get_lines()[0].get_data())
    np.testing.assert_allclose(y, 1.0 - np.cos(100.0 * x), atol=1e-9)
    assert np.sum(np.diff(np.sign(np.diff(y))) != 0.0) == 31


def test_a_response_that_is_zero_by_a_gain_is_told(tmp_path):
    """A PID whose gains a parameter of 0 multiplies: its effort is identically zero, whatever the structure."""
    path = tmp_path / "cut.yaml"
    path.write_text(
        "mbstab: 1\nparameters: {loop: 0, K: 20}\nbodies: {rod: {type: planar, mass: 1, inertia: 1}}\n"
        "joints: {pin: {type: revolute, between: [rod, ground]}}\nforces:\n"
        "  hold: {type: joint_spring, joint: pin, stiffness: 3, damping: 1}\n"
        "  c: {type: pid, joint: pin, of: angle(pin), P: loop*K, lag: 0.01}\n"
        "inputs: {push: {type: joint, joint: pin}}\noutputs: {back: -effort(c), turn: angle(pin)}\n"
        "reference: {coordinates: {rod: {theta: 0}}}\n"
    )
    channels = json.loads(run("response", str(path), "--format", "json").stdout)["channels"]
    assert [x["vanishes"] for x in channels] == [True, False]
    assert "does not respond to the input" in run("response", str(path)).stdout
    assert run("response", str(path), "--set", "loop=1").stdout.count("does not respond") == 0


def test_phases_fall_across_an_undamped_pole_and_rise_across_an_undamped_zero():
    """(4 - ω²)/((1 - ω²)(9 - ω²)), as with the least damping; 1e-17 of either sign does not decide."""
    x = np.array([0.2, 0.6, 0.9, 1.1, 1.5, 1.9, 2.1, 2.5, 2.9, 3.1, 4.0, 6.0])
    for sign in (1.0, -1.0):
        values = (4 - x**2) / ((1 - x**2) * (9 - x**2)) * (1.0 + sign * 1e-17j * (-1.0) ** np.arange(len(x)))
        expected = np.where(x < 1, 0, np.where(x < 2, -180, np.where(x < 3, 0, -180)))
        np.testing.assert_allclose(phase(values), expected, atol=1e-9)


def test_a_step_response_of_an_unstable_plant_says_so():
    text = (
        "mbstab: 1\nparameters: {k: -4}\nbodies: {b: {type: planar_point, mass: 1}}\n"
        "forces: {s: {type: expression, on: {b.x: -k*b.x - rate(b.x)}}}\n"
        "inputs: {f: {type: force, at: b, direction: x}}\noutputs: {x: b.x}\nreference: {coordinates: {b: {x: 0}}}\n"
    )
    model = mbstab.loads(text)
    (said,) = answer(model.state_space(), duration=1.0).growth
    assert said == "the output grows without bound: the eigenvalue 1.56155 is unstable"
    assert answer(model.at(k=4).state_space(), duration=1.0).growth == ("",)


def test_frequencies_may_be_given_from_either_end():
    one, other = (
        run("response", "whipple_bicycle.yaml", "--input", "steer_torque", *ends).stdout
        for ends in (("--from", "1", "--to", "2"), ("--from", "2", "--to", "1"))
    )
    assert one == other
    assert "1 " in one


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(4))
def test_hidden_eigenvalues_that_grow_do_not_spoil_responses_over_time(seed):
    """States z, beside an oscillator, which the output does not see, or which the input does not reach."""
    rng = np.random.default_rng(seed)
    a, b, (c, d) = rng.uniform(0.3, 2.0), rng.uniform(-2.0, 2.0), rng.uniform(-1.0, 1.0, 2)
    unseen = f"z: {{rate: {a}*z + {b}*v + b.x}}, v: {{rate: {a}*v - {b}*z + rate(b.x)}}, w: {{rate: -w + z + v}}"
    beside = f"{c}*(rate(w) + w - z - v)"
    unreached = f"z: {{rate: {a}*z + {b}*v}}, v: {{rate: {a}*v - {b}*z}}, w: {{rate: -w + z + v}}"
    text = (
        "mbstab: 1\nbodies: {{b: {{type: planar_point, mass: 1}}}}\nconstraints: {{rail: {{holonomic: b.y}}}}\n"
        "states: {{{}}}\nforces: {{s: {{type: expression, on: {{b.x: -2*b.x - 3*rate(b.x)}}}}}}\n"
        "inputs: {{u: {{type: force, at: b, direction: x}}}}\noutputs: {{o: {}*b.x + {}, p: z + b.x}}\n"
        "reference: {{coordinates: {{b: {{x: 0, y: 0}}}}}}\n"
    )
    gain = 1.0 + d
    for states, more in ((unseen, beside), (unreached, f"{c}*w")):
        model = mbstab.loads(text.format(states, gain, more)).state_space()
        for impulse in (False, True):
            found = answer(model, ("u",), ("o",), duration=80.0, points=9, impulse=impulse)
            t = found.x
            exact = np.exp(-t) - np.exp(-2 * t) if impulse else 0.5 - np.exp(-t) + 0.5 * np.exp(-2 * t)
            np.testing.assert_allclose(found.values[0], gain * exact, atol=1e-11)
            assert found.growth == ("",)
            # Pictures draw the same motion.
            np.testing.assert_array_equal(found.channels[0].step(t, impulse), found.values[0])
    # What sees one of them grows.
    (found,) = answer(mbstab.loads(text.format(unseen, 1, beside)).state_space(), ("u",), ("p",), duration=20.0).growth
    assert "grows without bound" in found


DRIFTING = """
mbstab: 1
parameters: {T: 0.5, F0: 4}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: b.y}}
states: {s: {rate: (F0 - s)/T, unit: N}}
forces: {f: {type: expression, on: {b.x: -9*b.x*(1 + b.x**2) + s - 2*rate(b.x)}}}
inputs: {push: {type: force, at: b, direction: x}}
outputs: {x: b.x}
reference: {coordinates: {b: {x: 0}}}
"""


def test_a_state_that_is_not_at_rest_is_told_wherever_a_linear_model_is_used(tmp_path):
    told = "the reference is not at rest: the state s changes by 8 N/s"
    drifting = mbstab.loads(DRIFTING)
    assert drifting.eig().verdict == "undecided"
    assert any(told in x for x in drifting.eig().judged.reasons)
    assert any(told in x for x in drifting.response().warnings)
    path = tmp_path / "drifting.yaml"
    path.write_text(DRIFTING, encoding="utf-8")
    assert told in " ".join(run("linearize", str(path)).stderr.split())
    assert drifting.response(frozen=True).warnings == ()
    found = DRIFTING.replace("{coordinates: {b: {x: 0}}}", "{find: equilibrium}")
    assert mbstab.loads(found).response().warnings == ()


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["dc_motor_arm", "whipple_bicycle", "levitation"])
def test_phases_in_tables_are_within_half_a_turn(name):
    """Also where the curve without jumps goes on to -355 degrees; -180 is written 180."""
    answer = mbstab.load(f"{name}.yaml").response()
    lines = run("response", f"{name}.yaml").stdout.splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("ω (rad/s)"))
    rows = [line.split() for line in lines[head + 2 :]]
    rows = rows[: rows.index([])]
    places = [int(np.argmin(np.abs(answer.x - float(row[0])))) for row in rows]
    assert {0, len(answer.x) - 1} <= set(places)
    truth = np.degrees(np.angle(answer.values[0][places]))
    assert np.ptp(phase(answer.values[0])) > 150.0
    for row, x in zip(rows, truth, strict=True):
        assert -180.0 < float(row[3]) <= 180.0
        assert float(row[3]) == pytest.approx(x, rel=2e-5)


def test_the_phase_of_a_negative_number_is_180_degrees():
    values = np.array([-1.0 - 0.0j, -1.0 + 0.0j, -1.0 + 1.0j, 0.0, np.inf])
    np.testing.assert_array_equal(angles(values), [180.0, 180.0, 135.0, np.nan, np.nan])
    assert _degrees(-179.9999999) == "180"


@pytest.mark.parametrize("name", ["dc_motor_arm", "robot_arm", "whipple_bicycle", "cart_pendulum"])
def test_states_are_in_the_order_of_the_file(name):
    model = mbstab.load(f"{name}.yaml")
    found = [x["name"] for x in json.loads(run("linearize", f"{name}.yaml", "--format", "json").stdout)["states"]]
    bodies = [f"{body.name}.{c}" for body in model.system().scene.bodies for c in body.coordinates]
    order = [*bodies, *model.model.states, *(f"rate({x})" for x in bodies)]
    assert found == sorted(found, key=order.index)


def test_a_phase_shows_no_digits_below_its_bound():
    """At resonance a rate is in phase with the force; -2.5e-14 degrees were printed."""
    rod = (
        "mbstab: 1\nbodies: {r: {type: planar, mass: 5, inertia: 0.1, points: {o: [-0.9, 0]}}}\n"
        "joints: {p: {type: revolute, between: [r.o, ground]}}\n"
        "forces: {s: {type: joint_spring, joint: p, stiffness: 70.45, damping: 20}}\n"
        "inputs: {T: {type: joint, joint: p}}\noutputs: {w: rate(r.theta)}\n"
        "reference: {coordinates: {r: {theta: 0}}}\n"
    )
    resonance = (70.45 / (0.1 + 5 * 0.9**2)) ** 0.5
    found = mbstab.loads(rod).response("T", "w", ends=(resonance, 2.0 * resonance), points=2)
    assert np.angle(found.values[0][0])  # not 0 in doubles
    assert response_text(found, "").splitlines()[3].split()[3] == "0"
