"""Eigenvalues against the nonlinear motion, as text and as data."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mbstab.analysis.compare.tolerances import TOLERANCES as COMPARE
from mbstab.analysis.verdict.wording import power
from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.report.eigenvalue_data import eigen_data
from mbstab.report.eigenvalues import eigen_text
from mbstab.report.export import attributes
from mbstab.report.styles import Style, Text, document, joined, styled
from mbstab.report.tables import fill_lines, number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.compare.neutral_drift import Drift
    from mbstab.analysis.compare.verify import Observation, Verification


STYLES: dict[str, Style] = {"confirmed": "good", "contradicted": "bad"}


def verification_text(found: Verification, model: Model) -> Text:
    """Return the answer of ``mbstab eig --verify`` as text."""
    heads = ["mode", "predicted\n(1/s)", "observed\n(1/s)", "relative\nerror", "known\nto", "time\n(s)", "verdict"]
    lines: list[str] = []
    if found.modes:
        lines.append(table(heads, [_row(x) for x in found.modes], (6,), [STYLES.get(x.verdict) for x in found.modes]))
        lines += fill_lines(_footer(found)) if any(x.observed == x.observed for x in found.modes) else []
    if found.neutral is not None:
        lines += fill_lines(_neutral(found.neutral))
    reasons = {x.reason: x.number for x in reversed(found.modes) if x.reason and x.reason not in found.reason}
    for reason, first in sorted(reasons.items(), key=lambda item: item[1]):
        lines += fill_lines(f"mode {first}: {reason}")
    lines.append(joined(["Nonlinear motion: ", styled(found.verdict, STYLES.get(found.verdict))], ""))
    lines += wrap_lines(found.reason, "  ", "  ", hyphens=False)
    return document([eigen_text(found.result, model), *lines])


def _footer(found: Verification) -> str:
    used = [x.amplitude for x in found.modes if x.observed == x.observed]
    least, most = f"{min(used):.0e}", f"{max(used):.0e}"
    amplitude = most if least == most else f"{least} to {most}"
    return (
        f"confirmed: real and imaginary part each within {COMPARE.uncertainties_of_observation:g} times what they are "
        f"known to, and growth seen; amplitude {amplitude} of the sizes in the scene"
    )


def _neutral(x: Drift) -> str:
    """Return the result along the neutral directions, in words."""
    many = counted(x.count, "neutral direction")
    if x.verdict == "cannot be judged":
        return f"{many}: not judged: {x.reason}"
    if x.verdict == "contradicted":
        return f"{many}: contradicted: {x.reason}"
    moving = x.count - x.staying
    how = "with the turning frame" if x.power == -1 else f"like {power(x.power)}"
    ways = [f"{x.staying} {'stay' if x.staying > 1 else 'stays'} constant"] if x.staying else []
    ways += [f"{moving} {'drift' if moving > 1 else 'drifts'} {how}"] if moving else []
    return (
        f"{many} tried: {', '.join(ways)}, as the linearized equations say, to {x.error:.0e} of the displacement in "
        f"{number(x.span, 3)} s"
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


def verification_data(found: Verification, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig --verify``: that of ``mbstab eig``, and an object ``verification``.

    Keys of the latter: ``verdict`` (``confirmed``, ``contradicted``, ``cannot be judged``), ``reason``,
    ``evaluations``, ``modes``, ``neutral`` (null without neutral eigenvalues). Of each mode: ``number``, ``kind``,
    ``predicted`` and ``observed`` (``real`` and ``imag`` in 1/s; null where nothing was observed), ``error``
    (relative), ``uncertainty`` (1/s), ``span`` (s), ``amplitude`` (of the sizes in the scene), ``verdict``,
    ``reason``. Of the
    neutral directions: ``count``, ``staying`` (with constant displacements), ``power`` (of time, with which the
    others drift; -1 if they rotate with a frame), ``error`` (largest difference from the prediction, relative to the
    displacement), ``span`` (s), ``verdict``, ``reason``.
    """
    told = {
        **attributes(found, "verdict reason evaluations"),
        "neutral": None if found.neutral is None else asdict(found.neutral),
        "modes": [
            attributes(x, "number kind predicted observed error uncertainty span amplitude verdict reason")
            for x in found.modes
        ],
    }
    return eigen_data(found.result, model) | {"verification": told}
