import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
from iptm_setup import declare

declare("matplotlib", "numpy", "pandas", "rich", programs={"compare": "iptm.compare_cli:main"})
