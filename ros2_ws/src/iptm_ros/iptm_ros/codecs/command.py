"""The decision of the controller and the record of how it came about."""

from __future__ import annotations

from enum import IntEnum
from typing import TypeVar

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import Command
from iptm_ros.codecs.numbers import StampedNumbers, encoder, read_numbers, reject
from iptm_ros.codecs.time import ns_from_time
from iptm_ros.message_types import (
    JointState,
)
from iptm_ros.topics import TOPICS, Topic

E = TypeVar("E", bound=IntEnum)


@encoder(Topic.COMMAND)
def encode_command(stamp_ns: int, command: Command) -> StampedNumbers:
    """Return a decision, stamped with the state it answers (acceleration m/s^2, power W)."""
    return stamp_ns, (command.acceleration_m_s2, command.compressor_power_w)


def decode_command(message: JointState) -> tuple[int, Command]:
    """Return the stamp (ns) of the state that is answered, and the decision.

    Physical bounds are not checked here: the plant clips, and a sign error must stay visible.
    """
    acceleration_m_s2, compressor_power_w = read_numbers(Topic.COMMAND, message)
    return ns_from_time(message.header.stamp), Command(acceleration_m_s2, compressor_power_w)


@encoder(Topic.SOLVE)
def encode_decision_record(stamp_ns: int, record: DecisionRecord) -> StampedNumbers:
    """Return the record of a decision, stamped like the decision."""
    return stamp_ns, tuple(vars(record).values())


def decode_decision_record(message: JointState) -> DecisionRecord:
    """Return the record of a decision."""
    numbers = dict(zip(TOPICS[Topic.SOLVE].fields, read_numbers(Topic.SOLVE, message), strict=True))
    return DecisionRecord(
        status=_enumerated(SolveStatus, "status_code", numbers.pop("status_code")),
        iterations=int(numbers.pop("iterations")),
        rung=_enumerated(Rung, "fallback_rung", numbers.pop("fallback_rung")),
        limiter_active=bool(numbers.pop("limiter_active")),
        **numbers,
    )


def _enumerated(kind: type[E], name: str, value: float) -> E:
    for entry in kind:
        if entry.value == value:
            return entry
    allowed = ", ".join(f"{entry.value} ({entry.name.lower()})" for entry in kind)
    return reject(Topic.SOLVE, f"{name} is {value:g}; allowed: {allowed}")
