"""The clock between two ticks: for nodes with timers on trip time only."""

from __future__ import annotations

from typing import Any

from rclpy.clock import ROSClock
from rclpy.parameter import Parameter

from iptm_core.state import NS_PER_S
from iptm_ros.codecs import ns_from_time, stamp_of
from iptm_ros.topics import Topic

RATE = {"mode": "real_time", "rate_factor": 2.5, "clock_hz": 50.0}
TRIP = {"cycle": "nycc", "duration_s": 10.0, "command_timeout_s": 60.0, "linger_s": 3.0}


def test_a_timer_on_trip_time_runs_between_the_ticks_which_alone_are_answered(
    launcher: Any, peer: Any
) -> None:
    times: list[int] = []
    answered: list[int] = []
    calls: list[int] = []
    node = peer.node
    node.set_parameters([Parameter("use_sim_time", value=True)])
    clock = node.get_clock()
    assert isinstance(clock, ROSClock)
    node.create_timer(0.25, lambda: calls.append(clock.now().nanoseconds), clock=clock)
    node.listen(Topic.CLOCK, lambda message: times.append(ns_from_time(message.clock)))
    node.listen(Topic.LEADER, lambda m: answered.append(stamp_of(m)))
    launcher.start_node(
        "iptm_v2x_bridge.node",
        parameters={"cycle": "nycc", "clock_hz": RATE["clock_hz"]},
    )
    plant = launcher.start_node(
        "iptm_plant_sim.node", parameters={**TRIP, **RATE, "start_paused": True}
    )
    peer.begin("plant", "v2x_bridge")
    last_ns = 10 * NS_PER_S
    peer.wait_until(lambda: last_ns in answered and last_ns in times, what="the last tick")
    plant.stop()
    assert "number of timers" not in plant.stdout  # rclpy's warning
    assert times == sorted(set(times))
    ticks = [time_ns for time_ns in times if time_ns % NS_PER_S == 0]
    # As many as the machine managed; without them, a timer of 4 Hz fires once a tick.
    assert len(times) > len(ticks)
    assert len(calls) > len(ticks)
    assert set(answered) <= set(ticks)
    assert times[-1] == 10 * NS_PER_S  # the time of a trip does not go on behind its end
