"""A string of vehicles: how disturbances travel along it, what each saves, and how late plans may be."""

from __future__ import annotations

from typing import Any

from studies.session import Session

import iptm
from iptm.parts import (
    SINGLE_HORIZON,
    Controller,
    ControllerOptions,
    ControllerSettings,
    Horizon,
    Plant,
    PreviewSettings,
    SolverOptions,
    build_route,
    load_parameters,
    run_string,
    strategy_by_name,
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
    parameters = load_parameters().values
    gap_m = parameters.gap.initial_gap_m
    route = build_route(CYCLE, initial_gap_m=gap_m, duration_s=duration_s)
    options = ControllerOptions(
        strategy=strategy_by_name(strategy),
        horizon=Horizon.parse(horizon),
        solver=SolverOptions(compile_code=duration_s is None),
        trip_duration_s=route.duration_s,
    )
    string = run_string(
        route,
        vehicles,
        Plant(parameters, route.slope.slope_at),
        lambda: Controller(parameters, options),
        PreviewSettings(latency_s=latency_s),
    )
    settings = {"strategy": strategy, "horizon": horizon}
    return [
        iptm.Run(strategy, settings, parameters, one.trajectory, one.decisions, route.slope)
        for one in string
    ]


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
