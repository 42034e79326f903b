"""Rules for statements about a figure along a series of runs: it rises, falls, levels off, spreads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iptm_core.state import FloatArray
from iptm_studies.report.measures import MEASURES, change_text
from iptm_studies.report.naming import name_of, names_of
from iptm_studies.report.rules.base import Printed, Rule, label, labels
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Verdict, worst

LEVEL_STEP = 5e-4
"""Relative change from one run to the next that still counts as level."""

_SIGNS = {"rises": 1.0, "falls": -1.0}


def _series(results: Results, runs: tuple[str, ...], key: str) -> FloatArray | None:
    values = [results.measure(run, key) for run in runs]
    known = [value for value in values if value is not None]
    return np.array(known) if len(known) == len(values) else None


def _steps_text(key: str, values: FloatArray) -> str:
    measure = MEASURES[key]
    *first, last = values.tolist()
    series = " → ".join([*(measure.text(value) for value in first), measure.with_unit(last)])
    total = change_text(float(values[-1] / values[0] - 1.0)) if values[0] != 0.0 else "–"
    return f"{label(key)} {series} ({total})"


def _moves_against(values: FloatArray, sign: float) -> bool:
    """True if some step goes the other way by more than a level step."""
    steps = np.diff(values) * sign
    return bool(np.any(steps < -LEVEL_STEP * np.abs(values[:-1])))


@dataclass(frozen=True)
class Trend(Rule):
    """Figures rise or fall along a series of runs."""

    runs: tuple[str, ...]
    directions: Mapping[str, str]
    least_change: float = 0.0
    every_step: bool = True

    def __post_init__(self) -> None:
        unknown = set(self.directions.values()) - set(_SIGNS)
        if unknown:
            raise ValueError(f"direction {sorted(unknown)}; allowed are {', '.join(_SIGNS)}")

    def needs(self) -> tuple[str, ...]:
        """The series."""
        return self.runs

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        wanted = ", ".join(f"{label(key)} {word}" for key, word in self.directions.items())
        size = f" by at least {100.0 * self.least_change:g} % in all" if self.least_change else ""
        if not self.every_step:
            return f"From {name_of(self.runs[0])} to {name_of(self.runs[-1])}: reproduced if {wanted}{size}."
        return (
            f"Along {names_of(self.runs)}: {wanted}. Reproduced if so from run to run (a step of "
            f"{100.0 * LEVEL_STEP:g} % counts as level){size}; in sign only if so from the first to the "
            "last run."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Follow each figure along the series."""
        verdicts, texts = [], []
        for key, word in self.directions.items():
            values = _series(results, self.runs, key)
            if values is None:
                return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(key)}")
            sign = _SIGNS[word]
            total = sign * (values[-1] - values[0])
            enough = total >= self.least_change * abs(values[0])
            if total <= 0.0:
                verdicts.append(Verdict.NOT_REPRODUCED)
            elif enough and not (self.every_step and _moves_against(values, sign)):
                verdicts.append(Verdict.REPRODUCED)
            else:
                verdicts.append(Verdict.SIGN_ONLY)
            texts.append(_steps_text(key, values))
        return Judgement(worst(verdicts), "; ".join(texts))


@dataclass(frozen=True)
class NotAlways(Rule):
    """A figure does not follow a direction along the whole series ("does not always decrease")."""

    runs: tuple[str, ...]
    measures: tuple[str, ...]
    direction: str

    def __post_init__(self) -> None:
        if self.direction not in _SIGNS:
            raise ValueError(f"direction '{self.direction}'; allowed are {', '.join(_SIGNS)}")

    def needs(self) -> tuple[str, ...]:
        """The series."""
        return self.runs

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Along {names_of(self.runs)}: reproduced if {labels(self.measures)} not always "
            f"{self.direction} (at least one figure moves the other way by more than "
            f"{100.0 * LEVEL_STEP:g} % in a step)."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Look for a step the other way."""
        texts, against = [], False
        for key in self.measures:
            values = _series(results, self.runs, key)
            if values is None:
                return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(key)}")
            against = against or _moves_against(values, _SIGNS[self.direction])
            texts.append(_steps_text(key, values))
        verdict = Verdict.REPRODUCED if against else Verdict.NOT_REPRODUCED
        return Judgement(verdict, "; ".join(texts))


@dataclass(frozen=True)
class TrendInGroups(Rule):
    """A figure rises or falls along each of several series."""

    groups: Mapping[str, tuple[str, ...]]
    measure: str
    direction: str
    needed_share: float = 1.0

    def __post_init__(self) -> None:
        if self.direction not in _SIGNS:
            raise ValueError(f"direction '{self.direction}'; allowed are {', '.join(_SIGNS)}")

    def needs(self) -> tuple[str, ...]:
        """All series."""
        return tuple(run for runs in self.groups.values() for run in runs)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        share = (
            "each" if self.needed_share >= 1.0 else f"at least {100.0 * self.needed_share:.0f} %"
        )
        return (
            f"{MEASURES[self.measure].label} {self.direction} along {share} of the series "
            f"{', '.join(self.groups)}: reproduced if so from run to run (a step of "
            f"{100.0 * LEVEL_STEP:g} % counts as level), in sign only if so from first to last run."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Follow the figure along each series."""
        sign = _SIGNS[self.direction]
        steady, overall, texts = 0, 0, []
        for name, runs in self.groups.items():
            values = _series(results, runs, self.measure)
            if values is None:
                return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(self.measure)}")
            overall += bool(sign * (values[-1] - values[0]) > 0.0)
            steady += bool(
                sign * (values[-1] - values[0]) > 0.0 and not _moves_against(values, sign)
            )
            total = change_text(float(values[-1] / values[0] - 1.0))
            texts.append(f"{name}: {total}")
        needed = self.needed_share * len(self.groups)
        if steady >= needed:
            verdict = Verdict.REPRODUCED
        elif overall >= needed:
            verdict = Verdict.SIGN_ONLY
        else:
            verdict = Verdict.NOT_REPRODUCED
        found = (
            f"{label(self.measure)} {self.direction} from first to last run in {overall} and at every "
            f"step in {steady} of {len(self.groups)} series ({'; '.join(texts)})"
        )
        return Judgement(verdict, found)


@dataclass(frozen=True)
class LevelsOff(Rule):
    """What one more step of a series gains becomes less; gains count per unit of ``positions``."""

    groups: Mapping[str, tuple[str, ...]]
    positions: tuple[float, ...]
    measures: tuple[str, ...]

    def needs(self) -> tuple[str, ...]:
        """All series."""
        return tuple(run for runs in self.groups.values() for run in runs)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Along {'; '.join(self.groups)}: reproduced if the last step saves less of each of "
            f"{labels(self.measures)} per unit than the first step, and the whole series saves something; "
            "in sign only if the series saves something."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the first and last gains."""
        verdicts, texts = [], []
        for name, runs in self.groups.items():
            for key in self.measures:
                values = _series(results, runs, key)
                if values is None:
                    return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(key)}")
                gains = -np.diff(values) / np.diff(self.positions) / values[0]
                saves = values[-1] < values[0]
                less = bool(gains[-1] < gains[0])
                verdicts.append(
                    Verdict.REPRODUCED
                    if saves and less
                    else Verdict.SIGN_ONLY
                    if saves
                    else Verdict.NOT_REPRODUCED
                )
                texts.append(
                    f"{name}, {label(key)}: {100.0 * gains[0]:.3f} % per unit at first, "
                    f"{100.0 * gains[-1]:.3f} % at last"
                )
        return Judgement(worst(verdicts), "; ".join(texts))


@dataclass(frozen=True)
class Spread(Rule):
    """A figure depends on a choice: largest over smallest value of each group of runs."""

    groups: Mapping[str, tuple[str, ...]]
    measures: tuple[str, ...]
    at_least: float | None = None
    at_most: float | None = None

    def needs(self) -> tuple[str, ...]:
        """All runs."""
        return tuple(run for runs in self.groups.values() for run in runs)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        bounds = [
            f"{word} {100.0 * value:g} %"
            for word, value in (("at least", self.at_least), ("at most", self.at_most))
            if value is not None
        ]
        return (
            f"Largest over smallest value minus one within {', '.join(self.groups)}: reproduced if in each "
            f"group one of {labels(self.measures)} spreads {' and '.join(bounds)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Find the spread of each group."""
        texts, holds = [], True
        for name, runs in self.groups.items():
            spreads = {}
            for key in self.measures:
                values = _series(results, runs, key)
                if values is None:
                    return Judgement(Verdict.NOT_TESTED, f"the stored runs lack {label(key)}")
                spreads[key] = float(np.max(values) / np.min(values) - 1.0)
            largest = max(spreads, key=spreads.__getitem__)
            enough = self.at_least is None or spreads[largest] >= self.at_least
            small = self.at_most is None or spreads[largest] <= self.at_most
            holds = holds and enough and small
            texts.append(f"{name}: {label(largest)} {100.0 * spreads[largest]:.2f} %")
        return Judgement(Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED, "; ".join(texts))
