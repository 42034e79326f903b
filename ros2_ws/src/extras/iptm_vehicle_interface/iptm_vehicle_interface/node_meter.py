"""A live meter: takes the odometry of any vehicle, and publishes its battery."""

from __future__ import annotations

import time

from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from iptm_core.program import EXIT_OK, StopRequest
from iptm_core.state import NS_PER_S
from iptm_core.units import J_PER_KWH
from iptm_ros.codecs import encode_battery, ns_from_time
from iptm_ros.process import joined_node
from iptm_ros.publishers import SENSOR_QOS, STREAM_QOS
from iptm_ros.suite_node import SuiteNode
from iptm_vehicle_interface.drive_meter import DriveMeter

_SPIN_S = 0.1
_SHOW_S = 5.0


class _MeterNode(SuiteNode):
    """Meters `nav_msgs/msg/Odometry` by stamp and twist.linear.x; backwards counts as forwards."""

    def __init__(
        self, meter: DriveMeter, topic: str, battery: str, consumers_w: float, context: object
    ) -> None:
        super().__init__("meter", context=context)
        self.meter, self._consumers_w = meter, consumers_w
        self._published_s = 0.0
        self._publisher = self.create_publisher(BatteryState, battery, STREAM_QOS)
        self.create_subscription(
            Odometry, topic, lambda message: self.guard(topic, self._take, message), SENSOR_QOS
        )

    def _take(self, message: Odometry) -> None:
        time_s = ns_from_time(message.header.stamp) / NS_PER_S
        self.meter.take(time_s, abs(message.twist.twist.linear.x), self._consumers_w)
        driven_s = self.meter.reading.driven_s
        if driven_s > self._published_s:
            self._published_s = driven_s
            self._publisher.publish(encode_battery(self.meter.battery()))


def follow(meter: DriveMeter, topic: str, battery: str, consumers_w: float) -> int:
    """Meter a topic until a signal comes; print a line now and then, and the sum at the end."""
    stop = StopRequest()
    stop.install()
    with joined_node(lambda context: _MeterNode(meter, topic, battery, consumers_w, context)) as (
        _,
        executor,
    ):
        shown_s = time.monotonic()
        print(f"metering {topic}", flush=True)
        while not stop.is_set:
            executor.spin_once(timeout_sec=_SPIN_S)
            if time.monotonic() - shown_s >= _SHOW_S:
                shown_s = time.monotonic()
                print(_line(meter), flush=True)
    print(_line(meter), flush=True)
    return EXIT_OK


def _line(meter: DriveMeter) -> str:
    reading = meter.reading
    return (
        f"{reading.driven_s:.0f} s, {reading.state.position_m / 1000.0:.2f} km, "
        f"{reading.battery_energy_j / J_PER_KWH:.3f} kWh, capacity loss {1e6 * reading.capacity_loss:.3g} ppm"
    )
