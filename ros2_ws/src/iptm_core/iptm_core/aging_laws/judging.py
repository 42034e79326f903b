"""Ageing of a trip by several laws: the same use of a cell for each of them.

A law of cells counts time, temperature, charge and throughput, so it needs a use, not a trip alone. That is

    the trip, then charging to the charge of its beginning, again and again

with `CHARGING_1_H` and a temperature that falls linearly to `CHARGED_K`, without a rest between. What a law
gives after `DAYS` of it is the loss that judges compare. A thrifty trip is charged in less time, and a trip
that leaves the pack cool begins its charging cool; beyond that nothing is corrected for the end of a trip.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.aging_laws.law import AgingLaw, Load, paper_law
from iptm_core.errors import StateError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import SECONDS_PER_DAY, SECONDS_PER_HOUR

TRIPS = 6
"""Trips of a use that is written out; it is repeated."""
CHARGING_1_H = 1.0 / 3.0
CHARGED_K = 298.15
DAYS = 7.3
"""A week, as a round number of years (0.02) for laws that count these."""
LONGEST_STEP_S = 60.0
"""Longest time between two rows: current and temperature are taken as linear in between."""
_CHARGING_POINTS = 12
_POINT_S = 60.0


@dataclass(frozen=True, eq=False)
class Exposure:
    """What a cell is exposed to; arrays of shape (n,), one value per instant.

    Attributes:
        time_s: increasing.
        charge: state of charge, 0 to 1; its fall is the discharge current over the capacity.
        temperature_k: mean of the first and the last cell of a coolant channel.
        apart_k: temperature of the last cell less the one of the first; zero by default.

    Raises:
        StateError: columns of different length, unknown values, or a gap in time.
    """

    time_s: FloatArray
    charge: FloatArray
    temperature_k: FloatArray
    apart_k: FloatArray = field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        rows = np.size(self.time_s)
        for name in ("time_s", "charge", "temperature_k", "apart_k"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if name == "apart_k" and not values.shape:
                values = np.full(rows, values)
            if values.shape != (rows,) or rows < 2:
                raise StateError(
                    f"exposure: {name} has shape {values.shape}; allowed: ({rows},), of 2 rows or more"
                )
            unknown = np.flatnonzero(~np.isfinite(values))
            if unknown.size:
                raise StateError(
                    f"exposure: {name} is {values[unknown[0]]} in row {unknown[0]} and unknown in "
                    f"{unknown.size} of {rows} rows; allowed: current and temperature throughout"
                )
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        steps_s = np.diff(self.time_s)
        if steps_s.min() <= 0.0:
            raise StateError(f"exposure: a step of {steps_s.min():g} s; allowed: increasing times")

    @classmethod
    def of(cls, run: Trajectory) -> Exposure:
        """Return the exposure of the cells in a run.

        Raises:
            StateError: charge or temperatures are not known, or rows are missing.
        """
        steps_s = run.intervals_s
        if steps_s.size and steps_s.max() > LONGEST_STEP_S:
            row = int(np.argmax(steps_s))
            raise StateError(
                f"run: {steps_s[row]:g} s without a row after {run.time_s[row]:g} s; allowed: at most "
                f"{LONGEST_STEP_S:g} s"
            )
        first_k, last_k = run.cell_1_temperature_k, run.cell_n_temperature_k
        return cls(run.time_s, run.state_of_charge, 0.5 * (first_k + last_k), last_k - first_k)

    def at(self, other: Exposure) -> Exposure:
        """Return the current of this exposure at the temperatures of another one, by the time since begin."""
        own_s, since_s = (each.time_s - each.time_s[0] for each in (self, other))
        mean_k: FloatArray = np.interp(own_s, since_s, other.temperature_k)
        apart_k: FloatArray = np.interp(own_s, since_s, other.apart_k)
        return Exposure(self.time_s, self.charge, mean_k, apart_k)

    def repeated(self, trips: int = TRIPS) -> Exposure:
        """Return trips in a row, each followed by charging what it took; a trip that took nothing by none."""
        taken = float(self.charge[0] - self.charge[-1])
        hours = taken / CHARGING_1_H
        ending_s = max(hours * SECONDS_PER_HOUR, 0.0)
        first_s = min(_POINT_S, 0.5 * ending_s)
        charging_s = np.linspace(first_s, ending_s, _CHARGING_POINTS if ending_s else 0)
        gained = taken * charging_s / ending_s if ending_s else charging_s
        cooled_k = np.linspace(self.temperature_k[-1], CHARGED_K, charging_s.size)
        trip_s = self.time_s - self.time_s[0]
        one_s = np.concatenate((trip_s, trip_s[-1] + charging_s))
        step_s = trip_s[1] - trip_s[0]
        times_s = [one_s + trip * (one_s[-1] + step_s) for trip in range(trips)]
        charges = np.concatenate((self.charge, self.charge[-1] + gained))
        temperatures_k = np.concatenate((self.temperature_k, cooled_k))
        return Exposure(
            np.concatenate(times_s),
            np.clip(np.tile(charges, trips), 0.0, 1.0),
            np.tile(temperatures_k, trips),
        )


def loss_by_law(law: AgingLaw, exposure: Exposure) -> float:
    """Return the capacity lost by a new cell in `DAYS` of a use, as a share of nominal capacity.

    Depth of discharge and mean C-rates hold for a trip with its charging.
    """
    use = exposure.repeated(1)
    steps_s = np.diff(use.time_s)
    charge, kelvin = (0.5 * (each[1:] + each[:-1]) for each in (use.charge, use.temperature_k))
    c_rate_1_h = -SECONDS_PER_HOUR * np.diff(use.charge) / steps_s
    is_charging = c_rate_1_h < 0.0
    charging_s = steps_s[is_charging]
    load = Load(
        kelvin,
        c_rate_1_h,
        charge,
        float(np.ptp(use.charge)),
        float(np.average(np.abs(c_rate_1_h), weights=steps_s)),
        float(np.average(-c_rate_1_h[is_charging], weights=charging_s)) if charging_s.size else 0.0,
    )
    uses = DAYS * SECONDS_PER_DAY / float(np.sum(steps_s))
    damage = [uses * float(np.sum(part.damage_rate_1_s(load) * steps_s)) for part in law.mechanisms]
    return float(law.capacity_loss(damage))


def loss_by_cell(cell: str, exposure: Exposure) -> float:
    """Return what `loss_by_law` gives for one of `AGING_CELLS`."""
    return loss_by_law(AGING_CELLS[cell].law, exposure)


def loss_by_paper(parameters: ModelParameters, exposure: Exposure) -> float:
    """Return the capacity lost on the trip itself, mean of the first and the last cell.

    The law has no ageing at rest. The current of an interval counts by its mean.
    """
    law = paper_law(parameters).mechanisms[0]
    steps_s = np.diff(exposure.time_s)
    c_rate_1_h = -SECONDS_PER_HOUR * np.diff(exposure.charge) / steps_s
    initial = parameters.aging.initial_capacity_loss
    lost = 0.0
    for side in (-0.5, 0.5):
        cell_k = exposure.temperature_k + side * exposure.apart_k
        load = Load(0.5 * (cell_k[1:] + cell_k[:-1]), c_rate_1_h)
        damage = initial ** (1.0 / law.exponent) + float(
            np.sum(law.damage_rate_1_s(load) * steps_s)
        )
        lost += 0.5 * (damage**law.exponent - initial)
    return lost


@dataclass(frozen=True)
class Judge:
    """A law or model that gives the ageing of a use.

    Attributes:
        name: of the cell or mechanism.
        group: of judges that are summed up together.
        function: of a module; returns the capacity lost, as a share of nominal capacity.
        arguments: of the function, besides ``exposure``.
    """

    name: str
    group: str
    function: Callable[..., float]
    arguments: Mapping[str, Any]

    def loss(self, exposure: Exposure) -> float:
        """Return the capacity lost, as a share of nominal capacity."""
        return self.function(**self.arguments, exposure=exposure)


CELLS = "laws of cells"
CELL_JUDGES = tuple(Judge(name, CELLS, loss_by_cell, {"cell": name}) for name in AGING_CELLS)
"""The measured cells of the suite."""


def losses_of_cells(exposure: Exposure) -> dict[str, float]:
    """Return the capacity that the measured cells of the suite lose, by the names of their laws."""
    return {judge.name: judge.loss(exposure) for judge in CELL_JUDGES}
