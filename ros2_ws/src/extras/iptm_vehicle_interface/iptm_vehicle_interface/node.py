"""A car as a node: takes the place of the plant on its topics, and follows the plans on its bus.

Stamps use the system clock, and ticks begin at multiples of the period. In `shadow` nothing
is sent.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2

from iptm_core.decision_record import DrivingMode
from iptm_core.declaration import parameter
from iptm_core.errors import ParameterError
from iptm_core.lead_track import RangeTrack
from iptm_core.program import go_first
from iptm_core.settings import FrameSettings, SamplingSettings
from iptm_core.state import Command, FloatArray, PlantObservation
from iptm_ros.codecs import (
    decode_command,
    decode_plan,
    encode_battery,
    encode_observation,
    encode_tracks,
    ns_from_s,
    s_from_ns,
    time_from_s,
)
from iptm_ros.codecs.numbers import LAYOUTS
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.node_health import CHECK_PERIOD_S, HeartbeatWatch
from iptm_ros.parameters import declare_parameters
from iptm_ros.services import Service
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import VEHICLE, Topic
from iptm_vehicle_interface import bus_key
from iptm_vehicle_interface.authority import BENCH_BUTTON_ID
from iptm_vehicle_interface.bus import BusReader, send
from iptm_vehicle_interface.drive_record import DriveRecorder, whole_microseconds
from iptm_vehicle_interface.driving import LOOP_S, Driver
from iptm_vehicle_interface.vehicle import load_vehicle
from iptm_vehicle_interface.vehicle_state import LEADER


@dataclass(frozen=True)
class VehicleNodeParameters(FrameSettings, SamplingSettings):
    """Parameters of the node: its groups, the last of the bases first, then its own."""

    vehicle: str = parameter("bench", "name of a shipped vehicle, or a folder with vehicle.yaml")
    bus: str = parameter(
        "udp:43113",
        "bus of the gateway as python-can names it, such as socketcan:can0; separated by commas, one per "
        "database of the vehicle",
    )
    bus_key: str = parameter(
        "", "file with the key of these buses, where they leave the machine; empty for none"
    )
    bench: bool = parameter(
        default=False,
        description="offer the service bench_enable as the button; a gateway obeys it with --bench only",
    )
    shadow: bool = parameter(
        default=False, description="send nothing: decide beside a driver, and record it"
    )
    awaited_nodes: str = parameter(
        "controller, v2x_bridge",
        "names of the nodes whose end or halt makes the car inactive within 100 ms, separated by commas; "
        "empty for none",
    )
    record: str = parameter(
        "", "folder to create for raw frames, steps and decisions, to be replayed; empty for none"
    )
    capacity_loss_file: str = parameter(
        "",
        "file with the capacity losses of the cells, read at the start and written while driving; empty "
        "starts from the parameter set",
    )
    log: str = parameter("", "file for the figures of the drive as JSON; empty for none")


PUBLISHED = (
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_BATTERY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_STATE,
)
"""Topics of one state; the clock follows, which the bridge answers."""
SLEWED_S = 1e-4
"""By how much the clock of the loop follows the system's in a step; a jump of the latter is spread."""
SAVED_EVERY_S = 10.0
_LEVELS = {
    DrivingMode.OFF: Level.WARN,
    DrivingMode.READY: Level.OK,
    DrivingMode.ENGAGED: Level.OK,
    DrivingMode.OVERRIDDEN: Level.OK,
    DrivingMode.HAND_OVER: Level.ERROR,
}
_FLAGS = ("brake_pressed", "accelerator_pressed", "enable_button", "cancel_button", "vehicle_fault")


class _SystemClock:
    """Time of the system that never jumps: the monotonic clock, led towards it."""

    def __init__(self) -> None:
        self._offset_s = time.time() - time.monotonic()

    @property
    def behind_s(self) -> float:
        """How far the clock of the system is ahead of this one."""
        return time.time() - time.monotonic() - self._offset_s

    def follow(self) -> None:
        """Move a little towards the clock of the system."""
        self._offset_s += min(max(self.behind_s, -SLEWED_S), SLEWED_S)

    def now_s(self) -> float:
        """Return the time in whole microseconds."""
        return whole_microseconds(time.monotonic() + self._offset_s)


class VehicleNode(SuiteNode):
    """Publishes what the car measures, and sends what follows the controller's plans.

    Subscribes to `controller/command` and `controller/plan`; the service ~/cancel acts as the button of the
    car. There is one for the enable button on the bench only.
    """

    def __init__(self) -> None:
        super().__init__(VEHICLE)
        self._options = declare_parameters(self, VehicleNodeParameters)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        self._vehicle = load_vehicle(self._options.vehicle)
        self._losses_file = Path(self._options.capacity_loss_file)
        self._driver = Driver(self._vehicle, self._saved_losses())
        self._time = _SystemClock()
        self._record = DriveRecorder(Path(self._options.record)) if self._options.record else None
        key_file = self._options.bus_key
        key = bus_key.read_key(Path(key_file)) if key_file else None
        addresses = [each.strip() for each in self._options.bus.split(",")]
        self._buses = bus_key.open_keyed(addresses, self._vehicle.has_fd, key, bus_key.SUITE)
        self._readers = [
            BusReader(bus, self._time.now_s, number=number)
            for number, bus in enumerate(self._buses)
        ]
        radar = self._vehicle.signals.get("gap_m")
        self._radar = radar.message if radar else ""
        self._outputs = {topic: self.advertise(topic) for topic in (*PUBLISHED, Topic.CLOCK)}
        self._tracks = self.advertise(Topic.RANGE_TRACKS) if self._radar else None
        self._engagement = self.advertise(Topic.ENGAGEMENT)
        self._reporter = DiagnosticsReporter.of_node(self, "vehicle")
        self._plans: dict[int, tuple[FloatArray, ...]] = {}
        self._commands: dict[int, Command] = {}
        self._tick_ns = 0
        self._period_ns = ns_from_s(self._options.period_s)
        self._saved_s = -math.inf
        self._reported: tuple[float, ...] = ()
        self._stepped_s = time.monotonic()
        names = filter(None, map(str.strip, self._options.awaited_nodes.split(",")))
        self._watch = HeartbeatWatch(self, names)
        self._silent: tuple[str, ...] = ()
        self.every(CHECK_PERIOD_S, self._check_alive)
        self.listen(Topic.PLAN, self._on_plan)
        self.listen(Topic.COMMAND, self._on_command)
        self.watch_peers(Topic.PLANT_STATE, Topic.COMMAND)
        if self._options.bench:
            self.serve(Service.BENCH_ENABLE, self._press_on_bench)
        self.serve(Service.CANCEL, lambda: self._press("cancel_button"))
        self.every(LOOP_S, self._step)
        self.every(REPORT_PERIOD_S, self._report)
        if "control_active" not in self._vehicle.signals:
            self.get_logger().warning(
                f"{self._vehicle.name} has no signal control_active: the suite does not notice that the "
                "car has become inactive"
            )
        self.get_logger().info(f"{self._vehicle.name}: ready")

    # --- decisions

    def _on_plan(self, message: PointCloud2) -> None:
        stamp_ns, plan = decode_plan(message)
        self._plans = {stamp_ns: (plan.times_s, plan.speeds_m_s, plan.accelerations_m_s2)}
        self._decide(stamp_ns)

    def _on_command(self, message: JointState) -> None:
        stamp_ns, command = decode_command(message)
        self._commands = {stamp_ns: command}
        self._decide(stamp_ns)

    def _decide(self, stamp_ns: int) -> None:
        """Follow a decision once its plan and its command are there."""
        plan, command = self._plans.get(stamp_ns), self._commands.get(stamp_ns)
        if plan is None or command is None:
            return
        tick_s = s_from_ns(stamp_ns)
        if self._driver.follow(tick_s, plan, command) and self._record:
            self._record.decided(tick_s, plan, command)

    def _press(self, button: str) -> str:
        now_s = self._time.now_s()
        self._driver.press(button, now_s)
        if self._record:
            self._record.pressed(button, now_s)
        return f"pressed, {self._driver.engagement.mode.value} before"

    def _press_on_bench(self) -> str:
        send(self._buses[0], BENCH_BUTTON_ID, b"")
        return self._press("enable_button")

    # --- the loop

    def _check_alive(self) -> None:
        """Let go at once, not with the next step, when a process of the suite has stopped."""
        silent = self._watch.silent()
        if silent == self._silent:
            return
        self._silent = silent
        self._driver.note_silent(silent)
        if self._record:
            self._record.silenced(silent, self._time.now_s())
        if silent:
            self._step()

    def _step(self) -> None:
        before_s, self._stepped_s = self._stepped_s, time.monotonic()
        self._driver.log.late.add(max(self._stepped_s - before_s - LOOP_S, 0.0))
        now_s = self._time.now_s()
        for frame in (frame for reader in self._readers for frame in reader.taken()):
            if self._record:
                self._record.received(frame)
            message = self._driver.receive(frame)
            if self._tracks is not None and message == self._radar:
                seen, stamp_ns = self._seen(frame.time_s), ns_from_s(frame.time_s)
                self._tracks.publish(encode_tracks(seen, stamp_ns, self.frame_prefix))
        tick_ns = ns_from_s(now_s) // self._period_ns * self._period_ns
        if tick_ns > self._tick_ns:
            self._tick_ns = tick_ns
            self._tick(s_from_ns(tick_ns), now_s)
        mode = self._driver.engagement.mode
        sent = self._driver.step(now_s)
        if not self._options.shadow:
            for frame_id, data in sent:
                number, is_fd = self._vehicle.route(frame_id)
                send(self._buses[number], frame_id, data, is_fd=is_fd)
        if self._record:
            self._record.stepped(now_s, sent)
        if self._driver.engagement.mode is not mode:
            self._report()
        self._publish_engagement(now_s)

    def _seen(self, now_s: float) -> tuple[RangeTrack, ...]:
        signals = self._driver.signals
        if signals.stale(LEADER, now_s) or not signals.is_set("target_valid", now_s):
            return ()
        gap_m, relative, _ = (signals.value(name, now_s) for name in LEADER)
        return (RangeTrack(gap_m, 0.0, relative),)

    def _tick(self, tick_s: float, now_s: float) -> None:
        self._time.follow()
        if self._record:
            self._record.ticked(tick_s, now_s)
        observed = self._driver.measured(tick_s, now_s)
        if observed is not None:
            self._publish(observed)
        if self._options.capacity_loss_file and now_s - self._saved_s >= SAVED_EVERY_S:
            self._saved_s = now_s
            self._save_losses()

    def _publish(self, observed: PlantObservation) -> None:
        found: dict[Topic, Any] = dict(encode_observation(observed, self.frame_prefix))
        battery = self._driver.estimator.battery(self._driver.signals, observed)
        found[Topic.PLANT_BATTERY] = encode_battery(battery)
        for topic in PUBLISHED:
            self._outputs[topic].publish(found[topic])
        self._outputs[Topic.CLOCK].publish(Clock(clock=time_from_s(observed.state.time_s)))

    def _publish_engagement(self, now_s: float) -> None:
        """Publish who drives when it has changed, else with every tick."""
        driver, signals = self._driver, self._driver.signals
        flags = (signals.value(name, now_s) for name in _FLAGS)
        values = (driver.engagement.mode.number, *flags)
        shown = (*(-1.0 if math.isnan(value) else value for value in values), float(self._tick_ns))
        if shown != self._reported:
            self._reported = shown
            numbers = (*values, driver.requested_m_s2)
            self._engagement.publish(
                LAYOUTS[Topic.ENGAGEMENT].data(ns_from_s(now_s), numbers, self.frame_prefix)
            )

    # --- reports

    def _report(self) -> None:
        engagement = self._driver.engagement
        level = Level.OK if self._options.shadow else _LEVELS[engagement.mode]
        self._reporter.report(self._tick_ns, level, engagement.reason, self._values)

    def _values(self) -> dict[str, object]:
        driver = self._driver
        return {
            "vehicle": self._vehicle.name,
            "mode": driver.engagement.mode.value,
            "shadow": self._options.shadow,
            "decisions": driver.log.decisions,
            "decisions_without_plan": driver.log.fallbacks,
            "requested_acceleration_m_s2": driver.requested_m_s2,
            "cell_1_capacity_loss": driver.estimator.capacity_losses[0],
            "cell_n_capacity_loss": driver.estimator.capacity_losses[1],
            "late_max_s": driver.log.late.take_recent_s(),
            "clock_behind_s": self._time.behind_s,
            "unreadable_frames": sum(reader.unreadable for reader in self._readers),
            "cooling": self._vehicle.cooling,
            **{f"rejected {name}": count for name, count in driver.log.faults.items()},
        }

    def _saved_losses(self) -> tuple[float, float] | None:
        if not (self._options.capacity_loss_file and self._losses_file.is_file()):
            return None
        try:
            first, last = map(float, json.loads(self._losses_file.read_text("utf-8")))
        except (ValueError, TypeError):
            raise ParameterError(
                f"{self._losses_file} holds no capacity losses; allowed: two numbers as JSON"
            ) from None
        return first, last

    def _save_losses(self) -> None:
        # Replaced in one step: a power cut leaves the old file or the new one.
        scratch = self._losses_file.with_suffix(".new")
        scratch.write_text(json.dumps(self._driver.estimator.capacity_losses), "utf-8")
        scratch.replace(self._losses_file)

    def destroy_node(self) -> None:
        """Give the bus back, and complete the files."""
        for reader in self._readers:
            reader.close()
        if self._record:
            self._record.close()
        if self._options.capacity_loss_file:
            self._save_losses()
        if self._options.log:
            Path(self._options.log).write_text(json.dumps(self._driver.log.summary()), "utf-8")
        super().destroy_node()


def main() -> None:
    """Run the node."""
    go_first()  # before the middleware starts its threads
    sys.exit(node_main(VEHICLE, VehicleNode, VehicleNodeParameters))


if __name__ == "__main__":
    main()
