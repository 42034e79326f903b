"""A year of use, by pattern of use and habit of charging: driven, charged and parked.

The year gives temperature, current and state of charge of the pack.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import partial

import numpy as np

from iptm.climate import DAY_S, HOUR_S, MONTH_DAYS, Climate
from iptm_controller.production import SIMPLE
from iptm_core.aging_laws.law import Load
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_resistance_ohm
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_core.user_input import known_keywords
from iptm_life.trip_map import TripMap, heat_capacity_j_k, nominal_energy_j

CITY, MOTORWAY = "wltc_class3b", "hwfet"


@known_keywords
@dataclass(frozen=True)
class Usage:
    """Equal driving days, and days of rest between them; the pack is charged after the last trip of a day.

    Attributes:
        name: for tables.
        about: in words.
        cycle: driving cycle of every trip, where no other is given.
        departures: hour of the day and number of trips in a row, for each drive of a day.
        days_a_week: driving days.
        charging_c_rate_1_h: power of the charger at night over the nominal energy of the pack.
        target: state of charge at the first departure.
        managed_target: the same with charging managed.
        fast_target: state of charge up to which a fast charger is used between drives; 0 for none.
        just_in_time: the charging ends at the first departure instead of beginning on arrival.
        free_cooling: a radiator and its fan cool the parked pack where it is warmer than the air.
    """

    name: str
    about: str
    cycle: str
    departures: tuple[tuple[float, int], ...]
    days_a_week: float
    charging_c_rate_1_h: float
    target: float
    managed_target: float
    fast_target: float = 0.0
    just_in_time: bool = False
    free_cooling: bool = False

    def managed(self) -> Usage:
        """Return the same use with charging managed and the parked pack cooled by the air."""
        return replace(self, target=self.managed_target, just_in_time=True, free_cooling=True)


FAST_C_RATE_1_H = 1.0
USAGES = (
    Usage(
        "commuter",
        "one WLTC at 7 and at 17 h on five days a week, 7 kW at home to 80 %; managed: to 60 %, just in time",
        CITY,
        ((7.0, 1), (17.0, 1)),
        days_a_week=5.0,
        charging_c_rate_1_h=0.1,
        target=0.8,
        managed_target=0.6,
    ),
    Usage(
        "taxi",
        "four WLTC from 6 and from 13 h on six days a week, 11 kW to 90 %; managed: to 80 %, just in time",
        CITY,
        ((6.0, 4), (13.0, 4)),
        days_a_week=6.0,
        charging_c_rate_1_h=0.15,
        target=0.9,
        managed_target=0.8,
    ),
    Usage(
        "long distance",
        "ten HWFET from 8 and eight from 12 h on five days a week, between them a fast charger at 1C to "
        "80 %, 11 kW at night to 90 %; managed: to 80 %, just in time",
        MOTORWAY,
        ((8.0, 10), (12.0, 8)),
        days_a_week=5.0,
        charging_c_rate_1_h=0.15,
        target=0.9,
        managed_target=0.8,
        fast_target=0.8,
    ),
)


NO_COOLING = "none"
"""Control of trips without cooling below the upper limit."""
PARKED_TIME_CONSTANT_S = 10.0 * HOUR_S
"""Of a parked pack towards the air: chosen, insulated packs of 60 to 80 kWh need that order of time."""
FREE_COOLING_W_K = 100.0
"""Of radiator and pump of a parked pack: chosen, a small radiator at its fan's power below."""
FREE_COOLING_FAN_W = 80.0
FREE_COOLING_ABOVE_AIR_K = 3.0
"""Heat carried off in an hour that justifies the power of the fan: chosen."""
FREE_COOLING_FROM_K = 20.0 + CELSIUS_ZERO_K
COOLING_COP = 2.4
"""While charging and at the upper limit: of the chiller of the paper's car at 450 to 600 W."""
UPPER_LIMIT_K = 40.0 + CELSIUS_ZERO_K
_STEP_S = 600.0
_DAYS_TO_SETTLE = 4


class Activity(IntEnum):
    """What a car does."""

    DRIVING = 0
    CHARGING = 1
    PARKED = 2


@dataclass(frozen=True)
class Year:
    """All loads of a year, each with the time it lasts in a year.

    Attributes:
        duration_s: shape (n,).
        activity: members of `Activity`, shape (n,).
        load: arrays of shape (n,).
        compressor_kwh: energy of the compressor while driving and of the fan while parked, from the pack.
        grid_compressor_kwh: the same while charging, from the grid.
        driving_kwh: energy drawn from the pack.
        distance_km: distance.
    """

    duration_s: FloatArray
    activity: FloatArray
    load: Load
    compressor_kwh: float
    grid_compressor_kwh: float
    driving_kwh: float
    distance_km: float


@dataclass
class _Day:
    """A day in the making in one month of a climate; it begins at the first departure.

    Attributes:
        charging_limit_k: temperature above which the pack is cooled while it is charged.
        rows: duration, activity, temperature, C-rate and state of charge of every step.
        drawn: share of the nominal energy drawn.
        arrival_charge: state of charge after the last trip.
    """

    parameters: ModelParameters
    usage: Usage
    climate: Climate
    month: int
    charging_limit_k: float
    kelvin: float
    charge: float
    rows: list[tuple[float, int, float, float, float]] = field(default_factory=list)
    compressor_j: float = 0.0
    grid_compressor_j: float = 0.0
    drawn: float = 0.0
    distance_m: float = 0.0
    elapsed_s: float = 0.0
    arrival_charge: float = 0.0

    def __post_init__(self) -> None:
        self._heat_capacity_j_k = heat_capacity_j_k(self.parameters)

    def drive(self, trip_map: TripMap) -> None:
        """Add a trip; above the upper limit the pack is cooled whatever the control."""
        trip = trip_map.from_start(self.kelvin)
        kelvin = np.minimum(trip.temperature_k[0], UPPER_LIMIT_K)
        above_k = max(float(trip.end_k[0]) - UPPER_LIMIT_K, 0.0)
        self.compressor_j += (
            float(trip.compressor_j[0]) + above_k * self._heat_capacity_j_k / COOLING_COP
        )
        for row in zip(
            trip.durations_s, kelvin, trip.c_rate_1_h[0], self.charge - trip.drawn[0], strict=True
        ):
            duration_s, at_k, c_rate, charge = map(float, row)
            self.rows.append((duration_s, Activity.DRIVING, at_k, c_rate, charge))
        self.kelvin = float(trip.end_k[0]) - above_k
        used = float(trip.drawn[0, -1])
        self.charge, self.drawn = self.charge - used, self.drawn + used
        self.distance_m += trip.distance_m
        self.elapsed_s += trip.duration_s

    def stand(self, until_s: float, c_rate_1_h: float = 0.0, target: float = 1.0) -> None:
        """Park, or charge to a target, until an instant of the day, whichever comes first."""
        first_s = self.usage.departures[0][0] * HOUR_S
        while self.elapsed_s < until_s - 1e-6:
            step_s = min(_STEP_S, until_s - self.elapsed_s)
            activity = Activity.PARKED
            if c_rate_1_h > 0.0:
                to_target_s = (target - self.charge) / c_rate_1_h * HOUR_S
                if to_target_s < 1.0:
                    return
                step_s, activity = min(step_s, to_target_s), Activity.CHARGING
            clock_s = first_s + (self.elapsed_s + 0.5 * step_s)
            air_k = self.climate.air_c(self.month, clock_s) + CELSIUS_ZERO_K
            time_constant_s = PARKED_TIME_CONSTANT_S
            is_warmer = self.kelvin - air_k > FREE_COOLING_ABOVE_AIR_K
            if self.usage.free_cooling and is_warmer and self.kelvin > FREE_COOLING_FROM_K:
                conductance_w_k = (
                    self._heat_capacity_j_k / PARKED_TIME_CONSTANT_S + FREE_COOLING_W_K
                )
                time_constant_s = self._heat_capacity_j_k / conductance_w_k
                self.compressor_j += FREE_COOLING_FAN_W * step_s
            kept = float(np.exp(-step_s / time_constant_s))
            heat_j = step_s * self._charging_heat_w(c_rate_1_h)
            after_k = air_k + (self.kelvin - air_k) * kept + heat_j / self._heat_capacity_j_k
            if activity is Activity.CHARGING and after_k > self.charging_limit_k:
                removed_k = after_k - max(self.charging_limit_k, min(self.kelvin, after_k))
                self.grid_compressor_j += removed_k * self._heat_capacity_j_k / COOLING_COP
                after_k -= removed_k
            gained = c_rate_1_h * step_s / HOUR_S
            mean = 0.5 * (self.kelvin + after_k), c_rate_1_h, self.charge + 0.5 * gained
            self.rows.append((step_s, activity, *mean))
            self.kelvin, self.charge = after_k, self.charge + gained
            self.elapsed_s += step_s

    def _charging_heat_w(self, c_rate_1_h: float) -> float:
        current_a = c_rate_1_h * self.parameters.cell.nominal_capacity_ah
        ohm = float(cell_resistance_ohm(self.kelvin, 0.0, self.parameters.cell))
        pack = self.parameters.pack
        cells = pack.modules * pack.series_per_module * pack.parallel
        return cells * current_a**2 * ohm

    def drive_and_charge(self, trip: TripMap) -> None:
        """Add all of a driving day."""
        usage = self.usage
        for number, (hour, repeats) in enumerate(usage.departures):
            departure_s = (hour - usage.departures[0][0]) * HOUR_S
            if number and usage.fast_target > self.charge:
                self.stand(departure_s, FAST_C_RATE_1_H, usage.fast_target)
            self.stand(departure_s)
            for _ in range(repeats):
                self.drive(trip)
        self.arrival_charge = self.charge
        needed_s = max(usage.target - self.charge, 0.0) / usage.charging_c_rate_1_h * HOUR_S
        if usage.just_in_time:
            self.stand(DAY_S - needed_s)
        self.stand(DAY_S, usage.charging_c_rate_1_h, usage.target)
        self.stand(DAY_S)


def year_of(
    usage: Usage,
    climate: Climate,
    control: str,
    trips: Sequence[TripMap],
    parameters: ModelParameters,
) -> Year:
    """Compose a year of settled days, a driving day and a day of rest for every month.

    Args:
        usage: pattern of use.
        climate: air.
        control: control of the trips; `NO_COOLING` cools at the upper limit only, when charging, too.
        trips: a trip of the cycle of the usage under that control for each month, January first.
        parameters: pack of the car.
    """
    limit_k = UPPER_LIMIT_K if control == NO_COOLING else SIMPLE["thermostat_on_k"]
    parts: list[tuple[float, _Day]] = []
    for month, (days, trip) in enumerate(zip(MONTH_DAYS, trips, strict=True)):
        day = partial(_Day, parameters, usage, climate, month, limit_k)
        kelvin = climate.monthly_c[month] + CELSIUS_ZERO_K
        for _ in range(_DAYS_TO_SETTLE):
            driven = day(kelvin, usage.target)
            driven.drive_and_charge(trip)
            kelvin = driven.kelvin
        rest = day(kelvin, driven.arrival_charge if usage.just_in_time else driven.charge)
        rest.stand(DAY_S)
        share = usage.days_a_week / 7.0
        parts += [(share * days, driven), ((1.0 - share) * days, rest)]
    return _year(parts, nominal_energy_j(parameters))


def _year(parts: Sequence[tuple[float, _Day]], energy_j: float) -> Year:
    def total(name: str) -> float:
        return sum(days * float(getattr(day, name)) for days, day in parts)

    columns = []
    for days, day in parts:
        rows = np.array(day.rows)
        duration_s, activity, _, c_rate, charge = rows.T
        charging_s = np.where(activity == Activity.CHARGING, duration_s, 0.0)
        of_the_day = (
            np.ptp(charge),
            np.sum(duration_s * c_rate) / np.sum(duration_s),
            np.sum(charging_s * c_rate) / max(float(np.sum(charging_s)), 1.0),
        )
        repeated = np.tile(of_the_day, (len(rows), 1))
        columns.append(np.column_stack((days * duration_s, rows[:, 1:], repeated)))
    table = np.concatenate(columns)
    return Year(
        table[:, 0],
        table[:, 1],
        Load(*table[:, 2:].T),
        total("compressor_j") / J_PER_KWH,
        total("grid_compressor_j") / J_PER_KWH,
        total("drawn") * energy_j / J_PER_KWH,
        total("distance_m") / 1000.0,
    )
