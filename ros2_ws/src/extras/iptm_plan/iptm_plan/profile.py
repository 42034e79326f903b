"""A plan as JSON: a charging profile in the terms of OCPP 2.0.1, a target with a start time, and prices."""

from __future__ import annotations

from datetime import timezone
from typing import Any

import numpy as np

from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_plan.course import Course, ParkedInstant
from iptm_plan.day_plan import DayPlan, Worth
from iptm_plan.week_file import Week

CLOCK = "%a %H:%M"
TABLE_C = tuple(map(float, range(-20, 49, 2)))
"""Temperatures on arrival whose cost a trip is given."""
_LEAST_EUR_KWH = 0.01


def plan_data(week: Week, plan: DayPlan, course: Course) -> dict[str, Any]:
    """Return what a plan decides, as plain data for JSON."""
    return {
        "begin": _utc(week, 0),
        "step_s": week.schedule.step_s,
        "chargingProfile": charging_profile(week, course),
        "charges": _charges(week, course),
        "events": [
            {**_event(week, each), **_trip(week, plan, each)} for each in plan.worth(course)
        ],
        "missed": [
            {
                "departure" if event.is_departure else "arrival": event.stage + 1,
                "at": _utc(week, event.step),
                "asked": round(event.asked, 4),
                "reached": round(event.charge, 4),
            }
            for event in course.events
            if event.missed
        ],
        "charge": np.round(course.charge, 4).tolist(),
        "pack_c": np.round(course.kelvin - CELSIUS_ZERO_K, 2).tolist(),
        "thermal_w": [
            0.0 if each is None else round(float(each.thermal_w), 1) for each in course.decisions
        ],
        "fan": [each is not None and bool(each.fan) for each in course.decisions],
        "energy_eur": round(course.energy_eur, 4),
        "aging_eur": round(course.aging_eur, 4),
    }


def missed_charges(week: Week, course: Course) -> list[str]:
    """Return one line for each charge that is out of reach: how far it gets, and since when it is charged."""
    lines: list[str] = []
    begins = 0
    for event in course.events:
        if not event.is_departure:
            begins = event.step
        if not event.missed:
            continue
        charged = [
            step
            for step in range(begins, event.step)
            if course.charge[step + 1] > course.charge[step]
        ]
        since = f"charged since {week.local(charged[0]):{CLOCK}}" if charged else "not charged"
        what = "departure" if event.is_departure else "arrival"
        lines.append(
            f"{what} {event.stage + 1}, {week.local(event.step):{CLOCK}}: charge is "
            f"{100.0 * event.charge:.1f} %, {since}; asked for: {100.0 * event.asked:.1f} %"
        )
    return lines


def charging_profile(week: Week, course: Course) -> dict[str, Any]:
    """Return the power from the plug over time as a ``ChargingProfileType`` of OCPP 2.0.1, in W.

    Limits hold for charging, chiller and heater together; 0 where the car is away.
    """
    step_s = week.schedule.step_s
    limits = np.round(course.grid_j / step_s, 1)
    starts = [0, *(np.flatnonzero(np.diff(limits)) + 1).tolist()]
    return {
        "id": 1,
        "stackLevel": 0,
        "chargingProfilePurpose": "TxDefaultProfile",
        "chargingProfileKind": "Absolute",
        "chargingSchedule": [
            {
                "id": 1,
                "startSchedule": _utc(week, 0),
                "duration": round(limits.size * step_s),
                "chargingRateUnit": "W",
                "chargingSchedulePeriod": [
                    {"startPeriod": round(start * step_s), "limit": float(limits[start])}
                    for start in starts
                ],
            }
        ],
    }


def trip_settings(week: Week, plan: DayPlan, worth: Worth) -> dict[str, Any]:
    """Return the settings of a trip that ends here: ``controller`` of a trip's file.

    What a per cent of charge is worth is the price of electricity there.
    """
    kwh = 0.01 * week.pack.energy_j / J_PER_KWH
    return {
        "arrival_cost_eur": arrival_table(plan, worth.stage + 1, worth.step, worth.charge),
        "electricity_eur_kwh": round(max(worth.eur_per_percent / kwh, _LEAST_EUR_KWH), 4),
    }


def arrival_table(plan: DayPlan, stage: int, step: int, charge: float) -> str:
    """Return the cost of the temperatures on arrival as the setting ``arrival_cost_eur`` of a trip.

    Args:
        stage: departure that the car waits for then.
        step: of the arrival.
        charge: state of charge on arrival.
    """
    low, high = plan.kelvins[0] - CELSIUS_ZERO_K, plan.kelvins[-1] - CELSIUS_ZERO_K
    celsius = [each for each in TABLE_C if low <= each <= high]
    eur = [
        plan.cost_to_go(ParkedInstant(stage, step, charge, at + CELSIUS_ZERO_K)) for at in celsius
    ]
    pairs = zip(celsius, eur, strict=True)
    return ", ".join(f"{at:g}:{each - min(eur):.5g}" for at, each in pairs)


def _charges(week: Week, course: Course) -> list[dict[str, Any]]:
    """Return target and start of each stay, for a car that takes nothing else."""
    found: list[dict[str, Any]] = []
    begins = 0
    for event in (*course.events, None):
        if event is not None and not event.is_departure:
            begins = event.step
            continue
        ends = len(course.decisions) if event is None else event.step
        gains = np.flatnonzero(np.diff(course.charge[begins : ends + 1]) > 0.0) + begins
        if gains.size:
            found.append(
                {
                    "start": _utc(week, int(gains[0])),
                    "end": _utc(week, int(gains[-1]) + 1),
                    "target_charge": round(float(course.charge[gains[-1] + 1]), 4),
                }
            )
    return found


def _event(week: Week, worth: Worth) -> dict[str, Any]:
    return {
        "event": "departure" if worth.is_departure else "arrival",
        "number": worth.stage + 1,
        "at": _utc(week, worth.step),
        "charge": round(worth.charge, 4),
        "pack_c": round(worth.kelvin - CELSIUS_ZERO_K, 2),
        "eur_per_k": round(worth.eur_per_k, 5),
        "eur_per_percent": round(worth.eur_per_percent, 5),
    }


def _trip(week: Week, plan: DayPlan, worth: Worth) -> dict[str, Any]:
    return {} if worth.is_departure else {"trip": trip_settings(week, plan, worth)}


def _utc(week: Week, step: int) -> str:
    return week.local(step).astimezone(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
