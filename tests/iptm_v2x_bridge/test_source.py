from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.errors import ParameterError, RouteError
from iptm_core.routes import Route, build_route
from iptm_core.settings import PreviewSettings
from iptm_core.state import LeaderPreview
from iptm_v2x_bridge.bridge import CycleSource, preview_times_s

NS = 10**9


def predicted(
    source: CycleSource, time_ns: int, length_s: float = 60.0, step_s: float = 1.0
) -> LeaderPreview:
    settings = PreviewSettings(preview_length_s=length_s, preview_step_s=step_s)
    return source.predict(preview_times_s(settings, time_ns))


@pytest.mark.parametrize(
    ("length_s", "step_s", "nodes"),
    [(60.0, 1.0, 61), (1.0, 1.0, 2), (300.0, 1.0, 301), (10.0, 4.0, 3), (1.0, 0.1, 11)],
)
def test_grid_reaches_as_far_as_whole_steps_go(length_s: float, step_s: float, nodes: int) -> None:
    times = preview_times_s(
        PreviewSettings(preview_length_s=length_s, preview_step_s=step_s), 5 * NS
    )
    assert times.size == nodes
    assert times[0] == 5.0
    assert times[-1] <= 5.0 + length_s


def test_grid_times_are_exact_far_into_the_trip() -> None:
    times = preview_times_s(PreviewSettings(preview_step_s=0.1), 9999 * NS)
    assert times[1] == 9999.1
    assert times[7] == 9999.7
    assert times[-1] == 10059.0


@pytest.mark.parametrize(
    ("length_s", "step_s", "reason"),
    [
        (0.5, 0.1, "preview_length_s is 0.5"),
        (3601.0, 1.0, "preview_length_s is 3601.0"),
        (math.nan, 1.0, "preview_length_s is nan"),
        (10.0, 11.0, "preview_step_s is 11.0"),
        (10.0, 0.0, "preview_step_s is 0.0"),
    ],
)
def test_impossible_grids_are_refused(length_s: float, step_s: float, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason.replace(".", r"\.") + ".*; allowed: "):
        PreviewSettings(preview_length_s=length_s, preview_step_s=step_s)


@pytest.mark.parametrize("tick", [0, 1, 123, 597, 598, 599, 5000])
def test_prediction_starts_exactly_at_the_leader(source: CycleSource, tick: int) -> None:
    preview = predicted(source, tick * NS)
    leader = source.leader_at(tick * NS)
    assert leader.time_s == tick
    assert preview.generated_at_s == preview.times_s[0] == leader.time_s
    assert preview.positions_m[0] == leader.position_m
    assert preview.speeds_m_s[0] == leader.speed_m_s


def test_every_node_comes_true(source: CycleSource) -> None:
    preview = predicted(source, 100 * NS, 120.0, 1.0)
    for index, time_s in enumerate(preview.times_s):
        leader = source.leader_at(round(float(time_s) * NS))
        assert preview.positions_m[index] == leader.position_m
        assert preview.speeds_m_s[index] == leader.speed_m_s


def test_leader_stands_still_past_the_end_of_the_trip(source: CycleSource, route: Route) -> None:
    end_ns = round(route.duration_s) * NS
    preview = predicted(source, end_ns - 10 * NS, 60.0, 1.0)
    past = preview.times_s > route.duration_s + 10.0
    assert past.any()
    assert (preview.speeds_m_s[past] == 0.0).all()
    assert np.unique(preview.positions_m[past]).size == 1


def test_initial_gap_is_the_position_of_the_leader_at_the_start(source: CycleSource) -> None:
    assert source.leader_at(0).position_m == 15.0


def test_slope_is_that_of_the_whole_road(source: CycleSource, route: Route) -> None:
    slope = source.slope_ahead()
    assert slope.positions_m is route.slope.positions_m
    assert slope.slopes_rad is route.slope.slopes_rad
    assert np.abs(np.tan(slope.slopes_rad)).max() == pytest.approx(0.06, abs=0.005)


def test_user_file_drives_the_leader(user_cycle: object) -> None:
    source = CycleSource(build_route(str(user_cycle), initial_gap_m=20.0))
    preview = predicted(source, 0, 4.0, 1.0)
    assert preview.speeds_m_s.tolist() == [0.0, 1.0, 2.0, 2.0, 0.0]
    np.testing.assert_allclose(preview.positions_m - 20.0, [0.0, 0.5, 2.0, 4.0, 5.0], atol=1e-12)


def test_unknown_cycle_is_a_route_error() -> None:
    with pytest.raises(RouteError, match="no_such_cycle"):
        build_route("no_such_cycle", initial_gap_m=15.0)
