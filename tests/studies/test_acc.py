"""The benchmark behind measured lead vehicles: its scenes, and its figures by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest
from studies.acc.figures import figures_of
from studies.acc.run import real_follower
from studies.acc.scenes import JOINT, Scene, joined, measured_scenes
from studies.acc.variants import Setting, equal_headways, headway_overrides, parameters_of
from studies.session import Case, Session

from iptm_core.errors import MeasurementError
from iptm_core.parameters import DEFAULT_SET

CAR, AMBIENT_C = DEFAULT_SET, 35.0


def made_scene(gap_m: float = 20.0) -> Scene:
    """A lead vehicle and its follower go at 10 m/s after a run-in of 20 s; 30 s are measured."""
    speeds = np.minimum(np.arange(51.0), 10.0)
    return Scene("made", 20, 50, np.append(speeds, np.full(30, 10.0)), speeds, np.full(51, gap_m))


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return measured_scenes()


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
        measured_scenes(999)


def test_the_real_follower_is_driven_exactly(scenes: list[Scene]) -> None:
    run = real_follower(scenes[0], CAR, AMBIENT_C)
    assert run.speed_m_s == pytest.approx(scenes[0].speed_m_s, abs=1e-6)
    assert run.gap_m == pytest.approx(scenes[0].gap_m)


def test_figures_by_hand() -> None:
    """20 m at 10 m/s are 2 s; behind the same lead vehicle, 15 m are always shorter."""
    scene, nearer = made_scene(20.0), made_scene(15.0)
    real, run = (real_follower(one, CAR, AMBIENT_C) for one in (scene, nearer))
    parameters = parameters_of(CAR, AMBIENT_C)
    own = figures_of(real, scene, parameters, real, {"base": run})
    assert own["headway_s"] == pytest.approx(2.0)
    assert own["jerk_m_s3"] == pytest.approx(0.0, abs=1e-9)
    assert own["real_energy"] == own["real_ageing"] == own["off_headway_s"] == 0.0
    assert math.isnan(own["below_percent"])
    figures = figures_of(run, scene, parameters, real, {"base": run})
    assert figures["below_percent"] == 100.0
    assert figures["headway_s"] == pytest.approx(1.5)
    assert figures["off_headway_s"] == pytest.approx(0.5)
    assert figures["real_energy"] == pytest.approx(0.0, abs=1e-9)
    assert figures["base_energy"] == figures["base_ageing"] == 0.0
    assert not figures["collided"]


def test_scenes_are_joined_where_both_are_alike() -> None:
    """30 s at 10 m/s from 20 m, then 30 s of another one from 22 m; one from 30 m cannot follow."""
    scene, other, far = (
        replace(made_scene(gap_m), name=str(gap_m)) for gap_m in (20.0, 22.0, 30.0)
    )
    found, used = joined([scene, far, other], 25)
    assert used == 2
    assert found.run_in_s == 20
    assert len(found.states) == 25
    assert np.all(np.abs(np.diff(found.states, axis=0)) <= JOINT)
    assert set(found.gap_m) <= {20.0, 22.0}
    with pytest.raises(MeasurementError, match="allowed: at least"):
        joined([scene, far], 200)


def test_the_limits_of_the_gap_leave_room() -> None:
    """At 10 m/s, 5 m take 0.5 s of 2 s, and 0.3 s are left between the limits."""
    limits = headway_overrides(made_scene(20.0), CAR, 2.0)
    assert limits["gap.max_time_headway_s"] == 2.0
    assert limits["gap.time_headway_s"] == pytest.approx(1.2)
    assert headway_overrides(made_scene(40.0), CAR, 4.0)["gap.time_headway_s"] == 1.5


def test_the_search_for_the_real_headway_follows_what_was_driven(tmp_path: Path) -> None:
    """With 0.5 s less than the limit, 2.5 s make the real 2 s; where nothing helps, the first one is kept."""

    class Driver:
        short, scratch = False, tmp_path

        def __init__(self, headway_s: Callable[[float], float]) -> None:
            self.headway_s, self.limits_s = headway_s, list[float]()

        def drive(self, cases: Sequence[Case]) -> pd.DataFrame:
            self.limits_s += [case.call["overrides"]["gap.max_time_headway_s"] for case in cases]
            headway_s = self.headway_s(self.limits_s[-1])
            speed = np.full(51, 10.0)
            trajectory = SimpleNamespace(
                speed_m_s=speed, gap_m=headway_s * speed, has_leader=np.full(speed.shape, True)
            )
            return pd.DataFrame({"run": [SimpleNamespace(trajectory=trajectory)]})

    settings = [Setting(made_scene(20.0), CAR, AMBIENT_C)]
    less, same = Driver(lambda limit_s: limit_s - 0.5), Driver(lambda _: 1.5)
    assert equal_headways(cast("Session", less), settings, 3) == [pytest.approx(2.5)]
    assert less.limits_s == [pytest.approx(2.2), pytest.approx(2.5)]
    assert equal_headways(cast("Session", same), settings, 3) == [pytest.approx(2.2)]
    assert len(same.limits_s) == 3
