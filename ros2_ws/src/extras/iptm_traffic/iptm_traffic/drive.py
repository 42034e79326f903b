"""A drive in traffic: its preparation, and the drive without ROS.

SUMO, messages, bridge, controller, plant, and back into SUMO.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.metrics.run_metrics import RunMetrics, compute_metrics
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.route import Route
from iptm_core.settings import PreviewSettings
from iptm_core.trajectory import Trajectory
from iptm_its.table import RoadsideTable
from iptm_plant_sim.plant import Plant
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.network import CYCLE_S, build_network
from iptm_traffic.own_network import build_own_network
from iptm_traffic.radio import Rehearsal, TrafficRadio, rehearse
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.simulation import TrafficSimulation
from iptm_traffic.trip import PredictionInput, TrafficDrive
from iptm_traffic.world import SumoWorld
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.expected_motion import History
from iptm_v2x_bridge.prediction.predictor import LeaderPredictor, ReceivedPath
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.rules_of_the_road import RulesOfTheRoad

DRIVER_FORESIGHT_S = 15.0
"""How far ahead the ego vehicle looks at lines where their plan is not sent to it."""
_REHEARSED_BEYOND_S = 60.0


@contextmanager
def opened_traffic(
    drive: TrafficDrive, parameters: ModelParameters, fcd: Path | None = None
) -> Iterator[tuple[TrafficSimulation, Rehearsal | None]]:
    """Provide the traffic of a drive at trip time 0, and what its vehicles will do if they announce paths.

    Raises:
        IptmError: SUMO is not installed or fails.
    """
    with tempfile.TemporaryDirectory(prefix="iptm_traffic_") as name:
        folder, demand, rehearsal = Path(name), None, None
        if drive.own is not None:
            network = build_own_network(drive.own, drive.step_s, folder)
        else:
            offsets = signal_offsets_s(drive.scenario, drive.demand, CYCLE_S)
            network = build_network(folder, offsets, BEFORE_TRIP_S)

            def written(*, with_stand_in: bool) -> Path:
                return write_demand(
                    drive.scenario,
                    drive.demand,
                    drive.duration_s,
                    parameters.gap.initial_gap_m,
                    drive.step_s,
                    folder,
                    with_stand_in=with_stand_in,
                )

            if drive.knowledge is PredictionInput.PATH:
                demand = written(with_stand_in=True)
                rehearsed = TrafficSimulation(network, demand, drive.step_s, with_ego=False)
                with closing(rehearsed):
                    rehearsal = rehearse(rehearsed, drive.duration_s + _REHEARSED_BEYOND_S)
            demand = written(with_stand_in=False)
        with closing(TrafficSimulation(network, demand, drive.step_s, fcd=fcd)) as simulation:
            yield simulation, rehearsal


@dataclass(frozen=True, eq=False)
class TrafficResult:
    """A finished drive.

    Attributes:
        drive: what was to be driven.
        world: what happened around the ego vehicle; its simulation has ended.
        trajectory: what happened; without a car ahead, the leader is as far as it is looked for.
        metrics: figures of the run.
        largest_excess_m_s: largest speed above the limit.
        predictors: ticks by the predictor in use.
        fallback_ticks: ticks on which the controller had no solution to follow.
        wall_time_s: wall time of the drive.
        processor_s: processor time of the drive, SUMO's included.
    """

    drive: TrafficDrive
    world: SumoWorld
    trajectory: Trajectory
    metrics: RunMetrics
    largest_excess_m_s: float
    predictors: dict[str, int]
    fallback_ticks: int
    wall_time_s: float
    processor_s: float

    @property
    def times_real_time(self) -> float:
        """Trip time over wall time."""
        return self.drive.duration_s / self.wall_time_s

    @property
    def times_processor_time(self) -> float:
        """Trip time over processor time, which is the wall time on a machine with nothing else to do."""
        return self.drive.duration_s / self.processor_s

    @property
    def digest(self) -> str:
        """Digest of the trajectory, to the last bit."""
        digest = hashlib.sha256()
        for values in self.trajectory.to_arrays().values():
            digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        return digest.hexdigest()


def drive_in_traffic(
    drive: TrafficDrive, parameters: ModelParameters, fcd: Path | None = None
) -> TrafficResult:
    """Simulate one drive in traffic and return its result.

    Args:
        drive: what is to be driven.
        parameters: of the ego vehicle.
        fcd: where SUMO writes what every vehicle does; None for nowhere.

    Raises:
        IptmError: SUMO is not installed or fails, or the strategy is not known.
    """
    with opened_traffic(drive, parameters, fcd) as (simulation, rehearsal):
        return _closed_loop(drive, parameters, simulation, rehearsal)


def _predictors(knowledge: PredictionInput, rules: RoadRules) -> tuple[LeaderPredictor, ...]:
    if knowledge is PredictionInput.PATH:
        return ReceivedPath(), History()
    if knowledge is PredictionInput.SIGNALS:
        return BoundedByRules(History(), rules), History()
    return (History(),)


def _closed_loop(
    drive: TrafficDrive,
    parameters: ModelParameters,
    simulation: TrafficSimulation,
    rehearsal: Rehearsal | None,
) -> TrafficResult:
    network = simulation.network
    road_line, slope = network.road.road_line(), network.road.slope()
    preview = PreviewSettings()
    radio = TrafficRadio(simulation, road_line, rehearsal, with_roadside=drive.signals_by_radio)
    own = RightOfWay(simulation) if drive.own is not None else None
    for_ego, for_leader = (own.ego, own.leader) if own else (network.rules, network.rules)
    heard = None
    if drive.signals_by_radio:
        heard = RoadsideTable(road_line, RoadRules(network.limits))
        for_ego, for_leader = heard.ego, heard.leader
    receiver = CamBridge(
        road_line, preview, predictors=_predictors(drive.knowledge, for_leader), roadside=heard
    )
    knows_plan = drive.knowledge is PredictionInput.SIGNALS
    heard_radio = SimulatedRadio(radio, receiver)
    bridge = RulesOfTheRoad(
        heard_radio,
        for_ego,
        parameters,
        preview,
        foresight_s=preview.preview_length_s if knows_plan else DRIVER_FORESIGHT_S,
    )
    world = SumoWorld(drive.scenario, simulation, radio, parameters, own)
    is_default = drive.strategy == ControllerSettings.strategy
    options = ControllerOptions(
        strategy=strategy_by_name(drive.strategy),
        horizon=Horizon.parse(ControllerSettings.horizon) if is_default else SINGLE_HORIZON,
        trip_duration_s=drive.duration_s,
    )
    route = Route(
        f"traffic, {drive.title}",
        LeaderMotion(np.zeros(1), np.zeros(1), parameters.gap.initial_gap_m),
        slope,
        drive.duration_s,
        (),
        "SUMO",
        road_line,
    )
    plant, controller = Plant(parameters, slope.slope_at), MpcController(parameters, options)
    started, used = time.perf_counter(), time.process_time() + simulation.processor_s
    run = run_closed_loop(route, plant, controller, bridge=bridge, world=world)
    wall_time_s = time.perf_counter() - started
    processor_s = time.process_time() + simulation.processor_s - used
    trip = run.trajectory
    excess = trip.speed_m_s - network.limits.at_m_s(trip.position_m)
    return TrafficResult(
        drive=drive,
        world=world,
        trajectory=trip,
        metrics=compute_metrics(trip, parameters, run.decisions),
        largest_excess_m_s=float(np.max(excess, initial=0.0)),
        predictors=dict(sorted(heard_radio.predictors.items())),
        fallback_ticks=int(np.count_nonzero(np.asarray(run.decisions.rung) != Rung.OPTIMAL)),
        wall_time_s=wall_time_s,
        processor_s=processor_s,
    )
