"""Numbers of mpmath as a number system of expressions and kernels, for oracles that share no arithmetic with balls."""

from mpmath import mp

from mbstab.model.arithmetic import KINK, MAX_DIGITS, Arithmetic
from mbstab.model.functions import NATIVE


def mpmath_arithmetic():
    """Return the arithmetic of mpmath numbers, at the precision set in ``mpmath.mp``."""

    def real(function):
        def checked(*arguments):
            value = function(*arguments)
            if isinstance(value, mp.mpc):
                raise ValueError("math domain error")
            return value

        return checked

    def power(base, exponent):
        if base != 0 and abs(exponent * mp.log(abs(base))) > MAX_DIGITS:
            raise OverflowError("the power is out of range")
        return mp.power(base, exponent)

    def abs_slope(x):
        if x == 0:
            raise ValueError(KINK)
        return mp.sign(x)

    def held(x):
        return mp.mpf(0) if x <= 0 else mp.mpf(1) if x >= 1 else x

    def inside(x):
        if not 0 <= x <= 1:
            raise ValueError("outside of a table")
        return mp.mpf(0)

    functions = {name: real(getattr(mp, name)) for name in NATIVE if hasattr(mp, name)}
    return Arithmetic(
        "mpmath",
        mp.mpf,
        {"pi": mp.pi, "deg": mp.degree},  # digits come when they are used
        functions
        | {
            "abs": mp.fabs,
            "signum": mp.sign,
            "abs_slope": abs_slope,
            "held": held,
            "inside": inside,
            "power": real(power),
        },
    )
