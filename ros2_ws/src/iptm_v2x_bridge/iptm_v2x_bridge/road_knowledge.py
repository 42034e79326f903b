"""Parameters of the given knowledge of the road, and the objects built from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.declaration import Settings, TextEnum, parameter
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters.model import KM_H_PER_M_S, ModelParameters
from iptm_core.road_ahead import RoadAheadSettings, SpeedLimits, limits_of_curves, limits_of_drive
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import LeaderSource, PreviewSettings
from iptm_v2x_bridge.bridge import CycleSource, EmptyRoad, PreviewSource, TickBridge, V2xBridge
from iptm_v2x_bridge.messages.pycrate_codec import specification
from iptm_v2x_bridge.prediction.extrapolation import History
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile
from iptm_v2x_bridge.prediction.predictor import Predictor, ReceivedPath
from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel
from iptm_v2x_bridge.prediction.road_rules import NO_LIMITS, BoundedByRules, RoadRules, Signal
from iptm_v2x_bridge.roadside.table import RoadsideTable
from iptm_v2x_bridge.rules_of_the_road import RulesOfTheRoad

OF_THE_CYCLE = "cycle"
"""Value of `speed_limits_km_h` for the limits that the cycle itself keeps."""
AT_THE_END_M_S = 1e-3
"""Speed limit behind the end of the route: a halt."""


class Expectation(TextEnum):
    """What is expected of a leader of whose future nothing is known."""

    HISTORY = "history"
    """Its acceleration decays."""
    REGRESSION = "regression"
    """What other drivers did after the same seconds."""


@dataclass(frozen=True)
class RoadKnowledgeSettings(Settings):
    """Earlier drives, messages of the roadside, and what is expected where nothing is known."""

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
    roadside_messages: bool = parameter(
        default=False,
        description="cam: take signals and speed limits from the messages of roadside stations, too (SPATEM, "
        "MAPEM, IVIM; needs requirements/roadside.txt); they override the given ones",
    )
    leader_keeps_rules: bool = parameter(
        default=True,
        description="cam: the prediction obeys the known speed limits and signals",
    )

    def build_heard_rules(self, given: RoadRules, road: RoadLine) -> RoadsideTable | None:
        """Return the rules as they are heard, None where they are not to be.

        Raises:
            ParameterError: the codec of these messages is not installed.
        """
        if not self.roadside_messages:
            return None
        specification()
        return RoadsideTable(road, given)

    def build_predictors(self, route: Route, rules: RoadRules) -> tuple[Predictor, ...]:
        """Return the predictors, the best informed first.

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


def given_rules(settings: RoadAheadSettings, route: Route) -> RoadRules:
    """Return the rules that settings state for a route.

    Raises:
        ParameterError: a text is not usable.
    """
    text = settings.speed_limits_km_h.strip()
    if text == OF_THE_CYCLE:
        limits: SpeedLimits | None = limits_of_drive(route.leader)
    else:
        limits = read_limits(text) if text else None
    return RoadRules(limits, read_signals(settings.signals))


def own_limits(settings: RoadAheadSettings, route: Route) -> SpeedLimits:
    """Return the limits other than signs: set speed, curves and, without a leader, the end of the route."""
    limits = limits_of_curves(route.road_line, settings.max_lateral_acceleration_m_s2)
    if settings.set_speed_km_h:
        wanted = np.full(1, settings.set_speed_km_h / KM_H_PER_M_S)
        limits = limits.and_not_above(SpeedLimits(np.zeros(1), wanted))
    if settings.leader_source is LeaderSource.NONE:
        motion = route.leader
        end_m = float(motion.positions_m[-1] - motion.start_position_m)
        end = SpeedLimits(
            np.array([0.0, end_m]), np.array([NO_LIMITS.limits_m_s[0], AT_THE_END_M_S])
        )
        limits = limits.and_not_above(end)
    return limits


def with_rules(
    inner: TickBridge,
    settings: RoadAheadSettings,
    route: Route,
    model: ModelParameters,
    preview: PreviewSettings,
    rules: RoadRules,
    start_timestamp_ms: int = 0,
) -> TickBridge:
    """Return a bridge that adds the rules of the road, or the same one where none are kept."""
    if not settings.keeps_rules:
        return inner
    return RulesOfTheRoad(
        inner,
        rules,
        model,
        preview,
        foresight_s=settings.line_foresight_s,
        start_timestamp_ms=start_timestamp_ms,
        own_limits=own_limits(settings, route),
    )


def road_bridge(
    settings: RoadAheadSettings,
    route: Route,
    model: ModelParameters,
    preview: PreviewSettings,
    leader: PreviewSource | None = None,
) -> tuple[PreviewSource, TickBridge]:
    """Return who drives ahead of an ego vehicle without ROS, and the bridge that answers its ticks.

    Raises:
        ParameterError: a text is not usable.
    """
    source: PreviewSource = leader or CycleSource(route)
    if settings.leader_source is LeaderSource.NONE:
        source = EmptyRoad()
    rules = given_rules(settings, route)
    return source, with_rules(V2xBridge(source, preview), settings, route, model, preview, rules)


def read_limits(text: str) -> SpeedLimits:
    """Return the speed limits that a text such as `0:50, 1200:70` states.

    Raises:
        ParameterError: the text is malformed.
    """
    try:
        pairs = np.array([[float(part) for part in entry.split(":")] for entry in text.split(",")])
        return SpeedLimits(pairs[:, 0], pairs[:, 1] / KM_H_PER_M_S)
    except (ValueError, IndexError, RouteError) as reason:
        raise ParameterError(
            f"speed_limits_km_h is {text!r}; allowed: <from metre>:<km/h> parts joined by commas, metres "
            "increasing, limits above 0; or cycle"
        ) from reason


def read_signals(text: str) -> tuple[Signal, ...]:
    """Return the signals that a text such as `1100:80:12.5:42` states, none for an empty one.

    Raises:
        ParameterError: the text is malformed.
    """
    entries = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        return RoadRules(
            None, tuple(Signal.cyclic(*map(float, parts)) for parts in entries)
        ).signals
    except (ValueError, TypeError, RouteError) as reason:
        raise ParameterError(
            f"signals is {text!r}: {reason}; allowed: <metre of the stop line>:<cycle in s>:<turns green at "
            "s>:<green for s> parts joined by commas, metres increasing"
        ) from reason
