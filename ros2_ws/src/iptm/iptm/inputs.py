"""What a user passes to `simulate`, as name, file or object, turned into the inputs of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from iptm.faults.fault import Fault, plain_faults
from iptm.studies.run_spec import RunSpec
from iptm.studies.study import Case, planned_run
from iptm.studies.study_loading import build_spec
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import STRATEGIES, Strategy
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.declaration import plain
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters import DEFAULT_SET, ModelParameters, load_parameters, to_flat_dict
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.user_csv import UserTrip, trip_from_columns
from iptm_core.user_input import shown

_BASE = "base"
_OWN_DRIVE = "own drive"


def run_inputs(
    cycle: Any, strategy: Any, vehicle: Any, overrides: Any, settings: Mapping[str, Any]
) -> Case:
    """Return the inputs of a run.

    Args:
        cycle: name, path, table of columns, pair of times and speeds, or a `DrivingCycle`.
        strategy: name, `Strategy`, or mapping of ``base`` and weights.
        vehicle: parameter set by name or path, mapping, or `ModelParameters`.
        overrides: single parameters that differ, by dotted key.
        settings: further keys of a run specification.

    Raises:
        IptmError: a value is not usable; the message states the value and what is allowed.
    """
    drive, name = _drive(cycle)
    parameter_set, changes = _vehicle(vehicle)
    if overrides is not None and not isinstance(overrides, Mapping):
        raise ParameterError(
            f"overrides is {shown(overrides)}; allowed: a mapping of key and number"
        )
    changes |= overrides or {}
    given = {
        "strategy": ControllerSettings.strategy,
        "horizon": ControllerSettings.horizon,
        "solver": ControllerSettings.solver,
        **settings,
        "cycle": name,
        "parameter_set": parameter_set,
        "overrides": {key: _number(value) for key, value in changes.items()},
    }
    # The solver of a run specification is a section, of which the defaults are the controller's.
    if "solver" not in settings:
        del given["solver"]
    elif isinstance(given["solver"], str):
        given["solver"] = {"name": given["solver"]}
    if isinstance(strategy, (str, Mapping)):
        given["strategy"] = strategy if isinstance(strategy, str) else dict(strategy)
    elif not isinstance(strategy, Strategy):
        raise ParameterError(
            f"strategy is {shown(strategy)}; allowed: a name, iptm.Strategy, or a mapping of base and weights"
        )
    faults = settings.get("faults", ())
    if not isinstance(faults, (tuple, list)) or not all(isinstance(each, Fault) for each in faults):
        raise ParameterError(
            f"faults is {shown(faults)}; allowed: a tuple of iptm.faults.fault.Fault"
        )
    spec = build_spec(given, Path())
    if isinstance(strategy, Strategy):
        spec = spec.with_strategy(strategy)
    return planned_run(spec, drive=drive)


def settings_of(spec: RunSpec) -> dict[str, Any]:
    """Return the choices of a run by the names that scenarios use; parameters are not among them."""
    weights = asdict(spec.strategy)
    name = weights.pop("name")
    return {
        "cycle": spec.cycle,
        "slope": spec.slope,
        "duration_s": spec.duration_s or 0.0,
        "strategy": name,
        **({} if STRATEGIES.get(name) == spec.strategy else weights),
        "horizon": spec.horizon,
        "solver": spec.solver,
        **asdict(AgingSettings.of(spec)),
        **asdict(ChargingStopSettings.of(spec)),
        **{key: plain(value) for key, value in asdict(spec.bridge_settings()).items()},
        "period_s": spec.tick_s,
        "integration_step_s": spec.plant_step_s,
        "thermal_model": plain(spec.thermal_model),
        **{f"controller: {key}": value for key, value in spec.controller_overrides},
        **({"faults": str(plain_faults(spec.faults))} if spec.faults else {}),
    }


def _drive(cycle: Any) -> tuple[UserTrip | None, str]:
    """Return a drive that is neither a name nor a file, and the name of the cycle."""
    if isinstance(cycle, (str, Path)):
        return None, str(cycle)
    if isinstance(cycle, DrivingCycle):
        return UserTrip(cycle, None), cycle.name
    if isinstance(cycle, pd.DataFrame):
        index = cycle.index.name
        cycle = cycle.reset_index() if index is not None and index not in cycle else cycle
        columns = {str(name): cycle[name].to_numpy() for name in cycle}
    elif isinstance(cycle, Mapping):
        columns = {str(name): values for name, values in cycle.items()}
    elif isinstance(cycle, (tuple, list)) and len(cycle) == 2 and np.ndim(cycle[0]) == 1:
        columns = {"time_s": cycle[0], "speed_m_s": cycle[1]}
    else:
        raise RouteError(
            f"cycle is {shown(cycle)}; allowed: a name, a path, a DataFrame or mapping with time_s and a"
            " speed, or times in s and speeds in m/s"
        )
    return trip_from_columns(columns, _OWN_DRIVE), _OWN_DRIVE


def _vehicle(vehicle: Any) -> tuple[str, dict[str, Any]]:
    """Return a parameter set and what differs from it."""
    if isinstance(vehicle, (str, Path)):
        return str(vehicle), {}
    if isinstance(vehicle, ModelParameters):
        usual = to_flat_dict(load_parameters().values)
        flat = to_flat_dict(vehicle)
        return DEFAULT_SET, {key: flat[key] for key in flat if flat[key] != usual[key]}
    if isinstance(vehicle, Mapping):
        content = dict(vehicle)
        return str(content.pop(_BASE, DEFAULT_SET)), dict(_flat(content))
    raise ParameterError(
        f"vehicle is {shown(vehicle)}; allowed: a parameter set, the path of a .yaml file, or a mapping of"
        " parameters"
    )


def _flat(content: Mapping[Any, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and numbers of ``{"body": {"mass_kg": 1600}}`` and ``{"body.mass_kg": 1600}``."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{group}{key}.")
        else:
            yield f"{group}{key}", value


def _number(value: Any) -> Any:
    """Return a number of NumPy's as a plain one; all else is left to the strict reader."""
    return value.item() if isinstance(value, np.generic) else value
