"""The command `iptm run`: options reach the trip, and mistakes cost one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm.commands.run import WATCHING_RATE, build_parser, chosen_trip, main
from iptm.trip import Trip
from iptm.trip_files import shipped_trips
from iptm.trip_settings import HOME
from iptm_core.settings import LoopMode


def trip_of(*arguments: str) -> Trip:
    parsed = build_parser().parse_args(arguments)
    return chosen_trip(parsed, watched=parsed.view)


def test_options_reach_the_trip() -> None:
    trip = trip_of(
        "demo", "--cycle", "nycc", "--duration-s", "30", "--horizon", "15x1",
        "--set", "leader.seed=4", "--overrides", "body.mass_kg=1600", "--set", "controller.tolerance=1e-6",
    )  # fmt: skip
    assert trip.name == "demo"
    assert trip.road.slope == "small"
    assert trip.route.duration_s == 30.0
    assert trip.parameters.body.mass_kg == 1600.0
    assert trip.controller.horizon == "15x1"
    assert trip.leader.seed == 4
    assert trip.controller.tolerance == 1e-6


def test_a_run_of_a_cycle_is_named_after_it(tmp_path: Path) -> None:
    (tmp_path / "my trip.csv").write_text("time_s,speed_kmh\n" + "".join(
        f"{second},{min(second, 30)}\n" for second in range(40)
    ))  # fmt: skip
    own = trip_of("--cycle", str(tmp_path / "my trip.csv"))
    assert own.name == "my_trip"
    assert own.heading.startswith("my trip, ")
    assert trip_of("--cycle", "nycc").name == "nycc"
    assert trip_of("demo", "--cycle", "nycc").name == "demo"


@pytest.mark.parametrize(
    ("options", "mode", "rate_factor", "pace"),
    [
        (["demo"], LoopMode.LOCK_STEP, 1.0, 0.0),
        (["demo", "--view"], LoopMode.LOCK_STEP, 1.0, WATCHING_RATE),
        (["demo", "--view", "--rate-factor", "3"], LoopMode.REAL_TIME, 3.0, 0.0),
        (["demo", "--view", "--mode", "lock_step"], LoopMode.LOCK_STEP, 1.0, 0.0),
        (["real_time", "--view"], LoopMode.REAL_TIME, 1.0, 0.0),
    ],
)
def test_who_watches_gets_a_pace_that_can_be_watched(
    options: list[str], mode: LoopMode, rate_factor: float, pace: float
) -> None:
    trip = trip_of(*options)
    found = trip.conditions
    assert (found.mode, found.rate_factor, found.pace) == (mode, rate_factor, pace)
    assert "pace" not in trip.heading, "what is driven does not depend on it"


def test_the_list_names_every_trip(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_trips())


def test_the_settings_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--settings"]) == 0
    lines = capsys.readouterr().out.splitlines()[::2]
    names = {line.partition("=")[0] for line in lines}
    assert names == {f"{group}.{name}" for name, group in HOME.items() if name != "faults"}
    assert main(["--settings", "road"]) == 0
    assert capsys.readouterr().out.startswith("road.cycle=wltc_class3b")


def test_a_trip_in_memory_ends_with_its_summary(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["demo", "--duration-s", "10", "--over", "memory", "--against", "reference"]
    assert main(options) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("us06, slope small, 10 s, 3x1+5x5")
    assert lines[1].startswith("energy  ")
    assert "too short to judge" in lines[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["wtlc"], "did you mean 'wltc'?"),
        (["--cycle", "moon"], "unknown driving cycle 'moon'"),
        (["--cycle", "us6"], "did you mean 'us06'?"),
        (["--cycle", "WLTC"], "did you mean 'wltc_class3b'?"),
        (["--strategy", "agingg"], "option controller.strategy is 'agingg'; did you mean 'aging'?"),
        (["--duration", "5"], "argument --duration is unknown; did you mean --duration-s?"),
        (["--duration-s", "-5"], "option road.duration_s is -5"),
        (["--horizon", "long"], "horizon 'long' cannot be read"),
        (["--overrides", "body.mas=1"], "body.mas"),
        (["--latency-s", "1"], "unknown; allowed: --set leader.latency_s=VALUE"),
        (["--set", "controller"], "option --set is 'controller'"),
        (["--set", "controller.deadline=1"], "did you mean 'deadline_ms'?"),
        (["--set", "conditions.namespace=car 1"], "allowed: letters, digits and _"),
        (["--settings", "lead"], "did you mean 'leader'?"),
        (["--vehicles", "1"], "--vehicles is 1; allowed: "),
        (["--over", "memory", "--view"], "--view is given with --over memory"),
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
    assert output.err.startswith("iptm run: ")
    assert output.err.count("\n") == 1
    assert message in output.err
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
