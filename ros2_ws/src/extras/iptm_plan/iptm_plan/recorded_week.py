"""Years like a recorded week: `iptm.life(run, usage=RecordedWeek.of(table))`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from iptm.climate import DAY_S, HOUR_S, MONTH_DAYS, Climate
from iptm_core.aging_laws.cells import AgingCell
from iptm_core.aging_laws.law import Load
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_life.trip_map import TripMap, nominal_energy_j
from iptm_life.year import Activity, Year
from iptm_plan.years import loads

STEP_S = 60.0
"""Braking and driving within a minute are one load: its C-rate is the mean of the minute."""
DRIVING_1_H = 0.02
"""C-rate of a discharge from which a car is driven; what it draws parked is less."""
COLUMNS = ("time_s", "state_of_charge", "pack_c")


@dataclass(frozen=True, eq=False)
class RecordedWeek:
    """Hours as a car measured them, a day or more, which repeat.

    Attributes:
        charge: state of charge at the ends of steps of `STEP_S`, shape (n + 1,).
        kelvin: temperature of the pack, shape (n + 1,).
        name: for tables.
    """

    charge: FloatArray
    kelvin: FloatArray
    name: str = "recorded"

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> RecordedWeek:
        """Return the week of a table with `COLUMNS`, linear between its rows.

        Raises:
            ScenarioError: a column is missing, a value is unknown or out of range, or it is less than a day.
        """
        missing = [name for name in COLUMNS if name not in table]
        if missing:
            raise ScenarioError(f"columns are {list(table)}; allowed: {', '.join(COLUMNS)}")
        time_s, charge, celsius = (np.asarray(table[name], dtype=np.float64) for name in COLUMNS)
        steps_s = np.diff(time_s)
        if not np.all(steps_s > 0.0) or np.sum(steps_s) < DAY_S:
            raise ScenarioError("time_s is not a day that increases; allowed: a day or more")
        ranges = ("state_of_charge", charge, 0.0, 1.0), ("pack_c", celsius, -40.0, 80.0)
        for name, values, low, high in ranges:
            wrong = values[~((values >= low) & (values <= high))]
            if wrong.size:
                raise ScenarioError(f"{name} is {wrong[0]}; allowed: {low:g} to {high:g}")
        ends_s = np.arange(time_s[0], time_s[-1] + 1e-6, STEP_S)
        kelvin = np.interp(ends_s, time_s, celsius) + CELSIUS_ZERO_K
        return cls(np.interp(ends_s, time_s, charge), kelvin)

    def year(
        self, cell: AgingCell, climate: Climate, trip: TripMap, parameters: ModelParameters
    ) -> Year:
        """Return a year of it; the trip counts for the distance alone, cell and climate were recorded."""
        del cell, climate
        gained = np.diff(self.charge)
        c_rate = np.abs(gained) / STEP_S * HOUR_S
        moved = c_rate >= DRIVING_1_H
        activity = np.where(
            moved, np.where(gained > 0.0, Activity.CHARGING, Activity.DRIVING), Activity.PARKED
        )
        middle = [0.5 * (each[1:] + each[:-1]) for each in (self.kelvin, self.charge)]
        rows = np.column_stack(
            (np.full(gained.size, STEP_S), activity, middle[0], moved * c_rate, middle[1])
        )
        weight = sum(MONTH_DAYS) * DAY_S / (STEP_S * gained.size)
        table = loads(weight, rows)
        drawn = -weight * float(np.sum(gained[activity == Activity.DRIVING]))
        trips = drawn / float(np.mean(trip.drawn[:, -1]))
        return Year(
            table[:, 0],
            table[:, 1],
            Load(*table[:, 2:].T),
            0.0,
            0.0,
            drawn * nominal_energy_j(parameters) / J_PER_KWH,
            trips * trip.distance_m / 1000.0,
        )
