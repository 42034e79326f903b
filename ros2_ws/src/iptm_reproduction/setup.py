import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare(
    "cma",
    "jinja2",
    "matplotlib",
    "numpy",
    "pandas",
    "pyyaml",
    "rich",
    programs={
        "identify": "iptm_reproduction.identification.cli:main",
        "reproduce": "iptm_reproduction.cli:main",
    },
)
