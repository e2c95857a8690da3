"""Modes as text: in words, coordinate by coordinate, and with their energies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbstab.analysis.verdict.wording import show
from mbstab.report.styles import document, joined
from mbstab.report.tables import number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.mode_energy import EnergyBalance
    from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue

UNKNOWN = "unknown"
"""Stands for an eigenvalue without an error bound: it may have any value."""

SMALL = 5e-4
"""Shares of energy and power smaller than this fraction of the largest are not printed."""

FAINT = 1e-12
"""Motions smaller than this fraction of the largest are rounding, and printed as 0."""


def value_text(e: Eigenvalue) -> str:
    """Return an eigenvalue, or a conjugate pair, with six digits; one without an error bound is not known."""
    return show(e.significant, bound=e.error_bound) if e.error_bound < math.inf else UNKNOWN


def motions_text(motions: Sequence[tuple[str, complex]]) -> str:
    """Return the motions of a mode in words: ``rear_body.psi 1.00, angle(steering) 0.62∠−34°``."""
    parts = []
    for name, x in motions:
        degrees = round(math.degrees(math.atan2(x.imag, x.real)))
        angle = f"∠{degrees}°".replace("-", "\N{MINUS SIGN}") if degrees else ""
        parts.append(f"{name} {abs(x):.2f}{angle}")
    return ", ".join(parts)


def modes_table(modes: Sequence[Eigenvalue]) -> str:
    """Return a table of modes in words."""
    rows = [[e.name or value_text(e), told_text(e)] for e in modes]
    return table(["mode", "motion"], rows, left=(0, 1))


def told_text(e: Eigenvalue) -> str:
    """Return a mode in words, with its whirl."""
    return motions_text(e.motions) + (f"; whirls {_ADVERBS[e.whirl]}" if e.whirl else "")


_ADVERBS = {"forward": "forward", "backward": "backward", "mixed": "forward and backward"}


def shapes_text(result: EigenResult) -> str:
    """Return the shapes of all modes, and their energies if they are known."""
    modes = [e for e in result.eigenvalues if e.vector is not None and e.value.imag >= 0.0]
    lines = []
    for n, e in enumerate(modes, 1):
        assert e.vector is not None
        lines += [f"Mode {n}{f' ({e.name})' if e.name else ''}: {value_text(e)} 1/s", ""]
        if e.motions:
            lines += [*wrap_lines(told_text(e), "  ", "  "), ""]
        rows = [
            [name, number(abs(x), 6), unit, number(round(math.degrees(math.atan2(x.imag, x.real)), 3), 6)]
            for name, unit, x in zip(result.coordinates, result.units, e.vector.tolist(), strict=True)
            if abs(x) > FAINT
        ]
        lines.append(table(["coordinate", "magnitude", "", "phase (deg)"], rows, left=(0, 2)))
        if e.energy is not None:
            lines.append(_energy_text(e.energy))
    if not lines:
        return "no mode has a shape: neutral eigenvalues and multipliers have none\n"
    note = (
        "Magnitudes: the coordinate that moves most, lengths relative to the size of the scene, has 1 m or 1 rad and "
        "phase 0; those not listed do not move. Energies are relative to the kinetic energy of the mode, and powers, "
        "too; load: geometric stiffness of weight, reactions, preload and turning; circulation: the skew part of the "
        "stiffness; reaction: that of rows on speeds, whose direction the mode changes."
    )
    return document([*lines, *wrap_lines(note)])


def _energy_text(balance: EnergyBalance) -> str:
    """Return the energies and powers of a mode as a table, with the balance of their sums."""
    sizes = [abs(x) for share in balance.shares for x in (share.kinetic, share.strain, share.load)]
    powers = [abs(x) for share in balance.shares for x in (share.damping, share.circulation, share.reaction)]
    least = SMALL * max(sizes, default=0.0), SMALL * max(powers, default=0.0)
    rounding = FAINT * abs(balance.value) * max(sizes, default=0.0)
    rows = []
    for share in (*balance.shares, balance.total):
        energies = [x if abs(x) >= least[0] else 0.0 for x in (share.kinetic, share.strain, share.load)]
        works = [
            x if abs(x) >= max(least[1], rounding) else 0.0 for x in (share.damping, share.circulation, share.reaction)
        ]
        if any(energies) or any(works):
            rows.append([share.owner, *(number(x, 4) if x else "-" for x in (*energies, *works))])
    heads = ["entry", "kinetic", "strain", "load", "damping\n(1/s)", "circulation\n(1/s)", "reaction\n(1/s)"]
    total = balance.total
    product, power = 2.0 * balance.value.real * total.energy, total.power
    product, power = (x if abs(x) > rounding else 0.0 for x in (product, power))
    closed = f"2 Re λ · energy = {number(product, 6)} 1/s, power {number(power, 6)} 1/s; they differ by "
    closed += f"{balance.defect:.0e} of the largest term"
    return joined([table(heads, rows, left=(0,)), *wrap_lines(closed)], end="\n")
