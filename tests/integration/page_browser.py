"""A browser that follows the live view, and a terminal on which a user starts a program."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from iptm_core.trajectory import Trajectory


class Browser:
    """Follows the events of a page in a thread and keeps their content."""

    def __init__(self, url: str, path: str = "events") -> None:
        self.documents: dict[str, Any] = {}
        self.rows: list[list[float]] = []
        self.plans: list[dict[str, list[float]]] = []
        threading.Thread(target=self._follow, args=(url + path,), daemon=True).start()

    def _follow(self, url: str) -> None:
        kind = ""
        try:
            with urllib.request.urlopen(url, timeout=120.0) as answer:  # noqa: S310
                for line in answer:
                    name, _, text = line.decode().rstrip("\n").partition(": ")
                    if name == "event":
                        kind = text
                    elif name == "data" and kind == "trip":
                        self.rows, self.plans = [], []
                        self.documents.pop("end", None)
                    elif name == "data" and kind in {"rows", "plans"}:
                        getattr(self, kind).extend(json.loads(text))
                    elif name == "data":
                        self.documents[kind] = json.loads(text)
        except OSError:
            pass  # the server has ended

    @property
    def has_ended(self) -> bool:
        return bool(self.documents.get("end", {}).get("ended"))

    def assert_rows_are_those_of(self, driven: Trajectory) -> None:
        names = self.documents["facts"]["columns"]
        by_time = dict(zip(driven.time_s.tolist(), range(len(driven)), strict=True))
        assert self.rows
        for row in self.rows:
            values = dict(zip(names, row, strict=True))
            k = by_time[values["time_s"]]
            for name in ("position_m", "speed_m_s", "leader_speed_m_s", "chiller_heat_w", "gap_m"):
                assert values[name] == getattr(driven, name)[k], (name, values["time_s"])


class Terminal:
    """A program that a user started on a terminal."""

    def __init__(self, launcher: Any, module: str, *arguments: str) -> None:
        self._controller, terminal = pty.openpty()
        self._read: list[bytes] = []
        self.popen = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=terminal, stdout=terminal, stderr=terminal,
            env=launcher.environment, cwd=launcher.directory, start_new_session=True
        )  # fmt: skip
        os.close(terminal)
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        with suppress(OSError):  # the program has ended
            while data := os.read(self._controller, 4096):
                self._read.append(data)

    @property
    def text(self) -> str:
        return re.sub(
            r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", b"".join(self._read).decode(errors="replace")
        )

    def close(self) -> None:
        if self.popen.poll() is None:
            os.killpg(self.popen.pid, signal.SIGKILL)
        self.popen.wait()
        os.close(self._controller)


def followed(runner: Terminal, wait_until: Callable[..., None], *paths: str) -> list[Browser]:
    """Return browsers that follow the view of a run, one for each path."""
    address = re.compile(r"live view: (http://[\w.:]+/)")
    wait_until(lambda: address.search(runner.text), what="address of the page")
    found = address.search(runner.text)
    assert found is not None
    return [Browser(found.group(1), path) for path in paths]
