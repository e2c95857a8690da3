"""The composite matrices as symbols: the shipped kernels, run on symbols instead of numbers.

Blocks as in Pappalardo, Lettieri, Guida (2020), Eqs. (62)-(67).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.compiler.system import System
from mbstab.errors import UsageError
from mbstab.model.arithmetic import symbol_arithmetic
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import Answer, dataclass

Track = Callable[[list[Any]], Iterable[Any]]


@dataclass(frozen=True)
class SymbolicBlocks(Answer):
    """Blocks of M̄, R̄, K̄ as SymPy matrices, by names such as ``K_11``.

    Attributes
    ----------
    blocks : dict of str to Matrix
    coordinates, multipliers : list of Symbol
    unsimplified : int
        Number of entries beyond `TOLERANCES.simplified_weight`, which are not simplified.
    """

    blocks: dict[str, Any]
    coordinates: list[Any]
    multipliers: list[Any]
    unsimplified: int = 0


def symbolic_blocks(model: Model, track: Track = list, forced: bool = False) -> SymbolicBlocks:
    """Return the composite matrices of a model with symbols for parameters, coordinates, speeds and multipliers.

    Parameters
    ----------
    model : Model
    track : callable, optional
        Takes the entries to be simplified and returns them one by one; for a progress bar.
    forced : bool
        Continue beyond `TOLERANCES.printed_operations`.

    Raises
    ------
    UsageError
        If the entries have more operations.
    """
    import sympy

    overrides = {name: sympy.Symbol(name, real=True) for name in model.parameters}
    system = System(evaluate(model, overrides, symbol_arithmetic()))
    several = len(model.bodies) > 1

    def state(ending: str) -> list[Any]:
        symbols = []
        for name in system.names:
            body, _, coordinate = name.partition(".")
            symbols.append(
                sympy.Symbol(f"{coordinate}{ending}_{body}" if several else f"{coordinate}{ending}", real=True)
            )
        return symbols

    q, u, a = state(""), state("dot"), state("ddot")
    lam = [sympy.Symbol(f"lambda_{i + 1}", real=True) for i in range(system.n_h)]
    single = system.n_n == 1
    mu = [sympy.Symbol("mu" if single else f"mu_{i + 1}", real=True) for i in range(system.n_n)]
    time = sympy.Symbol("t", real=True)
    dynamics = system.dynamics(q, u, time)
    K, R, D_q = system.linearize(q, u, a, [*lam, *mu], time)
    n, c, n_h = system.n_q, system.n_c, system.n_h
    zero = sympy.zeros
    J = sympy.Matrix(c, n, list(dynamics.J.flat)) if c else zero(0, n)
    lower_R, lower_K = zero(c, n), zero(c, n)
    for i in range(c):
        for j in range(n):
            if i < n_h:
                lower_K[i, j] = J[i, j]
            else:
                lower_R[i, j], lower_K[i, j] = J[i, j], D_q[i - n_h, j]
    raw = {
        "M_11": sympy.Matrix(n, n, list(dynamics.M.flat)),
        "M_12": zero(n, c),
        "M_21": zero(c, n),
        "M_22": zero(c, c),
        "R_11": sympy.Matrix(n, n, list(R.flat)),
        "R_12": zero(n, c),
        "R_21": lower_R,
        "R_22": zero(c, c),
        "K_11": sympy.Matrix(n, n, list(K.flat)),
        "K_12": J.T,
        "K_21": lower_K,
        "K_22": zero(c, c),
    }
    places = [(block, i) for block in raw.values() for i, entry in enumerate(block) if entry != 0]
    if not forced:
        _require_readable(block[i] for block, i in places)
    for block, i in places:
        # Fixed coordinates enter as plain zeros and ones, which become exact here.
        block[i] = block[i].xreplace({x: sympy.nsimplify(x, rational=True) for x in block[i].atoms(sympy.Float)})
    simple: dict[Any, Any] = {}
    total = 0
    # Rows and their transposes have the same entries.
    weights = {entry: _weight(entry) for entry in dict.fromkeys(block[i] for block, i in places)}
    for entry in track(sorted(weights, key=lambda entry: weights[entry])):
        if total + weights[entry] > TOLERANCES.simplified_weight:
            continue
        expanded = sympy.expand(entry)  # may be much longer
        total += max(weights[entry], _weight(expanded))
        if total <= TOLERANCES.simplified_weight:
            simple[entry] = sympy.factor_terms(sympy.trigsimp(expanded))
    unsimplified = sum(block[i] not in simple for block, i in places)
    for block, i in places:
        block[i] = simple.get(block[i], block[i])
    return SymbolicBlocks(raw, q, [*lam, *mu], unsimplified)


def _require_readable(entries: Iterable[Any]) -> None:
    """Refuse entries with too many operations."""
    operations = 0
    for entry in entries:
        operations += entry.count_ops()
        if operations > TOLERANCES.printed_operations:
            raise UsageError(
                f"the matrices have more than {TOLERANCES.printed_operations} operations in symbols\n"
                "hint: --force (force=True in Python) prints them anyway; mbstab linearize without --symbolic "
                "shows them as numbers"
            )


def _weight(entry: Any) -> int:
    """Return the cost of simplifying an entry: its operations, times 5 for each further angle, 25 for a denominator."""
    import sympy

    angles = {x.args[0] for x in entry.atoms(sympy.sin, sympy.cos)}
    below = {x.base for x in entry.atoms(sympy.Pow) if x.exp.is_negative and x.base.has(*angles)}
    operations: int = entry.count_ops()
    return operations * int(5 ** (max(0, len(angles) - 1) + 2 * len(below)))
