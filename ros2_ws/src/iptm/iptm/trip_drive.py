"""Drives a trip either way: in memory, or over ROS 2 with the same numbers."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any

from iptm.driving import drive_in_memory
from iptm.run import Run
from iptm.trip import Trip
from iptm_core.errors import ScenarioError
from iptm_core.user_input import check_known


class Over(Enum):
    """What connects the parts of a trip."""

    MEMORY = "memory"
    ROS = "ros"


def drive(
    trip: Trip,
    *,
    over: str = Over.MEMORY.value,
    bag: str | Path | None = None,
    **own_parts: Any,
) -> Run:
    """Drive a trip.

    Args:
        trip: the trip to drive.
        over: ``memory``, or ``ros`` for processes that exchange messages; both give the same numbers.
        bag: folder to create for the recorded messages; over ROS 2 only.
        own_parts: in memory, ``controller``, ``predictor``, ``aging_law``, ``on_tick`` and ``on_step``, see
            `drive_in_memory`.

    Raises:
        IptmError: the trip cannot be driven; the message states the value and the allowed ones.
    """
    check_known(over, [each.value for each in Over], "over", "value", ScenarioError)
    if over == Over.MEMORY.value:
        if bag is not None:
            raise ScenarioError(f"bag is {str(bag)!r} in memory; allowed: over ROS 2")
        return drive_in_memory(trip, **own_parts)
    given = [name for name, part in own_parts.items() if part is not None]
    if given:
        raise ScenarioError(f"{given[0]} is given over ROS 2; allowed: in memory, or a node")
    # Needs ROS.
    from iptm.runner.runner import drive_over_ros  # noqa: PLC0415

    return drive_over_ros(trip, None if bag is None else Path(bag))
