"""A run that is watched ends by itself where there is no terminal."""

from __future__ import annotations

import io
from pathlib import Path
from typing import cast

from rich.console import Console

from iptm.runner import viewer
from iptm.runner.supervisor import Supervisor
from iptm_core.program import StopRequest


class RunningView:
    def is_running(self, name: str) -> bool:
        return name == viewer.VIEW


def test_without_a_terminal_the_view_ends_with_the_run() -> None:
    """A script that drives runs comes to its end, and its output names the way to see them again."""
    console = Console(file=io.StringIO(), width=200)
    bags = [Path("bags/my run")]
    supervisor = cast("Supervisor", RunningView())
    viewer._stay_open(supervisor, StopRequest(), "http://127.0.0.1:8780/", bags, console)
    assert cast("io.StringIO", console.file).getvalue() == (
        "the live view ends with the run (no terminal); to see it again: scripts/iptm view 'bags/my run'\n"
    )
