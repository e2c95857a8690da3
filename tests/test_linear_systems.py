"""Random linear systems with small integers: verdicts, bounds, responses against the exact truth, tested itself.

`benchmarks/linear_systems.py` asks for many more of them and tells what is left open without need.
"""

import random
from contextlib import suppress

import linear_oracle
import numpy as np
import pytest
from descriptor_oracle import finite_part, random_descriptor
from descriptor_oracle import truth as descriptor_truth
from linear_oracle import AS, AS_UP_TO, OPEN, S_UP_TO, M, S, U, random_system
from linear_ports import GUISES, Ports, ports, roots
from mpmath import mp, mpc
from sampling import sample
from scipy.optimize import linear_sum_assignment

import mbstab
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.response import answer as respond
from mbstab.analysis.verdict.rule import WORDS
from mbstab.errors import ConstraintError, MassError, MbstabError, ModelFileError, NumericalError
from mbstab.model.words import ASYMPTOTIC_UP_TO, UNDECIDED

NONE = [[0, 0], [0, 0]]
UNIT = [[1, 0], [0, 1]]
TURN = [[0, 1], [-1, 0]]


# --- the truth itself -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("K", "D", "word", "true"),
    [
        ([[1]], [[0]], S, {S, S_UP_TO, M}),
        ([[1]], [[1]], AS, {AS, AS_UP_TO, S, S_UP_TO, M}),
        ([[1]], [[-2]], U, {U}),
        ([[-1]], [[1]], U, {U}),
        ([[0]], [[1]], AS_UP_TO, {AS_UP_TO, S, S_UP_TO, M}),
        ([[0]], [[0]], S_UP_TO, {AS_UP_TO, S_UP_TO, M}),
        ([[0]], [[-1]], U, {U}),
        (UNIT, NONE, S, {S, S_UP_TO, M}),
        ([[1, -1], [0, 1]], NONE, OPEN, {U}),  # x″ = −x + y, y″ = −y
        (NONE, [[0, -1], [0, 0]], U, {U}),  # x″ = y′, y″ = 0
        (NONE, TURN, S_UP_TO, {S, S_UP_TO, M}),  # circles
        ([[-1, 0], [0, -1]], [[0, -2], [2, 0]], OPEN, {U}),  # pairs that meet on a hill
        ([[-1, 0], [0, -1]], [[0, -3], [3, 0]], M, {S, S_UP_TO, M}),  # held on a hill
        ([[-1, 0], [0, -1]], [[1, -3], [3, 1]], U, {U}),
        ([[2, -1], [-1, 2]], [[1, -1], [-1, 1]], S, {S, S_UP_TO, M}),  # two carts, damper between
        ([[1, -1], [-1, 1]], [[1, -1], [-1, 1]], AS_UP_TO, {AS_UP_TO, S_UP_TO, M}),  # free carts, damper between
        ([[1, -1], [-1, 1]], NONE, S_UP_TO, {S_UP_TO, M}),
        ([[1, 1], [-1, 1]], NONE, U, {U}),  # circulatory
        ([[1, 2], [0, 3]], NONE, M, {S, S_UP_TO, M}),
    ],
)
def test_small_systems_are_known_by_hand(K, D, word, true):
    found = linear_oracle.truth(K, D)
    assert found.expected == word
    assert found.allowed == true | {OPEN}


@pytest.mark.parametrize("systems", sample([400, 2000], 2))
def test_exact_truth_agrees_with_eigenvalues_where_those_are_clear(systems):
    rng, clear = random.Random(5), 0
    for _ in range(systems):
        n = rng.randint(1, 4)
        K, D = random_system(rng, n)
        found = linear_oracle.truth(K, D)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.array(K), -np.array(D)]])
        values = np.linalg.eigvals(A)
        # A cluster of eight is spread by the eighth root of rounding.
        if np.min(np.abs(values.real)) > 0.05:
            clear += 1
            assert found.expected == (AS if np.max(values.real) < 0.0 else U)
        if np.max(values.real) > 0.05:
            assert found.expected == U
    assert clear > 0.15 * systems


# --- the verdicts ---------------------------------------------------------------------------------------------------


def drawn(seed, count):
    rng = random.Random(seed)
    for _ in range(count):
        yield random_system(rng, rng.randint(1, 4))


def checked(known, word, place, names, system):
    assert word in WORDS
    assert word in known.allowed, (word, known, system)
    if word == AS_UP_TO:
        assert place in (None, known.in_place), (word, known, system)
    if not known.neutral:
        assert not names, (names, known, system)


@pytest.mark.parametrize("systems", sample([150, 300], 2))
def test_no_verdict_on_a_linear_system_is_wrong(systems):
    words = []
    for system in drawn(1, systems):
        known = linear_oracle.truth(*system)
        result = mbstab.loads(linear_oracle.text(*system)).eig()
        names = result.modulo.symmetries + result.modulo.family
        checked(known, result.verdict, result.in_place, names, system)
        words.append((known.expected, result.verdict))
    for word in (AS, U, S):
        cases = [verdict for expected, verdict in words if expected == word]
        assert cases.count(word) >= 0.9 * len(cases) > 10


@pytest.mark.parametrize(
    ("K", "D"),
    [
        # Shifts and speeds along them that no single coordinate shows.
        ([[0, 0], [1, 2]], [[0, 0], [1, 2]]),
        (
            [[1, 0, 0, -1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0]],
            [[1, 0, 0, -1], [0, 1, 0, 1], [0, 0, 1, 1], [0] * 4],
        ),
        # Conserved functions that are no momenta of symmetries.
        ([[1, 0], [0, 0]], [[1, -1], [2, 0]]),
        ([[1, 1, 1], [0, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 0], [0, 0, 1]]),
        ([[0, 3, 0], [3, 4, 0], [0, 0, 0]], [[0, -3, 1], [3, 0, -2], [-1, 2, 0]]),
        # Some speeds stay, others that conserve the same function grow.
        (NONE, [[1, 1], [-1, -1]]),
    ],
)
def test_what_takes_combinations_to_see_is_seen(K, D):
    known, result = linear_oracle.truth(K, D), mbstab.loads(linear_oracle.text(K, D)).eig()
    assert result.verdict == known.expected
    checked(known, result.verdict, result.in_place, result.modulo.symmetries + result.modulo.family, (K, D))


@pytest.mark.few(2)
@pytest.mark.parametrize("systems", sample([12, 40], 2))
@pytest.mark.parametrize("command", ["precise", "certify", "index3", "sweep"])
def test_no_command_is_wrong_about_a_linear_system(command, systems):
    answered = 0
    for system in drawn(2, systems):
        known = linear_oracle.truth(*system)
        model = mbstab.loads(linear_oracle.text(*system, parameter=True))
        try:
            word = ask(model, command)
        except MbstabError:
            continue
        answered += 1
        checked(known, OPEN if word == "not provable" else word, None, (), system)
    assert answered >= 0.75 * systems


def ask(model, command):
    if command == "sweep":
        return model.sweep("c", np.array([0.9, 1.0, 1.1])).verdicts[1]
    if command == "index3":
        return model.eig(method="index3").verdict
    return (model.eig_precise(40) if command == "precise" else model.certify(40)).verdict


# --- with states, rows of constraints and motions without mass --------------------------------------------------------


REFUSED = (ConstraintError, MassError, ModelFileError)
"""What may be said of rows that vanish or motions that nothing determines."""


def drawn_descriptors(seed, count, massless=0.2):
    """Yield random systems that have an answer, with it and the truth."""
    rng = random.Random(seed)
    for _ in range(count):
        system = random_descriptor(rng, massless)
        A = finite_part(*system.pencil())
        try:
            mechanism = mbstab.loads(system.text())
            answer = mechanism.eig()
        except REFUSED:
            continue
        if A is not None:
            yield system.text(), mechanism, answer, descriptor_truth(A)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("seed", "massless", "count"), sample([(seed, part, 40) for seed in range(12) for part in (0.2, 0.7)], 5)
)
def test_numbers_bounds_and_verdicts_are_true(seed, massless, count):
    answered = decided = 0
    for text, _, answer, known in drawn_descriptors(seed, count, massless):
        assert answer.verdict in known.allowed, text
        assert not (answer.in_place and answer.verdict == ASYMPTOTIC_UP_TO and not known.in_place), text
        expected = np.array(known.eigenvalues)
        assert answer.counts.expected == len(expected), text
        assert answer.counts.neutral <= known.zeros, text
        values = np.array([e.value for e in answer.eigenvalues])
        bounds = np.array([1e-9 if e.kind == "neutral" else e.error_bound for e in answer.eigenvalues])
        bounds += 1e-15 * np.abs(values) + 1e-300
        distance = np.abs(values[:, None] - expected) / bounds[:, None] if len(values) else np.zeros((0, 0))
        rows, columns = linear_sum_assignment(np.log(distance + 1e-300))
        assert np.all(distance[rows, columns] <= 1.0), text
        # What grows or decays decides for itself; rates below are few.
        if known.eigenvalues and (known.word == AS or any(s.real > 1e-6 for s in known.eigenvalues)):
            answered += 1
            decided += answer.verdict in (AS, U)
    assert answered == decided > 5


@pytest.mark.long
@pytest.mark.parametrize(("seed", "count"), sample([(seed, 6) for seed in range(20, 40)], 10))
def test_no_command_says_what_is_not_so(seed, count):
    for text, mechanism, _, known in drawn_descriptors(seed, count):
        proven = None
        with suppress(NumericalError):  # directions without mass that are known in double precision only
            assert mechanism.eig_precise(30).verdict in known.allowed, text
        assert not known.eigenvalues or mechanism.modes(1).verdict in known.allowed, text
        try:
            proven = mechanism.certify().verdict
        except REFUSED:
            continue
        assert (UNDECIDED if proven == "not provable" else proven) in known.allowed, text


CARRIED = """
mbstab: 1
bodies: {{p: {{type: planar_point, mass: {mass}}}, q: {{type: planar_point, mass: 0}}}}
states: {{z: {{rate: {rate}}}}}
forces: {{law: {{type: expression, on: {{{laws}}}}}}}
{rows}
"""


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        # Balances along q: q.x = 0 and q.y = -p.x/2; rows: p.x' = p.y' = z; so z' = -p.x - 3 z/2.
        (
            {
                "mass": 2,
                "rate": "-p.x - rate(q.x) + rate(q.y) - z",
                "laws": "p.x: -4*p.x + p.y - 2*q.y, p.y: p.x - 2*p.y - z, q.x: -q.x, q.y: -2*p.x - 4*q.y",
                "rows": "constraints: {a: {nonholonomic: rate(p.y) - rate(p.x)}, b: {nonholonomic: rate(p.x) - z}}",
            },
            [0.0, -0.75 + 0.6614378277661477j, -0.75 - 0.6614378277661477j],
        ),
        # Roots of s^5 + 3 s^4/4 + 9 s^3 + 21 s^2/2 + 143 s/8 + 153/4.
        (
            {
                "mass": 1,
                "rate": "-p.x + p.y - rate(p.y) - rate(q.x) - z",
                "laws": "p.x: -2*p.x - 2*p.y + 3*q.x - 3*q.y, p.y: 2*p.x - 2*p.y - 3*q.x + q.y - z, "
                "q.x: p.x + 5*p.y - 3*q.x + z, q.y: 3*p.x - p.y + 2*q.x - 2*q.y",
                "rows": "",
            },
            np.roots([1.0, 3 / 4, 9.0, 21 / 2, 143 / 8, 153 / 4]),
        ),
    ],
)
def test_a_state_that_goes_along_with_what_has_no_mass(parts, expected):
    """Directions without mass are computed there, also where nothing that may move has mass: rounding is no part."""
    found = mbstab.loads(CARRIED.format(**parts)).eig()
    assert sorted((e.value for e in found.eigenvalues), key=_order) == pytest.approx(
        sorted(expected, key=_order), abs=1e-12
    )
    assert all(e.error_bound < 1e-11 for e in found.eigenvalues)


def _order(s):
    return round(s.real, 6), s.imag


# --- inputs and outputs of systems in many guises: see `linear_ports` -------------------------------------------------


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
    found = respond(model, points=5)
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


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", sample(range(20), 5))
@pytest.mark.parametrize("guise", GUISES[1:])
def test_guises_change_no_transfer_function(guise, seed):
    system = ports(seed, 1)
    model, found, truth = assert_true(system, guise)
    plain = respond(mbstab.loads(system.text()).state_space(), points=5)
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


@pytest.mark.few(3)
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
@pytest.mark.few(1)
@pytest.mark.parametrize("guise", [x for x in GUISES if x != "nonholonomic"])
def test_a_design_reaches_the_same_optimum_in_every_guise(guise):
    """An oscillator at critical damping decays fastest: c = 2 sqrt(k m)."""
    system = Ports(1, 0, {"m0": "2", "k00": "18", "c00": "3"}, 0, ((0, 0, "1"),))
    found = mbstab.loads(system.text(guise)).design(vary={"c00": (1.0, 40.0)}, goal="decay")
    assert found.values["c00"] == pytest.approx(12.0, rel=1e-4)
