"""Modes in words, the energies and powers of modes, and whirl."""

import json
import math

import numpy as np
import pytest
from chains import spinning_chain
from linear_ports import GUISES, ports
from random_mechanisms import random_mechanism
from sampling import sample

import mbstab
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference import attitude
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.rotation import rate_matrix
from mbstab.analysis.spectrum.eigenvalues import mode_shapes
from mbstab.analysis.spectrum.named_motions import Whirl
from mbstab.cli import main
from mbstab.errors import MbstabError
from mbstab.model.library import installed_models

BALANCE = 1e-12
"""The balance of every mode closes to this, relative to its largest term."""

ROTOR = """\
mbstab: 1
parameters:
  Omega: {value: 40, unit: rad/s}
  k: {value: 1000, unit: N/m}
bodies:
  rotor:
    type: spatial
    mass: 2
    inertia: [0.05, 0.05, 0.08]
    points: {A: [0, 0, 0.3], B: [0, 0, -0.3], tip: [0, 0, 0.3]}
forces:
  upper: {type: bearing, between: [rotor.A, {body: ground, point: [0, 0, 0.3]}], stiffness: k, damping: 0}
  lower: {type: bearing, between: [rotor.B, {body: ground, point: [0, 0, -0.3]}], stiffness: k, damping: 0}
reference:
  coordinates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Omega}}
"""


DOUBLE = """\
mbstab: 1
parameters: {c: 2}
bodies: {p: {type: planar_point, mass: 1}, q: {type: planar_point, mass: 1}}
constraints: {one: {holonomic: p.y}, other: {holonomic: q.y}}
forces:
  f: {type: expression, on: {p.x: -p.x + c*rate(p.x), q.x: -q.x - c*rate(q.x)}}
reference: {coordinates: {p: {x: 0}, q: {x: 0}}}
"""

FOLLOWER = """\
mbstab: 1
parameters: {P: 7/2 - sqrt(2)}
bodies:
  A: {type: planar, mass: 0, inertia: 0, points: {tip: [1, 0]}}
  B: {type: planar, mass: 0, inertia: 0, points: {tip: [1, 0]}}
  one: {type: planar_point, mass: 2}
  two: {type: planar_point, mass: 1}
joints:
  foot: {type: revolute, between: [A, ground]}
  knee: {type: revolute, between: [B, A.tip]}
  at_knee: {type: revolute, between: [one, A.tip]}
  at_tip: {type: revolute, between: [two, B.tip]}
forces:
  lower: {type: joint_spring, joint: foot, stiffness: 1}
  upper: {type: joint_spring, joint: knee, stiffness: 1}
  follower: {type: force, at: B.tip, vector: [-P, 0], frame: body}
reference: {coordinates: {A: {theta: 0}, B: {theta: 0}}}
"""


def modes(result):
    """Return one of each pair of modes with a shape."""
    return [e for e in result.eigenvalues if e.vector is not None and e.value.imag >= 0.0]


def with_energies(model):
    """Return the modes of a model that have energies: what cannot be told from zero has none."""
    found = modes(model.eig(energies=True))
    assert [e.energy is not None for e in found] == [e.error_bound < abs(e.value) for e in found]
    return [e for e in found if e.energy is not None]


def balances(model):
    """Return the largest defect of the energy balances of a model."""
    return max((e.energy.defect for e in with_energies(model)), default=0.0)


# --- the balance ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", installed_models(), ids=lambda path: path.stem)
def test_the_energy_balance_of_every_mode_closes(path):
    """Turning frames, redundant rows, neutral directions and nonholonomic rows are all among them."""
    assert balances(mbstab.load(path)) <= BALANCE


@pytest.mark.parametrize("seed", sample(range(160), every=8))
def test_the_energy_balance_of_random_mechanisms_closes(seed):
    """To 1e-12, or to the rounding of the shapes of slow modes beside fast ones."""
    try:
        found = with_energies(mbstab.loads(random_mechanism(seed)))
    except MbstabError as error:
        pytest.skip(str(error))
    fastest = max((abs(e.value) for e in found), default=0.0)
    for e in found:
        assert e.energy.defect <= max(BALANCE, np.finfo(float).eps * e.condition * fastest / abs(e.value))


def test_an_oscillator_loses_what_its_damper_takes():
    text = """
mbstab: 1
bodies: {b: {type: planar_point, mass: 2}}
forces: {s: {type: spring, between: [b, {body: ground, point: [-2, 0]}], stiffness: 50, damping: 3, length: 2}}
reference: {coordinates: {b: {x: 0, y: 0}}}
"""
    (pair,) = modes(mbstab.loads(text).eig(energies=True))
    assert pair.value == pytest.approx(complex(-0.75, math.sqrt(25.0 - 0.75**2)), rel=1e-14)
    body, spring = pair.energy.shares
    # |λ|² = k/m: strain and kinetic energy are equal; the damper takes c|λ|² of m|λ|²/2.
    assert (body.owner, spring.owner) == ("body 'b'", "force 's'")
    assert (body.kinetic, body.strain, body.load, body.power) == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert (spring.kinetic, spring.strain, spring.load) == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)
    assert (spring.damping, spring.circulation) == pytest.approx((-3.0, 0.0), abs=1e-15)


def test_tension_is_a_load_not_a_strain():
    """A mass between two tight strings swings across them by their tension alone."""
    text = """
mbstab: 1
bodies: {b: {type: planar_point, mass: 1}}
forces:
  left: {type: spring, between: [b, {body: ground, point: [-2, 0]}], stiffness: 50, length: 1.5}
  right: {type: spring, between: [b, {body: ground, point: [2, 0]}], stiffness: 50, length: 1.5}
reference: {coordinates: {b: {x: 0, y: 0}}}
"""
    across, along = sorted(modes(mbstab.loads(text).eig(energies=True)), key=lambda e: e.value.imag)
    # Tension 25 N over 2 m, twice; along the strings the springs act alone.
    assert across.value.imag == pytest.approx(5.0)
    assert (across.energy.total.strain, across.energy.total.load) == pytest.approx((0.0, 1.0), abs=1e-14)
    assert (along.energy.total.strain, along.energy.total.load) == pytest.approx((1.0, 0.0), abs=1e-14)


def test_a_sleigh_loses_energy_to_the_turning_of_its_runner():
    """The reaction of the knife edge does work on a disturbance, because a turn of the sleigh turns the edge."""
    (mode,) = modes(mbstab.load("chaplygin_sleigh.yaml").eig(energies=True))
    total = mode.energy.total
    assert total.reaction == pytest.approx(2.0 * mode.value.real, rel=1e-13)
    assert (total.kinetic, total.strain, total.load, total.damping, total.circulation) == (1.0, 0.0, 0.0, 0.0, 0.0)
    (row,) = [x for x in mode.energy.shares if x.reaction]
    assert row.owner.startswith("contact")


def test_powers_tell_what_feeds_flutter():
    """The follower force feeds the column, dampers take from it."""
    growing, decaying = modes(mbstab.load("ziegler_column.yaml").eig(energies=True))
    assert growing.value.real > 0.0 > decaying.value.real
    by_owner = {x.owner: x for x in growing.energy.shares}
    feeding = max(by_owner.values(), key=lambda x: x.power)
    assert feeding.owner == "force 'thrust'" or feeding.circulation > 0.0
    total = growing.energy.total
    assert total.damping < 0.0 < total.circulation
    assert 2.0 * growing.value.real * total.energy == pytest.approx(total.power, rel=1e-12)


def test_energies_of_a_few_modes_are_those_of_all():
    model = mbstab.load("double_pendulum.yaml")
    few, full = modes(model.modes(1, energies=True))[0], modes(model.eig(energies=True))
    same = min(full, key=lambda e: abs(e.value - few.value))
    for one, other in zip(few.energy.shares, same.energy.shares, strict=True):
        assert (one.owner, one.kinetic, one.load) == (
            other.owner,
            pytest.approx(other.kinetic),
            pytest.approx(other.load),
        )
    assert few.motions[0][0] == same.motions[0][0]


# --- in words -------------------------------------------------------------------------------------------------------


def test_modes_are_told_by_independent_motions():
    capsize, weave, castering = modes(mbstab.load("whipple_bicycle.yaml").eig())
    assert [name for name, _ in capsize.motions] == ["rear_body.y", "rear_body.psi"]
    assert {name for name, _ in weave.motions} == {"rear_body.psi", "angle(steering)", "rear_body.phi", "rear_body.y"}
    assert castering.motions[0] == ("angle(steering)", 1.0)
    for e in (capsize, weave, castering):
        sizes = [abs(x) for _, x in e.motions]
        assert e.motions[0][1] == pytest.approx(1.0, abs=4e-16)
        assert sizes == sorted(sizes, reverse=True)


def test_a_motion_of_a_joint_is_that_of_its_bodies():
    """The steering angle is the turn of the front body against the rear body about the steering axis."""
    _, weave, _ = modes(mbstab.load("whipple_bicycle.yaml").eig())
    names, told = mbstab.load("whipple_bicycle.yaml").eig().coordinates, dict(weave.motions)
    x = dict(zip(names, weave.vector, strict=True))
    tilt = math.pi / 10
    turns = [
        np.array([x[f"{body}.{angle}"] for angle in ("phi", "theta", "psi")]) for body in ("front_body", "rear_body")
    ]
    # Upright, the rates of all three angles are those about the ground axes.
    steer = (turns[0] - turns[1]) @ np.array([-math.sin(tilt), 0.0, math.cos(tilt)])
    assert abs(told["angle(steering)"] / told["rear_body.psi"]) == pytest.approx(
        abs(steer / x["rear_body.psi"]), rel=1e-9
    )


def test_one_mode_of_one_motion_is_that_motion():
    (pair,) = modes(mbstab.load("four_bar.yaml").eig())
    assert pair.motions == (("angle(A)", 1.0),)


def test_a_held_joint_is_not_named():
    """The driven angle of the hoop does not move; the bead does."""
    (pair,) = modes(mbstab.load("bead_on_hoop.yaml").eig())
    assert [name for name, _ in pair.motions] == ["bead.x"]


# --- whirl ----------------------------------------------------------------------------------------------------------


def whirls(text, **values):
    """Return frequencies and senses of the modes of a rotor, ascending."""
    return sorted((e.value.imag, e.whirl) for e in modes(mbstab.loads(text).eig(**values)) if e.whirl)


@pytest.mark.parametrize("Omega", [40, -40])
def test_gyroscopic_modes_whirl_forward_above_and_backward_below(Omega):
    """Conical modes of a rotor on bearings: I ω² − I_p Ω ω − k = 0; forward are those that the spin makes faster."""
    moment, polar, stiffness = 0.05, 0.08, 2 * 1000 * 0.3**2
    roots = np.roots([moment, -polar * abs(Omega), -stiffness])
    found = whirls(ROTOR, Omega=Omega)
    conical = {sense: w for w, sense in found if min(abs(abs(roots) - w)) < 1e-9 * w}
    assert conical["forward"] == pytest.approx(max(abs(roots)), rel=1e-12)
    assert conical["backward"] == pytest.approx(min(abs(roots)), rel=1e-12)


def test_a_light_body_that_goes_round_the_other_way_does_not_decide():
    """It hangs on springs of 80 and 120 rad/s: at 100 rad/s it follows one way, and moves against it the other way."""
    light = "  ring:\n    type: spatial\n    mass: 1e-4\n    inertia: [1e-7, 1e-7, 1e-7]\n"
    text = ROTOR.replace("forces:\n", light + "forces:\n", 1).replace(
        "reference:",
        "  hang:\n    type: expression\n    on:\n"
        "      ring.x: 0.64*(x(rotor.tip) - ring.x)\n      x(rotor.tip): 0.64*(ring.x - x(rotor.tip))\n"
        "      ring.y: 1.44*(y(rotor.tip) - ring.y)\n      y(rotor.tip): 1.44*(ring.y - y(rotor.tip))\n"
        "      ring.z: -ring.z\n      ring.phi: -ring.phi\n      ring.theta: -ring.theta\n"
        "reference:",
    )
    text = text.replace(
        "coordinates: {rotor", "coordinates: {ring: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, rotor"
    )
    text = text.replace("rates: {rotor", "rates: {ring: {psi: Omega}, rotor")
    found = dict(whirls(ROTOR)), whirls(text)
    fast = max(found[0])
    assert found[0][fast] == "forward"
    assert min(found[1], key=lambda x: abs(x[0] - fast))[1] == "forward"


def test_without_spin_nothing_whirls():
    assert whirls(ROTOR, Omega=0) == []


def test_whirl_in_a_turning_frame_is_that_on_the_ground():
    """A rotor that is not quite round is seen from a frame that turns with it, where frequencies differ by the spin."""
    odd = ROTOR.replace("inertia: [0.05, 0.05, 0.08]", "inertia: [0.05, 0.05 + 1e-9, 0.08]")
    model = mbstab.loads(odd.replace("reference:\n", "reference:\n  steady: {axis: z, rate: Omega}\n"))
    assert model.eig().frame
    # Conical modes at 100 and 36 rad/s; those along the bearings have the same frequency in all directions.
    along, conical = math.sqrt(2 * 1000 / 2), dict((sense, w) for w, sense in whirls(ROTOR) if sense != "mixed")
    expected = [(abs(w - 40), "forward") for w in (along, conical["forward"])]
    expected += [(w + 40, "backward") for w in (along, conical["backward"])]
    found = sorted((e.value.imag, e.whirl) for e in modes(model.eig()) if e.whirl)
    assert [sense for _, sense in found] == [sense for _, sense in sorted(expected)]
    assert [w for w, _ in found] == pytest.approx([w for w, _ in sorted(expected)], rel=1e-6)


def test_the_rates_of_each_body_are_formed_once_for_the_whirl_of_all_modes(monkeypatch):
    linear = linearize(system := mbstab.loads(spinning_chain(3)).system(), reference_motion(system))
    formed = []
    monkeypatch.setattr(attitude, "rate_matrix", lambda *given: formed.append(given) or rate_matrix(*given))
    whirl = Whirl(linear.system, linear.motion, linear.generator)
    found = mode_shapes(np.eye(system.n_q) + 0.5j, linear.motion.sizes)
    assert {whirl.of(1j * k, shape) for k, shape in enumerate(found)} <= {"", "forward", "backward", "mixed"}
    assert len(formed) == 3


# --- printed --------------------------------------------------------------------------------------------------------


def printed(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["eig", *arguments])
    assert not stop.value.code
    return capsys.readouterr().out


def test_the_table_tells_modes_in_words(capsys):
    text = printed(capsys, "whipple_bicycle.yaml")
    assert "rear_body.psi 1.00, angle(steering) 0.98∠\N{MINUS SIGN}84°" in " ".join(text.split())


def test_shapes_are_printed_on_request(capsys):
    text = printed(capsys, "wheelset.yaml", "--shapes")
    assert "wheelset.theta   0.541827  rad       94.243" in text
    assert "2 Re λ · energy = -4.80862 1/s, power -4.80862 1/s" in text
    assert "force 'creep'" in text


def test_json_has_motions_whirl_and_energies(capsys):
    plain = json.loads(printed(capsys, "wheelset.yaml", "--format", "json"))["eigenvalues"][0]
    assert plain["energy"] is None
    assert plain["motions"][0] == {"name": "wheelset.y", "magnitude": 1.0, "phase": 0.0}
    assert plain["whirl"] is None
    energy = json.loads(printed(capsys, "wheelset.yaml", "--format", "json", "--shapes"))["eigenvalues"][0]["energy"]
    total = energy["total"]
    assert total["kinetic"] == pytest.approx(1.0)
    inner = total["kinetic"] + total["strain"] + total["load"]
    power = total["damping"] + total["circulation"] + total["reaction"]
    assert 2.0 * energy["real"] * inner == pytest.approx(power, rel=1e-12)
    assert sum(x["strain"] for x in energy["of"]) == pytest.approx(total["strain"])


@pytest.mark.parametrize("other", [["--precision", "20"], ["--certify"], ["--verify"], ["--format", "csv"]])
def test_shapes_go_with_the_eigenvalues_only(other, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["eig", "pendulum.yaml", "--shapes", *other])
    assert stop.value.code == 2
    assert "--shapes goes with none of" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "settings", "count"), [(DOUBLE, {}, 2), (DOUBLE, {"c": -2}, 2), (FOLLOWER, {}, 2)])
def test_a_defective_eigenvalue_has_one_shape_and_it_is_an_eigenvector(text, settings, count):
    model = mbstab.loads(text)
    result, linear = model.eig(energies=True, **settings), model.linearize(**settings)
    N = linear.spaces.scale[:, None] * linear.spaces.N
    assert [e.together for e in result.eigenvalues] == [2] * 4
    shown = modes(result)
    assert len([e for e in result.eigenvalues if e.vector is not None]) == count
    for e in shown:
        # Eigenvalues that are split by rounding have their middle where they meet.
        s = np.mean([x.value for x in result.eigenvalues if abs(x.value - e.value) < 1e-6])
        Q = s**2 * linear.M + s * linear.R + linear.K
        assert np.linalg.norm(N.T @ Q @ e.vector) < 1e-8 * np.linalg.norm(N.T @ linear.K @ N)
        assert e.energy.value.real == pytest.approx(round(e.value.real, 6), abs=1e-12)
        kinetic = {x.owner: x.kinetic for x in e.energy.shares if x.kinetic}
        for body, share in e.participation.items():
            assert kinetic.get(f"body '{body}'", 0.0) == pytest.approx(share, abs=1e-9)


def test_eigenvalues_that_share_a_shape_are_told(tmp_path, capsys):
    file = tmp_path / "double.yaml"
    file.write_text(DOUBLE, encoding="utf-8")
    text = printed(capsys, str(file))
    assert "1 has no mode shape of its own: 2 eigenvalues are not told apart there" in " ".join(text.split())
    listed = json.loads(printed(capsys, str(file), "--format", "json"))["eigenvalues"]
    assert [(e["together"], e["vector"] is None) for e in listed] == [(2, False), (2, True)] * 2


def test_equal_eigenvalues_with_shapes_of_their_own_keep_them():
    result = mbstab.loads(DOUBLE).eig(c=0)
    assert len(modes(result)) == 2
    assert sorted(max(e.participation, key=e.participation.get) for e in modes(result)) == ["p", "q"]


# --- modes of states alone ------------------------------------------------------------------------------------------

FILTERS = """\
mbstab: 1
parameters: {k: 0}
bodies:
  a: {type: spatial, mass: 2, inertia: [0.3, 0.4, 0.5], points: {tip: [0.3, 0.1, 0.2]}}
  b: {type: spatial, mass: 1.7, inertia: [0.2, 0.25, 0.15], points: {foot: [-0.2, 0.1, 0]}}
joints:
  hip: {type: revolute, between: [a, ground], axis: [1, 2, 3]}
  knee: {type: revolute, between: [b.foot, a.tip], axis: [3, -1, 1]}
forces:
  s: {type: joint_spring, joint: hip, stiffness: 7, damping: 0.3}
  t: {type: joint_spring, joint: knee, stiffness: 3, damping: 0.1}
  push: {type: actuator, joint: knee, effort: k*seen + 2*(fast + slow)}
states:
  seen: {rate: 0.2*angle(knee) - 3*seen}
  later: {rate: seen - 5*later}
  fast: {rate: -7*fast}
  slow: {rate: -7.3*slow + 1e-7*fast}
reference: {coordinates: {a: {phi: 0, theta: 0, psi: 0}, b: {phi: 0, theta: 0, psi: 0}}}
"""


def alone(result):
    """Return the modes of states alone by eigenvalue, each with what moves in it."""
    return {
        round(e.value.real, 9): {n for n, x in zip(result.coordinates, e.vector, strict=True) if x}
        for e in modes(result)
        if not result.moves_bodies(e)
    }


@pytest.mark.parametrize("few", [False, True])
def test_what_moves_by_rounding_only_is_at_rest_in_a_mode_of_states(few):
    """Filters that nothing feels; a force that pivots hold, and what is felt however little, are told from rounding."""
    model = mbstab.loads(FILTERS.replace("2*(fast + slow)", "0"))
    found = model.modes(7, energies=True) if few else model.eig(energies=True)
    assert alone(found) == {-3: {"seen", "later"}, -5: {"later"}, -7: {"fast", "slow"}, -7.3: {"slow"}}
    for e in modes(found):
        assert (e.energy is not None) == (sum(e.participation.values()) > 0) == found.moves_bodies(e)
        assert all(name.startswith("angle") for name, _ in e.motions) == found.moves_bodies(e)
    felt = model.modes(7, k=1e-14) if few else model.eig(k=1e-14)
    assert set(alone(felt)) == {-5, -7, -7.3}


@pytest.mark.parametrize("axles", [3, 4, 5])
@pytest.mark.parametrize("seed", range(3))
def test_states_whose_forces_cancel_move_alone(axles, seed):
    """Tyres with one relaxation length L: slips whose forces and moments cancel relax with -v/L and move nothing."""
    rng = np.random.default_rng(seed)
    places, stiffness = rng.uniform(-3.0, 3.0, axles), rng.uniform(1e5, 5e5, axles)
    points = ", ".join(f"p{k}: [{x}, 0]" for k, x in enumerate(places.tolist()))
    tyres = "".join(
        f"  t{k}: {{type: tyre, at: truck.p{k}, cornering_stiffness: {c}, relaxation_length: 0.5}}\n"
        for k, c in enumerate(stiffness.tolist())
    )
    model = mbstab.loads(
        "mbstab: 1\nparameters: {v: 22.2}\nbodies:\n"
        f"  truck: {{type: planar, mass: 18000, inertia: 9e4, points: {{H: [-4.2, 0], {points}}}}}\n"
        "  dolly: {type: planar, mass: 800, inertia: 600, points: {H: [2.6, 0]}}\n"
        "joints: {hitch: {type: revolute, between: [dolly.H, truck.H]}}\n"
        "constraints: {cruise: {nonholonomic: vx(truck) - v}}\n"
        f"forces:\n{tyres}  d: {{type: tyre, at: dolly, cornering_stiffness: 3e5, relaxation_length: 0.5}}\n"
        "reference: {coordinates: {truck: {x: 0, y: 0, theta: 0}, dolly: {theta: 0}}, rates: {truck: {x: v}}}\n"
    )
    found = model.eig(energies=True)
    relaxing = [e for e in found.eigenvalues if abs(e.value + 44.4) < 1e-6]
    assert len(relaxing) == axles - 2
    for e in relaxing:
        assert not found.moves_bodies(e)
        assert all("slip" in name for name, _ in e.motions)
        amplitudes = dict(zip(found.coordinates, e.vector, strict=True))
        forces = stiffness * [amplitudes[f"t{k}_slip"] for k in range(axles)]
        assert abs(forces.sum()) < 1e-9 * np.abs(forces).sum()
        assert abs(forces @ places) < 1e-9 * np.abs(forces).sum()
    assert len([e for e in modes(found) if not found.moves_bodies(e)]) == len(
        [e for e in relaxing if e.value.imag >= 0]
    )


@pytest.mark.parametrize("guise", GUISES)
def test_filters_that_follow_move_alone_in_every_guise(guise):
    system = ports(503, 1)
    assert alone(mbstab.loads(system.text(guise)).eig()) == {-0.692: {"z1"}, -0.844: {"z0"}}


def test_states_that_push_against_what_holds_a_body_move_alone():
    """Their force is taken up by the guide of the mass; along it, it is felt."""
    text = """
mbstab: 1
bodies: {p: {type: planar, mass: 3, inertia: 1}}
joints: {guide: {type: prismatic, between: [p, ground], axis: [0.6, 0.8]}}
forces:
  s: {type: joint_spring, joint: guide, stiffness: 10}
  f: {type: expression, on: {p.x: -0.8*F, p.y: 0.6*F}}
states: {F: {rate: -2*F}}
reference: {}
"""
    assert alone(mbstab.loads(text).eig()) == {-2: {"F"}}
    assert alone(mbstab.loads(text.replace("-0.8*F", "-0.7*F")).eig()) == {}


def test_a_mode_of_states_has_no_picture(tmp_path, capsys):
    file = tmp_path / "filters.yaml"
    file.write_text(FILTERS, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["eig", str(file), "--plot", "modes", "--pictures", str(tmp_path / "a.svg")])
    shown = capsys.readouterr()
    assert not stop.value.code
    assert "are not drawn: states move, and no body" in shown.err
    assert "no mass moves" in shown.out
    found = mbstab.loads(FILTERS).eig()
    number = next(n for n, e in enumerate(modes(found), 1) if not found.moves_bodies(e))
    with pytest.raises(MbstabError, match=rf"mode {number} moves no body: only \w+"):
        mbstab.loads(FILTERS).swing(number)
