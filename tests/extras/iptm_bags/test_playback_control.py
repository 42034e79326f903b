"""The clock of a playback: exact with an artificial time, and synchronised across threads."""

from __future__ import annotations

import threading
from io import StringIO

import pytest
from rich.console import Console

from iptm_bags.playback_control import (
    LINE_PERIOD_S,
    PlaybackControl,
    PlaybackProgress,
    WaitOutcome,
)


def test_lines_where_there_is_no_terminal() -> None:
    now_s = 100.0
    file = StringIO()
    progress = PlaybackProgress(Console(file=file), 10.0, 30.0, steady_s=lambda: now_s)
    progress.show(11.0, 1.0, is_paused=False)
    assert file.getvalue() == ""
    now_s += LINE_PERIOD_S
    progress.show(12.0, 1.0, is_paused=True)
    assert file.getvalue() == ""
    progress.show(12.0, 1.0, is_paused=False)
    progress.show(12.5, 1.0, is_paused=False)
    now_s += LINE_PERIOD_S
    progress.show(99.0, 1.0, is_paused=False)  # the clock may be ahead of the last message
    progress.close()
    assert file.getvalue().splitlines() == ["at 12.0 of 30.0 s", "at 30.0 of 30.0 s"]


def test_a_bar_on_a_terminal_that_leaves_nothing_behind() -> None:
    file = StringIO()
    console = Console(file=file, force_terminal=True, width=120)
    progress = PlaybackProgress(console, 0.0, 30.0)
    progress.show(15.0, 2.5, is_paused=False)
    assert "15.0 of 30.0 s" in file.getvalue()
    assert "2.5 x recorded speed" in file.getvalue()
    progress.show(15.0, 2.5, is_paused=True)
    assert "paused" in file.getvalue()
    progress.close()
    progress.close()
    assert file.getvalue().endswith(("\x1b[2K", "\x1b[?25h"))


S = 10**9


class Steady:
    """Steady time advanced by the test."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def steady() -> Steady:
    return Steady()


def test_recorded_time_follows_rate_pause_and_position(steady: Steady) -> None:
    control = PlaybackControl(100 * S, 2.0, steady_s=steady)
    steady.now_s += 3.0
    assert control.position_ns == 106 * S
    control.set_rate(0.5)
    steady.now_s += 4.0
    assert control.position_ns == 108 * S
    control.pause(is_paused=True)
    steady.now_s += 1000.0
    assert control.position_ns == 108 * S
    control.pause(is_paused=False)
    steady.now_s += 2.0
    assert control.position_ns == 109 * S
    control.begin(7 * S)
    assert control.position_ns == 7 * S


def test_what_is_due_is_not_waited_for(steady: Steady) -> None:
    control = PlaybackControl(100 * S, 1.0, steady_s=steady)
    steady.now_s += 2.0
    assert control.wait(102 * S) is WaitOutcome.DUE
    assert control.wait(103 * S, longest_s=0.0) is WaitOutcome.EARLY


def test_steps_of_a_paused_playback(steady: Steady) -> None:
    control = PlaybackControl(100 * S, 1.0, is_paused=True, steady_s=steady)
    assert control.wait(100 * S, longest_s=0.0) is WaitOutcome.EARLY
    assert control.step()
    assert control.step()
    assert control.wait(105 * S) is WaitOutcome.DUE
    assert control.position_ns == 105 * S
    assert control.wait(105 * S) is WaitOutcome.DUE
    assert control.wait(106 * S, longest_s=0.0) is WaitOutcome.EARLY
    control.pause(is_paused=False)
    assert not control.step()
    steady.now_s += 1.0
    assert control.wait(106 * S) is WaitOutcome.DUE


def test_a_position_is_asked_for_once(steady: Steady) -> None:
    control = PlaybackControl(0, 1.0, is_paused=True, steady_s=steady)
    control.seek(5 * S)
    assert control.wait(S) is WaitOutcome.SOUGHT
    assert control.take_sought() == 5 * S
    assert control.take_sought() is None
    assert control.wait(S, longest_s=0.0) is WaitOutcome.EARLY


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        (PlaybackControl.stop, WaitOutcome.STOPPED),
        (lambda control: control.seek(0), WaitOutcome.SOUGHT),
        (PlaybackControl.step, WaitOutcome.DUE),
        (lambda control: control.pause(is_paused=False), WaitOutcome.DUE),
    ],
    ids=["stop", "seek", "step", "resume"],
)
def test_whoever_waits_is_woken(change: object, verdict: WaitOutcome) -> None:
    """The message is due a millisecond after the time at which the playback is paused."""
    control = PlaybackControl(0, 1.0, is_paused=True)
    found: list[WaitOutcome] = []
    thread = threading.Thread(target=lambda: found.append(control.wait(S // 1000)), daemon=True)
    thread.start()
    change(control)  # type: ignore[operator]
    thread.join(30.0)
    assert found == [verdict]


def test_the_longest_wait_does_not_overflow() -> None:
    control = PlaybackControl(0, 1e-6)
    assert control.wait(10**18, longest_s=0.001) is WaitOutcome.EARLY
