"""The base of every node of the suite: topics by key, and an orderly end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from iptm_core.errors import ParameterError
from iptm_core.strict_mapping import suggestion
from iptm_interfaces.topics import TOPICS, Topic

_ROS_PARAMETERS = ("use_sim_time", "qos_overrides.", "start_type_description_service")


class SuiteNode(Node):
    """A node that takes names, types and QoS from the topic table.

    Run it with `iptm_interfaces.process.run_node`, which watches `finished`.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.finished = False
        self.exit_code = 0
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)

    def advertise(self, topic: Topic) -> Publisher:
        """Return a publisher for a topic of the table."""
        spec = TOPICS[topic]
        return self.create_publisher(spec.message_type, spec.name, spec.qos)

    def listen(
        self, topic: Topic, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Return a subscription to a topic of the table.

        Args:
            topic: key of the topic.
            callback: called with the message, or with its serialised bytes if `raw`.
            raw: leave out the conversion to a message object.
        """
        spec = TOPICS[topic]
        return self.create_subscription(spec.message_type, spec.name, callback, spec.qos, raw=raw)

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Return a timer on the steady clock, which trip time cannot stop or speed up."""
        return self.create_timer(period_s, callback, clock=self._steady_clock)

    def reject_unknown_parameters(self) -> None:
        """Refuse overrides that no one declared: ROS ignores them, and with them every typo.

        Raises:
            ParameterError: an unknown name, with the closest known one.
        """
        # rclpy has no public way to list overrides without declaring them untyped.
        overrides: dict[str, Any] = getattr(self, "_parameter_overrides", {})
        for name in overrides:
            if self.has_parameter(name) or name.startswith(_ROS_PARAMETERS):
                continue
            own = [known for known in self._parameters if not known.startswith(_ROS_PARAMETERS)]
            hint = suggestion(name, sorted(own))
            raise ParameterError(f"parameter {name} is unknown to {self.get_name()}; {hint}")

    def stop(self) -> None:
        """Answer a request to stop (SIGINT, SIGTERM); repeated until the node has finished.

        A node with work left overrides this and finishes later.
        """
        self.finish(self.exit_code)

    def finish(self, exit_code: int = 0) -> None:
        """Ask for the end of the process; the current callback still completes."""
        self.exit_code = exit_code
        self.finished = True
