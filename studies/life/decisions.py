"""What the default strategy does on single trips under the ageing law of each cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.drives import DEFAULT
from studies.life.own_law import PAPER, priced_trips, trip_at, use_in
from studies.life.trips import trajectories, trip_case
from studies.measured_cycles import trip_cycles
from studies.session import Case

from iptm.climate import CLIMATES
from iptm_core.aging_laws.cells import AGING_CELLS, LAWS
from iptm_core.aging_laws.law import Load
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_life.life import SERVICE_YEARS
from iptm_life.trip_map import TripMap, compressor_j, mean_cell_k, nominal_energy_j
from iptm_life.year import CITY

COMPREHENSIVE = "comprehensive"
MEASURED = "measured trips"
START_C = 35.0
TRIPS_A_YEAR = 2.0 * 5.0 / 7.0 * 365.25
_JULY = 6


def routes_of(folder: Path) -> Mapping[str, Sequence[str]]:
    """Return the cycles of each route; files of measured trips are written to a folder."""
    return {CITY: (CITY,), COMPREHENSIVE: (COMPREHENSIVE,), MEASURED: trip_cycles(folder)}


def decision_cases(routes: Mapping[str, Sequence[str]]) -> list[Case]:
    """Return single trips of the default strategy under the law of each cell."""
    return [
        trip_case(cycle, DEFAULT, START_C, _use(cell), cell)
        for cycles in routes.values()
        for cycle in cycles
        for cell in (PAPER, *AGING_CELLS)
    ]


def _use(cell: str) -> AgingSettings:
    """Return a commuter's use in the first climate in its hottest month."""
    return AgingSettings() if cell == PAPER else use_in(cell, CLIMATES[0], _JULY)


def decisions(
    driven: pd.DataFrame,
    routes: Mapping[str, Sequence[str]],
    trips: Mapping[tuple[str, str], TripMap],
) -> pd.DataFrame:
    """Return what every law makes of every route.

    Args:
        driven: the trips of `decision_cases`.
        routes: cycles by route.
        trips: by cycle and control, for the interpolated ends.

    Returns:
        A row per ``route`` and ``cell`` (name of the law), with means over several trips: ``end_c``, the
        temperature at the end; ``cooling_kwh`` of the compressor; ``interpolated_end_c``, the same
        temperature as the years have it (missing where no such trips are driven); ``saved``, percentage
        points of capacity that such trips on all working days of the service save against the default
        with the paper's law.
    """
    runs = {label: found[0] for label, found in trajectories(driven).items()}
    rows: list[dict[str, Any]] = []
    for route, cycles in routes.items():
        for cell in (PAPER, *AGING_CELLS):
            own = [runs[cycle, cell] for cycle in cycles]
            row = {
                "route": route,
                "cell": cell,
                "end_c": float(np.mean([mean_cell_k(run)[-1] for run in own])) - CELSIUS_ZERO_K,
                "cooling_kwh": float(np.mean([compressor_j(run) for run in own])) / J_PER_KWH,
            }
            if cell != PAPER:
                saved = [
                    _lost(cell, runs[cycle, PAPER]) - _lost(cell, runs[cycle, cell])
                    for cycle in cycles
                ]
                row["saved"] = 100.0 * float(np.mean(saved)) * (TRIPS_A_YEAR * SERVICE_YEARS)
            if cell != PAPER and route == CITY:
                trip = trip_at(priced_trips(trips, CITY), _use(cell))
                end_k = trip.from_start(START_C + CELSIUS_ZERO_K).end_k[0]
                row["interpolated_end_c"] = float(end_k) - CELSIUS_ZERO_K
            rows.append(row)
    return pd.DataFrame(rows)


def _lost(cell: str, run: Trajectory) -> float:
    """Return what a trip costs in capacity at the end of service: while it lasts, and until it is cool."""
    use = _use(cell)
    parked = ParkedAging(LAWS[use.aging_law], use, use.parking_air_k)
    kelvin, step_s = mean_cell_k(run)[1:], np.diff(run.time_s)
    power_w = np.abs(run.battery_power_w[1:])
    c_rate = 3600.0 * power_w / nominal_energy_j(load_parameters().values)
    load = Load(kelvin, c_rate, use.parked_charge, use.daily_discharge, use.daily_discharge / 12.0)
    lost = sum(
        weight * float(np.sum(part.damage_rate_1_s(load) * step_s))
        for part, weight in zip(AGING_CELLS[cell].law.mechanisms, parked.weights, strict=True)
    )
    above_k = kelvin[-1:] - use.parking_air_k - use.pack_above_air_k
    return lost + float((parked.kelvin_price_1_k(kelvin[-1:]) * above_k)[0])
