"""Dataclasses whose methods are written when they are first needed.

`dataclasses.dataclass` writes and compiles the methods of a class when the class is made. A command imports a hundred
such classes and makes instances of half of them; here their methods wait for the first instance, or for the first
question about their fields.
"""

from __future__ import annotations

import dataclasses
from threading import RLock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    _FIELDS = "__dataclass_fields__"
    _LOCK = RLock()

    class _Waiting:
        """Stands for the fields of a class whose methods are not yet written."""

        def __init__(self, finish):
            self.finish = finish

        def __get__(self, instance, owner):
            self.finish()
            return getattr(owner, _FIELDS)

    def dataclass(cls=None, /, **options):
        """Return a decorator like that of `dataclasses.dataclass`; with ``slots`` it writes the methods at once."""
        if options.get("slots"):
            return dataclasses.dataclass(cls, **options)

        def decorate(cls):
            def finish():
                with _LOCK:
                    if isinstance(cls.__dict__.get(_FIELDS), _Waiting):
                        for name in (_FIELDS, "__init__", "__setstate__"):
                            delattr(cls, name)
                        dataclasses.dataclass(**options)(cls)

            def __init__(self, *values, **named):
                finish()
                cls.__init__(self, *values, **named)

            def __setstate__(self, state):  # copies, and what pickle reads
                finish()
                self.__dict__.update(state)

            cls.__init__, cls.__setstate__ = __init__, __setstate__
            setattr(cls, _FIELDS, _Waiting(finish))
            return cls

        return decorate if cls is None else decorate(cls)
