"""Tyres: vehicles against closed forms, at rest, in steady turns and in space; the Magic Formula as published."""

import mpmath
import numpy as np
import pytest
from mpmath_numbers import mpmath_arithmetic
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import mbstab
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.compiler.kernels import planar_magic_aligning_moment, planar_magic_tyre
from mbstab.errors import ModelFileError, NumericalError

CAR = """\
mbstab: 1
title: Car on tyres, seen from above
parameters:
  {{u: {{value: 10, unit: m/s}}, a: 1.189, b: 1.696, C: 80000, m: 16975/9.81, I: 3508, t_f: 0, t_r: 0, sigma: 0.5}}
bodies:
  car: {{type: planar, mass: m, inertia: I, points: {{front: [a, 0], rear: [-b, 0]}}}}
forces:
  front: {{type: tyre, at: car.front, cornering_stiffness: C, trail: t_f{more}}}
  rear: {{type: tyre, at: car.rear, cornering_stiffness: C, trail: t_r{more}}}
reference:
  coordinates: {{car: {{x: 0, y: 0, theta: 0}}}}
  rates: {{car: {{x: u}}}}
"""
STIFF = CAR.format(more="")
RELAXED = CAR.format(more=", relaxation_length: sigma")
TRAILS = {"t_f": 0.04, "t_r": 0.03}


def moving(found):
    """Return the eigenvalues that are not zero, those above the real axis and on it."""
    return sorted((s for s in found.values() if s.imag >= 0.0 and abs(s) > 1e-9), key=lambda s: (s.real, s.imag))


def close(found, expected, part=1e-12):
    """Whether eigenvalues are those expected, those above the real axis and on it."""
    expected = sorted(expected, key=lambda s: (np.real(s), np.imag(s)))
    assert len(found) == len(expected)
    return all(abs(x - y) <= part * abs(y) for x, y in zip(found, expected, strict=True))


@pytest.mark.parametrize(
    ("u", "expected", "with_trails"),
    [
        (10, -9.515101897115451 + 2.963081825535182j, -9.518887529954675 + 3.162273401487833j),
        (20, -4.757550948557725 + 3.296448275024203j, -4.759443764977338 + 3.516939638107643j),
        (30, -3.171700632371817 + 3.354549204317407j, -3.172962509984892 + 3.578763473863356j),
    ],
)
def test_a_car_on_tyres(u, expected, with_trails):
    car = mbstab.loads(STIFF)
    found = car.eig(u=u)
    assert close(moving(found), [expected])
    assert close(moving(car.eig(u=u, **TRAILS)), [with_trails])
    assert (found.counts.expected, found.counts.neutral) == (6, 4)
    assert found.verdict == "asymptotically stable up to symmetry"


@pytest.mark.parametrize(
    ("text", "trails", "expected"),
    [
        (STIFF, TRAILS, 29.622773675910968906),
        pytest.param(STIFF, {}, 27.549672693062145985, marks=pytest.mark.long),
        pytest.param(RELAXED, {}, 27.549672693062145985, marks=pytest.mark.long),
    ],
)
def test_a_car_that_oversteers_diverges_at_its_critical_speed(text, trails, expected):
    swept = mbstab.loads(text).sweep("u", [25.0, 31.0], a=1.696, b=1.189, **trails)
    assert [c.value for c in swept.critical] == pytest.approx([expected], rel=1e-11)


@pytest.mark.parametrize(
    ("u", "expected"),
    [
        (5, [-5.888247869776115 + 11.55634135862407j, -4.111752130223885 + 14.09372267514501j]),
        (20, [-34.80046987452894 + 1.242551902129871j, -5.199530125471059 + 4.143423423789674j]),
        (40, [-77.63031017793655 + 0.4440262672937696j, -2.369689822063447 + 3.533752217403184j]),
    ],
)
def test_a_car_on_tyres_with_relaxation(u, expected):
    car = mbstab.loads(RELAXED)
    assert [*car.system().names] == ["car.x", "car.y", "car.theta", "front_slip", "rear_slip"]
    assert close(moving(car.eig(u=u)), expected)


def test_aligning_moments_turn_oversteer_into_understeer():
    """Two tyres per axle, stiffness in N/deg and N m/deg; the trail is their ratio."""
    text = STIFF.replace("cornering_stiffness: C, trail: t_f", "cornering_stiffness: 2*1437/deg, trail: t_f")
    text = text.replace("cornering_stiffness: C, trail: t_r", "cornering_stiffness: 2*1507/deg, trail: t_r")
    values = {"m": 1914, "a": 1.473, "b": 1.403, "I": 2600, "t_f": 34 / 1437, "t_r": 38 / 1507}
    car = mbstab.loads(text)
    assert close(moving(car.eig(u=22.8, **values)), [-8.746606641521675, -10.75152792012992])
    assert close(moving(car.eig(u=40, **values)), [-5.556968350070704 + 1.320977770143204j])
    swept = car.sweep("u", [650.0, 690.0], **{**values, "t_f": 0, "t_r": 0})
    assert [c.value for c in swept.critical] == pytest.approx([671.259987831765843], rel=1e-11)


TRAILER = """\
mbstab: 1
title: Car with a trailer
parameters:
  {u: {value: 10, unit: m/s}, a: 1.289, b: 1.596, d: 2.7, e: 2.7, h: 0.3, C: 80000, m: 16975/9.81}
bodies:
  car: {type: planar, mass: m, inertia: 3508, points: {front: [a, 0], rear: [-b, 0], hitch: [-d, 0]}}
  trailer: {type: planar, mass: 2000, inertia: 3000, points: {hitch: [e, 0], axle: [-h, 0]}}
joints: {hitch: {type: revolute, between: [car.hitch, trailer.hitch]}}
forces:
  front: {type: tyre, at: car.front, cornering_stiffness: C}
  rear: {type: tyre, at: car.rear, cornering_stiffness: C}
  trailer: {type: tyre, at: trailer.axle, cornering_stiffness: C}
reference:
  coordinates: {car: {x: 0, y: 0, theta: 0}, trailer: {theta: 0}}
  rates: {car: {x: u}, trailer: {theta: 0}}
"""


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (
            {"u": 30},
            [-0.2302038475392513 + 2.973399773316713j, -0.5317333901564667, -5.037996615941374],
        ),
        (
            {"u": 40},
            [0.1789023665968457, -0.1570261485983097 + 2.921882171579922j, -4.387453345282483],
        ),
        (
            {"u": 30, "e": 2.9, "h": 0.1},
            [0.4777505808654939 + 2.69400098166997j, -2.418917418173147, -4.550776501468084],
        ),
    ],
)
def test_a_car_with_a_trailer(values, expected):
    assert close(moving(mbstab.loads(TRAILER).eig(**values)), expected, 1e-11)


@pytest.mark.long
def test_one_trailer_diverges_and_another_flutters():
    """The same masses; the second is loaded farther behind."""
    trailer = mbstab.loads(TRAILER)
    (critical,) = trailer.sweep("u", [35.0, 38.0]).critical
    assert (critical.kind, critical.value) == ("divergence", pytest.approx(36.962346917662735102, rel=1e-11))
    (critical,) = trailer.sweep("u", [17.0, 19.0], e=2.9, h=0.1).critical
    assert (critical.kind, critical.value) == ("flutter", pytest.approx(18.400054724652972167, rel=1e-11))
    assert critical.frequency == pytest.approx(2.95480977452978611, rel=1e-11)


SHIMMY = """\
mbstab: 1
title: Shimmy of a trailing wheel on a tyre with relaxation
parameters: {V: {value: 10, unit: m/s}, e: 0.08, t_p: 0.02, C: 15000, sigma: 0.25, I: 0.25, d: 1.5}
bodies:
  wheel: {type: planar, mass: 1, inertia: I, points: {contact: [-e, 0]}}
drives:
  along: {type: point, at: wheel, direction: x, position: V*t}
  across: {type: point, at: wheel, direction: y, position: 0}
forces:
  damper: {type: bushing, between: [wheel, ground], torsional_damping: d}
  tyre: {type: tyre, at: wheel.contact, cornering_stiffness: C, trail: t_p, relaxation_length: sigma}
reference:
  coordinates: {wheel: {x: 0, y: 0, theta: 0}}
"""


def test_shimmy_with_relaxation_of_the_tyre():
    """I d V^2 + (I S + σ d^2 − σ I G) V + σ d S = 0 with S = (e+t) C e and G = (e+t) C."""
    wheel = mbstab.loads(SHIMMY)
    assert close(moving(wheel.eig()), [10.55332535975057 + 58.86445414291477j, -67.10665071950114])
    assert close(moving(wheel.eig(V=100)), [1.875780182693704 + 76.50940571085784j, -409.7515603653874])
    swept = wheel.sweep("V", [0.5, 10.0, 200.0])
    assert [c.value for c in swept.critical] == pytest.approx([0.71520186173908039567, 167.7847981382609196], rel=1e-11)
    assert swept.critical[1].frequency == pytest.approx(77.115725732941540349, rel=1e-11)


@pytest.mark.long
@pytest.mark.parametrize(("sigma", "verdict"), [(0.1, "unstable"), (0.06, "asymptotically stable")])
def test_shimmy_without_a_damper_does_not_depend_on_the_speed(sigma, verdict):
    """Stable if and only if (e + t)(e - σ) > 0."""
    assert {mbstab.loads(SHIMMY).eig(d=0, V=V, sigma=sigma).verdict for V in (0.5, 300)} == {verdict}


a, b, C, m, INERTIA, SIGMA, TRAIL = 1.189, 1.696, 80000.0, 16975 / 9.81, 3508.0, 0.5, 0.03


def slips(vx, vy, r, steer):
    """Return for both axles the speed of the wheel, its slip angle, and its heading, for finite angles."""
    found = []
    for x, angle in ((a, steer), (-b, 0.0)):
        direction = np.arctan2(vy + r * x, vx)
        found.append((np.hypot(vx, vy + r * x), direction - angle, angle))
    return found


def car_rates(state, thrust, steer, relaxed):
    """Return the rates of speeds along and across, of the yaw rate, and of the slips that the forces follow."""
    vx, vy, r = state[:3]
    wheels = slips(vx, vy, r, steer)
    slip = state[3:] if relaxed else [alpha for _, alpha, _ in wheels]
    force, moment = np.array([thrust, 0.0]), 0.0
    for x, (_, alpha, angle), z in zip((a, -b), wheels, slip, strict=True):
        push = -C * z * np.array([-np.sin(angle), np.cos(angle)])
        force, moment = force + push, moment + x * push[1] + TRAIL * C * z * np.cos(alpha)
    lag = [speed / SIGMA * (alpha - z) for (speed, alpha, _), z in zip(wheels, slip, strict=True)] if relaxed else []
    return np.array([force[0] / m + vy * r, force[1] / m - vx * r, moment / INERTIA, *lag])


@pytest.mark.parametrize("relaxed", [False, True])
def test_a_car_in_a_steady_turn_has_the_eigenvalues_of_its_speeds(relaxed):
    """Three speeds with finite angles; eigenvalues from differences."""
    u, steer = 12.0, 0.2

    def unbalanced(x):
        state = [u, x[0], x[1]]
        return car_rates([*state, *(alpha for _, alpha, _ in slips(*state, steer))], x[2], steer, relaxed)[:3]

    v, r, thrust = fsolve(unbalanced, [0.0, 1.0, 5000.0], xtol=1e-14)
    alphas = [alpha for _, alpha, _ in slips(u, v, r, steer)]
    assert max(map(abs, alphas)) > 0.05
    text = (RELAXED if relaxed else STIFF).replace("t_f: 0, t_r: 0", f"t_f: {TRAIL}, t_r: {TRAIL}, steer: {steer}")
    text = text.replace("trail: t_f", "trail: t_f, along: [cos(steer), sin(steer)]")
    text = text.replace("forces:", f"forces:\n  engine: {{type: force, at: car, vector: [{thrust!r}, 0], frame: body}}")
    states = f", front_slip: {alphas[0]!r}, rear_slip: {alphas[1]!r}" if relaxed else ""
    text = text[: text.index("reference:")] + (
        f"reference:\n  steady: {{axis: z, rate: {r!r}}}\n"
        f"  coordinates: {{car: {{x: {v / r!r}, y: {-u / r!r}, theta: 0}}{states}}}\n"
        f"  rates: {{car: {{theta: {r!r}}}}}\n"
    )
    # The same motion is found from near it, though tyres have no forces at rest, where searches begin.
    guess = f", front_slip: {0.9 * alphas[0]!r}, rear_slip: {0.9 * alphas[1]!r}" if relaxed else ""
    sought = text[: text.index("reference:")] + (
        f"reference:\n  find: steady\n  steady: {{axis: z}}\n  coordinates: {{car: {{theta: 0}}}}\n"
        f"  guess: {{car: {{x: {1.05 * v / r!r}, y: {-0.95 * u / r!r}}}{guess}}}\n  rates: {{car: {{theta: {r!r}}}}}\n"
    )
    motion = mbstab.loads(sought.replace("np.float64", "")).motion()
    np.testing.assert_allclose(motion.q[:2], [v / r, -u / r], rtol=1e-8)
    state = np.array([u, v, r, *(alphas if relaxed else [])])
    h = 1e-4 * np.maximum(np.abs(state), 0.1)
    A = np.zeros((len(state), len(state)))
    for k, step in enumerate(h):
        at = [car_rates(state + i * step * np.eye(len(state))[k], thrust, steer, relaxed) for i in (-2, -1, 1, 2)]
        A[:, k] = (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step)
    found = mbstab.loads(text.replace("np.float64", "")).eig()
    expected = np.linalg.eigvals(A)
    assert len(found.values()) == len(expected)
    for value in found.values():
        assert np.min(np.abs(expected - value)) < 1e-8 * abs(value)


def test_shimmy_is_certified():
    wheel = mbstab.loads(SHIMMY)
    assert wheel.certify().verdict == "unstable"
    assert wheel.certify(V=200).verdict == "asymptotically stable"


def test_a_simulated_car_follows_its_equations_of_motion_and_loses_the_energy_that_tyres_take():
    run = mbstab.loads(STIFF).simulate(to=0.2, points=3, tol=1e-7, perturb={"car.theta": 0.1}, **TRAILS)
    energy = run.kinetic + run.potential
    np.testing.assert_allclose(energy - run.work, energy[0], rtol=1e-8)
    assert run.work[-1] < -100.0


@pytest.mark.parametrize("text", [STIFF, RELAXED])
def test_slip_has_no_value_at_rest(text):
    with pytest.raises(NumericalError, match=r"<text>:[78]:10: forces.front .*\n.*slip of a tyre has no value"):
        mbstab.loads(text).eig(u=0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sigma: 0.5", "sigma: -0.5", "relaxation length must be positive, got -0.5 m"),
        ("sigma: 0.5", "sigma: 0", "relaxation length must be positive, got 0 m"),
        ("cornering_stiffness: C, ", "", "the key 'cornering_stiffness' is missing"),
        ("C: 80000", "C: -1", "cornering stiffness must not be negative, got -1 N/rad"),
        ("t_r: 0", "front_slip: 0", "its state would be called 'front_slip', and that name is taken"),
        ("at: car.front", "contact: wheel", "unknown key 'contact'"),
        ("at: car.front", "at: ground", "expected a point of a body"),
    ],
)
def test_bad_tyres_are_refused(old, new, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(RELAXED.replace(old, new)).eig()
    assert message in str(caught.value)
    assert "<text>:" in str(caught.value)


def test_many_speeds_of_a_body_that_a_joint_moves_are_computed_together():
    """Rates that a joint determines are solved before those of the states of tyres, which divide by them."""
    text = RELAXED.replace("front: [a, 0]", "front: [a, 0], ball: [-2.5, 0]").replace(
        "forces:\n",
        "  van: {type: planar, mass: 900, inertia: 2000, points: {cup: [3, 0], axle: [-0.1, 0]}}\n"
        "joints: {hitch: {type: revolute, between: [van.cup, car.ball]}}\n"
        "forces:\n  axle: {type: tyre, at: van.axle, cornering_stiffness: C, relaxation_length: sigma}\n",
    )
    text = text.replace("theta: 0}}", "theta: 0}, van: {theta: 0}}").replace("{x: u}", "{x: u}, van: {theta: 0}")
    model, x = mbstab.loads(text), np.linspace(5.0, 60.0, 40)
    evaluator = Evaluator(model.model)
    found = evaluator.near({"u": x}, 7)
    assert evaluator.alone < 2
    for k in (0, 17, 39):
        assert close(moving(dict(enumerate(found.values[k]))), moving(model.eig(u=x[k])), 1e-11)


@pytest.mark.parametrize("law", ["", ", aligning_peak: 90, aligning_shape_factor: 2.3"])
@pytest.mark.parametrize("relaxed", [", relaxation_length: sigma", ""])
def test_the_sense_of_a_heading_changes_nothing(relaxed, law):
    """A wheel has no front: described from the other side it feels the same forces, and the same aligning moment."""
    text = SHIMMY.replace(", relaxation_length: sigma", f", aligning_stiffness: 300{relaxed}{law}")
    turned = text.replace("at: wheel.contact", "at: wheel.contact, along: -x")
    for V in (10.0, -10.0, 60.0):
        one, other = (mbstab.loads(x).eig(V=V) for x in (text, turned))
        assert close(moving(one), moving(other), 1e-11)
        assert one.verdict == other.verdict
        assert [*one.warnings, *other.warnings] == []


@pytest.mark.parametrize("relaxed", [", relaxation_length: sigma", ""])
@pytest.mark.parametrize("V", [10.0, -10.0])
def test_an_aligning_moment_is_that_of_a_trail_whichever_way_the_wheel_goes(V, relaxed):
    """The force C α at a distance t behind the contact, or the moment C t α."""
    shimmy = SHIMMY.replace(", relaxation_length: sigma", relaxed)
    trailing = mbstab.loads(shimmy).eig(V=V)
    text = shimmy.replace("trail: t_p", "aligning_stiffness: t_p*C")
    assert close(moving(mbstab.loads(text).eig(V=V)), moving(trailing), 1e-11)


def test_a_sweep_of_the_speed_through_rest_has_aligning_moments_of_both_senses():
    """I θ'' + (d + C e (e + s t)/|V|) θ' + C (s e + t) θ = 0 with s = V/|V|."""
    text = SHIMMY.replace("trail: t_p, relaxation_length: sigma", "aligning_stiffness: t_p*C")
    speeds, (C, inertia, t, d) = np.array([-20.0, -5.0, 5.0, 20.0]), (15000.0, 0.25, 0.02, 1.5)
    for e in (0.08, 0.01):
        swept = mbstab.loads(text).sweep("V", speeds, e=e)
        assert not swept.warnings
        for V, found, count in zip(speeds, swept.branches, swept.unstable, strict=True):
            s = np.sign(V)
            expected = np.roots([inertia, d + C * e * (e + s * t) / abs(V), C * (s * e + t)])
            found = sorted(found, key=lambda x: (x.real, x.imag))
            np.testing.assert_allclose(found, sorted(expected, key=lambda x: (x.real, x.imag)), rtol=1e-11)
            assert count == sum(x.real > 0.0 for x in expected)


@pytest.mark.parametrize("relaxed", [", relaxation_length: sigma", ""])
def test_an_aligning_moment_has_no_value_where_its_wheel_moves_straight_sideways(relaxed):
    text = SHIMMY.replace(", relaxation_length: sigma", f", aligning_stiffness: 300{relaxed}, along: y")
    with pytest.raises(NumericalError, match=r"<text>:11:9: forces.tyre .*\n.*moves straight sideways"):
        mbstab.loads(text).eig()


SIDEWAYS = """
mbstab: 1
parameters: {V: 10, d: 0.001, e: 0.1, C: 100, I: 0.5}
bodies: {wheel: {type: planar, mass: 1, inertia: I, points: {contact: [-e, 0]}}}
drives:
  along: {type: point, at: wheel, direction: x, position: V*t*sin(d)}
  across: {type: point, at: wheel, direction: y, position: V*t*cos(d)}
forces:
  tyre: {type: tyre, at: wheel.contact, cornering_stiffness: C}
  hold: {type: torque, body: wheel, value: -C*e*(pi/2 - d)}
reference:
  coordinates: {wheel: {x: 0, y: 0, theta: 0}}
  rates: {wheel: {x: V*sin(d), y: V*cos(d), theta: 0}}
"""


@pytest.mark.parametrize("d", [0.1, 1e-4, 1e-8])
def test_a_wheel_that_moves_nearly_sideways_keeps_all_digits(d):
    # I θ'' + C e (θ + e sin d θ'/V) = 0: the slip is π/2 − d − θ − e sin d θ'/V, and more of second order
    exact = np.roots([0.5, 100 * 0.1**2 * np.sin(d) / 10, 100 * 0.1])
    found = mbstab.loads(SIDEWAYS).eig(d=d).values()
    assert np.max(np.abs(np.sort_complex(found) - np.sort_complex(exact))) <= 1e-13
    assert np.max(np.abs(np.sort_complex(found).real / np.sort_complex(exact).real - 1.0)) <= 1e-6


@pytest.mark.parametrize("relaxed", [False, True])
def test_a_car_spins_past_the_directions_across_its_wheels(relaxed):
    sigma = ", relaxation_length: 0.6" if relaxed else ""
    text = (
        "mbstab: 1\nbodies: {car: {type: planar, mass: 1400, inertia: 2200, points: {f: [1.2, 0], r: [-1.4, 0]}}}\n"
        f"forces: {{f: {{type: tyre, at: car.f, cornering_stiffness: 9000{sigma}}}, "
        f"r: {{type: tyre, at: car.r, cornering_stiffness: 8000{sigma}}}}}\n"
        "reference: {coordinates: {car: {x: 0, y: 0, theta: 0}}, rates: {car: {x: 12, y: 0, theta: 3}}}\n"
    )
    sim = mbstab.loads(text).simulate(2.0, points=21, tol=1e-9)

    def rate(t, y):
        (x, v, turn), slips = y[3:6], y[6:]
        c, s = np.cos(y[2]), np.sin(y[2])
        force, moment, change = np.zeros(2), 0.0, []
        for k, (arm, stiffness) in enumerate([(1.2, 9000.0), (-1.4, 8000.0)]):
            along, across = c * x + s * v, -s * x + c * v + arm * turn
            slip = np.arctan2(across, abs(along))
            change.append(np.hypot(along, across) / 0.6 * (slip - slips[k]))
            side = -stiffness * (slips[k] if relaxed else slip)
            force, moment = force + side * np.array([-s, c]), moment + arm * side
        return [*y[3:6], *force / 1400.0, moment / 2200.0, *change]

    exact = solve_ivp(
        rate, (0.0, 2.0), [0, 0, 0, 12, 0, 3, 0, 0], t_eval=sim.times, max_step=1e-3, rtol=1e-11, atol=1e-11
    )
    assert np.ptp(exact.y[2]) > 2.0
    assert np.max(np.abs(sim.q[:, :3] - exact.y[:3].T)) < 1e-6


# --- the Magic Formula: published forces, the linear tyre at small slip, cars in steady turns -------------------------


MAGIC_CAR = """\
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
    return MAGIC_CAR.format(front=law.format("F_f"), rear=law.format("F_r"), more=more)


LINEAR, MAGIC = car(CORNERING), car(BAKKER)
MAGIC_RELAXED = car(BAKKER, ", relaxation_length: sigma")


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
def test_a_car_on_magic_tyres_in_a_steady_turn_has_the_eigenvalues_of_its_speeds(relaxed, steer, loads):
    with mpmath.workdps(40):
        state, slips, thrust, expected = turning(12, single_track(steer, loads), relaxed)
        assert max(map(abs, slips)) > 0.03
        text = in_a_turn(MAGIC_RELAXED if relaxed else MAGIC, state, thrust, slips, relaxed)
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
        text = in_space(in_a_turn(MAGIC_RELAXED if relaxed else MAGIC, state, thrust, slips, relaxed))
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
        MAGIC_CAR.format(front=stiffness[0] + front, rear=stiffness[1] + rear, more=more).replace("trail: t_p, ", "")
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


@pytest.mark.few(2)
@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("change", [str, in_space])
def test_loads_that_follow_the_motion_count_in_space_and_with_relaxation(relaxed, change):
    text = (MAGIC_RELAXED if relaxed else MAGIC).replace("*F_f", "*(F_f - 2*rate(car.theta))")
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
