"""The options of the command `iptm view`; the view itself is loaded when they are read."""

from __future__ import annotations

import argparse
from pathlib import Path

from iptm_core.user_input import number, whole_number
from iptm_view.page_server import DEFAULT_PORT

PROGRAM = "iptm view"
DEFAULT_RATE = 10.0
"""Default playback speed of a bag: ten seconds of trip in one."""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line without its ROS arguments."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Show a run in the browser while it takes place, or a finished bag as if it did."
        " ROS arguments (remaps) follow after --ros-args.",
    )
    parser.add_argument(
        "bag", type=Path, nargs="?", help="bag folder or file (default: the running graph)"
    )
    parser.add_argument(
        "--namespace",
        action="append",
        default=[],
        help="of the vehicle, e.g. car_1; on the graph several times for several vehicles, of which the"
        " page shows one at a time",
    )
    parser.add_argument(
        "--rate",
        type=number,
        default=DEFAULT_RATE,
        help="of a bag: playback speed over recorded speed, 0 for its end at once (default: %(default)g)",
    )
    parser.add_argument(
        "--start", type=number, default=0.0, metavar="S", help="of a bag: where playback begins, s"
    )
    parser.add_argument(
        "--run-information",
        type=Path,
        metavar="FILE",
        help="YAML about the run on the graph, as a recorder takes it (default: its nodes are asked)",
    )
    parser.add_argument(
        "--afterwards",
        type=Path,
        action="append",
        default=[],
        metavar="BAG",
        help="bag that the run on the graph is being recorded in, one for each --namespace; read when it is"
        " complete, so that the page has every tick",
    )
    parser.add_argument(
        "--against",
        default="reference",
        metavar="STRATEGY|BAG",
        help="strategy of the car to compare with, or the bag of another run of the same trip; none for no"
        " such car; with one vehicle only (default: %(default)s)",
    )
    parser.add_argument(
        "--port", type=whole_number, help=f"of the page (default: {DEFAULT_PORT}, or a free one)"
    )
    parser.add_argument(
        "--foxglove-port",
        type=whole_number,
        help="of the Foxglove server (default: 8765, or a free one)",
    )
    parser.add_argument(
        "--foxglove-origin",
        action="append",
        default=[],
        metavar="URL",
        help="web page that may connect to the Foxglove server, in addition to app.foxglove.dev and pages"
        " of this machine; repeatable",
    )
    parser.add_argument("--no-foxglove", action="store_true", help="start no Foxglove server")
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="of a bag: write the page to one HTML file that plays without a server, and end",
    )
    parser.add_argument("--no-browser", action="store_true", help="open no browser on a desktop")
    return parser
