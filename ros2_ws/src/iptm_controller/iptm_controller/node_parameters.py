"""Parameters of the controller node and what is built from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from iptm_controller.controller import Controller
from iptm_controller.memory import ControllerMemory
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import COST_TERMS
from iptm_core.declaration import Scalar, parameter, plain
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain
from iptm_core.settings import FrameSettings, ModelSettings, SamplingSettings

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
