"""Load a named or user-written parameter set, with overrides, into checked parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from iptm_core.errors import ParameterError
from iptm_core.parameters.flat import (
    Source,
    SourceTag,
    checked_number,
    field_specs,
    flat_to_parameters,
    neutral_values,
    to_flat_dict,
)
from iptm_core.parameters.layers import AMBIENT_KEY, ChillerTable, Layer, read_layer
from iptm_core.parameters.model import FieldSpec, ModelParameters
from iptm_core.parameters.strict_yaml import YAML_SUFFIXES
from iptm_core.user_input import StrictMapping, number, shown, suggestion

DEFAULT_SET = "paper_calibrated"
_MAX_LAYERS = 8
_NEUTRAL = "changes nothing: the paper's equations count"


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
class ParameterRow(FieldSpec):
    """One line of the parameter table: a declaration with the value, in its unit, and its source."""

    value: float
    source: str
    note: str


def available_parameter_sets() -> tuple[str, ...]:
    """Names of the shipped sets, the default first."""
    names = [path.stem for path in _sets_folder().iterdir() if path.suffix in YAML_SUFFIXES]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SET, name)))


def load_parameters(
    name_or_path: str | Path = DEFAULT_SET, overrides: Mapping[str, float] | None = None
) -> ParameterSet:
    """Load parameters, apply overrides, and check everything.

    Args:
        name_or_path: name of a shipped set (see ``available_parameter_sets``) or path of a YAML file.
            A file that names a ``base`` states only what differs from it.
        overrides: dotted key -> value in the unit of the model, for example
            ``{"gap.max_gap_m": 80.0}``. A set with a chiller table is interpolated at the ambient
            temperature that results, so overriding that temperature moves the chiller too; a
            coefficient that is overridden itself keeps the override.

    Raises:
        ParameterError: for an unknown set, a missing or malformed file, an unknown or missing key, a
            value of the wrong type, unit or range, or parameters that contradict each other. The
            message names the file, the dotted key, the value and what is permitted.
    """
    path = _find(name_or_path)
    layers = _read_layers(path)
    sources: dict[str, Source] = {
        key: Source(value, field_specs()[key].unit, SourceTag.CHOSEN, _NEUTRAL)
        for key, value in neutral_values().items()
    }
    table: ChillerTable | None = None
    for layer in layers:
        if layer.chiller_table is not None:
            table = layer.chiller_table
            sources = {
                key: source for key, source in sources.items() if key not in table.coefficients
            }
        sources.update(layer.entries)
    sources.update(_override_sources(overrides))
    origin = str(path) if not overrides else f"{path} with overrides"
    if table is not None:
        sources = {**_interpolated(table, sources, origin), **sources}
    flat = {
        key: checked_number(source.value, field_specs()[key], origin, source.unit)
        for key, source in sources.items()
    }
    return ParameterSet(
        name=path.stem,
        values=flat_to_parameters(flat, origin),
        sources={key: sources[key] for key in field_specs()},
        description=layers[-1].description,
    )


def parse_overrides(text: str) -> dict[str, float]:
    """Read ``key=value`` pairs separated by commas, such as ``body.mass_kg=1600, gap.max_gap_m=80``.

    Args:
        text: the pairs; empty for none. Whether the keys exist is checked by ``load_parameters``.

    Raises:
        ParameterError: an entry is not such a pair or a key appears twice.
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


def describe_parameters(parameter_set: ParameterSet | None = None) -> tuple[ParameterRow, ...]:
    """Describe every parameter, for generated documentation and tables.

    Args:
        parameter_set: set whose values and sources to show; None loads the default set.
    """
    shown_set = load_parameters() if parameter_set is None else parameter_set
    values, sources = to_flat_dict(shown_set.values), shown_set.sources
    return tuple(
        ParameterRow(
            **vars(spec), value=values[key], source=sources[key].tag.value, note=sources[key].note
        )
        for key, spec in field_specs().items()
    )


def _sets_folder() -> Path:
    # The packages are installed as plain folders (wheel, colcon, editable), so this is a real path.
    return Path(str(resources.files("iptm_core.parameters").joinpath("sets")))


def _find(name_or_path: str | Path, base_of: Path | None = None) -> Path:
    """Find a shipped set by name or a file by path (relative to the file whose base it is)."""
    asked = "parameter set" if base_of is None else f"{base_of}: base"
    names = available_parameter_sets()
    if not isinstance(name_or_path, str | Path) or not str(name_or_path):
        raise ParameterError(
            f"{asked} is {shown(name_or_path)}; allowed: a path, or a shipped set: "
            f"{', '.join(names)}"
        )
    if str(name_or_path) in names:
        return _sets_folder() / f"{name_or_path}.yaml"
    path = Path(name_or_path) if base_of is None else base_of.parent / name_or_path
    if path.suffix in YAML_SUFFIXES or _exists(path):
        return path
    raise ParameterError(
        f"{asked} is {shown(str(name_or_path))}, no shipped set and no file; "
        f"{suggestion(name_or_path, names)}, or the path of a .yaml file"
    )


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name too long for the file system
        return False


def _read_layers(path: Path) -> list[Layer]:
    """Read a file and its bases, the innermost base first."""
    layers = [read_layer(path)]
    seen = [path.resolve()]
    base = layers[0].base
    while base is not None:
        base_path = _find(base, path)
        if base_path.resolve() in seen or len(seen) >= _MAX_LAYERS:
            raise ParameterError(
                f"{path}: base is {base!r}, and sets build on each other in a circle or more than "
                f"{_MAX_LAYERS} deep; allowed: at most {_MAX_LAYERS} different sets"
            )
        seen.append(base_path.resolve())
        path = base_path
        layers.append(read_layer(path))
        base = layers[-1].base
    return layers[::-1]


def _override_sources(overrides: Mapping[str, float] | None) -> dict[str, Source]:
    if overrides is None:
        return {}
    specs = field_specs()
    written = StrictMapping(
        overrides, "overrides", specs, kind="parameter", error=ParameterError
    ).content
    return {
        key: Source(
            value=checked_number(value, specs[key], "overrides"),
            unit=specs[key].unit,
            tag=SourceTag.OVERRIDE,
        )
        for key, value in written.items()
    }


def _interpolated(
    table: ChillerTable, sources: Mapping[str, Source], origin: str
) -> dict[str, Source]:
    if AMBIENT_KEY not in sources:
        raise ParameterError(f"{origin}: missing {AMBIENT_KEY}")
    ambient = sources[AMBIENT_KEY]
    return table.at(checked_number(ambient.value, field_specs()[AMBIENT_KEY], origin, ambient.unit))
