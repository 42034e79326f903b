"""A foreign FMU in the place of the simulated vehicle: limits, monitor and figures are those of the suite."""

from __future__ import annotations

import math
import weakref
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from iptm_core.errors import ScenarioError, StateError
from iptm_core.frozen import replace
from iptm_core.state import Command, IntervalPowers, SafetyRecord, VehicleState
from iptm_fmi.foreign_unit import ForeignUnit
from iptm_fmi.mapping import ENERGIES, OUTPUTS, STATES, check_units, default_mapping, read_mapping
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

_SAME_S = 1e-6


def plant_of(file: str) -> type[Plant]:
    """Return the kind of plant that drives an FMU.

    Raises:
        ScenarioError: there is no such file.
    """
    if not Path(file).is_file():
        raise ScenarioError(f"plant is {file!r}; allowed: an FMU that exists")
    return type("ForeignPlant", (ForeignPlant,), {"FILE": Path(file).resolve()})


class ForeignPlant(Plant):
    """A vehicle whose motion, pack and temperatures are those of an FMU.

    Commands pass the limits of the suite first. What the FMU does not have stays as at the start (states) or
    is not known (powers and terminals); see `notes`. Unlike the base class it keeps where the trip stands: it
    can go back to the start, and by one interval where the FMU can save its state.
    """

    FILE: ClassVar[Path]

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        """Load the FMU; the arguments are those of the base class."""
        super().__init__(*arguments, **settings)
        self._unit = ForeignUnit(self.FILE)
        weakref.finalize(self, self._unit.close)
        mapping = read_mapping(self.FILE) or default_mapping(self._unit.units)
        check_units(mapping, self._unit.units)
        self._map = mapping
        self._names = [mapped.name for mapped in mapping.outputs.values()]
        missing = sorted({*OUTPUTS} - {*mapping.outputs})
        self.notes = (
            (
                f"{self.FILE.name} has no {', '.join(missing)}: figures of these are left out or constant",
            )
            if missing
            else ()
        )
        self._start_s = self._time_s = math.nan
        self._before: tuple[float, Any, dict[str, float]] | None = None
        self._energies: dict[str, float] = {}

    def initial_state(self, *arguments: Any, **settings: Any) -> VehicleState:
        """State of the FMU at the start; what it does not have is as in the suite."""
        own = super().initial_state(*arguments, **settings)
        self._begin(own.time_s)
        return replace(own, **self._states(self._read()))

    def observe(self, state: VehicleState) -> PlantStep:
        """What can be observed in a state before any interval has been driven from it."""
        if math.isnan(self._time_s):
            self._begin(state.time_s)
        command = Command(state.acceleration_m_s2, state.compressor_power_w)
        report = ActuatorReport(command, command)
        return self._observed(state, report, self._read(), self._energies, 0.0)

    def _begin(self, time_s: float) -> None:
        self._forget()
        self._unit.start(time_s)
        self._start_s = self._time_s = time_s
        self._energies = {name: value for name, value in self._read().items() if name in ENERGIES}

    def _forget(self) -> None:
        if self._before is not None:
            self._unit.forget(self._before[1])
            self._before = None

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        self._go_to(state.time_s)
        if self._unit.step_s is not None and abs(duration_s - self._unit.step_s) > _SAME_S:
            raise StateError(
                f"{self.FILE.name} takes steps of {self._unit.step_s:g} s only, and {duration_s:g} s are"
                " needed; allowed: steps of any length, or no safety monitor"
            )
        energies = dict(self._energies)
        if self._unit.keeps_states:
            self._forget()
            self._before = self._time_s, self._unit.state(), energies
        actuated = report.actuated
        given = {
            "acceleration_command_m_s2": actuated.acceleration_m_s2,
            "compressor_command_w": actuated.compressor_power_w,
            "slope_rad": self._slope_at(np.array([state.position_m])).item(),
        }
        self._unit.put(
            {
                mapped.name: (given[what] - mapped.offset) / mapped.factor
                for what, mapped in self._map.inputs.items()
            }
        )
        self._unit.step(self._time_s, duration_s)
        self._time_s = state.time_s + duration_s
        found = self._read()
        moved = self._states(found)
        mean_m_s2 = (moved["speed_m_s"] - state.speed_m_s) / duration_s
        assumed = {
            "compressor_power_w": actuated.compressor_power_w,
            "acceleration_m_s2": mean_m_s2,
        }
        end = replace(state, time_s=self._time_s, **{**assumed, **moved})
        self._energies = {name: found[name] for name in energies}
        return self._observed(end, report, found, energies, duration_s)

    def _go_to(self, time_s: float) -> None:
        """Let the FMU be where it was at a time."""
        if abs(time_s - self._time_s) <= _SAME_S:
            return
        if self._before is not None and abs(time_s - self._before[0]) <= _SAME_S:
            self._time_s, state, self._energies = self._before
            self._unit.restore(state)
        elif math.isnan(self._time_s) or abs(time_s - self._start_s) <= _SAME_S:
            self._begin(time_s)
        else:
            raise StateError(
                f"{self.FILE.name} stands at {self._time_s:g} s, and {time_s:g} s is asked for;"
                " allowed: that, the start, or the interval before"
            )

    def _read(self) -> dict[str, float]:
        values = self._unit.get(self._names)
        found = {}
        for (what, mapped), value in zip(self._map.outputs.items(), values, strict=True):
            if not math.isfinite(value):
                raise StateError(
                    f"{self.FILE.name}: {mapped.name} is {value}; allowed: finite numbers"
                )
            found[what] = mapped.factor * value + mapped.offset
        return found

    def _states(self, found: dict[str, float]) -> dict[str, float]:
        states = {name: found[name] for name in STATES if name in found}
        states["speed_m_s"] = max(states["speed_m_s"], 0.0)
        return states

    def _observed(
        self,
        state: VehicleState,
        report: ActuatorReport,
        found: dict[str, float],
        energies: dict[str, float],
        duration_s: float,
    ) -> PlantStep:
        self.check(state)

        def power_w(name: str) -> float:
            if name not in found:
                return math.nan
            return (found[name] - energies[name]) / duration_s if duration_s > 0.0 else 0.0

        current_a = found.get("pack_current_a", math.nan)
        voltage_v = found.get("pack_voltage_v", math.nan)
        cell_v = voltage_v / self.parameters.pack.cells_in_series
        return PlantStep(
            state=state,
            powers=IntervalPowers(
                traction_power_w=power_w("traction_energy_j"),
                compressor_power_w=state.compressor_power_w,
                auxiliary_power_w=self.parameters.cooling.auxiliary_power_w if duration_s else 0.0,
                battery_power_w=power_w("battery_energy_j"),
                chiller_heat_w=power_w("chiller_heat_j"),
                battery_heat_w=power_w("battery_heat_j"),
            ),
            regenerative_power_w=min(power_w("traction_energy_j"), 0.0),
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
