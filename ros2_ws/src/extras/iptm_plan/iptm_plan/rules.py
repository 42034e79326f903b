"""Rules that cars and chargers follow today: on arrival, just in time, and managed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from iptm_controller.production import SIMPLE
from iptm_life.year import (
    COOLING_COP,
    FREE_COOLING_ABOVE_AIR_K,
    FREE_COOLING_FROM_K,
)
from iptm_plan.course import ParkedInstant
from iptm_plan.pack import ParkedPack, PlannedStep
from iptm_plan.schedule import Schedule

_FULL = PlannedStep(1.0)


@dataclass(frozen=True)
class Rule:
    """Charging to a target, and a thermostat while charging.

    Attributes:
        target: state of charge.
        just_in_time: the charging ends at the departure instead of beginning on arrival.
        free_cooling: a fan cools the parked pack where it is warmer than the air, see `Usage`.
        away_target: state of charge to which the pack is charged on arrival at chargers of more power than
            the one at the beginning; 0 for none.
        heats_to_k: the heater runs while the pack charges below this temperature; 0 for never.
        charging_limit_k: temperature above which the pack is cooled while it is charged.
    """

    schedule: Schedule
    pack: ParkedPack
    target: float = 0.8
    just_in_time: bool = False
    free_cooling: bool = False
    away_target: float = 0.0
    heats_to_k: float = 0.0
    charging_limit_k: float = SIMPLE["thermostat_on_k"]

    def decide(self, at: ParkedInstant) -> PlannedStep:
        """Return the decision of a step."""
        schedule, step_s = self.schedule, self.schedule.step_s
        charger_w, air_k = schedule.place_w(at.stage), float(schedule.air_k[at.step])
        is_warmer = at.kelvin - air_k > FREE_COOLING_ABOVE_AIR_K
        cools = self.free_cooling and is_warmer and at.kelvin > FREE_COOLING_FROM_K
        fan = float(cools and self.pack.has_fan)
        is_away = charger_w > schedule.charger_w
        missing = (self.away_target if is_away else self.target) - at.charge
        waits = self.just_in_time and not is_away and self._waits(at, missing, charger_w)
        if not charger_w or missing <= 0.0 or waits:
            return PlannedStep(0.0, 0.0, fan)
        whole = self.pack.stand(at.charge, at.kelvin, charger_w, _FULL, step_s)
        gained = float(whole.gained)
        share = min(missing / gained, 1.0) if gained > 0.0 else 1.0
        if self.heats_to_k > at.kelvin:
            return PlannedStep(share, -self.pack.heater_w, fan)
        after_k = air_k + (at.kelvin - air_k) * float(whole.kept) + float(whole.warmed_k)
        above_k = after_k - max(self.charging_limit_k, min(at.kelvin, after_k))
        cooling_w = max(above_k, 0.0) * self.pack.capacity_j_k / COOLING_COP / step_s
        return PlannedStep(share, cooling_w, fan)

    def _waits(self, at: ParkedInstant, missing: float, charger_w: float) -> bool:
        """Return whether the charging begins in time in a later step."""
        if at.stage >= len(self.schedule.departures):
            return True
        left = self.schedule.departures[at.stage].step - at.step - 1
        gained = float(
            self.pack.stand(at.charge, at.kelvin, charger_w, _FULL, self.schedule.step_s).gained
        )
        return left * gained >= missing


RULES: Mapping[str, Mapping[str, Any]] = {
    "on arrival to 80 %": {"target": 0.8},
    "just in time": {"target": 0.8, "just_in_time": True},
    "managed": {"target": 0.6, "just_in_time": True, "free_cooling": True},
}
"""Rules by name, with what differs of a `Rule`."""
