"""Years of use made of a trip of one's own: capacity lost, by cause, in a climate and a pattern of use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pandas as pd

from iptm.climate import DAY_S, HOUR_S, Climate, climate_of
from iptm.run import Run
from iptm.service_life.losses import (
    SERVICE_YEARS,
    band,
    drawn_losses,
    flags,
    losses_by_cause,
    years_to_end,
)
from iptm.service_life.trip_map import START_C, nominal_energy_j, trip_map
from iptm.service_life.usage import USAGES, Usage
from iptm.service_life.year import year_of
from iptm_core.aging_laws.cells import AGING_CELLS, AgingCell
from iptm_core.errors import ScenarioError
from iptm_core.parameters.loading import parse_overrides
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import check_known, shown

_PERCENT = 100.0
_INITIAL = "environment.initial_cell_temperature_k"


@dataclass(frozen=True)
class Life:
    """What years of use make of a pack.

    Attributes:
        about: trip, cell, climate and usage, in one line.
        years: of service.
        lost: capacity lost after these years by cause, in percent of nominal.
        lost_band: 5th and 95th percentile of the sum for parameters drawn from their published spread.
        years_to_80_percent: until a fifth of the capacity is lost, at most 40.
        distance_km: driven in a year.
        energy_kwh: drawn from the pack in a year, driving.
        outside: quantities in which the use leaves the experiments behind the ageing law.
    """

    about: str
    years: float
    lost: pd.Series
    lost_band: tuple[float, float]
    years_to_80_percent: float
    distance_km: float
    energy_kwh: float
    outside: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The loss in one sentence."""
        low, high = self.lost_band
        beyond = f"; outside the experiments: {', '.join(self.outside)}" if self.outside else ""
        return (
            f"{self.about}: {self.lost.sum():.1f} % of the capacity lost after {self.years:g} years "
            f"({low:.1f} to {high:.1f} % for the spread of published cells), "
            f"{self.distance_km:.0f} km a year{beyond}"
        )


def life(
    run: Run,
    *,
    cell: str | AgingCell = "nca",
    climate: str | float | Climate = "Phoenix",
    usage: str | Usage = "commuter",
    years: float = SERVICE_YEARS,
    start_c: Sequence[float] = START_C,
) -> Life:
    """Return what years of trips like a run make of the pack: driven, charged and parked.

    The trip is driven again from each start temperature, with the controller of the run; the air around the
    car counts while it is parked; the trips are driven in the air of the run (``climate=`` of
    `simulate`). The paper's law of cyclic ageing does not count here.

    Args:
        run: a run of `iptm.simulate`; vehicle, drive and strategy are taken from its trip.
        cell: whose ageing law counts, by name such as ``nca``, or an `AgingCell`.
        climate: ``Phoenix``, ``Rome``, ``Oslo``, a constant temperature in degC, or a `Climate`.
        usage: ``commuter``, ``taxi``, ``long distance``, or a `Usage`; its cycle does not count.
        years: of service.
        start_c: temperatures of the pack at the start of a trip, in degC, at least two, increasing.

    Raises:
        IptmError: a name is unknown, the trip is not known, or the charge does not last for a day.
    """
    if run.trip is None or run.trip.conditions.faults:
        raise ScenarioError("life: the trip is not known or has faults; allowed: a run of simulate")
    aging = _named(cell, AGING_CELLS, "cell")
    air = climate_of(climate)
    driven_c = run.parameters.environment.ambient_temperature_k - CELSIUS_ZERO_K
    habit = _named(usage, {each.name: each for each in USAGES}, "usage")
    if len(start_c) < 2 or np.any(np.diff(start_c) <= 0.0):
        raise ScenarioError(f"start_c is {shown(start_c)}; allowed: two or more, increasing")
    driven = trip_map(
        [_driven_from(run, celsius) for celsius in start_c], nominal_energy_j(run.parameters)
    )
    _check_day(habit, float(driven.drawn[:, -1].max()), driven.duration_s, run)
    year = year_of(habit, air, run.strategy, [driven] * 12, run.parameters)
    lost = losses_by_cause(aging.law, year, years)
    low, high = band(drawn_losses(aging, year, years))
    return Life(
        about=f"{run.name}; {aging.law.name}, {air.name} (trips in air of {driven_c:.0f} degC), {habit.name}",
        years=years,
        lost=pd.Series({str(cause): _PERCENT * loss for cause, loss in lost.items()}),
        lost_band=(_PERCENT * low, _PERCENT * high),
        years_to_80_percent=years_to_end(aging.law, year),
        distance_km=year.distance_km,
        energy_kwh=year.driving_kwh,
        outside=flags(aging, year),
    )


def _driven_from(run: Run, celsius: float) -> Trajectory:
    from iptm.driving import drive_in_memory  # noqa: PLC0415  it takes a moment to load

    if run.trip is None:
        raise AssertionError("a run with a trip is checked for")
    overrides = {**parse_overrides(run.trip.vehicle.overrides), _INITIAL: celsius + CELSIUS_ZERO_K}
    return drive_in_memory(run.trip.changed(overrides=overrides)).trajectory


_Named = TypeVar("_Named", AgingCell, Usage)


def _named(given: str | _Named, shipped: Mapping[str, _Named], what: str) -> _Named:
    if not isinstance(given, str):
        return given
    known = {name.lower(): entry for name, entry in shipped.items()}
    check_known(given.lower(), known, "life", what, ScenarioError)
    return known[given.lower()]


def _check_day(usage: Usage, drawn: float, duration_s: float, run: Run) -> None:
    """Refuse a day of which the trips overlap, or empty the pack below its smallest charge."""
    charge = usage.target
    ends_h = [hour + repeats * duration_s / HOUR_S for hour, repeats in usage.departures]
    next_h = [hour for hour, _ in usage.departures[1:]]
    next_h.append(usage.departures[0][0] + DAY_S / HOUR_S)
    for number, (_, repeats) in enumerate(usage.departures):
        charge = max(charge, usage.fast_target) if number else charge
        charge -= repeats * drawn
        if charge < run.parameters.charge.min_charge or ends_h[number] > next_h[number]:
            raise ScenarioError(
                f"usage is {usage.name}: {repeats} trips of {duration_s:.0f} s from "
                f"{usage.departures[number][0]:g} h leave a charge of {charge:.2f}; allowed: trips that end "
                f"before the next drive, with at least {run.parameters.charge.min_charge:g}"
            )
