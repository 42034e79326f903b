"""Finds the Python class of a message type by its name."""

from __future__ import annotations

import importlib
from typing import Any

from iptm_core.errors import BagError


def message_class(type_name: str) -> type[Any]:
    """Return the class of a message type.

    Args:
        type_name: ``package/msg/Type``.

    Raises:
        BagError: the package is not installed or has no such type.
    """
    parts = type_name.split("/")
    if len(parts) != 3 or parts[1] != "msg":
        raise BagError(f"message type {type_name!r} is not of the form package/msg/Type")
    try:
        module = importlib.import_module(f"{parts[0]}.msg")
    except ImportError:
        raise BagError(
            f"message type {type_name}: package {parts[0]} is not installed here"
        ) from None
    found: type[Any] | None = getattr(module, parts[2], None)
    if found is None:
        raise BagError(f"message type {type_name}: package {parts[0]} has no message {parts[2]}")
    return found
