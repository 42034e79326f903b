"""The line about a drive that goes on."""

from __future__ import annotations

import io
import sys

import pytest

import iptm
from iptm import driving
from iptm.driving import ProgressLine


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_time_left_is_that_of_the_steps_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, terminal = 100.0, Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(driving.time, "monotonic", lambda: now_s)
    with ProgressLine("a trip", 100) as line:
        for _ in range(51):
            line.step()
            now_s += 0.2
    texts = terminal.getvalue().split("\r")
    assert "compiled once" in terminal.getvalue()
    assert any(text.startswith("a trip: 50 %, 10 s left") for text in texts)
    assert texts[-1] == "", "the line is cleared"


def test_nothing_is_shown_where_nobody_looks(capsys: pytest.CaptureFixture[str]) -> None:
    iptm.simulate("us06", horizon="3x1", duration_s=5.0)
    assert capsys.readouterr().err == ""


def test_a_trip_longer_than_its_drive_has_a_note() -> None:
    assert iptm.Trip.of("us06", duration_s=900.0).notes == (
        "the drive ends at 600 s: then the leader stands",
    )
    assert not iptm.Trip.of("us06", duration_s=600.0).notes
