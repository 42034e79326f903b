"""Measured motions written as drive files, the cycles of runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from iptm_core.state import FloatArray

LANDING_M_S2 = 1.0
"""Deceleration at the end of a part of a drive."""
STANDING_S = 5.0


def write_drive(
    path: Path, step_s: float, speeds_m_s: FloatArray, slopes_rad: FloatArray | None = None
) -> Path:
    """Write speeds at equal steps, and a halt at the end: a route has its lead vehicle stand there.

    A file that has this content already is left alone.

    Args:
        path: of the CSV file.
        step_s: sampling interval.
        speeds_m_s: speeds, shape (n,), not negative.
        slopes_rad: slopes of the road where the vehicle was, shape (n,); None for a level road.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
    """
    columns = {"time_s": step_s * np.arange(speeds_m_s.size), "speed_m_s": speeds_m_s}
    if slopes_rad is not None:
        columns["slope_rad"] = slopes_rad
    if speeds_m_s[-1] > 0.0:
        halt_s = float(columns["time_s"][-1] + np.ceil(speeds_m_s[-1] / LANDING_M_S2))
        end = {"time_s": [halt_s, halt_s + STANDING_S], "speed_m_s": [0.0, 0.0]}
        columns = {
            name: np.append(values, end.get(name, [values[-1]] * 2))
            for name, values in columns.items()
        }
    formats = {"time_s": ".3f", "speed_m_s": ".4f", "slope_rad": ".6f"}
    lines = [
        ",".join(f"{value:{formats[name]}}" for name, value in zip(columns, row, strict=True))
        for row in zip(*columns.values(), strict=True)
    ]
    text = "\n".join((",".join(columns), *lines)) + "\n"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return path
