"""Drives the bench car in real time: car, gateway and suite as three processes on two buses of this machine.

Prints who drove when, and what the car saw of the commands. Of the car the suite has nothing but its DBC.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from iptm_core.errors import ScenarioError
from iptm_core.program import EXIT_OK, EXIT_REFUSED, refused

ENABLE_AT_S = 4.0
START_S = 60.0
END_S = 10.0
GATEWAY, SUITE, CAR = "gateway", "driving", "bench_car"


def free_ports(number: int) -> int:
    """Return the first of two UDP ports that no DDS domain uses, another one for most numbers.

    DDS takes the first ones of every 250 from 7400 on (RTPS 2.5, 9.6.2.3).
    """
    domain, pair = number % 150, number // 150 % 40
    return 7400 + 250 * (50 + domain) + 160 + 2 * pair


@dataclass(frozen=True)
class BenchResult:
    """What the car and the suite saw; see `CarLog` and `DriveLog`. Empty for a process that was killed."""

    car: dict[str, Any]
    suite: dict[str, Any]


class BenchProcesses:
    """The three processes; entering starts them, leaving ends what is left of them."""

    def __init__(
        self, folder: Path, *, vehicle: str, cycle: str, duration_s: float, car: Sequence[str] = ()
    ) -> None:
        port = free_ports(os.getpid())
        buses = f"udp:{port}", f"udp:{port + 1}"
        self.car_bus = buses[0]
        self.folder, self._vehicle = folder, vehicle
        self._arguments: dict[str, list[str]] = {
            GATEWAY: ["--car", buses[0], "--suite", buses[1]],
            SUITE: ["--bus", buses[1], "--log", str(folder / "suite.json")],
            CAR: ["--bus", buses[0], "--cycle", cycle, "--duration-s", f"{duration_s}",
                  "--log", str(folder / "car.json"), *car],
        }  # fmt: skip
        self.running: dict[str, subprocess.Popen[str]] = {}

    def __enter__(self) -> BenchProcesses:  # noqa: PYI034 - Self needs Python 3.11
        for name in (GATEWAY, SUITE, CAR):
            self.start(name)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self.running.values():
            _wait_or_kill(process)

    def start(self, name: str) -> None:
        """Start a process and wait until it is ready.

        Raises:
            ScenarioError: it ended instead, or is not ready in time.
        """
        output = self.folder / f"{name}.log"
        command = [
            sys.executable,
            "-m",
            f"iptm_vehicle_interface.{name}",
            "--vehicle",
            self._vehicle,
        ]
        with output.open("w", encoding="utf-8") as stream:
            self.running[name] = subprocess.Popen(  # noqa: S603 - own program
                [*command, *self._arguments[name]], stdout=stream, stderr=stream, text=True
            )
        until_s = time.monotonic() + START_S
        while ": ready" not in (text := output.read_text("utf-8")):
            if self.running[name].poll() is not None or time.monotonic() > until_s:
                raise ScenarioError(f"{name} did not start: {text.strip() or 'no output'}")
            time.sleep(0.05)

    def result(self) -> BenchResult:
        """Wait for the car, end the suite, and return what both saw."""
        self.running[CAR].wait()
        for name in (SUITE, GATEWAY):
            if self.running[name].poll() is None:
                self.running[name].terminate()
                self.running[name].wait(END_S)
        found = [self.folder / name for name in ("car.json", "suite.json")]
        return BenchResult(
            *(json.loads(path.read_text("utf-8")) if path.exists() else {} for path in found)
        )


def _wait_or_kill(process: subprocess.Popen[str]) -> None:
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive the bench car; returns 0 when no command was too old and no collision happened."""
    parser = argparse.ArgumentParser("bench", description=__doc__)
    parser.add_argument("--vehicle", default="bench", help="name or folder of the vehicle")
    parser.add_argument("--cycle", default="us06", help="what the lead vehicle drives")
    parser.add_argument(
        "--duration-s", type=float, default=60.0, help="length of the drive, wall time"
    )
    parser.add_argument(
        "car", nargs="*", metavar="CAR_OPTION",
        help="after --: options of bench_car, such as --press brake_pressed:30:1 or --lost 0.1",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    car = ["--press", f"enable_button:{ENABLE_AT_S}:0.3", *options.car]
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        try:
            with (
                BenchProcesses(
                    Path(folder),
                    vehicle=options.vehicle,
                    cycle=options.cycle,
                    duration_s=options.duration_s,
                    car=car,
                ) as processes,
                console.status(f"driving {options.cycle} for {options.duration_s:g} s"),
            ):
                result = processes.result()
        except ScenarioError as error:
            return refused("bench", error)
    console.print(table_of(result))
    is_sound = bool(result.car) and result.car["smallest_gap_m"] > 0.0
    return EXIT_OK if is_sound else EXIT_REFUSED


def table_of(result: BenchResult) -> Table:
    """Return the figures of a drive as a table."""
    car, suite = result.car, result.suite
    table = Table("figure", "value", title="bench car")
    rows = {
        "driven by the suite": f"{car['active_s']:.1f} s, {car['engagements']} engagements",
        "distance": f"{car['distance_m']:.0f} m",
        "smallest gap": f"{car['smallest_gap_m']:.2f} m",
        "largest jerk while active": f"{car['largest_jerk_m_s3']:.2f} m/s³ (over 0.1 s)",
        "oldest command seen by the car": f"{1e3 * car['oldest_command_s']:.0f} ms",
        "frames that the car rejected": f"{car['rejected_frames']}",
        "energy from the battery": f"{car['battery_energy_j'] / 3.6e6:.3f} kWh",
        "decisions": f"{suite.get('decisions', 0)}, {suite.get('fallbacks', 0)} by a fallback",
        "inner loop late, p99 / largest": " / ".join(
            f"{1e3 * suite.get(name, 0.0):.1f} ms" for name in ("late_p99_s", "late_max_s")
        ),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    for time_s, mode, reason in suite.get("changes", []):
        table.add_row(f"at {time_s:.1f} s", f"{mode}: {reason}")
    for fault, count in suite.get("faults", {}).items():
        table.add_row("frames not counted", f"{count} {fault}")
    return table


if __name__ == "__main__":
    sys.exit(main())
