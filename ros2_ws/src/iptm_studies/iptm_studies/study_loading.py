"""Reads studies from YAML files, strictly: whatever is not understood is refused.

A file has ``title``, ``about``, ``defaults`` (settings of every run) and ``cases``. A case has a
``name``, ``labels``, ``run`` (settings that differ) and ``for_each``: a list of axes, each a list of
points with ``labels`` and ``run``; the case then stands for every combination. In texts, ``{label}`` is
replaced by the value of a label.
"""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_studies.run_settings import SETTINGS, build_spec, merge_settings, read_selection
from iptm_studies.study import Case, Label, Study

MAX_CASES = 10_000
_SUFFIXES = (".yaml", ".yml")
_STUDY_KEYS = ("title", "about", "defaults", "cases")
_CASE_KEYS = ("name", "labels", "run", "for_each")
_POINT_KEYS = ("labels", "run")
_PLACE = re.compile(r"\{([^{}]*)\}")
_NAME = re.compile(r"[\w.+-]+")


def available_studies() -> tuple[str, ...]:
    """Names of the shipped studies, in the order of the paper."""
    names = {path.stem for path in _folder().iterdir() if path.suffix in _SUFFIXES}
    ordered = [name for name in PAPER_ORDER if name in names]
    return (*ordered, *sorted(names - set(ordered)))


PAPER_ORDER = (
    "strategies",
    "weighting",
    "prediction_horizon",
    "sampling_time",
    "long_horizon",
    "whole_trip",
)


def load_study(name_or_path: str | Path) -> Study:
    """Load a shipped study by name, or a user's own by the path of its file.

    Raises:
        ScenarioError: no such study, or something in the file is wrong; says where, what, and what is
            allowed.
    """
    return read_study(_find(name_or_path))


def read_study(path: Path) -> Study:
    """Read a study file.

    Raises:
        ScenarioError: as for ``load_study``.
    """
    content = _mapping(read_yaml(path, ScenarioError), _STUDY_KEYS, str(path))
    for key in ("title", "cases"):
        if key not in content:
            raise ScenarioError(f"{path}: {key!r} is missing")
    if not _NAME.fullmatch(path.stem):
        raise ScenarioError(
            f"{path}: the file name is the study's name; allowed are letters, digits and . _ + -"
        )
    defaults = _mapping(content.get("defaults", {}), SETTINGS, f"{path}: defaults")
    cases: list[Case] = []
    for number, entry in enumerate(_sequence(content["cases"], f"{path}: cases"), start=1):
        draft = _Draft.read(entry, f"{path}: case {number}")
        cases += draft.expand(defaults, path.parent)
        if len(cases) > MAX_CASES:
            raise ScenarioError(f"{path}: more than {MAX_CASES} cases")
    return Study(
        name=path.stem,
        title=_text(content["title"], f"{path}: title"),
        about=" ".join(_text(content.get("about", ""), f"{path}: about").split()),
        cases=tuple(cases),
    )


@dataclass(frozen=True)
class _Draft:
    """A case as written, before its axes are multiplied out."""

    where: str
    name: str
    labels: Mapping[str, Label]
    run: Mapping[str, Any]
    axes: tuple[tuple[_Point, ...], ...]

    @classmethod
    def read(cls, entry: Any, where: str) -> _Draft:
        content = _mapping(entry, _CASE_KEYS, where)
        if "name" not in content:
            raise ScenarioError(f"{where}: 'name' is missing")
        name = _text(content["name"], f"{where}: name")
        axes = []
        written = _sequence(content.get("for_each", []), f"{where}: for_each", empty=True)
        for number, axis in enumerate(written, start=1):
            at = f"{where}: for_each {number}"
            points = enumerate(_sequence(axis, at), start=1)
            axes.append(
                tuple(_Point.read(point, f"{at}, point {count}") for count, point in points)
            )
        return cls(
            where=f"{where} ({name})",
            name=name,
            labels=_labels(content.get("labels", {}), where),
            run=_mapping(content.get("run", {}), SETTINGS, f"{where}: run"),
            axes=tuple(axes),
        )

    def expand(self, defaults: Mapping[str, Any], folder: Path) -> list[Case]:
        """All cases that the draft stands for."""
        return [
            self._case(defaults, combination, folder)
            for combination in itertools.product(*self.axes)
        ]

    def _case(self, defaults: Mapping[str, Any], points: Sequence[_Point], folder: Path) -> Case:
        labels = dict(self.labels)
        settings = merge_settings(defaults, self.run)
        for point in points:
            again = sorted(set(labels) & set(point.labels))
            if again:
                raise ScenarioError(f"{self.where}: the label {again[0]!r} is given twice")
            labels |= point.labels
            settings = merge_settings(settings, point.run)
        settings = _filled(settings, labels, self.where)
        where = f"{self.where} {labels}" if labels else self.where
        try:
            return Case(
                name=_filled(self.name, labels, self.where),
                labels=labels,
                spec=build_spec(settings, folder),
                best_of=read_selection(settings.get("strategy")),
            )
        except IptmError as error:
            raise ScenarioError(f"{where}: {error}") from error


@dataclass(frozen=True)
class _Point:
    """One value of an axis."""

    labels: Mapping[str, Label] = field(default_factory=dict)
    run: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, entry: Any, where: str) -> _Point:
        content = _mapping(entry, _POINT_KEYS, where)
        return cls(
            labels=_labels(content.get("labels", {}), where),
            run=_mapping(content.get("run", {}), SETTINGS, f"{where}: run"),
        )


def _filled(value: Any, labels: Mapping[str, Label], where: str) -> Any:
    """Replace ``{label}`` in all texts of a value."""
    if isinstance(value, Mapping):
        return {key: _filled(entry, labels, where) for key, entry in value.items()}
    if not isinstance(value, str):
        return value

    def label_text(match: re.Match[str]) -> str:
        if match[1] not in labels:
            raise ScenarioError(
                f"{where}: {{{match[1]}}} in {value!r} is no label; "
                f"known are {', '.join(labels) or 'none'}"
            )
        found = labels[match[1]]
        return found if isinstance(found, str) else f"{found:g}"

    return _PLACE.sub(label_text, value)


def _labels(value: Any, where: str) -> dict[str, Label]:
    labels = _mapping(value, None, f"{where}: labels")
    for name, label in labels.items():
        if isinstance(label, bool) or not isinstance(label, str | int | float):
            raise ScenarioError(
                f"{where}: label {name!r} is {label!r}; allowed are texts and numbers"
            )
    return labels


def _mapping(value: Any, known: Collection[str] | None, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ScenarioError(f"{where}: a mapping is needed, got {value!r:.80}")
    for key in value:
        if not isinstance(key, str):
            raise ScenarioError(f"{where}: the key {key!r} must be text")
        if known is not None and key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"allowed are {', '.join(known)}"
            raise ScenarioError(f"{where}: unknown key {key!r}; {hint}")
    return value


def _sequence(value: Any, where: str, *, empty: bool = False) -> list[Any]:
    if not isinstance(value, list) or not (value or empty):
        raise ScenarioError(f"{where}: a list with at least one entry is needed, got {value!r:.80}")
    return value


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise ScenarioError(f"{where}: text is needed, got {value!r:.80}")
    return value


def _folder() -> Path:
    # The packages are installed as plain folders, so this is a real path.
    return Path(str(resources.files("iptm_studies").joinpath("studies")))


def _find(name_or_path: str | Path) -> Path:
    names = available_studies()
    if str(name_or_path) in names:
        return _folder() / f"{name_or_path}.yaml"
    path = Path(name_or_path)
    if path.suffix in _SUFFIXES:
        return path
    near = difflib.get_close_matches(str(name_or_path), names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ScenarioError(
        f"no study {str(name_or_path)!r}; {hint}shipped are {', '.join(names)}; "
        "the path of a .yaml file is welcome as well"
    )
