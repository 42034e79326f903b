"""Entrants from files: a Python class, C by the header of `iptm codegen`, an FMU, bags of a node of ROS 2."""

from __future__ import annotations

import ctypes
import math
import weakref
from collections.abc import Mapping
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

import iptm
from iptm_controller.controller import MpcController
from iptm_controller.ocp.data import UNBOUNDED_W
from iptm_controller.options import ControllerOptions
from iptm_controller.tick_library import numbers_of
from iptm_core.compilation import compile_sources
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray, LeaderState, VehicleState
from iptm_ecu.controller_code import controller_code
from iptm_fmi.controller_unit import PREVIEW_ROOM
from iptm_fmi.foreign_unit import ForeignUnit
from iptm_fmi.unit import ROAD_ROOM

DOOR = Path(__file__).with_name("door.c")
ALLOWED = "NAME.py:CLASS, NAME.c, a folder of codegen, NAME.fmu, a folder with a bag for each task"
OUTPUTS = ("acceleration_command", "compressor_power_command")
TICK_S = 1.0
FEWEST_BEHIND_M = 25.0
"""Of the first node of the road behind the vehicle, see docs/how-to/fmi.md."""


def place_of(text: str) -> tuple[Path, str]:
    """Return file or folder of an entrant, and the name of its class.

    Raises:
        ScenarioError: the file does not exist.
    """
    name, _, inside = text.partition(":")
    path = Path(name)
    kinds = {".py": bool(inside), ".c": not inside, ".fmu": not inside}
    if not path.exists() or not (path.is_dir() or kinds.get(path.suffix, False)):
        raise ScenarioError(f"--entrant is {text!r}; allowed: {ALLOWED}")
    return path.resolve(), inside


def controller_of(path: Path, inside: str, car: ModelParameters) -> iptm.Controller:
    """Return a fresh controller of a file.

    Raises:
        IptmError: it cannot be loaded.
    """
    if path.suffix == ".py":
        return of_class(path, inside)
    return FromUnit(path) if path.suffix == ".fmu" else FromC(path, car)


def of_class(path: Path, name: str) -> iptm.Controller:
    """Return an object of a class of a Python file, made without arguments."""
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ScenarioError(f"{path} is not a Python file; allowed: {ALLOWED}")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    made: Any = getattr(module, name, None)
    if made is None:
        raise ScenarioError(f"{path.name} has no {name!r}; allowed: {ALLOWED}")
    controller: iptm.Controller = made()
    return controller


class FromC:
    """C that answers as ``iptm_decide`` of ``controller.h``.

    Args:
        path: the file that defines it, or a folder that `iptm codegen` has written, with that file in it.
        car: parameters of the vehicle, for the headers of a single file.
    """

    def __init__(self, path: Path, car: ModelParameters) -> None:
        if path.is_dir():
            parts = [each for each in sorted(path.iterdir()) if each.suffix in {".c", ".h"}]
            files = {each.name: each.read_text("utf-8") for each in parts if each.name != "bench.c"}
        else:
            made = controller_code(MpcController(car, ControllerOptions()))
            files = {name: text for name, text in made.items() if name.endswith(".h")}
            files[path.name] = path.read_text("utf-8")
        library = ctypes.CDLL(str(compile_sources({**files, DOOR.name: DOOR.read_text("utf-8")})))
        library.iptm_door_size.restype = ctypes.c_size_t
        self._decide = library.iptm_door_decide
        self._place = ctypes.create_string_buffer(library.iptm_door_size())

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        """Return the command of a tick."""
        state, leader = measured.state, measured.leader
        seen, road = measured.preview, measured.slope
        command = np.zeros(2)
        ahead = None if leader is None else (leader.time_s, leader.position_m, leader.speed_m_s)
        self._decide(
            self._place,
            _numbers(None if state is None else numbers_of(state)),
            _numbers(ahead),
            seen.times_s.size,
            *map(_numbers, (seen.times_s, seen.positions_m, seen.speeds_m_s)),
            road.positions_m.size,
            *map(_numbers, (road.positions_m, road.slopes_rad)),
            ctypes.c_double(UNBOUNDED_W),
            _numbers(command),
        )
        return iptm.Command(*command.tolist())


def _numbers(values: Any) -> Any:
    if values is None:
        return None
    array: FloatArray = np.ascontiguousarray(values, dtype=np.float64)
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


class FromUnit:
    """An FMU with the variables of ``iptm fmu controller``, of which it may leave out inputs."""

    def __init__(self, path: Path) -> None:
        self._unit = ForeignUnit(path)
        weakref.finalize(self, self._unit.close)
        missing = sorted({*OUTPUTS} - {*self._unit.units})
        if missing:
            raise ScenarioError(
                f"{path.name} has no {', '.join(missing)}; allowed: outputs {', '.join(OUTPUTS)}"
            )
        self._has_begun = False

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        """Return the command of a tick; without a measured vehicle or leader it brakes gently."""
        state, leader = measured.state, measured.leader
        if state is None or leader is None:
            return iptm.Command(-1.0, 0.0)
        if not self._has_begun:
            self._unit.start(state.time_s)
            self._has_begun = True
        given = inputs(measured, state, leader).items()
        self._unit.put({name: value for name, value in given if name in self._unit.units})
        self._unit.step(state.time_s, TICK_S)
        return iptm.Command(*self._unit.get(OUTPUTS))


def inputs(
    measured: iptm.Measurements, state: VehicleState, leader: LeaderState
) -> Mapping[str, float]:
    """Return the measurements under the names of ``iptm fmu controller``."""
    seen = measured.preview
    behind_m = state.position_m - FEWEST_BEHIND_M
    first = max(int(measured.slope.positions_m.searchsorted(behind_m)) - 1, 0)
    seen_s = seen.times_s[:PREVIEW_ROOM]
    road_m = measured.slope.positions_m[first : first + ROAD_ROOM]
    named = {
        "position": state.position_m,
        "speed": state.speed_m_s,
        "acceleration": state.acceleration_m_s2,
        "compressor_power": state.compressor_power_w,
        "cell_1_temperature": state.cell_1_temperature_k,
        "cell_n_temperature": state.cell_n_temperature_k,
        "cell_1_capacity_loss": state.cell_1_capacity_loss,
        "cell_n_capacity_loss": state.cell_n_capacity_loss,
        "leader_position": leader.position_m,
        "leader_speed": leader.speed_m_s,
        "preview_nodes": float(seen_s.size),
        "road_nodes": float(road_m.size),
    }
    arrays = {
        "preview_time": seen_s,
        "preview_position": seen.positions_m[: seen_s.size],
        "preview_speed": seen.speeds_m_s[: seen_s.size],
        "road_position": road_m,
        "road_slope": measured.slope.slopes_rad[first : first + ROAD_ROOM],
    }
    for name, values in arrays.items():
        named |= {f"{name}[{place}]": value for place, value in enumerate(values.tolist(), 1)}
    return named


def has_bags(path: Path) -> bool:
    """Whether a folder has the bags of a node: it has no C files."""
    return path.is_dir() and not (path / "controller.h").exists()


def recorded(folder: Path, trip: iptm.Trip) -> Mapping[str, FloatArray] | None:
    """Return the columns of the bag of a task in a folder of bags, None without one.

    Raises:
        IptmError: it cannot be read, or is another trip.
    """
    bag = folder / trip.name
    if not bag.exists():
        return None
    columns = iptm.load(bag).trajectory.to_arrays()
    if not math.isclose(columns["time_s"][-1], trip.ticks * trip.conditions.period_s):
        raise ScenarioError(
            f"{bag} ends at {columns['time_s'][-1]:g} s; allowed: the whole task {trip.name}"
        )
    return columns
