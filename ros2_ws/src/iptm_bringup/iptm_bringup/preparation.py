"""Checks that the parts of a scenario fit together, before any process is started."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from iptm_bringup.scenario import Scenario
from iptm_controller.horizon import Horizon
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters import ParameterSet
from iptm_core.routes import Route
from iptm_core.settings import LoopMode

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class PreparedScenario:
    """A scenario whose parts have been built once, so that they are known to be sound.

    Attributes:
        scenario: what was asked for.
        model: the vehicle.
        route: leader, road and length of the trip.
    """

    scenario: Scenario
    model: ParameterSet
    route: Route

    @property
    def is_lock_step(self) -> bool:
        """Whether trip time waits for the controller."""
        return self.scenario.mode is LoopMode.LOCK_STEP


def prepare(scenario: Scenario) -> PreparedScenario:
    """Build the parts of a scenario.

    Args:
        scenario: types and ranges checked already.

    Raises:
        ScenarioError: a part cannot be built: unknown cycle, malformed horizon, contradictory
            parameters or namespace.
    """

    def part(keys: str, build: Callable[[], T]) -> T:
        try:
            return build()
        except IptmError as error:
            raise ScenarioError(f"scenario {scenario.name}: {keys}: {error}") from None

    parameters = part("parameter_set, parameter_overrides", scenario.model)
    initial_gap_m = parameters.values.gap.initial_gap_m
    route = part("cycle, slope", lambda: scenario.trip_route(initial_gap_m))
    part("horizon", lambda: Horizon.parse(scenario.horizon))
    part("namespace", lambda: _check_namespace(scenario.full_namespace))
    return PreparedScenario(scenario, parameters, route)


def _check_namespace(namespace: str) -> None:
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        reason = " ".join(str(error).split("\n")[0].split())
        raise ScenarioError(
            f"{reason}; allowed: letters, digits and _, parts joined by /"
        ) from None
