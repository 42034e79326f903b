"""A scenario: what one closed-loop run is made of, as data.

Every field of `Scenario` that is a declared parameter is also an option of the command line and a key of
scenario files; `parameter_specs(Scenario)` lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from iptm_controller.settings import ControllerSettings
from iptm_core.declaration import Scalar, Settings, parameter, parameter_specs
from iptm_core.settings import (
    ModelSettings,
    PaceSettings,
    PreviewSettings,
    RoadSettings,
    TripSettings,
)

AUTOMATIC_DOMAIN = -1
MAX_DOMAIN = 232

PLANT = "plant"
BRIDGE = "v2x_bridge"
CONTROLLER = "controller"

SETTINGS_OF_NODES: Mapping[str, tuple[type[Settings], ...]] = {
    PLANT: (TripSettings, ModelSettings, PaceSettings),
    BRIDGE: (RoadSettings, PreviewSettings),
    CONTROLLER: (ControllerSettings, ModelSettings),
}
"""Which settings of a scenario each node of the loop takes, as parameters of the same names."""

NODES = tuple(SETTINGS_OF_NODES)
"""Names of the nodes of the loop; extra parameters in a scenario are grouped by them."""

_NO_PARAMETERS: Mapping[str, Mapping[str, Scalar]] = MappingProxyType({})


@dataclass(frozen=True)
class Scenario(PaceSettings, PreviewSettings, ControllerSettings, ModelSettings, TripSettings):
    """What is driven, by whom, under which conditions; ranges and units are in the declarations.

    Attributes:
        name: short name, also that of the run's folder.
        description: one line for lists.
        node_parameters: further parameters by node (one of `NODES`) and name; the nodes check them.
    """

    name: str = "custom"
    description: str = ""
    namespace: str = parameter("", "namespace of all nodes, e.g. car_1; empty for none")
    domain: int = parameter(
        AUTOMATIC_DOMAIN,
        "ROS domain of the run; -1 takes ROS_DOMAIN_ID, or a free one where that is not set",
        "",
        AUTOMATIC_DOMAIN,
        MAX_DOMAIN,
    )
    node_parameters: Mapping[str, Mapping[str, Scalar]] = field(
        default_factory=lambda: _NO_PARAMETERS
    )

    @property
    def full_namespace(self) -> str:
        """Namespace as ROS writes it, with a leading slash; ``/`` for none."""
        return "/" + self.namespace.strip("/")


def names_for(node: str) -> tuple[str, ...]:
    """Return the settings of a scenario that a node takes."""
    return tuple(spec.name for group in SETTINGS_OF_NODES[node] for spec in parameter_specs(group))
