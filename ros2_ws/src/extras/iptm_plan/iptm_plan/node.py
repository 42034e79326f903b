"""The node `planner`: a latched plan of the parked hours, and two services that move the next departure.

The plan is JSON in a `std_msgs/String`, as `iptm plan --json` writes it, with the instant at which it was
made. What the battery topic of the car measures is where the next plan begins. The cost of the temperature on
the next arrival, of a trip under way or ahead, is on the latched topic `vehicle/arrival_cost`, where the
controller takes it. When the node ends, listeners keep the last plan with its age, and the controller the
last cost.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from iptm_core.declaration import parameter
from iptm_core.errors import IptmError, ParameterError
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plan.course import Course
from iptm_plan.day_plan import DayPlan
from iptm_plan.profile import missed_charges, plan_data, trip_settings
from iptm_plan.week_file import Week, changed_departure, read_week, week_from
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.parameters import declare_parameters
from iptm_ros.publishers import LATCHED_QOS
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

NAME = "planner"
PLAN_TOPIC = f"{NAME}/plan"
EARLIER, LATER = "~/depart_earlier", "~/depart_later"
PLANNED = "a plan is published"
OUT_OF_REACH = "a charge that is asked for is out of reach"
NOT_PLANNED = "the departure cannot be moved"
REPLAN_PERIOD_S = 900.0
_CHANGED, _CHANGED_K = 0.03, 3.0
"""Difference between measured and planned state that is planned for at once."""


@dataclass(frozen=True)
class PlannerParameters:
    """What the node is started with."""

    week: str = parameter("", "path of the file with departures, weather, tariff and car")
    move_min: float = parameter(
        15.0, "by how much a service moves the next departure", "min", 15.0, 720.0
    )


class PlannerNode(SuiteNode):
    """Plans at the start, when a departure moves, when the battery is not as planned, and every 15 min."""

    def __init__(self, **options: Any) -> None:
        """Plan for the first time.

        Raises:
            IptmError: the file is refused.
        """
        super().__init__(NAME, **options)
        given = declare_parameters(self, PlannerParameters)
        if not given.week:
            raise ParameterError(
                "parameter week is empty; allowed: the path of a file for iptm plan"
            )
        self._move = timedelta(minutes=given.move_min)
        self._week: Week = read_week(Path(given.week))
        self._battery: tuple[float, float] | None = None
        self._values: dict[str, object] = {}
        self._level, self._reason = Level.OK, PLANNED
        self._publisher = self.create_publisher(String, PLAN_TOPIC, LATCHED_QOS)
        self._arrival_publisher = self.advertise(Topic.ARRIVAL_COST)
        self._reporter = DiagnosticsReporter.of_node(self, NAME)
        self._replan(self._week)
        self.create_service(Trigger, EARLIER, self._mover(-1))
        self.create_service(Trigger, LATER, self._mover(1))
        self.listen(Topic.PLANT_BATTERY, self._on_battery)
        self.every(REPLAN_PERIOD_S, lambda: self._replan(self._week))
        self.every(REPORT_PERIOD_S, self._report)

    def _mover(self, sign: int) -> Callable[[Any, Any], Any]:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = False, NOT_PLANNED
            self.guard(NAME, self._move_next, sign, response)
            return response

        return answer

    def _move_next(self, sign: int, response: Trigger.Response) -> None:
        """Move the next departure, and plan."""
        number = self._next_departure()
        try:
            departures = self._week.schedule.departures
            if number > len(departures):
                raise ParameterError("no departure is ahead; allowed: a file with a later one")
            at = self._week.local(departures[number - 1].step) + sign * self._move
            moved = changed_departure(self._week, number, at)
            self._replan(moved)
        except IptmError as error:
            response.message = " ".join(str(error).split())
            return
        self._week = moved
        response.success = True
        response.message = f"departure {number} at {at:%Y-%m-%d %H:%M}"

    def _next_departure(self) -> int:
        """Return the number of the first departure that is not over."""
        now = self._week.within(datetime.now(timezone.utc))
        return 1 + sum(self._week.local(each.step) < now for each in self._week.schedule.departures)

    def _on_battery(self, message: BatteryState) -> None:
        charge = float(message.percentage)
        cells_c = [float(each) for each in message.cell_temperature if math.isfinite(each)]
        if not (0.0 <= charge <= 1.0 and cells_c):
            return
        kelvin = sum(cells_c) / len(cells_c) + CELSIUS_ZERO_K
        last = self._battery or (self._week.charge, self._week.kelvin)
        self._battery = charge, kelvin
        if abs(charge - last[0]) > _CHANGED or abs(kelvin - last[1]) > _CHANGED_K:
            self._replan(self._week)
        else:
            self._battery = last

    def _replan(self, week: Week) -> None:
        """Plan from now on, and publish.

        Raises:
            IptmError: the hours do not fit together.
        """
        began_s = time.perf_counter()
        if self._battery is not None:
            week = replace(week, charge=self._battery[0], kelvin=self._battery[1])
        now = datetime.now(timezone.utc)
        week = week_from(week, now)
        plan = DayPlan(week.schedule, week.pack, week.price)
        course = plan.course(week.charge, week.kelvin)
        data = {"made": f"{now:%Y-%m-%dT%H:%M:%SZ}", **plan_data(week, plan, course)}
        self._publisher.publish(String(data=json.dumps(data)))
        arrivals = [each for each in plan.worth(course) if not each.is_departure]
        if (
            self._week.begin <= now < week.begin
        ):  # a trip is under way, behind which the plan begins
            arrivals.insert(0, plan.worth_at_first(week.charge, week.kelvin))
        if arrivals:
            priced = trip_settings(week, plan, arrivals[0])
            self._arrival_publisher.publish(String(data=json.dumps(priced)))
        self._note(week, course, time.perf_counter() - began_s)

    def _note(self, week: Week, course: Course, took_s: float) -> None:
        missed = missed_charges(week, course)
        self._level = Level.WARN if missed else Level.OK
        self._reason = OUT_OF_REACH if missed else PLANNED
        departures = week.schedule.departures
        self._values = {
            "missed": "; ".join(missed) or "none",
            "next_departure": f"{week.local(departures[0].step):%a %H:%M}"
            if departures
            else "none",
            "energy_kwh": course.grid_kwh,
            "energy_eur": course.energy_eur,
            "aging_eur": course.aging_eur,
            "planning_s": took_s,
            "battery": "of the file" if self._battery is None else "measured",
        }
        self._report()

    def _report(self) -> None:
        self._reporter.report(0, self._level, self._reason, lambda: self._values)


def main() -> None:
    """Run the node."""
    sys.exit(node_main("planner", PlannerNode, PlannerParameters))


if __name__ == "__main__":
    main()
