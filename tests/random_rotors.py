"""Random rotors on two bearings, with their equations written by hand.

A rigid rotor with a disc, between its bearings or overhung, spins about z. With r = (x, y) of its centre, small tilts
φ, θ about x and y, and the places a, b of the bearings on the axis,

    m r̈ + … = 0,   I φ̈ + I_p Ω θ̇ + … = 0,   I θ̈ − I_p Ω φ̇ + … = 0,

and a bearing at z moves by x + z θ, y − z φ. Rotating (internal) damping c_i acts on the centre as
−c_i (ṙ − Ω × r).
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg


@dataclass
class Rotor:
    """Numbers of a rotor: bearings are (z, kxx, kyy, kxy, cxx, cyy)."""

    mass: float
    transverse: float
    polar: float
    internal: float
    unbalance: float
    bearings: list
    sags: bool

    @classmethod
    def random(cls, seed):
        rng = np.random.default_rng(seed)
        size = 10 ** rng.uniform(-1, 1)
        mass, radius = 3000 * size**3 * rng.uniform(0.2, 1), size * rng.uniform(0.1, 0.5)
        transverse = mass * radius**2 * rng.uniform(0.3, 2)
        polar = transverse * rng.uniform(0.1, 1.95)
        # Between the bearings, or overhung.
        ends = ([-1, 0.2], [-0.2, 1]) if rng.random() < 0.5 else ([0.1, 0.6], [0.4, 1.2])
        places = size * rng.uniform(*ends)
        stiffness, damped, round_ = mass * 10 ** rng.uniform(2, 6), rng.random() < 0.5, rng.random() < 0.3
        bearings = []
        for z in places:
            kxx, kyy = stiffness * rng.uniform(0.5, 2, 2)
            kyy = kxx if round_ else kyy
            kxy = 0.0 if round_ else 0.2 * rng.uniform(-1, 1) * min(kxx, kyy)
            c = damped * np.sqrt(mass * stiffness) * 10 ** rng.uniform(-4, -1)
            bearings.append((z, kxx, kyy, kxy, c, c))
        internal = np.sqrt(mass * stiffness) * 10 ** rng.uniform(-5, -2) * (rng.random() < 0.3) * damped
        numbers = map(float, (mass, transverse, polar, internal, size * rng.uniform(-0.5, 0.5)))
        return cls(*numbers, [tuple(map(float, x)) for x in bearings], bool(rng.random() < 0.3))

    @property
    def damped(self):
        """Whether the bearings are."""
        return self.bearings[0][4] > 0.0

    @property
    def text(self):
        """The model."""
        (a, *one), (b, *other) = self.bearings
        names, c = ("kxx", "kyy", "kxy", "kyx", "cxx", "cyy"), self.internal
        films = [
            ", ".join(f"{name}: {x!r}" for name, x in zip(names, (*k[:3], *k[2:]), strict=True)) for k in (one, other)
        ]
        inner = f"{{rotor.x: {-c!r}*(rate(rotor.x) + n*rotor.y), rotor.y: {-c!r}*(rate(rotor.y) - n*rotor.x)}}"
        place = "coordinates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}"
        place = "find: steady, steady: {axis: z, rate: 0}" if self.sags else place
        moments = [self.transverse, self.transverse, self.polar]
        return f"""mbstab: 1
gravity: [0, {-9.81 * self.sags}, 0]
parameters: {{n: {{value: 100, unit: rad/s}}}}
bodies:
  rotor:
    type: spatial
    mass: {self.mass!r}
    inertia: {moments!r}
    points: {{A: [0, 0, {a!r}], B: [0, 0, {b!r}], U: [0, 0, {self.unbalance!r}]}}
ground: {{points: {{A: [0, 0, {a!r}], B: [0, 0, {b!r}]}}}}
joints: {{thrust: {{type: point_on_plane, between: [ground, rotor], axis: z}}}}
forces:
  A: {{type: rotor_bearing, between: [rotor.A, ground.A], {films[0]}}}
  B: {{type: rotor_bearing, between: [rotor.B, ground.B], {films[1]}}}
{f"  inner: {{type: expression, on: {inner}}}" if c else ""}
outputs: {{x: rotor.x, y: rotor.y}}
reference: {{{place}, rates: {{rotor: {{psi: n}}}}}}
"""

    @property
    def polynomial(self):
        """The matrices of P(Ω) = P₀ + P₁ Ω + P₂ Ω², and the force of the unbalance over Ω², in x, y, θ, −φ."""
        K, C = np.zeros((4, 4)), np.zeros((4, 4))
        for z, kxx, kyy, kxy, cxx, cyy in self.bearings:
            place = np.hstack([np.eye(2), z * np.eye(2)])
            K += place.T @ np.array([[kxx, kxy], [kxy, kyy]]) @ place
            C += place.T @ np.diag([cxx, cyy]) @ place
        M, turned = np.diag([self.mass] * 2 + [self.transverse] * 2), np.array([[0.0, 1.0], [-1.0, 0.0]])
        gyroscopic, carried = np.zeros((4, 4)), np.zeros((4, 4))
        gyroscopic[2:, 2:] = self.polar * turned
        C[:2, :2] += self.internal * np.eye(2)
        carried[:2, :2] = self.internal * turned
        force = np.array([1.0, -1j, self.unbalance, -1j * self.unbalance])
        return (K.astype(complex), 1j * C + carried, 1j * gyroscopic - M), force

    def amplitudes(self, speeds):
        """Return x and y for an unbalance of 1 kg m, shape (2, speeds)."""
        (P0, P1, P2), force = self.polynomial
        n = np.asarray(speeds)[:, None, None]
        return (n[:, :, 0] ** 2 * np.linalg.solve(P0 + n * P1 + n**2 * P2, force[:, None])[..., 0]).T[:2]

    @property
    def poles(self):
        """The speeds at which P is singular, and whether x or y has a pole there; of rotors without damping."""
        (P0, _, P2), force = self.polynomial
        # P is Hermitian, so that left and right vectors are the same.
        values, X = scipy.linalg.eig(P0, -P2)
        sharp = np.flatnonzero((values.real > 0) & (np.abs(values.imag) < 1e-9 * np.abs(values)))
        sharp = sharp[np.argsort(values[sharp].real)]
        parts = np.max(np.abs(X[:2, sharp]), axis=0) * np.abs(X[:, sharp].conj().T @ force)
        return np.sqrt(values[sharp].real), parts > 1e-9 * np.max(parts)
