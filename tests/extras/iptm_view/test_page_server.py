"""The web server of the page: content, access control, and the cost of a stalled browser."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from urllib.parse import urlsplit

import pytest
from tests.waiting import wait_until

from iptm_core.errors import ViewError
from iptm_view.page_feed import PageFeed
from iptm_view.page_server import MAX_CONNECTIONS, PAGE, PageServer

TIMEOUT_S = 120.0


@pytest.fixture
def feed() -> PageFeed:
    return PageFeed()


@pytest.fixture
def server(feed: PageFeed) -> Iterator[PageServer]:
    server = PageServer({"": feed}, 0)
    yield server
    server.close()


def get(
    server: PageServer, path: str, method: str = "GET", **headers: str
) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=TIMEOUT_S)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.headers, answer.read()
    connection.close()
    return found


def test_every_file_of_the_page_is_served_and_may_load_nothing_else(server: PageServer) -> None:
    for file in PAGE.iterdir():
        status, headers, content = get(server, f"/{file.name}")
        assert (status, content) == (200, file.read_bytes())
        assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert get(server, "/")[2] == (PAGE / "index.html").read_bytes()


def test_head_answers_as_get_without_content(server: PageServer) -> None:
    whole = get(server, "/view.js")
    status, headers, content = get(server, "/view.js", method="HEAD")
    assert (status, content) == (200, b"")
    assert headers["Content-Length"] == str(len(whole[2]))
    assert get(server, "/none.html", method="HEAD")[0] == 404


def test_half_requests_are_limited(server: PageServer) -> None:
    """Each open connection costs a thread; beyond the limit one is closed instead of answered."""
    before = threading.active_count()
    address = urlsplit(server.url)
    with ExitStack() as stack:
        for _ in range(2 * MAX_CONNECTIONS):
            half = socket.create_connection((address.hostname, address.port), timeout=TIMEOUT_S)
            stack.enter_context(half).sendall(b"GET / HT")
        with socket.create_connection((address.hostname, address.port), timeout=TIMEOUT_S) as last:
            assert last.recv(1) == b""
        assert threading.active_count() <= before + MAX_CONNECTIONS
    wait_until(lambda: threading.active_count() <= before)
    assert get(server, "/")[0] == 200


@pytest.mark.parametrize(
    "path", ["/../page_server.py", "/none.html", "//etc/passwd", "/%2e%2e/cli.py"]
)
def test_nothing_else_is_served(server: PageServer, path: str) -> None:
    assert get(server, path)[0] == 404


def test_a_name_that_was_pointed_at_this_machine_gets_nothing(server: PageServer) -> None:
    assert get(server, "/", Host="evil.example")[0] == 403
    assert server.url.startswith("http://127.0.0.1:")


@contextmanager
def listening(server: PageServer, path: str) -> Iterator[Callable[[str], object]]:
    """Follow the events of a path; yield what waits for the next one of a kind."""
    connection = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=TIMEOUT_S)
    connection.request("GET", path)
    answer = connection.getresponse()
    assert answer.headers["Content-Type"].startswith("text/event-stream")

    def next_event(kind: str) -> object:
        while answer.readline() != f"event: {kind}\n".encode():
            pass
        return json.loads(answer.readline().decode().removeprefix("data: "))

    yield next_event
    answer.close()
    connection.close()


def test_events_arrive_as_they_happen(server: PageServer, feed: PageFeed) -> None:
    feed.put("facts", {"title": "Fahrt, 35 °C"})
    with listening(server, "/events") as next_event:
        assert next_event("facts") == {"title": "Fahrt, 35 °C"}
        feed.append("rows", [1.0, 0.1 + 0.2])
        assert next_event("rows") == [[1.0, 0.1 + 0.2]]
        assert server.browsers == 1


def test_browsers_are_told_when_the_server_closes(feed: PageFeed) -> None:
    """They stop then, instead of asking a closed port for ever."""
    server = PageServer({"": feed}, 0)
    with listening(server, "/events") as next_event:
        next_event("trip")
        closing = threading.Thread(target=server.close)
        closing.start()
        assert next_event("closing") == {}
        closing.join(TIMEOUT_S)
    assert not closing.is_alive()


def test_of_several_vehicles_the_one_that_is_named_is_told_of() -> None:
    feeds = {"car_1": PageFeed(), "car_2": PageFeed()}
    server = PageServer(feeds, 0)
    for number, feed in enumerate(feeds.values(), start=1):
        feed.append("rows", [float(number)])
    names = list(feeds)
    for path, shown in (("/events", "car_1"), ("/events?vehicle=car_2", "car_2")):
        with listening(server, path) as next_event:
            assert next_event("vehicles") == {"names": names, "shown": shown}
            assert next_event("rows") == [[1.0 + names.index(shown)]]
    assert get(server, "/events?vehicle=car_3")[0] == 404
    server.close()


def test_a_browser_that_stops_reading_holds_up_nobody(server: PageServer, feed: PageFeed) -> None:
    host, port = urlsplit(server.url).netloc.split(":")
    with socket.create_connection((host, int(port)), timeout=TIMEOUT_S) as stalled:
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.sendall(f"GET /events HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        wait_until(lambda: server.browsers == 1)
        # Far more than the kernel buffers for a socket, without a reader.
        plan = {"speed_m_s": [0.123456789] * 2000}
        for k in range(3000):
            feed.append("rows", [float(k)] * 22)
            feed.put("plan", {**plan, "k": k})
        assert get(server, "/")[0] == 200
        assert feed.row_count == 3000


def test_a_named_port_that_is_taken_is_refused(server: PageServer, feed: PageFeed) -> None:
    port = int(urlsplit(server.url).port or 0)
    with pytest.raises(ViewError, match=f"port of the page is {port} .*allowed"):
        PageServer({"": feed}, port)
    with pytest.raises(ViewError, match="99999"):
        PageServer({"": feed}, 99999)
