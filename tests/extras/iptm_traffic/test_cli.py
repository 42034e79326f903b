"""What a user of the command sees; SUMO is not needed."""

from __future__ import annotations

import sys
from itertools import pairwise

import pytest

from iptm_core.program import EXIT_USER_ERROR
from iptm_traffic import cli
from iptm_traffic.moved_car import EgoInstant
from iptm_traffic.world import line_passed
from iptm_v2x_bridge.prediction.road_rules import RoadRules, Signal


def test_without_sumo_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "sumo", None)
    assert cli.main(["--duration-s", "5"]) == EXIT_USER_ERROR
    output = capsys.readouterr().err
    assert "requirements/traffic.txt" in output
    assert output.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "value", "word"),
    [
        ("--step-s", "0.3", "step_s"),
        ("--duration-s", "0", "duration_s"),
        ("--main-headway-s", "1", "main_headway_s"),
        ("--duration-s", "1e9", "duration_s"),
    ],
)
def test_wrong_options_are_refused_in_one_line(
    option: str, value: str, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([option, value]) == EXIT_USER_ERROR
    output = capsys.readouterr().err
    assert word in output
    assert value in output or "1e+09" in output
    assert "allowed" in output


def test_lines_are_counted_with_the_instant_they_were_passed_at() -> None:
    # Green from 0 s to 10.5 s; at 10 m/s the line at 105 m is reached at 10.5 s.
    for line_m, is_open in ((104.0, True), (106.0, False)):
        rules = RoadRules(signals=(Signal.cyclic(line_m, 60.0, 0.0, 10.5),))
        instants = [EgoInstant(time_s, 10.0 * time_s, 10.0) for time_s in (9.0, 10.0, 11.0, 12.0)]
        passed = [line_passed(rules, *interval) for interval in pairwise(instants)]
        assert passed == [None, (pytest.approx(line_m / 10.0), is_open), None]
