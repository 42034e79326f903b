"""The plan of the day: against enumeration, rules, its own simulation, and departures that come early."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from tests.extras.iptm_plan.scenes import (
    CHARGER_W,
    PACK,
    PRICE,
    hours,
    pack_with_heater,
    schedule,
    trip,
)

from iptm_controller.arrival import ArrivalCost
from iptm_core.errors import ScenarioError
from iptm_core.units import J_PER_KWH
from iptm_plan.course import ParkedInstant
from iptm_plan.day_plan import DayPlan, Fineness
from iptm_plan.pack import PlannedStep
from iptm_plan.profile import arrival_table
from iptm_plan.rules import Rule
from iptm_plan.schedule import Departure, Schedule

START = (0.5, 303.15)
RULES = {
    "on arrival": {"target": 0.8},
    "just in time": {"target": 0.8, "just_in_time": True},
    "managed": {"target": 0.6, "just_in_time": True, "free_cooling": True},
}


def test_within_a_percent_of_enumeration() -> None:
    """Seven hours before a departure, four decisions an hour: 16384 sequences, all of them tried."""
    tariff = np.array([0.3, 0.3, 0.1, 0.12, 0.3, 0.3, 0.2, 0.3])
    asked = Departure(7, trip(3.0, 60.0), charge=0.62, charger_w=0.0)
    planned = schedule(8.0, 36.0, tariff, step_s=3600.0, departures=(asked,))
    coarse = Fineness(101, 0.5, (0.0, 1.0), (1.0,))
    fan_less = type(PACK)(PACK.parameters, has_fan=False, chiller_w=500.0)
    plan = DayPlan(planned, fan_less, PRICE, coarse)
    sequences = np.array(list(product(range(4), repeat=7)))
    charge, kelvin, cost = (np.full(len(sequences), each) for each in (*START, 0.0))
    for step, eur_kwh in enumerate(tariff[:7]):
        decided = PlannedStep(1.0 * (sequences[:, step] // 2), 500.0 * (sequences[:, step] % 2))
        stood = fan_less.stand(charge, kelvin, CHARGER_W, decided, 3600.0)
        after, after_k = charge + stood.gained, 309.15 + (kelvin - 309.15) * stood.kept
        after_k = after_k + stood.warmed_k
        rest = PRICE.calendar_eur_s(charge, kelvin) + PRICE.calendar_eur_s(after, after_k)
        cost += 3600.0 * (0.5 * rest + PRICE.cyclic_eur_s(charge, kelvin, stood.c_rate_1_h))
        cost += eur_kwh * stood.grid_j / J_PER_KWH
        charge, kelvin = after, after_k
    for index in np.argsort(cost):  # the cheapest that is allowed, to the end by the simulation
        if charge[index] >= 0.62:
            break
    script = [PlannedStep(1.0 * (each // 2), 500.0 * (each % 2)) for each in sequences[index]]

    class Scripted:
        def decide(self, at: ParkedInstant) -> PlannedStep:
            return script[at.step] if at.step < 7 else PlannedStep()

    course = plan.course(*START)
    assert course.events[0].missed == 0.0
    best = plan.cost_eur(plan.course(*START, Scripted()))
    spent = best - plan._between(plan._end, *START)
    assert plan.cost_eur(course) - best <= 0.01 * abs(spent)
    assert plan.cost_to_go(ParkedInstant(0, 0, *START)) == pytest.approx(
        plan.cost_eur(course), abs=0.02 * abs(spent)
    )


@pytest.mark.parametrize("celsius", [0.0, 20.0, 35.0])
@pytest.mark.parametrize("rule", RULES)
def test_no_rule_is_cheaper(rule: str, celsius: float) -> None:
    tariff = np.where(hours(48.0) % 24.0 < 6.0, 0.15, 0.3)
    planned = schedule(48.0, celsius, tariff)
    plan = DayPlan(planned, PACK, PRICE)
    by_rule = plan.course(*START, Rule(planned, PACK, **RULES[rule]))
    assert plan.cost_eur(plan.course(*START)) <= plan.cost_eur(by_rule) + 0.01


def test_the_cost_to_go_is_what_the_hours_then_cost() -> None:
    plan = DayPlan(schedule(), PACK, PRICE)
    foreseen = plan.cost_to_go(ParkedInstant(0, 0, *START))
    assert plan.cost_eur(plan.course(*START)) == pytest.approx(foreseen, abs=0.03)


def test_rules_reach_their_target_when_they_should() -> None:
    planned = schedule()
    plan = DayPlan(planned, PACK, PRICE)
    arrival = plan.course(*START, Rule(planned, PACK))
    late = plan.course(*START, Rule(planned, PACK, just_in_time=True))
    assert arrival.charge[16] == pytest.approx(0.8, abs=1e-3)
    assert late.charge[16] == 0.5
    assert late.charge[48] == pytest.approx(0.8, abs=1e-3)
    assert late.charge[46] < 0.79
    assert arrival.grid_kwh == pytest.approx(late.grid_kwh + 0.055 * 72.5 / 0.9, rel=0.05)


def test_charging_waits_for_the_cheap_hours() -> None:
    tariff = np.where((hours(48.0) > 4.0) & (hours(48.0) < 9.0), 0.05, 0.4)
    asked = Departure(48, trip(), charge=0.7, charger_w=CHARGER_W)
    plan = DayPlan(schedule(48.0, 15.0, tariff, departures=(asked,)), PACK, PRICE)
    course = plan.course(*START)
    assert course.events[0].missed == 0.0
    cheap = tariff[:48] < 0.1
    assert course.grid_j[:48][cheap].sum() > 0.9 * course.grid_j[:48].sum() > 0.0


def test_negative_tariffs_are_taken() -> None:
    tariff = np.where(hours(48.0) % 24.0 < 2.0, -0.5, 0.3)
    course = DayPlan(schedule(48.0, 10.0, tariff), PACK, PRICE).course(*START)
    assert course.charge[8] > START[0]
    assert course.energy_eur < 0.0


@pytest.mark.parametrize("is_foreseen", [True, False])
def test_a_departure_two_hours_early_in_one_day_of_ten(is_foreseen: bool) -> None:
    """Foreseen, the charge is there two hours earlier; otherwise the least charge is missed."""
    early = ((8, 0.1),) if is_foreseen else ()
    tariff = np.where((hours(48.0) > 10.0) & (hours(48.0) < 12.0), 0.05, 0.4)
    long_trip = Departure(48, trip(14.0, 90.0), charger_w=CHARGER_W, early=early)
    planned = schedule(48.0, 25.0, tariff, departures=(long_trip,), least_charge=0.3)
    plan = DayPlan(planned, PACK, PRICE)
    course = plan.course(0.4, 298.15, early=[8])
    assert bool(course.charge.min() >= 0.295) == is_foreseen
    assert plan.course(0.4, 298.15).charge.min() >= 0.295


def test_a_night_in_the_cold_is_heated_once() -> None:
    """Cells that take no current below 0 degC are heated for one charging, not for each departure."""
    limits = {
        f"pack_limits.charge_rate_{node}_1_h": rate
        for node, rate in (("minus_20", 0.0), ("minus_10", 0.0), ("0", 0.02), ("5", 0.2))
    }
    pack = pack_with_heater(5000.0, **limits)
    tariff = np.where((hours(24.0) > 7.0) & (hours(24.0) < 9.0), 0.15, 0.25)
    departures = (
        Departure(48, trip(3.0, 30.0), charge=0.5, charger_w=CHARGER_W),
        Departure(60, trip(3.0, 30.0), charge=0.45, charger_w=CHARGER_W),
    )
    planned = schedule(24.0, -5.0, tariff, departures=departures)
    plan = DayPlan(planned, pack, PRICE)
    course = plan.course(0.4, 268.15)
    ruled = plan.course(0.4, 268.15, CheapestHeated(planned, pack))
    assert [event.missed for event in (*course.events, *ruled.events)] == [0.0] * 8
    heated = np.array([bool(each and each.thermal_w < 0.0) for each in course.decisions])
    begins = np.flatnonzero(np.diff(heated.astype(int)) == 1)
    assert len(begins) == 1
    assert course.thermal_j.sum() < 0.75 * ruled.thermal_j.sum()


class CheapestHeated:
    """Heats while charging, at the cheapest hours, to 20 degC; tops up before the second departure."""

    def __init__(self, planned: Schedule, pack: object) -> None:
        self._rule = Rule(planned, pack, 0.5, heats_to_k=293.15)  # type: ignore[arg-type]
        self._planned = planned

    def decide(self, at: ParkedInstant) -> PlannedStep:
        if at.stage == 0 and at.step < 29:
            return PlannedStep()
        return self._rule.decide(at)


def test_a_target_out_of_reach_is_reported_with_how_far_it_gets() -> None:
    asked = Departure(8, trip(), charge=0.9, charger_w=CHARGER_W)
    course = DayPlan(schedule(24.0, departures=(asked,)), PACK, PRICE).course(0.5, 298.15)
    assert course.events[0].charge == pytest.approx(0.5 + 2.0 * 0.92 * 7.4 / 72.5, abs=0.01)
    assert course.events[0].missed == pytest.approx(0.9 - course.events[0].charge)
    assert min(each.charging for each in course.decisions[:8] if each) == 1.0


def test_no_plug_is_a_plan_too() -> None:
    course = DayPlan(schedule(charger_w=0.0, departures=()), PACK, PRICE).course(0.5, 298.15)
    assert course.grid_kwh == 0.0
    assert np.all(np.diff(course.charge) <= 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"eur_kwh": np.nan}, "eur_kwh is nan 0 h"),
        ({"charger_w": -1.0}, "charger_w is -1.0"),
        ({"least_charge": 1.2}, "least_charge is 1.2"),
        ({"departures": (Departure(10, trip()), Departure(11, trip()))}, "departure 2 .*overlap"),
        ({"departures": (Departure(191, trip()),)}, "departure 1 arrives after 48.25 h"),
        ({"departures": (Departure(9, trip(), early=((4, 1.0),)),)}, "probability 1; allowed"),
        ({"departures": (Departure(9, trip(), charge=1.5),)}, "charge is 1.5"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        schedule(**changes)  # type: ignore[arg-type]


def test_prices_at_the_door() -> None:
    """Parked at 35 degC, a cool pack is welcome; charge is worth what it costs to buy."""
    warm = DayPlan(schedule(48.0, 35.0), PACK, PRICE)
    worth = warm.worth(warm.course(0.5, 308.15))
    assert [each.is_departure for each in worth] == [True, False, True, False]
    arrival = worth[1]
    assert arrival.eur_per_k > 0.0
    assert 0.05 < arrival.eur_per_percent < 0.25 * 0.725 / 0.9
    first = warm.worth_at_first(0.5, 308.15)
    begun = [warm.cost_to_go(ParkedInstant(0, 0, 0.5, each)) for each in (307.65, 308.65)]
    assert first.eur_per_k == pytest.approx(begun[1] - begun[0])
    cost = ArrivalCost.parse(arrival_table(warm, 1, arrival.step, arrival.charge))
    assert cost is not None
    assert np.all(np.diff(cost.eur)[np.searchsorted(cost.celsius, 25.0) :] > 0.0)
