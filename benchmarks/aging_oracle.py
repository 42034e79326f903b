"""Capacity losses of BLAST-Lite for profiles of temperature and state of charge, as a reference table.

``blast-lite`` needs NumPy below 2 and therefore an environment of its own; nothing of it is used elsewhere:

    python3 -m venv /tmp/blast && /tmp/blast/bin/pip install blast-lite==1.1.1 'numpy<2'
    /tmp/blast/bin/python benchmarks/aging_oracle.py > tests/iptm_core/data/blast_lite_losses.csv

It takes about half an hour. Losses are those of BLAST-Lite's own simulation, which averages rates over days
and deepens cycles as capacity fades. ``hourly_calendar_loss`` is what the same model makes of the same
series of temperature and state of charge hour by hour, and ``given_cyclic_loss`` by day, both without that.

``tests/iptm_core/test_aging_laws.py`` compares the laws of ``iptm_core.aging_laws`` with it.
"""

from __future__ import annotations

import csv
import importlib
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

Array = Any
YEARS = 8
STEP_S = 900.0
STEPS_AN_HOUR = 4
STEPS_A_DAY = 96
CLASSES = {
    "NCA": "Nca_Gr_Panasonic3Ah_Battery",
    "NMC811-Si": "Nmc811_GrSi_LGMJ1_4Ah_Battery",
    "NMC111": "Nmc111_Gr_Kokam75Ah_Battery",
    "NMC111 (18650)": "Nmc111_Gr_Sanyo2Ah_Battery",
    "NMC622": "Nmc622_Gr_DENSO50Ah_Battery",
    "LFP": "Lfp_Gr_250AhPrismatic",
}
_CALENDAR, _CYCLIC = ("q_t", "q_LLI_t"), ("q_EFC", "q_LLI_EFC")
COLUMNS = (
    "cell",
    "profile",
    "calendar_loss",
    "cyclic_loss",
    "hourly_calendar_loss",
    "given_cyclic_loss",
    "resistance_growth",
)


Profile = Mapping[str, Array]
"""One year in steps of 15 min, in the names of BLAST-Lite: ``Time_s``, ``SOC`` and ``Temperature_C``."""


def _storage(charge: float, mean_c: float, swing_k: float) -> Profile:
    """Return a year of rest: constant state of charge, sinus of temperature over the year."""
    time_s = STEP_S * np.arange(365 * STEPS_A_DAY + 1)
    season = np.sin(2.0 * np.pi * time_s / (365 * 86400.0))
    temperature_c = mean_c + swing_k * season
    return {"Time_s": time_s, "SOC": np.full_like(time_s, charge), "Temperature_C": temperature_c}


def _use(depth: float, mean_c: float, swing_k: float) -> Profile:
    """Return a year of equal days: a trip at 7 and at 17 h, charging from 19 h on to a charge of 0.8."""
    rest = _storage(0.8, mean_c, swing_k)
    hour = (rest["Time_s"] / 3600.0) % 24.0
    trip = np.clip(hour - 7.0, 0.0, 1.0) + np.clip(hour - 17.0, 0.0, 1.0)
    charged = np.clip((hour - 19.0) / 3.0, 0.0, 1.0)
    return {**rest, "SOC": 0.8 - depth * (0.5 * trip - charged)}


PROFILES = {
    "storage, 50 %, 25 degC": _storage(0.5, 25.0, 0.0),
    "storage, 80 %, 35 degC": _storage(0.8, 35.0, 0.0),
    "storage, 70 %, 15 to 35 degC": _storage(0.7, 25.0, 10.0),
    "commuter, 20 % a day, 25 degC": _use(0.2, 25.0, 0.0),
    "commuter, 20 % a day, 15 to 35 degC": _use(0.2, 25.0, 10.0),
    "80 % of depth a day, 30 degC": _use(0.8, 30.0, 0.0),
}


def _part(battery: Any, names: tuple[str, ...]) -> float:
    name = next(name for name in names if name in battery.outputs)
    return 1.0 - float(battery.outputs[name][-1])


def _hour_by_hour(battery: Any, profile: Profile) -> Any:
    """Return a battery after all years, whose past is forgotten after each: copying it takes long."""
    for _ in range(YEARS):
        for start in range(0, profile["Time_s"].size - 1, STEPS_AN_HOUR):
            hour = slice(start, start + STEPS_AN_HOUR + 1)
            series = (profile[name][hour] for name in ("Time_s", "SOC", "Temperature_C"))
            battery.update_battery_state(*series)
        for past in (battery.states, battery.outputs, battery.stressors, battery.rates):
            past.update({name: values[-1:] for name, values in past.items()})
    return battery


def _by_day(battery: Any, profile: Profile, *, deepens: bool) -> Any:
    """Return a battery after all years of BLAST-Lite's simulation, with or without deeper cycles."""
    return battery.simulate_battery_life(
        dict(profile), threshold_time=YEARS, is_conserve_energy_throughput=deepens
    )


def main() -> None:
    """Write the losses of every cell and profile."""
    models = importlib.import_module("blast.models")

    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(COLUMNS)
    for cell, class_name in CLASSES.items():
        model = getattr(models, class_name)
        for name, profile in PROFILES.items():
            battery = _by_day(model(), profile, deepens=True)
            given = _by_day(model(), profile, deepens=False)
            hourly = given
            if np.ptp(profile["SOC"]) > 0.0:
                hourly = _hour_by_hour(model(), profile)
            losses = (
                _part(battery, _CALENDAR),
                _part(battery, _CYCLIC),
                _part(hourly, _CALENDAR),
                _part(given, _CYCLIC),
            )
            grown = battery.outputs.get("r")
            resistance = "" if grown is None else f"{float(grown[-1]) - 1.0:.5f}"
            rows.writerow((cell, name, *(f"{loss:.5f}" for loss in losses), resistance))


if __name__ == "__main__":
    main()
