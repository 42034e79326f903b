"""The road ahead on the wire."""

from __future__ import annotations

import math

import numpy as np
import pytest

from iptm_core.errors import MessageError
from iptm_core.road_ahead import RoadAhead, SpeedLimits, Stop
from iptm_ros.codecs import decode_road_ahead, encode_road_ahead, has_leader, serialized

LIMITS = SpeedLimits(np.array([0.0, 700.5]), np.array([13.9, 8.3]))
STOPS = (Stop(398.0, 60.5), Stop(5000.0, math.inf))


@pytest.mark.parametrize("leads", [True, False])
@pytest.mark.parametrize(
    ("limits", "stops"), [(None, ()), (LIMITS, ()), (LIMITS, STOPS)], ids=["none", "limits", "all"]
)
def test_what_is_encoded_is_decoded(
    limits: SpeedLimits | None, stops: tuple[Stop, ...], leads: bool
) -> None:
    road = None if limits is None else RoadAhead(leads, limits, stops)
    message = encode_road_ahead(road, 7_000_000_001, has_leader=leads)
    stamp_ns, found = decode_road_ahead(message)
    assert stamp_ns == 7_000_000_001
    assert found.has_leader is leads
    assert has_leader(serialized(message)) is leads
    assert found.stops == stops
    assert (found.limits is None) is (limits is None)
    if limits is not None and found.limits is not None:
        assert found.limits.starts_m.tolist() == limits.starts_m.tolist()
        assert found.limits.limits_m_s.tolist() == limits.limits_m_s.tolist()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ["speed_limit"]}, "1 names, but 3"),
        ({"name": ["speed_limit", "hole", "stop"]}, "bound is hole"),
        ({"name": ["stop", "stop", "stop"]}, "without a speed limit"),
        ({"velocity": [-1.0, 5.0, 0.0]}, "limits above 0"),
        ({"position": [9.0, 3.0, 10.0]}, "increasing starts"),
        ({"position": [0.0, 3.0, math.nan]}, "bound is stop at nan"),
        ({"effort": [math.inf, math.inf, math.nan]}, "until nan"),
    ],
)
def test_a_message_that_bounds_nothing_is_refused(
    change: dict[str, list[float]], words: str
) -> None:
    message = encode_road_ahead(RoadAhead(False, LIMITS, STOPS[:1]), 0, has_leader=False)
    for name, values in change.items():
        setattr(message, name, values)
    with pytest.raises(MessageError, match=words):
        decode_road_ahead(message)
