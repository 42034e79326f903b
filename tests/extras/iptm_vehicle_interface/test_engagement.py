"""Who drives: the table of transitions, row by row."""

from __future__ import annotations

import pytest

from iptm_core.decision_record import DrivingMode
from iptm_vehicle_interface.engagement import Engagement, EngagementConditions

NOTHING = EngagementConditions()
ENABLE = EngagementConditions(enable=True)
STEP_S = 0.02


def after(
    start: DrivingMode, *conditions: EngagementConditions, requested_m_s2: float = -1.0
) -> Engagement:
    state = Engagement(start, enable_was_pressed=False)
    for now in conditions:
        state = state.step(now, requested_m_s2, STEP_S)
    return state


@pytest.mark.parametrize(
    ("start", "now", "end"),
    [
        (DrivingMode.OFF, NOTHING, DrivingMode.READY),
        (DrivingMode.OFF, EngagementConditions(hindrance="no fresh speed_m_s"), DrivingMode.OFF),
        (DrivingMode.OFF, ENABLE, DrivingMode.READY),
        (DrivingMode.READY, EngagementConditions(hindrance="no decision yet"), DrivingMode.OFF),
        (DrivingMode.READY, ENABLE, DrivingMode.ENGAGED),
        (DrivingMode.READY, EngagementConditions(enable=True, brake=True), DrivingMode.READY),
        (DrivingMode.READY, EngagementConditions(enable=True, accelerator=True), DrivingMode.READY),
        (DrivingMode.ENGAGED, NOTHING, DrivingMode.ENGAGED),
        (DrivingMode.ENGAGED, EngagementConditions(brake=True), DrivingMode.READY),
        (DrivingMode.ENGAGED, EngagementConditions(cancel=True), DrivingMode.READY),
        (DrivingMode.ENGAGED, EngagementConditions(accelerator=True), DrivingMode.OVERRIDDEN),
        (
            DrivingMode.ENGAGED,
            EngagementConditions(hindrance="no decision for 3.1 s"),
            DrivingMode.HAND_OVER,
        ),
        (DrivingMode.OVERRIDDEN, NOTHING, DrivingMode.ENGAGED),
        (DrivingMode.OVERRIDDEN, EngagementConditions(accelerator=True), DrivingMode.OVERRIDDEN),
        (DrivingMode.OVERRIDDEN, EngagementConditions(brake=True), DrivingMode.READY),
        (
            DrivingMode.OVERRIDDEN,
            EngagementConditions(hindrance="no fresh gap_m"),
            DrivingMode.HAND_OVER,
        ),
        (DrivingMode.HAND_OVER, EngagementConditions(brake=True), DrivingMode.OFF),
        (DrivingMode.ENGAGED, EngagementConditions(stopped="controller"), DrivingMode.OFF),
        (DrivingMode.OVERRIDDEN, EngagementConditions(stopped="controller"), DrivingMode.OFF),
        (DrivingMode.HAND_OVER, EngagementConditions(stopped="controller"), DrivingMode.OFF),
        (DrivingMode.READY, EngagementConditions(stopped="controller"), DrivingMode.OFF),
    ],
)
def test_transitions(start: DrivingMode, now: EngagementConditions, end: DrivingMode) -> None:
    state = Engagement(start, enable_was_pressed=False, released_m_s2=-1.0)
    assert state.step(now, -1.0, STEP_S).mode is end


def test_a_button_that_is_held_enables_once() -> None:
    state = after(
        DrivingMode.READY, ENABLE, EngagementConditions(brake=True, enable=True), ENABLE, ENABLE
    )
    assert state.mode is DrivingMode.READY
    assert state.step(NOTHING, 0.0, STEP_S).step(ENABLE, 0.0, STEP_S).mode is DrivingMode.ENGAGED


def test_the_hand_over_releases_the_brakes_at_the_stated_rate() -> None:
    lost = EngagementConditions(hindrance="no fresh gap_m")
    state = after(DrivingMode.ENGAGED, lost)
    assert state.is_active
    assert state.released_m_s2 == -1.0
    steps = 0
    while state.is_active:
        state = state.step(lost, -1.0, STEP_S)
        steps += 1
    # 1 m/s^2 at 1 m/s^3.
    assert steps == pytest.approx(1.0 / STEP_S, abs=1)
    assert state.mode is DrivingMode.OFF
    assert state.step(ENABLE, 0.0, STEP_S).mode is DrivingMode.READY


def test_a_request_to_accelerate_ends_at_once() -> None:
    lost = EngagementConditions(hindrance="no fresh gap_m")
    state = after(DrivingMode.ENGAGED, lost, requested_m_s2=1.0)
    assert state.released_m_s2 == 0.0
    assert state.step(lost, 0.0, STEP_S).mode is DrivingMode.OFF
