"""A controller as C99 for an electronic control unit: its sources and its numbers.

The folder holds what `MpcController` computes from a vehicle and a leader with its preview to a limited
command; ``controller.h`` states the duties of the caller.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple
from pathlib import Path

import numpy as np

from iptm_controller.c_sources import C_SOURCES
from iptm_controller.controller import MpcController
from iptm_controller.forecast import past_room
from iptm_controller.lead_check import unpredicted_s
from iptm_controller.measurements import MOTION_RANGES, PACK_RANGES
from iptm_controller.ocp.layout import layout_header
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.ocp.stage_code import TABLE
from iptm_controller.preview_trust import lead_ticks
from iptm_controller.solvers.riccati.backend import SwitchingNumbers
from iptm_controller.solvers.riccati.stage_program import stage_program
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.temperature_value import TemperatureValuation
from iptm_controller.tick_library import VEHICLE
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray

SOURCES = (
    "riccati",
    "switching",
    "tick_data",
    "forecast",
    "guard",
    "prices",
    "limiter",
    "fallback",
    "sound",
    "controller",
)
PREVIEW_ROOM = 128
"""Nodes of the longest preview that is taken."""
HEADERS = ("real", "stages", "vehicle", "solver_size")


def controller_code(controller: MpcController) -> dict[str, str]:
    """Return the C files of a controller by name.

    Raises:
        ParameterError: the horizon has thermal phases or steps that are watched inside, or the strategy
            optimises nothing.
    """
    options, builder = controller.options, controller.plan_data.builder
    horizon = options.horizon
    if horizon.motion_steps < horizon.steps or builder.watches_inside:
        raise ParameterError(
            f"horizon is {horizon} with ticks of {options.tick_s:g} s; allowed for C: phases of motion, with "
            "steps of a tick or of more than 2.5 s"
        )
    if options.strategy.is_rule_based or not isinstance(controller.backend, SwitchingCheck):
        raise ParameterError(
            f"strategy is '{options.strategy.name}'; allowed for C: strategies that optimise"
        )
    smoothing = DEFAULT_SMOOTHING.scaled(options.solver.smoothing_factor)
    problem = OptimalControlProblem(horizon, controller.model, smoothing)
    program = stage_program(problem, lanes=1)
    names = [*(f"{name}.c" for name in SOURCES), *(f"{name}.h" for name in SOURCES)]
    names += [f"{name}.h" for name in HEADERS]
    files = C_SOURCES.read(*names)
    files |= {f"stages_{place}.c": text for place, text in enumerate(program.sources)}
    files |= {"layout.h": layout_header(), "stage_sizes.h": program.header}
    files["controller_data.h"] = _header(controller)
    files["controller_data.c"] = _data(controller, problem, controller.backend.numbers)
    numbers = program.functions.prepare(problem.numbers)
    files["controller_data.c"] += f"\nconst iptm_real {TABLE}[] = {_braced(map(float, numbers))};\n"
    return files


def limit_numbers(model: ModelParameters, tick_s: float) -> tuple[float, ...]:
    """Return the numbers of ``iptm_limits`` in their order."""
    limits, gap = model.limits, model.gap
    return (
        limits.min_acceleration_m_s2,
        limits.max_acceleration_m_s2,
        limits.max_jerk_m_s3,
        limits.max_speed_m_s,
        limits.min_compressor_power_w,
        limits.max_compressor_power_w,
        limits.lowest_thermal_power_w,
        limits.max_compressor_rate_w_s,
        limits.min_temperature_k,
        gap.standstill_gap_m,
        gap.time_headway_s,
        tick_s,
    )


def _header(controller: MpcController) -> str:
    options, grid = controller.options, controller.grid
    leads = lead_ticks(options.tick_s)
    sizes = {
        "STEPS": grid.steps,
        "PARAMETERS": grid.parameter_count,
        "MAX_ITERATIONS": options.solver.max_iterations,
        "SHIFTED_PLAN_TICKS": options.shifted_plan_ticks,
        "SAFE_LAW_TICKS": options.safe_law_ticks,
        "LEADS": len(leads),
        "PREDICTIONS": leads[-1] + 1,
        "PAST_ROOM": past_room(options.tick_s),
        "PREVIEW_ROOM": PREVIEW_ROOM,
    }
    defines = "".join(f"#define IPTM_{name} {value}\n" for name, value in sizes.items())
    return f"""/* Numbers of one controller: horizon {options.horizon}, strategy {options.strategy.name}. */
#ifndef IPTM_CONTROLLER_DATA_H
#define IPTM_CONTROLLER_DATA_H

#include "forecast.h"
#include "prices.h"
#include "riccati.h"
#include "switching.h"
#include "tick_data.h"
#include "vehicle.h"

{defines}
extern const iptm_limits iptm_limits_of_model;
extern const iptm_vehicle iptm_lowest_plausible, iptm_highest_plausible;
extern const iptm_forecaster iptm_forecaster_of_controller;
extern const iptm_grid iptm_grid_of_horizon;
extern const iptm_horizon iptm_horizon_of_solver;
extern const iptm_options iptm_solver_options;
extern const iptm_switching iptm_switching_numbers;
extern const iptm_valuation iptm_valuation_of_strategy;
extern const iptm_strategy iptm_strategy_of_controller;

#endif
"""


def _data(
    controller: MpcController, problem: OptimalControlProblem, switching: SwitchingNumbers
) -> str:
    options, grid, builder = controller.options, controller.grid, controller.plan_data.builder
    limits, solver = controller.model.limits, options.solver
    horizon = grid.horizon
    nodes_s, lengths_s = horizon.node_times_s, horizon.step_lengths_s
    sample_steps = np.searchsorted(nodes_s, grid.sample_times_s, side="right") - 1
    tables: Mapping[str, FloatArray] = {
        "nodes_s": nodes_s,
        "lengths_s": lengths_s,
        "acceleration_intervals_s": builder.acceleration_intervals_s,
        "compressor_intervals_s": builder.compressor_intervals_s,
        "sample_times_s": grid.sample_times_s,
        "soft_prices": np.outer(lengths_s, astuple(problem.penalties)).ravel(),
    }
    places = {
        "sample_steps": np.clip(sample_steps, 0, grid.steps - 1),
        "step_places": grid.step_places,
        "sample_places": grid.sample_places,
        "kind_steps": [kind.count for kind in grid.stages],
    }
    strategy, valuation = builder.strategy, controller.valuation
    numbers = valuation.numbers if isinstance(valuation, TemperatureValuation) else [0.0] * 17
    ranges = MOTION_RANGES | PACK_RANGES
    lines = [
        '#include "controller_data.h"\n\n#include <math.h>\n#include <stddef.h>\n\n#include "stages.h"\n',
        *(
            f"static const double {name}[] = {_braced(map(float, values))};"
            for name, values in tables.items()
        ),
        *(
            f"static const int {name}[] = {{{', '.join(str(int(value)) for value in values)}}};"
            for name, values in places.items()
        ),
        "",
        _struct(
            "iptm_limits iptm_limits_of_model",
            *limit_numbers(controller.model, options.tick_s),
        ),
        *(
            _struct(
                f"iptm_vehicle iptm_{name}_plausible", *(ranges[part][side] for part in VEHICLE)
            )
            for side, name in enumerate(("lowest", "highest"))
        ),
        _struct(
            "iptm_forecaster iptm_forecaster_of_controller",
            options.tick_s,
            horizon.motion_duration_s,
            options.max_preview_age_s,
            *unpredicted_s(controller.model.gap),
            "IPTM_LEADS",
            _braced(lead_ticks(options.tick_s)),
            "IPTM_PAST_ROOM",
            "IPTM_PREVIEW_ROOM",
        ),
        _struct("iptm_valuation iptm_valuation_of_strategy", *numbers),
        _struct(
            "iptm_grid iptm_grid_of_horizon",
            grid.steps,
            horizon.motion_steps,
            grid.sample_times_s.size,
            grid.motion_samples,
            "nodes_s",
            "lengths_s",
            "acceleration_intervals_s",
            "compressor_intervals_s",
            "sample_times_s",
            "sample_steps",
            "step_places",
            "sample_places",
            limits.max_speed_m_s,
        ),
        _struct(
            "iptm_horizon iptm_horizon_of_solver",
            grid.steps,
            "IPTM_MAX_ITERATIONS",
            "kind_steps",
            "soft_prices",
            "lengths_s",
            "NULL",
        ),
        _struct(
            "iptm_options iptm_solver_options",
            solver.tolerance,
            solver.initial_barrier,
            0.0,
            "NULL",
            solver.warm_start_iterations,
            "IPTM_MAX_ITERATIONS",
        ),
        _struct(
            "iptm_switching iptm_switching_numbers",
            _braced(switching.candidates),
            switching.rate_1_s,
            _braced(switching.levels),
            switching.try_every,
            int(switching.simulates),
        ),
        _struct(
            "iptm_strategy iptm_strategy_of_controller",
            strategy.scale,
            _braced(strategy.weights.values()),
            strategy.reference_temperature_k,
            limits.min_temperature_k,
            strategy.coldest_below_limit_k,
            strategy.headway_price_1_m2_s,
        ),
    ]
    return "\n".join(lines)


def _struct(declaration: str, *values: float | str) -> str:
    written = (value if isinstance(value, str) else _number(value) for value in values)
    return f"const {declaration} = {{{', '.join(written)}}};\n"


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    return repr(float(value)) if math.isfinite(value) else "INFINITY"


def _braced(values: Iterable[float]) -> str:
    return "{" + ", ".join(map(_number, values)) + "}"


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a folder, which is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
