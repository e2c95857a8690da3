"""The search for an equilibrium does not depend on how fast states follow, or in which unit they are."""

import math

import pytest

import mbstab
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.errors import EquilibriumError, ModelFileError

ARM = """\
mbstab: 1
parameters: {T: 0.005, P: 300, I: 400, D: 20, Tf: 0.002}
gravity: [0, -9.81]
bodies: {arm: {type: planar, mass: 4, inertia: 0.1, points: {a: [-0.3, 0]}}}
joints: {axle: {type: revolute, between: [arm.a, ground]}}
forces:
  c: {type: pid, joint: axle, of: angle(axle), target: 0.5, P: P, D: D, filter: Tf, lag: TGIVEN}
reference: {find: equilibrium, guess: {arm: {theta: 0.4}}}
"""
INTEGRATING = mbstab.loads(ARM.replace("GIVEN", ", I: I"))
SAGGING = mbstab.loads(ARM.replace("GIVEN", ""))


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
    assert at["c_integral"] * (value if name == "I" else 400) == pytest.approx(torque, rel=1e-9)


def test_the_loop_of_an_arm_that_carries_weight_is_cut_as_the_manual_says():
    parameters = "hold: 4*9.81*0.3*cos(0.5), loop: 0, T"
    cut = "  cut: {type: expression, on: {angle(axle): -(1 - loop)*(c_effort - hold)}}\nreference"
    inputs = "inputs: {u: {type: joint, joint: axle}}\noutputs: {y: -c_effort}\nreference"
    text = ARM.replace("GIVEN", ", I: I").replace("{T", f"{{{parameters}", 1).replace("reference", cut, 1)
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
    assert mbstab.loads(ARM.replace("GIVEN", ", I: 0").replace("-9.81", "0")).motion().at_rest


def test_forces_out_of_balance_are_told_of_the_body_and_not_of_a_state_that_follows_it():
    text = (
        "mbstab: 1\nbodies: {cart: {type: planar_point, mass: 2}}\nconstraints: {rail: {holonomic: cart.y}}\n"
        "states: {u: {rate: (-40*rate(cart.x) - u)/0.001}}\nforces: {f: {type: expression, on: {cart.x: 5 + u}}}\n"
        "reference: {coordinates: {cart: {x: 0}}}\n"
    )
    with pytest.raises(ModelFileError, match=r"cart\.x would accelerate with 2\.5 m/s\^2 \(unbalanced 5 N\)"):
        mbstab.loads(text).eig()
