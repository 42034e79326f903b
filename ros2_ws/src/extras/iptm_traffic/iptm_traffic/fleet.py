"""Several equipped cars in one traffic: each with plant, safety monitor and controller of its own.

They know the car ahead by a range sensor, and signals as a driver sees them. SUMO drives all others.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from iptm.closed_loop import ClosedLoopRun, closed_loop
from iptm_controller.controller import Controller
from iptm_controller.horizon import Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.route import Route
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.plant import Plant
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    MAIN_PREFIX,
    DemandSettings,
    TrafficScenario,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.drive import DRIVER_FORESIGHT_S
from iptm_traffic.moved_car import MovedCar
from iptm_traffic.network import CYCLE_S, EGO_LANE, LONGEST_TRIP_S, MAIN_EDGES, build_network
from iptm_traffic.simulation import TrafficSimulation
from iptm_v2x_bridge.bridge import V2xBridge, single_sample
from iptm_v2x_bridge.rules_of_the_road import RulesOfTheRoad

TICK_S = 1.0
_SPEED, _DISTANCE = 0x40, 0x84  # of TraCI
_BLIND = PreviewSettings(preview_mode=PreviewMode.NONE)


@dataclass(frozen=True)
class FleetDrive:
    """What is to be driven on the corridor.

    Attributes:
        strategy: of the controllers of the equipped cars.
        every: of the cars that go all the way along the main road from trip time 0 on, each of this number is
            equipped, the first one included; 1 for all.
        duration_s: of the simulation.
        demand: how much traffic there is.
        step_s: step of SUMO.
        value_beyond_trip: see `ControllerSettings`.

    Raises:
        ScenarioError: a value is out of range.
    """

    strategy: str = ControllerSettings.strategy
    every: int = 1
    duration_s: float = 600.0
    demand: DemandSettings = field(default_factory=DemandSettings)
    step_s: float = 0.5
    value_beyond_trip: bool = False

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ScenarioError(f"every is {self.every}; allowed: 1 or more")
        if not TICK_S <= self.duration_s <= LONGEST_TRIP_S:
            most = f"{TICK_S:g} to {LONGEST_TRIP_S:.0f} s"
            raise ScenarioError(f"duration_s is {self.duration_s:g}; allowed: {most}")


@dataclass(frozen=True, eq=False)
class FleetCar:
    """What a car of the main road has driven, second by second from when it entered.

    Attributes:
        name: SUMO's.
        equipped: whether a controller drove it.
        time_s: trip times, shape (n,).
        speed_m_s: shape (n,).
        driven_m: since it entered, shape (n,).
        smallest_gap_m: to the car ahead, of an equipped one; infinite for the others.
    """

    name: str
    equipped: bool
    time_s: FloatArray
    speed_m_s: FloatArray
    driven_m: FloatArray
    smallest_gap_m: float


@dataclass(frozen=True, eq=False)
class FleetResult:
    """A finished drive.

    Attributes:
        cars: those that go all the way, in the order in which they entered.
        collisions: in which an equipped car took part.
        largest_deviation_m: how far apart SUMO and a plant ever had a car.
    """

    cars: tuple[FleetCar, ...]
    collisions: tuple[str, ...]
    largest_deviation_m: float


class EquippedCar:
    """A car with a controller, and the world around it.

    Attributes:
        moved: the car in SUMO.
        smallest_gap_m: to the car ahead.
    """

    def __init__(
        self,
        drive: FleetDrive,
        parameters: ModelParameters,
        simulation: TrafficSimulation,
        moved: MovedCar,
    ) -> None:
        """Take over a car where it is in SUMO."""
        self.moved, self.smallest_gap_m = moved, math.inf
        self._start_s = simulation.time_s
        self._measured: tuple[int, LeaderState | None] = (-1, None)
        network = simulation.network
        slope = network.road.slope()
        route = Route(
            f"fleet, {moved.name}",
            LeaderMotion(np.zeros(1), np.zeros(1), parameters.gap.initial_gap_m),
            slope,
            drive.duration_s,
            (),
            "SUMO",
            network.road.road_line(),
        )
        bridge = RulesOfTheRoad(
            V2xBridge(self, _BLIND),
            network.rules,
            parameters,
            foresight_s=DRIVER_FORESIGHT_S,
            start_timestamp_ms=round(1e3 * self._start_s),
        )
        options = ControllerOptions(
            strategy=strategy_by_name(drive.strategy),
            horizon=Horizon.parse(ControllerSettings.horizon),
            trip_duration_s=math.inf if drive.value_beyond_trip else drive.duration_s,
        )
        plant = Plant(parameters, slope.slope_at)
        start = plant.initial_state(moved.position_m, moved.speed_m_s)
        self.intervals: Generator[tuple[VehicleState, VehicleState], None, ClosedLoopRun] = (
            closed_loop(route, plant, Controller(parameters, options), bridge, self, start)
        )

    def pass_interval(self, before: VehicleState, after: VehicleState) -> None:
        """Do nothing: intervals pass for all cars together."""

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the car ahead at the present tick, None without one."""
        if self._measured[0] != time_ns:
            found, leader = self.moved.leader(), None
            if found is not None:
                _, gap_m, speed_m_s = found
                leader = LeaderState(1e-9 * time_ns, self.moved.position_m + gap_m, speed_m_s)
                self.smallest_gap_m = min(self.smallest_gap_m, gap_m)
            self._measured = time_ns, leader
        return self._measured[1]

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the car ahead at the present tick, as `sampled`: nothing is known of its future."""
        return self.sampled(times_s)

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the car ahead at the present tick; where it will be, SUMO has not decided yet."""
        return single_sample(self.leader_at(round(1e9 * float(times_s[0]))), float(times_s[0]))


def drive_fleet(drive: FleetDrive, parameters: ModelParameters) -> FleetResult:
    """Drive equipped cars on the corridor.

    Args:
        drive: what is to be driven.
        parameters: of every equipped car.

    Raises:
        IptmError: SUMO is not installed or fails, or the strategy is not known.
    """
    scenario = TrafficScenario.FOLLOWING
    with TemporaryDirectory(prefix="iptm_fleet_") as name:
        folder = Path(name)
        offsets = signal_offsets_s(scenario, drive.demand, CYCLE_S)
        network = build_network(folder, offsets, BEFORE_TRIP_S)
        gap_m = parameters.gap.initial_gap_m
        given = scenario, drive.demand, drive.duration_s, gap_m, drive.step_s, folder
        demand = write_demand(*given, with_stand_in=False)
        with closing(
            TrafficSimulation(network, demand, drive.step_s, with_ego=False)
        ) as simulation:
            return _driven(drive, parameters, simulation)


def _driven(
    drive: FleetDrive, parameters: ModelParameters, simulation: TrafficSimulation
) -> FleetResult:
    vehicle = simulation.connection.vehicle
    entered: dict[str, list[tuple[float, float, float]]] = {}
    waiting: dict[str, MovedCar] = {}
    equipped: dict[str, EquippedCar] = {}
    while simulation.time_s < drive.duration_s:
        for name in simulation.departed():
            if name.startswith(f"{MAIN_PREFIX}_") and tuple(vehicle.getRoute(name)) == MAIN_EDGES:
                if len(entered) % drive.every == 0:
                    waiting[name] = MovedCar(name, vehicle, simulation.network.road)
                    vehicle.changeLane(name, EGO_LANE, drive.duration_s)
                vehicle.subscribe(name, [_SPEED, _DISTANCE])
                entered[name] = []
        found = vehicle.getAllSubscriptionResults()
        for name, rows in entered.items():
            values = found[name]
            rows.append((simulation.time_s, max(values[_SPEED], 0.0), values[_DISTANCE]))
        for name, moved in list(waiting.items()):
            if moved.take_over(found[name][_SPEED]):
                simulation.watched.add(name)
                equipped[name] = EquippedCar(drive, parameters, simulation, waiting.pop(name))
        moves = [(car.moved, next(car.intervals)[1]) for car in equipped.values()]
        simulation.move(moves, TICK_S)
    cars = []
    for name, rows in entered.items():
        time_s, speed_m_s, driven_m = np.array(rows, dtype=np.float64).reshape(-1, 3).T
        gap_m = equipped[name].smallest_gap_m if name in equipped else math.inf
        cars.append(FleetCar(name, name in equipped, time_s, speed_m_s, driven_m, gap_m))
    return FleetResult(
        tuple(cars),
        tuple(simulation.collisions),
        max((car.moved.largest_deviation_m for car in equipped.values()), default=0.0),
    )
