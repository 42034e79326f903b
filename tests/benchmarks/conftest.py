"""The benchmarks are no installed package: put the root of the tree where they are found."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
