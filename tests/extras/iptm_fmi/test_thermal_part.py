"""A foreign FMU as the thermal part of the vehicle: temperatures and power by hand, and what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import iptm
from iptm.faults.fault import FaultKind
from iptm_core.errors import IptmError
from iptm_core.frozen import replace
from iptm_core.state import Command
from iptm_fmi.foreign_plant import plant_of
from iptm_plant_sim.plant import Plant

pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
builder = pytest.importorskip(
    "pythonfmu.builder", reason="pythonfmu is not installed (requirements/fmi.txt)"
)
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The supplier's pack with its mapping."""
    folder = tmp_path_factory.mktemp("supplier")
    made = builder.FmuBuilder.build_FMU(str(HERE / "supplier_pack.py"), dest=str(folder))
    shutil.copy(HERE / "supplier_pack.yaml", Path(made).with_suffix(".yaml"))
    return Path(made)


def test_temperatures_are_those_of_the_part(pack: Path) -> None:
    run = iptm.simulate("us06", duration_s=300.0, plant=str(pack))
    frame = run.frame
    heat_w, drawn_w = frame.battery_heat_w.to_numpy()[1:], frame.compressor_power_w.to_numpy()[1:]
    assert drawn_w.max() > 100.0
    for column, share, start_k in (
        ("cell_1_temperature_k", 1.1, 306.15),
        ("cell_n_temperature_k", 0.9, 307.15),
    ):
        by_hand = start_k + np.cumsum(heat_w - share * 2.0 * drawn_w) / 100e3
        np.testing.assert_allclose(frame[column].to_numpy()[1:], by_hand, atol=1e-3)
    np.testing.assert_allclose(frame.chiller_heat_w.to_numpy()[1:], 2.0 * drawn_w, atol=1e-6)
    assert any("coolant_inlet_k" in note for note in run.warnings)
    again = iptm.simulate("us06", duration_s=300.0, plant=str(pack)).frame
    np.testing.assert_array_equal(again.cell_n_temperature_k, frame.cell_n_temperature_k)
    np.testing.assert_array_equal(again.battery_power_w, frame.battery_power_w)


def test_the_pack_supplies_what_the_part_draws(pack: Path) -> None:
    """As the vehicle of the suite whose compressor has that power, from the same state."""
    trip = iptm.Trip.of("us06")
    plant = plant_of(str(pack))(trip.parameters, trip.route.slope.slope_at)
    own = Plant(trip.parameters, trip.route.slope.slope_at)
    start = replace(plant.initial_state(), speed_m_s=15.0)
    step = plant.advance(start, Command(0.5, 150.0))
    assert step.state.compressor_power_w == pytest.approx(
        1.1 * step.report.requested.compressor_power_w
    )
    same = own.advance(start, Command(0.5, step.state.compressor_power_w))
    assert step.powers.battery_power_w == pytest.approx(same.powers.battery_power_w, rel=1e-12)
    assert step.state.cell_1_capacity_loss == same.state.cell_1_capacity_loss


def test_the_monitor_brakes_with_a_thermal_part(pack: Path) -> None:
    stop = iptm.Fault(FaultKind.LEADER_HARD_STOP, 60.0, size=8.0)
    run = iptm.simulate("us06", plant=str(pack), duration_s=90.0, faults=[stop])
    assert run.figures["interventions"] > 0.0
    assert run.frame.gap_m.min() > 0.0


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("cell_n_temperature_k", "cell_n_capacity_loss", "cell_n_temperature_k"),
        ("  chiller_heat_j", "  position_m", "position_m"),
        ("  battery_heat_w", "  ambient_k", "acceleration_command"),
    ],
)
def test_a_mapping_that_is_no_thermal_part_is_refused(
    pack: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    other = tmp_path / "pack.fmu"
    shutil.copy(pack, other)
    text = pack.with_suffix(".yaml").read_text("utf-8")
    other.with_suffix(".yaml").write_text(text.replace(old, new), "utf-8")
    with pytest.raises(IptmError, match=named):
        iptm.simulate("nycc", duration_s=5.0, plant=str(other))


def test_all_cells_of_a_channel_are_refused(pack: Path) -> None:
    with pytest.raises(IptmError, match="full_channel"):
        iptm.simulate("nycc", duration_s=5.0, plant=str(pack), thermal_model="full_channel")
