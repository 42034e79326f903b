"""What the numbers were measured on, without a name of the machine or a path."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import datetime, timezone
from pathlib import Path

import casadi as ca
import numpy as np

from iptm_controller.ocp.compilation import COMPILER_FLAGS, find_compiler


def machine_description() -> dict[str, str]:
    """Return processor, memory, load and versions, in readable pairs."""
    load = os.getloadavg()
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "memory": f"{_memory_gib():.0f} GiB",
        "load average at the time (1, 5, 15 min)": ", ".join(f"{value:.1f}" for value in load),
        "system": f"{platform.system()} {platform.machine()}",
        "compiler": f"{_compiler_version()}, {' '.join(COMPILER_FLAGS)}",
        "Python": platform.python_version(),
        "CasADi": ca.CasadiMeta.version(),
        "NumPy": np.__version__,
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return platform.processor() or "unknown"
    for line in text.splitlines():
        if line.startswith("model name"):
            return line.split(":", maxsplit=1)[1].strip()
    return platform.processor() or "unknown"


def _memory_gib() -> float:
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")) / 2**30


def _compiler_version() -> str:
    compiler = find_compiler()
    if compiler is None:
        return "none"
    done = subprocess.run(  # noqa: S603 - the compiler found on the user's own path
        [compiler, "-dumpfullversion"], capture_output=True, text=True, timeout=30, check=False
    )
    return f"{Path(compiler).name} {done.stdout.strip()}"
