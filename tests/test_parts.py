"""Every part of a model: schema, drawing, energy, reactions, proof, formula, published result.

A part is a kind of entry with rows or forces. Those of `scenes/`, which have every kind and key, are taken at random
states off their constraints, also with keys left out that make other elements of them. A kind without its line
in the tables below fails.
"""

from __future__ import annotations

import functools
import re
from pathlib import Path

import numpy as np
import pytest
from element_tables import ENERGY
from test_reader import RICH

import mbstab
from mbstab.analysis.reference.reactions import reactions
from mbstab.analysis.reference.rotation import orientation, rate_matrix
from mbstab.compiler.system import System
from mbstab.mechanics.catalogue import GROUND
from mbstab.mechanics.elements import ELEMENTS, KINDS, kernel_name
from mbstab.model import balls
from mbstab.model.library import installed_models
from mbstab.model.values import evaluate

SECTIONS = ("joints", "contacts", "drives", "forces")
PARTS = sorted({(section, name) for section in SECTIONS for name, _ in KINDS[section]})
STATES = 40
TIME = 0.7

# --- scenes ---------------------------------------------------------------------------------------------------------

PEAKS = r", peak: 4, shape_factor: 1.3, curvature_factor: -1"
MOMENT_PEAK = r", aligning_peak: 0.2, aligning_shape_factor: 1.5, aligning_curvature_factor: -1"
CHANGES = {
    "all keys": {},
    "rigid, linear, at rest": {
        r"(?<=\d, )?stiffness: 1, damping: 1, (?=offset)": "",
        PEAKS: "",
        r", aligning_stiffness: 0.3" + MOMENT_PEAK: "",
        r", relaxation_length: 0.2": "",
        r", trail: 0.1": "",
        r", camber_stiffness: 1, camber_moment: 0.2": "",
        r", length: (L|1), damping: 1": "",
        r", kxy: 1, kyx: -1": "",
        r", cxy: 1, cyx: 1": "",
        r", surface_velocity: (x|\[[^]]*\])": "",
        r", surface_rate: [\w*]+": "",
        r"motion: frictionless": "motion: rolling",
        r"(?<=motion: )(angle, velocity|displacement, position)": "angle, position",
        r"(push: .*frame: )(body|ground)": lambda x: x[1] + ("ground" if x[2] == "body" else "body"),
    },
    "peaks of linear moments, other motions": {
        r", relaxation_length: 0.2": "",
        MOMENT_PEAK: "",
        r", offset: 0.1(?=})": "",
        r"(turning: .*)joint: turn, motion: angle": r"\1joint: slide, motion: displacement",
        r"joint: screw, motion: displacement, position": "joint: screw, motion: angle, velocity",
        r"(coil: .*)joint: (turn|revolute), motion: angle": lambda x: (
            x[1] + f"joint: {'slide' if x[2] == 'turn' else 'prismatic'}, motion: displacement"
        ),
        r"(motor: .*)joint: (slide|cylindrical), motion: displacement": lambda x: (
            x[1] + f"joint: {'turn' if x[2] == 'slide' else 'cylindrical'}, motion: angle"
        ),
        r"(point: .*)position: 0": r"\1velocity: 0.3",
        r"(point: .*)velocity: 1": r"\1position: t",
        r"(?<=surface_velocity: )\[0, 0\]": "[0.5, 0]",
        r"motion: (skate|frictionless)": "motion: rolling",
        r"(twist: .*frame: )body": r"\1ground",
    },
    "no relaxation": {r", relaxation_length: 0.2": ""},
    "relaxed linear forces, travels": {
        PEAKS: "",
        MOMENT_PEAK: "",
        r"(turning: .*)joint: turn, motion: angle, velocity": r"\1joint: slide, motion: displacement, position",
        r"joint: screw, motion: displacement, position": "joint: screw, motion: displacement, velocity",
    },
}
"""What is changed in the texts of the scenes, by patterns."""

SCENES = [(dimension, variant) for dimension in (2, 3) for variant in CHANGES]


@functools.cache
def scene(dimension, variant):
    """Return a scene with every kind of entry."""
    text = RICH[dimension]
    for pattern, other in CHANGES[variant].items():
        text = re.sub(pattern, other, text)
    return mbstab.loads(text).system()


def states(system, count=STATES):
    """Yield coordinates and speeds, which the constraints do not allow."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        yield rng.uniform(0.2, 1.2, system.n_q), rng.uniform(-1.2, 1.2, system.n_q)


def items(system):
    """Return entries with rows or forces, and the equations of each alone."""
    parts = dict(system.parts())
    return [(item, parts[item.entry.path]) for item in system.scene.items if item.entry.section in SECTIONS]


def own_rows(system, item):
    """Return the numbers of the rows of an entry."""
    return [i for i, row in enumerate(system.rows) if (row.section, row.name) == (item.entry.section, item.name)]


def test_all_elements_of_parts_occur():
    used = {
        kernel_name(use.element, dimension)
        for dimension, variant in SCENES
        for item in scene(dimension, variant).scene.items
        if not item.kind.written
        for use in item.kind.build(item)
    }
    parts = {name for name, element in ELEMENTS.items() if element.role != "inertia" and "measure_" not in name}
    assert parts - used == set()


# --- schema and drawing ---------------------------------------------------------------------------------------------

UNDRAWN = {
    ("joints", "fixed"): "bodies that are fixed to each other look like one",
    ("drives", "coordinate"): "it has no place",
    ("drives", "joint"): "the joint is drawn",
    ("drives", "point"): "the body is drawn",
    ("forces", "joint_spring"): "the joint is drawn",
    ("forces", "actuator"): "the joint is drawn",
    ("forces", "force"): "given forces are not drawn",
    ("forces", "torque"): "given torques are not drawn",
    ("forces", "expression"): "it has no place",
    ("forces", "potential"): "it has no place",
    ("forces", "dissipation"): "it has no place",
    ("forces", "pid"): "a signal has no place",
    ("forces", "state_feedback"): "a signal has no place",
    ("forces", "transfer_function"): "a signal has no place",
    ("forces", "state_space"): "a signal has no place",
    ("forces", "motor"): "the joint is drawn",
}
"""Why a part is not drawn."""


@pytest.mark.parametrize(("section", "name"), PARTS)
def test_a_part_is_drawn_or_it_is_said_why_not(section, name):
    drawn = [kind for (own, _), kind in KINDS[section].items() if own == name and kind.look is not None]
    assert bool(drawn) != ((section, name) in UNDRAWN)


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_what_is_drawn_has_points(dimension, variant):
    for item, _ in items(scene(dimension, variant)):
        if item.kind.look is not None:
            assert all(look.points for look in item.kind.look(item)), item.entry.path


# --- energy ---------------------------------------------------------------------------------------------------------


def lost(part, q, u):
    """Return the power that a force takes from the motion, beside what it stores."""
    h = 1e-6
    stored = (part.potential(q + h * u) - part.potential(q - h * u)) / (2.0 * h)
    return float(part.dynamics(q, u, TIME).F0 @ u - stored)


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_forces_keep_or_lose_energy_as_they_should(dimension, variant):
    system = scene(dimension, variant)
    for item, part in items(system):
        if not part.acting():
            continue
        found = np.array([lost(part, q, u) for q, u in states(system)])
        name, size = item.kind.name, float(np.max(np.abs(found)))
        match ENERGY.get((name, variant)) or ENERGY[name]:
            case "keeps":
                assert size < 1e-8, item.entry.path
            case "loses":
                assert np.all(found > -1e-8), item.entry.path
                assert size > 1e-3, item.entry.path
            case "either":
                assert np.min(found) < 0.0 < np.max(found), item.entry.path


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_rows_do_no_work_but_those_of_what_moves(dimension, variant):
    """Speeds that satisfy a row at rest satisfy it, J u = 0: its reaction is across them."""
    system = scene(dimension, variant)
    for item, part in items(system):
        rows = own_rows(system, item)
        if not rows:
            continue
        works = any(not law.zero for use in item.kind.build(item) for law in use.laws)
        for q, u in states(system, 3):
            at = part.dynamics(q, u, TIME)
            carried = np.abs(at.V - at.J @ u)[rows]
            assert (np.max(carried) > 1e-3) if works else (np.max(carried) < 1e-12), item.entry.path


# --- reactions ------------------------------------------------------------------------------------------------------


def speeds_of(system, body, q, u, point):
    """Return velocity of a point of the ground that a body carries, and its angular velocity."""
    d, part = system.scene.dimension, system.body_slices[body]
    place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
    if not system.scene.bodies[body].orientation:
        return u[place], np.zeros(0)
    if d == 2:
        (turn,) = u[angles]
        x, y = point - q[place]
        return u[place] + turn * np.array([-y, x]), u[angles]
    h = 1e-6
    body = system.scene.bodies[body]
    ahead, behind = (orientation(body, q[angles] + s * u[angles]) for s in (h, -h))
    rate = (ahead - behind) / (2.0 * h) @ orientation(body, q[angles]).T
    turn = np.array([rate[2, 1], rate[0, 2], rate[1, 0]])
    return u[place] + np.cross(turn, point - q[place]), turn


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_reactions_have_the_power_of_their_rows_and_forces(dimension, variant):
    """Listed forces at their points and torques, times velocities, against generalized forces times speeds."""
    system = scene(dimension, variant)
    names = [body.name for body in system.scene.bodies]
    rng = np.random.default_rng(8)
    nu = rng.uniform(0.2, 1.2, system.n_c)
    for q, u in states(system, 2):
        J = system.dynamics(q, u, TIME).J
        found = {}
        for x in reactions(system, q, u, J, nu):
            found.setdefault(x.owner, []).append(x)
        for item, part in items(system):
            rows = own_rows(system, item)
            if not rows and not item.kind.transmits:
                assert item.entry.called not in found
                continue
            load = -nu[rows] @ J[rows] if rows else -part.dynamics(q, u, TIME).F0
            listed = found[item.entry.called]
            for x in listed:
                if x.body == "ground":
                    continue
                body = names.index(x.body)
                own = system.body_slices[body]
                if x.point is None:  # a contact, whose force acts where the body touches
                    assert x.force == pytest.approx(load[own][: len(x.force)], rel=1e-12)
                    continue
                velocity, turn = speeds_of(system, body, q, u, x.point)
                power = x.force @ velocity + (x.torque @ turn if len(x.torque) else 0.0)
                assert power == pytest.approx(load[own] @ u[own], rel=1e-7, abs=1e-8), item.entry.path
            acted = [
                name for name, own in zip(names, system.body_slices, strict=True) if np.any(np.abs(load[own]) > 1e-12)
            ]
            if len(listed) > 1:
                assert {x.body for x in listed} - {"ground"} == set(acted), item.entry.path
                assert sum(x.force for x in listed) == pytest.approx(0.0, abs=1e-12)
            else:
                assert listed[0].body in acted


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_what_acts_between_bodies_is_in_balance(dimension, variant):
    """Forces and rows between bodies that both move do no work where all move together as one rigid body."""
    system = scene(dimension, variant)
    for q, u in states(system, 2):
        J = system.dynamics(q, u, TIME).J
        for item, part in items(system):
            markers = item.points_acted_on()
            if len(markers) < 2 or any(marker.body == GROUND for marker in markers):
                continue
            rows = own_rows(system, item)
            loads = J[rows] if rows else part.dynamics(q, u, TIME).F0[None]
            for k, motion in enumerate(rigid_motions(system, q)):
                if rows and k >= dimension and not item.kind.transmits:
                    continue  # a rotation turns gaps, which only constraints close
                assert loads @ motion == pytest.approx(0.0, abs=1e-10), item.entry.path


def rigid_motions(system, q):
    """Yield the speeds of all bodies under the translations and rotations of the whole."""
    d = system.scene.dimension
    axes = np.eye(3)
    for k in range(d):
        u = np.zeros(system.n_q)
        for part in system.body_slices:
            u[part.start + k] = 1.0
        yield u
    for axis in axes if d == 3 else axes[2:]:
        u = np.zeros(system.n_q)
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            place, angles = slice(part.start, part.start + d), slice(part.start + d, part.stop)
            u[place] = np.cross(axis, [*q[place], 0.0][:3])[:d]
            if body.orientation:
                u[angles] = np.linalg.solve(rate_matrix(body, q[angles]), axis) if d == 3 else 1.0
        yield u


# --- proof ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dimension", "variant"), SCENES)
def test_forces_and_rows_are_enclosed_in_balls(dimension, variant):
    system = scene(dimension, variant)
    ((q, u),) = states(system, 1)
    with balls.digits(30):
        exact = System(evaluate(system.scene.model, {}, balls.ball_arithmetic()))
        point = [[balls.ball(x) for x in y.tolist()] for y in (q, u)]
        enclosed, plain = exact.dynamics(*point, balls.ball(TIME)), system.dynamics(q, u, TIME)
        for name in ("M", "F0", "E", "V", "J", "B"):
            for x, y in zip(np.ravel(getattr(enclosed, name)), np.ravel(getattr(plain, name)), strict=True):
                assert abs(float(balls.real(x).mid()) - y) <= 1e-11 * max(1.0, abs(y)), name
                assert float(balls.real(x).rad()) <= 1e-25 * max(1.0, abs(y)), name


# --- published results ----------------------------------------------------------------------------------------------

JOINTS = "test_motion.py: test_a_body_on_a_spatial_joint_moves_as_its_closed_form_says"
ELSEWHERE = {
    ("joints", "cylindrical"): JOINTS,
    ("joints", "fixed"): JOINTS,
    ("joints", "screw"): JOINTS,
    ("forces", "bearing"): "test_families.py: test_a_shaft_turns_at_any_speed_and_every_command_says_so",
    ("forces", "potential"): "test_potentials.py: test_an_oscillator_has_its_closed_form",
    ("forces", "dissipation"): "test_potentials.py: test_an_oscillator_has_its_closed_form",
    ("forces", "state_space"): "test_controllers.py: test_a_state_space_controller",
}
"""Tests with closed forms or published numbers of the parts that no example has."""


def test_every_part_has_a_published_result():
    """In the expectations of an example, each with its source, or in a test."""
    shipped = {
        (section, entry.kind.name)
        for path in installed_models()
        for section, entries in mbstab.load(path).model.entries.items()
        for entry in entries.values()
    }
    assert set(PARTS) - shipped == set(ELSEWHERE)
    for (_, name), place in ELSEWHERE.items():
        file, _, test = place.partition(": ")
        text = (Path(__file__).parent / file).read_text(encoding="utf-8")
        assert f"def {test}(" in text, place
        assert f"type: {name}" in text, place
