"""Bits of roadside stations; left out where the extra is not installed."""

from __future__ import annotations

import json
import math
import random
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from tests.extras.iptm_its.roadside import GREEN, HERE, RED, STATION, lane, lanes, phases
from tests.iptm_v2x_bridge.cams import cam
from tests.iptm_v2x_bridge.test_messages_oracles import capture, find

pytest.importorskip("pycrate_asn1dir.ITS_IS", reason="requirements/roadside.txt is not installed")

from iptm_core.errors import MessageError
from iptm_its.mapem import decode_mapem, encode_mapem
from iptm_its.pycrate_codec import decode_fields, encode_fields
from iptm_its.spatem import (
    IntersectionPhases,
    Phase,
    SignalState,
    decode_spatem,
    encode_spatem,
    resolve_minute_ms,
    resolve_second_s,
)
from iptm_v2x_bridge.messages.cam import encode_cam
from iptm_v2x_bridge.messages.packets import (
    HEADER_BYTES,
    ROADSIDE_UNIT,
    MessageKind,
    OpenedDatagram,
    its_timestamp_ms,
    open_datagram,
    wrap,
)
from iptm_v2x_bridge.rejections import LeftOut, Rejection

NOW_MS = its_timestamp_ms(1_782_000_000 * 10**9)
SENT_MS = resolve_minute_ms(263_000, 59_999, NOW_MS)
DECODERS = {
    MessageKind.SPATEM: lambda bits: decode_spatem(bits, NOW_MS),
    MessageKind.MAPEM: decode_mapem,
}
PLACE = (600_000_000_123, (48.0, 10.0))
PHASES = IntersectionPhases(
    HERE,
    3,
    SENT_MS,
    {
        1: (
            Phase(
                GREEN,
                *(resolve_second_s(at, SENT_MS / 1000.0) for at in (3590.0, 3599.9, 4.5, 0.1)),
            ),
            Phase(SignalState.YELLOW),
            Phase(RED, min_end_s=math.inf),
        ),
        2: (Phase(SignalState.DARK),),
    },
)
BITS = {
    MessageKind.SPATEM: encode_spatem(STATION, [PHASES]),
    MessageKind.MAPEM: encode_mapem(STATION, [lanes()]),
}


def packet(kind: MessageKind) -> bytes:
    return wrap(BITS[kind], STATION, ROADSIDE_UNIT, *PLACE, port=kind.port)


def test_what_is_sent_is_what_is_read() -> None:
    assert decode_spatem(BITS[MessageKind.SPATEM], NOW_MS) == (PHASES,)
    assert decode_mapem(BITS[MessageKind.MAPEM]) == (lanes(),)


@pytest.mark.parametrize("working", [True, False])
def test_a_signal_that_does_not_work_says_so(working: bool) -> None:
    sent = phases(0, (GREEN, 5.0, 9.0), is_working=working)
    assert decode_spatem(encode_spatem(STATION, [sent]), 0) == (sent,)


@pytest.mark.parametrize("kind", list(DECODERS))
def test_bare_or_in_a_packet_and_to_its_port_only(kind: MessageKind) -> None:
    for datagram in (BITS[kind], packet(kind)):
        opened = open_datagram(datagram, list(MessageKind))
        assert isinstance(opened, OpenedDatagram)
        assert (opened.kind, opened.payload) == (kind, BITS[kind])
    assert open_datagram(BITS[kind], [MessageKind.CAM]) is Rejection.HEADER
    assert open_datagram(packet(kind), [MessageKind.CAM]) is Rejection.PORT
    stray = wrap(encode_cam(cam()), STATION, ROADSIDE_UNIT, *PLACE, port=kind.port)
    assert open_datagram(stray, list(MessageKind)) is Rejection.HEADER


def test_packets_for_everyone_in_an_area_are_read() -> None:
    """A geographic broadcast has a longer header: a number before the position, an area behind it."""
    single = packet(MessageKind.SPATEM)
    head, position = single[:12], single[12:36]
    area = struct.pack("!iiHHHH", 480_000_000, 100_000_000, 500, 0, 0, 0)
    wide = head[:5] + b"\x40" + head[6:] + bytes(4) + position + area + single[40:]
    opened = open_datagram(wide, list(MessageKind))
    assert isinstance(opened, OpenedDatagram)
    assert opened.payload == BITS[MessageKind.SPATEM]
    assert opened.packet_timestamp_ms == PLACE[0] % 2**32
    assert open_datagram(wide[:-1], list(MessageKind)) is Rejection.PACKET
    assert open_datagram(wide[: HEADER_BYTES + 2], list(MessageKind)) is Rejection.PACKET


def test_phases_without_their_time_are_incomplete() -> None:
    station, fields = decode_fields(MessageKind.SPATEM, BITS[MessageKind.SPATEM])  # type: ignore[misc]
    state = fields["intersections"][0]
    for name, unknown in (("moy", 527_040), ("timeStamp", 65_535)):
        changed = {**fields, "intersections": [{**state, name: unknown}]}
        bits = encode_fields(MessageKind.SPATEM, station, changed)
        assert decode_spatem(bits, NOW_MS) is Rejection.INCOMPLETE
        # It costs its own intersection, and no other one.
        beside = {**fields, "intersections": [{**state, name: unknown}, state]}
        bits = encode_fields(MessageKind.SPATEM, station, beside)
        assert decode_spatem(bits, NOW_MS) == decode_spatem(BITS[MessageKind.SPATEM], NOW_MS)


def test_parts_outside_of_the_subset_are_left_out_and_named() -> None:
    station, fields = decode_fields(MessageKind.MAPEM, BITS[MessageKind.MAPEM])  # type: ignore[misc]
    computed = dict(fields["intersections"][0]["laneSet"][0])
    offset = ("small", 350)
    computed["nodeList"] = (
        "computed",
        {"referenceLaneId": 1, "offsetXaxis": offset, "offsetYaxis": offset},
    )
    fields["intersections"][0]["laneSet"].append(computed)
    read = decode_mapem(encode_fields(MessageKind.MAPEM, station, fields))
    assert read == (replace(lanes(), left_out=(LeftOut.COMPUTED_LANE,)),)


def test_what_the_wire_cannot_hold_is_refused() -> None:
    with pytest.raises(MessageError, match="MAPEM"):
        encode_mapem(STATION, [lanes(lane(9, ((0.0, 0.0), (0.0, -400.0))))])


def damaged(source: random.Random, bits: bytes) -> bytes:
    way = source.randrange(5)
    if way == 0:
        return bits[:6] + source.randbytes(source.randrange(300))
    if way == 1:
        return bits[: source.randrange(7, len(bits))]
    changed = bytearray(bits + source.randbytes(source.choice((0, 200))))
    for _ in range(source.choice((1, 1, 2, 5, 40))):
        changed[source.randrange(6, len(changed))] ^= 1 << source.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize("kind", list(DECODERS))
def test_damaged_messages_are_refused_or_read_and_nothing_else(kind: MessageKind) -> None:
    source = random.Random(kind.port)  # noqa: S311 - no secret
    outcomes = set()
    for _ in range(2000):
        read = DECODERS[kind](damaged(source, BITS[kind]))
        outcomes.add(read if isinstance(read, Rejection) else type(read))
    assert outcomes <= {Rejection.DECODING, Rejection.INCOMPLETE, type(DECODERS[kind](BITS[kind]))}
    assert len(outcomes) > 1


def test_wireshark_reads_what_was_meant(tmp_path: Path) -> None:
    if shutil.which("tshark") is None:
        pytest.skip("tshark is not installed")
    file = tmp_path / "roadside.pcap"
    capture(file, [packet(kind) for kind in DECODERS])
    command = ["tshark", "-r", str(file), "-T", "json"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    spatem, mapem = (entry["_source"]["layers"] for entry in json.loads(result.stdout))
    for layers, kind in zip((spatem, mapem), DECODERS, strict=True):
        assert "_ws.malformed" not in layers
        assert find(layers, "btpb.dstport") == str(kind.port)
        assert find(layers, "its.stationID") == str(STATION)
    assert find(spatem, "dsrc.moy") == "263000"
    assert find(spatem, "dsrc.timeStamp") == "59999"
    assert find(spatem, "dsrc.signalGroup") == "1"
    assert find(spatem, "dsrc.eventState") == "6"
    assert find(spatem, "dsrc.startTime") == "35900"
    assert find(spatem, "dsrc.minEndTime") == "35999"
    assert find(spatem, "dsrc.maxEndTime") == "45"
    assert find(spatem, "dsrc.likelyTime") == "1"
    assert find(mapem, "dsrc.signalGroup") == "1"
    assert find(mapem, "dsrc.laneID") == "1"
    place = lanes()
    assert find(mapem, "dsrc.lat") == str(round(1e7 * place.latitude_deg))
    assert find(mapem, "dsrc.x") == "0"
    assert find(mapem, "dsrc.y") == "-1000"
