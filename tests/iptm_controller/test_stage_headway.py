"""A desired headway in one step of the problem: its price, and the reserve that it leaves."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state, run_stage

from iptm_controller.ocp.layout import LimitIndex
from iptm_controller.ocp.stages import NEARLY_DESIRED_M
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.car_following import emergency_reserve_m

AT_HEADWAY = replace(PARAMETERS, gap=replace(PARAMETERS.gap, desired_time_headway_s=1.6))
"""At 20 m/s a gap of 5 m + 1.6 s * 20 m/s = 37 m is desired."""


@pytest.mark.parametrize(("error_m", "squared_m2"), [(-1.0, 1.0), (0.0, 0.0), (2.0, 4.0)])
def test_deviation_from_the_desired_gap_costs_its_square(error_m: float, squared_m2: float) -> None:
    state = make_state(speed_m_s=20.0)

    def cost(price: float, step_s: float, model: ModelParameters = AT_HEADWAY) -> float:
        leader = (state.position_m + 20.0 * step_s + 37.0 + error_m, 20.0)
        return run_stage(
            state, 0.0, 0.0, step_s, leader=leader, headway_price_1_m2_s=price, model=model
        )[1]

    for step_s in (1.0, 5.0):
        paid = cost(0.5, step_s) - cost(0.0, step_s)
        assert paid == pytest.approx(0.5 * step_s * squared_m2, rel=1e-2, abs=1e-9)
    assert cost(0.5, 1.0, PARAMETERS) == cost(0.0, 1.0, PARAMETERS)


def test_far_from_the_desired_gap_a_metre_costs_no_more_than_near() -> None:
    state = make_state(speed_m_s=20.0)
    far = [
        run_stage(
            state, 0.0, 0.0, 1.0,
            leader=(state.position_m + gap_m, 20.0), headway_price_1_m2_s=1.0, model=AT_HEADWAY,
        )[1]
        for gap_m in (500.0, 501.0)
    ]  # fmt: skip
    assert far[1] - far[0] == pytest.approx(2.0 * NEARLY_DESIRED_M, rel=0.01)


def test_reserve_at_a_desired_headway_asks_for_the_service_brakes() -> None:
    """At every node, and not for comfort: a gap at which -2 m/s^2 would not do."""
    state = make_state(speed_m_s=20.0)
    rows = [
        run_stage(
            state, 0.0, 0.0, 1.0,
            leader=(state.position_m + 20.0 + 37.0, 20.0), end_of_horizon=model is PARAMETERS, model=model,
        )[2][LimitIndex.GAP_BRAKING]
        for model in (PARAMETERS, AT_HEADWAY)
    ]  # fmt: skip
    assert rows[0] < 0.0 < rows[1]
    by_hand = emergency_reserve_m(37.0, 20.0, 20.0, PARAMETERS.brakes)
    assert rows[1] == pytest.approx(by_hand)
