"""Climate control as in cars: PI control of the cabin, heat pump before heater, rules for the pack."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iptm_cabin.parameters import CabinParameters, ClimateControl, PartFailure
from iptm_cabin.refrigerant_loop import AIR_J_KG_K
from iptm_cabin.thermal_functions import Inputs, ThermalFunctions
from iptm_cabin.thermal_model import PERSON_W
from iptm_core.frozen import replace
from iptm_core.units import CELSIUS_ZERO_K

GAIN_W_K = 700.0
INTEGRAL_W_K_S = 1.5
_WINDUP_K = 3.0
LARGEST_INTEGRAL_W = 3000.0
LARGEST_COOLING_W, LARGEST_HEATING_W = 8000.0, 8000.0
HOTTEST_CORE_C, CORE_GAIN_W_K = 68.0, 300.0
PACK_COOLING_W, PACK_HEATING_W = 3000.0, 2000.0
COOL_ABOVE_C, COOL_UNTIL_C = 35.0, 30.0
HEAT_BELOW_C, HEAT_UNTIL_C = 5.0, 10.0
BYPASS_C, RADIATOR_K = 30.0, 5.0
BOTH = "heater and cooling of the cabin are asked for together; the heater stays off"
_BOTH_W = 50.0
UNCHANGED_S = 60.0
"""A sensor that repeats a number to the last bit for as long is frozen."""


@dataclass(frozen=True)
class Memory:
    """What the control remembers.

    Attributes:
        integral_w: integral part of the PI control.
        pack: 1 while the pack is heated by rule, -1 while it is cooled.
        reading_k: last reading of the sensor, and for how long it has been the same.
    """

    integral_w: float = 0.0
    pack: float = 0.0
    reading_k: float = math.nan
    unchanged_s: float = 0.0


def steady_heat_w(cabin: CabinParameters, ambient_k: float, speed_m_s: float) -> float:
    """Return the heat that keeps air and interior at the set point."""
    apart_k = cabin.set_point_c + CELSIUS_ZERO_K - ambient_k
    conductance_w_k = (
        cabin.shell_conductance_w_k
        + cabin.shell_conductance_j_k_m * speed_m_s
        + cabin.open_windows_w_k
        + cabin.interior_outside_w_k
        + AIR_J_KG_K * cabin.fresh_share * cabin.blown_air_kg_s
    )
    gains_w = PERSON_W * cabin.occupants + cabin.blower_power_w
    return conductance_w_k * apart_k - gains_w - cabin.sun_aperture_m2 * cabin.sun_w_m2


class ClimateUnit:
    """Decides on the inputs of the thermal model, tick by tick."""

    def __init__(self, functions: ThermalFunctions) -> None:
        self._functions = functions
        self._cabin = functions.model.cabin

    def decide(
        self,
        states: tuple[float, ...],
        weather: tuple[float, ...],
        memory: Memory,
        commanded_w: float,
        duration_s: float,
    ) -> tuple[Inputs, Memory, str]:
        """Return inputs within the limits of the parts, the memory for the next call, and a report if any.

        Args:
            commanded_w: heat into the pack that the controller of the trip asks for, negative for cooling.
        """
        reading_k, memory, report = self._measure(states[0], memory, duration_s)
        wanted_w, memory = self._cabin_heat_w(reading_k, weather, memory, duration_s)
        pack_w, radiator, memory = self._pack(states, weather, memory, commanded_w)
        inputs, limited = self.within(states, weather, wanted_w, pack_w, radiator)
        return inputs, memory, report or limited

    def _measure(
        self, air_k: float, memory: Memory, duration_s: float
    ) -> tuple[float, Memory, str]:
        """Return what the sensor reads, NaN where it is not to be trusted."""
        broken = self._cabin.broken
        reading_k = air_k
        if broken is PartFailure.SENSOR_LOST:
            return math.nan, memory, "the cabin's sensor is lost; heat as the air outside asks for"
        if broken is PartFailure.SENSOR_FROZEN and not math.isnan(memory.reading_k):
            reading_k = memory.reading_k
        same = reading_k == memory.reading_k
        unchanged_s = memory.unchanged_s + duration_s if same else 0.0
        memory = replace(memory, reading_k=reading_k, unchanged_s=unchanged_s)
        if unchanged_s > UNCHANGED_S:
            return math.nan, memory, "the cabin's sensor repeats a reading; it counts as lost"
        return reading_k, memory, ""

    def _cabin_heat_w(
        self, reading_k: float, weather: tuple[float, ...], memory: Memory, duration_s: float
    ) -> tuple[float, Memory]:
        """Return the heat that the cabin asks for, negative for cooling."""
        cabin = self._cabin
        steady_w = steady_heat_w(cabin, weather[3], weather[0])
        if math.isnan(reading_k):
            return min(max(steady_w, -LARGEST_COOLING_W), LARGEST_HEATING_W), memory
        error_k = cabin.set_point_c + CELSIUS_ZERO_K - reading_k
        integral_w = memory.integral_w
        if abs(error_k) < _WINDUP_K:
            integral_w += INTEGRAL_W_K_S * error_k * duration_s
            integral_w = min(max(integral_w, -LARGEST_INTEGRAL_W), LARGEST_INTEGRAL_W)
        wanted_w = steady_w + GAIN_W_K * error_k + integral_w
        wanted_w = min(max(wanted_w, -LARGEST_COOLING_W), LARGEST_HEATING_W)
        return wanted_w, replace(memory, integral_w=integral_w)

    def _pack(
        self,
        states: tuple[float, ...],
        weather: tuple[float, ...],
        memory: Memory,
        commanded_w: float,
    ) -> tuple[float, float, Memory]:
        """Return heat into the pack, opening of the radiator, and the memory."""
        control = self._cabin.control
        pack_c = 0.5 * (states[4] + states[5]) - CELSIUS_ZERO_K
        air_c = weather[3] - CELSIUS_ZERO_K
        if control in {ClimateControl.COMMAND, ClimateControl.PREDICTIVE}:
            return commanded_w, 0.0, memory
        if control is ClimateControl.ALONE:
            return 0.0, 0.0, memory
        cool_above, cool_until = COOL_ABOVE_C, COOL_UNTIL_C
        heat_until, radiator = HEAT_UNTIL_C, 0.0
        if control is ClimateControl.PUBLISHED:
            cool_above, cool_until, heat_until = BYPASS_C, BYPASS_C - 1.0, HEAT_BELOW_C + 1.0
            radiator = float(pack_c > air_c + RADIATOR_K and pack_c > HEAT_UNTIL_C + 5.0)
        mode = memory.pack
        if pack_c > cool_above or (mode < 0.0 and pack_c > cool_until):
            mode = -1.0
        elif pack_c < HEAT_BELOW_C or (mode > 0.0 and pack_c < heat_until):
            mode = 1.0
        else:
            mode = 0.0
        heat_w = {-1.0: -PACK_COOLING_W, 0.0: 0.0, 1.0: PACK_HEATING_W}[mode]
        return heat_w, radiator, replace(memory, pack=mode)

    def within(
        self,
        states: tuple[float, ...],
        weather: tuple[float, ...],
        wanted_w: float,
        pack_w: float,
        radiator: float,
        ptc_w: float | None = None,
        by_loop_w: float | None = None,
    ) -> tuple[Inputs, str]:
        """Return what the parts can do of it; the heater takes what the heat pump cannot.

        Args:
            ptc_w: power of the heater; None for the rest of the demand.
            by_loop_w: heat by the loop; None for all that is wanted.
        """
        cabin = self._cabin
        no_loop = cabin.broken is PartFailure.COMPRESSOR
        largest_w = cabin.max_pack_heat_w
        pack_w = min(max(pack_w, -largest_w), largest_w)
        core_c = states[2] - CELSIUS_ZERO_K
        mixed_k = cabin.fresh_share * weather[3] + (1.0 - cabin.fresh_share) * states[0]
        given_w = cabin.core_conductance_w_k * (states[2] - mixed_k)
        allowed_w = max(given_w + CORE_GAIN_W_K * (HOTTEST_CORE_C - core_c), 0.0)
        wanted_w = min(wanted_w, allowed_w)
        if cabin.broken is PartFailure.FAN:
            wanted_w = max(wanted_w, 0.0)
        by_loop_w = wanted_w if by_loop_w is None else min(by_loop_w, wanted_w)
        if no_loop or (wanted_w > 0.0 and not cabin.is_heat_pump):
            by_loop_w = min(by_loop_w, 0.0)
        report = ""
        if pack_w > 0.0 and not cabin.is_heat_pump:
            pack_w, report = 0.0, "there is no heat pump, and nothing heats the pack"
        if no_loop:
            by_loop_w = pack_w = 0.0
        asked = (by_loop_w, pack_w, 0.0, radiator)
        served_w, pack_w, _, _ = self._functions.possible(states, asked, weather)
        if asked[:2] != (served_w, pack_w):
            report = report or self._functions.loop(states, asked, weather).limit
        if ptc_w is not None and served_w < 0.0:
            report = report or (BOTH if ptc_w > _BOTH_W else "")
            ptc_w = 0.0
        rest_w = max(wanted_w, 0.0) - max(served_w, 0.0)
        heater_w = rest_w if ptc_w is None else min(ptc_w, max(allowed_w - max(served_w, 0.0), 0.0))
        heater_w = min(max(heater_w, 0.0), cabin.max_ptc_power_w)
        if cabin.broken is PartFailure.PTC:
            heater_w = 0.0
        broken = cabin.broken in {PartFailure.COMPRESSOR, PartFailure.PTC, PartFailure.FAN}
        report = f"{cabin.broken} is broken" if broken else report
        return (served_w, pack_w, heater_w, radiator), report
