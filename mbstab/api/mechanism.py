"""A model file that can be asked questions, with a method for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mbstab.analysis.algebra.budget import Task
from mbstab.analysis.reference.requested import fits_sparse, reference_motion
from mbstab.analysis.spectrum.eigenvalues import answer, with_energies
from mbstab.analysis.spectrum.results import EigenResult
from mbstab.api.core import Setting, asked
from mbstab.api.ports import Ports
from mbstab.api.printing import printed
from mbstab.compiler.system import Array
from mbstab.model.arguments import Progress, parted, untold, whole
from mbstab.model.ranges import swept_values
from mbstab.records import dataclass

if TYPE_CHECKING:
    from mbstab.analysis.compare.check import CheckReport
    from mbstab.analysis.compare.expectations import Outcome
    from mbstab.analysis.compare.integrators import Integrations
    from mbstab.analysis.compare.methods import Comparison
    from mbstab.analysis.compare.verify import Verification
    from mbstab.analysis.design.design import Design
    from mbstab.analysis.linear.symbolic import SymbolicBlocks, Track
    from mbstab.analysis.proof.certify import Certificate
    from mbstab.analysis.reference.equilibrium import Equilibrium
    from mbstab.analysis.simulate.energy import Energies
    from mbstab.analysis.simulate.mode_shape import Swing
    from mbstab.analysis.simulate.result import Simulation
    from mbstab.analysis.spectrum.precise import PreciseResult
    from mbstab.analysis.spectrum.sensitivity import Sensitivities
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.sweep import Sweep
    from mbstab.analysis.verdict.many_digits import ManyDigits


@dataclass(frozen=True, repr=False)
class Mechanism(Ports):
    """A model file that can be asked questions.

    Every method takes parameter values as keywords: ``model.eig(omega=5.6)``. A number, also one
    of NumPy, `fractions` or `decimal`, counts in the declared unit of the parameter; a text is an
    expression in SI, or a number with or without a unit, such as ``"2 mm"``. `at` binds them for several questions.
    Where something takes long, `progress` is called with the part of the work that is done, from 0 to 1.

    Attributes
    ----------
    model : Model
        What the file says.
    force : bool
        Go on where a scene is so large that memory or time is more than what is reasonable
        (`mbstab.analysis.algebra.budget`).
    """

    @asked
    def energies(self, **parameters: Setting) -> Energies:
        """Return kinetic and potential energy (J) at the reference motion and the power (W) of forces, by entry."""
        from mbstab.analysis.simulate.energy import energies

        system = self._affordable("motion", parameters)
        return energies(reference_motion(system, massless=True), system)

    @asked
    def equilibria(
        self, starts: int = 1, seed: int = 1, track: Callable[[list[int]], Iterator[int]] = iter, **parameters: Setting
    ) -> list[Equilibrium]:
        """Return the distinct equilibria or steady motions found from the reference and from random starts.

        Parameters
        ----------
        starts : int
            Number of starts; the first is the reference of the file.
        seed : int
            Seed of the random starts.
        track : callable
            Takes the list of starts and returns them one by one, for a progress bar.

        Raises
        ------
        ModelFileError
            If the constraints cannot be satisfied.
        EquilibriumError
            If none is found.
        """
        from mbstab.analysis.reference.equilibrium import find_equilibria

        starts, seed = whole("starts", starts, 1), whole("seed", seed)
        return find_equilibria(self._affordable("motion", parameters), starts, seed, track)

    @asked
    def eig(
        self,
        method: str = "nullspace",
        frozen: bool = False,
        progress: Progress | None = None,
        energies: bool = False,
        **parameters: Setting,
    ) -> EigenResult:
        """Return eigenvalues (1/s) with error bounds, and the verdict.

        Parameters
        ----------
        method : str
            A name of `mbstab.analysis.linear.methods.METHODS`: ``nullspace`` deflates, the others are
            there for comparison.
        frozen : bool
            Take the equations as they are at the reference time: of a motion that does not stand
            still in its coordinates these eigenvalues say nothing about stability.
        progress : callable, optional
            Is called with the part of the work that is done, from 0 to 1, where that takes long.
        energies : bool
            Add to each mode its energies and powers, entry by entry (`Eigenvalue.energy`).

        Raises
        ------
        ModelFileError
            If the reference is not a motion of the system.
        ConstraintError
            If the rank of the constraints cannot be decided.
        MassError
            If a motion that nothing holds has no mass.
        NumericalError
            If the method needs independent constraint rows and they are not.
        """
        system = self.system(**parameters)
        task: Task = "spectrum" if method == "nullspace" and not frozen and fits_sparse(system) else "modes"
        result = answer(self._within(task, system), method, frozen, progress, self._digits(parameters))
        return self._described(result, frozen, energies, parameters)

    @asked
    def modes(
        self, count: int, near: complex = 0.0, rightmost: bool = False, energies: bool = False, **parameters: Setting
    ) -> EigenResult:
        """Return a few eigenvalues (1/s) of a scene of any size with error bounds, and the verdict.

        How many eigenvalues lie right of the imaginary axis is counted without finding them
        (`counts.unstable_proven`); where that is not possible, the verdict is that of a part and says so.

        Parameters
        ----------
        count : int
            How many; a conjugate pair is one.
        near : complex
            Those nearest to it are looked for (1/s).
        rightmost : bool
            Look for those with the largest real parts instead.
        energies : bool
            As in `eig`.

        Raises
        ------
        UsageError
            If there are fewer eigenvalues, or the motion is periodic.
        NumericalError
            If the iteration does not converge.
        MbstabError
            As `eig`.
        """
        count = whole("count", count, 1)
        from mbstab.analysis.spectrum.modes import modes

        result = modes(self.system(**parameters), count, near, rightmost, self.force)
        return self._described(result, False, energies, parameters)

    def _described(
        self, result: EigenResult, frozen: bool, energies: bool, parameters: Mapping[str, Setting]
    ) -> EigenResult:
        """Return eigenvalues with the names of their modes, and their energies if they are asked for."""
        if self.model.modes:
            from mbstab.analysis.sweep.named_branches import Lines, with_names

            result = with_names(self.at(**parameters).model, result, self._followed.of({}, Lines))
        told = energies and result.period is None
        return with_energies(result, self.linearize(frozen, **parameters)) if told else result

    def _digits(self, parameters: Mapping[str, Setting]) -> ManyDigits:
        """Return the motion with many digits, for verdicts that rest on exact zeros."""
        from mbstab.analysis.spectrum.exactly import Exactly

        return Exactly(lambda: self.closed(**parameters))

    @asked
    def eig_precise(
        self, digits: int = 50, frozen: bool = False, progress: Progress = untold, **parameters: Setting
    ) -> PreciseResult:
        """Return eigenvalues (1/s) of which so many decimal digits are right, and the verdict.

        Parameters
        ----------
        digits : int
            From 16 to 1000.
        frozen, progress
            As in `eig`.
        parameters
            All digits of a text count; a float stands for the decimals it is printed with.

        Raises
        ------
        UsageError
            If the number of digits is out of range, or the motion is periodic.
        ConstraintError
            If the decimals of the file satisfy the constraints in double precision only.
        NumericalError
            If the digits cannot be reached.
        """
        digits = whole("digits", digits)
        model = self._afforded("digits", parameters)
        from mbstab.analysis.spectrum.precise import precise_eigenvalues

        return precise_eigenvalues(model, digits, frozen, progress, self._digits(parameters))

    @asked
    def sensitivities(self, frozen: bool = False, **parameters: Setting) -> Sensitivities:
        """Return the derivatives of all eigenvalues by all parameters, with the motion of the reference included.

        Raises
        ------
        UsageError
            If the file has no parameters, or the motion is periodic.
        MbstabError
            As `eig`; also where the reference has no derivative.
        """
        from mbstab.analysis.spectrum.sensitivity import sensitivities

        found = sensitivities(self._afforded("modes", parameters), frozen, self._digits(parameters))
        return replace(found, result=self._described(found.result, frozen, False, parameters))

    @asked
    def certify(self, digits: int = 50, progress: Progress = untold, **parameters: Setting) -> Certificate:
        """Return enclosures of all eigenvalues with proven radii, and a proven verdict or why there is none.

        Parameters
        ----------
        digits : int
            Decimal digits; twice and four times as many where a verdict is open.
        progress : callable
            Is called with the part of an interval that is decided, from 0 to 1.
        **parameters
            Texts are exact decimals; one of them may be an interval: ``omega="[5.6, 10]"``.

        Raises
        ------
        UsageError
            If a parameter is unknown.
        """
        digits = whole("digits", digits)
        model = self._afforded("proof", parameters)
        from mbstab.analysis.proof.certify import certify

        return certify(model, digits, progress)

    @asked
    def verify(self, frozen: bool = False, progress: Progress = untold, **parameters: Setting) -> Verification:
        """Return what the nonlinear motion says about the eigenvalues: each mode, each neutral direction excited.

        Parameters
        ----------
        frozen : bool
            Judge the eigenvalues of the equations frozen at the reference time.

        Raises
        ------
        MbstabError
            As `eig`.
        """
        from mbstab.analysis.compare.verify import verify

        return verify(self._affordable("modes", parameters), frozen, progress, self._digits(parameters))

    @asked
    def sweep(
        self,
        parameter: str,
        values: Array | Sequence[float | str] | None = None,
        progress: Progress = untold,
        certify: bool = False,
        sensitivity: bool = False,
        orders: Sequence[float] = (),
        meetings: bool = False,
        detail: bool = False,
        si: bool = False,
        **keywords: Any,
    ) -> Sweep:
        """Return eigenvalue branches over a parameter, and where stability changes.

        Parameters
        ----------
        parameter : str
        values : array or sequence of float or str, shape (points,), optional
            Of the parameter, ascending or descending, as keywords take them: numbers in its declared unit, or texts.
            Those of the file's ``sweep:`` block if not given.
        certify : bool
            Enclose each critical value in a ball, or say why that is not proven (`Critical.enclosed`).
        sensitivity : bool
            Differentiate each by the other parameters, or say why that is not possible (`Critical.slopes`).
        orders : sequence of float
            Multiples of the parameter, an angular velocity, whose crossings with frequencies are looked for.
        meetings : bool
            Locate where branches cross or collide.
        detail : bool
            Compute points between, for pictures.
        si : bool
            Whether the values are in SI, whatever the declared unit: 0.001 for 1 ms.
        **keywords
            Other parameters, and fields of `mbstab.analysis.sweep.settings.SweepSettings`.

        Raises
        ------
        UsageError
            If names, values or orders are wrong.
        """
        x = swept_values(self.model, parameter, values, si)
        from mbstab.analysis.proof.swept import swept
        from mbstab.analysis.sweep.settings import SweepSettings

        settings, parameters = parted(SweepSettings, keywords, self.model.parameters)
        model = self._afforded("modes", parameters)
        return swept(model, parameter, x, settings, progress, certify, sensitivity, orders, (meetings, detail))

    @asked
    def design(
        self, vary: Mapping[str, str | Sequence[float]], goal: str, progress: Progress = untold, **keywords: Any
    ) -> Design:
        """Return the best values of parameters that are found: ``model.design({"k": (1, 9)}, "decay", least=0.5)``.

        `vary`, `goal` and the keywords ``over``, ``least`` and ``steps`` are as in
        `mbstab.analysis.design.task.read_task`; other keywords are parameters.

        Raises
        ------
        UsageError
            If what is asked is wrong, the motion is periodic, or the reference cannot follow a parameter.
        MbstabError
            As `sensitivities`.
        """
        from mbstab.analysis.design.design import design
        from mbstab.analysis.design.task import Limits, read_task

        limits, parameters = parted(Limits, keywords, self.model.parameters)
        model = self._afforded("modes", parameters)
        return printed(design(model, read_task(model, vary, goal, limits), progress), model)

    @asked
    def simulate(
        self,
        to: float | None = None,
        *,
        progress: Progress = untold,
        tell: Callable[[str], object] = lambda text: None,
        **keywords: Any,
    ) -> Simulation:
        """Return the nonlinear motion: ``model.simulate(10.0, perturb={"rod.theta": 0.1})``.

        Parameters
        ----------
        to : float, optional
            Last time (s).
        tell : callable
            Is called with what should be known before the end: warnings, and how long it takes and why, where that
            is long.
        **keywords
            Parameters, and fields of `mbstab.analysis.simulate.settings.SimulationSettings`.

        Raises
        ------
        UsageError
            If an argument is out of range or a name is unknown.
        SimulationError
            If the motion cannot be followed to the end; its `partial` holds the finished part.
        """
        from mbstab.analysis.simulate.settings import SimulationSettings
        from mbstab.analysis.simulate.simulate import simulate

        settings, parameters = parted(SimulationSettings, {"to": to, **keywords}, self.model.parameters)
        return simulate(self._affordable("run", parameters), settings, progress, tell, self.force)

    @asked
    def swing(self, number: int = 1, points: int = 50, **parameters: Setting) -> Swing:
        """Return a mode, as `eig` lists them from 1, at evenly spaced instants of a period, exaggerated.

        Raises
        ------
        UsageError
            If there is no such mode, or it has no shape that swings.
        """
        from mbstab.analysis.simulate.mode_shape import swing

        number, points = whole("number", number), whole("points", points, 1)
        return swing(self._affordable("modes", parameters), number, points)

    @asked
    def chart(
        self,
        values: Mapping[str, Array | Sequence[float | str] | None],
        progress: Progress = untold,
        si: bool = False,
        **keywords: Any,
    ) -> Chart:
        """Return the number of unstable eigenvalues over two parameters, and the curves where it changes.

        Parameters
        ----------
        values : mapping
            Two parameters and their values, ascending, as in `sweep`.
        progress, si, **keywords
            As in `sweep`.
        """
        grids = {name: swept_values(self.model, name, x, si) for name, x in values.items()}
        from mbstab.analysis.sweep.chart import chart
        from mbstab.analysis.sweep.settings import SweepSettings

        settings, parameters = parted(SweepSettings, keywords, self.model.parameters)
        return chart(self._afforded("modes", parameters), grids, progress, settings)

    @asked
    def compare(
        self, digits: int = 50, tolerance: float | None = None, progress: Progress = untold, **parameters: Setting
    ) -> Comparison:
        """Return what each method keeps of the eigenvalues to many digits, and what it costs.

        Parameters
        ----------
        digits : int
            Of the truth.
        tolerance : float, optional
            Largest relative error, for the choice of a method.

        Raises
        ------
        UsageError
            If the tolerance cannot be judged, or the motion is periodic.
        """
        digits = whole("digits", digits)
        model = self._afforded("modes", parameters)
        from mbstab.analysis.compare.methods import compare

        return compare(model, digits, tolerance, progress)

    @asked
    def compare_integrators(
        self,
        to: float | None = None,
        perturb: Mapping[str, float | str] | None = None,
        tolerance: float | None = None,
        progress: Progress = untold,
        **parameters: Setting,
    ) -> Integrations:
        """Return error, cost and drift of every integrator on the nonlinear motion, with several tolerances.

        Parameters
        ----------
        to : float, optional
            Last time (s); 1 s after the start if not given.
        perturb : mapping, optional
            As in `simulate`; a tenth of the first mode if neither this nor the file disturbs the reference.
        tolerance : float, optional
            Largest global error, for the choice of an integrator.

        Raises
        ------
        UsageError
            If an argument is out of range or a name is unknown.
        SimulationError
            If the motion cannot be followed to the end.
        NumericalError
            If no integrator keeps the tolerance.
        """
        from mbstab.analysis.compare.integrators import compare_integrators

        system = self._affordable("run", parameters)
        return compare_integrators(system, to, perturb, tolerance, progress, self.force)

    @asked
    def check(self, **parameters: Setting) -> CheckReport:
        """Return what the scene consists of, what it does not need, and how well the reference fits."""
        from mbstab.analysis.compare.check import check_scene

        return check_scene(self._affordable("motion", parameters))

    @asked
    def symbolic(self, track: Track = list) -> SymbolicBlocks:
        """Return the blocks of the composite matrices with symbols (Pappalardo et al. 2020, Eqs. (62)-(67)).

        `track` takes the list of entries to be simplified and returns them one by one, for a progress bar.
        """
        from mbstab.analysis.linear.symbolic import symbolic_blocks

        return symbolic_blocks(self._afforded("motion", {}), track, self.force)

    def test(self) -> list[Outcome]:
        """Return for each entry of ``expect:`` whether it holds."""
        from mbstab.analysis.compare.expectations import check_expectations

        return check_expectations(self.model)
