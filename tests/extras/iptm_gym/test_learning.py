"""Policies that learn: costs beside the environment's, progress, the command, and files with a digest."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_gym.cli import main
from iptm_gym.learning import Trips, costs_eur_km, generations
from iptm_gym.policy import HEADWAY_S, LearnedPolicy


def test_trips_side_by_side_cost_what_they_cost_in_the_environment() -> None:
    """Steps of a second beside the plant's own integration: energy and road within 5 %."""
    pytest.importorskip("gymnasium")
    environment = import_module("iptm_gym.environment")
    speeds = np.concatenate((np.linspace(0.0, 20.0, 41), np.full(160, 20.0)))
    air_k, flat = np.array([290.0]), np.array([1e-9])
    trips = Trips(speeds[np.newaxis], np.zeros((1, 201)), air_k, air_k, flat, flat)
    policy = LearnedPolicy.first(1)
    weights = policy.weights.copy()
    weights[policy.direct.shape[1] : 2 * policy.direct.shape[1]] = 0.0  # does not cool
    policy = LearnedPolicy.of(weights)
    car = load_parameters().values
    trip = iptm.Trip.of(
        (np.arange(201.0), speeds), climate=290.0 - 273.15, overrides={"limits.max_jerk_m_s3": 2.0}
    )
    env = environment.TripEnv(trip, headway_s=HEADWAY_S)
    observed, _ = env.reset(seed=1)
    paid, ended = 0.0, False
    while not ended:
        observed, _, terminated, truncated, info = env.step(policy.act(observed))
        paid += info["energy_eur"] + info["road_eur"]
        ended = terminated or truncated
    in_arrays = float(costs_eur_km(policy.weights[np.newaxis], trips, car)[0])
    km = info["run"].metrics.distance_m / 1e3
    assert in_arrays == pytest.approx(paid / km, rel=0.05)


def test_later_generations_cost_less_and_repeat() -> None:
    held_out = Trips.drawn(np.random.default_rng(99), 8)
    car = load_parameters().values
    runs = [[next(found) for _ in range(8)] for found in (generations(3), generations(3))]
    np.testing.assert_array_equal(runs[0][-1].policy.weights, runs[1][-1].policy.weights)
    tried = np.array([LearnedPolicy.first(3).weights, runs[0][-1].policy.weights])
    first, learned = costs_eur_km(tried, held_out, car)
    assert learned < 0.9 * first


def test_the_command_writes_a_policy_that_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "policy.json"
    assert main([str(path), "--generations", "2"]) == 0
    assert "generation 2:" in capsys.readouterr().out
    policy = LearnedPolicy.read(path)
    run = iptm.simulate("us06", duration_s=60.0, controller=policy)
    assert run.metrics.distance_m > 100.0
    assert main([str(tmp_path), "--generations", "1"]) == 2
    assert main([str(path), "--generations", "0"]) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"digest": "x", "weights": [1, 2]}', "shape"),
        ('{"digest": "x", "weights": "no"}', "numbers"),
        ('{"weights": []}', "shape"),
    ],
)
def test_another_file_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=words):
        LearnedPolicy.read(path)


def test_changed_weights_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    LearnedPolicy.first(1).write(path)
    path.write_text(path.read_text("utf-8").replace("0.8,", "0.9,", 1), encoding="utf-8")
    with pytest.raises(ScenarioError, match="digest is another one"):
        LearnedPolicy.read(path)
