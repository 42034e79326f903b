"""An instance of a foreign FMU of co-simulation, of version 2 or 3, behind one interface with time limits."""

from __future__ import annotations

import queue
import shutil
import threading
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from iptm_core.errors import ScenarioError, StateError

TIMEOUT_S = 30.0
"""Longest time that a call may take."""
_FATAL = 4
T = TypeVar("T")


class ForeignUnit:
    """An instance; all calls are made in one thread of its own, as an FMU may hang.

    Attributes:
        units: unit of every variable of real values by name, empty where it states none.
        keeps_states: whether states can be saved and taken up again.
        step_s: the only step that it takes; None where it takes any.
    """

    def __init__(self, path: Path) -> None:
        """Load an FMU.

        Raises:
            ScenarioError: it cannot be loaded here; the message states why.
        """
        try:
            fmpy = import_module("fmpy")
        except ModuleNotFoundError as error:
            raise ScenarioError(f"{error}; FMUs need FMPy: install requirements/fmi.txt") from error
        self._path, self._is_lost, self._has_started = path, False, False
        try:
            self._described = fmpy.read_model_description(str(path))
        except Exception as error:  # FMPy raises whatever its parser does
            raise ScenarioError(f"{path} cannot be read as an FMU: {_line(error)}") from error
        described = self._described
        if described.coSimulation is None:
            raise ScenarioError(f"{path} is for model exchange only; allowed: co-simulation")
        self._is_3 = described.fmiVersion.startswith("3")
        real = [
            v
            for v in described.modelVariables
            if v.type in {"Real", "Float64"} and not v.dimensions
        ]
        self._places = {v.name: v.valueReference for v in real}
        self.units = {v.name: v.unit or getattr(v.declaredType, "unit", None) or "" for v in real}
        can = described.coSimulation
        self.keeps_states = bool(can.canGetAndSetFMUstate)
        step_s = described.defaultExperiment.stepSize if described.defaultExperiment else None
        takes_any = can.canHandleVariableCommunicationStepSize
        self.step_s = None if takes_any else float(step_s or 1.0)
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], queue.SimpleQueue[Any]] | None] = (
            queue.SimpleQueue()
        )
        threading.Thread(target=self._serve, daemon=True).start()
        self._folder = fmpy.extract(str(path))
        try:
            self._unit = self._called(self._made)
        except StateError as error:
            inside = _platforms(path)
            raise ScenarioError(
                f"{path} cannot be loaded: {error}; binaries inside: {', '.join(inside) or 'none'}"
            ) from error

    def start(self, time_s: float) -> None:
        """Begin a simulation, from the start values of the FMU."""
        self._called(lambda: self._started(time_s))

    def put(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        places, given = [self._places[name] for name in values], list(values.values())
        setter = self._unit.setFloat64 if self._is_3 else self._unit.setReal
        self._called(lambda: setter(places, given))

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables by name."""
        places = [self._places[name] for name in names]
        getter = self._unit.getFloat64 if self._is_3 else self._unit.getReal
        return list(self._called(lambda: getter(places)))

    def step(self, time_s: float, length_s: float) -> None:
        """Do a step."""
        self._called(lambda: self._unit.doStep(time_s, length_s))

    def state(self) -> Any:
        """Return the state, to be given back to `restore`, and to `forget` in the end."""
        get = self._unit.getFMUState if self._is_3 else self._unit.getFMUstate
        return self._called(get)

    def restore(self, state: Any) -> None:
        """Take up a state again."""
        put = self._unit.setFMUState if self._is_3 else self._unit.setFMUstate
        self._called(lambda: put(state))

    def forget(self, state: Any) -> None:
        """Free a state."""
        free = self._unit.freeFMUState if self._is_3 else self._unit.freeFMUstate
        self._called(lambda: free(state))

    def close(self) -> None:
        """Free the instance and remove what was unpacked."""
        if not self._is_lost:
            with suppress(StateError):
                self._called(self._unit.freeInstance)
        self._calls.put(None)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _made(self) -> Any:
        described = self._described
        module = import_module("fmpy.fmi3" if self._is_3 else "fmpy.fmi2")
        kind = module.FMU3Slave if self._is_3 else module.FMU2Slave
        unit = kind(
            guid=described.instantiationToken if self._is_3 else described.guid,
            unzipDirectory=self._folder,
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        unit.instantiate()
        return unit

    def _started(self, time_s: float) -> None:
        if self._has_started:
            self._unit.reset()
        self._has_started = True
        if self._is_3:
            self._unit.enterInitializationMode(startTime=time_s)
        else:
            self._unit.setupExperiment(startTime=time_s)
            self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()

    def _called(self, function: Callable[[], T]) -> T:
        answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._calls.put((function, answers))
        try:
            answer, error = answers.get(timeout=TIMEOUT_S)
        except queue.Empty:
            self._is_lost = True
            raise StateError(f"{self._path.name} has not answered within {TIMEOUT_S:g} s") from None
        if error is not None:
            # After this status nothing may be called any more (FMI 2.0.5, 2.1.3).
            self._is_lost = self._is_lost or getattr(error, "status", None) == _FATAL
            raise StateError(f"{self._path.name}: {_line(error)}") from error
        result: T = answer
        return result

    def _serve(self) -> None:
        while (job := self._calls.get()) is not None:
            function, answers = job
            try:
                answers.put((function(), None))
            except Exception as error:  # noqa: BLE001  whatever it is, the caller gets it
                answers.put((None, error))


def _line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def _platforms(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as archive:
        names = [Path(name).parts for name in archive.namelist()]
    return sorted({parts[1] for parts in names if len(parts) > 2 and parts[0] == "binaries"})
