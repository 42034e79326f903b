from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from iptm_core.errors import MessageError
from iptm_ros.codecs import PlanTrajectory, decode_plan, encode_plan

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
