"""Eigenvalues as data: JSON and CSV."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mbstab.model.schema import Model
from mbstab.report.export import Rows, attributes, parameters_data, polar

if TYPE_CHECKING:
    from mbstab.analysis.spectrum.mode_energy import EnergyBalance, EnergyShare
    from mbstab.analysis.spectrum.precise import PreciseResult
    from mbstab.analysis.spectrum.results import EigenResult
    from mbstab.analysis.verdict.rule import IfSymmetric, Verdict
    from mbstab.analysis.verdict.spectrum import Spectrum


def _asked(result: EigenResult | PreciseResult, model: Model) -> dict[str, Any]:
    """Return what eigenvalues belong to as the first part of their JSON object."""
    return {
        "parameters": parameters_data(model),
        "method": result.method,
        "frame": result.frame,
        "frozen_time": result.frozen,
    }


def eigen_data(result: EigenResult, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig``.

    Keys: ``model``, ``title``, ``parameters`` (see `parameters_data`), ``method``, ``frame`` (the steady
    motion that defines the frame of the equations; empty: the coordinates of the file), ``frozen_time``
    (true: no stability verdict), ``period`` (s, of a periodic motion; its eigenvalues are Floquet exponents
    with a ``multiplier``), the keys of `verdict_data`, ``eigenvalues`` (``real`` and ``imag`` in 1/s,
    ``kind``, ``frequency`` in Hz, ``damping_ratio``, ``time_to_double`` and ``time_to_half`` in s,
    ``error_bound`` in 1/s, ``condition``, ``backward_error``, ``participation``, ``vector``, ``motions``, ``whirl``,
    ``energy``, ``name``, ``together``), ``coordinates`` (names and units, in the order of the vectors), ``counts``
    (`mbstab.analysis.spectrum.results.Counts`), ``neutral_directions`` (what the neutral eigenvalues belong to, in
    words, whatever the verdict), ``warnings``. A ``vector`` has ``magnitude`` (m or rad) and
    ``phase`` (rad) of each coordinate; the one that moves most, lengths relative to the size of the scene,
    has magnitude 1 and phase 0. It is null for neutral eigenvalues and multipliers. ``motions`` are the independent
    ones of joints and coordinates that are not small, the largest first: ``name``, and ``magnitude`` and ``phase``
    (rad) relative to it, lengths counted in the size of the scene. ``whirl`` is ``forward``, ``backward`` or
    ``mixed``, null where nothing whirls. ``energy`` is null unless it is asked for: see `energy_data`. ``name`` is
    that of the file, null where it has none. ``together`` is the number of eigenvalues that are not told apart from it,
    itself included; where they have fewer shapes than they are, the ``vector`` of some is null, and their
    ``participation`` empty.
    """
    return {
        **_asked(result, model),
        "period": result.period,
        **verdict_data(result.judged),
        "eigenvalues": [
            {
                "real": e.value.real,
                "imag": e.value.imag,
                **attributes(e, "kind frequency damping_ratio"),
                "time_to_double": e.time_to_double if e.time_to_double > 0 else math.nan,
                "time_to_half": -e.time_to_double if e.time_to_double < 0 else math.nan,
                **attributes(e, "multiplier error_bound condition backward_error participation"),
                "vector": None if e.vector is None else polar(e.vector),
                "motions": [{"name": name, **polar(x)} for name, x in e.motions],
                "whirl": e.whirl or None,
                "name": e.name or None,
                "energy": None if e.energy is None else energy_data(e.energy),
                "together": e.together,
            }
            for e in result.eigenvalues
        ],
        "coordinates": [{"name": name, "unit": x} for name, x in zip(result.coordinates, result.units, strict=True)],
        "counts": {**asdict(result.counts), "degrees_of_freedom": result.counts.degrees_of_freedom},
        "neutral_directions": result.neutral_directions,
        "warnings": result.warnings,
    }


def energy_data(balance: EnergyBalance) -> dict[str, Any]:
    """Return the energy of a mode as part of a JSON object.

    Keys: ``of`` (a list with ``entry``, the energies ``kinetic``, ``strain`` and ``load`` relative to the kinetic
    energy of the mode, and the powers ``damping``, ``circulation`` and ``reaction`` relative to it, in 1/s), ``total``
    (the sums), ``real`` (of the eigenvalue: twice it times the energy is the power), ``defect`` (by how much it is
    not, relative to the largest term). `mbstab.analysis.spectrum.mode_energy` says what they are.
    """
    shares = [{"entry": share.owner, **_numbers(share)} for share in balance.shares]
    return {
        "of": shares, "total": _numbers(balance.total), "real": balance.value.real, "defect": balance.defect
    }  # fmt: skip


def _numbers(share: EnergyShare) -> dict[str, float]:
    return {name: value for name, value in asdict(share).items() if name != "owner"}


def verdict_data(judged: Verdict) -> dict[str, Any]:
    """Return a verdict as part of a JSON object.

    Keys: ``verdict`` (the word), ``modulo`` (up to what it holds: ``symmetries`` that map all motions to motions,
    ``family``: what distinguishes motions of the same kind, such as the speed), ``in_place`` (whether disturbed
    motions also stay near the reference itself; null: not claimed), ``reason`` (its grounds, in one text),
    ``reasons`` (the same, sentence by sentence), ``evidence`` (its weakest fact: ``structural``, ``enclosed`` or
    ``numerical``), ``spectrum`` (see `spectrum_data`), ``if_symmetric`` (``about``, the further symmetries of a scene
    within the digits of the file, and its ``verdict``; null: none is found).
    """
    return {
        "verdict": judged.word,
        "modulo": {"symmetries": judged.symmetries, "family": judged.family},
        "in_place": judged.in_place,
        "reason": "; ".join(judged.reasons),
        "reasons": judged.reasons,
        "evidence": judged.evidence,
        "spectrum": spectrum_data(judged.spectrum),
        "if_symmetric": symmetric_data(judged.if_symmetric),
    }


def symmetric_data(found: IfSymmetric | None) -> dict[str, Any] | None:
    """Return the verdict of a scene with more symmetries as part of a JSON object, None where there is none."""
    return None if found is None else attributes(found, "about verdict")


def spectrum_data(spectrum: Spectrum | None) -> dict[str, Any] | None:
    """Return it as part of a JSON object, None where nothing was judged.

    Keys: ``right``, ``left``, ``axis``, ``open`` (numbers of eigenvalues right and left of the imaginary axis, held
    on it by a structure, and whose side is not known; null: not counted), ``not_right`` (left of it or on it),
    ``zeros`` (zeros that nothing explains, not among the others), ``explained`` (number of those that symmetries
    and families explain, zeros and pairs ±iΩ; ``neutral_directions`` has these in words), ``turning`` (how many of
    these are ±iΩ), ``chains`` (lengths of the Jordan chains of the explained zeros; null: not known), ``drifting``
    (``name`` and ``power`` of t of symmetries along which disturbances grow), ``linear`` (whether no eigenvalue
    lies right of the axis or may do so).
    """
    if spectrum is None:
        return None
    chains = spectrum.chains
    return {
        **attributes(spectrum, "right left axis open not_right zeros explained"),
        "turning": 0 if chains is None else chains.turning,
        "chains": None if chains is None else chains.zeros,
        "drifting": [{"name": name, "power": k} for name, k in (() if chains is None else chains.drifting)],
        "linear": spectrum.linear,
    }


def eigen_rows(result: EigenResult, model: Model) -> Rows:
    """Return heads and rows of a CSV file: one eigenvalue per row, with magnitude and phase of every coordinate.

    Shapes have the scale of `mbstab.report.modes.shapes_text`: the coordinate that moves most has 1 and phase 0. (Modes
    in words also tell angles of joints, and are relative to the largest motion that they tell.)
    """
    heads = [
        "real (1/s)",
        "imag (1/s)",
        "kind",
        "frequency (Hz)",
        "damping ratio",
        "error bound (1/s)",
        "whirl",
        "mode",
    ]
    for name, unit in zip(result.coordinates, result.units, strict=True):
        heads += [f"magnitude of {name} ({unit}; largest coordinate 1)", f"phase of {name} (rad)"]
    rows = []
    for e in result.eigenvalues:
        shape: list[Any] = [""] * (2 * len(result.coordinates))
        if e.vector is not None:
            parts = polar(e.vector)
            shape[::2], shape[1::2] = parts["magnitude"].tolist(), parts["phase"].tolist()
        rows.append(
            [e.value.real, e.value.imag, e.kind, e.frequency, e.damping_ratio, e.error_bound, e.whirl, e.name, *shape]
        )
    return heads, rows


def precise_data(result: PreciseResult, model: Model) -> dict[str, Any]:
    """Return the JSON object of ``mbstab eig --precision``.

    Keys: ``model``, ``title``, ``parameters`` (see `parameters_data`, rounded to doubles), ``method``, ``frame``,
    ``frozen_time``, ``digits`` (all of them correct), ``working_digits``, ``seconds``, the keys of `verdict_data`,
    ``eigenvalues`` without the neutral ones (``real``, ``imag`` and ``error_bound`` in 1/s as decimal strings;
    ``kind``),
    ``neutral`` (``zeros`` and the frequencies ``shifts`` of pairs, rad/s as decimal strings), ``counts``,
    ``smallest_pivot`` and ``largest_zero_pivot`` (the rank decisions about zero eigenvalues, as decimal strings),
    ``double_precision`` (``verdict`` there), ``warnings``.
    """
    return {
        **_asked(result, model),
        **attributes(result, "digits working_digits seconds"),
        **verdict_data(result.judged),
        "eigenvalues": [
            {"real": e.real, "imag": e.imag, "kind": e.kind, "error_bound": e.bound} for e in result.eigenvalues
        ],
        "neutral": {"zeros": result.zeros, "shifts": result.shifts},
        "counts": {**asdict(result.counts), "degrees_of_freedom": result.counts.degrees_of_freedom},
        "smallest_pivot": result.kept,
        "largest_zero_pivot": result.dropped,
        "double_precision": {"verdict": result.plain.verdict},
        "warnings": result.warnings,
    }


def precise_rows(result: PreciseResult, model: Model) -> Rows:
    """Return heads and lines of a CSV file of eigenvalues with many digits."""
    rows = [[e.real, e.imag, e.kind, e.bound] for e in result.eigenvalues]
    return ["real (1/s)", "imag (1/s)", "kind", "error bound (1/s)"], rows
