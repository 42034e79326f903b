"""Mappings of a file and declared parameters: every refusal names place, value, and what is allowed."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import pytest

from iptm_core.declaration import (
    ParameterSpec,
    Settings,
    checked_value,
    declared,
    parameter,
    parameter_specs,
    plain,
)
from iptm_core.errors import ParameterError, ScenarioError, StoreError
from iptm_core.user_input import StrictMapping, known_keywords, one_of, suggestion

KNOWN = ("title", "speed", "parts", "notes")


def written(**content: Any) -> StrictMapping:
    return StrictMapping(content, "file.yaml", KNOWN)


def test_what_is_as_it_should_be_is_read() -> None:
    content = written(title="t", speed=3, parts=[1], notes={"a": True})
    assert (content.text("title"), content.number("speed")) == ("t", 3.0)
    assert content.entries("parts") == [1]
    assert content.section("notes").scalar("a") is True
    assert list(content) == ["title", "speed", "parts", "notes"]


def test_what_is_left_out() -> None:
    assert written().text("title", "none") == "none"
    assert written().section("notes").content == {}
    assert written().entries("parts", may_be_empty=True) == []
    assert "title" not in written()


@pytest.mark.parametrize(
    ("content", "read", "named"),
    [
        ({"title": 5}, lambda m: m.text("title"), "file.yaml: title is 5; allowed: a text"),
        ({}, lambda m: m.text("title"), "file.yaml: 'title' is missing"),
        ({"speed": True}, lambda m: m.number("speed"), "speed is True; allowed: a number"),
        ({"speed": 10**400}, lambda m: m.number("speed"), "allowed: a number that a float"),
        ({"parts": []}, lambda m: m.entries("parts"), "parts is []; allowed: a list"),
        ({"notes": 3}, lambda m: m.section("notes"), "file.yaml: notes holds 3; allowed: a map"),
        ({"notes": [1]}, lambda m: m.scalar("notes"), "notes is [1]; allowed: a number, a text"),
        ({"title": "c"}, lambda m: m.choice("title", "ab"), "title is 'c'; allowed: a, b"),
        ({}, lambda m: m.choice("title", "ab"), "'title' is missing; allowed: a, b"),
    ],
)
def test_what_is_wrong_is_refused(
    content: dict[str, Any], read: Callable[[StrictMapping], Any], named: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        read(written(**content))
    assert named in str(caught.value)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (None, "file.yaml holds nothing; allowed: a mapping"),
        ([1, 2], "file.yaml holds [1, 2]; allowed: a mapping"),
        ({3: "x"}, "file.yaml: key 3; allowed: a text"),
        ({"titel": "x"}, "file.yaml: unknown key 'titel'; did you mean 'title'?"),
    ],
)
def test_no_mapping_of_known_names(content: Any, named: str) -> None:
    with pytest.raises(StoreError) as caught:
        StrictMapping(content, "file.yaml", KNOWN, error=StoreError)
    assert named in str(caught.value)


def test_errors_keep_class_and_place_in_sections() -> None:
    content = StrictMapping({"notes": {"a": 1}}, "file.yaml", error=StoreError)
    with pytest.raises(StoreError, match=r"file\.yaml: notes: a is 1"):
        content.section("notes").text("a")


def test_very_many_names_are_not_all_listed() -> None:
    many = [f"group.parameter_{number}" for number in range(60)]
    assert suggestion("group.parametr_7", many) == "did you mean 'group.parameter_7'?"
    assert suggestion("zzz", many).count("group") == 12
    assert suggestion("speeed", KNOWN) == f"did you mean 'speed'? allowed: {', '.join(KNOWN)}"


class Colour(str, Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Paint(Settings):
    colour: Colour = parameter(Colour.RED, "what it looks like")
    thickness_m: float = parameter(0.5, "of one coat", "m", 0.0, 60.0)
    coats: int = parameter(3, "how many", "", 0, 10)
    glossy: bool = parameter(default=True, description="whether it shines")
    finish: str = parameter("oil", "what is in it", choices=("oil", "water"))
    label: str = parameter("", "free text")


@dataclass(frozen=True)
class Wall(Paint):
    width_m: float = parameter(4.0, "of the wall", "m", 0.1)
    neighbours: tuple[str, ...] = ()  # no parameter


@dataclass(frozen=True)
class Plan(Settings):
    coat_m: float | None = declared(Paint, "thickness_m", default=None)
    colour: Colour = declared(Paint, "colour", default=Colour.BLUE)
    coats: int = declared(Paint, "coats", maximum=20)


def test_values_arrive_in_their_type() -> None:
    paint = Paint(colour="blue", thickness_m=2, coats=7)  # type: ignore[arg-type]
    assert paint.colour is Colour.BLUE
    assert type(paint.thickness_m) is float
    assert type(replace(paint, thickness_m=np.float64(0.1)).thickness_m) is float
    assert plain(paint.colour) == "blue"


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("thickness_m", -1.0, "a number from 0 to 60 m"),
        ("thickness_m", math.nan, "a number from 0 to 60 m"),
        ("thickness_m", "thick", "a number from 0 to 60 m"),
        ("thickness_m", True, "a number from 0 to 60 m"),
        ("thickness_m", None, "a number from 0 to 60 m"),
        ("coats", 2.0, "a whole number from 0 to 10"),
        ("coats", 11, "a whole number from 0 to 10"),
        ("coats", True, "a whole number from 0 to 10"),
        ("colour", "green", "one of red, blue"),
        ("colour", 1, "one of red, blue"),
        ("finish", "tar", "one of oil, water"),
        ("glossy", 1, "true or false"),
        ("label", 5, "a text"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(name: str, value: Any, allowed: str) -> None:
    for build in (Paint, Wall):
        with pytest.raises(ParameterError) as caught:
            build(**{name: value})
        message = str(caught.value)
        assert message.startswith(f"{name} is {value!r}")
        assert message.endswith(f" allowed: {allowed}")


def test_the_nearest_choice_is_named() -> None:
    with pytest.raises(
        ParameterError, match=r"colour is 'Reed'; did you mean 'red'[?] allowed: one of"
    ):
        Paint(colour="Reed")
    with pytest.raises(ParameterError, match="colour is 'green'; allowed: one of red, blue"):
        Paint(colour="green")


@pytest.mark.parametrize("value", [math.inf, -math.inf, 10**400])
def test_infinity_is_no_number_even_without_a_bound(value: float) -> None:
    with pytest.raises(ParameterError, match="width_m is "):
        Wall(width_m=value)


def test_a_group_brings_its_parameters_along() -> None:
    names = [spec.name for spec in parameter_specs(Wall)]
    assert names == [spec.name for spec in parameter_specs(Paint)] + ["width_m"]


def test_a_declaration_may_be_reused_with_another_default() -> None:
    assert Plan() == Plan(coat_m=None, colour=Colour.BLUE, coats=3)
    assert Plan(coat_m=1, coats=20).coat_m == 1.0
    for wrong in ({"coat_m": 61.0}, {"colour": "green"}, {"coats": None}, {"coats": 21}):
        with pytest.raises(ParameterError):
            Plan(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("minimum", "maximum", "allowed"),
    [
        (1.0, math.inf, "a number, at least 1 m"),
        (-math.inf, 2.0, "a number, at most 2 m"),
        (-math.inf, math.inf, "a number"),
    ],
)
def test_open_ranges_in_words(minimum: float, maximum: float, allowed: str) -> None:
    spec = ParameterSpec("x_m", 1.5, "x", "m", minimum, maximum)
    assert spec.allowed == allowed
    assert checked_value(spec, 1) == 1.0


def test_an_unknown_keyword_is_refused_with_the_nearest_one() -> None:
    @known_keywords
    def life(run: int, *, climate: str = "Rome") -> str:
        return f"{run} {climate}"

    @known_keywords
    @dataclass(frozen=True)
    class Usage:
        target: float

    assert life(1, climate="Oslo") == "1 Oslo"
    assert isinstance(Usage(target=0.8), Usage)
    with pytest.raises(
        ScenarioError, match=r"life: unknown argument 'climat'; did you mean 'climate'"
    ):
        life(1, climat="Oslo")
    with pytest.raises(
        ScenarioError, match=r"Usage: unknown argument 'targt'; did you mean 'target'"
    ):
        Usage(targt=0.8)  # type: ignore[call-arg]


def test_an_unknown_choice_of_a_command_line_is_refused_with_the_nearest_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    parser = argparse.ArgumentParser("run")
    parser.add_argument("--without", type=one_of(("plant", "v2x_bridge")))
    assert parser.parse_args(["--without", "plant"]).without == "plant"
    with pytest.raises(SystemExit):
        parser.parse_args(["--without", "bridge"])
    assert "did you mean 'v2x_bridge'?" in capsys.readouterr().err
