"""Load a named or user-written parameter set, with overrides, into checked parameters.

Parameters belong together: there is a note where one is overridden and its neighbours are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from iptm_core.declaration import ParameterSpec
from iptm_core.errors import ParameterError
from iptm_core.parameters.catalogue import CARS_FILE, FITTED_CAR, Car, car_entries, cars
from iptm_core.parameters.flat import (
    AMBIENT_KEY,
    COEFFICIENT_KEYS,
    ChillerTable,
    Source,
    SourceTag,
    allowed_numbers,
    checked_number,
    field_specs,
    flat_to_parameters,
    neutral_values,
    read_chiller_table,
    read_tag,
    to_flat_dict,
)
from iptm_core.parameters.model import ModelParameters
from iptm_core.parameters.strict_yaml import YAML_SUFFIXES, read_yaml
from iptm_core.user_input import StrictMapping, check_known, number, shown, suggestion

DEFAULT_SET = "paper_calibrated"
_MAX_LAYERS = 8
_NEUTRAL = "changes nothing: the paper's equations count"
_TABLE_KEY = "chiller.by_ambient_temperature"
_HEADINGS = ("description", "base", "refused_without")


@dataclass(frozen=True)
class ParameterSet:
    """A complete, checked set of parameters and where each value comes from.

    Attributes:
        name: name of a shipped set, or the file name without suffix of a user's own.
        sources: dotted key -> value as written, unit, tag and note; one entry for each parameter.
    """

    name: str
    values: ModelParameters
    sources: Mapping[str, Source] = field(compare=False)
    description: str = ""


@dataclass(frozen=True)
class _Layer:
    """What one file states, each value checked; a file with a base need not state every parameter."""

    description: str
    base: str | None
    entries: Mapping[str, Source]
    chiller_table: ChillerTable | None
    refused_without: Mapping[str, str]


def available_parameter_sets() -> tuple[str, ...]:
    """Names of the shipped sets, the default first."""
    names = [path.stem for path in _sets_folder().iterdir() if path.suffix in YAML_SUFFIXES]
    names += cars()
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SET, name)))


def load_parameters(
    name_or_path: str | Path = DEFAULT_SET, overrides: Mapping[str, float] | None = None
) -> ParameterSet:
    """Load parameters, apply overrides, and check everything.

    Whatever is wrong ends in a `ParameterError` with the file, the dotted key, value and allowed ones.

    Args:
        name_or_path: name of a shipped set (see ``available_parameter_sets``) or path of a YAML file.
            A file that names a ``base`` states only what differs from it. One that names parameters under
            ``refused_without`` is refused, with the reason given there, unless they are overridden.
        overrides: dotted key -> value in the unit of the model, for example
            ``{"gap.max_gap_m": 80.0}``. A set with a chiller table is interpolated at the ambient
            temperature that results, so overriding that temperature moves the chiller too; a
            coefficient that is overridden itself keeps the override.
    """
    path = _find(name_or_path)
    layers = _read_layers(path)
    specs = field_specs()
    sources: dict[str, Source] = {
        key: Source(value, specs[key].unit, SourceTag.CHOSEN, _NEUTRAL)
        for key, value in neutral_values().items()
    }
    table: ChillerTable | None = None
    for layer in layers:
        if layer.chiller_table is not None:
            table = layer.chiller_table
            sources = {key: sources[key] for key in sources if key not in table.coefficients}
        sources.update(layer.entries)
    for key, reason in (pair for layer in layers for pair in layer.refused_without.items()):
        if key not in (overrides or {}):
            raise ParameterError(f"{path}: {reason}; allowed: with an override of {key} only")
    if overrides is not None:
        written = StrictMapping(
            overrides, "overrides", specs, kind="parameter", error=ParameterError
        )
        for key, value in written.content.items():
            checked = checked_number(value, specs[key], "overrides")
            sources[key] = Source(checked, specs[key].unit, SourceTag.OVERRIDE)
    origin = str(path) if not overrides else f"{path} with overrides"

    def in_model_unit(key: str) -> float:
        return checked_number(sources[key].value, specs[key], origin, sources[key].unit)

    if table is not None:
        if AMBIENT_KEY not in sources:
            raise ParameterError(f"{origin}: missing {AMBIENT_KEY}")
        sources = {**table.at(in_model_unit(AMBIENT_KEY)), **sources}
    return ParameterSet(
        name=path.stem,
        values=flat_to_parameters({key: in_model_unit(key) for key in sources}, origin),
        sources={key: sources[key] for key in specs},
        description=layers[-1].description,
    )


def parse_overrides(text: str) -> dict[str, float]:
    """Read different ``key=value`` pairs separated by commas: ``body.mass_kg=1600, gap.max_gap_m=80``.

    Whether the keys exist is checked by ``load_parameters``.
    """
    overrides: dict[str, float] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        key, separator, value = (part.strip() for part in entry.partition("="))
        try:
            value_of_entry = number(value)
        except ValueError:
            separator = ""
        if not separator or not key or key in overrides:
            raise ParameterError(
                f"parameter overrides have the entry {entry!r}; allowed: "
                "different entries key=number, separated by commas"
            )
        overrides[key] = value_of_entry
    return overrides


def describe_parameters(parameter_set: ParameterSet | None = None) -> list[dict[str, Any]]:
    """Return the parameters of a set (None: the default one) as records for tables.

    Each has ``key``, ``symbol``, ``value``, ``unit``, ``minimum``, ``maximum``, ``source`` and ``note``.
    """
    described = load_parameters() if parameter_set is None else parameter_set
    values = to_flat_dict(described.values)
    return [
        {
            "key": key,
            "symbol": spec.symbol,
            "value": values[key],
            "unit": spec.unit,
            "minimum": spec.minimum,
            "maximum": spec.maximum,
            "source": described.sources[key].tag.value,
            "note": described.sources[key].note,
        }
        for key, spec in field_specs().items()
    ]


def _sets_folder() -> Path:
    # The packages are installed as plain folders (wheel, colcon, editable), so this is a real path.
    return Path(str(resources.files("iptm_core.parameters").joinpath("sets")))


def _find(name_or_path: str | Path, base_of: Path | None = None) -> Path:
    """Find a shipped set by name or a file by path (relative to the file whose base it is).

    A car of the table has the path of the table and its name.
    """
    asked = "parameter set" if base_of is None else f"{base_of}: base"
    names = available_parameter_sets()
    if not isinstance(name_or_path, str | Path) or not str(name_or_path):
        raise ParameterError(
            f"{asked} is {shown(name_or_path)}; allowed: a path, or a shipped set: "
            f"{', '.join(names)}"
        )
    if str(name_or_path) in cars():
        return CARS_FILE / str(name_or_path)
    if str(name_or_path) in names:
        return _sets_folder() / f"{name_or_path}.yaml"
    path = Path(name_or_path) if base_of is None else base_of.parent / name_or_path
    try:
        found = path.suffix in YAML_SUFFIXES or path.exists()
    except OSError:  # a name too long for the file system
        found = False
    if not found:
        raise ParameterError(
            f"{asked} is {shown(str(name_or_path))}, no shipped set and no file; "
            f"{suggestion(name_or_path, names)}, or the path of a .yaml file"
        )
    return path


def _read_layers(path: Path) -> list[_Layer]:
    """Read a file and its bases, the innermost base first."""
    layers = [_read_layer(path)]
    seen = [path.resolve()]
    while (base := layers[-1].base) is not None:
        base_path = _find(base, path)
        if base_path.resolve() in seen or len(seen) >= _MAX_LAYERS:
            raise ParameterError(
                f"{path}: base is {base!r}, and sets build on each other in a circle or more than "
                f"{_MAX_LAYERS} deep; allowed: at most {_MAX_LAYERS} different sets"
            )
        seen.append(base_path.resolve())
        path = base_path
        layers.append(_read_layer(path))
    return layers[::-1]


def _read_layer(path: Path) -> _Layer:
    if path.parent == CARS_FILE:
        return _car_layer(cars()[path.name])
    return _shipped_layer(path) if path.parent == _sets_folder() else _layer_of_file(path)


@cache
def _shipped_layer(path: Path) -> _Layer:
    return _layer_of_file(path)


def _layer_of_file(path: Path) -> _Layer:
    origin = str(path)
    groups = dict.fromkeys(key.split(".")[0] for key in field_specs())
    document = StrictMapping(
        read_yaml(path), origin, (*groups, *_HEADINGS), kind="group", error=ParameterError
    )
    entries: dict[str, Source] = {}
    table: ChillerTable | None = None
    for group in (name for name in document if name not in _HEADINGS):
        for name, entry in document.section(group, kind="parameter").content.items():
            key = f"{group}.{name}"
            if key == _TABLE_KEY:
                table = read_chiller_table(entry, key, origin)
                continue
            check_known(key, field_specs(), origin, "parameter")
            entries[key] = _read_entry(entry, field_specs()[key], origin)
    stated = [key for key in COEFFICIENT_KEYS if key in entries]
    if table is not None and stated:
        raise ParameterError(
            f"{origin}: {', '.join(stated)} and {_TABLE_KEY} both state the chiller; "
            "allowed: one of the two in one file"
        )
    base = document.text("base") if "base" in document else None
    refused = document.section("refused_without", field_specs(), kind="parameter")
    reasons = {key: refused.text(key) for key in refused}
    return _Layer(document.text("description", ""), base, entries, table, reasons)


def _car_layer(car: Car) -> _Layer:
    fitted, default = load_parameters(FITTED_CAR).values, load_parameters().values
    about = f"{car.car} (2022), from public figures"
    return _Layer(about, FITTED_CAR, car_entries(car, fitted, default), None, {})


def _read_entry(entry: object, spec: ParameterSpec, origin: str) -> Source:
    where = f"{origin}: {spec.name}"
    if not isinstance(entry, Mapping):
        raise ParameterError(
            f"{where} is {shown(entry)}; allowed: {{value: ..., unit: {spec.unit}, source: ...}}, "
            f"{allowed_numbers(spec)}"
        )
    known = ("value", "unit", "source", "note")
    written = StrictMapping(entry, where, known, kind="entry", error=ParameterError)
    written.require("value", "unit", allowed=f"{spec.unit}, {allowed_numbers(spec)}")
    unit = written.text("unit")
    checked_number(entry["value"], spec, origin, unit)
    return Source(entry["value"], unit, read_tag(written), written.text("note", ""))


_COLD_LAWS = ("cell.resistance_temperature_coefficient_1_k", "cell.resistance_exponent_1_k")
"""Linear and exponential law of the resistance; the second one counts where it is not 0."""
_BELONG = (
    (
        ("cell.heat_capacity_j_k", "cell.nominal_capacity_ah"),
        ("cooling.convective_coefficient_w_k",),
        "heat transfer between cell and coolant belongs to the size of the cell",
    ),
    (
        ("cell.nominal_capacity_ah",),
        ("cell.heat_capacity_j_k", "cell.nominal_resistance_ohm"),
        "heat capacity and resistance belong to the size of the cell",
    ),
    (
        ("cell.nominal_resistance_ohm",),
        _COLD_LAWS,
        "the resistance in the cold belongs to the cell",
    ),
    (
        (AMBIENT_KEY,),
        ("environment.initial_cell_temperature_k",),
        "a car that has stood in the open has cells of that temperature",
    ),
)
"""Keys, keys that belong to them, and why."""
_DENSITY_KEY = "body.air_density_kg_m3"
_AIR_KEY = "cooling.air_exchange_w_k"


def belonging_notes(parameters: ParameterSet) -> Iterator[str]:
    """Yield a note for each group of which a part is overridden, and for an override without effect."""
    values = parameters.values
    overridden = {
        key for key, source in parameters.sources.items() if source.tag is SourceTag.OVERRIDE
    }
    has_exponent = values.cell.resistance_exponent_1_k > 0.0
    unused = _COLD_LAWS[0 if has_exponent else 1]
    for keys, neighbours, reason in _BELONG:
        changed = [key for key in keys if key in overridden]
        kept = [
            f"{key} ({parameters.sources[key].value:g} {parameters.sources[key].unit})"
            for key in neighbours
            if key not in overridden and key != unused
        ]
        if changed and kept:
            yield (
                f"{', '.join(changed)} is overridden, {', '.join(kept)} is that of {parameters.name}:"
                f" {reason}"
            )
    if AMBIENT_KEY in overridden:
        moved = ["the chiller"]
        moved += ["the exchange of the pack with the air"] * (values.cooling.air_exchange_w_k > 0.0)
        moved += ["drag"] * (_DENSITY_KEY in overridden)
        yield (
            f"{AMBIENT_KEY} affects {' and '.join(moved)}; tyres, driveline and cabin are not modelled"
            + ("" if _DENSITY_KEY in overridden else f", nor drag ({_DENSITY_KEY})")
            + ("" if values.cooling.air_exchange_w_k else f", nor the pack ({_AIR_KEY} is 0)")
        )
