"""The numbers of a problem: where they stand in the parameter vector and where they come from."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_forecaster, make_scene, make_state

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import (
    COLD_COMPRESSOR_PRICE_1_KW,
    REFERENCE_WINDOW_S,
    UNBOUNDED_W,
    ProblemData,
    ProblemDataBuilder,
)
from iptm_controller.ocp.grid import ProblemGrid, quadrature, sample_count
from iptm_controller.ocp.layout import GlobalIndex, SampleIndex, StepIndex
from iptm_controller.strategy import HEADWAY_PRICE_1_M2_S, strategy_by_name
from iptm_core.state import FloatArray, LeaderPreview, SlopePreview, VehicleState
from iptm_core.units import CELSIUS_ZERO_K

HORIZON = Horizon.parse("3x1+5x5")
FLAT = SlopePreview(np.zeros(1), np.zeros(1))


def steps_of(data: ProblemData, horizon: Horizon) -> list[tuple[FloatArray, FloatArray]]:
    """Cut the vector into each step's own parameters and its samples, one row each."""
    grid = ProblemGrid(horizon)
    vectors = [data.parameters[place] for place in grid.step_parameters]
    size = layout.STEP_PARAMETERS
    return [(v[:size], v[size:].reshape(-1, layout.SAMPLE_PARAMETERS)) for v in vectors]


def sample_times(horizon: Horizon) -> FloatArray:
    times = [
        start + quadrature(sample_count(float(length)))[0] * length
        for start, length in zip(horizon.node_times_s[:-1], horizon.step_lengths_s, strict=True)
    ]
    return np.concatenate(times)


def build(
    state: VehicleState,
    leader: LeaderPreview,
    slope: SlopePreview = FLAT,
    expected_m: FloatArray | None = None,
    horizon: Horizon = HORIZON,
    strategy: str = "reference_energy_aging",
) -> ProblemData:
    grid = ProblemGrid(horizon)
    builder = ProblemDataBuilder(grid, strategy_by_name(strategy), PARAMETERS)
    if expected_m is None:
        expected_m = state.position_m + state.speed_m_s * grid.sample_times_s
    return builder.build(state, leader, slope, expected_m)


@pytest.fixture
def steady() -> LeaderPreview:
    return LeaderPreview(np.array([0.0]), np.array([0.0]), np.array([10.5]))


def test_globals(steady: LeaderPreview) -> None:
    data = build(make_state(cell_1_capacity_loss=2e-3, cell_n_capacity_loss=3e-3), steady)
    expected = {
        GlobalIndex.CELL_1_LOSS: 2e-3,
        GlobalIndex.CELL_N_LOSS: 3e-3,
        GlobalIndex.REFERENCE_TEMPERATURE: 299.15,
        GlobalIndex.LOWEST_TEMPERATURE: 298.25,
        GlobalIndex.CHARGE_POWER: UNBOUNDED_W,
        GlobalIndex.HEADWAY_PRICE: HEADWAY_PRICE_1_M2_S,
        layout.WEIGHTS["speed_weight"]: 0.5,
        layout.WEIGHTS["temperature_weight"]: 0.1,
        layout.WEIGHTS["energy_weight_1_j"]: 1e-4,
        layout.WEIGHTS["aging_weight"]: 1e8,
    }
    for index in range(layout.GLOBALS):
        assert data.parameters[index] == expected.get(index, 0.0)


def test_initial_state_is_scaled_and_starts_at_position_zero(steady: LeaderPreview) -> None:
    state = make_state(acceleration_m_s2=-0.7, compressor_power_w=1250.0)
    data = build(state, steady)
    np.testing.assert_allclose(
        data.initial_state, [0.0, 15.0, 4.0, 5.0, -0.7, 1.25], rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("strategy", "cells_c", "lowest_c", "may_cool"),
    [
        ("aging", (25.1, 29.1), 25.1, True),
        ("aging", (24.5, 29.1), 24.45, False),
        ("aging_cost_to_go", (25.1, 29.1), 23.1, True),  # the mean is 2 K above the first cell
        ("aging_cost_to_go", (24.5, 26.5), 24.1, True),  # 1 K
        ("aging_cost_to_go", (24.0, 26.0), 23.95, False),  # the mean is at the limit
        ("aging_cost_to_go", (23.0, 30.0), 22.95, False),  # a cell is 2 K below it
        ("prices", (23.2, 30.0), 23.1, True),
    ],
)
def test_the_lower_temperature_limit(
    strategy: str,
    cells_c: tuple[float, float],
    lowest_c: float,
    *,
    may_cool: bool,
    steady: LeaderPreview,
) -> None:
    """Of the paper's strategies for each cell; of the default for the mean, with 2 K less for a cell."""
    first_k, last_k = (celsius + CELSIUS_ZERO_K for celsius in cells_c)
    state = make_state(cell_1_temperature_k=first_k, cell_n_temperature_k=last_k)
    shared = build(state, steady, strategy=strategy).parameters
    lowest_k = shared[GlobalIndex.LOWEST_TEMPERATURE]
    assert lowest_k - CELSIUS_ZERO_K == pytest.approx(lowest_c, abs=1e-6)
    price = shared[GlobalIndex.COMPRESSOR_PRICE]
    assert price == pytest.approx(0.0 if may_cool else COLD_COMPRESSOR_PRICE_1_KW)


def test_leader_at_the_end_of_every_step() -> None:
    """Off by one here would mean a gap to where the leader was, or will be, a step away."""
    measured = make_scene(leader_acceleration_m_s2=-0.5, gap_m=40.0)
    motion = make_forecaster().forecast(measured.leader, measured.preview).motion
    state = make_state()
    for (own, _), time in zip(
        steps_of(build(state, motion), HORIZON), HORIZON.node_times_s[1:], strict=True
    ):
        assert own[StepIndex.LEADER_POSITION] == pytest.approx(40.0 + 15.0 * time - 0.25 * time**2)
        assert own[StepIndex.LEADER_SPEED] == pytest.approx(15.0 - 0.5 * time)


def test_rates_count_between_the_middles_of_two_steps(steady: LeaderPreview) -> None:
    data = build(make_state(), steady)
    intervals = [own[StepIndex.ACCELERATION_INTERVAL] for own, _ in steps_of(data, HORIZON)]
    assert intervals == [1.0, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0, 5.0]
    intervals = [own[StepIndex.COMPRESSOR_INTERVAL] for own, _ in steps_of(data, HORIZON)]
    assert intervals == [1.0, 1.0, 1.0, 1.75, 5.0, 5.0, 5.0, 5.0]


def test_a_change_into_a_long_step_has_to_happen_soon(steady: LeaderPreview) -> None:
    """The acceleration as in steps of 1 s, or as long as the one before; between equal steps in full."""
    horizon = Horizon.parse("2x1+2x2+2x15")
    data = build(make_state(), steady, horizon=horizon)
    intervals = [own[StepIndex.ACCELERATION_INTERVAL] for own, _ in steps_of(data, horizon)]
    assert intervals == [1.0, 1.0, 1.0, 2.0, 2.0, 15.0]
    intervals = [own[StepIndex.COMPRESSOR_INTERVAL] for own, _ in steps_of(data, horizon)]
    assert intervals == [1.0, 1.0, 1.5, 2.0, 2.25, 15.0]


def test_the_leader_is_known_at_every_sample(steady: LeaderPreview) -> None:
    data = build(make_state(), steady)
    times = sample_times(HORIZON)
    samples = np.vstack([own for _, own in steps_of(data, HORIZON)])
    position, speed = steady.at(make_state().time_s + times)
    np.testing.assert_allclose(
        samples[:, SampleIndex.LEADER_POSITION], position - make_state().position_m
    )
    np.testing.assert_allclose(samples[:, SampleIndex.LEADER_SPEED], speed)


@pytest.mark.parametrize(
    ("known_s", "node"),
    [(0.0, 0), (1.0, 0), (2.9, 1), (3.0, 2), (12.0, 3), (28.0, 7), (math.inf, 7)],
)
def test_braking_reserve_is_asked_for_no_later_than_the_leader_is_known(
    steady: LeaderPreview, known_s: float, node: int
) -> None:
    grid = ProblemGrid(HORIZON)
    builder = ProblemDataBuilder(grid, strategy_by_name("aging"), PARAMETERS)
    expected_m = np.zeros(grid.sample_times_s.size)
    flat = SlopePreview(np.zeros(1), np.zeros(1))
    data = builder.build(make_state(), steady, flat, expected_m, known_s)
    asked = [own[StepIndex.END_OF_PREVIEW] for own, _ in steps_of(data, HORIZON)]
    assert asked == [float(index == node) for index in range(HORIZON.steps)]


def test_reference_is_the_mean_speed_over_the_last_two_seconds() -> None:
    """Seen from every sample: partly measured past, partly prediction."""
    times = np.arange(97.0, 131.0)
    speeds = 12.0 + 4.0 * np.sin(times / 3.0)
    positions = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    data = build(make_state(), LeaderPreview(times, 1040.0 + positions, speeds))
    found = np.concatenate([s[:, SampleIndex.SPEED_REFERENCE] for _, s in steps_of(data, HORIZON)])
    for reference, sample in zip(found, 100.0 + sample_times(HORIZON), strict=True):
        fine = np.linspace(sample - REFERENCE_WINDOW_S, sample, 20001)
        assert reference == pytest.approx(np.mean(np.interp(fine, times, speeds)), abs=1e-4)


def test_slope_is_expanded_where_the_ego_is_expected(steady: LeaderPreview) -> None:
    """A road of the second degree comes back exactly, wherever the ego vehicle then is."""
    nodes = np.arange(0.0, 3000.0, 5.0)

    def road(position: FloatArray) -> FloatArray:
        from_here = position - 1200.0
        return 0.02 + 1e-4 * from_here - 2e-7 * from_here**2

    state = make_state()
    expected = np.round((1000.0 + 14.0 * sample_times(HORIZON)) / 5.0) * 5.0
    data = build(state, steady, SlopePreview(nodes, road(nodes)), expected)
    samples = np.concatenate([samples for _, samples in steps_of(data, HORIZON)])
    np.testing.assert_allclose(samples[:, SampleIndex.POSITION], expected - 1000.0)
    np.testing.assert_allclose(samples[:, SampleIndex.SLOPE], road(expected), atol=1e-12)
    for away in (-20.0, 20.0):
        expanded = samples[:, SampleIndex.SLOPE] + away * (
            samples[:, SampleIndex.SLOPE_GRADIENT]
            + 0.5 * away * samples[:, SampleIndex.SLOPE_CURVATURE]
        )
        np.testing.assert_allclose(expanded, road(expected + away), atol=1e-9)


def test_only_relative_positions_count() -> None:
    """Far along the road the same situation gives the same numbers."""
    road = SlopePreview(np.arange(0.0, 4000.0, 10.0), np.sin(np.arange(400) / 7.0) / 20.0)
    here = make_scene(slope=road)
    far = make_scene(
        slope=replace(road, positions_m=road.positions_m + 1e5), position_m=1000.0 + 1e5
    )
    numbers = []
    for measured in (here, far):
        forecast = make_forecaster().forecast(measured.leader, measured.preview)
        numbers.append(build(measured.state, forecast.motion, measured.slope).parameters)
    np.testing.assert_allclose(numbers[0], numbers[1], rtol=0.0, atol=1e-8)
