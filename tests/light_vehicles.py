"""Texts of random vehicles, from a seed: light bodies beside knife edges and rolling wheels, masses down to 1e-12.

Skateboards with tilted trucks, bicycles with light wheels and forks, and rows of casters that are dragged on edges.
All places are expressions of decimals, so that a text means the same vehicle with any number of digits.
"""

import random

LIGHT = (-12, -3)
"""Decades of the mass of a light body over that of the heavy one."""

SKATEBOARD = """\
mbstab: 1
parameters: {{h: {h!r}, l: {l[0]!r}, r: {l[1]!r}, tf: {t[0]!r}, tr: {t[1]!r}, V: {V!r}, s: {s!r}}}
gravity: [0, 0, -9.81]
bodies:
  board:
    type: spatial
    mass: {m!r}
    inertia: [{roll!r}, {yaw!r}, {yaw!r}]
    points: {{f: [l, 0, -h], r: [-r, 0, -h]}}
    directions: {{af: [1, 0, tf], ar: [1, 0, -tr]}}
  front:
    {{type: spatial, mass: {e[0]!r}, inertia: [{j[0]!r}, {j[0]!r}, {j[0]!r}], points: {{L: [0, s, 0], R: [0, -s, 0]}},
     directions: {{a: [1, 0, tf]}}}}
  rear:
    {{type: spatial, mass: {e[1]!r}, inertia: [{j[1]!r}, {j[1]!r}, {j[1]!r}], points: {{L: [0, s, 0], R: [0, -s, 0]}},
     directions: {{a: [1, 0, -tr]}}}}
joints:
  pf: {{type: revolute, between: [board.f, front], axis: [af, a]}}
  pr: {{type: revolute, between: [board.r, rear], axis: [ar, a]}}
  fl: {{type: point_on_plane, between: [ground, front.L], axis: z}}
  fr: {{type: point_on_plane, between: [ground, front.R], axis: z}}
  rl: {{type: point_on_plane, between: [ground, rear.L], axis: z}}
  rr: {{type: point_on_plane, between: [ground, rear.R], axis: z}}
contacts:
  f: {{type: knife_edge, at: front, along: x}}
  r: {{type: knife_edge, at: rear, along: x}}
forces:
  sf: {{type: joint_spring, joint: pf, stiffness: {k[0]!r}, damping: {c!r}}}
  sr: {{type: joint_spring, joint: pr, stiffness: {k[1]!r}}}
reference:
  coordinates:
    board: {{x: 0, y: 0, z: h, phi: 0, theta: 0, psi: 0}}
    front: {{x: l, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    rear: {{x: -r, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates:
    board: {{x: V, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
"""

BICYCLE = """\
mbstab: 1
parameters:
  {{w: {w!r}, tilt: {tilt!r}, v: {v!r}, a: {radius[0]!r}, b: {radius[1]!r}, xb: {frame[0]!r}, zb: {frame[1]!r},
   xh: {fork[0]!r}, zh: {fork[1]!r}, xs: w + {trail!r} - zh*tan(tilt)}}
gravity: [0, 0, -9.81]
bodies:
  rear: {{type: spatial, mass: {m[0]!r}, inertia: [{i[0]!r}, {i[0]!r}, {i[0]!r}], axes: [pi/2, 0, 0]}}
  frame:
    type: spatial
    mass: {m[1]!r}
    inertia: [{i[1]!r}, {i[1]!r}, {i[1]!r}]
    points: {{hub: [-xb, 0, a - zb], head: [xs - xb, 0, zh - zb]}}
    directions: {{steer: [-sin(tilt), 0, cos(tilt)]}}
  fork:
    type: spatial
    mass: {m[2]!r}
    inertia: [{i[2]!r}, {i[2]!r}, {i[2]!r}]
    points: {{hub: [w - xh, 0, b - zh], head: [xs - xh, 0, 0]}}
    directions: {{steer: [-sin(tilt), 0, cos(tilt)]}}
  front: {{type: spatial, mass: {m[3]!r}, inertia: [{i[3]!r}, {i[3]!r}, {i[3]!r}], axes: [pi/2, 0, 0]}}
joints:
  rear_axle: {{type: revolute, between: [frame.hub, rear], axis: [-y, z]}}
  steering: {{type: revolute, between: [frame.head, fork.head], axis: steer}}
  front_axle: {{type: revolute, between: [fork.hub, front], axis: [-y, z]}}
contacts:
  r: {{type: wheel, center: rear, axle: z, radius: a}}
  f: {{type: wheel, center: front, axle: z, radius: b}}
reference:
  coordinates:
    rear: {{x: 0, y: 0, z: a, phi: 0, theta: 0, psi: 0}}
    frame: {{x: xb, y: 0, z: zb, phi: 0, theta: 0, psi: 0}}
    fork: {{x: xh, y: 0, z: zh, phi: 0, theta: 0, psi: 0}}
    front: {{x: w, y: 0, z: b, phi: 0, theta: 0, psi: 0}}
  rates:
    rear: {{x: v, y: 0, z: 0, phi: 0, theta: 0, psi: -v/a}}
    frame: {{x: v, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    fork: {{x: v, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    front: {{x: v, y: 0, z: 0, phi: 0, theta: 0, psi: -v/b}}
"""


def light_vehicle(seed):
    """Return the text of a vehicle."""
    return (skateboard, bicycle, casters)[seed % 3](random.Random(seed))


def three(x):
    """Return a number with three digits."""
    return float(f"{x:.2e}")


def size(r, low, high):
    """Return a number with three digits, its logarithm uniform."""
    return three(10.0 ** r.uniform(low, high))


def speed(r):
    """Return a speed ahead or back."""
    return r.choice([-1, 1]) * size(r, -1, 1)


def skateboard(r):
    """Return a board on two trucks, alike or not."""
    m, s = size(r, 1, 2), size(r, -1.3, -0.7)

    def two(low, high):
        one = size(r, low, high)
        return one, r.choice([one, size(r, low, high)])

    e = tuple(three(m * x) for x in two(*LIGHT))
    return SKATEBOARD.format(
        h=size(r, -0.7, 0.2), l=two(-0.7, 0.2), t=two(-0.7, 0.5), V=speed(r), s=s, m=m, roll=three(m * size(r, -2, -1)),
        yaw=three(m * size(r, -1.2, -1)), e=e, j=tuple(three(x * s * s) for x in e), k=two(1, 3),
        c=r.choice([0.0, size(r, -1, 2)]),
    )  # fmt: skip


def bicycle(r):
    """Return a bicycle of which one to three parts are light."""
    m = [size(r, 0, 2) for _ in range(4)]
    for part in r.sample((0, 2, 3), r.randint(1, 3)):
        m[part] = three(m[1] * size(r, *LIGHT))

    def place(*ends):
        return [three(r.uniform(*x)) for x in ends]

    return BICYCLE.format(
        w=three(r.uniform(0.8, 1.5)), tilt=three(r.uniform(-0.3, 0.5)), v=speed(r), trail=three(r.uniform(-0.1, 0.2)),
        radius=place((0.1, 0.4), (0.1, 0.4)), frame=place((0.1, 0.7), (0.4, 1.2)), fork=place((0.6, 1.2), (0.4, 0.9)),
        m=m, i=[three(x * size(r, -2, -1)) for x in m],
    )  # fmt: skip


def casters(r):
    """Return a planar body on an edge, with light bodies on edges at its pins or behind each other."""
    m, v = size(r, 0, 3), speed(r)
    points, pins = [f"e: [{-size(r, -1, 0)!r}, 0]"], []
    bodies, edges, springs, places, before = [], ["own: {type: knife_edge, at: c.e, along: x}"], [], [], 0.0
    for i in range(r.randint(1, 3)):
        e, trail = m * size(r, *LIGHT), r.choice([1, 1, -1]) * size(r, -1.5, 0)
        if i and r.random() < 0.5:
            pin, x = f"b{i - 1}.end", f"{places[-1]} - ({before!r})"
        else:
            arm = three(r.uniform(-1, 1))
            points.append(f"p{i}: [{arm!r}, 0]")
            pin, x = f"c.p{i}", f"({arm!r})"
        places.append(f"{x} - ({trail!r})")
        marks = f"points: {{pin: [{trail!r}, 0], end: [{-trail!r}, 0]}}"
        bodies.append(f"b{i}: {{type: planar, mass: {three(e)!r}, inertia: {three(e * size(r, -2, 0))!r}, {marks}}}")
        pins.append(f"j{i}: {{type: revolute, between: [{pin}, b{i}.pin]}}")
        edges.append(f"k{i}: {{type: knife_edge, at: b{i}{r.choice(['', '.end'])}, along: x}}")
        if r.random() < 0.7:
            laws = f"stiffness: {size(r, -1, 3)!r}, damping: {size(r, -2, 2)!r}"
            springs.append(f"s{i}: {{type: joint_spring, joint: j{i}, {laws}}}")
        before = trail

    def block(lines):
        return "".join(f"  {line}\n" for line in lines)

    bodies.append(f"c: {{type: planar, mass: {m!r}, inertia: {size(r, 0, 3)!r}, points: {{{', '.join(points)}}}}}")
    at = ["c: {x: 0, y: 0, theta: 0}", *(f"b{i}: {{x: {x}, y: 0, theta: 0}}" for i, x in enumerate(places))]
    rates = [f"{name}: {{x: {v!r}, y: 0, theta: 0}}" for name in ("c", *(f"b{i}" for i in range(len(places))))]
    forces = f"forces:\n{block(springs)}" if springs else ""
    return (
        f"mbstab: 1\nbodies:\n{block(bodies)}joints:\n{block(pins)}contacts:\n{block(edges)}{forces}"
        f"reference:\n  coordinates:\n  {block(at).replace(chr(10) + '  ', chr(10) + '    ')}"
        f"  rates:\n  {block(rates).replace(chr(10) + '  ', chr(10) + '    ')}"
    )
