"""Runs of a parked car in a climate, and measured motions as drive files, the cycles of runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.horizon import SINGLE_HORIZON
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.state import FloatArray
from iptm_studies.run_spec import RunSpec

DEFAULT, REFERENCE, PRODUCTION = "default", "reference", "production"
_CONTROLLER = ControllerSettings()
STRATEGIES = {
    DEFAULT: (_CONTROLLER.strategy, _CONTROLLER.horizon),
    REFERENCE: ("reference", str(SINGLE_HORIZON)),
    PRODUCTION: ("production", _CONTROLLER.horizon),
}
"""Strategy and grid by the role in the tables; the production-like one has no grid."""
LANDING_M_S2 = 1.0
"""Deceleration at the end of a part of a drive."""
STANDING_S = 5.0


def climate(ambient_c: float) -> dict[str, float]:
    """Return the parameters of a car that was parked outside: its cells have the temperature of the air."""
    names = ("ambient_temperature_k", "initial_cell_temperature_k")
    return {f"environment.{name}": ambient_c + CELSIUS_ZERO_K for name in names}


def drive(
    role: str,
    car: str,
    ambient_c: float,
    *,
    cycle: str,
    overrides: Mapping[str, float] | None = None,
    **settings: Any,
) -> RunSpec:
    """Return a run of a car that was parked outside.

    Args:
        role: one of `STRATEGIES`.
        car: name of its parameter set.
        ambient_c: temperature of the air in degC.
        cycle: driving cycle.
        overrides: further parameters that differ.
        settings: of the run, as in `RunSpec`.
    """
    strategy, horizon = STRATEGIES[role]
    return RunSpec(
        cycle=cycle,
        parameter_set=car,
        overrides=tuple({**climate(ambient_c), **(overrides or {})}.items()),
        strategy=strategy_by_name(strategy),
        horizon=horizon,
        **settings,
    )


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
