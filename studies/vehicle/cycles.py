"""Whole cycles: in real time on the bench, the bench in steps, and trips in memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from studies.session import Case, Session
from studies.vehicle.authority import energy_j
from studies.vehicle.bench import FRAMES, drive, kept, settled_jerk_m_s3
from studies.vehicle.in_steps import BenchInSteps

from iptm_core.parameters import load_parameters
from iptm_vehicle_interface.driving import controller_limits
from iptm_vehicle_interface.node_bench import V2X_HEADWAY_S
from iptm_vehicle_interface.vehicle import load_vehicle

STRATEGIES = ("aging_cost_to_go", "reference")
PRESSED = ("enable_button", 4.0, 0.3, 10.0)


@dataclass(frozen=True)
class Drive:
    """A drive in real time.

    Attributes:
        v2x: the lead vehicle sends its position and path, which the bridge joins with the radar.
        number: of the drive, where there are several that only time tells apart.
    """

    cycle: str
    duration_s: float
    v2x: bool
    number: int
    strategy: str

    def folder(self, session: Session) -> Path:
        """Return the folder of its logs."""
        parts = ["v2x"] * self.v2x + [f"{self.number}"] * (self.number > 1)
        return session.scratch / "drives" / "_".join([self.cycle, self.strategy, *parts])


DRIVES = [
    Drive(*kind, strategy)
    for kind in (
        ("us06", 600.0, False, 1),
        ("us06", 600.0, False, 2),
        ("us06", 600.0, True, 1),
        ("wltc_class3b", 1800.0, False, 1),
    )
    for strategy in STRATEGIES
]


def drives_table(session: Session) -> pd.DataFrame:
    """Compare drives in real time with the same ones in steps, and with trips in memory."""
    limits = controller_limits(load_vehicle("bench"))
    v2x_limits = {**limits, "gap.time_headway_s": V2X_HEADWAY_S}
    cases = [
        Case(
            each.folder(session).name,
            {"drive": each},
            {
                "cycle": each.cycle,
                "strategy": each.strategy,
                "preview_mode": "full" if each.v2x else "none",
                "overrides": v2x_limits if each.v2x else limits,
                "duration_s": each.duration_s,
                **_gateway_as_monitor(),
            },
        )
        for each in DRIVES
    ]
    rows = []
    for _, trip in session.drive(cases).iterrows():
        each, folder = trip.drive, trip.drive.folder(session)
        found = kept(
            folder / "result.json",
            partial(drive, folder, each.cycle, each.strategy, each.duration_s, v2x=each.v2x),
        )
        car, suite = found["car"], found["suite"]
        in_steps: Mapping[str, Any] = {}
        if not each.v2x:
            in_steps = kept(folder / "in_steps.json", partial(_in_steps, each))
        rows.append(
            {
                "cycle": each.cycle,
                "preview": "V2X" if each.v2x else "none",
                "number": each.number,
                "strategy": each.strategy,
                **_needed("", car),
                **_needed("step_", in_steps),
                "memory_energy_kwh": energy_j(trip.run) / 3.6e6,
                "memory_distance_km": float(trip.run.trajectory.position_m[-1]) / 1000.0,
                "interventions": trip.metrics.interventions,
                "engaged": 100.0 * car["active_s"] / each.duration_s,
                "hand_overs": sum(mode == "engaged" for _, mode, _ in suite["changes"]) - 1,
                "oldest_ms": 1e3 * car["oldest_command_s"],
                "engagements": car["engagements"],
                "jerk": car["largest_jerk_m_s3"],
                "settled_jerk": kept(
                    folder / "settled_jerk.json",
                    partial(settled_jerk_m_s3, folder / FRAMES),
                ),
                "gap_m": car["smallest_gap_m"],
                "late_p99_ms": 1e3 * suite["late_p99_s"],
                "late_max_ms": 1e3 * suite["late_max_s"],
                "fallbacks": suite["fallbacks"],
            }
        )
    return _with_savings(pd.DataFrame(rows))


def _in_steps(each: Drive) -> dict[str, Any]:
    return BenchInSteps(each.cycle, each.strategy, PRESSED).drive(each.duration_s)


def _needed(prefix: str, log: Mapping[str, Any]) -> dict[str, float]:
    """Return energy, capacity loss and distance by the log of a car; NaN without one."""
    units = {
        "energy_kwh": ("battery_energy_j", 1.0 / 3.6e6),
        "loss_ppm": ("capacity_loss", 1e6),
        "distance_km": ("distance_m", 1e-3),
    }
    return {f"{prefix}{name}": unit * log.get(key, math.nan) for name, (key, unit) in units.items()}


def _gateway_as_monitor() -> dict[str, float]:
    """Return settings with which the simulated plant's monitor asks for the gateway's distance.

    Its brakes have a delay and build up faster than the gateway lets them; the reaction time makes up for it.
    """
    vehicle = load_vehicle("bench")
    limits, brakes = vehicle.limits, load_parameters(vehicle.parameter_set).values.brakes
    braking = -limits.min_acceleration_m_s2
    build_up_s = 0.5 * braking * (1.0 / limits.max_jerk_m_s3 - 1.0 / brakes.build_up_m_s3)
    return {
        "monitor_own_deceleration_m_s2": braking,
        "monitor_lead_deceleration_m_s2": limits.lead_deceleration_m_s2,
        "monitor_reaction_s": limits.reaction_s + build_up_s - brakes.delay_s,
        "monitor_margin_m": limits.margin_m,
        "monitor_slippery_deceleration_m_s2": 0.0,
        "monitor_release_reaction_s": 0.0,
        "monitor_hold_s": 0.0,
    }


def _with_savings(table: pd.DataFrame) -> pd.DataFrame:
    """Add what the first strategy saves against the second, per distance, in real time and in lock-step."""
    for prefix in ("", "step_", "memory_"):
        for name in ("energy_kwh", "loss_ppm"):
            if f"{prefix}{name}" not in table:
                continue
            per_km = table[f"{prefix}{name}"] / table[f"{prefix}distance_km"]
            of_base = per_km.where(table.strategy == STRATEGIES[1])
            base = of_base.groupby([table.cycle, table.preview, table.number]).transform("max")
            saving = 100.0 * (1.0 - per_km / base)
            table[f"{prefix}{name.partition('_')[0]}_saving"] = saving
    return table
