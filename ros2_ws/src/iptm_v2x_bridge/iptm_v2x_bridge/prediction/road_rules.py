"""Speed limits and signals of the road as they are known at present, and the prediction that they bound."""

from __future__ import annotations

from dataclasses import dataclass, field

from iptm_core.road_ahead import SpeedLimits
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.predictor import Knowledge, Prediction, Predictor
from iptm_v2x_bridge.prediction.signals import BoundedBySignals, SignalPlan
from iptm_v2x_bridge.prediction.speed_limits import NO_LIMITS, BoundedBySpeedLimits


@dataclass
class RoadRules:
    """Rules of the road as they are known at present; messages change them from tick to tick.

    Attributes:
        limits: speed limits, None where none is known.
        plan: signals.
    """

    limits: SpeedLimits | None = None
    plan: SignalPlan = field(default_factory=lambda: SignalPlan(()))


class BoundedByRules:
    """Takes another prediction and keeps it within the rules."""

    def __init__(self, inner: Predictor, rules: RoadRules) -> None:
        self._inner, self._rules = inner, rules

    def predict(self, known: Knowledge, times_s: FloatArray) -> Prediction | None:
        """Return the bounded motion, None while no rule is known."""
        limits, plan = self._rules.limits, self._rules.plan
        if plan.signals:
            bounded = BoundedBySignals(self._inner, limits or NO_LIMITS, plan)
            return bounded.predict(known, times_s)
        if limits is None:
            return None
        return BoundedBySpeedLimits(self._inner, limits).predict(known, times_s)
