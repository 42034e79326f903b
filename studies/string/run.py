"""A string of vehicles: how disturbances travel along it, what each saves, and how late plans may be."""

from __future__ import annotations

from typing import Any

from studies.session import Session

import iptm
from iptm.parts import (
    SINGLE_HORIZON,
    ControllerSettings,
    PreviewSettings,
    drive_string_in_memory,
)
from iptm.string_report import save_string_picture, string_parts

CYCLE, VEHICLES = "wltc_class3b", 5
LATE_S = (0.0, 1.0)
SHORT_VEHICLES, SHORT_S = 3, 60.0
PICTURE = "string.png"
_CHOSEN = ControllerSettings()


def drive_string(
    strategy: str,
    horizon: str,
    latency_s: float,
    vehicles: int = VEHICLES,
    duration_s: float | None = None,
) -> list[iptm.Run]:
    """Drive a string of equal vehicles in memory; returns the run of each, the first one first."""
    trip = iptm.Trip.of(
        CYCLE,
        duration_s=duration_s,
        strategy=strategy,
        horizon=horizon,
        preview_length_s=PreviewSettings.preview_length_s,
        latency_s=latency_s,
        compile_code=duration_s is None,
    )
    return list(drive_string_in_memory(trip, vehicles))


def run(session: Session) -> bool:
    """Run the study; returns whether every string was driven."""
    extent: dict[str, Any] = {}
    if session.short:
        extent = {"vehicles": SHORT_VEHICLES, "duration_s": SHORT_S}
    own = {"strategy": _CHOSEN.strategy, "horizon": _CHOSEN.horizon}
    other = {"strategy": "reference", "horizon": str(SINGLE_HORIZON)}
    calls = [{**own, "latency_s": late_s, **extent} for late_s in LATE_S]
    calls.append({**other, "latency_s": 0.0, **extent})
    names = [f"{call['strategy']}, {call['latency_s']:g} s late" for call in calls]
    *late, others = session.compute(drive_string, calls, names)
    if session.failures:
        return False
    if not session.short:
        session.output.mkdir(parents=True, exist_ok=True)
        save_string_picture(session.output / PICTURE, late[0])
    session.render(
        vehicles=len(others),
        cycle=CYCLE,
        picture=PICTURE,
        parts=string_parts(late[0], others, dict(zip(LATE_S, late, strict=True))),
        **own,
    )
    return True
