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
_STARTS = 3
_LONGEST_START_S, _WAIT_S = 120.0, 0.05


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

        Raises:
            ScenarioError: SUMO is not installed or does not start.
        """
        traci = _module("traci")
        self.refusal: type[Exception] = traci.exceptions.TraCIException
        self.failure: type[Exception] = traci.exceptions.FatalTraCIError
        command = [str(sumo_program("sumo")), *options, "--remote-port"]
        output = ""
        for _ in range(_STARTS):
            port = _module("sumolib.miscutils").getFreeSocketPort()
            self._process = subprocess.Popen(  # noqa: S603
                [*command, str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            connection = self._connected(traci, port)
            if connection is not None:
                self.connection: Any = connection
                return
            # Another program may have taken the port that was free a moment ago.
            self._process.kill()
            output = " ".join((self._process.communicate()[1] or "").split())
        raise ScenarioError(f"SUMO does not start: {output[:500] or 'no answer'}")

    def _connected(self, traci: ModuleType, port: int) -> Any | None:
        """Return the connection, None if SUMO has ended or does not answer."""
        until = time.monotonic() + _LONGEST_START_S
        while self._process.poll() is None and time.monotonic() < until:
            with suppress(self.refusal, self.failure):
                return traci.connect(port, numRetries=0, proc=self._process)
            # TraCI's own wait between tries is a second; SUMO starts in a tenth of that.
            time.sleep(_WAIT_S)
        return None

    @property
    def processor_s(self) -> float:
        """Processor time that SUMO has used so far, in s."""
        stat = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii")
        user, system = stat.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def step(self) -> None:
        """Let SUMO make a step.

        Raises:
            ScenarioError: it has ended.
        """
        try:
            self.connection.simulationStep()
        except self.failure as reason:
            raise self.ended(reason) from reason

    def ended(self, reason: Exception) -> ScenarioError:
        """Return the error of a simulation that has ended by itself, in its own words."""
        self._process.kill()
        output = " ".join((self._process.communicate()[1] or "").split())
        return ScenarioError(f"SUMO has ended: {output[:500] or reason}")

    def close(self) -> None:
        """End SUMO."""
        with suppress(self.refusal, self.failure, OSError):
            self.connection.close(wait=False)
        try:
            self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._process.wait()
