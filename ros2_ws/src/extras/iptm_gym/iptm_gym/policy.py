"""A policy as a small network: from observations of a trip to a command, with NumPy alone.

    (a / a_max, P / P_max) = tanh(D x + W_2 tanh(W_1 x)),   P >= 0

x are the features (`features`) and a 1. D alone is a linear law of car following with proportional cooling;
the network is learned on top of it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm_controller.measurements import Measurements
from iptm_core.errors import ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.state import Command, FloatArray
from iptm_core.units import CELSIUS_ZERO_K
from iptm_core.user_input import StrictMapping
from iptm_gym.observation import ACTIONS, OBSERVED, PREVIEW_S, observation

HIDDEN = 12
LARGEST = (2.0, 8000.0)
"""Largest magnitudes of the actions: m/s^2 and W; the limits of the vehicle hold in any case."""
GAP_M, HEADWAY_S, SPEED_M_S, WARM_C, WARM_K = 7.0, 1.8, 5.0, 28.0, 10.0
"""The gap counts relative to ``GAP_M + HEADWAY_S v``, speeds to the one of the lead vehicle."""
FEATURES = 8 + len(PREVIEW_S)
_AT = {name: number for number, name in enumerate(OBSERVED)}


@dataclass(frozen=True, eq=False)
class LearnedPolicy:
    """A policy.

    Attributes:
        direct: D, shape (2, FEATURES).
        inner: W_1, shape (HIDDEN, FEATURES).
        outer: W_2, shape (2, HIDDEN).
    """

    direct: FloatArray
    inner: FloatArray
    outer: FloatArray

    @classmethod
    def first(cls, seed: int) -> LearnedPolicy:
        """Return the policy before it has learned: the linear law."""
        direct = np.zeros((len(ACTIONS), FEATURES))
        direct[0, :2] = 0.8, 1.2
        direct[1, 4] = 0.5
        inner = np.random.default_rng(seed).normal(0.0, FEATURES**-0.5, (HIDDEN, FEATURES))
        return cls(direct, inner, np.zeros((len(ACTIONS), HIDDEN)))

    @classmethod
    def of(cls, weights: FloatArray) -> LearnedPolicy:
        """Return the policy of all weights, shape (n,)."""
        shapes = (len(ACTIONS), FEATURES), (HIDDEN, FEATURES), (len(ACTIONS), HIDDEN)
        ends = np.cumsum([rows * columns for rows, columns in shapes])
        if weights.shape != (ends[-1],) or not np.all(np.isfinite(weights)):
            raise ScenarioError(
                f"weights have shape {weights.shape}; allowed: {ends[-1]} known numbers"
            )
        return cls(
            *(
                part.reshape(shape)
                for part, shape in zip(np.split(weights, ends[:-1]), shapes, strict=True)
            )
        )

    @property
    def weights(self) -> FloatArray:
        """All weights, shape (n,)."""
        return np.concatenate([self.direct.ravel(), self.inner.ravel(), self.outer.ravel()])

    @property
    def digest(self) -> str:
        """SHA-256 of the weights as they are written."""
        return hashlib.sha256(json.dumps(self._rounded).encode()).hexdigest()

    def act(self, observed: FloatArray) -> FloatArray:
        """Return the action of an observation."""
        return actions(self.direct, self.inner, self.outer, features(observed))

    def decide(self, measured: Measurements) -> Command:
        """Return the command of a tick, as `iptm.Controller`: braking where the state is not measured."""
        if measured.state is None or measured.leader is None:
            return Command(-1.0, 0.0)
        return Command(*map(float, self.act(observation(measured))))

    def write(self, path: Path) -> None:
        """Write the weights with their digest."""
        path.write_text(
            json.dumps({"digest": self.digest, "weights": self._rounded}) + "\n", encoding="utf-8"
        )

    @classmethod
    def read(cls, path: Path) -> LearnedPolicy:
        """Read a policy.

        Raises:
            ScenarioError: the file does not hold a policy, or its digest differs.
        """
        given = StrictMapping(read_yaml(path, ScenarioError), str(path), ("digest", "weights"))
        weights = given.value("weights")
        try:
            policy = cls.of(np.array(weights, dtype=np.float64))
        except (TypeError, ValueError):
            raise ScenarioError(f"{path}: weights are not numbers; allowed: numbers") from None
        if given.text("digest") != policy.digest:
            raise ScenarioError(f"{path}: digest is another one; allowed: {policy.digest}")
        return policy

    @property
    def _rounded(self) -> list[float]:
        return [round(each, 5) for each in self.weights.tolist()]


def features(observed: FloatArray) -> FloatArray:
    """Return the inputs of the network for observations (..., n): (..., FEATURES), of the order of 1."""

    def of(name: str) -> FloatArray:
        return observed[..., _AT[name]]

    speed, leader = of("speed_m_s"), of("leader_speed_m_s")
    wanted_m = GAP_M + HEADWAY_S * speed
    warm_k = np.maximum(of("cell_1_temperature_k"), of("cell_n_temperature_k"))
    own = (
        (of("gap_m") - wanted_m) / wanted_m,
        (leader - speed) / SPEED_M_S,
        of("acceleration_m_s2"),
        of("slope_rad") / 0.05,
        (warm_k - CELSIUS_ZERO_K - WARM_C) / WARM_K,
        speed / 20.0 - 1.0,
        of("compressor_power_w") / LARGEST[1],
        np.ones(speed.shape),
    )
    ahead = (observed[..., -len(PREVIEW_S) :] - leader[..., np.newaxis]) / SPEED_M_S
    return np.clip(np.concatenate((np.stack(own, axis=-1), ahead), axis=-1), -3.0, 3.0)


def actions(
    direct: FloatArray, inner: FloatArray, outer: FloatArray, seen: FloatArray
) -> FloatArray:
    """Return actions of features, of one policy or of policies along the first axis of all."""
    hidden = np.tanh(seen @ np.swapaxes(inner, -1, -2))
    wanted = np.tanh(seen @ np.swapaxes(direct, -1, -2) + hidden @ np.swapaxes(outer, -1, -2))
    return np.stack((LARGEST[0] * wanted[..., 0], LARGEST[1] * np.maximum(wanted[..., 1], 0.0)), -1)
