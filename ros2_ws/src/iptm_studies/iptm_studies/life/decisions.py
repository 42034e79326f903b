"""What the default strategy does on single trips under the ageing law of each cell."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm_core.aging_laws.cells import AGING_CELLS, LAWS
from iptm_core.aging_laws.law import Load
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_studies.campaign import CaseState
from iptm_studies.life.losses import SERVICE_YEARS
from iptm_studies.life.own_law import law_setting, priced_trips, trip_at
from iptm_studies.life.trips import (
    CITY,
    DEFAULT,
    Extent,
    TripMap,
    nominal_energy_j,
    trip_case,
)
from iptm_studies.life.usage import CLIMATES
from iptm_studies.real_cars.trips import trip_cycles
from iptm_studies.store import ResultStore
from iptm_studies.study import Study

COMPREHENSIVE = "comprehensive"
MEASURED = "measured trips"
START_C = 35.0
TRIPS_A_YEAR = 2.0 * 5.0 / 7.0 * 365.25
PAPER = "paper"
_MONTH = 6
_J_PER_KWH = 3.6e6


@dataclass(frozen=True)
class Decision:
    """What one law makes of a route; of several trips, means.

    Attributes:
        route: cycle, or measured trips.
        cell: name of the law, `PAPER` for the paper's.
        end_c: temperature at the end.
        cooling_kwh: energy of the compressor.
        interpolated_end_c: the same temperature from trips at the price of a kelvin, as the years have them;
            None where no such trips are driven.
        saved: capacity that such trips on all working days of the service save against the default with the
            paper's law, as a share; None for the paper's law.
    """

    route: str
    cell: str
    end_c: float
    cooling_kwh: float
    interpolated_end_c: float | None
    saved: float | None


def decision_study(
    extent: Extent, folder: Path, report: Callable[[str], None]
) -> tuple[Study, Mapping[str, Sequence[str]]]:
    """Return the trips under all laws, and the cycles of each route.

    Args:
        extent: how much is driven.
        folder: for the files of measured trips.
        report: takes one line per file of measurements that was left out.
    """
    routes: dict[str, Sequence[str]] = {
        CITY: (CITY,),
        COMPREHENSIVE: (COMPREHENSIVE,),
        MEASURED: trip_cycles(None, folder, report, extent.measured_trips),
    }
    cases = [
        trip_case(extent, cycle, DEFAULT, START_C, _use(cell), cell)
        for cycles in routes.values()
        for cycle in cycles
        for cell in (PAPER, *AGING_CELLS)
    ]
    about = "Single trips of the default strategy under the law of each cell."
    return Study("life_decisions", "Decisions", about, tuple(cases)), routes


def _use(cell: str) -> AgingSettings:
    """Return a commuter's use in the first climate in its hottest month."""
    if cell == PAPER:
        return AgingSettings()
    climate = CLIMATES[0]
    monthly_c = climate.monthly_c
    return AgingSettings(
        aging_law=law_setting(cell),
        parking_air_k=monthly_c[_MONTH] + CELSIUS_ZERO_K,
        parking_air_swing_k=0.5 * climate.daily_range_k,
        year_air_k=float(np.mean(monthly_c)) + CELSIUS_ZERO_K,
        year_air_swing_k=0.5 * (max(monthly_c) - min(monthly_c)),
        service_years=SERVICE_YEARS,
    )


def decisions(
    states: Iterable[CaseState],
    routes: Mapping[str, Sequence[str]],
    store: ResultStore,
    trips: Mapping[tuple[str, str], TripMap],
) -> Sequence[Decision]:
    """Return what each law makes of each route, from finished runs.

    Args:
        states: runs of the study.
        routes: cycles of each route.
        store: of the runs.
        trips: those of the years, by cycle and control.
    """
    runs: dict[tuple[str, str], Trajectory] = {}
    for state in states:
        if state.key is not None and state.metrics is not None:
            label = str(state.case.labels["cycle"]), str(state.case.labels["control"])
            runs[label] = store.load(state.key).trajectory
    found = []
    start_k = START_C + CELSIUS_ZERO_K
    for route, cycles in routes.items():
        usual = [runs[cycle, PAPER] for cycle in cycles]
        for cell in (PAPER, *AGING_CELLS):
            own = [runs[cycle, cell] for cycle in cycles]
            saved = interpolated_c = None
            if cell != PAPER:
                if route == CITY:
                    trip = trip_at(priced_trips(trips, CITY), _use(cell)).from_start(start_k)
                    interpolated_c = float(trip.end_k[0]) - CELSIUS_ZERO_K
                saved = float(
                    np.mean(
                        [
                            _lost(cell, one) - _lost(cell, two)
                            for one, two in zip(usual, own, strict=True)
                        ]
                    )
                )
                saved *= TRIPS_A_YEAR * SERVICE_YEARS
            found.append(
                Decision(
                    route,
                    cell,
                    float(np.mean([_kelvin(run)[-1] for run in own])) - CELSIUS_ZERO_K,
                    float(np.mean([_cooling_j(run) for run in own])) / _J_PER_KWH,
                    interpolated_c,
                    saved,
                )
            )
    return found


def _kelvin(run: Trajectory) -> FloatArray:
    return 0.5 * (run.cell_1_temperature_k + run.cell_n_temperature_k)


def _cooling_j(run: Trajectory) -> float:
    return float(np.sum(run.compressor_power_w[1:] * np.diff(run.time_s)))


def _lost(cell: str, run: Trajectory) -> float:
    """Return what a trip costs in capacity at the end of service: while it lasts, and until it is cool."""
    use = _use(cell)
    parked = ParkedAging(LAWS[use.aging_law], use, use.parking_air_k)
    kelvin, step_s = _kelvin(run)[1:], np.diff(run.time_s)
    power_w = np.abs(run.battery_power_w[1:])
    c_rate = 3600.0 * power_w / nominal_energy_j(load_parameters().values)
    load = Load(kelvin, c_rate, use.parked_charge, use.daily_discharge, use.daily_discharge / 12.0)
    lost = sum(
        weight * float(np.sum(part.damage_rate_1_s(load) * step_s))
        for part, weight in zip(AGING_CELLS[cell].law.mechanisms, parked.weights, strict=True)
    )
    above_k = kelvin[-1:] - use.parking_air_k - use.pack_above_air_k
    return lost + float((parked.kelvin_price_1_k(kelvin[-1:]) * above_k)[0])
