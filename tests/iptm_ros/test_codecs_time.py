from __future__ import annotations

import math

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import MessageError
from iptm_ros.codecs.cdr import (
    ns_from_s,
    ns_from_time,
    s_from_ns,
    time_from_ns,
    time_from_s,
)


@given(st.integers(min_value=0, max_value=26 * 24 * 3600 * 1000))
def test_milliseconds_survive_the_round_trip_exactly(milliseconds: int) -> None:
    time_s = milliseconds / 1000
    assert s_from_ns(ns_from_time(time_from_s(time_s))) == time_s
    assert ns_from_s(time_s) == milliseconds * 1_000_000


@given(st.integers(min_value=0, max_value=2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(stamp_ns: int) -> None:
    assert ns_from_time(time_from_ns(stamp_ns)) == stamp_ns


def test_sum_of_tenths_meets_the_same_stamp() -> None:
    assert ns_from_s(0.1 + 0.2) == ns_from_s(0.3)
    assert s_from_ns(ns_from_s(0.1 + 0.2)) == 0.3


@pytest.mark.parametrize("time_s", [math.nan, math.inf, -math.inf])
def test_non_finite_time_is_refused(time_s: float) -> None:
    with pytest.raises(MessageError, match="finite"):
        ns_from_s(time_s)


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_stamp_out_of_range_is_refused(stamp_ns: int) -> None:
    with pytest.raises(MessageError, match="allowed: 0 to"):
        time_from_ns(stamp_ns)


def test_largest_stamp_fits() -> None:
    assert time_from_ns(2**31 * 10**9 - 1) == Time(sec=2**31 - 1, nanosec=10**9 - 1)
