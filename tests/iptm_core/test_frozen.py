"""Copies of frozen dataclasses with some fields changed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pytest

from iptm_core.errors import StateError
from iptm_core.frozen import replace
from iptm_core.state import ChannelCells, Command, FullChannelState, VehicleState

STATE = VehicleState(0.0, 1.0, 2.0, 0.0, 0.0, 300.0, 301.0, 0.1, 0.1)


def test_a_copy_has_the_changed_fields_and_the_others() -> None:
    assert replace(Command(1.0, 2.0), compressor_power_w=3.0) == Command(1.0, 3.0)
    assert replace(STATE, time_s=5.0).time_s == 5.0
    assert STATE.time_s == 0.0


def test_values_worked_out_from_the_old_fields_are_not_copied() -> None:
    @dataclass(frozen=True)
    class Square:
        side: float

        @cached_property
        def area(self) -> float:
            return self.side**2

    square = Square(2.0)
    assert square.area == 4.0
    assert replace(square, side=3.0).area == 9.0


def test_an_unknown_field_is_refused() -> None:
    with pytest.raises(TypeError, match="Command has no field 'power'"):
        replace(Command(1.0, 2.0), power=1.0)  # type: ignore[call-arg]


def test_what_a_class_checks_when_created_is_checked() -> None:
    state = FullChannelState(**vars(STATE), cells=ChannelCells.between(STATE, 3))
    with pytest.raises(StateError, match="cell_1_temperature_k"):
        replace(state, cell_1_temperature_k=310.0)
