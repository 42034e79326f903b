import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "numpy",
    "pyyaml",
    "rosbags",
    programs={"visualize": "iptm_view.visualizer_node:main"},
    # Both are loaded only where they are used; the page works without.
    extras={"foxglove": ["foxglove-sdk>=0.30"], "screenshot": ["playwright>=1.40"]},
)
