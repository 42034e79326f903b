"""Profiles for which losses of BLAST-Lite 1.1.1 were computed once: ``data/blast_lite_losses.csv``.

Its losses are those of its own simulation, which averages over days and deepens cycles as capacity fades.
``hourly_calendar_loss`` is what the same model makes of the same series hour by
hour, and ``given_cyclic_loss`` by day, both without that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Array = Any
YEARS = 8
STEP_S = 900.0
STEPS_A_DAY = 96

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
