"""A flood of roadside messages: what is decoded, what is dropped, and that messages of cars are not."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from tests.extras.iptm_its.roadside import GREEN, HERE, LINE_M, STATION, lanes, phases
from tests.iptm_v2x_bridge.radio import ROAD, datagram

from iptm_its import table as table_module
from iptm_its.mapem import encode_mapem
from iptm_its.pycrate_codec import (
    BURST_BYTES,
    BYTES_PER_MS,
    KEPT_PER_STATION,
    MAX_STATIONS,
    WaitingMessages,
)
from iptm_its.spatem import encode_spatem
from iptm_its.table import RoadsideTable
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.packets import MessageKind, OpenedDatagram
from iptm_v2x_bridge.radio_recording import RadioRecording, SimulatedRadio

NS_PER_MS = 1_000_000
LONGEST = 1300


def message(kind: MessageKind, station_id: int, number: int = 0) -> OpenedDatagram:
    header = bytes((2, kind.message_id)) + station_id.to_bytes(4, "big")
    return OpenedDatagram(kind, header + number.to_bytes(4, "big") + bytes(LONGEST - 10))


def test_a_flood_is_decoded_as_far_as_the_budget_reaches() -> None:
    decoded: list[int] = []
    waiting = WaitingMessages(lambda opened, _: decoded.append(len(opened.payload)))
    dropped = 0
    for time_ms in range(10_000):
        dropped += waiting.add(message(MessageKind.MAPEM, 1, time_ms), time_ms)
        waiting.decode(time_ms)
    allowed = BURST_BYTES + BYTES_PER_MS * 9999
    assert allowed - LONGEST <= sum(decoded) <= allowed + LONGEST
    assert len(waiting) == KEPT_PER_STATION
    assert len(decoded) + dropped + len(waiting) == 10_000


def test_what_waits_is_the_newest_of_its_station() -> None:
    decoded: list[OpenedDatagram] = []
    waiting = WaitingMessages(lambda opened, _: decoded.append(opened))
    sent = [message(MessageKind.MAPEM, 1, number) for number in range(50)]
    for opened in sent:
        waiting.add(opened, 0)
    waiting.decode(0)
    assert decoded == sent[-KEPT_PER_STATION:][: len(decoded)]


def test_a_flood_of_one_kind_or_station_leaves_their_turn_to_the_others() -> None:
    """One station with maps of its own, ten times as many stations as may wait, and one with phases."""
    decoded: Counter[tuple[MessageKind, int]] = Counter()

    def count(opened: OpenedDatagram, _: int) -> None:
        decoded[opened.kind, int.from_bytes(opened.payload[2:6], "big")] += 1

    waiting = WaitingMessages(count)
    for time_ms in range(5000):
        waiting.add(message(MessageKind.MAPEM, 1, time_ms), time_ms)
        waiting.add(message(MessageKind.MAPEM, 2, time_ms), time_ms)
        if time_ms % 100 == 0:
            waiting.add(message(MessageKind.SPATEM, 3, time_ms), time_ms)
        waiting.decode(time_ms)
    assert decoded[MessageKind.SPATEM, 3] == 50
    assert abs(decoded[MessageKind.MAPEM, 1] - decoded[MessageKind.MAPEM, 2]) <= 1
    for station_id in range(10 * MAX_STATIONS):
        waiting.add(message(MessageKind.MAPEM, station_id), 5000)
    assert len(waiting) <= MAX_STATIONS - 1 + 2 * KEPT_PER_STATION


@pytest.fixture
def rules(monkeypatch: pytest.MonkeyPatch) -> RoadsideTable:
    """Rules that count how often bits were decoded, as `decodings`."""
    pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")
    found = RoadsideTable(ROAD)
    decoders = dict(table_module._KINDS)
    found.decodings = Counter()  # type: ignore[attr-defined]

    def counted(kind: MessageKind) -> object:
        def decode(payload: bytes, now_ms: int) -> object:
            found.decodings[kind] += 1  # type: ignore[attr-defined]
            return decoders[kind](payload, now_ms)

        return decode

    monkeypatch.setattr(table_module, "_KINDS", {kind: counted(kind) for kind in decoders})
    return found


def test_an_unchanged_map_is_decoded_once(rules: RoadsideTable) -> None:
    bridge = CamBridge(ROAD, roadside=rules)
    for second in range(20):
        bridge.receive(encode_mapem(STATION, [lanes()]), second * 10**9)
        bridge.answer(second * 10**9, 0.0)
    assert rules.decodings == {MessageKind.MAPEM: 1}  # type: ignore[attr-defined]
    assert bridge.report()["mapem_accepted"] == 20
    assert [line.position_m for line in rules.lines()] == [pytest.approx(LINE_M, abs=0.02)]


def test_a_forgotten_map_is_decoded_again(
    rules: RoadsideTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "MAX_INTERSECTIONS", 1)
    near, far = encode_mapem(STATION, [lanes()]), _other_map(900.0)
    for number, payload in enumerate((far, near, far)):
        opened = OpenedDatagram(MessageKind.MAPEM, payload)
        rules.receive(opened, number)
        rules.refresh(number, 880.0 if number == 2 else 480.0)
    assert rules.decodings == {MessageKind.MAPEM: 3}  # type: ignore[attr-defined]
    assert [line.position_m for line in rules.lines()] == [pytest.approx(900.0, abs=0.02)]


def _other_map(line_m: float, station_id: int = STATION) -> bytes:
    other = replace(lanes(line_m=line_m), intersection=(HERE[0], HERE[1] + 1))
    return encode_mapem(station_id, [other])


def test_cars_and_signals_are_heard_in_a_flood_and_a_recording_repeats_it() -> None:
    pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")
    flood = [_other_map(600.0 + number, station_id=9) for number in range(200)]
    received: list[tuple[int, int, bytes]] = []
    sent_cars = 0
    for time_ms in range(0, 5000, 5):
        tick_ns = -(-time_ms // 1000) * 10**9
        here = [flood[(time_ms + number) % 200] for number in range(5)]
        if time_ms % 100 == 0:
            here.append(datagram(4711, time_ms, 50.0 + 0.012 * time_ms, 12.0))
            sent_cars += 1
            here.append(encode_spatem(STATION, [phases(time_ms, (GREEN, 30.0, 40.0))]))
            here.append(encode_mapem(STATION, [lanes()]))
        received += [(tick_ns, time_ms * NS_PER_MS, each) for each in here]

    def bridge() -> CamBridge:
        return CamBridge(ROAD, roadside=RoadsideTable(ROAD))

    live, said = bridge(), []
    for tick in range(6):
        for tick_ns, received_ns, sent in received:
            if tick_ns == tick * 10**9:
                live.receive(sent, received_ns)
                live.decode_waiting(received_ns)
        said.append(live.answer(tick * 10**9, 12.0 * tick))
    assert live.report()["messages_accepted"] == sent_cars
    assert live.report()["spatem_accepted"] == 50
    assert int(str(live.report()["mapem_accepted"])) >= 50
    assert int(str(live.report()["rejected_waited"])) > 2000
    assert live.leader_id == 4711
    again = SimulatedRadio(RadioRecording(0, received), bridge())
    for tick, answer in enumerate(said):
        repeated = again.answer(tick * 10**9, 12.0 * tick)
        assert repeated.leader == answer.leader
    assert again.bridge.report() == live.report()
