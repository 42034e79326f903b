"""Random messages with every container of the first release, as fields of the wire."""

from __future__ import annotations

import random
from typing import Any


def random_fields(source: random.Random) -> dict[str, Any]:
    """Return the fields of one message, each value inside the range of the standard."""

    def some(low: int, high: int) -> int:
        return source.choice((low, high, source.randint(low, high)))

    def maybe() -> bool:
        return source.random() < 0.5

    def bits(count: int) -> tuple[bytes, int]:
        raw = source.getrandbits(count) << (-count % 8)
        return raw.to_bytes((count + 7) // 8, "big"), count

    vehicle: dict[str, Any] = {
        "heading": {"value": some(0, 3601), "confidence": some(1, 127)},
        "speed": {"value": some(0, 16_383), "confidence": some(1, 127)},
        "direction": some(0, 2),
        "length": {"value": some(1, 1023), "trailer": some(0, 4)},
        "width": some(1, 62),
        "longitudinal": {"value": some(-160, 161), "confidence": some(0, 102)},
        "curvature": {"value": some(-1023, 1023), "confidence": some(0, 7)},
        "curvatureMode": source.choice(("yawRateUsed", "yawRateNotUsed", "unavailable")),
        "yawRate": {"value": some(-32_766, 32_767), "confidence": some(0, 8)},
    }
    if maybe():
        vehicle["control"] = bits(7)
    if maybe():
        vehicle["lane"] = some(-1, 14)
    if maybe():
        vehicle["lateral"] = {"value": some(-160, 161), "confidence": some(0, 102)}
    params: dict[str, Any] = {
        "basic": {
            "stationType": some(0, 255),
            "position": {
                "lat": some(-900_000_000, 900_000_001),
                "lon": some(-1_800_000_000, 1_800_000_001),
                "ellipse": {
                    "major": some(0, 4095),
                    "minor": some(0, 4095),
                    "orientation": some(0, 3601),
                },
                "altitude": {"value": some(-100_000, 800_001), "confidence": some(0, 15)},
            },
        },
        "high": ("vehicle", vehicle),
    }
    if maybe():
        params["low"] = ("vehicle", _low(source, some, bits))
    if maybe():
        params["special"] = ("emergency", {"lightBar": bits(2)})
    return {
        "header": {"protocolVersion": 2, "messageId": 2, "stationId": some(0, 2**32 - 1)},
        "deltaTime": some(0, 65_535),
        "params": params,
    }


def _low(source: random.Random, some: Any, bits: Any) -> dict[str, Any]:
    points = []
    for _ in range(source.randint(0, 40)):
        point: dict[str, Any] = {
            "position": {
                "lat": some(-131_071, 131_072),
                "lon": some(-131_071, 131_072),
                "altitude": some(-12_700, 12_800),
            }
        }
        if source.random() < 0.5:
            point["deltaTime"] = some(1, 65_535)
        points.append(point)
    return {"role": some(0, 15), "lights": bits(8), "history": points}
