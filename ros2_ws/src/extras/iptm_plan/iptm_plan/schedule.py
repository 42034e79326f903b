"""What is given of the hours to plan: departures with their trips, air, tariff and chargers.

Time is divided into equal steps. A trip occupies whole steps; what is left of its last one is parked time at
the state of its end. A departure may come some steps early, each with its probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_resistance_ohm
from iptm_core.physics.thermal_loop import mean_cell_heat_w
from iptm_core.state import FloatArray
from iptm_life.trip_map import SAMPLE_S, TripMap, nominal_energy_j

STEP_S = 900.0
_ROUNDING = 1e-9
_STARTS_K = (243.15, 333.15)
PULSATION = 1.5
"""Root mean square over mean of the current of a trip stated by its energy: with `production` in the paper's
car 1.6 on WLTC, 1.4 on US06 and 1.1 on HWFET."""


@dataclass(frozen=True)
class Departure:
    """A departure: when, for which trip, and what is asked for.

    Attributes:
        step: index of the step at whose beginning the car departs.
        trip: what the trip does to the pack.
        charge: least state of charge at departure.
        charger_w: largest power from the plug where the trip leads to, 0 without a plug.
        repeats: trips in a row.
        early: numbers of steps that the car may depart earlier, with probabilities whose sum is below 1.
    """

    step: int
    trip: TripMap
    charge: float = 0.0
    charger_w: float = 0.0
    repeats: int = 1
    early: tuple[tuple[int, float], ...] = ()

    def steps(self, step_s: float) -> int:
        """Return the whole steps that the trip occupies."""
        return max(ceil(self.duration_s / step_s - _ROUNDING), 1)

    @property
    def duration_s(self) -> float:
        """Length of all trips in a row."""
        return self.repeats * self.trip.duration_s

    @property
    def earliest(self) -> int:
        """The first step at which the car may depart."""
        return self.step - max((steps for steps, _ in self.early), default=0)

    def hazard(self, step: int) -> float:
        """Return the probability to depart at a step, if the car is still there."""
        if step >= self.step:
            return 1.0
        left = sum(share for steps, share in self.early if self.step - steps >= step)
        now = sum(share for steps, share in self.early if self.step - steps == step)
        return now / (left + self.on_time)

    @property
    def on_time(self) -> float:
        """The probability not to depart early."""
        return 1.0 - sum(share for _, share in self.early)


@dataclass(frozen=True, eq=False)
class Schedule:
    """Hours to plan, in steps.

    Attributes:
        air_k: air around the parked car, sun included, mean of each step, shape (n,).
        eur_kwh: price of electricity from the plug in each step, may be negative, shape (n,).
        charger_w: largest power from the plug where the car stands at the beginning.
        departures: in the order of time.
        least_charge: state of charge that is kept at all times.
        is_periodic: the hours repeat, as a week does; otherwise the last day does.

    Raises:
        ScenarioError: shapes, values or times do not fit together.
    """

    air_k: FloatArray
    eur_kwh: FloatArray
    charger_w: float
    departures: tuple[Departure, ...] = ()
    least_charge: float = 0.2
    step_s: float = STEP_S
    is_periodic: bool = False

    def __post_init__(self) -> None:
        for name in ("air_k", "eur_kwh"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or values.shape != np.shape(self.air_k) or not values.size:
                raise ScenarioError(
                    f"{name} has shape {values.shape}; allowed: one value for each step"
                )
            unknown = np.flatnonzero(~np.isfinite(values))
            if unknown.size:
                hours = unknown[0] * self.step_s / 3600.0
                raise ScenarioError(
                    f"{name} is {values[unknown[0]]} {hours:g} h after the beginning; allowed: known values"
                )
            object.__setattr__(self, name, values)
        _check_number("least_charge", self.least_charge, 0.0, 1.0)
        _check_number("charger_w", self.charger_w, 0.0, 1e6)
        arrived = 0
        for number, departure in enumerate(self.departures):
            where = f"departure {number + 1}"
            _check_number(f"{where}: charge", departure.charge, 0.0, 1.0)
            _check_number(f"{where}: charger_w", departure.charger_w, 0.0, 1e6)
            for steps, share in departure.early:
                _check_number(f"{where}: steps early", steps, 1, self.steps)
                _check_number(f"{where}: probability of {steps} steps early", share, 0.0, 1.0)
            if departure.on_time <= 0.0:
                raise ScenarioError(
                    f"{where}: early with probability {1.0 - departure.on_time:g}; allowed: a sum below 1"
                )
            if departure.earliest < arrived:
                raise ScenarioError(
                    f"{where} is after {self.hours(departure.earliest):g} h, before the trip ahead of it "
                    f"ends, at {self.hours(arrived):g} h; allowed: departures that do not overlap"
                )
            arrived = departure.step + departure.steps(self.step_s)
            if arrived > self.steps:
                raise ScenarioError(
                    f"{where} arrives after {self.hours(arrived):g} h; allowed: within the "
                    f"{self.hours(self.steps):g} h of the schedule"
                )

    @property
    def steps(self) -> int:
        """Number of steps."""
        return int(np.size(self.air_k))

    def hours(self, step: int) -> float:
        """Return the time since the beginning."""
        return step * self.step_s / 3600.0

    def place_w(self, stage: int) -> float:
        """Return the power of the charger where the car waits for a departure, or stays after the last."""
        return self.departures[stage - 1].charger_w if stage else self.charger_w

    def waits_from(self, stage: int) -> int:
        """Return the first step at which the car may wait for a departure."""
        if not stage:
            return 0
        before = self.departures[stage - 1]
        return before.earliest + before.steps(self.step_s)

    def waits_until(self, stage: int) -> int:
        """Return the step of a departure, of the end after the last one."""
        return self.departures[stage].step if stage < len(self.departures) else self.steps


def trip_of(energy_j: float, duration_s: float, parameters: ModelParameters) -> TripMap:
    """Return a trip of known energy and duration: the current heats the pack, nothing cools it.

    Args:
        energy_j: drawn from the pack.
        duration_s: length.
        parameters: of the pack.

    Raises:
        ScenarioError: energy or duration is out of range.
    """
    nominal_j = nominal_energy_j(parameters)
    _check_number("kWh of a trip", energy_j / 3.6e6, 1e-3, nominal_j / 3.6e6)
    _check_number("minutes of a trip", duration_s / 60.0, 1.0, 1440.0)
    count = ceil(duration_s / SAMPLE_S - _ROUNDING)
    ends_s = np.minimum(SAMPLE_S * np.arange(1, count + 1), duration_s)
    lengths_s = np.diff(ends_s, prepend=0.0)
    c_rate_1_h = 3600.0 * energy_j / nominal_j / duration_s
    current_a = c_rate_1_h * parameters.cell.nominal_capacity_ah
    square_a2 = (PULSATION * current_a) ** 2
    rows, starts_k = [], np.array(_STARTS_K)
    kelvin = starts_k.copy()
    for length_s in lengths_s:
        ohm = cell_resistance_ohm(kelvin, parameters.aging.initial_capacity_loss, parameters.cell)
        heat_w = mean_cell_heat_w(current_a, square_a2, ohm, kelvin, parameters.cell)
        after = kelvin + length_s * heat_w / parameters.cell.heat_capacity_j_k
        rows.append(0.5 * (kelvin + after))
        kelvin = after
    drawn = energy_j / nominal_j * ends_s / duration_s
    return TripMap(
        starts_k,
        np.array(rows).T,
        np.full((2, count), c_rate_1_h),
        np.tile(drawn, (2, 1)),
        kelvin,
        np.zeros(2),
        duration_s,
        0.0,
    )


def _check_number(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ScenarioError(f"{name} is {value!r}; allowed: {low:g} to {high:g}")
