"""A master of FMUs in a few lines on FMPy, independent of the suite."""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typing_extensions import Self

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
SLAVES = {
    2: import_module("fmpy.fmi2").FMU2Slave,
    3: import_module("fmpy.fmi3").FMU3Slave,
}


@lru_cache
def unpacked(path: Path) -> tuple[Any, str]:
    """Return the description of an FMU and a folder with its files, which is removed at the end."""
    folder = fmpy.extract(str(path))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return fmpy.read_model_description(str(path)), folder


class Instance:
    """An instance of an FMU for co-simulation of either version; use it as a context manager."""

    def __init__(
        self,
        path: Path,
        starts: Mapping[str, Any] | None = None,
        start_s: float = 0.0,
        token: str | None = None,
        *,
        begins: bool = True,
    ) -> None:
        """Make an instance; `begins`: initialize it, too."""
        described, folder = unpacked(path)
        self.is_3 = described.fmiVersion.startswith("3")
        self.places: dict[str, list[int]] = {}
        for variable in described.modelVariables:
            name = variable.name.partition("[")[0]
            size = int(variable.dimensions[0].start) if self.is_3 and variable.dimensions else 1
            self.places.setdefault(name, []).append(variable.valueReference)
            if size > 1:
                self.places[name] += [variable.valueReference + 1] * (size - 1)
        kind = SLAVES[3 if self.is_3 else 2]
        self.unit = kind(
            guid=token or (described.instantiationToken if self.is_3 else described.guid),
            unzipDirectory=folder,
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.unit.instantiate()
        if begins:
            self.begin(starts, start_s)

    def begin(self, starts: Mapping[str, Any] | None = None, start_s: float = 0.0) -> None:
        """Initialize it."""
        if self.is_3:
            self.put(**(starts or {}))
            self.unit.enterInitializationMode(startTime=start_s)
        else:
            self.unit.setupExperiment(startTime=start_s)
            self.put(**(starts or {}))
            self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def put(self, **values: Any) -> None:
        """Set variables; an array may be shorter than its room in FMI 2 and is filled up in FMI 3."""
        for name, value in values.items():
            places, given = self.places[name], np.atleast_1d(value).astype(float).tolist()
            if self.is_3:
                given += [given[-1] if given else 0.0] * (len(places) - len(given))
                self.unit.setFloat64(places[:1], given)
            else:
                self.unit.setReal(places[: len(given)], given)

    def get(self, *names: str) -> list[float]:
        """Return variables that are no arrays."""
        places = [self.places[name][0] for name in names]
        return list(self.unit.getFloat64(places) if self.is_3 else self.unit.getReal(places))

    def step(self, time_s: float, length_s: float = 1.0) -> None:
        """Do a step."""
        self.unit.doStep(time_s, length_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.unit.terminate()
        self.unit.freeInstance()
