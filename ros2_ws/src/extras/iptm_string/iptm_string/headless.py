"""A string of vehicles without ROS: each follows the one before, whose plan of a tick is its preview.

What a vehicle does depends on those ahead only. So the trips are driven one after the other, from the first
vehicle to the last, and give the numbers of vehicles that drive at the same time in lock-step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
import pandas as pd

from iptm.closed_loop import ClosedLoopRun, TickController, run_closed_loop
from iptm.driving import controller_for, plant_for
from iptm.run import Run
from iptm.trip import Trip
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.route import Route
from iptm_core.settings import VEHICLE_LENGTH_M, PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray, VehicleState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant
from iptm_string.order import vehicles_in_string
from iptm_v2x_bridge.range_sensor import VehicleAhead

_NO_PLAN = np.empty((3, 0))


def run_string(
    route: Route,
    vehicles: int,
    plant: Plant,
    make_controller: Callable[[], TickController],
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
        _note_tick(vehicle_ahead, run.last.state, None)
        yield run
        ahead = vehicle_ahead


def _note_tick(vehicle_ahead: VehicleAhead, state: VehicleState, decision: Decision | None) -> None:
    """Pass the state and the plan of a tick to the vehicle behind, as the nodes publish them."""
    stamp_ns = round(state.time_s * NS_PER_S)
    vehicle_ahead.note_state(stamp_ns, state.position_m, state.speed_m_s)
    plan = None if decision is None else decision.plan
    vehicle_ahead.note_plan(stamp_ns, *(_NO_PLAN if plan is None else plan.motion))


RATIOS = ["speed_m_s", "acceleration_m_s2", "peak_acceleration_m_s2", "gap_m"]
"""Deviations that a member of a string may have more or less of than the member ahead."""


def deviations_along(
    trajectories: Sequence[Trajectory], parameters: ModelParameters
) -> pd.DataFrame:
    """Return how far the leader of the first vehicle and every vehicle depart from steady driving.

    Args:
        trajectories: of the vehicles, the first one first; at least one.
        parameters: of every vehicle.

    Returns:
        A row per member of the string, the leader of the first vehicle first: ``speed_m_s`` (standard
        deviation), ``acceleration_m_s2`` (root mean square), ``peak_acceleration_m_s2`` (largest magnitude),
        and of the vehicles only ``gap_m`` (standard deviation), ``smallest_margin_m`` (smallest distance of
        the gap from its lower limit) and ``largest_gap_m``.
    """
    first = trajectories[0]
    leader_m_s2 = np.diff(first.leader_speed_m_s) / np.diff(first.time_s)
    rows = [_of_motion(first.leader_speed_m_s, leader_m_s2)]
    rows += (
        _of_motion(run.speed_m_s, run.acceleration_m_s2[1:])
        | {
            "gap_m": float(np.std(run.gap_m[run.has_leader])),
            "smallest_margin_m": float(np.nanmin(gap_margins_m(run, parameters))),
            "largest_gap_m": float(np.nanmax(run.gap_m)),
        }
        for run in trajectories
    )
    return pd.DataFrame(rows)


def _of_motion(speeds_m_s: FloatArray, accelerations_m_s2: FloatArray) -> dict[str, float]:
    return {
        "speed_m_s": float(np.std(speeds_m_s)),
        "acceleration_m_s2": float(np.sqrt(np.mean(accelerations_m_s2**2))),
        "peak_acceleration_m_s2": float(np.max(np.abs(accelerations_m_s2))),
    }


def amplification(deviations: pd.DataFrame) -> pd.DataFrame:
    """Return the `RATIOS` to the member ahead: below 1 a disturbance fades, above 1 it grows.

    A ratio is NaN where the member ahead does not deviate, or has no such quantity.
    """
    ahead = deviations[RATIOS].shift()
    return deviations[RATIOS] / ahead.where(ahead != 0.0)


def drive_string_in_memory(trip: Trip, count: int, drivers: Sequence[Trip] = ()) -> Iterator[Run]:
    """Drive a string of equal vehicles without ROS and yield the run of each, the first one first.

    Args:
        drivers: trips whose controllers drive, one per vehicle; the one of ``trip`` without them.
    """
    drivers = drivers or [trip] * count
    pending = iter(drivers)
    string = run_string(
        trip.route,
        count,
        plant_for(trip),
        lambda: controller_for(next(pending)),
        trip.preview,
        trip.leader.leader_length_m,
    )
    for each, driver in zip(string, drivers, strict=True):
        yield Run(
            name=driver.heading,
            settings=driver.settings,
            parameters=trip.parameters,
            trajectory=each.trajectory,
            decisions=each.decisions,
            slope=trip.route.slope,
            trip=trip,
            warnings=trip.notes,
        )
