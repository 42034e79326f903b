"""The life of a node process: start, spin, stop, and the exit code.

Errors in callbacks do not end the process; see `iptm_ros.suite_node.SuiteNode.guard`.

| exit code | meaning |
|---|---|
| 0 | stopped by SIGINT or SIGTERM, or finished by itself |
| 1 | a defect: an unexpected error at the start or outside of all callbacks |
| 2 | a mistake of the user (parameter, file, argument): one line on stderr, no traceback |
"""

from __future__ import annotations

import gc
import os
import sys
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TypeVar

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, StopRequest, print_error, refused
from iptm_ros.discovery import middleware_settings
from iptm_ros.publishers import PATIENCE_S
from iptm_ros.suite_node import SuiteNode

AnyNode = TypeVar("AnyNode", bound=Node)

EXIT_DEFECT = 1
_LOOK_PERIOD_S = 0.02
"""Between two looks for a request to stop."""
_USER_ERRORS = (
    IptmError,
    NameValidationException,
    ParameterException,
    rclpy_implementation.RCLError,
    rclpy_implementation.UnknownROSArgsError,
)


def run_node(
    factory: Callable[[], SuiteNode],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run one node, see `run_nodes`: `sys.exit(run_node(BridgeNode))`."""
    return run_nodes([[factory]], arguments)


def run_nodes(
    factories: Sequence[Sequence[Callable[[], SuiteNode]]], arguments: Sequence[str] | None = None
) -> int:
    """Run groups of nodes with one executor; return the exit code of the process.

    A group has finished with its first node. The process ends when all groups have, or the first one with an
    exit code other than 0, which it takes over. Call it from the main thread, once per process.

    Args:
        factories: build the nodes of each group; an `IptmError` from here is a mistake of the user.
        arguments: command line with the program name; None takes the one of the process.
    """
    command = list(sys.argv if arguments is None else arguments)
    program = Path(command[0]).stem if command else "node"
    program = Path(command[0]).parent.name if program in {"__main__", "node"} else program
    stop = StopRequest()
    stop.install()
    # As well where no script has prepared the shell: under `ros2 run` and `ros2 launch`.
    os.environ.update(middleware_settings())
    groups: list[list[SuiteNode]] = []
    try:
        rclpy.init(args=command, signal_handler_options=SignalHandlerOptions.NO)
        for group in factories:
            groups.append([])
            groups[-1].extend(factory() for factory in group)
        for node in chain.from_iterable(groups):
            node.reject_unknown_parameters()
    except _USER_ERRORS as error:
        code = refused(program, error)
    except Exception:  # noqa: BLE001  the last line of defence of the process
        get_logger(program).fatal("unexpected error at start:\n" + traceback.format_exc())
        code = EXIT_DEFECT
    else:
        return _spin(groups, stop, program)
    rclpy.try_shutdown()
    for node in chain.from_iterable(groups):
        node.destroy_node()
    gc.collect()  # a node that was half built is in the graph, with files in shared memory, until then
    return code


@contextmanager
def joined_nodes(
    factories: Sequence[Callable[[Context], AnyNode]], domain: int | None = None
) -> Iterator[tuple[tuple[AnyNode, ...], EventsExecutor]]:
    """Take part in a domain with nodes in a context of their own; the caller spins them and handles signals.

    Args:
        factories: build the nodes.
        domain: ROS domain, None for the one of the environment.
    """
    context = Context()
    rclpy.init(
        args=[],
        context=context,
        domain_id=domain,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        nodes = tuple(factory(context) for factory in factories)
        executor = EventsExecutor(context=context)
        for node in nodes:
            executor.add_node(node)
        try:
            yield nodes, executor
        finally:
            _take_off(executor, nodes)
    finally:
        context.try_shutdown()


@contextmanager
def joined_node(
    factory: Callable[[Context], AnyNode], domain: int | None = None
) -> Iterator[tuple[AnyNode, EventsExecutor]]:
    """Take part in a domain with one node, see `joined_nodes`."""
    with joined_nodes([factory], domain) as ((node,), executor):
        yield node, executor


def _take_off(executor: EventsExecutor, nodes: Collection[Node]) -> None:
    """End executor and nodes when listeners have received the last messages.

    The executor ends first: it gives up the events of publishers late, which must exist until then.
    """
    until_s = time.monotonic() + PATIENCE_S
    for node in nodes:
        for publisher in node.publishers if node.context.ok() else ():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, until_s - time.monotonic())))
    executor.shutdown()
    for node in nodes:
        node.destroy_node()


def _spin(groups: Sequence[Sequence[SuiteNode]], stop: StopRequest, program: str) -> int:
    # Modules and codecs stay: a full collection through all of them would hold up a tick by 50 ms or more.
    gc.freeze()
    executor = EventsExecutor()
    nodes = list(chain.from_iterable(groups))
    for node in nodes:
        executor.add_node(node)
    running, code = [group[0] for group in groups], EXIT_OK
    try:
        while rclpy.ok() and running and not code:
            if stop.is_set:
                for node in nodes:
                    node.stop()
            executor.spin_until_future_complete(running[0].ended, _LOOK_PERIOD_S)
            code = max((node.exit_code for node in running if node.ended.done()), default=EXIT_OK)
            running = [node for node in running if not node.ended.done()]
    except ExternalShutdownException:
        code = max(node.exit_code for node in running)
    except Exception as error:  # noqa: BLE001  the last line of defence of the process
        # The executor has logged the traceback already.
        print_error(program, f"stopped by an unexpected {type(error).__name__}: {error}")
        code = EXIT_DEFECT
    finally:
        _take_off(executor, nodes)
        rclpy.try_shutdown()
        stop.end()
        gc.freeze()  # the end of the process need not look through all objects
    return code
