"""Modules of the nodes that a trip with faults over ROS 2 starts, by name; see `iptm.runner.composition`."""

from iptm_ros.topics import CONTROLLER, PLANT

INJECTOR = "iptm_faults.node"
"""Between the nodes, where a fault acts on topics."""
NODES = {CONTROLLER: "iptm_faults.node_controller", PLANT: "iptm_faults.node_plant"}
"""In place of the sound nodes, where a fault is inside of one."""
