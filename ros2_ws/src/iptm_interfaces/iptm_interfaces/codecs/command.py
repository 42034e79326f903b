"""The decision of the controller and the report on how it came about."""

from __future__ import annotations

from dataclasses import astuple, dataclass

from sensor_msgs.msg import JointState

from iptm_core.state import Command
from iptm_interfaces.codecs.named_values import decode_named_values, encode_named_values
from iptm_interfaces.codecs.time import ns_from_time
from iptm_interfaces.topics import Topic

_MAY_BE_UNKNOWN = frozenset(
    (
        "solve_time_s",
        "gap_slack_m",
        "speed_slack_m_s",
        "temperature_slack_k",
        "objective",
        "preview_age_s",
    )
)


@dataclass(frozen=True)
class SolveReport:
    """How a decision came about; a quantity that is not known is NaN.

    Attributes:
        status_code: solver status, number of the controller's status enumeration.
        solve_time_s: wall time of the solve.
        iterations: of the solver.
        gap_slack_m: largest violation of the gap limits in the plan.
        speed_slack_m_s: largest violation of the speed limits in the plan.
        temperature_slack_k: largest violation of the temperature limits in the plan.
        objective: value of the cost.
        fallback_rung: 0 = solver, higher = further down the ladder.
        limiter_active: whether the last limiter changed the decision.
        preview_age_s: time since the preview in use was generated, infinite without a preview.
    """

    status_code: int
    solve_time_s: float
    iterations: int
    gap_slack_m: float
    speed_slack_m_s: float
    temperature_slack_k: float
    objective: float
    fallback_rung: int
    limiter_active: bool
    preview_age_s: float


def encode_command(stamp_ns: int, command: Command) -> JointState:
    """Return a decision, stamped with the state it answers (acceleration m/s^2, power W)."""
    return encode_named_values(
        Topic.COMMAND, stamp_ns, (command.acceleration_m_s2, command.compressor_power_w)
    )


def decode_command(message: JointState) -> tuple[int, Command]:
    """Return the stamp (ns) of the state that is answered, and the decision.

    Physical bounds are not checked here: the plant clips, and a sign error must stay visible.

    Raises:
        MessageError: a value is missing or not finite.
    """
    acceleration_m_s2, compressor_power_w = decode_named_values(Topic.COMMAND, message)
    return ns_from_time(message.header.stamp), Command(acceleration_m_s2, compressor_power_w)


def encode_solve_report(stamp_ns: int, report: SolveReport) -> JointState:
    """Return the report on a decision, stamped like the decision."""
    return encode_named_values(Topic.SOLVE, stamp_ns, astuple(report))


def decode_solve_report(message: JointState) -> tuple[int, SolveReport]:
    """Return the stamp (ns) and the report on a decision.

    Raises:
        MessageError: a value is missing, or a count or code is not finite.
    """
    values = decode_named_values(Topic.SOLVE, message, _MAY_BE_UNKNOWN)
    status, time_s, iterations, gap, speed, temperature, cost, rung, limited, age = values
    report = SolveReport(
        status_code=int(status),
        solve_time_s=time_s,
        iterations=int(iterations),
        gap_slack_m=gap,
        speed_slack_m_s=speed,
        temperature_slack_k=temperature,
        objective=cost,
        fallback_rung=int(rung),
        limiter_active=bool(limited),
        preview_age_s=age,
    )
    return ns_from_time(message.header.stamp), report
