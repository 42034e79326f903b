"""Declared parameters: every instance holds only permitted values, wherever it is declared or reused."""

from __future__ import annotations

import math
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
from iptm_core.errors import ParameterError


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
