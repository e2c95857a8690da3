"""Controllers and motors: entries that bring first-order states of their own and act on a joint or a coordinate.

Each is written in terms of its keys, as the rates of its states and its effort would stand in a file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from mbstab.mechanics.catalogue import ElementUse, Field, Item, Kind, Part, PartError
from mbstab.mechanics.drives import MOTION

_SINGLE = re.compile(r"\s*[\w.]+\s*(\([^()+*/-]*\))?\s*")
"""A coordinate or a measure: what has a rate of its own."""


def _none(item: Item) -> Iterable[ElementUse]:
    return ()


def _list(given: Mapping[Any, Any], *keys: Any) -> list[Any]:
    """Return lists of numbers.

    Raises
    ------
    TypeError
        If one is no list; where the key is read, this is told.
    """
    found = [given[key] for key in keys]
    if any(isinstance(x, str) for x in found):
        raise TypeError
    return found


def _sum(terms: Iterable[tuple[str, str]]) -> str:
    """Return Σ (factor)·(text)."""
    return " + ".join(f"({factor})*({text})" for factor, text in terms) or "0"


def _pid(name: str, given: Mapping[str, Any]) -> Part:
    states: dict[str, str] = {}
    error = f"({given.get('target', '0')}) - ({given['of']})"
    terms = [(given["P"], error)] if "P" in given else []
    if "I" in given:
        states[f"{name}_integral"] = error
        terms.append((given["I"], f"{name}_integral"))
    if "D" in given:
        speed = f"rate({given['of']})"
        if "filter" in given:
            follower = f"{name}_filtered"
            speed = f"({given['of']} - {follower})/({given['filter']})"
            states[follower] = speed
        elif not _SINGLE.fullmatch(given["of"]):
            what = "D needs its rate, so that it must be one coordinate or measure"
            raise PartError("of", what, "give filter, a time constant, with which any expression may stand here")
        terms.append((given["D"], f"-({speed})"))
    elif "filter" in given:
        raise PartError("filter", "there is no derivative to be filtered", "give D, or leave out filter")
    if not terms:
        raise PartError("", "give at least one of 'P', 'I' and 'D'")
    return _lagged(name, given, states, _sum(terms))


def _lagged(name: str, given: Mapping[str, Any], states: dict[str, str], effort: str) -> Part:
    """Return a part whose actuator follows with a lag, if one is given."""
    if "lag" not in given:
        return Part(states, effort)
    acting = f"{name}_effort"
    return Part({**states, acting: f"({effort} - {acting})/({given['lag']})"}, acting)


def _feedback(name: str, given: Mapping[str, Any]) -> Part:
    effort = "-(" + _sum((gain, signal) for signal, gain in given["gains"].items()) + ")"
    return _lagged(name, given, {}, effort)


def _space(name: str, A: Sequence[Sequence[str]], B: Sequence[str], C: Sequence[str], D: str, signal: str) -> Part:
    states = [f"{name}_{i + 1}" for i in range(len(A))]
    rates = {
        state: _sum([*zip(row, states, strict=True), (b, signal)]) for state, row, b in zip(states, A, B, strict=True)
    }
    return Part(rates, _sum([*zip(C, states, strict=True), (D, signal)]))


def _transfer(name: str, given: Mapping[str, Any]) -> Part:
    above, below = _list(given, "numerator", "denominator")
    n = len(below) - 1
    if len(above) > n + 1:
        message = f"the numerator has the degree {len(above) - 1}, the denominator only {n}"
        raise PartError("numerator", message, "a transfer function acts only if it is proper: filter what it derives")
    lead = below[0]
    b = [*["0"] * (n + 1 - len(above)), *above]
    direct = f"({b[0]})/({lead})"
    A = [["1" if j == i + 1 else "0" for j in range(n)] for i in range(n - 1)]
    if n:
        A.append([f"-({x})/({lead})" for x in reversed(below[1:])])
    C = [f"(({x}) - ({direct})*({a}))/({lead})" for x, a in zip(reversed(b[1:]), reversed(below[1:]), strict=True)]
    part = _space(name, A, [*["0"] * (n - 1), "1"][-n:] if n else [], C, direct, given["signal"])
    return _lagged(name, given, part.states, part.effort)


def _state_space(name: str, given: Mapping[str, Any]) -> Part:
    A, B, C = _list(given, "A", "B", "C")
    n = len(A)
    _list(dict(enumerate(A)), *range(n))
    for row in A:
        if len(row) != n:
            raise PartError("A", f"A must be square: it has {n} rows, and one of them {len(row)} numbers")
    for key, x in (("B", B), ("C", C)):
        if len(x) != n:
            raise PartError(key, f"{key} must have as many numbers as A has rows: {n}, got {len(x)}")
    part = _space(name, A, B, C, given.get("D", "0"), given["signal"])
    return _lagged(name, given, part.states, part.effort)


def _motor(along: str, name: str, given: Mapping[str, Any]) -> Part:
    current, constant = f"{name}_current", f"({given['constant']})*({given.get('ratio', '1')})"
    voltage = given.get("voltage", "0")
    drop = f"({voltage}) - ({given['resistance']})*{current} - {constant}*rate({along})"
    return Part({current: f"({drop})/({given['inductance']})"}, f"{constant}*{current}", {current: "A"})


_TARGETS = (
    Field("joint", "joint", "name of the joint it acts on, on the first body against the second"),
    MOTION,
    Field("coordinate", "coordinate", "the coordinate it acts on, written body.x, instead of a joint"),
)
_LAG = Field(
    "lag",
    "number",
    "time constant with which the actuator follows; without it, the effort acts at once",
    "s",
    sign="positive",
)
_SIGNAL = Field("signal", "signal", "what it takes in, an expression", required=True)
_ON = Field("on", "loads", "the effort along what it acts on", made=True)


def _kind(name: str, doc: str, fields: tuple[Field, ...], part: Callable[..., Part]) -> Kind:
    own = (*_TARGETS, *fields, _ON)
    return Kind(name, doc, (2, 3), own, _none, one_of=(("joint", "coordinate"),), written="force", part=part)


_CONTROLLERS = (
    _kind(
        "pid",
        "controller: P*e + I*(integral of e) - D*(rate of what is controlled), with e = target - of; states "
        "NAME_integral, NAME_filtered with filter, NAME_effort with lag",
        (
            Field("of", "signal", "what is controlled, a coordinate or a measure: body.x, angle(joint)", required=True),
            Field("target", "signal", "what it should be, an expression; 0 if not given"),
            Field("P", "number", "proportional gain: effort for the error; 0 if not given", ""),
            Field("I", "number", "integral gain, that of P by s; 0 if not given", ""),
            Field("D", "number", "derivative gain, that of P times s; 0 if not given", ""),
            Field("filter", "number", "time constant of the filter of the derivative", "s", sign="positive"),
            _LAG,
        ),
        lambda along, name, given: _pid(name, given),
    ),
    _kind(
        "state_feedback",
        "controller: minus the sum of gains times expressions; state NAME_effort with lag",
        (Field("gains", "gains", "gains by expression: {angle(knee): 40, rate(angle(knee)): 3}", required=True), _LAG),
        lambda along, name, given: _feedback(name, given),
    ),
    _kind(
        "transfer_function",
        "controller: a transfer function from a signal u to the effort, realized in controllable form: with the "
        "denominator divided by its first coefficient, rate(NAME_i) = NAME_(i+1) and the rate of the last state is u - "
        "(sum of a_i*NAME_i); states NAME_1, ..., and NAME_effort with lag",
        (
            _SIGNAL,
            Field("numerator", "numbers", "coefficients, the highest power of s first", required=True),
            Field("denominator", "numbers", "coefficients, the highest power of s first, not 0", required=True),
            _LAG,
        ),
        lambda along, name, given: _transfer(name, given),
    ),
    _kind(
        "state_space",
        "controller: the effort C*x + D*signal with the states x, whose rates are A*x + B*signal; states NAME_1, ..., "
        "and NAME_effort with lag",
        (
            _SIGNAL,
            Field("A", "matrix", "rows of numbers", required=True),
            Field("B", "numbers", "as many numbers as A has rows", required=True),
            Field("C", "numbers", "as many numbers as A has rows", required=True),
            Field("D", "number", "number, 0 if not given", ""),
            _LAG,
        ),
        lambda along, name, given: _state_space(name, given),
    ),
    _kind(
        "motor",
        "direct-current motor: its current i obeys inductance*rate(i) = voltage - resistance*i - back-EMF, with the "
        "effort ratio*constant*i and the back-EMF ratio*constant*(speed); state NAME_current",
        (
            Field("voltage", "signal", "expression (V); 0 if not given"),
            Field("resistance", "number", "of the winding", "ohm", required=True, sign="nonnegative"),
            Field("inductance", "number", "of the winding", "H", required=True, sign="positive"),
            Field("constant", "number", "effort per current (N*m/A, along a travel N/A)", "", required=True),
            Field("ratio", "number", "turns of the motor per turn of the joint, 1 if not given", ""),
        ),
        _motor,
    ),
)
KINDS: dict[tuple[str, int], Kind] = {(kind.name, d): kind for kind in _CONTROLLERS for d in kind.dimensions}
"""What ``forces:`` may contain besides springs, forces and torques."""
