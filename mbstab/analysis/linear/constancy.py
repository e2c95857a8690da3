"""What the expressions of a scene say about time and smoothness: decided on their structure, never by sampling.

Looking at the equations at some times can show that they change, never that they do not: steps
that hit the period see a constant stiffness, and ``tanh(t - 50)`` is constant to 1e-43 near t = 0.
So every expression that may contain the time t is written as a sum of products with exact
rational coefficients (`Sum`); what is neither a number nor a sum or product stays closed (`Atom`):
π, coordinates, t, functions of further sums. Parameters are replaced by their exact values. In
this form ``t - t`` and ``0*sin(t)`` vanish, and whether two frequencies have a rational ratio is
read off the coefficients. The form is not unique (``sin(t)**2 + cos(t)**2`` keeps its t), which
errs on the safe side: something constant may be called variable, never the reverse.

From the time of the reference on, an expression can be free of t, of first degree in it (given
positions only), periodic, or anything else. Pieces of ``smooth_start`` and ``abs`` that are over
by then are replaced by what they are from then on. Sums of periodic functions have a common period only if
the ratios of their frequencies are rational.

The same form tells where an expression has no second derivative with respect to the state.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache, partial, reduce
from typing import Any, Literal
from weakref import WeakValueDictionary

import numpy as np

from mbstab.analysis.reference.efforts import effort_unit
from mbstab.compiler.system import System
from mbstab.errors import counted
from mbstab.model.arithmetic import Arithmetic, array_arithmetic
from mbstab.model.expressions import Call, Expression, ExpressionError, Name
from mbstab.model.functions import FUNCTIONS, PIECED, Break
from mbstab.model.scene import ItemValues, Scene
from mbstab.model.schema import Parameter, is_length
from mbstab.model.units import exact_factor

TERMS = 100
"""Products with more terms are not multiplied out."""

BITS = 4000
"""Powers with longer numerators stay powers."""

LONGEST = 10**6
"""A common period of more periods of the fastest part is of no use: none is said to exist."""

WHOLE = 1e-12
"""A stated period is a multiple of the true one if the ratio is whole to this, relatively."""

ROUNDING = 1e-12
"""Values of constants are known to this, relative to the sum of the sizes of their terms."""

NEAR = 1e-9
"""The state is at a kink if a change of this size, relative to the sizes in the scene, leads there."""

Kind = Literal["affine", "settled", "periodic", "other"]
Role = Literal["position", "velocity", "force", "holonomic", "nonholonomic"]

LEADS = ("position", "holonomic")
"""Roles in which a term of first degree in t leads the motion at a constant rate; elsewhere it grows."""


NO_COMMON = "whose frequencies have no common period"


# --- exact sums of products -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Atom:
    """A factor that is not taken apart; equal ones are one object, made by `of`.

    Attributes
    ----------
    kind : str
        ``time``, ``state``, ``constant``, ``group`` (a sum kept together), ``power``, or the name of a function.
    name : str
        Of a constant, of a coordinate, or ``rate(…)``.
    arguments : tuple of Sum
    """

    kind: str
    name: str = ""
    arguments: tuple[Sum, ...] = ()
    time: bool = field(init=False, default=False)
    state: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        for kind in ("time", "state"):
            object.__setattr__(self, kind, self.kind == kind or any(getattr(a, kind) for a in self.arguments))

    @staticmethod
    def of(kind: str, name: str = "", arguments: tuple[Sum, ...] = ()) -> Atom:
        """Return the atom with this content."""
        key = kind, name, arguments
        found = _ATOMS.get(key)
        if found is None:
            found = _ATOMS[key] = Atom(*key)
        return found

    def __reduce__(self) -> Any:
        return Atom.of, (self.kind, self.name, self.arguments)


_ATOMS: WeakValueDictionary[tuple[str, str, tuple[Sum, ...]], Atom] = WeakValueDictionary()


Monomial = frozenset[tuple[Atom, int]]
"""A product of atoms with whole exponents."""

ONE: Monomial = frozenset()


@dataclass(frozen=True)
class Sum:
    """A sum of monomials with rational coefficients, none of which is zero; no terms: zero."""

    terms: frozenset[tuple[Monomial, Fraction]] = frozenset()

    @staticmethod
    def of(x: Any) -> Sum:
        """Return a number, an atom or a sum as a sum."""
        if isinstance(x, Sum):
            return x
        if isinstance(x, Atom):
            return Sum(frozenset({(frozenset({(x, 1)}), Fraction(1))}))
        return Sum(frozenset({(ONE, Fraction(x))}) if x else frozenset())

    @staticmethod
    def _from(terms: Mapping[Monomial, Fraction]) -> Sum:
        return Sum(frozenset((m, c) for m, c in terms.items() if c))

    @cached_property
    def time(self) -> bool:
        """Whether it contains t."""
        return any(atom.time for m, _ in self.terms for atom, _ in m)

    @cached_property
    def state(self) -> bool:
        """Whether it contains coordinates or rates."""
        return any(atom.state for m, _ in self.terms for atom, _ in m)

    @cached_property
    def rational(self) -> Fraction | None:
        """Its value, if it is a rational number by structure."""
        if not self.terms:
            return Fraction(0)
        ((monomial, coefficient),) = self.terms if len(self.terms) == 1 else ((None, Fraction(0)),)
        return coefficient if monomial == ONE else None

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __add__(self, other: Any) -> Sum:
        total = dict(self.terms)
        for m, c in Sum.of(other).terms:
            total[m] = total.get(m, Fraction(0)) + c
        return Sum._from(total)

    __radd__ = __add__

    def __neg__(self) -> Sum:
        return Sum(frozenset((m, -c) for m, c in self.terms))

    def __sub__(self, other: Any) -> Sum:
        return self + -Sum.of(other)

    def __rsub__(self, other: Any) -> Sum:
        return Sum.of(other) - self

    def __mul__(self, other: Any) -> Sum:
        one, two = self, Sum.of(other)
        if len(one.terms) * len(two.terms) > TERMS:
            one, two = (x if len(x.terms) < 2 else Sum.of(Atom.of("group", arguments=(x,))) for x in (one, two))
        total: dict[Monomial, Fraction] = {}
        for m, c in one.terms:
            for n, d in two.terms:
                product, factor = _product(m, n)
                total[product] = total.get(product, Fraction(0)) + c * d * factor
        return Sum._from(total)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Sum:
        other = Sum.of(other)
        same = ratio(self, other) if other else None
        return self * other.inverse() if same is None else Sum.of(same)

    def __rtruediv__(self, other: Any) -> Sum:
        return Sum.of(other) / self

    def inverse(self) -> Sum:
        """Return 1 over it.

        Raises
        ------
        ZeroDivisionError
            If it is zero.
        """
        if not self.terms:
            raise ZeroDivisionError("division by zero")
        if len(self.terms) > 1:
            return Sum(frozenset({(frozenset({(Atom.of("group", arguments=(self,)), -1)}), Fraction(1))}))
        ((monomial, coefficient),) = self.terms
        turned, factor = _product(ONE, frozenset((atom, -n) for atom, n in monomial))
        return Sum(frozenset({(turned, factor / coefficient)}))


def _product(m: Monomial, n: Monomial) -> tuple[Monomial, Fraction]:
    """Return a product of monomials and a rational factor: squares of square roots of rationals leave the root."""
    powers = dict(m)
    for atom, k in n:
        powers[atom] = powers.get(atom, 0) + k
    factor = Fraction(1)
    for atom, k in powers.items():
        if atom.kind == "sqrt" and not 0 <= k <= 1 and (inside := atom.arguments[0].rational):
            powers[atom] = k % 2
            factor *= inside ** (k // 2)
    return frozenset((atom, k) for atom, k in powers.items() if k), factor


def ratio(a: Sum, b: Sum) -> Fraction | None:
    """Return a/b where both are the same but for a rational factor, else None; b is not zero."""
    first, second = dict(a.terms), dict(b.terms)
    if first.keys() != second.keys():
        return None if first else Fraction(0)
    found = {c / second[m] for m, c in first.items()}
    return found.pop() if len(found) == 1 else None


def _power(base: Sum, exponent: Sum) -> Sum:
    n = exponent.rational
    if n is None or n.denominator != 1:
        if n == Fraction(1, 2):
            return _function("sqrt", base)
        if base.rational in (0, 1) and n is not None and n > 0:
            return base
        return Sum.of(Atom.of("power", arguments=(base, exponent)))
    whole = int(n)
    if not whole:
        return Sum.of(1)
    if whole < 0:
        return _power(base, -exponent).inverse()
    size = max((max(c.numerator.bit_length(), c.denominator.bit_length()) for _, c in base.terms), default=0)
    if size * whole > BITS or (len(base.terms) > 1 and len(base.terms) ** whole > TERMS):
        return Sum(frozenset({(frozenset({(Atom.of("group", arguments=(base,)), whole)}), Fraction(1))}))
    return reduce(lambda x, _: x * base, range(whole - 1), base)


def _root(x: Fraction) -> Sum:
    """Return the square root of a rational that is not negative, with the squares of small primes outside."""
    inside, outside = x.numerator * x.denominator, Fraction(1, x.denominator)
    for p in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31):
        while inside and inside % (p * p) == 0:
            inside, outside = inside // (p * p), outside * p
    whole = math.isqrt(inside)
    if whole * whole == inside:
        return Sum.of(outside * whole)
    return Sum.of(Atom.of("sqrt", arguments=(Sum.of(inside),))) * outside


FRACTIONS = Arithmetic("fraction", Fraction, {}, {"abs": abs, "held": lambda x: min(max(x, Fraction(0)), Fraction(1))})
"""The arithmetic of functions that are put together from polynomials."""


def _function(name: str, *arguments: Sum) -> Sum:
    """Return a function of sums; its value where that is rational by structure."""
    x, value = arguments[0], arguments[0].rational
    if name == "sqrt" and value is not None and value >= 0:
        return _root(value)
    if value is not None:
        if FUNCTIONS[name].joints:
            return Sum.of(getattr(FRACTIONS, name)(value))
        if len(arguments) == 1 and (known := FUNCTIONS[name].at(value)) is not None:
            return Sum.of(known)
    if name in ("sin", "cos") and (quarters := ratio(x, PI)) is not None and (2 * quarters).denominator == 1:
        return Sum.of((0, 1, 0, -1)[(int(2 * quarters) + (name == "cos")) % 4])
    return Sum.of(Atom.of(name, arguments=arguments))


PI = Sum.of(Atom.of("constant", "pi"))
TIME = Sum.of(Atom.of("time"))


# --- a scene in this form -------------------------------------------------------------------------------------------


class Structure:
    """The expressions of a scene as exact sums.

    Attributes
    ----------
    start : Sum
        The time of the reference.
    values : dict
        Values of the constants that are no rational numbers: floats, or arrays over the points of a sweep.
    vague : set of str
        Constants whose value is not known.

    Parameters
    ----------
    scene : Scene
        A parameter with the value of its expression in the file stands for that expression, one
        with another value for the decimals it is printed with. One that varies over the points of
        a sweep, or is only known to lie in an interval, keeps its name.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.values: dict[str, Any] = {"pi": math.pi}
        self.vague: set[str] = set()
        self._parameters: dict[str, Sum] = {}
        self._spans: dict[tuple[Atom, Sum], tuple[float, float]] = {}
        self.start = self.given(scene.model.reference.time, scene.time, "reference.time")

    def exact(self, expression: Expression, start: Sum | None = None) -> Sum:
        """Return an expression as a sum.

        Parameters
        ----------
        start : Sum, optional
            The time (s) from which on it is wanted: pieces that are over by then are left out.

        Raises
        ------
        ExpressionError
            If it divides by zero.
        """
        names = {name: self._name(name) for name in expression.names()}
        rates = {name: Sum.of(Atom.of("state", f"rate({name})")) for name in expression.rates()}
        return Sum.of(expression.evaluate(names, self.arithmetic(start), rates))

    def given(self, expression: Expression, value: Any, name: str, parameter: Parameter | None = None) -> Sum:
        """Return the exact value of a number that the scene has: that of its expression, or of its decimals."""
        f = self.scene.arithmetic
        plain = f.name in ("float", "array")
        default, exact = expression.evaluate(self.scene.parameters, f), Sum.of(1)
        if parameter is not None:
            factor = parameter.factor
            if factor != 1.0:
                exact = exact_factor(parameter.unit, self.arithmetic())
            # Just as the scene was made: in balls, not even a factor of 1 is without effect.
            default = default * (factor if plain or factor == 1.0 else exact_factor(parameter.unit, f))
            if plain and factor != 1.0 and not getattr(value, "ndim", 0) and not _same(default, value):
                in_unit = f"{float(value) / factor:.12g}"
                if float(in_unit) * factor == value:
                    return Sum.of(Fraction(in_unit)) * exact
        if _same(default, value):
            return self.exact(expression) * exact
        decimals = _decimals(value, f)
        if decimals is not None:
            return Sum.of(decimals)
        self.values[name] = _floats(value)
        if not plain and f.name != "mpmath":
            self.vague.add(name)
        return Sum.of(Atom.of("constant", name))

    def _name(self, name: str) -> Sum:
        if name == "t":
            return TIME
        if name not in self.scene.parameters:
            return Sum.of(Atom.of("state", name))
        if name not in self._parameters:
            parameter = self.scene.model.parameters[name]
            self._parameters[name] = self.given(parameter.expression, self.scene.parameters[name], name, parameter)
        return self._parameters[name]

    def arithmetic(self, start: Sum | None = None) -> Arithmetic:
        """Return the arithmetic of sums, with what pieces are from a time on if one is given."""
        functions: dict[str, Any] = {name: partial(self._call, name, start) for name in FUNCTIONS}
        constants = {"pi": PI, "deg": PI / 180}
        return Arithmetic("sum", lambda text: Sum.of(Fraction(text)), constants, functions | {"power": _power})

    def _call(self, name: str, start: Sum | None, *arguments: Sum) -> Sum:
        x = arguments[0]
        entry = FUNCTIONS[name]
        if start is not None and entry.outside is not None and x.rational is None:
            before, behind = entry.outside
            if self.nonnegative(x - entry.joints[-1], start):
                return Sum.of(behind(x))
            if self.nonnegative(entry.joints[0] - x, start):
                return Sum.of(before(x))
        return _function(name, *arguments)

    # --- values -----------------------------------------------------------------------------------------------------

    def value(self, x: Sum, names: Mapping[str, Any] | None = None) -> tuple[Any, Any]:
        """Return the value of a sum and the sum of the sizes of its terms; nan where there is none.

        Parameters
        ----------
        names : mapping, optional
            Values of ``t``, of coordinates and rates.
        """
        with np.errstate(all="ignore"):
            return self._value(x, self.values if names is None else {**self.values, **names}, {})

    def _value(self, x: Sum, names: Mapping[str, Any], known: dict[Atom, Any]) -> tuple[Any, Any]:
        total: Any = np.float64(0.0)
        size: Any = np.float64(0.0)
        for monomial, coefficient in x.terms:
            term: Any = np.float64(_float(coefficient))
            for atom, n in monomial:
                term = term * np.power(self._atom(atom, names, known), float(n))
            total, size = total + term, size + abs(term)
        return total, size

    def _atom(self, atom: Atom, names: Mapping[str, Any], known: dict[Atom, Any]) -> Any:
        if atom.kind in ("time", "state", "constant"):
            return np.asarray(names["t" if atom.kind == "time" else atom.name], dtype=float)
        if atom not in known:
            arguments = [self._value(x, names, known)[0] for x in atom.arguments]
            known[atom] = arguments[0] if atom.kind == "group" else getattr(array_arithmetic(), atom.kind)(*arguments)
        return known[atom]

    def sign(self, x: Sum) -> int | None:
        """Return the sign of a constant, the same at all points of a sweep; None: not certain."""
        if x.rational is not None:
            return (x.rational > 0) - (x.rational < 0)
        if x.time or x.state or self.vague & _constants(x):
            return None
        value, size = self.value(x)
        rounding = ROUNDING * size
        return 1 if np.all(value > rounding) else -1 if np.all(value < -rounding) else None

    def nonnegative(self, x: Sum, start: Sum) -> bool:
        """Whether a function of time is certainly not negative from a time on."""
        if x.state:
            return False
        line = linear(x)
        if line is None:
            return self._span(x, start)[0] > 0.0
        return all(self.sign(part) in (0, 1) for part in (line[0], line[1] + line[0] * start))

    def _span(self, x: Sum, start: Sum) -> tuple[float, float]:
        """Return bounds of a function of time from a time on, with room for rounding."""
        low = high = room = 0.0
        for monomial, coefficient in x.terms:
            ends = (_float(coefficient),) * 2
            for atom, n in monomial:
                ends = _times(ends, _raised(self._bounds(atom, start), n))
            low, high = low + ends[0], high + ends[1]
            room += sum(abs(e) for e in ends if math.isfinite(e))
        return low - NEAR * room, high + NEAR * room

    def _bounds(self, atom: Atom, start: Sum) -> tuple[float, float]:
        if atom.state or self.vague & _constants(Sum.of(atom)):
            return -math.inf, math.inf
        if not atom.time or atom.kind == "time":
            values = np.atleast_1d(self.value(start if atom.kind == "time" else Sum.of(atom))[0])
            low, high = float(values.min()), float(values.max())
            return (low, math.inf if atom.kind == "time" else high) if low <= high else (-math.inf, math.inf)
        key = atom, start
        if key not in self._spans:
            self._spans[key] = self._span(atom.arguments[0], start)
        inside = self._spans[key]
        if atom.kind == "group":
            return inside
        entry = FUNCTIONS.get(atom.kind)
        if entry is not None and entry.rising:
            f = array_arithmetic()
            with np.errstate(all="ignore"):
                low, high = (float(getattr(f, atom.kind)(end)) for end in inside)
            return low, high
        return (-math.inf, math.inf) if entry is None else entry.span


def _same(a: Any, b: Any) -> bool:
    """Whether two numbers of a number system are one."""
    if hasattr(a, "shape") or hasattr(b, "shape"):
        return bool(np.array_equal(a, b))
    if hasattr(a, "rad") and hasattr(b, "rad"):
        return bool(a.mid() == b.mid() and a.rad() == b.rad())
    try:
        return bool(a == b)
    except TypeError:
        return False


def _decimals(value: Any, f: Arithmetic) -> Fraction | None:
    """Return the decimals with which a number is printed, if it is no more than these; None for others."""
    if getattr(value, "ndim", 0):
        value = value.flat[0] if bool(np.all(value == value.flat[0])) else None
    if value is None or f.name == "symbol":
        return None
    try:
        text = repr(float(value))
        same = f.name in ("float", "array") or _same(f.number(text), value)
        return Fraction(text) if same else None
    except (TypeError, ValueError, OverflowError):
        return None


def _floats(value: Any) -> Any:
    try:
        return np.asarray(value, dtype=float) if hasattr(value, "shape") else float(value)
    except (TypeError, ValueError):
        return math.nan


def _float(x: Fraction) -> float:
    try:
        return float(x)
    except OverflowError:
        return math.copysign(math.inf, x.numerator)


def _first(x: Any) -> float:
    return float(np.ravel(x)[0])


def _times(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    # Zero times what has no bounds is zero: the bounds themselves are not reached.
    products = [x * y if x and y else 0.0 for x in a for y in b]
    return min(products), max(products)


def _raised(a: tuple[float, float], n: int) -> tuple[float, float]:
    """Return bounds of a whole power."""
    if n < 0:
        return (-math.inf, math.inf) if a[0] <= 0.0 <= a[1] else _raised((1.0 / a[1], 1.0 / a[0]), -n)
    found = reduce(_times, [a] * n)
    return (0.0, found[1]) if n % 2 == 0 and a[0] < 0.0 < a[1] else found


def _constants(x: Sum) -> set[str]:
    """Return the names of the constants in a sum."""
    return {atom.name for atom in atoms(x) if atom.kind == "constant"}


def atoms(x: Sum) -> set[Atom]:
    """Return the atoms of a sum, and those in their arguments."""
    found: set[Atom] = set()
    waiting = [x]
    while waiting:
        new = {atom for monomial, _ in waiting.pop().terms for atom, _ in monomial} - found
        found |= new
        waiting += [argument for atom in new for argument in atom.arguments]
    return found


def linear(x: Sum) -> tuple[Sum, Sum] | None:
    """Return b and a of a + b·t, with a constant b; None for other functions of time."""
    slope, rest = Sum(), Sum()
    for monomial, coefficient in x.terms:
        term = Sum(frozenset({(monomial, coefficient)}))
        if not term.time:
            rest = rest + term
            continue
        slope_here = term / TIME
        if slope_here.time or slope_here.state:
            return None
        slope = slope + slope_here
    return slope, rest


# --- how t enters ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TimeUse:
    """How the time enters one expression of the file, from the time of the reference on.

    Attributes
    ----------
    path : str
        The entry, such as ``forces.p`` or ``drives.spin``.
    text : str
        The shortest part of the expression that makes it depend on t in this way, as it is written in the file.
    kind : str
        ``affine``: a + b·t in a given position or a holonomic constraint; ``settled``: from the
        time of the reference on it is constant, or a + b·t as before; ``periodic``; or ``other``.
    slope : float (1/s)
        The rate b at which it leads a motion, also beside periodic terms; that of the first point of a sweep.
    leads : bool
        Whether there is such a rate at all, at some point of a sweep.
    angular : bool
        Whether what is given is an angle.
    period : float (s)
        Period of a periodic use, nan for others; that of the first point of a sweep.
    from_time : float or None (s)
        Where ``other`` becomes one of the other kinds, if that is known; the latest of all points of a sweep.
    later : str
        What it becomes then.
    why : str
        What is wrong with ``other``, if there is something to say.
    frequencies : tuple of Sum
        Exact frequencies (rad/s) of the periodic terms, now or from `from_time` on.
    """

    path: str
    text: str
    kind: Kind
    slope: float = 0.0
    leads: bool = False
    angular: bool = False
    period: float = math.nan
    from_time: float | None = None
    later: str = ""
    why: str = ""
    frequencies: tuple[Sum, ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class _Shape:
    """An expression as a function of time: steady (a + b·t), periodic besides, or other."""

    kind: Literal["steady", "periodic", "other"]
    slope: Sum = Sum()
    frequencies: tuple[Sum, ...] = ()
    why: str = ""


def _shape(x: Sum, role: Role) -> _Shape:
    found = _periodic(x)
    if found is None or (found[0] and role not in LEADS):
        return _Shape("other")
    slope, frequencies = found
    if not frequencies:
        return _Shape("steady", slope)
    if common(frequencies) is None:
        return _Shape("other", why=NO_COMMON)
    return _Shape("periodic", slope, frequencies)


@lru_cache(maxsize=1000)
def _periodic(x: Sum) -> tuple[Sum, tuple[Sum, ...]] | None:
    """Return b and frequencies of b·t + P(t), where P repeats whenever all frequencies have made whole turns.

    A product of sines and cosines of ω_i t with exponents n_i repeats once Σ n_i ω_i and all
    2 ω_i have made whole turns: then the signs that half turns bring along cancel.
    """
    slope = Sum()
    found: list[Sum] = []
    for monomial, coefficient in x.terms:
        moving = [(atom, n) for atom, n in monomial if atom.time]
        if not moving:
            continue
        if any(atom.kind == "time" for atom, _ in moving):
            line = linear(Sum(frozenset({(monomial, coefficient)})))
            if line is None:
                return None
            slope = slope + line[0]
            continue
        halves, total = [], Sum()
        for atom, n in moving:
            inside = _inside(atom)
            if inside is None:
                return None
            half, more = inside
            if half:
                halves.append(half * 2)
                total = total + half * n
            found += more
        found += [f for f in (total, *halves) if f]
    return slope, tuple(dict.fromkeys(found))


def _inside(atom: Atom) -> tuple[Sum, tuple[Sum, ...]] | None:
    """Return ω of a sine or cosine of ω·t, zero for other factors, and their frequencies; None: it does not repeat."""
    parts = [_periodic(x) for x in atom.arguments]
    if any(part is None for part in parts):
        return None
    known = [part for part in parts if part is not None]
    slope, found = known[0][0], tuple(f for _, more in known for f in more)
    entry = FUNCTIONS.get(atom.kind)
    if entry is not None and entry.half_turn and slope:
        return (slope, found) if entry.half_turn < 0 else (Sum(), (slope * 2, *found))
    if any(s for s, _ in known):
        return None
    if entry is not None and entry.parity == "even":
        square = _periodic(atom.arguments[0] * atom.arguments[0])
        found = found if square is None or square[0] else square[1]
    return Sum(), found


def common(frequencies: Sequence[Sum]) -> Sum | None:
    """Return the greatest common divisor of frequencies with rational ratios; None: not known to have one of use."""
    ratios = [ratio(f, frequencies[0]) for f in frequencies]
    known = [abs(r) for r in ratios if r]
    if len(known) < len(ratios):
        return None
    below = math.lcm(*(r.denominator for r in known))
    divisor = Fraction(math.gcd(*(int(r * below) for r in known)), below)
    return frequencies[0] * divisor if max(known) <= LONGEST * divisor else None


def _expressions(system: System) -> Iterator[tuple[str, Role, Expression, bool]]:
    """Yield path, role and text of everything that may contain t or the state, and whether it gives an angle."""
    for item in system.scene.items:
        entry = item.entry
        if entry.section == "constraints":
            constraint: Role = "holonomic" if item.kind.name == "holonomic" else "nonholonomic"
            yield entry.path, constraint, entry.values[constraint], False
            continue
        for known in item.kind.fields:
            if known.shape not in ("law", "law vector", "loads") or known.name not in entry.values:
                continue
            value = entry.values[known.name]
            role: Role = "force"
            if entry.section == "drives":
                role = "position" if known.name == "position" else "velocity"
            values = value.values() if isinstance(value, dict) else getattr(value, "values", (value,))
            angular = role == "position" and _is_angle(item)
            yield from ((entry.path, role, x, angular) for x in values)


def _is_angle(drive: ItemValues) -> bool:
    """Whether a drive gives an angle."""
    assert drive.kind.effort
    return effort_unit(drive.kind.effort(drive).motion, str(drive.entry.values.get("coordinate", ""))) == "N*m"


def time_uses(system: System) -> tuple[TimeUse, ...]:
    """Return where and how the time enters from the time of the reference on, in the order of the file."""
    return _uses(system)[1]


def _uses(system: System) -> tuple[Structure | None, tuple[TimeUse, ...]]:
    with_time = [
        x for x in _expressions(system) if any(isinstance(node, Name) and node.name == "t" for node in x[2].walk())
    ]
    if not with_time:
        return None, ()
    structure = Structure(system.scene)
    found = (_use(structure, *x) for x in with_time)
    return structure, tuple(use for use in found if use is not None)


def _use(structure: Structure, path: str, role: Role, expression: Expression, angular: bool) -> TimeUse | None:
    try:
        written = structure.exact(expression)
        if not written.time:
            return None
        x = structure.exact(expression, structure.start)
    except ExpressionError as error:
        return TimeUse(path, _cut(expression.text), "other", why=error.message)
    shape = _shape(x, role)
    text = _part(structure, expression, shape.kind)
    if shape.kind == "other":
        when, after = _later(structure, expression, role, x)
        return TimeUse(
            path, text, "other", angular=angular, period=_period(structure, after.frequencies), from_time=when,
            later=after.kind if when is not None else "", why=shape.why, frequencies=after.frequencies,
        )  # fmt: skip
    kind: Kind = "periodic" if shape.kind == "periodic" else "settled"
    if kind == "settled" and _shape(written, role).kind == "steady":
        kind = "affine"
    slope, period = _first(structure.value(shape.slope)[0]), _period(structure, shape.frequencies)
    return TimeUse(path, text, kind, slope, bool(shape.slope), angular, period, frequencies=shape.frequencies)


def _period(structure: Structure, frequencies: Sequence[Sum]) -> float:
    base = common(frequencies) if frequencies else None
    with np.errstate(all="ignore"):
        return math.nan if base is None else _first(2.0 * math.pi / abs(structure.value(base)[0]))


def _later(structure: Structure, expression: Expression, role: Role, x: Sum) -> tuple[float | None, _Shape]:
    """Return from when on an expression is constant or periodic, and what it is then, as far as known."""
    seen: list[float] = []
    for _ in range(4):
        ends = [(float(np.max(structure.value(end)[0])), end) for end in _ends(structure, x)]
        ends = [end for end in ends if math.isfinite(end[0]) and (not seen or end[0] > seen[-1])]
        if not ends:
            break
        when, exact = max(ends, key=lambda end: end[0])
        seen.append(when)
        x = structure.exact(expression, exact)
        shape = _shape(x, role)
        if shape.kind != "other":
            return when, shape
    return None, _Shape("other")


def _ends(structure: Structure, x: Sum) -> Iterator[Sum]:
    """Yield the times at which a piece of a function of time ends for good."""
    for atom in atoms(x):
        line = linear(atom.arguments[0]) if atom.kind in PIECED and atom.time else None
        if line is None or line[1].state or not (sign := structure.sign(line[0])):
            continue
        joints = FUNCTIONS[atom.kind].joints
        yield (joints[-1 if sign > 0 else 0] - line[1]) / line[0]


def _part(structure: Structure, expression: Expression, kind: str) -> str:
    """Return the shortest call in an expression that depends on t as the whole does; the whole if there is none."""
    found: list[str] = []
    for node in expression.walk():
        if isinstance(node, Call) and any(isinstance(x, Name) and x.name == "t" for x in Expression("", node).walk()):
            call = Expression("", node)
            if structure.exact(call).time:
                here = _shape(structure.exact(call, structure.start), "position")
                if here.kind == kind and (kind != "steady" or not here.slope):
                    found.append(_written(expression.text, node.position))
    return _cut(min(found, key=len) if found else expression.text)


def _written(text: str, at: int) -> str:
    """Return the call that begins at a position."""
    depth = 0
    for end in range(text.index("(", at), len(text)):
        depth += {"(": 1, ")": -1}.get(text[end], 0)
        if not depth:
            return text[at : end + 1]
    return text[at:]


def _cut(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


# --- sentences ------------------------------------------------------------------------------------------------------


def affine_drives(system: System) -> tuple[TimeUse, ...]:
    """Return the uses with a term b·t that leads the motion; whether that shift is a symmetry is decided elsewhere."""
    return tuple(use for use in time_uses(system) if use.leads)


def common_period(system: System) -> float:
    """Return the common period (s) of all that is periodic, for the first point of a sweep; nan if there is none."""
    structure, uses = _uses(system)
    return math.nan if structure is None else _period(structure, [f for use in uses for f in use.frequencies])


def time_doubt(system: System, broken: Container[str] = ()) -> str:
    """Return why the equations are not known to be constant from the time of the reference on; empty: they are.

    Parameters
    ----------
    system : System
        Whose file states no period.
    broken : container of str
        Paths of entries among `affine_drives` whose shift is no symmetry of the rest.
    """
    structure, uses = _uses(system)
    led = [use for use in uses if use.leads and use.path in broken]
    doubts = [use for use in uses if use.kind in ("other", "periodic")]
    if structure is None or not (led or doubts):
        return ""
    others = [use for use in doubts if use.kind == "other"]
    now = _first(structure.value(structure.start)[0])
    none = f"the numbers are those of t = {now:.10g} s and say nothing about stability"
    if led:
        return f"{_through(led)}, and the motion it leads to is no symmetry of the rest: {none}"
    hopeless = [use for use in others if use.from_time is None]
    if hopeless:
        return f"{_through(hopeless)}{_reason(hopeless)}: {none}"
    frequencies = [f for use in doubts for f in use.frequencies]
    base = common(frequencies) if frequencies else None
    if frequencies and base is None:
        return f"{_through(doubts)}, {NO_COMMON}: {none}"
    repeating = f"periodic with {_in_words(structure, base)}" if base is not None else ""
    if not others:
        return f"{_through(doubts)}, {repeating}: {none}; give reference.period for a verdict"
    when = max(use.from_time for use in others if use.from_time is not None)
    after, keys = repeating or "constant", "reference.time" + " and reference.period" * bool(repeating)
    return f"{_through(others)}: {none}; from t = {when:.10g} s on they are {after}: give {keys}"


def _in_words(structure: Structure, frequency: Sum) -> str:
    """Return the period of a frequency."""
    with np.errstate(all="ignore"):
        periods = np.ravel(2.0 * math.pi / abs(structure.value(frequency)[0]))
    same = bool(np.all(periods == periods[0]))
    return f"{periods[0]:.10g} s" if same else "a period that depends on the point of the sweep"


def period_doubt(system: System, period: Any, broken: Container[str] = ()) -> str:
    """Return why the equations are not known to repeat after a period; empty: they do, or are constant.

    Parameters
    ----------
    system : System
    period : float or ndarray (s)
        The stated period; an array over the points of a sweep.
    broken : container of str
        As in `time_doubt`.
    """
    structure, uses = _uses(system)
    if structure is None:
        return ""
    others = [use for use in uses if use.kind == "other"]
    if others:
        return f"{_through(others)}{_reason(others)}: a period says nothing about their stability"
    led = [use for use in uses if use.leads and use.path in broken]
    if led:
        return f"{_through(led)}, and the motion it leads to is no symmetry of the rest: it does not repeat"
    stated = _stated(structure, period)
    for use in uses:
        for frequency in use.frequencies:
            turns = frequency * stated / (PI * 2)
            exact = turns.rational
            if exact is not None and exact.denominator == 1:
                continue
            values = np.asarray(structure.value(turns)[0], dtype=float)
            whole = np.abs(np.round(values))
            if not np.all((whole >= 1.0) & (np.abs(np.abs(values) - whole) <= WHOLE * whole)):
                own = f"repeats after {use.period:.10g} s"
                return f"{_through([use])}, which {own}: {_first(period):.10g} s is no whole multiple of it"
    return ""


def _stated(structure: Structure, period: Any) -> Sum:
    """Return a stated period as a sum: exactly what the file says, if it is that."""
    scene = structure.scene
    if scene.period is not None and scene.model.reference.period is not None and _same(scene.period, period):
        return structure.given(scene.model.reference.period, scene.period, "reference.period")
    structure.values["stated period"] = _floats(period)
    return Sum.of(Atom.of("constant", "stated period"))


def _through(uses: Iterable[TimeUse]) -> str:
    shown = list(dict.fromkeys(f"{use.path} ({use.text})" for use in uses))
    more = f" and {counted(len(shown) - 3, 'more place')}" if len(shown) > 3 else ""
    return f"the equations depend on time through {', '.join(shown[:3])}{more}"


def _reason(uses: Iterable[TimeUse]) -> str:
    why = next((use.why for use in uses if use.why), "")
    return f", {why}" if why else ""


# --- smoothness -----------------------------------------------------------------------------------------------------

SMOOTH = 99
"""Number of continuous derivatives where there is no kink."""

Place = tuple[int, Atom, str]
"""How many derivatives are continuous (−1: not even the value), of which factor, and where."""


def kinks(system: System, q: Any, u: Any, time: Any, order: int = 2, along: bool = False) -> str:
    """Return where an expression has not as many continuous derivatives with respect to the state as wanted.

    Only expressions of the file are looked at: forces and constraints. A state within rounding
    of a kink counts as being there.

    Parameters
    ----------
    q, u : array_like, shape (…, n_q)
        Coordinates (m, rad) and speeds of the reference.
    time : float or array_like, shape (…) (s)
    order : int
        Number of derivatives that must be continuous.
    along : bool
        Whether the states are those of one motion, which passes also what lies between two of them.

    Returns
    -------
    str
        A sentence, or nothing.
    """
    state = set(system.names)
    corners: _Corners | None = None
    for path, role, expression, _ in _expressions(system):
        if role in ("position", "velocity") or not (state & expression.names().keys() or expression.rates()):
            continue
        corners = corners or _Corners(Structure(system.scene), system, q, u, time, along)
        try:
            place = corners.worst(corners.structure.exact(expression))
        except ExpressionError as error:
            return f"the equations are not smooth at the reference: {path} ({_cut(expression.text)}): {error.message}"
        if place is not None and place[0] < order:
            text = corners.text(expression, place[1])
            missing = {-1: "is not continuous", 0: "has no derivative"}.get(place[0], "has no second derivative")
            return f"the equations have a kink at the reference: {path} ({text}) {missing} where {place[2]}"
    return ""


class _Corners:
    """Looks for kinks of sums at a state."""

    def __init__(self, structure: Structure, system: System, q: Any, u: Any, time: Any, along: bool = False) -> None:
        self.structure, self.along = structure, along
        q, u = np.asarray(q, dtype=float), np.asarray(u, dtype=float)
        lengths = np.array([is_length(name) for name in system.names], dtype=bool)
        known = max((abs(float(x)) for x in system.scene.lengths), default=0.0) or 1.0
        sizes = np.where(lengths, max(known, float(np.max(np.abs(q[..., lengths]), initial=0.0))), 1.0)
        speed = max(1.0, float(np.max(np.abs(u) / sizes, initial=0.0)))
        self.names: dict[str, Any] = {"t": np.asarray(time, dtype=float)}
        self._worst: dict[Sum, Place | None] = {}
        self.steps: dict[str, Any] = {}
        for i, name in enumerate(system.names):
            self.names[name], self.names[f"rate({name})"] = q[..., i], u[..., i]
            self.steps[name] = NEAR * max(float(np.max(np.abs(q[..., i]))), sizes[i])
            self.steps[f"rate({name})"] = NEAR * speed * sizes[i]

    def near(self, x: Sum) -> bool:
        """Whether a sum is zero within rounding, or has no value."""
        value, size = self.structure.value(x, self.names)
        if self.along and np.any(value > 0.0) and np.any(value < 0.0):
            return True
        room = ROUNDING * size
        for name in {atom.name for atom in atoms(x) if atom.kind == "state"}:
            moved = [
                abs(self.structure.value(x, {**self.names, name: self.names[name] + step})[0] - value)
                for step in (-self.steps[name], self.steps[name])
            ]
            room = room + np.maximum(*moved)
        return not bool(np.all(np.abs(value) > room))

    def worst(self, x: Sum) -> Place | None:
        """Return the place with the fewest continuous derivatives, or None if there is no kink."""
        if x in self._worst:
            return self._worst[x]
        found: list[Place] = []
        for monomial, _ in x.terms:
            for atom, n in monomial:
                if not atom.state:
                    continue
                derivatives, where = self._derivatives(atom, n, monomial)
                if derivatives < SMOOTH:
                    found.append((derivatives, atom, where))
                inner = atom.arguments
                if atom.kind == "power" and (size := _absolute(inner[0])) is not None:
                    inner = size[0].arguments
                found += [place for argument in inner if (place := self.worst(argument)) is not None]
        self._worst[x] = min(found, key=lambda place: place[0]) if found else None
        return self._worst[x]

    def _derivatives(self, atom: Atom, n: int, monomial: Monomial) -> tuple[int, str]:
        """Return how many derivatives of a product are continuous as far as one factor is concerned, and where not."""
        x = atom.arguments[0] if atom.arguments else Sum.of(atom)
        if atom.kind == "power":
            return self._of_power(atom)
        if atom.kind in ("group", "state"):
            return (-1, "it divides by 0") if n < 0 and self.near(x) else (SMOOTH, "")
        found = [(self._smooth(where, atom, n, monomial), where.text) for where in self._met(atom)]
        return min(found, default=(SMOOTH, ""))

    def _met(self, atom: Atom) -> Iterator[Break]:
        """Yield the breaks of a function near which the state is."""
        f = self.structure.arithmetic()
        for where in FUNCTIONS[atom.kind].breaks if atom.kind in FUNCTIONS else ():
            if all(map(self.near, where.where(f, *atom.arguments))):
                saving = None if where.unless is None else where.unless(f, *atom.arguments)
                if saving is None or self.near(saving) or not np.all(self.structure.value(saving, self.names)[0] > 0.0):
                    yield where

    @staticmethod
    def _smooth(where: Break, atom: Atom, n: int, monomial: Monomial) -> int:
        """Return how many derivatives of a power of a function are continuous at a break."""
        if where.zero and n < 0:
            return -1
        if where.square and n % 2 == 0:
            return SMOOTH
        if where.zero and atom.kind in PIECED:
            return n * (where.smooth + 1) - 1 + _zeros(atom.arguments[0], monomial)
        return where.smooth

    def _of_power(self, atom: Atom) -> tuple[int, str]:
        base, exponent = atom.arguments
        if not base.state or not self.near(base):
            return SMOOTH, ""
        size, n = _absolute(base), exponent.rational
        smooth = math.ceil(size[1] * n) - 1 if size is not None and n is not None and n > 0 else -1
        return smooth, "the base of a power is 0"

    def text(self, expression: Expression, atom: Atom) -> str:
        """Return a function in an expression as it is written, or the whole expression."""
        for node in expression.walk():
            if isinstance(node, Call) and node.function == atom.kind:
                arguments = tuple(self.structure.exact(Expression("", x)) for x in node.arguments)
                if arguments == atom.arguments:
                    return _cut(_written(expression.text, node.position))
        return _cut(expression.text)


def _absolute(x: Sum) -> tuple[Atom, int] | None:
    """Return abs(…) and n of a multiple of abs(…)**n, else None."""
    if len(x.terms) != 1:
        return None
    ((monomial, _),) = x.terms
    pair = next(iter(monomial)) if len(monomial) == 1 else None
    return pair if pair is not None and pair[0].kind == "abs" and pair[1] > 0 else None


def _zeros(x: Sum, monomial: Monomial) -> int:
    """Return how often a factor that is zero with x stands in a product beside a function of x."""
    if len(x.terms) != 1:
        return 0
    ((inside, _),) = x.terms
    if len(inside) != 1:
        return 0
    ((atom, n),) = inside
    return max(dict(monomial).get(atom, 0), 0) if n == 1 else 0
