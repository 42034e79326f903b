"""The plant as a node: the simulated vehicle, master of time for everybody else.

Exit codes beyond those of every node: 3, the controller was lost and the trip ended with the controlled
stop. 1 is also a vehicle model that failed.
"""

from __future__ import annotations

import math
import sys

from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from iptm_core.errors import IptmError, MessageError
from iptm_core.settings import LoopMode
from iptm_core.state import Command
from iptm_interfaces.codecs import decode_command, ns_from_time
from iptm_interfaces.command_line import node_main
from iptm_interfaces.diagnostics import DiagnosticsReporter, Level
from iptm_interfaces.parameters import declare_parameters
from iptm_interfaces.process import EXIT_DEFECT
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import TOPICS, Topic
from iptm_interfaces.watchdog import Watchdog
from iptm_plant_sim.node_parameters import WAIT, PlantNodeParameters
from iptm_plant_sim.node_publishers import PlantPublishers
from iptm_plant_sim.schedule import Schedule, TimeBetweenTicks
from iptm_plant_sim.trip import CommandHold, TripPhase

EXIT_CONTROLLER_LOST = 3

MATCHING_PERIOD_S = 0.02
CHECKS_PER_REPEAT = 5.0
REPORT_PERIOD_S = 1.0
STOP_TICK_WALL_S = 0.1
"""Pace of the controlled stop in lock-step mode: nobody is waited for, but a controller that is back can
answer in time, and listeners can follow."""
REPEAT_S = 2.5
"""Lock-step: a state without an answer is published again after so much wall time, for whoever has been
started meanwhile. More than the controller's wait for missing inputs: not without need."""


class PlantNode(SuiteNode):
    """Publishes the state of every tick and drives on when it has the command that answers it.

    In lock-step mode trip time advances only with commands; in real-time mode it advances with the
    wall clock, and a command is held until it is too old.
    """

    def __init__(self) -> None:
        super().__init__("plant")
        self._options = declare_parameters(self, PlantNodeParameters)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        self._trip = self._options.build_trip()
        self._phase = TripPhase.WAITING
        self._controller_lost = False
        self._controller_losses = 0
        self._failure = ""
        self._repeated_states = 0
        self._ignored_commands = 0
        self._unfitting_commands = 0
        self._rejected_commands = 0
        self._awaited: tuple[str, ...] = ()
        self._hold = CommandHold(self._options.command_timeout_s)
        self._schedule: Schedule | None = None
        self._between = TimeBetweenTicks(self._options.period_s, self._options.rate_factor)
        self._published_s = 0.0
        self._stop_timer: Timer | None = None
        self._outputs = PlantPublishers(self, self._trip.parameters)
        self._reporter = DiagnosticsReporter.of_node(self, "vehicle")
        self._watchdog = Watchdog(self._options.command_timeout_wall_s, self._on_silence)
        self._watchdog.attach(self)
        self.watch_peers(Topic.PLANT_ODOMETRY, Topic.COMMAND)
        self._commands = self.listen(Topic.COMMAND, self._on_command)
        self.every(REPORT_PERIOD_S, self._report)
        self._start_timer = self.every(MATCHING_PERIOD_S, self._start_when_matched)
        self._report()

    @property
    def _is_real_time(self) -> bool:
        return self._options.mode is LoopMode.REAL_TIME

    # --- start

    def _start_when_matched(self) -> None:
        """Publish the first state as soon as it would reach everyone."""
        self._awaited = self._missing_peers()
        if self._awaited:
            self._report()
            return
        self._start_timer.cancel()
        self._phase = TripPhase.RUNNING
        self._publish()
        if not self._is_real_time:
            self.every(REPEAT_S / CHECKS_PER_REPEAT, self._repeat_if_unanswered)
        else:
            wall_period_s = self._options.period_s / self._options.rate_factor
            self._schedule = Schedule(wall_period_s)
            self._tick_timer = self.every(wall_period_s, self._on_wall_tick)
            if self._options.clock_hz > 0.0:
                self.every(1.0 / self._options.clock_hz, self._publish_time_between)

    def _missing_peers(self) -> tuple[str, ...]:
        expected = self._options.expected_peers
        missing = self._outputs.missing_subscribers(expected)
        needs_controller = expected > 0 or not self._is_real_time
        if needs_controller and self._commands.get_publisher_count() == 0:
            missing = (*missing, self._commands.topic_name)
        return missing

    # --- commands

    def _on_command(self, message: JointState) -> None:
        stamp_ns, command = self._read(message)
        if self._phase is TripPhase.WAITING or self._phase is TripPhase.FINISHED:
            return
        answers_now = stamp_ns == self._trip.stamp_ns
        usable = self._is_real_time or answers_now
        if not (usable and self._hold.offer(stamp_ns, command, self._trip.stamp_ns)):
            self._ignored_commands += 1
            self._unfitting_commands += 1
            if stamp_ns < self._trip.stamp_ns:
                self.health.note_contradiction(TOPICS[Topic.COMMAND].publisher)
            self._report()
            return
        self._unfitting_commands = 0
        if not self._is_real_time:
            self._resume()
            self._advance(command)

    def _resume(self) -> None:
        """Lock-step: give the vehicle back to a controller that answers while it is being stopped."""
        if self._phase is not TripPhase.STOPPING:
            return
        if self._stop_timer is not None:
            self._stop_timer.cancel()
        self._controller_lost = False
        self._phase = TripPhase.RUNNING

    def _read(self, message: JointState) -> tuple[int, Command]:
        """Return stamp and decision; one that cannot be read counts as one without numbers.

        The plant answers such a command with the controlled stop for this tick, so a controller that
        sends nonsense once neither hangs the lock-step nor ends the trip.
        """
        try:
            return decode_command(message)
        except MessageError:
            self._rejected_commands += 1
            return ns_from_time(message.header.stamp), Command(math.nan, math.nan)

    # --- time

    def _advance(self, command: Command) -> None:
        try:
            self._trip.advance(command)
        except IptmError as error:
            self._fail(error)
            return
        self._publish()

    def _publish(self) -> None:
        """Publish the present state and expect an answer to it, or end with it."""
        over = self._trip.is_over
        if over:
            self._finish()
        self._outputs.publish(self._trip.step)
        self._published_s = self.awake.now_s()
        if not over:
            self._between.begin(self._trip.stamp_ns)
        if not over and not self._is_real_time:
            self._watchdog.feed()
        self._report()

    def _repeat_if_unanswered(self) -> None:
        """Lock-step: publish the state once more for peers that were not there when it was published."""
        if self._phase is not TripPhase.RUNNING:
            return
        if self.awake.now_s() - self._published_s >= REPEAT_S:
            self._repeated_states += 1
            self._outputs.publish(self._trip.step)
            self._published_s = self.awake.now_s()

    def _publish_time_between(self) -> None:
        time_ns = self._between.take_ns()
        if time_ns is not None:
            self._outputs.publish_time(time_ns)

    def _on_wall_tick(self) -> None:
        if self._phase is TripPhase.FINISHED or self._schedule is None:
            return
        self._schedule.keep()
        now_ns = self._trip.stamp_ns
        was_lost, self._controller_lost = self._controller_lost, self._hold.is_lost(now_ns)
        self._controller_losses += self._controller_lost and not was_lost
        self._phase = TripPhase.STOPPING if self._controller_lost else TripPhase.RUNNING
        self._advance(self._hold.command_at(now_ns) or self._trip.stop_command())

    def _on_silence(self, _: float) -> None:
        """Lock-step: the controller does not answer."""
        if self._options.on_lost_controller == WAIT:
            self._report()
            return
        self._controller_lost = True
        self._controller_losses += 1
        self._phase = TripPhase.STOPPING
        self._watchdog.disarm()
        self._report()
        self._stop_timer = self.every(STOP_TICK_WALL_S, self._on_stop_tick)

    def _on_stop_tick(self) -> None:
        """Lock-step: one interval of the controlled stop.

        A controller that answers the present state before the vehicle stands goes on with the trip. At
        standstill the trip ends: nothing is gained by waiting longer than the timeout did already.
        """
        if self._phase is not TripPhase.STOPPING:
            return
        if self._trip.step.standstill:
            self._finish()
            self._report()
            return
        self._advance(self._trip.stop_command())

    # --- end

    def _finish(self) -> None:
        """End the process a little later, so that the last messages arrive."""
        self._phase = TripPhase.FINISHED
        self._between.end()
        self._watchdog.disarm()
        code = EXIT_CONTROLLER_LOST if self._controller_lost else 0
        self.every(max(self._options.linger_s, 1e-3), lambda: self.finish(code))

    def _fail(self, error: IptmError) -> None:
        """End the trip: the vehicle model has no next state."""
        self._failure = str(error)
        self.get_logger().error(f"the vehicle model failed: {error}")
        self._phase = TripPhase.FINISHED
        self._between.end()
        self._watchdog.disarm()
        self._report()
        self.every(max(self._options.linger_s, 1e-3), lambda: self.finish(EXIT_DEFECT))

    # --- diagnostics

    def _report(self) -> None:
        trip = self._trip
        level, reason = self._situation()
        values: dict[str, object] = {
            "phase": self._phase.value,
            "mode": self._options.mode.value,
            "tick": trip.tick,
            "ticks": trip.ticks,
            "standstill": trip.step.standstill,
            "command_age_s": self._hold.age_s(trip.stamp_ns),
            "ignored_commands": self._ignored_commands,
            "rejected_commands": self._rejected_commands,
            "repeated_states": self._repeated_states,
            "controller_losses": self._controller_losses,
            "failure": self._failure or "none",
            "limited_ticks": trip.limited_ticks,
            **{f"limited_{kind.value}": count for kind, count in trip.clamps.items()},
            "last_limit": trip.last_reason,
        }
        if self._schedule is not None:
            values["overruns"] = self._schedule.overruns
            values["worst_lateness_s"] = self._schedule.worst_lateness_s
        self._reporter.report(trip.stamp_ns, level, reason, values)

    def _situation(self) -> tuple[Level, str]:
        if self._phase is TripPhase.WAITING:
            names = ", ".join(self._awaited)
            return Level.WARN, f"waiting for peers on {names}" if names else "waiting for peers"
        if self._phase is TripPhase.FINISHED:
            if self._failure:
                return Level.ERROR, "the vehicle model failed"
            if self._controller_lost:
                return Level.ERROR, "finished without a controller"
            return Level.OK, "finished"
        lost = "no commands arrive"
        if self._unfitting_commands:
            lost = "commands arrive, but their stamps answer no state that waits for one"
        if self._phase is TripPhase.STOPPING:
            return Level.ERROR, f"{lost}: controlled stop"
        if self._watchdog.is_silent:
            return Level.STALE, f"{lost}: waiting"
        if self._trip.is_limited:
            return Level.WARN, "commands exceed what the vehicle can do and are limited"
        return Level.OK, "running"


def main() -> None:
    """Run the node."""
    sys.exit(node_main("plant", PlantNode, PlantNodeParameters))


if __name__ == "__main__":
    main()
