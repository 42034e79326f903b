"""The judge: what a trip cost and how it was driven, from its rows alone.

Plain NumPy; nothing of the suite but numbers: parameters of the car, prices, coefficients of published laws.

    EUR/100 km = [p_E (E_b - E_kin + E_cool) + p_Q (Q_trip + Q_cool) + C] 100 km / distance

E_b is the integral of the battery power, E_kin the motion at the end, Q the mean of both cells. E_cool and
Q_cool cool the pack down to its lower limit at standstill, with the compressor power that takes the least
energy: heat that is left in the pack is not saved. A pack that ends colder gains nothing, so that no ending
buys a score. Where a fast charge follows, C is what its minutes cost at the temperature on arrival, instead
of the cooling. A mechanism with the damage u and the loss u^p counts with its slope p u^(p-1) after years of
service. Of the laws, the median counts. The road taken is the mean gap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from studies.paper.equations import Array, loss_rate_1_s, rates

DAY_S, HOUR_S, YEAR_DAYS, J_PER_KWH = 86400.0, 3600.0, 365.25, 3.6e6
LIFE_LOSS = 0.2
"""Loss of capacity over which the price of a pack is spread."""
HARD_BRAKING_M_S2 = 2.05
CAR_LENGTH_M = 4.5
POWER_STEP_W = 50.0
CLOSE_M = 0.5
"""Distance below the smallest gap that is allowed, from which on a second counts."""
MOST_BELOW, MOST_INTERVENTIONS = 0.2, 2
"""Share of the time below the smallest gap, and times that the vehicle braked by itself, of a ranked trip."""
ROWS = (
    "time_s",
    "position_m",
    "speed_m_s",
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "battery_power_w",
    "state_of_charge",
    "leader_position_m",
    "leader_speed_m_s",
    "service_braking_s",
    "smallest_gap_m",
)
"""Columns of a bag or a run that are judged."""

Rate = Callable[[Any, Any, Any], Array]
"""Rate of damage in 1/s at a temperature in K, a C-rate in 1/h and a state of charge."""


@dataclass(frozen=True)
class Found:
    """What the judge found in a trip.

    Attributes:
        eur: cost of energy and capacity in EUR per 100 km, the latter by the median of the laws.
        energy_kwh: energy at the battery in kWh per 100 km, the motion at the end given back.
        ending_kwh: of cooling the pack down after the trip, in kWh per 100 km; not in ``energy_kwh``.
        aging_eur: cost of capacity by each law in EUR per 100 km.
        arrival_eur: cost of the temperature on arrival in EUR per 100 km.
        gap_m: mean gap.
        vehicles_h: vehicles per hour and lane at the mean speed and gap.
        below_s: seconds more than `CLOSE_M` below the smallest gap that is allowed.
        smallest_gap_m: inside of intervals, too; 0 or less is a collision.
        interventions: how often the vehicle braked by itself.
        braking_s: seconds of hard braking.
        jerk_m_s3: root mean square.
    """

    eur: float
    energy_kwh: float
    ending_kwh: float
    gap_m: float
    vehicles_h: float
    below_s: float
    below_share: float
    smallest_gap_m: float
    interventions: int
    braking_s: float
    jerk_m_s3: float
    end_c: float
    aging_eur: Mapping[str, float] = field(default_factory=dict)
    arrival_eur: float = 0.0

    @property
    def is_too_close(self) -> bool:
        """Whether the trip is ranked without a score for its gaps."""
        return self.below_share > MOST_BELOW or self.interventions > MOST_INTERVENTIONS


def judged(
    rows: Mapping[str, Array],
    p: Any,
    use: Any,
    laws: Mapping[str, Any],
    arrival: tuple[Array, Array] | None = None,
) -> Found:
    """Judge a trip.

    Args:
        rows: `ROWS` by name, an entry per second; powers are means of the interval that ended.
        p: parameters of the car.
        use: prices, and the use of the car between trips.
        laws: coefficients by the name of the cell, see `mechanisms`.
        arrival: temperatures in degC and what they cost on arrival in EUR, linear between; None where no
            fast charge follows.
    """
    step_s = np.diff(rows["time_s"])
    speed, leader = rows["speed_m_s"], rows["leader_speed_m_s"]
    gap_m = rows["leader_position_m"] - rows["position_m"]
    hundreds = (rows["position_m"][-1] - rows["position_m"][0]) / 1e5
    mass_kg = p.body.mass_kg * p.body.rotational_inertia_factor
    spent_j = float(rows["battery_power_w"][1:] @ step_s) - 0.5 * mass_kg * speed[-1] ** 2
    ends_k = 0.5 * (rows["cell_1_temperature_k"][-1] + rows["cell_n_temperature_k"][-1])
    ending, arrival_eur = cooled_down(ends_k, p), 0.0
    if arrival is not None:
        ending = Ending(0.0, 0.0, 0.0, ends_k)
        arrival_eur = float(np.interp(ends_k - 273.15, *arrival)) / hundreds
    energy_kwh, ending_kwh = (each / J_PER_KWH / hundreds for each in (spent_j, ending.energy_j))
    pack_kwh = p.pack.open_circuit_voltage_v * p.cell.nominal_capacity_ah * p.pack.parallel / 1e3
    capacity_eur = use.battery_eur_kwh * pack_kwh / LIFE_LOSS / hundreds
    aging_eur = {
        name: capacity_eur * lost(rows, parts, p, use, ending)
        for name, parts in mechanisms(laws, p, use).items()
    }
    braking = 2.0 * math.sqrt(-p.limits.min_acceleration_m_s2 * p.limits.max_acceleration_m_s2)
    least_m = p.gap.standstill_gap_m + speed * (p.gap.time_headway_s + (speed - leader) / braking)
    below = (gap_m < least_m - CLOSE_M)[1:]
    acceleration = np.diff(speed) / step_s
    braked = rows["service_braking_s"] > 0.0
    energy_eur = use.electricity_eur_kwh * (energy_kwh + ending_kwh)
    return Found(
        eur=float(energy_eur + arrival_eur + np.median(list(aging_eur.values()))),
        energy_kwh=float(energy_kwh),
        ending_kwh=float(ending_kwh),
        aging_eur=aging_eur,
        arrival_eur=arrival_eur,
        gap_m=float(np.mean(gap_m)),
        vehicles_h=float(3600.0 * np.mean(speed) / (np.mean(gap_m) + CAR_LENGTH_M)),
        below_s=float(step_s[below].sum()),
        below_share=float(step_s[below].sum() / step_s.sum()),
        smallest_gap_m=float(min(np.min(gap_m), np.nanmin(rows["smallest_gap_m"]))),
        interventions=int(np.sum(braked[1:] & ~braked[:-1])),
        braking_s=float(step_s[acceleration < -HARD_BRAKING_M_S2].sum()),
        jerk_m_s3=float(np.sqrt(np.mean(np.diff(acceleration) ** 2))),
        end_c=float(ends_k - 273.15),
    )


def mechanisms(laws: Mapping[str, Any], p: Any, use: Any) -> dict[str, list[tuple[Rate, float]]]:
    """Return rate of damage and exponent of each mechanism, by law.

    Args:
        laws: of each cell a calendar and a cyclic part, ``k = factor exp((slope SOC - activation) / T)`` over
            days and ``k = (constant + rate C + depth DOD) sum exp(a / T)`` over full cycles, as fitted by
            NREL; C-rate and depth are those of a day.
    """
    mean_1_h, depth = 2.0 * use.daily_discharge / 24.0, min(use.daily_discharge, 1.0)

    def of_cell(law: Any) -> list[tuple[Rate, float]]:
        calendar, cyclic = law.mechanisms
        constant, by_rate, by_depth = cyclic.intensity.args
        intensity = constant + by_rate * mean_1_h + by_depth * depth

        def stored(kelvin: Any, _: Any, charge: Any) -> Array:
            k = calendar.factor * np.exp(
                (calendar.slope_k * charge - calendar.activation_k) / kelvin
            )
            return np.asarray(k ** (1.0 / calendar.exponent) / DAY_S)

        def cycled(kelvin: Any, c_rate: Any, _: Any) -> Array:
            k = intensity * sum(np.exp(a / kelvin) for a in cyclic.exponents_k)
            return np.asarray(k ** (1.0 / cyclic.exponent) * np.abs(c_rate) / (2.0 * HOUR_S))

        return [(stored, calendar.exponent), (cycled, cyclic.exponent)]

    def of_paper(kelvin: Any, c_rate: Any, _: Any) -> Array:
        current_a = c_rate * p.cell.nominal_capacity_ah
        return np.asarray(loss_rate_1_s(current_a, kelvin, 1.0, p) / p.aging.throughput_exponent)

    cells = {name: of_cell(law) for name, law in laws.items()}
    return {**cells, "paper": [(of_paper, p.aging.throughput_exponent)]}


@dataclass(frozen=True)
class Ending:
    """Cooling of a parked pack: energy, time, C-rate of the cells in 1/h, and mean temperature meanwhile."""

    energy_j: float
    time_s: float
    c_rate_1_h: float
    middle_k: float


def cooled_down(ends_k: float, p: Any) -> Ending:
    """Return how a pack is cooled to its lower limit with the least energy; infinite where it cannot be."""
    warmer_k = max(ends_k - p.limits.min_temperature_k, 0.0)
    middle_k = ends_k - 0.5 * warmer_k
    pack_j_k = p.pack.cells * p.cell.heat_capacity_j_k
    pack_w = p.pack.open_circuit_voltage_v * p.cell.nominal_capacity_ah * p.pack.parallel
    loss = p.aging.initial_capacity_loss
    at_rest = np.array([0.0, 0.0, middle_k, middle_k, loss, loss])
    found = [Ending(math.inf if warmer_k else 0.0, 0.0, 0.0, middle_k)]
    for power_w in np.arange(POWER_STEP_W, p.limits.max_compressor_power_w + 1.0, POWER_STEP_W):
        _, powers = rates(at_rest, 0.0, power_w, 0.0, p, hold=True)
        net_w = powers["chiller_heat_w"] - powers["battery_heat_w"]
        if net_w > 0.0:
            taken_w, time_s = powers["battery_power_w"], pack_j_k * warmer_k / net_w
            found.append(Ending(taken_w * time_s, time_s, taken_w / pack_w, middle_k))
    return min(found, key=lambda each: each.energy_j)


def lost(
    rows: Mapping[str, Array],
    parts: list[tuple[Rate, float]],
    p: Any,
    use: Any,
    ending: Ending,
) -> float:
    """Return the capacity lost by a trip and the cooling after it, as a share."""
    step_s, charge = np.diff(rows["time_s"]), rows["state_of_charge"]
    c_rate = -np.diff(charge) / step_s * HOUR_S
    cells_k = [rows[f"cell_{cell}_temperature_k"] for cell in ("1", "n")]
    damping = math.hypot(1.0, 2.0 * math.pi * use.parked_time_constant_h * HOUR_S / DAY_S)
    swing_k = use.parking_air_swing_k / damping * np.cos(2.0 * np.pi * np.arange(24) / 24.0)
    settled_k = p.environment.ambient_temperature_k + use.pack_above_air_k
    parked_charge = use.charging_target - 0.25 * use.daily_discharge
    mean_1_h = 2.0 * use.daily_discharge / 24.0
    total = 0.0
    for rate, exponent in parts:
        resting = float(np.mean(rate(settled_k + swing_k, mean_1_h, parked_charge)))
        service = use.service_years * YEAR_DAYS * DAY_S * resting
        slope = exponent * service ** (exponent - 1.0) if service else 0.0
        cells = [float(rate(kelvin[1:], c_rate, charge[1:]) @ step_s) for kelvin in cells_k]
        after = ending.time_s * float(rate(ending.middle_k, ending.c_rate_1_h, charge[-1]))
        total += slope * (sum(cells) / len(cells) + after)
    return total


def score(found: Found, reference: list[Found]) -> tuple[float, str]:
    """Return by how many percent a trip costs less than the reference at equal road space, and why none.

    Args:
        reference: the same law at several headways, between which its cost is interpolated over the gap;
            those that are too close themselves do not count. A shorter gap than the shortest counts as that;
            a longer one than the longest is not compared.

    Returns:
        Percent and an empty text, or NaN and the reason.
    """
    sound = [each for each in reference if not each.is_too_close]
    by_gap = sorted(sound or reference, key=lambda each: each.gap_m)
    gaps_m = [each.gap_m for each in by_gap]
    if found.smallest_gap_m <= 0.0:
        return math.nan, "collision"
    if found.gap_m > gaps_m[-1]:
        return math.nan, "more road"
    if found.is_too_close:
        return math.nan, "too close"
    cost = float(np.interp(found.gap_m, gaps_m, [each.eur for each in by_gap]))
    return 100.0 * (1.0 - found.eur / cost), ""
