"""What springs, dampers, actuators and drives do along their motions: against the equations of motion and statics."""

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement, efforts
from mbstab.analysis.reference.motion import Finder
from mbstab.cli.main import main
from mbstab.errors import UsageError
from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.sections.outputs import measured_expression
from mbstab.report.pictures.motion_plots import read_picture

MODELS = Path(__file__).parents[1] / "models"

PLANAR = """\
mbstab: 1
gravity: [0, -10]
bodies:
  cart: {type: planar, mass: 2, inertia: 0.1, points: {a: [0.1, 0.2]}}
  arm: {type: planar, mass: 1, inertia: 0.1, points: {a: [-0.5, 0.1], b: [0.5, 0]}}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: x}
  pivot: {type: revolute, between: [arm.a, cart.a]}
forces:
  hold: {type: joint_spring, joint: pivot, stiffness: 40, rest: 0.3, damping: 2}
  stop: {type: joint_spring, joint: rail, stiffness: 30, rest: -0.2, damping: 1}
  pull: {type: spring, between: [arm.b, {body: ground, point: [2, 1]}], stiffness: 5, length: 0.5, damping: 1.5}
  string: {type: spring, between: [cart, arm.b], stiffness: 3}
  push: {type: actuator, joint: rail, effort: 3 + t}
  twist: {type: actuator, joint: pivot, effort: 2*cos(t)}
reference: {coordinates: {cart: {x: 0.1}, arm: {theta: 0.4}}}
"""

SPATIAL = """\
mbstab: 1
gravity: [0, 0, -10]
bodies:
  base: {type: spatial, mass: 2, inertia: [0.1, 0.2, 0.25], points: {a: [0.1, 0.2, 0.3]}}
  rod: {type: spatial, mass: 1, inertia: [0.1, 0.12, 0.2], points: {a: [-0.5, 0.1, 0.2], b: [0.5, 0, 0.1]}}
joints:
  sleeve: {type: cylindrical, between: [rod.a, base.a], axis: [[1, 0, 1], [0, 1, 2]]}
  ball: {type: spherical, between: [base, ground]}
forces:
  turn: {type: joint_spring, joint: sleeve, motion: angle, stiffness: 40, rest: 0.3, damping: 2}
  slide: {type: joint_spring, joint: sleeve, motion: displacement, stiffness: 30, rest: -0.2, damping: 1}
  pull: {type: spring, between: [rod.b, {body: ground, point: [2, 1, 0]}], stiffness: 5, length: 0.5, damping: 1.5}
  push: {type: actuator, joint: sleeve, motion: displacement, effort: 3 + t}
  twist: {type: actuator, joint: sleeve, motion: angle, effort: 2*cos(t)}
reference: {coordinates: {base: {phi: 0.2, theta: -0.3, psi: 0.4}}}
"""


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_efforts_times_rates_are_the_power_in_the_equations_of_motion(text):
    system = mbstab.loads(text).system()
    rng = np.random.default_rng(7)
    parts = dict(system.parts())
    for _ in range(5):
        q, u = rng.normal(size=(2, system.n_q))
        q = Finder(system).assemble(q, np.ones(system.n_q, dtype=bool))
        state = system.dynamics(q, u, 0.7)
        assert np.max(np.abs(state.E)) < 1e-13
        u -= np.linalg.pinv(state.J) @ state.V
        at = Placement(Attitudes.of(system), system, q, u)
        found = {acted.owner: acted for acted in efforts(at, np.zeros(system.n_c), 0.7)}
        for item in system.scene.items:
            if item.kind.effort is None:
                continue
            effort = item.kind.effort(item)
            acted = found[f"force {item.name!r}"]
            power = float(acted.values) * float(at.rate(effort.motion, effort.of))
            assert power == pytest.approx(-float(parts[item.entry.path].dynamics(q, u, 0.7).F0 @ u), rel=1e-10)
            # The rate is that of the motion.
            h = 1e-6
            moved = [
                Placement(at.attitudes, system, q + s * h * u, u).motion(effort.motion, effort.of) for s in (1.0, -1.0)
            ]
            assert (moved[0] - moved[1]) / (2.0 * h) == pytest.approx(at.rate(effort.motion, effort.of), rel=1e-6)


def test_several_states_at_once_are_as_each_alone():
    system = mbstab.loads(SPATIAL).system()
    q, u = np.random.default_rng(3).normal(size=(2, 4, system.n_q))
    nu, times = np.zeros((4, system.n_c)), np.arange(4.0)
    attitudes = Attitudes.of(system)
    together = efforts(Placement(attitudes, system, q, u), nu, times)
    for k in range(4):
        alone = efforts(Placement(attitudes, system, q[k], u[k]), nu[k], times[k])
        for one, other in zip(together, alone, strict=True):
            assert one.values[k] == pytest.approx(other.values, rel=1e-13)


def _power(system, path, q, u):
    """Return the power of one entry at t = 0.7 s, from its generalized forces."""
    return float(-dict(system.parts())[path].dynamics(q, u, 0.7).F0 @ u)


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.yaml")), ids=lambda path: path.stem)
def test_one_list_of_efforts_serves_outputs_plots_and_tables(path):
    mechanism = mbstab.load(path)
    model = mechanism.model
    entries = [entry for section in ("drives", "forces") for entry in model.entries[section].values()]
    acting, units = {entry.name for entry in entries if entry.has_effort}, {}
    for entry in entries:
        word = f"effort({entry.name})"
        if entry.name in acting:
            measured_expression(model, word)
            units[entry.called] = read_picture(model, word).panels[0].curves[0].unit.replace("·", "*")
        else:
            with pytest.raises(ExpressionError, match="no force or drive along one motion"):
                measured_expression(model, word)
            with pytest.raises(UsageError, match="no force or drive along one motion"):
                read_picture(model, word)
    for group in model.entries.values():
        for entry in group.values():
            word, said = f"force({entry.name}.x)", "there is no joint|nothing called|there are several called"
            several = sum(other.has_reaction for x in model.entries.values() if (other := x.get(entry.name))) > 1
            if entry.has_reaction and not several:
                measured_expression(model, word)
                read_picture(model, word)
            elif several or not any(entry.name in x and x[entry.name].has_reaction for x in model.entries.values()):
                with pytest.raises(ExpressionError, match=said):
                    measured_expression(model, word)
                with pytest.raises(UsageError, match=said):
                    read_picture(model, word)
    system = mechanism.system()
    at = Placement(Attitudes.of(system), system, *np.full((2, system.n_q), 0.1))
    found = efforts(at, np.zeros(system.n_c), 0.0)
    assert {x.owner: x.unit for x in found} == units


WRITTEN = """\
mbstab: 1
parameters: {k: {value: 3}}
tables: {soft: {x: [-9, 0, 9], y: [-4, 0, 7]}}
bodies:
  a: {type: spatial, mass: 2, inertia: [1, 2, 2.5], points: {p: [0.3, 0.1, 0]}}
  b: {type: spatial, mass: 1, inertia: [1, 1, 1]}
joints:
  pivot: {type: revolute, between: [a.p, ground], axis: y}
  rail: {type: prismatic, between: [b, a], axis: x}
states: {z: {rate: k - z}}
forces:
  pid: {type: pid, joint: pivot, of: angle(pivot), target: 0.2*sin(t), P: k, I: 2, D: 0.5, filter: 0.01, lag: 0.1}
  now: {type: pid, coordinate: b.z, of: b.z, P: k, D: 0.5}
  lqr: {type: state_feedback, joint: rail, gains: {displacement(rail): k, rate(angle(pivot)): 2, z: 1}}
  tf: {type: transfer_function, joint: pivot, signal: angle(pivot), numerator: [1, k], denominator: [1, 2]}
  ss: {type: state_space, joint: pivot, signal: z, A: [[-1]], B: [1], C: [k], D: 2}
  dc: {type: motor, joint: rail, voltage: 4*cos(t), resistance: 1, inductance: 0.1, constant: k}
  law: {type: actuator, joint: rail, effort: "z - table(displacement(rail), soft)"}
  own: {type: expression, on: {a.theta: -k*rate(a.theta)**3}}
  part: {type: expression, on: {"distance(a.p, b)": "saturate(z, -0.2, 0.2, 0.1) - vx(a.p)"}}
"""


def test_efforts_that_are_written_times_rates_are_the_power_in_the_equations_of_motion():
    system = mbstab.loads(WRITTEN).system()
    assert {x.name for x in system.scene.model.entries["forces"].values() if x.has_effort} == {
        "pid", "now", "lqr", "tf", "ss", "dc", "law", "own", "part"
    }  # fmt: skip
    rng = np.random.default_rng(5)
    for _ in range(3):
        q, u = 0.4 * rng.normal(size=(2, system.n_q))
        at = Placement(Attitudes.of(system), system, q, u)
        found = {acted.owner: acted for acted in efforts(at, np.zeros(system.n_c), 0.7)}
        for entry in system.scene.model.entries["forces"].values():
            along = entry.load[0]
            rate = float(at.value(parse(f"rate({along})"), 0.7))
            power = float(found[entry.called].values) * rate
            assert power == pytest.approx(_power(system, entry.path, q, u), rel=1e-12), entry.name
            assert found[entry.called].unit == ("N*m" if "angle" in along or "theta" in along else "N")


def test_the_effort_of_a_controller_is_told_by_equilibrium_and_simulate(tmp_path):
    model = tmp_path / "held.yaml"
    old = "{type: joint_spring, joint: shoulder, stiffness: 100}"
    assert old in HELD
    model.write_text(HELD.replace(old, "{type: pid, joint: shoulder, of: angle(shoulder), P: 100}"), encoding="utf-8")
    angle = mbstab.load(model).equilibria()[0].motion.q[2]
    assert f"force 'hold'  angle of 'shoulder'  {-100.0 * angle:.5g}  N*m" in run("equilibrium", model).stdout
    arguments = ("simulate", model, "--to", "0.1", "--points", "3", "-o", tmp_path / "x.csv", "--plot", "effort(hold)")
    assert run(*arguments).exit_code == 0
    rows = csv.DictReader(io.StringIO((tmp_path / "x.csv").read_text(encoding="utf-8")))
    assert [float(row["effort of force 'hold' (N*m)"]) for row in rows] == pytest.approx([-100.0 * angle] * 3)


@pytest.mark.parametrize("law", ["position: A", "velocity: 0"])
@pytest.mark.parametrize("start", [0.3, 2.8])
def test_a_drive_carries_the_weight(law, start):
    # A rod of 2 kg turns about y, its center 0.7 m from the axis.
    text = f"""\
mbstab: 1
gravity: [0, 0, -10]
parameters: {{A: {{value: {start}}}}}
bodies: {{rod: {{type: spatial, mass: 2, inertia: [0.1, 0.2, 0.2], points: {{O: [-0.7, 0, 0]}}}}}}
joints: {{pivot: {{type: revolute, between: [rod.O, ground], axis: -y, zero: x}}}}
drives: {{motor: {{type: joint, joint: pivot, {law}}}}}
reference: {{coordinates: {{rod: {{phi: 0, theta: -A, psi: 0}}}}}}
"""
    sim = mbstab.loads(text).simulate(0.1, points=3, tol=1e-6)
    assert sim.effort_names == (("drive 'motor'", "N*m"),)
    np.testing.assert_allclose(sim.efforts[:, 0], 2.0 * 10.0 * 0.7 * math.cos(start), rtol=1e-6)


HELD = """\
mbstab: 1
gravity: [0, -10]
bodies: {arm: {type: planar, mass: 2, inertia: 0.1, points: {a: [-0.5, 0]}}}
joints: {shoulder: {type: revolute, between: [arm.a, ground]}}
forces: {hold: {type: joint_spring, joint: shoulder, stiffness: 100}}
reference: {find: equilibrium, guess: {arm: {x: 0.5}}}
"""


def run(*arguments):
    return CliRunner().invoke(main, [str(x) for x in arguments])


def test_every_output_tells_the_torque_of_a_spring_at_a_joint(tmp_path):
    model = tmp_path / "held.yaml"
    model.write_text(HELD, encoding="utf-8")
    angle = mbstab.load(model).equilibria()[0].motion.q[2]
    torque = float(-100.0 * angle)
    assert torque == pytest.approx(2.0 * 10.0 * 0.5 * math.cos(angle), rel=1e-10)
    text = run("equilibrium", model).stdout
    assert f"force 'hold'  angle of 'shoulder'  {torque:.5g}  N*m" in text
    (effort,) = json.loads(run("equilibrium", model, "--format", "json").stdout)["equilibria"][0]["efforts"]
    assert effort == {
        "of": "force 'hold'", "along": "angle of 'shoulder'", "value": pytest.approx(torque), "unit": "N*m"
    }  # fmt: skip
    rows = list(csv.reader(io.StringIO(run("equilibrium", model, "--format", "csv").stdout)))
    assert rows[-1][:3] == ["1", "effort", "force 'hold'"]
    assert float(rows[-1][3]) == pytest.approx(torque)
    for suffix in ("csv", "json", "npz"):
        path = tmp_path / f"held.{suffix}"
        assert run("simulate", model, "--to", "0.1", "--points", "3", "-o", path).exit_code == 0
        head = "effort of force 'hold' (N*m)"
        if suffix == "csv":
            found = [float(row[head]) for row in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))]
        elif suffix == "json":
            data = json.loads(path.read_text(encoding="utf-8"))
            found = [row[data["columns"].index(head)] for row in data["rows"]]
        else:
            with np.load(path) as archive:
                assert archive["efforts_columns"].tolist() == [head]
                found = archive["efforts"][:, 0]
        assert found == pytest.approx([torque] * 3, rel=1e-6)


def test_a_torque_that_a_spring_carries_is_hinted_at(tmp_path):
    model = tmp_path / "held.yaml"
    model.write_text(HELD, encoding="utf-8")
    result = run("simulate", model, "--to", "0.1", "--points", "3", "--plot", "torque(shoulder)")
    assert "torque(shoulder.z) is 0: what acts along joint 'shoulder' is not its reaction; plot effort(hold)" in (
        result.stderr
    )
    result = run("simulate", model, "--to", "0.1", "--points", "3", "--plot", "effort(hold)")
    assert result.exit_code == 0
    assert "hint" not in result.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("shoulder", "along this joint act effort(hold)"),
        ("hodl", "did you mean 'hold'?"),
        ("arm", "those with efforts: hold"),
    ],
)
def test_unknown_efforts_are_named(tmp_path, name, said):
    model = tmp_path / "held.yaml"
    model.write_text(HELD, encoding="utf-8")
    result = run("simulate", model, "--plot", f"effort({name})")
    assert result.exit_code == 2
    assert f"there is no force or drive along one motion {name!r}" in result.stderr
    assert said in result.stderr


# --- motions of joints ----------------------------------------------------------------------------------------------

SPINNING = """\
mbstab: 1
bodies:
  rotor: {type: spatial, mass: 1, inertia: [1, 1, 2]}
  nut: {type: spatial, mass: 1, inertia: [1, 1, 1]}
joints:
  shaft: {type: revolute, between: [rotor, ground], axis: [[0, 1, 1], [0, 1, 1]]}
  sleeve: {type: cylindrical, between: [nut, ground], axis: [z, z]}
initial: {rates: {nut: {z: 2}}}
"""


def test_angles_and_displacements_of_joints_go_on_over_many_turns(tmp_path):
    path = tmp_path / "spin.csv"
    (tmp_path / "spin.yaml").write_text(SPINNING, encoding="utf-8")
    arguments = ["--perturb", "rate(angle(shaft))=300", "--perturb", "angle(sleeve)=3", "--to", "0.1", "--points", "11"]
    plots = ["--plot", "angle(shaft),displacement(sleeve)", "--plot", "phase:angle(shaft)"]
    result = run("simulate", tmp_path / "spin.yaml", *arguments, *plots, "-o", path)
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    times = np.linspace(0.0, 0.1, 11)
    for head, value in (
        ("angle(shaft) (rad)", 300.0 * times),
        ("rate(angle(shaft)) (rad/s)", 300.0),
        ("angle(sleeve) (rad)", 3.0),
        ("displacement(sleeve) (m)", 2.0 * times),
        ("rate(displacement(sleeve)) (m/s)", 2.0),
    ):
        np.testing.assert_allclose([float(row[head]) for row in rows], value + 0.0 * times, rtol=1e-6, atol=1e-6)
    assert sorted(x.name for x in tmp_path.glob("*.png")) == [
        "spin-angle-shaft-displacement-sleeve.png", "spin-phase-angle-shaft.png"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("angle(shaf)", "did you mean 'angle(shaft)'?"),
        ("rate(angle(shaf))", "did you mean 'angle(shaft)'?"),
        ("displacement(shaft)", "hint: motions of joints: angle(shaft)"),
        ("angel(shaft)", "did you mean 'angle'?"),
        ("phase:energy", "there is no coordinate 'energy'"),
    ],
)
def test_unknown_motions_of_joints_are_named(asked, said, tmp_path):
    (tmp_path / "spin.yaml").write_text(SPINNING, encoding="utf-8")
    result = run("simulate", tmp_path / "spin.yaml", "--plot", asked)
    assert result.exit_code == 2
    assert said in result.stderr
