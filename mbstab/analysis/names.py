"""Which names the expressions in a part of a model contain."""

from __future__ import annotations

from mbstab.model.expressions import Expression


def names_in(value: object) -> set[str]:
    """Return the names in anything that a model is made of: parameters, coordinates, the time ``t``."""
    if isinstance(value, Expression):
        return set(value.names())
    if isinstance(value, dict):
        return names_in(tuple(value.values()))
    if isinstance(value, (tuple, list)):
        return set().union(*(names_in(item) for item in value))
    if hasattr(value, "__dataclass_fields__"):
        return names_in([getattr(value, name) for name in value.__dataclass_fields__])
    return set()
