"""Random trips of the suite's own FMUs in which a master does one thing wrong, from a seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.extras.iptm_fmi.master import Instance, fmpy

Refused = fmpy.fmi1.FMICallException
Rng = np.random.Generator
UNITS = ("plant", "meter", "controller")
LONGEST = 6
NOT_FINITE = (math.nan, math.inf, -math.inf)
INPUTS = {
    "plant": ("acceleration_command", "compressor_power_command", "slope", "road_nodes"),
    "meter": ("speed_measured", "slope", "road_nodes"),
    "controller": ("position", "speed", "cell_1_temperature", "leader_speed", "preview_nodes"),
}
OUTPUTS = {
    "plant": ("position", "speed", "cell_1_temperature", "battery_energy", "charge"),
    "meter": ("position", "speed", "cell_n_temperature", "battery_energy", "state_of_charge"),
    "controller": ("acceleration_command", "compressor_power_command", "rung", "iterations"),
}
FIXED = {"plant": "state_of_charge", "meter": "position", "controller": "foreseen_aging_rate"}
ROAD = "a road that goes back"
COMPUTED = {"plant": "battery_energy", "meter": "charge", "controller": "rung"}


def inputs(unit: str, rng: Rng, tick: int) -> dict[str, Any]:
    """Return inputs of a tick that are in order."""
    slope = rng.uniform(-0.05, 0.05, 3)
    road = {"road_nodes": 3.0, "road_position": [-50.0, 30.0, 900.0], "road_slope": slope}
    if unit == "plant":
        command_w = rng.uniform(0.0, 1500.0)
        accelerates = rng.uniform(-0.5, 1.5)
        return {
            "acceleration_command": accelerates,
            "compressor_power_command": command_w,
            **road,
        }
    if unit == "meter":
        return {"speed_measured": tick * rng.uniform(0.5, 1.0), **road}
    times = np.arange(10.0) + tick
    moved = {"preview_time": times, "preview_position": 60.0 + 10.0 * times}
    return {
        "position": 10.0 * tick,
        "speed": 10.0 + rng.uniform(-0.2, 0.2),
        "leader_position": 60.0 + 10.0 * tick,
        "leader_speed": 10.0,
        "preview_nodes": 10.0,
        "preview_speed": np.full(10, 10.0),
        **moved,
        **road,
    }


def _unknown(rng: Rng) -> list[int]:
    return [int(rng.integers(10_000, 4_000_000_000))]


def _write(one: Instance, place: int, value: float) -> None:
    setter = one.unit.setFloat64 if one.is_3 else one.unit.setReal
    setter([place], [value])


def _read(one: Instance, places: list[int]) -> None:
    (one.unit.getFloat64 if one.is_3 else one.unit.getReal)(places)


def _several(one: Instance, unit: str, rng: Rng) -> None:
    names = [name for name in INPUTS[unit] if not name.endswith("nodes")][:2]
    places = [one.places[name][0] for name in names]
    setter = one.unit.setFloat64 if one.is_3 else one.unit.setReal
    setter(places, [0.01, float(rng.choice(NOT_FINITE))])


def _road(one: Instance, rng: Rng, time_s: float) -> None:
    first_m = rng.uniform(0.0, 100.0)
    one.put(road_nodes=2.0, road_position=[first_m, first_m - rng.uniform(0.0, 50.0)])
    one.step(time_s)


def _bytes(one: Instance, rng: Rng) -> None:
    wrong = bytes(int(rng.integers(1, 500)))
    if one.is_3:
        one.unit.deserializeFMUState(wrong)
    else:
        one.unit.deSerializeFMUstate(wrong)


Fault = Callable[[Instance, str, Rng, float], Any]
FAULTS: dict[str, Fault] = {
    "an input not finite": lambda one, unit, rng, _: one.put(
        **{str(rng.choice(INPUTS[unit])): rng.choice(NOT_FINITE)}
    ),
    "an input out of range": lambda one, unit, rng, _: one.put(
        **{str(rng.choice(INPUTS[unit])): float(rng.choice([-1e30, 1e30]))}
    ),
    "one of several not finite": lambda one, unit, rng, _: _several(one, unit, rng),
    "an output written": lambda one, unit, rng, _: one.put(**{COMPUTED[unit]: rng.uniform()}),
    "a start written late": lambda one, unit, *_: one.put(**{FIXED[unit]: 0.5}),
    "an unknown reference read": lambda one, _, rng, __: _read(one, _unknown(rng)),
    "an unknown reference written": lambda one, _, rng, __: _write(one, _unknown(rng)[0], 1.0),
    "a step of 0": lambda one, _, __, time_s: one.step(time_s, 0.0),
    "a step backwards": lambda one, _, rng, time_s: one.step(time_s, -rng.uniform(1e-6, 5.0)),
    "a step that is no number": lambda one, _, rng, time_s: one.step(
        time_s, rng.choice(NOT_FINITE)
    ),
    "a step too long": lambda one, _, rng, time_s: one.step(time_s, rng.uniform(10.1, 1e9)),
    "a step from another time": lambda one, _, rng, time_s: one.step(
        time_s + float(rng.choice([-1.0, 1.0])) * rng.uniform(0.01, 50.0)
    ),
    "a step from no time": lambda one, _, rng, __: one.step(rng.choice(NOT_FINITE)),
    ROAD: lambda one, _, rng, time_s: _road(one, rng, time_s),
    "bytes of another state": lambda one, _, rng, __: _bytes(one, rng),
    "an initialization in a trip": lambda one, *_: one.unit.enterInitializationMode(),
    "a second end of it": lambda one, *_: one.unit.exitInitializationMode(),
}
BEFORE: dict[str, Fault] = {
    "an output read": lambda one, unit, *_: one.get(COMPUTED[unit]),
    "a step": lambda one, *_: one.step(0.0),
    "the end of the initialization": lambda one, *_: one.unit.exitInitializationMode(),
    "a start that is no time": lambda one, _, rng, __: (
        one.unit.enterInitializationMode(startTime=rng.choice(NOT_FINITE))
        if one.is_3
        else one.unit.setupExperiment(startTime=rng.choice(NOT_FINITE))
    ),
    "a start out of range": lambda one, unit, *_: one.put(**{FIXED[unit]: 1e30}),
}
"""What is wrong before the initialization."""


def drive(folder: Path, seed: int) -> tuple[str, bool, bool]:
    """Drive a faulty trip, and the same one without the fault beside it.

    Returns:
        What was wrong, whether it was refused, and whether it changed nothing: neither values at once nor the
        bits of outputs at the end.
    """
    rng = np.random.default_rng(seed)
    unit, version = str(rng.choice(UNITS)), int(rng.choice([2, 3]))
    path, is_before = folder / f"{unit}_{version}.fmu", bool(rng.uniform() < 0.2)
    what = str(rng.choice([*(BEFORE if is_before else FAULTS)]))
    fault = {**BEFORE, **FAULTS}[what]
    ticks, at = int(rng.integers(1, LONGEST)), int(rng.integers(0, LONGEST))
    refused, kept = False, True
    with Instance(path, begins=False) as one, Instance(path) as other:
        if is_before:
            refused = _is_refused(lambda: fault(one, unit, rng, 0.0))
        one.begin()
        for tick in range(ticks):
            given = inputs(unit, rng, tick)
            if not is_before and tick == min(at, ticks - 1):
                before = one.get(*INPUTS[unit], *OUTPUTS[unit])
                refused = _is_refused(lambda: fault(one, unit, rng, float(tick)))  # noqa: B023
                # The wrong road is an input of its own, which is replaced.
                kept = what == ROAD or one.get(*INPUTS[unit], *OUTPUTS[unit]) == before
            for each in (one, other):
                each.put(**given)
                each.step(float(tick))
        found = [each.get(*OUTPUTS[unit]) for each in (one, other)]
    return f"{unit} {version}: {what}", refused, kept and found[0] == found[1]


def _is_refused(act: Callable[[], Any]) -> bool:
    try:
        act()
    except Refused:
        return True
    return False
