"""Who drives: the table of transitions, row by row."""

from __future__ import annotations

import pytest

from iptm_vehicle_interface.engagement import Conditions, Engagement, Mode

NOTHING = Conditions()
ENABLE = Conditions(enable=True)
STEP_S = 0.02


def after(start: Mode, *conditions: Conditions, requested_m_s2: float = -1.0) -> Engagement:
    state = Engagement(start, enable_was_pressed=False)
    for now in conditions:
        state = state.step(now, requested_m_s2, STEP_S)
    return state


@pytest.mark.parametrize(
    ("start", "now", "end"),
    [
        (Mode.OFF, NOTHING, Mode.READY),
        (Mode.OFF, Conditions(hindrance="no fresh speed_m_s"), Mode.OFF),
        (Mode.OFF, ENABLE, Mode.READY),
        (Mode.READY, Conditions(hindrance="no decision yet"), Mode.OFF),
        (Mode.READY, ENABLE, Mode.ENGAGED),
        (Mode.READY, Conditions(enable=True, brake=True), Mode.READY),
        (Mode.READY, Conditions(enable=True, accelerator=True), Mode.READY),
        (Mode.ENGAGED, NOTHING, Mode.ENGAGED),
        (Mode.ENGAGED, Conditions(brake=True), Mode.READY),
        (Mode.ENGAGED, Conditions(cancel=True), Mode.READY),
        (Mode.ENGAGED, Conditions(accelerator=True), Mode.OVERRIDDEN),
        (Mode.ENGAGED, Conditions(hindrance="no decision for 3.1 s"), Mode.HAND_OVER),
        (Mode.OVERRIDDEN, NOTHING, Mode.ENGAGED),
        (Mode.OVERRIDDEN, Conditions(accelerator=True), Mode.OVERRIDDEN),
        (Mode.OVERRIDDEN, Conditions(brake=True), Mode.READY),
        (Mode.OVERRIDDEN, Conditions(hindrance="no fresh gap_m"), Mode.HAND_OVER),
        (Mode.HAND_OVER, Conditions(brake=True), Mode.OFF),
    ],
)
def test_transitions(start: Mode, now: Conditions, end: Mode) -> None:
    state = Engagement(start, enable_was_pressed=False, released_m_s2=-1.0)
    assert state.step(now, -1.0, STEP_S).mode is end


def test_a_button_that_is_held_enables_once() -> None:
    state = after(Mode.READY, ENABLE, Conditions(brake=True, enable=True), ENABLE, ENABLE)
    assert state.mode is Mode.READY
    assert state.step(NOTHING, 0.0, STEP_S).step(ENABLE, 0.0, STEP_S).mode is Mode.ENGAGED


def test_the_hand_over_releases_the_brakes_at_the_stated_rate() -> None:
    lost = Conditions(hindrance="no fresh gap_m")
    state = after(Mode.ENGAGED, lost)
    assert state.is_active
    assert state.released_m_s2 == -1.0
    steps = 0
    while state.is_active:
        state = state.step(lost, -1.0, STEP_S)
        steps += 1
    # 1 m/s^2 at 1 m/s^3.
    assert steps == pytest.approx(1.0 / STEP_S, abs=1)
    assert state.mode is Mode.OFF
    assert state.step(ENABLE, 0.0, STEP_S).mode is Mode.READY


def test_a_request_to_accelerate_ends_at_once() -> None:
    lost = Conditions(hindrance="no fresh gap_m")
    state = after(Mode.ENGAGED, lost, requested_m_s2=1.0)
    assert state.released_m_s2 == 0.0
    assert state.step(lost, 0.0, STEP_S).mode is Mode.OFF
