"""Drives in shadow: what the meter states of a driven car, and of the suite behind it."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

from studies.session import Session
from studies.vehicle.bench import FRAMES, drive, kept

from iptm_core.errors import MeasurementError
from iptm_vehicle_interface import meter
from iptm_vehicle_interface.vehicle import VEHICLES, load_vehicle


def shadow(log: Path, dbc: Path, signal: str, parameter_set: str, strategy: str) -> dict[str, Any]:
    """Return what `iptm meter` states of a logged drive (driven_) and of the suite behind it (behind_)."""
    options = {"--dbc": dbc, "--signal": signal, "--parameter-set": parameter_set}
    texts = [f"{part}" for pair in options.items() for part in pair]
    printed = io.StringIO()
    with redirect_stdout(printed):
        meter.main([str(log), *texts, "--follow", strategy, "--json"])
    driven, behind = json.loads(printed.getvalue()).values()
    return {f"driven_{name}": value for name, value in driven.items()} | {
        f"behind_{name}": value for name, value in behind.items()
    }


def bench_shadows(session: Session, recorded: Path, strategy: str) -> list[dict[str, Any]]:
    """Drive in shadow of the bench car's driver, with all processes, and of the log of a drive.

    Raises:
        MeasurementError: a request has reached the car.
    """
    folder = session.scratch / "drives" / "us06_shadow"
    live = kept(
        folder / "result.json",
        partial(drive, folder, "us06", strategy, 600.0, shadow=True),
    )
    if live["car"]["active_s"]:
        raise MeasurementError(f"{folder}: a request has reached the car; allowed: none in shadow")
    vehicle = load_vehicle("bench")
    rows = []
    for name, of in (("bench car's driver", folder), ("bench, by the suite", recorded)):
        found = kept(
            of / "shadow.json",
            partial(shadow, of / FRAMES, VEHICLES / "bench" / "bench.dbc",
                    "speed_kmh=VehicleSpeed", vehicle.parameter_set, strategy),
        )  # fmt: skip
        drove = json.loads((of / "result.json").read_text("utf-8"))
        own = {
            "own_kwh": drove["car"]["battery_energy_j"] / 3.6e6,
            "own_km": drove["car"]["distance_m"] / 1000.0,
            "decisions": drove["suite"]["decisions"],
        }
        rows.append({"drive": name, **found, **own})
    return rows
