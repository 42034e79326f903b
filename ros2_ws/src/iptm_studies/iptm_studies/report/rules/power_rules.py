"""Rules about powers over the time of a trip, and the timing of the cooling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_studies.report.naming import name_of, names_of
from iptm_studies.report.quantities import (
    PowerRegions,
    battery_power_kw,
    traction_power_kw,
)
from iptm_studies.report.rules.base import Printed, Rule
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Verdict


@dataclass(frozen=True)
class PowerRegionShares(Rule):
    """A run spends less time at high and more at low power than others."""

    run: str
    others: tuple[str, ...]
    reference: str
    low_percentile: float
    high_percentile: float

    def needs(self) -> tuple[str, ...]:
        """All runs."""
        return (self.run, *self.others, self.reference)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Low power is up to percentile {self.low_percentile:g}, high power from percentile "
            f"{self.high_percentile:g} of the battery power of {name_of(self.reference)}. "
            f"Reproduced if {name_of(self.run)} spends less time at high and more at low power than "
            f"{names_of(self.others)}; in sign only if one of the two holds against each."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the shares of time."""
        regions = PowerRegions.of_reference(
            results[self.reference].trajectory, self.low_percentile, self.high_percentile
        )
        shares = {
            name: regions.shares(results[name].trajectory) for name in (self.run, *self.others)
        }
        low, _, high = shares[self.run]
        less_high = all(high < shares[other][2] for other in self.others)
        more_low = all(low > shares[other][0] for other in self.others)
        if less_high and more_low:
            verdict = Verdict.REPRODUCED
        elif less_high or more_low:
            verdict = Verdict.SIGN_ONLY
        else:
            verdict = Verdict.NOT_REPRODUCED
        parts = [
            f"{name_of(name)}: low {100.0 * share[0]:.2f} %, high {100.0 * share[2]:.2f} % of the time"
            for name, share in shares.items()
        ]
        bounds = f"bounds {regions.low_kw:.2f} and {regions.high_kw:.2f} kW"
        return Judgement(verdict, f"{'; '.join(parts)} ({bounds})")


@dataclass(frozen=True)
class LowerPeaks(Rule):
    """High percentiles of the battery power of a run lie below those of others."""

    run: str
    others: tuple[str, ...]
    percentile: float

    def needs(self) -> tuple[str, ...]:
        """All runs."""
        return (self.run, *self.others)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reproduced if percentile {self.percentile:g} of the battery power of {name_of(self.run)} lies "
            f"below that of {names_of(self.others)}."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the percentiles."""
        peaks = {
            name: float(np.percentile(battery_power_kw(results[name].trajectory), self.percentile))
            for name in (self.run, *self.others)
        }
        holds = all(peaks[self.run] < peaks[other] for other in self.others)
        return Judgement(
            Verdict.REPRODUCED if holds else Verdict.NOT_REPRODUCED,
            "; ".join(f"{name_of(name)} {peak:.2f} kW" for name, peak in peaks.items()),
        )


@dataclass(frozen=True)
class TractionDominates(Rule):
    """Traction power is much larger than compressor and auxiliary power, on average of magnitudes."""

    run: str
    factor: float

    def needs(self) -> tuple[str, ...]:
        """The run."""
        return (self.run,)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Mean magnitude of the traction power of {name_of(self.run)} over that of compressor plus "
            f"auxiliaries: reproduced from a ratio of {self.factor:g} on, in sign only above 1."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the means."""
        run = results[self.run].trajectory
        traction = float(np.mean(np.abs(traction_power_kw(run))))
        other = 1e-3 * float(np.mean(run.compressor_power_w[1:] + run.auxiliary_power_w[1:]))
        ratio = traction / other
        if ratio >= self.factor:
            verdict = Verdict.REPRODUCED
        else:
            verdict = Verdict.SIGN_ONLY if ratio > 1.0 else Verdict.NOT_REPRODUCED
        return Judgement(
            verdict,
            f"{traction:.2f} kW traction, {other:.2f} kW compressor and auxiliaries, ratio {ratio:.1f}",
        )


@dataclass(frozen=True)
class CoolsOffPeak(Rule):
    """The compressor runs less at high traction power than at low traction power or while braking."""

    run: str
    low_percentile: float
    high_percentile: float

    def needs(self) -> tuple[str, ...]:
        """The run."""
        return (self.run,)

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"Reproduced if the mean compressor power of {name_of(self.run)} above percentile "
            f"{self.high_percentile:g} of its traction power is below that up to percentile "
            f"{self.low_percentile:g} and below that while braking; in sign only if below one of them."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Compare the means."""
        run = results[self.run].trajectory
        traction, compressor = traction_power_kw(run), run.compressor_power_w[1:]
        low, high = np.percentile(traction, [self.low_percentile, self.high_percentile])
        means = {
            name: float(np.mean(compressor[rows])) if np.any(rows) else float("nan")
            for name, rows in (
                (f"above {high:.1f} kW traction", traction > high),
                (f"up to {low:.1f} kW", traction <= low),
                ("braking", traction < 0.0),
            )
        }
        at_high, at_low, braking = means.values()
        below = [at_high < at_low, at_high < braking]
        if all(below):
            verdict = Verdict.REPRODUCED
        else:
            verdict = Verdict.SIGN_ONLY if any(below) else Verdict.NOT_REPRODUCED
        return Judgement(
            verdict, "; ".join(f"{name}: {value:.0f} W" for name, value in means.items())
        )
