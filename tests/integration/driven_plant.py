"""The plant node in the process of the test, driven by a scripted controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tests.integration.node_bench import NodeBench, S, node_bench

from iptm_core.state import Command, VehicleState
from iptm_plant_sim.node import PlantNode
from iptm_ros.codecs import decode_observation, encode_command, ns_from_time, stamp_of
from iptm_ros.services import Service
from iptm_ros.topics import Topic

Script = Callable[[int], Command | None]


def lively(tick: int) -> Command:
    """Start, speed up, brake to a stop, start again."""
    return Command(1.2 * math.sin(tick / 9.0) - 0.1, 1000.0 + 900.0 * math.sin(tick / 5.0))


class DrivenPlant:
    """A plant on a bench, and a controller that answers its clocks by a script."""

    def __init__(self, bench: NodeBench) -> None:
        self.bench = bench
        self._answered = 0

    @property
    def ticks(self) -> list[int]:
        """Stamps of all clocks, ns."""
        return [ns_from_time(message.clock) for message in self.bench.received[Topic.CLOCK]]

    def answer(self, tick: float, command: Command) -> None:
        self.bench.hear({Topic.COMMAND: encode_command(round(tick * S), command)})

    def drive(self, script: Script, until: Callable[[], object] | None = None) -> None:
        """Answer every new clock until a condition holds, by default the end of the process."""

        def is_reached() -> object:
            while self._answered < len(self.ticks):
                stamp_ns = self.ticks[self._answered]
                self._answered += 1
                command = script(stamp_ns // S)
                if command is not None and stamp_ns % S == 0:
                    self.answer(stamp_ns / S, command)
            return self.bench.node.ended.done() if until is None else until()

        self.bench.spin_until(is_reached)

    def state(self, stamp_ns: int) -> VehicleState:
        """The newest state with a stamp, as it arrives at other nodes."""
        return decode_observation(self.message(Topic.PLANT_STATE, stamp_ns)).state

    def message(self, topic: Topic, stamp_ns: int) -> Any:
        """The newest message of a topic with a stamp."""
        return next(
            message
            for message in reversed(self.bench.received[topic])
            if stamp_of(message) == stamp_ns
        )

    def states(self) -> list[VehicleState]:
        return [self.state(stamp_ns) for stamp_ns in self.ticks]


@contextmanager
def driven_plant(**parameters: object) -> Iterator[DrivenPlant]:
    """Start a plant, by default on nycc in hills and without a range sensor, and have it begin."""
    usual = {"cycle": "nycc", "slope": "large", "linger_s": 0.0, "safety_monitor": False}
    with node_bench(PlantNode, **{**usual, "start_paused": True, **parameters}) as bench:
        if "start_paused" not in parameters:
            assert bench.call(Service.RESUME).success
        yield DrivenPlant(bench)
