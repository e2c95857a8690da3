"""Controllers and motors: entries that bring first-order states of their own and act on a joint or a coordinate.

Each is written in terms of its keys, as the rates of its states and its effort would stand in a file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from mbstab.errors import counted
from mbstab.mechanics.catalogue import EFFORT, ElementUse, Field, Item, Kind, Part, PartError, Product
from mbstab.mechanics.drives import MOTION

_SINGLE = re.compile(r"\s*(?!rate\s*\()[\w.]+\s*(\([^()+*/-]*\))?\s*")
"""A coordinate or a measure: what has a rate of its own."""


def _none(item: Item) -> Iterable[ElementUse]:
    return ()


def _sum(terms: Iterable[tuple[str, str]]) -> str:
    """Return Σ (factor)·(text)."""
    return " + ".join(f"({factor})*({text})" for factor, text in terms) or "0"


def _pid(name: str, given: Mapping[str, Any]) -> Part:
    states: dict[str, str] = {}
    of = given["of"]
    error = f"({given.get('target', '0')}) - ({of})"
    products = [Product(of, key="target", coefficient=given["target"])] if "target" in given else []
    products += [
        Product(EFFORT, (of,), seconds, key, coefficient=given[key])
        for key, seconds in (("P", 0), ("I", 1), ("D", -1))
        if key in given
    ]
    terms = [(given["P"], error)] if "P" in given else []
    if "I" in given:
        states[f"{name}_integral"] = error
        products.append(Product(f"{name}_integral", (of,), 1))
        terms.append((given["I"], f"{name}_integral"))
    if "D" in given:
        speed = f"rate({of})"
        if "filter" in given:
            follower = f"{name}_filtered"
            speed = f"({of} - {follower})/({given['filter']})"
            states[follower] = speed
            products.append(Product(follower, (of,)))
        elif not _SINGLE.fullmatch(of):
            what = "D needs its rate, so that it must be one coordinate or measure"
            raise PartError("of", what, "give filter, a time constant, with which any expression may stand here")
        terms.append((given["D"], f"-({speed})"))
    elif "filter" in given:
        raise PartError("filter", "there is no derivative to be filtered", "give D, or leave out filter")
    if not terms:
        raise PartError("", "give at least one of 'P', 'I' and 'D'")
    return _lagged(name, given, Part(states, _sum(terms), tuple(products)))


def _lagged(name: str, given: Mapping[str, Any], part: Part) -> Part:
    """Return a part whose actuator follows with a lag, if one is given."""
    if "lag" not in given:
        return part
    acting = f"{name}_effort"
    rate = f"({part.effort} - {acting})/({given['lag']})"
    return Part({**part.states, acting: rate}, acting, (*part.products, Product(acting, (EFFORT,))))


def _feedback(name: str, given: Mapping[str, Any]) -> Part:
    gains = given["gains"]
    effort = "-(" + _sum((gain, signal) for signal, gain in gains.items()) + ")"
    # Of what the file gives, the expressions come first, then the gains.
    products = (
        Product(EFFORT, (signal,), 0, "gains", (len(gains) + i,), gain)
        for i, (signal, gain) in enumerate(gains.items())
    )
    return _lagged(name, given, Part({}, effort, tuple(products)))


def _names(name: str, count: int) -> list[str]:
    return [f"{name}_{i + 1}" for i in range(count)]


def _space(name: str, A: Sequence[Sequence[str]], B: Sequence[str], C: Sequence[str], D: str, signal: str) -> Part:
    states = _names(name, len(A))
    rates = {
        state: _sum([*zip(row, states, strict=True), (b, signal)]) for state, row, b in zip(states, A, B, strict=True)
    }
    return Part(rates, _sum([*zip(C, states, strict=True), (D, signal)]))


def _transfer(name: str, given: Mapping[str, Any]) -> Part:
    above, below = given["numerator"], given["denominator"]
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
    products = tuple(_in_transfer(_names(name, n), above, below, given["signal"]))
    return _lagged(name, given, Part(part.states, part.effort, products))


def _in_transfer(states: list[str], above: list[str], below: list[str], signal: str) -> Iterator[Product]:
    """Yield the products of a transfer function: each coefficient stands before a power of s, which is 1/time."""
    denominator, numerator = "the terms of the denominator", "the terms of the numerator"
    for state, following in zip(reversed(states), [signal, *reversed(states)], strict=False):
        yield Product(state, (following,), 1)
    for i, x in enumerate(below):
        yield Product(denominator, (), i + 1 - len(below), "denominator", (i,), x)
    yield Product(numerator, (denominator, EFFORT))
    for i, x in enumerate(above):
        yield Product(numerator, (signal,), i + 1 - len(above), "numerator", (i,), x)


def _state_space(name: str, given: Mapping[str, Any]) -> Part:
    A, B, C = given["A"], given["B"], given["C"]
    n = len(A)
    for row in A:
        if len(row) != n:
            rows, numbers = counted(n, "row"), counted(len(row), "number")
            raise PartError("A", f"A must be square: it has {rows}, and one of them {numbers}")
    for key, x in (("B", B), ("C", C)):
        if len(x) != n:
            raise PartError(key, f"{key} must have as many numbers as A has rows: {n}, got {len(x)}")
    signal, states = given["signal"], _names(name, n)
    part = _space(name, A, B, C, given.get("D", "0"), signal)
    products = [
        Product(one, (other,), 1, "A", (i, j), A[i][j])
        for i, one in enumerate(states)
        for j, other in enumerate(states)
    ]
    products += [Product(x, (signal,), 1, "B", (i,), B[i]) for i, x in enumerate(states)]
    products += [Product(EFFORT, (x,), 0, "C", (i,), C[i]) for i, x in enumerate(states)]
    if "D" in given:
        products.append(Product(EFFORT, (signal,), 0, "D", coefficient=given["D"]))
    return _lagged(name, given, Part(part.states, part.effort, tuple(products)))


def _motor(along: str, name: str, given: Mapping[str, Any]) -> Part:
    current, constant = f"{name}_current", f"({given['constant']})*({given.get('ratio', '1')})"
    voltage = given.get("voltage", "0")
    drop = f"({voltage}) - ({given['resistance']})*{current} - {constant}*rate({along})"
    products = (Product(EFFORT, (current,), 0, "constant", coefficient=constant),)
    return Part({current: f"({drop})/({given['inductance']})"}, f"{constant}*{current}", products, {current: "A"})


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
_SIGNAL = Field("signal", "signal", "what it takes in, an expression", "", required=True)
_ON = Field("on", "loads", "the effort along what it acts on", made=True)


def _kind(name: str, doc: str, fields: tuple[Field, ...], part: Callable[..., Part]) -> Kind:
    own = (*_TARGETS, *fields, _ON)
    return Kind(name, doc, (2, 3), own, _none, one_of=(("joint", "coordinate"),), written="force", part=part)


KINDS: tuple[Kind, ...] = (
    _kind(
        "pid",
        "controller: P*e + I*(integral of e) - D*(rate of what is controlled), with e = target - of; states "
        "NAME_integral, NAME_filtered with filter, NAME_effort with lag",
        (
            Field(
                "of",
                "moving signal",
                "what is controlled, a coordinate or a measure: body.x, angle(joint)",
                "",
                required=True,
            ),
            Field("target", "signal", "what it should be, an expression in the unit of that; 0 if not given", ""),
            Field("P", "number", "proportional gain: effort for the error, N/m or N*m/rad; 0 if not given", ""),
            Field("I", "number", "integral gain, that of P by s: N/(m*s) or N*m/(rad*s); 0 if not given", ""),
            Field("D", "number", "derivative gain, that of P times s: N*s/m or N*m*s/rad; 0 if not given", ""),
            Field(
                "filter",
                "number",
                "time constant of the filter of the derivative; without it, the rate itself acts",
                "s",
                sign="positive",
            ),
            _LAG,
        ),
        lambda along, name, given: _pid(name, given),
    ),
    _kind(
        "state_feedback",
        "controller: minus the sum of gains times expressions; state NAME_effort with lag",
        (
            Field(
                "gains",
                "gains",
                "gains by expression, N or N*m by its unit: {angle(knee): 40, rate(angle(knee)): 3}",
                required=True,
            ),
            _LAG,
        ),
        lambda along, name, given: _feedback(name, given),
    ),
    _kind(
        "transfer_function",
        "controller: a transfer function from a signal u to the effort, realized in controllable form: with the "
        "denominator divided by its first coefficient, rate(NAME_i) = NAME_(i+1) and the rate of the last state is u - "
        "(sum of a_i*NAME_i); states NAME_1, ..., and NAME_effort with lag",
        (
            _SIGNAL,
            Field(
                "numerator",
                "numbers",
                "coefficients, the highest power of s first: each in the unit of the effort by that of the signal, "
                "and of the denominator, times s for each power",
                required=True,
            ),
            Field(
                "denominator",
                "numbers",
                "coefficients, the highest power of s first, not 0: [T, 1] with a time constant T (s)",
                required=True,
            ),
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
            Field("A", "matrix", "rows of numbers, 1/s between states of one unit", required=True),
            Field(
                "B", "numbers", "as many numbers as A has rows: units of the states by s and the signal", required=True
            ),
            Field("C", "numbers", "as many numbers as A has rows: N or N*m by the units of the states", required=True),
            Field("D", "number", "effort for the signal: N or N*m by its unit; 0 if not given", ""),
            _LAG,
        ),
        lambda along, name, given: _state_space(name, given),
    ),
    _kind(
        "motor",
        "direct-current motor: its current i obeys inductance*rate(i) = voltage - resistance*i - back-EMF, with the "
        "effort ratio*constant*i and the back-EMF ratio*constant*(speed); state NAME_current",
        (
            Field("voltage", "signal", "expression; 0 if not given", "V"),
            Field("resistance", "number", "of the winding", "ohm", required=True, sign="nonnegative"),
            Field("inductance", "number", "of the winding", "H", required=True, sign="positive"),
            Field("constant", "number", "torque per current (N*m/A), or force per current (N/A)", "", required=True),
            Field(
                "ratio",
                "number",
                "turns of the motor per turn of the joint, or turns (rad) per travel (1/m); 1 if not given",
                "",
            ),
        ),
        _motor,
    ),
)
"""What ``forces:`` may contain besides springs, forces and torques."""
