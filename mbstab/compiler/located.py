"""Where in a model file an expression stands that has no equations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mbstab.errors import ModelFileError
from mbstab.model.dependencies import equations_of, expressions_in
from mbstab.model.expressions import ExpressionError
from mbstab.model.scene import Scene
from mbstab.model.schema import Quantity
from mbstab.model.yamlfile import Scalar


@contextmanager
def located(scene: Scene) -> Iterator[None]:
    """Say where in the file an expression stands that has no value whatever the motion."""
    try:
        yield
    except ExpressionError as error:
        document, settled = scene.model.document, scene.rationals.settled
        for x in expressions_in(equations_of(scene.model)):
            if isinstance(x, Quantity) and settled(x).root == error.root:
                place = document.locate(Scalar(x.text, x.location), error.position)
                raise ModelFileError([document.problem(place, x.path, error.message, error.hint)]) from None
        raise
