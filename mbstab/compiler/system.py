"""A scene in numbers: gather the coordinates of each element, run its kernel, scatter the results.

The resulting arrays (the notation of the whole package):

========  ==============================================  ==========================
symbol    meaning                                         shape
========  ==============================================  ==========================
q, u, a   coordinates, speeds q̇, accelerations q̈          (n_q,)
M         ∂F/∂a, the mass matrix                          (n_q, n_q)
F0        F at a = 0 and ν = 0                            (n_q,)
E         constraint residuals C(q, t) and D(q, u, t)     (n_c,)
V         velocity residuals dC/dt and D                  (n_c,)
J         [C_q; D_u], ∂V/∂u                               (n_c, n_q)
B         acceleration residual of the rows at a = 0      (n_c,)
K, R      ∂F/∂q (with ∂(Jᵀν)/∂q) and ∂F/∂u                (n_q, n_q)
D_q       ∂D/∂q, nonholonomic rows only                   (n_n, n_q)
V_q       ∂V/∂q; for the holonomic rows dC_q/dt           (n_c, n_q)
A_q, A_u  ∂A/∂q and ∂A/∂u at fixed a, with A = J a + B    (n_c, n_q)
nu        multipliers [λ; μ]                              (n_c,)
========  ==============================================  ==========================

The residual of the equations of motion is F = M a + F0 + Jᵀ ν. Rows of holonomic
constraints come first (n_h of them), then the n_n nonholonomic ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import accumulate, chain
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mbstab.compiler import kernels
from mbstab.compiler.located import located
from mbstab.compiler.placed import Acting, Placed, acting, bases_of, columns_of, following, force_sizes, unfelt_states
from mbstab.compiler.scatter import Plan, Time, arithmetic_of, padded, plan_of
from mbstab.errors import Location, NumericalError
from mbstab.mechanics.bodies import inertia_element
from mbstab.mechanics.catalogue import ElementUse, Moved, Role
from mbstab.mechanics.elements import ELEMENTS, kernel_name
from mbstab.model.arithmetic import FLOAT
from mbstab.model.evaluator import Law
from mbstab.model.expressions import Expression
from mbstab.model.scene import BalanceValues, Scene
from mbstab.model.schema import Entry, is_length, is_state
from mbstab.records import dataclass

if TYPE_CHECKING:
    import numpy.typing as npt

    from mbstab.compiler.grouped import Assembly, Form, Numbers, What
    from mbstab.compiler.measured import Measured

Array = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """One constraint row: the entry it belongs to, its label, its unit, and what its residual is."""

    section: str
    name: str
    label: str
    unit: str
    location: Location
    residual: str = "the residual"

    @property
    def owner(self) -> str:
        """Return the entry it belongs to, such as ``joint 'pivot'``."""
        return f"{self.section.removesuffix('s')} {self.name!r}"

    def __str__(self) -> str:
        return f"{self.owner} ({self.label})"


Numbered = tuple[tuple[str, str, int], Row]
"""A row with its entry and its number there."""


@dataclass(frozen=True)
class Dynamics:
    """Matrices of the equations of motion at a state; see the table of this module."""

    M: Any
    F0: Any
    E: Any
    V: Any
    J: Any
    B: Any


class System:
    """The equations of motion of a scene.

    Attributes
    ----------
    scene : Scene
    n_q, n_h, n_n : int
        Numbers of coordinates, holonomic and nonholonomic rows.
    names : list of str
        Coordinates in the order of q.
    rows : list of Row
        Constraint rows in the order of E.
    row_keys : list of (section, name, number)
        Which row of which entry each of them is.
    body_slices : list of slice
        Coordinates of each body.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.names = scene.coordinate_names()
        self.n_q = len(self.names)
        self.body_slices: list[slice] = []
        start = 0
        for body in scene.bodies:
            self.body_slices.append(slice(start, start + len(body.coordinates)))
            start += len(body.coordinates)
        uses = self._uses()
        groups = [self._row_list(use, entry) if role in _OF_ROWS else [] for use, entry, role in uses]
        kept = self._kept(groups)
        parts = [
            [x for own, use in zip(kept, uses, strict=True) if use[2] == role for x in own if x] for role in _OF_ROWS
        ]
        self.row_keys = [key for part in parts for key, _ in part]
        self.rows = [row for part in parts for _, row in part]
        self.n_h, self.n_n = map(len, parts)
        with located(scene):
            self._elements = self._place(uses, kept)
        self._plans: dict[str, Plan] = {}
        self._known: dict[str, tuple[Any, Any]] = {}
        self._assembly: Assembly | None = None

    def __reduce__(self) -> tuple[type[System], tuple[Scene]]:
        """Return it as its scene: kernels are found, or compiled, where it is needed again."""
        return System, (self.scene,)

    def remember(self, what: str, key: Any, make: Callable[[], T]) -> T:
        """Return what was made for the same key the last time, or make it; nobody must change it.

        Parameters
        ----------
        what : str
            One result for each is kept as long as the system.
        key : hashable
            All that it depends on besides the system.
        """
        known = self._known.get(what)
        if known is None or known[0] != key:
            known = self._known[what] = key, make()
        found: T = known[1]
        return found

    def _with(self, elements: list[Placed]) -> System:
        """Return a system in which only some elements act."""
        part = object.__new__(System)
        part.__dict__.update(self.__dict__)
        part._elements, part._plans, part._known = elements, {}, {}
        if self._assembly is not None:
            part._assembly = self._assembly.of(elements)
        return part

    @property
    def n_c(self) -> int:
        """Number of constraint rows."""
        return self.n_h + self.n_n

    @cached_property
    def places(self) -> npt.NDArray[np.intp]:
        """Numbers of the coordinates of the place of each body, shape (bodies, 2 or 3)."""
        return np.array([range(part.start, part.start + self.scene.dimension) for part in self.body_slices])

    def parts(self) -> Iterator[tuple[str, System]]:
        """Yield each entry of the scene, such as ``joints.pivot``, and a system in which only it acts."""
        for path in dict.fromkeys(element.path for element in self._elements):
            yield path, self._with([element for element in self._elements if element.path == path])

    def _only(self, chosen: Callable[[Placed], bool]) -> System:
        """Return a system with the elements that are chosen: this one if all are."""
        elements = [element for element in self._elements if chosen(element)]
        return self if len(elements) == len(self._elements) else self._with(elements)

    @property
    def closing(self) -> System:
        """A system with only inertia and holonomic rows: what closes a mechanism has a value without its speeds."""

        def closes(element: Placed) -> bool:
            return element.takes_acceleration or bool(element.rows and min(element.rows) < self.n_h)

        return self.remember("closing", None, lambda: self._only(closes))

    @property
    def bodily(self) -> System:
        """A system with only inertia and the rows of bodies: states follow them, and take no force from them."""
        if not self.n_n:
            return self.closing

        def bodily(element: Placed) -> bool:
            return element.takes_acceleration or bool(element.rows and element.path.partition(".")[0] != "states")

        return self.remember("bodily", None, lambda: self._only(bodily))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """The SI units of the coordinates."""
        return tuple(map(self.scene.model.unit_of, self.names))

    @cached_property
    def states(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Numbers of the coordinates that are first-order states, and of the rows of their rates."""
        rows = [i for i, row in enumerate(self.rows) if row.section == "states"]
        columns = [i for i, name in enumerate(self.names) if is_state(name)]
        return np.array(columns, dtype=np.intp), np.array(rows, dtype=np.intp)

    @cached_property
    def following(self) -> list[int]:
        """Numbers of the first-order states that only follow: no force, no row and no other state contains them."""
        states, rows = self.states
        unfelt = unfelt_states(self.scene, self.names) if len(states) else {}
        return following(self._elements, states, rows, unfelt)

    def with_state_rates(self, q: Array, u: Array, time: Any = None) -> Array:
        """Return speeds in which the rates of the states follow from the others, shape (n_q,) or (points, n_q)."""
        columns, rows = self.states
        # Affine in the rates of states, unless these stand in functions of each other.
        for _ in range(3 if len(rows) else 0):
            at = self.dynamics(q, u, time)
            J, V = (at.J.toarray() if self.sparse else at.J)[..., rows[:, None], columns], at.V[..., rows]
            if not np.any(V):
                break
            u = u.copy()
            u[..., columns] -= np.linalg.solve(J, V[..., None])[..., 0]
        return u

    @property
    def sparse(self) -> bool:
        """Whether matrices are sparse."""
        return self._assembly is not None

    def in_matrices(self, form: Form, numbers: Numbers | None = None) -> System:
        """Return the same equations with sparse matrices made by a function; see `Form`."""
        from mbstab.compiler.grouped import FLOATS, Assembly

        other = self._with(self._elements)
        other._assembly = Assembly(self._elements, self.n_q, form, numbers or FLOATS)
        return other

    def given_functions(self) -> Iterator[tuple[str, Any]]:
        """Yield the owner, such as ``drives.motor``, and the `Law` of each given function of time."""
        for element in self._elements:
            yield from ((element.path, law) for law in element.laws if isinstance(law, Law))

    def numbers(self) -> Iterator[Any]:
        """Yield the numbers of all elements: parameters, components of vectors, base rotations."""
        yield from (number for element in self._elements for number in element.parameters)

    def in_arithmetic(self, scene: Scene) -> System:
        """Return the same elements in the arithmetic of another scene, which must not differ otherwise."""

        def law(x: Any) -> Any:
            return replace(x, arithmetic=scene.arithmetic) if isinstance(x, Law) else x

        other = self._with([replace(e, laws=tuple(map(law, e.laws))) for e in self._elements])
        other.scene, other._assembly = scene, None
        return other

    def renumbered(self, scene: Scene, numbers: Numbers | None = None) -> System:
        """Return the same elements with the numbers of another scene, which must not differ otherwise.

        Parameters
        ----------
        scene : Scene
        numbers : Numbers, optional
            The type of these numbers, of sparse matrices.
        """
        other = self._with([])
        other.scene = scene
        uses = other._uses()
        if len(uses) == len(self._elements):
            for known, (use, _, role) in zip(self._elements, uses, strict=True):
                if not isinstance(use, ElementUse) or known.kernel is not kernels.load(self._kernel_name(use)):
                    break
                own = (*bases_of(use, ELEMENTS[self._kernel_name(use)], scene), *use.parameters)
                other._elements.append(
                    Placed(known.kernel, known.columns, known.rows, own, use.laws, role == "inertia", known.path)
                )
            else:
                if self._assembly is not None:
                    other._assembly = self._assembly.renumbered(other._elements, numbers)
                return other
        other = System(scene)
        return other if self._assembly is None else other.in_matrices(self._assembly.form, numbers)

    def loads(self, q: Any, u: Any, a: Any, time: Any = None) -> Any:
        """Return the sum of the sizes of all forces and inertia on each coordinate, without cancellation, (n_q,)."""
        found = force_sizes(self.acting(), q, u, a, self.scene.time if time is None else time)
        if not np.isfinite(found).all():
            raise self._overflow("dynamics", q, u, time, a, None)
        return found

    def terms(self, q: Any, u: Any, a: Any, nu: Any, time: Any = None) -> dict[str, Any]:
        """Return M, F (= F0), J, K, R and D (= D_q) without cancellation: sums of sizes over the elements.

        Parameters
        ----------
        q, u, a : array_like, shape (n_q,)
        nu : array_like, shape (n_c,)
        time : float, optional
        """
        n, c = self.n_q, self.n_c
        shapes = {"M": (n, n), "F": (n,), "E": (c,), "V": (c,), "J": (c, n), "B": (c,)}
        out = self._run("dynamics", q, u, time, shapes, what="sizes")
        out |= self._run("linearize", q, u, time, {"K": (n, n), "R": (n, n), "D": (c, n)}, a, nu, what="sizes")
        return out | {"D": out["D"][..., self.n_h :, :]}

    def lost(self, q: Any, u: Any, a: Any, nu: Any, time: Any = None) -> dict[str, Any]:
        """Return the rounding errors of the sums in the entries of M, J, K, R and D (= D_q), if sparse."""
        n, c = self.n_q, self.n_c
        shapes = {"M": (n, n), "F": (n,), "E": (c,), "V": (c,), "J": (c, n), "B": (c,)}
        out = self._run("dynamics", q, u, time, shapes, what="lost")
        out |= self._run("linearize", q, u, time, {"K": (n, n), "R": (n, n), "D": (c, n)}, a, nu, what="lost")
        return out | {"D": out["D"][..., self.n_h :, :]}

    def acting(self) -> list[Acting]:
        """Return the elements without rows, each by itself."""
        return acting(self._elements, self.scene, self.names)

    # --- what is in the scene ---------------------------------------------------------------------------------------

    def _uses(self) -> list[tuple[Any, Entry | None, Role]]:
        scene = self.scene
        uses: list[tuple[Any, Entry | None, Role]] = []
        for number, body in enumerate(scene.bodies):
            element = inertia_element(number, body.orientation, body.mass, body.inertia, body.center, scene.gravity)
            uses.append((element, None, "inertia"))
        for item in scene.items:
            if item.kind.written:
                uses.append((item.entry.equations, item.entry, item.kind.written))
            else:
                for use in item.kind.build(item):
                    uses.append((use, item.entry, ELEMENTS[self._kernel_name(use)].role))
        uses += ((x, None, "nonholonomic" if x.first_order else "holonomic") for x in scene.balances)
        return uses

    def _kernel_name(self, use: ElementUse) -> str:
        return kernel_name(use.element, self.scene.dimension)

    def _row_list(self, use: Any, entry: Entry | None) -> list[Row]:
        if isinstance(use, BalanceValues):
            unit, place = "N" if is_length(use.name) else "N*m", self._location(f"balances.{use.name}")
            return [Row("balances", use.name, "forces", unit, place)]
        assert entry is not None
        if not isinstance(use, ElementUse):
            return [Row(entry.section, entry.name, entry.kind.name, "unit of the expression", entry.location)]
        element = ELEMENTS[name := self._kernel_name(use)]
        count = 1 + max(i for i, *_ in kernels.load(name).DYNAMICS["J"])
        label = use.labels[0] if use.labels else element.name
        if (unit := element.units[0]).startswith("unit"):
            unit = unit.replace("unit", self.units[use.slots[0]])
        labels = [label] if count == 1 else [f"{label} {axis}" for axis in "xyz"[:count]]
        return [Row(entry.section, entry.name, text, unit, entry.location, element.residual) for text in labels]

    def _kept(self, groups: list[list[Row]]) -> list[list[Numbered | None]]:
        """Return the rows of each element, numbered in their entries; None in the place of those that are left out."""
        left_out, seen = {item.row for item in self.scene.model.left_out}, dict[tuple[str, str], int]()
        found: list[list[Numbered | None]] = []
        for group in groups:
            found.append([])
            for row in group:
                entry = row.section, row.name
                key = (*entry, seen.get(entry, 0))
                seen[entry] = key[2] + 1
                found[-1].append(None if key in left_out else (key, row))
        return found

    def _place(self, uses: list[tuple[Any, Entry | None, Role]], groups: list[list[Numbered | None]]) -> list[Placed]:
        next_row = {"holonomic": 0, "nonholonomic": self.n_h}
        placed: list[Placed] = []
        for (use, entry, role), group in zip(uses, groups, strict=True):
            # A row that is left out has the number behind the last one, as a fixed coordinate has.
            first, behind = next_row.get(role, 0), list(accumulate(map(bool, group), initial=0))
            rows = tuple(first + n if row else self.n_c for n, row in zip(behind, group, strict=False))
            next_row[role] = first + behind[-1]
            if isinstance(use, BalanceValues):
                from mbstab.compiler.balances import balance_of

                placed.append(balance_of(use, self.names, role, placed, f"balances.{use.name}", rows[0]))
                continue
            path = entry.path if entry else f"bodies.{self.scene.bodies[use.slots[0]].name}"
            if isinstance(use, ElementUse):
                name = self._kernel_name(use)
                columns = columns_of(use, ELEMENTS[name], self.scene, self.body_slices, self.n_q)
                bases = bases_of(use, ELEMENTS[name], self.scene)
                if any(isinstance(x, Moved) for x in use.parameters):
                    placed.append(self._place_moved(use, name, columns, bases, rows, path))
                    continue
                kernel, numbers = kernels.load(name), (*bases, *use.parameters)
                placed.append(Placed(kernel, columns, rows, numbers, use.laws, role == "inertia", path))
            else:
                assert entry is not None
                placed.append(self._place_expressions(use, entry, role, rows))
        return placed

    def _place_moved(
        self, use: ElementUse, name: str, columns: tuple[int, ...], bases: tuple[Any, ...], rows: Any, path: str
    ) -> Placed:
        """Place an element some of whose numbers change with the motion."""
        from mbstab.compiler.measured import all_coordinates
        from mbstab.compiler.user import moved_kernel

        moved = {i: x for i, x in enumerate(use.parameters) if isinstance(x, Moved)}
        coordinates, parameters, measures = self._contents(x.expression for x in moved.values())
        settled = self.scene.rationals.settled
        places = tuple((i, settled(x.expression).root, x.positive) for i, x in moved.items())
        frame = name.removesuffix(f"_{ELEMENTS[name].name}")
        kernel = moved_kernel(name, frame, places, coordinates, parameters, tuple(measures))
        own = (x for i, x in enumerate(use.parameters) if i not in moved)
        numbers = (*bases, *own, *self._numbers(parameters, measures))
        more = (self.names.index(x) for x in all_coordinates(coordinates, measures))
        positive = dict.fromkeys(x.expression.path.removeprefix(f"{path}.") for x in moved.values() if x.positive)
        return Placed(kernel, (*columns, *more), rows, numbers, (*use.laws, _TIME), False, path, 0, tuple(positive))

    def _place_expressions(
        self, equations: dict[str, Expression], entry: Entry, role: str, rows: tuple[int, ...]
    ) -> Placed:
        from mbstab.compiler.measured import all_coordinates
        from mbstab.compiler.user import user_kernel

        number = {name: i for i, name in enumerate(self.names)}
        acted = tuple(equations) if role == "force" else ()
        coordinates, parameters, measures = self._contents(equations.values(), acted)
        expressions = tuple(map(self.scene.rationals.settled, equations.values()))
        kernel = user_kernel(role, expressions, acted, coordinates, parameters, tuple(measures))
        columns = tuple(number[name] for name in all_coordinates(coordinates, measures))
        values = self._numbers(parameters, measures)
        return Placed(kernel, columns, rows, values, (_TIME,), False, entry.path, len(parameters))

    def _contents(
        self, expressions: Iterable[Expression], acted: tuple[str, ...] = ()
    ) -> tuple[tuple[str, ...], tuple[str, ...], dict[Measured, tuple[Any, ...]]]:
        """Return what is written in expressions: coordinates, also those acted on, parameters and measures."""
        from mbstab.compiler.measured import measured

        used = {name for e in expressions for name in (*e.names(), *e.rates())} | set(acted)
        measures = measured(self.scene, used) if self.scene.measures else {}
        coordinates = tuple(name for name in self.names if name in used)
        return coordinates, tuple(name for name in self.scene.parameters if name in used), measures

    def _numbers(self, parameters: tuple[str, ...], measures: dict[Measured, tuple[Any, ...]]) -> tuple[Any, ...]:
        return (*(self.scene.parameters[name] for name in parameters), *chain.from_iterable(measures.values()))

    # --- numbers ----------------------------------------------------------------------------------------------------

    def potential(self, q: Any) -> Any:
        """Return the potential energy (J) of gravity and of elements that store energy, shape (…); q has (…, n_q)."""
        q = np.asarray(q)
        coordinates = [*np.moveaxis(q, -1, 0), 0.0]
        total = np.zeros(q.shape[:-1])
        for element in self._elements:
            if hasattr(element.kernel, "potential"):
                arguments = [[coordinates[i] for i in element.columns], element.parameters]
                total = total + element.kernel.potential(arithmetic_of(arguments), *arguments)[0]
        return total

    def dynamics(self, q: Any, u: Any, time: Any = None) -> Dynamics:
        """Return the matrices of the equations of motion.

        Parameters
        ----------
        q, u : array_like, shape (n_q,)
            Coordinates (m, rad) and speeds; shape (points, n_q) for the points of a sweep, whose
            matrices then have a first axis for them, of length 1 where all are the same.
        time : float, optional
            Time (s), for given motions and forces; the reference time if not given.
        """
        n, c = self.n_q, self.n_c
        out = self._run("dynamics", q, u, time, {"M": (n, n), "F": (n,), "E": (c,), "V": (c,), "J": (c, n), "B": (c,)})
        return Dynamics(out["M"], out["F"], out["E"], out["V"], out["J"], out["B"])

    def linearize(self, q: Any, u: Any, a: Any, nu: Any, time: Any = None) -> tuple[Any, Any, Any]:
        """Return K = ∂F/∂q, R = ∂F/∂u and D_q at fixed accelerations and multipliers.

        Parameters
        ----------
        q, u, a : array_like, shape (n_q,)
        nu : array_like, shape (n_c,)
            Multipliers [λ; μ].
        time : float, optional
        """
        n, c = self.n_q, self.n_c
        out = self._run("linearize", q, u, time, {"K": (n, n), "R": (n, n), "D": (c, n)}, a, nu)
        return out["K"], out["R"], out["D"][..., self.n_h :, :]

    def linearize_rows(self, q: Any, u: Any, a: Any, time: Any = None) -> tuple[Any, Any, Any]:
        """Return V_q = ∂V/∂q, and A_q = ∂A/∂q and A_u = ∂A/∂u of A = J a + B at fixed accelerations.

        With ∂V/∂u = ∂A/∂a = J, neighbours of a motion satisfy V_q Δq + J Δu = 0
        and A_q Δq + A_u Δu + J Δa = 0.

        Parameters
        ----------
        q, u, a : array_like, shape (n_q,)
        time : float, optional
        """
        shape = self.n_c, self.n_q
        out = self._run("linearize_rows", q, u, time, {"V_q": shape, "A_q": shape, "A_u": shape}, a)
        return out["V_q"], out["A_q"], out["A_u"]

    def _run(
        self,
        function: str,
        q: Any,
        u: Any,
        time: Any,
        shapes: dict[str, tuple[int, ...]],
        a: Any = None,
        nu: Any = None,
        what: What = "sum",
    ) -> dict[str, Any]:
        time = self.scene.time if time is None else time
        points = self.scene.points
        if points is None and isinstance(q, np.ndarray) and q.ndim == 2:
            points = len(q)
        if self._assembly is not None and points is None:
            found = self._assembly.outputs(function, (q, u, a, nu, time), shapes, what)
            if found is not None:
                return found
        plan = self._plans.get(function)
        if plan is None:
            plan = self._plans[function] = self._plan(function, shapes)
        if points is not None:
            from mbstab.compiler.at_points import MANY, matrices

            running = self._running(function)
            if points <= MANY:
                with suppress(ArithmeticError, ValueError):
                    return matrices(running, self.remember, function, (q, u, a, nu, time), points, plan, what)
        values = self._values(function, q, u, time, a, nu, points)
        if self.sparse and points is None:
            raise self._overflow(function, q, u, time, a, nu)
        if what == "sizes":
            values = [abs(x) for x in values]
        if points is not None:
            return plan.at_points(values, points)
        out = plan.matrices(values)
        if out is None:
            raise self._overflow(function, q, u, time, a, nu)
        return out

    def _values(
        self, function: str, q: Any, u: Any, time: Any, a: Any, nu: Any, points: int | None, report: bool = False
    ) -> list[Any]:
        """Return the results of all elements, one after the other; refuse infinite ones if they are asked for."""
        f = FLOAT if points else self.scene.arithmetic
        # Exact number systems must not be mixed with floats.
        zero = f.number("0") if f.name in ("ball", "digits") else 0.0
        q, u = padded(q, zero), padded(u, zero)
        a = padded(a, zero) if a is not None else None
        nu = padded(nu, zero) if nu is not None else None
        running = self._running(function)
        values: list[Any] = []
        for element in running:
            arguments = element.arguments(function, q, u, a, nu, time)
            if points is not None:
                f = arithmetic_of(arguments)
            try:
                own = getattr(element.kernel, function)(f, *arguments)
            except (ArithmeticError, ValueError) as error:
                place, named = self._location(element.path), self.scene.model.with_table(error)
                hint = self.scene.model.table_hint(named) or element.hint(error)
                raise NumericalError(
                    f"{place}: {element.path} has no finite equations here ({element.why(named)})\n{hint}"
                ) from None
            if report and not all(map(math.isfinite, own)):
                raise NumericalError(f"{self._location(element.path)}: {element.path}: {_OVERFLOW}")
            values.extend(own)
        return values

    def _overflow(self, function: str, q: Any, u: Any, time: Any, a: Any, nu: Any) -> NumericalError:
        """Return what to say where a matrix entry is not finite: of the first element whose results are not."""
        try:
            self._values(function, q, u, time, a, nu, None, report=True)
        except NumericalError as error:
            return error
        return NumericalError(f"the equations of motion: {_OVERFLOW}")

    def _location(self, path: str) -> Location:
        """Return the location of an entry in the file."""
        section, _, name = path.partition(".")
        model = self.scene.model
        if section == "balances":
            section, name = "bodies", name.partition(".")[0]
        return (model.bodies if section == "bodies" else model.entries[section])[name].location

    def _running(self, function: str) -> list[Placed]:
        """Return the elements that have this function: all, or those with rows."""
        return [element for element in self._elements if element.rows or function != "linearize_rows"]

    def _plan(self, function: str, shapes: dict[str, tuple[int, ...]]) -> Plan:
        """Return for each matrix which returned value is added to which entry."""
        elements = self._running(function)
        known = tuple((element.kernel, element.columns, element.rows) for element in elements)
        return plan_of(function, tuple(shapes.items()), known, self.n_q, self.n_c)


_OVERFLOW = (
    "an entry of the matrices is not finite\n"
    "hint: numbers of this size leave the range of double precision; use other units"
)


_TIME = Time()
_OF_ROWS: tuple[Role, ...] = ("holonomic", "nonholonomic")
