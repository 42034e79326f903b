"""The planner as a process: its latched plan, moved departures, a measured battery, and its end."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from tests.packaging.packages import ROOT

from iptm_plan.node import OUT_OF_REACH, PLAN_TOPIC, PLANNED
from iptm_ros.diagnostics import status_values
from iptm_ros.publishers import LATCHED_QOS
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.topics import Topic

EXAMPLE = ROOT / "docs" / "examples" / "my_week.yaml"


@pytest.fixture
def plans(peer: Any) -> list[dict[str, Any]]:
    """Return a list that grows with every plan."""
    heard: list[dict[str, Any]] = []
    peer.node.create_subscription(
        String, PLAN_TOPIC, lambda message: heard.append(json.loads(message.data)), LATCHED_QOS
    )
    return heard


def started(launcher: Any, week: Path = EXAMPLE) -> Any:
    return launcher.start_node("iptm_plan.node", parameters={"week": str(week)})


def departures(plan: dict[str, Any]) -> list[str]:
    return [each["at"] for each in plan["events"] if each["event"] == "departure"]


def test_a_plan_is_there_and_follows_departures_and_battery(
    launcher: Any, peer: Any, plans: list[dict[str, Any]]
) -> None:
    statuses = peer.statuses("/planner")
    battery = peer.node.advertise(Topic.PLANT_BATTERY)
    costs: list[dict[str, Any]] = []
    peer.node.listen(Topic.ARRIVAL_COST, lambda message: costs.append(json.loads(message.data)))
    planner = started(launcher)
    began_s = time.monotonic()
    peer.wait_until(
        lambda: plans and costs and statuses and statuses[-1].message == PLANNED,
        what="the first plan",
    )
    arrival = next(each for each in plans[0]["events"] if each["event"] == "arrival")
    assert costs[0] == arrival["trip"]
    print(f"first plan after {time.monotonic() - began_s:.2f} s")
    assert len(plans) == 1
    first = plans[0]
    assert departures(first)[0] == "2026-07-15T14:00:00Z"
    assert first["chargingProfile"]["chargingSchedule"][0]["chargingRateUnit"] == "W"
    answer = peer.call("/planner/depart_earlier")
    assert answer.success
    assert answer.message == "departure 1 at 2026-07-15 06:45"
    peer.wait_until(lambda: len(plans) == 2, what="a plan for the moved departure")
    assert departures(plans[1])[0] == "2026-07-15T13:45:00Z"
    assert peer.call("/planner/depart_later").message == "departure 1 at 2026-07-15 07:00"
    peer.wait_until(lambda: len(plans) == 3, what="a plan for the departure as it was")
    assert plans[2]["charge"] == first["charge"]
    peer.wait_until(lambda: battery.get_subscription_count() > 0, what="a listener of the battery")
    battery.publish(BatteryState(percentage=0.9, cell_temperature=[30.0, 32.0]))
    peer.wait_until(lambda: len(plans) == 4, what="a plan from the measured battery")
    assert (plans[3]["charge"][0], plans[3]["pack_c"][0]) == (0.9, 31.0)
    peer.wait_until(
        lambda: status_values(statuses[-1])["battery"] == "measured", what="battery in the status"
    )
    assert float(status_values(statuses[-1])["planning_s"]) > 0.0
    assert planner.stop() == 0


def test_a_killed_planner_leaves_its_last_plan_with_its_age(
    launcher: Any, peer: Any, plans: list[dict[str, Any]]
) -> None:
    planner = started(launcher)
    peer.wait_until(lambda: plans, what="the first plan")
    planner.send(signal.SIGKILL)
    assert planner.wait() == -signal.SIGKILL
    made = datetime.fromisoformat(plans[-1]["made"].replace("Z", "+00:00"))
    assert 0.0 <= (datetime.now(timezone.utc) - made).total_seconds() < 600.0
    assert len(plans[-1]["charge"]) == 193
    started(launcher)
    peer.wait_until(lambda: len(plans) == 2, what="the plan of the next planner")


def test_a_charge_out_of_reach_is_a_warning(
    launcher: Any, peer: Any, plans: list[dict[str, Any]], tmp_path: Path
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace(
        "charger_kw: 7.4\nweather", "charger_kw: 0\nweather"
    )
    week = tmp_path / "week.yaml"
    week.write_text(text.replace("charge: 0.3,", "charge: 0.9,"), encoding="utf-8")
    statuses = peer.statuses("/planner")
    started(launcher, week)
    peer.wait_until(
        lambda: plans and statuses and statuses[-1].message == OUT_OF_REACH, what="the first plan"
    )
    assert "not charged; asked for: 90.0 %" in status_values(statuses[-1])["missed"]
    assert plans[0]["missed"][0]["departure"] == 1


def test_a_plan_is_recorded_and_replayed(
    launcher: Any,
    peer: Any,
    plans: list[dict[str, Any]],
    wait_until: Callable[..., None],
    tmp_path: Path,
) -> None:
    planner = started(launcher)
    peer.wait_until(lambda: plans, what="the first plan")
    bag = tmp_path / "bag"
    recorder = launcher.start_module(
        "iptm_ros.recording.recorder_cli", bag, "--topics", f"/{PLAN_TOPIC}", "--time", "wall"
    )
    wait_until(lambda: "recorder ready" in recorder.stdout, what="recorder ready")
    assert peer.call("/planner/depart_earlier").success
    peer.wait_until(lambda: len(plans) == 2, what="the second plan")

    def recorded() -> list[str]:
        return [
            str(file)
            for file in bag.glob("*.mcap")
            if file.stat().st_size > len(json.dumps(plans[1]))
        ]

    peer.wait_until(recorded, what="the plan in the bag")
    assert recorder.stop() == 0
    assert planner.stop() == 0
    with BagReader(bag) as reader:
        assert reader.topics[f"/{PLAN_TOPIC}"].message_count >= 1
    launcher.start_module("iptm_bags.player_cli", bag, "--wait-for-subscribers", "1")
    peer.wait_until(lambda: len(plans) >= 3, what="the replayed plan")
    assert plans[-1] in plans[:2]


def test_a_file_that_is_refused_is_one_line(refused: Callable[..., str], tmp_path: Path) -> None:
    assert "parameter week is empty" in refused("iptm_plan.node")
    line = refused("iptm_plan.node", parameters={"week": str(tmp_path / "none.yaml")})
    assert "none.yaml: no such file" in line
