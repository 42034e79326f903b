"""Drives all scenarios in simulated traffic with all kinds of knowledge.

Needs requirements/traffic.txt. The wall times hold for this machine, whatever else it does.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from studies.pages import STUDIES
from studies.savings import BASES, road_taken, savings
from studies.savings import COLUMNS as SAVINGS
from studies.session import Session

from iptm_core.markdown import table_of
from iptm_core.metrics.run_metrics import RunMetrics
from iptm_core.parameters import load_parameters
from iptm_core.units import KM_H_PER_M_S
from iptm_traffic.demand import DemandSettings, TrafficScenario
from iptm_traffic.drive import drive_in_traffic
from iptm_traffic.own_network import OwnNetwork
from iptm_traffic.trip import PredictionInput, TrafficDrive

MEASURES_TIME = True
SHORT_S = 60.0
DEFAULT = "default"
DISTANCES = {"production": "1.6 s", "eco_acc": "3.5 s", DEFAULT: "120 m"}
_TOWN = STUDIES.parent / "docs" / "examples" / "town"
TOWN = OwnNetwork(_TOWN / "town.netccfg", (_TOWN / "town.rou.xml",), "round_trip")
COLUMNS = {
    "scenario": "`{scenario}`",
    "control": "`{control}`",
    **dict(SAVINGS),
    "way:": "{distance_km:.2f} km",
    "battery energy:": "{battery_energy_kj:.0f} kJ",
    "degradation:": "{degradation_1e7:.3f}·10⁻⁷",
    "smallest gap:": "{smallest_gap_m:.2f} m",
    "smallest margin to s_min:": "{smallest_margin_m:.2f} m",
    "lines passed:": "{lines_passed}",
    "while closed:": "{lines_passed_closed}",
    "above the limit:": "{excess_km_h:.1f} km/h",
    "collisions:": "{collisions}",
    "cars ahead:": "{leaders}",
    "messages:": "{messages}",
    "without solution:": "{fallback_ticks} s",
    "plant − SUMO:": "{deviation_m:.0e} m",
    "times real time:": "{times_real_time:.0f}",
    "by processor time:": "{times_processor_time:.0f}",
}


def row_of(drive: TrafficDrive) -> dict[str, Any]:
    """Return the figures of one drive, and its `RunMetrics`."""
    result = drive_in_traffic(drive, load_parameters().values)
    run, world = result.metrics, result.world
    control = drive.strategy if drive.strategy in BASES else DEFAULT
    return {
        "scenario": drive.title,
        "control": control,
        "distance": DISTANCES[control],
        "preview": str(drive.knowledge) if control == DEFAULT else "none",
        **road_taken([result.trajectory]),
        "metrics": run,
        "distance_km": 1e-3 * run.distance_m,
        "battery_energy_kj": 1e-3 * run.battery_energy_j,
        "degradation_1e7": 1e7 * run.degradation,
        "smallest_gap_m": run.smallest_gap_m,
        "smallest_margin_m": world.smallest_margin_m,
        "lines_passed": len(world.lines),
        "lines_passed_closed": world.lines_passed_closed,
        "excess_km_h": KM_H_PER_M_S * result.largest_excess_m_s,
        "collisions": len(world.simulation.collisions),
        "leaders": len(world.leaders),
        "messages": world.radio.sent,
        "fallback_ticks": result.fallback_ticks,
        "deviation_m": world.simulation.ego.largest_deviation_m,
        "times_real_time": result.times_real_time,
        "times_processor_time": result.times_processor_time,
        "digest": result.digest,
    }


def run(session: Session) -> bool:
    """Run the study; returns whether everything was driven."""
    options = session.options
    scenarios = options.scenario or [*map(str, TrafficScenario), TOWN.net.name]
    known = [PredictionInput(name) for name in options.know or map(str, PredictionInput)]
    duration_s = SHORT_S if session.short else options.duration_s
    if session.short:
        scenarios, known = scenarios[:1], known[:1]
    drives = [
        TrafficDrive(duration_s=duration_s, own=replace(TOWN, seed=options.seed))
        if name == TOWN.net.name
        else TrafficDrive(
            TrafficScenario(name),
            duration_s=duration_s,
            demand=DemandSettings(traffic_seed=options.seed),
        )
        for name in scenarios
    ]
    driven = [
        replace(drive, knowledge=knowledge)
        for drive in drives
        for knowledge in known
        if drive.own is None or knowledge is not PredictionInput.PATH
    ]
    driven += [replace(drive, strategy=base) for drive in drives for base in BASES]
    names = [f"{drive.title}, {drive.strategy}, {drive.knowledge}" for drive in driven]
    calls = [{"drive": drive} for drive in driven]
    rows = with_savings([row for row in session.compute(row_of, calls, names) if row is not None])
    text = (
        f"Trips of {duration_s:g} s, seed {options.seed}; {os.cpu_count()} processors, "
        f"with other work on them (mean load {os.getloadavg()[0]:.0f})."
    )
    parts: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        parts.setdefault("town" if row["scenario"] == TOWN.net.name else "drives", []).append(row)
    session.fill({name: f"{text}\n\n{table_of(part, COLUMNS)}" for name, part in parts.items()})
    return not session.failures


def with_savings(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add savings to rows, ordered by scenario; rows of scenarios that lack a base are left out."""
    by_place: dict[str, dict[str, RunMetrics]] = {}
    for row in rows:
        by_place.setdefault(row["scenario"], {})[row["control"]] = row["metrics"]
    parameters = load_parameters().values
    return [
        {**row, **savings([row["metrics"]], {base: [found[base]] for base in BASES}, parameters)}
        for scenario, found in by_place.items()
        if {*BASES} <= {*found}
        for row in rows
        if row["scenario"] == scenario
    ]
