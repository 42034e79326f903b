"""One parameter file read into checked entries, before it is laid over its base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from iptm_core.errors import ParameterError
from iptm_core.parameters.chiller_table import (
    COEFFICIENT_KEYS,
    TABLE_ENTRIES,
    ChillerTable,
    parse_chiller_table,
)
from iptm_core.parameters.flat import (
    FILE_TAGS,
    FieldSpec,
    Source,
    SourceTag,
    checked_number,
    field_specs,
)
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.strict_mapping import StrictMapping, check_known, shown

TABLE_NAME = "by_ambient_temperature"
_HEADINGS = ("description", "base")


@dataclass(frozen=True)
class Layer:
    """What one file states.

    Attributes:
        origin: the file.
        description: one line about the set, may be empty.
        base: name or path of the set that this one differs from, or None.
        entries: dotted key -> value as written, each already checked.
        chiller_table: coefficients over ambient temperature, or None.
    """

    origin: str
    description: str
    base: str | None
    entries: Mapping[str, Source]
    chiller_table: ChillerTable | None


def read_layer(path: Path) -> Layer:
    """Read one parameter file.

    Args:
        path: a YAML file with the groups of the model, optional ``description`` and ``base``.

    Returns:
        Its checked entries; a file with a base need not state every parameter.

    Raises:
        ParameterError: for everything that is wrong in the file, with the dotted key and value.
    """
    origin = str(path)
    groups = dict.fromkeys(key.split(".")[0] for key in field_specs())
    document = StrictMapping(
        read_yaml(path), origin, (*groups, *_HEADINGS), kind="group", error=ParameterError
    )
    entries: dict[str, Source] = {}
    table: ChillerTable | None = None
    for name in document:
        if name in _HEADINGS:
            continue
        for field, entry in document.section(name, kind="parameter").content.items():
            key = f"{name}.{field}"
            if key == f"chiller.{TABLE_NAME}":
                table = _read_table(entry, origin)
                continue
            check_known(key, field_specs(), origin, "parameter")
            entries[key] = _read_entry(entry, field_specs()[key], origin)
    _check_single_chiller(entries, table, origin)
    return Layer(
        origin=origin,
        description=document.text("description", ""),
        base=document.text("base") if "base" in document else None,
        entries=entries,
        chiller_table=table,
    )


def _read_entry(entry: object, spec: FieldSpec, origin: str) -> Source:
    where = f"{origin}: {spec.key}"
    if not isinstance(entry, Mapping):
        raise ParameterError(
            f"{where} is {shown(entry)}; allowed: {{value: ..., unit: {spec.unit}, source: ...}}, "
            f"{spec.allowed}"
        )
    written = StrictMapping(
        entry, where, ("value", "unit", "source", "note"), kind="entry", error=ParameterError
    )
    written.require("value", "unit", allowed=f"{spec.unit}, {spec.allowed}")
    unit = written.text("unit")
    checked_number(entry["value"], spec, origin, unit)
    return Source(
        value=entry["value"], unit=unit, tag=_read_tag(written), note=written.text("note", "")
    )


def _read_table(entry: object, origin: str) -> ChillerTable:
    where = f"{origin}: chiller.{TABLE_NAME}"
    written = StrictMapping(entry, where, TABLE_ENTRIES, kind="entry", error=ParameterError)
    return parse_chiller_table(written, _read_tag(written), written.text("note", ""), origin)


def _read_tag(written: StrictMapping) -> SourceTag:
    return SourceTag(written.choice("source", [tag.value for tag in FILE_TAGS]))


def _check_single_chiller(
    entries: Mapping[str, Source], table: ChillerTable | None, origin: str
) -> None:
    stated = [key for key in COEFFICIENT_KEYS if key in entries]
    if table is not None and stated:
        raise ParameterError(
            f"{origin}: {', '.join(stated)} and chiller.{TABLE_NAME} both state the chiller; "
            "allowed: one of the two in one file"
        )
