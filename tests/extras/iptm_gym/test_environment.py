"""Trips as environments: Gymnasium's own checks, figures of `iptm.simulate`, rewards, wrappers, refusals."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

import iptm
from iptm.driving import controller_for
from iptm_core.state import FloatArray
from iptm_gym.observation import ACTIONS, OBSERVED

gymnasium = pytest.importorskip("gymnasium")
environment = import_module("iptm_gym.environment")
parts = import_module("iptm_gym.parts")
# Gymnasium's checks warn of what they would rather see; none of it is an error.
pytestmark = pytest.mark.filterwarnings("default::UserWarning")

NAME = "iptm_gym.environment:iptm/Trip-v0"
SAME = 1e-6
OF_A_SOLVER = ("solve", "iterations", "commands")
EVERYTHING = {
    "cycle": "us06",
    "slope": "small",
    "duration_s": 120.0,
    "latency_s": 0.5,
    "dropout_probability": 0.2,
    "noise_std_m_s": 1.0,
    "noise_correlation_s": 10.0,
}


class Replay:
    """Commands of an episode as a controller."""

    def __init__(self, actions: list[FloatArray]) -> None:
        self._actions = iter(actions)

    def decide(self, _: iptm.Measurements) -> iptm.Command:
        return iptm.Command(*map(float, next(self._actions)))


def episode(env: Any, policy: Any, seed: int = 7) -> tuple[iptm.Run, list[FloatArray], float]:
    env.reset(seed=seed)
    actions, gained, ended = [], 0.0, False
    while not ended:
        actions.append(policy(env))
        observed, reward, terminated, truncated, info = env.step(actions[-1])
        assert env.observation_space.contains(observed)
        gained += reward
        ended = terminated or truncated
    return info["run"], actions, gained


def random_policy() -> Any:
    rng = np.random.default_rng(3)

    def act(env: Any) -> FloatArray:
        gap_m = env.unwrapped.measured.leader.position_m - env.unwrapped.measured.state.position_m
        at_most = env.action_space.high[0] if gap_m > 40.0 else -1.0
        low, high = env.action_space.low, env.action_space.high
        return rng.uniform(low, [max(at_most, low[0]), high[1]])

    return act


def assert_same_figures(run: iptm.Run, other: iptm.Run) -> None:
    for name, values in other.trajectory.to_arrays().items():
        np.testing.assert_allclose(getattr(run.trajectory, name), values, SAME, SAME, err_msg=name)
    own, figures = run.figures, other.figures
    # An action has no solver behind it.
    keys = [key for key in own if not any(word in key for word in OF_A_SOLVER)]
    keys = [key for key in keys if np.isfinite(figures[key])]
    assert len(keys) > 20
    for key in keys:
        assert own[key] == pytest.approx(figures[key], rel=SAME, abs=SAME), key


def test_gymnasium_accepts_it() -> None:
    checker = import_module("gymnasium.utils.env_checker")
    trip = iptm.Trip.of("us06", duration_s=20.0)
    checker.check_env(gymnasium.make(NAME, trip=trip).unwrapped, skip_render_check=True)


def test_a_random_policy_gives_the_figures_of_simulate() -> None:
    env = gymnasium.make(NAME, trip=iptm.Trip.of(**EVERYTHING))
    run, actions, _ = episode(env, random_policy())
    assert_same_figures(run, iptm.simulate(**EVERYTHING, seed=7, controller=Replay(actions)))


def test_the_mpc_gives_the_figures_of_simulate() -> None:
    env = gymnasium.make(NAME, trip=iptm.Trip.of(**EVERYTHING))
    mpc = controller_for(iptm.Trip.of(**EVERYTHING, seed=7).checked())

    def act(env: Any) -> FloatArray:
        command = mpc.decide(env.unwrapped.measured).command
        return np.array([getattr(command, name) for name in ACTIONS])

    run, _, _ = episode(env, act)
    assert_same_figures(run, iptm.simulate(**EVERYTHING, seed=7))


def test_rewards_add_up_to_the_cost_of_the_run() -> None:
    env = gymnasium.make(NAME, trip=iptm.Trip.of(**EVERYTHING), headway_s=1.5)
    env.reset(seed=7)
    costs, total, ended = environment.TickCosts, 0.0, False
    parts_eur = np.zeros(3)
    begin = env.unwrapped.measured.state
    policy = random_policy()
    while not ended:
        _, reward, terminated, truncated, info = env.step(policy(env))
        parts_eur += [info[name] for name in ("energy_eur", "aging_eur", "road_eur")]
        total += reward
        ended = terminated or truncated
    assert total == pytest.approx(-parts_eur.sum())
    run: iptm.Run = info["run"]
    hundreds = run.metrics.distance_m / 1e5
    cost = run.cost()
    assert parts_eur[0] == pytest.approx(cost.energy_eur * hundreds, rel=SAME)
    use = run.trip.controller
    parked = costs(run.parameters, use, 1.5)._lost_parked(begin)
    price = costs(run.parameters, use, 1.5)._capacity_eur
    aging_eur = (cost.driving_eur + cost.parked_eur) * hundreds - price * parked
    assert parts_eur[1] == pytest.approx(aging_eur, rel=1e-4)
    rows = run.trajectory
    off_m = rows.gap_m - run.parameters.gap.standstill_gap_m - 1.5 * rows.speed_m_s
    assert parts_eur[2] == pytest.approx(0.0025 / 3600.0 * np.sum(off_m[1:] ** 2))


def test_environments_run_side_by_side() -> None:
    trips = [iptm.Trip.of("us06", duration_s=5.0), iptm.Trip.of("nycc", duration_s=5.0)]
    envs = gymnasium.make_vec(NAME, num_envs=3, vectorization_mode="sync", trip=trips)
    observed, _ = envs.reset(seed=1)
    assert observed.shape == (3, len(OBSERVED))
    ends = np.zeros(3, dtype=int)
    for _ in range(12):
        observed, rewards, _, truncated, _ = envs.step(envs.action_space.sample())
        assert rewards.shape == (3,)
        ends += truncated
    assert ends.tolist() == [2, 2, 2]
    envs.close()


def test_several_trips_are_drawn_by_the_seed() -> None:
    trips = [iptm.Trip.of(cycle, duration_s=5.0) for cycle in ("us06", "nycc", "hwfet")]
    env = gymnasium.make(NAME, trip=trips).unwrapped

    def drawn(seed: int | None) -> str:
        env.reset(seed=seed)
        return str(env.trip.road.cycle)

    assert len({drawn(seed) for seed in range(12)}) == 3
    assert drawn(5) == drawn(5)
    first = [drawn(5), drawn(None), drawn(None)]
    assert first == [drawn(5), drawn(None), drawn(None)]


def test_a_touched_leader_ends_the_episode() -> None:
    trip = iptm.Trip.of("nycc", duration_s=60.0, overrides={"gap.initial_gap_m": 8.0})
    trip = trip.changed(safety_monitor=False)
    env = gymnasium.make(NAME, trip=trip)
    env.reset(seed=0)
    ended, ticks = False, 0
    while not ended:
        _, _, ended, truncated, info = env.step(env.action_space.high)
        ticks += 1
        assert not truncated
    assert ticks < 60
    assert "run" not in info


@pytest.mark.parametrize(("wrapper", "other"), [("MotionOnly", 1), ("CoolingOnly", 0)])
def test_one_half_is_driven_by_the_car_of_today(wrapper: str, other: int) -> None:
    today = iptm.simulate("us06", duration_s=60.0, strategy="production", preview_mode="none")
    trip = iptm.Trip.of("us06", duration_s=60.0, preview_mode="none")
    env = getattr(parts, wrapper)(gymnasium.make(NAME, trip=trip))
    assert env.action_space.shape == (1,)
    rows = today.trajectory
    column = ("acceleration_m_s2", "compressor_power_w")[1 - other]
    commands = iter(getattr(rows, column)[1:])
    run, _, _ = episode(env, lambda _: np.array([next(commands)]))
    # What `production` does itself and what is replayed of it make the same trip.
    np.testing.assert_allclose(run.trajectory.position_m, rows.position_m, atol=0.5)
    np.testing.assert_allclose(run.trajectory.compressor_power_w, rows.compressor_power_w, atol=1.0)


@pytest.mark.parametrize(
    ("trip", "words"),
    [
        ("nowhere", "nowhere"),
        ([], "at least one trip"),
        (iptm.Trip.of("us06", leader_source="none", set_speed_km_h=50.0), "leader_source is none"),
    ],
)
def test_trips_that_cannot_be_driven_are_refused(trip: Any, words: str) -> None:
    with pytest.raises(iptm.IptmError, match=words):
        environment.TripEnv(trip)


def test_a_step_needs_an_episode() -> None:
    env = environment.TripEnv(iptm.Trip.of("us06", duration_s=5.0))
    with pytest.raises(iptm.IptmError, match="after reset"):
        env.step(env.action_space.low)
