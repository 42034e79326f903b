"""One row of the page: the messages of one stamp as plain numbers, and what is drawn ahead of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from iptm_core.errors import MessageError
from iptm_core.parameters import ModelParameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.routes.route import heights
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.codecs import (
    decode_decision_record,
    decode_leader,
    decode_leader_preview,
    decode_observation,
    decode_plan,
    decode_slope,
    s_from_ns,
)
from iptm_ros.topics import TOPICS, Topic

ROW_TOPICS = (Topic.PLANT_STATE, Topic.LEADER, Topic.SOLVE)
"""Topics of which a row is made; what a foreign suite does not publish stays empty."""

AHEAD_TOPICS = (Topic.PLAN, Topic.LEADER_PREVIEW)
"""Topics of what is drawn ahead of the newest row."""


PAGE_COLUMNS: Mapping[str, str] = MappingProxyType(
    {
        "time_s": "trip time",
        "position_m": "of the ego vehicle along the road",
        "speed_m_s": "of the ego vehicle",
        "leader_position_m": "rear bumper of the leader",
        "leader_speed_m_s": "of the leader",
        "gap_m": "distance to the leader",
        "min_gap_m": "its lower limit s_min at these speeds",
        "traction_power_w": "mean over the interval that ended now, as the other powers",
        "battery_power_w": "positive when drawn from the pack",
        "compressor_power_w": "drawn by the compressor",
        "chiller_heat_w": "positive when cooling",
        "cell_1_temperature_c": "first cell of a coolant channel",
        "cell_n_temperature_c": "last cell of a coolant channel",
        "coolant_inlet_temperature_c": "coolant entering the pack",
        "coolant_outlet_temperature_c": "coolant leaving the pack",
        "capacity_loss": "of both cells together, since they were new, as a fraction of nominal",
        "cell_1_capacity_loss": "of the first cell",
        "cell_n_capacity_loss": "of the last cell",
        "state_of_charge": "charge left in the pack, as a fraction of its present capacity",
        "service_braking_s": "time for which the safety monitor braked in the interval that ended now",
        "command_source": "number of CommandSource of the interval that ended now",
        "status_code": "number of SolveStatus",
        "solve_time_s": "processor time of the solve",
        "iterations": "of the solver",
        "fallback_rung": "number of Rung",
        "limiter_active": "1 where the last limiter changed the command",
        "preview_age_s": "age of the preview in use",
    }
)
"""Columns of a row, the numbers that the page shows of one instant, with what they mean; NaN is not known."""


def page_row(
    stamp_ns: int, messages: Mapping[Topic, bytes], parameters: ModelParameters | None
) -> tuple[list[float], list[str]]:
    """Decode the messages of one stamp.

    Returns:
        The row, and a sentence for every message that breaks its promise; its values are left out.
    """
    found: dict[str, float] = {}
    faults: list[str] = []

    def take(topic: Topic, read: Callable[[Any], Mapping[str, float]]) -> None:
        if topic in messages:
            try:
                found.update(read(_message(topic, messages[topic])))
            except MessageError as error:
                faults.append(str(error))

    take(Topic.PLANT_STATE, _state)
    take(Topic.LEADER, _leader)
    take(Topic.SOLVE, _decision)
    if "position_m" in found and "leader_position_m" in found:
        found["gap_m"] = found["leader_position_m"] - found["position_m"]
        if parameters is not None:
            found["min_gap_m"] = minimum_gap_m(
                found["speed_m_s"], found["leader_speed_m_s"], parameters.gap, parameters.limits
            )
    found["time_s"] = s_from_ns(stamp_ns)
    return [float(found.get(name, math.nan)) for name in PAGE_COLUMNS], faults


def _state(message: Any) -> dict[str, float]:
    observed = decode_observation(message)
    state = observed.state
    kelvin = {
        "cell_1": state.cell_1_temperature_k,
        "cell_n": state.cell_n_temperature_k,
        "coolant_inlet": observed.coolant_inlet_temperature_k,
        "coolant_outlet": observed.coolant_outlet_temperature_k,
    }
    return {
        **vars(state),
        **vars(observed.powers),
        **{f"{name}_temperature_c": value - CELSIUS_ZERO_K for name, value in kelvin.items()},
        "state_of_charge": float(np.float32(state.state_of_charge)),  # as trajectories hold it
        "capacity_loss": state.cell_1_capacity_loss + state.cell_n_capacity_loss,
        "service_braking_s": observed.safety.service_braking_s,
        "command_source": observed.safety.command_source,
    }


def _leader(message: Any) -> dict[str, float]:
    leader = decode_leader(message)
    return {"leader_position_m": leader.position_m, "leader_speed_m_s": leader.speed_m_s}


def _decision(message: Any) -> dict[str, float]:
    record = decode_decision_record(message)
    return {
        "status_code": record.status,
        "solve_time_s": record.solve_time_s,
        "iterations": record.iterations,
        "fallback_rung": record.rung,
        "limiter_active": record.limiter_active,
        "preview_age_s": record.preview_age_s,
    }


def plan_ahead(messages: Mapping[Topic, bytes]) -> dict[str, list[float]]:
    """Return the plan as the page draws it; empty without one.

    The gap ahead is that to the leader's preview, as far as this reaches; the smallest gap ahead is that to a
    leader behind it by its bounds, where it has any.
    """
    if Topic.PLAN not in messages:
        return {}
    _, plan = decode_plan(_message(Topic.PLAN, messages[Topic.PLAN]))
    if not plan.times_s.size:
        return {}
    gaps_m = smallest_m = np.full(plan.times_s.shape, math.nan)
    if Topic.LEADER_PREVIEW in messages:
        _, preview = decode_leader_preview(
            _message(Topic.LEADER_PREVIEW, messages[Topic.LEADER_PREVIEW])
        )
        if preview.times_s.size:
            leader_m = np.interp(plan.times_s, preview.times_s, preview.positions_m)
            known = plan.times_s <= preview.times_s[-1]
            gaps_m = np.where(known, leader_m - plan.positions_m, math.nan)
            if preview.bounds_m.size:
                behind_m = np.interp(plan.times_s, preview.times_s, preview.bounds_m)
                smallest_m = gaps_m - behind_m
    return {
        "time_s": plan.times_s.tolist(),
        "speed_m_s": plan.speeds_m_s.tolist(),
        "gap_m": gaps_m.tolist(),
        "smallest_gap_m": smallest_m.tolist(),
        "cell_1_temperature_c": (plan.cell_1_temperatures_k - CELSIUS_ZERO_K).tolist(),
        "cell_n_temperature_c": (plan.cell_n_temperatures_k - CELSIUS_ZERO_K).tolist(),
        "compressor_power_w": plan.compressor_powers_w.tolist(),
    }


def road_height(data: bytes) -> dict[str, list[float]]:
    """Return the height of the road over position, from the slope; 0 at the start of the trip."""
    position_m, height_m = heights(decode_slope(_message(Topic.SLOPE, data)))
    return {"position_m": position_m.tolist(), "height_m": height_m.tolist()}


def _message(topic: Topic, data: bytes) -> Any:
    return deserialize_message(data, TOPICS[topic].message_type)
