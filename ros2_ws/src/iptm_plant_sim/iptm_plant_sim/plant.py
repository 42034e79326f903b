"""The simulated vehicle, free of ROS: one command in, the state one interval later out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields

import numpy as np

from iptm_core.braking import (
    GRAVITY_M_S2,
    LEAST_DECELERATION_M_S2,
    SafetyMonitorSettings,
    tyre_deceleration_m_s2,
)
from iptm_core.errors import PackEmptyError, StateError
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.radio_lead import RadioLead
from iptm_core.settings import IntegrationSettings, ThermalModel
from iptm_core.state import (
    ChannelCells,
    Command,
    FloatArray,
    FullChannelState,
    IntervalPowers,
    LeaderPreview,
    SafetyRecord,
    VehicleState,
)
from iptm_plant_sim.actuators import ActuatorReport, Clamp, Motion, limit_command, plan_motion
from iptm_plant_sim.integrator import PackIntegration
from iptm_plant_sim.interval import IntervalResult, PlantStep
from iptm_plant_sim.safety_monitor import MonitorMemory, SafetyMonitor
from iptm_plant_sim.service_braking import MonitoredInterval, RangeSensor, ServiceBrakes

DEFAULT_STEP_S = IntegrationSettings.integration_step_s
"""Keeps each interval's energies and capacity loss within 0.1 %; the kinks set the error, not the order."""
_POWER_BISECTIONS = 40
_TEMPERATURES = ("cell_1_temperature_k", "cell_n_temperature_k", "cells.temperatures_k")
_CAPACITY_LOSSES = ("cell_1_capacity_loss", "cell_n_capacity_loss", "cells.capacity_losses")


class Plant:
    """The vehicle with its pack, exact kinks included, integrated finely over each interval.

    Without a range sensor instances keep no trip state: the same state and command give the same result,
    always. With one, see `watch`, the safety monitor acts in every interval, and its memory, which is part of
    each step, is from the interval before. Instances own evaluation buffers and are not meant to be shared
    between threads.

    Attributes:
        monitor: the safety monitor; it acts only with a range sensor.
        brake_strength: share of every requested deceleration that the brakes deliver, above 0.
        road_friction: coefficient of friction of the road, 0 for one that never limits the brakes.
        notes: what is to be known of a trip with it, a sentence each.
    """

    def __init__(
        self,
        parameters: ModelParameters,
        slope_at: Callable[[FloatArray], FloatArray],
        step_s: float = DEFAULT_STEP_S,
        thermal_model: ThermalModel = IntegrationSettings.thermal_model,
        safety: SafetyMonitorSettings | None = None,
    ) -> None:
        """Set up a vehicle on a road.

        Args:
            slope_at: road slope in rad (positive uphill) at positions in m, shape (n,) to (n,).
            step_s: longest integration step inside an interval.
            thermal_model: which cells of a coolant channel are integrated. With all of them, states are
                `FullChannelState`.
            safety: assumptions of the safety monitor; by default from the settings.

        Raises:
            StateError: the step is not a positive number.
        """
        if not (math.isfinite(step_s) and step_s > 0.0):
            raise StateError(f"integration step is {step_s} s; allowed: positive numbers")
        self.parameters = parameters
        self.monitor = SafetyMonitor(safety or SafetyMonitorSettings(), parameters.brakes)
        self.brake_strength = 1.0
        self.road_friction = 0.0
        self.notes: tuple[str, ...] = ()
        self._sensor: RangeSensor | None = None
        self._memory = MonitorMemory()
        self._heard = LeaderPreview.empty()
        self._slope_at = slope_at
        self._step_s = step_s
        self._pack = PackIntegration(parameters, thermal_model)
        self._has_all_cells = thermal_model is ThermalModel.FULL_CHANNEL

    def watch(self, sensor: RangeSensor | None, memory: MonitorMemory | None = None) -> None:
        """Let the safety monitor watch the vehicle ahead from now on.

        Args:
            sensor: called once at the start of every interval, in order; None for no monitor.
        """
        self._sensor = sensor
        self._heard = LeaderPreview.empty()
        self.resume(memory or MonitorMemory())

    def hear(self, preview: LeaderPreview) -> None:
        """Take the newest preview of the vehicle ahead; the monitor counts on an authenticated one only."""
        self._heard = preview

    def resume(self, memory: MonitorMemory) -> None:
        """Let the safety monitor go on with the memory of the step from which the next one starts."""
        self._memory = memory

    def initial_state(
        self,
        position_m: float = 0.0,
        speed_m_s: float = 0.0,
        cell_n_temperature_k: float | None = None,
    ) -> VehicleState:
        """State at the start of a trip: no acceleration, compressor off, parameters' pack.

        Args:
            cell_n_temperature_k: temperature of cell N_c; by default the parameters' initial temperature,
                which is that of cell 1. The cells between lie evenly.
        """
        initial_k = self.parameters.environment.initial_cell_temperature_k
        loss = self.parameters.aging.initial_capacity_loss
        state = VehicleState(
            time_s=0.0,
            position_m=float(position_m),
            speed_m_s=float(speed_m_s),
            acceleration_m_s2=0.0,
            compressor_power_w=self.parameters.limits.min_compressor_power_w,
            cell_1_temperature_k=float(initial_k),
            cell_n_temperature_k=float(
                initial_k if cell_n_temperature_k is None else cell_n_temperature_k
            ),
            cell_1_capacity_loss=loss,
            cell_n_capacity_loss=loss,
            state_of_charge=self.parameters.charge.initial_charge,
        )
        if self._has_all_cells:
            cells = ChannelCells.between(state, self.parameters.pack.cells_per_channel)
            state = FullChannelState(**vars(state), cells=cells)
        self.check(state)
        return state

    def check(self, state: VehicleState) -> None:
        """Raise a StateError for a state from which no sensible step can be taken."""
        values = {item.name: np.asarray(getattr(state, item.name)) for item in fields(VehicleState)}
        if not self._pack.depends_on_charge:
            del values["state_of_charge"]  # it may be unknown
        if isinstance(state, FullChannelState):
            values |= {f"cells.{name}": array for name, array in vars(state.cells).items()}
        ranges = {
            "speed_m_s": (0.0, self.parameters.limits.max_speed_m_s),
            **dict.fromkeys(_TEMPERATURES, (200.0, 400.0)),
            **dict.fromkeys(_CAPACITY_LOSSES, (1e-9, 0.9)),
        }
        for name, value in values.items():
            low, high = ranges.get(name, (-math.inf, math.inf))
            wrong = value[~(np.isfinite(value) & (low <= value) & (value <= high))]
            if wrong.size:
                raise StateError(f"state: {name} is {wrong[0]}; allowed: {low} to {high}")

    def advance(self, state: VehicleState, command: Command, duration_s: float = 1.0) -> PlantStep:
        """Carry out a command for one interval.

        The command passes the actuator limits, the vehicle moves at constant acceleration until it stops
        or meets its top speed, and the pack follows. Where the safety monitor brakes, the acceleration
        follows the service brakes instead. If the pack cannot deliver the power, the drive gives
        way: the acceleration is cut to the possible one, regardless of the jerk limit.

        Raises:
            StateError: the state leads nowhere (not finite or out of range).
        """
        slope_rad = self._slope_at(np.array([state.position_m])).item()
        brakes = ServiceBrakes(
            self.parameters, self.brake_strength, self._largest_deceleration_m_s2(slope_rad)
        )
        last_m_s2 = brakes.requested_m_s2(state.acceleration_m_s2)
        report = limit_command(
            command, state, self.parameters.limits, duration_s, last_acceleration_m_s2=last_m_s2
        )
        if self._sensor is None or not self.monitor.settings.safety_monitor:
            delivered = brakes.delivered_m_s2(report.actuated.acceleration_m_s2)
            actuated = replace(report.actuated, acceleration_m_s2=delivered)
            return self._drive_interval(state, replace(report, actuated=actuated), duration_s)
        driven = self.monitor, brakes, self._drive_interval, state, report, duration_s, slope_rad
        memory, heard = self._memory, None
        if self.monitor.settings.authenticated_radio:
            heard = RadioLead.of(self._heard, state.time_s)
        before = memory.radio
        counts = heard is not None and before is not None and heard.follows(before)
        if heard is not None:
            memory = replace(memory, radio=heard)
        interval = MonitoredInterval(*driven, heard if counts else None)
        step = interval.drive(memory, self._sensor(state))
        self._memory = step.memory
        return step

    def _largest_deceleration_m_s2(self, slope_rad: float) -> float:
        """Return the largest deceleration that brakes, tyres and slope permit."""
        force_m_s2 = self.parameters.brakes.max_deceleration_m_s2
        if self.road_friction > 0.0:
            force_m_s2 = min(force_m_s2, tyre_deceleration_m_s2(self.road_friction, slope_rad))
        along_m_s2 = GRAVITY_M_S2 * math.sin(slope_rad)
        return max(force_m_s2 + along_m_s2, LEAST_DECELERATION_M_S2)

    def observe(self, state: VehicleState) -> PlantStep:
        """What can be observed in a state before any interval has been driven from it."""
        command = Command(state.acceleration_m_s2, state.compressor_power_w)
        motion = plan_motion(
            state.position_m, state.speed_m_s, 0.0, math.inf, 0.0, self._sub_steps(1.0)
        )
        result = self._integrate(state, command, motion, within_limits=False)
        if not result.finite:
            self.check(state)
            raise StateError(f"state: the pack cannot supply it, {state}")
        step = self._step(state, ActuatorReport(command, command), motion, result, 0.0)
        return replace(step, state=state)

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        """Drive at the actuated acceleration, as far as the pack can supply it."""
        motion, result = self._drive(state, report.actuated, duration_s)
        if not result.finite:
            self.check(state)
            report, motion, result = self._give_way(state, report, duration_s)
        if motion.top_speed_reached:
            report = replace(report, clamps=(*report.clamps, Clamp.TOP_SPEED))
        return self._step(state, report, motion, result, duration_s)

    def _sub_steps(self, duration_s: float) -> int:
        return max(2, math.ceil(duration_s / self._step_s - 1e-9))

    def _integrate(
        self, state: VehicleState, command: Command, motion: Motion, *, within_limits: bool = True
    ) -> IntervalResult:
        # Friction brakes supply what the motor does not take; it costs no power.
        least_m_s2 = -self.parameters.brakes.regenerative_deceleration_m_s2
        if motion.accelerations_m_s2[0] < least_m_s2:  # what follows, if anything, is a hold
            by_motor = np.maximum(motion.accelerations_m_s2, least_m_s2)
            motion = replace(motion, accelerations_m_s2=by_motor)
        slopes = np.empty(motion.positions_m.shape)
        slopes[:] = self._slope_at(motion.positions_m)
        power_w = command.compressor_power_w
        if within_limits:
            return self._pack.integrate(state, power_w, motion, slopes)
        return self._pack.unbounded(state, power_w, motion, slopes)

    def _drive(
        self, state: VehicleState, command: Command, duration_s: float
    ) -> tuple[Motion, IntervalResult]:
        motion = plan_motion(
            state.position_m,
            state.speed_m_s,
            command.acceleration_m_s2,
            self.parameters.limits.max_speed_m_s,
            duration_s,
            self._sub_steps(duration_s),
        )
        return motion, self._integrate(state, command, motion)

    def _give_way(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> tuple[ActuatorReport, Motion, IntervalResult]:
        """Find the largest acceleration that the pack can supply, by bisection.

        Where it cannot even supply the gentlest motion, the compressor or heater is switched off first.
        """
        high = report.actuated.acceleration_m_s2
        low = min(self.parameters.limits.min_acceleration_m_s2, high)
        actuated = replace(report.actuated, acceleration_m_s2=low)
        motion, result = self._drive(state, actuated, duration_s)
        if not result.finite:
            actuated = replace(actuated, compressor_power_w=0.0)
            motion, result = self._drive(state, actuated, duration_s)
        if not result.finite:
            given_w = self._pack.limits(state, duration_s).discharge_w
            raise PackEmptyError(
                f"the pack is empty: at {100.0 * state.state_of_charge:.2f} % of its charge it gives "
                f"{given_w:.0f} W, less than the auxiliaries take"
            )
        for _ in range(_POWER_BISECTIONS):
            middle = 0.5 * (low + high)
            trial = replace(actuated, acceleration_m_s2=middle)
            trial_motion, trial_result = self._drive(state, trial, duration_s)
            if trial_result.finite:
                low, actuated, motion, result = middle, trial, trial_motion, trial_result
            else:
                high = middle
        clamps = (*report.clamps, Clamp.PACK_POWER)
        return ActuatorReport(report.requested, actuated, clamps), motion, result

    def _step(
        self,
        state: VehicleState,
        report: ActuatorReport,
        motion: Motion,
        result: IntervalResult,
        duration_s: float,
    ) -> PlantStep:
        compressor = report.actuated.compressor_power_w
        end = VehicleState(
            time_s=state.time_s + duration_s,
            position_m=motion.end_position_m,
            speed_m_s=motion.end_speed_m_s,
            acceleration_m_s2=motion.end_acceleration_m_s2,
            compressor_power_w=compressor,
            cell_1_temperature_k=result.cell_1_temperature_k,
            cell_n_temperature_k=result.cell_n_temperature_k,
            cell_1_capacity_loss=result.cell_1_capacity_loss,
            cell_n_capacity_loss=result.cell_n_capacity_loss,
            state_of_charge=self._pack.charge_at_end(state, result),
        )
        if result.channel is not None:
            end = FullChannelState(**vars(end), cells=result.channel)
        per_second = 1.0 / duration_s if duration_s > 0.0 else 0.0
        auxiliary_w = self.parameters.cooling.auxiliary_power_w
        return PlantStep(
            state=end,
            powers=IntervalPowers(
                traction_power_w=result.traction_energy_j * per_second,
                compressor_power_w=compressor,
                auxiliary_power_w=auxiliary_w if duration_s > 0.0 else 0.0,
                battery_power_w=result.battery_energy_j * per_second,
                chiller_heat_w=result.chiller_heat_j * per_second,
                battery_heat_w=result.battery_heat_j * per_second,
            ),
            regenerative_power_w=result.regenerated_energy_j * per_second,
            charge_c=result.charge_c,
            cell_current_a=result.cell_current_a,
            pack_current_a=result.pack_current_a,
            pack_voltage_v=result.pack_voltage_v,
            cell_1_voltage_v=result.cell_1_voltage_v,
            cell_n_voltage_v=result.cell_n_voltage_v,
            coolant_inlet_temperature_k=result.coolant_inlet_k,
            coolant_outlet_temperature_k=result.coolant_outlet_k,
            safety=SafetyRecord(command_source=report.source),
            report=report,
            standstill=motion.end_speed_m_s == 0.0,
            memory=self._memory,
        )
