"""Saving of one run of a trip against another, corrected to equal ends.

They end with different temperatures, speeds and distances, and each of these holds energy or ageing that the
figures of the trip do not show. The corrected figures of a run are

    E' = E_b + E_cool - E_kin,   E_kin = 1/2 delta m v^2,
    Q' = Q_loss + Q_cool,

with the battery energy E_b and the capacity loss Q_loss of the trip, and with delta, m and the final speed
v. E_cool and Q_cool bring the warmer pack, of N cells with mean temperature T, to the final temperature T*
of the other: at standstill, with a constant compressor power P, and with all rates at the middle temperature
(T + T*) / 2,

    t = N C_c (T - T*) / (Q_co - N q_bc),   E_cool = P_b t,   Q_cool = (dQ_loss/dt) t,

where Q_co is the heat that the chiller takes, q_bc the heat that a cell makes, P_b = (P + P_aux) / eta_b the
battery power, and P the power that takes the least energy, at the state of charge at the end. No pack is
cooled below T_b,min: between packs that end colder nothing is corrected.
Full recovery of the kinetic energy is assumed. Energies are compared per distance.

The number to quote is the one with equal ends, and the figures as driven stand behind it. On a short
trip most of their difference is heat that one car has left in its pack. Where equal ends change the number by
more than a few points, both cars drive the trip over and over until the temperature of the pack repeats, and
the number is that of a repetition (`iptm_core.metrics.repeated`). A trip that cannot be driven again has the
middle of both numbers, and half of their difference as its uncertainty.

Laws of ageing disagree on the size of a saving and on some trips on its sign. A saving of ageing is therefore
stated by the laws of the measured cells, as their median and range, with the law of the paper beside it. The
former count a use that charges what the trip took (`iptm_core.aging_laws.judging`) and are not corrected for
the ends. The distance that a car kept belongs to every saving: a longer one, or one below s_min, saves, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from iptm_core.metrics.following import Following
from iptm_core.metrics.repeated import Repeated
from iptm_core.metrics.saved_share import (
    NO_PERCENTAGE,
    Judgement,
    SavedShare,
    judged_share,
    saved_percent,
    saved_text,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import at_charge, cell_heat_w, cell_resistance_ohm, heat_from_air_w
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import reduce_channel

POWER_STEP_W = 10.0


class TripEnd(Protocol):
    """Figures of a run that its comparison with another one needs; `RunMetrics` has them."""

    @property
    def duration_s(self) -> float:
        """From the first to the last row."""

    @property
    def distance_m(self) -> float:
        """Distance driven."""

    @property
    def battery_energy_j(self) -> float:
        """Energy taken from the pack."""

    @property
    def degradation(self) -> float:
        """Capacity lost by both cells together."""

    @property
    def hard_violations(self) -> int:
        """Rows that break a hard limit."""

    @property
    def final_kinetic_energy_j(self) -> float:
        """Energy of the motion at the end."""

    @property
    def final_temperature_k(self) -> float:
        """Mean of both cells at the end."""

    @property
    def final_cell_losses(self) -> tuple[float, float]:
        """Capacity losses of both cells at the end."""

    @property
    def final_charge(self) -> float:
        """State of charge at the end."""

    @property
    def following(self) -> Following:
        """Headway, and time and distance below s_min."""

    @property
    def cell_losses(self) -> Mapping[str, float]:
        """Capacity lost by the laws of measured cells, by name; empty where that is not known."""

    @property
    def unbalanced_heat_share(self) -> float:
        """Heat that the two-cell model leaves unbalanced, over the heat taken by the chiller."""


def cool_down(
    run: TripEnd, temperature_k: float, parameters: ModelParameters
) -> tuple[float, float] | None:
    """Return what cooling the pack down at standstill takes; None where it cannot be.

    Returns:
        Energy in J, and the capacity loss of both cells together; zero if the pack is not warmer.
    """
    warmer_k = run.final_temperature_k - temperature_k
    if warmer_k <= 0.0:
        return 0.0, 0.0
    parameters = at_charge(parameters, run.final_charge)
    middle_k = run.final_temperature_k - 0.5 * warmer_k
    powers_w = np.arange(
        POWER_STEP_W,
        largest_useful_power_w(parameters.chiller, parameters.limits) + 1e-6,
        POWER_STEP_W,
    )
    losses = run.final_cell_losses
    rates = power_thermal_rates(
        0.0,
        0.0,
        0.0,
        powers_w,
        CellPair(middle_k, middle_k, *losses),
        parameters,
        reduce_channel(parameters.cooling, parameters.pack),
    )
    cell, cells = parameters.cell, parameters.pack.cells
    resistance_ohm = cell_resistance_ohm(middle_k, 0.5 * sum(losses), cell)
    heat_w = cells * (
        cell_heat_w(rates.cell_current_a, resistance_ohm, middle_k, cell)
        + heat_from_air_w(middle_k, parameters)
    )
    net_w = rates.coolant.cooling_rate_w - heat_w
    loss_1_s = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
    to_remove_j = cells * cell.heat_capacity_j_k * warmer_k
    durations_s = np.full(powers_w.shape, np.inf)
    np.divide(to_remove_j, net_w, out=durations_s, where=net_w > 0.0)
    energies_j = rates.battery_power_w * durations_s
    best = int(np.argmin(energies_j))
    if not np.isfinite(energies_j[best]):
        return None
    return float(energies_j[best]), float(loss_1_s[best] * durations_s[best])


@dataclass(frozen=True)
class CorrectedFigures:
    """What a run would have cost with the end of the other run; see the module.

    Attributes:
        temperature_k: to which the packs are cooled: the final one of the cooler run, at least T_b,min.
        capacity_loss: of both cells together.
        energy_per_distance_j_m: the same over the distance of the run; NaN for one that stands.
    """

    temperature_k: float
    capacity_loss: float
    energy_j: float
    energy_per_distance_j_m: float


def at_equal_end(
    own: TripEnd,
    other: TripEnd,
    parameters: ModelParameters,
    of_other: ModelParameters | None = None,
) -> tuple[CorrectedFigures, CorrectedFigures] | None:
    """Return the figures of two runs corrected for their ends; None where they cannot be.

    Args:
        own: figures of a run.
        other: figures of the other one.
        parameters: of the vehicle.
        of_other: of the vehicle of the other run; None for the same.
    """
    coolest_k = min(own.final_temperature_k, other.final_temperature_k)
    temperature_k = max(coolest_k, parameters.limits.min_temperature_k)
    first = _corrected(own, temperature_k, parameters)
    second = _corrected(other, temperature_k, of_other or parameters)
    return None if first is None or second is None else (first, second)


def _corrected(
    run: TripEnd, temperature_k: float, parameters: ModelParameters
) -> CorrectedFigures | None:
    cooling = cool_down(run, temperature_k, parameters)
    if cooling is None:
        return None
    cooling_j, cooling_loss = cooling
    energy_j = run.battery_energy_j + cooling_j - run.final_kinetic_energy_j
    return CorrectedFigures(
        temperature_k=temperature_k,
        capacity_loss=run.degradation + cooling_loss,
        energy_j=energy_j,
        energy_per_distance_j_m=energy_j / run.distance_m if run.distance_m > 0.0 else math.nan,
    )


SHORTEST_TRIP_S = 60.0
"""Trips below are too short to judge."""
SHORTEST_ENDED_S, SHORTEST_WHOLE_S = 300.0, 1800.0
"""Trips below the first are not judged by equal ends; those below the second are repeated where possible."""
LARGEST_CORRECTION_POINTS = 5.0
"""Percentage points by which equal ends may change a saving; where by more, the trip is repeated."""
SAME_TRIP = 0.1
"""Largest relative difference of distances and durations of two runs of the same trip."""
LEAST_UNCERTAINTY_POINTS = 0.5
"""Of a repeated trip: by how much it has differed from many repetitions in one piece."""
ENERGY_SAVED = "energy"
"""Label of the first line of a statement."""


@dataclass(frozen=True)
class CellSavings:
    """Savings of ageing by the laws of measured cells.

    Attributes:
        percents: by the name of the cell, negative where it lost.
    """

    judgement: Judgement
    percents: Mapping[str, float]

    @property
    def median(self) -> float:
        """Median of the cells, NaN where there is none or it may not be quoted."""
        return self._of(np.median)

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest saving, NaN as the median."""
        return self._of(np.min), self._of(np.max)

    def _of(self, statistic: Callable[[list[float]], np.floating]) -> float:
        is_known = self.judgement is Judgement.JUDGED and self.percents
        return float(statistic([*self.percents.values()])) if is_known else math.nan

    @property
    def text(self) -> str:
        """Median and range, such as ``7.0 % saved (-0.1 to 13.3 %)``, or the judgement in its place."""
        if self.judgement is not Judgement.JUDGED:
            return str(self.judgement)
        if not self.percents:
            return NO_PERCENTAGE
        lowest, highest = self.range
        return f"{saved_text(self.median)} ({lowest:.1f} to {highest:.1f} %)"


@dataclass(frozen=True)
class Saving:
    """What a run saved against another one, as it is stated everywhere.

    Attributes:
        energy: of the battery energy per distance.
        cells: of the ageing, by the laws of measured cells.
        aging: of the capacity loss of both cells together, by the law of the paper.
        following: how the run followed.
        preview: that the run had, in words; empty where that is not known.
        unbalanced: heat that the model leaves unbalanced over the heat that the chiller takes, own first.
        ends: figures of both runs, corrected for their ends, own first; None where these are not known.
        repeated: figures of a repetition of both, own first; None where the trip was not repeated.
    """

    energy: SavedShare
    cells: CellSavings
    aging: SavedShare
    following: Following
    preview: str
    unbalanced: tuple[float, float]
    ends: tuple[CorrectedFigures, CorrectedFigures] | None
    repeated: tuple[Repeated, Repeated] | None = None

    @property
    def values(self) -> dict[str, float]:
        """Values by the keys of `iptm_core.metrics.figures.SAVINGS`; NaN where there is none."""
        lowest, highest = self.cells.range
        return {
            "energy_saved": self.energy.percent,
            "energy_saved_uncertainty": self.energy.uncertainty_points,
            "energy_saved_as_driven": self.energy.as_driven_percent,
            "aging_saved_by_cells": self.cells.median,
            "aging_saved_by_cells_lowest": lowest,
            "aging_saved_by_cells_highest": highest,
            "aging_saved": self.aging.percent,
            "aging_saved_uncertainty": self.aging.uncertainty_points,
            "aging_saved_as_driven": self.aging.as_driven_percent,
        }

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The statement: label and text of each line."""
        preview = self.preview and f"preview: {self.preview}"
        shares = [f"{100.0 * share:.1f} %" for share in self.unbalanced]
        heat = f"{shares[0]} of the heat that the chiller takes, {shares[1]} of the other run"
        lines = [
            (ENERGY_SAVED, f"{self.energy.text} ({self.energy.as_driven})"),
            (f"ageing, {len(self.cells.percents)} cells", self.cells.text),
            ("ageing, paper's law", f"{self.aging.text} ({self.aging.as_driven})"),
            ("distance kept", "; ".join(filter(None, (self.following.text, preview)))),
            ("unbalanced heat", heat if np.isfinite(self.unbalanced).all() else ""),
        ]
        return [(label, text) for label, text in lines if text]

    @property
    def headline(self) -> str:
        """The statement in one line; where nothing may be quoted, what the figures as driven give."""
        reasons = {share.judgement for share in (self.energy, self.cells, self.aging)}
        if len(reasons) == 1 and Judgement.JUDGED not in reasons:
            driven = (
                f"energy {self.energy.as_driven}, ageing by the paper's law {self.aging.as_driven}"
            )
            return f"{self.energy.text} ({driven})"
        return "; ".join(f"{label}: {text}" for label, text in self.lines)


def judge_saving(
    own: TripEnd,
    other: TripEnd,
    parameters: ModelParameters,
    of_other: ModelParameters | None = None,
    preview: str = "",
    *,
    late: bool = False,
    repeat: Callable[[], tuple[Repeated, Repeated] | None] = lambda: None,
) -> Saving:
    """Judge what a run saved against another run of the same trip.

    Args:
        own: figures of the run.
        other: figures of the run that it is compared with.
        parameters: of the vehicle.
        of_other: of the vehicle of the other run; None for the same.
        preview: that the run had, in words.
        late: whether ticks in real time were late, so that the drive depended on the machine.
        repeat: drives the trip over and over with both, own first; called only where that is needed, and None
            where it is not possible.
    """
    known = all(math.isfinite(end.final_temperature_k) for end in (own, other))
    ends = at_equal_end(own, other, parameters, of_other) if known else None
    duration_s = min(own.duration_s, other.duration_s)
    judgement = Judgement.JUDGED
    if own.hard_violations or other.hard_violations:
        judgement = Judgement.LIMIT_BROKEN
    elif duration_s < SHORTEST_TRIP_S:
        judgement = Judgement.TOO_SHORT
    elif late:
        judgement = Judgement.LATE
    elif _differ(own.duration_s, other.duration_s) or _differ(own.distance_m, other.distance_m):
        judgement = Judgement.OTHER_TRIP
    elif ends is None:
        judgement = Judgement.UNKNOWN
    corrected = (math.nan, math.nan), (math.nan, math.nan)
    if ends is not None:
        corrected = (
            (ends[0].energy_per_distance_j_m, ends[1].energy_per_distance_j_m),
            (ends[0].capacity_loss, ends[1].capacity_loss),
        )
    driven = (_per_distance(own), _per_distance(other)), (own.degradation, other.degradation)
    equal, raw = ([saved_percent(*each) for each in both] for both in (corrected, driven))
    is_short = duration_s < SHORTEST_WHOLE_S
    unclear = [
        duration_s < SHORTEST_ENDED_S or abs(first - second) > LARGEST_CORRECTION_POINTS
        for first, second in zip(equal, raw, strict=True)
    ]
    needed = [is_short or each for each in unclear]
    found = repeat() if judgement is Judgement.JUDGED and any(needed) else None
    again = [None, None] if found is None else _of_repetitions(found)
    energy, aging = (
        judged_share(
            judgement, equal[each], raw[each], again[each] if needed[each] else None, unclear[each]
        )
        for each in range(2)
    )
    lost = own.cell_losses, other.cell_losses
    if found is not None and is_short:
        lost = found[0].cell_losses, found[1].cell_losses
    return Saving(
        energy,
        CellSavings(
            Judgement.JUDGED if judgement is Judgement.UNKNOWN else judgement,
            {
                name: saved_percent(lost[0][name], lost[1][name])
                for name in lost[0]
                if name in lost[1]
            },
        ),
        aging,
        own.following,
        preview,
        (own.unbalanced_heat_share, other.unbalanced_heat_share),
        ends,
        found,
    )


def _of_repetitions(found: tuple[Repeated, Repeated]) -> list[tuple[float, float]]:
    """Return saving and its uncertainty, in percent, of energy and of ageing."""
    own, other = found
    percents = (
        saved_percent(own.energy_per_distance_j_m, other.energy_per_distance_j_m),
        saved_percent(own.capacity_loss, other.capacity_loss),
    )
    errors = (
        math.hypot(own.energy_error, other.energy_error),
        math.hypot(own.aging_error, other.aging_error),
    )
    return [
        (each, max((100.0 - each) * error, LEAST_UNCERTAINTY_POINTS))
        for each, error in zip(percents, errors, strict=True)
    ]


def _differ(own: float, other: float) -> bool:
    return abs(own - other) > SAME_TRIP * max(abs(own), abs(other))


def _per_distance(run: TripEnd) -> float:
    return run.battery_energy_j / run.distance_m if run.distance_m > 0.0 else math.nan
