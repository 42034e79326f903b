"""Serves the page: its static files, and what happens as server-sent events; this machine only.

Of several vehicles a browser follows one: `/?vehicle=car_2`. The page of a whole run can be one file, too,
which plays without a server.
"""

from __future__ import annotations

import re
import threading
import time
from base64 import b64encode
from collections.abc import Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from iptm_core.errors import ViewError
from iptm_view.page_feed import Cursor, PageEvent, PageFeed, json_text

HOST = "127.0.0.1"
DEFAULT_PORT = 8780
MAX_BROWSERS = 32
MAX_CONNECTIONS = 96
"""Open connections, event streams included; further ones are closed at once."""
FRAME_S = 0.1
"""Shortest time between two messages to a browser."""
KEEP_ALIVE_S = 10.0
REQUEST_TIMEOUT_S = 10.0
"""Disconnect clients that do not complete a request within this time."""
SEND_TIMEOUT_S = 60.0
"""Disconnect browsers that have not read for this long; they reconnect when they read again."""

_CLOSE_TIMEOUT_S = 2.0
_CLOSE_POLL_S = 0.2

PAGE = Path(__file__).parent / "page"
_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
# The page may connect only to this server.
_POLICY = "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


class PageServer:
    """The web server of the page, in threads of its own."""

    def __init__(self, feeds: Mapping[str, PageFeed], port: int | None = None) -> None:
        """Start serving.

        Raises:
            ViewError: the named port is taken or may not be used.
        """
        self._server = _bind(feeds, port)
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.server_address[1]}/"

    @property
    def browsers(self) -> int:
        """Browsers that listen at present."""
        return self._server.browsers

    def close(self) -> None:
        """Stop serving; browsers are informed, so that they do not try to reconnect."""
        self._server.closing.set()
        deadline_s = time.monotonic() + _CLOSE_TIMEOUT_S
        while self.browsers and time.monotonic() < deadline_s:
            time.sleep(_CLOSE_POLL_S)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    # Python would wait for the threads of browsers that hang.
    block_on_close = False
    request_queue_size = 128

    def __init__(self, feeds: Mapping[str, PageFeed], port: int) -> None:
        self.feeds = feeds
        self.closing = threading.Event()
        self.browsers = 0
        self.lock = threading.Lock()
        self._free_connections = threading.BoundedSemaphore(MAX_CONNECTIONS)
        super().__init__((HOST, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread of its own, or close it when there are too many."""
        if self._free_connections.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer a connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free_connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore connections closed by a browser."""


def _bind(feeds: Mapping[str, PageFeed], port: int | None) -> _Server:
    if port is None:
        with suppress(OSError):
            return _Server(feeds, DEFAULT_PORT)
        return _Server(feeds, 0)
    try:
        return _Server(feeds, port)
    except (OSError, OverflowError) as error:
        raise ViewError(
            f"port of the page is {port} ({error}); allowed: a free port from 1024 to 65535"
        ) from None


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: _Server
    protocol_version = "HTTP/1.1"
    timeout = REQUEST_TIMEOUT_S

    def do_HEAD(self) -> None:
        """Answer as to GET, without content."""
        self.do_GET()

    def do_GET(self) -> None:
        """Answer with a file of the page, or with the events."""
        host = self.headers.get("Host", "").rsplit(":", 1)[0]
        # A foreign page must not read the run by a name that resolves to this machine.
        if host not in {HOST, "localhost"}:
            self._refuse(HTTPStatus.FORBIDDEN)
            return
        asked = urlsplit(self.path)
        path = asked.path
        if path == "/events" and self.command == "GET":
            names = parse_qs(asked.query).get("vehicle") or [next(iter(self.server.feeds))]
            if names[0] in self.server.feeds:
                self._tell_events(names[0])
            else:
                self._refuse(HTTPStatus.NOT_FOUND)
            return
        file = PAGE / ("index.html" if path == "/" else path[1:])
        if file.parent != PAGE or file.suffix not in _KINDS or not file.is_file():
            self._refuse(HTTPStatus.NOT_FOUND)
            return
        self._answer(HTTPStatus.OK, _KINDS[file.suffix], file.read_bytes())

    def _refuse(self, status: HTTPStatus) -> None:
        content = f"{status.value} {status.phrase}\n".encode()
        self._answer(status, "text/plain; charset=utf-8", content)

    def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self._head(status, kind, len(content))
        if self.command != "HEAD":
            self.wfile.write(content)

    def _head(self, status: HTTPStatus, kind: str, length: int | None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is None:
            self.send_header("Connection", "close")
            self.close_connection = True
        else:
            self.send_header("Content-Length", str(length))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()

    def _tell_events(self, vehicle: str) -> None:
        with self.server.lock:
            if self.server.browsers >= MAX_BROWSERS:
                is_full = True
            else:
                is_full = False
                self.server.browsers += 1
        if is_full:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)
            return
        self.connection.settimeout(SEND_TIMEOUT_S)
        try:
            self._head(HTTPStatus.OK, "text/event-stream; charset=utf-8", None)
            self._follow(vehicle)
        except OSError:
            pass  # the browser has gone, or takes nothing any more
        finally:
            with self.server.lock:
                self.server.browsers -= 1

    def _follow(self, vehicle: str) -> None:
        feeds, cursor = self.server.feeds, Cursor()
        if len(feeds) > 1:
            choice = json_text({"names": list(feeds), "shown": vehicle})
            self.wfile.write(_as_text(PageEvent("vehicles", choice)).encode())
        said_s = time.monotonic()
        while not self.server.closing.is_set():
            cursor, events = feeds[vehicle].changes(cursor, _CLOSE_POLL_S)
            now_s = time.monotonic()
            if events:
                self.wfile.write("".join(map(_as_text, events)).encode())
            elif now_s - said_s >= KEEP_ALIVE_S:
                self.wfile.write(b": nothing new\n\n")
            else:
                continue
            said_s = now_s
            time.sleep(FRAME_S)
        self.wfile.write(_as_text(PageEvent("closing", "{}")).encode())

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name of the base class
        """Do not log requests."""


def _as_text(event: PageEvent) -> str:
    return f"event: {event.kind}\ndata: {event.text}\n\n"


_MAIN = "view.js"
_IMPORT = re.compile(r'from "\./(\w+)\.js"')


def stored_page(feed: PageFeed) -> str:
    """Return the page with everything that a feed holds, and all the code and styles inside.

    Browsers load no modules from files beside a page, so an import map gives every module as data.
    """
    modules = {
        file.stem: _data("text/javascript", _named(file))
        for file in PAGE.glob("*.js")
        if file.name != _MAIN
    }
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    held = ",".join(f'["{event.kind}",{event.text}]' for event in events).replace("</", r"<\/")
    style = (PAGE / "view.css").read_text(encoding="utf-8")
    icon = _data("image/svg+xml", (PAGE / "icon.svg").read_text(encoding="utf-8"))
    parts = {
        '<link rel="icon" href="icon.svg">': f'<link rel="icon" href="{icon}">',
        '<link rel="stylesheet" href="view.css">': f"<style>{style}</style>",
        f'<script type="module" src="{_MAIN}"></script>': (
            f'<script type="importmap">{json_text({"imports": modules})}</script>\n'
            f'<script type="application/json" id="stored">[{held}]</script>\n'
            f'<script type="module">{_named(PAGE / _MAIN)}</script>'
        ),
    }
    text = (PAGE / "index.html").read_text(encoding="utf-8")
    for linked, inside in parts.items():
        text = text.replace(linked, inside)
    return text


def save_page(feed: PageFeed, path: Path) -> None:
    """Write the page of a feed to a new file.

    Raises:
        ViewError: the file exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(stored_page(feed))
    except FileExistsError:
        raise ViewError(f"{path} exists already; allowed: a new file") from None
    except OSError as error:
        raise ViewError(f"{path} cannot be written: {error.strerror}") from None


def _named(file: Path) -> str:
    """Return a module that imports others by their names in the import map."""
    return _IMPORT.sub(r'from "\1"', file.read_text(encoding="utf-8"))


def _data(kind: str, text: str) -> str:
    return f"data:{kind};base64,{b64encode(text.encode()).decode()}"
