"""The observer of the pack in C (`iptm_controller/c`), for ticks at which all is plausible."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import partial

from iptm_controller.measurements import (
    CORRECTION_1_S,
    EFFECT_S,
    EFFECT_SHARE,
    EFFECT_W,
    FOLLOW_S,
    FOLLOW_SHARE,
    FOLLOW_W,
    MOTION_RANGES,
    NOISE_FACTOR,
    PACK_RANGES,
    STUCK_K,
    STUCK_STEPS,
    TOLERANCE_K,
    CoolingMemory,
    Measurements,
    SensorMemory,
    is_temperature,
    slope_at_rad,
    slope_fault,
)
from iptm_controller.pack_observer import (
    CONTRADICTION_K,
    LEAST_OUTLET_WEIGHT,
    MOST_TICK_S,
    PackMemory,
    PackObserver,
    PackReport,
)
from iptm_controller.tick_library import VEHICLE, numbers_of, vehicle
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import doubles
from iptm_core.state import Command, PackReading, VehicleState

_UNKNOWN = PackReading()
_SENSORS = slice(5, 12), slice(12, 19)
"""Places of the sensors in a memory."""


class PackObserverInC(PackObserver):
    """The same with a memory in C; implausible measurements are left to the Python form."""

    def __init__(self, parameters: ModelParameters, library: ctypes.PyDLL) -> None:
        self._numbers, self._write_numbers = doubles(19)
        super().__init__(parameters)
        ranges = MOTION_RANGES | PACK_RANGES
        outlet = self._outlet
        is_shown = outlet.cell_1 + outlet.cell_n >= LEAST_OUTLET_WEIGHT
        weights = (outlet.inlet, outlet.cell_1, outlet.cell_n) if is_shown else (0.0, 0.0, 0.0)
        given = (
            *(ranges[name][0] for name in VEHICLE),
            *(ranges[name][1] for name in VEHICLE),
            *(MOST_TICK_S, TOLERANCE_K, NOISE_FACTOR, STUCK_K, STUCK_STEPS),
            *(CORRECTION_1_S, CONTRADICTION_K, EFFECT_W, EFFECT_SHARE, EFFECT_S),
            *(FOLLOW_W, FOLLOW_SHARE, FOLLOW_S, *weights, self._flow_w_k),
        )
        self._pack, write = doubles(len(given))
        write(*given)
        self._vehicle, self._write_vehicle = vehicle()
        self._reading, self._write_reading = doubles(6)
        self._watch = library.iptm_watch_pack

    @property
    def memory(self) -> PackMemory:
        """State carried from tick to tick; see `PackObserver`."""
        return self.kept_memory()()

    @memory.setter
    def memory(self, memory: PackMemory) -> None:
        self._last: VehicleState | None = memory.last
        sensors = (
            value for each in (memory.cell_1, memory.cell_n) for value in vars(each).values()
        )
        times_s = memory.time_s, memory.age_s, memory.contradicted_s
        self._write_numbers(*times_s, *vars(memory.cooling).values(), *sensors)

    def kept_memory(self) -> Callable[[], PackMemory]:
        """See `PackObserver`."""
        return partial(_built, self._numbers[:], self._last)

    def observe(self, measured: Measurements, commanded: Command | None = None) -> PackReport:
        """See `PackObserver`."""
        state, known = measured.state, self._numbers
        cells_k = known[_SENSORS[0].start], known[_SENSORS[1].start]
        if state is None or math.isnan(cells_k[0]):
            return super().observe(measured, commanded)
        reading, slope = measured.pack or _UNKNOWN, measured.slope
        inlet_k, outlet_k = reading.coolant_inlet_k, reading.coolant_outlet_k
        slope_rad = None if slope_fault(slope) else slope_at_rad(slope, state.position_m)
        power_w, fed_k = reading.battery_power_w, inlet_k if is_temperature(inlet_k) else math.nan
        rates = self._model.rates_k_s(state, cells_k, slope_rad, power_w, fed_k)
        measured_k = state.cell_1_temperature_k, state.cell_n_temperature_k
        cooling_w = self._model.cooling_w(state, measured_k)
        asked_w = 0.0 if commanded is None else commanded.compressor_power_w
        self._write_vehicle(*numbers_of(state))
        self._write_reading(inlet_k, outlet_k, *rates, cooling_w, asked_w)
        if not self._watch(self._pack, self._numbers, self._vehicle, self._reading):
            return super().observe(measured, commanded)
        self._last = state
        return PackReport(state)


def _built(known: Sequence[float], last: VehicleState | None) -> PackMemory:
    """Return a memory from its numbers in C."""
    # One object for all that is not known, so that equal memories compare as equal.
    numbers = [math.nan if math.isnan(value) else value for value in known]
    time_s, age_s, contradicted_s, *cooling = numbers[: _SENSORS[0].start]
    cell_1, cell_n = (SensorMemory(*numbers[place]) for place in _SENSORS)
    cooled = CoolingMemory(*cooling)
    return PackMemory(time_s, age_s, cell_1, cell_n, last, contradicted_s, cooled)
