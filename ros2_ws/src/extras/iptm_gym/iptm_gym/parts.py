"""Wrappers for one half of the decision; the other half is the one of `production`, a car of today."""

from __future__ import annotations

import gymnasium
import numpy as np

from iptm_controller.production import ProductionLikeController, ProductionSettings
from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray
from iptm_gym.environment import TripEnv
from iptm_gym.observation import ACTIONS


class _OnePart(gymnasium.ActionWrapper[FloatArray, FloatArray, FloatArray]):
    """Actions with one entry of `ACTIONS`."""

    part: int

    def __init__(self, env: gymnasium.Env[FloatArray, FloatArray]) -> None:
        super().__init__(env)
        whole = env.action_space
        if not isinstance(whole, gymnasium.spaces.Box):
            raise ScenarioError(f"action space is {whole}; allowed: the one of a trip")
        one = slice(self.part, self.part + 1)
        self.action_space = gymnasium.spaces.Box(whole.low[one], whole.high[one], dtype=np.float64)

    def reset(self, **given: object) -> tuple[FloatArray, dict[str, object]]:
        """Begin a trip."""
        begun = super().reset(**given)
        trip = self._trip_env.trip
        self._production = ProductionLikeController(
            trip.parameters, ProductionSettings(), trip.conditions.period_s
        )
        return begun

    def action(self, action: FloatArray) -> FloatArray:
        """Return the whole action."""
        measured = self._trip_env.measured
        if measured.state is None:
            raise ScenarioError("state is not measured; allowed: trips with a measured state")
        command = self._production.command(measured.state, measured.leader)
        whole = np.array([getattr(command, name) for name in ACTIONS])
        whole[self.part] = action[0]
        return whole

    @property
    def _trip_env(self) -> TripEnv:
        inner = self.unwrapped
        if not isinstance(inner, TripEnv):
            raise ScenarioError(f"environment is {inner}; allowed: a trip")
        return inner


class MotionOnly(_OnePart):
    """The action is the acceleration; a thermostat cools."""

    part = 0


class CoolingOnly(_OnePart):
    """The action is the compressor power; a cruise control drives."""

    part = 1
