"""Heat that the two-cell pack leaves unbalanced: a figure of every run, and an independent sum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import iptm

TRIPS: dict[str, dict[str, Any]] = {
    "wltc": {"cycle": "wltc_class3b", "duration_s": 300.0},
    "us06": {"cycle": "us06", "duration_s": 300.0, "strategy": "reference", "horizon": "15x1"},
    "production": {"cycle": "udds", "duration_s": 300.0, "strategy": "production"},
    "hills": {"cycle": "nycc", "slope": "large", "duration_s": 300.0, "strategy": "aging"},
    "i3": {"cycle": "us06", "duration_s": 300.0, "vehicle": "bmw_i3", "strategy": "production"},
}


@pytest.mark.parametrize("name", TRIPS)
def test_the_residual_is_an_independent_sum(name: str) -> None:
    """Made and taken from the air, less taken by the chiller and stored; cells cool by more than is taken."""
    run = iptm.simulate(**TRIPS[name])
    frame, p = run.frame, run.parameters
    lengths_s = np.diff(frame.index)
    cells = p.pack.modules * p.pack.cells_per_channel
    mean_k = (frame.cell_1_temperature_k + frame.cell_n_temperature_k).to_numpy() / 2.0
    stored_j = cells * p.cell.heat_capacity_j_k * (mean_k[-1] - mean_k[0])
    air_w = p.cooling.air_exchange_w_k * (p.environment.ambient_temperature_k - mean_k)
    air_j = float(lengths_s @ (air_w[1:] + air_w[:-1])) / 2.0
    made_j = float(lengths_s @ frame.battery_heat_w.to_numpy()[1:])
    taken_j = float(lengths_s @ frame.chiller_heat_w.to_numpy()[1:])
    residual_kj = 1e-3 * (made_j + air_j - taken_j - stored_j)
    assert run.summary["unbalanced_heat [kJ]"] == pytest.approx(residual_kj, rel=1e-6, abs=1e-6)
    assert 0.0 < residual_kj < 1e-3 * taken_j


def test_the_heat_of_the_pack_is_what_its_source_gives_and_its_terminals_do_not() -> None:
    """Chemical energy E_b Q, with the charge counted by the coulomb meter of the pack, less the terminals."""
    run = iptm.simulate("us06", duration_s=200.0, strategy="production")
    frame, p = run.frame, run.parameters
    capacity_c = 3600.0 * p.cell.nominal_capacity_ah * p.pack.parallel
    used = float(frame.state_of_charge.iloc[0] - frame.state_of_charge.iloc[-1])
    # The charge has the 32 bits of the battery message.
    charge_error = 2e-7
    made_j = float(np.diff(frame.index) @ frame.battery_heat_w.to_numpy()[1:])
    out_j = float(np.diff(frame.index) @ frame.battery_power_w.to_numpy()[1:])
    aged = 1.0 - float(frame.cell_1_capacity_loss.iloc[0])
    source_j = p.pack.open_circuit_voltage_v * used * capacity_c * aged
    error_j = p.pack.open_circuit_voltage_v * charge_error * capacity_c
    assert source_j - out_j == pytest.approx(made_j, abs=error_j)
