"""The arithmetic a model file may contain: read safely, evaluate in any number system.

Grammar: numbers, names (with a dot for coordinates, ``rod.theta``), ``+ - * / **``,
parentheses, the functions of `mbstab.model.functions`, the constants of `mbstab.model.arithmetic`, and
``rate(rod.theta)`` for the time derivative of a coordinate or a measure (`mbstab.mechanics.measures`). Nothing else: no
attribute access, no calls of anything else. Limits on length,
depth and exponent keep a hostile text from taking much time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator, Mapping
from functools import cached_property, lru_cache
from typing import Any, Protocol

from mbstab.errors import MbstabError, alternatives, counted, suggestion
from mbstab.mechanics.measures import MEASURES, is_measure
from mbstab.model import mistaken
from mbstab.model.arithmetic import CONSTANTS, Arithmetic
from mbstab.model.functions import CALLED, PIECED
from mbstab.records import dataclass

MAX_LENGTH = 5_000
MAX_DEPTH = 60
MAX_CHAIN = 480
MAX_EXPONENT = 100.0
MAX_NUMBER = 1e300
MAX_NODES = 20_000
DERIVED = ("rate", "acceleration")
"""Time derivatives of what is measured."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)"
    r"|(?P<operator>\*\*|[-+*/(),]))"
)


class ExpressionError(MbstabError):
    """A text that is not an expression, or has no value; `position` counts characters from 0.

    `root` is the expression, where several are evaluated.
    """

    exit_code = 2

    def __init__(self, message: str, position: int = 0, hint: str = "", root: Node | None = None) -> None:
        super().__init__(message)
        self.root = root
        self.message = message
        self.position = position
        self.hint = hint


class _Tree:
    """What is asked of a node and all below it; found once, as the same texts share their nodes."""

    def walk(self) -> Iterator[Node]:
        """Yield every node."""
        stack: list[Any] = [self]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(_parts(node))

    @cached_property
    def used(self) -> tuple[Mapping[str, int], Mapping[str, int]]:
        """Names that are not constants, and coordinates whose rate occurs, with the positions of their first use."""
        names: dict[str, int] = {}
        rates: dict[str, int] = {}
        for node in self.walk():
            if isinstance(node, Rate):
                rates[node.name] = min(node.position, rates.get(node.name, node.position))
            elif isinstance(node, Name) and node.name not in CONSTANTS:
                names[node.name] = min(node.position, names.get(node.name, node.position))
        return names, rates

    @cached_property
    def named_exponents(self) -> bool:
        """Whether names stand in an exponent."""
        return any(isinstance(node, Binary) and node.operator == "**" and node.right.used[0] for node in self.walk())

    @cached_property
    def widths(self) -> list[tuple[str, Node]]:
        """The widths over which functions are smoothed, each with the name of its function."""
        calls = (node for node in self.walk() if isinstance(node, Call))
        return [(node.function, node.arguments[-1]) for node in calls if CALLED[node.function].smoothed]


@dataclass(frozen=True)
class Number(_Tree):
    """A literal, kept as text so that every number system reads all its digits."""

    text: str
    position: int


@dataclass(frozen=True)
class Name(_Tree):
    """A parameter, a constant, the time ``t`` or a coordinate ``body.x``."""

    name: str
    position: int


@dataclass(frozen=True)
class Rate(_Tree):
    """The time derivative of a coordinate: ``rate(body.x)``."""

    name: str
    position: int


@dataclass(frozen=True)
class Call(_Tree):
    """One of the listed functions applied to its arguments."""

    function: str
    arguments: tuple[Node, ...]
    position: int


@dataclass(frozen=True)
class Binary(_Tree):
    """``left operator right`` with one of ``+ - * / **``."""

    operator: str
    left: Node
    right: Node
    position: int


@dataclass(frozen=True)
class Negative(_Tree):
    """``-operand``."""

    operand: Node
    position: int


Node = Number | Name | Rate | Call | Binary | Negative


class Table(Protocol):
    """A function given by points."""

    def points(self, function: str) -> tuple[str, ...]:
        """Return x, y and slope of each point."""


@dataclass(frozen=True)
class Expression:
    """A parsed expression and the text it came from."""

    text: str
    root: Node

    @property
    def literal(self) -> bool:
        """Whether the text is a plain number, with or without a sign."""
        root = self.root.operand if isinstance(self.root, Negative) else self.root
        return isinstance(root, Number) and root.text in self.text  # not by the name of a definition

    def walk(self) -> Iterator[Node]:
        """Yield every node."""
        return self.root.walk()

    def names(self) -> Mapping[str, int]:
        """Return the names that are not constants, with the position of their first use."""
        return self.root.used[0]

    def rates(self) -> Mapping[str, int]:
        """Return the coordinates whose rate occurs, with the position of their first use."""
        return self.root.used[1]

    @property
    def widths(self) -> list[tuple[str, Node]]:
        """The widths over which functions in it are smoothed, each with the name of its function."""
        return self.root.widths

    def pieced(self, coordinates: Container[str]) -> bool:
        """Whether it is piecewise in the motion: a function with a kink or a joint, of a coordinate or its rate."""
        return any(
            isinstance(node, Call) and node.function in PIECED and in_motion(node, coordinates) for node in self.walk()
        )

    def coefficients(self, names: Mapping[str, Any], arithmetic: Arithmetic) -> list[Any]:
        """Return the values of the largest parts that contain no other names than these, such as a − b in (a - b)*x."""
        found: list[Any] = []

        def known(node: Node) -> bool:
            match node:
                case Name():
                    return node.name in names or node.name in CONSTANTS
                case Rate():
                    return False
            parts = [(part, known(part)) for part in _parts(node)]
            if all(whole for _, whole in parts):
                return True
            found.extend(_evaluate(part, names, {}, arithmetic) for part, whole in parts if whole)
            return False

        if known(self.root):
            found.append(_evaluate(self.root, names, {}, arithmetic))
        return found

    def felt(self, names: Mapping[str, Any], arithmetic: Arithmetic) -> set[str]:
        """Return the other names and rates on which the value depends, given the values of these: none in 0*x."""

        def found(node: Node) -> set[str]:
            if isinstance(node, Rate) or (isinstance(node, Name) and node.name not in (*names, *CONSTANTS)):
                return {node.name}
            parts = [found(part) for part in _parts(node)]
            if isinstance(node, Binary) and node.operator in "*/":
                factors = (node.left, node.right) if node.operator == "*" else (node.left,)
                if any(not own and zero(x) for own, x in zip(parts, factors, strict=False)):
                    return set()
            return set().union(*parts)

        def zero(node: Node) -> bool:
            try:
                nothing = _evaluate(node, names, {}, arithmetic) == 0
            except (ExpressionError, KeyError):
                return False
            return bool(nothing.all() if hasattr(nothing, "all") else nothing)

        return found(self.root)

    def evaluate(self, names: Mapping[str, Any], arithmetic: Arithmetic, rates: Mapping[str, Any] | None = None) -> Any:
        """Return the value.

        Parameters
        ----------
        names : mapping
            Value of every name that occurs.
        arithmetic : Arithmetic
            The number system of the values.
        rates : mapping, optional
            Value of every ``rate(...)`` that occurs.

        Raises
        ------
        ExpressionError
            If the expression has no value (division by zero, logarithm of a negative number, …).
        """
        return _evaluate(self.root, names, rates or {}, arithmetic)


def filled_in(expression: Expression, definitions: Mapping[str, Expression], tables: Mapping[str, Table]) -> Expression:
    """Return an expression with definitions and points in the place of names; its text and its positions stay.

    Parameters
    ----------
    definitions : mapping
        None of them needs itself.
    tables : mapping
        Points by the name of the table and the function.

    Raises
    ------
    ExpressionError
        If it becomes too large, contains the rate of a definition, or calls a table that does not exist.
    """
    if not any(_is_filled(node, definitions) for node in expression.walk()):
        return expression
    size = 0

    def put(node: Node, at: int | None, depth: int) -> Node:
        nonlocal size
        size += 1
        here = node.position if at is None else at
        if size > MAX_NODES or depth > MAX_CHAIN:
            raise ExpressionError("the expression is too long with all its definitions", here)
        match node:
            case Name() if node.name in definitions:
                return put(parse(definitions[node.name].text).root, here, depth + 1)
            case Rate() if node.name in definitions:
                hint = "rate(...) takes a coordinate or a measure; write out the rate of a definition"
                raise ExpressionError(f"{node.name!r} is a definition", here, hint)
            case Call() if CALLED[node.function].knots >= 0 and isinstance(node.arguments[-1], Name):
                x, name = put(node.arguments[0], at, depth + 1), _word_of(node.arguments[-1])
                if name not in tables:
                    hint = alternatives(name, tables, "tables")
                    if isinstance(node.arguments[0], Name) and node.arguments[0].name in tables:
                        hint = f"the table comes last: {node.function}(x, {node.arguments[0].name})"
                    raise ExpressionError(f"there is no table {name!r}", here, hint)
                points = tables[name].points(node.function)
                return Call(node.function, (x, *(Number(text, here) for text in points)), here)
            case Call():
                arguments = tuple(put(x, at, depth + 1) for x in node.arguments)
                return Call(node.function, arguments, here)
            case Binary():
                left, right = put(node.left, at, depth + 1), put(node.right, at, depth + 1)
                return Binary(node.operator, left, right, here)
            case Negative():
                return Negative(put(node.operand, at, depth + 1), here)
            case Number():
                return Number(node.text, here)
            case _:
                return node.__class__(node.name, here)

    return Expression(expression.text, put(expression.root, None, 0))


def _word_of(node: Node) -> str:
    return node.name if isinstance(node, Name) else ""


def _is_filled(node: Node, definitions: Container[str]) -> bool:
    if isinstance(node, Call):
        return CALLED[node.function].knots >= 0
    return isinstance(node, (Name, Rate)) and node.name in definitions


def moves(name: str, coordinates: Container[str]) -> bool:
    """Whether a name in an expression changes with the motion: a coordinate or a measure."""
    return name in coordinates or is_measure(name)


def in_motion(node: Node, coordinates: Container[str]) -> bool:
    """Whether a node contains what changes with the motion: a coordinate, its rate or a measure."""
    names, rates = node.used
    return bool(rates) or any(moves(name, coordinates) for name in names)


def _parts(node: Node) -> tuple[Node, ...]:
    match node:
        case Call():
            return node.arguments
        case Binary():
            return node.left, node.right
        case Negative():
            return (node.operand,)
        case _:
            return ()


NO_REAL_VALUE = "a function has no real value there"


def why_no_number(error: Exception) -> str:
    """Return why a calculation has no result, in words for engineers."""
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    if isinstance(error, OverflowError):
        return "a number becomes too large"
    return NO_REAL_VALUE if "math domain error" in str(error) else str(error)


def _evaluate(node: Node, names: Mapping[str, Any], rates: Mapping[str, Any], f: Arithmetic) -> Any:
    try:
        match node:
            case Number():
                return f.number(node.text)
            case Name():
                return f.constants[node.name] if node.name in CONSTANTS else names[node.name]
            case Rate():
                return rates[node.name]
            case Negative():
                return -_evaluate(node.operand, names, rates, f)
            case Call():
                return getattr(f, node.function)(*[_evaluate(a, names, rates, f) for a in node.arguments])
            case Binary():
                left = _evaluate(node.left, names, rates, f)
                right = _evaluate(node.right, names, rates, f)
                return OPERATIONS[node.operator](left, right, f)
    except (ArithmeticError, ValueError) as error:
        message = f"the expression has no value here ({why_no_number(error)})"
        hint = "a divisor is 0: correct it, or a parameter in it" if isinstance(error, ZeroDivisionError) else ""
        raise ExpressionError(message, node.position, hint) from None


OPERATIONS: dict[str, Callable[[Any, Any, Arithmetic], Any]] = {
    "+": lambda a, b, f: a + b,
    "-": lambda a, b, f: a - b,
    "*": lambda a, b, f: a * b,
    "/": lambda a, b, f: a / b,
    "**": lambda a, b, f: f.power(a, b),
}


@lru_cache(maxsize=4096)
def parse(text: str) -> Expression:
    """Read an expression; the same texts stand in a file again and again.

    What is measured, such as ``angle(pivot)`` or ``acceleration(body.x)``, is a `Name` with that text.

    Raises
    ------
    ExpressionError
        With the position of the first character that does not fit the grammar.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression may have at most {MAX_LENGTH} characters, this one has {len(text)}")
    return Expression(text, _Parser(text).parse())


class _Parser:
    """Recursive descent; every level of nesting costs one unit of `MAX_DEPTH`."""

    def __init__(self, text: str) -> None:
        self.tokens = list(self._tokens(text))
        self.index = 0
        self.depth = 0

    @staticmethod
    def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
        at = 0
        end = len(text.rstrip())
        while at < end:
            match = _TOKEN.match(text, at)
            if match is None:
                at += len(text[at:]) - len(text[at:].lstrip())
                hint = mistaken.CHARACTERS.get(text[at], "")
                raise ExpressionError(f"unexpected character {text[at]!r} in an expression", at, hint)
            kind = match.lastgroup or ""
            yield kind, match.group(kind), match.start(kind)
            at = match.end()
        yield "end", "", end

    def parse(self) -> Node:
        if self.tokens[0][0] == "end":
            raise ExpressionError("the expression is empty")
        root = self._sum()
        kind, token, at = self.tokens[self.index]
        if kind != "end":
            before = self.tokens[self.index - 1][1]
            adjacent = kind in ("number", "name") or token == "("
            hint = mistaken.behind_number(before, kind, token) if adjacent else mistaken.CHARACTERS.get(token, "")
            raise ExpressionError(f"unexpected {token!r} in an expression", at, hint)
        self._check_chains(root)
        return root

    @staticmethod
    def _check_chains(root: Node) -> None:
        # A chain of operators is as deep to evaluate as it is long, and chains may stand in chains.
        stack = [(root, 0)]
        while stack:
            node, above = stack.pop()
            if above > MAX_CHAIN:
                raise ExpressionError(f"an expression may chain at most {MAX_CHAIN} operators", node.position)
            stack.extend((part, above + 1) for part in _parts(node))

    def _accept(self, *operators: str) -> tuple[str, int] | None:
        kind, token, at = self.tokens[self.index]
        if kind == "operator" and token in operators:
            self.index += 1
            return token, at
        return None

    def _expect(self, operator: str) -> None:
        if self._accept(operator) is None:
            kind, token, at = self.tokens[self.index]
            found = "the end" if kind == "end" else repr(token)
            hint = (
                "within { } or [ ] an expression with a comma stands in quotes"
                if kind == "end"
                else mistaken.CHARACTERS.get(token, "")
            )
            raise ExpressionError(f"expected {operator!r}, found {found}", at, hint)

    def _deeper(self, at: int) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ExpressionError(f"an expression may be nested at most {MAX_DEPTH} deep", at)

    def _sum(self) -> Node:
        node = self._product()
        while found := self._accept("+", "-"):
            node = Binary(found[0], node, self._product(), found[1])
        return node

    def _product(self) -> Node:
        node = self._sign()
        while found := self._accept("*", "/"):
            node = Binary(found[0], node, self._sign(), found[1])
        return node

    def _sign(self) -> Node:
        found = self._accept("+", "-")
        if found is None:
            return self._power()
        self._deeper(found[1])
        operand = self._sign()
        self.depth -= 1
        return Negative(operand, found[1]) if found[0] == "-" else operand

    def _power(self) -> Node:
        base = self._atom()
        found = self._accept("**")
        if found is None:
            return base
        self._deeper(found[1])
        exponent = self._sign()
        self.depth -= 1
        if abs(float(_magnitude(exponent))) > MAX_EXPONENT:
            raise ExpressionError(f"an exponent may be at most {MAX_EXPONENT:g}", exponent.position)
        return Binary("**", base, exponent, found[1])

    def _atom(self) -> Node:
        kind, token, at = self.tokens[self.index]
        self.index += 1
        if kind == "number":
            # Exact number systems would spell out every digit of 1e-999999999.
            exponent = token.lower().partition("e")[2].lstrip("+-0")
            if len(exponent) > 3 or float(token) > MAX_NUMBER:
                raise ExpressionError(f"a number may be at most {MAX_NUMBER:g}, with three digits in its exponent", at)
            return Number(token, at)
        if kind == "operator" and token == "(":
            self._deeper(at)
            node = self._sum()
            self._expect(")")
            self.depth -= 1
            return node
        if kind == "name":
            if self.tokens[self.index][:2] == ("operator", "("):
                return self._call(token, at)
            return Name(token, at)
        found = "the expression ends" if kind == "end" else f"found {token!r}"
        raise ExpressionError(f"expected a number, a name or '(', {found}", at)

    def _measure(self, kind: str, at: int) -> Node:
        self._expect("(")
        arguments = [self._word(kind)]
        while self._accept(","):
            arguments.append(self._word(kind))
        self._expect(")")
        expected = MEASURES[kind].arguments
        if len(arguments) != len(expected):
            said = " and ".join(f"a {x}" for x in expected)
            raise ExpressionError(f"{kind}() takes {said}, got {counted(len(arguments), 'name', 'names')}", at)
        name = f"{kind}({', '.join(arguments)})"
        return Rate(name, at) if MEASURES[kind].speed else Name(name, at)

    def _word(self, kind: str) -> str:
        token, text, at = self.tokens[self.index]
        if token != "name":
            first = MEASURES[kind].arguments[0]
            raise ExpressionError(f"{kind}() takes the name of a {first}, found {text or 'the end'!r}", at)
        self.index += 1
        return text

    def _call(self, function: str, at: int) -> Node:
        if function in MEASURES:
            return self._measure(function, at)
        if function not in DERIVED and function not in CALLED:
            hint = mistaken.FUNCTIONS.get(function.lower(), "") or suggestion(function, [*CALLED, *MEASURES, *DERIVED])
            hint = hint or "known functions: " + ", ".join(CALLED)
            raise ExpressionError(f"unknown function {function!r}", at, hint)
        self._expect("(")
        self._deeper(at)
        arguments = [self._sum()]
        while self._accept(","):
            arguments.append(self._sum())
        self._expect(")")
        self.depth -= 1
        if function in DERIVED:
            if len(arguments) != 1 or not isinstance(arguments[0], Name):
                hint = "the speed of a point in the axes of its body is vx(body.point)"
                message = f"{function}(...) takes one coordinate or measure, such as {function}(body.x)"
                raise ExpressionError(message, at, hint)
            name = arguments[0].name
            return Rate(name, at) if function == "rate" else Name(f"{function}({name})", at)
        expected = CALLED[function].arguments
        if CALLED[function].knots >= 0 and not (len(arguments) == 2 and isinstance(arguments[1], Name)):
            hint = f"{function}(x, NAME) with the name of one under tables:"
            raise ExpressionError(f"{function}() takes a number and the name of a table", at, hint)
        if len(arguments) != expected:
            plural = "" if expected == 1 else "s"
            raise ExpressionError(
                f"{function}() takes {expected} argument{plural}, got {len(arguments)}", at, _written(function)
            )
        return Call(function, tuple(arguments), at)


def _written(function: str) -> str:
    """Return a hint how a function is called."""
    *others, last = CALLED[function].names
    if not CALLED[function].smoothed:
        return f"{function}({', '.join([*others, last])})"
    example = f"{function}({', '.join([*others, '0.001'])})"
    return f"{example}: the last one is the width over which a corner is rounded, as it has no derivative"


def _magnitude(node: Node) -> str:
    return _magnitude(node.operand) if isinstance(node, Negative) else node.text if isinstance(node, Number) else "0"
