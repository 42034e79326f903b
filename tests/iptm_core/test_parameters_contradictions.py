"""Parameters that are nonsense together, wrong overrides, and sets that do not exist."""

from __future__ import annotations

from typing import Any

import pytest

from iptm_core.errors import ParameterError
from iptm_core.parameters import load_parameters


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"limits.max_speed_m_s": 5.0, "limits.min_speed_m_s": 5.0},
            "limits.min_speed_m_s is 5.0; allowed: ",
        ),
        ({"limits.min_compressor_power_w": 4500.0}, "below limits.max_compressor_power_w = 4500.0"),
        ({"limits.min_temperature_k": 314.0}, "below limits.max_temperature_k = 313.15"),
        ({"gap.standstill_gap_m": 30.0, "gap.max_gap_m": 20.0}, "below gap.max_gap_m = 20.0"),
        ({"gap.initial_gap_m": 4.0}, "from gap.standstill_gap_m to gap.max_gap_m, 5.0 to 120.0 m"),
        ({"gap.initial_gap_m": 130.0}, "gap.initial_gap_m is 130.0; allowed: "),
        (
            {"brakes.max_deceleration_m_s2": 1.0},
            "brakes.max_deceleration_m_s2 is 1.0; allowed: from",
        ),
        ({"charge.voltage_share_30": 1.2}, "voltage_share_40 is 1.0; allowed: at least"),
        ({"charge.initial_charge": 0.05}, "charge.min_charge is 0.1; allowed: below"),
        (
            {"regeneration.blend_start_m_s": 3.0},
            "regeneration.blend_start_m_s is 3.0; allowed: below",
        ),
        ({"cooling.convective_coefficient_w_k": 30.0}, "of one coolant channel, 29.97 W/K"),
        ({"cooling.coolant_mass_flow_kg_s": 0.002}, "h/C_f = 1.17742; allowed: below 1"),
        ({"cooling.coolant_mass_flow_kg_s": 0.13}, "flow that they were fitted at"),
        (
            {
                "cell.resistance_temperature_coefficient_1_k": -0.03,
                "environment.initial_cell_temperature_k": 330.0,
            },
            "vanish at environment.initial_cell_temperature_k = 330.0",
        ),
        ({"pack.open_circuit_voltage_v": 11.0}, "gives an entropic voltage of 11.4"),
    ],
)
def test_parameters_that_contradict_each_other(overrides: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(overrides=overrides)
    assert message in str(caught.value)
    assert "paper_calibrated.yaml with overrides: " in str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"gap.max_gap": 80.0},
            "overrides: unknown parameter 'gap.max_gap'; did you mean 'gap.max_gap_m'?",
        ),
        ({"zzz": 1.0}, "overrides: unknown parameter 'zzz'; allowed: body.mass_kg, "),
        (
            {"gap.max_gap_m": "80"},
            "overrides: gap.max_gap_m is '80', no number; allowed: 20 to 1000 m",
        ),
        (
            {"pack.modules": 1.5},
            "overrides: pack.modules is 1.5; allowed: whole numbers from 1 to 1000",
        ),
        (
            [("gap.max_gap_m", 80.0)],
            "overrides holds [('gap.max_gap_m', 80.0)]; allowed: a mapping",
        ),
    ],
)
def test_wrong_overrides(overrides: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(overrides=overrides)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "textbook",
            "parameter set is 'textbook', no shipped set and no file; did you mean 'textbook_cell'?",
        ),
        ("", "parameter set is ''; allowed: a path, or a shipped set: paper_calibrated, "),
        (7, "parameter set is 7; allowed: a path"),
        ("nowhere.yaml", "nowhere.yaml: no such file"),
        ("x" * 300, "no shipped set and no file; allowed: paper_calibrated, "),
        ("y" * 300 + ".yaml", "cannot be read: "),
    ],
)
def test_sets_that_do_not_exist(name: Any, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameters(name)
    assert message in str(caught.value)
