"""A foreign FMU, written with pythonfmu, as the vehicle of trips; mappings and files that are refused."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.extras.iptm_fmi.drives import STATES

import iptm
from iptm.faults.fault import FaultKind
from iptm_core.errors import IptmError, StateError
from iptm_fmi import foreign_unit
from iptm_fmi.foreign_plant import plant_of

pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
pytest.importorskip("pythonfmu", reason="pythonfmu is not installed (requirements/fmi.txt)")
builder = pytest.importorskip("pythonfmu.builder")

HERE = Path(__file__).parent
CAR = HERE / "foreign_car.py"
MAPPING = (HERE / "foreign_car.yaml").read_text("utf-8")


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The foreign car as an FMU, without a mapping."""
    folder = tmp_path_factory.mktemp("foreign")
    return Path(builder.FmuBuilder.build_FMU(str(CAR), dest=str(folder)))


@pytest.fixture
def car(built: Path, tmp_path: Path) -> Path:
    """The foreign car with its mapping."""
    path = tmp_path / "car.fmu"
    shutil.copy(built, path)
    path.with_suffix(".yaml").write_text(MAPPING, "utf-8")
    return path


def test_a_trip_behind_a_leader_in_a_foreign_car(car: Path) -> None:
    run = iptm.simulate("us06", duration_s=120.0, plant=str(car))
    frame = run.frame
    # Its speed is that of its own law: the commands, as the suite has limited them, integrated.
    moved = np.cumsum(0.5 * (frame.speed_m_s.iloc[1:] + frame.speed_m_s.iloc[:-1].to_numpy()))
    assert frame.position_m.iloc[1:].to_numpy() == pytest.approx(moved.to_numpy(), abs=1e-6)
    assert frame.gap_m.min() > 2.0
    assert run.figures["battery_energy"] > 0.0
    assert "traction_energy" not in run.figures or np.isnan(run.figures["traction_energy"])
    assert any("traction_energy_j" in note for note in run.warnings)
    again = iptm.simulate("us06", duration_s=120.0, plant=str(car)).frame
    for name in STATES.values():
        np.testing.assert_array_equal(again[name], frame[name])


def test_the_monitor_brakes_a_foreign_car(car: Path) -> None:
    stop = iptm.Fault(FaultKind.LEADER_HARD_STOP, 60.0, size=8.0)
    run = iptm.simulate("us06", plant=str(car), duration_s=90.0, faults=[stop])
    assert run.figures["interventions"] > 0.0
    assert run.frame.gap_m.min() > 0.0


@pytest.mark.parametrize("version", [2, 3])
def test_the_own_plant_as_a_foreign_one_changes_nothing(made: Path, version: int) -> None:
    own = iptm.simulate("us06", vehicle="paper_calibrated", duration_s=100.0).frame
    file = str(made / f"plant_{version}.fmu")
    other = iptm.simulate("us06", vehicle="paper_calibrated", duration_s=100.0, plant=file).frame
    for name in STATES.values():
        np.testing.assert_allclose(other[name], own[name], rtol=1e-12, err_msg=name)
    np.testing.assert_allclose(other.battery_power_w, own.battery_power_w, rtol=1e-9, atol=1e-6)


def edited(car: Path, change: Callable[[str], str]) -> str:
    beside = car.with_suffix(".yaml")
    beside.write_text(change(beside.read_text("utf-8")), "utf-8")
    return str(car)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda text: text.replace("v_kmh", "v_mph"), "v_mph"),
        (lambda text: text.replace("unit: km/h,", ""), "unit"),
        (lambda text: text.replace("0.2777777777777778", "0"), "factor"),
        (lambda text: text.replace("0.2777777777777778", "fast"), "fast"),
        (lambda text: text.replace("  speed_m_s", "  speed_kmh"), "speed_kmh"),
        (lambda text: text.replace("inputs:", "given:"), "inputs"),
        (lambda text: text.replace("  position_m", "  #"), "position_m"),
        (lambda text: text + "\n\t- :", "not valid YAML"),
        (lambda _: "- a list", "allowed: inputs, outputs"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(
    car: Path, change: Callable[[str], str], named: str
) -> None:
    with pytest.raises(IptmError, match=named):
        iptm.simulate("nycc", duration_s=5.0, plant=edited(car, change))


def test_a_unit_that_differs_from_the_one_of_the_file_is_refused(
    made: Path, tmp_path: Path
) -> None:
    car = tmp_path / "car.fmu"
    shutil.copy(made / "plant_2.fmu", car)
    rows = {"position_m": "position", "speed_m_s": "speed"}
    text = "inputs: {acceleration_command_m_s2: acceleration_command}\noutputs:\n"
    text += "".join(f"  {what}: {{name: {name}, unit: km/h}}\n" for what, name in rows.items())
    car.with_suffix(".yaml").write_text(text, "utf-8")
    with pytest.raises(IptmError, match=r"'m'.*'km/h'"):
        iptm.simulate("nycc", duration_s=5.0, plant=str(car))


def rewritten(path: Path, target: Path, change: Callable[[str, bytes], tuple[str, bytes]]) -> str:
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            new.writestr(*change(name, old.read(name)))
    return str(target)


def test_files_that_cannot_be_driven_are_refused(made: Path, tmp_path: Path) -> None:
    plant = made / "plant_2.fmu"
    other = rewritten(
        plant,
        tmp_path / "other.fmu",
        lambda name, data: (name.replace("linux64", "win64").replace(".so", ".dll"), data),
    )
    exchange = rewritten(
        plant,
        tmp_path / "exchange.fmu",
        lambda name, data: (
            (name, data.replace(b"CoSimulation", b"ModelExchange"))
            if name == "modelDescription.xml"
            else (name, data)
        ),
    )
    (tmp_path / "text.fmu").write_text("no archive", "utf-8")
    for file, named in (
        (other, "win64"),
        (exchange, "exchange"),
        (str(tmp_path / "text.fmu"), "cannot be read"),
        (str(tmp_path / "none.fmu"), "exists"),
        ("car.slx", r"\*\.fmu"),
    ):
        with pytest.raises(IptmError, match=named):
            iptm.simulate("nycc", duration_s=5.0, plant=file)


@pytest.mark.parametrize(("fault", "named"), [("nan", "t_pack is nan"), ("hang", "not answered")])
def test_a_plant_that_fails_on_the_way_ends_the_trip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str, named: str
) -> None:
    ill = {
        "nan": "        self.t_pack = float('nan') if self.s > 1.0 else self.t_pack\n",
        "hang": "        import time; time.sleep(3.0 if self.s > 1.0 else 0.0)\n",
    }[fault]
    source = tmp_path / f"car_{fault}.py"
    source.write_text(
        CAR.read_text("utf-8").replace("        return True", f"{ill}        return True")
    )
    file = Path(builder.FmuBuilder.build_FMU(str(source), dest=str(tmp_path)))
    file.with_suffix(".yaml").write_text(MAPPING, "utf-8")
    if fault == "hang":
        monkeypatch.setattr(foreign_unit, "TIMEOUT_S", 1.0)
    with pytest.raises(StateError, match=named):
        iptm.simulate("nycc", duration_s=100.0, plant=str(file))


def test_an_fmu_is_asked_for_the_interval_before_or_the_start_only(made: Path) -> None:
    trip = iptm.Trip.of("nycc", vehicle="paper_calibrated")
    plant = plant_of(str(made / "plant_3.fmu"))(trip.parameters, trip.route.slope.slope_at)
    start = plant.initial_state()
    command = plant.observe(start).report.requested
    first = plant.advance(start, command)
    assert plant.advance(start, command).state == first.state
    third = plant.advance(plant.advance(first.state, command).state, command)
    assert third.state.time_s == 3.0
    with pytest.raises(StateError, match="stands at 3 s"):
        plant.advance(first.state, command)
    assert plant.advance(start, command).state == first.state
