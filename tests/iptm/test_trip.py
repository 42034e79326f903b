"""A trip as data: one name per setting, in one group, as a parameter of the nodes that need it."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import pytest
import yaml

import iptm
from iptm.runner.composition import node_settings
from iptm.trip import Trip
from iptm.trip_settings import GROUPS, HOME, NODE_SETTINGS, SPECS
from iptm_controller.strategy import STRATEGIES, Strategy
from iptm_core.declaration import parameter_specs
from iptm_core.errors import IptmError, ScenarioError


def test_a_setting_has_one_name_and_one_group() -> None:
    names = {spec.name for group in GROUPS.values() for spec in parameter_specs(group)}
    assert names | {"faults"} == set(HOME)
    content = yaml.safe_load(iptm.trip_text(Trip()))
    written = Counter(name for group in GROUPS for name in content[group])
    assert set(written.values()) == {1}


def test_the_controller_takes_what_it_shares_with_the_vehicle_from_there() -> None:
    trip = Trip.of(gap_accuracy_m=1.5)
    assert trip.vehicle.gap_accuracy_m == trip.controller.gap_accuracy_m == 1.5
    assert node_settings(trip, "controller")["gap_accuracy_m"] == 1.5


@pytest.mark.parametrize("node", NODE_SETTINGS)
def test_what_a_node_is_told_is_a_setting_of_the_trip(node: str) -> None:
    names = [spec.name for group in NODE_SETTINGS[node] for spec in parameter_specs(group)]
    assert set(names) <= set(SPECS)
    trip = Trip.of("us06", latency_s=0.5, deadline_ms=50, overrides={"body.mass_kg": 1600})
    told = node_settings(trip, node)
    for name, expected in (
        ("cycle", "us06"), ("latency_s", 0.5), ("deadline_ms", 50.0), ("overrides", "body.mass_kg=1600.0")
    ):  # fmt: skip
        assert told.get(name, expected) == expected


def test_the_model_of_the_controller_may_differ_from_the_vehicle() -> None:
    trip = Trip.of(overrides={"body.mass_kg": 1600}, controller_overrides={"body.mass_kg": 1500})
    assert trip.parameters.body.mass_kg == 1600.0
    assert trip.controller_parameters.body.mass_kg == 1500.0
    assert node_settings(trip, "plant")["overrides"] == "body.mass_kg=1600.0"
    assert node_settings(trip, "controller")["overrides"] == "body.mass_kg=1500.0"


@pytest.mark.parametrize(
    ("horizon", "latency_s", "length_s"),
    [("3x1+5x5", 0.0, 60.0), ("15x1", 0.0, 60.0), ("60x1", 0.5, 91.0)],
)
def test_a_preview_reaches_beyond_the_horizon(
    horizon: str, latency_s: float, length_s: float
) -> None:
    trip = Trip.of(horizon=horizon, latency_s=latency_s)
    assert trip.preview.preview_length_s == length_s
    assert node_settings(trip, "v2x_bridge")["preview_length_s"] == length_s
    assert trip.changed(preview_length_s=20.0).preview.preview_length_s == 20.0


def test_weights_of_a_strategy_are_settings() -> None:
    trip = Trip.of(strategy={"base": "aging", "aging_weight": 2e9})
    assert trip.controller.strategy == "aging"
    assert trip.controller.aging_weight == 2e9
    mine = Strategy("mine", speed_weight=1.0, cost_to_go=True, reference_temperature_k=300.0)
    found = Trip.of(strategy=mine).controller.weighted_strategy()
    assert found.weights == mine.weights
    assert (found.cost_to_go, found.reference_temperature_k) == (True, 300.0)


@pytest.mark.parametrize("name", STRATEGIES)
def test_a_shipped_strategy_is_but_a_name(name: str) -> None:
    trip = Trip.of(strategy=STRATEGIES[name])
    assert trip == Trip.of(strategy=name)
    assert trip.controller.weighted_strategy() == STRATEGIES[name]


def test_none_takes_the_default() -> None:
    assert Trip.of(duration_s=None, preview_length_s=None, faults=None) == Trip.of()


def test_the_heading_states_what_is_no_default() -> None:
    trip = Trip.of("nycc", duration_s=60.0, latency_s=0.5, overrides={"body.mass_kg": 1600})
    assert trip.heading.startswith("nycc, slope as_designed, 60 s, 3x1+5x5, aging_cost_to_go, ")
    assert trip.heading.endswith("latency_s=0.5, overrides=body.mass_kg=1600.0")
    assert Trip.of(horizon="3*1").controller.horizon == "3x1"


def test_the_other_run_of_a_comparison_is_sound_and_drives_the_same_road() -> None:
    trip = Trip.of(
        "nycc", leader_source="cam", latency_s=0.5, strategy={"base": "aging", "aging_weight": 1.0},
        thermal_model="full_channel", horizon="60x1",
    )  # fmt: skip
    other = trip.against("reference")
    assert other.controller.weighted_strategy() == STRATEGIES["reference"]
    assert other.controller.horizon == "15x1"
    assert other.leader.leader_source == "cycle"
    assert other.preview == trip.preview
    assert other.vehicle == trip.vehicle
    assert other.options.trip_duration_s == trip.route.duration_s
    assert not math.isinf(other.options.trip_duration_s)
    assert math.isinf(Trip.of("nycc", value_beyond_trip=True).options.trip_duration_s)
    assert Trip.of("nycc", acc_time_headway_s=1.1).options.production.acc_time_headway_s == 1.1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"strateg": "aging"}, "unknown key 'strateg'; did you mean 'strategy'"),
        ({"horizon": 15}, "horizon is 15"),
        ({"faults": 3}, "faults is 3; allowed: a list"),
        ({"faults": [3]}, r"faults is \[3\]; allowed: a list"),
        ({"leader_source": "none"}, "speed_limits_km_h is empty and set_speed_km_h is 0"),
        ({"overrides": {"body.mass_kg": True}}, "body.mass_kg is True; allowed: a number"),
    ],
)
def test_a_wrong_setting_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(IptmError, match=message):
        Trip.of(**settings)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"over": "radio"}, "over: unknown value 'radio'"),
        ({"bag": "here"}, "bag is 'here' in memory; allowed: over ROS 2"),
        ({"over": "ros", "controller": object()}, "controller is given over ROS 2"),
    ],
)
def test_what_only_one_way_of_driving_can_do(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        iptm.drive(Trip.of("us06", duration_s=5.0), **arguments)


def test_a_leader_that_is_heard_needs_nodes() -> None:
    with pytest.raises(ScenarioError, match="leader_source is cam; allowed in memory: cycle, none"):
        iptm.drive(Trip.of("us06", leader_source="cam"))


def test_messages_that_are_not_all_verified_never_count_as_authenticated() -> None:
    assert Trip.of("us06").vehicle.authenticated_radio
    by_radio = Trip.of("us06", leader_source="cam", authenticated_radio=True)
    assert not by_radio.vehicle.authenticated_radio
    assert not by_radio.settings["authenticated_radio"]
