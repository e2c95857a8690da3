"""Work and precision of the integrators on one motion."""

import csv
import io
import json
import math
import re
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.special import ellipj, ellipk

import mbstab
from mbstab.analysis.compare import integrators
from mbstab.analysis.compare.tolerances import TOLERANCES as COMPARE
from mbstab.cli import main
from mbstab.errors import NumericalError, SimulationError, UsageError

PENDULUM = mbstab.load("pendulum.yaml")
NAMES = ["DOP853", "RK45", "Radau", "BDF", "alpha", "radau"]


@cache
def compared():
    return PENDULUM.compare_integrators(0.5, {"rod.theta": math.pi / 4}, 1e-6)


@pytest.mark.long
def test_the_reference_is_the_exact_solution():
    result = compared()
    k, rate = math.sin(math.pi / 8), math.sqrt(3.0 * 9.81 / 0.8)
    sn = ellipj(ellipk(k * k) - rate * 0.5, k * k)[0]
    assert result.final[2] - 1.5 * math.pi == pytest.approx(2.0 * math.asin(k * sn), abs=1e-12)
    assert result.known <= 1e-11


@pytest.mark.long
def test_errors_are_the_global_ones_of_simulations():
    result = compared()
    run = next(x for x in result.runs if (x.name, x.tol) == ("RK45", 1e-5))
    # As in tests of simulations: places, orientations and speeds at any time, against the elliptic functions.
    times = np.linspace(0.0, 0.5, COMPARE.output_times)
    k, rate = math.sin(math.pi / 8), math.sqrt(3.0 * 9.81 / 0.8)
    sn, cn, dn, _ = ellipj(ellipk(k * k) - rate * times, k * k)
    angle = 2.0 * np.arcsin(k * sn)
    speed = -2.0 * k * rate * cn * dn / np.cos(0.5 * angle)
    # The single run of a simulation takes another rate as fast, that of compare the one of its reference.
    assert run.error == pytest.approx(_error_of_rk45(angle, speed), rel=1e-3)
    assert 0.0 < result.known <= COMPARE.reference_error


def _error_of_rk45(angle, speed):
    system = PENDULUM.system()
    begin = integrators.start_of(system, {"rod.theta": math.pi / 4})
    follower = integrators.Follower(begin.system, begin.motion, np.linspace(0.0, 0.5, COMPARE.output_times))
    race = integrators._Race(follower, np.inf)
    race.reference()
    run, _ = race.run(integrators.METHODS["projection"]["RK45"], 1e-5, 10.0)
    q, u = integrators.states(run.stretches)
    found = np.stack([q[:, 2] - 1.5 * math.pi, u[:, 2]], axis=1)
    fast = np.max(np.abs(speed))
    return max(
        np.max(np.abs(np.sin(found[:, 0]) - np.sin(angle))),
        np.max(np.abs(np.cos(found[:, 0]) - np.cos(angle))),
        np.max(np.abs(found[:, 1] - speed)) / fast,
    )


@pytest.mark.long
def test_smaller_tolerances_leave_smaller_errors_and_cost_more():
    result = compared()
    for name in NAMES:
        runs = [x for x in result.runs if x.name == name]
        assert [x.tol for x in runs] == list(COMPARE.step_tolerances)
        done = [x for x in runs if not x.failure]
        assert len(done) >= 3
        errors = [x.error for x in done]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] < 1e-3 * errors[0]
        assert [x.evaluations for x in done] == sorted(x.evaluations for x in done)
        assert all(x.constraints <= 1e-4 for x in done)
        assert done[-1].energy < 1e-4


@pytest.mark.long
def test_the_chosen_integrator_is_the_fastest_that_keeps_the_tolerance():
    result = compared()
    good = [x for x in result.runs if x.error <= 1e-6]
    assert result.chosen in good
    assert result.chosen.seconds <= COMPARE.equal_times * min(x.seconds for x in good)


def test_a_reference_at_rest_is_disturbed_by_its_first_mode(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.compare.tolerances.Tolerances.step_tolerances", (1e-4,))
    result = PENDULUM.compare_integrators(0.2)
    assert result.disturbance == {"mode:1": 0.1}
    assert all(x.error > 0.0 for x in result.runs)


@pytest.mark.long
def test_angles_may_pass_their_singularity_within_a_step(monkeypatch):
    # The shaft turns by a quarter in 0.157 s, and with it theta of the cranks passes pi/2.
    tolerances = "mbstab.analysis.compare.tolerances.Tolerances."
    monkeypatch.setattr(tolerances + "step_tolerances", (1e-3,))
    monkeypatch.setattr(tolerances + "integration_time", 100.0)
    monkeypatch.setattr(tolerances + "comparison_time", 1000.0)
    result = mbstab.load("governor.yaml").compare_integrators(0.2)
    assert [x.failure for x in result.runs] == [""] * len(NAMES)
    assert max(x.error for x in result.runs) < 0.1


def test_what_takes_too_long_is_given_up(monkeypatch):
    run = integrators._Race.run

    def short(self, method, tol, limit):
        return run(self, method, tol, limit if limit > COMPARE.integration_time else 0.0)

    monkeypatch.setattr(integrators._Race, "run", short)
    result = PENDULUM.compare_integrators(0.5, {"rod.theta": 0.5})
    assert re.match(r"given up after \S+ s, when \d+% was done", result.runs[0].failure)
    assert result.runs[1].failure == "not tried: a larger tolerance took too long"
    assert np.isnan(result.runs[0].error)
    with pytest.raises(NumericalError, match=r"no integrator keeps 0\.001"):
        PENDULUM.compare_integrators(0.5, {"rod.theta": 0.5}, 1e-3)


def test_the_whole_comparison_keeps_within_its_budget(monkeypatch):
    spent, limits = iter(np.arange(0.0, 1e4, 3.0)), []

    def given_up(self, method, tol, limit):
        limits.append(limit)
        raise NumericalError("given up after this run")

    monkeypatch.setattr(integrators.time, "process_time", lambda: next(spent))
    race = integrators._Race(None, 15.0)
    monkeypatch.setattr(integrators._Race, "run", given_up)
    for left in (6, 5, 4, 3, 2, 1):
        race.share(left)
        with pytest.raises(NumericalError, match="given up"):
            race.measured("alpha", "", None, 1e-3, None)
    assert limits[0] < COMPARE.integration_time
    assert limits[2:] == [0.0] * 4
    # Forced, a single run is all that is limited.
    race = integrators._Race(None, np.inf)
    race.share(6)
    with pytest.raises(NumericalError, match="given up"):
        race.measured("alpha", "", None, 1e-3, None)
    assert limits[-1] == COMPARE.integration_time


def test_a_pace_that_is_too_slow_is_given_up_early(monkeypatch):
    times = iter([0.0, 0.9, 1.1, 1.1])
    monkeypatch.setattr(integrators.time, "process_time", lambda: next(times))
    watch = integrators._watch(4.0, 1.0)
    watch(0.001)
    watch(0.2)
    with pytest.raises(NumericalError, match=r"given up after 1\.1 s, when 18% was done"):
        watch(0.18)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"to": -1.0}, UsageError, "must be later than its start"),
        ({"tolerance": 2.0}, UsageError, "above 0 and below 1"),
        ({"perturb": {"rod.tetha": 1}}, UsageError, "no coordinate 'rod.tetha'"),
    ],
)
def test_wrong_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        PENDULUM.compare_integrators(**arguments)


def test_a_motion_that_cannot_be_followed_is_said():
    with pytest.raises(SimulationError, match="no reference to compare with: the mechanism is at a singular"):
        mbstab.load("four_bar.yaml").compare_integrators(1.0, {"rate(left.theta)": 9.0})


# --- the command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.compare.tolerances.Tolerances.step_tolerances", (1e-3, 1e-5))


def run(*arguments):
    return CliRunner().invoke(main, ["compare", "pendulum.yaml", "--to", "0.2", *arguments])


def test_table_json_csv_and_picture(few, tmp_path):
    picture, drawn = tmp_path / "p-error.svg", ("--plot", "error", "--pictures", str(tmp_path / "p.svg"))
    result = run("--simulate", "--perturb", "rod.theta=pi/4", "--tol", "1e-3", *drawn)
    assert result.exit_code == 0
    assert all(name in result.stdout for name in NAMES)
    assert "Chosen for 0.001: " in result.stdout
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    data = json.loads(run("--simulate", "--format", "json").stdout)
    assert data["disturbance"] == {"mode:1": 0.1}
    assert len(data["runs"]) == 12
    assert set(data["runs"][0]) >= {
        "method",
        "solver",
        "tol",
        "error",
        "seconds",
        "evaluations",
        "energy",
        "constraints",
    }
    head, *rows = csv.reader(io.StringIO(run("--simulate", "--format", "csv").stdout))
    assert head[:4] == ["method", "solver", "tol", "error"]
    assert len(rows) == 12


def test_options_of_the_simulation_need_it():
    result = run("--perturb", "rod.theta=1")
    assert result.exit_code == 2
    assert "--to, --perturb have no effect without --simulate\nhint: leave them out" in result.stderr


def test_digits_of_eigenvalues_are_refused_where_there_are_none():
    result = run("--simulate", "--digits", "50")
    assert result.exit_code == 2
    assert "--digits has no effect with --simulate\nhint: leave it out" in result.stderr
