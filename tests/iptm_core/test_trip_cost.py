"""Cost of a trip: a parked car by hand, and what a kelvin on arrival costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import iptm
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.law import Load
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging, capacity_price_eur
from iptm_core.metrics.trip_cost import trip_cost

USE = AgingSettings(aging_law="lfp", electricity_eur_kwh=0.3, battery_eur_kwh=100.0)


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    return iptm.simulate("us06", duration_s=120.0, strategy="production")


def test_energy_by_hand(run: iptm.Run) -> None:
    cost = trip_cost(run.trajectory, run.metrics, run.parameters, USE)
    spent_kwh = (run.metrics.battery_energy_j - run.metrics.final_kinetic_energy_j) / 3.6e6
    assert cost.energy_eur == pytest.approx(0.3 * spent_kwh / run.metrics.distance_m * 1e5)
    assert cost.eur == cost.energy_eur + cost.driving_eur + cost.parked_eur


def test_a_pack_at_rest_loses_by_the_calendar_only(run: iptm.Run) -> None:
    """At one temperature and charge, for the 120 s of the run."""
    rows = np.ones_like(run.trajectory.time_s)
    still = replace(
        run.trajectory,
        cell_1_temperature_k=300.0 * rows,
        cell_n_temperature_k=300.0 * rows,
        state_of_charge=0.6 * rows,
    )
    cost = trip_cost(still, run.metrics, run.parameters, USE)
    (calendar, *_) = LAWS["lfp"].mechanisms
    weight = ParkedAging(LAWS["lfp"], USE, 308.15).weights[0]
    lost = 120.0 * weight * float(calendar.damage_rate_1_s(Load(300.0, 0.0, 0.6)))
    price_eur = capacity_price_eur(USE, run.parameters)
    assert cost.driving_eur == pytest.approx(lost * price_eur / run.metrics.distance_m * 1e5)


def test_arriving_warmer_costs_more_and_as_the_settled_pack_nothing(run: iptm.Run) -> None:
    settled_k = ParkedAging(LAWS["lfp"], USE, 308.15).parked_k
    parked = [
        trip_cost(
            run.trajectory,
            replace(run.metrics, final_temperature_k=settled_k + above_k),
            run.parameters,
            USE,
        ).parked_eur
        for above_k in (-10.0, 0.0, 10.0)
    ]
    assert parked[0] < 0.0 < parked[2]
    assert parked[1] == pytest.approx(0.0)
    assert parked[2] > -parked[0], "ageing grows faster than the temperature"
