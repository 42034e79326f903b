"""Several equipped cars in SUMO: taken over where they are, repeatable, lawful. Skipped without the extra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("traci", reason="requirements/traffic.txt is not installed")
pytest.importorskip("sumo", reason="requirements/traffic.txt is not installed")

from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_traffic.demand import DemandSettings
from iptm_traffic.fleet import FleetDrive, FleetResult, drive_fleet

PARAMETERS = load_parameters().values
DRIVE = FleetDrive("production", 2, 90.0, DemandSettings(main_headway_s=5.0))


@pytest.fixture(scope="module")
def fleet() -> FleetResult:
    return drive_fleet(DRIVE, PARAMETERS)


def test_every_second_car_of_the_main_road_has_a_controller(fleet: FleetResult) -> None:
    assert len(fleet.cars) > 6
    assert [car.equipped for car in fleet.cars[:6]] == [True, False] * 3


def test_sumo_has_each_car_where_its_plant_has_it(fleet: FleetResult) -> None:
    assert fleet.largest_deviation_m < 1e-6
    assert fleet.collisions == ()
    for car in fleet.cars:
        steps_m, mean = np.diff(car.driven_m), 0.5 * (car.speed_m_s[1:] + car.speed_m_s[:-1])
        assert np.diff(car.time_s) == pytest.approx(1.0)
        assert steps_m[10:] == pytest.approx(mean[10:], abs=0.6)
        assert car.smallest_gap_m > 0.0
        assert np.isfinite(car.smallest_gap_m) <= car.equipped


def test_a_drive_repeats_to_the_last_bit_and_depends_on_the_strategy(fleet: FleetResult) -> None:
    again = drive_fleet(DRIVE, PARAMETERS)
    other = drive_fleet(replace(DRIVE, strategy="eco_acc"), PARAMETERS)
    speeds = [[car.speed_m_s.tolist() for car in result.cars] for result in (fleet, again, other)]
    assert speeds[0] == speeds[1]
    assert speeds[0] != speeds[2]
    assert [car.name for car in fleet.cars] == [car.name for car in other.cars]


def test_no_drive_without_cars_or_beyond_the_road() -> None:
    with pytest.raises(ScenarioError, match="every is 0; allowed: 1 or more"):
        replace(DRIVE, every=0)
    with pytest.raises(ScenarioError, match="duration_s is 10000; allowed"):
        replace(DRIVE, duration_s=1e4)
