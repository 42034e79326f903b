"""What is to be driven in traffic, and its preparation: network, vehicles, and a rehearsal of their paths."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from iptm_controller.settings import ControllerSettings
from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_traffic.demand import (
    BEFORE_TRIP_S,
    DemandSettings,
    TrafficScenario,
    signal_offsets_s,
    write_demand,
)
from iptm_traffic.network import CYCLE_S, Corridor, build_network
from iptm_traffic.own_network import OwnNetwork, build_own_network
from iptm_traffic.radio import Rehearsed, rehearse
from iptm_traffic.simulation import TrafficSimulation

LONGEST_S = 4 * 3600.0
MOST_STEPS = 10
_REHEARSED_BEYOND_S = 60.0


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
        signals_by_radio: signals and speed limits come from roadside stations only.
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


@contextmanager
def opened_traffic(
    drive: TrafficDrive, parameters: ModelParameters, fcd: Path | None = None
) -> Iterator[tuple[TrafficSimulation, dict[str, Rehearsed] | None]]:
    """Provide the traffic of a drive at trip time 0, and what its vehicles will do if they announce paths.

    Raises:
        IptmError: SUMO is not installed or fails.
    """
    with tempfile.TemporaryDirectory(prefix="iptm_traffic_") as name:
        folder, demand, rehearsal = Path(name), None, None
        if drive.own is not None:
            network = build_own_network(drive.own, drive.step_s, folder)
        else:
            corridor = Corridor.long_enough_for(drive.duration_s)
            offsets = signal_offsets_s(corridor, drive.scenario, drive.demand, CYCLE_S)
            network = build_network(corridor, folder, offsets, BEFORE_TRIP_S)

            def written(*, with_stand_in: bool) -> Path:
                return write_demand(
                    corridor,
                    drive.scenario,
                    drive.demand,
                    drive.duration_s,
                    parameters.gap.initial_gap_m,
                    drive.step_s,
                    folder,
                    with_stand_in=with_stand_in,
                )

            if drive.knowledge is PredictionInput.PATH:
                demand = written(with_stand_in=True)
                rehearsed = TrafficSimulation(network, demand, drive.step_s, with_ego=False)
                with closing(rehearsed):
                    rehearsal = rehearse(rehearsed, drive.duration_s + _REHEARSED_BEYOND_S)
            demand = written(with_stand_in=False)
        with closing(TrafficSimulation(network, demand, drive.step_s, fcd=fcd)) as simulation:
            yield simulation, rehearsal
