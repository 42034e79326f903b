import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "numpy",
    programs={
        "injector": "iptm_faults.node:main",
        "controller_with_solver_faults": "iptm_faults.node_controller:main",
        "plant_with_actuator_faults": "iptm_faults.node_plant:main",
    },
)
