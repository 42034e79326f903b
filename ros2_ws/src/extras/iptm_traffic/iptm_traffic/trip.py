"""What is to be driven in traffic."""

from __future__ import annotations

from dataclasses import dataclass, field

from iptm_controller.settings import ControllerSettings
from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_traffic.demand import DemandSettings, TrafficScenario
from iptm_traffic.network import LONGEST_TRIP_S
from iptm_traffic.own_network import OwnNetwork

LONGEST_S = 4 * 3600.0
MOST_STEPS = 10


class PredictionInput(TextEnum):
    """Input of the prediction of the leader's motion."""

    PATH = "path"
    """The path announced in its messages."""
    HISTORY = "history"
    """Its past motion."""
    SIGNALS = "signals"
    """Its past motion, with the signals and speed limits that bound it, and the ego vehicle's own lines."""


@dataclass(frozen=True)
class TrafficDrive:
    """What is to be driven.

    Attributes:
        scenario: what happens around the ego vehicle.
        knowledge: input of the leader's prediction.
        duration_s: length of the trip.
        strategy: the controller's; the reference plans on the paper's single horizon.
        demand: how much traffic there is.
        step_s: step of SUMO and period of the messages.
        signals_by_radio: signals come from roadside stations only.
        own: a network of the user's own; None for the corridor with its demand.

    Raises:
        ScenarioError: the trip is not a whole number of seconds, or a second not one of steps, or an own
            network is to have what only the corridor has.
    """

    scenario: TrafficScenario = TrafficScenario.FOLLOWING
    knowledge: PredictionInput = PredictionInput.HISTORY
    duration_s: float = 600.0
    strategy: str = ControllerSettings.strategy
    demand: DemandSettings = field(default_factory=DemandSettings)
    step_s: float = 0.5
    signals_by_radio: bool = False
    own: OwnNetwork | None = None

    def __post_init__(self) -> None:
        if not 1.0 <= self.duration_s <= LONGEST_S or self.duration_s % 1.0:
            raise ScenarioError(
                f"duration_s is {self.duration_s:g}; allowed: whole numbers from 1 to {LONGEST_S:g} s"
            )
        steps = 1.0 / self.step_s if self.step_s > 0.0 else 0.0
        if not 1.0 <= steps <= MOST_STEPS or abs(steps - round(steps)) > 1e-9:
            raise ScenarioError(
                f"step_s is {self.step_s:g}; allowed: 1 s divided by a whole number up to {MOST_STEPS}"
            )
        if self.own is None:
            if self.duration_s > LONGEST_TRIP_S:
                most = f"{LONGEST_TRIP_S:.0f} s at most"
                raise ScenarioError(
                    f"duration_s is {self.duration_s:g} on the corridor; allowed: {most}"
                )
            return
        if self.knowledge is PredictionInput.PATH or self.signals_by_radio:
            raise ScenarioError(
                "an own network lacks paths and roadside stations; allowed: prediction history or signals"
            )
        if self.scenario is not TrafficScenario.FOLLOWING or self.demand != DemandSettings():
            raise ScenarioError(
                "an own network has traffic of its own; allowed: no scenario and no settings of the traffic"
            )

    @property
    def title(self) -> str:
        """Name of the scenario or of the network."""
        return str(self.scenario) if self.own is None else self.own.net.name
