"""Eigenvalues beside what the nonlinear motion shows, as text and as data."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

from mbstab.analysis.verify import BLURRED
from mbstab.report import WIDTH
from mbstab.report.tables import number, table

if TYPE_CHECKING:
    from mbstab.analysis.verify import Observation, Verification


def verification_text(found: Verification) -> str:
    """Return the part of ``mbstab eig --verify`` that follows the eigenvalues."""
    heads = ["", "predicted\n(1/s)", "observed\n(1/s)", "relative\nerror", "known\nto", "time\n(s)", ""]
    lines = []
    if found.modes:
        lines.append(table(heads, [_row(x) for x in found.modes], left=(6,)))
        lines += _filled(_footer(found)) if any(x.observed == x.observed for x in found.modes) else []
    reasons = {x.reason: x.number for x in reversed(found.modes) if x.reason and x.reason not in found.reason}
    for reason, first in sorted(reasons.items(), key=lambda item: item[1]):
        lines += _filled(f"mode {first}: {reason}")
    lines += _filled(f"Nonlinear motion: {found.verdict}")
    lines += wrap(found.reason, width=WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
    return "\n".join(lines) + "\n"


def _footer(found: Verification) -> str:
    used = [x.amplitude for x in found.modes if x.observed == x.observed]
    least, most = f"{min(used):.0e}", f"{max(used):.0e}"
    amplitude = most if least == most else f"{least} to {most}"
    return (
        f"confirmed: real and imaginary part each within {BLURRED:g} times what they are known to, and growth seen; "
        f"amplitude {amplitude} of the sizes in the scene"
    )


def _row(x: Observation) -> list[str]:
    predicted = _shown(x.predicted, x.predicted, 1e-10 * abs(x.predicted))
    if x.observed != x.observed:
        return [str(x.number), predicted, "-", "-", "-", "-", x.verdict]
    known, observed = x.uncertainty / abs(x.predicted), _shown(x.observed, x.predicted, x.uncertainty)
    return [str(x.number), predicted, observed, f"{x.error:.0e}", f"{known:.0e}", number(x.span, 3), x.verdict]


def _shown(s: complex, predicted: complex, known: float) -> str:
    """Return an eigenvalue with seven digits; a part that is not known to differ from 0 is 0."""
    real, imag = (0.0 if abs(part) <= known else part for part in (s.real, s.imag))
    return f"{number(real, 7)} ± {number(abs(imag), 7)}i" if predicted.imag else number(real, 7)


def _filled(text: str) -> list[str]:
    return wrap(text, width=WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def verification_data(found: Verification) -> dict[str, Any]:
    """Return the JSON object ``verification`` of ``mbstab eig --verify``.

    Keys: ``verdict`` (``confirmed``, ``contradicted``, ``cannot be judged``), ``reason``, ``evaluations``,
    ``modes``. Of each mode: ``number``, ``kind``, ``predicted`` and ``observed`` (``real`` and ``imag`` in 1/s; null
    where nothing was observed), ``error`` (relative), ``uncertainty`` (1/s), ``span`` (s), ``amplitude`` (of the
    sizes in the scene), ``verdict``, ``reason``.
    """
    return {
        "verdict": found.verdict,
        "reason": found.reason,
        "evaluations": found.evaluations,
        "modes": [
            {
                "number": x.number,
                "kind": x.kind,
                "predicted": {"real": x.predicted.real, "imag": x.predicted.imag},
                "observed": {"real": x.observed.real, "imag": x.observed.imag},
                "error": x.error,
                "uncertainty": x.uncertainty,
                "span": x.span,
                "amplitude": x.amplitude,
                "verdict": x.verdict,
                "reason": x.reason,
            }
            for x in found.modes
        ],
    }
