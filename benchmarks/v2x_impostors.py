"""A second sender with the identity of the leader, in closed loop: smallest gap and time to the diagnostics.

The leader drives 15 m/s and brakes to a halt with 2.5 m/s2 from 60 s on. The impostor repeats its motion
until then, 10 messages a second; then it drives on, or moves out of the lane. The vehicle without radio has
an exact range sensor and no previews; the radio is the only source of the leader in the other drives.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from benchmarks.harness import formatted_table, run_benchmark
from benchmarks.v2x_attacks import (
    PARAMETERS,
    SENDER,
    AttackedRadio,
    Outcome,
    controller,
    drive,
    written_route,
)
from iptm_core.routes import Route
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_v2x_bridge.sending.settings import Foresight, Impostor

DEPARTURE_S, TRIP_S = 60, 95
CLOCKS: Mapping[str, dict[str, float]] = {
    "100 ms ahead": {"impostor_clock_ahead_s": 0.1},
    "150 ms ahead, arriving later": {"impostor_clock_ahead_s": 0.15, "impostor_delay_s": 0.05},
    "the same, arriving first": {"link_delay_s": 0.02, "impostor_delay_s": -0.01},
    "50 ms behind": {"impostor_clock_ahead_s": -0.05},
}
"""Stamps of the impostor, and settings of the sender."""


def braking_route() -> Route:
    """Return the leader that brakes."""
    return written_route(f"0,0\n15,15\n{DEPARTURE_S},15\n{DEPARTURE_S + 6},0\n120,0\n", TRIP_S)


def without_radio(route: Route) -> Trajectory:
    """Return the drive with an exact range sensor and no previews."""
    plant = Plant(PARAMETERS, route.slope.slope_at)
    settings = PreviewSettings(preview_mode=PreviewMode.NONE)
    return run_closed_loop(route, plant, controller(), settings).trajectory


def impersonated(route: Route, **settings: Any) -> Outcome:
    """Drive behind a leader whose identity another sender uses."""
    return drive(route, AttackedRadio(route, None, replace(SENDER, **settings)))


def reported_after_s(outcome: Outcome) -> int | None:
    """Return how long after the departure the contested identity was reported, None if never."""
    if True not in outcome.contested:
        return None
    return max(outcome.contested.index(True) - DEPARTURE_S, 0)


def drives() -> Iterator[tuple[dict[str, str], Outcome]]:
    """Yield every impostor with its drive, and the drives without one."""
    route = braking_route()
    for foresight in Foresight:
        paths = "yes" if foresight is Foresight.PATH else "no"
        names = {"impostor": "-", "stamps": "-", "paths": paths}
        yield names, impersonated(route, foresight=foresight)
        for impostor in (Impostor.KEEPS_SPEED, Impostor.DRIFTS_ASIDE):
            for stamps, settings in CLOCKS.items():
                kind = str(impostor).replace("_", " ")
                outcome = impersonated(route, impostor=impostor, foresight=foresight, **settings)
                yield names | {"impostor": kind, "stamps": stamps}, outcome


def row(trajectory: Trajectory, names: dict[str, str], reported: str) -> dict[str, Any]:
    """Return one row of the table."""
    after = slice(DEPARTURE_S, None)
    return {
        **names,
        "reported": reported,
        "hardest_braking_m_s2": float(-trajectory.acceleration_m_s2[after].min()),
        "smallest_gap_m": float(trajectory.gap_m.min()),
    }


def measure() -> dict[str, Any]:
    """Drive with every impostor."""
    names = {"impostor": "no radio", "stamps": "-", "paths": "-"}
    rows = [row(without_radio(braking_route()), names, "-")]
    for names, outcome in drives():
        after_s = reported_after_s(outcome)
        reported = "-" if after_s is None else f"{after_s} s"
        rows.append(row(outcome.loop.trajectory, names, reported))
    return {"rows": rows}


COLUMNS = {
    "impostor": "{impostor}",
    "stamps": "{stamps}",
    "paths sent": "{paths}",
    "reported after:": "{reported}",
    "hardest braking:": "{hardest_braking_m_s2:.2f} m/s²",
    "smallest true gap:": "{smallest_gap_m:.2f} m",
}


def as_table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    return formatted_table(numbers["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
