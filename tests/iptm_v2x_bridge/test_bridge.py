"""The bridge of a cycle: leader and preview at every tick."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import NS, predicted

from iptm_core.routes import Route
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_v2x_bridge.bridge import CycleSource, V2xBridge, preview_times_s


def bridge_with(source: CycleSource, **imperfections: float) -> V2xBridge:
    return V2xBridge(source, PreviewSettings(**imperfections))  # type: ignore[arg-type]


def test_perfect_preview_agrees_with_the_leader_at_every_tick(source: CycleSource) -> None:
    bridge = V2xBridge(source)
    for tick in range(700):
        answer = bridge.answer(tick * NS)
        assert answer.leader == source.leader_at(tick * NS)
        assert answer.preview.generated_at_s == answer.leader.time_s
        assert answer.preview.positions_m[0] == answer.leader.position_m
        assert answer.preview.speeds_m_s[0] == answer.leader.speed_m_s
        assert answer.preview_age_s == 0.0
        assert not answer.lost


@pytest.mark.parametrize(
    ("latency_s", "ages"),
    [
        (0.0, [0.0, 0.0, 0.0, 0.0, 0.0]),
        (0.3, [math.inf, 1.0, 1.0, 1.0, 1.0]),
        (1.0, [math.inf, 1.0, 1.0, 1.0, 1.0]),
        (2.5, [math.inf, math.inf, math.inf, 3.0, 3.0]),
    ],
)
def test_latency_is_the_age_at_the_next_tick(
    source: CycleSource, latency_s: float, ages: list[float]
) -> None:
    bridge = bridge_with(source, latency_s=latency_s)
    assert [bridge.answer(tick * NS).preview_age_s for tick in range(5)] == ages


def test_old_preview_is_what_was_true_at_its_generation(source: CycleSource) -> None:
    bridge = bridge_with(source, latency_s=4.0)
    for tick in range(100):
        answer = bridge.answer(tick * NS)
    expected = source.predict(preview_times_s(PreviewSettings(), 95 * NS))
    np.testing.assert_array_equal(answer.preview.times_s, expected.times_s)
    np.testing.assert_array_equal(answer.preview.positions_m, expected.positions_m)


def test_dropouts_make_the_held_preview_age(source: CycleSource) -> None:
    bridge = bridge_with(source, dropout_probability=0.4, seed=9)
    expected_age = math.inf
    for tick in range(300):
        answer = bridge.answer(tick * NS)
        expected_age = expected_age + 1.0 if answer.lost else 0.0
        assert answer.preview_age_s == expected_age
    assert bridge.sent == 300
    assert 80 < bridge.lost < 160


def test_same_tick_again_gets_the_same_answer_and_sends_nothing(source: CycleSource) -> None:
    bridge = bridge_with(source, dropout_probability=0.5, latency_s=1.0)
    first = bridge.answer(5 * NS)
    assert bridge.answer(5 * NS) is first
    assert bridge.sent == 1


def test_earlier_tick_begins_a_new_trip(source: CycleSource) -> None:
    bridge = bridge_with(source, latency_s=1.0)
    ages = [bridge.answer(tick * NS).preview_age_s for tick in (0, 1, 2)]
    again = [bridge.answer(tick * NS).preview_age_s for tick in (0, 1, 2)]
    assert ages == again == [math.inf, 1.0, 1.0]
    assert bridge.sent == 3


def test_joining_late_gives_the_same_previews(source: CycleSource) -> None:
    """What is lost and how wrong a prediction is does not depend on when the bridge started."""
    faults = {"dropout_probability": 0.3, "noise_std_m_s": 1.0, "seed": 5, "latency_s": 2.0}
    early, late = bridge_with(source, **faults), bridge_with(source, **faults)
    for tick in range(200):
        one = early.answer(tick * NS)
        if tick < 100:
            continue
        two = late.answer(tick * NS)
        assert one.lost == two.lost
        if math.isfinite(two.preview_age_s):
            np.testing.assert_array_equal(one.preview.speeds_m_s, two.preview.speeds_m_s)


def test_mode_none_knows_the_leader_now_and_nothing_else(source: CycleSource) -> None:
    bridge = V2xBridge(source, PreviewSettings(preview_mode=PreviewMode.NONE))
    for tick in range(5):
        answer = bridge.answer(tick * NS)
        assert answer.leader == source.leader_at(tick * NS)
        assert answer.preview.times_s.size == 0
        assert answer.preview_age_s == math.inf
    assert bridge.sent == 0


@pytest.mark.parametrize(
    ("length_s", "step_s", "nodes"),
    [(60.0, 1.0, 61), (1.0, 1.0, 2), (300.0, 1.0, 301), (10.0, 4.0, 3), (1.0, 0.1, 11)],
)
def test_grid_reaches_as_far_as_whole_steps_go(length_s: float, step_s: float, nodes: int) -> None:
    times = preview_times_s(
        PreviewSettings(preview_length_s=length_s, preview_step_s=step_s), 5 * NS
    )
    assert times.size == nodes
    assert times[0] == 5.0
    assert times[-1] <= 5.0 + length_s


def test_grid_times_are_exact_far_into_the_trip() -> None:
    times = preview_times_s(PreviewSettings(preview_step_s=0.1), 9999 * NS)
    assert times[1] == 9999.1
    assert times[7] == 9999.7
    assert times[-1] == 10059.0


@pytest.mark.parametrize("tick", [0, 1, 123, 597, 598, 599, 5000])
def test_prediction_starts_exactly_at_the_leader(source: CycleSource, tick: int) -> None:
    preview = predicted(source, tick * NS)
    leader = source.leader_at(tick * NS)
    assert leader.time_s == tick
    assert preview.generated_at_s == preview.times_s[0] == leader.time_s
    assert preview.positions_m[0] == leader.position_m
    assert preview.speeds_m_s[0] == leader.speed_m_s


def test_every_node_comes_true(source: CycleSource) -> None:
    preview = predicted(source, 100 * NS, 120.0, 1.0)
    for index, time_s in enumerate(preview.times_s):
        leader = source.leader_at(round(float(time_s) * NS))
        assert preview.positions_m[index] == leader.position_m
        assert preview.speeds_m_s[index] == leader.speed_m_s


def test_leader_stands_still_past_the_end_of_the_trip(source: CycleSource, route: Route) -> None:
    end_ns = round(route.duration_s) * NS
    preview = predicted(source, end_ns - 10 * NS, 60.0, 1.0)
    past = preview.times_s > route.duration_s + 10.0
    assert past.any()
    assert (preview.speeds_m_s[past] == 0.0).all()
    assert np.unique(preview.positions_m[past]).size == 1


def test_slope_is_that_of_the_whole_road(source: CycleSource, route: Route) -> None:
    slope = source.slope_ahead()
    assert slope.positions_m is route.slope.positions_m
    assert slope.slopes_rad is route.slope.slopes_rad
    assert np.abs(np.tan(slope.slopes_rad)).max() == pytest.approx(0.06, abs=0.005)
