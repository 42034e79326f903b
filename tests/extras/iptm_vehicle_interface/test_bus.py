"""Buses of the machine's own processes, their readers, and frames that prove their sender."""

from __future__ import annotations

import os
import socket
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from tests.waiting import wait_until

from iptm_core.errors import MessageError, ScenarioError
from iptm_vehicle_interface.bus import LOOPBACK, LOOPBACK_GROUP, BusReader, open_bus
from iptm_vehicle_interface.bus_key import GATEWAY, SUITE, KeyedBus, read_key
from iptm_vehicle_interface.node_bench import free_ports

KEY = bytes(range(16))


def message(data: bytes = b"\1\2\3", frame_id: int = 0x123) -> can.Message:
    return can.Message(arbitration_id=frame_id, data=data, is_extended_id=False, timestamp=0.0)


def test_a_bench_takes_no_port_of_another_one() -> None:
    first = free_ports(os.getpid())
    bus = open_bus(f"udp:{first + 1}")
    try:
        assert abs(free_ports(os.getpid()) - first) > 1
    finally:
        bus.shutdown()
    assert free_ports(os.getpid()) == first


def test_a_datagram_to_another_address_of_the_machine_does_not_arrive() -> None:
    """Neither one to the address of its network, nor one to the group on another interface."""
    port = free_ports(os.getpid())
    bus = open_bus(f"udp:{port}")
    try:
        data = pack_message(message())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
            foreign.connect(("192.0.2.1", 9))
            own = foreign.getsockname()[0]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
            for address in (own, LOOPBACK):
                foreign.sendto(data, (address, port))
            foreign.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(own))
            foreign.sendto(data, (LOOPBACK_GROUP, port))
        assert bus.recv(0.3) is None
        bus.send(message())
        assert bytes(bus.recv(5.0).data) == b"\1\2\3"
    except OSError as error:
        pytest.skip(f"no other interface on this machine: {error}")
    finally:
        bus.shutdown()


@pytest.mark.parametrize("error", [can.CanOperationError("Network is down"), OSError("other")])
def test_a_bus_that_fails_is_tried_again_without_spinning(error: Exception) -> None:
    class Down:
        is_up = False

        def recv(self, timeout: float) -> Any:
            time.sleep(min(timeout, 0.01))
            if not self.is_up:
                raise error
            return message()

        def shutdown(self) -> None:
            pass

    bus = Down()
    reader = BusReader(bus)
    try:
        before_s = time.process_time()
        wait_until(lambda: reader.unreadable, what="a try")
        time.sleep(0.5)
        assert reader.unreadable <= 10
        assert time.process_time() - before_s < 0.25
        bus.is_up = True
        wait_until(reader.taken, what="a frame")
    finally:
        reader.close()


class Wire:
    """Both ends of a keyed link, with a clock and everything that is sent."""

    def __init__(self) -> None:
        self.sent: deque[can.Message] = deque()
        self.now_ns = 10**18
        self.ends = {
            name: KeyedBus(self, KEY, name, lambda: self.now_ns) for name in (SUITE, GATEWAY)
        }

    def send(self, each: can.Message) -> None:
        self.sent.append(each)

    def recv(self, timeout: float) -> can.Message | None:  # noqa: ARG002
        return self.sent.popleft() if self.sent else None

    def shutdown(self) -> None:
        pass

    def carried(self, data: bytes = b"\1\2\3") -> Any:
        self.ends[SUITE].send(message(data))
        return self.ends[GATEWAY].recv(0.0)


@pytest.mark.parametrize("data", [b"", b"\1\2\3", bytes(8), bytes(range(32)), bytes(43)])
def test_a_keyed_frame_arrives_as_it_was(data: bytes) -> None:
    wire = Wire()
    for _ in range(3):
        found = wire.carried(data)
        assert (found.arbitration_id, bytes(found.data)) == (0x123, data)
        assert found.is_fd is (len(data) > 8)


def test_every_flipped_bit_of_a_keyed_frame_is_refused() -> None:
    wire = Wire()
    wire.ends[SUITE].send(message())
    (sent,) = wire.sent
    used = 1 + 8 + 12 + 3
    for bit in range(8 * used):
        data = bytearray(sent.data)
        data[bit // 8] ^= 1 << bit % 8
        wire.sent = deque([can.Message(arbitration_id=0x123, data=data, is_fd=True)])
        with pytest.raises(MessageError, match="authentication code"):
            wire.ends[GATEWAY].recv(0.0)
    other = can.Message(arbitration_id=0x124, data=sent.data, is_fd=True)
    wire.sent = deque([other])
    with pytest.raises(MessageError, match="authentication code"):
        wire.ends[GATEWAY].recv(0.0)


def _repeat(wire: Wire) -> None:
    wire.ends[SUITE].send(message())
    wire.sent.append(wire.sent[0])
    wire.ends[GATEWAY].recv(0.0)


def _delay(wire: Wire) -> None:
    wire.ends[SUITE].send(message())
    wire.now_ns += 10**9


def _with_another_key(wire: Wire) -> None:
    KeyedBus(wire, b"\0" * 16, SUITE, lambda: wire.now_ns).send(message())


def _without_a_key(wire: Wire) -> None:
    wire.send(message(bytes(8)))


@pytest.mark.parametrize("attack", [_repeat, _delay, _with_another_key, _without_a_key])
def test_what_is_not_fresh_or_not_proved_is_refused(attack: Callable[[Wire], None]) -> None:
    wire = Wire()
    attack(wire)
    with pytest.raises(MessageError):
        wire.ends[GATEWAY].recv(0.0)
    assert wire.carried() is not None


def test_own_frames_that_a_bus_returns_are_left_out() -> None:
    wire = Wire()
    wire.ends[SUITE].send(message())
    assert wire.ends[SUITE].recv(0.0) is None


@pytest.mark.parametrize(
    ("text", "mode", "why"),
    [
        ("00" * 16, 0o644, "open to others"),
        ("00" * 15, 0o600, "holds no key; allowed: 32"),
        ("key", 0o600, "holds no key"),
    ],
)
def test_a_key_that_is_none_is_refused(tmp_path: Path, text: str, mode: int, why: str) -> None:
    path = tmp_path / "key"
    path.write_text(text, "ascii")
    path.chmod(mode)
    with pytest.raises(ScenarioError, match=why):
        read_key(path)
    with pytest.raises(ScenarioError, match="allowed: a file with a key"):
        read_key(tmp_path / "none")


def test_a_key_is_read(tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_text(KEY.hex() + "\n", "ascii")
    path.chmod(0o600)
    assert read_key(path) == KEY
