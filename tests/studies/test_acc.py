"""The benchmark behind measured lead vehicles: its scenes, and its figures by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from studies.acc.figures import figures_of
from studies.acc.run import real_follower
from studies.acc.scenes import Scene, measured_scenes
from studies.acc.variants import parameters_of

from iptm_core.parameters import DEFAULT_SET

CAR, AMBIENT_C = DEFAULT_SET, 35.0


def made_scene(gap_m: float = 20.0) -> Scene:
    """A lead vehicle and its follower go at 10 m/s after a run-in of 20 s; 30 s are measured."""
    speeds = np.minimum(np.arange(51.0), 10.0)
    return Scene("made", 20, 50, np.append(speeds, np.full(30, 10.0)), speeds, np.full(51, gap_m))


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return measured_scenes()


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
