"""Drives trips in memory; `simulate` is the short spelling for notebooks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

from iptm.closed_loop import LeaderOnly, TickController, closed_loop, decided
from iptm.faults.injection import FaultInjection, FaultyController, check_headless, faulty
from iptm.own_parts import Controller, OwnController, PredictedSource, Predictor, check_part
from iptm.run import Report, Reporter, Run, following_notes
from iptm.trip import Trip
from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.errors import ScenarioError
from iptm_core.program import no_full_collections
from iptm_core.settings import LeaderSource, TripSettings
from iptm_core.state import LeaderState
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_kinds import plant_kind
from iptm_v2x_bridge.rules_of_the_road import road_bridge

_EVERY_S = 0.5
_QUIET_S = 2.0

HEADLESS_LEADERS = (LeaderSource.CYCLE, LeaderSource.NONE)
NOTICED_SHARE = 0.95
"""Brakes that deliver less of the request count as weak."""
_OWN = "own"

OnTick = Callable[[int, Measurements, Decision], None]
OnStep = Callable[[PlantStep, LeaderState | None], None]


@no_full_collections()
def drive_in_memory(
    trip: Trip,
    *,
    controller: Controller | None = None,
    predictor: Predictor | None = None,
    aging_law: AgingLaw | None = None,
    on_tick: OnTick | None = None,
    on_step: OnStep | None = None,
) -> Run:
    """Drive a trip without ROS.

    Args:
        trip: the trip to drive.
        controller: drives instead of the controller of the suite, see `Controller`.
        predictor: predicts the lead vehicle for the controller instead of its true future, see `Predictor`.
        aging_law: ageing law of the controller's cost instead of the one that the trip names.
        on_tick: called after every decision with the tick, its measurements and its decision.
        on_step: called with vehicle and leader, if there is one, at every instant, the last one included.

    Raises:
        IptmError: the trip cannot be driven; the message states the value and the allowed ones.
    """
    check_part("controller", controller, Controller, "decide")
    check_part("predictor", predictor, Predictor, "predict")
    ticks = trip_in_ticks(trip, predictor=predictor, on_tick=on_tick, on_step=on_step)
    driver: TickController = (
        controller_for(trip, aging_law)
        if controller is None
        else OwnController(controller, trip.parameters.limits, trip.conditions.period_s)
    )
    return _with_own_parts(decided(ticks, driver), controller, predictor, aging_law)


def trip_in_ticks(
    trip: Trip,
    *,
    predictor: Predictor | None = None,
    on_tick: OnTick | None = None,
    on_step: OnStep | None = None,
) -> Generator[Measurements, Decision, Run]:
    """Return a drive that waits for a decision at every tick; see `drive_in_memory`.

    Returns:
        A generator: it yields measurements, is sent the decision on them, and returns the run.
    """
    check_in_memory(trip)
    return _ticks(trip, predictor, on_tick, on_step)


def _ticks(
    trip: Trip, predictor: Predictor | None, on_tick: OnTick | None, on_step: OnStep | None
) -> Generator[Measurements, Decision, Run]:
    began_s = time.perf_counter()
    plant, route, conditions = plant_for(trip), trip.route, trip.conditions
    source = None if predictor is None else PredictedSource(route, predictor)
    around, bridge = road_bridge(trip.rules, route, trip.parameters, trip.preview, source)
    reports: list[Report] = []
    of_vehicle: list[Report] = []

    def note(tick: int, measured: Measurements, decision: Decision) -> None:
        if on_tick is not None:
            on_tick(tick, measured, decision)
        if decision.reason != (reports[-1].text if reports else ""):
            reports.append(Report(tick * conditions.period_s, Reporter.CONTROLLER, decision.reason))

    def observe(step: PlantStep, leader: LeaderState | None) -> None:
        if on_step is not None:
            on_step(step, leader)
        report = vehicle_report(step, of_vehicle[-1].text if of_vehicle else "")
        if report is not None:
            of_vehicle.append(report)

    loop = yield from closed_loop(
        route,
        plant,
        conditions.period_s,
        bridge,
        LeaderOnly(around),
        plant.initial_state(trip.vehicle.start_position_m),
        note,
        FaultInjection(conditions.faults) if conditions.faults else None,
        observe,
    )
    return Run(
        name=trip.heading,
        settings=trip.settings,
        parameters=trip.parameters,
        trajectory=loop.trajectory,
        decisions=loop.decisions,
        slope=route.slope,
        trip=trip,
        reports=(*reports, *of_vehicle),
        wall_time_s=time.perf_counter() - began_s,
        problems=(f"the trip ended early, {loop.ended}",) if loop.ended else (),
        warnings=(
            *trip.notes,
            *plant.notes,
            *following_notes(loop.trajectory, trip.parameters),
        ),
    )


def check_in_memory(trip: Trip) -> Trip:
    """Return a trip that can be driven in memory.

    Raises:
        ScenarioError: it cannot, or its parts do not fit together.
    """
    source = trip.leader.leader_source
    if source not in HEADLESS_LEADERS:
        raise ScenarioError(
            f"leader_source is {source}; allowed in memory: {', '.join(HEADLESS_LEADERS)}"
        )
    check_headless(trip.conditions.faults)
    return trip.checked()


def plant_for(trip: Trip) -> Plant:
    """Return the vehicle of a trip."""
    slope_at, vehicle = trip.route.slope.slope_at, trip.vehicle
    detail = vehicle.integration_step_s, vehicle.thermal_model, vehicle
    kind = plant_kind(vehicle.plant)
    if trip.conditions.faults:
        return faulty(kind)(trip.conditions.faults, trip.parameters, slope_at, *detail)
    return kind(trip.parameters, slope_at, *detail)


def controller_for(trip: Trip, own_law: AgingLaw | None = None) -> TickController:
    """Return a fresh controller of a trip, its problem compiled, with another ageing law if one is given."""
    model, faults = trip.controller_parameters, trip.conditions.faults
    controller = MpcController(model, replace(trip.options, own_law=own_law))
    return FaultyController(model, controller, faults, lambda _: None) if faults else controller


def vehicle_report(step: PlantStep, last: str) -> Report | None:
    """Return what safety monitor and brakes report at an instant; None where it is the same as before.

    Args:
        last: text of the report before, empty for none.
    """
    texts, share = [], step.safety.brake_share
    if step.safety.service_braking_s > 0.0:
        texts.append(f"service braking: {step.memory.reason}")
    if share < NOTICED_SHARE:
        texts.append(f"brakes deliver {100.0 * share:.0f} %")
    text = ", ".join(texts)
    if text == last:
        return None
    return Report(step.state.time_s, Reporter.VEHICLE, text, share < NOTICED_SHARE)


def _with_own_parts(
    run: Run,
    controller: Controller | None,
    predictor: Predictor | None,
    aging_law: AgingLaw | None,
) -> Run:
    """Return a run with the user's own parts in its name and settings."""
    if controller is not None:
        trip = run.trip
        if trip is None:
            raise AssertionError("a run that was driven has a trip")
        # Strategy and horizon belong to the controller that did not drive.
        planned = f", {trip.controller.horizon}, {trip.controller.strategy}"
        run = replace(run, name=run.name.replace(planned, ""))
        own = dict.fromkeys(("strategy", "horizon"), _OWN)
        run = run.labelled(f"controller {type(controller).__name__}", own)
    if aging_law is not None:
        run = run.labelled(f"law {aging_law.name}", {"aging_law": aging_law.name})
    if predictor is not None:
        name = type(predictor).__name__
        run = run.labelled(f"predictor {name}", {"predictor": name})
    return run


def simulate(
    cycle: Any = TripSettings.cycle,
    *,
    vehicle: Any = None,
    aging_law: Any = None,
    controller: Controller | None = None,
    predictor: Predictor | None = None,
    **settings: Any,
) -> Run:
    """Drive a trip behind a lead vehicle, without ROS: ``drive(Trip.of(cycle, **settings))``.

    The defaults match ``scripts/run_demo``, and both give the same commands. On a terminal and in a
    notebook a line shows how far a longer drive has come.

    Args:
        cycle: what the lead vehicle drives: a name such as ``wltc_class3b``, the path of a drive (CSV, GPX,
            SUMO, bag), a DataFrame or mapping with ``time_s`` and one of ``speed_m_s``, ``speed_kmh`` and
            ``speed_mph``, optionally ``elevation_m`` or ``slope_percent``, or a pair of times (s) and speeds
            (m/s).
        vehicle: a car or parameter set by name or path, `Vehicle`, `ModelParameters`, or a mapping of dotted
            keys and numbers, with ``base`` for a set other than the default.
        aging_law: law of the controller's cost: ``paper``, a cell such as ``nca``, or an `AgingLaw`.
        controller: drives instead of the controller of the suite, see `Controller`; strategy and horizon then
            do not count.
        predictor: predicts the lead vehicle for the controller instead of its true future, see `Predictor`.
        settings: all other settings of a trip by their names: ``strategy`` (a name, a `Strategy` or a
            mapping of ``base`` and weights), ``horizon``, ``overrides`` (parameters by dotted key),
            ``climate`` (a name or degC), ``slope``, ``duration_s``, ``latency_s``, ``leader_source``,
            ``faults`` ...

    Returns:
        The finished run.

    Raises:
        IptmError: an argument is not usable; the message states the value and the allowed ones.
    """
    own_law = aging_law if isinstance(aging_law, AgingLaw) else None
    named = {} if own_law is not None or aging_law is None else {"aging_law": aging_law}
    if vehicle is not None:
        named["vehicle"] = vehicle
    trip = Trip.of(cycle, **settings, **named)
    ticks = round(trip.route.duration_s / trip.conditions.period_s)
    with ProgressLine(trip.heading, ticks + 1) as line:
        return drive_in_memory(
            trip, controller=controller, predictor=predictor, aging_law=own_law, on_step=line.step
        )


class ProgressLine(AbstractContextManager["ProgressLine"]):
    """A line on standard error, on terminals and in notebooks only; use it as a context manager.

    A drive that is over in two seconds shows nothing.
    """

    def __init__(self, name: str, steps: int) -> None:
        self._name, self._steps = name, steps
        in_notebook = type(sys.stderr).__module__.startswith("ipykernel")
        self._is_shown = sys.stderr.isatty() or in_notebook
        self._began_s = self._shown_s = time.monotonic()
        self._first_s = self._began_s
        self._done = self._width = 0
        self._write(f"{name}: setting up; a problem of a new kind is compiled once ...")

    def __exit__(self, *error: object) -> None:
        """Clear the line."""
        self._write("")

    def step(self, *_: object) -> None:
        """Count one step."""
        now_s = time.monotonic()
        if not self._done:
            self._first_s = now_s
        self._done += 1
        if now_s - self._began_s < _QUIET_S or now_s - self._shown_s < _EVERY_S:
            return
        self._shown_s = now_s
        left_s = (now_s - self._first_s) / self._done * (self._steps - self._done)
        percent = 100.0 * self._done / self._steps
        self._write(f"{self._name}: {percent:.0f} %, {max(left_s, 0.0):.0f} s left")

    def _write(self, text: str) -> None:
        if self._is_shown:
            sys.stderr.write(f"\r{text:<{self._width}}\r{text}")
            sys.stderr.flush()
            self._width = len(text)
