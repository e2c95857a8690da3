"""Straight-line programs of small steps that can be differentiated.

Differentiating whole expression trees doubles their size with every derivative. A `Tape`
holds each subexpression once, as a numbered step; derivatives are more steps.

Two steps are the same if they agree at one random state, computed exactly in the integers
modulo a prime: inputs are random residues, the nine numbers of a base rotation a random rotation, sine and cosine of an
angle a random point of the unit circle, and the value of every other function an independent random residue. So
everything that follows from the rules of arithmetic, from sin² + cos² = 1 and from orthogonal axes is found: entries
that vanish identically are dropped and a symmetric matrix is computed once. Identities that hold for
some states only, such as |x| = x, are not found. The probability of an error is below 1e-30.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, lru_cache
from hashlib import sha256
from math import gcd, lcm
from types import SimpleNamespace
from typing import Any

from mbstab.model.arithmetic import Arithmetic
from mbstab.model.functions import TABLE
from mbstab.records import dataclass

PRIME = 2**127 - 1
ONE = 0
"""The step that is the number one."""

MAX_POWER = 100
"""Higher powers are left to the arithmetic."""

MAX_COEFFICIENT = 1000
"""Numerator and denominator of the literals that count as coefficients; the others keep their digits."""

Rational = int | Fraction
"""Whole numbers are kept as such, with which Python computes many times as fast."""

# --- steps ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Input:
    """A number that the program is given."""

    name: str


@dataclass(frozen=True, slots=True)
class Literal:
    """A number with its digits, or ``pi``."""

    text: str


@dataclass(frozen=True, slots=True)
class Sum:
    """Σ coefficient · step."""

    terms: tuple[tuple[int, Rational], ...]


@dataclass(frozen=True, slots=True)
class Product:
    """Π step ** exponent."""

    factors: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Call:
    """A function of an `Arithmetic` applied to coefficient · step, ...."""

    function: str
    arguments: tuple[tuple[int, Rational], ...]


Step = Input | Literal | Sum | Product | Call


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A rational number times a step; the number type in which a program is written."""

    tape: Tape
    coefficient: Rational
    step: int

    @property
    def is_zero(self) -> bool:
        """Whether this is the number zero."""
        return self.coefficient == 0

    @property
    def number(self) -> Rational | None:
        """The value of a rational number, None for anything else."""
        return self.coefficient if self.step == ONE else None

    def __neg__(self) -> Term:
        return Term(self.tape, -self.coefficient, self.step)

    def __add__(self, other: Any) -> Term:
        return self.tape.sum((self, self.tape.term(other)))

    def __sub__(self, other: Any) -> Term:
        return self.tape.sum((self, -self.tape.term(other)))

    def __mul__(self, other: Any) -> Term:
        if isinstance(other, tuple):  # the vector multiplies each of its components
            return NotImplemented
        return self.tape.product((self, self.tape.term(other)))

    def __truediv__(self, other: Any) -> Term:
        if isinstance(other, int):
            return Term(self.tape, _over(self.coefficient, other), self.step)
        return self.tape.product((self, self.tape.power(self.tape.term(other), self.tape.term(-1))))

    def __pow__(self, exponent: int) -> Term:
        return self.tape.power(self, self.tape.term(exponent))

    def __radd__(self, other: Any) -> Term:
        return self.tape.sum((self.tape.term(other), self))

    def __rsub__(self, other: Any) -> Term:
        return self.tape.sum((self.tape.term(other), -self))

    def __rmul__(self, other: Any) -> Term:
        return self.tape.product((self.tape.term(other), self))

    def __rtruediv__(self, other: Any) -> Term:
        return self.tape.product((self.tape.term(other), self.tape.power(self, self.tape.term(-1))))


# --- the tape -------------------------------------------------------------------------------------------------------


class Tape:
    """A growing program.

    Parameters
    ----------
    shares : bool
        Whether products with quotients by roots of sums of squares have a value where these are 0, if it is 0.

    Attributes
    ----------
    steps : list of Step
        Each after those it uses; the first is the number one.
    """

    def __init__(self, shares: bool = False) -> None:
        self.shares = shares
        self.steps: list[Step] = [Literal("1")]
        self._values = [1]
        self._inverses: dict[int, int] = {}
        self._depends = [0]  # which inputs a step depends on, as bits
        self._terms: dict[Step, Term] = {}
        self._by_value = {1: ONE}
        self._partials: dict[int, list[tuple[int, Term]]] = {}
        self._inputs = 0
        self._slopes_of_abs: set[int] = set()
        self._signed: dict[int, tuple[int, int]] = {}  # products with such slopes that have a value at 0, as factors
        self._norms: dict[int, frozenset[int]] = {}  # roots of sums of squares, and the steps that are squared
        self._over_norms: dict[int, frozenset[int]] = {}  # sums of quotients by such roots, and what is squared in them

    # --- making terms -----------------------------------------------------------------------------------------------

    def term(self, x: Term | Rational) -> Term:
        """Return a number as a term; terms are returned unchanged."""
        return x if isinstance(x, Term) else Term(self, x if isinstance(x, int) else _whole(Fraction(x)), ONE)

    def input(self, name: str) -> Term:
        """Return the input of that name."""
        return self._put(Input(name))

    def rotation(self, names: Sequence[str]) -> list[Term]:
        """Return the inputs of nine names, which are a rotation matrix row by row."""
        a, b, c, d = (random_residue(f"{names[0]} {x}") for x in "abcd")  # a quaternion
        over = pow(a * a + b * b + c * c + d * d, -1, PRIME)
        entries = [
            *(a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)),
            *(2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)),
            *(2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d),
        ]
        for name, entry in zip(names, entries, strict=True):
            if (step := Input(name)) not in self._terms:
                self._terms[step] = self._new(step, entry * over % PRIME)
        return [self.input(name) for name in names]

    def literal(self, text: str) -> Term:
        """Return the number written as `text`, or ``pi``."""
        if text == "pi":
            return self._put(Literal(text))
        value = Fraction(text)
        if max(abs(value.numerator), value.denominator) <= MAX_COEFFICIENT:
            return self.term(value)
        return self._put(Literal(text))

    def sum(self, terms: Iterable[Term]) -> Term:
        """Return the sum of terms."""
        total: dict[int, Rational] = {}
        for term in terms:
            total[term.step] = total.get(term.step, 0) + term.coefficient
        entries = sorted((step, c) for step, c in total.items() if c)
        if len(entries) < 2:
            return Term(self, _whole(entries[0][1]), entries[0][0]) if entries else self.term(0)
        # A common factor is taken out, so that multiples of a sum share its step.
        size = _over(gcd(*(c.numerator for _, c in entries)), lcm(*(c.denominator for _, c in entries)))
        content = size if sum(1 if c > 0 else -1 for _, c in entries) >= 0 else -size
        inner = self._put(Sum(tuple((step, _over(c, content)) for step, c in entries)))
        if self._norms:
            divisors = {factor for step, _ in entries for factor, e in self._factors(step) if e < 0}
            if divisors := divisors & self._norms.keys():
                self._over_norms[inner.step] = frozenset().union(*(self._norms[norm] for norm in divisors))
        return Term(self, _whole(content * inner.coefficient), inner.step)

    def product(self, factors: Iterable[Term]) -> Term:
        """Return the product of terms."""
        exponents = dict[int, int]()
        coefficient: Rational = 1
        for factor in factors:
            if factor.is_zero:
                return self.term(0)
            coefficient *= factor.coefficient
            for step, exponent in self._as_power(factor.step):
                exponents[step] = exponents.get(step, 0) + exponent
        if self._slopes_of_abs:
            number, exponents = self._without_slopes_of_abs(exponents)
            coefficient *= number
        if self._norms:
            if (parts := self._distributed(exponents)) is not None:
                rest = coefficient * self._raised(parts[1].items())
                return self.sum(Term(self, c, step) * rest for step, c in parts[0].terms)
            exponents = self._divided_by_norms(exponents)
        inner = self._raised(exponents.items())
        return Term(self, _whole(coefficient * inner.coefficient), inner.step)

    def _without_slopes_of_abs(self, exponents: dict[int, int]) -> tuple[Rational, dict[int, int]]:
        """Return factors in which x times the derivative of abs(x) is abs(x), and a number besides.

        The derivative has no value at 0, the product has one: so x*abs(x) has its derivative there. Any other factors
        that are 0 where x is take the sign of x: so has sin(x)*abs(x).
        """
        flat = self._flat(exponents)
        number: Rational = 1
        while len(flat) > 1 and (known := [step for step in self._signed.keys() & flat.keys() if flat[step] == 1]):
            step = max(known)
            flat = self._flat({**flat, step: 0, **{x: flat.get(x, 0) + 1 for x in self._signed[step]}})
        slopes = sorted(slope for slope in self._slopes_of_abs & flat.keys() if flat[slope] == 1)
        for slope in slopes:
            x, times = self._argument(slope)
            size = self.call("abs", Term(self, times, x))
            if flat.get(x, 0) > 0:
                number, factors = _over(number * size.coefficient, times), {slope: -1, x: -1, size.step: 1}
            elif flat.get(size.step, 0) > 0:
                number, factors = _over(number * times, size.coefficient), {slope: -1, size.step: -1, x: 1}
            else:
                continue
            for step, e in factors.items():
                flat[step] = flat.get(step, 0) + e
            number *= self._shortened(flat, size.step)
        rest = self._raised((step, e) for step, e in flat.items() if step not in slopes or e != 1)
        if self.shares and rest.number is None:
            last, number = rest.step, number * rest.coefficient
            for slope in (slope for slope in slopes if flat[slope] == 1):
                x, times = self._argument(slope)
                signed = self.call("signed", Term(self, 1, last), Term(self, times, x))
                self._signed[signed.step] = last, slope
                last, number = signed.step, number * signed.coefficient
            flat = {last: 1}
        return (number, flat) if slopes else (number, exponents)

    def _argument(self, step: int) -> tuple[int, Rational]:
        """Return the step of which a step is a function, and its coefficient."""
        known = self.steps[step]
        assert isinstance(known, Call)
        return known.arguments[0]

    def _shortened(self, flat: dict[int, int], x: int) -> Rational:
        """Divide x in factors by negative powers of x between -1 and 0, which have no value at 0; return a number."""
        number: Rational = 1
        for step, e in list(flat.items()):
            known = self.steps[step]
            if not isinstance(known, Call) or known.arguments[0][0] != x or not flat.get(x, 0) > 0:
                continue
            (_, times), *exponent = known.arguments
            if known.function == "sqrt" and e < 0:
                changes, number = {x: -1, step: 2}, _over(number, times)
            elif known.function == "power" and e == 1 and exponent[0][0] == ONE and exponent[0][1] < 0:
                power = self.power(Term(self, times, x), self.term(exponent[0][1] + 1))
                changes, number = {x: -1, step: -1, power.step: 1}, _over(number * power.coefficient, times)
            else:
                continue
            for changed, by in changes.items():
                flat[changed] = flat.get(changed, 0) + by
        return number

    def _divided_by_norms(self, exponents: dict[int, int]) -> dict[int, int]:
        """Return factors in which x*y/hypot(x, y) is x times the share of y in hypot(x, y): it has a value at 0."""
        divisors = {factor for step, e in exponents.items() for factor, n in self._factors(step) if e * n < 0}
        if not (divisors := divisors & self._norms.keys()):
            return exponents
        flat = self._flat(exponents)
        for norm in divisors:
            times, inside = -flat[norm], [step for step in sorted(self._norms[norm]) if flat.get(step, 0) > 0]
            if not 0 < times < sum(flat[step] for step in inside):
                continue
            flat[norm] = 0
            for step in inside:
                taken = min(times, flat[step])
                times -= taken
                flat[step] -= taken
                share = self.call("share", Term(self, 1, step), Term(self, 1, norm))
                flat[share.step] = flat.get(share.step, 0) + taken
        return flat

    def _distributed(self, exponents: dict[int, int]) -> tuple[Sum, dict[int, int]] | None:
        """Return a sum and the other factors of a product whose terms have a value at 0, unlike its factors."""
        flat = self._flat(exponents)
        divisors = self._norms.keys() & {step for step, e in flat.items() if e < 0}
        squared = frozenset[int]().union(*(self._norms[norm] for norm in divisors))
        for step, e in flat.items():
            known, over = self.steps[step], self._over_norms.get(step, frozenset())
            if not isinstance(known, Sum) or e != 1:
                continue
            inside = [{factor for factor, _ in self._factors(term)} for term, _ in known.terms]
            if over & flat.keys() or (squared and all(squared & x for x in inside)):
                return known, {other: x for other, x in flat.items() if other != step}
        return None

    def _squared(self, term: Term) -> frozenset[int]:
        """Return the steps whose squares add up to a term with positive coefficients; none if it is no such sum."""
        known = self.steps[term.step]
        terms = known.terms if isinstance(known, Sum) else ((term.step, 1),)
        powers = [self._as_power(step) for step, _ in terms]
        squares = all(len(power) == 1 and power[0][1] == 2 for power in powers)
        if not squares or any(term.coefficient * c < 0 for _, c in terms):
            return frozenset()
        return frozenset(power[0][0] for power in powers)

    def _flat(self, exponents: dict[int, int]) -> dict[int, int]:
        """Return the factors of a product, of which none is a product."""
        flat = dict[int, int]()
        for step, exponent in exponents.items():
            for factor, e in self._factors(step):
                flat[factor] = flat.get(factor, 0) + e * exponent
        return flat

    def _factors(self, step: int) -> list[tuple[int, int]]:
        """Return the factors of a product of products, others as themselves."""
        known = self.steps[step]
        if not isinstance(known, Product):
            return [(step, 1)]
        return [(inner, e * outer) for factor, outer in known.factors for inner, e in self._factors(factor)]

    def _raised(self, factors: Iterable[tuple[int, int]]) -> Term:
        """Return Π step ** exponent."""
        entries = tuple(sorted((step, e) for step, e in factors if e))
        if not entries:
            return self.term(1)
        if entries == ((entries[0][0], 1),):
            return Term(self, 1, entries[0][0])
        return self._put(Product(entries))

    def _as_power(self, step: int) -> Sequence[tuple[int, int]]:
        """Return a power of one step as that, anything else as itself to the power one."""
        if step == ONE:
            return ()
        known = self.steps[step]
        return known.factors if isinstance(known, Product) and len(known.factors) == 1 else ((step, 1),)

    def power(self, base: Term, exponent: Term) -> Term:
        """Return base ** exponent."""
        e = exponent.number
        if e is None or not -MAX_POWER <= e <= MAX_POWER:
            return self.call("power", base, exponent)
        if base.is_zero:
            if e < 0:
                raise ZeroDivisionError("division by zero")
            return self.term(0 if e > 0 else 1)
        if abs(e) == Fraction(1, 2):
            root = self.call("sqrt", base)
            return root if e > 0 else 1 / root
        times, number = e.numerator, base.coefficient
        large = max(abs(number.numerator), number.denominator) ** abs(times) > MAX_COEFFICIENT**4
        if e.denominator != 1 or large:
            return self.call("power", base, exponent)
        inner = self._raised([(step, times * k) for step, k in self._as_power(base.step)])
        return Term(self, _whole(Fraction(number) ** times * inner.coefficient), inner.step)

    def call(self, function: str, *arguments: Term) -> Term:
        """Return a function of `TABLE`, or ``power``, applied to terms."""
        term = self._put(Call(function, tuple((a.step, _whole(a.coefficient)) for a in arguments)))
        if function == "abs_slope":
            self._slopes_of_abs.add(term.step)
        if self.shares and function == "hypot":
            self._norms[term.step] = frozenset(a.step for a in arguments)
        elif self.shares and function == "sqrt" and (inside := self._squared(arguments[0])):
            self._norms[term.step] = inside
        return term

    def arithmetic(self) -> Arithmetic:
        """Return the arithmetic of terms, to write expressions on the tape."""
        pi = self.literal("pi")
        return Arithmetic("tape", self.literal, {"pi": pi, "deg": pi / 180}, vars(self._functions))

    @cached_property
    def _functions(self) -> SimpleNamespace:
        def function(name: str) -> Callable[..., Term]:
            return lambda *arguments: self.call(name, *map(self.term, arguments))

        return SimpleNamespace(**{name: function(name) for name in TABLE}, power=self.power)

    def _put(self, step: Step) -> Term:
        known = self._terms.get(step)
        if known is not None:
            return known
        value = self._value(step)
        term = self.term(0) if value == 0 else self._multiple(value) or self._new(step, value)
        self._terms[step] = term
        return term

    def _multiple(self, value: int) -> Term | None:
        """Return the known step that has this value, or its double, half or negative, as a term."""
        for times, over in _MULTIPLES:
            part = value * over % PRIME
            number = self._by_value.get(min(part, PRIME - part))
            if number is not None:
                return Term(self, times if self._values[number] == part else -times, number)
        return None

    def _new(self, step: Step, value: int) -> Term:
        number = self._by_value[min(value, PRIME - value)] = len(self.steps)
        self.steps.append(step)
        self._values.append(value)
        self._depends.append(self._dependence(step))
        return Term(self, 1, number)

    def _dependence(self, step: Step) -> int:
        if isinstance(step, Input):
            self._inputs += 1
            return 1 << (self._inputs - 1)
        depends = 0
        for used in uses(step):
            depends |= self._depends[used]
        return depends

    def _value(self, step: Step) -> int:
        values = self._values
        match step:
            case Sum():
                return sum(values[n] * residue(c) for n, c in step.terms) % PRIME
            case Product():
                result = 1
                for n, e in step.factors:
                    base = values[n]
                    if e < 0:
                        base, e = self._inverses.get(n) or self._inverted(n), -e
                    result = result * (base if e == 1 else pow(base, e, PRIME)) % PRIME
                return result
            case Literal() if step.text != "pi":
                return residue(Fraction(step.text))
            case Call("sin" | "cos"):
                return half_angle(step.function, str(step.arguments))
            case _:
                return random_residue(repr(step))

    def _inverted(self, number: int) -> int:
        """Return the inverse of the value of a step, which takes as long as many products."""
        self._inverses[number] = pow(self._values[number], -1, PRIME)
        return self._inverses[number]

    # --- derivatives ------------------------------------------------------------------------------------------------

    def tangent(self, rates: Mapping[Term, Term]) -> Callable[[Term], Term]:
        """Return the function that gives the derivative of a term where inputs, and what is known of them, change.

        Parameters
        ----------
        rates : dict
            Rates of inputs, and of terms whose rates need not be derived.
        """
        known = {name.step: rate / name.coefficient for name, rate in rates.items() if name.step != ONE}
        mask = self._mask(name for name in rates if isinstance(self.steps[name.step], Input))

        zero = self.term(0)

        def derivative(term: Term) -> Term:
            if not self._depends[term.step] & mask:
                return zero
            for step in self._below([term.step], mask, known):
                known[step] = self.sum(
                    partial * known[used] for used, partial in self.partials(step) if self._depends[used] & mask
                )
            return term.coefficient * known[term.step]

        return derivative

    def depends(self, term: Term, name: Term) -> bool:
        """Whether an input occurs in a term."""
        return bool(self._depends[term.step] & self._depends[name.step])

    def gradient(self, weighted: Iterable[tuple[Term, Term]], names: Sequence[Term]) -> list[Term]:
        """Return Σ weight · ∂term/∂name over pairs (weight, term) for some terms, of which all consist."""
        mask = self._mask(names)
        ends = {name.step for name in names}
        parts: dict[int, list[Term]] = {}
        for weight, term in weighted:
            parts.setdefault(term.step, []).append(term.coefficient * weight)
        queue = [-step for step in parts if self._depends[step] & mask]
        heapq.heapify(queue)
        while queue:
            step = -heapq.heappop(queue)
            adjoint = self.sum(parts[step])
            parts[step] = [adjoint]
            if step in ends:
                continue
            for used, partial in self.partials(step):
                if self._depends[used] & mask:
                    if used not in parts:
                        heapq.heappush(queue, -used)
                    parts.setdefault(used, []).append(adjoint * partial)
        return [self.sum(parts.get(name.step, ())) / name.coefficient for name in names]

    def _mask(self, names: Iterable[Term]) -> int:
        mask = 0
        for name in names:
            mask |= self._depends[name.step]
        return mask

    def _below(self, steps: list[int], mask: int, known: Mapping[int, Any]) -> list[int]:
        """Return the unknown steps that some steps are made of and that depend on masked inputs, in order."""
        found: set[int] = set()
        stack = list(steps)
        while stack:
            step = stack.pop()
            if step not in found and step not in known and self._depends[step] & mask:
                found.add(step)
                stack.extend(uses(self.steps[step]))
        return sorted(found)

    def partials(self, step: int) -> list[tuple[int, Term]]:
        """Return the steps that a step uses with its partial derivatives."""
        if step not in self._partials:
            self._partials[step] = self._differentiated(step)
        return self._partials[step]

    def _differentiated(self, number: int) -> list[tuple[int, Term]]:
        step = self.steps[number]
        match step:
            case Sum():
                return [(n, self.term(c)) for n, c in step.terms]
            case Product():
                found = []
                for i, (n, e) in enumerate(step.factors):
                    rest = [self._raised([(m, k - (i == j))]) for j, (m, k) in enumerate(step.factors)]
                    found.append((n, e * self.product(rest)))
                return found
            case Call():
                arguments = [Term(self, c, n) for n, c in step.arguments]
                slopes = self._slopes(step.function, Term(self, 1, number), arguments)
                return [(a.step, a.coefficient * slope) for a, slope in zip(arguments, slopes, strict=True)]
            case _:
                return []

    def _slopes(self, function: str, value: Term, arguments: list[Term]) -> tuple[Term, ...]:
        """Return the partial derivatives of a function by its arguments."""
        if function != "power":
            return tuple(map(self.term, TABLE[function].slopes(self._functions, value, *arguments)))
        base, exponent = arguments
        slope = exponent * self.power(base, exponent - 1)
        return slope, value * self.call("log", base) if self._depends[exponent.step] else self.term(0)


def uses(step: Step) -> Iterable[int]:
    """Return the numbers of the steps that a step uses."""
    match step:
        case Sum():
            return (n for n, _ in step.terms)
        case Product():
            return (n for n, _ in step.factors)
        case Call():
            return (n for n, _ in step.arguments)
        case _:
            return ()


def _whole(x: Rational) -> Rational:
    return x.numerator if x.denominator == 1 else x


def _over(x: Rational, y: Rational) -> Rational:
    """Return x / y."""
    return x * y if y in (1, -1) else _whole(Fraction(x) / y)


def residue(x: Rational) -> int:
    """Return the residue of a rational number."""
    if x.denominator == 1:
        return x.numerator % PRIME
    return x.numerator * _inverse(x.denominator) % PRIME


@lru_cache(maxsize=4096)
def _inverse(number: int) -> int:
    return pow(number, -1, PRIME)


_MULTIPLES: tuple[tuple[Rational, int], ...] = tuple((x, residue(_over(1, x))) for x in (1, 2, Fraction(1, 2)))
"""Multiples of steps that share them, and the residues of their inverses."""


def half_angle(function: str, angle: str) -> int:
    """Return the residue of the sine or cosine of an angle given by a text: a random point of the unit circle."""
    tangent = random_residue(f"half of {angle}")
    over = pow(1 + tangent * tangent, -1, PRIME)
    return (2 * tangent if function == "sin" else 1 - tangent * tangent) * over % PRIME


def random_residue(text: str) -> int:
    """Return a residue that looks random, always the same for a text."""
    return int.from_bytes(sha256(text.encode()).digest()) % PRIME
