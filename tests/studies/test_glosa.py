"""Speed advice in front of closed lines, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from studies.glosa import LOWEST_M_S, advised
from tests.iptm_controller.scenes import FLAT, make_state

from iptm_controller.measurements import Measurements
from iptm_core.road_ahead import RoadAhead, SpeedLimits, Stop
from iptm_core.state import LeaderPreview

LIMIT_M_S = 14.0


def limits_of(*stops: Stop) -> SpeedLimits:
    limits = SpeedLimits(np.array([0.0, 500.0]), np.array([LIMIT_M_S, 20.0]))
    state = make_state(position_m=0.0, speed_m_s=10.0, time_s=100.0)
    road = RoadAhead(has_leader=False, limits=limits, stops=stops)
    measured = Measurements(state, None, LeaderPreview.empty(), FLAT, road=road)
    found = advised(measured).rules
    assert found is not None
    assert found.limits is not None
    return found.limits


@pytest.mark.parametrize(
    ("opens_at_s", "advice_m_s"),
    [
        # 300 m: 2 * 300 / 30 - 10 m/s; slower than is advised; faster than the limit.
        (130.0, 10.0),
        (150.0, LOWEST_M_S),
        (120.0, LIMIT_M_S),
    ],
)
def test_the_line_is_reached_when_it_opens(opens_at_s: float, advice_m_s: float) -> None:
    limits = limits_of(Stop(300.0, opens_at_s), Stop(450.0, 170.0))
    places = np.array([0.0, 299.0, 300.0, 499.0, 500.0])
    assert limits.at_m_s(places).tolist() == pytest.approx(
        [advice_m_s, advice_m_s, LIMIT_M_S, LIMIT_M_S, 20.0]
    )


@pytest.mark.parametrize("stop", [(), (Stop(300.0, np.inf),)])
def test_without_a_line_that_opens_the_limits_hold(stop: tuple[Stop, ...]) -> None:
    assert limits_of(*stop).limits_m_s.tolist() == [LIMIT_M_S, 20.0]
