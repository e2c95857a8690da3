"""Simulations as text and data. A further output is one entry of `OUTPUTS`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mbstab.analysis.simulate.result import Simulation
from mbstab.analysis.simulate.tolerances import TOLERANCES as SIMULATE
from mbstab.errors import counted
from mbstab.model.schema import Model
from mbstab.model.units import per_second
from mbstab.records import dataclass
from mbstab.report.export import Rows, attributes
from mbstab.report.styles import document
from mbstab.report.tables import number, table, wrap_lines

if TYPE_CHECKING:
    from mbstab.compiler.system import Array


@dataclass(frozen=True)
class Output:
    """One group of columns.

    Attributes
    ----------
    name : str
        Key in npz files.
    heads : callable
        Maps a simulation to the heads of its columns, with units.
    values : callable
        Maps a simulation to an array of shape (n_t, columns) or (n_t,).
    """

    name: str
    heads: Callable[[Simulation], list[str]]
    values: Callable[[Simulation], Array]


def _named(sim: Simulation, form: str, order: int = 0) -> list[str]:
    return [f"{form.format(name)} ({per_second(unit, order)})" for name, unit in zip(sim.names, sim.units, strict=True)]


def _load_heads(sim: Simulation) -> list[str]:
    return [
        f"{component} of {owner} on {body} ({'N' if component.startswith('force') else 'N*m'})"
        for owner, body, component in sim.load_names
    ]


def _effort_heads(sim: Simulation) -> list[str]:
    return [f"effort of {owner} ({unit})" for owner, unit in sim.effort_names]


def _with_units(names: tuple[tuple[str, str], ...]) -> list[str]:
    return [f"{name} ({unit})" if unit else name for name, unit in names]


def _motion_heads(sim: Simulation, form: str, per: str = "") -> list[str]:
    return [f"{form.format(name)} ({unit}{per})" for name, unit in sim.motion_names]


OUTPUTS = (
    Output("time", lambda sim: ["time (s)"], lambda sim: sim.times),
    Output("q", lambda sim: _named(sim, "{}"), lambda sim: sim.q),
    Output("u", lambda sim: _named(sim, "rate({})", 1), lambda sim: sim.u),
    Output("a", lambda sim: _named(sim, "acceleration({})", 2), lambda sim: sim.a),
    Output("reactions", _load_heads, lambda sim: sim.loads),
    Output("efforts", _effort_heads, lambda sim: sim.efforts),
    Output("motions", lambda sim: _motion_heads(sim, "{}"), lambda sim: sim.motions),
    Output("motion_rates", lambda sim: _motion_heads(sim, "rate({})", "/s"), lambda sim: sim.motion_rates),
    Output("outputs", lambda sim: _with_units(sim.output_names), lambda sim: sim.outputs),
    Output("kinetic", lambda sim: ["kinetic energy (J)"], lambda sim: sim.kinetic),
    Output("potential", lambda sim: ["potential energy (J)"], lambda sim: sim.potential),
    Output("work", lambda sim: ["work (J)"], lambda sim: sim.work),
    Output("energy_error", lambda sim: ["energy error (J)"], lambda sim: sim.imbalance),
    Output("residuals", lambda sim: ["position residual", "velocity residual"], lambda sim: sim.residuals),
)
"""The contents of files, in the order of their columns."""


def simulation_rows(sim: Simulation, model: Model) -> Rows:
    """Return one line for each output time: the columns of `OUTPUTS`."""
    import numpy as np

    columns = np.hstack([np.reshape(out.values(sim), (len(sim.times), -1)) for out in OUTPUTS])
    return [head for out in OUTPUTS for head in out.heads(sim)], columns.tolist()


def simulation_arrays(sim: Simulation, model: Model) -> dict[str, Any]:
    """Return `OUTPUTS` as arrays, with the positions and orientations of bodies and all names."""
    import numpy as np

    arrays: dict[str, Any] = {out.name: out.values(sim) for out in OUTPUTS}
    arrays |= {f"{out.name}_columns": np.array(out.heads(sim)) for out in OUTPUTS}
    arrays |= {"positions": sim.positions, "rotations": sim.rotations, "velocities": sim.velocities}
    arrays |= {"spins": sim.spins, "multipliers": sim.nu}
    arrays |= {"coordinates": np.array(sim.names), "bodies": np.array(sim.bodies), "rows": np.array(sim.rows)}
    summary = {key: value for key, value in _summary(sim).items() if not isinstance(value, dict | list)}
    return arrays | {key: np.array(value) for key, value in summary.items()}


def _summary(sim: Simulation) -> dict[str, Any]:
    return {
        **attributes(sim, "method solver tol"),
        "step": math.nan if sim.step is None else sim.step,
        **attributes(sim, "error_estimate complete failure"),
        "start": float(sim.times[0]),
        "end": float(sim.times[-1]),
        **attributes(sim, "end_state max_constraint_residual energy_drift conservative"),
        **attributes(sim, "steps rejected evaluations runs charts"),
        "warnings": list(sim.warnings),
    }


def simulation_data(sim: Simulation, model: Model, whole: bool = False) -> dict[str, Any]:
    """Return the JSON object of ``mbstab simulate``.

    Keys: ``model``, ``title``, ``method``, ``solver``, ``tol`` (null with fixed steps), ``step`` (s),
    ``error_estimate`` (of the global error: positions relative to the size of the scene, entries of rotation matrices,
    speeds relative to the largest one, or to a part of the natural rate of the scene where nothing moves),
    ``complete``, ``failure``, ``start`` and ``end`` (s), ``end_state``
    (``coordinates`` in m and rad, ``rates`` and ``outputs``, by name), ``max_constraint_residual``,
    ``energy_drift`` (relative), ``conservative``, ``steps``, ``rejected``, ``evaluations``, ``runs``, ``charts``,
    ``warnings``; in a file also ``columns`` (names with units) and ``rows`` (a list for each output time).
    """
    heads, rows = simulation_rows(sim, model) if whole else ([], [])
    return _summary(sim) | ({"columns": heads, "rows": rows} if whole else {})


STILL = 1e-9
"""A motion within this fraction of the sizes counts as rest."""

NOTHING = 1e-12
"""The summary shows values below this fraction of their size as 0; files contain them unchanged."""

MOST = 40
"""Maximum number of coordinates in the summary unless all are requested."""


def simulation_text(sim: Simulation, model: Model, full: bool = False) -> str:
    """Return the summary of ``mbstab simulate``."""
    import numpy as np

    rows = []
    for i, (name, unit) in enumerate(zip(sim.names, sim.units, strict=True)):
        q, u, size = sim.q[:, i], sim.u[:, i], float(sim.sizes[i])
        rate = max(float(np.max(np.abs(u))), size / float(sim.times[-1] - sim.times[0] or 1.0))
        values = [_shown(x, size) for x in (q[0], q[-1], q.min(), q.max())] + [_shown(u[-1], rate)]
        rows.append([name, unit, *values])
    rows = rows if full else rows[:MOST]
    hidden = len(sim.names) - len(rows)
    heads = ["unit", "at first", "at last", "least", "largest"]
    lines: list[str] = [table(["coordinate", *heads, "last rate\n(unit/s)"], rows, left=(0, 1))]
    if hidden:
        lines += [f"{hidden} more coordinates; --full shows all", ""]
    rows = []
    for (name, unit), y in zip(sim.output_names, sim.outputs.T, strict=True):
        size = float(np.max(np.abs(y)))
        rows.append([name, unit, *(_shown(x, size) for x in (y[0], y[-1], y.min(), y.max()))])
    if rows:
        lines.append(table(["output", *heads], rows, left=(0, 1)))
    what = f"{sim.method}{f' ({sim.solver})' if sim.solver else ''}"
    steps = counted(sim.steps, "step") + (f", {sim.rejected} rejected" if sim.rejected else "")
    control = f"fixed step {sim.step:g} s" if sim.step is not None else f"tolerance {sim.tol:g}"
    lines += [
        f"time          {number(float(sim.times[0]), 9)} to {number(float(sim.times[-1]), 9)} s, "
        f"{counted(len(sim.times), 'output time')}",
        f"method        {what}, {control}",
        f"work done     {steps}, {sim.evaluations} evaluations in {counted(sim.runs, 'run')}",
        f"error         {_error(sim)}",
        f"constraints   largest residual {sim.max_constraint_residual:.1e} of the sizes in the scene",
        *wrap_lines(f"energy        {_energy(sim)}", "", " " * 14),
    ]
    if sim.charts:
        lines.append(f"orientation   Euler angles replaced by others {counted(sim.charts, 'time')}")
    if sim.complete and np.all(np.ptp(sim.q, axis=0) <= STILL * sim.sizes):
        text = "the simulation starts in equilibrium, so nothing moves"
        lines += [
            "",
            *wrap_lines(f"{text}; --perturb, such as mode:1=0.1, or initial: in the file disturb it"),
        ]
    if not sim.complete:
        lines += ["", *wrap_lines(f"ended early, at t = {number(float(sim.times[-1]), 9)} s")]
    return document(lines)


def _shown(value: float, size: float) -> str:
    """Return a number with eight digits; a value that is rounding relative to its size is 0."""
    return number(0.0 if abs(value) <= NOTHING * size else float(value), 8)


def _error(sim: Simulation) -> str:
    if math.isnan(sim.error_estimate):
        return "not estimated: one run"
    return f"{sim.error_estimate:.1e} estimated, to a factor {SIMULATE.error_factor:g}"


def _energy(sim: Simulation) -> str:
    what = "kinetic + potential drift" if sim.conservative else "kinetic + potential - work drift"
    largest = " or change of potential energy" if sim.conservative else ", change of potential energy or work"
    size = f"{number(sim.energy_scale, 4)} J, the largest kinetic energy{largest}"
    return f"{what} by {sim.energy_drift:.1e} of {size}"
