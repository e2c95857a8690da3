"""Random carts on wheels, casters and skids, and cars on tyres, against their equations in other coordinates.

Axles of carts carry up to three wheels, and the bodies stand on up to seven points: rows repeat others.
"""

import itertools
import random
import re

import mpmath
import numpy as np
import pytest

import mbstab
from mbstab.analysis.algebra.stacks import unit
from mbstab.analysis.proof.characteristic import Proof
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.sweep.sweep import sweep
from mbstab.analysis.verdict.directions import Ranks, orthonormal
from mbstab.errors import ConstraintError

STEP = 1e-30
"""Complex step: derivatives without differences."""


class Cart:
    """A cart with its axle through the origin of the drawing, x ahead and y to the left."""

    def __init__(self, seed: int, still: bool = False) -> None:
        rng = random.Random(seed)
        fixed, casters = [(1, 2), (2, 0), (2, 1), (2, 2), (3, 0), (3, 1)][seed % 6]
        even = seed % 3 == 0
        self.v = 0.0 if still else rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-2, 1)
        self.gravity = rng.choice([0.0, 9.81])
        self.declared = rng.random() < 0.3
        self.r, self.m, self.inertia = rng.uniform(0.03, 0.3), 10.0 ** rng.uniform(0, 3), 10.0 ** rng.uniform(0, 3)
        self.center = rng.uniform(-0.3, 0.8), 0.0 if even else rng.uniform(-0.2, 0.2)
        track = rng.uniform(0.1, 0.5)
        places = [(track, -track, 0.0), (track, -rng.uniform(0.1, 0.5), rng.uniform(-0.1, 0.1))][not even]
        self.wheels = [(rng.uniform(0.1, 5.0), y) for y in places[: fixed if fixed > 1 else 0] or (0.0,)]
        ahead = rng.uniform(0.4, 1.5)
        self.trail = rng.uniform(0.02, 0.2)
        self.casters = [
            (rng.uniform(0.1, 3.0), ahead + (not even) * rng.uniform(-0.2, 0.2), y, 10.0 ** rng.uniform(-4, -1))
            for y in (track, -track)[:casters]
        ]
        if even:
            self.wheels = [(self.wheels[0][0], y) for _, y in self.wheels]
            self.casters = [(*self.casters[0][:1], x, y, self.casters[0][3]) for _, x, y, _ in self.casters]
        self.skids = [(ahead + rng.uniform(-0.3, 0.3), y) for y in (track, -track)[: 2 if casters < 2 else seed % 2]]

    def text(self) -> str:
        """Return the model file."""
        r, (cx, cy) = self.r, self.center
        bodies, joints, contacts, states, rates = [], [], [], [], [f"cart: {{x: {self.v!r}, psi: 0}}"]
        disk = f"axes: [-pi/2, 0, 0], shape: {{type: disk, radius: {r!r}}}"

        def add(name: str, mass: float, x: float, y: float, on: str = "cart") -> None:
            bodies.append(f"{name}: {{type: spatial, mass: {mass!r}, {disk}}}")
            joints.append(f"a{name}: {{type: revolute, between: [{name}, {on}], axis: [z, y]}}")
            contacts.append(f"c{name}: {{type: wheel, center: {name}, axle: z, radius: {r!r}}}")

        points = {f"w{i}": (-cx, y - cy) for i, (_, y) in enumerate(self.wheels)}
        points |= {f"p{i}": (x - cx, y - cy) for i, (_, x, y, _) in enumerate(self.casters)}
        points |= {f"k{i}": (x - cx, y - cy) for i, (x, y) in enumerate(self.skids)}
        for i, (mass, y) in enumerate(self.wheels):
            add(f"w{i}", mass, 0.0, y, f"cart.w{i}")
        for i, (mass, x, y, inertia) in enumerate(self.casters):
            low = f"inertia: [{inertia!r}, {inertia!r}, {inertia!r}], points: {{axle: [{-self.trail!r}, 0, 0]}}"
            bodies.append(f"f{i}: {{type: spatial, mass: 0.3, {low}}}")
            joints.append(f"j{i}: {{type: revolute, between: [f{i}, cart.p{i}], axis: z}}")
            add(f"q{i}", mass, x, y, f"f{i}.axle")
            states.append(f"f{i}: {{theta: 0, psi: 0}}")
            rates.append(f"f{i}: {{x: {self.v!r}}}")
        for i, _ in enumerate(self.skids):
            bodies.append(f"s{i}: {{type: spatial, mass: 0.4, inertia: [1.0e-3, 1.0e-3, 1.0e-3]}}")
            joints.append(f"b{i}: {{type: fixed, between: [s{i}, cart.k{i}]}}")
            ball = f"center: s{i}, a: {r!r}, b: {r!r}, c: {r!r}, motion: frictionless"
            contacts.append(f"d{i}: {{type: ellipsoid, {ball}}}")
        marks = ", ".join(f"{name}: [{x!r}, {y!r}, {r!r} - 0.6]" for name, (x, y) in points.items())
        solid = f"inertia: [{0.6 * self.inertia!r}, {0.8 * self.inertia!r}, {self.inertia!r}]"
        cart = f"cart: {{type: spatial, mass: {self.m!r}, {solid}, points: {{{marks}}}}}"
        states = ["cart: {x: 0, y: 0, z: 0.6, phi: 0, theta: 0, psi: 0}", *states]
        steady = f"\n  steady: {{direction: x, speed: {self.v!r}}}" if self.declared and self.v else ""

        def block(lines: list[str]) -> str:
            return "\n".join(f"  {line}" for line in lines)

        return (
            f"mbstab: 1\ngravity: [0, 0, {-self.gravity!r}]\nbodies:\n{block([cart, *bodies])}\n"
            f"joints:\n{block(joints)}\ncontacts:\n{block(contacts)}\n"
            f"reference:\n  coordinates:\n  {block(states).replace(chr(10), chr(10) + '  ')}\n"
            f"  rates:\n  {block(rates).replace(chr(10), chr(10) + '  ')}{steady}\n"
        )

    def speeds(self, heading, turns):
        """Return √inertia times the speeds of all bodies, linear in the speed of the axle ahead and the yaw rate.

        The plane motion: heading, and the angles of the casters, whose wheels roll in their own plane.
        """
        along, left = (np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))
        rows, r = [], self.r
        spun = 0.5 * r * r, 0.25 * r * r  # a thin disk, about its axle and across

        def moved(mass, x, y):
            """Add a mass that moves with a point of the cart."""
            for k in (0, 1):
                rows.append(np.sqrt(mass) * np.array([along[k], left[k] * x - along[k] * y]))

        moved(self.m, *self.center)
        rows.append(np.sqrt(self.inertia) * np.array([0.0, 1.0]))
        for x, y in self.skids:
            moved(0.4, x, y)
            rows.append(np.sqrt(1e-3) * np.array([0.0, 1.0]))
        for mass, y in self.wheels:
            moved(mass, 0.0, y)
            rows.append(np.sqrt(mass * spun[1]) * np.array([0.0, 1.0]))
            rows.append(np.sqrt(mass * spun[0]) / r * np.array([1.0, -y]))
        for (mass, x, y, inertia), turn in zip(self.casters, turns, strict=True):
            moved(0.3, x, y)
            yaw = self.yaw(x, y, turn)
            rows.append(np.sqrt(inertia) * yaw)
            ahead = np.array([np.cos(turn), np.sin(turn) * x - np.cos(turn) * y])
            # The wheel's centre moves in its own plane.
            rows += [np.sqrt(mass) * e * ahead for e in (np.cos(heading + turn), np.sin(heading + turn))]
            rows.append(np.sqrt(mass * spun[1]) * yaw)
            rows.append(np.sqrt(mass * spun[0]) / r * ahead)
        return np.array(rows)

    def yaw(self, x, y, turn):
        """Return the yaw rate of a caster at a point, linear in the same speeds."""
        return np.array([-np.sin(turn), np.cos(turn) * x + np.sin(turn) * y]) / self.trail

    def eigenvalues(self):
        """Return the eigenvalues without those of place, heading, speed and wheel angles.

        With speeds w = W η the equations are Wᵀ (W η̇ + Ẇ η) = 0; about η = (v, 0) only first-order changes of W count.
        """
        n = len(self.casters)
        W = self.speeds(0.0, [0.0] * n)
        rates = np.zeros((1 + n, n + 2))  # of heading and of the turns of the casters, from turns and speeds
        rates[0, n + 1] = 1.0
        for i, (_, x, y, _) in enumerate(self.casters):
            rates[1 + i, n:] = self.yaw(x, y, 0.0) - [0.0, 1.0]
            rates[1 + i, i] = self.v * self.yaw(x, y, STEP * 1j)[0].imag / STEP
        changes = []
        for k in range(1 + n):
            angles = [STEP * 1j * (k == i) for i in range(1 + n)]
            changes.append(self.speeds(angles[0], angles[1:])[:, 0].imag / STEP * self.v)
        A = np.zeros((n + 2, n + 2))
        A[:n] = rates[1:]
        A[n:] = -np.linalg.solve(W.T @ W, W.T @ np.array(changes).T @ rates)
        found = np.linalg.eigvals(A)
        return np.delete(found, np.argmin(np.abs(found)))


def matched(found, expected):
    """Return the largest distance between numbers that belong together."""
    return min(
        max((abs(x - y) for x, y in zip(order, expected, strict=True)), default=0.0)
        for order in itertools.permutations(found)
    )


@pytest.mark.parametrize("seed", range(36))
def test_a_cart_is_judged_as_its_plane_motion_is(seed):
    cart = Cart(seed)
    expected = cart.eigenvalues()
    result = mbstab.loads(cart.text()).eig()
    found = [x for x in result.eigenvalues if x.kind != "neutral"]
    values = [z for x in found for z in ((x.value,) if not x.value.imag else (x.value, x.value.conjugate()))]
    assert len(values) == len(expected)
    assert matched(values, expected) <= 1e-9 * max(map(abs, expected))
    growing = any(z.real > 0.0 for z in expected)
    assert result.verdict == ("unstable" if growing else "asymptotically stable up to symmetry")


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(12))
def test_a_cart_at_rest_is_judged_by_its_energy(seed):
    """Speeds stay small, as the energy does; but casters turn round, however slowly the cart moves back."""
    cart = Cart(seed, still=True)
    result = mbstab.loads(cart.text()).eig()
    assert all(abs(x.value) <= x.error_bound for x in result.eigenvalues if x.kind != "neutral")
    assert result.verdict == ("undecided" if cart.casters else "stable up to symmetry")


@pytest.mark.parametrize("spin", [0.0, 1.0, 1e4])
@pytest.mark.parametrize("off", [1e-9, 1e-3, 1.0])
def test_drives_whose_accelerations_differ_contradict_each_other_beside_whatever_turns(spin, off):
    text = (
        "mbstab: 1\nbodies:\n  a: {type: planar, mass: 1, inertia: 1}\n  b: {type: planar, mass: 1, inertia: 1}\n"
        "drives:\n"
        + "".join(
            f"  d{i}: {{type: coordinate, coordinate: a.x, position: t + {x!r}*t**2}}\n"
            for i, x in enumerate((0.0, off))
        )
        + f"reference: {{coordinates: {{a: {{x: 0}}}}, rates: {{a: {{x: 1}}, b: {{theta: {spin!r}}}}}}}\n"
    )
    with pytest.raises(ConstraintError, match="no accelerations satisfy all of them"):
        mbstab.loads(text).motion()


@pytest.mark.parametrize(("rows", "count", "rank", "holds"), [(5, 3, 4, False), (4, 6, 4, True), (5, 4, 3, False)])
def test_a_pattern_with_other_directions_than_a_point_does_not_hold_there(rows, count, rank, holds):
    """Fewer columns than the rank, no more rows than the rank, and columns of a larger rank."""
    columns = unit(np.random.default_rng(1).standard_normal((2, rows, count)))
    ranks = Ranks({"columns": rank}, points=2)
    basis = orthonormal(columns, ranks, "columns")
    assert basis.shape == (2, rows, rank)
    assert ranks.good.tolist() == [holds, holds]
    assert np.allclose(np.swapaxes(basis, 1, 2) @ basis, np.eye(rank), atol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(0, 36, 3))
def test_rounding_of_forces_that_vanish_holds_no_place_at_rest(seed):
    """Only what symmetries and speeds explain is neutral: forces that are rounding determine no manifold of rests."""
    cart = Cart(seed, still=True)
    result = mbstab.loads(cart.text()).eig()
    assert "position at rest" not in result.neutral_directions
    assert result.counts.neutral == len(result.neutral_directions)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_eigenvalues_of_a_cart_pass_zero_where_it_stands(seed):
    # They are proportional to the speed: at rest all of them are zero, and only rounding tells in which order.
    cart = Cart(seed)
    speed = repr(cart.v)
    text = cart.text().replace(f"x: {speed}", 'x: "v"').replace(f"speed: {speed}", 'speed: "v"')
    text = text.replace("mbstab: 1\n", "mbstab: 1\nparameters: {v: {value: 1.0, unit: m/s}}\n")
    found = sweep(mbstab.loads(text).model, "v", np.linspace(-1.0, 1.0, 25))
    right = int(np.sum(cart.eigenvalues().real / cart.v > 1e-9))
    left = int(np.sum(cart.eigenvalues().real / cart.v < -1e-9))
    (critical,) = found.critical
    assert critical.value == 0.0
    assert critical.kind == "divergence"
    assert critical.unstable == (left, right)
    assert len(critical.branches) == abs(left - right)


TOWED = """
mbstab: 1
title: Undamped trailer on a knife edge, towed at an elastic kingpin
parameters: {{p: 0.3, v: {{value: "{speed}"}}}}
bodies:
  W: {{type: planar, mass: {m}, inertia: {J}, points: {{K: [{a}, 0], E: [{b}, 0]}}}}
contacts: {{e: {{type: knife_edge, at: W.E, along: x}}}}
drives: {{tow: {{type: point, at: W.K, direction: x, position: v*t}}}}
forces:
  turning: {{type: expression, on: {{W.theta: -{kt}*W.theta}}}}
  lateral:
    type: expression
    on: {{W.y: "-{k}*(W.y + {a}*sin(W.theta))", W.theta: "-{k}*(W.y + {a}*sin(W.theta))*{a}*cos(W.theta)"}}
reference:
  coordinates: {{W: {{x: -{a}, y: 0, theta: 0}}}}
  rates: {{W: {{x: v, y: 0, theta: 0}}}}
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [0, 1, 2, 6, 7])
def test_trailers_with_three_eigenvalues_are_swept_through_rest(seed):
    """At rest the spectrum is symmetric and of odd size; elsewhere the verdict is that of Routh's rule."""
    rng = np.random.default_rng(seed)
    m, J, a, k, kt = 10.0 ** rng.uniform(-1, 1, size=5)
    b = a * rng.uniform(-0.5, 1.5)
    zeros, speed = [((0.0,), "p"), ((0.318, 0.367), "(p - 0.318)*(p - 0.367)*7")][seed % 2]
    model = mbstab.loads(TOWED.format(speed=speed, m=m, J=J, a=a, b=b, k=k, kt=kt))
    swept = model.sweep("p", np.linspace(-1.0, 1.0, 11 + seed // 2))

    d = a - b

    def unstable(p: float) -> int:
        v = p if seed % 2 == 0 else (p - 0.318) * (p - 0.367) * 7
        roots = np.roots([m * b * b + J, -m * b * v, d * d * k + kt, d * k * v])
        return int(np.sum(roots.real > 0.0))

    assert all(unstable(p) == n for p, n in zip(swept.values, swept.unstable, strict=True) if p not in zeros)
    for zero in zeros:
        beside = [c for c in swept.critical if abs(c.value - zero) < 1e-9]
        assert [beside[0].unstable[0], beside[-1].unstable[1]] == [unstable(zero - 1e-4), unstable(zero + 1e-4)]
    assert all(min(abs(c.value - zero) for zero in zeros) < 1e-9 for c in swept.critical)


# --- cars on tyres at extremes, against their linear equations in 40 digits, and proven -------------------------------
# Place, heading and speed are neutral.


def a_car(seed):
    """Return the text of a car that rolls freely, and the matrix of its speeds across, its yaw rate and its slips."""
    rng = random.Random(seed)

    def size(low, high):
        return 10.0 ** rng.uniform(low, high)

    m, inertia, a, b, u = size(-3, 6), size(-3, 6), size(-2, 1), size(-2, 1), size(-1, 2)
    relaxed = rng.random() < 0.5
    n = 4 if relaxed else 2
    A, tyres = mpmath.zeros(n), []
    A[0, 1] = -mpmath.mpf(u)
    for i, (point, x) in enumerate((("f", mpmath.mpf(a)), ("r", -mpmath.mpf(b)))):
        C, K, t, sigma = size(0, 6), size(-3, 5), size(-4, -1), size(-2, 1)
        text = f"type: tyre, at: c.{point}, cornering_stiffness: {C!r}, trail: {t!r}, aligning_stiffness: {K!r}"
        if rng.random() < 0.5:
            peak, shape, curvature = size(0, 4), rng.uniform(0.5, 3.0), rng.uniform(-3.0, 1.0)
            text += f", aligning_peak: {peak!r}, aligning_shape_factor: {shape!r}"
            text += f", aligning_curvature_factor: {curvature!r}"
        tyres.append(f"{{{text}{f', relaxation_length: {sigma!r}' if relaxed else ''}}}")
        slip = [1 / mpmath.mpf(u), x / u]
        force, moment = -mpmath.mpf(C), -x * C + mpmath.mpf(t) * C + K
        if relaxed:
            A[0, 2 + i], A[1, 2 + i] = force / m, moment / inertia
            A[2 + i, 0], A[2 + i, 1] = (y * u / sigma for y in slip)
            A[2 + i, 2 + i] = -mpmath.mpf(u) / sigma
        else:
            for k in range(2):
                A[0, k] += force * slip[k] / m
                A[1, k] += moment * slip[k] / inertia
    body = f"{{type: planar, mass: {m!r}, inertia: {inertia!r}, points: {{f: [{a!r}, 0], r: [{-b!r}, 0]}}}}"
    return (
        f"mbstab: 1\nbodies: {{c: {body}}}\nforces:\n  f: {tyres[0]}\n  r: {tyres[1]}\n"
        f"reference: {{coordinates: {{c: {{x: 0, y: 0, theta: 0}}}}, rates: {{c: {{x: {u!r}}}}}}}\n"
    ), A


@pytest.mark.parametrize("seed", range(80))
def test_a_free_car_is_judged_as_its_linear_equations_are(seed):
    with mpmath.workdps(40):
        text, A = a_car(seed)
        expected = list(mpmath.eig(A, left=False, right=False))
        found = mbstab.loads(text).eig()
        growing = any(x.real > 0 for x in expected)
        assert found.verdict == ("unstable" if growing else "asymptotically stable up to symmetry")
        certificate = mbstab.loads(text).certify()
        assert (certificate.status, certificate.verdict) == ("proven", found.verdict)
        left = [x for x in found.eigenvalues if x.kind != "neutral"]
        assert len(left) == len(expected)
        for x in left:
            distance = min(abs(mpmath.mpc(x.value) - y) for y in expected)
            assert distance <= x.error_bound + 4e-16 * abs(x.value)


def test_all_speeds_of_a_free_car_have_the_structure_of_one_of_them():
    """It may roll on at any speed, but not sideways; the eigenvalues are those of the single-track model."""
    m, inertia, C, a, b = 1700.0, 3500.0, 8e4, 1.7, 1.2
    text = (
        "mbstab: 1\nparameters: {u: 20.0}\n"
        f"bodies: {{c: {{type: planar, mass: {m}, inertia: {inertia}, points: {{f: [{a}, 0], r: [{-b}, 0]}}}}}}\n"
        f"forces:\n  f: {{type: tyre, at: c.f, cornering_stiffness: {C}}}\n"
        f"  r: {{type: tyre, at: c.r, cornering_stiffness: {C}}}\n"
        "reference: {coordinates: {c: {x: 0, y: 0, theta: 0}}, rates: {c: {x: u}}}\n"
    )
    speeds, evaluator = np.linspace(5.0, 60.0, 12), Evaluator(mbstab.loads(text).model)
    found = evaluator.near({"u": speeds}, 2)
    assert evaluator.alone == 1
    for u, values in zip(speeds, found.values, strict=True):
        A = [
            [-2 * C / (m * u), -u - C * (a - b) / (m * u)],
            [-C * (a - b) / (inertia * u), -C * (a * a + b * b) / (inertia * u)],
        ]
        assert np.sort_complex(values) == pytest.approx(np.sort_complex(np.linalg.eigvals(A)), rel=1e-12)


def test_a_car_that_a_force_brakes_is_not_proven_to_roll_at_any_speed():
    """However weak the force is, which vanishes at the speed of the reference."""
    text = re.sub(r"rates: {c: {x: [^}]*", "rates: {c: {x: 20", a_car(1)[0])
    for drag, finding in (
        ("", "structural"),
        ("  drag: {type: expression, on: {c.x: -1e-30*(rate(c.x) - 20)**3}}\n", "refuted"),
    ):
        proof = Proof(mbstab.loads(text.replace("reference:", f"{drag}reference:")).model, {})
        (along,) = (x for x in proof.identities.invariance.symmetries if x.name == "c.x")
        assert proof.identities.at_any_speed(along) == finding


STEERED = """
mbstab: 1
title: Car whose front wheel without mass the driver holds at a constant angle to it
parameters: {{v: 20, a: 1.2, b: 1.0, C: 80000, m: 1500}}
bodies:
  car: {{type: planar, mass: m, inertia: 2500, points: {{front: [a, 0], rear: [-b, 0]}}}}
  wheel: {{type: planar, mass: 0, inertia: 0}}
joints: {{king: {{type: revolute, between: [wheel, car.front]}}}}
constraints:
  cruise: {{nonholonomic: vx(car) - v}}
  driver: {{nonholonomic: rate(angle(king))}}
forces:
  front: {{type: tyre, at: wheel, cornering_stiffness: C}}
  rear: {{type: tyre, at: car.rear, cornering_stiffness: C}}
reference:
  coordinates: {{car: {{x: 0, y: 0, theta: 0}}, wheel: {{theta: 0}}}}
  rates: {{car: {{x: v, y: 0, theta: 0}}, wheel: {{theta: 0}}}}
""".format()


@pytest.mark.long
def test_the_zero_of_a_held_steering_angle_is_neutral_whatever_else_grows():
    """Each angle of the steering is a circle of its own, on both sides of the speed √(C (a + b)²/(m (a − b)))."""
    car = mbstab.loads(STEERED)
    critical = np.sqrt(80000 * 2.2**2 / (1500 * 0.2))
    for v, word in ((0.6 * critical, "asymptotically stable up to symmetry"), (1.6 * critical, "unstable")):
        found = car.eig(v=v)
        assert (found.verdict, found.counts.neutral) == (word, 4)
        assert all(e.kind != "undecided" for e in found.eigenvalues)
        assert (
            any("motions of the same kind" in name for name in found.neutral_directions)
            or len(found.neutral_directions) == 4
        )
    (change,) = car.sweep("v", np.linspace(5.0, 60.0, 12)).critical
    assert (change.kind, change.unstable) == ("divergence", (0, 1))
    assert change.value == pytest.approx(critical, rel=1e-11)
