from __future__ import annotations

import pytest

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters
from iptm_interfaces.parameters import parameter_specs
from iptm_v2x_bridge.bridge import BridgeSettings, PreviewMode
from iptm_v2x_bridge.node import BridgeParameters


def test_defaults_of_the_node_are_those_of_the_bridge() -> None:
    assert BridgeParameters().settings() == BridgeSettings()


def test_default_gap_is_that_of_the_model() -> None:
    assert BridgeParameters().initial_gap_m == load_parameters().values.gap.initial_gap_m


def test_every_parameter_reaches_the_bridge() -> None:
    settings = BridgeParameters(
        preview_mode="none",
        preview_length_s=120.0,
        preview_step_s=2.0,
        latency_s=0.5,
        dropout_probability=0.1,
        dropout_burst=4,
        noise_std_m_s=0.7,
        noise_correlation_s=8.0,
        seed=99,
    ).settings()
    faults = settings.imperfections
    assert settings.mode is PreviewMode.NONE
    assert (settings.grid.length_s, settings.grid.step_s) == (120.0, 2.0)
    assert (faults.latency_s, faults.dropout_probability, faults.dropout_burst) == (0.5, 0.1, 4)
    assert (faults.noise_std_m_s, faults.noise_correlation_s, faults.seed) == (0.7, 8.0, 99)


def test_step_longer_than_the_preview_is_refused() -> None:
    with pytest.raises(ParameterError, match="preview step"):
        BridgeParameters(preview_length_s=2.0, preview_step_s=3.0).settings()


def test_every_number_has_a_range_and_every_name_its_unit() -> None:
    units = {"_s": "s", "_m": "m", "_m_s": "m/s"}
    for spec in parameter_specs(BridgeParameters):
        if isinstance(spec.default, (int, float)):
            assert spec.maximum < float("inf"), spec.name
        for ending, unit in units.items():
            if spec.name.endswith(ending) and not (ending == "_s" and spec.name.endswith("_m_s")):
                assert spec.unit == unit, spec.name
