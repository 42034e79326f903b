"""Objects in place of names in a trip: a car of one's own, a drive, a strategy."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.settings import FROM_STRATEGY
from iptm_controller.strategy import COST_TERMS, STRATEGIES, Strategy, strategy_by_name
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters import (
    DEFAULT_SET,
    ModelParameters,
    field_specs,
    load_parameters,
    to_flat_dict,
)
from iptm_core.parameters.catalogue import FITTED_CAR, cells, pack_entries
from iptm_core.parameters.loading import belonging_notes
from iptm_core.routes.comprehensive import RouteComposition
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.user_trip import UserTrip
from iptm_core.user_input import StrictMapping, check_known, shown

_LAYOUT = re.compile(r"(\d{1,3})s(\d{1,3})p")


@dataclass(frozen=True, init=False)
class Vehicle:
    """A car of one's own, for ``vehicle=`` of `simulate`, `sweep` and `Trip`.

        iptm.Vehicle("volkswagen_id4", mass_kg=2200, cell="lg_e78", pack="96s3p")

    A cell brings its resistance in the cold, heat capacity and voltage along, and a pack its heat transfer to
    the coolant and the air and its constants of ageing; the car keeps its chiller.

    Attributes:
        name: car or parameter set by name (`available_parameter_sets`), or the path of a .yaml file.
        overrides: parameters in which it differs from that, by dotted key.
    """

    name: str
    overrides: Mapping[str, float]

    def __init__(
        self,
        name: str = DEFAULT_SET,
        *,
        cell: str | None = None,
        pack: str | None = None,
        **parameters: float,
    ) -> None:
        """Put the car together.

        Args:
            name: see the attributes.
            cell: by name, see `cell_names`; None keeps the car's.
            pack: cells in series and parallel, such as ``96s3p``; None keeps the car's, or with another cell
                its cells in series and about its energy.
            parameters: in the unit of the model, by the last part of their key, such as ``mass_kg``.

        Raises:
            ParameterError: a name or a value is not allowed.
        """
        model = load_parameters(name).values
        overrides: dict[str, float] = {}
        if cell is not None:
            check_known(cell, cells(), "vehicle", "cell")
            own, layout = cells()[cell], model.pack
            series, parallel = layout.cells_in_series, layout.parallel
            parallel = max(1, round(parallel * model.cell.nominal_capacity_ah / own.capacity_ah))
            if pack is not None:
                series, parallel = _layout(pack)
            modules = math.gcd(series, layout.modules)
            i3, paper = load_parameters(FITTED_CAR).values, load_parameters().values
            entries = pack_entries(own, modules, series, parallel, i3, paper)
            overrides = {key: entry.value for key, entry in entries.items()}
        elif pack is not None:
            raise ParameterError(f"pack is {shown(pack)} without a cell; allowed: with cell=")
        for short, value in parameters.items():
            check_known(short, _keys(), "vehicle", "parameter")
            overrides[_keys()[short]] = value
        object.__setattr__(self, "name", str(name))
        object.__setattr__(self, "overrides", overrides)
        load_parameters(self.name, overrides)

    @property
    def notes(self) -> tuple[str, ...]:
        """Parameters that were changed without their neighbours."""
        return tuple(belonging_notes(load_parameters(self.name, self.overrides)))


def cell_names() -> tuple[str, ...]:
    """Names of the cells for `Vehicle`."""
    return tuple(cells())


def _layout(pack: Any) -> tuple[int, int]:
    found = _LAYOUT.fullmatch(pack) if isinstance(pack, str) else None
    if found is None:
        raise ParameterError(f"pack is {shown(pack)}; allowed: such as '96s3p'")
    return int(found[1]), int(found[2])


@cache
def _keys() -> Mapping[str, str]:
    """Dotted keys by their last part, which is different for every parameter."""
    return {key.rpartition(".")[2]: key for key in field_specs()}


_BASE = "base"
_OWN_DRIVE = "own drive"
_REFERENCE = "reference_temperature_k"


def flat_settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of a trip with objects replaced by what they stand for.

    Args:
        given: settings by name. ``cycle`` may be a path, a table of columns, a pair of times (s) and speeds
            (m/s) or a `DrivingCycle`; ``strategy`` a `Strategy` or a mapping of ``base`` and weights;
            ``vehicle`` an `iptm.Vehicle`, a parameter set by name or path, `ModelParameters` or a mapping of
            parameters, and ``base`` for a set other than the default. It sets ``parameter_set`` and
            ``overrides``; stated overrides come after it.

    Raises:
        IptmError: a value is not usable; the message states the value and the allowed ones.
    """
    settings = {key: _plain(value) for key, value in given.items()}
    if "cycle" in settings:
        settings |= _drive(settings["cycle"])
    if "strategy" in settings:
        settings |= _strategy(settings["strategy"])
    if settings.get("vehicle") is not None:
        parameter_set, changes = _vehicle(settings.pop("vehicle"))
        over = settings.get("overrides") or {}
        settings["parameter_set"] = parameter_set
        if changes and not isinstance(over, Mapping):
            raise ParameterError(
                f"overrides is {shown(over)} beside a vehicle with parameters; allowed: a mapping"
            )
        settings["overrides"] = {**changes, **over} if changes else over
    settings.pop("vehicle", None)
    overrides = settings.get("overrides")
    if not isinstance(overrides, (Mapping, str, type(None))):
        raise ParameterError(
            f"overrides is {shown(overrides)}; allowed: a mapping of key and number"
        )
    return settings


def _plain(value: Any) -> Any:
    """Return a number of NumPy's as a plain one."""
    return value.item() if isinstance(value, np.generic) else value


def _drive(cycle: Any) -> dict[str, Any]:
    """Return the name of a cycle, and the drive itself where it is neither a name nor a file."""
    if isinstance(cycle, (str, Path)):
        return {"cycle": str(cycle)}
    if isinstance(cycle, (UserTrip, RouteComposition)):
        return {"cycle": _OWN_DRIVE, "own_drive": cycle}
    if isinstance(cycle, DrivingCycle):
        return {"cycle": cycle.name, "own_drive": UserTrip(cycle, None)}
    if hasattr(cycle, "to_numpy") and hasattr(cycle, "columns"):
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
    from iptm_core.routes.user_csv import trip_from_columns  # noqa: PLC0415

    return {"cycle": _OWN_DRIVE, "own_drive": trip_from_columns(columns, _OWN_DRIVE)}


def _strategy(given: Any) -> dict[str, Any]:
    """Return the settings of a strategy: the name of a shipped one, and the weights in which it differs."""
    if isinstance(given, str):
        return {"strategy": strategy_by_name(given).name}
    if isinstance(given, Mapping):
        names = (_BASE, *COST_TERMS, _REFERENCE, "cost_to_go")
        written = StrictMapping(given, "strategy", names, error=ParameterError)
        base = strategy_by_name(written.text(_BASE))
        given = replace(base, **{key: given[key] for key in written if key != _BASE})
    if not isinstance(given, Strategy):
        raise ParameterError(
            f"strategy is {shown(given)}; allowed: a name, iptm.Strategy, or a mapping of base and weights"
        )
    kind = (given.cost_to_go, given.rules)
    alike = [each for each in STRATEGIES.values() if (each.cost_to_go, each.rules) == kind]
    base = STRATEGIES.get(given.name, alike[-1])
    base = base if base in alike else alike[-1]
    stated = {
        key: getattr(given, key) if getattr(given, key) != getattr(base, key) else FROM_STRATEGY
        for key in (*COST_TERMS, _REFERENCE)
    }
    return {"strategy": base.name, **stated}


def _vehicle(vehicle: Any) -> tuple[str, dict[str, Any]]:
    """Return a parameter set and what differs from it."""
    if isinstance(vehicle, (str, Path)):
        return str(vehicle), {}
    if isinstance(vehicle, Vehicle):
        return vehicle.name, dict(vehicle.overrides)
    if isinstance(vehicle, ModelParameters):
        usual = to_flat_dict(load_parameters().values)
        flat = to_flat_dict(vehicle)
        return DEFAULT_SET, {key: flat[key] for key in flat if flat[key] != usual[key]}
    if isinstance(vehicle, Mapping):
        content = dict(vehicle)
        return str(content.pop(_BASE, DEFAULT_SET)), dict(_flat(content))
    raise ParameterError(
        f"vehicle is {shown(vehicle)}; allowed: iptm.Vehicle, a parameter set, the path of a .yaml file, or a"
        " mapping of parameters"
    )


def _flat(content: Mapping[Any, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and numbers of ``{"body": {"mass_kg": 1600}}`` and ``{"body.mass_kg": 1600}``."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{group}{key}.")
        else:
            yield f"{group}{key}", _plain(value)
