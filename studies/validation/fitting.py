"""All fitted parameters: fit, save and load them, and compare them with other data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

import yaml
from studies.validation.cell import PanasonicCell, compare_cell, fit_cell
from studies.validation.drivers import compare_drivers
from studies.validation.epa import OneDrivetrain, compare_cars, fit_one_drivetrain
from studies.validation.i3_drivetrain import I3Drivetrain, fit_drivetrain
from studies.validation.i3_pack import I3Pack, compare_pack, fit_pack
from studies.validation.i3_vehicle import I3Vehicle, compare_energy, fit_vehicle
from studies.validation.lead_vehicle import LeadBounds, fit_bounds
from studies.validation.measurements import MeasuredData
from studies.validation.outcome import Outcome

from iptm.parts import MeasurementError, ParameterError

Parameters = TypeVar("Parameters")
PARAMETERS = Path(__file__).parent / "parameters"
DIGITS = 6


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    return value


def save_parameters(path: Path, parameters: Any, description: str) -> None:
    """Write parameters with six digits.

    Args:
        path: the file.
        parameters: a frozen dataclass of numbers, texts, tuples and such dataclasses.
        description: what they are and where the data came from.
    """
    content = {"description": description, "parameters": _plain(asdict(parameters))}
    text = yaml.safe_dump(content, sort_keys=False, width=110, default_flow_style=None)
    path.write_text(
        f"# Written by `scripts/study validation --fit`; do not edit.\n{text}", encoding="utf-8"
    )


def load_parameters(path: Path, kind: type[Parameters]) -> Parameters:
    """Read parameters.

    Raises:
        ParameterError: the file is missing or does not have the fields of ``kind``.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        built: Parameters = _build(content["parameters"], kind)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(f"fitted parameters {path.name}: {error}") from error
    return built


def _build(value: Any, kind: Any) -> Any:
    if get_origin(kind) is tuple:
        (entry, *_) = get_args(kind)
        return tuple(_build(item, entry) for item in value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        unknown = set(value) - {entry.name for entry in fields(kind)}
        if unknown:
            raise ValueError(f"unknown entries {sorted(unknown)}")
        return cast("Any", kind)(
            **{name: _build(item, hints[name]) for name, item in value.items()}
        )
    return kind(value)


I3_SOURCE = (
    "Steinstraeter et al., Battery and Heating Data in Real Driving Cycles, TU Munich, "
    "IEEE DataPort, CC BY 4.0"
)
MODELS: dict[str, tuple[type[Any], str]] = {
    "bmw_i3_drivetrain": (
        I3Drivetrain,
        f"losses of motor and inverter of the BMW i3, fitted to {I3_SOURCE}",
    ),
    "bmw_i3_vehicle": (I3Vehicle, f"road load of the BMW i3, fitted to {I3_SOURCE}"),
    "bmw_i3_pack": (I3Pack, f"pack of the BMW i3 (60 Ah), fitted to {I3_SOURCE}"),
    "panasonic_18650pf": (
        PanasonicCell,
        (
            "Panasonic NCR18650PF, fitted to Kollmeyer, University of Wisconsin-Madison, Mendeley Data "
            "10.17632/wykht8y7tg.1, CC BY 4.0"
        ),
    ),
    "one_drivetrain": (
        OneDrivetrain,
        (
            "one drivetrain of many electric cars, fitted to the EPA list of test cars, model year 2022, "
            "public domain"
        ),
    ),
    "lead_vehicles": (
        LeadBounds,
        (
            "bounds of predicted positions, fitted to OpenACC, Joint Research Centre of the European "
            f"Commission, CC BY 4.0, and {I3_SOURCE}"
        ),
    ),
}
"""File of the parameters of each model, their class, and what they were fitted to."""


def load_fitted(folder: Path | None = None) -> dict[type[Any], Any]:
    """Read the parameters of all models, by class, from a folder, by default those that are shipped.

    Raises:
        ParameterError: a file is missing or damaged.
    """
    base = folder or PARAMETERS
    return {
        kind: load_parameters(base / f"{name}.yaml", kind) for name, (kind, _) in MODELS.items()
    }


def fit_all(data: MeasuredData, folder: Path, report: Callable[[str], None]) -> None:
    """Fit what there are data for and write it to a folder; the files of other models stay as they are.

    Raises:
        MeasurementError: the data cover no model.
    """
    found: list[object] = []

    if data.trips:
        report("i3: losses of motor and inverter")
        drivetrain = fit_drivetrain(data.trips)
        report("i3: road load")
        found += [drivetrain, fit_vehicle(data.trips, drivetrain)]
        report("i3: pack")
        found.append(fit_pack(data.trips))
    if data.cell_tests:
        report("Panasonic cell: choice of the circuit and fit (minutes)")
        found.append(fit_cell(data.cell_tests))
    if not data.dynamometer_tests.empty:
        report("EPA: one drivetrain")
        found.append(fit_one_drivetrain(data.dynamometer_tests))
    if data.drives:
        found.append(fit_bounds(data.drives, report))
    if not found:
        raise MeasurementError("no data to fit to; allowed: files of at least one data set")
    for name, (kind, source) in MODELS.items():
        for parameters in found:
            if isinstance(parameters, kind):
                save_parameters(folder / f"{name}.yaml", parameters, source)


def compare_all(
    data: MeasuredData, fitted: Mapping[type[Any], Any], report: Callable[[str], None]
) -> Iterator[Outcome]:
    """Compare the models with what they were not fitted to, as far as there are data."""
    report("i3: energy")
    outcomes = [compare_energy(data.trips, fitted[I3Drivetrain], fitted[I3Vehicle])]
    report("i3: pack")
    outcomes.append(compare_pack(data.trips, fitted[I3Pack]))
    report("Panasonic cell")
    outcomes.append(compare_cell(data.cell_tests, fitted[PanasonicCell]))
    report("EPA")
    outcomes.append(compare_cars(data.dynamometer_tests, fitted[OneDrivetrain]))
    outcomes.append(compare_drivers(data.drives, fitted[LeadBounds], report))
    yield from (outcome for outcome in outcomes if outcome is not None)
