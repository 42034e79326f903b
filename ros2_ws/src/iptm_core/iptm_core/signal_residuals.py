"""Residuals between signals that arrive anyway: a gap and its rate, a speed and its acceleration.

Each pair is redundant: the gap changes by the integral of the relative speed, the speed by that of the
acceleration. What the integral leaves unexplained is summed up and forgotten slowly; noise cancels, a wrong
scale, sign or value does not. Which signal of a pair is wrong, a residual does not show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

RANGE_TIME_S, RANGE_LIMIT_M = 3.0, 1.2
"""Time in which an unexplained change of the gap is forgotten, and the residual from which on it counts."""
SPEED_TIME_S, SPEED_LIMIT_M_S = 4.0, 1.0
"""The same of the own speed: slopes and offsets of an accelerometer stay below."""
NOISE_LIMIT = 2.5
"""Mean differences of successive unexplained changes that are added to a limit. Noise of independent
measurements stays below: of a standard deviation of 1, they have a mean of 2."""
JUMP_M = 3.0
"""A gap that changes by more than this beyond its rate is the gap to another vehicle."""
HELD_BELOW_M_S = 1.0
"""Below this speed brakes and road hold a vehicle, whatever its acceleration."""
LONGEST_INTERVAL_S = 0.5
"""Measurements farther apart are not compared."""


class Contradiction(Enum):
    """Signals that do not fit together."""

    RANGE = "gap and relative speed contradict each other"
    SPEED = "speed and acceleration contradict each other"


@dataclass(frozen=True)
class Residual:
    """Unexplained residuals of the last measurements.

    Attributes:
        value: sum of unexplained changes, older ones forgotten.
        noise: mean difference of successive ones.
        last: the newest one.
    """

    value: float = 0.0
    noise: float = 0.0
    last: float = 0.0

    def after(self, unexplained: float, interval_s: float, time_s: float) -> Residual:
        """Return the residual after one more change.

        Args:
            unexplained: see `unexplained_change`.
            interval_s: between the two measurements.
            time_s: in which changes are forgotten.
        """
        share = min(interval_s / time_s, 1.0)
        return Residual(*after(self.value, self.noise, self.last, unexplained, share))

    def beyond(self, limit: float) -> float:
        """Return by how much the residual exceeds a limit and its noise, with its sign; 0 within."""
        excess = abs(self.value) - limit - NOISE_LIMIT * self.noise
        return math.copysign(excess, self.value) if excess > 0.0 else 0.0


def after(
    value: float, noise: float, last: float, unexplained: float, share: float
) -> tuple[float, float, float]:
    """Return the numbers of a `Residual` after one more change, of which a share is forgotten at once."""
    return (
        (value + unexplained) * (1.0 - share),
        noise + share * (abs(unexplained - last) - noise),
        unexplained,
    )


def unexplained_change(change: float, rate: float, later_rate: float, interval_s: float) -> float:
    """Return the part of a change that no course of its rate between two measured values explains.

    Args:
        change: of the signal.
        rate: measured at its beginning.
        later_rate: measured at its end.
        interval_s: between the two.
    """
    farther = change - 0.5 * (rate + later_rate) * interval_s
    excess = abs(farther) - 0.5 * abs(later_rate - rate) * interval_s
    return math.copysign(excess, farther) if excess > 0.0 else 0.0


class SignalWatch:
    """Follows both pairs of signals of a vehicle; measurements in increasing order of time."""

    def __init__(self) -> None:
        self._range, self._speed = Residual(), Residual()
        self._last_gap: tuple[float, float, float] | None = None
        self._last_speed: tuple[float, float, float] | None = None

    def see_gap(self, time_s: float, gap_m: float, relative_speed_m_s: float) -> None:
        """Take a measurement of the vehicle ahead; a gap that is not finite stands for no vehicle."""
        last, now = self._last_gap, (time_s, gap_m, relative_speed_m_s)
        self._last_gap = now if all(map(math.isfinite, now)) else None
        if last is None or self._last_gap is None:
            self._range = Residual()
            return
        interval_s = time_s - last[0]
        changed_m = unexplained_change(gap_m - last[1], last[2], relative_speed_m_s, interval_s)
        comparable = 0.0 < interval_s <= LONGEST_INTERVAL_S and abs(changed_m) <= JUMP_M
        self._range = (
            self._range.after(changed_m, interval_s, RANGE_TIME_S) if comparable else Residual()
        )

    def see_speed(self, time_s: float, speed_m_s: float, acceleration_m_s2: float) -> None:
        """Take a measurement of the own motion."""
        last, now = self._last_speed, (time_s, speed_m_s, acceleration_m_s2)
        self._last_speed = now if all(map(math.isfinite, now)) else None
        if last is None or self._last_speed is None or speed_m_s < HELD_BELOW_M_S:
            self._speed = Residual()
            return
        interval_s = time_s - last[0]
        if not 0.0 < interval_s <= LONGEST_INTERVAL_S:
            self._speed = Residual()
            return
        changed_m_s = unexplained_change(
            speed_m_s - last[1], last[2], acceleration_m_s2, interval_s
        )
        self._speed = self._speed.after(changed_m_s, interval_s, SPEED_TIME_S)

    @property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """What does not fit together now."""
        found = []
        if self._range.beyond(RANGE_LIMIT_M):
            found.append(Contradiction.RANGE)
        if self._speed.beyond(SPEED_LIMIT_M_S):
            found.append(Contradiction.SPEED)
        return tuple(found)
