"""The linear statement: where eigenvalues lie and what zeros belong to, whatever is proven about motions.

A verdict is about all motions nearby. What the linearized equations say by themselves is told beside it: how many
eigenvalues lie on each side of the imaginary axis, and how disturbances along explained zeros grow, from the ranks of
powers of the matrix (Jordan chains; Gantmacher 1959, chapter VI).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Literal

from mbstab.analysis.verdict.wording import listed, phrases, power
from mbstab.errors import counted
from mbstab.records import dataclass

Evidence = Literal["structural", "enclosed", "numerical"]


@dataclass(frozen=True)
class Chains:
    """The Jordan chains of explained eigenvalues.

    Attributes
    ----------
    zeros : tuple of int
        Lengths of the chains at zero, longest first.
    turning : int
        Number of eigenvalues ±iΩ that rotate with the motion.
    longest_turning : int
        Length of the longest chain of these.
    drifting : tuple of (str, int)
        Symmetries along which disturbances grow, and the power of t with which they do.
    """

    zeros: tuple[int, ...] = ()
    turning: int = 0
    longest_turning: int = 0
    drifting: tuple[tuple[str, int], ...] = ()

    @property
    def drift(self) -> int:
        """The power of t with which disturbances along neutral directions grow; 0: they do not grow."""
        return max(*self.zeros[:1], self.longest_turning, 1) - 1


@dataclass(frozen=True)
class Modulo:
    """The symmetries and families up to which a verdict holds.

    Attributes
    ----------
    symmetries : tuple of str
        Symmetries of all motions: ``position along x``, ``heading`` and the like.
    family : tuple of str
        Quantities that distinguish the steady motions of a family: ``speed``.
    """

    symmetries: tuple[str, ...] = ()
    family: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return all of them in words."""
        return self.symmetries + self.family


@dataclass(frozen=True)
class Neutral(Modulo):
    """Directions of neighbouring motions of the same kind.

    Attributes
    ----------
    count : int
        Number of eigenvalues that belong to them.
    chains : Chains or None
        How disturbances along them grow; None: not known.
    evidence : str
        The weakest evidence among them.
    checked : str
        How far a family without a symmetry was followed, in words; empty: there is none.
    linear : bool
        Whether the motions, up to symmetries, obey linear equations, of which zero is a semisimple eigenvalue.
    tumbling : bool
        Whether motions with other values of conserved momenta, at rest here, need not become steady.
    slow : tuple of str
        Those of the family that are speeds of a scene at rest; they stay small where the energy bounds them.
    """

    count: int = 0
    chains: Chains | None = Chains()
    evidence: Evidence = "structural"
    checked: str = ""
    linear: bool = False
    slow: tuple[str, ...] = ()
    tumbling: bool = False

    @property
    def drift(self) -> int:
        """0: disturbances along them stay constant; 1: they may grow like t (by another speed); 2: like t²."""
        return 1 if self.chains is None else self.chains.drift


@dataclass(frozen=True)
class Spectrum:
    """Numbers of eigenvalues by their place.

    Attributes
    ----------
    right, left, axis, open : int or None
        Right and left of the imaginary axis, held on it by a structure, and those whose side is not known; None: not
        counted, where a few eigenvalues are computed.
    not_right : int
        Those that lie left of the axis or on it, as the verdict implies.
    zeros : int
        Eigenvalues that are zero and that nothing explains; they are not among the others.
    explained : int
        Those of symmetries and families, zeros and pairs ±iΩ.
    chains : Chains or None
        Chains of these; None: not known.
    names : tuple of str
        Symmetries and families that explain them.
    multipliers : bool
        Whether the eigenvalues are Floquet exponents.
    instant : bool
        Whether the equations are those of an instant.
    """

    right: int | None
    left: int | None
    axis: int | None
    open: int | None
    not_right: int = 0
    zeros: int = 0
    explained: int = 0
    chains: Chains | None = None
    names: tuple[str, ...] = ()
    multipliers: bool = False
    instant: bool = False

    @property
    def linear(self) -> bool:
        """Whether no eigenvalue lies right of the axis, or may do so: nothing grows exponentially."""
        return self.right == 0 and not self.open and not self.instant

    def sentences(self) -> tuple[str, ...]:
        """Return it in words."""
        if self.right is None:
            return ()
        beyond, inside, on = "right of the imaginary axis", "left of it", "on it"
        if self.multipliers:
            beyond, inside, on = "outside the unit circle", "inside", "on it"
        parts = [f"{self.right} {beyond}"]
        places = (self.left, inside), (self.axis, on), (self.not_right, f"{inside} or {on}")
        parts += [f"{n} {where}" for n, where in places if n]
        parts += [f"{counted(self.zeros, 'zero')} unexplained"] if self.zeros else []
        parts += [f"{self.open} undecided"] if self.open else []
        at = " at this instant" if self.instant else ""
        found = [f"eigenvalues{at}: {', '.join(parts)}"]
        if self.explained:
            found.append(self._explained())
        return tuple(found)

    def _explained(self) -> str:
        """Return what zeros and turning pairs belong to, in words."""
        turning = 0 if self.chains is None else self.chains.turning
        kinds = [counted(self.explained - turning, "zero")] if self.explained > turning else []
        kinds += [f"{counted(turning // 2, 'pair')} ± iΩ"] if turning else []
        text = f"{listed(kinds)} explained by {phrases(self.names) if self.names else 'the given momenta'}"
        if self.chains is None or not self.chains.drift:
            return text
        by_power: dict[int, list[str]] = {}
        for name, degree in self.chains.drifting:
            by_power.setdefault(degree, []).append(name)
        drifts = [f"{phrases(names)} {_verb(names)} like {power(k)}" for k, names in sorted(by_power.items())]
        lengths = Counter(x for x in self.chains.zeros if x > 1)
        chains = [f"{counted(n, 'chain')} of {length}" for length, n in sorted(lengths.items(), reverse=True)]
        return ": ".join(x for x in (f"{text}, in {listed(chains)}" if chains else text, "; ".join(drifts)) if x)


def _verb(names: Sequence[str]) -> str:
    return "drifts" if len(names) == 1 else "drift"
