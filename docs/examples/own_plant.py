"""A minimal plant in lock-step: a point mass with drag and one lumped battery temperature.

It takes the place of `scripts/plant`: it publishes the state of every tick, waits for the command that
answers it, and integrates to the next one. Plain rclpy and standard messages: nothing of the suite is
imported.
"""

from __future__ import annotations

from contextlib import suppress

import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

PERIOD_S = 1
DURATION_S = 60
MASS_KG = 1600.0
AUXILIARY_W = 300.0
COP = 3.0
HEAT_CAPACITY_J_K = 4e5


class OwnPlant(Node):
    """Master of time: a tick lasts until the command with its stamp has arrived."""

    def __init__(self) -> None:
        super().__init__("plant")
        self._state = self.create_publisher(JointState, "plant/state", 10)
        self._clock_topic = self.create_publisher(Clock, "clock", 10)
        self.create_subscription(JointState, "controller/command", self._take_command, 10)
        self.create_service(Trigger, "~/resume", self._begin)
        self._timer = self.create_timer(0.5, self._publish_state, autostart=False)
        self.time_s = 0
        self.position_m = self.speed_m_s = self.acceleration_m_s2 = 0.0
        self.temperature_k = 309.0
        self.capacity_loss = 1e-3  # a law of ageing has no rate at 0
        self.powers = self._powers_of(0.0, 0.0)

    def _begin(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        """Begin the trip; the timer repeats a state without an answer."""
        self._timer.reset()
        self._publish_state()
        answer.success = True
        return answer

    def _take_command(self, command: JointState) -> None:
        if command.header.stamp != Time(sec=self.time_s):
            return  # the answer to another state
        values = dict(zip(command.name, command.position, strict=True))
        self._drive(values["acceleration_m_s2"], values["compressor_power_w"])
        self.time_s += PERIOD_S
        if self.time_s > DURATION_S:
            raise SystemExit
        self._publish_state()

    def _drive(self, acceleration_m_s2: float, compressor_w: float) -> None:
        """Integrate one period."""
        self.acceleration_m_s2 = max(acceleration_m_s2, -self.speed_m_s / PERIOD_S)
        mean_m_s = self.speed_m_s + 0.5 * self.acceleration_m_s2 * PERIOD_S
        force_n = MASS_KG * self.acceleration_m_s2 + 150.0 + 0.4 * mean_m_s**2
        traction_w = force_n * mean_m_s * (1.1 if force_n > 0.0 else 0.7)
        self.powers = self._powers_of(traction_w, compressor_w)
        heat_w = 0.03 * abs(self.powers["battery_power_w"]) - self.powers["chiller_heat_w"]
        self.temperature_k += heat_w * PERIOD_S / HEAT_CAPACITY_J_K
        self.position_m += mean_m_s * PERIOD_S
        self.speed_m_s += self.acceleration_m_s2 * PERIOD_S
        self.capacity_loss += 1e-13 * abs(self.powers["battery_power_w"]) * PERIOD_S

    @staticmethod
    def _powers_of(traction_w: float, compressor_w: float) -> dict[str, float]:
        """Return the means over the last period, drawn from the pack, by name."""
        return {
            "traction_power_w": traction_w,
            "compressor_power_w": compressor_w,
            "auxiliary_power_w": AUXILIARY_W,
            "battery_power_w": traction_w + compressor_w + AUXILIARY_W,
            "chiller_heat_w": COP * compressor_w,
        }

    def _publish_state(self) -> None:
        """Publish the state of a tick, then the clock of the same time."""
        stamp = Time(sec=self.time_s)
        values = {
            "position_m": self.position_m,
            "speed_m_s": self.speed_m_s,
            "acceleration_m_s2": self.acceleration_m_s2,
            "cell_1_temperature_k": self.temperature_k,
            "cell_n_temperature_k": self.temperature_k,
            "cell_1_capacity_loss": self.capacity_loss,
            "cell_n_capacity_loss": self.capacity_loss,
            **self.powers,
        }
        message = JointState(name=list(values), position=list(values.values()))
        message.header.stamp = stamp
        self._state.publish(message)
        self._clock_topic.publish(Clock(clock=stamp))


def main() -> None:
    """Drive one trip."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException, SystemExit):
        rclpy.spin(OwnPlant())


if __name__ == "__main__":
    main()
