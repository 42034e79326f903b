import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "mcap",
    "numpy",
    "pyarrow",
    "pyyaml",
    "rich",
    "rosbags",
    "zstandard",
    programs={
        "recorder": "iptm_recording.recorder_cli:main",
        "player": "iptm_recording.player_cli:main",
        "recover_bag": "iptm_recording.recover:main",
        "bag_info": "iptm_recording.bag_info:main",
        "export": "iptm_recording.export:main",
        "compare_bags": "iptm_recording.compare_bags:main",
    },
)
