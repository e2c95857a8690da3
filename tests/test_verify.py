"""The nonlinear motion confirms right eigenvalues and contradicts wrong ones."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from sampling import sample
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.compare import verify
from mbstab.analysis.compare.tolerances import TOLERANCES as COMPARE
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.spectrum import eigenvalues
from mbstab.cli import main

EXAMPLES = [
    ("pendulum", {}),
    ("wheeled_inverted_pendulum", {}),
    ("top", {"omega": 4}),
    ("top", {"omega": 10}),
    ("rolling_disk", {"omega": 1}),
    ("rolling_disk", {}),
    ("double_pendulum", {}),
    ("slider_crank", {}),
    ("four_bar", {}),
    ("ziegler_column", {}),
    ("ziegler_column", {"b_1": 1, "b_2": 1}),
    ("free_rigid_body", {}),
    ("rolling_torus", {}),
    ("rattleback", {}),
    ("rotating_pendulum", {}),
    ("bead_on_hoop", {}),
    ("von_mises_truss", {}),
    ("bricard", {}),
    ("chaplygin_sleigh", {}),
    ("trailer", {}),
    ("shimmy", {}),
    ("wheelset", {}),
    ("whipple_bicycle", {"v": 1}),
    ("whipple_bicycle", {"v": 5}),
    ("kapitza", {"nu": 60}),
    ("kapitza", {}),
]


@pytest.mark.parametrize(("name", "parameters"), sample(EXAMPLES, 4), ids=str)
def test_rates_and_frequencies_of_the_examples_are_those_of_the_nonlinear_motion(name, parameters):
    found = mbstab.load(f"{name}.yaml").verify(**parameters)
    # A disk whose Cardan angle is driven has zeros that nothing explains.
    assert found.verdict == ("confirmed" if found.result.verdict != "undecided" else "cannot be judged")
    assert found.result.verdict != "undecided" or (name, parameters) == ("rolling_disk", {})
    zeros = [mode for mode in found.modes if "it is zero" in mode.reason]
    assert all(mode.kind == "undecided" for mode in zeros)
    for mode in found.modes:
        if mode in zeros:
            continue
        assert mode.verdict == "confirmed"
        assert mode.error <= 1e-5
        assert mode.uncertainty <= 1e-4 * abs(mode.predicted)
    if found.result.counts.neutral:
        assert found.neutral.verdict == "confirmed"
        assert found.neutral.count >= found.result.counts.neutral + len(zeros)
        assert found.neutral.error <= 2e-5  # of motions that are not small: of second order
    else:
        assert found.neutral is None
    if found.result.verdict == "unstable":
        fastest = max(e.value.real for e in found.result.eigenvalues)
        grown = max(mode.observed.real for mode in found.modes)
        assert grown == pytest.approx(fastest, rel=1e-6)
        assert "grows with" in found.reason


@pytest.mark.parametrize(
    ("name", "true", "frozen"),
    sample(
        [
            ("rotating_pendulum", complex(0.0, math.sqrt(64.0 - (9.81 / 4.0) ** 2)), 8.0),
            ("governor_paper", -0.271958656303631506 + 12.182367622566508j, 12.762),
        ],
        every=2,
    ),
)
def test_the_motion_decides_between_the_turning_frame_and_frozen_time(name, true, frozen):
    model = mbstab.load(f"{name}.yaml")
    (mode,) = model.verify().modes
    assert mode.verdict == "confirmed"
    assert abs(mode.observed - true) <= 1e-6 * abs(true)
    found = model.verify(frozen=True)
    (mode,) = (mode for mode in found.modes if mode.predicted.imag)
    assert mode.predicted.imag == pytest.approx(frozen, abs=1e-3)
    assert abs(mode.observed - true) <= 1e-6 * abs(true)
    assert (mode.verdict, found.verdict) == ("contradicted", "contradicted")
    assert mode.error > 0.04


def test_a_wrong_prediction_is_contradicted(monkeypatch):
    def shifted(system, **options):
        result = answer(system, **options)
        return replace(result, eigenvalues=[replace(e, value=e.value * 1.001) for e in result.eigenvalues])

    answer = verify.answer
    monkeypatch.setattr(verify, "answer", shifted)
    found = mbstab.load("pendulum.yaml").verify()
    assert found.verdict == "contradicted"
    assert found.modes[0].error == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "exact"), sample([("pendulum", 6.065269986j), ("governor_paper", -0.2719587 + 12.1823676j)], 2)
)
def test_wrong_linearized_equations_are_contradicted_though_their_modes_are_excited(name, exact, monkeypatch):
    def stiffer(*arguments, **options):
        linear = linearize(*arguments, **options)
        return replace(linear, K=1.002 * linear.K)

    linearize = verify.linearize
    monkeypatch.setattr(verify, "linearize", stiffer)
    monkeypatch.setattr(eigenvalues, "linearize", stiffer)
    (mode,) = mbstab.load(f"{name}.yaml").verify().modes
    assert mode.verdict == "contradicted"
    assert mode.error == pytest.approx(1e-3, rel=0.05)
    assert abs(mode.observed - exact) <= 3e-5 * abs(exact)


def test_what_is_not_steady_cannot_be_judged():
    text = """\
mbstab: 1
gravity: [0, -9.81]
bodies: {p: {type: planar_point, mass: 1}}
joints: {rope: {type: distance, between: [p, ground], length: 1}}
reference: {coordinates: {p: {x: 1, y: 0}}, rates: {p: {x: 0, y: 2}}}
"""
    found = mbstab.loads(text).verify()
    assert found.verdict == "cannot be judged"
    assert "neither steady nor declared as periodic" in found.reason
    assert all(mode.verdict == "cannot be judged" for mode in found.modes)


def test_an_eigenvalue_without_a_mode_of_its_own_cannot_be_judged():
    # Critical damping: both eigenvalues are -1, with one vector.
    text = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
constraints: {line: {holonomic: p.y}}
forces: {f: {type: expression, on: {p.x: -p.x - 2*rate(p.x)}}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""
    found = mbstab.loads(text).verify()
    assert found.result.verdict == "asymptotically stable"
    assert found.verdict == "cannot be judged"
    assert all(mode.verdict == "cannot be judged" for mode in found.modes)


def test_equal_eigenvalues_with_modes_of_their_own_are_confirmed():
    text = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {p.x: -4*p.x - p.x**3, p.y: -4*p.y}}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""
    found = mbstab.loads(text).verify()
    assert found.verdict == "confirmed"
    assert [mode.observed.imag for mode in found.modes] == pytest.approx([2.0, 2.0], rel=1e-8)


def test_a_stiff_motion_is_followed_by_an_implicit_integrator():
    text = """\
mbstab: 1
bodies: {p: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {p.x: -p.x, p.y: -1e6*p.y - 1e6*rate(p.y)}}}
reference: {coordinates: {p: {x: 0, y: 0}}}
"""
    found = mbstab.loads(text).verify()
    slow = min(found.modes, key=lambda mode: abs(mode.predicted.imag - 1.0))
    assert slow.verdict == "confirmed"
    assert found.verdict == "confirmed"
    assert found.evaluations < 20_000


def point(force):
    return mbstab.loads(f"""\
mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}}}
joints: {{r: {{type: point_on_line, between: [ground, a], axis: x}}}}
forces: {{s: {{type: expression, on: {{a.x: "{force}"}}}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}
""").verify()


@pytest.mark.parametrize(
    "force",
    ["-400*a.x - 5*tanh(rate(a.x)/1e-3)", "-tanh(1e7*a.x)", "-4*a.x + 1e6*rate(a.x)**3", "-4*a.x + 1e3*rate(a.x)**3"],
)
def test_a_small_linear_range_is_found_by_smaller_amplitudes(force):
    found = point(force)
    assert all(mode.verdict == "confirmed" for mode in found.modes)
    # Nothing holds a pair on the axis that a cubic push by the rate makes grow.
    pushed = "**3" in force
    assert (found.result.verdict == "undecided") == pushed
    assert found.verdict == ("cannot be judged" if pushed else "confirmed")
    assert min(mode.amplitude for mode in found.modes) < COMPARE.mode_amplitude
    for mode in found.modes:
        assert mode.error <= 1e-5
        assert abs(mode.observed - mode.predicted) <= COMPARE.uncertainties_of_observation * mode.uncertainty


@pytest.mark.parametrize("width", [1e-4, 1e-5, 1e-6, 1e-8])
def test_a_linear_range_below_rounding_contradicts_nothing(width):
    found = point(f"-400*a.x - 5*tanh(rate(a.x)/{width})")
    assert found.verdict != "contradicted"
    for mode in found.modes:
        assert mode.verdict != "confirmed" or mode.error <= 1e-5
        assert mode.verdict == "confirmed" or mode.reason


@pytest.mark.parametrize("force", ["-400*a.x + 1e-6*rate(a.x)", "-4*a.x + 1e-8*rate(a.x)"])
def test_growth_that_is_too_slow_to_be_seen_is_not_confirmed(force):
    found = point(force)
    (mode,) = found.modes
    assert found.result.verdict == "unstable"
    assert (found.verdict, mode.verdict) == ("cannot be judged", "cannot be judged")
    assert "frequency confirmed; growth too small to be seen" in mode.reason
    assert "no mode grows" not in found.reason


def test_slow_growth_that_is_seen_is_confirmed():
    found = point("-4*a.x + 1e-5*rate(a.x)")
    assert found.verdict == "confirmed"
    assert "mode 1 grows with 4.9998" in found.reason


CARRIED = """\
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{p.x: "1 - rate(p.x)", p.y: "{force}"}}}}}}
reference: {{coordinates: {{p: {{x: 0, y: 0}}}}, rates: {{p: {{x: 1, y: 0}}}}}}
"""


@pytest.mark.parametrize(
    ("force", "verdict"),
    [
        # Along y nothing is a symmetry but of the linearized equations: motions leave in the end.
        ("-rate(p.y) + p.y**3", "cannot be judged"),
        ("-rate(p.y) - p.y", "confirmed"),
        ("-rate(p.y)", "confirmed"),
    ],
)
def test_a_carried_point_is_confirmed_only_where_every_zero_is_explained(force, verdict):
    found = mbstab.loads(CARRIED.format(force=force)).verify()
    assert found.verdict == verdict
    assert (found.result.verdict in ("undecided", "unstable")) == (verdict == "cannot be judged")


def zoo(name):
    return mbstab.loads(next(s.text for s in SYSTEMS if s.name == name)).verify()


def test_a_family_of_rests_without_any_stiffness_is_followed_at_its_own_pace():
    found = zoo("Roberval balance, tilted")
    assert (found.result.verdict, found.verdict) == ("stable up to symmetry", "confirmed")
    assert (found.neutral.count, found.neutral.staying, found.neutral.power) == (2, 1, 1)


def test_zeros_that_nothing_explains_contradict_nothing():
    # They are 3e-5 1/s beside 1e6 1/s.
    found = zoo("slow growth hidden by a coupling")
    assert (found.result.verdict, found.verdict) == ("undecided", "cannot be judged")
    assert "zeros that nothing explains" in found.neutral.reason


@pytest.mark.parametrize("law", ["1 - 2*smooth_start((t - 50)/10)", "1 - tanh(t - 50)", "1 + 0.5*sin(2*pi*t/3)"])
def test_what_depends_on_the_time_is_not_confirmed_by_motions_of_now(law):
    found = point(f"-({law})*a.x - 0.2*rate(a.x)")
    assert found.result.verdict == "undecided"
    assert found.verdict != "confirmed"


def test_periodic_motions_are_confirmed_in_the_new_words():
    damped = mbstab.loads(
        "\n".join(mbstab.load("kapitza.yaml").model.document.lines).replace(
            "\nreference:\n",
            "\nforces: {brake: {type: expression, on: {rod.theta: -0.01*rate(rod.theta)}}}\nreference:\n",
        )
    ).verify()
    assert (damped.result.verdict, damped.verdict) == ("asymptotically stable", "confirmed")
    assert damped.reason.startswith("all modes decay")


# --- neutral directions ---------------------------------------------------------------------------------------------


def free(force="-9*a.y", more=""):
    return mbstab.loads(f"""\
mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}}}
forces: {{s: {{type: expression, on: {{a.y: "{force}"{more}}}}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}
""")


def test_a_free_coordinate_stays_and_its_speed_drifts():
    found = free().verify()
    assert found.verdict == "confirmed"
    assert "neutral directions do what the linearized equations say" in found.reason
    assert (found.neutral.count, found.neutral.staying, found.neutral.power) == (2, 1, 1)
    assert 0.0 < found.neutral.span < 100.0
    # With a damper the speed decays: no direction drifts.
    found = free(more=', a.x: "-2*rate(a.x)"').verify()
    assert (found.neutral.count, found.neutral.staying, found.neutral.power) == (1, 1, 0)
    assert found.neutral.verdict == "confirmed"


def test_a_wrong_prediction_along_neutral_directions_is_contradicted(monkeypatch):
    # As if speeds did not move anything.
    monkeypatch.setattr(verify.neutral_drift, "flow", lambda A, times: [np.eye(len(A))] * len(times))
    found = free().verify()
    assert found.modes[0].verdict == "confirmed"
    assert (found.neutral.verdict, found.verdict) == ("contradicted", "contradicted")
    assert "displaced along a neutral direction is off by" in found.reason


def test_what_depends_on_the_amplitude_along_a_neutral_direction_is_not_judged():
    found = free(more=', a.x: "-1e12*a.x**3"').verify()
    assert found.neutral.verdict == "cannot be judged"
    assert "depends on the amplitude" in found.neutral.reason
    assert found.verdict == "cannot be judged"


def test_an_undecided_zero_is_tried_as_a_neutral_direction():
    found = mbstab.load("wheelset_no_slip.yaml").verify(v=0)
    assert (found.result.verdict, found.verdict) == ("undecided", "cannot be judged")
    assert all("it is zero" in mode.reason for mode in found.modes)
    assert found.result.counts.neutral + len(found.modes) == 4
    assert (found.neutral.verdict, found.neutral.count, found.neutral.staying) == ("confirmed", 4, 3)


def test_neutral_directions_of_a_periodic_motion_are_followed_by_periods():
    # Mathieu's equation in y, nothing in x.
    text = free("-(4 + cos(3*t))*a.y").model.document.lines
    found = mbstab.loads("\n".join(text).replace("reference: {", "reference: {period: 2*pi/3, ")).verify()
    assert found.result.counts.neutral == 2
    assert (found.neutral.verdict, found.neutral.staying, found.neutral.power) == ("confirmed", 1, 1)
    assert found.neutral.span == pytest.approx(COMPARE.periodic_rounds * 2.0 * math.pi / 3.0)


@pytest.mark.parametrize(
    ("matrix", "exact", "told"),
    [
        ([[0.0, 1.0, 5.0], [0.0, 0.0, 1.0], [0.0, 0.0, -2.0]], [0j, 0j], True),
        ([[0.0, 1.0], [-4.0, 0.0]], [2j, -2j], True),
        ([[1e-9, 0.0], [0.0, 1e-8]], [0j], False),
    ],
)
def test_the_invariant_subspace_is_that_of_the_given_eigenvalues(matrix, exact, told):
    matrix = np.array(matrix)
    basis = verify.neutral_drift.invariant_subspace(matrix, exact)
    assert (basis is not None) == told
    if told:
        inner = basis.T @ matrix @ basis
        np.testing.assert_allclose(basis.T @ basis, np.eye(len(exact)), atol=1e-14)
        np.testing.assert_allclose(matrix @ basis, basis @ inner, atol=1e-13)
        np.testing.assert_allclose(sorted(np.linalg.eigvals(inner), key=np.imag), sorted(exact, key=np.imag), atol=1e-7)


# --- the command ----------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["eig", *arguments, "--verify"])


def test_the_table_shows_prediction_and_observation():
    result = run("rotating_pendulum.yaml")
    assert result.exit_code == 0
    assert "Verdict: stable" in result.stdout
    assert "0 ± 7.61480" in result.stdout
    assert "Nonlinear motion: confirmed" in result.stdout
    assert "confirmed: real and imaginary part each within 3 times" in result.stdout
    assert "amplitude 2e-05 of the sizes" in result.stdout


@pytest.mark.few(1)
@pytest.mark.parametrize("form", ["table", "json"])
def test_a_contradiction_is_answered_and_has_an_exit_code(form):
    result = run("rotating_pendulum.yaml", "--frozen", "--format", form)
    assert result.exit_code == 3
    assert "contradicted" in result.stdout
    assert "the nonlinear motion contradicts the eigenvalues: mode 1: " in result.stderr
    # What cannot be judged is an answer, as "undecided" is.
    assert run("top.yaml", "--set", "omega=10").exit_code == 0


def test_neutral_directions_are_in_the_table_and_in_json():
    shown = " ".join(run("rolling_disk.yaml").stdout.split())
    assert "4 neutral directions tried: 2 stay constant, 2 drift like t^2, as the linearized equations" in shown
    found = json.loads(run("rolling_disk.yaml", "--format", "json").stdout)["verification"]["neutral"]
    assert (found["count"], found["staying"], found["power"], found["verdict"]) == (4, 2, 2, "confirmed")
    assert json.loads(run("pendulum.yaml", "--format", "json").stdout)["verification"]["neutral"] is None


def test_the_json_answer_has_the_modes():
    data = json.loads(run("top.yaml", "--set", "omega=4", "--format", "json").stdout)
    found = data["verification"]
    assert data["verdict"] == "unstable"
    assert found["verdict"] == "confirmed"
    assert found["modes"][0]["observed"]["real"] == pytest.approx(2.451223, abs=1e-6)
    assert set(found["modes"][0]) >= {"number", "predicted", "observed", "error", "uncertainty", "verdict", "reason"}


@pytest.mark.parametrize(
    "extra", [("--certify",), ("--precision", "30"), ("--method", "index3"), ("--format", "csv")], ids=str
)
def test_what_it_does_not_go_with_is_said(extra):
    result = run("pendulum.yaml", *extra)
    assert result.exit_code == 2
    assert "--verify goes with none of" in result.stderr


@pytest.mark.parametrize("size", [3e-7, 1e-5, 1e-3, 1.0])
def test_coefficients_that_hardly_change_say_by_how_much(size):
    text = """\
mbstab: 1
gravity: [0, -10]
bodies: {rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [0, 0.5]}}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
forces: {shake: {type: force, at: rod, vector: [0, SIZE*sin(t)]}}
reference: {coordinates: {rod: {theta: 0}}}
"""
    result = mbstab.loads(text.replace("SIZE", str(size))).verify()
    for said in (result.reason, result.result.reasons[0]):
        change = re.search(r"change by (\S+)% along", said)
        assert size / 100.0 < float(change[1]) / 100.0 < size
        assert ("1e-06%" in said) == (float(change[1]) < 0.1)


def test_work_is_not_added_up_where_nobody_asks_for_it(monkeypatch):
    def power(*arguments):
        raise AssertionError

    monkeypatch.setattr(Energy, "powers", power)
    assert mbstab.load("ziegler_column.yaml").verify(b_1=1, b_2=1).verdict == "confirmed"
