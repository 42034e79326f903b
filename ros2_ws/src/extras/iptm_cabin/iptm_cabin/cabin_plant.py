"""The suite's vehicle with a cabin: climate control, refrigerant loop, and their power from the pack."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from iptm_cabin.climate_control import ClimateUnit, Memory
from iptm_cabin.parameters import CabinParameters, ClimateControl, air_course, read_cabin
from iptm_cabin.predictive import PredictiveUnit, way_ahead
from iptm_cabin.refrigerant_loop import ACTIVE_W, OF_COMPRESSOR
from iptm_cabin.thermal_functions import thermal_functions
from iptm_core.errors import ScenarioError
from iptm_core.frozen import replace
from iptm_core.physics.chiller import chiller_line
from iptm_core.physics.thermal_loop import reduce_channel, solve_coolant_loop, thermal_actuation
from iptm_core.state import VehicleState
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plant_sim.actuators import ActuatorReport
from iptm_plant_sim.interval import PlantStep
from iptm_plant_sim.plant import Plant

LEFT = "the loop leaves the map of its refrigerant, which is held at its bounds"
LEFT_K = 2.0
MIXING_S = 1.0
"""Longest step of the temperatures in an interval."""


CABIN = (
    "air_k",
    "interior_k",
    "core_k",
    "drive_k",
    "cabin_w",
    "pack_w",
    "ptc_w",
    "radiator",
    "compressor_w",
    "electric_w",
    "evaporation_c",
    "condensation_c",
    "is_limited",
    "is_compressor_limited",
)
"""Numbers of `CabinState` that tables and messages have."""


@dataclass(frozen=True)
class CabinState:
    """Cabin and loop at the end of an interval; powers are means over it.

    Attributes:
        cabin_w: heat into the heater core by the loop, negative where cabin air is cooled.
        pack_w: heat into the coolant by the loop, negative for the chiller.
        radiator: opening of the radiator's valve, 0 to 1.
        electric_w: compressor, heater, fans and blower together.
        is_limited: compressor, frost, pressure or a broken part leave less than is asked for.
        is_compressor_limited: it is power or speed of the compressor.
    """

    air_k: float
    interior_k: float
    core_k: float
    drive_k: float
    memory: Memory = field(default_factory=Memory)
    cabin_w: float = 0.0
    pack_w: float = 0.0
    ptc_w: float = 0.0
    radiator: float = 0.0
    compressor_w: float = 0.0
    electric_w: float = 0.0
    evaporation_c: float = 0.0
    condensation_c: float = 0.0
    is_limited: bool = False
    is_compressor_limited: bool = False

    @property
    def nodes_k(self) -> tuple[float, float, float, float]:
        """Air, interior, heater core, drive."""
        return self.air_k, self.interior_k, self.core_k, self.drive_k


@dataclass(frozen=True)
class CabinVehicleState(VehicleState):
    """A vehicle state with its cabin."""

    cabin: CabinState


class CabinPlant(Plant):
    """The vehicle of the suite, with cell temperatures and thermal power of `iptm_cabin`.

    Motion, currents, ageing and heat of the cells follow the suite, from the temperatures at the start
    of an interval. The compressor power of the trip's figures is the one that its controller commands; what
    cabin and loop take beyond it counts as auxiliary power.
    """

    CABIN: ClassVar[CabinParameters]

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        """Set up the cabin; arguments as in the base class.

        Raises:
            ScenarioError: all cells of a channel are integrated.
        """
        super().__init__(*arguments, **settings)
        if self._has_all_cells:
            raise ScenarioError(
                "thermal_model is full_channel, and a cabin has two cells; allowed: two_cell"
            )
        self._functions = thermal_functions(self.CABIN, self.parameters)
        self._air = air_course(self.CABIN)
        self._outlet = reduce_channel(self.parameters.cooling, self.parameters.pack).outlet
        self._unit: ClimateUnit
        if self.CABIN.control is ClimateControl.PREDICTIVE:
            self._unit = PredictiveUnit(self._functions, way_ahead(self.CABIN, self.parameters))
        else:
            self._unit = ClimateUnit(self._functions)

    def initial_state(self, *arguments: Any, **settings: Any) -> CabinVehicleState:
        """State at the start, with a cabin that stood in the air and the sun."""
        return self._with_cabin(super().initial_state(*arguments, **settings))

    def observe(self, state: VehicleState) -> PlantStep:
        """What can be observed in a state before any interval has been driven from it."""
        return super().observe(self._with_cabin(state))

    def _with_cabin(self, state: VehicleState) -> CabinVehicleState:
        if isinstance(state, CabinVehicleState):
            return state
        air_k = self._air_k(state.time_s)
        cabin_k = self.CABIN.initial_temperature_c(air_k - CELSIUS_ZERO_K) + CELSIUS_ZERO_K
        return CabinVehicleState(
            **vars(state), cabin=CabinState(cabin_k, cabin_k, max(cabin_k, air_k), air_k)
        )

    def _air_k(self, time_s: float) -> float:
        """Return the temperature of the air outside."""
        times, degrees = self._air
        if not times:
            return self.parameters.environment.ambient_temperature_k
        return float(np.interp(time_s, times, degrees)) + CELSIUS_ZERO_K

    def _drive_interval(
        self, state: VehicleState, report: ActuatorReport, duration_s: float
    ) -> PlantStep:
        start = self._with_cabin(state)
        cabin, functions = start.cabin, self._functions
        states: tuple[float, ...] = (
            *cabin.nodes_k,
            state.cell_1_temperature_k,
            state.cell_n_temperature_k,
        )
        air_k = self._air_k(state.time_s)
        weather = (state.speed_m_s, 0.0, 0.0, air_k, self.CABIN.sun_w_m2)
        by_trip = self.CABIN.control is ClimateControl.COMMAND
        commanded_w = report.actuated.compressor_power_w if by_trip else 0.0
        if isinstance(self._unit, PredictiveUnit):
            self._unit.look_ahead(state, self._heard)
        asked_w = -self._taken_w(start, commanded_w)
        inputs, memory, limited = self._unit.decide(
            states, weather, cabin.memory, asked_w, duration_s
        )
        electric_w = functions.flows(states, inputs, weather)["electric_w"]
        drawn = replace(report.actuated, compressor_power_w=electric_w)
        step = super()._drive_interval(state, replace(report, actuated=drawn), duration_s)
        if step.report.actuated.compressor_power_w < electric_w:  # the pack cannot supply it
            inputs, electric_w, limited = (0.0, 0.0, 0.0, 0.0), 0.0, "the pack cannot supply it"
        loop = functions.loop(states, inputs, weather)
        left = loop.beyond_k > LEFT_K and loop.power_w > ACTIVE_W
        for note in (limited, LEFT if left else ""):
            if note and note not in self.notes:
                self.notes = (*self.notes, note)
        waste_w = self._functions.model.drive_waste_w(step.powers.traction_power_w)
        speed_m_s = 0.5 * (state.speed_m_s + step.state.speed_m_s)
        weather = (speed_m_s, step.powers.battery_heat_w, waste_w, air_k, self.CABIN.sun_w_m2)
        steps = max(1, round(duration_s / MIXING_S))
        for _ in range(steps):
            states = functions.advance(states, inputs, weather, loop.waste_w, duration_s / steps)
        flows = functions.flows(states, inputs, weather)
        air_node, interior, core, drive, cell_1, cell_n = states
        cabin_w, pack_w, ptc_w, radiator = inputs
        after = CabinState(
            air_node,
            interior,
            core,
            drive,
            memory,
            cabin_w,
            pack_w,
            ptc_w,
            radiator,
            compressor_w=loop.power_w if electric_w else 0.0,
            electric_w=electric_w,
            evaporation_c=loop.evaporation_c,
            condensation_c=loop.condensation_c,
            is_limited=bool(limited),
            is_compressor_limited=limited in OF_COMPRESSOR,
        )
        end = replace(
            step.state,
            compressor_power_w=commanded_w,
            cell_1_temperature_k=cell_1,
            cell_n_temperature_k=cell_n,
        )
        beyond_w = electric_w - commanded_w
        actuated = replace(step.report.actuated, compressor_power_w=commanded_w)
        step = replace(
            step,
            state=CabinVehicleState(**vars(end), cabin=after),
            powers=replace(
                step.powers,
                compressor_power_w=commanded_w,
                auxiliary_power_w=step.powers.auxiliary_power_w + beyond_w,
                chiller_heat_w=flows["radiator_w"] - pack_w,
            ),
            coolant_inlet_temperature_k=flows["coolant_in_k"],
            coolant_outlet_temperature_k=flows["coolant_out_k"],
            report=replace(step.report, actuated=actuated),
        )
        self.check(step.state)
        return step

    def _taken_w(self, state: VehicleState, power_w: float) -> float:
        """Return the heat that the suite's map takes from the coolant at a power of its actuator."""
        if power_w == 0.0:
            return 0.0
        values = self.parameters
        actuation = thermal_actuation(power_w, values)
        line = chiller_line(
            actuation.compressor_w,
            state.speed_m_s,
            values.chiller,
            values.cooling,
            values.environment,
        )
        cells_k = state.cell_1_temperature_k, state.cell_n_temperature_k
        loop = solve_coolant_loop(*cells_k, line, self._outlet, values.cooling, 0.0, actuation)
        return float(loop.cooling_rate_w)


def plant_of(file: str) -> type[Plant]:
    """Return the kind of plant of a file of `CabinParameters`.

    Raises:
        ScenarioError: there is no such file, or it is not usable.
    """
    return plant_with(read_cabin(file))


def plant_with(cabin: CabinParameters) -> type[CabinPlant]:
    """Return the kind of plant with a cabin."""
    return type("CabinPlant", (CabinPlant,), {"CABIN": cabin})
