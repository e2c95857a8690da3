"""Questions about inputs and outputs of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mbstab.api.core import Core, Setting, asked
from mbstab.compiler.system import Array
from mbstab.model.arguments import Progress, several, untold, whole
from mbstab.model.ranges import swept_values
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.response.response import Response
    from mbstab.analysis.response.state_space import ControlModel
    from mbstab.analysis.sweep.unbalance import UnbalanceResponse


@dataclass(frozen=True, repr=False)
class Ports(Core):
    """A model file that can be asked about its inputs and outputs."""

    @asked
    def state_space(
        self, states: str | Sequence[str] = (), frozen: bool = False, **parameters: Setting
    ) -> ControlModel:
        """Return A, B, C, D for the inputs and outputs of the file; `states` as in `control_model`."""
        from mbstab.analysis.response.state_space import control_model

        return control_model(self.linearize(frozen, **parameters), several(states))

    @asked
    def response(
        self,
        inputs: str | Sequence[str] = (),
        outputs: str | Sequence[str] = (),
        ends: tuple[float | None, float | None] = (None, None),
        points: int = 201,
        step: float | None = None,
        impulse: float | None = None,
        frozen: bool = False,
        **parameters: Setting,
    ) -> Response:
        """Return frequency responses with zeros, margins and largest gains, or responses over time.

        Parameters
        ----------
        inputs, outputs : str or sequence of str
            One name in the file, or several; all if none.
        ends : pair of float or None
            First and last frequency (rad/s); None: a decade beyond the eigenvalues.
        points : int
            How many frequencies or times.
        step, impulse : float, optional
            Duration (s) of the response to a unit step or impulse.
        frozen : bool
            As in `eig`.

        Raises
        ------
        UsageError
            If names are unknown, or arguments contradict each other.
        MbstabError
            As `linearize`.
        """
        from mbstab.analysis.response.response import answer, duration_of

        inputs, outputs = several(inputs), several(outputs)
        duration, points = duration_of(step, impulse, ends), whole("points", points, 2)
        given = self.model
        if inputs and set(inputs) <= set(given.inputs):  # others need no answer
            given = replace(given, inputs={name: x for name, x in given.inputs.items() if name in inputs})
        if outputs and set(outputs) <= set(given.outputs):
            given = replace(given, outputs={name: x for name, x in given.outputs.items() if name in outputs})
        found = replace(self, model=given).state_space((), frozen, **parameters)
        return answer(found, inputs, outputs, ends, points, duration, step is None)

    @asked
    def unbalance(
        self,
        at: str | Mapping[str, complex],
        parameter: str,
        values: Array | Sequence[float | str] | None = None,
        outputs: str | Sequence[str] = (),
        progress: Progress = untold,
        si: bool = False,
        **parameters: Setting,
    ) -> UnbalanceResponse:
        """Return the outputs that unbalances cause over the spin of their bodies.

        Parameters
        ----------
        at : str or dict
            A body or a point of a body, with an unbalance of 1 kg m; or complex unbalances (kg m) by such places, whose
            angle is that by which they lead.
        parameter : str
            The spin of the body.
        values, si
            Its values, positive, as in `mbstab.api.mechanism.Mechanism.sweep`.
        outputs : str or sequence of str
            One name in the file, or several; all if none.

        Raises
        ------
        UsageError
            If there is no such point, parameter or output.
        """
        from mbstab.analysis.sweep.unbalance import unbalance

        speeds = swept_values(self.model, parameter, values, si)
        return unbalance(self._afforded("modes", parameters), at, parameter, speeds, several(outputs), progress)
