"""A process that hangs is noticed."""

from __future__ import annotations

import time
from typing import Any

import pytest
from rclpy.experimental import EventsExecutor

from iptm_core.errors import ParameterError
from iptm_ros.node_health import Watchdog


class Bench:
    def __init__(self) -> None:
        self.now_s = 0.0
        self.reports: list[float] = []
        self.dog = Watchdog(2.0, self.reports.append, lambda: self.now_s)

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.dog.check()


def test_it_does_not_report_before_the_first_sign_of_life() -> None:
    bench = Bench()
    bench.wait(1000.0)
    assert not bench.reports


def test_it_reports_once_per_silence() -> None:
    bench = Bench()
    bench.dog.feed()
    bench.wait(2.0)
    assert not bench.dog.is_silent
    bench.wait(0.5)
    bench.wait(5.0)
    assert bench.reports == [2.5]
    assert bench.dog.is_silent


def test_feeding_arms_it_again() -> None:
    bench = Bench()
    for _ in range(2):
        bench.dog.feed()
        assert not bench.dog.is_silent
        bench.wait(3.0)
    assert len(bench.reports) == 2


def test_disarmed_it_is_quiet() -> None:
    bench = Bench()
    bench.dog.feed()
    bench.dog.disarm()
    bench.wait(100.0)
    assert not bench.reports


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, float("nan")])
def test_timeout_must_be_positive(timeout_s: float) -> None:
    with pytest.raises(ParameterError, match="watchdog timeout"):
        Watchdog(timeout_s, lambda _: None)


def test_it_runs_on_the_steady_clock_although_trip_time_stands_still(make_node: Any) -> None:
    node = make_node("-p", "use_sim_time:=true")
    silences: list[float] = []
    Watchdog(0.05, silences.append).attach(node).feed()
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    deadline = time.monotonic() + 120.0
    while not silences and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    assert len(silences) == 1
