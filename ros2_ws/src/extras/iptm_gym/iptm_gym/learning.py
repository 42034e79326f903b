"""Learning by an evolution strategy: changed policies drive the same trips, and the better ones lead.

In a generation, pairs of policies whose weights differ by plus and minus the same normal change drive some
trips; the weights move along the changes in the order of their costs, with Adam (T. Salimans et al.,
arXiv:1703.03864). All policies and trips pass side by side in arrays, by the equations of
`iptm_core.physics` in steps of a second and the cost of the environment, a hundred times as fast as it; but
in place of the hours parked, heat that is left in the pack above its lower limit costs what the chiller needs
for it, or short trips would be won by their end. Lead vehicles are synthetic: published cycles are held out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from iptm_core.aging_laws.parking import (
    PRICED_LAW,
    AgingSettings,
    ParkedAging,
    capacity_price_eur,
)
from iptm_core.parameters import ModelParameters, load_parameters
from iptm_core.physics.car_following import minimum_gap_m
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH, SECONDS_PER_HOUR
from iptm_gym.observation import PREVIEW_S
from iptm_gym.policy import HEADWAY_S, LearnedPolicy, actions, features

TRIPS, TRIP_S = 16, 300
PAIRS, CHANGE, STEP = 16, 0.05, 0.02
JERK_M_S3 = 2.0
FORGETTING, STEADYING = 0.9, 0.99
CLOSE_EUR_M, CRASH_EUR = 1e-3, 1.0
"""Cost of a second for each metre below s_min, which no controller of the suite plans, and of a collision."""
ENDING_COP = 2.4
"""Coefficient of performance of cooling a parked pack, auxiliaries included: chosen, 1.5 to 4 are usual."""
_AHEAD = np.array([round(each) for each in PREVIEW_S])


@dataclass(frozen=True, eq=False)
class Trips:
    """Trips behind synthetic lead vehicles, m of them of n seconds.

    Attributes:
        leader_m_s: speeds, shape (m, n + 1).
        error_m_s: of the preview at its end, shape (m, n + 1).
        air_k: of the air, shape (m,).
        pack_k: of the pack at the start, shape (m,).
        steepest_rad: amplitude of a road that goes up and down, shape (m,).
        hill_m: length of a hill, shape (m,).
    """

    leader_m_s: FloatArray
    error_m_s: FloatArray
    air_k: FloatArray
    pack_k: FloatArray
    steepest_rad: FloatArray
    hill_m: FloatArray

    @classmethod
    def drawn(cls, rng: np.random.Generator, count: int = TRIPS, duration_s: int = TRIP_S) -> Trips:
        """Draw trips in town and on motorways, 0 to 38 degC, a third with errors of the preview.

        Half of the packs begin warmer than the air, up to 38 degC.
        """
        shape = count, duration_s + 1
        noise = rng.normal(0.0, 0.1, shape).cumsum(axis=1)
        noise -= noise.mean(axis=1, keepdims=True)
        air_k, warm_k = CELSIUS_ZERO_K + rng.uniform(0.0, 38.0, (2, count))
        is_warm = rng.random(count) < 0.5
        return cls(
            np.array([_speeds(rng, duration_s) for _ in range(count)]),
            noise * (rng.random((count, 1)) < 1.0 / 3.0),
            air_k,
            np.where(is_warm, np.maximum(air_k, warm_k), air_k),
            rng.choice([0.0, 0.02, 0.06], count),
            rng.uniform(300.0, 1500.0, count),
        )


def _speeds(rng: np.random.Generator, duration_s: int) -> FloatArray:
    town, speeds = rng.random() < 0.5, [0.0]
    while len(speeds) <= duration_s:
        stops = rng.random() < (0.35 if town else 0.1)
        wanted = 0.0 if stops else rng.uniform(4.0, 16.0) if town else rng.uniform(14.0, 33.0)
        count = max(round(abs(wanted - speeds[-1]) / rng.uniform(0.4, 1.5)), 1)
        speeds += np.linspace(speeds[-1], wanted, count + 1)[1:].tolist()
        held = int(rng.integers(3, 25 if stops or town else 70))
        swing = (wanted > 0.0) * rng.normal(0.0, 0.2, held).cumsum()
        speeds += np.maximum(wanted + swing, 0.0).tolist()
    return np.array(speeds[: duration_s + 1])


def costs_eur_km(weights: FloatArray, trips: Trips, car: ModelParameters) -> FloatArray:
    """Return what policies cost per km, as the environment does, and for gaps that are too close.

    Args:
        weights: of the policies, shape (p, k).

    Returns:
        Mean of the trips, shape (p,).
    """
    nets = [[each.direct, each.inner, each.outer] for each in map(LearnedPolicy.of, weights)]
    direct, inner, outer = (np.array(each) for each in zip(*nets, strict=True))
    limits, gap, use = car.limits, car.gap, AgingSettings()
    airs: dict[str, Any] = {"ambient_temperature_k": trips.air_k}
    there = replace(car, environment=replace(car.environment, **airs))
    channel, loss = reduce_channel(car.cooling, car.pack), car.aging.initial_capacity_loss
    shape = len(weights), trips.air_k.size
    leader_m = gap.initial_gap_m + np.cumsum(trips.leader_m_s, axis=1) - trips.leader_m_s[:, :1]
    last = trips.leader_m_s.shape[1] - 1
    position, speed, own, power, spent_j, paid = _zeros(shape, 6)
    warm_1, warm_n = (each + trips.pack_k for each in _zeros(shape, 2))
    warmth, c_rates, touched = [], [], np.zeros(shape, dtype=bool)
    for second in range(last):
        leader = trips.leader_m_s[:, second]
        gap_m = leader_m[:, second] - position
        ahead = np.minimum(second + _AHEAD, last)
        error = trips.error_m_s[:, second, np.newaxis] * _AHEAD / _AHEAD[-1]
        preview = np.maximum(trips.leader_m_s[:, ahead] + error, 0.0)
        slope = trips.steepest_rad * np.sin(2.0 * np.pi * position / trips.hill_m)
        charge = np.full(shape, car.charge.initial_charge)
        seen = (speed, own, power, warm_1, warm_n, charge, slope, gap_m, leader + np.zeros(shape))
        observed = np.concatenate(
            (np.stack(seen, axis=-1), np.broadcast_to(preview, (*shape, len(_AHEAD)))), axis=-1
        )
        wanted = actions(direct, inner, outer, features(observed))
        own = np.clip(wanted[..., 0], own - JERK_M_S3, own + JERK_M_S3)
        own = np.clip(own, limits.min_acceleration_m_s2, limits.max_acceleration_m_s2)
        own = np.maximum(own, -speed)
        rate_w = limits.max_compressor_rate_w_s
        power = np.clip(wanted[..., 1], power - rate_w, power + rate_w)
        power = np.minimum(power, limits.max_compressor_power_w)
        middle = speed + 0.5 * own
        cells = CellPair(warm_1, warm_n, loss, loss)
        found: Any = power_thermal_rates(middle, own, slope, power, cells, there, channel)
        spent_j += found.battery_power_w
        warm_1 = warm_1 + found.cell_1_temperature_rate_k_s
        warm_n = warm_n + found.cell_n_temperature_rate_k_s
        warmth.append(np.stack((warm_1, warm_n)))
        c_rates.append(found.cell_current_a / car.cell.nominal_capacity_ah)
        position, speed = position + middle, speed + own
        gap_m = leader_m[:, second + 1] - position
        below_m = minimum_gap_m(speed, trips.leader_m_s[:, second + 1], gap, limits) - gap_m
        off_m = gap_m - gap.standstill_gap_m - HEADWAY_S * speed
        paid += use.headway_eur_m2_h * off_m**2 / SECONDS_PER_HOUR
        paid += CLOSE_EUR_M * np.maximum(below_m, 0.0)
        touched |= gap_m <= 0.0
    warmer_k = 0.5 * (warm_1 + warm_n) - limits.min_temperature_k
    spent_j += np.maximum(warmer_k, 0.0) * car.pack_heat_capacity_j_k / ENDING_COP
    spent_j -= 0.5 * car.body.mass_kg * car.body.rotational_inertia_factor * speed**2
    paid += use.electricity_eur_kwh / J_PER_KWH * spent_j
    paid += CRASH_EUR * touched
    paid += capacity_price_eur(use, car) * _lost(np.array(warmth), np.array(c_rates), trips, car)
    return np.mean(1e3 * np.nan_to_num(paid, nan=CRASH_EUR) / np.maximum(position, 100.0), axis=1)


def _zeros(shape: tuple[int, int], count: int) -> list[FloatArray]:
    return [np.zeros(shape) for _ in range(count)]


def _lost(kelvin: FloatArray, c_rate: FloatArray, trips: Trips, car: ModelParameters) -> FloatArray:
    """Return the capacity lost on the way, shape (p, m).

    Args:
        kelvin: of both cells, shape (n, 2, p, m).
        c_rate: shape (n, p, m).
    """
    use, lost = AgingSettings(), np.zeros(kelvin.shape[2:])
    for number, air_k in enumerate(trips.air_k):
        parked = ParkedAging(use.law() or PRICED_LAW, use, float(air_k))
        cells, rate = kelvin[..., number], c_rate[:, np.newaxis, :, number] + np.zeros((1, 2, 1))
        charge = np.full(cells.size, car.charge.initial_charge)
        loss = parked.loss_1_s(cells.ravel(), rate.ravel(), charge).reshape(cells.shape)
        lost[:, number] = loss.mean(axis=1).sum(axis=0)
    return lost


@dataclass(frozen=True, eq=False)
class Generation:
    """A generation: its number from 1, the mean cost of its policies per km, and the policy it leads to."""

    number: int
    eur_km: float
    policy: LearnedPolicy


def generations(seed: int = 1, first: LearnedPolicy | None = None) -> Iterator[Generation]:
    """Yield generations without end, from the linear law by default; the same seed gives the same ones."""
    rng = np.random.default_rng(seed)
    car = load_parameters().values
    weights = (first or LearnedPolicy.first(seed)).weights
    mean, square, number = np.zeros_like(weights), np.zeros_like(weights), 0
    while True:
        number += 1
        changes = rng.normal(0.0, CHANGE, (PAIRS, weights.size))
        tried = np.concatenate((weights + changes, weights - changes))
        costs = costs_eur_km(tried, Trips.drawn(rng), car)
        ranks = costs.argsort().argsort() / (costs.size - 1.0) - 0.5
        slope = (ranks[:PAIRS] - ranks[PAIRS:]) @ changes / (PAIRS * CHANGE)
        mean = FORGETTING * mean + (1.0 - FORGETTING) * slope
        square = STEADYING * square + (1.0 - STEADYING) * slope**2
        ahead = mean / (1.0 - FORGETTING**number)
        weights = weights - STEP * ahead / np.sqrt(square / (1.0 - STEADYING**number) + 1e-12)
        yield Generation(number, float(np.mean(costs)), LearnedPolicy.of(weights))
