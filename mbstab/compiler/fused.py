"""The equations of motion of one scene as straight-line functions of the state, for many evaluations.

`System` gathers, calls and scatters for every element at every state, and takes any kind of
numbers. A `Fused` takes floats only and does that work once: its functions are written by
`mbstab.compiler.trace`, with the parameters as constants, and return each different number
once; one ``take`` puts them, the constants and the zeros in their places. Nothing is
generated before it is asked for.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.compiler.system import Array, Dynamics, System
from mbstab.compiler.trace import Code, Trace, Traced
from mbstab.errors import MbstabError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.functions import NATIVE

_FAILURES = (ArithmeticError, ValueError, MbstabError)


class Program:
    """A function from numbers to arrays.

    Attributes
    ----------
    source : str
        Its text: q3 is coordinate number 3, counted from 0, and so on.
    """

    def __init__(self, trace: Trace, inputs: dict[str, Any], outputs: Sequence[Any]) -> None:
        slots: dict[Any, int] = {}
        values: list[Any] = []
        places: list[int] = []
        self._parts: list[tuple[slice, tuple[int, ...]]] = []
        for output in outputs:
            array = np.asarray(output)
            start = len(places)
            for x in array.ravel().tolist():
                key = (x.step, x.negative) if isinstance(x, Traced) else float(x)
                if key not in slots:
                    slots[key] = len(values)
                    values.append(x)
                places.append(slots[key])
            self._parts.append((slice(start, len(places)), array.shape))
        self._index: npt.NDArray[np.intp] = np.array(places, dtype=np.intp)
        self.source = trace.text(inputs, values)
        self._values = _from_floats(self.source, len(values))

    def __call__(self, *arguments: Any) -> list[Array]:
        """Return new arrays, views of one block of memory.

        Raises
        ------
        ArithmeticError, ValueError
            If a number does not exist or is not finite.
        """
        values = self._values(*arguments)
        # A search in bytes takes a third of the time of ``all``.
        if b"\0" in np.isfinite(values).tobytes():
            raise OverflowError
        flat = values.take(self._index)
        return [flat[part].reshape(shape) for part, shape in self._parts]


def _functions() -> dict[str, Callable[..., Any]]:
    return {name: getattr(FLOAT, name) for name in (*NATIVE, "power")}


def _from_floats(source: str, count: int) -> Callable[..., Array]:
    """Return the function of lists of floats that has this source and returns this many numbers."""
    names = _functions() | {"pack": struct.Struct(f"{count}d").pack}
    # The text is ours: it was written from traced numbers, nothing of it was taken from the file.
    exec(compile(source, "<fused>", "exec"), names)
    evaluate = names["evaluate"]

    def values(*arguments: Any) -> Array:
        return np.frombuffer(evaluate(*arguments))

    return values


class Fused:
    """What `System` returns, for one scene with fixed parameters, faster.

    Every method takes coordinates q and speeds u (m, rad, s; shape (n_q,)) and optionally
    the time (s) as those of `System` do, and raises what they raise.

    Parameters
    ----------
    system : System
    free : sequence of int
        Numbers of bodies whose base rotation is not known before: only for `code`.

    Raises
    ------
    ValueError
        If the parameters of the scene are not floats.
    """

    def __init__(self, system: System, free: Sequence[int] = ()) -> None:
        if system.scene.points is not None or system.scene.arithmetic is not FLOAT:
            raise ValueError("only a scene whose parameters are floats can be fused")
        self.system = system
        self._trace = Trace()
        bodies = list(system.scene.bodies)
        self._bases: list[Traced] = []
        for number in free:
            base = [self._trace.input(f"base{number}_{i}") for i in range(9)]
            bodies[number] = replace(bodies[number], base=tuple(base))
            self._bases += base
        scene = replace(system.scene, arithmetic=self._trace.arithmetic(), bodies=tuple(bodies))
        self._traced = (System(scene) if free else system).in_arithmetic(scene)
        sizes = {"q": system.n_q, "u": system.n_q, "a": system.n_q, "nu": system.n_c}
        self._inputs: dict[str, Any] = {
            name: [self._trace.input(f"{name}{i}") for i in range(size)] for name, size in sizes.items()
        }
        self._inputs["t"] = self._trace.input("t")

    def dynamics(self, q: Any, u: Any, time: float | None = None) -> Dynamics:
        """Return the matrices of the equations of motion."""
        program = self._dynamics
        try:
            return Dynamics(*program(*self._state(q, u, time)))
        except _FAILURES:
            return self.system.dynamics(q, u, time)

    def equations(self, q: Any, u: Any, time: float | None = None) -> tuple[Array, Array, Array, Array]:
        """Return M, F0, J and B of M a + Jᵀ ν = −F0, J a = −B."""
        program = self._equations
        try:
            M, F0, J, B = program(*self._state(q, u, time))
        except _FAILURES:
            state = self.system.dynamics(q, u, time)
            return state.M, state.F0, state.J, state.B
        return M, F0, J, B

    def residuals(self, q: Any, u: Any, time: float | None = None) -> tuple[Array, Array, Array]:
        """Return E, V and J, to correct a state that violates the constraints."""
        program = self._residuals
        try:
            E, V, J = program(*self._state(q, u, time))
        except _FAILURES:
            state = self.system.dynamics(q, u, time)
            return state.E, state.V, state.J
        return E, V, J

    def linearize(self, q: Any, u: Any, a: Any, nu: Any, time: float | None = None) -> tuple[Array, Array, Array]:
        """Return K = ∂F/∂q, R = ∂F/∂u and D_q; a has shape (n_q,), nu (n_c,)."""
        program = self._linearize
        try:
            K, R, D_q = program(*self._state(q, u, time), _listed(a), _listed(nu))
        except _FAILURES:
            K, R, D_q = self.system.linearize(q, u, a, nu, time)
        return K, R, D_q

    def linearize_rows(self, q: Any, u: Any, a: Any, time: float | None = None) -> tuple[Array, Array, Array]:
        """Return V_q, A_q and A_u; a has shape (n_q,)."""
        program = self._linearize_rows
        try:
            V_q, A_q, A_u = program(*self._state(q, u, time), _listed(a))
        except _FAILURES:
            V_q, A_q, A_u = self.system.linearize_rows(q, u, a, time)
        return V_q, A_q, A_u

    def augmented(self, rows: Sequence[int]) -> Program:
        """Return the program of the matrix and the right-hand side of [[M, Jᵀ], [J, 0]] [a; ν] = [−F0; −B].

        Parameters
        ----------
        rows : sequence of int
            The constraint rows that enter; with rows that depend on each other the matrix is singular.

        Returns
        -------
        Program
            Takes q and u as lists and the time (s); returns shapes (n, n) and (n,) with
            n = n_q + number of `rows`.
        """
        state, count = self.traced, len(rows)
        J = np.asarray(state.J)[list(rows)]
        matrix = np.block([[np.asarray(state.M, dtype=object), J.T], [J, np.zeros((count, count), dtype=object)]])
        right = [-x for x in (*state.F0.tolist(), *state.B[list(rows)].tolist())]
        return self._program("qut", (matrix, np.array(right, dtype=object)))

    @cached_property
    def traced(self) -> Dynamics:
        """The matrices of the equations of motion, as traced numbers."""
        x = self._inputs
        return self._traced.dynamics(x["q"], x["u"], x["t"])

    def traced_power(self, working: Collection[str], damped: Collection[str]) -> Any:
        """Return the power (W) of entries, and of the dampers of others, such as ``forces.spring``, traced."""
        x, total = self._inputs, 0.0
        rest = [0.0] * self.system.n_q
        for path, part in self._traced.parts():
            if path in working or path in damped:
                force = part.dynamics(x["q"], x["u"], x["t"]).F0
                if path in damped:
                    force = force - part.dynamics(x["q"], rest, x["t"]).F0
                for f, u in zip(force.tolist(), x["u"], strict=True):
                    total = total - f * u
        return total

    def code(self, groups: Sequence[Sequence[Any]]) -> Code:
        """Return the program that finds groups of traced numbers; its first registers are q, u, t and free bases."""
        x = self._inputs
        return self._trace.code([*x["q"], *x["u"], x["t"], *self._bases], groups)

    @cached_property
    def _dynamics(self) -> Program:
        x = self.traced
        return self._program("qut", (x.M, x.F0, x.E, x.V, x.J, x.B))

    @cached_property
    def _equations(self) -> Program:
        x = self.traced
        return self._program("qut", (x.M, x.F0, x.J, x.B))

    @cached_property
    def _residuals(self) -> Program:
        x = self.traced
        return self._program("qut", (x.E, x.V, x.J))

    @cached_property
    def _linearize(self) -> Program:
        x = self._inputs
        return self._program(
            ("q", "u", "t", "a", "nu"), self._traced.linearize(*(x[k] for k in ("q", "u", "a", "nu", "t")))
        )

    @cached_property
    def _linearize_rows(self) -> Program:
        x = self._inputs
        return self._program("quta", self._traced.linearize_rows(*(x[k] for k in "quat")))

    def _program(self, inputs: Sequence[str], outputs: Sequence[Any]) -> Program:
        return Program(self._trace, {name: self._inputs[name] for name in inputs}, outputs)

    def _state(self, q: Any, u: Any, time: float | None) -> tuple[list[float], list[float], float]:
        return _listed(q), _listed(u), float(self.system.scene.time if time is None else time)


def _listed(x: Any) -> list[float]:
    # Python floats are several times faster than array elements.
    listed: list[float] = x.tolist() if isinstance(x, np.ndarray) else x
    return listed
