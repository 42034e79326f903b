"""Messages for the tests of the receiver."""

from __future__ import annotations

from typing import Any

import numpy as np

from iptm_v2x_bridge.messages.cam import CamMessage, PredictedPath


def cam(**changes: Any) -> CamMessage:
    """A car driving north at 20 m/s."""
    usual: dict[str, Any] = {
        "station_id": 4711,
        "delta_time_ms": 12_345,
        "latitude_deg": 48.1234567,
        "longitude_deg": 10.7654321,
        "heading_deg": 0.0,
        "speed_m_s": 20.0,
        "acceleration_m_s2": -0.5,
        "length_m": 4.5,
        "width_m": 1.8,
        "altitude_m": 512.3,
        "position_bound_m": 0.05,
        "lane": 1,
    }
    return CamMessage(**{**usual, **changes})


def path(points: int = 40, step_s: float = 1.5, speed_m_s: float = 20.0) -> PredictedPath:
    """A path that leads north at constant speed from where `cam` is."""
    times = step_s * np.arange(1, points + 1)
    return PredictedPath(
        times_s=np.round(times, 1),
        latitudes_deg=np.round(48.1234567 + speed_m_s * times / 111_195.0, 7),
        longitudes_deg=np.full(points, 10.7654321),
        confidence=0.8,
    )
