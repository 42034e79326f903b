"""Attacks on the receiver while it drives: what it makes of them, and what the car does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from studies.v2x.attacks import (
    BEGIN_S,
    CLOCKS,
    DEPARTURE_S,
    END_S,
    FLOOD,
    FORGER,
    LEADER,
    PARAMETERS,
    AttackedRadio,
    absurdly_fast,
    braking_route,
    clock_set_back,
    drive,
    flood,
    forged_car,
    impersonated,
    jumping,
    replayed,
    replayed_a_wrap_later,
    same_identity,
    silenced,
    steady_route,
    without_radio,
)

from iptm_core.routes import Route
from iptm_v2x_bridge.settings import Foresight
from iptm_v2x_bridge.stations.table import STATION_TIMEOUT_MS

ATTACK_S = END_S - BEGIN_S


@pytest.fixture(scope="module")
def route() -> Route:
    return steady_route()


@pytest.fixture(scope="module")
def undisturbed(route: Route) -> AttackedRadio:
    outcome = drive(route, AttackedRadio(route, None))
    assert set(outcome.leaders) == {LEADER}
    assert outcome.refused == {}
    return outcome


@pytest.fixture
def attacked(route: Route) -> Callable[..., AttackedRadio]:
    return lambda attack: drive(route, AttackedRadio(route, attack))


def test_a_forged_car_close_ahead_is_believed_and_kept_clear_of(
    attacked: Callable[..., AttackedRadio],
) -> None:
    """Without signatures it is indistinguishable from a real one: the car brakes within its limits."""
    outcome = attacked(forged_car)
    assert FORGER in outcome.leaders[BEGIN_S : END_S + 1]
    assert outcome.leaders[-1] == LEADER
    run = outcome.loop.trajectory
    assert run.acceleration_m_s2.min() >= PARAMETERS.limits.min_acceleration_m_s2 - 1e-6
    assert run.acceleration_m_s2[BEGIN_S:END_S].min() < -0.5
    assert run.gap_m.min() > 0.0
    assert outcome.margins_m()[BEGIN_S:].min() > 0.0


@pytest.mark.parametrize(
    ("attack", "reasons", "least"),
    [
        (replayed, {"duplicate", "older", "stale"}, 29 * ATTACK_S),
        (absurdly_fast, {"absurd"}, 10 * ATTACK_S),
        (flood, {"table_full"}, FLOOD // 2),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_the_car_drives_as_if_nothing_had_happened(
    attacked: Callable[..., AttackedRadio],
    undisturbed: AttackedRadio,
    attack: Callable[..., object],
    reasons: set[str],
    least: int,
) -> None:
    """To the last bit; the counts of refused forged messages by reason are exact."""
    outcome = attacked(attack)
    assert set(outcome.leaders) == {LEADER}
    np.testing.assert_array_equal(
        outcome.loop.trajectory.position_m, undisturbed.loop.trajectory.position_m
    )
    assert set(outcome.refused) == reasons
    assert sum(outcome.refused.values()) >= least


@pytest.mark.parametrize(
    ("attack", "leaders"),
    [
        (replayed_a_wrap_later, {LEADER}),
        (jumping, {LEADER, FORGER}),
        (same_identity, {LEADER}),
        (clock_set_back, {LEADER}),
    ],
)
def test_an_identity_that_contradicts_itself_is_contested_as_long_as_it_does(
    attacked: Callable[..., AttackedRadio], attack: Callable[..., object], leaders: set[int]
) -> None:
    """The nearest of its stations leads, as a forged car would; the gap is kept."""
    outcome = attacked(attack)
    assert set(outcome.leaders) == leaders
    contested = np.flatnonzero(outcome.contested)
    assert contested.size
    assert BEGIN_S <= contested[0] <= BEGIN_S + 3
    assert contested[-1] <= END_S + STATION_TIMEOUT_MS // 1000
    assert outcome.margins_m()[BEGIN_S:].min() > 0.0


@pytest.mark.parametrize("foresight", list(Foresight))
def test_an_impostor_of_the_leader_does_not_hide_that_it_brakes(foresight: Foresight) -> None:
    """The smallest gap is that of a vehicle without radio, to within the controller's tolerance."""
    route = braking_route()
    outcome = impersonated(route, foresight, *CLOCKS["150 ms ahead, arriving later"])
    assert outcome.contested.index(True) == DEPARTURE_S + 1
    smallest_gap_m = float(without_radio(route).gap_m.min())
    assert outcome.loop.trajectory.gap_m.min() > smallest_gap_m - 0.05


def test_a_leader_that_falls_silent_and_brakes_is_not_run_into() -> None:
    """The leader brakes to a halt unheard; the ego vehicle halts behind where it may be by then."""
    _, outcome = silenced()
    assert set(outcome.leaders) == {LEADER}
    assert outcome.loop.trajectory.gap_m.min() > 0.0
    assert outcome.loop.trajectory.speed_m_s[-1] < 0.5
