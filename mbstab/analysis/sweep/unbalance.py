"""Unbalance responses of rotors: how outputs answer to a small mass beside the spin axis.

A mass m at the distance e from the axis turns with the spin Ω and acts as the force m e Ω² (e₁ cos Ωt + e₂ sin Ωt) at
a point of the body. e₁ is the ground axis that follows the one nearest to the spin (x for a spin about z), made
perpendicular to it; e₁, e₂ and the spin are right-handed. An output with the transfer functions G₁ and G₂ from forces
along e₁ and e₂ is then Re(z exp(iΩt)), z = m e Ω² (G₁(iΩ) - i G₂(iΩ)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.state_space import ControlModel, control_model
from mbstab.analysis.response.transfer import number_of
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.analysis.sweep.approaches import approaches
from mbstab.analysis.sweep.batched_spectra import Evaluator as Spectra
from mbstab.analysis.sweep.blocks import Block, Progress, compute, merged, tasks
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import UNDECIDED, WORDS
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.mechanics.catalogue import ElementUse, Kind
from mbstab.model.evaluator import Evaluator
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Entry, Model
from mbstab.model.units import is_angular_velocity
from mbstab.model.values import evaluate
from mbstab.model.words import UNSTABLE
from mbstab.records import Answer, dataclass

NAMES = ("unbalance along e1", "unbalance along e2")
"""Names of the two forces, which no input of a file can have."""


@dataclass(frozen=True)
class Peak:
    """The largest amplitude of an output over the spins of a range, also between those that were asked for.

    Attributes
    ----------
    speed : float (rad/s)
    value : complex
        z of the module's text; nan without a finite value.
    inside : bool
        Whether amplitudes are smaller on both sides; if not, it stands at an end of the range.
    bounded : bool
        Whether a largest amplitude was found; if not, it grows on and on towards the speed, a critical speed without
        damping.
    """

    speed: float
    value: complex
    inside: bool
    bounded: bool


@dataclass(frozen=True)
class UnbalanceResponse(Answer):
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
    peaks : tuple of Peak
        The largest of each output, and …
    further : tuple of tuple of Peak
        … its other peaks that are at least `TOLERANCES.share_of_peak` of it, in the order of the speeds.
    between : callable, optional
        Returns the values of the outputs at any other speed (rad/s), for smooth curves.
    """

    point: str
    parameter: str
    speeds: Array
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    values: Complex
    verdicts: tuple[str, ...]
    peaks: tuple[Peak, ...]
    further: tuple[tuple[Peak, ...], ...]
    between: Callable[[float], list[complex]] | None = field(default=None, repr=False, compare=False)

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
    outputs, units = goals or tuple(model.outputs), dict[str, str]()

    forced_at = partial(_forced_at, model, number, own, parameter)

    def answer(speed: float, sure: bool = False) -> list[complex]:
        forced = forced_at(speed)
        units.update(zip(forced.outputs, forced.output_units, strict=True))
        return _amplitudes(forced, outputs, speed, sure)

    found = list[list[complex]]()
    for speed in speeds.tolist():
        progress(len(found) / len(speeds))
        found.append(answer(speed))
    plain = replace(model, inputs={}, outputs={})  # each speed is solved by itself, here as above
    spectra, values = merged([compute(x) for x in tasks(plain, {parameter: speeds})]), np.array(found, dtype=complex).T
    return UnbalanceResponse(
        point, parameter, speeds, outputs, tuple(f"{units[x]}/(kg*m)" if units[x] else "" for x in outputs), values,
        _verdicts(plain, parameter, speeds, spectra),
        *_peaks(speeds, values, _resonances(plain, parameter, speeds, spectra.values), partial(answer, sure=True),
                partial(_undamped, plain, parameter)),
        between=partial(_between, forced_at, outputs),
    )  # fmt: skip


def _verdicts(model: Model, parameter: str, speeds: Array, spectra: Block) -> tuple[str, ...]:
    """Return the verdicts at all speeds; those that the bounds for many points do not decide one by one."""
    words = [WORDS[word] for word in spectra.words]
    for k, word in enumerate(words):
        if word == UNDECIDED:
            words[k] = eigenvalues(_linear(bound(model, settings_in_si({parameter: float(speeds[k])})))).verdict
    return tuple(words)


def _undamped(model: Model, parameter: str, speed: float) -> float | None:
    """Return the frequency of the eigenvalue nearest to iΩ if it may be without damping; None if it is damped."""
    found = eigenvalues(_linear(bound(model, settings_in_si({parameter: speed})))).eigenvalues
    near = min(found, key=lambda e: abs(e.value - 1j * speed))
    return float(near.value.imag) if abs(near.value.real) <= near.error_bound else None


def _linear(model: Model) -> Linearization:
    system = System(evaluate(model))
    return linearize(system, reference_motion(system, massless=True))


def _peaks(
    speeds: Array,
    values: Complex,
    resonances: list[float],
    answer: Callable[[float], list[complex]],
    undamped: Callable[[float], float | None],
) -> tuple[tuple[Peak, ...], tuple[tuple[Peak, ...], ...]]:
    """Return the largest peak of each output, and its other ones.

    Beside the speeds themselves, those of resonances are looked at, which may be much narrower than the steps between
    the speeds, and one between any two of these. All peaks are refined between their neighbours before they are
    compared.
    """
    known = dict(zip(speeds.tolist(), values.T.tolist(), strict=True))
    places = sorted({*known, *resonances})
    places += [0.5 * (a + b) for a, b in pairwise(places) if a in resonances and b in resonances]
    known |= {x: answer(x) for x in places if x not in known}

    def size(speed: float, output: int) -> float:
        if speed not in known:
            known[speed] = answer(speed)
        return float(abs(known[speed][output]))

    def peak(output: int, x: list[float], i: int) -> Peak:
        best, largest = x[i], size(x[i], output)
        beside = max((size(y, output) for y in x[max(i - 1, 0) : i + 2] if y != best), default=largest)
        inside = 0 < i < len(x) - 1 and beside < largest
        if inside and np.isfinite(largest):
            best = _refined(partial(size, output=output), x[i - 1 : i + 2])
        critical = undamped(best) if size(best, output) > TOLERANCES.high_peak * beside else None
        if critical is not None or not np.isfinite(largest):
            return Peak(best if critical is None else critical, complex(np.nan, np.nan), inside, bounded=False)
        return Peak(best, known[best][output], inside, bounded=True)

    def height(found: Peak) -> float:
        return float(abs(found.value)) if found.bounded else np.inf

    grid, largest, further = sorted(known), list[Peak](), list[tuple[Peak, ...]]()
    for k in range(len(values)):
        sizes = np.array([size(x, k) for x in grid])
        first = int(np.argmax(sizes))
        tops = np.flatnonzero((sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] >= sizes[2:])) + 1
        finite = sizes[np.isfinite(sizes) & (np.arange(len(grid)) != first)]
        least = TOLERANCES.share_of_peak * (sizes[first] if np.isfinite(sizes[first]) else np.max(finite, initial=0.0))
        found = [peak(k, grid, i) for i in sorted({first, *tops[sizes[tops] >= least].tolist()})]
        largest.append(max(found, key=height))
        others = [x for x in found if x is not largest[-1] and x.inside]
        bounded = max((height(x) for x in found if x.bounded), default=0.0)
        further.append(tuple(x for x in others if height(x) >= TOLERANCES.share_of_peak * bounded))
    return tuple(largest), tuple(further)


def _resonances(model: Model, parameter: str, speeds: Array, branches: Complex) -> list[float]:
    """Return where the frequency of a branch is the spin or next to it, for resonances narrow beside the steps."""
    if len(speeds) < 2:
        return []
    order = np.argsort(speeds)
    x, found = speeds[order], set[float]()
    for a in approaches(Spectra(model), parameter, x, branches[order], 1.0):
        step = np.diff(x)[np.clip(np.searchsorted(x, a.x[0], side="right") - 1, 0, len(x) - 2)]
        if not np.min(np.abs(a.values.real)) < TOLERANCES.narrow_resonance * step:
            continue
        gaps = a.values.imag - a.x
        if a.crosses:
            found.add(float(a.x[0] - gaps[0] * (a.x[1] - a.x[0]) / (gaps[1] - gaps[0])))
        else:
            found.add(float(a.x[np.argmin(np.abs(gaps))]))
    apart = list[float]()
    for speed in sorted(found):
        if not apart or speed - apart[-1] > TOLERANCES.peak_speed * speed:
            apart.append(speed)
    return apart


def _refined(size: Callable[[float], float], bracket: list[float]) -> float:
    """Return where an amplitude is largest, between two speeds with a better one in between.

    The inverse square of the amplitude is nearly a parabola at a resonance.
    """
    from scipy.optimize import minimize_scalar

    def goal(speed: float) -> float:
        here = size(min(max(float(speed), bracket[0]), bracket[2]))
        return 1.0 / here**2 if here > 0.0 else np.inf

    options = {"xtol": TOLERANCES.peak_speed, "maxiter": TOLERANCES.peak_steps}
    return float(minimize_scalar(goal, bracket=tuple(bracket), method="brent", options=options).x)


def _axis(system: System, motion: Motion, body: int, parameter: str, speed: float) -> Array:
    """Return the direction of the spin of a body, which must have a speed."""
    spin = Attitudes.of(system).spins(system, motion.q, motion.u)[body]
    size = float(np.linalg.norm(spin))
    if abs(size - speed) > SPECTRUM.rotor_still * speed:
        model = system.scene.model
        name, own = list(model.bodies)[body], model.parameters[parameter]
        unit, factor = (own.unit, own.factor) if is_angular_velocity(own.unit) else ("rad/s", 1.0)
        raise UsageError(
            f"with {parameter} = {speed / factor:g} {unit} {name!r} spins with {size / factor:g} {unit}\n"
            "hint: --speed names the parameter that is the rate of the body about its axis; where spools turn at a "
            "ratio, let it be the speed of this one, and give that of the other as a multiple of it"
        )
    return np.asarray(spin / size)


def _between(forced_at: Callable[[float], ControlModel], outputs: tuple[str, ...], speed: float) -> list[complex]:
    return _amplitudes(forced_at(speed), outputs, speed, False)


def _forced_at(model: Model, body: int, point: str, parameter: str, speed: float) -> ControlModel:
    """Return what `_forced` does, with the spin set to a speed (rad/s)."""
    return _forced(bound(model, settings_in_si({parameter: speed})), body, point, parameter, speed)


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


def _amplitudes(model: ControlModel, goals: tuple[str, ...], speed: float, sure: bool) -> list[complex]:
    """Return z of the module's text for each output; if only what is `sure` counts, 0 where rounding may have made it.

    Rounding does so beside an eigenvalue without damping whose motion the unbalance does not reach.
    """
    exact = FrequencyResponse(model)
    values, errors, _ = exact.at(1j * speed) if sure else (exact.value(1j * speed), None, None)
    found = []
    for goal in goals:
        row = number_of(goal, model.outputs, "output", "outputs of the file")
        one, other = ((row, model.inputs.index(name)) for name in NAMES)
        with np.errstate(invalid="ignore"):  # on an eigenvalue without damping
            z = complex(speed**2 * (values[one] - 1j * values[other]))
        if errors is not None and not speed**2 * (errors[one] + errors[other]) <= TOLERANCES.sure_peak * abs(z):
            z = 0j
        found.append(z if np.isfinite(z) else complex(np.inf))
    return found
