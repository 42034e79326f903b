"""Parameters that were fitted to measurements: the files in `parameters`, as data."""

from __future__ import annotations

from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml

Parameters = TypeVar("Parameters")


def load_fitted(name: str, kind: type[Parameters]) -> Parameters:
    """Read the parameters of a model from its file, as a dataclass of numbers, texts and dataclasses."""
    file = Path(__file__).parent / "parameters" / f"{name}.yaml"
    return cast("Parameters", _build(yaml.safe_load(file.read_text("utf-8"))["parameters"], kind))


def _build(value: Any, kind: Any) -> Any:
    if get_origin(kind) is tuple:
        return tuple(_build(item, get_args(kind)[0]) for item in value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        given = {name: _build(item, hints[name]) for name, item in value.items()}
        return cast("Any", kind)(**given)
    return kind(value)
