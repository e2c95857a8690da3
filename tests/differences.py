"""Derivatives of eigenvalues as differences with many digits."""

from mpmath import mp
from mpmath_numbers import mpmath_arithmetic

from mbstab.model.parameters import evaluate_parameters


def differences(mechanism, name, digits=30):
    """Return the function from an eigenvalue to its derivative by a parameter, from a tiny step."""
    with mp.workdps(2 * digits):
        value = evaluate_parameters(mechanism.model, {}, mpmath_arithmetic())[name]
        h = (abs(value) or 1) * mp.mpf(10) ** (-digits // 2)
        ends = []
        for sign in (1, -1):
            result = mechanism.eig_precise(digits, **{name: f"1*({mp.nstr(value + sign * h, 2 * digits)})"})
            ends.append([e.value for e in result.eigenvalues])

        def slope(s):
            after, before = (min(end, key=lambda x: abs(x - s)) for end in ends)
            return complex((after - before) / (2 * h))

        return slope
