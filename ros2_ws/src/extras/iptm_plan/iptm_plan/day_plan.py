"""Plan of the parked hours by dynamic programming over state of charge and temperature of the pack.

The cost to go V(s, T) in EUR is worked out backwards over the steps, for each departure that the car may wait
for,

    V_j(s, T; k) = h (leave) + (1 - h) min over decisions of [energy + ageing + V_j(s', T'; k + 1)],

with the probability h to depart at step k. Between the nodes of the grid V is linear in both. After the last
step comes what a plan of repeated hours makes of them: the schedule again if it is periodic, else its last
day. What a kelvin and a share of charge are worth on arrival are the slopes of V.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH, SECONDS_PER_DAY
from iptm_plan.course import Course, Event, ParkedInstant, Policy, course_of
from iptm_plan.pack import AgingPrice, ParkedPack, PlannedStep
from iptm_plan.schedule import Departure, Schedule

MISSED_EUR = 1e4
"""Cost of a whole state of charge that a departure lacks, or that is below the least charge for a step."""
SETTLED_EUR = 0.01
"""Largest change of the cost to go, from hours to their repetition, that counts as settled."""
_BEYOND_K = 5.0
_COLD_K = 280.15
_HOTTEST_K = 43.0 + CELSIUS_ZERO_K


@dataclass(frozen=True)
class Fineness:
    """Grid of states and decisions.

    Attributes:
        charges: nodes of the state of charge, from 0 to 1.
        kelvin: distance of two nodes of the temperature.
        charging: shares of the charger's power.
        thermal: shares of the power of chiller and heater.
        passes: of the repeated hours at most, until they settle.
    """

    charges: int = 51
    kelvin: float = 1.0
    charging: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    thermal: tuple[float, ...] = (0.125, 0.25, 0.5, 1.0)
    passes: int = 3


FINE = Fineness()


@dataclass(frozen=True, eq=False)
class _Place:
    """All decisions at a charger, from each node; arrays of shape (a, charges, kelvins) or broadcasting.

    Attributes:
        decisions: arrays of shape (a, 1, 1).
        below: flat index of the node below the state of charge afterwards, at the lowest temperature.
        above: share of the way to the next node.
        warmed_k: see `Stand`.
        kept: see `Stand`.
        grid_kwh: energy from the plug.
        eur: cost of ageing but for what the end of the step counts.
    """

    decisions: PlannedStep
    below: Any
    above: FloatArray
    warmed_k: FloatArray
    kept: FloatArray
    grid_kwh: FloatArray
    eur: FloatArray


@dataclass(frozen=True, eq=False)
class _Leave:
    """A trip from each node: state afterwards and cost."""

    charge: FloatArray
    kelvin: FloatArray
    eur: FloatArray


@dataclass(frozen=True)
class Worth:
    """What the state of the pack is worth at a departure or an arrival.

    Attributes:
        eur_per_k: cost of a kelvin more, negative where warmth is welcome.
        eur_per_percent: cost of one per cent of charge less.
    """

    is_departure: bool
    stage: int
    step: int
    charge: float
    kelvin: float
    eur_per_k: float
    eur_per_percent: float


class DayPlan:
    """The best decisions over a schedule, from any state of charge and temperature.

    Attributes:
        charges: nodes of the state of charge, shape (m,).
        kelvins: nodes of the temperature, shape (n,).
    """

    def __init__(
        self,
        schedule: Schedule,
        pack: ParkedPack,
        price: AgingPrice,
        fineness: Fineness = FINE,
        end: FloatArray | None = None,
    ) -> None:
        """Plan.

        Args:
            end: cost to go after the last step, shape (m, n); worked out from repeated hours by default.
        """
        self.schedule, self.pack, self.price, self._fine = schedule, pack, price, fineness
        low_k = min(float(np.min(schedule.air_k)), _COLD_K) - _BEYOND_K
        high_k = max(float(np.max(schedule.air_k)), _HOTTEST_K) + _BEYOND_K
        count = int(np.ceil((high_k - low_k) / fineness.kelvin)) + 1
        self.charges: FloatArray = np.arange(fineness.charges) / (fineness.charges - 1.0)
        self.kelvins: FloatArray = low_k + fineness.kelvin * np.arange(count, dtype=np.float64)
        self._s, self._t = self.charges[:, np.newaxis], self.kelvins[np.newaxis, :]
        half_s = 0.5 * schedule.step_s
        self._half_eur: FloatArray = half_s * price.calendar_eur_s(self._s, self._t)
        below = np.maximum(schedule.least_charge - self._s, 0.0)
        self._missed_eur: FloatArray = MISSED_EUR * below + 0.0 * self._t
        self._places = {
            power: self._place(power)
            for power in {schedule.place_w(stage) for stage in range(len(schedule.departures) + 1)}
        }
        leaves: dict[tuple[int, int], _Leave] = {}
        self._leaves = []
        for each in schedule.departures:
            driven = id(each.trip), each.repeats
            if driven not in leaves:
                leaves[driven] = self._leave(each)
            self._leaves.append(leaves[driven])
        self._values: dict[tuple[int, int], FloatArray] = {}
        self._end = self._settled() if end is None else end
        self._backward(self._end)

    def value(self, stage: int, step: int) -> FloatArray:
        """Return the cost to go in EUR of waiting for a departure when a step begins, shape (m, n)."""
        return self._values[stage, step]

    def cost_to_go(self, at: ParkedInstant) -> float:
        """Return the cost to go of a situation, in EUR."""
        return self._between(self._values[at.stage, at.step], at.charge, at.kelvin)

    def decide(self, at: ParkedInstant) -> PlannedStep:
        """Return the best decision of a step."""
        place = self._places[self.schedule.place_w(at.stage)]
        step_s, tried = self.schedule.step_s, place.decisions
        stood = self.pack.stand(
            at.charge, at.kelvin, self.schedule.place_w(at.stage), tried, step_s
        )
        air_k = self.schedule.air_k[at.step]
        after_k = air_k + (at.kelvin - air_k) * stood.kept + stood.warmed_k
        after = at.charge + stood.gained
        cost = stood.grid_j / J_PER_KWH * self.schedule.eur_kwh[at.step]
        cost = cost + step_s * self.price.cyclic_eur_s(at.charge, at.kelvin, stood.c_rate_1_h)
        # A car that is there before it could be waits as at the first step that was planned.
        later = max(at.step + 1, self.schedule.waits_from(at.stage))
        ends = self._values[at.stage, later] + self._half_eur + self._missed_eur
        below, above = self._nodes(np.broadcast_to(after, np.shape(after_k)))
        cost = cost + self._interpolated(ends, below, above, after_k)
        best = int(np.argmin(cost))
        chosen = (
            float(np.broadcast_to(each, np.shape(cost)).reshape(-1)[best])
            for each in (tried.charging, tried.thermal_w, tried.fan)
        )
        return PlannedStep(*chosen)

    def course(
        self, charge: float, kelvin: float, policy: Policy | None = None, **how: Any
    ) -> Course:
        """Return the course under the plan, or under another policy, from a state; see `course_of`."""
        return course_of(
            self.schedule, self.pack, self.price, policy or self, charge, kelvin, **how
        )

    def cost_eur(self, course: Course) -> float:
        """Return energy and ageing of a course, with the cost to go of its end."""
        end = self._between(self._end, float(course.charge[-1]), float(course.kelvin[-1]))
        return course.energy_eur + course.aging_eur + end

    def worth(self, course: Course) -> tuple[Worth, ...]:
        """Return what kelvin and charge are worth at the departures and arrivals of a course."""
        found = []
        for event in course.events:
            after = event.stage if event.is_departure else event.stage + 1
            value = self._values[after, event.step]
            if event.is_departure:  # the car leaves in any case
                value = self._left(event.stage, event.step)
            found.append(self._worth(event, value))
        return tuple(found)

    def worth_at_first(self, charge: float, kelvin: float) -> Worth:
        """Return what kelvin and charge are worth at the beginning: on arrival of a trip under way."""
        arrival = Event(-1, 0, charge, kelvin, 0.0, is_departure=False)
        return self._worth(arrival, self._values[0, 0])

    def _worth(self, event: Event, value: FloatArray) -> Worth:
        kelvin = float(np.clip(event.kelvin, self.kelvins[0] + 0.5, self.kelvins[-1] - 0.5))
        charge = float(np.clip(event.charge, 0.01, 0.99))
        at = self._between(value, charge, kelvin)
        return Worth(
            event.is_departure,
            event.stage,
            event.step,
            event.charge,
            event.kelvin,
            self._between(value, charge, kelvin + 0.5) - self._between(value, charge, kelvin - 0.5),
            self._between(value, charge - 0.01, kelvin) - at,
        )

    def _place(self, charger_w: float) -> _Place:
        """Work out all decisions at a charger."""
        fine, pack, step_s = self._fine, self.pack, self.schedule.step_s
        thermal = [(0.0, 0.0)]
        if pack.has_fan:
            thermal.append((0.0, 1.0))
        charging: tuple[float, ...] = (0.0,)
        if charger_w:
            charging = fine.charging
            thermal += [(share * pack.chiller_w, 0.0) for share in fine.thermal if pack.chiller_w]
            thermal += [(-share * pack.heater_w, 0.0) for share in fine.thermal if pack.heater_w]
        rows = np.array([(share, *each) for share, each in product(charging, thermal)])
        decisions = PlannedStep(*(column[:, np.newaxis, np.newaxis] for column in rows.T))
        stood = pack.stand(self._s, self._t, charger_w, decisions, step_s)
        shape = (len(rows), self.charges.size, self.kelvins.size)
        below, above = self._nodes(np.broadcast_to(self._s + stood.gained, shape))
        eur = self._half_eur + step_s * self.price.cyclic_eur_s(
            self._s, self._t, np.broadcast_to(stood.c_rate_1_h, shape)
        )
        return _Place(
            decisions,
            below,
            above,
            np.broadcast_to(stood.warmed_k, shape),
            np.broadcast_to(stood.kept, (len(rows), 1, 1)),
            np.broadcast_to(stood.grid_j / J_PER_KWH, shape),
            eur,
        )

    def _leave(self, departure: Departure) -> _Leave:
        """Work out a trip from each node."""
        after, ends_k, costs = [], [], []
        rest_s = departure.steps(self.schedule.step_s) * self.schedule.step_s
        rest_s -= departure.duration_s
        for kelvin in self.kelvins:
            driven = self.pack.driven(departure.trip, float(kelvin), departure.repeats)
            left = self.charges - float(driven.drawn[-1])
            eur = self.pack.driven_eur(driven, self.charges, self.price)
            costs.append(eur + rest_s * self.price.calendar_eur_s(left, driven.end_k))
            after.append(left)
            ends_k.append(driven.end_k)
        charge, eur = np.array(after).T, np.array(costs).T
        eur = eur + MISSED_EUR * np.maximum(self.schedule.least_charge - charge, 0.0)
        return _Leave(charge, np.broadcast_to(np.array(ends_k), charge.shape), eur)

    def _left(self, stage: int, step: int) -> FloatArray:
        """Return the cost to go of departing at a step."""
        departure, leave = self.schedule.departures[stage], self._leaves[stage]
        next_value = self._values[stage + 1, step + departure.steps(self.schedule.step_s)]
        below, above = self._nodes(leave.charge)
        missed = MISSED_EUR * np.maximum(departure.charge - self._s, 0.0)
        found: FloatArray = (
            leave.eur + missed + self._interpolated(next_value, below, above, leave.kelvin)
        )
        return found

    def _backward(self, end: FloatArray, begin: int = 0) -> None:
        """Work out the cost to go from the end back to a step."""
        schedule = self.schedule
        last = len(schedule.departures)
        self._values = {(last, schedule.steps): end}
        for stage in range(last, -1, -1):
            until = schedule.waits_until(stage)
            for step in range(until, max(schedule.waits_from(stage), begin) - 1, -1):
                if stage == last and step == until:
                    continue
                hazard = 0.0 if stage == last else schedule.departures[stage].hazard(step)
                value = np.zeros_like(end)
                if hazard > 0.0:
                    value += hazard * self._left(stage, step)
                if hazard < 1.0:
                    value += (1.0 - hazard) * self._stayed(stage, step)
                self._values[stage, step] = value

    def _stayed(self, stage: int, step: int) -> FloatArray:
        """Return the least cost to go of staying for a step."""
        place = self._places[self.schedule.place_w(stage)]
        air_k = self.schedule.air_k[step]
        after_k = air_k + (self._t - air_k) * place.kept + place.warmed_k
        ends = self._values[stage, step + 1] + self._half_eur + self._missed_eur
        cost = self._interpolated(ends, place.below, place.above, after_k)
        cost += place.eur
        cost += self.schedule.eur_kwh[step] * place.grid_kwh
        least: FloatArray = cost.min(axis=0)
        return least

    def _settled(self) -> FloatArray:
        """Return the cost to go after the last step, when the hours repeat."""
        schedule = self.schedule
        value: FloatArray = (
            -float(np.mean(schedule.eur_kwh)) * self.pack.energy_j / J_PER_KWH * self._s
            + 0.0 * self._t
        )
        day = round(SECONDS_PER_DAY / schedule.step_s)
        begin = 0 if schedule.is_periodic else max(schedule.steps - day, 0)
        stages = range(len(schedule.departures) + 1)
        waiting = [
            (step, stage)
            for stage in stages
            for step in range(schedule.waits_from(stage), schedule.waits_until(stage) + 1)
            if step <= begin
        ]
        step, stage = max(waiting)
        for _ in range(self._fine.passes):
            before = value
            self._backward(value, step)
            begun = self._values[stage, step]
            value = begun - np.min(begun)
            if np.ptp(value - before) < SETTLED_EUR:
                break
        return value

    def _nodes(self, charge: FloatArray) -> tuple[Any, FloatArray]:
        """Return flat indices of the nodes below some states of charge, and shares of the way to the next."""
        size = self.charges.size
        place = np.clip(charge, 0.0, 1.0) * (size - 1)
        node = np.minimum(place.astype(np.intp), size - 2)
        return node * self.kelvins.size, place - node

    def _interpolated(self, value: FloatArray, below: Any, above: Any, kelvin: Any) -> Any:
        size = self.kelvins.size
        place = (kelvin - self.kelvins[0]) / (self.kelvins[1] - self.kelvins[0])
        place = np.clip(place, 0.0, size - 1.0)
        node = np.minimum(place.astype(np.intp), size - 2)
        share = place - node
        node = node + below
        flat = value.reshape(-1)
        low = flat.take(node)
        low += share * (flat.take(node + 1) - low)
        high = flat.take(node + size)
        high += share * (flat.take(node + size + 1) - high)
        high -= low
        high *= above
        low += high
        return low

    def _between(self, value: FloatArray, charge: float, kelvin: float) -> float:
        below, above = self._nodes(np.array([charge]))
        return float(self._interpolated(value, below, above, np.array([kelvin]))[0])
