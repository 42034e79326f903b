"""Settings of a run as a study file writes them, turned into a specification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from iptm_controller.strategy import Strategy, strategy_by_name
from iptm_core.errors import ScenarioError
from iptm_studies.run_spec import PreviewSpec, RunKind, RunSpec, SolverSpec
from iptm_studies.study import DEFAULT_CRITERION, Selection

SETTINGS = tuple(entry.name for entry in fields(RunSpec))
"""Keys of ``run`` and ``defaults``."""

_FILES = {"cycle": ".csv", "parameter_set": ".yaml"}
_BASE = "base"
_BEST_OF = "best_of"
_SELECTION_KEYS = ("study", "labels", "lowest")
_WEIGHTS = tuple(entry.name for entry in fields(Strategy) if entry.name != "name")
_Section = TypeVar("_Section", SolverSpec, PreviewSpec)


def merge_settings(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Lay settings over others: sections key by key, all else (a strategy, too) as a whole."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        if key != "strategy" and isinstance(value, dict) and isinstance(below, dict):
            merged[key] = {**below, **value}
        else:
            merged[key] = value
    return merged


def build_spec(settings: Mapping[str, Any], folder: Path) -> RunSpec:
    """Build the specification of a run.

    Args:
        settings: by key, see ``SETTINGS``.
        folder: files named in it are looked up here.

    Raises:
        IptmError: a key or value is not as it should be.
    """
    _check_keys(settings, SETTINGS, "run")
    arguments = {key: _READERS[key](value, key) for key, value in settings.items()}
    for key, suffix in _FILES.items():
        if str(arguments.get(key, "")).lower().endswith(suffix):
            arguments[key] = str(folder / arguments[key])
    return RunSpec(**arguments)


def read_selection(strategy: Any) -> Selection | None:
    """Read ``{best_of: {study: ..., labels: ..., lowest: ...}}``; None for a stated strategy.

    Raises:
        ScenarioError: it is not of this form.
    """
    if not isinstance(strategy, dict) or _BEST_OF not in strategy:
        return None
    _check_keys(strategy, (_BEST_OF,), "strategy")
    content = _mapping(strategy[_BEST_OF], "strategy: best_of")
    _check_keys(content, _SELECTION_KEYS, "strategy: best_of")
    if "study" not in content:
        raise ScenarioError("strategy: best_of: 'study' is missing")
    return Selection(
        study=_text(content["study"], "strategy: best_of: study"),
        labels=_mapping(content.get("labels", {}), "strategy: best_of: labels"),
        lowest=_text(content.get("lowest", DEFAULT_CRITERION), "strategy: best_of: lowest"),
    )


def _strategy(value: Any, where: str) -> Strategy:
    if isinstance(value, str):
        return strategy_by_name(value)
    content = _mapping(value, where)
    if _BEST_OF in content:
        return strategy_by_name("aging")  # stands in until the best run is known
    _check_keys(content, (_BASE, *_WEIGHTS), where)
    if _BASE not in content:
        raise ScenarioError(
            f"{where}: 'base' is missing: the name of the strategy that the weights belong to"
        )
    weights: dict[str, Any] = {
        key: _number(number, f"{where}: {key}") for key, number in content.items() if key != _BASE
    }
    return replace(strategy_by_name(_text(content[_BASE], f"{where}: base")), **weights)


def _kind(value: Any, where: str) -> RunKind:
    kinds = [kind.value for kind in RunKind]
    if value not in kinds:
        raise ScenarioError(f"{where} is {value!r}; allowed are {', '.join(kinds)}")
    return RunKind(value)


def _overrides(value: Any, where: str) -> tuple[tuple[str, float], ...]:
    return tuple(
        (key, _number(number, f"{where}: {key}")) for key, number in _mapping(value, where).items()
    )


def _optional_number(value: Any, where: str) -> float | None:
    return None if value is None else _number(value, where)


def _section(usual: _Section, value: Any, where: str) -> _Section:
    """Lay a mapping over the defaults of a section; types follow the defaults."""
    content = _mapping(value, where)
    _check_keys(content, tuple(entry.name for entry in fields(usual)), where)
    changes: dict[str, Any] = {}
    for key, given in content.items():
        before = getattr(usual, key)
        at = f"{where}: {key}"
        if isinstance(before, str):
            changes[key] = _text(given, at)
        elif isinstance(before, int):
            changes[key] = _whole(given, at)
        elif given is None and before is None:
            changes[key] = None
        else:
            changes[key] = _number(given, at)
    return replace(usual, **changes)


def _check_keys(content: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in content:
        if key not in known:
            raise ScenarioError(f"{where}: unknown key {key!r}; allowed are {', '.join(known)}")


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise ScenarioError(f"{where}: a mapping of names is needed, got {value!r:.80}")
    return value


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise ScenarioError(f"{where}: text is needed, got {value!r:.80}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"{where}: a number is needed, got {value!r:.80}")
    try:
        return float(value)
    except OverflowError as error:
        raise ScenarioError(f"{where}: the number is too large to be used") from error


def _whole(value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ScenarioError(f"{where}: a whole number is needed, got {value!r:.80}")
    return value


_READERS: dict[str, Callable[[Any, str], Any]] = {
    "kind": _kind,
    "cycle": _text,
    "slope": _text,
    "duration_s": _optional_number,
    "parameter_set": _text,
    "overrides": _overrides,
    "strategy": _strategy,
    "horizon": _text,
    "solver": partial(_section, SolverSpec()),
    "preview": partial(_section, PreviewSpec()),
    "tick_s": _number,
    "plant_step_s": _number,
}
