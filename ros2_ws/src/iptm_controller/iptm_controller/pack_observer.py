"""Plausibility of cell temperatures and cooling: compared with each other, the coolant and a model.

A model of the two cells goes along with the heat of the current and the measured coolant. A sensor that is
silent, impossible, far from the model, or does not move while the model does, is not used: the model takes
its place, with a margin towards the nearer limit. The sound sensor, or else the coolant at the outlet,
corrects the model meanwhile. Two bad sensors reduce the power of the pack in steps, but stop no car.

Compressor, pump and fan are judged by what they do: the heat that the coolant loses on its way round.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial

import numpy as np

from iptm_controller.measurements import (
    APART_K,
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
    START_S,
    STUCK_K,
    STUCK_STEPS,
    TOLERANCE_K,
    CoolingMemory,
    Measurements,
    SensorMemory,
    are_alike,
    corrected,
    is_temperature,
    motion_fault,
    slope_at_rad,
    slope_fault,
)
from iptm_controller.pack_model import PackModel
from iptm_controller.tick_library import VEHICLE, numbers_of, vehicle
from iptm_core.frozen import replace
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import doubles
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.state import Command, PackReading, VehicleState

LEAST_MARGIN_K, MARGIN_K_S, LARGEST_MARGIN_K = 1.0, 0.2 / 60.0, 3.0
REDUCTION_EVERY_S, REDUCTION, LEAST_SHARE = 30.0, 0.2, 0.3
CONTRADICTION_K, CONTRADICTION_S = 5.0, 10.0
LEAST_OUTLET_WEIGHT = 0.02
"""Part of the outlet temperature that comes from the cells, below which it shows nothing about them."""
MOST_TICK_S = 10.0
_TEMPERATURES = ("cell_1_temperature_k", "cell_n_temperature_k")


class PackFault(Enum):
    """A fault of sensors or cooling of the pack; the value is the sentence of the diagnostics."""

    ONE_SENSOR = "a cell temperature is not plausible, model used"
    BOTH_SENSORS = "no cell temperature is plausible, model used and power reduced"
    CONTRADICTION = "cell temperatures and coolant contradict each other, the warmer counts"
    NO_EFFECT = "cooling has no effect: compressor, pump or fan"
    NOT_FOLLOWED = "the compressor does not follow its command"
    OTHER_VALUE = "a value of the pack is not plausible, the last one is used"


@dataclass(frozen=True)
class PackMemory:
    """State carried from tick to tick.

    Attributes:
        time_s: last tick, minus infinity before the first.
        age_s: since the first tick.
        contradicted_s: for how long cells and coolant have differed.
        cooling: whether cooling follows and has an effect.
    """

    time_s: float = -math.inf
    age_s: float = 0.0
    cell_1: SensorMemory = field(default_factory=SensorMemory)
    cell_n: SensorMemory = field(default_factory=SensorMemory)
    last: VehicleState | None = None
    contradicted_s: float = 0.0
    cooling: CoolingMemory = field(default_factory=CoolingMemory)


@dataclass(frozen=True)
class PackReport:
    """Findings of a tick.

    Attributes:
        state: measured state, its implausible values of the pack replaced.
        faults: the most important first.
        reason: the same with numbers, one sentence, empty if nothing is.
        power_share: share of its power that the pack is to give and take.
    """

    state: VehicleState | None
    faults: tuple[PackFault, ...] = ()
    reason: str = ""
    power_share: float = 1.0


class PackObserver:
    """Judges the measurements of the pack, tick by tick."""

    def __init__(self, parameters: ModelParameters) -> None:
        self._parameters = parameters
        self._outlet = reduce_channel(parameters.cooling, parameters.pack).outlet
        self._model = PackModel(parameters)
        loss, cooling = parameters.aging.initial_capacity_loss, parameters.cooling
        usual = {
            "compressor_power_w": 0.0,
            "cell_1_capacity_loss": loss,
            "cell_n_capacity_loss": loss,
        }
        self._usual = [(name, PACK_RANGES[name], value) for name, value in usual.items()]
        self._flow_w_k = cooling.coolant_mass_flow_kg_s * cooling.coolant_specific_heat_j_kg_k
        self.memory = PackMemory()

    def kept_memory(self) -> Callable[[], PackMemory]:
        """Return what builds the memory of now, whenever it is called."""
        memory = self.memory
        return lambda: memory

    def observe(self, measured: Measurements, commanded: Command | None = None) -> PackReport:
        """Judge a tick.

        Args:
            measured: the pack is judged where the motion is possible; without a reading the model
                works out power and coolant itself.
            commanded: command of the tick before, None if there was none.
        """
        state, reading = measured.state, measured.pack
        if state is None or motion_fault(state):
            return PackReport(state)
        memory = self.memory
        elapsed_s = state.time_s - memory.time_s
        if not 0.0 < elapsed_s <= MOST_TICK_S:
            # The first tick, another trip or a long silence; or the same tick again, where nothing moves on.
            before = memory.time_s, memory.cell_1.value_k, memory.cell_n.value_k
            now = state.time_s, *_temperatures(state)
            is_same = np.array_equal(before, now, equal_nan=True)
            memory = memory if is_same else replace(PackMemory(), last=memory.last)
            elapsed_s = 0.0
        state, other = self._with_other_values(state, memory.last)
        measured_k = [state.cell_1_temperature_k, state.cell_n_temperature_k]
        (first, last), (first_by_k, last_by_k) = self._moved(memory, state, measured, elapsed_s)
        sensors = [
            first.judged(measured_k[0], first_by_k, elapsed_s),
            last.judged(measured_k[1], last_by_k, elapsed_s),
        ]
        if memory.age_s < START_S and are_alike(sensors, measured_k):
            sensors = [SensorMemory(value_k, value_k) for value_k in measured_k]
        offset_k = self._coolant_offset_k(sensors, reading)
        sensors = corrected(sensors, measured_k, offset_k, elapsed_s)
        sound = not (sensors[0].bad_s or sensors[1].bad_s)
        used_k, known = measured_k, state
        if not sound:
            used_k = [self._used_k(*pair) for pair in zip(sensors, measured_k, strict=True)]
            known = replace(state, **dict(zip(_TEMPERATURES, used_k, strict=True)))
        differs = sound and abs(offset_k) > CONTRADICTION_K
        self.memory = memory = PackMemory(
            state.time_s,
            memory.age_s + elapsed_s,
            sensors[0],
            sensors[1],
            known,
            memory.contradicted_s + elapsed_s if differs else 0.0,
            self._cooling_judged(memory.cooling, known, reading, commanded, elapsed_s),
        )
        if memory.contradicted_s > CONTRADICTION_S:
            warmer_k = [max(value_k, value_k + offset_k) for value_k in used_k]
            known = replace(known, **dict(zip(_TEMPERATURES, warmer_k, strict=True)))
        return self._report(known, memory, measured_k, other)

    def _with_other_values(
        self, state: VehicleState, last: VehicleState | None
    ) -> tuple[VehicleState, str]:
        """Return a state whose power and ageing are possible, and the faults."""
        for name, (low, high), value in self._usual:
            measured = getattr(state, name)
            if not low <= measured <= high:
                known = value if last is None else getattr(last, name)
                state = replace(state, **{name: known})
                return self._with_other_values(state, last)[0], f"measured {name} is {measured}"
        return state, ""

    def _moved(
        self,
        memory: PackMemory,
        state: VehicleState,
        measured: Measurements,
        elapsed_s: float,
    ) -> tuple[tuple[SensorMemory, SensorMemory], tuple[float, float]]:
        """Return the sensors before this tick, at first as measured, and how far their models have moved."""
        reading = measured.pack
        t_1, t_n = memory.cell_1.model_k, memory.cell_n.model_k
        if math.isnan(t_1):
            t_1, t_n = self._start_k(state, reading)
            return (SensorMemory(t_1), SensorMemory(t_n)), (0.0, 0.0)
        slope_rad = None
        if not slope_fault(measured.slope):
            slope_rad = slope_at_rad(measured.slope, state.position_m)
        power_w = inlet_k = math.nan
        if reading is not None:
            power_w = reading.battery_power_w
            if is_temperature(reading.coolant_inlet_k):
                inlet_k = reading.coolant_inlet_k
        rates = self._model.rates_k_s(state, (t_1, t_n), slope_rad, power_w, inlet_k)
        by_k = rates[0] * elapsed_s, rates[1] * elapsed_s
        return (memory.cell_1, memory.cell_n), by_k

    def _start_k(self, state: VehicleState, reading: PackReading | None) -> tuple[float, float]:
        """Return where the model starts: as measured where that is possible and the cells are alike."""
        initial_k = self._parameters.environment.initial_cell_temperature_k
        found = [value for value in _temperatures(state) if is_temperature(value)]
        if not found:
            outlet_k = math.nan if reading is None else reading.coolant_outlet_k
            return (outlet_k, outlet_k) if is_temperature(outlet_k) else (initial_k, initial_k)
        if len(found) == 1 or abs(found[0] - found[1]) > APART_K:
            known_k = initial_k if reading is None else reading.coolant_outlet_k
            if not is_temperature(known_k):
                known_k = initial_k
            nearest = min(found, key=lambda value: abs(value - known_k))
            return nearest, nearest
        return found[0], found[1]

    def _coolant_offset_k(self, sensors: list[SensorMemory], reading: PackReading | None) -> float:
        """Return by how much the cells are warmer than the model according to the coolant; 0 if unknown."""
        outlet = self._outlet
        weight = outlet.cell_1 + outlet.cell_n
        if reading is None or weight < LEAST_OUTLET_WEIGHT:
            return 0.0
        inlet_k, outlet_k = reading.coolant_inlet_k, reading.coolant_outlet_k
        if not (is_temperature(inlet_k) and is_temperature(outlet_k)):
            return 0.0
        expected_k = outlet.temperature_k(inlet_k, sensors[0].model_k, sensors[1].model_k)
        return float((outlet_k - expected_k) / weight)

    def _used_k(self, sensor: SensorMemory, value_k: float) -> float:
        """Return the temperature to go on with: the measured one, or the model's with its margin."""
        if not sensor.bad_s:
            return value_k
        limits = self._parameters.limits
        margin_k = min(LEAST_MARGIN_K + MARGIN_K_S * sensor.bad_s, LARGEST_MARGIN_K)
        middle_k = 0.5 * (limits.min_temperature_k + limits.max_temperature_k)
        nearness = (sensor.model_k - middle_k) / (limits.max_temperature_k - middle_k)
        return sensor.model_k + margin_k * min(max(nearness, -1.0), 1.0)

    def _cooling_judged(
        self,
        cooling: CoolingMemory,
        state: VehicleState,
        reading: PackReading | None,
        commanded: Command | None,
        elapsed_s: float,
    ) -> CoolingMemory:
        """Return for how long cooling has had no effect, or has not followed."""
        taken_w = expected_w = 0.0
        # A car without sensors of the coolant shows no effect, and lacks none.
        if reading is not None and math.isfinite(
            reading.coolant_outlet_k - reading.coolant_inlet_k
        ):
            taken_w = self._flow_w_k * (reading.coolant_outlet_k - reading.coolant_inlet_k)
            expected_w = self._model.cooling_w(state, _temperatures(state))
        asked_w = 0.0 if commanded is None else commanded.compressor_power_w
        return cooling.after(elapsed_s, taken_w, expected_w, state.compressor_power_w, asked_w)

    def _report(
        self, state: VehicleState, memory: PackMemory, measured_k: list[float], other: str
    ) -> PackReport:
        first, last, cooling = memory.cell_1, memory.cell_n, memory.cooling
        contradicts = memory.contradicted_s > CONTRADICTION_S
        is_bad = bool(first.bad_s or last.bad_s or other or contradicts)
        if not (is_bad or cooling.has_no_effect or cooling.is_ignored):
            return PackReport(state)
        sensors = {"1": first, "N": last}
        bad = [name for name, sensor in sensors.items() if sensor.bad_s]
        both = len(bad) == len(sensors)
        cases = (
            (both, PackFault.BOTH_SENSORS),
            (len(bad) == 1, PackFault.ONE_SENSOR),
            (cooling.has_no_effect, PackFault.NO_EFFECT),
            (cooling.is_ignored, PackFault.NOT_FOLLOWED),
            (contradicts, PackFault.CONTRADICTION),
            (bool(other), PackFault.OTHER_VALUE),
        )
        faults = tuple(fault for holds, fault in cases if holds)
        parts = [
            f"cell {name} measured at {value_k:.1f} K, by the model {sensors[name].model_k:.1f} K"
            for name, value_k in zip(sensors, measured_k, strict=True)
            if name in bad
        ]
        told = {PackFault.ONE_SENSOR, PackFault.BOTH_SENSORS, PackFault.OTHER_VALUE}
        parts += [other, *(fault.value for fault in faults if fault not in told)]
        share = 1.0
        if both:
            steps = math.floor(min(sensor.bad_s for sensor in sensors.values()) / REDUCTION_EVERY_S)
            share = max(1.0 - REDUCTION * steps, LEAST_SHARE)
        return PackReport(state, faults, "; ".join(filter(None, parts)), share)


def _temperatures(state: VehicleState) -> tuple[float, float]:
    return state.cell_1_temperature_k, state.cell_n_temperature_k


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
