"""Behind measured lead vehicles: scenes, the real follower in the model, figures by hand, the command."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from iptm.studies.acc_benchmark.cli import main
from iptm.studies.acc_benchmark.comparison import figures_of, spread
from iptm.studies.acc_benchmark.drives import (
    VARIANTS,
    headway_overrides,
    parameters_of,
    real_follower,
)
from iptm.studies.acc_benchmark.page import REAL, benchmark_page, draw_picture
from iptm.studies.acc_benchmark.scenes import LONGEST_S, RUN_IN_S, Scene, measured_scenes
from iptm_core.errors import MeasurementError
from iptm_core.parameters import DEFAULT_SET
from iptm_core.routes import build_route

CAR = DEFAULT_SET


def made_scene(gap_m: float = 20.0) -> Scene:
    """A lead vehicle and its follower go at 10 m/s after a run-in of 20 s; 30 s are measured."""
    speeds = np.minimum(np.arange(51.0), 10.0)
    return Scene("made", 20, 50, np.append(speeds, np.full(30, 10.0)), speeds, np.full(51, gap_m))


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return measured_scenes(None, print)


def test_the_excerpts_have_forty_lead_vehicles(scenes: list[Scene], tmp_path: Path) -> None:
    assert len({scene.name for scene in scenes}) == len(scenes) >= 40
    for scene in scenes:
        assert scene.run_in_s in {0, RUN_IN_S}
        assert 60 <= scene.duration_s + 1 - scene.run_in_s <= LONGEST_S
        assert scene.speed_m_s.size == scene.gap_m.size == scene.duration_s + 1
        assert scene.gap_m.min() > 0.0
        assert scene.leader_speed_m_s[0] == scene.speed_m_s[0] == 0.0
        assert 0.8 < scene.largest_headway_s < 10.0
    for scene in scenes[::10]:
        route = build_route(scene.write(tmp_path), initial_gap_m=15.0)
        seconds = np.arange(scene.duration_s + 1)
        assert route.leader.speeds_at(seconds) == pytest.approx(
            scene.leader_speed_m_s[seconds], abs=1e-3
        )


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


def test_the_short_version(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    store = str(tmp_path / "store")
    assert main(["--short", "--dry-run", "--store", store]) == 0
    assert len(capfd.readouterr().out.splitlines()) == 2 * len(VARIANTS)
    assert main(["--short", "--stored", "--store", store]) == 2
    assert "lacks runs" in capfd.readouterr().err


def test_the_page_shows_every_way(tmp_path: Path, scenes: list[Scene]) -> None:
    variants = (REAL, *(variant.name for variant in VARIANTS))
    rows = pd.DataFrame(
        {"car": CAR, "variant": variant} | figures_of(real, real, scene, parameters_of(CAR))
        for scene in scenes[:2]
        for real in (real_follower(scene, CAR),)
        for variant in variants
    )
    text = benchmark_page("scripts/acc_benchmark", [CAR], rows, {})
    draw_picture(tmp_path, [CAR], rows)
    assert "behind 2 lead\nvehicles" in text
    assert all(text.count(f"| {name} |") == 2 for name in variants)
    known = pd.Series([1.0, 2.0, 3.0, 4.0, 5.0, math.nan])
    assert (spread(known, 1), spread(known[5:], 1)) == ("3.0 (2.0 to 4.0)", "–")
    assert (tmp_path / "images" / "acc-benchmark.png").is_file()
