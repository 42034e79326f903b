"""What a car could have avoided: by its brakes, and by full cooling."""

from __future__ import annotations

import numpy as np
import pytest
from studies.bounds import (
    avoidable_collisions,
    avoidably_below_s_min,
    below_s_min,
    braking_leads,
    emergency_stops,
    fully_cooled_k,
    gaps_when_braking,
)
from tests.iptm_core.made_runs import make_run

import iptm
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import BrakeParameters
from iptm_core.routes import build_route
from iptm_core.trajectory import Trajectory

PARAMETERS = load_parameters(
    overrides={
        "gap.standstill_gap_m": 5.0,
        "gap.time_headway_s": 1.0,
        "limits.min_acceleration_m_s2": -2.0,
        "limits.max_acceleration_m_s2": 2.0,
        "limits.max_jerk_m_s3": 2.0,
    }
).values


def trip(**columns: object) -> Trajectory:
    """A trip of a row per second with the given columns, at 30 degC and 100 m behind a standing leader."""
    rows = max(np.size(column) for column in columns.values())
    return make_run(rows, **{"leader_position_m": np.full(rows, 100.0), **columns})


def approach(wall_m: float, appears_s: int = 0) -> Trajectory:
    """The ego vehicle keeps 20 m/s; a leader that went as fast is taken for a wall from one second on."""
    seconds = np.arange(20.0)
    position = 20.0 * seconds
    before = seconds < appears_s
    return trip(
        position_m=position,
        speed_m_s=np.full(20, 20.0),
        leader_position_m=np.where(before, position + 60.0, wall_m),
        leader_speed_m_s=np.where(before, 20.0, 0.0),
    )


def test_a_wall_that_was_seen_in_time_is_avoidable() -> None:
    """From 20 m/s and 380 m away, the 100 m to a stop leave more than the 5 m that are asked for."""
    run = approach(380.0)
    below = below_s_min(run, PARAMETERS)
    assert below.any()
    assert not below[0]
    assert np.array_equal(avoidably_below_s_min(run, PARAMETERS, 60.0), below)


def test_a_single_row_has_its_gap() -> None:
    run = approach(380.0)
    assert gaps_when_braking(run, PARAMETERS, 15, 15) == pytest.approx([380.0 - 300.0])


def test_a_wall_out_of_nowhere_is_not_avoidable() -> None:
    """Braking for 5 s leaves 10 m/s and 35 m to the wall, where s_min is 5 + 10 + 25 m; 8 s are enough."""
    run = approach(170.0, appears_s=8)
    below = below_s_min(run, PARAMETERS)
    assert np.flatnonzero(below)[0] == 8
    assert not avoidably_below_s_min(run, PARAMETERS, 5.0).any()
    assert avoidably_below_s_min(run, PARAMETERS, 8.0).any()


def test_rows_with_which_a_trip_begins_do_not_count() -> None:
    run = trip(leader_position_m=[3.0, 4.0, 4.9, 6.0, 4.0, 6.0])
    assert below_s_min(run, PARAMETERS).tolist() == [False, False, False, False, True, False]


@pytest.mark.parametrize(
    ("appears_s", "informed", "avoidable"),
    [(0, True, True), (9, True, True), (9, False, False), (8, False, True)],
)
def test_only_what_could_be_seen_is_avoidable(
    appears_s: int, *, informed: bool, avoidable: bool
) -> None:
    """0.6 s at 20 m/s, 0.8 s until 8 m/s^2, 16.8^2 / 16 m: 44.8 m. The wall: 60 m at 8 s, 40 m at 9 s."""
    run = approach(220.0, appears_s)
    touching = run.gap_m <= 0.0
    assert touching.any()
    found = avoidable_collisions(run, PARAMETERS, 60.0, informed=informed)
    assert np.array_equal(found, touching & avoidable)


def test_full_cooling_cools_more() -> None:
    run = iptm.simulate("nycc", duration_s=60.0)
    gap_m = run.parameters.gap.initial_gap_m
    route = build_route("nycc", initial_gap_m=gap_m, duration_s=60.0)
    cooled_k = fully_cooled_k(run.trajectory, run.parameters, route, 0.05)
    warmest_k = np.maximum(run.trajectory.cell_1_temperature_k, run.trajectory.cell_n_temperature_k)
    assert cooled_k.shape == warmest_k.shape
    assert cooled_k[0] == warmest_k[0]
    assert cooled_k[-1] < warmest_k[-1] + 1e-6


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
