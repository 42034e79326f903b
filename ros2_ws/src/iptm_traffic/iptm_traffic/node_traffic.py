"""The traffic as a node: moves the host in SUMO with its plant, and sends the messages of other cars."""

from __future__ import annotations

import math

from nav_msgs.msg import Odometry
from rclpy.context import Context
from rosgraph_msgs.msg import Clock

from iptm_core.parameters.model import ModelParameters
from iptm_core.state import NS_PER_S
from iptm_interfaces.codecs import ns_from_time
from iptm_interfaces.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_interfaces.suite_node import SuiteNode
from iptm_interfaces.topics import Topic
from iptm_traffic.drive import TrafficDrive
from iptm_traffic.radio import TrafficRadio
from iptm_traffic.simulation import HostInstant, TrafficSimulation
from iptm_traffic.world import SumoWorld
from iptm_v2x_bridge.messages.cam import specification
from iptm_v2x_bridge.sending.datagrams import (
    NOT_ALL_SENT,
    REPEAT_PERIOD_S,
    DatagramSender,
)

NAME = "traffic"
LISTENERS = 2
"""Additional subscriptions to odometry and clock with traffic, apart from the bridge's."""
_LOCALHOST = "127.0.0.1"


class TrafficNode(SuiteNode):
    """Lets SUMO pass the interval before every state of the plant, and sends the messages of that interval.

    They go through one socket with the end of the tick behind them, which is repeated until the next tick, so
    the bridge hears the same in every run. A node drives one trip, from trip time 0.

    Attributes:
        world: SUMO around the host.
    """

    def __init__(
        self,
        context: Context,
        drive: TrafficDrive,
        parameters: ModelParameters,
        simulation: TrafficSimulation,
        radio: TrafficRadio,
        to_port: int,
    ) -> None:
        """Join the graph."""
        super().__init__(NAME, context=context)
        self._simulation, self._radio = simulation, radio
        self.world = SumoWorld(drive.scenario, simulation, parameters)
        self._datagrams = DatagramSender(_LOCALHOST, to_port)
        self._host: HostInstant | None = None
        specification()  # compiled now, not at the first tick, which others wait for
        self._reporter = DiagnosticsReporter.of_node(self, NAME)
        self.every(REPEAT_PERIOD_S, self._datagrams.repeat_end)
        self.every(REPORT_PERIOD_S, self._report)
        self.listen(Topic.PLANT_ODOMETRY, self._on_host)
        # Only to be counted: the plant waits for as many peers on the clock as on the odometry, and the
        # bridge listens to both.
        for _ in range(LISTENERS):
            self.listen(Topic.CLOCK, self._on_clock)
        self._report()

    def _on_clock(self, message: Clock) -> None:
        pass

    def _on_host(self, message: Odometry) -> None:
        time_ns = ns_from_time(message.header.stamp)
        position_m = float(message.pose.pose.position.x)
        speed_m_s = float(message.twist.twist.linear.x)
        host = HostInstant(time_ns / NS_PER_S, position_m, speed_m_s)
        before = self._host or HostInstant(0.0, 0.0, 0.0)
        if not (math.isfinite(position_m) and math.isfinite(speed_m_s)):
            return  # the bridge gets no end of the tick, and reports it
        if host.time_s < before.time_s or (self._host is not None and host.time_s == before.time_s):
            return  # a state that was repeated, or a new trip, which needs a new simulation
        if host.time_s > before.time_s:
            self.world.pass_interval(before, host)
        self._host = host
        for _, datagram in self._radio.take():
            self._datagrams.send(datagram)
        self._datagrams.end_tick(time_ns)

    def _report(self) -> None:
        host = self._host
        values: dict[str, object] = {
            **self._datagrams.report(),
            "leader": ("none", *self.world.leaders)[-1],
            "largest_deviation_m": self._simulation.largest_deviation_m,
        }
        level, reason = Level.OK, "the traffic follows the plant"
        if host is None:
            level, reason = Level.WARN, "waiting for the plant"
        elif self._datagrams.failed:
            level, reason = Level.WARN, NOT_ALL_SENT
        self._reporter.report(
            0 if host is None else round(host.time_s * NS_PER_S), level, reason, values
        )

    def destroy_node(self) -> None:
        """Give the socket back, too."""
        self._datagrams.close()
        super().destroy_node()
