"""Families of steady motions that nothing explains but that are there: a shaft that turns at any speed."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbstab
from mbstab.analysis.verdict.rule import ASYMPTOTIC_UP_TO, STABLE_UP_TO, UNDECIDED, UNSTABLE

ROTOR = """
mbstab: 1
parameters: {m: 1, I: 0.5, k: 100, ci: 0.4, ce: 0.2, Om: 8, e: 0}
bodies:
  shaft: {type: planar, mass: 1, inertia: I}
  p: {type: planar_point, mass: m}
joints:
  pivot: {type: revolute, between: [shaft, ground]}
forces:
  inner: {type: bearing, between: [p, shaft], stiffness: k, damping: ci}
  outer: {type: bearing, between: [p, ground], damping: ce}
  push: {type: expression, on: {shaft.theta: e*(rate(shaft.theta) - Om)**3}}
reference:
  rates: {shaft: {theta: Om}}
  coordinates:
    shaft: {x: 0, y: 0, theta: 0}
    p: {x: 0, y: 0}
"""


def test_a_shaft_turns_at_any_speed_and_every_command_says_so():
    # Stable below the speed sqrt(k/m)*(1 + ce/ci) = 15, to the square of the damping.
    rotor, speeds = mbstab.loads(ROTOR), np.linspace(0.5, 14.5, 15)
    assert rotor.sweep("Om", speeds).verdicts == [ASYMPTOTIC_UP_TO] * 15
    assert {rotor.eig(Om=float(x)).verdict for x in speeds[::3]} == {ASYMPTOTIC_UP_TO}
    assert rotor.eig(Om=15.5).verdict == UNSTABLE


RIGID = """
mbstab: 1
parameters: {n: 100, ci: 20}
bodies:
  rotor: {type: spatial, mass: 20, inertia: [0.8, 0.8, 1.1], points: {A: [0, 0, -0.3], B: [0, 0, 0.2]}}
forces:
  A: {type: bearing, between: [rotor.A, {body: ground, point: [0, 0, -0.3]}], stiffness: 2e5, damping: 30}
  B: {type: bearing, between: [rotor.B, {body: ground, point: [0, 0, 0.2]}], stiffness: 3e5, damping: 30}
  inner: {type: bearing, between: [{body: ground, point: [0, 0, -0.3]}, rotor.A], damping: ci}
constraints: {axial: {holonomic: rotor.z}}
reference:
  coordinates: {rotor: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates: {rotor: {psi: n}}
"""


def test_the_speed_of_a_rotor_is_neutral_at_every_speed_and_in_every_command():
    rotor = mbstab.loads(RIGID)
    for n in (0, 100):
        assert rotor.eig(n=n).modulo.family == ("speed of rotor.psi",)
    swept = rotor.sweep("n", np.linspace(0.0, 200.0, 9))
    assert (swept.neutral, swept.branches.shape[1]) == (2, 8)
    proven = rotor.certify(n=100)
    assert proven.verdict == ASYMPTOTIC_UP_TO
    assert proven.conditions == ()


def test_so_does_one_with_other_sizes_of_masses_and_forces():
    settings = {"m": 0.0628, "I": 58.7, "k": 66.9, "ci": 0.00264, "ce": 0.328, "Om": 148.66}
    assert mbstab.loads(ROTOR).eig(**settings).verdict == ASYMPTOTIC_UP_TO


@pytest.mark.few(2)
@pytest.mark.parametrize("e", [1e-3, 1e-9, -1e-9])
@pytest.mark.parametrize("speed", [1.0, 8.0])
def test_where_a_weak_push_changes_the_speed_nothing_is_claimed(e, speed):
    assert mbstab.loads(ROTOR).eig(e=e, Om=speed).verdict == UNDECIDED


# --- what a zero carries along ---------------------------------------------------------------------------------------

CASTER = """
mbstab: 1
bodies: {w: {type: planar, mass: 1, inertia: 0.2}}
drives: {along: {type: coordinate, coordinate: w.x, position: t}}
contacts: {wheel: {type: knife_edge, at: w, along: x}}
forces: {caster: {type: expression, on: {w.theta: LAW - 2*rate(w.theta)}}}
reference:
  coordinates: {w: {x: 0, y: 0, theta: 0}}
  rates: {w: {x: 1, y: 0, theta: 0}}
"""


@pytest.mark.parametrize(
    ("law", "in_place", "drift"),
    [
        ("0*w.theta", False, "only this offset drifts like t"),  # y' = tan(theta), theta stays
        ("-w.theta**3", None, "may drift more slowly than t"),  # theta like the root of 1/t
        ("-w.theta", True, ""),
    ],
)
def test_a_wheel_that_does_not_return_goes_on_across(law, in_place, drift):
    result = mbstab.loads(CASTER.replace("LAW", law)).eig()
    assert result.verdict == ASYMPTOTIC_UP_TO
    assert bool(result.in_place) == bool(in_place)
    assert drift in result.reasons[0]
    assert ("drift" in result.reasons[0]) == bool(drift)


@pytest.mark.parametrize(
    ("across", "grows"),
    [
        ("x**2", True),  # x decays like the root of 1/(2 t): y grows like log(t)/2
        ("x**2 + rate(x)", True),
        ("0*x", False),
    ],
)
@pytest.mark.parametrize("how", ["force", "state"])
def test_what_a_slow_decay_drives_may_grow_even_by_its_square(across, grows, how):
    across = across.replace("x", "b.x")
    text = """
mbstab: 1
bodies: {b: {type: planar_point, mass: 1}}
constraints: {rail: {holonomic: b.y}}
forces: {f: {type: expression, on: {b.x: -b.x**3 - rate(b.x)}}}
states: {F: {rate: RATE}}
reference: {coordinates: {b: {x: 0, y: 0}}}
"""
    if how == "force":
        text = text.replace("states: {F: {rate: RATE}}\n", "").replace("constraints: {rail: {holonomic: b.y}}\n", "")
        text = text.replace("- rate(b.x)}", "- rate(b.x), b.y: RATE - rate(b.y)}")
    result = mbstab.loads(text.replace("RATE", across)).eig()
    assert result.verdict == ASYMPTOTIC_UP_TO
    assert ("may drift more slowly than t" in result.reasons[0]) == grows


def test_a_towed_wheel_below_its_pin_goes_on_across():
    result = mbstab.load("shimmy.yaml").eig(l=0)
    assert not result.in_place
    assert "only this offset drifts like t" in result.reasons[0]


def test_a_family_of_places_is_called_one():
    result = mbstab.loads("""
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {a.x: -rate(a.x), a.y: -a.y-(1+a.x**2)*rate(a.y)}}}
reference: {coordinates: {a: {x: 0, y: 0}}}
""").eig()
    assert result.modulo.family == ("position of a.x",)


def test_numbers_whose_squares_vanish_leave_the_verdict_open():
    text = """
mbstab: 1
parameters: {e: {value: 1e-165}}
bodies: {a: {type: planar_point, mass: 1}}
forces: {f: {type: expression, on: {a.x: -rate(a.x)+e*a.y, a.y: -a.y-rate(a.y)+e*a.x}}}
reference: {coordinates: {a: {x: 0, y: 0}}}
"""
    mechanism = mbstab.loads(text)
    assert mechanism.eig().verdict == "undecided"
    assert any("e is 1e-165: products" in x for x in mechanism.eig().reasons)
    assert mechanism.sweep("e", [1e-165, 1e-100]).verdicts == ["undecided", "unstable"]


@pytest.mark.parametrize("lag", [0.3, 0.7, 11.0])
def test_a_line_of_rests_that_a_filter_follows(lag):
    """F - x/T never changes; the filter G goes where x is, to rounding."""
    text = f"""
mbstab: 1
bodies: {{b: {{type: planar_point, mass: 2}}}}
constraints: {{y: {{holonomic: b.y}}}}
states: {{F: {{rate: rate(b.x)/0.5}}, G: {{rate: (b.x - G)/{lag}}}}}
forces: {{s: {{type: expression, on: {{b.x: -50*b.x - 3*rate(b.x) - 2*F}}}}}}
reference: {{coordinates: {{b: {{x: 0, y: 0}}}}}}
"""
    found = mbstab.loads(text).eig()
    assert found.verdict == "asymptotically stable up to symmetry"
    assert found.counts.neutral == 1


@pytest.mark.parametrize(("rate", "verdict"), [("x**3", "unstable"), ("-x**3", "asymptotically stable")])
def test_a_state_that_leaves_slowly_is_no_line_of_rests(rate, verdict):
    text = f"""
mbstab: 1
bodies: {{b: {{type: planar_point, mass: 2}}}}
constraints: {{y: {{holonomic: b.y}}}}
states: {{x: {{rate: {rate}}}, G: {{rate: (x + b.x - G)/0.3}}}}
forces: {{s: {{type: expression, on: {{b.x: -50*b.x - 3*rate(b.x)}}}}}}
reference: {{coordinates: {{b: {{x: 0, y: 0}}}}}}
"""
    assert mbstab.loads(text).eig().verdict in (verdict, "undecided")


@pytest.mark.few(3)
@pytest.mark.parametrize(("length", "mass"), [(1, 1), (1e3, 1e-3), (1e6, 1), (1, 1e9)])
def test_a_family_in_which_states_change_is_found_in_all_units(length, mass):
    """A cart at constant speed needs another integral and another effort, in units of their own."""
    force = length * mass
    found = mbstab.load("cart_pendulum.yaml").eig(
        **{"P": 40 * force, "I": 20 * force, "D": 8 * force, "M": 0.5 * mass, "m": 0.2 * mass, "b": 0.1 * mass},
        **{"l": 0.3 * length, "J": 0.006 * mass * length**2, "g": 9.81 * length},
    )
    assert found.verdict == ASYMPTOTIC_UP_TO
    assert found.counts.neutral == 2


def test_rests_with_other_values_of_a_state_are_named_after_it():
    rail = "bodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}"
    spring = "forces: {spring: {type: expression, on: {p.x: -p.x}}}\nstates: {z: {rate: p.x*z}}"
    found = mbstab.loads(f"mbstab: 1\n{rail}\n{spring}\nreference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}\n").eig()
    assert found.modulo.family == ("state z",)


def test_a_state_that_time_changes_is_named_without_empty_brackets():
    rail = "bodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}"
    late = "forces: {spring: {type: expression, on: {p.x: -p.x}}}\nstates: {z: {rate: -z*(1 - smooth_start(t - 5))}}"
    found = mbstab.loads(f"mbstab: 1\n{rail}\n{late}\nreference: {{coordinates: {{p: {{x: 0, y: 0}}}}}}\n").eig()
    assert found.verdict == UNDECIDED
    assert "through states.z (smooth_start(t - 5)):" in found.reasons[0]


# --- floppy chains: rests of another shape -------------------------------------------------------------------------


def floppy(count, planar, weak="0"):
    """Return points on springs of their free length, with friction on the ground, and perhaps a weak force."""
    places, names = [(0, 0), (1, 0), (1, 1), (2, 1)], "abcd"[:count]
    letters = "xy" if planar else "xyz"
    kind, third = ("planar_point", "") if planar else ("point", ", z: 0")
    bodies = ", ".join(f"{x}: {{type: {kind}, mass: {1 + k / 4}}}" for k, x in enumerate(names))
    springs = "".join(
        f"  {x}{y}: {{type: spring, between: [{x}, {y}], stiffness: 10, length: 1, damping: 0.5}}\n"
        for x, y in pairwise(names)
    )
    drag = ", ".join(f'{x}.{q}: "-rate({x}.{q})"' for x in names for q in letters)
    given = ", ".join(f"{x}: {{x: {q[0]}, y: {q[1]}{third}}}" for x, q in zip(names, places, strict=False))
    return f"""
mbstab: 1
bodies: {{{bodies}}}
forces:
{springs}  drag: {{type: expression, on: {{{drag}}}}}
  weak: {{type: expression, on: {{"distance(a, c)": "{weak}"}}}}
reference: {{coordinates: {{{given}}}}}
"""


@pytest.mark.few(3)
@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("count", [3, 4])
def test_chains_of_springs_may_rest_in_any_shape(count, planar):
    found = mbstab.loads(floppy(count, planar)).eig()
    assert found.verdict == ASYMPTOTIC_UP_TO
    # Lengths and speeds decay; places do not.
    assert found.counts.neutral == (2 if planar else 3) * count - (count - 1)


@pytest.mark.parametrize(
    ("weak", "allowed"),
    [
        ("-1e-12*(distance(a, c) - sqrt(2))**3", {ASYMPTOTIC_UP_TO, UNDECIDED}),
        ("1e-12*(distance(a, c) - sqrt(2))**3", {UNSTABLE, UNDECIDED}),
        ("1e-12*(distance(a, c) - sqrt(2))**7", {UNSTABLE, UNDECIDED}),
    ],
)
def test_a_weak_force_along_the_shape_leaves_no_family(weak, allowed):
    found = mbstab.loads(floppy(3, True, weak)).eig()
    assert found.verdict in allowed
    assert not any("same kind" in x for x in found.modulo.family)


# --- what goes on along symmetries beside an energy that has a minimum -----------------------------------------------

ON_RAILS = """
mbstab: 1
bodies: {{{bodies}}}
constraints: {{{rails}{row}}}
forces: {{f: {{type: expression, on: {{{forces}}}}}}}
"""


def on_rails(row="", **forces):
    """Return points of mass 1 that move along x, with forces."""
    bodies = ", ".join(f"{name}: {{type: planar_point, mass: 1}}" for name in forces)
    rails = ", ".join(f"r{name}: {{holonomic: {name}.y}}" for name in forces)
    row = f", c: {{nonholonomic: {row}}}" if row else ""
    written = ", ".join(f"{name}.x: {law}" for name, law in forces.items())
    return mbstab.loads(ON_RAILS.format(bodies=bodies, rails=rails, row=row, forces=written))


@pytest.mark.parametrize("seed", range(8))
def test_steady_motions_beside_an_energy_are_named(seed):
    """With forces -g(x) w and g(x) v of no power, v = 0 and k x = -g(x) w is a motion for every small speed w."""
    rng = np.random.default_rng(seed)
    k, c, a, b, d = rng.uniform(0.5, 2.0, 5).round(3) * np.array([1, seed % 2, 1, 1, 1])
    g = f"({a} + {b}*p.x + {d}*p.x**2)"
    mechanism = on_rails(p=f"-{g}*rate(q.x) - {k}*p.x - {c}*rate(p.x)", q=f"{g}*rate(p.x)")
    for found in (mechanism.eig(), mechanism.eig_precise(30)):
        assert (found.verdict, found.counts.neutral) == (STABLE_UP_TO, 2)
        assert "the speed of q.x" in found.reasons[0]
        assert found.reasons[0].endswith("only this offset drifts like t, while everything else stays small")
        assert found.spectrum.chains.drifting == (("q.x", 1),)
    assert "may drift at most like t" in " ".join(str(mechanism.certify()).split())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("damped", [0, 1])
def test_oscillations_that_drive_a_symmetry_are_told(seed, damped):
    """The place z' = h(x) y' grows by the same area in each period; with damping it ends somewhere."""
    rng = np.random.default_rng(seed)
    k, a, b = rng.uniform(0.5, 2.0, 3).round(3)
    forces = {"x": f"-{k}*x.x - {damped}*rate(x.x)", "y": f"-{k}*y.x - {damped}*rate(y.x)", "z": "0"}
    told = on_rails(f"rate(z.x) - ({a}*x.x + {b}*x.x**2)*rate(y.x)", **forces).eig().reasons[0]

    def slope(t, s):
        x, y, _, v, w = s
        h, dh = a * x + b * x**2, a + 2.0 * b * x
        return [v, w, h * w, -k * x - damped * v, (-k * y - damped * w - h * dh * v * w) / (1.0 + h**2)]

    times = np.array([200.0, 400.0])
    z = solve_ivp(slope, (0, 400), [0.01, 0, 0, 0, 0.01], rtol=1e-10, atol=1e-14, t_eval=times).y[2]
    grows = abs(z[1] / z[0] - 2.0) < 0.1
    assert grows == (not damped)
    assert ("may drift at most like t" in told) == grows
    assert ("slightly" in told) != grows


@pytest.mark.parametrize("seed", range(6))
def test_states_that_follow_a_symmetry_of_their_own(seed):
    """Integrals w of states z that decay, and of a mass that does not; driven by a square, they go on."""
    rng = np.random.default_rng(seed)
    k, a, b, c, d = rng.uniform(0.5, 2.0, 5).round(3)
    for square, drifts in ((0, False), (1, True)):
        states = f"z: {{rate: -{a}*z + {b}*p.x}}, w: {{rate: {c}*z + {d}*rate(p.x) + {square}*p.x**2}}"
        rail = "bodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}"
        text = f"mbstab: 1\nparameters: {{k: {k}}}\n{rail}\nstates: {{{states}}}\n"
        mechanism = mbstab.loads(f"{text}forces: {{f: {{type: expression, on: {{p.x: -k*p.x}}}}}}\n")
        found = mechanism.eig()
        assert (found.verdict, found.modulo.names) == (STABLE_UP_TO, ("state w",))
        assert ("slightly" in found.reasons[0]) != drifts
        assert mechanism.certify().verdict == STABLE_UP_TO
        assert mechanism.sweep("k", [0.5, 1.0, 2.0]).verdicts == [STABLE_UP_TO] * 3


def test_an_integral_of_a_constant_beside_an_oscillation_grows_like_t():
    rail = "bodies: {p: {type: planar_point, mass: 1}}\nconstraints: {rail: {holonomic: p.y}}"
    text = f"mbstab: 1\nparameters: {{k: 1}}\n{rail}\nstates: {{z: {{rate: RATE}}, w: {{rate: z}}}}\n"
    text += "forces: {f: {type: expression, on: {p.x: -k*p.x}}}\n"
    mechanism = mbstab.loads(text.replace("RATE", "0"))
    assert mechanism.eig().reasons[0].endswith("only this offset drifts like t, while everything else stays small")
    assert mechanism.sweep("k", [-1.0, -0.5, 0.5, 1.0]).verdicts == [UNSTABLE] * 2 + [STABLE_UP_TO] * 2
    # Here z grows like t, and w like its square.
    assert mbstab.loads(text.replace("RATE", "p.x**2")).eig().verdict == UNDECIDED
    # Nothing that has an energy is left of this one.
    held = "bodies: {p: {type: planar, mass: 1, inertia: 1}}\njoints: {hold: {type: fixed, between: [p, ground]}}"
    found = mbstab.loads(f"mbstab: 1\n{held}\nstates: {{z: {{rate: 0}}, w: {{rate: z}}}}\n").eig()
    assert found.reasons[0].startswith("every motion nearby is of the same kind: it differs in the state w and")
