"""The example bag, and a real browser to open pages in."""

from __future__ import annotations

import importlib.util
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_view.screenshot import BROWSERS, Picture, opened_page, started_browser

from iptm_core.trajectory import Trajectory
from iptm_ros.recording.trajectory_reader import read_trajectory

BAG = Path(__file__).resolve().parents[3] / "bags" / "example_us06_120s"


@pytest.fixture(scope="session")
def bag() -> Path:
    return BAG


@pytest.fixture(scope="session")
def driven() -> Trajectory:
    """What the example bag holds, by the project's own reader."""
    return read_trajectory(BAG)


@dataclass
class Visit:
    """An opened page, what it asked for, and what it complained about."""

    page: Any
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def wait_until(self, expression: str) -> None:
        """Wait until an expression holds; the page itself may not evaluate one (Content-Security-Policy)."""
        deadline_s = time.monotonic() + 120.0
        while not self.page.evaluate(expression):
            assert time.monotonic() < deadline_s, expression
            self.page.wait_for_timeout(20)

    def wait_for_clock(self, text: str) -> None:
        """Wait until the page shows an instant."""
        self.page.wait_for_selector(f"#clock:text-is('{text}')")


Visitor = Callable[[str, Picture], AbstractContextManager[Visit]]


@pytest.fixture(scope="session")
def visitor() -> Iterator[Visitor]:
    """What opens pages in one Chromium for all tests."""
    if not any(map(shutil.which, BROWSERS)):
        pytest.skip(f"no Chromium is installed ({', '.join(BROWSERS)})")
    if importlib.util.find_spec("playwright") is None:
        pytest.skip("playwright is not installed (requirements/view.txt)")
    with started_browser() as browser:

        @contextmanager
        def visited(url: str, picture: Picture) -> Iterator[Visit]:
            with opened_page(browser, picture) as page:
                found = Visit(page)
                page.on("request", lambda asked: found.requests.append(asked.url))
                page.on("pageerror", lambda error: found.complaints.append(str(error)))
                page.on(
                    "console",
                    lambda message: (
                        found.complaints.append(message.text) if message.type != "log" else None
                    ),
                )
                page.goto(url)
                yield found

        yield visited
