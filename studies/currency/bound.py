"""How far the strategy `prices` is from the optimum of the whole trip in the same currency."""

from __future__ import annotations

from typing import Any

import numpy as np
from studies.whole_trip import drive_whole_trip

import iptm
from iptm_controller.ocp.stages import NEARLY_DESIRED_M
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.physics.car_following import desired_gap_m
from iptm_core.units import SECONDS_PER_HOUR


def costs(
    cycle: str, production: dict[str, Any], priced: dict[str, Any], unseen: dict[str, Any]
) -> dict[str, Any]:
    """Return the cost of a trip in EUR per 100 km by control, that of headway included.

    Args:
        cycle: its name.
        production: arguments of the trip of the car of today.
        priced: of the strategy with a preview.
        unseen: of the strategy without one.
    """
    base = iptm.simulate(**production)
    whole, record = drive_whole_trip(iptm.Trip.of(**priced).checked())
    runs = {"production": base, "prices": iptm.simulate(**priced), "none": iptm.simulate(**unseen)}
    found: dict[str, Any] = {"cycle": cycle}
    found |= {name: _eur(run, base.aging_use, whole) for name, run in runs.items()}
    found["whole"] = _eur(whole, base.aging_use, whole) if record["settled"] else np.nan
    for name in ("prices", "none"):
        saved, most = (found["production"] - found[each] for each in (name, "whole"))
        found[f"{name}_reached"] = 100.0 * saved / most
    return found


def _eur(run: iptm.Run, use: AgingSettings, desired: iptm.Run) -> float:
    """Return energy, capacity and headway other than the one desired, in EUR per 100 km."""
    driven = run.trajectory
    error = driven.gap_m - desired_gap_m(driven.speed_m_s, desired.parameters.gap)
    error = error[1:] / NEARLY_DESIRED_M
    squared_m2 = 2.0 * NEARLY_DESIRED_M**2 * (np.sqrt(1.0 + error * error) - 1.0)
    hours = driven.intervals_s / SECONDS_PER_HOUR
    headway_eur = float(np.dot(squared_m2, hours)) * use.headway_eur_m2_h
    return run.cost(use).eur + headway_eur * 1e5 / run.metrics.distance_m
