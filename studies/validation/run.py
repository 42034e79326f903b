"""Compare the models with measured cars, cells and drivers, and fit them to measurements."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from studies.session import Session
from studies.validation.fitting import PARAMETERS, compare_all, fit_all, load_fitted
from studies.validation.measurements import Driver, MeasuredData
from studies.validation.outcome import draw, figures_table
from studies.validation.readers.folder import excerpts, files_of, read_files

from iptm.parts import MeasurementError, ScenarioError, evaluate, held_out, table_of, train

VARIABLE = "IPTM_MEASURED_DATA"
PREDICTOR_COLUMNS = {
    "after": "{lead_s:g} s",
    "position error rms": "{rms_m:.2f} m",
    "with decaying acceleration": "{decay_rms_m:.2f} m",
    "mean bound": "{bound_m:.2f} m",
    "kept": "{kept_percent:.1f} %",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this study."""
    for name, text in (
        ("data", f"measurements to compare with (${VARIABLE}, else the excerpts of the project)"),
        ("fit", "measurements to fit to before comparing"),
        (
            "parameters",
            "fitted parameters to read, and to write with --fit (by default the study's)",
        ),
    ):
        parser.add_argument(f"--{name}", type=Path, metavar="FOLDER", help=text)
    text = "instead, train the predictor of lead vehicles on the trips of the i3 and write it there"
    parser.add_argument("--predictor", type=Path, metavar="FILE", help=text)


def run(session: Session) -> bool:
    """Run the study; returns whether all bars are met.

    Raises:
        MeasurementError: there is nothing in the data that was not fitted to.
    """
    options = session.options
    if options.fit is not None:
        target = options.parameters or PARAMETERS
        target.mkdir(parents=True, exist_ok=True)
        fit_all(_read(options.fit, session), target, session.say)
    folder = options.data or os.environ.get(VARIABLE) or excerpts()
    data = _read(Path(folder), session)
    if options.predictor is not None:
        train_predictor(data, options.predictor)
        return True
    outcomes = list(compare_all(data, load_fitted(options.parameters), session.say))
    if not outcomes:
        raise MeasurementError(f"{folder} holds nothing that was not fitted to; allowed: something")
    pictures = session.output / "pictures"
    for outcome in outcomes:
        for comparison in outcome.comparisons:
            if comparison.curves and not session.short:
                draw(comparison, pictures / f"{comparison.key}.png")
    session.render(outcomes=[(outcome, figures_table(outcome)) for outcome in outcomes])
    return all(figure.is_met for outcome in outcomes for figure in outcome.figures if figure.bar)


def _read(folder: Path, session: Session) -> MeasuredData:
    return read_files(files_of(folder), session.say)


def train_predictor(data: MeasuredData, output: Path) -> None:
    """Train the shipped predictor on two thirds of the drives on roads, try it on the others and write it.

    Raises:
        ScenarioError: the drive does not exist.
    """
    drives = {
        drive.name: drive.speed_m_s
        for drive in data.drives
        if drive.driver is Driver.ROAD and drive.step_s == 1.0
    }
    if not drives:
        raise ScenarioError("the data hold no drive on a road; allowed: trips of the i3")
    others = held_out(list(drives))
    model = train({name: drives[name] for name in drives if name not in others}, "")
    print(table_of(evaluate(model, {name: drives[name] for name in others}), PREDICTOR_COLUMNS))
    output.write_text(model.as_json(), encoding="utf-8")
