"""Commands as messages and back."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.errors import MessageError
from iptm_core.state import Command
from iptm_ros.codecs import (
    decode_command,
    decode_decision_record,
    encode_command,
    encode_decision_record,
)

RECORD = DecisionRecord(
    status=SolveStatus.ITERATION_LIMIT,
    solve_time_s=0.004,
    iterations=17,
    gap_slack_m=0.5,
    speed_slack_m_s=0.0,
    temperature_slack_k=0.1,
    objective=123.4,
    rung=Rung.SHIFTED_PLAN,
    limiter_active=True,
    preview_age_s=3.0,
)


def test_command_round_trip_keeps_the_stamp() -> None:
    command = Command(-0.75, 1500.0)
    assert decode_command(encode_command(7_000_000_000, command)) == (7_000_000_000, command)


def test_sign_errors_of_a_controller_stay_visible() -> None:
    _, command = decode_command(encode_command(0, Command(-99.0, -5.0)))
    assert command == Command(-99.0, -5.0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_command_must_be_finite(value: float) -> None:
    with pytest.raises(MessageError, match="controller/command: compressor_power_w"):
        decode_command(encode_command(0, Command(0.0, value)))


def test_order_of_names_does_not_matter_and_extra_names_are_ignored() -> None:
    message = encode_command(0, Command(1.0, 2.0))
    message.name = ["note", "compressor_power_w", "acceleration_m_s2"]
    message.position = [math.nan, 2.0, 1.0]
    assert decode_command(message)[1] == Command(1.0, 2.0)


def test_missing_name_is_named() -> None:
    message = encode_command(0, Command(1.0, 2.0))
    message.name = ["acceleration_m_s2", "compressor_power"]
    with pytest.raises(MessageError, match="missing compressor_power_w; got acceleration_m_s2"):
        decode_command(message)


def test_unequal_numbers_of_names_and_values() -> None:
    message = encode_command(0, Command(1.0, 2.0))
    message.position = [1.0]
    with pytest.raises(MessageError, match="2 names but 1 values"):
        decode_command(message)


def test_empty_message_is_refused() -> None:
    message = encode_command(0, Command(1.0, 2.0))
    message.name, message.position = [], []
    with pytest.raises(MessageError, match="got no names"):
        decode_command(message)


def test_record_of_a_decision_round_trip() -> None:
    assert decode_decision_record(encode_decision_record(5, RECORD)) == RECORD


def test_failed_solve_is_a_value() -> None:
    record = replace(
        RECORD, status=SolveStatus.NUMERICAL_ERROR, objective=math.nan, preview_age_s=math.inf
    )
    back = decode_decision_record(encode_decision_record(0, record))
    assert back.status is SolveStatus.NUMERICAL_ERROR
    assert math.isnan(back.objective)
    assert back.preview_age_s == math.inf


@pytest.mark.parametrize(
    ("place", "value", "complaint"),
    [
        (0, math.nan, "status_code is nan"),
        (0, 2.5, "status_code is 2.5"),
        (7, 9.0, "fallback_rung"),
    ],
)
def test_record_with_an_unknown_code_is_refused(place: int, value: float, complaint: str) -> None:
    message = encode_decision_record(0, RECORD)
    message.position[place] = value
    with pytest.raises(MessageError, match=f"controller/solve: {complaint}"):
        decode_decision_record(message)
