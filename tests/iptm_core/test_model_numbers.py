"""Numbers of a model as data: which cars share code."""

from __future__ import annotations

import pytest

from iptm_core.parameters import load_parameters
from iptm_core.physics.model_numbers import SymbolicModel, numbers_of, shape_of


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("body.mass_kg", 1851.0),
        ("body.drag_coefficient", 0.21),
        ("body.rolling_resistance", 0.011),
        ("powertrain.wheel_radius_m", 0.35),
        ("powertrain.final_drive_ratio", 9.1),
        ("pack.parallel", 37),
        ("pack.cells_per_channel", 9),
        ("cell.nominal_resistance_ohm", 0.0031),
        ("cell.nominal_capacity_ah", 5.2),
        ("cell.heat_capacity_j_k", 71.0),
        ("cooling.convective_coefficient_w_k", 0.41),
        ("environment.ambient_temperature_k", 300.0),
        ("gap.time_headway_s", 1.3),
        ("limits.max_compressor_power_w", 2500.0),
    ],
)
def test_another_number_is_another_vector_of_the_same_shape(key: str, value: float) -> None:
    usual, other = load_parameters().values, load_parameters(overrides={key: value}).values
    shape = shape_of(usual)
    assert shape_of(other) == shape
    assert shape_of(shape) == shape
    numbers, others = numbers_of(usual, shape), numbers_of(other, shape)
    assert numbers.shape == others.shape == (SymbolicModel.of(shape).numbers.numel(),)
    assert value in others
    assert value not in numbers


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cooling.air_exchange_w_k", 3.0),
        ("gap.desired_time_headway_s", 1.5),
        ("limits.max_heater_power_w", 2000.0),
        ("aging.charging_rate_factor", -1.0),
        ("cell.resistance_exponent_1_k", 0.02),
    ],
)
def test_an_effect_that_the_car_does_not_have_is_another_shape(key: str, value: float) -> None:
    usual = load_parameters().values
    assert shape_of(load_parameters(overrides={key: value}).values) != shape_of(usual)
