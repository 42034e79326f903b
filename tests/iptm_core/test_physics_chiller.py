"""The chiller map and the gate that switches it off with the compressor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.parameters import available_parameter_sets, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.chiller import (
    ChillerLine,
    air_mass_flow_kg_s,
    chiller_line,
    compressor_gate,
    largest_useful_power_w,
)

CALIBRATED = load_parameters().values
PUBLISHED = load_parameters("published_chiller").values


def line(values: ModelParameters, power_w: float, speed_m_s: float = 10.0) -> ChillerLine:
    return chiller_line(power_w, speed_m_s, values.chiller, values.cooling, values.environment)


def test_the_air_flow_takes_its_speed_in_km_h() -> None:
    # 10 m/s = 36 km/h: 0.07065 + 0.001683 * 36 = 0.131238 kg/s
    assert air_mass_flow_kg_s(10.0, CALIBRATED.chiller) == pytest.approx(0.131238, rel=1e-12)
    assert air_mass_flow_kg_s(0.0, CALIBRATED.chiller) == 0.07065
    # the public model of the same system has 0.00606 per m/s
    slope = air_mass_flow_kg_s(1.0, CALIBRATED.chiller) - 0.07065
    assert slope == pytest.approx(0.00606, rel=5e-4)


def test_the_gate_by_hand() -> None:
    gate = {power: compressor_gate(power, CALIBRATED.chiller) for power in (0.0, 500.0, 1000.0)}
    assert gate[0.0] == 0.0
    assert gate[500.0] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-14)
    assert gate[1000.0] == pytest.approx(1.0 - math.exp(-4.0), rel=1e-14)
    assert compressor_gate(4500.0, CALIBRATED.chiller) == pytest.approx(1.0, abs=1e-15)


def test_the_calibrated_map_by_hand() -> None:
    """1000 W, 10 m/s, 35 degC air and 30 degC coolant, term by term."""
    cooling = (
        2.2 * 1000.0
        - 1.6e-4 * 1e6
        + 4.1710995 * 35.0 * 0.131238
        - 1396.3143182
        + (-1579.2336767 + 11348.8506087 * 0.144) * 30.0
    )
    gated = (1.0 - math.exp(-4.0)) * cooling
    assert line(CALIBRATED, 1000.0).cooling_rate_w(303.15) == pytest.approx(gated, rel=1e-10)
    assert gated == pytest.approx(2270.0, rel=1e-2)


@given(
    power=st.floats(100.0, 4400.0),
    speed=st.floats(0.0, 37.0),
    outlet=st.floats(298.15, 313.15),
)
def test_more_power_more_air_and_warmer_coolant_cool_more(
    power: float, speed: float, outlet: float
) -> None:
    """Holds for the calibrated set over the whole operating range."""
    here = line(CALIBRATED, power, speed).cooling_rate_w(outlet)
    assert line(CALIBRATED, power + 50.0, speed).cooling_rate_w(outlet) > here
    assert line(CALIBRATED, power, speed + 0.5).cooling_rate_w(outlet) > here
    assert line(CALIBRATED, power, speed).cooling_rate_w(outlet + 0.5) > here


def test_beyond_the_vertex_of_the_published_map_more_power_is_of_no_use() -> None:
    """xi_1 + 2 xi_2 P = 0 near 3023 W; the fit would cool less beyond."""
    peak = 1.860278870 / (2.0 * 0.000307654)
    assert peak == pytest.approx(3023.3, abs=0.1)
    assert largest_useful_power_w(PUBLISHED.chiller, PUBLISHED.limits) == pytest.approx(peak)
    assert largest_useful_power_w(CALIBRATED.chiller, CALIBRATED.limits) == 4500.0
    at_peak, beyond = (line(PUBLISHED, p).cooling_rate_w(303.15) for p in (peak, peak + 500.0))
    assert beyond == pytest.approx(at_peak, rel=1e-9)


@pytest.mark.parametrize("ambient_c", [26.0, 30.0, 35.0, 39.5])
@pytest.mark.parametrize("speed_m_s", [0.0, 15.0, 37.5])
@pytest.mark.parametrize("outlet_k", [263.15, 283.15, 298.15, 313.15, 333.15])
def test_more_power_never_cools_less_and_never_heats(
    ambient_c: float, speed_m_s: float, outlet_k: float
) -> None:
    """All shipped sets over the whole range of the compressor."""
    power = np.linspace(0.0, 4500.0, 901)
    ambient = {"environment.ambient_temperature_k": ambient_c + 273.15}
    for name in available_parameter_sets():
        values = load_parameters(name, ambient).values
        rate = line(values, power, speed_m_s).cooling_rate_w(outlet_k)
        assert rate[0] == 0.0
        assert np.diff(rate).min() >= -1e-9, name
