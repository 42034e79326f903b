import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "numpy",
    "rich",
    programs={"traffic": "iptm_traffic.cli:main"},
    # SUMO is an extra, see requirements/traffic.txt.
    extras={"traffic": ["eclipse-sumo>=1.20", "traci>=1.20"]},
)
