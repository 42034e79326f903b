import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare("casadi", "numpy", programs={"plant": "iptm_plant_sim.node:main"})
