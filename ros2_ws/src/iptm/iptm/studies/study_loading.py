"""Reads studies from YAML files, strictly: whatever is not understood is refused.

A file has ``title``, ``about``, ``defaults`` (settings of every run) and ``cases``. A case has a
``name``, ``labels``, ``run`` (settings that differ) and ``for_each``: a list of axes, each a list of
points with ``labels`` and ``run``; the case then stands for every combination. In texts, ``{label}`` is
replaced by the value of a label.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from iptm.studies.run_spec import (
    REPRODUCED_CYCLE,
    REPRODUCED_SET,
    SECTIONS,
    RunSpec,
)
from iptm.studies.study import DEFAULT_CRITERION, Case, Label, Selection, Study
from iptm_controller.strategy import Strategy, strategy_by_name
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import YAML_SUFFIXES, read_yaml
from iptm_core.routes.user_csv import GPX_SUFFIX, USER_SUFFIXES
from iptm_core.user_input import StrictMapping, is_path, shown, suggestion

_FOLDER = Path(__file__).parent / "studies"
MAX_CASES = 10_000
PAPER_ORDER = (
    "strategies",
    "weighting",
    "prediction_horizon",
    "sampling_time",
    "long_horizon",
    "whole_trip",
)
_GROUPED = {name for section in SECTIONS.values() for name in section.values()}
SETTINGS = (*(entry.name for entry in fields(RunSpec) if entry.name not in _GROUPED), *SECTIONS)
"""Keys of ``run`` and ``defaults``."""

_FILES = {"cycle": USER_SUFFIXES, "slope": (GPX_SUFFIX,), "parameter_set": YAML_SUFFIXES}
_BASE = "base"
_BEST_OF = "best_of"
_WEIGHTS = tuple(entry.name for entry in fields(Strategy) if entry.name not in {"name", "rules"})
_Point = tuple[Mapping[str, Label], Mapping[str, Any]]
"""Labels and settings of one value of an axis."""
_STUDY_KEYS = ("title", "about", "defaults", "cases")
_CASE_KEYS = ("name", "labels", "run", "for_each")
_POINT_KEYS = ("labels", "run")
_PLACE = re.compile(r"\{([^{}]*)\}")
_NAME = re.compile(r"[\w.+-]+")


def available_studies() -> tuple[str, ...]:
    """Names of the shipped studies, in the order of the paper."""
    names = {path.stem for path in _FOLDER.iterdir() if path.suffix in YAML_SUFFIXES}
    place = {name: number for number, name in enumerate(PAPER_ORDER)}
    return tuple(sorted(names, key=lambda name: (place.get(name, len(place)), name)))


def load_study(name_or_path: str | Path) -> Study:
    """Load a shipped study by name, or a user's own by the path of its file.

    Raises:
        ScenarioError: unknown study, or an error in the file, with its place, value and what is
            allowed.
    """
    names = available_studies()
    if str(name_or_path) in names:
        return read_study(_FOLDER / f"{name_or_path}.yaml")
    path = Path(name_or_path)
    if path.suffix in YAML_SUFFIXES:
        return read_study(path)
    raise ScenarioError(
        f"no study {str(name_or_path)!r}; {suggestion(name_or_path, names)}, or the path of a .yaml file"
    )


def read_study(path: Path) -> Study:
    """Read a study file; raises as ``load_study``."""
    content = StrictMapping(read_yaml(path, ScenarioError), str(path), _STUDY_KEYS)
    content.require("title", "cases")
    if not _NAME.fullmatch(path.stem):
        raise ScenarioError(
            f"{path}: the file name is the study's name; allowed: letters, digits and . _ + -"
        )
    defaults = content.section("defaults", SETTINGS).content
    cases: list[Case] = []
    for number, entry in enumerate(content.entries("cases"), start=1):
        written = StrictMapping(entry, f"{path}: case {number}", _CASE_KEYS)
        cases += _read_cases(written, defaults, path.parent, MAX_CASES - len(cases))
    return Study(
        name=path.stem,
        title=content.text("title"),
        about=" ".join(content.text("about", "").split()),
        cases=tuple(cases),
    )


def _read_cases(
    content: StrictMapping, defaults: Mapping[str, Any], folder: Path, most: int
) -> list[Case]:
    """Return all cases that an entry stands for: its axes are multiplied out, if that is not too many."""
    name = content.text("name")
    axes = [[_read_point(content)]]
    for number, axis in enumerate(content.entries("for_each", may_be_empty=True), start=1):
        at = f"{content.where}: for_each {number}"
        if not isinstance(axis, list) or not axis:
            raise ScenarioError(f"{at} is {shown(axis)}; allowed: a list with at least one entry")
        axes.append(
            [
                _read_point(StrictMapping(point, f"{at}, point {count}", _POINT_KEYS))
                for count, point in enumerate(axis, start=1)
            ]
        )
    where = f"{content.where} ({name})"
    count = math.prod(map(len, axes))
    if count > most:
        raise ScenarioError(
            f"{where}: {count} cases; allowed: {MAX_CASES} in a study, {most} are left"
        )
    return [_case(name, where, defaults, points, folder) for points in itertools.product(*axes)]


def _read_point(content: StrictMapping) -> _Point:
    labels = content.section("labels", kind="label")
    for name, label in labels.content.items():
        if isinstance(label, bool) or not isinstance(label, str | int | float):
            labels.refuse(name, "a text or a number")
    return dict(labels.content), content.section("run", SETTINGS).content


def _case(
    name: str, where: str, defaults: Mapping[str, Any], points: Iterable[_Point], folder: Path
) -> Case:
    labels: dict[str, Label] = {}
    settings: Mapping[str, Any] = defaults
    for its_labels, run in points:
        again = sorted(set(labels) & set(its_labels))
        if again:
            raise ScenarioError(f"{where}: the label {again[0]!r} is given twice")
        labels |= its_labels
        settings = merge_settings(settings, run)
    settings = _filled(settings, labels, where)
    name = _filled(name, labels, where)
    try:
        best_of = read_selection(settings.get("strategy"))
        return Case(name, labels, build_spec(settings, folder), best_of)
    except IptmError as error:
        raise ScenarioError(f"{where}{f' {labels}' if labels else ''}: {error}") from error


def _filled(value: Any, labels: Mapping[str, Label], where: str) -> Any:
    """Replace ``{label}`` in all texts of a value."""
    if isinstance(value, Mapping):
        return {key: _filled(entry, labels, where) for key, entry in value.items()}
    if not isinstance(value, str):
        return value

    def label_text(match: re.Match[str]) -> str:
        if match[1] not in labels:
            raise ScenarioError(
                f"{where}: {{{match[1]}}} in {value!r} is not a label; "
                f"allowed: {', '.join(labels) or 'none'}"
            )
        found = labels[match[1]]
        return found if isinstance(found, str) else f"{found:g}"

    return _PLACE.sub(label_text, value)


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
    """Build the specification of a run from settings by key; files named in them are looked up in a folder.

    Raises:
        IptmError: a key or value is not as it should be.
    """
    written = StrictMapping(settings, "run", SETTINGS)
    arguments: dict[str, Any] = {}
    for key, value in written.content.items():
        if key in SECTIONS:
            section = written.section(key, SECTIONS[key])
            arguments |= {SECTIONS[key][name]: entry for name, entry in section.content.items()}
        else:
            arguments[key] = _READERS[key](written) if key in _READERS else value
    for key, suffixes in _FILES.items():
        if is_path(str(arguments.get(key, "")), suffixes):
            arguments[key] = str(folder / arguments[key])
    return RunSpec(**{"cycle": REPRODUCED_CYCLE, "parameter_set": REPRODUCED_SET, **arguments})


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


def _overrides(name: str, run: StrictMapping) -> tuple[tuple[str, float], ...]:
    written = run.section(name)
    return tuple((key, written.number(key)) for key in written)


_READERS: Mapping[str, Callable[[StrictMapping], Any]] = {
    **{name: partial(_overrides, name) for name in ("overrides", "controller_overrides")},
    "strategy": _strategy,
}
"""Settings that are more than one value; the specification checks all others itself."""
