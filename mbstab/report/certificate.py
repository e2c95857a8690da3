"""Proven enclosures as text and as data."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from mbstab.analysis.proof.certify import Certificate
from mbstab.analysis.verdict.spectrum import Modulo
from mbstab.model.schema import Model
from mbstab.report.eigenvalue_data import spectrum_data, symmetric_data
from mbstab.report.export import attributes
from mbstab.report.styles import Style, document
from mbstab.report.tables import decimals, table, wrap_lines
from mbstab.report.verdicts import verdict_badge, word_style

SHOWN = 20
"""Digits of a midpoint in a table."""

COORDINATES = 6
"""Maximum number of coordinates of an equilibrium that are shown."""

WORDS = {
    "left": "left of the axis",
    "right": "right of the axis",
    "imaginary": "on the axis",
    "zero": "zero, by symmetry",
    "carried": "on the axis, by symmetry",
    "open": "not known",
}

STYLES: dict[str, Style] = {"right": "grows", "zero": "faint", "carried": "faint", "open": "open"}
"""Styles of rows, by where the eigenvalues are."""

STATUS = {"proven": ", proven", "conditional": ", proven under conditions", "not provable": ""}
"""What is said of the verdict."""


def certificate_data(result: Certificate, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig --certify``.

    Keys: ``model``, ``title``, ``verdict``, ``status`` (``proven``, ``conditional``: the verdict
    rests on ``conditions``, or ``not provable``), ``proven`` (whether the status is that),
    ``conditions``, ``statement``, ``modulo``, ``in_place``, ``reason``, ``evidence``, ``warnings`` (as those of
    ``mbstab eig``), ``eigenvalues`` (``real`` and ``imag`` in 1/s, each with
    ``midpoint`` and ``radius`` as decimal strings, ``count``, ``kind``, ``why``), ``assumed``,
    ``reasons``, ``notes``, ``digits``, ``spectrum`` (see `mbstab.report.eigenvalue_data.spectrum_data`),
    ``if_symmetric`` (as that of ``mbstab eig``), ``parameter``, ``followed`` (which equilibrium an interval is for)
    and ``parts`` of an interval (``low`` and ``high`` in SI as fractions, ``verdict``, ``modulo``, ``reason``,
    ``at_low`` and ``at_high``: enclosures of the coordinates that were solved for).
    """
    return {
        **attributes(result, "verdict status proven conditions statement"),
        "modulo": _modulo(result.modulo),
        "in_place": result.in_place,
        "reason": "; ".join(result.judged.reasons if result.judged is not None else result.reasons),
        **attributes(result, "evidence warnings"),
        "eigenvalues": [
            {
                "real": decimals(e.real, result.digits),
                "imag": decimals(e.imag, result.digits),
                **attributes(e, "count kind why"),
            }
            for e in result.eigenvalues
        ],
        **attributes(result, "assumed reasons notes"),
        "spectrum": spectrum_data(result.spectrum),
        "if_symmetric": symmetric_data(result.if_symmetric),
        **attributes(result, "digits parameter followed"),
        "parts": [
            {
                "low": str(part.low),
                "high": str(part.high),
                "verdict": part.verdict,
                "modulo": _modulo(part.modulo),
                "reason": part.reason,
                "at_low": {name: decimals(x, result.digits) for name, x in part.at_low.items()},
                "at_high": {name: decimals(x, result.digits) for name, x in part.at_high.items()},
            }
            for part in result.parts
        ],
    }


def _modulo(modulo: Modulo) -> dict[str, tuple[str, ...]]:
    return {"symmetries": modulo.symmetries, "family": modulo.family}


def certificate_text(result: Certificate, model: Model) -> str:
    """Return the answer of ``mbstab eig --certify`` as text."""
    lines: list[str] = [verdict_badge(result.verdict, STATUS[result.status]), ""]
    if result.eigenvalues:
        rows = [
            [_number(e.real), _number(e.imag), f"{e.radius:.0e}" if e.wide else "0", str(e.count), WORDS[e.kind]]
            for e in result.eigenvalues
        ]
        heads = ["real part\n(1/s)", "imaginary part\n(1/s)", "radius\n(1/s)", "number", "where"]
        lines.append(table(heads, rows, (4,), [STYLES.get(e.kind) for e in result.eigenvalues]))
    if result.parts:
        rows = [[_in_unit(p.low, result), _in_unit(p.high, result), p.verdict] for p in result.parts]
        head = "under conditions" if result.conditions else "proven"
        unit = f"\n({result.unit})" if result.unit else ""
        lines.append(
            table(
                [f"{result.parameter} from{unit}", f"to{unit}", head],
                rows,
                (2,),
                [word_style(p.verdict) for p in result.parts],
            )
        )
        lines += _where(result)
    lines += _wrapped(result.statement[0].upper() + result.statement[1:], "")
    for reason in result.reasons[1:]:
        lines += _wrapped(reason, "  ")
    for sentence in () if result.spectrum is None else result.spectrum.sentences():
        lines += _wrapped(sentence, "")
    if result.if_symmetric is not None:
        lines += _wrapped(str(result.if_symmetric), "")
    zeros = [e for e in result.eigenvalues if e.kind == "zero"]
    on_axis = list(dict.fromkeys(e.why for e in result.eigenvalues if e.kind in ("imaginary", "carried")))
    if zeros or on_axis or result.notes or result.warnings:
        lines.append("")
    lines += [line for e in zeros for line in _wrapped(f"zero because nothing depends on {e.why}", "")]
    lines += [line for why in on_axis for line in _wrapped(f"exactly on the axis because {why}", "")]
    lines += [line for note in (*result.notes, *result.warnings) for line in _wrapped(note, "")]
    lines += ["", "assumed: " + ("nothing but the model file" if not result.assumed else "")]
    lines[-1] = lines[-1].rstrip()
    for text in result.assumed:
        lines += _wrapped(text, "  ")
    lines.append(f"computed with {result.digits} digits")
    return document(lines)


def _where(result: Certificate) -> list[str]:
    """Return the coordinates of the motion that is followed over an interval, at the ends of its parts."""
    places = {x: at for p in result.parts for x, at in ((p.low, p.at_low), (p.high, p.at_high)) if at}
    if not (result.followed and places):
        return []
    ends = [x for x in sorted(places) if x in (min(places), max(places))]
    lines = _wrapped(f"about {result.followed}:", "")
    for x in ends:
        shown = [f"{name} = {float(value):.6g}" for name, value in list(places[x].items())[:COORDINATES]]
        more = f", … ({len(places[x])} in all, see --format json)" if len(places[x]) > COORDINATES else ""
        value = f"{result.parameter} = {_in_unit(x, result)} {result.unit}".rstrip()
        lines += _wrapped(f"{value}: {', '.join(shown)}{more}", "  ")
    return [*lines, ""]


def _in_unit(x: Fraction, result: Certificate) -> str:
    """Return a value of the parameter of an interval in its unit."""
    return f"{float(x) / result.factor:.12g}"


def _wrapped(text: str, indent: str) -> list[str]:
    return wrap_lines(text, indent, indent + "  " if indent else "")


def _number(x: Any) -> str:
    return "0" if x.is_zero() else str(x.mid().str(SHOWN, radius=False))
