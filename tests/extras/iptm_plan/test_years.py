"""Years of use under rules and under a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.extras.iptm_plan.scenes import CAR, trip

import iptm
from iptm.climate import climate_of
from iptm_core.aging_laws.cells import NCA, NMC622, AgingCell
from iptm_core.errors import ScenarioError
from iptm_life.life import damage_by_cause
from iptm_life.year import USAGES, Activity, Usage
from iptm_plan.day_plan import Fineness
from iptm_plan.recorded_week import RecordedWeek
from iptm_plan.rules import RULES
from iptm_plan.years import PLAN, PlannedYears

COMMUTER, TAXI, LONG = USAGES
JULY = {"months": (6,), "fineness": Fineness(41, 2.0, (0.0, 1.0), (0.25, 1.0), passes=2)}


def test_rules_make_the_years_that_the_suite_makes_of_them() -> None:
    """The same trips: by `Usage`, and in steps of 15 minutes by a rule."""
    run = iptm.simulate("wltc_class3b", duration_s=300.0, strategy="production")
    managed = COMMUTER.managed()
    for usage, by in ((COMMUTER, "on arrival to 80 %"), (managed, "managed")):
        whole = iptm.life(run, usage=usage, climate="Rome", start_c=(20.0, 36.0))
        ruled = iptm.life(
            run, usage=PlannedYears(COMMUTER, by), climate="Rome", start_c=(20.0, 36.0)
        )
        assert ruled.lost.sum() == pytest.approx(whole.lost.sum(), rel=0.02)
        assert ruled.energy_kwh == pytest.approx(whole.energy_kwh, rel=5e-3)
        assert ruled.distance_km == pytest.approx(whole.distance_km, rel=2e-3)
    assert f"commuter, {by}" in ruled.about


def test_trips_are_not_driven_again_for_other_parked_hours(monkeypatch: pytest.MonkeyPatch) -> None:
    run = iptm.simulate("wltc_class3b", duration_s=60.0, strategy="production")
    driven = iptm.life(run, start_c=(20.0, 36.0))

    def fail(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("iptm_life.life._driven_from", fail)
    late = iptm.life(run, start_c=(20.0, 36.0), usage=replace(COMMUTER, just_in_time=True))
    assert late.lost.sum() < driven.lost.sum()


@pytest.mark.parametrize("cell", [NCA, NMC622], ids=lambda cell: str(cell.law.name))
@pytest.mark.parametrize("usage", USAGES, ids=lambda usage: str(usage.name))
def test_a_plan_costs_less_than_every_rule(cell: AgingCell, usage: Usage) -> None:
    """Energy and ageing of eight years, July in Phoenix; the pack of NMC622 likes 80 % better than 60 %."""
    driven, air = (
        trip(4.2 if usage is not LONG else 2.0, 30.0 if usage is not LONG else 12.75),
        climate_of("Phoenix"),
    )
    cost = {}
    for by in (*RULES, PLAN):
        years = PlannedYears(usage, by, **JULY)  # type: ignore[arg-type]
        weeks = years.weeks(cell.law, air, driven, CAR)
        cost[by] = weeks.cost_eur(cell.law, years.prices, CAR)
    assert min(cost, key=cost.__getitem__) == PLAN
    assert cost[PLAN] < min(cost[by] for by in RULES)


def test_a_year_has_all_of_its_hours() -> None:
    years = PlannedYears(TAXI, "managed", months=(0, 6))
    weeks = years.weeks(NCA.law, climate_of("Oslo"), trip(), CAR)
    year = weeks.year(CAR)
    assert year.duration_s.sum() == pytest.approx(365.25 * 86400.0)
    driving = year.duration_s[year.activity == Activity.DRIVING].sum()
    assert driving == pytest.approx(365.25 / 7.0 * 6 * 8 * 1800.0)
    assert np.all(np.asarray(year.load.charge) > 0.2)


def test_an_unknown_rule_is_refused() -> None:
    with pytest.raises(ScenarioError, match="unknown rule 'smart'"):
        PlannedYears(COMMUTER, "smart")


def test_a_recorded_week_makes_the_years_of_the_week_it_recorded() -> None:
    """Recorded is a week that a rule made: the same losses and energy, but for loads within a minute."""
    years = PlannedYears(COMMUTER, "managed", months=(6,))
    weeks = years.weeks(NCA.law, climate_of("Phoenix"), trip(), CAR)
    ((_, course),) = weeks.parts
    durations_s, _, kelvin, _, charge = course.rows.T
    times_s = np.cumsum(durations_s) - 0.5 * durations_s
    table = {"time_s": times_s, "state_of_charge": charge, "pack_c": kelvin - 273.15}
    whole = weeks.year(CAR)
    again = RecordedWeek.of(table).year(NCA, climate_of("Oslo"), trip(), CAR)
    assert again.duration_s.sum() == pytest.approx(whole.duration_s.sum())
    assert again.driving_kwh == pytest.approx(whole.driving_kwh, rel=0.05)
    assert again.distance_km == pytest.approx(whole.distance_km, rel=0.05)
    lost, expected = (
        sum(sum(each.values()) for each in damage_by_cause(NCA.law, year))
        for year in (again, whole)
    )
    assert lost == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"time_s": [0.0, 3600.0]}, "time_s is not a day"),
        ({"pack_c": [20.0, float("nan")]}, "pack_c is nan"),
        ({"state_of_charge": [0.5, 1.5]}, "state_of_charge is 1.5"),
    ],
)
def test_a_damaged_record_is_refused(changes: dict[str, list[float]], words: str) -> None:
    table = {"time_s": [0.0, 9e4], "state_of_charge": [0.5, 0.4], "pack_c": [20.0, 21.0]}
    with pytest.raises(ScenarioError, match=words):
        RecordedWeek.of({**table, **changes})
    with pytest.raises(ScenarioError, match="columns are"):
        RecordedWeek.of({"time_s": [0.0]})
