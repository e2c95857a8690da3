"""From the definition of an element to every derivative the analyses need.

With F the residual of the equations of motion, F = d/dt ∂T/∂u − ∂T/∂q − Q + Jᵀν, each
element adds to

* ``dynamics``: M = ∂F/∂a and F at a = 0 (inertia), F (force), the residual E of the rows,
  their velocity residual V, their Jacobian J = ∂V/∂u and the part B of their acceleration
  that does not contain a (constraints);
* ``linearize``: K = ∂F/∂q and R = ∂F/∂u at fixed a and ν; for nonholonomic rows also D_q;
* ``linearize_rows`` (constraints only): V_q = ∂V/∂q, A_q = ∂A/∂q and A_u = ∂A/∂u at fixed a,
  with A = J a + B the acceleration residual of the rows.

Where there is a potential, of gravity or of a spring, ``potential`` gives it. A force that comes from a potential and a
dissipation function only, names the parameters that are the coefficients of the latter.

For a holonomic row V = dC/dt, A = d²C/dt² and J = C_q; for a nonholonomic one E = V = D,
A = dD/dt and J = D_u. Given functions of time enter as s with their derivatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from types import SimpleNamespace
from typing import Any, Protocol

from mbstab.compiler.tape import Tape, Term
from mbstab.mechanics.bodies import TENSOR_SIZE
from mbstab.mechanics.catalogue import COORDINATES, DIMENSIONS, Element, Load
from mbstab.mechanics.frames import Column, Frame, combined
from mbstab.records import dataclass

Entries = dict[tuple[int, ...], Term]


@dataclass(frozen=True)
class Derived:
    """The functions of a kernel: names of their inputs, the steps, and the non-zero entries of their outputs.

    `damping` is None, or numbers of parameters in which the dissipation function of a force is linear: it vanishes with
    them, and the force has no other part than this and that of the potential.
    """

    inputs: dict[str, list[str]]
    tape: Tape
    dynamics: dict[str, Entries]
    linearize: dict[str, Entries]
    linearize_rows: dict[str, Entries] = field(default_factory=dict)
    potential: dict[str, Entries] = field(default_factory=dict)
    damping: tuple[int, ...] | None = None


def parameter_sizes(element: Element, frame: str) -> list[tuple[str, int]]:
    """Return names and sizes of the parameters of an element in a frame."""
    sizes = {0: DIMENSIONS[frame], TENSOR_SIZE: 1 if frame == "planar" else 6}
    return [(name, sizes.get(size, size)) for name, size in element.parameters]


class Given(Protocol):
    """Parameters of an element that are expressions, and what these contain.

    Attributes
    ----------
    coordinates : int
        How many coordinates and measures they contain; their names are q0, q1, …, those of their rates u0, ….
    numbers : int
        How many numbers; their names are p0, p1, ….
    """

    coordinates: int
    numbers: int

    def terms(self, motion: Moving, time: str) -> dict[int, Term]:
        """Return the expressions by the number of the parameter, base rotations not counted."""


def derive(element: Element, frame: str, given: Given | None = None) -> Derived:
    """Derive everything a kernel returns from the definition of an element.

    Parameters
    ----------
    element : Element
    frame : str
        One of `Element.frames`.
    given : Given, optional
        Parameters that are expressions. What they contain follows the coordinates and parameters of the element, and
        the time its given functions.
    """
    tape = Tape()
    kinds = element.slot_kinds(frame)
    names = [[f"{name}{number}" for name in COORDINATES[kind]] for number, kind in enumerate(kinds, 1)]
    q = [name for own in names for name in own]
    u, a = ([f"{name}_{dots}" for name in q] for dots in ("t", "tt"))
    signals = [f"s{i + 1}" for i in range(element.signals)]
    terms: dict[int, Term] = {}
    if given is not None:
        signals.append(f"s{element.signals + 1}")
        for every, letter in ((q, "q"), (u, "u"), (a, "a")):
            every += [f"{letter}{i}" for i in range(given.coordinates)]
    motion = Moving(tape, q, u, signals)
    if given is not None:
        terms = given.terms(motion, signals[-1])
    spatial = frame == "spatial"
    bases = [[f"base{number}_{i}{j}" for i in "123" for j in "123"] for number in range(1, spatial * element.slots + 1)]
    rotations = [tape.rotation(base) for base in bases]
    parameters = [x for base in bases for x in base]
    p, count = SimpleNamespace(), 0
    for name, size in parameter_sizes(element, frame):
        own = [f"{name}_{i + 1}" if size > 1 else name for i in range(size)]
        parameters += [x for i, x in enumerate(own, count) if i not in terms]
        setattr(p, name, Column(terms[i] if i in terms else tape.input(x) for i, x in enumerate(own, count)))
        count += size
    parameters += [f"p{i}" for i in range(given.numbers if given else 0)]

    def defined(at_rest: bool = False) -> Any:
        frames = [
            motion.frame(own, DIMENSIONS[kind], rotations[i] if kind == "spatial" else [], at_rest)
            for i, (kind, own) in enumerate(zip(kinds, names, strict=True))
        ]
        return element.define(frames, p, Column(map(tape.input, signals[: element.signals])))

    definition = defined()
    if (
        given is not None
        and element.role != "nonholonomic"
        and not (isinstance(definition, Load) and definition.potential == definition.dissipation == 0)
    ):
        raise ValueError("what has a potential has no parameters that change with the motion")
    derived = differentiate(tape, element.role, definition, motion, a, signals, parameters)
    if element.measured:
        rates, first = derived.linearize_rows, {key: derived.dynamics[key] for key in "EVJ"}
        linearize = {**first, "K": derived.linearize["K"], "V_q": rates["V_q"]}
        return replace(derived, linearize=linearize, linearize_rows={**derived.dynamics, **rates})
    # Derived last: the text of the other functions depends on the order of their steps.
    if element.role == "inertia":
        return replace(derived, potential=_potential(-defined(at_rest=True)))
    damping: tuple[int, ...] | None = None
    if isinstance(definition, Load) and not definition.power:
        damping = _coefficients(tape, tape.term(definition.dissipation), parameters)
    return replace(with_potential(derived, definition), damping=damping)


def with_potential(derived: Derived, definition: Any) -> Derived:
    """Return the same with the potential of a force; one that has nothing else has no coefficients of dissipation."""
    if not isinstance(definition, Load):
        return derived
    tape = derived.tape
    alone = not definition.power and tape.term(definition.dissipation).is_zero
    return replace(derived, potential=_potential(tape.term(definition.potential)), damping=() if alone else None)


class Moving:
    """How the terms on a tape change with coordinates.

    A vector that turns with a body changes by the product of an axis and the vector: its components are not derived.

    Attributes
    ----------
    q, u : list of Term
    along, by_speed : list of dict
        Rates of terms where one coordinate, or one speed, changes with the rate 1.
    """

    def __init__(self, tape: Tape, q: list[str], u: list[str], s: list[str]) -> None:
        self.tape, self.names, self.rates = tape, q, u
        self._changing = [tape.input(name) for name in (*q, *u, *s)]
        self.q, self.u = ([tape.input(name) for name in x] for x in (q, u))
        self.along, self.by_speed = ([{x: tape.term(1)} for x in terms] for terms in (self.q, self.u))
        self._steps: dict[int, Term] = {}

    def frame(self, names: list[str], dimension: int, base: list[Term], at_rest: bool = False) -> Frame:
        """Return the frame of a body whose coordinates have these names."""
        places = [self.names.index(name) for name in names]
        q, u = [self.q[i] for i in places], [self.tape.term(0) if at_rest else self.u[i] for i in places]
        return _Turning(self, places, dimension, q, u, base)

    def rate(self, x: Any) -> Term:
        """Return the time derivative of what was computed from coordinates."""
        return self.tape.tangent(self.motion())(self.tape.term(x))

    def motion(self, a: Sequence[Term] = ()) -> dict[Term, Term]:
        """Return the rates along the motion at accelerations, or where they are zero and speeds are not asked for."""
        found: dict[Term, list[Term]] = {}
        for u, rates in zip(self.u, self.along, strict=True):
            for term, rate in rates.items():
                found.setdefault(term, []).append(u * rate)
        for acceleration, rates in zip(a, self.by_speed, strict=False):
            for term, rate in rates.items():
                found.setdefault(term, []).append(acceleration * rate)
        return {term: self.tape.sum(rates) for term, rates in found.items()}

    def fixed(self, vector: Iterable[Any]) -> bool:
        """Whether a vector contains parameters alone."""
        return not any(self.tape.depends(self.tape.term(x), y) for x in vector for y in self._changing)

    def turn(self, place: int, vector: Column, rates: Iterable[Term]) -> None:
        """Say how the components of a vector change with a coordinate."""
        for x, rate in zip(vector, rates, strict=True):
            if x.number is None:
                step = self._steps.setdefault(x.step, x / x.coefficient)
                self.along[place][step] = rate / x.coefficient


class _Turning(Frame):
    """A frame whose vectors turn with its angles on a tape."""

    def __init__(self, moving: Moving, places: list[int], dimension: int, q: Any, u: Any, base: Any) -> None:
        super().__init__(moving.tape.arithmetic(), dimension, q, base, u, moving.rate)
        self._moving, self._angles = moving, places[dimension:] if dimension else []
        if dimension == 3 and self._angles:
            for i, hinge in enumerate(self.hinges):
                self._turn_about(hinge, i)
        if self._angles:
            for i, axis in enumerate(self.axes):
                self._turned(axis, [int(i == j) for j in range(dimension)])

    def _turn_about(self, vector: Column, hinges: int) -> None:
        """Say that a vector turns with the first angles."""
        for place, hinge in zip(self._angles[:hinges], self.hinges, strict=False):
            self._moving.turn(place, vector, hinge.cross(vector))

    def _turned(self, vector: Column, own: Sequence[Any]) -> Column:
        """Say that a vector turns with the body, in whose axes it has the components `own`."""
        if self.dimension == 3:
            self._turn_about(vector, 2)
        # The last axis is fixed in the body: what lies along it does not change, exactly, with whatever errors.
        last = combined(self.axes[:2], (-own[1], own[0]))
        self._moving.turn(self._angles[-1], vector, last)
        return vector

    def direction(self, vector: Sequence[Any]) -> Column:
        turned = super().direction(vector)
        return self._turned(turned, vector) if self._angles and self._moving.fixed(vector) else turned


def _potential(energy: Term) -> dict[str, Entries]:
    return {} if energy.is_zero else {"U": {(): energy}}


def _coefficients(tape: Tape, dissipation: Term, parameters: list[str]) -> tuple[int, ...]:
    """Return the numbers of the parameters c in a dissipation function Σ c Φ_c, no Φ_c of which contains its own c."""
    inputs = [tape.input(name) for name in parameters]
    slopes = tape.gradient([(tape.term(1), dissipation)], inputs)
    pairs = [(i, x * slope) for i, (x, slope) in enumerate(zip(inputs, slopes, strict=True)) if not slope.is_zero]
    found = [(i, part) for i, part in pairs if not tape.depends(slopes[i], inputs[i])]
    if not (dissipation - tape.sum(part for _, part in found)).is_zero:
        raise ValueError("a dissipation function is a sum of coefficients times what does not contain them")
    return tuple(i for i, _ in found)


def differentiate(
    tape: Tape, role: str, definition: Any, motion: Moving, a: list[str], s: list[str], p: list[str]
) -> Derived:
    """Derive the outputs of a kernel from a definition on a tape.

    Parameters
    ----------
    tape : Tape
    role : str
        As in `Element`.
    definition : Term, Load or list of Term
        What `Element.define` returned.
    motion : Moving
        Coordinates and speeds, and how terms change with them.
    a : list of str
        Names of accelerations.
    s : list of str
        Given functions of time; their derivatives get the endings ``_t`` and ``_tt``.
    p : list of str
        Parameters, base rotations first.
    """
    inputs = {"q": motion.names, "u": motion.rates, "p": p}
    inputs["s"] = [*s, *(f"{x}_t" for x in s), *(f"{x}_tt" for x in s)]
    A, S = ([tape.input(name) for name in names] for names in (a, inputs["s"]))
    signals = dict(zip(S[: 2 * len(s)], S[len(s) :], strict=True))
    total, moving = (tape.tangent(motion.motion(x) | signals) for x in ((), A))
    one = tape.term(1)
    Q, by_speed = motion.along, motion.by_speed

    def jacobian(values: list[Term], directions: list[dict[Term, Term]]) -> Entries:
        slopes = [tape.tangent(rates) for rates in directions]
        return _entries([[slope(value) for slope in slopes] for value in values])

    def gradient(weighted: Iterable[tuple[Term, Term]], directions: list[dict[Term, Term]]) -> list[Term]:
        names = list({x: None for rates in directions for x in rates})
        adjoint = dict(zip(names, tape.gradient(weighted, names), strict=True))
        return [tape.sum(adjoint[x] * rate for x, rate in rates.items()) for rates in directions]

    if role == "inertia":
        inputs["a"] = a
        momentum, slope = (gradient([(one, definition)], x) for x in (by_speed, Q))
        F = [total(p) - x for p, x in zip(momentum, slope, strict=True)]
        full = [moving(p) - x for p, x in zip(momentum, slope, strict=True)]
        dynamics = {"M": jacobian(momentum, by_speed), "F": _entries(F)}
        return Derived(inputs, tape, dynamics, {"K": jacobian(full, Q), "R": jacobian(F, by_speed)})
    if role == "force":
        power = [(-f, v) for force, velocity in definition.power for f, v in zip(force, velocity, strict=True)]
        parts = (
            gradient([(one, tape.term(definition.potential))], Q),
            gradient([(one, tape.term(definition.dissipation)), *power], by_speed),
        )
        F = [x + y for x, y in zip(*parts, strict=True)]
        return Derived(inputs, tape, {"F": _entries(F)}, {"K": jacobian(F, Q), "R": jacobian(F, by_speed)})
    inputs["nu"] = [f"nu{i + 1}" for i in range(len(definition))]
    inputs["a"] = a
    nu = [tape.input(name) for name in inputs["nu"]]
    holonomic = role == "holonomic"
    by = Q if holonomic else by_speed
    definition = [tape.term(row) for row in definition]
    speeds = [total(row) for row in definition] if holonomic else definition
    bias = [total(speed) for speed in speeds]
    push = gradient(list(zip(nu, definition, strict=True)), by)

    def by_rows(values: list[Term], by: list[dict[Term, Term]]) -> list[list[Term]]:
        # Backward differentiation from one row takes fewer steps than forward from each coordinate.
        if len(values) == 1:
            return [gradient([(one, values[0])], by)]
        return [[slope(value) for slope in map(tape.tangent, by)] for value in values]

    J = by_rows(definition, by)
    D = [[total(x) for x in row] for row in J] if holonomic else by_rows(definition, Q)
    dynamics = {"E": _entries(definition), "V": _entries(speeds), "J": _entries(J), "B": _entries(bias)}
    if holonomic:
        linearize = {"K": _entries([gradient([(one, x)], Q) for x in push])}
    else:
        linearize = {"K": jacobian(push, Q), "R": jacobian(push, by_speed), "D": _entries(D)}
    # The derivatives of A = dV/dt are total derivatives of those of V.
    A_q = [[moving(x) for x in row] for row in D]
    A_u = [[x + moving(y) for x, y in zip(*rows, strict=True)] for rows in zip(D, J, strict=True)]
    return Derived(inputs, tape, dynamics, linearize, {"V_q": _entries(D), "A_q": _entries(A_q), "A_u": _entries(A_u)})


def _entries(values: list[Any]) -> Entries:
    """Return the entries of a vector or matrix that do not vanish identically."""
    entries: Entries = {}
    for i, value in enumerate(values):
        if isinstance(value, list):
            entries |= {(i, j): entry for j, entry in enumerate(value) if not entry.is_zero}
        elif not value.is_zero:
            entries[(i,)] = value
    return entries
