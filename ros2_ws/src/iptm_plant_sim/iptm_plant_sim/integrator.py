"""Integration of the exact model over one interval of prescribed motion.

Classical Runge-Kutta of order four on the four cell states; energies, heat and charge are quadratures of
the same stages. What depends on the state of charge is taken at the start of the interval. One sub-step is an
expression graph of the very functions that the rest of the project uses. It is generated as C once for all
models of one shape, with the numbers of a model as an argument, and called in a loop in C, see
``c/interval.c``.

Friction brakes supply what the pack does not take. A pack without limits of its own takes any power until it
is full, and gives any until it is empty; only then are its powers bounded, so that otherwise every number
stays as it is without any bound.
"""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Sequence
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from iptm_core.compilation import cache_directory, compile_sources
from iptm_core.errors import StateError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import charge_after, depends_on_charge, pack_capacity_ah
from iptm_core.physics.model_numbers import (
    SplitFunctions,
    SymbolicModel,
    numbers_of,
    shape_of,
    split_off,
)
from iptm_core.physics.ops import address
from iptm_core.physics.pack_limits import PowerLimits, least_traction_power_w, power_limits
from iptm_core.physics.power_thermal import CellPair
from iptm_core.settings import ThermalModel
from iptm_core.state import FloatArray, FullChannelState, VehicleState
from iptm_plant_sim.actuators import Motion
from iptm_plant_sim.c_sources import C_SOURCES
from iptm_plant_sim.channel_integrator import ChannelIntegrator
from iptm_plant_sim.interval import AT_END, INTEGRALS, STATES, IntervalResult, PowerBounds, sub_step

_states_of = attrgetter(*STATES)
_NOTHING = (-0.0,) * len(INTEGRALS)
"""Plus any number, it is that number."""
_VALUES = len(STATES) + len(INTEGRALS)
_START = struct.Struct(f"{_VALUES}d")


class IntervalIntegrator:
    """Integrates intervals of any number of sub-steps for one parameter set.

    Args:
        bounded: whether intervals have `PowerBounds`.
    """

    def __init__(self, parameters: ModelParameters, *, bounded: bool = False) -> None:
        shape = shape_of(parameters)
        library, split = _program(shape, cache_directory(), bounded=bounded)
        self._numbers = split.prepare(numbers_of(parameters, shape))
        self._held = np.zeros(4 if bounded else 2)
        self._found = np.zeros(len(STATES) + len(INTEGRALS) + len(AT_END))
        self._run = library.iptm_integrate
        self._buffers = [address(each) for each in (self._numbers, self._held, self._found)]

    def integrate(
        self,
        cells: CellPair,
        compressor_power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        charge: float = math.nan,
        bounds: PowerBounds | None = None,
    ) -> IntervalResult:
        """Integrate one interval.

        Args:
            cells: cell states at the start.
            motion: the motion, laid out for n sub-steps.
            slopes_rad: slope at ``motion.positions_m``, shape (2 n + 1,).
            charge: state of charge at the start; NaN where nothing depends on it.
            bounds: of the interval, where it is bounded.
        """
        self._held[0], self._held[1] = compressor_power_w, charge
        if bounds is not None:
            self._held[2], self._held[3] = bounds.traction_w, bounds.battery_w
        _START.pack_into(self._found.data, 0, *_states_of(cells), *_NOTHING)
        columns = motion.lengths_s, motion.accelerations_m_s2, slopes_rad, motion.speeds_m_s
        numbers, held, end = self._buffers
        self._run(motion.lengths_s.size, numbers, held, *map(address, columns), end)
        found: Sequence[Any] = self._found.tolist()
        return IntervalResult(*found)


@lru_cache(maxsize=16)
def _program(
    shape: ModelParameters, _folder: Path, *, bounded: bool
) -> tuple[ctypes.PyDLL, SplitFunctions]:
    """Return the library of a shape and the functions in it; the folder is part of the key only."""
    split = split_off(sub_step(SymbolicModel.of(shape), bounded=bounded))
    generator = ca.CodeGenerator("model.c", {"with_header": False})
    for function in split.functions:
        generator.add(function)
    files = {**C_SOURCES.read("interval.c"), "model.c": str(generator.dump())}
    library = ctypes.PyDLL(str(compile_sources(files)))
    library.iptm_integrate.argtypes = [ctypes.c_int, *[ctypes.c_void_p] * 7]
    library.iptm_integrate.restype = None
    return library, split


class PackIntegration:
    """Integrates intervals of any number of sub-steps for one parameter set.

    Attributes:
        depends_on_charge: whether states need a state of charge.
    """

    def __init__(self, parameters: ModelParameters, thermal_model: ThermalModel) -> None:
        self._parameters = parameters
        self._is_limited = parameters.pack_limits.limited
        self.depends_on_charge = depends_on_charge(parameters.charge) or self._is_limited
        self._integrators: dict[bool, IntervalIntegrator] = {}
        self._channels: dict[bool, ChannelIntegrator] = {}
        if thermal_model is ThermalModel.FULL_CHANNEL:
            self._channels = {
                bounded: ChannelIntegrator(parameters, bounded=bounded) for bounded in (False, True)
            }

    def charge_at_end(self, state: VehicleState, result: IntervalResult) -> float:
        """Return the state of charge behind an interval."""
        loss = 0.5 * (state.cell_1_capacity_loss + state.cell_n_capacity_loss)
        capacity_ah = pack_capacity_ah(self._parameters, loss)
        return charge_after(state.state_of_charge, result.charge_c, capacity_ah)

    def limits(self, state: VehicleState, duration_s: float) -> PowerLimits:
        """Return what the pack takes and gives in an interval."""
        charge = state.state_of_charge
        return power_limits(cells_of(state), charge, self._parameters, duration_s)

    def integrate(
        self, state: VehicleState, power_w: float, motion: Motion, slopes_rad: FloatArray
    ) -> IntervalResult:
        """Integrate an interval within the limits; one that asks the pack for too much is not finite.

        Args:
            power_w: of the thermal actuator, negative for the heater.
        """
        if not self._is_limited:
            result = self.unbounded(state, power_w, motion, slopes_rad)
            end = self.charge_at_end(state, result)
            if math.isnan(end) or 0.0 <= end <= 1.0:
                return result
        limits = self.limits(state, float(motion.lengths_s.sum()))
        least_w = least_traction_power_w(limits.charge_w, power_w, self._parameters)
        bounds = PowerBounds(least_w, limits.discharge_w)
        return self._integrate(state, power_w, motion, slopes_rad, bounds)

    def unbounded(
        self, state: VehicleState, power_w: float, motion: Motion, slopes_rad: FloatArray
    ) -> IntervalResult:
        """Integrate an interval whatever the pack takes and gives."""
        return self._integrate(state, power_w, motion, slopes_rad, None)

    def _integrate(
        self,
        state: VehicleState,
        power_w: float,
        motion: Motion,
        slopes_rad: FloatArray,
        bounds: PowerBounds | None,
    ) -> IntervalResult:
        bounded, charge = bounds is not None, state.state_of_charge
        if self._channels:
            if not isinstance(state, FullChannelState):
                raise StateError("state has two cells; allowed: a state of the full channel")
            channel = self._channels[bounded]
            return channel.integrate(state.cells, power_w, motion, slopes_rad, charge, bounds)
        integrator = self._integrators.get(bounded)
        if integrator is None:
            integrator = IntervalIntegrator(self._parameters, bounded=bounded)
            self._integrators[bounded] = integrator
        return integrator.integrate(cells_of(state), power_w, motion, slopes_rad, charge, bounds)


def cells_of(state: VehicleState) -> CellPair:
    """Return the first and the last cell of a state."""
    return CellPair(
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.cell_1_capacity_loss,
        state.cell_n_capacity_loss,
    )
