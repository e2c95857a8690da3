"""Simulations as pictures: quantities over time, energies, constraint drift, phase planes.

A picture is requested as text: quantities separated by commas, such as ``rod.theta, rate(rod.theta)``, of which
those with the same unit share a panel; ``energy``; ``residuals``; or ``phase:rod.theta``, rates over coordinates.
A further quantity is one entry of `FUNCTIONS` or `WORDS`, a further picture of several panels one of `GROUPS`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mbstab.analysis.reference.efforts import MOTION_UNITS, motion_name
from mbstab.analysis.simulate.result import Simulation
from mbstab.compiler.system import Array
from mbstab.errors import UsageError, alternatives, suggestion
from mbstab.model.measures import unit_of_effort, unit_of_output
from mbstab.model.schema import Entry, Model
from mbstab.records import dataclass
from mbstab.report.pictures.curves import INK, THIN, decimated, thinned
from mbstab.report.pictures.drawing import EXACT, draw_legend, house_style, legend_marker, panel_width, titled_figure
from mbstab.report.pictures.scales import typeset, with_minus_sign
from mbstab.report.pictures.value_axes import FLAT, common_part, set_decades, set_room

MOST = 12
"""Maximum number of curves in a picture: more could not be distinguished."""

DASHES = ("-", (0, (5.0, 2.0)), (0, (1.2, 1.6)), (0, (7.0, 2.0, 1.5, 2.0)))
"""Styles of curves; with the three inks in turn they make `MOST` different ones."""

BROAD: dict[str, Any] = {"color": "0.75", "linestyle": "-", "linewidth": 4.5}
"""Style of a curve below others."""

LITTLE = 0.5
"""Kinetic energy that changes by less than this fraction of its maximum is drawn relative to its minimum."""

UNBALANCED = 3.0
"""Energies that change by less than this many times their imbalance change by errors."""

ROUNDED = 1e-14
"""Energy drift below this fraction of the energies is rounding, and is drawn as zero."""

TITLES = {
    "m": "length",
    "rad": "angle",
    "m/s": "speed",
    "rad/s": "angular rate",
    "m/s²": "acceleration",
    "rad/s²": "angular acceleration",
    "N": "force",
    "N·m": "torque",
    "J": "energy",
}
"""Titles of panels with several curves, by unit."""

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Quantity:
    """One curve over time.

    Attributes
    ----------
    name : str
        The name in a request, such as ``rate(rod.theta)``.
    unit : str
        SI unit, as written on pictures; empty for plain numbers.
    values : callable
        Maps a simulation to an array of shape (n_t,).
    said : str
        Its text in legends, if different from its name.
    """

    name: str
    unit: str
    values: Callable[[Simulation], Array]
    said: str = ""

    @property
    def label(self) -> str:
        """Its name in a legend."""
        return self.said or self.name


@dataclass(frozen=True)
class Panel:
    """Curves with the same unit over time.

    Attributes
    ----------
    curves : tuple of Quantity
    title : str
        Text at its axis, if different from `TITLES`.
    logarithmic : bool
    beneath : str
        Name of a curve that is drawn broad and pale below the others, as it may coincide with them.
    """

    curves: tuple[Quantity, ...]
    title: str = ""
    logarithmic: bool = False
    beneath: str = ""

    @property
    def text(self) -> str:
        """Text at its axis."""
        return self.said(0)

    def said(self, power: int) -> str:
        """Return the text at its axis, with numbers in a power of ten of the unit."""
        unit = self.curves[0].unit
        name = self.curves[0].label if len(self.curves) == 1 else TITLES.get(unit, "value")
        scale = f"10{str(power).translate(_RAISED)} " if power else ""
        return f"{self.title or name} ({scale}{unit})" if unit else self.title or name


@dataclass(frozen=True)
class Picture:
    """A picture: panels over time, or pairs of quantities over each other.

    Attributes
    ----------
    name : str
        Part of the name of its file.
    panels : tuple of Panel
    phases : tuple of (Quantity, Quantity)
        Horizontal and vertical quantity.
    """

    name: str
    panels: tuple[Panel, ...] = ()
    phases: tuple[tuple[Quantity, Quantity], ...] = ()


# --- what can be requested ------------------------------------------------------------------------------------------


Reader = Callable[[Model, str], list[Quantity]]
"""Reads the text inside the parentheses of a function."""


def _of_coordinate(form: str, array: str, order: int) -> Reader:
    """Return a reader of the name of a coordinate as a column of an array of the simulation."""

    def read(model: Model, name: str) -> list[Quantity]:
        known = model.coordinates()
        if name not in known:
            bodies = list(dict.fromkeys(x.rpartition(".")[0] for x in known))
            text = "" if form == "{}" else f" in {form.format(name)!r}"
            hint = alternatives(
                name, [*known, *model.outputs], "coordinates and outputs" if model.outputs else "coordinates"
            )
            if name in bodies:
                hint = "coordinates: " + ", ".join(x for x in known if x.startswith(f"{name}."))
            raise UsageError(f"there is no coordinate {name!r}{text}\nhint: {hint}")
        i, unit = known.index(name), typeset(model.unit_of(name, order))
        return [Quantity(form.format(name), unit, lambda sim: np.asarray(getattr(sim, array)[:, i]))]

    return read


def _of_name(model: Model, name: str) -> list[Quantity]:
    """Read the name of an output, or of a coordinate."""
    if name not in model.outputs or name in model.coordinates():
        return _of_coordinate("{}", "q", 0)(model, name)
    i, unit = list(model.outputs).index(name), unit_of_output(model, model.outputs[name])
    return [Quantity(name, typeset(unit), lambda sim: np.asarray(sim.outputs[:, i]))]


def _of_reaction(what: str, unit: str) -> Reader:
    """Return a reader of the name of a joint, possibly with a component such as ``pivot.x``, as reactions."""

    def read(model: Model, name: str) -> list[Quantity]:
        owner, dot, component = name.partition(".")
        letters = "z" if what == "torque" and model.dimension == 2 else "xyz"[: model.dimension]
        transmitting = [entry for group in model.entries.values() for entry in group.values() if entry.has_reaction]
        sections = [entry.section for entry in transmitting if entry.name == owner]
        if not sections:
            known = [entry.name for entry in transmitting]
            hint = alternatives(owner, known, "those with reactions")
            raise UsageError(f"nothing called {owner!r} has reactions, in {f'{what}({name})'!r}\nhint: {hint}")
        if len(sections) > 1:
            where = " and ".join(sections)
            raise UsageError(
                f"{what}({name}): there are several called {owner!r}, in {where}\nhint: give one of them another name"
            )
        if dot and (len(component) != 1 or component not in letters):
            raise UsageError(f"{what}({name}): a {what} here has the components {', '.join(letters)}")
        called = f"{sections[0].removesuffix('s')} {owner!r}"
        parts = component or letters
        return [Quantity(f"{what}({owner}.{x})", unit, _reaction(called, f"{what} {x}")) for x in parts]

    return read


def _reaction(owner: str, component: str) -> Callable[[Simulation], Array]:
    def values(sim: Simulation) -> Array:
        for i, (one, _, other) in enumerate(sim.load_names):
            if (one, other) == (owner, component):
                return np.asarray(sim.loads[:, i])
        raise UsageError(f"{owner} transmits no {component}")

    return values


def _of_effort(model: Model, name: str) -> list[Quantity]:
    """Read the name of an entry that acts along one motion as its effort."""
    found = {entry.called: entry for entry in _with_efforts(model)}
    owners = [owner for owner, entry in found.items() if entry.name == name]
    if not owners:
        known = list(dict.fromkeys(entry.name for entry in found.values()))
        hint = alternatives(name, known, "those with efforts")
        if along := [entry.name for entry in found.values() if str(entry.values.get("joint")) == name]:
            hint = "along this joint act " + ", ".join(f"effort({x})" for x in along)
        raise UsageError(
            f"there is no force or drive along one motion {name!r}, in {f'effort({name})'!r}\nhint: {hint}"
        )
    if len(owners) > 1:
        raise UsageError(
            f"effort({name}): there are several called {name!r}, in drives and forces\n"
            "hint: give one of them another name"
        )
    unit = unit_of_effort(model, found[owners[0]]).replace("*", "·")
    return [Quantity(f"effort({name})", unit, lambda sim: _effort(sim, owners[0]))]


def _with_efforts(model: Model) -> list[Entry]:
    """Return the drives and forces of a model that act along one motion."""
    entries = (entry for section in ("drives", "forces") for entry in model.entries.get(section, {}).values())
    return [entry for entry in entries if entry.has_effort]


def _effort(sim: Simulation, owner: str) -> Array:
    return np.asarray(sim.efforts[:, [x for x, _ in sim.effort_names].index(owner)])


def _of_motion(motion: str, array: str = "motions", form: str = "{}", per: str = "") -> Reader:
    """Return a reader of the name of a joint as one of its motions, or as the rate of it."""

    def read(model: Model, joint: str) -> list[Quantity]:
        name = motion_name(motion, joint)
        known = [motion_name(x, entry.name) for entry in model.entries["joints"].values() for x in entry.kind.motions]
        if name not in known:
            own = [x for x in known if x.endswith(f"({joint})")]
            listed = "motions of joints"
            hint = f"{listed}: {', '.join(own)}" if own else alternatives(name, known, listed)
            raise UsageError(f"there is no joint motion {name!r}\nhint: {hint}")
        return [Quantity(form.format(name), MOTION_UNITS[motion] + per, lambda sim: _motion(sim, array, name))]

    return read


def _motion(sim: Simulation, array: str, name: str) -> Array:
    return np.asarray(getattr(sim, array)[:, [x for x, _ in sim.motion_names].index(name)])


def _rate(model: Model, name: str) -> list[Quantity]:
    """Read a coordinate, or a motion of a joint, as its rate."""
    call = _CALL.fullmatch(name)
    if call is not None and call[1] in MOTION_UNITS:
        return _of_motion(call[1], "motion_rates", "rate({})", "/s")(model, call[2])
    return _of_coordinate("rate({})", "u", 1)(model, name)


FUNCTIONS: dict[str, Reader] = {
    "": _of_name,
    "rate": _rate,
    "acceleration": _of_coordinate("acceleration({})", "a", 2),
    **{motion: _of_motion(motion) for motion in MOTION_UNITS},
    "force": _of_reaction("force", "N"),
    "torque": _of_reaction("torque", "N·m"),
    "effort": _of_effort,
}
"""Readers by the name before a parenthesis; without parentheses a name is an output or a coordinate."""


def _above(values: Array) -> Array:
    return np.asarray(values - np.min(values))


WORDS: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        Quantity("kinetic", "J", lambda sim: sim.kinetic, "kinetic energy"),
        Quantity("potential", "J", lambda sim: sim.potential, "potential energy"),
        Quantity("total", "J", lambda sim: sim.kinetic + sim.potential, "kinetic + potential"),
        Quantity("work", "J", lambda sim: sim.work, "work of other forces"),
        Quantity("drift", "J", lambda sim: sim.imbalance, "change of kinetic + potential − work"),
    )
}
"""Quantities of the whole scene."""

GROUPS: dict[str, tuple[Panel, ...]] = {
    "energy": (
        Panel(
            (
                WORDS["kinetic"],
                # Its zero is arbitrary: relative to its minimum it is comparable to the kinetic energy.
                Quantity("potential", "J", lambda sim: _above(sim.potential), "potential energy above its least"),
                Quantity("sum", "J", lambda sim: sim.kinetic + _above(sim.potential), "sum of both"),
                WORDS["work"],
            ),
            "energy",
            beneath="sum",
        ),
        Panel((WORDS["drift"],), "energy drift"),
    ),
    "residuals": (
        Panel(
            (
                Quantity("position", "", lambda sim: sim.residuals[:, 0], "positions"),
                Quantity("velocity", "", lambda sim: sim.residuals[:, 1], "velocities"),
            ),
            "largest relative residual, if not 0",
            True,
        ),
    ),
}
"""Groups of panels by name."""

_CALL = re.compile(r"([A-Za-z_]+)\(\s*([^()\s]*|[A-Za-z_]+\([^()]*\))\s*\)")
_PHASE = "phase:"


def read_picture(model: Model, text: str) -> Picture:
    """Return the picture that a text such as ``rod.theta, rate(rod.theta)`` describes.

    Raises
    ------
    UsageError
        If a name is unknown, or a picture would have too many curves.
    """
    words = [word.strip() for word in text.removeprefix(_PHASE).split(",") if word.strip()]
    if not words:
        raise UsageError(f"--plot {text!r} names nothing\nhint: a coordinate, or {_alternatives()}")
    slug = "-".join(re.sub(r"[^A-Za-z0-9_.]+", "-", word).strip("-") for word in words)[:80]
    try:
        if text.startswith(_PHASE):
            phases = tuple(_phase(model, word) for word in words)
            picture = Picture(f"phase-{slug}", phases=phases)
        else:
            picture = Picture(slug, panels=tuple(_panels(model, words)))
    except UsageError as error:
        raise UsageError(f"--plot {text}: {error}") from None
    units = {(x.unit, y.unit) for x, y in picture.phases}
    if len(units) > 1:
        both = " and ".join(sorted({x for x, _ in units}))
        raise UsageError(f"--plot {text}: quantities in {both} cannot share the axes of a phase plane")
    count = sum(len(panel.curves) for panel in picture.panels) + len(picture.phases)
    if count > MOST:
        raise UsageError(f"--plot {text}: {count} curves, and no more than {MOST} can be told apart in a picture")
    return picture


def _alternatives() -> str:
    calls = [f"{name}(…)" for name in FUNCTIONS if name]
    return ", ".join([*calls, *WORDS, *GROUPS, f"{_PHASE}…"])


def _phase(model: Model, word: str) -> tuple[Quantity, Quantity]:
    (rate,) = FUNCTIONS["rate"](model, word)  # of what has one
    return _quantities(model, word)[0], rate


def _panels(model: Model, words: Sequence[str]) -> Iterator[Panel]:
    """Yield panels in the order of the request; quantities with the same unit are together."""
    found: list[Quantity | Panel] = []
    for word in words:
        found += GROUPS[word] if word in GROUPS else _quantities(model, word)
    units = dict.fromkeys(x.unit for x in found if isinstance(x, Quantity))
    for x in found:
        if isinstance(x, Panel):
            yield x
        elif x.unit in units:
            del units[x.unit]
            same = (y for y in found if isinstance(y, Quantity) and y.unit == x.unit)
            yield Panel(tuple({y.name: y for y in same}.values()))


def _quantities(model: Model, word: str) -> list[Quantity]:
    if word in WORDS:
        return [WORDS[word]]
    call = _CALL.fullmatch(word)
    if call is None:
        if "." not in word and word not in model.states and word not in model.outputs:
            known = [*model.coordinates(), *model.outputs, *WORDS, *GROUPS]
            hint = suggestion(word, known)
            if not hint and word in model.bodies:
                hint = "coordinates: " + ", ".join(x for x in model.coordinates() if x.startswith(f"{word}."))
            raise UsageError(f"there is no {word!r} to plot\nhint: {hint or f'a coordinate, or {_alternatives()}'}")
        return FUNCTIONS[""](model, word)
    name, argument = call.groups()
    if name not in FUNCTIONS:
        hint = suggestion(name, FUNCTIONS) or f"a coordinate, or {_alternatives()}"
        raise UsageError(f"there is no function {name!r}\nhint: {hint}")
    return FUNCTIONS[name](model, argument)


# --- pictures -------------------------------------------------------------------------------------------------------


def draw(picture: Picture, sim: Simulation, title: str) -> Figure:
    """Return a picture of a simulation.

    Raises
    ------
    UsageError
        If a requested reaction is not transmitted.
    """
    with house_style():
        return _draw_phases(picture, sim, title) if picture.phases else _draw_panels(picture, sim, title)


def idle(picture: Picture, sim: Simulation, model: Model) -> list[str]:
    """Return a hint for each joint whose plotted reaction is zero because springs or drives act along it."""
    found = []
    largest = float(np.max(np.abs(sim.loads), initial=0.0))
    for quantity in dict.fromkeys(x for panel in picture.panels for x in panel.curves):
        call = _CALL.fullmatch(quantity.name)
        if call is None or call[1] not in ("force", "torque"):
            continue
        joint = call[2].partition(".")[0]
        acting = [entry.name for entry in _with_efforts(model) if str(entry.values.get("joint")) == joint]
        if acting and np.max(np.abs(quantity.values(sim)), initial=0.0) <= FLAT * largest:
            wanted = ", ".join(f"effort({name})" for name in acting)
            found.append(
                f"hint: {quantity.name} is 0: what acts along joint {joint!r} is not its reaction; plot {wanted}"
            )
    return found


def _draw_panels(picture: Picture, sim: Simulation, title: str) -> Figure:
    shown = [replace(panel, curves=_at_work(panel, sim)) for panel in picture.panels]
    heights = [3.6] if len(shown) == 1 else [2.4] * 2 if len(shown) == 2 else [1.75] * len(shown)
    figure, axes = titled_figure(title, heights)
    handles: list[Artist] = []
    number = 0
    for panel, here in zip(shown, axes, strict=True):
        values = [np.asarray(curve.values(sim), dtype=float) for curve in panel.curves]
        if panel.curves[0].unit == "J" and 0.0 < np.max(np.abs(values), initial=0.0) <= _least(panel, sim):
            values = [0.0 * y for y in values]
            here.text(0.5, 0.75, "zero but for rounding", transform=here.transAxes, ha="center")
        base = common_part(np.concatenate(values)) if not panel.logarithmic else 0.0
        for curve, y in zip(panel.curves, values, strict=True):
            below = curve.name == panel.beneath
            style = BROAD if below else _curve_style(number if len(values) > 1 else 0)
            if panel.logarithmic:
                # A gap where it is zero; markers show single values between gaps.
                points = decimated(sim.times, np.where(y > 0.0, np.maximum(y, EXACT), np.nan))
                here.plot(*points, **style | {"linewidth": 0.9}, marker=".", markersize=2.0, zorder=3)
            else:
                here.plot(*decimated(sim.times, y - base), **style, zorder=2.5 if below else 3)
            if len(values) > 1:
                number += not below
                if not panel.logarithmic or np.any(y > 0.0):
                    handles.append(Line2D([], [], **style, label=curve.label))
        text = panel.text
        if not panel.logarithmic:
            size = base if panel.beneath != "sum" or not np.any(values) else _energies(sim)
            text = panel.said(set_room(here, "y", np.concatenate(values) - base, size))
        else:
            set_decades(here, np.concatenate(values))
        text = text if not base else f"{text}, less {with_minus_sign(f'{base:.12g}')}"
        here.set_ylabel(text)
        here.set_xlim(float(sim.times[0]), max(float(sim.times[-1]), np.nextafter(float(sim.times[0]), np.inf)))
        here.tick_params(labelbottom=here is axes[-1])
        here.grid(color="0.88", linewidth=0.6)
        here.set_axisbelow(True)
        here.yaxis.set_label_coords(-0.57 / panel_width(), 0.5)
    axes[-1].set_xlabel("time (s)" + ("" if sim.complete else f", ended early at {sim.times[-1]:.6g} s"))
    draw_legend(figure, handles)
    return figure


def _energies(sim: Simulation) -> float:
    """Return the largest energy or work of a simulation (J)."""
    return float(max(np.max(np.abs(x), initial=0.0) for x in (sim.kinetic, sim.potential, sim.work)))


def _least(panel: Panel, sim: Simulation) -> float:
    """Return the size of energies in a panel that are more than rounding (J)."""
    if WORDS["drift"] in panel.curves:
        return ROUNDED * max(_energies(sim), sim.energy_scale)
    return FLAT * sim.energy_scale


def _at_work(panel: Panel, sim: Simulation) -> tuple[Quantity, ...]:
    """Return the curves of a panel, without work if there is none, and energies on a scale that shows their change.

    A change of the kinetic energy that is an error, as energies do not balance better, is not magnified.
    """
    idle = sim.conservative and len(panel.curves) > 1
    curves = (curve for curve in panel.curves if not (idle and curve is WORDS["work"]))
    noise = max(FLAT * float(np.max(sim.kinetic)), UNBALANCED * float(np.max(np.abs(sim.imbalance))))
    if panel.beneath != "sum" or not noise < np.ptp(sim.kinetic) < LITTLE * np.max(sim.kinetic):
        return tuple(curves)
    least = float(np.min(sim.kinetic))
    kinetic = Quantity("kinetic", "J", lambda sim: sim.kinetic - least, f"kinetic energy less {least:.6g} J")
    return tuple(
        kinetic
        if curve is WORDS["kinetic"]
        else replace(curve, values=lambda sim: sim.kinetic - least + _above(sim.potential))
        if curve.name == "sum"
        else curve
        for curve in curves
    )


def _draw_phases(picture: Picture, sim: Simulation, title: str) -> Figure:
    figure, (axes,) = titled_figure(title, heights=(4.6,))
    handles: list[Artist] = []
    alone = len(picture.phases) == 1
    pairs = [(x.values(sim), y.values(sim)) for x, y in picture.phases]
    for number, ((x, _), (across, up)) in enumerate(zip(picture.phases, pairs, strict=True)):
        style = _curve_style(number)
        axes.plot(*thinned(across, up), **style, zorder=3)
        axes.plot(across[:1], up[:1], "o", color=style["color"], markersize=7, markerfacecolor="w", zorder=4)
        axes.plot(across[-1:], up[-1:], "s", color=style["color"], markersize=5, zorder=4)
        if not alone:
            handles.append(Line2D([], [], **style, label=x.name))
    handles.append(legend_marker("o", 7.0, f"start, t = {with_minus_sign(f'{sim.times[0]:.6g}')} s"))
    end = f"end, t = {with_minus_sign(f'{sim.times[-1]:.6g}')} s" + ("" if sim.complete else " (early)")
    handles.append(Line2D([], [], color="k", linestyle="", marker="s", markersize=5, label=end))
    for which, column in (("x", 0), ("y", 1)):
        values = np.concatenate([pair[column] for pair in pairs])
        base = common_part(values)
        for line in axes.get_lines():
            shifted = np.asarray(line.get_xdata() if which == "x" else line.get_ydata()) - base
            (line.set_xdata if which == "x" else line.set_ydata)(shifted)
        text = Panel(tuple(pair[column] for pair in picture.phases)).said(set_room(axes, which, values - base, base))
        text = text if not base else f"{text}, less {with_minus_sign(f'{base:.12g}')}"
        (axes.set_xlabel if which == "x" else axes.set_ylabel)(text)
    axes.yaxis.set_label_coords(-0.57 / panel_width(), 0.5)
    axes.grid(color="0.88", linewidth=0.6)
    axes.set_axisbelow(True)
    draw_legend(figure, handles)
    return figure


def _curve_style(number: int) -> dict[str, Any]:
    return {"color": INK[number % len(INK)], "linestyle": DASHES[number % len(DASHES)], "linewidth": THIN}
