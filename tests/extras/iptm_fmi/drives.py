"""Trips of the suite, recorded tick by tick, to drive FMUs through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tests.extras.iptm_fmi.master import Instance

import iptm
from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.measurements import Measurements
from iptm_controller.ocp.data import SLOPE_DIFFERENCE_M
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import Command, FloatArray
from iptm_fmi.unit import ROAD_ROOM
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

STATES = {
    "position": "position_m",
    "speed": "speed_m_s",
    "acceleration": "acceleration_m_s2",
    "compressor_power": "compressor_power_w",
    "cell_1_temperature": "cell_1_temperature_k",
    "cell_n_temperature": "cell_n_temperature_k",
    "cell_1_capacity_loss": "cell_1_capacity_loss",
    "cell_n_capacity_loss": "cell_n_capacity_loss",
    "state_of_charge": "state_of_charge",
}


@dataclass(frozen=True)
class Recorded:
    """A trip of the suite.

    Attributes:
        commands: of every interval.
        steps: at the end of every interval.
        measured: what the controller was given at every tick.
        foreseen_1_s: aging rate that it expected at the start.
    """

    trip: iptm.Trip
    commands: list[Command]
    steps: list[PlantStep]
    measured: list[Measurements]
    foreseen_1_s: float

    @property
    def parameters(self) -> ModelParameters:
        """Parameters of the vehicle."""
        return self.trip.parameters

    def road(self, position_m: float) -> dict[str, Any]:
        """Return the inputs of the road from a position on."""
        return road_inputs(self.trip.route.slope, position_m)


def road_inputs(slope: Any, position_m: float) -> dict[str, Any]:
    """Return the nodes of a road from where the controller looks back to, which is behind a position."""
    first = max(
        int(np.searchsorted(slope.positions_m, position_m - SLOPE_DIFFERENCE_M, side="right")) - 1,
        0,
    )
    part = slice(first, first + ROAD_ROOM)
    nodes: FloatArray = slope.positions_m[part]
    return {
        "road_nodes": float(nodes.size),
        "road_position": nodes,
        "road_slope": slope.slopes_rad[part],
    }


def recorded(cycle: str, vehicle: str = "paper_calibrated", **settings: Any) -> Recorded:
    """Drive a trip by the controller of the suite, its safety monitor off."""
    trip = iptm.Trip.of(cycle, vehicle=vehicle, **settings)
    commands: list[Command] = []
    steps: list[PlantStep] = []
    measured: list[Measurements] = []

    class Recording(Plant):
        def advance(self, state: Any, command: Command, duration_s: float = 1.0) -> PlantStep:
            step = super().advance(state, command, duration_s)
            commands.append(command)
            steps.append(step)
            return step

        def watch(self, *_: Any) -> None:
            """Leave the monitor off."""

    controller = MpcController(trip.controller_parameters, trip.options)
    run_closed_loop(
        trip.route,
        Recording(trip.parameters, trip.route.slope.slope_at),
        controller,
        on_tick=lambda _, given, __: measured.append(given),
    )
    return Recorded(trip, commands, steps, measured, controller.memory.foreseen_1_s)


def closed(
    folder: Path,
    version: int,
    trip: Recorded,
    step: Callable[[Instance, float], None] = Instance.step,
) -> tuple[float, float, int]:
    """Close controller and plant; return energy at the battery, ageing of cell N, and ticks not optimal."""
    names = [name for name in STATES if name != "state_of_charge"]
    starts = {"foreseen_aging_rate": trip.foreseen_1_s}
    with (
        Instance(folder / f"plant_{version}.fmu") as plant,
        Instance(folder / f"controller_{version}.fmu", starts) as controller,
    ):
        state, others = plant.get(*names), 0
        for tick, given in enumerate(trip.measured):
            preview, leader = given.preview, given.leader
            assert leader is not None
            road = trip.road(state[0])
            controller.put(
                **dict(zip(names, state, strict=True)),
                leader_position=leader.position_m,
                leader_speed=leader.speed_m_s,
                preview_nodes=preview.times_s.size,
                preview_time=preview.times_s,
                preview_position=preview.positions_m,
                preview_speed=preview.speeds_m_s,
                **road,
            )
            step(controller, float(tick))
            acceleration, power, rung = controller.get(
                "acceleration_command", "compressor_power_command", "rung"
            )
            others += rung != 0.0
            plant.put(acceleration_command=acceleration, compressor_power_command=power, **road)
            step(plant, float(tick))
            state = plant.get(*names)
        return *plant.get("battery_energy", "cell_n_capacity_loss"), others
