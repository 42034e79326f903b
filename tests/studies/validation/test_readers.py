"""Downloaded files are read by content, regardless of their names; damaged ones are reported."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from studies.validation.i3_vehicle import Road
from studies.validation.measurements import Driver, MeasuredData
from studies.validation.readers.folder import files_of, read_files


@pytest.fixture
def reports() -> list[str]:
    return []


def read(folder: Path, reports: list[str]) -> MeasuredData:
    return read_files(files_of(folder), reports.append)


def test_original_trip_of_the_i3(tmp_path: Path, reports: list[str]) -> None:
    names = [
        "Time [s]",
        "Velocity [km/h]]]",
        "Elevation [m]",
        "Motor Torque [Nm]",
        "Battery Voltage [V]",
        "Battery Current [A]",
        "Battery Temperature [°C]",
        "max. Battery Temperature [°C]",
        "SoC [%]",
        "Heating Power CAN [kW]",
        "AirCon Power [kW]",
        "Ambient Temperature [°C]",
        "Heat Exchanger Temperature [°C]",
    ]
    rows = [
        [f"{0.1 * k:.1f}", "36", "500", "20", "360", "-10", "21", "25", "80", "1.5", "", "20", "22"]
        for k in range(40)
    ]
    rows[5][4] = ""  # a missing voltage is not zero
    rows.append([""] * len(names))
    text = "\n".join(";".join(row) for row in [names, *rows])
    (tmp_path / "TripA99.csv").write_bytes(text.encode("latin-1"))
    (trip,) = read(tmp_path, reports).trips
    assert reports == []
    assert trip.name == "A99"
    assert not trip.is_winter
    np.testing.assert_allclose(trip.time_s, [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(trip.speed_m_s, 10.0)
    np.testing.assert_allclose(trip.battery_power_w, 3600.0)
    np.testing.assert_allclose(trip.battery_temperature_k, 294.15)
    np.testing.assert_allclose(trip.charge, 0.8)
    np.testing.assert_allclose(trip.heating_w, 1500.0)
    np.testing.assert_allclose(trip.cooling_w, 0.0)
    np.testing.assert_allclose(trip.ambient_k, 293.15)
    np.testing.assert_allclose(trip.heat_exchanger_k, 295.15)


def test_original_trip_without_optional_channels(tmp_path: Path, reports: list[str]) -> None:
    names = "Time [s];Velocity [km/h];Elevation [m];Motor Torque [Nm];Battery Voltage [V];"
    names += "Battery Current [A];Battery Temperature [°C];Ambient Temperature [°C]"
    rows = [f"{k};{30 + k};500;20;360;-10;21;20" for k in range(30)]
    (tmp_path / "TripA98.csv").write_text("\n".join([names, *rows]), encoding="utf-8")
    (trip,) = read(tmp_path, reports).trips
    assert reports == []
    assert trip.heating_w.max() == 0.0
    assert np.isnan(trip.charge).all()
    # Without the temperature that shows how long it was parked, the car counts as cold.
    assert Road.of(trip).parked_difference_k == 0.0


def platoon(path: Path, metadata: list[str], columns: dict[str, list[str]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*columns.values(), strict=True)
    lines = [*metadata, ",".join(columns), *(",".join(row) + "," for row in rows)]
    path.write_text("\n".join(lines), encoding="utf-8")


def test_original_platoons_of_openacc(tmp_path: Path, reports: list[str]) -> None:
    times = [f"{0.1 * k:.1f}" for k in range(101)]
    speeds = [f"{10.0 + 0.1 * k:.2f}" for k in range(101)]
    gap = ["" if 40 <= k <= 60 else "12.0" for k in range(101)]
    columns = {"Time": times, "Speed1": speeds, "Speed3": gap, "IVS1": ["20"] * 101}
    metadata = ["Date,8,10,2019", "Vehicle_order,A,B,C,", "Number_of_vehicles,3", "ACC,1"]
    platoon(tmp_path / "short" / "dynamic_part1.csv", [*metadata, "Distance_setting,S"], columns)
    by_hand = {**columns, "Driver3": ["Human"] * 101}
    platoon(tmp_path / "astazero" / "platoon3.csv", [*metadata, "Distance_setting,S"], by_hand)
    platoon(tmp_path / "no_ACC" / "part2.csv", [*metadata, "Distance_setting,-"], columns)
    drives = {drive.name: drive for drive in read(tmp_path, reports).drives}
    assert reports == []
    leader, follower = drives["short__dynamic_part1/1"], drives["short__dynamic_part1/3"]
    assert leader.driver is Driver.PROVING_GROUND
    assert follower.driver is Driver.ADAPTIVE_CRUISE_CONTROL
    assert drives["astazero__platoon3/3"].driver is Driver.PROVING_GROUND
    assert drives["no_ACC__part2/3"].driver is Driver.PROVING_GROUND
    assert leader.run == follower.run == "short__dynamic_part1"
    np.testing.assert_allclose(leader.speed_m_s, 10.0 + 0.2 * np.arange(51))
    unknown = np.flatnonzero(np.isnan(follower.speed_m_s)) * follower.step_s
    assert unknown.min() == pytest.approx(4.0)
    assert unknown.max() == pytest.approx(6.0)


def test_original_cell_test(tmp_path: Path, reports: list[str]) -> None:
    time_s = 0.1 * np.arange(400)
    current = np.where(time_s < 10.0, 0.0, -2.0)
    charge = np.cumsum(current) * 0.1 / 3600.0
    measured = {
        "Time": time_s,
        "Voltage": np.where(time_s < 10.0, 4.1, 4.0),
        "Current": current,
        "Ah": charge,
        "Battery_Temp_degC": np.full(400, -10.0),
    }
    savemat(tmp_path / "06-10-17_11.25 n10degC_US06_Pan18650PF.mat", {"meas": measured})
    savemat(tmp_path / "05-08-17_13.26 C20 OCV Test_C20_25dC.mat", {"meas": measured})
    (test,) = read(tmp_path, reports).cell_tests
    assert len(reports) == 1
    assert "C20 OCV" in reports[0]
    assert test.name == "n10degC_US06"
    assert test.chamber_k == pytest.approx(263.15)
    np.testing.assert_allclose(test.time_s, np.arange(31.0))
    np.testing.assert_allclose(test.current_a[1:], 2.0)
    np.testing.assert_allclose(test.voltage_v, [4.1, *[4.0] * 30])
    # The last mean is that of the charge half a second before the end.
    assert test.discharged_ah[-1] == pytest.approx(29.55 * 2.0 / 3600.0, abs=1e-6)


def test_list_of_test_cars(tmp_path: Path, reports: list[str]) -> None:
    header = (
        "Model Year,Represented Test Veh Make,Represented Test Veh Model,Test Vehicle ID,"
        "Test Veh Configuration #,Equivalent Test Weight (lbs.),Test Procedure Cd,"
        "Test Fuel Type Cd,RND_ADJ_FE,Target Coef A (lbf),Target Coef B (lbf/mph),"
        "Target Coef C (lbf/mph**2)"
    )
    rows = [
        "2022,HYUNDAI,One,V1,0,4000,81,62,120.5,30,0.2,0.02",
        "2022,Hyundai,One,V1,0,4000,84,62,30.1,30,0.2,0.02",  # kWh/100 mi
        "2022,Hyundai,Label,V2,0,4000,81,62,129,30,0.2,0.02",  # label values
        "2022,Hyundai,Label,V2,0,4000,84,62,109,30,0.2,0.02",
        "2022,Hyundai,Odd,V3,0,4000,81,62,138.5,30,0.2,0.02",  # of two kinds
        "2022,Hyundai,Odd,V3,0,4000,84,62,38.1,30,0.2,0.02",
        "2022,Hyundai,Petrol,V4,0,4000,81,61,35.2,30,0.2,0.02",
        "2022,Hyundai,Empty,V5,0,4000,81,62,,30,0.2,0.02",
    ]
    (tmp_path / "cars.csv").write_text("\n".join([header, *rows]), encoding="utf-8-sig")
    tests = list(read(tmp_path, reports).dynamometer_tests.itertuples())
    assert [(test.make, test.cycle) for test in tests] == [
        ("Hyundai", "udds"),
        ("Hyundai", "hwfet"),
    ]
    assert tests[0].consumption_wh_km == pytest.approx(33705.0 / 120.5 / 1.609344)
    assert tests[1].consumption_wh_km == pytest.approx(301.0 / 1.609344)
    assert tests[0].mass_kg == pytest.approx(1814.37, abs=0.01)
    assert tests[0].constant_n == pytest.approx(133.447, abs=1e-3)
    # 60 mph: 30 + 12 + 72 lbf
    speed = 60.0 * 0.44704
    force = tests[0].constant_n + tests[0].linear_n_s_m * speed
    force += tests[0].quadratic_n_s2_m2 * speed**2
    assert force == pytest.approx(114.0 * 4.4482216, rel=1e-6)


def test_damaged_and_foreign_files_are_reported_and_the_others_read(
    tmp_path: Path, reports: list[str]
) -> None:
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    (tmp_path / "cut.csv.gz").write_bytes(b"\x1f\x8b\x08\x00broken")
    (tmp_path / "25degC_US06.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    short = "Time [s];Velocity [km/h]\n0.1;5\n0.2;5\n"
    (tmp_path / "TripB99.csv").write_text(short, encoding="utf-8")
    found = read(tmp_path, reports)
    assert not any(len(part) for part in vars(found).values())
    assert sorted(line.split(":")[0] for line in reports) == [
        "25degC_US06.mat",
        "TripB99.csv",
        "cut.csv.gz",
        "empty.csv",
        "notes.csv",
    ]
    assert "Elevation" in next(line for line in reports if line.startswith("TripB99"))
