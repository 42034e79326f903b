import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "asn1tools",
    "numpy",
    programs={"bridge": "iptm_v2x_bridge.node:main", "sender": "iptm_v2x_bridge.node_sender:main"},
)
