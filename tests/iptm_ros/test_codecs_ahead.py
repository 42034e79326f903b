"""Plans and the road ahead on the wire."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from tests.table_messages import encode_plan

from iptm_core.errors import MessageError
from iptm_core.road_ahead import RoadAhead, SpeedLimits, Stop
from iptm_ros.codecs import (
    PlanTrajectory,
    decode_plan,
    decode_road_ahead,
    encode_road_ahead,
    has_leader,
    serialized,
)

TIMES = 30.0 + np.array([0.0, 1.0, 2.0, 7.0, 12.0])
PLAN = PlanTrajectory(TIMES, *(column + np.linspace(0.0, 1.0, 5) for column in range(6)))


def test_round_trip_with_unequal_steps() -> None:
    stamp_ns, back = decode_plan(encode_plan(PLAN, 30_000_000_000))
    assert stamp_ns == 30_000_000_000
    for field in dataclasses.fields(PLAN):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(PLAN, field.name))


def test_empty_plan_is_possible() -> None:
    empty = PlanTrajectory(*(np.empty(0) for _ in range(7)))
    _, back = decode_plan(encode_plan(empty, 0))
    assert back.times_s.size == back.compressor_powers_w.size == 0


def test_columns_of_different_length_cannot_be_sent() -> None:
    broken = dataclasses.replace(PLAN, accelerations_m_s2=np.zeros(4))
    with pytest.raises(MessageError, match="controller/plan: columns have"):
        encode_plan(broken, 0)


def test_value_that_is_not_finite_is_named() -> None:
    speeds = PLAN.speeds_m_s.copy()
    speeds[2] = math.nan
    message = encode_plan(dataclasses.replace(PLAN, speeds_m_s=speeds), 0)
    with pytest.raises(MessageError, match=r"speed_m_s\[2\] is nan"):
        decode_plan(message)


def test_other_columns_are_refused() -> None:
    message = encode_plan(PLAN, 0)
    message.fields = message.fields[:-1]
    with pytest.raises(MessageError, match="controller/plan: missing compressor_power_w; got x, y"):
        decode_plan(message)


def test_times_must_increase() -> None:
    times = PLAN.times_s.copy()
    times[1] = times[0]
    message = encode_plan(dataclasses.replace(PLAN, times_s=times), 0)
    with pytest.raises(MessageError, match="time_s do not increase"):
        decode_plan(message)


LIMITS = SpeedLimits(np.array([0.0, 700.5]), np.array([13.9, 8.3]))
STOPS = (Stop(398.0, 60.5), Stop(5000.0, math.inf))


@pytest.mark.parametrize("leads", [True, False])
@pytest.mark.parametrize(
    ("limits", "stops"), [(None, ()), (LIMITS, ()), (LIMITS, STOPS)], ids=["none", "limits", "all"]
)
def test_what_is_encoded_is_decoded(
    limits: SpeedLimits | None, stops: tuple[Stop, ...], leads: bool
) -> None:
    road = None if limits is None else RoadAhead(leads, limits, stops)
    message = encode_road_ahead(road, 7_000_000_001, has_leader=leads)
    stamp_ns, found = decode_road_ahead(message)
    assert stamp_ns == 7_000_000_001
    assert found.has_leader is leads
    assert has_leader(serialized(message)) is leads
    assert found.stops == stops
    assert (found.limits is None) is (limits is None)
    if limits is not None and found.limits is not None:
        assert found.limits.starts_m.tolist() == limits.starts_m.tolist()
        assert found.limits.limits_m_s.tolist() == limits.limits_m_s.tolist()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ["speed_limit"]}, "1 names, but 3"),
        ({"name": ["speed_limit", "hole", "stop"]}, "bound is hole"),
        ({"name": ["stop", "stop", "stop"]}, "without a speed limit"),
        ({"velocity": [-1.0, 5.0, 0.0]}, "limits above 0"),
        ({"position": [9.0, 3.0, 10.0]}, "increasing starts"),
        ({"position": [0.0, 3.0, math.nan]}, "bound is stop at nan"),
        ({"effort": [math.inf, math.inf, math.nan]}, "until nan"),
    ],
)
def test_a_message_that_bounds_nothing_is_refused(
    change: dict[str, list[float]], words: str
) -> None:
    message = encode_road_ahead(RoadAhead(False, LIMITS, STOPS[:1]), 0, has_leader=False)
    for name, values in change.items():
        setattr(message, name, values)
    with pytest.raises(MessageError, match=words):
        decode_road_ahead(message)
