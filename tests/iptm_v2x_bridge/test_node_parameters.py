from __future__ import annotations

from dataclasses import asdict

from iptm_core.declaration import parameter_specs
from iptm_core.parameters import load_parameters
from iptm_core.settings import PreviewSettings
from iptm_v2x_bridge.bridge import V2xBridge
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters


def test_default_gap_is_that_of_the_model() -> None:
    assert BridgeNodeParameters().initial_gap_m == load_parameters().values.gap.initial_gap_m


def test_leader_and_road_are_those_asked_for() -> None:
    source = BridgeNodeParameters(cycle="us06", slope="large", initial_gap_m=22.0).build_source()
    assert source.leader_at(0).position_m == 22.0
    assert source.route.name == "us06, slope large"


def test_the_node_drives_the_bridge_by_its_own_parameters() -> None:
    """What the bridge answers depends on the settings of the previews, not on who holds them."""
    settings = PreviewSettings(latency_s=1.0, dropout_probability=0.5, noise_std_m_s=1.0, seed=9)
    parameters = BridgeNodeParameters(cycle="nycc", **asdict(settings))
    source = parameters.build_source()
    one, two = V2xBridge(source, parameters), V2xBridge(source, settings)
    for tick in range(50):
        first, second = one.answer(tick * 10**9), two.answer(tick * 10**9)
        assert first.preview.speeds_m_s.tolist() == second.preview.speeds_m_s.tolist()
    assert one.lost == two.lost > 0


def test_every_number_has_a_range_and_every_name_its_unit() -> None:
    units = {"_m_s": "m/s", "_s": "s", "_m": "m"}
    for spec in parameter_specs(BridgeNodeParameters):
        if isinstance(spec.default, (int, float)) and not isinstance(spec.default, bool):
            assert spec.maximum < float("inf"), spec.name
        ending = next((ending for ending in units if spec.name.endswith(ending)), None)
        if ending is not None:
            assert spec.unit == units[ending], spec.name
