"""The command line of a node: everything is a ROS argument but `--help`."""

from __future__ import annotations

import inspect
import re
import sys
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import remove_ros_args

from iptm_core.declaration import ParameterSpec, Scalar, parameter_specs, plain
from iptm_core.errors import ParameterError
from iptm_core.program import EXIT_OK, refused

if TYPE_CHECKING:
    from iptm_ros.suite_node import SuiteNode

_WIDTH = 100
_ALLOWED = "-p NAME:=VALUE, --params-file FILE, -r FROM:=TO, --log-level LEVEL"
_PLACE_IN_SOURCE = re.compile(r",? at /\S+:\d+")  # of rcl


def node_main(
    program: str,
    node: type[SuiteNode],
    parameters: type[Any],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run a node as a program, or explain it.

    ROS itself ignores unknown arguments, so that `--help` would start the node and a
    forgotten `--ros-args` would start it without its parameters. Both are caught here.

    Args:
        program: name in the usage line.
        node: class to run, built without arguments; its docstring is the description.
        parameters: dataclass of `parameter` fields that the node declares.
        arguments: command line with the program name; None takes the one of the process.
    """
    command = list(sys.argv if arguments is None else arguments)
    try:
        own = own_arguments(command)
    except ParameterError as error:
        return refused(program, error)
    if "-h" in own or "--help" in own:
        print(help_text(program, inspect.getdoc(node) or "", parameter_specs(parameters)))
        return EXIT_OK
    if own:
        allowed = f"--help, and behind --ros-args {_ALLOWED}"
        return refused(program, f"argument {own[0]!r} is unknown; allowed: {allowed}")
    from iptm_ros.process import run_node  # noqa: PLC0415  help needs no node

    return run_node(node, command)


def own_arguments(command: Sequence[str]) -> list[str]:
    """Return the arguments of a program without its name and without those for ROS."""
    try:
        return list(remove_ros_args(list(command))[1:])
    except rclpy_implementation.UnknownROSArgsError as error:
        raise ParameterError(f"ROS arguments {error} are unknown; allowed: {_ALLOWED}") from None
    except (RuntimeError, ValueError, TypeError) as error:  # the errors of rcl are RuntimeErrors
        reason = _PLACE_IN_SOURCE.sub("", " ".join(str(error).split()))
        raise ParameterError(f"{reason or type(error).__name__}; allowed: {_ALLOWED}") from None


def help_text(program: str, description: str, specs: Sequence[ParameterSpec]) -> str:
    """Return usage, description and parameters for a terminal."""
    lines = [
        f"usage: {program} [--help] [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO]]",
        "",
        *description.splitlines(),
        "",
        "parameters:",
    ]
    for spec in specs:
        unit = f" {spec.unit}" if spec.unit else ""
        lines.append(f"  {spec.name} (default: {_shown(plain(spec.default))}{unit})")
        text = f"{spec.description}; {spec.allowed}"
        lines += textwrap.wrap(text, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return "\n".join(lines)


def _shown(default: Scalar) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    return repr(default)
