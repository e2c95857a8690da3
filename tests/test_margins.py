"""Margins, largest gains and rank decisions of transfer functions, against closed forms and fine grids."""

import json
import math

import numpy as np
import pytest
from sampling import sample
from scipy.optimize import linear_sum_assignment
from test_cli import run

from mbstab.analysis.response.margins import closed_loop, largest_gain, margins
from mbstab.analysis.response.transfer import Channel
from mbstab.analysis.response.zeros import find


def channel(A, B, C, *D):
    D = np.array([*D, 0.0, 0.0, 0.0][:3])
    return Channel("w", "z", "", "", np.array(A, dtype=float), np.array(B, dtype=float), np.array(C, dtype=float), D)


def resonance(zeta, omega=3.0, *D):
    return channel([[0, 1], [-(omega**2), -2 * zeta * omega]], [0, 1], [omega**2, 0], *D)


def exact(loop):
    """Return the function that returns G(iω) of a channel, with errors of rounding."""

    def values(omega):
        found = [at(loop, 1j * x) for x in omega]
        return np.array([x[0] for x in found], dtype=complex), np.array([x[1] for x in found])

    return values


def margins_of(loop):
    """Return the margins of a channel whose values are known to rounding."""
    zeros = zeros_of(loop)
    return margins(zeros, exact(loop), closed_loop(zeros, zeros_of(loop, 1.0)))


def largest_of(loop):
    """Return the largest gain of a channel whose values are known to rounding."""
    return largest_gain(zeros_of(loop), exact(loop))


def at(loop, s, shift=0.0):
    """Return G(s) + shift, its error and slope."""
    whole = s * np.eye(len(loop.A)) - loop.A
    try:
        x = np.linalg.solve(whole, loop.B.astype(complex))
        y = np.linalg.solve(whole.T, loop.C.astype(complex))
    except np.linalg.LinAlgError:
        return complex(np.inf, np.nan), np.inf, complex(np.inf, np.nan)
    value = loop.C @ x + loop.D @ s ** np.arange(3) + shift
    error = 1e-15 * (np.abs(y) @ (np.abs(whole) @ np.abs(x)) + np.abs(loop.C) @ np.abs(x) + shift)
    return complex(value), float(error), complex(-y @ x + loop.D[1] + 2 * s * loop.D[2])


def zeros_of(loop, shift=0.0):
    """Return the zeros of G + shift of a channel whose values are known to rounding."""
    poles = np.linalg.eigvals(loop.A).astype(complex)
    return find(lambda s: at(loop, s, shift), poles, 1e-13 * np.abs(poles), poles[poles.real == 0.0])


def test_three_equal_lags():
    """4/(s + 1)³: phase -180° at √3, where the gain is 1/2; gain 1 where (1 + ω²)³ = 16."""
    loop = channel(np.diag([-1.0] * 3) + np.diag([1.0, 1.0], 1), [0, 0, 4], [1, 0, 0])
    found = margins_of(loop)
    assert found.closed is True
    (gain,), (phase,) = found.gain, found.phase
    np.testing.assert_allclose([gain.frequency, gain.factor], [3**0.5, 2.0], rtol=1e-13)
    omega = (16 ** (1 / 3) - 1) ** 0.5
    margin = np.pi - 3 * np.arctan(omega)
    np.testing.assert_allclose(
        [phase.frequency, phase.phase, phase.delay], [omega, np.degrees(margin), margin / omega], rtol=1e-12
    )
    largest = largest_of(loop)
    assert (largest.value, largest.frequency) == (pytest.approx(4.0, rel=1e-14), 0.0)


@pytest.mark.parametrize("zeta", [0.5, 0.05, 1e-4])
def test_the_peak_of_a_resonance(zeta):
    found = largest_of(resonance(zeta))
    np.testing.assert_allclose(found.value, 1 / (2 * zeta * (1 - zeta**2) ** 0.5), rtol=1e-12)
    np.testing.assert_allclose(found.frequency, 3 * (1 - 2 * zeta**2) ** 0.5, rtol=1e-7)
    assert found.tolerance <= 1e-7


def test_a_norm_that_is_infinite_or_does_not_exist():
    for zeta, value, word in ((0.0, np.inf, "no damping"), (-0.1, np.nan, "unstable")):
        found = largest_of(resonance(zeta))
        np.testing.assert_equal(found.value, value)
        assert word in found.reason
    following = largest_of(resonance(0.1, 3.0, 0.0, 1.0))
    assert following.value == np.inf
    assert "rate of the input" in following.reason
    through = largest_of(channel([[-1.0]], [1.0], [-1.0], 2.0))
    assert (through.value, through.frequency) == (2.0, np.inf)


def test_an_output_that_follows_the_rate_of_its_input_has_margins_too():
    """G = s/(s + 2): never 1 before infinity; 3 s: 1 at 1/3 with the phase 90°."""
    assert margins_of(channel([[-2.0]], [1.0], [-2.0], 1.0)).phase == ()
    (phase,) = margins_of(channel(np.zeros((0, 0)), [], [], 0.0, 3.0)).phase
    np.testing.assert_allclose([phase.frequency, phase.phase], [1 / 3, -90.0], rtol=1e-13)


def test_a_response_without_damping_is_real_everywhere():
    found = margins_of(resonance(0.0))
    assert found.always_real
    assert found.gain == ()
    (phase,) = found.phase
    # |9/(9 - ω²)| = 1 at √18.
    np.testing.assert_allclose([phase.frequency, abs(phase.phase)], [18**0.5, 0.0], atol=1e-12)
    assert found.closed is not True


def integrators(n, seed):
    """Return n eigenvalues at or near zero in a row, with a direct part, beside an oscillator that no input reaches."""
    rng = np.random.default_rng(seed)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n] = np.diag(np.ones(n - 1), -1) + np.diag(rng.choice([0.0, -0.01, -0.02], n) * rng.integers(0, 2))
    omega, zeta = rng.uniform(0.5, 2.0), rng.uniform(0.05, 0.5)
    A[n:, n:] = [[0, 1], [-(omega**2), -2 * zeta * omega]]
    return channel(A, [1.0] + [0.0] * (n + 1), [0.0] * (n - 1) + [10.0, 0.0, 0.0], -0.5)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_many_eigenvalues_at_one_place_leave_no_trace_of_others_that_are_hidden(n):
    for seed in range(4):
        loop = integrators(n, seed)
        found = zeros_of(loop)
        assert not found.doubt
        assert len(found.values) == n
        np.testing.assert_allclose(sorted(found.hidden, key=np.imag), np.linalg.eigvals(loop.A[n:, n:])[[1, 0]])


@pytest.mark.parametrize("systems", sample([8, 25], 2))
def test_random_systems_against_a_fine_grid(systems):
    rng = np.random.default_rng(3)
    omega = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 4001)])
    seen = 0
    for _ in range(systems):
        n = int(rng.integers(2, 10))
        A = rng.normal(size=(n, n))
        A -= np.eye(n) * (np.linalg.eigvals(A).real.max() + rng.choice([0.03, 0.3]))
        direct = rng.choice([0.0, 0.7, -0.6, -1.4])
        loop = channel(A, rng.choice([1.0, 10.0]) * rng.normal(size=n), rng.normal(size=n), direct)
        G, found = exact(loop)(omega)[0], margins_of(loop)
        largest, peak = largest_of(loop), np.abs(G).max()
        assert peak <= (1 + largest.tolerance) * largest.value
        assert largest.value < 1.01 * peak
        assert largest.tolerance <= 1e-7
        up = np.flatnonzero(np.diff(np.sign(np.abs(G[1:]) - 1)))
        assert len(found.phase) == len(up)
        for k, crossing in zip(up, found.phase, strict=True):
            assert omega[k + 1] <= crossing.frequency <= omega[k + 2]
            assert abs(abs(at(loop, 1j * crossing.frequency)[0]) - 1) < 1e-11
        across = np.flatnonzero(np.diff(np.sign(G[1:].imag)) * (G[2:].real < 0))
        moving = [x for x in found.gain if 0.0 < x.frequency < np.inf]
        assert len(moving) == len(across)
        for crossing in moving:
            np.testing.assert_allclose(at(loop, 1j * crossing.frequency)[0], -1 / crossing.factor, rtol=1e-9)
        closed = np.linalg.eigvals(A - np.outer(loop.B, loop.C) / (1 + loop.D[0]))
        assert found.closed is bool(closed.real.max() < 0)
        at_infinity = [x.factor for x in found.gain if x.frequency == np.inf]
        np.testing.assert_allclose(at_infinity, [-1 / loop.D[0]] if loop.D[0] < 0.0 else [], rtol=1e-9)
        assert found.no_delay is bool(abs(loop.D[0]) > 1.0)
        seen += len(up) + len(across) + len(at_infinity)
    assert seen > 1.2 * systems


@pytest.mark.parametrize("direct", [-0.5, -0.999999, -1.0, -1.000001, -3.0])
def test_a_loop_is_lost_through_infinity(direct):
    """G = D + 1/(s + 1): the loop has the eigenvalue -(2 + D)/(1 + D), the gain k one at -(1 + k + k D)/(1 + k D)."""
    found = margins_of(channel([[-1.0]], [1.0], [1.0], direct))
    at_infinity = [x for x in found.gain if x.frequency == np.inf]
    assert [x.factor for x in at_infinity] == [pytest.approx(-1.0 / direct, rel=1e-12)]
    assert found.ill_posed is (direct == -1.0)
    assert found.closed is (None if direct == -1.0 else (2.0 + direct) / (1.0 + direct) > 0.0)
    assert found.no_delay is (direct < -1.0)


def test_a_motion_that_drives_prescribe_has_responses_without_eigenvalues(tmp_path):
    path = tmp_path / "driven.yaml"
    path.write_text(
        """
mbstab: 1
bodies: {slider: {type: planar_point, mass: 2}}
constraints: {rail: {holonomic: slider.y}}
drives: {motor: {type: coordinate, coordinate: slider.x, position: 0}}
inputs: {place: {type: drive, drive: motor}}
outputs: {there: slider.x, load: 0.2*effort(motor)}
reference: {coordinates: {slider: {x: 0, y: 0}}}
""",
        encoding="utf-8",
    )
    result = run("response", str(path), "--from", "1", "--to", "3", "--points", "2", "--format", "json")
    assert not result.exit_code, result.stderr
    there, load = json.loads(result.stdout)["channels"]
    assert there["real"] == pytest.approx([1.0, 1.0])
    assert np.abs(load["real"]) == pytest.approx([0.4, 3.6])
    assert len(load["zeros"]) == 2
    steps = run("response", str(path), "--measured", "there", "--step", "1", "--format", "json")
    assert json.loads(steps.stdout)["channels"][0]["values"][-1] == pytest.approx(1.0)


def chain(n, seen):
    """Return a chain of masses with springs and dampers that is pushed at its first one."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-9.0 * K, -0.05 * K]])
    return channel(A, np.eye(2 * n)[n], np.eye(2 * n)[seen])


def test_zeros_are_told_only_where_ranks_are_decided():
    for part, many in ((1e-3, 1), (1e-9, 1), (3e-15, 1), (5e-25, None), (1e-30, 0)):
        found = zeros_of(channel(np.diag([-1.0, -2.0]), [1.0, part], [1.0, 1.0]))
        if many is None:
            assert "is reached and seen" in found.doubt
            assert found.minimum_phase is None
            assert len(found.values) == 0
        else:
            assert (found.doubt, len(found.values), len(found.hidden)) == ("", many, 1 - many)
    near, far = zeros_of(chain(20, 0)), zeros_of(chain(20, 19))
    assert (near.doubt, len(near.values), near.minimum_phase) == ("", 38, True)
    # 19 zeros at -180: springs and dampers that one follows the other.
    assert (far.doubt, len(far.values), far.minimum_phase) == ("", 19, True)
    assert np.all(np.abs(far.values + 180.0) <= far.errors)
    assert np.all(far.errors < 1.0)
    short = zeros_of(chain(3, 2))
    np.testing.assert_allclose(short.values, [-180.0, -180.0], rtol=1e-5)  # a double one


@pytest.mark.parametrize("seed", sample(range(60), 10))
def test_zeros_of_random_fractions_lie_in_their_discs(seed):
    """G = c Π (s - z) / Π (s - p) with sizes from 1e-6 to 1e6, some poles hidden, some zeros at 0 or equal."""
    rng = np.random.default_rng(seed)

    def points(count):
        found = []
        while len(found) < count:
            size = 10.0 ** rng.uniform(-6, 6)
            if rng.random() < 0.4 and len(found) + 2 <= count:
                turn = size * np.exp(1j * rng.uniform(0.1, 3.0))
                found += [turn, turn.conjugate()]
            else:
                found.append(complex(rng.choice([-1.0, 1.0]) * size))
        return np.array(found)

    poles, hidden = points(int(rng.integers(2, 8))), points(int(rng.integers(0, 3)))
    zeros = points(int(rng.integers(0, len(poles))))
    if len(zeros) and not rng.integers(0, 3):
        zeros[zeros.imag == 0.0] = 0.0

    def values(s):
        G = 3.7 * np.exp(np.sum(np.log(s - zeros)) - np.sum(np.log(s - poles)))
        return complex(G), 1e-13 * abs(G), complex(G * (np.sum(1 / (s - zeros)) - np.sum(1 / (s - poles))))

    every = np.concatenate([poles, hidden])
    found = find(values, every, 1e-14 * np.abs(every), every[:0])
    if found.doubt:
        # The residue of a pole is lost beside what others contribute.
        assert "is reached and seen" in found.doubt
        return
    assert len(found.values) == len(zeros)
    np.testing.assert_allclose(np.sort_complex(np.array(found.hidden)), np.sort_complex(hidden))
    distance = np.abs(found.values[:, None] - zeros)
    rows, columns = linear_sum_assignment(np.log(distance + 1e-300))
    assert np.all(distance[rows, columns] <= found.errors[rows])
    single = np.abs(zeros[columns]) > 0.0
    assert np.all(found.errors[rows][single] <= 1e-7 * np.abs(zeros[columns][single]))


def test_a_loop_on_the_axis_has_no_margin_of_phase_and_no_delay():
    """1/(1 - ω²) is -1 at √2: a delay of a whole turn, 4.4 s, was told."""
    (found,) = margins_of(resonance(0.0, 1.0)).phase
    assert found.frequency == pytest.approx(math.sqrt(2.0))
    assert (found.phase, found.delay) == (0.0, 0.0)


@pytest.mark.parametrize("a", [0.5, 1.0, 2.0])
def test_a_double_zero_known_to_half_of_its_digits_has_margins(a):
    """(s + a)^2/s^3 is −2/a at i a."""
    A, B, C = [[0, 1, 0], [0, 0, 1], [0, 0, 0]], [0, 0, 1], [a * a, 2 * a, 1]
    found = margins_of(channel(A, B, C))
    assert [x.factor for x in found.gain] == pytest.approx([a / 2], rel=1e-6)


def test_the_command_tells_margins_and_draws_nyquist_diagrams(tmp_path):
    bicycle = ("response", "whipple_bicycle.yaml", "--set", "v=5", "--points", "5")
    result = run(*bicycle, "--plot", "bode,nyquist", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 0
    assert all((tmp_path / f"a-{name}.svg").stat().st_size > 5000 for name in ("bode", "nyquist"))
    assert "gain margins: × 2.19707 (6.837 dB) at 0 rad/s" in result.stdout
    first = json.loads(run(*bicycle, "--input", "steer_torque", "--format", "json").stdout)["channels"][0]
    (phase,) = first["margins"]["phase"]
    assert first["margins"]["closed_loop_stable"] is False
    assert 0.1 < phase["frequency"] < 0.2
    # T_δ→φ of Meijaard et al. at rest in the turn: (g K₀ + v² K₂)⁻¹.
    K = 9.81 * np.array([[-80.95, -2.599516852498716], [-2.599516852498716, -0.8032948845861769]])
    K += 25 * np.array([[0, 76.59734589573222], [0, 2.65431523794604]])
    np.testing.assert_allclose(first["largest_gain"]["value"], abs(np.linalg.inv(K)[0, 1]), rtol=1e-10)
    unstable = json.loads(run("response", "whipple_bicycle.yaml", "--set", "v=3", "--format", "json").stdout)
    assert unstable["channels"][0]["largest_gain"]["value"] is None
    assert "unstable" in unstable["channels"][0]["largest_gain"]["reason"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--output", "roll"), "outputs of the model are chosen by --measured"),
        (("--plot", "step"), "drawn as bode or nyquist"),
        (("--step", "1", "--plot", "nyquist"), "drawn as step"),
    ],
)
def test_wrong_questions_are_refused(arguments, message):
    result = run("response", "whipple_bicycle.yaml", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.parametrize("output", ["here", "there"])
def test_margins_of_a_free_axis_whose_phase_leaves_180_degrees_with_the_cube_of_the_frequency(tmp_path, output):
    """Two inertias on a damped spring, as closed forms have it: without a frame, the damping has no force at first."""
    J, J2, k, c = 1.5, 1.1, 4000.0, 2.0
    path = tmp_path / "shafts.yaml"
    path.write_text(
        f"""
mbstab: 1
bodies:
  rotor: {{type: planar, mass: 1, inertia: {J}}}
  arm: {{type: planar, mass: 1, inertia: {J2}}}
joints:
  a1: {{type: revolute, between: [rotor, ground]}}
  a2: {{type: revolute, between: [arm, ground]}}
forces:
  flex:
    type: expression
    on: {{angle(a1): -moment, angle(a2): moment}}
definitions: {{moment: {k}*(angle(a1) - angle(a2)) + {c}*(rate(angle(a1)) - rate(angle(a2)))}}
inputs: {{push: {{type: joint, joint: a1}}}}
outputs: {{there: angle(a2), here: angle(a1)}}
reference: {{coordinates: {{rotor: {{theta: 0}}, arm: {{theta: 0}}}}}}
""",
        encoding="utf-8",
    )
    result = run("response", str(path), "--format", "json")
    assert not result.exit_code, result.stderr
    channels = json.loads(result.stdout)["channels"]
    (found,) = (x["margins"] for x in channels if x["output"] == output)
    above = [c, k] if output == "there" else [J2, c, k]
    below = [J * J2, (J + J2) * c, (J + J2) * k, 0.0, 0.0]
    # |above|² = |below|² at s = iω
    at = np.polyadd(np.polymul(above, np.array(above) * (-1.0) ** np.arange(len(above))[::-1]),
                    -np.polymul(below, np.array(below) * (-1.0) ** np.arange(len(below))[::-1]))  # fmt: skip
    squares = -(np.roots(at) ** 2)
    omega = np.unique(np.sqrt(squares[(abs(squares.imag) < 1e-6) & (squares.real > 0)].real).round(9))
    assert found["gain"] == []
    assert [x["frequency"] for x in found["phase"]] == pytest.approx(list(omega), rel=1e-8)
    for x in found["phase"]:
        G = np.polyval(above, 1j * x["frequency"]) / np.polyval(below, 1j * x["frequency"])
        assert x["phase"] == pytest.approx(np.degrees(np.angle(-G)), rel=1e-6)
