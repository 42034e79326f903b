"""The newest value of each signal with its age: what arrives at 1 to 100 Hz, seen at one instant."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from iptm_vehicle_interface.vehicle import SignalSource


class SignalTable:
    """Values and times of arrival; a value older than its timeout is NaN."""

    def __init__(self, sources: Mapping[str, SignalSource]) -> None:
        self._timeouts_s = {name: source.timeout_s for name, source in sources.items()}
        self._values: dict[str, tuple[float, float]] = {}

    def take(self, values: Mapping[str, float], time_s: float) -> None:
        """Take values that arrived at one time, which is not decreasing."""
        for name, value in values.items():
            self._values[name] = value, time_s

    def age_s(self, name: str, now_s: float) -> float:
        """Return the age of a signal, infinite where it never arrived."""
        entry = self._values.get(name)
        return math.inf if entry is None else now_s - entry[1]

    def value(self, name: str, now_s: float) -> float:
        """Return a signal, NaN where it is stale, never arrived or is not offered."""
        entry = self._values.get(name)
        if entry is None or now_s - entry[1] > self._timeouts_s[name]:
            return math.nan
        return entry[0]

    def is_set(self, name: str, now_s: float) -> bool:
        """Return whether a fresh flag is 1; an unknown one is not set."""
        return self.value(name, now_s) >= 0.5

    def stale(self, names: Iterable[str], now_s: float) -> tuple[str, ...]:
        """Return which of several signals are offered by the vehicle and not fresh."""
        return tuple(
            name
            for name in names
            if name in self._timeouts_s and math.isnan(self.value(name, now_s))
        )


MISSING_CHANGE_M = 0.3
"""Change of the gap by the measured relative speed that is missing when a sensor counts as frozen."""
LEAST_REPEATS = 2
"""Noise makes up for the change between two measurements now and then."""
LONGEST_SAME_S = 2.0
"""Longer than this no gap in motion is measured the same, noise and resolution included."""
MOVING_M_S = 2.0


class RangeWatch:
    """Notices a range sensor that repeats itself with sound counters."""

    def __init__(self) -> None:
        self._measured: tuple[float, float] | None = None
        self._arrivals_s: list[float] = []

    def is_frozen(self, gap_m: float, relative_m_s: float, speed_m_s: float, now_s: float) -> bool:
        """Return whether the sensor repeats a measurement that must have changed; NaN for no target.

        Args:
            now_s: when the measurement arrived: one that is lost is none that is repeated.
        """
        if (gap_m, relative_m_s) != self._measured or not speed_m_s >= MOVING_M_S:
            self._measured, self._arrivals_s = (gap_m, relative_m_s), [now_s]
            return False
        if now_s > self._arrivals_s[-1] + 1e-3:  # ages are differences of large numbers
            self._arrivals_s.append(now_s)
        unchanged_s = now_s - self._arrivals_s[0]
        if len(self._arrivals_s) <= LEAST_REPEATS:
            return False
        return unchanged_s > LONGEST_SAME_S or abs(relative_m_s) * unchanged_s > MISSING_CHANGE_M
