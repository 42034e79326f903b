"""Facts about a run other than its messages: title, limits, and the trip for a reference car.

It comes from the parameters of the three nodes, as a bag stores them or as the nodes answer when asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.declaration import Settings, parameter_specs
from iptm_core.errors import BagError, IptmError
from iptm_core.metrics.constraints import (
    GAP_TOLERANCE_M,
    SPEED_TOLERANCE_M_S,
    TEMPERATURE_TOLERANCE_K,
)
from iptm_core.metrics.figures import FIGURES, SAVINGS
from iptm_core.parameters import ModelParameters
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.settings import (
    IntegrationSettings,
    ModelSettings,
    PreviewSettings,
    SamplingSettings,
    TripSettings,
)
from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.recording.run_information import RunInformation, stored_model_parameters
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT
from iptm_view.page_row import PAGE_COLUMNS

NodeParameters = Mapping[str, Mapping[str, Any]]
"""Parameters by node and name."""

ASKED: Mapping[str, tuple[type[Settings], ...]] = {
    PLANT: (TripSettings, ModelSettings, IntegrationSettings, SamplingSettings),
    BRIDGE: (PreviewSettings,),
}
"""Settings of the nodes that the view can make use of."""

ASKED_OF_CONTROLLER = ("strategy", "horizon")
LEADER_SOURCE, FROM_CYCLE = "leader_source", "cycle"
"""Parameter of the bridge, and its value where the leader drives the cycle: else that gives the road only."""
_OF_THE_PLANT_ALONE = (IntegrationSettings, SamplingSettings)


@dataclass(frozen=True, eq=False)
class RunFacts:
    """What is known of a run.

    Attributes:
        source: where its messages come from, in words.
        parameters: of the model; None where they are not known.
        nodes: parameters of the nodes; empty where they are not known.
        notes: what is missing, in sentences for the reader of the page.
        foxglove: address of the Foxglove server, "" without one.
        waiting: what to do while nothing is received, in sentences for the reader of the page.
        run: folder of the run; None while it takes place.
        is_complete: whether no more will become known.
    """

    source: str
    parameters: ModelParameters | None = None
    nodes: NodeParameters | None = None
    notes: tuple[str, ...] = ()
    foxglove: str = ""
    waiting: str = "Reading ..."
    run: Path | None = None
    is_complete: bool = False

    @property
    def title(self) -> str:
        """Cycle, strategy and horizon, as far as they are known."""
        nodes = self.nodes or {}
        trip, control = nodes.get(PLANT, {}), nodes.get(CONTROLLER, {})
        words = [f"cycle {Path(str(trip['cycle'])).name}"] if "cycle" in trip else []
        words += [f"{name} {control[name]}" for name in ASKED_OF_CONTROLLER[:2] if name in control]
        return ", ".join(words) or "iptm live view"

    def with_note(self, note: str) -> RunFacts:
        """Return the same facts with another sentence."""
        return self if note in self.notes else replace(self, notes=(*self.notes, note))

    def document(self) -> dict[str, Any]:
        """Return the facts as a document for the page."""
        return {
            "title": self.title,
            "source": self.source,
            "columns": list(PAGE_COLUMNS),
            "limits": _limits(self.parameters),
            "initial_capacity_loss": None
            if self.parameters is None
            else 2.0 * self.parameters.aging.initial_capacity_loss,
            "statuses": {int(status): _words(status.name) for status in SolveStatus},
            "rungs": {int(rung): _words(rung.name) for rung in Rung},
            "notes": list(self.notes),
            "foxglove": self.foxglove,
            "waiting": self.waiting,
            "definitions": {key: figure.about for key, figure in {**SAVINGS, **FIGURES}.items()},
            "duration_s": (self.nodes or {}).get(PLANT, {}).get("duration_s"),
        }

    def trip_settings(self) -> str | None:
        """Return the settings of the trip as YAML text, None where it or its leader is not known."""
        nodes = self.nodes or {}
        given = {**nodes.get(BRIDGE, {}), **nodes.get(PLANT, {})}
        names = [
            spec.name
            for groups in ASKED.values()
            for group in groups
            for spec in parameter_specs(group)
        ]
        content = {name: given[name] for name in names if name in given}
        drives_cycle = given.get(LEADER_SOURCE, FROM_CYCLE) == FROM_CYCLE
        if "cycle" not in content or "duration_s" not in content or not drives_cycle:
            return None
        text: str = yaml.safe_dump(content, sort_keys=False)
        return text


def facts_of_information(source: str, information: RunInformation) -> RunFacts:
    """Return what stands in a bag, or in the file that a recorder is given, about a run."""
    try:
        nodes = parse_yaml(information.parameters, "parameters of the run", BagError)
    except BagError:
        nodes = None
    known = {
        node: dict(given)
        for node, given in (nodes.items() if isinstance(nodes, dict) else ())
        if node in {PLANT, BRIDGE, CONTROLLER} and isinstance(given, dict)
    }
    parameters = stored_model_parameters(information)
    facts = RunFacts(source, parameters, known, is_complete=True)
    return facts if parameters is not None else facts.with_note(_NO_LIMITS)


def facts_of_nodes(source: str, nodes: NodeParameters) -> RunFacts:
    """Return the facts from the parameters of the nodes of a graph that answered."""
    is_complete = {PLANT, BRIDGE, CONTROLLER} <= nodes.keys()
    names = [spec.name for spec in parameter_specs(ModelSettings)]
    of_plant = nodes.get(PLANT, {})
    given = {name: of_plant[name] for name in names if name in of_plant}
    if len(given) < len(names):
        return RunFacts(source, None, nodes, (_NO_LIMITS,), is_complete=is_complete)
    try:
        parameters = ModelSettings(**given).model().values
    except IptmError as error:
        return RunFacts(source, None, nodes, (f"{_NO_LIMITS} ({error})",), is_complete=is_complete)
    return RunFacts(source, parameters, nodes, is_complete=is_complete)


_NO_LIMITS = "the parameters of the model are not known: limits are left out"


def _limits(parameters: ModelParameters | None) -> dict[str, float] | None:
    if parameters is None:
        return None
    limits, gap = parameters.limits, parameters.gap
    return {
        "max_gap_m": gap.max_gap_m,
        "max_speed_m_s": limits.max_speed_m_s,
        "min_temperature_c": limits.min_temperature_k - CELSIUS_ZERO_K,
        "max_temperature_c": limits.max_temperature_k - CELSIUS_ZERO_K,
        "max_compressor_power_w": limits.max_compressor_power_w,
        "gap_tolerance_m": GAP_TOLERANCE_M,
        "speed_tolerance_m_s": SPEED_TOLERANCE_M_S,
        "temperature_tolerance_k": TEMPERATURE_TOLERANCE_K,
    }


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def asked_names(node: str) -> list[str]:
    """Return the names of the parameters that the view asks a node for."""
    if node == CONTROLLER:
        return list(ASKED_OF_CONTROLLER)
    names = [spec.name for group in ASKED[node] for spec in parameter_specs(group)]
    return [*names, LEADER_SOURCE] if node == BRIDGE else names
