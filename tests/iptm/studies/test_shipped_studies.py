"""The studies of the paper, as they are shipped."""

import pytest

from iptm.studies.campaign import plan_campaign
from iptm.studies.run_spec import REPRODUCED_CYCLE
from iptm.studies.study_loading import available_studies, load_study
from iptm_controller.horizon import Horizon

CONVENTIONAL = ("reference_energy", "reference_aging", "reference_energy_aging")


TRIPS = {
    "first_composition": {"comprehensive"},
    "cost_to_go": {"comprehensive", "wltc_class3b", "us06", "udds", "hwfet"},
    "cold_days": {"wltc_class3b", "us06", "udds"},
}
SLOPES = {"cold_days": {"flat", "large"}}


@pytest.mark.parametrize("name", available_studies())
def test_every_study_says_what_it_shows(name: str) -> None:
    study = load_study(name)
    assert study.title
    assert len(study.about.split()) > 8
    assert study.cases
    assert {case.spec.cycle for case in study.cases} == TRIPS.get(name, {REPRODUCED_CYCLE})
    assert {case.spec.slope for case in study.cases} == SLOPES.get(name, {"as_designed"})
    assert {case.spec.duration_s for case in study.cases} == {None}


def test_weights_of_the_paper() -> None:
    cases = load_study("weighting").cases
    by_strategy = {
        name: [case.spec.strategy for case in cases if case.labels["strategy"] == name]
        for name in (*CONVENTIONAL, "energy_aging")
    }
    energy = [strategy.energy_weight_1_j for strategy in by_strategy["reference_energy"]]
    assert energy == [1e-5, 5e-5, 5e-4, 1e-3]
    aging = [strategy.aging_weight for strategy in by_strategy["reference_aging"]]
    assert aging == [1e6, 1e6, 5e7, 1e8], "the repeated value is run as printed"
    for name, ratios in (
        ("reference_energy_aging", [1e11, 1e12, 1e13, 1e14]),
        ("energy_aging", [5e6, 5e10, 5e11, 5e12]),
    ):
        found = [s.aging_weight / s.energy_weight_1_j for s in by_strategy[name]]
        assert found == pytest.approx(ratios)
    for name in CONVENTIONAL:
        assert {s.speed_weight for s in by_strategy[name]} == {0.5}
        assert {s.temperature_weight for s in by_strategy[name]} == {0.1}
    for strategy in by_strategy["reference_energy_aging"]:
        assert 1e-5 <= strategy.energy_weight_1_j <= 1e-3
        assert 1e6 <= strategy.aging_weight <= 1e10
    for case in cases:
        strategy = case.spec.strategy
        value = {
            "lambda_P": strategy.energy_weight_1_j,
            "lambda_Q": strategy.aging_weight,
            "lambda_Q/lambda_P": strategy.aging_weight / max(strategy.energy_weight_1_j, 1e-30),
        }[str(case.labels["weight"])]
        assert case.labels["value"] == pytest.approx(value)


def test_previews_reach_to_the_end_of_every_horizon_unless_they_are_meant_to_be_short() -> None:
    short = set()
    for name in available_studies():
        for case in load_study(name).cases:
            reach_s = case.spec.bridge_settings().preview_length_s
            if reach_s < Horizon.parse(case.spec.horizon).duration_s:
                short.add((name, case.labels["preview"]))
    assert short == {("cost_to_go", "15_s"), ("cost_to_go", "8_s"), ("cost_to_go", "28_s")}


def test_the_cost_to_go_changes_nothing_but_itself() -> None:
    specs = {case.name: case.spec for case in load_study("cost_to_go").cases}
    for trip in TRIPS["cost_to_go"]:
        with_it = specs[f"{trip}/multi_horizon_cost_to_go/perfect"]
        without = specs[f"{trip}/multi_horizon/perfect"]
        assert with_it.strategy.cost_to_go
        assert not without.strategy.cost_to_go
        assert with_it.cycle == without.cycle == trip
        assert with_it.with_strategy(without.strategy) == without


def test_all_of_it_can_be_planned_and_shares_its_runs() -> None:
    campaign = plan_campaign(available_studies())
    cases = campaign.cases
    later = campaign.later_runs()
    runs = len(campaign.keys) + len(later)
    assert runs < len(cases)
    # The weighted strategies of the table repeat runs of the weights; under imperfect previews they do not.
    assert all(run.address.startswith("imperfect_previews/") for run in later)
    assert len(later) == 16
