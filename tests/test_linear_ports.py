"""Responses, zeros, margins, derivatives, modes, designs of random systems in many guises, against exact numbers.

See `linear_ports`.
"""

import numpy as np
import pytest
from linear_ports import GUISES, Ports, ports, roots
from mpmath import mp, mpc
from sampling import sample
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.response import answer


def assert_same(found, errors, known, relative=1e-15):
    """Compare complex numbers in any order, each within its error."""
    assert len(found) == len(known)
    if len(found):
        known = np.array([complex(x) for x in known])
        distance = np.abs(np.asarray(found)[:, None] - known)
        rows, columns = linear_sum_assignment(np.log(distance + 1e-300))
        assert np.all(distance[rows, columns] <= np.asarray(errors)[rows] + relative * np.abs(known[columns]))


def assert_zeros(zeros, truth, more_hidden=0):
    """Whatever is decided is true; how many hidden eigenvalues at 0 the guise adds is given."""
    if zeros.doubt:
        return
    if zeros.vanishes or truth.vanishes:
        assert zeros.vanishes == truth.vanishes
        return
    known, hidden = list(truth.zeros), [*truth.hidden, *[0] * more_hidden]
    # A pole and a zero that no 13 digits tell apart are hidden as far as rounding errors tell.
    near = [(p, z) for p in truth.poles for z in truth.zeros if abs(p - z) < 1e-13 * abs(p)]
    for p, z in near:
        if len(hidden) < len(zeros.hidden) and min(abs(complex(p) - x) for x in zeros.hidden) < 1e-8 * abs(p):
            known.remove(z)
            hidden.append(p)
    assert_same(zeros.values, zeros.errors, known)
    assert_same(zeros.hidden, zeros.hidden_errors, hidden, 1e-8)
    assert zeros.minimum_phase in (None, all(z.real < 0 for z in truth.zeros))


@mp.workdps(60)
def assert_margins(margins, truth, hidden_unstable):
    stable = all(s.real < 0 for s in truth.closed()) and not hidden_unstable
    assert margins.closed in (None, stable)
    if margins.doubt or truth.vanishes:
        return
    crossings = truth.phase_crossings()
    assert margins.always_real == (crossings is None)
    if crossings is not None:
        # Where the gain is next to nothing, there is no margin.
        known = [(w, f) for w, f in crossings if f < 1e12 * abs(truth_size(truth))]
        gains = [x for x in margins.gain if x.frequency < np.inf]  # those at infinity: test_margins
        found = [(x.frequency, x.factor, x.error) for x in gains if x.factor < 1e12 * abs(truth_size(truth))]
        assert len(found) == len(known)
        for (frequency, factor, error), (w, f) in zip(found, known, strict=True):
            assert abs(frequency - w) <= 1e-7 * w
            assert abs(factor - f) <= error + 1e-13 * f
    passed = truth.gain_crossings()
    assert len(margins.phase) == len(passed)
    for x, w in zip(margins.phase, passed, strict=True):
        assert abs(x.frequency - w) <= 1e-7 * w
        angle = float(mp.degrees(mp.arg(-truth.at(mpc(0, w)))))
        assert abs((angle - x.phase + 180) % 360 - 180) <= x.error + 1e-10


@mp.workdps(60)
def truth_size(truth):
    """Return the largest factor, 1/|G|, of frequencies beside the zeros and poles."""
    sizes = [abs(x) for x in [*truth.zeros, *truth.poles] if x] or [mp.mpf(1)]
    return max(1 / abs(truth.at(mpc(0, 0.7 * x))) for x in sizes)


@mp.workdps(60)
def assert_true(system, guise="plain"):
    """Compare all that `response` says with what is true."""
    truth, model = system.truth(), mbstab.loads(system.text(guise)).state_space()
    more = len(model.A) - len(truth.poles) - len(truth.hidden)
    found = answer(model, points=5)
    exact = FrequencyResponse(model).of(found.channels[0])
    omega = np.concatenate([found.x, np.geomspace(1e-4, 1e4, 4)])
    for w, value, error in zip(omega, *exact(omega), strict=True):
        known = 0 if truth.vanishes else truth.at(mpc(0, w))
        assert abs(mpc(complex(value)) - known) <= error + 2e-16 * abs(known)
    zeros = found.zeros[0]
    assert_zeros(zeros, truth, more)
    assert_margins(found.margins[0], truth, any(s.real > 0 for s in truth.hidden))
    largest, known = found.largest[0], truth.largest()
    if not largest.reason.startswith("not decided") and not truth.vanishes:
        assert np.isfinite(largest.value) == (known is not None and known < mp.inf)
        if np.isfinite(largest.value):
            assert (
                largest.value * (1 - largest.tolerance - 1e-12)
                <= known
                <= largest.value * (1 + largest.tolerance + 1e-12)
            )
    return model, found, truth


@pytest.mark.parametrize("seed", sample(range(90), 6))
@pytest.mark.parametrize("span", [1, 3, 6])
def test_responses(seed, span):
    assert_true(ports(1000 * span + seed, span))


@pytest.mark.parametrize("seed", sample(range(20), 5))
@pytest.mark.parametrize("guise", GUISES[1:])
def test_guises_change_no_transfer_function(guise, seed):
    system = ports(seed, 1)
    model, found, truth = assert_true(system, guise)
    plain = answer(mbstab.loads(system.text()).state_space(), points=5)
    # Rounding of redundant rows may hide that a response vanishes; that is said.
    if not (truth.vanishes and found.zeros[0].doubt):
        assert found.zeros[0].doubt == plain.zeros[0].doubt
        assert len(found.margins[0].gain) == len(plain.margins[0].gain)
    # A, B, C, D have it too, at any s.
    for s in (0.3 + 1.1j, -0.2 + 4.0j):
        known = 0 if truth.vanishes else truth.at(mpc(s))
        states = np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B.astype(complex))
        orders = np.array([s**k for _, k in model.orders])
        assert abs(complex((model.C @ states + model.D)[0] @ orders) - known) <= 1e-9 * abs(known) + 1e-15


@pytest.mark.parametrize("seed", sample(range(40), 4))
@pytest.mark.parametrize("guise", GUISES)
def test_guises_change_no_mode_and_no_derivative(guise, seed):
    """Eigenvalues and derivatives by every number against exact polynomials; the energy balance of each mode closes."""
    system = ports(500 + seed, 1)
    model = mbstab.loads(system.text(guise))
    found, known = model.sensitivities(), roots(system.characteristic())
    for item in found.derivatives:
        e = found.eigenvalue(item)
        if abs(e.value) <= e.error_bound:
            continue  # the guise adds zeros, such as the heading of a knife edge
        nearest = min(known, key=lambda s: abs(complex(s) - e.value))
        assert abs(complex(nearest) - e.value) <= e.error_bound + 1e-15 * abs(e.value)
        if item.missing:
            continue
        with mp.workdps(60):
            exact = [system.slope(nearest, name) if name in system.numbers else 0 for name in found.parameters]
        for slope, error, truth in zip(item.slopes, item.errors, exact, strict=True):
            assert np.isnan(slope) or abs(slope - complex(truth)) <= 10 * error + 1e-14 * abs(complex(truth)) + 1e-25
    shown = [e for e in found.result.eigenvalues if e.kind != "neutral" and abs(e.value) > e.error_bound]
    assert len(shown) == sum(s != 0 for s in known)
    assert max((e.energy.defect for e in model.eig(energies=True).eigenvalues if e.energy), default=0.0) <= 1e-12


# With nonholonomic rows: the bicycle in test_design.
@pytest.mark.parametrize("guise", [x for x in GUISES if x != "nonholonomic"])
def test_a_design_reaches_the_same_optimum_in_every_guise(guise):
    """An oscillator at critical damping decays fastest: c = 2 sqrt(k m)."""
    system = Ports(1, 0, {"m0": "2", "k00": "18", "c00": "3"}, 0, ((0, 0, "1"),))
    found = mbstab.loads(system.text(guise)).design(vary={"c00": (1.0, 40.0)}, goal="decay")
    assert found.values["c00"] == pytest.approx(12.0, rel=1e-4)
