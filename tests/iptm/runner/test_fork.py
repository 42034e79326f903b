"""Companions beside a run: a request is answered even if the process does not run."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from iptm.runner import fork
from iptm.runner.fork import Companion
from iptm_core.errors import DriveError
from iptm_core.program import StopRequest


def test_a_request_of_a_companion_that_does_not_run_is_answered_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Companion(tmp_path / "companion.log") as companion:
        companion.request(os.getpid)
        process = companion.answer(StopRequest())
        assert process != os.getpid()
        os.kill(process, signal.SIGSTOP)
        monkeypatch.setattr(fork, "_LOOK_AFTER_S", 0.2)
        companion.request(os.getpid)
        assert companion.answer(StopRequest()) == os.getpid()


def test_a_companion_that_has_ended_is_an_error_with_its_log(tmp_path: Path) -> None:
    log = tmp_path / "companion.log"
    with Companion(log) as companion:
        companion.request(os.getpid)
        os.kill(companion.answer(StopRequest()), signal.SIGKILL)
        companion.request(os.getpid)
        with pytest.raises(DriveError, match=str(log)):
            companion.answer(StopRequest())


def test_a_stop_ends_the_wait_for_a_companion(tmp_path: Path) -> None:
    stop = StopRequest()
    stop.number = signal.SIGINT
    began_s = time.monotonic()
    with Companion(tmp_path / "companion.log") as companion:
        companion.request(time.sleep, 600.0)
        assert companion.answer(stop) is None
    assert time.monotonic() - began_s < 60.0
