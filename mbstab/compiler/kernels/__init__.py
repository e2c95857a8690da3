"""The kernels of the elements, one module each: written when the package is built (`mbstab.compiler.build`).

In a checkout they may be older than the definitions; they are derived in memory then.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

FOLDER = Path(__file__).parent
_PACKAGE = FOLDER.parents[1]
STAMP = FOLDER / "sources.txt"
"""Holds the hash of the sources from which the kernels were written."""
_COMMAND = "python -m mbstab.compiler.build"


def sources() -> list[Path]:
    """Return the files that decide what the kernels are."""
    own = [_PACKAGE / "compiler" / f"{name}.py" for name in ("derive", "emit", "tape")]
    return [*own, _PACKAGE / "model" / "functions.py", *sorted((_PACKAGE / "mechanics").glob("*.py"))]


def hash_of_sources() -> str:
    """Return a hash of all sources."""
    from hashlib import sha256

    return sha256(b"".join(path.read_bytes() for path in sources())).hexdigest()


@cache
def _stale() -> bool:
    """Whether the kernels must be derived again; of an installed package they need not."""
    if not (_PACKAGE.parent / "pyproject.toml").exists():
        return False
    try:
        written = STAMP.stat().st_mtime_ns
        if all(path.stat().st_mtime_ns < written for path in sources()):
            return False
        return STAMP.read_text(encoding="ascii") != hash_of_sources()
    except OSError:
        return True


@cache
def load(name: str) -> ModuleType:
    """Return the kernel of an element, such as ``planar_coincident``."""
    if not _stale():
        with suppress(ModuleNotFoundError):  # as after a checkout of a commit that kept them
            return import_module(f"{__name__}.{name}")
    _tell()
    from mbstab.compiler.emit import source

    module = ModuleType(f"{__name__}.{name}")
    exec(compile(source(name), f"<kernel {name}>", "exec"), vars(module))
    return module


@cache
def _tell() -> None:
    said = "the kernels are missing or older than the definitions, and are derived at each start"
    print(f"mbstab: {said}; '{_COMMAND}' writes them", file=sys.stderr)
