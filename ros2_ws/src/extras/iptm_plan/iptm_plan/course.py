"""What happens to a pack over a schedule under any policy: states, energies, ageing, and what is missed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray
from iptm_core.units import J_PER_KWH
from iptm_life.year import FREE_COOLING_FAN_W, Activity
from iptm_plan.pack import AgingPrice, ParkedPack, PlannedStep
from iptm_plan.schedule import Schedule

TOLERANCE = 5e-3
"""Of a state of charge that is asked for."""


@dataclass(frozen=True)
class ParkedInstant:
    """An instant at which a car stands.

    Attributes:
        stage: index of the departure that the car waits for; the number of departures after the last one.
        step: index of the step that begins.
        charge: state of charge.
        kelvin: temperature of the pack.
    """

    stage: int
    step: int
    charge: float
    kelvin: float


class Policy(Protocol):
    """Decides what a standing car does."""

    def decide(self, at: ParkedInstant) -> PlannedStep:
        """Return the decision of a step, of numbers."""
        ...


@dataclass(frozen=True)
class Event:
    """A departure or an arrival.

    Attributes:
        stage: index of the departure, also of the one that leads to an arrival.
        asked: least state of charge at departure; of an arrival, the one that is kept at all times.
    """

    stage: int
    step: int
    charge: float
    kelvin: float
    asked: float
    is_departure: bool = True

    @property
    def missed(self) -> float:
        """What the state of charge is short of what is asked for, 0 within the tolerance."""
        short = self.asked - self.charge
        return short if short > TOLERANCE else 0.0


@dataclass(frozen=True, eq=False)
class Course:
    """Hours as they pass under a policy.

    Attributes:
        charge: state of charge at the ends of the steps, shape (n + 1,); linear during trips.
        kelvin: temperature of the pack, shape (n + 1,).
        decisions: of the steps of standing, None while driving, n of them.
        grid_j: energy from the plug, shape (n,).
        thermal_j: electric energy of fan, chiller and heater while standing, shape (n,).
        energy_eur: price of the energy from the plug.
        aging_eur: price of the ageing.
        rows: duration in s, `Activity`, temperature, C-rate and state of charge of what happened, as in
            `iptm_life.year`, shape (m, 5).
        events: departures and arrivals.
        drawn: share of the nominal energy that the trips took.
        plugged_thermal_j: part of the thermal energy that comes from the plug.
        trip_cooling_j: energy of cooling during trips.
        distance_m: driven.
    """

    charge: FloatArray
    kelvin: FloatArray
    decisions: tuple[PlannedStep | None, ...]
    grid_j: FloatArray
    thermal_j: FloatArray
    energy_eur: float
    aging_eur: float
    rows: FloatArray
    events: tuple[Event, ...]
    drawn: float
    plugged_thermal_j: float
    trip_cooling_j: float
    distance_m: float

    @property
    def grid_kwh(self) -> float:
        """Energy from the plug."""
        return float(np.sum(self.grid_j)) / J_PER_KWH


class _Log:
    """Rows and sums of a course in the making."""

    def __init__(self, steps: int, charge: float, kelvin: float) -> None:
        self.charge = np.full(steps + 1, charge)
        self.kelvin = np.full(steps + 1, kelvin)
        self.decisions: list[PlannedStep | None] = [None] * steps
        self.grid_j, self.thermal_j = np.zeros(steps), np.zeros(steps)
        self.rows: list[tuple[float, float, float, float, float]] = []
        self.events: list[Event] = []
        self.aging_eur = self.drawn = self.trip_cooling_j = self.distance_m = 0.0


def course_of(
    schedule: Schedule,
    pack: ParkedPack,
    price: AgingPrice,
    policy: Policy,
    charge: float,
    kelvin: float,
    early: Sequence[int] = (),
) -> Course:
    """Let the hours of a schedule pass.

    Args:
        charge: state of charge at the beginning.
        kelvin: temperature of the pack at the beginning.
        early: steps that the car departs early, one number for each departure; none for all in time.

    Raises:
        ScenarioError: a departure is earlier than the arrival before it.
    """
    log = _Log(schedule.steps, charge, kelvin)
    step = 0
    ahead = list(early) or [0] * len(schedule.departures)
    for stage, departure in enumerate(schedule.departures):
        departs = departure.step - ahead[stage]
        if departs < step:
            raise ScenarioError(
                f"departure {stage + 1} is {ahead[stage]} steps early; allowed: after the arrival"
            )
        _stand(schedule, pack, price, policy, log, stage, step, departs)
        step = _drive(schedule, pack, price, log, stage, departs)
    _stand(schedule, pack, price, policy, log, len(schedule.departures), step, schedule.steps)
    return Course(
        log.charge,
        log.kelvin,
        tuple(log.decisions),
        log.grid_j,
        log.thermal_j,
        float(np.dot(log.grid_j, schedule.eur_kwh)) / J_PER_KWH,
        log.aging_eur,
        np.array(log.rows),
        tuple(log.events),
        log.drawn,
        float(np.sum(log.thermal_j[log.grid_j > 0.0])),
        log.trip_cooling_j,
        log.distance_m,
    )


def _stand(
    schedule: Schedule,
    pack: ParkedPack,
    price: AgingPrice,
    policy: Policy,
    log: _Log,
    stage: int,
    begin: int,
    end: int,
) -> None:
    step_s, charger_w = schedule.step_s, schedule.place_w(stage)
    for step in range(begin, end):
        charge, kelvin = float(log.charge[step]), float(log.kelvin[step])
        decision = policy.decide(ParkedInstant(stage, step, charge, kelvin))
        stood = pack.stand(charge, kelvin, charger_w, decision, step_s)
        air_k = float(schedule.air_k[step])
        after = charge + float(stood.gained)
        after_k = air_k + (kelvin - air_k) * float(stood.kept) + float(stood.warmed_k)
        c_rate = float(stood.c_rate_1_h)
        rest = price.calendar_eur_s(charge, kelvin) + price.calendar_eur_s(after, after_k)
        cyclic = price.cyclic_eur_s(charge, kelvin, c_rate)
        log.aging_eur += step_s * (0.5 * float(rest) + float(cyclic))
        log.grid_j[step], log.thermal_j[step] = float(stood.grid_j), float(stood.thermal_j)
        log.charge[step + 1], log.kelvin[step + 1] = after, after_k
        fan_j = FREE_COOLING_FAN_W * float(decision.fan) * step_s
        drawn_w = (log.thermal_j[step] - fan_j) / step_s  # less than decided at the lower limit
        log.decisions[step] = replace(
            decision, thermal_w=math.copysign(drawn_w, decision.thermal_w)
        )
        activity = Activity.CHARGING if c_rate > 0.0 else Activity.PARKED
        log.rows.append(
            (step_s, activity, 0.5 * (kelvin + after_k), c_rate, 0.5 * (charge + after))
        )


def _drive(
    schedule: Schedule, pack: ParkedPack, price: AgingPrice, log: _Log, stage: int, begin: int
) -> int:
    departure, step_s = schedule.departures[stage], schedule.step_s
    charge, kelvin = float(log.charge[begin]), float(log.kelvin[begin])
    log.events.append(Event(stage, begin, charge, kelvin, departure.charge))
    driven = pack.driven(departure.trip, kelvin, departure.repeats)
    end_k, drawn = driven.end_k, float(driven.drawn[-1])
    log.aging_eur += float(pack.driven_eur(driven, charge, price))
    for row in zip(
        driven.durations_s, driven.kelvin, driven.c_rate_1_h, charge - driven.drawn, strict=True
    ):
        duration_s, at_k, c_rate, at = map(float, row)
        log.rows.append((duration_s, Activity.DRIVING, at_k, c_rate, at))
    steps = departure.steps(step_s)
    end = begin + steps
    shares = np.arange(steps + 1) / steps
    left = charge - drawn
    log.charge[begin : end + 1] = charge + shares * (left - charge)
    log.kelvin[begin : end + 1] = kelvin + shares * (end_k - kelvin)
    rest_s = steps * step_s - departure.duration_s
    if rest_s > 0.0:
        log.rows.append((rest_s, Activity.PARKED, end_k, 0.0, left))
        log.aging_eur += rest_s * float(price.calendar_eur_s(left, end_k))
    log.events.append(Event(stage, end, left, end_k, schedule.least_charge, is_departure=False))
    log.drawn += drawn
    log.trip_cooling_j += driven.cooling_j
    log.distance_m += departure.repeats * departure.trip.distance_m
    return end
