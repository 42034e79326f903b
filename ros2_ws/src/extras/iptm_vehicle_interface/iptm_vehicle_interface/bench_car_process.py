"""The process of the bench car: its options, and real time on its bus."""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, go_first, refused
from iptm_vehicle_interface.bench_car import BenchCar, BusFaults
from iptm_vehicle_interface.bus import BusReader, log_line, open_bus, send
from iptm_vehicle_interface.vehicle import load_vehicle


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the car on its bus; prints what it saw of the commands as JSON at the end."""
    parser = argparse.ArgumentParser("bench_car", description=__doc__)
    add = parser.add_argument
    add("--vehicle", default="bench", help="name or folder of the vehicle")
    add("--bus", required=True, metavar="BUS", help="bus of the car")
    add("--cycle", default="us06", help="what the lead vehicle drives")
    add("--slope", default="flat", help="slope of the road")
    add("--duration-s", type=float, default=60.0, help="length of the drive")
    add("--seed", type=int, default=0, help="of noise and bus faults")
    add(
        "--press", action="append", default=[], metavar="NAME:AT:FOR[:EVERY]",
        help="pedal or button, time and duration in s, such as enable_button:2:0.2, and after which time "
        "again",
    )  # fmt: skip
    add("--lost", type=float, default=0.0, help="share of frames that are lost")
    add("--late-s", type=float, default=0.0, help="frames are late by up to this")
    add("--frozen-from-s", type=float, default=math.inf, help="radar repeats from here on")
    add("--silent", default="inf:inf", metavar="FROM:TO", help="no frame in this time, in s")
    add("--bad-checksum", type=float, default=0.0, help="share of wrong checksums")
    add("--log", type=Path, metavar="FILE", help="JSON of the result, also on a signal")
    add("--frames", type=Path, metavar="FILE", help="candump log of all frames of the car")
    options = parser.parse_args(arguments)
    try:
        silent_from_s, silent_to_s = map(float, options.silent.split(":"))
        events = [
            (name, float(at), float(for_), float(every[0]) if every else math.inf)
            for name, at, for_, *every in (text.split(":") for text in options.press)
        ]
    except ValueError:
        return refused(
            "bench_car", "--press or --silent is malformed; allowed: NAME:AT:FOR, FROM:TO"
        )
    try:
        silent, frozen_s = (silent_from_s, silent_to_s), options.frozen_from_s
        faults = BusFaults(options.lost, options.late_s, frozen_s, silent, options.bad_checksum)
        vehicle = load_vehicle(options.vehicle)
        car = BenchCar(vehicle, options.cycle, events, options.seed, faults, options.slope)
        bus = open_bus(options.bus)
    except IptmError as error:
        return refused("bench_car", error)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    with ExitStack() as stack:
        log = stack.enter_context(options.frames.open("w")) if options.frames else None
        _drive(car, bus, options.duration_s, ended, log)
    text = json.dumps(vars(car.log))
    if options.log:
        options.log.write_text(text, "utf-8")
    print(text, flush=True)
    return EXIT_OK


def _drive(
    car: BenchCar, bus: Any, duration_s: float, ended: Sequence[int], log: TextIO | None
) -> None:
    """Run in real time; late frames leave when they are due."""
    go_first()
    reader = BusReader(bus)
    waiting: list[tuple[float, int, bytes]] = []
    start_s = car.log.began_s = time.monotonic()
    print(f"bench_car: ready, began at {time.time():.3f} s", flush=True)
    while not ended and car.time_s < duration_s:
        for frame in reader.taken():
            car.receive(frame.frame_id, frame.data)
            if log is not None:
                log.write(log_line(car.time_s, frame.frame_id, frame.data, "R"))
        car.advance()
        waiting += [
            (car.time_s + late_s, frame_id, data) for late_s, frame_id, data in car.frames()
        ]
        for each in [entry for entry in waiting if entry[0] <= car.time_s]:
            send(bus, each[1], each[2])
            if log is not None:
                log.write(log_line(car.time_s, each[1], each[2], "T"))
            waiting.remove(each)
        time.sleep(max(start_s + car.time_s - time.monotonic(), 0.0))
    reader.close()


if __name__ == "__main__":
    sys.exit(main())
