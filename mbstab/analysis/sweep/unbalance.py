"""Unbalance responses of rotors: how outputs answer to small masses beside the spin axis.

A mass m at the distance e from the axis turns with the spin Ω and acts as the force m e Ω² (e₁ cos Ωt + e₂ sin Ωt) at
a point of the body; the force passes through the spin axis, so of a point beside it the foot on the axis counts. e₁ is
the ground axis that follows the one nearest to the spin (x for a spin about z), made perpendicular to it; e₁, e₂ and
the spin are right-handed. An output with the transfer functions G₁ and G₂ from forces along e₁ and e₂ is then
Re(z exp(iΩt)), z = Ω² Σ m e exp(iφ) (G₁(iΩ) - i G₂(iΩ)), where an unbalance leads e₁ by φ.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, replace
from functools import partial

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.motion import Motion
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.response.descriptor import Unreduced
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.state_space import unreduced
from mbstab.analysis.response.transfer import number_of
from mbstab.analysis.spectrum.eigenvalues import eigenvalues
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.analysis.sweep.blocks import Block, Progress, compute, merged, tasks
from mbstab.analysis.sweep.synchronous import Bordered, Pole, Synchronous
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.analysis.verdict.rule import UNDECIDED, WORDS
from mbstab.compiler.system import Array, System
from mbstab.errors import NumericalError, UsageError
from mbstab.mechanics.catalogue import ElementUse, Kind
from mbstab.model.arithmetic import FLOAT
from mbstab.model.dependencies import equations_of, expressions_in
from mbstab.model.evaluator import Evaluator
from mbstab.model.expressions import Call, ExpressionError, parse
from mbstab.model.functions import TABLE
from mbstab.model.parameters import bound, settings_in_si, with_unit
from mbstab.model.schema import Entry, Model
from mbstab.model.units import is_angular_velocity, parse_unit
from mbstab.model.values import evaluate
from mbstab.model.words import UNSTABLE
from mbstab.records import Answer, dataclass


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
    error : float (rad/s)
        Bound of the error of a critical speed without damping, towards which the amplitude grows on and on; nan if a
        largest amplitude was found.
    """

    speed: float
    value: complex
    inside: bool
    error: float = np.nan

    @property
    def bounded(self) -> bool:
        """Whether a largest amplitude was found."""
        return math.isnan(self.error)


@dataclass(frozen=True)
class UnbalanceResponse(Answer):
    """Amplitudes of outputs over the spin.

    Attributes
    ----------
    unbalances : dict
        m e exp(iφ) (kg m) by its place: a body, or a point of a body.
    relative : bool
        Whether amplitudes are those for 1 kg m.
    parameter : str
        The parameter that is the spin.
    speeds : ndarray, shape (n,)
        Angular velocities (rad/s).
    outputs, units : tuple of str
        Names, and units, ``m/(kg*m)`` where the answer is that to 1 kg m, empty where they are not known.
    values : ndarray of complex, shape (outputs, n)
        z of the module's text; its phase is relative to the unbalance. Infinite at an undamped critical speed.
    verdicts : tuple of str
        Of the motion without unbalance at each speed. Where it is unstable, no rotor answers like this.
    peaks : tuple of Peak
        The largest of each output, or the first critical speed without damping, and …
    further : tuple of tuple of Peak
        … its other critical speeds and peaks that are at least `TOLERANCES.share_of_peak` of the largest, in the order
        of the speeds.
    between : callable, optional
        Returns the values of the outputs, shape (outputs, n), at any other speeds (rad/s), for smooth curves.
    """

    unbalances: dict[str, complex]
    relative: bool
    parameter: str
    speeds: Array
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    values: Complex
    verdicts: tuple[str, ...]
    peaks: tuple[Peak, ...]
    further: tuple[tuple[Peak, ...], ...]
    between: Callable[[Array], Complex] | None = field(default=None, repr=False, compare=False)

    @property
    def point(self) -> str:
        """The places of the unbalances."""
        return ", ".join(self.unbalances)

    @property
    def unstable(self) -> Array:
        """Where the motion without unbalance is unstable, shape (n,)."""
        return np.array([verdict == UNSTABLE for verdict in self.verdicts])


def unbalance(
    model: Model,
    at: str | Mapping[str, complex],
    parameter: str,
    speeds: Array,
    goals: tuple[str, ...] = (),
    progress: Progress = lambda done: None,
) -> UnbalanceResponse:
    """Return the unbalance response of a rotor at several speeds.

    Parameters
    ----------
    model : Model
    at : str or dict
        A body or a point of a body, such as ``rotor.disk``, with an unbalance of 1 kg m; or m e exp(iφ) (kg m) by such
        places.
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
    unbalances = {at: 1.0 + 0.0j} if isinstance(at, str) else {place: complex(x) for place, x in at.items()}
    _require_places(model, unbalances)
    outputs, units = goals or tuple(model.outputs), dict[str, str]()

    def equations(speed: float) -> Bordered:
        exact = FrequencyResponse(_forced(model, unbalances, parameter, speed))
        units.update(zip(exact.model.outputs, exact.model.output_units, strict=True))
        return _bordered(exact, speed, unbalances, outputs)

    ascending = np.unique(speeds)
    rotor = Synchronous(equations, ascending if _may_bend(model) else ascending[[0, -1]])
    progress(0.5)
    plain = replace(model, inputs={}, outputs={})  # each speed is solved by itself, here as above
    spectra = merged([compute(x) for x in tasks(plain, {parameter: speeds})])
    verdicts = _verdicts(plain, parameter, speeds, spectra)
    poles, damped = rotor.resonances()
    between = partial(_amplitudes, rotor, poles)
    relative, values = isinstance(at, str), between(speeds)
    per = "/(kg*m)" * relative
    return UnbalanceResponse(
        unbalances, relative, parameter, speeds, outputs, tuple(units[x] and units[x] + per for x in outputs), values,
        verdicts, *_peaks(speeds, poles, damped, between), between=between,
    )  # fmt: skip


def _require_places(model: Model, places: Iterable[str]) -> None:
    if not model.outputs:
        raise UsageError("the model declares no outputs\nhint: add the section outputs: to the file")
    for place in places:
        body, _, own = place.partition(".")
        number_of(body, tuple(model.bodies), "body", "bodies")
        if own:
            number_of(own, tuple(model.bodies[body].values.get("points") or ()), f"point of {body!r}", "its points")


def _bordered(
    exact: FrequencyResponse, speed: float, unbalances: Mapping[str, complex], outputs: tuple[str, ...]
) -> Bordered:
    """Return the equations from unbalances, each of which is a pair of forces, along e₁ and along e₂, to outputs."""
    whole, n = exact.bordered(1j * speed), len(exact.B)
    chosen = np.array([number_of(x, exact.model.outputs, "output", "outputs of the file") for x in outputs])
    turning = whole[:, n:] @ np.array([(x, -1j * x) for x in unbalances.values()]).ravel()
    matrix = np.column_stack([whole[:, :n], turning])[np.concatenate([np.arange(n), n + chosen])]
    return Bordered(matrix, np.any(exact.responds[chosen], axis=1), lambda: exact.entry_errors(speed))


def _may_bend(model: Model) -> bool:
    """Return whether the equations contain a table or a function that is not analytic everywhere."""
    found = expressions_in([equations_of(model), model.parameters])
    calls = {node.function for expression in found for node in expression.walk() if isinstance(node, Call)}
    return any(TABLE[name].breaks or TABLE[name].knots >= 0 for name in calls)


def read_unbalances(texts: tuple[str, ...]) -> str | dict[str, complex]:
    """Return the unbalances of texts such as ``disk``, or ``disk.rim=2e-5@90`` (kg m, degrees), as `unbalance` takes.

    Raises
    ------
    UsageError
        If a text is not of this form, or only one of several unbalances may have no size.
    """
    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    found = dict[str, complex]()
    for text in texts:
        place, _, size = text.partition("=")
        amount, _, phase = size.partition("@")
        try:
            z = _number(amount, "kg*m") * cmath.exp(1j * _number(phase or "0", "deg"))
        except ExpressionError as error:
            raise UsageError(
                f"--unbalance {text}: {error.message}\nhint: several unbalances, or one with a size, are written "
                "POINT=SIZE@PHASE in kg*m and degrees, such as disk.rim=2e-5@90"
            ) from None
        found[place] = found.get(place, 0.0) + z
    return found


def _number(text: str, own: str) -> float:
    """Return a number in SI that counts in a unit of its own, if none stands behind it."""
    try:
        number, unit = parse(text), own
    except ExpressionError:
        if (parts := with_unit(text.strip(), ())) is None:
            raise
        number, unit = parts
    factor, dimension = parse_unit(unit)
    if dimension != parse_unit(own)[1]:
        raise ExpressionError(f"{unit} is not a unit like {own}")
    return float(number.evaluate({}, FLOAT)) * factor


def _verdicts(model: Model, parameter: str, speeds: Array, spectra: Block) -> tuple[str, ...]:
    """Return the verdicts at all speeds; those that the bounds for many points do not decide one by one."""
    words = [WORDS[word] for word in spectra.words]
    for k, word in enumerate(words):
        if word == UNDECIDED:
            words[k] = eigenvalues(_linear(bound(model, settings_in_si({parameter: float(speeds[k])})))).verdict
    return tuple(words)


def _linear(model: Model) -> Linearization:
    system = System(evaluate(model))
    return linearize(system, reference_motion(system, massless=True))


def _amplitudes(rotor: Synchronous, poles: list[Pole], speeds: Array) -> Complex:
    """Return z of the module's text, shape (outputs, speeds); infinite at critical speeds without damping.

    An output that does not answer to what is undamped there has the mean of its values around it.
    """
    with np.errstate(invalid="ignore"):  # where P is exactly singular
        values = speeds**2 * rotor.values(speeds)
    for pole in poles:
        near = np.abs(speeds - pole.speed) <= max(pole.error, TOLERANCES.peak_speed * pole.speed)
        if np.any(near):
            values[np.ix_(~pole.reached, near)] = speeds[near] ** 2 * pole.means(speeds[near])[~pole.reached]
        values[np.ix_(pole.reached, np.abs(speeds - pole.speed) <= pole.error)] = np.inf
    return values


def _peaks(
    speeds: Array, poles: list[Pole], damped: Complex, between: Callable[[Array], Complex]
) -> tuple[tuple[Peak, ...], tuple[tuple[Peak, ...], ...]]:
    """Return the largest peak of each output, and its other ones.

    Beside the speeds themselves, those next to poles are looked at, which may be much narrower than the steps between
    the speeds. All peaks are refined between their neighbours before they are compared.
    """
    x = _places(speeds, poles, damped)
    sizes, brackets, found = np.abs(between(x)), list[tuple[int, Array]](), list[list[Peak]]()
    for k, own in enumerate(sizes):
        tops = 1 + np.flatnonzero((own[1:-1] > own[:-2]) & (own[1:-1] >= own[2:]) & np.isfinite(own[1:-1]))
        least = TOLERANCES.share_of_peak * np.max(own[tops], initial=0.0)
        brackets += [(k, x[i - 1 : i + 2]) for i in tops[own[tops] >= least]]
        nothing = complex(np.nan, np.nan)
        found.append([Peak(p.speed, nothing, x[0] < p.speed < x[-1], p.error) for p in poles if p.reached[k]])
    outputs, places = np.array([k for k, _ in brackets], dtype=int), _refined(between, brackets)
    for k, z, own in zip(outputs.tolist(), places.tolist(), between(places).T, strict=True):
        found[k].append(Peak(z, complex(own[k]), inside=True))
    largest, further = list[Peak](), list[tuple[Peak, ...]]()
    for k, own in enumerate(sizes):
        i = int(np.argmax(own))
        if i in (0, len(x) - 1) and np.isfinite(own[i]):
            found[k].append(Peak(float(x[i]), complex(between(x[i : i + 1])[k, 0]), inside=False))
        largest.append(max(found[k], key=_height))
        least = TOLERANCES.share_of_peak * max((_height(y) for y in found[k] if y.bounded), default=0.0)
        others = (y for y in found[k] if y is not largest[-1] and y.inside and _height(y) >= least)
        further.append(tuple(sorted(others, key=lambda y: y.speed)))
    return tuple(largest), tuple(further)


def _height(peak: Peak) -> float:
    return float(abs(peak.value)) if peak.bounded else np.inf


def _places(speeds: Array, poles: list[Pole], damped: Complex) -> Array:
    """Return speeds, ascending, between which no output has more than one peak."""
    ends = float(np.min(speeds)), float(np.max(speeds))
    centres = np.unique([*(pole.speed for pole in poles), *damped.real, *ends])
    beside = [damped.real + sign * np.abs(damped.imag) for sign in (-1.0, 1.0)]
    between = 0.5 * (centres[1:] + centres[:-1])
    x = np.unique([*centres, *between, *np.concatenate(beside), *speeds, *np.linspace(*ends, TOLERANCES.peak_places)])
    x = x[(x >= ends[0]) & (x <= ends[1])]
    for pole in poles:
        reach = 2.0 * max(pole.error, TOLERANCES.peak_speed * pole.speed)
        x = x[(np.abs(x - pole.speed) > reach) | (x == pole.speed)]
    return x


def _refined(between: Callable[[Array], Complex], brackets: list[tuple[int, Array]]) -> Array:
    """Return where amplitudes of outputs are largest, each between two speeds with a better one in between.

    The inverse square of an amplitude is nearly a parabola at a resonance. Its vertex and two speeds about it are
    looked at together with the bracket, until that is narrow.
    """
    x = np.array([y for _, y in brackets]).reshape(-1, 3)
    outputs = np.array([k for k, _ in brackets], dtype=int)[:, None]

    def inverse(at: Array) -> Array:
        values = between(at.ravel()).reshape(-1, *at.shape)
        return np.asarray(np.abs(np.take_along_axis(values, outputs[None], axis=0)[0]) ** -2.0)

    with np.errstate(all="ignore"):
        y = inverse(x) if len(x) else x
        for _ in range(TOLERANCES.peak_steps):
            width = x[:, -1] - x[:, 0]
            if np.all(width <= TOLERANCES.peak_speed * x[:, 1]):
                break
            slopes = np.diff(y) / np.diff(x)
            vertex = 0.5 * (x[:, 0] + x[:, 1] - slopes[:, 0] * width / (slopes[:, 1] - slopes[:, 0]))
            vertex = np.where(np.isfinite(vertex), vertex, x[:, 1])
            step = width / 16.0
            vertex = np.clip(vertex, x[:, 0] + 1.5 * step, x[:, 2] - 1.5 * step)
            more = vertex[:, None] + step[:, None] * np.array([-1.0, 0.0, 1.0])
            x, y = np.hstack([x, more]), np.hstack([y, inverse(more)])
            order = np.argsort(x, axis=1)
            x, y = np.take_along_axis(x, order, axis=1), np.take_along_axis(y, order, axis=1)
            best = np.clip(np.argmin(y, axis=1), 1, 4)[:, None] + np.arange(-1, 2)
            x, y = np.take_along_axis(x, best, axis=1), np.take_along_axis(y, best, axis=1)
    return x[:, 1]


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


def _forced(model: Model, unbalances: Mapping[str, complex], parameter: str, speed: float) -> Unreduced:
    """Return the linear model at a spin (rad/s), from forces along both directions across the axis at each place."""
    model = bound(model, settings_in_si({parameter: speed}))
    plain = System(evaluate(replace(model, inputs={}, outputs={})))
    motion = reference_motion(plain, massless=True)
    evaluator = Evaluator(model, plain.scene.parameters, plain.scene.arithmetic)
    inputs = dict[str, Entry]()
    for place in unbalances:
        name, _, point = place.partition(".")
        body = list(model.bodies).index(name)
        points = model.bodies[name].values["points"] if point else {}
        place_in_body = evaluator.vector(points[point]) if point else (0.0,) * model.dimension
        axis = _axis(plain, motion, body, parameter, speed)
        at = _foot(plain, motion, body, np.array(place_in_body, dtype=float), speed * axis)
        for k, direction in enumerate(_directions(axis), start=1):
            use = ElementUse("ground_force", (body,), tuple(at), tuple(direction[: model.dimension]))
            kind = Kind("force", "", (2, 3), (), lambda item, use=use: (use,))  # type: ignore[misc]
            own = f"unbalance of {place} along e{k}"  # which no input of a file can be called
            inputs[own] = Entry("inputs", own, kind, {}, model.reference.location, {})
    linear = linearize(System(evaluate(replace(model, inputs=inputs))), motion)
    if linear.generator is not None and linear.generator.turns:
        raise NumericalError(
            f"the equations are constant only in a turning frame ({linear.generator}), where an unbalance is a load at "
            "rest\nhint: leave out reference: steady: where the rotor and its bearings are round"
        )
    return unreduced(linear)


def _foot(system: System, motion: Motion, body: int, at: Array, spin: Array) -> Array:
    """Return the foot of a point on the axis about which a body turns, in axes of the body."""
    d = len(at)
    turned = Attitudes.of(system).orientations(system, motion.q)[body]
    places = np.arange(d) + system.body_slices[body].start
    arm, velocity = np.zeros(3), np.zeros(3)
    arm[:d], velocity[:d] = turned @ at, motion.u[places]
    velocity += np.cross(spin, arm)
    beside = -np.cross(spin, velocity) / (spin @ spin)
    if np.max(np.abs(beside)) <= TOLERANCES.on_axis * np.max(motion.sizes[places]):
        return at
    return np.asarray(at - turned.T @ beside[:d])


def _directions(axis: Array) -> tuple[Array, Array]:
    """Return e₁ and e₂."""
    along = np.eye(3)[(int(np.argmax(np.abs(axis))) + 1) % 3]
    first = along - (along @ axis) * axis
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)
