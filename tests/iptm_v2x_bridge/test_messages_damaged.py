"""Damaged and invented datagrams: only stated outcomes, none slow, and the bridge goes on."""

from __future__ import annotations

import time
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.iptm_v2x_bridge.radio import ROAD

from iptm_core.routes import build_route
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import decode_datagram
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Foresight, Framing, SenderSettings

LEADER = build_route("us06", initial_gap_m=15.0).leader
GENUINE = [
    CamSender(LEADER, ROAD, SenderSettings(framing=framing, foresight=foresight)).datagram_at(
        second * 10**9
    )
    for framing, foresight in product(Framing, Foresight)
    for second in range(0, 100, 5)
]
LARGEST = 65_507
BRIDGE = CamBridge(ROAD)


def flipped(datagram: bytes, bits: list[int]) -> bytes:
    changed = bytearray(datagram)
    for bit in bits:
        changed[bit // 8 % len(changed)] ^= 1 << bit % 8
    return bytes(changed)


genuine = st.sampled_from(GENUINE)
DAMAGED = st.one_of(
    st.binary(max_size=200),
    st.binary(min_size=4, max_size=600).map(lambda octets: b"\x02\x02" + octets),
    st.builds(lambda datagram, size: datagram[: size % len(datagram)], genuine, st.integers(0)),
    st.builds(lambda datagram, more: datagram + more, genuine, st.binary(min_size=1, max_size=300)),
    st.builds(flipped, genuine, st.lists(st.integers(0, 8 * 600), min_size=1, max_size=40)),
)


def decoding_time_s(datagram: bytes) -> float:
    began_s = time.process_time()
    decode_datagram(datagram)
    return time.process_time() - began_s


def judge(datagram: bytes) -> None:
    # A garbage collection in a large process takes as long, once; a slow datagram is slow every time.
    assert any(decoding_time_s(datagram) < 0.25 for _ in range(3))
    read = decode_datagram(datagram)
    assert isinstance(read, Rejection | tuple)
    assert BRIDGE.receive(datagram, 10**9) in {None, *Rejection}


@given(DAMAGED)
@settings(max_examples=1000, deadline=None)
def test_what_is_damaged_is_read_or_refused(datagram: bytes) -> None:
    judge(datagram)


@given(DAMAGED)
@settings(max_examples=200_000, deadline=None)
@pytest.mark.slow
def test_what_is_damaged_is_read_or_refused_for_minutes(datagram: bytes) -> None:
    judge(datagram)


@pytest.mark.parametrize("octet", [0, 2, 0x12, 255])
def test_the_largest_datagram_is_refused_at_once(octet: int) -> None:
    judge(bytes((octet,)) * LARGEST)


def test_the_bridge_hears_its_leader_among_damaged_messages() -> None:
    bridge = CamBridge(ROAD)
    sender = CamSender(LEADER, ROAD, SenderSettings())
    for tenth in range(20):
        bridge.receive(flipped(GENUINE[tenth], [16 + tenth, 100 + tenth]), tenth * 10**8)
        assert bridge.receive(sender.datagram_at(tenth * 10**8), tenth * 10**8) is None
    assert bridge.answer(19 * 10**8, 0.0).leader is not None
