"""Passes messages on to Foxglove and Lichtblick as they are: CDR bytes, with the definition of their type.

The library (`foxglove-sdk`) is an extra; without it the page works all the same.
"""

from __future__ import annotations

import importlib
import secrets
import sys
import threading
import time
from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from typing import Any

from iptm_core.errors import ViewError
from iptm_recording.message_types import SCHEMA_ENCODING, message_definition
from iptm_view.foxglove_gate import FoxgloveGate

HOST = "127.0.0.1"
DEFAULT_PORT = 8765
BACKLOG = 1024
"""Messages queued for one client at most; the oldest are dropped."""

NOT_INSTALLED = (
    "foxglove-sdk is not installed, so the server for Foxglove and Lichtblick is off; to enable it: "
    ".venv/bin/python -m pip install --require-hashes -r requirements/view.txt"
)


class FoxgloveServer:
    """A server on this machine with one channel for every topic.

    Attributes:
        url: address for a viewer.
    """

    def __init__(self, name: str, port: int | None = None, origins: Collection[str] = ()) -> None:
        """Start serving.

        Raises:
            ViewError: the library is not installed, or the named port is taken.
        """
        try:
            self._library: Any = importlib.import_module("foxglove")
        except ImportError:
            raise ViewError(NOT_INSTALLED) from None
        self._listener = _Listener()
        self._context = self._library.Context()
        self._server_host = _unguessable_address()
        self._server = self._library.start_server(
            name=name,
            host=self._server_host,
            port=0,
            server_listener=self._listener,
            message_backlog_size=BACKLOG,
            context=self._context,
        )
        try:
            self._gate = self._open_gate(port, origins)
        except ViewError:
            self._server.stop()
            raise
        self._channels: dict[str, Any] = {}
        self._latched: dict[str, bytes] = {}
        self.url = f"ws://{HOST}:{self._gate.port}"

    def _open_gate(self, port: int | None, origins: Collection[str]) -> FoxgloveGate:
        server = (self._server_host, int(self._server.port))
        if port is None:
            with suppress(ViewError):
                return FoxgloveGate(HOST, DEFAULT_PORT, server, origins)
        return FoxgloveGate(HOST, port or 0, server, origins)

    @property
    def wanted(self) -> Collection[str]:
        """Topics that a client is subscribed to at present."""
        return self._listener.wanted()

    @property
    def topics(self) -> Collection[str]:
        """Topics that clients are offered."""
        return self._channels.keys()

    def offer(self, topic: str, type_name: str) -> None:
        """Offer a topic to clients; a second call is free."""
        if topic in self._channels:
            return
        definition = message_definition(type_name)
        schema = self._library.Schema(
            name=type_name, encoding=SCHEMA_ENCODING, data=definition.text.encode()
        )
        self._channels[topic] = self._library.Channel(
            topic, message_encoding="cdr", schema=schema, context=self._context
        )

    def take(self, topic: str, data: bytes, *, is_latched: bool = False) -> None:
        """Pass one message on to the subscribed clients; never waits for a client.

        Args:
            topic: an offered topic; messages of others are dropped.
            data: CDR bytes.
            is_latched: keep it for clients that subscribe later.
        """
        channel = self._channels.get(topic)
        if channel is None:
            return
        channel.log(data, log_time=time.time_ns())
        if is_latched:
            self._latched[topic] = data

    def serve_latecomers(self) -> None:
        """Send latched messages again where a client has subscribed since; call it now and then."""
        for topic in self._listener.new_subscriptions():
            if topic in self._latched:
                self._channels[topic].log(self._latched[topic], log_time=time.time_ns())

    def close(self) -> None:
        """Disconnect all clients."""
        self._gate.close()
        self._server.stop()


def _unguessable_address() -> str:
    """Return a loopback address that no web page can guess, where all of 127/8 is the loopback (Linux)."""
    if sys.platform != "linux":
        return HOST
    return f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(256)}.{secrets.randbelow(254) + 1}"


class _Listener:
    """Notes who is subscribed to what; called from threads of the library."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._clients: Counter[str] = Counter()
        self._new: set[str] = set()

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        with self._lock:
            self._clients[channel.topic] += 1
            self._new.add(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        with self._lock:
            self._clients[channel.topic] -= 1

    def wanted(self) -> set[str]:
        with self._lock:
            return {topic for topic, count in self._clients.items() if count > 0}

    def new_subscriptions(self) -> set[str]:
        with self._lock:
            new, self._new = self._new, set()
            return new
