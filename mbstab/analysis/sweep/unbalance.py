"""Unbalance responses of rotors: how outputs answer to a small mass beside the spin axis.

A mass m at the distance e from the axis turns with the spin Ω and acts as the force m e Ω² (e₁ cos Ωt + e₂ sin Ωt) at
a point of the body. e₁ is the ground axis that follows the one nearest to the spin (x for a spin about z), made
perpendicular to it; e₁, e₂ and the spin are right-handed. An output with the transfer functions G₁ and G₂ from forces
along e₁ and e₂ is then Re(z exp(iΩt)), z = m e Ω² (G₁(iΩ) - i G₂(iΩ)).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.state_space import ControlModel, control_model
from mbstab.analysis.response.transfer import channels, number_of
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.analysis.sweep.blocks import Progress, compute, merged, tasks
from mbstab.analysis.verdict.rule import UNDECIDED, WORDS
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.mechanics.catalogue import ElementUse, Kind
from mbstab.model.evaluator import Evaluator
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Entry, Model
from mbstab.model.values import evaluate
from mbstab.model.words import UNSTABLE
from mbstab.records import dataclass

NAMES = ("unbalance along e1", "unbalance along e2")
"""Names of the two forces, which no input of a file can have."""


@dataclass(frozen=True)
class UnbalanceResponse:
    """Amplitudes of outputs over the spin, for an unbalance m e of 1 kg m.

    Attributes
    ----------
    point : str
        Where it is: a body, or a point of a body.
    parameter : str
        The parameter that is the spin.
    speeds : ndarray, shape (n,)
        Angular velocities (rad/s).
    outputs, units : tuple of str
        Names, and units such as ``m/(kg*m)``, empty where they are not known.
    values : ndarray of complex, shape (outputs, n)
        z of the module's text; its phase is relative to the unbalance. Infinite at an undamped critical speed.
    verdicts : tuple of str
        Of the motion without unbalance at each speed. Where it is unstable, no rotor answers like this.
    """

    point: str
    parameter: str
    speeds: Array
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    values: Complex
    verdicts: tuple[str, ...]

    @property
    def unstable(self) -> Array:
        """Where the motion without unbalance is unstable, shape (n,)."""
        return np.array([verdict == UNSTABLE for verdict in self.verdicts])


def unbalance(
    model: Model,
    point: str,
    parameter: str,
    speeds: Array,
    goals: tuple[str, ...] = (),
    progress: Progress = lambda done: None,
) -> UnbalanceResponse:
    """Return the unbalance response of a rotor at several speeds.

    Parameters
    ----------
    model : Model
    point : str
        A body or a point of a body, such as ``rotor.disk``.
    parameter : str
        The angular velocity of the body; it is set to each of the speeds.
    speeds : ndarray, shape (n,)
        Positive (rad/s).
    goals : tuple of str
        Outputs; all if none.
    progress : callable, optional
        Called with the fraction of the work that is done, from 0 to 1.

    Raises
    ------
    UsageError
        If there is no such point, parameter or output, or the parameter is not the spin of the body.
    NumericalError
        If there is no linear model with constant coefficients on the ground.
    """
    if not model.outputs:
        raise UsageError("the model declares no outputs\nhint: add the section outputs: to the file")
    body, _, own = point.partition(".")
    number = number_of(body, tuple(model.bodies), "body", "bodies")
    points = tuple(model.bodies[body].values.get("points") or ())
    if own:
        number_of(own, points, f"point of {body!r}", "its points")
    found = []
    for k, speed in enumerate(speeds.tolist()):
        forced = _forced(bound(model, settings_in_si({parameter: speed})), number, own, parameter, speed)
        found.append(_amplitudes(forced, goals, speed))
        progress(k / len(speeds))
    outputs = goals or tuple(model.outputs)
    units = dict(zip(forced.outputs, forced.output_units, strict=True))
    return UnbalanceResponse(
        point, parameter, speeds, outputs, tuple(f"{units[x]}/(kg*m)" if units[x] else "" for x in outputs),
        np.array(found, dtype=complex).T, _verdicts(model, parameter, speeds),
    )  # fmt: skip


def _verdicts(model: Model, parameter: str, speeds: Array) -> tuple[str, ...]:
    """Return the verdicts of the motion at all speeds at once, as sweeps find them; each speed is solved by itself."""
    plain = replace(model, inputs={}, outputs={})
    raw = merged([compute(task) for task in tasks(plain, {parameter: speeds}, followed=False)])
    words = [WORDS[word] for word in raw.words]
    for k, word in enumerate(words):
        if word == UNDECIDED:
            here = bound(plain, settings_in_si({parameter: float(speeds[k])}))
            words[k] = eigenvalues(linearize(system := System(evaluate(here)), reference_motion(system, True))).verdict
    return tuple(words)


def _axis(system: System, motion: Motion, body: int, parameter: str, speed: float) -> Array:
    """Return the direction of the spin of a body, which must have a speed."""
    spin = Attitudes.of(system).spins(system, motion.q, motion.u)[body]
    size = float(np.linalg.norm(spin))
    if abs(size - speed) > SPECTRUM.rotor_still * speed:
        name = list(system.scene.model.bodies)[body]
        raise UsageError(
            f"with {parameter} = {speed:g} rad/s {name!r} spins with {size:g} rad/s\n"
            "hint: --speed names the parameter that is the rate of the body about its axis"
        )
    return np.asarray(spin / size)


def _forced(model: Model, body: int, point: str, parameter: str, speed: float) -> ControlModel:
    """Return the linear model from forces along both directions across the axis at a point of a body."""
    plain = System(evaluate(replace(model, inputs={}, outputs={})))
    motion = reference_motion(plain, massless=True)
    axis = _axis(plain, motion, body, parameter, speed)
    entry = list(model.bodies.values())[body]
    evaluator = Evaluator(model, plain.scene.parameters, plain.scene.arithmetic)
    place = evaluator.vector(entry.values["points"][point]) if point else (0.0,) * model.dimension

    def force(direction: Array) -> Kind:
        use = ElementUse("ground_force", (body,), place, tuple(direction[: model.dimension]))
        return Kind("force", "", (2, 3), (), lambda item: (use,))

    inputs = {
        name: Entry("inputs", name, force(direction), {}, model.reference.location, {})
        for name, direction in zip(NAMES, _directions(axis), strict=True)
    }
    linear = linearize(System(evaluate(replace(model, inputs=inputs))), motion)
    if linear.generator is not None and linear.generator.turns:
        raise NumericalError(
            f"the equations are constant only in a turning frame ({linear.generator}), where an unbalance is a load at "
            "rest\nhint: leave out reference: steady: where the rotor and its bearings are round"
        )
    return control_model(linear)


def _directions(axis: Array) -> tuple[Array, Array]:
    """Return e₁ and e₂."""
    along = np.eye(3)[(int(np.argmax(np.abs(axis))) + 1) % 3]
    first = along - (along @ axis) * axis
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


def _amplitudes(model: ControlModel, goals: tuple[str, ...], speed: float) -> list[complex]:
    """Return z of the module's text for each output."""
    exact = FrequencyResponse(model)
    values = exact.value(1j * speed)
    both = [[values[exact.number(c)] for c in channels(model, (name,), goals)] for name in NAMES]
    with np.errstate(invalid="ignore"):  # on an eigenvalue without damping
        found = [complex(speed**2 * (one - 1j * other)) for one, other in zip(*both, strict=True)]
    return [z if np.isfinite(z) else complex(np.inf) for z in found]
