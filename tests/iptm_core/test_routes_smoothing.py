"""Noise in the speeds of a logged drive: found, noted, and taken out without a change of the distance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iptm_core.routes.cycles import (
    CYCLE_NAMES,
    NOTED_NOISE_M_S,
    DrivingCycle,
    load_cycle,
    smoothed,
    speed_noise_m_s,
)
from iptm_core.routes.route import build_route

LOGGER_M_S = 0.6 / 3.6


def noisy(name: str, seed: int = 3) -> DrivingCycle:
    cycle = load_cycle(name)
    noise = np.random.default_rng(seed).normal(0.0, LOGGER_M_S, cycle.speeds_m_s.size)
    moving = cycle.speeds_m_s > 0.0
    return replace(cycle, speeds_m_s=np.maximum(cycle.speeds_m_s + noise * moving, 0.0))


@pytest.mark.parametrize("name", CYCLE_NAMES)
def test_noise_of_a_logger_is_told_from_a_driver(name: str) -> None:
    assert speed_noise_m_s(load_cycle(name)) < NOTED_NOISE_M_S < speed_noise_m_s(noisy(name))


def test_the_noise_of_a_steady_drive_is_what_was_added() -> None:
    speeds = 20.0 + np.random.default_rng(1).normal(0.0, 0.2, 4000)
    steady = DrivingCycle("steady", np.arange(4000.0), speeds, "made up")
    assert speed_noise_m_s(steady) == pytest.approx(0.2, rel=0.05)


def test_smoothing_keeps_stops_length_and_distance_and_takes_the_noise() -> None:
    drive = noisy("wltc_class3b")
    calm = smoothed(drive, 9.0)
    assert calm.distance_m == pytest.approx(drive.distance_m)
    assert calm.duration_s == drive.duration_s
    assert np.array_equal(calm.speeds_m_s == 0.0, drive.speeds_m_s == 0.0)
    assert speed_noise_m_s(calm) < 0.3 * speed_noise_m_s(drive)
    true = load_cycle("wltc_class3b").speeds_m_s
    left, had = (np.std(each.speeds_m_s - true) for each in (calm, drive))
    assert left < 0.85 * had
    assert smoothed(drive, 1.0) is drive


def test_by_hand() -> None:
    speeds = np.array([0.0, 3.0, 9.0, 6.0, 12.0, 6.0, 0.0])
    cycle = DrivingCycle("hill", np.arange(7.0), speeds, "made up")
    # Five rows fit in from the third to the fifth one: weights -3, 12, 17, 12 and -3 of 35.
    fitted = speeds.copy()
    for row in (2, 3, 4):
        fitted[row] = np.dot(speeds[row - 2 : row + 3], [-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
    expected = fitted * speeds.sum() / fitted.sum()
    assert smoothed(cycle, 5.0).speeds_m_s == pytest.approx(expected)
    # No window reaches beyond a stop.
    twice = DrivingCycle("hills", np.arange(14.0), np.tile(speeds, 2), "made up")
    assert smoothed(twice, 5.0).speeds_m_s == pytest.approx(np.tile(expected, 2))


def test_a_parabola_stays_to_its_end_in_motion() -> None:
    times_s = np.arange(30.0)
    speeds = 0.02 * times_s**2 + 0.1 * times_s
    cycle = DrivingCycle("parabola", times_s, speeds, "made up")
    assert smoothed(cycle, 9.0).speeds_m_s == pytest.approx(speeds)


def test_a_noisy_file_has_a_note_and_a_smoothed_one_has_none(tmp_path: Path) -> None:
    drive = noisy("hwfet")
    file = tmp_path / "log.csv"
    rows = zip(drive.times_s.tolist(), drive.speeds_m_s.tolist(), strict=True)
    file.write_text("time_s,speed_m_s\n" + "".join(f"{t},{v}\n" for t, v in rows))
    (note,) = build_route(str(file), initial_gap_m=15.0).notes
    assert "speeds have noise of 0.1" in note
    assert not build_route(str(file), initial_gap_m=15.0, smooth_s=9.0).notes
