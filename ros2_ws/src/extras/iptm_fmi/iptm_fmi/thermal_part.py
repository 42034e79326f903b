"""A foreign FMU as the thermal part of the simulated vehicle: a supplier's pack with its chiller."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

from iptm_core.errors import ScenarioError
from iptm_core.frozen import replace
from iptm_core.state import VehicleState
from iptm_fmi.mapping import THERMAL_OUTPUTS
from iptm_fmi.trip_unit import TripUnit
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

_TEMPERATURES = ("cell_1_temperature_k", "cell_n_temperature_k")


class ThermalPart(Plant):
    """The vehicle of the suite, with the cell temperatures of an FMU.

    In an interval motion, currents, heat and ageing are those of the suite, from the temperatures at its
    start; the FMU takes the mean heat of the cells and the command of the compressor, and its temperatures
    are the ones at the end. Where it has the power that it draws, the pack supplies that one, and the heat of
    the difference goes into the next interval. Like `ForeignPlant` it keeps where the trip stands.
    """

    FILE: ClassVar[Path]

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        """Load the FMU; arguments as in the base class.

        Raises:
            ScenarioError: all cells of a channel are integrated, or the FMU cannot be used.
        """
        super().__init__(*arguments, **settings)
        if self._has_all_cells:
            raise ScenarioError(
                f"thermal_model is full_channel, and {self.FILE.name} has the temperatures of two cells;"
                " allowed: two_cell"
            )
        self._unit = TripUnit(self.FILE)
        self._owed_j: dict[
            float, float
        ] = {}  # heat that the FMU has yet to take, by the time from which
        missing = [name for name in THERMAL_OUTPUTS if name not in self._unit.map.outputs]
        self.notes = (f"{self.FILE.name} is the thermal part; temperatures of cells are its own",)
        if missing:
            self.notes += (
                f"{self.FILE.name} has no {', '.join(missing)}: these are not known, power is as commanded",
            )

    def initial_state(self, *arguments: Any, **settings: Any) -> VehicleState:
        """State at the start, with the temperatures of the FMU."""
        own = super().initial_state(*arguments, **settings)
        self._unit.begin(own.time_s)
        self._owed_j = {}
        return self._with_temperatures(own)

    def observe(self, state: VehicleState) -> PlantStep:
        """What can be observed in a state before any interval has been driven from it."""
        if not self._unit.has_begun:
            self._unit.begin(state.time_s)
        return self._with_coolant(super().observe(state), 0.0)

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        step = super()._drive_interval(state, report, duration_s)
        heat_w = step.powers.battery_heat_w
        owed_j = self._owed_j.get(round(state.time_s, 6), 0.0)
        given = {
            "battery_heat_w": heat_w + owed_j / duration_s,
            "compressor_command_w": step.powers.compressor_power_w,
            "ambient_k": self.parameters.environment.ambient_temperature_k,
            "vehicle_speed_m_s": 0.5 * (state.speed_m_s + step.state.speed_m_s),
        }
        self._unit.advance(given, state.time_s, duration_s)
        drawn_w = self._unit.found.get("compressor_power_w", step.powers.compressor_power_w)
        if drawn_w != step.powers.compressor_power_w:
            actuated = replace(step.report.actuated, compressor_power_w=drawn_w)
            report = replace(step.report, actuated=actuated)
            step = super()._drive_interval(state, report, duration_s)
        end_s = round(step.state.time_s, 6)
        owed_j = (step.powers.battery_heat_w - heat_w) * duration_s
        self._owed_j = {**dict([*self._owed_j.items()][-2:]), end_s: owed_j}
        step = replace(step, state=self._with_temperatures(step.state))
        self.check(step.state)
        return self._with_coolant(step, duration_s)

    def _with_temperatures(self, state: VehicleState) -> VehicleState:
        return replace(state, **{name: self._unit.found[name] for name in _TEMPERATURES})

    def _with_coolant(self, step: PlantStep, duration_s: float) -> PlantStep:
        found = self._unit.found
        chiller_w = self._unit.mean_w("chiller_heat_j", duration_s)
        return replace(
            step,
            powers=replace(step.powers, chiller_heat_w=chiller_w),
            coolant_inlet_temperature_k=found.get("coolant_inlet_k", math.nan),
            coolant_outlet_temperature_k=found.get("coolant_outlet_k", math.nan),
        )
