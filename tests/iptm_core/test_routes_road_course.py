"""The road in space, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.routes.road_course import RoadCourse, heights
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import SlopePreview

FLAT = SlopePreview(np.zeros(1), np.zeros(1))


def turned(quaternion: np.ndarray, vector: tuple[float, float, float]) -> np.ndarray:
    """Turn a vector by the matrix of a quaternion, written out."""
    x, y, z, w = quaternion
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return matrix @ np.array(vector)


def test_a_straight_level_road_is_the_x_axis() -> None:
    poses = RoadCourse(FLAT).poses([-5.0, 0.0, 1234.5], -4.5)
    assert poses.points_m.tolist() == [[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1234.5, 0.0, 0.0]]
    assert poses.quaternions().tolist() == [[0.0, 0.0, 0.0, 1.0]] * 3


def test_a_climb_lifts_the_nose() -> None:
    slope = SlopePreview(np.array([-100.0, 300.0]), np.array([0.1, 0.1]))
    poses = RoadCourse(slope).poses([200.0], -4.0)
    assert poses.points_m[0] == pytest.approx([200.0, 0.0, 200.0 * math.sin(0.1)])
    forward = turned(poses.quaternions()[0], (1.0, 0.0, 0.0))
    assert forward[2] / forward[0] == pytest.approx(math.sin(0.1))
    assert np.linalg.norm(poses.quaternions()[0]) == pytest.approx(1.0)
    # Height 0 is where the host starts, not where the slope begins.
    assert heights(slope)[1][0] == pytest.approx(-100.0 * math.sin(0.1))


def test_a_car_stands_on_a_bend_with_both_ends() -> None:
    east = RoadLine(np.array([0.0, 0.0, 0.001]), np.array([0.0, 0.001, 0.001]))
    corner_m = float(east.positions_m[1])
    course = RoadCourse(FLAT, east)
    before, at_corner, after = course.poses(
        [corner_m - 10.0, corner_m + 2.0, corner_m + 10.0], -4.0
    ).yaws_rad
    assert before == pytest.approx(0.0, abs=1e-6)
    assert at_corner == pytest.approx(math.radians(45.0), abs=1e-3)
    assert after == pytest.approx(math.radians(90.0))
    # A body that lies ahead of its position looks the same way.
    assert course.poses([corner_m - 2.0], 4.0).yaws_rad[0] == pytest.approx(at_corner, abs=1e-6)
    assert course.points_m([corner_m + 10.0])[0] == pytest.approx([corner_m, 10.0, 0.0], abs=1e-3)
