"""Real-time drives on the bench car: whole cycles, killed and stopped processes, and faults of the bus."""

from __future__ import annotations

import json
import math
import random
import re
import shutil
import signal
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from iptm_core.errors import MessageError
from iptm_vehicle_interface.bench_car import STEP_S, TIMEOUT_S
from iptm_vehicle_interface.bus import BusReader, open_bus
from iptm_vehicle_interface.drive_record import read_frames
from iptm_vehicle_interface.frames import FrameCodec
from iptm_vehicle_interface.node_bench import (
    BRIDGE,
    CAR,
    CONTROLLER,
    ENABLE,
    GATEWAY,
    RECORDER,
    VEHICLE,
    BenchOptions,
    BenchProcesses,
    BenchResult,
)
from iptm_vehicle_interface.vehicle import VEHICLES, load_vehicle

VICTIMS = (VEHICLE, GATEWAY, CONTROLLER, BRIDGE, RECORDER)
HOWS = (signal.SIGKILL, signal.SIGSTOP)
SETTLED_S = 1.0
LONGEST_WAIT_S = 60.0
REPORTED_WITHIN_S = 2.0
STOPPED_S = 6.0
"""For how long a process stands: longer than a decision is followed."""
SETTLING_S = 2.0
WINDOW_STEPS = 10
_REPORT = re.compile("no sign of life|no fresh|does not act|gateway: inactive")
OFTEN = ("--press", "enable_button:4:0.3:2")
FRAMES = "car_frames.log"
Json = dict[str, Any]


def kept(path: Path, make: Callable[[], Any]) -> Any:
    """Return what a file holds, which is made first where it is not there: drives in real time are long."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(make()), "utf-8")
    return json.loads(path.read_text("utf-8"))


def drive(
    folder: Path,
    cycle: str,
    strategy: str,
    duration_s: float,
    *,
    v2x: bool = False,
    shadow: bool = False,
) -> Json:
    """Drive a cycle with recorder and raw frames; return what car and suite saw.

    Args:
        v2x: the lead vehicle sends its position and path.
        shadow: the driver drives, beside the suite.
    """
    folder.mkdir(parents=True, exist_ok=True)
    options = BenchOptions(
        cycle=cycle,
        v2x=v2x,
        duration_s=duration_s,
        car=[*(() if shadow else ENABLE), "--frames", str(folder / FRAMES)],
        controller={"strategy": strategy},
        node={"record": str(folder / "record"), "shadow": shadow},
        bag=str(folder / "bag"),
    )
    return _driven(folder, options)


def faulty(folder: Path, car: Sequence[str], duration_s: float, vehicle: str = "bench") -> Json:
    """Drive the beginning of US06 with a fault of the bus."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = ["--frames", str(folder / FRAMES)]
    options = BenchOptions(
        cycle="us06", vehicle=vehicle, duration_s=duration_s, car=[*car, *frames]
    )
    return _driven(folder, options)


def other_dbc(folder: Path) -> Path:
    """Return a vehicle whose messages have other identifiers than those of the bench car."""
    shutil.copytree(VEHICLES / "bench", folder, dirs_exist_ok=True)
    path = folder / "bench.dbc"
    text = path.read_text("utf-8")
    path.write_text(re.sub(r"BO_ (\d+)", lambda found: f"BO_ {int(found[1]) + 1}", text), "utf-8")
    return folder


def _driven(folder: Path, options: BenchOptions) -> Json:
    with BenchProcesses(folder, options) as bench:
        result: BenchResult = bench.result()
    return vars(result)


@dataclass
class _Listener:
    """Whether the newest command on the car's bus is enabled, and since when."""

    def __init__(self, address: str) -> None:
        self._vehicle = load_vehicle("bench")
        self._codec = FrameCodec(self._vehicle)
        self._reader = BusReader(open_bus(address))
        self._enabled, self._since_s, self._heard_s = False, time.monotonic(), -math.inf

    def enabled_s(self) -> float:
        """Return for how long the car has been driven by the suite, 0 while it is not."""
        for frame in self._reader.taken():
            try:
                command = self._codec.command(frame.frame_id, frame.data)
            except MessageError:  # the first counter of a gateway that was started again
                continue
            if command is None or command[0] is not self._vehicle.acceleration:
                continue
            if command[2] is not self._enabled or frame.time_s - self._heard_s > 0.5:
                self._enabled, self._since_s = command[2], frame.time_s
            self._heard_s = frame.time_s
        now_s = time.monotonic()
        is_heard = now_s - self._heard_s < 0.1
        return now_s - self._since_s if self._enabled and is_heard else 0.0

    def close(self) -> None:
        self._reader.close()


def kills(
    folder: Path, number: int, cycle: str, seed: int, longest_s: float = math.inf
) -> list[Json]:
    """Kill or stop each process at random instants while engaged.

    Returns:
        An entry per event: process, signal, time to inactive by the car's clock, whether another process
        reported it, whether the car drove on (which it shall without a recorder), and of the whole drive
        the number of engagements and the smallest gap.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bag = folder / "bag"
    options = BenchOptions(cycle=cycle, duration_s=1e5, car=OFTEN, bag=str(bag))
    draws = random.Random(seed)  # noqa: S311 - no secret
    plan = [(name, how) for name in VICTIMS for how in HOWS]
    plan *= math.ceil(number / len(plan))
    draws.shuffle(plan)
    events: list[Json] = []
    with BenchProcesses(folder, options) as bench:
        listener = _Listener(bench.car_bus)
        try:
            until_s = time.monotonic() + longest_s
            for name, how in plan[:number]:
                if time.monotonic() > until_s:
                    break
                engaged = _wait(lambda: listener.enabled_s() > SETTLED_S)
                time.sleep(draws.uniform(0.0, 1.0))
                if not (engaged and listener.enabled_s()):
                    events.append({"process": name, "signal": how.name, "at_s": math.nan})
                    continue
                log = folder / f"{GATEWAY if name == VEHICLE else VEHICLE}.log"
                before, at_s = len(log.read_text("utf-8")), time.monotonic()
                bench.running[name].send_signal(how)
                may_end_s = REPORTED_WITHIN_S if name == RECORDER else LONGEST_WAIT_S
                drove_on = not _wait(lambda: listener.enabled_s() == 0.0, may_end_s)
                reported = not drove_on and _wait(
                    partial(_has_report, log, before), REPORTED_WITHIN_S
                )
                if how is signal.SIGSTOP:
                    time.sleep(max(at_s + STOPPED_S - time.monotonic(), 0.0))
                    bench.running[name].send_signal(signal.SIGCONT)
                else:
                    bench.running[name].wait()
                    if name == RECORDER and bag.exists():  # into which it does not write again
                        bag.rename(folder / f"bag_{len(events)}")
                    bench.start(name)
                found = {"at_s": at_s, "reported": reported, "drove_on": drove_on}
                events.append({"process": name, "signal": how.name, **found})
            _wait(lambda: listener.enabled_s() > SETTLED_S)
        finally:
            listener.close()
        bench.running[CAR].terminate()
        car = bench.result().car
    inactive = [car["began_s"] + at_s for at_s in car["inactive_at_s"]]
    for event in events:
        later = [
            at_s for at_s in inactive if at_s >= event["at_s"] - 0.02 and not event.get("drove_on")
        ]
        event["inactive_after_s"] = min(later, default=math.nan) - event["at_s"]
        event["smallest_gap_m"] = car["smallest_gap_m"]
    engagements = car["engagements"]
    return [{**event, "engagements": engagements} for event in events]


def _has_report(log: Path, before: int) -> bool:
    return _REPORT.search(log.read_text("utf-8")[before:]) is not None


def _wait(condition: Callable[[], bool], longest_s: float = LONGEST_WAIT_S) -> bool:
    until_s = time.monotonic() + longest_s
    while time.monotonic() < until_s:
        if condition():
            return True
        time.sleep(0.02)
    return False


def settled_jerk_m_s3(log: Path) -> float:
    """Return the largest jerk over 0.1 s of a car's log, from 2 s after an engagement to its end."""
    vehicle = load_vehicle("bench")
    of_car, of_suite = FrameCodec(vehicle), FrameCodec(vehicle)
    since_s, heard_s, largest = math.inf, -math.inf, 0.0
    window: deque[float] = deque(maxlen=WINDOW_STEPS + 1)
    for frame, received in read_frames(log):
        if received:
            command = of_suite.command(frame.frame_id, frame.data)
            if command is not None and command[0] is vehicle.acceleration:
                is_new = since_s == math.inf or frame.time_s - heard_s > TIMEOUT_S
                since_s = (frame.time_s if is_new else since_s) if command[2] else math.inf
                heard_s = frame.time_s
            continue
        values = of_car.decode(frame.frame_id, frame.data).values
        if "acceleration_m_s2" not in values:
            continue
        window.append(values["acceleration_m_s2"])
        is_settled = frame.time_s - since_s > SETTLING_S and frame.time_s - heard_s <= TIMEOUT_S
        if not is_settled:
            window.clear()
        elif len(window) == WINDOW_STEPS + 1:
            largest = max(largest, abs(window[-1] - window[0]) / (WINDOW_STEPS * STEP_S))
    return largest
