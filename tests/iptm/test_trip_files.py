"""Files of trips: everything shipped works, everything unknown or out of range is named and refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.trip import Trip
from iptm.trip_files import (
    DEFAULT_TRIP,
    assigned,
    load_trip,
    shipped_trips,
    trip_from,
    trip_text,
)
from iptm.trip_settings import GROUPS, SPECS
from iptm_core.errors import ScenarioError
from iptm_core.settings import PreviewMode


def write(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_promised_trips_are_shipped() -> None:
    assert shipped_trips()[0] == DEFAULT_TRIP == "wltc"
    assert set(shipped_trips()) == {
        "wltc", "comprehensive", "demo", "imperfect_preview", "real_time"
    }  # fmt: skip


@pytest.mark.parametrize("name", shipped_trips())
def test_shipped_trips_are_sound_and_described(name: str) -> None:
    trip = load_trip(name).checked()
    assert trip.name == name
    assert trip.description
    expected_s = {"wltc": 1800.0, "comprehensive": 10000.0, "demo": 120.0}
    assert trip.route.duration_s == expected_s.get(name, trip.route.duration_s)


def test_an_empty_file_is_the_default_trip(tmp_path: Path) -> None:
    assert load_trip(write(tmp_path, "")) == replace(Trip(), name="mine")


def test_text_of_a_trip_reads_back(tmp_path: Path) -> None:
    trip = Trip.of(
        "us06",
        name="mine",
        description="öfter mal was Neues: yes",
        overrides="body.mass_kg=1600.5, gap.max_gap_m=80",
        controller_overrides={"body.mass_kg": 1500},
        horizon="15x1",
        preview_mode=PreviewMode.NONE,
        latency_s=0.1 + 0.2,
        seed=2**62,
        namespace="1e3",
        deadline_ms=50.0,
        faults=[Fault(FaultKind.LEADER_HARD_STOP, 120.0, size=4.0)],
    )
    assert load_trip(write(tmp_path, trip_text(trip))) == trip


def test_a_text_states_every_setting() -> None:
    content = yaml.safe_load(trip_text(Trip()))
    assert content.keys() == {"description", *GROUPS}
    assert {name for group in GROUPS for name in content[group]} == set(SPECS)


def test_a_drive_given_as_data_is_in_no_file() -> None:
    trip = Trip.of(([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]))
    with pytest.raises(ScenarioError, match="a drive given as data; allowed here: a name or"):
        trip_text(trip)


def test_overrides_may_be_a_mapping(tmp_path: Path) -> None:
    path = write(tmp_path, "vehicle: {overrides: {gap.max_gap_m: 80.5, body.mass_kg: 1600}}\n")
    trip = load_trip(path)
    assert trip.vehicle.overrides == "body.mass_kg=1600.0, gap.max_gap_m=80.5"
    assert trip.parameters.body.mass_kg == 1600.0
    assert trip.parameters.gap.max_gap_m == 80.5


def test_relative_files_start_at_the_folder_of_the_trip(tmp_path: Path) -> None:
    write(tmp_path, "time_s,speed_kmh\n0,0\n1,3\n2,6\n3,0\n", "trace.csv")
    write(tmp_path, "base: paper_calibrated\n", "car.yaml")
    text = "road: {cycle: trace.csv}\nvehicle: {parameter_set: car.yaml}\n"
    trip = load_trip(write(tmp_path, text))
    assert trip.road.cycle == str(tmp_path / "trace.csv")
    assert trip.route.duration_s == 3.0
    assert trip.model.name == "car"


@pytest.mark.parametrize("cycle", ["traffic.fcd.xml#leader", "runs/us06", "runs/string#car_2"])
def test_drives_of_one_vehicle_start_there_too(tmp_path: Path, cycle: str) -> None:
    path = write(tmp_path, f"road: {{cycle: '{cycle}'}}\n")
    assert load_trip(path).road.cycle == str(tmp_path / cycle)


def test_options_come_last(tmp_path: Path) -> None:
    path = write(tmp_path, "road: {duration_s: 60, cycle: us06}\n")
    trip = load_trip(path, {"duration_s": "1e2", "cycle": "nycc", "seed": "7"})
    assert (trip.road.duration_s, trip.road.cycle, trip.leader.seed) == (100.0, "nycc", 7)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("raod: {}", ("mine.yaml", "unknown key 'raod'", "did you mean 'road'?")),
        ("road: {cycel: us06}", ("mine.yaml: road", "unknown key 'cycel'", "'cycle'?")),
        ("road: {seed: 1}", ("mine.yaml: road", "unknown key 'seed'")),
        ("road: 3", ("road holds 3", "a mapping")),
        ("road: {duration_s: long}", ("mine.yaml", "duration_s is 'long'", "0 to 1e+06 s")),
        ("road: {duration_s: -1}", ("duration_s is -1", "allowed: a number from 0")),
        ("road: {duration_s: .nan}", ("duration_s is nan", "allowed")),
        ("road: {duration_s: true}", ("duration_s is True", "allowed: a number")),
        ("leader: {dropout_probability: 1.5}", ("dropout_probability is 1.5", "0 to 1")),
        ("leader: {dropout_burst: 2.5}", ("dropout_burst is 2.5", "whole number")),
        ("controller: {strategy: fastest}", ("strategy is 'fastest'", "reference", "aging")),
        ("conditions: {mode: slow}", ("mode is 'slow'", "lock_step, real_time")),
        ("road: {slope: steep}", ("slope is 'steep'", "as_designed")),
        ("road: {cycle: 5}", ("cycle is 5", "a text")),
        ("description: 5", ("description is 5", "a text")),
        ("leader: {seed: 1, seed: 2}", ("mine.yaml", "'seed' occurs twice")),
        ("[1, 2]", ("mine.yaml holds [1, 2]", "allowed: a mapping")),
        ("a: {", ("mine.yaml", "not valid YAML")),
        (
            "leader: {preview_length_s: 5, preview_step_s: 10}",
            ("trip mine", "preview_step_s is 10", "5 s"),
        ),
        (
            "leader: {preview_length_s: 3600, preview_step_s: 0.5}",
            ("trip mine", "preview_step_s is 0.5", "at most 3600 steps"),
        ),
        ("vehicle: {overrides: {body.mass_kg: heavy}}", ("body.mass_kg is 'heavy'", "a number")),
        (
            "conditions: {faults: [{kind: leader_hard_stopp}]}",
            ("mine.yaml", "fault 1: kind is 'leader_hard_stopp'"),
        ),
        (
            "{leader: {leader_source: none}, road: {speed_limits_km_h: '0:50'},"  # noqa: ISC004
            " conditions: {faults: [{kind: leader_hard_stop}]}}",
            ("fault is leader_hard_stop with leader_source none",),
        ),
    ],
)
def test_a_wrong_file_is_refused_with_key_value_and_what_is_allowed(
    tmp_path: Path, text: str, parts: tuple[str, ...]
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_trip(write(tmp_path, text))
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration_s": "soon"}, "option road.duration_s is 'soon'"),
        ({"seed": "1.5"}, "option leader.seed is 1.5"),
        ({"strategy": "x"}, "option controller.strategy is 'x'"),
        ({"rate_factor": "nan"}, "option conditions.rate_factor is 'nan'"),
    ],
)
def test_a_wrong_option_is_named(options: dict[str, str], message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_trip("wltc", options)
    assert str(caught.value).startswith(message)
    assert "allowed" in str(caught.value)


def test_unknown_trip_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="did you mean 'wltc'"):
        load_trip("wtlc")
    with pytest.raises(ScenarioError, match="no such file"):
        load_trip(tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="too long"):
        load_trip("x" * 300)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ({"road": {"cycle": "moon"}}, ("cycle", "unknown driving cycle 'moon'", "wltc_class3b")),
        ({"road": {"cycle": "none.csv"}}, ("cycle", "none.csv")),
        ({"controller": {"horizon": "3y1"}}, ("horizon", "'3y1'", "3x1+5x5")),
        ({"vehicle": {"parameter_set": "mine"}}, ("parameter_set", "mine", "paper_calibrated")),
        ({"vehicle": {"overrides": "body.mass=3"}}, ("body.mass", "did you mean")),
        ({"vehicle": {"overrides": "body.mass_kg=3"}}, ("body.mass_kg", "100")),
        ({"vehicle": {"overrides": "body.mass_kg=1_600"}}, ("body.mass_kg=1_600",)),
        ({"conditions": {"period_s": 7.0}}, ("1800 s with ticks of 7 s", "a whole number")),
    ],
)
def test_parts_that_do_not_fit_are_refused_before_anything_starts(
    content: dict[str, object], parts: tuple[str, ...]
) -> None:
    with pytest.raises(ScenarioError) as caught:
        trip_from(content, "file", "mine", Path()).checked()
    assert str(caught.value).startswith("trip mine: ")
    for part in parts:
        assert part in str(caught.value)


def test_assignments_name_group_and_setting() -> None:
    assert assigned(["controller.deadline_ms=50", "conditions.on_lost_controller=wait"]) == {
        "deadline_ms": "50",
        "on_lost_controller": "wait",
    }
    for wrong in (
        "controller.deadline_ms", "deadline_ms=50", "nobody.x=1", "vehicle.deadline_ms=1", "=3"
    ):  # fmt: skip
        with pytest.raises(ScenarioError, match="option --set"):
            assigned([wrong])


def test_faults_are_an_option_as_well() -> None:
    trip = load_trip("demo", assigned(["conditions.faults=[{kind: leader_hard_stop, start_s: 9}]"]))
    assert trip.conditions.faults == (Fault(FaultKind.LEADER_HARD_STOP, 9.0),)


def test_a_setting_that_was_given_up_may_be_stated_at_its_default_only() -> None:
    trip = trip_from({"controller": {"charging_minute_kwh": 0.0}}, "bag", "mine", Path())
    assert trip.checked() == trip_from({}, "bag", "mine", Path())
    with pytest.raises(ScenarioError, match="unknown key 'charging_minute_kwh'"):
        trip_from({"controller": {"charging_minute_kwh": 0.2}}, "bag", "mine", Path())
