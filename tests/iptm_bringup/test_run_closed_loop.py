"""The command line: every field is an option, and mistakes cost one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_bringup.run_closed_loop import build_parser, main, prepared_from
from iptm_bringup.scenario import Scenario
from iptm_bringup.scenario_files import shipped_scenarios
from iptm_core.declaration import parameter_specs


def test_every_field_of_a_scenario_is_an_option() -> None:
    text = build_parser().format_help()
    for spec in parameter_specs(Scenario):
        assert f"--{spec.name.replace('_', '-')} " in text
    for option in ("--output", "--no-record", "--no-picture", "--set", "--list"):
        assert option in text


def test_options_reach_the_scenario() -> None:
    arguments = build_parser().parse_args(
        [
            "demo", "--cycle", "nycc", "--duration-s", "30", "--horizon", "15x1", "--seed", "4",
            "--parameter-overrides", "body.mass_kg=1600", "--set", "controller.tolerance=1e-6",
        ]
    )  # fmt: skip
    prepared = prepared_from(arguments)
    assert prepared.scenario.name == "demo"
    assert prepared.scenario.slope == "small"
    assert prepared.route.duration_s == 30.0
    assert prepared.model.values.body.mass_kg == 1600.0
    assert prepared.scenario.horizon == "15x1"
    assert prepared.scenario.seed == 4
    assert prepared.scenario.node_parameters == {"controller": {"tolerance": 1e-6}}


def test_the_list_names_every_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_scenarios())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["wtlc"], "did you mean 'wltc'?"),
        (["--cycle", "moon"], "unknown driving cycle 'moon'"),
        (["--duration-s", "-5"], "option --duration-s is -5"),
        (["--horizon", "long"], "horizon 'long' cannot be read"),
        (["--parameter-overrides", "body.mas=1"], "body.mas"),
        (["--set", "controller"], "option --set is 'controller'"),
        (["--output", "taken"], "taken exists already"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("run_closed_loop: ")
    assert said.err.count("\n") == 1
    assert message in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
