"""The table of the elementary functions: all that any number system, derivative, text or proof knows about one.

A new function is one entry of `FUNCTIONS`, at its end. What it needs:

* ``slopes``, its derivatives by its arguments in terms of the same functions: higher ones follow;
* ``formula``, its value in terms of the others, for number systems whose library does not have a function of its
  name. Without it every library must have one. Functions of Python's `math` are one operation of traced programs and
  of machine code; all others are the operations of their formula there;
* how its slope is bounded near a point (``steepest``), if it has no formula: for numbers that carry errors;
* where it is not analytic (``breaks``), and where its pieces meet (``joints``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from inspect import signature
from typing import Any, Literal

from mbstab.model.hermite import hermite
from mbstab.records import dataclass

Slope = Callable[[float], float]
"""The size of the slope of a function at a point; `math.inf` where it has none."""


@dataclass(frozen=True)
class Break:
    """A set of points where a function is not analytic.

    Attributes
    ----------
    where : callable
        From an arithmetic and the arguments to the quantities that all vanish there.
    text : str
        Where that is, in words.
    smooth : int
        Number of continuous derivatives of the function; −1: not even the value.
    zero : bool
        Whether the function vanishes there.
    square : bool
        Whether its square is analytic there.
    unless : callable, optional
        From an arithmetic and the arguments to a quantity; where it is positive all is well.
    """

    where: Callable[..., tuple[Any, ...]]
    text: str
    smooth: int = -1
    zero: bool = False
    square: bool = False
    unless: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Function:
    """A function of one or more numbers.

    Attributes
    ----------
    doc : str
        What it is.
    slopes : callable
        ``slopes(f, value, *arguments)``: its partial derivatives, in the arithmetic `f`; its arguments have their names
        from here.
    formula : callable or None
        ``formula(f, *arguments)``: its value in terms of other functions.
    unit : str
        ``free``: takes everything; ``plain``: takes numbers and angles; ``same``: the unit of its arguments;
        ``root``: the square root of it; ``ratio``: arguments of one unit, a plain result.
    parity : str
        ``odd`` or ``even``.
    exact : dict
        Rational values at rational points.
    steepest : callable or None
        ``steepest(slope, x, d)``: a bound of the size of the slope between x − d and x + d.
    breaks : tuple of Break
    joints : tuple of int
        Where its pieces meet, in ascending order.
    outside : pair of callables
        What it is before the first joint and behind the last one.
    span : (float, float)
        Bounds of its values.
    rising : bool
        Whether it nowhere decreases, and has values everywhere.
    half_turn : int
        By what it is multiplied when π is added to its argument; 0: it does not repeat.
    knots : int
        Of a function given by points: number of its continuous derivatives there; −1: it is not given by points.
    smoothed : bool
        Whether its last argument is the width over which it is smoothed, a positive constant.
    """

    doc: str
    slopes: Callable[..., tuple[Any, ...]]
    formula: Callable[..., Any] | None = None
    unit: Literal["free", "plain", "same", "root", "ratio"] = "plain"
    parity: Literal["odd", "even", ""] = ""
    exact: tuple[tuple[int, int], ...] = ()
    steepest: Callable[[Slope, float, float], float] | None = None
    breaks: tuple[Break, ...] = ()
    joints: tuple[int, ...] = ()
    outside: tuple[Callable[[Any], Any], Callable[[Any], Any]] | None = None
    span: tuple[float, float] = (-math.inf, math.inf)
    rising: bool = False
    half_turn: int = 0
    knots: int = -1
    smoothed: bool = False

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of its arguments."""
        return tuple(signature(self.slopes).parameters)[2:]

    @property
    def arguments(self) -> int:
        """How many arguments it takes."""
        return len(self.names)

    def breaks_at(self, arguments: int) -> tuple[Break, ...]:
        """Return where it is not analytic, if it has so many arguments."""
        if self.knots < 0:
            return self.breaks

        def at(i: int) -> Callable[..., tuple[Any, ...]]:
            return lambda f, *given: (given[0] - given[i],)

        first, *inner, last = range(1, arguments, 3)
        ends = [Break(at(i), "its table ends") for i in (first, last)]
        return (*ends, *(Break(at(i), "its argument is a point of the table", self.knots) for i in inner))

    def at(self, x: Fraction) -> int | None:
        """Return its value at a rational point where that is known to be a whole number."""
        return dict(self.exact).get(int(x)) if x.denominator == 1 else None


# --- where a slope is largest ---------------------------------------------------------------------------------------


def _outer(slope: Slope, x: float, d: float) -> float:
    """Return the largest slope of a function whose slope grows with the size of its argument."""
    return slope(abs(x) + d)


def _inner(slope: Slope, x: float, d: float) -> float:
    return slope(max(0.0, abs(x) - d))


def _upper(slope: Slope, x: float, d: float) -> float:
    return slope(x + d)


def _lower(slope: Slope, x: float, d: float) -> float:
    return slope(x - d)


def _within_one(slope: Slope, x: float, d: float) -> float:
    """Return it for a slope that is at most 1 and changes no faster than its argument."""
    return min(1.0, slope(x) + d)


def _before_a_pole(slope: Slope, x: float, d: float) -> float:
    return 2.0 * slope(x) if d * (1.0 + abs(math.tan(x))) < 0.1 else math.inf


# --- the table ------------------------------------------------------------------------------------------------------


def _smooth_start(f: Any, x: Any) -> Any:
    held = f.held(x)
    return held * held * (3 - 2 * held)


def _smooth_start_slopes(f: Any, value: Any, x: Any) -> tuple[Any, ...]:
    held = f.held(x)
    return (6 * held * (1 - held),)


def _atan2_slopes(f: Any, value: Any, y: Any, x: Any) -> tuple[Any, ...]:
    square = y * y + x * x
    return x / square, -y / square


def _sign_slopes(f: Any, value: Any, x: Any, w: Any) -> tuple[Any, ...]:
    far = f.hypot(x, w)
    cube = far * far * far
    return w * w / cube, -x * w / cube


def _max_slopes(f: Any, value: Any, a: Any, b: Any, w: Any) -> tuple[Any, ...]:
    far = f.hypot(a - b, w)
    part = (a - b) / far
    return (1 + part) / 2, (1 - part) / 2, w / (2 * far)


def _min_slopes(f: Any, value: Any, a: Any, b: Any, w: Any) -> tuple[Any, ...]:
    of_a, of_b, of_w = _max_slopes(f, value, a, b, w)
    return of_b, of_a, -of_w


def _saturate(f: Any, x: Any, lo: Any, hi: Any, w: Any) -> Any:
    # The difference of the two distances, without cancellation.
    above, below = f.hypot(x - lo, w), f.hypot(x - hi, w)
    return (lo + hi) / 2 + (hi - lo) * ((x - lo) + (x - hi)) / (2 * (above + below))


def _saturate_slopes(f: Any, value: Any, x: Any, lo: Any, hi: Any, w: Any) -> tuple[Any, ...]:
    above, below = f.hypot(x - lo, w), f.hypot(x - hi, w)
    first, second = (x - lo) / above, (x - hi) / below
    return (first - second) / 2, (1 - first) / 2, (1 + second) / 2, (w / above - w / below) / 2


def _derivative(name: str) -> Callable[..., tuple[Any, ...]]:
    """Return the slopes of a function given by points; those do not move."""

    def slopes(f: Any, value: Any, x: Any, *table: Any) -> tuple[Any, ...]:
        return getattr(f, name)(x, *table), *(0 for _ in table)

    return slopes


_AT_ZERO = "its argument is 0"
_NO_WIDTH = "its width is 0"
_AT_ONE = "its argument is 1 or -1"
_INSIDE_ONE = (
    Break(lambda f, x: (x - 1,), _AT_ONE),
    Break(lambda f, x: (x + 1,), _AT_ONE),
)

FUNCTIONS: dict[str, Function] = {
    "sin": Function(
        "sine", lambda f, value, x: (f.cos(x),), parity="odd", exact=((0, 0),),
        steepest=_within_one, span=(-1.0, 1.0), half_turn=-1,
    ),
    "cos": Function(
        "cosine", lambda f, value, x: (-f.sin(x),), parity="even", exact=((0, 1),),
        steepest=_within_one, span=(-1.0, 1.0), half_turn=-1,
    ),
    "tan": Function(
        "tangent", lambda f, value, x: (1 + value * value,), parity="odd", exact=((0, 0),),
        steepest=_before_a_pole, breaks=(Break(lambda f, x: (f.cos(x),), "it is infinite"),), half_turn=1,
    ),
    "asin": Function(
        "inverse sine", lambda f, value, x: (1 / f.sqrt(1 - x * x),), parity="odd", exact=((0, 0),),
        steepest=_outer, breaks=_INSIDE_ONE, span=(-math.pi / 2, math.pi / 2),
    ),
    "acos": Function(
        "inverse cosine", lambda f, value, x: (-1 / f.sqrt(1 - x * x),),
        steepest=_outer, breaks=_INSIDE_ONE, span=(0.0, math.pi),
    ),
    "atan": Function(
        "inverse tangent", lambda f, value, x: (1 / (1 + x * x),), parity="odd", exact=((0, 0),),
        steepest=_inner, span=(-math.pi / 2, math.pi / 2), rising=True,
    ),
    "atan2": Function(
        "angle of the point (second, first argument)", _atan2_slopes, unit="ratio",
        breaks=(Break(lambda f, y, x: (y,), "it jumps by a turn", unless=lambda f, y, x: x),),
        span=(-math.pi, math.pi),
    ),
    "sinh": Function(
        "hyperbolic sine", lambda f, value, x: (f.cosh(x),), parity="odd", exact=((0, 0),),
        steepest=_outer, rising=True,
    ),
    "cosh": Function(
        "hyperbolic cosine", lambda f, value, x: (f.sinh(x),), parity="even", exact=((0, 1),),
        steepest=_outer, span=(1.0, math.inf),
    ),
    "tanh": Function(
        "hyperbolic tangent", lambda f, value, x: (1 - value * value,), parity="odd", exact=((0, 0),),
        steepest=lambda slope, x, d: 1.0, span=(-1.0, 1.0), rising=True,
    ),
    "exp": Function(
        "exponential", lambda f, value, x: (value,), exact=((0, 1),),
        steepest=_upper, span=(0.0, math.inf), rising=True,
    ),
    "log": Function(
        "natural logarithm", lambda f, value, x: (1 / x,), exact=((1, 0),),
        steepest=_lower, breaks=(Break(lambda f, x: (x,), _AT_ZERO),),
    ),
    "sqrt": Function(
        "square root", lambda f, value, x: (1 / (2 * value),), unit="root",
        breaks=(Break(lambda f, x: (x,), _AT_ZERO, 0, zero=True),), span=(0.0, math.inf),
    ),
    "abs": Function(
        "absolute value", lambda f, value, x: (f.abs_slope(x),), unit="same", parity="even",
        breaks=(Break(lambda f, x: (x,), _AT_ZERO, 0, zero=True, square=True),),
        joints=(0,), outside=(lambda x: -x, lambda x: x), span=(0.0, math.inf),
    ),
    "smooth_start": Function(
        "0 before 0, 3 x**2 - 2 x**3 between 0 and 1, 1 after 1", _smooth_start_slopes, _smooth_start,
        breaks=(
            Break(lambda f, x: (x,), _AT_ZERO, 1, zero=True),
            Break(lambda f, x: (x - 1,), "its argument is 1", 1),
        ),
        joints=(0, 1), outside=(lambda x: 0, lambda x: 1), span=(0.0, 1.0), rising=True,
    ),
    "hypot": Function(
        "distance of the point (x, y) from the origin", lambda f, value, x, y: (x / value, y / value),
        lambda f, x, y: f.sqrt(x * x + y * y), unit="same", span=(0.0, math.inf),
        breaks=(Break(lambda f, x, y: (x, y), "both arguments are 0", 0, zero=True, square=True),),
    ),
    "sign": Function(
        "x/sqrt(x**2 + w**2), sign smoothed over the width w", _sign_slopes, lambda f, x, w: x / f.hypot(x, w),
        unit="ratio", parity="odd", breaks=(Break(lambda f, x, w: (x, w), _NO_WIDTH),), span=(-1.0, 1.0), smoothed=True,
    ),
    "min": Function(
        "(a + b - sqrt((a - b)**2 + w**2))/2, the smaller one smoothed over the width w: min(body.x, 0, 0.001)",
        _min_slopes, lambda f, a, b, w: (a + b - f.hypot(a - b, w)) / 2, unit="same",
        breaks=(Break(lambda f, a, b, w: (a - b, w), _NO_WIDTH),), smoothed=True,
    ),
    "max": Function(
        "(a + b + sqrt((a - b)**2 + w**2))/2, the larger one smoothed over the width w: max(body.x, 0, 0.001)",
        _max_slopes, lambda f, a, b, w: (a + b + f.hypot(a - b, w)) / 2, unit="same",
        breaks=(Break(lambda f, a, b, w: (a - b, w), _NO_WIDTH),), smoothed=True,
    ),
    "saturate": Function(
        "(lo + hi + sqrt((x - lo)**2 + w**2) - sqrt((x - hi)**2 + w**2))/2, x between lo and hi smoothed over the "
        "width w",
        _saturate_slopes, _saturate, unit="same", smoothed=True,
        breaks=(
            Break(lambda f, x, lo, hi, w: (x - lo, w), _NO_WIDTH),
            Break(lambda f, x, lo, hi, w: (x - hi, w), _NO_WIDTH),
        ),
    ),
}  # fmt: skip
"""Functions that an expression may call with numbers."""

TABULATED: dict[str, Function] = {
    "table": Function(
        "value of a table of the file: cubics that rise and fall only as the points do (Fritsch, Butland); one "
        "continuous derivative", _derivative("hermite1"), hermite(0), unit="free", knots=1,
    ),
    "spline": Function(
        "the same with two continuous derivatives: a cubic spline, with second derivative 0 at both ends",
        _derivative("hermite1"), hermite(0), unit="free", knots=2,
    ),
    "linear": Function(
        "the same with straight lines between the points; at a point it has no derivative",
        _derivative("linear1"), hermite(0, lines=True), unit="free", knots=0,
    ),
}  # fmt: skip
"""Functions given by points: an expression calls them with a number and the name of a table, evaluation with a number
and the points (`mbstab.model.hermite`)."""

CALLED = FUNCTIONS | TABULATED
"""Functions that an expression may call."""

AUXILIARY: dict[str, Function] = {
    "signum": Function("-1, 0 or 1", lambda f, value, x: (0 * x,), parity="odd"),
    "abs_slope": Function("the derivative of abs, which does not exist at 0", lambda f, v, x: (0 * x,), parity="odd"),
    "signed": Function(
        "x times the derivative of abs at y; 0 where both are 0",
        lambda f, value, x, y: (f.abs_slope(y), 0 * x),
        lambda f, x, y: x * f.abs_slope(y + (1 - f.abs(f.signum(y))) * (1 - f.abs(f.signum(x)))),
    ),
    "share": Function(
        "x/s where no x is larger than s; 0 where both are 0",
        lambda f, value, x, s: (1 / s, -value / s),
        lambda f, x, s: x / (s + (1 - f.abs(f.signum(s)))),
    ),
    "held": Function(
        "the number between 0 and 1 that is next to it", lambda f, v, x: ((f.signum(x) - f.signum(x - 1)) / 2,)
    ),
    "inside": Function("0 between 0 and 1, and no value elsewhere", lambda f, value, x: (0 * x,)),
    "hermite1": Function("first derivative of a function given by points", _derivative("hermite2"), hermite(1)),
    "hermite2": Function("second derivative of it", _derivative("hermite3"), hermite(2)),
    "hermite3": Function("third derivative of it", lambda f, v, x, *name: (0 * x, *(0 for _ in name)), hermite(3)),
    "linear1": Function(
        "slope of lines between points", lambda f, v, x, *name: (0 * x, *(0 for _ in name)), hermite(1, lines=True)
    ),
}
"""Functions in which others are written; every number system has its own of those without a formula."""

TABLE = CALLED | AUXILIARY
"""All functions of an arithmetic but ``power``."""

PIECED = tuple(name for name, function in CALLED.items() if function.joints or function.knots >= 0)
"""Functions that are put together from pieces."""

NATIVE = tuple(
    name
    for name, function in TABLE.items()
    if name == "abs" or hasattr(math, name) or (name in AUXILIARY and function.formula is None)
)
"""Functions that are one operation on floats."""
