"""Names of symmetries and of families of motions in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mbstab.model.schema import is_length

HEADS: dict[str, tuple[str, str]] = {
    "speed of translation along ": ("the speed along ", ""),
    "speed of rotation about ": ("the rate of turn about ", ""),
    "speed of rotation ": ("the rate of turn ", ""),
    "speed of turn of ": ("the spin of ", ""),
    "speed of common shift of ": ("the rate of the common shift of ", ""),
    "speed along ": ("the speed along ", ""),
    "speed of ": ("the speed of ", "the speeds of "),
    "translation along ": ("the position along ", ""),
    "rotation about ": ("the angle about ", ""),
    "rotation ": ("the angle ", ""),
    "turn of ": ("the turn of ", ""),
    "common shift of ": ("the common shift of ", ""),
}
"""Beginnings of the names of symmetries and families, and of the words for them: for one, for several."""

WHOLE = {"the motion itself": "the place along the motion", "speed of the motion itself": "the speed"}
"""Names that are replaced as a whole."""

MOST = 6
"""Maximum number of things that are listed by name."""


def _parts(name: str) -> tuple[str, str, str]:
    """Return the beginning of the words for a name, alone and with others of the kind, and the rest.

    The second is empty where words stand alone.
    """
    if name in WHOLE:
        return WHOLE[name], "", ""
    if name.startswith("speed along ") and "." in name:
        name = f"speed of {name.removeprefix('speed along ')}"
    for head, (one, many) in HEADS.items():
        if name.startswith(head):
            rest = name.removeprefix(head)
            if head == "speed of " and not is_length(rest):
                return "the rate of ", "the rates of ", rest
            return one, many or (one if rest in ("x", "y", "z") else ""), rest
    if "." in name and " " not in name:
        return ("the position ", "the positions ", name) if is_length(name) else ("the angle ", "the angles ", name)
    return ("" if name.startswith("the ") else "the ") + name, "", ""


def phrases(names: Sequence[str]) -> str:
    """Return names as a list in plain words; those of a kind are named together, and a long list ends with a number.

    >>> phrases(("translation along x", "translation along y", "rear_wheel.psi", "speed"))
    'the position along x and y, the angle rear_wheel.psi and the speed'
    >>> phrases(("motion of rotor", "motion of rotor"))
    'the motion of rotor (2×)'
    """
    kinds: dict[str, tuple[str, str, list[str]]] = {}
    for name in names[:MOST]:
        one, many, rest = _parts(name)
        kinds.setdefault(many or one + rest, (one, many, []))[2].append(rest)
    found = [
        one + rests[0] if len(rests) == 1 else many + listed(rests) if many else f"{one}{rests[0]} ({len(rests)}×)"
        for one, many, rests in kinds.values()
    ]
    return listed([*found, f"{len(names) - MOST} more"] if len(names) > MOST else found)


def listed(names: Sequence[str]) -> str:
    """Return names as a list in words."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


REST = "while everything else stays small"
"""Ends a sentence about what drifts: the motion itself is stable."""


def drifting(drift: int) -> str:
    """Return how a change along neutral directions drifts, in words."""
    return f"; only this offset drifts like {power(drift)}, {REST}" if drift else ""


def power(drift: int) -> str:
    """Return a power of time in words."""
    return "t" if drift == 1 else f"t^{drift}"


def show(s: complex, digits: int = 6, bound: float = 0.0) -> str:
    """Return an eigenvalue with as many significant digits, none below an error bound; a pair as ±."""
    real = known(s.real, digits, bound)
    return real if s.imag == 0.0 else f"{real} ± {known(abs(s.imag), digits, bound)}i"


def known(x: float, digits: int, bound: float = 0.0) -> str:
    """Return a number with as many significant digits, but none below an error bound."""
    if 0.0 < bound < math.inf and math.isfinite(x) and x:
        if abs(x) <= bound:
            return "0"
        digits = min(digits, max(1, math.floor(math.log10(abs(x))) - math.ceil(math.log10(bound)) + 1))
    return f"{x + 0.0:.{digits}g}"


def strict(kind: str) -> str:
    """Return what a function has at the reference in words, by the kind of a `mbstab.analysis.verdict.rule.Minimum`."""
    if kind == "with a multiple":
        return "with a multiple of the angular momentum has a strict minimum here"
    return f"has a strict {kind} here"


def unplaced(disc: Any) -> str:
    """Return why an eigenvalue in a `mbstab.analysis.verdict.rule.Disc` leaves the verdict open."""
    if not disc.radius < float("inf"):
        return f"no error bound could be computed for the eigenvalue {show(disc.centre)} 1/s"
    many = disc.count > 1
    if disc.holds_zero and not disc.radius:
        what = f"{disc.count} eigenvalues are" if many else "an eigenvalue is"
        return f"{what} exactly zero, and no symmetry or family of motions was found that explains it: a critical state"
    if disc.holds_zero:
        what = f"{disc.count} eigenvalues lie" if many else "an eigenvalue lies"
        return (
            f"{what} within {disc.radius:.1e} 1/s of zero, and no symmetry or family of motions was found that "
            "explains it: a critical state, or motions so slow that rounding hides on which side of the imaginary axis "
            "they are"
        )
    known = abs(disc.centre.real) > disc.radius
    value = f"{show(disc.centre if known else complex(0.0, disc.centre.imag))} 1/s"
    if many and disc.radius:
        return (
            f"{disc.count} eigenvalues lie within {disc.radius:.1e} 1/s of {value}, and this disc reaches over the "
            "imaginary axis"
        )
    what = f"{disc.count} eigenvalues {value} lie" if many else f"the eigenvalue {value} lies"
    where = f"within its error bound {disc.radius:.1e} of" if disc.radius else "exactly on"
    return (
        f"{what} {where} the imaginary axis, and no structure of the equations holds {'them' if many else 'it'} there"
    )
