"""The last safety layer: every rule by hand, and no request that passes beyond them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_vehicle_interface.channel import ActuationLimits
from iptm_vehicle_interface.safety_layer import Request, Violation, checked, safe_gap_m

LIMITS = ActuationLimits(
    min_acceleration_m_s2=-3.5,
    max_acceleration_m_s2=2.0,
    max_jerk_m_s3=5.0,
    max_command_age_s=0.06,
    reaction_s=0.3,
    lead_deceleration_m_s2=8.0,
    margin_m=1.0,
    max_compressor_power_w=4500.0,
)
REQUEST = Request(
    acceleration_m_s2=0.5,
    enabled=True,
    age_s=0.02,
    last_m_s2=0.47,
    since_last_s=0.02,
    speed_m_s=20.0,
    gap_m=100.0,
    relative_speed_m_s=0.0,
    pedal=False,
)


def test_a_sound_request_passes_unchanged() -> None:
    passed = checked(REQUEST, LIMITS)
    assert passed.enabled
    assert passed.value == 0.5
    assert passed.violations == ()


@pytest.mark.parametrize(
    ("change", "violation", "sent"),
    [
        ({"acceleration_m_s2": 2.1, "last_m_s2": 2.0}, Violation.RANGE, 2.0),
        ({"acceleration_m_s2": -3.6, "last_m_s2": -3.5}, Violation.RANGE, -3.5),
        ({"acceleration_m_s2": 1.0}, Violation.RATE, 0.51),
        ({"acceleration_m_s2": -1.0}, Violation.RATE, 0.43),
        # At 20 m/s behind 20 m/s: 20 * (0.3 + 0.35) + 400 / 7 - 400 / 16 + 1 = 46.1 m are needed.
        ({"gap_m": 46.0}, Violation.GAP, 0.37),
        # Half of the distance over which braking begins: 0.05 * 46.1 + 1 = 3.3 m; half of -3.5 to 2 m/s^2.
        ({"gap_m": 46.143 + 1.654, "last_m_s2": -0.75}, Violation.GAP, -0.75),
        ({"gap_m": 47.8}, Violation.GAP, 0.43),
    ],
)
def test_a_request_beyond_a_limit_is_cut(
    change: dict[str, float], violation: Violation, sent: float
) -> None:
    passed = checked(replace(REQUEST, **change), LIMITS)
    assert passed.enabled
    assert violation in passed.violations
    assert passed.value == pytest.approx(sent, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "violation"),
    [
        ({"age_s": 0.061}, Violation.AGE),
        ({"age_s": math.nan}, Violation.AGE),
        ({"pedal": True}, Violation.DRIVER),
        ({"acceleration_m_s2": math.nan}, Violation.NOT_FINITE),
        ({"acceleration_m_s2": -math.inf}, Violation.NOT_FINITE),
    ],
)
def test_an_old_or_overridden_request_makes_the_car_inactive(
    change: dict[str, float], violation: Violation
) -> None:
    passed = checked(replace(REQUEST, **change), LIMITS)
    assert not passed.enabled
    assert passed.value == 0.0
    assert passed.violations == (violation,)


def test_the_safe_gap_by_hand() -> None:
    assert safe_gap_m(20.0, 20.0, LIMITS) == pytest.approx(13.0 + 400.0 / 7.0 - 25.0 + 1.0)
    assert safe_gap_m(0.0, 0.0, LIMITS) == 1.0
    assert safe_gap_m(20.0, 40.0, LIMITS) == 1.0


def test_braking_from_the_safe_gap_avoids_the_collision() -> None:
    """The leader brakes as hard as is allowed for; braking builds up within the rate after the reaction."""
    for speed in (5.0, 15.0, 30.0):
        position, own, acceleration = 0.0, speed, 0.0
        lead_m, lead = safe_gap_m(speed, speed, LIMITS), speed
        nearest, time_s, step = math.inf, 0.0, 0.001
        while own > 0.0:
            if time_s >= LIMITS.reaction_s:
                acceleration = max(acceleration - LIMITS.max_jerk_m_s3 * step, -3.5)
            own = max(own + acceleration * step, 0.0)
            lead = max(lead - LIMITS.lead_deceleration_m_s2 * step, 0.0)
            position, lead_m, time_s = position + own * step, lead_m + lead * step, time_s + step
            nearest = min(nearest, lead_m - position)
        assert 0.5 < nearest < 2.0


values = st.floats(-50.0, 50.0) | st.sampled_from([math.nan, math.inf, -math.inf])


@given(
    wanted=values,
    last=st.floats(-3.5, 2.0),
    age=st.floats(0.0, 1.0),
    speed=st.floats(0.0, 40.0) | st.just(math.nan),
    gap=st.floats(0.0, 200.0) | st.just(math.nan),
    relative=st.floats(-40.0, 40.0),
    pedal=st.booleans(),
    enabled=st.booleans(),
)
def test_whatever_is_asked_what_is_sent_keeps_range_and_rate(
    *,
    wanted: float,
    last: float,
    age: float,
    speed: float,
    gap: float,
    relative: float,
    pedal: bool,
    enabled: bool,
) -> None:
    request = Request(wanted, enabled, age, last, 0.02, speed, gap, relative, pedal)
    passed = checked(request, LIMITS)
    assert -3.5 <= passed.value <= 2.0
    if passed.enabled:
        assert enabled
        assert not pedal
        assert age <= LIMITS.max_command_age_s
        assert abs(passed.value - last) <= 5.0 * 0.02 + 1e-9
    else:
        assert passed.value == 0.0
