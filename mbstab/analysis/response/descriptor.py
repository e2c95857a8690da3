"""The linear model from inputs to outputs in the coordinates and multipliers of the scene, without reduction."""

from __future__ import annotations

from mbstab.analysis.linear.linearize import Linearization
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Descriptor:
    """The index-3 system E ẏ = A y + B w, z = C y + D w; D has the columns of `ControlModel.D`.

    The variables are Δq, Δν, Δu, and Δa where an output is an acceleration.
    """

    E: Array
    A: Array
    B: Array
    C: Array
    D: Array
    variables: tuple[str, ...]


@dataclass(frozen=True)
class Unreduced:
    """The descriptor form about a reference motion.

    Attributes
    ----------
    descriptor : Descriptor
    linear : Linearization
    orders : tuple of (int, int)
        Number of the input of each column of D, and how often it is differentiated.
    inputs, outputs, output_units : tuple of str
    """

    descriptor: Descriptor
    linear: Linearization
    orders: tuple[tuple[int, int], ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
