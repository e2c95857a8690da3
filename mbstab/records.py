"""Dataclasses whose methods are functions that all of them share.

`dataclasses.dataclass` writes the text of every method of every class and compiles it: for the hundred classes of a
command that takes longer than most answers. Here the fields are those of `dataclasses` (with `fields`, `replace`,
`asdict`, matching), and the methods are closures over their names.
"""

from __future__ import annotations

import dataclasses
from inspect import get_annotations
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING


class Answer:
    """An answer to a question about a model; printed, it is the text of the command if the interface has added it."""

    def __str__(self) -> str:
        """Return the text."""
        write = self.__dict__.get("_text")
        return repr(self) if write is None else str(write(self))

    def __getstate__(self) -> dict[str, object]:
        """Return the fields: a copy in another process has no text, which needs the model."""
        return {name: x for name, x in self.__dict__.items() if name != "_text"}


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, repr=True, **options):
        """Return a decorator like that of `dataclasses.dataclass`; with other options it is that."""

        def decorate(cls):
            if options:
                return dataclasses.dataclass(cls, frozen=frozen, eq=eq, repr=repr, **options)
            own = set(vars(cls))
            fields = _fields(cls)
            methods = {"__init__": _init(cls, fields)}
            if repr:
                methods["__repr__"] = _repr(fields)
            if eq:
                methods |= _comparison(fields, frozen)
            if frozen:
                methods |= {"__setattr__": _refuse_assignment, "__delattr__": _refuse_deletion}
            for name, method in methods.items():
                if name not in own:
                    setattr(cls, name, method)
            return cls

        return decorate if cls is None else decorate(cls)

    def _fields(cls):
        """Return the fields of a class, which `dataclasses` then knows; their types are those of the annotations.

        `dataclasses` parses each annotation that is a text, and there is none that means anything to it.
        """
        written = get_annotations(cls)
        plain = bool(written) and not any("Var" in str(x) or "KW_ONLY" in str(x) for x in written.values())
        if plain:
            cls.__annotations__ = dict.fromkeys(written, object)
        dataclasses.dataclass(cls, init=False, repr=False, eq=False)
        fields = dataclasses.fields(cls)
        if plain:
            cls.__annotations__ = written
            for field in fields:
                field.type = written.get(field.name, field.type)
        return fields

    def _init(cls, fields):
        """Return the method that sets the fields, and calls ``__post_init__`` if there is one."""
        names = tuple(f.name for f in fields if f.init)
        defaults = {f.name: f.default for f in fields if f.default is not dataclasses.MISSING}
        factories = tuple((f.name, f.default_factory) for f in fields if f.default_factory is not dataclasses.MISSING)
        known, count, complete = frozenset(names), len(names), len(names) == len(fields)
        made = [name for name, _ in factories]
        required = [name for name in names if name not in defaults and name not in made]
        least = names.index(required[-1]) + 1 if required else 0
        checked = hasattr(cls, "__post_init__")

        def __init__(self, *values, **named):
            state, given = self.__dict__, len(values)
            if complete and given == count and not named:
                state.update(zip(names, values))  # noqa: B905, `strict` takes longer than all the rest
            else:
                if given > count or (
                    named and not (known.issuperset(named) and named.keys().isdisjoint(names[:given]))
                ):
                    raise TypeError(f"{cls.__qualname__}() takes {', '.join(names)}, each at most once")
                state.update(defaults)
                state.update(zip(names, values, strict=False))
                if named:
                    state.update(named)
                for name, factory in factories:
                    if name not in state:
                        state[name] = factory()
                if given < least and (missing := [name for name in required if name not in state]):
                    raise TypeError(f"{cls.__qualname__}() needs {', '.join(missing)}")
            if checked:
                self.__post_init__()

        return __init__

    def _repr(fields):
        names = [f.name for f in fields if f.repr]

        @recursive_repr()
        def __repr__(self):
            shown = (f"{name}={getattr(self, name)!r}" for name in names)
            return f"{type(self).__qualname__}({', '.join(shown)})"

        return __repr__

    def _comparison(fields, hashable):
        """Return the methods for what is equal if all fields are, and a hash where these stay what they are."""
        names = [f.name for f in fields if f.compare]
        values = attrgetter(*names) if len(names) > 1 else lambda self: tuple(getattr(self, name) for name in names)

        def __eq__(self, other):
            return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

        def __hash__(self):
            return hash(values(self))

        return {"__eq__": __eq__, "__hash__": __hash__ if hashable else None}

    def _refuse_assignment(self, name, value):
        _refuse(self, name, "assign to")
        object.__setattr__(self, name, value)

    def _refuse_deletion(self, name):
        _refuse(self, name, "delete")
        object.__delattr__(self, name)

    def _refuse(self, name, what):
        """Refuse to change a field, or any attribute but those that a plain subclass adds."""
        if "__dataclass_fields__" in type(self).__dict__ or name in self.__dataclass_fields__:
            raise dataclasses.FrozenInstanceError(f"cannot {what} field {name!r}")
