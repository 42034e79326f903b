"""The bench in steps: car, gateway, vehicle interface, bridge and controller in one process without a clock.

The same parts as in real time, with the same rates and noise. A decision follows the first measurement of the
range sensor at its tick or later, and is there with the next step of the inner loop.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from iptm.trip import Trip
from iptm_controller.controller import MpcController
from iptm_controller.measurements import Measurements
from iptm_controller.node_reports import plan_trajectory
from iptm_controller.node_ticks import FLAT_ROAD
from iptm_core.decision_record import DrivingMode
from iptm_core.lead_track import RangeTrack
from iptm_core.state import NS_PER_S, PlantObservation
from iptm_v2x_bridge.range_sensor import RangeSensorBridge
from iptm_vehicle_interface.authority import report_frame
from iptm_vehicle_interface.bench_car import STEP_S, BenchCar
from iptm_vehicle_interface.bus import Frame
from iptm_vehicle_interface.driving import Driver, controller_limits
from iptm_vehicle_interface.gateway import Gateway
from iptm_vehicle_interface.vehicle import load_vehicle
from iptm_vehicle_interface.vehicle_state import LEADER

STEPS_OF_LOOP = 2
"""Steps of the car between two of gateway and inner loop."""


class BenchInSteps:
    """The processes of the bench without their processes."""

    def __init__(self, cycle: str, strategy: str, press: tuple[str, float, float, float]) -> None:
        """Set up a drive behind a range sensor.

        Args:
            press: of the enable button, see `BenchCar`.
        """
        vehicle = load_vehicle("bench")
        trip = Trip.of(
            cycle,
            strategy=strategy,
            preview_mode="none",
            parameter_set=vehicle.parameter_set,
            overrides=controller_limits(vehicle),
        )
        # Like a car without navigation, it is not told when the trip ends.
        options = trip.controller.options(trip.conditions.period_s, math.inf)
        self._controller = MpcController(trip.controller_parameters, options)
        self.car = BenchCar(vehicle, cycle, [press])
        self._gateway, self._driver = Gateway(vehicle), Driver(vehicle)
        self._radar = vehicle.signals["gap_m"].message
        self._bridge = RangeSensorBridge()
        self._waiting: PlantObservation | None = None

    def drive(self, duration_s: float) -> dict[str, Any]:
        """Drive for a while; return what the car saw, see `CarLog`."""
        for step in range(1, round(duration_s / STEP_S) + 1):
            now_ns = round(step * STEP_S * NS_PER_S)
            self.car.advance()
            self._hear_car(now_ns)
            if step % STEPS_OF_LOOP == 0:
                self._step(now_ns)
        return vars(self.car.log)

    def _hear_car(self, now_ns: int) -> None:
        now_s, signals = now_ns / NS_PER_S, self._driver.signals
        for _, frame_id, data in self.car.frames():
            if not self._gateway.from_car(frame_id, data, now_s):
                continue
            self._driver.receive(Frame(*report_frame(self._gateway.report), now_s))
            if self._driver.receive(Frame(frame_id, data, now_s)) == self._radar:
                gap_m, relative_m_s, seen = (signals.value(name, now_s) for name in LEADER)
                track = RangeTrack(gap_m, 0.0, relative_m_s)
                self._bridge.take(now_ns, (track,) if seen else ())

    def _step(self, now_ns: int) -> None:
        now_s = now_ns / NS_PER_S
        if now_ns % NS_PER_S == 0:
            self._waiting = self._driver.measured(now_s, now_s)
        self._decide()
        for frame_id, data in self._driver.step(now_s):
            self._gateway.from_suite(frame_id, data, now_s)
        for frame_id, data in self._gateway.frames(now_s):
            self.car.receive(frame_id, data)
        self._driver.receive(Frame(*report_frame(self._gateway.report), now_s))

    def _decide(self) -> None:
        if self._waiting is None:
            return
        state, pack = self._waiting.state, self._waiting.pack_reading
        tick_ns = round(state.time_s * NS_PER_S)
        if not self._bridge.has_measured(tick_ns):
            return
        answer = self._bridge.answer(tick_ns, state.position_m, state.speed_m_s)
        engaged = self._driver.engagement.mode is DrivingMode.ENGAGED
        measured = Measurements(state, answer.leader, answer.preview, FLAT_ROAD, pack=pack)
        decision = self._controller.decide(replace(measured, is_followed=engaged))
        plan = plan_trajectory(decision.plan)
        columns = plan.times_s, plan.speeds_m_s, plan.accelerations_m_s2
        self._driver.follow(state.time_s, columns, decision.command)
        self._waiting = None
