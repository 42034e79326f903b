"""One step of the problem against its definition; the horizon as one nonlinear program."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from studies.speed.transcription import Transcription
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    exact_rates,
    make_state,
    plain_solver,
    problem_of,
    run_stage,
    transcription_of,
)

from iptm_controller.ocp.data import UNBOUNDED_W
from iptm_controller.ocp.grid import quadrature, sample_count
from iptm_controller.ocp.layout import LimitIndex, StateIndex
from iptm_controller.ocp.stage import DEFAULT_PENALTIES, INACTIVE_ROW_M
from iptm_controller.ocp.stages import GAP_SMOOTHING_M
from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters, PackLimitParameters
from iptm_core.state import FloatArray

STEP_LENGTHS = st.sampled_from([0.2, 1.0, 2.0, 5.0, 10.0])


@settings(max_examples=50)
@given(
    speed=st.floats(0.0, 37.5),
    acceleration=st.floats(-2.0, 2.0),
    power=st.floats(0.0, 4500.0),
    step_s=STEP_LENGTHS,
)
def test_motion_is_exact_and_inputs_are_remembered(
    speed: float, acceleration: float, power: float, step_s: float
) -> None:
    state = make_state(speed_m_s=speed)
    following, _, _ = run_stage(state, acceleration, power, step_s)
    moved = speed * step_s + 0.5 * acceleration * step_s**2
    assert following[StateIndex.POSITION] == pytest.approx(state.position_m + moved, abs=1e-9)
    assert following[StateIndex.SPEED] == pytest.approx(speed + acceleration * step_s, abs=1e-9)
    assert following[StateIndex.LAST_ACCELERATION] == pytest.approx(acceleration)
    assert following[StateIndex.LAST_COMPRESSOR_POWER] == pytest.approx(power)


def test_cost_terms_far_from_the_kinks() -> None:
    """Each term alone, on a steady stretch where one sample is exact."""
    state = make_state(speed_m_s=25.0, cell_1_temperature_k=305.0, cell_n_temperature_k=309.0)
    rates = exact_rates(state, 0.0, 800.0)

    def cost(*weights: float) -> float:
        return run_stage(state, 0.0, 800.0, 1.0, weights, speed_reference_m_s=22.0)[1]

    assert cost(2.0, 0.0, 0.0, 0.0) == pytest.approx(2.0 * 3.0**2)
    in_j2 = (305.0 - 299.15) ** 2 + (309.0 - 299.15) ** 2
    assert cost(0.0, 0.1, 0.0, 0.0) == pytest.approx(0.1 * in_j2)
    assert cost(0.0, 0.0, 1e-3, 0.0) == pytest.approx(1e-3 * rates.battery_power_w, rel=1e-2)
    loss_rate = rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s
    assert cost(0.0, 0.0, 0.0, 1e9) == pytest.approx(1e9 * loss_rate, rel=1e-2)
    assert cost(2.0, 0.1, 1e-3, 1e9) == pytest.approx(
        cost(2.0, 0, 0, 0) + cost(0, 0.1, 0, 0) + cost(0, 0, 1e-3, 0) + cost(0, 0, 0, 1e9)
    )


@pytest.mark.parametrize("acceleration", [-1.2, 0.7])
def test_energy_spent_is_less_by_what_the_motion_gains(acceleration: float) -> None:
    """Over a second from 20 m/s: half of the mass, rotating parts included, times the gain of v squared."""
    state = make_state(speed_m_s=20.0)
    of_battery, spent = (
        run_stage(state, acceleration, 0.0, 1.0, weights)[1]
        for weights in ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0, 1.0))
    )
    gained_j = 0.5 * 1432.0 * 1.022 * ((20.0 + acceleration) ** 2 - 20.0**2)
    assert of_battery - spent == pytest.approx(gained_j, rel=1e-9)


@pytest.mark.parametrize("charge_w", [0.0, 1000.0, 8000.0])
def test_no_more_is_regenerated_than_the_pack_takes(charge_w: float) -> None:
    """20 m/s and -1.5 m/s^2 feed back 30 kW: the terminals take what they can, friction brakes the rest."""
    car = load_parameters("bmw_i3").values

    def cost_rate(model: ModelParameters, most_w: float, *weights: float) -> float:
        state = make_state(speed_m_s=20.0)
        return run_stage(state, -1.5, 0.0, 0.2, weights, model=model, charge_w=most_w)[1] / 0.2

    def regenerated_w(model: ModelParameters, most_w: float = UNBOUNDED_W) -> float:
        return -cost_rate(model, most_w, 0.0, 0.0, 1.0, 0.0)

    free = replace(car, pack_limits=PackLimitParameters())
    assert regenerated_w(free) > 25e3
    assert regenerated_w(car) == regenerated_w(free) == regenerated_w(free, charge_w)
    assert regenerated_w(car, charge_w) == pytest.approx(charge_w, abs=100.0)
    # Ageing does not reward braking by friction.
    aging = (0.0, 0.0, 0.0, 1e9)
    assert cost_rate(car, charge_w, *aging) == pytest.approx(
        cost_rate(free, charge_w, *aging), rel=1e-12
    )


def test_slacks_cost_their_penalty_per_second() -> None:
    penalties = (
        DEFAULT_PENALTIES.gap_short_1_m,
        DEFAULT_PENALTIES.gap_long_1_m,
        DEFAULT_PENALTIES.speed_1_m_s,
        DEFAULT_PENALTIES.temperature_1_k,
    )
    for step_s in (1.0, 5.0):
        for index, penalty in enumerate(penalties):
            slacks = np.zeros(4)
            slacks[index] = 2.0
            _, cost, _ = run_stage(make_state(), 0.0, 0.0, step_s, slacks=tuple(slacks))
            assert cost == pytest.approx(2.0 * penalty * step_s)


@settings(max_examples=60)
@given(
    speed=st.floats(2.0, 37.5),
    leader_speed=st.floats(0.0, 37.5),
    gap=st.floats(0.0, 150.0),
    acceleration=st.floats(-2.0, 2.0),
    power=st.floats(0.0, 4500.0),
    last=st.tuples(st.floats(-2.0, 2.0), st.floats(0.0, 4500.0)),
    slacks=st.tuples(*[st.floats(0.0, 5.0)] * 4),
    step_s=st.sampled_from([1.0, 2.0]),
)
def test_limits_are_those_of_the_paper(
    speed: float,
    leader_speed: float,
    gap: float,
    acceleration: float,
    power: float,
    last: tuple[float, float],
    slacks: tuple[float, float, float, float],
    step_s: float,
) -> None:
    limits, policy = PARAMETERS.limits, PARAMETERS.gap
    state = make_state(speed_m_s=speed, acceleration_m_s2=last[0], compressor_power_w=last[1])
    leader_m = state.position_m + gap
    following, _, rows = run_stage(
        state, acceleration, power, step_s, slacks=slacks, leader=(leader_m, leader_speed)
    )
    short, far, fast, warm = slacks
    position, end_speed, cell_1, cell_n = following[:4]
    braking = 2.0 * math.sqrt(-limits.min_acceleration_m_s2 * limits.max_acceleration_m_s2)
    shortest = (
        policy.standstill_gap_m
        + policy.time_headway_s * end_speed
        + end_speed * (end_speed - leader_speed) / braking
    )
    expected = {
        LimitIndex.ACCELERATION_RATE: (acceleration - last[0]) / (limits.max_jerk_m_s3 * step_s),
        LimitIndex.COMPRESSOR_RATE: (power - last[1]) / (limits.max_compressor_rate_w_s * step_s),
        LimitIndex.GAP_MIN: leader_m - position - shortest + short,
        LimitIndex.GAP_FLOOR: leader_m - position - policy.standstill_gap_m + short,
        LimitIndex.GAP_BRAKING: INACTIVE_ROW_M + short,
        LimitIndex.GAP_MAX: policy.max_gap_m - (leader_m - position) + far,
        LimitIndex.SPEED_MIN: end_speed - limits.min_speed_m_s + fast,
        LimitIndex.SPEED_MAX: limits.max_speed_m_s - end_speed + fast,
        LimitIndex.CELL_1_MAX: limits.max_temperature_k - cell_1 + warm,
        LimitIndex.CELL_N_MAX: limits.max_temperature_k - cell_n + warm,
    }
    for index, value in expected.items():
        assert rows[index] == pytest.approx(value, rel=1e-9, abs=1e-8), index.name


@pytest.mark.parametrize(
    ("speed", "acceleration", "leader_speed", "expected"),
    [
        # Brakes build up in 4 s over 74.67 m to 16 m/s; the leader, 17.8 m/s after its surprise, is then
        # at 9.8 m/s. It stands after 79.21 m, with 6.2 m/s left for the ego vehicle, who then has covered
        # 74.67 + (16^2 - 6.2^2) / 4 = 129.06 m; s_min is 5 + 9.3 + 9.61 m.
        (20.0, 0.0, 20.0, 100.0 + 79.21 - 129.06 - 23.91),
        # Tightest at the end of the build-up: 114.67 m to 26 m/s, the leader 99.2 m to 20.8 m/s; s_min
        # is 5 + 39 + 33.8 m.
        (30.0, 0.0, 31.0, 100.0 + 99.2 - 114.6667 - 77.8),
        # Full braking already: both at -2 m/s^2 from 20 and 12.8 m/s, so the leader stands first, after
        # 40.96 m. The ego vehicle has then 7.2 m/s left and came from 20 m/s in 87.04 m; s_min is 28.76 m.
        (20.0, -2.0, 15.0, 100.0 + 40.96 - 87.04 - 28.76),
        # Accelerating at 1 m/s^2 behind a standing leader: 6 s, 60 m, 7 m/s; s_min is 27.75 m.
        (10.0, 1.0, 0.0, 100.0 - 60.0 - 27.75),
    ],
)
def test_braking_reserve_at_the_end_of_the_horizon(
    speed: float, acceleration: float, leader_speed: float, expected: float
) -> None:
    """Counts from where the step ends, with the acceleration that it held."""
    before = make_state(speed_m_s=speed - acceleration, acceleration_m_s2=acceleration)
    leader_m = before.position_m + speed - 0.5 * acceleration + 100.0
    slacks = (3.0, 0.0, 0.0, 0.0)
    _, _, rows = run_stage(
        before, acceleration, 0.0, 1.0,
        slacks=slacks, leader=(leader_m, leader_speed), end_of_horizon=True,
    )  # fmt: skip
    assert rows[LimitIndex.GAP_BRAKING] == pytest.approx(expected + slacks[0], abs=0.3)


def test_outlet_is_that_of_the_coolant_loop() -> None:
    state = make_state(speed_m_s=20.0)
    _, _, rows = run_stage(state, 0.0, 1500.0, 1.0)
    rates = exact_rates(state, 0.0, 1500.0)
    outlet_k = PARAMETERS.limits.max_temperature_k - rows[LimitIndex.OUTLET_MAX]
    assert outlet_k == pytest.approx(rates.coolant.outlet_k, abs=1e-3)


@pytest.mark.parametrize(("step_s", "watched"), [(2.0, False), (5.0, True), (10.0, True)])
def test_the_gap_inside_a_long_step_counts(step_s: float, watched: bool) -> None:
    """The ego vehicle comes closer and falls back again: least in the middle, the same gap at both ends."""
    leader_speed, acceleration = 10.0, -1.0
    speed = leader_speed - 0.5 * acceleration * step_s
    state = make_state(speed_m_s=speed)
    gap = 40.0
    leader_m = state.position_m + gap + leader_speed * step_s
    _, _, limits = run_stage(state, acceleration, 0.0, step_s, leader=(leader_m, leader_speed))
    times = quadrature(sample_count(step_s))[0] * step_s
    inside = gap + (leader_speed - speed) * times - 0.5 * acceleration * times**2
    floor = (inside.min() if watched else gap) - PARAMETERS.gap.standstill_gap_m
    # The smooth minimum is strict by up to half of its width per sample.
    assert (
        floor - 0.5 * GAP_SMOOTHING_M * times.size <= limits[LimitIndex.GAP_FLOOR] <= floor + 1e-9
    )
    if not watched:
        assert limits[LimitIndex.GAP_FLOOR] == pytest.approx(floor)


def test_cell_1_below_its_lowest_temperature_costs_more_than_the_price_of_a_kelvin() -> None:
    """0.5 K below for 5 s at a price of 8 per kelvin: (1 + 0.5 * 8) * 0.5 K * 5 s; no row, no slack."""
    state = make_state(cell_1_temperature_k=300.0, cell_n_temperature_k=300.0, speed_m_s=20.0)
    prices = (2.0, 6.0, 0.0)
    following, free, rows = run_stage(state, 0.0, 0.0, 5.0, prices=prices)
    _, cost, same_rows = run_stage(
        state, 0.0, 0.0, 5.0, prices=prices, lowest_k=float(following[2]) + 0.5
    )
    assert cost - free == pytest.approx(5.0 * 0.5 * 5.0, rel=1e-3)
    np.testing.assert_array_equal(rows, same_rows)


def test_prices_count_the_change_of_each_cell_and_the_running_compressor() -> None:
    state = make_state(speed_m_s=20.0)
    following, base, _ = run_stage(state, 0.0, 1000.0, 1.0)
    _, cost, _ = run_stage(state, 0.0, 1000.0, 1.0, prices=(3.0, 7.0, 11.0))
    change_1 = following[2] - state.cell_1_temperature_k
    change_n = following[3] - state.cell_n_temperature_k
    assert cost - base == pytest.approx(3.0 * change_1 + 7.0 * change_n + 11.0, rel=1e-6)


@pytest.fixture(params=["2x1+2x5", "3x1", "1x0.5+1x1+2x10"])
def grid(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def transcription(grid: str) -> Transcription:
    return transcription_of(grid)


@pytest.fixture
def point(grid: str) -> tuple[FloatArray, FloatArray]:
    """Somewhere around a trajectory, all terms of the cost counting."""
    data, guess = problem_of(SCENES["hills"], grid, "reference_energy_aging")
    rng = np.random.default_rng(5)
    return guess + rng.uniform(-0.3, 0.3, guess.size), data.parameters


def numbers(function: ca.Function, *arguments: Any) -> FloatArray:
    answer: ca.DM = function.call(list(arguments))[0]
    values: FloatArray = answer.full()
    return values


def test_gradient_and_jacobian_are_casadis_own(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    t = transcription
    for ours, theirs in (
        (t.gradient, ca.gradient(t.cost, t.variables)),
        (t.jacobian, ca.jacobian(t.rows, t.variables)),
    ):
        function = ca.Function("pair", [t.variables, t.parameters], [ours, theirs])
        mine, reference = (value.full() for value in function(*point))
        np.testing.assert_allclose(mine, reference, rtol=1e-10, atol=1e-10)


def test_hessian_is_casadis_own(
    transcription: Transcription, point: tuple[FloatArray, FloatArray]
) -> None:
    t = transcription
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", t.grid.row_count)
    lagrangian = lam_f * t.cost + ca.dot(lam_g, t.rows)
    theirs = ca.hessian(lagrangian, t.variables)[0]
    arguments = [t.variables, t.parameters, lam_f, lam_g]
    function = ca.Function("pair", arguments, [t.hessian(lam_f, lam_g), theirs])
    multipliers = np.random.default_rng(2).normal(size=t.grid.row_count)
    mine, reference = (value.full() for value in function(*point, 0.7, multipliers))
    np.testing.assert_allclose(mine, reference, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(mine, mine.T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_single_and_multi_horizon_give_the_same_plan_on_the_same_steps(strategy: str) -> None:
    plans = []
    for text in ("8x1", "3x1+5x1"):
        result = plain_solver(text).solve(*problem_of(SCENES["leader_brakes"], text, strategy))
        assert result.status.usable
        plans.append(result)
    assert plans[0].iterations == plans[1].iterations
    np.testing.assert_allclose(plans[0].variables, plans[1].variables, rtol=0.0, atol=1e-6)
