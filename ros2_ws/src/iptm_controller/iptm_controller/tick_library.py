"""Functions of a tick in C: their library, and arrays and structures to call them with.

Each has a readable form in Python, which the tests compare it with: both give the same numbers, to the last
bit.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from iptm_controller.c_sources import C_SOURCES
from iptm_controller.ocp.layout import layout_header
from iptm_core.compilation import cache_directory, compile_sources
from iptm_core.errors import SolverSetupError
from iptm_core.physics.ops import doubles

_UNITS = "tick_data", "forecast", "guard", "prices", "pack"
_FILES = (*(f"{name}.{end}" for name in _UNITS for end in "ch"), "vehicle.h", "real.h")
INT, DOUBLE, POINTER = ctypes.c_int, ctypes.c_double, ctypes.c_void_p

VEHICLE = (
    "time_s",
    "position_m",
    "speed_m_s",
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "acceleration_m_s2",
    "compressor_power_w",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
)
numbers_of = attrgetter(*VEHICLE)
"""Numbers of a state, in the order of `vehicle`."""


def vehicle() -> tuple[Any, Callable[..., None]]:
    """Return the ego vehicle at one instant, as `doubles`."""
    return doubles(len(VEHICLE))


class CLeader(ctypes.Structure):
    """A lead vehicle at one instant."""

    _fields_ = (("time_s", DOUBLE), ("position_m", DOUBLE), ("speed_m_s", DOUBLE))


def tick_library() -> ctypes.PyDLL:
    """Return the library.

    Raises:
        SolverSetupError: no C compiler is installed, or the code cannot be compiled or loaded.
    """
    return _library(cache_directory())


@lru_cache
def _library(_folder: Path) -> ctypes.PyDLL:
    files = {**C_SOURCES.read(*_FILES), "layout.h": layout_header()}
    path = compile_sources(files)
    arguments = {
        "iptm_shift_plan": [POINTER, DOUBLE, *[POINTER] * 5],
        "iptm_pose_problem": [POINTER] * 8,
        "iptm_read_plan": [POINTER, DOUBLE, *[POINTER] * 3],
        "iptm_collision_threatens": [POINTER, POINTER, *[DOUBLE] * 4],
        "iptm_forecast_leader": [POINTER] * 5,
        "iptm_value_temperatures": [POINTER] * 3,
        "iptm_watch_pack": [POINTER] * 4,
        "iptm_leader_at": [POINTER, POINTER, POINTER, DOUBLE],
    }
    results: dict[str, Any] = dict.fromkeys(arguments) | {
        "iptm_collision_threatens": INT,
        "iptm_watch_pack": INT,
        "iptm_leader_at": CLeader,
    }
    try:
        # The interpreter lock is held: a call is shorter than it takes to get the lock again.
        library = ctypes.PyDLL(str(path))
        for name, types in arguments.items():
            function = getattr(library, name)
            function.argtypes, function.restype = types, results[name]
    except (OSError, AttributeError) as error:
        raise SolverSetupError(f"the C code of a tick cannot be set up: {error}") from error
    return library
