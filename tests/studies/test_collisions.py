"""Single trials of the families: two sources, lies, messages that cannot brake, and the bounds by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from studies.collisions.families import FAMILIES, FROZEN_5, LIE_OF_NOW, PUBLISHED, Motion
from studies.collisions.family_trials import (
    AUTHENTICATED,
    COMFORT_M_S2,
    LOSS_M_S,
    NO_RADIO,
    ONE_AND_A_HALF_S,
    OPEN,
    Setting,
    blind_summary,
    broken,
    summary,
    trial,
    trials,
)
from studies.collisions.recorded import STEP_S


def test_a_motion_that_brakes_and_one_that_is_replaced() -> None:
    drive = Motion.of(10.0, np.full(2000, 10.0))
    braking = drive.braking(5.0, 5.0)
    assert braking.at(10.0) == pytest.approx((10.0 + 50.0 + 10.0, 0.0), abs=1e-2)
    other = drive.replaced(5.0, 100.0, np.full(2000, 2.0))
    assert other.at(4.99)[0] == pytest.approx(59.9)
    assert other.at(6.0) == pytest.approx((102.0, 2.0))
    assert STEP_S == 0.01


def test_behind_a_blind_sensor_honest_messages_avoid_what_the_sensor_alone_does_not() -> None:
    tables = {
        radio: trials(Setting(FROZEN_5, ONE_AND_A_HALF_S, radio), ["us06", "udds"], 8, 3)
        for radio in (AUTHENTICATED, NO_RADIO)
    }
    assert not tables[AUTHENTICATED].collided.any()
    alone = summary(tables[NO_RADIO]).iloc[0]
    assert alone.avoidable > 0
    assert alone.unexplained == 0
    assert not broken(tables[NO_RADIO])
    found = blind_summary(tables[NO_RADIO])
    short = found[found.largest_m.notna()]
    assert len(found) > len(short) > 0
    assert ((short.median_m >= 0.0) & (short.largest_m >= short.median_m)).all()


def test_messages_that_lie_cost_little_without_a_key() -> None:
    for radio in (AUTHENTICATED, OPEN):
        table = trials(Setting(LIE_OF_NOW, ONE_AND_A_HALF_S, radio), ["us06", "udds"], 6, 5)
        assert not table.collided.any()
        assert not broken(table)
        if radio == OPEN:
            assert table.lost_m_s.max() <= LOSS_M_S
            assert table.hardest_m_s2.min() >= COMFORT_M_S2


def test_a_published_friction_brakes_within_comfort() -> None:
    table = trials(Setting(PUBLISHED, ONE_AND_A_HALF_S, NO_RADIO), ["us06", "hwfet"], 6, 2)
    assert table.hardest_m_s2.min() >= COMFORT_M_S2
    assert not broken(table)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_every_family_can_be_driven_and_is_the_same_again(family: str) -> None:
    setting = Setting(family, ONE_AND_A_HALF_S, AUTHENTICATED)
    first, second = (trial(setting, "nycc", (7, 1)) for _ in range(2))
    assert math.isfinite(first["smallest_gap_m"])
    assert {**first, "drawn": 0} == pytest.approx({**second, "drawn": 0}, nan_ok=True)
