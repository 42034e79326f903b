"""Thermal steps: true to the exact model over their length, and the traction powers foreseen for them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.iptm_controller.scenes import PARAMETERS, SCENES, checking_solver, make_scene, make_state

from iptm_controller.controller import MpcController
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.node_reports import plan_trajectory
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import POWER_LEVELS, ProblemGrid
from iptm_controller.ocp.layout import GlobalIndex, LimitIndex, StepIndex, ThermalSampleIndex
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.ocp.stages import build_thermal_stage
from iptm_controller.options import ControllerOptions
from iptm_controller.traction_forecast import TractionForecaster
from iptm_core.decision_record import Rung
from iptm_core.physics.cell import capacity_loss_rate_1_s
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.power_thermal import (
    CellPair,
    electric_traction_power_w,
    rates_at_traction_power,
)
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import FloatArray, LeaderPreview, SlopePreview

GRID = "3x1+5x5+6x30t"
AGING_WEIGHT = 1e9


def run_step(
    step_s: float, cells_k: tuple[float, float], power_w: float, traction_w: FloatArray
) -> tuple[FloatArray, float, FloatArray]:
    """Return cell temperatures at the end of a thermal step, its aging cost, and its rows."""
    stage = build_thermal_stage(step_s, POWER_LEVELS, SymbolicModel.literal(PARAMETERS))
    function = ca.Function(
        "step",
        [stage.state, stage.inputs, stage.step_parameters, stage.global_parameters],
        [stage.next_state, stage.cost, stage.limits],
    )
    state = np.array([0.0, 20.0, *cells_k, 0.0, power_w])
    samples = np.zeros((POWER_LEVELS, layout.SAMPLE_PARAMETERS))
    samples[:, 0], samples[:, 1] = traction_w, 20.0
    shared = np.zeros(layout.GLOBALS)
    shared[[GlobalIndex.CELL_1_LOSS, GlobalIndex.CELL_N_LOSS]] = 1e-3
    shared[layout.WEIGHTS["aging_weight"]] = AGING_WEIGHT
    shared[GlobalIndex.REFERENCE_TEMPERATURE] = 299.15
    own = np.zeros(layout.STEP_PARAMETERS)
    own[StepIndex.COMPRESSOR_INTERVAL] = step_s
    following, cost, rows = function(
        (state - layout.STATE_OFFSET) / layout.STATE_SCALE,
        np.array([0.0, power_w, 0.0, 0.0, 0.0, 0.0]) / layout.INPUT_SCALE,
        np.concatenate([own, samples.ravel()]),
        shared,
    )
    physical = following.full().ravel() * layout.STATE_SCALE + layout.STATE_OFFSET
    return physical[2:4], float(cost), rows.full().ravel()


def integrate(
    step_s: float, cells_k: tuple[float, float], power_w: float, traction_w: FloatArray
) -> tuple[FloatArray, float]:
    """Integrate the exact model finely, the powers in turns of a tenth of a second."""
    channel = reduce_channel(PARAMETERS.cooling, PARAMETERS.pack)
    now, lost, dt = np.array(cells_k), 0.0, 0.1
    for index in range(round(step_s / dt)):
        rates = rates_at_traction_power(
            float(traction_w[index % traction_w.size]),
            20.0, power_w, CellPair(*now, 1e-3, 1e-3), PARAMETERS, channel,
        )  # fmt: skip
        change = [rates.cell_1_temperature_rate_k_s, rates.cell_n_temperature_rate_k_s]
        now = now + dt * np.array(change)
        lost += dt * (rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s)
    return now, AGING_WEIGHT * lost


def smoothed_aging(temperature_k: float, step_s: float) -> float:
    """Return the cost of aging both cells by the current that the smoothed kinks add at rest, at most."""
    pack, smoothing = PARAMETERS.pack, DEFAULT_SMOOTHING
    by_power_a = 0.5 * smoothing.power_w / (pack.open_circuit_voltage_v * pack.parallel)
    rate = capacity_loss_rate_1_s(
        smoothing.c_rate_1_h * PARAMETERS.cell.nominal_capacity_ah + by_power_a,
        temperature_k,
        1e-3,
        PARAMETERS.aging,
        PARAMETERS.cell,
    )
    return 2.0 * AGING_WEIGHT * float(rate) * step_s


@settings(max_examples=25)
@given(
    step_s=st.sampled_from([15.0, 30.0]),
    cell_1=st.floats(298.15, 312.0),
    spread=st.floats(0.0, 4.0),
    power_w=st.one_of(st.just(0.0), st.floats(600.0, 3000.0)),
    traction_w=st.lists(st.floats(-20e3, 40e3), min_size=3, max_size=3),
)
def test_a_step_is_as_good_as_many_small_ones(
    step_s: float, cell_1: float, spread: float, power_w: float, traction_w: list[float]
) -> None:
    """Temperatures within 3 % of their change; aging within 2 % and what the smoothed |I| adds at rest."""
    powers = np.sort(np.array(traction_w))
    cells = (cell_1, cell_1 + spread)
    found, cost, _ = run_step(step_s, cells, power_w, powers)
    exact, exact_cost = integrate(step_s, cells, power_w, powers)
    np.testing.assert_allclose(found, exact, atol=0.03 + 0.03 * np.abs(exact - cells).max())
    assert cost == pytest.approx(exact_cost, rel=0.02, abs=smoothed_aging(max(cells), step_s))


def test_averaging_the_power_would_be_wrong() -> None:
    """Levels of 40, 0 and -10 kW age more than their mean of 10 kW does: what the levels are for."""
    _, levels, _ = run_step(30.0, (300.0, 301.0), 0.0, np.array([-10e3, 0.0, 40e3]))
    _, mean, _ = run_step(30.0, (300.0, 301.0), 0.0, np.full(3, 10e3))
    assert levels > 1.3 * mean


def test_thermal_rows_do_not_constrain_the_motion() -> None:
    _, _, rows = run_step(30.0, (300.0, 301.0), 0.0, np.zeros(3))
    assert (rows[LimitIndex.GAP_MIN : LimitIndex.SPEED_MAX + 1] == 1.0).all()
    assert rows[LimitIndex.ACCELERATION_RATE] == 0.0


@pytest.fixture(scope="module")
def controller() -> MpcController:
    options = ControllerOptions(horizon=Horizon.parse(GRID))
    return MpcController(PARAMETERS, options, checking_solver(GRID))


@pytest.mark.parametrize("name", sorted(SCENES))
def test_a_thermal_phase_leaves_the_driving_alone(controller: MpcController, name: str) -> None:
    measured: Measurements = SCENES[name]
    decision = controller.decide(measured)
    assert decision.rung is Rung.OPTIMAL
    assert decision.reason == ""
    short = MpcController(PARAMETERS, ControllerOptions(), checking_solver()).decide(measured)
    assert decision.command.acceleration_m_s2 == pytest.approx(
        short.command.acceleration_m_s2, abs=0.15
    )


def test_the_published_plan_ends_with_the_motion(controller: MpcController) -> None:
    decision = controller.decide(make_scene())
    trajectory = plan_trajectory(decision.plan)
    assert trajectory.times_s[-1] - trajectory.times_s[0] == pytest.approx(28.0)
    assert decision.plan.node_times_s[-1] == pytest.approx(208.0)
    assert len(trajectory.positions_m) == len(trajectory.compressor_powers_w) == 9


FLAT = SlopePreview(np.zeros(1), np.zeros(1))
STEPS = 4


def forecaster() -> TractionForecaster:
    return TractionForecaster(PARAMETERS, ProblemGrid(Horizon.parse(f"3x1+5x5+{STEPS}x30t")))


def powers(samples: FloatArray) -> FloatArray:
    return samples[:, ThermalSampleIndex.TRACTION_POWER].reshape(STEPS, POWER_LEVELS)


def cruise_power_w(speed_m_s: float) -> float:
    return float(electric_traction_power_w(speed_m_s, 0.0, 0.0, PARAMETERS))


def steady(speed_m_s: float) -> LeaderPreview:
    times = np.arange(100.0, 500.0)
    positions = 1060.0 + speed_m_s * (times - 100.0)
    return LeaderPreview(times, positions, np.full(times.size, speed_m_s))


def test_behind_a_steady_leader_the_ego_cruises() -> None:
    own = forecaster()
    state = make_state(speed_m_s=25.0)
    own.remember(state, FLAT)
    samples = own.samples(state, steady(25.0), 300.0, FLAT)
    np.testing.assert_allclose(powers(samples), cruise_power_w(25.0), rtol=1e-6)
    np.testing.assert_allclose(samples[:, ThermalSampleIndex.SPEED], 25.0)


def test_a_hill_counts_when_the_ego_vehicle_is_on_it_not_the_leader() -> None:
    """The second thermal step is 58 to 88 s ahead; the ego vehicle is 60 m behind."""
    own, rise_rad = forecaster(), 0.03
    state = make_state(speed_m_s=25.0)
    edges_m = 1000.0 + 25.0 * np.array([58.0, 88.0])
    places = np.array([edges_m[0] - 1e-3, edges_m[0], edges_m[1], edges_m[1] + 1e-3])
    hill = SlopePreview(places, np.array([0.0, rise_rad, rise_rad, 0.0]))
    own.remember(state, hill)
    found = powers(own.samples(state, steady(25.0), 300.0, hill))
    uphill_w = float(electric_traction_power_w(25.0, 0.0, rise_rad, PARAMETERS))
    np.testing.assert_allclose(found[1], uphill_w, rtol=1e-6)
    np.testing.assert_allclose(found[[0, 2, 3]], cruise_power_w(25.0), rtol=1e-6)


def test_beyond_the_preview_the_trip_so_far_counts() -> None:
    """Two thirds of the time at 10 m/s, one third at 30: the levels are those powers."""
    own = forecaster()
    for tick, speed in enumerate([10.0, 10.0, 30.0] * 20):
        own.remember(make_state(time_s=float(tick), speed_m_s=speed), FLAT)
    state = make_state(time_s=100.0, speed_m_s=25.0)
    # The preview ends inside of the second thermal step, 58 to 88 s ahead.
    samples = own.samples(state, steady(25.0), 60.0, FLAT)
    found = powers(samples)
    np.testing.assert_allclose(found[0], cruise_power_w(25.0), rtol=1e-6)
    usual = [cruise_power_w(10.0), cruise_power_w(10.0), cruise_power_w(30.0)]
    for step in range(1, STEPS):
        np.testing.assert_allclose(found[step], usual, rtol=1e-9)
    assert samples[-1, ThermalSampleIndex.SPEED] == pytest.approx(50.0 / 3.0)


def test_a_stop_of_the_leader_is_smoothed() -> None:
    """Speeds change over the window, not at once; what is averaged keeps the way."""
    times = np.arange(100.0, 500.0)
    speeds = np.where((times > 160.0) & (times < 175.0), 5.0, 20.0)
    positions = 1060.0 + np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    own = forecaster()
    state = make_state(speed_m_s=20.0)
    own.remember(state, FLAT)
    found = own.samples(state, LeaderPreview(times, positions, speeds), 399.0, FLAT)
    average = found[:, ThermalSampleIndex.SPEED].reshape(STEPS, POWER_LEVELS)[:, 0]
    assert (average > 14.0).all()
    assert average[1] < 18.0
    assert average[-1] == pytest.approx(20.0, abs=0.01)


def test_hills_count_where_the_ego_will_be() -> None:
    own = forecaster()
    state = make_state(speed_m_s=25.0)
    own.remember(state, FLAT)
    flat = powers(own.samples(state, steady(25.0), 300.0, FLAT))
    # Uphill from 2000 m behind the ego vehicle on: reached after 80 s, in the second thermal step.
    climb = SlopePreview(
        state.position_m + np.array([0.0, 2000.0, 2001.0, 9000.0]), np.array([0.0, 0.0, 0.03, 0.03])
    )
    hilly = powers(own.samples(state, steady(25.0), 300.0, climb))
    np.testing.assert_allclose(hilly[0], flat[0])
    assert hilly[1][0] == pytest.approx(flat[1][0])
    assert (hilly[2:] > flat[2:] + 5e3).all()


def test_an_earlier_state_forgets_the_trip() -> None:
    own = forecaster()
    for tick in range(30):
        own.remember(make_state(time_s=100.0 + tick, speed_m_s=30.0), FLAT)
    state = make_state(time_s=0.0, speed_m_s=10.0)
    own.remember(state, FLAT)
    found = powers(own.samples(state, steady(10.0), 0.0, FLAT))
    np.testing.assert_allclose(found, cruise_power_w(10.0))
