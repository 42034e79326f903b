"""One diagnostic status per node: published on change of level or reason, else at most once a second.

The reason is a short sentence without numbers, so that it changes only when the situation does;
numbers go into the key values. Messages are stamped by the node's clock, as `diagnostic_aggregator` expects;
the trip time is a key value. Levels follow ROS: STALE means that the data a node needs has stopped
coming.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from enum import Enum

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message

from iptm_ros.codecs.cdr import s_from_ns
from iptm_ros.node_health import NodeHealth
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

HARDWARE_ID = "iptm"
"""Vehicle of a suite outside of any namespace."""
CHANGED_SETTINGS = "changed_settings"
"""Key: settings that were changed last while the node runs, with their former values."""
SETTINGS_SINCE = "settings_since_s"
"""Key: trip time of the first tick with them, or `start`."""
TRIP_TIME = "trip_time_s"
"""Key: trip time of the status, 0 before the trip."""
PROCESS = "process"
"""Key: process of the node, which distinguishes two nodes of the same name."""
REPORT_PERIOD_S = 1.0
"""Interval at which nodes report, and the least between two messages of the same level and reason."""


class Level(Enum):
    """Severity of a status, with the values of `diagnostic_msgs/DiagnosticStatus`."""

    OK = DiagnosticStatus.OK
    WARN = DiagnosticStatus.WARN
    ERROR = DiagnosticStatus.ERROR
    STALE = DiagnosticStatus.STALE


def _text(value: object) -> str:
    """Return a key value as text: floats with six digits, everything else as Python writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def build_status(
    name: str,
    level: Level,
    reason: str,
    values: Mapping[str, object],
    hardware_id: str = HARDWARE_ID,
) -> DiagnosticStatus:
    """Return one status."""
    return DiagnosticStatus(
        level=level.value,
        name=name,
        message=reason,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )


def status_values(status: DiagnosticStatus) -> dict[str, str]:
    """Return the key values of a status as a mapping."""
    return {entry.key: entry.value for entry in status.values}


def find_status(message: DiagnosticArray, name: str) -> DiagnosticStatus | None:
    """Return the status of a node (its qualified name, with or without component) if present."""
    for status in message.status:
        if status.name == name or status.name.startswith(name + ": "):
            return status
    return None


class DiagnosticsReporter:
    """Publishes the status of a node at a limited rate.

    Call `report` every tick: a change of level or reason goes out at once, mere changes of numbers
    at most once per `REPORT_PERIOD_S` of steady time.
    """

    def __init__(
        self,
        publish: Callable[[DiagnosticArray], None],
        name: str,
        on_change: Callable[[Level, str], None],
        health: NodeHealth,
        now: Callable[[], Time],
        hardware_id: str = HARDWARE_ID,
        steady_time_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up a reporter.

        Args:
            publish: takes the finished message.
            name: name of the status.
            on_change: called with every new level or reason, for the log.
            health: errors that the node met; errors go before every reason, warnings before OK.
            now: returns the time of the node's clock, for the stamps.
            hardware_id: the vehicle.
            steady_time_s: clock in seconds, replaceable in tests.
        """
        self._publish = publish
        self._name = name
        self._steady_time_s = steady_time_s
        self._on_change = on_change
        self._health = health
        self._now = now
        self._hardware_id = hardware_id
        self._last: tuple[Level, str] | None = None
        self._last_time_s = -math.inf

    @classmethod
    def of_node(cls, node: SuiteNode, component: str) -> DiagnosticsReporter:
        """Return a reporter on `/diagnostics` that also logs every change once."""
        publisher = node.advertise(Topic.DIAGNOSTICS)
        logger = node.get_logger()

        def log(level: Level, reason: str) -> None:
            # One line per call site and severity, as the logger identifies callers by line.
            if level is Level.OK:
                logger.info(reason)
            elif level is Level.ERROR:
                logger.error(reason)
            else:
                logger.warning(reason)

        name = f"{node.get_fully_qualified_name()}: {component}"
        vehicle = node.get_namespace().strip("/") or HARDWARE_ID
        clock = node.get_clock()
        return cls(publisher.publish, name, log, node.health, lambda: clock.now().to_msg(), vehicle)

    def is_from_double(self, data: bytes) -> bool:
        """Return whether another process reports in a message on the same component of the vehicle."""
        component = self._name.rpartition(": ")[2]
        own = str(os.getpid())
        if f": {component}\0".encode() not in data or self._hardware_id.encode() not in data:
            return False
        message = deserialize_message(data, DiagnosticArray)
        return any(
            status.hardware_id == self._hardware_id
            and status.name.endswith(f": {component}")
            and status_values(status).get(PROCESS, own) != own
            for status in message.status
        )

    def report(
        self,
        trip_time_ns: int,
        level: Level,
        reason: str,
        values: Callable[[], Mapping[str, object]],
    ) -> bool:
        """Publish the status if it is due; return whether it was.

        `values` is called only then: a node reports every tick, and most reports are not due.
        """
        now_s = self._steady_time_s()
        if self._health.error:
            level, reason = Level.ERROR, self._health.error
        elif self._health.warning and level is Level.OK:
            level, reason = Level.WARN, self._health.warning
        changed = (level, reason) != self._last
        if not changed and now_s - self._last_time_s < REPORT_PERIOD_S:
            return False
        time_s = f"{s_from_ns(trip_time_ns):.9g}"
        all_values = {
            TRIP_TIME: time_s,
            **values(),
            **self._health.values,
            PROCESS: os.getpid(),
        }
        status = build_status(self._name, level, reason, all_values, self._hardware_id)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._now()
        self._publish(message)
        if changed:
            self._on_change(level, reason)
        self._last = (level, reason)
        self._last_time_s = now_s
        return True
