"""Texts of random mechanisms in equilibrium or steady motion, from a seed: planar and spatial ones of many kinds.

Loops, redundant rows, masses down to 1e-12 kg, forces in joints that nearly cancel, stiff springs beside soft ones,
damped and not, at rest and in motion. Places of joints are written as expressions of decimals, so that a text means
the same mechanism in double precision and with any number of digits.
"""

import json
import re

import numpy as np
import yaml
from chains import hanging_chain, spring_chain

from mbstab.model.library import installed_models

KINDS = (
    "planar", "planar", "planar", "spatial", "spatial", "row", "chain", "screws", "found", "turning", "model", "adrift",
)  # fmt: skip

MOVING = (
    "governor", "governor_paper", "rattleback", "rolling_disk", "rolling_torus", "rotating_pendulum", "shimmy", "top",
    "trailer", "wheelset", "wheelset_no_slip", "whipple_bicycle", "flyball_governor", "bead_on_hoop", "ziegler_column",
    "chaplygin_sleigh", "andrews_squeezer", "free_rigid_body", "slider_crank", "double_pendulum", "von_mises_truss",
)  # fmt: skip


def random_mechanism(seed):
    """Return the text of a mechanism; a few seeds describe none, and are refused."""
    rng = np.random.default_rng([seed, 11])
    kind = KINDS[seed % len(KINDS)]
    return globals()[f"_{kind}"](rng)


def _spread(rng, low, high):
    """Return a number with three digits, its logarithm uniform."""
    return float(f"{10.0 ** rng.uniform(low, high):.2e}")


def _near(rng, *shape, size=1.0):
    return np.round(rng.uniform(-size, size, shape), 3).tolist()


def _number(x):
    return f"({x!r})" if x < 0 else repr(x)


def _masses(rng, count):
    style = rng.integers(4)
    low = (0, -2, -6, -12)[style]
    masses = [_spread(rng, low, 1.0) for _ in range(count)]
    if style == 3 and count > 1:
        masses[rng.integers(count)] = _spread(rng, 0, 2)
    return masses


def _stiffness(rng):
    return _spread(rng, *((0, 2), (0, 2), (-4, 4), (-3, 9))[rng.integers(4)])


def _damping(rng, stiffness, damped):
    return _spread(rng, -3, 0) * stiffness**0.5 if damped else 0


# --- bodies that are joined at points -------------------------------------------------------------------------------


class _Plane:
    """Bodies in the plane, at places and angles with three decimals."""

    dimension, vectors = 2, 2

    def __init__(self, rng, count):
        self.places = [(*_near(rng, 2), *_near(rng, 1, size=3.0)) for _ in range(count)]

    def parameters(self):
        return {f"{f}_{i}": f"{f}({p[2]!r})" for i, p in enumerate(self.places) for f in ("cos", "sin")}

    def inside(self, i, point):
        """Return a point of the ground in a body, as expressions."""
        dx, dy = (f"({_number(x)} - {_number(p)})" for x, p in zip(point, self.places[i][:2], strict=True))
        return [f"cos_{i}*{dx} + sin_{i}*{dy}", f"cos_{i}*{dy} - sin_{i}*{dx}"]

    def body(self, rng, mass):
        return {"type": "planar", "mass": mass, "inertia": float(f"{mass * rng.uniform(0.05, 0.5):.3e}")}

    def place(self, i):
        return dict(zip(("x", "y", "theta"), self.places[i], strict=True))

    def joint(self, rng):
        return "revolute"

    def axes(self, rng, i, j):
        return {}


class _Space(_Plane):
    """Bodies in space, with three Euler angles."""

    dimension, vectors = 3, 3

    def __init__(self, rng, count):
        self.places = [(*_near(rng, 3), *_near(rng, 3)) for _ in range(count)]

    def parameters(self):
        found = {}
        for i, place in enumerate(self.places):
            c, s = ([f"{f}({x!r})" for x in place[3:]] for f in ("cos", "sin"))
            rows = [
                [f"{c[1]}*{c[2]}", f"-{c[1]}*{s[2]}", s[1]],
                [f"{c[0]}*{s[2]} + {s[0]}*{s[1]}*{c[2]}", f"{c[0]}*{c[2]} - {s[0]}*{s[1]}*{s[2]}", f"-{s[0]}*{c[1]}"],
                [f"{s[0]}*{s[2]} - {c[0]}*{s[1]}*{c[2]}", f"{s[0]}*{c[2]} + {c[0]}*{s[1]}*{s[2]}", f"{c[0]}*{c[1]}"],
            ]
            found |= {f"A_{i}_{j}{k}": rows[j][k] for j in range(3) for k in range(3)}
        return found

    def seen(self, i, vector):
        """Return a direction of the ground in a body, as expressions."""
        return [" + ".join(f"A_{i}_{j}{k}*{x}" for j, x in enumerate(vector)) for k in range(3)]

    def inside(self, i, point):
        return self.seen(i, [f"({_number(x)} - {_number(p)})" for x, p in zip(point, self.places[i], strict=False)])

    def body(self, rng, mass):
        moments = [float(f"{mass * x:.3e}") for x in rng.uniform(0.2, 0.3, 3)]
        return {"type": "spatial", "mass": mass, "inertia": moments}

    def place(self, i):
        return dict(zip(("x", "y", "z", "phi", "theta", "psi"), self.places[i], strict=True))

    def joint(self, rng):
        return ("revolute", "revolute", "spherical", "cylindrical", "universal")[rng.integers(5)]

    def axes(self, rng, i, j):
        """Return axis and zero of a joint in body i and in body j, or in the ground if that is None."""
        found = {}
        for name in ("axis", "zero"):
            v = [_number(x) for x in _near(rng, 3)]
            found[name] = [self.seen(i, v), v if j is None else self.seen(j, v)]
        return found


def _planar(rng):
    return _joined(rng, _Plane)


def _spatial(rng):
    return _joined(rng, _Space)


def _adrift(rng):
    return _joined(rng, (_Plane, _Space)[rng.integers(2)], free=True)


def _joined(rng, kind, free=False):
    """Return bodies at random places, joined to each other and to the ground, or to each other only."""
    count = int(rng.integers(1 + free, 5 if kind is _Plane else 4))
    world = kind(rng, count)
    masses, damped = _masses(rng, count), bool(rng.integers(2))
    bodies = {f"b{i}": world.body(rng, masses[i]) | {"points": {}} for i in range(count)}
    joints, forces = {}, {}
    marks = iter(range(1000))

    def at(i, point):
        """Return a marker of body i (None: the ground) at a point of the ground."""
        if i is None:
            return {"body": "ground", "point": point}
        name = f"P{next(marks)}"
        bodies[f"b{i}"]["points"][name] = world.inside(i, point)
        return f"b{i}.{name}"

    def pinned(i, j, point, sort, axes=None):
        joint = {"type": sort, "between": [at(i, point), at(j, point)]}
        if kind is _Space and sort not in ("spherical",):
            joint |= world.axes(rng, i, j) if axes is None else axes
            if sort == "universal":
                # Both axes must be perpendicular: the frame of the first body decides.
                joint |= {"axis": [joint["axis"][0], joint["zero"][1]], "zero": [joint["zero"][0], joint["axis"][1]]}
                joint["type"] = "spherical"
                del joint["axis"], joint["zero"]
        joints[f"j{len(joints)}"] = joint
        return joint

    light = masses.index(min(masses))
    for i in range(int(free), count):
        j = None if i == 0 or rng.random() < 0.3 else int(rng.integers(i))
        if free and j is None:
            continue
        sort, point = world.joint(rng), _near(rng, kind.vectors)
        joint = pinned(i, j, point, sort)
        redundant = rng.random()
        if redundant < 0.25 and kind is _Space and joint["type"] == "revolute":
            # A second bearing on the same axis.
            far = rng.uniform(0.2, 1.0)
            axis = [float(x.strip("()")) for x in joint["axis"][1]] if j is None else None
            if axis is not None:
                second = [round(p + round(far, 2) * a, 6) for p, a in zip(point, axis, strict=True)]
                pinned(i, j, second, "revolute", {"axis": joint["axis"], "zero": joint["zero"]})
        elif redundant < 0.12 and count > 1:
            # A second pin makes one body of two, with a row that repeats others.
            pinned(i, j, _near(rng, kind.vectors), "revolute" if kind is _Plane else "spherical")
        if joint["type"] != "cylindrical" and (rng.random() < 0.4 or i == light):
            # Forces on both bodies at the pin, carried by the pin.
            push = [_spread(rng, -2, 6) * float(rng.choice([-1, 1])) for _ in range(kind.vectors)]
            forces[f"push_{i}"] = {"type": "force", "at": at(i, point), "vector": push, "frame": "ground"}
            if j is not None:
                back = [-x for x in push]
                forces[f"back_{i}"] = {"type": "force", "at": at(j, point), "vector": back, "frame": "ground"}
    if count > 2 and rng.random() < 0.4:
        joints["rod"] = _rod(rng, kind, count, at)
    forces |= _springs(rng, kind, count, free, damped, at)
    model = {"mbstab": 1, "gravity": [0] * kind.vectors, "parameters": world.parameters(), "bodies": bodies}
    model |= {"joints": joints, "forces": forces}
    model["reference"] = {"coordinates": {f"b{i}": world.place(i) for i in range(count)}}
    return json.dumps(model, indent=1)


def _apart(a, b):
    """Return the distance of two points, as an expression."""
    return "sqrt(" + " + ".join(f"({_number(x)} - {_number(y)})**2" for x, y in zip(a, b, strict=True)) + ")"


def _rod(rng, kind, count, at):
    """Return a rod between two of the bodies; `at` makes markers."""
    i, j = (int(x) for x in rng.choice(count, 2, replace=False))
    a, b = _near(rng, kind.vectors), _near(rng, kind.vectors)
    return {"type": "distance", "between": [at(i, a), at(j, b)], "length": _apart(a, b)}


def _springs(rng, kind, count, free, damped, at):
    """Return relaxed springs on the bodies, and some that pull against each other; `at` makes markers."""
    forces = {}
    for i in range(int(free), count):
        for number in range(int(rng.integers(1, 3))):
            # To the ground where no symmetry is to be left.
            a, b = _near(rng, kind.vectors), _near(rng, kind.vectors)
            k = _stiffness(rng)
            other = int(rng.integers(i)) if free else None
            spring = {"type": "spring", "between": [at(i, a), at(other, b)], "stiffness": k, "length": _apart(a, b)}
            forces[f"spring_{i}_{number}"] = spring | {"damping": _damping(rng, k, damped)}
    if not free and rng.random() < 0.3:
        # Two stretched springs that pull against each other.
        i, k = int(rng.integers(count)), _spread(rng, 0, 8)
        a, step = _near(rng, kind.vectors), _near(rng, kind.vectors)
        for number, sign in enumerate((1, -1)):
            b = [round(x + sign * y, 3) for x, y in zip(a, step, strict=True)]
            spring = {"type": "spring", "between": [at(i, a), at(None, b)], "stiffness": k, "length": 0.1}
            forces[f"pull_{number}"] = spring
    return forces


# --- masses in a row ------------------------------------------------------------------------------------------------


def _row(rng):
    """Return point masses on a line with springs and dampers of all sizes, and laws that couple them."""
    count = int(rng.integers(1, 6))
    masses = [_spread(rng, *((-12, 3), (-2, 2))[rng.integers(2)]) for _ in range(count)]
    damped = bool(rng.integers(2))
    laws = {f"m{i}.x": [] for i in range(count)}
    for i in range(count):
        for j in (*range(i), None):
            if j is None or rng.random() < 0.6:
                k = _stiffness(rng) * float(rng.choice([1, 1, 1, -1]))
                c = _damping(rng, abs(k), damped)
                away = f"m{i}.x" if j is None else f"m{i}.x - m{j}.x"
                speed = f"rate(m{i}.x)" if j is None else f"rate(m{i}.x) - rate(m{j}.x)"
                laws[f"m{i}.x"].append(f"-({k!r})*({away}) - {c!r}*({speed})")
                if j is not None and rng.random() < 0.8:
                    laws[f"m{j}.x"].append(f"({k!r})*({away}) + {c!r}*({speed})")
    model = {
        "mbstab": 1,
        "bodies": {f"m{i}": {"type": "planar_point", "mass": m} for i, m in enumerate(masses)},
        "constraints": {f"line_{i}": {"holonomic": f"m{i}.y"} for i in range(count)},
        "forces": {"law": {"type": "expression", "on": {name: " + ".join(x) for name, x in laws.items()}}},
        "reference": {"coordinates": {f"m{i}": {"x": 0, "y": 0} for i in range(count)}},
    }
    return json.dumps(model, indent=1)


# --- chains ---------------------------------------------------------------------------------------------------------


def _chain(rng):
    links = int(rng.integers(1, 6))
    masses = _masses(rng, links)
    return hanging_chain(rng, links, masses, *(float(x) for x in rng.choice([0.0, 0.1, 100.0], 2)))


def _screws(rng):
    return spring_chain(rng, int(rng.integers(1, 4)), float(rng.choice([0.0, 1.0, 100.0])))


def _found(rng):
    """Return bars that hang on pins and springs, in an equilibrium that the program looks for; some form loops."""
    count = int(rng.integers(1, 4))
    masses, damped = _masses(rng, count), bool(rng.integers(2))
    lengths = np.round(rng.uniform(0.5, 1.5, count), 2).tolist()
    bodies, joints, forces, guess = {}, {}, {}, {}
    x = 0.0
    for i, (m, length) in enumerate(zip(masses, lengths, strict=True)):
        ends = {"A": [-length / 2, 0], "B": [length / 2, 0]}
        inertia = float(f"{m * length**2 / 12:.4e}")
        bodies[f"b{i}"] = {"type": "planar", "mass": m, "inertia": inertia, "points": ends}
        other = f"b{i - 1}.B" if i else "ground"
        joints[f"j{i}"] = {"type": "revolute", "between": [f"b{i}.A", other]}
        guess[f"b{i}"] = {"x": x + length / 2, "y": -0.1 * i, "theta": round(float(rng.uniform(-0.5, 0.0)), 2)}
        x += length
        k = _stiffness(rng)
        place = [round(x * 0.8, 2), round(float(rng.uniform(0.3, 1.0)), 2)]
        spring = {"type": "spring", "between": [f"b{i}.B", {"body": "ground", "point": place}], "stiffness": k}
        forces[f"s{i}"] = spring | {"length": 0.3, "damping": _damping(rng, k, damped)}
    if count > 1 and rng.random() < 0.5:
        place = [round(0.7 * x, 2), round(float(rng.uniform(-0.5, 0.5)), 2)]
        length = round(float(rng.uniform(0.5, 1.0)), 2)
        ends = [f"b{count - 1}.B", {"body": "ground", "point": place}]
        joints["rod"] = {"type": "distance", "between": ends, "length": length}
    model = {"mbstab": 1, "gravity": [0, -9.81], "bodies": bodies, "joints": joints, "forces": forces}
    model["reference"] = {"find": "equilibrium", "guess": guess}
    return json.dumps(model, indent=1)


def _turning(rng):
    """Return masses and springs on a table that turns: a steady motion that the program looks for."""
    count = int(rng.integers(1, 4))
    rate, damped = _spread(rng, -1, 1), bool(rng.integers(2))
    bodies, forces, guess = {}, {}, {}
    for i, m in enumerate(_masses(rng, count)):
        bodies[f"m{i}"] = {"type": "planar_point", "mass": m}
        place = [round(float(rng.uniform(0.5, 1.5)), 2), round(float(rng.uniform(-1, 1)), 2)]
        guess[f"m{i}"] = {"x": place[0], "y": place[1]}
        k = m * rate**2 * _spread(rng, 0.5, 3)
        bar = {"type": "spring", "between": [f"m{i}", "ground"], "stiffness": float(f"{k:.3e}"), "length": 0.8}
        forces[f"s{i}"] = bar | {"damping": float(f"{_damping(rng, k * m, damped):.3e}") if damped else 0}
        for j in range(i):
            forces[f"s{i}_{j}"] = {"type": "spring", "between": [f"m{i}", f"m{j}"], "stiffness": _stiffness(rng),
                                   "length": 0.7}  # fmt: skip
    model = {"mbstab": 1, "bodies": bodies, "forces": forces}
    model["reference"] = {"find": "steady", "steady": {"axis": "z", "rate": rate}, "guess": guess}
    return json.dumps(model, indent=1)


# --- the example models with other numbers --------------------------------------------------------------------------


def _model(rng):
    texts = {path.stem: path.read_text(encoding="utf-8") for path in installed_models()}
    text = texts[MOVING[rng.integers(len(MOVING))]]
    plain = yaml.safe_load(text)
    for name, entry in plain.get("parameters", {}).items():
        value = entry["value"] if isinstance(entry, dict) else entry
        if isinstance(value, (int, float)) and rng.random() < 0.7:
            new = float(f"{value * rng.uniform(0.8, 1.25):.4g}")
            pattern = rf"(?m)^(  {re.escape(name)}: (?:{{value: )?){re.escape(str(value))}(?=[,\s}}])"
            text = re.sub(pattern, lambda found, x=new: f"{found.group(1)}{x!r}", text)
    return text
