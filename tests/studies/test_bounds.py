"""What a car could have avoided by its brakes."""

from __future__ import annotations

import numpy as np
import pytest
from studies.bounds import (
    braking_leads,
    emergency_stops,
    gaps_when_braking,
    seen_from,
)
from tests.iptm_core.made_runs import make_run

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import BrakeParameters

PARAMETERS = load_parameters().values


def test_a_wall_that_appears_at_60_m_leaves_what_braking_does_not_need() -> None:
    """0.6 s at 20 m/s, 0.8 s until 8 m/s^2, 16.8^2 / 16 m: 44.8 m."""
    seconds = np.arange(20.0)
    position = 20.0 * seconds
    run = make_run(
        20,
        position_m=position,
        speed_m_s=np.full(20, 20.0),
        leader_position_m=np.where(seconds < 8, position + 60.0, 220.0),
        leader_speed_m_s=np.where(seconds < 8, 20.0, 0.0),
    )
    assert seen_from(run, 11) == 8
    gaps_m = gaps_when_braking(run, PARAMETERS, 8, 19)
    assert gaps_m[0] == 60.0
    assert gaps_m.min() == pytest.approx(60.0 - 44.8, abs=0.1)
    assert gaps_when_braking(run, PARAMETERS, 9, 9) == pytest.approx([40.0])


def brakes(build_up_m_s3: float = 1e9, delay_s: float = 0.0) -> BrakeParameters:
    """Brakes of 8 m/s^2."""
    return BrakeParameters(8.0, build_up_m_s3, delay_s, 0.0)


def stop(
    gap_m: float,
    speed_m_s: float,
    lead_m_s: float,
    deceleration_m_s2: float,
    own: BrakeParameters,
) -> tuple[float, float]:
    one = np.ones(1)
    gaps, impacts = emergency_stops(
        braking_leads(gap_m * one, lead_m_s * one, deceleration_m_s2 * one),
        0.0 * one,
        speed_m_s * one,
        0.0 * one,
        own,
        0.0,
    )
    return float(gaps[0]), float(impacts[0])


def test_stopping_distances_decide_the_smallest_gap() -> None:
    """20 m/s behind 20 m/s: 400 / 16 = 25 m against 400 / 18 = 22.2 m."""
    gap, impact = stop(10.0, 20.0, 20.0, 9.0, brakes())
    assert gap == pytest.approx(10.0 - 25.0 + 400.0 / 18.0, abs=0.02)
    assert impact == 0.0


def test_reaction_and_build_up_cost_their_way() -> None:
    """0.5 s at 20 m/s are 10 m; a ramp of 8 m/s^2 at 10 m/s^3 costs 0.4 s of braking, less its own share."""
    late, _ = stop(60.0, 20.0, 0.0, 1.0, brakes(delay_s=0.5))
    assert late == pytest.approx(60.0 - 10.0 - 25.0, abs=0.02)
    ramped, _ = stop(60.0, 20.0, 0.0, 1.0, brakes(10.0))
    ramp_m = 20.0 * 0.8 - 10.0 * 0.8**3 / 6.0
    assert ramped == pytest.approx(
        60.0 - ramp_m - (20.0 - 0.5 * 10.0 * 0.8**2) ** 2 / 16.0, abs=0.1
    )


def test_an_impact_has_the_speed_that_is_left() -> None:
    """From 20 m/s at 8 m/s^2 there are sqrt(400 - 160) m/s left after 10 m."""
    gap, impact = stop(10.0, 20.0, 0.0, 1.0, brakes())
    assert gap == pytest.approx(-15.0, abs=0.02)
    assert impact == pytest.approx(240.0**0.5, abs=0.1)
