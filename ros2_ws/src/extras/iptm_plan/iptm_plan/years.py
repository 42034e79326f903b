"""Years of use with the parked hours planned, or by a rule: `iptm.life(run, usage=PlannedYears(...))`.

A year is made of weeks of some of its months, each repeated until it settles. The plan weighs ageing at the
marginal loss at the end of service. That depends on the plan itself: it begins with that of the best rule,
and is worked out anew with the damage of the plan. The loss is concave in the damage, so that loss and
energy together only fall from one to the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from iptm.climate import DAY_S, HOUR_S, MONTH_DAYS, Climate
from iptm_core.aging_laws.cells import AgingCell
from iptm_core.aging_laws.law import AgingLaw, Load
from iptm_core.aging_laws.parking import AgingSettings, capacity_price_eur
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_core.user_input import check_known
from iptm_life.life import SERVICE_YEARS, damage_by_cause
from iptm_life.trip_map import TripMap, nominal_energy_j
from iptm_life.year import FAST_C_RATE_1_H, Activity, Usage, Year
from iptm_plan.course import Course, Policy, course_of
from iptm_plan.day_plan import DayPlan, Fineness
from iptm_plan.pack import CHARGER_EFFICIENCY, AgingPrice, ParkedPack
from iptm_plan.rules import RULES, Rule
from iptm_plan.schedule import STEP_S, Departure, Schedule

PLAN = "plan"
WEEK_DAYS = 7
MONTHS = tuple(range(12))
SEASONS = (0, 3, 6, 9)
"""January, April, July and October, each for a quarter of a year."""
LEAST_CHARGE = 0.2
FINENESS = Fineness(41, 1.5, (0.0, 0.5, 1.0), (0.125, 0.5, 1.0), passes=3)
_WEEKS_TO_SETTLE = 4
_SETTLED, _SETTLED_K = 2e-3, 0.3
_ROUNDS = 2
_LEAST_DAMAGE = 1e-12


@dataclass(frozen=True)
class PlannedYears:
    """A pattern of use whose parked hours are planned, or follow a rule.

    Attributes:
        usage: departures, days and chargers; its targets and its cycle do not count.
        by: ``plan``, or one of `RULES`.
        prices: of electricity and battery.
        has_fan: a radiator and a fan for the parked pack.
        months: that are composed, 0 for January.
    """

    usage: Usage
    by: str = PLAN
    prices: AgingSettings = field(default_factory=AgingSettings)
    has_fan: bool = True
    months: Sequence[int] = MONTHS
    fineness: Fineness = FINENESS

    def __post_init__(self) -> None:
        check_known(self.by, (PLAN, *RULES), "years", "rule", ScenarioError)

    @property
    def name(self) -> str:
        """Name of the use and of what decides."""
        return f"{self.usage.name}, {self.by}"

    def year(
        self, cell: AgingCell, climate: Climate, trip: TripMap, parameters: ModelParameters
    ) -> Year:
        """Return a year of trips."""
        return self.weeks(cell.law, climate, trip, parameters).year(parameters)

    def weeks(
        self, law: AgingLaw, climate: Climate, trip: TripMap, parameters: ModelParameters
    ) -> Weeks:
        """Return the settled weeks of a year, and what they cost.

        Raises:
            ScenarioError: the trips of a day overlap.
        """
        pack = ParkedPack(parameters, self.has_fan)
        schedules = [self._week(climate, month, trip, parameters) for month in self.months]
        price = self._price(law, self._weights(law), trip, parameters)
        ruled = {
            name: self._followed(schedules, pack, price, name)
            for name in (RULES if self.by == PLAN else (self.by,))
        }
        if self.by != PLAN:
            return ruled[self.by]
        best = min(ruled.values(), key=lambda weeks: weeks.cost_eur(law, self.prices, parameters))
        for _ in range(_ROUNDS):
            price = replace(price, weights=best.weights(law, parameters))
            planned = self._planned(schedules, pack, price)
            if planned.cost_eur(law, self.prices, parameters) < best.cost_eur(
                law, self.prices, parameters
            ):
                best = planned
        return best

    def _week(
        self, climate: Climate, month: int, trip: TripMap, parameters: ModelParameters
    ) -> Schedule:
        usage, steps = self.usage, round(WEEK_DAYS * DAY_S / STEP_S)
        times_s = STEP_S * (np.arange(steps) + 0.5)
        air_k = [climate.air_c(month, float(time_s)) + CELSIUS_ZERO_K for time_s in times_s]
        per_1_h = nominal_energy_j(parameters) / HOUR_S / CHARGER_EFFICIENCY
        home_w = usage.charging_c_rate_1_h * per_1_h
        between_w = FAST_C_RATE_1_H * per_1_h if usage.fast_target else 0.0
        departures = [
            Departure(
                round((day * DAY_S + hour * HOUR_S) / STEP_S),
                trip,
                0.0,
                home_w if number + 1 == len(usage.departures) else between_w,
                repeats,
            )
            for day in range(round(usage.days_a_week))
            for number, (hour, repeats) in enumerate(usage.departures)
        ]
        return Schedule(
            np.array(air_k),
            np.full(steps, self.prices.electricity_eur_kwh),
            home_w,
            tuple(departures),
            LEAST_CHARGE,
            is_periodic=True,
        )

    def _price(
        self,
        law: AgingLaw,
        weights: tuple[float, ...],
        trip: TripMap,
        parameters: ModelParameters,
    ) -> AgingPrice:
        drawn = float(np.mean(trip.drawn[:, -1])) * sum(many for _, many in self.usage.departures)
        return AgingPrice(
            law,
            weights,
            capacity_price_eur(self.prices, parameters),
            min(drawn, 1.0),
            2.0 * drawn * HOUR_S / DAY_S,
            self.usage.charging_c_rate_1_h,
        )

    def _weights(self, law: AgingLaw) -> tuple[float, ...]:
        return (1.0,) * len(law.mechanisms)

    def _followed(
        self, schedules: Sequence[Schedule], pack: ParkedPack, price: AgingPrice, name: str
    ) -> Weeks:
        rule = dict(RULES[name])
        targets = self.usage.target, self.usage.managed_target
        rule |= {
            "target": targets[bool(rule.get("free_cooling"))],
            "away_target": self.usage.fast_target,
        }
        rules = [Rule(each, pack, **rule) for each in schedules]
        return self._settled(pack, price, {each.schedule: each for each in rules})

    def _planned(self, schedules: Sequence[Schedule], pack: ParkedPack, price: AgingPrice) -> Weeks:
        plans = {each: DayPlan(each, pack, price, self.fineness) for each in schedules}
        return self._settled(pack, price, plans)

    def _settled(
        self, pack: ParkedPack, price: AgingPrice, policies: Mapping[Schedule, Policy]
    ) -> Weeks:
        days = [MONTH_DAYS[month] for month in self.months]
        shares = [each * sum(MONTH_DAYS) / sum(days) for each in days]
        courses = (_settled(each, pack, price, policy) for each, policy in policies.items())
        return Weeks(tuple(zip(shares, courses, strict=True)))


@dataclass(frozen=True, eq=False)
class Weeks:
    """Settled weeks of a year.

    Attributes:
        parts: days of the year that a week stands for, and its course.
    """

    parts: tuple[tuple[float, Course], ...]

    def year(self, parameters: ModelParameters) -> Year:
        """Return the year."""

        def total(name: str) -> float:
            return sum(days / WEEK_DAYS * float(getattr(week, name)) for days, week in self.parts)

        tables = [loads(days / WEEK_DAYS, week.rows) for days, week in self.parts]
        table = np.concatenate(tables)
        plugged = sum(days / WEEK_DAYS * week.plugged_thermal_j for days, week in self.parts)
        thermal = sum(days / WEEK_DAYS * float(np.sum(week.thermal_j)) for days, week in self.parts)
        return Year(
            table[:, 0],
            table[:, 1],
            Load(*table[:, 2:].T),
            (total("trip_cooling_j") + thermal - plugged) / J_PER_KWH,
            plugged / J_PER_KWH,
            total("drawn") * nominal_energy_j(parameters) / J_PER_KWH,
            total("distance_m") / 1000.0,
        )

    def grid_kwh(self, parameters: ModelParameters) -> float:
        """Return the energy from the plug in a year; what a week leaves in the pack is taken off."""
        per_charge = nominal_energy_j(parameters) / CHARGER_EFFICIENCY / J_PER_KWH
        return sum(
            days
            / WEEK_DAYS
            * (week.grid_kwh - per_charge * float(week.charge[-1] - week.charge[0]))
            for days, week in self.parts
        )

    def loss(
        self, law: AgingLaw, parameters: ModelParameters, years: float = SERVICE_YEARS
    ) -> float:
        """Return the capacity lost after years of service, as a share of nominal capacity."""
        return float(law.capacity_loss([years * each for each in self._damage(law, parameters)]))

    def cost_eur(self, law: AgingLaw, prices: AgingSettings, parameters: ModelParameters) -> float:
        """Return what energy and ageing cost in all years of service."""
        energy = prices.service_years * prices.electricity_eur_kwh * self.grid_kwh(parameters)
        lost = self.loss(law, parameters, prices.service_years)
        return energy + capacity_price_eur(prices, parameters) * lost

    def weights(self, law: AgingLaw, parameters: ModelParameters) -> tuple[float, ...]:
        """Return the marginal loss of each mechanism at the end of service."""
        damage = [
            max(SERVICE_YEARS * each, _LEAST_DAMAGE) for each in self._damage(law, parameters)
        ]
        return tuple(
            part.exponent * each ** (part.exponent - 1.0)
            for part, each in zip(law.mechanisms, damage, strict=True)
        )

    def _damage(self, law: AgingLaw, parameters: ModelParameters) -> list[float]:
        return [sum(each.values()) for each in damage_by_cause(law, self.year(parameters))]


def _settled(schedule: Schedule, pack: ParkedPack, price: AgingPrice, policy: Policy) -> Course:
    """Return the course of hours that repeat."""
    charge, kelvin = 0.6, float(np.mean(schedule.air_k))
    for _ in range(_WEEKS_TO_SETTLE):
        course = course_of(schedule, pack, price, policy, charge, kelvin)
        off, off_k = course.charge[-1] - charge, course.kelvin[-1] - kelvin
        charge, kelvin = float(course.charge[-1]), float(course.kelvin[-1])
        if abs(off) < _SETTLED and abs(off_k) < _SETTLED_K:
            break
    return course


def loads(weight: float, rows: FloatArray) -> FloatArray:
    """Return duration times a weight, activity, and the columns of `Load`, of rows as in a `Course`."""
    day = (np.cumsum(rows[:, 0]) - 0.5 * rows[:, 0]) // DAY_S
    table = np.column_stack((rows, np.zeros((len(rows), 3))))
    for each in np.unique(day):
        of_day = day == each
        duration_s, activity, _, c_rate, charge = rows[of_day].T
        charging_s = np.where(activity == Activity.CHARGING, duration_s, 0.0)
        table[of_day, 5:] = (
            np.ptp(charge),
            np.sum(duration_s * c_rate) / np.sum(duration_s),
            np.sum(charging_s * c_rate) / max(float(np.sum(charging_s)), 1.0),
        )
    table[:, 0] *= weight
    return table
