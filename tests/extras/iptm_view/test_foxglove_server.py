"""The Foxglove server: the bytes of the graph, with the definition of their type, to any client."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from iptm_core.errors import ViewError
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.message_types import Decoder, MessageDefinition
from iptm_view import foxglove_server
from iptm_view.foxglove_server import KNOWN_ORIGINS, FoxgloveServer, is_admitted

TIMEOUT_S = 120.0
_MESSAGE = struct.Struct("<BIQ")


@pytest.fixture
def server() -> Iterator[FoxgloveServer]:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (requirements/view.txt)")
    server = FoxgloveServer("test", 0)
    yield server
    server.close()


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ("Host: 127.0.0.1:8765", True),
        ("host: localhost:8765", True),
        ("Host: 127.0.0.1:8765\r\nOrigin: http://localhost:8080", True),
        ("Host: 127.0.0.1:8765\r\nOrigin: https://app.foxglove.dev", True),
        ("Host: 127.0.0.1:8765\r\nOrigin: file://", True),
        ("Host: 127.0.0.1:8765\r\nOrigin: http://evil.example", False),
        ("Host: 127.0.0.1:8765\r\nOrigin: https://app.foxglove.dev.evil.example", False),
        ("Host: 127.0.0.1:8765\r\nOrigin: http://localhost.evil.example", False),
        ("Host: 127.0.0.1:8765\r\nOrigin: http://[::1", False),
        ("Host: 127.0.0.1:8765\r\nOrigin: null", False),
        ("Host: 127.0.0.1:8765\r\nOrigin: file://\r\nOrigin: http://evil.example", False),
        ("Host: evil.example:8765", False),
        ("Host: 127.0.0.1\r\nHost: evil.example", False),
        ("Accept: */*", False),
    ],
)
def test_handshakes_of_foreign_pages_and_names_are_refused(headers: str, expected: bool) -> None:
    request = f"GET / HTTP/1.1\r\n{headers}\r\n\r\n".encode()
    assert is_admitted(request, KNOWN_ORIGINS) == expected


@pytest.mark.parametrize("origin", ["http://evil.example", "https://lichtblick.example"])
def test_a_page_connects_only_when_its_origin_is_admitted(origin: str) -> None:
    websockets = pytest.importorskip("websockets", reason="websockets is not installed")
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (requirements/view.txt)")

    async def connect(url: str) -> str:
        async with websockets.connect(
            url, subprotocols=["foxglove.sdk.v1"], origin=origin
        ) as client:
            return str(json.loads(await asyncio.wait_for(client.recv(), TIMEOUT_S))["op"])

    server = FoxgloveServer("test", 0, ["https://lichtblick.example/"])
    try:
        if "evil" in origin:
            with pytest.raises(websockets.InvalidStatus, match="403"):
                asyncio.run(connect(server.url))
        else:
            assert asyncio.run(connect(server.url)) == "serverInfo"
    finally:
        server.close()


async def subscribe(url: str, topics: list[str]) -> tuple[Any, dict[int, dict[str, Any]]]:
    websockets = pytest.importorskip("websockets", reason="websockets is not installed")
    client = await websockets.connect(url, subprotocols=["foxglove.sdk.v1"])
    channels: dict[int, dict[str, Any]] = {}
    while {channel["topic"] for channel in channels.values()} < set(topics):
        text = await asyncio.wait_for(client.recv(), TIMEOUT_S)
        for channel in json.loads(text).get("channels", []):
            channels[channel["id"]] = channel
    wanted = [{"id": known, "channelId": known} for known in channels]
    await client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return client, channels


async def receive(client: Any) -> tuple[int, bytes]:
    while True:
        frame = await asyncio.wait_for(client.recv(), TIMEOUT_S)
        if isinstance(frame, bytes):
            _, subscription, _ = _MESSAGE.unpack_from(frame)
            return subscription, frame[_MESSAGE.size :]


def test_clients_get_the_bytes_of_the_bag_and_can_decode_them(
    server: FoxgloveServer, bag: Path
) -> None:
    with BagReader(bag) as reader:
        messages = list(reader.raw_messages(["/plant/state", "/v2x/leader"]))[:40]
    types = {message.topic: message.type_name for message in messages}
    for topic, type_name in types.items():
        server.offer(topic, type_name)

    async def listen() -> list[tuple[str, bytes]]:
        client, channels = await subscribe(server.url, list(types))
        for channel in channels.values():
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
            assert channel["schemaName"] == types[channel["topic"]]
        while set(server.wanted) != set(types):
            await asyncio.sleep(0.01)
        for message in messages:
            server.take(message.topic, message.data)
        found = []
        for _ in messages:
            subscription, data = await receive(client)
            definition = MessageDefinition(
                channels[subscription]["schemaName"], channels[subscription]["schema"], ""
            )
            Decoder({definition.type_name: definition}).decode(data, definition.type_name)
            found.append((channels[subscription]["topic"], data))
        await client.close()
        return found

    assert asyncio.run(listen()) == [(message.topic, message.data) for message in messages]


def test_a_latecomer_gets_the_road(server: FoxgloveServer, bag: Path) -> None:
    with BagReader(bag) as reader:
        (slope,) = reader.raw_messages(["/v2x/slope"])
    server.offer(slope.topic, slope.type_name)
    server.take(slope.topic, slope.data, is_latched=True)

    async def listen() -> bytes:
        client, _ = await subscribe(server.url, [slope.topic])
        while slope.topic not in server.wanted:
            await asyncio.sleep(0.01)
        server.serve_latecomers()
        _, data = await receive(client)
        await client.close()
        return data

    assert asyncio.run(listen()) == slope.data


def test_a_taken_port_is_refused(server: FoxgloveServer) -> None:
    with pytest.raises(ViewError, match=r"port of the Foxglove server .*allowed"):
        FoxgloveServer("second", int(server.url.rsplit(":", 1)[1]))


def test_without_the_library_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        foxglove_server.importlib,
        "import_module",
        lambda name: (_ for _ in ()).throw(ImportError(name)),
    )
    with pytest.raises(ViewError, match=r"requirements/view\.txt") as refusal:
        FoxgloveServer("test")
    assert "\n" not in str(refusal.value)
