"""Tyres with the Magic Formula: published forces, the linear tyre at small slip, and cars in steady turns."""

import mpmath
import numpy as np
import pytest

import mbstab
from mbstab.compiler.kernels import planar_magic_aligning_moment, planar_magic_tyre
from mbstab.errors import ModelFileError, NumericalError
from mbstab.model.arithmetic import mpmath_arithmetic

CAR = """\
mbstab: 1
title: Car on tyres with the Magic Formula, seen from above
parameters:
  {{u: {{value: 10, unit: m/s}}, a: 1.189, b: 1.696, I: 3508, t_p: 0.03, sigma: 0.5, steer: 0,
   m: 16975/9.81, F_f: 4, F_r: 4}}
bodies:
  car: {{type: planar, mass: m, inertia: I, points: {{front: [a, 0], rear: [-b, 0]}}}}
forces:
  front: {{type: tyre, at: car.front, along: [cos(steer), sin(steer)], trail: t_p, {front}{more}}}
  rear: {{type: tyre, at: car.rear, trail: t_p, {rear}{more}}}
reference:
  coordinates: {{car: {{x: 0, y: 0, theta: 0}}}}
  rates: {{car: {{x: u}}}}
"""
CORNERING = "cornering_stiffness: 1078*sin(1.82*atan(0.208*{0}))/deg"
BAKKER = CORNERING + ", peak: (1011 - 22.1*{0})*{0}, shape_factor: 1.3, curvature_factor: 0.707 - 0.354*{0}"


def car(law, more=""):
    """Return the text of a car whose tyres depend on the loads F_f and F_r (kN)."""
    return CAR.format(front=law.format("F_f"), rear=law.format("F_r"), more=more)


LINEAR, MAGIC = car(CORNERING), car(BAKKER)
RELAXED = car(BAKKER, ", relaxation_length: sigma")


def bakker(load):
    """Return peak, cornering stiffness (N/rad) and curvature factor of a tyre under a load (kN)."""
    D = (1011 - mpmath.mpf("22.1") * load) * load
    K = 1078 * mpmath.sin(mpmath.mpf("1.82") * mpmath.atan(mpmath.mpf("0.208") * load))
    return D, K / mpmath.radians(1), mpmath.mpf("0.707") - mpmath.mpf("0.354") * load


def magic(load, slip):
    """Return the side force over the load (kN), Bakker 1987."""
    D, K, E = bakker(load)
    C = mpmath.mpf("1.3")
    B = K / C / D
    return D * mpmath.sin(C * mpmath.atan((1 - E) * B * slip + E * mpmath.atan(B * slip)))


@pytest.mark.parametrize(
    ("load", "forces"),
    [
        (2, ["676.252311507103", "1197.056401939161", "1828.900014505994", "1932.81947869261"]),
        (4, ["1009.378096087319", "1911.059839057859", "3389.600985092467", "3688.347232805343"]),
        (8, ["1029.932127010582", "2061.016428964508", "4821.906642820278", "6576.224290313273"]),
    ],
)
def test_the_forces_are_those_of_a_published_tyre(load, forces):
    with mpmath.workdps(30):
        D, K, E = bakker(load)
        for degrees, force in zip((1, 2, 5, 10), forces, strict=True):
            slip = mpmath.radians(degrees)
            speeds = [20 * mpmath.cos(slip), -20 * mpmath.sin(slip), 0]
            tyre = [0, 0, 1, 0, K, 0, D, mpmath.mpf("1.3"), E]
            _, found, _ = planar_magic_tyre.dynamics(mpmath_arithmetic(), [0, 0, 0], speeds, tyre, [])
            assert abs(-found - mpmath.mpf(force)) < 1e-11


def test_the_aligning_moments_are_those_of_a_published_tyre():
    """Bakker 1987 under 4 kN; his moments are negative where his side forces are positive."""
    with mpmath.workdps(30):
        load, c = 4, [mpmath.mpf(x) for x in ("-2.72", "-2.28", "-1.86", "-2.73", "0.110", "-0.070", "0.643", "-4.04")]
        D, E = (c[0] * load + c[1]) * load, (c[5] * load + c[6]) * load + c[7]
        K = (c[2] * load + c[3]) * load / mpmath.exp(c[4] * load) / mpmath.radians(1)
        moments = ["-25.6051240834276", "-45.810502265871", "-33.3140884603163", "5.66412427574157"]
        for degrees, moment in zip((1, 2, 5, 10), moments, strict=True):
            slip = mpmath.radians(degrees)
            speeds = [20 * mpmath.cos(slip), 20 * mpmath.sin(slip), 0]
            tyre = [0, 0, 1, 0, -K, -D, mpmath.mpf("2.4"), E]
            (found,) = planar_magic_aligning_moment.dynamics(mpmath_arithmetic(), [0, 0, 0], speeds, tyre, [])
            assert abs(found - mpmath.mpf(moment)) < 1e-12


ALIGNING = (
    ", aligning_stiffness: (1.86*{0} + 2.73)*{0}/exp(0.11*{0})/deg, aligning_peak: (2.72*{0} + 2.28)*{0}, "
    "aligning_shape_factor: 2.4, aligning_curvature_factor: (0.643 - 0.07*{0})*{0} - 4.04"
)


def aligning(load, slip):
    """Return the aligning moment over the load (kN), Bakker 1987, positive to where the wheel goes."""
    D = (mpmath.mpf("2.72") * load + mpmath.mpf("2.28")) * load
    K = (mpmath.mpf("1.86") * load + mpmath.mpf("2.73")) * load / mpmath.exp(mpmath.mpf("0.11") * load)
    E = (mpmath.mpf("0.643") - mpmath.mpf("0.07") * load) * load - mpmath.mpf("4.04")
    x = K / mpmath.radians(1) / mpmath.mpf("2.4") / D * slip
    return D * mpmath.sin(mpmath.mpf("2.4") * mpmath.atan(x - E * (x - mpmath.atan(x))))


@pytest.mark.parametrize("load", [1, 4, 8])
def test_at_small_slip_the_tyre_is_the_linear_one(load):
    one, other = (mbstab.loads(text).eig(F_f=load, F_r=4).values() for text in (MAGIC, LINEAR))
    assert len(one) == len(other) == 2
    for x, y in zip(one, other, strict=True):
        assert abs(x - y) <= 4 * 2.0**-53 * abs(y)


def single_track(steer, loads):
    """Return the wheels of a car: their places, their angles, and their loads (kN) from speed and yaw rate."""
    return [(1.189, 0.0, steer, lambda vx, r: loads[0]), (-1.696, 0.0, 0, lambda vx, r: loads[1])]


def double_track(steer, loads, transfer):
    """Return those of a car whose load moves to the outer wheels with its lateral acceleration."""
    return [
        (x, y, angle, lambda vx, r, own=load / 2, side=y: own - transfer * vx * r * mpmath.sign(side))
        for (x, _, angle, _), load in zip(single_track(steer, loads), loads, strict=True)
        for y in (0.75, -0.75)
    ]


def rates(state, thrust, wheels, relaxed, turned=lambda load, slip: 0):
    """Return the rates of the speeds along and across, of the yaw rate, and of the slips that the forces follow."""
    m, inertia, t, sigma = 16975 / 9.81, 3508, 0.03, 0.5
    vx, vy, r = state[:3]
    force, moment, lags = [thrust, mpmath.mpf(0)], mpmath.mpf(0), []
    for i, (x, y, angle, load) in enumerate(wheels):
        along, across = vx - r * y, vy + r * x
        alpha = mpmath.atan2(across, along) - angle
        slip = state[3 + i] if relaxed else alpha
        side = -magic(load(vx, r), slip)
        push = [-side * mpmath.sin(angle), side * mpmath.cos(angle)]
        force = [force[0] + push[0], force[1] + push[1]]
        moment += x * push[1] - y * push[0] - t * mpmath.cos(alpha) * side + turned(load(vx, r), slip)
        lags.append(mpmath.hypot(along, across) / sigma * (alpha - slip))
    return [force[0] / m + vy * r, force[1] / m - vx * r, moment / inertia, *(lags if relaxed else [])]


def turning(u, wheels, relaxed=False, turned=lambda load, slip: 0):
    """Return the steady state of a car in a turn, its slips, its thrust, and the eigenvalues, from 40 digits."""
    u = mpmath.mpf(u)

    def slips(v, r):
        return [mpmath.atan2(v + r * x, u - r * y) - angle for x, y, angle, _ in wheels]

    def unbalanced(v, r, thrust):
        return rates([u, v, r, *slips(v, r)], thrust, wheels, relaxed, turned)[:3]

    v, r, thrust = mpmath.findroot(unbalanced, (mpmath.mpf("-0.2"), u * wheels[0][2] / 3, 500))
    state = [u, v, r, *(slips(v, r) if relaxed else [])]
    columns = []
    for k in range(len(state)):

        def moved(x, k=k):
            return rates([*state[:k], x, *state[k + 1 :]], thrust, wheels, relaxed, turned)

        h = mpmath.mpf(10) ** -20
        columns.append([(y - x) / (2 * h) for x, y in zip(moved(state[k] - h), moved(state[k] + h), strict=True)])
    return state, slips(v, r), thrust, mpmath.eig(mpmath.matrix(columns).T, left=False, right=False)


def in_a_turn(text, state, thrust, slips, relaxed):
    """Return the text of a car in a steady turn about the origin."""
    u, v, r = map(float, state[:3])
    engine = f"forces:\n  engine: {{type: force, at: car, vector: [{float(thrust)!r}, 0], frame: body}}"
    states = f", front_slip: {float(slips[0])!r}, rear_slip: {float(slips[1])!r}" if relaxed else ""
    return text[: text.index("reference:")].replace("forces:", engine) + (
        f"reference:\n  steady: {{axis: z, rate: {r!r}}}\n"
        f"  coordinates: {{car: {{x: {v / r!r}, y: {-u / r!r}, theta: 0}}{states}}}\n"
        f"  rates: {{car: {{theta: {r!r}}}}}\n"
    )


def found_in(values, expected, part):
    """Whether every one of the expected values is among those found."""
    return all(min(abs(mpmath.mpc(x) - y) for x in values) <= part * abs(y) for y in expected)


@pytest.mark.parametrize(("relaxed", "steer", "loads"), [(False, 0.08, (6, 5)), (True, 0.08, (6, 5))])
def test_a_car_in_a_steady_turn_has_the_eigenvalues_of_its_speeds(relaxed, steer, loads):
    with mpmath.workdps(40):
        state, slips, thrust, expected = turning(12, single_track(steer, loads), relaxed)
        assert max(map(abs, slips)) > 0.03
        text = in_a_turn(RELAXED if relaxed else MAGIC, state, thrust, slips, relaxed)
        found = mbstab.loads(text).eig(F_f=loads[0], F_r=loads[1], steer=steer).values()
        assert len(found) == len(expected)
        assert found_in(found, expected, 1e-13)


def in_space(text):
    """Return the text of the same car in space, on four wheels that do not lift."""
    body = "{type: spatial, mass: m, inertia: [600, 3000, I], points: {front: [a, 0, 0], rear: [-b, 0, 0]}}"
    contacts = """\
contacts:
  front: {type: wheel, center: car.front, axle: [-sin(steer), cos(steer), 0], radius: 0.3, motion: frictionless}
  rear: {type: wheel, center: car.rear, axle: y, radius: 0.25, tube: 0.05, motion: frictionless}
constraints: {upright: {holonomic: car.phi}}
"""
    text = text.replace(text[text.index("{type: planar") : text.index("\nforces:")], body)
    text = text.replace("at: car.front, along: [cos(steer), sin(steer)]", "contact: front").replace(
        "0], frame", "0, 0], frame"
    )
    text = text.replace("at: car.rear", "contact: rear").replace("forces:", contacts + "forces:")
    return text.replace(", theta: 0}", ", z: 0.3, phi: 0, theta: 0, psi: 0}").replace("{theta:", "{psi:")


@pytest.mark.parametrize("relaxed", [False, True])
def test_wheels_on_contacts_in_space_turn_as_those_seen_from_above(relaxed):
    with mpmath.workdps(40):
        state, slips, thrust, expected = turning(12, single_track(0.08, (6, 5)), relaxed)
        text = in_space(in_a_turn(RELAXED if relaxed else MAGIC, state, thrust, slips, relaxed))
        found = mbstab.loads(text).eig(F_f=6, F_r=5, steer=0.08)
        assert found.verdict == "asymptotically stable up to symmetry"
        assert found_in(found.values(), expected, 1e-13)


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("relaxed", [False, True])
def test_a_car_with_aligning_moments_in_a_steady_turn(relaxed, space):
    with mpmath.workdps(40):
        state, slips, thrust, expected = turning(12, single_track(0.08, (6, 5)), relaxed, aligning)
        law = car(BAKKER + ALIGNING, ", relaxation_length: sigma" if relaxed else "")
        text = in_a_turn(law, state, thrust, slips, relaxed)
        found = mbstab.loads(in_space(text) if space else text).eig(F_f=6, F_r=5, steer=0.08)
        assert found.verdict == "asymptotically stable up to symmetry"
        assert found_in(found.values(), expected, 1e-13)


def test_the_car_of_the_examples_spins_beyond_the_fold_of_its_turns():
    """Where the determinant of the speeds across and about the vertical vanishes, in 40 digits."""
    car_turn = mbstab.load("car_turn.yaml")
    certificate = car_turn.certify()
    assert (certificate.status, certificate.verdict) == ("proven", "asymptotically stable up to symmetry")
    (fold,) = car_turn.sweep("steer", np.linspace(0.045, 0.06, 7)).critical
    assert fold.kind == "fold"
    assert fold.value == pytest.approx(0.058443095408922281538, rel=1e-11)


@pytest.mark.parametrize("more", ["", ", relaxation_length: sigma"])
def test_a_linear_aligning_moment_is_that_of_a_trail(more):
    """A car that oversteers without aligning moments and understeers with them: 34 and 38 N m/deg, two tyres each."""
    stiffness = ("cornering_stiffness: 2*1437/deg, ", "cornering_stiffness: 2*1507/deg, ")
    moment, trail = (
        CAR.format(front=stiffness[0] + front, rear=stiffness[1] + rear, more=more).replace("trail: t_p, ", "")
        for front, rear in (
            ("aligning_stiffness: 2*34/deg", "aligning_stiffness: 2*38/deg"),
            ("trail: 34/1437", "trail: 38/1507"),
        )
    )
    given = {"a": 1.473, "b": 1.403, "I": 2600, "m": 1914, "u": 22.8}
    one, other = (mbstab.loads(x).eig(**given).values() for x in (moment, trail))
    assert found_in(one, other, 1e-13)
    if not more:
        assert found_in(one, [mpmath.mpf("-8.746606641521675"), mpmath.mpf("-10.75152792012992")], 1e-13)


def test_aligning_moments_are_enclosed_and_simulated():
    model = mbstab.loads(car(BAKKER + ALIGNING))
    values = [x.value for x in model.eig().eigenvalues if x.kind != "neutral"]
    enclosed = [complex(float(x.real), float(x.imag)) for x in model.certify().eigenvalues]
    assert len(values) == 2
    assert found_in(enclosed, values, 1e-13)
    run = model.simulate(to=0.2, points=3, perturb={"rate(car.y)": 1.0})
    assert run.energy_drift < 1e-8 * max(run.kinetic)


TRACKS = """\
mbstab: 1
title: Car on four tyres whose loads follow the lateral acceleration, seen from above
parameters:
  {u: {value: 12, unit: m/s}, steer: 0.08, F_f: 6, F_r: 5, transfer: 0.2, a: 1.189, b: 1.696, sigma: 0.5}
definitions:
  moved: transfer*vx(car)*rate(car.theta)
bodies:
  car:
    {type: planar, mass: 16975/9.81, inertia: 3508,
     points: {fl: [a, 0.75], fr: [a, -0.75], rl: [-b, 0.75], rr: [-b, -0.75]}}
forces:
reference:
"""


def double_track_text():
    text = TRACKS
    for name, load in (
        ("fl", "F_f/2 - moved"),
        ("fr", "F_f/2 + moved"),
        ("rl", "F_r/2 - moved"),
        ("rr", "F_r/2 + moved"),
    ):
        along = "along: [cos(steer), sin(steer)], " if name[0] == "f" else ""
        tyre = f"  {name}: {{type: tyre, at: car.{name}, {along}trail: 0.03, {BAKKER.format(f'({load})')}}}\n"
        text = text.replace("reference:", f"{tyre}reference:")
    return text


def test_loads_may_follow_the_motion():
    """In a turn the outer wheels carry more, and the loads change with the disturbance too."""
    with mpmath.workdps(40):
        state, slips, thrust, expected = turning(12, double_track(0.08, (6, 5), 0.2))
        found = mbstab.loads(in_a_turn(double_track_text(), state, thrust, slips, False)).eig().values()
        assert len(found) == len(expected)
        assert found_in(found, expected, 1e-12)
        held = double_track_text().replace("vx(car)*rate(car.theta)", repr(float(state[0] * state[2])))
        held = mbstab.loads(in_a_turn(held, state, thrust, slips, False)).eig().values()
        assert not found_in(held, expected, 1e-3)


@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("change", [str, in_space])
def test_loads_that_follow_the_motion_count_in_space_and_with_relaxation(relaxed, change):
    text = (RELAXED if relaxed else MAGIC).replace("*F_f", "*(F_f - 2*rate(car.theta))")
    with mpmath.workdps(40):
        front, rear = single_track(0.08, (6, 5))
        wheels = [(*front[:3], lambda vx, r: 6 - 2 * r), rear]
        state, slips, thrust, expected = turning(12, wheels, relaxed)
        text = change(in_a_turn(text, state, thrust, slips, relaxed))
        if change is in_space:
            text = text.replace("rate(car.theta)", "wz(car)")
        found = mbstab.loads(text).eig(F_f=6, F_r=5, steer=0.08)
        assert found.verdict == "asymptotically stable up to symmetry"
        assert found_in(found.values(), expected, 1e-12)


def test_a_wheel_without_load_is_refused():
    text = MAGIC.replace("*F_f,", "*(F_f - rate(car.theta)),").replace(
        "rates: {car: {x: u}}", "rates: {car: {x: u, theta: 5}}"
    )
    with pytest.raises(NumericalError) as caught:
        mbstab.loads(text).system().dynamics([0.0, 0.0, 0.0], [10.0, 0.0, 5.0])
    why = "a function has no real value there; peak must stay positive"
    assert f"<text>:9:10: forces.front has no finite equations here ({why})" in str(caught.value)


def test_a_simulated_car_loses_the_energy_that_its_tyres_take():
    run = mbstab.loads(MAGIC).simulate(to=0.2, points=3, tol=1e-8, perturb={"car.theta": 0.2})
    energy = run.kinetic + run.potential
    assert run.work[-1] < -100.0
    assert energy - run.work == pytest.approx(energy[0], rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("peak: (", "peak: -(", "146: forces.front.peak: peak must be positive, got -3690.4 N"),
        ("factor: 1.3", "factor: 2.1", "183: forces.front.shape_factor: shape factor must be at most 2, got 2.1"),
        ("factor: 1.3", "factor: 0", "183: forces.front.shape_factor: shape factor must be positive, got 0"),
        (
            "0.707 - 0.354*F_f",
            "1.01",
            "206: forces.front.curvature_factor: curvature factor must be at most 1, got 1.01",
        ),
        (", shape_factor: 1.3", "", "10: forces.front.peak: the key 'shape_factor' is missing"),
        ("peak: (1011 - 22.1*F_f)*F_f, ", "", "10: forces.front.shape_factor: the key 'peak' is missing"),
    ],
)
def test_bad_coefficients_are_refused(old, new, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(MAGIC.replace(old, new, 1)).eig()
    assert str(caught.value).startswith(f"<text>:9:{message}")
