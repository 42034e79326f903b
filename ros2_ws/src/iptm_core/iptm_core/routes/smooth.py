"""The smooth driving cycle: slow ramps between 60 and 120 km/h."""

from __future__ import annotations

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.routes.cycles import DrivingCycle

LOW_SPEED_M_S = 60.0 / 3.6
HIGH_SPEED_M_S = 120.0 / 3.6
RAMP_TIME_S = 90.0
"""Duration of the ramp from standstill and of the one back to it."""

_WAVE_TIME_S = 240.0
_MIN_DURATION_S = 360


def smooth_cycle(duration_s: int) -> DrivingCycle:
    """Build the smooth cycle.

    Cosine ramps lead from standstill to 60 km/h and back (peak 0.29 m/s^2); between them speed
    swings as a cosine between 60 and 120 km/h, in whole periods of about four minutes.

    Args:
        duration_s: whole seconds, at least 360; below 0.3 m/s^2 throughout for all of them.

    Returns:
        The cycle, standing at its first and last sample.

    Raises:
        RouteError: the duration is not a whole number of seconds or too short.
    """
    if int(duration_s) != duration_s or duration_s < _MIN_DURATION_S:
        raise RouteError(
            f"smooth cycle of {duration_s} s; allowed: whole seconds, at least {_MIN_DURATION_S}"
        )
    times = np.arange(int(duration_s) + 1, dtype=np.float64)
    cruise = duration_s - 2.0 * RAMP_TIME_S
    period = cruise / max(1, round(cruise / _WAVE_TIME_S))
    swing = 0.5 * (HIGH_SPEED_M_S - LOW_SPEED_M_S)
    waves = LOW_SPEED_M_S + swing * (1.0 - np.cos(2.0 * np.pi * (times - RAMP_TIME_S) / period))
    to_end = np.minimum(times, duration_s - times)
    ramp = 0.5 * LOW_SPEED_M_S * (1.0 - np.cos(np.pi * to_end / RAMP_TIME_S))
    speeds = np.where(to_end < RAMP_TIME_S, ramp, waves)
    return DrivingCycle(
        "smooth", times, speeds, "made for this project: slow ramps between 60 and 120 km/h"
    )
