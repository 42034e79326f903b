"""Fitted parameters in YAML files: frozen dataclasses with the names of the data that they were fitted to."""

from __future__ import annotations

from dataclasses import asdict, fields, is_dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml

from iptm_core.errors import ParameterError

Parameters = TypeVar("Parameters")
DIGITS = 6


def package_folder() -> Path:
    """Return the folder of the shipped parameters."""
    return Path(str(files("iptm_validation.parameters")))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    return value


def save_parameters(path: Path, parameters: Any, description: str) -> None:
    """Write parameters with six digits.

    Args:
        path: the file.
        parameters: a frozen dataclass of numbers, texts, tuples and such dataclasses.
        description: what they are and where the data came from.
    """
    content = {"description": description, "parameters": _plain(asdict(parameters))}
    text = yaml.safe_dump(content, sort_keys=False, width=110, default_flow_style=None)
    path.write_text(
        f"# Written by `scripts/validate --fit`; do not edit.\n{text}", encoding="utf-8"
    )


def load_parameters(path: Path, kind: type[Parameters]) -> Parameters:
    """Read parameters.

    Raises:
        ParameterError: the file is missing or does not have the fields of ``kind``.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        built: Parameters = _build(content["parameters"], kind)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(f"fitted parameters {path.name}: {error}") from error
    return built


def _build(value: Any, kind: Any) -> Any:
    if get_origin(kind) is tuple:
        (entry, *_) = get_args(kind)
        return tuple(_build(item, entry) for item in value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        unknown = set(value) - {entry.name for entry in fields(kind)}
        if unknown:
            raise ValueError(f"unknown entries {sorted(unknown)}")
        return cast("Any", kind)(
            **{name: _build(item, hints[name]) for name, item in value.items()}
        )
    return kind(value)
