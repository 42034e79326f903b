"""Passes messages on to Foxglove and Lichtblick as they are: CDR bytes, with the definition of their type.

The library (`foxglove-sdk`) is an extra; without it the page works all the same.
"""

from __future__ import annotations

import importlib
import threading
import time
from collections import Counter
from collections.abc import Collection
from typing import Any

from iptm_core.errors import ViewError
from iptm_recording.message_types import SCHEMA_ENCODING, message_definition

HOST = "127.0.0.1"
DEFAULT_PORT = 8765
BACKLOG = 1024
"""Messages that wait for one client at most; the oldest are dropped."""

NOT_INSTALLED = (
    "foxglove-sdk is not installed, so there is no server for Foxglove and Lichtblick; to have one: "
    ".venv/bin/python -m pip install --require-hashes -r requirements/view.txt"
)


class FoxgloveServer:
    """A server on this machine with one channel for every topic.

    Attributes:
        url: address for a viewer.
    """

    def __init__(self, name: str, port: int | None = None) -> None:
        """Start serving.

        Args:
            name: what a viewer shows as the name of the source.
            port: port on this machine; None for the usual one, or a free one where it is taken.

        Raises:
            ViewError: the library is not installed, or the named port is taken.
        """
        try:
            self._library: Any = importlib.import_module("foxglove")
        except ImportError:
            raise ViewError(NOT_INSTALLED) from None
        self._listener = _Listener()
        self._context = self._library.Context()
        self._server = self._start(name, port)
        self._channels: dict[str, Any] = {}
        self._latched: dict[str, bytes] = {}
        self.url = f"ws://{HOST}:{self._server.port}"

    def _start(self, name: str, port: int | None) -> Any:
        if port is None:
            try:
                return self._start(name, DEFAULT_PORT)
            except ViewError:
                return self._start(name, 0)
        try:
            return self._library.start_server(
                name=name,
                host=HOST,
                port=port,
                server_listener=self._listener,
                message_backlog_size=BACKLOG,
                context=self._context,
            )
        except (OSError, RuntimeError, OverflowError) as error:
            raise ViewError(
                f"port of the Foxglove server is {port} ({error}); allowed: a free port from 1024 to 65535"
            ) from None

    @property
    def wanted(self) -> Collection[str]:
        """Topics that a client is subscribed to at present."""
        return self._listener.wanted()

    @property
    def topics(self) -> Collection[str]:
        """Topics that clients are offered."""
        return self._channels.keys()

    def offer(self, topic: str, type_name: str) -> None:
        """Offer a topic to clients; a second call is free.

        Raises:
            BagError: the type is not known.
        """
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
        """Pass one message on to whoever is subscribed; never waits for a client.

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
        """Let all clients go."""
        self._server.stop()


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
