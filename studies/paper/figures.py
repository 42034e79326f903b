"""What is kept of a run: its figures, those that only statements of the paper need, and columns for plots."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from studies.whole_trip import drive_whole_trip

import iptm

CELSIUS_ZERO_K = 273.15
LOW_PERCENTILE, HIGH_PERCENTILE = 50, 90
"""Up to the one, power counts as low, from the other on as high; the paper draws regions without values."""
DEMAND_S = 800.0
"""Length of the stretch of high demand: the text has it between 2000 and 2800 s of its own trip."""
FALL_SHARE = 0.63
SETTLED_SHARE = 0.75
"""Last part of a trip over which a temperature counts as settled."""
COLUMNS = (
    "position_m",
    "speed_m_s",
    "acceleration_m_s2",
    "compressor_power_w",
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
    "traction_power_w",
    "auxiliary_power_w",
    "battery_power_w",
    "chiller_heat_w",
    "leader_speed_m_s",
    "gap_m",
)
PRINTED_PPM = {
    **dict.fromkeys(("cell_1_degradation", "cell_n_degradation", "total_degradation"), 10.0),
    "inconsistency": 0.1,
}
"""Units in which the paper prints capacity losses, in ppm: 1e-5 and 1e-7."""


def drive(*, whole_trip: bool = False, **settings: Any) -> dict[str, Any]:
    """Drive a trip, or solve it as one problem.

    Returns:
        Its figures by key, and the columns that tables and plots are made of.
    """
    trip = iptm.Trip.of(**settings)
    run = drive_whole_trip(trip)[0] if whole_trip else iptm.drive(trip)
    frame = run.frame[list(COLUMNS)]
    printed = {key: run.figures[key] / unit for key, unit in PRINTED_PPM.items()}
    return {"figures": {**run.figures, **printed, **trip_figures(frame)}, "frame": frame}


def mean_cell_c(frame: pd.DataFrame) -> pd.Series:
    """Mean temperature of cells 1 and N in degC at every row."""
    return 0.5 * (frame.cell_1_temperature_k + frame.cell_n_temperature_k) - CELSIUS_ZERO_K


def trip_figures(frame: pd.DataFrame) -> dict[str, float]:
    """What statements need beyond the figures of a run; row 0 ends no interval and has no powers."""
    driven, mean_c = frame.iloc[1:], mean_cell_c(frame)
    traction, compressor = driven.traction_power_w, driven.compressor_power_w
    low, high = np.percentile(traction, [LOW_PERCENTILE, HIGH_PERCENTILE])
    settled = frame.iloc[int((1.0 - SETTLED_SHARE) * len(frame)) :]
    start, end = busiest_stretch(frame)
    other = compressor.mean() + driven.auxiliary_power_w.mean()
    return {
        "power_p99": 1e-3 * float(np.percentile(driven.battery_power_w, 99)),
        "traction_over_cooling": float(traction.abs().mean() / other),
        "compressor_at_high_traction": float(compressor[traction > high].mean()),
        "compressor_at_low_traction": float(compressor[traction <= low].mean()),
        "compressor_while_braking": float(compressor[traction < 0.0].mean()),
        "braking_share": float(compressor[traction < 0.0].sum() / max(compressor.sum(), 1e-9)),
        "start_temperature": float(mean_c.iloc[0]),
        "settled_temperature": float(mean_cell_c(settled).mean()),
        "cell_1_fall_time": _fall_time_s(frame.cell_1_temperature_k),
        "cell_n_fall_time": _fall_time_s(frame.cell_n_temperature_k),
        "demand_start": float(frame.index[start]),
        "drop_before_demand": float(mean_c.iloc[0] - mean_c.iloc[start]),
        "rise_in_demand": float(mean_c.iloc[start : end + 1].max() - mean_c.iloc[start]),
    }


def busiest_stretch(frame: pd.DataFrame) -> tuple[int, int]:
    """First and last row of the `DEMAND_S` with the most traction energy; of a shorter trip, its own."""
    times_s = frame.index.to_numpy()
    drawn = np.maximum(frame.traction_power_w.to_numpy()[1:], 0.0) * np.diff(times_s)
    energy = np.concatenate([[0.0], np.cumsum(drawn)])
    ends = np.searchsorted(times_s, times_s + DEMAND_S - 1e-9)
    inside = ends < len(frame)
    if not inside.any():
        return 0, len(frame) - 1
    start = int(np.argmax(energy[ends[inside]] - energy[np.flatnonzero(inside)]))
    return start, int(ends[start])


def _fall_time_s(temperature_k: pd.Series) -> float:
    """Time until a temperature has fallen by `FALL_SHARE` of the way to its lowest value."""
    first = float(temperature_k.iloc[0])
    target = first - FALL_SHARE * (first - float(temperature_k.min()))
    return float(temperature_k.index[int(np.argmax(temperature_k.to_numpy() <= target))])


def power_bounds_kw(frame: pd.DataFrame) -> tuple[float, float]:
    """Bounds of low and high power: percentiles of the battery power of a trip, the reference's."""
    low, high = np.percentile(
        1e-3 * frame.battery_power_w.iloc[1:], [LOW_PERCENTILE, HIGH_PERCENTILE]
    )
    return float(low), float(high)


def power_shares(frame: pd.DataFrame, bounds_kw: tuple[float, float]) -> dict[str, float]:
    """Percentages of the time at low and at high power; all ticks are of one length."""
    power = 1e-3 * frame.battery_power_w.iloc[1:]
    low, high = bounds_kw
    return {
        "low_power_share": 100.0 * float((power <= low).mean()),
        "high_power_share": 100.0 * float((power >= high).mean()),
    }
