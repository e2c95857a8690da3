"""What tests know of each element, written independently of the program: a new one gets a line in these tables.

* `HOLONOMIC`, `NONHOLONOMIC`: the row that a constraint states, by the name of its element.
* `POWER`: the power of a force in a virtual motion, by the name of its element.
* `DIVISORS`: what a kernel divides by, by its name; one that divides by nothing is not listed.
* `ENERGY`: whether a part of a file takes energy from the motion, by its type.

Formulas come from kinematics that are written here: rotation matrices, and places of displaced bodies.
"""

import mpmath
import numpy as np

STEP = mpmath.mpf("1e-15")


def turn(axis, angle):
    """Return the matrix of a rotation about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    A = np.array([[mpmath.mpf(int(r == c)) for c in range(3)] for r in range(3)])
    A[i, i] = A[j, j] = mpmath.cos(angle)
    A[i, j], A[j, i] = -mpmath.sin(angle), mpmath.sin(angle)
    return A


class Body:
    """Places of a body at displaced states; velocities are differences of places."""

    def __init__(self, frame, q, base):
        self.size = {"planar": 2, "spatial": 3}[frame]
        self.q, self.base = np.array(q), base

    def matrix(self, shift=0):
        q = self.q + shift
        if self.size == 2:
            return turn(2, q[2])[:2, :2]
        return self.base @ turn(0, q[3]) @ turn(1, q[4]) @ turn(2, q[5])

    def place(self, point, shift=0):
        return (self.q + shift)[: self.size] + self.matrix(shift) @ point

    def velocity(self, point, u):
        return (self.place(point, STEP * u) - self.place(point, -STEP * u)) / (2 * STEP)

    def acceleration(self, point, u):
        """Return the acceleration at constant u."""
        h = mpmath.mpf("1e-12")
        return (self.place(point, h * u) - 2 * self.place(point) + self.place(point, -h * u)) / h**2

    def spin(self, u):
        """Return the angular velocity in ground components."""
        rate = (self.matrix(STEP * u) - self.matrix(-STEP * u)) / (2 * STEP) @ self.matrix().T
        if self.size == 2:
            return np.array([rate[1, 0]])
        return np.array([rate[2, 1], rate[0, 2], rate[1, 0]])


def unit(v):
    return v / mpmath.sqrt(v @ v)


def gap(bodies, p):
    return bodies[0].place(p["first"]) - bodies[1].place(p["second"])


def travel(bodies, p):
    return (bodies[1].matrix() @ p["second_v1"]) @ gap(bodies, p)


def crank(bodies, p):
    """Return length and angle of the first body's zero direction, seen in two directions of the second."""
    zero = bodies[0].matrix() @ p["first_v2"]
    c, s = (zero @ (bodies[1].matrix() @ p[key]) for key in ("second_v2", "second_v3"))
    return mpmath.hypot(c, s), mpmath.atan2(s, c)


def angle(bodies, p):
    return bodies[0].q[2] - bodies[1].q[2] if bodies[0].size == 2 else crank(bodies, p)[1]


def screw(bodies, p, s):
    length, angle = crank(bodies, p)
    (lead,) = p["lead"]
    return [lead / (2 * mpmath.pi) * length * mpmath.sin(angle - 2 * mpmath.pi * travel(bodies, p) / lead)]


def triads(bodies, p):
    """Return the triads of both bodies, first made orthonormal (v2 along its part across v1), as columns."""
    found = []
    for body, side in zip(bodies, ("first", "second"), strict=True):
        v1, v2 = (p[f"{side}_v{i}"] for i in (1, 2))
        v1 = unit(v1)
        v2 = unit(v2 - (v2 @ v1) * v1)
        p |= {f"{side}_v{i}": v for i, v in enumerate((v1, v2, np.cross(v1, v2)), 1)}
        found.append(body.matrix() @ np.array([v1, v2, np.cross(v1, v2)]).T)
    return found


def sum_of(motions):
    """Return the factors times the motions of joints, each between two bodies, less the phase."""

    def total(bodies, p):
        found = -p["phase"][0]
        for k, motion in enumerate(motions):
            own = {key.rpartition("_")[0]: value for key, value in p.items() if key[-1] == str(k)}
            found += p["factors"][k] * motion(bodies[2 * k : 2 * k + 2], own)
        return found

    return total


def train(motions):
    """Return the row of a drive train: in space less the whole turns."""

    def row(bodies, p, s=()):
        total = sum_of(motions)(bodies, p)
        if bodies[0].size == 3:
            total -= 2 * mpmath.pi * mpmath.nint(total / (2 * mpmath.pi))
        return [total / p["scale"][0]]

    return row


def equal_turns(bodies, p, s):
    # If they turn equally, the shortest turn that brings the first shaft onto the second takes v2 to w2.
    A, B = triads(bodies, p)
    v1, w1 = A[:, 0], B[:, 0]
    axis = unit(np.cross(v1, w1))
    bend = mpmath.atan2(axis @ np.cross(v1, w1), v1 @ w1)
    across = np.cross(axis, A[:, 1])
    bent = axis * (axis @ A[:, 1]) * (1 - mpmath.cos(bend)) + mpmath.cos(bend) * A[:, 1] + mpmath.sin(bend) * across
    twist = mpmath.atan2(w1 @ np.cross(bent, B[:, 1]), bent @ B[:, 1])
    return [2 * mpmath.tan(twist / 2)]


def distance(bodies, p, s):
    (length,) = p["length"]
    return [(sum(gap(bodies, p) ** 2) - length**2) / (2 * length)]


def angle_position(bodies, p, s):
    if bodies[0].size == 2:
        return [bodies[0].q[2] - bodies[1].q[2] - s[0]]
    length, angle = crank(bodies, p)
    return [length * mpmath.sin(angle - s[0])]


def lowest(body, p):
    """Return the lowest point of a wheel, as the lowest of a circle of points around the axle, less the tube."""
    axle, normal = body.matrix() @ p["axle"], p["normal"]
    e = unit(np.cross(axle, [1, 0, 0]))
    f = np.cross(axle, e)
    height = mpmath.hypot(normal @ e, normal @ f)
    down = -(normal @ e * e + normal @ f * f) / height
    return body.place(p["center"]) + p["radius"][0] * down - p["tube"][0] * normal


def wheel_height(bodies, p, s):
    return [p["normal"] @ lowest(bodies[0], p) - p["level"][0]]


def support(body, p):
    """Return the lowest point of an ellipsoid in the body frame: where a sphere touches that space has stretched."""
    stretch = np.diag(p["semi_axes"])
    return p["center"] - stretch @ unit(stretch @ body.matrix().T @ p["normal"])


def displaced(bodies, u, sign):
    frame = {2: "planar", 3: "spatial"}[bodies[0].size]
    return [Body(frame, body.q + sign * STEP * v, body.base) for body, v in zip(bodies, u, strict=True)]


def rate_of(function, bodies, u):
    return (function(displaced(bodies, u, 1)) - function(displaced(bodies, u, -1))) / (2 * STEP)


GEAR, RACK = (angle, angle), (travel, angle)


def disk_slip(bodies, p, s, u):
    contact = p["center"] - p["radius"][0] * (bodies[0].matrix().T @ p["normal"])
    along = np.array([p["normal"][1], -p["normal"][0]])
    return [along @ (bodies[0].velocity(contact, u[0]) - carried(p, s, None))]


def roller_slip(bodies, p, s, u):
    away = unit(gap(bodies, p))
    own = [
        p["first"] - p["radii"][0] * bodies[0].matrix().T @ away,
        p["second"] + p["radii"][1] * bodies[1].matrix().T @ away,
    ]
    first, second = (body.velocity(point, v) for body, point, v in zip(bodies, own, u, strict=True))
    return [np.array([-away[1], away[0]]) @ (first - second)]


def carried(p, s, place):
    """Return the velocity of a plane that moves along itself, at a place; of one at rest 0."""
    turn = s[3] * np.cross(p["normal"], place - p["origin"]) if len(s) == 4 else 0
    return s[: len(p["normal"])] + turn if len(s) else 0


def wheel_slip(across):
    def row(bodies, p, s, u):
        (body,) = bodies
        contact = body.matrix().T @ (lowest(body, p) - body.q[:3])
        direction = unit(np.cross(body.matrix() @ p["axle"], p["normal"]))
        direction = np.cross(p["normal"], direction) if across else direction
        return [direction @ (body.velocity(contact, u[0]) - carried(p, s, lowest(body, p)))]

    return row


def ellipsoid_slip(bodies, p, s, u):
    (body,), point = bodies, support(bodies[0], p)
    return [p["along"] @ (body.velocity(point, u[0]) - carried(p, s, body.place(point)))]


def knife_edge(bodies, p, s, u):
    (body,) = bodies
    across = body.matrix() @ p["across"] if body.size == 2 else np.cross(p["normal"], body.matrix() @ p["along"])
    return [across @ body.velocity(p["point"], u[0])]


def angle_velocity(bodies, p, s, u):
    axis = bodies[1].matrix() @ p["second_v1"] if bodies[0].size == 3 else np.array([1])
    return [axis @ (bodies[0].spin(u[0]) - bodies[1].spin(u[1])) - s[0]]


def rolling(body, p, u):
    """Return speeds of a wheel along and across its plane, its turn rate about the normal, and its lean."""
    if body.size == 2:
        heading, velocity = body.matrix() @ p["along"], body.velocity(p["point"], u)
        return heading @ velocity, np.array([-heading[1], heading[0]]) @ velocity, u[2], 0
    axle, n = body.matrix() @ p["axle"], p["normal"]
    heading = unit(np.cross(axle, n))
    contact = body.velocity(body.matrix().T @ (lowest(body, p) - body.q[:3]), u)
    lean = mpmath.pi / 2 - mpmath.acos(axle @ n)
    return heading @ body.velocity(p["center"], u), np.cross(n, heading) @ contact, n @ body.spin(u), lean


def slip_angle(body, p, u):
    along, across, _, _ = rolling(body, p, u)
    return mpmath.atan(across / abs(along))


def slip_of_lean(body, p, u):
    return p["camber"][0] * rolling(body, p, u)[3] / p["cornering"][0] if body.size == 3 else 0


def tyre_relaxation(bodies, p, s, u):
    along, across, _, _ = rolling(bodies[0], p, u[0])
    lag = p["relaxation"][0] / mpmath.hypot(along, across)
    return [u[1] - (slip_angle(bodies[0], p, u[0]) + slip_of_lean(bodies[0], p, u[0]) - bodies[1]) / lag]


def length(bodies, p):
    return mpmath.sqrt(sum(gap(bodies, p) ** 2))


def spring(extension):
    """Return the power of a spring and damper in a virtual motion w."""

    def power(bodies, p, s, u, w):
        speed, virtual = (rate_of(lambda at: extension(at, p), bodies, v) for v in (u, w))
        (stiffness,), (rest,), (damping,) = p["stiffness"], p["rest"], p["damping"]
        return -(stiffness * (extension(bodies, p) - rest) + damping * speed) * virtual

    return power


def elastic_train(motions):
    def power(bodies, p, s, u, w):
        speed, virtual = (rate_of(lambda at: sum_of(motions)(at, p), bodies, v) / p["scale"][0] for v in (u, w))
        return -(p["stiffness"][0] * train(motions)(bodies, p)[0] + p["damping"][0] * speed) * virtual

    return power


def effort(motion):
    return lambda b, p, s, u, w: s[0] * rate_of(lambda at: motion(at, p), b, w)


def ideal_spring(b, p, s, u, w):
    ends = gap(b, p)
    return -p["stiffness"][0] * sum(x * rate_of(lambda at, i=i: gap(at, p)[i], b, w) for i, x in enumerate(ends))


def bearing(b, p, s, u, w):
    """Return the power in a virtual motion, with the gap in the axes of the second body."""

    def local(bodies):
        return bodies[1].matrix().T @ gap(bodies, p)

    (stiffness,), (damping,) = p["stiffness"], p["damping"]
    speed, virtual = ([rate_of(lambda at, i=i: local(at)[i], b, v) for i in range(len(local(b)))] for v in (u, w))
    return -sum((stiffness * x + damping * v) * d for x, v, d in zip(local(b), speed, virtual, strict=True))


def mount(displacements):
    """Return the power of springs, dampers and preloads along displacements whose speeds are given besides."""

    def power(bodies, p, s, u, w):
        moved, rates, virtual, speeds = displacements(bodies, p, u, w)
        forces = zip(p["stiffness"], p["preload"], moved, virtual, strict=True)
        stored = sum((f - k * x) * d for k, f, x, d in forces)
        return stored - sum(c * v * d for c, v, d in zip(p["damping"], rates, speeds, strict=True))

    return power


def mount_axes(p, owner):
    return np.array([p[f"{owner}_v{i}"] for i in (1, 2, 3)])


def mounted(bodies, p, u, w):
    axes = np.eye(2, dtype=int) if bodies[0].size == 2 else mount_axes(p, "second")

    def local(at):
        return axes @ (at[1].matrix().T @ gap(at, p))

    rates, virtual = ([rate_of(lambda at, i=i: local(at)[i], bodies, v) for i in range(len(axes))] for v in (u, w))
    return local(bodies), rates, virtual, virtual


def coupled_mount(b, p, s, u, w):
    """Return the power of a force with matrices of stiffness and damping across an axis."""
    across = np.array([p["second_v2"], p["second_v3"]]) if b[0].size == 3 else np.eye(2, dtype=int)

    def local(at):
        return across @ (at[1].matrix().T @ gap(at, p))

    K, C = p["stiffness"].reshape(2, 2), p["damping"].reshape(2, 2)
    rates, virtual = (np.array([rate_of(lambda at, i=i: local(at)[i], b, v) for i in range(2)]) for v in (u, w))
    return -(K @ local(b) + C @ rates) @ virtual


def turned(bodies, p, u, w):
    spins, virtual = (bodies[0].spin(v[0]) - bodies[1].spin(v[1]) for v in (u, w))
    if bodies[0].size == 2:
        return [bodies[0].q[2] - bodies[1].q[2]], spins, virtual, virtual
    axes = mount_axes(p, "second") @ bodies[1].matrix().T

    def turns(at):
        R = mount_axes(p, "second") @ at[1].matrix().T @ at[0].matrix() @ mount_axes(p, "first").T
        return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / mpmath.sqrt(1 + np.trace(R))

    growing = [rate_of(lambda at, i=i: turns(at)[i], bodies, w) for i in range(3)]
    return turns(bodies), axes @ spins, growing, axes @ virtual


def tyre(b, p, s, u, w):
    """Return the power of a side force at the contact and its moment, which falls with the cosine of the slip angle."""
    slip = b[1] - slip_of_lean(b[0], p, u[0]) if len(b) > 1 else slip_angle(b[0], p, u[0])
    force = -magic_formula(slip, p["cornering"][0], p) if "peak" in p else -p["cornering"][0] * slip
    along, across, _, lean = rolling(b[0], p, u[0])
    arm = p["trail"][0] * mpmath.cos(mpmath.atan2(across, along))
    _, side, turn, _ = rolling(b[0], p, w[0])
    thrust = -p["camber"][0] * lean if b[0].size == 3 else 0
    return (force + thrust) * side - arm * force * turn


def aligning_moment(b, p, s, u, w):
    """Return the power of a moment about the normal that turns a wheel to where it goes, ahead or astern."""
    slip = b[1] - slip_of_lean(b[0], p, u[0]) if len(b) > 1 else slip_angle(b[0], p, u[0])
    slope, sense = p["aligning"][0], mpmath.sign(rolling(b[0], p, u[0])[0])
    return sense * (magic_formula(slip, slope, p) if "peak" in p else slope * slip) * rolling(b[0], p, w[0])[2]


def camber_moment(b, p, s, u, w):
    """Return the power of a moment that turns a wheel to the side to which it leans."""
    along, _, _, lean = rolling(b[0], p, u[0])
    return -mpmath.sign(along) * p["moment"][0] * lean * rolling(b[0], p, w[0])[2]


def magic_formula(slip, slope, p):
    """Return F = D sin(C atan(B φ)) with φ = (1 − E) α + (E/B) atan(B α), and B C D the slope where nothing slips."""
    D, C, E = (p[key][0] for key in ("peak", "shape_factor", "curvature_factor"))
    B = slope / C / D
    return D * mpmath.sin(C * mpmath.atan(B * ((1 - E) * slip + E / B * mpmath.atan(B * slip))))


def creep(b, p, s, u, w):
    """Return the power of creep and of the load, with the wheelset's coordinates along and across the rails.

    In space the lateral motion is that of the point of the wheelset a radius below its middle.
    """
    rails = p["rails"]
    f11, f22, f23, f33, half, conicity, radius, load = (
        p[x][0] for x in ("f11", "f22", "f23", "f33", "half_gauge", "conicity", "radius", "load")
    )
    up = p.get("normal", [0, 0, 1])
    left = np.array([-rails[1], rails[0]]) if b[0].size == 2 else np.cross(up, rails)
    contact = p["point"] - (b[0].matrix().T @ (radius * up) if b[0].size == 3 else 0 * p["point"])
    velocity, virtual = (left @ b[0].velocity(contact, x[0]) for x in (u, w))
    rate, turn = (b[0].spin(x[0]) @ up[-len(b[0].spin(x[0])) :] for x in (u, w))
    ahead = rails @ b[0].velocity(p["point"], u[0])
    speed = mpmath.hypot(ahead, velocity)
    off, yaw = left @ (b[0].place(p["point"]) - p["origin"]), left @ (b[0].matrix() @ p["along"])
    power = -load * conicity * (off / half * virtual - half * yaw * turn)
    for side in (1, -1):
        x = -side * (half * rate + conicity * off * ahead / radius) / speed
        y, spin = (velocity - yaw * ahead) / speed, rate / speed
        f23 = p["f23"][0] * ahead / speed
        power += -f11 * x * (-side * half * turn) - (f22 * y + f23 * spin) * virtual + (f23 * y - f33 * spin) * turn
    return power


# --- the tables -------------------------------------------------------------------------------------------------------


def numbered(p, names):
    """Return vectors by name from the numbers of a measure."""
    return dict(zip(names, np.split(p["numbers"], len(names)), strict=True))


def turns_of(b, numbers):
    """Return the angle of a joint in space from the directions of a measure and the angle from which it counts."""
    zero, v2, v3 = (body.matrix() @ x for body, x in zip((b[0], b[1], b[1]), np.split(numbers[:9], 3), strict=True))
    return numbers[9] + mpmath.atan2(zero @ v3, zero @ v2)


def own_component(vector, i):
    """Return a row: a component of a vector of a body in its own axes."""
    return lambda b, p, s, u: [(b[0].matrix().T @ vector(b[0], p, u[0]))[i]]


HOLONOMIC = {
    "coincident": lambda b, p, s: gap(b, p),
    "in_plane": lambda b, p, s: [(b[0].matrix() @ p["normal"]) @ gap(b, p)],
    "perpendicular": lambda b, p, s: [(b[0].matrix() @ p["first"]) @ (b[1].matrix() @ p["second"])],
    "aligned": lambda b, p, s: [b[0].q[2] - b[1].q[2] + p["angle"][0]],
    "distance": distance,
    "screw": screw,
    "equal_turns": equal_turns,
    "gear": train(GEAR),
    "rack": train(RACK),
    "differential": train((angle, angle, angle)),
    "roller_distance": lambda b, p, s: [mpmath.sqrt(sum(gap(b, p) ** 2)) - sum(p["radii"])],
    "disk_height": lambda b, p, s: [p["normal"] @ b[0].place(p["center"]) - p["level"][0]],
    "wheel_height": wheel_height,
    "ellipsoid_height": lambda b, p, s: [p["normal"] @ b[0].place(support(b[0], p)) - p["level"][0]],
    "angle_position": angle_position,
    "displacement_position": lambda b, p, s: [travel(b, p) - s[0]],
    "point_position": lambda b, p, s: [p["direction"] @ b[0].place(p["point"]) - s[0]],
    "measure_angle": lambda b, p, s: [angle(b, p) if b[0].size == 2 else turns_of(b, p["numbers"])],
    "measure_displacement": lambda b, p, s: [travel(b, numbered(p, ("first", "second", "second_v1")))],
    "measure_distance": lambda b, p, s: [sum(gap(b, numbered(p, ("first", "second"))) ** 2) / 2],
}
HOLONOMIC |= {f"measure_{x}": lambda b, p, s, i=i: [b[0].place(p["numbers"])[i]] for i, x in enumerate("xyz")}
"""Residuals of rows, of bodies b, parameters p and given functions of time s."""

NONHOLONOMIC = {
    "tyre_relaxation": tyre_relaxation,
    "disk_slip": disk_slip,
    "roller_slip": roller_slip,
    "wheel_slip_along": wheel_slip(across=False),
    "wheel_slip_across": wheel_slip(across=True),
    "ellipsoid_slip": ellipsoid_slip,
    "knife_edge": knife_edge,
    "angle_velocity": angle_velocity,
    "displacement_velocity": lambda b, p, s, u: [rate_of(lambda at: travel(at, p), b, u) - s[0]],
    "point_velocity": lambda b, p, s, u: [p["direction"] @ b[0].velocity(p["point"], u[0]) - s[0]],
    **{f"measure_v{x}": own_component(lambda b, p, u: b.velocity(p["numbers"], u), i) for i, x in enumerate("xyz")},
    **{f"measure_w{x}": own_component(lambda b, p, u: b.spin(u), i) for i, x in enumerate("xyz")},
}

NONHOLONOMIC |= {
    f"carried_{name}": row for name, row in NONHOLONOMIC.items() if name.endswith(("slip", "along", "across"))
}
"""Residuals of rows of speeds u."""

POWER = {
    "creep": creep,
    "camber_moment": camber_moment,
    "tyre": tyre,
    "relaxed_tyre": tyre,
    "aligning_moment": aligning_moment,
    "relaxed_aligning_moment": aligning_moment,
    "magic_aligning_moment": aligning_moment,
    "relaxed_magic_aligning_moment": aligning_moment,
    "magic_tyre": tyre,
    "relaxed_magic_tyre": tyre,
    "mount_force": mount(mounted),
    "mount_torque": mount(turned),
    "spring": spring(length),
    "bearing": bearing,
    "coupled_mount": coupled_mount,
    "ideal_spring": ideal_spring,
    "angle_spring": spring(angle),
    "gear_spring": elastic_train(GEAR),
    "rack_spring": elastic_train(RACK),
    "displacement_spring": spring(travel),
    "angle_effort": effort(angle),
    "displacement_effort": effort(travel),
    "ground_force": lambda b, p, s, u, w: s @ b[0].velocity(p["point"], w[0]),
    "body_force": lambda b, p, s, u, w: (b[0].matrix() @ s) @ b[0].velocity(p["point"], w[0]),
    "ground_torque": lambda b, p, s, u, w: s @ b[0].spin(w[0]),
    "body_torque": lambda b, p, s, u, w: (b[0].matrix() @ s) @ b[0].spin(w[0]),
}
"""Powers of forces at the speeds u in the virtual velocities w."""

DIVISORS = {
    "planar_gear": {"scale"},
    "planar_gear_spring": {"scale"},
    "planar_rack": {"scale"},
    "planar_rack_spring": {"scale"},
    "planar_differential": {"scale"},
    "spatial_gear": {"scale", "sum of squares"},
    "spatial_gear_spring": {"scale", "sum of squares"},
    "spatial_rack": {"scale", "sum of squares"},
    "spatial_rack_spring": {"scale", "sum of squares"},
    "spatial_differential": {"scale", "sum of squares"},
    "planar_creep": {"half_gauge", "radius", "sqrt"},
    "spatial_creep": {"half_gauge", "radius", "sqrt"},
    "planar_distance": {"length"},
    "planar_aligning_moment": {"sum of squares", "signum"},
    "planar_magic_aligning_moment": {"sum of squares", "signum", "1 + square", "peak", "shape_factor"},
    "planar_relaxed_aligning_moment": {"signum"},
    "planar_relaxed_magic_aligning_moment": {"signum", "1 + square", "peak", "shape_factor"},
    "spatial_aligning_moment": {"sqrt", "signum", "sum of squares"},
    "spatial_camber_moment": {"sqrt", "signum", "sum of squares"},
    "spatial_magic_aligning_moment": {"sqrt", "signum", "sum of squares", "1 + square", "peak", "shape_factor"},
    "spatial_relaxed_aligning_moment": {"sqrt", "signum", "sum of squares", "cornering"},
    "spatial_relaxed_magic_aligning_moment": {
        *("sqrt", "signum", "sum of squares", "1 + square", "cornering", "peak", "shape_factor")
    },
    "planar_magic_tyre": {"sqrt", "sum of squares", "1 + square", "peak", "shape_factor"},
    "planar_relaxed_magic_tyre": {"sqrt", "1 + square", "peak", "shape_factor"},
    "planar_relaxed_tyre": {"sqrt"},
    "planar_roller_distance": {"sqrt"},
    "planar_roller_slip": {"sqrt"},
    "planar_spring": {"sqrt"},
    "planar_tyre": {"sqrt", "sum of squares"},
    "planar_tyre_relaxation": {"sqrt", "sum of squares", "relaxation"},
    "spatial_distance": {"length"},
    "spatial_equal_turns": {"1 + sum of products"},
    "spatial_mount_torque": {"sqrt"},
    "spatial_magic_tyre": {"sqrt", "sum of squares", "1 + square", "peak", "shape_factor"},
    "spatial_relaxed_magic_tyre": {"sqrt", "sum of squares", "1 + square", "cornering", "peak", "shape_factor"},
    "spatial_relaxed_tyre": {"sqrt", "sum of squares", "cornering"},
    "spatial_screw": {"lead", "pi"},
    "spatial_spring": {"sqrt"},
    "spatial_tyre": {"sqrt", "sum of squares"},
    "spatial_tyre_relaxation": {"sqrt", "sum of squares", "cornering", "relaxation"},
    "spatial_angle_effort": {"sum of squares"},
    "spatial_measure_angle": {"sum of squares"},
    "spatial_angle_spring": {"sum of squares"},
    "spatial_ellipsoid_height": {"sqrt"},
    "spatial_ellipsoid_slip": {"sqrt"},
    "spatial_carried_ellipsoid_slip": {"sqrt"},
    "spatial_carried_wheel_slip_along": {"sqrt"},
    "spatial_carried_wheel_slip_across": {"sqrt"},
    "spatial_wheel_height": {"sqrt"},
    "spatial_wheel_slip_along": {"sqrt"},
    "spatial_wheel_slip_across": {"sqrt"},
}
"""What a definition divides by, and nothing else."""

AT_REST = "rigid, linear, at rest"
KEEPS, LOSES, EITHER = "keeps", "loses", "either"
ENERGY = {
    "spring": LOSES, "bearing": LOSES, "bushing": LOSES, "joint_spring": LOSES, "gear": LOSES, "belt": LOSES,
    "rack": LOSES, "rotor_bearing": EITHER, "tyre": EITHER, "creep": EITHER, "actuator": EITHER, "force": EITHER,
    "torque": EITHER, "expression": EITHER, "potential": KEEPS, "dissipation": LOSES,
    ("spring", AT_REST): KEEPS, ("rotor_bearing", AT_REST): LOSES, ("tyre", AT_REST): LOSES,
}  # fmt: skip
"""Whether a force loses energy beside what it stores, keeps it, or may do either; by type, and in one of the scenes."""
