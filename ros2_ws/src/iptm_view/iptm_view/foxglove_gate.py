"""Admits viewers to the Foxglove server: applications on this machine and known web pages, nothing else.

The library answers every WebSocket handshake, so any web page that is open in a browser on this machine could
read a run. The gate checks the headers `Host` (against a foreign name that resolves to this machine) and
`Origin` (against foreign pages) of a handshake, then forwards the connection as it is.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Collection
from contextlib import closing, suppress
from urllib.parse import urlsplit

from iptm_core.errors import ViewError

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
