"""The command line: every field is an option, and mistakes cost one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm.runner.run_closed_loop import build_parser, chosen_scenario, main
from iptm.runner.scenario_files import shipped_scenarios


def test_options_reach_the_scenario() -> None:
    arguments = build_parser().parse_args(
        [
            "demo", "--cycle", "nycc", "--duration-s", "30", "--horizon", "15x1", "--seed", "4",
            "--overrides", "body.mass_kg=1600", "--set", "controller.tolerance=1e-6",
        ]
    )  # fmt: skip
    scenario = chosen_scenario(arguments)
    assert scenario.name == "demo"
    assert scenario.slope == "small"
    assert scenario.trip.duration_s == 30.0
    assert scenario.vehicle.values.body.mass_kg == 1600.0
    assert scenario.horizon == "15x1"
    assert scenario.seed == 4
    assert scenario.node_parameters == {"controller": {"tolerance": 1e-6}}


def test_a_run_of_a_cycle_is_named_after_it(tmp_path: Path) -> None:
    """Before, the folder, the results and the errors of any cycle were called wltc."""
    (tmp_path / "my trip.csv").write_text("time_s,speed_kmh\n" + "".join(
        f"{second},{min(second, 30)}\n" for second in range(40)
    ))  # fmt: skip
    own = chosen_scenario(build_parser().parse_args(["--cycle", str(tmp_path / "my trip.csv")]))
    assert own.name == "my_trip"
    assert own.heading.startswith("my_trip: my trip, ")
    assert chosen_scenario(build_parser().parse_args(["--cycle", "nycc"])).name == "nycc"
    named = chosen_scenario(build_parser().parse_args(["demo", "--cycle", "nycc"]))
    assert named.name == "demo"


def test_the_heading_shows_a_horizon_in_one_form() -> None:
    arguments = build_parser().parse_args(["demo", "--horizon", "3*1"])
    assert "horizon 3x1," in chosen_scenario(arguments).heading


def test_the_list_names_every_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_scenarios())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["wtlc"], "did you mean 'wltc'?"),
        (["--cycle", "moon"], "unknown driving cycle 'moon'"),
        (["--cycle", "us6"], "did you mean 'us06'?"),
        (["--cycle", "WLTC"], "did you mean 'wltc_class3b'?"),
        (["--strategy", "agingg"], "option --strategy is 'agingg'; did you mean 'aging'?"),
        (["--duration", "5"], "argument --duration is unknown; did you mean --duration-s?"),
        (["--duration-s", "-5"], "option --duration-s is -5"),
        (["--horizon", "long"], "horizon 'long' cannot be read"),
        (["--overrides", "body.mas=1"], "body.mas"),
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
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("run_closed_loop: ")
    assert output.err.count("\n") == 1
    assert message in output.err
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
