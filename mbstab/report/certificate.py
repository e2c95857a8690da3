"""Proven enclosures as text and as data."""

from __future__ import annotations

from textwrap import wrap
from typing import Any

from mbstab.analysis.certify import Certificate
from mbstab.report import WIDTH
from mbstab.report.tables import table

SHOWN = 20
"""Digits of a midpoint in a table."""

WORDS = {
    "left": "left of the axis",
    "right": "right of the axis",
    "imaginary": "on the axis",
    "zero": "zero",
    "open": "not told",
}


def decimals(x: Any, digits: int) -> dict[str, str]:
    """Return a ball as midpoint and radius in decimal; the radius covers the rounding of the midpoint."""
    middle, radius, exponent = (int(part) for part in x.mid_rad_10exp(digits))
    return {"midpoint": _scientific(middle, exponent), "radius": _scientific(radius, exponent)}


def _scientific(mantissa: int, exponent: int) -> str:
    if mantissa == 0:
        return "0"
    digits = str(abs(mantissa)).rstrip("0")
    shift = exponent + len(str(abs(mantissa))) - 1
    text = digits[0] + ("." + digits[1:] if len(digits) > 1 else "")
    return f"{'-' if mantissa < 0 else ''}{text}e{shift:+d}" if shift else f"{'-' if mantissa < 0 else ''}{text}"


def certificate_data(result: Certificate, model: str, title: str) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig --certify``.

    Keys: ``model``, ``title``, ``verdict``, ``proven``, ``statement``, ``eigenvalues`` (``real``
    and ``imag`` in 1/s, each with ``midpoint`` and ``radius`` as decimal strings, ``count``,
    ``kind``, ``why``), ``assumed``, ``reasons``, ``digits``, ``parameter`` and ``parts`` of an
    interval (``low`` and ``high`` in SI as fractions, ``verdict``).
    """
    return {
        "model": model,
        "title": title,
        "verdict": result.verdict,
        "proven": result.proven,
        "statement": result.statement,
        "eigenvalues": [
            {
                "real": decimals(e.real, result.digits),
                "imag": decimals(e.imag, result.digits),
                "count": e.count,
                "kind": e.kind,
                "why": e.why,
            }
            for e in result.eigenvalues
        ],
        "assumed": result.assumed,
        "reasons": result.reasons,
        "digits": result.digits,
        "parameter": result.parameter,
        "parts": [{"low": str(part.low), "high": str(part.high), "verdict": part.verdict} for part in result.parts],
    }


def certificate_text(result: Certificate, title: str) -> str:
    """Return the answer of ``mbstab eig --certify`` as text."""
    lines = [title, ""] if title else []
    if result.eigenvalues:
        rows = [
            [_number(e.real), _number(e.imag), f"{e.radius:.0e}" if e.wide else "0", str(e.count), WORDS[e.kind]]
            for e in result.eigenvalues
        ]
        heads = ["real part\n(1/s)", "imaginary part\n(1/s)", "radius\n(1/s)", "number", "where"]
        lines.append(table(heads, rows, left=(4,)))
    if result.parts:
        rows = [[f"{float(p.low):.12g}", f"{float(p.high):.12g}", p.verdict] for p in result.parts]
        lines.append(table([f"{result.parameter} from\n(SI)", "to\n(SI)", "proven"], rows, left=(2,)))
    lines += _wrapped(result.statement[0].upper() + result.statement[1:], "")
    for reason in result.reasons[1:]:
        lines += _wrapped(reason, "  ")
    zeros = [e for e in result.eigenvalues if e.kind == "zero"]
    on_axis = list(dict.fromkeys(e.why for e in result.eigenvalues if e.kind == "imaginary"))
    if zeros or on_axis:
        lines.append("")
    lines += [line for e in zeros for line in _wrapped(f"zero because of: {e.why}", "")]
    lines += [line for why in on_axis for line in _wrapped(f"exactly on the axis because {why}", "")]
    lines += ["", "assumed: " + ("nothing but the model file" if not result.assumed else "")]
    lines[-1] = lines[-1].rstrip()
    for text in result.assumed:
        lines += _wrapped(text, "  ")
    lines.append(f"computed with {result.digits} digits")
    return "\n".join(lines) + "\n"


def _wrapped(text: str, indent: str) -> list[str]:
    return wrap(text, width=WIDTH, initial_indent=indent, subsequent_indent=indent + "  " if indent else "")


def _number(x: Any) -> str:
    return "0" if x.is_zero() else str(x.mid().str(SHOWN, radius=False))
