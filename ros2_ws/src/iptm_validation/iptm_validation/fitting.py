"""All fitted parameters: fit, save and load them, and compare them with other data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from iptm_core.errors import MeasurementError
from iptm_validation.comparisons.cars import compare_cars
from iptm_validation.comparisons.cell import compare_cell
from iptm_validation.comparisons.drivers import compare_drivers
from iptm_validation.comparisons.i3_energy import compare_energy
from iptm_validation.comparisons.i3_pack import compare_pack
from iptm_validation.measurements import MeasuredData
from iptm_validation.models.epa_drivetrain import OneDrivetrain, fit_one_drivetrain
from iptm_validation.models.i3_drivetrain import I3Drivetrain, fit_drivetrain
from iptm_validation.models.i3_pack import I3Pack, fit_pack
from iptm_validation.models.i3_vehicle import I3Vehicle, fit_vehicle
from iptm_validation.models.lead_vehicle import LeadBounds, fit_bounds
from iptm_validation.models.panasonic_cell import PanasonicCell, fit_cell
from iptm_validation.outcome import Outcome
from iptm_validation.parameter_files import load_parameters, package_folder, save_parameters

I3_SOURCE = (
    "Steinstraeter et al., Battery and Heating Data in Real Driving Cycles, TU Munich, "
    "IEEE DataPort, CC BY 4.0"
)
SOURCES = {
    "bmw_i3_drivetrain": f"losses of motor and inverter of the BMW i3, fitted to {I3_SOURCE}",
    "bmw_i3_vehicle": f"road load of the BMW i3, fitted to {I3_SOURCE}",
    "bmw_i3_pack": f"pack of the BMW i3 (60 Ah), fitted to {I3_SOURCE}",
    "panasonic_18650pf": (
        "Panasonic NCR18650PF, fitted to Kollmeyer, University of Wisconsin-Madison, Mendeley Data "
        "10.17632/wykht8y7tg.1, CC BY 4.0"
    ),
    "one_drivetrain": (
        "one drivetrain of many electric cars, fitted to the EPA list of test cars, model year 2022, "
        "public domain"
    ),
    "lead_vehicles": (
        "bounds of predicted positions, fitted to OpenACC, Joint Research Centre of the European Commission, "
        f"CC BY 4.0, and {I3_SOURCE}"
    ),
}


@dataclass(frozen=True)
class FittedParameters:
    """The parameters of all models."""

    drivetrain: I3Drivetrain
    vehicle: I3Vehicle
    pack: I3Pack
    cell: PanasonicCell
    cars: OneDrivetrain
    leaders: LeadBounds


def load_fitted(folder: Path | None = None) -> FittedParameters:
    """Read the parameters from a folder, by default those that are shipped.

    Raises:
        ParameterError: a file is missing or damaged.
    """
    base = folder or package_folder()
    return FittedParameters(
        drivetrain=load_parameters(base / "bmw_i3_drivetrain.yaml", I3Drivetrain),
        vehicle=load_parameters(base / "bmw_i3_vehicle.yaml", I3Vehicle),
        pack=load_parameters(base / "bmw_i3_pack.yaml", I3Pack),
        cell=load_parameters(base / "panasonic_18650pf.yaml", PanasonicCell),
        cars=load_parameters(base / "one_drivetrain.yaml", OneDrivetrain),
        leaders=load_parameters(base / "lead_vehicles.yaml", LeadBounds),
    )


def fit_all(data: MeasuredData, folder: Path, report: Callable[[str], None]) -> None:
    """Fit what there are data for and write it to a folder; the files of other models stay as they are.

    Raises:
        MeasurementError: the data cover no model.
    """
    written = False

    def save(name: str, parameters: object) -> None:
        nonlocal written
        written = True
        save_parameters(folder / f"{name}.yaml", parameters, SOURCES[name])

    if data.trips:
        report("i3: losses of motor and inverter")
        drivetrain = fit_drivetrain(data.trips)
        save("bmw_i3_drivetrain", drivetrain)
        report("i3: road load")
        save("bmw_i3_vehicle", fit_vehicle(data.trips, drivetrain))
        report("i3: pack")
        save("bmw_i3_pack", fit_pack(data.trips))
    if data.cell_tests:
        report("Panasonic cell: choice of the circuit and fit (minutes)")
        save("panasonic_18650pf", fit_cell(data.cell_tests))
    if data.dynamometer_tests:
        report("EPA: one drivetrain")
        save("one_drivetrain", fit_one_drivetrain(data.dynamometer_tests))
    if data.drives:
        save("lead_vehicles", fit_bounds(data.drives, report))
    if not written:
        raise MeasurementError("no data to fit to; allowed: files of at least one data set")


def compare_all(
    data: MeasuredData, fitted: FittedParameters, report: Callable[[str], None]
) -> Iterator[Outcome]:
    """Compare the models with what they were not fitted to, as far as there are data."""
    report("i3: energy")
    outcomes = [compare_energy(data.trips, fitted.drivetrain, fitted.vehicle)]
    report("i3: pack")
    outcomes.append(compare_pack(data.trips, fitted.pack))
    report("Panasonic cell")
    outcomes.append(compare_cell(data.cell_tests, fitted.cell))
    report("EPA")
    outcomes.append(compare_cars(data.dynamometer_tests, fitted.cars))
    outcomes.append(compare_drivers(data.drives, fitted.leaders, report))
    yield from (outcome for outcome in outcomes if outcome is not None)
