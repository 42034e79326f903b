"""A trip as an environment: the closed loop of `iptm.simulate`, with the action in place of a controller.

    env = gymnasium.make("iptm_gym.environment:iptm/Trip-v0", trip="wltc")

Once this module is imported, ``iptm/Trip-v0`` is enough. Actions and observations have SI units (`ACTIONS`,
`OBSERVED`); learners that need them scaled use the wrappers of Gymnasium. The trip decides what is driven,
with which vehicle, preview and faults, and both ways give the same numbers.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from iptm.driving import trip_in_ticks
from iptm.own_parts import OwnController
from iptm.run import Run
from iptm.trip import Trip
from iptm.trip_files import DEFAULT_TRIP, load_trip
from iptm_controller.decision import Decision
from iptm_controller.measurements import LARGEST_GAP_M, Measurements
from iptm_controller.production import ProductionSettings
from iptm_core.errors import ScenarioError
from iptm_core.settings import LeaderSource
from iptm_core.state import Command, FloatArray, LeaderState
from iptm_core.user_input import shown
from iptm_gym.cost import TickCost, TickCosts
from iptm_gym.observation import OBSERVED, observation
from iptm_plant_sim.interval import PlantStep

ENVIRONMENT = "iptm/Trip-v0"
TripGiven = Trip | str | Path


class TripEnv(gymnasium.Env[FloatArray, FloatArray]):
    """A trip behind a lead vehicle, a step for each tick.

    An episode ends (``terminated``) when the lead vehicle is touched or the pack is empty, and is cut off
    (``truncated``) at the end of the trip; then ``info["run"]`` is the `iptm.Run`. Every ``info`` has the
    cost of the tick in its parts. The seed of `reset` is the seed of the trip's preview, and draws the trip
    where there are several.

    Args:
        trip: a trip, or its name or file, or several of them.
        headway_s: time headway of the gap without a price; None for the desired one of the vehicle, or of
            `production` where there is none.

    Attributes:
        trip: what is driven in this episode.
        measured: what is known at this tick, as controllers of the suite get it.

    Raises:
        IptmError: a trip cannot be driven; the message states the value and what is allowed.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    trip: Trip
    measured: Measurements

    def __init__(
        self,
        trip: TripGiven | Sequence[TripGiven] = DEFAULT_TRIP,
        headway_s: float | None = None,
    ) -> None:
        several = [trip] if isinstance(trip, (Trip, str, Path)) else list(trip)
        self._trips = [_driven_behind_a_leader(each) for each in several]
        if not self._trips:
            raise ScenarioError(f"trip is {shown(trip)}; allowed: at least one trip")
        self._headway_s = headway_s
        low, high = np.array(list(OBSERVED.values())).T
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        limits = [each.parameters.limits for each in self._trips]
        self.action_space = gymnasium.spaces.Box(
            np.array(
                [
                    min(each.min_acceleration_m_s2 for each in limits),
                    min(each.lowest_thermal_power_w for each in limits),
                ]
            ),
            np.array(
                [
                    max(each.max_acceleration_m_s2 for each in limits),
                    max(each.max_compressor_power_w for each in limits),
                ]
            ),
            dtype=np.float64,
        )
        self._loop: Generator[Measurements, Decision, Run] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin a trip."""
        super().reset(seed=seed, options=options)
        self.close()
        drawn = self._trips[int(self.np_random.integers(len(self._trips)))]
        noise = int(self.np_random.integers(2**31)) if seed is None else seed
        self.trip = drawn.changed(seed=noise)
        model = self.trip.parameters
        free_s = self._headway_s or model.gap.desired_time_headway_s
        self._costs = TickCosts(model, self.trip.controller, free_s or _OF_PRODUCTION_S)
        self._given = _Given()
        self._limited = OwnController(self._given, model.limits, self.trip.conditions.period_s)
        self._loop = trip_in_ticks(self.trip, on_step=self._note)
        self.measured = next(self._loop)
        return observation(self.measured), {}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Drive a tick.

        Args:
            action: `ACTIONS`; held within the bounds and rates of the vehicle, as every command.
        """
        if self._loop is None:
            raise ScenarioError("step without an episode; allowed: after reset")
        before, info = self._step, dict[str, Any]()
        self._given.command = Command(*map(float, action))
        try:
            self.measured = self._loop.send(self._limited.decide(self.measured))
        except StopIteration as end:
            run: Run = end.value
            info["run"], self._loop = run, None
            self.measured = replace(self.measured, state=self._step.state, leader=self._leader)
        gap_m = LARGEST_GAP_M
        if self._leader is not None:
            gap_m = self._leader.position_m - self._step.state.position_m
        elapsed = self._step.state.time_s > before.state.time_s
        cost = self._costs.of(before, self._step, gap_m) if elapsed else TickCost(0.0, 0.0, 0.0)
        info |= vars(cost)
        touched, at_end = gap_m <= 0.0, self._loop is None
        terminated = touched or (at_end and bool(info["run"].problems))
        if touched:
            self.close()
        return observation(self.measured), -cost.eur, terminated, at_end and not terminated, info

    def close(self) -> None:
        """End the trip."""
        if self._loop is not None:
            self._loop.close()
            self._loop = None

    def _note(self, step: PlantStep, leader: LeaderState | None) -> None:
        self._step, self._leader = step, leader


class _Given:
    """A controller whose command comes from outside."""

    command = Command(0.0, 0.0)

    def decide(self, measured: Measurements) -> Command:  # noqa: ARG002  by protocol
        return self.command


_OF_PRODUCTION_S = ProductionSettings().acc_time_headway_s


def _driven_behind_a_leader(given: TripGiven) -> Trip:
    trip = given if isinstance(given, Trip) else load_trip(given)
    source = trip.leader.leader_source
    if source is not LeaderSource.CYCLE:
        raise ScenarioError(f"leader_source is {source}; allowed here: {LeaderSource.CYCLE}")
    return trip.checked()


gymnasium.register(ENVIRONMENT, entry_point=TripEnv)
