"""One thread for the linear algebra of small matrices.

Matrices of one mechanism are small: threads cost more time than they save, and hold cores that other processes need.
NumPy and SciPy each bring an OpenBLAS of their own, whose number of threads can be set while it runs; others (MKL,
Accelerate) are left as they are.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock

Setting = tuple[Callable[[], int], Callable[[int], object]]
"""Functions that return and set the number of threads of a library."""

_LOADED = getattr(os, "RTLD_NOLOAD", 0)
"""Mode in which a library is found only if it is there already."""


class _Limit:
    """Those who ask for one thread at the moment, and the numbers of threads that were set before the first."""

    def __init__(self) -> None:
        self.lock, self.inside = Lock(), 0
        self.before: list[tuple[Callable[[int], object], int]] = []

    def enter(self) -> None:
        with self.lock:
            if not self.inside:
                self.before = [(change, number) for get, change in _settings() if (number := get()) > 1]
                for change, _ in self.before:
                    change(1)
            self.inside += 1

    def leave(self) -> None:
        with self.lock:
            self.inside -= 1
            if not self.inside:
                for change, number in self.before:
                    change(number)


_limit = _Limit()


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the libraries that are loaded at one thread; the last that leaves sets what the first found."""
    _limit.enter()
    try:
        yield
    finally:
        _limit.leave()


def _settings() -> list[Setting]:
    packages = [name for name in ("numpy", "scipy") if name in sys.modules]
    return [found for name in packages for path in _libraries(name) if (found := _setting(path)) is not None]


@cache
def _libraries(package: str) -> tuple[str, ...]:
    """Return the files of OpenBLAS that a package brings, on Linux and Windows and on macOS."""
    own = Path(str(sys.modules[package].__file__)).parent
    return tuple(
        str(path) for folder in (own.with_suffix(".libs"), own / ".dylibs") for path in folder.glob("*openblas*")
    )


_known = dict[str, Setting]()


def _setting(path: str) -> Setting | None:
    """Return how the threads of a library are set, if it is loaded."""
    if path not in _known:
        try:
            library = ctypes.CDLL(path, mode=ctypes.DEFAULT_MODE | _LOADED)
        except OSError:
            return None
        for start in ("scipy_openblas", "openblas"):
            for end in ("64_", ""):
                if hasattr(library, f"{start}_set_num_threads{end}"):
                    get, change = (getattr(library, f"{start}_{x}_num_threads{end}") for x in ("get", "set"))
                    _known[path] = get, change
    return _known.get(path)
