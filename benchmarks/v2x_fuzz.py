"""Feeds damaged datagrams to the V2X receiver: only stated outcomes, no slow one, no growth of memory."""

from __future__ import annotations

import random
import resource
import sys
import time
from collections import Counter
from typing import Any

from benchmarks.harness import run_benchmark
from iptm_core.routes import build_route
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import decode_datagram
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import Foresight, Framing, SenderSettings

LONGEST = 65_507
WARM_UP = 2000
_NS_PER_MS = 1_000_000


def genuine(count: int) -> list[bytes]:
    """Return messages of both releases in both framings."""
    route = build_route("us06", initial_gap_m=15.0)
    senders = [
        CamSender(
            route.leader, route.road_line, SenderSettings(framing=framing, foresight=foresight)
        )
        for framing in Framing
        for foresight in Foresight
    ]
    return [senders[k % 4].datagram_at(500 * k * _NS_PER_MS) for k in range(count)]


def damaged(source: random.Random, datagram: bytes) -> bytes:
    """Return a datagram with flipped bits, cut, lengthened or invented altogether."""
    way = source.randrange(6)
    if way == 0:
        return source.randbytes(source.randrange(200))
    if way == 1:
        return bytes((2, 2)) + source.randbytes(source.randrange(4, 600))
    if way == 2:
        return datagram[: source.randrange(len(datagram))]
    if way == 3:
        return datagram + source.randbytes(source.randrange(1, 300))
    changed = bytearray(datagram)
    for _ in range(source.choice((1, 1, 2, 5, 40))):
        changed[source.randrange(len(changed))] ^= 1 << source.randrange(8)
    return bytes(changed)


def fuzz(datagrams: int, seed: int) -> dict[str, Any]:
    """Feed a number of damaged datagrams to decoder and bridge; return what came of them."""
    source = random.Random(seed)  # noqa: S311 - no secret
    examples = genuine(200)
    bridge = CamBridge(build_route("us06", initial_gap_m=15.0).road_line)
    outcomes: Counter[str] = Counter()
    slowest_s, slowest_bytes, before_kib = 0.0, 0, 0
    for number in range(datagrams):
        if number == WARM_UP:
            before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if number % 500 == 499:
            datagram = source.randbytes(LONGEST)
        else:
            datagram = damaged(source, source.choice(examples))
        began = time.process_time()
        read = decode_datagram(datagram)
        elapsed_s = time.process_time() - began
        if elapsed_s > slowest_s and number > 0:
            slowest_s, slowest_bytes = elapsed_s, len(datagram)
        outcomes[str(read) if isinstance(read, Rejection) else "read"] += 1
        bridge.receive(datagram, number * 10 * _NS_PER_MS)
        if number % 100 == 0:
            bridge.answer(number * 10 * _NS_PER_MS, 0.0)
    after_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "datagrams": datagrams,
        "seed": seed,
        "outcomes": dict(outcomes.most_common()),
        "slowest_ms": 1e3 * slowest_s,
        "slowest_bytes": slowest_bytes,
        "grown_mib": (after_kib - before_kib) / 1024.0,
    }


def measure(datagrams: int = 200_000, seed: int = 1) -> dict[str, Any]:
    """Measure.

    Args:
        datagrams: how many.
        seed: of the damage.
    """
    return fuzz(datagrams, seed)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
