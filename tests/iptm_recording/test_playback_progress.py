from __future__ import annotations

from io import StringIO

from rich.console import Console

from iptm_recording.playback_progress import LINE_PERIOD_S, PlaybackProgress


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
