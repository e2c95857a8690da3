"""The same mechanism, described otherwise, has the same eigenvalues and the same verdict.

The examples stand upright in round numbers, where wrong terms often vanish. Here each is renamed, put in another order,
moved within its bodies, mirrored, turned, measured in other units, and all of these together.
"""

import functools
import random
import re
from itertools import product

import numpy as np
import pytest
import yaml
from descriptions import (
    dimension,
    in_other_units,
    in_small_units,
    load,
    mirrored,
    mirrored_in_space,
    read,
    renamed_and_reordered,
    turned,
    with_other_reference_points,
)
from linear_oracle import random_system, text, truth
from sampling import sample
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.verdict.rule import ASYMPTOTIC_UP_TO, STABLE_UP_TO, STRENGTH, UNDECIDED
from mbstab.errors import MbstabError
from mbstab.model.library import installed_models

MODELS = {path.stem: path.read_text(encoding="utf-8") for path in installed_models()}
# The same spin about the vertical, found from the rates and declared.
MODELS["spinning_rattleback"] = MODELS["rattleback"].replace("omega: {value: 0,", "omega: {value: 5,")
MODELS["steady_rattleback"] = MODELS["spinning_rattleback"].replace(
    "  rates:\n    stone: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: omega}", "  steady: {axis: z, rate: omega}"
)
SPATIAL = {name for name, text in MODELS.items() if "type: spatial" in text}
PLANAR = sorted(set(MODELS) - SPATIAL)
# Their masses are numbers in the bodies and their axes named directions; some transformations act on parameters only.
WRITTEN_OUT = {"whipple_bicycle", "motorcycle"}
PLAIN = sorted(set(MODELS) - WRITTEN_OUT)
# Springs of one act along axes of the ground that cannot be named; axes of the other are expressions.
TURNABLE = sorted(set(PLAIN) - {"wheelset_creep", "drive_shafts"})

# On the axis of the spin the reference point may lie anywhere. A free body that turns with its first Euler angle is
# left out: a tilt would carry a point off its centre of mass around, and the equations would not stand still.
# Where the frame turns with the scene any point will do; here the same is taken for all bodies.
SPIN_AXIS = {
    name: 2
    for name in (
        *("top", "rolling_disk", "rolling_torus", "rattleback", "spinning_rattleback", "steady_rattleback"),
        *("governor", "governor_paper", "rotating_pendulum", "bead_on_hoop", "bricard"),
    )
}
# Wheels of a train turn freely together: a symmetry only where the origins of their frames lie on their axles.
TRAINS = {"gear_train", "differential", "belt_drive", "roller_in_ring"}
MOVABLE = [name for name in MODELS if name in SPIN_AXIS or (name in PLANAR and name not in TRAINS)]
PLANAR_SHIFT = (0.13, -0.21)


def everything(model, name):
    model = in_small_units(model)
    if name in MOVABLE:
        model = with_other_reference_points(model, shift_of(name))
    model = mirrored(model) if dimension(model) == 2 else mirrored_in_space(model)
    return renamed_and_reordered(turned(model))


def shift_of(name):
    if name in PLANAR:
        return PLANAR_SHIFT
    return [0.17 * float(i == SPIN_AXIS[name]) for i in range(3)]


def assert_close(found, original, time, rtol):
    """Compare eigenvalues in units of time; what may be zero in one must be zero within its bound in the other."""
    others = [e.value for e in original.eigenvalues if e.kind != "neutral" and abs(e.value) > e.error_bound]
    judged = sorted((e for e in found.eigenvalues if e.kind != "neutral"), key=lambda e: -abs(e.value))
    assert len(judged) == len(original.values())
    judged, zeros = judged[: len(others)], judged[len(others) :]
    assert all(abs(e.value) <= e.error_bound for e in zeros)
    expected = np.array(others) / time
    np.testing.assert_array_less(matched([e.value for e in judged], expected), rtol * np.abs(expected))


@functools.cache
def answer(name):
    return mbstab.loads(MODELS[name]).eig()


def assert_same(name, model):
    original, found = answer(name), load(model).eig()
    assert found.verdict == original.verdict
    assert found.counts.neutral == original.counts.neutral
    assert [len(x) for x in vars(found.modulo).values()] == [len(x) for x in vars(original.modulo).values()]
    assert_close(found, original, 1.0, 1e-11)


@pytest.mark.parametrize("name", MODELS)
def test_names_and_order_do_not_matter(name):
    assert_same(name, renamed_and_reordered(read(MODELS[name])))


@pytest.mark.parametrize("name", MOVABLE)
def test_the_place_of_the_reference_point_in_a_body_does_not_matter(name):
    assert_same(name, with_other_reference_points(read(MODELS[name]), shift_of(name)))


@pytest.mark.parametrize("name", PLANAR)
def test_left_and_right_do_not_matter(name):
    assert_same(name, mirrored(read(MODELS[name])))


@pytest.mark.parametrize("name", sorted(SPATIAL - WRITTEN_OUT))
def test_left_and_right_do_not_matter_in_space(name):
    assert_same(name, mirrored_in_space(read(MODELS[name])))


@pytest.mark.parametrize("name", ["flyball_governor", "turntable"])
def test_axes_that_are_parallel_to_sixteen_digits_are_parallel(name):
    assert_same(name, turned(read(MODELS[name])))


def test_in_a_proof_decimals_are_what_is_written():
    """Gravity and its axis are the same expressions; decimals of 16 digits stand for the frames of bodies alone."""
    proven = load(turned(read(MODELS["flyball_governor"]))).certify()
    assert (proven.verdict, proven.proven) == ("asymptotically stable up to symmetry", False)
    assert "provided that the steady motion satisfies the equations" in proven.statement


@pytest.mark.parametrize("name", TURNABLE)
def test_the_direction_of_the_axes_does_not_matter(name):
    assert_same(name, turned(read(MODELS[name])))


@pytest.mark.parametrize("name", PLAIN)
def test_declared_units_do_not_matter(name):
    assert_same(name, in_small_units(read(MODELS[name])))


@pytest.mark.parametrize("name", TURNABLE)
def test_all_of_these_together_do_not_matter(name):
    assert_same(name, everything(read(MODELS[name]), name))


# What a metre, a kilogram and a second are in other units.
UNITS = {
    "km-Gg-h": (1e-3, 1e-6, 1.0 / 3600.0),
    "nm-fg-ns": (1e9, 1e18, 1e9),
    "none in use": (25.4e-6, 453.6e3, 7.7e-4),
}


def scales(length, mass, time):
    return {"kg": mass, "m": length, "mm": length, "s": time, "N": mass * length / time**2, "rad": 1.0, "deg": 1.0} | {
        "V": mass * length**2 / time**3,
        "ohm": mass * length**2 / time**3,
        "H": mass * length**2 / time**2,
        "A": 1.0,
    }


# Numbers outside their parameters would have to be scaled too in the others.
WRITTEN = {
    "slider_crank",
    "trailer",
    "car",
    "car_relaxation",
    "car_trailer",
    "rigid_rotor",
    "rotor_stator",
    "rotor_table",
    "rack_and_pinion",
    "drive_shafts",
    "car_turn",
} | TRAINS
# The size of a state is one in whatever unit, and its family or its value is not found where it is far from that.
ALL_IN_PARAMETERS = sorted(set(PLAIN) - WRITTEN - {"cart_pendulum", "robot_arm", "levitation", "shimmy_relaxation"})


@pytest.mark.parametrize(("name", "units"), sample([(x, y) for x in ALL_IN_PARAMETERS for y in UNITS], 4))
def test_a_model_of_other_size_mass_and_speed_has_eigenvalues_scaled_by_the_time(name, units):
    model, factors, time = mbstab.loads(MODELS[name]), scales(*UNITS[units]), UNITS[units][2]
    values, own = model.parameters(), model.model.parameters
    scaled = {k: values[k] * in_other_units(p.unit, factors) / p.factor for k, p in own.items() if p.expression.literal}
    original, found = answer(name), model.eig(**scaled)
    assert (found.verdict, found.counts) == (original.verdict, original.counts)
    # Which of two speeds that lead to each other is named first depends on rounding.
    for part in ("symmetries", "family"):
        assert sorted(getattr(found.modulo, part)) == sorted(getattr(original.modulo, part))
    assert_close(found, original, time, 1e-12)


COIN = """
mbstab: 1
parameters: {m: 5, r: 0.3, v: 2}
gravity: [0, 0, -9.81]
bodies:
  disc: {type: spatial, mass: m, axes: AXES, inertia: [m*r**2/4, m*r**2/4, m*r**2/2]}
contacts:
  floor: {type: wheel, center: disc, axle: z, radius: r}
reference:
  coordinates: {disc: {z: HEIGHT}}
  rates: {disc: {psi: v/r}}
"""
"""A coin that rolls upright."""
LYING = ["[-90*deg, 0, 0]", "[pi/2, 0, 0]", "[0, 90*deg, 0]", "[0, -pi/2, 0]"]
"""Frames of the coin in which its axle is horizontal."""


@pytest.mark.parametrize("axes", LYING)
@pytest.mark.parametrize("height", ["r", "0.30000000000000004", "r + 3e-17"])
def test_rounding_of_a_right_angle_does_not_let_a_height_determine_the_lean(axes, height):
    """The cosine of the double next to π/2 is 6e-17: the row of the contact depends on the lean by rounding alone."""
    model = mbstab.loads(COIN.replace("AXES", axes).replace("HEIGHT", height))
    found = model.eig()
    (pair,) = {abs(e.value.imag) for e in found.eigenvalues if e.kind != "neutral"}
    # A thin disc (Routh 1905, Advanced Rigid Dynamics, section 244): 5 ω² = 12 v²/r² − 4 g/r.
    assert pair == pytest.approx(np.sqrt((12.0 * 2.0**2 / 0.3**2 - 4.0 * 9.81 / 0.3) / 5.0), rel=1e-13)
    assert max(e.error_bound for e in found.eigenvalues if e.kind != "neutral") < 1e-11
    assert found.verdict == "stable up to symmetry"
    assert model.sweep("v", [1.0, 2.0, 3.0]).verdicts == ["stable up to symmetry"] * 3


# --- systems of known stability: what stands far away makes a verdict weaker at most ----------------------------------


SECTIONS = ("bodies", "joints", "constraints", "contacts", "drives", "forces")
KEYS = {"x", "y", "z", "phi", "theta", "psi"}
NAMES = [system.name for system in SYSTEMS]
TEXTS = {system.name: system.text for system in SYSTEMS}


def verdict(document):
    """Return the verdict, open where the model is refused: a refusal claims nothing."""
    model = document if isinstance(document, str) else yaml.safe_dump(document, sort_keys=False)
    try:
        result = mbstab.loads(model).eig()
    except MbstabError:
        return UNDECIDED
    # Where nothing is left to judge, all of it decays as well.
    nothing = result.verdict == STABLE_UP_TO and result.counts.neutral == result.counts.found
    return ASYMPTOTIC_UP_TO if nothing else result.verdict


def exchanged(document):
    """Write all entries of all sections the other way round."""
    return {key: dict(reversed(x.items())) if key in SECTIONS else x for key, x in document.items()}


def renamed(document):
    """Give all bodies other names, in another alphabetical order."""
    names = {name: f"{'zyxwv'[k % 5]}_{k}_body" for k, name in enumerate(document["bodies"])}

    def changed(x, key=""):
        if isinstance(x, dict):
            return {names.get(k, changed(k)): changed(y, k) for k, y in x.items()}
        if isinstance(x, list):
            return [changed(y, key) for y in x]
        if not isinstance(x, str) or key in ("title", "source", "description", "type"):
            return x
        return names.get(x, re.sub(r"(?<![\w.])(\w+)(?=\.)", lambda m: names.get(m[1], m[1]), x))

    return changed(document)


def beside(damping):
    """Return what adds a heavy oscillator far away."""

    def changed(document):
        planar = any("planar" in str(body.get("type", "")) for body in document["bodies"].values())
        others = "y" if planar else "yz"
        found = {key: dict(x) if isinstance(x, dict) else x for key, x in document.items()}
        found["bodies"]["far"] = {"type": "planar_point" if planar else "point", "mass": "1e6"}
        law = f"-2e6*(far.x - 1000) - {damping}*rate(far.x)"
        found.setdefault("forces", {})["far"] = {"type": "expression", "on": {"far.x": law}}
        rows = {f"far_{k}": {"holonomic": f"far.{k} - 50"} for k in others}
        found["constraints"] = {**found.get("constraints", {}), **rows}
        reference = dict(found.get("reference", {}))
        places = {"x": 1000, **dict.fromkeys(others, 50)}
        reference["coordinates"] = {**reference.get("coordinates", {}), "far": places}
        found["reference"] = reference
        return found

    return changed


CHANGES = {
    "exchanged": exchanged,
    "renamed": renamed,
    "beside an oscillator": beside("0"),
    "beside a damped oscillator": beside("1e5"),
}


@functools.cache
def known(name):
    """Return the verdict on a system as it is written in the zoo."""
    return verdict(TEXTS[name])


@pytest.mark.parametrize(("name", "change"), sample(product(NAMES, CHANGES), 9))
def test_the_verdict_is_the_same_or_weaker(name, change):
    # All as texts: they are expressions.
    document = yaml.load(TEXTS[name], Loader=yaml.BaseLoader)
    before, after = known(name), verdict(CHANGES[change](document))
    assert after in STRENGTH[before] or before in STRENGTH[after]
    if change in ("exchanged", "renamed"):
        assert after == before
    else:
        assert after in STRENGTH[before]


def scaled(rng, K, D):
    """Return K and D in other units of each coordinate and of time."""
    n = len(K)
    units, time = [3.7 ** rng.randint(-3, 3) for _ in range(n)], 1.7 ** rng.randint(-3, 3)
    return (
        [[K[i][j] * time**2 * units[j] / units[i] for j in range(n)] for i in range(n)],
        [[D[i][j] * time * units[j] / units[i] for j in range(n)] for i in range(n)],
    )


@pytest.mark.parametrize(("seed", "systems"), sample([(8, 30), (8, 150)], 2))
def test_units_change_no_verdict_on_a_linear_system_but_to_a_weaker_one(seed, systems):
    rng, same = random.Random(seed), 0
    for _ in range(systems):
        K, D = random_system(rng, rng.randint(1, 4))
        known, before = truth(K, D), verdict(text(K, D))
        after = verdict(text(*scaled(rng, K, D)))
        assert after in known.allowed, (K, D)
        assert after in STRENGTH[before], (K, D)
        same += after == before
    assert same >= 0.8 * systems
