"""Tables to which several modules contribute; modules are imported until one of them has the key that is asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from importlib import import_module
from types import ModuleType
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")


class Gathered(MutableMapping[K, V]):
    """A table of what modules contribute, in their order.

    Parameters
    ----------
    package, modules : str
        Names of modules in a package, separated by blanks. Those that are imported anyway are asked first.
    items : callable
        Returns what a module contributes.
    """

    def __init__(self, package: str, modules: str, items: Callable[[ModuleType], Mapping[K, V]]) -> None:
        self._waiting = [f"{package}.{module}" for module in modules.split()]
        self._items, self._known = items, dict[K, V]()
        self._parts: dict[str, Mapping[K, V]] = {name: {} for name in self._waiting}

    def _import(self) -> None:
        name = next((name for name in self._waiting if name in sys.modules), self._waiting[0])
        self._parts[name] = self._items(import_module(name))
        self._known.update(self._parts[name])
        self._waiting.remove(name)

    def __getitem__(self, key: K) -> V:
        known = self._known
        while key not in known and self._waiting:
            self._import()
        return known[key]

    def __setitem__(self, key: K, value: V) -> None:
        if key not in self:
            self._parts[""] = {**self._parts.get("", {}), key: value}
        self._known[key] = value

    def __delitem__(self, key: K) -> None:
        del self._known[key]

    def __iter__(self) -> Iterator[K]:
        while self._waiting:
            self._import()
        return (key for part in self._parts.values() for key in part if key in self._known)

    def __len__(self) -> int:
        return sum(1 for _ in self)
