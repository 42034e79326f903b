"""The whole plan of the controller with its node times, as a table."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.state import FloatArray
from iptm_ros.codecs.table import decode_table, encode_table
from iptm_ros.message_types import PointCloud2
from iptm_ros.topics import TOPICS, Topic

PLAN_NAMES = list(TOPICS[Topic.PLAN].fields)


@dataclass(frozen=True)
class PlanTrajectory:
    """Predicted motion, temperatures and inputs of the ego vehicle at the nodes of the horizon.

    All arrays have shape (n,), in the order of the columns of the message. The inputs hold from their node to
    the next; the last node repeats the inputs of the last interval.

    Attributes:
        times_s: node times, increasing, absolute (trip time).
        positions_m: distance along the road.
        speeds_m_s: speed.
        cell_1_temperatures_k: first cell of a coolant channel.
        cell_n_temperatures_k: last cell of a coolant channel.
        accelerations_m_s2: acceleration input.
        compressor_powers_w: compressor power input.
    """

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray
    cell_1_temperatures_k: FloatArray
    cell_n_temperatures_k: FloatArray
    accelerations_m_s2: FloatArray
    compressor_powers_w: FloatArray


def encode_plan(plan: PlanTrajectory, stamp_ns: int) -> PointCloud2:
    """Return a plan as a message, stamped with the state that it starts from."""
    return encode_table(
        Topic.PLAN, stamp_ns, dict(zip(PLAN_NAMES, vars(plan).values(), strict=True))
    )


def decode_plan(message: PointCloud2) -> tuple[int, PlanTrajectory]:
    """Return the stamp (ns) and the plan.

    Raises:
        MessageError: see `decode_table`.
    """
    stamp_ns, columns = decode_table(Topic.PLAN, message)
    return stamp_ns, PlanTrajectory(*columns.values())
