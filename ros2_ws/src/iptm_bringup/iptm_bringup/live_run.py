"""Puts a run together from what the runner heard itself, without the bag.

This is the second, independent way from the nodes to the figures (ROS decodes the messages here, the
bag's own reader there). Both must agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iptm_bringup.monitor import messages_by_stamp
from iptm_core.errors import MessageError
from iptm_core.trajectory import Trajectory
from iptm_interfaces.codecs import (
    SolveReport,
    decode_leader,
    decode_powers,
    decode_solve_report,
    decode_temperature,
    decode_vehicle_state,
    s_from_ns,
)
from iptm_interfaces.topics import Topic
from iptm_recording.trajectory_reader import SolveSeries

_STATE = (
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_POWERS,
    Topic.PLANT_CAPACITY_LOSS,
)
_COOLANT = {
    Topic.PLANT_COOLANT_INLET_TEMPERATURE: "coolant_inlet_temperature_k",
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE: "coolant_outlet_temperature_k",
}
_TOPICS = (*_STATE, *_COOLANT, Topic.LEADER)

Recorded = Mapping[Topic, Sequence[bytes]]


@dataclass(frozen=True, eq=False)
class LiveRun:
    """A run as the runner heard it.

    Attributes:
        trajectory: one row per tick of which every message was heard.
        solves: one row per decision.
        incomplete_ticks: ticks between the first and the last complete one that lack a message.
    """

    trajectory: Trajectory
    solves: SolveSeries
    incomplete_ticks: int


def live_run(recorded: Recorded) -> LiveRun:
    """Decode what the monitor kept.

    Args:
        recorded: bytes by topic.

    Raises:
        MessageError: no tick was heard completely, or a message breaks its promise.
    """
    found = {topic: messages_by_stamp(topic, recorded[topic]) for topic in _TOPICS}
    stamps = sorted(set().union(*found.values()))
    complete = [s for s in stamps if all(s in messages for messages in found.values())]
    if not complete:
        raise MessageError("the runner heard no tick completely")
    rows = [
        _row({topic: messages[stamp] for topic, messages in found.items()}) for stamp in complete
    ]
    inside = [stamp for stamp in stamps if complete[0] < stamp < complete[-1]]
    return LiveRun(
        trajectory=Trajectory.from_arrays({key: [row[key] for row in rows] for key in rows[0]}),
        solves=_solves(recorded[Topic.SOLVE]),
        incomplete_ticks=len(set(inside) - set(complete)),
    )


def _row(tick: Mapping[Topic, Any]) -> dict[str, float]:
    state = decode_vehicle_state(*(tick[topic] for topic in _STATE))
    powers = decode_powers(tick[Topic.PLANT_POWERS])
    leader = decode_leader(tick[Topic.LEADER])
    return {
        # The compressor power stands in the state as well.
        **{entry.name: getattr(powers, entry.name) for entry in fields(powers)},
        **{entry.name: getattr(state, entry.name) for entry in fields(state)},
        **{name: decode_temperature(topic, tick[topic]) for topic, name in _COOLANT.items()},
        "leader_position_m": leader.position_m,
        "leader_speed_m_s": leader.speed_m_s,
    }


def _solves(data: Sequence[bytes]) -> SolveSeries:
    messages = sorted(messages_by_stamp(Topic.SOLVE, data).items())
    reports = [decode_solve_report(message)[1] for _, message in messages]
    return SolveSeries(
        time_s=np.array([s_from_ns(stamp_ns) for stamp_ns, _ in messages]),
        values={
            entry.name: np.array([float(getattr(report, entry.name)) for report in reports])
            for entry in fields(SolveReport)
        },
    )


def run_differences(live: LiveRun, trajectory: Trajectory, solves: SolveSeries) -> list[str]:
    """Compare a run as heard with the same run as read from its bag, bit by bit.

    Args:
        live: what the runner heard.
        trajectory: what the bag holds.
        solves: what the bag holds.

    Returns:
        One sentence per column that differs, empty if all are equal.
    """
    columns = live.trajectory.to_arrays()
    differences = [
        text
        for name, recorded in trajectory.to_arrays().items()
        if (text := _difference(name, columns[name], recorded))
    ]
    pairs = {"solve stamps": (live.solves.time_s, solves.time_s)}
    pairs |= {
        f"solve {name}": (live.solves.values[name], solves.values[name]) for name in solves.values
    }
    differences += [text for name, pair in pairs.items() if (text := _difference(name, *pair))]
    return differences


def _difference(name: str, heard: NDArray[Any], recorded: NDArray[Any]) -> str:
    if heard.size != recorded.size:
        return f"{name}: heard {heard.size} values, the bag holds {recorded.size}"
    equal = (heard == recorded) | (np.isnan(heard) & np.isnan(recorded))
    if bool(np.all(equal)):
        return ""
    row = int(np.flatnonzero(~equal)[0])
    return f"{name}: heard {heard[row]!r}, the bag holds {recorded[row]!r} in row {row}"
