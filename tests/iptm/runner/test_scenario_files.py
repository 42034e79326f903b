"""Scenario files: everything shipped works, everything unknown or out of range is named and refused."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml

from iptm.runner.scenario import Scenario, prepare
from iptm.runner.scenario_files import (
    DEFAULT_SCENARIO,
    load_scenario,
    scenario_from,
    scenario_text,
    shipped_scenarios,
    with_node_parameters,
)
from iptm_core.declaration import parameter_specs
from iptm_core.errors import ScenarioError
from iptm_core.settings import PreviewMode


def write(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_promised_scenarios_are_shipped() -> None:
    assert shipped_scenarios()[0] == DEFAULT_SCENARIO == "wltc"
    assert set(shipped_scenarios()) == {
        "wltc", "comprehensive", "demo", "imperfect_preview", "real_time"
    }  # fmt: skip


@pytest.mark.parametrize("name", shipped_scenarios())
def test_shipped_scenarios_are_sound_and_described(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    scenario = prepare(scenario)
    expected_s = {"wltc": 1800.0, "comprehensive": 10000.0, "demo": 120.0}
    assert scenario.trip.duration_s == expected_s.get(name, scenario.trip.duration_s)


def test_an_empty_file_is_the_default_scenario(tmp_path: Path) -> None:
    assert load_scenario(write(tmp_path, "")) == replace(Scenario(), name="mine")


def test_text_of_a_scenario_reads_back(tmp_path: Path) -> None:
    scenario = Scenario(
        name="mine",
        description="öfter mal was Neues: yes",
        cycle="us06",
        overrides="body.mass_kg=1600.5, gap.max_gap_m=80",
        horizon="15x1",
        preview_mode=PreviewMode.NONE,
        latency_s=0.1 + 0.2,
        seed=2**62,
        namespace="1e3",
        node_parameters={"controller": {"deadline_ms": 50.0, "compile_code": False}},
    )
    assert load_scenario(write(tmp_path, scenario_text(scenario))) == scenario


def test_overrides_may_be_a_mapping(tmp_path: Path) -> None:
    path = write(tmp_path, "overrides: {body.mass_kg: 1600, gap.max_gap_m: 80.5}\n")
    scenario = prepare(load_scenario(path))
    assert scenario.overrides == "body.mass_kg=1600, gap.max_gap_m=80.5"
    assert scenario.vehicle.values.body.mass_kg == 1600.0
    assert scenario.vehicle.values.gap.max_gap_m == 80.5


def test_relative_files_start_at_the_folder_of_the_scenario(tmp_path: Path) -> None:
    write(tmp_path, "time_s,speed_kmh\n0,0\n1,3\n2,6\n3,0\n", "trace.csv")
    write(tmp_path, "base: paper_calibrated\n", "car.yaml")
    path = write(tmp_path, "cycle: trace.csv\nparameter_set: car.yaml\n")
    scenario = prepare(load_scenario(path))
    assert scenario.cycle == str(tmp_path / "trace.csv")
    assert scenario.trip.duration_s == 3.0
    assert scenario.vehicle.name == "car"


@pytest.mark.parametrize("cycle", ["traffic.fcd.xml#leader", "runs/us06", "runs/string#car_2"])
def test_drives_of_one_vehicle_start_there_too(tmp_path: Path, cycle: str) -> None:
    assert load_scenario(write(tmp_path, f"cycle: {cycle}\n")).cycle == str(tmp_path / cycle)


def test_options_come_last(tmp_path: Path) -> None:
    path = write(tmp_path, "duration_s: 60\ncycle: us06\n")
    scenario = load_scenario(path, {"duration_s": "1e2", "cycle": "nycc", "seed": "7"})
    assert (scenario.duration_s, scenario.cycle, scenario.seed) == (100.0, "nycc", 7)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("cycel: us06", ("mine.yaml", "unknown key 'cycel'", "did you mean 'cycle'?")),
        ("duration_s: long", ("mine.yaml", "duration_s is 'long'", "0 to 1e+06 s")),
        ("duration_s: -1", ("duration_s is -1", "allowed: a number from 0")),
        ("duration_s: .nan", ("duration_s is nan", "allowed")),
        ("duration_s: true", ("duration_s is True", "allowed: a number")),
        ("dropout_probability: 1.5", ("dropout_probability is 1.5", "0 to 1")),
        ("dropout_burst: 2.5", ("dropout_burst is 2.5", "whole number")),
        ("strategy: fastest", ("strategy is 'fastest'", "reference", "aging")),
        ("solver: magic", ("solver is 'magic'", "riccati")),
        ("mode: slow", ("mode is 'slow'", "lock_step, real_time")),
        ("slope: steep", ("slope is 'steep'", "as_designed")),
        ("cycle: 5", ("cycle is 5", "a text")),
        ("description: 5", ("description is 5", "a text")),
        ("seed: 1\nseed: 2", ("mine.yaml", "'seed' occurs twice")),
        ("[1, 2]", ("mine.yaml holds [1, 2]", "allowed: a mapping")),
        ("a: {", ("mine.yaml", "not valid YAML")),
        (
            "preview_length_s: 5\npreview_step_s: 10",
            ("scenario mine", "preview_step_s is 10", "5 s"),
        ),
        ("overrides: {body.mass_kg: heavy}", ("body.mass_kg is 'heavy'", "a number")),
        ("node_parameters: 3", ("node_parameters holds 3", "a mapping")),
        ("node_parameters: {plnt: {}}", ("unknown node 'plnt'", "did you mean 'plant'?")),
        ("node_parameters: {plant: 3}", ("plant holds 3", "a mapping")),
        ("node_parameters: {plant: {period_s: [1]}}", ("plant: period_s is [1]", "a number")),
    ],
)
def test_a_wrong_file_is_refused_with_key_value_and_what_is_allowed(
    tmp_path: Path, text: str, parts: tuple[str, ...]
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(write(tmp_path, text))
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration_s": "soon"}, "option --duration-s is 'soon'"),
        ({"seed": "1.5"}, "option --seed is 1.5"),
        ({"strategy": "x"}, "option --strategy is 'x'"),
        ({"rate_factor": "nan"}, "option --rate-factor is 'nan'"),
    ],
)
def test_a_wrong_option_is_named(options: dict[str, str], message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("wltc", options)
    assert str(caught.value).startswith(message)
    assert "allowed" in str(caught.value)


def test_unknown_scenario_and_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="did you mean 'wltc'"):
        load_scenario("wtlc")
    with pytest.raises(ScenarioError, match="no such file"):
        load_scenario(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ({"cycle": "moon"}, ("cycle", "unknown driving cycle 'moon'", "wltc_class3b")),
        ({"cycle": "none.csv"}, ("cycle", "none.csv")),
        ({"horizon": "3y1"}, ("horizon", "'3y1'", "3x1+5x5")),
        ({"parameter_set": "mine"}, ("parameter_set", "mine", "paper_calibrated")),
        ({"overrides": "body.mass=3"}, ("body.mass", "did you mean")),
        ({"overrides": "body.mass_kg=3"}, ("body.mass_kg", "100")),
        ({"namespace": "car 1"}, ("namespace", "allowed: letters")),
    ],
)
def test_parts_that_do_not_fit_are_refused_before_anything_starts(
    content: dict[str, object], parts: tuple[str, ...]
) -> None:
    scenario = scenario_from(content, "file", "mine", Path())
    with pytest.raises(ScenarioError) as caught:
        prepare(scenario)
    assert str(caught.value).startswith("scenario mine: ")
    for part in parts:
        assert part in str(caught.value)


def test_nodes_that_need_it_must_have_one_period() -> None:
    with pytest.raises(ScenarioError, match="period_s is 2 s for plant and 1 s for controller"):
        prepare(Scenario(node_parameters={"plant": {"period_s": 2.0}}))
    both = {"plant": {"period_s": 2}, "controller": {"period_s": 2.0}}
    prepare(Scenario(node_parameters=both))
    with pytest.raises(ScenarioError, match="period_s is 2 s for plant and 1 s for v2x_bridge"):
        prepare(Scenario(node_parameters=both, clock_hz=10.0))


def test_numbers_only_python_understands_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"body\.mass_kg=1_600"):
        prepare(Scenario(overrides="body.mass_kg=1_600"))


def test_a_scenario_with_a_name_no_file_can_have() -> None:
    with pytest.raises(ScenarioError, match="too long"):
        load_scenario("x" * 300)


def test_node_parameters_are_laid_over_those_of_the_file() -> None:
    scenario = Scenario(node_parameters={"controller": {"tolerance": 1e-6}})
    merged = with_node_parameters(
        scenario, ["controller.deadline_ms=50", "plant.on_lost_controller=wait"]
    )
    assert merged == {
        "controller": {"tolerance": 1e-6, "deadline_ms": 50},
        "plant": {"on_lost_controller": "wait"},
    }
    for wrong in ("controller.deadline_ms", "deadline_ms=50", "nobody.x=1", "plant.x=[1]", "=3"):
        with pytest.raises(ScenarioError, match="option --set"):
            with_node_parameters(scenario, [wrong])


def test_every_field_can_be_set() -> None:
    known = {spec.name for spec in parameter_specs(Scenario)} | {
        "name",
        "description",
        "node_parameters",
        "faults",
        "foreign",
    }
    assert known == {entry.name for entry in fields(Scenario)}
    content = yaml.safe_load(scenario_text(Scenario()))
    assert content.keys() == known - {"name", "node_parameters", "faults", "foreign"}
