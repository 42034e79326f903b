"""Settings of the controller that are changed while it drives: checked, applied, reported, recorded."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from std_msgs.msg import String
from tests.integration.controller_ticks import ROAD, SMALL, as_measured, tick_messages
from tests.integration.node_bench import NodeBench, S, node_bench

from iptm_controller.node import ControllerNode
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_core.errors import BagError
from iptm_core.trajectory import Trajectory
from iptm_ros.codecs import decode_command, encode_slope, serialized, time_from_ns
from iptm_ros.diagnostics import CHANGED_SETTINGS, SETTINGS_SINCE, Level, build_status
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.trajectory_reader import (
    SettingsChange,
    changes_in_words,
    read_settings_changes,
    refuse_changed_settings,
)
from iptm_ros.topics import TOPICS, Topic

pytestmark = pytest.mark.usefixtures("ros_environment")
OPTIONS: dict[str, Any] = {**SMALL, "strategy": "reference"}


@pytest.fixture
def controller() -> Iterator[NodeBench]:
    with node_bench(ControllerNode, **OPTIONS) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        yield bench


def set_all(bench: NodeBench, **values: Any) -> Any:
    """Set parameters at once, as the service does; return the result."""
    parameters = [Parameter(name, value=value) for name, value in values.items()]
    return bench.node.set_parameters_atomically(parameters)


def send_tick(bench: NodeBench, tick: int) -> None:
    """Send the controller a tick and wait for its answer, which a starved machine delays."""
    bench.hear(tick_messages(float(tick)))
    bench.spin_until(lambda: bench.stamps(Topic.COMMAND)[-1:] == [tick])


def test_weights_hold_from_the_next_tick_on(controller: NodeBench) -> None:
    alone = ControllerNodeParameters(**OPTIONS).build_controller()
    for tick in range(6):
        if tick == 3:
            assert set_all(controller, strategy="aging", aging_weight=7.0).successful
            weights = ControllerNodeParameters(**{**OPTIONS, "strategy": "aging"}, aging_weight=7.0)
            alone.use_costs(weights.controller_options())
        send_tick(controller, tick)
        assert decode_command(controller.received[Topic.COMMAND][-1]) == (
            tick * S,
            alone.decide(as_measured(tick_messages(float(tick)))).command,
        )
    reported = [
        status.message
        for array in controller.received[Topic.DIAGNOSTICS]
        for status in array.status
    ]
    assert reported.count("settings have been changed") == 1
    assert controller.values["strategy"] == "aging"
    assert controller.values[SETTINGS_SINCE] == "3"
    assert "strategy=aging (was reference)" in controller.values[CHANGED_SETTINGS]
    assert "aging_weight=7.0 (was -1.0)" in controller.values[CHANGED_SETTINGS]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"strategy": "fastest"}, "fastest"),
        ({"aging_weight": -7.0}, "aging_weight"),
        ({"speed_weight": 2.0, "horizon": "3x1+3x5"}, "read-only"),
        ({"speed_weight": 2.0, "period_s": 0.5}, "read-only"),
    ],
)
def test_a_mistake_is_refused_in_a_sentence_and_changes_nothing(
    controller: NodeBench, values: dict[str, Any], words: str
) -> None:
    result = set_all(controller, **values)
    assert not result.successful
    assert words in result.reason
    assert len(result.reason.splitlines()) == 1
    send_tick(controller, 0)
    assert controller.values[CHANGED_SETTINGS] == "none"
    for name in values:
        assert controller.node.get_parameter(name).value == getattr(
            ControllerNodeParameters(**OPTIONS), name
        )


def test_a_bag_tells_of_changes_inside_it(tmp_path: Path) -> None:
    reported = [
        (5, "4", "before"),
        (6, "4", "before"),
        (9, "9", "horizon=2x1 (was 1x1)"),
        (10, "9", "x"),
    ]
    with BagWriter(tmp_path / "bag") as writer:
        key = writer.add_topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        for second, since, what in reported:
            values = {CHANGED_SETTINGS: what, SETTINGS_SINCE: since}
            for name in ("/car_1/controller", "/car_2/controller"):
                if name == "/car_1/controller" or second < 9:
                    status = build_status(f"{name}: optimal control", Level.OK, "", values)
                    message = DiagnosticArray(status=[status])
                    message.header.stamp = time_from_ns(second * S)
                    writer.write(key, serialized(message), second * S)
    (change,) = read_settings_changes(tmp_path / "bag", "car_1")
    assert str(change) == "from 9 s on horizon=2x1 (was 1x1)"
    with pytest.raises(BagError, match="changed while it drove"):
        refuse_changed_settings(tmp_path / "bag", "car_1")
    assert read_settings_changes(tmp_path / "bag", "car_2") == []
    refuse_changed_settings(tmp_path / "bag", "car_2")
    assert len(read_settings_changes(tmp_path / "bag")) == 1


def test_figures_of_the_last_trip_come_with_its_own_changes(
    tick_messages: Any, trajectory: Trajectory, tmp_path: Path
) -> None:
    """What was changed in an earlier trip holds for all of the last one."""
    changes_by_trip = {
        0: {3: ("3", "horizon=2x1 (was 1x1)"), 7: ("7", "speed_weight=2.0 (was 1.0)")},
        1: {5: ("5", "deadline_ms=9.0 (was 0.0)")},
    }
    with BagWriter(tmp_path / "bag") as writer:
        ids: dict[Topic, int] = {}
        since = ("start", "none")
        for trip, changes in changes_by_trip.items():
            for row in range(len(trajectory)):
                since = changes.get(row, since)
                values = dict(zip((SETTINGS_SINCE, CHANGED_SETTINGS), since, strict=True))
                status = build_status("/controller: optimal control", Level.OK, "", values)
                reported = tick_messages(trajectory, row)
                reported[Topic.DIAGNOSTICS] = DiagnosticArray(status=[status])
                for topic, message in reported.items():
                    if topic not in ids:
                        spec = TOPICS[topic]
                        ids[topic] = writer.add_topic(f"/{spec.name.strip('/')}", spec.type_name)
                    at_ns = (trip * len(trajectory) + row) * S
                    writer.write(ids[topic], serialized(message), at_ns)
    earlier, during = changes_in_words(read_settings_changes(tmp_path / "bag"))
    assert earlier == (
        "changed in an earlier trip: horizon=2x1 (was 1x1); speed_weight=2.0 (was 1.0)"
    )
    assert during == "changed while driving: from 5 s on deadline_ms=9.0 (was 0.0)"


def test_many_changes_are_summed_up() -> None:
    many = [SettingsChange(float(k), f"speed_weight={k}.0 (was 1.0)") for k in range(40)]
    (text,) = changes_in_words(many)
    assert "40 times" in text
    assert "from 39 s on speed_weight=39.0" in text
    assert len(text) < 200


PRICED = {**OPTIONS, "strategy": "prices", "trip_duration_s": 600.0}
WARM_ENDS_COST = {"arrival_cost_eur": "20:0, 40:2", "electricity_eur_kwh": 0.2}


def test_a_cost_on_arrival_that_is_heard_is_the_one_of_the_settings() -> None:
    """Until it is heard the settings decide, from then on as in a trip that states it."""
    plain, priced = (
        ControllerNodeParameters(**given).build_controller()
        for given in (PRICED, {**PRICED, **WARM_ENDS_COST})
    )
    with node_bench(ControllerNode, **PRICED) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        for tick in range(6):
            if tick == 3:
                bench.hear({Topic.ARRIVAL_COST: String(data=json.dumps(WARM_ENDS_COST))})
                for text in ("no JSON", '{"arrival_cost_eur": "warm:1"}', "[1]"):
                    bench.hear({Topic.ARRIVAL_COST: String(data=text)})
                priced.memory = plain.memory
            send_tick(bench, tick)
            alone = plain if tick < 3 else priced
            expected = alone.decide(as_measured(tick_messages(float(tick)))).command
            assert decode_command(bench.received[Topic.COMMAND][-1]) == (tick * S, expected)
        first, second = (
            each.decide(as_measured(tick_messages(6.0))).record for each in (plain, priced)
        )
        assert first.cell_1_marginal_cost_1_k != second.cell_1_marginal_cost_1_k
        bench.spin_until(lambda: bench.values.get("refused_messages") == "3")
        assert bench.values["arrival_cost"] == Topic.ARRIVAL_COST.value
        assert bench.values[CHANGED_SETTINGS] == "none"


def test_a_cost_on_arrival_is_refused_where_the_trip_has_no_end() -> None:
    with node_bench(ControllerNode, **{**PRICED, "trip_duration_s": 0.0}) as bench:
        bench.hear({Topic.SLOPE: encode_slope(ROAD)})
        bench.hear({Topic.ARRIVAL_COST: String(data=json.dumps(WARM_ENDS_COST))})
        send_tick(bench, 0)
        bench.spin_until(lambda: bench.values.get("refused_messages") == "1")
        assert bench.values["arrival_cost"] == "of the settings"
