"""Copies of frozen dataclasses with some fields changed, for code that makes dozens of them a tick."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

__all__ = ["replace"]

Instance = TypeVar("Instance")

if TYPE_CHECKING:
    from dataclasses import replace
else:

    def replace(instance: Instance, /, **changes: Any) -> Instance:
        """Return the same as ``dataclasses.replace``, faster for a dataclass without checks of its own."""
        kind = type(instance)
        names = _plain_fields(kind)
        if names is None:
            return dataclasses.replace(instance, **changes)
        values = instance.__dict__
        if len(values) != len(names):  # values of cached properties are not copied
            values = {name: values[name] for name in names}
        values = {**values, **changes}
        if len(values) != len(names):
            raise TypeError(f"{kind.__name__} has no field {(values.keys() - names).pop()!r}")
        changed = object.__new__(kind)
        changed.__dict__.update(values)
        return changed


@cache
def _plain_fields(kind: Any) -> frozenset[str] | None:
    """Return the fields of a dataclass that its ``__init__`` only stores, None if it does more."""
    fields = dataclasses.fields(kind)
    is_plain = not hasattr(kind, "__post_init__") and all(each.init for each in fields)
    return (
        frozenset(each.name for each in fields) if is_plain and hasattr(kind, "__dict__") else None
    )
