"""Drives all scenarios in simulated traffic with all kinds of knowledge: the table of docs/traffic.md.

Needs requirements/traffic.txt. The wall times are those of this machine, whatever else it does.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from iptm.parts import KM_H_PER_M_S, load_parameters, table_of
from studies.speed.harness import run_benchmark
from iptm_traffic.demand import DemandSettings, TrafficScenario
from iptm_traffic.drive import PredictionInput, TrafficDrive, TrafficResult, drive_in_traffic
from iptm_traffic.own_network import OwnNetwork

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "traffic.md"
_TOWN = DOCS / "examples" / "town"
TOWN = OwnNetwork(_TOWN / "town.netccfg", (_TOWN / "town.rou.xml",), "round_trip")
COLUMNS = {
    "scenario": "`{scenario}`",
    "known": "`{knowledge}`",
    "way:": "{distance_km:.2f} km",
    "battery energy:": "{battery_energy_kj:.0f} kJ",
    "degradation:": "{degradation_1e7:.3f}·10⁻⁷",
    "ageing while driving saved:": "{saved_percent:.1f} %",
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


def row_of(result: TrafficResult, reference: TrafficResult) -> dict[str, Any]:
    """Return the figures of one drive, compared with the reference strategy in the same traffic."""
    run, other, world = result.metrics, reference.metrics, result.world
    return {
        "scenario": result.drive.title,
        "knowledge": str(result.drive.knowledge),
        "distance_km": 1e-3 * run.distance_m,
        "battery_energy_kj": 1e-3 * run.battery_energy_j,
        "degradation_1e7": 1e7 * run.degradation,
        "saved_percent": 100.0 * (1.0 - run.degradation / other.degradation),
        "smallest_gap_m": run.smallest_gap_m,
        "smallest_margin_m": world.smallest_margin_m,
        "lines_passed": len(world.lines),
        "lines_passed_closed": world.lines_passed_closed,
        "excess_km_h": KM_H_PER_M_S * result.largest_excess_m_s,
        "collisions": len(world.simulation.collisions),
        "leaders": len(world.leaders),
        "messages": world.radio.sent,
        "fallback_ticks": result.fallback_ticks,
        "deviation_m": world.simulation.largest_deviation_m,
        "times_real_time": result.times_real_time,
        "times_processor_time": result.times_processor_time,
        "digest": result.digest,
    }


def measure(
    duration_s: float = 600.0,
    seed: int = 1,
    scenario: tuple[str, ...] = (*map(str, TrafficScenario), TOWN.net.name),
    know: tuple[str, ...] = tuple(map(str, PredictionInput)),
    rows_of: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Measure all drives.

    Args:
        duration_s: length of each, s.
        seed: of the traffic.
        scenario: only these, or the example of an own network; may be repeated.
        know: only with this knowledge; may be repeated.
        rows_of: no drives, but the rows of these --json files; may be repeated.
    """
    parameters = load_parameters().values
    rows: list[dict[str, Any]] = []
    load = os.getloadavg()[0]
    for file in rows_of:
        measured = json.loads(Path(file).read_text("utf-8"))
        rows += measured["rows"]
        load = max(load, measured["load"])
    drives = [
        TrafficDrive(duration_s=duration_s, own=replace(TOWN, seed=seed))
        if name == TOWN.net.name
        else TrafficDrive(
            TrafficScenario(name),
            duration_s=duration_s,
            demand=DemandSettings(traffic_seed=seed),
        )
        for name in scenario
    ]
    for drive in () if rows_of else drives:
        reference = drive_in_traffic(replace(drive, strategy="reference"), parameters)
        for knowledge in map(PredictionInput, know):
            if drive.own is not None and knowledge is PredictionInput.PATH:
                continue
            result = drive_in_traffic(replace(drive, knowledge=knowledge), parameters)
            rows.append(row_of(result, reference))
            print(rows[-1], file=sys.stderr, flush=True)
    return {
        "duration_s": duration_s,
        "seed": seed,
        "load": max(load, os.getloadavg()[0]),
        "rows": rows,
    }


def as_tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Return the tables of the own network and of the corridors, as far as they were driven."""
    text = (
        f"Trips of {numbers['duration_s']:g} s, seed {numbers['seed']}; {os.cpu_count()} processors, "
        f"with other work on them (mean load {numbers['load']:.0f})."
    )
    parts: dict[str, list[dict[str, Any]]] = {}
    for row in numbers["rows"]:
        own = row["scenario"] == TOWN.net.name
        parts.setdefault("town" if own else "drives", []).append(row)
    return {name: f"{text}\n\n{table_of(rows, COLUMNS)}" for name, rows in parts.items()}


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_tables, page=PAGE))
