"""Expressions as sums of products with exact rational coefficients, in which structural zeros cancel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from fractions import Fraction
from functools import cached_property, partial, reduce
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.model.arithmetic import Arithmetic, array_arithmetic
from mbstab.model.expressions import Expression
from mbstab.model.functions import CALLED
from mbstab.model.rationals import FRACTIONS, meaning
from mbstab.model.scene import Scene
from mbstab.model.schema import Parameter
from mbstab.model.units import exact_factor
from mbstab.records import dataclass

ATOMS: WeakValueDictionary[tuple[str, str, tuple[Sum, ...]], Atom] = WeakValueDictionary()

ONE: Monomial = frozenset()


@dataclass(frozen=True, eq=False)
class Atom:
    """A factor that is not expanded further; equal ones are one object, made by `of`.

    Attributes
    ----------
    kind : str
        ``time``, ``state``, ``constant``, ``group`` (a sum kept together), ``power``, or the name of a function.
    name : str
        Name of a constant or of a coordinate, or ``rate(…)``.
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
        found = ATOMS.get(key)
        if found is None:
            found = ATOMS[key] = Atom(*key)
        return found

    def __reduce__(self) -> Any:
        return Atom.of, (self.kind, self.name, self.arguments)


Monomial = frozenset[tuple[Atom, int]]
"""A product of atoms with whole exponents."""


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
        if len(one.terms) * len(two.terms) > TOLERANCES.product_terms:
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


ZERO = Sum()


PI = Sum.of(Atom.of("constant", "pi"))


TIME = Sum.of(Atom.of("time"))


def _product(m: Monomial, n: Monomial) -> tuple[Monomial, Fraction]:
    """Return a product of monomials and a rational factor: squared square roots of rationals become rational."""
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
    """Return a/b if it is a rational number by structure, else None; b is not zero."""
    first, second = dict(a.terms), dict(b.terms)
    if first.keys() != second.keys():
        return None if first else Fraction(0)
    found = {c / second[m] for m, c in first.items()}
    return found.pop() if len(found) == 1 else None


def divided(x: Sum, by: Sum) -> Sum | None:
    """Return the sum of products q with x = q·by, if factors that `by` does not contain show it; else None."""
    inside = {atom for monomial, _ in by.terms for atom, _ in monomial}
    parts: dict[Monomial, Sum] = {}
    for monomial, coefficient in x.terms:
        own = frozenset(factor for factor in monomial if factor[0] in inside)
        parts[monomial - own] = parts.get(monomial - own, Sum()) + Sum(frozenset({(own, coefficient)}))
    found = {outside: ratio(part, by) for outside, part in parts.items()}
    if any(same is None for same in found.values()):
        return None
    return Sum(frozenset((outside, same) for outside, same in found.items() if same))


def _power(base: Sum, exponent: Sum) -> Sum:
    n = exponent.rational
    if n is None or n.denominator != 1:
        if n == Fraction(1, 2):
            return function("sqrt", base)
        if base.rational in (0, 1) and n is not None and n > 0:
            return base
        return Sum.of(Atom.of("power", arguments=(base, exponent)))
    whole = int(n)
    if not whole:
        return Sum.of(1)
    if whole < 0:
        return _power(base, -exponent).inverse()
    size = max((max(c.numerator.bit_length(), c.denominator.bit_length()) for _, c in base.terms), default=0)
    if size * whole > TOLERANCES.power_bits or (
        len(base.terms) > 1 and len(base.terms) ** whole > TOLERANCES.product_terms
    ):
        return Sum(frozenset({(frozenset({(Atom.of("group", arguments=(base,)), whole)}), Fraction(1))}))
    return reduce(lambda x, _: x * base, range(whole - 1), base)


def _kept(base: Sum, exponent: Sum) -> Sum:
    """Return a power in which a sum of several terms is kept together."""
    n = exponent.rational
    if len(base.terms) < 2 or n is None or n.denominator != 1 or n < 2:
        return _power(base, exponent)
    sign, kept = together(base)
    return Sum(frozenset({(frozenset({(kept, int(n))}), Fraction(sign) ** int(n))}))


def together(x: Sum) -> tuple[int, Atom]:
    """Return a sign and a sum kept together, which is x but for that sign, and the same for −x."""
    first = min(x.terms, key=lambda term: sorted((atom.kind, atom.name, n) for atom, n in term[0]))
    sign = 1 if first[1] > 0 else -1
    return sign, Atom.of("group", arguments=(x if sign > 0 else -x,))


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


def function(name: str, *arguments: Sum) -> Sum:
    """Return a function of sums; its value where that is rational by structure."""
    x, value = arguments[0], arguments[0].rational
    if name == "sqrt" and value is not None and value >= 0:
        return _root(value)
    if value is not None:
        if CALLED[name].joints:
            return Sum.of(getattr(FRACTIONS, name)(value))
        if len(arguments) == 1 and (known := CALLED[name].at(value)) is not None:
            return Sum.of(known)
    if name in ("sin", "cos") and (quarters := ratio(x, PI)) is not None and (2 * quarters).denominator == 1:
        return Sum.of((0, 1, 0, -1)[(int(2 * quarters) + (name == "cos")) % 4])
    return Sum.of(Atom.of(name, arguments=arguments))


class Structure:
    """The expressions of a scene as exact sums.

    Attributes
    ----------
    start : Sum
        The time of the reference.
    values : dict
        Values of constants that are not rational numbers: floats, or arrays over the points of a sweep.
    vague : set of str
        Constants whose value is not known.

    Parameters
    ----------
    scene : Scene
        A parameter with the value of its expression in the file is replaced by that expression, one
        with another value by its printed decimals. One that varies over the points of
        a sweep, or is only known to lie in an interval, keeps its name.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.values: dict[str, Any] = {"pi": math.pi}
        self.vague: set[str] = set()
        self._parameters: dict[str, Sum] = {}
        self._spans: dict[tuple[Atom, Sum], tuple[float, float]] = {}
        self.start = self.given(scene.model.reference.time, scene.time, "reference.time")

    def exact(
        self, expression: Expression, start: Sum | None = None, still: bool = False, expanded: bool = True
    ) -> Sum:
        """Return an expression as a sum.

        Parameters
        ----------
        start : Sum, optional
            The time (s) from which on the sum must hold: pieces that are over by then are left out.
        still : bool
            Whether all rates are zero.
        expanded : bool
            Whether powers of sums are expanded; otherwise the sums are kept together.

        Raises
        ------
        ExpressionError
            If it divides by zero.
        """
        names = {name: self._name(name) for name in expression.names()}
        rates = {name: Sum() if still else Sum.of(Atom.of("state", f"rate({name})")) for name in expression.rates()}
        return Sum.of(expression.evaluate(names, self.arithmetic(start, expanded), rates))

    def given(self, expression: Expression, value: Any, name: str, parameter: Parameter | None = None) -> Sum:
        """Return the exact value of a number of the scene: that of its expression, or of its decimals."""
        f = self.scene.arithmetic
        known = meaning(value, expression, self.scene.parameters, f, parameter)
        if known is not None:
            exact = self.exact(known.content) if isinstance(known.content, Expression) else Sum.of(known.content)
            return exact * exact_factor(known.unit, self.arithmetic()) if known.unit else exact
        self.values[name] = floats(value)
        if f.name not in ("float", "array", "digits"):
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

    def arithmetic(self, start: Sum | None = None, expanded: bool = True) -> Arithmetic:
        """Return the arithmetic of sums; with `start`, piecewise functions are replaced by their piece from then on."""
        functions: dict[str, Any] = {name: partial(self._call, name, start) for name in CALLED}
        constants = {"pi": PI, "deg": PI / 180}
        functions["power"] = _power if expanded else _kept
        return Arithmetic("sum", lambda text: Sum.of(Fraction(text)), constants, functions)

    def _call(self, name: str, start: Sum | None, *arguments: Sum) -> Sum:
        x = arguments[0]
        entry = CALLED[name]
        if start is not None and entry.outside is not None and x.rational is None:
            before, behind = entry.outside
            if self.nonnegative(x - entry.joints[-1], start):
                return Sum.of(behind(x))
            if self.nonnegative(entry.joints[0] - x, start):
                return Sum.of(before(x))
        return function(name, *arguments)

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
        if x.time or x.state:
            return None
        if self.uncertain(x):
            return self._enclosed_sign(x)
        value, size = self.value(x)
        rounding = TOLERANCES.constant_rounding * size
        return 1 if np.all(value > rounding) else -1 if np.all(value < -rounding) else None

    @property
    def settled(self) -> bool:
        """Whether all parameters have known values, not intervals."""
        return not any(self.uncertain(self._name(name)) for name in self.scene.parameters)

    def uncertain(self, x: Sum) -> bool:
        """Return whether it contains constants that are only known to lie in an interval."""
        return bool(self.vague & _constants(x))

    def _enclosed_sign(self, x: Sum) -> int | None:
        """Return the sign of products of such constants, from their intervals; None: not certain."""
        f, parameters = self.scene.arithmetic, self.scene.parameters
        total = f.number("0")
        for monomial, coefficient in x.terms:
            term = f.number(str(coefficient.numerator)) / f.number(str(coefficient.denominator))
            for atom, n in monomial:
                if atom.kind != "constant" or atom.name not in parameters or n < 0:
                    return None
                for _ in range(n):
                    term = term * parameters[atom.name]
            total = total + term
        return 1 if total > 0 else -1 if total < 0 else None

    def nonnegative(self, x: Sum, start: Sum) -> bool:
        """Return whether a function of time is certainly nonnegative from a time on."""
        if x.state:
            return False
        line = linear(x)
        if line is None:
            return self._span(x, start)[0] > 0.0
        return all(self.sign(part) in (0, 1) for part in (line[0], line[1] + line[0] * start))

    def _span(self, x: Sum, start: Sum) -> tuple[float, float]:
        """Return bounds of a function of time from a time on, with a margin for rounding."""
        low = high = room = 0.0
        for monomial, coefficient in x.terms:
            ends = (_float(coefficient),) * 2
            for atom, n in monomial:
                ends = _times(ends, _raised(self._bounds(atom, start), n))
            low, high = low + ends[0], high + ends[1]
            room += sum(abs(e) for e in ends if math.isfinite(e))
        return low - TOLERANCES.kink_distance * room, high + TOLERANCES.kink_distance * room

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
        entry = CALLED.get(atom.kind)
        if entry is not None and entry.rising:
            f = array_arithmetic()
            with np.errstate(all="ignore"):
                low, high = (float(getattr(f, atom.kind)(end)) for end in inside)
            return low, high
        return (-math.inf, math.inf) if entry is None else entry.span


def floats(value: Any) -> Any:
    """Return a number as a float, numbers at points as an array; nan for anything but real numbers."""
    try:
        return np.asarray(value, dtype=float) if hasattr(value, "shape") else float(value)
    except (TypeError, ValueError):
        return math.nan


def _float(x: Fraction) -> float:
    try:
        return float(x)
    except OverflowError:
        return math.copysign(math.inf, x.numerator)


def first_point(x: Any) -> float:
    """Return a number, or the first of those at the points of a sweep."""
    return float(np.ravel(x)[0])


def _times(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    # Zero times an unbounded factor is zero: infinite bounds are not attained.
    products = [x * y if x and y else 0.0 for x in a for y in b]
    return min(products), max(products)


def _raised(a: tuple[float, float], n: int) -> tuple[float, float]:
    """Return bounds of an integer power."""
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
