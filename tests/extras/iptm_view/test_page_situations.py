"""The page in situations that no good trip has: no run, broken limits, a reference car under way, the end."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from tests.extras.iptm_view.screenshot import Picture

from iptm_core.decision_record import Rung
from iptm_core.parameters import load_parameters
from iptm_view.page_feed import PageFeed
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.page_server import PageServer
from iptm_view.reference_car import STATE
from iptm_view.run_facts import RunFacts

pytestmark = pytest.mark.integration
FACTS = RunFacts("test", load_parameters().values, {"plant": {"duration_s": 100.0}})


@pytest.fixture
def feed() -> PageFeed:
    feed = PageFeed()
    feed.put("facts", FACTS.document())
    return feed


@pytest.fixture
def server(feed: PageFeed) -> Iterator[PageServer]:
    server = PageServer({"": feed}, 0)
    yield server
    server.close()


@pytest.fixture
def visit(server: PageServer, visitor: Any) -> Iterator[Any]:
    with visitor(server.url, Picture()) as visit:
        yield visit
        assert visit.complaints == []


def drive(feed: PageFeed, times_s: range, **values: Any) -> None:
    """Append rows of a steady trip at 20 m/s, 30 m behind the leader."""
    for time_s in times_s:
        row = {
            "time_s": float(time_s),
            "position_m": 20.0 * time_s,
            "speed_m_s": 20.0,
            "gap_m": 30.0,
            "min_gap_m": 15.0,
            "battery_power_w": 7200.0,
            "cell_n_temperature_c": 35.0,
            "capacity_loss": FACTS.document()["initial_capacity_loss"] + 5e-9 * time_s,
            "fallback_rung": 0.0,
            **values,
        }
        feed.append("rows", [row.get(name, math.nan) for name in PAGE_COLUMNS])


def test_an_empty_page_names_its_domain_and_the_cure(visit: Any, feed: PageFeed) -> None:
    page = visit.page
    waiting = "Listening in ROS domain 7, start the view with ROS_DOMAIN_ID=NUMBER"
    feed.put("facts", {**FACTS.document(), "waiting": waiting})
    page.wait_for_selector(f"#waiting-text:text-is('{waiting}')")
    assert page.inner_text("#connection") == "waiting for a run"
    for hidden in ("#panels", "#headline", "#transport", "#tiles"):
        assert not page.is_visible(hidden), hidden
    drive(feed, range(3))
    page.wait_for_selector("#headline", state="visible")
    assert not page.is_visible("#waiting")


def test_panels_without_data_are_not_drawn(visit: Any, feed: PageFeed) -> None:
    drive(feed, range(10))
    visit.page.wait_for_selector("body[data-rows='10']")
    shown = {panel.get_attribute("id") for panel in visit.page.query_selector_all("main .panel")
             if panel.is_visible()}  # fmt: skip
    assert shown == {
        "panel-aging",
        "panel-speed",
        "panel-gap",
        "panel-temperature",
        "panel-driving",
    }
    for missing in ("#tile-compressor", "#value-speed-leader", "#value-temperature-cell-1"):
        assert not visit.page.is_visible(missing), missing
    assert visit.page.inner_text("#figure-cooling") == "–"


def test_broken_limits_and_interventions_have_a_colour_and_a_word(
    visit: Any, feed: PageFeed
) -> None:
    page = visit.page
    drive(feed, range(10))
    drive(feed, range(10, 13), gap_m=14.0)
    drive(feed, range(13, 15), fallback_rung=float(Rung.EMERGENCY_BRAKING))
    # Within the tolerance of the result table.
    drive(feed, range(15, 18), gap_m=14.995)
    drive(feed, range(18, 20), service_braking_s=0.3)
    page.wait_for_selector("body[data-rows='20']")
    label = page.get_attribute("#event-row", "aria-label")
    expected = "10 s: gap below s_min; 13 s: intervention: emergency braking;"
    expected += " 18 s: intervention: safety monitor brakes"
    assert label == f"interventions and broken limits: {expected}"
    assert page.inner_text("#figure-events") == "3"
    bad = page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--bad')")
    page.click("#events button:text-is('10 to 12 s: gap below s_min')")
    tile = page.locator("#tiles div", has=page.locator("#tile-margin"))
    tile.locator("text=gap below s_min").wait_for()
    as_rgb = tuple(int(bad.strip()[k : k + 2], 16) for k in (1, 3, 5))
    color = tile.locator("dd").first.evaluate("node => getComputedStyle(node).color")
    assert color == f"rgb{as_rgb}"
    page.evaluate("window.iptmPlayer.seek(5)")
    tile.locator("text=gap below s_min").wait_for(state="detached")


def test_the_saving_is_shown_as_far_as_the_reference_car_has_come(
    visit: Any, feed: PageFeed
) -> None:
    page = visit.page
    columns = ["time_s", "position_m", "battery_power_w", "capacity_loss"]
    state = {"state": "computing", "strategy": "reference", "columns": []}
    feed.put(STATE, state)
    drive(feed, range(81))
    page.wait_for_selector(
        "#saved-note:text-is('reference car (strategy reference): 0 % computed')"
    )
    assert page.is_visible("#reference-progress")
    feed.put(STATE, {**state, "columns": columns, "duration_s": 100.0})
    for time_s in range(41):
        feed.append("reference", [float(time_s), 20.0 * time_s, 14400.0, 1e-3 + 1e-8 * time_s])
    driven = {"as_driven": "as driven 50.0 % saved"}
    judged = {"percent": 31.25, "text": "31.3 % saved", **driven}
    short = {"percent": None, "text": "too short to judge", **driven}
    for time_s, share in ((10.0, short), (40.0, judged)):
        feed.append("savings", {"time_s": time_s, "energy": share, "others": "ageing: 7 %"})
    page.wait_for_selector("#saved:text-is('31.3 %')")
    note = (
        "after 40 s, against a car with strategy reference; as driven 50.0 % saved;"
        " reference car: 40 % computed"
    )
    assert page.inner_text("#saved-note") == note
    # 7.2 kW at 20 m/s are 10 kWh per 100 km.
    assert page.inner_text("#figure-energy") == "10.0"
    assert page.inner_text("#figures .note >> nth=0") == "other car 20.0"
    assert page.inner_text("#saved-others") == "ageing: 7 %"
    sizes = page.evaluate(
        "[...document.querySelectorAll('dd, .value')].map((n) => parseFloat(getComputedStyle(n).fontSize))"
    )
    saved = page.evaluate("parseFloat(getComputedStyle(document.getElementById('saved')).fontSize)")
    assert saved == max(sizes) > 1.5 * sorted(set(sizes))[-2]
    page.evaluate("window.iptmPlayer.seek(20)")
    page.wait_for_selector("#saved:text-is('too short to judge')")
    assert page.get_attribute("#saving", "data-level") == "none"
    feed.put(STATE, {**state, "state": "failed", "columns": columns, "reason": "no such cycle"})
    page.wait_for_selector("#saved-note:text-is('no reference car: no such cycle')")


def test_a_run_can_be_paused_while_it_goes_on(visit: Any, feed: PageFeed) -> None:
    page = visit.page
    drive(feed, range(21))
    page.wait_for_selector("#clock:text-is('20.0 / 100 s')")
    page.click("#play")
    drive(feed, range(21, 31))
    page.wait_for_selector("body[data-rows='31']")
    assert page.inner_text("#clock") == "20.0 / 100 s"
    assert page.inner_text("#connection") == "live, shown later"
    page.click("#to-end")
    page.wait_for_selector("#clock:text-is('30.0 / 100 s')")
    assert page.inner_text("#connection") == "live"


def test_a_bag_is_played_from_where_it_was_asked_to(visit: Any, feed: PageFeed) -> None:
    page = visit.page
    feed.put("play", {"rate": 25.0, "start_s": 40.0})
    drive(feed, range(101))
    feed.put("end", {"ended": True})
    page.wait_for_selector("body[data-player='playing']")
    assert page.evaluate("window.iptmPlayer.now") >= 40.0
    assert page.input_value("#speed") == "25"
    assert page.inner_text("#connection") == "replay"
    page.wait_for_selector("#clock:text-is('100.0 / 100 s')")
    page.wait_for_selector("body[data-player='live']")


def test_when_the_view_ends_the_page_stays_without_an_error(visitor: Any, feed: PageFeed) -> None:
    drive(feed, range(21))
    feed.put("end", {"ended": True})
    server = PageServer({"": feed}, 0)
    with visitor(server.url, Picture()) as visit:
        page = visit.page
        page.wait_for_selector("body[data-ended='true']")
        server.close()
        page.wait_for_selector("#connection:text-is('trip ended; view closed, replay works')")
        page.keyboard.press("Home")
        page.wait_for_selector("#clock:text-is('0.0 / 20 s')")
        # A browser that tried to reconnect would do so every three seconds.
        page.wait_for_timeout(4000)
        assert visit.complaints == []
