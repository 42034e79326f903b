"""Drives without a lead vehicle, compared with a driver with cruise control and with a strong baseline.

Energy and ageing count up to the end of the road, which all reach. Strategies are compared at
equal distances, not at equal times: the time of arrival is given as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from studies.glosa import drive_advised
from studies.savings import BASELINE, BASES, PRODUCTION
from studies.session import Session, inputs_of

import iptm
from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.decision_record import Rung
from iptm_core.markdown import table_of
from iptm_core.metrics.saved_share import saved_percent
from iptm_core.settings import LeaderSource
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_core.units import KM_H_PER_M_S
from iptm_v2x_bridge.rules_of_the_road import OF_THE_CYCLE, given_rules

ADVISED = ", advised"
"""Behind the names of strategies that drive with the speed advice of `studies.glosa`."""
STRATEGIES = (
    PRODUCTION,
    PRODUCTION + ADVISED,
    BASELINE,
    DEFAULT_STRATEGY,
    DEFAULT_STRATEGY + ADVISED,
    "reference",
    "reference_aging",
)
LINES = ", ".join(f"{1000 * k}:80:{(31 * k) % 80}:35" for k in range(1, 12))
"""A stop line on every kilometre, green for 35 s of 80 s, with offsets that make no progression."""
ROADS = {
    "WLTC at its limits": ("wltc_class3b", ""),
    "UDDS with stop lines": ("udds", LINES),
}
CHECKS_PER_TICK = 20
SHORT_S = 120.0
HALT_M_S = 0.1
ARRIVED_M = 10.0
"""The ego vehicle has arrived when it is this near to where it halts."""

COLUMNS = {
    "road": "{road}",
    "strategy": "`{strategy}`",
    "way:": "{distance_km:.2f} km",
    "arrival:": "{arrival_s:.0f} s",
    "stood on the way:": "{stood_s:.0f} s",
    "battery energy:": "{battery_energy_kj:.0f} kJ",
    "degradation:": "{degradation_1e7:.3f}·10⁻⁷",
    "ageing saved:": "{production_ageing:.1f} %",
    "energy saved:": "{production_energy:.1f} %",
    "against `eco_acc`:": "{eco_acc_ageing:.1f} / {eco_acc_energy:.1f} %",
    "above the limit:": "{excess_km_h:.2f} km/h",
    "lines passed:": "{lines}",
    "while closed:": "{lines_closed}",
    "hardest braking:": "{braking_m_s2:.2f} m/s²",
    "fallback:": "{fallback_ticks} ticks",
}


def drive(road: str, strategy: str, duration_s: float | None = None) -> dict[str, Any]:
    """Drive one of `ROADS` and return the row of the table."""
    cycle, signals = ROADS[road]
    call: dict[str, Any] = {
        "cycle": cycle,
        "strategy": strategy.removesuffix(ADVISED),
        "horizon": str(MULTI_HORIZON),
        "leader_source": LeaderSource.NONE,
        "speed_limits_km_h": OF_THE_CYCLE,
        "signals": signals,
        "duration_s": duration_s,
    }
    run = drive_advised(call) if strategy.endswith(ADVISED) else iptm.simulate(**call)
    inputs = inputs_of(call)
    trip, rules = run.trajectory, given_rules(inputs.rules, inputs.route)
    if rules.limits is None:
        raise AssertionError("a road of this study has limits")
    times, places, speeds = _between_ticks(trip)
    excess = speeds - rules.limits.at_m_s(places)
    passed = [line for line in rules.signals if line.stop_line_m < places[-1]]
    at_s = [
        float(times[np.searchsorted(places, line.stop_line_m, side="right")]) for line in passed
    ]
    arrived = int(np.argmax(trip.position_m >= trip.position_m[-1] - ARRIVED_M))
    losses = trip.cell_1_capacity_loss + trip.cell_n_capacity_loss
    return {
        "road": road,
        "strategy": strategy,
        "leaders": int(trip.has_leader.sum()),
        "distance_km": trip.position_m[-1] / 1000.0,
        "arrival_s": float(trip.time_s[arrived]),
        "stood_s": int(np.count_nonzero(trip.speed_m_s[1:arrived] < HALT_M_S)),
        "battery_energy_kj": float(
            np.sum(trip.battery_power_w[1 : arrived + 1] * trip.intervals_s[:arrived]) / 1000.0
        ),
        "degradation_1e7": float(losses[arrived] - losses[0]) * 1e7,
        "excess_km_h": max(float(excess.max()), 0.0) * KM_H_PER_M_S,
        "lines": len(passed),
        "lines_closed": sum(
            not line.is_open(time_s) for line, time_s in zip(passed, at_s, strict=True)
        ),
        "braking_m_s2": -float(trip.acceleration_m_s2.min()),
        "fallback_ticks": int(np.count_nonzero(np.asarray(run.decisions.rung) != Rung.OPTIMAL)),
    }


def _between_ticks(trip: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, positions and speeds in steps of a tick's share, the speed linear inside a tick."""
    shares = np.arange(CHECKS_PER_TICK) / CHECKS_PER_TICK
    steps, gains = np.diff(trip.time_s)[:, None], np.diff(trip.speed_m_s)[:, None]
    moved = steps * shares * (trip.speed_m_s[:-1, None] + 0.5 * gains * shares)
    return (
        (trip.time_s[:-1, None] + steps * shares).ravel(),
        (trip.position_m[:-1, None] + moved).ravel(),
        (trip.speed_m_s[:-1, None] + gains * shares).ravel(),
    )


def run(session: Session) -> bool:
    """Run the study; returns whether everything was driven."""
    roads, duration_s = list(ROADS), None
    if session.short:
        roads, duration_s = roads[-1:], SHORT_S
    calls = [
        {"road": road, "strategy": strategy, "duration_s": duration_s}
        for road in roads
        for strategy in STRATEGIES
    ]
    names = [f"{call['road']}, {call['strategy']}" for call in calls]
    rows = [row for row in session.compute(drive, calls, names) if row is not None]
    driven = {(row["road"], row["strategy"]): row for row in rows}
    for row in rows:
        for base in BASES:
            other = driven[row["road"], base]
            for name, key in (("ageing", "degradation_1e7"), ("energy", "battery_energy_kj")):
                row[f"{base}_{name}"] = saved_percent(row[key], other[key])
    session.fill({"drives": table_of(rows, COLUMNS)})
    return True
