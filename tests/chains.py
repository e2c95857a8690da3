"""Texts of mechanisms with random geometry, any number of bodies long, in an equilibrium that is known exactly.

Chains are generated here, in Python, and not by a ``repeat`` construct of the file format: a model file stays data
that reads from top to bottom, every number at its place, and a loop needs fifteen lines of Python.

Positions are written as expressions of the random numbers, so that the text means the same mechanism, in the same
equilibrium, in double precision and in any other.
"""

import json


def hanging_chain(rng, links, masses=None, damping=0.0, stiffness=0.0, size=1.0):
    """Return the text of a planar chain of rigid links, pivots and centres of mass anywhere in their links.

    A link hangs at rest when its own mass at its centre and all mass below at its lower pivot balance about its upper
    pivot; joint springs are relaxed there.
    """
    masses = masses if masses is not None else rng.uniform(0.5, 2.0, links).tolist()
    parameters, bodies, joints, forces, places = {"X_0": "0", "Y_0": "0"}, [], [], [], []
    for i in range(1, links + 1):
        (ax, ay), (bx, by), (gx, gy) = (rng.uniform(-size, size, 2).tolist() for _ in range(3))
        m, below = masses[i - 1], sum(masses[i:])
        lever = [
            f"({m!r}*({g!r}) + {below!r}*({b!r}))/{m + below!r} - ({a!r})" for g, b, a in ((gx, bx, ax), (gy, by, ay))
        ]
        parameters[f"th_{i}"] = f"-pi/2 - atan2({lever[1]}, {lever[0]})"
        parameters |= {f"c_{i}": f"cos(th_{i})", f"s_{i}": f"sin(th_{i})"}
        parameters |= _shifted(f"x_{i}", f"X_{i - 1}", f"y_{i}", f"Y_{i - 1}", i, -ax, -ay)
        parameters |= _shifted(f"X_{i}", f"x_{i}", f"Y_{i}", f"y_{i}", i, bx, by)
        inertia = m * size**2 * rng.uniform(0.05, 0.5)
        points = f"points: {{A: [{ax!r}, {ay!r}], B: [{bx!r}, {by!r}]}}"
        bodies.append(
            f"link_{i}: {{type: planar, mass: {m!r}, inertia: {inertia!r}, center_of_mass: [{gx!r}, {gy!r}], {points}}}"
        )
        joints.append(f"pin_{i}: {{type: revolute, between: [link_{i}.A, {f'link_{i - 1}.B' if i > 1 else 'ground'}]}}")
        rest = f"th_{i} - th_{i - 1}" if i > 1 else "th_1"
        if stiffness or damping:
            numbers = f"stiffness: {stiffness * rng.uniform(0.5, 1.5)!r}, damping: {damping * rng.uniform(0.5, 1.5)!r}"
            forces.append(f"spring_{i}: {{type: joint_spring, joint: pin_{i}, rest: {rest}, {numbers}}}")
        places.append(f"link_{i}: {{x: x_{i}, y: y_{i}, theta: th_{i}}}")
    return _text("[0, -9.81]", parameters, bodies, joints, forces, places)


def _shifted(x, from_x, y, from_y, i, px, py):
    return {x: f"{from_x} + c_{i}*({px!r}) - s_{i}*({py!r})", y: f"{from_y} + s_{i}*({px!r}) + c_{i}*({py!r})"}


def spinning_chain(count, damping=100):
    """Return the text of a shaft of spinning rigid cylinders on bushings, which bend as a beam does, in two bearings.

    The bearings are damped (N s/m) and softer along y than along x, and the cylinders turn at 100 rad/s.
    """
    return f"""mbstab: 1
counts: {{N: {count}}}
parameters:
  Omega: {{value: 100, unit: rad/s}}
  l: {{value: 1.5/<N>, unit: m}}
  d: {{value: 0.05, unit: m}}
  density: {{value: 7810, unit: kg/m^3}}
  modulus: {{value: 211, unit: GPa}}
  mass: {{value: density*pi*d**2/4*l, unit: kg}}
  across: {{value: mass*(3*d**2/4 + l**2)/12, unit: kg*m^2}}
  pull: {{value: modulus*pi*d**2/4/l, unit: N/m}}
  bend: {{value: modulus*pi*d**4/64/l, unit: N*m/rad}}
repeat:
  - for: {{i: [1, N]}}
    bodies:
      s<i>: {{type: spatial, mass: mass, inertia: [across, across, mass*d**2/8], points: {{L: [0, 0, -l/2],
        R: [0, 0, l/2]}}}}
    reference:
      coordinates: {{s<i>: {{x: 0, y: 0, z: <i>*l, phi: 0, theta: 0, psi: 0}}}}
      rates: {{s<i>: {{psi: Omega}}}}
  - for: {{i: [2, N]}}
    forces:
      shaft<i>: {{type: bushing, between: [s<i>.L, s<i-1>.R], stiffness: [12*bend/l**2, 12*bend/l**2, pull],
        torsional_stiffness: [bend, bend, 0.77*bend]}}
ground: {{points: {{A: [0, 0, l], B: [0, 0, <N>*l]}}}}
joints: {{thrust: {{type: point_on_plane, between: [ground.A, s1], axis: z}}}}
forces:
  bA: {{type: rotor_bearing, between: [s1, ground.A], kxx: 1e6, kyy: 0.8e6, cxx: {damping}, cyy: {damping}}}
  bB: {{type: rotor_bearing, between: ["s<N>", ground.B], kxx: 1e6, kyy: 0.8e6, cxx: {damping}, cyy: {damping}}}
"""


def four_bar_loops(loops, angle, solved=False):
    """Return the text of N four-bar loops side by side: N + 1 cranks at an angle and N couplers, rods of 1 m and 1 kg.

    With ``solved`` all coordinates but the angle of the first crank are left to the program, with a guess near them.
    """
    rod = {"type": "planar", "mass": 1, "shape": {"type": "rod", "length": 1}}
    ends = {"points": {"A": [-0.5, 0], "B": [0.5, 0]}}
    bodies, joints, places = {}, {}, {}
    for i in range(loops + 1):
        bodies[f"crank_{i}"] = rod | ends
        places[f"crank_{i}"] = {"x": f"{i} + cos(angle)/2", "y": "sin(angle)/2", "theta": "angle"}
        joints[f"pivot_{i}"] = {"type": "revolute", "between": [f"crank_{i}.A", {"body": "ground", "point": [i, 0]}]}
    for i in range(1, loops + 1):
        bodies[f"coupler_{i}"] = rod | ends
        places[f"coupler_{i}"] = {"x": f"{i} - 1/2 + cos(angle)", "y": "sin(angle)", "theta": 0}
        joints[f"left_{i}"] = {"type": "revolute", "between": [f"coupler_{i}.A", f"crank_{i - 1}.B"]}
        joints[f"right_{i}"] = {"type": "revolute", "between": [f"coupler_{i}.B", f"crank_{i}.B"]}
    reference = {"coordinates": places}
    if solved:
        del places["crank_0"]["theta"]
        guess = {body: {name: f"{x} + 0.1" for name, x in place.items()} for body, place in places.items()}
        reference = {"coordinates": {"crank_0": {"theta": "angle"}}, "guess": guess}
    model = {
        "mbstab": 1,
        "gravity": [0, -9.81],
        "parameters": {"angle": angle},
        "bodies": bodies,
        "joints": joints,
        "reference": reference,
    }
    # Every JSON text is a YAML text.
    return json.dumps(model, indent=1)


def spring_chain(rng, links, damping=0.0):
    """Return the text of a spatial chain: hinges with any axes and screws of springs, relaxed, without gravity."""
    parameters, bodies, joints, forces, places = {f"P_0{k}": "0" for k in "xyz"}, [], [], [], []
    parameters |= {f"A_0{i}{j}": str(int(i == j)) for i in range(3) for j in range(3)}
    for i in range(1, links + 1):
        a, b, g = (rng.uniform(-1.0, 1.0, 3).tolist() for _ in range(3))
        phi, theta, psi = angles = rng.uniform(-1.0, 1.0, 3).tolist()
        parameters |= _rotation(i, *angles)
        parameters |= {f"p_{i}{k}": f"P_{i - 1}{k} - ({_turned(i, row, a)})" for row, k in enumerate("xyz")}
        parameters |= {f"P_{i}{k}": f"p_{i}{k} + {_turned(i, row, b)}" for row, k in enumerate("xyz")}
        # The same directions, axis and zero of the hinge, in the ground and in the frames of both bodies.
        for name in ("axis", "zero"):
            v = rng.normal(size=3).tolist()
            parameters |= {f"{name}_{i}{k}": repr(v[row]) for row, k in enumerate("xyz")}
        sides = [
            f"[[{_seen(i, 'axis', i)}], [{_seen(i - 1, 'axis', i)}]]",
            f"[[{_seen(i, 'zero', i)}], [{_seen(i - 1, 'zero', i)}]]",
        ]
        xx, yy, zz = rng.uniform(0.2, 0.3, 3).tolist()
        xy, xz, yz = rng.uniform(-0.05, 0.05, 3).tolist()
        tensor = f"{{xx: {xx!r}, yy: {yy!r}, zz: {zz!r}, xy: {xy!r}, xz: {xz!r}, yz: {yz!r}}}"
        bodies.append(
            f"link_{i}: {{type: spatial, mass: {rng.uniform(0.5, 2.0)!r}, inertia: {tensor}, center_of_mass: {g!r}, "
            f"points: {{A: {a!r}, B: {b!r}}}}}"
        )
        other = f"link_{i - 1}.B" if i > 1 else "ground"
        kind = "cylindrical" if i % 3 == 0 else "revolute"
        joints.append(f"pin_{i}: {{type: {kind}, between: [link_{i}.A, {other}], axis: {sides[0]}, zero: {sides[1]}}}")
        for motion in ("angle", "displacement")[: 1 + (kind == "cylindrical")]:
            numbers = f"stiffness: {rng.uniform(5.0, 50.0)!r}, damping: {damping * rng.uniform(0.5, 1.5)!r}"
            forces.append(f"{motion}_{i}: {{type: joint_spring, joint: pin_{i}, motion: {motion}, {numbers}}}")
        places.append(f"link_{i}: {{x: p_{i}x, y: p_{i}y, z: p_{i}z, phi: {phi!r}, theta: {theta!r}, psi: {psi!r}}}")
    return _text("0", parameters, bodies, joints, forces, places)


def _rotation(i, phi, theta, psi):
    """Return the entries A_i00 … A_i22 of Ax(φ) Ay(θ) Az(ψ) as expressions."""
    c1, c2, c3 = (f"cos({x!r})" for x in (phi, theta, psi))
    s1, s2, s3 = (f"sin({x!r})" for x in (phi, theta, psi))
    rows = [
        [f"{c2}*{c3}", f"-{c2}*{s3}", s2],
        [f"{c1}*{s3} + {s1}*{s2}*{c3}", f"{c1}*{c3} - {s1}*{s2}*{s3}", f"-{s1}*{c2}"],
        [f"{s1}*{s3} - {c1}*{s2}*{c3}", f"{s1}*{c3} + {c1}*{s2}*{s3}", f"{c1}*{c2}"],
    ]
    return {f"A_{i}{j}{k}": rows[j][k] for j in range(3) for k in range(3)}


def _turned(i, row, vector):
    """Return one component, in the ground, of a vector of body i."""
    return " + ".join(f"A_{i}{row}{k}*({x!r})" for k, x in enumerate(vector))


def _seen(i, name, joint):
    """Return the components in body i of a direction given in the ground."""
    return ", ".join(" + ".join(f"A_{i}{k}{row}*{name}_{joint}{'xyz'[k]}" for k in range(3)) for row in range(3))


def _text(gravity, parameters, bodies, joints, forces, places):
    lines = ["mbstab: 1", f"gravity: {gravity}", "parameters:", *(f"  {k}: {v}" for k, v in parameters.items())]
    for section, entries in (("bodies", bodies), ("joints", joints), ("forces", forces)):
        lines += [f"{section}:", *(f"  {entry}" for entry in entries)] if entries else []
    return "\n".join([*lines, "reference:", "  coordinates:", *(f"    {place}" for place in places), ""])


def straight_chain(links, joint="revolute", damping=0.0):
    """Return the text of equal rods of 1 m and 1 kg, of thickness 0.1 m in space, that hang straight down.

    Joints are ``revolute`` in the plane, ``universal`` or ``spherical`` in space.
    """
    plane = joint == "revolute"
    if plane:
        rod = {"type": "planar", "shape": {"type": "rod", "length": 1}, "points": {"A": [-0.5, 0], "B": [0.5, 0]}}
    else:
        moments = {"xx": 1 / 12, "yy": 1 / 12, "zz": 0.00125}
        rod = {"type": "spatial", "inertia": moments, "points": {"A": [0, 0, 0.5], "B": [0, 0, -0.5]}}
    axes = {"axis": [[1, 0, 0], [0, 1, 0]]} if joint == "universal" else {}
    bodies, joints, forces, places = {}, {}, {}, {}
    for i in range(links):
        between = [f"rod_{i}.A", f"rod_{i - 1}.B" if i else "ground"]
        bodies[f"rod_{i}"], joints[f"pin_{i}"] = {"mass": 1} | rod, {"type": joint, "between": between} | axes
        along = {"y" if plane else "z": -i - 0.5}
        places[f"rod_{i}"] = (
            {"x": 0, "theta": "-pi/2"} if plane else {"x": 0, "y": 0, "phi": 0, "theta": 0, "psi": 0}
        ) | along
        if damping:
            rest = "-pi/2" if i == 0 else 0
            forces[f"damper_{i}"] = {"type": "joint_spring", "joint": f"pin_{i}", "stiffness": 0, "damping": damping}
            forces[f"damper_{i}"] |= {"rest": rest}
    return _as_text([0, -9.81] if plane else [0, 0, -9.81], bodies, joints, forces, places)


def string_of_points(points):
    """Return the text of equal point masses on massless links of 1 m that hang straight down in the plane.

    The squares of the frequencies are g/(1 m) times the zeros of the Laguerre polynomial of that degree.
    """
    link = {"type": "planar", "mass": 1, "inertia": 0, "center_of_mass": [1, 0], "points": {"A": [0, 0], "B": [1, 0]}}
    bodies = {f"link_{i}": link for i in range(points)}
    joints = {
        f"pin_{i}": {"type": "revolute", "between": [f"link_{i}.A", f"link_{i - 1}.B" if i else "ground"]}
        for i in range(points)
    }
    places = {f"link_{i}": {"x": 0, "y": -i, "theta": "-pi/2"} for i in range(points)}
    return _as_text([0, -9.81], bodies, joints, {}, places)


def free_bodies(number):
    """Return points that nothing holds, as text."""
    return "mbstab: 1\nbodies:\n" + "".join(f"  p{i}: {{type: point, mass: 1}}\n" for i in range(number))


def _as_text(gravity, bodies, joints, forces, places):
    model = {"mbstab": 1, "gravity": gravity, "bodies": bodies, "joints": joints}
    model |= {"forces": forces} if forces else {}
    return json.dumps(model | {"reference": {"coordinates": places}}, indent=1)
