"""The gateway before a car's bus: judged by opendbc's safety code, and with measurements that are wrong."""

from __future__ import annotations

from typing import Any

from studies.gateway.faulty_car import NAMES, NONE, FaultyBench
from studies.gateway.opendbc_judge import CARS, build, judged
from studies.session import Session

FRAMES, SEED = 34_000, 50
"""By car: more than 100,000 together."""
CYCLE, FAULT_AT_S, DRIVE_S = "us06", 20.0, 45.0
CLEAN = (("us06", 600.0), ("wltc_class3b", 1800.0))
SHORT_FRAMES, SHORT_S, SHORT_FAULTS = 300, 15.0, NAMES[:2]


def run(session: Session) -> bool:
    """Run the study; returns whether nothing was blocked, and no car came too near."""
    short = session.short
    library = build()
    cars: list[dict[str, Any]] = []
    for car in CARS:
        counts = judged(library, car, SHORT_FRAMES if short else FRAMES, SEED)
        session.say(f"{car.name}: {counts}")
        cars.append({"car": car.name, **counts})
    faults = [
        FaultyBench(name, 8.0 if short else FAULT_AT_S, CYCLE).outcome(
            SHORT_S if short else DRIVE_S
        )
        for name in (SHORT_FAULTS if short else NAMES)
    ]
    clean = [
        {
            "cycle": cycle,
            "driven_s": duration_s,
            **FaultyBench(NONE, 4.5, cycle).outcome(duration_s),
        }
        for cycle, duration_s in ([] if short else CLEAN)
    ]
    session.render(
        cars=cars,
        frames=sum(each["enabled"] + each["inactive"] for each in cars),
        faults=faults,
        clean=clean,
        fault_at=FAULT_AT_S,
        drive=DRIVE_S,
    )
    blocked = [each["enabled, blocked"] + each["inactive, blocked"] for each in cars]
    return not any(blocked) and all(each["gap_m"] > 0.0 for each in [*faults, *clean])
