"""Symmetries of a scene: what explains its zero eigenvalues.

Two kinds are found numerically. A *constant* direction w of the coordinates is ignorable if
no equation depends on q along it: K w = 0, C_q w = 0, D_q w = 0 at arbitrary states. A
*rotation* of everything about a fixed axis is a symmetry if it carries the reference motion
into another motion with the same accelerations, turned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from mbstab.analysis.motion import Motion, motion_at, unbalance
from mbstab.analysis.rotation import rate_drift, rate_matrix
from mbstab.analysis.steady import Generator, axis_text, through
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError

STATES = 3
TOLERANCE = 1e-9
ANGLE = 0.7

SHARP = 1e-12
"""An element is carried into itself if what it does changes by no more than this part of its own size."""


WEAK = 1e-4
"""Elements weaker than this part of the strongest are looked at by themselves."""

_UNEQUAL: WeakKeyDictionary[System, bool] = WeakKeyDictionary()

BASIS = 1e-14
"""Motions that the constraints allow are known to this, in scaled coordinates."""


@dataclass(frozen=True)
class Symmetry:
    """A direction in which the motion can be shifted without effect.

    Attributes
    ----------
    name : str
        Such as ``wheel.psi``, ``translation along x``, ``rotation about z``.
    direction : ndarray, shape (n_q,)
        The shift of the coordinates.
    exact : bool
        Whether the direction is known but for its own rounding; not if it was found as a null vector.
    """

    name: str
    direction: Array
    exact: bool = True


def symmetries(system: System, motion: Motion) -> list[Symmetry]:
    """Return independent symmetries of the scene at the reference motion."""
    found = [item for item in _constant_directions(system, motion) if _shifts_elements(system, motion, item.direction)]
    # Rows may depend on a shift away from the constraints only, so shifts are tried on them as well.
    moved = [(name, _shift(system, motion, direction)) for name, direction in _shifts(system)]
    turned = [(name, _rotation(system, motion, axis, point)) for name, axis, point in _axes(system, motion)]
    turned += _own_turns(system, motion)
    for name, direction in [*moved, *turned, ("the motion itself", _own(system, motion))]:
        if direction is not None and np.any(direction):
            basis = np.array([s.direction for s in found] + [direction]) / motion.spaces.scale
            basis /= np.linalg.norm(basis, axis=1)[:, None]
            if np.linalg.matrix_rank(basis, tol=1e-8) == len(basis):
                found.append(Symmetry(name, direction))
    return found


def conserved(system: System, motion: Motion, known: list[Symmetry]) -> int:
    """Return how many momenta along symmetries are kept near a state of rest: nothing there resists or drives them.

    A motion along such a symmetry goes on, which makes a second zero eigenvalue.
    """
    scale = motion.spaces.scale
    along = np.array([item.direction for item in known]).T / scale[:, None]
    along = scale[:, None] * along / np.linalg.norm(along, axis=0)
    allowed = scale[:, None] * (motion.spaces.N @ motion.spaces.Z)
    rows = [np.zeros((1, len(known)))]
    for element in system.forces_alone():
        _, R, _ = element.linearize(motion.q, motion.u, motion.a, np.zeros(system.n_c), motion.time)
        size = float(np.max(np.abs(along).T @ np.abs(R) @ np.abs(allowed), initial=0.0))
        if size > 0.0:
            resisted = (along.T @ R @ allowed).T / size
            rows.append(np.where(np.abs(resisted) > SHARP, resisted, 0.0))
    return len(known) - int(np.linalg.matrix_rank(np.vstack(rows), tol=TOLERANCE))


def _shifts(system: System) -> list[tuple[str, Array]]:
    """Return the shifts worth trying: of everything along an axis, and of each coordinate."""
    candidates: list[tuple[str, Array]] = []
    for axis in "xyz":
        shift = np.array([float(name.endswith(f".{axis}")) for name in system.names])
        if np.sum(shift) > 1:
            candidates.append((f"translation along {axis}", shift))
    return candidates + [(name, np.eye(system.n_q)[i]) for i, name in enumerate(system.names)]


def _shift(system: System, motion: Motion, direction: Array) -> Array | None:
    """Return a direction of the coordinates if shifting along it is a symmetry, or None."""
    q = motion.q + ANGLE * direction * motion.sizes
    return direction if _carries(system, motion, q, np.eye(system.n_q)) else None


def _carries(system: System, motion: Motion, q: Array, T: Array, drift: Callable[[Array], Array] | None = None) -> bool:
    """Whether a change of the coordinates with derivative T that leads to q carries motions into motions.

    Asked of the motion itself, and of one nearby that is faster: at rest more positions are
    alike than symmetries explain. The derivative itself changes with the speeds by `drift`.
    """
    steps = TOLERANCE * motion.sizes
    try:
        for u in (motion.u, motion.u + _disturbance(system, motion)):
            base = motion if u is motion.u else motion_at(system, motion.q, u, motion.time)
            moved_u, a = T @ u, _carried_accelerations(system, motion.q, base, q, T)
            a = a if drift is None else a + drift(base.u)
            state = system.dynamics(q, moved_u, motion.time)
            if np.any(np.abs(state.E[: system.n_h]) > (np.abs(state.J) @ steps)[: system.n_h]):
                return False
            fastest = float(np.max(np.abs(moved_u) / motion.sizes))
            if np.any(np.abs(state.V) > np.abs(state.J) @ steps * fastest):
                return False
            moved = motion_at(system, q, moved_u, motion.time)
            force = (moved.dynamics.M @ (moved.a - a)) * motion.spaces.scale
            if np.max(np.abs(force)) > unbalance(system, base):
                return False
            if not _carries_elements(system, base, (q, moved_u, a), T):
                return False
    except (MbstabError, ValueError, np.linalg.LinAlgError):
        return False
    return True


def _carries_elements(system: System, base: Motion, moved: tuple[Array, Array, Array], T: Array) -> bool:
    """Whether the elements do the same after a turn or a shift: weak springs do not count less beside stiff ones.

    Those that do not do the same by themselves must do so together, along all motions that the constraints allow.
    """
    if not _unequal(system, base):
        return True  # the sums of all elements have told it
    allowed = base.spaces.scale[:, None] * (base.spaces.N @ base.spaces.Z)
    reach = np.abs(allowed) + BASIS / TOLERANCE * base.spaces.scale[:, None]
    total, size = np.zeros((2, allowed.shape[1]))
    for element in system.forces_alone():
        before, rounding = _force(element, base.q, base.u, base.a, base)
        after, more = _force(element, *moved, base)
        change = after @ T - before
        if np.any(np.abs(change) > SHARP * (rounding + more @ np.abs(T))):
            total += change @ allowed
            size += (np.abs(before) + np.abs(after @ T)) @ reach
    return bool(np.all(np.abs(total) <= TOLERANCE * size))


def _unequal(system: System, motion: Motion) -> bool:
    """Whether some elements are so weak beside others that their sums do not tell what they do."""
    if system not in _UNEQUAL:
        sizes = []
        for element in system.forces_alone():
            size = _force(element, motion.q + 0.01 * motion.sizes, motion.u, motion.a, motion)[1] * motion.spaces.scale
            sizes += size[size > 0.0].tolist()
        _UNEQUAL[system] = bool(sizes) and min(sizes) < WEAK * max(sizes)
    return _UNEQUAL[system]


def _force(element: System, q: Array, u: Array, a: Array, motion: Motion) -> tuple[Array, Array]:
    """Return the force of an element alone, with its inertia, and the size of what it is computed from."""
    state = element.dynamics(q, u, motion.time)
    K, R, _ = element.linearize(q, u, a, np.zeros(element.n_c), motion.time)
    size = np.abs(state.F0) + np.abs(state.M) @ np.abs(a) + np.abs(K) @ motion.sizes + np.abs(R) @ np.abs(u)
    return state.F0 + state.M @ a, size


def _shifts_elements(system: System, motion: Motion, direction: Array) -> bool:
    """Whether a shift of the coordinates that no equation seems to depend on leaves every element as it is."""
    q = motion.q + ANGLE * direction * (np.min(motion.sizes) / np.max(np.abs(direction)))
    try:
        return _carries_elements(system, motion, (q, motion.u, motion.a), np.eye(system.n_q))
    except (MbstabError, ValueError):
        return False


def _disturbance(system: System, motion: Motion) -> Array:
    """Return speeds that the constraints allow, as fast as the scene would move by itself."""
    spaces, rate = motion.spaces, _rate(system, motion)
    allowed = spaces.N @ spaces.Z
    speeds = spaces.scale * (allowed @ np.random.default_rng(11).uniform(0.5, 1.0, allowed.shape[1]))
    largest = float(np.max(np.abs(speeds) / motion.sizes, initial=0.0))
    result: Array = speeds * (0.3 * rate / largest) if largest > 0.0 else speeds
    return result


def _rate(system: System, motion: Motion) -> float:
    """Return a rate at which the scene moves by itself or is moved (1/s)."""
    scale = motion.spaces.scale
    K, R, _ = system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
    K, R = (np.abs(x * scale * scale[:, None]) for x in (K, R))
    return max(float(np.max(np.abs(motion.u) / motion.sizes)), float(np.max(K)) ** 0.5, float(np.max(R))) or 1.0


def _constant_directions(system: System, motion: Motion) -> list[Symmetry]:
    rng = np.random.default_rng(20)
    scale = motion.spaces.scale
    blocks: list[Array] = []
    size, rate = np.maximum(np.abs(motion.q), 0.3 * motion.sizes), _rate(system, motion)
    while len(blocks) < STATES:
        for spread in (1.0, 0.1, 0.01, 0.0):
            try:
                blocks.append(_dependence(system, motion, rng, size * spread, rate))
                break
            except MbstabError:
                continue
        else:
            return []
    stacked = np.vstack(blocks) * scale
    lengths = np.linalg.norm(stacked, axis=1)
    stacked = stacked[lengths > 0.0] / lengths[lengths > 0.0, None]
    if not len(stacked):
        stacked = np.zeros((1, system.n_q))
    _, s, right = np.linalg.svd(stacked)
    rank = int(np.sum(s > TOLERANCE * max(s[0], 1e-300)))
    null = right[rank:].T
    return _named(system, null, scale)


def _dependence(system: System, motion: Motion, rng: np.random.Generator, spread: Array, rate: float) -> Array:
    """Return K, C_q and D_q at a random state near the reference, with speeds and forces that belong to a rate."""
    n, spaces = system.n_q, motion.spaces
    q = motion.q + spread * rng.uniform(-1.0, 1.0, n)
    u = motion.u + rate * spread * rng.uniform(-1.0, 1.0, n)
    a, nu = rate * rate * spread * rng.uniform(-1.0, 1.0, n), rng.uniform(0.5, 1.5, system.n_c)
    nu *= rate * rate * spaces.row_scale * float(np.max(motion.sizes / spaces.scale))
    K, _, D_q = system.linearize(q, u, a, nu, motion.time)
    C_q = system.dynamics(q, u, motion.time).J[: system.n_h]
    return np.vstack([K, C_q, D_q])


def _named(system: System, null: Array, scale: Array) -> list[Symmetry]:
    """Return a basis of the null space made of coordinates, joint translations and the rest."""
    found: list[Symmetry] = []
    basis = np.zeros((0, len(scale)))
    for name, direction in _shifts(system):
        scaled = direction / scale
        scaled /= np.linalg.norm(scaled)
        inside = np.linalg.norm(scaled - null @ (null.T @ scaled)) < 1e-7
        rest = scaled - basis.T @ (basis @ scaled)
        if inside and np.linalg.norm(rest) > 1e-6:
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
            found.append(Symmetry(name, direction))
    remaining = null - basis.T @ (basis @ null)
    left, s, _ = np.linalg.svd(remaining, full_matrices=False)
    for vector in left.T[: int(np.sum(s > 1e-6))]:
        direction = vector * scale
        strong = [
            n for n, x in zip(system.names, np.abs(direction), strict=True) if x > 0.3 * np.max(np.abs(direction))
        ]
        found.append(Symmetry("joint shift of " + ", ".join(strong[:4]), direction, exact=False))
    return found


# --- rotations ------------------------------------------------------------------------------------------------------


def _own(system: System, motion: Motion) -> Array | None:
    """Return the direction of a steady motion, if going along it is a symmetry at any time."""
    for generator in motion.generators:
        if generator.turns or np.any(generator.velocity):
            rate = abs(generator.rate) or float(np.max(np.abs(generator.field(motion.q)) / motion.sizes))
            q, T = generator.flow(motion.q, ANGLE / rate)
            return generator.field(motion.q) if _carries(system, motion, q, T) else None
    return None


def _axes(system: System, motion: Motion) -> list[tuple[str, Array, Array]]:
    """Return the rotations worth trying: name, axis and a point of it."""
    gravity, origin = system.scene.gravity, np.zeros(3)
    own = [
        (f"rotation about {axis_text(g.axis)}" + through(g.point), g.axis, g.point)
        for g in motion.generators
        if g.turns and (np.any(g.point) or not any(abs(abs(x) - 1.0) < 1e-12 for x in g.axis))
    ]
    if system.scene.dimension == 2:
        plane = [] if any(gravity) else [("rotation in the plane", np.array([0.0, 0.0, 1.0]), origin)]
        return plane + own
    if any(gravity):
        up = -np.array(gravity, dtype=float)
        up /= np.max(np.abs(up))
        axis = up / np.linalg.norm(up)
        k = int(np.argmax(np.abs(axis)))
        name = f"rotation about {'xyz'[k]}" if abs(axis[k]) > 1.0 - 1e-12 else "rotation about the vertical"
        return [(name, axis, origin), *own]
    return [*((f"rotation about {name}", np.eye(3)[i], origin) for i, name in enumerate("xyz")), *own]


def _rotation(system: System, motion: Motion, axis: Array, point: Array) -> Array | None:
    """Return the direction of a rotation about an axis through a point, or None if it is no symmetry."""
    generator = Generator(system, axis, point, 1.0, np.zeros(3), np.zeros(system.n_q))
    try:
        q, T = generator.flow(motion.q, ANGLE)
    except (ValueError, np.linalg.LinAlgError):
        return None
    return generator.field(motion.q) if _carries(system, motion, q, T) else None


def _own_turns(system: System, motion: Motion) -> list[tuple[str, Array | None]]:
    """Return the turns of planar bodies about their centres of mass, where these are not their places."""
    found: list[tuple[str, Array | None]] = []
    for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
        if system.scene.dimension != 2 or part.stop - part.start != 3 or not any(body.center):
            continue
        c, s = (float(np.cos(motion.q[part.stop - 1])), float(np.sin(motion.q[part.stop - 1])))
        x, y = (float(value) for value in body.center[:2])
        lever = np.array([c * x - s * y, s * x + c * y])
        c, s = float(np.cos(ANGLE)), float(np.sin(ANGLE))
        moved = np.array([c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]])
        across = np.array([[-z[1], z[0]] for z in (lever, moved)])
        q, T, direction = motion.q.copy(), np.eye(system.n_q), np.zeros(system.n_q)
        places, angle = slice(part.start, part.start + 2), part.stop - 1
        q[places] += lever - moved
        q[angle] += ANGLE
        T[places, angle] = across[0] - across[1]
        direction[places], direction[angle] = -across[0], 1.0

        def drift(u: Array, change: Array = moved - lever, places: slice = places, angle: int = angle) -> Array:
            result = np.zeros(len(u))
            result[places] = change * u[angle] ** 2
            return result

        found.append((system.names[angle], direction if _carries(system, motion, q, T, drift) else None))
    return found


def _carried_accelerations(system: System, q: Array, base: Motion, moved: Array, T: Array) -> Array:
    """Return the accelerations of a motion through q after a turn or a shift to `moved` with derivative T."""
    a: Array = T @ base.a
    if system.scene.dimension == 3:
        # Euler angles change nonlinearly: the angular accelerations, G a + Ġ u, are what turns.
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            if body.orientation:
                angles = slice(part.start + 3, part.stop)
                G, G_before = rate_matrix(body, moved[angles]), rate_matrix(body, q[angles])
                turn = G @ T[angles, angles] @ np.linalg.inv(G_before)
                rates = T[angles, angles] @ base.u[angles]
                drift = turn @ rate_drift(body, q[angles], base.u[angles]) - rate_drift(body, moved[angles], rates)
                a[angles] += np.linalg.solve(G, drift)
    return a
