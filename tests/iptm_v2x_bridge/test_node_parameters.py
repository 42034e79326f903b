from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from iptm_core.declaration import parameter_specs
from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import LeaderSource, PreviewSettings
from iptm_v2x_bridge.bridge import CycleSource, V2xBridge
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters
from iptm_v2x_bridge.prediction.predictor import Knowledge, PredictorName
from iptm_v2x_bridge.road_knowledge import given_rules
from iptm_v2x_bridge.stations.station import Observation


def test_default_gap_is_that_of_the_model() -> None:
    assert BridgeNodeParameters().initial_gap_m == load_parameters().values.gap.initial_gap_m


def test_leader_and_road_are_those_asked_for() -> None:
    route = BridgeNodeParameters(cycle="us06", slope="large").route(22.0)
    assert route.leader.positions_at(0.0) == 22.0
    assert route.name == "us06, slope large"


def test_the_node_drives_the_bridge_by_its_own_parameters() -> None:
    """What the bridge answers depends on the settings of the previews, not on who holds them."""
    settings = PreviewSettings(latency_s=1.0, dropout_probability=0.5, noise_std_m_s=1.0, seed=9)
    parameters = BridgeNodeParameters(cycle="nycc", **asdict(settings))
    source = CycleSource(parameters.route(15.0))
    one, two = V2xBridge(source, parameters), V2xBridge(source, settings)
    for tick in range(50):
        first, second = one.answer(tick * 10**9), two.answer(tick * 10**9)
        assert first.preview.speeds_m_s.tolist() == second.preview.speeds_m_s.tolist()
    assert one.lost == two.lost > 0


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


def test_a_host_that_keeps_the_rules_needs_to_know_them() -> None:
    with pytest.raises(ParameterError, match="speed_limits_km_h"):
        BridgeNodeParameters(host_keeps_rules=True)
    with pytest.raises(ParameterError, match="set_speed_km_h is 0 with leader_source none"):
        BridgeNodeParameters(leader_source=LeaderSource.NONE)
    assert BridgeNodeParameters(leader_source=LeaderSource.NONE, set_speed_km_h=90.0).keeps_rules


def test_what_is_given_of_the_road_bounds_the_prediction() -> None:
    """A leader at 15 m/s, 100 m before a line that opens in 30 s."""
    stands = Knowledge((Observation(0.0, 100.0, 15.0, 0.0),))
    times = np.arange(0.0, 40.0)
    given = {"signals": "204.5:80:30:40"}
    for keeps, farthest_m in ((True, 200.5), (False, np.inf)):
        parameters = BridgeNodeParameters(leader_keeps_rules=keeps, **given)  # type: ignore[arg-type]
        route = parameters.route(15.0)
        predictors = parameters.build_predictors(route, given_rules(parameters, route))
        found = [predictor.predict(stands, times) for predictor in predictors]
        best = next(prediction for prediction in found if prediction is not None)
        assert 150.0 < best.positions_m[29] < farthest_m
        assert (best.predictor is PredictorName.SIGNALS) is keeps


def test_every_number_has_a_range_and_every_name_its_unit() -> None:
    units = {"_m_s": "m/s", "_s": "s", "_m": "m"}
    for spec in parameter_specs(BridgeNodeParameters):
        if isinstance(spec.default, (int, float)) and not isinstance(spec.default, bool):
            assert spec.maximum < float("inf"), spec.name
        ending = next((ending for ending in units if spec.name.endswith(ending)), None)
        if ending is not None:
            assert spec.unit == units[ending], spec.name


def test_heights_of_the_road_are_those_of_messages_or_none() -> None:
    road = replace(RoadLine.test_road(), heights_m=None)
    heights = np.full(road.latitudes_deg.size, 55.0)
    high = replace(road, heights_m=heights)
    assert BridgeNodeParameters().road_of_messages(high).heights_m is None
    compared = BridgeNodeParameters(compare_altitudes=True, height_datum_m=43.0)
    assert compared.road_of_messages(high).height_at_m(500.0) == 98.0
    assert compared.road_of_messages(road).height_at_m(500.0) is None
