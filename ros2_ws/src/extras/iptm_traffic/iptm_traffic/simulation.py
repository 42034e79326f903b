"""One SUMO simulation with the ego vehicle in it, moved exactly with the plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray
from iptm_traffic.demand import EGO, EGO_KIND, MAIN_NAMES
from iptm_traffic.moved_car import EgoMotion, MovedCar
from iptm_traffic.network import Network
from iptm_traffic.sumo_process import SumoProcess

RADIO_RANGE_M = 400.0
LONGEST_WAIT_S = 120.0
"""Longest delay of the start of the trip until there is room for the ego vehicle."""
_VEHICLES = 0xA4  # TraCI's domain of vehicles
_ON_LANE = (0x51, 0x56)  # name of the lane, position on it
_SPEED, _POSITION, _ANGLE, _LENGTH, _LANE_INDEX, _ACCELERATION = 0x40, 0x42, 0x43, 0x44, 0x52, 0x72


@dataclass(frozen=True, eq=False)
class SumoNeighbours:
    """The vehicles in radio range of the ego vehicle at one instant, in the order of their names.

    Attributes:
        time_s: trip time.
        names: SUMO's names, n of them.
        positions_m: fronts along the ego vehicle's road, shape (n,).
        lateral_m: distances to the left of it, shape (n,).
        headings_deg: clockwise from north, shape (n,).
        speeds_m_s: shape (n,).
        accelerations_m_s2: shape (n,).
        lengths_m: shape (n,).
        lanes: lane indices, 0 the outermost one, shape (n,).
    """

    time_s: float
    names: tuple[str, ...]
    positions_m: FloatArray
    lateral_m: FloatArray
    headings_deg: FloatArray
    speeds_m_s: FloatArray
    accelerations_m_s2: FloatArray
    lengths_m: FloatArray
    lanes: FloatArray


def step_options(step_s: float) -> tuple[str, ...]:
    """Return SUMO's command line for steps that end exactly where the plant is; see `TrafficSimulation`."""
    return (
        *("--step-length", f"{step_s:g}", "--step-method.ballistic", "true"),
        *("--time-to-teleport", "-1", "--no-step-log", "true", "--no-warnings", "true"),
        *("--lanechange.duration", "2", "--collision.action", "warn"),
        *("--collision.check-junctions", "true", "--collision.mingap-factor", "0"),
    )


class TrafficSimulation:
    """SUMO, step by step, to be closed in the end.

    Attributes:
        network: what is driven in.
        ego: the ego vehicle.
        watched: names of the vehicles whose collisions are noted.
        collisions: of these vehicles, as SUMO has noticed, junctions and crossings included.
        start_s: SUMO's time at trip time 0.
        after_step: called after every step.

    With the ego vehicle in it, the simulation waits at trip time 0 until `move_ego` sets the position of the
    ego vehicle.
    """

    def __init__(
        self,
        network: Network,
        demand: Path | None,
        step_s: float,
        *,
        with_ego: bool = True,
        fcd: Path | None = None,
    ) -> None:
        """Start SUMO and let the traffic drive up to trip time 0.

        Args:
            network: what is driven in.
            demand: vehicles, see `iptm_traffic.demand`; None for the demand of the network.
            step_s: SUMO's step.
            with_ego: put the ego vehicle in.
            fcd: where SUMO writes what every vehicle does, its floating car data; None for nowhere.

        Raises:
            ScenarioError: SUMO does not start, or has no room for the ego vehicle.
        """
        self.network = network
        self._step_s = step_s
        self._process = SumoProcess(
            [
                *network.options,
                *(() if demand is None else ("-r", str(demand), "--seed", "1")),
                *step_options(step_s),
                *(() if fcd is None else ("--fcd-output", str(fcd), "--precision", "6")),
            ]
        )
        self.connection = self._process.connection
        self._vehicle = self.connection.vehicle
        self._steps = 0
        self.ego = MovedCar(EGO, self._vehicle, network.road)
        self.after_step: Callable[[], None] = lambda: None
        self.watched, self.collisions = {EGO}, list[str]()
        self._departed: list[str] = []
        try:
            self._warm_up(with_ego=with_ego)
        except self._process.refusal as reason:
            self.close()
            raise ScenarioError(f"SUMO refuses the ego vehicle: {reason}") from reason
        except BaseException:
            self.close()
            raise
        self.start_s = float(self.connection.simulation.getTime())

    def close(self) -> None:
        """End SUMO."""
        self._process.close()

    def _warm_up(self, *, with_ego: bool) -> None:
        # The step that ends at trip time 0 puts the standing cars in.
        until_s = self.network.start_s - (0.5 + with_ego) * self._step_s
        while self.connection.simulation.getTime() < until_s:
            self._process.step()
            if not with_ego:
                self.main_road_places()
        if not with_ego:
            return
        vehicle, network = self._vehicle, self.network
        if network.instead_of:
            vehicle.remove(network.instead_of)
        self.connection.route.add("ego_route", network.edges)
        vehicle.add(
            EGO,
            "ego_route",
            typeID=EGO_KIND,
            depart="now",
            departLane=network.way[0].from_lane.rpartition("_")[2],
            departPos=f"{network.start_m:g}",
            departSpeed="0",
        )
        self.ego.hold()
        vehicle.setSpeed(EGO, 0.0)
        latest_s = network.start_s + LONGEST_WAIT_S
        while EGO not in vehicle.getIDList():
            if self.connection.simulation.getTime() >= latest_s:
                raise ScenarioError(
                    f"SUMO finds no room for the ego vehicle at the start of its way for {LONGEST_WAIT_S:g} s"
                )
            self._process.step()
        vehicle.subscribeContext(
            EGO,
            _VEHICLES,
            RADIO_RANGE_M,
            [*(_SPEED, _POSITION, _ANGLE, _LENGTH, _LANE_INDEX, _ACCELERATION), *_ON_LANE],
        )

    @property
    def processor_s(self) -> float:
        """Processor time that SUMO has used so far, in s."""
        return self._process.processor_s

    @property
    def time_s(self) -> float:
        """Trip time."""
        return self._steps * self._step_s

    def step(self) -> None:
        """Let a step pass."""
        self._process.step()
        self._steps += 1
        self._departed += self.connection.simulation.getDepartedIDList()
        for met in self.connection.simulation.getCollisions():
            if self.watched & {met.collider, met.victim}:
                self.collisions.append(
                    f"{met.collider} met {met.victim} on {met.lane} at {self.time_s:g} s"
                )
        self.after_step()

    def departed(self) -> list[str]:
        """Return the vehicles that have entered in steps since this was last asked for."""
        names, self._departed = self._departed, []
        return names

    def main_road_places(self) -> list[tuple[str, tuple[float, float]]]:
        """Return where the vehicles of the main road are that have been subscribed to; for rehearsals."""
        for name in self.connection.simulation.getDepartedIDList():
            if name.startswith(MAIN_NAMES):
                self._vehicle.subscribe(name, [_POSITION])
        found = self._vehicle.getAllSubscriptionResults()
        return [(name, values[_POSITION]) for name, values in found.items()]

    def move_ego(self, ego: EgoMotion, duration_s: float) -> None:
        """Let an interval pass in which the ego vehicle moves as its plant has moved; see `move`."""
        self.move([(self.ego, ego)], duration_s)

    def move(self, cars: Sequence[tuple[MovedCar, EgoMotion]], duration_s: float) -> None:
        """Let an interval pass in which cars move as their plants have moved.

        SUMO's ballistic step covers the mean of the speeds at its two ends. The speed at its beginning is set
        to what leads exactly to the plant's position, so nothing adds up, wherever a car halts between.

        Args:
            cars: with where they are at the end of the interval.
            duration_s: length of the interval, a whole number of SUMO's steps.
        """
        count = round(duration_s / self._step_s)
        starts = [(car.position_m, car.speed_m_s) for car, _ in cars]
        for number in range(1, count + 1):
            at_s = number * self._step_s
            for (car, end), (start_m, speed) in zip(cars, starts, strict=True):
                moved_m = end.position_m - start_m
                target_m, target_speed = (
                    (moved_m, end.speed_m_s)
                    if number == count
                    else _inside(speed, end.speed_m_s, moved_m, duration_s, at_s)
                )
                car.aim(start_m + target_m, target_speed, self._step_s)
            self.step()
        for car, end in cars:
            car.position_m = end.position_m
            deviation_m = abs(car.sumo_position_m() - end.position_m)
            car.largest_deviation_m = max(car.largest_deviation_m, deviation_m)

    def on_lanes(self) -> list[tuple[str, str, float, float, float]]:
        """Return name, lane, position on it, speed and length of the vehicles around the ego, by name."""
        around = dict(self._vehicle.getContextSubscriptionResults(EGO) or {})
        around.pop(EGO, None)
        return [
            (name, *(around[name][key] for key in (*_ON_LANE, _SPEED, _LENGTH)))
            for name in sorted(around)
        ]

    def neighbours(self) -> SumoNeighbours:
        """Return the vehicles around the ego vehicle."""
        around = dict(self._vehicle.getContextSubscriptionResults(EGO) or {})
        around.pop(EGO, None)
        names = tuple(sorted(around))
        rows = [around[name] for name in names]

        def column(key: int) -> FloatArray:
            return np.array([row[key] for row in rows], dtype=np.float64)

        places = np.array([row[_POSITION] for row in rows], dtype=np.float64).reshape(-1, 2)
        along, aside = self.network.road.along_and_aside_m(
            places[:, 0], places[:, 1], self.ego.position_m
        )
        return SumoNeighbours(
            self.time_s,
            names,
            along,
            aside,
            column(_ANGLE),
            np.maximum(column(_SPEED), 0.0),
            column(_ACCELERATION),
            column(_LENGTH),
            column(_LANE_INDEX),
        )

    def change_lane(self, name: str, lane: int, duration_s: float) -> None:
        """Command a vehicle to move to a lane and to stay there for a while."""
        self._vehicle.changeLane(name, lane, duration_s)

    def turn_off(self, name: str) -> bool:
        """Command a vehicle of the main road to leave it at the next signal; return whether it can."""
        edges, edge = self.network.edges, self._vehicle.getRoadID(name)
        if edge not in edges[:-1]:
            return False
        try:
            self._vehicle.changeTarget(name, f"south_out_{edges.index(edge) + 1}")
        except self._process.refusal:
            return False  # too near to the junction, or on a lane from which no one turns off
        return True


def _inside(
    start_speed: float, end_speed: float, moved_m: float, duration_s: float, at_s: float
) -> tuple[float, float]:
    """Return way and speed inside an interval of constant acceleration that may end at a halt."""
    if end_speed > 0.0 or start_speed <= 0.0:
        acceleration = (end_speed - start_speed) / duration_s
    else:
        acceleration = -0.5 * start_speed**2 / max(moved_m, 1e-9)
        at_s = min(at_s, -start_speed / acceleration)
    way_m = at_s * (start_speed + 0.5 * acceleration * at_s)
    return min(way_m, moved_m), max(start_speed + acceleration * at_s, 0.0)
