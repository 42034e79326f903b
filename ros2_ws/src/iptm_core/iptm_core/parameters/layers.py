"""One parameter file read into checked entries, before it is laid over its base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm_core.errors import ParameterError
from iptm_core.parameters.chiller_table import (
    COEFFICIENT_KEYS,
    ChillerTable,
    parse_chiller_table,
)
from iptm_core.parameters.flat import FieldSpec, check_known, checked_number, field_specs, shown
from iptm_core.parameters.sources import FILE_TAGS, Source, SourceTag
from iptm_core.parameters.strict_yaml import read_yaml

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
        path: a YAML file with the groups of the model, and ``description`` and ``base`` at will.

    Returns:
        Its checked entries; a file with a base need not state every parameter.

    Raises:
        ParameterError: for everything that is wrong in the file, with the dotted key and value.
    """
    origin = str(path)
    document = read_yaml(path)
    if document is None:
        raise ParameterError(f"{origin}: the file is empty; a mapping of groups is needed")
    if not isinstance(document, dict):
        raise ParameterError(f"{origin}: a mapping of groups is needed, got {shown(document)}")
    groups = dict.fromkeys(key.split(".")[0] for key in field_specs())
    entries: dict[str, Source] = {}
    table: ChillerTable | None = None
    for name, content in document.items():
        if name in _HEADINGS:
            continue
        check_known(name, (*groups, *_HEADINGS), origin, "group")
        if not isinstance(content, dict):
            raise ParameterError(
                f"{origin}: {name} = {shown(content)}: a mapping of parameters is needed"
            )
        for field, entry in content.items():
            key = f"{name}.{field}"
            if key == f"chiller.{TABLE_NAME}":
                table = _read_table(entry, origin)
                continue
            check_known(key, field_specs(), origin)
            entries[key] = _read_entry(entry, field_specs()[key], origin)
    _check_single_chiller(entries, table, origin)
    return Layer(
        origin=origin,
        description=_text(document.get("description", ""), "description", origin),
        base=_text(document["base"], "base", origin) if "base" in document else None,
        entries=entries,
        chiller_table=table,
    )


def _read_entry(entry: Any, spec: FieldSpec, origin: str) -> Source:
    where = f"{origin}: {spec.key}"
    if not isinstance(entry, dict):
        raise ParameterError(
            f"{where} = {shown(entry)}: write {{value: ..., unit: {spec.unit}, source: ...}}; "
            f"{spec.permitted}"
        )
    for name in entry:
        check_known(name, ("value", "unit", "source", "note"), where, "entry")
    for name in ("value", "unit"):
        if name not in entry:
            raise ParameterError(f"{where}: {name!r} is missing; {spec.permitted}")
    tag, note = _read_source(entry, where)
    unit = _text(entry["unit"], f"{spec.key}.unit", origin)
    checked_number(entry["value"], spec, origin, unit)
    return Source(value=entry["value"], unit=unit, tag=tag, note=note)


def _read_table(entry: Any, origin: str) -> ChillerTable:
    where = f"{origin}: chiller.{TABLE_NAME}"
    if not isinstance(entry, dict):
        raise ParameterError(f"{where} = {shown(entry)}: a mapping is needed")
    tag, note = _read_source(entry, where)
    return parse_chiller_table(entry, tag, note, origin)


def _read_source(entry: Mapping[str, Any], where: str) -> tuple[SourceTag, str]:
    permitted = ", ".join(tag.value for tag in FILE_TAGS)
    if "source" not in entry:
        raise ParameterError(f"{where}: 'source' is missing; permitted: {permitted}")
    written = entry["source"]
    if written not in [tag.value for tag in FILE_TAGS]:
        raise ParameterError(f"{where}: source {shown(written)}; permitted: {permitted}")
    return SourceTag(written), _text(entry.get("note", ""), "note", where)


def _check_single_chiller(
    entries: Mapping[str, Source], table: ChillerTable | None, origin: str
) -> None:
    stated = [key for key in COEFFICIENT_KEYS if key in entries]
    if table is not None and stated:
        raise ParameterError(
            f"{origin}: {', '.join(stated)} and chiller.{TABLE_NAME} both state the chiller; "
            "permitted: one of the two in one file"
        )


def _text(value: object, name: str, origin: str) -> str:
    if not isinstance(value, str):
        raise ParameterError(f"{origin}: {name} = {shown(value)}: text is needed (quote it)")
    return value
