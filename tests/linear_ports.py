"""Random linear systems with an input and an output, as model files in several guises, and what is exactly true.

The equations are those of masses along a line, M x″ + C x′ + K x = F z + e w, with states z′ = A₀ x + A₁ x′ + A₂ z.
Each guise adds coordinates, rows, a turning frame or neutral directions, and leaves the transfer function as it is.
Nothing of what is true comes from mbstab: numerators and denominators are determinants of rational numbers (flint).
"""

import random
from dataclasses import dataclass, replace
from fractions import Fraction

from mpmath import mp, mpc, mpf

GUISES = ("plain", "neutral", "redundant", "turning", "nonholonomic")
SPEED = 3
"""Of the turning frame (rad/s)."""


@dataclass(frozen=True)
class Ports:
    """A system: numbers as decimal texts by name, such as ``m0``, ``k01``, ``c10``, ``f0_1``, ``a0_1``, ``b0_1``.

    The input acts on mass `at`; the output is the sum of `seen`: positions (0), rates (1), accelerations (2), each with
    its number and its factor.
    """

    n: int
    states: int
    numbers: dict[str, str]
    at: int
    seen: tuple[tuple[int, int, str], ...]

    def value(self, name):
        return Fraction(self.numbers.get(name, "0"))

    def coefficients(self, i, j):
        """Return the polynomial in s in row i and column j, lowest first."""
        n = self.n
        if i < n and j < n:
            return [self.value(f"k{i}{j}"), self.value(f"c{i}{j}"), self.value(f"m{i}") * (i == j)]
        if i < n:
            return [-self.value(f"f{i}_{j - n}")]
        if j < n:
            return [-self.value(f"a{i - n}_{j}"), -self.value(f"b{i - n}_{j}")]
        return [-self.value(f"d{i - n}{j - n}"), Fraction(i == j)]

    def row(self, j):
        """Return the polynomial of the output by variable j."""
        found = [Fraction(0)] * 3
        for place, order, number in self.seen:
            if place == j:
                found[order] += Fraction(number)
        return found

    def truth(self):
        """Return the exact transfer function."""
        size = self.n + self.states
        P = [[self.coefficients(i, j) for j in range(size)] for i in range(size)]
        bordered = [[*line, [Fraction(-(i == self.at))]] for i, line in enumerate(P)]
        return Truth(determinant([*bordered, [*map(self.row, range(size)), [Fraction(0)]]]), determinant(P))

    def characteristic(self, **changed):
        """Return the characteristic polynomial, with some numbers changed."""
        size, own = self.n + self.states, replace(self, numbers=self.numbers | changed)
        return determinant([[own.coefficients(i, j) for j in range(size)] for i in range(size)])

    def slope(self, s, name):
        """Return dλ/dp of a simple eigenvalue, from polynomials that differ by 1e-30 of the number."""
        step = self.value(name) / 10**30
        ahead, behind = (self.characteristic(**{name: str(self.value(name) + x)}) for x in (step, -step))
        change = (_value(ahead, s) - _value(behind, s)) / (2 * mp.mpf(step.numerator) / step.denominator)
        return -change / _value(self.characteristic().derivative(), s)

    def text(self, guise="plain"):
        """Return the model file; in a turning frame the stiffness makes up for the centrifugal force."""
        n, turning = self.n, guise == "turning"
        x = [f"displacement(rail{i})" if turning else f"b{i}.x" for i in range(n)]
        z = [f"z{j}" for j in range(self.states)]
        laws = []
        for i in range(n):
            terms = self._sum("-k{}{}*{}", i, x) + self._sum("-c{}{}*rate({})", i, x) + self._sum("+f{}_{}*{}", i, z)
            terms += f" -m{i}*Omega**2*{x[i]}" if turning else ""
            laws.append(f"  f{i}: {{type: expression, on: {{{x[i]}: 0{terms}}}}}")
        rates = []
        for i in range(self.states):
            terms = self._sum("+a{}_{}*{}", i, x) + self._sum("+b{}_{}*rate({})", i, x) + self._sum("+d{}{}*{}", i, z)
            rates.append(f"  z{i}: {{rate: 0{terms}}}")
        names = [*x, *z]
        kinds = ("{}", "rate({})", "acceleration({})")
        seen = " ".join(f"+({number})*{kinds[order].format(names[j])}" for j, order, number in self.seen)
        push = f"{{type: joint, joint: rail{self.at}}}" if turning else f"{{type: force, at: b{self.at}, direction: x}}"
        lines = ["mbstab: 1", "parameters:", *(f"  {name}: {number}" for name, number in self.numbers.items())]
        lines += [f"  Omega: {SPEED}"] if turning else []
        lines += [*_scene(guise, n), "forces:", *laws, *(["states:", *rates] if rates else [])]
        return "\n".join([*lines, f"inputs: {{w: {push}}}", f"outputs: {{y: {seen}}}", ""])

    def _sum(self, term, i, names):
        """Return the terms of row i whose numbers are there, such as `` -k01*b1.x``."""
        found = [(term.format(i, j, name), term[1:].split("*")[0].format(i, j)) for j, name in enumerate(names)]
        return "".join(f" {text}" for text, number in found if number in self.numbers)


def _scene(guise, n):
    """Return the lines of bodies, rows and reference."""
    each = range(n)
    if guise == "turning":
        lines = ["bodies:", "  hub: {type: planar, mass: 1, inertia: 2}"]
        lines += [f"  b{i}: {{type: planar, mass: m{i}, inertia: 0.3}}" for i in each]
        lines += ["joints:", "  axle: {type: revolute, between: [hub, ground]}"]
        lines += [f"  rail{i}: {{type: prismatic, between: [b{i}, hub], axis: x}}" for i in each]
        lines += ["drives: {motor: {type: joint, joint: axle, velocity: Omega}}", "reference:"]
        lines += ["  coordinates: {hub: {x: 0, y: 0, theta: 0}, " + ", ".join(f"b{i}: {{x: 0}}" for i in each) + "}"]
        return [*lines, "  rates: {hub: {theta: Omega}}", "  steady: {axis: z, rate: Omega}"]
    if guise == "nonholonomic":
        lines = ["bodies:", *(f"  b{i}: {{type: planar, mass: m{i}, inertia: 0.3}}" for i in each), "contacts:"]
        return [*lines, *(f"  edge{i}: {{type: knife_edge, at: b{i}, along: x}}" for i in each), "reference: {}"]
    lines = ["bodies:", *(f"  b{i}: {{type: planar_point, mass: m{i}}}" for i in each)]
    lines += ["  free: {type: planar_point, mass: 2}"] if guise == "neutral" else []
    lines += ["constraints:", *(f"  l{i}: {{holonomic: b{i}.y}}" for i in each)]
    if guise == "redundant":
        lines += [f"  again{i}: {{holonomic: 2*b{i}.y + b{(i + 1) % n}.y}}" for i in each]
    return [*lines, "reference: {}"]


def ports(seed, span, states=2):
    """Return a random system whose numbers are 10**-span to 10**span: chains, symmetric ones, full and sparse ones."""
    rng = random.Random(seed)
    n, numbers = rng.randint(1, 3), {}
    style = rng.choice(["chain", "symmetric", "full", "sparse"])

    def size():
        return f"{10 ** rng.uniform(-span, span):.3g}"

    def signed():
        return f"{float(size()) * rng.choice([-1, 1]):.3g}"

    def put(name, number):
        if Fraction(number):
            numbers[name] = str(number)

    for i in range(n):
        put(f"m{i}", numbers["m0"] if style == "symmetric" and i else size())
    if style in ("chain", "symmetric"):
        _chain(rng, n, style == "symmetric", size, put)
    else:
        part = 0.8 if style == "full" else 0.35
        for kind, share, i, j in (
            (*x, i, j) for i in range(n) for j in range(n) for x in (("k", part), ("c", 0.6 * part))
        ):
            if i == j or rng.random() < share:
                put(f"{kind}{i}{j}", size() if i == j and rng.random() < 0.8 else signed())
    count = rng.randint(0, states)
    for i in range(count):
        put(f"d{i}{i}", f"-{size()}" if rng.random() < 0.8 else size())
        for j in range(n):
            for kind, share in (("a", 0.5), ("b", 0.3)):
                if rng.random() < share:
                    put(f"{kind}{i}_{j}", signed())
            if rng.random() < 0.5:
                put(f"f{j}_{i}", signed())
    seen = [(rng.randrange(n + count), 0, "1")]
    if rng.random() < 0.5:
        seen = [(rng.randrange(n), rng.choice([0, 1, 1, 2]), signed()) for _ in range(rng.randint(1, 2))]
    return Ports(n, count, numbers, rng.randrange(n), tuple(seen))


def _chain(rng, n, symmetric, size, put):
    """Put springs and dampers between neighbours and at both ends."""
    for kind, part in (("k", 0.9), ("c", 0.7)):
        x = [Fraction(size()) * (rng.random() < part) for _ in range(n + 1)]
        x = [x[0], *[x[1]] * (n - 1), x[0]] if symmetric else x
        for i in range(n):
            put(f"{kind}{i}{i}", _decimal(x[i] + x[i + 1]))
            if i + 1 < n:
                put(f"{kind}{i}{i + 1}", _decimal(-x[i + 1]))
                put(f"{kind}{i + 1}{i}", _decimal(-x[i + 1]))


def _decimal(x):
    """Return a sum of decimals as a decimal text."""
    return f"{x.numerator / x.denominator:.17g}" if Fraction(f"{x.numerator / x.denominator:.17g}") == x else _long(x)


def _long(x):
    digits = next(k for k in range(60) if (x * 10**k).denominator == 1)
    return f"{(x * 10**digits).numerator}e-{digits}"


# --- what is true ---------------------------------------------------------------------------------------------------


def determinant(entries):
    """Return the determinant of a matrix of polynomials, lowest coefficient first, by interpolation."""
    from flint import fmpq, fmpq_mat, fmpq_poly

    def number(x):
        return fmpq(x.numerator, x.denominator)

    degree = sum(max(len(x) - 1 for x in line) for line in entries)
    points, size = range(degree + 1), len(entries)
    found = [
        fmpq_mat(size, size, [number(sum(c * x**k for k, c in enumerate(e))) for line in entries for e in line]).det()
        for x in points
    ]
    for j in points[1:]:
        for i in reversed(points[j:]):
            found[i] = (found[i] - found[i - 1]) / j
    total = fmpq_poly([0])
    for i in reversed(points):
        total = total * fmpq_poly([-i, 1]) + found[i]
    return total


@mp.workdps(60)
def roots(polynomial):
    """Return all roots, each as often as it is one, to 60 digits; parts that are zero exactly so."""
    import flint

    if polynomial.degree() <= 0:
        return []
    flint.ctx.prec = 300

    def part(ball):
        mantissa, exponent = ball.mid().man_exp()
        return mpf(0) if ball.contains(0) else mp.ldexp(mpf(int(mantissa)), int(exponent))

    with mp.workdps(60):
        return [
            mpc(part(x.real), part(x.imag)) for x, many in polynomial.numer().complex_roots() for _ in range(int(many))
        ]


class Truth:
    """A transfer function N(s)/D(s), both with what they have in common."""

    def __init__(self, N, D):
        self.common = D if N == 0 else N.gcd(D)
        self.vanishes, self.n, self.d = N == 0, N // self.common, D // self.common
        self.zeros, self.poles, self.hidden = map(roots, (self.n, self.d, self.common))

    @mp.workdps(60)
    def at(self, s):
        """Return G(s)."""
        return _value(self.n, s) / _value(self.d, s)

    @mp.workdps(60)
    def closed(self):
        """Return the roots of N + D without what is hidden."""
        return roots(self.n + self.d)

    @mp.workdps(60)
    def _on_axis(self, polynomial):
        """Return real and imaginary part of a polynomial of iω, as polynomials of ω."""
        from flint import fmpq_poly

        signs = ((1, 0), (0, 1), (-1, 0), (0, -1))
        c = polynomial.coeffs()
        return [fmpq_poly([x * signs[k % 4][part] for k, x in enumerate(c)]) for part in (0, 1)]

    @mp.workdps(60)
    def gain_crossings(self):
        """Return the frequencies at which |G| passes 1."""
        (a, b), (c, d) = map(self._on_axis, (self.n, self.d))
        return _passed(a * a + b * b - c * c - d * d)

    @mp.workdps(60)
    def phase_crossings(self):
        """Return frequencies and gains -1/G where G is real and negative, or None if it is real everywhere."""
        (a, b), (c, d) = map(self._on_axis, (self.n, self.d))
        if b * c == a * d:
            return None
        undamped = [abs(p.imag) for p in self.poles if p.real == 0]
        found = [w for w in _passed(b * c - a * d, odd=False) if all(abs(w - x) > 1e-30 * x for x in undamped)]
        if all(p(0) != 0 for p in (self.n, self.d)):
            found = [mpf(0), *found]
        gains = [self.at(mpc(0, w)) for w in found]
        return [
            (w, -1 / g.real) for w, g in zip(found, gains, strict=True) if g.real < 0 and abs(g.imag) < 1e-30 * abs(g)
        ]

    @mp.workdps(60)
    def largest(self):
        """Return the largest gain; None: there is none, infinity: it grows without limit."""
        if any(p.real >= 0 for p in self.poles):
            return None
        (a, b), (c, d) = map(self._on_axis, (self.n, self.d))
        above, below = a * a + b * b, c * c + d * d
        if above.degree() > below.degree():
            return mp.inf
        slope = above.derivative() * below - above * below.derivative()
        return max(abs(self.at(mpc(0, w))) for w in [mpf(0), mpf(10) ** 40, *_passed(slope, odd=False)])


def _value(polynomial, s):
    found = mpc(0)
    for c in reversed(polynomial.coeffs()):
        found = found * s + mpf(int(c.p)) / int(c.q)
    return found


def _passed(polynomial, odd=True):
    """Return positive real roots, those of odd multiplicity or all."""
    real = [x.real for x in roots(polynomial) if x.imag == 0 and x.real > 0]
    return sorted(x for x in set(real) if not odd or real.count(x) % 2)
