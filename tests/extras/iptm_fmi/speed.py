"""Print median times of steps of the FMUs, beside the controller of the suite, as a program."""

from __future__ import annotations

import ctypes
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from tests.extras.iptm_fmi.conftest import SET, versions
from tests.extras.iptm_fmi.drives import closed, recorded
from tests.extras.iptm_fmi.master import Instance

from iptm_controller.controller import MpcController
from iptm_controller.options import ControllerOptions
from iptm_core.parameters import load_parameters
from iptm_fmi.controller_unit import controller_unit
from iptm_fmi.fmu_file import write_fmus
from iptm_fmi.plant_unit import plant_unit


def main() -> None:
    """Time a recorded trip."""
    parameters = load_parameters(SET).values
    trip = recorded("us06", SET, slope="small", value_beyond_trip=True)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        write_fmus(versions(folder, "plant"), plant_unit(parameters))
        write_fmus(versions(folder, "controller"), controller_unit(parameters, ControllerOptions()))
        for version in (2, 3):
            spent: dict[str, list[float]] = {}

            def timed(one: Instance, time_s: float) -> None:
                step = _step_of(one, time_s)
                before = time.perf_counter()
                status = step()
                after = time.perf_counter()
                if status != 0:
                    raise AssertionError(f"status {status}")
                spent.setdefault(one.unit.modelIdentifier, []).append(1e6 * (after - before))  # noqa: B023

            begun = time.perf_counter()
            closed(folder, version, trip, timed)
            faster = len(trip.steps) / (time.perf_counter() - begun)
            plant_us, controller_us = (
                np.median(spent[name]) for name in ("iptm_plant", "iptm_controller")
            )
            sizes = [file.stat().st_size / 1024 for file in folder.glob(f"*_{version}.fmu")]
            print(
                f"FMI {version}: plant step {plant_us:.1f} us, controller step {controller_us:.0f} us,"
                f" closed {faster:.0f} times real time, largest file {max(sizes):.0f} kB"
            )
    own, ticks_us = MpcController(trip.trip.controller_parameters, trip.trip.options), []
    for measured in trip.measured:
        before = time.perf_counter()
        own.decide(measured)
        ticks_us.append(1e6 * (time.perf_counter() - before))
    print(f"suite: controller step {np.median(ticks_us):.0f} us")


def _step_of(one: Instance, time_s: float) -> Callable[[], int]:
    """Return a step as the call of its function in C, without FMPy around it."""
    unit, times = one.unit, (ctypes.c_double(time_s), ctypes.c_double(1.0))
    if not one.is_3:
        return partial(unit.dll.fmi2DoStep, unit.component, *times, 1)
    flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
    last = ctypes.byref(ctypes.c_double())
    component = unit.component, *times, ctypes.c_bool(True)
    return partial(unit.dll.fmi3DoStep, *component, *flags, last)


if __name__ == "__main__":
    main()
