"""Time dependence and smoothness of the expressions of a scene, decided from their structure, never by sampling.

Sampling the equations at some times can show that they change, never that they do not: steps
equal to the period see a constant stiffness, and ``tanh(t - 50)`` is constant to 1e-43 near t = 0.
Therefore every expression that may contain the time t is written as a sum of products with exact
rational coefficients (`Sum`); whatever is not a number, sum or product is not taken apart (`Atom`):
π, coordinates, t, functions of further sums. Parameters are replaced by their exact values. In
this form ``t - t`` and ``0*sin(t)`` vanish, and whether two frequencies have a rational ratio is
read off the coefficients. The form is not unique (``sin(t)**2 + cos(t)**2`` keeps its t), which
errs on the safe side: a constant may be taken as variable, never the reverse.

From the time of the reference on, an expression can be free of t, of first degree in it (given
positions only), periodic, or anything else. Pieces of ``smooth_start`` and ``abs`` that are over
by then are replaced by their values from then on. Sums of periodic functions have a common period only if
the ratios of their frequencies are rational.

The same form tells where an expression has no second derivative with respect to the state.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import field
from fractions import Fraction
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from mbstab.analysis.verdict.exact_sums import (
    PI,
    ZERO,
    Atom,
    Structure,
    Sum,
    atoms,
    first_point,
    floats,
    linear,
    ratio,
)
from mbstab.analysis.verdict.tolerances import TOLERANCES
from mbstab.analysis.verdict.written import Role, cut, with_time
from mbstab.compiler.system import System
from mbstab.errors import counted
from mbstab.model.expressions import Call, Expression, ExpressionError, Name
from mbstab.model.functions import CALLED, PIECED
from mbstab.model.rationals import same_number
from mbstab.records import dataclass

Kind = Literal["affine", "settled", "periodic", "other"]

LEADS = ("position", "holonomic")
"""Roles in which a term of first degree in t drives the motion at a constant rate; elsewhere it grows."""


NO_COMMON = "whose frequencies have no common period"


# --- exact sums of products -----------------------------------------------------------------------------------------


# --- a scene in this form -------------------------------------------------------------------------------------------


# --- how t enters ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TimeUse:
    """How one expression of the file depends on time, from the time of the reference on.

    Attributes
    ----------
    path : str
        The entry, such as ``forces.p`` or ``drives.spin``.
    text : str
        The shortest part of the expression that depends on t in this way, as written in the file.
    kind : str
        ``affine``: a + b·t in a given position or a holonomic constraint; ``settled``: from the
        time of the reference on it is constant, or a + b·t as before; ``periodic``; or ``other``.
    slope : float (1/s)
        The rate b at which it drives a motion, also beside periodic terms; at the first point of a sweep.
    leads : bool
        Whether there is such a rate at all, at some point of a sweep.
    angular : bool
        Whether the expression gives an angle.
    period : float (s)
        Period of a periodic use, nan for others; at the first point of a sweep.
    from_time : float or None (s)
        Time from which ``other`` is one of the other kinds, if known; the latest of all points of a sweep.
    later : str
        The kind from then on.
    why : str
        The reason for ``other``, if it is known.
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
    """An expression as a function of time: steady (a + b·t), with periodic terms, or other."""

    kind: Literal["steady", "periodic", "other"]
    slope: Sum = ZERO
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
    """Return b and frequencies of b·t + P(t), where P repeats when all frequencies have completed whole turns.

    A product of sines and cosines of ω_i t with exponents n_i repeats once Σ n_i ω_i and all
    2 ω_i have completed whole turns: then the signs from half turns cancel.
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
    """Return ω of a sine or cosine of ω·t, or zero for other factors, and their frequencies; None: not periodic."""
    parts = [_periodic(x) for x in atom.arguments]
    if any(part is None for part in parts):
        return None
    known = [part for part in parts if part is not None]
    slope, found = known[0][0], tuple(f for _, more in known for f in more)
    entry = CALLED.get(atom.kind)
    if entry is not None and entry.half_turn and slope:
        return (slope, found) if entry.half_turn < 0 else (Sum(), (slope * 2, *found))
    if any(s for s, _ in known):
        return None
    if entry is not None and entry.parity == "even":
        square = _periodic(atom.arguments[0] * atom.arguments[0])
        found = found if square is None or square[0] else square[1]
    return Sum(), found


def common(frequencies: Sequence[Sum]) -> Sum | None:
    """Return the greatest common divisor of frequencies with rational ratios; None: no useful one is known."""
    ratios = [ratio(f, frequencies[0]) for f in frequencies]
    known = [abs(r) for r in ratios if r]
    if len(known) < len(ratios):
        return None
    below = math.lcm(*(r.denominator for r in known))
    divisor = Fraction(math.gcd(*(int(r * below) for r in known)), below)
    return frequencies[0] * divisor if max(known) <= TOLERANCES.common_period * divisor else None


def time_uses(system: System) -> tuple[TimeUse, ...]:
    """Return where and how the equations depend on time, from that of the reference on, in the order of the file."""
    return _uses(system)[1]


def _uses(system: System) -> tuple[Structure | None, tuple[TimeUse, ...]]:
    written = with_time(system)
    if not written:
        return None, ()
    structure = Structure(system.scene)
    found = (_use(structure, *x) for x in written)
    return structure, tuple(use for use in found if use is not None)


def _use(structure: Structure, path: str, role: Role, expression: Expression, angular: bool) -> TimeUse | None:
    try:
        written = structure.exact(expression)
        if not written.time:
            return None
        x = structure.exact(expression, structure.start)
    except ExpressionError as error:
        return TimeUse(path, cut(expression.text), "other", why=error.message)
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
    slope, period = first_point(structure.value(shape.slope)[0]), _period(structure, shape.frequencies)
    return TimeUse(path, text, kind, slope, bool(shape.slope), angular, period, frequencies=shape.frequencies)


def _period(structure: Structure, frequencies: Sequence[Sum]) -> float:
    base = common(frequencies) if frequencies else None
    with np.errstate(all="ignore"):
        return math.nan if base is None else first_point(2.0 * math.pi / abs(structure.value(base)[0]))


def _later(structure: Structure, expression: Expression, role: Role, x: Sum) -> tuple[float | None, _Shape]:
    """Return the time from which an expression is constant or periodic, and its form then, as far as known."""
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
        line = linear(atom.arguments[0]) if atom.kind in PIECED and CALLED[atom.kind].joints and atom.time else None
        if line is None or line[1].state or not (sign := structure.sign(line[0])):
            continue
        joints = CALLED[atom.kind].joints
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
                    found.append(call_at(expression.text, node.position))
    return cut(min(found, key=len) if found else expression.text)


def call_at(text: str, at: int) -> str:
    """Return the call that begins at a position, or the name that stands for it."""
    name = re.match(r"\w*", text[at:])
    if name is not None and not text[at + name.end() :].lstrip().startswith("("):
        return name[0]
    depth = 0
    for end in range(text.index("(", at), len(text)):
        depth += {"(": 1, ")": -1}.get(text[end], 0)
        if not depth:
            return text[at : end + 1]
    return text[at:]


# --- sentences ------------------------------------------------------------------------------------------------------


def affine_drives(system: System) -> tuple[TimeUse, ...]:
    """Return the uses with a term b·t that drives the motion; whether that shift is a symmetry is decided elsewhere."""
    return tuple(use for use in time_uses(system) if use.leads)


def time_doubt(system: System, broken: Container[str] = ()) -> str:
    """Return why the equations are not known to be constant from the time of the reference on; empty: they are.

    Parameters
    ----------
    system : System
        A system whose file states no period.
    broken : container of str
        Paths of entries of `affine_drives` whose shift is not a symmetry of the other entries.
    """
    structure, uses = _uses(system)
    led = [use for use in uses if use.leads and use.path in broken]
    doubts = [use for use in uses if use.kind in ("other", "periodic")]
    if structure is None or not (led or doubts):
        return ""
    others = [use for use in doubts if use.kind == "other"]
    now = first_point(structure.value(structure.start)[0])
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
    """Return why the equations are not known to have a given period; empty: they have it, or are constant.

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
            if not np.all((whole >= 1.0) & (np.abs(np.abs(values) - whole) <= TOLERANCES.period_multiple * whole)):
                own = f"repeats after {use.period:.10g} s"
                return f"{_through([use])}, which {own}: {first_point(period):.10g} s is no whole multiple of it"
    return ""


def _stated(structure: Structure, period: Any) -> Sum:
    """Return a stated period as a sum: the exact value of the file, if it is the same."""
    scene = structure.scene
    if scene.period is not None and scene.model.reference.period is not None and same_number(scene.period, period):
        return structure.given(scene.model.reference.period, scene.period, "reference.period")
    structure.values["stated period"] = floats(period)
    return Sum.of(Atom.of("constant", "stated period"))


def _through(uses: Iterable[TimeUse]) -> str:
    shown = list(dict.fromkeys(f"{use.path} ({use.text})" if use.text else use.path for use in uses))
    more = f" and {counted(len(shown) - 3, 'more place')}" if len(shown) > 3 else ""
    return f"the equations depend on time through {', '.join(shown[:3])}{more}"


def _reason(uses: Iterable[TimeUse]) -> str:
    why = next((use.why for use in uses if use.why), "")
    return f", {why}" if why else ""
