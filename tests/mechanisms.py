"""Texts of mechanisms that several tests use, with words in capitals for what differs, and their frequencies."""

import mbstab

DOOR = """
mbstab: 1
gravity: [GRAVITY, 0, -9]
parameters: {e: EXTRA}
bodies:
  d: {type: spatial, mass: 2, inertia: [0.1, 0.2, 0.3], points: {A: [0.5, 0, -1], B: [0.5, 0, 1], C: [0.5 + e, 0, 0]}}
joints:
  a: {type: spherical, between: [d.A, ground.A]}
  b: {type: spherical, between: [d.B, ground.B]}
  c: {type: spherical, between: [d.C, ground.C]}
ground: {points: {A: [0, 0, -1], B: [0, 0, 1], C: [e, 0, 0]}}
reference: {coordinates: {d: {x: -0.5, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}
"""

FREE_DISK = """\
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {disk: {type: spatial, mass: 2, shape: {type: disk, radius: 0.3, thickness: 0.05}}}
contacts: {rolling: {type: wheel, center: disk, axle: z, radius: 0.3}}
reference:
  coordinates: {disk: {x: 0, y: 0, z: 0.3, phi: pi/2, theta: 0, psi: 0}}
  rates: {disk: {x: -1.5, y: 0, z: 0, phi: 0, theta: 0, psi: 5}}
"""

SLIDER_CRANK = """\
mbstab: 1
gravity: [0, -9.81]
bodies:
  crank: {type: planar, mass: 1, shape: {type: rod, length: 1}, points: {O: [-0.5, 0], A: [0.5, 0]}}
  rod: {type: planar, mass: 1, shape: {type: rod, length: LENGTH}, points: {A: [-LENGTH/2, 0], B: [LENGTH/2, 0]}}
  slider: {type: planar, mass: 1, inertia: 1}
joints:
  O: {type: revolute, between: [crank.O, ground]}
  A: {type: revolute, between: [rod.A, crank.A]}
  B: {type: revolute, between: [rod.B, slider]}
  guide: {type: prismatic, between: [ground, slider], axis: x}
drives: {motor: {type: coordinate, coordinate: crank.theta, LAW}}
reference: {coordinates: {crank: {theta: 0.2}}, guess: {rod: {x: 1.3, y: 0.1, theta: -0.2}, slider: {x: 1.75}}}
"""


def frequencies(model, **parameters):
    """Return the imaginary parts above zero of the eigenvalues (rad/s), which must be all of them, in their order."""
    values = [e.value for e in mbstab.loads(model).eig(**parameters).eigenvalues]
    found = sorted(z.imag for z in values if z.imag > 1e-5)
    size = max(abs(z) for z in values)
    assert max(abs(z.real) for z in values) <= 1e-12 * size
    return found
