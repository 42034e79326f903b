"""Parameters of the controller node, what is built from them, and their changes while it drives.

Strategy, weights and the cost on arrival are numbers of a problem: a change is checked, and holds from the
next decision on.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_msgs.msg import String

from iptm_controller.controller import MpcController
from iptm_controller.decision import ControllerMemory
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import COST_TERMS
from iptm_core.declaration import Scalar, parameter, plain
from iptm_core.errors import IptmError, MessageError, ParameterError
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain
from iptm_core.settings import FrameSettings, ModelSettings, SamplingSettings
from iptm_core.state import NS_PER_S
from iptm_core.user_input import StrictMapping
from iptm_ros.diagnostics import CHANGED_SETTINGS, SETTINGS_SINCE
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

CONTROLLER_STATE = "controller"
_OF_A_STATE = ("horizon", "parameter_set", "overrides", "period_s")
CHANGEABLE = ("strategy", *COST_TERMS)
"""Parameters that may be set while the node runs."""
OF_ARRIVAL = ("arrival_cost_eur", "electricity_eur_kwh")
"""Settings that `vehicle/arrival_cost` changes; bags have the topic, so that a check repeats the change."""
ARRIVAL_COST = "arrival_cost"


@dataclass(frozen=True)
class ControllerNodeParameters(FrameSettings, SamplingSettings, ModelSettings, ControllerSettings):
    """Parameters of the node: its groups, the last of the bases first, and its own."""

    trip_duration_s: float = parameter(
        0.0,
        "trip time at which the trip ends, from navigation; 0 if unknown. The cost to go "
        "excludes aging after it",
        "s",
        0.0,
        1e7,
    )
    state_folder: str = parameter(
        "states", "folder for the service controller/save_state, made when it is needed"
    )
    start_state: str = parameter(
        "",
        "file of the service controller/save_state, for a trip that starts from a saved state of the plant",
    )

    def saved_state(self, stamp_ns: int, memory: ControllerMemory) -> SavedState:
        """Return what a file needs to hold to decide on from a tick."""
        return SavedState(CONTROLLER_STATE, stamp_ns, self._kept(), to_plain(memory))

    def start_memories(self) -> dict[int, ControllerMemory]:
        """Return the initial memory of the controller, by the trip time of the start (ns)."""
        memories = {0: ControllerMemory()}
        if self.start_state:
            saved = read_state(Path(self.start_state), CONTROLLER_STATE, self._kept())
            memories[saved.stamp_ns] = from_plain(ControllerMemory, saved.state)
        return memories

    def _kept(self) -> dict[str, Scalar]:
        """Return the settings that a memory depends on."""
        return {name: plain(getattr(self, name)) for name in _OF_A_STATE}

    def controller_options(self) -> ControllerOptions:
        """Return what the controller is to do."""
        return self.options(self.period_s, self.trip_duration_s or math.inf)

    def build_controller(self) -> MpcController:
        """Return the controller, its problem compiled."""
        return MpcController(self.model().values, self.controller_options())


class SettingsChanges:
    """Takes changes of strategy and weights.

    Attributes:
        options: settings that the decisions are made with.
        values: key values for the diagnostics.
    """

    def __init__(self, node: SuiteNode, options: ControllerNodeParameters) -> None:
        self.options = self._wanted = options
        self.values: dict[str, object] = {
            CHANGED_SETTINGS: "none",
            SETTINGS_SINCE: "start",
            ARRIVAL_COST: "of the settings",
        }
        self._logger = node.get_logger()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._note)

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse all that is asked for in one sentence, or nothing of it."""
        try:
            self._options_of(self._changed(parameters))
        except IptmError as error:
            return SetParametersResult(successful=False, reason=" ".join(str(error).split()))
        return SetParametersResult(successful=True)

    def _note(self, parameters: Sequence[Parameter]) -> None:
        self._wanted = self._changed(parameters)

    def _changed(self, parameters: Sequence[Parameter]) -> ControllerNodeParameters:
        changes = {each.name: each.value for each in parameters if each.name in CHANGEABLE}
        return replace(self._wanted, **changes)

    def on_arrival_cost(self, message: String) -> None:
        """Take the prices of `vehicle/arrival_cost`.

        Raises:
            MessageError: they are not usable; the last ones stay.
        """
        try:
            given = StrictMapping(json.loads(message.data), Topic.ARRIVAL_COST.value, OF_ARRIVAL)
            wanted = replace(
                self._wanted,
                arrival_cost_eur=given.text("arrival_cost_eur"),
                electricity_eur_kwh=given.number("electricity_eur_kwh"),
            )
            options = self._options_of(wanted)
            if options.arrival is not None and math.isinf(options.trip_duration_s):
                raise ParameterError("the trip has no known end; allowed: trips with one")
        except (ValueError, IptmError) as error:
            reason = " ".join(str(error).split())
            raise MessageError(f"{Topic.ARRIVAL_COST.value}: {reason}") from None
        self._wanted = wanted
        self.values[ARRIVAL_COST] = Topic.ARRIVAL_COST.value

    def _options_of(self, wanted: ControllerNodeParameters) -> ControllerOptions:
        """Return the options of changed settings.

        Raises:
            IptmError: a value is not usable, or the ageing law of the cost is another one.
        """
        options = wanted.controller_options()
        if options.law is not self._wanted.controller_options().law:
            raise ParameterError(
                f"strategy is '{options.strategy.name}', whose cost has another ageing law; allowed while "
                "a trip is driven: strategies with the same law"
            )
        return options

    def take_over(self, controller: MpcController, stamp_ns: int) -> bool:
        """Let a controller decide from a tick on with what has been set; return whether that is new."""
        before, self.options = self.options, self._wanted
        difference = ", ".join(
            f"{name}={plain(getattr(self.options, name))} (was {plain(getattr(before, name))})"
            for name in CHANGEABLE
            if getattr(self.options, name) != getattr(before, name)
        )
        if self.options != before:
            controller.use_costs(self.options.controller_options())
        if difference:
            since = f"{stamp_ns / NS_PER_S:.9g}"
            self.values |= {CHANGED_SETTINGS: difference, SETTINGS_SINCE: since}
            self._logger.info(f"from {since} s on: {difference}")
        return bool(difference)
