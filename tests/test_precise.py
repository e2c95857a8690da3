"""Eigenvalues with many digits: against closed forms and against elimination that shares nothing with the program."""

import functools
import json
import re
import time
from fractions import Fraction

import closed_forms
import flint
import mpmath
import numpy as np
import pytest
from chains import hanging_chain
from closed_forms import pair
from mechanisms import DOOR
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic
from sampling import sample
from truth import exact_eigenvalues

import mbstab
from mbstab.analysis.algebra.digits import deflated, eigenvalues, exact, kernel, largest
from mbstab.cli import main
from mbstab.errors import ConstraintError, UsageError
from mbstab.model.balls import digits
from mbstab.model.units import UNITS, exact_factor, parse_unit

DIGITS = 50


@functools.cache
def answer(name, digits=DIGITS, **settings):
    return mbstab.load(f"{name}.yaml").eig_precise(digits, **settings)


def worst(found, expected):
    """Return the largest relative distance after pairing each with the nearest, both ways."""
    with mp.workdps(400):
        found, expected = ([mp.mpmathify(x) for x in group] for group in (found, expected))
        assert len(found) == len(expected)
        pairs = [(x, min(expected, key=lambda y: abs(x - y))) for x in found]
        pairs += [(min(found, key=lambda x: abs(x - y)), y) for y in expected]
        return max((abs(x - y) / abs(y) for x, y in pairs), default=mp.zero)


def printed(result):
    return [mp.mpc(e.real, e.imag) for e in result.eigenvalues]


def zeros(result):
    """Return the number of eigenvalues that are zero or neutral, and of those that nothing explains."""
    unexplained = sum(e.value == 0 for e in result.eigenvalues)
    return result.neutral + unexplained, unexplained


def assert_right(result, expected, digits=DIGITS):
    """Compare what is printed, which may be off by half a unit of the last digit, and what is behind it."""
    with mp.workdps(2 * digits + 50):
        assert worst([s for s in printed(result) if s], expected) < mp.mpf(10) ** (1 - digits)
        assert worst([s for s in result.values() if s != 0], expected) < mp.mpf(10) ** -(digits + 1)


# --- closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("digits", [16, 50, 300])
def test_the_pendulum_has_its_closed_form(digits):
    with mp.workdps(digits + 30):
        assert_right(answer("pendulum", digits), closed_forms.pendulum(), digits)


@pytest.mark.parametrize("omega", ["0", "4", "5.6", "10", "-7.3", "5.56772844"])
def test_the_top_has_its_closed_form(omega):
    with mp.workdps(100):
        assert_right(answer("top", omega=omega), closed_forms.top(omega))


@pytest.mark.parametrize("omega", ["1", "3.33", "5", "3.3167642"])
def test_the_rolling_disk_has_its_closed_form(omega):
    result = answer("rolling_disk", omega=omega)
    # Rolling in a circle needs another rate of turn than the driven angle has: two zeros are not explained.
    assert zeros(result) == (4, 2)
    with mp.workdps(100):
        assert_right(result, closed_forms.rolling_disk(omega))


@pytest.mark.parametrize("Omega", ["8", "15"])
def test_the_rotating_pendulum_has_its_closed_form(Omega):
    with mp.workdps(100):
        assert_right(answer("rotating_pendulum", Omega=Omega), closed_forms.rotating_pendulum(Omega))


@pytest.mark.parametrize("P", ["1", "3", "6"])
def test_zieglers_column_has_its_closed_form(P):
    with mp.workdps(100):
        assert_right(answer("ziegler_column", P=P, b_1="0", b_2="0"), closed_forms.ziegler(P))


def test_the_double_pendulum_has_its_closed_form():
    with mp.workdps(100):
        assert_right(answer("double_pendulum"), closed_forms.double_pendulum())


# --- critical parameters --------------------------------------------------------------------------------------------

CRITICAL_TOP = "2*sqrt((I_x + m*H**2)*m*g*H)/I_z"


def test_at_the_critical_spin_the_double_eigenvalue_of_the_top_has_all_its_digits():
    result = answer("top", omega=CRITICAL_TOP)
    assert result.verdict == "undecided"
    assert result.working_digits > 2 * DIGITS  # one digit in two is left
    assert {e.kind for e in result.eigenvalues} == {"undecided"}
    assert "2 eigenvalues lie within" in result.reasons[0]
    assert "reaches over the imaginary axis" in result.reasons[0]
    with mp.workdps(200):
        H, m, I_x, g = (mp.mpf(x) for x in ("0.04", "0.01", "3e-4", "9.81"))
        root = mp.sqrt(m * g * H / (I_x + m * H**2))
        assert worst(printed(result), [1j * root, 1j * root, -1j * root, -1j * root]) < mp.mpf(10) ** -(DIGITS - 1)


def test_at_its_flutter_load_zieglers_column_is_critical():
    result = answer("ziegler_column", P="7/2 - sqrt(2)", b_1="0", b_2="0")
    assert result.verdict == "undecided"
    with mp.workdps(200):
        root = mp.mpf(2) ** mp.mpf("-0.25")
        assert worst(printed(result), [1j * root, 1j * root, -1j * root, -1j * root]) < mp.mpf(10) ** -(DIGITS - 1)


def test_at_the_critical_spin_the_disk_has_two_more_zeros_than_symmetries_explain():
    result = answer("rolling_disk", omega="sqrt(m*g*R*I_t/(I_a*(I_a + m*R**2)))")
    assert (zeros(result), len(result.eigenvalues), result.verdict) == ((6, 4), 4, "undecided")
    assert "no symmetry or family of motions was found that explains it" in result.reasons[0]


def test_next_to_a_critical_spin_the_digits_decide():
    """30 digits of the critical value are more than double precision can tell from it."""
    with mp.workdps(60):
        critical = closed_forms.critical_top()
        below, above = (mp.nstr(critical * (1 + sign * mp.mpf(10) ** -30), 45) for sign in (-1, 1))
    assert mbstab.load("top.yaml").eig(omega=below).verdict == "undecided"
    assert answer("top", omega=below).verdict == "unstable"
    assert answer("top", omega=above).verdict == "marginally stable"
    with mp.workdps(200):
        assert_right(answer("top", omega=below), closed_forms.top(below))


def test_a_slow_eigenvalue_is_told_from_a_neutral_one():
    text = """
mbstab: 1
parameters: {b: 1e-25}
bodies: {cart: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: cart.y}}
forces: {drag: {type: expression, on: {cart.x: -b*rate(cart.x)}}}
reference: {coordinates: {cart: {x: 0, y: 0}}}
"""
    result = mbstab.loads(text).eig_precise(40)
    assert result.neutral == 1
    assert [e.real for e in result.eigenvalues] == ["-1." + 39 * "0" + "e-25"]
    assert (result.verdict, result.in_place) == ("asymptotically stable up to symmetry", True)
    assert result.modulo.symmetries == ("cart.x",)


# --- what digits decide, and what they do not -----------------------------------------------------------------------

PLANE = """
mbstab: 1
bodies: {{p: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{p.x: "{x}", p.y: "{y}"}}}}}}
reference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}
"""


@pytest.mark.parametrize(
    ("x", "y", "verdict"),
    [
        # On the axis to all digits, and nothing holds it there.
        ("-p.x + p.x**2*rate(p.x)", "-p.y - rate(p.y)", "undecided"),
        ("-p.x - p.x**2*rate(p.x)", "-p.y - rate(p.y)", "stable"),
        ("-p.x + 1e-38*rate(p.x)", "-p.y - rate(p.y)", "unstable"),
        ("-p.x - 1e-38*rate(p.x)", "-p.y - rate(p.y)", "asymptotically stable"),
        # A double pair: one vector, which grows with t; two, in a minimum of the energy.
        ("-p.x + p.y", "-p.y", "undecided"),
        ("-p.x", "-p.y", "stable"),
        # Four zeros, of which two shifts and the speed along x explain three: x' grows.
        ("rate(p.y)", "0*p.y", "unstable"),
        ("-rate(p.x)", "-rate(p.y)", "asymptotically stable up to symmetry"),
        # The double root is one of motions that grow, or of such that decay.
        ("2*rate(p.x) - p.x", "-p.y - rate(p.y)", "unstable"),
        ("-2*rate(p.x) - p.x", "-p.y - rate(p.y)", "asymptotically stable"),
    ],
)
def test_only_structure_holds_eigenvalues_on_the_axis(x, y, verdict):
    result = mbstab.loads(PLANE.format(x=x, y=y)).eig_precise(50)
    assert result.verdict == verdict


@pytest.mark.long
def test_a_critical_position_that_is_found_is_known_in_double_precision_only():
    result = mbstab.load("bead_on_hoop.yaml").eig_precise(40, R=0.5, g=8, Omega=4, theta=0)
    assert [e.kind for e in result.eigenvalues] == ["critical", "critical"]
    assert result.verdict == "stable up to symmetry"
    assert any("nothing determines bead.x" in text for text in result.warnings)


# --- against the independent truth ----------------------------------------------------------------------------------

TRUTH = {
    "governor": {},
    "whipple_bicycle": {"v": "5"},
    "four_bar": {},
    "trailer": {},
    "wheelset": {},
    "bricard": {},
    "bead_on_hoop": {},
    "free_rigid_body": {},
    "rattleback": {},
    "shimmy": {},
    "rolling_torus": {},
    "slider_crank": {},
    "wheelset_no_slip": {},
}


@pytest.mark.few(3)
@pytest.mark.parametrize("name", sample(TRUTH, 3))
def test_the_examples_agree_with_the_elimination_that_shares_nothing(name):
    expected, neutral = exact_eigenvalues(mbstab.load(f"{name}.yaml").model, **TRUTH[name])
    began = time.process_time()
    result = answer(name, **TRUTH[name])
    assert time.process_time() - began < 60  # about a second
    assert result.counts.expected == result.counts.found == len(expected) + neutral
    # Tilts of a free body, which turn with it, are modes to the elimination.
    with mp.workdps(2 * DIGITS):
        tilts = [mp.mpc(0, sign * mp.mpf(x)) for x in result.shifts for sign in (1, -1)]
        modes = [s for s in expected if all(abs(s - x) > mp.mpf(10) ** (1 - DIGITS) * abs(x) for x in tilts)]
    assert zeros(result)[0] == neutral + len(expected) - len(modes)
    assert_right(result, modes)


def test_the_speed_of_the_bicycle_counts_in_decimals():
    expected, _ = exact_eigenvalues(mbstab.load("whipple_bicycle.yaml").model, v="4.1")
    assert_right(answer("whipple_bicycle", v="4.1"), expected)
    assert_right(answer("whipple_bicycle", v=4.1), expected)


def test_a_chain_of_random_links_agrees_with_the_elimination():
    model = mbstab.loads(hanging_chain(np.random.default_rng(3), 3))
    expected, neutral = exact_eigenvalues(model.model)
    result = model.eig_precise(20)
    assert result.neutral == neutral
    # Springs that balance to 16 decimals only: the accelerations that are left are not part of an equilibrium.
    assert worst(result.values(), expected) < 1e-13
    assert result.warnings


# --- decimals, not doubles ------------------------------------------------------------------------------------------

OSCILLATOR = """
mbstab: 1
parameters:
  k: {value: 0.1, unit: N/m}
  m: {value: 300, unit: g}
  c: {value: 2*k*1, unit: N/m}
bodies: {mass: {type: planar_point, mass: m}}
constraints: {rail: {holonomic: mass.y}}
forces: {spring: {type: expression, on: {mass.x: -k*mass.x}}}
reference: {coordinates: {mass: {x: 0, y: 0}}}
"""


@pytest.mark.parametrize(
    ("settings", "square"),
    [
        ({}, Fraction(1, 3)),
        ({"k": "0.3"}, Fraction(1)),
        ({"k": 0.3}, Fraction(1)),
        ({"m": "700"}, Fraction(1, 7)),
        ({"m": 0.1}, Fraction(1000)),
        ({"k": mpmath.mpf(1) / 4}, Fraction(5, 6)),
        ({"k": "1/3"}, Fraction(10, 9)),
    ],
)
def test_parameters_are_the_decimals_that_are_written(settings, square):
    result = mbstab.loads(OSCILLATOR).eig_precise(60, **settings)
    with mp.workdps(100):
        assert_right(result, pair(-mp.mpf(square.numerator) / square.denominator), 60)


@pytest.mark.parametrize("unit", [*UNITS, "kg*m^2/s^2", "N*s/mm", "1/s", "g*mm^2", "kN/cm**2", "deg/min"])
def test_factors_of_units_are_exact(unit):
    with mp.workdps(60):
        factor = exact_factor(unit, mpmath_arithmetic())
        assert float(factor) == pytest.approx(parse_unit(unit)[0], rel=1e-15)
        known = {"mm": "0.001", "g": "0.001", "N*s/mm": "1000", "g*mm^2": "1e-9", "kN/cm**2": "1e7", "h": "3600"}
        if unit in known:
            assert abs(factor - mp.mpf(known[unit])) < mp.mpf(10) ** -58 * factor
        if unit == "rpm":
            assert abs(factor - mp.pi / 30) < mp.mpf(10) ** -58


def test_the_moment_of_a_sphere_is_a_fraction():
    text = """
mbstab: 1
gravity: 0
bodies: {ball: {type: planar, mass: 1, shape: {type: sphere, radius: 1}}}
constraints: {x: {holonomic: ball.x}, y: {holonomic: ball.y}}
forces: {spring: {type: expression, on: {ball.theta: -ball.theta}}}
reference: {coordinates: {ball: {x: 0, y: 0, theta: 0}}}
"""
    with mp.workdps(80):
        assert_right(mbstab.loads(text).eig_precise(50), pair(-mp.mpf(5) / 2))


def test_a_spring_without_length_stays_smooth_where_its_ends_meet():
    text = """
mbstab: 1
bodies: {mass: {type: planar_point, mass: 1}}
forces: {spring: {type: spring, between: [mass, ground], stiffness: 4}}
reference: {coordinates: {mass: {x: 0, y: 0}}}
"""
    result = mbstab.loads(text).eig_precise(30)
    assert_right(result, [2j, 2j, -2j, -2j], 30)
    assert result.verdict == "stable"  # double, but the energy has a minimum


# --- double precision -----------------------------------------------------------------------------------------------

ALL = ["chaplygin_sleigh", "governor_paper", "n_four_bar", "von_mises_truss", "wheeled_inverted_pendulum", *TRUTH]


@pytest.mark.parametrize("name", ALL)
def test_double_precision_agrees_within_its_error_bounds(name):
    result = answer(name)
    plain = mbstab.load(f"{name}.yaml").eig()
    assert plain.verdict == result.verdict
    assert plain.counts.neutral == result.neutral
    assert (plain.modulo, plain.in_place) == (result.modulo, result.in_place)
    judged = [e for e in plain.eigenvalues if e.kind != "neutral"]
    assert sorted(e.kind for e in judged) == sorted(e.kind for e in result.eigenvalues)
    for e in judged:
        assert min(abs(e.value - complex(x)) for x in result.values()) <= e.error_bound
    assert not [text for text in result.warnings if "double precision" in text]


def test_frozen_time_numbers_are_no_verdict():
    result = answer("governor_paper", 30, frozen=True)
    assert (result.verdict, result.frozen) == ("undecided", True)
    assert max(float(abs(x.imag)) for x in result.values()) == pytest.approx(12.762, abs=1e-3)


# --- references -----------------------------------------------------------------------------------------------------

CRANK = """
mbstab: 1
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 1, inertia: 0.1, points: {O: [0, 0.5]}}
  weight: {type: planar_point, mass: 2}
joints:
  pin: {type: revolute, between: [rod.O, ground]}
  line: {type: distance, between: [weight, rod.O], length: 0.3}
forces: {hinge: {type: joint_spring, joint: pin, stiffness: 20, rest: 0.7}}
reference:
  find: equilibrium
  guess: {rod: {x: 0.2, y: -0.4, theta: 0.5}, weight: {x: 0, y: -0.3}}
"""


def test_an_equilibrium_is_solved_to_all_digits():
    result = mbstab.loads(CRANK).eig_precise(45)
    with mp.workdps(80):
        theta = mp.findroot(lambda x: mp.mpf("9.81") / 2 * mp.sin(x) + 20 * (x - mp.mpf("0.7")), 0.6)
        rod = (mp.mpf("9.81") / 2 * mp.cos(theta) + 20) / (mp.mpf("0.1") + mp.mpf("0.25"))
        assert_right(result, [*pair(-rod), *pair(-mp.mpf("9.81") / mp.mpf("0.3"))], 45)


SWING = """
mbstab: 1
gravity: [0, -9.81]
bodies: {bar: {type: planar, mass: 1, inertia: 1, points: {A: [-1, 0], B: [0, 0], C: [1, 0]}}}
joints:
  one: {type: distance, between: [bar.A, ground.A], length: 1}
  two: {type: distance, between: [bar.B, ground.B], length: 1}
  three: {type: distance, between: [bar.C, ground.C], length: 1}
ground: {points: {A: [-1, 1], B: [0, 1], C: [1, 1]}}
reference: {coordinates: {bar: {x: 0}}}
"""


def test_redundant_rows_are_redundant_to_all_digits():
    result = mbstab.loads(SWING).eig_precise(40)
    assert (result.counts.n_holonomic, result.counts.rank_holonomic) == (3, 2)
    with mp.workdps(70):
        assert_right(result, pair(-mp.mpf("9.81")), 40)


def test_decimals_that_close_a_redundant_mechanism_in_double_precision_only_are_refused():
    text = SWING.replace("ground.C], length: 1", "ground.C], length: 1.00000000000000001")
    assert mbstab.loads(text).eig().verdict == "stable"
    with pytest.raises(ConstraintError, match=r"contradict each other\nhint: write lengths"):
        mbstab.loads(text).eig_precise(30)


def test_coordinates_with_16_digits_are_taken_as_they_are_and_named():
    text = """
mbstab: 1
gravity: [0, -9.81]
bodies: {mass: {type: planar_point, mass: 1}}
joints: {string: {type: distance, between: [mass, ground], length: sqrt(2)}}
reference: {coordinates: {mass: {x: 0, y: -1.4142135623730951}}}
"""
    result = mbstab.loads(text).eig_precise(30)
    assert "joint 'string' (distance) to 3.6e-17 only" in result.warnings[0]


# --- linear algebra -------------------------------------------------------------------------------------------------


def jordan(*blocks):
    """Return a matrix with Jordan blocks (value, size) in random real coordinates."""
    n = sum(size for _, size in blocks)
    A, at = np.zeros((n, n), dtype=int), 0
    for value, size in blocks:
        A[at : at + size, at : at + size] = value * np.eye(size, dtype=int) + np.eye(size, k=1, dtype=int)
        at += size
    T = exact(np.random.default_rng(5).integers(-3, 4, (n, n)))
    inverse = np.array(flint.arb_mat(T.tolist()).inv().tolist(), dtype=object)
    return exact(T @ exact(A) @ inverse)


@pytest.mark.parametrize(
    ("blocks", "steps"),
    [
        ([(0, 1), (2, 1)], (1,)),
        ([(0, 3), (0, 2), (0, 1), (1, 1)], (3, 2, 1)),
        ([(0, 4), (0, 4)], (2, 2, 2, 2)),
        ([(1, 2)], ()),
    ],
)
def test_the_staircase_of_zeros_has_the_sizes_of_the_blocks(blocks, steps):
    with digits(80):
        found = deflated(jordan(*blocks))
        assert found.steps == steps
        assert found.decided
        assert len(found.S) == sum(size for value, size in blocks if value)


def test_a_null_space_is_found_with_all_digits():
    with digits(60):
        A = exact(np.random.default_rng(1).integers(-4, 5, (6, 4))) @ exact(
            np.random.default_rng(2).integers(-4, 5, (4, 6))
        )
        null = kernel(A, largest(A))
        assert len(null.free) == 2
        assert largest(A @ null.basis) < 1e-55


@pytest.mark.parametrize(
    ("blocks", "chained"),
    [([(1, 1), (2, 1), (3, 1)], 0), ([(1, 2), (2, 1)], 2), ([(1, 1), (1, 1), (2, 1)], 0), ([(2, 3), (2, 1)], 4)],
)
def test_multiple_eigenvalues_are_told_by_their_vectors(blocks, chained):
    with digits(90):
        found = eigenvalues(jordan(*blocks))
        assert sum(e.chained for e in found) == chained
        expected = sorted(value for value, size in blocks for _ in range(size))
        assert sorted(round(float(e.value.real)) for e in found) == expected
        assert all(abs(e.value - round(float(e.value.real))) <= e.radius < 1e-17 for e in found)


# --- command line ---------------------------------------------------------------------------------------------------


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["eig", *arguments])
    captured = capsys.readouterr()
    return stop.value.code or 0, captured.out, captured.err


def test_the_table_shows_the_digits_in_80_columns(capsys):
    code, out, _ = run(capsys, "whipple_bicycle.yaml", "--precision", "40")
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    real, imag = re.search(r"(-0\.7753\d+)\n± (4\.46\d+)i", out).groups()
    assert len(real) == 43  # with the sign and the zero in front
    assert len(imag) == 41
    assert "neutral, 6×" in out
    assert "Verdict: asymptotically stable up to symmetry" in out


def test_json_has_decimal_strings(capsys):
    _, out, _ = run(capsys, "pendulum.yaml", "--precision", "60", "--format", "json")
    data = json.loads(out)
    assert data["digits"] == 60
    with mp.workdps(80):
        exactly = mp.nstr(mp.sqrt(3 * mp.mpf("9.81") / (4 * mp.mpf("0.2"))), 60, strip_zeros=False)
    assert [e["imag"] for e in data["eigenvalues"]] == [exactly, f"-{exactly}"]
    assert {e["real"] for e in data["eigenvalues"]} == {"0"}
    assert data["verdict"] == data["double_precision"]["verdict"] == "stable"
    assert data["in_place"] is True


def test_csv_has_the_same_digits(capsys):
    _, out, _ = run(capsys, "trailer.yaml", "--precision", "20", "--format", "csv")
    assert out.splitlines()[1].startswith("-2.5000000000000000000,0,stable node,")


def test_require_holds_with_digits_as_well(capsys):
    assert run(capsys, "trailer.yaml", "--precision", "20", "--require", "stable")[0] == 0
    assert run(capsys, "pendulum.yaml", "--precision", "20", "--require", "stable")[0] == 0
    assert run(capsys, "pendulum.yaml", "--precision", "20", "--require", "asymptotic")[0] == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pendulum.yaml", "--precision", "15"], "precision 15: from 16 to 1000 digits"),
        (["pendulum.yaml", "--precision", "1001"], "precision 1001: from 16 to 1000 digits"),
        (["pendulum.yaml", "--precision", "many"], "precision"),
        (["pendulum.yaml", "--precision", "30", "--method", "index3"], "not with --method index3"),
        (["kapitza.yaml", "--precision", "30"], "describes a periodic motion"),
        (["pendulum.yaml", "--precision", "30", "--set", "l=1"], "no parameter 'l'"),
    ],
)
def test_what_cannot_be_asked_is_said(capsys, arguments, message):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert message in err


def test_the_interface_refuses_what_the_command_refuses():
    with pytest.raises(UsageError, match="16 to 1000"):
        answer("pendulum", 3)


def test_the_precision_of_the_caller_is_left_alone():
    before = flint.ctx.prec
    answer.__wrapped__("pendulum", 33)
    assert flint.ctx.prec == before


@pytest.mark.parametrize("gravity", ["-2", "2"])
@pytest.mark.parametrize("extra", ["1e-11", "1e-12", "1e-14", "1e-20"])
def test_rows_that_repeat_others_in_double_precision_only_are_named(gravity, extra):
    model = mbstab.loads(DOOR.replace("GRAVITY", gravity).replace("EXTRA", extra))
    for ask in (lambda: model.eig_precise(50), model.compare):
        with pytest.raises(ConstraintError, match="another rank than in double precision") as caught:
            ask()
        text = str(caught.value)
        assert "joint 'c'" in text
        assert "hint:" in text
        differ = float(text.partition("differ by ")[2].split()[0])
        assert 0.1 < differ / float(extra) < 10


def test_an_interval_is_for_certificates_only():
    for ask in (mbstab.load("pendulum.yaml").compare, mbstab.load("pendulum.yaml").eig_precise):
        with pytest.raises(UsageError, match="this is an interval\nhint: intervals need mbstab eig --certify"):
            ask(L="[0.1,0.2]")


@pytest.mark.parametrize("size", ["1e-44", "4e-44", "1e-60", "1e-162", "1e-290"])
def test_a_slow_eigenvalue_is_not_taken_for_zero(size):
    text = f"""
mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}}}
forces: {{f: {{type: expression, on: {{a.x: -rate(a.x) + {size}*a.x, a.y: -a.y - rate(a.y)}}}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}}}}}
"""
    result = mbstab.loads(text).eig_precise(30)
    assert result.verdict == "unstable"
    slow = max(result.eigenvalues, key=lambda e: e.value.real)
    with mp.workdps(400):
        assert abs(mp.mpmathify(slow.value) / mp.mpf(size) - 1) < 1e-29
