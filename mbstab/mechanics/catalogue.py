"""What a type of body, joint, contact, drive or force is made of, as data.

A `Kind` describes one type that a model file may name: its fields, with units and
documentation, and the elements it stands for. The reader, the JSON Schema and the
compiler all work from these tables, so a new type is one entry.

An `Element` is the smallest thing that has equations: a kinetic energy, one group of
constraint rows, or one force. Its definition stands in one function of numbers of any kind;
every derivative is derived from it when the package is built (`mbstab.compiler.derive`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal, Protocol

from mbstab.mechanics.frames import Frame
from mbstab.records import dataclass

Number = Any  # float, array of the points of a sweep, or any number of the arithmetic in use
Vector = tuple[Number, ...]

COORDINATES: dict[str, tuple[str, ...]] = {
    "planar": ("x", "y", "theta"),
    "spatial": ("x", "y", "z", "phi", "theta", "psi"),
    "coordinate": ("c",),
}
"""Coordinates of a slot of an element: a body of a planar or spatial scene, or any one coordinate."""

FRAMES = {2: "planar", 3: "spatial"}
"""Slots of the bodies of a scene, by its dimension."""

DIMENSIONS = {"coordinate": 0, **{frame: dimension for dimension, frame in FRAMES.items()}}
"""The number of coordinates of a slot that are those of a place."""

GROUND = -1

Sign = Literal["any", "positive", "nonnegative", "nonzero"]
"""Which values a number may have."""

Role = Literal["inertia", "force", "potential", "dissipation", "holonomic", "nonholonomic"]

ROWS: tuple[Literal["holonomic"], Literal["nonholonomic"]] = ("holonomic", "nonholonomic")
"""Roles of elements that have constraint rows."""


@dataclass(frozen=True)
class Element:
    """One group of equations, defined once.

    Attributes
    ----------
    name : str
        Without the frame; the kernel of the planar version is called ``planar_name``.
    role : str
        ``inertia``: `define` returns the Lagrangian T − V; ``force``: a `Load`;
        ``holonomic``: rows C(q, s); ``nonholonomic``: rows D(q, u, s).
    frames : tuple of str
        The kinds of slots for which it exists, keys of `COORDINATES`.
    slots : int
        Number of bodies (or coordinates) it connects.
    parameters : tuple of (str, int)
        Names and sizes of its constant numbers; size 0 stands for the dimension of the frame.
    signals : int
        Number of given functions of time.
    units : tuple of str
        Unit of each row; one unit stands for all rows.
    residual : str
        What a row is away from zero, where that is not plain.
    define : callable
        ``define(frames, parameters, signals)`` of frames, and of parameters by name and signals as `Column`.
    hint : str
        What to do where it has no finite equations.
    states : int
        Number of first-order states it contains; each is a slot after those of the bodies.
    measured : bool
        Whether its row is a measure: a function of its kernel gives all that the same one of expressions takes of it.
    """

    name: str
    role: Role
    frames: tuple[str, ...]
    slots: int
    parameters: tuple[tuple[str, int], ...]
    define: Callable[..., Any]
    signals: int = 0
    units: tuple[str, ...] = ()
    residual: str = "the residual"
    hint: str = ""
    states: int = 0
    measured: bool = False

    def slot_kinds(self, frame: str) -> list[str]:
        """Return the kinds of all its slots in a frame, keys of `COORDINATES`."""
        return [*[frame] * self.slots, *["coordinate"] * self.states]

    @property
    def on_coordinates(self) -> bool:
        """Whether it connects coordinates, not bodies."""
        return self.frames == ("coordinate",)


@dataclass(frozen=True)
class Load:
    """What a force element does: a potential, a dissipation function, virtual power, or several of them.

    Attributes
    ----------
    potential : expression
        V(q); the force is −∂V/∂q.
    dissipation : expression
        Φ(q, u); the force is −∂Φ/∂u.
    power : iterable of (force, velocity)
        Vectors; the generalized force is Σ (∂velocity/∂u)ᵀ force.
    """

    potential: Any = 0
    dissipation: Any = 0
    power: tuple[tuple[Any, Any], ...] = ()


@dataclass(frozen=True)
class Field:
    """One key of an entry in a model file.

    Attributes
    ----------
    shape : str
        What kind of field it is, one of those in `mbstab.model.fields`.
    unit : str
        SI unit; "" and "1" stand for everything without a declared unit.
    units : tuple of str
        Of what acts along the motion of a joint or a coordinate: the SI units for an angle and for a travel.
    made : bool
        Whether the program writes it, from the other fields.
    needs : tuple of str
        Fields that must be given with it.
    motions : tuple of str
        Of joints: the motion that each of them must have.
    most : float or None
        The largest value that a number may have.
    columns : tuple of str
        Of curves: the numbers of the entry that may be columns of the file instead.
    instead : str
        What to write instead of a number of the wrong sign.
    keys : tuple of Field
        Of a mapping: its own keys.
    """

    name: str
    shape: str
    doc: str
    unit: str = "1"
    required: bool = False
    default: str | None = None
    sign: Sign = "any"
    most: float | None = None
    choices: tuple[str, ...] = ()
    dimensions: tuple[int, ...] = (2, 3)
    made: bool = False
    needs: tuple[str, ...] = ()
    motions: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    instead: str = ""
    keys: tuple[Field, ...] = ()

    @property
    def text(self) -> str:
        """What it means, and its unit."""
        return self.doc + (f" ({self.unit})" if self.unit not in ("", "1") else "")

    def along(self, motion: str) -> Field:
        """Return the field with the unit for a motion, ``angle`` or ``displacement``, if it depends on it."""
        if not self.units or not motion:
            return self
        return replace(self, unit=self.units[0] if motion == "angle" else self.units[1])


class PartError(Exception):
    """The keys of an entry do not fit each other; `key` is the one to change."""

    def __init__(self, key: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.key, self.message, self.hint = key, message, hint


EFFORT = "the effort"
"""What `Product` calls the effort of an entry, N or N*m."""


@dataclass(frozen=True)
class Product:
    """A product in what an entry stands for: coefficient · factors · s^seconds has the unit of `gives`.

    Attributes
    ----------
    gives : str
        `EFFORT`, a state, an expression, or a few words for what stands nowhere else.
    factors : tuple of str
        The same.
    seconds : int
    key : str
        Of the entry, that has the coefficient; empty: the coefficient is 1.
    index : tuple of int
        Place of the coefficient in a list or a matrix.
    coefficient : str
        With all that multiplies it in the entry.
    """

    gives: str
    factors: tuple[str, ...] = ()
    seconds: int = 0
    key: str = ""
    index: tuple[int, ...] = ()
    coefficient: str = ""


@dataclass(frozen=True)
class Part:
    """What an entry with states of its own stands for: expressions, as they would stand in a file.

    Attributes
    ----------
    states : dict
        Their rates by name.
    effort : str
    products : tuple of Product
        What decides the units of the states, and what the coefficients must fit.
    units : dict
        Units of states that nothing else decides.
    """

    states: dict[str, str]
    effort: str
    products: tuple[Product, ...] = ()
    units: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Marker:
    """A point fixed in a body (or in the ground), in the frame of the body."""

    body: int
    point: Vector


@dataclass(frozen=True)
class Triad:
    """Three orthogonal unit vectors fixed in a body; `v1` is the axis of a joint."""

    v1: Vector
    v2: Vector
    v3: Vector


@dataclass(frozen=True)
class Moved:
    """A number that changes with the motion.

    Attributes
    ----------
    expression : Expression
        Of coordinates, rates, states and time.
    positive : bool
        Whether it must be positive; where it is not, the element has no finite equations.
    """

    expression: Any
    positive: bool


@dataclass(frozen=True)
class ElementUse:
    """One element at work in a scene.

    Attributes
    ----------
    element : str
        Name of the element, without the frame.
    slots : tuple of int
        Body numbers, or coordinate numbers where the element's frame is ``coordinate``, and of its states.
    parameters : tuple
        Its numbers, in the order of `Element.parameters`, flattened. Those of forces of power only, and of rows, may be
        `Moved`.
    laws : tuple
        Functions of time, as the model reader made them.
    labels : tuple of str
        A word for each row, for messages.
    """

    element: str
    slots: tuple[int, ...]
    parameters: Vector
    laws: tuple[Any, ...] = ()
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Effort:
    """The force or torque of an entry along one motion x, positive in the direction of x: −k (x − rest) − c ẋ + law.

    Attributes
    ----------
    motion : str
        ``distance`` of two points, ``angle`` or ``displacement`` of a joint, ``coordinate``, or ``point`` along a
        direction.
    of : Item
        The joint, or else the entry itself.
    stiffness, rest, damping : number
        Of a spring; in space the angle is the one within half a turn of the rest.
    law : Law or None
        The effort of an actuator as a function of time, or the motion that a drive gives by position.
    driven : bool
        Whether it is the reaction of the entry's constraint row.
    """

    motion: Literal["distance", "angle", "displacement", "coordinate", "point"]
    of: Item
    stiffness: Number = 0.0
    rest: Number = 0.0
    damping: Number = 0.0
    law: Any = None
    driven: bool = False


@dataclass(frozen=True)
class Form:
    """A shape to draw, its axis of symmetry along z, and its lengths (m).

    Attributes
    ----------
    name : str
        ``rod`` (length), ``cylinder`` (radius, length), ``cone`` (radius, length; tip up, a quarter of the length above
        the base its origin), ``hoop`` (radius), ``box`` (x, y, z), ``ellipsoid`` (its semi-axes), or ``torus`` (radius
        of the circle in its middle, radius of the tube).
    lengths : tuple
    """

    name: Literal["rod", "cylinder", "cone", "hoop", "box", "ellipsoid", "torus"]
    lengths: Vector


@dataclass(frozen=True)
class Look:
    """How an entry is drawn.

    Attributes
    ----------
    sign : str
        ``pin``: points are held together; ``slider``: they slide on each other; ``rod``: a bar between two pins;
        ``line``: a straight line between two points; ``spring``: windings between two; ``blade``: a line through a
        point; ``body``: a form about a point.
    points : tuple of Marker
    axis : tuple
        Direction of a blade, or of the axis of a form, in the axes of its body; without it that of a form is z.
    form : Form or None
    surface : (tuple, tuple) or None
        Unit normal and one point of the fixed line or plane that a form touches.
    """

    sign: Literal["pin", "slider", "rod", "line", "spring", "blade", "body"]
    points: tuple[Marker, ...]
    axis: Vector = ()
    form: Form | None = None
    surface: tuple[Vector, Vector] | None = None


class Item(Protocol):
    """An entry of a model with its numbers, as `Kind.build` sees it."""

    name: str
    kind: Kind
    dimension: int
    functions: Any
    """The functions of the number system in use: ``sqrt``, ``atan2``, …"""

    @property
    def state(self) -> int:
        """Number of the coordinate that is its own first-order state (`Kind.state`)."""

    def given(self, name: str) -> bool: ...  # noqa: D102
    def value(self, name: str) -> Any: ...  # noqa: D102
    def number(self, name: str) -> Number: ...  # noqa: D102
    def vector(self, name: str) -> Vector: ...  # noqa: D102
    def choice(self, name: str) -> str: ...  # noqa: D102
    def body(self, name: str) -> int: ...  # noqa: D102
    def marker(self, name: str) -> Marker: ...  # noqa: D102
    def markers(self, name: str) -> tuple[Marker, Marker]: ...  # noqa: D102
    def direction(self, name: str) -> Vector: ...  # noqa: D102
    def triads(self, axis: str, zero: str) -> tuple[Triad, Triad]: ...  # noqa: D102
    def coordinate(self, name: str) -> int: ...  # noqa: D102
    def joint(self, name: str) -> Item: ...  # noqa: D102
    def at_reference(self, body: int) -> Frame: ...  # noqa: D102
    def contact(self, name: str) -> Item: ...  # noqa: D102
    def law(self, name: str) -> Any: ...  # noqa: D102
    def laws(self, name: str) -> tuple[Any, ...]: ...  # noqa: D102


Build = Callable[[Item], Iterable[ElementUse]]


@dataclass(frozen=True)
class OwnState:
    """A first-order state that an entry has where one of its fields is given.

    Attributes
    ----------
    field : str
        Name of the field.
    suffix : str
        The state is called after the entry, ``NAME_suffix``.
    doc : str
        What it is.
    unit : str
    build : callable
        From the `Item` to the elements with the row of its rate.
    """

    field: str
    suffix: str
    doc: str
    unit: str
    build: Build


@dataclass(frozen=True)
class Kind:
    """One type that a model file may name.

    Attributes
    ----------
    name, doc : str
        The word after ``type:``, and what it stands for.
    dimensions : tuple of int
        In which scenes it exists: 2 planar, 3 spatial.
    fields : tuple of Field
        Its keys.
    build : callable
        From an `Item` to the elements it stands for.
    written : str or None
        Role of the equations that the file itself gives in its only field; `build` has no elements then.
    motions : tuple of str
        For joints: the motions a drive or a spring can act on (``angle``, ``displacement``).
    one_of : tuple of tuple of str
        Groups of fields of which exactly one must be given.
    some_of : tuple of str
        Fields of which at least one must be given: without them, an entry does nothing.
    effort : callable or None
        From an `Item` to its effort, if it acts along one motion.
    transmits : bool
        Whether a force is one between two points whose force and torque are listed with the reactions of joints.
    look : callable or None
        From an `Item` to how it is drawn, if it is.
    part : callable or None
        From what it acts along, its name and the texts of its keys (lists and mappings of texts) to a `Part`; the field
        ``on`` is made of it. Raises `PartError`.
    state : OwnState or None
        For forces: the first-order state that an entry may have.
    following : Kind or None
        What it is instead where one of its laws depends on the motion, not only on the time.
    """

    name: str
    doc: str
    dimensions: tuple[int, ...]
    fields: tuple[Field, ...]
    build: Build
    motions: tuple[str, ...] = ()
    one_of: tuple[tuple[str, ...], ...] = ()
    some_of: tuple[str, ...] = ()
    effort: Callable[[Item], Effort] | None = None
    look: Callable[[Item], tuple[Look, ...]] | None = None
    written: Role | None = None
    transmits: bool = False
    part: Callable[[str, str, Mapping[str, Any]], Part] | None = None
    state: OwnState | None = None
    following: Kind | None = None

    @cached_property
    def _by_name(self) -> dict[str, Field]:
        return {field.name: field for field in self.fields}

    def field(self, name: str) -> Field:
        """Return the field of that name."""
        return self._by_name[name]
