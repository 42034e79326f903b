"""The trip as the plant node drives it: by commands or by the wall clock, from the first state to the end."""

from __future__ import annotations

import math
from typing import Any

from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from iptm_core.errors import IptmError, MessageError, PackEmptyError
from iptm_core.extras import offered
from iptm_core.settings import LoopMode, LostController
from iptm_core.state import Command, CommandSource
from iptm_plant_sim.interval import battery_reading
from iptm_plant_sim.node_neighbours import Neighbours, NodeRangeSensor, PlayedRangeSensor
from iptm_plant_sim.node_parameters import WAIT, PlantNodeParameters
from iptm_plant_sim.trip import CommandHold, Slots, TimeBetweenTicks, TripPhase
from iptm_ros.codecs import (
    REPEATED,
    battery_bytes,
    decode_command,
    encode_clock,
    encode_observation,
    ns_from_s,
    stamp_of,
)
from iptm_ros.node_health import Watchdog
from iptm_ros.parameters import declare_parameters
from iptm_ros.process import EXIT_DEFECT
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import TOPICS, Topic

EXIT_CONTROLLER_LOST = 3
EXIT_PACK_EMPTY = 4

START_PERIOD_S = 0.02
CHECKS_PER_REPEAT = 5.0
STOP_TICK_WALL_S = 0.1
"""Wall time per tick of the controlled stop in lock-step: a restarted controller can take over."""
REPORTED_S = 1.0
"""Lock-step: wall time after which a state without an answer is reported."""
REPEAT_S = 2.5
"""Lock-step: wall time after which an unanswered state is sent again, for nodes that came late; longer than
the controller's wait for missing inputs."""
KEEP_ALIVE_S = 1.0
"""Wall time between repeats of the state of a paused trip, shorter than every node's input timeout."""
PUBLISHED = (
    Topic.PLANT_CELL_1_TEMPERATURE,
    Topic.PLANT_CELL_N_TEMPERATURE,
    Topic.PLANT_COOLANT_INLET_TEMPERATURE,
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE,
    Topic.PLANT_BATTERY,
    Topic.PLANT_ACCELERATION,
    Topic.PLANT_ODOMETRY,
    Topic.PLANT_STATE,
)
"""Topics of one state in the order that the other nodes rely on; the clock follows."""
_FOR_OTHERS = tuple(topic for topic in PUBLISHED if topic in REPEATED)


class TripNode(SuiteNode):
    """Advances the trip tick by tick, publishes every state, and holds the trip where it is to pause."""

    PARAMETERS = PlantNodeParameters

    def __init__(self, **options: Any) -> None:
        super().__init__("plant", **options)
        self._options = declare_parameters(self, self.PARAMETERS)
        self.reject_unknown_parameters()
        self.use_frame_prefix(self._options.frame_prefix)
        self._trip = self._options.build_trip()
        self._phase = TripPhase.WAITING
        self._is_start_due = self._pause_due = self._is_tick_due = False
        self._offered_to: tuple[int, ...] = ()
        self._steps_due = self._controller_losses = 0
        self._controller_lost = False
        self._failure = ""
        self._repeated_states = self._rejected_commands = 0
        self._ignored_commands = self._unfitting_commands = 0
        self._awaited: tuple[str, ...] = ()
        self._hold = CommandHold(self._options.command_timeout_s)
        self._schedule: Slots | None = None
        self._between = TimeBetweenTicks(self._options.period_s, self._options.rate_factor)
        self._published_s = 0.0
        self._stop_timer: Timer | None = None
        self._end_timer: Timer | None = None
        self._tick_timer: Timer | None = None
        self._played_sensor = PlayedRangeSensor(self, self._options)
        self._outputs = {topic: self.advertise(topic) for topic in (*PUBLISHED, Topic.CLOCK)}
        added = (extra.publisher(self, self._trip.plant) for extra in offered("plant_topics"))
        self._added = [publish for publish in added if publish is not None]
        self._watchdog = Watchdog(self._options.command_timeout_wall_s, self._on_silence)
        self._watchdog.attach(self)
        reported_s = min(REPORTED_S, self._options.command_timeout_wall_s)
        self._answers = Watchdog(reported_s, lambda _: self._report()).attach(self)
        self.watch_peers(Topic.PLANT_STATE, Topic.COMMAND)
        self._held: tuple[int, Command] | None = None
        go_on = self._drive_if_due if self._is_real_time else self._release
        self._neighbours = Neighbours(self, self._options, go_on)
        self._range_sensor = NodeRangeSensor(self, self._options, self._release)
        self._trip.watch(self._range_sensor.measure)
        self._commands = self.listen(Topic.COMMAND, self._on_command)
        self._start_timer = self.every(START_PERIOD_S, self._look_for_start)

    def _report(self) -> None:
        """Report the state of the trip; called whenever it may have changed."""
        raise NotImplementedError

    @property
    def _is_real_time(self) -> bool:
        return self._options.mode is LoopMode.REAL_TIME

    @property
    def _is_paced(self) -> bool:
        return self._options.pace > 0.0 and not self._is_real_time

    def _on_paced_tick(self) -> None:
        """Lock-step at a pace: the answer to a tick is taken when its time has come."""
        self._is_tick_due = True
        self._release()

    def _look_for_start(self) -> None:
        """Begin when that was asked for; else offer the first state to controllers, one of which begins.

        Subscribers that came since then have missed it, so it is offered again.
        """
        self._awaited = self._neighbours.missing(self._trip.stamp_ns)
        offered = (self._outputs[Topic.PLANT_STATE], self._outputs[Topic.CLOCK])
        listeners = tuple(publisher.get_subscription_count() for publisher in offered)
        if self._awaited:
            pass
        elif self._is_start_due:
            self._start()
            return
        elif self._options.start_paused:
            self._awaited = ("plant/resume",)
        elif not self._commands.get_publisher_count():
            self._awaited = (self._commands.topic_name,)
        elif listeners != self._offered_to or self.awake.now_s() - self._published_s >= REPEAT_S:
            self._offered_to = listeners
            self._publish_state()
        self._report()

    def _start(self, *, is_answered: bool = False) -> None:
        """Begin the first trip; its first state need not be published where it has been answered."""
        self._start_timer.cancel()
        if self._is_paced:
            self.every(self._options.period_s / self._options.pace, self._on_paced_tick)
        if self._is_real_time:
            wall_period_s = self._options.period_s / self._options.rate_factor
            self._schedule = Slots(wall_period_s)
            self._tick_timer = self.every(wall_period_s, self._on_wall_tick)
            if self._options.clock_hz > 0.0:
                self.every(1.0 / self._options.clock_hz, self._publish_time_between)
        self.every(KEEP_ALIVE_S / CHECKS_PER_REPEAT, self._repeat_if_unanswered)
        if not is_answered:
            self._begin()
        elif self._pause_due:
            self._hold_trip()
        else:
            self._phase = TripPhase.RUNNING
            self._let_time_run()

    def _begin(self) -> None:
        """Begin the trip with its first state."""
        self._range_sensor.begin_trip()
        self._phase = TripPhase.RUNNING
        self._publish()
        if self._phase is TripPhase.RUNNING:
            self._let_time_run()

    def _let_time_run(self) -> None:
        """Real time: the next tick lies one period ahead of now."""
        self._is_tick_due = False
        if self._tick_timer is not None and self._schedule is not None:
            self._schedule.begin_again()
            self._tick_timer.reset()
            self._between.begin(self._trip.stamp_ns)

    # --- commands

    def _on_command(self, message: JointState) -> None:
        self._held = self._read(message)
        self._release()

    def _release(self) -> None:
        """Take the newest command as soon as neighbours and range sensor allow it."""
        if self._held is None:
            return
        # In real time the wall clock drives, with the newest command.
        if not (self._is_real_time or self._neighbours.allow_answer_to(self._held[0])):
            return
        answers_now = self._held[0] == self._trip.stamp_ns
        if self._is_paced and self._phase is TripPhase.RUNNING and not self._is_tick_due:
            return
        if not answers_now or self._range_sensor.allows_answer_to(self._held[0]):
            held, self._held = self._held, None
            self._is_tick_due = self._is_real_time and self._is_tick_due
            self._take(*held, answers_now=answers_now)

    def _take(self, stamp_ns: int, command: Command, *, answers_now: bool) -> None:
        if self._phase is TripPhase.WAITING and self._offered_to and answers_now:
            self._start(is_answered=True)
        is_paused = self._phase is TripPhase.PAUSED
        is_repeated = is_paused and self._hold.answers(stamp_ns)
        if is_repeated or self._phase in {TripPhase.WAITING, TripPhase.FINISHED}:
            return
        usable = self._is_real_time or answers_now
        if not (usable and self._hold.offer(stamp_ns, command, self._trip.stamp_ns)):
            self._ignored_commands += 1
            self._unfitting_commands += 1
            if stamp_ns < self._trip.stamp_ns:
                self.health.note_contradiction(TOPICS[Topic.COMMAND].publisher)
            self._report()
            return
        self._unfitting_commands = 0
        if self._is_real_time or (is_paused and not self._steps_due):
            return
        if self._phase is TripPhase.STOPPING:  # a controller answers in time
            self._cancel(self._stop_timer)
            self._controller_lost = False
            self._phase = TripPhase.RUNNING
        self._steps_due -= is_paused
        self._advance(command)

    def _read(self, message: JointState) -> tuple[int, Command]:
        """Return stamp and decision; an unreadable one is treated as NaN.

        The plant answers such a command with the controlled stop for this tick, so a controller that
        sends one malformed command neither hangs the lock-step nor ends the trip.
        """
        try:
            return decode_command(message)
        except MessageError:
            self._rejected_commands += 1
            return stamp_of(message), Command(math.nan, math.nan)

    # --- time

    def _advance(
        self, command: Command | None, source: CommandSource = CommandSource.ANSWER
    ) -> None:
        try:
            self._trip.plant.hear(self._range_sensor.heard(self._trip.stamp_ns))
            self._trip.advance(command, source)
        except PackEmptyError as error:
            self._failure = str(error)
            self.get_logger().warning(f"the trip ends early: {error}")
            self._end(EXIT_PACK_EMPTY)
            self._report()
            return
        except IptmError as error:
            self._fail(error)
            return
        self._publish()

    def _publish(self) -> None:
        """Publish the present state and expect an answer to it, or end with it."""
        over = self._trip.is_over
        if over:
            self._finish()
        elif self._pause_due:
            self._hold_trip()
        if not self._is_real_time:
            self._outputs[Topic.CLOCK].let_listeners_follow(self._outputs.values())
        self._publish_state()
        if not over and self._phase is not TripPhase.PAUSED:
            self._between.begin(self._trip.stamp_ns)
            if not self._is_real_time:
                self._expect_answer()
        self._report()

    def _expect_answer(self, *, is_expected: bool = True) -> None:
        """Begin to wait for an answer in lock-step, or wait no longer."""
        for watchdog in (self._watchdog, self._answers):
            watchdog.feed() if is_expected else watchdog.disarm()

    def _publish_state(self) -> None:
        step = self._trip.step
        # The state is for the nodes; the others, for other tools, take more time than the drive itself.
        heard = [topic for topic in _FOR_OTHERS if self._outputs[topic].is_heard]
        found = encode_observation(step, self.frame_prefix, heard)
        if self._outputs[Topic.PLANT_BATTERY].is_heard:
            battery = battery_reading(step, self._trip.parameters)
            found[Topic.PLANT_BATTERY] = battery_bytes(battery, self.frame_prefix)
        for topic in PUBLISHED:
            if topic in found:
                self._outputs[topic].publish(found[topic])
        for publish in self._added:
            publish(step)
        self._played_sensor.publish(step.state, self._trip.stamp_ns)
        self._outputs[Topic.CLOCK].publish(encode_clock(ns_from_s(step.state.time_s)))
        self._published_s = self.awake.now_s()

    def _repeat_if_unanswered(self) -> None:
        """Publish the state again: for peers that were not there, or as a sign of life of a paused trip."""
        paused = self._phase is TripPhase.PAUSED
        unanswered = self._phase is TripPhase.RUNNING and not self._is_real_time
        waits = self._is_paced and self._held is not None
        if waits or not (paused or unanswered):
            return
        if self.awake.now_s() - self._published_s >= (KEEP_ALIVE_S if paused else REPEAT_S):
            self._repeated_states += 1
            self._publish_state()

    def _publish_time_between(self) -> None:
        time_ns = self._between.take_ns()
        if time_ns is not None:
            self._outputs[Topic.CLOCK].publish(encode_clock(time_ns))

    def _on_wall_tick(self) -> None:
        if self._schedule is not None:
            self._schedule.keep()
            self._schedule.overruns += self._is_tick_due
            self._is_tick_due = True
            self._drive_if_due()

    def _drive_if_due(self) -> None:
        """Real time: drive the interval of a tick as soon as the neighbours allow it."""
        is_held = self._phase in {TripPhase.PAUSED, TripPhase.FINISHED}
        if is_held or not self._is_tick_due:
            return
        if not self._neighbours.allow_answer_to(self._trip.stamp_ns):
            return
        self._is_tick_due = False
        self._judge_command_age()
        self._phase = TripPhase.STOPPING if self._controller_lost else TripPhase.RUNNING
        self._advance(*self._hold.command_at(self._trip.stamp_ns))

    def _judge_command_age(self) -> None:
        was_lost = self._controller_lost
        self._controller_lost = self._hold.is_lost(self._trip.stamp_ns)
        self._controller_losses += self._controller_lost and not was_lost

    def _on_silence(self, _: float) -> None:
        """Lock-step: the controller does not answer."""
        if self._held is not None:
            self._watchdog.feed()
            return
        if self._options.on_lost_controller is LostController.WAIT:
            self._report()
            return
        self._controller_lost = True
        self._controller_losses += 1
        self._phase = TripPhase.STOPPING
        self._expect_answer(is_expected=False)
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
        self._advance(None)

    # --- pause and end

    def _hold_trip(self) -> None:
        self._pause_due = False
        self._steps_due = 0
        self._phase = TripPhase.PAUSED
        self._between.end()
        self._expect_answer(is_expected=False)
        self._cancel(self._stop_timer)
        self._cancel(self._tick_timer)

    def _finish(self) -> None:
        self._end(EXIT_CONTROLLER_LOST if self._controller_lost else 0)

    def _end(self, code: int) -> None:
        """End the process a little later, so that the last messages arrive, or wait for another trip."""
        self._phase = TripPhase.FINISHED
        self._between.end()
        self._expect_answer(is_expected=False)
        self._cancel(self._tick_timer)
        self.exit_code = code
        if self._options.at_end != WAIT:
            linger_s = max(self._options.linger_s, 1e-3)
            self._end_timer = self.every(linger_s, lambda: self.finish(code))

    def _fail(self, error: IptmError) -> None:
        """End the trip: the vehicle model has no next state."""
        self.get_logger().error(f"the vehicle model failed: {error}")
        self._failure = str(error)
        self._end(EXIT_DEFECT)
        self._report()

    @staticmethod
    def _cancel(timer: Timer | None) -> None:
        if timer is not None:
            timer.cancel()
