"""Interpolation of a motion, against integrals of the speed taken by other means."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.state import FloatArray, LeaderPreview

SPEEDS = st.lists(st.floats(0.0, 40.0), min_size=2, max_size=12)
STEPS = st.lists(st.floats(0.05, 10.0), min_size=11, max_size=11)
INSTANTS = st.lists(st.floats(-30.0, 130.0), min_size=1, max_size=20)


def integrated(times: FloatArray, speeds: FloatArray, until: float) -> float:
    """Area under the piecewise linear speed from the first node, constant outside the nodes."""
    low, high = min(until, times[0]), max(until, times[0])
    inner = times[(times > low) & (times < high)]
    grid = np.concatenate([[low], inner, [high]])
    values = np.interp(grid, times, speeds)
    area = float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(grid)))
    return area if until >= times[0] else -area


def consistent_motion(speeds: list[float], steps: list[float]) -> LeaderPreview:
    times = np.concatenate([[0.0], np.cumsum(steps[: len(speeds) - 1])])
    values = np.array(speeds)
    positions = np.array([7.0 + integrated(times, values, float(time)) for time in times])
    return LeaderPreview(times, positions, values)


@given(speeds=SPEEDS, steps=STEPS, instants=INSTANTS)
def test_exact_where_the_speed_is_piecewise_linear(
    speeds: list[float], steps: list[float], instants: list[float]
) -> None:
    motion = consistent_motion(speeds, steps)
    positions, found = motion.at(np.array(instants))
    for instant, position, speed in zip(instants, positions, found, strict=True):
        assert speed == pytest.approx(np.interp(instant, motion.times_s, speeds), abs=1e-9)
        expected = 7.0 + integrated(motion.times_s, motion.speeds_m_s, instant)
        assert position == pytest.approx(expected, abs=1e-8)


@given(speeds=SPEEDS, steps=STEPS, shifts=st.lists(st.floats(-5.0, 5.0), min_size=12, max_size=12))
def test_meets_every_node_even_where_nodes_contradict_each_other(
    speeds: list[float], steps: list[float], shifts: list[float]
) -> None:
    clean = consistent_motion(speeds, steps)
    motion = LeaderPreview(
        clean.times_s, clean.positions_m + shifts[: len(speeds)], clean.speeds_m_s
    )
    positions, found = motion.at(motion.times_s)
    np.testing.assert_allclose(positions, motion.positions_m, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found, motion.speeds_m_s, rtol=0.0, atol=1e-9)
    # No jump on either side of a node.
    for side in (-1e-9, 1e-9):
        beside, _ = motion.at(motion.times_s + side)
        np.testing.assert_allclose(beside, positions, rtol=0.0, atol=1e-6)


def test_speed_is_held_outside_the_nodes() -> None:
    motion = LeaderPreview(np.array([10.0, 12.0]), np.array([100.0, 114.0]), np.array([6.0, 8.0]))
    positions, speeds = motion.at(np.array([7.0, 15.0]))
    assert speeds.tolist() == [6.0, 8.0]
    assert positions.tolist() == [100.0 - 3.0 * 6.0, 114.0 + 3.0 * 8.0]


@given(speeds=SPEEDS, steps=STEPS)
def test_never_drives_backwards(speeds: list[float], steps: list[float]) -> None:
    motion = consistent_motion(speeds, steps)
    times = np.linspace(motion.times_s[0] - 5.0, motion.times_s[-1] + 5.0, 400)
    positions, _ = motion.at(times)
    assert (np.diff(positions) >= -1e-9).all()
