"""A prediction by linear regression on what the leader did in the last seconds.

The expected change of speed up to some lead times is linear in features of the past speeds; the bound of
the position is a table over speed and acceleration. Both come from drives (`scripts/iptm train`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import RouteError
from iptm_core.state import FloatArray, LeaderPreview
from iptm_v2x_bridge.prediction.expected_motion import History, unheard_braking_m
from iptm_v2x_bridge.prediction.predictor import LeaderTrack, PredictorName

PAST_S = 10
"""Seconds of the past that count."""
SPEED_NODES_M_S = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 36.0)
"""Level and effect of the acceleration are linear in the speed between these."""

NEAR_S, NEAR_FACTOR = 2.0, 1.5
"""Up to here the leader may be as far behind as with a decaying acceleration and its bound by this factor,
whatever is expected: s_min depends on it at every tick, and other drivers brake harder than the ones of the
training drives."""

GAIN_FACTOR = 1.5
"""Behind `NEAR_S` expected gains of speed count by this factor. A plan for too slow a leader costs more than
one for too fast a leader: lost ground is caught up at high power, while a gap that closes is coasted away.
Chosen on four of the training drives: the largest of 1, 1.5, 1.7 and 2 at which none of them takes more
energy than with a range sensor only. The bounds grow by the same distance, so the motion that they allow for
is still as in the drives."""


def linear_weights(values: FloatArray, nodes: Sequence[float]) -> FloatArray:
    """Return the weights of the nodes in a linear interpolation, constant outside; shape (n, nodes)."""
    return np.column_stack([np.interp(values, nodes, row) for row in np.eye(len(nodes))])


def regression_features(past_speeds_m_s: FloatArray) -> FloatArray:
    """Return the features of the regression, shape (n, features).

    Weights of the speed at its nodes; these times the acceleration of the last second, where it is negative
    and where it is positive; the changes of speed in each second of the past.

    Args:
        past_speeds_m_s: speeds now and 1 to `PAST_S` seconds ago, shape (n, `PAST_S` + 1).
    """
    changes = past_speeds_m_s[:, :-1] - past_speeds_m_s[:, 1:]
    level = linear_weights(past_speeds_m_s[:, 0], SPEED_NODES_M_S)
    acceleration = changes[:, :1]
    return np.hstack(
        [
            level,
            level * np.minimum(acceleration, 0.0),
            level * np.maximum(acceleration, 0.0),
            changes,
        ]
    )


FEATURES = 3 * len(SPEED_NODES_M_S) + PAST_S


def bound_weights(
    past_speeds_m_s: FloatArray, speeds_m_s: Sequence[float], accelerations_m_s2: Sequence[float]
) -> FloatArray:
    """Return the weights of the bounds at the nodes, shape (n, speeds times accelerations).

    Args:
        past_speeds_m_s: see `regression_features`; the speed now and the change in the last second count.
        speeds_m_s: nodes of the speed.
        accelerations_m_s2: nodes of the acceleration, which vary faster.
    """
    speed = past_speeds_m_s[:, 0]
    of_speed = linear_weights(speed, speeds_m_s)
    of_change = linear_weights(speed - past_speeds_m_s[:, 1], accelerations_m_s2)
    weights: FloatArray = (of_speed[:, :, None] * of_change[:, None]).reshape(speed.size, -1)
    return weights


@dataclass(frozen=True)
class RegressionModel:
    """Coefficients, and where they come from.

    Attributes:
        trained_on: source and licence of the drives.
        drives: names of the drives.
        leads_s: times since the observation, increasing, above 0.
        coefficients: change of speed in m/s for each lead time and feature, shape (leads, features).
        bound_speeds_m_s: nodes of the speed, increasing.
        bound_accelerations_m_s2: nodes of the acceleration, increasing.
        bounds_m: 99 % bounds for each lead time and node, shape (leads, speeds times accelerations).

    Raises:
        RouteError: lengths do not fit, nodes do not increase, or a value is not finite.
    """

    trained_on: str
    drives: tuple[str, ...]
    leads_s: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]
    bound_speeds_m_s: tuple[float, ...]
    bound_accelerations_m_s2: tuple[float, ...]
    bounds_m: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        leads, nodes = (
            len(self.leads_s),
            len(self.bound_speeds_m_s) * len(self.bound_accelerations_m_s2),
        )
        increasing = (
            (0.0, *self.leads_s),
            self.bound_speeds_m_s,
            self.bound_accelerations_m_s2,
        )
        fits = leads >= 2 and nodes > 0 and all(np.all(np.diff(axis) > 0.0) for axis in increasing)
        for rows, width in ((self.coefficients, FEATURES), (self.bounds_m, nodes)):
            fits &= len(rows) == leads and all(len(row) == width for row in rows)
            fits = fits and bool(np.isfinite(rows).all())
        if not fits:
            raise RouteError(
                f"regression has {leads} lead times; allowed: at least 2, increasing from above 0, with "
                f"{FEATURES} finite coefficients and a bound for each node of speed and acceleration"
            )

    def at_leads(self, past_speeds_m_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return speeds, distances driven and bounds at lead time 0 and `leads_s`, shape (n, leads + 1) each.

        Args:
            past_speeds_m_s: see `regression_features`.
        """
        speed = past_speeds_m_s[:, :1]
        changes = regression_features(past_speeds_m_s) @ np.transpose(self.coefficients)
        speeds = np.hstack([speed, np.maximum(speed + changes, 0.0)])
        steps = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * np.diff(self.leads_s, prepend=0.0)
        driven = np.cumsum(np.hstack([np.zeros_like(speed), steps]), axis=1)
        weights = bound_weights(
            past_speeds_m_s, self.bound_speeds_m_s, self.bound_accelerations_m_s2
        )
        bounds = np.maximum.accumulate(weights @ np.transpose(self.bounds_m), axis=1)
        # A leader that never drives backwards falls behind by at most what it was expected to drive.
        bounds = np.clip(np.hstack([np.zeros_like(speed), bounds]), 0.0, driven)
        return speeds, driven, np.maximum.accumulate(bounds, axis=1)

    def as_json(self) -> str:
        """Return the model as text, for `from_json`."""
        return json.dumps(asdict(self), indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str) -> RegressionModel:
        """Read a model.

        Raises:
            RouteError: the text is not a model.
        """
        try:
            read = json.loads(text)
            values = {entry.name: read[entry.name] for entry in fields(cls)}
            values = {name: _tuples(value) for name, value in values.items()}
            model = cls(**values)
        except (ValueError, KeyError, TypeError) as reason:
            raise RouteError(f"regression cannot be read: {reason!r}") from reason
        return model

    @classmethod
    def load(cls, path: str = "") -> RegressionModel:
        """Read the model of a file, the shipped one for an empty path.

        Raises:
            RouteError: the file cannot be read, or is not a model.
        """
        try:
            file = Path(path) if path else files("iptm_v2x_bridge.prediction") / "regression.json"
            text = file.read_text(encoding="utf-8")
        except (OSError, ValueError) as reason:
            raise RouteError(f"regression_model {path!r} cannot be read: {reason}") from reason
        return cls.from_json(text)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


class Regression:
    """Expects of the leader what others did after the same seconds."""

    name = PredictorName.REGRESSION

    def __init__(self, model: RegressionModel, gain_factor: float = GAIN_FACTOR) -> None:
        """Use a model.

        Args:
            gain_factor: see `GAIN_FACTOR`; 1 expects what the drives did.
        """
        self._model, self._gain_factor = model, gain_factor

    def predict(self, track: LeaderTrack, times_s: FloatArray) -> LeaderPreview:
        """Return the motion at all times asked for; behind the last lead time it keeps its speed."""
        last = track.last
        past = np.interp(
            last.time_s - np.arange(PAST_S + 1.0),
            [seen.time_s for seen in track.observations],
            [seen.speed_m_s for seen in track.observations],
        )
        speeds, driven, bounds = (table[0] for table in self._model.at_leads(past[None]))
        leads = np.array([0.0, *self._model.leads_s])
        gains = np.where(leads > NEAR_S, np.maximum(speeds - speeds[0], 0.0), 0.0)
        extra = (self._gain_factor - 1.0) * gains
        speeds = speeds + extra
        farther = np.cumsum(0.5 * (extra + np.roll(extra, 1)) * np.diff(leads, prepend=0.0))
        driven, bounds = driven + farther, bounds + farther
        elapsed = np.maximum(times_s - last.time_s, 0.0)
        inside = np.minimum(elapsed, leads[-1])
        index = np.clip(np.searchsorted(leads, inside, side="right") - 1, 0, leads.size - 2)
        since = inside - leads[index]
        slopes = np.diff(speeds) / np.diff(leads)
        moved = driven[index] + since * (speeds[index] + 0.5 * slopes[index] * since)
        beyond = elapsed - inside
        moved += speeds[-1] * beyond
        rate = (bounds[-1] - bounds[-2]) / (leads[-1] - leads[-2])
        learnt = np.interp(inside, leads, bounds) + rate * beyond
        decaying = History().predict(replace(track, age_s=0.0), times_s)
        lowest_m = decaying.positions_m - NEAR_FACTOR * (decaying.bounds_m - last.bound_m)
        behind = last.position_m + moved - lowest_m
        near = np.maximum.accumulate(np.where(elapsed <= NEAR_S, behind, 0.0))
        expected = np.interp(inside, leads, speeds)
        bounds = np.maximum(np.maximum(learnt, near), unheard_braking_m(track, elapsed, expected))
        return LeaderPreview(
            times_s,
            last.position_m + moved,
            expected,
            np.minimum(bounds, moved) + last.bound_m,
        )
