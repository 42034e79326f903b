"""The lead vehicle's motion as worked out in C is the one of Python, to the last bit."""

from __future__ import annotations

import ctypes
from dataclasses import astuple

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_scene

from iptm_controller.forecast import LeaderForecast, LeaderForecaster
from iptm_controller.safeguards import CollisionGuard
from iptm_controller.tick_library import tick_library
from iptm_core.frozen import replace
from iptm_core.state import LeaderPreview, LeaderState


@pytest.fixture(scope="module")
def library() -> ctypes.PyDLL:
    found = tick_library(is_wanted=True)
    if found is None:
        pytest.skip("no C compiler on this machine")
    return found


def some_preview(rng: np.random.Generator, leader: LeaderState) -> LeaderPreview:
    """Return a preview that is whole, spoilt, noisy, old or bounded."""
    nodes = int(rng.choice([0, 1, 2, 30]))
    speeds = np.maximum(leader.speed_m_s + np.cumsum(rng.normal(0.0, 0.7, nodes)), 0.0)
    times = leader.time_s - rng.choice([0.0, 0.3, 3.0]) + np.arange(nodes)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])[:nodes]
    preview = LeaderPreview(times, leader.position_m + moved, speeds)
    kind = rng.integers(9)
    if kind == 0 and nodes:
        name = str(rng.choice(["times_s", "positions_m", "speeds_m_s"]))
        spoilt = getattr(preview, name).copy()
        spoilt[rng.integers(nodes)] = rng.choice([np.nan, np.inf, -1.0, 101.0, -0.1])
        return replace(preview, **{name: spoilt})
    if kind == 1 and nodes:
        return replace(preview, speeds_m_s=speeds[:-1])
    if kind == 2:
        return replace(preview, bounds_m=0.02 * np.arange(nodes) ** 2)
    return preview


def assert_equal(one: LeaderForecast, other: LeaderForecast) -> None:
    for motion, expected in ((one.motion, other.motion), (one.limiting, other.limiting)):
        pairs = zip(astuple(motion), astuple(expected), strict=True)
        assert all(np.array_equal(*pair, equal_nan=True) for pair in pairs)
    assert (one.quality, one.reason, one.known_s) == (other.quality, other.reason, other.known_s)
    assert np.array_equal(one.age_s, other.age_s, equal_nan=True)


@pytest.mark.parametrize("seed", range(6))
def test_forecasts_and_their_collisions_are_those_of_python(
    library: ctypes.PyDLL, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    limits = PARAMETERS.limits
    forecasters = [LeaderForecaster(28.0, 2.0, 1.0, each) for each in (None, library)]
    guards = [CollisionGuard(limits, 1.0, 3, each) for each in (None, library)]
    leader, collisions = LeaderState(0.0, 50.0, float(rng.uniform(0.0, 25.0))), set()
    for tick in range(150):
        speed = max(leader.speed_m_s + float(rng.normal(0.0, 1.0)), 0.0)
        moved_m = 0.5 * (speed + leader.speed_m_s)
        leader = LeaderState(float(tick), leader.position_m + moved_m, speed)
        preview = some_preview(rng, leader)
        expected, found = (each.forecast(leader, preview) for each in forecasters)
        assert_equal(found, expected)
        assert repr(forecasters[1].trust.memory) == repr(forecasters[0].trust.memory)
        assert forecasters[1].fusion.noise == forecasters[0].fusion.noise
        ego = replace(
            make_scene(speed_m_s=float(rng.uniform(0.0, 30.0))).state,
            time_s=leader.time_s + float(rng.choice([0.0, 0.2])),
            position_m=leader.position_m - float(rng.uniform(0.0, 80.0)),
        )
        case = float(rng.uniform(-3.0, 2.0)), ego
        share = float(rng.choice([1.0, 0.7]))
        for each in guards:
            each.observe(leader)
        threats = [
            [each.collision_threatens(*case, given, share) for given in (found, None)]
            for each in guards
        ]
        assert threats[0] == threats[1]
        collisions.update(threats[0])
    assert collisions == {True, False}
