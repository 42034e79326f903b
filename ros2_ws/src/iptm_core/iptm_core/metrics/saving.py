"""What one run of a trip saved against another one: the one number to quote, or why there is none.

The number is the one with equal ends (`iptm_core.metrics.equal_end`). The figures as driven stand behind it:
on a short trip most of their difference is heat that one car has left in its pack.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.declaration import TextEnum
from iptm_core.metrics.equal_end import CorrectedFigures, TripEnd, at_equal_end
from iptm_core.parameters.model import ModelParameters

SHORTEST_TRIP_S = 300.0
"""Trips below are too short to judge."""
LARGEST_CORRECTION_POINTS = 5.0
"""Percentage points by which equal ends may change a saving; if they change it by more, the ends decide."""
SAME_TRIP = 0.1
"""Largest relative difference of distances and durations of two runs of the same trip."""
NO_PERCENTAGE = "–"


class Judgement(TextEnum):
    """Whether a saving may be quoted."""

    JUDGED = "judged"
    TOO_SHORT = "too short to judge"
    LIMIT_BROKEN = "not judged: a hard limit is broken"
    OTHER_TRIP = "not judged: not the same trip"
    UNKNOWN = "not judged: the ends cannot be made equal"


@dataclass(frozen=True)
class SavedShare:
    """Share of a quantity that a run saved against another one, in percent, negative where it lost.

    Attributes:
        equal_ends_percent: with both runs brought to the same end; NaN where that is not known.
        as_driven_percent: of the figures of the trip itself; NaN where they are not known.
    """

    judgement: Judgement
    equal_ends_percent: float
    as_driven_percent: float

    @property
    def percent(self) -> float:
        """The number to quote, NaN where there is none."""
        return self.equal_ends_percent if self.judgement is Judgement.JUDGED else math.nan

    @property
    def text(self) -> str:
        """The headline, such as ``27.9 % saved``, or the judgement in its place."""
        if self.judgement is Judgement.JUDGED:
            return saved_text(self.equal_ends_percent)
        return str(self.judgement)

    @property
    def as_driven(self) -> str:
        """What stands behind the headline."""
        text = f"as driven {saved_text(self.as_driven_percent)}"
        change = self.equal_ends_percent - self.as_driven_percent
        if self.judgement is Judgement.TOO_SHORT and abs(change) > LARGEST_CORRECTION_POINTS:
            text += f", equal ends change it by {change:+.0f} points"
        return text


@dataclass(frozen=True)
class Saving:
    """What a run saved against another one.

    Attributes:
        aging: of the capacity loss of both cells together.
        energy: of the battery energy per distance.
        ends: figures of both runs, corrected for their ends, own first; None where these are not known.
    """

    aging: SavedShare
    energy: SavedShare
    ends: tuple[CorrectedFigures, CorrectedFigures] | None

    @property
    def values(self) -> dict[str, float]:
        """Percentages by the keys of `iptm_core.metrics.figures.SAVINGS`; NaN where there is none."""
        return {
            "aging_saved": self.aging.percent,
            "energy_saved": self.energy.percent,
            "aging_saved_as_driven": self.aging.as_driven_percent,
            "energy_saved_as_driven": self.energy.as_driven_percent,
        }

    @property
    def headline(self) -> str:
        """One line for headings: ageing and energy, each with its value as driven."""
        if self.aging.judgement is self.energy.judgement is not Judgement.JUDGED:
            return (
                f"{self.aging.text} (ageing {self.aging.as_driven}, energy {self.energy.as_driven})"
            )
        parts = (("ageing", self.aging), ("energy", self.energy))
        return "; ".join(f"{name}: {share.text} ({share.as_driven})" for name, share in parts)


def judge_saving(
    own: TripEnd,
    other: TripEnd,
    parameters: ModelParameters,
    of_other: ModelParameters | None = None,
) -> Saving:
    """Judge what a run saved against another run of the same trip.

    Args:
        own: figures of the run.
        other: figures of the run that it is compared with.
        parameters: of the vehicle.
        of_other: of the vehicle of the other run; None for the same.
    """
    known = all(math.isfinite(end.final_temperature_k) for end in (own, other))
    ends = at_equal_end(own, other, parameters, of_other) if known else None
    judgement = Judgement.JUDGED
    if own.hard_violations or other.hard_violations:
        judgement = Judgement.LIMIT_BROKEN
    elif min(own.duration_s, other.duration_s) < SHORTEST_TRIP_S:
        judgement = Judgement.TOO_SHORT
    elif _differ(own.duration_s, other.duration_s) or _differ(own.distance_m, other.distance_m):
        judgement = Judgement.OTHER_TRIP
    elif ends is None:
        judgement = Judgement.UNKNOWN
    corrected = (
        (math.nan, math.nan) if ends is None else tuple(end.capacity_loss for end in ends),
        (math.nan, math.nan)
        if ends is None
        else tuple(end.energy_per_distance_j_m for end in ends),
    )
    return Saving(
        _share(judgement, corrected[0], (own.degradation, other.degradation)),
        _share(judgement, corrected[1], (_per_distance(own), _per_distance(other))),
        ends,
    )


def saved_percent(own: float, other: float) -> float:
    """Return the saving relative to the other value, in percent; NaN where that is zero or unknown."""
    return 100.0 * (1.0 - own / other) if other else math.nan


def saved_text(percent: float) -> str:
    """Return a saving in words, such as ``49.8 % saved``."""
    if not math.isfinite(percent):
        return NO_PERCENTAGE
    amount = f"{abs(percent):.0f}" if abs(percent) >= 100.0 else f"{abs(percent):.1f}"
    return f"{amount} % {'saved' if percent >= 0.0 else 'lost'}"


def _share(
    judgement: Judgement, corrected: tuple[float, ...], driven: tuple[float, float]
) -> SavedShare:
    equal_ends, as_driven = saved_percent(*corrected), saved_percent(*driven)
    if judgement is Judgement.JUDGED:
        if not math.isfinite(equal_ends):
            judgement = Judgement.UNKNOWN
        elif abs(equal_ends - as_driven) > LARGEST_CORRECTION_POINTS:
            judgement = Judgement.TOO_SHORT
    return SavedShare(judgement, equal_ends, as_driven)


def _differ(own: float, other: float) -> bool:
    return abs(own - other) > SAME_TRIP * max(abs(own), abs(other))


def _per_distance(run: TripEnd) -> float:
    return run.battery_energy_j / run.distance_m if run.distance_m > 0.0 else math.nan
