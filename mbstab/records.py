"""Dataclasses whose methods are functions that all of them share.

`dataclasses.dataclass` writes the text of every method of every class and compiles it: for the hundred classes of a
command that takes longer than most answers. Here the fields are those of `dataclasses` (with `fields`, `replace`,
`asdict`, matching), and the methods are closures over their names. Fields and methods are made when they are first
needed: a command imports more classes than it makes objects of.
"""

from __future__ import annotations

import dataclasses
from inspect import get_annotations
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any


class Answer:
    """An answer to a question about a model; printed, it is the text of the command if the interface has added it."""

    def __str__(self) -> str:
        """Return the text."""
        write = self.__dict__.get("_text")
        return repr(self) if write is None else str(write(self))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Write the text where IPython or a notebook show an answer."""
        printer.text(str(self))


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, repr=True, **options):
        """Return a decorator like that of `dataclasses.dataclass`; with other options it is that."""

        def decorate(cls):
            if options:
                return dataclasses.dataclass(cls, frozen=frozen, eq=eq, repr=repr, **options)
            makers = {"__init__": _init}
            if repr:
                makers["__repr__"] = _repr
            if eq:
                makers["__eq__"] = _equality
            if eq and frozen:
                makers["__hash__"] = _hash
            methods = {name: _late(cls, name, make) for name, make in makers.items()}
            if eq and not frozen:
                methods["__hash__"] = None
            if frozen:
                methods |= {"__setattr__": _refuse_assignment, "__delattr__": _refuse_deletion}
            own = set(vars(cls))
            for name, method in methods.items():
                if name not in own:
                    setattr(cls, name, method)
            _announce(cls)
            return cls

        return decorate if cls is None else decorate(cls)

    def _late(cls, name, make):
        """Return a method that, when it is first called, gives way to the one that is made for the class."""

        def method(self, *values, **named):
            made = make(cls)
            setattr(cls, name, made)
            return made(self, *values, **named)

        return method

    class _Announced:
        """An attribute of a class that `dataclasses` sets when one of them is first read."""

        def __init__(self, cls, name):
            self.cls, self.name = cls, name

        def __get__(self, instance, owner=None):
            cls = self.cls
            for name in ANNOUNCED:
                delattr(cls, name)
            for name, written in vars(cls)[WRITTEN].items():
                if isinstance(written, dataclasses.Field):
                    setattr(cls, name, written)
            _find_fields(cls)
            return getattr(cls, self.name)

    ANNOUNCED = ("__dataclass_fields__", "__dataclass_params__", "__match_args__")
    WRITTEN = "__written_fields__"
    """The attribute with what a class assigns to its own fields, by their names; `MISSING` if nothing."""

    def _announce(cls):
        """Set the defaults of the fields, and the attributes of a dataclass so that they are found when read."""
        own = vars(cls)
        kinds = get_annotations(cls).items()
        written = {name: own.get(name, dataclasses.MISSING) for name, kind in kinds if "ClassVar" not in str(kind)}
        setattr(cls, WRITTEN, written)
        for name, x in written.items():
            if isinstance(x, dataclasses.Field):
                if x.default is dataclasses.MISSING:
                    delattr(cls, name)
                else:
                    setattr(cls, name, x.default)
        for name in ANNOUNCED:
            setattr(cls, name, _Announced(cls, name))

    def _find_fields(cls):
        """Let `dataclasses` find the fields of a class; their types are those of the annotations.

        `dataclasses` parses each annotation that is a text, and only that of a class variable means anything to it.
        """
        written = get_annotations(cls)
        cls.__annotations__ = {name: kind if "ClassVar" in str(kind) else object for name, kind in written.items()}
        dataclasses.dataclass(cls, init=False, repr=False, eq=False)
        cls.__annotations__ = written
        for field in dataclasses.fields(cls):
            field.type = written.get(field.name, field.type)

    def _init(cls):
        """Return the method that sets the fields, and calls ``__post_init__`` if there is one."""
        written = {}
        for base in reversed(cls.__mro__):
            written |= vars(base).get(WRITTEN, vars(base).get("__dataclass_fields__", {}))
        names, defaults, factories = [], {}, []
        for name, x in written.items():
            field = x if isinstance(x, dataclasses.Field) else None
            if field is None or field.init:
                names.append(name)
            if (default := x if field is None else field.default) is not dataclasses.MISSING:
                defaults[name] = default
            if field is not None and field.default_factory is not dataclasses.MISSING:
                factories.append((name, field.default_factory))
        names, complete = tuple(names), len(names) == len(written)
        known, count = frozenset(names), len(names)
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

    def _repr(cls):
        names = [f.name for f in dataclasses.fields(cls) if f.repr]

        @recursive_repr()
        def __repr__(self):
            shown = (f"{name}={getattr(self, name)!r}" for name in names)
            return f"{type(self).__qualname__}({', '.join(shown)})"

        return __repr__

    def _compared(cls):
        """Return the function that gives the values by which objects of a class are compared."""
        names = [f.name for f in dataclasses.fields(cls) if f.compare]
        return attrgetter(*names) if len(names) > 1 else lambda self: tuple(getattr(self, name) for name in names)

    def _equality(cls):
        values = _compared(cls)

        def __eq__(self, other):
            return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

        return __eq__

    def _hash(cls):
        values = _compared(cls)

        def __hash__(self):
            return hash(values(self))

        return __hash__

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
