"""The commands `recover` and `check`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from iptm_bags.reading import EXIT_DIFFERENT, console_of_width
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.program import EXIT_OK, EXIT_REFUSED, print_error, refused
from iptm_core.user_input import check_known, number

PROGRAM, CHECK = "iptm recover", "iptm check"


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a sound bag of a damaged one.

    Returns:
        0 on success, 1 when nothing could be recovered.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Make a sound bag of one that was killed, cut short or damaged, and list the losses.",
    )
    parser.add_argument("source", type=Path, help="bag folder or .mcap file; it is not changed")
    parser.add_argument(
        "-o", "--output", type=Path, help="bag folder to create (default: <source>_recovered)"
    )
    given = parser.parse_args(arguments)
    # Not for --help: it takes a moment to load.
    from iptm_bags.recover import recover  # noqa: PLC0415

    try:
        report = recover(given.source, given.output)
    except IptmError as error:
        print_error(PROGRAM, error)
        return EXIT_REFUSED
    print(report)
    return EXIT_OK


def check(arguments: Sequence[str] | None = None) -> int:
    """Check a node against a bag.

    Returns:
        0 when it answers as recorded, 1 when not, 2 when that cannot be found out.
    """
    parser = argparse.ArgumentParser(
        CHECK,
        description="Feed a new node the inputs of a bag, and compare its answers with the recorded ones."
        " Ends with 0 when it agrees, 1 when not, 2 when that cannot be found out.",
    )
    parser.add_argument("node", help="plant, v2x_bridge or controller")
    parser.add_argument("bag", type=Path, help="bag folder or file, recorded in lock-step")
    parser.add_argument("--namespace", help="of the vehicle; needed only if the bag holds several")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the node to change against the recorded one; repeatable",
    )
    for name in ("absolute", "relative"):
        parser.add_argument(f"--{name}", type=number, help=f"{name} tolerance of all numbers")
    given = parser.parse_args(arguments)
    # Not for --help, as above.
    from iptm.trip_settings import NODES  # noqa: PLC0415
    from iptm_bags.compare_bags import NumberTolerance, print_comparison  # noqa: PLC0415
    from iptm_bags.replay_check import check_node, tolerances_text  # noqa: PLC0415

    tolerances = [given.absolute, given.relative]
    stated = any(each is not None for each in tolerances)
    tolerance = NumberTolerance(*(each or 0.0 for each in tolerances)) if stated else None
    console = console_of_width()
    try:
        check_known(given.node, NODES, CHECK, "node", ScenarioError)
        changes = dict(map(_assignment, given.set))
        with console.status(f"feeding {given.node} ...") as status:
            comparison = check_node(
                given.bag,
                given.node,
                namespace=given.namespace,
                changes=changes,
                tolerance=tolerance,
                on_tick=lambda done, count: status.update(f"tick {done} of {count}"),
            )
    except IptmError as error:
        return refused(CHECK, error)
    agrees = print_comparison(comparison, console)
    verdict = "answers as recorded" if agrees else "does not answer as recorded"
    text = tolerances_text(tolerance)
    console.print(f"{given.node} {verdict}; tolerance {text}", highlight=False)
    return EXIT_OK if agrees else EXIT_DIFFERENT


def _assignment(text: str) -> tuple[str, Any]:
    name, separator, value = text.partition("=")
    if not (name and separator):
        raise ScenarioError(f"option --set is {text!r}; allowed: NAME=VALUE")
    return name, parse_yaml(value, "option --set", ScenarioError) if value else ""
