"""Upper bounds of the road: limits, curves, and the drive of an attentive driver within them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.errors import RouteError
from iptm_core.road_ahead import (
    BRAKING_M_S2,
    HARDEST_M_S2,
    START_M_S2,
    SpeedLimits,
    Stop,
    lawful_drive,
    limits_of_curves,
    limits_of_drive,
)
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine, step_deg

TOWN = SpeedLimits(np.array([0.0, 500.0]), np.array([20.0, 10.0]))
ORIGIN = (48.0, 10.0)


@pytest.mark.parametrize(
    ("starts", "limits"),
    [([], []), ([0.0], [0.0]), ([0.0], [math.nan]), ([5.0, 5.0], [1.0, 2.0]), ([0.0], [1.0, 2.0]),
     ([math.nan, 1.0], [1.0, 2.0])],
)  # fmt: skip
def test_limits_that_bound_nothing_are_refused(starts: list[float], limits: list[float]) -> None:
    with pytest.raises(RouteError, match="speed limits"):
        SpeedLimits(np.array(starts), np.array(limits))


def test_of_two_limits_the_lower_one_holds_everywhere() -> None:
    both = TOWN.and_not_above(SpeedLimits(np.array([100.0, 700.0]), np.array([15.0, 5.0])))
    places = np.array([-1.0, 50.0, 100.0, 499.0, 500.0, 699.0, 700.0])
    assert both.at_m_s(places).tolist() == [15.0, 15.0, 15.0, 15.0, 10.0, 10.0, 5.0]
    part = both.between(550.0, 650.0)
    assert part.at_m_s(np.array([550.0, 650.0])).tolist() == [10.0, 10.0]


def test_a_lower_limit_is_approached_with_comfortable_braking() -> None:
    ahead_m = (20.0**2 - 10.0**2) / (2.0 * BRAKING_M_S2)
    assert TOWN.approach_at_m_s(500.0 - ahead_m - 1.0) == 20.0
    assert TOWN.approach_at_m_s(500.0 - 50.0) == pytest.approx(math.sqrt(10.0**2 + 2.0 * 50.0))
    assert TOWN.approach_at_m_s(500.0) == 10.0


def test_a_lawful_drive_keeps_limits_and_halts_at_a_stop_until_it_opens() -> None:
    drive = lawful_drive(TOWN, (Stop(800.0, 110.0), Stop(900.0, 100.0)), (0.0, 0.0, 0.0), 300, 0.5)
    times, places, speeds = drive.times_s, drive.positions_m, drive.speeds_m_s
    # At the end of every step the limit holds that is there by then.
    assert np.all(speeds <= TOWN.at_m_s(places) + 0.5)
    gains = np.diff(speeds) / 0.5
    assert gains.max() <= START_M_S2 + 1e-9
    assert gains.min() > -HARDEST_M_S2
    held = times < 110.0
    assert places[held].max() == pytest.approx(800.0, abs=0.05)
    assert speeds[held][-1] == pytest.approx(0.0, abs=0.05)
    # The second one has opened by then.
    assert places[-1] > 950.0


def test_a_lawful_drive_stays_behind_a_leader() -> None:
    room = 60.0 + 8.0 * 0.5 * np.arange(121)
    drive = lawful_drive(TOWN, (), (0.0, 0.0, 12.0), 120, 0.5, room, headway_s=1.5)
    assert 0.0 < room[-1] - drive.positions_m[-1] < 20.0
    assert drive.speeds_m_s[-1] == pytest.approx(8.0, abs=0.01)


def test_limits_of_wltc_are_the_legal_classes_of_its_parts() -> None:
    found = limits_of_drive(build_route("wltc_class3b", initial_gap_m=15.0).leader)
    assert (found.limits_m_s * 3.6).round(6).tolist() == [50, 60, 50, 30, 30, 80, 100, 130]
    assert found.starts_m[0] == pytest.approx(15.0, abs=0.1)


def test_a_drive_keeps_the_limits_that_it_suggests() -> None:
    for cycle in ("us06", "nycc", "udds"):
        motion = build_route(cycle, initial_gap_m=15.0).leader
        limits = limits_of_drive(motion).at_m_s(motion.positions_m)
        assert np.all(motion.speeds_m_s <= 1.03 * limits + 1e-9)


def circle(radius_m: float) -> RoadLine:
    """A straight road of 500 m due north, then a bend to the right."""
    north = np.arange(0.0, 501.0, 5.0)
    angle = np.arange(0.0, np.pi, 5.0 / radius_m)[1:]
    easts = np.concatenate([np.zeros(north.size), radius_m * (1.0 - np.cos(angle))])
    norths = np.concatenate([north, 500.0 + radius_m * np.sin(angle)])
    places = [step_deg(*ORIGIN, east, there) for east, there in zip(easts, norths, strict=True)]
    return RoadLine(
        np.array([float(place[0]) for place in places]),
        np.array([float(place[1]) for place in places]),
    )


@pytest.mark.parametrize("radius_m", [60.0, 150.0, 400.0])
def test_a_curve_is_passed_with_its_lateral_acceleration(radius_m: float) -> None:
    limits = limits_of_curves(circle(radius_m), 2.0)
    expected_m_s = math.sqrt(2.0 * radius_m)
    inside = limits.at_m_s(np.array([560.0, 600.0]))
    assert inside == pytest.approx(expected_m_s, rel=0.03)
    assert limits.at_m_s(np.array([300.0]))[0] >= 55.0


def test_a_straight_road_has_no_curves() -> None:
    assert limits_of_curves(RoadLine.test_road(), 2.0).limits_m_s.min() >= 55.0
