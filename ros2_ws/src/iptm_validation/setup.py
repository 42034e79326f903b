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
    "scipy",
    programs={"validate": "iptm_validation.cli:main"},
)
