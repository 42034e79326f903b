"""`simulate` and `sweep`: what a notebook gets, from names, files and objects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import iptm
from iptm_core.aging_laws.cells import LAWS
from iptm_core.metrics.figures import figure_values
from iptm_core.routes import load_cycle
from iptm_core.trajectory import TRAJECTORY_COLUMNS

SHORT: dict[str, Any] = {"duration_s": 30.0}


@pytest.fixture(scope="module")
def run() -> iptm.Run:
    return iptm.simulate("us06", horizon="15x1", strategy="aging", **SHORT)


class KeepsSpeed:
    """Accelerates as long as it is slower than the leader, and cools with 300 W."""

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        assert measured.state is not None
        assert measured.leader is not None
        return iptm.Command(measured.leader.speed_m_s - measured.state.speed_m_s, 300.0)


class Constant:
    def predict(self, leader: iptm.LeaderState, times_s: np.ndarray) -> np.ndarray:
        return np.full(times_s.shape, leader.speed_m_s)


def test_a_simulation_is_a_drive_of_its_trip(run: iptm.Run) -> None:
    trip = iptm.Trip.of("us06", horizon="15x1", strategy="aging", **SHORT)
    assert run.trip == trip
    again = iptm.drive(trip)
    for name, values in again.trajectory.to_arrays().items():
        assert np.array_equal(values, run.trajectory.to_arrays()[name], equal_nan=True), name


def test_the_frame_has_a_row_per_tick_and_units_in_its_names(run: iptm.Run) -> None:
    frame = run.frame
    assert frame.index.name == "time_s"
    assert frame.index.tolist() == list(range(31))
    assert {*TRAJECTORY_COLUMNS, "gap_m", "solve_time_s"} <= {"time_s", *frame.columns}
    assert frame["gap_m"].iloc[0] == run.parameters.gap.initial_gap_m
    assert frame["status"].notna().tolist() == [True] * 30 + [False]


def test_the_summary_has_every_figure_with_its_unit(run: iptm.Run) -> None:
    values = figure_values(run.metrics)
    assert run.summary.tolist() == list(values.values())
    assert run.summary["duration [s]"] == 30.0
    assert run.summary["mean_cop [1]"] == values["mean_cop"]


def test_the_picture_shows_in_a_notebook(run: iptm.Run) -> None:
    picture = run.plot(against=run)
    assert picture._repr_png_().startswith(b"\x89PNG")
    titles = [axes.get_title("left") for axes in picture.axes]
    assert titles[0] == "Speed"
    assert "Solver" in titles


def test_the_defaults_are_those_of_the_nodes() -> None:
    run = iptm.simulate("sc03", duration_s=2.0)
    assert run.settings["strategy"] == "aging_cost_to_go"
    assert run.settings["horizon"] == "3x1+5x5"
    assert run.settings["preview_length_s"] == 60.0
    assert run.parameters == iptm.load_parameters().values


@pytest.mark.parametrize("form", ["frame", "index", "arrays", "mapping", "file", "cycle"])
def test_a_cycle_is_welcome_in_every_form(form: str, run: iptm.Run, tmp_path: Path) -> None:
    cycle = load_cycle("us06")
    columns = {"time_s": cycle.times_s, "speed_m_s": cycle.speeds_m_s}
    frame = pd.DataFrame(columns)
    file = tmp_path / "own.csv"
    frame.to_csv(file, index=False)
    given = {
        "frame": frame,
        "index": frame.set_index("time_s"),
        "arrays": (cycle.times_s, cycle.speeds_m_s),
        "mapping": columns,
        "file": file,
        "cycle": cycle,
    }[form]
    own = iptm.simulate(given, horizon="15x1", strategy="aging", **SHORT)
    assert np.array_equal(own.trajectory.battery_power_w, run.trajectory.battery_power_w)


def test_a_vehicle_is_welcome_in_every_form() -> None:
    heavy = iptm.load_parameters("paper_calibrated", {"body.mass_kg": 1850.0}).values
    for given in (
        {"vehicle": {"body.mass_kg": 1850}},
        {"vehicle": {"base": "paper_calibrated", "body": {"mass_kg": np.float64(1850.0)}}},
        {"vehicle": heavy},
        {"overrides": {"body.mass_kg": 1850.0}},
    ):
        run = iptm.simulate("sc03", duration_s=1.0, **given)
        assert run.parameters == heavy


def test_a_strategy_is_welcome_in_every_form() -> None:
    aging = iptm.STRATEGIES["aging"]
    for strategy in (aging, "aging", {"base": "aging", "aging_weight": 1e9}):
        run = iptm.simulate("us06", horizon="3x1", strategy=strategy, **SHORT)
        assert run.settings["strategy"] == "aging"
        assert run.settings["aging_weight"] == -1.0
    run = iptm.simulate(
        "us06", horizon="3x1", strategy={"base": "aging", "aging_weight": 2e9}, **SHORT
    )
    assert run.settings["aging_weight"] == 2e9


def test_an_own_controller_drives_within_the_bounds_of_the_vehicle() -> None:
    run = iptm.simulate("us06", duration_s=60.0, controller=KeepsSpeed())
    limits = run.parameters.limits
    assert run.trajectory.speed_m_s.max() > 5.0
    assert run.trajectory.acceleration_m_s2.max() <= limits.max_acceleration_m_s2 + 1e-9
    assert run.trajectory.compressor_power_w[-1] == pytest.approx(300.0)
    assert run.settings["strategy"] == "own"
    assert "KeepsSpeed" in run.name


def test_a_desired_headway_is_kept_without_a_preview() -> None:
    """To 0.2 s in the median; the reserve for comfort would take nearly twice the road."""
    medians_s = []
    for desired_s in (0.0, 1.65):
        run = iptm.simulate(
            "udds",
            duration_s=180.0,
            preview_mode="none",
            overrides={"gap.desired_time_headway_s": desired_s, "gap.max_time_headway_s": 3.0},
        )
        trip = run.trajectory
        moving = trip.speed_m_s > 5.0
        wanted_s = 1.65 + run.parameters.gap.standstill_gap_m / trip.speed_m_s[moving]
        medians_s.append(np.median(trip.gap_m[moving] / trip.speed_m_s[moving] - wanted_s))
        assert trip.gap_m.min() > 0.0
        assert run.metrics.interventions == 0
    assert abs(medians_s[1]) < 0.2 < medians_s[0] - medians_s[1]


def test_an_own_predictor_is_what_the_controller_hears() -> None:
    run = iptm.simulate("us06", horizon="15x1", strategy="aging", predictor=Constant(), **SHORT)
    true = iptm.simulate("us06", horizon="15x1", strategy="aging", **SHORT)
    assert run.trajectory.leader_position_m.tolist() == true.trajectory.leader_position_m.tolist()
    assert run.trajectory.position_m.tolist() != true.trajectory.position_m.tolist()


def test_a_law_of_a_cell_cools_where_a_kelvin_saves_more_than_its_energy_costs() -> None:
    """From 28 degC and with dear energy: parked in a Phoenix July it pays, in an Oslo January it does not."""
    warm = {"environment.initial_cell_temperature_k": 301.15}

    def drive(law: Any, air_k: float, year_air_k: float) -> iptm.Run:
        use = {"parking_air_k": air_k, "year_air_k": year_air_k, "year_air_swing_k": 11.0}
        dear = {"aging_law": law, "electricity_eur_kwh": 0.7, **use}
        return iptm.simulate("us06", horizon="3x1", overrides=warm, **dear, **SHORT)

    phoenix, own = drive("nmc622", 308.75, 297.6), drive(LAWS["nmc622"], 308.75, 297.6)
    powers_w = phoenix.trajectory.compressor_power_w
    assert powers_w.max() > 500.0
    assert own.trajectory.compressor_power_w.tolist() == powers_w.tolist()
    assert (phoenix.settings["aging_law"], own.settings["aging_law"]) == ("nmc622", "NMC622")
    assert own.name.endswith("law NMC622")
    oslo = drive("nmc622", 268.65, 279.4)
    assert oslo.trajectory.compressor_power_w.max() < 1.0


def test_a_sweep_drives_every_combination() -> None:
    sweep = iptm.sweep(
        cycle=["us06", "udds"],
        overrides={"environment.ambient_temperature_k": [273.15, 308.15], "body.mass_kg": 1500.0},
        horizon="3x1",
        duration_s=5.0,
    )
    assert sweep.table.index.names == ["cycle", "environment.ambient_temperature_k"]
    assert sweep.table.index.tolist() == [
        ("us06", 273.15), ("us06", 308.15), ("udds", 273.15), ("udds", 308.15),
    ]  # fmt: skip
    assert sweep.table["duration [s]"].tolist() == [5.0] * 4
    assert sweep.runs[3].parameters.environment.ambient_temperature_k == 308.15
    assert sweep.runs[3].parameters.body.mass_kg == 1500.0


def test_ranges_and_arrays_are_swept_and_savings_refer_to_the_run_named() -> None:
    sweep = iptm.sweep(
        cycle="us06",
        overrides={"body.mass_kg": np.linspace(1500.0, 1600.0, 2)},
        strategy=["production", "reference"],
        horizon="3x1",
        duration_s=5.0,
    )
    masses = [1500.0, 1500.0, 1600.0, 1600.0]
    assert sweep.varied["body.mass_kg"].tolist() == masses
    savings = sweep.savings(strategy="reference")
    as_driven = savings["energy_saved_as_driven [%]"].tolist()
    assert as_driven[1] == as_driven[3] == 0.0
    energies = [run.metrics.battery_energy_j / run.metrics.distance_m for run in sweep.runs]
    assert as_driven[2] == pytest.approx(100.0 * (1.0 - energies[2] / energies[3]))
    assert savings["aging_saved [%]"].isna().all()
    assert set(savings["judgement"]) == {"too short to judge"}
    with pytest.raises(iptm.IptmError, match="no run has "):
        sweep.savings(strategy="aging")


class Broken:
    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def decide(self, _: Any) -> Any:
        return self.answer

    predict = None


class BrokenPredictor:
    def predict(self, _: Any, times_s: np.ndarray) -> Any:
        return times_s[:-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"strategy": "agin"}, "strategy is 'agin'; did you mean 'aging'"),
        ({"strategy": 3}, "strategy is 3; allowed: a name, iptm.Strategy"),
        ({"cycle": "us6"}, "did you mean 'us06'"),
        ({"cycle": 3}, "cycle is 3; allowed: a name, a path, a DataFrame"),
        (
            {"cycle": {"time_s": [0, 1, 2], "speed": [0, 1, 2]}},
            "unknown column 'speed'.* allowed: time_s, speed_m_s",
        ),
        ({"cycle": ([0, 1, 2], [0, 1])}, "own drive: columns have"),
        (
            {"cycle": ([0, 1, 2], [0, 1, np.nan])},
            "the trip lasts 1 s in 2 rows|value nan; allowed: a finite",
        ),
        ({"cycle": ([0, 1, 2], [0, 1, 90])}, "own drive, row 2, column speed_m_s"),
        ({"vehicle": 3}, "vehicle is 3; allowed: iptm.Vehicle, a parameter set"),
        ({"vehicle": {"body": {"mass_kg": -1}}}, "body.mass_kg is -1.0; allowed: 100 to"),
        ({"overrides": [1]}, r"overrides is \[1\]; allowed: a mapping"),
        ({"overrides": {"body.mas": 1}}, "did you mean 'body.mass_kg'"),
        ({"overrides": {"body.mass_kg": "heavy"}}, "body.mass_kg is 'heavy'; allowed: a number"),
        ({"strateg": "aging"}, "unknown key 'strateg'; did you mean 'strategy'"),
        ({"horizon": 15}, "horizon is 15"),
        ({"faults": 3}, "faults is 3; allowed: "),
        ({"aging_law": "nmc"}, "aging_law is 'nmc'.* allowed: one of paper, nca"),
        ({"charging_target": 1.2}, "charging_target is 1.2 .* allowed: a number from 0 to 1"),
        ({"controller": 3}, "controller is 3; allowed: an object with the method decide"),
        ({"controller": KeepsSpeed}, "controller is <class .* allowed: an object"),
        ({"predictor": Broken(1)}, "predictor is .* allowed: an object with the method predict"),
        ({"controller": Broken(None)}, "decide returned None; allowed: iptm.Command"),
        (
            {"controller": Broken(iptm.Command(np.nan, 0.0))},
            r"decide returned Command\(acceleration_m_s2=nan",
        ),
        ({"predictor": BrokenPredictor(), "horizon": "3x1", **SHORT}, "predict returned .* speeds"),
    ],
)
def test_a_mistake_is_one_line(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(iptm.IptmError, match=message) as raised:
        iptm.simulate(**arguments)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("arguments", [{}, {"cycle": "us06"}, {"strategy": []}])
def test_a_sweep_needs_lists(arguments: dict[str, Any]) -> None:
    with pytest.raises(iptm.IptmError, match="allowed: one or more, none empty"):
        iptm.sweep(**arguments)


def test_what_was_repaired_in_a_drive_is_in_the_warnings_of_its_run(tmp_path: Path) -> None:
    pytest.importorskip("iptm_drives", reason="the extra is not installed")
    times = np.arange(0.0, 31.0)
    speeds = np.minimum(times, 10.0)
    drive = pd.DataFrame({"time_s": times, "speed_m_s": np.where(times == 20.0, np.nan, speeds)})
    run = iptm.simulate(drive, horizon="3x1", **SHORT)
    assert "speed_m_s missing at 1 row" in run.warnings
    assert "speed_m_s missing at 1 row" in run.report(tmp_path / "run.html").read_text()


def test_a_trip_that_ends_early_is_a_problem_of_the_run(tmp_path: Path) -> None:
    """A pack that cannot deliver: named by the run, by a comparison, its page and a sweep."""
    trip = {"cycle": "us06", "duration_s": 30.0, "horizon": "3x1"}
    heavy = {"overrides": {"body.mass_kg": 40000}}
    short, whole = iptm.simulate(**trip, **heavy), iptm.simulate(**trip)
    (problem,) = short.problems
    assert problem.startswith("the trip ended early, at ")
    assert problem in repr(short)
    assert not whole.problems
    both = iptm.compare(whole, short)
    assert problem in both.report(tmp_path / "both.html").read_text(encoding="utf-8")
    assert next(iter(both.savings.values())).energy.percent != 0.0
    rows = iptm.sweep(**{**trip, "overrides": [None, heavy["overrides"]]}).table
    assert rows["problems"].tolist() == ["", problem]


def test_the_mean_acceleration_of_a_row_integrates_to_the_speed() -> None:
    """Where the monitor brakes inside an interval, the acceleration of the row is the one at its end."""
    frame = iptm.simulate("us06", strategy="production", preview_mode="none", horizon="3x1").frame
    assert frame.service_braking_s.sum() > 0.0
    steps_s = np.diff(frame.index)
    speeds = np.cumsum(frame.mean_acceleration_m_s2.to_numpy()[1:] * steps_s)
    np.testing.assert_allclose(speeds, frame.speed_m_s.to_numpy()[1:], atol=1e-9)
    ends = np.cumsum(frame.acceleration_m_s2.to_numpy()[1:] * steps_s)
    assert np.abs(ends - frame.speed_m_s.to_numpy()[1:]).max() > 1.0


def test_a_tuple_is_a_list_and_a_climate_is_in_degrees_celsius() -> None:
    sweep = iptm.sweep(cycle="us06", duration_s=(10.0, 20.0), strategy="production")
    assert [run.metrics.duration_s for run in sweep.runs] == [10.0, 20.0]
    cold = iptm.Trip.of(cycle="us06", climate=-20).parameters.environment
    assert cold.ambient_temperature_k == 253.15
    with pytest.raises(iptm.IptmError, match=r"climate is 308.15 degC.*would be 35 degC"):
        iptm.Trip.of(cycle="us06", climate=308.15)
    with pytest.raises(iptm.IptmError, match="--cycle us06"):
        iptm.load_trip("us06")
