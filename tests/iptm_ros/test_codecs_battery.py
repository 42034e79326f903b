from __future__ import annotations

import math

import pytest
from sensor_msgs.msg import BatteryState

from iptm_core.state import BatteryReading
from iptm_ros.codecs import encode_battery

READING = BatteryReading(
    time_s=5.0,
    pack_voltage_v=345.5,
    pack_current_a=40.25,
    cell_voltages_v=(3.5, 3.25),
    cell_temperatures_k=(300.0, 303.0),
    charge_ah=30.0,
    capacity_ah=60.0,
    design_capacity_ah=62.5,
)


def test_discharging_is_negative_on_the_wire_and_positive_inside() -> None:
    message = encode_battery(READING)
    assert message.current == -40.25
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING


@pytest.mark.parametrize(
    ("current_a", "status"),
    [
        (-3.0, BatteryState.POWER_SUPPLY_STATUS_CHARGING),
        (0.0, BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING),
    ],
)
def test_status_follows_the_current(current_a: float, status: int) -> None:
    reading = BatteryReading(0.0, 350.0, current_a, (3.6, 3.6), (300.0, 300.0))
    assert encode_battery(reading).power_supply_status == status


def test_values_are_those_of_ros_in_single_precision() -> None:
    message = encode_battery(READING)
    assert (message.header.stamp.sec, message.header.frame_id) == (5, "battery_pack")
    assert message.voltage == READING.pack_voltage_v
    assert tuple(message.cell_voltage) == READING.cell_voltages_v
    assert list(message.cell_temperature) == pytest.approx([26.85, 29.85], abs=1e-5)
    assert message.temperature == pytest.approx(28.35, abs=1e-5)
    assert (message.charge, message.capacity, message.percentage) == (30.0, 60.0, 0.5)


def test_unmeasured_values_are_nan_as_ros_defines() -> None:
    message = encode_battery(BatteryReading(0.0, 350.0, 1.0, (3.6, 3.6), (300.0, 300.0)))
    assert math.isnan(message.charge)
    assert math.isnan(message.percentage)
