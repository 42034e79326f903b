"""A controller and the rule of the safety monitor as C99, and recorded ticks.

What is in the folder, and what is left to the caller, is said in ``controller.h`` and ``safety_monitor.h``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from iptm.closed_loop import run_closed_loop
from iptm_controller.c_sources import C_SOURCES
from iptm_controller.controller import MpcController
from iptm_controller.decision import Decision
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import build_route
from iptm_core.state import FloatArray
from iptm_ecu.controller_code import controller_code, write_files
from iptm_plant_sim.c_sources import C_SOURCES as PLANT_SOURCES
from iptm_plant_sim.plant import Plant

CMAKE = """cmake_minimum_required(VERSION 3.16)
project(iptm_controller C)
option(IPTM_FLOAT "solver in single precision" OFF)
set(CMAKE_C_STANDARD 99)
# Operations are done as they are written: no contraction to fused multiply-adds.
add_compile_options(-O2 -ffp-contract=off)
file(GLOB sources *.c)
list(FILTER sources EXCLUDE REGEX "bench[.]c$")
if(IPTM_FLOAT)
  add_compile_definitions(IPTM_FLOAT)
  file(GLOB solver riccati.c switching.c stages_*.c)
  set_source_files_properties(${solver} PROPERTIES COMPILE_OPTIONS -fsingle-precision-constant)
endif()
add_library(iptm_controller STATIC ${sources})
target_link_libraries(iptm_controller m)
add_executable(bench bench.c)
target_link_libraries(bench iptm_controller)
enable_testing()
add_test(NAME recorded_ticks COMMAND bench ${CMAKE_CURRENT_SOURCE_DIR}/ticks.bin)
"""


def write_controller(
    folder: Path,
    *,
    strategy: str | None,
    horizon: str | None,
    parameter_set: str | None,
    cycle: str,
    duration_s: float,
) -> int:
    """Write controller, safety monitor and recorded ticks into a folder; return the number of files.

    Args:
        folder: is made; files of the same names are replaced.
        strategy: of the controller; None for the default.
        horizon: of the controller; None for the default.
        parameter_set: of the model; None for the default.
        cycle: of the recorded ticks.
        duration_s: of the recorded ticks.

    Raises:
        IptmError: an argument is refused.
        OSError: a file cannot be written.
    """
    parameters = load_parameters(parameter_set or DEFAULT_SET).values
    options = ControllerOptions(
        strategy=strategy_by_name(strategy or DEFAULT_STRATEGY),
        horizon=MULTI_HORIZON if horizon is None else Horizon.parse(horizon),
    )
    files = code_of(parameters, options)
    write_files(folder, files)
    recorded_ticks(parameters, options, cycle, duration_s).tofile(folder / "ticks.bin")
    return len(files) + 1


def code_of(parameters: ModelParameters, options: ControllerOptions) -> dict[str, str]:
    """Return the files of a controller, of the safety monitor and of their build, by name."""
    files = controller_code(MpcController(parameters, options))
    files |= PLANT_SOURCES.read("safety_monitor.c", "safety_monitor.h")
    files |= C_SOURCES.read("bench.c")
    return files | {"CMakeLists.txt": CMAKE}


def recorded_ticks(
    parameters: ModelParameters, options: ControllerOptions, cycle: str, duration_s: float
) -> FloatArray:
    """Drive a trip and return what the controller was given and decided, as ``bench.c`` reads it."""
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    controller = MpcController(parameters, options)
    ticks: list[FloatArray] = []

    def record(_: int, measured: Measurements, decision: Decision) -> None:
        ticks.append(_tick(measured, decision, controller))

    run_closed_loop(route, Plant(parameters, route.slope.slope_at), controller, on_tick=record)
    return np.concatenate([[len(ticks)], *ticks])


def _tick(measured: Measurements, decision: Decision, controller: MpcController) -> FloatArray:
    state, leader = measured.state, measured.leader
    if state is None or leader is None:
        raise AssertionError("a trip behind a leader has both at every tick")
    value, slope, preview = decision.value, measured.slope, measured.preview
    numbers = [
        state.time_s,
        state.position_m,
        state.speed_m_s,
        state.cell_1_temperature_k,
        state.cell_n_temperature_k,
        state.acceleration_m_s2,
        state.compressor_power_w,
        state.cell_1_capacity_loss,
        state.cell_n_capacity_loss,
        leader.position_m,
        leader.speed_m_s,
        controller.plan_data.charge_w,
        value.cell_1_marginal_cost_1_k,
        value.cell_n_marginal_cost_1_k,
        value.temperature_weight_1_k2_s,
        value.reference_temperature_k,
        value.thermal_energy_price_1_j,
        controller.memory.foreseen_1_s,
        controller.power.most_m_s2,
    ]
    # The slope as far as a plan looks.
    first, last = slope.positions_m.searchsorted(
        [state.position_m - 100.0, state.position_m + 3000.0]
    )
    part = slice(max(int(first) - 1, 0), int(last) + 1)
    reached, command = controller.power.slower(None), decision.command
    return np.concatenate(
        [
            numbers,
            _table(preview.times_s, preview.positions_m, preview.speeds_m_s),
            _table(slope.positions_m[part], slope.slopes_rad[part]),
            _table(np.empty(0) if reached is None else reached),
            [command.acceleration_m_s2, command.compressor_power_w, decision.rung],
        ]
    )


def _table(*columns: FloatArray) -> FloatArray:
    return np.concatenate([[len(columns[0])], *columns])
