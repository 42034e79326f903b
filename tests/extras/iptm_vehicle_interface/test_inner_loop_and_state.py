"""The inner loop between decisions, and the vehicle state from asynchronous signals."""

from __future__ import annotations

import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_core.physics.powertrain import cell_current_a
from iptm_core.state import Command, LeaderState
from iptm_vehicle_interface.channel import VehicleLink
from iptm_vehicle_interface.driving import KEPT_CHANGES, DriveLog, LateSteps
from iptm_vehicle_interface.engagement import Engagement
from iptm_vehicle_interface.frames import SignalTable
from iptm_vehicle_interface.inner_loop import (
    LARGEST_JERK_M_S3,
    Followed,
    followed,
    wanted_acceleration_m_s2,
)
from iptm_vehicle_interface.vehicle_state import VehicleStateEstimator

STEP_S = 0.02


def plan_of(accelerations: list[float], speed_m_s: float, leader: LeaderState | None) -> Followed:
    nodes = np.arange(len(accelerations) + 1.0)
    speeds = speed_m_s + np.concatenate(([0.0], np.cumsum(accelerations)))
    return Followed(0.0, nodes[:-1] + 0.5, np.array(accelerations), nodes, speeds, leader, 0.0)


def test_steps_of_a_plan_become_ramps_that_reach_its_speeds() -> None:
    target = plan_of([0.0, 1.0, 1.0, 0.0, -0.5], 15.0, None)
    speed, last, time_s, jerks, at = 15.0, 0.0, 0.0, [], {}
    while time_s < 4.0 - 1e-9:
        wanted = wanted_acceleration_m_s2(target, time_s, speed, None, last, STEP_S)
        jerks.append(abs(wanted - last) / STEP_S)
        last, speed, time_s = wanted, speed + wanted * STEP_S, time_s + STEP_S
        at[round(time_s, 2)] = speed
    assert max(jerks) <= LARGEST_JERK_M_S3 + 1e-9
    for node in (1.0, 2.0, 3.0, 4.0):
        assert at[node] == pytest.approx(float(target.speeds_m_s[int(node)]), abs=0.15)


def test_a_leader_that_brakes_between_two_decisions_is_met_at_once() -> None:
    leader = LeaderState(0.0, 40.0, 20.0)
    target = plan_of([0.0, 0.0, 0.0], 20.0, leader)
    for time_s, slower in ((0.3, 2.0), (0.6, 4.0)):
        now = LeaderState(time_s, 40.0 + 20.0 * time_s - 0.5 * slower * time_s, 20.0 - slower)
        braked = wanted_acceleration_m_s2(target, time_s, 20.0, now, -1.0, 1.0)
        assert braked <= -0.5 * slower
    faster = LeaderState(0.5, 50.5, 22.0)
    assert wanted_acceleration_m_s2(target, 0.5, 20.0, faster, 0.0, 1.0) == 0.0


def test_a_decision_without_a_plan_is_its_command() -> None:
    nothing = (np.empty(0), np.empty(0), np.empty(0))
    target = followed(5.0, nothing, Command(-1.0, 300.0), 20.0, None)
    assert target.compressor_power_w == 300.0
    assert wanted_acceleration_m_s2(target, 5.5, 19.5, None, -1.0, STEP_S) == pytest.approx(-1.0)


def test_position_and_ageing_are_integrated(vehicle: VehicleLink) -> None:
    """A minute at 20 m/s and 30 A, speeds at 100 Hz and the battery at 10 Hz, against the law by hand."""
    parameters = load_parameters(vehicle.parameter_set).values
    estimator, table = VehicleStateEstimator(parameters), SignalTable(vehicle.signals)
    for tick in range(6001):
        now_s = 0.01 * tick
        table.take({"speed_m_s": 20.0, "acceleration_m_s2": 0.0, "brake_pressed": 0.0}, now_s)
        if tick % 10 == 0:
            table.take({"pack_current_a": 30.0, "state_of_charge": 0.8}, now_s)
            table.take({"gap_m": 50.0, "relative_speed_m_s": -2.0, "target_valid": 1.0}, now_s)
        if tick % 100 == 0:
            table.take(
                {"lowest_cell_temperature_k": 300.0, "highest_cell_temperature_k": 305.0}, now_s
            )
        if tick % 2 == 0:
            estimator.update(table, now_s)
    observed = estimator.at_tick(table, 60.0, 60.0)
    assert observed is not None
    state = observed.state
    assert state.position_m == pytest.approx(1200.0, abs=1e-6)
    current_a = float(cell_current_a(30.0, parameters.pack))
    for loss, temperature_k in (
        (state.cell_1_capacity_loss, 300.0),
        (state.cell_n_capacity_loss, 305.0),
    ):
        start = parameters.aging.initial_capacity_loss
        rate = float(
            capacity_loss_rate_1_s(
                current_a, temperature_k, start, parameters.aging, parameters.cell
            )
        )
        assert loss - start == pytest.approx(60.0 * rate, rel=1e-3)
    leader = estimator.leader(table, 60.05)
    assert leader is not None
    # Seen 0.05 s ago, and closing in with 2 m/s.
    assert leader.position_m == pytest.approx(1200.0 + 50.0 - 0.1, abs=1e-6)
    assert leader.speed_m_s == pytest.approx(18.0)


def test_without_a_fresh_signal_there_is_no_state(vehicle: VehicleLink) -> None:
    parameters = load_parameters(vehicle.parameter_set).values
    estimator, table = VehicleStateEstimator(parameters), SignalTable(vehicle.signals)
    table.take({"speed_m_s": 20.0, "brake_pressed": 0.0, "pack_current_a": 10.0}, 0.0)
    assert estimator.at_tick(table, 0.05, 0.05) is None
    assert estimator.leader(table, 0.05) is None


def test_what_is_measured_after_a_tick_is_taken_back_to_it(vehicle: VehicleLink) -> None:
    """Braking with 2 m/s^2 from 20 m/s, seen 15 ms after the tick; 350 V and 40 A since the one before."""
    parameters = load_parameters(vehicle.parameter_set).values
    estimator, table = VehicleStateEstimator(parameters), SignalTable(vehicle.signals)
    for step in range(102):
        now_s = 9.0 + 0.01 * step
        speed = 20.0 - 2.0 * (now_s - 9.0)
        table.take({"speed_m_s": speed, "acceleration_m_s2": -2.0, "brake_pressed": 0.0}, now_s)
        table.take({"pack_voltage_v": 350.0, "pack_current_a": 40.0, "state_of_charge": 0.8}, now_s)
        table.take({"lowest_cell_temperature_k": 300.0, "highest_cell_temperature_k": 305.0}, now_s)
        estimator.update(table, now_s)
    observed = estimator.at_tick(table, 10.0, 10.015)
    assert observed is not None
    assert observed.state.time_s == 10.0
    assert observed.state.speed_m_s == pytest.approx(18.0 - 2.0 * 0.01 + 2.0 * 0.015)
    assert observed.state.position_m == pytest.approx(19.0, abs=0.02)
    assert observed.powers.battery_power_w == pytest.approx(14000.0)
    battery = estimator.battery(table, observed)
    assert battery.pack_current_a == 40.0
    assert 0.0 < battery.charge_ah < battery.capacity_ah < battery.design_capacity_ah


def test_the_lateness_of_any_number_of_steps_takes_one_size() -> None:
    """Percentiles agree with the sorted values within a bin, the largest is exact."""
    late, values = LateSteps(), np.random.default_rng(3).exponential(2e-3, 50_000)
    values[7] = 3.21
    for value in values:
        late.add(float(value))
    for percent in (50.0, 99.0, 99.9):
        exact_s = float(np.percentile(values, percent, method="inverted_cdf"))
        assert exact_s <= late.percentile_s(percent) <= exact_s + LateSteps.BIN_S
    assert late.largest_s == late.percentile_s(100.0) == late.take_recent_s() == 3.21
    assert late.take_recent_s() == 0.0
    assert sum(np.size(each) for each in vars(late).values()) < 11_000


def test_without_a_step_there_is_no_lateness() -> None:
    late = LateSteps()
    assert np.isnan(late.largest_s)
    assert np.isnan(late.percentile_s(99.0))


def test_a_log_keeps_the_newest_changes_and_counts_the_others() -> None:
    log = DriveLog()
    for number in range(KEPT_CHANGES + 7):
        log.note_change(float(number), Engagement())
    found = log.summary()
    times_s = [since_start_s for since_start_s, _, _ in found["changes"]]
    assert times_s == [float(number) for number in range(7, KEPT_CHANGES + 7)]
    assert found["changes_left_out"] == 7
