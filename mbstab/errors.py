"""What can go wrong, where, and which exit code says so.

Exit codes: 0 answered, 1 the computation failed, 2 the file or the command line
is wrong, 3 an expectation (``expect:``, ``--require`` or ``--verify``) did not hold.
A command that a signal stops ends with 128 and its number (130 Ctrl-C, 143 SIGTERM, 129 SIGHUP).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from mbstab.records import dataclass

_UNSEEN = re.compile(r"[^\n\t -~]")


def unseen(c: str) -> bool:
    """Whether a character cannot be seen, and is no blank: a control character, a mark of direction and the like."""
    if c.isprintable():
        return False
    import unicodedata

    return unicodedata.category(c) != "Zs"


def visible(text: str, lines: bool = True) -> str:
    """Return text in which control characters, marks of direction and the like are escapes of their code.

    Parameters
    ----------
    text : str
    lines : bool
        Whether line breaks and tabs stay.
    """

    def shown(match: re.Match[str]) -> str:
        c = match.group()
        if not unseen(c):
            return c
        units = c.encode("utf-16-be", "surrogatepass").hex()
        return "".join(f"\\u{units[k : k + 4]}" for k in range(0, len(units), 4))

    text = _UNSEEN.sub(shown, text)
    return text if lines else text.replace("\n", "\\n").replace("\t", "\\t")


@dataclass(frozen=True)
class Location:
    """A place in a text file; line and column count from 1."""

    file: str
    line: int
    column: int

    @property
    def order(self) -> tuple[str, int, int]:
        """Return what places are sorted by."""
        return self.file, self.line, self.column

    def __str__(self) -> str:
        return f"{visible(self.file, lines=False)}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a model file: where, at which path, which rule, and what to do."""

    location: Location
    path: str
    message: str
    hint: str = ""
    source: str = ""

    def parts(self) -> list[tuple[str, str]]:
        """Return the text in parts, each with its kind: ``place``, ``text``, ``source``, ``caret``, ``hint``."""
        path, message = visible(self.path, lines=False), visible(self.message)
        parts = [("place", f"{self.location}:"), ("text", f" {path}: {message}" if path else f" {message}")]
        if self.source:
            text, at = _window(self.source, self.location.column - 1)
            number = str(self.location.line)
            parts += [("source", f"\n {number} | {text}\n {' ' * len(number)} | "), ("caret", f"{' ' * at}^")]
        if self.hint:
            parts += [("text", "\n"), ("hint", "hint:"), ("text", f" {self.hint}")]
        return parts

    def __str__(self) -> str:
        return "".join(text for _, text in self.parts())


def _window(source: str, at: int, width: int = 100) -> tuple[str, int]:
    """Cut a long source line around position `at`; control characters become blanks."""
    start = max(0, min(at - width // 2, len(source) - width))
    return "".join(c if c.isprintable() else " " for c in source[start : start + width]), at - start


LISTED = 20
"""Known words that a hint lists."""


def nearest(word: str, known: Iterable[str]) -> str:
    """Return the nearest of the known words (of the first 1000), or an empty string.

    A word of one letter is near to those that begin with it.
    """
    import difflib  # for mistakes only

    words = [x for x in islice(known, 1000) if len(word) > 1 or x[:1].lower() == word.lower()]
    if word not in words and (near := [x for x in words if x.lower() == word.lower()]):
        return near[0]
    if near := difflib.get_close_matches(word, words, n=1, cutoff=0.6):
        return near[0]
    lower = {x.lower(): x for x in words}  # as Kp for P
    return lower[near[0]] if (near := difflib.get_close_matches(word.lower(), lower, n=1, cutoff=0.6)) else ""


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return ``did you mean 'mass'?`` for the nearest of the known words, or an empty string."""
    near = nearest(word, known)
    return f"did you mean {near!r}?" if near else ""


def alternatives(word: str, known: Iterable[str], what: str) -> str:
    """Return which of the known words is meant, or else which there are: ``joints: hip, knee``, ``joints: none``."""
    words = list(known)
    return suggestion(word, words) or listed(what, words)


def listed(what: str, known: Sequence[str]) -> str:
    """Return the known words, ``LISTED`` of them at most: ``joints: hip, knee``."""
    more = f", … ({len(known)} in all)" if len(known) > LISTED else ""
    return f"{what}: {', '.join(known[:LISTED]) or 'none'}{more}"


def counted(number: int, one: str, many: str = "") -> str:
    """Return ``1 row`` or ``2 rows``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def amount(x: float) -> str:
    """Return a size in a sentence: ``0``, two digits such as ``1.2e-05``, or that there is none."""
    return "0" if x == 0.0 else f"{x:.1e}" if math.isfinite(x) else "no finite number"


def percent(part: float) -> str:
    """Return a part of 1 such as ``12.3%``, small ones with two digits that tell something: ``0.0023%``."""
    return f"{part:.1%}" if not 0.0 < abs(part) < 0.001 else f"{100.0 * part:.2g}%"


class MbstabError(Exception):
    """Base of every error that is the user's to mend; carries the exit code."""

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Return it as its text and attributes: what it was made of may be something else."""
        return _same_again, (type(self), self.args, self.__dict__)


def _same_again(kind: type[MbstabError], args: tuple[Any, ...], attributes: dict[str, Any]) -> MbstabError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


class ModelFileError(MbstabError):
    """A model file is wrong; holds all its problems in the order of the file."""

    exit_code = 2

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = sorted(problems, key=lambda problem: problem.location.order)
        super().__init__("\n\n".join("".join(text for _, text in parts) for parts in self.parts()))

    def parts(self) -> list[list[tuple[str, str]]]:
        """Return the texts of the problems in parts (see `Problem.parts`); a hint about several is given once."""
        told: set[str] = set()
        found = []
        for problem in self.problems:
            found.append((problem if problem.hint not in told else replace(problem, hint="")).parts())
            told.add(problem.hint)
        return found


def in_one_line(error: MbstabError) -> str:
    """Return what an error says, without its hint and the line of the file."""
    problem = error.problems[0] if isinstance(error, ModelFileError) else None
    text = str(error).partition("\nhint:")[0] if problem is None else str(replace(problem, source="", hint=""))
    return text.replace("\n", "; ")


class UsageError(MbstabError):
    """The call is wrong: an unknown parameter, a value out of range, a name that is no model."""

    exit_code = 2


class ConstraintError(MbstabError):
    """The constraints cannot be used: their rank has no gap or changes at this configuration."""


class MassError(MbstabError):
    """A motion that the constraints allow carries no mass."""

    exit_code = 2


class NumericalError(MbstabError):
    """A computation did not reach its threshold; the message says number, threshold and next step."""


class SimulationError(NumericalError):
    """A motion could be followed only in part; `partial` is the finished part, or None."""

    def __init__(self, message: str, partial: Any = None) -> None:
        super().__init__(message)
        self.partial = partial


class EquilibriumError(MbstabError):
    """No equilibrium or steady motion was found; the message says where the search stalled and what to try."""


class OutputError(MbstabError):
    """An answer could not be written."""


class UnforeseenError(MbstabError):
    """A fault of the program at one of several files; the message ends with where it happened."""

    def __init__(self, name: str, error: Exception) -> None:
        import traceback

        where = "".join(traceback.format_exception(error)).rstrip("\n")
        super().__init__(f"{visible(name, lines=False)}: a fault of mbstab, please report it:\n{where}")


class SeveralErrors(MbstabError):
    """Several files could not be answered; the exit code is that of the worst of `errors`."""

    WEIGHTS = (3, 1, 2)
    """Exit codes by weight: an expectation that does not hold, a failed computation, a wrong file."""

    def __init__(self, errors: Sequence[MbstabError]) -> None:
        self.errors = tuple(errors)
        self.exit_code = max((error.exit_code for error in errors), key=self.WEIGHTS.index)
        super().__init__("\n\n".join(str(error) for error in errors))


class ExpectationError(MbstabError):
    """An ``expect:`` block or ``--require`` did not hold, or ``--verify`` contradicts."""

    exit_code = 3
