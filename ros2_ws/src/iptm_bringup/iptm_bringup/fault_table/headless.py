"""Trips without ROS: the same faults and measures, a thousand times faster."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from iptm_bringup.fault_table.catalogue import PlannedTrip
from iptm_bringup.fault_table.observed import FaultInterval, ObservedTrip, StatusReport
from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.node_reports import Road, situation
from iptm_controller.node_watch import OperatorWatch
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend
from iptm_core.decision_record import Rung
from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory
from iptm_faults.fault import Fault
from iptm_faults.injection import FaultInjection
from iptm_faults.solver import FaultyController
from iptm_faults.vehicle import FaultyPlant
from iptm_interfaces.topics import CONTROLLER
from iptm_studies.closed_loop import run_closed_loop
from iptm_studies.random_cars.bounds import BoolArray

PARAMETERS = load_parameters().values


class HeadlessDriver:
    """Drives trips one after the other with one stateless solver."""

    def __init__(self) -> None:
        self._backend: SolverBackend = build_solver(
            ControllerOptions().horizon, PARAMETERS, ControllerOptions().solver
        )

    def drive(self, plan: PlannedTrip, faults: Iterable[Fault] | None = None) -> ObservedTrip:
        """Drive a trip.

        Args:
            plan: the trip.
            faults: those of the plan by default; none for the fault-free run.
        """
        chosen = plan.faults if faults is None else tuple(faults)
        options = ControllerOptions(trip_duration_s=plan.route.duration_s)
        sound = Controller(PARAMETERS, options, self._backend)
        controller = FaultyController(PARAMETERS, sound, chosen, lambda _: None)
        watch = OperatorWatch(PARAMETERS, ControllerNodeParameters())
        reports: list[StatusReport] = []
        rungs: dict[float, Rung] = {}

        def note(tick: int, measured: Measurements, decision: Decision) -> None:
            watch.update(measured, decision)
            level, reason = situation(decision, Road(known=True), watch)
            last = reports[-1] if reports else None
            if last is None or (last.level, last.reason) != (level, reason):
                reports.append(StatusReport(float(tick), CONTROLLER, level, reason))
            rungs[float(tick)] = decision.rung

        plant = FaultyPlant(chosen, PARAMETERS, plan.route.slope.slope_at)
        injection = FaultInjection(chosen)
        run = run_closed_loop(
            plan.route,
            plant,
            controller,
            on_tick=note,
            disturb=injection.disturb,
            sampled=injection.sampled,
        )
        return ObservedTrip(
            plan,
            PARAMETERS,
            run.trajectory,
            leader_apart(plan, run.trajectory),
            rungs,
            reports,
            [FaultInterval(fault.start_s, fault.end_s) for _, fault in plan.entries],
        )


def leader_apart(plan: PlannedTrip, trajectory: Trajectory) -> BoolArray:
    """Return the rows in which the effective leader is not where the leader of the route is."""
    own: FloatArray = plan.route.leader.positions_at(trajectory.time_s)
    return np.abs(trajectory.leader_position_m - own) > 1e-6
