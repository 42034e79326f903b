"""Parameters of the injector, and the names of the topics on both sides of it.

True values keep their names for recorders and viewers: the plant's topics, and `v2x/leader` and
`v2x/leader_preview` of the effective leader. The faulty inputs of controller and bridge have their own names,
to which these inputs are remapped, and so have the bridge's outputs for the leader of the route.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ScenarioError
from iptm_faults.fault import Fault, faults_from


@dataclass(frozen=True)
class FaultSettings(Settings):
    """The faults of a run as one text, as a parameter can hold them."""

    faults: str = parameter("[]", "list of faults as JSON, keys as in a scenario file")

    def listed(self) -> tuple[Fault, ...]:
        """Return the faults.

        Raises:
            ScenarioError: the text is not a list of faults.
        """
        try:
            entries = json.loads(self.faults)
        except ValueError as error:
            raise ScenarioError(f"faults are not valid JSON: {error}; allowed: a list") from None
        return faults_from(entries, "parameter faults")


@dataclass(frozen=True)
class InjectorNodeParameters(FaultSettings):
    """Parameters of the injector."""

    expected_peers: int = parameter(
        0, "subscribers of v2x/leader_preview to wait for before anything is passed on", "", 0, 100
    )


def faulty_name(topic: str) -> str:
    """Return the name of a topic with faults applied, as its receiver subscribes to it."""
    return "faults/faulty/" + topic.lstrip("/")


def route_name(topic: str) -> str:
    """Return the name under which the bridge publishes a topic of the route's leader."""
    return "faults/route/" + topic.lstrip("/")
