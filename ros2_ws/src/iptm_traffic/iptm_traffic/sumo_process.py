"""SUMO as a process of its own, spoken to over TraCI; an optional extra (requirements/traffic.txt)."""

from __future__ import annotations

import importlib
import os
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from iptm_core.errors import ScenarioError

NOT_INSTALLED = (
    "SUMO is not installed; needed: python -m pip install --require-hashes -r requirements/traffic.txt "
    "in the entered environment"
)
_TRIES, _WAIT_S = 400, 0.05


def sumo_program(name: str) -> Path:
    """Return one of SUMO's programs.

    Raises:
        ScenarioError: SUMO is not installed.
    """
    return Path(_module("sumo").SUMO_HOME) / "bin" / name


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as reason:
        raise ScenarioError(f"{NOT_INSTALLED} ({reason})") from reason


class SumoProcess:
    """One running simulation.

    Attributes:
        connection: TraCI's connection.
        refusal: what it raises where SUMO refuses a command.
        failure: what it raises where SUMO has ended.
    """

    def __init__(self, options: list[str]) -> None:
        """Start SUMO.

        Args:
            options: command line without program and port.

        Raises:
            ScenarioError: SUMO is not installed or does not start.
        """
        traci = _module("traci")
        self.refusal: type[Exception] = traci.exceptions.TraCIException
        self.failure: type[Exception] = traci.exceptions.FatalTraCIError
        sumolib = _module("sumolib.miscutils")
        port = sumolib.getFreeSocketPort()
        command = [str(sumo_program("sumo")), *options, "--remote-port", str(port)]
        self._process = subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self.connection: Any = self._connect(traci, port)

    def _connect(self, traci: ModuleType, port: int) -> Any:
        refused = (traci.exceptions.TraCIException, traci.exceptions.FatalTraCIError)
        for _ in range(_TRIES):
            with suppress(*refused):
                return traci.connect(port, numRetries=0, proc=self._process)
            if self._process.poll() is not None:
                break
            # TraCI's own wait between tries is a second; SUMO starts in a tenth of that.
            time.sleep(_WAIT_S)
        self._process.kill()
        said = " ".join((self._process.communicate()[1] or "").split())
        raise ScenarioError(f"SUMO does not start: {said[:500] or 'no answer'}")

    @property
    def processor_s(self) -> float:
        """Processor time that SUMO has used so far, in s."""
        stat = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii")
        user, system = stat.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End SUMO."""
        try:
            self.connection.close(wait=False)
        finally:
            try:
                self._process.communicate(timeout=10.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.communicate()
