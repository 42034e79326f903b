"""Parameters of what is known of the road beside the messages of cars, and what is built from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters.units import KM_H_PER_M_S
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.text_enum import TextEnum
from iptm_v2x_bridge.messages.pycrate_codec import specification
from iptm_v2x_bridge.prediction.history import History
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile
from iptm_v2x_bridge.prediction.predictor import Predictor
from iptm_v2x_bridge.prediction.received_path import ReceivedPath
from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, GivenRules, RoadRules
from iptm_v2x_bridge.prediction.signals import CyclicSignal, SignalPlan
from iptm_v2x_bridge.prediction.speed_limits import SpeedLimits
from iptm_v2x_bridge.roadside.rules import HeardRules
from iptm_v2x_bridge.roadside.table import RoadsideTable


class Expectation(TextEnum):
    """What is expected of a leader of whose future nothing is known."""

    HISTORY = "history"
    """Its acceleration decays."""
    REGRESSION = "regression"
    """What other drivers did after the same seconds."""


@dataclass(frozen=True)
class RoadKnowledgeSettings(Settings):
    """Earlier drives, the rules of the road, and what is expected where nothing is known."""

    prediction: Expectation = parameter(
        Expectation.HISTORY,
        "cam: expected motion of a leader that sends no path: history (its acceleration decays) or "
        "regression (on its last 10 s)",
    )
    regression_model: str = parameter(
        "",
        "cam: file with the regression, written by scripts/train_predictor; empty: the shipped one",
    )

    earlier_drives: str = parameter(
        "",
        "cam: earlier drives of this road to learn from, as in cycle, separated by commas",
    )
    speed_limits_km_h: str = parameter(
        "", "cam: speed limits of the road, <from metre>:<km/h> parts, e.g. '0:50, 1200:70'"
    )
    signals: str = parameter(
        "",
        "cam: signals of the road with plans that repeat themselves, <metre of the stop line>:<cycle in s>:"
        "<s of TimestampIts at which it turns green>:<s for which it is green> parts",
    )
    roadside_messages: bool = parameter(
        default=False,
        description="cam: take signals and speed limits from the messages of roadside stations, too (SPATEM, "
        "MAPEM, IVIM; needs requirements/roadside.txt); they override the given ones",
    )
    leader_keeps_rules: bool = parameter(
        default=True,
        description="cam: the prediction obeys the known speed limits and signals",
    )
    host_keeps_rules: bool = parameter(
        default=False,
        description="cam: where the speed limits and signals that are known are stricter than the leader, or "
        "none is there, the host is given a leader that stands for them",
    )
    line_foresight_s: float = parameter(
        60.0,
        "cam: with host_keeps_rules, stop lines that the host reaches later are not looked at",
        "s",
        1.0,
        3600.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.host_keeps_rules and not self.speed_limits_km_h.strip():
            raise ParameterError(
                "speed_limits_km_h is empty with host_keeps_rules; allowed: the limits to be kept, with "
                "roadside_messages where no sign is heard"
            )

    def build_given_rules(self) -> GivenRules:
        """Return the rules that the parameters state.

        Raises:
            ParameterError: a text is not usable.
        """
        text = self.speed_limits_km_h
        limits = read_limits(text) if text.strip() else None
        return GivenRules(limits, read_signals(self.signals))

    def build_heard_rules(self, given: GivenRules, road: RoadLine) -> HeardRules | None:
        """Return the rules as they are heard, None where they are not to be.

        Args:
            given: the rules that the parameters state.
            road: the host's route.

        Raises:
            ParameterError: the codec of these messages is not installed.
        """
        if not self.roadside_messages:
            return None
        specification()
        return HeardRules(RoadsideTable(road), given)

    def build_predictors(self, route: Route, rules: RoadRules) -> tuple[Predictor, ...]:
        """Return the predictors, the best informed first.

        Args:
            route: the leader's start on it is that of the earlier drives.
            rules: of the road, as far as a leader is known to keep them.

        Raises:
            IptmError: a file is not usable.
        """
        usual: Predictor = History()
        if self.prediction is Expectation.REGRESSION:
            usual = Regression(RegressionModel.load(self.regression_model))
        found: list[Predictor] = [ReceivedPath()]
        names = [name.strip() for name in self.earlier_drives.split(",") if name.strip()]
        if names:
            gap_m = route.leader.start_position_m
            drives = [build_route(name, initial_gap_m=gap_m).leader for name in names]
            found.append(LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in drives]))
        if self.leader_keeps_rules:
            found.append(BoundedByRules(usual, rules))
        return (*found, usual)


def read_limits(text: str) -> SpeedLimits:
    """Return the speed limits that a text such as `0:50, 1200:70` states.

    Raises:
        ParameterError: it is no such text.
    """
    try:
        pairs = np.array([[float(part) for part in entry.split(":")] for entry in text.split(",")])
        return SpeedLimits(pairs[:, 0], pairs[:, 1] / KM_H_PER_M_S)
    except (ValueError, IndexError, RouteError) as reason:
        raise ParameterError(
            f"speed_limits_km_h is {text!r}; allowed: <from metre>:<km/h> parts joined by commas, metres "
            "increasing, limits above 0"
        ) from reason


def read_signals(text: str) -> SignalPlan:
    """Return the signals that a text such as `1100:80:12.5:42` states, none for an empty one.

    Raises:
        ParameterError: it is no such text.
    """
    entries = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        return SignalPlan(tuple(CyclicSignal(*map(float, parts)) for parts in entries))
    except (ValueError, TypeError, RouteError) as reason:
        raise ParameterError(
            f"signals is {text!r}: {reason}; allowed: <metre of the stop line>:<cycle in s>:<turns green at "
            "s>:<green for s> parts joined by commas, metres increasing"
        ) from reason
