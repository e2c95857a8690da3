"""What people write in expressions who know other programs or other rules, and what they mean."""

from __future__ import annotations

import re

CHARACTERS = {
    "^": "powers are written **",
    "²": "powers are written **: x**2",
    "³": "powers are written **: x**3",
    "=": "an equation is written as what is zero: left - (right)",
    "°": "degrees are written 90*deg",
    ",": "decimals have a point: 0.5 for 0,5",
    "·": "multiplication is written *",
    "×": "multiplication is written *",
    "−": "the sign for minus is the hyphen, -",
    "%": "a number of percent is written as a fraction: 0.05 for 5 %",
    "<": "angle brackets take an index of repeat: or a name under counts:, and this file has neither here",
    "π": "it is written pi",
}
"""What stands for characters that expressions do not have."""

_RATE = "the time derivative is written rate(body.x)"
_STEP = "smooth_start(x) rises smoothly from 0 to 1"
_CORNER = "max(x, 0, 0.001) and sign(x, 0.001) change smoothly over the width 0.001"
FUNCTIONS = {
    "ln": "the natural logarithm is written log(x)",
    "log10": "it is written log(x)/log(10)",
    "pow": "powers are written x**2",
    "square": "powers are written x**2",
    **dict.fromkeys(("der", "dot", "diff", "derivative", "ddt", "vel", "velocity", "speed", "d"), _RATE),
    **dict.fromkeys(("step", "heaviside", "ramp", "floor", "ceil", "round"), _STEP),
    **dict.fromkeys(("if", "where", "piecewise", "sgn"), _CORNER),
    "deg": "degrees are written 30*deg",
    "degrees": "degrees are written 30*deg",
    "rad": "angles count in rad; degrees are written 30*deg",
    "radians": "angles count in rad; degrees are written 30*deg",
    "interp": "a function given by points stands under tables: and is written table(x, NAME)",
    "lookup": "a function given by points stands under tables: and is written table(x, NAME)",
}
"""What stands for functions that expressions do not have."""

_GROUPED = re.compile(r"_?[0-9]{3}(?:_[0-9]{3})*")


def behind_number(number: str, kind: str, token: str) -> str:
    """Return a hint about what stands behind a number without an operator: digits in groups, or a name."""
    if number.isdigit() and _GROUPED.fullmatch(token):
        return f"digits of a number stand together: {number}{token.replace('_', '')}"
    return f"write *{token} for a product with a parameter" if kind == "name" else "multiplication is written *"
