"""The ego vehicle on roads with rules, driven by the real controller: without a leader, and with one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import iptm
from iptm.faults.fault import faults_from
from iptm_core.decision_record import Rung
from iptm_core.errors import IptmError
from iptm_core.units import KM_H_PER_M_S
from iptm_v2x_bridge.rules_of_the_road import read_signals

TOLERANCE_M_S = 0.02


def driven(**settings: Any) -> iptm.Run:
    given: dict[str, Any] = {
        "cycle": "us06",
        "duration_s": 150.0,
        "horizon": "3x1+5x5",
        "leader_source": "none",
        "strategy": "aging",
        "speed_limits_km_h": "0:50",
    }
    return iptm.simulate(**{**given, **settings})


def assert_free(run: iptm.Run) -> None:
    assert not run.trajectory.has_leader.any()
    assert set(run.decisions.rung) == {Rung.OPTIMAL}


@pytest.mark.parametrize("opens_at_s", [0.0, 12.0, 24.0, 36.0, 48.0])
@pytest.mark.parametrize("foresight_s", [15.0, 60.0])
def test_lines_are_passed_only_while_they_are_open(opens_at_s: float, foresight_s: float) -> None:
    shifts = ((300.0, 0.0), (700.0, 17.0), (1100.0, 41.0))
    signals = ", ".join(f"{line}:60:{opens_at_s + shift}:25" for line, shift in shifts)
    run = driven(signals=signals, line_foresight_s=foresight_s)
    assert_free(run)
    times, places = run.trajectory.time_s, run.trajectory.position_m
    passed = 0
    for signal in read_signals(signals):
        if places[-1] > signal.stop_line_m:
            passed += 1
            index = int(np.argmax(places > signal.stop_line_m))
            share = (signal.stop_line_m - places[index - 1]) / (places[index] - places[index - 1])
            passed_s = float(times[index - 1] + share * (times[index] - times[index - 1]))
            assert signal.is_open(passed_s), f"{signal} was passed at {passed_s} s"
    assert passed >= 2


def test_limits_are_kept_where_they_fall_and_rise() -> None:
    run = driven(speed_limits_km_h="0:50, 400:30, 600:80, 1200:50")
    assert_free(run)
    trip = run.trajectory
    limits = np.array([50.0, 30.0, 80.0, 50.0]) / KM_H_PER_M_S
    here = limits[np.searchsorted([400.0, 600.0, 1200.0], trip.position_m, side="right")]
    assert np.all(trip.speed_m_s <= here + TOLERANCE_M_S)
    # They are used, too, and what falls is anticipated without hard braking.
    for limit, start_m, end_m in (
        (50.0, 200.0, 350.0),
        (30.0, 450.0, 590.0),
        (80.0, 900.0, 1100.0),
    ):
        inside = (trip.position_m > start_m) & (trip.position_m < end_m)
        assert trip.speed_m_s[inside].max() > 0.85 * limit / KM_H_PER_M_S
    assert trip.acceleration_m_s2.min() > -1.5


def test_the_set_speed_of_the_driver_is_a_limit() -> None:
    run = driven(speed_limits_km_h="", set_speed_km_h=40.0, duration_s=60.0)
    assert_free(run)
    assert run.trajectory.speed_m_s.max() == pytest.approx(40.0 / KM_H_PER_M_S, abs=TOLERANCE_M_S)


def test_the_trip_ends_at_the_end_of_the_route() -> None:
    run = driven(cycle="nycc", speed_limits_km_h="0:60", duration_s=400.0)
    assert_free(run)
    end_m = 1898.0
    assert run.trajectory.position_m[-1] == pytest.approx(end_m, abs=6.0)
    assert run.trajectory.speed_m_s[-1] < 0.05


def test_the_cruise_control_of_the_production_car_keeps_the_rules() -> None:
    signals = "300:1000:60:900"
    run = driven(strategy="production", signals=signals, speed_limits_km_h="0:50, 700:30")
    assert_free(run)
    trip = run.trajectory
    assert trip.position_m[trip.time_s <= 60.0].max() <= 300.0
    fast = np.where(trip.position_m < 700.0, 50.0, 30.0) / KM_H_PER_M_S
    assert np.all(trip.speed_m_s <= fast + 0.1)


def test_of_a_leader_and_a_stop_line_the_nearer_one_binds() -> None:
    """The leader of US06 passes the line; the ego vehicle waits there, and follows it before and after."""
    own = {"leader_source": "cycle", "ego_keeps_rules": True, "duration_s": 120.0}
    rules = {**own, "speed_limits_km_h": "0:130", "signals": "400:1000:70:900"}
    held, free = driven(**rules), driven(**{**rules, "signals": ""}).trajectory
    trip = held.trajectory
    assert trip.has_leader.all()
    assert set(held.decisions.rung) == {Rung.OPTIMAL}
    assert trip.leader_position_m[trip.time_s == 69.0][0] > 500.0
    assert trip.position_m[trip.time_s <= 70.0].max() <= 400.0
    assert trip.position_m[-1] > 400.0
    assert free.position_m[free.time_s == 70.0][0] > 500.0
    assert trip.closest_m.min() > 0.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"speed_limits_km_h": ""}, "speed_limits_km_h is empty and set_speed_km_h is 0"),
        ({"speed_limits_km_h": "fast"}, "allowed: <from metre>"),
        ({"signals": "12"}, "signals is '12'"),
        ({"leader_source": "cam"}, "cam"),
        ({"set_speed_km_h": -1.0}, "set_speed_km_h is -1"),
        ({"max_lateral_acceleration_m_s2": 0.0}, "max_lateral_acceleration_m_s2 is 0"),
    ],
)
def test_settings_that_lead_nowhere_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(IptmError, match=words):
        driven(**settings)


def test_faults_of_a_leader_need_one() -> None:
    faults = faults_from([{"kind": "leader_lost", "start_s": 5.0, "duration_s": 2.0}], "test")
    with pytest.raises(IptmError, match="fault is leader_lost with leader_source none"):
        driven(faults=faults)
