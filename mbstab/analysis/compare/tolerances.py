"""When a result is confirmed, and how long comparisons may take."""

from typing import Final


class Tolerances:
    """Tolerances, thresholds and limits of comparisons."""

    __slots__ = ()

    # Integrators
    step_tolerances: Final = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
    """Tolerances per step with which each integrator runs."""
    reference_error: Final = 1e-11
    """Requested global error of the reference of integrators; it may turn out larger."""
    integration_time: Final = 4.0
    """CPU seconds after which a run is given up; the runs of a reference may take ten times as long in total."""
    comparison_time: Final = 15.0
    """CPU seconds of the whole comparison, unless it is forced; two thirds of it may be spent on the reference."""
    pace_known: Final = 0.25
    """After this fraction of the limit a run is also given up if its pace …"""
    pace_slow: Final = 1.5
    """… predicts more than this many times the limit."""
    default_duration: Final = 1.0
    """Duration of the motion, if its end is not given (s)."""
    output_times: Final = 21
    """Times of the motion at which errors are taken."""

    # Methods for eigenvalues
    method_timings: Final = 15
    """A method is timed this many times …"""
    method_time: Final = 0.3
    """… or until this many seconds have passed; the median counts."""
    further_digits: Final = (20, 30)
    """Numbers of digits, besides double precision, that are measured too."""
    equal_times: Final = 1.1
    """Times that differ by less than this factor count as equal: the first method is chosen."""
    eigenvalue_lost: Final = 0.5
    """An eigenvalue with a larger relative error than this is lost: not one binary digit of it is right."""

    # Eigenvalues that are seen in simulations
    mode_amplitude: Final = 2e-5
    """Largest amplitude of a mode in the motion, relative to the sizes in the scene or to its speeds."""
    eigenvalue_error: Final = 1e-4
    """Largest relative error of an eigenvalue that is confirmed."""
    uncertainties_of_observation: Final = 3.0
    """A part of an eigenvalue is confirmed, or not seen to differ from 0, within this many uncertainties of the
    observation; it is contradicted if it is off by more than these and more than `eigenvalue_error`."""
    amplitude_reduction: Final = 0.1
    """Amplitude of a repeated observation, relative to the one before …"""
    amplitude_repeats: Final = 6
    """… and the maximum number of repetitions."""
    step_tolerance: Final = 1e-13
    """Tolerance per step with the amplitude `mode_amplitude`; with smaller amplitudes it is proportionally smaller …"""
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
    """Number of times at which the motion of a run is observed …"""
    neutral_samples: Final = 33
    """… and where it is neutral …"""
    periodic_rounds: Final = 4
    """… which are this many periods of a periodic motion."""
    stiff_decay: Final = 3000.0
    """Decay of other modes within a run, in e-foldings, from which on an implicit integrator is used."""
    equal_eigenvalues: Final = 1e-6
    """Eigenvalues are multiple if they differ by less than this part of their modulus."""
    defective_overlap: Final = 1e9
    """A mode has no amplitude of its own if the product of its left and right unit vectors is below 1/this."""

    # Neutral motions that are seen in simulations
    drift_error: Final = 1e-4
    """A motion is confirmed if it differs from the prediction by less than this fraction of the displacement."""
    drift_amplitude_reduction: Final = 0.1
    """Amplitude of a repeated motion, relative to the first, and the relative difference allowed between both."""
    neutral_distance: Final = 0.05
    """Largest distance of the neutral eigenvalues from their exact values, relative to that of the next one."""
    drift_none: Final = 1e-6
    """A motion stays if it moves by less than this fraction of its displacement."""


TOLERANCES = Tolerances()
