"""Parameters of the bridge node that do not fit together are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import LeaderSource
from iptm_v2x_bridge.node_answers import BridgeNodeParameters
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, Observation, PredictorName
from iptm_v2x_bridge.rules_of_the_road import given_rules


def test_default_gap_is_that_of_the_model() -> None:
    assert BridgeNodeParameters().initial_gap_m == load_parameters().values.gap.initial_gap_m


def test_leader_and_road_are_those_asked_for() -> None:
    route = BridgeNodeParameters(cycle="us06", slope="large").route(22.0)
    assert route.leader.positions_at(0.0) == 22.0
    assert route.name == "us06, slope large"


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"signals": "1100:80:12"}, "signals"),
        ({"signals": "1100:80:12:90"}, "open_for_s"),
        ({"signals": "1100:80:12:40, 900:80:12:40"}, "increasing"),
        ({"speed_limits_km_h": "fast"}, "speed_limits_km_h"),
    ],
)
def test_rules_that_cannot_be_read_are_refused(given: dict[str, str], word: str) -> None:
    parameters = BridgeNodeParameters(**given)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=word):
        given_rules(parameters, parameters.route(15.0))


def test_a_ego_that_keeps_the_rules_needs_to_know_them() -> None:
    with pytest.raises(ParameterError, match="speed_limits_km_h"):
        BridgeNodeParameters(ego_keeps_rules=True)
    with pytest.raises(ParameterError, match="set_speed_km_h is 0 with leader_source none"):
        BridgeNodeParameters(leader_source=LeaderSource.NONE)
    assert BridgeNodeParameters(leader_source=LeaderSource.NONE, set_speed_km_h=90.0).keeps_rules


def test_what_is_given_of_the_road_bounds_the_prediction() -> None:
    """A leader at 15 m/s, 100 m before a line that opens in 30 s."""
    stands = LeaderTrack((Observation(0.0, 100.0, 15.0, 0.0),))
    times = np.arange(0.0, 40.0)
    given = {"signals": "204.5:80:30:40"}
    for keeps, farthest_m in ((True, 200.5), (False, np.inf)):
        parameters = BridgeNodeParameters(leader_keeps_rules=keeps, **given)  # type: ignore[arg-type]
        route = parameters.route(15.0)
        predictors = parameters.build_predictors(route, given_rules(parameters, route))
        found = [(predictor.name, predictor.predict(stands, times)) for predictor in predictors]
        name, best = next(entry for entry in found if entry[1] is not None)
        assert best is not None
        assert 150.0 < best.positions_m[29] < farthest_m
        assert (name is PredictorName.SIGNALS) is keeps


def test_heights_of_the_road_are_those_of_messages_or_none() -> None:
    road = replace(RoadLine.test_road(), heights_m=None)
    heights = np.full(road.latitudes_deg.size, 55.0)
    high = replace(road, heights_m=heights)
    assert BridgeNodeParameters().road_of_messages(high).heights_m is None
    compared = BridgeNodeParameters(compare_altitudes=True, height_datum_m=43.0)
    assert compared.road_of_messages(high).height_at_m(500.0) == 98.0
    assert compared.road_of_messages(road).height_at_m(500.0) is None
