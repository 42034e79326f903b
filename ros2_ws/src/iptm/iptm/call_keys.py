"""Keys of calls: equal where function, arguments, files and code are."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import singledispatch
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from iptm.fingerprint import SUITE, fingerprint
from iptm_core.errors import ParameterError
from iptm_core.user_input import shown

KEY_LENGTH = 32


def call_key(function: Callable[..., Any], arguments: Mapping[str, Any]) -> str:
    """Return the key of a call: equal for equal results.

    Raises:
        ParameterError: an argument cannot be described.
    """
    root = function.__module__.rpartition(".")[0]
    own = () if not root or root.split(".")[0] in SUITE else (root,)
    parts = (function.__module__, function.__qualname__, fingerprint((*SUITE, *own)))
    text = repr((parts, _plain(arguments)))
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


@singledispatch
def _plain(value: Any) -> Any:
    """Return nested tuples of texts and numbers that stand for a value."""
    if is_dataclass(value) and not isinstance(value, type):
        entries = (_plain(getattr(value, entry.name)) for entry in fields(value))
        return type(value).__qualname__, *entries
    if callable(value) and hasattr(value, "__qualname__"):
        return value.__module__, value.__qualname__
    try:
        return type(value).__qualname__, _digest(pickle.dumps(value))
    except Exception:  # noqa: BLE001 - pickle raises whatever the object does
        raise ParameterError(
            f"argument is {shown(value)}; allowed with a cache: numbers, texts, arrays, dataclasses and what"
            " can be pickled"
        ) from None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@_plain.register(type(None))
@_plain.register(int)
@_plain.register(float)
@_plain.register(bytes)
def _(value: float | bytes | None) -> Any:
    return value


@_plain.register(str)
@_plain.register(Path)
def _(value: str | Path) -> Any:
    """A file counts by its content, wherever it is."""
    path = Path(value)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        is_file = False
    return ("file", path.name, _digest(path.read_bytes())) if is_file else str(value)


@_plain.register
def _(value: Enum) -> Any:
    return type(value).__qualname__, value.name


@_plain.register(Mapping)
def _(value: Mapping[Any, Any]) -> Any:
    return "map", *sorted((str(key), _plain(entry)) for key, entry in value.items())


@_plain.register(list)
@_plain.register(tuple)
def _(value: list[Any] | tuple[Any, ...]) -> Any:
    return "list", *map(_plain, value)


@_plain.register
def _(value: pd.DataFrame) -> Any:
    columns = {str(name): value[name].to_numpy() for name in value}
    return "frame", _plain(value.index.to_numpy()), *map(_plain, columns.items())


@_plain.register(np.ndarray)
@_plain.register(np.generic)
def _(value: Any) -> Any:
    array = np.ascontiguousarray(value)
    if array.dtype.hasobject:
        return "list", *map(_plain, array.ravel().tolist())
    return str(array.dtype), array.shape, _digest(array.tobytes())
