"""Tyres: vehicles against their closed forms, at rest refused, in steady turns and in space."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import mbstab
from mbstab.analysis.sweep.batched_spectra import Evaluator
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
    pytest.importorskip("flint")
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
        ("C: 80000", "C: -1", "cornering stiffness must be positive, got -1 N/rad"),
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
