"""The benchmark behind measured lead vehicles: its scenes, and its figures by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from studies.acc.figures import figures_of
from studies.acc.run import headway_overrides, parameters_of, real_follower
from studies.acc.scenes import Scene, measured_scenes

from iptm_core.errors import MeasurementError
from iptm_core.parameters import DEFAULT_SET

CAR = DEFAULT_SET


def made_scene(gap_m: float = 20.0) -> Scene:
    """A lead vehicle and its follower go at 10 m/s after a run-in of 20 s; 30 s are measured."""
    speeds = np.minimum(np.arange(51.0), 10.0)
    return Scene("made", 20, 50, np.append(speeds, np.full(30, 10.0)), speeds, np.full(51, gap_m))


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return measured_scenes(None, print)


def test_gap_and_speeds_belong_together(scenes: list[Scene]) -> None:
    """The gap changes by what the lead vehicle drives more, but for errors of the positioning."""
    misses = []
    for scene in scenes:
        begin = scene.run_in_s
        more_m = scene.leader_speed_m_s[begin : scene.duration_s + 1] - scene.speed_m_s[begin:]
        driven_m = np.cumsum(0.5 * (more_m[1:] + more_m[:-1]))
        misses.append(np.abs(scene.gap_m[begin + 1 :] - scene.gap_m[begin] - driven_m).max())
    assert np.median(misses) < 6.0


def test_too_few_scenes_are_refused() -> None:
    with pytest.raises(
        MeasurementError, match=r"with an adaptive cruise control; allowed: at least 999"
    ):
        measured_scenes(None, print, 999)


def test_the_real_follower_is_driven_exactly(scenes: list[Scene]) -> None:
    run = real_follower(scenes[0], CAR)
    assert run.speed_m_s == pytest.approx(scenes[0].speed_m_s, abs=1e-6)
    assert run.gap_m == pytest.approx(scenes[0].gap_m)


def test_figures_by_hand() -> None:
    """20 m at 10 m/s are 2 s; behind the same lead vehicle, 15 m are always shorter."""
    scene, nearer = made_scene(20.0), made_scene(15.0)
    real, run = real_follower(scene, CAR), real_follower(nearer, CAR)
    parameters = parameters_of(CAR)
    own = figures_of(real, real, scene, parameters)
    assert own["headway_s"] == pytest.approx(2.0)
    assert own["jerk_m_s3"] == pytest.approx(0.0, abs=1e-9)
    assert own["energy_saving"] == own["aging_saving"] == own["end_kinetic_kj"] == 0.0
    assert math.isnan(own["below_percent"])
    figures = figures_of(run, real, scene, parameters)
    assert (figures["below_percent"], figures["above_percent"]) == (100.0, 0.0)
    assert figures["headway_s"] == pytest.approx(1.5)
    assert figures["end_gap_m"] == pytest.approx(-5.0)
    assert figures["energy_saving"] == pytest.approx(0.0, abs=1e-9)
    assert not figures["collided"]


def test_the_limits_of_the_gap_leave_room() -> None:
    """At 10 m/s, 5 m take 0.5 s of 2 s, and 0.3 s are left between the limits."""
    limits = headway_overrides(made_scene(20.0), CAR)
    assert limits["gap.max_time_headway_s"] == 2.0
    assert limits["gap.time_headway_s"] == pytest.approx(1.2)
    assert headway_overrides(made_scene(40.0), CAR)["gap.time_headway_s"] == 1.5
