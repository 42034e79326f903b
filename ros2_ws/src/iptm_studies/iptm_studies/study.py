"""Studies and trials as data: named cases, each one run, what varies between them, and what was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from iptm_core.errors import ScenarioError
from iptm_studies.run_spec import RunSpec

Label = str | int | float
DEFAULT_CRITERION = "total_degradation"


@dataclass(frozen=True)
class Selection:
    """Take the strategy of the best run of another study, as the paper does for its weighted strategies.

    Attributes:
        study: name of the other study.
        labels: only its cases with these labels count; empty for all.
        lowest: key of the figure that decides (see ``iptm_core.metrics.FIGURES``), smaller is better.
            Runs that break a hard limit come last, whatever their figure.
    """

    study: str
    labels: Mapping[str, Label] = field(default_factory=dict)
    lowest: str = DEFAULT_CRITERION

    def matches(self, case: Case) -> bool:
        """True if a case of the other study counts."""
        return all(case.labels.get(name) == value for name, value in self.labels.items())


@dataclass(frozen=True)
class Case:
    """One run of a study.

    Attributes:
        name: unique in the study.
        labels: what varies, by name, for tables and plots.
        spec: the run; with ``best_of`` its strategy is replaced by the one found.
    """

    name: str
    labels: Mapping[str, Label]
    spec: RunSpec
    best_of: Selection | None = None


@dataclass(frozen=True)
class Study:
    """A set of runs that belong together; ``about`` is what it shows, a few sentences."""

    name: str
    title: str
    about: str
    cases: tuple[Case, ...]

    def __post_init__(self) -> None:
        names = [case.name for case in self.cases]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ScenarioError(
                f"study {self.name}: the case name {twice[0]!r} occurs more than once; "
                "allowed: different names"
            )

    def address(self, case: Case) -> str:
        """Return the address of one of its cases, ``study/case``."""
        return f"{self.name}/{case.name}"

    def shortened(self, *, compile_code: bool = True, **settings: Any) -> Study:
        """Return the same cases with other settings of their runs, such as a shorter trip.

        Args:
            compile_code: False interprets all controllers.
            settings: as in `RunSpec`.
        """

        def shortened(spec: RunSpec) -> RunSpec:
            solver = spec.solver if compile_code else replace(spec.solver, compile_code=False)
            return replace(spec, solver=solver, **settings)

        cases = (replace(case, spec=shortened(case.spec)) for case in self.cases)
        return replace(self, cases=tuple(cases))


@dataclass(frozen=True)
class Judged:
    """A trial, what was found in it, and what of that did not hold.

    Attributes:
        name: of the trial, and how it was driven.
        what: the trial in words.
        labels: what tables group it by.
        figures: what was found, by name; a figure that does not exist is left out.
        problems: what did not hold, in words, by the name of the requirement.
        counts: what occurred how often.
    """

    name: str
    what: str
    labels: Mapping[str, Label] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    problems: Mapping[str, str] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def problem_text(self) -> str:
        """What did not hold, in one line; empty if everything did."""
        return ", ".join(self.problems.values())


@dataclass(frozen=True)
class ShortTrip:
    """The trip that the small version of a study drives instead of its own."""

    cycle: str = "us06"
    slope: str = "small"
    duration_s: float = 600.0

    def shorten(self, study: Study) -> Study:
        """The same cases on the short trip."""
        return study.shortened(**asdict(self))


SMALL = ShortTrip()
"""Ten lively minutes: the whole US06 cycle over gentle hills."""
