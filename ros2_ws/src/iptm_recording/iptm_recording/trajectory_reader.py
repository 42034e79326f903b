"""Turns a bag back into the run that it recorded: one row per tick, joined by header stamps.

Log times say when the recorder got a message, stamps say what instant it describes; only the latter
join. Values stay float64 all the way; temperatures become kelvin again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from iptm_core.errors import BagError, IptmError
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_interfaces.codecs import (
    SolveReport,
    decode_leader,
    decode_powers,
    decode_solve_report,
    decode_temperature,
    decode_vehicle_state,
    ns_from_time,
    s_from_ns,
)
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader

_STATE = (
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_POWERS,
    Topic.PLANT_CAPACITY_LOSS,
)
_COOLANT = (Topic.PLANT_COOLANT_INLET_TEMPERATURE, Topic.PLANT_COOLANT_OUTLET_TEMPERATURE)
_TRAJECTORY_TOPICS = (*_STATE, *_COOLANT, Topic.LEADER)

T = TypeVar("T")
Messages = Mapping[Topic, Any]


@dataclass(frozen=True, eq=False)
class SolveSeries:
    """Reports of the controller, one row per decision.

    Attributes:
        time_s: stamps of the states that were answered, shape (n,).
        values: the fields of ``SolveReport`` by name, each of shape (n,); NaN where unknown.
    """

    time_s: FloatArray
    values: Mapping[str, FloatArray]


def read_trajectory(path: Path, namespace: str | None = None) -> Trajectory:
    """Read the run of a bag.

    Ticks at the very start and end that were recorded only in part are left out.

    Args:
        path: bag folder or .mcap file.
        namespace: namespace of the vehicle; needed only if the bag holds several.

    Raises:
        BagError: the bag cannot be read, lacks a topic or has one of another type, holds no
            complete tick, a tick inside the run is incomplete, or a message breaks its promise.
    """
    with BagReader(path) as reader:
        ticks = _ticks(reader, namespace)
        return _checked(path, lambda: _trajectory(ticks))


def read_solve_series(path: Path, namespace: str | None = None) -> SolveSeries:
    """Read how the controller came to its decisions.

    Args:
        path: bag folder or .mcap file.
        namespace: namespace of the vehicle; needed only if the bag holds several.

    Raises:
        BagError: as for ``read_trajectory``.
    """
    with BagReader(path) as reader:
        by_stamp = _by_stamp(reader, (Topic.SOLVE,), namespace)[Topic.SOLVE]
        decoded = _checked(
            path, lambda: [decode_solve_report(message) for message in by_stamp.values()]
        )
    names = [entry.name for entry in fields(SolveReport)]
    return SolveSeries(
        time_s=np.array([s_from_ns(stamp_ns) for stamp_ns, _ in decoded]),
        values={
            name: np.array([float(getattr(report, name)) for _, report in decoded])
            for name in names
        },
    )


def topic_name(reader: BagReader, topic: Topic, namespace: str | None) -> str:
    """Return the full name of a topic of the suite in a bag, after checking its type.

    Raises:
        BagError: it is missing, of another type, or in several namespaces.
    """
    spec = TOPICS[topic]
    name = spec.name
    if namespace is not None and not name.startswith("/"):
        prefix = namespace.strip("/")
        name = f"/{prefix}/{name}" if prefix else f"/{name}"
    return reader.resolve(name, spec.type_name).name


def _by_stamp(
    reader: BagReader, topics: tuple[Topic, ...], namespace: str | None
) -> dict[Topic, dict[int, Any]]:
    """Return the messages of stamped topics by their stamps (ns), in order of the stamps."""
    if reader.message_count == 0:
        raise BagError(f"{reader.path} holds no messages")
    keys = {topic_name(reader, topic, namespace): topic for topic in topics}
    found: dict[Topic, dict[int, Any]] = {topic: {} for topic in topics}
    for item in reader.messages(list(keys)):
        found[keys[item.topic]][ns_from_time(item.message.header.stamp)] = item.message
    return {topic: dict(sorted(messages.items())) for topic, messages in found.items()}


def _ticks(reader: BagReader, namespace: str | None) -> list[Messages]:
    """Return the messages of every tick from the first to the last complete one."""
    found = _by_stamp(reader, _TRAJECTORY_TOPICS, namespace)
    stamps = sorted(set().union(*found.values()))
    complete = [s for s in stamps if all(s in messages for messages in found.values())]
    if not complete:
        counts = ", ".join(f"{topic.value} {len(m)}" for topic, m in found.items())
        raise BagError(f"{reader.path} holds no complete tick; messages per topic: {counts}")
    for stamp in stamps:
        if complete[0] < stamp < complete[-1]:
            missing = [topic.value for topic, m in found.items() if stamp not in m]
            if missing:
                raise BagError(
                    f"{reader.path} lacks {', '.join(missing)} at {s_from_ns(stamp):g} s:"
                    " messages were lost during the recording"
                )
    return [{topic: m[stamp] for topic, m in found.items()} for stamp in complete]


def _trajectory(ticks: list[Messages]) -> Trajectory:
    states = [decode_vehicle_state(*(tick[topic] for topic in _STATE)) for tick in ticks]
    leaders = [decode_leader(tick[Topic.LEADER]) for tick in ticks]
    powers = [decode_powers(tick[Topic.PLANT_POWERS]) for tick in ticks]
    inlet, outlet = (
        [decode_temperature(topic, tick[topic]) for tick in ticks] for topic in _COOLANT
    )
    columns: dict[str, list[float]] = {
        **{name: [getattr(s, name) for s in states] for name in _names_of(states[0])},
        "coolant_inlet_temperature_k": inlet,
        "coolant_outlet_temperature_k": outlet,
        **{
            name: [getattr(p, name) for p in powers]
            for name in _names_of(powers[0])
            if name not in ("time_s", "compressor_power_w")
        },
        "leader_position_m": [leader.position_m for leader in leaders],
        "leader_speed_m_s": [leader.speed_m_s for leader in leaders],
    }
    return Trajectory.from_arrays(columns)


def _names_of(instance: Any) -> list[str]:
    return [entry.name for entry in fields(instance)]


def _checked(path: Path, read: Callable[[], T]) -> T:
    """Give errors in the content the name of the bag."""
    try:
        return read()
    except BagError:
        raise
    except IptmError as error:
        raise BagError(f"{path}: {error}") from None
