"""Faults of a simulated link: latency, loss, noise."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import NS, predicted

from iptm_core.settings import PreviewSettings
from iptm_core.state import LeaderPreview
from iptm_v2x_bridge.bridge import CycleSource, distort, is_lost, latency_ns

NOISY = PreviewSettings(noise_std_m_s=1.5, seed=7)


def loss_pattern(settings: PreviewSettings, count: int = 8000) -> np.ndarray[Any, Any]:
    return np.array([is_lost(settings, tick * NS) for tick in range(count)])


def steady(speed_m_s: float, count: int = 61, step_s: float = 1.0) -> LeaderPreview:
    times = np.arange(count, dtype=np.float64) * step_s
    speeds = np.full(count, speed_m_s, dtype=np.float64)
    return LeaderPreview(times, speeds * times, speeds)


def at_tick(preview: LeaderPreview, tick: int) -> LeaderPreview:
    return dataclasses.replace(preview, times_s=preview.times_s + float(tick))


def test_perfect_by_default(source: CycleSource) -> None:
    perfect = PreviewSettings()
    preview = predicted(source, 50 * NS)
    assert distort(perfect, preview) is preview
    assert not loss_pattern(perfect, 100).any()
    assert latency_ns(perfect) == 0


@pytest.mark.parametrize("burst", [1, 3, 10])
@pytest.mark.parametrize("probability", [0.05, 0.3])
def test_share_of_lost_predictions_is_as_asked(probability: float, burst: int) -> None:
    lost = loss_pattern(
        PreviewSettings(dropout_probability=probability, dropout_burst=burst, seed=1)
    )
    deviation = math.sqrt(probability * (1.0 - probability) * burst / lost.size)
    assert abs(lost.mean() - probability) < 4.0 * deviation


def test_bursts_are_as_long_as_asked() -> None:
    lost = loss_pattern(PreviewSettings(dropout_probability=0.05, dropout_burst=5, seed=2))
    edges = np.flatnonzero(np.diff(lost.astype(int)))
    runs = np.diff(edges)[lost[edges[:-1] + 1]]
    assert runs.min() >= 5
    assert (runs == 5).mean() > 0.7


def test_losses_depend_on_seed_and_stamp_only() -> None:
    first = PreviewSettings(dropout_probability=0.3, dropout_burst=2, seed=5)
    again = PreviewSettings(dropout_probability=0.3, dropout_burst=2, seed=5)
    other = PreviewSettings(dropout_probability=0.3, dropout_burst=2, seed=6)
    forward = loss_pattern(first, 300)
    backward = np.array([is_lost(again, tick * NS) for tick in reversed(range(300))])[::-1]
    np.testing.assert_array_equal(forward, backward)
    assert (forward != loss_pattern(other, 300)).any()


def test_noise_depends_on_seed_and_stamp_only(source: CycleSource) -> None:
    preview = predicted(source, 100 * NS)
    first = distort(NOISY, preview)
    for tick in (1, 99, 500):
        distort(NOISY, predicted(source, tick * NS))
    again = distort(PreviewSettings(noise_std_m_s=1.5, seed=7), preview)
    np.testing.assert_array_equal(first.speeds_m_s, again.speeds_m_s)
    np.testing.assert_array_equal(first.positions_m, again.positions_m)
    other_seed = distort(PreviewSettings(noise_std_m_s=1.5, seed=8), preview)
    assert (first.speeds_m_s != other_seed.speeds_m_s).any()
    flat = steady(20.0)
    assert (distort(NOISY, flat).speeds_m_s != distort(NOISY, at_tick(flat, 1)).speeds_m_s).any()


def test_longer_previews_see_the_same_error_where_they_overlap(source: CycleSource) -> None:
    short = distort(NOISY, predicted(source, 60 * NS, 20.0, 1.0))
    long = distort(NOISY, predicted(source, 60 * NS, 200.0, 1.0))
    np.testing.assert_array_equal(short.speeds_m_s, long.speeds_m_s[:21])
    np.testing.assert_array_equal(short.positions_m, long.positions_m[:21])


@pytest.mark.parametrize("tick", [0, 30, 100, 333, 590])
@pytest.mark.parametrize("std_m_s", [0.2, 2.0, 10.0])
def test_positions_belong_to_speeds(source: CycleSource, tick: int, std_m_s: float) -> None:
    true = predicted(source, tick * NS, 100.0, 1.0)
    noisy = distort(PreviewSettings(noise_std_m_s=std_m_s, seed=3), true)
    assert noisy.generated_at_s == true.generated_at_s
    assert noisy.times_s is true.times_s
    assert noisy.positions_m[0] == true.positions_m[0]
    assert noisy.speeds_m_s[0] == true.speeds_m_s[0]
    assert (noisy.speeds_m_s >= 0.0).all()
    assert (np.diff(noisy.positions_m) >= 0.0).all()
    # The cycle is linear between whole seconds, so the trapezoid rule is exact here.
    steps = np.diff(noisy.times_s)
    travelled = np.cumsum(0.5 * steps * (noisy.speeds_m_s[1:] + noisy.speeds_m_s[:-1]))
    np.testing.assert_allclose(noisy.positions_m[1:] - noisy.positions_m[0], travelled, atol=1e-9)


@pytest.mark.parametrize("step_s", [0.5, 3.0, 7.0])
def test_no_car_drives_backwards_on_any_grid(source: CycleSource, step_s: float) -> None:
    noise = PreviewSettings(noise_std_m_s=8.0, noise_correlation_s=1.0, seed=11)
    for tick in range(0, 590, 7):
        noisy = distort(noise, predicted(source, tick * NS, 70.0, step_s))
        assert (noisy.speeds_m_s >= 0.0).all()
        assert (np.diff(noisy.positions_m) >= 0.0).all()


def test_errors_grow_to_the_standard_deviation_and_are_correlated_over_the_horizon() -> None:
    noise = PreviewSettings(noise_std_m_s=1.0, noise_correlation_s=10.0, seed=4)
    truth = steady(50.0, 101)
    errors = np.array(
        [distort(noise, at_tick(truth, tick)).speeds_m_s - 50.0 for tick in range(4000)]
    )
    expected = np.sqrt(1.0 - np.exp(-2.0 * truth.times_s / 10.0))
    np.testing.assert_allclose(errors.std(axis=0), expected, atol=0.05)
    assert np.abs(errors.mean(axis=0)).max() < 0.08
    for lag in (1, 5, 10):
        correlation = np.corrcoef(errors[:, 60], errors[:, 60 + lag])[0, 1]
        assert correlation == pytest.approx(math.exp(-lag / 10.0), abs=0.06)


def test_single_node_and_empty_previews_pass_untouched() -> None:
    for count in (0, 1):
        preview = steady(5.0, count)
        assert distort(NOISY, preview) is preview
