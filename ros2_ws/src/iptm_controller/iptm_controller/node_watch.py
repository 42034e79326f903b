"""Conditions that last too long, for the operator: broken limits, futile cooling, plans out of limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements, trusted_measurements
from iptm_controller.ocp.layout import StateIndex
from iptm_controller.settings import WarningSettings
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
from iptm_core.state import LeaderState, VehicleState

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
