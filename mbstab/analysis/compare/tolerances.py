"""What confirms a result, and how long comparisons may take."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of comparisons."""

    __slots__ = ()

    # Integrators
    step_tolerances: Final = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
    """Tolerances of a step with which each integrator runs."""
    reference_error: Final = 1e-11
    """Global error asked of the reference of integrators; it may turn out larger."""
    integration_time: Final = 4.0
    """Seconds of work after which a run is given up; the runs of a reference may take ten times as long together."""
    comparison_time: Final = 15.0
    """Seconds of work of the whole comparison, unless it is forced: two thirds of it may go to the reference."""
    pace_known: Final = 0.25
    """After this part of the limit a run is given up as well whose pace …"""
    pace_slow: Final = 1.5
    """… makes it longer than so many times the limit."""
    default_duration: Final = 1.0
    """Of the motion, if its end is not given (s)."""
    output_times: Final = 21
    """Times of the motion at which errors are taken."""

    # Methods for eigenvalues
    method_timings: Final = 15
    """A method is timed so many times …"""
    method_time: Final = 0.3
    """… or until so many seconds have passed; the median counts."""
    further_digits: Final = (20, 30)
    """Numbers of digits besides those of double precision that are measured as well."""
    equal_times: Final = 1.1
    """Times that differ by less than this factor are equal: the method that comes first is taken."""
    eigenvalue_lost: Final = 0.5
    """An eigenvalue with a larger relative error than this is none: not one binary digit of it is right."""

    # Eigenvalues that are seen in simulations
    mode_amplitude: Final = 2e-5
    """Largest part of a mode in the motion: of the sizes in the scene, or of its speeds."""
    eigenvalue_error: Final = 1e-4
    """Relative error of an eigenvalue that is confirmed."""
    uncertainties_of_observation: Final = 3.0
    """A part of an eigenvalue is confirmed, or not seen to differ from 0, within this many uncertainties of the
    observation; contradicted is what is off by more than these and more than `eigenvalue_error`."""
    amplitude_reduction: Final = 0.1
    """Amplitude of a repeated observation, relative to the one before …"""
    amplitude_repeats: Final = 6
    """… and how often it is repeated at most."""
    step_tolerance: Final = 1e-13
    """Tolerance of a step with the amplitude `mode_amplitude`; with smaller ones it is smaller in proportion …"""
    step_tolerance_least: Final = 1e-15
    """… but not smaller than this."""
    run_periods: Final = 3.0
    """Length of a run in periods …"""
    run_growths: Final = 3.0
    """… in e-foldings of growth …"""
    run_decays: Final = 6.0
    """… and of decay, whichever is shortest …"""
    run_fastest_times: Final = 300.0
    """… and in times 1/(fastest rate) …"""
    run_fastest_growths: Final = 12.0
    """… and in e-foldings of the fastest growing mode."""
    run_samples: Final = 161
    """Times of a run at which the motion is observed …"""
    neutral_samples: Final = 33
    """… and where it is neutral …"""
    periodic_rounds: Final = 4
    """… which are so many periods of a periodic motion."""
    stiff_decay: Final = 3000.0
    """Decay of other modes within a run, in e-foldings, from which the integrator is an implicit one."""
    equal_eigenvalues: Final = 1e-6
    """Eigenvalues are multiple if they differ by less than this part of their modulus."""
    defective_overlap: Final = 1e9
    """A mode whose left and right vectors are orthogonal but for the inverse of this has no amplitude of its own."""

    # Neutral motions that are seen in simulations
    drift_error: Final = 1e-4
    """Part of the largest displacement by which a motion may differ from the prediction, and is confirmed."""
    drift_amplitude_reduction: Final = 0.1
    """Amplitude of a repeated motion, relative to the first, and the part by which their differences may differ."""
    neutral_distance: Final = 0.05
    """Distance of the neutral eigenvalues from their exact values, relative to that of the next one, at most."""
    drift_none: Final = 1e-6
    """What moves by less than this part of its displacement stays."""


TOLERANCES = Tolerances()
