"""Frequency responses and responses over time as text and as data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.model.words import UNSTABLE
from mbstab.report.export import Rows, in_unit
from mbstab.report.styles import document
from mbstab.report.tables import eigenvalue, number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.response.margins import LargestGain, Margins
    from mbstab.analysis.response.response import Response
    from mbstab.analysis.response.transfer import Channel
    from mbstab.analysis.response.zeros import Zeros
    from mbstab.analysis.sweep.unbalance import Peak, UnbalanceResponse

HALF_TURN = 1e-6
"""Steps of a phase this near to half a turn (rad) are those across a pole or a zero without damping."""

ROWS = 13
"""Rows of a table; the other formats hold all."""


def decibels(value: Any) -> Any:
    """Return 20 log₁₀ of a size."""
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(np.abs(value))


def angles(values: Any) -> Any:
    """Return phases (degrees), above -180 and up to 180; nan on a pole and at 0."""
    found = np.where(np.isfinite(values) & (values != 0.0), np.degrees(np.angle(values)), np.nan)
    return np.where(found == -180.0, 180.0, found)


def _degrees(angle: float, error: float = 0.0) -> str:
    """Return a phase with six digits, none below an error bound; one that rounds to -180 is 180."""
    text = number(angle, 6, error)
    return "180" if text == "-180" else text


def phase(values: Any) -> Any:
    """Return the phase of a curve without jumps (degrees), the first one between -180 and 180; nan on a pole and at 0.

    Across a pole or a zero without damping it jumps by 180: down at a pole, where the values grow, up at a zero, as
    with the least damping.
    """
    found, known = np.full(len(values), np.nan), np.isfinite(values) & (values != 0.0)
    if not known.any():
        return found
    angle, size = np.unwrap(np.angle(values[known])), np.log(np.abs(values[known]))
    steps = np.diff(angle)
    # A step inside is compared with both neighbours; one at an end, with its own.
    beyond = np.pad(size, 1, mode="edge")
    grows = beyond[1:-2] + beyond[2:-1] >= beyond[:-3] + beyond[3:]
    turned = np.abs(np.abs(steps) - np.pi) < HALF_TURN
    steps[turned] = np.where(grows, -np.pi, np.pi)[turned]
    found[known] = np.degrees(np.concatenate([angle[:1], angle[:1] + np.cumsum(steps)]))
    return found


def unit(channel: Channel, kind: str) -> str:
    """Return the unit of a kind of response, such as ``rad/(N*m)``; empty if it is not known.

    An impulse has the unit of its input times seconds.
    """
    source, goal = channel.source_unit, channel.goal_unit
    if not source or not goal:
        return ""
    if kind == "impulse":
        source = "s" if source == "1" else f"{source}*s"
    return f"{goal}/({source})" if any(x in source for x in "*/") else f"{goal}/{source}"


def response_text(result: Response, model: Model) -> str:
    """Return the answer of ``mbstab response`` as text."""
    lines: list[str] = []
    rows = _rows(len(result.x))
    for i, (channel, values, zeros) in enumerate(zip(result.channels, result.values, result.zeros, strict=True)):
        own = unit(channel, result.kind)
        lines.append(f"From {channel.source} to {channel.goal}" + (f" ({own})" if own else ""))
        if result.kind == "frequency":
            body = [_frequency_row(result.x[k], values[k], result.errors[i][k]) for k in rows]
            lines.append(table(["ω (rad/s)", "gain", "gain (dB)", "phase (°)", "error of gain"], body))
        else:
            body = [[f"{x:.6g}" for x in (result.x[k], values[k])] for k in rows]
            lines.append(table(["time (s)", f"after a unit {result.kind}"], body))
            lines += [growth] if (growth := result.growth[i]) else []
        lines += _left_out(len(result.x), "frequencies" if result.kind == "frequency" else "times")
        lines += _zeros_text(zeros)
        if result.margins:
            lines += [*_largest_text(result.largest[i]), *_margins_text(result.margins[i], zeros)]
        elif result.kind == "frequency":
            lines.append(f"margins and the largest gain are not computed for {len(result.poles)} states")
        lines.append("")
    return document(lines)


def _rows(number: int) -> Any:
    """Return which of many values a table shows: each so many-th and the last."""
    return np.unique([*range(0, number, _step(number)), number - 1])


def _step(number: int) -> int:
    return -(-(number - 1) // (ROWS - 1)) or 1


def _left_out(number: int, what: str) -> list[str]:
    """Return a line that says which values a table leaves out, if it does."""
    if number <= ROWS:
        return []
    return [f"of {number} {what} the first of each {_step(number)} and the last are shown; --format csv has all"]


def _frequency_row(omega: float, value: complex, error: float) -> list[str]:
    """Return a line of the table; a gain that is no larger than its error is said to be at most the sum of both."""
    gain = float(abs(value))
    if gain <= error < np.inf and gain:
        return [f"{omega:.6g}", f"≤ {gain + error:.0e}", "", "", ""]
    shown = f"{error:.0e}" if np.isfinite(error) else ""
    turn = float(np.degrees(error / gain)) if gain else 0.0
    return [
        f"{omega:.6g}", number(gain, 6, error), f"{decibels(gain):.6g}", _degrees(float(angles(value)), turn), shown
    ]  # fmt: skip


def _zeros_text(zeros: Zeros) -> list[str]:
    if zeros.doubt:
        return wrap_lines(f"zeros: not decided: {zeros.doubt}")
    if zeros.vanishes:
        return ["the output does not respond to the input: nothing but gains of 0 leads from one to the other"]
    # One of each pair stands for both.
    pairs = [(z if abs(z) > e else 0j, e) for z, e in zip(zeros.values, zeros.errors, strict=True) if z.imag >= 0.0]
    each = [f"{eigenvalue(z)} ± {e:.0e}" if e else f"{eigenvalue(z)} (exact)" for z, e in pairs]
    lines = wrap_lines(f"zeros (1/s, with errors): {', '.join(each) or 'none'}")
    axis = "" if zeros.growing else f": {counted(int(np.sum(zeros.on_axis)), 'zero')} on the imaginary axis"
    words = {
        True: "minimum phase",
        False: f"not minimum phase{axis}",
        None: "whether it is minimum phase is not decided",
    }
    reserve = ", as far as rounding errors tell" if zeros.hidden and zeros.minimum_phase is not None else ""
    lines.append(words[zeros.minimum_phase] + reserve)
    if zeros.hidden:
        what = "that the input does not reach or the output does not see, as far as rounding errors tell"
        listed = ", ".join(eigenvalue(s) for s in zeros.hidden if s.imag >= 0.0)
        lines += wrap_lines(f"{counted(len(zeros.hidden), 'eigenvalue')} {what}: {listed}")
    return lines


def _largest_text(found: LargestGain) -> list[str]:
    what = f"{found.value:.10g} {_at(found.frequency)}, relative error at most {found.tolerance:g}"
    if not np.isfinite(found.value):
        what = f"{'none' if np.isnan(found.value) else 'infinite'}: {found.reason}"
    return wrap_lines(f"largest gain (H∞ norm): {what}")


def _at(frequency: float) -> str:
    return f"at {frequency:.6g} rad/s" if np.isfinite(frequency) else "at high frequencies"


def _margins_text(found: Margins, zeros: Zeros) -> list[str]:
    loop = "the loop in which the output is subtracted from the input is"
    if zeros.hidden_growing:
        grows = ", ".join(eigenvalue(s) for s in zeros.hidden_growing if s.imag >= 0.0)
        said = f"{loop} unstable, whatever its gain: hidden eigenvalues grow ({grows})"
    elif found.closed is None and found.ill_posed:
        said = f"{loop} ill-posed: the response tends to -1 at high frequencies"
    elif found.closed is None:
        said = f"whether {loop} stable is not decided"
    else:
        said = f"{loop} {'stable' if found.closed else 'unstable'}"
        if found.closed and not zeros.hidden_decaying:
            said += ", apart from hidden eigenvalues that do not decay"
    lines = wrap_lines(said)
    if found.doubt:
        return lines + wrap_lines(f"margins: not decided: {found.doubt}")
    if found.always_real:
        lines.append("gain margins: none; the response is real at all frequencies")
    else:
        each = [
            f"× {number(x.factor, 6, x.error)} ({decibels(x.factor):.4g} dB) {_at(x.frequency)}" for x in found.gain
        ]
        lines += wrap_lines(f"gain margins: {', '.join(each) or 'none'}")
    each = [
        f"{number(x.phase, 6, x.error)}° (delay {number(x.delay, 6, np.radians(x.error) / x.frequency)} s) at "
        f"{x.frequency:.6g} rad/s"
        for x in found.phase
    ]
    lines += wrap_lines(f"phase margins: {', '.join(each) or 'none'}")
    if found.no_delay:
        said = "any delay, however small, makes the loop unstable: the gain stays above 1 at high frequencies"
        lines += wrap_lines(said)
    return lines


def _margins_data(found: Margins, largest: LargestGain) -> dict[str, Any]:
    return {
        "margins": None
        if found.doubt
        else {
            "closed_loop_stable": found.closed,
            "gain": [{"frequency": x.frequency, "factor": x.factor, "error": x.error} for x in found.gain],
            "phase": [
                {"frequency": x.frequency, "phase": x.phase, "delay": x.delay, "error": x.error} for x in found.phase
            ],
            "always_real": found.always_real,
            "no_delay": found.no_delay,
        },
        "largest_gain": {
            "value": largest.value,
            "frequency": largest.frequency,
            "tolerance": largest.tolerance,
            "infinite": bool(np.isinf(largest.value)),
            "reason": largest.reason,
        },
    }


def response_data(result: Response, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab response``.

    Keys: ``model``, ``title``, ``kind``, ``frequency`` (rad/s) or ``time`` (s), ``poles`` and ``channels``: ``input``,
    ``output``, ``unit``, ``real``, ``imag`` and ``error``, or ``values``, ``zeros`` (``real``, ``imag``, ``error``;
    null: not decided, for the reason in ``doubt``), ``minimum_phase`` and ``hidden`` (null: not decided), ``vanishes``,
    and over frequency ``margins`` (``closed_loop_stable``, ``gain`` and ``phase``, each with ``error`` of the factor or
    the phase, and ``frequency`` null at high frequencies, ``always_real``, ``no_delay``: any delay makes the loop
    unstable; null: not decided) and
    ``largest_gain`` (``value``, null if there is none or if it is ``infinite``, ``frequency``, ``tolerance``,
    ``reason``).
    """
    found = []
    for i, (channel, values, zeros) in enumerate(zip(result.channels, result.values, result.zeros, strict=True)):
        many = {"values": values}
        if result.kind == "frequency":
            many = {"real": values.real, "imag": values.imag, "error": result.errors[i]}
        known = [
            {"real": z.real, "imag": z.imag, "error": float(e)}
            for z, e in zip(zeros.values.tolist(), zeros.errors, strict=True)
        ]
        found.append(
            {
                "input": channel.source,
                "output": channel.goal,
                "unit": unit(channel, result.kind),
                **many,
                "zeros": None if zeros.doubt else known,
                "doubt": zeros.doubt,
                "minimum_phase": zeros.minimum_phase,
                "hidden": None if zeros.doubt else [{"real": s.real, "imag": s.imag} for s in zeros.hidden],
                "vanishes": zeros.vanishes,
                **(_margins_data(result.margins[i], result.largest[i]) if result.margins else {}),
            }
        )
    return {
        "kind": result.kind,
        "frequency" if result.kind == "frequency" else "time": result.x,
        "poles": [{"real": s.real, "imag": s.imag} for s in result.poles.tolist()],
        "channels": found,
    }


def unbalance_text(result: UnbalanceResponse, model: Model) -> str:
    """Return the answer of ``mbstab response --unbalance`` as text."""
    lines = []
    unit, factor = spin_unit(result, model)
    rows, speeds = _rows(len(result.speeds)), result.speeds / factor
    whole = zip(result.outputs, result.units, result.values, result.peaks, result.further, strict=True)
    for name, own, values, peak, others in whole:
        lines += wrap_lines(f"From {_sources(result)} to {name}" + (f" ({own})" if own else ""))
        angle = angles(values)
        body = [
            [f"{speeds[k]:.6g}", f"{abs(values[k]):.6g}", _degrees(angle[k]), UNSTABLE if result.unstable[k] else ""]
            for k in rows
        ]
        heads = [f"{result.parameter} ({unit})", "amplitude", "phase (°)", ""]
        shown = len(heads) if np.any(result.unstable[rows]) else len(heads) - 1
        lines += [table(heads[:shown], [row[:shown] for row in body]), *_left_out(len(speeds), "speeds")]
        for which in (peak, *others):
            text = _peak_text(which, unit, factor)
            lines += wrap_lines(text if which is peak else f"further {text}")
        lines.append("")
    if np.any(result.unstable):
        ends = " to ".join(f"{x:.6g}" for x in np.unique(speeds[result.unstable][[0, -1]]))
        lines += wrap_lines(
            f"Unstable at {int(np.sum(result.unstable))} of {len(speeds)} speeds, {ends} {unit}: these amplitudes are "
            "those of the steady solution, which the rotor leaves."
        )
    return document(lines)


def spin_unit(result: UnbalanceResponse, model: Model) -> tuple[str, float]:
    """Return the unit of the spin, and the factor to rad/s."""
    spin = model.parameters[result.parameter]
    return spin.unit or "rad/s", spin.factor


def _sources(result: UnbalanceResponse) -> str:
    """Return the unbalances in words."""
    if result.relative:
        return f"an unbalance at {next(iter(result.unbalances))}"
    each = []
    for place, z in result.unbalances.items():
        angle = _degrees(float(angles(z)))
        each.append(f"{place} ({abs(z):.6g} kg m" + (f" at {angle}°)" if angle != "0" else ")"))
    return f"unbalance{'s' * (len(each) > 1)} at {', '.join(each)}"


def _peak_text(peak: Peak, unit: str, factor: float) -> str:
    """Return a peak in words."""
    at = f"at {peak.speed / factor:.6g} {unit}"
    if not peak.bounded:
        return f"peak: none: the amplitude grows without bound {at}, a critical speed without damping"
    if peak.value == 0.0:
        return "no response"
    shown = f"{abs(peak.value):.6g} {at}, phase {_degrees(float(angles(peak.value)))}°"
    return f"peak: {shown}" if peak.inside else f"no peak inside of the range; largest: {shown}"


def unbalance_data(result: UnbalanceResponse, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab response --unbalance``.

    Keys: ``model``, ``title``, ``kind``, ``point`` (or several), ``parameter``, ``unbalances`` (``point``, ``real`` and
    ``imag`` in kg m), ``speed`` (rad/s) and ``outputs``: ``name``, ``unit``, ``real`` and ``imag``, and ``peak`` with
    ``speed``, ``real`` and ``imag`` (null if the amplitude grows without bound there, at a speed that is known to
    ``error``) and whether it is ``inside`` the range, ``further_peaks`` (those of at least a hundredth of it, in the
    same form); ``verdicts`` of the motion without it.
    """
    found = [
        {
            "name": name,
            "unit": own,
            "real": values.real,
            "imag": values.imag,
            "peak": _peak_data(peak),
            "further_peaks": [_peak_data(other) for other in others],
        }
        for name, own, values, peak, others in zip(
            result.outputs, result.units, result.values, result.peaks, result.further, strict=True
        )
    ]
    given = [{"point": place, "real": z.real, "imag": z.imag} for place, z in result.unbalances.items()]
    head = {"kind": "unbalance", "point": result.point, "parameter": result.parameter}
    return head | {"unbalances": given, "speed": result.speeds, "outputs": found, "verdicts": list(result.verdicts)}


def _peak_data(peak: Peak) -> dict[str, Any]:
    known = {"real": peak.value.real, "imag": peak.value.imag} if peak.bounded else {"real": None, "imag": None}
    return {"speed": peak.speed, **known, "error": None if peak.bounded else peak.error, "inside": peak.inside}


def unbalance_rows(result: UnbalanceResponse, model: Model) -> Rows:
    """Return one line for each speed with all outputs."""
    unit, factor = spin_unit(result, model)
    heads = [f"{result.parameter} ({unit})"]
    for name, own in zip(result.outputs, result.units, strict=True):
        heads += [f"{name} {part}" + (f" ({own})" if own else "") for part in ("real", "imag", "amplitude")]
        heads.append(f"{name} phase (deg)")
    columns = [part for values in result.values for part in (values.real, values.imag, np.abs(values), angles(values))]
    lines = np.column_stack([in_unit(result.speeds, factor), *columns]).tolist()
    return [*heads, "verdict"], [[*line, verdict] for line, verdict in zip(lines, result.verdicts, strict=True)]


def response_rows(result: Response, model: Model) -> Rows:
    """Return one line for each frequency or time, with all channels."""
    names = [f"{c.goal}/{c.source}" for c in result.channels]
    units = [f" ({own})" if (own := unit(c, result.kind)) else "" for c in result.channels]
    named = list(zip(names, units, strict=True))
    if result.kind == "frequency":
        heads = [
            "frequency (rad/s)",
            *(f"{name} {part}{own}" for name, own in named for part in ("real", "imag", "error")),
        ]
        pairs = zip(result.values, result.errors, strict=True)
        columns = [part for values, errors in pairs for part in (values.real, values.imag, errors)]
    else:
        heads, columns = ["time (s)", *map("".join, named)], list(result.values)
    return heads, np.column_stack([result.x, *columns]).tolist()
