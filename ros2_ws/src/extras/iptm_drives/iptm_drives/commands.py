"""The commands `drive` and `train`.

What they need is imported where it is used: their ``--help`` is there at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from iptm_core.errors import IptmError, RouteError
from iptm_core.program import EXIT_OK, refused

# ruff: noqa: PLC0415
DRIVE, TRAIN = "iptm drive", "iptm train"


def drive(arguments: Sequence[str] | None = None) -> int:
    """Show a recorded drive as it is read, or make one from a CAN log; return the exit code."""
    given = _drive_parser().parse_args(arguments)
    from iptm_core.routes.user_csv import read_user_trip
    from iptm_drives.can_log import can_log_csv
    from iptm_drives.picture import description, draw
    from iptm_drives.reading import trip_of_table
    from iptm_drives.text_table import parse_text_table

    try:
        if given.command == "can":
            signals = dict(map(_named_signal, given.signal))
            text = can_log_csv(given.log, given.dbc, signals, given.channel)
            trip = trip_of_table(given.file, parse_text_table(text, str(given.file)))
            given.file.write_text(text, encoding="utf-8")
        else:
            columns = f"#{given.columns}" if given.columns else ""
            trip = read_user_trip(Path(f"{given.file}{columns}"))
        print(description(trip))
        if given.picture is not None:
            draw(trip, given.picture)
    except (IptmError, OSError) as reason:
        return refused(DRIVE, reason)
    return EXIT_OK


def _drive_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        DRIVE,
        description="Show a recorded drive as it is read, or make one from signals in a CAN log. The same"
        " file drives the leader: iptm run --cycle FILE.",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    show = commands.add_parser("show", help="show a drive as it is read")
    show.add_argument(
        "file",
        type=Path,
        help="a table, workbook, GPX, TCX, KML, NMEA, FIT or JSON track, a bag, a zip with one of them, or"
        " FILE.fcd.xml#VEHICLE of SUMO",
    )
    show.add_argument(
        "--columns",
        default="",
        metavar="WHAT=NAME[UNIT],...",
        help="which column of a table is what: speed=Vehicle_Speed[km/h]",
    )
    can = commands.add_parser("can", help="make a drive of signals in a CAN log, and show it")
    can.add_argument("log", type=Path, help=".blf, .asc, .log, .trc, .csv or .mf4 file")
    can.add_argument("file", type=Path, help=".csv file to write")
    can.add_argument(
        "--dbc", type=Path, help="decodes the frames; none for an MF4 file that holds signals"
    )
    can.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="COLUMN=SIGNAL",
        help="what a signal is, such as speed_kmh=VehicleSpeed; repeatable",
    )
    can.add_argument(
        "--channel", default="", help="bus or sender (0x..) of the frames, where there are several"
    )
    for each in (show, can):
        each.add_argument("--picture", type=Path, help="draw it into this .png file")
    return parser


def _named_signal(text: str) -> tuple[str, str]:
    column, separator, signal = text.partition("=")
    if not (column and separator and signal):
        raise RouteError(f"--signal is {text!r}; allowed: COLUMN=SIGNAL")
    return column, signal


def train(arguments: Sequence[str] | None = None) -> int:
    """Train the prediction of the lead vehicle; return the exit code, 2 if something was refused."""
    parser = argparse.ArgumentParser(
        TRAIN,
        description="Train the regression that predicts a lead vehicle on recorded drives, and try it on"
        " others: two thirds are trained on; errors and coverage of the bounds are those on the rest. The"
        " bridge takes the file as its parameter regression_model.",
    )
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="DRIVES",
        help="cycles, recorded drives, and folders of CSV drives",
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the model there")
    parser.add_argument("--source", default="", help="source and licence, to be noted in the model")
    given = parser.parse_args(arguments)
    from iptm_drives.predictor_training import train_and_try

    try:
        train_and_try(given.sources, given.output, given.source)
    except IptmError as error:
        return refused(TRAIN, error)
    except OSError as error:
        return refused(TRAIN, f"{error.filename}: {error.strerror}")
    return EXIT_OK
