"""Averages of noisy previews: what passes unchanged, what is gained, when an average begins anew."""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference.preview_trust import PreviewFusion, _weights

from iptm_controller.decision import ControllerMemory
from iptm_controller.preview_trust import ERROR_GROWTH_S, FusionMemory
from iptm_core.saved_state import from_plain, to_plain
from iptm_core.settings import PreviewSettings
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.bridge import distort

TRIP_S = np.arange(0.0, 200.0)
SPEEDS_M_S = 15.0 + 5.0 * np.sin(TRIP_S / 15.0)
POSITIONS_M = np.concatenate([[0.0], np.cumsum(0.5 * (SPEEDS_M_S[1:] + SPEEDS_M_S[:-1]))])
NOISY = PreviewSettings(noise_std_m_s=1.5, noise_correlation_s=5.0)


def true_preview(tick: int) -> LeaderPreview:
    part = slice(tick, tick + 61)
    return LeaderPreview(TRIP_S[part], POSITIONS_M[part], SPEEDS_M_S[part])


def braking_preview(tick: int, deceleration_m_s2: float, least_m_s: float) -> LeaderPreview:
    """A driver who cruises, and from tick 10 on announces braking at 12 s."""
    times = tick + np.arange(61.0)
    braked_s = np.maximum(times - 12.0, 0.0) if tick >= 10 else np.zeros(61)
    speeds = np.maximum(20.0 - deceleration_m_s2 * braked_s, least_m_s)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])
    return LeaderPreview(times, 20.0 * tick + moved, speeds)


def errors(preview: LeaderPreview) -> FloatArray:
    wrong: FloatArray = preview.positions_m - np.interp(preview.times_s, TRIP_S, POSITIONS_M)
    return wrong


def test_consistent_previews_pass_unchanged() -> None:
    fusion = PreviewFusion()
    for tick in range(30):
        preview = true_preview(tick)
        assert fusion.fused(preview) is preview
    assert fusion.memory.noise == ""


@pytest.mark.parametrize("deceleration_m_s2", [1.0, 2.0, 4.0, 6.0, 9.0])
@pytest.mark.parametrize("least_m_s", [0.0, 10.0, 15.0])
def test_a_change_of_plans_counts_at_once(deceleration_m_s2: float, least_m_s: float) -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        preview = braking_preview(tick, deceleration_m_s2, least_m_s)
        fused = fusion.fused(preview)
        np.testing.assert_allclose(fused.speeds_m_s, preview.speeds_m_s, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_averages_are_nearer_the_truth_than_the_newest_preview(seed: int) -> None:
    fusion, settings = PreviewFusion(), PreviewSettings(**{**vars(NOISY), "seed": seed})
    newest, averaged = [], []
    for tick in range(100):
        preview = distort(settings, true_preview(tick))
        fused = fusion.fused(preview)
        if tick >= 20:
            newest.append(errors(preview))
            averaged.append(errors(fused))
    assert fusion.memory.noise.startswith("previews ")
    # Ten previews with equal weights would leave a third of the error.
    assert np.std(averaged) < 0.5 * np.std(newest)
    near = slice(0, 6)
    assert np.std([each[near] for each in averaged]) < np.std([each[near] for each in newest])


def test_a_preview_that_is_repeated_at_other_nodes_begins_a_new_average() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        preview = distort(NOISY, true_preview(tick))
        assert fusion.fused(preview).times_s.size == 61
    again = LeaderPreview(
        preview.times_s[::2],
        preview.positions_m[::2],
        preview.speeds_m_s[::2],
    )
    np.testing.assert_array_equal(fusion.fused(again).speeds_m_s, again.speeds_m_s)


def test_weights_are_the_inverse_variances_of_errors_that_grow_and_forget() -> None:
    """The variance of an Ornstein-Uhlenbeck process that starts from zero, over its final one."""
    generator, step_s = np.random.default_rng(4), 0.05
    kept = np.exp(-step_s / ERROR_GROWTH_S)
    found, errors_m_s = [], np.zeros(4000)
    for _ in range(400):
        noise = generator.normal(0.0, np.sqrt(1.0 - kept * kept), errors_m_s.size)
        errors_m_s = kept * errors_m_s + noise
        found.append(1.0 / np.var(errors_m_s))
    times_s = step_s * np.arange(401.0)
    weights = _weights(LeaderPreview(times_s, times_s, np.ones(401)))
    assert found[19:] == pytest.approx(weights[20:], rel=0.12)


def test_positions_are_the_integral_of_the_averaged_speeds() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        preview = distort(NOISY, true_preview(tick))
        fused = fusion.fused(preview)
    assert fused is not preview
    assert fused.positions_m[0] == preview.positions_m[0]
    moved = 0.5 * (fused.speeds_m_s[1:] + fused.speeds_m_s[:-1])
    np.testing.assert_allclose(np.diff(fused.positions_m), moved)


def test_a_preview_received_again_is_not_counted_twice() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        fused = fusion.fused(distort(NOISY, true_preview(tick)))
    memory = fusion.memory
    again = fusion.fused(distort(NOISY, true_preview(19)))
    np.testing.assert_array_equal(again.speeds_m_s, fused.speeds_m_s)
    assert fusion.memory is memory


def test_another_preview_of_the_same_instant_replaces_it() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        fusion.fused(distort(NOISY, true_preview(tick)))
    whole = true_preview(19)
    part = LeaderPreview(whole.times_s[:4], whole.positions_m[:4], whole.speeds_m_s[:4])
    np.testing.assert_array_equal(fusion.fused(part).speeds_m_s, part.speeds_m_s)
    assert fusion.fused(distort(NOISY, true_preview(20))).times_s.size == 61


def test_a_preview_of_something_else_and_an_earlier_one_begin_a_new_average() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        fusion.fused(distort(NOISY, true_preview(tick)))
    other = true_preview(20)
    faster = LeaderPreview(other.times_s, other.positions_m, other.speeds_m_s + 8.0)
    np.testing.assert_array_equal(fusion.fused(faster).speeds_m_s, faster.speeds_m_s)
    early = true_preview(3)
    assert fusion.fused(early) is early, "a new trip"


@pytest.mark.parametrize(("faster_m_s", "averaged"), [(4.9, True), (5.1, False), (-5.1, False)])
def test_a_preview_that_differs_by_5_m_s_is_another_plan(faster_m_s: float, averaged: bool) -> None:
    fusion, times_s = PreviewFusion(), np.arange(61.0)
    before = LeaderPreview(times_s, 15.0 * times_s, np.full(61, 15.0))
    fusion.memory = FusionMemory(before, roughness_m2_s4=1.0)
    now = LeaderPreview(times_s + 1.0, 15.0 * times_s, before.speeds_m_s + faster_m_s)
    speeds_m_s = fusion.fused(now).speeds_m_s
    assert np.array_equal(speeds_m_s, now.speeds_m_s) is not averaged


def test_a_memory_can_be_saved_and_goes_on() -> None:
    fusion = PreviewFusion()
    for tick in range(20):
        fusion.fused(distort(NOISY, true_preview(tick)))
    saved = to_plain(ControllerMemory(fusion=fusion.memory))
    other = PreviewFusion()
    other.memory = from_plain(ControllerMemory, saved).fusion
    preview = distort(NOISY, true_preview(20))
    np.testing.assert_array_equal(other.fused(preview).speeds_m_s, fusion.fused(preview).speeds_m_s)
    assert from_plain(ControllerMemory, to_plain(ControllerMemory())).fusion == FusionMemory()
    quiet = PreviewFusion()
    quiet.fused(true_preview(0))
    assert from_plain(
        ControllerMemory, to_plain(ControllerMemory(fusion=quiet.memory))
    ).fusion.preview
