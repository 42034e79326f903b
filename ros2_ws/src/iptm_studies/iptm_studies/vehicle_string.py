"""A string of vehicles without ROS: each follows the one before, whose plan of a tick is its preview.

What a vehicle does depends on those ahead only. So the trips are driven one after the other, from the first
vehicle to the last, and give the numbers of vehicles that drive at the same time in lock-step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_core.routes.route import Route
from iptm_core.settings import VEHICLE_LENGTH_M, PreviewSettings
from iptm_core.state import NS_PER_S, VehicleState
from iptm_core.vehicle_string import vehicles_in_string
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop
from iptm_v2x_bridge.vehicle_ahead import VehicleAhead

_NO_PLAN = np.empty((3, 0))


def run_string(
    route: Route,
    vehicles: int,
    plant: Plant,
    make_controller: Callable[[], Controller],
    preview: PreviewSettings | None = None,
    length_m: float = VEHICLE_LENGTH_M,
) -> Iterable[ClosedLoopRun]:
    """Drive a string of equal vehicles along a route, from standstill.

    Args:
        route: the driving cycle ahead of the first vehicle, slope and length of the trip.
        vehicles: how many.
        plant: the simulated vehicle; with the same slope.
        make_controller: returns a fresh controller.
        preview: length and imperfections of the previews, those by plans included.
        length_m: of every vehicle, front to rear bumper.

    Yields:
        The trip of each vehicle, the first one first.
    """
    ahead: VehicleAhead | None = None
    gap_m = plant.parameters.gap.initial_gap_m
    for vehicle in vehicles_in_string(vehicles, gap_m, length_m):
        vehicle_ahead = VehicleAhead(length_m)

        def note_tick(
            _: int,
            measured: Measurements,
            decision: Decision,
            vehicle_ahead: VehicleAhead = vehicle_ahead,
        ) -> None:
            if measured.state is not None:
                _note_tick(vehicle_ahead, measured.state, decision)

        run = run_closed_loop(
            route,
            plant,
            make_controller(),
            preview,
            on_tick=note_tick,
            leader=ahead,
            start_position_m=vehicle.start_position_m,
        )
        _note_tick(vehicle_ahead, run.steps[-1].state, None)
        yield run
        ahead = vehicle_ahead


def _note_tick(vehicle_ahead: VehicleAhead, state: VehicleState, decision: Decision | None) -> None:
    """Pass the state and the plan of a tick to the vehicle behind, as the nodes publish them."""
    stamp_ns = round(state.time_s * NS_PER_S)
    vehicle_ahead.note_state(stamp_ns, state.position_m, state.speed_m_s)
    plan = None if decision is None else decision.plan
    vehicle_ahead.note_plan(stamp_ns, *(_NO_PLAN if plan is None else plan.motion))
