"""Scenes in balls, and what proofs raise.

Matrices are arrays of balls and fractions. Elimination divides by pivots chosen in double precision and
never adds a multiple with factor zero, so that it preserves structural zeros.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy.typing as npt

from mbstab.compiler.system import System
from mbstab.errors import MbstabError, UsageError
from mbstab.model.arithmetic import Arithmetic
from mbstab.model.balls import Ball, ball, ball_arithmetic
from mbstab.model.jets import Jet
from mbstab.model.parameters import given_values
from mbstab.model.schema import Model
from mbstab.model.values import evaluate

Matrix = npt.NDArray[Any]
"""Arrays of balls and fractions, vectors and matrices."""


class NotProvable(MbstabError):
    """Something could not be enclosed, or its sign not proven, with the digits in use; the message is the reason."""


class Hopeless(NotProvable):
    """Something cannot be proven with any number of digits."""


def ends(model: Model, name: str) -> list[Ball]:
    """Return the value (SI) that a call gives a parameter, or both ends of its interval.

    Raises
    ------
    UsageError
        If the first end is not below the last.
    """
    found = given_values(model, name, ball_arithmetic())
    if len(found) == 2 and not found[0] < found[1]:
        setting = model.parameters[name].given
        raise UsageError(f"{name}={setting and setting.setting}: the first end of an interval must be below the last")
    return found


def ball_system(model: Model, overrides: Mapping[str, Ball], f: Arithmetic | None = None) -> System:
    """Return the equations of motion of a model in balls, or in digits (`mbstab.model.balls.digit_arithmetic`).

    Raises
    ------
    ModelFileError
        If a number is not proven to have the required sign.
    """
    system = System(evaluate(model, overrides, f or ball_arithmetic()))
    # Kernels must not get floats: their quotients would be rounded.
    system._elements = [
        replace(
            element,
            parameters=tuple(ball(x) for x in element.parameters),
            laws=tuple(_BallLaw(law) for law in element.laws),
        )
        for element in system._elements
    ]
    return system


class _BallLaw:
    """A given function of time whose value and derivatives are balls."""

    def __init__(self, law: Any) -> None:
        self.law = law

    def at(self, time: Any) -> Jet:
        jet = self.law.at(ball(time))
        return Jet(ball(jet.value), ball(jet.rate), ball(jet.second))
