"""The page in a Chromium without a window: for tests, and for the pictures in ``docs/images``.

python -m tests.extras.iptm_view.screenshot    # of the run in bags/docs
"""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iptm_core.errors import ViewError
from iptm_view.judged_feed import JudgedFeed
from iptm_view.page_server import PageServer
from iptm_view.reference_car import NO_REFERENCE, ReferenceCar
from iptm_view.sources import BagSource
from iptm_view.view import REFERENCE_COMMAND

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
_REFERENCE_TIMEOUT_MS = 600_000
_PAGE_TIMEOUT_MS = 60_000
_PHONE_WIDTH = 600


@dataclass(frozen=True)
class Picture:
    """What a picture of the page shall look like.

    Attributes:
        width: of the window, pixels.
        height: of the window, pixels.
        is_dark: whether the browser prefers dark colours.
        at_s: trip time of the cursor, None for the end.
    """

    width: int = 1280
    height: int = 800
    is_dark: bool = False
    at_s: float | None = None


DOCUMENTED = {
    "live_view.png": Picture(),
    "live_view_tablet.png": Picture(820, 1180),
    "live_view_phone.png": Picture(390, 844, is_dark=True),
}
"""Pictures of the documentation by file name."""


def find_browser() -> str:
    """Return the path of an installed Chromium."""
    for name in BROWSERS:
        path = shutil.which(name)
        if path is not None:
            return path
    raise ViewError(
        f"no browser is installed that can be driven; allowed: one of {', '.join(BROWSERS)}"
        " (Debian: apt install chromium)"
    )


@contextmanager
def started_browser() -> Iterator[Any]:
    """Start a Chromium without a window; yield Playwright's browser."""
    try:
        playwright = importlib.import_module("playwright.sync_api")
    except ImportError:
        raise ViewError(
            "playwright is not installed, which drives the browser; to have it: .venv/bin/python"
            " -m pip install --require-hashes -r requirements/view.txt"
        ) from None
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=find_browser(), args=list(_FLAGS))
        with closing(browser):
            yield browser


@contextmanager
def opened_page(browser: Any, picture: Picture) -> Iterator[Any]:
    """Open an empty page; yield Playwright's page."""
    context = browser.new_context(
        viewport={"width": picture.width, "height": picture.height},
        color_scheme="dark" if picture.is_dark else "light",
        device_scale_factor=2 if picture.width < _PHONE_WIDTH else 1,
    )
    with closing(context):
        page = context.new_page()
        page.set_default_timeout(_PAGE_TIMEOUT_MS)
        yield page


@contextmanager
def served_bag(
    bag: Path, reference_command: Sequence[str] = (), strategy: str = NO_REFERENCE
) -> Iterator[PageServer]:
    """Serve the page of a whole bag."""
    feed = JudgedFeed()
    with (
        closing(ReferenceCar(feed, reference_command, strategy)) as reference,
        closing(PageServer({"": feed}, 0)) as server,
    ):
        with BagSource(bag) as source:
            feed.parameters = source.facts.parameters
            source.load(feed, reference.start(source.facts))
        yield server


def take_screenshot(bag: Path, file: Path, picture: Picture, strategy: str) -> None:
    """Write a picture of the page of a bag, with the reference car of a strategy."""
    with (
        served_bag(bag, REFERENCE_COMMAND, strategy) as server,
        started_browser() as browser,
        opened_page(browser, picture) as page,
    ):
        page.goto(server.url)
        page.wait_for_selector(
            "body[data-ended='true']:not([data-reference='computing'])",
            timeout=_REFERENCE_TIMEOUT_MS,
        )
        if picture.at_s is not None:
            page.evaluate("(time) => window.iptmPlayer.seek(time)", picture.at_s)
            page.wait_for_selector("body[data-player='paused']")
        page.screenshot(path=str(file))


if __name__ == "__main__":
    root = Path(__file__).resolve().parents[3]
    for name, look in DOCUMENTED.items():
        take_screenshot(root / "bags" / "docs", root / "docs" / "images" / name, look, "reference")
