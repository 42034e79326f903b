"""JSON schemas of trips and vehicles for editors, from the declarations of their settings."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.trip_settings import GROUPS, HOME, SPECS
from iptm_core.declaration import ParameterSpec, parameter_specs, plain
from iptm_core.parameters import available_parameter_sets
from iptm_core.parameters.flat import SourceTag, allowed_numbers, field_specs

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}
_NUMBERS = {"type": "object", "additionalProperties": {"type": "number"}}


def trip_schema() -> str:
    """Return the schema of a trip as JSON."""
    faults = {spec.name: _value(spec) for spec in parameter_specs(Fault)}
    faults["kind"] = {"enum": [kind.value for kind in FaultKind]}
    faults["size"] = {"type": "number"}
    groups: dict[str, Any] = {}
    for group in GROUPS:
        values = {name: _value(spec) for name, spec in SPECS.items() if HOME[name] == group}
        groups[group] = _closed(values)
    groups["conditions"]["properties"]["faults"] = {
        "type": "array",
        "items": {**_closed(faults), "required": ["kind"]},
    }
    return _text("A trip of iptm", _closed({"description": {"type": "string"}, **groups}))


def vehicle_schema() -> str:
    """Return the schema of a vehicle, a parameter set that states what differs, as JSON."""
    groups: dict[str, dict[str, Any]] = {}
    for key, spec in field_specs().items():
        group, _, name = key.partition(".")
        # A value may have another unit than the model, so its range is words.
        groups.setdefault(group, {})[name] = {
            "type": "object",
            "description": f"{spec.symbol}: {allowed_numbers(spec)}",
            "properties": {
                "value": {"type": "number"},
                "unit": {"type": "string"},
                "source": {
                    "enum": [tag.value for tag in SourceTag if tag is not SourceTag.OVERRIDE]
                },
                "note": {"type": "string"},
            },
            "required": ["value", "unit", "source"],
            "additionalProperties": False,
        }
    groups["chiller"]["by_ambient_temperature"] = {"type": "object"}
    closed = {group: _closed(names) for group, names in groups.items()}
    heads: Mapping[str, Any] = {
        "description": {"type": "string"},
        "base": {"anyOf": [{"enum": list(available_parameter_sets())}, {"type": "string"}]},
        "refused_without": {"type": "object"},
    }
    return _text("A vehicle of iptm", _closed({**heads, **closed}))


def _value(spec: ParameterSpec) -> dict[str, Any]:
    """Return the schema of a setting."""
    found: dict[str, Any] = {"type": _TYPES[spec.kind]}
    if spec.choices and not spec.suffixes:
        found["enum"] = list(spec.choices)
    if spec.minimum > -math.inf:
        found["minimum"] = spec.minimum
    if spec.maximum < math.inf:
        found["maximum"] = spec.maximum
    if spec.name.endswith("overrides"):
        found = {"anyOf": [found, _NUMBERS]}
    if spec.optional:
        found = {"anyOf": [found, {"type": "null"}]}
    if not spec.required and not spec.optional:
        found["default"] = plain(spec.default)
    unit = f" [{spec.unit}]" if spec.unit else ""
    return {**found, "description": f"{spec.description}{unit}"}


def _closed(properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": dict(properties), "additionalProperties": False}


def _text(title: str, schema: Mapping[str, Any]) -> str:
    return json.dumps({"$schema": _DIALECT, "title": title, **schema}, indent=1) + "\n"
