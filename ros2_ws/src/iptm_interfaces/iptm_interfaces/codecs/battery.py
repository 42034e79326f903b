"""The pack as seen at its terminals, and the mean powers of one interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import IntervalPowers
from iptm_interfaces.codecs._checks import finite
from iptm_interfaces.codecs.fixed_layout import Numbers
from iptm_interfaces.codecs.named_values import decode_named_values, named_values
from iptm_interfaces.codecs.time import ns_from_s, time_from_s
from iptm_interfaces.message_types import (
    BatteryState,
    JointState,
)
from iptm_interfaces.topics import PACK_FRAME, Topic


@dataclass(frozen=True)
class BatteryReading:
    """Terminal values of the pack and of cells of a coolant channel.

    The cells are the first and the last one, or all of them in the order of the coolant.

    The message holds 32-bit floats: good for plots, not for control. What is not measured is NaN.

    Attributes:
        time_s: trip time.
        pack_voltage_v: terminal voltage.
        pack_current_a: positive when discharging (sign of the paper; the message has the
            opposite sign).
        cell_voltages_v: of the cells.
        cell_temperatures_k: of the cells.
        charge_ah: charge left.
        capacity_ah: capacity at present, aged.
        design_capacity_ah: nominal capacity.
    """

    time_s: float
    pack_voltage_v: float
    pack_current_a: float
    cell_voltages_v: tuple[float, ...]
    cell_temperatures_k: tuple[float, ...]
    charge_ah: float = math.nan
    capacity_ah: float = math.nan
    design_capacity_ah: float = math.nan


@named_values(Topic.PLANT_POWERS)
def encode_powers(time_s: float, powers: IntervalPowers) -> Numbers:
    """Return the mean powers of the interval that ended at a time (W)."""
    return ns_from_s(time_s), tuple(vars(powers).values())


def decode_powers(message: JointState) -> IntervalPowers:
    """Return the mean powers of the interval that ended at the stamp (W).

    Raises:
        MessageError: a power is missing or not finite.
    """
    return IntervalPowers(*decode_named_values(Topic.PLANT_POWERS, message))


def encode_battery(reading: BatteryReading) -> BatteryState:
    """Return the pack's terminal values, the current with the sign of ROS."""
    current_a = -float(reading.pack_current_a)
    temperatures_c = [float(t) - CELSIUS_ZERO_K for t in reading.cell_temperatures_k]
    message = BatteryState(
        voltage=float(reading.pack_voltage_v),
        current=current_a,
        temperature=sum(temperatures_c) / len(temperatures_c),
        charge=float(reading.charge_ah),
        capacity=float(reading.capacity_ah),
        design_capacity=float(reading.design_capacity_ah),
        percentage=float(reading.charge_ah / reading.capacity_ah),
        power_supply_status=_supply_status(current_a),
        power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION,
        present=True,
        cell_voltage=[float(v) for v in reading.cell_voltages_v],
        cell_temperature=temperatures_c,
        location=PACK_FRAME,
    )
    message.header.stamp = time_from_s(reading.time_s)
    message.header.frame_id = PACK_FRAME
    return message


def decode_charge(message: BatteryState) -> float:
    """Return the state of charge, 0 to 1; NaN where it was not measured.

    Raises:
        MessageError: it is infinite.
    """
    charge = float(message.percentage)
    return charge if math.isnan(charge) else finite(Topic.PLANT_BATTERY, "percentage", charge)


def _supply_status(ros_current_a: float) -> int:
    if ros_current_a < 0.0:
        return int(BatteryState.POWER_SUPPLY_STATUS_DISCHARGING)
    if ros_current_a > 0.0:
        return int(BatteryState.POWER_SUPPLY_STATUS_CHARGING)
    return int(BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING)
