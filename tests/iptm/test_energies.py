"""Where the energy of a run went: a balance that closes, and parts that a second computation gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm_core.parameters.loading import DEFAULT_SET, available_parameter_sets
from iptm_core.physics.cell import at_charge

VARIANTS = ("paper_identified", "published_chiller", "textbook_cell")
QUICK = {"duration_s": 120.0, "horizon": "3x1", "strategy": "production"}
CARS = ("paper_calibrated", "volkswagen_id4", "bmw_i3")
NAMED = sorted(set(available_parameter_sets()) - {DEFAULT_SET, *VARIANTS})
"""The twelve cars by name."""


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize(("cycle", "slope"), [("us06", "flat"), ("nycc", "large")])
def test_the_balance_closes_and_its_parts_are_those_of_current_and_voltage(
    car: str, cycle: str, slope: str
) -> None:
    run = iptm.simulate(cycle, vehicle=car, slope=slope, **QUICK)
    found, rows, parameters = run.energies, run.trajectory, run.parameters
    assert abs(found.residual) < 1e-6
    assert found.consumers_j == 0.0
    assert "consumers" not in found.uses
    figures = run.figures
    assert figures["battery_energy"] == pytest.approx(1e-3 * found.terminals_j)
    assert figures["cell_energy"] == pytest.approx(1e-3 * found.open_circuit_j)
    # Charge times open-circuit voltage, from the state of charge alone.
    middles = 0.5 * (rows.state_of_charge[1:] + rows.state_of_charge[:-1])
    volts = np.array([at_charge(parameters, each).pack.open_circuit_voltage_v for each in middles])
    present = 1.0 - 0.5 * (rows.cell_1_capacity_loss[0] + rows.cell_n_capacity_loss[0])
    capacity_as = present * 3600.0 * parameters.cell.nominal_capacity_ah * parameters.pack.parallel
    by_charge_j = float(-np.diff(rows.state_of_charge) @ volts * capacity_as)
    assert found.open_circuit_j == pytest.approx(by_charge_j, rel=2e-4)
    assert found.cells_j > 0.0
    body = parameters.body
    speed = rows.speed_m_s
    motion_j = (
        0.5 * body.rotational_inertia_factor * body.mass_kg * (speed[-1] ** 2 - speed[0] ** 2)
    )
    assert found.motion_j == pytest.approx(motion_j)
    assert found.rolling_j > 0.0 < found.air_j
    assert found.drive_j > 0.0
    assert found.brakes_j >= 0.0
    if slope == "flat":
        assert found.climb_j == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("cycle", ["us06", "nycc", "wltc_class3b"])
@pytest.mark.parametrize("car", NAMED)
def test_the_balance_closes_for_every_car(car: str, cycle: str) -> None:
    run = iptm.simulate(cycle, vehicle=car, slope="small", **QUICK)
    assert abs(run.energies.residual) < 1e-6


def test_the_report_has_a_bar_of_the_energies(tmp_path: Path) -> None:
    run = iptm.simulate("us06", **QUICK)
    text = run.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert "Where the energy of the cells went" in text
    assert f"rolling: {run.energies.rolling_j / 3.6 / run.metrics.distance_m:.1f} Wh/km" in text
