"""Plant, bridge and controller of vehicles in one process with one executor.

That saves the switches between processes. Each vehicle has a section of ROS arguments, and its nodes end with
its plant.
"""

import sys
from functools import partial

from iptm_controller.node import ControllerNode
from iptm_core.program import sections
from iptm_plant_sim.node import PlantNode
from iptm_ros.process import run_nodes
from iptm_v2x_bridge.node import BridgeNode


def main() -> None:
    """Run the nodes."""
    program, *arguments = sys.argv
    vehicles = [
        [
            partial(node, cli_args=section, use_global_arguments=False)
            for node in (PlantNode, BridgeNode, ControllerNode)
        ]
        for section in sections(arguments)
    ]
    sys.exit(run_nodes(vehicles, [program]))
