"""Parameters of the controller node and what is built from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from iptm_controller.controller import Controller
from iptm_controller.estimator import NoiseSettings
from iptm_controller.horizon import Horizon
from iptm_controller.memory import ControllerMemory
from iptm_controller.node_watch import WarningSettings
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings, SolveSettings
from iptm_controller.solvers.interface import SolverOptions
from iptm_controller.strategy import COST_TERMS, MAX_WEIGHT, Strategy, strategy_by_name
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.declaration import Scalar, Settings, parameter, plain
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain
from iptm_core.settings import FrameSettings, ModelSettings, SamplingSettings

FROM_STRATEGY = -1.0
CONTROLLER_STATE = "controller"
_OF_A_STATE = ("horizon", "parameter_set", "parameter_overrides", "period_s")
WEIGHTS = {term.parameter: field for field, term in COST_TERMS.items()}
"""Fields of `Strategy` by the parameter that sets them."""
CHANGEABLE = ("strategy", "horizon", *WEIGHTS, "deadline_ms")
"""Parameters that may be set while the node runs."""

if TYPE_CHECKING:

    class _WeightSettings(Settings):
        """One parameter for the weight of every cost term."""

else:
    _WeightSettings = make_dataclass(
        "_WeightSettings",
        [
            (
                term.parameter,
                "float",
                parameter(
                    FROM_STRATEGY,
                    f"{term.symbol}, weight of {term.name}: {term.meaning}; -1 takes that of the strategy",
                    term.unit,
                    -1.0,
                    MAX_WEIGHT,
                ),
            )
            for term in COST_TERMS.values()
        ],
        bases=(Settings,),
        frozen=True,
    )


@dataclass(frozen=True)
class ControllerNodeParameters(
    _WeightSettings,
    FrameSettings,
    NoiseSettings,
    WarningSettings,
    SamplingSettings,
    ModelSettings,
    SolveSettings,
    AgingSettings,
    ChargingStopSettings,
    ControllerSettings,
):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    deadline_ms: float = parameter(
        0.0,
        "wall time of one solve at most, 0 for none; runs with a deadline are not exactly repeatable",
        "ms",
        0.0,
        60000.0,
    )
    trip_duration_s: float = parameter(
        0.0,
        "trip time at which the trip ends, from navigation; 0 if unknown. The cost to go "
        "excludes aging after it",
        "s",
        0.0,
        1e7,
    )
    max_preview_age_s: float = parameter(
        ControllerOptions.max_preview_age_s,
        "older previews are not used; the leader's measured motion is then extrapolated",
        "s",
        0.0,
        1e4,
    )
    shifted_plan_ticks: int = parameter(
        ControllerOptions.shifted_plan_ticks,
        "ticks that the last plan may be driven on after a failed solve",
        "",
        0,
        1000,
    )
    safe_law_ticks: int = parameter(
        ControllerOptions.safe_law_ticks,
        "ticks of the safe car-following law before the controlled stop",
        "",
        0,
        100000,
    )
    input_timeout_s: float = parameter(
        2.0,
        "time after which a tick with missing inputs is answered all the same; wall time, or trip time where "
        "that runs faster and the plant does not wait",
        "s",
        0.05,
        60.0,
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
        return ControllerOptions(
            strategy=self._strategy(),
            horizon=Horizon.parse(self.horizon),
            solver=SolverOptions(
                name=self.solver,
                compile_code=self.compile_code,
                max_iterations=self.max_iterations,
                deadline_s=1e-3 * self.deadline_ms,
                tolerance=self.tolerance,
            ),
            shifted_plan_ticks=self.shifted_plan_ticks,
            safe_law_ticks=self.safe_law_ticks,
            max_preview_age_s=self.max_preview_age_s,
            tick_s=self.period_s,
            trip_duration_s=self.trip_duration_s or math.inf,
            noise=NoiseSettings.of(self),
            aging=AgingSettings.of(self),
            charging_stop=ChargingStopSettings.of(self),
        )

    def build_controller(self) -> Controller:
        """Return the controller, its problem compiled."""
        return Controller(self.model().values, self.controller_options())

    def _strategy(self) -> Strategy:
        given = {weight: getattr(self, name) for name, weight in WEIGHTS.items()}
        chosen = {weight: value for weight, value in given.items() if value != FROM_STRATEGY}
        return replace(strategy_by_name(self.strategy), **chosen)
