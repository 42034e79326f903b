import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "matplotlib",
    "numpy",
    "pandas",
    "pyyaml",
    "rich",
    programs={
        "drive_file": "iptm_bringup.recorded_drive:main",
        "run_closed_loop": "iptm_bringup.run_closed_loop:main",
        "run_string": "iptm_bringup.run_string:main",
        "view": "iptm_bringup.view:main",
    },
    # The launch files look for them here, as every ROS 2 package does.
    shared={
        "launch": "launch/*.launch.py",
        "config/nodes": "iptm_bringup/config/nodes/*.yaml",
        "config": "iptm_bringup/config/*.yaml",
        "config/scenarios": "iptm_bringup/config/scenarios/*.yaml",
    },
)
