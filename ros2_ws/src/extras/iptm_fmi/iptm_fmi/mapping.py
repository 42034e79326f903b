"""Which variables of a foreign FMU are what: a YAML file beside it, or the names of the suite's plant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from iptm_core.errors import ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.user_input import shown, suggestion

INPUTS = {
    "acceleration_command_m_s2": ("acceleration_command", "m/s2"),
    "compressor_command_w": ("compressor_power_command", "W"),
    "slope_rad": ("slope", "rad"),
}
"""What a plant is given, with its name in the plant of the suite and its unit."""
STATES = {
    "position_m": ("position", "m"),
    "speed_m_s": ("speed", "m/s"),
    "acceleration_m_s2": ("acceleration", "m/s2"),
    "compressor_power_w": ("compressor_power", "W"),
    "cell_1_temperature_k": ("cell_1_temperature", "K"),
    "cell_n_temperature_k": ("cell_n_temperature", "K"),
    "cell_1_capacity_loss": ("cell_1_capacity_loss", "1"),
    "cell_n_capacity_loss": ("cell_n_capacity_loss", "1"),
    "state_of_charge": ("state_of_charge", "1"),
}
ENERGIES = {
    "traction_energy_j": ("traction_energy", "J"),
    "battery_energy_j": ("battery_energy", "J"),
    "chiller_heat_j": ("chiller_heat", "J"),
    "battery_heat_j": ("battery_heat", "J"),
}
"""Sums since the start."""
ENDS = {
    "pack_current_a": ("pack_current", "A"),
    "pack_voltage_v": ("pack_voltage", "V"),
    "coolant_inlet_k": ("coolant_inlet", "K"),
    "coolant_outlet_k": ("coolant_outlet", "K"),
}
OUTPUTS = {**STATES, **ENERGIES, **ENDS}
NEEDED = ("acceleration_command_m_s2", "position_m", "speed_m_s")
HEAT = "battery_heat_w"
"""An FMU with this input is a thermal part."""
THERMAL_INPUTS = (HEAT, "compressor_command_w", "ambient_k", "vehicle_speed_m_s")
THERMAL_OUTPUTS = (
    "cell_1_temperature_k",
    "cell_n_temperature_k",
    "compressor_power_w",
    "chiller_heat_j",
    "coolant_inlet_k",
    "coolant_outlet_k",
)
THERMAL_NEEDED = (HEAT, "cell_1_temperature_k", "cell_n_temperature_k")
_KEYS = ("name", "unit", "factor", "offset")


@dataclass(frozen=True)
class Mapped:
    """A variable of an FMU: its value times the factor plus the offset is in the unit of the suite.

    Attributes:
        unit: that the FMU has to state for it; empty where it states none.
    """

    name: str
    unit: str = ""
    factor: float = 1.0
    offset: float = 0.0

    def from_fmu(self, value: float) -> float:
        """Return a value of the FMU in the unit of the suite."""
        return self.factor * value + self.offset

    def to_fmu(self, value: float) -> float:
        """Return a value of the suite in the unit of the FMU."""
        return (value - self.offset) / self.factor


@dataclass(frozen=True)
class VariableMap:
    """Variables of an FMU by what they are."""

    inputs: Mapping[str, Mapped] = field(default_factory=dict)
    outputs: Mapping[str, Mapped] = field(default_factory=dict)

    @property
    def is_thermal(self) -> bool:
        """Whether the FMU is a thermal part of the suite's own vehicle."""
        return HEAT in self.inputs


def read_mapping(path: Path) -> VariableMap | None:
    """Read the mapping beside an FMU; None where there is no such file.

    Raises:
        ScenarioError: it cannot be used.
    """
    beside = path.with_suffix(".yaml")
    if not beside.is_file():
        return None
    content = read_yaml(beside, ScenarioError)
    if not isinstance(content, dict) or not {*content} <= {"inputs", "outputs"}:
        raise ScenarioError(f"{beside} has other keys; allowed: inputs, outputs")
    found = VariableMap(
        _entries(beside, content.get("inputs"), dict.fromkeys((*INPUTS, *THERMAL_INPUTS))),
        _entries(beside, content.get("outputs"), OUTPUTS),
    )
    needed, allowed = NEEDED, (*INPUTS, *OUTPUTS)
    if found.is_thermal:
        needed, allowed = THERMAL_NEEDED, (*THERMAL_INPUTS, *THERMAL_OUTPUTS)
    mapped = {**found.inputs, **found.outputs}
    lacking = [name for name in needed if name not in mapped]
    if lacking:
        raise ScenarioError(f"{beside} maps nothing to {lacking[0]}; needed: {', '.join(needed)}")
    further = [name for name in mapped if name not in allowed]
    if further:
        what = "thermal part" if found.is_thermal else "vehicle"
        raise ScenarioError(
            f"{beside} maps {further[0]}; allowed for a {what}: {', '.join(allowed)}"
        )
    return found


def default_mapping(names: Mapping[str, str]) -> VariableMap:
    """Return the mapping of an FMU that has the names of the plant of the suite.

    Args:
        names: units of its variables by name.

    Raises:
        ScenarioError: it lacks what every plant needs.
    """
    inputs = {key: Mapped(*row) for key, row in INPUTS.items() if row[0] in names}
    outputs = {key: Mapped(*row) for key, row in OUTPUTS.items() if row[0] in names}
    lacking = [key for key in NEEDED if key not in {**inputs, **outputs}]
    if lacking:
        row = {**INPUTS, **OUTPUTS}[lacking[0]]
        raise ScenarioError(
            f"the FMU has no variable {row[0]!r}; allowed: a .yaml file beside it that maps its variables"
        )
    return VariableMap(inputs, outputs)


def check_units(mapping: VariableMap, units: Mapping[str, str]) -> None:
    """Compare a mapping with the variables of an FMU.

    Args:
        units: that the FMU states, by name of the variable; empty for none.

    Raises:
        ScenarioError: a variable does not exist, or has another unit, or a unit is stated nowhere.
    """
    for what, mapped in {**mapping.inputs, **mapping.outputs}.items():
        if mapped.name not in units:
            raise ScenarioError(
                f"{what} is mapped to {mapped.name!r}; {suggestion(mapped.name, units)}"
            )
        stated = units[mapped.name]
        if not (stated or mapped.unit):
            raise ScenarioError(
                f"{mapped.name} has no unit in the FMU; allowed: a unit in the mapping of {what}"
            )
        if stated and mapped.unit and stated != mapped.unit:
            raise ScenarioError(
                f"{mapped.name} is in {stated!r} in the FMU, in {mapped.unit!r} in the mapping of {what}"
            )


def _entries(path: Path, given: Any, known: Mapping[str, object]) -> dict[str, Mapped]:
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise ScenarioError(f"{path} has {shown(given)} for a table; allowed: names with variables")
    found = {}
    for what, entry in given.items():
        if what not in known:
            raise ScenarioError(f"{path} names {what!r}; {suggestion(str(what), known)}")
        row = {"name": entry} if isinstance(entry, str) else entry
        if not isinstance(row, dict) or "name" not in row or not {*row} <= {*_KEYS}:
            raise ScenarioError(
                f"{path}: {what} is {shown(entry)}; allowed: a name, or {', '.join(_KEYS)}"
            )
        numbers = {key: row[key] for key in ("factor", "offset") if key in row}
        for key, value in numbers.items():
            if not isinstance(value, int | float) or not math.isfinite(value):
                raise ScenarioError(f"{path}: {key} of {what} is {shown(value)}; allowed: numbers")
        if numbers.get("factor", 1.0) == 0.0:
            raise ScenarioError(f"{path}: factor of {what} is 0; allowed: other numbers")
        found[what] = Mapped(str(row["name"]), str(row.get("unit", "")), **numbers)
    return found
