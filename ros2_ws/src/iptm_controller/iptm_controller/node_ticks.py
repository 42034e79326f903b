"""Which tick is answered (a complete one, of several the newest), and conditions that last too long.

The latter are for the operator: broken limits, futile cooling, plans out of limits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements, trusted_measurements
from iptm_controller.ocp.layout import StateIndex
from iptm_controller.settings import WarningSettings
from iptm_core.errors import MessageError
from iptm_core.metrics.constraints import (
    TEMPERATURE_TOLERANCE_K,
    Concern,
    IneffectiveCooling,
    Situation,
    Streak,
    broken_limits,
    cooling_at_limit,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.road_ahead import RoadAhead
from iptm_core.state import LeaderPreview, LeaderState, PackReading, SlopePreview, VehicleState
from iptm_ros.codecs import decode_leader, decode_observation
from iptm_ros.stamp_matcher import MatchedSet
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

SLOW_DECISION_S = 0.05
WAITED_SHARE = 0.5
"""A tick that is complete within this share of the time of a slow decision after it has waited for it."""
CATCH_UP_S = 0.002
OTHER_INPUTS = (Topic.LEADER_PREVIEW, Topic.ROAD_AHEAD, Topic.LEADER)
"""What a decision takes besides the state."""
FLAT_ROAD = SlopePreview(np.zeros(1), np.zeros(1))


class CompleteTick:
    """Determines whether all messages of a tick have arrived.

    The road ahead states whether there is a leader to wait for. Without such a topic, as of a bridge of the
    user's, there always is.
    """

    def __init__(self, node: SuiteNode) -> None:
        name = node.resolve_topic_name(Topic.ROAD_AHEAD.value)
        self._look = partial(node.count_publishers, name)
        self._has_road = False

    def __call__(self, values: Mapping[Topic, Any]) -> bool:
        """Return whether a tick with these messages can be decided."""
        if not {Topic.PLANT_STATE, Topic.LEADER_PREVIEW} <= values.keys():
            return False
        road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
        if road is not None:
            return Topic.LEADER in values or not road.has_leader
        if Topic.LEADER not in values:
            return False
        self._has_road = self._has_road or self._look() > 0
        return not self._has_road


class CatchUp:
    """Answers the newest tick only, where others have waited for the decision on the one before.

    In real time a controller that decides more slowly than ticks come would otherwise fall behind further
    and further. In lock-step the plant waits, so nothing is skipped.

    Attributes:
        is_skipping: whether ticks are skipped at present.
        skipped_ticks: ticks without a decision of their own.
    """

    def __init__(self, node: SuiteNode, answer: Callable[[MatchedSet[Topic]], None]) -> None:
        self.is_skipping = False
        self.skipped_ticks = 0
        self._answer = answer
        self._newest: MatchedSet[Topic] | None = None
        self._seen_last: MatchedSet[Topic] | None = None
        self._answered_s = -math.inf
        self._took_s = 0.0
        self._timer = node.every(CATCH_UP_S, self._catch_up)
        self._timer.cancel()

    def note_answer(self, started_s: float) -> None:
        """Note that a decision which was begun at a steady time is made."""
        self._answered_s = time.monotonic()
        self._took_s = self._answered_s - started_s

    def takes(self, matched: MatchedSet[Topic]) -> bool:
        """Return whether a tick is kept until what else has waited is taken in."""
        if self._newest is None and not self._is_behind():
            self.is_skipping = False
            return False
        if self._newest is not None:
            self.skipped_ticks += 1
            self.is_skipping = True
        self._newest = matched
        if self._timer.is_canceled():
            self._seen_last = None
            self._timer.reset()
        return True

    def _is_behind(self) -> bool:
        """Return whether a tick has waited for the decision on the one before."""
        waited = time.monotonic() - self._answered_s < WAITED_SHARE * self._took_s
        return waited and self._took_s > SLOW_DECISION_S

    def _catch_up(self) -> None:
        """Answer as soon as no further tick has been completed for a moment."""
        if self._newest is not self._seen_last:
            self._seen_last = self._newest
            return
        self._timer.cancel()
        newest, self._newest = self._newest, None
        if newest is not None:
            self._answer(newest)


def read_measurements(values: Mapping[Topic, Any], slope: SlopePreview | None) -> Measurements:
    """Decode the arrived messages, with the reason for each missing one.

    Args:
        values: messages of a tick by topic, preview and road decoded already.
        slope: of the road, None where it is not known.
    """
    faults = []
    road: RoadAhead | None = values.get(Topic.ROAD_AHEAD)
    state: VehicleState | None = None
    leader: LeaderState | None = None
    pack: PackReading | None = None
    try:
        if Topic.PLANT_STATE in values:
            observed = decode_observation(values[Topic.PLANT_STATE])
            state, pack = observed.state, observed.pack_reading
        else:
            faults.append(f"no {Topic.PLANT_STATE.value} received")
    except MessageError as error:
        faults.append(str(error))
    try:
        if Topic.LEADER in values:
            leader = decode_leader(values[Topic.LEADER])
        elif road is None or road.has_leader or road.limits is None:
            faults.append("no measurement of the leader received")
    except MessageError as error:
        faults.append(str(error))
    preview: LeaderPreview = values.get(Topic.LEADER_PREVIEW) or LeaderPreview.empty()
    return Measurements(state, leader, preview, slope or FLAT_ROAD, "; ".join(faults), road, pack)


_WARNINGS = {
    Concern.SHORT_GAP: "gap below s_min for long",
    Concern.LONG_GAP: "gap above s_max for long",
    Concern.SPEED: "speed out of its limits for long",
    Concern.HOT_CELL: "cell above its highest temperature for long",
    Concern.COOLING: "compressor at its limit without effect",
    Concern.PLAN: "plans never get back within limits",
}
CONCERNS = frozenset(_WARNINGS.values())
"""All reasons to warn of something that has gone on for too long."""
COLD = "cells below their lowest temperature, which forbids cooling"


class OperatorWatch:
    """Follows the trip tick by tick.

    Attributes:
        lasted_s: for how long each concern has lasted now, in s.
        in_contact: whether the measured gap is zero or negative.
        note: informational note that is not a warning, empty for none.
    """

    def __init__(self, parameters: ModelParameters, settings: WarningSettings) -> None:
        self._parameters = parameters
        self._settings = settings
        self._streaks = {concern: Streak() for concern in Concern}
        self._cooling = IneffectiveCooling()
        self.lasted_s: dict[Concern, float] = dict.fromkeys(Concern, 0.0)
        self.in_contact = False
        self.note = ""

    def update(self, measured: Measurements, decision: Decision) -> None:
        """Update with a tick; one without a plausible state or leader is ignored."""
        if decision.pack is not None and decision.pack.faults:
            measured = replace(measured, state=decision.pack.state)
        state, leader, _ = trusted_measurements(measured)
        if state is not None and leader is not None:
            self._watch_trip(state, leader)
            ends_outside = self._ends_outside(decision)
            if ends_outside is not None:
                self._count(Concern.PLAN, state.time_s, holds=ends_outside)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to warn, without numbers; empty if there is none."""
        return tuple(
            text
            for concern, text in _WARNINGS.items()
            if self.lasted_s[concern] > self._settings.after_s(concern)
        )

    @property
    def values(self) -> Mapping[str, object]:
        """Times that the concerns have lasted, by the key of a diagnostic value."""
        return {f"{concern.value}_s": lasted for concern, lasted in self.lasted_s.items()}

    def _watch_trip(self, state: VehicleState, leader: LeaderState) -> None:
        at = Situation.at(state, leader)
        self.in_contact = bool(at.gap_m <= 0.0)
        for concern, broken in broken_limits(at, self._parameters).items():
            self._count(concern, state.time_s, holds=bool(broken))
        at_limit = bool(cooling_at_limit(at, self._parameters))
        self.lasted_s[Concern.COOLING] = self._cooling.update(
            state.time_s, at.warmest_cell_k, at_limit=at_limit
        )
        coldest_k = min(state.cell_1_temperature_k, state.cell_n_temperature_k)
        lowest_k = self._parameters.limits.min_temperature_k - TEMPERATURE_TOLERANCE_K
        self.note = COLD if coldest_k < lowest_k else ""

    def _count(self, concern: Concern, time_s: float, *, holds: bool) -> None:
        self.lasted_s[concern] = self._streaks[concern].update(time_s, holds=holds)

    def _ends_outside(self, decision: Decision) -> bool | None:
        """Return whether the last node of the plan breaks a watched limit, None without a plan."""
        plan, forecast = decision.plan, decision.forecast
        if plan is None or forecast is None:
            return None
        moving, last = plan.states[plan.motion_steps], plan.states[-1]
        end_s = plan.start_s + plan.node_times_s[plan.motion_steps]
        positions, speeds = forecast.motion.at(np.array([end_s]))
        end = Situation(
            gap_m=float(positions[0] - moving[StateIndex.POSITION]),
            speed_m_s=float(moving[StateIndex.SPEED]),
            leader_speed_m_s=float(speeds[0]),
            warmest_cell_k=float(
                max(last[StateIndex.CELL_1_TEMPERATURE], last[StateIndex.CELL_N_TEMPERATURE])
            ),
            compressor_power_w=float(last[StateIndex.LAST_COMPRESSOR_POWER]),
        )
        return any(bool(broken) for broken in broken_limits(end, self._parameters).values())
