from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_v2x_bridge.bridge import CycleSource, V2xBridge, preview_times_s

NS = 10**9


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


def test_same_seed_gives_the_same_trip(source: CycleSource) -> None:
    settings = PreviewSettings(
        preview_length_s=30.0,
        latency_s=0.5,
        dropout_probability=0.2,
        dropout_burst=3,
        noise_std_m_s=1.0,
        noise_correlation_s=5.0,
        seed=42,
    )
    first, second = V2xBridge(source, settings), V2xBridge(source, settings)
    for tick in range(100):
        one, two = first.answer(tick * NS), second.answer(tick * NS)
        assert (one.lost, one.preview_age_s) == (two.lost, two.preview_age_s)
        np.testing.assert_array_equal(one.preview.positions_m, two.preview.positions_m)


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
