"""Integration of the exact model over one interval of prescribed motion.

Classical Runge-Kutta of order four on the four cell states; energies, heat and charge are quadratures of
the same stages. What depends on the state of charge is taken at the start of the interval. One sub-step is an
expression graph of the very functions that the rest of the project uses. It is generated as C once for all
models of one form, with the numbers of a model as an argument, and called in a loop in C, see
``c/interval.c``; without a compiler it is interpreted, to the same bits.
"""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from iptm_core.compilation import address, cache_directory, compile_sources, find_compiler
from iptm_core.frozen import light
from iptm_core.number_table import split_numbers
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import BufferedFunction
from iptm_core.physics.power_thermal import CellPair
from iptm_core.state import ChannelCells, FloatArray
from iptm_plant_sim.actuators import Motion
from iptm_plant_sim.interval_model import AT_END, INTEGRALS, STATES, sub_step

_SOURCE = Path(__file__).resolve().parent / "c" / "interval.c"
_states_of = attrgetter(*STATES)
_NOTHING = (-0.0,) * len(INTEGRALS)
"""Plus any number, it is that number."""
_START = struct.Struct(f"{len(STATES) + len(INTEGRALS)}d")


@light
@dataclass(frozen=True)
class IntervalResult:
    """Cell states and electrics at the end of an interval, and energies over it.

    Attributes:
        traction_energy_j: electric traction energy, regeneration counted negative.
        regenerated_energy_j: its negative part, before the regenerative efficiency.
        battery_energy_j: energy at the terminals, positive when discharging.
        chiller_heat_j: heat taken from the coolant.
        battery_heat_j: heat generated in all cells, ohmic and entropic.
        pack_current_a: pack current at the end, positive when discharging.
        cell_current_a: cell current at the end.
        coolant_inlet_k: channel inlet temperature at the end.
        coolant_outlet_k: channel outlet temperature at the end.
        channel: all cells of a channel at the end; None where only two are integrated.
    """

    cell_1_temperature_k: float
    cell_n_temperature_k: float
    cell_1_capacity_loss: float
    cell_n_capacity_loss: float
    traction_energy_j: float
    regenerated_energy_j: float
    battery_energy_j: float
    chiller_heat_j: float
    battery_heat_j: float
    charge_c: float
    pack_current_a: float
    cell_current_a: float
    coolant_inlet_k: float
    coolant_outlet_k: float
    cell_1_voltage_v: float
    cell_n_voltage_v: float
    pack_voltage_v: float
    channel: ChannelCells | None = None

    @property
    def finite(self) -> bool:
        """False if the pack could not deliver the power asked for at some stage."""
        return math.isfinite(self.battery_energy_j + self.charge_c + self.pack_current_a)


@dataclass(frozen=True)
class PowerBounds:
    """What of the powers is possible in an interval.

    Attributes:
        traction_w: least traction power (negative): friction brakes supply the rest.
        battery_w: largest terminal power; an interval that asks for more is not `finite`.
    """

    traction_w: float
    battery_w: float


class IntervalIntegrator:
    """Integrates intervals of any number of sub-steps for one parameter set.

    Args:
        bounded: whether intervals have `PowerBounds`.
    """

    def __init__(self, parameters: ModelParameters, *, bounded: bool = False) -> None:
        code = _code(parameters, bounded=bounded)
        self._held = np.zeros(4 if bounded else 2)
        self._found = np.zeros(len(STATES) + len(INTEGRALS) + len(AT_END))
        self._integrate = code.on(self._held, self._found)

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
        self._integrate(motion, slopes_rad)
        found: Sequence[Any] = self._found.tolist()
        return IntervalResult(*found)


class _Code:
    """A sub-step and the end of an interval as functions: in C, else interpreted."""

    def __init__(self, parameters: ModelParameters, *, bounded: bool) -> None:
        self._functions = sub_step(parameters, bounded=bounded)
        compiler = find_compiler()
        self._run: Any = None
        if compiler is not None:
            text, numbers = split_numbers(_source(self._functions), "w", 0)
            self._run = _library(text, compiler, cache_directory()).iptm_integrate
            self._numbers = np.array(numbers)

    def on(self, held: FloatArray, found: FloatArray) -> Callable[[Motion, FloatArray], None]:
        """Return the integration of a motion on slopes, on two fixed buffers."""
        if self._run is None:
            return self._interpreted(held, found)
        run, numbers, fixed, end = self._run, address(self._numbers), address(held), address(found)

        def integrate(motion: Motion, slopes_rad: FloatArray) -> None:
            lengths_s = motion.lengths_s
            columns = lengths_s, motion.accelerations_m_s2, slopes_rad, motion.speeds_m_s
            run(lengths_s.size, numbers, fixed, *map(address, columns), end)

        return integrate

    def _interpreted(
        self, held: FloatArray, found: FloatArray
    ) -> Callable[[Motion, FloatArray], None]:
        """Return the reference of `iptm_integrate`."""
        values, at_end = np.split(found, [len(STATES) + len(INTEGRALS)])
        step, end = (BufferedFunction(each, {"held": held}) for each in self._functions)

        def integrate(motion: Motion, slopes_rad: FloatArray) -> None:
            given = step.arguments
            for i, speeds_m_s in enumerate(motion.speeds_m_s):
                given["values"][:] = values
                given["acceleration_m_s2"][:] = motion.accelerations_m_s2[i]
                given["length_s"][:] = motion.lengths_s[i]
                given["slopes_rad"][:] = slopes_rad[2 * i : 2 * i + 3]
                given["speeds_m_s"][:] = speeds_m_s
                step()
                values[:] = step.results["moved"]
            last = end.arguments
            last["values"][:] = values
            last["acceleration_m_s2"][:] = motion.accelerations_m_s2[-1]
            last["slope_rad"][:] = slopes_rad[-1]
            last["speed_m_s"][:] = motion.speeds_m_s[-1, -1]
            end()
            at_end[:] = end.results["at_end"]

        return integrate


@lru_cache(maxsize=16)
def _code(parameters: ModelParameters, *, bounded: bool) -> _Code:
    """Return the code of a parameter set, kept for the next vehicle with the same one."""
    return _Code(parameters, bounded=bounded)


@lru_cache(maxsize=16)
def _library(text: str, compiler: tuple[str, ...], *_: object) -> ctypes.PyDLL:
    """Return the library of a generated model, whose numbers are arguments."""
    files = {_SOURCE.name: _SOURCE.read_text("ascii"), "model.c": text}
    library = ctypes.PyDLL(str(compile_sources([], files, compiler)))
    library.iptm_integrate.argtypes = [ctypes.c_int, *[ctypes.c_void_p] * 7]
    library.iptm_integrate.restype = None
    return library


def _source(functions: Iterable[ca.Function]) -> str:
    generator = ca.CodeGenerator("model.c", {"with_header": False})
    for function in functions:
        generator.add(function)
    return str(generator.dump())
