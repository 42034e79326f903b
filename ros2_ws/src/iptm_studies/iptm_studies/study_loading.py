"""Reads studies from YAML files, strictly: whatever is not understood is refused.

A file has ``title``, ``about``, ``defaults`` (settings of every run) and ``cases``. A case has a
``name``, ``labels``, ``run`` (settings that differ) and ``for_each``: a list of axes, each a list of
points with ``labels`` and ``run``; the case then stands for every combination. In texts, ``{label}`` is
replaced by the value of a label.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.strict_mapping import StrictMapping, shown, suggestion
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
    content = StrictMapping(read_yaml(path, ScenarioError), str(path), _STUDY_KEYS)
    content.require("title", "cases")
    if not _NAME.fullmatch(path.stem):
        raise ScenarioError(
            f"{path}: the file name is the study's name; allowed: letters, digits and . _ + -"
        )
    defaults = content.section("defaults", SETTINGS).content
    cases: list[Case] = []
    for number, entry in enumerate(content.entries("cases"), start=1):
        draft = _Draft.read(StrictMapping(entry, f"{path}: case {number}", _CASE_KEYS))
        cases += draft.expand(defaults, path.parent)
        if len(cases) > MAX_CASES:
            raise ScenarioError(f"{path}: more than {MAX_CASES} cases")
    return Study(
        name=path.stem,
        title=content.text("title"),
        about=" ".join(content.text("about", "").split()),
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
    def read(cls, content: StrictMapping) -> _Draft:
        name = content.text("name")
        axes = []
        for number, axis in enumerate(content.entries("for_each", may_be_empty=True), start=1):
            at = f"{content.where}: for_each {number}"
            if not isinstance(axis, list) or not axis:
                raise ScenarioError(
                    f"{at} is {shown(axis)}; allowed: a list with at least one entry"
                )
            points = (
                StrictMapping(point, f"{at}, point {count}", _POINT_KEYS)
                for count, point in enumerate(axis, start=1)
            )
            axes.append(tuple(_Point.read(point) for point in points))
        return cls(
            where=f"{content.where} ({name})",
            name=name,
            labels=_labels(content),
            run=content.section("run", SETTINGS).content,
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
    def read(cls, content: StrictMapping) -> _Point:
        return cls(labels=_labels(content), run=content.section("run", SETTINGS).content)


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
                f"allowed: {', '.join(labels) or 'none'}"
            )
        found = labels[match[1]]
        return found if isinstance(found, str) else f"{found:g}"

    return _PLACE.sub(label_text, value)


def _labels(content: StrictMapping) -> dict[str, Label]:
    labels = content.section("labels", kind="label")
    for name, label in labels.content.items():
        if isinstance(label, bool) or not isinstance(label, str | int | float):
            labels.refuse(name, "a text or a number")
    return dict(labels.content)


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
    raise ScenarioError(
        f"no study {str(name_or_path)!r}; {suggestion(name_or_path, names)}, or the path of a .yaml file"
    )
