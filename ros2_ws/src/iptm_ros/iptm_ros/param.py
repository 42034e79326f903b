"""The command `param`: list, show and change the parameters of a node."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from iptm_core.errors import ParameterError, ServiceError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.program import EXIT_OK, EXIT_REFUSED
from iptm_core.user_input import check_known, number, whole_number
from iptm_ros.call import add_graph_options, ask
from iptm_ros.graph_client import GraphClient

PROGRAM = "iptm param"
_BOOLEANS = {"true": True, "false": False}


class NodeParameters:
    """The parameters of one node on the graph."""

    def __init__(self, client: GraphClient, node: str) -> None:
        self._client = client
        self._node = node
        self._asked = AsyncParameterClient(client.node, node)
        if not client.wait(self._asked.services_are_ready):
            raise ServiceError(f"the parameters of {node} cannot be reached")
        listed = self._answer(self._asked.list_parameters()).result.names
        described = self._answer(self._asked.describe_parameters(sorted(listed))).descriptors
        self.descriptors: Mapping[str, ParameterDescriptor] = {d.name: d for d in described}

    def values(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the values of parameters; None for one that is not set."""
        for name in names:
            self._check(name)
        response = self._answer(self._asked.get_parameters(list(names)))
        return dict(zip(names, map(parameter_value_to_python, response.values), strict=True))

    def change(self, texts: Mapping[str, str]) -> tuple[bool, str]:
        """Set parameters, all of them or none.

        Args:
            texts: values by name, as the user wrote them.

        Returns:
            Whether the node accepted the values, and its reason if it did not.
        """
        for name in texts:
            self._check(name)
        wanted = [
            Parameter(name, value=value_from(self.descriptors[name], text))
            for name, text in texts.items()
        ]
        result = self._answer(self._asked.set_parameters_atomically(wanted)).result
        return bool(result.successful), str(result.reason)

    def _check(self, name: str) -> None:
        check_known(name, self.descriptors, self._node, "parameter")

    def _answer(self, future: Any) -> Any:
        return self._client.answer(future, self._node)


def value_from(descriptor: ParameterDescriptor, text: str) -> Any:
    """Return the value that a text stands for, in the type of a parameter.

    Numbers are plain decimals: `2e8` and `50` are valid for a double, where `ros2 param set` reads a text
    and an integer.
    """
    kind = descriptor.type
    try:
        if kind == ParameterType.PARAMETER_STRING:
            return text
        if kind == ParameterType.PARAMETER_DOUBLE:
            return number(text)
        if kind == ParameterType.PARAMETER_INTEGER:
            return whole_number(text)
        if kind == ParameterType.PARAMETER_BOOL:
            return _BOOLEANS[text.lower()]
    except (KeyError, ValueError):
        allowed = {
            ParameterType.PARAMETER_DOUBLE: "a number",
            ParameterType.PARAMETER_INTEGER: "a whole number",
            ParameterType.PARAMETER_BOOL: "true or false",
        }
        raise ParameterError(f"{descriptor.name} is {text!r}; allowed: {allowed[kind]}") from None
    return parse_yaml(text, descriptor.name)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Show and change the parameters of a node. Several values in one call are set together: "
        "all of them or none. Without a parameter, list those of the node; without a node, list the nodes.",
        epilog="exit code: 0 on success, 1 when the node refused the values, 2 for a mistake in the "
        "arguments or a node that is not there",
    )
    add_graph_options(parser)
    parser.add_argument(
        "parameters",
        nargs="*",
        metavar="NAME[=VALUE]",
        help="parameter to show, or with a value to set; a whole number is accepted for a float",
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Show or change parameters.

    Returns:
        0 on success, 1 when the node refused the values, 2 after a mistake of the user.
    """
    options = build_parser().parse_args(arguments)
    return ask(
        PROGRAM,
        options,
        lambda client, node: _run(NodeParameters(client, node), options.parameters),
    )


def _run(parameters: NodeParameters, given: Sequence[str]) -> int:
    texts = {name: text for name, sign, text in (part.partition("=") for part in given) if sign}
    if texts:
        successful, reason = parameters.change(texts)
        if not successful:
            print(f"{PROGRAM}: {reason}", file=sys.stderr)
            return EXIT_REFUSED
    names = [part.partition("=")[0] for part in given] or list(parameters.descriptors)
    for name, value in parameters.values(names).items():
        descriptor = parameters.descriptors[name]
        fixed = ", read-only" if descriptor.read_only and not texts else ""
        about = f"    # {descriptor.description}{fixed}" if descriptor.description else ""
        print(f"{name}={_shown(value)}{about}")
    return EXIT_OK


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


if __name__ == "__main__":
    sys.exit(main())
