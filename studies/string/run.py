"""A string of vehicles: how disturbances travel along it, what each saves, and how late plans may be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from studies.road_space.run import EQUAL, EQUAL_ROAD
from studies.savings import BASELINE, BASES, COLUMNS, PRODUCTION, road_taken, savings
from studies.session import Session

import iptm
from iptm_controller.settings import ControllerSettings
from iptm_core.settings import PreviewSettings
from iptm_string.headless import drive_string_in_memory
from iptm_string.report import save_string_picture, string_parts

CYCLE, VEHICLES = "wltc_class3b", 5
LATE_S = (0.0, 1.0)
DEFAULT = "default"
PREVIEW = f"{PreviewSettings.preview_length_s:g} s, perfect"
PLAN = "plan of the car ahead"
SHORT_VEHICLES, SHORT_S = 3, 60.0
PICTURE = "string.png"
_CHOSEN = ControllerSettings()


def drive_string(
    strategy: str,
    horizon: str,
    latency_s: float = 0.0,
    vehicles: int = VEHICLES,
    duration_s: float | None = None,
    settings: Mapping[str, Any] | None = None,
) -> list[iptm.Run]:
    """Drive a string of equal vehicles in memory; returns the run of each, the first one first.

    Args:
        settings: further ones of the trip.
    """
    trip = iptm.Trip.of(
        CYCLE,
        duration_s=duration_s,
        strategy=strategy,
        horizon=horizon,
        preview_length_s=PreviewSettings.preview_length_s,
        latency_s=latency_s,
        **(settings or {}),
    )
    return list(drive_string_in_memory(trip, vehicles))


def run(session: Session) -> bool:
    """Run the study; returns whether every string was driven."""
    extent: dict[str, Any] = {}
    if session.short:
        extent = {"vehicles": SHORT_VEHICLES, "duration_s": SHORT_S}
    own = {"strategy": _CHOSEN.strategy, "horizon": _CHOSEN.horizon}
    calls = [{**own, "latency_s": late_s, **extent} for late_s in LATE_S]
    calls.append({**own, "settings": EQUAL, **extent})
    calls += [{"strategy": base, "horizon": _CHOSEN.horizon, **extent} for base in BASES]
    names = [f"string {place} of {len(calls)}" for place in range(1, len(calls) + 1)]
    driven = session.compute(drive_string, calls, names)
    if session.failures:
        return False
    *late, shorter, production, baseline = driven
    strings = {
        (DEFAULT, EQUAL_ROAD): shorter,
        (DEFAULT, "120 m"): late[0],
        (PRODUCTION, "1.6 s"): production,
        (BASELINE, "3.5 s"): baseline,
    }
    if not session.short:
        session.output.mkdir(parents=True, exist_ok=True)
        save_string_picture(session.output / PICTURE, late[0])
    session.render(
        vehicles=len(late[0]),
        cycle=CYCLE,
        picture=PICTURE,
        parts=string_parts(late[0], late=dict(zip(LATE_S, late, strict=True))),
        columns=COLUMNS,
        savings=savings_along(strings),
        **own,
    )
    return True


def savings_along(strings: Mapping[tuple[str, str], list[iptm.Run]]) -> list[dict[str, Any]]:
    """Return a row per control, distance and vehicle: its road, and what it saves in its place."""
    bases = {control: runs for (control, _), runs in strings.items() if control in BASES}
    rows = []
    for (control, distance), runs in strings.items():
        for place, run in enumerate(runs):
            others = {name: [string[place].metrics] for name, string in bases.items()}
            row = {
                "car": f"car_{place + 1}",
                "control": control,
                "distance": distance,
                "preview": "none" if control in bases else PLAN if place else PREVIEW,
            }
            own = savings([run.metrics], others, run.parameters)
            rows.append({**row, **road_taken([run.trajectory]), **own})
    return rows
