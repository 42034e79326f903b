"""The file and the command: what it reads, what it refuses, and what it writes."""

from __future__ import annotations

import json
import random
from copy import deepcopy
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.packaging.packages import ROOT

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_plan.cli import main
from iptm_plan.week_file import changed_departure, instant_of, read_week, week_from, week_of

EXAMPLE = ROOT / "docs" / "examples" / "my_week.yaml"
CONTENT = parse_yaml(EXAMPLE.read_text(encoding="utf-8"), "example")


def changed(**changes: Any) -> dict[str, Any]:
    return {**deepcopy(CONTENT), **changes}


def departure(**changes: Any) -> dict[str, Any]:
    first = {"at": "2026-07-15 07:00", "kwh": 4.2, "minutes": 31}
    return {"departures": [{**first, **changes}]}


def test_the_example_as_it_is_written() -> None:
    week = read_week(EXAMPLE)
    schedule = week.schedule
    assert schedule.steps == 192
    assert [each.step for each in schedule.departures] == [52, 92, 148, 188]
    assert schedule.departures[0].early == ((8, 0.1),)
    assert [schedule.place_w(stage) for stage in range(5)] == [7400.0, 0.0, 7400.0, 0.0, 7400.0]
    assert schedule.eur_kwh[[0, 11, 12, 23, 24, 47, 48]].tolist() == [
        *(0.34, 0.34, 0.20, 0.20, 0.14, 0.14, 0.20)
    ]
    assert schedule.air_k.max() == pytest.approx(273.15 + 35.6 + 6.0, abs=0.01)
    assert f"{week.local(0):%H:%M %Z}" == "18:00 MST"


def test_a_week_is_json_too(tmp_path: Path) -> None:
    file = tmp_path / "week.json"
    file.write_text(json.dumps(CONTENT), encoding="utf-8")
    week = read_week(file)
    assert np.array_equal(week.schedule.eur_kwh, read_week(EXAMPLE).schedule.eur_kwh)


def test_summer_time_moves_the_clock_and_not_the_hours() -> None:
    """In the night to 29 March 2026 an hour is missing in Rome, in October one comes twice."""
    tariff = {"00:00": 0.3, "02:00": 0.1, "04:00": 0.3}
    cheap = {}
    for day in ("2026-03-28", "2026-10-24", "2026-06-01"):
        content = changed(
            time_zone="Europe/Rome", begin=f"{day} 20:00", departures=[], tariff=tariff, hours=12
        )
        cheap[day] = int(np.sum(week_of(content, "week").schedule.eur_kwh == 0.1))
    assert list(cheap.values()) == [4, 12, 8]


def test_local_times_that_do_not_exist_or_exist_twice() -> None:
    zone = week_of(changed(time_zone="Europe/Rome"), "week").zone
    with pytest.raises(ScenarioError, match="summer time leaves out"):
        instant_of("2026-03-29 02:30", zone, "at")
    first = instant_of("2026-10-25 02:30", zone, "at")
    second = instant_of("2026-10-25T02:30+01:00", zone, "at")
    assert (second - first).total_seconds() == 3600.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cell": "ncaa"}, "unknown cell 'ncaa'; did you mean 'nca'"),
        ({"charge": float("nan")}, "charge is nan; allowed: 0 to 1"),
        ({"charger_kw": -1}, "charger_kw is -1"),
        ({"time_zone": "Europe/Atlantis"}, "time_zone is 'Europe/Atlantis'"),
        ({"begin": "tomorrow"}, "begin is 'tomorrow'"),
        ({"hours": 1000}, "hours is 1000; allowed: 1 to 168"),
        ({"tariff": {"25:00": 0.2}}, "25:00 is 0.2"),
        ({"tariff": {}}, "at least one price"),
        ({"tariff": float("inf")}, "tariff is inf"),
        ({"tariff": [{"at": "2026-07-15 00:00", "eur_kwh": 0.2}]}, "does not begin with the plan"),
        ({"weather": "Atlantis"}, "unknown climate"),
        (
            {
                "weather": [
                    {"at": f"2026-07-{14 + hour // 24} {hour % 24:02}:00", "air_c": 30.0}
                    for hour in (18, 20, 22, 30, 32)
                ]
            },
            "no row from 2026-07-14 22:00 to 2026-07-15 06:00",
        ),
        (departure(at="2026-07-14 17:00"), "departure 1: at is .*not before 2026-07-14 18:00"),
        (departure(kwh=200.0), "kWh of a trip is 200"),
        (departure(kwh=float("nan")), "kWh of a trip is nan"),
        (departure(minutes=0), "minutes of a trip is 0"),
        (departure(charge=1.1), "charge is 1.1"),
        (departure(early=[{"hours": 2, "probability": 1}]), "probability is 1; allowed: 0 to 0.99"),
        (departure(arrives=1), "unknown key 'arrives'"),
        ({"departures": [CONTENT["departures"][0]] * 2}, "departure 2 .*do not overlap"),
        ({"car": {"parameter_set": "batmobile"}}, "batmobile"),
        ({"car": {"fan": 3}}, "fan is 3"),
    ],
)
def test_refusals_name_value_and_what_is_allowed(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(IptmError, match=message) as refused:
        week_of(changed(**changes), "week")
    assert "\n" not in str(refused.value)


def test_negative_tariffs_no_plug_and_rows_are_allowed() -> None:
    rows = [
        {"at": f"2026-07-{14 + hour // 24} {hour % 24:02}:00", "air_c": 30.0, "sun_w_m2": 800}
        for hour in range(18, 67, 3)
    ]
    prices = [{"at": "2026-07-14 00:00", "eur_kwh": -0.1}, {"at": "2026-07-15", "eur_kwh": 0.2}]
    week = week_of(changed(weather=rows, tariff=prices, charger_kw=0), "week")
    assert week.schedule.air_k == pytest.approx(273.15 + 38.0)
    assert week.schedule.eur_kwh[[0, 23, 24]].tolist() == [-0.1, -0.1, 0.2]


def test_a_departure_is_moved() -> None:
    week = read_week(EXAMPLE)
    moved = changed_departure(week, 1, instant_of("2026-07-15 06:00", week.zone, "at"))
    assert moved.schedule.departures[0].step == 48
    with pytest.raises(ScenarioError, match="departure is 5; allowed: 1 to 4"):
        changed_departure(week, 5, week.begin)
    with pytest.raises(ScenarioError, match="overlap"):
        changed_departure(week, 2, instant_of("2026-07-15 07:10", week.zone, "at"))


def test_what_is_left_of_a_week() -> None:
    week = read_week(EXAMPLE)
    assert week_from(week, week.begin - timedelta(days=1)) is week
    assert week_from(week, week.begin + timedelta(days=9)) is week
    later = week_from(week, week.begin + timedelta(hours=7, minutes=5))
    assert later.begin == week.begin + timedelta(hours=7)
    assert [each.step for each in later.schedule.departures] == [24, 64, 120, 160]
    assert later.schedule.departures[0].early == ((8, 0.1),)
    away = week_from(week, week.begin + timedelta(hours=13, minutes=20))
    assert away.begin == week.begin + timedelta(hours=13, minutes=45)
    assert (len(away.schedule.departures), away.schedule.charger_w) == (3, 0.0)
    assert away.schedule.eur_kwh[0] == week.schedule.eur_kwh[55]


def test_what_the_command_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    assert main([str(EXAMPLE), "--json", str(plan), "--picture", str(picture)]) == 0
    assert "managed" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = json.loads(plan.read_text(encoding="utf-8"))
    schedule = found["chargingProfile"]["chargingSchedule"][0]
    periods = schedule["chargingSchedulePeriod"]
    starts = [each["startPeriod"] for each in periods]
    assert schedule["duration"] == 172800
    assert schedule["startSchedule"] == "2026-07-15T01:00:00Z"
    assert starts == sorted(set(starts))
    assert starts[0] == 0
    assert max(each["limit"] for each in periods) <= 7400.0
    kwh = sum(
        each["limit"] * (end - each["startPeriod"]) / 3.6e6
        for each, end in zip(periods, [*starts[1:], 172800], strict=True)
    )
    gained = found["charge"][-1] - found["charge"][0] + 4 * 4.2 / 72.474
    assert kwh > gained * 72.474
    assert [each["event"] for each in found["events"]] == ["departure", "arrival"] * 4
    for stay in found["charges"]:
        assert stay["start"] < stay["end"]


def test_a_charge_out_of_reach_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "week.yaml"
    asked = departure(at="2026-07-14 20:00", charge=0.9)
    file.write_text(yaml.safe_dump(changed(**asked)), encoding="utf-8")
    assert main([str(file)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "departure 1, Tue 20:00: charge is 47." in line
    assert "charged since Tue 18:00; asked for: 90.0 %" in line


def test_damaged_files_are_refused_in_one_line(tmp_path: Path) -> None:
    """200 files with a few bytes changed: a week or a refusal of one line, no other error."""
    chance, text = random.Random(54), EXAMPLE.read_bytes()  # noqa: S311
    file, refusals, count = tmp_path / "week.yaml", 0, 0
    for _ in range(200):
        damaged = bytearray(text)
        for _ in range(chance.randint(1, 4)):
            place = chance.randrange(len(damaged))
            if chance.random() < 0.5:
                damaged[place] = chance.randrange(256)
            else:
                del damaged[place : place + chance.randint(1, 30)]
        file.write_bytes(bytes(damaged))
        try:
            read_week(file)
        except IptmError as error:
            refusals += len(str(error).splitlines())
        else:
            continue
        count += 1
    assert refusals == count > 50
