"""The page in a real browser: what it shows is what the bag holds, and it talks to nobody else."""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from matplotlib.image import imread

from iptm_core.errors import ViewError
from iptm_core.trajectory import Trajectory
from iptm_view.page_feed import PageFeed
from iptm_view.page_server import PageServer
from iptm_view.run_facts import RunFacts
from iptm_view.screenshot import BROWSERS, Picture, opened_page, served_bag, take_screenshot

HAS_BROWSER = any(map(shutil.which, BROWSERS))
HAS_DRIVER = importlib.util.find_spec("playwright") is not None
pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(not HAS_BROWSER, reason=f"no Chromium is installed ({', '.join(BROWSERS)})"),
    pytest.mark.skipif(
        not HAS_DRIVER, reason="playwright is not installed (requirements/view.txt)"
    ),
]
CELSIUS = 273.15


@dataclass
class Visit:
    """An opened page, what it asked for, and what it complained about."""

    page: Any
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def url(bag: Path) -> Iterator[str]:
    with served_bag(bag, "none") as server:
        yield server.url


@pytest.fixture(
    params=[
        (width, height, is_dark)
        for width, height in ((1280, 800), (390, 844))
        for is_dark in (False, True)
    ],
    ids=["desktop, light", "desktop, dark", "phone, light", "phone, dark"],
)
def visit(url: str, request: pytest.FixtureRequest) -> Iterator[Visit]:
    width, height, is_dark = request.param
    with opened_page("about:blank", Picture(width, height, is_dark=is_dark)) as page:
        found = Visit(page)
        page.on("request", lambda asked: found.requests.append(asked.url))
        page.on("pageerror", lambda error: found.complaints.append(str(error)))
        page.on(
            "console",
            lambda said: found.complaints.append(said.text) if said.type != "log" else None,
        )
        page.goto(url)
        page.wait_for_selector("body[data-ended='true']")
        yield found


def test_the_page_shows_the_bag_and_nothing_goes_wrong(visit: Visit, driven: Trajectory) -> None:
    page, last = visit.page, -1
    expected = {
        "#tile-time": f"{driven.time_s[last]:.1f}",
        "#tile-speed": f"{3.6 * driven.speed_m_s[last]:.1f}",
        "#tile-gap": f"{driven.gap_m[last]:.2f}",
        "#tile-battery": f"{1e-3 * driven.battery_power_w[last]:.2f}",
        "#tile-cell_n": f"{driven.cell_n_temperature_k[last] - CELSIUS:.2f}",
        "#value-speed-leader": f"{3.6 * driven.leader_speed_m_s[last]:.1f}",
        "#value-cooling-compressor": f"{1e-3 * driven.compressor_power_w[last]:.3f}",
        "#value-temperature-coolant-in": (
            f"{driven.coolant_inlet_temperature_k[last] - CELSIUS:.2f}"
        ),
    }
    assert {selector: page.inner_text(selector) for selector in expected} == expected
    rows = page.evaluate("Object.fromEntries(window.iptmRun.columns)")
    for name in ("time_s", "position_m", "speed_m_s", "traction_power_w", "leader_position_m"):
        assert rows[name] == getattr(driven, name).tolist(), name
    assert page.inner_text("#connection") == "trip ended"
    assert visit.complaints == []
    hosts = {urlsplit(asked).hostname for asked in visit.requests}
    assert hosts == {"127.0.0.1"}


def test_every_curve_is_drawn_and_says_what_it_shows(visit: Visit) -> None:
    page = visit.page
    panels = page.query_selector_all("canvas")
    assert len(panels) == 8
    width = page.viewport_size["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for canvas in panels:
        label = canvas.get_attribute("aria-label")
        assert re.search(r"\(.+\); now: .*\d", label), label
        ink = canvas.evaluate(
            "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
            ".filter((value, k) => k % 4 === 3 && value > 0).length"
        )
        assert ink > 500, f"nothing is drawn: {label}"
    assert page.inner_text("#decision").startswith("solver: solved after ")


def test_text_can_be_read_against_its_background(visit: Visit) -> None:
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
    assert len(pairs) > 40
    for text, ink, paper in pairs:
        lighter, darker = sorted((luminance(ink), luminance(paper)), reverse=True)
        assert (lighter + 0.05) / (darker + 0.05) >= 4.5, f"{text!r}: {ink} on {paper}"


def luminance(color: str) -> float:
    channels = [int(part) / 255.0 for part in re.findall(r"\d+", color)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_of_several_vehicles_one_is_chosen_on_the_page() -> None:
    feeds = {"car_1": PageFeed(), "car_2": PageFeed()}
    for number, feed in enumerate(feeds.values(), start=1):
        feed.put("facts", RunFacts(f"vehicle {number}").document())
    server = PageServer(feeds, 0)
    with opened_page(server.url, Picture()) as page:
        page.wait_for_selector("#vehicle", state="visible")
        assert page.input_value("#vehicle") == "car_1"
        page.select_option("#vehicle", "car_2")
        page.wait_for_selector("#source:text-is('vehicle 2')")
        assert page.input_value("#vehicle") == "car_2"
    server.close()


@pytest.mark.parametrize("is_dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [(640, 480), (1280, 800)], ids=["small", "large"])
def test_a_picture_of_the_middle_of_a_trip(
    bag: Path, tmp_path: Path, size: tuple[int, int], is_dark: bool
) -> None:
    file = tmp_path / "view.png"
    take_screenshot(bag, file, Picture(*size, is_dark=is_dark, at_s=30.0), "none")
    pixels = imread(file)[..., :3]
    assert pixels.shape[:2] == size[::-1]
    # The margin of the page, which nothing is drawn on.
    assert (pixels[:5, :5].mean() < 0.5) == is_dark


@pytest.mark.parametrize("size", ["1280", "1x1", "axb", "99999x800"])
def test_a_size_that_is_none_is_refused(size: str) -> None:
    with pytest.raises(ViewError, match=f"'{size}'.*allowed"):
        Picture.of_text(size, is_dark=False, at_s=None)
