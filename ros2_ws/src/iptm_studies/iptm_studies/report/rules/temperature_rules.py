"""Rules about temperatures over the time of a trip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_studies.report.naming import name_of
from iptm_studies.report.quantities import (
    busiest_window,
    celsius,
    time_to_fall_s,
)
from iptm_studies.report.rules.base import Printed, Rule
from iptm_studies.report.runs import ReportRun, Results
from iptm_studies.report.verdict import Judgement, Verdict


@dataclass(frozen=True)
class SettlesNear(Rule):
    """Both cells stay near a printed temperature over the last part of the trip."""

    run: str
    printed_c: float
    tolerance_k: float
    last_share: float

    def needs(self) -> tuple[str, ...]:
        """The run."""
        return (self.run,)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Mean temperature of both cells of {name_of(self.run)} over the last "
            f"{100.0 * self.last_share:g} % of the trip: reproduced within "
            f"{self.tolerance_k:g} K of the printed value, in sign only if between that and the start."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Average the end of the trip."""
        run = results[self.run].trajectory
        rows = slice(int((1.0 - self.last_share) * len(run)), None)
        cell_1, cell_n = celsius(run.cell_1_temperature_k), celsius(run.cell_n_temperature_k)
        mean_1, mean_n = float(np.mean(cell_1[rows])), float(np.mean(cell_n[rows]))
        mean = 0.5 * (mean_1 + mean_n)
        if abs(mean - self.printed_c) <= self.tolerance_k:
            verdict = Verdict.REPRODUCED
        elif min(self.printed_c, cell_1[0]) <= mean <= max(self.printed_c, cell_1[0]):
            verdict = Verdict.SIGN_ONLY
        else:
            verdict = Verdict.NOT_REPRODUCED
        return Judgement(
            verdict,
            f"{mean:.2f} °C (cell 1 {mean_1:.2f}, cell N {mean_n:.2f} °C)",
            f"{self.printed_c:g} °C",
        )


@dataclass(frozen=True)
class LastCellFallsSlower(Rule):
    """The last cell cools down more gradually than the first."""

    run: str
    share: float

    def needs(self) -> tuple[str, ...]:
        """The run."""
        return (self.run,)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reproduced if cell N of {name_of(self.run)} takes longer than cell 1 to fall by "
            f"{100.0 * self.share:.0f} % of the way from its start to its lowest temperature."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the times."""
        run = results[self.run].trajectory
        first, last = (
            time_to_fall_s(run.time_s, values, self.share)
            for values in (run.cell_1_temperature_k, run.cell_n_temperature_k)
        )
        return Judgement(
            Verdict.REPRODUCED if last > first else Verdict.NOT_REPRODUCED,
            f"cell 1 {first:.0f} s, cell N {last:.0f} s",
        )


@dataclass(frozen=True)
class _AroundDemand:
    """Mean cell temperatures at the start, before and after the busiest stretch of a trip."""

    start_s: float
    initial_c: float
    before_c: float
    after_c: float

    @classmethod
    def of(cls, record: ReportRun, length_s: float) -> _AroundDemand:
        run = record.trajectory
        window = busiest_window(run, length_s)
        mean = 0.5 * (celsius(run.cell_1_temperature_k) + celsius(run.cell_n_temperature_k))
        highest = float(np.max(mean[window.start_row : window.end_row + 1]))
        return cls(
            float(run.time_s[window.start_row]),
            float(mean[0]),
            float(mean[window.start_row]),
            highest,
        )


@dataclass(frozen=True)
class HeatsInDemand(Rule):
    """The pack warms up during the stretch of highest traction demand."""

    runs: tuple[str, ...]
    length_s: float
    least_rise_k: float

    def needs(self) -> tuple[str, ...]:
        """The runs."""
        return self.runs

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"In the {self.length_s:g} s of each run that draw most traction energy (the composition of the "
            "printed cycle is not given, so the stretch is found, not fixed), the mean of both cells rises "
            f"above its value at the start of the stretch: reproduced from {self.least_rise_k:g} K on in "
            "every run, in sign only if it rises at all."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the temperature at the start of the stretch with the highest one in it."""
        found = {run: _AroundDemand.of(results[run], self.length_s) for run in self.runs}
        rises = [stretch.after_c - stretch.before_c for stretch in found.values()]
        if min(rises) >= self.least_rise_k:
            verdict = Verdict.REPRODUCED
        else:
            verdict = Verdict.SIGN_ONLY if min(rises) > 0.0 else Verdict.NOT_REPRODUCED
        return Judgement(
            verdict,
            "; ".join(
                f"{name_of(run)}: {stretch.after_c - stretch.before_c:+.2f} K from {stretch.start_s:.0f} s on"
                for run, stretch in found.items()
            ),
        )


@dataclass(frozen=True)
class CooledBeforeDemand(Rule):
    """The pack is clearly cooler at the start of the stretch of highest demand than at first."""

    runs: tuple[str, ...]
    length_s: float
    least_drop_k: float

    def needs(self) -> tuple[str, ...]:
        """The runs."""
        return self.runs

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"At the start of the {self.length_s:g} s that draw most traction energy, the mean of both cells "
            f"is below its initial value: reproduced from {self.least_drop_k:g} K on in every run, in sign "
            "only if it is lower at all."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the start of the stretch with the start of the trip."""
        found = {run: _AroundDemand.of(results[run], self.length_s) for run in self.runs}
        drops = [stretch.initial_c - stretch.before_c for stretch in found.values()]
        if min(drops) >= self.least_drop_k:
            verdict = Verdict.REPRODUCED
        else:
            verdict = Verdict.SIGN_ONLY if min(drops) > 0.0 else Verdict.NOT_REPRODUCED
        return Judgement(
            verdict,
            "; ".join(
                f"{name_of(run)}: {stretch.before_c:.2f} °C at {stretch.start_s:.0f} s"
                for run, stretch in found.items()
            ),
        )
