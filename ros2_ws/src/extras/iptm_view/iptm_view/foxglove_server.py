"""Passes messages on to Foxglove and Lichtblick as they are: CDR bytes, with the definition of their type.

The library (`foxglove-sdk`) is an extra; without it the page works all the same. It answers every WebSocket
handshake, so any web page that is open in a browser on this machine could read a run. A gate in front of it
admits applications on this machine and known web pages, nothing else: it checks the headers `Host` (against a
foreign name that resolves to this machine) and `Origin` (against foreign pages) of a handshake, then forwards
the connection as it is.
"""

from __future__ import annotations

import asyncio
import importlib
import secrets
import sys
import threading
import time
from collections import Counter
from collections.abc import Collection
from contextlib import closing, suppress
from typing import Any
from urllib.parse import urlsplit

from iptm_core.errors import ViewError
from iptm_ros.recording.message_types import SCHEMA_ENCODING, message_definition

LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
KNOWN_ORIGINS = frozenset({"https://app.foxglove.dev", "file://"})
"""Foxglove in the browser, and desktop applications; pages served by this machine are admitted too."""
MAX_CLIENTS = 32
_HANDSHAKE_BYTES = 16_384
_HANDSHAKE_TIMEOUT_S = 10.0
_CHUNK_BYTES = 65_536
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


class FoxgloveGate:
    """Listens on the public port and forwards admitted connections, in a thread of its own."""

    def __init__(
        self, host: str, port: int, server: tuple[str, int], origins: Collection[str] = ()
    ) -> None:
        """Start listening.

        Raises:
            ViewError: the port is taken or not allowed.
        """
        self._server = server
        self._origins = KNOWN_ORIGINS.union(origin.rstrip("/") for origin in origins)
        self._clients: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        try:
            listening = self._loop.run_until_complete(
                asyncio.start_server(self._serve, host, port, limit=_HANDSHAKE_BYTES)
            )
        except (OSError, OverflowError) as error:
            self._loop.close()
            raise ViewError(
                f"port of the Foxglove server is {port} ({error}); allowed: a free port from 1024 to 65535"
            ) from None
        self.port: int = listening.sockets[0].getsockname()[1]
        self._listening = listening
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening and disconnect all clients."""
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _stop(self) -> None:
        self._listening.close()
        for client in self._clients:
            client.cancel()
        await asyncio.gather(*self._clients, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None or len(self._clients) >= MAX_CLIENTS:
            writer.close()
            return
        self._clients.add(task)
        try:
            with (
                closing(writer),
                suppress(OSError, EOFError, ValueError, asyncio.LimitOverrunError),
            ):
                await self._forward(reader, writer)
        finally:
            self._clients.discard(task)

    async def _forward(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        request = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HANDSHAKE_TIMEOUT_S)
        if not is_admitted(request, self._origins):
            writer.write(_REFUSAL)
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection(*self._server)
        with closing(inner_writer):
            inner_writer.write(request)
            ways = [
                asyncio.create_task(_copy(reader, inner_writer)),
                asyncio.create_task(_copy(inner_reader, writer)),
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)


def is_admitted(request: bytes, origins: Collection[str]) -> bool:
    """Return whether a WebSocket handshake names this machine and comes from an admitted page.

    Args:
        request: request line and headers.
        origins: pages to admit besides those served by this machine. A client that is not a browser has none.
    """
    headers: dict[str, list[str]] = {}
    for line in request.decode("latin-1").split("\r\n")[1:]:
        name, _, value = line.partition(":")
        headers.setdefault(name.strip().lower(), []).append(value.strip())
    hosts, sources = headers.get("host", []), headers.get("origin", [])
    if len(hosts) != 1 or len(sources) > 1 or _host_name(f"//{hosts[0]}") not in LOCAL_NAMES:
        return False
    return not sources or sources[0] in origins or _host_name(sources[0]) in LOCAL_NAMES


def _host_name(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    # Waits while the other side does not read, so a stalled viewer costs no memory here.
    while data := await reader.read(_CHUNK_BYTES):
        writer.write(data)
        await writer.drain()


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
