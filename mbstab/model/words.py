"""The words of verdicts: what answers say, what ``expect:`` blocks may ask for, what ``--require`` accepts."""

from __future__ import annotations

ASYMPTOTIC = "asymptotically stable"
ASYMPTOTIC_UP_TO = "asymptotically stable up to symmetry"
STABLE = "stable"
STABLE_UP_TO = "stable up to symmetry"
MARGINAL = "marginally stable"
UNSTABLE = "unstable"
UNDECIDED = "undecided"

WORDS = (ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO, MARGINAL, UNSTABLE, UNDECIDED)
"""All verdicts."""

REQUIRED = {
    "asymptotic": (ASYMPTOTIC, ASYMPTOTIC_UP_TO),
    "stable": (ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO),
    "marginal": (ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO, MARGINAL),
    "linear": (ASYMPTOTIC, ASYMPTOTIC_UP_TO, STABLE, STABLE_UP_TO, MARGINAL),
}
"""Which verdicts ``--require`` accepts; ``linear`` any beside which no eigenvalue lies right of the imaginary axis."""

STRENGTH: dict[str, frozenset[str]] = {
    ASYMPTOTIC: frozenset(WORDS) - {UNSTABLE},
    ASYMPTOTIC_UP_TO: frozenset({ASYMPTOTIC_UP_TO, STABLE_UP_TO, MARGINAL, UNDECIDED}),
    STABLE: frozenset({STABLE, STABLE_UP_TO, MARGINAL, UNDECIDED}),
    STABLE_UP_TO: frozenset({STABLE_UP_TO, MARGINAL, UNDECIDED}),
    MARGINAL: frozenset({MARGINAL, UNDECIDED}),
    UNSTABLE: frozenset({UNSTABLE, UNDECIDED}),
    UNDECIDED: frozenset({UNDECIDED}),
}
"""What each verdict implies: the same, or a weaker claim."""
