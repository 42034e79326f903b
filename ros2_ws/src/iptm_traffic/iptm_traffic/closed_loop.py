"""A drive in traffic, headless: SUMO, messages, bridge, controller, plant, and back into SUMO."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.metrics import compute_metrics
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.route import Route
from iptm_core.settings import PreviewSettings
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_traffic.drive import PredictionInput, TrafficDrive, TrafficResult
from iptm_traffic.preparation import prepare_traffic
from iptm_traffic.radio import Rehearsed, TrafficRadio
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.roadside import LIMITS_WITHOUT_SIGNS, RoadsideStations
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.world import SumoWorld
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.history import History
from iptm_v2x_bridge.prediction.predictor import Predictor
from iptm_v2x_bridge.prediction.received_path import ReceivedPath
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, GivenRules, RoadRules
from iptm_v2x_bridge.road_knowledge import read_limits
from iptm_v2x_bridge.roadside.rules import HeardRules
from iptm_v2x_bridge.roadside.table import RoadsideTable
from iptm_v2x_bridge.rules_of_the_road import RulesOfTheRoad

DRIVER_FORESIGHT_S = 15.0
"""How far ahead the host looks at lines where their plan is not sent to it."""


class _HeardTraffic:
    """A bridge that hears, before each tick, what has been sent by then."""

    def __init__(self, radio: TrafficRadio, bridge: CamBridge) -> None:
        self._radio, self._bridge = radio, bridge

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        for sent_ns, datagram in self._radio.take():
            self._bridge.receive(datagram, sent_ns)
        return self._bridge.answer(time_ns, host_position_m, host_speed_m_s)


class _Watched:
    """A bridge that counts the predictors in use."""

    def __init__(self, inner: RulesOfTheRoad) -> None:
        self._inner = inner
        self.predictors: Counter[str] = Counter()

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        answer = self._inner.answer(time_ns, host_position_m, host_speed_m_s)
        self.predictors[answer.predictor or "none"] += 1
        return answer


def drive_in_traffic(
    drive: TrafficDrive, parameters: ModelParameters, fcd: Path | None = None
) -> TrafficResult:
    """Drive.

    Args:
        drive: what is to be driven.
        parameters: of the host.
        fcd: where SUMO writes what every vehicle does; None for nowhere.

    Raises:
        IptmError: SUMO is not installed or fails, or the strategy is not known.
    """
    with tempfile.TemporaryDirectory(prefix="iptm_traffic_") as name:
        made = prepare_traffic(drive, parameters, Path(name))
        with closing(
            TrafficSimulation(made.network, made.demand, drive.step_s, fcd=fcd)
        ) as simulation:
            return _closed_loop(drive, parameters, simulation, made.rehearsal)


def _predictors(knowledge: PredictionInput, rules: RoadRules) -> tuple[Predictor, ...]:
    if knowledge is PredictionInput.PATH:
        return ReceivedPath(), History()
    if knowledge is PredictionInput.SIGNALS:
        return BoundedByRules(History(), rules), History()
    return (History(),)


def _options(drive: TrafficDrive) -> ControllerOptions:
    is_default = drive.strategy == ControllerSettings.strategy
    return ControllerOptions(
        strategy=strategy_by_name(drive.strategy),
        horizon=Horizon.parse(ControllerSettings.horizon) if is_default else SINGLE_HORIZON,
        trip_duration_s=drive.duration_s,
    )


def _closed_loop(
    drive: TrafficDrive,
    parameters: ModelParameters,
    simulation: TrafficSimulation,
    rehearsal: dict[str, Rehearsed] | None,
) -> TrafficResult:
    network = simulation.network
    road_line, slope = network.road.road_line(), network.road.slope()
    preview = PreviewSettings()
    heard = stations = None
    if drive.signals_by_radio:
        stations = RoadsideStations(network, road_line)
        heard = HeardRules(RoadsideTable(road_line), GivenRules(read_limits(LIMITS_WITHOUT_SIGNS)))
    radio = TrafficRadio(simulation, road_line, rehearsal, stations)
    own = RightOfWay(simulation) if drive.own is not None else None
    for_host, for_leader = (own.host, own.leader) if own else (network.rules, network.rules)
    if heard is not None:
        for_host, for_leader = heard.host, heard.leader
    bridge = CamBridge(
        road_line,
        preview,
        predictors=_predictors(drive.knowledge, for_leader),
        roadside=heard,
    )
    knows_plan = drive.knowledge is PredictionInput.SIGNALS
    rules = RulesOfTheRoad(
        _HeardTraffic(radio, bridge),
        for_host,
        parameters,
        preview,
        foresight_s=preview.preview_length_s if knows_plan else DRIVER_FORESIGHT_S,
    )
    watched = _Watched(rules)
    world = SumoWorld(drive.scenario, simulation, own)
    plant = Plant(parameters, slope.slope_at)
    controller = Controller(parameters, _options(drive))
    route = Route(
        f"traffic, {drive.title}",
        LeaderMotion(np.zeros(1), np.zeros(1), parameters.gap.initial_gap_m),
        slope,
        drive.duration_s,
        (),
        "SUMO",
        road_line,
    )
    started, used = time.perf_counter(), time.process_time() + simulation.processor_s
    run = run_closed_loop(route, plant, controller, bridge=watched, world=world)
    ended = time.perf_counter()
    processor_s = time.process_time() + simulation.processor_s - used
    margins = gap_margins_m(run.trajectory, parameters)
    records = run.decisions
    metrics = compute_metrics(run.trajectory, parameters, records)
    return TrafficResult(
        smallest_gap_m=metrics.gap.smallest_m,
        smallest_margin_m=float(np.min(margins[world.ahead.counted], initial=np.inf)),
        lines_passed=len(world.lines.passed),
        lines_passed_closed=world.lines.passed_closed,
        largest_deviation_m=simulation.largest_deviation_m,
        leaders=tuple(world.ahead.names),
        messages=radio.sent,
        collisions=tuple(simulation.collisions),
        drive=drive,
        trajectory=run.trajectory,
        decisions=records,
        metrics=metrics,
        largest_excess_m_s=float(
            np.max(
                run.trajectory.speed_m_s - network.limits.at_m_s(run.trajectory.position_m),
                initial=0.0,
            )
        ),
        predictors=dict(sorted(watched.predictors.items())),
        fallback_ticks=int(np.count_nonzero(np.asarray(records.rung) != Rung.OPTIMAL)),
        wall_time_s=ended - started,
        processor_s=processor_s,
    )
