"""Parameters of the injector, and the form in which a node is given faults."""

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
