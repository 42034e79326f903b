"""Pure functions between the project's dataclasses and ROS messages, checked on decoding."""

from iptm_ros.codecs.cdr import serialized, stamp_ns_of
from iptm_ros.codecs.command import (
    decode_command,
    decode_decision_record,
    encode_command,
    encode_decision_record,
)
from iptm_ros.codecs.datagram import decode_raw_datagram, encode_raw_datagram
from iptm_ros.codecs.numbers import read_numbers
from iptm_ros.codecs.observation import (
    decode_leader,
    decode_motion,
    decode_observation,
    encode_battery,
    encode_leader,
    encode_observation,
)
from iptm_ros.codecs.plan import PlanTrajectory, decode_plan, encode_plan
from iptm_ros.codecs.preview import decode_leader_preview, encode_leader_preview
from iptm_ros.codecs.road import (
    decode_road_ahead,
    decode_slope,
    encode_road_ahead,
    encode_slope,
    has_leader,
)
from iptm_ros.codecs.time import (
    ns_from_s,
    ns_from_time,
    s_from_ns,
    time_from_ns,
    time_from_s,
)
from iptm_ros.codecs.tracks import decode_tracks, encode_tracks

__all__ = [
    "PlanTrajectory",
    "decode_command",
    "decode_decision_record",
    "decode_leader",
    "decode_leader_preview",
    "decode_motion",
    "decode_observation",
    "decode_plan",
    "decode_raw_datagram",
    "decode_road_ahead",
    "decode_slope",
    "decode_tracks",
    "encode_battery",
    "encode_command",
    "encode_decision_record",
    "encode_leader",
    "encode_leader_preview",
    "encode_observation",
    "encode_plan",
    "encode_raw_datagram",
    "encode_road_ahead",
    "encode_slope",
    "encode_tracks",
    "has_leader",
    "ns_from_s",
    "ns_from_time",
    "read_numbers",
    "s_from_ns",
    "serialized",
    "stamp_ns_of",
    "time_from_ns",
    "time_from_s",
]
