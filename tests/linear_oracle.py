"""Random linear systems q″ + D q′ + K q = 0 with small integers, and what is true of their stability, exactly.

Nothing here shares code with mbstab: characteristic polynomials, greatest common divisors, Sturm's and Routh's
criteria and ranks are computed with integers and fractions.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

AS, AS_UP_TO = "asymptotically stable", "asymptotically stable up to symmetry"
S, S_UP_TO = "stable", "stable up to symmetry"
M, U, OPEN = "marginally stable", "unstable", "undecided"


# --- polynomials, highest coefficient first -------------------------------------------------------------------------


def trimmed(p):
    """Return a polynomial without leading zeros, monic; the zero polynomial is empty."""
    start = next((i for i, c in enumerate(p) if c), len(p))
    return [Fraction(c) / p[start] for c in p[start:]]


def divided(p, q):
    """Return quotient and remainder."""
    quotient, rest = [], [Fraction(c) for c in p]
    for _ in range(len(p) - len(q) + 1):
        factor = rest[0] / q[0]
        quotient.append(factor)
        for i, c in enumerate(q):
            rest[i] -= factor * c
        rest.pop(0)
    return quotient, rest


def common(p, q):
    """Return the greatest common divisor, monic."""
    p, q = trimmed(p), trimmed(q)
    while q:
        p, q = q, trimmed(divided(p, q)[1] if len(p) >= len(q) else p)
    return p


def derivative(p):
    n = len(p) - 1
    return [c * (n - i) for i, c in enumerate(p[:-1])]


def distinct(p):
    """Return square-free factors with their multiplicities (Yun's algorithm)."""
    p, found, multiplicity = trimmed(p), [], 1
    repeated = common(p, derivative(p)) if len(p) > 1 else p
    simple = divided(p, repeated)[0]
    while len(simple) > 1:
        further = common(simple, repeated)
        factor = divided(simple, further)[0]
        if len(factor) > 1:
            found.append((factor, multiplicity))
        repeated, simple, multiplicity = divided(repeated, further)[0], further, multiplicity + 1
    return found


def negative_roots(p):
    """Return the number of negative roots of a square-free polynomial with p(0) ≠ 0 (Sturm)."""
    chain = [p, derivative(p)]
    while len(chain[-1]) > 1:
        rest = [-c for c in divided(chain[-2], chain[-1])[1]]
        start = next(i for i, c in enumerate(rest) if c)
        chain.append(rest[start:])
    far = [f[0] * (-1) ** (len(f) - 1) for f in chain]
    return changes(far) - changes([f[-1] for f in chain])


def changes(values):
    """Return the number of changes of sign."""
    signs = [v > 0 for v in values if v]
    return sum(a != b for a, b in pairwise(signs))


def all_left(p):
    """Whether all roots have negative real parts (Routh)."""
    upper, lower = [Fraction(c) for c in p[::2]], [Fraction(c) for c in p[1::2]]
    if upper[0] < 0:
        upper, lower = [-c for c in upper], [-c for c in lower]
    for _ in range(len(p) - 1):
        if not lower or lower[0] <= 0:
            return False
        padded = lower[1:] + [Fraction(0)] * (len(upper) - len(lower))
        factor = upper[0] / lower[0]
        upper, lower = lower, [a - factor * b for a, b in zip(upper[1:], padded, strict=True)]
    return True


# --- matrices -------------------------------------------------------------------------------------------------------


def product(A, B):
    return [[sum(a * b for a, b in zip(row, column, strict=True)) for column in zip(*B, strict=True)] for row in A]


def identity(n):
    return [[int(i == j) for j in range(n)] for i in range(n)]


def characteristic(A):
    """Return det(s − A) (Faddeev and LeVerrier)."""
    n, p, B = len(A), [1], identity(len(A))
    for k in range(1, n + 1):
        AB = product(A, B)
        p.append(-sum(AB[i][i] for i in range(n)) // k)
        B = [[AB[i][j] + (p[-1] if i == j else 0) for j in range(n)] for i in range(n)]
    return p


def nullity(A):
    """Return the dimension of the null space."""
    rows, rank = [[Fraction(x) for x in row] for row in A], 0
    for column in range(len(A)):
        pivot = next((i for i in range(rank, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for i in range(rank + 1, len(rows)):
            factor = rows[i][column] / rows[rank][column]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[rank], strict=True)]
        rank += 1
    return len(A) - rank


def evaluated(p, A):
    """Return the matrix p(A)."""
    n = len(A)
    result = [[0] * n for _ in range(n)]
    for c in p:
        result = product(result, A)
        for i in range(n):
            result[i][i] += c
    return result


def symmetric(A):
    return [list(row) for row in zip(*A, strict=True)] == A


def never_negative(A):
    """Whether the quadratic form of a matrix is never negative."""
    twice = [[A[i][j] + A[j][i] for j in range(len(A))] for i in range(len(A))]
    return all(c * (-1) ** i >= 0 for i, c in enumerate(characteristic(twice)))


# --- truth ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """What is true of a linear system.

    G are the shifts along the null space of K, P the motions that stand still up to G: T is the null space of A².

    Attributes
    ----------
    allowed : frozenset of str
        All verdicts that are true.
    expected : str
        What eigenvalues, energy and reversibility of A tell.
    kind : str
        The same in more detail.
    neutral : int
        Dimension of T.
    in_place : bool
        Whether disturbances along T stay what they are.
    """

    allowed: frozenset[str]
    expected: str
    kind: str
    neutral: int
    in_place: bool


def truth(K, D):
    """Return what is true of q″ + D q′ + K q = 0."""
    n = len(K)
    A = [[0] * n + row for row in identity(n)]
    A += [[-x for x in K[i]] + [-x for x in D[i]] for i in range(n)]
    squared = product(A, A)
    zeros = [nullity(power) for power in (A, squared, product(A, squared))]
    # A shift that is not along a coordinate does not show in single terms of the laws.
    oblique = ", oblique shifts" if nullity(K) > sum(not any(column) for column in zip(*K, strict=True)) else ""
    p = characteristic(A)
    while p[-1] == 0:
        p.pop()
    even, odd = ([c for i, c in enumerate(p) if (len(p) - 1 - i) % 2 == part] for part in (0, 1))
    # Roots ±s of the same p: s² is a common root of its even and its odd part.
    mirrored = common(even, odd)
    factors = distinct(mirrored)
    pairs = sum(negative_roots(factor) for factor, _ in factors)
    spread = [c for factor in mirrored for c in (factor, 0)][:-1]
    others = divided(p, spread)[0]
    if sum(len(factor) - 1 for factor, _ in factors) > pairs or not all_left(others):
        return Truth(frozenset({U, OPEN}), U, "grows exponentially", zeros[1], False)
    in_chains = any(nullity(evaluated(f, squared)) < 2 * k * (len(f) - 1) for f, k in factors)
    if in_chains:
        return Truth(frozenset({U, OPEN}), OPEN, "pairs on the axis grow with t", zeros[1], False)
    if zeros[2] > zeros[1]:
        return Truth(frozenset({U, OPEN}), U, "zeros grow with t apart from symmetries", zeros[1], False)
    in_place = zeros[1] == zeros[0]
    allowed = {S_UP_TO, M, OPEN} | ({S} if in_place else set())
    if zeros[1] == 2 * n:
        return Truth(frozenset(allowed | {AS_UP_TO}), S_UP_TO, f"nothing left to judge{oblique}", zeros[1], in_place)
    if not pairs:
        allowed |= {AS_UP_TO} if zeros[0] else {AS, AS_UP_TO}
        word = AS_UP_TO if zeros[0] else AS
        how = "" if not zeros[0] else ", in place" if in_place else ", drifting"
        return Truth(frozenset(allowed), word, f"{word}{how}{oblique}", zeros[1], in_place)
    simple = all(k == 1 for _, k in factors)
    skew = [[D[i][j] + D[j][i] for j in range(n)] for i in range(n)] == [[0] * n] * n
    if symmetric(K) and never_negative(K) and never_negative(D):
        word = S_UP_TO if zeros[0] else S
        return Truth(frozenset(allowed), word, f"{word}, the energy is definite{oblique}", zeros[1], in_place)
    if simple and symmetric(K) and skew:
        return Truth(frozenset(allowed), M, f"simple pairs, conservative{oblique}", zeros[1], in_place)
    if simple and not any(map(any, D)):
        return Truth(frozenset(allowed), M, f"simple pairs, no rates{oblique}", zeros[1], in_place)
    why = "no structure" if simple else "multiple pairs"
    return Truth(frozenset(allowed), OPEN, f"stable, {why}{oblique}", zeros[1], in_place)


# --- systems --------------------------------------------------------------------------------------------------------

NAMES = (("p.x",), ("p.x", "p.y"), ("p.x", "p.y", "p.z"), ("p.x", "p.y", "q.x", "q.y"))
BODIES = (
    "{p: {type: planar_point, mass: 1}}\njoints: {rail: {type: point_on_line, between: [ground, p], axis: x}}",
    "{p: {type: planar_point, mass: 1}}",
    "{p: {type: point, mass: 1}}",
    "{p: {type: planar_point, mass: 1}, q: {type: planar_point, mass: 1}}",
)
PLACES = (
    "{p: {x: 0, y: 0}}",
    "{p: {x: 0, y: 0}}",
    "{p: {x: 0, y: 0, z: 0}}",
    "{p: {x: 0, y: 0}, q: {x: 0, y: 0}}",
)


def text(K, D, parameter=False):
    """Return the model file of q″ + D q′ + K q = 0; with ``parameter`` each law has a factor c = 1."""
    n = len(K)
    names = NAMES[n - 1]
    laws = []
    for i, name in enumerate(names):
        terms = [f"{-c:+}*{x}" for c, x in zip(K[i], names, strict=True) if c]
        terms += [f"{-c:+}*rate({x})" for c, x in zip(D[i], names, strict=True) if c]
        if terms:
            law = "".join(terms)
            laws.append(f"{name}: {f'c*({law})' if parameter else law!r}")
    forces = f"forces: {{law: {{type: expression, on: {{{', '.join(laws)}}}}}}}\n" if laws else ""
    number = "parameters: {c: 1}\n" if parameter else ""
    return f"mbstab: 1\n{number}bodies: {BODIES[n - 1]}\n{forces}reference: {{coordinates: {PLACES[n - 1]}}}\n"


CRITICAL = ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (4, 0), (2, 3), (0, -1), (-1, 0), (1, -1))


def random_system(rng, n):
    """Return K and D of a way of making them that is drawn as well."""
    made = rng.choice((_any, _potential, _turning, _damped, _repeated, _triangular, _circulatory, _held))(rng, n)
    if rng.random() < 0.2:
        zero = rng.randrange(n)
        made = tuple([[0] * n if i == zero else row for i, row in enumerate(matrix)] for matrix in made)
    return made


def _numbers(rng, n, values=(-2, -1, 0, 0, 0, 1, 2)):
    return [[rng.choice(values) for _ in range(n)] for _ in range(n)]


def _none(n):
    return [[0] * n for _ in range(n)]


def _square(rng, n):
    """A form that is never negative, of any rank."""
    B = _numbers(rng, n, (-1, 0, 0, 1))
    return product([list(row) for row in zip(*B, strict=True)], B)


def _sum(A, B, sign=1):
    return [[a + sign * b for a, b in zip(x, y, strict=True)] for x, y in zip(A, B, strict=True)]


def _mixed(rng, n, sign):
    """A symmetric (1) or skew matrix (−1)."""
    B = _numbers(rng, n)
    return _sum(B, [list(row) for row in zip(*B, strict=True)], sign)


def _any(rng, n):
    return _numbers(rng, n), _numbers(rng, n)


def _potential(rng, n):
    return (_square(rng, n) if rng.random() < 0.7 else _mixed(rng, n, 1)), _none(n)


def _turning(rng, n):
    return (_square(rng, n) if rng.random() < 0.5 else _mixed(rng, n, 1)), _mixed(rng, n, -1)


def _damped(rng, n):
    D = _square(rng, n)
    return _square(rng, n), D if rng.random() < 0.6 else _sum(D, _mixed(rng, n, -1))


def _repeated(rng, n):
    k, d = rng.choice(CRITICAL)
    return _shaken(rng, [[k * x for x in row] for row in identity(n)], [[d * x for x in row] for row in identity(n)])


def _triangular(rng, n):
    diagonal = [rng.choice(CRITICAL) for _ in range(n)]
    if rng.random() < 0.5:
        diagonal = [diagonal[0]] * n
    K, D = (
        [[rng.choice((0, 0, 1)) if j > i else diagonal[i][part] if i == j else 0 for j in range(n)] for i in range(n)]
        for part in (0, 1)
    )
    return _shaken(rng, K, D)


def _circulatory(rng, n):
    return _sum(_square(rng, n), _mixed(rng, n, -1)), _none(n)


def _held(rng, n):
    """A few coordinates without any force of their own, and any coupling by rates."""
    K, D = _damped(rng, n)
    free = [i for i in range(n) if rng.random() < 0.5]
    return [[0 if i in free or j in free else K[i][j] for j in range(n)] for i in range(n)], D


def _shaken(rng, K, D):
    """The same system in other coordinates, whose matrix and inverse have integer entries."""
    n = len(K)
    for _ in range(rng.choice((0, 0, 1, 2))):
        if n == 1:
            break
        i, j = rng.sample(range(n), 2)
        c = rng.choice((-1, 1))
        for matrix in (K, D):
            matrix[i] = [a + c * b for a, b in zip(matrix[i], matrix[j], strict=True)]
            for row in matrix:
                row[j] -= c * row[i]
    return K, D
