"""Parameters of the controller node, what is built from them, and their changes while it drives.

A change is checked, prepared in another thread, then applied. Weights and strategy are numbers of a problem
and hold from the next decision on. Another horizon or deadline is another problem, which a thread builds and
compiles while the node goes on with the present one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from time import perf_counter

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from iptm_controller.controller import Controller
from iptm_controller.decision import ControllerMemory
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import COST_TERMS
from iptm_core.declaration import Scalar, parameter, plain
from iptm_core.errors import IptmError, ParameterError
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain
from iptm_core.settings import FrameSettings, ModelSettings, SamplingSettings
from iptm_core.state import NS_PER_S
from iptm_ros.diagnostics import CHANGED_SETTINGS, SETTINGS_SINCE
from iptm_ros.suite_node import SuiteNode

CONTROLLER_STATE = "controller"
_OF_A_STATE = ("horizon", "parameter_set", "overrides", "period_s")
CHANGEABLE = ("strategy", "horizon", *COST_TERMS, "deadline_ms")
"""Parameters that may be set while the node runs."""


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

    def build_controller(self) -> Controller:
        """Return the controller, its problem compiled."""
        return Controller(self.model().values, self.controller_options())


_NUMBERS_OF_A_PROBLEM = ("strategy", *COST_TERMS)


class SettingsChanges:
    """Takes one change after the other.

    Attributes:
        options: settings that the decisions are made with.
        values: key values for the diagnostics.
    """

    def __init__(self, node: SuiteNode, options: ControllerNodeParameters) -> None:
        self.options = self._wanted = options
        self.values: dict[str, object] = {CHANGED_SETTINGS: "none", SETTINGS_SINCE: "start"}
        self._node = node
        self._prepared: Future[tuple[Controller, float]] | None = None
        self._is_giving_up = False
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._prepare)

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse all that is asked for in one sentence, or nothing of it."""
        changes = {each.name: each.value for each in parameters if each.name in CHANGEABLE}
        if not changes or self._is_giving_up:
            return SetParametersResult(successful=True)
        try:
            if self._prepared is not None:
                raise ParameterError(
                    f"another change ({self._difference()}) is being prepared; allowed: one at a time"
                )
            wanted = replace(self._wanted, **changes)
            wanted.controller_options()
        except IptmError as error:
            return SetParametersResult(successful=False, reason=" ".join(str(error).split()))
        return SetParametersResult(successful=True)

    def _prepare(self, parameters: Sequence[Parameter]) -> None:
        changes = {each.name: each.value for each in parameters if each.name in CHANGEABLE}
        if self._is_giving_up or not changes:
            return
        self._wanted = replace(self._wanted, **changes)
        different = set(self._different())
        if not different.issubset(_NUMBERS_OF_A_PROBLEM):
            self._node.get_logger().info(f"prepares {self._difference()}")
            self._prepared = Future()
            # A daemon, so that the node can stop without waiting for a compiler.
            Thread(target=_build, args=(self._wanted, self._prepared), daemon=True).start()

    def take_over(self, controller: Controller, stamp_ns: int) -> Controller:
        """Return the controller to decide a tick with: the present one, or the one that is ready now."""
        if self._wanted == self.options:
            return controller
        if self._prepared is None or not self._prepared.done():
            # A horizon in preparation does not delay the numbers.
            numbers = {name: getattr(self._wanted, name) for name in _NUMBERS_OF_A_PROBLEM}
            options = replace(self.options, **numbers)
            if options != self.options:
                controller.use_strategy(options.controller_options().strategy)
                self._note(options, stamp_ns, "")
            return controller
        prepared, self._prepared = self._prepared, None
        try:
            ready, took_s = prepared.result()
        except Exception as error:  # noqa: BLE001  whatever it is, the car must be driven on
            self._give_up(error)
            return controller
        memory = controller.memory
        if self._wanted.horizon != self.options.horizon:
            # A plan on another grid cannot start this one.
            memory = replace(memory, last_plan=None)
        ready.memory = memory
        self._note(self._wanted, stamp_ns, f", prepared in {took_s:.2g} s")
        return ready

    def _note(self, options: ControllerNodeParameters, stamp_ns: int, how: str) -> None:
        since = f"{stamp_ns / NS_PER_S:.9g}"
        difference = self._difference(options)
        self.values = {CHANGED_SETTINGS: difference, SETTINGS_SINCE: since}
        self._node.get_logger().info(f"from {since} s on: {difference}{how}")
        self.options = options

    def _give_up(self, error: Exception) -> None:
        """Keep the present settings, and restore the parameters."""
        self._node.get_logger().error(f"{self._difference()} cannot be prepared: {error}")
        back = [Parameter(name, value=getattr(self.options, name)) for name in self._different()]
        self._wanted = self.options
        self._is_giving_up = True
        try:
            self._node.set_parameters_atomically(back)
        finally:
            self._is_giving_up = False

    def _different(self, wanted: ControllerNodeParameters | None = None) -> list[str]:
        wanted = wanted or self._wanted
        return [name for name in CHANGEABLE if getattr(wanted, name) != getattr(self.options, name)]

    def _difference(self, wanted: ControllerNodeParameters | None = None) -> str:
        wanted = wanted or self._wanted
        return ", ".join(
            f"{name}={plain(getattr(wanted, name))} (was {plain(getattr(self.options, name))})"
            for name in self._different(wanted)
        )


def _build(options: ControllerNodeParameters, prepared: Future[tuple[Controller, float]]) -> None:
    started_s = perf_counter()
    try:
        controller = options.build_controller()
    except Exception as error:  # noqa: BLE001  handed to the node, which goes on as it is
        prepared.set_exception(error)
    else:
        prepared.set_result((controller, perf_counter() - started_s))
