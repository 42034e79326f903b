"""The decision of the controller and the record of how it came about."""

from __future__ import annotations

from enum import IntEnum
from typing import TypeVar

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import Command
from iptm_interfaces.codecs._checks import reject
from iptm_interfaces.codecs.fixed_layout import Numbers
from iptm_interfaces.codecs.named_values import decode_named_values, named_values
from iptm_interfaces.codecs.time import ns_from_time
from iptm_interfaces.message_types import (
    JointState,
)
from iptm_interfaces.topics import Topic

E = TypeVar("E", bound=IntEnum)

_ADDED = (
    "cell_1_marginal_cost_1_k",
    "cell_n_marginal_cost_1_k",
    "aging_rate_1_s",
    "aging_sensitivity_1_k",
    "temperature_decay_time_s",
    "trusted_preview_s",
    "command_delay_s",
    "brake_share",
)
"""Values that older bags do not have."""
_MAY_BE_UNKNOWN = frozenset(
    (
        "solve_time_s",
        "gap_slack_m",
        "speed_slack_m_s",
        "temperature_slack_k",
        "objective",
        "preview_age_s",
        *_ADDED,
    )
)


@named_values(Topic.COMMAND)
def encode_command(stamp_ns: int, command: Command) -> Numbers:
    """Return a decision, stamped with the state it answers (acceleration m/s^2, power W)."""
    return stamp_ns, (command.acceleration_m_s2, command.compressor_power_w)


def decode_command(message: JointState) -> tuple[int, Command]:
    """Return the stamp (ns) of the state that is answered, and the decision.

    Physical bounds are not checked here: the plant clips, and a sign error must stay visible.

    Raises:
        MessageError: a value is missing or not finite.
    """
    acceleration_m_s2, compressor_power_w = decode_named_values(Topic.COMMAND, message)
    return ns_from_time(message.header.stamp), Command(acceleration_m_s2, compressor_power_w)


@named_values(Topic.SOLVE)
def encode_decision_record(stamp_ns: int, record: DecisionRecord) -> Numbers:
    """Return the record of a decision, stamped like the decision."""
    return stamp_ns, tuple(vars(record).values())


def decode_decision_record(message: JointState) -> DecisionRecord:
    """Return the record of a decision.

    Raises:
        MessageError: a value is missing, a count is not finite, or a status or rung is unknown.
    """
    values = decode_named_values(Topic.SOLVE, message, _MAY_BE_UNKNOWN)
    status, time_s, iterations, gap, speed, temperature, cost, rung, limited, age, *added = values
    return DecisionRecord(
        status=_enumerated(SolveStatus, "status_code", status),
        solve_time_s=time_s,
        iterations=int(iterations),
        gap_slack_m=gap,
        speed_slack_m_s=speed,
        temperature_slack_k=temperature,
        objective=cost,
        rung=_enumerated(Rung, "fallback_rung", rung),
        limiter_active=bool(limited),
        preview_age_s=age,
        **dict(zip(_ADDED, added, strict=True)),
    )


def _enumerated(kind: type[E], name: str, value: float) -> E:
    for entry in kind:
        if entry.value == value:
            return entry
    allowed = ", ".join(f"{entry.value} ({entry.name.lower()})" for entry in kind)
    return reject(Topic.SOLVE, f"{name} is {value:g}; allowed: {allowed}")
