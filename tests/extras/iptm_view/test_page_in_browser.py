"""The page in a real browser: what it shows is what the bag holds, and it connects to no other server."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from matplotlib.image import imread
from tests.extras.iptm_view.screenshot import Picture, served_bag, take_screenshot

from iptm_core.trajectory import Trajectory
from iptm_view.page_feed import PageFeed
from iptm_view.page_server import PageServer
from iptm_view.run_facts import RunFacts

pytestmark = pytest.mark.integration
CELSIUS = 273.15


@pytest.fixture(scope="module")
def url(bag: Path) -> Iterator[str]:
    with served_bag(bag) as server:
        yield server.url


@pytest.fixture(
    scope="module",
    params=[
        (width, height, is_dark)
        for width, height in ((1280, 800), (390, 844))
        for is_dark in (False, True)
    ],
    ids=["desktop, light", "desktop, dark", "phone, light", "phone, dark"],
)
def opened(url: str, visitor: Any, request: pytest.FixtureRequest) -> Iterator[Any]:
    width, height, is_dark = request.param
    with visitor(url, Picture(width, height, is_dark=is_dark)) as visit:
        visit.page.wait_for_selector("body[data-ended='true']")
        yield visit


@pytest.fixture(scope="module")
def desktop(url: str, visitor: Any) -> Iterator[Any]:
    with visitor(url, Picture()) as visit:
        visit.page.wait_for_selector("body[data-ended='true']")
        yield visit


@pytest.fixture
def visit(opened: Any) -> Any:
    """The page in every look, at the end of its trip."""
    return at_the_end(opened)


@pytest.fixture
def on_desktop(desktop: Any) -> Any:
    """The page in one look, at the end of its trip."""
    return at_the_end(desktop)


def at_the_end(visit: Any) -> Any:
    visit.page.evaluate("window.iptmPlayer.follow()")
    visit.wait_for_clock("120.0 / 120 s")
    return visit


def expected_at(driven: Trajectory, row: int) -> dict[str, str]:
    """Return what the page shows of a row, by selector."""
    return {
        "#tile-speed": f"{3.6 * driven.speed_m_s[row]:.1f}",
        "#tile-gap": f"{driven.gap_m[row]:.2f}",
        "#tile-battery": f"{1e-3 * driven.battery_power_w[row]:.2f}",
        "#tile-cell_n": f"{driven.cell_n_temperature_k[row] - CELSIUS:.2f}",
        "#value-speed-leader": f"{3.6 * driven.leader_speed_m_s[row]:.1f}",
        "#value-cooling-compressor": f"{1e-3 * driven.compressor_power_w[row]:.3f}",
        "#value-coolant-into-the-pack": f"{driven.coolant_inlet_temperature_k[row] - CELSIUS:.2f}",
    }


def assert_shows(visit: Any, driven: Trajectory, row: int) -> None:
    expected = expected_at(driven, row)
    assert {selector: visit.page.inner_text(selector) for selector in expected} == expected


def test_the_page_shows_the_bag_and_nothing_goes_wrong(visit: Any, driven: Trajectory) -> None:
    page = visit.page
    assert_shows(visit, driven, -1)
    rows = page.evaluate("Object.fromEntries(window.iptmRun.rows.columns)")
    for name in ("time_s", "position_m", "speed_m_s", "traction_power_w", "leader_position_m"):
        assert rows[name] == getattr(driven, name).tolist(), name
    energy_j = np.sum(driven.battery_power_w[1:] * driven.intervals_s)
    distance_m = driven.position_m[-1] - driven.position_m[0]
    assert page.inner_text("#figure-energy") == f"{energy_j / 36.0 / distance_m:.1f}"
    assert page.inner_text("#figure-events") == "0"
    assert page.inner_text("#connection") == "trip ended"
    assert visit.complaints == []
    hosts = {urlsplit(asked).hostname for asked in visit.requests}
    assert hosts == {"127.0.0.1"}


def test_after_the_end_one_can_seek_play_pause_and_play_again(
    on_desktop: Any, driven: Trajectory
) -> None:
    page = on_desktop.page
    page.keyboard.press("Home")
    on_desktop.wait_for_clock("0.0 / 120 s")
    assert_shows(on_desktop, driven, 0)
    page.evaluate("window.iptmPlayer.seek(50)")
    on_desktop.wait_for_clock("50.0 / 120 s")
    assert_shows(on_desktop, driven, 50)
    assert page.evaluate("window.iptmRun.planAt(50).time_s[0]") == 50.0
    page.focus("#position")
    page.keyboard.press("Home")
    on_desktop.wait_for_clock("0.0 / 120 s")
    page.select_option("#speed", "30")
    page.click("#play")
    on_desktop.wait_until("window.iptmPlayer.now > 5")
    page.click("#play")
    page.wait_for_selector("body[data-player='paused']")
    paused_s = page.evaluate("window.iptmPlayer.now")
    assert 5.0 < paused_s < 120.0
    assert_shows(on_desktop, driven, int(paused_s))
    page.evaluate("document.activeElement.blur()")
    page.select_option("#speed", "100")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    on_desktop.wait_for_clock("120.0 / 120 s")
    # From the end, the trip begins again.
    page.keyboard.press("Space")
    on_desktop.wait_until("window.iptmPlayer.now < 100")
    on_desktop.wait_for_clock("120.0 / 120 s")
    assert on_desktop.complaints == []


def test_one_cursor_shows_the_values_of_all_panels(on_desktop: Any, driven: Trajectory) -> None:
    page = on_desktop.page
    page.hover("#panel-speed canvas")
    on_desktop.wait_until("document.getElementById('clock').textContent[0] !== '1'")
    reading_s = float(page.inner_text("#clock").split()[0])
    assert 40.0 < reading_s < 80.0
    assert_shows(on_desktop, driven, int(reading_s))
    page.hover("#title")
    on_desktop.wait_for_clock("120.0 / 120 s")
    page.click("#panel-speed canvas")
    page.hover("#title")
    page.wait_for_selector("body[data-player='paused']")
    assert page.evaluate("window.iptmPlayer.now") == pytest.approx(reading_s, abs=0.5)


def test_every_curve_is_drawn_with_a_description_and_nothing_is_clipped(visit: Any) -> None:
    page = visit.page
    panels = page.query_selector_all("main canvas")
    assert len(panels) == 9
    width = page.viewport_size["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    clipped = page.evaluate(
        """() => [...document.querySelectorAll('h1, h2, p, dt, dd, li, output, button')]
        .filter((node) => node.scrollWidth > node.clientWidth + 1 && node.clientWidth > 0)
        .map((node) => node.innerText)"""
    )
    assert clipped == []
    for canvas in panels:
        label = canvas.get_attribute("aria-label")
        assert re.search(r"\(.+\); at 120.0 s: .*\d", label), label
        ink = canvas.evaluate(
            "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
            ".filter((value, k) => k % 4 === 3 && value > 0).length"
        )
        assert ink > 500, f"nothing is drawn: {label}"
    assert page.inner_text("#decision").startswith("solver: solved after ")


def test_text_can_be_read_against_its_background(visit: Any) -> None:
    """Contrast of text after WCAG 2: at least 4.5 to 1, in light and dark."""
    pairs = visit.page.evaluate(
        """() => [...document.querySelectorAll('h1, h2, p, dt, dd, li, small, .level, select')]
        .filter((node) => node.innerText?.trim())
        .map((node) => {
          const paper = (behind) => getComputedStyle(behind).backgroundColor;
          let behind = node;
          while (paper(behind) === 'rgba(0, 0, 0, 0)') behind = behind.parentElement;
          return [node.innerText, getComputedStyle(node).color, paper(behind)];
        })"""
    )
    assert len(pairs) > 30
    for text, ink, paper in pairs:
        lighter, darker = sorted((luminance(ink), luminance(paper)), reverse=True)
        assert (lighter + 0.05) / (darker + 0.05) >= 4.5, f"{text!r}: {ink} on {paper}"


def luminance(color: str) -> float:
    channels = [int(part) / 255.0 for part in re.findall(r"\d+", color)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_of_several_vehicles_one_is_chosen_on_the_page(visitor: Any) -> None:
    feeds = {"car_1": PageFeed(), "car_2": PageFeed()}
    for number, feed in enumerate(feeds.values(), start=1):
        feed.put("facts", RunFacts(f"vehicle {number}").document())
    server = PageServer(feeds, 0)
    with visitor(server.url, Picture()) as visit:
        page = visit.page
        page.wait_for_selector("#vehicle", state="visible")
        assert page.input_value("#vehicle") == "car_1"
        page.select_option("#vehicle", "car_2")
        page.wait_for_selector("#source:text-is('vehicle 2')")
        assert page.input_value("#vehicle") == "car_2"
    server.close()


def test_a_picture_of_the_middle_of_a_trip(bag: Path, visitor: Any, tmp_path: Path) -> None:  # noqa: ARG001
    for is_dark in (False, True):
        file = tmp_path / f"{is_dark}.png"
        picture = Picture(640, 480, is_dark=is_dark, at_s=30.0)
        # A browser of its own, which Playwright starts in another thread only.
        with ThreadPoolExecutor() as pool:
            pool.submit(take_screenshot, bag, file, picture, "none").result()
        pixels = imread(file)[..., :3]
        assert pixels.shape[:2] == (480, 640)
        # The margin of the page, which nothing is drawn on.
        assert (pixels[:5, :5].mean() < 0.5) == is_dark
