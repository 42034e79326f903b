"""Lead vehicles that brake at any instant of an undisturbed drive, detected by the safety monitor only.

The ego vehicle receives the commands of the undisturbed drive; every deviation is the action of the plant's
safety monitor. Each outcome is compared with the best stop of the stated brakes (`emergency_stop`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from studies.bounds import braking_leads, emergency_stops
from studies.session import Session, inputs_of

from iptm_core.state import Command, LeaderPreview, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant

GENTLEST_M_S2, HARDEST_M_S2 = 2.0, 9.0
TICK_S = 0.1
"""Of the trials; the commands of the undisturbed drive change at its own ticks."""
MOST_S = 60.0
EARLIEST_S = 5.0


def braking_trials(
    call: Mapping[str, Any], drive: Trajectory, trials: int, seed: int
) -> pd.DataFrame:
    """Drive trials from random instants of an undisturbed drive, with random decelerations.

    Args:
        call: arguments of `iptm.simulate` that the drive was made from.
        drive: what was driven.
        trials: number of trials.
        seed: of all draws.

    Returns:
        A row per trial: ``time_s`` at which the lead vehicle begins to brake, with ``deceleration_m_s2``;
        ``smallest_gap_m`` up to standstill; ``impact_m_s``, the speed difference when the gap closed, 0 where
        it did not; ``braked``, 1 where the monitor braked; ``bound_m``, the smallest gap of stated brakes
        with the reaction of the sensor alone; ``bound_impact_m_s``, the speed difference when that
        gap closes.
    """
    inputs = inputs_of(call)
    random = np.random.default_rng([seed, trials])
    rows = random.integers(round(EARLIEST_S / inputs.conditions.period_s), len(drive) - 1, trials)
    decelerations = random.uniform(GENTLEST_M_S2, HARDEST_M_S2, trials)
    plant = Plant(
        inputs.parameters,
        inputs.route.slope.slope_at,
        TICK_S,
        inputs.vehicle.thermal_model,
        inputs.vehicle,
    )
    outcomes = np.array(
        [
            _drive_one(plant, drive, int(row), float(deceleration))
            for row, deceleration in zip(rows, decelerations, strict=True)
        ],
        dtype=float,
    )
    leads = braking_leads(
        drive.leader_position_m[rows], drive.leader_speed_m_s[rows], decelerations
    )
    bound_m, bound_impact_m_s = emergency_stops(
        leads,
        drive.position_m[rows],
        drive.speed_m_s[rows],
        drive.acceleration_m_s2[rows + 1],
        inputs.parameters.brakes,
        plant.monitor.settings.monitor_period_s,
    )
    gap_m, impact_m_s, braked = outcomes.T
    return pd.DataFrame(
        {
            "time_s": drive.time_s[rows],
            "deceleration_m_s2": decelerations,
            "smallest_gap_m": gap_m,
            "impact_m_s": impact_m_s,
            "braked": braked,
            "bound_m": bound_m,
            "bound_impact_m_s": bound_impact_m_s,
        }
    )


def _drive_one(
    plant: Plant, drive: Trajectory, row: int, deceleration_m_s2: float
) -> tuple[float, float, bool]:
    """Return smallest gap, speed of impact and whether the monitor braked."""
    start_s, lead_m = float(drive.time_s[row]), float(drive.leader_position_m[row])
    lead_m_s = float(drive.leader_speed_m_s[row])
    halt_s = lead_m_s / deceleration_m_s2

    def lead(time_s: float) -> tuple[float, float]:
        elapsed_s = min(time_s - start_s, halt_s)
        speed_m_s = lead_m_s - deceleration_m_s2 * elapsed_s
        return lead_m + 0.5 * (lead_m_s + speed_m_s) * elapsed_s, max(speed_m_s, 0.0)

    def sensor(state: VehicleState) -> LeaderPreview:
        position_m, speed_m_s = lead(state.time_s)
        now = (np.array([value]) for value in (state.time_s, position_m, speed_m_s))
        return LeaderPreview(*now)

    plant.watch(sensor)
    state = state_at(drive, row)
    smallest_m, impact_m_s, braked = float(drive.gap_m[row]), 0.0, False
    for tick in range(1, round(MOST_S / TICK_S)):
        driving = min(int(np.searchsorted(drive.time_s, state.time_s + 1e-6)), len(drive) - 1)
        command = Command(
            float(drive.acceleration_m_s2[driving]), float(drive.compressor_power_w[driving])
        )
        step = plant.advance(state, command, TICK_S)
        state = VehicleState(**{**vars(step.state), "time_s": start_s + tick * TICK_S})
        position_m, speed_m_s = lead(state.time_s)
        gap_m = position_m - state.position_m
        braked |= step.safety.service_braking_s > 0.0
        if gap_m <= 0.0:
            return gap_m, max(state.speed_m_s - speed_m_s, 0.0), braked
        smallest_m = min(smallest_m, gap_m)
        if state.time_s - start_s >= halt_s and (
            step.standstill or state.time_s >= drive.time_s[-1]
        ):
            break
    return smallest_m, impact_m_s, braked


def state_at(drive: Trajectory, row: int) -> VehicleState:
    """Return the ego vehicle in a row of a drive."""
    names = VehicleState.__dataclass_fields__
    values = {name: float(getattr(drive, name)[row]) for name in names}
    return VehicleState(**values)


def braking_outcomes(
    session: Session,
    drives: Mapping[str, tuple[Mapping[str, Any], Trajectory]],
    trials: int,
    seed: int,
) -> pd.DataFrame:
    """Return the trials of some drives.

    Args:
        session: computes them.
        drives: undisturbed drives by name, with the arguments that they were made from.
        trials: number of trials in all, shared alike.
        seed: of all draws.

    Returns:
        The rows of `braking_trials` with the ``drive``, and ``avoidable``: a collision that the stated brakes
        would have avoided.
    """
    share = max(1, round(trials / len(drives))) if drives else 0
    calls = [
        {"call": call, "drive": drive, "trials": share, "seed": seed}
        for call, drive in drives.values()
    ]
    names = [f"braking lead vehicle: {name}" for name in drives]
    found = zip(drives, session.compute(braking_trials, calls, names), strict=True)
    rows = [outcome.assign(drive=name) for name, outcome in found if outcome is not None]
    if not rows:
        return pd.DataFrame(columns=["drive", "smallest_gap_m", "avoidable"])
    table = pd.concat(rows, ignore_index=True)
    return table.assign(avoidable=(table.smallest_gap_m <= 0.0) & (table.bound_m > 0.0))
