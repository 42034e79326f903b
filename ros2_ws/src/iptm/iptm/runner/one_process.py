"""Plant, bridge and controller in one process with one executor, which saves the switches between processes.

The plant is the first node: with it, all end.
"""

import sys

from iptm_controller.node import ControllerNode
from iptm_plant_sim.node import PlantNode
from iptm_ros.process import run_nodes
from iptm_v2x_bridge.node import BridgeNode


def main() -> None:
    """Run the nodes."""
    sys.exit(run_nodes([PlantNode, BridgeNode, ControllerNode]))
