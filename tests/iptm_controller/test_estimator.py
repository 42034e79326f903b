"""Noise in the measurements: perfect ones pass unchanged, noisy ones are filtered."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.iptm_controller.scenes import PARAMETERS, make_state

from iptm_controller.estimator import Estimator, NoiseSettings
from iptm_core.state import LeaderState, VehicleState

TICKS = 300


def truth(tick: int, tick_s: float = 1.0) -> tuple[VehicleState, LeaderState]:
    """Return an ego vehicle at constant acceleration within a tick behind a lead vehicle in gentle waves."""
    time_s = tick * tick_s
    # Integrals of a held acceleration and of a sinusoidal speed.
    held = [0.5 * math.sin(0.3 * index * tick_s) for index in range(tick)]
    speed = 15.0 + sum(held) * tick_s
    state = make_state(
        time_s=time_s,
        position_m=0.0,
        speed_m_s=speed,
        acceleration_m_s2=held[-1] if held else 0.0,
        cell_1_temperature_k=305.0 + 0.01 * time_s,
        cell_n_temperature_k=306.0 + 0.01 * time_s,
    )
    position = 40.0 + 15.0 * time_s + 40.0 * (1.0 - math.cos(0.05 * time_s))
    return state, LeaderState(time_s, position, 15.0 + 2.0 * math.sin(0.05 * time_s))


def noisy(
    random: np.random.Generator, state: VehicleState, leader: LeaderState
) -> tuple[VehicleState, LeaderState]:
    errors = random.standard_normal(5).tolist()
    return (
        replace(
            state,
            speed_m_s=state.speed_m_s + 0.1 * errors[0],
            cell_1_temperature_k=state.cell_1_temperature_k + 0.5 * errors[1],
            cell_n_temperature_k=state.cell_n_temperature_k + 0.5 * errors[2],
        ),
        replace(
            leader,
            position_m=leader.position_m + 0.5 * errors[3],
            speed_m_s=leader.speed_m_s + 0.1 * errors[4],
        ),
    )


def estimator(noise: NoiseSettings | None = None, tick_s: float = 1.0) -> Estimator:
    return Estimator(noise or NoiseSettings(), PARAMETERS.limits, tick_s)


@pytest.mark.parametrize("tick_s", [0.1, 1.0])
def test_perfect_measurements_pass_to_the_last_bit(tick_s: float) -> None:
    filtering = estimator(tick_s=tick_s)
    for tick in range(TICKS):
        state, leader = truth(tick, tick_s)
        assert filtering.update(state, leader) == (state, leader)
    assert filtering.noise == ""


def test_noise_is_noticed_and_its_level_estimated() -> None:
    filtering, random = estimator(), np.random.default_rng(1)
    noticed = None
    for tick in range(TICKS):
        filtering.update(*noisy(random, *truth(tick)))
        if noticed is None and filtering.noise:
            noticed = tick
    assert noticed <= 5
    speed, gap, temperature = filtering._levels
    assert speed == pytest.approx(0.1, rel=0.6)
    assert gap == pytest.approx(0.5, rel=0.6)
    assert temperature == pytest.approx(0.5, rel=0.6)


@pytest.mark.parametrize("stated", [True, False])
def test_filtered_values_are_nearer_to_the_truth(stated: bool) -> None:
    noise = NoiseSettings(0.5, 0.1, 0.5) if stated else NoiseSettings()
    filtering, random = estimator(noise), np.random.default_rng(2)
    raw, filtered, nearer = [], [], 0
    for tick in range(TICKS):
        state, leader = truth(tick)
        measured_state, measured_leader = noisy(random, state, leader)
        estimated_state, estimated_leader = filtering.update(measured_state, measured_leader)
        if tick < 30:
            continue

        def errors(each: VehicleState, lead: LeaderState) -> list[float]:
            return [
                each.speed_m_s - state.speed_m_s,  # noqa: B023  called in the same tick
                lead.speed_m_s - leader.speed_m_s,  # noqa: B023
                each.cell_1_temperature_k - state.cell_1_temperature_k,  # noqa: B023
            ]

        raw.append(errors(measured_state, measured_leader))
        filtered.append(errors(estimated_state, estimated_leader))
        nearer += estimated_leader.position_m <= leader.position_m
    before = np.sqrt(np.mean(np.square(raw), axis=0))
    after = np.sqrt(np.mean(np.square(filtered), axis=0))
    assert after[0] < 0.6 * before[0]
    assert after[1] < before[1]
    assert after[2] < 0.6 * before[2]
    # The margin covers the error of the position in nearly all ticks.
    assert nearer >= 0.97 * (TICKS - 30)


def test_vehicle_that_cuts_in_counts_at_once() -> None:
    filtering, random = estimator(), np.random.default_rng(3)
    for tick in range(50):
        filtering.update(*noisy(random, *truth(tick)))
    state, leader = noisy(random, *truth(50))
    _, nearer = filtering.update(state, replace(leader, position_m=leader.position_m - 25.0))
    assert nearer.position_m <= leader.position_m - 23.0


def test_single_outlier_farther_away_is_discarded_and_a_lasting_one_believed() -> None:
    filtering, random = estimator(), np.random.default_rng(4)
    for tick in range(50):
        filtering.update(*noisy(random, *truth(tick)))
    positions = []
    for tick in (50, 51, 52):
        state, leader = noisy(random, *truth(tick))
        _, seen = filtering.update(state, replace(leader, position_m=leader.position_m + 60.0))
        positions.append(seen.position_m - leader.position_m)
    assert positions[0] < 5.0
    assert positions[1] > 50.0
    assert positions[2] > 50.0


def test_wild_values_do_not_count_as_noise() -> None:
    """One leap of everything is a fault or another vehicle; filters and margins do not follow from it."""
    filtering = estimator()
    for tick in range(20):
        filtering.update(*truth(tick))
    state, leader = truth(20)
    leap = replace(state, speed_m_s=state.speed_m_s + 12.0, cell_1_temperature_k=370.0)
    filtering.update(leap, replace(leader, position_m=leader.position_m - 30.0))
    state, leader = truth(21)
    filtering.update(state, leader)
    assert filtering.noise == ""
