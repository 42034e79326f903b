"""The plant as a node, with faults of its actuators; all else is as in the plant node."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from iptm.faults.fault import FaultSettings
from iptm.faults.injection import FaultyPlant, faulty
from iptm_plant_sim.node import PlantNode
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_plant_sim.plant_kinds import plant_kind
from iptm_ros.command_line import node_main
from iptm_ros.topics import PLANT


@dataclass(frozen=True)
class FaultyPlantNodeParameters(FaultSettings, PlantNodeParameters):
    """Parameters of the plant, and the faults of its actuators."""

    def build_plant(self, *arguments: Any) -> FaultyPlant:
        """Return the vehicle with its faults; see the sound one."""
        return faulty(plant_kind(self.plant))(self.listed(), *arguments)


class FaultyPlantNode(PlantNode):
    """The plant whose actuators are late or weak while a fault lasts."""

    PARAMETERS = FaultyPlantNodeParameters


def main() -> None:
    """Run the node."""
    sys.exit(node_main(PLANT, FaultyPlantNode, FaultyPlantNodeParameters))


if __name__ == "__main__":
    main()
