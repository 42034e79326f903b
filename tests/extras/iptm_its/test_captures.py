"""Packets in captures of a network: what went in comes out, and what is damaged is reported."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.errors import ParameterError
from iptm_core.routes import Route
from iptm_its.captures import read_capture
from iptm_v2x_bridge.messages.packets import its_timestamp_ms
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Framing, SenderSettings

NS = 10**9
PORT = 8947


class Capture:
    """Writes frames as dpkt does."""

    def __init__(self, path: Path, link_type: int) -> None:
        self.dpkt = pytest.importorskip("dpkt", reason="requirements/capture.txt is not installed")
        self._file = path.open("wb")
        kind = self.dpkt.pcapng if path.suffix == ".pcapng" else self.dpkt.pcap
        self._writer = kind.Writer(self._file, snaplen=65_535, linktype=link_type)

    def write(self, frames: list[tuple[float, bytes]]) -> None:
        for unix_s, frame in frames:
            self._writer.writepkt(frame, unix_s)
        self._writer.close()
        self._file.close()

    def udp(self, payload: bytes, port: int) -> bytes:
        datagram = self.dpkt.udp.UDP(sport=4000, dport=port, ulen=8 + len(payload), data=payload)
        whole = self.dpkt.ip.IP(src=bytes(4), dst=bytes(4), p=17, data=datagram)
        whole.len = 28 + len(payload)
        return bytes(whole)


ETHERNET = bytes(6) + b"\x02" + bytes(5)
GEONETWORKING = b"\x89\x47"
WIRELESS = b"\x88\x00" + bytes(24) + b"\xaa\xaa\x03\x00\x00\x00" + GEONETWORKING
RADIOTAP = b"\x00\x00\x08\x00\x00\x00\x00\x00"


@pytest.mark.parametrize("suffix", [".pcap", ".pcapng"])
@pytest.mark.parametrize("link", ["ethernet", "vlan", "cooked", "wireless", "monitor", "ip", "udp"])
def test_packets_come_out_of_a_capture_as_they_went_in(
    tmp_path: Path, route: Route, link: str, suffix: str
) -> None:
    path = tmp_path / f"radio{suffix}"
    types = {"cooked": 113, "wireless": 105, "monitor": 127, "ip": 101}
    capture = Capture(path, types.get(link, 1))
    framing = Framing.BARE if link in {"ip", "udp"} else Framing.GEONETWORKING
    sender = CamSender(route.leader, ROAD, SenderSettings(framing=framing))
    packets = [sender.datagram_at(k * NS // 2) for k in range(20)]

    def framed(packet: bytes) -> bytes:
        ip = capture.udp(packet, PORT)
        return {
            "ethernet": ETHERNET + GEONETWORKING + packet,
            "vlan": ETHERNET + b"\x81\x00\x00\x05" + GEONETWORKING + packet + bytes(4),
            "cooked": bytes(14) + GEONETWORKING + packet,
            "wireless": WIRELESS + packet + b"\x01\x02\x03\x04",  # with the checksum of the frame
            "monitor": RADIOTAP + WIRELESS + packet,
            "ip": ip,
            "udp": ETHERNET + b"\x08\x00" + ip,
        }[link]

    begin_s = 1_790_000_000.25
    other = ETHERNET + b"\x08\x06" + bytes(40)
    frames = [(begin_s + 0.1 * k, framed(packet)) for k, packet in enumerate(packets)]
    foreign = other if link in {"ethernet", "udp", "vlan"} else framed(b"")[:-20]
    capture.write([(begin_s, foreign), *frames])
    found = read_capture(path, PORT, str)
    assert [packet for _, packet in found] == packets
    expected_ns = [its_timestamp_ms(round(1e9 * unix_s)) * 10**6 for unix_s, _ in frames]
    np.testing.assert_allclose([at_ns for at_ns, _ in found], expected_ns, rtol=0, atol=2e6)


@pytest.mark.parametrize("suffix", [".pcap", ".pcapng"])
def test_a_capture_that_is_cut_or_malformed_is_reported(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"radio{suffix}"
    capture = Capture(path, 1)
    frames = [ETHERNET + b"\x08\x00" + capture.udp(bytes([k] * 9), PORT) for k in range(60)]
    frames[7] = frames[7][:3]
    capture.write([(1e9 + k, frame) for k, frame in enumerate(frames)])
    warnings: list[str] = []
    whole = read_capture(path, PORT, warnings.append)
    assert len(whole) == 59
    assert [text.rpartition(": ")[2] for text in warnings] == ["1 malformed frames are left out"]
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3 + 5])
    warnings.clear()
    found = read_capture(path, PORT, warnings.append)
    assert found == whole[: len(found)]
    assert f"cut short within a packet; the {len(found)} before it" in warnings[0]


def test_what_is_no_capture_ends_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "radio.pcap"
    capture = Capture(path, 1)
    capture.write([(1.0, ETHERNET + b"\x08\x00" + capture.udp(b"of another service", 9999))])
    with pytest.raises(ParameterError, match=f"no UDP datagram to port {PORT}"):
        read_capture(path, PORT, str)
    content = path.read_bytes()
    source = random.Random(5)  # noqa: S311 - no secret
    for number in range(300):
        damaged = bytearray(content if number % 2 else source.randbytes(200))
        for _ in range(1 + number % 7):
            damaged[source.randrange(len(damaged))] = source.randrange(256)
        path.write_bytes(damaged[: source.randrange(1, len(damaged) + 1)])
        with pytest.raises(ParameterError, match="recorded_packets is"):
            read_capture(path, PORT, str)
    with pytest.raises(ParameterError, match="recorded_packets is"):
        read_capture(tmp_path / "none.pcap", PORT, str)
