"""Gains and thermostat of `production`, tuned once on trips that no table of savings uses.

The thermostat comes first, with the gains of `production_simple`, judged by the cost of energy and capacity
in the median over the laws of measured cells; then the gains, with that thermostat, judged by the energy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.drives import climate
from studies.measured_cycles import FASTEST_M_S, write_drive
from studies.savings import PRODUCTION, PRODUCTION_SIMPLE, kept, road_taken
from studies.session import Case, Session
from studies.validation import excerpts

import iptm
from iptm_controller.production import SIMPLE, ProductionSettings
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.metrics.trip_cost import trip_cost
from iptm_core.parameters import load_parameters
from iptm_core.units import CELSIUS_ZERO_K

TRIPS = ("A07", "A27", "B23")
"""Whole trips of the BMW i3: a motorway, a town and a country road. No other study drives them."""
AMBIENT_C = 35.0
THERMOSTATS = tuple(
    (off_c + band_k, off_c, share)
    for off_c in (27.0, 28.0, 29.0)
    for band_k in (1.0, 2.0)
    for share in (0.22, 0.26, 0.3, 0.4, 0.5)
)
"""Temperatures in degC of the warmer cell above which the compressor runs and below which it stops; power."""
GAINS = (
    (0.23, 0.07, 0.04, 0.8),
    (0.10, 0.30, 0.04, 0.8),
    (0.05, 0.50, 0.04, 0.8),
    (0.05, 0.40, 0.03, 0.5),
    (0.04, 0.80, 0.04, 0.8),
    (0.03, 0.50, 0.03, 0.5),
    (0.03, 0.50, 0.04, 0.7),
    (0.03, 0.50, 0.05, 0.7),
    (0.05, 0.28, 0.03, 0.55),
    (0.05, 0.30, 0.04, 0.7),
    (0.02, 0.60, 0.05, 1.0),
    (0.09, 0.45, 0.05, 0.85),
)
"""Gains of gap and speed while following, and the same while a large gap is closed."""
GAIN_NAMES = (
    "acc_gap_gain_1_s2",
    "acc_speed_gain_1_s",
    "acc_closing_gap_gain_1_s2",
    "acc_closing_speed_gain_1_s",
)
HEADWAY_S, DEEPER_M = 0.05, 2.0
"""Median headway and depth below s_min that count as equal to those of `production_simple`."""
CLOSE_EUR = 0.005
"""Costs that differ by less are equal: it depends on chance in which phase a thermostat ends."""
SHORT_S = 60.0
Settings = Mapping[str, float]


def thermostat(on_c: float, off_c: float, share: float) -> Settings:
    """Return the settings of a thermostat."""
    kelvin = {"thermostat_on_k": on_c, "thermostat_off_k": off_c}
    in_kelvin = {name: round(value + CELSIUS_ZERO_K, 2) for name, value in kelvin.items()}
    return {**in_kelvin, "thermostat_power_share": share}


def cycles(folder: Path) -> list[str]:
    """Write the trips as drive files on a level road; returns their paths."""
    found = []
    for trip in excerpts.trips():
        if trip.name in TRIPS:
            seconds = np.arange(0.0, trip.time_s[-1] + 0.5)
            speeds = np.interp(seconds, trip.time_s, trip.speed_m_s)
            path = folder / f"whole_{trip.name}.csv"
            found.append(str(write_drive(path, 1.0, np.minimum(speeds, FASTEST_M_S))))
    return found


def drive(session: Session, candidates: Sequence[Settings]) -> pd.DataFrame:
    """Drive candidates and `production_simple`; returns a row per candidate, see `_row`."""
    places = cycles(session.scratch / "drives")[: 1 if session.short else None]
    roles: list[tuple[str, Settings]] = [
        (PRODUCTION_SIMPLE, {}),
        *((PRODUCTION, each) for each in candidates),
    ]
    cases = [
        Case(
            f"{Path(cycle).stem}/{strategy}/{settings}",
            {"number": number},
            {
                "cycle": cycle,
                "strategy": strategy,
                "preview_mode": "none",
                "overrides": climate(AMBIENT_C),
                **settings,
            },
        )
        for number, (strategy, settings) in enumerate(roles)
        for cycle in places
    ]
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    base, *others = (list(group.run) for _, group in driven.groupby("number"))
    rows = [_row(runs, base) for runs in others if all(runs)]
    return pd.DataFrame(
        {"settings": settings, **row} for settings, row in zip(candidates, rows, strict=True)
    )


def _row(runs: Sequence[iptm.Run], base: Sequence[iptm.Run]) -> dict[str, float]:
    """Return cost saved in EUR per 100 km, energy saved, coldest pack, and how the distance was kept."""
    use = AgingSettings()
    saved_eur = [
        np.median([_cost_eur(before, use, law) - _cost_eur(run, use, law) for law in LAWS])
        for run, before in zip(runs, base, strict=True)
    ]
    energies = [sum(run.metrics.battery_energy_j for run in each) for each in (runs, base)]
    kelvin = [
        0.5 * (r.trajectory.cell_1_temperature_k + r.trajectory.cell_n_temperature_k) for r in runs
    ]
    road = road_taken([run.trajectory for run in runs])
    return {
        "saved_eur": float(np.mean(saved_eur)),
        "energy": 100.0 * (1.0 - energies[0] / energies[1]),
        "coldest_c": min(float(each.min()) for each in kelvin) - CELSIUS_ZERO_K,
        **kept([run.metrics for run in runs]),
        "headway_s": road["headway_s"],
        "vehicles_h": road["vehicles_h"],
        "interventions": sum(run.metrics.interventions for run in runs),
    }


def _cost_eur(run: iptm.Run, use: AgingSettings, law: str) -> float:
    return trip_cost(run.trajectory, run.metrics, run.parameters, use, law).eur


def run(session: Session) -> bool:
    """Run the study; returns whether the best candidate is what the strategy has."""
    most = 2 if session.short else None
    thermostats = drive(
        session, [{**thermostat(*each), **_simple_gains()} for each in THERMOSTATS[:most]]
    )
    lowest_c = load_parameters().values.limits.min_temperature_k - CELSIUS_ZERO_K
    thermostats["allowed"] = thermostats.coldest_c >= lowest_c
    near = thermostats[thermostats.allowed] if thermostats.allowed.any() else thermostats
    near = near[near.saved_eur >= near.saved_eur.max() - CLOSE_EUR]
    strongest = near.settings.map(lambda each: each["thermostat_power_share"]).idxmax()
    warm: Settings = near.loc[strongest].settings
    candidates = [{**warm, **dict(zip(GAIN_NAMES, gains, strict=True))} for gains in GAINS[:most]]
    gains = drive(session, candidates)
    base = gains.iloc[0]
    gains["allowed"] = (
        (gains.below_s <= base.below_s)
        & (gains.deepest_m <= base.deepest_m + DEEPER_M)
        & ((gains.headway_s - base.headway_s).abs() <= HEADWAY_S)
        & (gains.vehicles_h >= base.vehicles_h)
    )
    kept = gains[gains.allowed]
    best: Settings = kept.loc[kept.energy.idxmax()].settings
    session.render(
        thermostats=pd.DataFrame(_shown(thermostats)),
        gains=pd.DataFrame(_shown(gains)),
        trips=", ".join(TRIPS),
        ambient_c=AMBIENT_C,
        lowest_c=lowest_c,
        headway_s=HEADWAY_S,
        deeper_m=DEEPER_M,
        close_eur=CLOSE_EUR,
        best=best,
        laws=", ".join(f"`{law}`" for law in LAWS),
    )
    shipped = asdict(ProductionSettings())
    return session.short or all(shipped[name] == value for name, value in best.items())


def _simple_gains() -> Settings:
    return {name: SIMPLE[name] for name in GAIN_NAMES}


def _shown(table: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table with their settings as columns."""
    for row in table.to_dict("records"):
        settings = row.pop("settings")
        yield {
            **{str(name): value for name, value in row.items()},
            **settings,
            "on_c": settings["thermostat_on_k"] - CELSIUS_ZERO_K,
            "off_c": settings["thermostat_off_k"] - CELSIUS_ZERO_K,
            "kept": "yes" if row["allowed"] else "no",
        }
