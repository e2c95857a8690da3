"""The same mechanism, described otherwise: model files as dictionaries, and what may be done to them."""

import json
import math
import re

import numpy as np
import yaml

import mbstab
from mbstab.model.reader import expanded_text

PLANAR_ANGLE = 0.7331
SPATIAL_ANGLES = (0.5, -0.8, 1.1)

AXES = {name: [float(i == k) for i in range(3)] for k, name in enumerate("xyz")}


# --- vectors of numbers and expressions -----------------------------------------------------------------------------


def written(vector, dimension):
    """Return a vector that may be written as an axis, such as -x, as a list."""
    if isinstance(vector, str):
        sign = -1.0 if vector.startswith("-") else 1.0
        return [sign * x for x in AXES[vector.removeprefix("-")][:dimension]]
    return list(vector) if vector != 0 else [0.0] * dimension


def both_axes(axis, dimension):
    """Return an axis in the frames of both bodies; it may be written once for both."""
    if isinstance(axis, list) and all(isinstance(x, list) or str(x).removeprefix("-") in AXES for x in axis):
        return [written(x, dimension) for x in axis]
    return [written(axis, dimension)] * 2


def times(matrix, vector):
    return [" + ".join(f"({a})*({x})" for a, x in zip(row, vector, strict=True)) for row in matrix]


def plus(a, b, sign="+"):
    return [f"({x}) {sign} ({y})" for x, y in zip(a, b, strict=True)]


def planar_rotation(angle):
    return [[f"cos({angle})", f"-sin({angle})"], [f"sin({angle})", f"cos({angle})"]]


def spatial_rotation(phi, theta, psi):
    (c1, s1), (c2, s2), (c3, s3) = ((f"cos({x})", f"sin({x})") for x in (phi, theta, psi))
    return [
        [f"{c2}*{c3}", f"-{c2}*{s3}", s2],
        [f"{c1}*{s3} + {s1}*{s2}*{c3}", f"{c1}*{c3} - {s1}*{s2}*{s3}", f"-{s1}*{c2}"],
        [f"{s1}*{s3} - {c1}*{s2}*{c3}", f"{s1}*{c3} + {c1}*{s2}*{s3}", f"{c1}*{c2}"],
    ]


def product(a, b):
    return [
        [" + ".join(f"({x})*({y})" for x, y in zip(row, column, strict=True)) for column in zip(*b, strict=True)]
        for row in a
    ]


def with_base(body, rotation):
    return product(spatial_rotation(*body["axes"]), rotation) if "axes" in body else rotation


def number(text):
    return float(eval(str(text), {"pi": math.pi, "cos": math.cos, "sin": math.sin}))


def angles_of(rotation):
    """Return the Euler angles of a rotation that is written with numbers."""
    A = np.array([[number(x) for x in row] for row in rotation])
    return [math.atan2(-A[1, 2], A[2, 2]), math.asin(A[0, 2]), math.atan2(-A[0, 1], A[0, 0])]


# --- models as dictionaries -----------------------------------------------------------------------------------------


def read(text):
    model = yaml.safe_load(expanded_text(mbstab.loads(text).model))
    for section in ("expect", "sweep", "title", "source", "initial", "inputs", "outputs", "modes"):
        model.pop(section, None)
    model["reference"].setdefault("guess", {})
    for entry in model.get("forces", {}).values():
        if True in entry:  # what PyYAML takes the key `on` for
            entry["on"] = entry.pop(True)
    # A place of which some components are held and others sought is sought as a whole: constraints hold it as well.
    coordinates, guess = model["reference"].get("coordinates", {}), model["reference"]["guess"]
    for body in set(coordinates) & set(guess):
        for key in set(coordinates[body]) & set("xyz"):
            if set(guess[body]) & set("xyz"):
                guess[body][key] = coordinates[body].pop(key)
    return model


def dimension(model):
    return 3 if any(body["type"] == "spatial" for body in model["bodies"].values()) else 2


def load(model):
    # Every JSON text is a YAML text.
    return mbstab.loads(json.dumps(model, indent=1))


def entries(model):
    return [e for section in ("joints", "contacts", "drives", "forces") for e in model.get(section, {}).values()]


def states(model):
    """Return the reference points that are given, and those that are guessed, with the angles that go with them."""
    coordinates, guess = (model["reference"].get(key, {}) for key in ("coordinates", "guess"))
    for body in model["bodies"]:
        angles = {**guess.get(body, {}), **coordinates.get(body, {})}
        for state in (coordinates.get(body), guess.get(body)):
            if state is not None:
                yield body, state, angles


def in_ground(model, change):
    """Apply a linear change to all vectors in the ground."""
    n = dimension(model)
    if "gravity" in model:
        model["gravity"] = change(written(model["gravity"], n))
    for group in ("points", "directions"):
        for name, vector in model.get("ground", {}).get(group, {}).items():
            model["ground"][group][name] = change(written(vector, n))
    steady = model["reference"].get("steady", {})
    for key in ("axis", "point", "direction"):
        if key in steady and (n == 3 or key != "axis"):
            steady[key] = change(written(steady[key], n))
    for entry in entries(model):
        if entry["type"] == "disk":
            entry["normal"] = change(written(entry.get("normal", "y"), n))
        if entry["type"] in ("wheel", "ellipsoid"):
            entry["normal"] = change(written(entry.get("normal", "z"), n))
        if entry["type"] == "creep" and n == 3:
            entry |= {
                key: change(written(entry.get(key, usual), n)) for key, usual in (("rails", "x"), ("normal", "z"))
            }
        if "direction" in entry:
            entry["direction"] = change(written(entry["direction"], n))


def places(model, change):
    """Apply a linear change to the reference points and their speeds; a guess of one component guesses them all."""
    names = "xyz"[: dimension(model)]
    reference = model["reference"]
    for key in ("coordinates", "rates", "guess"):
        for state in reference.get(key, {}).values():
            given = [name for name in names if name in state]
            if given:
                assert key == "guess" or len(given) == len(names)
                state.update(zip(names, change([state.get(name, "0") for name in names]), strict=True))


ACTING = ("pid", "state_feedback", "transfer_function", "motor")
"""Types of entries whose efforts are written for one sense of their joint."""

VELOCITY = re.compile(r"\bvx\(([\w.]+)\)")


def in_velocities(model, change):
    """Write constraints with vx(…) in another way: `change` maps what stands in the brackets."""
    for entry in model.get("constraints", {}).values():
        for key in entry:
            entry[key] = VELOCITY.sub(lambda m: change(m[1]), str(entry[key]))


def negated(entry, keys):
    for key in set(keys) & set(entry):
        entry[key] = f"-({entry[key]})"


NAME = re.compile(r"rate\((\w+)\.(\w+)\)|(?<!vx\()\b([A-Za-z_]\w*)\.([A-Za-z]\w*)")


def in_expressions(model, place, rate, force):
    """Write expressions with other coordinates.

    `place` and `rate` map the coordinates and rates of a body to what stands for them, by coordinate, and `force` its
    generalized forces to those by the other coordinates, with the name that the body has then.
    """

    def other(expression):
        return NAME.sub(lambda m: f"({rate(m[1])[m[2]] if m[1] else place(m[3])[m[4]]})", str(expression))

    for entry in model.get("constraints", {}).values():
        for key in entry:
            entry[key] = other(entry[key])
    for entry in model.get("forces", {}).values():
        if "gains" in entry:
            entry["gains"] = {other(signal): gain for signal, gain in entry["gains"].items()}
        if entry["type"] == "expression":
            loads = {}
            for coordinate, load in entry["on"].items():
                body, _, key = coordinate.partition(".")
                loads.setdefault(body, {})[key] = other(load)
            changed = {}
            for body, load in loads.items():
                name, load = force(body, {"x": "0", "y": "0", "theta": "0"} | load)
                changed |= {f"{name}.{key}": value for key, value in load.items()}
            entry["on"] = changed


def planar_state(body, wrap="{}"):
    return {key: wrap.format(f"{body}.{key}") for key in ("x", "y", "theta")}


# --- other descriptions ---------------------------------------------------------------------------------------------


def renamed_and_reordered(model):
    """Rename all bodies, turn every order around, and swap the two ends of every joint."""
    names = {body: f"part_{9 - i}" for i, body in enumerate(model["bodies"])}

    def other(word):
        if isinstance(word, dict):
            return word | {"body": other(word["body"])}
        body, dot, rest = word.partition(".")
        return names.get(body, body) + dot + rest

    # The axis along which a controller acts stands in the second body; the cart would lean on its rail. Targets and
    # voltages count their angles from the second body, too.
    kept = [model["joints"][entry["joint"]] for entry in entries(model) if entry["type"] in ACTING]
    for entry in entries(model):
        rename_and_swap(entry, other, dimension(model), entry in kept)
    in_velocities(model, lambda word: f"vx({other(word)})")
    in_expressions(
        model,
        place=lambda body: planar_state(names[body]),
        rate=lambda body: planar_state(names[body], "rate({})"),
        force=lambda body, load: (names[body], dict(reversed(load.items()))),
    )
    model["bodies"] = {names[body]: model["bodies"][body] for body in reversed(model["bodies"])}
    for key in ("coordinates", "rates", "guess"):
        if key in model["reference"]:
            model["reference"][key] = {names[body]: state for body, state in model["reference"][key].items()}
    for section in ("joints", "contacts", "drives", "forces", "constraints"):
        if section in model:
            model[section] = dict(reversed(model[section].items()))
    first = ("mbstab", "parameters")
    return {key: model[key] for key in (*first, *reversed([key for key in model if key not in first]))}


def rename_and_swap(entry, other, n, kept):
    """Rename the bodies of an entry, and swap its two ends where that changes nothing."""
    for key in ("at", "center", "coordinate", "body", "of"):
        if key in entry:
            entry[key] = other(entry[key])
    if kept or entry["type"] in ("point_on_plane", "point_on_line", "rollers", "rotor_bearing", "bushing"):
        # Plane and line are those of the first body, which rolls inside; directions are those of the second.
        entry["between"] = [other(word) for word in entry["between"]]
    elif "between" in entry:
        entry["between"] = [other(word) for word in reversed(entry["between"])]
        if isinstance(entry.get("axis"), list):
            entry["axis"] = (both_axes(entry["axis"], 3) if n == 3 else entry["axis"])[::-1]
            entry |= {"zero": entry["zero"][::-1]} if "zero" in entry and n == 3 else {}
    if entry["type"] == "joint" and "joint" in entry:
        # The angle is that of the second body against the first one.
        negated(entry, ("position", "velocity"))
    if entry["type"] == "joint_spring":
        entry["rest"] = f"-({entry.get('rest', 0)})"


def with_other_reference_points(model, shift):
    """Move the origin of every body frame; x, y, z are the coordinates of another point then."""
    n, model["parameters"]["metre"] = dimension(model), {"value": 1, "unit": "m"}

    def arm(body, turned="0"):
        """From the old origin to the new one, in the ground."""
        return times(planar_rotation(f"({body}.theta + {turned})"), shift)

    def place(body):
        x, y = plus([f"{body}.x", f"{body}.y"], arm(body), "-")
        return planar_state(body) | {"x": x, "y": y}

    def rate(body):
        turning = [f"rate({body}.theta)*({x})" for x in arm(body, "pi/2")]
        x, y = plus([f"rate({body}.x)", f"rate({body}.y)"], turning, "-")
        return planar_state(body, "rate({})") | {"x": x, "y": y}

    def force(body, load):  # it acts at the old origin
        loads = zip(arm(body, "pi/2"), (load["x"], load["y"]), strict=True)
        moment = [f"({x})*metre*({f})" for x, f in loads if f != "0"]
        return body, load | {"theta": " - ".join([f"({load['theta']})", *moment])}

    for name, body in model["bodies"].items():
        if body["type"] in ("planar_point", "point"):
            continue
        if "parts" in body:
            for part in body["parts"]:
                place = part.get("at", 0)
                part["at"] = plus(place if isinstance(place, list) else ["0"] * n, shift, "-")
        else:
            body["center_of_mass"] = plus(body.get("center_of_mass", ["0"] * n), shift, "-")
        body["points"] = {
            key: plus(point if isinstance(point, list) else ["0"] * n, shift, "-")
            for key, point in body.get("points", {}).items()
        }
        body["points"]["old_origin"] = [-x for x in shift]
        for entry in entries(model):
            for key in ("at", "center"):
                if entry.get(key) == name:
                    entry[key] = f"{name}.old_origin"
            if "between" in entry:
                entry["between"] = [f"{name}.old_origin" if word == name else word for word in entry["between"]]
    for body, state, angles in states(model):
        given = [key for key in "xyz"[:n] if key in state]
        if given and model["bodies"][body]["type"] not in ("planar_point", "point"):
            rotation = (
                planar_rotation(angles.get("theta", "0"))
                if n == 2
                else with_base(
                    model["bodies"][body], spatial_rotation(*(angles[key] for key in ("phi", "theta", "psi")))
                )
            )
            moved = plus([state.get(key, "0") for key in "xyz"[:n]], times(rotation, shift))
            state.update(zip("xyz"[:n], moved, strict=True))
    in_expressions(model, place, rate, force)
    in_velocities(model, lambda body: f"vx({body}.old_origin)")
    for body, rates in model["reference"].get("rates", {}).items():
        # In the plane the bodies of the examples do not turn; in space the point lies on the axis of the spin.
        assert n == 3 or rates.get("theta", 0) == 0, body
    return model


def mirrored(model):
    """Reflect a planar scene at the y axis: the frames of the bodies too, so that angles change sign."""

    def reflect(vector):
        return [f"-({vector[0]})", vector[1]]

    def signs(state):
        return {key: value if key == "y" else f"-({value})" for key, value in state.items()}

    in_ground(model, reflect)
    places(model, reflect)
    in_expressions(
        model,
        place=lambda body: signs(planar_state(body)),
        rate=lambda body: signs(planar_state(body, "rate({})")),
        force=lambda body, load: (body, signs(load)),
    )
    for body in model["bodies"].values():
        for group in ("points", "directions"):
            body[group] = {key: reflect(vector) for key, vector in body.get(group, {}).items()}
        if "center_of_mass" in body:
            body["center_of_mass"] = reflect(body["center_of_mass"])
        if body["type"] == "planar_point":
            del body["points"], body["directions"]
    in_velocities(model, lambda word: f"-vx({word})")
    for entry in entries(model):
        for key in {"tyre": ("along",), "creep": ("along", "rails")}.get(entry["type"], ()):
            entry.setdefault(key, "x")
        if entry["type"] == "pid" and model["joints"][entry["joint"]]["type"] == "prismatic":
            # What it controls in the examples is an angle, what it acts on a travel.
            negated(entry, "PID")
        elif entry["type"] == "pid":
            negated(entry, ("target",))
        for key in ("axis", "along", "rails", "vector"):
            if key in entry:
                entry[key] = reflect(written(entry[key], 2))
        if entry["type"] == "joint_spring":
            entry["rest"] = f"-({entry.get('rest', 0)})"
        if entry["type"] == "torque":
            entry["value"] = f"-({entry['value']})"
    for key in ("coordinates", "rates", "guess"):
        for state in model["reference"].get(key, {}).values():
            if "theta" in state:
                state["theta"] = f"-({state['theta']})"
    return model


def turned(model):
    """Turn the whole scene about an axis that is none of x, y, z."""
    flat = dimension(model) == 2
    rotation = planar_rotation(PLANAR_ANGLE) if flat else spatial_rotation(*SPATIAL_ANGLES)

    def turn(vector):
        return times(rotation, vector)

    def back(state, angle):
        places = times(planar_rotation(-PLANAR_ANGLE), [state["x"], state["y"]])
        return {"x": places[0], "y": places[1], "theta": f"{state['theta']} - {angle}"}

    in_ground(model, turn)
    places(model, turn)
    in_expressions(
        model,
        place=lambda body: back(planar_state(body), PLANAR_ANGLE),
        rate=lambda body: back(planar_state(body, "rate({})"), 0),
        force=lambda body, load: (body, load | dict(zip("xy", turn([load["x"], load["y"]]), strict=True))),
    )
    for entry in entries(model):
        turn_entry(entry, turn, flat, model)
    for state in (s for key in ("coordinates", "guess") for s in model["reference"].get(key, {}).values()):
        if flat and "theta" in state:
            state["theta"] = f"({state['theta']}) + {PLANAR_ANGLE}"
    if not flat:
        for body in model["bodies"].values():
            if body["type"] == "spatial":
                body["axes"] = angles_of(product(rotation, spatial_rotation(*body.get("axes", [0, 0, 0]))))
    return model


def turn_entry(entry, turn, flat, model):
    """Turn what an entry writes in the ground; its angles count from there."""

    def ends(axis):
        # An axis is written in the frames of both bodies; the ground does not turn with the scene.
        both = zip(entry["between"], both_axes(axis, 2 if flat else 3), strict=True)
        return [turn(axis) if word.partition(".")[0] == "ground" else axis for word, axis in both]

    kind = entry["type"]
    if kind in ("bushing", "rotor_bearing") and not flat:
        for key, usual in zip(("axis", "zero"), ("x", "y") if kind == "bushing" else ("z", "x"), strict=True):
            entry[key] = ends(entry.get(key, usual))
    elif "axis" in entry:
        entry["axis"] = ends(entry["axis"])
    if "joint" in entry and "ground" in model["joints"][entry["joint"]]["between"]:
        count_from_turned_ground(entry, model["joints"][entry["joint"]]["type"])
    if kind == "joint" and not flat and "position" in entry:
        # Its angle counts from a direction that is across the axis, z in the examples.
        joint = model["joints"][entry["joint"]]
        joint["zero"] = [turn(AXES["x"]) if word == "ground" else AXES["x"] for word in joint["between"]]
    if kind == "force" and entry.get("frame") != "body":
        entry["vector"] = turn(entry["vector"])


def count_from_turned_ground(entry, joint):
    """Let what acts along a joint with the ground count the angle from the axes that turn with the scene."""
    if entry["type"] == "pid":
        entry["target"] = f"({entry.get('target', 0)}) + {PLANAR_ANGLE}"
    if entry["type"] == "joint_spring" and joint != "prismatic":
        entry["rest"] = f"({entry.get('rest', 0)}) + {PLANAR_ANGLE}"
    if entry["type"] == "motor":
        entry["voltage"] = entry["voltage"].replace(
            f"angle({entry['joint']})", f"(angle({entry['joint']}) - {PLANAR_ANGLE})"
        )


def mirrored_in_space(model):
    """Reflect a spatial scene at the plane of x and z, the frames of the bodies too: φ and ψ change sign."""

    def reflect(vector):
        return [vector[0], f"-({vector[1]})", vector[2]]

    in_ground(model, reflect)
    places(model, reflect)
    for body in model["bodies"].values():
        for group in ("points", "directions"):
            if group in body:
                body[group] = {
                    key: reflect(vector if isinstance(vector, list) else ["0"] * 3)
                    for key, vector in body[group].items()
                }
        for part in (body, *body.get("parts", [])):
            for key in ("center_of_mass", "at"):
                if isinstance(part.get(key), list):
                    part[key] = reflect(part[key])
        if isinstance(body.get("inertia"), dict):
            negated(body["inertia"], ("xy", "yz"))
        if "axes" in body:
            body["axes"] = [f"-({body['axes'][0]})", body["axes"][1], f"-({body['axes'][2]})"]
    for entry in entries(model):
        for key in ("axle", "along", "vector"):
            if key in entry:
                entry[key] = reflect(written(entry[key], 3))
        for key in {"axis", "zero"} & set(entry):
            entry[key] = [reflect(axis) for axis in both_axes(entry[key], 3)]
        if entry["type"] == "joint_spring":
            entry["rest"] = f"-({entry.get('rest', 0)})"
        if entry["type"] == "rotor_bearing":
            negated(entry, ("kxy", "kyx", "cxy", "cyx"))
        if entry["type"] == "joint" or entry.get("coordinate", "").endswith((".phi", ".psi")):
            negated(entry, ("position", "velocity"))
        negated(entry, ("surface_rate",))
    negated(model["reference"].get("steady", {}), ("rate",))
    for key in ("coordinates", "rates", "guess"):
        for state in model["reference"].get(key, {}).values():
            negated(state, ("phi", "psi"))
    return model


BASE = re.compile("[a-z]+", re.IGNORECASE)
SMALL = {
    "kg": ("g", 1e3),
    "m": ("mm", 1e3),
    "mm": ("m", 1e-3),
    "s": ("ms", 1e3),
    "N": ("(g*mm/ms^2)", 1.0),
    "rad": ("deg", 180.0 / math.pi),
    "deg": ("rad", math.pi / 180.0),
    "rpm": ("(deg/s)", 6.0),
    "V": ("(g*mm^2/ms^3/A)", 1.0),
    "A": ("A", 1.0),
    "ohm": ("(V/A)", 1.0),
    "H": ("(V*ms/A)", 1e3),
}


def in_other_units(unit, factors):
    """Return how many of another unit one is, where factors give it for the words of which it consists."""
    return number(BASE.sub(lambda word: repr(factors[word[0]]), unit.replace("^", "**")))


def in_small_units(model):
    for parameter in model["parameters"].values():
        try:
            value = float(parameter["value"])
        except ValueError:  # an expression counts in SI
            continue
        factor = in_other_units(parameter["unit"], {word: factor for word, (_, factor) in SMALL.items()})
        unit = BASE.sub(lambda word: SMALL[word[0]][0], parameter["unit"])
        parameter |= {"value": value * factor, "unit": unit}
    return model
