"""What is to be driven in traffic, and what came of it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np

from iptm_controller.settings import ControllerSettings
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import TextEnum
from iptm_core.errors import ScenarioError
from iptm_core.metrics import RunMetrics
from iptm_core.trajectory import Trajectory
from iptm_traffic.demand import DemandSettings, TrafficScenario
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
    """Its past motion, with the signals and speed limits that bound it, and the host's own lines."""


@dataclass(frozen=True)
class TrafficDrive:
    """What is to be driven.

    Attributes:
        scenario: what happens around the host.
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
        """What is driven, in a word."""
        return str(self.scenario) if self.own is None else self.own.net.name


@dataclass(frozen=True, eq=False)
class TrafficFacts:
    """Results of a drive that the traffic provides, wherever plant and controller run.

    Attributes:
        smallest_gap_m: to the car ahead.
        smallest_margin_m: smallest gap less s_min behind a real car that did not just move in.
        lines_passed: stop lines passed by the host.
        lines_passed_closed: how many of them were not green.
        largest_deviation_m: how far apart SUMO and plant ever had the host.
        leaders: names of the cars ahead, in order.
        messages: messages sent around the host.
        collisions: those of the host that SUMO has noticed, one text each.
    """

    smallest_gap_m: float
    smallest_margin_m: float
    lines_passed: int
    lines_passed_closed: int
    largest_deviation_m: float
    leaders: tuple[str, ...]
    messages: int
    collisions: tuple[str, ...]

    @property
    def leader_count(self) -> int:
        """How many cars were ahead, one after the other."""
        return len(self.leaders)

    @property
    def collision_count(self) -> int:
        """How many steps the host spent in collisions."""
        return len(self.collisions)


@dataclass(frozen=True, eq=False)
class TrafficResult(TrafficFacts):
    """A finished drive.

    Attributes:
        drive: what was to be driven.
        trajectory: what happened; without a car ahead, the leader is as far as it is looked for.
        decisions: how the decisions came about.
        metrics: figures of the run.
        largest_excess_m_s: by how much the host was ever faster than the limit.
        predictors: ticks by the predictor in use.
        fallback_ticks: ticks on which the controller had no solution to follow.
        wall_time_s: wall time of the drive.
        processor_s: processor time of the drive, SUMO's included.
    """

    drive: TrafficDrive
    trajectory: Trajectory
    decisions: DecisionSeries
    metrics: RunMetrics
    largest_excess_m_s: float
    predictors: dict[str, int]
    fallback_ticks: int
    wall_time_s: float
    processor_s: float

    @property
    def times_real_time(self) -> float:
        """Trip time over wall time."""
        return self.drive.duration_s / self.wall_time_s

    @property
    def times_processor_time(self) -> float:
        """Trip time over processor time, which is the wall time on a machine with nothing else to do."""
        return self.drive.duration_s / self.processor_s

    @property
    def digest(self) -> str:
        """Digest of the trajectory, to the last bit."""
        digest = hashlib.sha256()
        for values in self.trajectory.to_arrays().values():
            digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        return digest.hexdigest()
