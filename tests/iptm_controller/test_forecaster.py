"""Forecasts of the lead vehicle and collisions with it are in C what they are in Python, to the last bit."""

from __future__ import annotations

import ctypes
from dataclasses import astuple

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_forecaster, make_scene
from tests.reference.leader_forecast import ReferenceForecaster

from iptm_controller.forecast import LeaderForecast, LeaderForecaster, PreviewQuality
from iptm_controller.safeguards import CollisionGuard
from iptm_controller.tick_library import tick_library
from iptm_core.frozen import replace
from iptm_core.state import LeaderPreview, LeaderState


@pytest.fixture(scope="module")
def library() -> ctypes.PyDLL:
    return tick_library()


def some_preview(rng: np.random.Generator, leader: LeaderState) -> LeaderPreview:
    """Return a preview that is whole, spoilt, noisy, old or bounded."""
    nodes = int(rng.choice([0, 1, 2, *[40] * 9, 150]))
    noise = float(rng.choice([0.05, 0.05, 0.7]))
    speeds = np.maximum(leader.speed_m_s + np.cumsum(rng.normal(0.0, noise, nodes)), 0.0)
    times = leader.time_s - rng.choice([*[0.0] * 6, 0.3, 3.0]) + np.arange(nodes)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]))])[:nodes]
    preview = LeaderPreview(times, leader.position_m + moved, speeds)
    kind = rng.integers(20)
    if kind == 0 and nodes:
        name = str(rng.choice(["times_s", "positions_m", "speeds_m_s"]))
        spoilt = getattr(preview, name).copy()
        spoilt[rng.integers(nodes)] = rng.choice([np.nan, np.inf, -1.0, 101.0, -0.1])
        return replace(preview, **{name: spoilt})
    if kind == 1 and nodes:
        return replace(preview, speeds_m_s=speeds[:-1])
    if kind < 5:
        return replace(preview, bounds_m=rng.choice([0.001, 0.02]) * np.arange(nodes) ** 2)
    if kind == 5 and nodes:  # an estimator at standstill
        back = rng.uniform(-0.2, 0.0, nodes)
        return replace(preview, speeds_m_s=back, positions_m=leader.position_m + back)
    return preview


def assert_equal(one: LeaderForecast, other: LeaderForecast) -> None:
    for motion, expected in ((one.motion, other.motion), (one.limiting, other.limiting)):
        pairs = zip(astuple(motion), astuple(expected), strict=True)
        assert all(np.array_equal(*pair, equal_nan=True) for pair in pairs)
    assert (one.quality, one.reason, one.known_s) == (other.quality, other.reason, other.known_s)
    assert np.array_equal(one.age_s, other.age_s, equal_nan=True)


@pytest.mark.parametrize("tick_s", [1.0, 0.5, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_forecasts_are_those_of_python(library: ctypes.PyDLL, seed: int, tick_s: float) -> None:
    """Whichever of the two has the memory."""
    rng = np.random.default_rng(seed)
    given = 28.0, 2.0, tick_s, 0.5 if seed % 2 else 4.0, 4.0 + 8.0 * seed
    forms = ReferenceForecaster(*given), LeaderForecaster(library, *given)
    leader, seen = LeaderState(0.0, 50.0, float(rng.uniform(0.0, 25.0))), set()
    for tick in range(400):
        speed = max(leader.speed_m_s + float(rng.normal(0.0, 0.7)) * tick_s, 0.0)
        moved_m = 0.5 * (speed + leader.speed_m_s) * tick_s
        leader = LeaderState(tick * tick_s, leader.position_m + moved_m, speed)
        if tick == 300:  # another trip
            leader = replace(leader, time_s=2.0 * tick_s)
        preview = some_preview(rng, leader)
        expected, found = (each.forecast(leader, preview) for each in forms)
        assert_equal(found, expected)
        later_s = leader.time_s + float(rng.choice([0.0, 0.7, 30.0]))
        assert forms[1].leader_at(later_s, leader) == forms[0].leader_at(later_s, leader)
        assert forms[1].noise == forms[0].noise
        assert repr(forms[1].memory[::2]) == repr(forms[0].memory[::2])
        if tick % 50 == 49:
            memories = [each.memory for each in forms]
            forms[0].memory, forms[1].memory = memories[1], memories[0]
        seen.add((found.quality, found.limiting is found.motion, forms[0].noise == ""))
        if tick == 300:
            leader = replace(leader, time_s=tick * tick_s)
    assert {quality for quality, *_ in seen} == set(PreviewQuality)
    assert {limits for _, limits, _ in seen} == {is_quiet for *_, is_quiet in seen} == {True, False}


@pytest.mark.parametrize("seed", range(3))
def test_collisions_are_those_of_python(library: ctypes.PyDLL, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = PARAMETERS.limits
    forecaster = make_forecaster(max_age_s=2.0)
    guards = [CollisionGuard(limits, 1.0, 3, each) for each in (None, library)]
    leader, collisions = LeaderState(0.0, 50.0, float(rng.uniform(0.0, 25.0))), set()
    for tick in range(150):
        speed = max(leader.speed_m_s + float(rng.normal(0.0, 1.0)), 0.0)
        moved_m = 0.5 * (speed + leader.speed_m_s)
        leader = LeaderState(float(tick), leader.position_m + moved_m, speed)
        forecast = forecaster.forecast(leader, some_preview(rng, leader))
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
            [each.collision_threatens(*case, given, share) for given in (forecast, None)]
            for each in guards
        ]
        assert threats[0] == threats[1]
        collisions.update(threats[0])
    assert collisions == {True, False}
