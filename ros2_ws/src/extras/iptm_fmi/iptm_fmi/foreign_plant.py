"""A foreign FMU in the place of the simulated vehicle: limits, monitor and figures are those of the suite."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from iptm_core.errors import ScenarioError
from iptm_core.frozen import replace
from iptm_core.state import Command, IntervalPowers, SafetyRecord, VehicleState
from iptm_fmi.mapping import OUTPUTS, STATES, read_mapping
from iptm_fmi.thermal_part import ThermalPart
from iptm_fmi.trip_unit import TripUnit
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant


def plant_of(file: str) -> type[Plant]:
    """Return the kind of plant that drives an FMU, which is a vehicle or, by its mapping, a thermal part.

    Raises:
        ScenarioError: the file does not exist, or its mapping cannot be used.
    """
    path = Path(file)
    if not path.is_file():
        raise ScenarioError(f"plant is {file!r}; allowed: an FMU that exists")
    mapping = read_mapping(path)
    kind = ThermalPart if mapping is not None and mapping.is_thermal else ForeignPlant
    return type(kind.__name__, (kind,), {"FILE": path.resolve()})


class ForeignPlant(Plant):
    """A vehicle whose motion, pack and temperatures are those of an FMU.

    Commands pass the limits of the suite first. What the FMU does not have stays as at the start (states) or
    is not known (powers and terminals); see `notes`. Unlike the base class it keeps where the trip stands: it
    can go back to the start, and by one interval where the FMU can save its state.
    """

    FILE: ClassVar[Path]

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        """Load the FMU; arguments as in the base class."""
        super().__init__(*arguments, **settings)
        self._unit = TripUnit(self.FILE)
        missing = sorted({*OUTPUTS} - {*self._unit.map.outputs})
        self.notes = (
            (
                f"{self.FILE.name} has no {', '.join(missing)}: figures of these are left out or constant",
            )
            if missing
            else ()
        )

    def initial_state(self, *arguments: Any, **settings: Any) -> VehicleState:
        """State of the FMU at the start; what it does not have is as in the suite."""
        own = super().initial_state(*arguments, **settings)
        self._unit.begin(own.time_s)
        return replace(own, **self._states())

    def observe(self, state: VehicleState) -> PlantStep:
        """What can be observed in a state before any interval has been driven from it."""
        if not self._unit.has_begun:
            self._unit.begin(state.time_s)
        command = Command(state.acceleration_m_s2, state.compressor_power_w)
        return self._observed(state, ActuatorReport(command, command), 0.0)

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        actuated = report.actuated
        given = {
            "acceleration_command_m_s2": actuated.acceleration_m_s2,
            "compressor_command_w": actuated.compressor_power_w,
            "slope_rad": self._slope_at(np.array([state.position_m])).item(),
        }
        self._unit.advance(given, state.time_s, duration_s)
        moved = self._states()
        mean_m_s2 = (moved["speed_m_s"] - state.speed_m_s) / duration_s
        assumed = {
            "compressor_power_w": actuated.compressor_power_w,
            "acceleration_m_s2": mean_m_s2,
        }
        end = replace(state, time_s=state.time_s + duration_s, **{**assumed, **moved})
        return self._observed(end, report, duration_s)

    def _states(self) -> dict[str, float]:
        states = {name: value for name, value in self._unit.found.items() if name in STATES}
        states["speed_m_s"] = max(states["speed_m_s"], 0.0)
        return states

    def _observed(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        self.check(state)
        found = self._unit.found
        current_a = found.get("pack_current_a", math.nan)
        voltage_v = found.get("pack_voltage_v", math.nan)
        cell_v = voltage_v / self.parameters.pack.cells_in_series
        return PlantStep(
            state=state,
            powers=IntervalPowers(
                traction_power_w=self._unit.mean_w("traction_energy_j", duration_s),
                compressor_power_w=state.compressor_power_w,
                auxiliary_power_w=self.parameters.cooling.auxiliary_power_w if duration_s else 0.0,
                battery_power_w=self._unit.mean_w("battery_energy_j", duration_s),
                chiller_heat_w=self._unit.mean_w("chiller_heat_j", duration_s),
                battery_heat_w=self._unit.mean_w("battery_heat_j", duration_s),
            ),
            regenerative_power_w=min(self._unit.mean_w("traction_energy_j", duration_s), 0.0),
            charge_c=current_a * duration_s,
            cell_current_a=current_a / self.parameters.pack.parallel,
            pack_current_a=current_a,
            pack_voltage_v=voltage_v,
            cell_1_voltage_v=cell_v,
            cell_n_voltage_v=cell_v,
            coolant_inlet_temperature_k=found.get("coolant_inlet_k", math.nan),
            coolant_outlet_temperature_k=found.get("coolant_outlet_k", math.nan),
            safety=SafetyRecord(command_source=report.source),
            report=report,
            standstill=state.speed_m_s == 0.0,
            memory=self._memory,
        )
