"""The command `call`: call a trigger service of a node, or list those that it offers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from std_srvs.srv import Trigger

from iptm_core.errors import IptmError, ServiceError
from iptm_core.program import EXIT_INTERRUPTED, EXIT_OK, EXIT_REFUSED, refused
from iptm_core.user_input import number, suggestion, whole_number
from iptm_ros.connections import Meeting
from iptm_ros.graph_client import GraphClient
from iptm_ros.topics import full_name

PROGRAM = "iptm call"
_TRIGGER = "std_srvs/srv/Trigger"
_DEFAULT_TIMEOUT_S = 5.0


def add_graph_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of every program that asks a node one question."""
    parser.add_argument(
        "node",
        nargs="?",
        help="name of the node: plant, or with its namespace car_1/plant (default: list the nodes)",
    )
    parser.add_argument(
        "--domain",
        type=whole_number,
        metavar="N",
        help="ROS domain of the run (default: ROS_DOMAIN_ID, or 0 where that is not set)",
    )
    parser.add_argument(
        "--timeout-s",
        type=number,
        default=_DEFAULT_TIMEOUT_S,
        metavar="S",
        help="longest wait for the node and for its answer (default: %(default)g)",
    )


def ask(
    program: str, options: argparse.Namespace, question: Callable[[GraphClient, str], int]
) -> int:
    """Ask the node that is meant by the options, or list the nodes; return the exit code."""
    try:
        with GraphClient(options.domain, options.timeout_s) as client:
            if options.node is None:
                print(*client.nodes(), sep="\n")
                return EXIT_OK
            return question(client, client.find(options.node))
    except IptmError as error:
        return refused(program, error)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Call a service of a node and print its answer. Without a service, list those of the "
        "node; without a node, list the nodes.",
        epilog="exit code: 0 when the service was carried out, 1 when the node refused it, "
        "2 for a mistake in the arguments or a node that is not there",
    )
    add_graph_options(parser)
    parser.add_argument("service", nargs="?", help="such as pause (default: list the services)")
    parser.add_argument(
        "--connected",
        default="",
        metavar="NODES",
        help="call it as soon as these nodes of its namespace hear each other: "
        "call plant resume --connected plant,v2x_bridge,controller,recorder",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Call a service.

    Returns:
        0 when it was carried out, 1 when the node refused it, 2 after a mistake of the user.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if "--ros-args" in given:  # `ros2 launch` adds them
        del given[given.index("--ros-args") :]
    options = build_parser().parse_args(given)
    return ask(PROGRAM, options, lambda client, node: _call(client, node, options))


def _call(client: GraphClient, node: str, options: argparse.Namespace) -> int:
    service: str | None = options.service
    offered = client.services(node, _TRIGGER, service)
    if service is None:
        if offered:
            print(*sorted(offered), sep="\n")
        else:
            print(f"{node} offers no service", file=sys.stderr)
        return EXIT_OK
    if service not in offered:
        raise ServiceError(f"{node} has no service {service!r}; {suggestion(service, offered)}")
    if options.connected:
        space = node.rpartition("/")[0]
        names = [name.strip() for name in options.connected.split(",")]
        full = [name if name.startswith("/") else full_name(space, name) for name in names]
        meeting = Meeting(client.node, full)
        if not client.wait(lambda: meeting.is_complete):
            missing = ", ".join(meeting.absent or meeting.missing)
            raise ServiceError(f"not connected after {client.timeout_s:g} s: {missing}")
    caller = client.node.create_client(Trigger, offered[service])
    answer = client.call(caller, Trigger.Request(), offered[service])
    print(f"{node}: {answer.message}", file=sys.stdout if answer.success else sys.stderr)
    return EXIT_OK if answer.success else EXIT_REFUSED


if __name__ == "__main__":
    sys.exit(main())
