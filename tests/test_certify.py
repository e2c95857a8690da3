"""Proven enclosures: they contain closed forms and multiprecision values, and nothing is claimed that is not so."""

import json
import math
import random
import re
from fractions import Fraction
from pathlib import Path

import closed_forms
import mechanisms
import numpy as np
import pytest
import zoo
from click.testing import CliRunner
from flint import arb, ctx
from mpmath import mp
from mpmath_numbers import mpmath_arithmetic
from sampling import sample
from truth import exact_eigenvalues

import mbstab
from mbstab.analysis.algebra import ball_polynomials
from mbstab.analysis.algebra.ball_matrices import matrix
from mbstab.analysis.algebra.balls import NotProvable, ends
from mbstab.analysis.proof.critical_values import proven_change
from mbstab.analysis.proof.intervals import Part, common
from mbstab.analysis.proof.krawczyk import krawczyk_boxes
from mbstab.analysis.proof.tolerances import TOLERANCES as PROOF
from mbstab.analysis.verdict.rule import REQUIRED, STRENGTH, UNDECIDED, WORDS
from mbstab.analysis.verdict.spectrum import Modulo
from mbstab.cli import main
from mbstab.errors import UsageError
from mbstab.model import balls
from mbstab.model.balls import ball, digits, real
from mbstab.model.expressions import parse
from mbstab.model.parameters import bound
from mbstab.model.units import UNITS, exact_factor
from mbstab.report.certificate import certificate_data, certificate_text
from mbstab.report.tables import decimals

MODELS = sorted(Path(__file__).parent.parent.joinpath("models").glob("*.yaml"))


def inside(e, s):
    """Whether an enclosure contains a multiprecision number, which is known to far more digits than its radius."""
    with mp.workdps(80):
        return all(
            abs(mp.mpf(str(part.mid().str(80, radius=False))) - value)
            <= mp.mpf(float(part.rad()) * 1.0001) + mp.mpf(10) ** -75
            for part, value in ((e.real, mp.re(s)), (e.imag, mp.im(s)))
        )


def matched(result, exact):
    """Every exact eigenvalue lies in an enclosure of its own."""
    exactly_zero = [e for e in result.eigenvalues if e.imag.is_zero() and e.real.is_zero() and not e.wide]
    free = [e for e in result.eigenvalues if e.kind != "carried" and e not in exactly_zero]
    assert sum(e.count for e in free) == len(exact)
    for s in exact:
        with ctx.workprec(400):
            e = next(e for e in free if inside(e, s))
        free.remove(e)
        assert e.radius < 1e-35 * (1 + abs(s))


# --- values ---------------------------------------------------------------------------------------------------------


def agree(one, other):
    """Whether two words are about the same motion: one of them says the same as the other, or less."""
    one, other = (UNDECIDED if word == "not provable" else word for word in (one, other))
    return one in STRENGTH[other] or other in STRENGTH[one]


def test_the_pendulum_swings_exactly_on_the_axis_and_the_energy_holds_it_there():
    result = mbstab.load("pendulum.yaml").certify()
    assert result.verdict == "stable"
    assert result.in_place
    assert result.evidence == "enclosed"
    assert "the energy has a strict minimum here" in result.notes[0]
    assert result.proven
    assert not result.assumed
    assert [e.kind for e in result.eigenvalues] == ["imaginary"] * 2
    assert all(e.real.is_zero() for e in result.eigenvalues)
    with mp.workdps(70):
        matched(result, closed_forms.pendulum())


@pytest.mark.parametrize(
    ("omega", "verdict"), [("4", "unstable"), ("5.6", "marginally stable"), ("10", "marginally stable")]
)
def test_the_top_has_its_closed_form(omega, verdict):
    result = mbstab.load("top.yaml").certify(omega=omega)
    assert result.verdict == verdict
    assert not result.assumed
    with mp.workdps(70):
        matched(result, closed_forms.top(omega))


def test_the_disk_rolls_with_four_exact_zeros_of_which_two_have_no_explanation():
    # The drive of its last angle breaks the turn about the vertical: steady circles do not exist.
    result = mbstab.load("rolling_disk.yaml").certify()
    kinds = [(e.kind, e.count) for e in result.eigenvalues]
    assert sorted(kinds) == [("imaginary", 1)] * 2 + [("open", 1)] * 2 + [("zero", 2)]
    assert not result.decided
    assert any(reason.startswith("nothing explains: ") for reason in result.reasons)
    with mp.workdps(70):
        matched(result, closed_forms.rolling_disk(5))


SPEEDS = {"v": "5"}
LENGTHS = {"L": "0.05", "R": "0.002", "H": "0.02", "e": "0.01777", "omega": "10"}


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("name", "settings", "verdict"),
    sample(
        [
            ("whipple_bicycle", SPEEDS, "asymptotically stable up to symmetry"),
            ("whipple_bicycle", {"v": "3"}, "unstable"),
            ("wheeled_inverted_pendulum", {}, "unstable"),
            ("double_pendulum", {}, "stable"),
            ("wheelset", {}, "asymptotically stable"),
            ("trailer", {}, "asymptotically stable"),
            ("ziegler_column", {}, "unstable"),
            ("rattleback", {}, "stable up to symmetry"),
            ("slider_crank", {}, "asymptotically stable"),
            ("governor", LENGTHS, "asymptotically stable up to symmetry"),
        ],
        4,
    ),
)
def test_enclosures_contain_the_truth(name, settings, verdict):
    mechanism = mbstab.load(f"{name}.yaml")
    exact, neutral = exact_eigenvalues(mechanism.model, **settings)
    ends = {key: text for key, text in settings.items() if mechanism.model.parameters[key].unit != "mm"}
    result = mechanism.certify(**ends)
    assert result.verdict == verdict
    zeros = [
        e for e in result.eigenvalues if e.kind == "zero" or (e.kind == "open" and e.real.is_zero() and not e.wide)
    ]
    assert sum(e.count for e in zeros) == neutral
    matched(result, exact)


# Motions backwards in time in a mirror are not looked at in balls, nor families of motions that the controller holds.
NUMERICAL_ONLY = ("rolling_torus", "wheelset_no_slip", "cart_pendulum")


PERIODIC = ("kapitza",)


@pytest.mark.parametrize("name", PERIODIC)
def test_nothing_is_proven_about_a_periodic_motion(name):
    mechanism = mbstab.load(f"{name}.yaml")
    result = mechanism.certify()
    assert mechanism.eig().period is not None
    assert not result.proven
    assert "periodic" in result.statement


STEADY, POSED = "its steady motion is overdetermined", "the file gives a motion that holds to the digits only"
NOT_PROVEN = {
    "bricard": "rows that repeat others",
    "flyball_governor": STEADY,
    "governor": STEADY,
    "governor_paper": STEADY,
    "rotating_pendulum": STEADY,
    "four_bar": POSED,
    "n_four_bar": POSED,
    "motorcycle": POSED,
    "whipple_bicycle": POSED,
    "cart_pendulum": "a family of motions that is only followed",
    "rolling_disk": "a critical state",
    "rolling_torus": "a critical state",
    "turntable": "constants of the motion that are only found",
}
"""Examples whose verdict is not proven without conditions, and why."""


@pytest.mark.parametrize(
    "path", sample([path for path in MODELS if path.stem not in PERIODIC], 3), ids=lambda path: path.stem
)
def test_answers_in_double_precision_lie_inside(path):
    mechanism = mbstab.load(path)
    result, rough = mechanism.certify(), mechanism.eig()
    assert agree(result.verdict, rough.verdict)
    assert result.proven != (path.stem in NOT_PROVEN)
    if path.stem not in NUMERICAL_ONLY:
        proven = result.verdict if result.proven else UNDECIDED
        assert UNDECIDED in (proven, rough.verdict) or rough.verdict in STRENGTH[proven]
        assert result.verdict != rough.verdict or result.modulo == rough.modulo
    assert sum(e.count for e in result.eigenvalues) == rough.counts.found
    for e in rough.eigenvalues:
        slack = e.error_bound + 1e-15 if e.kind != "neutral" else 1e-9
        assert any(other.contains(e.value, slack) for other in result.eigenvalues), e.value


RANDOM = [
    "ziegler_column",
    "wheelset",
    "whipple_bicycle",
    "top",
    "rolling_torus",
    "rattleback",
    "shimmy",
    "bead_on_hoop",
]


@pytest.mark.few(1)
@pytest.mark.parametrize("name", sample(RANDOM, 4))
def test_at_other_parameters_both_ways_agree(name):
    rng = random.Random(name)
    mechanism = mbstab.load(f"{name}.yaml")
    parameters, values = mechanism.model.parameters, mechanism.parameters()
    literal = [key for key in parameters if parameters[key].expression.literal]
    answered = 0
    for _ in range(4):
        key = rng.choice(literal)
        value = round(values[key] / parameters[key].factor * rng.uniform(0.5, 1.6), 4)
        try:
            rough = mechanism.eig(**{key: value})
        except mbstab.MbstabError:
            continue
        answered += 1
        result = mechanism.certify(**{key: repr(value)})
        assert agree(result.verdict, rough.verdict)
        for e in rough.eigenvalues:
            slack = (e.error_bound if e.kind != "neutral" else 1e-9) + 1e-14
            assert any(other.contains(e.value, slack) for other in result.eigenvalues), (key, value, e.value)
    assert answered >= 2


# --- intervals ------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("below", "above"), sample([("5.5", "5.7"), ("5.5677", "5.5678")], 2))
def test_the_top_falls_for_every_slow_spin_and_sleeps_for_every_fast_one(below, above):
    top = mbstab.load("top.yaml")
    slow, fast = top.certify(omega=f"[0, {below}]"), top.certify(omega=f"[{above}, 100]")
    assert slow.verdict == "unstable"
    assert [(p.low, p.high) for p in slow.parts] == [(0, Fraction(below))]
    assert fast.verdict == "marginally stable"
    assert fast.status == "conditional"
    assert "provided that the reference satisfies the constraints" in fast.statement


def test_the_critical_spin_of_the_top_to_thirty_digits():
    found = proven_change(mbstab.load("top.yaml").model, "omega", Fraction(5), Fraction(6), 30)
    with mp.workdps(60):
        exact = closed_forms.critical_top()
        low, high = (mp.mpf(x.numerator) / x.denominator for x in (found.low, found.high))
        assert low < exact < high
        assert high - low < mp.mpf(10) ** -30
    assert found.test == "collision"
    assert found.unstable == (2, 0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("low", "high", "value", "unstable"),
    sample([("4", "5", 4.29238253634110396, (2, 0)), ("6", "6.1", 6.02426201538835889, (0, 1))], 2),
)
def test_weave_and_capsize_of_the_bicycle(low, high, value, unstable):
    found = proven_change(mbstab.load("whipple_bicycle.yaml").model, "v", Fraction(low), Fraction(high), 25)
    assert found.unstable == unstable
    assert float(found.low) == pytest.approx(value, abs=1e-14)
    assert float(found.high - found.low) < 1e-24


def test_a_critical_value_that_is_not_there_is_refused():
    with pytest.raises(NotProvable, match="no test function changes its sign"):
        proven_change(mbstab.load("top.yaml").model, "omega", Fraction(6), Fraction(7))


@pytest.mark.long
@pytest.mark.parametrize("seed", sample(range(3, 7), 4))
def test_an_interval_over_a_change_is_not_claimed(seed):
    rng = random.Random(seed)
    top, critical = mbstab.load("top.yaml"), 5.5677284416537414
    low, high = critical - 10 ** rng.uniform(-5, 0), critical + 10 ** rng.uniform(-5, 0)
    result = top.certify(omega=f"[{low!r}, {high!r}]")
    assert not result.proven
    assert result.statement.startswith("not provable")
    for part in result.parts:
        expected = (
            "unstable" if part.high < critical else "marginally stable" if part.low > critical else "not provable"
        )
        assert part.verdict == expected
    (open_,) = [part for part in result.parts if part.verdict == "not provable"]
    assert open_.low < critical < open_.high
    assert float(open_.high - open_.low) <= 4 * PROOF.part_width * (high - low)


def test_parts_agree_with_points_inside_them():
    rng = random.Random(8)
    wheelset = mbstab.load("wheelset.yaml")
    name = next(iter(wheelset.model.sweep))
    nominal = wheelset.parameters()[name] / wheelset.model.parameters[name].factor
    result = wheelset.certify(**{name: f"[{0.9 * nominal!r}, {1.1 * nominal!r}]"})
    for part in result.parts:
        for _ in range(5):
            value = float(part.low + (part.high - part.low) * Fraction(rng.random()))
            if part.verdict != "not provable":
                assert wheelset.eig(**{name: value / wheelset.model.parameters[name].factor}).verdict == part.verdict


def test_a_reference_that_fits_in_the_middle_only_proves_nothing():
    text = MODELS[0].with_name("top.yaml").read_text(encoding="utf-8")
    model = mbstab.loads(text.replace("psi: omega}", "psi: 7}"))
    result = model.certify(omega="[6, 8]")
    assert model.certify(omega="7").proven
    assert not result.proven
    assert all(part.verdict == "not provable" for part in result.parts)


def test_an_interval_counts_in_the_unit_of_the_parameter():
    model = mbstab.load("governor.yaml").model
    with digits(30):
        low, high = ends(bound(model, {"L": "[49, 50.5]"}), "L")
        assert balls.fraction(low) == Fraction(49, 1000)
        assert balls.fraction(high) == Fraction(505, 10000)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"omega": "[5,"}, "an interval is written"),
        ({"omega": "[6, 5]"}, "must be below"),
        ({"omega": "[5, x]"}, "unknown parameter"),
        ({"omega": "[5, 6]", "m": "[1, 2]"}, "one parameter may be an interval"),
        ({"omega": "5 +"}, "expected a number"),
        ({"spin": "5"}, "no parameter"),
    ],
)
def test_settings_that_are_none(settings, message):
    with pytest.raises(UsageError, match=message):
        mbstab.load("top.yaml").certify(**settings)


# --- one equilibrium ------------------------------------------------------------------------------------------------

POINT = """
mbstab: 1
parameters: {p: 0.5}
bodies: {b: {type: planar_point, mass: 1}}
constraints: {y: {holonomic: b.y}}
forces: {f: {type: expression, on: {b.x: FORCE}}}
reference: REFERENCE
"""


def point(force, guess=None):
    """A body on a line with a force along it, at an equilibrium next to a guess, or at rest at 0."""
    reference = "{coordinates: {b: {x: 0, y: 0}}}"
    if guess is not None:
        reference = f"{{find: equilibrium, coordinates: {{b: {{y: 0}}}}, guess: {{b: {{x: {guess}}}}}}}"
    return mbstab.loads(POINT.replace("FORCE", force).replace("REFERENCE", reference))


HYSTERESIS = "p + b.x - b.x**3 - rate(b.x)"
THREE = "-(b.x**2 - 1)*b.x - rate(b.x)*(b.x + p)"  # x = 1 and x = -1 attract, if the damping is positive there


@pytest.mark.long
def test_a_branch_that_folds_is_not_continued_on_another_one():
    fold = 2 / math.sqrt(27)
    result = point(HYSTERESIS, -1).certify(p="[-0.3, 0.43]")
    assert not result.decided
    stable, lost = result.parts
    assert stable.verdict == "asymptotically stable"
    assert fold - 1e-6 < float(stable.high) < fold
    assert lost.verdict == "not provable"
    assert lost.high == Fraction("0.43")
    assert "the motion followed from p = -0.3 is lost near p = 0.38490" in lost.reason
    assert float(stable.at_high["b.x"]) == pytest.approx(-1 / math.sqrt(3), abs=1e-3)


def test_before_the_fold_the_branch_is_named():
    result = point(HYSTERESIS, -1).certify(p="[-0.3, 0.38]")
    assert result.proven
    assert "the equilibrium that the file leads to at p = -0.3" in result.statement
    (part,) = result.parts
    for p, at in ((-0.3, part.at_low), (0.38, part.at_high)):
        x = float(at["b.x"])
        assert p + x - x**3 == pytest.approx(0, abs=1e-14)
        assert x < -0.57


def test_a_guess_that_jumps_does_not_take_the_proof_along():
    result = point(THREE, "p").certify(p="[-1, 0.9]")
    (part,) = result.parts
    assert result.verdict == "unstable"
    assert [float(at["b.x"]) for at in (part.at_low, part.at_high)] == pytest.approx([-1, -1])
    right = point(THREE, "p").certify(p="[0.6, 1]")
    assert right.verdict == "asymptotically stable"
    assert float(right.parts[0].at_low["b.x"]) == pytest.approx(1)


def test_where_the_lower_end_has_none_it_begins_at_the_upper_one():
    result = point("p - b.x**2 - rate(b.x)", 1).certify(p="[-0.5, 1]")
    lost, stable = result.parts
    assert stable.verdict == "asymptotically stable"
    assert 0 < stable.low < 1e-6
    assert "followed from p = 1 is lost" in lost.reason


def test_no_equilibrium_is_one_row_with_one_reason():
    done = []
    result = point("p - b.x**2 - rate(b.x)", 1).certify(50, done.append, p="[-2, -1]")
    (part,) = result.parts
    assert part.verdict == "not provable"
    assert "no equilibrium is proven to exist at its ends and in its middle" in part.reason
    assert len(result.reasons) == 1
    assert done == [1.0]


def test_a_limit_of_boxes_leaves_what_is_proven(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.proof.tolerances.Tolerances.interval_parts", 5)
    result = point(HYSTERESIS, -1).certify(p="[-0.3, 0.38]")
    assert [part.verdict for part in result.parts] == ["asymptotically stable", "not provable"]
    assert "given up after 5 parts" in result.parts[1].reason


def test_progress_never_goes_back():
    done = []
    point(HYSTERESIS, -1).certify(50, done.append, p="[-0.3, 0.43]")
    assert done == sorted(done)
    assert done[-1] == 1.0


def test_a_start_that_fails_in_double_precision_leaves_a_part_open_to_division():
    bump = point("-b.x - (1 - 2*exp(-((p-0.123456789)*40)**2))*rate(b.x)")
    result = bump.certify(p="[0, 1]")
    verdicts = [part.verdict for part in result.parts]
    assert verdicts == ["asymptotically stable", "not provable", "unstable", "not provable", "asymptotically stable"]


def test_a_critical_value_belongs_to_one_equilibrium():
    # The damping of x = 1 is 1 - 2 p; that of the other one does not change its sign.
    model = point("-(b.x**2 - 1)*b.x - rate(b.x)*(b.x - 2*p)", "0.4 + p").model
    found = proven_change(model, "p", Fraction("0.3"), Fraction("0.7"), 20)
    assert found.low < Fraction(1, 2) < found.high
    model = point("-(b.x**2 - 1)*b.x - rate(b.x)*b.x", "p").model
    with pytest.raises(NotProvable):
        proven_change(model, "p", Fraction("-0.7"), Fraction("0.7"), 20)


def test_a_test_function_that_is_zero_where_nothing_changes_proves_no_critical_value():
    # The eigenvalues of a saddle are 1 and -1 at p = 0, and their sum passes zero.
    saddle = point("b.x - p*rate(b.x)").model
    with pytest.raises(NotProvable, match="the number of unstable eigenvalues is 1 on both sides"):
        proven_change(saddle, "p", Fraction("-0.5"), Fraction("0.7"))


def test_a_pair_of_roots_close_to_the_real_line_is_told_apart():
    with digits(50):
        below, above = ball_polynomials.root_discs([ball(144 + Fraction(1, 10**22)), ball(24), ball(1)])
    assert {round(float(centre.imag.mid()) * 1e11) for centre, _, _ in (below, above)} == {-1, 1}
    assert all(radius < 1e-40 and count == 1 for _, radius, count in (below, above))


def swept(*arguments):
    return CliRunner().invoke(main, ["sweep", *arguments, "--certify", "--plot", "none"])


def test_sweep_proves_its_critical_values():
    arguments = ("top.yaml", "--param", "omega", "--from", "5", "--to", "6", "--points", "11")
    (critical,) = json.loads(swept(*arguments, "--format", "json").stdout)["critical"]
    ball_ = critical["enclosure"]
    with mp.workdps(40):
        assert abs(mp.mpf(ball_["midpoint"]) - closed_forms.critical_top()) < mp.mpf(ball_["radius"])
    assert float(ball_["radius"]) < 1e-20
    assert ball_["conditions"] == ["the reference satisfies the constraints"]
    assert ball_["reason"] == ""
    text = swept(*arguments).stdout
    assert "5.56772844165374143  ± 2e-17  collision" in text
    assert "5.56773 proven, provided that the reference satisfies the constraints" in text
    last = swept(*arguments, "--format", "csv").stdout.splitlines()[-1]
    assert last.startswith("5.5677284416537")
    assert last.endswith("; the reference satisfies the constraints")
    assert f",critical: collision; {ball_['midpoint']} ± {ball_['radius']};" in last


@pytest.mark.long
def test_sweep_says_why_a_critical_value_is_not_proven():
    text = swept("von_mises_truss.yaml", "--param", "P", "--from", "-5", "--to", "5", "--points", "11").output
    assert "not proven: only divergence, flutter, collision can be proven, not 'fold'" in " ".join(text.split())
    assert "not proven: it is on a path beyond a fold" in " ".join(text.split())


def test_a_chart_proves_nothing():
    refused = swept("whipple_bicycle.yaml", "--param", "v", "--param", "g")
    assert refused.exit_code == 2
    assert "--certify goes with one parameter" in refused.stderr


# --- rows that repeat others ----------------------------------------------------------------------------------------

DOOR = mechanisms.DOOR.replace("GRAVITY", "-2")


def door(extra):
    return mbstab.loads(DOOR.replace("EXTRA", extra))


@pytest.mark.parametrize("extra", ["1e-11", "1e-14", "1e-20", "-1e-12"])
def test_rows_that_are_independent_are_not_left_out(extra):
    result = door(extra).certify()
    assert not result.decided
    assert "do not repeat each other: their rank is at least 6" in result.statement


def test_rows_that_may_repeat_others_are_a_condition():
    result = door("0").certify()
    assert result.status == "conditional"
    assert not result.proven
    assert result.statement.startswith("proven stable, provided that these rows repeat others: joint 'b'")
    data = certificate_data(result, None)
    assert data["verdict"] == "stable"
    assert data["evidence"] == "numerical"
    assert data["status"] == "conditional"
    assert data["conditions"]


@pytest.mark.long
@pytest.mark.parametrize("interval", sample(["[-1e-14, 1e-14]", "[0, 1e-14]", "[-3e-15, 1e-14]"], 3))
def test_rows_that_repeat_others_at_one_value_only(interval):
    result = door("0").certify(e=interval)
    assert not result.decided
    assert {part.verdict for part in result.parts} == {"not provable"}


def test_a_reference_that_fits_at_both_ends_only_proves_nothing():
    assert not point("p*(1 - p)*1e-30 - b.x - rate(b.x)").certify(p="[0, 1]").decided


def test_what_is_reversible_and_what_is_up_to_nonlinear_terms():
    # The motion grows: only its linearization swings for ever.
    found = point("-b.x + rate(b.x)**3").certify()
    assert found.verdict == "marginally stable"
    assert {e.why for e in found.eigenvalues} == {"the linearized equations are reversible"}
    assert "depends on nonlinear terms" in found.notes[0]
    assert "depends on nonlinear terms" in run("top.yaml", "--certify").output.replace("\n", " ")
    assert point("-b.x*(1 + p*p) + rate(b.x)**3").certify(p="[0, 1]").notes
    assert point("-b.x*(1 + p*p)").certify(p="[0, 1]").verdict == "stable"
    assert not point("-b.x - rate(b.x)").certify().notes


# --- what is told from what looks the same ----------------------------------------------------------------------------


def free_point(x, y, **more):
    """A point in the plane under forces, written with x, y and their rates u, v."""
    return mbstab.loads(zoo.point(x, y, **more))


def test_a_shift_of_the_linear_equations_alone_explains_no_zero():
    cubic = free_point("-u", "-v + y**3").certify()
    assert cubic.status == "not provable"
    assert "nothing explains: p.y" in cubic.reasons
    assert certificate_text(cubic, None).count("nothing explains") == 1
    assert [e.why for e in cubic.eigenvalues if e.kind == "zero"] == ["the position p.x"]
    tiny = free_point("-1e6*u", "-1e6*v + 1e-40*y**3").certify()
    assert tiny.status == "not provable"
    true = free_point("-u", "-v").certify()
    assert true.statement.startswith("proven asymptotically stable up to symmetry (the positions p.x and p.y): 2 eig")
    assert true.in_place


def test_a_speed_that_drives_another_is_no_family():
    assert free_point("v", "0").certify().status == "not provable"


@pytest.mark.parametrize(
    ("force", "reason"),
    [
        ("-(1 + sin(2*pi/3*t)/2)*b.x - rate(b.x)/1000", "periodic with 3 s"),
        ("tanh(t - 50)*b.x - rate(b.x)/10", "tanh(t - 50)"),
        ("-(1 - 2*smooth_start((t - 5)/10))*b.x - rate(b.x)/10", "from t = 15 s on they are constant"),
    ],
)
def test_samples_that_agree_prove_no_constancy(force, reason):
    found = point(force).certify()
    assert found.status == "not provable"
    assert "depend on time through forces.f" in found.statement
    assert reason in found.statement
    assert found.digits == 50  # more of them do not help


def test_a_law_that_has_come_to_rest_is_constant():
    text = POINT.replace("FORCE", "-b.x - rate(b.x)*smooth_start(t/9)")
    later = text.replace("REFERENCE", "{time: 9, coordinates: {b: {x: 0, y: 0}}}")
    assert mbstab.loads(later).certify().verdict == "asymptotically stable"


def test_a_double_pair_on_the_axis_counts_with_two_vectors_or_a_definite_energy():
    grows = free_point("-x + y", "-y").certify()
    assert grows.status == "not provable"
    assert any(e.kind == "open" and "more than one" in e.why for e in grows.eigenvalues)
    assert free_point("-x", "-y").certify().verdict == "stable"
    # Without an energy, but nothing leads from one to the other.
    assert free_point("-x + u**3", "-y + v**3").certify().verdict == "marginally stable"
    assert free_point("2*v + x", "-2*u + y").certify().status == "not provable"


@pytest.mark.parametrize(
    ("name", "verdict"),
    sample(
        [
            ("pendulum", "stable"),
            ("pendulum, hardly damped", "asymptotically stable"),
            ("equal pairs of a spring", "stable"),
            ("equal pairs of forces", "stable"),
            ("spring pendulum, two to one", "stable"),
            ("two carts, damper between", "stable"),
            ("quadratic drive, damped", "asymptotically stable up to symmetry"),
            ("trough in a ring", "asymptotically stable up to symmetry"),
            ("two points turning about each other", "asymptotically stable up to symmetry"),
            ("two points turning about each other, undamped", "stable up to symmetry"),
            ("pendulum on a free cart", "stable up to symmetry"),
            ("free body about its least axis", "stable up to symmetry"),
            ("sleeping top, fast", "stable up to symmetry"),
            ("sleeping top, slow", "unstable"),
            ("sleigh forwards", "asymptotically stable up to symmetry"),
            ("rattleback at rest", "stable up to symmetry"),
            ("rattleback spinning", "unstable"),
            ("Ziegler's column, hardly damped", "unstable"),
            ("negative damping below rounding", "unstable"),
            ("held on a hill by gyroscopic forces", "marginally stable"),
            ("held on a hill, slightly damped", "unstable"),
            ("push that has begun", "unstable"),
        ],
        2,
    ),
)
def test_verdicts_of_systems_with_known_truth_are_proven(name, verdict):
    system = next(x for x in zoo.SYSTEMS if x.name == name)
    found = mbstab.loads(system.text).certify(40)
    assert (found.verdict, found.status) == (verdict, "proven")


@pytest.mark.parametrize("name", sample(["bicycle at 5 m/s", "Watt governor, driven", "Watt governor, free"], 3))
def test_machines_decay_up_to_their_symmetries(name):
    system = next(x for x in zoo.SYSTEMS if x.name == name)
    mechanism = mbstab.loads(system.text)
    found, rough = mechanism.certify(40), mechanism.eig()
    assert found.verdict == rough.verdict == "asymptotically stable up to symmetry"
    assert found.modulo == rough.modulo
    assert found.in_place == system.in_place
    assert all("symmetry" not in text for text in found.conditions)


def test_what_is_not_verified_in_balls_is_a_condition(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.proof.identities.Identities.conserved", lambda *_: "open")
    found = mbstab.load("chaplygin_sleigh.yaml").certify()
    assert found.status == "conditional"
    assert found.evidence == "numerical"
    assert "provided that the energy is conserved (checked in double precision)" in found.statement
    # Growth needs no symmetry.
    assert mbstab.load("chaplygin_sleigh.yaml").certify(v=-1).proven


def test_what_is_refuted_in_balls_is_no_condition(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.proof.identities.Identities.conserved", lambda *_: "refuted")
    assert not mbstab.load("chaplygin_sleigh.yaml").certify().decided


def test_words_over_intervals():
    sleigh = mbstab.load("chaplygin_sleigh.yaml").certify(v="[0.5, 2]")
    assert sleigh.verdict == "asymptotically stable up to symmetry"
    assert sleigh.modulo == mbstab.load("chaplygin_sleigh.yaml").eig().modulo
    assert "(the positions sleigh.x and sleigh.y, the angle in the plane and the speed) for every v" in sleigh.statement
    # Damping that grows from nothing is not told from none next to it.
    found = point("-b.x - p*rate(b.x)").certify(p="[0, 1]")
    assert {part.verdict for part in found.parts} == {"not provable", "asymptotically stable"}
    assert not point("-b.x - p*rate(b.x)").certify(p="[-0.1, 1]").decided


def test_what_holds_over_parts_with_different_words_is_the_weaker_one():
    def parts(*verdicts):
        modulo = {word: Modulo(("b.x",)) for word in ("stable up to symmetry", "asymptotically stable up to symmetry")}
        return [Part(Fraction(k), Fraction(k + 1), x, modulo=modulo.get(x, Modulo())) for k, x in enumerate(verdicts)]

    assert common(parts("asymptotically stable", "stable")) == ("stable", Modulo())
    assert common(parts("asymptotically stable", "marginally stable")) == ("marginally stable", Modulo())
    up_to = parts("stable", "asymptotically stable up to symmetry")
    assert common(up_to) == ("stable up to symmetry", Modulo(("b.x",)))
    assert common(parts("asymptotically stable", "unstable")) is None
    assert common(parts("asymptotically stable", "not provable")) is None


@pytest.mark.long
def test_words_that_may_be_required_are_those_of_the_rule():
    assert all(set(words) <= set(WORDS) for words in REQUIRED.values())
    assert run("whipple_bicycle.yaml", "--certify", "--require", "asymptotic").exit_code == 0
    assert run("pendulum.yaml", "--certify", "--require", "stable").exit_code == 0
    assert run("pendulum.yaml", "--certify", "--require", "asymptotic").exit_code == 3


# --- what cannot be proven ------------------------------------------------------------------------------------------


def test_a_critical_state_is_not_judged():
    # The spring balances the weight of the upright bar exactly.
    text = """
mbstab: 1
gravity: [0, -10]
bodies: {bar: {type: planar, mass: 1, inertia: 0.1, points: {O: [0, -1]}}}
joints: {pivot: {type: revolute, between: [bar.O, ground]}}
forces: {spring: {type: joint_spring, joint: pivot, stiffness: 10}}
reference: {coordinates: {bar: {x: 0, y: 1, theta: 0}}}
"""
    result = mbstab.loads(text).certify()
    assert not result.proven
    assert "no symmetry or family of motions was found that explains it" in result.statement


def test_digits_that_do_not_suffice_are_doubled():
    # A stiffness 1e-80 above the critical one.
    model = """
mbstab: 1
gravity: [0, -10]
bodies: {bar: {type: planar, mass: 1, inertia: 0.1, points: {O: [0, -1]}}}
joints: {pivot: {type: revolute, between: [bar.O, ground]}}
forces: {spring: {type: joint_spring, joint: pivot, stiffness: "10*(sin(1)**2 + cos(1)**2) + EXTRA"}}
reference: {coordinates: {bar: {x: 0, y: 1, theta: 0}}}
"""
    result = mbstab.loads(model.replace("EXTRA", "1e-80")).certify()
    assert result.verdict == "stable"
    assert result.digits == 100
    zero = mbstab.loads(model.replace("EXTRA", "0")).certify()
    assert not zero.proven
    assert zero.digits == 200
    assert "no symmetry or family of motions was found that explains" in zero.statement


def test_an_equilibrium_that_is_not_isolated_is_not_proven_to_exist():
    text = """
mbstab: 1
gravity: [0, -10]
bodies: {disk: {type: planar, mass: 1, inertia: 0.1}}
contacts: {ground: {type: disk, center: disk, radius: 1}}
reference: {find: equilibrium, guess: {disk: {x: 0.3, y: 1.2, theta: 0}}}
"""
    result = mbstab.loads(text).certify()
    assert not result.proven
    assert "not isolated" in result.statement


# --- numbers --------------------------------------------------------------------------------------------------------

EXPRESSIONS = [
    "sin(x)*cos(y) + tan(x/3)", "atan2(x, y) - asin(x/10)", "exp(-x)*log(1 + y*y)", "sqrt(x*x + y*y)**3",
    "acos(y/20) + atan(x)", "sinh(x/5) - cosh(y/5)*tanh(x)", "abs(x - 7)*smooth_start(y/9)", "x**y - (x + 1)**-3",
    "cos(x*pi/4) + sin(30*deg*y)", "2**0.5 + x/3 - y/7",
]  # fmt: skip


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_balls_contain_what_mpmath_finds(text):
    rng = random.Random(text)
    for _ in range(20):
        x, y = (Fraction(rng.randint(1, 60), rng.choice([7, 64, 100])) for _ in range(2))
        with digits(40), mp.workdps(90):
            found = real(parse(text).evaluate({"x": ball(x), "y": ball(y)}, balls.ball_arithmetic()))
            names = {"x": mp.mpf(x.numerator) / x.denominator, "y": mp.mpf(y.numerator) / y.denominator}
            exact = parse(text).evaluate(names, mpmath_arithmetic())
            middle = mp.mpf(found.mid().str(120, radius=False))
            assert abs(middle - exact) <= mp.mpf(float(found.rad())) * mp.mpf("1.0001") + abs(exact) * mp.mpf(10) ** -80
            assert float(found.rad()) <= 1e-45 * (1 + abs(float(exact)))


def test_structure_stays_exact():
    with digits(30):
        f = balls.ball_arithmetic()

        def value(text):
            return balls.fraction(parse(text).evaluate({"x": ball(Fraction(3, 10))}, f))

        assert value("cos(pi/2)") == 0
        assert value("sin(3*pi/2)") == -1
        assert value("sin(30*deg)*2 - 1") == 0
        assert value("0.1 + 0.2 - x") == 0
        assert value("sqrt(x*x)") == Fraction(3, 10)
        assert value("cos(0.5*pi + pi)*exp(x)") == 0
        assert value("exp(x)") is None


def test_units_are_exact():
    f = balls.ball_arithmetic()
    with digits(30):
        for name, (factor, _) in UNITS.items():
            assert float(exact_factor(name, f)) == pytest.approx(factor, rel=1e-15)
        assert balls.fraction(exact_factor("kg*mm^2/ms", f)) == Fraction(1, 1000)
        assert balls.fraction(exact_factor("N*m/(mm/s)", f)) == 1000


def test_a_certificate_reads_units_in_brackets():
    text = """
mbstab: 1
parameters: {c: {value: 0.1, unit: N*m/(deg/s)}}
bodies: {disk: {type: planar, mass: 1, inertia: 1}}
joints: {pin: {type: revolute, between: [disk, ground]}}
forces: {bearing: {type: expression, on: {disk.theta: -c*rate(disk.theta)}}}
reference: {coordinates: {disk: {theta: 0}}}
"""
    slow = next(e for e in mbstab.loads(text).certify().eigenvalues if e.kind == "left")
    assert float(slow.real.mid()) == pytest.approx(-18.0 / math.pi, rel=1e-14)


def test_a_kink_or_a_hole_has_no_enclosure():
    with digits(30):
        f, wide = balls.ball_arithmetic(), arb(0, 1)
        for function in (f.sqrt, f.log, f.signum, f.abs_slope, f.smooth_start):
            with pytest.raises(ValueError, match=r"."):
                function(wide)


def polynomial(roots):
    with digits(40):
        p = [ball(1)]
        for root in roots:
            p = ball_polynomials.product(p, [ball(-root), ball(1)])
        return p


def test_roots_are_inside_their_discs_and_counted_on_both_sides():
    rng = random.Random(5)
    for _ in range(30):
        roots = [Fraction(rng.randint(-60, 60), 7) or Fraction(1) for _ in range(rng.randint(1, 7))]
        p = polynomial(roots)
        with digits(40):
            discs = ball_polynomials.root_discs(p)
            assert sum(count for _, _, count in discs) == len(roots)
            for root in roots:
                assert any(not abs(real(ball(root)) - centre) > radius for centre, radius, _ in discs)
            right = ball_polynomials.right_roots(p)
            assert right is None or right == sum(root > 0 for root in roots)
            good = ball_polynomials.all_negative_and_simple(p)
            assert good is None or good == (all(root < 0 for root in roots) and len(set(roots)) == len(roots))


def test_characteristic_polynomials_of_all_sizes():
    rng = np.random.default_rng(2)
    for n in (1, 2, 5, 8):
        A = rng.integers(-4, 5, (n, n))
        expected = np.poly(A)[::-1]
        with digits(30):
            for wrapped in (lambda x: ball(int(x)), lambda x: arb(int(x), 1e-20)):
                p = ball_polynomials.characteristic(np.frompyfunc(wrapped, 1, 1)(A))
                assert np.allclose([float(x) for x in p], expected, atol=1e-6)


def test_krawczyk_proves_a_root_and_refuses_where_there_is_none():
    with digits(40):
        ((x,), _) = krawczyk_boxes(lambda x: x * x - 2, lambda x: 2 * x[None], matrix([1.4]), "the root")
        assert x.overlaps(arb(2).sqrt())
        assert float(x.rad()) < 1e-40
        with pytest.raises(NotProvable, match="the root is not proven"):
            krawczyk_boxes(lambda x: x * x + 2, lambda x: 2 * x[None], matrix([1.4]), "the root")
        with pytest.raises(NotProvable, match="the root is not proven"):
            krawczyk_boxes(lambda x: x * x, lambda x: 2 * x[None], matrix([1e-3]), "the root")


@pytest.mark.parametrize("start", [0.4, 0.8])
def test_a_root_at_a_short_fraction_is_exact(start):
    def root(a):
        a = ball(a)
        rows = [lambda x: (x - a) * (x * x + 1), lambda x: (3 * x * x - 2 * a * x + 1)[None]]
        return krawczyk_boxes(*rows, matrix([start]), "the root")[0][0]

    with digits(40):
        assert root(Fraction(17, 41)) == ball(Fraction(17, 41))
        assert not float(root(Fraction(17, 41)).rad())
        near = root(Fraction(17, 41) + Fraction(1, 10**60))
        assert float(near.rad()) > 0.0


FILTERED = """
mbstab: 1
bodies: {b: {type: planar, mass: 2, inertia: 1}}
joints: {rail: {type: prismatic, between: [b, ground], axis: x}}
forces: {s: {type: joint_spring, joint: rail, stiffness: 30}}
states: {f: {rate: STATE}, g: {rate: (f - 2*g)/0.2}}
reference: {coordinates: {b: {x: 0, y: 0, theta: 0}, f: 0, g: 0}}
"""


@pytest.mark.parametrize(
    ("rate", "verdict"),
    [
        ("(b.x - f)/0.1", "stable"),
        ("(b.x**3 - f)/0.1", "stable"),
        ("b.x", "stable up to symmetry"),
        ("(b.x + f)/0.1", "unstable"),
        ("b.x - 5*g", "stable"),
    ],
)
def test_states_that_only_follow_and_decay_take_nothing_from_a_minimum(rate, verdict):
    certificate = mbstab.loads(FILTERED.replace("STATE", rate)).certify()
    assert (certificate.verdict, certificate.proven) == (verdict, True)
    if verdict == "stable":
        assert any(
            "of what the state f and the state g only follow has a strict minimum" in note for note in certificate.notes
        )


def test_a_drive_whose_rate_is_a_multiple_of_pi_is_proven():
    """Times such a multiple, the time with its derivatives is none."""
    model = """
mbstab: 1
parameters: {Omega: {value: 30, unit: rpm}}
bodies: {one: {type: planar, mass: 1, inertia: 1}, two: {type: planar, mass: 1, inertia: 1}}
joints: {a: {type: revolute, between: [one, ground]}, b: {type: revolute, between: [two, one]}}
drives: {turn: {type: joint, joint: a, position: Omega*t}}
forces: {b: {type: joint_spring, joint: b, stiffness: 3}}
reference: {rates: {one: {theta: Omega}, two: {theta: Omega}}}
"""
    assert mbstab.loads(model).certify().proven


def test_decimal_strings_cover_their_rounding():
    with digits(50):
        x = arb(1) / 3
        text = decimals(x, 10)
        assert abs(Fraction(text["midpoint"]) - Fraction(1, 3)) <= Fraction(text["radius"])
    assert decimals(arb(0), 10) == {"midpoint": "0", "radius": "0"}
    assert decimals(arb(-250), 10)["midpoint"] == "-2.5e+2"


# --- command line ---------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["eig", *arguments])


def test_the_command_prints_what_is_proven():
    found = run("whipple_bicycle.yaml", "--certify", "--set", "v=5")
    assert found.exit_code == 0
    flat = " ".join(found.output.split())
    assert (
        "Proven asymptotically stable up to symmetry (the position along x and y, the angles rear_wheel.psi and "
        "front_wheel.psi, the angle about z and the speed), provided that the reference satisfies"
    ) in flat
    assert "4 eigenvalues to the left" in flat
    assert "assumed:" in found.output


def test_the_command_as_json():
    found = run("pendulum.yaml", "--certify", "--format", "json", "--precision", "30")
    data = json.loads(found.stdout)
    assert data["proven"]
    assert Fraction(data["eigenvalues"][0]["imag"]["radius"]) < Fraction(1, 10**28)
    named = {key: data[key] for key in ("model", "title")}
    assert data == named | json.loads(json.dumps(certificate_data(mbstab.load("pendulum.yaml").certify(30), None)))


def test_exit_codes(monkeypatch):
    monkeypatch.setattr("mbstab.analysis.proof.tolerances.Tolerances.interval_parts", 5)
    assert run("top.yaml", "--certify", "--set", "omega=[5,6]").exit_code == 1
    assert run("top.yaml", "--set", "omega=[5,6]").exit_code == 2
    assert run("top.yaml", "--certify", "--frozen").exit_code == 2
    assert run("top.yaml", "--certify", "--precision", "3").exit_code == 2
    assert run("top.yaml", "--certify", "--set", "omega=4", "--require", "marginal").exit_code == 3
    assert run("top.yaml", "--certify", "--require", "marginal").exit_code == 0


def test_real_parts_of_a_stable_system_are_proven_negative():
    result = mbstab.load("wheelset.yaml").certify()
    assert all(e.real < 0 for e in result.eigenvalues)
    assert math.isclose(
        max(float(e.real) for e in result.eigenvalues),
        max(x.value.real for x in mbstab.load("wheelset.yaml").eig().eigenvalues),
        rel_tol=1e-9,
    )


DAMPED = """
mbstab: 1
parameters:
  c: {value: 1, unit: N*s/m}
  d: {value: 3, unit: mm}
  k: {value: 1000, unit: N/m^2}
bodies:
  b: {type: planar_point, mass: 1}
forces:
  s: {type: bearing, between: [b, ground], stiffness: 100, damping: c}
  t: {type: bearing, between: [b, ground], stiffness: k*d}
reference:
  coordinates: {b: {x: 0, y: 0}}
"""


@pytest.mark.parametrize("end", ["1", "3", "0.3", "1e-3", "1/7"])
def test_an_interval_that_begins_at_the_least_value_allowed_is_proven(end):
    result = mbstab.loads(DAMPED).certify(c=f"[0, {end}]")
    assert result.verdict == "stable"
    assert result.parts[0].low == 0
    assert {part.verdict for part in result.parts} == {"stable", "asymptotically stable"}


@pytest.mark.parametrize("end", ["-1", "-1e-9", "-1e-30"])
def test_an_interval_that_begins_below_is_refused_there(end):
    result = mbstab.loads(DAMPED).certify(c=f"[{end}, 1]")
    assert result.verdict == "not provable"
    assert result.parts[0].verdict == "not provable"
    refused = "damping must not be negative, got -" in result.parts[0].reason
    assert (
        refused or Fraction(end) > -1e-12
    )  # so near to zero the verdict of the part is open before its ends are looked at


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0, Fraction(1, 7)), (Fraction(-3, 7), 0), (Fraction(1, 3), 2)])
def test_a_ball_between_two_numbers_ends_at_zero_where_they_do(low, high):
    found = balls.between(balls.ball(low), balls.ball(high))
    assert found.contains(balls.real(balls.ball(low)))
    assert found.contains(balls.real(balls.ball(high)))
    assert (found >= 0) == (low >= 0)
    assert (found <= 0) == (high <= 0)


def test_intervals_are_told_in_the_unit_of_the_parameter(tmp_path):
    path = tmp_path / "damped.yaml"
    path.write_text(DAMPED, encoding="utf-8")
    text = CliRunner().invoke(main, ["eig", str(path), "--certify", "--set", "d=[2, 4]"]).output
    assert re.search(r"d from +to\n +\(mm\) +\(mm\)", text)
    assert re.search(r"^ +2 +4 +asymptotically stable", text, re.M)
    refused = CliRunner().invoke(main, ["eig", str(path), "--certify", "--set", "c=[-1, 1]"])
    assert refused.exit_code == 1
    assert refused.output.lower().count("not provable with") == 1


PIECES = {
    "a kink of abs": ("c*(abs(p)+p)*rate(b.x) - 4*b.x", "-1", "0.5"),
    "abs within a stiffness": ("(abs(p)-p-1)*b.x - rate(b.x)", "-2", "1"),
    "a joint of smooth_start": ("smooth_start(p/0.576)*b.x - 3*rate(b.x)", "-0.5", "0.5"),
    "the end of smooth_start": ("(smooth_start(p)-0.5)*b.x - rate(b.x)", "0.2", "1.5"),
    "the branch of atan2": ("atan2(0*p, 1-p)*b.x - rate(b.x)", "-1", "2"),
    "a root of a square": ("(p - sqrt(p**2) + 1)*b.x - rate(b.x)", "-2", "1"),
    "a removable pole": ("-(p/p)*b.x - rate(b.x)", "-2", "2"),
    "a power of a square": ("(p - (p**2)**0.5 + 1)*b.x - rate(b.x)", "-2", "1"),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("name", sample(PIECES, 3))
def test_what_is_proven_over_an_interval_holds_on_both_sides_of_a_kink(name):
    force, low, high = PIECES[name]
    model = mbstab.loads(
        "mbstab: 1\nparameters: {p: 0.3, c: 1}\n"
        "bodies: {b: {type: planar_point, mass: 1}}\n"
        "joints: {l: {type: point_on_line, between: [ground, b], axis: x}}\n"
        f'forces: {{f: {{type: expression, on: {{b.x: "{force}"}}}}}}\n'
        "reference: {coordinates: {b: {x: 0, y: 0}}}\n"
    )
    certificate = model.certify(p=f"[{low},{high}]")
    proven = [part for part in certificate.parts if part.verdict != "not provable"]
    assert proven
    for part in proven:
        for k in range(5):
            p = float(part.low) + (float(part.high) - float(part.low)) * k / 4
            word = model.eig(p=p).verdict
            assert part.verdict in STRENGTH[word] or word == "undecided", (p, part.verdict, word)
    assert "a removable" not in name or certificate.verdict == "not provable"
