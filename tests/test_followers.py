"""States that only watch a scene: what they watch keeps its verdict, its family of motions and its drift."""

import numpy as np
import pytest

import mbstab
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.verdict.facts import Grounds
from mbstab.compiler.system import System
from mbstab.model.values import evaluate
from mbstab.model.words import ASYMPTOTIC_UP_TO, STABLE_UP_TO, UNDECIDED, UNSTABLE

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


@pytest.mark.parametrize("states", ["", LAG, RATES, CASCADE, PAIR, CUBIC])
@pytest.mark.parametrize(("force", "word"), [(DAMPED, ASYMPTOTIC_UP_TO), (UNDAMPED, STABLE_UP_TO)])
def test_the_drift_of_a_free_shaft_is_told_whatever_watches_it(states, force, word):
    mechanism = shafts(states, force)
    found = mechanism.eig()
    assert found.verdict == word
    assert found.counts.neutral == 2
    assert "goes on growing like t" in found.reasons[0]
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
    assert "goes on growing like t" in found.reasons[0]


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
    assert "goes on growing like t" in found.reasons[0]
    assert any(e.value == pytest.approx(-200.0, rel=1e-12) for e in found.eigenvalues)
    closed = mbstab.loads(ARM.format(loop=1)).eig()
    assert closed.counts.neutral == 0


@pytest.mark.parametrize(("states", "expected"), [(RATES, [-10.0]), (CASCADE, [-10.0, -1.0])])
def test_disturbances_of_states_alone_stay_such(states, expected):
    """S F = F A with the eigenvalues of the states alone, although their rates contain those of bodies."""
    system = System(evaluate(shafts(states).model))
    grounds = Grounds(linearize(system, reference_motion(system)))
    F, S = grounds.structure.followers, grounds.S
    A = np.linalg.lstsq(F, S @ F, rcond=None)[0]
    assert np.max(np.abs(S @ F - F @ A)) < 1e-12 * np.max(np.abs(S))
    assert np.sort(np.linalg.eigvals(A)) == pytest.approx(expected, rel=1e-12)
