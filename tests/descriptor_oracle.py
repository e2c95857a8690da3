"""Random linear systems with first-order states, rows of constraints and motions without mass, and their truth.

The unknowns x = (q, v, z, λ) obey E x' = A x with rational entries, of which E is singular. The finite part is
separated exactly: with s no eigenvalue, W = (s E − A)⁻¹ E has the same vectors, and its image under high powers leaves
out what is infinite. Nothing here shares code with mbstab; integers and fractions are those of FLINT.
"""

from dataclasses import dataclass
from fractions import Fraction

from flint import ctx, fmpq, fmpq_mat, fmpq_poly

AS, AS_UP_TO = "asymptotically stable", "asymptotically stable up to symmetry"
S, S_UP_TO = "stable", "stable up to symmetry"
M, U, OPEN = "marginally stable", "unstable", "undecided"

NAMES = (("p.x",), ("p.x", "p.y"), ("p.x", "p.y", "p.z"), ("p.x", "p.y", "q.x", "q.y"))


# --- exact linear algebra -------------------------------------------------------------------------------------------


def rational(rows):
    """Return a matrix of fractions."""
    numbers = [Fraction(x) for row in rows for x in row]
    return fmpq_mat(len(rows), len(rows[0]), [fmpq(x.numerator, x.denominator) for x in numbers])


def identity(n):
    return rational([[int(i == j) for j in range(n)] for i in range(n)])


def finite_part(E, A):
    """Return the matrix of the finite eigenvalues of s E − A; None if this is singular for all s."""
    n = E.nrows()
    shift = next((s for s in (3, 5, 7, 11, 13, 17) if (E * s - A).det() != 0), None)
    if shift is None:
        return None
    W = (E * shift - A).inv() * E
    power, exponent = W, 1
    while exponent < n:
        power, exponent = power * power, 2 * exponent
    R, rank = power.transpose().rref()
    if not rank:
        return fmpq_mat(0, 0)
    B = fmpq_mat(rank, n, [R[i, j] for i in range(rank) for j in range(n)]).transpose()
    X = (B.transpose() * B).inv() * (B.transpose() * (W * B))
    return identity(rank) * shift - X.inv()


@dataclass(frozen=True)
class Truth:
    """What is true of x' = A x: its eigenvalues, the verdicts that are true, and what a verdict up to symmetry means.

    Steady motions are those with A² x = 0; one that stays near them has no chain of three zeros.
    """

    eigenvalues: tuple[complex, ...]
    zeros: int
    allowed: frozenset[str]
    word: str
    in_place: bool


def truth(A):
    """Return what is true of the stability of x' = A x."""
    n = A.nrows()
    coefficients = A.charpoly().coeffs() if n else [fmpq(1)]
    zeros = next(i for i, c in enumerate(coefficients) if c != 0)
    ctx.prec = 400
    roots = [(s, m) for s, m in fmpq_poly(coefficients[zeros:]).complex_roots()] if zeros < n else []
    values = [complex(float(s.real.mid()), float(s.imag.mid())) for s, m in roots for _ in range(m)]
    right = any(s.real > 0 for s, _ in roots)
    axis = any(not (s.real > 0 or s.real < 0) for s, _ in roots)
    single, double = (n - X.rank() == zeros if n else True for X in (A, A * A))
    if right or not double or (axis and _repeated_on_axis(A)):
        word, allowed = U, {U, OPEN}
    elif axis:
        word, allowed = (S if single else S_UP_TO), {S_UP_TO, M, OPEN} | ({S} if single else set())
    elif zeros:
        word, allowed = AS_UP_TO, {AS_UP_TO, S_UP_TO, M, OPEN} | ({S} if single else set())
    else:
        word, allowed = AS, {AS, AS_UP_TO, S, S_UP_TO, M, OPEN}
    return Truth((*values, *[0j] * zeros), zeros, frozenset(allowed), word, single)


def _repeated_on_axis(A):
    """Whether a nonzero eigenvalue on the axis has fewer vectors than its multiplicity."""
    coefficients = A.minpoly().coeffs()
    p = fmpq_poly(coefficients[next(i for i, c in enumerate(coefficients) if c != 0) :])
    repeated = p.gcd(p.derivative())
    return any(not (s.real > 0 or s.real < 0) for s, _ in repeated.complex_roots()) if repeated.degree() > 0 else False


# --- systems --------------------------------------------------------------------------------------------------------


@dataclass
class Descriptor:
    """M q″ + D q′ + K q + L z + C′λ = 0, z′ = G q + H q′ + J z, C q′ + B q + F z = 0, P q = 0 (P with its own λ)."""

    masses: list
    K: list
    D: list
    L: list
    G: list
    H: list
    J: list
    C: list
    B: list
    F: list
    P: list

    @property
    def names(self):
        return NAMES[len(self.K) - 1]

    def text(self):
        """Return the model file."""
        q, u, z = self.names, [f"rate({x})" for x in self.names], [f"z{i}" for i in range(len(self.G))]
        quoted = [_sum((self.K[i], q, -1), (self.D[i], u, -1), (self.L[i], z, -1)) for i in range(len(q))]
        laws = ", ".join(f"{x}: {law!r}" for x, law in zip(q, quoted, strict=True) if law != "0")
        rates = [_sum((g, q, 1), (h, u, 1), (j, z, 1)) for g, h, j in zip(self.G, self.H, self.J, strict=True)]
        rows = [_sum((c, u, 1), (b, q, 1), (f, z, 1)) for c, b, f in zip(self.C, self.B, self.F, strict=True)]
        entries = [f"n{i}: {{nonholonomic: {row!r}}}" for i, row in enumerate(rows)]
        entries += [f"h{i}: {{holonomic: {_sum((row, q, 1))!r}}}" for i, row in enumerate(self.P)]
        entries += ["rail: {holonomic: p.y}"] if len(q) == 1 else []
        space = len(q) == 3
        bodies = [f"p: {{type: {'point' if space else 'planar_point'}, mass: {self.masses[0]}}}"]
        places = [f"p: {{x: 0, y: 0{', z: 0' if space else ''}}}"]
        if len(q) == 4:
            bodies.append(f"q: {{type: planar_point, mass: {self.masses[-1]}}}")
            places.append("q: {x: 0, y: 0}")
        sections = {
            "bodies": ", ".join(bodies),
            "states": ", ".join(f"{x}: {{rate: {rate!r}}}" for x, rate in zip(z, rates, strict=True)),
            "forces": f"law: {{type: expression, on: {{{laws}}}}}" if laws else "",
            "constraints": ", ".join(entries),
            "reference": f"coordinates: {{{', '.join(places)}}}",
        }
        return "mbstab: 1\n" + "".join(f"{name}: {{{text}}}\n" for name, text in sections.items() if text)

    def pencil(self):
        """Return E and A of E x' = A x; rows that others imply are left out."""
        n, m, P = len(self.K), len(self.G), []
        for row in self.P:
            P += [row] if rational([*P, row]).rank() > len(P) else []
        known, kept = [[*row, *[0] * (n + m)] for row in P], []
        for row in zip(self.C, self.B, self.F, strict=True):
            full = [*known, [x for part in row for x in part]]
            if rational(full).rank() == len(full):
                known, kept = full, [*kept, row]
        k, h = len(kept), len(P)
        size = 2 * n + m + k + h
        E, A = ([[Fraction(0)] * size for _ in range(size)] for _ in range(2))

        def put(i, j, block, sign=1):
            for a, row in enumerate(block):
                for b, x in enumerate(row):
                    A[i + a][j + b] += sign * x

        for i in range(n):
            E[i][i], E[n + i][n + i], A[i][n + i] = 1, Fraction(self.masses[i]), 1
        for i in range(m):
            E[2 * n + i][2 * n + i] = 1
        for j, block in ((0, self.K), (n, self.D), (2 * n, self.L)):
            put(n, j, block, -1)
        for j, block in ((0, self.G), (n, self.H), (2 * n, self.J)):
            put(2 * n, j, block)
        C, B, F = ([row[part] for row in kept] for part in range(3))
        last = 2 * n + m
        for j, block in ((n, C), (0, B), (2 * n, F)):
            put(last, j, block)
        put(last + k, 0, P)
        for a, row in enumerate([*C, *P]):
            for i, x in enumerate(row):
                A[n + i][last + a] -= x
        return rational(E), rational(A)


def _sum(*parts):
    terms = [f"{sign * c:+}*{x}" for numbers, names, sign in parts for c, x in zip(numbers, names, strict=True) if c]
    return "".join(terms) or "0"


def random_descriptor(rng, massless=0.2):
    """Return a random system of up to four coordinates, two states and three rows."""
    n = rng.choice((1, 2, 2, 3, 4, 4))
    K, D = rng.choice((_any, _potential, _turning, _damped, _circulatory))(rng, n)
    m, rows = rng.choice((0, 1, 1, 2)), rng.choice((0, 0, 1, 1, 2)) if n > 2 else rng.choice((0, 0, n - 1))
    each = [rng.choice((1, 1, 1, 2, "1/2", 3)) for _ in range(2)]
    if rng.random() < massless:
        each[rng.randrange(2)] = 0
    few = (-1, 0, 0, 0, 1)
    return Descriptor(
        masses=[each[i // 2 if n == 4 else 0] for i in range(n)],
        K=K,
        D=D,
        L=_numbers(rng, n, m, few) if rng.random() < 0.8 else _none(n, m),
        G=_numbers(rng, m, n, few),
        H=_numbers(rng, m, n, few) if rng.random() < 0.5 else _none(m, n),
        J=_numbers(rng, m, m, (-2, -1, -1, 0, 0, 1)),
        C=_numbers(rng, rows, n, few),
        B=_numbers(rng, rows, n, few) if rng.random() < 0.4 else _none(rows, n),
        F=_numbers(rng, rows, m, few) if rng.random() < 0.2 else _none(rows, m),
        P=_numbers(rng, rng.choice((0, 0, 0, 1)) if n - rows > 1 else 0, n, few),
    )


def _numbers(rng, n, m, values=(-2, -1, 0, 0, 0, 1, 2)):
    return [[rng.choice(values) for _ in range(m)] for _ in range(n)]


def _none(n, m):
    return [[0] * m for _ in range(n)]


def _square(rng, n):
    B = _numbers(rng, n, n, (-1, 0, 0, 1))
    return [[sum(B[k][i] * B[k][j] for k in range(n)) for j in range(n)] for i in range(n)]


def _skew(rng, n):
    B = _numbers(rng, n, n)
    return [[B[i][j] - B[j][i] for j in range(n)] for i in range(n)]


def _plus(A, B):
    return [[a + b for a, b in zip(x, y, strict=True)] for x, y in zip(A, B, strict=True)]


def _any(rng, n):
    return _numbers(rng, n, n), _numbers(rng, n, n)


def _potential(rng, n):
    return _square(rng, n), _none(n, n)


def _turning(rng, n):
    return _square(rng, n), _skew(rng, n)


def _damped(rng, n):
    return _square(rng, n), _square(rng, n)


def _circulatory(rng, n):
    return _plus(_square(rng, n), _skew(rng, n)), _square(rng, n) if rng.random() < 0.5 else _none(n, n)
