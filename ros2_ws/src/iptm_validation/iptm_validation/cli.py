"""Compare the models with measured cars, cells and drivers, and fit them to measurements."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, refused
from iptm_validation.fitting import compare_all, fit_all, load_fitted, package_folder
from iptm_validation.measurements import MeasuredData
from iptm_validation.outcome import Outcome, write_page
from iptm_validation.readers.folder import excerpts, files_of, read_files

PROGRAM = "validate"
VARIABLE = "IPTM_MEASURED_DATA"
EXIT_MISSED = 1


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(PROGRAM, description=__doc__)
    parser.add_argument(
        "--data",
        metavar="FOLDER",
        type=Path,
        help=f"measurements to compare with (default: ${VARIABLE}, else the excerpts of the project)",
    )
    parser.add_argument(
        "--fit", metavar="FOLDER", type=Path, help="measurements to fit to before comparing"
    )
    parser.add_argument(
        "--parameters",
        metavar="FOLDER",
        type=Path,
        help="fitted parameters to read, and to write with --fit (default: those of the package)",
    )
    parser.add_argument(
        "--page", metavar="FOLDER", type=Path, help="write validation.md and its pictures there"
    )
    return parser.parse_args(arguments)


def _read(folder: Path | None, console: Console) -> MeasuredData:
    def report(text: str) -> None:
        console.print(f"{PROGRAM}: {text}", markup=False, highlight=False, soft_wrap=True)

    paths = files_of(folder or excerpts())
    with console.status(f"reading {len(paths)} files"):
        return read_files(paths, report)


def _table(outcomes: list[Outcome]) -> Table:
    table = Table(title="Models compared with measurements (parts that were not fitted)")
    for name in ("quantity", "part"):
        table.add_column(name, overflow="fold")
    for name in ("value", "bar"):
        table.add_column(name, justify="right")
    table.add_column("")
    for outcome in outcomes:
        for figure in outcome.figures:
            verdict = ("met" if figure.is_met else "MISSED") if figure.bar else ""
            value = f"{figure.value:.2f} {figure.unit}"
            table.add_row(figure.quantity, figure.part, value, figure.bar, verdict)
        table.add_section()
    return table


def _run(options: argparse.Namespace, console: Console) -> int:
    folder = options.data
    if folder is None and os.environ.get(VARIABLE):
        folder = Path(os.environ[VARIABLE])

    with console.status("starting") as status:
        if options.fit is not None:
            status.update("reading what is fitted to")
            target = options.parameters or package_folder()
            target.mkdir(parents=True, exist_ok=True)
            fit_all(_read(options.fit, Console(stderr=True)), target, status.update)
    fitted = load_fitted(options.parameters)
    data = _read(folder, console)
    with console.status("comparing") as status:
        outcomes = list(compare_all(data, fitted, status.update))
    if not outcomes:
        return refused(PROGRAM, "there is nothing in these data that was not fitted to")
    console.print(_table(outcomes))
    for outcome in outcomes:
        for note in outcome.notes:
            console.print(f"{outcome.title}: {note}", markup=False, highlight=False)
    if options.page is not None:
        path = write_page(options.page, outcomes)
        console.print(f"page: {path}", markup=False, highlight=False, soft_wrap=True)
    missed = [f for outcome in outcomes for f in outcome.figures if f.bar and not f.is_met]
    return EXIT_MISSED if missed else EXIT_OK


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; exit code 1 if a bar is missed, 2 if something was refused."""
    options = _options(arguments)
    try:
        return _run(options, Console())
    except IptmError as error:
        return refused(PROGRAM, error)
    except OSError as error:
        return refused(PROGRAM, f"{error.filename}: {error.strerror}")


if __name__ == "__main__":
    sys.exit(main())
