"""Stations that are heard, and messages that are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.iptm_v2x_bridge.radio import ROAD, station

from iptm_core.routes.road_line import RoadLine
from iptm_v2x_bridge.messages.packets import its_timestamp_ms, resolve_delta_ms
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sender import car_on_road
from iptm_v2x_bridge.stations.table import MAX_CONFIRMED, MAX_NEWCOMERS, StationTable

NOW_MS = 700_000_000_000


def heard(table: StationTable, message: Any, now_ms: int, **more: Any) -> Rejection | None:
    return table.receive(message, more.pop("packet_ms", None), now_ms, **more)


def drive(
    table: StationTable, identity: int = 1, start_ms: int = NOW_MS, messages: int = 5, **more: Any
) -> int:
    """Let a car be heard at 10 Hz at 20 m/s; return when it was heard last."""
    start_m = more.pop("rear_m", 100.0)
    for number in range(messages):
        at_ms = start_ms + 100 * number
        assert (
            heard(table, station(identity, at_ms, start_m + 2.0 * number, 20.0, **more), at_ms)
            is None
        )
    return start_ms + 100 * (messages - 1)


def test_the_epoch_is_that_of_the_standard() -> None:
    """The example of TS 102 894-2: 2007-01-01T00:00:00 UTC is 94,694,401,000 ms."""
    assert its_timestamp_ms(1_167_609_600 * 10**9) - 94_694_401_000 == 4000
    # Four leap seconds were added after the example's single one; since 2017 there are five.
    assert its_timestamp_ms(1_483_228_800 * 10**9) == 410_313_600_000 + 5000


@given(st.integers(0, 2**42), st.integers(-30_000, 60_000))
def test_the_wrap_is_resolved_against_the_clock(now_ms: int, age_ms: int) -> None:
    generated_ms = now_ms - age_ms
    if age_ms < 32_768:
        assert resolve_delta_ms(generated_ms % 65_536, now_ms, 32_768) == generated_ms
    else:
        assert resolve_delta_ms(generated_ms % 65_536, now_ms, 0) == generated_ms


@pytest.mark.parametrize("start_ms", [NOW_MS, 65_536 * 1000 - 200])
def test_a_car_becomes_a_station(start_ms: int) -> None:
    """Across the wrap of the generation time as well."""
    table = StationTable(ROAD)
    drive(table, start_ms=start_ms)
    (found,) = table.confirmed
    assert found.last.position_m == pytest.approx(108.0, abs=0.02)
    assert found.last.time_s == pytest.approx(start_ms / 1000.0 + 0.4)
    assert table.rejections.total == 0


def test_one_message_is_no_station_yet() -> None:
    table = StationTable(ROAD)
    drive(table, messages=2)
    assert table.confirmed == ()
    assert len(table) == 1


def test_a_silent_station_is_forgotten() -> None:
    table = StationTable(ROAD)
    last_ms = drive(table)
    table.forget_silent(last_ms + 5000)
    assert len(table.confirmed) == 1
    table.forget_silent(last_ms + 5001)
    assert len(table) == 0


@pytest.mark.parametrize(
    ("later_ms", "rear_m", "changes", "reason"),
    [
        (100, 110.0, {}, None),
        (100, 110.0, {"speed_m_s": 71.0}, Rejection.ABSURD),
        (100, 110.0, {"acceleration_m_s2": -12.5}, Rejection.ABSURD),
        (0, 108.0, {}, Rejection.DUPLICATE),
        (-100, 106.0, {}, Rejection.OLDER),
        (100, 130.0, {}, Rejection.POSITION_JUMP),
        (100, 90.0, {}, Rejection.POSITION_JUMP),
        (100, 110.0, {"speed_m_s": 25.0}, Rejection.SPEED_JUMP),
        (100, 110.0, {"heading_deg": 90.0}, Rejection.HEADING_JUMP),
        (100, 110.0, {"left_m": 3.5}, Rejection.LATERAL_JUMP),
        (1000, 128.0, {"left_m": 2.0}, None),
        # As far as the faster of both speeds leads, with 6 m of acceleration and 2.5 m of tolerance.
        (1000, 145.0, {"speed_m_s": 31.0}, None),
    ],
)
def test_the_next_message_has_to_fit(
    later_ms: int, rear_m: float, changes: dict[str, Any], reason: Rejection | None
) -> None:
    table = StationTable(ROAD)
    last_ms = drive(table)
    speed_m_s = changes.pop("speed_m_s", 20.0)
    at_ms = last_ms + later_ms
    message = station(1, at_ms, rear_m, speed_m_s, **changes)
    assert heard(table, message, max(at_ms, last_ms)) is reason
    if reason is not None:
        assert table.rejections.by_reason() == {str(reason): 1}
        assert table.confirmed[0].last.position_m == pytest.approx(108.0, abs=0.02)


@pytest.mark.parametrize(
    ("age_ms", "reason"),
    [
        (-499, None),
        (-501, Rejection.FUTURE),
        (2999, None),
        (3001, Rejection.STALE),
        (40_000, Rejection.FUTURE),
    ],
)
def test_messages_of_another_time_are_dropped(age_ms: int, reason: Rejection | None) -> None:
    """Half a wrap away no one can tell the past from the future; neither is used."""
    table = StationTable(ROAD)
    assert heard(table, station(1, NOW_MS - age_ms, 0.0, 20.0), NOW_MS) is reason


def test_an_old_message_in_a_new_wrap_is_betrayed_by_its_packet() -> None:
    table = StationTable(ROAD)
    old = station(1, NOW_MS - 65_536, 0.0, 20.0)
    assert heard(table, old, NOW_MS, packet_ms=(NOW_MS - 65_536) % 2**32) is Rejection.TIMESTAMPS
    assert heard(table, old, NOW_MS, packet_ms=NOW_MS % 2**32) is None


def test_a_car_that_brakes_hard_is_believed() -> None:
    """A full stop from 30 m/s at 9 m/s2, heard once a second."""
    table = StationTable(ROAD)
    rear_m, speed_m_s, at_ms = 0.0, 30.0, NOW_MS
    while speed_m_s > 0.0:
        assert heard(table, station(1, at_ms, rear_m, speed_m_s), at_ms) is None
        step_s = 1.0
        slower = max(speed_m_s - 9.0 * step_s, 0.0)
        braking_s = (speed_m_s - slower) / 9.0
        rear_m += 0.5 * (speed_m_s + slower) * braking_s
        at_ms, speed_m_s = at_ms + round(1000.0 * step_s), slower
    assert heard(table, station(1, at_ms, rear_m, 0.0), at_ms) is None


def test_a_flood_of_identities_leaves_the_known_alone() -> None:
    table = StationTable(ROAD)
    drive(table, identity=7)
    for identity in range(1000, 11_000):
        heard(table, station(identity, NOW_MS + 400, 300.0, 20.0), NOW_MS + 400)
    assert len(table) <= MAX_NEWCOMERS + 1
    assert table.hypotheses(7)
    assert table.rejections[Rejection.TABLE_FULL] == 10_000 - MAX_NEWCOMERS
    assert heard(table, station(7, NOW_MS + 500, 110.0, 20.0), NOW_MS + 500) is None


def test_too_many_proven_stations_give_way_from_afar() -> None:
    table = StationTable(ROAD)
    drive(table, identity=7)
    for identity in range(1000, 1000 + MAX_CONFIRMED):
        drive(table, identity=identity, rear_m=500.0 + 10.0 * identity)
    assert len(table.confirmed) == MAX_CONFIRMED
    assert table.hypotheses(7)
    assert table.rejections[Rejection.TABLE_FULL] == 1


def test_on_the_second_lap_a_new_station_is_looked_for_near_the_ego_vehicle() -> None:
    lap = [(0.0, 0.0), (0.003, 0.0), (0.003, 0.004), (0.0, 0.004)]
    corners = np.array([*lap, *lap, (0.0, 0.0)])
    road = RoadLine(48.0 + corners[:, 0], 11.0 + corners[:, 1])
    lap_m = float(road.positions_m[4])
    table = StationTable(road)
    for number in range(5):
        at_ms = NOW_MS + 100 * number
        message = car_on_road(road, 1, at_ms, lap_m + 60.0 + 2.0 * number, 20.0)
        assert heard(table, message, at_ms, ego_position_m=lap_m + 30.0) is None
    (found,) = table.confirmed
    assert found.last.position_m == pytest.approx(lap_m + 68.0, abs=0.1)
