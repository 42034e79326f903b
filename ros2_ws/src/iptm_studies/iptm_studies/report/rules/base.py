"""What a rule is, and how rules put runs and figures into words."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from iptm_studies.report.measures import MEASURES, change_text
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Tolerance


@dataclass(frozen=True)
class Printed:
    """Numbers of the paper that a rule can be applied to, beside its own arguments.

    Attributes:
        measures: figure by run address and key, as printed.
        change_tolerance: when a relative change counts as the printed one.
    """

    measures: Mapping[str, Mapping[str, float]]
    change_tolerance: Tolerance

    def value(self, address: str, key: str) -> float | None:
        """A printed figure, or None."""
        return self.measures.get(address, {}).get(key)


class Rule(ABC):
    """Checks one statement. Subclasses are frozen dataclasses; fields are the arguments of a claim."""

    @abstractmethod
    def needs(self) -> tuple[str, ...]:
        """Addresses of the runs without which the rule cannot be applied."""

    @abstractmethod
    def text(self, printed: Printed) -> str:
        """The rule in words, with its tolerances."""

    @abstractmethod
    def judge(self, results: Results, printed: Printed) -> Judgement:
        """Apply the rule; every needed run is there."""


def label(key: str) -> str:
    """Name of a figure inside a sentence."""
    text = MEASURES[key].label
    return text[0].lower() + text[1:]


def labels(keys: tuple[str, ...]) -> str:
    """Names of several figures inside a sentence."""
    return ", ".join(label(key) for key in keys)


def with_unit(key: str, value: float) -> str:
    """A figure with its unit."""
    return MEASURES[key].with_unit(value)


def points(tolerance: Tolerance) -> str:
    """A tolerance on relative changes in words."""
    return (
        f"the larger of {100.0 * tolerance.floor:g} percentage point(s) and "
        f"{100.0 * tolerance.share:g} % of the printed change"
    )


def changes(values: Mapping[str, float | None]) -> str:
    """Relative changes in words."""
    return ", ".join(f"{name} {change_text(value)}" for name, value in values.items())
