"""Lead vehicles that brake at any instant of an undisturbed drive, detected by the safety monitor only.

The ego vehicle receives the commands of the undisturbed drive; every deviation is the action of the plant's
safety monitor. Each outcome is compared with the best stop of the stated brakes (`emergency_stop`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from iptm.parts import Command, LeaderPreview, Plant, StateError, Trajectory, VehicleState
from iptm.parts import braking_leads, emergency_stops
from iptm.studies.store import ResultStore, content_key
from iptm.studies.study import Case
from iptm.studies.workers import Failed, OnProgress, perform_all

GENTLEST_M_S2, HARDEST_M_S2 = 2.0, 9.0
TICK_S = 0.1
"""Of the trials; the commands of the undisturbed drive change at its own ticks."""
MOST_S = 60.0
EARLIEST_S = 5.0


def braking_trials(inputs: Case, drive: Trajectory, trials: int, seed: int) -> pd.DataFrame:
    """Drive trials from random instants of an undisturbed drive, with random decelerations.

    Returns:
        A row per trial: ``time_s`` at which the lead vehicle begins to brake, with ``deceleration_m_s2``;
        ``smallest_gap_m`` up to standstill; ``impact_m_s``, the speed difference when the gap closed, 0 where
        it did not; ``braked``, 1 where the monitor braked; ``bound_m``, the smallest gap of stated brakes
        with the reaction of the sensor alone; ``bound_impact_m_s``, the speed difference when that
        gap closes.
    """
    random = np.random.default_rng([seed, trials])
    rows = random.integers(round(EARLIEST_S / inputs.spec.tick_s), len(drive) - 1, trials)
    decelerations = random.uniform(GENTLEST_M_S2, HARDEST_M_S2, trials)
    plant = Plant(inputs.parameters, inputs.route.slope.slope_at, TICK_S, inputs.spec.thermal_model)
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


def _braking_task(
    task: tuple[str, Case, Trajectory, int, int], on_progress: OnProgress
) -> pd.DataFrame:
    del on_progress
    return braking_trials(*task[1:])


def braking_outcomes(
    store: ResultStore,
    drives: Mapping[str, tuple[Case, Trajectory]],
    trials: int,
    seed: int,
    workers: int,
    on_progress: Callable[[str], None],
) -> pd.DataFrame:
    """Return the trials of some drives; what is stored is not driven again.

    Args:
        store: of the outcomes.
        drives: undisturbed drives by name.
        trials: number of trials in all, shared alike.
        seed: of all draws.
        workers: number of processes; 0 to drive none, so that only what is stored is returned.
        on_progress: called with the name of each drive whose trials are done.

    Returns:
        The rows of `braking_trials` with the ``drive``, and ``avoidable``: a collision that the stated brakes
        would have avoided.

    Raises:
        StateError: the trials of a drive failed.
    """
    share = max(1, round(trials / len(drives))) if drives else 0
    keys = {name: content_key(inputs.key, share, seed) for name, (inputs, _) in drives.items()}
    stored = {name: store.find_content(key) for name, key in keys.items()}
    found = {name: pd.DataFrame(one[1]) for name, one in stored.items() if one}
    tasks = [(name, *drive, share, seed) for name, drive in drives.items() if name not in found]
    for (name, *_), outcome in perform_all(_braking_task, tasks if workers else [], workers):
        if isinstance(outcome, Failed):
            raise StateError(f"braking lead vehicle, {name}: {outcome.cause}")
        columns = {column: outcome[column].to_numpy() for column in outcome}
        store.save_content(keys[name], {}, columns)
        found[name] = outcome
        on_progress(name)
    rows = [found[name].assign(drive=name) for name in drives if name in found]
    if not rows:
        return pd.DataFrame(columns=["drive", "smallest_gap_m", "avoidable"])
    table = pd.concat(rows, ignore_index=True)
    return table.assign(avoidable=(table.smallest_gap_m <= 0.0) & (table.bound_m > 0.0))
