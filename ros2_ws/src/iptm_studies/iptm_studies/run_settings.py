"""Settings of a run as a study file writes them, turned into a specification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from iptm_controller.strategy import Strategy, strategy_by_name
from iptm_core.errors import ScenarioError
from iptm_core.strict_mapping import StrictMapping
from iptm_studies.run_spec import PreviewSpec, RunSpec, SolverSpec
from iptm_studies.study import DEFAULT_CRITERION, Selection

SETTINGS = tuple(entry.name for entry in fields(RunSpec))
"""Keys of ``run`` and ``defaults``."""

_FILES = {"cycle": ".csv", "parameter_set": ".yaml"}
_BASE = "base"
_BEST_OF = "best_of"
_WEIGHTS = tuple(entry.name for entry in fields(Strategy) if entry.name != "name")
_SOLVER_FIELDS = tuple(entry.name for entry in fields(SolverSpec))
_PREVIEW_FIELDS = {entry.name.removeprefix("preview_"): entry.name for entry in fields(PreviewSpec)}
"""Key in the section ``preview`` -> name of the setting; the section says already what it is about."""


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
    written = StrictMapping(settings, "run", SETTINGS)
    arguments = {
        key: _READERS[key](written) if key in _READERS else value
        for key, value in written.content.items()
    }
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
    written = StrictMapping(strategy, "strategy", (_BEST_OF,))
    best_of = written.section(_BEST_OF, ("study", "labels", "lowest"))
    return Selection(
        study=best_of.text("study"),
        labels=best_of.section("labels").content,
        lowest=best_of.text("lowest", DEFAULT_CRITERION),
    )


def _strategy(run: StrictMapping) -> Strategy:
    if isinstance(run.content["strategy"], str):
        return strategy_by_name(run.text("strategy"))
    written = run.section("strategy")
    if _BEST_OF in written:
        return strategy_by_name("aging")  # stands in until the best run is known
    written = run.section("strategy", (_BASE, *_WEIGHTS))
    if _BASE not in written:
        raise ScenarioError(
            f"{written.where}: 'base' is missing: the name of the strategy that the weights belong to"
        )
    weights: dict[str, Any] = {key: written.number(key) for key in written if key != _BASE}
    return replace(strategy_by_name(written.text(_BASE)), **weights)


def _overrides(run: StrictMapping) -> tuple[tuple[str, float], ...]:
    written = run.section("overrides")
    return tuple((key, written.number(key)) for key in written)


def _solver(run: StrictMapping) -> SolverSpec:
    return SolverSpec(**run.section("solver", _SOLVER_FIELDS).content)


def _preview(run: StrictMapping) -> PreviewSpec:
    written = run.section("preview", _PREVIEW_FIELDS)
    return PreviewSpec(**{_PREVIEW_FIELDS[key]: value for key, value in written.content.items()})


_READERS: Mapping[str, Callable[[StrictMapping], Any]] = {
    "overrides": _overrides,
    "strategy": _strategy,
    "solver": _solver,
    "preview": _preview,
}
"""Settings that are more than one value; the specification checks all others itself."""
