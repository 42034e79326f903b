"""What lies ahead: the predicted motion of the leader, and its measured one inside an interval, as tables.

A prediction carries two times: the stamp of its publication and the instant of its generation, which is the
time of its first row. Where it is uncertain, a further column has its bounds.
"""

from __future__ import annotations

import numpy as np

from iptm_core.state import SPEED_AT_REST_M_S, FloatArray, LeaderPreview
from iptm_ros.codecs.numbers import reject
from iptm_ros.codecs.table import POSITION, TIME, decode_table, encode_table
from iptm_ros.message_types import PointCloud2
from iptm_ros.topics import Topic

SPEED, BOUND = "speed_m_s", "bound_m"


def encode_leader_preview(
    preview: LeaderPreview, stamp_ns: int, topic: Topic = Topic.LEADER_PREVIEW
) -> PointCloud2:
    """Return a prediction as a message.

    Raises:
        MessageError: the arrays differ in length, or a time is not finite.
    """
    columns: dict[str, FloatArray] = {
        TIME: preview.times_s,
        POSITION: preview.positions_m,
        SPEED: preview.speeds_m_s,
    }
    if preview.bounds_m.size:
        columns[BOUND] = preview.bounds_m
    return encode_table(topic, stamp_ns, columns)


def decode_leader_preview(
    message: PointCloud2, topic: Topic = Topic.LEADER_PREVIEW
) -> tuple[int, LeaderPreview]:
    """Return the stamp (ns) and the prediction.

    Measured positions, as in ``v2x/leader_samples``, may go back and forth; predicted ones may not.

    Raises:
        MessageError: see `decode_table`; a leader that drives backwards, a negative bound, or a generation
            after the publication.
    """
    stamp_ns, columns = decode_table(topic, message, optional=(BOUND,))
    times_s, positions_m, speeds_m_s = columns[TIME], columns[POSITION], columns[SPEED]
    bounds_m = columns.get(BOUND, np.empty(0))
    if not times_s.size:
        return stamp_ns, LeaderPreview.empty()
    late_ns = round(float(times_s[0]) * 1e9) - stamp_ns
    if late_ns > 0:
        reject(topic, f"generated {late_ns} ns after its publication; allowed: at most 0")
    if float(speeds_m_s.min()) < SPEED_AT_REST_M_S:
        reject(topic, f"speed is {speeds_m_s.min()}; allowed: at least {SPEED_AT_REST_M_S:g} m/s")
    if float(bounds_m.min(initial=0.0)) < 0.0:
        reject(topic, f"bound is {bounds_m.min()} m; allowed: at least 0 m")
    backwards_m = SPEED_AT_REST_M_S * np.maximum(np.diff(times_s), 1.0)
    if topic is Topic.LEADER_PREVIEW and (np.diff(positions_m) < backwards_m).any():
        reject(topic, "positions decrease; allowed: a leader that never drives backwards")
    return stamp_ns, LeaderPreview(times_s, positions_m, speeds_m_s, bounds_m)
