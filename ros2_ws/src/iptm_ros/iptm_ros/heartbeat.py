"""Signs of life of the nodes that drive a car, from a thread each, which a long computation does not silence.

A process that dies or stops is noticed within `SILENT_S` and a period of the watch. One that lives and does
not decide is noticed by its decisions.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from iptm_core.program import REAL_TIME_PRIORITY, go_first

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
