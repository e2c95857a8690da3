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

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from fractions import Fraction
from types import MappingProxyType, SimpleNamespace
from typing import Any, Protocol

from mbstab.compiler.tape import Tape, Term
from mbstab.mechanics.bodies import TENSOR_SIZE
from mbstab.mechanics.catalogue import Element, Load
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
    dimension = {"planar": 2, "spatial": 3}.get(frame, 0)
    sizes = {0: dimension, TENSOR_SIZE: 1 if dimension == 2 else 6}
    return [(name, sizes.get(size, size)) for name, size in element.parameters]


class Given(Protocol):
    """Parameters of an element that are expressions, and what these contain.

    Attributes
    ----------
    coordinates : int
        How many coordinates they contain; their names are q0, q1, …, those of their rates u0, ….
    numbers : int
        How many numbers; their names are p0, p1, ….
    """

    coordinates: int
    numbers: int

    def terms(self, tape: Tape, time: str) -> dict[int, Term]:
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
    from mbstab.mechanics.frames import Frame

    kinds = [*[frame] * element.slots, *["coordinate"] * element.states]
    frames = [Frame(kind, number + 1) for number, kind in enumerate(kinds)]
    p, flat, s = _symbols(element, frame)
    defined = element.define(frames, p, s)
    tape = Tape()
    q, u, a = ([x.name for f in frames for x in getattr(f, name)] for name in "qua")
    signals = [x.name for x in s]
    terms: dict[int, Term] = {}
    if given is not None:
        if element.role != "nonholonomic" and not (
            isinstance(defined, Load) and defined.potential == defined.dissipation == 0
        ):
            raise ValueError("what has a potential has no parameters that change with the motion")
        signals.append(f"s{len(s) + 1}")
        terms = given.terms(tape, signals[-1])
        for names, letter in ((q, "q"), (u, "u"), (a, "a")):
            names += [f"{letter}{i}" for i in range(given.coordinates)]
    put = from_symbols(tape, {flat[i]: term for i, term in terms.items()})
    definition = _on_tape(defined, put)
    parameters = [x.name for f in frames for x in f.base] + [x.name for i, x in enumerate(flat) if i not in terms]
    parameters += [f"p{i}" for i in range(given.numbers if given else 0)]
    derived = differentiate(tape, element.role, definition, q, u, a, signals, parameters)
    # Derived last: the text of the other functions depends on the order of their steps.
    if element.role == "inertia":
        return replace(derived, potential=_potential(-put(defined.subs({x: 0 for frame in frames for x in frame.u}))))
    if not isinstance(definition, Load):
        return derived
    damping = None if definition.power else _coefficients(tape, definition.dissipation, parameters)
    return replace(derived, potential=_potential(definition.potential), damping=damping)


def _symbols(element: Element, frame: str) -> tuple[SimpleNamespace, list[Any], list[Any]]:
    """Return the parameters of an element by name and one after the other, and its given functions, as symbols."""
    import sympy

    p, flat = SimpleNamespace(), []
    for name, size in parameter_sizes(element, frame):
        symbols = [sympy.Symbol(f"{name}_{i + 1}" if size > 1 else name, real=True) for i in range(size)]
        setattr(p, name, sympy.Matrix(symbols))
        flat += symbols
    return p, flat, [sympy.Symbol(f"s{i + 1}", real=True) for i in range(element.signals)]


def _on_tape(defined: Any, put: Callable[[Any], Term]) -> Any:
    """Return the definition of an element with the terms of a tape."""
    if isinstance(defined, Load):
        pairs = tuple(([put(x) for x in force], [put(x) for x in velocity]) for force, velocity in defined.power)
        return Load(put(defined.potential), put(defined.dissipation), pairs)
    return [put(row) for row in defined] if isinstance(defined, list) else put(defined)


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


def from_symbols(tape: Tape, given: Mapping[Any, Term] = MappingProxyType({})) -> Callable[[Any], Term]:
    """Return the function that puts SymPy expressions on a tape; `given` says what some symbols are there."""
    import sympy

    f = tape.arithmetic()
    known: dict[Any, Term] = dict(given)

    def put(x: Any) -> Term:
        if x not in known:
            known[x] = new(sympy.sympify(x))
        return known[x]

    def new(x: Any) -> Term:
        if x.is_Symbol:
            return tape.input(x.name)
        if x.is_Rational:
            return tape.term(Fraction(int(x.p), int(x.q)))
        if x is sympy.pi:
            return tape.literal("pi")
        arguments = [put(argument) for argument in x.args]
        if x.is_Add:
            return tape.sum(arguments)
        if x.is_Mul:
            return tape.product(arguments)
        if x.is_Pow:
            return tape.power(*arguments)
        term: Term = getattr(f, x.func.__name__.lower())(*arguments)
        return term

    return put


def differentiate(
    tape: Tape, role: str, definition: Any, q: list[str], u: list[str], a: list[str], s: list[str], p: list[str]
) -> Derived:
    """Derive the outputs of a kernel from a definition on a tape.

    Parameters
    ----------
    tape : Tape
    role : str
        As in `Element`.
    definition : Term, Load or list of Term
        What `Element.define` returned.
    q, u, a : list of str
        Names of coordinates, speeds and accelerations.
    s : list of str
        Given functions of time; their derivatives get the endings ``_t`` and ``_tt``.
    p : list of str
        Parameters, base rotations first.
    """
    inputs = {"q": q, "u": u, "p": p, "s": [*s, *(f"{x}_t" for x in s), *(f"{x}_tt" for x in s)]}
    Q, U, A, S = ([tape.input(name) for name in names] for names in (q, u, a, inputs["s"]))
    rates = dict(zip([*Q, *S[: 2 * len(s)]], [*U, *S[len(s) :]], strict=True))
    total = tape.tangent(rates)
    one = tape.term(1)

    def jacobian(values: list[Term], names: list[Term]) -> Entries:
        slopes = [tape.tangent({name: one}) for name in names]
        return _entries([[slope(value) for slope in slopes] for value in values])

    if role == "inertia":
        inputs["a"] = a
        momentum, slope = (tape.gradient([(one, definition)], names) for names in (U, Q))
        F = [total(p) - x for p, x in zip(momentum, slope, strict=True)]
        moving = tape.tangent(rates | dict(zip(U, A, strict=True)))
        full = [moving(p) - x for p, x in zip(momentum, slope, strict=True)]
        dynamics = {"M": jacobian(momentum, U), "F": _entries(F)}
        return Derived(inputs, tape, dynamics, {"K": jacobian(full, Q), "R": jacobian(F, U)})
    if role == "force":
        F = _generalized_force(tape, definition, Q, U)
        return Derived(inputs, tape, {"F": _entries(F)}, {"K": jacobian(F, Q), "R": jacobian(F, U)})
    inputs["nu"] = [f"nu{i + 1}" for i in range(len(definition))]
    inputs["a"] = a
    nu = [tape.input(name) for name in inputs["nu"]]
    holonomic = role == "holonomic"
    by = Q if holonomic else U
    speeds = [total(row) for row in definition] if holonomic else definition
    bias = [total(speed) for speed in speeds]
    push = tape.gradient(zip(nu, definition, strict=True), by)

    def of_rows(values: list[Term], names: list[Term]) -> Entries:
        # Backward differentiation from one row takes fewer steps than forward from each coordinate.
        return _entries([tape.gradient([(one, values[0])], names)]) if len(values) == 1 else jacobian(values, names)

    J = of_rows(definition, by)
    dynamics = {"E": _entries(definition), "V": _entries(speeds), "J": J, "B": _entries(bias)}
    linearize = {"K": jacobian(push, Q)}
    if not holonomic:
        linearize |= {"R": jacobian(push, U), "D": jacobian(definition, Q)}
    # Derived after the other functions, whose text depends only on the order of their steps.
    moving = tape.tangent(rates | dict(zip(U, A, strict=True)))
    full = [moving(speed) for speed in speeds]
    linearize_rows = {"V_q": of_rows(speeds, Q), "A_q": of_rows(full, Q), "A_u": of_rows(full, U)}
    return Derived(inputs, tape, dynamics, linearize, linearize_rows)


def _generalized_force(tape: Tape, load: Load, q: list[Term], u: list[Term]) -> list[Term]:
    """Return −Q, the term a force adds to F."""
    one = tape.term(1)
    by_speed = [(one, tape.term(load.dissipation))]
    by_speed += [(-f, v) for force, velocity in load.power for f, v in zip(force, velocity, strict=True)]
    parts = tape.gradient([(one, tape.term(load.potential))], q), tape.gradient(by_speed, u)
    return [x + y for x, y in zip(*parts, strict=True)]


def _entries(values: list[Any]) -> Entries:
    """Return the entries of a vector or matrix that do not vanish identically."""
    entries: Entries = {}
    for i, value in enumerate(values):
        if isinstance(value, list):
            entries |= {(i, j): entry for j, entry in enumerate(value) if not entry.is_zero}
        elif not value.is_zero:
            entries[(i,)] = value
    return entries
