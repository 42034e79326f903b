"""Functions of a tick in C: their library, and arrays and structures to call them with.

Each has a readable form in Python, which runs where there is no compiler. Both give the same numbers, to the
last bit.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.ocp.layout_header import layout_header
from iptm_core.compilation import address, cache_directory, compile_sources, find_compiler
from iptm_core.errors import SolverSetupError
from iptm_core.state import FloatArray, LeaderPreview, LeaderState

_SOURCE_FOLDER = Path(__file__).resolve().parent / "c"
_FILES = ("tick_data.c", "tick_data.h", "lead_motion.c", "lead_motion.h", "vehicle.h", "real.h")
INT, DOUBLE, POINTER = ctypes.c_int, ctypes.c_double, ctypes.c_void_p
_MOTIONS_KEPT = 8
_motions: dict[int, tuple[LeaderPreview, Motion]] = {}
"""Motions of the newest previews, by the identity of the preview."""


_VEHICLE = (
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
numbers_of = attrgetter(*_VEHICLE)
"""Numbers of a state, in the order of `Vehicle`."""


class Vehicle(ctypes.Structure):
    """The ego vehicle at one instant."""

    _fields_ = tuple((name, DOUBLE) for name in _VEHICLE)


class Motion(ctypes.Structure):
    """The nodes of a preview."""

    _fields_ = (
        ("nodes", INT),
        ("times_s", POINTER),
        ("positions_m", POINTER),
        ("speeds_m_s", POINTER),
    )


def motion_of(preview: LeaderPreview) -> Motion:
    """Return the nodes of a preview, of which all arrays have the length of the first."""
    kept = _motions.get(id(preview))
    if kept is not None:
        return kept[1]
    columns = preview.times_s, preview.positions_m, preview.speeds_m_s
    arrays = [np.ascontiguousarray(each, dtype=np.float64) for each in columns]
    motion = Motion(arrays[0].size, *map(address, arrays))
    motion.kept = arrays
    return keep_motion(preview, motion)


def keep_motion(preview: LeaderPreview, motion: Motion) -> Motion:
    """Note the motion of a preview, whose arrays it points to."""
    if len(_motions) >= _MOTIONS_KEPT:
        _motions.clear()
    _motions[id(preview)] = preview, motion
    return motion


def tick_library(*, is_wanted: bool) -> ctypes.PyDLL | None:
    """Return the library; None where it is not wanted or no compiler was found."""
    compiler = find_compiler() if is_wanted else None
    return None if compiler is None else _library(compiler, cache_directory())


@lru_cache
def _library(compiler: tuple[str, ...], *_: object) -> ctypes.PyDLL:
    fixed = {name: (_SOURCE_FOLDER / name).read_text("ascii") for name in _FILES}
    path = compile_sources([], {**fixed, "layout.h": layout_header()}, compiler)
    arguments = {
        "iptm_shift_plan": [POINTER, DOUBLE, *[POINTER] * 5],
        "iptm_pose_problem": [POINTER] * 8,
        "iptm_read_plan": [POINTER, DOUBLE, *[POINTER] * 3],
        "iptm_follow_preview": [POINTER, DOUBLE, DOUBLE, DOUBLE, INT, *[POINTER] * 5],
        "iptm_collision_threatens": [POINTER, POINTER, *[DOUBLE] * 4],
        "iptm_is_sound": [POINTER],
        "iptm_roughness_m2_s4": [POINTER, POINTER],
    }
    results: dict[str, Any] = {"iptm_roughness_m2_s4": DOUBLE}
    results |= dict.fromkeys(("iptm_shift_plan", "iptm_pose_problem", "iptm_read_plan"))
    try:
        # The interpreter lock is held: a call is shorter than it takes to get the lock again.
        library = ctypes.PyDLL(str(path))
        for name, types in arguments.items():
            function = getattr(library, name)
            function.argtypes, function.restype = types, results.get(name, INT)
    except (OSError, AttributeError) as error:
        raise SolverSetupError(f"the C code of a tick cannot be set up: {error}") from error
    return library


class LeadMotionInC:
    """Functions of a preview in C."""

    def __init__(self, library: ctypes.PyDLL, lead_times_s: FloatArray) -> None:
        """Keep the lead times at which predictions are compared."""
        self._library, self._lead_times_s = library, lead_times_s
        self._asserted_m_s = np.empty(lead_times_s.size)
        self._leads = lead_times_s.size, address(lead_times_s)
        self._asserted = address(self._asserted_m_s)

    def is_sound(self, preview: LeaderPreview) -> bool:
        """Return whether a preview without bounds has no fault and nowhere moves backwards."""
        size = preview.times_s.size
        is_whole = size == preview.positions_m.size == preview.speeds_m_s.size
        if not is_whole or preview.bounds_m.size:
            return False
        return bool(self._library.iptm_is_sound(ctypes.byref(motion_of(preview))))

    def roughness_m2_s4(self, before: LeaderPreview, now: LeaderPreview) -> float:
        """Return the same as the function of this name in `preview_trust`."""
        pair = ctypes.byref(motion_of(before)), ctypes.byref(motion_of(now))
        return float(self._library.iptm_roughness_m2_s4(*pair))

    def joined(
        self, leader: LeaderState, measured: Sequence[LeaderState], preview: LeaderPreview
    ) -> tuple[LeaderPreview, tuple[float, ...]]:
        """Return the past and what a preview says, and the speeds asserted for the lead times."""
        past, room = len(measured) - 1, preview.times_s.size + len(measured)
        columns = np.empty((3, room))
        for place in range(past):
            state = measured[place]
            columns[:, place] = state.time_s, state.position_m, state.speed_m_s
        first, row = address(columns), 8 * room
        rows = first, first + row, first + 2 * row
        nodes = past + self._library.iptm_follow_preview(
            ctypes.byref(motion_of(preview)),
            leader.time_s,
            leader.position_m,
            preview.known_until_s,
            *self._leads,
            *(each + 8 * past for each in rows),
            self._asserted,
        )
        motion = LeaderPreview(*columns[:, :nodes])
        keep_motion(motion, Motion(nodes, *rows))
        return motion, tuple(self._asserted_m_s.tolist())
