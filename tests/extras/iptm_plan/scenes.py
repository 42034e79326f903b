"""A car, a law with numbers for the hand, and short schedules."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from iptm_core.aging_laws.cells import NCA
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.parameters import load_parameters
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_plan.pack import AgingPrice, ParkedPack
from iptm_plan.schedule import Departure, Schedule, trip_of

CAR = load_parameters().values
PACK = ParkedPack(CAR, has_fan=True)
USE = AgingSettings(aging_law="nca", parking_air_k=CELSIUS_ZERO_K + 25.0)
PRICE = AgingPrice.of(NCA.law, USE, CAR)
CHARGER_W = 7400.0


def pack_with_heater(watt: float, **overrides: float) -> ParkedPack:
    """Return a pack of a car with a heater."""
    changes = {"limits.max_heater_power_w": watt, **overrides}
    return ParkedPack(load_parameters(overrides=changes).values, has_fan=True)


def hours(count: float, step_s: float = 900.0) -> NDArray[np.float64]:
    """Return the hours at the beginning of steps."""
    return np.arange(round(3600.0 * count / step_s)) * step_s / 3600.0


def trip(kwh: float = 4.0, minutes: float = 30.0) -> Any:
    """Return a trip."""
    return trip_of(kwh * J_PER_KWH, 60.0 * minutes, CAR)


def schedule(
    count: float = 48.0, celsius: float = 25.0, eur_kwh: Any = 0.25, **more: Any
) -> Schedule:
    """Return a schedule of constant air, with a departure at 12 and 36 h unless others are given."""
    step_s = more.pop("step_s", 900.0)
    steps = hours(count, step_s)
    departures = more.pop("departures", None)
    if departures is None:
        home = {"charger_w": CHARGER_W}
        departures = tuple(
            Departure(round(at * 3600.0 / step_s), trip(), **home) for at in (12.0, 36.0)
        )
    return Schedule(
        np.full(steps.size, celsius + CELSIUS_ZERO_K),
        np.broadcast_to(eur_kwh, steps.shape).astype(float),
        more.pop("charger_w", CHARGER_W),
        departures,
        step_s=step_s,
        **more,
    )
