"""Drives the bench car in real time: car and gateway on two buses of this machine, the nodes over ROS 2.

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
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.program import EXIT_OK, EXIT_REFUSED, refused
from iptm_core.units import J_PER_KWH
from iptm_ros.discovery import reserve_domain, without_shared_memory
from iptm_vehicle_interface.bus import is_unused
from iptm_vehicle_interface.driving import controller_limits
from iptm_vehicle_interface.vehicle import load_vehicle

ENABLE = ("--press", "enable_button:4:0.3:10")
"""The driver enables the suite, and again after every hand-over."""
START_S = 660.0
"""For the slowest process: a first controller compiles."""
END_S = 10.0
V2X_HEADWAY_S = 3.5
"""Plans with a preview come nearer than the gateway permits with the braking of the channel, else."""
GATEWAY, VEHICLE, BRIDGE, CONTROLLER = "gateway", "vehicle_interface", "v2x_bridge", "controller"
RECORDER, CAR, SENDER = "recorder", "bench_car", "v2x_sender"
SUITE = (VEHICLE, BRIDGE, CONTROLLER)
_MODULES = {
    GATEWAY: ("iptm_vehicle_interface.gateway", ": ready"),
    VEHICLE: ("iptm_vehicle_interface.node", ": ready"),
    BRIDGE: ("iptm_v2x_bridge.node", "waiting for"),
    CONTROLLER: ("iptm_controller.node", "waiting for"),
    RECORDER: ("iptm_ros.recording.recorder_cli", ""),
    CAR: ("iptm_vehicle_interface.bench_car_process", ": ready"),
    SENDER: ("iptm_its.node_sender", ""),
}
"""Module of each process, and what it prints once it is ready."""


def free_ports(number: int) -> int:
    """Return the first of three unused UDP ports outside the ranges of DDS, a different one for most numbers.

    DDS takes the first ones of every 250 from 7400 on (RTPS 2.5, 9.6.2.3).

    Raises:
        ScenarioError: all ports are in use.
    """
    for attempt in range(number, number + 4500):
        domain, place = attempt % 150, attempt // 150 % 30
        first = 7400 + 250 * (50 + domain) + 160 + 3 * place
        if all(is_unused(port) for port in range(first, first + 3)):
            return first
    raise ScenarioError("no UDP ports are free for the bench; allowed: three in a row above 19900")


@dataclass(frozen=True)
class BenchResult:
    """What the car and the suite saw; see `CarLog` and `DriveLog`. Empty for a process that was killed."""

    car: dict[str, Any]
    suite: dict[str, Any]


@dataclass(frozen=True)
class BenchOptions:
    """A drive on the bench.

    Attributes:
        vehicle: name or folder of the vehicle.
        cycle: what the lead vehicle drives.
        slope: of the road, which the bridge knows ahead.
        v2x: the lead vehicle sends its position and path; the bridge joins them with the radar.
        duration_s: length of the drive, wall time.
        car: further options of the car.
        controller: parameters of the controller node.
        bridge: parameters of the bridge node.
        node: parameters of the vehicle's node.
        bag: folder for a bag; empty for none.
    """

    vehicle: str = "bench"
    cycle: str = "us06"
    slope: str = "flat"
    v2x: bool = False
    duration_s: float = 60.0
    car: Sequence[str] = ()
    controller: Mapping[str, Any] = field(default_factory=dict)
    bridge: Mapping[str, Any] = field(default_factory=dict)
    node: Mapping[str, Any] = field(default_factory=dict)
    bag: str = ""


class BenchProcesses:
    """The processes, in a ROS domain of their own; entering starts them, leaving ends those that are left."""

    def __init__(self, folder: Path, options: BenchOptions) -> None:
        port = free_ports(os.getpid())
        buses = f"udp:{port}", f"udp:{port + 1}"
        self.car_bus = buses[0]
        self.folder, self._stack = folder, ExitStack()
        self._environment = {**os.environ, **without_shared_memory(folder)}
        vehicle = load_vehicle(options.vehicle)
        planned = controller_limits(vehicle)
        if options.v2x:
            planned["gap.time_headway_s"] = V2X_HEADWAY_S
        limits = ", ".join(f"{key}={value}" for key, value in planned.items())
        own, road = ["--vehicle", options.vehicle], {"cycle": options.cycle, "slope": options.slope}
        by_now: dict[str, Any] = {"trip_start_timestamp_ms": -1}
        self._sender = {**road, **by_now, "to_port": port + 2, "follow_clock": False}
        heard = {
            **by_now,
            "leader_source": "range_sensor_and_cam",
            "cam_port": port + 2,
            "cam_lock_step": False,
        }
        nodes: dict[str, dict[str, Any]] = {
            VEHICLE: {"vehicle": options.vehicle, "bus": buses[1], "log": str(folder / "suite.json"),
                      **options.node},
            BRIDGE: {"leader_source": "range_sensor", **road, **(heard if options.v2x else {}),
                     **options.bridge},
            CONTROLLER: {"parameter_set": vehicle.parameter_set, "overrides": limits,
                         **options.controller},
        }  # fmt: skip
        self._arguments: dict[str, list[str]] = {
            GATEWAY: [*own, "--car", buses[0], "--suite", buses[1]],
            **{name: self._parameters(name, values) for name, values in nodes.items()},
            **({RECORDER: [options.bag]} if options.bag else {}),
            CAR: [*own, "--bus", buses[0], "--cycle", options.cycle, "--duration-s",
                  f"{options.duration_s}", "--slope", options.slope, "--log",
                  str(folder / "car.json"), *options.car],
            **({SENDER: []} if options.v2x else {}),
        }  # fmt: skip
        self.running: dict[str, subprocess.Popen[str]] = {}

    def _parameters(self, node: str, values: Mapping[str, Any]) -> list[str]:
        path = self.folder / f"{node}.yaml"
        # JSON is YAML; texts stay texts.
        path.write_text(json.dumps({f"/**/{node}": {"ros__parameters": dict(values)}}), "utf-8")
        return ["--ros-args", "--params-file", str(path)]

    def __enter__(self) -> BenchProcesses:  # noqa: PYI034 - Self needs Python 3.11
        domain = self._stack.enter_context(reserve_domain())
        self._environment |= {"ROS_DOMAIN_ID": f"{domain}", "PYTHONUNBUFFERED": "1"}
        try:
            for name in self._arguments:
                if name == CAR:
                    for each in (GATEWAY, *SUITE):
                        self.wait_until_ready(each)
                if name == SENDER:
                    began_s = float(self.wait_until_ready(CAR).split()[-2])
                    sent = {**self._sender, "drive_began_s": began_s}
                    self._arguments[SENDER] = self._parameters(SENDER, sent)
                self.start(name)
            self.wait_until_ready(CAR)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self.running.values():
            _wait_or_kill(process)
        self._stack.close()

    def start(self, name: str) -> None:
        """Start a process, for the first time or again."""
        with (self.folder / f"{name}.log").open("w", encoding="utf-8") as stream:
            self.running[name] = subprocess.Popen(  # noqa: S603 - own program
                [sys.executable, "-m", _MODULES[name][0], *self._arguments[name]],
                stdout=stream, stderr=stream, text=True, env=self._environment,
            )  # fmt: skip

    def wait_until_ready(self, name: str) -> str:
        """Wait until a process is ready; return what it printed.

        Raises:
            ScenarioError: it ended instead, or is not ready in time.
        """
        output, until_s = self.folder / f"{name}.log", time.monotonic() + START_S
        while _MODULES[name][1] not in (text := output.read_text("utf-8")):
            if self.running[name].poll() is not None or time.monotonic() > until_s:
                raise ScenarioError(f"{name} did not start: {text.strip() or 'no output'}")
            time.sleep(0.05)
        return text

    def result(self) -> BenchResult:
        """Wait for the car, end the suite, and return what both saw."""
        self.running[CAR].wait()
        for name, process in reversed(self.running.items()):
            if name != CAR and process.poll() is None:
                process.terminate()
                _wait_or_kill(process)
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


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser("iptm bench", description=__doc__)
    parser.add_argument("--vehicle", default="bench", help="name or folder of the vehicle")
    parser.add_argument("--cycle", default="us06", help="what the lead vehicle drives")
    parser.add_argument("--slope", default="flat", help="slope of the road, known ahead")
    parser.add_argument(
        "--v2x", action="store_true", help="the lead vehicle sends its position and path"
    )
    parser.add_argument(
        "--duration-s", type=float, default=60.0, help="length of the drive, wall time"
    )
    parser.add_argument("--strategy", default="aging_cost_to_go", help="strategy of the controller")
    parser.add_argument("--output", default="", metavar="DIR", help="bag to record")
    parser.add_argument(
        "--record", default="", metavar="DIR", help="record raw frames, steps and decisions"
    )
    parser.add_argument(
        "car", nargs="*", metavar="CAR_OPTION",
        help="after --: options of bench_car, such as --press brake_pressed:30:1 or --lost 0.1",
    )  # fmt: skip
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive the bench car; returns 0 when the suite drove it and no collision happened."""
    given = build_parser().parse_args(arguments)
    options = BenchOptions(
        given.vehicle,
        given.cycle,
        given.slope,
        given.v2x,
        given.duration_s,
        [*ENABLE, *given.car],
        controller={"strategy": given.strategy},
        node={"record": given.record} if given.record else {},
        bag=given.output,
    )
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        try:
            with (
                console.status(f"driving {options.cycle} for {options.duration_s:g} s"),
                BenchProcesses(Path(folder), options) as processes,
            ):
                result = processes.result()
        except IptmError as error:
            return refused("iptm bench", error)
    if not result.car:
        return refused("iptm bench", ScenarioError("the car ended early; allowed: see its options"))
    console.print(table_of(result))
    is_sound = result.car["smallest_gap_m"] > 0.0 and result.car["active_s"] > 0.0
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
        "energy from the battery": f"{car['battery_energy_j'] / J_PER_KWH:.3f} kWh",
        "decisions": f"{suite.get('decisions', 0)}, {suite.get('fallbacks', 0)} by a fallback",
        "inner loop late, p99 / largest": " / ".join(
            f"{1e3 * suite.get(name, 0.0):.1f} ms" for name in ("late_p99_s", "late_max_s")
        ),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    if suite.get("changes_left_out"):
        table.add_row("earlier changes left out", f"{suite['changes_left_out']}")
    for time_s, mode, reason in suite.get("changes", []):
        table.add_row(f"at {time_s:.1f} s", f"{mode}: {reason}")
    for fault, count in suite.get("faults", {}).items():
        table.add_row("frames not counted", f"{count} {fault}")
    return table


if __name__ == "__main__":
    sys.exit(main())
