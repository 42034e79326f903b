import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "numpy",
    "rosbags",
    programs={"call": "iptm_interfaces.call:main", "param": "iptm_interfaces.param:main"},
)
