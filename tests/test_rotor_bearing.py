"""Bearings of rotors with eight coefficients: a rigid rotor on two of them against closed forms and its matrices."""

import json
import math
from decimal import Decimal

import numpy as np
import pytest
from chains import spinning_chain
from click.testing import CliRunner
from scipy.interpolate import PchipInterpolator

import mbstab
from mbstab.cli.main import main
from mbstab.errors import Location, ModelFileError
from mbstab.model.arithmetic import FLOAT
from mbstab.model.schema import TableValue

# Uniform, 0.5 m long, 0.2 m thick, 7810 kg/m^3.
ROTOR = """\
mbstab: 1
parameters: {{rho: 7810, L: 0.5, D: 0.2, Omega: {{value: {speed}, unit: rad/s}}, k: 1e6, c: 0, q: 0}}
bodies:
  rotor:
    type: spatial
    mass: rho*pi*D**2/4*L
    shape: {{type: cylinder, radius: D/2, length: L}}
    points: {{A: [0, 0, -L/2], B: [0, 0, L/2]}}
ground: {{points: {{A: [0, 0, -L/2], B: [0, 0, L/2]}}}}
joints: {{thrust: {{type: point_on_plane, between: [rotor, ground], axis: z}}}}
forces:
  A: {{type: rotor_bearing, between: [rotor.A, ground.A], {A}}}
  B: {{type: rotor_bearing, between: [rotor.B, ground.B], {B}}}
reference:
  coordinates: {{rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{rotor: {{psi: Omega}}}}
"""
EQUAL = "kxx: k, kyy: k"
WHIRL = "kxx: k, kyy: k, kxy: q, kyx: -q, cxx: c, cyy: c"
m, I_d, I_p, L = 122.679193122681426, 2.86251450619589994, 0.61339596561340713, 0.5
RPM = 2 * math.pi / 60


def rotor(A=EQUAL, B=EQUAL, speed=0.0):
    return mbstab.loads(ROTOR.format(A=A, B=B, speed=speed))


def upper(found):
    """Return the eigenvalues above the real axis, by imaginary part."""
    return sorted((e.value for e in found.eigenvalues if e.value.imag > 0.0), key=lambda s: s.imag)


def matrices(K, C, omega):
    """Return the eigenvalues of the four equations of motion in x, y of the middle and the slopes of both."""
    n = np.zeros((2, 2))
    T = [np.block([np.eye(2), z * np.eye(2)]) for z in (-L / 2, L / 2)]
    stiffness, damping = (sum(t.T @ x @ t for t, x in zip(T, pair, strict=True)) for pair in (K, C))
    damping[2:, 2:] += I_p * omega * np.array([[0, 1], [-1, 0]])
    inverse = np.diag([1 / m, 1 / m, 1 / I_d, 1 / I_d])
    Z = np.block([[n, n], [n, n]])
    return np.linalg.eigvals(np.block([[Z, np.eye(4)], [-inverse @ stiffness, -inverse @ damping]]))


@pytest.mark.parametrize(
    ("rpm", "conical"),
    [
        (0, [208.9686602731978] * 2),
        (4000, [168.8538317121584, 258.6136218147239]),
        (20000, [82.23226718348597, 531.0312176963136]),
    ],
)
def test_a_rigid_rotor_on_equal_bearings_whirls_backward_and_forward(rpm, conical):
    found = rotor(speed=rpm * RPM).eig()
    translation = [math.sqrt(2e6 / m)] * 2
    np.testing.assert_allclose([s.imag for s in upper(found)], sorted([*translation, *conical]), rtol=1e-12)
    assert all(s.real == 0.0 for s in upper(found))


@pytest.mark.parametrize(
    ("A", "B", "expected"),
    [
        (EQUAL, "kxx: 1.3*k, kyy: 1.3*k", [134.0016537067822, 135.587903835689, 185.8712193266342, 274.0447593002928]),
        (
            "kxx: 1.0*k, kyy: 1.5*k",
            "kxx: 1.3*k, kyy: 2.0*k",
            [134.9123312276425, 165.5850036774177, 204.8381938751225, 307.2345965398704],
        ),
    ],
)
def test_unequal_and_anisotropic_bearings_split_the_frequencies(A, B, expected):
    found = rotor(A, B, 4000 * RPM).eig()
    np.testing.assert_allclose([s.imag for s in upper(found)], expected, rtol=1e-12)


def test_eight_coefficients_of_two_bearings_have_the_eigenvalues_of_their_matrices():
    A = "kxx: 1e6, kxy: 2e5, kyx: -3e5, kyy: 1.4e6, cxx: 2e3, cxy: -300, cyx: -300, cyy: 2.5e3"
    B = "kxx: 1.3e6, kxy: 1e5, kyx: -2e5, kyy: 1.6e6, cxx: 1.5e3, cxy: -200, cyx: -200, cyy: 3e3"
    found = rotor(A, B, 300.0).eig()
    printed = [
        -9.71478675327962 + 140.9113642271649j,
        -28.28138224560473 + 149.5328357673775j,
        -54.14184119797078 + 206.0294316139652j,
        -42.79580382014412 + 268.8436618185044j,
    ]
    np.testing.assert_allclose(upper(found), printed, rtol=1e-12)
    K = [np.array([[1e6, 2e5], [-3e5, 1.4e6]]), np.array([[1.3e6, 1e5], [-2e5, 1.6e6]])]
    C = [np.array([[2e3, -300], [-300, 2.5e3]]), np.array([[1.5e3, -200], [-200, 3e3]])]
    expected = matrices(K, C, 300.0)
    for e in found.eigenvalues:
        if e.value.imag:
            assert np.min(np.abs(expected - e.value)) < e.error_bound + 1e-13 * abs(e.value)
    assert found.verdict == "asymptotically stable up to symmetry"


def test_cross_coupling_drives_forward_whirl_beyond_its_limit():
    """q > c sqrt(2k/m) makes the translation unstable, at its frequency."""
    limit = 2e3 * math.sqrt(2e6 / m)
    swept = rotor(WHIRL, WHIRL).sweep("q", np.linspace(2.4e5, 2.8e5, 3), c=2e3)
    (critical,) = swept.critical
    assert critical.value == pytest.approx(limit, rel=1e-11)
    assert critical.value == pytest.approx(255363.92095345074414, rel=1e-11)
    assert critical.frequency == pytest.approx(127.6819604767254, rel=1e-11)


def test_the_axes_of_the_housing_turn_the_coefficients():
    K = "kxx: 1e6, kxy: 2e5, kyx: -3e5, kyy: 1.4e6, cxx: 2e3, cxy: -300, cyx: 100, cyy: 2.5e3"
    turned = "zero: y, kxx: 1.4e6, kxy: 3e5, kyx: -2e5, kyy: 1e6, cxx: 2.5e3, cxy: -100, cyx: 300, cyy: 2e3"
    one, other = (rotor(A, EQUAL, 100.0).eig() for A in (K, turned))
    np.testing.assert_allclose(upper(one), upper(other), rtol=1e-12)


def test_a_bearing_between_a_rotor_and_a_moving_stator_acts_on_both():
    """Stator m_s on springs k_s, both in the plane: translation as z = x + iy of two masses."""
    text = """\
mbstab: 1
bodies:
  rotor: {type: planar, mass: 3, inertia: 0.1}
  stator: {type: planar, mass: 5, inertia: 0.2}
forces:
  film: {type: rotor_bearing, between: [rotor, stator], kxx: 4e3, kyy: 4e3, kxy: 900, kyx: -900, cxx: 20, cyy: 20}
  mount: {type: bushing, between: [stator, ground], stiffness: [9e3, 9e3], torsional_stiffness: 100}
"""
    found = mbstab.loads(text).eig()
    # m z'' + c w' + (k - iq) w = 0 and m_s z_s'' - c w' - (k - iq) w + k_s z_s = 0 with w = z - z_s.
    k = 4e3 - 900j
    expected = np.roots(np.polyadd(np.polymul([3, 20, k], [5, 20, k + 9e3]), -np.polymul([20, k], [20, k])))
    expected = np.concatenate([expected, np.conj(expected), [1j * math.sqrt(500), -1j * math.sqrt(500)]])
    for e in found.eigenvalues:
        if e.value:
            assert np.min(np.abs(expected - e.value)) < 1e-12 * abs(e.value)
    assert sum(e.value != 0 for e in found.eigenvalues) == 10


def test_energy_that_a_film_gives_to_the_rotor_is_told_as_work():
    run = rotor(WHIRL, WHIRL, 100.0).simulate(0.02, points=3, tol=1e-7, perturb={"rotor.x": 1e-3}, q=3e5, c=2e3)
    energy = run.kinetic + run.potential
    np.testing.assert_allclose(energy - run.work, energy[0], rtol=1e-8)
    assert abs(run.work[-1]) > 1e-3


PLANE = """\
mbstab: 1
gravity: [0, -10]
bodies: {rotor: {type: planar, mass: 3, inertia: 0.1}}
forces: {film: {type: rotor_bearing, between: [rotor, ground], kxx: 4e3, kyy: 5e3, COUPLING}}
constraints: {level: {holonomic: rotor.theta}}
reference: {find: equilibrium}
"""


def jeffcott(coupling):
    return mbstab.loads(PLANE.replace("COUPLING", coupling))


def test_a_bearing_transmits_the_weight_and_shifts_the_rotor_across_it():
    (found,) = jeffcott("kxy: 1e3, kyx: -2e3").equilibria()
    x, y = np.linalg.solve([[4e3, 1e3], [-2e3, 5e3]], [0, -30])
    np.testing.assert_allclose(found.motion.q, [x, y, 0], rtol=1e-12, atol=1e-15)
    reaction = next(r for r in found.reactions if r.owner == "force 'film'")
    np.testing.assert_allclose(reaction.force, [0, 30], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("coupling", ["cxx: 50, cyy: 80", "kxy: 1e3, kyx: -2e3, cxx: 50, cyy: 80, cxy: 9, cyx: 4"])
def test_bearings_are_proven(coupling):
    certified = jeffcott(coupling).certify()
    assert certified.proven
    assert certified.verdict == "asymptotically stable"


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("kxx: k, cxx: -3", r"cxx must .*got -3 N\*s/m"),
        ("kxx: k, axis: z, zero: z", "zero must not be along the axis"),
        ("kx: k", "unknown key 'kx'"),
    ],
)
def test_bad_bearings_are_refused(entry, message):
    with pytest.raises(ModelFileError, match=message):
        rotor(entry).eig()


@pytest.mark.parametrize("spin", [0.0, 400.0])
def test_a_bushing_in_the_middle_of_a_shaft_is_a_beam_element(spin):
    """A disc at the end of a cantilever, by the stiffness of the beam: [12, -6L; -6L, 4L²] EI/L³ in x and the slope."""
    m, I_d, I_p, EI, L = 3.0, 0.02, 0.035, 900.0, 0.4
    text = f"""\
mbstab: 1
bodies: {{disc: {{type: spatial, mass: {m}, inertia: [{I_d}, {I_d}, {I_p}], points: {{middle: [0, 0, {-L / 2}]}}}}}}
ground: {{points: {{middle: [0, 0, {L / 2}]}}}}
forces:
  shaft:
    type: bushing
    between: [disc.middle, ground.middle]
    stiffness: [{12 * EI / L**3}, {12 * EI / L**3}, 1e6]
    torsional_stiffness: [{EI / L}, {EI / L}, 0]
reference:
  coordinates: {{disc: {{x: 0, y: 0, z: {L}, phi: 0, theta: 0, psi: 0}}}}
  rates: {{disc: {{psi: {spin}}}}}
"""
    # With x + iy and the slope: M q'' - i spin diag(0, I_p) q' + K q = 0.
    K = EI / L**3 * np.array([[12.0, -6.0 * L], [-6.0 * L, 4.0 * L**2]])
    inverse, turning = np.diag([1 / m, 1 / I_d]), np.diag([0.0, I_p])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, 1j * spin * inverse @ turning]])
    expected = np.abs(np.linalg.eigvals(A).imag)
    found = np.array([s.imag for s in upper(mbstab.loads(text).eig())])
    for frequency in expected:
        assert np.min(np.abs(found - frequency)) < 1e-10 * frequency


# --- coefficients over the speed ------------------------------------------------------------------------------------

SPEEDS = [1000.0, 1500.0, 2000.0, 3000.0]
COLUMNS = {
    "kxx": [12.4e6, 12.8e6, 13.0e6, 13.2e6],
    "kxy": [10.7e6, 16.4e6, 22.0e6, 33.2e6],
    "kyx": [-22.1e6, -25.1e6, -29.0e6, -38.1e6],
    "kyy": [10.5e6, 8.8e6, 8.0e6, 7.3e6],
    "cxx": [250e3, 233e3, 225e3, 218e3],
    "cxy": [-120e3, -82e3, -62e3, -42e3],
    "cyx": [-120e3, -82e3, -62e3, -42e3],
    "cyy": [374e3, 295e3, 262e3, 236e3],
}
BETWEEN = {
    "table": lambda y: PchipInterpolator(SPEEDS, y),
    "linear": lambda y: lambda x: np.interp(x, SPEEDS, y),
}
CURVES = "curves: {{file: short.csv, speed: n, function: {function}}}"


def csv(columns=tuple(COLUMNS), unit="rpm"):
    """Return the lines of a file with the coefficients over the speed."""
    rows = zip([x if unit == "rpm" else repr(x * RPM) for x in SPEEDS], *(COLUMNS[c] for c in columns), strict=True)
    return "\n".join([",".join([unit, *columns]), *(",".join(map(str, row)) for row in rows)]) + "\n"


@pytest.mark.parametrize(
    ("column", "rpm", "value", "slope"),
    [
        ("kxx", 1750.0, 12916025.641025641, 397.4358974358974),
        ("kxy", 1750.0, 19206194.6902654867, 11175.22123893805),
        ("kyx", 1750.0, -26953362.1960206338, -7922.144436256448),
        ("kyy", 1750.0, 8327636.36363636364, -1601.454545454545),
        ("kxy", 1100.0, 11848014.1592920354, None),
    ],
)
def test_coefficients_between_the_speeds_of_a_table(column, rpm, value, slope):
    """Monotone cubics with three-point ends (Fritsch, Butland)."""
    x, y = (tuple(map(Decimal, map(str, numbers))) for numbers in (SPEEDS, COLUMNS[column]))
    table = TableValue(x, y, Location("short.csv", 1, 1))
    points = tuple(map(FLOAT.number, table.points("table")))
    assert FLOAT.table(rpm, *points) == pytest.approx(value, rel=1e-15)
    if slope is not None:
        assert FLOAT.hermite1(rpm, *points) == pytest.approx(slope, rel=1e-14)


@pytest.fixture
def turning(tmp_path):
    """Return a function that writes the model with a file of coefficients beside it, and returns its path."""

    def write(lines=None, function="table", n="1750, unit: rpm", **replaced):
        (tmp_path / "short.csv").write_text(csv() if lines is None else lines, encoding="utf-8")
        bearing = replaced.get("bearing", CURVES.format(function=function))
        text = ROTOR.format(A=bearing, B=bearing, speed=0).replace(
            "parameters: {", f"parameters: {{n: {{value: {n}}}, "
        )
        path = tmp_path / "rotor.yaml"
        path.write_text(text.replace("psi: Omega", "psi: n"), encoding="utf-8")
        return path

    return write


def expected(rpm, function):
    """Return the eigenvalues of the equations with the coefficients that another library finds."""
    k = {name: float(BETWEEN[function](y)(rpm)) for name, y in COLUMNS.items()}
    K = np.array([[k["kxx"], k["kxy"]], [k["kyx"], k["kyy"]]])
    C = np.array([[k["cxx"], k["cxy"]], [k["cyx"], k["cyy"]]])
    return np.sort_complex(matrices([K, K], [C, C], rpm * RPM))


@pytest.mark.parametrize(
    ("function", "printed"),
    [
        (
            "table",
            [-40.35651639306624 + 97.00972806346438j, -42.06167193036435 + 95.55852904853415j, -2856.361493394868],
        ),
        (
            "linear",
            [-40.20457963902469 + 96.55810962923567j, -41.88556093315068 + 95.12467321895775j, -2858.830533471389],
        ),
    ],
)
def test_a_rotor_on_bearings_whose_coefficients_depend_on_the_speed(turning, function, printed):
    found = mbstab.load(turning(function=function)).eig()
    values = found.values()
    for value in printed:
        assert np.min(np.abs(values - value)) < 1e-12 * abs(value)
    np.testing.assert_allclose(np.sort_complex(values), expected(1750.0, function), rtol=1e-10)
    assert found.verdict == "asymptotically stable up to symmetry"


@pytest.mark.few(1)
@pytest.mark.parametrize("function", BETWEEN)
def test_the_speed_is_swept_from_end_to_end_and_what_is_outside_has_no_answer(turning, function):
    mechanism = mbstab.load(turning(function=function))
    speeds = np.array([1000.0, 1100.0, 1500.0, 2300.0, 3000.0])
    swept = mechanism.sweep("n", speeds)
    for rpm, values in zip(speeds, swept.branches, strict=True):
        np.testing.assert_allclose(np.sort_complex(values), expected(rpm, function), rtol=1e-9)
    wide = mechanism.sweep("n", [999.0, 1000.0, 3000.0, 3001.0])
    assert wide.unanswered == [0, 3]
    said = "forces.A.curves.speed: the expression has no value here (3001 is outside the table, which goes from 1000"
    assert said in wide.problems[3]


def test_a_speed_outside_is_refused_once_for_each_bearing_at_its_place(turning):
    for rpm in (999.9, 3000.1):
        with pytest.raises(ModelFileError) as caught:
            mbstab.load(turning(n=f"{rpm}, unit: rpm")).eig()
        assert f"({rpm} is outside the table, which goes from 1000 to 3000)" in str(caught.value)
        assert str(caught.value).count("is outside the table") == 2
        assert "a plain number or a parameter without a unit is in rad/s here" in str(caught.value)
        assert "rotor.yaml:12:" in str(caught.value)


def test_derivatives_by_the_speed_know_the_slopes_of_the_coefficients(turning):
    result = CliRunner().invoke(main, ["eig", str(turning()), "--sensitivity", "--format", "json"])
    assert result.exit_code == 0, result.output
    rows = json.loads(result.output)["sensitivity"]["eigenvalues"]
    h = 0.01
    above, below = (expected(1750.0 + x, "table") for x in (h, -h))
    for row in rows:
        value = complex(row["real"], row["imag"])
        k = int(np.argmin(np.abs(above - value)))
        slope = (above[k] - below[k]) / (2 * h)  # by rpm, the unit of the parameter
        assert complex(row["derivatives"]["n"]["real"], row["derivatives"]["n"]["imag"]) == pytest.approx(
            slope, rel=1e-5
        )


def test_where_two_lines_meet_eigenvalues_exist_and_derivatives_by_the_speed_do_not(turning):
    path = turning(function="linear", n="1500, unit: rpm")
    np.testing.assert_allclose(np.sort_complex(mbstab.load(path).eig().values()), expected(1500.0, "linear"), rtol=1e-9)
    result = CliRunner().invoke(main, ["eig", str(path), "--sensitivity"])
    assert result.exit_code == 2
    assert "two lines of the table meet at 1500" in result.output


@pytest.mark.few(1)
@pytest.mark.parametrize("function", ["table", "linear"])
def test_eigenvalues_over_the_speed_are_proven_and_computed_to_many_digits(turning, function):
    mechanism = mbstab.load(turning(function=function))
    values = np.sort_complex([complex(x) for x in mechanism.eig_precise(25).values()])
    np.testing.assert_allclose(values, np.sort_complex(mechanism.eig().values()), rtol=1e-12)
    assert mechanism.certify().verdict == "asymptotically stable up to symmetry"


def test_a_file_in_rad_per_second_with_missing_columns_given_by_keys(turning):
    lines = csv([c for c in COLUMNS if c not in ("cxy", "cyx")], "rad/s")
    path = turning(lines, bearing="cxy: 0, cyx: -7e4, " + CURVES.format(function="table"))
    values = mbstab.load(path).eig().values()
    written = ", ".join(
        f"{c}: {float(PchipInterpolator(SPEEDS, y)(1750.0))!r}" for c, y in COLUMNS.items() if c not in ("cxy", "cyx")
    )
    plain = turning(bearing=f"cxy: 0, cyx: -7e4, {written}")
    np.testing.assert_allclose(np.sort_complex(values), np.sort_complex(mbstab.load(plain).eig().values()), rtol=1e-11)


@pytest.mark.parametrize(
    ("lines", "bearing", "message"),
    [
        (csv().replace("rpm", "speed"), "", "short.csv: its first column is 'speed'"),
        (csv().replace("kxy", "kxz"), "", "short.csv: it has a column 'kxz'"),
        (csv().replace("kxy", "kxx"), "", "short.csv: it has two columns 'kxx'"),
        (csv(list(COLUMNS)[:-1]), "", "short.csv: it has no column 'cyy'"),
        (csv(), "kxx: 1e6, ", "short.csv: it has a column 'kxx', and the entry gives it too"),
        (csv().replace("1500.0", "900"), "", "short.csv:3:1: forces.A.curves.file: x must increase"),
        (csv().replace("13000000.0", "much"), "", "'much' is not a number"),
        (csv().replace("13000000.0", "13000000.0,9"), "", "this line has 10 values, and the heading 9 names"),
        (csv().replace(",", ";").replace("13000000.0", "1,3e7"), "", "decimals follow a point: 1.3e7"),
        ("rpm,kxx\n", "", "short.csv has no numbers"),
        (csv(), "rho", "forces.A.curves.speed: 'rho' has the unit kg/m^3"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(turning, lines, bearing, message):
    wrong = CURVES.format(function="table")
    path = turning(lines, bearing=wrong.replace("speed: n", "speed: rho") if bearing == "rho" else bearing + wrong)
    text = path.read_text(encoding="utf-8").replace("rho: 7810", "rho: {value: 7810, unit: kg/m^3}")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelFileError) as caught:
        mbstab.load(path)
    assert message in str(caught.value)


@pytest.mark.few(3)
@pytest.mark.parametrize(("rate", "spin"), [("0", "0"), ("n/2", "91.6298"), ("n", ""), ("-n", "-183.26")])
def test_a_rotor_that_does_not_turn_at_the_speed_of_its_curves_is_told(turning, rate, spin):
    path = turning()
    path.write_text(path.read_text(encoding="utf-8").replace("psi: n", f"psi: {rate}"), encoding="utf-8")
    said = f"curves of force 'A' and force 'B' are read at 183.26 rad/s, and 'rotor' turns at {spin} rad/s"
    expected = [said + " about the axis" * (rate == "-n")] if spin else []
    for warnings in (
        mbstab.load(path).eig().warnings,
        mbstab.load(path).sweep("n", [183.259571, 190.0], si=True).warnings,
    ):
        assert [x.split("\n")[0].removeprefix("the ") for x in warnings] == expected


@pytest.mark.parametrize(
    ("axis", "rate", "told"), [("z", "n", False), ("z", "-n", True), ("-z", "n", True), ("-z", "-n", False)]
)
def test_coefficients_that_couple_turn_with_the_shaft(turning, axis, rate, told):
    """Turned about the other sense of the axis an oil film is another one; one that couples nothing is the same."""
    straight = "rpm,kxx,kxy,kyx,kyy,cxx,cxy,cyx,cyy\n1500,1e7,0,0,2e7,1,0,0,1\n2000,1.1e7,0,0,2.1e7,1,0,0,1\n"
    for columns in (csv(), straight):
        path = turning(columns, bearing=f"axis: {axis}, " + CURVES.format(function="table"))
        path.write_text(path.read_text(encoding="utf-8").replace("psi: n", f"psi: {rate}"), encoding="utf-8")
        assert bool(mbstab.load(path).eig().warnings) == (told and columns == csv())


def test_a_point_mass_has_no_spin_to_compare(turning):
    path = turning()
    text = path.read_text(encoding="utf-8")
    text = text[: text.index("bodies:")] + "bodies: {rotor: {type: planar_point, mass: 3}}\n"
    text += "forces: {A: {type: rotor_bearing, between: [rotor, ground], " + CURVES.format(function="table") + "}}\n"
    path.write_text(text, encoding="utf-8")
    assert mbstab.load(path).eig().warnings == ()


def test_damping_that_becomes_negative_between_points_is_refused(turning):
    lines = csv().replace("262000.0", "0").replace("236000.0", "0")
    path = turning(lines, function="spline", n="2500, unit: rpm")
    with pytest.raises(ModelFileError, match="cyy must not be negative, got -"):
        mbstab.load(path).eig()


def test_several_speeds_of_curves_are_told_at_once(turning):
    path = turning()
    text = path.read_text(encoding="utf-8").replace("psi: n", "psi: 0")
    start = text.index("  B:")
    path.write_text(text[:start] + text[start:].replace("speed: n", "speed: 2*n/3", 1), encoding="utf-8")
    (told,) = mbstab.load(path).eig().warnings
    assert told.startswith(
        "the curves of force 'A' are read at 183.26 rad/s, and 'rotor' turns at 0 rad/s; those of force 'B' are "
    )
    assert "read at 122.173 rad/s" in told
    assert told.count("hint: ") == 1


def test_a_sweep_passes_values_at_which_coefficients_vanish():
    # Without cross-coupled coefficients a bearing is springs and dampers along its axes, another element.
    text = """\
mbstab: 1
parameters: {q: 0}
gravity: [0, 0]
bodies: {a: {type: planar, mass: 1, inertia: 1}}
constraints: {turn: {holonomic: a.theta}}
forces:
  b: {type: rotor_bearing, between: [a, ground], kxx: 100, kyy: 100, kxy: q, kyx: -q, cxx: 2, cyy: 2}
"""
    model = mbstab.loads(text)
    for values in ([0, 5], [5, 0], [0, 5, 30]):
        found = model.sweep("q", values)
        for q, word, branches in zip(values, found.verdicts, found.branches, strict=True):
            one = model.eig(q=q)
            assert word == one.verdict
            assert np.sort_complex(branches) == pytest.approx(np.sort_complex([e.value for e in one.eigenvalues]))


def test_what_a_zero_belongs_to_has_the_same_name_at_all_speeds():
    # The energy and the momentum of the spin tell the same motions apart; rounding chose between their names.
    model = mbstab.loads(spinning_chain(1, damping=0))
    found = {model.eig(Omega=speed).neutral_directions for speed in (10, 30, 70, 100, 183.26, 250, 333, 471)}
    assert found == {("s1.phi", "s1.psi", "motion of s1", "speed of s1.psi")}
