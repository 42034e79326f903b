"""Health of a node: incidents in it, silence around it, and its own signs of life.

Incidents are exceptions in callbacks, refused messages and duplicate peers. Counters run for the lifetime of
the node; the status reports recent incidents only. Silence is noticed on the steady clock: trip time stands
still exactly when something hangs.

Nodes that drive a car send signs of life from a thread each, which a long computation does not silence. A
process that dies or stops is noticed within `SILENT_S` and a period of the watch. One that lives and does
not decide is noticed by its decisions.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from iptm_core.errors import ParameterError
from iptm_core.program import REAL_TIME_PRIORITY, go_first
from iptm_ros.topics import Topic, topic_of

if TYPE_CHECKING:
    from iptm_ros.suite_node import SuiteNode


RECENT_S = 3.0
"""Steady time for which a status reports an incident."""
LINGERING_S = 25.0
"""Steady time after which a second publisher is a duplicate; Fast DDS drops a killed process after 20 s."""
_LOOK_PERIOD_S = 0.5
_CHECKS_PER_TIMEOUT = 5.0


@dataclass
class _Incidents:
    count: int = 0
    last_s: float = -math.inf
    what: str = "none"

    def note(self, what: str, now_s: float) -> None:
        self.count += 1
        self.last_s, self.what = now_s, what


class NodeHealth:
    """Incidents of one node.

    Attributes:
        defects: unexpected exceptions.
        refusals: messages that were too large or could not be read.
    """

    def __init__(self, steady_time_s: Callable[[], float] = time.monotonic) -> None:
        self._steady_time_s = steady_time_s
        self.defects = _Incidents()
        self.refusals = _Incidents()
        self._doubled_since_s: dict[str, float] = {}
        self._contradicted_s: dict[str, float] = {}

    def note_defect(self, what: str) -> None:
        """Count an unexpected exception."""
        self.defects.note(what, self._steady_time_s())

    def note_refusal(self, what: str) -> None:
        """Count a refused message."""
        self.refusals.note(what, self._steady_time_s())

    def note_publishers(self, who: str, count: int) -> None:
        """Record the number of publishers of a topic that only one node should publish."""
        if count < 2:
            self._doubled_since_s.pop(who, None)
        else:
            self._doubled_since_s.setdefault(who, self._steady_time_s())

    def note_contradiction(self, who: str) -> None:
        """Record a message that a single node would not send: a repeated or late answer."""
        self._contradicted_s[who] = self._steady_time_s()

    @property
    def doubled(self) -> tuple[str, ...]:
        """Nodes that are there more than once.

        A killed process stays in the graph for a while, so either both must speak, or the second one must
        stay for longer than that.
        """
        now_s = self._steady_time_s()
        return tuple(
            who
            for who, since_s in self._doubled_since_s.items()
            if now_s - since_s > LINGERING_S
            or self._contradicted_s.get(who, -math.inf) > max(since_s, now_s - RECENT_S)
        )

    @property
    def error(self) -> str:
        """Reason for an error status without numbers, empty if there is none."""
        if self._is_recent(self.defects):
            return "an internal error was caught, see the log"
        doubled = self.doubled
        return f"more than one {' and '.join(doubled)} on this graph" if doubled else ""

    @property
    def warning(self) -> str:
        """Reason for a warning without numbers, empty if there is none."""
        return "messages were refused" if self._is_recent(self.refusals) else ""

    @property
    def values(self) -> dict[str, object]:
        """Key values for the diagnostics."""
        return {
            "caught_errors": self.defects.count,
            "last_caught_error": self.defects.what,
            "refused_messages": self.refusals.count,
            "last_refused_message": self.refusals.what,
        }

    def _is_recent(self, incidents: _Incidents) -> bool:
        return self._steady_time_s() - incidents.last_s < RECENT_S


class AwakeClock:
    """Steady time without the stretches in which the process did not run.

    A process that was frozen, or busy in one callback, has not looked at its messages meanwhile: the
    silence of others must not be judged by that time.
    """

    PERIOD_S = 0.1
    LONGEST_STEP_S = 0.5

    def __init__(self) -> None:
        self._base_s = 0.0
        self._ticked_s = time.monotonic()

    def tick(self) -> None:
        """Note that the process runs; call it every `PERIOD_S`."""
        self._base_s = self.now_s()
        self._ticked_s = time.monotonic()

    def now_s(self) -> float:
        """Return the time in s."""
        return self._base_s + min(time.monotonic() - self._ticked_s, self.LONGEST_STEP_S)


class VehiclePresence:
    """Checks whether another vehicle still publishes a topic.

    The middleware reports the end of a process at once, and a killed one after its lease. A process that
    is only slow is still there, however busy the machine.

    Attributes:
        is_gone: it published the topic and does not any more.
    """

    def __init__(
        self, node: SuiteNode, vehicle: str, topic: Topic, on_gone: Callable[[], None]
    ) -> None:
        self.is_gone = False
        self._node, self._on_gone = node, on_gone
        self._name = node.resolve_topic_name(topic_of(vehicle, topic))
        self._was_there = False
        node.every(_LOOK_PERIOD_S, self._look)

    def _look(self) -> None:
        is_there = self._node.count_publishers(self._name) > 0
        self._was_there |= is_there
        went = self._was_there and not is_there and not self.is_gone
        self.is_gone = self._was_there and not is_there
        if went:
            self._on_gone()


class Watchdog:
    """Calls back once when nothing has fed it for a while; feeding arms it again.

    It starts unarmed, so that the wait for the first message is not taken for a failure.
    """

    def __init__(
        self,
        timeout_s: float,
        on_silence: Callable[[float], None],
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up a watchdog; see `attach` for the timer.

        Args:
            timeout_s: permitted silence, positive.
            on_silence: called once per silence with its length so far in seconds.
        """
        if not timeout_s > 0.0:
            raise ParameterError(f"watchdog timeout is {timeout_s} s; allowed: above 0")
        self.timeout_s = timeout_s
        self._on_silence = on_silence
        self._steady_time_s = steady_time_s
        self._fed_s: float | None = None
        self._reported = False

    def feed(self) -> None:
        """Note a sign of life."""
        self._fed_s = self._steady_time_s()
        self._reported = False

    def disarm(self) -> None:
        """Expect nothing any more until it is fed again."""
        self._fed_s = None
        self._reported = False

    @property
    def is_silent(self) -> bool:
        """Whether the present silence has been reported."""
        return self._reported

    def check(self) -> None:
        """Report the silence if it has become too long."""
        if self._fed_s is None or self._reported:
            return
        silence_s = self._steady_time_s() - self._fed_s
        if silence_s > self.timeout_s:
            self._reported = True
            self._on_silence(silence_s)

    def attach(self, node: SuiteNode) -> Watchdog:
        """Check regularly on a timer of the node; return the watchdog itself.

        From now on only such silence counts in which the node itself was running.
        """
        self._steady_time_s = node.awake.now_s
        node.every(self.timeout_s / _CHECKS_PER_TIMEOUT, self.check)
        return self


NAME = "_heartbeat"
"""Hidden, as ROS calls a name that begins with an underscore: tools list it on request."""
PERIOD_S = 0.02
IDLE_PERIOD_S = 0.5
"""Between two looks for a listener."""
CHECK_PERIOD_S = 0.01
SILENT_S = 0.06
_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Heartbeat:
    """The signs of life of a node: a header with its name, while somebody listens."""

    def __init__(self, node: Node) -> None:
        self._node, self._ended = node, threading.Event()
        self._publisher = node.create_publisher(Header, NAME, _QOS)
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the thread; before the node is destroyed."""
        self._ended.set()
        self._thread.join()

    def _beat(self) -> None:
        go_first()
        message, drives_a_car = Header(frame_id=self._node.get_name()), False
        period_s = PERIOD_S
        while not self._ended.wait(period_s) and self._node.context.ok():
            is_heard = self._publisher.get_subscription_count() > 0
            period_s = PERIOD_S if is_heard else IDLE_PERIOD_S
            if not is_heard:
                continue
            if not drives_a_car:
                # One that waits for its turn with a lock of interpreter or middleware holds this one up.
                for thread in Path("/proc/self/task").iterdir():
                    go_first(int(thread.name), REAL_TIME_PRIORITY // 2)
                go_first()
                drives_a_car = True
            self._publisher.publish(message)


class HeartbeatWatch:
    """For how long each of several nodes has been silent, while this process ran."""

    def __init__(self, node: Node, names: Iterable[str]) -> None:
        self._silent_s = dict.fromkeys(names, SILENT_S)
        self._checked_s = time.monotonic()
        self._subscription: Subscription = node.create_subscription(
            Header, NAME, self._on_beat, QoSProfile(depth=10, reliability=_QOS.reliability)
        )

    def _on_beat(self, message: Header) -> None:
        if message.frame_id in self._silent_s:
            self._silent_s[message.frame_id] = 0.0

    def silent(self) -> tuple[str, ...]:
        """Return the silent nodes; to be called every `CHECK_PERIOD_S`."""
        now_s = time.monotonic()
        # Longer when this process stood itself: what arrived meanwhile is still to be taken.
        passed_s, self._checked_s = min(now_s - self._checked_s, 2.0 * CHECK_PERIOD_S), now_s
        for name in self._silent_s:
            self._silent_s[name] += passed_s
        if any(silent_s > SILENT_S for silent_s in self._silent_s.values()):
            self._take_arrived()
        return tuple(name for name, silent_s in self._silent_s.items() if silent_s > SILENT_S)

    def _take_arrived(self) -> None:
        """Take what has arrived and waits behind other callbacks of the executor."""
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(Header, False)) is not None:  # noqa: FBT003
                self._on_beat(taken[0])
