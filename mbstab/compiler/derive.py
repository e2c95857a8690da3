"""From the definition of an element to every derivative the analyses need, as symbols.

With F the residual of the equations of motion, F = d/dt ∂T/∂u − ∂T/∂q − Q + Jᵀν, each
element adds to

* ``dynamics``: M = ∂F/∂a and F at a = 0 (inertia), F (force), the residual E of the rows,
  their velocity residual V, their Jacobian J = ∂V/∂u and the part B of their acceleration
  that does not contain a (constraints);
* ``linearize``: K = ∂F/∂q and R = ∂F/∂u at fixed a and ν; for nonholonomic rows also D_q.

For a holonomic row V = dC/dt and J = C_q; for a nonholonomic one E = V = D and J = D_u.
Given functions of time enter as s with their derivatives.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import sympy

from mbstab.mechanics.bodies import TENSOR_SIZE
from mbstab.mechanics.catalogue import COORDINATES, Element, Load
from mbstab.mechanics.frames import Frame

Entries = dict[tuple[int, ...], Any]


class Tape:
    """A straight-line program of small steps that can be differentiated.

    Differentiating whole expression trees doubles their size with every derivative. Here
    every subexpression has a name, its derivative with respect to each variable is one
    more named step, and equal steps share a name, so the size grows with the number of
    variables only.
    """

    def __init__(self) -> None:
        self.steps: dict[Any, Any] = {}
        self._names: dict[Any, Any] = {}
        self._derivatives: dict[tuple[Any, Any], Any] = {}
        self._fresh = (sympy.Symbol(f"w{i}") for i in itertools.count())

    def put(self, expression: Any) -> Any:
        """Return the name of an expression; numbers and symbols stand for themselves."""
        expression = sympy.sympify(expression)
        if expression.is_Atom:
            return expression
        known = self._names.get(expression)
        if known is not None:
            return known
        sign, rest = expression.as_coeff_Mul()
        if sign != 1 and not rest.is_Atom:
            return sign * self.put(rest) if sign == -1 else self._step(sign * self.put(rest))
        return self._step(expression.func(*[self.put(argument) for argument in expression.args]))

    def _step(self, small: Any) -> Any:
        if small.is_Atom:
            return small
        sign, rest = small.as_coeff_Mul()
        if sign == -1:
            return -self._step(rest)
        if small not in self._names:
            name = next(self._fresh)
            self.steps[name] = small
            self._names[small] = name
        return self._names[small]

    def diff(self, expression: Any, x: Any) -> Any:
        """Return the derivative of an expression of names with respect to a variable."""
        terms = []
        for symbol in sorted(expression.free_symbols, key=str):
            inner = self._symbol_derivative(symbol, x)
            if inner != 0:
                terms.append(self.put(self.put(expression.diff(symbol)) * inner))
        return self.put(sympy.Add(*terms))

    def _symbol_derivative(self, symbol: Any, x: Any) -> Any:
        if symbol == x:
            return sympy.S.One
        if symbol not in self.steps:
            return sympy.S.Zero
        key = (symbol, x)
        if key not in self._derivatives:
            self._derivatives[key] = self.diff(self.steps[symbol], x)
        return self._derivatives[key]


@dataclass(frozen=True)
class Derived:
    """The two functions of a kernel: names of their inputs, the steps, and the non-zero entries of their outputs."""

    inputs: dict[str, list[Any]]
    tape: Tape
    dynamics: dict[str, Entries]
    linearize: dict[str, Entries]


def parameter_sizes(element: Element, frame: str) -> list[tuple[str, int]]:
    """Return names and sizes of the parameters of an element in a frame."""
    dimension = {"planar": 2, "spatial": 3}.get(frame, 0)
    sizes = {0: dimension, TENSOR_SIZE: 1 if dimension == 2 else 6}
    return [(name, sizes.get(size, size)) for name, size in element.parameters]


def derive(element: Element, frame: str) -> Derived:
    """Derive everything a kernel returns from the definition of an element.

    Parameters
    ----------
    element : Element
    frame : str
        One of `Element.frames`.
    """
    frames = [Frame(frame, number + 1) for number in range(element.slots)]
    p = SimpleNamespace()
    flat: list[Any] = []
    for name, size in parameter_sizes(element, frame):
        symbols = [sympy.Symbol(f"{name}_{i + 1}" if size > 1 else name, real=True) for i in range(size)]
        setattr(p, name, sympy.Matrix(symbols))
        flat += symbols
    s = [sympy.Symbol(f"s{i + 1}", real=True) for i in range(element.signals)]
    definition = element.define(frames, p, s)
    q, u, a = ([x for f in frames for x in getattr(f, name)] for name in "qua")
    return differentiate(element.role, definition, q, u, a, s, flat, [f.base for f in frames])


def differentiate(
    role: str, definition: Any, q: list[Any], u: list[Any], a: list[Any], s: list[Any], parameters: list[Any],
    bases: list[list[Any]],
) -> Derived:  # fmt: skip
    """Derive the outputs of a kernel from a symbolic definition.

    Parameters
    ----------
    role : str
        As in `Element`.
    definition : expression, Load or list of expressions
        What `Element.define` returned.
    q, u, a : list of Symbol
        Coordinates, speeds and accelerations.
    s : list of Symbol
        Given functions of time; their derivatives get the endings ``_t`` and ``_tt``.
    parameters : list of Symbol
    bases : list of list of Symbol
        Base rotation of each slot, empty where there is none.
    """
    s_t, s_tt = ([sympy.Symbol(f"{x.name}{end}", real=True) for x in s] for end in ("_t", "_tt"))
    inputs = {"q": q, "u": u, "p": [x for base in bases for x in base] + parameters, "s": [*s, *s_t, *s_tt]}
    pairs = [*zip(q, u, strict=True), *zip(s, s_t, strict=True), *zip(s_t, s_tt, strict=True)]
    tape = Tape()

    def total_derivative(expression: Any) -> Any:
        return tape.put(sympy.Add(*[tape.put(tape.diff(expression, x) * rate) for x, rate in pairs]))

    def gradient(expression: Any, variables: list[Any]) -> list[Any]:
        return [tape.diff(expression, x) for x in variables]

    def jacobian(values: list[Any], variables: list[Any]) -> Entries:
        return _entries([gradient(value, variables) for value in values])

    if role == "inertia":
        inputs["a"] = a
        lagrangian = tape.put(definition)
        momentum = gradient(lagrangian, u)
        M = [gradient(p, u) for p in momentum]
        F = [
            tape.put(total_derivative(p) - slope) for p, slope in zip(momentum, gradient(lagrangian, q), strict=True)
        ]
        full = [tape.put(f + sum(m * x for m, x in zip(row, a, strict=True))) for f, row in zip(F, M, strict=True)]
        dynamics = {"M": _entries(M), "F": _entries(F)}
        return Derived(inputs, tape, dynamics, {"K": jacobian(full, q), "R": jacobian(F, u)})
    if role == "force":
        F = _generalized_force(tape, definition, q, u)
        return Derived(inputs, tape, {"F": _entries(F)}, {"K": jacobian(F, q), "R": jacobian(F, u)})
    rows = [tape.put(row) for row in definition]
    nu = [sympy.Symbol(f"nu{i + 1}", real=True) for i in range(len(rows))]
    inputs["nu"] = nu
    speeds = [total_derivative(row) for row in rows] if role == "holonomic" else rows
    J = [gradient(speed, u) for speed in speeds]
    bias = [total_derivative(speed) for speed in speeds]
    push = [tape.put(sympy.Add(*[n * row[j] for n, row in zip(nu, J, strict=True)])) for j in range(len(q))]
    dynamics = {"E": _entries(rows), "V": _entries(speeds), "J": _entries(J), "B": _entries(bias)}
    linearize = {"K": jacobian(push, q)}
    if role == "nonholonomic":
        linearize |= {"R": jacobian(push, u), "D": jacobian(rows, q)}
    return Derived(inputs, tape, dynamics, linearize)


def _generalized_force(tape: Tape, load: Load, q: list[Any], u: list[Any]) -> list[Any]:
    """Return −Q, the term a force adds to F."""
    potential, dissipation = tape.put(load.potential), tape.put(load.dissipation)
    F = []
    for x, v in zip(q, u, strict=True):
        terms = [tape.diff(potential, x), tape.diff(dissipation, v)]
        for force, velocity in load.power:
            terms += [-tape.put(f) * tape.diff(tape.put(w), v) for f, w in zip(force, velocity, strict=True)]
        F.append(tape.put(sympy.Add(*terms)))
    return F


def _entries(values: list[Any]) -> Entries:
    """Return the entries of a vector or matrix that are not zero as written."""
    entries: Entries = {}
    for i, value in enumerate(values):
        if isinstance(value, list):
            entries |= {(i, j): entry for j, entry in enumerate(value) if entry != 0}
        elif value != 0:
            entries[(i,)] = value
    return entries


def slot_coordinates(frame: str) -> int:
    """Return how many coordinates a slot of this frame has."""
    return len(COORDINATES[frame])
