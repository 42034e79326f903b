"""Motion of a leader that follows a vehicle which is measured, too: a law of car following and its spread.

The expected change of speed up to some lead times is linear in what a car follower responds to: speeds and
their changes, the relative speed, and how far the gap is from the one that its driver or cruise control
keeps, whose time gap is identified from the last seconds, within bounds. Law and spread are fitted to the
platoons of OpenACC (``scripts/study chain``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from iptm_core.state import FloatArray

PAST_S = 10
"""Seconds of the past that count."""
LAGS_S = np.array([1, 2, 3, 5])
STANDSTILL_GAP_M = 2.0
USUAL_TIME_GAP_S, USUAL_WEIGHT_M2_S2 = 1.5, 200.0
"""Expected before any measurement, with the weight of two seconds at 10 m/s."""
TIME_GAPS_S = (0.5, 4.0)
STEADY_M_S = 0.5
"""Relative speed at which a measured gap counts half in the identified time gap."""
LAW_FEATURES = 25
_OF_SPREAD = np.array([0, 2, 1, 4, 8, 17, 21])
LARGEST_ERROR_M, LARGEST_RELATIVE_M_S = 15.0, 8.0
"""Farther from its gap a follower does not respond more: it drives freely."""


class Past(NamedTuple):
    """Leader and the vehicle ahead of it, now and 1 to `PAST_S` seconds ago, shape (n, `PAST_S` + 1) each.

    Attributes:
        speed_m_s: of the leader.
        ahead_m_s: speed of the vehicle ahead of it.
        gap_m: between both, from bumper to bumper.
        weight: 1 where it was measured, 0 where older values stand for it.
    """

    speed_m_s: FloatArray
    ahead_m_s: FloatArray
    gap_m: FloatArray
    weight: FloatArray


def time_gap_s(past: Past) -> FloatArray:
    """Return the time gap that the leader keeps, shape (n,), by least squares within `TIME_GAPS_S`."""
    v = past.speed_m_s
    weight = past.weight * v / (1.0 + ((past.ahead_m_s - v) / STEADY_M_S) ** 2)
    kept = (weight * (past.gap_m - STANDSTILL_GAP_M)).sum(axis=1)
    kept += USUAL_TIME_GAP_S * USUAL_WEIGHT_M2_S2
    gaps_s = kept / ((weight * v).sum(axis=1) + USUAL_WEIGHT_M2_S2)
    bounded: FloatArray = np.minimum(np.maximum(gaps_s, TIME_GAPS_S[0]), TIME_GAPS_S[1])
    return bounded


def following_features(past: Past) -> tuple[FloatArray, FloatArray]:
    """Return what the change of speed is linear in, and what its spread is, shape (n, ...) each."""
    v, u, gap_s = past.speed_m_s[:, 0], past.ahead_m_s[:, 0], time_gap_s(past)
    own = v[:, None] - past.speed_m_s.take(LAGS_S, axis=1)
    ahead = u[:, None] - past.ahead_m_s.take(LAGS_S, axis=1)
    relative = np.minimum(np.maximum(u - v, -LARGEST_RELATIVE_M_S), LARGEST_RELATIVE_M_S)
    error = past.gap_m[:, 0] - STANDSTILL_GAP_M - gap_s * v
    error = np.minimum(np.maximum(error, -LARGEST_ERROR_M), LARGEST_ERROR_M)
    law: FloatArray = np.empty((v.size, LAW_FEATURES))
    law[:, 0], law[:, 1] = 1.0, v
    law[:, 2], law[:, 3] = np.minimum(v, 5.0), np.minimum(v, 12.0)
    law[:, 4:8], law[:, 8:12] = own, ahead
    law[:, 12], law[:, 13] = np.minimum(own[:, 0], 0.0), own[:, 0] * v / 15.0
    law[:, 14], law[:, 15] = np.minimum(ahead[:, 0], 0.0), ahead[:, 0] * u / 15.0
    law[:, 16] = ahead[:, 0] / gap_s
    law[:, 17], law[:, 18] = relative, np.minimum(relative, 0.0)
    law[:, 19], law[:, 20] = relative * v / 15.0, relative / gap_s
    law[:, 21], law[:, 22] = error, np.minimum(error, 0.0)
    law[:, 23], law[:, 24] = error * np.minimum(v, 10.0) / 10.0, error / gap_s
    return law, np.abs(law.take(_OF_SPREAD, axis=1))


class FollowingMotion(NamedTuple):
    """Expected motion at lead time 0 and the lead times of the law, shape (n, leads + 1) each.

    Attributes:
        speeds_m_s: expected speeds.
        driven_m: expected distances driven.
        spread_m: scale of the error of the distance, of which the bounds are multiples.
    """

    speeds_m_s: FloatArray
    driven_m: FloatArray
    spread_m: FloatArray


@dataclass(frozen=True, eq=False)
class FollowingLaw:
    """Coefficients of the law, and where they come from.

    Attributes:
        fitted_to: source and licence of the data, and the runs that were used.
        leads_s: lead times, increasing, above 0, shape (leads,).
        law: change of speed for each feature, shape (features, leads).
        spread: mean size of the error of the distance for each feature of the spread, shape (..., leads).
        half_90: multiple of the spread that the error stays within in 90 of 100 cases, shape (leads + 1,).
        behind_99: multiple by which the leader is behind in 1 of 100 cases at most, shape (leads + 1,).
    """

    fitted_to: str
    leads_s: FloatArray
    law: FloatArray
    spread: FloatArray
    half_90: FloatArray
    behind_99: FloatArray

    def motion(self, past: Past) -> FollowingMotion:
        """Return the motion that the law expects."""
        features, of_spread = following_features(past)
        v = past.speed_m_s[:, :1]
        speeds = np.concatenate([v, np.maximum(v + features @ self.law, 0.0)], axis=1)
        widths = self.leads_s.copy()
        widths[1:] -= self.leads_s[:-1]
        driven = np.zeros_like(speeds)
        np.cumsum(0.5 * (speeds[:, 1:] + speeds[:, :-1]) * widths, axis=1, out=driven[:, 1:])
        spread = np.zeros_like(speeds)
        np.maximum.accumulate(of_spread @ self.spread, axis=1, out=spread[:, 1:])
        return FollowingMotion(speeds, driven, spread)

    def as_json(self) -> str:
        """Return the law as text, for `from_json`."""
        return json.dumps(vars(self), indent=1, default=_rounded) + "\n"

    @classmethod
    def from_json(cls, text: str) -> FollowingLaw:
        """Read a law that `as_json` wrote."""
        read = json.loads(text)
        fitted_to = read.pop("fitted_to")
        return cls(fitted_to, **{name: np.array(value) for name, value in read.items()})


def _rounded(value: FloatArray) -> Any:
    return np.round(value, 6).tolist()


@cache
def shipped_law() -> FollowingLaw:
    """Return the law of this package."""
    return FollowingLaw.from_json((files("iptm_its") / "car_following.json").read_text("utf-8"))
