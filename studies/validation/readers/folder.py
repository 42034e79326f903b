"""All measurements in a folder: each file is recognised by its first lines, whatever it is called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np
import pandas as pd
from studies.validation.measurements import CellTest, Drive, Driver, MeasuredData, Trip
from studies.validation.readers import bmw_i3, epa, openacc, panasonic
from studies.validation.readers.columns import head_of

from iptm.parts import MeasurementError

SUFFIXES = (".csv", ".csv.gz", ".mat")
Measured: TypeAlias = Trip | Drive | CellTest | pd.DataFrame
Named = TypeVar("Named", Trip, Drive, CellTest)
_READERS: tuple[
    tuple[
        Callable[[list[str]], bool],
        Callable[[Path], Sequence[Measured]],
    ],
    ...,
] = (
    (bmw_i3.is_compact_i3, bmw_i3.compact_trips),
    (bmw_i3.is_original_i3, bmw_i3.original_trips),
    (openacc.is_compact_openacc, openacc.compact_platoons),
    (openacc.is_original_openacc, openacc.original_platoons),
    (panasonic.is_compact_panasonic, panasonic.compact_cell_tests),
    (epa.is_epa, epa.dynamometer_tests),
)


def excerpts() -> Path:
    """Return the folder of the measurements that are part of the project."""
    return Path(__file__).parents[1] / "data"


def files_of(folder: Path) -> list[Path]:
    """Return the files below a folder that may hold measurements.

    Raises:
        MeasurementError: the folder does not exist or holds no usable file.
    """
    if not folder.is_dir():
        raise MeasurementError(f"data is {str(folder)!r}; allowed: a folder")
    found = sorted(path for path in folder.rglob("*") if path.name.lower().endswith(SUFFIXES))
    if not found:
        raise MeasurementError(f"{folder} holds no file that ends in {', '.join(SUFFIXES)}")
    return found


def read_files(paths: list[Path], report: Callable[[str], None]) -> MeasuredData:
    """Read files; one that is not recognised or damaged is reported and left out.

    Args:
        paths: files, originals and compact ones in any order.
        report: takes one line per file that was left out.

    Returns:
        All measurements; of those with the same name the first one.
    """
    found: list[Measured] = []
    for path in paths:
        found += _read_or_report(path, report)
    trips = _first_of_each([item for item in found if isinstance(item, Trip)])
    drives = [item for item in found if isinstance(item, Drive)]
    return MeasuredData(
        trips=tuple(sorted(trips, key=lambda trip: trip.name)),
        drives=tuple(_first_of_each([*drives, *map(_drive_of, trips)])),
        cell_tests=tuple(_first_of_each([item for item in found if isinstance(item, CellTest)])),
        dynamometer_tests=pd.concat(
            [pd.DataFrame(), *(item for item in found if isinstance(item, pd.DataFrame))]
        ),
    )


def _read_or_report(path: Path, report: Callable[[str], None]) -> Sequence[Measured]:
    try:
        return _read(path)
    except (MeasurementError, OSError, ValueError, EOFError) as error:
        report(f"{path.name}: {error}; left out")
        return []


def _read(path: Path) -> Sequence[Measured]:
    """Return what a file holds.

    Raises:
        MeasurementError: it is of no known data set, or damaged.
    """
    if path.suffix.lower() == ".mat":
        return panasonic.original_cell_tests(path)
    head = head_of(path) or [""]
    for recognises, read in _READERS:
        if recognises(head):
            return read(path)
    raise MeasurementError("its first line belongs to no known data set")


def _first_of_each(items: Sequence[Named]) -> list[Named]:
    return list({item.name: item for item in reversed(items)}.values())[::-1]


def _drive_of(trip: Trip) -> Drive:
    """Return the speed of a trip at steps of a second."""
    grid = np.arange(0.0, trip.time_s[-1], 1.0)
    speeds = np.interp(grid, trip.time_s, trip.speed_m_s)
    return Drive(trip.name, trip.name, Driver.ROAD, 1.0, speeds)
