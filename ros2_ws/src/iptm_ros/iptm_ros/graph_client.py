"""Find nodes on the graph and call their services, for programs that ask one question and end."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, TypeVar

import rclpy
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from iptm_core.errors import ServiceError
from iptm_core.user_input import suggestion
from iptm_ros.discovery import middleware_settings

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
LARGEST_DOMAIN = 232
_POLL_S = 0.05
_SETTLED_S = 1.2
"""A list of names on the graph is complete once it has not changed for this long."""


_Names = TypeVar("_Names")


class GraphClient(AbstractContextManager["GraphClient"]):
    """A hidden node that finds other nodes by name and waits for their answers.

    Use it as a context manager, in the main thread of a program.

    Attributes:
        node: creates the clients of services.
        domain: ROS domain whose nodes it sees.
        timeout_s: how long to wait for a node to appear, and for each answer.
    """

    def __init__(self, domain: int | None, timeout_s: float) -> None:
        given = domain if domain is not None else os.environ.get(DOMAIN_VARIABLE) or 0
        try:
            self.domain = int(given)
        except ValueError:
            self.domain = -1
        if not 0 <= self.domain <= LARGEST_DOMAIN:
            raise ServiceError(f"ROS domain is {given}; allowed: 0 to {LARGEST_DOMAIN}")
        self.timeout_s = timeout_s
        os.environ.update(middleware_settings())
        self._context = Context()
        rclpy.init(
            args=[],
            context=self._context,
            domain_id=self.domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.node = Node(
            f"_iptm_client_{os.getpid()}",
            context=self._context,
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def nodes(self) -> list[str]:
        """Return the full names of the visible nodes, once discovery has settled."""
        self.wait(self._names)
        return self._settled(self._names)

    def find(self, name: str) -> str:
        """Wait for a node and return its full name.

        Args:
            name: full name, `/car_1/plant`, or its end, `plant` or `car_1/plant`, where only one node has it.

        Raises:
            ServiceError: no node or several nodes have the name.
        """
        absolute = "/" + name.strip("/")
        self.wait(lambda: any(full.endswith(absolute) for full in self._names()))
        # Another node whose name ends alike may be discovered a moment later.
        names = self._names()
        names = names if absolute in names else self._settled(self._names)
        if absolute in names:
            return absolute
        found = [full for full in names if full.endswith(absolute)]
        if len(found) == 1 and not name.startswith("/"):
            return found[0]
        if found:
            raise ServiceError(f"node is {name!r}; allowed: {', '.join(found)}")
        there = suggestion(name, names)
        hint = "; --domain or ROS_DOMAIN_ID chooses the domain of the run"
        raise ServiceError(
            f"no node {name!r} in ROS domain {self.domain} after {self.timeout_s:g} s; "
            + (there if names else f"allowed: none, no node runs there{hint}")
        )

    def services(self, node: str, type_name: str, wanted: str | None = None) -> Mapping[str, str]:
        """Return the services of a type that a node offers, once discovery has settled.

        Args:
            node: full name.
            type_name: such as `std_srvs/srv/Trigger`.
            wanted: base name of the only service that matters, if there is one; it need not settle.

        Returns:
            Full name by base name, `/plant/pause` by `pause`.
        """
        space, _, base = node.rpartition("/")

        def listed() -> list[str]:
            offered = self.node.get_service_names_and_types_by_node(base, space or "/")
            return sorted(name for name, types in offered if type_name in types)

        # A node is visible before its services are, a starting one for seconds.
        self.wait(listed)
        private = f"{node}/{wanted}"
        names = [private] if private in listed() else self._settled(listed)
        # A private name (`~/pause`) takes precedence over an alias outside of the node.
        names.sort(key=lambda name: name.startswith(f"{node}/"))
        return {name.rpartition("/")[2]: name for name in names}

    def wait(self, condition: Callable[[], object]) -> bool:
        """Wait until a condition holds; return whether it does before the timeout."""
        deadline = time.monotonic() + self.timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=_POLL_S)
        return True

    def call(self, client: Client, request: Any, server: str) -> Any:
        """Call a service and return the response."""
        if not self.wait(client.service_is_ready):
            raise ServiceError(f"{server} cannot be reached within {self.timeout_s:g} s")
        return self.answer(client.call_async(request), server)

    def answer(self, future: Future, server: str) -> Any:
        """Wait for the response of a call under way."""
        if not self.wait(future.done):
            raise ServiceError(f"{server} does not answer within {self.timeout_s:g} s")
        return future.result()

    def _settled(self, read: Callable[[], _Names]) -> _Names:
        """Return names on the graph once they have not changed for a while."""
        seen, since = read(), time.monotonic()
        deadline = since + self.timeout_s
        while (now := time.monotonic()) < deadline and now - since < _SETTLED_S:
            time.sleep(_POLL_S)
            if (names := read()) != seen:
                seen, since = names, now
        return seen

    def _names(self) -> list[str]:
        """Return the full names of the nodes known now, without hidden ones."""
        listed = self.node.get_node_names_and_namespaces()
        return sorted(
            f"{space.rstrip('/')}/{name}" for name, space in listed if not name.startswith("_")
        )
