"""What a scene consists of, what it does not need, and the residuals of its reference."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import RandomNumbers
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.rotation import rate_matrix
from mbstab.analysis.reference.symmetries import symmetries
from mbstab.analysis.verdict.facts import Grounds
from mbstab.compiler.system import Array, System
from mbstab.model.dependencies import equations_of, unused_texts, used_in
from mbstab.records import Answer, dataclass


@dataclass(frozen=True)
class CheckReport(Answer):
    """The scene in numbers and words.

    Attributes
    ----------
    dimension : int
        2 planar, 3 spatial.
    gravity : tuple of float
        In m/s², in ground axes.
    bodies : list of (name, coordinates, mass in kg)
    constraints : list of (name, type, holonomic rows, nonholonomic rows)
    n_q, n_holonomic, n_nonholonomic, rank_holonomic, rank_nonholonomic, n_f, states : int
        As in `mbstab.analysis.spectrum.results.Counts`: the rates of the states count as nonholonomic rows.
    gaps : tuple of float
        Ratio of the singular values on both sides of each of the two rank decisions.
    redundant : list of str
        Redundant constraint rows, by name.
    symmetries : list of str
        Ignorable coordinates and other symmetries.
    unneeded : list of str
        Parts that the scene does not need, and what leaving them out saves.
    position_residual, velocity_residual : float
        Largest residuals of the reference, over the rows.
    solved : list of str
        Coordinates and rates that the file leaves to the program.
    at_rest : bool
    warnings : list of str
    """

    dimension: int
    gravity: tuple[float, ...]
    bodies: list[tuple[str, tuple[str, ...], float]]
    constraints: list[tuple[str, str, int, int]]
    n_q: int
    n_holonomic: int
    n_nonholonomic: int
    rank_holonomic: int
    rank_nonholonomic: int
    n_f: int
    states: int
    gaps: tuple[float, float]
    redundant: list[str]
    symmetries: list[str]
    unneeded: list[str]
    position_residual: float
    velocity_residual: float
    solved: list[str]
    at_rest: bool
    warnings: list[str]

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent speeds."""
        return self.n_q - self.rank_holonomic - self.rank_nonholonomic


def check_scene(system: System) -> CheckReport:
    """Return the report on a scene at its reference motion.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.reference.motion.reference_motion`.
    """
    scene, motion = system.scene, reference_motion(system, massless=True)
    spaces, state = motion.spaces, motion.dynamics
    return CheckReport(
        dimension=scene.dimension,
        gravity=tuple(float(x) for x in scene.gravity),
        bodies=[(body.name, body.coordinates, float(body.mass)) for body in scene.bodies],
        constraints=_constraints(system),
        n_q=system.n_q,
        n_holonomic=system.n_h,
        n_nonholonomic=system.n_n,
        rank_holonomic=spaces.C.rank,
        rank_nonholonomic=spaces.W.rank,
        n_f=spaces.n_f if motion.massless is None else linearize(system, motion).n_f,
        states=len(system.states[0]),
        gaps=(spaces.C.gap, spaces.W.gap),
        redundant=[str(item) for item in motion.redundant],
        symmetries=[item.name for item in symmetries(system, motion)],
        unneeded=_unneeded(system, motion),
        position_residual=float(np.max(np.abs(state.E[: system.n_h]), initial=0.0)),
        velocity_residual=float(np.max(np.abs(state.V), initial=0.0)),
        solved=list(motion.solved),
        at_rest=motion.at_rest,
        warnings=list(motion.warnings),
    )


def _constraints(system: System) -> list[tuple[str, str, int, int]]:
    model = system.scene.model
    found = []
    for section in (section for section in model.order if section != "states"):
        for entry in model.entries[section].values():
            mine = [i for i, row in enumerate(system.rows) if (row.section, row.name) == (section, entry.name)]
            if mine:
                kind = " ".join(dict.fromkeys([entry.kind.name, section.removesuffix("s")]))
                found.append((entry.name, kind, sum(i < system.n_h for i in mine), sum(i >= system.n_h for i in mine)))
    return found


def _unneeded(system: System, motion: Motion) -> list[str]:
    scene, spaces = system.scene, motion.spaces
    allowed = spaces.scale[:, None] * spaces.N
    moving = _moving(system, motion)
    # What is redundant at the reference only restricts motions beside it.
    spare = motion.redundant and not Grounds(linearize(system, motion)).singular
    found = [f"{item} (one row, one multiplier)" for item in motion.redundant if spare]
    for body, part in zip(scene.bodies, system.body_slices, strict=True):
        if not moving[part].any() and not np.any(motion.u[part]):
            found.append(
                f"body {body.name!r} cannot move: as part of the ground it saves {len(body.coordinates)} coordinates"
            )
    if scene.dimension == 3 and motion.at_rest:
        axis = _planar_axis(system, motion, allowed)
        if axis:
            count = sum(3 if len(body.coordinates) == 6 else 2 for body in scene.bodies)
            found.append(
                f"every small motion stays in the plane across {axis}: a planar scene has {count} coordinates "
                f"instead of {system.n_q}"
            )
    model = scene.model
    signals = [entry.values for entry in model.inputs.values()]
    besides = [model.outputs, signals, model.reference, model.initial, model.expect]
    used = used_in(model, [equations_of(model), besides])
    unused = [f"parameter {name!r}" for name in model.parameters if name not in used] + unused_texts(model)
    return found + [f"{name} is not used" for name in unused]


def _moving(system: System, motion: Motion) -> npt.NDArray[np.bool_]:
    """Return which coordinates can move, at the reference or near it: a dead point does not count as fixed."""
    spaces, finder = motion.spaces, Finder(system)
    moving: npt.NDArray[np.bool_] = np.linalg.norm(spaces.N, axis=1) > 1e-9
    rng = RandomNumbers(4)
    direction = spaces.scale * (spaces.N @ rng.uniform(-1.0, 1.0, spaces.N.shape[1]))
    size = float(np.max(np.abs(direction / motion.sizes), initial=0.0))
    if size > 0.0:
        q = finder.assemble(motion.q + 0.1 / size * direction, np.ones(system.n_q, dtype=bool))
        moving |= np.abs(q - motion.q) > 1e-6 * motion.sizes
    return moving


def _planar_axis(system: System, motion: Motion, allowed: Array) -> str:
    """Return the axis normal to which all admissible small motions are planar, or an empty string."""
    for k, axis in enumerate("xyz"):
        fits = allowed.shape[1] > 0
        for body, part in zip(system.scene.bodies, system.body_slices, strict=True):
            motions = allowed[part]
            size = np.max(np.abs(motions), initial=1e-300)
            fits &= bool(np.all(np.abs(motions[k]) < 1e-9 * size))
            if body.orientation:
                spin = rate_matrix(body, motion.q[part.start + 3 : part.start + 6]) @ motions[3:]
                fits &= bool(np.all(np.abs(np.delete(spin, k, axis=0)) < 1e-9 * max(size, 1e-300)))
        if fits:
            return axis
    return ""
