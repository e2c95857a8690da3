"""The library as people use it: load a model file, ask a question, get a result object.

>>> import mbstab
>>> model = mbstab.load("pendulum.yaml")
>>> result = model.eig()
>>> result.verdict
'stable'
>>> f"{result.eigenvalues[0].value.imag:.12f}"
'6.065269985747'
"""

from __future__ import annotations

import os

from mbstab.api.mechanism import Mechanism
from mbstab.errors import UsageError
from mbstab.model.library import find_model
from mbstab.model.reader import read_model, read_model_text

__all__ = ["Mechanism", "load", "loads"]


def load(path: str | os.PathLike[str], force: bool = False) -> Mechanism:
    """Load a model file; a name that is not a file is looked up among the installed examples.

    With `force` it answers however much memory and time that takes.

    Raises
    ------
    ModelFileError
        With all problems of the file.
    UsageError
        If there is no such file or example.
    """
    if not isinstance(path, (str, os.PathLike)) or not os.fspath(path):
        raise UsageError(f"{path!r} is not a file\nhint: give the path of a model file or the name of an example")
    return Mechanism(read_model(find_model(os.fsdecode(path)).path), force)


def loads(text: str | bytes, name: str = "<text>", force: bool = False) -> Mechanism:
    """Load a model from text; `name` is what messages call it, `force` as in `load`."""
    if not isinstance(text, (str, bytes)):
        raise UsageError(f"{text!r} is no text of a model\nhint: load(path) reads a file")
    return Mechanism(read_model_text(text, name), force)
