"""The life of the process that shows a run."""

from __future__ import annotations

import argparse
import os
import sys
import time
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from iptm_core.errors import IptmError, ViewError
from iptm_core.program import EXIT_OK, StopRequest, refused
from iptm_ros.discovery import middleware_settings
from iptm_ros.recording.run_information import load_run_information
from iptm_view.foxglove_server import FoxgloveServer
from iptm_view.graph_subscriptions import listening_node
from iptm_view.judged_feed import JudgedFeed
from iptm_view.options import PROGRAM
from iptm_view.page_server import PageServer, save_page
from iptm_view.reference_car import NO_REFERENCE, ReferenceCar, put_stored_run
from iptm_view.run_facts import RunFacts
from iptm_view.sources import NAME, BagSource, GraphSource

_POLL_S = 0.1
_FRAME_S = 0.1
"""Time between two looks at the graph: the page is not fed more often, however fast the run is."""
_NICENESS = 10
"""Lowers the priority of the view below the run's."""


def show(
    parsed: argparse.Namespace, command: list[str], reference_command: Sequence[str] = ()
) -> int:
    """Show a run until a signal stops it.

    Args:
        parsed: options of `iptm_view.options`.
        command: command line with the program's name, for the arguments of ROS.
        reference_command: drives the reference car, see `ReferenceCar`; empty for no such car.

    Returns:
        0 when stopped, 2 after a mistake of the user.
    """
    try:
        stop = StopRequest()
        stop.install()
        with _Servers(parsed, _vehicles(parsed), reference_command) as servers:
            if parsed.bag is None:
                _show_graph(parsed, command, servers, stop)
            else:
                _show_bag(parsed, servers, stop)
    except IptmError as error:
        return refused(PROGRAM, error)
    return EXIT_OK


def _vehicles(parsed: argparse.Namespace) -> list[str]:
    """Return the namespaces to show, without slashes around them; "" for none."""
    vehicles = list(dict.fromkeys(name.strip("/") for name in parsed.namespace)) or [""]
    if parsed.bag is not None and len(vehicles) > 1:
        raise ViewError(f"--namespace is {', '.join(vehicles)}; allowed: one with a bag")
    if parsed.save is not None and parsed.bag is None:
        raise ViewError(f"--save is {parsed.save}; allowed: with a bag")
    if parsed.afterwards and len(parsed.afterwards) != len(vehicles):
        given = ", ".join(map(str, parsed.afterwards))
        raise ViewError(f"--afterwards is {given}; allowed: one for each --namespace")
    return vehicles


class _Servers(AbstractContextManager["_Servers"]):
    """Page, Foxglove server and reference car of one view."""

    def __init__(
        self,
        parsed: argparse.Namespace,
        vehicles: Sequence[str],
        reference_command: Sequence[str],
    ) -> None:
        self.feeds = {vehicle: JudgedFeed() for vehicle in vehicles}
        self.feed = self.feeds[vehicles[0]]
        self.foxglove, self._note = _start_foxglove(parsed)
        # The trip that a reference would drive is that behind the driving cycle.
        strategy = parsed.against if len(vehicles) == 1 else NO_REFERENCE
        if Path(strategy).exists():
            put_stored_run(self.feed, Path(strategy))
            strategy = NO_REFERENCE
        self._reference = ReferenceCar(self.feed, reference_command, strategy)
        self._page = PageServer(self.feeds, parsed.port)
        print(f"{PROGRAM}: {self._page.url}", flush=True)
        if self.foxglove is not None:
            print(f"{PROGRAM}: Foxglove or Lichtblick: {self.foxglove.url}", flush=True)
        if not parsed.no_browser and _is_desktop():
            webbrowser.open(self._page.url)

    def __exit__(self, *error: object) -> None:
        self._reference.close()
        self._page.close()
        if self.foxglove is not None:
            self.foxglove.close()

    @property
    def is_computing(self) -> bool:
        """Whether the reference car is still being driven."""
        return self._reference.is_computing

    def complete(self, facts: RunFacts) -> RunFacts:
        """Add the facts of this view to the facts of a run, and start the reference car once."""
        self.feed.parameters = facts.parameters
        if self.foxglove is not None:
            facts = replace(facts, foxglove=self.foxglove.url)
        if self._note:
            facts = facts.with_note(self._note)
        return self._reference.start(facts) if facts.is_complete else facts


def _start_foxglove(parsed: argparse.Namespace) -> tuple[FoxgloveServer | None, str]:
    """Return the server, or why there is none."""
    if parsed.no_foxglove:
        return None, ""
    try:
        return FoxgloveServer("iptm", parsed.foxglove_port, parsed.foxglove_origin), ""
    except ViewError as error:
        if parsed.foxglove_port is not None:
            raise
        return None, str(error)


def _is_desktop() -> bool:
    return sys.platform == "darwin" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _show_bag(parsed: argparse.Namespace, servers: _Servers, stop: StopRequest) -> None:
    def wait(seconds: float) -> bool:
        time.sleep(seconds)
        return stop.is_set

    (namespace,) = servers.feeds
    foxglove = servers.foxglove
    with BagSource(parsed.bag, parsed.rate, parsed.start, namespace or None) as source:
        source.load(servers.feed, servers.complete(source.facts), wait)
        if parsed.save is not None:
            while servers.is_computing:
                if wait(_POLL_S):
                    return
            save_page(servers.feed, parsed.save)
            return
        if foxglove is not None:
            source.play(foxglove, wait)
    while not wait(_POLL_S):
        if foxglove is not None:
            foxglove.serve_latecomers()


def _show_graph(
    parsed: argparse.Namespace, command: list[str], servers: _Servers, stop: StopRequest
) -> None:
    _let_runs_go_first()
    file = parsed.run_information
    information = None if file is None else load_run_information(file)
    with _ros(command):
        sources = [
            GraphSource(
                _node_in(namespace),
                feed,
                servers.foxglove,
                servers.complete,
                information,
                bag,
                passes_global=feed is servers.feed,
            )
            for (namespace, feed), bag in zip_longest(servers.feeds.items(), parsed.afterwards)
        ]
        while not stop.is_set:
            time.sleep(_FRAME_S)
            for source in sources:
                source.look()
        for source in sources:
            source.close()


def _let_runs_go_first() -> None:
    os.nice(_NICENESS)
    # Where Linux groups processes by session (autogroup), a niceness counts inside a session only.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICENESS), encoding="ascii")


def _node_in(namespace: str) -> Node:
    try:
        return listening_node(NAME, namespace)
    except NameValidationException as error:
        reason = " ".join(str(error).split())
        raise ViewError(f"namespace is {namespace!r}: {reason}") from None


@contextmanager
def _ros(command: list[str]) -> Iterator[None]:
    os.environ.update(middleware_settings())
    rclpy.init(args=command, signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()
