"""Cruise control and thermostat of production cars: by hand, in a string of cars, and in a controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    make_leader,
    make_scene,
    make_state,
    plain_solver,
)

from iptm_controller.controller import MpcController
from iptm_controller.options import ControllerOptions
from iptm_controller.production import (
    SIMPLE,
    ProductionLikeController,
    ProductionSettings,
    cruise_control_m_s2,
    eco_cruise_control_m_s2,
)
from iptm_controller.strategy import STRATEGIES, DrivingRules
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.errors import ParameterError
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.state import VehicleState

SETTINGS = ProductionSettings(**SIMPLE)
STANDSTILL_GAP_M = PARAMETERS.gap.standstill_gap_m


def acceleration(gap_m: float, speed_m_s: float, leader_m_s: float) -> float:
    state, leader = make_state(speed_m_s=speed_m_s), make_leader(gap_m, leader_m_s)
    return cruise_control_m_s2(state, leader, PARAMETERS, SETTINGS)


@pytest.mark.parametrize("speed_m_s", [0.0, 10.0, 30.0])
def test_the_equilibrium_is_the_standstill_gap_and_the_time_headway(speed_m_s: float) -> None:
    assert acceleration(STANDSTILL_GAP_M + 1.6 * speed_m_s, speed_m_s, speed_m_s) == pytest.approx(
        0.0
    )


def test_acceleration_by_hand() -> None:
    desired_m = STANDSTILL_GAP_M + 1.6 * 20.0
    # Too near by 2 m at equal speeds: 0.23 * -2. Too far by 10 m: 0.04 * 10, the gentler gains.
    assert acceleration(desired_m - 2.0, 20.0, 20.0) == pytest.approx(-0.46)
    assert acceleration(desired_m + 10.0, 20.0, 20.0) == pytest.approx(0.4)
    # A lead vehicle that is slower by 1 m/s at the desired gap: 0.8 * -1; one that is faster: 0.07 * 1.
    assert acceleration(desired_m, 20.0, 19.0) == pytest.approx(-0.8)
    assert acceleration(desired_m, 20.0, 21.0) == pytest.approx(0.07)


def test_acceleration_keeps_the_limits() -> None:
    limits = PARAMETERS.limits
    assert acceleration(500.0, 10.0, 20.0) == limits.max_acceleration_m_s2
    assert acceleration(1.0, 30.0, 10.0) == limits.min_acceleration_m_s2
    top = limits.max_speed_m_s
    assert acceleration(500.0, top - 1.0, top) == pytest.approx(0.4)


def test_a_string_of_constant_speed_settles_at_the_equilibrium_gaps() -> None:
    """Five cars behind a lead vehicle at 25 m/s, from wrong gaps and speeds, steps of 0.1 s."""
    positions = [0.0, -30.0, -80.0, -200.0, -220.0, -290.0]
    speeds = [25.0, 22.0, 28.0, 25.0, 20.0, 27.0]
    smallest_m = 1e3
    for _ in range(3000):
        wanted = [0.0] + [
            cruise_control_m_s2(
                make_state(position_m=positions[k], speed_m_s=speeds[k]),
                replace(make_leader(), position_m=positions[k - 1], speed_m_s=speeds[k - 1]),
                PARAMETERS,
                SETTINGS,
            )
            for k in range(1, 6)
        ]
        speeds = [max(v + 0.1 * a, 0.0) for v, a in zip(speeds, wanted, strict=True)]
        positions = [x + 0.1 * v for x, v in zip(positions, speeds, strict=True)]
        smallest_m = min(smallest_m, float(-np.diff(positions).max()))
    assert speeds == pytest.approx([25.0] * 6, abs=0.01)
    assert -np.diff(positions) == pytest.approx([STANDSTILL_GAP_M + 40.0] * 5, abs=0.05)
    assert smallest_m > STANDSTILL_GAP_M


def eco_acceleration(gap_m: float, speed_m_s: float, leader_m_s: float) -> float:
    state, leader = make_state(speed_m_s=speed_m_s), make_leader(gap_m, leader_m_s)
    return eco_cruise_control_m_s2(state, leader, PARAMETERS, SETTINGS, 1.0)


def test_the_strong_baseline_by_hand() -> None:
    desired_m = STANDSTILL_GAP_M + 3.5 * 20.0
    # Twenty metres beyond it: 0.002 * 20; a lead vehicle faster by 1 m/s: 0.12 * 1.
    assert eco_acceleration(desired_m + 20.0, 20.0, 20.0) == pytest.approx(0.04)
    assert eco_acceleration(desired_m + 20.0, 20.0, 21.0) == pytest.approx(0.16)
    # Five metres below s_max of 120 m: 0.05 * 15.
    assert eco_acceleration(115.0, 15.0, 15.0) == pytest.approx(0.75)
    assert eco_acceleration(8.0, 15.0, 10.0) == PARAMETERS.limits.min_acceleration_m_s2


@pytest.mark.parametrize("deceleration_m_s2", [0.5, 1.0, 1.5, 2.0])
def test_the_strong_baseline_keeps_s_min_behind_a_braking_leader(deceleration_m_s2: float) -> None:
    """From the equilibrium at 25 m/s to standstill, commands held for 1 s within the jerk limit."""
    limits, gap = PARAMETERS.limits, PARAMETERS.gap
    position, speed, own = 0.0, 25.0, 0.0
    leader_m, leader_m_s = STANDSTILL_GAP_M + 3.5 * 25.0, 25.0
    margins = []
    for _ in range(80):
        state = make_state(position_m=position, speed_m_s=speed, acceleration_m_s2=own)
        leader = make_leader(leader_m - position, leader_m_s)
        leader = replace(leader, position_m=leader_m)
        wanted = eco_cruise_control_m_s2(state, leader, PARAMETERS, SETTINGS, 1.0)
        own = min(max(wanted, own - limits.max_jerk_m_s3), own + limits.max_jerk_m_s3)
        slower = max(leader_m_s - deceleration_m_s2, 0.0)
        leader_m, leader_m_s = leader_m + 0.5 * (leader_m_s + slower), slower
        after = max(speed + own, 0.0)
        position, speed = position + 0.5 * (speed + after), after
        margins.append(leader_m - position - minimum_gap_m(speed, leader_m_s, gap, limits))
    assert speed < 0.5
    assert min(margins) > -0.1


def warm(warmest_c: float) -> VehicleState:
    warmest_k = warmest_c + 273.15
    return make_state(cell_1_temperature_k=warmest_k - 1.0, cell_n_temperature_k=warmest_k)


def test_thermostat_with_hysteresis() -> None:
    tuned, rules = ProductionSettings(), DrivingRules.PRODUCTION_SIMPLE
    controller = ProductionLikeController(PARAMETERS, tuned, rules=rules)
    half_w = 0.5 * PARAMETERS.limits.max_compressor_power_w
    expected = [
        (31.0, 0.0),
        (32.9, 0.0),
        (33.1, half_w),
        (31.0, half_w),
        (30.1, half_w),
        (29.9, 0.0),
        (31.0, 0.0),
        (33.1, half_w),
    ]
    for warmest_c, power_w in expected:
        command = controller.command(warm(warmest_c), make_leader())
        assert command.compressor_power_w == power_w


def test_tuned_and_simple_cars_differ_in_gains_and_thermostat() -> None:
    """A gap too short by 2 m at 20 m/s, and a pack of 31 degC."""
    leader = make_leader(STANDSTILL_GAP_M + 1.6 * 20.0 - 2.0, 20.0)
    state = replace(warm(31.0), speed_m_s=20.0)
    found = {}
    for rules in (DrivingRules.PRODUCTION, DrivingRules.PRODUCTION_SIMPLE):
        car = ProductionLikeController(PARAMETERS, ProductionSettings(), rules=rules)
        command = car.command(state, leader)
        found[rules] = command.acceleration_m_s2, command.compressor_power_w
    largest_w = PARAMETERS.limits.max_compressor_power_w
    assert found[DrivingRules.PRODUCTION] == pytest.approx((0.04 * -2.0, 0.26 * largest_w))
    assert found[DrivingRules.PRODUCTION_SIMPLE] == pytest.approx((0.23 * -2.0, 0.0))


def test_settings_out_of_order_or_range_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"thermostat_off_k is 310\.0; allowed: at most"):
        ProductionSettings(thermostat_off_k=310.0)
    with pytest.raises(ParameterError, match=r"acc_time_headway_s is 0\.1"):
        ProductionSettings(acc_time_headway_s=0.1)


def test_the_controller_drives_by_it_without_a_solve() -> None:
    options = ControllerOptions(strategy=STRATEGIES["production"])
    controller = MpcController(PARAMETERS, options, plain_solver("3x1+5x5"))
    desired_m = STANDSTILL_GAP_M + 1.6 * 15.0
    decision = controller.decide(make_scene(gap_m=desired_m))
    assert decision.rung is Rung.OPTIMAL
    assert decision.reason == ""
    assert decision.record.status is SolveStatus.NOT_POSED
    assert decision.plan is None
    assert decision.command.acceleration_m_s2 == pytest.approx(0.0)
    # 35 degC: the compressor starts, as fast as it may.
    assert decision.command.compressor_power_w == PARAMETERS.limits.max_compressor_rate_w_s
    resumed = MpcController(PARAMETERS, options, controller.backend)
    resumed.memory = controller.memory
    assert resumed.memory.is_cooling
    resumed.use_costs(replace(options, strategy=STRATEGIES["reference"]))
    assert resumed.decide(make_scene()).plan is not None


def test_without_a_lead_vehicle_it_falls_back_and_comes_back() -> None:
    options = ControllerOptions(strategy=STRATEGIES["production"])
    controller = MpcController(PARAMETERS, options, plain_solver("3x1+5x5"))
    controller.decide(make_scene())
    assert controller.decide(replace(make_scene(), leader=None)).rung is Rung.STOP
    assert controller.decide(make_scene()).rung is Rung.OPTIMAL
