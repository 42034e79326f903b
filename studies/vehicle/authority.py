"""With the braking of a production car's channel, in memory: measured leaders, and leaders that brake."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from studies.acc.scenes import LONGEST_S, SCENES, SHORTEST_S, measured_scenes
from studies.safety.braking import braking_trials
from studies.session import Case, Session

import iptm
from iptm_vehicle_interface.driving import controller_limits
from iptm_vehicle_interface.vehicle import load_vehicle

AUTHORITIES = (
    ("none", 3.5, 1.5),
    ("none", 8.0, 1.5),
    ("full", 3.5, 1.5),
    ("full", 3.5, 2.0),
    ("full", 3.5, 2.5),
    ("full", 3.5, 3.0),
    ("full", 3.5, 3.5),
    ("full", 3.5, 4.0),
    ("full", 8.0, 1.5),
)
"""Preview, braking of channel or brakes in m/s^2, and headway of s_min in s."""
RELIED_ON_M_S2 = 7.0
"""Of stronger brakes the safety monitor relies on this."""
STRATEGY, BRAKING_CYCLE = "aging_cost_to_go", "us06"
BRAKING_TRIALS, BRAKING_SEED = 200, 39
SHORT_S = 60.0


def energy_j(run: iptm.Run) -> float:
    """Return the energy from the battery of a trip in memory."""
    trajectory = run.trajectory
    return float(np.sum(trajectory.battery_power_w[1:] * trajectory.intervals_s))


def leaders_table(session: Session) -> pd.DataFrame:
    """Drive behind measured leaders, and behind ones that brake, with the authority of the channel."""
    extent = (1, SHORTEST_S) if session.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(*extent)
    trips = {
        scene.name: {
            "cycle": scene.write(session.scratch / "leads"),
            "duration_s": float(scene.duration_s),
        }
        for scene in scenes
    }
    trips[BRAKING_CYCLE] = {"cycle": BRAKING_CYCLE}
    kinds = [AUTHORITIES[0]] if session.short else AUTHORITIES
    cases = [
        Case(
            f"{name}/{number}",
            {"leader": name, "number": number},
            {**_with_authority(*kind), **trip},
        )
        for number, kind in enumerate(kinds)
        for name, trip in trips.items()
    ]
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    calls = {case.name: case.call for case in cases}
    rows = []
    for number, group in driven.groupby("number"):
        is_cycle = group.leader == BRAKING_CYCLE
        measured, cycle = group[~is_cycle], group[is_cycle].iloc[0]
        trials = braking_trials(
            calls[cycle.case],
            cycle.run.trajectory,
            3 if session.short else BRAKING_TRIALS,
            BRAKING_SEED,
        )
        hit = trials.impact_m_s > 0.0
        preview, authority_m_s2, headway_s = kinds[number]
        rows.append(
            {
                "preview": preview,
                "authority": authority_m_s2,
                "headway_s": headway_s,
                "leaders": len(measured),
                "collisions": sum(run.frame.gap_m.min() <= 0.0 for run in measured.run),
                "gap_m": min(run.frame.gap_m.min() for run in measured.run),
                "interventions": sum(metrics.interventions for metrics in measured.metrics),
                "cycle_interventions": cycle.metrics.interventions,
                "braked": int(trials.braked.sum()),
                "hit": int(hit.sum()),
                "avoidable": int((hit & (trials.bound_impact_m_s <= 0.0)).sum()),
                "mean_gap_m": cycle.run.frame.gap_m.mean(),
                "energy_kwh_100km": energy_j(cycle.run)
                / float(cycle.run.trajectory.position_m[-1])
                / 36.0,
            }
        )
    return pd.DataFrame(rows)


def _with_authority(preview: str, authority_m_s2: float, headway_s: float) -> dict[str, Any]:
    """Return the settings of trips whose brakes have an authority, which planner and monitor rely on."""
    limits = controller_limits(load_vehicle("bench"))
    return {
        "preview_mode": preview,
        "strategy": STRATEGY,
        "monitor_own_deceleration_m_s2": min(authority_m_s2, RELIED_ON_M_S2),
        "overrides": {
            **limits,
            "brakes.max_deceleration_m_s2": authority_m_s2,
            "gap.time_headway_s": headway_s,
        },
    }
