"""The controller as a node, with a solver that fails on demand; all else is as in the controller node."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from iptm.faults.fault import FaultSettings
from iptm.faults.injection import FaultyController
from iptm_controller.node import ControllerNode
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_ros.command_line import node_main
from iptm_ros.topics import CONTROLLER


@dataclass(frozen=True)
class FaultyControllerNodeParameters(FaultSettings, ControllerNodeParameters):
    """Parameters of the controller, and the faults of its solver."""

    def build_controller(self) -> FaultyController:
        """Return the controller with a solver that fails on demand; see the sound one."""
        sound = super().build_controller()
        return FaultyController(self.model().values, sound, self.listed())


class FaultyControllerNode(ControllerNode):
    """The controller, whose solver runs out of time, raises or does not converge while a fault lasts."""

    PARAMETERS = FaultyControllerNodeParameters


def main() -> None:
    """Run the node."""
    sys.exit(node_main(CONTROLLER, FaultyControllerNode, FaultyControllerNodeParameters))


if __name__ == "__main__":
    main()
